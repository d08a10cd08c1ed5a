"""A lens known before a clip is looked at, and how well."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.camera.lens_model import Lens

__all__ = ["FLOOR", "LensPrior", "prior_of"]

FloatArray = NDArray[np.float64]

MOST_POINTS = 600
BROWN = 5
FLOOR: FloatArray = np.array([1e-4, 0.05, 0.05, 1e-4, 1e-4])
"""No lens is known better: focusing and warming up move it by as much."""


@dataclass(frozen=True, eq=False)
class LensPrior:
    """A lens known beforehand.

    Attributes
    ----------
    lens : Lens
        Its parameters, at the size of the clip's picture.
    std : (5,) array
        Standard uncertainties of log focal length, principal point (x, y, px), k1, k2.
    correlation : (5, 5) array or None
        Their correlations; None for none.
    """

    lens: Lens
    std: FloatArray
    correlation: FloatArray | None = None

    @property
    def related(self) -> FloatArray:
        """Correlations of the five, (5, 5)."""
        return np.eye(5) if self.correlation is None else self.correlation

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the five, (5, 5)."""
        return np.asarray(self.related * np.outer(self.std, self.std))

    def resized(self, width: int, height: int) -> "LensPrior":
        """The same for the picture resampled to another size."""
        sx, sy = width / self.lens.width, height / self.lens.height
        std = np.maximum(self.std * [1.0, sx, sy, 1.0, 1.0], FLOOR)
        return LensPrior(self.lens.resized(width, height), std, self.correlation)


def prior_of(lens: Lens, covariance: FloatArray, seen_px: FloatArray) -> LensPrior:
    """What the uncertainty of all parameters of a lens amounts to in the five that a clip moves.

    The parameters of a rich model trade off against each other; what matters is how far they leave
    a place in the picture open. The five are given the covariance that leaves it open as far.

    Parameters
    ----------
    lens : Lens
    covariance : (P, P) array
        Of fx, fy, cx, cy and the distortion coefficients in OpenCV's order.
    seen_px : (N, 2) array
        Where in the picture the lens was measured.
    """
    chosen = seen_px[np.unique(np.linspace(0, len(seen_px) - 1, MOST_POINTS).astype(int))]
    looks = lens.undistort(lens.from_pixels(chosen))
    looks = looks[np.isfinite(looks).all(axis=1)]
    rays = np.c_[looks, np.ones(len(looks))]
    count = len(covariance) - 4
    coefficients = np.zeros(count)
    known = lens.coefficients
    coefficients[: len(known)] = known
    still = np.zeros(3)
    moves = np.asarray(cv2.projectPoints(rays, still, still, lens.matrix, coefficients)[1])[:, 6:]
    by_five = np.column_stack(
        [lens.fx * moves[:, 0] + lens.fy * moves[:, 1], moves[:, 2:4], moves[:, 4:6]]
    )
    to_five = np.linalg.lstsq(by_five, moves[:, : 4 + count], rcond=None)[0]
    five = to_five @ covariance @ to_five.T
    std = np.sqrt(np.diag(five))
    return LensPrior(lens, np.maximum(std, FLOOR), five / np.outer(std, std))
