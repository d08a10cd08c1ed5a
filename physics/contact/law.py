"""Hunt–Crossley contact between a turning face and a resting ball: the equations of motion.

The ball (centre B, radius R) is pushed by the flat face of a pendulum whose pivot P is fixed. With
the bar at angle φ the unit vector along the bar is a = (sin φ, −cos φ), the face's normal is
n = (cos φ, sin φ), and the face is the plane (r − P)·n = f. Then

    compression      δ  = R + f − (B − P)·n
    lever of force   s  = (B − P)·a
    rate             δ̇  = ω s − v·n
    force            F  = k δⁿ (1 + c δ̇),  never pulling

Hunt and Crossley, J. Appl. Mech. 42, 440 (1975). Everything here takes floats and arrays alike.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physics.arrays import FloatArray, Number
from physics.bodies import Ball, Pendulum, Support
from physics.domain import require_finite, require_non_negative, require_positive

__all__ = [
    "SLIP_SCALE",
    "ContactScene",
    "HuntCrossley",
    "damping_for_cor",
    "elastic_contact_time",
    "stiffness_for_time",
]

SLIP_SCALE = 0.02
"""m/s: slip at which regularised Coulomb friction has reached tanh(1) = 76 % of its full size."""

State = Sequence[Number]


@dataclass(frozen=True)
class HuntCrossley:
    """A contact force F = k δⁿ (1 + c δ̇).

    Attributes
    ----------
    stiffness : float or array
        k, N/mⁿ.
    damping : float or array
        c, s/m; 0 returns all energy.
    exponent : float
        n: 1 linear, 3/2 Hertz.
    friction : float
        Coulomb coefficient between face and ball, along the face.
    """

    stiffness: Number
    damping: Number
    exponent: float
    friction: float = 0.0

    def __post_init__(self) -> None:
        require_positive("the stiffness of the contact", self.stiffness)
        require_finite("the damping of the contact", self.damping)
        require_positive("the exponent of the contact force", self.exponent)
        require_non_negative("the friction of the face", self.friction)

    def force(self, compression: Number, rate: Number) -> Number:
        """Normal force, N, at compression δ (m) and rate δ̇ (m/s); zero where they are apart."""
        pressed = np.maximum(compression, 0.0)
        push: Number = self.stiffness * pressed**self.exponent
        return np.maximum(push * (1.0 + self.damping * rate), 0.0)


@dataclass(frozen=True)
class ContactScene:
    """A pendulum, a ball on its support, and where the pivot must be for them to touch at `angle`.

    World frame: x from the ball's centre at rest, y up from the floor, z towards the camera.

    Attributes
    ----------
    pendulum, ball, support
        The bodies.
    gravity : float
        m/s².
    angle : float or array
        Angle φ of the bar when face and ball first touch, rad past the lowest point.
    """

    pendulum: Pendulum
    ball: Ball
    support: Support
    gravity: float
    angle: Number

    @property
    def rest_height(self) -> float:
        """Height of the ball's centre at rest, m."""
        return self.support.height + self.ball.radius

    @property
    def pivot(self) -> tuple[Number, Number]:
        """x, y of the pivot, m."""
        reach = self.ball.radius + self.pendulum.face_offset
        length = self.pendulum.length
        sine, cosine = np.sin(self.angle), np.cos(self.angle)
        return (
            -(length * sine + reach * cosine),
            self.rest_height + length * cosine - reach * sine,
        )

    def kinematics(self, state: State) -> tuple[Number, Number, Number]:
        """Compression δ (m), its rate δ̇ (m/s) and the lever s (m) in a state of `derivative`."""
        phi, omega, x, y, vx, vy = state[:6]
        sine, cosine = np.sin(phi), np.cos(phi)
        pivot_x, pivot_y = self.pivot
        along = (x - pivot_x) * sine - (y - pivot_y) * cosine
        ahead = (x - pivot_x) * cosine + (y - pivot_y) * sine
        compression = self.ball.radius + self.pendulum.face_offset - ahead
        rate = omega * along - (vx * cosine + vy * sine)
        return compression, rate, along

    def derivative(
        self, state: State, law: HuntCrossley, resting: bool | FloatArray
    ) -> list[Number]:
        """Rates of (φ, ω, x, y, vx, vy, spin).

        Parameters
        ----------
        state : seven floats or arrays
            rad, rad/s, m, m, m/s, m/s, rad/s (spin about z, counter-clockwise positive).
        law : HuntCrossley
        resting : bool or bool array
            Whether the ball sits on its support, which can push but not pull.

        Returns
        -------
        list of seven floats or arrays
        """
        phi, omega, _, _, vx, vy, spin = state
        sine, cosine = np.sin(phi), np.cos(phi)
        compression, rate, lever = self.kinematics(state)
        push = law.force(compression, rate)
        ball, body = self.ball, self.pendulum
        rub: Number = 0.0
        # the face rubs on the flattened patch, nearer to the centre than the radius
        reach = ball.radius - np.maximum(compression, 0.0)
        if law.friction > 0.0:
            slip = vx * sine - vy * cosine + reach * spin + omega * body.face_offset
            rub = -law.friction * push * np.tanh(slip / SLIP_SCALE)
        accel_x = (push * cosine + rub * sine) / ball.mass
        accel_y = (push * sine - rub * cosine) / ball.mass - self.gravity
        torque = reach * rub
        reaction = np.where(resting, np.maximum(-accel_y, 0.0), 0.0)
        if self.support.friction > 0.0:
            drag = (
                -self.support.friction * reaction * np.tanh((vx + ball.radius * spin) / SLIP_SCALE)
            )
            accel_x = accel_x + drag
            torque = torque + ball.radius * ball.mass * drag
        weight = body.mass * self.gravity * body.com * sine
        angular = (-weight - push * lever + rub * body.face_offset) / body.inertia
        spin_rate = torque / (ball.inertia_factor * ball.mass * ball.radius**2)
        return [omega, angular, vx, vy, accel_x, accel_y + reaction, spin_rate]


def elastic_contact_time(exponent: float) -> float:
    """Contact time of an elastic k δⁿ contact in units of (m / (k v^(n−1)))^(1/(n+1)).

    2 ((n+1)/2)^(1/(n+1)) √π Γ(1/(n+1)) / ((n+1) Γ(1/(n+1) + 1/2)); 3.218 for Hertz's n = 3/2.
    """
    share = 1.0 / (exponent + 1.0)
    quarter = math.sqrt(math.pi) * share * math.gamma(share) / math.gamma(share + 0.5)
    return float(2.0 * (0.5 * (exponent + 1.0)) ** share * quarter)


def stiffness_for_time(
    reduced_mass: Number, speed: Number, time: Number, exponent: float
) -> Number:
    """Stiffness k that makes an elastic head-on contact at `speed` (m/s) last `time` (s)."""
    ratio = elastic_contact_time(exponent) / time
    return reduced_mass * ratio ** (exponent + 1.0) * speed ** (1.0 - exponent)


def damping_for_cor(cor: Number) -> Number:
    """The product c v for which a head-on Hunt–Crossley contact at speed v returns `cor`.

    Energy balance of m δ̈ = −k δⁿ (1 + c δ̇): with d = c v, d − ln(1 + d) = −e d − ln(1 − e d),
    whatever the exponent. Solved by bisection on q = −ln(1 − e d); e > 1 (a contact that adds
    energy) follows by reversing time.

    Parameters
    ----------
    cor : float or array
        Above 0.

    Returns
    -------
    float or array
        d, shaped as `cor`.
    """
    e = np.asarray(cor, dtype=np.float64)
    inner = np.minimum(e, 1.0 / e)
    low = np.zeros_like(inner)
    high = np.full_like(inner, 10.0) + 4.0 / inner
    for _ in range(70):
        q = 0.5 * (low + high)
        returned = -np.expm1(-q)
        d = returned / inner
        too_far = d + returned - q - np.log1p(d) < 0.0
        high = np.where(too_far, q, high)
        low = np.where(too_far, low, q)
    d = -np.expm1(-0.5 * (low + high)) / inner
    result: FloatArray = np.where(e > 1.0, -d / e, np.where(e == 1.0, 0.0, d))
    return result if result.ndim else float(result)
