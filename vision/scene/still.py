"""The scene before the strike: with the ball, its shadow and all that leaves with it still there.

Against the scene without the ball, a mass that comes near is one with the shadow of the ball and
with what the ball hides; against the scene before the strike, it is all that differs.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.ball.rest import Rest
from vision.scene.scene import Scene

__all__ = ["scene_before_strike"]

FloatImage = NDArray[np.float32]

_SAMPLES = 15
_LEAST_FRAMES = 9
_STEADY = 3.0
# Frames, of those sampled, in which a pixel may differ by accident.
_STRAY = 1
_CLOSED = 0.5


def scene_before_strike(scene: Scene, rest: Rest, radius: float) -> FloatImage:
    """Median of the frames in which the ball lies still.

    Parameters
    ----------
    scene : Scene
        Footage with its static scene.
    rest : Rest
        The ball before it is struck.
    radius : float
        Ball radius, px.

    Returns
    -------
    (H, W) float32 array
        In reference brightness. Where the frames do not agree with one another, because something
        lingers there for part of the time, the static scene.
    """
    if rest.last - rest.first < _LEAST_FRAMES:
        return scene.background.image
    wanted = np.unique(np.linspace(rest.first, rest.last, _SAMPLES).astype(np.int64))
    even = [
        picture / np.float32(scene.views[index].gain) for index, picture in scene.pictures(wanted)
    ]
    stack = np.sort(np.stack(even), axis=0)
    middle, still = stack[len(stack) // 2], scene.background.image
    quarter = len(stack) // 4
    noise = scene.background.noise
    steady = stack[-1 - quarter] - stack[quarter] < _STEADY * noise
    return np.where(steady & ~_lingering(stack, still, noise, radius), middle, still)


def _lingering(
    stack: FloatImage, still: FloatImage, noise: FloatImage | float, radius: float
) -> NDArray[np.bool_]:
    """Where a thing stands for most of the time that uncovers the static scene for the rest.

    A thick, slow mass may leave the middle of its way to the ball uncovered in no frame at all.
    """
    low, high = stack[_STRAY], stack[-1 - _STRAY]
    uncovered = np.minimum(np.abs(low - still), np.abs(high - still)) < _STEADY * noise
    other = np.abs(stack[len(stack) // 2] - still) > _STEADY * noise
    gone = (uncovered & other & (high - low > 2.0 * _STEADY * noise)).astype(np.uint8)
    gone = cv2.morphologyEx(gone, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    size = 2 * int(_CLOSED * radius) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.asarray((cv2.morphologyEx(gone, cv2.MORPH_CLOSE, kernel) > 0) & other)
