"""Frames lost without a trace: told where they are, so many as they are, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from tests.vision.ball.painted import PaintedClip, struck_ball
from vision.following import follow
from vision.lost import lost_frames
from vision.tracks import Track


def _track(frame: np.ndarray, centre: np.ndarray, seed: int, radius: float = 12.0) -> Track:
    count, std = len(frame), 0.1
    scatter = np.random.default_rng(seed).normal(0.0, std, centre.shape)
    return Track(
        frame=frame,
        time_s=frame / 600.0,
        centre_px=centre + scatter,
        covariance_px2=np.tile(std**2 * np.eye(2), (count, 1, 1)),
        bound_px2=np.zeros((count, 2, 2)),
        radius_px=np.full(count, radius),
        radius_std_px=np.full(count, 0.1),
        quality=np.ones(count),
    )


def _flight(time: np.ndarray) -> np.ndarray:
    """Lies still for 40 frames, then flies, slowed a little by the air."""
    flown = np.maximum(time - 40.0, 0.0)
    x = 60.0 + 2.1 * flown - 3e-4 * flown**2
    return np.column_stack([x, 150.0 - 0.9 * flown + 0.008 * flown**2])


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("many", [1, 3, 11, 35])
def test_lost_frames_are_counted(many: int, seed: int) -> None:
    last = int(np.random.default_rng(seed).integers(70, 110))
    true = np.concatenate([np.arange(last + 1), np.arange(last + 1 + many, 200)])
    found = lost_frames(_track(np.arange(len(true)), _flight(true.astype(float)), seed))
    assert found is not None
    assert found.after <= last < found.before
    assert found.count == many


@pytest.mark.parametrize("seed", range(6))
def test_lost_frames_are_told_between_two_things_too(seed: int) -> None:
    true = np.concatenate([np.arange(90), np.arange(121, 190)])
    frame, centre = np.arange(len(true)), _flight(true.astype(float))
    parts = [_track(frame[:88], centre[:88], seed), _track(frame[91:], centre[91:], seed + 10)]
    found = lost_frames(parts[1], parts[:1])
    assert found is not None
    assert (found.count, found.sure) == (31, True)


@pytest.mark.parametrize("seed", range(8))
def test_a_strike_a_bounce_and_a_slip_to_another_thing_are_no_lost_frames(seed: int) -> None:
    frame = np.arange(160)
    time = frame.astype(float)
    whole = _flight(time)
    bounced = whole.copy()
    bounced[110:, 1] = 2.0 * whole[110, 1] - whole[110:, 1]
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0.0, 2.0 * np.pi)
    slipped = whole.copy()
    slipped[100:] += 4.0 * np.array([np.cos(turn), np.sin(turn)])
    slipped[100:] -= 0.4 * (time[100:, None] - 100.0) * np.array([0.3, -0.2])
    for path in (whole, bounced, slipped):
        assert lost_frames(_track(frame, path, seed)) is None


def test_a_ball_set_in_motion_by_another_is_no_lost_frame() -> None:
    # as followed in a ray-traced collision, 0.01 px: it lay still up to frame 22, then rolled away
    x = (
        "128 98 118 69 132 94 120 66 134 94 123 69 128 127 133 220 275 248 330 410 389 494 "
        "537 629 623 698 668 744 822 815 914 909 955 937 1040 1036 1108 1088 1176 1179 1228 "
        "1202 1280 1312 1382 1358"
    )
    y = (
        "20 5 2 12 24 16 9 19 31 16 8 11 23 6 22 16 3 7 0 -2 5 18 2 20 17 12 29 21 7 27 4 -1 "
        "-2 15 10 13 -2 22 29 22 4 12 16 -7 8 23"
    )
    frame = np.array(
        [*range(13), 14, 16, 25, 26, 27, *range(29, 33), 34, *range(36, 40), *range(41, 60)]
    )
    place = np.array([x.split(), y.split()], dtype=float).T / 100.0
    followed = replace(
        _track(frame, place, 0, 10.8),
        centre_px=place,
        covariance_px2=0.28**2 * np.tile(np.eye(2), (len(place), 1, 1)),
    )
    assert lost_frames(followed) is None


def test_a_clip_is_followed_as_if_its_lost_frames_had_been_there_and_told() -> None:
    clip, truth, _ = struck_ball(84)
    kept = [index for index in range(84) if not 62 <= index < 68]
    tracks = follow(PaintedClip([clip.pictures[index] for index in kept]), 30.0)  # type: ignore[arg-type]
    assert tracks.lacks == ((61, 6),)
    assert tracks.on_clock(np.arange(78.0)) == pytest.approx(np.array(kept, dtype=float))
    ball = tracks.ball
    assert np.hypot(*(ball.centre_px - truth[kept][ball.frame]).T).max() < 0.4
    assert ball.time_s == pytest.approx(np.array(kept)[ball.frame] / 30.0)
    assert any("6 frames" in said for said in tracks.warnings)
