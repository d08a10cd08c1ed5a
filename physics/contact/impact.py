"""The instantaneous impact (Eqs 2 and 7 to 10): impulse and velocities from masses and e."""

from dataclasses import dataclass

from physics.arrays import Number
from physics.domain import require_positive
from physics.restitution.restitution import require_cor

__all__ = [
    "ImpulsiveImpact",
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
