"""The pendulum's swing: energy balance in closed form, and friction and air drag by integration."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from metrology import DomainError
from physics.arrays import FloatArray, FloatOrArray
from physics.bodies import GRAVITY, Pendulum
from physics.domain import require_angle, require_non_negative, require_positive
from physics.flight.events import Event, Path, follow_until

__all__ = [
    "Bearing",
    "SwingPath",
    "backswing_for_speed",
    "frictionless_speed",
    "small_period",
    "swing",
]


def frictionless_speed(
    pendulum: Pendulum,
    backswing: FloatOrArray,
    contact_angle: float,
    gravity: float = GRAVITY,
) -> FloatOrArray:
    """Speed of the contact point where the face meets the ball, without friction or drag.

    ½ I ω² = m g d (cos φ_contact − cos φ_backswing), v = ω L.

    Parameters
    ----------
    pendulum : Pendulum
    backswing : float or array
        Angle of release, rad from the lowest point (its sign does not matter).
    contact_angle : float
        Angle at which face and ball meet, rad.
    gravity : float
        m/s².

    Returns
    -------
    float or array
        m/s, shaped as `backswing`.

    Raises
    ------
    DomainError
        If an angle is beyond 180°, or the backswing is too small to reach the ball.
    """
    require_angle("the back-swing angle", backswing)
    require_angle("the contact angle", contact_angle)
    drop = math.cos(contact_angle) - np.cos(backswing)
    if np.any(drop <= 0.0):
        raise DomainError(
            f"a back-swing of {np.rad2deg(backswing)} deg does not reach a ball that is met"
            f" {math.degrees(contact_angle):.1f} deg past the lowest point",
            hint="Give a larger back-swing angle.",
        )
    scale = 2.0 * pendulum.mass * gravity * pendulum.com / pendulum.inertia
    result: FloatOrArray = pendulum.length * (scale * drop) ** 0.5
    return result


def backswing_for_speed(
    pendulum: Pendulum, speed: float, contact_angle: float, gravity: float = GRAVITY
) -> float:
    """Back-swing angle (rad) that gives the contact point `speed` (m/s), without friction.

    Inverse of `frictionless_speed`.

    Raises
    ------
    DomainError
        If even a back-swing of 180° is too slow.
    """
    require_positive("the impact speed", speed, "m/s")
    scale = 2.0 * pendulum.mass * gravity * pendulum.com / pendulum.inertia
    cosine = math.cos(contact_angle) - (speed / pendulum.length) ** 2 / scale
    if cosine < -1.0:
        fastest = frictionless_speed(pendulum, math.pi, contact_angle, gravity)
        raise DomainError(
            f"this pendulum can't strike at {speed:.3f} m/s:"
            f" from 180 deg it reaches {fastest:.3f} m/s"
        )
    return math.acos(cosine)


def small_period(pendulum: Pendulum, gravity: float = GRAVITY) -> float:
    """Period of small swings 2π √(I / (m g d)), s."""
    return 2.0 * math.pi * math.sqrt(pendulum.inertia / (pendulum.mass * gravity * pendulum.com))


@dataclass(frozen=True)
class Bearing:
    """What slows a swing down.

    Attributes
    ----------
    dry : float
        Coulomb torque of the bearing, N m.
    viscous : float
        Torque per angular velocity, N m s.
    drag : float
        Torque of the air per squared angular velocity, N m s²; for a mass of area A at the length L
        with drag coefficient C it is ½ ρ C A L³.
    """

    dry: float = 0.0
    viscous: float = 0.0
    drag: float = 0.0

    def __post_init__(self) -> None:
        require_non_negative("the dry friction of the bearing", self.dry, "N m")
        require_non_negative("the viscous friction of the bearing", self.viscous, "N m s")
        require_non_negative("the drag of the pendulum", self.drag, "N m s^2")

    def torque(self, omega: FloatOrArray) -> FloatOrArray:
        """Torque against the motion, N m, at angular velocity `omega` (rad/s)."""
        against: FloatOrArray = -(
            self.dry * np.sign(omega) + self.viscous * omega + self.drag * omega * abs(omega)
        )
        return against


@dataclass(frozen=True)
class SwingPath:
    """A swing from release to the ball.

    Attributes
    ----------
    time : (N,) array
        s from release.
    phi, omega : (N,) array
        rad past the lowest point, rad/s.
    speed_at_contact : float
        Speed of the contact point in the last row, m/s.
    """

    time: FloatArray
    phi: FloatArray
    omega: FloatArray
    speed_at_contact: float


def swing(
    pendulum: Pendulum,
    backswing: float,
    contact_angle: float,
    *,
    bearing: Bearing | None = None,
    torque: Callable[[float, float], float] | None = None,
    gravity: float = GRAVITY,
    samples: int = 201,
) -> SwingPath:
    """Let the pendulum go at `backswing` and follow it to the ball.

    I φ̈ = −m g d sin φ − τ_dry sgn φ̇ − b φ̇ − q φ̇|φ̇|.

    Parameters
    ----------
    pendulum : Pendulum
    backswing : float
        Angle of release, rad, counted positive backwards.
    contact_angle : float
        Where it meets the ball, rad past the lowest point.
    bearing : Bearing, optional
        Losses.
    torque : callable, optional
        Any further torque, N m, from φ (rad) and its rate (rad/s).
    gravity : float
        m/s².
    samples : int
        Rows of the result.

    Returns
    -------
    SwingPath

    Raises
    ------
    DomainError
        If it never reaches the ball: too small an angle, too much friction, or balanced at 180°.
    """
    frictionless_speed(pendulum, backswing, contact_angle, gravity)
    weight = pendulum.mass * gravity * pendulum.com
    losses = Bearing() if bearing is None else bearing
    start = -abs(backswing)
    if weight * math.sin(abs(backswing)) <= losses.dry or math.pi - abs(backswing) < 1e-9:
        raise DomainError(
            f"a pendulum let go at {math.degrees(backswing):.2f} deg stays where it is",
            hint="Friction holds it, or it stands upright on its pivot.",
        )

    path = _approach(pendulum, start, contact_angle, losses, torque, gravity)
    time = np.linspace(0.0, path.end, samples)
    states = path.at(time)
    return SwingPath(time, states[0], states[1], float(path.state[1]) * pendulum.length)


def _approach(
    pendulum: Pendulum,
    start: float,
    contact_angle: float,
    losses: Bearing,
    torque: Callable[[float, float], float] | None,
    gravity: float,
) -> Path:
    weight = pendulum.mass * gravity * pendulum.com

    def rates(_: float, state: FloatArray) -> list[float]:
        phi, omega = float(state[0]), float(state[1])
        # until it moves, friction acts against the coming motion
        loss = losses.torque(omega) if omega > 0.0 else -losses.dry
        if torque is not None:
            loss += torque(phi, omega)
        return [omega, (-weight * math.sin(phi) + loss) / pendulum.inertia]

    def arrives(_: float, state: FloatArray) -> float:
        return float(state[0]) - contact_angle

    def stops(time: float, state: FloatArray) -> float:
        return float(state[1]) if time > 1e-6 else 1.0

    path = follow_until(
        rates,
        np.array([start, 0.0]),
        (0.0, 40.0 * small_period(pendulum, gravity)),
        [Event(arrives), Event(stops, -1.0)],
        method="DOP853",
        relative=1e-10,
        absolute=1e-12,
    )
    if path.ended_by != 0:
        raise DomainError(
            f"let go at {math.degrees(-start):.1f} deg, the pendulum stops before the ball",
            hint="The back-swing is too small for the friction given.",
        )
    return path
