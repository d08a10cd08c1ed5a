"""Restitution of a bounce against flights that an ODE solver made, with drag, drift and noise."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.stats import binom

from measuring.bounce import bounce_restitution
from measuring.chain import with_bounce
from measuring.checks import Check, CheckKind, CheckOutcome
from measuring.motions import MotionResults, MotionScene
from metrology import Quantity
from vision.tracks import Motion, MotionKind, Track, Tracks

FloatArray = NDArray[np.float64]
FPS, PX_PER_M, G = 120.0, 250.0, 9.81
COR = 0.72


def flown(start: list[float], drag: float, duration: float) -> FloatArray:
    """States (x, y, vx, vy; m, y up) at 20,000 times a second, until the floor at y = 0."""

    def rates(_: float, s: FloatArray) -> list[float]:
        resist = drag * math.hypot(s[2], s[3])
        return [s[2], s[3], -resist * s[2], -resist * s[3] - G]

    def floor(_: float, s: FloatArray) -> float:
        return float(s[1])

    floor.terminal, floor.direction = True, -1.0  # type: ignore[attr-defined]
    time = np.arange(0.0, duration, 5e-5)
    solved = solve_ivp(rates, (0.0, duration), start, t_eval=time, events=floor, rtol=1e-10)
    return np.asarray(solved.y.T)


def dropped(
    *,
    across: float = 0.0,
    drag: float = 0.02,
    contact_s: float = 0.0,
    noise: float = 0.2,
    seed: int = 0,
    known_down: bool = True,
    rises_s: float = 0.4,
) -> Tracks:
    down = flown([0.0, 0.9, across, -0.3], drag, 2.0)
    x, _, vx, vy = down[-1]
    stays = np.tile([x, 0.0, vx, 0.0], (round(contact_s / 5e-5), 1))
    up = flown([x, 1e-9, 0.8 * vx, -COR * vy], drag, rises_s)
    states = np.vstack([down, stays, up])[:: round(1.0 / (FPS * 5e-5))]
    count, rng = len(states), np.random.default_rng(seed)
    px = [200.0, 400.0] + states[:, :2] * [PX_PER_M, -PX_PER_M]
    square = np.tile(noise**2 * np.eye(2), (count, 1, 1))
    frame, one = np.arange(count), np.ones(count)
    noisy = px + rng.normal(0.0, noise, px.shape)
    ball = Track(frame, frame / FPS, noisy, square, square, 15.0 * one, one, one)
    at = round((len(down) + 0.5 * len(stays)) * 5e-5 * FPS)
    fall = (0.0, G * PX_PER_M / FPS**2) if known_down else None
    motion = Motion(MotionKind.DROP, 0.95, fall_px=fall, events=(("bounce", at),))
    return Tracks(ball, None, np.zeros((9, 9), np.float32), None, motion=motion)


def bounced(**how: Any) -> Quantity | None:
    return bounce_restitution(dropped(**how), np.arange(999.0), FPS)


def off(found: Quantity | None) -> float:
    assert found is not None
    assert found.value is not None
    assert found.std is not None
    return abs(found.value - COR) / found.std


@pytest.mark.parametrize("drag", [0.0, 0.02, 0.15])
@pytest.mark.parametrize("across", [0.0, 1.5])
@pytest.mark.parametrize("known_down", [True, False])
def test_a_bounce_gives_its_restitution(across: float, drag: float, known_down: bool) -> None:
    found = bounced(across=across, drag=drag, known_down=known_down)
    assert off(found) < 3.0
    assert found is not None
    assert found.std < 0.05


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    held = sum(off(bounced(seed=seed)) < 2.0 for seed in range(60))
    assert held >= binom.ppf(1e-3, 60, 0.95)


@pytest.mark.parametrize("contact_s", [0.005, 0.01])
def test_a_contact_that_lasts_is_within_the_interval(contact_s: float) -> None:
    assert off(bounced(contact_s=contact_s, noise=0.05)) < 3.0


def test_a_bounce_at_the_end_of_the_clip_is_too_short() -> None:
    found = bounced(rises_s=0.03)
    assert found is not None
    assert found.value is None
    assert "after the bounce" in str(found.reason)


def test_without_a_bounce_there_is_none() -> None:
    one = np.ones(9)
    square = np.tile(np.eye(2), (9, 1, 1))
    ball = Track(np.arange(9), np.arange(9.0), np.zeros((9, 2)), square, square, one, one, one)
    tracks = Tracks(ball, None, np.zeros((9, 9), np.float32), None)
    assert bounce_restitution(tracks, np.arange(9.0), FPS) is None


def test_what_does_not_fall_freely_has_no_restitution() -> None:
    statement = "the tracked object is not in free fall"
    check = Check(CheckKind.STEADY_FALL, CheckOutcome.FAILED, statement)
    scene = MotionScene(np.arange(999.0), FPS, 0.1, None, None, (), (0.0, 0.01), G, 640.0)
    tracks = dropped()
    found = with_bounce(MotionResults(checks=(check,)), tracks, scene).quantities["cor_bounce"]
    assert (found.value, found.reason) == (None, statement)
    assert with_bounce(MotionResults(), tracks, scene).quantities["cor_bounce"].known
