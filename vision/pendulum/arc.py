"""Arcs of a swinging body in the picture, and registration of its appearance.

A circle is fitted to positions by geometric least squares. In an oblique view each circle of a
rotation is an ellipse; all of them share the pivot and the view, a 2 × 2 matrix that is upper
triangular, since a rotation or a scale of the plane of the swing in itself changes nothing.

A rigid body is a layer with an appearance T and an opacity α in coordinates of its own: a frame
shows α·T + (1 − α)·B where it is, with the known scene B behind it, so that grid lines behind its
edge pull nothing. Shift and rotation are fitted by Gauss–Newton.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology.least_squares import minimise
from vision.compiled import CORRELATED_PIXELS, registered

__all__ = [
    "LOOK_PX",
    "Arc",
    "ImagedSwing",
    "Patch",
    "Pose",
    "SwingThrough",
    "disc",
    "fit_arc",
    "fit_imaged_swing",
    "register",
    "sampled",
]

FloatImage = NDArray[np.float32]

FloatArray = NDArray[np.float64]

_ROW = 16384

"""Pixels of a row: OpenCV's remap takes pictures of less than 32,768 in each direction."""


@dataclass(frozen=True)
class Patch:
    """The look of a rigid thing.

    Attributes
    ----------
    x, y : (n,) arrays
        Patch coordinates about its anchor, px.
    look : (n,) array
        Gray level of the thing, in reference brightness.
    opacity : (n,) array
        0 where the background is seen, 1 where the thing is.
    """

    x: FloatArray
    y: FloatArray
    look: FloatArray
    opacity: FloatArray

    @cached_property
    def points(self) -> FloatImage:
        """x, y, look and opacity as compiled loops take them, (4, n); of a large one every k-th."""
        points = np.array([self.x, self.y, self.look, self.opacity], dtype=np.float32)
        if self.each == 1:
            return points
        # at random, so that no edge falls between them
        order = np.random.default_rng(0).permutation(len(self.x))
        return np.ascontiguousarray(points[:, np.sort(order[:: self.each])])

    @property
    def each(self) -> int:
        """One of so many points is compared: sums over them count so many times."""
        return -(-len(self.x) // _MAX_POINTS)


_MAX_POINTS = 6000
"""Points of a thing that are compared with a picture (chosen: a disc of 44 px)."""


@dataclass(frozen=True)
class Pose:
    """Where the patch lies in a frame.

    Attributes
    ----------
    anchor : (2,) array
        Where its anchor is, px.
    turn : float
        Turn in the picture, rad, from +x towards +y.
    covariance : (3, 3) array
        Of anchor x, y (px) and turn (rad).
    rms_residual : float
        Root mean square residual over noise.
    seen : float
        Part of the opaque patch in view and not hidden, 0 to 1.
    """

    anchor: FloatArray
    turn: float
    covariance: FloatArray
    rms_residual: float
    seen: float


def sampled(
    pictures: FloatImage, x: NDArray[Any], y: NDArray[Any], interpolation: int = cv2.INTER_CUBIC
) -> FloatImage:
    """Gray levels of a picture (H, W) or several (H, W, C) at points (n,): (n,) or (n, C).

    OpenCV takes fewer than 32768 points in a row: they are laid out in several.
    """
    count = len(x)
    if count == 0:
        # OpenCV takes no empty maps
        return np.zeros((0, *pictures.shape[2:]), dtype=np.float32)
    rows = -(-count // _ROW)
    maps = np.zeros((2, rows * _ROW if rows > 1 else count), dtype=np.float32)
    maps[0, :count], maps[1, :count] = x, y
    u, v = maps.reshape(2, rows, -1)
    found = cv2.remap(pictures, u, v, interpolation, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found.reshape(-1, *found.shape[2:])[:count])


def register(
    patch: Patch,
    frame: FloatImage,
    background: FloatImage,
    gain: float,
    noise: float,
    start: Pose,
    *,
    turn_std: float,
    hidden: tuple[float, float, float] | None = None,
    anchor_information: FloatArray | None = None,
    iterations: int = 12,
) -> Pose | None:
    """Find the patch in a frame.

    Parameters
    ----------
    patch : Patch
        What to look for.
    frame, background : (H, W) float32 arrays
        The frame, and the static scene in reference brightness.
    gain : float
        Brightness of the frame relative to the scene.
    noise : float
        Standard deviation of a pixel, gray levels.
    start : Pose
        First guess.
    turn_std : float
        How well the guess's turn is known, rad; the fit is held to it that much.
    hidden : tuple of float, optional
        Centre x, y and radius of a disc in which something else may be in front, px.
    anchor_information : (2, 2) array, optional
        Information (1/px²) by which the anchor is held to the guess: across a known arc, say.
    iterations : int
        Steps at most.

    Returns
    -------
    Pose or None
        None where less than a third of it is in view.
    """
    prior = np.zeros((3, 3))
    prior[2, 2] = turn_std**-2
    if anchor_information is not None:
        prior[:2, :2] = anchor_information
    prior /= patch.each
    normal = np.empty((4, 4))
    settled, x, y, turn, scale, rms_residual, seen = registered(
        patch.points,
        np.array([*start.anchor, start.turn]),
        prior,
        np.ascontiguousarray(frame, dtype=np.float32),
        np.ascontiguousarray(background, dtype=np.float32),
        float(gain),
        float(noise),
        disc(hidden),
        iterations,
        normal,
    )
    if not settled:
        return None
    covariance = np.linalg.inv(normal)[:3, :3] * scale**2 * CORRELATED_PIXELS / patch.each
    return Pose(np.array([x, y]), turn, np.asarray(covariance, float), rms_residual, seen)


def disc(hidden: tuple[float, float, float] | None) -> FloatArray:
    """Centre x, y and radius of what may be in front, px; without anything the radius is 0."""
    return np.zeros(3) if hidden is None else np.array(hidden, dtype=np.float64)


_UNTURNED = (1.0, 0.0, 0.0, 1.0)


def _wrapped(angle: FloatArray) -> FloatArray:
    """The same angles between −π and π, rad."""
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))


def _squared(
    offset: FloatArray, shear: FloatArray | float, stretch: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Offsets (..., 2) in the picture of a plane in an oblique view, as in that plane."""
    y = offset[..., 1] / stretch
    return offset[..., 0] - shear * y, y


@dataclass(frozen=True)
class ImagedSwing:
    """Where the points of a swinging body are seen.

    Attributes
    ----------
    pivot_px : (2,) array
        The pivot, px; in view or not.
    shear, stretch : float
        The view: a plane seen squarely has 0 and 1.
    centre_px : (2,) array
        The middle of the body in the reference picture, px.
    turns : bool
        Whether its look turns with the arm; that of a smooth sphere does not.
    """

    pivot_px: FloatArray
    shear: float
    stretch: float
    centre_px: FloatArray
    turns: bool

    def turning(self, angle: float) -> FloatArray:
        """The picture (2, 2) of a turn by `angle`, rad from +x towards +y in the plane."""
        cosine, sine = math.cos(angle), math.sin(angle)
        leaning = self.shear * sine
        across = (1.0 + self.shear**2) * sine / self.stretch
        return np.array([[cosine + leaning, -across], [self.stretch * sine, cosine - leaning]])

    def by_view(self, angle: float) -> tuple[FloatArray, FloatArray]:
        """How the picture of a turn changes with shear and with stretch, (2, 2) each."""
        sine, stretch = math.sin(angle), self.stretch
        across = (1.0 + self.shear**2) * sine / stretch**2
        return (
            np.array([[sine, -2.0 * self.shear * sine / stretch], [0.0, -sine]]),
            np.array([[0.0, across], [sine, 0.0]]),
        )

    def placing(self, angle: float) -> FloatArray:
        """Where the middle is and what maps offsets from it, row by row, (6,)."""
        turning = self.turning(angle)
        middle = self.pivot_px + turning @ (self.centre_px - self.pivot_px)
        return np.array([*middle, *(turning.ravel() if self.turns else _UNTURNED)])

    def middle(self, angle: float) -> FloatArray:
        """Where the middle of the body is, (2,), px."""
        return np.asarray(self.pivot_px + self.turning(angle) @ (self.centre_px - self.pivot_px))

    def spread(self, angle: float) -> FloatArray:
        """What maps offsets from the middle in the reference picture to those now, (2, 2)."""
        return self.turning(angle) if self.turns else np.eye(2)

    def in_plane(self, point_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Offsets of points (..., 2) from the pivot in the plane of the swing, x and y (...)."""
        return _squared(point_px - self.pivot_px, self.shear, self.stretch)

    def angle_of(self, point_px: FloatArray) -> FloatArray:
        """Angle at which the middle is nearest to points (..., 2) in direction, rad."""
        x, y = self.in_plane(point_px)
        start_x, start_y = self.in_plane(self.centre_px)
        return _wrapped(np.arctan2(y, x) - np.arctan2(start_y, start_x))

    def per_radian(self, angle: float) -> tuple[FloatArray, FloatArray]:
        """What a small turn moves: the middle (2,) px/rad, and offsets from it (2, 2) 1/rad."""
        quarter = self.turning(angle + 0.5 * np.pi)
        moved = np.asarray(quarter @ (self.centre_px - self.pivot_px))
        return moved, quarter if self.turns else np.zeros((2, 2))

    def way_per_radian(self, angle: float) -> FloatArray:
        """The same change of `placing` as one row, (6,)."""
        moved, turned = self.per_radian(angle)
        return np.array([*moved, *turned.ravel()])


# rad: what all turns may be off by together; a thick body shows more of one side as it swings.
_TURN_STD = 0.012

# An oblique view of up to some 25° shortens a plane by a tenth, and more at the picture's edge.
_VIEW_STD = 0.06

_SQUARE_STD = 0.005

"""Dimensionless, shear and stretch of a swing seen square on (chosen): a camera set up by eye and
levelled."""

_PIVOT_STD_SHARE = 0.5

# px: what light and depth move a body off its arc; of the frames, so many are independent.
_OFF_ARC_PX, _INDEPENDENT = 0.15, 8.0

LOOK_PX = 1.0
"""px: what a body's depth, its light and its rod do to the track between the ends of its way. The
pivot is off by what is stated with it, to a factor of 1.3, over rooms at random and ray-traced
clips."""

_UNSURE = 2.0
"""Times the usual uncertainty of a place from which it counts for less: places of a body that is
followed well are all known alike, to a factor of one and a half."""

# How much better an oblique view has to do: by half a chi-square, and by this factor, since what a
# body's depth and its light do to the track looks a little like an oblique view.
_TELLING, _TELLING_RATIO = 4.0, 2.0

_MIN_POSES = 8

"""Poses: a swing in an oblique view has six unknowns, and two more show whether it is one."""


@dataclass(frozen=True)
class Arc:
    """A circle through a track.

    Attributes
    ----------
    centre_px : (2,) array
        Its centre, px.
    radius_px : float
        Its radius, px.
    covariance : (3, 3) array
        Of centre x, y and radius, px².
    scatter_px : float
        Robust scatter of the points about the circle, px.
    span_rad : float
        Angle that the points cover, rad.
    """

    centre_px: FloatArray
    radius_px: float
    covariance: FloatArray
    scatter_px: float
    span_rad: float


def fit_arc(points: FloatArray, turns: FloatArray | None = None) -> Arc | None:
    """Fit a circle, helped where known by how far the body turned on the way.

    Parameters
    ----------
    points : (N, 2) array
        Points, px.
    turns : (N,) array, optional
        Turn of the body at each point, rad, from +x towards +y: on a short arc it tells the radius
        better than the bend of the arc does.

    Returns
    -------
    Arc or None
        None if the points lie on a line, or are fewer than five.
    """
    if len(points) < 5:
        return None
    start = _algebraic(points)
    if start is None:
        return None
    radius = float(np.median(np.hypot(*(points - start).T)))
    state = np.array([*start, radius, 0.0])
    common = _TURN_STD * float(np.sqrt(len(points)))
    scatter, turn_scatter = 0.1, common
    angle = _angles(points, start)
    if turns is not None:
        state[3] = float(np.median(turns - angle))

    def residuals(state: FloatArray) -> FloatArray:
        offset = points - state[..., np.newaxis, :2]
        away, rest = np.hypot(offset[..., 0], offset[..., 1]), state[..., 3:]
        radial = (away - state[..., 2:3]) / scatter
        if turns is None:
            return np.concatenate([radial, 1e-3 * rest], axis=-1)
        turned = turns - np.arctan2(offset[..., 1], offset[..., 0]) - rest
        return np.concatenate([radial, _wrapped(turned) / turn_scatter], axis=-1)

    for _ in range(4):
        solution = minimise(residuals, state, soft_from=1.0, stacked=True, most_evaluations=60)
        state = solution.values
        offset = points - state[:2]
        radial = np.hypot(offset[:, 0], offset[:, 1]) - state[2]
        scatter = max(1.4826 * float(np.median(np.abs(radial))), 0.01)
        if turns is not None:
            turned = turns - _angles(points, state[:2]) - state[3]
            turn_scatter = max(1.4826 * float(np.median(np.abs(turned))), common)
    if not np.all(np.isfinite(state)) or state[2] > 1e5:
        return None
    slopes = solution.jacobian
    covariance = np.asarray(np.linalg.pinv(slopes.T @ slopes)[:3, :3], dtype=np.float64)
    span = float(np.ptp(np.unwrap(_angles(points, state[:2]))))
    return Arc(state[:2], float(state[2]), covariance, scatter, span)


def _angles(points: FloatArray, centre: FloatArray) -> FloatArray:
    """Direction of each point from the centre, rad, from +x towards +y."""
    offset = points - centre
    return np.asarray(np.arctan2(offset[:, 1], offset[:, 0]))


def _algebraic(points: FloatArray) -> FloatArray | None:
    """Kåsa's linear fit, for a start."""
    middle = points.mean(axis=0)
    x, y = (points - middle).T
    design = np.column_stack([2 * x, 2 * y, np.ones(len(x))])
    solution, _, rank, _ = np.linalg.lstsq(design, x * x + y * y, rcond=None)
    if rank < 3:
        return None
    return np.asarray(middle + solution[:2])


@dataclass(frozen=True)
class SwingThrough:
    """A swing fitted through poses.

    Attributes
    ----------
    pivot_covariance_px2 : (2, 2) array
        Of its pivot, px².
    cost : float
        Half a robust chi-square.
    """

    swing: ImagedSwing
    pivot_covariance_px2: FloatArray
    cost: float


def fit_imaged_swing(start: ImagedSwing, poses: Sequence[Pose]) -> SwingThrough:
    """Fit pivot and view to where a body was registered, helped by how far it turned.

    Parameters
    ----------
    start : ImagedSwing
        First guess; its middle is the reference.
    poses : sequence of Pose
        Where the body was seen.

    Returns
    -------
    SwingThrough
        Through the poses, robustly; the guess where there are fewer than eight.
    """
    if len(poses) < _MIN_POSES:
        arm = float(np.hypot(*(start.centre_px - start.pivot_px)))
        return SwingThrough(start, np.eye(2) * (_PIVOT_STD_SHARE * arm) ** 2, np.inf)
    square = _swing_through(start, poses, _SQUARE_STD)
    oblique = _swing_through(start, poses, _VIEW_STD)
    telling = oblique.cost < min(square.cost - _TELLING, square.cost / _TELLING_RATIO)
    return oblique if telling else square


def _swing_through(start: ImagedSwing, poses: Sequence[Pose], view_std: float) -> SwingThrough:
    points = np.array([pose.anchor for pose in poses])
    turns = np.array([pose.turn for pose in poses])
    away = start.centre_px - start.pivot_px
    arm = float(np.hypot(*away))
    stds = np.array([_PIVOT_STD_SHARE * arm] * 2 + [view_std] * 2)
    # neighbouring frames share what biases them; one that tells far less than usual counts for less
    place_std = np.sqrt([0.5 * np.trace(pose.covariance[:2, :2]) for pose in poses])
    less = np.maximum(place_std / max(_UNSURE * float(np.median(place_std)), 1e-9), 1.0)
    count = float(np.sqrt(len(points) / _INDEPENDENT)) * less

    def swing_of(state: FloatArray) -> ImagedSwing:
        return replace(
            start,
            pivot_px=state[:2] + start.pivot_px,
            shear=float(state[2]),
            stretch=float(np.exp(state[3])),
            centre_px=start.centre_px + state[4] * away / arm,
        )

    def residuals(state: FloatArray) -> FloatArray:
        view = state[..., 2:3], np.exp(state[..., 3:4])
        pivot = start.pivot_px + state[..., np.newaxis, :2]
        x, y = _squared(points - pivot, *view)
        middle = start.centre_px + state[..., np.newaxis, 4:] * away / arm
        start_x, start_y = _squared(middle - pivot, *view)
        radial = np.hypot(x, y) - np.hypot(start_x, start_y)
        left = [radial / (_OFF_ARC_PX * count), state[..., :4] / stds, 0.1 * state[..., 4:]]
        if start.turns:
            turned = turns - _wrapped(np.arctan2(y, x) - np.arctan2(start_y, start_x))
            usual = np.median(turned, axis=-1, keepdims=True)
            left.append((turned - usual) / (_TURN_STD * count))
        return np.concatenate(left, axis=-1)

    found = minimise(residuals, np.zeros(5), soft_from=1.0, stacked=True, most_evaluations=60)
    if not np.all(np.isfinite(found.values)):
        return SwingThrough(start, np.diag(stds[:2] ** 2), np.inf)
    # A body's look pulls its track about as an oblique view does, by more than the view is oblique.
    slopes = found.jacobian.copy()
    look = slice(len(points) + 2, len(points) + 4)
    slopes[look] *= view_std / math.hypot(view_std, LOOK_PX / arm)
    widened = max(1.0, 2.0 * found.cost / _INDEPENDENT)
    covariance = np.asarray(widened * np.linalg.pinv(slopes.T @ slopes)[:2, :2], dtype=np.float64)
    return SwingThrough(swing_of(found.values), covariance, found.cost)
