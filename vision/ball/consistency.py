"""Frames held against their neighbours: what does not belong is told, and what is left is honest.

Each position is predicted without itself, by a parabola through the frames on both sides, and by
one through those of either side alone, since a strike or a bounce breaks the motion. A position
that none of the three explains does not belong. How far the others lie from their predictions,
beside what they state, says by how much the stated uncertainty is too small.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Expected", "expected_places"]

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
    place = np.full((count, 2), np.nan)
    off = np.zeros(count, dtype=bool)
    excess = np.full(count, np.nan)
    if count < _FEWEST + 1:
        return Expected(place, off, excess)
    usual = float(np.median(radius))
    floor = _LEAST_OFF_PX + _LEAST_OFF_RADII * usual
    for row in range(count):
        guesses = _guesses(frame, centre, variance, row)
        if not guesses:
            continue
        away = [float(np.hypot(*(centre[row] - guess))) for guess, _ in guesses]
        scaled = [
            gap**2 / (2.0 * (variance[row] + spread))
            for gap, (_, spread) in zip(away, guesses, strict=True)
        ]
        best = int(np.argmin(scaled))
        place[row], excess[row] = guesses[best][0], scaled[best]
        off[row] = min(away) > floor and scaled[best] > 0.5 * _OFF_SIGMA**2
    near = np.array([_near_radius(frame, radius, row) for row in range(count)])
    off |= np.abs(np.log(radius / near)) > _SWOLLEN
    return Expected(place, off, excess)


def _near_radius(frame: IntArray, radius: FloatArray, row: int) -> float:
    """Usual radius of the frames around one, itself left out."""
    near = np.abs(frame - frame[row]) <= 2 * _FURTHEST
    near[row] = False
    return float(np.median(radius[near])) if near.sum() >= _FEWEST else float(radius[row])


def _guesses(
    frame: IntArray, centre: FloatArray, variance: FloatArray, row: int
) -> list[tuple[FloatArray, float]]:
    """Predictions from both sides and from either, each with its variance."""
    count = len(frame)
    before = np.arange(max(0, row - _ALONE), row)
    after = np.arange(row + 1, min(count, row + 1 + _ALONE))
    before = before[frame[row] - frame[before] <= _FURTHEST]
    after = after[frame[after] - frame[row] <= _FURTHEST]
    sides = [np.concatenate([before[-_EACH_SIDE:], after[:_EACH_SIDE]]), before, after]
    guesses = []
    for chosen in sides:
        if len(chosen) >= _FEWEST:
            time = (frame[chosen] - frame[row]).astype(np.float64)
            guesses.append(_predicted(time, centre[chosen], variance[chosen]))
    return guesses


def _predicted(
    time: FloatArray, centre: FloatArray, variance: FloatArray
) -> tuple[FloatArray, float]:
    """Robust parabola at time 0, and its variance from what is stated and from its residuals."""
    scale = max(float(np.abs(time).max()), 1.0)
    degree = 2 if len(time) > _FEWEST else 1
    design = np.vander(time / scale, degree + 1, increasing=True)
    steady = variance + 1e-6
    weight = 1.0 / steady
    value = centre[0]
    for _ in range(_ROUNDS):
        inverse = np.linalg.inv((design * weight[:, None]).T @ design + 1e-9 * np.eye(degree + 1))
        fitted = inverse @ (design * weight[:, None]).T @ centre
        value = fitted[0]
        square = np.sum((centre - design @ fitted) ** 2, axis=1)
        usual = max(float(np.median(square)), float(np.median(steady)))
        weight = 1.0 / (steady * (1.0 + square / (4.0 * usual)) ** 2)
    spread = float(np.median(square)) / 1.4 / float(np.median(steady))
    return value, float(inverse[0, 0]) * max(1.0, spread)
