"""The pendulum's swing compared with energy balance and small angles."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from metrology import DomainError
from physics.bodies import GRAVITY, PAPER_PENDULUM
from physics.effects import Term, effect_named
from physics.integrator import crossing, integrate
from physics.swing import (
    SwingModel,
    backswing_for_speed,
    frictionless_speed,
    small_period,
    swing,
    swing_on,
)


def kinetic(speed: float) -> float:
    """½ I ω²."""
    return 0.5 * PAPER_PENDULUM.inertia * (speed / PAPER_PENDULUM.length) ** 2


def potential(angle: float) -> float:
    """Weight times height above the lowest point."""
    body = PAPER_PENDULUM
    return body.mass * GRAVITY * body.com * (1.0 - math.cos(angle))


def losses(dry: float = 0.0, viscous: float = 0.0, drag: float = 0.0) -> tuple[Term, ...]:
    return (
        Term(effect_named("bearing_friction"), {"dry_torque": dry}),
        Term(effect_named("viscous_damping"), {"viscous_coefficient": viscous}),
        Term(effect_named("pendulum_drag"), {"drag_torque": drag}),
    )


@given(st.floats(0.3, math.pi - 0.01), st.floats(0.0, 0.25))
def test_energy_is_conserved_without_friction(backswing: float, contact: float) -> None:
    speed = frictionless_speed(PAPER_PENDULUM, backswing, contact)
    gained = kinetic(speed)
    fallen = potential(backswing) - potential(contact)
    assert gained == pytest.approx(fallen, rel=1e-12)
    assert backswing_for_speed(PAPER_PENDULUM, speed, contact) == pytest.approx(backswing, rel=1e-7)


def test_integrated_swing_agrees_with_the_energy_balance() -> None:
    for degrees in (15.0, 60.0, 120.0, 170.0):
        run = swing(PAPER_PENDULUM, math.radians(degrees), 0.1484)
        wanted = frictionless_speed(PAPER_PENDULUM, math.radians(degrees), 0.1484)
        assert run.speed_at_contact == pytest.approx(wanted, abs=1e-8)


def test_losses_are_the_work_of_the_friction() -> None:
    run = swing(PAPER_PENDULUM, 1.5, 0.15, terms=losses(0.05, 0.02, 0.004), samples=4001)
    # Coulomb, Stokes and Newton written down again; dry friction has its full size all the way
    against = 0.05 + 0.02 * run.omega + 0.004 * run.omega**2
    work = -np.trapezoid(against, run.phi)
    start, end = potential(1.5), potential(0.15)
    assert kinetic(run.speed_at_contact) == pytest.approx(start - end + work, abs=1e-6)


def test_small_swings_take_a_quarter_period_to_the_bottom() -> None:
    run = swing(PAPER_PENDULUM, 0.01, 0.0)
    assert run.time[-1] == pytest.approx(0.25 * small_period(PAPER_PENDULUM), rel=1e-5)


def test_viscous_damping_of_small_swings_is_the_textbook_decay() -> None:
    damping, body = 0.4, PAPER_PENDULUM
    model = SwingModel.of(body, losses(viscous=damping))
    time = np.linspace(0.0, 6.0, 61)
    phi, _ = swing_on(model, 1e-3, 0.0, time)
    rate = 0.5 * damping / body.inertia
    free = 2.0 * math.pi / small_period(body)
    turning = math.sqrt(free**2 - rate**2)
    decay = np.exp(-rate * time)
    wanted = 1e-3 * decay * (np.cos(turning * time) + rate / turning * np.sin(turning * time))
    np.testing.assert_allclose(phi, wanted, atol=1e-9)


def test_a_batch_of_swings_meets_the_ball_as_the_solver_does() -> None:
    backswings = np.radians([30.0, 60.0, 90.0])
    terms = losses(0.3, 0.05, 0.01)
    model = SwingModel.of(PAPER_PENDULUM, terms)
    start = np.array([-backswings, np.zeros(3)])
    path = integrate(model.rates, start, np.full(3, 1.0), 400)
    met = path.at(crossing(path, np.full(3, 0.15))[:, None])[1, :, 0]
    for backswing, omega in zip(backswings, met, strict=True):
        one = swing(PAPER_PENDULUM, float(backswing), 0.15, terms=terms)
        assert omega * PAPER_PENDULUM.length == pytest.approx(one.speed_at_contact, rel=1e-6)


@pytest.mark.parametrize("degrees", [0.0, 5.0, 181.0, 360.0, math.nan])
def test_backswings_without_impact_are_refused(degrees: float) -> None:
    with pytest.raises(DomainError):
        frictionless_speed(PAPER_PENDULUM, math.radians(degrees), math.radians(8.5))


def test_a_stuck_or_exhausted_pendulum_is_an_error() -> None:
    with pytest.raises(DomainError, match="does not move"):
        swing(PAPER_PENDULUM, 0.3, 0.1, terms=losses(dry=20.0))
    with pytest.raises(DomainError, match="stops"):
        swing(PAPER_PENDULUM, 0.5, 0.3, terms=losses(viscous=8.0))
    with pytest.raises(DomainError, match="does not move"):
        swing(PAPER_PENDULUM, math.pi, 0.1)
    with pytest.raises(DomainError, match="from 180 deg"):
        backswing_for_speed(PAPER_PENDULUM, 40.0, 0.1)
