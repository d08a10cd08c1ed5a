"""Command wrapper: exit codes, messages, and files that are refused."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from pipelines.cli import app
from pipelines.doors import FileRole, guarded

ROOT = Path(__file__).parents[2]
SIMULATE = ["simulate", "--backswing", "60deg", "--ball", "jokku"]


def invoked(*words: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert "Traceback" not in result.output
    return result.exit_code, result.output


def test_two_options_may_not_name_one_file(tmp_path: Path) -> None:
    both = tmp_path / "a.json"
    code, said = invoked(*SIMULATE, "--json", both, "--csv", tmp_path / "." / "a.json")
    assert code == 2
    assert "named twice" in said
    assert not both.exists()
    assert invoked(*SIMULATE, "--json", "/dev/null", "--csv", "/dev/null")[0] == 0


def test_what_is_read_is_never_written(tmp_path: Path) -> None:
    table = tmp_path / "balls.csv"
    table.write_text("trial,t_s,x_m,y_m\n", encoding="utf-8")
    link = tmp_path / "link.csv"
    link.symlink_to(table)
    setup = tmp_path / "setup.toml"
    setup.write_text("", encoding="utf-8")
    for out in (table, link):
        code, said = invoked("explain", table, "--setup", setup, "--json", out)
        assert code == 2
        assert "the same file is an input" in said
    assert table.read_text(encoding="utf-8") == "trial,t_s,x_m,y_m\n"


def test_an_output_without_a_folder_is_refused_before_the_work(tmp_path: Path) -> None:
    code, said = invoked("measure", "no-such-clip.mp4", "--report", tmp_path / "no" / "a.html")
    assert code == 2
    assert "a.html" in said


def test_a_setup_of_nothing_but_mistakes_is_told_in_short(tmp_path: Path) -> None:
    setup = tmp_path / "setup.toml"
    setup.write_text("\n".join(f"k{i} = 1" for i in range(3000)), encoding="utf-8")
    code, said = invoked(*SIMULATE, "--setup", setup)
    assert code == 2
    assert "2988 more" in said
    assert len(said) < 3000


def test_a_name_too_long_for_the_file_system_is_no_clip() -> None:
    assert invoked("measure", "x" * 5000)[0] == 3


READS = {
    "setup": ["simulate", "--impact-speed", "2", "--setup", "@"],
    "laws": ["simulate", "--impact-speed", "2", "--cor-law", "@"],
    "table": ["explain", "@"],
    "effects": ["effects", "check", "@"],
    "tracks": ["convert", "@", "o.csv"],
    "tracks of a clip": ["measure", "--from-tracks", "@", "--fps", "240"],
    "clip": ["measure", "@", "--fps", "600"],
    "lab book": ["campaign", "a.mp4", "--trials", "@", "--out", "out"],
    "lens": ["calibrate", "wall", "a.mp4", "--lens", "@"],
    "campaign": ["campaign", "status", "@"],
    "pilot": ["plan", "campaign", "--target-cor-std", "0.01", "--pilot", "@"],
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("door", READS)
def test_what_is_no_regular_file_is_refused_at_once(
    door: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.mp4").write_bytes(b"x")
    for name in ("pipe.csv", "pipe.trk", "pipe.toml", "pipe.xlsx"):
        os.mkfifo(tmp_path / name)
    names = ["pipe.csv", "pipe.trk", "pipe.toml", "pipe.xlsx", "/dev/zero", "x" * 5000 + ".csv"]
    for name in names:
        code, said = invoked(*[name if word == "@" else word for word in READS[door]])
        assert code in (2, 3), (name[:20], said)
        assert len(said) < 1000 or door == "clip"
    assert not (tmp_path / "o.csv").exists()
    assert not (tmp_path / "out").exists()


LATE = {
    "explain": ["explain", "none.csv", "--setup", "none.toml", "--plot", "p.jpeg"],
    "simulate": [*SIMULATE, "--plot", "p.bmp"],
    "plan": ["plan", "--distance", "1.5 m", "--plot", "p.pdf"],
    "measure": ["measure", "none.mp4", "--overlay", "o.gif"],
    "many": ["measure", "none.mp4", "--out", "many", "--plot", "p.jpeg"],
}


@pytest.mark.parametrize("command", LATE)
def test_an_ending_that_cannot_be_written_is_refused_first(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, said = invoked(*LATE[command])
    assert code == 2
    assert said.startswith(f"vision: {LATE[command][-2]} {LATE[command][-1]}: unknown file ending")
    assert list(tmp_path.iterdir()) == []


def _command(fault: Exception) -> int | str | None:
    def fails(out: Annotated[Path | None, typer.Option(), FileRole.WRITES] = None) -> None:
        raise fault

    single = typer.Typer(pretty_exceptions_enable=False)
    single.command()(guarded(fails))
    return CliRunner().invoke(single, []).exit_code


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        (np.linalg.LinAlgError("singular matrix"), 4),
        (ZeroDivisionError("division by zero"), 4),
        (MemoryError(), 2),
        (OSError(28, "No space left on device"), 2),
        (KeyError("a bug"), 1),
        (ValueError("a bug"), 1),
    ],
)
def test_what_stops_a_command_has_its_exit_code(fault: Exception, code: int) -> None:
    assert _command(fault) == code


def test_libraries_that_do_not_fit_into_a_limit_are_told(tmp_path: Path) -> None:
    script = (
        "import resource; resource.setrlimit(resource.RLIMIT_AS, (400 << 20, 400 << 20))\n"
        "from pipelines.cli import app; app()"
    )
    ran = subprocess.run(
        [sys.executable, "-c", script, "measure", str(tmp_path / "a.mp4")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert ran.returncode in (2, 3), ran.stderr
    assert "Traceback" not in ran.stderr
    assert ran.returncode == 3 or "400 MiB" in ran.stderr


def _scipy_refuses() -> None:
    from scipy.optimize import least_squares

    least_squares(lambda x: np.full(3, np.nan), [1.0])


def _we_do() -> None:
    np.zeros(3) + np.zeros(4)


@pytest.mark.parametrize(("work", "code"), [(_scipy_refuses, 4), (_we_do, 1)])
def test_numbers_that_fail_are_told_and_slips_of_ours_stay_bugs(
    work: Callable[[], None], code: int
) -> None:
    single = typer.Typer(pretty_exceptions_enable=False)
    single.command()(guarded(work))
    ran = CliRunner().invoke(single, [])
    assert ran.exit_code == code
    assert ("can't be fitted" in ran.output) == (code == 4)


def test_debug_keeps_the_traceback_of_numbers_that_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    from pipelines.doors import DEBUG

    monkeypatch.setenv(DEBUG, "1")
    single = typer.Typer(pretty_exceptions_enable=False)
    single.command()(guarded(_scipy_refuses))
    ran = CliRunner().invoke(single, [])
    assert isinstance(ran.exception, ValueError)


def vision(*words: str | Path, stdout: int) -> subprocess.Popen[str]:
    script = "import sys\nfrom pipelines.cli import app\napp()"
    return subprocess.Popen(
        [sys.executable, "-c", script, *map(str, words)],
        cwd=ROOT,
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_a_full_or_closed_stdout_is_no_traceback() -> None:
    with open("/dev/full", "wb") as full:
        running = vision(*SIMULATE, stdout=full.fileno())
        said = running.communicate(timeout=120)[1]
    assert running.returncode == 2
    assert "full" in said
    assert "Traceback" not in said
    read, write = os.pipe()
    os.close(read)
    running = vision(*SIMULATE, "--json", "-", stdout=write)
    os.close(write)
    said = running.communicate(timeout=120)[1]
    assert running.returncode == 128 + signal.SIGPIPE
    assert "Traceback" not in said


def test_a_terminated_command_leaves_no_temporary(tmp_path: Path) -> None:
    running = vision("render", "-o", tmp_path / "a.mp4", stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not list(tmp_path.glob(".a-*")) and time.monotonic() < deadline:
        time.sleep(0.02)
    running.terminate()
    running.communicate(timeout=60)
    assert running.returncode == 128 + signal.SIGTERM
    assert list(tmp_path.iterdir()) == []
