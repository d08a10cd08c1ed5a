"""Clips in which nothing is struck, and pictures of no usual size: no number without a motion."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from measuring.chain import MeasureOptions, measure_clip
from metrology import ClipError, NotFoundError
from pipelines.cli import app
from tests.pipelines.measure.small_clips import Frames, written
from tests.vision.ball.painted import struck_ball
from vision.tracks import MotionKind

WIDTH, HEIGHT, COUNT = 128, 72, 30
OVERSAMPLED = 4


def painted(draw: Callable[[np.ndarray, int], None]) -> Frames:
    """Frames of a mottled wall with something drawn on it, four times as large, and noise."""
    rng = np.random.default_rng(1)
    coarse = 150.0 + 20.0 * rng.normal(size=(9, 16)).astype(np.float32)
    wall = cv2.resize(coarse, (WIDTH * OVERSAMPLED, HEIGHT * OVERSAMPLED))
    frames = []
    for index in range(COUNT):
        large = wall.copy()
        draw(large, index)
        small = cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
        noisy = (small + rng.normal(0.0, 1.5, small.shape)).clip(0, 255).astype(np.uint8)
        frames.append(np.repeat(noisy[:, :, np.newaxis], 3, axis=2))
    return frames


def box_that_slides(picture: np.ndarray, index: int) -> None:
    left = OVERSAMPLED * (5 + 3 * index)
    cv2.rectangle(picture, (left, 120), (left + 56, 156), 40.0, -1)


def ten_balls_that_roll(picture: np.ndarray, index: int) -> None:
    for ball in range(10):
        x, y = 12.0 + (1.0 + 0.3 * ball) * index, 4.0 + 7.0 * ball
        centre = (round(OVERSAMPLED * x), round(OVERSAMPLED * y))
        cv2.circle(picture, centre, OVERSAMPLED * 4, 30.0 + 10.0 * ball, -1)


@pytest.mark.parametrize("draw", [box_that_slides, ten_balls_that_roll])
def test_what_goes_straight_on_is_no_swing_and_gives_no_number(
    draw: Callable[[np.ndarray, int], None], tmp_path: Path
) -> None:
    found = measure_clip(written(painted(draw), tmp_path / "clip.mp4"))
    assert [item.name for item in found.quantities if item.known] == []
    even = (MotionKind.NONE, MotionKind.ROLL, MotionKind.SLIDE)
    assert found.motion.measured_as in even or found.motion.probability < 0.5
    assert all(item.reason for item in found.quantities)
    assert not any("was struck" in said for said in found.warnings)


def test_where_nothing_is_measured_its_different_reasons_are_told(tmp_path: Path) -> None:
    path = written(painted(ten_balls_that_roll), tmp_path / "clip.mp4")
    reasons = {item.reason for item in measure_clip(path).quantities if item.reason}
    result = CliRunner().invoke(app, ["measure", str(path), "--quiet"])
    assert result.exit_code == 4
    refusal = " ".join(result.output.split()).partition("nothing can be measured")[2]
    assert sum(" ".join(reason.split()) in refusal for reason in reasons) >= 2


def test_a_bar_that_moves_on_evenly_gives_no_number_and_no_collision(tmp_path: Path) -> None:
    # its two ends, seen one after the other, pass for two like balls
    def bar(picture: np.ndarray, index: int) -> None:
        middle = 118.0 - 3.71 * index
        corner = [(middle - 39.8, 34.0), (middle + 39.8, 42.0)]
        ends = [(round(OVERSAMPLED * x), round(OVERSAMPLED * y)) for x, y in corner]
        cv2.rectangle(picture, ends[0], ends[1], 70.0, -1)

    found = measure_clip(written(painted(bar), tmp_path / "clip.mp4"))
    assert [item.name for item in found.quantities if item.known] == []
    assert found.motion.kind is not MotionKind.COLLISION


def coloured(pictures: list[np.ndarray]) -> Frames:
    return [np.repeat(picture[:, :, np.newaxis], 3, axis=2) for picture in pictures]


STRUCK = {"contact_time", "contact_frames", "contact_start", "contact_end", "ball_speed"}


@pytest.mark.parametrize(
    ("begin", "frames"), [(0, 36), (46, 34)], ids=["the ball is never struck", "struck before"]
)
def test_a_strike_out_of_the_clip_gives_no_number_of_a_strike(
    begin: int, frames: int, tmp_path: Path
) -> None:
    pictures = struck_ball(frames, begin=begin)[0].pictures
    path = written(coloured(pictures), tmp_path / "clip.mp4")
    try:
        found = measure_clip(path, MeasureOptions(ball="basketball", fps=200.0))
    except NotFoundError:
        return
    assert found.motion.kind is not MotionKind.STRIKE
    assert [item.name for item in found.quantities if item.known and item.name in STRUCK] == []


def test_a_strike_played_in_reverse_is_named(tmp_path: Path) -> None:
    pictures = coloured(struck_ball(80)[0].pictures)[::-1]
    path = written(pictures, tmp_path / "clip.mp4")
    found = measure_clip(path, MeasureOptions(ball="basketball", fps=200.0, kind=MotionKind.STRIKE))
    reasons = {one.reason for one in found.quantities if not one.known}
    assert any("played in reverse" in (reason or "") for reason in reasons)


@pytest.mark.slow
def test_of_two_strikes_one_is_measured_and_how_to_measure_the_other_is_told(
    tmp_path: Path,
) -> None:
    struck, centres, _ = struck_ball()
    # dark for light: the same wall once more is hardly another scene, and an encoder that does not
    # write the same bytes twice decided whether it was
    dark = [(230 - 0.8 * picture).astype(np.uint8) for picture in struck.pictures]
    pictures = [*struck.pictures, *dark]
    path = written(coloured(pictures), tmp_path / "clip.mp4")
    found = measure_clip(path)
    assert any("cut between frames 79 and 80" in said for said in found.warnings)
    angle = found.quantity("launch_angle")
    step = centres[41] - centres[40]
    true = float(np.degrees(np.arctan2(-step[1], step[0])))
    assert angle.std < 4.0
    assert angle.value == pytest.approx(true, abs=3.0 * angle.std)
    x, y = centres[50]
    pointing = MeasureOptions(ball_at=(float(x), float(y), 130))
    other = measure_clip(path, pointing)
    # in frames: whether the fall tells the camera's rate, too, is decided by what the encoder wrote
    ends = [one.tracks.rest_frames[1] for one in (found, other)]
    assert ends[1] - ends[0] == pytest.approx(len(centres), abs=4.0)


def test_a_few_pictures_are_no_recording(tmp_path: Path) -> None:
    with pytest.raises(ClipError, match="3 frames, too few"):
        measure_clip(written(coloured(struck_ball(80)[0].pictures[:3]), tmp_path / "clip.mp4"))


def test_noise_holds_no_ball(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    frames = [rng.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8) for _ in range(COUNT)]
    with pytest.raises(NotFoundError, match="no ball found"):
        measure_clip(written(frames, tmp_path / "clip.mp4"))


def test_pictures_too_small_are_refused_with_their_size(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    frames = [rng.integers(0, 255, (8, 100, 3), dtype=np.uint8) for _ in range(20)]
    with pytest.raises(ClipError, match="100 × 8 px are too small"):
        measure_clip(written(frames, tmp_path / "clip.mp4"))


def test_black_frames_before_a_fade_are_no_error(tmp_path: Path) -> None:
    frames = painted(box_that_slides)
    black = [np.zeros_like(frames[0])] * COUNT
    found = measure_clip(written([*black, *frames[:3]], tmp_path / "clip.mp4"))
    assert found.motion.kind is MotionKind.NONE
    assert not any(item.known for item in found.quantities)


@pytest.mark.slow
def test_huge_pictures_are_looked_through(tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for index in range(3):
        picture = np.full((5000, 9000), 40 * index, dtype=np.uint8)
        cv2.imwrite(str(folder / f"{index}.png"), picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    with pytest.raises(NotFoundError, match="no ball found"):
        measure_clip(folder)
