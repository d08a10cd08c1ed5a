"""The circle of edges nearest a guess: all that a ball of a few pixels allows."""

import numpy as np
from numpy.typing import NDArray

from vision.ball.circles import find_circles
from vision.ball.outline.fits import OutlineFits, nothing_found
from vision.scene.scene import Scene, Window

__all__ = ["voted_outlines"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
IntArray = NDArray[np.int64]

_VOTED_STD = 0.15
# How much a circle's radius scatters (natural logarithm).
_SWELLING = 0.15
_SMALLEST_WINDOW = 16


def voted_outlines(scene: Scene, frame: IntArray, guess: FloatArray, radius: float) -> OutlineFits:
    """Find the circle of edges nearest each guess.

    Parameters
    ----------
    scene : Scene
        Footage with its static scene.
    frame : (F,) int array
        Frame indices, increasing.
    guess : (F, 2) array
        Where it may be, px.
    radius : float
        Its radius, px.

    Returns
    -------
    OutlineFits
    """
    fits = nothing_found(len(frame))
    windows = [_window(start, radius, scene.shape) for start in guess]
    for place, (index, gray) in enumerate(scene.windows(frame, windows)):
        if min(gray.shape) >= _SMALLEST_WINDOW:
            picture = gray.astype(np.float32)
            _vote(scene, index, picture, windows[place], guess[place], radius, fits, place)
    return fits


def _window(start: FloatArray, radius: float, shape: tuple[int, int]) -> Window:
    reach = int(np.ceil(2.5 * radius + 6))
    x, y = int(start[0]), int(start[1])
    return (
        slice(max(0, y - reach), max(0, min(shape[0], y + reach + 1))),
        slice(max(0, x - reach), max(0, min(shape[1], x + reach + 1))),
    )


def _vote(
    scene: Scene,
    index: int,
    picture: FloatImage,
    window: Window,
    start: FloatArray,
    radius: float,
    fits: OutlineFits,
    place: int,
) -> None:
    circles = find_circles(
        picture,
        scene.expected(index, window),
        np.ascontiguousarray(scene.background.noise[window]),
        radii=(0.75 * radius, 1.3 * radius),
        most=8,
        least_coverage=0.5,
    )
    if len(circles) == 0:
        return
    centres = circles.centre_px + np.array([window[1].start, window[0].start])
    gap = np.hypot(*(centres - start).T)
    swollen = np.log(circles.radius_px / radius) / _SWELLING
    clear = circles.coverage * np.log1p(circles.sharpness)
    clear /= (1.0 + (gap / radius) ** 2) * (1.0 + swollen**2)
    best = int(np.argmax(clear))
    std = max(_VOTED_STD, 0.03 * radius) * max(1.0, 30.0 / float(circles.sharpness[best]))
    # A circle of another size is not the outline: its centre may be off by as much.
    std = float(np.hypot(std, circles.radius_px[best] - radius))
    fits.found[place] = True
    fits.centre[place] = centres[best]
    fits.radius[place] = circles.radius_px[best]
    fits.covariance[place] = std**2 * np.eye(2)
    fits.bound[place] = std**2 / 9.0 * np.eye(2)
    fits.misfit[place] = 1.0
    fits.contrast[place] = circles.coverage[best]
