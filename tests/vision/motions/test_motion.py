"""The kind of motion of tracked objects, against paths made by equations of motion."""

import numpy as np
import pytest

from vision.motions.motion import interpret_tracks
from vision.tracks import Face, MotionKind, PendulumTrack, Track

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


def _pendulum(track: Track) -> PendulumTrack:
    """A mass on an arc about a pivot 150 px above the lowest place of its track."""
    lowest = track.centre_px[np.argmax(track.centre_px[:, 1])]
    pivot, count = lowest - [0.0, 150.0], len(track)
    angle = np.arctan2(*(track.centre_px - pivot).T)
    face = Face(int(track.frame[0]), lowest, 0.3)
    return PendulumTrack(track, angle, np.full(count, 1e-3), pivot, np.eye(2), 150.0, face)


def _kind(
    centre: np.ndarray, pendulum: PendulumTrack | None = None, striker: Track | None = None
) -> tuple[MotionKind, float]:
    motion = interpret_tracks(_track(centre), pendulum, striker)
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
    assert _kind(_after_rest(0.0 * TIME, 0.06 * TIME**2))[0] is MotionKind.DROP


def _mass(seed: int = 1) -> PendulumTrack:
    """A mass on an arc that reaches the ball at frame 19 and goes on slower."""
    time = np.arange(60.0) - 19.0
    angle = np.where(time < 0.0, 0.03, 0.022) * time
    lowest = np.array([50.0 - 2.0 * RADIUS, 50.0])
    arc = 150.0 * np.column_stack([np.sin(angle), np.cos(angle) - 1.0])
    return _pendulum(_track(lowest + arc, seed))


def test_what_a_pendulum_meets_at_rest_is_struck() -> None:
    path = _after_rest(4.0 * TIME, -1.0 * TIME + 0.03 * TIME**2)
    motion = interpret_tracks(_track(path), _mass())
    assert motion.kind is MotionKind.STRIKE
    assert motion.probability > 0.9
    assert motion.frames is not None
    assert motion.frames[0] == pytest.approx(20, abs=2)
    assert motion.frames[1] == 79


def test_a_ball_whose_outline_drifts_at_rest_is_struck_all_the_same() -> None:
    path = _after_rest(4.0 * TIME, -1.0 * TIME + 0.03 * TIME**2)
    # the shadow of the mass draws the outline along as it comes
    path[:20, 0] += 0.04 * np.arange(20.0)
    motion = interpret_tracks(_track(path), _mass())
    assert motion.kind is MotionKind.STRIKE


def test_a_ball_pushed_for_some_frames_by_what_is_not_seen_is_struck() -> None:
    time = np.concatenate([2.0 * (np.arange(4.0) / 4.0) ** 2, 2.0 + np.arange(60.0)])
    path = np.column_stack([4.0 * time, -1.0 * time + 0.03 * time**2]) + 50.0
    still = np.full((20, 2), 50.0)
    motion = interpret_tracks(_track(np.concatenate([still, path])))
    share = {motion.kind: motion.probability} | dict(motion.alternatives)
    assert share[MotionKind.STRIKE] > 0.3
    assert share[MotionKind.COLLISION] == 0.0


def test_a_mass_that_hangs_is_no_second_ball() -> None:
    path = _after_rest(4.0 * TIME, -1.0 * TIME + 0.03 * TIME**2)
    hanging = interpret_tracks(_track(path), _mass())
    assert dict(hanging.alternatives)[MotionKind.COLLISION] == 0.0


def test_what_is_carried_off_before_it_flies_was_not_struck() -> None:
    carried = np.random.default_rng(3).normal(0.0, 9.0, (40, 2)).cumsum(axis=0)
    flight = np.column_stack([4.0 * TIME, -1.0 * TIME + 0.03 * TIME**2]) + carried[-1]
    path = np.concatenate([np.zeros((20, 2)), carried, flight]) + 150.0
    kind, _ = _kind(path)
    assert kind is MotionKind.FLIGHT


def _other(before: float, after: float) -> Track:
    """What comes from the left at one speed until frame 19 and goes on at another, px per frame."""
    time = np.arange(80.0) - 19.0
    x = np.where(time < 0.0, before * time, after * time) - 2.0 * RADIUS
    return _track(np.column_stack([x, 0.0 * x]) + 50.0, 1)


@pytest.mark.parametrize(("after", "gained"), [(0.0, 3.0), (0.5, 2.2), (-1.0, 4.5), (2.0, 1.5)])
def test_what_another_ball_meets_at_rest_collided(after: float, gained: float) -> None:
    path = _after_rest(gained * TIME, 0.0 * TIME)
    kind, probability = _kind(path, striker=_other(3.0, after))
    assert kind is MotionKind.COLLISION
    assert probability > 0.8


def test_a_bob_swings() -> None:
    angle = 0.5 * np.cos(2 * np.pi * np.arange(150.0) / 60.0) * np.exp(-np.arange(150.0) / 400.0)
    kind, _ = _kind(np.column_stack([150.0 * np.sin(angle), 150.0 * np.cos(angle)]) + 200.0)
    assert kind is MotionKind.SWING


def test_a_turn_that_friction_stops_is_a_circle() -> None:
    time = np.arange(400.0)
    angle = 45.0 * (1.0 - np.exp(-time / 110.0))
    centre = 80.0 * np.column_stack([np.cos(angle), 0.9 * np.sin(angle)]) + 150.0
    seen = np.concatenate([np.arange(60), np.arange(95, 400)])
    track = _track(centre)
    kept = {name: getattr(track, name)[seen] for name in Track.__dataclass_fields__}
    motion = interpret_tracks(Track(**kept), None)
    assert motion.kind is MotionKind.CIRCLE
    assert motion.probability > 0.8


def test_what_follows_no_law_is_no_motion() -> None:
    steps = np.random.default_rng(5).normal(0.0, 9.0, (60, 2))
    assert _kind(np.cumsum(steps, axis=0))[0] in (MotionKind.NONE, MotionKind.CARRIED)


def _seen(centre: np.ndarray, radius: float, noise: float, rng: np.random.Generator) -> Track:
    """Through a lens that bends by up to a hundredth, with errors of which half change slowly."""
    count, middle = len(centre), np.array([320.0, 240.0])
    away = (centre - centre.mean(axis=0)) / 400.0
    bent = middle + 400.0 * away * (1.0 + rng.uniform(-0.05, 0.05) * (away**2).sum(axis=1))[:, None]
    walk = rng.normal(0.0, 1.0, (count, 2)).cumsum(axis=0)
    walk -= np.linspace(0.0, 1.0, count)[:, None] * walk[-1]
    place = bent + rng.normal(0.0, noise, bent.shape) + 0.5 * noise * walk / walk.std()
    variance = np.tile(noise**2 * np.eye(2), (count, 1, 1))
    frame, one = np.arange(count), np.ones(count)
    return Track(frame, frame / 100.0, place, variance, variance, radius * one, 0.1 * one, one)


def _rolls(time: np.ndarray, length: float, rng: np.random.Generator) -> np.ndarray:
    """Evenly, braked or sped up along a line in any direction."""
    gain = rng.choice([0.0, 0.0, rng.uniform(-0.9, -0.1), rng.uniform(0.2, 1.0)])
    way, turn = time + 0.5 * gain * time**2, rng.uniform(-0.5, 0.5)
    return length * way[:, None] * np.array([np.cos(turn), np.sin(turn)])


def _flies(time: np.ndarray, length: float, rng: np.random.Generator) -> np.ndarray:
    """Thrown, seen about its highest point or on one side of it."""
    rise = rng.uniform(0.3, 1.0) * length
    return np.column_stack([length * time, 4.0 * rise * (time - rng.uniform(0.0, 0.7)) ** 2])


def _bounces(time: np.ndarray, length: float, rng: np.random.Generator) -> np.ndarray:
    """On a floor, and on along it."""
    fall, height, speed, places = rng.uniform(10.0, 40.0) * length, 0.0, 0.0, []
    for _ in time:
        for _ in range(20):
            speed += fall / (20 * len(time))
            height += speed / (20 * len(time))
            if height > 0.6 * length:
                height, speed = 1.2 * length - height, -0.8 * speed
        places.append(height)
    return np.column_stack([0.5 * length * time, places])


FALLS = (MotionKind.FLIGHT, MotionKind.DROP, MotionKind.BOUNCE)


@pytest.mark.parametrize(
    ("moves", "falls"),
    [(_rolls, False), (_flies, True), (_bounces, True)],
    ids=["rolls", "flies", "bounces"],
)
def test_what_falls_is_told_from_what_rolls_and_seldom_surely_wrong(moves, falls) -> None:
    shares = []
    for seed in range(40):
        rng = np.random.default_rng([seed, 11])
        count, radius = int(rng.integers(15, 120)), rng.uniform(4.0, 40.0)
        time, length = np.linspace(0.0, 1.0, count), rng.uniform(150.0, 500.0)
        noise = rng.uniform(0.05, 0.3) + 0.01 * radius
        seen = _seen(moves(time, length, rng), radius, noise, rng)
        motion = interpret_tracks(seen)
        share = {motion.kind: motion.probability} | dict(motion.alternatives)
        kinds = FALLS if falls else (MotionKind.ROLL, MotionKind.SLIDE)
        shares.append(sum(share[kind] for kind in kinds))
    assert np.mean(np.array(shares) > 0.5) >= 0.8
    assert np.mean(np.array(shares) < 0.05) <= 0.1


def test_a_straight_path_at_constant_speed_rolls() -> None:
    rolling = np.column_stack([6.0 * TIME, 100.0 + 0.2 * TIME])
    kind, probability = _kind(rolling)
    assert kind in (MotionKind.ROLL, MotionKind.SLIDE)
    assert probability > 0.6


def test_bends_in_all_directions_are_no_gravity() -> None:
    centre = [np.zeros(2)]
    for turn in (0.3, 2.0, 4.1, 5.5, 1.2):
        pull = 0.25 * np.array([np.cos(turn), np.sin(turn)])
        speed = np.array([np.sin(turn), -np.cos(turn)]) * 3.0
        time = np.arange(1.0, 25.0)[:, None]
        centre += list(centre[-1] + speed * time + 0.5 * pull * time**2)
    kind, probability = _kind(np.array(centre) + 300.0)
    assert kind not in (*FALLS, MotionKind.STRIKE) or probability < 0.6


def test_a_ball_that_bounces_falls_though_no_arc_is_most_of_its_path() -> None:
    path = _bounces(np.linspace(0.0, 1.0, 120), 300.0, np.random.default_rng(1))
    motion = interpret_tracks(_track(path + 50.0))
    assert motion.kind in FALLS
    assert motion.measured_as in (MotionKind.FLIGHT, MotionKind.DROP)
    assert motion.probability + sum(p for k, p in motion.alternatives if k in FALLS) > 0.9


@pytest.mark.parametrize("quarter", [0, 1, 3])
def test_which_way_it_falls_is_told(quarter: int) -> None:
    turn = np.linalg.matrix_power(np.array([[0, 1], [-1, 0]]), quarter)
    centre = np.column_stack([4.0 * TIME, -5.0 * TIME + 0.08 * TIME**2]) @ turn + 200.0
    motion = interpret_tracks(_track(centre))
    assert motion.fall_px == pytest.approx(tuple(np.array([0.0, 0.16]) @ turn), abs=0.005)


def test_what_rolls_falls_nowhere() -> None:
    centre = np.column_stack([6.0 * TIME, 100.0 + 0.2 * TIME])
    assert interpret_tracks(_track(centre)).fall_px is None


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_bob_that_passes_once_is_no_flight_under_a_camera_upside_down(way: float) -> None:
    angle = way * np.linspace(-0.3, 0.25, 100)
    centre = 90.0 * np.column_stack([np.sin(angle), np.cos(angle)]) + 200.0
    motion = interpret_tracks(_track(centre))
    share = {motion.kind: motion.probability} | dict(motion.alternatives)
    assert share[MotionKind.STRIKE] == 0.0
    assert sum(share[kind] for kind in FALLS) < 0.9
    assert motion.fall_px is None


def _bob(start: float, speed: float, frames: int = 60, frequency: float = 0.024) -> np.ndarray:
    """Angles of a pendulum of so small a frequency (rad per frame), stepped a tenth of a frame."""
    angle, rate, found = start, speed, []
    for step in range(10 * frames):
        if step % 10 == 0:
            found.append(angle)
        rate -= 0.1 * frequency**2 * np.sin(angle)
        angle += 0.1 * rate
    return np.array(found)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(("start", "speed"), [(-0.17, 0.0165), (-0.12, 0.02), (0.05, 0.016)])
def test_a_bob_that_climbs_past_its_lowest_point_is_no_sure_fall_and_shows_no_direction(
    way: float, start: float, speed: float
) -> None:
    # Gravity brakes it while its pivot pulls it up: what is left points sideways, as a fall does
    # in the picture of a camera that lay on its side.
    angle = way * _bob(start, speed)
    centre = 70.0 * np.column_stack([np.sin(angle), np.cos(angle)]) + 100.0
    for seed in range(6):
        motion = interpret_tracks(_track(centre, seed))
        assert motion.fall_px is None
        falls = [motion.probability] if motion.kind in FALLS else []
        assert sum(falls) < 0.9


def test_what_drives_itself_along_an_arc_and_off_a_wall_does_not_swing() -> None:
    turned = np.linspace(0.0, 0.7, 45)
    bent = 8.0 * np.column_stack([np.cos(turned), -np.sin(turned)])
    back = 8.0 * np.column_stack([-np.cos(turned), np.full(45, -0.3)])
    straight = np.tile([-8.0, 0.4], (40, 1))
    centre = np.array([50.0, 400.0]) + np.cumsum(np.vstack([bent, back, straight]), axis=0)
    kind, probability = _kind(centre)
    assert kind is not MotionKind.SWING or probability < 0.5


def test_what_lies_still_and_is_put_elsewhere_is_no_free_motion() -> None:
    place = np.repeat([[60.0, 60.0], [66.0, 75.0], [60.0, 60.0]], [90, 20, 20], axis=0)
    kind, _ = _kind(place)
    assert kind in (MotionKind.NONE, MotionKind.CARRIED)
