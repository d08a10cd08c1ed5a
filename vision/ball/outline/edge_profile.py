"""How a ball's edge looks across the outline: point spread, exposure smear, a sphere's shading.

Two profiles over the distance from the outline: how much of the pixel the ball covers, and the same
weighted with n_z, the part of the sphere's normal towards the camera, after which the light on a
sphere falls off near its limb. Both are blurred by a Gaussian point spread, the pixel's own size
and the exposure's smear along the outline's normal.
"""

import numpy as np
from numpy.typing import NDArray

__all__ = ["EdgeProfile"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]

# Fine enough to be looked up without interpolation: rounding by half a step is a hundredth of the
# narrowest edge, and of either sign.
_STEP = 0.0125
_SMEAR_STEPS = 8
# How far from the outline the tables reach, px: further than any ring of pixels does.
_REACH = 16.0
_TYPICAL_INNER = 5.0


class EdgeProfile:
    """Tabulated edge profiles of a sphere's outline.

    Parameters
    ----------
    radius : float
        Outline radius, px.
    spread : float
        Standard deviation of the point spread, px.
    most_smear : float
        Longest exposure smear that will be asked for, px.
    """

    def __init__(self, radius: float, spread: float, most_smear: float) -> None:
        self.radius = radius
        self.spread = spread
        smears = np.arange(int(np.ceil(most_smear / (_STEP * _SMEAR_STEPS))) + 1)
        margin = 4.0 * spread + 1.0 + 0.5 * _STEP * _SMEAR_STEPS * len(smears)
        around = round((_REACH + margin) / _STEP)
        depth = np.arange(-around, around + 1) * _STEP
        # The outline itself lies on a table point: half of it is inside.
        inside = np.where(depth < 0, 1.0, np.where(depth > 0, 0.0, 0.5))
        normal = np.sqrt(np.clip(1.0 - (1.0 + depth / radius) ** 2, 0.0, 1.0)) * inside
        # As a difference from its mean, the shading is well told apart from the covered part.
        within = (depth < 0) & (depth > -_TYPICAL_INNER)
        normal -= float(normal[within].mean()) * inside
        half = round(_REACH / _STEP)
        self._low, self._count = -half * _STEP, 2 * half + 1
        self._most = len(smears) - 1
        tables = np.empty((4, len(smears), self._count), dtype=np.float32)
        for place, shape in enumerate((inside, normal)):
            sharp = _blurred(shape, spread)
            total = np.concatenate([[0.0], np.cumsum(sharp)])
            for smear in smears:
                row = _smeared(sharp, total, int(smear), around, half)
                tables[2 * place, smear] = row
                tables[2 * place + 1, smear] = np.gradient(row, _STEP)
        self._tables = tables.reshape(4, -1)

    def __call__(self, depth: FloatImage, smear: FloatImage | None = None) -> list[FloatImage]:
        """Look the profiles up.

        Parameters
        ----------
        depth : array
            Distance outside the outline (negative inside), px.
        smear : array, optional
            Smear along the outline's normal, px; of the same shape.

        Returns
        -------
        list of four arrays of that shape
            Coverage, its slope over depth (1/px), shading profile about its mean, its slope.
        """
        place = depth * np.float32(1.0 / _STEP)
        place += np.float32(0.5 - self._low / _STEP)
        np.clip(place, 0, self._count - 1, out=place)
        column = place.astype(np.int32)
        if smear is not None and self._most > 0:
            row = smear * np.float32(1.0 / (_STEP * _SMEAR_STEPS))
            row += np.float32(0.5)
            column += np.minimum(row, self._most).astype(np.int32) * np.int32(self._count)
        return [table.take(column) for table in self._tables]


def _blurred(shape: FloatArray, spread: float) -> FloatArray:
    """Blur by the point spread and the pixel's own width; ends are continued."""
    reach = int(np.ceil((4.0 * spread + 0.5) / _STEP))
    axis = np.arange(-reach, reach + 1) * _STEP
    kernel = np.exp(-0.5 * (axis / max(spread, _STEP)) ** 2)
    total = np.concatenate([[0.0], np.cumsum(kernel)])
    half = round(0.5 / _STEP)
    places = np.arange(len(kernel))
    upper, lower = np.minimum(places + half + 1, len(kernel)), np.maximum(places - half, 0)
    boxed = total[upper] - total[lower]
    padded = np.pad(shape, reach, mode="edge")
    size = len(padded) + len(boxed)
    product = np.fft.rfft(padded, size) * np.fft.rfft(boxed / boxed.sum(), size)
    return np.asarray(np.fft.irfft(product, size)[2 * reach : 2 * reach + len(shape)])


def _smeared(
    sharp: FloatArray, total: FloatArray, smear: int, around: int, half: int
) -> FloatArray:
    """Mean over a box of so many smear steps, on the middle of the table; ends weigh a half."""
    middle = np.arange(around - half, around + half + 1)
    if smear == 0:
        return np.asarray(sharp[middle])
    box = smear * _SMEAR_STEPS // 2
    whole = total[middle + box + 1] - total[middle - box]
    return np.asarray((whole - 0.5 * (sharp[middle - box] + sharp[middle + box])) / (2 * box))
