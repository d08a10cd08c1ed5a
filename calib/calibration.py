"""A calibrated scene: pixels to metres on the ball's plane and on the wall, and how sure.

Whether a fitted scene can be: a ball between wall and camera.

What is known about a scene besides its grid: taped distances, the ball's size, its free fall.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.camera import Camera, Lens, rotation_matrix
from metrology import CalibrationError, Contribution, Defaults, UncertaintySource

__all__ = [
    "PARAMETERS",
    "RADIUS_COMMON_OVER_RANDOM",
    "BallOutlines",
    "Calibration",
    "ContradictionError",
    "DepthEstimate",
    "Evidence",
    "FreeFall",
    "Known",
    "Parameters",
    "Source",
    "plausible",
]

FloatArray = NDArray[np.float64]


class Parameters(NamedTuple):
    """What a calibration determines, in the order of its vectors; of stacks, arrays.

    Turns in rad about the camera's axes; places in m in the grid's frame; principal point in px;
    `log_pitch` of the grid's true pitch over the one that was said.
    """

    turn_x: Any
    turn_y: Any
    turn_z: Any
    camera_x: Any
    camera_y: Any
    log_distance: Any
    log_focal: Any
    principal_x: Any
    principal_y: Any
    k1: Any
    k2: Any
    ball_plane_offset: Any
    log_pitch: Any

    @classmethod
    def of(cls, vector: FloatArray) -> Self:
        """Names for the numbers of a vector (P,), or of vectors (..., P)."""
        return cls(*np.moveaxis(vector, -1, 0))


PARAMETERS = Parameters._fields

"""Their names, in order."""


@dataclass(frozen=True, eq=False)
class Source:
    """One independent input and what its uncertainty does to the parameters.

    Attributes
    ----------
    name : UncertaintySource
        The input.
    covariance : (P, P) array
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

    P is the number of `PARAMETERS`. A stack of K calibrations has a vector (K, P): its camera is a
    stack, and places come out as (K, N, 2) for N pixels.

    Attributes
    ----------
    lens : Lens
        Lens at the best estimate.
    orientation : (3, 3) array
        Rotation from the wall's frame to the camera's at zero turns.
    vector : (P,) array
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

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of `vector`, (P, P)."""
        return np.asarray(
            sum((s.covariance for s in self.sources), np.zeros((len(PARAMETERS), len(PARAMETERS))))
        )

    @cached_property
    def parameters(self) -> Parameters:
        """The numbers of `vector` by name."""
        return Parameters.of(self.vector)

    @property
    def ball_plane_offset(self) -> float:
        """Ball plane in front of the wall, m."""
        return float(self.parameters.ball_plane_offset)

    @property
    def camera_distance(self) -> float:
        """Camera in front of the wall, m."""
        return float(np.exp(self.parameters.log_distance))

    @property
    def _depth(self) -> Any:
        """Ball plane in front of the wall, m: a float, or (K, 1) of a stack."""
        depth = self.parameters.ball_plane_offset
        return depth[:, np.newaxis] if self.vector.ndim > 1 else depth

    @cached_property
    def grid_camera(self) -> Camera:
        """The camera in the frame of the grid."""
        stacked = self.vector.ndim > 1
        p = Parameters.of(self.vector[:, np.newaxis] if stacked else self.vector)
        focal = np.exp(p.log_focal)
        lens = replace(
            self.lens,
            fx=focal,
            fy=focal * (self.lens.fy / self.lens.fx),
            cx=p.principal_x,
            cy=p.principal_y,
            k1=p.k1,
            k2=p.k2,
        )
        position = np.stack([p.camera_x, p.camera_y, np.exp(p.log_distance)], axis=-1)
        turn = rotation_matrix(self.vector[..., :3])
        return Camera(lens, turn @ self.orientation, position)

    @cached_property
    def origin(self) -> FloatArray:
        """World coordinates of the grid's origin, (2,), m; (K, 1, 2) of a stack."""
        if self.rest_px is None or self.rest_xy is None:
            return np.zeros(2)
        rest = self.rest_px if self.vector.ndim == 1 else self.rest_px[np.newaxis]
        return np.asarray(self.rest_xy - self._on_ball_plane(self.grid_camera, rest))

    @cached_property
    def camera(self) -> Camera:
        """The camera in the world."""
        seen = self.grid_camera
        origin = self.origin
        moved = np.concatenate([origin, np.zeros_like(origin[..., :1])], axis=-1)
        return replace(seen, position=seen.position + moved)

    def with_parameters(self, vector: ArrayLike) -> Self:
        """The same scene with other parameters (P,), or a stack of them (K, P)."""
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
            camera.to_plane(px + 0.5 * e, self._depth) - camera.to_plane(px - 0.5 * e, self._depth)
            for e in np.eye(2)
        ]
        jacobian = np.stack(steps, axis=-1)
        return xy, np.asarray(jacobian @ np.asarray(covariance_px2) @ np.swapaxes(jacobian, -1, -2))

    def outline_radius(self, px: ArrayLike, radius: float) -> FloatArray:
        """Radius (..., N) of the outlines, centred on pixels (N, 2), of balls on their plane, px.

        Parameters
        ----------
        px : (N, 2) array
            Outline centres.
        radius : float
            Of the balls, m.
        """
        camera = self.grid_camera
        xy = camera.sphere_on_plane(px, radius, self._depth)
        depth = np.broadcast_to(self._depth, xy.shape[:-1])
        return camera.sphere_outline(np.concatenate([xy, depth[..., np.newaxis]], -1), radius)[1]

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
        (..., P) array
        """
        std = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        columns = []
        for index in range(len(self.vector)):
            step = np.zeros(len(PARAMETERS))
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
        if self.ball_radius is None:
            return camera.to_plane(px, self._depth)
        return camera.sphere_on_plane(px, self.ball_radius, self._depth)


# A ball nearer to the camera than to the wall is not what a measurement against a wall looks like
FAR_OUT = 0.5

SURE = 2.0


class ContradictionError(CalibrationError):
    """Grid pitch, ball diameter and taped distances can't all be right."""


def plausible(calibration: Calibration) -> Calibration:
    """The calibration, with a warning where the ball is suspiciously far from the wall.

    Apparent size puts the ball at a distance from the camera that does not depend on the grid; a
    wrong pitch moves the wall away from behind it.

    Raises
    ------
    ContradictionError
        If the ball plane is behind the wall or behind the camera.
    """
    depth, distance = calibration.ball_plane_offset, calibration.camera_distance
    # size against grid tells depth over distance far better than either of them
    share = depth / distance
    share_std = _total(calibration.budget(lambda c: c.ball_plane_offset / c.camera_distance))
    if not -SURE * share_std < share < 1.0:
        std = _total(calibration.budget(lambda c: c.ball_plane_offset))
        raise ContradictionError(
            f"the ball plane would be {depth:.2f} ± {std:.2f} m in front of the wall and the "
            f"camera {distance:.2f} m: no such scene",
            hint="Likeliest wrong: the pitch of the grid, or the diameter of the ball.",
        )
    if share - SURE * share_std < FAR_OUT:
        return calibration
    told = (
        f"the ball plane comes out {depth:.2f} m in front of the wall, {distance - depth:.2f} m "
        "from the camera: check the pitch of the grid and the diameter of the ball"
    )
    return replace(calibration, warnings=(*calibration.warnings, told))


def _total(budget: tuple[Contribution, ...]) -> float:
    return math.sqrt(sum(line.std**2 for line in budget))


RADIUS_COMMON_STD_PX, RADIUS_COMMON_OVER_RANDOM = 0.05, 4.0

"""px, and times the random part: what all radii of a clip are off by together, supposed. What
biases an outline (shading, blur, compression) biases it in every frame, and more where a frame
tells less of it."""


@dataclass(frozen=True)
class Known:
    """A number somebody measured, with its standard uncertainty."""

    value: float
    std: float


@dataclass(frozen=True, eq=False)
class BallOutlines:
    """Outlines of a ball of known size.

    Attributes
    ----------
    centre_px : (N, 2) array
        Centres of the outlines, px.
    radius_px : (N,) array
        Radii of the outlines, px.
    std_px : (N,) array
        Their independent standard uncertainties, px.
    diameter : Known
        Diameter of the ball, m.
    common_std_px : float
        What all radii may be off by together (blur, threshold, shading), px.
    """

    centre_px: FloatArray
    radius_px: FloatArray
    std_px: FloatArray
    diameter: Known
    common_std_px: float = RADIUS_COMMON_STD_PX

    @classmethod
    def followed(
        cls, centre_px: FloatArray, radius_px: FloatArray, std_px: FloatArray, diameter: Known
    ) -> Self:
        """Outlines as following a ball gives them, with what they are off by together."""
        common = np.hypot(RADIUS_COMMON_STD_PX, RADIUS_COMMON_OVER_RANDOM * np.median(std_px))
        return cls(centre_px, radius_px, std_px, diameter, float(common))


@dataclass(frozen=True, eq=False)
class FreeFall:
    """A stretch of free flight.

    Attributes
    ----------
    centre_px : (N, 2) array
        Centres of the ball's outline, px.
    time_s : (N,) array
        Times, s.
    std_px : (N,) array
        Standard uncertainty of each centre along one axis, px.
    acceleration : Known
        Mean downward acceleration to expect, m/s²: gravity, less what the air takes; its
        uncertainty holds that of the capture rate too.
    """

    centre_px: FloatArray
    time_s: FloatArray
    std_px: FloatArray
    acceleration: Known


@dataclass(frozen=True, eq=False)
class Evidence:
    """All that may be known; every part optional.

    Attributes
    ----------
    rest_px : (2,) array or None
        Centre of the ball's outline at rest: the world's origin in x.
    rest_height : float
        Height of the ball's centre at rest above y = 0, m.
    ball_radius : float or None
        Radius of the ball, m, for the correction from outline centre to centre.
    camera_distance : Known or None
        Camera to wall, along the wall's normal, m.
    camera_x, camera_y : Known or None
        Where the camera stands, world coordinates, m.
    axis_foot_x, axis_foot_y : Known or None
        Where the optical axis meets the wall, world coordinates, m.
    ball_plane_offset : Known or None
        Ball plane in front of the wall by tape, m.
    outlines : BallOutlines or None
    fall : FreeFall or None
    pitch_relative_std : float
        Standard uncertainty of the grid's pitch over the pitch; not 0.
    """

    rest_px: FloatArray | None = None
    rest_height: float = 0.0
    ball_radius: float | None = None
    camera_distance: Known | None = None
    camera_x: Known | None = None
    camera_y: Known | None = None
    axis_foot_x: Known | None = None
    axis_foot_y: Known | None = None
    ball_plane_offset: Known | None = None
    outlines: BallOutlines | None = None
    fall: FreeFall | None = None
    pitch_relative_std: float = Defaults.GRID_PITCH.std

    @property
    def taped(self) -> bool:
        """Whether tape alone tells the scale of the ball plane: then a fall is left as a check."""
        return self.camera_distance is not None and self.ball_plane_offset is not None
