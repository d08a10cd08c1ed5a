"""Tables 2 to 10, recomputed cell by cell.

The paper's four conclusions on Eq. 17, and its speeds against a frictionless swing.

Table 5: which unsaid things could explain its 16 simulated distances, and which could not.

Impact speeds that the paper measured but does not print, and its Eqs 26 and 27.

What the paper prints: Tables 2 to 10, digit by digit (the number of digits matters).

One cell of the audit: print, ours, difference, verdict and why.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from scipy.optimize import brentq, least_squares

from physics.air import PAPER_AIR, moist_air_density, moist_air_viscosity
from physics.bodies import BALLS, PAPER_PENDULUM, PAPER_SUPPORT, Ball
from physics.contact import ContactOutcome, contact_outcomes, external_impulse
from physics.domain import FloatArray
from physics.flight import land_many
from physics.forward import (
    Experiment,
    RangeInputs,
    ball_state,
    cor_from_range,
    impulsive_launch,
    numerical_landing,
    paper_impact,
    sensitivities,
    speed_for_distance,
)
from physics.restitution import ConstantCor, CorFit, CorLaw, ExponentialCor, compare_cor_fits
from physics.swing import backswing_for_speed, frictionless_speed
from pipelines.model.simulate import BLUE, ORANGE, saved_figure

__all__ = [
    "ALLOWANCE",
    "BACKSWINGS_DEG",
    "EFFECTIVE_MASS",
    "TABLE_5",
    "TABLE_5_PERCENT",
    "TABLE_6",
    "TABLE_7",
    "TABLE_8",
    "TABLE_9",
    "TABLE_10",
    "TABLE_10_PERCENT",
    "WANTED_DISTANCES",
    "WANTED_IMPULSES",
    "Cell",
    "Explanation",
    "Verdict",
    "as_rows",
    "audit",
    "backswing_by_rational",
    "conclusions",
    "constant_law",
    "contact_candidate",
    "draw_sensitivities",
    "half_digit",
    "implied_fits",
    "investigate",
    "judged",
    "law_of",
    "measured_speeds",
    "speed_by_rational",
    "speed_for",
    "swing_checks",
]

BACKSWINGS_DEG = (30, 60, 90, 120)

"""deg: the settings of Tables 5 to 8."""

TABLE_5 = {
    "jokku": {
        "variable": ("0.5148", "1.198", "1.808", "2.341"),
        "constant": ("0.5234", "1.236", "1.881", "2.481"),
        "experiment": ("0.5181", "1.1893", "1.7932", "2.3603"),
    },
    "basketball": {
        "variable": ("0.5701", "1.339", "2.063", "2.732"),
        "constant": ("0.5764", "1.375", "2.139", "2.861"),
        "experiment": ("0.5688", "1.3354", "2.0716", "2.7500"),
    },
}

TABLE_5_PERCENT = {
    "jokku": {
        "variable": ("-0.6409", "0.7348", "0.8235", "-0.8196"),
        "constant": ("1.0189", "3.9300", "4.8943", "5.1118"),
    },
    "basketball": {
        "variable": ("0.2219", "0.2731", "-0.4149", "-0.6555"),
        "constant": ("1.3294", "2.9690", "3.2538", "4.0353"),
    },
}

TABLE_6 = {
    "jokku": {
        "variable": ("0.6510", "1.3197", "1.8267", "2.2155"),
        "constant": ("0.6614", "1.3574", "1.8926", "2.3059"),
    },
    "basketball": {
        "variable": ("1.0771", "2.2774", "3.1908", "3.8927"),
        "constant": ("1.0896", "2.3280", "3.2826", "4.0213"),
    },
}

WANTED_IMPULSES = {"jokku": (1.0, 1.4, 1.8, 2.2), "basketball": (1.5, 2.5, 3.5, 3.8)}

"""N s: the columns of Table 7."""

TABLE_7 = {
    "jokku": {
        "variable": ("1.740", "2.449", "3.166", "3.888"),
        "constant": ("1.698", "2.378", "3.057", "3.736"),
    },
    "basketball": {
        "variable": ("1.451", "2.436", "3.432", "3.732"),
        "constant": ("1.427", "2.370", "3.329", "3.614"),
    },
}

TABLE_8 = {
    "jokku": {
        "variable": ("45.78", "64.73", "88.58", "118.95"),
        "constant": ("44.73", "62.35", "84.94", "112.47"),
    },
    "basketball": {
        "variable": ("40.76", "67.31", "103.38", "116.19"),
        "constant": ("40.14", "65.39", "99.00", "111.17"),
    },
}

WANTED_DISTANCES = {
    "jokku": (1.0, 1.4, 1.8, 2.2, 2.5),
    "basketball": (1.0, 1.4, 1.8, 2.2, 2.8),
}

"""m: the columns of Table 9."""

TABLE_9 = {
    "jokku": ("52.64", "69.16", "89.36", "111.62", "129.81"),
    "basketball": ("49.01", "65.05", "81.88", "99.61", "128.90"),
}

TABLE_10 = {
    "jokku": ("1.0024", "1.4055", "1.8068", "2.2082", "2.5183"),
    "basketball": ("1.0029", "1.4067", "1.8076", "2.2096", "2.8178"),
}

TABLE_10_PERCENT = {
    "jokku": ("0.2432", "0.3569", "0.3765", "0.3704", "0.7319"),
    "basketball": ("0.2852", "0.4765", "0.4247", "0.4376", "0.6362"),
}

Verdict: TypeAlias = Literal[
    "reproduced",
    "rounding",
    "slip in print",
    "not reproducible from what is printed",
]

_BEYOND: Verdict = "not reproducible from what is printed"


@dataclass(frozen=True)
class Cell:
    """A printed number beside ours.

    Attributes
    ----------
    table : int
    row, column : str
    printed, ours, difference : float
        In the table's unit; the difference is ours minus print.
    verdict : Verdict
    note : str
    """

    table: int
    row: str
    column: str
    printed: float
    ours: float
    difference: float
    verdict: Verdict
    note: str


def half_digit(text: str) -> float:
    """Half a unit of the last printed digit."""
    _, _, decimals = text.partition(".")
    return float(0.5 * 10.0 ** -len(decimals))


def judged(
    table: int,
    row: str,
    column: str,
    printed: str,
    ours: float,
    *,
    input_rounding: float = 0.0,
    beyond: Verdict = _BEYOND,
    note: str = "",
    within: str = "",
) -> Cell:
    """Judge a cell.

    Parameters
    ----------
    table, row, column
        Where it is.
    printed : str
        The digits as printed.
    ours : float
        Recomputed.
    input_rounding : float
        How far the printed inputs' own rounding can shift `ours`.
    beyond : Verdict
        Verdict where neither rounding explains the difference.
    note, within : str
        Why, where it is not explained; and what to say where it is.
    """
    difference = ours - float(printed)
    half = half_digit(printed)
    verdict: Verdict
    if abs(difference) <= half * (1.0 + 1e-9):
        verdict, said = "reproduced", within
    elif abs(difference) <= half + input_rounding:
        verdict, said = "rounding", within or "within what the rounding of its inputs allows"
    else:
        verdict, said = beyond, note
    return Cell(table, row, column, float(printed), ours, difference, verdict, said)


def as_rows(cells: tuple[Cell, ...]) -> list[dict[str, object]]:
    """The contract's JSON rows."""
    rows = []
    for cell in cells:
        row = asdict(cell)
        row["print"] = row.pop("printed")
        keys = ("table", "row", "column", "print", "ours", "difference", "verdict", "note")
        rows.append({key: row[key] for key in keys})
    return rows


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
        target = np.array([float(text) for text in TABLE_5[name][row]])
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


EQUATION = {"jokku": 26, "basketball": 27}

"""Of the paper, by ball: impact speed from the back-swing."""

HALF_OF_P2 = {"jokku": 0.05, "basketball": 0.005}

"""Half a unit of the last digit that the paper prints of p2, by ball."""

SLIPS = frozenset({("basketball", "constant", 2.5)})

"""Cells of Table 7 that the paper prints wrongly: ball, law and impulse, N s."""

_COR_ROUNDING = 1.5e-4 / 1.7

"""Relative change of a speed by the last digits of Eqs 24, 25, which move e by 1.5e-4 at most."""


def audit() -> tuple[Cell, ...]:
    """All cells of Tables 2 to 10 that follow from other printed numbers.

    Pure inputs (masses, lengths, measured distances, balls' properties) have nothing to be
    recomputed from and are not listed.

    Returns
    -------
    tuple of Cell
    """
    tables = (
        _table_2,
        _table_3,
        _table_5,
        _table_5_percent,
        _table_6,
        _table_6_rational,
        _table_7,
        _table_8,
        _table_9,
        _table_10,
    )
    return tuple(cell for table in tables for cell in table())


def _table_2() -> Iterator[Cell]:
    end, bar, length = 4.750, 1.250, 0.5541
    yield judged(2, "total mass (kg)", "specification", "6.0", end + bar)
    yield judged(
        2,
        "effective mass (kg)",
        "specification",
        "5.1667",
        end + bar / 3.0,
        within="M + m/3; section IV prints M l² + m l²/3, which is a moment of inertia",
    )
    yield judged(
        2,
        "effective mass as I/L² (kg)",
        "specification",
        "5.1667",
        PAPER_PENDULUM.inertial_mass,
        input_rounding=PAPER_PENDULUM.inertial_mass * (0.0005 / 1.579 + 2 * 0.00005 / length),
        note="from Table 2's own inertia and length; a second reading, 0.46 % less",
    )
    yield judged(
        2,
        "moment of inertia (kg m²)",
        "specification",
        "1.579",
        (end + bar / 3.0) * length**2,
        note="M l² + m l²/3 for a point mass and a thin rod; the paper's is from a solid model",
    )
    yield judged(
        2,
        "centre of mass (m)",
        "specification",
        "0.4553",
        (end * length + 0.5 * bar * length) / (end + bar),
        note="for a point mass at the end; the printed one needs the end mass 50 mm nearer",
    )


def _table_3() -> Iterator[Cell]:
    kelvin = 26.0 + 273.15
    yield judged(
        3,
        "air density (kg/m³)",
        "specification",
        "1.180",
        moist_air_density(kelvin, 101325.0, 0.0),
        within="dry air at 1013.25 hPa; pressure and humidity are not printed",
        note="dry air at 1013.25 hPa; pressure and humidity are not printed",
    )
    yield judged(
        3,
        "air viscosity (N s/m²)",
        "specification",
        "0.00001852",
        moist_air_viscosity(kelvin, 101325.0, 0.0),
        note="Sutherland's law for dry air gives half a percent less",
    )


def _columns(name: str) -> list[str]:
    return [f"{angle} deg" for angle in BACKSWINGS_DEG]


def _simulated(name: str, kind: str, speeds: FloatArray) -> FloatArray:
    ball = BALLS[name]
    experiment = Experiment(ball)
    launch = impulsive_launch(experiment, speeds, np.asarray(law_of(ball, kind)(speeds)))
    return np.asarray(numerical_landing(experiment, launch).distance)


def _table_5() -> Iterator[Cell]:
    note = (
        "steps a to e with C_D 0.47, assumed contact times and the measured speeds of Table 6;"
        " see the investigation of Table 5"
    )
    for name in BALLS:
        speeds = measured_speeds(name)
        for kind in KINDS:
            ours = _simulated(name, kind, speeds)
            slope = np.diff(_simulated(name, kind, speeds[:, None] + [[-1e-3, 1e-3]]))[:, 0] / 2e-3
            for i, column in enumerate(_columns(name)):
                yield judged(
                    5,
                    f"{name} {kind}",
                    column,
                    TABLE_5[name][kind][i],
                    float(ours[i]),
                    input_rounding=float(slope[i]) * 1e-4,
                    note=note,
                )


def _table_5_percent() -> Iterator[Cell]:
    for name in BALLS:
        measured = TABLE_5[name]["experiment"]
        for kind in KINDS:
            for i, column in enumerate(_columns(name)):
                text, against = TABLE_5[name][kind][i], measured[i]
                yield _percent(5, f"{name} {kind}, %", column, text, against, name, kind, i)


def _percent(
    table: int, row: str, column: str, text: str, against: str, name: str, kind: str, i: int
) -> Cell:
    simulated, measured = float(text), float(against)
    allowed = 100.0 * (half_digit(text) / measured + simulated * half_digit(against) / measured**2)
    return judged(
        table,
        row,
        column,
        TABLE_5_PERCENT[name][kind][i],
        100.0 * (simulated - measured) / measured,
        input_rounding=allowed,
        note="the two printed distances give another percentage",
        beyond="slip in print",
    )


def _impulse(name: str, kind: str, speed: float) -> float:
    ball = BALLS[name]
    return float(external_impulse(EFFECTIVE_MASS, ball.mass, law_of(ball, kind)(speed), speed))


def _table_6() -> Iterator[Cell]:
    for name in BALLS:
        speeds = measured_speeds(name)
        for kind in KINDS:
            for i, column in enumerate(_columns(name)):
                text = TABLE_6[name][kind][i]
                speed = float(speeds[i])
                slope = (_impulse(name, kind, speed + 1e-4) - _impulse(name, kind, speed)) / 1e-4
                yield judged(
                    6,
                    f"{name} {kind}",
                    column,
                    text,
                    _impulse(name, kind, speed),
                    input_rounding=slope * 1e-4,
                    within=f"Eq. 9 at the measured speed of {speed:.4f} m/s that both rows imply",
                    note=f"Eq. 9 at {speed:.4f} m/s",
                )


def _table_6_rational() -> Iterator[Cell]:
    for name in BALLS:
        for kind in KINDS:
            for i, angle in enumerate(BACKSWINGS_DEG):
                speed = speed_by_rational(name, angle)
                bound = abs(_impulse(name, kind, speed) / speed) * _rational_rounding(name, angle)
                yield judged(
                    6,
                    f"{name} {kind}, speed by Eq. {EQUATION[name]}",
                    f"{angle} deg",
                    TABLE_6[name][kind][i],
                    _impulse(name, kind, speed),
                    input_rounding=bound,
                    note=f"the printed fit gives {speed:.4f} m/s, the table implies"
                    f" {measured_speeds(name)[i]:.4f} m/s",
                )


def _rational_rounding(name: str, angle: float) -> float:
    """How far the last digits of the coefficients of Eqs 26, 27 can move the speed, m/s."""
    halves = (0.0005, HALF_OF_P2[name], 0.00005, 0.05, 0.005)
    p1, p2, p3, q1, q2 = RATIONAL[name]
    below = angle**2 + q1 * angle + q2
    value = (p1 * angle**2 + p2 * angle + p3) / below
    weights = (angle**2, angle, 1.0, value * angle, value)
    return float(sum(w * h for w, h in zip(weights, halves, strict=True)) / below)


def _table_7() -> Iterator[Cell]:
    for name, ball in BALLS.items():
        for kind in KINDS:
            for i, impulse in enumerate(WANTED_IMPULSES[name]):
                text = TABLE_7[name][kind][i]
                ours = speed_for(ball, law_of(ball, kind), impulse)
                slip = (name, kind, impulse) in SLIPS
                yield judged(
                    7,
                    f"{name} {kind}",
                    f"{impulse} N s",
                    text,
                    ours,
                    input_rounding=ours * _COR_ROUNDING,
                    beyond="slip in print" if slip else "not reproducible from what is printed",
                    note="Eqs 9 and 25 give 2.378 m/s; the row's other cells agree to 0.02 %"
                    if slip
                    else "up to 0.15 % off, more at low impulse; perhaps read off the plot",
                    within="Eqs 9, 24, 25; the column is headed with a back-swing angle by mistake",
                )


def _table_8() -> Iterator[Cell]:
    for name, ball in BALLS.items():
        for kind in KINDS:
            for i, impulse in enumerate(WANTED_IMPULSES[name]):
                speed = speed_for(ball, law_of(ball, kind), impulse)
                angle = backswing_by_rational(name, speed)
                slope = (speed_by_rational(name, angle + 0.1) - speed) / 0.1
                yield judged(
                    8,
                    f"{name} {kind}",
                    f"{impulse} N s",
                    TABLE_8[name][kind][i],
                    angle,
                    input_rounding=_rational_rounding(name, angle) / slope,
                    note="Eqs 9, 24 to 27 as printed; the fit of speed by back-swing was another",
                )


def _table_9() -> Iterator[Cell]:
    for name, ball in BALLS.items():
        law = partial(_simulated, name, "variable")
        for i, distance in enumerate(WANTED_DISTANCES[name]):
            speed = speed_for_distance(distance, law, 0.3, 12.0)
            yield judged(
                9,
                ball.name,
                f"{distance} m",
                TABLE_9[name][i],
                backswing_by_rational(name, speed),
                note="rests on the simulation of Table 5 and on Eqs 26, 27, neither of which the"
                " printed numbers reproduce",
            )


def _table_10() -> Iterator[Cell]:
    for name in BALLS:
        for i, distance in enumerate(WANTED_DISTANCES[name]):
            text = TABLE_10[name][i]
            yield judged(
                10,
                f"{name}, %",
                f"{distance} m",
                TABLE_10_PERCENT[name][i],
                100.0 * (float(text) - distance) / distance,
                input_rounding=100.0 * half_digit(text) / distance,
                beyond="slip in print",
                note="the printed average gives another percentage",
            )


_INPUTS = (
    "impact_speed",
    "distance",
    "launch_angle",
    "support_height",
    "effective_mass",
    "ball_mass",
    "contact_time",
    "ball_diameter",
    "drag_coefficient",
    "air_density",
)

READING_STD = 5.0 / (2.0 * math.sqrt(6.0))

"""deg: a triangular distribution between the protractor's 5-degree marks (GUM 4.3.9)."""


@dataclass(frozen=True)
class Conclusion:
    """A sentence of the paper and what Eq. 17 says.

    Attributes
    ----------
    claim : str
    elasticity : dict of str to float
        Relative change of e per relative change of an input, by ball.
    holds : bool
    """

    claim: str
    elasticity: dict[str, float]
    holds: bool


@dataclass(frozen=True)
class SwingCheck:
    """A measured impact speed beside what a frictionless swing can give.

    Attributes
    ----------
    ball : str
    backswing_deg : int
    measured, limit : float
        m/s.
    backswing_needed_deg : float
        Back-swing from which a frictionless pendulum would reach the measured speed.
    flagged : bool
        Whether it is above the limit by more than the protractor's reading explains.
    """

    ball: str
    backswing_deg: int
    measured: float
    limit: float
    backswing_needed_deg: float
    flagged: bool


def _point(name: str, index: int = 2) -> RangeInputs:
    """Inputs of Eq. 17 at one printed distance; 90 deg unless told."""
    ball, speed = BALLS[name], float(measured_speeds(name)[index])
    return RangeInputs.of(
        PAPER_PENDULUM,
        ball,
        PAPER_SUPPORT,
        PAPER_AIR,
        distance=float(TABLE_5[name]["experiment"][index]),
        impact_speed=speed,
        contact_time=float(ball.contact_time(speed)),
        drag_coefficient=0.47,
    )


def _elasticities(name: str) -> dict[str, float]:
    point = _point(name)
    slopes, e = sensitivities(point), float(cor_from_range(point))
    return {key: slopes[key] * float(getattr(point, key)) / e for key in _INPUTS}


def conclusions() -> tuple[Conclusion, ...]:
    """The four sentences after Eq. 17, checked at the 90-deg point of both balls."""
    by_ball = {name: _elasticities(name) for name in BALLS}

    def of(key: str) -> dict[str, float]:
        return {name: values[key] for name, values in by_ball.items()}

    small = {name: max(abs(v[k]) for k in _INPUTS[-3:]) for name, v in by_ball.items()}
    claims = (
        ("COR falls as the colliding velocity rises", of("impact_speed"), -1),
        ("COR falls as the contact time rises", of("contact_time"), -1),
        ("COR rises with the mass of the ball", of("ball_mass"), 1),
    )
    checked = [
        Conclusion(claim, values, all(sign * value > 0.0 for value in values.values()))
        for claim, values, sign in claims
    ]
    last = "Cross section, air density and drag coefficient do not affect COR much"
    return (*checked, Conclusion(last, small, all(value < 0.3 for value in small.values())))


def swing_checks() -> tuple[SwingCheck, ...]:
    """All measured speeds against the frictionless swing from the printed back-swing angle."""
    found = []
    for name, ball in BALLS.items():
        for angle, speed in zip(BACKSWINGS_DEG, measured_speeds(name), strict=True):
            limit = float(
                frictionless_speed(PAPER_PENDULUM, math.radians(angle), ball.launch_angle)
            )
            needed = backswing_for_speed(PAPER_PENDULUM, float(speed), ball.launch_angle)
            degrees = math.degrees(needed)
            found.append(
                SwingCheck(name, angle, float(speed), limit, degrees, degrees - angle > READING_STD)
            )
    return tuple(found)


def implied_fits(name: str) -> tuple[CorFit, ...]:
    """Laws of restitution fitted to the four e that Table 6 implies, the preferred first.

    The uncertainty is that of the table's last digit.
    """
    ball, speeds = BALLS[name], measured_speeds(name)
    share = EFFECTIVE_MASS * ball.mass / (EFFECTIVE_MASS + ball.mass) * speeds
    impulse = np.array([float(text) for text in TABLE_6[name]["variable"]])
    std = np.asarray(1e-4 / math.sqrt(12.0) / share)
    return compare_cor_fits(speeds, np.asarray(impulse / share - 1.0), std)


def draw_sensitivities(path: Path) -> None:
    """Relative change of e per relative change of each input, both balls."""
    with saved_figure(path, 6.4, 3.8) as figure:
        axes = figure.subplots()
        places = np.arange(len(_INPUTS))
        bars = zip(BALLS, (BLUE, ORANGE), strict=True)
        for shift, (name, colour) in zip((-0.2, 0.2), bars, strict=True):
            values = _elasticities(name)
            axes.barh(
                places + shift, [values[key] for key in _INPUTS], 0.38, color=colour, label=name
            )
        axes.axvline(0.0, color="black", lw=0.8)
        axes.set_yticks(places, [key.replace("_", " ") for key in _INPUTS])
        axes.invert_yaxis()
        axes.set_xlabel("relative change of e per relative change of the input")
        axes.legend(loc="lower right")
