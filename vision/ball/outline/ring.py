"""The ring of pixels about an outline, sorted into sectors of about four pixels of outline."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.ball.outline.cutout import Cutouts

__all__ = ["Ring", "Template"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# The ring is laid out about whole pixels; so far may a centre lie off its middle, px.
_SLACK = 0.8
_FEWEST_PIXELS = 24
_FEWEST_IN_SECTOR = 5


@dataclass(frozen=True)
class Ring:
    """Pixels of several frames in sectors, padded to equal length.

    Attributes
    ----------
    x, y : (S, L) arrays
        Offsets from each frame's origin, px.
    origin : (F, 2) array
        Whole pixel about which each frame's ring was laid out, px.
    gray, background, inverse_noise : (F, S, L) float32 arrays
        As in `Cutouts`; the noise's inverse is 0 for pixels that do not count.
    size : (F, S) array
        Pixels that count; 0 in sectors with too few.
    enough : (F,) bool array
        Whether enough of the ring is in view.
    """

    x: FloatImage
    y: FloatImage
    origin: FloatArray
    gray: FloatImage
    background: FloatImage
    inverse_noise: FloatImage
    size: FloatArray
    enough: BoolArray

    def where(self, kept: BoolArray) -> "Ring":
        """Some of the frames."""
        if np.all(kept):
            return self
        return Ring(
            self.x,
            self.y,
            self.origin[kept],
            self.gray[kept],
            self.background[kept],
            self.inverse_noise[kept],
            self.size[kept],
            self.enough[kept],
        )

    def narrowed(self, sectors: BoolArray, parameters: FloatArray, inner: float) -> "Ring":
        """Without what lies further inside than `inner` in some sectors (F, S)."""
        away = (parameters[:, :2] - self.origin).astype(np.float32)[:, :, None, None]
        radius = parameters[:, 2].astype(np.float32)[:, None, None]
        depth = np.sqrt((self.x - away[:, 0]) ** 2 + (self.y - away[:, 1]) ** 2) - radius
        inverse = self.inverse_noise * ~(sectors[:, :, None] & (depth < -np.float32(inner)))
        size = np.count_nonzero(inverse, axis=2)
        good = size >= _FEWEST_IN_SECTOR
        return replace(
            self,
            inverse_noise=inverse * good[:, :, None],
            size=np.where(good, size, 0).astype(np.float64),
        )

    def moved(self, parameters: FloatArray) -> BoolArray:
        """Whether centres have left the middle of their ring."""
        away = np.abs(parameters[:, :2] - self.origin).max(axis=1)
        return np.asarray(away > _SLACK)


class Template:
    """Which pixels about a whole pixel make up the ring, the same for all frames.

    Parameters
    ----------
    radius : float
        Radius of the outline, px.
    inner, outer : float
        How far the ring reaches inside and outside, px.
    """

    def __init__(self, radius: float, inner: float, outer: float) -> None:
        self._inner, self._outer = np.float32(inner), np.float32(outer)
        self._reach = int(np.ceil(radius + outer + _SLACK))
        axis = np.arange(-self._reach, self._reach + 1)
        y, x = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
        rho = np.hypot(x, y)
        near = (rho > max(radius - inner - _SLACK, 0.5)) & (rho < radius + outer + _SLACK)
        x, y = x[near], y[near]
        count = int(np.clip(round(2 * np.pi * radius / 4.0), 6, 40))
        sector = np.floor((np.arctan2(y, x) / (2 * np.pi) + 0.5) * count).astype(np.int64) % count
        order = np.argsort(sector, kind="stable")
        x, y, sector = x[order], y[order], sector[order]
        sizes = np.bincount(sector, minlength=count)
        place = np.arange(len(x)) - np.concatenate([[0], np.cumsum(sizes)[:-1]])[sector]
        self._x = np.zeros((count, int(sizes.max())), dtype=np.int64)
        self._y = np.zeros_like(self._x)
        self._real = np.zeros(self._x.shape, dtype=np.float32)
        self._x[sector, place], self._y[sector, place] = x, y
        self._real[sector, place] = 1.0
        # Padding stands on the ring too, where nothing is divided by nought.
        self._x[self._real == 0] = round(radius)
        self.size = self._x.size

    def gathered(self, cutouts: Cutouts, places: IntArray, parameters: FloatArray) -> Ring:
        """Pick the ring's pixels out of the cut-outs.

        Parameters
        ----------
        cutouts : Cutouts
            Pieces of all frames.
        places : (F,) int array
            Which of them.
        parameters : (F, 5) array
            Centre, radius and ellipse of each, px.

        Returns
        -------
        Ring
        """
        width = cutouts.gray.shape[1]
        origin = np.rint(parameters[:, :2]).astype(np.int64)
        first = origin - cutouts.corner[places]
        inside = np.all((first >= self._reach) & (first < width - self._reach), axis=1)
        first = np.where(inside[:, None], first, width // 2)
        offset = (self._y * width + self._x).ravel()
        start = (places * width + first[:, 1]) * width + first[:, 0]
        flat = start[:, None] + offset
        shape = (len(places), *self._x.shape)
        gray, background, inverse = (
            piece.take(flat).reshape(shape)
            for piece in (cutouts.gray, cutouts.background, cutouts.inverse_noise)
        )
        x, y = self._x.astype(np.float32), self._y.astype(np.float32)
        away = (parameters[:, :2] - origin).astype(np.float32)[:, :, None, None]
        radius = parameters[:, 2].astype(np.float32)[:, None, None]
        depth = np.sqrt((x - away[:, 0]) ** 2 + (y - away[:, 1]) ** 2) - radius
        counts = (depth > -self._inner) & (depth < self._outer) & (inverse > 0)
        inverse *= counts * self._real
        size = np.count_nonzero(inverse, axis=2)
        good = size >= _FEWEST_IN_SECTOR
        inverse *= good[:, :, None]
        most = good.shape[1]
        enough = inside & (size.sum(axis=1) >= _FEWEST_PIXELS)
        enough &= np.count_nonzero(good, axis=1) >= max(4, 0.4 * most)
        counted = np.where(good, size, 0).astype(np.float64)
        return Ring(x, y, origin.astype(np.float64), gray, background, inverse, counted, enough)
