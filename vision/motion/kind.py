"""What happens in a clip: a strike, a flight, a drop, a swing, a collision, or nothing."""

import numpy as np

from vision.tracks import Motion, MotionKind, Track

__all__ = ["motion_of"]

_FEWEST = 5


def motion_of(
    ball: Track,
    rest_frames: tuple[int, int] | None,
    *,
    pendulum: bool,
    struck_by_another: bool,
) -> Motion:
    """Say what happened to the ball.

    Parameters
    ----------
    ball : Track
        What was followed.
    rest_frames : tuple of int or None
        First and last frame in which it lies still before it leaves.
    pendulum : bool
        Whether a pendulum was followed to it.
    struck_by_another : bool
        Whether another ball came to it while it lay still.

    Returns
    -------
    Motion
    """
    if len(ball) < _FEWEST:
        return Motion(MotionKind.NONE, 1.0, ("too few frames show anything that moves",))
    first = int(ball.frame[0]) if rest_frames is None else rest_frames[1]
    frames = (first, int(ball.frame[-1]))
    if struck_by_another and rest_frames is not None:
        return Motion(
            MotionKind.COLLISION, 0.9, ("another ball met it while it lay still",), frames
        )
    if rest_frames is not None and pendulum:
        reasons = ("a pendulum met it while it lay still",)
        return Motion(MotionKind.STRIKE, 0.9, reasons, frames)
    moved = ball.centre_px[ball.frame >= first]
    across, down = np.ptp(moved, axis=0)
    if rest_frames is not None and across > 0.3 * down:
        return Motion(MotionKind.STRIKE, 0.6, ("it lay still and left sideways",), frames)
    kind = MotionKind.DROP if across < 0.1 * down else MotionKind.FLIGHT
    return Motion(kind, 0.6, ("nothing was seen to strike it",), frames)
