import numpy as np
import pytest

from vision.motion import bends_up, lawful_course, lawful_stretch, motion_of
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


def _kind(
    centre: np.ndarray,
    rest: int | None = None,
    pendulum: bool = False,
    striker: Track | None = None,
) -> tuple[MotionKind, float]:
    still = None if rest is None else (0, rest)
    motion = motion_of(_track(centre), still, pendulum=pendulum, striker=striker)
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


def _other(before: float, after: float) -> Track:
    """What comes from the left at one speed until frame 19 and goes on at another, px per frame."""
    time = np.arange(80.0) - 19.0
    x = np.where(time < 0.0, before * time, after * time) - 2.0 * RADIUS
    return _track(np.column_stack([x, 0.0 * x]) + 50.0, 1)


@pytest.mark.parametrize(("after", "gained"), [(0.0, 3.0), (0.5, 2.2), (-1.0, 4.5), (2.0, 1.5)])
def test_what_another_ball_meets_at_rest_collided(after: float, gained: float) -> None:
    path = _after_rest(gained * TIME, 0.0 * TIME)
    kind, probability = _kind(path, 19, striker=_other(3.0, after))
    assert kind is MotionKind.COLLISION
    assert probability > 0.8


def test_what_goes_on_as_fast_as_it_came_struck_nothing() -> None:
    path = _after_rest(3.0 * TIME, 0.0 * TIME)
    kind, probability = _kind(path, 19, striker=_other(3.0, 3.0))
    assert kind is MotionKind.NONE
    assert probability > 0.8


def test_of_a_striker_that_is_lost_as_it_strikes_nobody_is_sure() -> None:
    path, striker = _after_rest(3.0 * TIME, 0.0 * TIME), _other(3.0, 0.0)
    _, probability = _kind(path, 19, striker=striker.where(striker.frame < 20))
    assert probability < 0.7


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


def _struck(still: int, flown: int) -> np.ndarray:
    """Lies at (90, 60), then flies on a parabola; centres scatter by 0.1 px."""
    time = np.arange(flown) + 0.6
    flight = np.column_stack([90.0 + 1.4 * time, 60.0 - 0.7 * time + 0.012 * time**2])
    rest = np.tile([90.0, 60.0], (still, 1))
    scatter = np.random.default_rng(8).normal(0.0, 0.1, (still + flown, 2))
    return np.concatenate([rest, flight]) + scatter


def test_a_course_is_the_rest_and_the_flight() -> None:
    course = lawful_course(np.arange(120), _struck(50, 70), 9.0)
    # a ball that hardly moved yet may count for either
    assert course.still == pytest.approx(50, abs=3)
    assert course.still + course.moving == 120
    assert (course.astray, course.missed, course.last) == (0, 0, 119)


def test_a_rest_told_as_another_thing_speaks_less_for_a_course() -> None:
    whole = _struck(50, 70)
    shadow = whole.copy()
    shadow[:50] += np.column_stack([np.linspace(40.0, 12.0, 50), np.full(50, 30.0)])
    shadow[::7] += 9.0
    frame = np.arange(120)
    best = lawful_course(frame, whole, 9.0).evidence(9.0)
    assert best > lawful_course(frame, shadow, 9.0).evidence(9.0) + 50.0
    assert best > lawful_course(frame[52:], whole[52:], 9.0).evidence(9.0) + 50.0


def test_a_course_ends_with_its_law_and_counts_what_is_not_seen() -> None:
    path = _struck(50, 70)
    bounced = path[-1] + np.column_stack([1.4 * TIME[1:16], -2.0 * TIME[1:16]])
    frame = np.setdiff1d(np.arange(135), [70, 71, 72])
    course = lawful_course(frame, np.concatenate([path, bounced])[frame], 9.0)
    assert course.missed == 3
    assert course.last == pytest.approx(119, abs=2)
    assert course.astray == pytest.approx(15, abs=2)


def test_one_gap_is_less_of_a_surprise_than_as_many_frames_missed_here_and_there() -> None:
    path, frame = _struck(50, 120), np.arange(170)
    hidden = np.setdiff1d(frame, np.arange(80, 120))
    blinking = np.setdiff1d(frame, np.arange(60, 140, 2))
    courses = [lawful_course(left, path[left], 9.0) for left in (hidden, blinking)]
    assert [course.missed for course in courses] == [40, 40]
    assert courses[0].evidence(9.0) > courses[1].evidence(9.0) + 30.0
    assert courses[1].hidden == 0.0
    lacking = lawful_course(blinking, path[blinking], 9.0, blinking)
    assert (lacking.hidden, lacking.absent) == (40.0, 40)
    assert courses[0].absent == 0


def test_what_lay_elsewhere_is_no_rest_of_what_flies() -> None:
    path = _struck(50, 70)
    path[:50] += [40.0, 28.0]
    course = lawful_course(np.arange(120), path, 9.0)
    assert course.still == 0
    assert course.astray == pytest.approx(50, abs=3)


def test_what_never_leaves_its_place_has_no_law() -> None:
    course = lawful_course(np.arange(60), _struck(60, 0), 9.0)
    assert course.moving == 0
    assert course.evidence(9.0) <= 0.0


def test_what_bounces_often_is_lawful_in_between() -> None:
    rng, time = np.random.default_rng(14), np.arange(400.0)
    across = np.cumsum(np.repeat(rng.normal(0.0, 3.0, 29), 14)[:400])
    path = np.column_stack([across, 200.0 + 0.3 * (time % 14.0 - 7.0) ** 2])
    path += rng.normal(0.0, 0.3, path.shape)
    stretch = lawful_stretch(np.arange(400), path, 6.0)
    assert 12 <= stretch.looks <= 16
    assert stretch.evidence > 20.0


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
        motion = motion_of(seen, None, pendulum=False)
        share = {motion.kind: motion.probability} | dict(motion.alternatives)
        falling = share[MotionKind.FLIGHT] + share[MotionKind.DROP]
        shares.append(falling if falls else share[MotionKind.NONE])
    assert np.mean(np.array(shares) > 0.5) >= 0.8
    assert np.mean(np.array(shares) < 0.05) <= 0.1


def test_a_path_whose_acceleration_may_be_none_is_no_sure_flight() -> None:
    rolling = np.column_stack([6.0 * TIME, 100.0 + 0.2 * TIME])
    kind, probability = _kind(rolling)
    assert kind is MotionKind.NONE
    assert probability > 0.6


def test_bends_in_all_directions_are_no_gravity() -> None:
    centre = [np.zeros(2)]
    for turn in (0.3, 2.0, 4.1, 5.5, 1.2):
        pull = 0.25 * np.array([np.cos(turn), np.sin(turn)])
        speed = np.array([np.sin(turn), -np.cos(turn)]) * 3.0
        time = np.arange(1.0, 25.0)[:, None]
        centre += list(centre[-1] + speed * time + 0.5 * pull * time**2)
    kind, probability = _kind(np.array(centre) + 300.0)
    assert kind is MotionKind.NONE or probability < 0.6


def test_a_ball_that_bounces_flies_though_no_arc_is_most_of_its_way() -> None:
    path = _bounces(np.linspace(0.0, 1.0, 120), 300.0, np.random.default_rng(1))
    kind, probability = _kind(path + 50.0)
    assert kind is MotionKind.FLIGHT
    assert probability > 0.8


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_which_way_it_falls_is_told(quarter: int) -> None:
    turn = np.linalg.matrix_power(np.array([[0, 1], [-1, 0]]), quarter)
    centre = np.column_stack([4.0 * TIME, -5.0 * TIME + 0.08 * TIME**2]) @ turn + 200.0
    motion = motion_of(_track(centre), None, pendulum=False)
    assert motion.fall_px == pytest.approx(tuple(np.array([0.0, 0.16]) @ turn), abs=0.005)


def test_what_rolls_falls_nowhere() -> None:
    centre = np.column_stack([6.0 * TIME, 100.0 + 0.2 * TIME])
    assert motion_of(_track(centre), None, pendulum=False).fall_px is None


def test_a_bob_bends_up_where_it_is_lowest_and_nothing_that_falls_or_brakes_does() -> None:
    time = np.arange(50.0)
    angle = 0.02 * (time - 25.0)
    bob = np.column_stack([100.0 + 80.0 * np.sin(angle), 20.0 + 80.0 * np.cos(angle)])
    thrown = np.column_stack([20.0 + 3.0 * time, 90.0 - 2.0 * time + 0.03 * time**2])
    braked = np.outer(4.0 * time - 0.03 * time**2, [0.8, 0.6])

    def bends(places: np.ndarray) -> bool:
        strayed = places + np.random.default_rng(5).normal(0.0, 0.3, places.shape)
        return bends_up(np.arange(len(places)), strayed, 8.0)

    assert bends(bob)
    assert not bends(thrown)
    # it comes down in the picture, and slows down: its acceleration points up
    assert not bends(braked)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_bob_that_passes_once_is_no_flight_under_a_camera_upside_down(way: float) -> None:
    angle = way * np.linspace(-0.3, 0.25, 100)
    centre = 90.0 * np.column_stack([np.sin(angle), np.cos(angle)]) + 200.0
    motion = motion_of(_track(centre), None, pendulum=False)
    share = {motion.kind: motion.probability} | dict(motion.alternatives)
    assert share[MotionKind.FLIGHT] + share[MotionKind.DROP] + share[MotionKind.STRIKE] < 0.4


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
def test_a_bob_that_climbs_past_its_lowest_point_swings_and_the_camera_stood_upright(
    way: float, start: float, speed: float
) -> None:
    # Gravity brakes it while its pivot pulls it up: what is left points sideways, as a fall does
    # in the picture of a camera that lay on its side.
    angle = way * _bob(start, speed)
    centre = 70.0 * np.column_stack([np.sin(angle), np.cos(angle)]) + 100.0
    for seed in range(6):
        motion = motion_of(_track(centre, seed), None, pendulum=False)
        assert motion.fall_px is None
        assert motion.kind is MotionKind.SWING


def test_what_drives_itself_along_an_arc_and_off_a_wall_does_not_swing() -> None:
    turned = np.linspace(0.0, 0.7, 45)
    bent = 8.0 * np.column_stack([np.cos(turned), -np.sin(turned)])
    back = 8.0 * np.column_stack([-np.cos(turned), np.full(45, -0.3)])
    straight = np.tile([-8.0, 0.4], (40, 1))
    centre = np.array([50.0, 400.0]) + np.cumsum(np.vstack([bent, back, straight]), axis=0)
    kind, probability = _kind(centre)
    assert kind is not MotionKind.SWING or probability < 0.5
    alone, _ = _kind(centre[:45])
    assert alone is MotionKind.SWING


def test_what_lies_still_and_is_put_elsewhere_does_not_swing() -> None:
    place = np.repeat([[60.0, 60.0], [66.0, 75.0], [60.0, 60.0]], [90, 20, 20], axis=0)
    kind, probability = _kind(place)
    assert kind is MotionKind.NONE
    assert probability > 0.9


def test_what_an_unsure_pendulum_met_may_as_well_roll() -> None:
    still = np.tile([60.0, 60.0], (20, 1))
    rolled = 60.0 + np.column_stack([3.0 * TIME, 0.7 * TIME])
    track = _track(np.vstack([still, rolled]))
    told = [motion_of(track, (0, 19), pendulum=True, sure=sure) for sure in (True, False)]
    assert [motion.kind for motion in told] == [MotionKind.STRIKE] * 2
    assert told[0].probability > 0.95
    assert told[1].probability < 0.9
