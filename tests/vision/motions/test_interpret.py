"""Kinds of motion, events and parameters against tracks made by equations of motion alone."""

import csv
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.shared_data import shared_folder
from vision.motions import EventKind, Model, Observations, interpret
from vision.motions.models import _angle
from vision.tracks import MotionKind


def seen(path, noise, rng, radius=10.0, first=0, keep=None):
    frame = first + np.arange(len(path))
    place = path + rng.normal(0, noise, path.shape)
    kept = np.ones(len(path), dtype=bool) if keep is None else keep
    return Observations.of(frame[kept], place[kept], noise, radius)


def bounced(height, gravity, restitution, start, count):
    """A fall from rest at a frame that need not be whole, in closed form: y, contacts."""
    time_, contacts = np.arange(count, dtype=float), []
    y = np.where(time_ < start, 0.0, np.nan)
    hit, speed = start + math.sqrt(2 * height / gravity), math.sqrt(2 * gravity * height)
    falling = (time_ >= start) & (time_ < hit)
    y[falling] = 0.5 * gravity * (time_[falling] - start) ** 2
    while hit < count:
        contacts.append(hit)
        speed *= restitution
        nxt = hit + 2 * speed / gravity
        up = (time_ >= hit) & (time_ < nxt)
        y[up] = height - speed * (time_[up] - hit) + 0.5 * gravity * (time_[up] - hit) ** 2
        hit = nxt
    return y, contacts


def pendulum(amplitude_deg, periods, count, decay=1.0, arm=150.0):
    """A damped pendulum by its differential equation: path, mean period between zero crossings."""
    amplitude, omega = math.radians(amplitude_deg), 2 * math.pi * periods / count
    rate = decay / count
    angle = solve_ivp(
        lambda t, q: [q[1], -(omega**2) * math.sin(q[0]) - 2 * rate * q[1]],
        (0, count),
        [amplitude, 0.0],
        t_eval=np.arange(count),
        rtol=1e-9,
        atol=1e-10,
    ).y[0]
    at = np.flatnonzero(np.diff(np.sign(angle)) != 0)
    zero = at - angle[at] / (angle[at + 1] - angle[at])
    period = 2 * (zero[-1] - zero[0]) / (len(zero) - 1)
    return arm * np.column_stack([np.sin(angle), np.cos(angle)]) + [300, 60], period


@pytest.mark.parametrize(
    ("amplitude", "periods", "noise"),
    [(5, 2.3, 0.2), (12, 6, 1.0), (30, 40, 0.5), (60, 3, 2.0), (90, 12, 1.0), (120, 8, 0.5)],
)
def test_swings_of_any_size_are_recognised_with_their_period(amplitude, periods, noise):
    rng = np.random.default_rng(amplitude)
    path, period = pendulum(amplitude, periods, 420, decay=0.02)
    found = interpret(seen(path, noise, rng))
    assert found.kind is MotionKind.SWING
    swing = next(each for each in found.segments if each.model is Model.SWING)
    # zero crossings of a swing that hardly decays come at its period
    assert swing.period == pytest.approx(period, abs=4 * swing.period_std + 1e-3 * period)
    assert swing.period_std < 0.02 * period


def test_swings_drawn_at_random_are_recognised_with_their_periods():
    known, off = 0, []
    for seed in range(40):
        rng = np.random.default_rng([77, seed])
        amplitude, periods, noise = (
            math.exp(rng.uniform(math.log(low), math.log(high)))
            for low, high in ((5, 120), (2.2, 40), (0.2, 2))
        )
        count = int(np.clip(periods * rng.uniform(10, 60), 60, 800))
        path, period = pendulum(amplitude, periods, count, decay=rng.uniform(0, 1.5))
        found = interpret(seen(path, noise, rng))
        if found.kind is MotionKind.SWING:
            known += 1
            swing = next(each for each in found.segments if each.model is Model.SWING)
            off.append(abs(swing.period - period) / swing.period_std)
    # 98 of 100 are wanted: of 40 one may be missed
    assert known >= 39
    assert np.mean(np.array(off) < 2.0) >= 0.9


def test_a_swing_s_decay_and_amplitude_are_those_of_the_equation():
    rng = np.random.default_rng(5)
    path, _ = pendulum(50, 10, 500, decay=1.2)
    found = interpret(seen(path, 0.5, rng))
    swing = next(each for each in found.segments if each.model is Model.SWING)
    assert found.kind is MotionKind.SWING
    assert math.degrees(swing.amplitude) == pytest.approx(50, abs=2)
    assert swing.damping == pytest.approx(1.2 / 500, rel=0.1)


def test_a_drop_with_bounces_has_its_release_its_contacts_and_one_gravity():
    rng = np.random.default_rng(1)
    y, contacts = bounced(260.0, 0.08, 0.75, 40.3, 300)
    path = np.column_stack([np.full(300, 200.0), 50 + y])
    found = interpret(seen(path, 0.4, rng))
    assert found.kind in (MotionKind.DROP, MotionKind.BOUNCE)
    assert found.gravity_px is not None
    assert found.gravity_px[1] == pytest.approx(0.08, rel=0.01)
    release = next(each for each in found.events if each.kind is EventKind.RELEASE)
    assert release.frame == pytest.approx(40.3, abs=3 * release.std + 1.0)
    hits = [each for each in found.events if each.kind is EventKind.BOUNCE]
    assert len(hits) >= len(contacts) - 1
    for hit, truth in zip(hits, contacts, strict=False):
        assert hit.frame == pytest.approx(truth, abs=4 * hit.std + 0.1)


def test_a_throw_is_a_flight_with_the_gravity_of_its_camera_tilted_or_not():
    rng = np.random.default_rng(2)
    t = np.arange(80.0)[:, None]
    for tilt in (0.0, 0.2):
        pull = 0.15 * np.array([math.sin(tilt), math.cos(tilt)])
        path = np.array([40.0, 300.0]) + t * [4.0, -6.0] + 0.5 * pull * t**2
        found = interpret(seen(path, 0.5, rng))
        assert found.kind is MotionKind.FLIGHT
        assert found.gravity_px == pytest.approx(tuple(pull), abs=0.003)
        assert found.frames == (0, 79)


def test_the_longest_segment_keeps_its_name_when_a_slide_ends_in_a_fall():
    rng = np.random.default_rng(3)
    t = np.arange(361.0)
    slope = np.array([math.cos(0.35), math.sin(0.35)])
    slide = 60 + np.outer(0.5 * 0.0041 * t**2, slope)
    u = np.arange(1.0, 28.0)[:, None]
    fall = slide[-1] + u * (slide[-1] - slide[-2]) + [0, 0.06] * u**2
    found = interpret(seen(np.concatenate([slide, fall]), 0.7, rng))
    assert found.kind in (MotionKind.ROLL, MotionKind.SLIDE)
    assert found.frames is not None
    assert found.frames[1] == pytest.approx(360, abs=8)


def test_a_body_that_rolls_up_a_slope_and_back_rolls():
    rng = np.random.default_rng(4)
    t = np.arange(300.0)
    path = np.outer(2.2 * t - 0.0085 * t**2, [0.98, -0.2]) + np.array([50, 200])
    found = interpret(seen(path, 0.4, rng))
    assert found.kind in (MotionKind.ROLL, MotionKind.SLIDE)
    turn = next(each for each in found.events if each.kind is EventKind.TURN)
    assert turn.frame == pytest.approx(2.2 / 0.017, abs=4 * turn.std + 0.5)


def struck(rest, count, gravity=0.02, launch=3.0):
    """A pendulum of 60° meets a ball at rest at a frame: paths of the ball and of the mass."""
    arm, omega = 180.0, math.sqrt(gravity / 180.0)
    speed = math.sqrt(2 * gravity * arm * (1 - math.cos(math.radians(60))))

    def rhs(_, q):
        return [q[1], -(omega**2) * math.sin(q[0])]

    before = solve_ivp(rhs, (0, -rest), [0.0, speed / arm], t_eval=-np.arange(0.0, rest + 1)).y[0]
    late = np.arange(1.0, count - rest)
    after = solve_ivp(rhs, (0, count), [0.0, 0.8 * speed / arm], t_eval=late).y[0]
    angle = np.concatenate([before[::-1], after])
    mass = np.array([200.0, 20.0]) + arm * np.column_stack([np.sin(angle), np.cos(angle)])
    t = np.clip(np.arange(count) - rest, 0, None)[:, None]
    flight = t * [launch, -0.4] + 0.5 * np.array([0, gravity]) * t**2
    return np.array([224.0, 200.0]) + flight, mass


def test_a_pendulum_that_meets_a_ball_at_rest_is_a_strike_at_the_frame_of_contact():
    rng = np.random.default_rng(6)
    for rest in (40, 170):
        ball, mass = struck(rest, rest + 90)
        found = interpret(seen(ball, 0.3, rng, 12), seen(mass, 0.8, rng, 12))
        assert found.kind is MotionKind.STRIKE
        assert found.rest is not None
        assert found.rest[1] == pytest.approx(rest, abs=2)
        contact = next(each for each in found.events if each.kind is EventKind.CONTACT)
        assert contact.frame == pytest.approx(rest, abs=4 * contact.std + 0.3)


def test_a_ball_that_meets_another_at_rest_is_a_collision():
    rng = np.random.default_rng(7)
    t = np.arange(140.0) - 70.4
    target = np.where(t[:, None] > 0, np.outer(t, [1.7, 0.3]), 0.0) + np.array([200, 150])
    striker = np.where(t[:, None] < 0, np.outer(t, [2.0, 0.2]), np.outer(t, [0.3, -0.1]))
    found = interpret(seen(target, 0.3, rng, 9), seen(striker + np.array([182, 147]), 0.3, rng, 9))
    assert found.kind is MotionKind.COLLISION
    contact = next(each for each in found.events if each.kind is EventKind.CONTACT)
    assert contact.frame == pytest.approx(70.4, abs=4 * contact.std + 0.3)


def test_a_hand_s_way_is_no_motion_of_a_free_body():
    rng = np.random.default_rng(8)
    t = np.arange(240) / 240
    path = 200 + 70 * np.column_stack(
        [
            np.sin(6 * t + 3 * t**2) + 0.5 * np.sin(23 * t**1.5),
            np.cos(9 * t**2 + 1) + 0.4 * np.sin(17 * t + 2),
        ]
    )
    found = interpret(seen(path, 0.4, rng))
    free = (MotionKind.FLIGHT, MotionKind.DROP, MotionKind.STRIKE, MotionKind.SWING)
    assert sum(found.probabilities[kind] for kind in free) < 0.5


@pytest.mark.parametrize("noise", [0.2, 1.5])
def test_what_only_trembles_has_no_motion(noise):
    rng = np.random.default_rng(9)
    found = interpret(seen(np.full((120, 2), 100.0), noise, rng))
    assert found.kind is MotionKind.NONE


def test_too_few_rows_and_rows_without_numbers_leave_the_kind_open():
    rng = np.random.default_rng(10)
    for few in (
        seen(np.zeros((3, 2)), 1.0, rng),
        Observations.of(np.arange(9), np.full((9, 2), np.nan), 1.0, 5.0),
    ):
        found = interpret(few)
        assert found.kind is MotionKind.NONE
        assert found.probability < 0.2
        assert sum(found.probabilities.values()) == pytest.approx(1.0)


def test_probabilities_of_all_kinds_sum_to_one_and_misses_change_no_kind():
    rng = np.random.default_rng(11)
    t = np.arange(90.0)[:, None]
    path = np.array([40.0, 300.0]) + t * [3.0, -5.0] + 0.5 * np.array([0.0, 0.12]) * t**2
    keep = (rng.random(90) > 0.3) & ~((t[:, 0] > 40) & (t[:, 0] < 52))
    wild = path.copy()
    wild[[20, 66]] += 80
    found = interpret(seen(wild, 0.5, rng, keep=keep))
    assert set(found.probabilities) == set(MotionKind)
    assert sum(found.probabilities.values()) == pytest.approx(1.0)
    assert found.kind is MotionKind.FLIGHT


def test_noise_that_changes_slowly_is_reported_as_correlated():
    rng = np.random.default_rng(12)
    white = rng.normal(size=(260, 2))
    slow = np.array([white[i : i + 8].mean(axis=0) for i in range(250)]) * math.sqrt(8)
    t = np.arange(250.0)[:, None]
    path = t * [1.0, 0.2] + 50
    assert interpret(seen(path + slow, 0.05, rng)).noise_correlation > 0.5
    assert interpret(seen(path, 1.0, rng)).noise_correlation < 0.3


def test_a_long_track_is_a_swing():
    rng = np.random.default_rng(13)
    path, _ = pendulum(40, 20, 2000, decay=0.5)
    track = seen(path, 0.5, rng)
    assert interpret(track).kind is MotionKind.SWING


@pytest.mark.parametrize(
    ("clip", "kinds"),
    [
        ("freefall_phantom1000", {"drop", "flight"}),
        ("pendulum_ornament_352p30", {"swing"}),
        ("projectile_A_canon240", {"flight"}),
        ("projectile_B_canon240", {"flight"}),
        ("rolling_cylinder_canon240", {"roll", "slide"}),
        ("sliding_slope_canon240", {"roll", "slide"}),
        ("tennis_toss_1080p30", {"flight"}),
    ],
)
def test_truth_of_recordings_has_its_kind(clip, kinds):
    text = (shared_folder("clips") / "truth" / f"{clip}.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    table = np.array(
        [
            [float(row[k]) for k in ("frame", "x_px", "y_px", "uncertainty_px", "radius_px")]
            for row in rows
        ]
    )
    track = Observations.of(table[:, 0], table[:, 1:3], table[:, 3], float(np.median(table[:, 4])))
    assert interpret(track).kind.value in kinds


def test_a_frequency_beyond_two_frames_a_period_is_no_error() -> None:
    time = np.arange(40.0)
    angle, _ = _angle(np.array([800.0, 0.0, -1.0, 0.5]), time, 39.0)
    assert np.isfinite(angle).all()


def test_a_kind_that_was_given_explains_the_track_and_its_probability_stays():
    path, period = pendulum(30, 3, 300)
    ball = seen(path, 0.3, np.random.default_rng(4))
    found, given = interpret(ball), interpret(ball, given=MotionKind.FLIGHT)
    assert found.kind is MotionKind.SWING
    assert given.kind is MotionKind.FLIGHT
    assert given.probabilities == found.probabilities
    assert given.probability < 0.1
    again = interpret(ball, given=MotionKind.SWING)
    assert again.segments[-1].period == pytest.approx(period, rel=0.01)
    assert again.frames == found.frames
