"""Numbers of a folder's images are its clock."""

import cv2
import numpy as np
import pytest

from tests.vision.clip.written_clips import scene
from vision.clip.clip import ClipReader
from vision.following import follow


def folder_of(path, numbers, name="p{:04d}.png"):
    rng = np.random.default_rng(5)
    for number in numbers:
        picture = scene(150.0, 25.0 + 0.11 * (number - 100) ** 2, size=(320, 240))
        noisy = np.clip(picture + rng.normal(0.0, 1.5, picture.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(path / name.format(number)), noisy)
    return ClipReader.open(path)


@pytest.mark.parametrize("step", [1, 2])
def test_holes_and_steps_are_time(tmp_path, step):
    numbers = [number for number in range(100, 140, step) if not 114 <= number < 120]
    clip = folder_of(tmp_path, numbers)
    times = np.array(numbers, dtype=float) - 100.0
    assert clip.capture_times(1.0) == pytest.approx(times)
    assert [frame.time_s for frame in clip.frames()] == pytest.approx(times)
    assert clip.info.duration_s == times[-1]
    said = " ".join(clip.warnings)
    assert f"{6 // step} images are missing" in said
    assert ("steps of 2" in said) == (step == 2)


def test_a_fall_with_a_hole_is_one_parabola(tmp_path):
    clip = folder_of(tmp_path, [n for n in range(100, 142) if not 118 <= n < 123])
    tracks = follow(clip, 1.0)
    ball = tracks.ball
    times = tracks.on_clock(clip.capture_times(1.0))[ball.frame]
    assert len(ball) >= 30
    assert np.abs(ball.centre_px[:, 1] - 25.0 - 0.11 * times**2).max() < 1.5


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        # one number counts; others are the same in all names
        ("cam2_{:04d}_v1.png", range(100, 120)),
        # steps of 40 are times, not pictures
        ("t{}.png", range(100, 900, 40)),
    ],
)
def test_plain_numbering_gives_the_order(tmp_path, name, numbers):
    clip = folder_of(tmp_path, numbers, name)
    assert clip.capture_times(1.0) == pytest.approx(np.arange(20))
    assert clip.warnings == ()


def test_names_without_numbers_give_the_order(tmp_path):
    for letter in "abcdef":
        cv2.imwrite(str(tmp_path / f"{letter}.png"), scene(60.0 + ord(letter), 60.0))
    assert ClipReader.open(tmp_path).capture_times(1.0) == pytest.approx(np.arange(6))
