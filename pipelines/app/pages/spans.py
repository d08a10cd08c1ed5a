"""A span of a graph: fit a line, a parabola or a sine to it, each number with ±."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from nicegui import ui
from numpy.typing import NDArray

from metrology import NoFitError, UsageError
from metrology.least_squares import fit
from metrology.quantity import format_value
from pipelines.app.graphs import Graph
from pipelines.app.words import Say, on_page, translated

__all__ = ["Shape", "SpanCard", "SpanFit", "fit_span", "scatter_rows"]

FloatArray = NDArray[np.float64]

MIN_SPARE_POINTS = 2
"""Points beyond the number of parameters (chosen: with fewer the scatter is a guess)."""

CURVE_POINTS = 120
"""Points of a drawn curve (chosen: a sine of ten periods is smooth)."""

_PERIODS = np.geomspace(0.1, 3.0, 200)
"""Periods tried for a sine, spans of it (chosen: a third of a period determines little)."""

_MAD_TO_STD = 1.4826
"""Std over median absolute deviation of Gaussian noise (derived)."""


class Shape(StrEnum):
    """Curves that can be fitted."""

    LINE = "line"
    PARABOLA = "parabola"
    SINE = "sine"


_TERMS = {
    Shape.LINE: ("at_start", "slope"),
    Shape.PARABOLA: ("at_start", "slope", "curvature"),
    Shape.SINE: ("mean", "amplitude", "period"),
}
_PER_TIME = {"at_start": 0, "mean": 0, "amplitude": 0, "slope": 1, "curvature": 2}


@dataclass(frozen=True)
class SpanFit:
    """A fitted curve.

    Attributes
    ----------
    terms : tuple of (str, float, float)
        Name, value and standard uncertainty. A line and a parabola have their value and slope at
        the span's first point; the curvature is the second derivative.
    scatter : float
        Standard deviation of the points about the curve.
    curve : (N, 2) array
        To draw it.
    """

    terms: tuple[tuple[str, float, float], ...]
    scatter: float
    points: int
    curve: FloatArray


def fit_span(x: FloatArray, y: FloatArray, shape: Shape) -> SpanFit:
    """Fit a curve to points; their noise is taken from their scatter about it.

    Parameters
    ----------
    x, y : (N,) array
        In order of x.

    Raises
    ------
    UsageError
        If there are too few points.
    NoFitError
        If the points do not determine the curve.
    """
    unknowns = 4 if shape is Shape.SINE else len(_TERMS[shape])
    if len(np.unique(x)) < unknowns + MIN_SPARE_POINTS:
        raise UsageError(
            f"{len(np.unique(x))} points are too few for a {shape}",
            hint=f"Select {unknowns + MIN_SPARE_POINTS} or more.",
        )
    since = x - x[0]
    start, curve = (_sine if shape is Shape.SINE else _polynomial)(since, y, unknowns)
    left = y - curve(start, since)
    typical = _MAD_TO_STD * float(np.median(np.abs(left))) * len(x) / (len(x) - unknowns)
    noise = max(typical, 1e-9 * float(np.ptp(y)), 1e-12)
    found = fit(lambda values: (curve(values, since) - y) / noise, start)
    values, std = found.values, np.sqrt(np.diag(found.covariance))
    if not (found.determined.all() and np.isfinite(values).all() and np.isfinite(std).all()):
        raise NoFitError(f"the points do not determine a {shape}", hint="Select a longer span.")
    drawn = np.linspace(0.0, since[-1], CURVE_POINTS)
    line = np.column_stack([x[0] + drawn, curve(values, drawn)])
    scatter = float(np.sqrt(np.sum((curve(values, since) - y) ** 2) / (len(x) - unknowns)))
    # the phase of a sine is not shown
    terms = zip(_TERMS[shape], values.tolist(), std.tolist(), strict=False)
    return SpanFit(tuple(terms), scatter, len(x), line)


_Curve = Callable[[FloatArray, FloatArray], FloatArray]


def _polynomial(since: FloatArray, y: FloatArray, unknowns: int) -> tuple[FloatArray, _Curve]:
    """Value, slope and second derivative at the first point."""
    factorial = np.array([1.0, 1.0, 2.0])[:unknowns]
    start = np.polyfit(since, y, unknowns - 1)[::-1] * factorial
    return start, lambda c, at: np.asarray(np.polynomial.polynomial.polyval(at, c / factorial))


def _sine(since: FloatArray, y: FloatArray, _: int) -> tuple[FloatArray, _Curve]:
    """Mean, amplitude, period and phase; the period from a scan."""
    best, least = np.zeros(4), np.inf
    for period in since[-1] * _PERIODS:
        turn = 2.0 * np.pi * since / period
        design = np.column_stack([np.ones_like(turn), np.cos(turn), np.sin(turn)])
        mean, cosine, sine = parts = np.linalg.lstsq(design, y, rcond=None)[0]
        off = float(np.sum((design @ parts - y) ** 2))
        if off < least:
            amplitude, phase = np.hypot(cosine, sine), np.arctan2(cosine, sine)
            best, least = np.array([mean, amplitude, period, phase]), off
    return best, lambda c, at: c[0] + c[1] * np.sin(2.0 * np.pi * at / c[2] + c[3])


def scatter_rows(graphs: tuple[Graph, ...], say: Say) -> dict[str, tuple[int, str, FloatArray]]:
    """Measured points of the graphs over time: label → number of the graph, unit, (N, 3) array."""
    found: dict[str, tuple[int, str, FloatArray]] = {}
    for number, graph in enumerate(graphs):
        if not graph.over_time:
            continue
        unit = graph.y.rpartition(" / ")[2].partition(" (down)")[0].strip("()")
        for series in graph.series:
            rows = np.array(series["data"], np.float64).reshape(len(series["data"]), -1)
            if series["type"] == "scatter" and len(rows):
                name = f"{say(graph.name)}: {translated(series['name'], say)}"
                found[name] = (number, unit, rows[np.argsort(rows[:, 0])])
    return found


def _unit(unit: str, term: str) -> str:
    if term == "period":
        return "s"
    base, _, per = unit.partition("/")
    power = _PER_TIME[term] + (1 if per else 0)
    return base + ("", "/s", "/s²", "/s³")[power]


class SpanCard:
    """The span that is selected, and what was fitted to it."""

    def __init__(self, graphs: tuple[Graph, ...], say: Say) -> None:
        self.say, self._series = say, scatter_rows(graphs, say)
        self._fitted: SpanFit | None = None
        self._unit = self._problem = ""

    def build(self) -> None:
        """Lay the fields out."""
        say = self.say
        if not self._series:
            return
        names = list(self._series)
        frames = self._series[names[0]][2][:, 2]
        with ui.element("div").classes("va-form va-hidden-in-print").props("data-test=span"):
            self._name = ui.select(names, value=names[0], label=say("fit_of"))
            self._from = ui.number(say("from_frame"), value=int(frames.min()), min=0, step=1)
            self._to = ui.number(say("to_frame"), value=int(frames.max()), min=0, step=1)
            shapes = {str(one): say(f"shape_{one}") for one in Shape}
            self._shape = ui.select(shapes, value=str(Shape.PARABOLA), label=say("shape"))
            for field, test in (
                (self._name, "fit-of"),
                (self._from, "fit-from"),
                (self._to, "fit-to"),
                (self._shape, "fit-shape"),
            ):
                field.props(f"dense outlined stack-label data-test={test}")
            self._shape.on_value_change(lambda: self._again())
            ui.button(say("fit"), on_click=self.fit).props("outline dense data-test=fit")
        self.outcome()

    @ui.refreshable_method
    def outcome(self) -> None:
        """The fitted terms, or why there are none."""
        if self._problem:
            ui.label(self._problem).classes("va-note bad").props("role=alert data-test=fit-problem")
        if (found := self._fitted) is None:
            return
        with ui.element("div").props("data-test=fitted aria-live=polite").classes("w-full"):
            for term, value, std in found.terms:
                with ui.element("div").classes("va-row"):
                    ui.element("span")
                    ui.label(self.say(f"term_{term}"))
                    text = format_value(value, std, _unit(self._unit, term))
                    ui.label(text).classes("va-value").props(f"data-test=term-{term}")
            about = f"{found.scatter:.2g} {self._unit}"
            said = self.say("fit_note", count=found.points, scatter=about)
            ui.label(said).classes("va-small")

    def select(self, sent: dict[str, Any]) -> None:
        """Take over a span that was dragged in a graph, and fit it."""
        name = str(sent.get("series", ""))
        try:
            first, last = sorted((int(sent["from"]), int(sent["to"])))
        except (KeyError, TypeError, ValueError):
            return
        if name in self._series:
            self._name.set_value(name)
            self._from.set_value(first)
            self._to.set_value(last)
            self.fit()

    def fit(self) -> None:
        """Fit the span and draw the curve."""
        number, self._unit, rows = self._series[self._name.value]
        first, last = (float(one.value or 0) for one in (self._from, self._to))
        rows = rows[(rows[:, 2] >= first) & (rows[:, 2] <= last)]
        self._fitted, self._problem = None, ""
        try:
            self._fitted = fit_span(rows[:, 0], rows[:, 1], Shape(self._shape.value))
        except (UsageError, NoFitError) as problem:
            self._problem = on_page(problem.in_one_line, self.say)
        curve = [] if self._fitted is None else self._fitted.curve.tolist()
        ui.run_javascript(f"visionViewer.fitted({number}, {json.dumps(curve)})")
        self.outcome.refresh()

    def _again(self) -> None:
        if self._fitted is not None or self._problem:
            self.fit()
