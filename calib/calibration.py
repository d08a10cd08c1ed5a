"""Convert pixels to metres on ball plane and wall, with uncertainties.

`Evidence` holds the inputs besides the grid: measured distances, the ball's size, its free fall.
`plausible` rejects a scene whose ball is not between wall and camera.
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
    """Parameters of a calibration, in the order of its vectors; arrays for stacks.

    Rotations in rad about the camera's axes; positions in m in the grid's frame; principal point in
    px; `log_pitch` is the log of the grid's true pitch over the stated one.
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
    """One independent input and the covariance it contributes.

    Attributes
    ----------
    name : UncertaintySource
        The input.
    covariance : (P, P) array
        Its part of the covariance of the parameters; the parts add up to the whole.
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

    The world's origin is bound to the ball at rest: for all parameters, the ball at rest is at
    `rest_xy` on its plane. Without a ball at rest, the world is the grid's own frame.

    P is the number of `PARAMETERS`. A stack of K calibrations has a vector (K, P); its positions
    are (K, N, 2) for N pixels.

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
        World coordinates of that point, m.
    ball_radius : float or None
        Radius of the ball, m.
    depth_estimates : tuple of DepthEstimate
        Ball plane offset from each input alone.
    depth_known : bool
        False where the ball plane offset rests on a broad prior only.
    chi2_per_dof : float
        Of the grid's nodes about the fitted camera.
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
        """Position on its plane of a ball whose outline is centred on a pixel.

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
        """Derivative of any quantity with respect to the parameters.

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
            # Large enough to exceed rounding, small enough for linearity.
            step[index] = np.clip(0.1 * std[index], 1e-9, 1e-2 * max(1.0, abs(self.vector[index])))
            ahead = np.asarray(function(self.with_parameters(self.vector + step)))
            behind = np.asarray(function(self.with_parameters(self.vector - step)))
            columns.append((ahead - behind) / (2.0 * step[index]))
        return np.stack(columns, axis=-1)

    def budget(self, function: Callable[["Calibration"], float]) -> tuple[Contribution, ...]:
        """Contribution of each input of the calibration to a scalar quantity's uncertainty."""
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


MAX_USUAL_DEPTH = 0.5
"""Ball plane offset over camera distance from which a warning is given (chosen): a ball nearer to
the camera than to the wall is unusual."""

CONFIDENCE_SIGMAS = 2.0
"""Confidence margin, standard deviations (convention: 95 %)."""


class ContradictionError(CalibrationError):
    """Grid pitch, ball diameter and measured distances contradict each other."""


def plausible(calibration: Calibration) -> Calibration:
    """Return the calibration, with a warning where the ball is unusually far from the wall.

    The apparent size determines the ball's distance from the camera independently of the grid; a
    wrong pitch displaces the wall behind it.

    Raises
    ------
    ContradictionError
        If the ball plane is behind the wall or behind the camera.
    """
    depth, distance = calibration.ball_plane_offset, calibration.camera_distance
    # Size and grid determine the ratio far better than either distance.
    share = depth / distance
    share_std = _total(calibration.budget(lambda c: c.ball_plane_offset / c.camera_distance))
    if not -CONFIDENCE_SIGMAS * share_std < share < 1.0:
        std = _total(calibration.budget(lambda c: c.ball_plane_offset))
        raise ContradictionError(
            f"the ball plane would be {depth:.2f} ± {std:.2f} m in front of the wall and the "
            f"camera {distance:.2f} m, which is impossible",
            hint="Most probably wrong: [wall] grid, or [ball] diameter.",
        )
    if share - CONFIDENCE_SIGMAS * share_std < MAX_USUAL_DEPTH:
        return calibration
    told = (
        f"the ball plane is {depth:.2f} m in front of the wall, {distance - depth:.2f} m from the "
        "camera, which is unusual: check the pitch of the grid and the diameter of the ball"
    )
    return replace(calibration, warnings=(*calibration.warnings, told))


def _total(budget: tuple[Contribution, ...]) -> float:
    return math.sqrt(sum(line.std**2 for line in budget))


RADIUS_COMMON_STD_PX, RADIUS_COMMON_OVER_RANDOM = 0.05, 4.0
"""Common error of all radii of a clip, px, and over their random error (chosen). What biases an
outline (shading, blur, compression) does so in every frame, and more if the frame is less clear."""


@dataclass(frozen=True)
class Known:
    """A measured number with its standard uncertainty."""

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
        Common error of all radii (blur, threshold, shading), px.
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
        """Tracked outlines, with their common error."""
        common = np.hypot(RADIUS_COMMON_STD_PX, RADIUS_COMMON_OVER_RANDOM * np.median(std_px))
        return cls(centre_px, radius_px, std_px, diameter, float(common))


@dataclass(frozen=True, eq=False)
class FreeFall:
    """An interval of free flight.

    Attributes
    ----------
    centre_px : (N, 2) array
        Centres of the ball's outline, px.
    time_s : (N,) array
        Times, s.
    std_px : (N,) array
        Standard uncertainty of each centre along one axis, px.
    acceleration : Known
        Expected mean downward acceleration, m/s²: gravity minus drag; its uncertainty includes
        that of the capture rate.
    """

    centre_px: FloatArray
    time_s: FloatArray
    std_px: FloatArray
    acceleration: Known


@dataclass(frozen=True, eq=False)
class Evidence:
    """Inputs besides the grid; all optional.

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
        Position of the camera, world coordinates, m.
    axis_foot_x, axis_foot_y : Known or None
        Intersection of the optical axis with the wall, world coordinates, m.
    ball_plane_offset : Known or None
        Measured distance of the ball plane from the wall, m.
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
        """Whether measured distances give the ball plane's scale; a fall is then only a check."""
        return self.camera_distance is not None and self.ball_plane_offset is not None
