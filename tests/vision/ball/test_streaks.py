import numpy as np
import pytest

from tests.vision.ball.painted import PaintedClip, cover, exposed, wall
from vision.ball.ball import follow_ball
from vision.ball.path import BallPath
from vision.ball.streaks import Sweep, fit_sweep
from vision.clip.footage import Footage
from vision.following import follow
from vision.scene import FilmedScene


def _smeared(
    light: np.ndarray, centre: np.ndarray, motion: np.ndarray, radius: float
) -> np.ndarray:
    """A dark disc before a scene, while it goes along a line."""
    height, width = light.shape
    y, x = np.mgrid[0:height, 0:width].astype(float)
    covered = np.zeros_like(light)
    for part in np.linspace(-0.5, 0.5, 49):
        away = np.hypot(x - centre[0] - part * motion[0], y - centre[1] - part * motion[1])
        covered += np.clip(radius + 0.5 - away, 0.0, 1.0) / 49
    return light * (1.0 - covered) + 0.15 * covered


@pytest.mark.parametrize("length", [0.0, 10.0, 25.0, 50.0])
def test_a_ball_smeared_by_two_diameters_is_found_in_the_middle_of_its_way(length: float) -> None:
    scene, centre = wall(90, 100), np.array([50.3, 44.8])
    motion = length * np.array([0.8, 0.6])
    picture = exposed(_smeared(scene, centre, motion, 12.5), 1.0, 3).astype(np.float32)
    expected = exposed(scene, 0.0, 0).astype(np.float32)
    start = Sweep(centre + np.array([3.0, -4.0]), 0.7 * motion, 12.5)
    found = fit_sweep(picture, expected, 1.0, start)
    assert found is not None
    assert np.hypot(*(found.sweep.centre - centre)) < 0.6
    assert np.hypot(*found.sweep.motion) == pytest.approx(length, abs=2.5)
    assert found.explained > 0.9


def test_nothing_is_found_where_nothing_changed() -> None:
    scene = exposed(wall(60, 60), 0.0, 0).astype(np.float32)
    noisy = exposed(wall(60, 60), 1.0, 5).astype(np.float32)
    found = fit_sweep(noisy, scene, 1.0, Sweep(np.array([30.0, 30.0]), np.zeros(2), 9.0))
    assert found is None or found.explained < 0.3


def test_a_throw_at_a_few_frames_per_second_is_followed_through_its_smears() -> None:
    scene, radius = wall(150, 200), 7.0
    time = np.arange(13.0)
    places = np.column_stack([20.0 + 12.5 * time, 125.0 - 34.0 * time + 2.83 * time**2])
    speed = np.column_stack([np.full(13, 12.5), -34.0 + 5.66 * time])
    pictures = [exposed(scene, 1.5, seed) for seed in range(6)]
    for index in range(13):
        smeared = _smeared(scene, places[index], 0.6 * speed[index], radius)
        pictures.append(exposed(smeared, 1.5, 10 + index))
    pictures += [exposed(scene, 1.5, seed) for seed in range(40, 46)]
    ball = follow(PaintedClip(pictures), 30.0).ball  # type: ignore[arg-type]
    known = (ball.frame >= 6) & (ball.frame < 19)
    off = np.hypot(*(ball.centre_px[known] - places[ball.frame[known] - 6]).T)
    std = np.sqrt(0.5 * np.trace(ball.covariance_px2[known], axis1=1, axis2=2))
    assert known.sum() == len(ball) >= 12
    assert off.max() < 2.0
    assert np.mean(off < 2.5 * std) > 0.9


def test_the_size_of_a_small_ball_is_that_of_all_of_it_and_not_of_its_light_part() -> None:
    radius = 6.8
    scene, time = wall(120, 160) * 0.6, np.arange(40.0)
    y = np.mgrid[0:120, 0:160][0].astype(float)
    places = np.column_stack([25.0 + 2.6 * time, 88.0 - 3.4 * time + 0.075 * time**2])
    pictures = [exposed(scene, 1.0, seed) for seed in range(6)]
    for index, place in enumerate(places):
        part = cover(120, 160, (place[0], place[1]), radius)
        # light from above: white on top, and black in the lowest third
        shade = np.clip(0.62 - 0.09 * (y - place[1]), 0.05, 1.0)
        pictures.append(exposed(scene * (1.0 - part) + shade * part, 1.0, 20 + index))
    looks, plain = np.arange(8, 44, 3), np.ones(12)
    seen = places[looks - 6] - np.array([0.0, 0.2 * radius])
    path = BallPath(looks, seen, 5.0 * plain)
    fits = follow_ball(FilmedScene(Footage(PaintedClip(pictures))), path)  # type: ignore[arg-type]
    assert np.median(fits.radius) == pytest.approx(radius, abs=0.5)
