"""Whether what was followed can have struck the ball."""

from dataclasses import replace

import numpy as np
import pytest

from vision.ball.ball import BallFits
from vision.ball.outline import nothing_found
from vision.pendulum.arc import Arc, Patch, Pose
from vision.pendulum.face import MassPoses, Striking, restitution_px, striking
from vision.tracks import Rest

REST = Rest(0, 30, np.array([100.0, 200.0]), np.array([1.0, 0.0]), 1.5)
PIVOT, ARM = np.array([90.0, 100.0]), 100.0


def swung(before: float, after: float, *, until: int = 60) -> MassPoses:
    """A mass that comes with one speed and goes on with another, px per frame at the ball."""
    frame = np.arange(until)
    rate = np.where(frame < 33, before, after) / np.hypot(*(REST.centre_px - PIVOT))
    angle = np.pi / 2 + 0.2 - np.cumsum(rate)
    anchor = PIVOT + ARM * np.column_stack([np.cos(angle), np.sin(angle)])
    poses = tuple(Pose(at, 0.0, np.eye(3), 1.0, 1.0) for at in anchor)
    patch = Patch(np.zeros(1), np.zeros(1), np.zeros(1), np.ones(1))
    return MassPoses(frame, poses, patch, Arc(PIVOT, ARM, np.eye(3), 0.1, 1.0), 0)


def flown(speed: float, every: int = 1) -> BallFits:
    frame = np.arange(0, 60, every)
    fits = nothing_found(len(frame))
    fits.centre[:, 0] = REST.centre_px[0] + np.maximum(frame - 31, 0) * speed
    fits.centre[:, 1] = REST.centre_px[1]
    fits.radius[:] = 19.0
    return BallFits(np.arange(len(frame)), fits)


def test_restitution_is_the_speed_of_parting_over_that_of_approach() -> None:
    assert restitution_px(swung(1.0, 0.8), flown(1.5), REST) == pytest.approx(0.7, abs=0.03)
    assert striking(swung(1.0, 0.8), flown(1.5), REST) is Striking.AGREES


def test_a_shadow_that_comes_too_slowly_did_not_strike() -> None:
    assert striking(swung(0.6, 0.5), flown(1.5), REST) is Striking.CONTRADICTS


def test_what_is_lost_at_the_ball_is_not_judged() -> None:
    assert striking(swung(1.0, 0.8, until=33), flown(1.5), REST) is Striking.UNKNOWN


@pytest.mark.parametrize("every", [2, 3])
def test_a_slower_camera_judges_alike(every: int) -> None:
    mass = swung(1.0, 0.8, until=60)
    slow = replace(mass, frame=np.arange(len(mass.frame[::every])), poses=mass.poses[::every])
    rest = replace(REST, last=REST.last // every, speed_px=REST.speed_px * every)
    assert restitution_px(slow, flown(1.5, every), rest) == pytest.approx(0.7, abs=0.05)
