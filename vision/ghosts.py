"""Things that lay still for so long that they look like background, told from what they hid.

A ball that rests for most of the clip is what most frames show at that place. Two states of a
region, with
and without the thing, are told apart by the region's own outline: only with the thing does the
picture have a step along it. The same holds for the shadow that left with it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["without_ghosts"]

FloatImage = NDArray[np.float32]

_DIFFERENT = 6.0
_SMALLEST = 12


def without_ghosts(epochs: list[FloatImage], usual: FloatImage, noise: FloatImage) -> FloatImage:
    """Replace regions of the usual picture that show something that was not always there.

    Parameters
    ----------
    epochs : list of (H, W) float32 arrays
        The scene in successive parts of the clip.
    usual : (H, W) float32 array
        What most of them show.
    noise : (H, W) float32 array
        Standard deviation of a frame's pixel, gray levels.

    Returns
    -------
    (H, W) float32 array
    """
    clean = usual.copy()
    code = np.zeros(usual.shape, dtype=np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    for bit, epoch in enumerate(epochs):
        differs = (np.abs(epoch - usual) > _DIFFERENT * noise).astype(np.uint8)
        opened = cv2.morphologyEx(differs, cv2.MORPH_OPEN, kernel)
        code |= np.where(opened > 0, np.uint8(1 << bit), np.uint8(0))
    # Pixels that differ in the same epochs belong together: the ball that left, apart from the mass
    # that swung into its place.
    values, counts = np.unique(code, return_counts=True)
    for value in values[(values > 0) & (counts >= _SMALLEST)]:
        count, labels, boxes, _ = cv2.connectedComponentsWithStats((code == value).astype(np.uint8))
        for label in range(1, count):
            if boxes[label, cv2.CC_STAT_AREA] < _SMALLEST:
                continue
            window = _window(boxes[label], usual.shape)
            region = (labels[window] == label).astype(np.uint8)
            others = [epochs[bit][window] for bit in range(len(epochs)) if value >> bit & 1]
            steps = [_step_along(other, region) for other in others]
            best = int(np.argmin(steps))
            if steps[best] < 0.7 * _step_along(usual[window], region):
                wide = cv2.dilate(region, np.ones((7, 7), np.uint8)) > 0
                clean[window][wide] = others[best][wide]
    return clean


def _window(box: NDArray[np.int32], shape: tuple[int, ...]) -> tuple[slice, slice]:
    left, top, width, height = (int(value) for value in box[:4])
    return (
        slice(max(0, top - 8), min(shape[0], top + height + 8)),
        slice(max(0, left - 8), min(shape[1], left + width + 8)),
    )


def _step_along(picture: FloatImage, region: NDArray[np.uint8]) -> float:
    """Mean step of the picture across the region's outline, gray levels per pixel."""
    soft = cv2.GaussianBlur(region.astype(np.float32), (0, 0), 1.5)
    nx, ny = cv2.Scharr(soft, cv2.CV_32F, 1, 0), cv2.Scharr(soft, cv2.CV_32F, 0, 1)
    length = np.hypot(nx, ny)
    smooth = cv2.GaussianBlur(picture, (0, 0), 1.5)
    gx = cv2.Scharr(smooth, cv2.CV_32F, 1, 0) / 32.0
    gy = cv2.Scharr(smooth, cv2.CV_32F, 0, 1) / 32.0
    across = (gx * nx + gy * ny) / np.maximum(length, 1e-6)
    # Smoothed along the outline, so that lines of the scene that cross it cancel.
    weight = length * (length > 0.3 * length.max())
    mean = cv2.GaussianBlur(across * weight, (0, 0), 3.0)
    norm = cv2.GaussianBlur(weight, (0, 0), 3.0)
    local = np.abs(mean) / np.maximum(norm, 1e-6)
    return float(np.sum(local * weight) / max(float(np.sum(weight)), 1e-6))
