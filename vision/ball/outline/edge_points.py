"""Edge points of a picture: where it is steepest, to a fraction of a pixel, and which way."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["EdgePoints", "edge_points", "places"]

FloatImage = NDArray[np.float32]
IntArray = NDArray[np.int64]

_STEEP = 6.0
_MOST_EDGES = 6000


@dataclass(frozen=True)
class EdgePoints:
    """Points on edges.

    Attributes
    ----------
    x, y : (n,) arrays
        Where, px.
    nx, ny : (n,) arrays
        Unit vector up the slope.
    strength : (n,) array
        Steepness; unit noise gives about 1.
    """

    x: FloatImage
    y: FloatImage
    nx: FloatImage
    ny: FloatImage
    strength: FloatImage


def edge_points(level: FloatImage, left: int, top: int) -> EdgePoints:
    """Find the edge points of a picture, thinned along their gradient.

    Parameters
    ----------
    level : (H, W) float32 array
        The picture, in units of its noise.
    left, top : int
        Where its first pixel lies.

    Returns
    -------
    EdgePoints
    """
    smooth = cv2.GaussianBlur(level, (0, 0), 0.8)
    gx = cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=0.1)
    gy = cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=0.1)
    steepness = cv2.magnitude(gx, gy)
    steepness[:1], steepness[-1:], steepness[:, :1], steepness[:, -1:] = 0, 0, 0, 0
    rows, columns = places(steepness > np.float32(_STEEP))
    if len(rows) > 4 * _MOST_EDGES:
        values = steepness[rows, columns]
        keep = np.argpartition(values, -4 * _MOST_EDGES)[-4 * _MOST_EDGES :]
        rows, columns = rows[keep], columns[keep]
    strength = steepness[rows, columns]
    nx, ny = gx[rows, columns] / strength, gy[rows, columns] / strength
    step_x, step_y = np.rint(nx).astype(int), np.rint(ny).astype(int)
    crest = (strength >= steepness[rows + step_y, columns + step_x]) & (
        strength > steepness[rows - step_y, columns - step_x]
    )
    rows, columns, nx, ny, strength = (part[crest] for part in (rows, columns, nx, ny, strength))
    ahead = steepness[rows + step_y[crest], columns + step_x[crest]]
    behind = steepness[rows - step_y[crest], columns - step_x[crest]]
    offset = 0.5 * (ahead - behind) / np.maximum(2 * strength - ahead - behind, 1e-6)
    length = np.hypot(step_x[crest], step_y[crest])
    offset = np.clip(offset, -0.5, 0.5) * length
    return EdgePoints(
        (columns + left + offset * nx).astype(np.float32),
        (rows + top + offset * ny).astype(np.float32),
        nx,
        ny,
        strength,
    )


def places(mask: NDArray[np.bool_]) -> tuple[IntArray, IntArray]:
    """Rows and columns that are set, in reading order."""
    if not mask.any():
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    x, y = cv2.findNonZero(mask.view(np.uint8)).reshape(-1, 2).T.astype(np.int64)
    return y, x
