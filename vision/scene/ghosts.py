"""Things that lay still for so long that they look like background, told from what they hid.

A ball that rests for most of the clip is what most frames show at that place. Two states of a
region, with and without the thing, are told apart by the region's own outline: only with the thing
does the picture have a step along it. The same holds for the shadow that left with it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.measure import label, regionprops

__all__ = ["without_ghosts"]

FloatImage = NDArray[np.float32]

_DIFFERENT = 6.0
_SMALLEST = 40
# A thing's outline is a step that the noise does not make, and that is gone without the thing.
_LEAST_STEP = 1.5
_SMOOTHER = 0.4


def without_ghosts(
    epochs: list[FloatImage],
    stable: list[NDArray[np.bool_]],
    usual: FloatImage,
    noise: FloatImage,
) -> FloatImage:
    """Replace regions of the usual picture that show something that was not always there.

    Parameters
    ----------
    epochs : list of (H, W) float32 arrays
        The scene in successive parts of the clip.
    stable : list of (H, W) bool arrays
        Where nothing moved in each part; elsewhere it tells nothing of the scene.
    usual : (H, W) float32 array
        What is shown most of the time.
    noise : (H, W) float32 array
        Standard deviation of a frame's pixel, gray levels.

    Returns
    -------
    (H, W) float32 array
    """
    clean = usual.copy()
    code = np.zeros(usual.shape, dtype=np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    for bit, (epoch, still) in enumerate(zip(epochs, stable, strict=True)):
        differs = ((np.abs(epoch - usual) > _DIFFERENT * noise) & still).astype(np.uint8)
        opened = cv2.morphologyEx(differs, cv2.MORPH_OPEN, kernel)
        code |= np.where(opened > 0, np.uint8(1 << bit), np.uint8(0))
    # Pixels that differ in the same epochs belong together: the ball that left, apart from the mass
    # that swung into its place.
    least = float(np.median(noise))
    pieces = label(code, connectivity=2)  # type: ignore[no-untyped-call]
    for piece in regionprops(pieces, intensity_image=code):  # type: ignore[no-untyped-call]
        value = int(piece.intensity_max)
        if piece.area < _SMALLEST or not _at_one_end(value, len(epochs)):
            continue
        window = _window(piece.bbox, usual.shape)
        region = (pieces[window] == piece.label).astype(np.uint8)
        others = [epochs[bit][window] for bit in range(len(epochs)) if value >> bit & 1]
        steps = [_step_along(other, region) for other in others]
        best, seen = int(np.argmin(steps)), _step_along(usual[window], region)
        if seen > _LEAST_STEP * least and steps[best] < _SMOOTHER * seen:
            wide = cv2.dilate(region, np.ones((7, 7), np.uint8)) > 0
            clean[window][wide] = others[best][wide]
    return clean


def _at_one_end(code: int, epochs: int) -> bool:
    """Whether an alternative is what the clip begins or ends with: a thing that lay and left.

    What is seen for a while in between is something that swung by.
    """
    ends = [(1 << run) - 1 for run in range(1, epochs)]
    ends += [((1 << run) - 1) << (epochs - run) for run in range(1, epochs)]
    return code in ends


def _window(box: tuple[int, int, int, int], shape: tuple[int, ...]) -> tuple[slice, slice]:
    top, left, bottom, right = box
    return (
        slice(max(0, top - 8), min(shape[0], bottom + 8)),
        slice(max(0, left - 8), min(shape[1], right + 8)),
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
