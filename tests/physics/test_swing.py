import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from metrology import DomainError
from physics.bodies import PAPER_PENDULUM
from physics.energy import kinetic_energy, potential_energy
from physics.swing import Bearing, backswing_for_speed, frictionless_speed, small_period, swing


@given(st.floats(0.3, math.pi - 0.01), st.floats(0.0, 0.25))
def test_energy_is_conserved_without_friction(backswing: float, contact: float) -> None:
    speed = frictionless_speed(PAPER_PENDULUM, backswing, contact)
    gained = kinetic_energy(PAPER_PENDULUM, speed)
    fallen = potential_energy(PAPER_PENDULUM, backswing) - potential_energy(PAPER_PENDULUM, contact)
    assert gained == pytest.approx(fallen, rel=1e-12)
    assert backswing_for_speed(PAPER_PENDULUM, speed, contact) == pytest.approx(backswing, rel=1e-7)


def test_integrated_swing_agrees_with_the_energy_balance() -> None:
    for degrees in (15.0, 60.0, 120.0, 170.0):
        run = swing(PAPER_PENDULUM, math.radians(degrees), 0.1484)
        wanted = frictionless_speed(PAPER_PENDULUM, math.radians(degrees), 0.1484)
        assert run.speed_at_contact == pytest.approx(wanted, abs=1e-8)


def test_losses_are_the_work_of_the_friction() -> None:
    bearing = Bearing(dry=0.05, viscous=0.02, drag=0.004)
    run = swing(PAPER_PENDULUM, 1.5, 0.15, bearing=bearing, samples=4001)
    work = np.trapezoid(np.asarray(bearing.torque(run.omega)), run.phi)
    start, end = potential_energy(PAPER_PENDULUM, 1.5), potential_energy(PAPER_PENDULUM, 0.15)
    assert kinetic_energy(PAPER_PENDULUM, run.speed_at_contact) == pytest.approx(
        start - end + work, abs=1e-6
    )


def test_small_swings_take_a_quarter_period_to_the_bottom() -> None:
    run = swing(PAPER_PENDULUM, 0.01, 0.0)
    assert run.time[-1] == pytest.approx(0.25 * small_period(PAPER_PENDULUM), rel=1e-5)


def test_a_torque_of_ones_own_acts_like_the_bearing() -> None:
    by_bearing = swing(PAPER_PENDULUM, 1.2, 0.15, bearing=Bearing(viscous=0.03))
    by_torque = swing(PAPER_PENDULUM, 1.2, 0.15, torque=lambda _, omega: -0.03 * omega)
    assert by_torque.speed_at_contact == pytest.approx(by_bearing.speed_at_contact, rel=1e-12)


@pytest.mark.parametrize("degrees", [0.0, 5.0, 181.0, 360.0, math.nan])
def test_backswings_that_reach_nothing_are_refused(degrees: float) -> None:
    with pytest.raises(DomainError):
        frictionless_speed(PAPER_PENDULUM, math.radians(degrees), math.radians(8.5))


def test_a_stuck_or_exhausted_pendulum_is_an_error() -> None:
    with pytest.raises(DomainError, match="stays"):
        swing(PAPER_PENDULUM, 0.3, 0.1, bearing=Bearing(dry=20.0))
    with pytest.raises(DomainError, match="stops"):
        swing(PAPER_PENDULUM, 0.5, 0.3, bearing=Bearing(viscous=8.0))
    with pytest.raises(DomainError, match="stays"):
        swing(PAPER_PENDULUM, math.pi, 0.1)
    with pytest.raises(DomainError, match="from 180 deg"):
        backswing_for_speed(PAPER_PENDULUM, 40.0, 0.1)
