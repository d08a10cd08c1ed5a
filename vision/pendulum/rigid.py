"""A rigid thing followed by its look: a patch registered against the known background.

The patch is a layer: its look T and its opacity α in the patch's own coordinates. A frame shows
α·T + (1 − α)·B where the patch lies; B is the known background there, so that grid lines sliding by
behind its edge pull nothing. Shift and turn are fitted by Gauss–Newton on this difference.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.compiled import CORRELATED_PIXELS, registered

__all__ = ["Patch", "Pose", "disc", "register", "sampled"]

FloatImage = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_ROW = 16384
"""Pixels of a row: OpenCV's remap takes pictures of less than 32,768 in each direction."""


@dataclass(frozen=True)
class Patch:
    """The look of a rigid thing.

    Attributes
    ----------
    x, y : (n,) arrays
        Patch coordinates about its anchor, px.
    look : (n,) array
        Gray level of the thing, in reference brightness.
    opacity : (n,) array
        0 where the background is seen, 1 where the thing is.
    """

    x: FloatArray
    y: FloatArray
    look: FloatArray
    opacity: FloatArray

    @cached_property
    def points(self) -> FloatImage:
        """x, y, look and opacity as compiled loops take them, (4, n)."""
        return np.array([self.x, self.y, self.look, self.opacity], dtype=np.float32)


@dataclass(frozen=True)
class Pose:
    """Where the patch lies in a frame.

    Attributes
    ----------
    anchor : (2,) array
        Where its anchor is, px.
    turn : float
        Turn in the picture, rad, from +x towards +y.
    covariance : (3, 3) array
        Of anchor x, y (px) and turn (rad).
    rms_residual : float
        Root mean square residual over noise.
    seen : float
        Part of the opaque patch in view and not hidden, 0 to 1.
    """

    anchor: FloatArray
    turn: float
    covariance: FloatArray
    rms_residual: float
    seen: float


def sampled(
    pictures: FloatImage, x: NDArray[Any], y: NDArray[Any], interpolation: int = cv2.INTER_CUBIC
) -> FloatImage:
    """Gray levels of a picture (H, W) or several (H, W, C) at points (n,): (n,) or (n, C).

    OpenCV takes fewer than 32768 points in a row: they are laid out in several.
    """
    count = len(x)
    rows = max(1, -(-count // _ROW))
    maps = np.zeros((2, rows * _ROW if rows > 1 else count), dtype=np.float32)
    maps[0, :count], maps[1, :count] = x, y
    u, v = maps.reshape(2, rows, -1)
    found = cv2.remap(pictures, u, v, interpolation, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found.reshape(-1, *found.shape[2:])[:count])


def register(
    patch: Patch,
    frame: FloatImage,
    background: FloatImage,
    gain: float,
    noise: float,
    start: Pose,
    *,
    turn_std: float,
    hidden: tuple[float, float, float] | None = None,
    anchor_information: FloatArray | None = None,
    iterations: int = 12,
) -> Pose | None:
    """Find the patch in a frame.

    Parameters
    ----------
    patch : Patch
        What to look for.
    frame, background : (H, W) float32 arrays
        The frame, and the static scene in reference brightness.
    gain : float
        Brightness of the frame relative to the scene.
    noise : float
        Standard deviation of a pixel, gray levels.
    start : Pose
        First guess.
    turn_std : float
        How well the guess's turn is known, rad; the fit is held to it that much.
    hidden : tuple of float, optional
        Centre x, y and radius of a disc in which something else may be in front, px.
    anchor_information : (2, 2) array, optional
        Information (1/px²) by which the anchor is held to the guess: across a known arc, say.
    iterations : int
        Steps at most.

    Returns
    -------
    Pose or None
        None where less than a third of it is in view.
    """
    prior = np.zeros((3, 3))
    prior[2, 2] = turn_std**-2
    if anchor_information is not None:
        prior[:2, :2] = anchor_information
    normal = np.empty((4, 4))
    settled, x, y, turn, scale, rms_residual, seen = registered(
        patch.points,
        np.array([*start.anchor, start.turn]),
        prior,
        np.ascontiguousarray(frame, dtype=np.float32),
        np.ascontiguousarray(background, dtype=np.float32),
        float(gain),
        float(noise),
        disc(hidden),
        iterations,
        normal,
    )
    if not settled:
        return None
    covariance = np.linalg.inv(normal)[:3, :3] * scale**2 * CORRELATED_PIXELS
    return Pose(np.array([x, y]), turn, np.asarray(covariance, float), rms_residual, seen)


def disc(hidden: tuple[float, float, float] | None) -> FloatArray:
    """Centre x, y and radius of what may be in front, px; without anything the radius is 0."""
    return np.zeros(3) if hidden is None else np.array(hidden, dtype=np.float64)
