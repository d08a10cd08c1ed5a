"""What is kept on disk: found again only where nothing it follows from has changed."""

import io
import json
import math
import os
import pickle
import subprocess
import sys
import zipfile
from dataclasses import MISSING, fields, replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from measuring import cache as module
from measuring.cache import Cache, clip_digest
from measuring.chain import (
    FittedClip,
    MeasureOptions,
    fitted_once,
    measure_clip,
    measured_once,
    tracked_once,
)
from measuring.measurement import ClipMeasurement, tracks_as_csv
from measuring.setup.file import CameraSetup, Setup, load_setup
from metrology import ClipError, Quantity
from metrology.stored import dump, load
from pipelines.cli import app
from pipelines.measure.files import measurement_as_json
from tests.shared_data import shared_folder
from vision.clip.footage import CaptureRate, RateSource
from vision.clip.picture import ClipInfo
from vision.tracks import Track, Tracks


def test_an_entry_is_found_by_everything_it_follows_from(tmp_path: Path) -> None:
    kept = Cache(tmp_path)
    key = kept.key("following", "abc", 600.0, None)
    assert kept.get(key) is None
    kept.put(key, {"x": 1.0})
    assert kept.get(key) == {"x": 1.0}
    assert kept.get(kept.key("following", "abc", 601.0, None)) is None
    assert kept.get(kept.key("measuring", "abc", 600.0, None)) is None


def test_a_change_of_the_code_is_not_answered_from_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = tmp_path / "vision"
    room.mkdir()
    (room / "following.py").write_text("LIMIT = 1\n")
    monkeypatch.setattr(module, "__file__", str(tmp_path / "measuring" / "cache.py"))
    kept = Cache(tmp_path / "kept")
    module._code.cache_clear()
    before = kept.key("following", "abc")
    (room / "following.py").write_text("LIMIT = 2\n")
    os.utime(room / "following.py", ns=(1, 1))
    module._code.cache_clear()
    assert kept.key("following", "abc") != before
    module._code.cache_clear()


def test_a_damaged_entry_counts_as_missing(tmp_path: Path) -> None:
    kept = Cache(tmp_path)
    key = kept.key("following", 1)
    kept.put(key, "whole")
    (entry,) = tmp_path.iterdir()
    whole = entry.read_bytes()
    for damage in (b"", b"\x80\x05half", whole[: len(whole) // 2], whole[:-1] + b"x"):
        entry.write_bytes(damage)
        assert kept.get(key) in (None, "whole")
    entry.write_bytes(whole)
    assert kept.get(key) == "whole"


def test_the_oldest_entries_go_when_there_is_too_much(tmp_path: Path) -> None:
    kept = Cache(tmp_path, limit_bytes=3500)
    keys = [kept.key("following", index) for index in range(4)]
    for age, key in enumerate(keys):
        kept.put(key, bytes(1000))
        path = next(p for p in tmp_path.iterdir() if p.stem == key)
        os.utime(path, (age, age))
    kept.put(keys[0], bytes(1000))
    assert [kept.get(key) is not None for key in keys] == [True, False, False, True]
    assert kept.clear() > 2000
    assert kept.size() == 0


def test_two_processes_may_write_the_same_entry_at_once(tmp_path: Path) -> None:
    script = (
        "import sys\nfrom pathlib import Path\nfrom measuring.cache import Cache\n"
        "kept = Cache(Path(sys.argv[1]))\n"
        "for _ in range(50):\n"
        "    kept.put('following-1', bytes(100_000))\n"
        "    found = kept.get('following-1')\n"
        "    assert found is not None and len(found) == 100_000\n"
    )
    writers = [
        subprocess.Popen([sys.executable, "-c", script, str(tmp_path)], cwd=Path.cwd())
        for _ in range(2)
    ]
    assert [writer.wait() for writer in writers] == [0, 0]
    assert len(list(tmp_path.iterdir())) == 1


class Command:
    """A pickle of it runs a command when it is read."""

    def __init__(self, command: str) -> None:
        self.command = command

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, (self.command,)


def test_a_foreign_file_in_the_folder_runs_nothing(tmp_path: Path) -> None:
    kept, proof = Cache(tmp_path / "kept"), tmp_path / "proof"
    keys = [kept.key("following", name) for name in range(4)]
    for key in keys:
        kept.put(key, np.arange(3.0))
    bomb = pickle.dumps(Command(f"touch {proof}"))
    for suffix in (".pickle", ".npz"):
        (kept.folder / f"{keys[0]}{suffix}").write_bytes(bomb)  # type: ignore[operator]
    members = io.BytesIO()
    with zipfile.ZipFile(members, "w") as content:
        array = io.BytesIO()
        np.lib.format.write_array(array, np.array([Command(f"touch {proof}")], dtype=object))
        content.writestr("0.npy", array.getvalue())
        content.writestr("tree.json", json.dumps(["array", 0]))
    (kept.folder / f"{keys[1]}.npz").write_bytes(members.getvalue())  # type: ignore[operator]
    for key, tree in zip(
        keys[2:],
        (["object", "os:system", {}], ["object", "measuring.cache:os.system", {"x": "true"}]),
        strict=True,
    ):
        with zipfile.ZipFile(kept.folder / f"{key}.npz", "w") as content:  # type: ignore[operator]
            content.writestr("tree.json", json.dumps(tree))
    assert [kept.get(key) for key in keys] == [None] * 4
    assert not proof.exists()


def test_entries_that_others_could_have_written_are_not_read(tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    kept = Cache(folder)
    key = kept.key("following", 1)
    kept.put(key, 1.5)
    (entry,) = folder.iterdir()
    assert kept.get(key) == 1.5
    assert entry.stat().st_mode & 0o077 == 0
    entry.chmod(0o666)
    assert kept.get(key) is None
    entry.chmod(0o600)
    folder.chmod(0o777)
    assert kept.get(key) is None
    assert "others may write to it" in shown(folder)
    folder.chmod(0o700)
    assert "not read" not in shown(folder)
    moved = entry.rename(tmp_path / "elsewhere.npz")
    entry.symlink_to(moved)
    assert kept.get(key) is None
    entry.unlink()
    os.mkfifo(entry, 0o600)
    assert kept.get(key) is None


def shown(folder: Path) -> str:
    """What `vision cache show` prints."""
    said = CliRunner().invoke(app, ["cache", "show"], env={module.FOLDER_VARIABLE: str(folder)})
    return " ".join(said.output.split())


def test_entries_of_old_versions_and_of_killed_processes_are_removed(tmp_path: Path) -> None:
    kept = Cache(tmp_path)
    for name in ("following-1.pickle", ".writing-old", ".writing-new"):
        (tmp_path / name).write_bytes(b"x")
    os.utime(tmp_path / ".writing-old", (1, 1))
    kept.put(kept.key("following"), 1)
    assert {path.name for path in tmp_path.iterdir()} == {
        f"{kept.key('following')}.npz",
        ".writing-new",
    }


def test_what_a_measurement_holds_comes_back_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(module.FOLDER_VARIABLE, str(tmp_path))
    clip = shared_folder("inputs") / "base_strike.mkv"
    options = MeasureOptions(setup=load_setup(clip.parent / "lab.toml"), fps=600.0, cache=True)
    fresh = measure_clip(clip, options)
    assert sorted(path.name.split("-")[0] for path in tmp_path.iterdir()) == [
        "measurement",
        "tracks",
    ]
    for again in (
        measure_clip(clip, options),
        measure_clip(clip, replace(options, wanted=("cor",))),
    ):
        assert again is not fresh
        assert measurement_as_json(again) == measurement_as_json(fresh)
        assert tracks_as_csv(again) == tracks_as_csv(fresh)


@pytest.mark.parametrize(
    "value",
    [
        {"a": [1, 2.5, float("inf"), None, True], ("b", 3): {"x", "y"}, "c": frozenset({1})},
        (np.float64(1.5), np.int64(3), np.bool_(True), b"bytes", Path("a/b"), RateSource.OPTION),
        (Fraction(5, 2), Fraction(1)),
    ],
)
def test_plain_values_keep_their_types(value: object) -> None:
    found = load(dump(value))
    assert found == value
    assert type(found) is type(value)
    if isinstance(value, tuple):
        assert [type(one) for one in found] == [type(one) for one in value]  # type: ignore[attr-defined]


def test_what_is_shared_stays_shared() -> None:
    rate = CaptureRate(600.0, math.nan, RateSource.OPTION, None)
    array = np.arange(6.0).reshape(2, 3)[:, ::2]
    one, other, first, second = load(dump((rate, rate, array, array)))
    assert one is other
    assert math.isnan(one.std)
    assert first is second
    assert first.tolist() == array.tolist()


@pytest.mark.parametrize("value", [object(), lambda: 1, np.array([object()]), Command("true")])
def test_objects_of_others_are_not_stored(value: object, tmp_path: Path) -> None:
    with pytest.raises(TypeError):
        dump(value)
    Cache(tmp_path).put("following-1", value)
    assert list(tmp_path.iterdir()) == []


def test_a_cache_that_is_switched_off_keeps_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(module.FOLDER_VARIABLE, "off")
    kept = Cache.of_user()
    kept.put(kept.key("following"), 1)
    assert kept.get(kept.key("following")) is None
    assert Cache.of_user(wanted=False).folder is None


def test_a_folder_of_pictures_is_known_by_names_and_contents(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"one")
    before = clip_digest(tmp_path)
    (tmp_path / "a.png").rename(tmp_path / "b.png")
    assert clip_digest(tmp_path) != before


@pytest.mark.timeout(20)
def test_a_pipe_or_a_device_is_refused_before_it_is_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mp4")
    for path in (tmp_path / "pipe.mp4", Path("/dev/zero")):
        with pytest.raises(ClipError, match="not a regular file"):
            clip_digest(path)


def empty_measurement(path: Path) -> ClipMeasurement:
    info = ClipInfo(path, "", 8, 6, 2, "h264", 30.0, True, 1.0, 0, "progressive", 8, None, False)
    empty = {field.name: None for field in fields(ClipMeasurement) if field.default is MISSING} | {
        "info": info,
        "rate": CaptureRate(600.0, 0.0, RateSource.OPTION, None),
        "quantities": (),
        "gravity": Quantity.missing("gravity_check", "m/s^2", "no flight"),
    }
    return ClipMeasurement(**empty)  # type: ignore[arg-type]


def test_a_clip_is_measured_once_for_all_that_is_said_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The measurement itself is not looked at: any record of one will do."""
    monkeypatch.setenv(module.FOLDER_VARIABLE, str(tmp_path / "kept"))
    clip, lens = tmp_path / "a.mp4", tmp_path / "lens.toml"
    clip.write_bytes(b"one")
    lens.write_text("fx = 900\n")
    asked: list[MeasureOptions] = []

    def measure(path: Path, options: MeasureOptions, *_: object) -> ClipMeasurement:
        asked.append(options)
        return empty_measurement(path)

    measured = measured_once(measure)
    options = MeasureOptions(setup=Setup(camera=CameraSetup(lens=lens)), ball="jokku", cache=True)
    measured(clip, options, None)
    moved = clip.rename(tmp_path / "b.mp4")
    assert measured(moved, options, None).info.path == moved
    assert len(asked) == 1
    measured(moved, replace(options, ball="basketball"), None)
    lens.write_text("fx = 901\n")
    measured(moved, options, None)
    moved.write_bytes(b"two")
    measured(moved, options, None)
    measured(moved, replace(options, cache=False), None)
    assert len(asked) == 5


def test_a_question_is_answered_by_the_whole_measurement_where_there_is_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(module.FOLDER_VARIABLE, str(tmp_path / "kept"))
    clip = tmp_path / "a.mp4"
    clip.write_bytes(b"one")
    asked: list[tuple[str, ...] | None] = []

    def measure(path: Path, options: MeasureOptions, *_: object) -> ClipMeasurement:
        asked.append(options.wanted)
        return empty_measurement(path)

    measured = measured_once(measure)
    contact, cor = ("contact_time",), ("cor",)
    for wanted in (contact, contact, None, cor, contact, None):
        measured(clip, MeasureOptions(cache=True, wanted=wanted), None)
    assert asked == [contact, None]


def test_two_questions_about_a_clip_share_its_fits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(module.FOLDER_VARIABLE, str(tmp_path))
    done: list[FittedClip] = []

    class Info:
        sha256 = "ab"

    class Clip:
        info = Info()

    def fit() -> FittedClip:
        done.append(FittedClip(None, None, None))  # type: ignore[arg-type]
        return done[-1]

    clip: object = Clip()
    options = MeasureOptions(cache=True)
    for wanted, ball in ((("contact_time",), None), (("cor",), None), (("cor",), "jokku")):
        fitted_once(clip, replace(options, wanted=wanted, ball=ball), fit)  # type: ignore[arg-type]
    assert len(done) == 2


def some_tracks(place: float) -> Tracks:
    one, square = np.ones(1), np.eye(2)[np.newaxis]
    ball = Track(np.arange(1), one, np.full((1, 2), place), square, square, one, one, one)
    return Tracks(ball, None, np.zeros((1, 1), np.float32), None)


def test_a_clip_is_followed_once_whatever_is_said_of_the_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(module.FOLDER_VARIABLE, str(tmp_path))
    rng = np.random.default_rng(0)

    class AClip:
        info = ClipInfo(
            tmp_path / "a.mp4",
            "ab",
            8,
            6,
            2,
            "h264",
            30.0,
            True,
            1.0,
            0,
            "progressive",
            8,
            None,
            False,
        )
        warnings = ("damaged",)

        def capture_times(self, fps: float) -> object:
            return np.arange(2) / fps

    def follow() -> object:
        return some_tracks(rng.random())

    options = MeasureOptions(cache=True)
    clip: object = AClip()
    first = tracked_once(clip, 600.0, options, follow)  # type: ignore[arg-type]
    again = tracked_once(clip, 600.0, replace(options, ball="jokku"), follow)  # type: ignore[arg-type]
    place = first.tracks.ball.centre_px
    assert again.tracks.ball.centre_px.tolist() == place.tolist()
    assert again.warnings == ("damaged",)
    shown = tracked_once(clip, 600.0, replace(options, ball_at=(3.0, 4.0)), follow)  # type: ignore[arg-type]
    assert shown.tracks.ball.centre_px.tolist() != place.tolist()
