"""Contact of pendulum and ball: resolved in time, or instantaneous.

**Resolved contact** (Hunt and Crossley, J. Appl. Mech. 42, 440, 1975). The ball (centre B, radius
R) is pushed by the flat face of a pendulum with a fixed pivot P. With the bar at angle φ, a unit
vector along the bar a = (sin φ, −cos φ) and the face's normal n = (cos φ, sin φ), the face is the
plane (r − P)·n = f. Then

    compression      δ  = R + f − (B − P)·n
    lever of force   s  = (B − P)·a
    rate             δ̇  = ω s − v·n
    force            F  = k δⁿ (1 + c δ̇),  never pulling

One contact is solved by a stiff solver with events, many at once by fixed Runge–Kutta steps over
arrays, calibrated to e(v) and Δt(v).

**Instantaneous impact** (Eqs 2 and 7 to 10): impulse and velocities from masses and e.

**Bounds of the contact time**, between the stiffest and the softest elastic bodies. The stiffest is
a solid steel sphere (Hertz; Johnson, Contact Mechanics, 1985, §11.4)

    Δt = 2.87 (m*² / (R E*² v))^(1/5),

the softest an inflated shell, flattened over the disc that the face cuts off. Its force is the
gauge pressure times that disc, π D δ for small δ, a spring of stiffness k = π D p, so that

    Δt = π √(m* / k),    1 / m* = 1 / m_ball + 1 / m_face.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Self

import numpy as np

from metrology import DomainError
from physics.bodies import GRAVITY, Ball, Pendulum, Support
from physics.domain import (
    FloatArray,
    Number,
    require_angle,
    require_finite,
    require_non_negative,
    require_positive,
)
from physics.integrator import SolvedPath, ZeroCrossing, follow_until, runge_kutta_step
from physics.restitution import require_cor

__all__ = [
    "ContactHistory",
    "ContactOutcome",
    "ContactScene",
    "HuntCrossley",
    "ImpulsiveImpact",
    "contact_outcomes",
    "cor_from_ball_speed",
    "damping_for_cor",
    "elastic_contact_time",
    "external_impulse",
    "impact",
    "simulate_contact",
]


@dataclass(frozen=True)
class ContactOutcome:
    """The state at release, with floats or with arrays of one entry per contact.

    Attributes
    ----------
    impact_speed : float or array
        Speed of the contact point at onset, ω₀ L, m/s.
    cor : float or array
        Separation speed along the face's normal at release over `impact_speed`.
    contact_time : float or array
        s.
    pendulum_speed_after : float or array
        ω₁ L at release, m/s.
    pendulum_angle : float or array
        φ at release, rad.
    ball_x, ball_y : float or array
        Ball's centre at release, m; x from its rest position, y from the floor.
    ball_vx, ball_vy : float or array
        Its velocity, m/s.
    ball_spin : float or array
        About z, counter-clockwise positive, rad/s.
    """

    impact_speed: Number
    cor: Number
    contact_time: Number
    pendulum_speed_after: Number
    pendulum_angle: Number
    ball_x: Number
    ball_y: Number
    ball_vx: Number
    ball_vy: Number
    ball_spin: Number = 0.0

    @property
    def ball_speed(self) -> Number:
        """Speed of the ball at release, m/s."""
        return np.hypot(self.ball_vx, self.ball_vy)

    @property
    def launch_angle(self) -> Number:
        """Direction of the ball's velocity above the horizontal, rad."""
        return np.arctan2(self.ball_vy, self.ball_vx)

    def at(self, index: int) -> Self:
        """One contact of a batch, as floats."""
        values = {
            f.name: float(np.ravel(getattr(self, f.name))[index])
            if np.ndim(getattr(self, f.name))
            else getattr(self, f.name)
            for f in fields(self)
        }
        return type(self)(**values)


SLIP_SCALE = 0.02
"""Slip, m/s, at which regularised Coulomb friction has tanh(1) = 76 % of its full value
(chosen)."""

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
        """Normal force, N, at compression δ (m) and rate δ̇ (m/s); zero without contact."""
        pressed = np.maximum(compression, 0.0)
        push: Number = self.stiffness * pressed**self.exponent
        return np.maximum(push * (1.0 + self.damping * rate), 0.0)


@dataclass(frozen=True)
class ContactScene:
    """A pendulum, a ball on its support, and the pivot for which they touch at `angle`.

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

    @cached_property
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
        return self._touching(state, np.sin(state[0]), np.cos(state[0]))

    def _touching(
        self, state: State, sine: Number, cosine: Number
    ) -> tuple[Number, Number, Number]:
        """`kinematics`, given sine and cosine of the bar's angle."""
        _, omega, x, y, vx, vy = state[:6]
        pivot_x, pivot_y = self.pivot
        from_x, from_y = x - pivot_x, y - pivot_y
        along = from_x * sine - from_y * cosine
        ahead = from_x * cosine + from_y * sine
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
        resting : bool or bool array
            Whether the ball sits on its support, which can push but not pull.

        Returns
        -------
        list of seven floats or arrays
        """
        phi, omega, _, _, vx, vy, spin = state
        sine, cosine = np.sin(phi), np.cos(phi)
        compression, rate, lever = self._touching(state, sine, cosine)
        push = law.force(compression, rate)
        ball, body = self.ball, self.pendulum
        rub: Number = 0.0
        # The friction acts at the flattened patch, nearer to the centre than the radius.
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


CONTACT_STEPS = 160
"""Steps per contact (measured: with half the step the outcome changes by less than 1e-6)."""

MAX_CALIBRATION_ROUNDS = 40
"""Chosen; a handful suffice."""
CALIBRATION_ERROR = 1e-7
"""Largest relative error of `cor` and `contact_time` (chosen: far below any uncertainty)."""
COARSE_CONTACT_STEPS, COARSE_CALIBRATION_ERROR = 40, 1e-4
"""Steps per contact while the calibration's relative error exceeds this tolerance (derived: fourth
order gives 1e-6 · 4⁴, a few 1e-4, at a quarter of the cost)."""


def released(
    scene: ContactScene,
    law: HuntCrossley,
    impact_speed: FloatArray,
    expected_time: FloatArray,
    steps: int = CONTACT_STEPS,
) -> ContactOutcome:
    """Solve contacts from onset to release with classical fourth-order steps.

    Parameters
    ----------
    scene : ContactScene
        `angle` a float or (N,).
    law : HuntCrossley
        `stiffness`, `damping` floats or (N,).
    impact_speed : (N,) array
        m/s.
    expected_time : (N,) array
        Approximate duration of each contact, s.
    steps : int
        Steps in that time.

    Returns
    -------
    ContactOutcome
        Arrays (N,).

    Raises
    ------
    DomainError
        If a ball is not released within four times its expected time.
    """
    shape = impact_speed.shape
    zero = np.zeros(shape)
    omega = impact_speed / scene.pendulum.length
    state = np.stack([zero + scene.angle, omega, zero, zero + scene.rest_height, zero, zero, zero])
    step = expected_time / steps
    found = np.zeros(shape, dtype=bool)
    when = np.zeros(shape)
    final = np.zeros_like(state)

    def motion(_: float, now: FloatArray) -> FloatArray:
        return _rates(scene, law, now)

    rates = motion(0.0, state)
    for count in range(4 * steps):
        after = runge_kutta_step(motion, 0.0, state, step, rates)
        sunk = after[3] < scene.rest_height
        after[3] = np.where(sunk, scene.rest_height, after[3])
        after[5] = np.where(sunk, np.maximum(after[5], 0.0), after[5])
        rates_after = motion(0.0, after)
        apart = ~found & (np.asarray(scene.kinematics(list(after))[0]) <= 0.0)
        if apart.any():
            share = _crossing(scene, state, after, rates, rates_after, step)
            at_release = _hermite(state, after, rates, rates_after, step, share)
            final = np.where(apart, at_release, final)
            when = np.where(apart, (count + share) * step, when)
            found |= apart
            if found.all():
                return _outcome(scene, impact_speed, when, final)
        state, rates = after, rates_after
    raise DomainError(
        f"a ball struck at {impact_speed[~found][0]:.3g} m/s is not released by the face",
        hint="The impact is too slow, or the restitution too small, to simulate.",
    )


def _rates(scene: ContactScene, law: HuntCrossley, state: FloatArray) -> FloatArray:
    resting = (state[3] <= scene.rest_height + 1e-12) & (state[5] <= 1e-12)
    rates = np.empty_like(state)
    for row, rate in zip(rates, scene.derivative(list(state), law, resting), strict=True):
        row[:] = rate
    return rates


def _hermite(
    before: FloatArray,
    after: FloatArray,
    rates: FloatArray,
    rates_after: FloatArray,
    step: FloatArray,
    share: FloatArray,
) -> FloatArray:
    back = 1.0 - share
    return np.asarray(
        (1.0 + 2.0 * share) * back**2 * before
        + share * back**2 * step * rates
        + share**2 * (3.0 - 2.0 * share) * after
        - share**2 * back * step * rates_after
    )


def _crossing(
    scene: ContactScene,
    before: FloatArray,
    after: FloatArray,
    rates: FloatArray,
    rates_after: FloatArray,
    step: FloatArray,
) -> FloatArray:
    """Fraction of the step at which the compression vanishes, by bisection on the cubic."""
    low, high = np.zeros_like(step), np.ones_like(step)
    for _ in range(45):
        middle = 0.5 * (low + high)
        there = _hermite(before, after, rates, rates_after, step, middle)
        pressed = np.asarray(scene.kinematics(list(there))[0]) > 0.0
        low, high = np.where(pressed, middle, low), np.where(pressed, high, middle)
    return np.asarray(0.5 * (low + high))


def _outcome(
    scene: ContactScene, impact_speed: FloatArray, when: FloatArray, state: FloatArray
) -> ContactOutcome:
    phi, omega, x, y, vx, vy, spin = state
    separation = -np.asarray(scene.kinematics(list(state))[1])
    return ContactOutcome(
        impact_speed=impact_speed,
        cor=separation / impact_speed,
        contact_time=when,
        pendulum_speed_after=omega * scene.pendulum.length,
        pendulum_angle=phi,
        ball_x=x,
        ball_y=y,
        ball_vx=vx,
        ball_vy=vy,
        ball_spin=spin,
    )


def calibrate_contacts(
    scene: ContactScene,
    impact_speed: FloatArray,
    cor: FloatArray,
    contact_time: FloatArray,
    exponent: float,
    friction: float = 0.0,
) -> tuple[HuntCrossley, ContactOutcome]:
    """Stiffness and damping for which each contact returns its `cor` and `contact_time`.

    The head-on contact without gravity has a solution in closed form; its inverse, applied to the
    remaining error of the full simulation, converges in a few rounds.

    Parameters
    ----------
    impact_speed, cor, contact_time : (N,) array
        m/s, 1, s.
    exponent : float
        n of the contact force.
    friction : float
        Of the face.

    Returns
    -------
    HuntCrossley
        With arrays (N,).
    ContactOutcome
        Arrays (N,).

    Raises
    ------
    DomainError
        If the rounds do not converge.
    """
    body = scene.pendulum.inertial_mass
    reduced = body * scene.ball.mass / (body + scene.ball.mass)
    aimed_cor, aimed_time = cor.copy(), contact_time.copy()
    # Static friction is stiff and needs shorter explicit steps.
    finer = 2 if friction > 0.0 or scene.support.friction > 0.0 else 1
    missed, steps = np.inf, COARSE_CONTACT_STEPS * finer
    for _ in range(MAX_CALIBRATION_ROUNDS):
        law = HuntCrossley(
            np.asarray(stiffness_for_time(reduced, impact_speed, aimed_time, exponent)),
            np.asarray(damping_for_cor(aimed_cor)) / impact_speed,
            exponent,
            friction,
        )
        outcome = released(scene, law, impact_speed, contact_time, steps)
        cor_miss = np.asarray(outcome.cor) / cor
        time_miss = np.asarray(outcome.contact_time) / contact_time
        missed = float(np.max(np.abs([cor_miss - 1.0, time_miss - 1.0])))
        if missed < CALIBRATION_ERROR and steps == CONTACT_STEPS * finer:
            return law, outcome
        if missed < COARSE_CALIBRATION_ERROR:
            steps = CONTACT_STEPS * finer
        aimed_cor, aimed_time = aimed_cor / cor_miss, aimed_time / time_miss
    raise DomainError(
        f"no contact law gives these coefficients of restitution and contact times"
        f" (relative error {missed:.1e})",
        hint="Check the law of restitution and the contact times at the lowest and highest speed.",
    )


def contact_outcomes(
    pendulum: Pendulum,
    ball: Ball,
    support: Support,
    impact_speed: FloatArray,
    *,
    gravity: float = GRAVITY,
    cor: Number | None = None,
    contact_time: Number | None = None,
    angle: Number | None = None,
    friction: float = 0.0,
) -> ContactOutcome:
    """Outcomes of many contacts, each calibrated to its own e and Δt.

    Parameters
    ----------
    pendulum, ball, support
        The bodies.
    impact_speed : (N,) array
        m/s.
    gravity : float
        m/s².
    cor, contact_time : float or (N,) array, optional
        Default: the ball's laws at `impact_speed`.
    angle : float or (N,) array, optional
        Angle of the pendulum at onset, rad; default the ball's launch angle.
    friction : float
        Coulomb coefficient between face and ball.

    Returns
    -------
    ContactOutcome
        Arrays (N,).

    Raises
    ------
    DomainError
        For speeds that are not positive, e outside (0, 1], or a contact that never ends.
    """
    speed = np.atleast_1d(np.asarray(impact_speed, dtype=np.float64))
    require_positive("the impact speed", speed, "m/s")
    wanted_cor = np.broadcast_to(ball.cor(speed) if cor is None else cor, speed.shape)
    require_cor(wanted_cor)
    wanted_time = np.broadcast_to(
        ball.contact_time(speed) if contact_time is None else contact_time, speed.shape
    )
    require_positive("the contact time", wanted_time, "s")
    onset = ball.launch_angle if angle is None else angle
    require_angle("the contact angle", onset, np.pi / 2)
    scene = ContactScene(pendulum, ball, support, gravity, onset)
    _, outcome = calibrate_contacts(
        scene,
        speed,
        np.array(wanted_cor, dtype=np.float64),
        np.array(wanted_time, dtype=np.float64),
        ball.contact_time.exponent,
        friction,
    )
    return outcome


MAX_CONTACT_TIME = 1.0
"""Maximum duration of a contact, s (chosen)."""

RESTING_TOLERANCE = 1e-8
"""Distance below its rest height at which a ball is on the support again, m (chosen)."""

MAX_CONTACT_PHASES = 8
"""Maximum number of phases on and off the support in one contact (chosen): strikes on the paper's
rig have at most three; more are numerical chatter."""


@dataclass(frozen=True)
class ContactHistory:
    """A contact from onset (time 0) to release (last row).

    Attributes
    ----------
    time : (N,) array
        s from onset.
    phi, omega : (N,) array
        Pendulum, rad past the lowest point and rad/s.
    ball_x, ball_y, ball_vx, ball_vy : (N,) array
        Ball's centre, m and m/s; x from rest, y from the floor.
    ball_spin : (N,) array
        rad/s about z.
    compression : (N,) array
        m.
    force : (N,) array
        Normal force of the face, N.
    lift_off : float
        Time at which the ball left its support, s; that of release if it never did.
    law : HuntCrossley
        The contact law followed.
    scene : ContactScene
        Bodies and pivot.
    outcome : ContactOutcome
        The state at release, as floats.
    """

    time: FloatArray
    phi: FloatArray
    omega: FloatArray
    ball_x: FloatArray
    ball_y: FloatArray
    ball_vx: FloatArray
    ball_vy: FloatArray
    ball_spin: FloatArray
    compression: FloatArray
    force: FloatArray
    lift_off: float
    law: HuntCrossley
    scene: ContactScene
    outcome: ContactOutcome


def calibrate_contact(
    scene: ContactScene,
    impact_speed: float,
    cor: float,
    contact_time: float,
    exponent: float,
    friction: float = 0.0,
) -> HuntCrossley:
    """Contact law that returns `cor` and `contact_time` (s) at `impact_speed` (m/s).

    Parameters
    ----------
    impact_speed, cor, contact_time : float
        m/s, 1, s.
    exponent : float
        n of the force k δⁿ (1 + c δ̇).
    friction : float
        Coulomb coefficient of the face.

    Raises
    ------
    DomainError
        If there are none.
    """
    law, _ = calibrate_contacts(
        scene,
        np.array([impact_speed]),
        np.array([cor]),
        np.array([contact_time]),
        exponent,
        friction,
    )
    return HuntCrossley(
        float(np.ravel(law.stiffness)[0]), float(np.ravel(law.damping)[0]), exponent, friction
    )


def simulate_contact(
    pendulum: Pendulum,
    ball: Ball,
    support: Support,
    impact_speed: float,
    *,
    gravity: float = GRAVITY,
    cor: float | None = None,
    contact_time: float | None = None,
    friction: float = 0.0,
    law: HuntCrossley | None = None,
    samples: int = 201,
) -> ContactHistory:
    """Simulate a contact from first touch to release (Hunt and Crossley 1975).

    Gravity acts on pendulum and ball; the support pushes until the face lifts the ball off it.
    LSODA switches to an implicit method where friction makes the equations stiff; lift-off and
    release are events.

    Parameters
    ----------
    pendulum, ball, support
        The bodies.
    impact_speed : float
        ω₀ L, m/s.
    gravity : float
        m/s².
    cor, contact_time : float, optional
        Required result, 1 and s; default the ball's laws at this speed.
    friction : float
        Coulomb coefficient between face and ball.
    law : HuntCrossley, optional
        Use this law instead of calibrating one.
    samples : int
        Rows of the history.

    Raises
    ------
    DomainError
        For a speed that is not positive, e outside (0, 1], or a ball that stays on the face.
    """
    require_positive("the impact speed", impact_speed, "m/s")
    require_angle("the contact angle", ball.launch_angle, np.pi / 2)
    scene = ContactScene(pendulum, ball, support, gravity, ball.launch_angle)
    if law is None:
        wanted_cor = ball.cor(impact_speed) if cor is None else cor
        wanted_time = ball.contact_time(impact_speed) if contact_time is None else contact_time
        require_cor(wanted_cor)
        require_positive("the contact time", wanted_time, "s")
        law = calibrate_contact(
            scene, impact_speed, wanted_cor, wanted_time, ball.contact_time.exponent, friction
        )
    start = np.array(
        [ball.launch_angle, impact_speed / pendulum.length, 0.0, scene.rest_height, 0.0, 0.0, 0.0]
    )
    return _history(scene, law, impact_speed, _phases(scene, law, start), samples)


def _phases(scene: ContactScene, law: HuntCrossley, state: FloatArray) -> list[SolvedPath]:
    """Motion on the support, off it, and perhaps on it again, until release."""
    phases: list[SolvedPath] = []
    resting, since = True, 0.0
    while not phases or (phases[-1].ended_by == 1 and len(phases) < MAX_CONTACT_PHASES):
        phases.append(_phase(scene, law, state, since, resting=resting))
        since, state = phases[-1].end, phases[-1].state.copy()
        if not resting:
            state[3], state[5] = scene.rest_height, 0.0
        resting = not resting
    if phases[-1].ended_by != 0:
        raise DomainError(
            f"the ball is not released by the face within {MAX_CONTACT_TIME:g} s",
            hint="The impact is too slow, or the restitution too small, to simulate.",
        )
    return phases


def _phase(
    scene: ContactScene, law: HuntCrossley, start: FloatArray, since: float, *, resting: bool
) -> SolvedPath:
    def rates(_: float, state: FloatArray) -> FloatArray:
        return np.array(scene.derivative(list(state), law, resting), dtype=np.float64)

    def compression(_: float, state: FloatArray) -> float:
        return float(scene.kinematics(list(state))[0])

    def upward(_: float, state: FloatArray) -> float:
        return float(scene.derivative(list(state), law, False)[5])

    def height(_: float, state: FloatArray) -> float:
        return float(state[3]) - scene.rest_height + RESTING_TOLERANCE

    # On the support until the upward force exceeds the weight; off it until the ball sinks back.
    leaves = ZeroCrossing(upward, 1.0) if resting else ZeroCrossing(height, -1.0)
    return follow_until(
        rates,
        start,
        (since, since + MAX_CONTACT_TIME),
        [ZeroCrossing(compression, -1.0), leaves],
        method="LSODA",
        relative=1e-9,
        absolute=1e-11,
        first_step=1e-6,
        max_step=2e-3,
    )


def _history(
    scene: ContactScene,
    law: HuntCrossley,
    impact_speed: float,
    phases: list[SolvedPath],
    samples: int,
) -> ContactHistory:
    release, lift_off = phases[-1].end, phases[0].end
    time = np.linspace(0.0, release, samples)
    ends = np.array([phase.end for phase in phases[:-1]])
    states = np.array([phases[int(np.searchsorted(ends, t))].at(t) for t in time]).T
    states[:, -1] = phases[-1].state
    phi, omega, x, y, vx, vy, spin = states
    compression, rate, _ = scene.kinematics(list(states))
    outcome = ContactOutcome(
        impact_speed=impact_speed,
        cor=-float(np.asarray(rate)[-1]) / impact_speed,
        contact_time=release,
        pendulum_speed_after=float(omega[-1]) * scene.pendulum.length,
        pendulum_angle=float(phi[-1]),
        ball_x=float(x[-1]),
        ball_y=float(y[-1]),
        ball_vx=float(vx[-1]),
        ball_vy=float(vy[-1]),
        ball_spin=float(spin[-1]),
    )
    return ContactHistory(
        time,
        phi,
        omega,
        x,
        y,
        vx,
        vy,
        spin,
        np.maximum(np.asarray(compression), 0.0),
        np.asarray(law.force(compression, rate)),
        lift_off,
        law,
        scene,
        outcome,
    )


@dataclass(frozen=True)
class ImpulsiveImpact:
    """Velocities and impulse of an impact along the contact normal; floats or arrays.

    Attributes
    ----------
    speed_before : float or array
        Pendulum at the contact point, v_M⁰, m/s.
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
        """v_M^avg = (v_M⁰ + v_M) / 2, m/s: mean speed of the face during contact (Eq. 13)."""
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
