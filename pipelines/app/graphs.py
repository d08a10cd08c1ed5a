"""Graphs of a measurement as ECharts options; each point carries its frame."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from measuring.measurement import (
    BALL,
    PENDULUM,
    ClipMeasurement,
    on_axes,
    tracks_as_frame,
)
from pipelines.measure.files import report_input
from pipelines.report import Curve, GapRecord, ReportInput, SpeedRecord
from vision.tracks import MotionKind

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Graph", "graphs_of"]

FloatArray = NDArray[np.float64]

MAX_POINTS = 1500
"""Points of a series (chosen: more than a graph has pixels); longer ones are thinned."""

SERIES_COLOURS = ("#e69f00", "#56b4e9", "#009e73", "#cc79a7", "#0072b2", "#d55e00")
"""Convention: palette of Okabe and Ito (2008), distinguishable with any colour vision."""


DOWN = " (down)"
"""Behind the label of an axis whose values increase downwards."""


@dataclass(frozen=True)
class Graph:
    """A graph.

    Attributes
    ----------
    name : str
        "path", "position", "speed", "gap" or "angle".
    x, y : str
        Labels of the axes: quantity and unit.
    over_time : bool
        Whether x is the time, so that a frame is a vertical line.
    series : tuple of dict
        ECharts series; a point is [x, y, frame].
    """

    name: str
    x: str
    y: str
    over_time: bool
    series: tuple[dict[str, Any], ...]

    def options(self, word: Callable[[str], str] = str) -> dict[str, Any]:
        """ECharts options; colours of text and lines are the page's.

        Parameters
        ----------
        word : callable
            Translates names of axes and series.
        """
        axis = {
            "type": "value",
            "scale": True,
            "nameLocation": "middle",
            "splitLine": {"lineStyle": {"opacity": 0.25}},
        }
        # over a time, dragging selects a span
        moves = "ctrl" if self.over_time else True
        zoom = {"type": "inside", "filterMode": "none", "moveOnMouseMove": moves}
        width, height = ({}, {}) if self.over_time else _equal_spans(self.series)
        if self.y.endswith(DOWN) and not self.over_time:
            # as in the picture
            height = {**height, "inverse": True}
        named = [{**one, "name": word(one["name"])} for one in self.series]
        return {
            "animation": False,
            "legend": {"type": "scroll", "top": 0, "left": 0, "itemWidth": 12},
            "grid": {"left": 56, "right": 14, "top": 32, "bottom": 42},
            "tooltip": {"trigger": "item"},
            "dataZoom": [{**zoom, "xAxisIndex": 0}, {**zoom, "yAxisIndex": 0}],
            "xAxis": {**axis, **width, "name": word(self.x), "nameGap": 26},
            "yAxis": {**axis, **height, "name": word(self.y), "nameGap": 42},
            "series": [*named, {"id": "cursor", "name": "", "type": "line", "data": []}],
        }


def graphs_of(measured: ClipMeasurement) -> tuple[Graph, ...]:
    """Gap, path, speed, position and angle, as far as they are known."""
    table = tracks_as_frame(measured)
    if measured.motion.measured_as is not MotionKind.COLLISION:
        # what also moves hides the measured curves
        table = table[table["object"].isin((BALL, PENDULUM))]
    clock = _Clock(table)
    shown = report_input(measured, None)
    found: list[Graph] = []
    if shown.gap is not None:
        found.append(_gap(shown.gap, clock))
    found += _paths(table, _fitted_paths(measured, shown))
    found += _speeds(shown.speeds, clock) if shown.speeds else _steps(table)
    found += _angles(table)
    return tuple(found)


class _Clock:
    """Nearest frame of a time."""

    def __init__(self, table: "pd.DataFrame") -> None:
        rows = table.drop_duplicates("frame").sort_values("t_s")
        self._time = rows["t_s"].to_numpy(np.float64)
        self._frame = rows["frame"].to_numpy(np.float64)

    def frames(self, time_s: FloatArray) -> FloatArray:
        if not len(self._time):
            return np.zeros(len(time_s))
        return np.asarray(np.rint(np.interp(time_s, self._time, self._frame)))


def _rows(*columns: FloatArray) -> list[list[float]]:
    """Points of finite numbers with six digits, thinned evenly."""
    table = np.column_stack([np.asarray(column, np.float64) for column in columns])
    table = table[np.isfinite(table).all(axis=1)]
    if len(table) > MAX_POINTS:
        table = table[np.linspace(0, len(table) - 1, MAX_POINTS).astype(int)]
    return [[float(f"{value:.6g}") for value in row] for row in table.tolist()]


def _equal_spans(series: tuple[dict[str, Any], ...]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Limits of both axes of the same length: a vertical fall is a line, not noise."""
    points = np.array([row[:2] for part in series for row in part["data"]])
    if not len(points):
        return {}, {}
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, 0.55 * float((high - low).max())
    # the limits themselves are no round numbers
    plain = {"axisLabel": {"showMinLabel": False, "showMaxLabel": False}}
    bounds = [
        {**plain, "min": float(f"{one - half:.3g}"), "max": float(f"{one + half:.3g}")}
        for one in middle
    ]
    return bounds[0], bounds[1]


def _points(name: str, rows: list[list[float]], place: int) -> dict[str, Any]:
    colour = SERIES_COLOURS[place % len(SERIES_COLOURS)]
    return {
        "name": name,
        "type": "scatter",
        "symbolSize": 6,
        "itemStyle": {"color": colour},
        "data": rows,
    }


def _line(curve: Curve, place: int, scale: float = 1.0) -> dict[str, Any]:
    return {
        "name": curve.label,
        "type": "line",
        "showSymbol": False,
        "silent": True,
        "lineStyle": {"color": SERIES_COLOURS[place % len(SERIES_COLOURS)], "width": 1.5},
        "itemStyle": {"color": SERIES_COLOURS[place % len(SERIES_COLOURS)]},
        "data": _rows(curve.x, scale * curve.y),
    }


def _gap(gap: GapRecord, clock: _Clock) -> Graph:
    rows = _rows(gap.time_s, 1e3 * gap.gap_m, clock.frames(gap.time_s))
    lines = [_line(curve, 1 + place, 1e3) for place, curve in enumerate(gap.fits)]
    return Graph("gap", "t / s", "gap / mm", True, (_points("gap", rows, 0), *lines))


def _paths(table: "pd.DataFrame", fits: Iterable[Curve]) -> list[Graph]:
    metric = bool(table["x_m"].notna().any())
    unit = "m" if metric else "px"
    path: list[dict[str, Any]] = []
    over_time: list[dict[str, Any]] = []
    for place, (name, own) in enumerate(table.groupby("object", sort=False)):
        x, y = (own[f"{axis}_{unit}"].to_numpy(np.float64) for axis in "xy")
        frame = own["frame"].to_numpy(np.float64)
        time = own["t_s"].to_numpy(np.float64)
        path.append(_points(str(name), _rows(x, y, frame), place))
        over_time.append(_points(f"{name} x", _rows(time, x, frame), 2 * place))
        over_time.append(_points(f"{name} y", _rows(time, y, frame), 2 * place + 1))
    drawn = [_line(curve, 4) for curve in fits] if metric else []
    down = "" if metric else DOWN
    return [
        Graph("path", f"x / {unit}", f"y / {unit}{down}", False, (*path, *drawn)),
        Graph("position", "t / s", f"x, y / {unit}", True, tuple(over_time)),
    ]


def _fitted_paths(measured: ClipMeasurement, shown: ReportInput) -> list[Curve]:
    """Fitted paths on the axes of the table; those of the fit are along the flight."""
    if measured.impact is None or shown.path is None:
        return []
    forward = np.array([measured.impact.tracks.direction, 1.0])
    found = []
    for curve in shown.path.fits:
        place = on_axes(measured, np.column_stack([curve.x, curve.y]) * forward)
        found.append(replace(curve, x=place[:, 0], y=place[:, 1]))
    return found


def _speeds(speeds: Iterable[SpeedRecord], clock: _Clock) -> list[Graph]:
    series: list[dict[str, Any]] = []
    for place, one in enumerate(speeds):
        rows = _rows(one.time_s, one.speed, clock.frames(one.time_s))
        series.append(_points(one.label, rows, place))
        series += [_line(curve, 2 + place) for curve in one.fits]
    return [Graph("speed", "t / s", "speed / (m/s)", True, tuple(series))]


def _steps(table: "pd.DataFrame") -> list[Graph]:
    """Speed by displacement between neighbouring frames."""
    unit = "m" if table["x_m"].notna().any() else "px"
    series = []
    for place, (name, own) in enumerate(table.groupby("object", sort=False)):
        own = own.sort_values("frame")
        time, x, y = (own[key].to_numpy(np.float64) for key in ("t_s", f"x_{unit}", f"y_{unit}"))
        frame = own["frame"].to_numpy(np.float64)
        if len(own) < 2:
            continue
        near = np.diff(frame) == 1.0
        speed = np.hypot(np.diff(x), np.diff(y)) / np.diff(time)
        middle = 0.5 * (time[1:] + time[:-1])
        rows = _rows(middle[near], speed[near], frame[1:][near])
        series.append(_points(str(name), rows, place))
    return [Graph("speed", "t / s", f"speed / ({unit}/s)", True, tuple(series))] if series else []


def _angles(table: "pd.DataFrame") -> list[Graph]:
    own = table[table["phi_rad"].notna()]
    if not len(own):
        return []
    time, phi = own["t_s"].to_numpy(np.float64), np.degrees(own["phi_rad"].to_numpy(np.float64))
    rows = _rows(time, phi, own["frame"].to_numpy(np.float64))
    name = str(own["object"].iloc[0])
    return [Graph("angle", "t / s", "angle / °", True, (_points(name, rows, 1),))]
