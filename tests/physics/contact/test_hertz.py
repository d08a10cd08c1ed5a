"""Bounds of the contact time compared with integration and measurements."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from metrology import DomainError
from physics.contact import MAX_CONTACT_MODULUS, MIN_GAUGE_PRESSURE, contact_time_bound


def integrated(stiffness: float, exponent: float, mass: float, speed: float) -> float:
    """Contact time of m δ'' = −k δⁿ from a fall in, s."""

    def apart(_time: float, state: np.ndarray) -> float:
        return float(state[0])

    apart.terminal = True  # type: ignore[attr-defined]
    apart.direction = -1  # type: ignore[attr-defined]
    unit = (mass * speed**2 / stiffness) ** (1.0 / (exponent + 1.0)) / speed
    found = solve_ivp(
        lambda _, s: [s[1], -stiffness * max(s[0], 0.0) ** exponent / mass],
        (0.0, 20.0 * unit),
        [0.0, speed],
        events=apart,
        rtol=1e-9,
        atol=1e-14,
        max_step=0.02 * unit,
    )
    return float(found.t[-1])


def test_both_ends_satisfy_the_equations_of_motion() -> None:
    ball, face, diameter, speed = 0.353, 5.167, 0.20175, 2.5
    mass = ball * face / (ball + face)
    bound = contact_time_bound(ball, diameter, face, speed)
    solid = 4.0 / 3.0 * MAX_CONTACT_MODULUS * np.sqrt(0.5 * diameter)
    assert bound.shortest == pytest.approx(integrated(solid, 1.5, mass, speed), rel=0.01)
    soft = np.pi * diameter * MIN_GAUGE_PRESSURE
    assert bound.longest == pytest.approx(integrated(soft, 1.0, mass, speed), rel=0.001)


@pytest.mark.parametrize(
    ("mass", "diameter", "measured"),
    [(0.353, 0.20175, 0.0145), (0.605, 0.2459, 0.017), (0.058, 0.066, 0.005), (0.046, 0.043, 5e-4)],
    ids=["jokku", "basketball", "tennis", "golf"],
)
def test_real_balls_are_between_the_limits(mass: float, diameter: float, measured: float) -> None:
    bound = contact_time_bound(mass, diameter, 5.167, 3.0)
    assert bound.shortest < measured < bound.longest
    assert bound.longest < 0.039


def test_no_mass_is_refused() -> None:
    with pytest.raises(DomainError):
        contact_time_bound(0.0, 0.2, 5.0, 2.0)
