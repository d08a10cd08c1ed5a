"""Pendulum swing: energy balance, and integration with friction and drag."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from metrology import DomainError
from physics.bodies import GRAVITY, Pendulum
from physics.domain import FloatArray, FloatOrArray, Number, require_angle, require_positive
from physics.effects.base import Coordinate, SwingState, Term, rows_of
from physics.integrator import SolvedPath, ZeroCrossing, follow_until

__all__ = [
    "SwingModel",
    "SwingPath",
    "backswing_for_speed",
    "frictionless_speed",
    "small_period",
    "swing",
    "swing_on",
]

INITIAL_RATE = 0.1
"""Rate at which a swing may begin, rad/s (chosen): five times the rate below which dry friction is
smoothed, a fiftieth of a strike's."""


def frictionless_speed(
    pendulum: Pendulum,
    backswing: FloatOrArray,
    contact_angle: float,
    gravity: float = GRAVITY,
) -> FloatOrArray:
    """Speed of the contact point where it meets the ball, without friction or drag.

    ½ I ω² = m g d (cos φ_contact − cos φ_backswing), v = ω L.

    Parameters
    ----------
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
class SwingModel:
    """The equation of motion of a free pendulum: I φ̈ = −m g d sin φ + torques of the catalogue.

    It is used by all solvers of the swing, single or batch.

    Attributes
    ----------
    length, inertia, mass, com : Number
        m, kg m² about the pivot, kg, m from the pivot.
    gravity : Number
        m/s².
    terms : sequence of Term
        Effects with a torque; others are ignored.
    stiffer : Number
        Factor on m g d, for a pendulum whose natural frequency differs from trial to trial.
    order : Number
        As in `SwingState`.
    step : Number
        Of the solver, s; 0 where it resolves turning points.
    losses : Number
        Factor on torques that depend on the rate, for a bearing with varying losses.
    """

    length: Number
    inertia: Number
    mass: Number
    com: Number
    gravity: Number
    terms: Sequence[Term] = ()
    stiffer: Number = 1.0
    order: Number = 0.0
    step: Number = 0.0
    losses: Number = 1.0

    @classmethod
    def of(
        cls, body: Pendulum, terms: Sequence[Term] = (), gravity: float = GRAVITY
    ) -> "SwingModel":
        """The free swing of a pendulum."""
        return cls(body.length, body.inertia, body.mass, body.com, gravity, terms)

    def torque(self, phi: Number, omega: Number) -> Number:
        """Torque of the effects, N m, at an angle (rad) and a rate (rad/s)."""
        return sum(
            (t.effect.torque(t.values, self._seen(b, phi, omega)) for t, b in self._braking),
            np.zeros_like(np.asarray(omega, dtype=np.float64)),
        )

    def rates(self, time: Number, state: FloatArray) -> FloatArray:
        """Rates of (φ, ω), rad/s and rad/s².

        Parameters
        ----------
        time : Number
            Not used; solvers pass it.
        state : (2, ...) array
            rad past the lowest point, rad/s.

        Returns
        -------
        (2, ...) array
        """
        slope = np.empty_like(state)
        slope[0] = state[1]
        slope[1] = self._restoring * np.sin(state[0])
        gained, losses = slope[1] * self.step, np.asarray(self.losses)
        for term, body in self._braking:
            at = term.where
            now = self._seen(body, state[0][at], state[1][at], gained[at])
            gain = term.effect.torque(term.values, now) / now.inertia
            if term.effect.coordinate is Coordinate.RATE:
                gain = gain * (losses[at] if losses.ndim > 1 else losses)
            slope[(1, at)] += gain
        return slope

    @cached_property
    def _braking(self) -> tuple[tuple[Term, tuple[Number, ...]], ...]:
        """Terms with a torque, each with inertia, mass, centre and length in its members."""
        body = (self.inertia, self.mass, self.com, self.length)
        return tuple(
            (term, tuple(rows_of(one, term.where) for one in body))
            for term in self.terms
            if term.brakes
        )

    @cached_property
    def _restoring(self) -> Number:
        """Angular acceleration by the weight over the sine of the angle, 1/s²."""
        return -(self.mass * self.gravity * self.com / self.inertia * self.stiffer)

    def _seen(
        self, body: Sequence[Number], phi: Number, omega: Number, gained: Number = 0.0
    ) -> SwingState:
        inertia, mass, com, length = body
        return SwingState(phi, omega, inertia, mass, com, length, self.gravity, self.order, gained)


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
    terms: Sequence[Term] = (),
    gravity: float = GRAVITY,
    samples: int = 201,
) -> SwingPath:
    """Simulate the pendulum from release at `backswing` to the ball.

    Parameters
    ----------
    backswing : float
        Angle of release, rad, counted positive backwards.
    contact_angle : float
        Angle at which it meets the ball, rad past the lowest point.
    terms : sequence of Term
        Effects of the catalogue with a torque.
    gravity : float
        m/s².
    samples : int
        Rows of the result.

    Raises
    ------
    DomainError
        If it does not reach the ball: too small an angle, too much friction, or balanced at 180°.
    """
    frictionless_speed(pendulum, backswing, contact_angle, gravity)
    model = SwingModel.of(pendulum, terms, gravity)
    start = -abs(backswing)
    weight = pendulum.mass * gravity * pendulum.com
    # At this rate dry friction has its full size, and other losses are negligible.
    holds = -float(model.torque(start, INITIAL_RATE))
    if weight * math.sin(abs(backswing)) <= holds or math.pi - abs(backswing) < 1e-9:
        raise DomainError(
            f"a pendulum released at {math.degrees(backswing):.2f} deg does not move",
            hint="Friction holds it, or it is upright above its pivot.",
        )
    path = _approach(model, start, contact_angle, 40.0 * small_period(pendulum, gravity))
    time = np.linspace(0.0, path.end, samples)
    states = path.at(time)
    states[:, -1] = path.state
    return SwingPath(time, states[0], states[1], float(path.state[1]) * pendulum.length)


def swing_on(model: SwingModel, phi: float, omega: float, time: FloatArray) -> FloatArray:
    """Angle and rate (2, N) at increasing times (s) of a free swing from a given state.

    Parameters
    ----------
    phi, omega : float
        At time 0, rad and rad/s.
    time : (N,) array
        s.
    """
    path = follow_until(
        model.rates,
        np.array([phi, omega]),
        (0.0, float(time[-1])),
        [],
        method="DOP853",
        relative=1e-9,
        absolute=1e-11,
        max_step=0.05,
    )
    return np.asarray(path.at(time))


def _approach(model: SwingModel, start: float, contact_angle: float, longest: float) -> SolvedPath:
    def arrives(_: float, state: FloatArray) -> float:
        return float(state[0]) - contact_angle

    def stops(time: float, state: FloatArray) -> float:
        return float(state[1]) if time > 1e-6 else 1.0

    path = follow_until(
        model.rates,
        np.array([start, 0.0]),
        (0.0, longest),
        [ZeroCrossing(arrives), ZeroCrossing(stops, -1.0)],
        method="DOP853",
        relative=1e-10,
        absolute=1e-12,
    )
    if path.ended_by != 0:
        raise DomainError(
            f"released at {math.degrees(-start):.1f} deg, the pendulum stops before the ball",
            hint="Increase the back-swing or reduce the friction.",
        )
    return path
