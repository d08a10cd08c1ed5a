"""Table 5: which unsaid things could explain its 16 simulated distances, and which could not.

Impact speeds that the paper measured but does not print, and its Eqs 26 and 27.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.optimize import brentq, least_squares

from physics.bodies import BALLS, PAPER_PENDULUM, Ball
from physics.contact.contact import ContactOutcome, contact_outcomes
from physics.contact.impact import external_impulse
from physics.domain import FloatArray
from physics.flight.flight import land_many
from physics.forward import Experiment, ball_state, paper_impact
from physics.restitution.restitution import ConstantCor, CorLaw, ExponentialCor
from pipelines.paper import printed
from pipelines.paper.printed import TABLE_6

__all__ = [
    "ALLOWANCE",
    "EFFECTIVE_MASS",
    "RATIONAL",
    "Explanation",
    "backswing_by_rational",
    "constant_law",
    "contact_candidate",
    "investigate",
    "law_of",
    "measured_speeds",
    "speed_by_rational",
    "speed_for",
]

EFFECTIVE_MASS = PAPER_PENDULUM.mass_at_contact

RATIONAL = {
    "jokku": (9.594, -85.5, -0.2311, 152.3, 6.66),
    "basketball": (9.554, -98.12, -1.5070, 154.2, 7.267),
}

"""Eqs 26, 27: p₁, p₂, p₃, q₁, q₂ of (p₁ b² + p₂ b + p₃) / (b² + q₁ b + q₂), b in
degrees and the speed in m/s, as the paper prints them."""


def constant_law(ball: Ball) -> ConstantCor:
    """The paper's constant COR: its fitted law at zero speed."""
    law = ball.cor
    return law.at_rest if isinstance(law, ExponentialCor) else ConstantCor(float(law(0.0)))


def law_of(ball: Ball, kind: str) -> CorLaw:
    """Eq. 24 or 25: ``variable`` or ``constant``."""
    return ball.cor if kind == "variable" else constant_law(ball)


def speed_for(ball: Ball, law: CorLaw, impulse: float) -> float:
    """Eq. 9 with e(v), solved for the impact speed, m/s."""

    def miss(speed: float) -> float:
        impulse_here = external_impulse(EFFECTIVE_MASS, ball.mass, law(speed), speed)
        return float(impulse_here) - impulse

    return float(brentq(miss, 1e-3, 50.0, xtol=1e-14))


def measured_speeds(name: str) -> FloatArray:
    """Impact speeds (4,) at 30, 60, 90, 120 deg, m/s, recovered from both rows of Table 6."""
    ball = BALLS[name]
    rows = [
        [speed_for(ball, law_of(ball, kind), float(text)) for text in TABLE_6[name][kind]]
        for kind in ("variable", "constant")
    ]
    return np.asarray(np.mean(rows, axis=0))


def speed_by_rational(name: str, backswing_deg: float) -> float:
    """Eq. 26 or 27 as printed, m/s."""
    p1, p2, p3, q1, q2 = RATIONAL[name]
    b = backswing_deg
    return (p1 * b**2 + p2 * b + p3) / (b**2 + q1 * b + q2)


def backswing_by_rational(name: str, speed: float) -> float:
    """Eq. 26 or 27 solved for the back-swing angle, degrees."""
    return float(brentq(lambda b: speed_by_rational(name, b) - speed, 15.0, 400.0, xtol=1e-12))


ALLOWANCE = {"simulated": 0.006, "experiment": 0.010}

"""m. The simulation ran "until the y coordinate is near to zero", up to one step late: 6 mm for a
step of 1 ms at 6 m/s. The experiment was read on gradations of 10 mm. A candidate that misses a
printed distance by more is excluded."""

KINDS = ("variable", "constant")


@dataclass(frozen=True)
class Explanation:
    """A candidate and how well it fits.

    Attributes
    ----------
    name : str
    data : str
        "simulated" (16 numbers) or "experiment" (8 numbers).
    parameters : tuple of (str, float)
        Fitted values, with the ball they belong to; SI, angles in degrees.
    rms, largest : float
        Residuals, m.
    allowed : bool
        Whether no residual exceeds `ALLOWANCE`.
    physical : bool
        Whether the values are ones a lab could have (see `_BOUNDS`).
    """

    name: str
    data: str
    parameters: tuple[tuple[str, float], ...]
    rms: float
    largest: float
    allowed: bool
    physical: bool


_SCALES = {"origin": 0.05, "height": 0.02, "contact_time": 0.005, "drag": 0.3, "turn": 1.0}
"""m, m, s, factor and degree: about what the paper leaves open of each, so that a solver's steps
are alike."""

_BOUNDS = {
    "origin": (-0.03, 0.03),
    "height": (-0.01, 0.01),
    "contact_time": (0.005, 0.03),
    "drag": (0.2, 0.6),
    "turn": (-1.0, 1.0),
}

"""What would be unremarkable: a tape misread by 3 cm or 1 cm, 5 to 30 ms of contact, a sphere's
C_D, a degree of launch angle."""

_CANDIDATES: tuple[tuple[str, bool, tuple[str, ...]], ...] = (
    ("as printed, drag C_D 0.47", False, ()),
    ("origin of x", False, ("origin",)),
    ("height of release", False, ("height",)),
    ("contact time", False, ("contact_time",)),
    ("drag coefficient", False, ("drag",)),
    ("launch angle", False, ("turn",)),
    ("origin and height", False, ("origin", "height")),
    ("origin and drag", False, ("origin", "drag")),
    ("origin and launch angle", False, ("origin", "turn")),
    ("origin, height, contact time and drag", False, ("origin", "height", "contact_time", "drag")),
    ("contact followed in time", True, ()),
    ("contact in time, drag", True, ("drag",)),
    ("contact in time, origin and drag", True, ("origin", "drag")),
    ("contact in time, launch angle and drag", True, ("turn", "drag")),
    ("contact in time, origin, height and drag", True, ("origin", "height", "drag")),
)


@dataclass(frozen=True)
class _Case:
    """One ball's rows: launch states before anything is fitted."""

    experiment: Experiment
    rows: tuple[tuple[ContactOutcome, FloatArray], ...]


def _case(name: str, in_time: bool, data: str) -> _Case:
    rows = []
    for kind in KINDS if data == "simulated" else ("variable",):
        row = kind if data == "simulated" else "experiment"
        target = np.array([float(text) for text in printed.TABLE_5[name][row]])
        rows.append((_launched(name, in_time, kind), target))
    return _Case(Experiment(BALLS[name]), tuple(rows))


@cache
def _launched(name: str, in_time: bool, kind: str) -> ContactOutcome:
    experiment = Experiment(BALLS[name])
    speeds = measured_speeds(name)
    cor = np.asarray(law_of(experiment.ball, kind)(speeds))
    return (_in_time if in_time else _impulsive)(experiment, speeds, cor)


def _in_time(experiment: Experiment, speeds: FloatArray, cor: FloatArray) -> ContactOutcome:
    return contact_outcomes(
        experiment.pendulum, experiment.ball, experiment.support, speeds, cor=cor
    )


def _impulsive(experiment: Experiment, speeds: FloatArray, cor: FloatArray) -> ContactOutcome:
    after = paper_impact(experiment, speeds, cor)
    angle, zero = experiment.ball.launch_angle, np.zeros(speeds.shape)
    ball_speed = np.asarray(after.ball_speed)
    return ContactOutcome(
        impact_speed=np.asarray(after.mean_speed),
        cor=cor,
        contact_time=np.asarray(experiment.ball.contact_time(speeds)),
        pendulum_speed_after=np.asarray(after.speed_after),
        pendulum_angle=zero,
        ball_x=zero,
        ball_y=zero + experiment.rest_height,
        ball_vx=ball_speed * np.cos(angle),
        ball_vy=ball_speed * np.sin(angle),
    )


def _distances(
    case: _Case, outcome: ContactOutcome, in_time: bool, values: dict[str, float]
) -> FloatArray:
    experiment = case.experiment
    x, y = np.asarray(outcome.ball_x), np.asarray(outcome.ball_y)
    vx, vy = np.asarray(outcome.ball_vx), np.asarray(outcome.ball_vy)
    if not in_time:
        time = values.get("contact_time", outcome.contact_time)
        advance = outcome.impact_speed * time
        x = x + advance * np.cos(experiment.ball.launch_angle)
        y = y + advance * np.sin(experiment.ball.launch_angle)
    turn = np.deg2rad(values.get("turn", 0.0))
    vx, vy = vx * np.cos(turn) - vy * np.sin(turn), vx * np.sin(turn) + vy * np.cos(turn)
    drag = values.get("drag", experiment.drag_coefficient)
    model = replace(experiment, drag_coefficient=drag).flight
    state = ball_state(x, y + values.get("height", 0.0), vx, vy)
    _, there = land_many(model, state, floor=experiment.ball.radius, step=0.05)
    reached: FloatArray = there[0] + values.get("origin", 0.0)
    return reached


def _fit(name: str, in_time: bool, free: tuple[str, ...], data: str) -> Explanation:
    residuals: list[FloatArray] = []
    found: list[tuple[str, float]] = []
    for ball in BALLS:
        case = _case(ball, in_time, data)

        def misses(vector: FloatArray, case: _Case = case) -> FloatArray:
            values = {key: float(v) * _SCALES[key] for key, v in zip(free, vector, strict=True)}
            return np.concatenate(
                [_distances(case, out, in_time, values) - want for out, want in case.rows]
            )

        best = _minimum(misses, free)
        residuals.append(misses(best))
        found += [
            (f"{ball} {key}", float(v) * _SCALES[key]) for key, v in zip(free, best, strict=True)
        ]
    every = np.concatenate(residuals)
    largest = float(np.max(np.abs(every)))
    inside = all(
        _BOUNDS[key.split(" ", 1)[1]][0] <= value <= _BOUNDS[key.split(" ", 1)[1]][1]
        for key, value in found
    )
    return Explanation(
        name,
        data,
        tuple(found),
        float(np.sqrt(np.mean(every**2))),
        largest,
        largest <= ALLOWANCE[data],
        inside,
    )


def _minimum(misses: Callable[[FloatArray], FloatArray], free: tuple[str, ...]) -> FloatArray:
    if not free:
        return np.zeros(0)
    start = np.array([0.47 / _SCALES["drag"] if key == "drag" else 0.0 for key in free])
    start = np.array(
        [3.0 if key == "contact_time" else s for key, s in zip(free, start, strict=True)]
    )
    low = [0.0 if key in ("drag", "contact_time") else -np.inf for key in free]
    return np.asarray(least_squares(misses, start, bounds=(low, np.inf), x_scale=1.0).x)


def investigate(data: str = "simulated") -> tuple[Explanation, ...]:
    """Fit every candidate, each ball with its own values.

    Parameters
    ----------
    data : str
        "simulated" for rows A and B of Table 5, "experiment" for row C.

    Returns
    -------
    tuple of Explanation
        In the order of the candidates.
    """
    return tuple(_fit(name, in_time, free, data) for name, in_time, free in _CANDIDATES)


def contact_candidate(name: str) -> tuple[FloatArray, FloatArray]:
    """Launch angles (deg) at the measured speeds: the paper's, and from the contact in time."""
    ball = BALLS[name]
    speeds = measured_speeds(name)
    outcome = _launched(name, True, "variable")
    constant = np.full(speeds.shape, np.rad2deg(ball.launch_angle))
    return constant, np.rad2deg(np.asarray(outcome.launch_angle))
