"""The instantaneous impact of Eqs 2, 9 and 10."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from metrology import DomainError
from physics.bodies import PAPER_PENDULUM, Pendulum, lost_by_pendulum, lost_by_pendulum_approximate
from physics.contact import (
    cor_from_ball_speed,
    external_impulse,
    impact,
)

masses = st.floats(0.05, 20.0)
cors = st.floats(0.05, 1.0)
speeds = st.floats(0.05, 20.0)


@given(masses, masses, cors, speeds)
def test_momentum_is_conserved_and_restitution_obeyed(
    heavy: float, light: float, e: float, v: float
) -> None:
    after = impact(heavy, light, e, v)
    assert heavy * after.speed_after + light * after.ball_speed == pytest.approx(heavy * v)
    assert after.ball_speed - after.speed_after == pytest.approx(e * v)
    assert cor_from_ball_speed(heavy, light, v, after.ball_speed) == pytest.approx(e)


@given(cors, speeds)
def test_the_energy_of_the_pendulum_goes_to_ball_and_deformation(e: float, v: float) -> None:
    # the balance closes only for the effective mass that the equation of motion implies
    heavy, light = PAPER_PENDULUM.inertial_mass, 0.353
    after = impact(heavy, light, e, v)
    lost = lost_by_pendulum(PAPER_PENDULUM, v, after.speed_after)
    gained = 0.5 * light * after.ball_speed**2
    # what two free bodies lose in an impact: half the reduced mass times (1 - e^2) v^2
    reduced = heavy * light / (heavy + light)
    assert lost == pytest.approx(gained + 0.5 * reduced * (1.0 - e**2) * v**2, rel=1e-12)


def test_the_approximation_of_ryu_et_al_is_6_to_11_percent_too_large() -> None:
    pendulum = Pendulum(0.5541, 5.1667 * 0.5541**2, 6.0, 0.4553)
    for mass, e, excess in ((0.353, 0.72, 0.06), (0.605, 0.88, 0.11)):
        after = impact(5.1667, mass, e, 3.0)
        exact = lost_by_pendulum(pendulum, 3.0, after.speed_after)
        rough = lost_by_pendulum_approximate(pendulum, 3.0, after.impulse)
        assert rough / exact - 1.0 == pytest.approx(excess, abs=0.006)


def test_two_readings_of_the_effective_mass() -> None:
    assert PAPER_PENDULUM.mass_at_contact == 5.1667
    assert PAPER_PENDULUM.inertial_mass == pytest.approx(5.143, abs=5e-4)
    assert Pendulum(0.5541, 1.579, 6.0, 0.4553).mass_at_contact == PAPER_PENDULUM.inertial_mass


@pytest.mark.parametrize(
    ("heavy", "light", "e", "v"),
    [(-5.0, 0.4, 0.8, 3.0), (5.0, 0.0, 0.8, 3.0), (5.0, 0.4, 1.2, 3.0), (5.0, 0.4, 0.8, -1.0)],
)
def test_bad_input(heavy: float, light: float, e: float, v: float) -> None:
    with pytest.raises(DomainError):
        impact(heavy, light, e, v)


def test_arrays_are_accepted() -> None:
    values = external_impulse(5.0, 0.4, np.array([0.7, 0.8]), np.array([1.0, 2.0]))
    assert np.asarray(values).shape == (2,)
