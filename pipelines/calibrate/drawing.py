"""SVG over the frame of the page Set up: grid lines, uncertainty map, path."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.grid import WallGrid, pixel_grid
from pipelines.calibrate.answers import Answers

__all__ = ["RAMP", "MapScale", "grid_lines", "path_line", "shaded_map"]

FloatArray = NDArray[np.float64]

LINE, MARK_COLOUR = "#00a395", "#d6156c"

RAMP = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")
"""Viridis, dark for small values."""

MAX_GRID_LINES = 120
"""Wall lines drawn (chosen: more merge into a grey surface and load slowly)."""

LINE_POINTS = 24
"""Points of the polygon that draws a line distorted by the lens (chosen)."""


@dataclass(frozen=True)
class MapScale:
    """Range of the map's colours: smallest and largest uncertainty, m."""

    low: float
    high: float


def _stroke(size: tuple[int, int], width: float) -> str:
    """Line width that appears equal on small and large images."""
    return f"{width * size[0] / 640:.2f}"


def grid_lines(grid: WallGrid) -> str:
    """Fitted coarse lines in the region of the grid, and its origin."""
    height, width = grid.area.shape
    step = max(1, width // 320)
    coordinates = grid.map(pixel_grid((height, width))[::step, ::step])
    inside = grid.area[::step, ::step]
    parts: list[str] = []
    for family in range(2):
        values = np.where(np.isfinite(coordinates[..., family]), coordinates[..., family], 0.0)
        seen = values[inside]
        first, last = int(np.ceil(seen.min())), int(np.floor(seen.max()))
        every = max(1, (last - first) // MAX_GRID_LINES)
        for level in range(first, last + 1, every):
            parts += _level(values - level, inside, step)
    body = "".join(parts)
    stroke = _stroke((width, height), 0.7)
    lines = f'<path d="{body}" fill="none" stroke="{LINE}" stroke-width="{stroke}" opacity="0.8"/>'
    return lines + _origin(grid)


def _level(values: FloatArray, inside: NDArray[np.bool_], step: int) -> Iterable[str]:
    """Segments of the line where values change sign, along the longer axis."""
    for axis in (0, 1):
        a, b = (values[:-1], values[1:]) if axis == 0 else (values[:, :-1], values[:, 1:])
        ok = inside[:-1] if axis == 0 else inside[:, :-1]
        slope = np.abs(np.gradient(values, axis=axis)) >= np.abs(np.gradient(values, axis=1 - axis))
        slope = slope[:-1] if axis == 0 else slope[:, :-1]
        crossing = (a * b <= 0) & (a != b) & ok & slope
        rows, columns = np.nonzero(crossing)
        part = a[rows, columns] / (a[rows, columns] - b[rows, columns])
        x = (columns + (part if axis == 1 else 0.0)) * step
        y = (rows + (part if axis == 0 else 0.0)) * step
        order = np.argsort(x if axis == 0 else y)
        yield from _runs(np.asarray(x[order]), np.asarray(y[order]), 2.5 * step, axis)


def _runs(x: FloatArray, y: FloatArray, gap: float, axis: int) -> Iterable[str]:
    if len(x) < 2:
        return
    along = x if axis == 0 else y
    breaks = np.flatnonzero(np.diff(along) > gap) + 1
    for run in np.split(np.arange(len(x)), breaks):
        if len(run) < 2:
            continue
        chosen = run[np.unique(np.linspace(0, len(run) - 1, LINE_POINTS).astype(int))]
        points = " ".join(f"{x[i]:.1f},{y[i]:.1f}" for i in chosen)
        yield f"M{points}"


def _origin(grid: WallGrid) -> str:
    start = grid.points_px[np.argmin(np.abs(grid.wall_m).sum(axis=1))]
    px = grid.map.inverse(-grid.origin_m[np.newaxis] / grid.pitch_m, start[np.newaxis])[0]
    if not np.isfinite(px).all():
        return ""
    size = grid.size
    x, y = px
    arm = 14 * size[0] / 640
    return (
        f'<path d="M{x - arm:.1f},{y:.1f}H{x + arm:.1f}M{x:.1f},{y - arm:.1f}V{y + arm:.1f}"'
        f' stroke="{MARK_COLOUR}" stroke-width="{_stroke(size, 1.6)}"/>'
        + _label(px + 4 * size[0] / 640 * np.array([1.0, -1.0]), "0, 0", MARK_COLOUR, size)
    )


def _label(px: FloatArray, text: str, colour: str, size: tuple[int, int]) -> str:
    font = 11 * size[0] / 640
    anchor = "end" if px[0] > 0.85 * size[0] else "start"
    return (
        f'<text x="{px[0]:.1f}" y="{px[1]:.1f}" font-size="{font:.1f}" fill="{colour}" '
        f'style="paint-order: stroke; font-weight: 600" stroke="#fff" '
        f'stroke-width="{0.3 * font:.2f}" '
        f'text-anchor="{anchor}" font-family="sans-serif">{escape(text)}</text>'
    )


def path_line(answers: Answers) -> str:
    """Path of the tracked ball."""
    if answers.tracks is None:
        return ""
    size = answers.scene.size
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in answers.tracks.ball.centre_px[::3])
    return (
        f'<polyline points="{points}" fill="none" stroke="{MARK_COLOUR}" '
        f'stroke-width="{_stroke(size, 1)}" stroke-dasharray="{_stroke(size, 4)}"/>'
    )


def shaded_map(calibration: Calibration) -> tuple[str, MapScale]:
    """Uncertainty of positions on the ball plane, from the ball at rest, over the picture."""
    width = calibration.lens.width
    step = max(8, width // 40)
    px, std = calibration.uncertainty_map(step)
    finite = std[np.isfinite(std)]
    if len(finite) == 0:
        return "", MapScale(0.0, 0.0)
    scale = MapScale(float(finite.min()), float(np.percentile(finite, 98)))
    colour = _colouring(scale)
    cells = "".join(
        f'<rect x="{x - step / 2:.1f}" y="{y - step / 2:.1f}" width="{_cell_side(x, width, step)}" '
        f'height="{_cell_side(y, calibration.lens.height, step)}" '
        f'fill="{colour(value)}"/>'
        for (x, y), value in zip(px.reshape(-1, 2), std.ravel(), strict=True)
        if np.isfinite(value)
    )
    return f'<g opacity="0.6">{cells}</g>', scale


def _cell_side(at: float, length: int, step: int) -> float:
    """Side of a cell; the last one of a row ends at the image's edge."""
    return step + 0.3 if at + step < length else length - at + 0.5 * step


def _colouring(scale: MapScale) -> Callable[[float], str]:
    stops = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in RAMP], dtype=float)
    places = np.linspace(0.0, 1.0, len(RAMP))
    span = max(scale.high - scale.low, 1e-12)

    def colour(value: float) -> str:
        part = min(max((value - scale.low) / span, 0.0), 1.0)
        red, green, blue = (int(np.interp(part, places, stops[:, i])) for i in range(3))
        return f"#{red:02x}{green:02x}{blue:02x}"

    return colour
