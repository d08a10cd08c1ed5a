"""How lawfully a thing moves: the stretch of its path that a constant acceleration explains.

A thrown, struck or falling ball runs along a parabola, a rolling one along a line; a hand, a blob
or a string of unrelated edges does not. Each look beyond the three that fix the motion, and that
lies where the motion says, would have lain there by chance with a probability of about tolerance
over travel; the logarithms add up to the evidence.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LawfulStretch", "lawful_stretch"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_TRIALS = 120
_FEWEST = 5
# Circles of edges scatter by about this: px, and in radii.
_SCATTER_PX = 0.7
_SCATTER_RADII = 0.12
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
    tolerance = _SCATTER_PX + _SCATTER_RADII * radius
    best = nothing
    for chosen in _triples(count):
        time = (frame - frame[chosen[0]]).astype(np.float64) / max(
            float(frame[chosen[2]] - frame[chosen[0]]), 1.0
        )
        powers = np.column_stack([np.ones(count), time, time * time])
        expected = powers @ np.linalg.solve(powers[chosen], centre[chosen])
        off = np.hypot(*(centre - expected).T) > tolerance
        first, last = _best_run(off, chosen)
        agree = ~off[first : last + 1]
        place = centre[first : last + 1][agree]
        travel = float(np.hypot(*np.ptp(place, axis=0)))
        if travel < _LEAST_TRAVEL * radius or len(place) < _FEWEST:
            continue
        spare = len(place) - 3
        evidence = spare * np.log1p(travel / tolerance) - _OFF_PRICE * np.count_nonzero(~agree)
        if evidence > best.evidence:
            best = LawfulStretch(
                int(frame[first]), int(frame[last]), len(place), float(evidence), travel
            )
    return best


def _triples(count: int) -> IntArray:
    """Sets of three looks at all distances, the same for all paths of a length."""
    rng = np.random.default_rng(count)
    triples: list[tuple[int, int, int]] = []
    while len(triples) < _TRIALS:
        span = int(rng.integers(4, max(count, 5)))
        start = int(rng.integers(0, max(count - span, 1)))
        end = min(start + span, count - 1)
        middle = int(rng.integers(start + 1, end))
        triples.append((start, middle, end))
    return np.array(triples, dtype=np.int64)


def _best_run(off: NDArray[np.bool_], chosen: IntArray) -> tuple[int, int]:
    """First and last look of the run about the chosen ones in which most agree."""
    gain = np.where(off, -1.0, 0.5)
    low, high = int(chosen[0]), int(chosen[2])
    before = np.cumsum(gain[:low][::-1])
    after = np.cumsum(gain[high + 1 :])
    if len(before) and before.max() > 0:
        low -= int(np.argmax(before)) + 1
    if len(after) and after.max() > 0:
        high += int(np.argmax(after)) + 1
    return low, high
