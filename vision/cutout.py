"""The pixels around a ball, cut out of frame and background and turned into linear light.

An edge pixel mixes light from ball and background before the camera's transfer curve bends it:
mixed in
gray levels as they are, the edge of a dark ball before a bright wall would lie too far inside.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vision.outline import RingPixels
from vision.scene import Scene

__all__ = ["TYPICAL_GAMMA", "Hides", "ring_pixels", "ring_widths"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
Hides = Callable[[FloatArray, FloatArray], BoolArray]

# Exponent that sRGB and ITU-R BT.709 come to over the brighter half of their range.
TYPICAL_GAMMA = 1.85


def ring_widths(radius: float) -> tuple[float, float]:
    """How far inside and outside the outline pixels are used, px."""
    return float(np.clip(0.2 * radius, 2.2, 6.0)), float(np.clip(0.2 * radius, 2.5, 4.0))


def ring_pixels(
    scene: Scene,
    index: int,
    picture: FloatImage,
    centre: FloatArray,
    reach: float,
    gamma: float,
    hidden: Hides | None = None,
) -> RingPixels | None:
    """Cut out what an outline fit needs.

    Parameters
    ----------
    scene : Scene
        Footage with its static scene.
    index : int
        Frame index.
    picture : (H, W) float32 array
        That frame.
    centre : (2,) array
        Middle of the cut-out, px.
    reach : float
        Its half width, px.
    gamma : float
        Exponent of the transfer curve.
    hidden : callable, optional
        Gives for pixels (x, y) whether something else is in front.

    Returns
    -------
    RingPixels or None
        None if it lies outside the picture.
    """
    height, width = picture.shape
    left, top = max(0, int(centre[0] - reach)), max(0, int(centre[1] - reach))
    right, bottom = min(width, int(centre[0] + reach) + 2), min(height, int(centre[1] + reach) + 2)
    if right - left < 5 or bottom - top < 5:
        return None
    window = (slice(top, bottom), slice(left, right))
    rows, columns = np.mgrid[top:bottom, left:right]
    x, y = columns.ravel().astype(np.float64), rows.ravel().astype(np.float64)
    near = np.hypot(x - centre[0], y - centre[1]) < reach
    x, y = x[near], y[near]
    gray = picture[window].ravel()[near].astype(np.float64)
    background = scene.expected(index, window).ravel()[near].astype(np.float64)
    noise = scene.background.noise[window].ravel()[near].astype(np.float64)
    usable = np.ones(x.shape, dtype=bool)
    if hidden is not None:
        usable &= ~hidden(x, y)
    slope = gamma * np.clip(gray / 255.0, 0.05, 1.0) ** (gamma - 1.0)
    return RingPixels(x, y, _linear(gray, gamma), _linear(background, gamma), noise * slope, usable)


def _linear(gray: FloatArray, gamma: float) -> FloatArray:
    return np.asarray(255.0 * np.clip(gray / 255.0, 0.0, 1.0) ** gamma)
