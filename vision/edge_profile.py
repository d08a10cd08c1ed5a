"""How a ball's edge looks across the outline: point spread, exposure smear, a sphere's shading.

Two profiles over the distance from the outline: how much of the pixel the ball covers, and the same
weighted with n_z, the part of the sphere's normal towards the camera, after which the light on a
sphere
falls off near its limb. Both are blurred by a Gaussian point spread, the pixel's own size and the
exposure's smear along the outline's normal.
"""

import numpy as np
from numpy.typing import NDArray

__all__ = ["EdgeProfile"]

FloatArray = NDArray[np.float64]

_STEP = 0.05
_SMEAR_STEP = 0.1


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
        margin = 4.0 * spread + 0.5 * most_smear + 2.0
        depth = np.arange(-radius - margin, margin, _STEP)
        inside = depth < 0
        normal = np.sqrt(np.clip(1.0 - (1.0 + depth / radius) ** 2, 0.0, 1.0)) * inside
        self._low, self._count = float(depth[0]), len(depth)
        self._smears = np.arange(0.0, most_smear + _SMEAR_STEP, _SMEAR_STEP)
        tables = []
        for smear in self._smears:
            kernel = _kernel(spread, float(smear))
            for shape in (inside.astype(np.float64), normal):
                blurred = np.convolve(np.pad(shape, len(kernel) // 2, mode="edge"), kernel, "valid")
                tables.append(blurred)
                tables.append(np.gradient(blurred, _STEP))
        stacked = np.array(tables).reshape(len(self._smears), 4, len(depth))
        self._tables = np.ascontiguousarray(stacked.transpose(0, 2, 1)).reshape(-1, 4)

    def __call__(self, depth: FloatArray, smear: FloatArray) -> FloatArray:
        """Look the profiles up.

        Parameters
        ----------
        depth : (n,) array
            Distance outside the outline (negative inside), px.
        smear : (n,) array
            Smear along the outline's normal, px.

        Returns
        -------
        (4, n) array
            Coverage, its slope over depth (1/px), shading profile, its slope.
        """
        place = np.clip((depth - self._low) * (1.0 / _STEP), 0, self._count - 1.001)
        column = place.astype(np.int64)
        right = (place - column)[:, None]
        if len(self._smears) > 1:
            row = np.clip(np.rint(smear * (1.0 / _SMEAR_STEP)), 0, len(self._smears) - 1)
            column += row.astype(np.int64) * self._count
        near = self._tables[column]
        return np.asarray((near + right * (self._tables[column + 1] - near)).T)


def _kernel(spread: float, smear: float) -> FloatArray:
    """Gaussian, pixel box and smear box convolved, on the table's step."""
    reach = int(np.ceil((4.0 * spread + 0.5 * smear + 1.0) / _STEP))
    axis = np.arange(-reach, reach + 1) * _STEP
    kernel = np.exp(-0.5 * (axis / max(spread, _STEP)) ** 2)
    for width in (1.0, smear):
        if width > _STEP:
            half = round(0.5 * width / _STEP)
            box = np.ones(2 * half + 1)
            box[0] = box[-1] = 0.5
            kernel = np.convolve(kernel, box, mode="same")
    return np.asarray(kernel / kernel.sum())
