"""Flights compared with closed forms and an independent integrator."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from metrology import DomainError
from physics.air import PAPER_AIR, SOCCER_DRAG, Air
from physics.bodies import GRAVITY, JOKKU
from physics.domain import FloatArray, Vector
from physics.effects import Effect, FlightState, Parameter, Phase, Term, Values, effect_named
from physics.flight import (
    FlightModel,
    Launch,
    drag_constant,
    drag_free_distance,
    flown,
    fly,
    land,
    land_many,
    rates,
    time_of_fall,
)
from physics.forward import Experiment, ball_state, drag_term
from physics.integrator import integrate, runge_kutta_step
from tests.physics.independent import Array, extrapolated

K = drag_constant(JOKKU, PAPER_AIR, 0.47)
FREE = FlightModel(JOKKU.mass, JOKKU.diameter, PAPER_AIR.density, PAPER_AIR.viscosity, GRAVITY)
DRAGGED = Experiment(JOKKU).flight


def term(name: str, **values: float | FloatArray) -> Term:
    return Term(effect_named(name), values)


def test_without_drag_numerical_and_closed_form_are_the_parabola() -> None:
    launch = Launch(6.0, 0.15, 0.05)
    wanted = land(launch, 0.312, 0.0)
    start = (0.05 * math.cos(0.15), JOKKU.radius + 0.312 + 0.05 * math.sin(0.15), 0.0)
    moving = (6.0 * math.cos(0.15), 6.0 * math.sin(0.15), 0.0)
    flight = fly(FREE, start, moving, floor=JOKKU.radius)
    assert flight.landing_time == pytest.approx(wanted.time, abs=1e-9)
    assert flight.landing_position[0] == pytest.approx(wanted.distance, abs=1e-9)


def test_with_horizontal_drag_only_the_closed_form_is_exact() -> None:
    # what Eqs 13, 14 integrate: drag along x by the x-velocity, none along y
    @dataclass(frozen=True)
    class Horizontal(Effect):
        id: str = "horizontal"
        statement: str = ""
        law: str = ""
        source: str = "Eqs 11, 12"
        phase: Phase = "flight"
        parameters: tuple[Parameter, ...] = ()

        def force(self, values: Values, flight: FlightState) -> Vector:
            return -K * JOKKU.mass * flight.vx * flight.vx, 0.0, 0.0

    wanted = land(Launch(6.0, 0.15, 0.0), 0.312, K)
    flight = fly(
        FREE.with_terms(Term(Horizontal(), {})),
        (0.0, JOKKU.radius + 0.312, 0.0),
        (6.0 * math.cos(0.15), 6.0 * math.sin(0.15), 0.0),
        floor=JOKKU.radius,
    )
    assert flight.landing_position[0] == pytest.approx(wanted.distance, abs=1e-9)


def test_flat_flight_in_still_air_without_gravity() -> None:
    floating = replace(DRAGGED, gravity=0.0)
    path = integrate(floating.rates, ball_state(0.0, 1.0, 7.0, 0.0), np.array([0.4]), 40)
    assert path.states[-1, 0, 0] == pytest.approx(math.log1p(K * 7.0 * 0.4) / K, abs=1e-9)


@given(st.floats(0.0, 5.0), st.floats(1e-9, 1.0))
def test_the_limit_of_zero_drag_is_continuous(distance: float, constant: float) -> None:
    free = float(drag_free_distance(distance, constant))
    assert free >= distance
    assert math.log1p(constant * free) / constant == pytest.approx(distance, rel=1e-6, abs=1e-9)


def test_no_drag_is_exact_not_a_division() -> None:
    assert drag_free_distance(2.0, 0.0) == 2.0
    assert land(Launch(5.0, 0.1, 0.0), 0.3, 0.0).distance == pytest.approx(
        land(Launch(5.0, 0.1, 0.0), 0.3, 1e-12).distance, rel=1e-10
    )


def _all_forces(time: float, state: Array) -> Array:
    """Gravity, draught, drag by Reynolds number, lift, its decay and buoyancy, written anew."""
    v = state[3:6]
    rho, mu, m, d = 1.18, 1.852e-5, 0.353, 0.20175
    area = math.pi * d * d / 4
    speed = math.sqrt(float(v @ v))
    re = rho * speed * d / mu
    cd = 0.155 + 0.346 / (
        1.0 + math.exp((re - 12.19 * 0.2185 / 1.5e-5) / (1.309 * 0.2185 / 1.5e-5))
    )
    u = v - np.array([1.0, 0.0, 0.0])
    # the catalogue's draught takes the coefficient at the speed over ground
    drag = -0.5 * rho * area * cd * math.sqrt(float(u @ u)) * u
    spin = 60.0 * math.exp(-0.9 * time)
    lift = 0.5 * rho * area * (d / 2) * np.cross([0.0, 0.0, spin], v)
    up = np.array([0.0, 0.8 * rho * math.pi / 6 * d**3 * GRAVITY, 0.0])
    return np.concatenate([v, (drag + lift + up) / m - np.array([0.0, GRAVITY, 0.0])])


def test_all_forces_agree_with_an_independent_integrator() -> None:
    model = FREE.with_terms(
        drag_term(SOCCER_DRAG),
        term("wind", wind_x=1.0),
        term("magnus", spin=60.0),
        term("spin_decay", decay_rate=0.9),
        term("buoyancy", fraction=0.8),
    )
    start = np.array([0.0, 1.5, 0.0, 13.0, 4.0, 0.5])
    flight = fly(model, start[:3], start[3:], floor=0.1)
    wanted = extrapolated(_all_forces, start, flight.landing_time, 12)
    np.testing.assert_allclose(flight.landing_position, wanted[:3], atol=2e-9)
    np.testing.assert_allclose(flight.landing_velocity, wanted[3:], atol=2e-8)
    # the same law in fixed steps, as a batch
    path = integrate(model.rates, start[:, None], np.array([flight.landing_time]), 60)
    np.testing.assert_allclose(path.states[-1, :, 0], wanted, atol=1e-6)
    time, there = land_many(model, start[:, None], floor=0.1)
    assert time[0] == pytest.approx(flight.landing_time, abs=1e-6)
    assert there[0, 0] == pytest.approx(wanted[0], abs=1e-5)


def test_flights_of_a_batch_are_independent() -> None:
    drags = np.linspace(0.0, 0.6, 7)
    model = FREE.with_terms(drag_term(drags))
    _, there = land_many(model, ball_state(0.0, 0.4, np.full(7, 6.0), 1.0), floor=JOKKU.radius)
    for drag, x in zip(drags, there[0], strict=True):
        one = fly(
            FREE.with_terms(drag_term(float(drag))),
            (0.0, 0.4, 0.0),
            (6.0, 1.0, 0.0),
            floor=JOKKU.radius,
        )
        assert x == pytest.approx(one.landing_position[0], abs=1e-7)


def test_a_term_acts_only_in_its_phase_with_the_right_state() -> None:
    """Four members: nothing, drag, drag and draught, spin and its decay."""
    column = np.array([[0.47], [0.47]])
    model = FREE.with_terms(
        Term(effect_named("drag"), {"drag_coefficient": column}, slice(1, 3)),
        Term(effect_named("wind"), {"wind_x": np.array([[2.0]])}, slice(2, 3)),
        Term(effect_named("magnus"), {"spin": np.array([[30.0]])}, slice(3, 4)),
        Term(effect_named("spin_decay"), {"decay_rate": np.array([[1.5]])}, slice(3, 4)),
    )
    state = np.tile(np.array([0.0, 1.0, 0.0, 6.0, 2.0, 0.3])[:, None, None], (1, 4, 5))
    together = model.rates(0.2, state)
    alone = (
        FREE,
        FREE.with_terms(drag_term(0.47)),
        FREE.with_terms(drag_term(0.47), term("wind", wind_x=2.0)),
        FREE.with_terms(term("magnus", spin=30.0), term("spin_decay", decay_rate=1.5)),
    )
    for row, single in enumerate(alone):
        np.testing.assert_allclose(together[:, row, 2], single.rates(0.2, state[:, row, 2]))


def test_the_planar_flight_is_the_model_in_observable_parameters() -> None:
    spin, speed = 25.0, np.array([[6.0, 2.0], [3.0, -4.0]])
    model = DRAGGED.with_terms(term("magnus", spin=spin))
    lift = 0.5 * 1.18 * math.pi * 0.25 * 0.20175**2 * 0.5 * 0.20175 * spin / 0.353
    state = ball_state(0.1, 0.9, speed[:, 0], speed[:, 1])
    flat = np.empty((4, 2))
    for ball in range(2):
        flight = np.array([*state[[0, 1, 3, 4], ball], K, lift, GRAVITY])
        rates(flight, flight[:4], flat[:, ball])
    np.testing.assert_allclose(model.rates(0.0, state)[[0, 1, 3, 4]], flat, rtol=1e-12)


def test_planar_flights_agree_with_the_model_forwards_and_backwards() -> None:
    flights = np.array(
        [[0.1, 0.9, 4.0, 1.0, K, 0.0, GRAVITY], [0.0, 2.0, 7.0, 3.0, K, 0.0, GRAVITY]]
    )
    elapsed = np.array([-0.2, -0.07, 0.0, 0.11, 0.4])
    found = flown(flights, elapsed)
    for flight, states in zip(flights, found, strict=True):
        for duration, here in ((-0.2, elapsed <= 0.0), (0.4, elapsed >= 0.0)):
            start = ball_state(*(np.array([one]) for one in flight[:4]))
            path = integrate(DRAGGED.rates, start, np.array([duration]), 80)
            there = path.at(elapsed[None, here])[[0, 1, 3, 4], 0].T
            np.testing.assert_allclose(states[here], there, atol=1e-6)


def test_a_planar_flight_comes_down_when_it_is_at_that_height() -> None:
    flight = np.array([0.0, 1.0, 4.0, 1.0, K, 0.0, GRAVITY])
    after = time_of_fall(flight, 0.2, 2.0)
    state = flown(flight[None], np.array([after]))[0, 0]
    assert state[1] == pytest.approx(0.2, abs=1e-6)
    assert state[3] < 0.0
    assert math.isnan(time_of_fall(flight, 5.0, 2.0))


def test_a_trajectory_is_evaluated_before_and_after_its_start() -> None:
    times = np.array([[0.0, 0.13, 0.3]])
    start = ball_state(0.0, 1.0, 5.0, 1.0)
    ahead = integrate(DRAGGED.rates, start, np.array([0.4]), 40).at(times)[:, 0]
    back = integrate(DRAGGED.rates, ahead[:, 2:], np.array([-0.3]), 30).at(
        np.array([[-0.3, -0.17]])
    )
    np.testing.assert_allclose(back[:, 0], ahead[:, :2], atol=1e-8)
    one = runge_kutta_step(DRAGGED.rates, 0.0, start, 0.01)
    np.testing.assert_allclose(runge_kutta_step(DRAGGED.rates, 0.01, one, -0.01), start, atol=1e-9)


@settings(max_examples=30)
@given(st.floats(0.1, 12.0), st.floats(-1.0, 1.3), st.floats(0.0, 1.0))
def test_drag_takes_energy_and_never_gives_any(speed: float, angle: float, drag: float) -> None:
    moving = (speed * math.cos(angle), speed * math.sin(angle), 0.0)
    flight = fly(FREE.with_terms(drag_term(drag)), (0.0, 1.0, 0.0), moving, floor=0.1)
    energy = 0.5 * np.sum(flight.velocity**2, axis=1) + GRAVITY * flight.position[:, 1]
    assert np.all(np.diff(energy) <= 1e-9)


def test_magnus_does_no_work_vanishes_without_spin_and_lifts_with_back_spin() -> None:
    state = np.array([0.0, 1.0, 0.0, 9.0, 2.0, 0.0])
    weightless = replace(FREE, gravity=0.0)
    push = weightless.with_terms(term("magnus", spin=50.0)).rates(0.0, state)[3:]
    assert push @ state[3:] == pytest.approx(0.0, abs=1e-12)
    assert push[1] > 0.1
    assert not weightless.with_terms(term("magnus", spin=0.0)).rates(0.0, state)[3:].any()


def test_a_flight_that_never_lands_is_an_error() -> None:
    with pytest.raises(DomainError, match="not landed"):
        fly(replace(FREE, gravity=-1.0), (0.0, 1.0, 0.0), (1.0, 1.0, 0.0), longest=2.0)
    with pytest.raises(DomainError, match="not landed"):
        land_many(replace(FREE, gravity=0.0), ball_state(0.0, 1.0, 1.0, 1.0), longest=1.0)
    with pytest.raises(DomainError, match="below the floor"):
        fly(FREE, (0.0, 0.0, 0.0), (1.0, 1.0, 0.0), floor=0.1)
    with pytest.raises(DomainError, match="below the floor"):
        land_many(FREE, ball_state(0.0, 0.0, 1.0, 1.0), floor=0.1)
    with pytest.raises(DomainError, match="finite"):
        fly(FREE, (0.0, 1.0, 0.0), (math.nan, 1.0, 0.0))
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
