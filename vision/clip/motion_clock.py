"""A clock that ticks when something moves: frames before and after the action count for nothing.

What a look at every so-many frames can tell depends on how far things move between looks, not on
the frame rate nor on how long nothing happened. So each frame is held, coarsely, against the last
one that differed: a slow motion ticks when it has come far enough to be seen, a fast one with every
frame, a still picture hardly ever.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.clip.info import GrayImage

__all__ = ["MotionClock"]

FloatImage = NDArray[np.float32]

# Side of the cells whose means are compared, px: a ball of 5 px fills a third of one.
_CELL = 8
_FINEST_CELL = 4
# A small picture still gets so many cells across.
_CELLS_ACROSS = 24
# Means of a cell that move by so many of their own noise, and at least this much of white, moved.
_SIGMA = 8.0
_LEAST_CHANGE = 1.5 / 255.0
# Still frames tick like 1, 1/2, 1/3, ... of this.
_STILL_TICK = 0.25


class MotionClock:
    """Tells for each frame shown to it, in order, whether something moved, and keeps the time.

    Attributes
    ----------
    time : float
        Ticks so far: about one for each frame in which something moved.
    """

    def __init__(self) -> None:
        self.time = 0.0
        self._reference: FloatImage | None = None
        self._still = 0

    def tick(self, frame: GrayImage) -> bool:
        """Show the next frame (H, W); says whether it differs from the last that differed."""
        cells = _cells(frame)
        full = 255.0 if frame.dtype == np.uint8 else 65535.0
        if self._reference is None:
            self._reference = cells
            return False
        if _differ(cells, self._reference, full):
            self._reference = cells
            self._still = 0
            self.time += 1.0
            return True
        self._still += 1
        self.time += _STILL_TICK / self._still
        return False


def _cells(frame: GrayImage) -> FloatImage:
    height, width = frame.shape
    cell = int(np.clip(min(height, width) // _CELLS_ACROSS, _FINEST_CELL, _CELL))
    size = (max(1, width // cell), max(1, height // cell))
    trimmed = frame[: max(1, size[1] * cell), : max(1, size[0] * cell)]
    half = (min(2 * size[0], width), min(2 * size[1], height))
    fine = cv2.resize(trimmed, half, interpolation=cv2.INTER_AREA).astype(np.float32)
    return np.asarray(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _differ(cells: FloatImage, reference: FloatImage, full: float) -> bool:
    """Whether some cell changed by more than its noise, a change of light left aside."""
    usual = float(np.median(reference))
    gain = float(np.median(cells)) / usual if usual > 0.0 else 1.0
    change = np.abs(cells - np.float32(gain) * reference)
    noise = 1.4826 * float(np.median(change))
    return bool(change.max() > max(_SIGMA * noise, _LEAST_CHANGE * full))
