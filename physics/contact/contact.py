"""One contact, followed through time by a stiff-safe solver with events."""

from dataclasses import dataclass

import numpy as np

from metrology import DomainError
from physics.arrays import FloatArray
from physics.bodies import GRAVITY, Ball, Pendulum, Support
from physics.contact.batch import calibrate_contacts
from physics.contact.law import ContactScene, HuntCrossley
from physics.contact.outcome import ContactOutcome
from physics.domain import require_angle, require_positive
from physics.follow import Event, Path, follow_until
from physics.restitution.restitution import require_cor

__all__ = ["ContactHistory", "calibrate_contact", "simulate_contact"]

LONGEST = 1.0
"""s; a contact that lasts longer is called stuck."""

TOUCHING = 1e-8
"""m; a ball this little below its rest height lies on the support again."""

MOST_PHASES = 8
"""Times a ball may leave its support and sink back onto it during one contact: of strikes on the
paper's rig none does so more than once, so that more than a few is a solver that chatters."""


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
        When the ball left its support, s; the time of release if it never did.
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
    scene : ContactScene
    impact_speed, cor, contact_time : float
        m/s, 1, s.
    exponent : float
        n of the force k δⁿ (1 + c δ̇).
    friction : float
        Coulomb coefficient of the face.

    Returns
    -------
    HuntCrossley

    Raises
    ------
    DomainError
        If no stiffness and damping do.
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
    """Follow face and ball from first touch to release (Hunt and Crossley 1975).

    The pendulum turns, its face with it; gravity acts on both; the support pushes until the face
    lifts the ball off it. LSODA changes to an implicit method where friction makes the equations
    stiff; lift-off and release are events.

    Parameters
    ----------
    pendulum, ball, support
        The bodies.
    impact_speed : float
        ω₀ L, m/s.
    gravity : float
        m/s².
    cor, contact_time : float, optional
        What the contact shall return, 1 and s; default the ball's laws at this speed.
    friction : float
        Coulomb coefficient between face and ball.
    law : HuntCrossley, optional
        Follow this law as it is instead of calibrating one.
    samples : int
        Rows of the history.

    Returns
    -------
    ContactHistory

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


def _phases(scene: ContactScene, law: HuntCrossley, state: FloatArray) -> list[Path]:
    """The motion on the support, off it, perhaps on it again, until the face lets go."""
    phases: list[Path] = []
    resting, since = True, 0.0
    while not phases or (phases[-1].ended_by == 1 and len(phases) < MOST_PHASES):
        phases.append(_phase(scene, law, state, since, resting=resting))
        since, state = phases[-1].end, phases[-1].state.copy()
        if not resting:
            state[3], state[5] = scene.rest_height, 0.0
        resting = not resting
    if phases[-1].ended_by != 0:
        raise DomainError(
            f"the ball is not released by the face within {LONGEST:g} s",
            hint="A very slow impact or a very small coefficient of restitution can't be followed.",
        )
    return phases


def _phase(
    scene: ContactScene, law: HuntCrossley, start: FloatArray, since: float, *, resting: bool
) -> Path:
    def rates(_: float, state: FloatArray) -> FloatArray:
        return np.array(scene.derivative(list(state), law, resting), dtype=np.float64)

    def compression(_: float, state: FloatArray) -> float:
        return float(scene.kinematics(list(state))[0])

    def upward(_: float, state: FloatArray) -> float:
        return float(scene.derivative(list(state), law, False)[5])

    def height(_: float, state: FloatArray) -> float:
        return float(state[3]) - scene.rest_height + TOUCHING

    # on the support until the push upwards beats the weight; off it until it sinks back
    leaves = Event(upward, 1.0) if resting else Event(height, -1.0)
    return follow_until(
        rates,
        start,
        (since, since + LONGEST),
        [Event(compression, -1.0), leaves],
        method="LSODA",
        relative=1e-9,
        absolute=1e-11,
        first_step=1e-6,
        max_step=2e-3,
    )


def _history(
    scene: ContactScene, law: HuntCrossley, impact_speed: float, phases: list[Path], samples: int
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
