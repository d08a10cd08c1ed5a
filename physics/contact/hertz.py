"""Which contact times are possible: between two elastic bodies at their stiffest and their softest.

The stiffest is a solid steel sphere (Hertz; Johnson, Contact Mechanics, 1985, §11.4)

    Δt = 2.87 (m*² / (R E*² v))^(1/5),

the softest an inflated shell, pressed flat over the disc that the face cuts off. It pushes back
with its gauge pressure times that disc, π D δ for small δ: a spring of stiffness k = π D p, so that

    Δt = π √(m* / k),    1 / m* = 1 / m_ball + 1 / m_face.
"""

import math
from dataclasses import dataclass

from physics.domain import require_positive

__all__ = ["LOWEST_PRESSURE", "STIFFEST_MODULUS", "ContactTimeBound", "contact_time_bound"]

LOWEST_PRESSURE = 8.0e3
"""Pa above the air's: a soft play ball; a volleyball has 30 kPa, a basketball 55 kPa, a football 60
to 110 kPa (rules of FIVB, FIBA and IFAB)."""
STIFFEST_MODULUS = 1.15e11
"""Pa: E* = E / 2(1 − ν²) of steel on steel, E = 210 GPa, ν = 0.3."""
_HERTZ = 2.87
"""1: Johnson 1985, Eq. 11.24."""


@dataclass(frozen=True)
class ContactTimeBound:
    """Contact times that a ball can have.

    Attributes
    ----------
    shortest, longest : float
        s.
    """

    shortest: float
    longest: float


def contact_time_bound(
    ball_mass: float, diameter: float, face_mass: float, speed: float
) -> ContactTimeBound:
    """Bound the contact time of a ball by what bodies can be made of.

    Parameters
    ----------
    ball_mass, diameter : float
        Of the ball, kg and m.
    face_mass : float
        Effective mass of what strikes it, kg.
    speed : float
        At which they meet, m/s.

    Returns
    -------
    ContactTimeBound

    Raises
    ------
    DomainError
        If one of them is not positive.
    """
    require_positive("a ball's mass", ball_mass, "kg")
    require_positive("a ball's diameter", diameter, "m")
    require_positive("an effective mass", face_mass, "kg")
    require_positive("a speed of approach", speed, "m/s")
    mass = ball_mass * face_mass / (ball_mass + face_mass)
    solid = _HERTZ * (mass**2 / (0.5 * diameter * STIFFEST_MODULUS**2 * speed)) ** 0.2
    shell = math.pi * math.sqrt(mass / (math.pi * diameter * LOWEST_PRESSURE))
    return ContactTimeBound(solid, shell)
