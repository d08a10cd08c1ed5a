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

from vision.clip.info import GrayImage, Weave

__all__ = ["CombingDetector", "separate_field"]

FloatImage = NDArray[np.float32]

# Moving pixels, and looks at three pictures in a row, after which the question is settled.
_ENOUGH_PIXELS = 6000
_ENOUGH_LOOKS = 6
"""Looks after which combing is settled: six that agree do so by chance in one of 32."""
_FEWEST_LOOKS = 3
"""Looks at least: of three that agree, one may still be chance, two can't be outvoted."""
_AGREEING = 0.6
"""Share of the looks that must agree: more than half, by a margin."""
# Whole pictures taken for fields cost more than the other way round: the sum must be clear.
_CLEAR = 1.5
_CLEAR_LOOK = 0.5
# Fewer moving pixels than this in one look are noise.
_LEAST_PIXELS = 20
_NOISE_FACTOR = 6.0
"""Times the noise of a change: in a picture of a million pixels none passes by chance."""
_LEVEL = 100.0
"""Gray levels that lines are scaled to, so that flicker is no motion."""
_CYCLE = 6
"""Pictures of which three in a row are looked at: neighbours show motion, and the pause covers more
of the clip."""


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


@dataclass(frozen=True)
class _Evidence:
    """Sums over the moving pixels of three pictures in a row, of squares."""

    pixels: int
    within: float
    to_next: float
    to_last: float

    def verdict(self, clear: float) -> Weave:
        """Judge by mean squares, in which the scene's own texture adds the same to all three.

        With h the change in half an interval, woven fields leave h² within a picture and to the
        nearer neighbour, 9 h² to the farther; whole pictures leave 0 within and 4 h² to both. So
        the step from near to far has to be `clear` times that from within to near.
        """
        near, far = sorted((self.to_next, self.to_last))
        if far < 1.25 * near or far - near < clear * (near - self.within):
            return "progressive"
        return "top_first" if self.to_next < self.to_last else "bottom_first"


_LEAST_LINES = 4
"""Lines of a picture: a bottom line with a top line on either side, and their pair."""


class CombingDetector:
    """Weighs combing over the pictures shown to it, until what moves has told enough."""

    def __init__(self) -> None:
        self._held: list[FloatImage] = []
        self._seen: list[_Evidence] = []

    @property
    def settled(self) -> bool:
        """Whether enough moving pixels have been seen."""
        enough = sum(look.pixels for look in self._seen) >= _ENOUGH_PIXELS
        return enough and len(self._seen) >= _ENOUGH_LOOKS

    def wants(self, index: int) -> bool:
        """Whether picture `index` is to be shown: three in a row, then a pause."""
        return index % _CYCLE < 3

    def show(self, picture: GrayImage) -> None:
        """Look at the next picture that is wanted, as stored."""
        if picture.shape[0] < _LEAST_LINES:
            return
        lines = picture[: picture.shape[0] // 2 * 2].astype(np.float32)
        # Mains flicker changes all of a picture; only what moves in it is to count.
        self._held.append(lines * np.float32(_LEVEL / max(float(lines.mean()), 1e-3)))
        if len(self._held) == 3:
            self._weigh(*self._held)
            self._held.clear()

    def _weigh(self, last: FloatImage, now: FloatImage, following: FloatImage) -> None:
        # Bottom lines of `now` against the mean of the top lines around them.
        bottom = now[1:-2:2]
        # Pictures two intervals apart, line by line of the same field: where things move.
        change = np.abs(following[1:-2:2] - last[1:-2:2])
        noise = 1.5 * float(np.median(change[::3, ::3])) + 1e-3 * _LEVEL
        moving = change > _NOISE_FACTOR * noise
        count = int(np.count_nonzero(moving))
        if count < _LEAST_PIXELS:
            return
        here = bottom[moving]
        self._seen.append(
            _Evidence(
                count,
                _square(here - _between(now, moving)),
                _square(here - _between(following, moving)),
                _square(here - _between(last, moving)),
            )
        )

    def verdict(self) -> Weave:
        """Judge by the sum, where most looks agree with it: damage and bounces speak once."""
        seen = self._seen
        total = _Evidence(
            sum(look.pixels for look in seen),
            sum(look.within for look in seen),
            sum(look.to_next for look in seen),
            sum(look.to_last for look in seen),
        )
        weave = total.verdict(_CLEAR)
        agreeing = sum(look.verdict(_CLEAR_LOOK) == weave for look in seen)
        if len(seen) < _FEWEST_LOOKS or agreeing < _AGREEING * len(seen):
            return "progressive"
        return weave


def _square(difference: FloatImage) -> float:
    return float(np.sum(difference * difference, dtype=np.float64))


def _between(picture: FloatImage, where: NDArray[np.bool_]) -> FloatImage:
    """Mean of the top lines above and below the bottom lines' pixels `where`."""
    above, below = picture[0:-2:2], picture[2::2]
    mean: FloatImage = 0.5 * (above[where] + below[where])
    return mean
