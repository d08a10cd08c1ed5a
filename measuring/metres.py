"""Calibration of a clip, and tracks in metres in the ball plane."""

import math
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.calibration import (
    RADIUS_COMMON_OVER_RANDOM,
    BallOutlines,
    Calibration,
    Evidence,
    Known,
)
from calib.grid import find_wall_grid
from calib.lens import LensPrior, read_lens
from calib.solve import FOCAL_OVER_WIDTH, LOG_FOCAL_STD, Solved, solve
from measuring.inputs import Inputs
from metrology import Defaults, NotFoundError
from metrology.kept import KeptResults
from metrology.least_squares import minimise
from vision.ball.outline import RADIUS_STD_PX
from vision.ball.refine import MODEL_STD_PX
from vision.tracks import PendulumTrack, Track, Tracks, find_rest

__all__ = [
    "ARM_RELATIVE_STD",
    "MAX_ESTIMATE_DIFFERENCE",
    "SLANT_STD",
    "AssumedLens",
    "BallScale",
    "CameraMapping",
    "MetricTracks",
    "arm_along_bar",
    "assumed_lens",
    "ball_scale",
    "calibrate_clip",
    "centre_of_arc",
    "radius_relative_std",
    "scene_evidence",
    "stated_evidence",
    "to_length",
    "tracks_in_metres",
]

FloatArray = NDArray[np.float64]

_FACE_EDGE_STD_PX = 0.10
"""px, error of the mass's track between its observed face and the point of contact (fitted: the
face offset at the true contact has an std of 0.12 px over ray-traced clips of another renderer and
0.10 px over own ones, 208 to 640 px wide; 0.08 px of it comes from the fit of the rims)."""

REST_STD_PX = 0.1
"""px, common error of the outline of a ball at rest from support, shadow and one-sided light
(fitted: rms 0.13 px per axis over 13 clips of another renderer, 0.10 px over 8 own ones, where
frames state 0.08)."""

MAX_BEND_FRACTION = 0.003
"""Of the length: maximum bend of a straight line (chosen: lines bent more are not mapped by the
pinhole scale)."""

ARM_RELATIVE_STD = 0.05
"""Relative std of the observed arm in the ball plane (fitted: path-traced scenes)."""

MAX_ESTIMATE_DIFFERENCE = 3.0
"""Standard deviations between two estimates beyond which one of them is wrong (convention)."""

SLANT_STD = 0.03
"""Std of the slope of the line of sight to the face, with a calibrated camera (chosen)."""

_MIN_FORESHORTENING = 0.2
"""Minimum foreshortening (chosen: an obliquity of 80°)."""

_INDEPENDENT_RADII = 8.0
"""Number of independent errors of the radius in a flight (chosen: the ball's appearance and light
change slowly)."""

MAX_REST_SPEED_FRACTION = 0.25
"""Of the median speed after the strike: maximum speed of a ball at rest (chosen)."""


class PlaneMapping(Protocol):
    """Mapping from pixels to metres in the ball plane."""

    def ball(self, px: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Ball centres (N, 2) and covariances (N, 2, 2) from those of the outlines."""

    def point(self, px: FloatArray) -> FloatArray:
        """Points (..., 2) of the ball plane behind pixels."""

    def across(self, px: FloatArray, radius_px: FloatArray) -> float:
        """Radius of a ball, m, from outline centres (N, 2) and radii (N,), px."""

    def eye(self) -> FloatArray | None:
        """Position of the camera: x, y and distance from the ball plane; None if unknown."""

    def slope_std(self, slope: float) -> float:
        """Std of the slope of a line of sight across the plane."""

    @property
    def scaled_by_wall(self) -> bool:
        """Whether the scale comes from a calibrated wall."""


@dataclass(frozen=True)
class CameraMapping:
    """Mapping by the calibrated camera."""

    calibration: Calibration

    def ball(self, px: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Ball centres and covariances."""
        return self.calibration.position(px, covariance)

    def point(self, px: FloatArray) -> FloatArray:
        """Points of the ball plane behind pixels."""
        c = self.calibration
        return np.asarray(c.grid_camera.to_plane(px, c.ball_plane_offset) + c.origin)

    def across(self, px: FloatArray, radius_px: FloatArray) -> float:
        """Radius of a ball, m, from outline centres (N, 2) and radii (N,), px."""
        guess = _min_radius_in_plane(self, np.median(px, axis=0), float(np.median(radius_px)))
        return guess * float(np.median(radius_px / self.calibration.outline_radius(px, guess)))

    def eye(self) -> FloatArray:
        """Position of the camera: x, y and distance from the ball plane."""
        c = self.calibration
        x, y = c.grid_camera.position[:2] + c.origin[:2]
        return np.array([x, y, c.camera_distance - c.ball_plane_offset])

    def slope_std(self, slope: float) -> float:
        """Std of the slope of a line of sight across the plane."""
        return SLANT_STD

    @property
    def scaled_by_wall(self) -> bool:
        """True: the scale comes from a calibrated wall."""
        return True


@dataclass(frozen=True)
class AssumedLens:
    """Assumed lens of a camera without a lens file.

    Attributes
    ----------
    middle_px : (2,) array
        Centre of the picture.
    focal_px : float
        Typical focal length for the picture's width, with a relative std of `LOG_FOCAL_STD`.
    slant_std_rad : float
        Std of the camera's slant from square to the plane.
    """

    middle_px: FloatArray
    focal_px: float
    slant_std_rad: float

    def across(self, px: FloatArray, radius_px: FloatArray) -> FloatArray:
        """Radii (N,) normal to the line from the centre, from outline centres (N, 2) and radii.

        Off the axis a sphere's image is elongated; its width is that of an object in its plane.
        """
        off_axis = np.hypot(*(px - self.middle_px).T) / self.focal_px
        return np.asarray(radius_px * 2.0 / (1.0 + np.hypot(1.0, off_axis)))

    def centres(self, px: FloatArray, across_px: float) -> FloatArray:
        """Image points of the centres of spheres with outlines centred on pixels (N, 2).

        A sphere of half angle α at θ off the axis is imaged from tan(θ - α) to tan(θ + α), centred
        on tan θ (1 + tan² α / cos² θ), up to α⁴.
        """
        further = 1.0 + (across_px / self.focal_px) ** 2
        return np.asarray(self.middle_px + (px - self.middle_px) / further)

    def foreshortening(self, px: FloatArray, slant_rad: float) -> float:
        """Foreshortening of lengths along the rows at a point of a slanted plane."""
        off_axis = float(px[0] - self.middle_px[0]) / self.focal_px
        left = math.cos(slant_rad) - off_axis * math.sin(slant_rad)
        return max(left, _MIN_FORESHORTENING)


@dataclass(frozen=True)
class BallScale:
    """Mapping by the ball's own size, for a camera nearly square to the plane of flight.

    Attributes
    ----------
    metres_per_px : float
        Scale in the ball plane at the typical position.
    rest_px : (2,) array
        Origin, x = y = 0.
    usual_px : (2,) array
        Typical position of the ball.
    roll_rad : float
        Roll of the camera.
    growth_per_px : float
        Relative change of scale along the picture's rows due to slant.
    foreshortening : float
        Foreshortening of lengths along the rows due to slant.
    lens : AssumedLens or None
        Gives the approximate position of the camera.
    across_px : float
        Radius of the ball's outline, normal to the line from the centre of the picture.
    """

    metres_per_px: float
    rest_px: FloatArray
    usual_px: FloatArray
    roll_rad: float = 0.0
    growth_per_px: float = 0.0
    foreshortening: float = 1.0
    lens: AssumedLens | None = None
    across_px: float = 0.0

    def ball(self, px: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Ball centres and covariances."""
        centre = px if self.lens is None else self.lens.centres(px, self.across_px)
        return self.point(centre), covariance * self.metres_per_px**2

    def point(self, px: FloatArray) -> FloatArray:
        """Points of the ball plane behind pixels."""
        grown, rest = self._grown(px), self._grown(self.rest_px)
        cosine, sine = np.cos(self.roll_rad), np.sin(self.roll_rad)
        turned = (grown - rest) @ np.array([[cosine, -sine], [-sine, -cosine]])
        return np.asarray(turned * self.metres_per_px)

    def _grown(self, px: FloatArray) -> FloatArray:
        """Pixels corrected for slant, relative to the typical position.

        Level lines of a slanted plane meet on the horizon, the middle row of a camera without tilt.
        """
        x = px[..., 0] - self.usual_px[0]
        horizon = self.usual_px[1] if self.lens is None else self.lens.middle_px[1]
        further = 1.0 / np.maximum(1.0 - self.growth_per_px * x, _MIN_FORESHORTENING)
        seen = np.stack([x / self.foreshortening, px[..., 1] - horizon], axis=-1)
        return np.asarray(seen * further[..., np.newaxis])

    def across(self, px: FloatArray, radius_px: FloatArray) -> float:
        """Radius of a ball, m, from outline centres (N, 2) and radii (N,), px."""
        wide = radius_px if self.lens is None else self.lens.across(px, radius_px)
        return _min_radius_in_plane(self, np.median(px, axis=0), float(np.median(wide)))

    def eye(self) -> FloatArray | None:
        """Position of the camera from its slant and lens."""
        if self.lens is None:
            return None
        off_axis = float(self.usual_px[0] - self.lens.middle_px[0]) / self.lens.focal_px
        sine = self.growth_per_px * self.foreshortening * self.lens.focal_px
        cosine = self.foreshortening + off_axis * sine
        away = self.lens.focal_px * self.metres_per_px
        level = self.point(np.array([self.usual_px[0], self.lens.middle_px[1]]))
        along = np.array([np.cos(self.roll_rad), -np.sin(self.roll_rad)])
        foot = level - away * (off_axis * cosine + sine) * along
        return np.asarray(np.append(foot, away * self.foreshortening))

    def slope_std(self, slope: float) -> float:
        """Std of the slope of a line of sight across the plane."""
        if self.lens is None:
            return SLANT_STD
        aslant = math.tan(min(self.lens.slant_std_rad, 1.0))
        return float(np.linalg.norm([SLANT_STD, LOG_FOCAL_STD * slope, aslant]))

    @property
    def scaled_by_wall(self) -> bool:
        """False: the scale comes from the ball or is given."""
        return False


def ball_scale(
    tracks: Tracks,
    lens: AssumedLens,
    diameter: float,
    *,
    metres_per_px: float | None = None,
    stretched: float = 1.0,
    roll_rad: float = 0.0,
    slant_rad: float = 0.0,
) -> BallScale:
    """Mapping of the plane of motion, scaled to the ball's diameter.

    Parameters
    ----------
    tracks : Tracks
        In pixels.
    diameter : float
        Of the ball, m.
    metres_per_px : float, optional
        Scale at the typical position, if given.
    stretched : float
        Factor on lengths.
    roll_rad, slant_rad : float
        Rotation of the camera about its axis, and about the vertical.
    """
    ball, still = tracks.ball, slice(None)
    if tracks.rest_frames is not None:
        first, last = tracks.rest_frames
        first_row, end_row = np.searchsorted(ball.frame, [first, last + 1])
        still = slice(first_row, max(end_row, first_row + 1))
    across = float(np.median(lens.across(ball.centre_px, ball.radius_px)))
    if metres_per_px is None:
        metres_per_px = diameter / (2 * across)
    usual = np.median(ball.centre_px, axis=0)
    shortened = lens.foreshortening(usual, slant_rad)
    return BallScale(
        stretched * metres_per_px,
        np.median(lens.centres(ball.centre_px[still], across), axis=0),
        usual,
        roll_rad,
        math.sin(slant_rad) / (shortened * lens.focal_px),
        shortened,
        lens,
        across,
    )


@dataclass(frozen=True)
class MetricTracks:
    """Input of the fits: ball plane, m, x along the flight, y up, s.

    Attributes
    ----------
    ball_frame, ball_time_s, ball_m, ball_cov_m2 : arrays
        Per frame: (N,), (N,), (N, 2), (N, 2, 2).
    rest_m, rest_std_m : (2,) arrays
        Ball at rest.
    pivot_m : (2,) array or None
        Pivot; None without a pendulum.
    swing_time_s, swing_rad, swing_std_rad : (M,) arrays
        Pendulum angle, 0 straight down, positive forward.
    edge_offset_m, edge_offset_std_m : float
        Lead of the mass's foremost edge over the bar's line.
    middle_offset_m, middle_offset_std_m : float
        Middle of the face between its two rims; infinite std if they are not resolved.
    bob_arm_m : float or None
        Pivot to the centre of a round bob; None if the mass has a flat face.
    face_slant : float or None
        Slope of the line of sight to the face along the flight: shift of the foremost edge per
        thickness in front of or behind the ball plane. Negative if the camera sees the face.
    eye_m : (3,) array or None
        Position of the camera: x, y and distance from the ball plane; None if unknown.
    radius_m : float
        Observed radius of the ball.
    direction : float
        +1 if the ball flies to the right in the picture, −1 to the left.
    face_slant_std : float
        Std of that slope.
    landing : (2,) tuple of array or None
        Stated place of the ball's centre at landing, m, and its covariance (2, 2).
    scaled_by_wall : bool
        Whether the scale comes from a calibrated wall.
    """

    ball_frame: NDArray[np.int64]
    ball_time_s: FloatArray
    ball_m: FloatArray
    ball_cov_m2: FloatArray
    rest_m: FloatArray
    rest_std_m: FloatArray
    pivot_m: FloatArray | None
    swing_time_s: FloatArray
    swing_rad: FloatArray
    swing_std_rad: FloatArray
    edge_offset_m: float
    edge_offset_std_m: float
    middle_offset_m: float
    middle_offset_std_m: float
    bob_arm_m: float | None
    face_slant: float | None
    eye_m: FloatArray | None
    radius_m: float
    direction: float
    face_slant_std: float = SLANT_STD
    scaled_by_wall: bool = True
    landing: tuple[FloatArray, FloatArray] | None = None

    @property
    def spherical(self) -> bool:
        """Whether a round bob strikes, which has no thickness in front of the ball plane."""
        return self.bob_arm_m is not None


def flight_direction(tracks: Tracks) -> float:
    """+1 if the ball flies to the right in the picture, −1 to the left."""
    x = tracks.ball.centre_px[:, 0]
    return 1.0 if x[-1] >= x[0] else -1.0


def tracks_in_metres(
    tracks: Tracks,
    mapping: PlaneMapping,
    time_s: FloatArray,
    zero_rad: float = 0.0,
    pivot_moved_px: tuple[float, float] = (0.0, 0.0),
    length: tuple[float, float] | None = None,
) -> MetricTracks:
    """Map tracks to the ball plane.

    Parameters
    ----------
    tracks : Tracks
        In pixels.
    mapping : PlaneMapping
        Pixels to metres.
    time_s : (F,) array
        Mid-exposure time of every frame of the clip, s.
    zero_rad : float
        Added to all angles of the pendulum, rad.
    pivot_moved_px : (2,) tuple of float
        Added to the pivot in the picture.
    length : (2,) tuple of float, optional
        Given distance of the point of contact from the pivot, m, and its relative std.

    Raises
    ------
    NotFoundError
        If the ball is never at rest before it is struck.
    """
    first, last = _rest_frames(tracks)
    direction = flight_direction(tracks)
    flip = np.array([direction, 1.0])
    ball, pendulum = tracks.ball, tracks.pendulum
    position, covariance = mapping.ball(ball.centre_px, ball.covariance_px2)
    rest, rest_std = _at_rest(position, covariance, (ball.frame >= first) & (ball.frame <= last))
    moved = np.array(pivot_moved_px)
    swing = _swing(pendulum, mapping, direction, zero_rad, moved)
    if pendulum is not None and length is not None:
        # what the picture leaves open of the pivot, the given length and the angles say together
        further = _left_open(swing, pendulum, rest * flip, last, length)
        swing = _swing(pendulum, mapping, direction, zero_rad, moved, further)
    radius = mapping.across(ball.centre_px, ball.radius_px)
    eye = mapping.eye()
    eye = None if eye is None else eye * np.append(flip, 1.0)
    slope = None if eye is None else float((rest[0] * direction - radius - eye[0]) / eye[2])
    return MetricTracks(
        ball_frame=ball.frame,
        ball_time_s=time_s[ball.frame],
        ball_m=position * flip,
        ball_cov_m2=covariance * np.outer(flip, flip),
        rest_m=rest * flip,
        rest_std_m=np.hypot(rest_std, REST_STD_PX * (radius / float(np.median(ball.radius_px)))),
        pivot_m=swing.pivot,
        swing_time_s=np.zeros(0) if pendulum is None else time_s[pendulum.track.frame],
        swing_rad=swing.angle,
        swing_std_rad=swing.angle_std,
        edge_offset_m=swing.edge[0],
        edge_offset_std_m=swing.edge[1],
        middle_offset_m=swing.middle[0],
        middle_offset_std_m=swing.middle[1],
        bob_arm_m=swing.arm if pendulum is not None and pendulum.face.spherical else None,
        face_slant=slope,
        eye_m=eye,
        radius_m=radius,
        direction=direction,
        face_slant_std=SLANT_STD if slope is None else mapping.slope_std(slope),
        scaled_by_wall=mapping.scaled_by_wall,
        landing=_stated_landing(tracks.landing_px, mapping, flip),
    )


def _at_rest(
    position: FloatArray, covariance: FloatArray, still: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Median position of rest, and its std; errors common to the frames do not average out."""
    std = np.sqrt(np.diagonal(covariance[still], axis1=1, axis2=2)).mean(axis=0)
    residual_std = position[still].std(axis=0) if still.sum() > 3 else std
    return np.median(position[still], axis=0), np.maximum(std, residual_std)


STATED_STD_PX = 1.0
"""Std of a point that a person places, px (chosen: as well as a point is seen and placed)."""


def _stated_landing(
    landing_px: FloatArray | None, mapping: PlaneMapping, flip: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    if landing_px is None:
        return None
    place, spread = mapping.ball(landing_px[np.newaxis], STATED_STD_PX**2 * np.eye(2)[np.newaxis])
    return place[0] * flip, spread[0] * np.outer(flip, flip)


def _rest_frames(tracks: Tracks) -> tuple[int, int]:
    """First and last frame of the ball's rest."""
    if tracks.rest_frames is None:
        raise NotFoundError(
            "the ball is never at rest in the clip, so there is no strike to measure"
            + _backwards(tracks.ball),
            hint="Start the clip before the ball is struck, or point at the ball with --ball-at.",
        )
    first, last = tracks.rest_frames
    still = (tracks.ball.frame >= first) & (tracks.ball.frame <= last)
    if not still.any():
        raise NotFoundError(
            "the ball is not clearly visible while at rest",
            hint="Point at it with --ball-at X,Y, or film against a contrasting background.",
        )
    if _moves_at_rest(tracks.ball, still):
        raise NotFoundError(
            "the tracked object moves from the first frame on, so there is no strike to measure"
            + _backwards(tracks.ball),
            hint="Start the clip before the ball is struck, or point at the ball with --ball-at.",
        )
    return first, last


def _backwards(ball: Track) -> str:
    """A hint where a ball comes to the rest from which it starts in a clip played in reverse."""
    turned = replace(
        ball,
        frame=ball.frame[-1] - ball.frame[::-1],
        centre_px=ball.centre_px[::-1],
        covariance_px2=ball.covariance_px2[::-1],
    )
    rest = find_rest(turned.frame, turned.centre_px, float(np.median(ball.radius_px)))
    if rest is None or rest.last < MIN_END_FRAMES:
        return ""
    if _moves_at_rest(turned, turned.frame <= rest.last):
        return ""
    return ": it ends at rest, as in a clip that is played in reverse; turn such a clip round"


MIN_END_FRAMES = 4
"""Frames of a rest at the end (derived: two medians of its thirds, and one between)."""


def _moves_at_rest(ball: Track, still: NDArray[np.bool_]) -> bool:
    """Whether the ball moves during its assumed rest: a pendulum, or a ball in flight."""
    if not still.any() or still.all():
        return False
    step = np.hypot(*(np.diff(ball.centre_px, axis=0) / np.diff(ball.frame)[:, np.newaxis]).T)
    if still.sum() == 1:
        # alone, the first frame shows rest only if the ball leaves it more slowly than it goes on
        return bool(still[0]) and float(step[0]) > MAX_REST_SPEED_FRACTION * float(np.median(step))
    resting = still[1:] & still[:-1]
    if not resting.any() or resting.all():
        return False
    # what moves gets on: steps to and fro are noise, however large
    place, frame = ball.centre_px[still], ball.frame[still]
    third = max(len(place) // 3, 1)
    ends = [np.median(rows, axis=0) for rows in (place[:third], place[-third:])]
    elapsed = float(np.mean(frame[-third:]) - np.mean(frame[:third]))
    gone = float(np.hypot(*(ends[1] - ends[0])))
    noise = float(np.sqrt(np.median(np.trace(ball.covariance_px2, axis1=1, axis2=2))))
    speed = gone / max(elapsed, 1.0)
    return speed > MAX_REST_SPEED_FRACTION * float(np.median(step[~resting])) and gone > 3.0 * noise


def radius_relative_std(ball: Track) -> float:
    """Relative std of the common error of a ball's radii.

    Where the outline is less clear, its biases (a dark ball's reflections, blur, an unknown
    transfer curve) increase likewise: see `BallOutlines.followed`.
    """
    random = float(np.median(ball.radius_std_px))
    unclean = math.sqrt(max(random**2 - MODEL_STD_PX**2, 0.0))
    common = math.hypot(RADIUS_STD_PX, RADIUS_COMMON_OVER_RANDOM * unclean)
    return common / float(np.median(ball.radius_px))


def assumed_lens(ball: Track, shape: tuple[int, int]) -> AssumedLens:
    """Assumed lens, and the slant of a camera set up by eye.

    The ball appears smaller where a slanted plane is farther away. If its size changes more along
    the rows than a typical slant explains, the std of the slant is increased.

    Parameters
    ----------
    ball : Track
        The ball, px.
    shape : (2,) tuple of int
        Height and width of the picture, px.
    """
    height, width = shape
    focal = FOCAL_OVER_WIDTH * width
    middle = 0.5 * np.array([width - 1.0, height - 1.0])
    offset = (ball.centre_px - middle) / focal
    usual = AssumedLens(middle, focal, Defaults.CAMERA_SLANT.std)
    radius = usual.across(ball.centre_px, ball.radius_px)
    spread = float(offset[:, 0].std())
    if not ball.sized or len(radius) < _INDEPENDENT_RADII or spread == 0.0:
        return usual
    design = np.column_stack([offset[:, 0], np.ones(len(radius))])
    std = np.hypot(ball.radius_std_px, MODEL_STD_PX) / radius
    fitted = minimise(
        lambda line: (np.log(radius) - line @ design.T) / std,
        np.array([0.0, math.log(float(np.median(radius)))]),
        soft_from=1.0,
        stacked=True,
    )
    left = (np.log(radius) - design @ fitted.values) / std
    residual_std = max(1.0, float(np.median(np.abs(left))) / 0.6745)
    off = residual_std * float(np.median(std)) / (spread * math.sqrt(_INDEPENDENT_RADII))
    # off the axis a slanted plane is foreshortened, which changes its growth accordingly
    growth = -float(fitted.values[0])
    slant = math.atan(growth / max(1.0 + growth * float(offset[:, 0].mean()), _MIN_FORESHORTENING))
    excess = slant**2 - math.atan(off) ** 2
    return replace(usual, slant_std_rad=math.sqrt(max(usual.slant_std_rad**2, excess)))


def _min_radius_in_plane(mapping: PlaneMapping, px: FloatArray, radius_px: float) -> float:
    """Minimum length in the ball plane of a radius in pixels over all directions, m.

    A slanted camera stretches the plane in one direction; a ball has the same size from anywhere.
    """
    radius_vectors = radius_px * np.eye(2)
    across = 0.5 * (mapping.point(px + radius_vectors) - mapping.point(px - radius_vectors))
    return float(np.linalg.svd(across, compute_uv=False)[-1])


@dataclass(frozen=True)
class _SwingInMetres:
    """Pivot and arm, m; angles, rad; offsets of edge and middle of the face with std, m."""

    pivot: FloatArray | None
    arm: float
    angle: FloatArray
    angle_std: FloatArray
    edge: tuple[float, float]
    middle: tuple[float, float]


def _swing(
    pendulum: PendulumTrack | None,
    mapping: PlaneMapping,
    direction: float,
    zero_rad: float,
    pivot_moved_px: FloatArray,
    further_m: FloatArray | float = 0.0,
) -> _SwingInMetres:
    if pendulum is None:
        return _SwingInMetres(None, 0.0, np.zeros(0), np.zeros(0), (0.0, 1.0), (0.0, math.inf))
    flip = np.array([direction, 1.0])
    mass = mapping.point(pendulum.track.centre_px) * flip
    pivot = mapping.point(pendulum.pivot_px) * flip
    moved = mapping.point(pendulum.pivot_px + pivot_moved_px) * flip - pivot
    if pendulum.seen_pivot is None and _bends(mapping, pendulum.pivot_px, pendulum.track.centre_px):
        # a lens that bends lines distorts the arc: its centre is fitted in metres
        pivot = centre_of_arc(mass)
    pivot = pivot + moved + further_m
    arm = mass - pivot
    angle = np.arctan2(arm[:, 0], -arm[:, 1]) + zero_rad
    length = float(np.median(np.hypot(*arm.T)))
    scale = length / pendulum.arm_px
    face = pendulum.face
    phi = float(angle[np.argmin(np.abs(pendulum.track.frame - face.frame))])
    normal = np.array([np.cos(phi), np.sin(phi)])

    def ahead_of_line(point_px: FloatArray | None, std_px: float) -> tuple[float, float]:
        if point_px is None:
            return 0.0, math.inf
        ahead = float((mapping.point(point_px) * flip - pivot) @ normal)
        return ahead, math.hypot(std_px, _FACE_EDGE_STD_PX) * scale

    return _SwingInMetres(
        pivot,
        length,
        angle,
        pendulum.angle_std_rad,
        ahead_of_line(face.edge_px, face.edge_std_px),
        ahead_of_line(face.middle_px, face.middle_std_px),
    )


def arm_along_bar(arm: FloatArray, phi: ArrayLike) -> Any:
    """Distance from the pivot to the point of contact (2,) or (2, L), along the bar, m."""
    return arm[0] * np.sin(phi) - arm[1] * np.cos(phi)


def to_length(
    arm: FloatArray, phi: float, length: float, own_std: float, other_std: float
) -> FloatArray:
    """Displacement of a pivot along the bar towards a given length.

    Parameters
    ----------
    arm : (2,) array
        From the pivot to the ball at rest, m.
    phi : float
        Angle of the bar at contact, rad.
    length : float
        Given distance of the point of contact from the pivot, m.
    own_std, other_std : float
        Relative std of the arm from the pivot, and from everything else.

    Returns
    -------
    (2,) array
        m: the part of the difference that the pivot has in its variance; none where given and
        observed length contradict each other, which is left to the check.
    """
    seen = float(arm_along_bar(arm, phi))
    if seen <= 0.0:
        return np.zeros(2)
    apart, std = math.log(length / seen), math.hypot(own_std, other_std)
    if abs(apart) > MAX_ESTIMATE_DIFFERENCE * std:
        return np.zeros(2)
    further = seen * math.expm1((own_std / std) ** 2 * apart)
    return -further * np.array([math.sin(phi), -math.cos(phi)])


def _left_open(
    swing: _SwingInMetres,
    pendulum: PendulumTrack,
    rest: FloatArray,
    frame: int,
    length: tuple[float, float],
) -> FloatArray:
    """Displacement (2,) of the pivot to the given length as far as its own covariance allows, m.

    A short arc determines its radius poorly, and angles with it.
    """
    assert swing.pivot is not None
    place = int(np.argmin(np.abs(pendulum.track.frame - frame)))
    arm = pendulum.track.centre_px[place] - pendulum.pivot_px
    own_std = math.sqrt(arm @ pendulum.pivot_covariance_px2 @ arm) / float(arm @ arm)
    other_std = math.hypot(ARM_RELATIVE_STD, length[1])
    return to_length(rest - swing.pivot, float(swing.angle[place]), length[0], own_std, other_std)


def _bends(mapping: PlaneMapping, pivot_px: FloatArray, mass_px: FloatArray) -> bool:
    """Whether a straight line of the picture is curved or uneven in metres."""
    ends = mapping.point(np.stack([pivot_px, np.median(mass_px, axis=0)]))
    middle = mapping.point(0.5 * (pivot_px + np.median(mass_px, axis=0)))
    off = float(np.hypot(*(middle - ends.mean(axis=0))))
    return off > MAX_BEND_FRACTION * float(np.hypot(*(ends[1] - ends[0])))


def centre_of_arc(points: FloatArray) -> FloatArray:
    """Centre of the circle through (N, 2) points: algebraic start, then robust geometric fit."""
    middle = points.mean(axis=0)
    near = points - middle
    design = np.column_stack([2 * near, np.ones(len(near))])
    start = np.linalg.lstsq(design, (near**2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(start[2] + start[:2] @ start[:2], 1e-12)))

    def residuals(values: FloatArray) -> FloatArray:
        return np.asarray(np.hypot(*(near - values[:2]).T) - values[2])

    best = minimise(residuals, [*start[:2], radius], soft_from=1e-3)
    return np.asarray(best.values[:2] + middle)


def calibrate_clip(tracks: Tracks, inputs: Inputs, kept: KeptResults | None = None) -> Solved:
    """Find the wall grid, and fit camera and ball plane to all evidence.

    Raises
    ------
    CalibrationError
        If there is no grid, or it contradicts other evidence.
    SetupError
        If the lens file can't be used.
    """
    lens = known_lens(tracks, inputs)
    background, sizes = tracks.background, (inputs.grid_pitch, inputs.fine_pitch)
    grid = (kept or KeptResults()).once(
        "grid",
        (background, sizes),
        lambda: find_wall_grid(background, pitch_m=sizes[0], fine_pitch_m=sizes[1]),
    )
    return solve(grid, scene_evidence(tracks, inputs), lens=lens)


def known_lens(tracks: Tracks, inputs: Inputs) -> LensPrior | None:
    """Lens of the setup file, for the clip's picture size; None if none is named.

    Raises
    ------
    SetupError
        If its file can't be read, or its picture has another aspect ratio than the clip's.
    """
    path = inputs.setup.camera.lens
    if path is None:
        return None
    height, width = tracks.background.shape
    return read_lens(path, width=width, height=height)


def _known(pair: tuple[float, float] | None) -> Known | None:
    return None if pair is None else Known(*pair)


def stated_evidence(inputs: Inputs) -> Evidence:
    """Evidence on the scene that is stated, without a track."""
    camera, wall = inputs.setup.camera, inputs.setup.wall
    evidence = Evidence(
        camera_distance=_known(camera.distance_to_wall),
        ball_plane_offset=_known(wall.ball_plane_offset),
        pitch_relative_std=inputs.rig.grid_pitch.relative_std,
    )
    if inputs.ball is None:
        return evidence
    radius = 0.5 * inputs.ball.diameter
    height = 0.0 if inputs.fall is None else inputs.fall + radius
    return replace(evidence, ball_radius=radius, rest_height=height)


def scene_evidence(tracks: Tracks, inputs: Inputs) -> Evidence:
    """Evidence on the scene other than its grid.

    The foot of the optical axis is measured from the ball at rest and the floor; without these it
    can't be used.
    """
    foot = inputs.setup.camera.principal_point_on_wall
    ball = tracks.ball
    evidence = stated_evidence(inputs)
    if inputs.ball is not None:
        evidence = replace(evidence, outlines=_outlines(ball, tracks, inputs))
    if tracks.rest_frames is not None:
        first, last = tracks.rest_frames
        still = (ball.frame >= first) & (ball.frame <= last)
        if still.any():
            evidence = replace(evidence, rest_px=np.median(ball.centre_px[still], axis=0))
    if foot is not None and evidence.rest_px is not None:
        evidence = replace(evidence, axis_foot_x=_known(foot[0]))
        if inputs.ball is not None and inputs.fall is not None:
            evidence = replace(evidence, axis_foot_y=_known(foot[1]))
    return evidence


def _outlines(ball: Track, tracks: Tracks, inputs: Inputs) -> BallOutlines | None:
    diameter = inputs.rig.ball_diameter
    assert diameter is not None
    after = -1 if tracks.rest_frames is None else tracks.rest_frames[1]
    # the ball is compressed for some hundredths of a second after its rest
    round_again = ball.frame > after + (0.03 / np.median(np.diff(ball.time_s)))
    good = ball.where(round_again & (ball.quality >= np.median(ball.quality) * 0.5))
    if len(good) < 3 or not ball.sized:
        return None
    return BallOutlines.followed(
        good.centre_px, good.radius_px, good.radius_std_px, Known(diameter.value, diameter.std)
    )
