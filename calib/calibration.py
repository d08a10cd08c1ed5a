"""A calibrated scene: pixels to metres on the ball's plane and on the wall, and how sure."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.camera.camera import Camera, Lens, rotation_matrix
from metrology import Contribution, UncertaintySource

__all__ = ["PARAMETERS", "Calibration", "DepthEstimate", "Source"]

FloatArray = NDArray[np.float64]

PARAMETERS = (
    "turn_x",
    "turn_y",
    "turn_z",
    "camera_x",
    "camera_y",
    "log_distance",
    "log_focal",
    "principal_x",
    "principal_y",
    "k1",
    "k2",
    "ball_plane_offset",
)
"""Turns in rad about the camera's axes; places in m in the grid's frame; principal point in px."""


@dataclass(frozen=True, eq=False)
class Source:
    """One independent input and what its uncertainty does to the parameters.

    Attributes
    ----------
    name : UncertaintySource
        The input.
    covariance : (12, 12) array
        Its share of the covariance of the parameters; the shares add up to the whole.
    """

    name: UncertaintySource
    covariance: FloatArray


@dataclass(frozen=True)
class DepthEstimate:
    """Ball plane offset from one input alone, m."""

    source: UncertaintySource
    value: float
    std: float


@dataclass(frozen=True, eq=False)
class Calibration:
    """Camera, wall and ball plane, with joint uncertainty.

    The world's origin is bound to the ball at rest: whatever the parameters, the ball at rest is at
    `rest_xy` on its plane. Without a ball at rest, the world is the grid's own frame.

    Attributes
    ----------
    lens : Lens
        Lens at the best estimate.
    orientation : (3, 3) array
        Rotation from the wall's frame to the camera's at zero turns.
    vector : (12,) array
        Parameters, see `PARAMETERS`.
    sources : tuple of Source
        Covariance by source.
    rest_px : (2,) array or None
        Outline centre of the ball at rest, px.
    rest_xy : (2,) array
        World coordinates it has, m.
    ball_radius : float or None
        Radius of the ball, m.
    depth_estimates : tuple of DepthEstimate
        Ball plane offset from each input alone.
    depth_known : bool
        False where nothing but a broad guess stands behind the ball plane offset.
    chi2_per_dof : float
        Of the grid's nodes about the fitted camera.
    warnings : tuple of str
    """

    lens: Lens
    orientation: FloatArray
    vector: FloatArray
    sources: tuple[Source, ...]
    rest_px: FloatArray | None = None
    rest_xy: FloatArray | None = None
    ball_radius: float | None = None
    depth_estimates: tuple[DepthEstimate, ...] = ()
    depth_known: bool = True
    chi2_per_dof: float = 1.0
    warnings: tuple[str, ...] = ()

    @property
    def covariance(self) -> FloatArray:
        """Covariance of `vector`, (12, 12)."""
        return np.asarray(sum((s.covariance for s in self.sources), np.zeros((12, 12))))

    @property
    def ball_plane_offset(self) -> float:
        """Ball plane in front of the wall, m."""
        return float(self.vector[11])

    @property
    def camera_distance(self) -> float:
        """Camera in front of the wall, m."""
        return float(np.exp(self.vector[5]))

    @property
    def grid_camera(self) -> Camera:
        """The camera in the frame of the grid."""
        v = self.vector
        focal = float(np.exp(v[6]))
        lens = replace(
            self.lens,
            fx=focal,
            fy=focal * self.lens.fy / self.lens.fx,
            cx=float(v[7]),
            cy=float(v[8]),
            k1=float(v[9]),
            k2=float(v[10]),
        )
        position = np.array([v[3], v[4], np.exp(v[5])])
        return Camera(lens, rotation_matrix(v[:3]) @ self.orientation, position)

    @property
    def origin(self) -> FloatArray:
        """World coordinates of the grid's origin, (2,), m."""
        if self.rest_px is None or self.rest_xy is None:
            return np.zeros(2)
        return np.asarray(self.rest_xy - self._on_ball_plane(self.grid_camera, self.rest_px))

    @property
    def camera(self) -> Camera:
        """The camera in the world."""
        seen = self.grid_camera
        return replace(seen, position=seen.position + np.append(self.origin, 0.0))

    def with_parameters(self, vector: ArrayLike) -> Self:
        """The same scene with other parameters: for propagation by finite differences."""
        return replace(self, vector=np.asarray(vector, dtype=np.float64))

    def position(
        self, px: ArrayLike, covariance_px2: ArrayLike | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Where on its plane the ball is whose outline is centred on a pixel.

        Parameters
        ----------
        px : (..., 2) array
            Outline centres.
        covariance_px2 : (..., 2, 2) array, optional
            Their covariances, px².

        Returns
        -------
        xy : (..., 2) array
            World coordinates of the ball's centre, m.
        covariance : (..., 2, 2) array
            From the pixels' noise alone, m²; zeros where none was given.
        """
        px = np.asarray(px, dtype=np.float64)
        camera = self.grid_camera
        xy = self._on_ball_plane(camera, px) + self.origin
        if covariance_px2 is None:
            return xy, np.zeros((*px.shape, 2))
        steps = [
            camera.to_plane(px + 0.5 * e, self.vector[11])
            - camera.to_plane(px - 0.5 * e, self.vector[11])
            for e in np.eye(2)
        ]
        jacobian = np.stack(steps, axis=-1)
        return xy, np.asarray(jacobian @ np.asarray(covariance_px2) @ np.swapaxes(jacobian, -1, -2))

    def on_wall(self, px: ArrayLike) -> FloatArray:
        """Reading on the wall behind pixels (..., 2): world coordinates (..., 2), m."""
        return np.asarray(self.grid_camera.to_plane(px, 0.0) + self.origin)

    def gradient(self, function: Callable[["Calibration"], ArrayLike]) -> FloatArray:
        """Derivative of any quantity by the parameters.

        Parameters
        ----------
        function : callable
            Takes a Calibration, returns a quantity, scalar or array.

        Returns
        -------
        (..., 12) array
        """
        std = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        columns = []
        for index in range(len(self.vector)):
            step = np.zeros(12)
            # Large enough to rise above rounding, small enough for the map to be straight
            step[index] = np.clip(0.1 * std[index], 1e-9, 1e-2 * max(1.0, abs(self.vector[index])))
            ahead = np.asarray(function(self.with_parameters(self.vector + step)))
            behind = np.asarray(function(self.with_parameters(self.vector - step)))
            columns.append((ahead - behind) / (2.0 * step[index]))
        return np.stack(columns, axis=-1)

    def budget(self, function: Callable[["Calibration"], float]) -> tuple[Contribution, ...]:
        """What each input of the calibration adds to the uncertainty of a scalar quantity."""
        slope = self.gradient(function)
        return tuple(
            Contribution(s.name, float(np.sqrt(max(0.0, float(slope @ s.covariance @ slope)))))
            for s in self.sources
        )

    def position_covariance(self, px: ArrayLike) -> FloatArray:
        """Systematic covariance of `position` at pixels (..., 2): (..., 2, 2), m²."""
        slope = self.gradient(lambda c: c.position(px)[0])
        return np.asarray(slope @ self.covariance @ np.swapaxes(slope, -1, -2))

    def uncertainty_map(self, step: int = 16) -> tuple[FloatArray, FloatArray]:
        """Systematic uncertainty of positions on the ball plane over the picture.

        Parameters
        ----------
        step : int
            Spacing of the map's points, px.

        Returns
        -------
        px : (R, C, 2) array
        std : (R, C) array
            Root of the sum of both variances, m.
        """
        rows = np.arange(0, self.lens.height, step, dtype=np.float64)
        columns = np.arange(0, self.lens.width, step, dtype=np.float64)
        px = np.stack(np.meshgrid(columns, rows), axis=-1)
        covariance = self.position_covariance(px)
        return px, np.sqrt(np.trace(covariance, axis1=-2, axis2=-1))

    def _on_ball_plane(self, camera: Camera, px: ArrayLike) -> FloatArray:
        offset = self.vector[11]
        if self.ball_radius is None:
            return camera.to_plane(px, offset)
        return camera.sphere_on_plane(px, self.ball_radius, offset)
