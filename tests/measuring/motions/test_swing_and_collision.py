"""Swings from a solved pendulum equation, collisions from the laws of momentum and restitution."""

import math
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.special import ellipk
from scipy.stats import binom

from measuring.motions import fit_collision, fit_free_swing
from metrology import NotFoundError, TooLittleDataError
from vision.tracks import Track

FloatArray = NDArray[np.float64]
LENGTH_PX, PERIOD = 300.0, 1.27


def swung(
    start_rad: float, damping: float, count: int, fps: float, noise: float, seed: int = 0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A bob on its arc, px."""
    time, place = without_noise(start_rad, damping, count, fps)
    scatter = np.random.default_rng(seed).normal(0.0, noise, place.shape)
    return time, place + scatter, np.full(count, noise)


@cache
def without_noise(
    start_rad: float, damping: float, count: int, fps: float
) -> tuple[FloatArray, FloatArray]:
    time = np.arange(count) / fps
    stiffness = (2 * math.pi / PERIOD) ** 2
    solved = solve_ivp(
        lambda _, s: [s[1], -2 * damping * s[1] - stiffness * math.sin(s[0])],
        (0.0, time[-1]),
        [start_rad, 0.0],
        t_eval=time,
        rtol=1e-10,
        atol=1e-12,
    )
    angle = solved.y[0]
    return time, LENGTH_PX * np.stack([np.sin(angle), np.cos(angle)], axis=1)


def test_period_and_damping_of_a_small_swing() -> None:
    found = fit_free_swing(*swung(0.08, 0.05, 200, 60.0, 0.05))
    assert found.period == pytest.approx(PERIOD, rel=2e-3)
    assert found.damping == pytest.approx(0.05, abs=0.005)
    assert found.periods == pytest.approx(199 / 60.0 / PERIOD, rel=0.01)


def test_a_wide_swing_takes_as_long_as_the_elliptic_integral_says() -> None:
    found = fit_free_swing(*swung(0.9, 0.0, 300, 60.0, 0.2))
    true = PERIOD * 2.0 / math.pi * float(ellipk(math.sin(0.45) ** 2))
    assert found.period == pytest.approx(true, rel=3e-3)


def test_intervals_of_the_period_hold_the_truth_as_often_as_they_say() -> None:
    inside = [0, 0]
    for seed in range(200):
        found = fit_free_swing(*swung(0.06, 0.1, 80, 40.0, 0.5, seed))
        damped = 2 * math.pi / math.sqrt((2 * math.pi / PERIOD) ** 2 - 0.1**2)
        inside[0] += abs(found.period - damped) < 1.96 * found.period_std
        inside[1] += abs(found.damping - 0.1) < 1.96 * found.damping_std
    low, high = binom.ppf([0.0005, 0.9995], 200, 0.95)
    assert low <= inside[0] <= high
    assert low <= inside[1] <= high


def test_half_a_swing_or_no_swing_is_refused() -> None:
    with pytest.raises((TooLittleDataError, NotFoundError)):
        fit_free_swing(*swung(0.3, 0.0, 26, 60.0, 0.1))
    rng = np.random.default_rng(0)
    walk = np.cumsum(rng.normal(0, 3, (80, 2)), axis=0)
    with pytest.raises((TooLittleDataError, NotFoundError)):
        fit_free_swing(np.arange(80.0), walk, np.full(80, 0.1))


COR, MEETS = 0.82, 40.3


def met(noise: float, seed: int, friction: float = 0.0) -> tuple[Track, Track]:
    """A puck that lies still and one that strikes it off the line of centres, px and frames."""
    radius = 9.0
    normal = np.array([math.cos(0.3), math.sin(0.3)])
    incoming = np.array([3.2, 0.0])
    along = float(incoming @ normal)
    struck_v = 0.5 * (1 + COR) * along * normal
    striker_v = incoming - struck_v
    frame = np.arange(80)
    since = (frame - MEETS)[:, None]
    after = np.clip(since, 0.0, None)
    slowed = after - 0.5 * friction * after**2
    struck = np.array([150.0, 80.0]) + struck_v * slowed
    touch = np.array([150.0, 80.0]) - 2 * radius * normal
    striker = touch + np.where(since < 0, incoming * since, striker_v * slowed)
    rng = np.random.default_rng(seed)

    def track(place: FloatArray) -> Track:
        count = len(place)
        return Track(
            frame,
            frame.astype(float),
            place + rng.normal(0.0, noise, place.shape),
            np.tile(noise**2 * np.eye(2), (count, 1, 1)),
            np.zeros((count, 2, 2)),
            np.full(count, radius),
            np.full(count, 0.1),
            np.ones(count),
        )

    return track(struck), track(striker)


def test_speeds_and_restitution_of_two_pucks() -> None:
    found = fit_collision(*met(0.05, 0), MEETS, np.arange(80.0))
    along = 3.2 * math.cos(0.3)
    assert found.before.speed[0] < 3 * found.before.speed[1]
    assert found.other_before.speed[0] == pytest.approx(3.2, abs=0.02)
    assert found.after.speed[0] == pytest.approx(0.5 * (1 + COR) * along, abs=0.02)
    assert abs(found.cor - COR) < 2.5 * found.cor_std
    assert found.momentum_change < 3.0


def test_intervals_of_the_restitution_hold_the_truth_as_often_as_they_say() -> None:
    inside = sum(
        abs((one := fit_collision(*met(0.3, seed), MEETS, np.arange(80.0))).cor - COR)
        < 1.96 * one.cor_std
        for seed in range(200)
    )
    assert inside >= binom.ppf(0.001, 200, 0.95)


def test_pucks_that_slow_down_are_taken_at_the_meeting() -> None:
    found = fit_collision(*met(0.05, 0, friction=0.01), MEETS, np.arange(80.0))
    true = 0.5 * (1 + COR) * 3.2 * math.cos(0.3)
    assert abs(found.after.speed[0] - true) < 3 * found.after.speed[1]


def test_a_puck_that_is_pushed_does_not_keep_momentum() -> None:
    struck, striker = met(0.05, 0)
    pushed = struck.centre_px.copy()
    pushed[41:] += 1.5 * np.clip(np.arange(41, 80) - MEETS, 0, None)[:, None] * [1.0, 0.0]
    moved = Track(
        struck.frame, struck.time_s, pushed, struck.covariance_px2, struck.bound_px2,
        struck.radius_px, struck.radius_std_px, struck.quality,
    )  # fmt: skip
    assert fit_collision(moved, striker, MEETS, np.arange(80.0)).momentum_change > 4.0


def test_a_puck_seen_on_one_side_only_is_refused() -> None:
    struck, striker = met(0.05, 0)
    with pytest.raises(TooLittleDataError, match="after the collision"):
        fit_collision(struck, striker.where(striker.frame < 41), MEETS, np.arange(80.0))
