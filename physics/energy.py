"""Energies of the pendulum and the loss in the impact (Eqs 18 to 23, exact and as printed)."""

import numpy as np

from physics.arrays import Number
from physics.bodies import GRAVITY, Pendulum
from physics.contact.impact import impact
from physics.domain import require_positive
from physics.restitution.inversion import RangeInputs, impact_speed_from_range

__all__ = [
    "deformation_loss",
    "kinetic_energy",
    "lost_by_pendulum",
    "lost_by_pendulum_approximate",
    "lost_by_pendulum_as_printed",
    "lost_by_range",
    "potential_energy",
    "swing_loss",
]


def potential_energy(pendulum: Pendulum, angle: Number, gravity: float = GRAVITY) -> Number:
    """M g d (1 − cos φ), J above the lowest point; φ in rad."""
    weight = pendulum.mass * gravity * pendulum.com
    height: Number = 1.0 - np.cos(angle)
    return weight * height


def kinetic_energy(pendulum: Pendulum, speed: Number) -> Number:
    """½ I (v/L)², J, for the contact point's speed v in m/s."""
    return 0.5 * pendulum.inertia * (speed / pendulum.length) ** 2


def swing_loss(
    pendulum: Pendulum, backswing: Number, forward_swing: Number, gravity: float = GRAVITY
) -> Number:
    """Energy lost between release and the highest point after the impact, J.

    Eq. 18 with the weight where it acts: m g d (cos φ₂ − cos φ₁); angles in rad.
    """
    return potential_energy(pendulum, backswing, gravity) - potential_energy(
        pendulum, forward_swing, gravity
    )


def lost_by_pendulum(pendulum: Pendulum, before: Number, after: Number) -> Number:
    """½ I (ω₁² − ω₂²), J: what the pendulum gives away, to the ball and to deformation (Eq. 19)."""
    return kinetic_energy(pendulum, before) - kinetic_energy(pendulum, after)


def lost_by_pendulum_approximate(pendulum: Pendulum, before: Number, impulse: Number) -> Number:
    """Eqs 20, 21 with the dimensions put right: v_M⁰ F̃, J. Too large by 1/(1 − F̃/(2 M v))."""
    return before * impulse


def lost_by_range(pendulum: Pendulum, inputs: RangeInputs, cor: Number) -> Number:
    """Eq. 23 with its exponent and dimensions put right: what the pendulum lost, J, from the range.

    The impact speed follows from distance and e by Eq. 22, the loss from Eqs 8, 9 and 19. Eq. 23 as
    printed adds a length to a pure number in its exponent and can't be evaluated.
    """
    speed = impact_speed_from_range(inputs, cor)
    after = impact(inputs.effective_mass, inputs.ball_mass, cor, speed)
    return lost_by_pendulum(pendulum, speed, after.speed_after)


def lost_by_pendulum_as_printed(pendulum: Pendulum, before: Number, impulse: Number) -> Number:
    """Eqs 20, 21 letter by letter: v_M⁰ F̃ / L². Its unit is J/m²; only for the audit."""
    return before * impulse / pendulum.length**2


def deformation_loss(
    effective_mass: Number, ball_mass: Number, cor: Number, speed: Number
) -> Number:
    """½ μ (1 − e²) v², J: what neither body has after the impact; μ the reduced mass."""
    require_positive("the effective mass", effective_mass, "kg")
    require_positive("the ball's mass", ball_mass, "kg")
    reduced = effective_mass * ball_mass / (effective_mass + ball_mass)
    return 0.5 * reduced * (1.0 - cor**2) * speed**2
