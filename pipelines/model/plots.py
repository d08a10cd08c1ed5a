"""Pictures of `simulate` and `plan`."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from metrology import UsageError, written_whole
from physics.arrays import FloatArray
from physics.flight.flight import FlightPath
from physics.forward import Experiment

__all__ = ["BLUE", "GRAY", "ORANGE", "draw_flights", "draw_plan", "saved_figure"]

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


@contextmanager
def saved_figure(path: Path, width: float = 6.4, height: float = 3.6) -> Iterator[Figure]:
    """A figure that is written whole to `path` (.png or .svg) when the block succeeds.

    Raises
    ------
    UsageError
        For another kind of file.
    """
    if path.suffix.lower() not in (".png", ".svg"):
        raise UsageError(f"a plot is a .png or .svg file, not {path.name}")
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(width, height), dpi=150, layout="constrained")
        yield figure
        metadata: dict[str, Any] = {"Date": None} if path.suffix.lower() == ".svg" else {}
        with written_whole(path) as temporary:
            figure.savefig(temporary, metadata=metadata)


def draw_flights(
    path: Path, experiment: Experiment, impulsive: FlightPath, turned: FlightPath | None
) -> None:
    """The ball's path by the paper's launch and by the contact followed in time."""
    with saved_figure(path) as figure:
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


def draw_plan(
    path: Path,
    angles: FloatArray,
    curves: dict[str, FloatArray],
    std: FloatArray,
    wanted: tuple[float, float],
    fitted: Callable[[float], bool],
) -> None:
    """Distance over back-swing angle (rad), the wanted point, and where the law is extrapolated."""
    degrees = np.rad2deg(angles)
    with saved_figure(path) as figure:
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
