"""The lens: focal length, principal point, and a distortion that is Brown's or a ratio of two such.

Pixel centres are integers, (0, 0) is the centre of the top-left pixel, y points down. Coefficients
have OpenCV's order and sign. The polynomial is that of D. C. Brown, *Close-range camera
calibration*, Photogrammetric Engineering 37 (1971) 855–866; a wide lens needs the ratio of
polynomials of D. Claus and A. W. Fitzgibbon, *A rational function lens distortion model for general
cameras*, CVPR 2005, in the radial form that OpenCV gave it.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Lens"]

FloatArray = NDArray[np.float64]

INVERSION_STEPS = 40


@dataclass(frozen=True)
class Lens:
    """Intrinsics and distortion of a camera.

    A stack of K lenses has arrays (K, 1) for numbers; its methods then take points (K, N, 2), or
    (N, 2) that all of them look at.

    Attributes
    ----------
    width, height : int
        Picture size, px.
    fx, fy : float
        Focal length along both axes, px.
    cx, cy : float
        Principal point, px.
    k1, k2, k3 : float
        Radial distortion coefficients.
    p1, p2 : float
        Decentring (tangential) distortion coefficients.
    k4, k5, k6 : float
        Radial coefficients of the denominator; 0 leaves Brown's polynomial.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0

    @classmethod
    def centred(
        cls, width: int, height: int, focal: float, *, k1: float = 0.0, k2: float = 0.0
    ) -> Self:
        """Lens with square pixels and its principal point in the middle of the picture."""
        return cls(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, k1, k2)

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix as OpenCV takes it, (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def coefficients(self) -> FloatArray:
        """Distortion coefficients in OpenCV's order, k1 k2 p1 p2 k3 and, if any, k4 k5 k6."""
        five = [self.k1, self.k2, self.p1, self.p2, self.k3]
        return np.array([*five, self.k4, self.k5, self.k6] if self._rational else five)

    def resized(self, width: int, height: int) -> Self:
        """The same lens with the picture resampled to another size."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
        )

    @cached_property
    def _rational(self) -> bool:
        return bool(np.any(self.k4) or np.any(self.k5) or np.any(self.k6))

    @cached_property
    def fold(self) -> Any:
        """Undistorted radius at which the distortion turns back or has a pole; inf without either.

        Beyond it the model maps two directions to one pixel and means nothing.
        """
        above = _coefficients(1.0, self.k1, self.k2, self.k3)
        # of r n(s) / d(s) with s = r²: the slope has the sign of (n + 2 s n') d - 2 s n d'
        slope = above * (1.0 + 2.0 * np.arange(4))
        poles = np.zeros((*above.shape[:-1], 0))
        if self._rational:
            below = _coefficients(1.0, self.k4, self.k5, self.k6)
            slope = _product(slope, below) - _product(above, 2.0 * np.arange(4) * below)
            poles = _inverse_roots(below)
        roots = np.concatenate([_inverse_roots(slope), poles], axis=-1)
        real = np.abs(roots.imag) < 1e-9 * (1e-9 + np.abs(roots))
        largest = np.where(real, roots.real, 0.0).max(axis=-1, initial=0.0)
        safe = np.where(largest > 1e-12, largest, 1.0)
        return np.where(largest > 1e-12, 1.0 / np.sqrt(safe), np.inf)[()]

    def distort(self, xy: ArrayLike) -> FloatArray:
        """Where the lens puts a direction.

        Parameters
        ----------
        xy : (..., 2) array
            Undistorted normalised coordinates X/Z, Y/Z.

        Returns
        -------
        (..., 2) array
            Distorted normalised coordinates; NaN beyond the fold of the polynomial.
        """
        xy = np.asarray(xy, dtype=np.float64)
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        radial = np.where(r2 < self.fold**2, self._stretch(r2)[0], np.nan)
        dx, dy = self._decentring(x, y, r2)
        return np.stack([x * radial + dx, y * radial + dy], axis=-1)

    def undistort(self, xy: ArrayLike) -> FloatArray:
        """Invert `distort`; NaN where no direction leads to the given place.

        Parameters
        ----------
        xy : (..., 2) array
            Distorted normalised coordinates.

        Returns
        -------
        (..., 2) array
            Undistorted normalised coordinates.
        """
        given = np.asarray(xy, dtype=np.float64)
        found = self._undo_radial(given)
        if not (np.any(self.p1) or np.any(self.p2)):
            return found
        for _ in range(INVERSION_STEPS):
            x, y = found[..., 0], found[..., 1]
            offset = np.stack(self._decentring(x, y, x * x + y * y), axis=-1)
            before, found = found, self._undo_radial(given - offset)
            if not np.any(np.abs(found - before) > 1e-13):
                break
        return found

    def to_pixels(self, xy: ArrayLike) -> FloatArray:
        """Distorted normalised coordinates (..., 2) to px."""
        xy = np.asarray(xy)
        return np.stack([xy[..., 0] * self.fx + self.cx, xy[..., 1] * self.fy + self.cy], axis=-1)

    def from_pixels(self, px: ArrayLike) -> FloatArray:
        """Px (..., 2) to distorted normalised coordinates."""
        px = np.asarray(px)
        return np.stack(
            [(px[..., 0] - self.cx) / self.fx, (px[..., 1] - self.cy) / self.fy], axis=-1
        )

    def _decentring(
        self, x: FloatArray, y: FloatArray, r2: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        return (
            2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        )

    def _stretch(self, r2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distorted over undistorted radius at undistorted radius², and how the former changes."""
        above = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        slope = 1.0 + r2 * (3.0 * self.k1 + r2 * (5.0 * self.k2 + 7.0 * r2 * self.k3))
        if not self._rational:
            return above, slope
        below = 1.0 + r2 * (self.k4 + r2 * (self.k5 + r2 * self.k6))
        steep = 2.0 * r2 * (self.k4 + r2 * (2.0 * self.k5 + 3.0 * r2 * self.k6))
        return above / below, (slope - above * steep / below) / below

    def _undo_radial(self, xy: FloatArray) -> FloatArray:
        if not (np.any(self.k1) or np.any(self.k2) or np.any(self.k3) or self._rational):
            return xy
        distorted = np.hypot(xy[..., 0], xy[..., 1])
        limit = np.minimum(self.fold, 1e6)
        radius = np.minimum(distorted, limit)
        residual = np.zeros_like(distorted)
        for _ in range(INVERSION_STEPS):
            stretch, slope = self._stretch(radius * radius)
            residual = radius * stretch - distorted
            if not np.any(np.abs(residual) > 1e-14 * (1.0 + distorted)):
                break
            radius = np.clip(radius - residual / np.maximum(slope, 1e-9), 0.0, limit)
        ratio = np.where(distorted > 0.0, radius / np.where(distorted > 0.0, distorted, 1.0), 1.0)
        ratio = np.where(np.abs(residual) < 1e-9 * (1.0 + distorted), ratio, np.nan)
        return xy * ratio[..., np.newaxis]


def _coefficients(*numbers: ArrayLike) -> FloatArray:
    """Polynomials of a stack of lenses, (..., P), lowest order first."""
    return np.stack(np.broadcast_arrays(*(np.asarray(n, dtype=np.float64) for n in numbers)), -1)


def _product(one: FloatArray, other: FloatArray) -> FloatArray:
    """Products of polynomials (..., P) and (..., Q): (..., P + Q - 1)."""
    out = np.zeros((*one.shape[:-1], one.shape[-1] + other.shape[-1] - 1))
    for power in range(other.shape[-1]):
        out[..., power : power + one.shape[-1]] += one * other[..., power : power + 1]
    return out


def _inverse_roots(polynomial: FloatArray) -> NDArray[np.complex128]:
    """One over the roots of polynomials (..., P) whose constant term is 1: (..., P - 1).

    In 1/s the leading coefficient is that 1, whatever other coefficients are 0.
    """
    order = polynomial.shape[-1] - 1
    companion = np.zeros((*polynomial.shape[:-1], order, order))
    companion[..., 0, :] = -polynomial[..., 1:]
    companion[..., np.arange(1, order), np.arange(order - 1)] = 1.0
    return np.asarray(np.linalg.eigvals(companion), dtype=np.complex128)
