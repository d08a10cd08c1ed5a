"""Pictures of `simulate` and `plan`."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from physics.domain import FloatArray
from physics.flight.flight import FlightPath
from physics.forward import Experiment
from pipelines.figures import Picture, save_figure

__all__ = ["BLUE", "GRAY", "ORANGE", "flights_figure", "plan_figure", "saved_figure"]

BLUE, ORANGE, GRAY = "#1f6fb4", "#d95f02", "#666666"
_STYLE: Any = {
    "font.size": 9,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "svg.hashsalt": "impact-vision",
}
"""Points of type and lines: legible where a page is printed at half its size."""


@contextmanager
def styled_figure(width: float = 6.4, height: float = 3.6) -> Iterator[Picture]:
    """A figure to draw on in the style of these plots; sizes in inches."""
    with matplotlib.rc_context(_STYLE):
        yield Picture(figsize=(width, height), dpi=150, layout="constrained")


@contextmanager
def saved_figure(path: Path, width: float = 6.4, height: float = 3.6) -> Iterator[Picture]:
    """A figure that is written whole to `path` (.png or .svg) when the block succeeds.

    Raises
    ------
    UsageError
        For another kind of file.
    """
    with styled_figure(width, height) as figure:
        yield figure
        save_figure(figure, path)


def flights_figure(
    experiment: Experiment, impulsive: FlightPath, turned: FlightPath | None
) -> Picture:
    """The ball's path by the paper's launch and by the contact followed in time."""
    with styled_figure() as figure:
        axes = figure.subplots()
        axes.axhline(experiment.ball.radius, color=GRAY, lw=0.8, ls=":")
        for flight, colour, label in (
            (impulsive, BLUE, "launched along the contact angle (steps a to e)"),
            (turned, ORANGE, "contact followed in time"),
        ):
            if flight is None:
                continue
            x, y = flight.position[:, 0], flight.position[:, 1]
            axes.plot(x, y, color=colour, label=label)
            axes.plot(x[-1], y[-1], "o", color=colour, ms=4)
        axes.annotate("centre at landing", (0.0, experiment.ball.radius), va="bottom", color=GRAY)
        axes.set(xlabel="x from rest (m)", ylabel="height of the centre (m)")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return figure


def plan_figure(
    angles: FloatArray,
    curves: dict[str, FloatArray],
    std: FloatArray,
    wanted: tuple[float, float],
    fitted: Callable[[float], bool],
) -> Picture:
    """Distance over back-swing angle (rad), the wanted point, and where the law is extrapolated."""
    degrees = np.rad2deg(angles)
    with styled_figure() as figure:
        axes = figure.subplots()
        inside = np.array([fitted(float(angle)) for angle in angles])
        for (label, distance), colour in zip(curves.items(), (BLUE, ORANGE), strict=False):
            axes.plot(degrees, distance, color=colour, lw=1.0, ls="--")
            axes.plot(degrees[inside], distance[inside], color=colour, label=label)
        first = next(iter(curves.values()))
        axes.fill_between(
            degrees, first - 1.96 * std, first + 1.96 * std, color=BLUE, alpha=0.15, lw=0
        )
        axes.plot(math.degrees(wanted[0]), wanted[1], "o", color="black", ms=5)
        axes.set(xlabel="back-swing angle (deg)", ylabel="landing distance (m)")
        axes.plot([], [], color=GRAY, lw=1.0, ls="--", label="beyond the fitted speeds")
        axes.legend(loc="upper left")
    return figure
