"""What is kept on disk: found again only where nothing it follows from has changed."""

import os
import subprocess
import sys
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path

import numpy as np
import pytest

from metrology import ClipError, Quantity
from pipelines import cache as module
from pipelines.cache import Cache, clip_digest
from pipelines.measure.chain import (
    FittedClip,
    MeasureOptions,
    fitted_once,
    measured_once,
    tracked_once,
)
from pipelines.measure.measurement import ClipMeasurement
from pipelines.setup.file import CameraSetup, Setup
from vision.clip.footage import CaptureRate, RateSource
from vision.clip.picture import ClipInfo


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
    monkeypatch.setattr(module, "__file__", str(tmp_path / "pipelines" / "cache.py"))
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
    next(tmp_path.glob("*.pickle")).write_bytes(b"\x80\x05half")
    assert kept.get(key) is None


def test_the_oldest_entries_go_when_there_is_too_much(tmp_path: Path) -> None:
    kept = Cache(tmp_path, limit_bytes=2500)
    keys = [kept.key("following", index) for index in range(4)]
    for age, key in enumerate(keys):
        kept.put(key, bytes(1000))
        path = next(p for p in tmp_path.glob("*.pickle") if p.stem == key)
        os.utime(path, (age, age))
    kept.put(keys[0], bytes(1000))
    assert [kept.get(key) is not None for key in keys] == [True, False, False, True]
    assert kept.clear() > 2000
    assert kept.size() == 0


def test_two_processes_may_write_the_same_entry_at_once(tmp_path: Path) -> None:
    script = (
        "import sys\nfrom pathlib import Path\nfrom pipelines.cache import Cache\n"
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

    def measure(path: Path, options: MeasureOptions, progress: object) -> ClipMeasurement:
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

    def measure(path: Path, options: MeasureOptions, progress: object) -> ClipMeasurement:
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


@dataclass(frozen=True)
class SomeTracks:
    """What was followed, of a file that lacks no frames."""

    place: float

    def on_clock(self, clock: object) -> object:
        return clock


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
        return SomeTracks(rng.random())

    options = MeasureOptions(cache=True)
    clip: object = AClip()
    first = tracked_once(clip, 600.0, options, follow)  # type: ignore[arg-type]
    again = tracked_once(clip, 600.0, replace(options, ball="jokku"), follow)  # type: ignore[arg-type]
    assert (again.tracks, again.warnings) == (first.tracks, ("damaged",))
    shown = tracked_once(clip, 600.0, replace(options, ball_at=(3.0, 4.0)), follow)  # type: ignore[arg-type]
    assert shown.tracks != first.tracks
