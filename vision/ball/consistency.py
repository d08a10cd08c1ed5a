"""Frames held against their neighbours: what does not belong is told, and what is left is honest.

Each position is predicted without itself, by a parabola through the frames on both sides, and by
one through those of either side alone, since a strike or a bounce breaks the motion. A position
that none of the three explains does not belong. How far the others lie from their predictions,
beside what they state, says by how much the stated uncertainty is too small.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.motion.lawful import lawful_stretch

__all__ = ["Expected", "expected_places", "off_flight"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_EACH_SIDE = 5
_ALONE = 6
_FEWEST = 4
# Frames further away than this tell nothing.
_FURTHEST = 12
_ROUNDS = 3
# Off by so many combined standard uncertainties, and by at least this (px, and in radii).
_OFF_SIGMA = 5.0
_LEAST_OFF_PX, _LEAST_OFF_RADII = 0.6, 0.03
_SWOLLEN = 0.1
# A flight of so many frames is judged as a whole: drag and lens bend it no more than a cubic.
_FLIGHT_FRAMES = 24
_FLIGHT_DEGREE = 3
_FLIGHT_ROUNDS = 12
# Of so many parts of a flight, no more than this many rest: the top of a throw, a release.
_PARTS, _MOST_RESTING = 8, 2


@dataclass(frozen=True)
class Expected:
    """What the other frames say of each frame.

    Attributes
    ----------
    centre : (N, 2) array
        Where it should be, px; NaN where too few others are near.
    off : (N,) bool array
        Whether the frame lies elsewhere, or is of another size.
    excess : (N,) array
        Squared distance from the prediction over what both state, per axis; NaN where unknown.
    """

    centre: FloatArray
    off: BoolArray
    excess: FloatArray


def expected_places(
    frame: IntArray, centre: FloatArray, radius: FloatArray, variance: FloatArray
) -> Expected:
    """Predict each frame from the others.

    Parameters
    ----------
    frame : (N,) int array
        Frames, increasing.
    centre : (N, 2) array
        Positions, px.
    radius : (N,) array
        Radii, px.
    variance : (N,) array
        Stated variance of a position along one axis, px².

    Returns
    -------
    Expected
    """
    count = len(frame)
    if count < _FEWEST + 1:
        return Expected(np.full((count, 2), np.nan), np.zeros(count, bool), np.full(count, np.nan))
    guesses = [
        _predicted(frame, centre, variance, np.array(steps))
        for steps in (
            [*range(-_EACH_SIDE, 0), *range(1, _EACH_SIDE + 1)],
            range(-_ALONE, 0),
            range(1, _ALONE + 1),
        )
    ]
    places = np.stack([guess for guess, _ in guesses])
    away = np.hypot(*np.moveaxis(centre - places, 2, 0))
    scaled = away**2 / (2.0 * (variance + np.stack([spread for _, spread in guesses])))
    known = np.isfinite(scaled)
    scaled = np.where(known, scaled, np.inf)
    best, rows = np.argmin(scaled, axis=0), np.arange(count)
    nearest = np.where(known, away, np.inf).min(axis=0)
    floor = _LEAST_OFF_PX + _LEAST_OFF_RADII * float(np.median(radius))
    excess = scaled[best, rows]
    off = np.isfinite(excess) & (nearest > floor) & (excess > 0.5 * _OFF_SIGMA**2)
    off |= np.abs(np.log(radius / _near_radius(frame, radius))) > _SWOLLEN
    return Expected(places[best, rows], off, np.where(np.isfinite(excess), excess, np.nan))


def off_flight(
    frame: IntArray, centre: FloatArray, radius: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Frames of a long free flight that lie off it as a whole.

    A run of frames that is drawn off by the same thing, such as the ball's shadow on the floor, is
    smooth by itself; the flight is not drawn off with it.

    Parameters
    ----------
    frame, centre, radius : arrays
        As in `expected_places`.

    Returns
    -------
    centre : (N, 2) array
        Where the flight is, px; NaN outside it.
    off : (N,) bool array
        Whether the frame lies elsewhere.
    """
    place, off = np.full((len(frame), 2), np.nan), np.zeros(len(frame), dtype=bool)
    usual = float(np.median(radius))
    stretch = lawful_stretch(frame, centre, usual)
    inside = np.flatnonzero((frame >= stretch.first) & (frame <= stretch.last))
    if len(inside) < _FLIGHT_FRAMES or stretch.looks < _FLIGHT_FRAMES:
        return place, off
    floor = _LEAST_OFF_PX + _LEAST_OFF_RADII * usual
    parts = np.array_split(centre[inside], _PARTS)
    resting = [float(np.hypot(*_spread(part))) < 2.0 * floor for part in parts]
    if sum(resting) > _MOST_RESTING:
        # Mostly rest, before or after the motion: no one law holds there.
        return place, off
    time = np.interp(frame[inside], [stretch.first, stretch.last], [-1.0, 1.0])
    design = np.vander(time, _FLIGHT_DEGREE + 1)
    weight = np.ones(len(inside))
    for _ in range(_FLIGHT_ROUNDS):
        weighted = design * weight[:, None]
        fitted = np.linalg.solve(weighted.T @ design, weighted.T @ centre[inside])
        away = np.hypot(*(centre[inside] - design @ fitted).T)
        scale = max(1.2 * float(np.median(away)), 0.02)
        weight = 1.0 / (1.0 + (away / (3.0 * scale)) ** 2) ** 2
    place[inside] = design @ fitted
    off[inside] = away > max(floor, _OFF_SIGMA * scale)
    return place, off


def _spread(centre: FloatArray) -> FloatArray:
    """How far positions reach along each axis, the outermost left aside."""
    low, high = np.quantile(centre, [0.1, 0.9], axis=0)
    return np.asarray(high - low)


def _near_radius(frame: IntArray, radius: FloatArray) -> FloatArray:
    """Usual radius of the frames around each, itself left out; its own where there are few."""
    steps = np.array([*range(-_FURTHEST, 0), *range(1, _FURTHEST + 1)])
    rows, near = _neighbours(frame, steps)
    values = np.where(near, radius[rows], np.nan)
    few = near.sum(axis=1) < _FEWEST
    values[few] = radius[few, None]
    return np.asarray(np.nanmedian(values, axis=1))


def _neighbours(frame: IntArray, steps: IntArray) -> tuple[IntArray, BoolArray]:
    """Rows so many steps from each, and which of them are there and near enough."""
    count = len(frame)
    rows = np.arange(count)[:, None] + steps
    inside = (rows >= 0) & (rows < count)
    rows = np.clip(rows, 0, count - 1)
    return rows, inside & (np.abs(frame[rows] - frame[:, None]) <= _FURTHEST)


def _predicted(
    frame: IntArray, centre: FloatArray, variance: FloatArray, steps: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Robust parabola through the rows so many steps away, and its variance at each row.

    The variance is what is stated, or what the residuals say where that is more; NaN where too few
    rows are near. Through only just enough of them goes a line.
    """
    rows, near = _neighbours(frame, steps)
    enough = near.sum(axis=1)
    time = (frame[rows] - frame[:, None]) / float(_FURTHEST)
    design = np.stack([np.ones_like(time), time, time * time], axis=2)
    stated = variance[rows] + 1e-6
    held = np.zeros((len(frame), 3, 3))
    held[:, [0, 1, 2], [0, 1, 2]] = 1e-9
    held[enough <= _FEWEST, 2, 2] = 1e9
    weight = near / stated
    known = np.where(near, stated, np.nan)
    known[enough < _FEWEST] = 1.0
    typical = np.nanmedian(known, axis=1)
    for _ in range(_ROUNDS):
        weighted = design * weight[:, :, None]
        inverse = np.linalg.inv(np.einsum("nki,nkj->nij", weighted, design) + held)
        fitted = inverse @ np.einsum("nki,nkj->nij", weighted, centre[rows])
        square = np.sum((centre[rows] - design @ fitted) ** 2, axis=2)
        left = np.where(near, square, np.nan)
        left[enough < _FEWEST] = 1.0
        middle = np.nanmedian(left, axis=1)
        usual = np.maximum(middle, typical)[:, None]
        weight = near / (stated * (1.0 + square / (4.0 * usual)) ** 2)
    spread = inverse[:, 0, 0] * np.maximum(1.0, middle / (1.4 * typical))
    place = fitted[:, 0]
    place[enough < _FEWEST] = np.nan
    spread[enough < _FEWEST] = np.nan
    return place, spread
