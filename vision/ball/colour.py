"""The colour in which what moves stands out: a ball as light as the wall may have another colour.

A shadow has no colour of its own and neither has a change of light, so that in colour differences
(C_B and C_R of ITU-R BT.601) only things are left. What moved there is weighed by its square; the
directions of that sum are the colours worth looking in. Codecs store colour at half the sharpness:
it is asked only where gray leaves doubt.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.scene import FilmedScene

__all__ = ["TINT_STD_PX", "moving_colours"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]

TINT_STD_PX = 0.25
"""px: colour samples lie at the left pixel of two, or between them, as few files tell (ITU-T H.273,
chroma sample location): half a pixel apart."""
_FRAMES = 15
"""Frames whose median shows the scene's own colour, supposed: a thing is elsewhere in most."""
_GRAIN = 2
"""px: colour is stored for each second one."""
_SMOOTH = 3
"""Colour samples that are averaged: a codec's blocks differ by less."""
_SIGMA = 8.0
"""Standard deviations of noise: see `MotionClock`."""
_LEAST_NOISE = 0.5
"""Levels: what rounding leaves, 1/√12, and the codec's quantiser."""
_FEWEST = 20
"""Colour samples that changed in all frames together: fewer are no thing."""
_LEAST_COLOUR = 5.0
"""Levels: a weaker colour is lost in the codec's quantiser, supposed."""


def moving_colours(scene: FilmedScene) -> list[FloatArray]:
    """Directions in the plane of C_B and C_R in which what moves differs from the scene.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.

    Returns
    -------
    list of (2,) arrays
        Unit vectors, the strongest first; none where what moves has no colour of its own.
    """
    wanted = scene.spread(_FRAMES)
    stack = np.stack([_colour_differences(image) for _, image in scene.coloured(wanted)])
    change = stack - np.median(stack, axis=0)
    noise = 1.4826 * np.median(np.abs(change), axis=(0, 1, 2)) + _LEAST_NOISE
    moved = change[np.sum((change / noise) ** 2, axis=3) > _SIGMA**2]
    if len(moved) < _FEWEST:
        return []
    square, axes = np.linalg.eigh((moved.T @ moved / len(moved)).astype(np.float64))
    return [axes[:, k] for k in (1, 0) if square[k] > _LEAST_COLOUR**2]


def _colour_differences(image: NDArray[np.uint8]) -> FloatImage:
    """C_B and C_R (h, w, 2) of an image (H, W, 3), blue first."""
    size = (max(1, image.shape[1] // _GRAIN), max(1, image.shape[0] // _GRAIN))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    both = cv2.cvtColor(small, cv2.COLOR_BGR2YCrCb)[:, :, :0:-1].astype(np.float32)
    return np.asarray(cv2.blur(both, (_SMOOTH, _SMOOTH)), dtype=np.float32)
