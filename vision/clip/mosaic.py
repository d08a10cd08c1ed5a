"""Raw pictures whose pixels have colour filters in turn (Bayer mosaic)."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.clip.picture import GrayImage

__all__ = ["Mosaic", "mosaic_of"]

_KERNEL: NDArray[np.float64] = np.outer([1.0, 2.0, 1.0], [1.0, 2.0, 1.0]) / 16.0
"""Mean over one period of the mosaic, centred on a pixel (derived: each of the four filters has the
weight 1/4)."""

_MIN_CORRELATION = 0.5
"""Correlation of neighbouring cells' diagonal differences (derived: half of their variance is the
mosaic's; noise and texture give 0)."""


@dataclass(frozen=True)
class Mosaic:
    """A mosaic of red, green and blue filters.

    Attributes
    ----------
    green_first : bool
        Whether the first pixel of the first line is green.
    depth : int
        Bits that the pictures use.
    """

    green_first: bool
    depth: int = 8

    def gray(self, image: NDArray[Any]) -> GrayImage:
        """Mean over the filters around each pixel, same size and type."""
        mean = cv2.filter2D(image, -1, _KERNEL, borderType=cv2.BORDER_REFLECT_101)
        return np.asarray(mean, dtype=image.dtype)

    def colour(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """Colour image (H, W, 3); red and blue can't be distinguished."""
        eight = np.minimum(image >> max(self.depth - 8, 0), 255).astype(np.uint8)
        pattern = cv2.COLOR_BayerGB2BGR if self.green_first else cv2.COLOR_BayerRG2BGR
        return np.asarray(cv2.cvtColor(eight, pattern), dtype=np.uint8)


def mosaic_of(image: NDArray[Any]) -> Mosaic | None:
    """The mosaic of a raw picture; None if it has none.

    Between the diagonals of a cell of 2 × 2 pixels, a mosaic makes a difference that neighbouring
    cells share; of a picture without one they share nothing.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
    """
    if image.ndim != 2 or min(image.shape) < 8:
        return None
    rows, columns = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    plane = image[:rows, :columns].astype(np.float64)
    first, second = plane[0::2, 0::2], plane[0::2, 1::2]
    third, last = plane[1::2, 0::2], plane[1::2, 1::2]
    cell = first + last - second - third
    total = float((cell**2).mean())
    if total == 0.0:
        return None
    shared = min(float((cell[:, 1:] * cell[:, :-1]).mean()), float((cell[1:] * cell[:-1]).mean()))
    if shared < _MIN_CORRELATION * total:
        return None
    # both green pixels of a cell are alike
    green_first = float(((first - last) ** 2).mean()) < float(((second - third) ** 2).mean())
    return Mosaic(green_first, int(image.max()).bit_length())
