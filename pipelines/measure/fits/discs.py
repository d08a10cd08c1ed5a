"""A strike between two balls or pucks: the moment they touch, from straight lines on each side."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.tracks import Track, Tracks

__all__ = ["DiscContact", "disc_contact"]

FloatArray = NDArray[np.float64]

_LINE_FRAMES = 10
"""Frames of a line on either side of the meeting: gliding discs slow down little over them."""
RADIUS_STD_PX = 0.3
"""px, of the distance of two outlines at their touch, supposed: the edges of both, blurred by
motion."""


@dataclass(frozen=True)
class DiscContact:
    """When two round bodies met.

    Attributes
    ----------
    time_s, std_s : float
        The meeting, s from the first frame.
    longest_s : float
        The contact lasted no longer than this (k = 2).
    """

    time_s: float
    std_s: float
    longest_s: float


def disc_contact(tracks: Tracks) -> DiscContact | None:
    """Find when the striker met the struck ball.

    The striker's gap closes along a line that reaches zero at first touch; the struck ball leaves
    along a line that started at its rest. Between the two lies the contact.

    Parameters
    ----------
    tracks : Tracks
        With the struck ball as `ball` and the striker as the first of `others`.

    Returns
    -------
    DiscContact or None
        None where there is no striker, or it is not seen on both sides.
    """
    if tracks.pendulum is not None or not tracks.others or tracks.rest_frames is None:
        return None
    ball, striker, last = tracks.ball, tracks.others[0].track, tracks.rest_frames[1]
    still = ball.frame <= last - 1
    if still.sum() < 3:
        return None
    rest = np.median(ball.centre_px[still], axis=0)
    reach = float(np.median(ball.radius_px) + np.median(striker.radius_px))
    gap = np.hypot(*(striker.centre_px - rest).T) - reach
    closing = _line_to_zero(
        striker, gap, (striker.frame < last) & (striker.frame >= last - _LINE_FRAMES)
    )
    away = np.hypot(*(ball.centre_px - rest).T)
    leaving = _line_to_zero(
        ball, away, (ball.frame > last + 1) & (ball.frame <= last + _LINE_FRAMES)
    )
    if closing is None or leaving is None:
        return None
    touch, touch_std, speed = closing
    touch_std = math.hypot(touch_std, RADIUS_STD_PX / abs(speed))
    left, left_std, _ = leaving
    weights = np.array([touch_std, left_std]) ** -2.0
    time = float(weights @ [touch, left] / weights.sum())
    return DiscContact(
        time,
        float(weights.sum() ** -0.5),
        max(left - touch, 0.0) + 2.0 * math.hypot(touch_std, left_std),
    )


def _line_to_zero(
    track: Track, distance: FloatArray, used: NDArray[np.bool_]
) -> tuple[float, float, float] | None:
    """Time at which a line through distances reaches zero, its std, and the slope (px/s)."""
    if used.sum() < 4:
        return None
    time = track.time_s[used]
    middle = float(time.mean())
    slope, offset = np.polyfit(time - middle, distance[used], 1)
    if slope == 0:
        return None
    left = distance[used] - slope * (time - middle) - offset
    noise = float(np.sqrt((left**2).sum() / (used.sum() - 2)))
    at = -offset / slope
    spread = float(((time - middle) ** 2).sum())
    std = noise / abs(slope) * math.sqrt(1.0 / used.sum() + at**2 / spread)
    return middle + at, std, float(slope)
