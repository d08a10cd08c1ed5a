"""Files are written completely or not at all; only small texts are read."""

import os
import stat
import subprocess
import sys
import threading
from functools import partial
from pathlib import Path

import pytest

from metrology import (
    OutputError,
    SetupError,
    UsageError,
    parse_toml,
    read_small_text,
    refuse_unwritable,
    write_each,
    write_text_whole,
    written_whole,
)


def left_over(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]


def test_a_device_stays_a_device() -> None:
    before = os.stat("/dev/null").st_rdev
    write_text_whole(Path("/dev/null"), "words")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    assert os.stat("/dev/null").st_rdev == before


def test_a_pipe_gets_all_that_was_written(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    got: list[str] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_text(encoding="utf-8")))
    reader.start()
    words = "0123456789" * 30_000
    write_text_whole(pipe, words)
    reader.join(timeout=10)
    assert got == [words]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_full_device_is_reported_and_nothing_is_left() -> None:
    with pytest.raises(OutputError, match="/dev/full"):
        write_text_whole(Path("/dev/full"), "words")


def test_a_link_is_followed_and_the_file_keeps_its_mode(tmp_path: Path) -> None:
    real, link = tmp_path / "real.txt", tmp_path / "link.txt"
    real.write_text("old", encoding="utf-8")
    real.chmod(0o600)
    link.symlink_to(real)
    write_text_whole(link, "new")
    assert link.is_symlink()
    assert real.read_text(encoding="utf-8") == "new"
    assert stat.S_IMODE(real.stat().st_mode) == 0o600


def test_a_new_file_has_the_mode_that_the_users_mask_leaves(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_text_whole(tmp_path / "new.txt", "words")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "new.txt").stat().st_mode) == 0o640


def test_a_failure_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "kept.txt"
    path.write_text("old", encoding="utf-8")

    def fail_half_way() -> None:
        with written_whole(path) as temporary:
            temporary.write_text("half", encoding="utf-8")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_half_way()
    assert path.read_text(encoding="utf-8") == "old"
    assert left_over(tmp_path) == []


def test_a_disk_that_fills_up_is_reported(tmp_path: Path) -> None:
    script = (
        "import resource, signal, sys; from pathlib import Path\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "from metrology import OutputError, write_text_whole\n"
        "try: write_text_whole(Path(sys.argv[1]), 'x' * 5000)\n"
        "except OutputError as problem: print(problem)\n"
    )
    said = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "big.txt")],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert "big.txt" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["no/such/folder/a.csv", "folder", "n" * 300 + ".csv"])
def test_an_output_that_cannot_be_written_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError):
        write_text_whole(tmp_path / name, "words")
    if len(name) < 256:
        with pytest.raises(OutputError):
            refuse_unwritable(tmp_path / name)


@pytest.mark.parametrize(
    ("mark", "encoding"), [("", "utf-8"), ("\ufeff", "utf-8"), ("\ufeff", "utf-16-le")]
)
def test_texts_are_read_with_or_without_a_byte_order_mark(
    tmp_path: Path, mark: str, encoding: str
) -> None:
    path = tmp_path / "setup.toml"
    path.write_bytes((mark + "mass = '1 kg ± 2 g'").encode(encoding))
    assert read_small_text(path) == "mass = '1 kg ± 2 g'"


def test_a_file_that_is_no_small_text_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").write_bytes(b"a" * (5 << 20))
    (tmp_path / "bytes").write_bytes(b"\xff\x00\xfe\x81" * 9)
    wrong = [tmp_path / name for name in ("pipe", "large", "bytes", "none", "x" * 5000)]
    for path in [*wrong, tmp_path, Path("/dev/zero")]:
        with pytest.raises(UsageError, match="can't read"):
            read_small_text(path)


@pytest.mark.parametrize(
    "text", ["a = " + "[" * 20_000, "a = " + "9" * 5000, "a = 1\na = 2", "a = \x01"]
)
def test_invalid_toml_is_reported_in_short(text: str) -> None:
    with pytest.raises(SetupError, match=r"lab\.toml") as told:
        parse_toml(text, "lab.toml")
    assert len(str(told.value)) < 400


def test_a_number_beyond_all_floats_is_refused_by_its_key() -> None:
    with pytest.raises(SetupError, match=r"lab.toml: scatter.cor is a whole number of 400 digits"):
        parse_toml(f"[scatter]\ncor = {'9' * 400}\n", "lab.toml")
    assert parse_toml(f"a = [{2**63 - 1}, -3]", "lab.toml") == {"a": [2**63 - 1, -3]}


def test_a_name_that_is_no_text_is_written_as_an_escape(tmp_path: Path) -> None:
    write_text_whole(tmp_path / "a.json", '{"clip": "a\udcff.mp4"}')
    assert (tmp_path / "a.json").read_bytes() == b'{"clip": "a\\udcff.mp4"}'


@pytest.mark.timeout(20)
def test_a_pipe_that_nothing_reads_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("metrology.files._MAX_READER_WAIT_S", 0.2)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="nothing reads this pipe"):
        write_text_whole(tmp_path / "pipe", "a")


def test_a_file_that_fails_does_not_stop_the_others(tmp_path: Path) -> None:
    def refuse() -> None:
        raise UsageError("nothing to plot", hint="Omit --plot.")

    paths = tmp_path / "a.txt", tmp_path / "no" / "b.txt", tmp_path / "c.txt"
    writers = [refuse, *(partial(write_text_whole, path, "words") for path in paths)]
    with pytest.raises(OutputError) as raised:
        write_each(writers)
    assert "nothing to plot" in raised.value.message
    assert "b.txt" in raised.value.message
    assert [path.exists() for path in paths] == [True, False, True]
