"""Until when the ball surely flies: it lands, bounces, or the path jumps to something else."""

import numpy as np
from numpy.typing import NDArray

from pipelines.measure.inputs import Inputs
from pipelines.measure.metres import MetricTracks

__all__ = ["LONGEST_CONTACT_S", "flight_end"]

FloatArray = NDArray[np.float64]

LONGEST_CONTACT_S = 0.025
_JUST_ABOVE_M = 0.004
_BOUNCE_M = 0.01
_JUMP_RADII = 0.5
_HARDEST_PULL = 15.0
"""m/s²: gravity with drag and lift of a fast, light ball."""


def flight_end(tracks: MetricTracks, inputs: Inputs, left: float) -> float:
    """Time before which the ball surely flies, s.

    Parameters
    ----------
    tracks : MetricTracks
        Ball plane.
    inputs : Inputs
        How far the ball may fall, where that is known.
    left : float
        When the ball has left its rest, s.

    Returns
    -------
    float
        The earliest of: the floor is reached, the ball rises again after its fall, the path jumps
        away from itself; just after the last frame where nothing of that is seen.
    """
    after = np.flatnonzero(tracks.ball_time_s > left + LONGEST_CONTACT_S)
    time, place = tracks.ball_time_s[after], tracks.ball_m[after]
    if len(time) == 0:
        return float(tracks.ball_time_s[-1]) + 1e-9
    ends = [float(time[-1]) + 1e-9]
    jump = _jump(time, place, tracks)
    if jump is not None:
        ends.append(float(time[jump]))
    height = place[:, 1]
    if inputs.fall is not None:
        floor = tracks.rest_m[1] - inputs.fall
        ends += [float(t) for t in time[height <= floor + _JUST_ABOVE_M][:1]]
    highest = int(np.argmax(height))
    lowest = highest + int(np.argmin(height[highest:]))
    if np.any(height[lowest:] - height[lowest] > _BOUNCE_M):
        ends.append(float(time[lowest]))
    return min(ends)


def _jump(time: FloatArray, place: FloatArray, tracks: MetricTracks) -> int | None:
    """First frame from which the path no longer carries on from where it was.

    A single frame that is off is left to the robust fit.
    """
    noise = 6.0 * float(np.median(np.sqrt(np.trace(tracks.ball_cov_m2, axis1=1, axis2=2))))
    last, so_far = 1, 0
    for k in range(2, len(time)):
        before = time[last] - time[so_far]
        velocity = (place[last] - place[so_far]) / before
        ahead = time[k : k + 2] - time[last]
        missed = np.hypot(*(place[k : k + 2] - place[last] - velocity * ahead[:, None]).T)
        allowed = (
            _JUMP_RADII * tracks.radius_m
            + 0.5 * _HARDEST_PULL * ahead * (ahead + before)
            + noise * (1.0 + ahead / before)
        )
        if np.all(missed > allowed):
            return k
        if missed[0] <= allowed[0]:
            last, so_far = k, last
    return None
