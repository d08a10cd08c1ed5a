"""The instantaneous impact (Eqs 2 and 7 to 10): impulse and velocities from masses and e.

Which contact times are possible: between two elastic bodies at their stiffest and their softest.

The stiffest is a solid steel sphere (Hertz; Johnson, Contact Mechanics, 1985, §11.4)

    Δt = 2.87 (m*² / (R E*² v))^(1/5),

the softest an inflated shell, pressed flat over the disc that the face cuts off. It pushes back
with its gauge pressure times that disc, π D δ for small δ: a spring of stiffness k = π D p, so that

    Δt = π √(m* / k),    1 / m* = 1 / m_ball + 1 / m_face.
"""

import math
from dataclasses import dataclass

from physics.domain import Number, require_positive
from physics.restitution.restitution import require_cor

__all__ = [
    "LOWEST_PRESSURE",
    "STIFFEST_MODULUS",
    "ImpulsiveImpact",
    "contact_time_bound",
    "cor_from_ball_speed",
    "external_impulse",
    "impact",
]


@dataclass(frozen=True)
class ImpulsiveImpact:
    """Both sides of an impact along the contact normal; floats or arrays.

    Attributes
    ----------
    speed_before : float or array
        Pendulum at the contact point, v_M⁰, m/s.
    cor : float or array
    impulse : float or array
        On the ball, N s (Eq. 9).
    ball_speed : float or array
        v_B, m/s (Eq. 10).
    speed_after : float or array
        v_M, m/s (Eq. 8).
    """

    speed_before: Number
    cor: Number
    impulse: Number
    ball_speed: Number
    speed_after: Number

    @property
    def mean_speed(self) -> Number:
        """v_M^avg = (v_M⁰ + v_M) / 2, m/s: the face during contact, as Eq. 13 has it."""
        return 0.5 * (self.speed_before + self.speed_after)


def external_impulse(
    effective_mass: Number, ball_mass: Number, cor: Number, speed: Number
) -> Number:
    """Eq. 9: M m (1 + e) v / (M + m), N s, for masses in kg and a speed in m/s."""
    return effective_mass * ball_mass * (1.0 + cor) * speed / (effective_mass + ball_mass)


def impact(
    effective_mass: Number, ball_mass: Number, cor: Number, speed: Number
) -> ImpulsiveImpact:
    """Impulse and velocities of an instantaneous impact on a ball at rest (Eqs 7 to 10).

    Parameters
    ----------
    effective_mass, ball_mass : float or array
        kg.
    cor : float or array
        In (0, 1].
    speed : float or array
        Of the pendulum's contact point before, m/s.

    Returns
    -------
    ImpulsiveImpact

    Raises
    ------
    DomainError
        For masses or speeds that are not positive, or e outside (0, 1].
    """
    require_positive("the effective mass", effective_mass, "kg")
    require_positive("the ball's mass", ball_mass, "kg")
    require_positive("the impact speed", speed, "m/s")
    require_cor(cor)
    impulse = external_impulse(effective_mass, ball_mass, cor, speed)
    return ImpulsiveImpact(
        speed, cor, impulse, impulse / ball_mass, speed - impulse / effective_mass
    )


def cor_from_ball_speed(
    effective_mass: Number, ball_mass: Number, before: Number, ball: Number
) -> Number:
    """Eq. 10 solved for e from the ball's speed after and the pendulum's before, m/s."""
    require_positive("the impact speed", before, "m/s")
    return ball * (effective_mass + ball_mass) / (effective_mass * before) - 1.0


LOWEST_PRESSURE = 8.0e3

"""Pa above the air's: a soft play ball; a volleyball has 30 kPa, a basketball 55 kPa, a football 60
to 110 kPa (rules of FIVB, FIBA and IFAB)."""

STIFFEST_MODULUS = 1.15e11

"""Pa: E* = E / 2(1 − ν²) of steel on steel, since nothing that is thrown is stiffer; E = 210 GPa, ν
= 0.3."""

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
