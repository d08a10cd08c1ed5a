"""A rigid thing followed by its look: a patch registered against the known background.

The patch is a layer: its look T and its opacity α in the patch's own coordinates. A frame shows
α·T + (1 − α)·B where the patch lies; B is the known background there, so that grid lines sliding by
behind its edge pull nothing. Shift and turn are fitted by Gauss–Newton on this difference.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Patch", "Pose", "register", "warped"]

FloatImage = NDArray[np.float32]
FloatArray = NDArray[np.float64]

# Neighbouring residuals share interpolation and coding errors; so many pixels count as one.
_CORRELATED_PIXELS = 4.0
_SLOPE = np.array([-0.5, 0.0, 0.5])
_FLAT = np.array([0.0, 1.0, 0.0])


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
    misfit : float
        Root mean square residual over noise.
    seen : float
        Part of the opaque patch in view and not hidden, 0 to 1.
    """

    anchor: FloatArray
    turn: float
    covariance: FloatArray
    misfit: float
    seen: float


def warped(patch: Patch, anchor: FloatArray, turn: float) -> tuple[FloatArray, FloatArray]:
    """Picture coordinates of the patch's points."""
    cosine, sine = np.cos(turn), np.sin(turn)
    return (
        anchor[0] + cosine * patch.x - sine * patch.y,
        anchor[1] + sine * patch.x + cosine * patch.y,
    )


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
    iterations : int
        Steps at most.

    Returns
    -------
    Pose or None
        None where less than a third of it is in view.
    """
    height, width = frame.shape
    anchor, turn = start.anchor.copy(), start.turn
    opaque = float(patch.opacity.sum())
    scale = noise
    last = np.inf
    for step_count in range(iterations):
        x, y = warped(patch, anchor, turn)
        inside = (x > 1) & (y > 1) & (x < width - 2) & (y < height - 2)
        if hidden is not None:
            inside &= np.hypot(x - hidden[0], y - hidden[1]) > hidden[2]
        seen = float(patch.opacity[inside].sum()) / opaque
        if seen < 0.33:
            return None
        value, gx, gy = _with_gradient(frame, x, y)
        scene, bx, by = _with_gradient(background, x, y)
        clear = (1.0 - patch.opacity) * gain
        # The light on the thing changes a little as it turns: brightness is free.
        look = patch.look * gain
        held = patch.opacity * inside
        bright = float(np.dot(held, value * look) / max(np.dot(held, look * look), 1e-9))
        residual = value - clear * scene - patch.opacity * look * bright
        dx, dy = gx - clear * bx, gy - clear * by
        cosine, sine = np.cos(turn), np.sin(turn)
        ax, ay = -sine * patch.x - cosine * patch.y, cosine * patch.x - sine * patch.y
        jacobian = np.stack([dx, dy, dx * ax + dy * ay, -patch.opacity * look], axis=1)
        scale = max(1.4826 * float(np.median(np.abs(residual[inside]))), 0.7 * noise)
        weight = inside / (1.0 + (residual / (3.0 * scale)) ** 2) ** 2
        weighted = jacobian * weight[:, None]
        normal = weighted.T @ jacobian
        pull = np.zeros(4)
        prior = (scale / turn_std) ** 2
        normal[2, 2] += prior
        pull[2] = prior * (turn - start.turn)
        normal += np.diag([1e-6, 1e-6, 1e-6, 1e-3 * opaque])
        step = -np.linalg.solve(normal, weighted.T @ residual + pull)
        length = float(np.hypot(step[0], step[1]))
        limit = min(1.0, 1.5 / max(length, 1e-9))
        anchor = anchor + limit * step[:2]
        turn += float(np.clip(step[2], -0.1, 0.1)) * limit
        if length < 3e-3 and last < 3e-2 and step_count > 1:
            break
        last = length
    if last > 0.5:
        return None
    covariance = np.linalg.inv(normal)[:3, :3] * scale**2 * _CORRELATED_PIXELS
    misfit = float(np.sqrt(np.average(residual**2, weights=weight + 1e-12))) / noise
    return Pose(anchor, turn, covariance, misfit, seen)


def _with_gradient(
    image: FloatImage, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sample an image at scattered points with its gradient, from a window around them."""
    height, width = image.shape
    left, top = max(0, int(x.min()) - 4), max(0, int(y.min()) - 4)
    right, bottom = min(width, int(x.max()) + 6), min(height, int(y.max()) + 6)
    window = np.ascontiguousarray(image[top:bottom, left:right])
    u, v = (x - left).astype(np.float32)[None], (y - top).astype(np.float32)[None]
    gx = cv2.sepFilter2D(window, cv2.CV_32F, _SLOPE, _FLAT)
    gy = cv2.sepFilter2D(window, cv2.CV_32F, _FLAT, _SLOPE)
    border = cv2.BORDER_REPLICATE
    value = cv2.remap(window, u, v, cv2.INTER_CUBIC, borderMode=border)[0]
    gx = cv2.remap(gx, u, v, cv2.INTER_LINEAR, borderMode=border)[0]
    gy = cv2.remap(gy, u, v, cv2.INTER_LINEAR, borderMode=border)[0]
    return value.astype(np.float64), gx.astype(np.float64), gy.astype(np.float64)
