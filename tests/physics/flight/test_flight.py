import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from metrology import DomainError
from physics.arrays import Number, Vector
from physics.bodies import GRAVITY, JOKKU
from physics.flight.air import PAPER_AIR, Air
from physics.flight.closed_form import Launch, drag_constant, drag_free_distance, land, paper_path
from physics.flight.drag_curves import SOCCER_DRAG, SOCCER_LIFT
from physics.flight.flight import fly
from physics.flight.forces import Drag, Gravity, Magnus, SpinDecay
from physics.flight.march import BallState, fly_many, march, sample_flights
from tests.physics.independent import Array, extrapolated

K = drag_constant(JOKKU, PAPER_AIR, 0.47)


def test_without_drag_numerical_and_closed_form_are_the_parabola() -> None:
    launch = Launch(6.0, 0.15, 0.05)
    wanted = land(launch, 0.312, 0.0)
    start = (0.05 * math.cos(0.15), JOKKU.radius + 0.312 + 0.05 * math.sin(0.15), 0.0)
    moving = (6.0 * math.cos(0.15), 6.0 * math.sin(0.15), 0.0)
    flight = fly(start, moving, [Gravity()], floor=JOKKU.radius)
    assert flight.landing_time == pytest.approx(wanted.time, abs=1e-9)
    assert flight.landing_position[0] == pytest.approx(wanted.distance, abs=1e-9)


def test_with_horizontal_drag_only_the_closed_form_is_exact() -> None:
    # what Eqs 13, 14 integrate: drag along x by the x-velocity, none along y
    def horizontal(time: Number, position: Vector, velocity: Vector, spin: Vector) -> Vector:
        return -K * velocity[0] * velocity[0], 0.0, 0.0

    wanted = land(Launch(6.0, 0.15, 0.0), 0.312, K)
    flight = fly(
        (0.0, JOKKU.radius + 0.312, 0.0),
        (6.0 * math.cos(0.15), 6.0 * math.sin(0.15), 0.0),
        [Gravity(), horizontal],
        floor=JOKKU.radius,
    )
    assert flight.landing_position[0] == pytest.approx(wanted.distance, abs=1e-9)


def test_flat_flight_in_still_air_without_gravity() -> None:
    end = march(
        BallState((0.0, 1.0, 0.0), (7.0, 0.0, 0.0)), 0.4, 200, [Drag(JOKKU, PAPER_AIR, 0.47)]
    )
    assert end.position[0] == pytest.approx(math.log1p(K * 7.0 * 0.4) / K, abs=1e-9)


@given(st.floats(0.0, 5.0), st.floats(1e-9, 1.0))
def test_the_drag_limit_has_no_seam(distance: float, constant: float) -> None:
    free = float(drag_free_distance(distance, constant))
    assert free >= distance
    assert math.log1p(constant * free) / constant == pytest.approx(distance, rel=1e-6, abs=1e-9)


def test_no_drag_is_exact_not_a_division() -> None:
    assert drag_free_distance(2.0, 0.0) == 2.0
    assert land(Launch(5.0, 0.1, 0.0), 0.3, 0.0).distance == pytest.approx(
        land(Launch(5.0, 0.1, 0.0), 0.3, 1e-12).distance, rel=1e-10
    )


def test_path_of_the_paper_ends_where_it_lands() -> None:
    launch = Launch(5.0, 0.15, 0.04)
    landing = land(launch, 0.312, K)
    x, y = paper_path(launch, landing.time, K)
    assert x == pytest.approx(landing.distance, abs=1e-12)
    assert y == pytest.approx(-0.312, abs=1e-12)


def _all_forces(time: float, state: Array) -> Array:
    """Gravity, wind, drag crisis, lift and spin decay, written down again from the laws."""
    x, v, w = state[:3], state[3:6], state[6:]
    rho, mu = 1.18, 1.852e-5
    m, d = 0.353, 0.20175
    area = math.pi * d * d / 4
    u = v - np.array([1.0, 0.2, -0.5])
    speed = math.sqrt(float(u @ u))
    re = rho * speed * d / mu
    cd = 0.155 + 0.346 / (
        1.0 + math.exp((re - 12.19 * 0.2185 / 1.5e-5) / (1.309 * 0.2185 / 1.5e-5))
    )
    drag = -0.5 * rho * area * cd * speed * u
    lift = 0.5 * rho * area * 0.8 * (d / 2) * np.cross(w, u)
    decay = 0.009 * rho * area * (d / 2) ** 2 / (2 / 3 * m * (d / 2) ** 2)
    spin = -decay * math.sqrt(float(v @ v)) * w
    return np.concatenate([v, (drag + lift) / m - np.array([0.0, GRAVITY, 0.0]), spin + 0.0 * x])


def test_all_forces_agree_with_an_independent_integrator() -> None:
    wind = (1.0, 0.2, -0.5)
    forces = [
        Gravity(),
        Drag(JOKKU, PAPER_AIR, SOCCER_DRAG, wind),
        Magnus(JOKKU, PAPER_AIR, 0.8, wind),
    ]
    decay = SpinDecay(JOKKU, PAPER_AIR)
    start = np.array([0.0, 1.5, 0.0, 13.0, 4.0, 0.5, 5.0, -20.0, 60.0])
    flight = fly(start[:3], start[3:6], forces, spin=start[6:], spin_rate=decay, floor=0.1)
    wanted = extrapolated(_all_forces, start, flight.landing_time, 12)
    np.testing.assert_allclose(flight.landing_position, wanted[:3], atol=2e-9)
    np.testing.assert_allclose(flight.landing_velocity, wanted[3:6], atol=2e-8)
    np.testing.assert_allclose(flight.spin[-1], wanted[6:], atol=1e-7)
    # the fixed-step core, on floats and on arrays
    state = BallState(tuple(start[:3]), tuple(start[3:6]), tuple(start[6:]))
    end = march(state, flight.landing_time, 60, forces, decay)
    np.testing.assert_allclose(end.position, wanted[:3], atol=1e-6)
    time, there = fly_many(state, forces, decay, floor=0.1)
    assert time[0] == pytest.approx(flight.landing_time, abs=1e-6)
    assert float(np.ravel(there.position[0])[0]) == pytest.approx(wanted[0], abs=1e-5)


def test_many_flights_are_each_their_own() -> None:
    drags = np.linspace(0.0, 0.6, 7)
    forces = [Gravity(), Drag(JOKKU, PAPER_AIR, drags)]
    _, there = fly_many(BallState((0.0, 0.4, 0.0), (6.0, 1.0, 0.0)), forces, floor=JOKKU.radius)
    for drag, x in zip(drags, np.asarray(there.position[0]), strict=True):
        one = fly(
            (0.0, 0.4, 0.0),
            (6.0, 1.0, 0.0),
            [Gravity(), Drag(JOKKU, PAPER_AIR, float(drag))],
            floor=JOKKU.radius,
        )
        assert x == pytest.approx(one.landing_position[0], abs=1e-7)


def test_samples_of_a_flight_lie_on_it_before_and_after_the_start() -> None:
    forces = [Gravity(), Drag(JOKKU, PAPER_AIR, 0.47)]
    state = BallState((0.0, 1.0, 0.0), (5.0, 1.0, 0.0))
    times = np.array([-0.1, 0.0, 0.13, 0.3])
    position, velocity = sample_flights(times, state, forces, start=0.0)
    assert position.shape == (4, 3)
    np.testing.assert_allclose(position[1], [0.0, 1.0, 0.0], atol=1e-9)
    end = march(state, 0.3, 300, forces)
    np.testing.assert_allclose(position[3], end.position, atol=1e-8)
    back = march(BallState(tuple(position[0]), tuple(velocity[0])), 0.1, 100, forces)
    np.testing.assert_allclose(back.position, [0.0, 1.0, 0.0], atol=1e-8)


@settings(max_examples=30)
@given(st.floats(0.1, 12.0), st.floats(-1.0, 1.3), st.floats(0.0, 1.0))
def test_drag_takes_energy_and_never_gives_any(speed: float, angle: float, drag: float) -> None:
    moving = (speed * math.cos(angle), speed * math.sin(angle), 0.0)
    flight = fly((0.0, 1.0, 0.0), moving, [Gravity(), Drag(JOKKU, PAPER_AIR, drag)], floor=0.1)
    energy = 0.5 * np.sum(flight.velocity**2, axis=1) + GRAVITY * flight.position[:, 1]
    assert np.all(np.diff(energy) <= 1e-9)


def test_magnus_does_no_work_and_vanishes_without_spin() -> None:
    lift = Magnus(JOKKU, PAPER_AIR, SOCCER_LIFT)
    velocity, spin = (9.0, 2.0, 1.0), (3.0, -40.0, 50.0)
    push = np.array(lift(0.0, (0.0, 0.0, 0.0), velocity, spin), dtype=np.float64)
    assert push @ np.array(velocity) == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.norm(push) > 0.1
    none = lift(0.0, (0.0, 0.0, 0.0), velocity, (0.0, 0.0, 0.0))
    assert all(float(part) == 0.0 for part in none)
    still = lift(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), spin)
    assert all(math.isfinite(float(part)) for part in still)


def test_back_spin_lifts() -> None:
    up = Magnus(JOKKU, PAPER_AIR)(0.0, (0, 0, 0), (5.0, 0.0, 0.0), (0.0, 0.0, 10.0))
    assert float(up[1]) > 0.0


def test_a_flight_that_never_lands_is_an_error() -> None:
    with pytest.raises(DomainError, match="not landed"):
        fly((0.0, 1.0, 0.0), (1.0, 1.0, 0.0), [Gravity(-1.0)], longest=2.0)
    with pytest.raises(DomainError, match="not landed"):
        fly_many(BallState((0.0, 1.0, 0.0), (1.0, 1.0, 0.0)), [Gravity(0.0)], longest=1.0)
    with pytest.raises(DomainError, match="below the floor"):
        fly((0.0, 0.0, 0.0), (1.0, 1.0, 0.0), [Gravity()], floor=0.1)
    with pytest.raises(DomainError, match="finite"):
        fly((0.0, 1.0, 0.0), (math.nan, 1.0, 0.0), [Gravity()])
    with pytest.raises(DomainError):
        land(Launch(5.0, 0.1, 0.0), 0.3, K, gravity=0.0)
    with pytest.raises(DomainError):
        land(Launch(0.01, 0.1, -5.0), 0.3, K)


def test_dimensions_scale() -> None:
    """Lengths x 2, times x 3, masses x 5: the landing must follow."""
    length, time, mass = 2.0, 3.0, 5.0
    launch = Launch(6.0, 0.2, 0.05)
    one = land(launch, 0.3, K)
    scaled = Launch(6.0 * length / time, 0.2, 0.05 * length)
    two = land(scaled, 0.3 * length, K / length, GRAVITY * length / time**2)
    assert two.distance == pytest.approx(one.distance * length, rel=1e-12)
    assert two.time == pytest.approx(one.time * time, rel=1e-12)
    air = Air(1.18 * mass / length**3, 1.85e-5)
    ball = type(JOKKU)("scaled", 0.353 * mass, 0.20175 * length, 0.1, JOKKU.cor)
    assert drag_constant(ball, air, 0.47) == pytest.approx(K / length, rel=1e-12)
