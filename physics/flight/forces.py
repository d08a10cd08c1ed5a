"""Accelerations of a ball in the air: one small object per force, all with one signature.

Each takes time (s), position (m), velocity (m/s) and spin (rad/s) as components of floats or arrays
and returns the components of an acceleration (m/s²), so that a model is a sequence of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from physics.arrays import Number, Vector
from physics.bodies import GRAVITY, Ball
from physics.domain import require_non_negative
from physics.flight.air import Air

__all__ = [
    "Acceleration",
    "CoefficientCurve",
    "Drag",
    "Gravity",
    "LiftCurve",
    "Magnus",
    "SpinDecay",
    "SpinRate",
    "total_acceleration",
]


class Acceleration(Protocol):
    """A force per mass."""

    def __call__(self, time: Number, position: Vector, velocity: Vector, spin: Vector) -> Vector:
        """Acceleration, m/s², of floats or arrays as the arguments are."""
        ...


class SpinRate(Protocol):
    """A torque per moment of inertia."""

    def __call__(self, time: Number, position: Vector, velocity: Vector, spin: Vector) -> Vector:
        """Rate of the spin, rad/s²."""
        ...


class CoefficientCurve(Protocol):
    """Drag coefficient by Reynolds number."""

    def __call__(self, reynolds: Number) -> Number:
        """C_D at `reynolds`, float or array."""
        ...


class LiftCurve(Protocol):
    """Lift coefficient by spin parameter and Reynolds number."""

    def __call__(self, spin_parameter: Number, reynolds: Number) -> Number:
        """C_L, float or array."""
        ...


@dataclass(frozen=True)
class Gravity:
    """Uniform weight, downwards.

    Attributes
    ----------
    strength : float
        m/s².
    """

    strength: float = GRAVITY

    def __call__(self, time: Number, position: Vector, velocity: Vector, spin: Vector) -> Vector:
        """(0, −g, 0)."""
        return 0.0, -self.strength, 0.0


def _relative(velocity: Vector, wind: Vector) -> tuple[Number, Number, Number, Number]:
    x, y, z = velocity[0] - wind[0], velocity[1] - wind[1], velocity[2] - wind[2]
    return x, y, z, (x * x + y * y + z * z) ** 0.5


@dataclass(frozen=True)
class Drag:
    """Quadratic drag −½ ρ S C_D |u| u / m with u the velocity relative to the air (Eqs 3, 4).

    Attributes
    ----------
    ball : Ball
    air : Air
    coefficient : float, array or CoefficientCurve
        C_D, or a curve C_D(Re).
    wind : (3,) tuple
        Velocity of the air, m/s.
    """

    ball: Ball
    air: Air
    coefficient: Number | CoefficientCurve
    wind: Vector = (0.0, 0.0, 0.0)

    def __call__(self, time: Number, position: Vector, velocity: Vector, spin: Vector) -> Vector:
        """Acceleration against the motion through the air."""
        x, y, z, speed = _relative(velocity, self.wind)
        coefficient = self.coefficient
        if callable(coefficient):
            scale = self.air.density * self.ball.diameter / self.air.viscosity
            coefficient = coefficient(scale * speed)
        share = -0.5 * self.air.density * self.ball.area / self.ball.mass * coefficient * speed
        return share * x, share * y, share * z


@dataclass(frozen=True)
class Magnus:
    """Magnus force ½ ρ S C_L |u|² along spin × u (Eqs 5, 6).

    Attributes
    ----------
    ball : Ball
    air : Air
    slope : float, array or LiftCurve
        C_L per spin parameter (C_L = slope · Sp, so that the force is ½ ρ S slope R spin × u), or a
        curve C_L(Sp, Re).
    wind : (3,) tuple
        Velocity of the air, m/s.
    """

    ball: Ball
    air: Air
    slope: Number | LiftCurve = 1.0
    wind: Vector = (0.0, 0.0, 0.0)

    def __call__(self, time: Number, position: Vector, velocity: Vector, spin: Vector) -> Vector:
        """Acceleration along spin × velocity; zero without spin."""
        x, y, z, speed = _relative(velocity, self.wind)
        sx, sy, sz = spin
        cross = (sy * z - sz * y, sz * x - sx * z, sx * y - sy * x)
        slope = self.slope
        share = 0.5 * self.air.density * self.ball.area / self.ball.mass * self.ball.radius
        if callable(slope):
            turning = (sx * sx + sy * sy + sz * sz) ** 0.5
            # at rest or without spin the force vanishes, whatever the curve says
            parameter = self.ball.radius * turning / (speed + 1e-12)
            scale = self.air.density * self.ball.diameter / self.air.viscosity
            slope = slope(parameter, scale * speed) / (parameter + 1e-12)
        factor = share * slope
        return factor * cross[0], factor * cross[1], factor * cross[2]


@dataclass(frozen=True)
class SpinDecay:
    """Spin slowed by the air: torque ρ S R² C_T |u| ω against the spin.

    A torque in proportion to spin and speed, as found for golf balls by Tavares, Shannon and Melvin
    in "Golf ball spin decay model based on radar measurements" (1998). The coefficient of 0.009 is
    the one usually quoted from there; neither it nor a value for inflated balls could be confirmed.

    Attributes
    ----------
    ball : Ball
    air : Air
    torque_coefficient : float
        C_T.
    wind : (3,) tuple
        Velocity of the air, m/s.
    """

    ball: Ball
    air: Air
    torque_coefficient: float = 0.009
    wind: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        require_non_negative("the torque coefficient", self.torque_coefficient)

    def __call__(self, time: Number, position: Vector, velocity: Vector, spin: Vector) -> Vector:
        """Rate of the spin, rad/s²."""
        _, _, _, speed = _relative(velocity, self.wind)
        ball = self.ball
        inertia = ball.inertia_factor * ball.mass * ball.radius**2
        torque = self.air.density * ball.area * ball.radius**2 * self.torque_coefficient
        rate = -torque / inertia * speed
        return rate * spin[0], rate * spin[1], rate * spin[2]


def total_acceleration(
    forces: Sequence[Acceleration], time: Number, position: Vector, velocity: Vector, spin: Vector
) -> Vector:
    """Sum of all accelerations, m/s²."""
    x: Number = 0.0
    y: Number = 0.0
    z: Number = 0.0
    for force in forces:
        ax, ay, az = force(time, position, velocity, spin)
        x, y, z = x + ax, y + ay, z + az
    return x, y, z
