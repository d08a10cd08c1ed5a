"""The open clip: measured in a process, corrected, undone; nothing a person wrote is lost."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pipelines.app.corrections import (
    ClipInputs,
    Corrections,
    corrections_file,
    read_corrections,
    table_file,
)
from pipelines.app.openings import Recent
from pipelines.app.session import AppSession, ClipSession
from tests.pipelines.app.small import FALL, falling

RATE = Corrections(ClipInputs(fps="240"))


def until(holds: Callable[[], bool], wait_s: float = 120.0) -> None:
    end = time.monotonic() + wait_s
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)


def settled(clip: ClipSession) -> None:
    until(lambda: not clip.busy)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AppSession]:
    one = AppSession(recent=Recent(tmp_path_factory.mktemp("state") / "recent.json"))
    yield one
    one.end()


def _heights(clip: ClipSession) -> dict[int, float]:
    """Row of the ball's centre by frame, px."""
    ball = clip.marks()["objects"][0]
    return dict(zip(ball["frame"], ball["y"], strict=True))


def test_a_clip_is_measured_corrected_and_restored(session: AppSession, tmp_path: Path) -> None:
    path = falling(tmp_path / "<b>drop")
    clip = session.open_clip(path)
    assert clip.busy
    settled(clip)
    clip.change(RATE)
    settled(clip)
    assert clip.problem == ""
    assert clip.measured is not None
    fall = clip.measured.quantity("fall_acceleration_px")
    assert fall.value == pytest.approx(2 * FALL * 240.0**2, rel=0.06)
    before = _heights(clip)

    assert clip.frames.wait_until_open(10.0)
    clip.mark("ball", 20, 61.0, before[20], moved=True)
    assert "--from-tracks" in clip.as_command()
    settled(clip)
    assert clip.problem == ""
    assert clip.measured is not None
    assert table_file(path).is_file()
    assert read_corrections(corrections_file(path)).ball[0].frame == 20
    # the outline is fitted again from there: a mark a pixel off changes nothing
    after = _heights(clip)
    assert len(after.keys() & before.keys()) > 30
    assert all(abs(after[frame] - before[frame]) < 0.2 for frame in after.keys() & before.keys())

    clip.undo()
    settled(clip)
    assert read_corrections(corrections_file(path)) == RATE
    assert "--from-tracks" not in clip.as_command()
    again = session.open_clip(path)
    assert again.corrections == RATE
    assert again.number != clip.number
    settled(again)
    assert again.measured is not None


def test_a_new_task_replaces_the_one_under_way(session: AppSession, tmp_path: Path) -> None:
    clip = session.open_clip(falling(tmp_path / "clip"))
    for fps in ("100", "150", "240"):
        clip.change(Corrections(ClipInputs(fps=fps)))
    settled(clip)
    assert clip.measured is not None
    assert clip.measured.rate.fps == 240.0


def test_a_measuring_process_that_dies_is_reported_and_replaced(
    session: AppSession, tmp_path: Path
) -> None:
    clip = session.open_clip(falling(tmp_path / "clip"))
    session.measurer._process.process.kill()
    settled(clip)
    assert "ended unexpectedly" in clip.problem
    clip.begin()
    settled(clip)
    assert clip.measured is not None


def test_nothing_moves_and_the_page_still_answers(session: AppSession, tmp_path: Path) -> None:
    clip = session.open_clip(falling(tmp_path / "one", frames=1))
    settled(clip)
    assert "too few to show a motion" in clip.problem
    assert clip.frames.jpeg(0, 10.0) is not None
    clip.change(Corrections(ClipInputs(fps="fast")))
    assert not clip.busy
    assert "--fps" in clip.problem
    clip.undo()
    settled(clip)
    assert "too few to show" in clip.problem


def test_a_clip_that_was_moved_is_a_sentence_and_its_numbers_stay(
    session: AppSession, tmp_path: Path
) -> None:
    path = falling(tmp_path / "drop")
    clip = session.open_clip(path)
    settled(clip)
    assert clip.frames.jpeg(35, 60.0) is not None
    path.rename(tmp_path / "elsewhere")
    clip.mark("ball", 10, 61.0, 31.0, moved=True)
    settled(clip)
    assert "drop" in clip.problem
    assert clip.figures
    assert clip.frames.jpeg(3) is not None
    (tmp_path / "elsewhere").rename(path)
    clip.undo()
    settled(clip)
    assert not clip.problem


def test_a_file_that_can_not_be_read_is_kept(session: AppSession, tmp_path: Path) -> None:
    path = falling(tmp_path / "clip")
    file = corrections_file(path)
    file.write_text("[[ball]\nmine = 1\n")
    clip = session.open_clip(path)
    assert "not valid TOML" in clip.unsaved
    assert clip.corrections == Corrections()
    clip.change(RATE)
    assert clip.unsaved == ""
    assert read_corrections(file) == RATE
    assert file.with_name(f"{file.name}.old").read_text() == "[[ball]\nmine = 1\n"
    settled(clip)


def test_the_set_up_file_of_the_same_name_is_taken(session: AppSession, tmp_path: Path) -> None:
    path = falling(tmp_path / "clip")
    (tmp_path / "clip.toml").write_text("[camera]\ncapture_fps = 240\n")
    clip = session.open_clip(path)
    assert clip.corrections.inputs.setup == "clip.toml"
    settled(clip)
    assert clip.measured is not None
    assert clip.measured.rate.fps == 240.0


def test_corrections_that_can_not_be_saved_still_count(session: AppSession, tmp_path: Path) -> None:
    path = falling(tmp_path / "clip")
    clip = session.open_clip(path)
    corrections_file(path).mkdir()
    clip.change(RATE)
    assert clip.unsaved
    settled(clip)
    assert clip.measured is not None
    assert clip.measured.rate.fps == 240.0
