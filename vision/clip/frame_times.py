"""Frame times from the container's time stamps: sorted, and freed of their rounding.

Containers round time stamps to their ticks: 600 frames per second in a Matroska file (1 ms) come as
steps of 1 and 2 ms. Where every stamp lies within a tick of an even clock (frames missing from it
allowed), that clock is the better estimate of each time; where not, the rate varies and the stamps
stand.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["FrameTimes", "frame_times"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class FrameTimes:
    """When each frame is shown.

    Attributes
    ----------
    stamps : (N,) int array
        Time stamps in ticks, increasing.
    seconds : (N,) array
        Times, s, 0 at the first frame.
    interval_s : float
        Usual interval between frames, s; NaN for a single frame.
    variable : bool
        Whether the stamps do not fit an even clock.
    missing : int
        Frames that an even clock has and the clip has not.
    """

    stamps: NDArray[np.int64]
    seconds: FloatArray
    interval_s: float
    variable: bool
    missing: int


def frame_times(
    stamps: NDArray[np.int64], tick_s: float, declared_fps: tuple[float, ...] = ()
) -> FrameTimes:
    """Build the table of times.

    Parameters
    ----------
    stamps : (N,) int array
        Presentation time stamps in any order; repeated ones are kept once.
    tick_s : float
        Length of a tick, s.
    declared_fps : tuple of float
        Rates that the container declares; one that fits every stamp as well is preferred to the
        fitted rate.

    Returns
    -------
    FrameTimes
    """
    ticks = np.unique(stamps)
    since = (ticks - ticks[0]).astype(np.float64) if len(ticks) else np.zeros(0)
    if len(ticks) < 3:
        interval = tick_s * since[-1] if len(ticks) == 2 else np.nan
        return FrameTimes(ticks, tick_s * since, float(interval), False, 0)
    count, interval_ticks = _even_clock(since)
    declared_ticks = [1.0 / (fps * tick_s) for fps in declared_fps if fps > 0]
    for candidate in (*declared_ticks, interval_ticks):
        if not _fits(since, count, candidate):
            continue
        interval_ticks = candidate
        missing = int(count[-1]) + 1 - len(count)
        seconds = tick_s * interval_ticks * count
        return FrameTimes(ticks, seconds, tick_s * interval_ticks, False, missing)
    usual = float(np.median(np.diff(since)))
    return FrameTimes(ticks, tick_s * since, tick_s * usual, True, 0)


def _even_clock(since: FloatArray) -> tuple[FloatArray, float]:
    """Which beat of an even clock each stamp is, and the clock's interval in ticks."""
    steps = np.diff(since)
    beats = np.maximum(1.0, np.round(steps / np.median(steps)))
    count = np.concatenate([[0.0], np.cumsum(beats)])
    interval = _slope(count, since)
    count = np.round(since / interval)
    if np.any(np.diff(count) < 1):
        count = np.concatenate([[0.0], np.cumsum(beats)])
    return count, _slope(count, since)


def _fits(since: FloatArray, count: FloatArray, interval: float) -> bool:
    residual = since - count * interval
    return float(np.ptp(residual)) <= 2.0


def _slope(count: FloatArray, since: FloatArray) -> float:
    centred = count - count.mean()
    return float(centred @ since / (centred @ centred))
