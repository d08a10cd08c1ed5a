"""The paper recomputed: its tables cell by cell, Table 5 investigated, figures.

Tables 2 to 10 are stored as printed (the number of digits matters), with the paper's four
conclusions on Eq. 17, its speeds compared with a frictionless swing, impact speeds that it implies,
its Eqs 26 and 27, and candidate explanations of the 16 simulated distances of Table 5. Figures show
our results as lines, the paper's as points.

``python -m pipelines.paper docs/model.md`` rewrites the generated parts of that page; run it after
a change of the physics.
"""

import json
import math
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
import typer
from matplotlib.axes import Axes
from rich.table import Table
from scipy.optimize import brentq

from metrology import UsageError, write_text_whole
from metrology.least_squares import minimise
from physics.air import (
    DRAG_CURVES,
    PAPER_AIR,
    SOCCER_LIFT,
    SUBCRITICAL_DRAG,
    moist_air_density,
    moist_air_viscosity,
)
from physics.bodies import (
    BALLS,
    PAPER_PENDULUM,
    PAPER_SUPPORT,
    Ball,
    lost_by_pendulum,
    lost_by_pendulum_approximate,
)
from physics.contact import ContactOutcome, contact_outcomes, external_impulse
from physics.cor_fit import CorLawFit, CorPoints, LawKind, fit_cor_laws
from physics.domain import FloatArray
from physics.flight import FlightPath, fly, land_many
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
    time_resolved_landing,
)
from physics.restitution import ConstantCor, CorLaw, ExponentialCor
from physics.swing import backswing_for_speed, frictionless_speed
from pipelines.doors import FileRole
from pipelines.model import BLUE, GRAY, ORANGE, saved_figure
from pipelines.terminal import screen

__all__ = [
    "BACKSWINGS_DEG",
    "FIGURES",
    "MAX_MISFIT_M",
    "PAPER_EFFECTIVE_MASS",
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
    "draw_figures",
    "draw_sensitivities",
    "fit_candidates",
    "half_digit",
    "implied_fits",
    "judge",
    "law_of",
    "measured_speeds",
    "paper_command",
    "sections",
    "speed_by_rational",
    "speed_for",
    "swing_checks",
]


BACKSWINGS_DEG = (30, 60, 90, 120)

"""Degrees: settings of Tables 5 to 8."""

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

"""N s: columns of Table 7."""

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

"""m: columns of Table 9."""

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

_NOT_REPRODUCIBLE: Verdict = "not reproducible from what is printed"


@dataclass(frozen=True)
class Cell:
    """A printed number with ours.

    Attributes
    ----------
    table : int
    row, column : str
    printed, ours, difference : float
        In the table's unit; the difference is ours − print.
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


def judge(
    table: int,
    row: str,
    column: str,
    printed: str,
    ours: float,
    *,
    input_rounding: float = 0.0,
    beyond: Verdict = _NOT_REPRODUCIBLE,
    note: str = "",
    within: str = "",
) -> Cell:
    """Compare a cell with the recomputed value.

    Parameters
    ----------
    table, row, column
        Position of the cell.
    printed : str
        The digits as printed.
    ours : float
        Recomputed.
    input_rounding : float
        Largest change of `ours` by the rounding of the printed inputs.
    beyond : Verdict
        Verdict if rounding does not explain the difference.
    note, within : str
        Notes if the difference is not explained, and if it is.
    """
    difference = ours - float(printed)
    half = half_digit(printed)
    verdict: Verdict
    if abs(difference) <= half * (1.0 + 1e-9):
        verdict, said = "reproduced", within
    elif abs(difference) <= half + input_rounding:
        verdict, said = "rounding", within or "within the rounding of its inputs"
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


PAPER_EFFECTIVE_MASS = PAPER_PENDULUM.mass_at_contact

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
        impulse_here = external_impulse(PAPER_EFFECTIVE_MASS, ball.mass, law(speed), speed)
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


MAX_MISFIT_M = {"simulated": 0.006, "experiment": 0.010}
"""m. The simulation ran "until the y coordinate is near to zero", up to one step late: 6 mm for a
step of 1 ms at 6 m/s. The experiment was read on a scale with 10 mm divisions. A candidate with a
larger difference from a printed distance is excluded."""

COR_KINDS = ("variable", "constant")


@dataclass(frozen=True)
class Explanation:
    """A candidate explanation and its fit.

    Attributes
    ----------
    name : str
    data : str
        "simulated" (16 numbers) or "experiment" (8 numbers).
    parameters : tuple of (str, float)
        Fitted values, by ball; SI, angles in degrees.
    rms, largest : float
        Residuals, m.
    allowed : bool
        Whether no residual exceeds `MAX_MISFIT_M`.
    physical : bool
        Whether the values are plausible for a lab (see `_FIT_BOUNDS`).
    """

    name: str
    data: str
    parameters: tuple[tuple[str, float], ...]
    rms: float
    largest: float
    allowed: bool
    physical: bool


_FIT_SCALES = {"origin": 0.05, "height": 0.02, "contact_time": 0.005, "drag": 0.3, "turn": 1.0}

"""m, m, s, factor and degree: approximate uncertainties left by the paper; scale the solver's
steps."""

_FIT_BOUNDS = {
    "origin": (-0.03, 0.03),
    "height": (-0.01, 0.01),
    "contact_time": (0.005, 0.03),
    "drag": (0.2, 0.6),
    "turn": (-1.0, 1.0),
}

"""Plausible ranges: a tape misread by 3 cm or 1 cm, 5 to 30 ms of contact, a sphere's C_D, a
degree of launch angle."""

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
    """One ball's rows: launch states before the fit."""

    experiment: Experiment
    rows: tuple[tuple[ContactOutcome, FloatArray], ...]


def _case(name: str, in_time: bool, data: str) -> _Case:
    rows = []
    for kind in COR_KINDS if data == "simulated" else ("variable",):
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
            values = {key: float(v) * _FIT_SCALES[key] for key, v in zip(free, vector, strict=True)}
            return np.concatenate(
                [_distances(case, out, in_time, values) - want for out, want in case.rows]
            )

        best = _minimum(misses, free)
        residuals.append(misses(best))
        found += [
            (f"{ball} {key}", float(v) * _FIT_SCALES[key])
            for key, v in zip(free, best, strict=True)
        ]
    every = np.concatenate(residuals)
    largest = float(np.max(np.abs(every)))
    inside = all(
        _FIT_BOUNDS[key.split(" ", 1)[1]][0] <= value <= _FIT_BOUNDS[key.split(" ", 1)[1]][1]
        for key, value in found
    )
    return Explanation(
        name,
        data,
        tuple(found),
        float(np.sqrt(np.mean(every**2))),
        largest,
        largest <= MAX_MISFIT_M[data],
        inside,
    )


def _minimum(misses: Callable[[FloatArray], FloatArray], free: tuple[str, ...]) -> FloatArray:
    if not free:
        return np.zeros(0)
    start = np.array([0.47 / _FIT_SCALES["drag"] if key == "drag" else 0.0 for key in free])
    start = np.array(
        [3.0 if key == "contact_time" else s for key, s in zip(free, start, strict=True)]
    )
    low = [0.0 if key in ("drag", "contact_time") else -np.inf for key in free]
    return minimise(misses, start, low=low).values


def fit_candidates(data: str = "simulated") -> tuple[Explanation, ...]:
    """Fit every candidate, with separate parameters for each ball.

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
    """Launch angles (deg) at the measured speeds: the paper's, and of the time-resolved contact."""
    ball = BALLS[name]
    speeds = measured_speeds(name)
    outcome = _launched(name, True, "variable")
    constant = np.full(speeds.shape, np.rad2deg(ball.launch_angle))
    return constant, np.rad2deg(np.asarray(outcome.launch_angle))


EQUATION = {"jokku": 26, "basketball": 27}

"""Number of the paper's equation for the impact speed from the back-swing, by ball."""

P2_ROUNDING = {"jokku": 0.05, "basketball": 0.005}
"""Half a unit of the last printed digit of p₂, by ball."""

SLIPS = frozenset({("basketball", "constant", 2.5)})

"""Cells of Table 7 that are misprinted: ball, law and impulse, N s."""

_COR_ROUNDING = 1.5e-4 / 1.7

"""Relative change of a speed by the last digits of Eqs 24, 25, which change e by up to 1.5e-4."""


def audit() -> tuple[Cell, ...]:
    """All cells of Tables 2 to 10 that follow from other printed numbers.

    Pure inputs (masses, lengths, measured distances, properties of balls) can't be recomputed and
    are not listed.

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
    yield judge(2, "total mass (kg)", "specification", "6.0", end + bar)
    yield judge(
        2,
        "effective mass (kg)",
        "specification",
        "5.1667",
        end + bar / 3.0,
        within="M + m/3; section IV prints M l² + m l²/3, which is a moment of inertia",
    )
    yield judge(
        2,
        "effective mass as I/L² (kg)",
        "specification",
        "5.1667",
        PAPER_PENDULUM.inertial_mass,
        input_rounding=PAPER_PENDULUM.inertial_mass * (0.0005 / 1.579 + 2 * 0.00005 / length),
        note="from Table 2's own inertia and length; a second reading, 0.46 % less",
    )
    yield judge(
        2,
        "moment of inertia (kg m²)",
        "specification",
        "1.579",
        (end + bar / 3.0) * length**2,
        note="M l² + m l²/3 for a point mass and a thin rod; the paper's is from a solid model",
    )
    yield judge(
        2,
        "centre of mass (m)",
        "specification",
        "0.4553",
        (end * length + 0.5 * bar * length) / (end + bar),
        note="for a point mass at the end; the printed one needs the end mass 50 mm nearer",
    )


def _table_3() -> Iterator[Cell]:
    kelvin = 26.0 + 273.15
    yield judge(
        3,
        "air density (kg/m³)",
        "specification",
        "1.180",
        moist_air_density(kelvin, 101325.0, 0.0),
        within="dry air at 1013.25 hPa; pressure and humidity are not printed",
        note="dry air at 1013.25 hPa; pressure and humidity are not printed",
    )
    yield judge(
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
        for kind in COR_KINDS:
            ours = _simulated(name, kind, speeds)
            slope = np.diff(_simulated(name, kind, speeds[:, None] + [[-1e-3, 1e-3]]))[:, 0] / 2e-3
            for i, column in enumerate(_columns(name)):
                yield judge(
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
        for kind in COR_KINDS:
            for i, column in enumerate(_columns(name)):
                text, against = TABLE_5[name][kind][i], measured[i]
                yield _percent(5, f"{name} {kind}, %", column, text, against, name, kind, i)


def _percent(
    table: int, row: str, column: str, text: str, against: str, name: str, kind: str, i: int
) -> Cell:
    simulated, measured = float(text), float(against)
    allowed = 100.0 * (half_digit(text) / measured + simulated * half_digit(against) / measured**2)
    return judge(
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
    return float(
        external_impulse(PAPER_EFFECTIVE_MASS, ball.mass, law_of(ball, kind)(speed), speed)
    )


def _table_6() -> Iterator[Cell]:
    for name in BALLS:
        speeds = measured_speeds(name)
        for kind in COR_KINDS:
            for i, column in enumerate(_columns(name)):
                text = TABLE_6[name][kind][i]
                speed = float(speeds[i])
                slope = (_impulse(name, kind, speed + 1e-4) - _impulse(name, kind, speed)) / 1e-4
                yield judge(
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
        for kind in COR_KINDS:
            for i, angle in enumerate(BACKSWINGS_DEG):
                speed = speed_by_rational(name, angle)
                bound = abs(_impulse(name, kind, speed) / speed) * _rational_rounding(name, angle)
                yield judge(
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
    """Largest change of the speed, m/s, by the last digits of the coefficients of Eqs 26, 27."""
    halves = (0.0005, P2_ROUNDING[name], 0.00005, 0.05, 0.005)
    p1, p2, p3, q1, q2 = RATIONAL[name]
    below = angle**2 + q1 * angle + q2
    value = (p1 * angle**2 + p2 * angle + p3) / below
    weights = (angle**2, angle, 1.0, value * angle, value)
    return float(sum(w * h for w, h in zip(weights, halves, strict=True)) / below)


def _table_7() -> Iterator[Cell]:
    for name, ball in BALLS.items():
        for kind in COR_KINDS:
            for i, impulse in enumerate(WANTED_IMPULSES[name]):
                text = TABLE_7[name][kind][i]
                ours = speed_for(ball, law_of(ball, kind), impulse)
                slip = (name, kind, impulse) in SLIPS
                yield judge(
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
        for kind in COR_KINDS:
            for i, impulse in enumerate(WANTED_IMPULSES[name]):
                speed = speed_for(ball, law_of(ball, kind), impulse)
                angle = backswing_by_rational(name, speed)
                slope = (speed_by_rational(name, angle + 0.1) - speed) / 0.1
                yield judge(
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
            yield judge(
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
            yield judge(
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

"""Degrees: triangular distribution between the protractor's 5-degree marks (GUM 4.3.9)."""


@dataclass(frozen=True)
class Conclusion:
    """A statement of the paper and the result of Eq. 17.

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
    """A measured impact speed and the limit of a frictionless swing.

    Attributes
    ----------
    ball : str
    backswing_deg : int
    measured, limit : float
        m/s.
    backswing_needed_deg : float
        Back-swing from which a frictionless pendulum reaches the measured speed.
    flagged : bool
        Whether it exceeds the limit by more than the protractor's reading explains.
    """

    ball: str
    backswing_deg: int
    measured: float
    limit: float
    backswing_needed_deg: float
    flagged: bool


def _point(name: str, index: int = 2) -> RangeInputs:
    """Inputs of Eq. 17 at one printed distance; default: 90 deg."""
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
    """Compare all measured speeds with a frictionless swing from the printed back-swing."""
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


def implied_fits(name: str) -> tuple[CorLawFit, ...]:
    """Laws of restitution fitted to the four e implied by Table 6, the preferred first.

    The uncertainty is that of the table's last digit.
    """
    ball, speeds = BALLS[name], measured_speeds(name)
    share = PAPER_EFFECTIVE_MASS * ball.mass / (PAPER_EFFECTIVE_MASS + ball.mass) * speeds
    impulse = np.array([float(text) for text in TABLE_6[name]["variable"]])
    std = np.asarray(1e-4 / math.sqrt(12.0) / share)
    points = CorPoints(
        speed=speeds,
        cor=np.asarray(impulse / share - 1.0),
        std=std,
        shared=np.zeros((len(speeds), 0)),
        session=np.zeros(len(speeds), dtype=np.int64),
    )
    return fit_cor_laws(points, strike_scatter=False)


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


_KIND_COLOURS = {"variable": BLUE, "constant": ORANGE}
_BACKSWINGS = np.array(BACKSWINGS_DEG, dtype=np.float64)


def _numbers(texts: tuple[str, ...]) -> FloatArray:
    return np.array([float(text) for text in texts])


def _grid(low: float, high: float) -> FloatArray:
    return np.linspace(low, high, 80)


def _speeds_by_energy(ball: Ball, degrees: FloatArray) -> FloatArray:
    return np.asarray(frictionless_speed(PAPER_PENDULUM, np.deg2rad(degrees), ball.launch_angle))


def _figure_2(axes: Axes, ball: Ball) -> None:
    reynolds = np.logspace(3.5, 6, 400)
    for curve, style in zip(DRAG_CURVES.values(), ("-", "--", ":"), strict=True):
        inside = (reynolds >= curve.valid[0]) & (reynolds <= curve.valid[1])
        axes.plot(reynolds, np.asarray(curve(reynolds)), color=GRAY, lw=0.7, ls=style)
        colour = {"smooth": "black", "soccer": BLUE, "basketball": ORANGE}[curve.name]
        axes.plot(
            reynolds[inside],
            np.asarray(curve(reynolds[inside])),
            style,
            color=colour,
            label=curve.name,
        )
    top = PAPER_AIR.reynolds(7.0, ball.diameter)
    axes.axvspan(PAPER_AIR.reynolds(1.8, ball.diameter), top, color=GRAY, alpha=0.15, lw=0)
    axes.text(top * 0.9, 0.02, "this experiment", ha="right", color=GRAY)
    axes.set(xscale="log", xlabel="Reynolds number", ylabel="drag coefficient", ylim=(0, 0.7))
    axes.legend(loc="upper right")


def _figure_5(axes: Axes, ball: Ball) -> None:
    parameter = _grid(0.0, 0.4)
    axes.plot(parameter, np.asarray(SOCCER_LIFT(parameter, 2e5)), color=BLUE, label="soccer ball")
    axes.plot(SOCCER_LIFT.spin_parameter, SOCCER_LIFT.lift, "o", color="black", ms=4)
    axes.plot(parameter, parameter, color=GRAY, ls=":", label="C_L = Sp")
    axes.set(xlabel="spin parameter Sp = ω r / v", ylabel="lift coefficient")
    axes.legend()


def _paper_flight(ball: Ball, speed: float, kind: str) -> tuple[Experiment, FlightPath]:
    experiment = Experiment(ball)
    launch = impulsive_launch(experiment, speed, float(law_of(ball, kind)(speed)))
    angle, advance = ball.launch_angle, float(launch.advance)
    flight = fly(
        experiment.flight,
        (advance * np.cos(angle), experiment.rest_height + advance * np.sin(angle), 0.0),
        (float(launch.speed) * np.cos(angle), float(launch.speed) * np.sin(angle), 0.0),
        floor=ball.radius,
    )
    return experiment, flight


def _figure_11(axes: Axes, ball: Ball) -> None:
    experiment, flight = _paper_flight(ball, float(measured_speeds(ball.name)[3]), "variable")
    speed = np.linalg.norm(flight.velocity, axis=1)
    share = 0.5 * experiment.air.density * ball.area * SUBCRITICAL_DRAG
    axes.plot(flight.time, share * speed * flight.velocity[:, 0], color=BLUE, label="drag, x")
    axes.plot(flight.time, share * speed * flight.velocity[:, 1], color=ORANGE, label="drag, y")
    axes.axhline(ball.mass * experiment.gravity, color=GRAY, label="weight")
    axes.set(xlabel="time of flight (s)", ylabel="force (N)")
    axes.legend(loc="center right")


def _figure_12(axes: Axes, ball: Ball) -> None:
    degrees = _grid(25, 125)
    speeds = _speeds_by_energy(ball, degrees)
    experiment = Experiment(ball)
    launch = impulsive_launch(experiment, speeds, np.asarray(ball.cor(speeds)))
    axes.plot(
        degrees,
        np.asarray(numerical_landing(experiment, launch).distance),
        color=BLUE,
        label="steps a to e",
    )
    some = np.linspace(25, 125, 12)
    _, landing = time_resolved_landing(experiment, _speeds_by_energy(ball, some))
    axes.plot(some, np.asarray(landing.distance), color=ORANGE, label="time-resolved contact")
    measured = _numbers(TABLE_5[ball.name]["experiment"])
    axes.plot(_BACKSWINGS, measured, "ko", ms=4, label="printed average")
    axes.set(xlabel="back-swing angle (deg)", ylabel="distance (m)")
    axes.legend()


def _figure_15(axes: Axes, ball: Ball) -> None:
    degrees = _grid(25, 125)
    speeds = _speeds_by_energy(ball, degrees)
    after = paper_impact(Experiment(ball), speeds)
    exact = np.asarray(lost_by_pendulum(PAPER_PENDULUM, speeds, after.speed_after))
    rough = np.asarray(lost_by_pendulum_approximate(PAPER_PENDULUM, speeds, after.impulse))
    axes.plot(degrees, exact, color=BLUE, label="½ I (ω₁² − ω₂²)")
    axes.plot(degrees, rough, color=ORANGE, ls="--", label="v_M⁰ F̃ (Eqs 20, 21)")
    axes.set(xlabel="back-swing angle (deg)", ylabel="energy lost by the pendulum (J)")
    axes.legend()


def _figure_16(axes: Axes, ball: Ball) -> None:
    degrees = _grid(25, 125)
    speeds = _speeds_by_energy(ball, degrees)
    after = paper_impact(Experiment(ball), speeds)
    axes.plot(degrees, speeds, color=BLUE, label="before, frictionless")
    axes.plot(degrees, np.asarray(after.speed_after), color=ORANGE, label="after")
    axes.plot(_BACKSWINGS, measured_speeds(ball.name), "ko", ms=4, label="implied by Table 6")
    axes.set(xlabel="back-swing angle (deg)", ylabel="speed of the pendulum (m/s)")
    axes.legend()


def _impulses(ball: Ball, kind: str, speeds: FloatArray) -> FloatArray:
    cor = np.asarray(law_of(ball, kind)(speeds))
    return np.asarray(external_impulse(PAPER_EFFECTIVE_MASS, ball.mass, cor, speeds))


def _figure_17(axes: Axes, ball: Ball) -> None:
    degrees = _grid(25, 125)
    axes.plot(degrees, _impulses(ball, "variable", _speeds_by_energy(ball, degrees)), color=BLUE)
    axes.plot(_BACKSWINGS, _numbers(TABLE_6[ball.name]["variable"]), "ko", ms=4)
    axes.set(xlabel="back-swing angle (deg)", ylabel="external impulse (N s)")


def _implied_cor(ball: Ball) -> FloatArray:
    impulse = _numbers(TABLE_6[ball.name]["variable"])
    speeds = measured_speeds(ball.name)
    share = PAPER_EFFECTIVE_MASS * ball.mass / (PAPER_EFFECTIVE_MASS + ball.mass)
    return np.asarray(impulse / (share * speeds) - 1.0)


def _figure_19(axes: Axes, ball: Ball) -> None:
    degrees = _grid(25, 125)
    axes.plot(degrees, np.asarray(ball.cor(_speeds_by_energy(ball, degrees))), color=BLUE)
    axes.plot(_BACKSWINGS, _implied_cor(ball), "ko", ms=4)
    axes.set(xlabel="back-swing angle (deg)", ylabel="coefficient of restitution")


def _figure_20(axes: Axes, ball: Ball) -> None:
    axes.plot(measured_speeds(ball.name), _implied_cor(ball), "ko-", ms=4, lw=0.8)
    axes.set(xlabel="speed of the pendulum (m/s)", ylabel="coefficient of restitution")


def _figure_21(axes: Axes, ball: Ball) -> None:
    speeds = _grid(0.0, 6.0)
    for kind in ("variable", "constant"):
        law = law_of(ball, kind)
        axes.plot(speeds, np.asarray(law(speeds)), color=_KIND_COLOURS[kind], label=f"{kind} COR")
    axes.plot(measured_speeds(ball.name), _implied_cor(ball), "ko", ms=4, label="by Table 6")
    axes.set(xlabel="speed of the pendulum (m/s)", ylabel="coefficient of restitution")
    axes.legend()


def _figure_22(axes: Axes, ball: Ball) -> None:
    for kind in ("variable", "constant"):
        for speed in measured_speeds(ball.name):
            _, flight = _paper_flight(ball, float(speed), kind)
            style = "-" if kind == "variable" else "--"
            x, y = flight.position[:, 0], flight.position[:, 1] - ball.radius
            first = f"steps a to e, {kind}" if speed == measured_speeds(ball.name)[0] else None
            axes.plot(x, y, style, color=_KIND_COLOURS[kind], lw=1.0, label=first)
        row = _numbers(TABLE_5[ball.name][kind])
        axes.plot(row, np.zeros(4), "|", color=_KIND_COLOURS[kind], ms=10, label=f"printed, {kind}")
    measured = _numbers(TABLE_5[ball.name]["experiment"])
    axes.plot(measured, np.zeros(4), "ko", ms=4, label="printed, experiment")
    axes.set(xlabel="x (m)", ylabel="height above the floor (m)", ylim=(-0.02, 0.62))
    axes.legend(loc="upper right", fontsize=8)


def _figure_23(axes: Axes, ball: Ball) -> None:
    speeds = _grid(0.2, 4.5)
    for kind, colour in _KIND_COLOURS.items():
        axes.plot(speeds, _impulses(ball, kind, speeds), color=colour, label=f"{kind} COR")
        points = _numbers(TABLE_6[ball.name][kind])
        axes.plot(measured_speeds(ball.name), points, "o", color=colour, mec="black", ms=4)
    axes.set(xlabel="collision velocity (m/s)", ylabel="external impulse (N s)")
    axes.legend()


def _figure_25(axes: Axes, ball: Ball) -> None:
    wanted = np.array(WANTED_IMPULSES[ball.name])
    impulses = np.linspace(0.3, float(wanted[-1]) * 1.1, 60)
    for kind, colour in _KIND_COLOURS.items():
        law = law_of(ball, kind)
        speeds = [speed_for(ball, law, float(j)) for j in impulses]
        axes.plot(impulses, speeds, color=colour, label=f"{kind} COR")
        points = _numbers(TABLE_7[ball.name][kind])
        axes.plot(wanted, points, "o", color=colour, mec="black", ms=4)
    axes.set(xlabel="external impulse (N s)", ylabel="collision velocity (m/s)")
    axes.legend()


def _figure_27(axes: Axes, ball: Ball) -> None:
    degrees = _grid(20, 140)
    fitted = [speed_by_rational(ball.name, float(b)) for b in degrees]
    axes.plot(degrees, fitted, color=BLUE, label="Eq. 26 or 27 as printed")
    axes.plot(degrees, _speeds_by_energy(ball, degrees), color=GRAY, ls=":", label="frictionless")
    axes.plot(_BACKSWINGS, measured_speeds(ball.name), "ko", ms=4, label="implied by Table 6")
    axes.set(xlabel="back-swing angle (deg)", ylabel="speed before impact (m/s)")
    axes.legend()


def _figure_28(axes: Axes, ball: Ball) -> None:
    wanted = np.array(WANTED_IMPULSES[ball.name])
    impulses = np.linspace(0.6 * float(wanted[0]), float(wanted[-1]) * 1.05, 60)
    for kind, colour in _KIND_COLOURS.items():
        law = law_of(ball, kind)
        angles = [
            backswing_by_rational(ball.name, speed_for(ball, law, float(j))) for j in impulses
        ]
        axes.plot(impulses, angles, color=colour, label=f"{kind} COR")
        points = _numbers(TABLE_8[ball.name][kind])
        axes.plot(wanted, points, "o", color=colour, mec="black", ms=4)
    axes.set(xlabel="external impulse (N s)", ylabel="back-swing angle (deg)")
    axes.legend()


def _figure_30(axes: Axes, ball: Ball) -> None:
    wanted = np.array(WANTED_DISTANCES[ball.name])
    axes.plot(wanted, wanted, color=GRAY, lw=0.8, label="desired")
    axes.plot(wanted, _numbers(TABLE_10[ball.name]), "ko", ms=4, label="printed average")
    axes.set(xlabel="desired distance (m)", ylabel="distance (m)")
    axes.legend()


Painter = Callable[[Axes, Ball], None]

FIGURES: dict[str, tuple[Painter, tuple[str, ...]]] = {
    "02": (_figure_2, ("basketball",)),
    "05": (_figure_5, ("basketball",)),
    "11": (_figure_11, ("jokku",)),
    "12": (_figure_12, tuple(BALLS)),
    "15": (_figure_15, tuple(BALLS)),
    "16": (_figure_16, tuple(BALLS)),
    "17": (_figure_17, tuple(BALLS)),
    "19": (_figure_19, tuple(BALLS)),
    "20": (_figure_20, tuple(BALLS)),
    "21": (_figure_21, tuple(BALLS)),
    "22": (_figure_22, tuple(BALLS)),
    "23": (_figure_23, ("jokku",)),
    "24": (_figure_23, ("basketball",)),
    "25": (_figure_25, ("jokku",)),
    "26": (_figure_25, ("basketball",)),
    "27": (_figure_27, tuple(BALLS)),
    "28": (_figure_28, ("jokku",)),
    "29": (_figure_28, ("basketball",)),
    "30": (_figure_30, ("jokku",)),
    "31": (_figure_30, ("basketball",)),
}
"""Painter and balls by figure number. Figs 13, 14 and 18 have no printed numbers."""


def draw_figures(folder: Path, only: tuple[str, ...] = ()) -> tuple[Path, ...]:
    """Draw the figures into `folder` as PNG.

    Parameters
    ----------
    folder : Path
        Created if it does not exist.
    only : tuple of str
        Figure numbers ("05"); empty for all.

    Returns
    -------
    tuple of Path
        Files written.

    Raises
    ------
    UsageError
        If the folder can't be created.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise UsageError(
            f"can't create the folder {folder}: {problem.strerror}",
            hint="Pass a writable folder as --figures.",
        ) from problem
    files = []
    for number, (painter, balls) in FIGURES.items():
        if only and number not in only:
            continue
        path = folder / f"figure_{number}.png"
        with saved_figure(path, width=4.8 * len(balls), height=3.4) as figure:
            panels: Any = np.ravel(figure.subplots(1, len(balls), squeeze=False))
            for axes, name in zip(panels, balls, strict=True):
                painter(axes, BALLS[name])
                if number not in ("02", "05"):
                    axes.set_title(name, fontsize=9)
        files.append(path)
    return tuple(files)


def paper_document(
    cells: tuple[Cell, ...], explanations: tuple[Explanation, ...]
) -> dict[str, Any]:
    """The contract's JSON plus the candidates for Table 5 and the checks of the text."""
    return {
        "cells": as_rows(cells),
        "table_5": [
            {
                "candidate": e.name,
                "data": e.data,
                "parameters": dict(e.parameters),
                "rms_m": e.rms,
                "largest_m": e.largest,
                "allowed": e.allowed,
                "believable_values": e.physical,
            }
            for e in explanations
        ],
        "conclusions": [asdict(conclusion) for conclusion in conclusions()],
        "swing": [asdict(check) for check in swing_checks()],
    }


def _cell_table(cells: tuple[Cell, ...], number: int, notes: list[str]) -> Table:
    table = Table(title=f"Table {number}")
    for name, justify in (("row", "left"), ("column", "left")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    for name in ("print", "ours", "difference"):
        table.add_column(name, justify="right")
    table.add_column("verdict")
    table.add_column("note", justify="right")
    for cell in cells:
        if cell.table == number:
            mark = str(notes.index(cell.note) + 1) if cell.note else ""
            table.add_row(
                cell.row,
                cell.column,
                f"{cell.printed:.6g}",
                f"{cell.ours:.6g}",
                f"{cell.difference:+.2g}",
                cell.verdict,
                mark,
            )
    return table


def _candidate_table(explanations: tuple[Explanation, ...]) -> Table:
    table = Table(title="Table 5: candidate explanations")
    for name in ("data", "candidate"):
        table.add_column(name)
    for name in ("rms (mm)", "largest (mm)"):
        table.add_column(name, justify="right")
    table.add_column("verdict")
    for e in explanations:
        verdict = "allowed" if e.allowed else "excluded"
        if e.allowed and not e.physical:
            verdict = "fits with implausible values"
        table.add_row(e.data, e.name, f"{e.rms * 1e3:.1f}", f"{e.largest * 1e3:.1f}", verdict)
    return table


def paper_command(
    json_to: Annotated[
        str | None,
        typer.Option("--json", help="Cells as JSON; - for stdout.", metavar="FILE"),
        FileRole.WRITES,
    ] = None,
    csv_to: Annotated[
        Path | None, typer.Option("--csv", help="Cells as CSV."), FileRole.WRITES
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Draw the figures into this folder.", metavar="DIR")
    ] = None,
    table: Annotated[int | None, typer.Option(help="Show only this table.", metavar="N")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print no tables.")] = False,
) -> None:
    """Recompute every table of the paper, compare with the print, and redraw its figures.

    Example: vision paper --table 6 --figures figures
    """
    cells = audit()
    if table is not None:
        if table not in {cell.table for cell in cells}:
            raise UsageError(
                f"there is no table {table} to recompute", hint="Pass --table 2 to 10."
            )
        cells = tuple(cell for cell in cells if cell.table == table)
    explained = table in (None, 5)
    candidates = (*fit_candidates("simulated"), *fit_candidates("experiment")) if explained else ()
    document = json.dumps(
        paper_document(cells, candidates), indent=2, ensure_ascii=False, allow_nan=False
    )
    if csv_to is not None:
        _write_csv(csv_to, cells)
    if figures is not None:
        draw_figures(figures)
        draw_sensitivities(figures / "sensitivity_of_cor.png")
    if json_to not in (None, "-"):
        write_text_whole(Path(str(json_to)), document + "\n")
    if json_to == "-":
        sys.stdout.write(document + "\n")
    elif not quiet:
        _show(cells, candidates)


def _write_csv(path: Path, cells: tuple[Cell, ...]) -> None:
    import pandas as pd

    write_text_whole(path, pd.DataFrame(as_rows(cells)).to_csv(index=False))


def _show(cells: tuple[Cell, ...], candidates: tuple[Explanation, ...]) -> None:
    console = screen()
    for number in sorted({cell.table for cell in cells}):
        notes = list(dict.fromkeys(c.note for c in cells if c.table == number and c.note))
        console.print(_cell_table(cells, number, notes))
        for count, note in enumerate(notes, 1):
            console.print(f"  {count}: {note}")
    if candidates:
        console.print(_candidate_table(candidates))
    for conclusion in conclusions():
        values = ", ".join(f"{name} {value:+.3f}" for name, value in conclusion.elasticity.items())
        word = "holds" if conclusion.holds else "does not hold"
        console.print(f"{conclusion.claim}: {word} ({values})")
    for check in swing_checks():
        if check.flagged:
            console.print(
                f"{check.ball}, {check.backswing_deg} deg: the measured {check.measured:.4f} m/s"
                f" exceeds the frictionless limit of {check.limit:.4f} m/s; it would need"
                f" {check.backswing_needed_deg:.1f} deg",
            )
    for verdict, count in Counter(cell.verdict for cell in cells).most_common():
        console.print(f"{count:4d} cells: {verdict}")


PAGE_FIGURES = ("02", "05", "12", "22", "27")
"""Figures shown on the model page."""


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def _audit_section(cells: tuple[Cell, ...]) -> str:
    counts = Counter((cell.table, cell.verdict) for cell in cells)
    verdicts = list(dict.fromkeys(cell.verdict for cell in cells))
    tables = sorted({cell.table for cell in cells})
    return _table(
        ("table", *verdicts),
        [(str(t), *(str(counts.get((t, v), 0)) for v in verdicts)) for t in tables],
    )


def _candidates_section() -> str:
    rows = []
    for data in ("simulated", "experiment"):
        for e in fit_candidates(data):
            if not e.allowed:
                verdict = "excluded"
            else:
                verdict = "allowed" if e.physical else "fits with implausible values"
            count = str(len(e.parameters))
            rows.append(
                (data, e.name, count, f"{e.rms * 1e3:.1f}", f"{e.largest * 1e3:.1f}", verdict)
            )
    limits = ", ".join(f"{name} {value * 1e3:.0f} mm" for name, value in MAX_MISFIT_M.items())
    header = ("distances", "candidate", "parameters", "rms (mm)", "largest (mm)", "verdict")
    return f"Largest difference allowed: {limits}.\n\n{_table(header, rows)}"


def _launch_section() -> str:
    rows = []
    for name in BALLS:
        constant, turned = contact_candidate(name)
        for speed, fixed, angle in zip(measured_speeds(name), constant, turned, strict=True):
            rows.append((name, f"{speed:.3f}", f"{fixed:.1f}", f"{angle:.1f}"))
    header = ("ball", "impact speed (m/s)", "paper's launch angle (deg)", "time-resolved (deg)")
    return _table(header, rows)


def _conclusions_section() -> str:
    rows = [
        (
            c.claim,
            *(f"{c.elasticity[name]:+.3f}" for name in BALLS),
            "holds" if c.holds else "does not hold",
        )
        for c in conclusions()
    ]
    return _table(("claim", *BALLS, "verdict"), rows)


def _swing_section() -> str:
    rows = [
        (
            check.ball,
            str(check.backswing_deg),
            f"{check.measured:.4f}",
            f"{check.measured / check.limit:.4f}",
            f"{check.backswing_needed_deg:.1f}",
            "too fast" if check.flagged else "",
        )
        for check in swing_checks()
    ]
    header = ("ball", "back-swing (deg)", "speed (m/s)", "relative to limit", "needs (deg)", "flag")
    return _table(header, rows)


def _fits_section() -> str:
    rows = []
    for name in BALLS:
        for fit in implied_fits(name):
            values = ", ".join(
                f"{key} {p.value:.4f} ({p.low:.4f} to {p.high:.4f})"
                for key, p in fit.parameters.items()
                if fit.law is not LawKind.FREE
            )
            rows.append((name, str(fit.law), values, f"{fit.probability:.3g}"))
    return _table(("ball", "law", "parameters (95 %)", "probability"), rows)


def sections() -> dict[str, str]:
    """All generated parts by the name in their markers."""
    return {
        "launch": _launch_section(),
        "conclusions": _conclusions_section(),
        "fits": _fits_section(),
        "swing": _swing_section(),
        "table-5": _candidates_section(),
        "audit": _audit_section(audit()),
    }


def fill_sections(text: str, parts: dict[str, str]) -> str:
    """Replace the text between ``<!-- NAME:begin -->`` and ``<!-- NAME:end -->``.

    Raises
    ------
    UsageError
        If a marker is missing.
    """
    for name, part in parts.items():
        pattern = re.compile(f"(<!-- {name}:begin -->).*?(<!-- {name}:end -->)", re.DOTALL)
        found = pattern.search(text)
        if found is None:
            raise UsageError(
                f"the page has no markers for {name!r}",
                hint=f"Add <!-- {name}:begin --> and <!-- {name}:end -->.",
            )
        begin, end = (f"<!-- {name}:{edge} -->" for edge in ("begin", "end"))
        text = "".join((text[: found.start()], begin, "\n", part, "\n", end, text[found.end() :]))
    return text


def refresh(page: Path) -> None:
    """Rewrite the page's generated parts and draw its figures next to it."""
    write_text_whole(page, fill_sections(page.read_text(encoding="utf-8"), sections()))
    folder = page.parent / "pictures"
    for path in draw_figures(folder, only=PAGE_FIGURES):
        path.replace(folder / f"model_{path.name}")
    draw_sensitivities(folder / "model_sensitivity.png")


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    refresh(Path(sys.argv[1]))
