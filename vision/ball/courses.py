"""Stretches of a path that one constant acceleration explains."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled

__all__ = ["lawful_stretch"]

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]

_TRIALS = 200
"""Sets of looks tried: of two hundred one is free of outliers even where only a fifth of all looks
is right."""

# Of so many sets one agrees by chance more often than any given one does, nats.
_SEARCHED = float(np.log(_TRIALS))

_FEWEST = 5
"""Looks: a parabola has three unknowns, and two more show whether it is one."""

# Circles of edges scatter by about this: px, and in radii.
_PATH_SCATTER_PX = 0.7

_PATH_SCATTER_RADII = 0.12
"""Radii, scatter of a rough outline about its path, supposed."""

# A look that is off the motion costs so many nats: some are mistaken.
_OFF_PRICE = 1.0

_LEAST_TRAVEL = 1.0


@dataclass(frozen=True)
class LawfulStretch:
    """The part of a path that one constant acceleration explains.

    Attributes
    ----------
    first, last : int
        Its first and last frame.
    looks : int
        How many looks agree.
    evidence : float
        How much more likely they are so than by chance, nats; 0 where there is no such stretch.
    travel_px : float
        How far it goes, px.
    """

    first: int
    last: int
    looks: int
    evidence: float
    travel_px: float


def lawful_stretch(frame: IntArray, centre: FloatArray, radius: float) -> LawfulStretch:
    """Find the stretch of a path with the most evidence for a constant acceleration.

    Parameters
    ----------
    frame : (N,) int array
        Frames, increasing.
    centre : (N, 2) array
        Centres, px.
    radius : float
        Radius, px.

    Returns
    -------
    LawfulStretch
        With no evidence where the thing stays where it is.
    """
    count = len(frame)
    nothing = LawfulStretch(int(frame[0]), int(frame[0]), 0, 0.0, 0.0)
    if count < _FEWEST:
        return nothing
    tolerance = _tolerance(radius)
    chosen = _triples(count)
    explained = np.empty(5)
    _explained(frame.astype(np.float64), centre, chosen, tolerance, radius, explained)
    first, last, looks = (int(value) for value in explained[:3])
    if looks == 0:
        return nothing
    return LawfulStretch(
        int(frame[first]), int(frame[last]), looks, float(explained[3]), float(explained[4])
    )


def _tolerance(radius: float) -> float:
    return _PATH_SCATTER_PX + _PATH_SCATTER_RADII * radius


@compiled
def _explained(
    frame: FloatArray,
    centre: FloatArray,
    chosen: IntArray,
    tolerance: float,
    radius: float,
    best: FloatArray,
) -> None:
    """Find the run of looks with the most evidence among those about sets of three chosen ones.

    Writes its first and last look, how many agree, the evidence and how far it goes, px; nought
    agree where no run has evidence. Of equals the longest is taken.
    """
    best[:] = 0.0
    off = np.empty(len(frame), dtype=np.bool_)
    for trial in range(len(chosen)):
        _astray(frame, centre, chosen[trial], tolerance, off)
        # as far on either side of the chosen ones as most agree, and no further
        first, last, gain, most = chosen[trial, 0], chosen[trial, 2], 0.0, 0.0
        for k in range(first - 1, -1, -1):
            gain += -1.0 if off[k] else 0.5
            if gain > most:
                first, most = k, gain
        gain, most = 0.0, 0.0
        for k in range(last + 1, len(frame)):
            gain += -1.0 if off[k] else 0.5
            if gain > most:
                last, most = k, gain
        looks, low_x, high_x, low_y, high_y = 0, np.inf, -np.inf, np.inf, -np.inf
        for k in range(first, last + 1):
            if not off[k]:
                looks += 1
                low_x, high_x = min(low_x, centre[k, 0]), max(high_x, centre[k, 0])
                low_y, high_y = min(low_y, centre[k, 1]), max(high_y, centre[k, 1])
        travel = math.hypot(high_x - low_x, high_y - low_y) if looks > 0 else 0.0
        if travel < _LEAST_TRAVEL * radius or looks < _FEWEST:
            continue
        evidence = (looks - 3) * math.log1p(travel / tolerance) - _SEARCHED
        evidence -= _OFF_PRICE * (last + 1 - first - looks)
        longer = last - first > best[1] - best[0]
        if evidence > best[3] or (evidence == best[3] and longer and best[2] > 0.0):
            best[0], best[1], best[2], best[3], best[4] = first, last, looks, evidence, travel


@compiled
def _astray(
    frame: FloatArray,
    centre: FloatArray,
    chosen: IntArray,
    tolerance: float,
    off: NDArray[np.bool_],
) -> None:
    """Write which looks lie off the parabola through three chosen ones."""
    begin, middle, end = chosen
    span = max(frame[end] - frame[begin], 1.0)
    part = (frame[middle] - frame[begin]) / span
    x, y = centre[begin]
    dx, dy = centre[end, 0] - x, centre[end, 1] - y
    bend = part * part - part
    bend_x = (centre[middle, 0] - x - part * dx) / bend
    bend_y = (centre[middle, 1] - y - part * dy) / bend
    for k in range(len(frame)):
        time = (frame[k] - frame[begin]) / span
        away_x = centre[k, 0] - x - time * (dx - bend_x + time * bend_x)
        away_y = centre[k, 1] - y - time * (dy - bend_y + time * bend_y)
        off[k] = math.hypot(away_x, away_y) > tolerance


@cache
def _triples(count: int) -> IntArray:
    """Sets of three looks at all distances, the same for all paths of a length.

    Short ones are as frequent as long ones: a thing that bounces often is lawful in between.
    """
    rng = np.random.default_rng(count)
    longest = float(count - 1)
    span = np.rint(4.0 * (longest / 4.0) ** rng.uniform(size=_TRIALS)).astype(np.int64)
    start = np.floor(rng.uniform(size=_TRIALS) * (count - span)).astype(np.int64)
    middle = start + 1 + np.floor(rng.uniform(size=_TRIALS) * (span - 1)).astype(np.int64)
    return np.column_stack([start, middle, start + span])
