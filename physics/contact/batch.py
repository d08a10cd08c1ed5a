"""Many contacts at once: fixed-step Runge–Kutta over arrays, calibrated to e(v) and Δt(v)."""

import numpy as np

from metrology import DomainError
from physics.arrays import FloatArray, Number
from physics.bodies import GRAVITY, Ball, Pendulum, Support
from physics.contact.law import ContactScene, HuntCrossley, damping_for_cor, stiffness_for_time
from physics.contact.outcome import ContactOutcome
from physics.domain import require_angle, require_positive
from physics.integrator import runge_kutta_step
from physics.restitution.restitution import require_cor

__all__ = ["calibrate_contacts", "contact_outcomes", "released"]

STEPS = 160
"""Steps per contact: halved again, the outcome moves by less than 1e-6 of itself."""

COARSE_STEPS, COARSE_TOLERANCE = 40, 1e-4
"""Steps per contact while the calibration is further off than this share: a quarter of the steps
costs a quarter, and fourth order leaves 1e-6 · 4⁴, a few 1e-4."""


def released(
    scene: ContactScene,
    law: HuntCrossley,
    impact_speed: FloatArray,
    expected_time: FloatArray,
    steps: int = STEPS,
) -> ContactOutcome:
    """Follow contacts from onset to release with classical fourth-order steps.

    Parameters
    ----------
    scene : ContactScene
        `angle` a float or (N,).
    law : HuntCrossley
        `stiffness`, `damping` floats or (N,).
    impact_speed : (N,) array
        m/s.
    expected_time : (N,) array
        About how long each contact lasts, s.
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
        f"a ball struck at {impact_speed[~found][0]:.3g} m/s does not come free of the face",
        hint="A very slow impact or a very small coefficient of restitution can't be followed.",
    )


def _rates(scene: ContactScene, law: HuntCrossley, state: FloatArray) -> FloatArray:
    resting = (state[3] <= scene.rest_height + 1e-12) & (state[5] <= 1e-12)
    rows = scene.derivative(list(state), law, resting)
    return np.stack([np.broadcast_to(row, state.shape[1:]) for row in rows])


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
    """Share of the step at which the compression vanishes, by bisection on the Hermite cubic."""
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
    *,
    rounds: int = 40,
    tolerance: float = 1e-7,
) -> tuple[HuntCrossley, ContactOutcome]:
    """Stiffness and damping for which each contact returns its `cor` and `contact_time`.

    The head-on contact without gravity has a solution in closed form; its inverse, applied to what
    the full simulation missed by, converges in a few rounds.

    Parameters
    ----------
    scene : ContactScene
    impact_speed, cor, contact_time : (N,) array
        m/s, 1, s.
    exponent : float
        n of the contact force.
    friction : float
        Of the face.
    rounds : int
        Most rounds to try.
    tolerance : float
        Largest relative miss of `cor` and `contact_time` allowed at the end.

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
    # friction that grips is stiff: the explicit steps must be shorter
    finer = 2 if friction > 0.0 or scene.support.friction > 0.0 else 1
    missed, steps = np.inf, COARSE_STEPS * finer
    for _ in range(rounds):
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
        if missed < tolerance and steps == STEPS * finer:
            return law, outcome
        if missed < COARSE_TOLERANCE:
            steps = STEPS * finer
        aimed_cor, aimed_time = aimed_cor / cor_miss, aimed_time / time_miss
    raise DomainError(
        f"no contact law gives these coefficients of restitution and contact times"
        f" (missed by {missed:.1e})",
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
