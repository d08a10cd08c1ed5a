"""When and where the ball lay still before it was struck."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Rest", "find_rest"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FEWEST = 3
"""Frames: a median of fewer does not leave out one that is wrong."""


@dataclass(frozen=True)
class Rest:
    """The ball lying still.

    Attributes
    ----------
    first, last : int
        First and last frame in which it lies still.
    centre_px : (2,) array
        Where, px.
    direction : (2,) array
        Unit vector in which it leaves.
    speed_px : float
        How fast it goes soon after, px per frame.
    """

    first: int
    last: int
    centre_px: FloatArray
    direction: FloatArray
    speed_px: float


def find_rest(frame: IntArray, centre: FloatArray, radius: float) -> Rest | None:
    """Find a first stretch of rest that ends in motion.

    Parameters
    ----------
    frame : (N,) int array
        Frame indices.
    centre : (N, 2) array
        Ball centres, px.
    radius : float
        Ball radius, px.

    Returns
    -------
    Rest or None
        None if the ball moves from the start, or never leaves.
    """
    if len(frame) < 2 * _FEWEST:
        return None
    departure = _departure(centre, radius)
    if departure is None or departure < _FEWEST:
        return None
    place = np.median(centre[:departure], axis=0)
    scatter = 1.4826 * np.median(np.hypot(*(centre[:departure] - place).T))
    tolerance = max(4.0 * float(scatter), 0.003 * radius + 0.05)
    still = np.hypot(*(centre[:departure] - place).T) <= tolerance
    last = int(np.nonzero(still)[0][-1]) if np.any(still) else departure - 1
    after = slice(departure, min(departure + 12, len(frame)))
    if after.stop - after.start < 2:
        return None
    run = centre[after][-1] - centre[after][0]
    elapsed = float(frame[after][-1] - frame[after][0])
    length = float(np.hypot(*run))
    if length < 1e-6:
        return None
    return Rest(int(frame[0]), int(frame[last]), place, run / length, length / elapsed)


def _departure(centre: FloatArray, radius: float) -> int | None:
    """Row at which the ball leaves for good: it goes a radius away without coming back first.

    A few bad fits, while something passes in front or beside, are no departure, and neither are
    bad ones at the start: where the ball dwells for most of that time is where it lies.
    """
    start = np.median(centre[:_FEWEST], axis=0)
    far = np.flatnonzero(np.hypot(*(centre - start).T) > radius)
    if len(far) == 0:
        return None
    if far[0] == 0:
        return 0
    before = centre[: far[0]]
    tolerance = 0.12 * radius + 0.3
    departure = 0
    for place in (start, np.median(before, axis=0)):
        near = np.flatnonzero(np.hypot(*(before - place).T) <= tolerance)
        if len(near) and len(near) > 0.5 * (near[-1] + 1):
            departure = max(departure, int(near[-1]) + 1)
    return departure
