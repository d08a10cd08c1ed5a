"""What an overlay shows beside the tracks, as plain arrays and lines of text."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["OverlayMarks"]


@dataclass(frozen=True)
class OverlayMarks:
    """Marks on the picture; everything may be left out.

    Attributes
    ----------
    contact : (2,) tuple of int or None
        First and last frame in contact, both included.
    grid_px : (N, 2) array or None
        Wall grid points, px.
    landing_px : (2,) array or None
        Where the ball's centre is seen at landing, px.
    landing_label : str
        Written beside the landing point.
    captions : tuple of str
        Results in lines, written below the picture.
    capture_fps : float or None
        Frames per second of the camera, for the running clock; frames are counted without it.
    """

    contact: tuple[int, int] | None = None
    grid_px: NDArray[np.float64] | None = None
    landing_px: NDArray[np.float64] | None = None
    landing_label: str = "landing"
    captions: tuple[str, ...] = ()
    capture_fps: float | None = None
