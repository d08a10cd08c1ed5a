"""Where the camera looked in each frame, and how bright the light was, from the static scene.

A gain, a shift and a small roll are fitted together by least squares on the pixels where the scene
has structure (Lucas and Kanade 1981); what moves in front is rejected by its residual.
"""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Aligner", "FrameView", "warp_to_frame", "warp_to_scene"]

FloatImage = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_TILES = 12
"""Tiles along each side of the picture from which edges are taken, so that no bright corner
outvotes the rest."""
_POINTS_PER_TILE = 24
"""Points of a tile, the steepest: with twelve by twelve tiles some three thousand, whose mean is
good to a fiftieth of one."""
_ITERATIONS = 6
"""Steps of Gauss-Newton at most: a wander of a pixel settles in three."""
_FEWEST_POINTS = 40
"""Points: gain, shift, turn and scale are five unknowns, eight times as many leave room for
outliers."""


@dataclass(frozen=True)
class FrameView:
    """How one frame sees the static scene.

    Attributes
    ----------
    gain : float
        Brightness relative to the scene.
    shift_px : (2,) array
        Where the scene's point (x, y) appears: at (x, y) + shift + roll × (−(y − y₀), x − x₀).
    roll_rad : float
        Roll about the picture's centre.
    shift_std_px : float
        Standard uncertainty of the shift from the picture noise.
    """

    gain: float
    shift_px: FloatArray
    roll_rad: float
    shift_std_px: float

    @property
    def still(self) -> bool:
        """Whether the camera looks exactly as it did at the reference."""
        return self.roll_rad == 0.0 and not np.any(self.shift_px)

    def matrix(self, shape: tuple[int, int]) -> FloatArray:
        """Affine matrix (2, 3) from scene to frame pixels."""
        x0, y0 = 0.5 * (shape[1] - 1), 0.5 * (shape[0] - 1)
        roll = self.roll_rad
        return np.array(
            [
                [1.0, -roll, self.shift_px[0] + roll * y0],
                [roll, 1.0, self.shift_px[1] - roll * x0],
            ]
        )


def warp_to_scene(frame: FloatImage, view: FrameView) -> FloatImage:
    """Resample a frame as the reference camera would have seen it."""
    if view.still:
        return frame
    height, width = frame.shape
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpAffine(
        frame,
        view.matrix((height, width)),
        (width, height),
        flags=flags,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(warped, dtype=np.float32)


def warp_to_frame(scene: FloatImage, view: FrameView) -> FloatImage:
    """Resample the static scene as the camera of one frame sees it."""
    if view.still:
        return scene
    height, width = scene.shape
    warped = cv2.warpAffine(
        scene,
        view.matrix((height, width)),
        (width, height),
        flags=cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(warped, dtype=np.float32)


class Aligner:
    """Registers frames on a picture of the scene.

    Parameters
    ----------
    scene : (H, W) float32 array
        The static scene, or a frame that stands for it.
    noise : float
        Standard deviation of a pixel, gray levels.
    """

    def __init__(self, scene: FloatImage, noise: float) -> None:
        self._scene = scene
        self._noise = noise
        self._smooth = cv2.GaussianBlur(scene, (0, 0), 1.0)
        self._gx = cv2.Scharr(self._smooth, cv2.CV_32F, 1, 0) / 32.0
        self._gy = cv2.Scharr(self._smooth, cv2.CV_32F, 0, 1) / 32.0
        self._rows, self._columns = _structured_points(np.hypot(self._gx, self._gy))
        height, width = scene.shape
        self._centre = (0.5 * (width - 1), 0.5 * (height - 1))

    def view(self, frame: FloatImage, start: FrameView | None = None) -> FrameView:
        """Register one frame.

        Parameters
        ----------
        frame : (H, W) float32 array
            Gray levels.
        start : FrameView, optional
            A guess, such as the view of the frame before.

        Returns
        -------
        FrameView
        """
        guess = start if start is not None else FrameView(1.0, np.zeros(2), 0.0, 0.0)
        if len(self._rows) < _FEWEST_POINTS:
            # Too small a picture to tell the camera's motion by.
            return guess
        smooth = np.asarray(cv2.GaussianBlur(frame, (0, 0), 1.0), dtype=np.float32)
        found = self._refine(smooth, guess)
        if found[1] > 1.7:
            # On copies: the transform works in place.
            jump, _ = cv2.phaseCorrelate(self._smooth.copy(), smooth.copy())
            again = self._refine(smooth, FrameView(1.0, np.array(jump, dtype=np.float64), 0.0, 0.0))
            # A wall's grid repeats: of two fits about as good, the nearer is right.
            found = again if again[1] < 0.7 * found[1] else found
        return found[0]

    def _refine(self, frame: FloatImage, guess: FrameView) -> tuple[FrameView, float]:
        rows, columns = self._rows, self._columns
        x0, y0 = self._centre
        height, width = frame.shape
        gx, gy = self._gx[rows, columns], self._gy[rows, columns]
        expected = self._smooth[rows, columns]
        design = np.stack(
            [expected, gx, gy, gy * (columns - x0) - gx * (rows - y0)], axis=1
        ).astype(np.float64)
        shift, roll = guess.shift_px.copy(), guess.roll_rad
        gain, scale, std = guess.gain, 1e9, 0.0
        for _ in range(_ITERATIONS):
            x = (columns + shift[0] - roll * (rows - y0)).astype(np.float32)
            y = (rows + shift[1] + roll * (columns - x0)).astype(np.float32)
            inside = (x > 1) & (y > 1) & (x < width - 2) & (y < height - 2)
            if np.count_nonzero(inside) < _FEWEST_POINTS:
                return FrameView(float(gain), shift, float(roll), std), np.inf
            seen = _sampled(frame, x, y)
            residual = (seen - gain * expected).astype(np.float64)
            spread = 1.4826 * float(np.median(np.abs(residual[inside])))
            scale = max(spread, 0.3 * self._noise)
            weight = inside / (1.0 + (residual / (2.0 * scale)) ** 2) ** 2
            weighted = design * weight[:, None]
            normal = weighted.T @ design + np.diag([1e-9, 1e-3, 1e-3, 1e-3])
            step = np.linalg.solve(normal, weighted.T @ residual)
            gain += step[0]
            delta = -step[1:3] / max(gain, 0.05)
            shift += np.clip(delta, -1.5, 1.5)
            roll -= float(np.clip(step[3] / max(gain, 0.05), -0.01, 0.01))
            inverse = np.linalg.inv(normal)
            std = float(scale * np.sqrt(max(inverse[1, 1] + inverse[2, 2], 0.0) / 2))
            if np.hypot(*delta) < 2e-3:
                break
        # The median alone would be content with half of the scene's lines matching.
        quality = float(np.quantile(np.abs(residual[inside]), 0.8)) / (1.28 * self._noise)
        return FrameView(float(gain), shift, float(roll), std), quality


def _sampled(frame: FloatImage, x: FloatImage, y: FloatImage) -> FloatImage:
    """The frame at scattered points."""
    return np.asarray(
        cv2.remap(frame, x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0],
        dtype=np.float32,
    )


def _structured_points(
    gradient: FloatImage,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pick the steepest pixels of each tile of the picture."""
    height, width = gradient.shape
    rows, columns = [], []
    row_edges = np.linspace(3, height - 3, _TILES + 1).astype(int)
    column_edges = np.linspace(3, width - 3, _TILES + 1).astype(int)
    for top, bottom in pairwise(row_edges):
        for left, right in pairwise(column_edges):
            tile = gradient[top:bottom, left:right]
            if tile.size < _POINTS_PER_TILE:
                continue
            steepest = np.argpartition(tile.ravel(), -_POINTS_PER_TILE)[-_POINTS_PER_TILE:]
            rows.append(top + steepest // tile.shape[1])
            columns.append(left + steepest % tile.shape[1])
    nowhere = np.zeros(0, dtype=np.int64)
    return np.concatenate([nowhere, *rows]), np.concatenate([nowhere, *columns])
