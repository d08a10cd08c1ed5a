"""Plots of one measurement: gap, speeds, path on the wall, residuals."""

import io
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from metrology import UsageError, written_whole
from pipelines.doors import DATE
from pipelines.report.inputs import GapRecord, Moment, PathRecord, ReportInput, SpeedRecord

__all__ = [
    "PANELS",
    "Panel",
    "Picture",
    "draw_into",
    "panel_svg",
    "panels_of",
    "plot_panel",
    "plots_figure",
    "save_figure",
    "styled_figure",
    "write_plot",
]

_PLOT_SUFFIXES = (".png", ".svg")


class Picture(Figure):
    """A matplotlib figure that a notebook displays without `pyplot`."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


def save_figure(figure: Figure, path: Path, hint: str | None = None) -> None:
    """Write a figure as .png or .svg, completely or not at all.

    Raises
    ------
    UsageError
        If the file is neither .png nor .svg, or its folder can't be written to.
    """
    kind = path.suffix.lower()
    if kind not in _PLOT_SUFFIXES:
        raise UsageError(f"a plot is a .png or .svg file, not {path.name}", hint=hint)
    with written_whole(path) as temporary:
        draw_into(temporary, figure, kind)


def draw_into(target: "Path | IO[Any]", figure: Figure, kind: str, **options: Any) -> None:
    """Draw a figure as ".png", ".svg", …: the same figure gives the same bytes.

    An SVG has a date only if `vision --date` asks for one.
    """
    metadata = {"Date": os.environ.get(DATE)} if kind == ".svg" else None
    with matplotlib.rc_context({"svg.hashsalt": "impact-vision"}):
        figure.savefig(target, format=kind.lstrip("."), metadata=metadata, **options)


# Distinguishable with any colour vision (Okabe and Ito 2008).
BLUE, ORANGE, GREEN, PINK, GRAY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#555555"

STYLE: Any = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "grid.color": "#e2e2e2",
    "grid.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.edgecolor": "none",
    "legend.framealpha": 0.85,
    "legend.fontsize": 8,
}
"""Font sizes and line widths in points: legible when printed at half size."""


@contextmanager
def styled_figure(width: float = 6.4, height: float = 3.6) -> Iterator[Picture]:
    """A figure in this style; sizes in inches."""
    with matplotlib.rc_context(STYLE):
        yield Picture(figsize=(width, height), dpi=150, layout="constrained")


Panel = tuple[str, Callable[[Axes], None]]
_POINTS: dict[str, Any] = {"fmt": "o", "ms": 2.6, "lw": 0, "elinewidth": 0.7, "capsize": 0}
"""Sizes of markers and bars in points: several hundred frames stay distinguishable."""


def panels_of(report: ReportInput) -> tuple[Panel, ...]:
    """Titles and drawing functions of the plots for which there are data."""
    panels: list[Panel] = []
    if report.gap is not None and len(report.gap.time_s):
        gap = report.gap
        panels.append(("Gap between pendulum face and ball", lambda axes: _draw_gap(axes, gap)))
    if report.speeds:
        panels.append(("Speeds", lambda axes: _draw_speeds(axes, report.speeds, report.gap)))
    if report.path is not None and len(report.path.x_m):
        path = report.path
        panels.append(("Path of the ball's centre", lambda axes: _draw_path(axes, path)))
        if path.residual_time_s is not None and len(path.residual_time_s):
            panels.append(
                ("Residuals of the fitted flight", lambda axes: _draw_residuals(axes, path))
            )
    return tuple(panels)


def panel_svg(panel: Panel) -> tuple[str, str]:
    """Draw one panel as an SVG document; with it, as JSON, its axes and points.

    The JSON has `box`, the axes as fractions of the picture (left, bottom, right, top), their
    limits `x` and `y`, and `series`: pairs of a name and points.
    """
    with matplotlib.rc_context(STYLE):
        figure = Picture(figsize=(6.2, 3.1), layout="constrained")
        axes = figure.subplots()
        _fill(axes, panel)
        buffer = io.StringIO()
        draw_into(buffer, figure, ".svg")
    drawn = {
        "box": [round(float(one), 4) for one in axes.get_position().extents],
        "x": [float(one) for one in axes.get_xlim()],
        "y": [float(one) for one in axes.get_ylim()],
        "series": _points_of(axes),
    }
    return buffer.getvalue(), json.dumps(drawn)


def _points_of(axes: Axes) -> list[tuple[str, list[list[float]]]]:
    """Names and points of what the legend lists."""
    found = []
    for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
        line = handle[0] if isinstance(handle, ErrorbarContainer) else handle
        if isinstance(line, Line2D):
            points = np.asarray(line.get_xydata())
            points = points[np.isfinite(points).all(axis=1)]
            found.append((name, [[float(f"{one:.5g}") for one in row] for row in points]))
    return found


def plots_figure(report: ReportInput) -> Picture:
    """All panels in one figure.

    Raises
    ------
    UsageError
        If there is nothing to draw.
    """
    panels = _required(report)
    columns = 2 if len(panels) > 1 else 1
    rows = -(-len(panels) // columns)
    with matplotlib.rc_context(STYLE):
        figure = Picture(figsize=(5.6 * columns, 3.3 * rows), dpi=130, layout="constrained")
        figure.suptitle(report.title, fontsize=11)
        grid = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, panel in zip(grid, panels, strict=False):
            _fill(axes, panel)
        for axes in grid[len(panels) :]:
            axes.set_axis_off()
    return figure


def _required(report: ReportInput) -> tuple[Panel, ...]:
    panels = panels_of(report)
    if not panels:
        raise UsageError(
            "there is nothing to plot: curves need positions in metres",
            hint="Omit --plot and use --report or --overlay. For curves give a scale, or point at "
            "the ball with --ball-at X,Y.",
        )
    return panels


PANELS = {"gap": "Gap", "speeds": "Speeds", "path": "Path", "residuals": "Residuals"}
"""Short names of the panels: first words of their titles."""


def plot_panel(report: ReportInput, axes: Axes, name: str) -> Axes:
    """Draw one panel on given axes.

    Parameters
    ----------
    name : {"gap", "speeds", "path", "residuals"}

    Raises
    ------
    UsageError
        If there is no such panel, or nothing to draw on it.
    """
    drawn = {
        short: panel
        for panel in _required(report)
        for short, first in PANELS.items()
        if panel[0].startswith(first)
    }
    if name not in drawn:
        raise UsageError(f"there is no panel {name!r}", hint=f"There are {', '.join(drawn)}.")
    _fill(axes, drawn[name])
    return axes


def write_plot(path: Path, report: ReportInput) -> None:
    """Write all panels to one picture (``--plot``).

    Raises
    ------
    UsageError
        If the file is neither .png nor .svg, or there is nothing to draw.
    """
    with matplotlib.rc_context(STYLE):
        save_figure(plots_figure(report), path, hint="Try --plot results.png.")


def _fill(axes: Axes, panel: Panel) -> None:
    title, draw = panel
    axes.set_title(title)
    draw(axes)
    if axes.get_legend_handles_labels()[0]:
        axes.legend()


def _draw_gap(axes: Axes, gap: GapRecord) -> None:
    axes.axhline(0.0, color=GRAY, lw=0.8)
    axes.errorbar(
        1e3 * gap.time_s, 1e3 * gap.gap_m, 1e3 * gap.gap_std_m, color=BLUE, label="measured",
        **_POINTS,
    )  # fmt: skip
    for number, fit in enumerate(gap.fits):
        axes.plot(
            1e3 * fit.x, 1e3 * fit.y, color=(ORANGE, GREEN)[number % 2], lw=1, label=fit.label
        )
    _draw_moments(axes, gap)
    largest = 1e3 * np.nanmax(np.abs(gap.gap_m))
    axes.set_ylim(bottom=max(axes.get_ylim()[0], -1.1 * largest))
    axes.set(xlabel="time / ms", ylabel="gap / mm")


def _draw_moments(axes: Axes, gap: GapRecord | None) -> None:
    """Shade the contact; its uncertain ends (k = 2) are darker."""
    if gap is None:
        return
    if gap.onset is not None and gap.release is not None:
        axes.axvspan(
            1e3 * gap.onset.time_s, 1e3 * gap.release.time_s, color=PINK, alpha=0.15, lw=0,
            label="in contact",
        )  # fmt: skip
    for moment in (gap.onset, gap.release):
        if isinstance(moment, Moment):
            low, high = moment.time_s - 2 * moment.std_s, moment.time_s + 2 * moment.std_s
            axes.axvspan(1e3 * low, 1e3 * high, color=PINK, alpha=0.45, lw=0)


def _draw_speeds(axes: Axes, speeds: tuple[SpeedRecord, ...], gap: GapRecord | None) -> None:
    for number, record in enumerate(speeds):
        colour = (BLUE, ORANGE)[number % 2]
        axes.errorbar(
            1e3 * record.time_s, record.speed, record.speed_std, color=colour, alpha=0.55,
            label=f"{record.label}, frame by frame", **_POINTS,
        )  # fmt: skip
        for fit in record.fits:
            axes.plot(1e3 * fit.x, fit.y, color=colour, lw=1.4, label=fit.label, zorder=4)
    _draw_moments(axes, gap)
    axes.set(xlabel="time / ms", ylabel="speed / (m/s)")
    axes.set_ylim(bottom=0.0)


def _draw_path(axes: Axes, path: PathRecord) -> None:
    axes.errorbar(
        path.x_m, path.y_m, path.y_std_m, path.x_std_m, color=BLUE, label="measured", **_POINTS
    )
    for number, fit in enumerate(path.fits):
        axes.plot(fit.x, fit.y, color=(ORANGE, GREEN)[number % 2], lw=1, label=fit.label, zorder=4)
    if path.landing is not None:
        x, y = path.landing
        spread = None if path.landing_std_m is None else 2 * path.landing_std_m
        axes.errorbar(
            [x], [y], xerr=spread, color=PINK, marker="X", ms=8, lw=0, elinewidth=1.5,
            label="landing (k = 2)",
        )  # fmt: skip
    axes.axhline(0.0, color=GRAY, lw=0.8)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x / m", ylabel="y / m")


def _draw_residuals(axes: Axes, path: PathRecord) -> None:
    assert path.residual_time_s is not None
    axes.axhline(0.0, color=GRAY, lw=0.8)
    time = 1e3 * path.residual_time_s
    if path.residual_std_m is not None:
        band = 2e3 * path.residual_std_m
        axes.fill_between(time, -band, band, color=GRAY, alpha=0.15, lw=0, label="±2 std expected")
    for residual, colour, label in (
        (path.residual_x_m, BLUE, "along the wall"),
        (path.residual_y_m, ORANGE, "vertical"),
    ):
        if residual is not None:
            axes.plot(time, 1e3 * residual, ".", ms=4, color=colour, label=label)
    axes.set(xlabel="time / ms", ylabel="measured − fitted / mm")
