"""Interlaced clips: two fields, half an interval apart, woven into one picture.

Whether pictures are woven is told by the file, or seen from combing: lines of one field are held
against the mean of the lines above and below, which belong to the other field. Where things move,
fields taken at the same time agree, fields taken apart in time do not, and the more the further
apart. So the top lines of pictures n−1, n and n+1 are each compared with the bottom lines of
picture n:

    progressive     0 within a picture, 1 interval to either neighbour
    top field first 1/2 interval within, 1/2 to the next, 3/2 to the last
    bottom first    1/2 interval within, 3/2 to the next, 1/2 to the last
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.clip_info import GrayImage, Weave

__all__ = ["CombingDetector", "separate_field"]

FloatImage = NDArray[np.float32]

# Moving pixels needed, each this many times the noise apart, before a verdict counts.
_ENOUGH_PIXELS = 1500
_NOISE_FACTOR = 6.0
_LEAST_PIXELS = 60
_CYCLE = 6


def separate_field(picture: NDArray[Any], bottom: bool) -> NDArray[Any]:
    """Take one field out of a woven picture, on the picture's own pixel grid.

    The lines of the other field are interpolated from those above and below, so that both fields
    keep their places: without that, every second field would stand half a line pair too high.

    Parameters
    ----------
    picture : (H, W) or (H, W, 3) integer array
        Woven picture.
    bottom : bool
        Whether to take lines 1, 3, 5, … and not 0, 2, 4, ….

    Returns
    -------
    array of the same shape and type
    """
    field = picture.copy()
    first = 1 if bottom else 0
    missing = np.arange(1 - first, picture.shape[0], 2)
    above = np.clip(missing - 1, first, None)
    below = np.where(missing + 1 < picture.shape[0], missing + 1, missing - 1)
    above = np.where(missing == 0, below, above)
    wide = picture.astype(np.uint32)
    field[missing] = ((wide[above] + wide[below] + 1) // 2).astype(picture.dtype)
    return field


@dataclass
class _Evidence:
    pixels: int = 0
    within: float = 0.0
    to_next: float = 0.0
    to_last: float = 0.0


class CombingDetector:
    """Weighs combing over pictures shown to it in order, until what moves has told enough."""

    def __init__(self) -> None:
        self._held: list[FloatImage] = []
        self._sum = _Evidence()

    @property
    def settled(self) -> bool:
        """Whether enough moving pixels have been seen."""
        return self._sum.pixels >= _ENOUGH_PIXELS

    def wants(self, index: int) -> bool:
        """Whether picture `index` is to be shown: three in a row, then a pause."""
        return index % _CYCLE < 3

    def show(self, picture: GrayImage) -> None:
        """Look at the next picture that is wanted, as stored."""
        self._held.append(picture[: picture.shape[0] // 2 * 2].astype(np.float32))
        if len(self._held) == 3:
            self._weigh(*self._held)
            self._held.clear()

    def _weigh(self, last: FloatImage, now: FloatImage, following: FloatImage) -> None:
        # Bottom lines of `now` against the mean of the top lines around them.
        bottom = now[1:-2:2]
        # Pictures two intervals apart, line by line of the same field: where things move.
        change = np.abs(following[1:-2:2] - last[1:-2:2])
        noise = 1.5 * float(np.median(change[::3, ::3])) + 1e-3 * max(1.0, float(now.max()))
        moving = change > _NOISE_FACTOR * noise
        count = int(np.count_nonzero(moving))
        if count < _LEAST_PIXELS:
            return
        self._sum.pixels += count
        here = bottom[moving]
        self._sum.within += float(np.abs(here - _between(now, moving)).sum())
        self._sum.to_next += float(np.abs(here - _between(following, moving)).sum())
        self._sum.to_last += float(np.abs(here - _between(last, moving)).sum())

    def verdict(self) -> Weave:
        """Judge: fields apart in time are as far from the nearer neighbour as from each other."""
        seen = self._sum
        if seen.pixels < _LEAST_PIXELS:
            return "progressive"
        near, far = sorted((seen.to_next, seen.to_last))
        # Progressive: near ≈ far, within well below. Woven: within ≈ near, far well above both.
        if far <= 1.25 * near or seen.within <= 0.75 * near:
            return "progressive"
        return "top_first" if seen.to_next < seen.to_last else "bottom_first"


def _between(picture: FloatImage, where: NDArray[np.bool_]) -> FloatImage:
    """Mean of the top lines above and below the bottom lines' pixels `where`."""
    above, below = picture[0:-2:2], picture[2::2]
    mean: FloatImage = 0.5 * (above[where] + below[where])
    return mean
