"""The calibrated scene as a measurement uses it: metres on the ball's plane, one input at a time.

`calib.pose` fits the camera; here its covariance is split into independent shifts, each with a name
and each a calibration of its own, so that any result, however nonlinear, gets its budget by being
worked out anew with every input moved. A fall under known gravity can be added afterwards.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.calibration import Calibration
from calib.camera import Camera, Lens
from calib.evidence import BallOutlines, Evidence, Known
from calib.grid import WallGrid
from calib.pose import LensPrior
from calib.pose import calibrate as fit_scene
from metrology import CalibrationError

__all__ = ["Estimate", "Input", "SceneCalibration", "calibrate", "fitted"]

FloatArray = NDArray[np.float64]
ValueStd = tuple[float, float]

TAPE_STD = 0.005
# Blur, threshold and shading move an outline as a whole by about a tenth of a pixel
OUTLINE_STD_PX = 0.1
# What refocusing and another crop do to a lens calibrated on another day: log f, share of the
# width, share of the width, k1, k2
LENS_STD = (0.005, 0.002, 0.002, 0.01, 0.01)
# A ball nearer to the camera than to the wall is not what a measurement against a wall looks like
FAR_OUT = 0.5
LEAST_SHARE = 1e-3
DEPTH, LOG_DISTANCE = 11, 5
SHORT_NAMES = {
    "ball plane offset by tape": "tape",
    "camera distance by tape": "tape",
    "ball diameter": "apparent diameter",
    "free fall": "free fall",
    "ball plane guessed": "guess",
    "grid lines": "wall grid",
    "lens not known beforehand": "wall grid",
    "lens calibration": "lens",
}


@dataclass(frozen=True)
class Estimate:
    """A length, its standard uncertainty (m), and the input that tells it best."""

    value: float
    std: float
    source: str


@dataclass(frozen=True, eq=False)
class Input:
    """One independent way in which the calibration may be wrong.

    Attributes
    ----------
    name : str
        The input it comes from, in words.
    step : (12,) array
        How the parameters move with one standard uncertainty of it.
    """

    name: str
    step: FloatArray


@dataclass(frozen=True, eq=False)
class SceneCalibration:
    """Pixels to metres, with everything that may be wrong about it.

    World frame: x right along the wall, y up, z out of the wall, metres; x = y = 0 is the origin of
    the grid's wall coordinates, the same for every shifted calibration.

    Attributes
    ----------
    fit : Calibration
        The fitted camera with its covariance by source.
    grid : WallGrid
        The grid it was fitted to.
    evidence : Evidence
        What else it was fitted to.
    lens : LensPrior or None
        Lens known beforehand.
    ball_plane_offset : Estimate
        Ball plane in front of the wall.
    camera_distance : Estimate
        Camera in front of the wall, along the wall's normal.
    inputs : tuple of Input
        Independent shifts; their outer products add up to what matters of the fit's covariance.
    reprojection_rms_px : float
        Root mean square distance of the grid's measured crossings from the fitted camera's, px.
    warnings : tuple of str
        What the user should know, in whole sentences.
    """

    fit: Calibration
    grid: WallGrid
    evidence: Evidence
    lens: LensPrior | None
    ball_plane_offset: Estimate
    camera_distance: Estimate
    inputs: tuple[Input, ...]
    reprojection_rms_px: float
    warnings: tuple[str, ...]

    @property
    def camera(self) -> Camera:
        """The camera in the grid's frame."""
        return self.fit.grid_camera

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the independent inputs, in the order of `shifted`."""
        return tuple(item.name for item in self.inputs)

    def shifted(self, index: int, sigmas: float) -> Self:
        """The calibration with input `names[index]` moved by so many standard uncertainties."""
        moved = self.fit.with_parameters(self.fit.vector + sigmas * self.inputs[index].step)
        return replace(
            self,
            fit=moved,
            ball_plane_offset=replace(self.ball_plane_offset, value=moved.ball_plane_offset),
            camera_distance=replace(self.camera_distance, value=moved.camera_distance),
        )

    def on_wall(self, px: ArrayLike) -> FloatArray:
        """Reading on the wall behind pixels (..., 2): x, y (..., 2), m."""
        return self.camera.to_plane(px, 0.0)

    def on_ball_plane(self, outline_px: ArrayLike, radius_m: float) -> FloatArray:
        """Centre of the ball from the centroid of its outline.

        Parameters
        ----------
        outline_px : (..., 2) array
        radius_m : float
            Radius of the ball, m; 0 for a point.

        Returns
        -------
        (..., 2) array
            x, y on the ball plane, m.
        """
        if radius_m == 0.0:
            return self.camera.to_plane(outline_px, self.fit.ball_plane_offset)
        return self.camera.sphere_on_plane(outline_px, radius_m, self.fit.ball_plane_offset)

    def ball_centre_px(self, outline_px: ArrayLike, radius_m: float) -> FloatArray:
        """Projection of the ball's centre (..., 2), px, from its outline's centroid (..., 2)."""
        xy = self.on_ball_plane(outline_px, radius_m)
        depth = np.full((*xy.shape[:-1], 1), self.fit.ball_plane_offset)
        return self.camera.project(np.concatenate([xy, depth], axis=-1))

    def jacobian(self, px: ArrayLike) -> FloatArray:
        """Derivative of x, y on the ball plane by the pixel, (..., 2, 2), m/px."""
        px = np.asarray(px, dtype=np.float64)
        depth = self.fit.ball_plane_offset
        columns = [
            self.camera.to_plane(px + 0.5 * e, depth) - self.camera.to_plane(px - 0.5 * e, depth)
            for e in np.eye(2)
        ]
        return np.stack(columns, axis=-1)


def calibrate(
    grid: WallGrid,
    size: tuple[int, int],
    *,
    distance: ValueStd | None = None,
    ball_plane_offset: ValueStd | None = None,
    foot: tuple[ValueStd | None, ValueStd | None] | None = None,
    rest_px: ArrayLike | None = None,
    rest_height: float | None = None,
    lens: Lens | LensPrior | None = None,
    ball_diameter: ValueStd | None = None,
    ball_outline: tuple[FloatArray, FloatArray, FloatArray] | None = None,
) -> SceneCalibration:
    """Fit camera, lens and ball plane to the grid and to whatever else is known.

    Parameters
    ----------
    grid : WallGrid
        The grid on the wall.
    size : tuple of int
        Width and height of the clip's picture, px; the grid must come from a picture of that size.
    distance : (value, std), optional
        Camera to wall by tape, m.
    ball_plane_offset : (value, std), optional
        Ball plane to wall by tape, m.
    foot : (x, y), each (value, std) or None, optional
        Foot of the optical axis on the wall, right of the ball at rest and above the floor, m. Used
        where `rest_px` is given; its y needs `rest_height` too.
    rest_px : (2,) array, optional
        Outline centre of the ball at rest, px.
    rest_height : float, optional
        Height of the ball's centre at rest above the floor, m.
    lens : Lens or LensPrior, optional
        Lens known beforehand.
    ball_diameter : (value, std), optional
        Diameter of the ball, m.
    ball_outline : (px (N, 2), radius_px (N,), radius_std_px (N,)), optional
        Outlines of the ball; they tell its distance where its diameter is known.

    Returns
    -------
    SceneCalibration

    Raises
    ------
    CalibrationError
        If no camera fits the grid, or the inputs put the ball behind the wall or the camera.
    """
    if tuple(size) != tuple(grid.size):
        raise CalibrationError(
            f"the grid is from a picture of {grid.size[0]}×{grid.size[1]} px, the clip has "
            f"{size[0]}×{size[1]} px",
            hint="Find the grid in a picture of the clip itself.",
        )
    outlines = None
    if ball_diameter is not None and ball_outline is not None:
        outlines = BallOutlines(*ball_outline, Known(*ball_diameter), OUTLINE_STD_PX)
    foot_x, foot_y = (None, None) if foot is None or rest_px is None else foot
    evidence = Evidence(
        rest_px=None if rest_px is None else np.asarray(rest_px, dtype=np.float64),
        rest_height=rest_height or 0.0,
        ball_radius=None if ball_diameter is None else 0.5 * ball_diameter[0],
        camera_distance=_known(distance),
        axis_foot_x=_known(foot_x),
        axis_foot_y=None if rest_height is None else _known(foot_y),
        ball_plane_offset=_known(ball_plane_offset),
        outlines=outlines,
    )
    return fitted(grid, evidence, _lens_prior(lens))


def fitted(grid: WallGrid, evidence: Evidence, lens: LensPrior | None) -> SceneCalibration:
    """Fit the scene and split its covariance into independent inputs.

    Parameters
    ----------
    grid : WallGrid
        The grid on the wall.
    evidence : Evidence
        Whatever else is known.
    lens : LensPrior or None
        Lens known beforehand.

    Raises
    ------
    CalibrationError
        If no camera fits the grid, or the ball plane is behind the wall or behind the camera.
    """
    fit = replace(fit_scene(grid, evidence, lens=lens), rest_px=None, rest_xy=None)
    std = np.sqrt(np.diag(fit.covariance))
    depth, distance = fit.ball_plane_offset, fit.camera_distance
    if not -2.0 * std[DEPTH] < depth < distance:
        raise CalibrationError(
            f"the ball plane would be {depth:.2f} ± {std[DEPTH]:.2f} m in front of the wall and "
            f"the camera {distance:.2f} m: no such scene",
            hint="Likeliest wrong: the pitch of the grid, or the diameter of the ball.",
        )
    warnings = fit.warnings
    if depth - 2.0 * std[DEPTH] > FAR_OUT * distance:
        warnings += (
            f"the ball plane comes out {depth:.2f} m in front of the wall, "
            f"{distance - depth:.2f} m from the camera: check the pitch of the grid and the "
            "diameter of the ball",
        )
    wall = np.c_[grid.wall_m, np.zeros(len(grid.nodes))]
    error = fit.grid_camera.project(wall) - grid.points_px
    return SceneCalibration(
        fit=fit,
        grid=grid,
        evidence=evidence,
        lens=lens,
        ball_plane_offset=Estimate(depth, float(std[DEPTH]), _best_source(fit, DEPTH)),
        camera_distance=Estimate(
            distance, float(distance * std[LOG_DISTANCE]), _best_source(fit, LOG_DISTANCE)
        ),
        inputs=_inputs(fit),
        reprojection_rms_px=float(np.sqrt((error**2).sum(axis=1).mean())),
        warnings=warnings,
    )


def _known(pair: ValueStd | None) -> Known | None:
    return None if pair is None else Known(pair[0], pair[1] if pair[1] > 0.0 else TAPE_STD)


def _lens_prior(lens: Lens | LensPrior | None) -> LensPrior | None:
    if not isinstance(lens, Lens):
        return lens
    return LensPrior(lens, np.array(LENS_STD) * [1.0, lens.width, lens.width, 1.0, 1.0])


def _best_source(fit: Calibration, index: int) -> str:
    """The input that tells a parameter best.

    With weights w and covariances S, an input's share of the variance is proportional to its
    weight: the largest share belongs to the most telling input.
    """
    best = max(fit.sources, key=lambda s: float(s.covariance[index, index]))
    return SHORT_NAMES.get(best.name, best.name)


def _inputs(fit: Calibration) -> tuple[Input, ...]:
    """Independent shifts, ordered within each source by what they do to positions.

    A common shift of all positions is no concern: lengths are reckoned from the ball at rest.
    """
    lens = fit.lens
    columns = np.linspace(0.1, 0.9, 5) * (lens.width - 1)
    rows = np.linspace(0.1, 0.9, 4) * (lens.height - 1)
    px = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)

    def readings(c: Calibration) -> FloatArray:
        planes = [c.grid_camera.to_plane(px, z) for z in (0.0, c.ball_plane_offset)]
        return np.concatenate([xy - xy.mean(axis=0) for xy in planes]).ravel()

    slope = fit.gradient(readings)
    total = float(np.trace(slope @ fit.covariance @ slope.T))
    inputs: list[Input] = []
    for source in fit.sources:
        value, axis = np.linalg.eigh(source.covariance)
        root = axis * np.sqrt(np.maximum(value, 0.0))
        _, effect, turn = np.linalg.svd(slope @ root, full_matrices=False)
        kept = [k for k in range(len(effect)) if effect[k] ** 2 > LEAST_SHARE * total]
        for rank, k in enumerate(kept):
            name = source.name if rank == 0 else f"{source.name} ({rank + 1})"
            inputs.append(Input(name, np.asarray(root @ turn[k])))
    return tuple(inputs)
