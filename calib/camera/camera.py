"""The camera: a lens, its pose, and what a sphere looks like through it.

World frame: x right along the wall, y up, z out of the wall towards the camera, in metres; the
wall is z = 0. Camera frame: X right, Y down, Z forward. Pixel centres are integers, (0, 0) is the
centre of the top-left pixel, y points down.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.camera.lens_model import Lens

__all__ = ["SQUARE_TO_WALL", "Camera", "Lens", "rotation_matrix"]

FloatArray = NDArray[np.float64]

SQUARE_TO_WALL: FloatArray = np.diag([1.0, -1.0, -1.0])
"""Rotation of a camera that looks straight at the wall, its rows along the picture's rows."""

OUTLINE_POINTS = 8
"""An outline's harmonics fall by about radius over distance from one to the next: that of a sphere
three of its diameters away, off to the side of a 56° lens, is right to 2e-5 px with these."""
_TURN: FloatArray = 2.0 * np.pi * np.arange(OUTLINE_POINTS)[:, np.newaxis] / OUTLINE_POINTS
RIM_COSINE, RIM_SINE = np.cos(_TURN), np.sin(_TURN)


def rotation_matrix(vector: ArrayLike) -> FloatArray:
    """Rotations by |vector| rad about `vector` (..., 3) (Rodrigues), (..., 3, 3)."""
    v = np.asarray(vector, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1)[..., np.newaxis, np.newaxis]
    # (v ×): the cross product with each of the axes, as columns
    cross = np.cross(v[..., np.newaxis, :], np.eye(3)).swapaxes(-1, -2)
    # np.sinc keeps both factors finite, and their derivatives right, at angle 0
    return np.asarray(
        np.eye(3)
        + np.sinc(angle / np.pi) * cross
        + 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2 * cross @ cross
    )


@dataclass(frozen=True, eq=False)
class Camera:
    """A lens somewhere in the room.

    A stack of K cameras has a stack of lenses, `rotation` (K, 3, 3) and `position` (K, 1, 3); its
    methods take points (K, N, …), or (N, …) that all of them look at, and give (K, N, …).

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
        """Camera at `position` (x, y, z in m), square to the wall and then turned.

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
        """Where the optical axis meets the wall, (x, y) in m; NaN where it does not."""
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
            Px; NaN for points behind the camera or outside what the lens can see.
        """
        seen = np.asarray(points, dtype=np.float64) - self.position
        seen = seen @ np.swapaxes(self.rotation, -1, -2)
        depth = np.where(seen[..., 2] > 0.0, seen[..., 2], np.nan)
        return self.lens.to_pixels(self.lens.distort(seen[..., :2] / depth[..., np.newaxis]))

    def rays(self, px: ArrayLike) -> FloatArray:
        """Directions in which pixels look.

        Parameters
        ----------
        px : (..., 2) array

        Returns
        -------
        (..., 3) array
            Unit vectors in the world; NaN where the lens sees nothing.
        """
        xy = self.lens.undistort(self.lens.from_pixels(px))
        seen = np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
        seen /= np.linalg.norm(seen, axis=-1, keepdims=True)
        return np.asarray(seen @ self.rotation)

    def to_plane(self, px: ArrayLike, z: ArrayLike = 0.0) -> FloatArray:
        """Where the rays of pixels meet a plane parallel to the wall.

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
        """Outline of a sphere in the picture: not centred on the projection of its centre.

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
        # The visible rim is the circle in which the cone of tangents touches the sphere
        rim_centre = centre - towards * (radius**2 / distance)[..., np.newaxis]
        # a camera inside the sphere sees no outline
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
        """Centre of a sphere on the plane z from its outline's centroid; undoes `sphere_outline`.

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

    def sphere_in_space(
        self, outline_px: ArrayLike, radius_px: ArrayLike, radius: ArrayLike
    ) -> FloatArray:
        """Centre of a sphere of known radius from where and how large its outline is.

        Parameters
        ----------
        outline_px : (..., 2) array
        radius_px : (...) array
            Radius of the outline, px.
        radius : float or (...) array
            Radius of the sphere, m.

        Returns
        -------
        (..., 3) array
            World coordinates of its centre, m.
        """
        outline_px = np.asarray(outline_px, dtype=np.float64)
        radius_px = np.asarray(radius_px, dtype=np.float64)
        aim = outline_px
        distance = self.lens.fx * np.asarray(radius, dtype=np.float64) / radius_px
        for _ in range(8):
            centre = self.position + self.rays(aim) * distance[..., np.newaxis]
            seen_at, seen_radius = self.sphere_outline(centre, radius)
            aim = aim + outline_px - seen_at
            distance = distance * seen_radius / radius_px
        return np.asarray(self.position + self.rays(aim) * distance[..., np.newaxis])


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
    # Green's theorem, each mean a sum over one turn of 2 pi
    area = 0.5 * (x * dy - y * dx).mean(axis=-1)
    moment = 0.5 * np.stack([(x * x * dy).mean(axis=-1), -(y * y * dx).mean(axis=-1)], axis=-1)
    return middle[..., 0, :] + moment / area[..., np.newaxis], np.sqrt(2.0 * np.abs(area))
