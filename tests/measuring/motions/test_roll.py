"""Rolls down a slope against places made by its own law, with scatter, friction and slant."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from measuring.motions import MotionScene, PlaneScale, motion_quantities
from metrology import Quantity, UncertaintySource
from vision.tracks import Motion, MotionKind, Track, Tracks

FloatArray = NDArray[np.float64]
FPS, PER_PX, RADIUS_PX = 120.0, 0.002, 15.0
ACCELERATION, SPEED = 0.9, 0.25


def steadily(time: FloatArray) -> FloatArray:
    return SPEED * time + 0.5 * ACCELERATION * time**2


def rolled(
    along: Callable[[FloatArray], FloatArray],
    *,
    slope_deg: float = 8.0,
    slant: float = 0.0,
    noise: float = 0.2,
    seed: int = 0,
    kind: MotionKind = MotionKind.ROLL,
    metric: bool = True,
) -> dict[str, Quantity]:
    """Quantities of a roll to the right and down, whose scale grows by `slant` along a metre."""
    time = np.arange(0.0, 1.2, 1.0 / FPS)
    rng, turn = np.random.default_rng(seed), math.radians(slope_deg)
    place = along(time)[:, None] * [math.cos(turn), math.sin(turn)] / PER_PX
    centred = place - place.mean(axis=0)
    grown = 1.0 + slant * PER_PX * centred[:, :1]
    count = len(time)
    px = centred * grown + 300.0 + rng.normal(0.0, noise, place.shape)
    square = np.tile(noise**2 * np.eye(2), (count, 1, 1))
    radius = RADIUS_PX * grown[:, 0] ** 2 + rng.normal(0.0, 0.1, count)
    frame = np.arange(count)
    ball = Track(frame, time, px, square, 0.0 * square, radius, np.full(count, 0.1), np.ones(count))
    scale = PlaneScale(PER_PX, 0.002, UncertaintySource.SCALE) if metric else None
    scene = MotionScene(frame.astype(float), FPS, 0.05, scale, None, (), (0.02, 0.01), 9.81, 1280.0)
    tracks = Tracks(ball, None, np.zeros((9, 9), np.float32), None, motion=Motion(kind, 0.95))
    return motion_quantities(tracks, scene).quantities


def off(one: Quantity, true: float) -> float:
    assert one.value is not None
    assert one.std is not None
    return abs(one.value - true) / one.std


@pytest.mark.parametrize("kind", [MotionKind.ROLL, MotionKind.SLIDE])
@pytest.mark.parametrize("slope_deg", [0.0, 8.0, 35.0, 172.0])
def test_a_roll_gives_its_acceleration_and_speed(slope_deg: float, kind: MotionKind) -> None:
    found = rolled(steadily, slope_deg=slope_deg, kind=kind)
    acceleration, speed = found["roll_acceleration"], found["roll_speed"]
    assert off(acceleration, ACCELERATION) < 3.0
    assert off(speed, SPEED) < 3.0
    assert acceleration.std < 0.08 * ACCELERATION


def test_intervals_of_the_acceleration_hold_the_truth_at_least_as_often_as_they_say() -> None:
    slants = np.random.default_rng(5).normal(0.0, 0.03, 60)
    held = sum(
        off(rolled(steadily, slant=slant, seed=seed)["roll_acceleration"], ACCELERATION) < 2.0
        for seed, slant in enumerate(slants.tolist())
    )
    assert held >= binom.ppf(1e-3, len(slants), 0.95)


def test_what_slows_down_has_a_negative_acceleration() -> None:
    found = rolled(lambda time: 0.8 * time - 0.5 * 0.4 * time**2, slope_deg=0.0)
    assert off(found["roll_acceleration"], -0.4) < 3.0


def test_an_acceleration_that_changes_is_given_as_its_mean_with_that_change() -> None:
    found = rolled(lambda time: steadily(time) - 0.05 * time**3, noise=0.1)["roll_acceleration"]
    lines = {line.source: line.std for line in found.budget}
    # from 0.90 to 0.54 m/s² in 1.2 s: its halves differ by 0.18
    assert lines[UncertaintySource.ROLL_CHANGE] == pytest.approx(0.09, rel=0.3)
    assert off(found, 0.72) < 1.5


def test_without_a_scale_it_is_given_in_pixels() -> None:
    found = rolled(steadily, metric=False)
    assert found["roll_acceleration"].value is None
    assert found["roll_acceleration"].reason is not None
    assert off(found["roll_acceleration_px"], ACCELERATION / PER_PX) < 3.0


def test_what_stops_and_goes_is_no_roll() -> None:
    found = rolled(lambda time: 0.3 * time + 0.1 * np.sin(9.0 * time))
    assert found["roll_acceleration"].value is None
    assert "one line at one acceleration" in str(found["roll_acceleration"].reason)
