"""`vision law`: fit a law of restitution to strikes, heights or bounce times."""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from measuring.setup.cor_file import ball_law, write_cor_file
from measuring.setup.file import meant_name, setup_from
from measuring.setup.tables import BallSetup, Setup
from metrology import (
    DomainError,
    Quantity,
    TooLittleDataError,
    UsageError,
    parse_quantity,
)
from metrology.quantity import format_pair
from physics.bodies import BALLS, GRAVITY, PAPER_PENDULUM
from physics.cor_fit import (
    AveragedLaw,
    CorLawFit,
    CorPoints,
    LackOfFit,
    LawKind,
    fit_cor_laws,
    lack_of_fit,
    repeated_levels,
)
from physics.rebound import FallingBall
from pipelines.doors import FileRole as _FileRole
from pipelines.doors import QuietOption, ReportOption, ResultsJsonOption, SetupFileOption
from pipelines.interop.sheets import read_table
from pipelines.interop.tables import plain_name, unit_of
from pipelines.measure.files import software_version
from pipelines.report.inputs import ReportInput
from pipelines.report.page import write_report
from pipelines.terminal import screen, write_json

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pipelines.report.plots import Panel, Picture

__all__ = ["LAW_FORMULAS", "BallTableLaw", "TableLaws", "law", "law_command"]

FloatArray = NDArray[np.float64]

_NAMES = {
    "impact_speed": "impact_speed impact_velocity v_in vin v0 v_0 speed_in speed_before v speed"
    " pendulum_speed_before velocity v_impact aufprallgeschwindigkeit auftreffgeschwindigkeit"
    " vitesse_d_impact vitesse_impact velocidad_de_impacto",
    "rebound_speed": "rebound_speed rebound_velocity v_out vout v1 v_1 speed_out speed_after"
    " ruckprallgeschwindigkeit vitesse_de_rebond velocidad_de_rebote",
    "ball_speed": "ball_speed ball_velocity v_ball v_b vb ballgeschwindigkeit"
    " vitesse_de_la_balle velocidad_de_la_pelota",
    "pendulum_speed_after": "pendulum_speed_after",
    "cor": "cor e restitution coefficient_of_restitution stosszahl stosskoeffizient"
    " restitutionskoeffizient coefficient_de_restitution coeficiente_de_restitucion",
    "cor_std": "cor_std e_std",
    "drop_height": "drop_height h0 h_0 height release_height h_drop height_drop initial_height"
    " fallhohe anfangshohe hauteur_de_chute hauteur_initiale altura_inicial altura_de_caida",
    "rebound_height": "rebound_height h1 h_1 bounce_height h_rebound rebound height_rebound"
    " rucksprunghohe ruckprallhohe sprunghohe hauteur_de_rebond altura_de_rebote",
    "time_before": "time_before t_before flight_before",
    "time_after": "time_after t_after flight_after",
    "interval": "time_between_bounces interval dt delta_t flight_time time_of_flight flugzeit"
    " temps_de_vol tiempo_de_vuelo",
    "bounce_time": "bounce_time time_of_bounce t_bounce impact_time",
    "ball": "ball object body kugel balle ballon pelota bola",
    "session": "session day series run sitzung serie",
    "level": "level setting backswing backswing_deg backswing_angle backswing_angle_deg auslenkung",
    "unit": "unit units",
}
"""Column names that are recognised, without their unit."""

_SI = {
    **dict.fromkeys(("impact_speed", "rebound_speed", "ball_speed", "pendulum_speed_after"), "m/s"),
    **dict.fromkeys(("drop_height", "rebound_height"), "m"),
    **dict.fromkeys(("time_before", "time_after", "interval", "bounce_time"), "s"),
    **dict.fromkeys(("cor", "cor_std"), "1"),
}
_MAX_WITHOUT_UNIT = {"m": 10.0, "s": 10.0, "m/s": 60.0}
"""Largest usual value if no unit is written (chosen: what is dropped by hand, or hit)."""

_SPEED_SUFFIX = re.compile(r"_(m|cm|mm|km)_(s|h)$", re.IGNORECASE)
_LENGTH_SUFFIX = re.compile(r"_(mm|cm|m|ms|s|in|ft)$", re.IGNORECASE)

_DRAG_STD = 0.12
"""Relative standard uncertainty of a ball's drag: sports balls below the drag crisis have C_D of
0.40 to 0.60, a rectangular distribution of half-width 20 %."""

_MAX_SPEED_GAP = 5.0
"""Ratio of neighbouring impact speeds from which units are mixed (chosen: between heights in cm and
m that span a factor of four it is 5, between speeds of one apparatus at most 4)."""

_MIN_RELATIVE_COR = 0.2
"""Fraction of the median e below which a row's own readings differ in unit: 0.1 for cm and m."""

_FITS = 0.01
"""Significance of the lack-of-fit test (convention)."""

_NONE_FITS = 0.95
"""Probability of the free form from which no parametric law is offered (convention)."""

_LAW_SPEEDS = 9
"""Number of speeds in `cor_at`, evenly across the range; the levels' speeds are added."""

MAX_STRIKES = 20_000
"""Rows of a table of strikes (chosen): a machine that strikes all day makes as many."""

_MAX_LEVEL_SPEEDS = 50
"""Maximum number of levels listed in `cor_at`."""

LAW_FORMULAS = {
    LawKind.EXPONENTIAL: "e = a exp(-b v) + d",
    LawKind.POWER: "e = 1 - a v^(1/5)",
    LawKind.LINEAR: "e = d + k v",
    LawKind.CONSTANT: "e = d",
    LawKind.FREE: "smooth monotone curve through e1 ... e9, evenly over the speeds",
}


@dataclass(frozen=True, eq=False)
class BallTableLaw:
    """The laws of one ball of a table.

    Attributes
    ----------
    fits : tuple of CorLawFit
        The most probable first; empty with too few rows.
    reason : str or None
        Why there is no law.
    air : str
        What was done about drag.
    """

    name: str
    points: CorPoints
    fits: tuple[CorLawFit, ...]
    tests: Mapping[LawKind, LackOfFit]
    reason: str | None
    air: str

    @property
    def parametric(self) -> CorLawFit:
        """The most probable parametric law."""
        return next(fit for fit in self.fits if fit.law is not LawKind.FREE)

    @property
    def test(self) -> LackOfFit:
        """Lack of fit of the most probable parametric law."""
        return self.tests[self.parametric.law]

    @property
    def none_fits(self) -> bool:
        """Whether the data exclude every parametric law in favour of another smooth curve."""
        return self.fits[0].law is LawKind.FREE and self.fits[0].probability >= _NONE_FITS

    @property
    def statement(self) -> str:
        """The result in one or two sentences."""
        first, test = self.fits[0], self.test
        share = min(first.probability, 0.99)
        if self.none_fits:
            text = (
                "None of the parametric laws fits; a smooth monotone curve does (probability"
                f" {share:.2f} or more)."
            )
        else:
            text = f"Most probable law: {first.law}, {LAW_FORMULAS[first.law]}"
            text += f" (probability {first.probability:.2f})."
        if test.p is not None and test.p < _FITS:
            spread = first.level_scatter.value
            text += (
                f" The level means differ from the best parametric law by more than the repeats"
                f" allow (lack-of-fit p = {test.p:.2g}): no law in the speed alone fits them; they"
                f" vary by {spread:.3f} from level to level, which the band includes."
                if not self.none_fits
                else f" Lack-of-fit p = {test.p:.2g}."
            )
        return text

    def speeds(self) -> list[float]:
        """Speeds of `cor_at`, m/s."""
        low, high = self.fits[0].speeds
        grid = set(np.linspace(low, high, _LAW_SPEEDS).tolist())
        if self.points.level is not None:
            levels = np.unique(self.points.level)
            if len(levels) <= _MAX_LEVEL_SPEEDS:
                grid |= {float(self.points.speed[self.points.level == k].mean()) for k in levels}
        # a level at an end of the range is in the grid, too, but for its last digit
        return sorted({round(speed, 9) for speed in grid})

    def to_dict(self) -> dict[str, Any]:
        """JSON of the ball (contract)."""
        rows = len(self.points.speed)
        if not self.fits:
            return {"law": None, "reason": self.reason, "rows": rows}
        fit, averaged = self.fits[0], AveragedLaw(self.fits)
        level = self.points.level
        return {
            **fit.to_dict(),
            "statement": self.statement,
            "formula": LAW_FORMULAS[fit.law],
            "probability": fit.probability,
            "none_of_the_parametric_laws_fits": self.none_fits,
            "laws": {
                str(one.law): {
                    "probability": one.probability,
                    "lack_of_fit_p": None if one.law is LawKind.FREE else self.tests[one.law].p,
                }
                for one in self.fits
            },
            "cor_at": [self._at(averaged, speed) for speed in self.speeds()],
            "lack_of_fit_p": self.test.p,
            "lack_of_fit_reason": self.test.reason,
            "rows": rows,
            "levels": None if level is None else len(np.unique(level)),
            "sessions": len(np.unique(self.points.session)),
            "air": self.air,
        }

    def _at(self, averaged: AveragedLaw, speed: float) -> dict[str, Any]:
        following = averaged.next_strike(speed)
        return {
            "speed": speed,
            **averaged.level_mean(speed, self.points.repeats).to_dict(),
            "law_std": averaged.at(speed).std,
            "next_strike_95": [following.low, following.high],
        }


@dataclass(frozen=True, eq=False)
class TableLaws:
    """Laws of restitution of all balls of a table.

    Attributes
    ----------
    name : str
        Of the table.
    """

    name: str
    balls: Mapping[str, BallTableLaw]
    warnings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """JSON document (contract)."""
        return {
            "balls": {name: ball.to_dict() for name, ball in self.balls.items()},
            "warnings": list(self.warnings),
            "software": {"version": software_version()},
        }

    def save(self, path: str | PathLike[str]) -> None:
        """Write the laws as ``cor.toml``, for `simulate`, `plan` and `explain`."""
        known = {name: ball_law(name, ball.fits) for name, ball in self.balls.items() if ball.fits}
        write_cor_file(Path(path), known)

    def plot(self) -> "Picture":
        """Data, law and 95 % band of all balls."""
        from pipelines.report.plots import Picture

        figure = Picture(figsize=(7.0, 4.2), dpi=130, layout="constrained")
        self._draw(figure.subplots())
        figure.axes[0].legend()
        return figure

    def report(self, path: str | PathLike[str]) -> None:
        """Write the report page with one figure."""
        known = {name: ball for name, ball in self.balls.items() if ball.fits}
        facts = tuple(
            (name, f"{ball.statement} {ball.air}. {_test_text(ball)}")
            for name, ball in known.items()
        )
        quantities = [
            quantity for name, ball in self.balls.items() for quantity in _quantities(name, ball)
        ]
        panel: Panel = (
            "Coefficient of restitution: data, law and 95 % band of level means",
            self._draw,
        )
        page = ReportInput(
            title=f"Law of restitution from {self.name}",
            facts=facts,
            quantities=tuple(quantities),
            warnings=self.warnings,
            version=software_version(),
        )
        write_report(Path(path), page, [panel])

    def _draw(self, axes: "Axes") -> None:
        from pipelines.report.plots import BLUE, GREEN, ORANGE, PINK

        colours = (BLUE, ORANGE, GREEN, PINK)
        for number, (name, ball) in enumerate(self.balls.items()):
            colour, points = colours[number % len(colours)], ball.points
            axes.plot(points.speed, points.cor, "o", ms=2.6, alpha=0.6, color=colour, lw=0)
            if not ball.fits:
                continue
            grid = np.linspace(*ball.fits[0].speeds, 40)
            averaged = AveragedLaw(ball.fits)
            band = [averaged.level_mean(v, points.repeats) for v in grid]
            label = f"{name}: {'free form' if ball.none_fits else ball.fits[0].law}"
            axes.plot(grid, [averaged.at(v).value for v in grid], color=colour, lw=1.4, label=label)
            axes.fill_between(
                grid, [e.low for e in band], [e.high for e in band], color=colour, alpha=0.2, lw=0
            )
        axes.set_xlabel("impact speed / (m/s)")
        axes.set_ylabel("coefficient of restitution")


def _test_text(ball: BallTableLaw) -> str:
    if ball.test.p is None:
        return f"No lack-of-fit test: {ball.test.reason}"
    return f"Lack-of-fit p of the {ball.parametric.law} law: {ball.test.p:.2g}"


def _quantities(name: str, ball: BallTableLaw) -> list[Quantity]:
    if not ball.fits:
        return [Quantity.missing(f"law of {name}", "1", ball.reason or "")]
    fit, averaged = ball.fits[0], AveragedLaw(ball.fits)
    units = {"b": "s/m", "k": "s/m"}
    found = [
        Quantity(f"{name}: {key} of the {fit.law} law", item.value, item.std, units.get(key, "1"))
        for key, item in fit.parameters.items()
    ]
    for speed in np.linspace(*fit.speeds, 3):
        at = averaged.level_mean(float(speed), ball.points.repeats)
        found.append(Quantity(f"{name}: e at {speed:.2f} m/s", at.value, at.std, "1"))
    return found


def law(
    table: "pd.DataFrame | str | PathLike[str]",
    *,
    setup: "Setup | str | PathLike[str] | None" = None,
    speeds_from: str | None = None,
) -> TableLaws:
    """Fit laws of restitution to a table.

    Parameters
    ----------
    table : DataFrame or path
        Strikes (impact speed with e, rebound speed or ball speed), drop and rebound heights, or
        times between bounces; optional columns ball, session, level.
    setup : Setup or path, optional
        Masses and diameters of the balls, pendulum, air.
    speeds_from : str, optional
        "heights" or "times": speeds and e in the table were computed from these without air.

    Raises
    ------
    UsageError
        If the table can't be used; TooLittleDataError if no ball has enough rows.
    """
    if speeds_from not in (None, "heights", "times"):
        raise UsageError(
            f"speeds from {speeds_from!r}?", hint="Write heights or times, or leave it out."
        )
    name, notes = "the table", list[str]()
    if not isinstance(table, pd.DataFrame):
        name = Path(table).name
        table = read_table(Path(table), "a table of strikes", notes)
    if len(table) > MAX_STRIKES:
        raise UsageError(
            f"{name} has {len(table):,} rows; a law is fitted to at most {MAX_STRIKES:,}",
            hint="Give one row per strike, not per frame; or average the repeats of each level.",
        )
    known = setup_from(setup)
    reader = _Reader(table, known, name, speeds_from)
    balls = {ball: _fitted(ball, *read) for ball, read in reader.balls().items()}
    if not any(ball.fits for ball in balls.values()):
        reasons = "; ".join(f"{ball}: {one.reason}" for ball, one in balls.items())
        raise TooLittleDataError(
            f"{name}: no law of restitution ({reasons})",
            hint="Measure at least three strikes, better five at each of three speeds.",
        )
    warnings = [*notes, *reader.warnings]
    for ball, one in balls.items():
        if not one.fits:
            warnings.append(f"{ball}: no law: {one.reason}.")
        elif np.ptp(one.points.speed) == 0:
            warnings.append(f"{ball}: one impact speed only; a law needs several, better three.")
    return TableLaws(name, balls, tuple(warnings))


def _fitted(name: str, points: CorPoints, air: str) -> BallTableLaw:
    try:
        fits = fit_cor_laws(points)
    except TooLittleDataError as problem:
        return BallTableLaw(name, points, (), {}, problem.message, air)
    tests: dict[LawKind, LackOfFit] = {}
    tests |= {fit.law: lack_of_fit(fit.law, points) for fit in fits if fit.law is not LawKind.FREE}
    return BallTableLaw(name, points, fits, tests, None, air)


@dataclass
class _Reader:
    """A table with recognised columns."""

    table: pd.DataFrame
    setup: Setup
    name: str
    speeds_from: str | None
    warnings: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.table = self.table.dropna(how="all").reset_index(drop=True)
        self.columns = _recognised([str(one) for one in self.table.columns], self.name)
        if len(self.table) == 0:
            raise TooLittleDataError(
                f"{self.name} has a header but no rows", hint="Write one row per strike."
            )
        self.values = {key: self._numbers(key) for key in self.columns if key in _SI}
        self.kind = self._kind()

    def _numbers(self, key: str) -> FloatArray:
        """A column in SI units; NaN where it is empty."""
        head = self.columns[key]
        unit, cells = _unit(head, _SI[key]), self.table[head]
        own = self.table[self.columns["unit"]] if "unit" in self.columns else None
        if own is not None and key != "cor":
            cells = cells.astype(str) + " " + own.astype(str)
        numbers = np.full(len(cells), np.nan)
        with_unit = np.zeros(len(cells), dtype=bool)
        for row, cell in enumerate(cells.tolist()):
            if cell is None or (isinstance(cell, float) and math.isnan(cell)):
                continue
            text = str(cell).strip().replace(",", ".")
            if not text or text.lower().split()[0] in ("nan", "na", "n/a", "-"):
                continue
            try:
                numbers[row] = float(text)
            except ValueError:
                with_unit[row] = True
                try:
                    numbers[row] = parse_quantity(text, _SI[key])
                except UsageError as problem:
                    raise UsageError(
                        f"{self.name}, row {row + 1}: {head} is {cell!r}, not a number"
                        f" ({problem.message})",
                        hint="Correct the cell, or leave it empty.",
                    ) from problem
        bare = np.isfinite(numbers) & ~with_unit
        if with_unit.any() and bare.any() and _unit(head, "") == "":
            raise UsageError(
                f"{self.name}: {head} has a unit in row {int(np.argmax(with_unit)) + 1} and none in"
                f" row {int(np.argmax(bare)) + 1}",
                hint="Write the unit once, in the head: 'drop_height (cm)'.",
            )
        if _SI[key] == "1":
            factor = 0.01 if "%" in head else 1.0
        else:
            factor = parse_quantity(f"1 {unit}", _SI[key])
            if unit == _SI[key] and own is None and not _states_unit(head):
                self._refuse_without_unit(key, numbers[bare])
        numbers[bare] *= factor
        return numbers

    def _refuse_without_unit(self, key: str, numbers: FloatArray) -> None:
        """Refuse numbers without a unit that are too large for the one that would be assumed."""
        unit = _SI[key]
        if not len(numbers) or np.median(numbers) <= _MAX_WITHOUT_UNIT[unit]:
            return
        usual = {"m": "(cm)' or '(mm)", "s": "(ms)", "m/s": "(cm/s)' or '(km/h)"}[unit]
        raise UsageError(
            f"{self.name}: {self.columns[key]!r} states no unit, and {np.median(numbers):.4g}"
            f" {unit} can't be",
            hint=f"Write its unit behind its name in the first line, such as '{usual}'.",
        )

    def _kind(self) -> str:
        have = self.columns.keys()
        for kind, needed in (
            ("heights", ("drop_height", "rebound_height")),
            ("times", ("time_before", "time_after")),
            ("intervals", ("interval",)),
            ("strikes", ("impact_speed", "cor")),
            ("strikes", ("impact_speed", "rebound_speed")),
            ("strikes", ("impact_speed", "ball_speed")),
            ("bounces", ("bounce_time",)),
        ):
            if all(key in have for key in needed):
                return kind
        listed = ", ".join(repr(str(one)) for one in self.table.columns[:12])
        raise UsageError(
            f"{self.name}: no columns found for a law of restitution; it has {listed}",
            hint="Name them impact_speed and e (or rebound_speed, ball_speed), or drop_height and"
            " rebound_height, or time_between_bounces, with units: 'drop_height (cm)'.",
        )

    def _labels(self, key: str) -> NDArray[Any] | None:
        if key not in self.columns:
            return None
        return self.table[self.columns[key]].fillna("").astype(str).str.strip().to_numpy()

    def balls(self) -> dict[str, tuple[CorPoints, str]]:
        """Points of each ball, and what was done about air."""
        given = self._labels("ball")
        if given is None:
            default = self.setup.ball.name if self.setup.ball is not None else "ball"
            given = np.full(len(self.table), default)
        names = [str(one) for one in given]
        return {
            name or "ball": self._points(
                name, np.array([k for k, one in enumerate(names) if one == name], dtype=np.int64)
            )
            for name in dict.fromkeys(names)
        }

    def _points(self, name: str, rows: NDArray[np.int64]) -> tuple[CorPoints, str]:
        readings, rows = self._readings(rows)
        kept = np.isfinite(readings).all(axis=1)
        if not kept.all():
            self.warnings.append(
                f"{name or 'ball'}: {int((~kept).sum())} of {len(rows)} rows have an empty cell and"
                " are not used."
            )
        readings, rows = readings[kept], rows[kept]
        if len(rows) == 0:
            none = np.zeros(0)
            empty = np.zeros(0, dtype=np.int64)
            return CorPoints(none, none, none, np.zeros((0, 0)), empty), "No rows"
        self._check_positive(readings, rows)
        speed, cor, shared, air = self._restitution(name, readings, rows)
        std = self.values.get("cor_std", np.zeros(len(self.table)))[rows]
        session = self._labels("session")
        number = (
            np.zeros(len(rows), dtype=np.int64)
            if session is None
            else np.unique(session[rows], return_inverse=True)[1].ravel().astype(np.int64)
        )
        points = CorPoints(
            speed, cor, np.nan_to_num(std), shared, number, self._levels(readings, rows)
        )
        return points, air

    def _levels(self, readings: FloatArray, rows: NDArray[np.int64]) -> NDArray[np.int64] | None:
        level = self._labels("level")
        if level is not None:
            return np.unique(level[rows], return_inverse=True)[1].ravel().astype(np.int64)
        if self.kind in ("intervals", "bounces", "times"):
            return None
        return repeated_levels(readings[:, 0])

    def _readings(self, rows: NDArray[np.int64]) -> tuple[FloatArray, NDArray[np.int64]]:
        """Two readings a row: what gives the impact speed, and what gives e."""
        values = self.values
        if self.kind == "heights":
            return np.column_stack([values["drop_height"], values["rebound_height"]])[rows], rows
        if self.kind == "times":
            return np.column_stack([values["time_before"], values["time_after"]])[rows], rows
        if self.kind in ("intervals", "bounces"):
            return self._pairs(rows)
        e = values.get("cor")
        speed = values["impact_speed"]
        if e is None and "rebound_speed" in values:
            self._check_positive(np.column_stack([speed, values["rebound_speed"]])[rows], rows)
            e = values["rebound_speed"] / speed
        if e is None:
            e = self._from_ball_speed(speed, rows)
        return np.column_stack([speed, e])[rows], rows

    def _pairs(self, rows: NDArray[np.int64]) -> tuple[FloatArray, NDArray[np.int64]]:
        """Neighbouring intervals of each series of bounces."""
        session = self._labels("session")
        groups = np.full(len(self.table), "") if session is None else session
        found: list[tuple[float, float]] = []
        at: list[int] = []
        for name in dict.fromkeys(groups[rows].tolist()):
            own = rows[groups[rows] == name]
            if self.kind == "bounces":
                interval = np.diff(self.values["bounce_time"][own])
                own = own[1:]
            else:
                interval = self.values["interval"][own]
            found += itertools.pairwise(interval)
            at += own[:-1].tolist()
        return np.array(found).reshape(-1, 2), np.array(at, dtype=np.int64)

    def _from_ball_speed(self, speed: FloatArray, rows: NDArray[np.int64]) -> FloatArray:
        ball_speed = self.values["ball_speed"]
        if "pendulum_speed_after" in self.values:
            return np.asarray((ball_speed - self.values["pendulum_speed_after"]) / speed)
        names = self._labels("ball")
        ball = self._ball("" if names is None else str(names[rows[0]]))
        if ball is None or ball.mass is None:
            raise UsageError(
                f"{self.name}: e from the ball's speed needs the ball's mass",
                hint="Pass --setup with [ball] mass and [pendulum], or give a column e or"
                " pendulum_speed_after.",
            )
        pendulum = self.setup.pendulum or PAPER_PENDULUM
        if self.setup.pendulum is None:
            self._warn_once(
                "No pendulum given: the effective mass of Ryu et al. is assumed"
                f" ({pendulum.mass_at_contact:.4g} kg). Set [pendulum] in the setup file."
            )
        return np.asarray((1.0 + ball.mass / pendulum.mass_at_contact) * ball_speed / speed - 1.0)

    def _warn_once(self, text: str) -> None:
        if text not in self.warnings:
            self.warnings.append(text)

    def _ball(self, name: str) -> BallSetup | None:
        if name in self.setup.balls:
            return self.setup.balls[name]
        meant = meant_name(name, (*self.setup.balls, *BALLS))
        if meant and meant.casefold() != name.casefold():
            raise UsageError(
                f"{self.name}: unknown ball {name!r}; did you mean {meant!r}?",
                hint=f"Write {meant} in the column ball, or describe [balls.{name}] in the setup"
                " file.",
            )
        name = meant or name
        if name in self.setup.balls:
            return self.setup.balls[name]
        if self.setup.ball is not None:
            return self.setup.ball
        if not name and len(self.setup.balls) == 1:
            return next(iter(self.setup.balls.values()))
        return BallSetup.preset(name) if name in BALLS else None

    def _check_positive(self, readings: FloatArray, rows: NDArray[np.int64]) -> None:
        bad = (readings <= 0).any(axis=1)
        if bad.any():
            row = int(np.argmax(bad))
            values = " and ".join(f"{value:.4g}" for value in readings[row])
            raise DomainError(
                f"{self.name}, row {rows[row] + 1}: {self._what} {values} (SI units) must be above"
                " zero",
                hint="Correct the row, or leave its cells empty.",
            )

    @property
    def _what(self) -> str:
        return {
            "heights": "drop and rebound height",
            "strikes": "impact speed and restitution",
        }.get(self.kind, "times between bounces")

    def _check(self, speed: FloatArray, cor: FloatArray, rows: NDArray[np.int64]) -> None:
        """Reject rows whose readings contradict each other or the other rows."""
        first, second = _EXCHANGED.get(self.kind, ("", ""))
        if (cor > 1.0).all() and first in self.columns and second in self.columns:
            names = f"{self.columns[first]!r} and {self.columns[second]!r}"
            raise DomainError(
                f"{self.name}: the columns {names} are exchanged, or one has another unit: e is"
                f" {cor.min():.3g} to {cor.max():.3g}, above 1 in every row",
                hint="Exchange the two names in the first line, or write the units there:"
                f" '{first} (UNIT)'.",
            )
        if (cor > 1.0).any():
            row = int(np.argmax(cor))
            raise DomainError(
                f"{self.name}, row {rows[row] + 1}: e = {cor[row]:.4g} is above 1",
                hint="A ball cannot rebound faster than it hit. Check the units of the row, and"
                " whether the two columns are exchanged.",
            )
        low = cor < _MIN_RELATIVE_COR * np.median(cor)
        if low.any():
            row = int(np.argmax(low))
            raise UsageError(
                f"{self.name}, row {rows[row] + 1}: e = {cor[row]:.3g}, where the table's median is"
                f" {np.median(cor):.3g}",
                hint="The row's readings seem to be in different units. Correct it, or leave its"
                " cells empty.",
            )
        order = np.argsort(speed)
        ratio = speed[order][1:] / speed[order][:-1]
        if self.kind in ("heights", "strikes") and len(ratio) and ratio.max() >= _MAX_SPEED_GAP:
            cut = int(np.argmax(ratio)) + 1
            few = order[:cut] if 2 * cut <= len(order) else order[cut:]
            listed = ", ".join(str(rows[one] + 1) for one in sorted(few)[:6])
            raise UsageError(
                f"{self.name}: the impact speeds of rows {listed} differ from the others by a"
                f" factor of {ratio.max():.0f} or more",
                hint="Units seem to differ by row. Write all rows in the unit of the head.",
            )

    def _restitution(
        self, name: str, readings: FloatArray, rows: NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray, FloatArray, str]:
        """Impact speed, e, change of e per std of the drag, and what was done about air."""
        first, second = readings.T
        kind = "times" if self.kind in ("intervals", "bounces") else self.kind
        if kind == "strikes":
            self._check(first, second, rows)
            if self.speeds_from is None:
                return first, second, np.zeros((len(rows), 0)), "Speeds are used as given"
            kind = self.speeds_from
            # the readings from which speed and e were computed without air
            rebound = first * second
            scale = 2.0 / GRAVITY
            if kind == "times":
                first, second = first * scale, rebound * scale
            else:
                first, second = first**2 / (2 * GRAVITY), rebound**2 / (2 * GRAVITY)
        if kind == "heights":
            speed, cor = np.sqrt(2 * GRAVITY * first), np.sqrt(second / first)
            longest = float(np.sqrt(2 * max(first.max(), second.max()) / GRAVITY))
        else:
            speed, cor = 0.5 * GRAVITY * first, second / first
            longest = 0.5 * float(max(first.max(), second.max()))
        self._check(speed, cor, rows)
        ball = self._ball(name)
        if ball is None or ball.mass is None:
            self.warnings.append(
                f"{name or 'ball'}: drag between impact and reading is not removed, since mass and"
                " diameter are unknown: e comes out too low, the more the faster the ball. Set mass"
                f" and diameter of [balls.{name or 'NAME'}] in the setup file and pass --setup."
            )
            return speed, cor, np.zeros((len(rows), 0)), "Drag was not removed"
        found = []
        for factor in (1.0, 1.0 + _DRAG_STD):
            falling = FallingBall(ball.mass, ball.diameter, self.setup.air, longest, factor)
            down = first if kind == "heights" else falling.height_of_flight(first)
            up = second if kind == "heights" else falling.height_of_flight(second)
            impact = falling.speed_after_fall(down)
            found.append((impact, falling.speed_of_rise(up) / impact))
        (speed, cor_free), (_, more) = found
        text = (
            f"Drag of a smooth sphere ± {_DRAG_STD:.0%} was removed; it changes e by"
            f" {np.min(cor_free - cor):+.4f} to {np.max(cor_free - cor):+.4f}"
        )
        return speed, cor_free, (more - cor_free)[:, None], text


def _recognised(header: Sequence[str], table: str) -> dict[str, str]:
    """Columns by meaning."""
    bare = {name: _bare(name) for name in header}
    found: dict[str, str] = {}
    for key, words in _NAMES.items():
        alike = [name for name in header if bare[name] in words.split()]
        exact = [name for name in alike if bare[name] == words.split()[0]]
        if len(alike) > 1 and not exact:
            raise UsageError(
                f"{table}: {' and '.join(map(repr, alike))} may both be {key}",
                hint=f"Name the right one {words.split()[0]!r}.",
            )
        if alike:
            found[key] = (exact or alike)[0]
    drops = [name for name in header if bare[name] == "drop"]
    if drops and "drop_height" not in found and "rebound_height" in found:
        found["drop_height"] = drops[0]
    elif drops and "session" not in found:
        found["session"] = drops[0]
    return found


_EXCHANGED = {
    "heights": ("drop_height", "rebound_height"),
    "strikes": ("impact_speed", "rebound_speed"),
    "times": ("time_before", "time_after"),
}
"""Pairs of columns that are exchanged if e is above 1 in every row."""

_COLUMN_WORDS = frozenset(word for words in _NAMES.values() for word in words.split())


def _bare(name: str) -> str:
    """A column's name without its unit."""
    plain = plain_name(name)
    if plain in _COLUMN_WORDS:  # v_in is no length in inches
        return plain
    for suffix in (_SPEED_SUFFIX, _LENGTH_SUFFIX):
        cut = suffix.sub("", plain)
        if cut and cut != plain:
            return cut
    return plain


def _states_unit(head: str) -> bool:
    return _unit(head, "") != ""


def _unit(head: str, default: str) -> str:
    """Unit in a column's head."""
    plain = plain_name(head)
    speed = _SPEED_SUFFIX.search(plain)
    if speed is not None:
        return f"{speed[1]}/{speed[2]}"
    bracketed = "(" in head or "[" in head or "/" in head
    return (unit_of(head) if bracketed or plain not in _COLUMN_WORDS else None) or default


_TableArgument = Annotated[
    Path, typer.Argument(metavar="TABLE", help="Strikes, heights or bounce times (CSV, XLSX).")
]
_SaveOption = Annotated[
    Path | None,
    typer.Option("--save", help="Write the laws (cor.toml), for --cor-law.", metavar="FILE"),
    _FileRole.WRITES,
]
_SpeedsFromOption = Annotated[
    str | None,
    typer.Option(
        "--speeds-from",
        help="heights or times: speeds and e were computed from these without air; remove drag.",
        metavar="WHAT",
    ),
]


def law_command(
    table: _TableArgument,
    setup: SetupFileOption = None,
    report: ReportOption = None,
    save: _SaveOption = None,
    json_file: ResultsJsonOption = None,
    speeds_from: _SpeedsFromOption = None,
    quiet: QuietOption = False,
) -> None:
    """Fit a law of restitution to a table of strikes, heights or bounce times.

    The table has one row per strike or drop: impact_speed and e (or rebound_speed, ball_speed);
    drop_height and rebound_height; or time_between_bounces. Columns ball, session and level are
    used; units stand in the head. Example:
    vision law drops.csv --setup lab.toml --report law.html --save cor.toml
    """
    found = law(table, setup=setup, speeds_from=speeds_from)
    if save is not None:
        found.save(save)
    if report is not None:
        found.report(report)
    taken = write_json(found.to_dict(), json_file)
    if quiet:
        return
    for warning in found.warnings:
        screen(errors=True).print(warning, soft_wrap=True, markup=False)
    if not taken:
        for line in _lines(found):
            screen().print(line, soft_wrap=True, markup=False, highlight=False)


def _lines(found: TableLaws) -> list[str]:
    lines = []
    for name, ball in found.balls.items():
        if not ball.fits:
            continue
        lines.append(f"{name} ({len(ball.points.speed)} rows): {ball.statement}")
        for key, item in ball.fits[0].parameters.items():
            value, std = format_pair(item.value, item.std)
            lines.append(f"  {key} = {value} ± {std}")
        averaged = AveragedLaw(ball.fits)
        for speed in np.linspace(*ball.fits[0].speeds, 3):
            at = averaged.level_mean(float(speed), ball.points.repeats)
            lines.append(
                f"  e at {speed:.2f} m/s: {at.value:.4f}, 95 % band {at.low:.4f} to {at.high:.4f}"
            )
        others = ", ".join(f"{fit.law} {fit.probability:.2f}" for fit in ball.fits)
        lines += [f"  probabilities: {others}", f"  {_test_text(ball)}", f"  {ball.air}."]
    return lines
