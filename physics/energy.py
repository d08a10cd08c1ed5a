"""Energies of the pendulum and the loss in the impact (Eqs 18 to 23, exact and as printed)."""

from physics.arrays import Number
from physics.bodies import Pendulum

__all__ = [
    "kinetic_energy",
    "lost_by_pendulum",
    "lost_by_pendulum_approximate",
]


def kinetic_energy(pendulum: Pendulum, speed: Number) -> Number:
    """½ I (v/L)², J, for the contact point's speed v in m/s."""
    return 0.5 * pendulum.inertia * (speed / pendulum.length) ** 2


def lost_by_pendulum(pendulum: Pendulum, before: Number, after: Number) -> Number:
    """½ I (ω₁² − ω₂²), J: what the pendulum gives away, to the ball and to deformation (Eq. 19)."""
    return kinetic_energy(pendulum, before) - kinetic_energy(pendulum, after)


def lost_by_pendulum_approximate(pendulum: Pendulum, before: Number, impulse: Number) -> Number:
    """Eqs 20, 21 with the dimensions put right: v_M⁰ F̃, J. Too large by 1/(1 − F̃/(2 M v))."""
    return before * impulse
