import numpy as np
import pytest

from vision.motion import lawful_stretch, motion_of
from vision.tracks import MotionKind, Track

RADIUS = 12.0


def _track(centre: np.ndarray, seed: int = 0) -> Track:
    count = len(centre)
    noisy = centre + np.random.default_rng(seed).normal(0.0, 0.1, centre.shape)
    variance = np.tile(0.01 * np.eye(2), (count, 1, 1))
    frame = np.arange(count)
    return Track(
        frame=frame,
        time_s=frame / 100.0,
        centre_px=noisy,
        covariance_px2=variance,
        bound_px2=variance,
        radius_px=np.full(count, RADIUS),
        radius_std_px=np.full(count, 0.1),
        quality=np.ones(count),
    )


def _kind(centre: np.ndarray, rest: int | None = None, **seen: bool) -> tuple[MotionKind, float]:
    facts = {"pendulum": False, "struck_by_another": False} | seen
    motion = motion_of(_track(centre), None if rest is None else (0, rest), **facts)
    total = motion.probability + sum(part for _, part in motion.alternatives)
    assert total == pytest.approx(1.0)
    return motion.kind, motion.probability


TIME = np.arange(60.0)
STILL = np.zeros(20)


def _after_rest(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.column_stack([np.concatenate([STILL, x]), np.concatenate([STILL, y])]) + 50.0


def test_a_thrown_ball_flies() -> None:
    centre = np.column_stack([4.0 * TIME, 200.0 - 5.0 * TIME + 0.08 * TIME**2])
    kind, probability = _kind(centre)
    assert kind is MotionKind.FLIGHT
    assert probability > 0.8


def test_what_falls_straight_from_rest_drops() -> None:
    assert _kind(_after_rest(0.0 * TIME, 0.06 * TIME**2), 19)[0] is MotionKind.DROP


def test_what_a_pendulum_meets_at_rest_is_struck() -> None:
    path = _after_rest(4.0 * TIME, -1.0 * TIME + 0.03 * TIME**2)
    kind, sure = _kind(path, 19, pendulum=True)
    assert kind is MotionKind.STRIKE
    unseen, less_sure = _kind(path, 19)
    assert unseen is MotionKind.STRIKE
    assert less_sure < sure


def test_what_is_carried_off_before_it_flies_was_not_struck() -> None:
    carried = np.random.default_rng(3).normal(0.0, 9.0, (40, 2)).cumsum(axis=0)
    flight = np.column_stack([4.0 * TIME, -1.0 * TIME + 0.03 * TIME**2]) + carried[-1]
    path = np.concatenate([np.zeros((20, 2)), carried, flight]) + 150.0
    kind, _ = _kind(path, 19, pendulum=True)
    assert kind is MotionKind.FLIGHT


def test_what_another_ball_meets_at_rest_collided() -> None:
    path = _after_rest(3.0 * TIME, 0.0 * TIME)
    assert _kind(path, 19, struck_by_another=True)[0] is MotionKind.COLLISION


def test_a_bob_swings() -> None:
    angle = 0.5 * np.cos(2 * np.pi * np.arange(150.0) / 60.0) * np.exp(-np.arange(150.0) / 400.0)
    kind, _ = _kind(np.column_stack([150.0 * np.sin(angle), 150.0 * np.cos(angle)]) + 200.0)
    assert kind is MotionKind.SWING


def test_what_follows_no_law_is_no_motion() -> None:
    steps = np.random.default_rng(5).normal(0.0, 9.0, (60, 2))
    assert _kind(np.cumsum(steps, axis=0))[0] is MotionKind.NONE


def test_the_lawful_stretch_ends_at_the_bounce() -> None:
    fall = np.column_stack([2.0 * TIME[:30], 0.1 * TIME[:30] ** 2])
    after = TIME[1:25]
    rise = fall[-1] + np.column_stack([2.0 * after, -5.0 * after + 0.1 * after**2])
    stretch = lawful_stretch(np.arange(54), np.concatenate([fall, rise]), 6.0)
    assert (stretch.first, stretch.last) in {(0, 29), (0, 30), (0, 31)}
    assert stretch.evidence > 50.0


def test_what_bounces_often_is_lawful_in_between() -> None:
    rng, time = np.random.default_rng(14), np.arange(400.0)
    across = np.cumsum(np.repeat(rng.normal(0.0, 3.0, 29), 14)[:400])
    path = np.column_stack([across, 200.0 + 0.3 * (time % 14.0 - 7.0) ** 2])
    path += rng.normal(0.0, 0.3, path.shape)
    stretch = lawful_stretch(np.arange(400), path, 6.0)
    assert 12 <= stretch.looks <= 16
    assert stretch.evidence > 20.0
