"""The scene before the strike: with the ball, its shadow and all that leaves with it still there.

Against the scene without the ball, a mass that comes near is one with the shadow of the ball and
with what the ball hides; against the scene before the strike, it is all that differs.
"""

import numpy as np
from numpy.typing import NDArray

from vision.rest import Rest
from vision.scene import Scene

__all__ = ["scene_before_strike"]

FloatImage = NDArray[np.float32]

_SAMPLES = 15
_LEAST_FRAMES = 9
_STEADY = 3.0


def scene_before_strike(scene: Scene, rest: Rest) -> FloatImage:
    """Median of the frames in which the ball lies still.

    Parameters
    ----------
    scene : Scene
        Footage with its static scene.
    rest : Rest
        The ball before it is struck.

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
    middle = stack[len(stack) // 2]
    quarter = len(stack) // 4
    spread = stack[-1 - quarter] - stack[quarter]
    steady = spread < _STEADY * scene.background.noise
    return np.asarray(np.where(steady, middle, scene.background.image), dtype=np.float32)
