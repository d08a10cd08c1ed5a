"""Camera model: lens with distortion, pose, and the image of a sphere.

World frame: x right along the wall, y up, z out of the wall towards the camera, in metres; the
wall is z = 0. Camera frame: X right, Y down, Z forward. Pixel centres are integers, (0, 0) is the
centre of the top-left pixel, y points down. Coefficients have OpenCV's order and sign. The
polynomial is that of D. C. Brown, *Close-range camera calibration*, Photogrammetric Engineering 37
(1971) 855–866; a wide lens needs the ratio of polynomials of D. Claus and A. W. Fitzgibbon, *A
rational function lens distortion model for general cameras*, CVPR 2005, in OpenCV's radial form.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["SQUARE_TO_WALL", "Camera", "Lens", "rotation_matrix"]

FloatArray = NDArray[np.float64]

MAX_INVERSION_STEPS = 40
"""Maximum steps of the fixed-point inversion (derived: linear convergence at a rate of 0.4, near
the fold of a lens, gives the sixteen digits of a double)."""


@dataclass(frozen=True)
class Lens:
    """Intrinsics and distortion of a camera.

    A stack of K lenses has arrays (K, 1) for numbers; its methods then take points (K, N, 2), or
    (N, 2) common to all.

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
        """Camera matrix in OpenCV's form, (3, 3)."""
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
        """Undistorted radius at which the distortion folds or has a pole; inf without either.

        Beyond it the model maps two directions to one pixel and is invalid.
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
        """Map directions through the lens.

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
        """Invert `distort`; NaN where there is no solution.

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
        for _ in range(MAX_INVERSION_STEPS):
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
        """Distorted over undistorted radius at undistorted radius², and the former's derivative."""
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
        for _ in range(MAX_INVERSION_STEPS):
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

    In 1/s the leading coefficient is that 1, so other coefficients may be 0.
    """
    order = polynomial.shape[-1] - 1
    companion = np.zeros((*polynomial.shape[:-1], order, order))
    companion[..., 0, :] = -polynomial[..., 1:]
    companion[..., np.arange(1, order), np.arange(order - 1)] = 1.0
    return np.asarray(np.linalg.eigvals(companion), dtype=np.complex128)


SQUARE_TO_WALL: FloatArray = np.diag([1.0, -1.0, -1.0])
"""Rotation of a camera perpendicular to the wall, with horizontal rows."""

OUTLINE_POINTS = 8
"""Sampled points of an outline (derived): its harmonics decrease by about radius over distance
each; a sphere three diameters away, off the axis of a 56° lens, is accurate to 2e-5 px."""

_RIM_ANGLES: FloatArray = 2.0 * np.pi * np.arange(OUTLINE_POINTS)[:, np.newaxis] / OUTLINE_POINTS

RIM_COSINE, RIM_SINE = np.cos(_RIM_ANGLES), np.sin(_RIM_ANGLES)


def rotation_matrix(vector: ArrayLike) -> FloatArray:
    """Rotations by |vector| rad about `vector` (..., 3) (Rodrigues), (..., 3, 3)."""
    v = np.asarray(vector, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1)[..., np.newaxis, np.newaxis]
    # (v ×): the cross product with each of the axes, as columns
    cross = np.cross(v[..., np.newaxis, :], np.eye(3)).swapaxes(-1, -2)
    # np.sinc keeps both factors finite, and their derivatives right, at angle 0.
    return np.asarray(
        np.eye(3)
        + np.sinc(angle / np.pi) * cross
        + 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2 * cross @ cross
    )


@dataclass(frozen=True, eq=False)
class Camera:
    """A lens with a pose.

    A stack of K cameras has a stack of lenses, `rotation` (K, 3, 3) and `position` (K, 1, 3); its
    methods take points (K, N, …), or (N, …) common to all, and return (K, N, …).

    Attributes
    ----------
    lens : Lens
        Its intrinsics and distortion.
    rotation : (3, 3) array
        World to camera axes (X right, Y down, Z forward).
    position : (3,) array
        Centre of projection in the world, m.
    """

    lens: Lens
    rotation: FloatArray
    position: FloatArray

    @classmethod
    def facing_wall(
        cls,
        lens: Lens,
        position: ArrayLike,
        *,
        yaw: float = 0.0,
        pitch: float = 0.0,
        roll: float = 0.0,
    ) -> Self:
        """Camera at `position` (x, y, z in m), perpendicular to the wall and then rotated.

        Parameters
        ----------
        yaw, pitch, roll : float
            Turn to the right, turn upwards, and clockwise roll as the photographer sees it, rad.
        """
        turn = rotation_matrix([0, 0, -roll]) @ rotation_matrix([-pitch, 0, 0])
        turn = turn @ rotation_matrix([0, -yaw, 0])
        return cls(lens, turn @ SQUARE_TO_WALL, np.asarray(position, dtype=np.float64))

    @property
    def axis_foot(self) -> FloatArray:
        """Intersection of the optical axis with the wall, (x, y) in m; NaN if there is none."""
        return self.to_plane(np.stack([self.lens.cx, self.lens.cy], axis=-1), 0.0)

    def project(self, points: ArrayLike) -> FloatArray:
        """Project world points into the picture.

        Parameters
        ----------
        points : (..., 3) array
            World coordinates, m.

        Returns
        -------
        (..., 2) array
            Px; NaN for points behind the camera or outside the lens's valid range.
        """
        seen = np.asarray(points, dtype=np.float64) - self.position
        seen = seen @ np.swapaxes(self.rotation, -1, -2)
        depth = np.where(seen[..., 2] > 0.0, seen[..., 2], np.nan)
        return self.lens.to_pixels(self.lens.distort(seen[..., :2] / depth[..., np.newaxis]))

    def rays(self, px: ArrayLike) -> FloatArray:
        """Viewing directions of pixels.

        Parameters
        ----------
        px : (..., 2) array

        Returns
        -------
        (..., 3) array
            Unit vectors in the world; NaN outside the lens's valid range.
        """
        xy = self.lens.undistort(self.lens.from_pixels(px))
        seen = np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
        seen /= np.linalg.norm(seen, axis=-1, keepdims=True)
        return np.asarray(seen @ self.rotation)

    def to_plane(self, px: ArrayLike, z: ArrayLike = 0.0) -> FloatArray:
        """Intersection of the rays of pixels with a plane parallel to the wall.

        Parameters
        ----------
        px : (..., 2) array
        z : float or (...) array
            Distance of the plane from the wall, m.

        Returns
        -------
        (..., 2) array
            x, y in m; NaN where the ray does not meet the plane in front of the camera.
        """
        ray = self.rays(px)
        reach = np.asarray(z, dtype=np.float64) - self.position[..., 2]
        falling = np.where(ray[..., 2] * np.sign(reach) > 0.0, ray[..., 2], np.nan)
        across = ray[..., :2] * (reach / falling)[..., np.newaxis]
        return np.asarray(self.position[..., :2] + across)

    def sphere_outline(self, centre: ArrayLike, radius: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Outline of a sphere; its centroid is not the projection of the sphere's centre.

        Parameters
        ----------
        centre : (..., 3) array
            Centre of the sphere in the world, m.
        radius : float or (...) array
            Its radius, m.

        Returns
        -------
        outline_px : (..., 2) array
            Centroid of the outline, px.
        radius_px : (...) array
            Radius of the disc of equal area, px.
        """
        centre = np.asarray(centre, dtype=np.float64)
        radius = np.asarray(radius, dtype=np.float64)
        sight = centre - self.position
        distance = np.linalg.norm(sight, axis=-1)
        towards = sight / distance[..., np.newaxis]
        # The visible rim is the circle in which the cone of tangents touches the sphere.
        rim_centre = centre - towards * (radius**2 / distance)[..., np.newaxis]
        # A camera inside the sphere has no outline.
        with np.errstate(invalid="ignore"):
            rim_radius = radius * np.sqrt(1.0 - (radius / distance) ** 2)
        down = self.rotation[..., 1, :]
        across = np.cross(towards, down[:, np.newaxis] if down.ndim == 2 else down)
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        along = np.cross(towards, across)
        rim = RIM_COSINE * across[..., np.newaxis, :] + RIM_SINE * along[..., np.newaxis, :]
        rim = rim_centre[..., np.newaxis, :] + rim * rim_radius[..., np.newaxis, np.newaxis]
        seen = self.project(rim.reshape(*rim.shape[:-3], -1, 3))
        return _centroid_and_radius(seen.reshape(*rim.shape[:-1], 2))

    def sphere_on_plane(self, outline_px: ArrayLike, radius: ArrayLike, z: ArrayLike) -> FloatArray:
        """Centre of a sphere on plane z from its outline's centroid: inverse of `sphere_outline`.

        Parameters
        ----------
        outline_px : (..., 2) array
        radius : float or (...) array
            Radius of the sphere, m.
        z : float or (...) array
            Plane of its centre, m in front of the wall.

        Returns
        -------
        (..., 2) array
            x, y of the centre, m.
        """
        outline_px = np.asarray(outline_px, dtype=np.float64)
        xy = self.to_plane(outline_px, z)
        height = np.broadcast_to(np.asarray(z, dtype=np.float64), xy.shape[:-1])
        for _ in range(2):
            centre = np.concatenate([xy, height[..., np.newaxis]], axis=-1)
            shift = self.sphere_outline(centre, radius)[0] - self.project(centre)
            xy = self.to_plane(outline_px - shift, height)
        return xy


def _spectral_derivative(points: int) -> FloatArray:
    """Matrix that differentiates a smooth closed curve sampled evenly over one turn (N even)."""
    lag = np.arange(points)[:, np.newaxis] - np.arange(points)
    sign = np.where(lag % 2 == 0, 0.5, -0.5)
    angle = np.pi * lag / points
    tangent = np.where(lag == 0, 1.0, np.tan(angle))
    return np.asarray(np.where(lag == 0, 0.0, sign / tangent))


RIM_DERIVATIVE = _spectral_derivative(OUTLINE_POINTS)


def _centroid_and_radius(outline: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centroid (..., 2) and equal-area radius (...) of smooth closed outlines (..., N, 2)."""
    middle = outline.mean(axis=-2, keepdims=True)
    here = outline - middle
    x, y = here[..., 0], here[..., 1]
    dx, dy = np.moveaxis(RIM_DERIVATIVE @ here, -1, 0)
    # Green's theorem, each mean a sum over one turn of 2 pi.
    area = 0.5 * (x * dy - y * dx).mean(axis=-1)
    moment = 0.5 * np.stack([(x * x * dy).mean(axis=-1), -(y * y * dx).mean(axis=-1)], axis=-1)
    return middle[..., 0, :] + moment / area[..., np.newaxis], np.sqrt(2.0 * np.abs(area))
