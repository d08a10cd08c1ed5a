"""Lens, poses and shape of the board from its corners in many views, in one robust weighted fit.

A bundle adjustment as in B. Triggs et al., *Bundle adjustment: a modern synthesis*, 1999: the poses
are eliminated view by view, what all views share is solved for. A printed board is never flat, nor
its squares alike; where its corners really are can be among what is solved for.

A lens known before a clip is looked at, and how well.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.camera.board import BoardView
from calib.camera.camera import Lens

__all__ = [
    "FLOOR",
    "MODELS",
    "NAMES",
    "BoardFit",
    "LensPrior",
    "fit_boards",
    "held_out_errors",
    "prior_of",
]

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")

MOST_STEPS = 25
"""Steps of the Levenberg-Marquardt search at most: one that has not settled by then does not
settle."""

SETTLED = 1e-4
"""Relative change of the cost that is none: a hundredth of the chi² by which a parameter moves a
standard deviation, of a hundred points."""

COEFFICIENT_STD = 1.0

"""Distortion coefficients of any lens that still gives a picture."""

SHAPE_STD = 0.02

"""Corners of a board on paper or cardboard off their places, over the side of a square."""

SOFT_FROM = 4.0
"""Standard deviations from which a corner loses weight (Geman-McClure): of normal errors in two
directions one in three thousand is larger."""

LEAST_NOISE = 0.01
"""px: no corner is found better, so that exact corners do not end in a weight without bound."""

DIGITS = 9
"""Digits after the point, of m: a nanometre tells the corners of any board apart."""


@dataclass(frozen=True)
class LensModel:
    """What is fitted.

    Attributes
    ----------
    name : str
        In words.
    coefficients : int
        Distortion coefficients, of OpenCV's: 5 for Brown's polynomial, 8 for a ratio.
    shaped : bool
        Whether the board's corners may lie off their nominal places.
    """

    name: str
    coefficients: int
    shaped: bool


MODELS = (
    LensModel("Brown's polynomial, flat board", 5, False),
    LensModel("Brown's polynomial, board as it is", 5, True),
    LensModel("ratio of polynomials, flat board", 8, False),
    LensModel("ratio of polynomials, board as it is", 8, True),
)

"""From the simplest to the richest."""


@dataclass(frozen=True, eq=False)
class BoardFit:
    """A fitted lens.

    Attributes
    ----------
    model : LensModel
    lens : (4 + coefficients,) array
        fx, fy, cx, cy, then the coefficients in OpenCV's order.
    covariance : array
        Of `lens`, square, for corners with the noise `noise_px`.
    board, shape : (P, 3) arrays
        Nominal places of the board's corners, and where they are, m.
    poses : (V, 6) array
        Turn and shift of each view's board.
    errors : tuple of (N, 2) arrays
        Projected minus measured corner of each view, px.
    noise_px : float
        Robust standard deviation of the errors along one axis.
    """

    model: LensModel
    lens: FloatArray
    covariance: FloatArray
    board: FloatArray
    shape: FloatArray
    poses: FloatArray
    errors: tuple[FloatArray, ...]
    noise_px: float

    @property
    def rms_px(self) -> float:
        """Root mean square of the distances between projected and measured corners, px."""
        return float(np.sqrt(np.mean((np.concatenate(self.errors) ** 2).sum(axis=1))))

    @property
    def view_rms_px(self) -> FloatArray:
        """The same for each view, (V,)."""
        return np.array([np.sqrt(np.mean((e**2).sum(axis=1))) for e in self.errors])

    def to_lens(self, size: tuple[int, int]) -> Lens:
        """The lens, for pictures of a size (width, height)."""
        return Lens(*size, **dict(zip(NAMES, self.lens.tolist(), strict=False)))


@dataclass(frozen=True, eq=False)
class _Corners:
    """Corners of all views, each with its place in the table of the board's corners."""

    places: tuple[IntArray, ...]
    px: tuple[FloatArray, ...]
    board: FloatArray
    square: float


@dataclass(frozen=True, eq=False)
class _Equations:
    """Normal equations with the poses eliminated, and what gives the poses back."""

    reduced: FloatArray
    right: FloatArray
    poses: tuple[tuple[FloatArray, FloatArray, FloatArray], ...]
    cost: float
    noise: float


def _corners(views: Sequence[BoardView]) -> _Corners:
    every = np.concatenate([view.board_m for view in views])
    board, where = np.unique(np.round(every, DIGITS), axis=0, return_inverse=True)
    ends = np.cumsum([0] + [len(view.board_m) for view in views])
    places = tuple(np.ravel(where)[a:b] for a, b in pairwise(ends))
    steps = np.diff(np.unique(board[:, 0]))
    return _Corners(places, tuple(view.points_px for view in views), board, float(steps.min()))


def fit_boards(
    views: Sequence[BoardView], model: LensModel, start: BoardFit | None = None
) -> BoardFit:
    """Fit a model to views of one board.

    Parameters
    ----------
    views : sequence of BoardView
    model : LensModel
    start : BoardFit, optional
        A fit to the same views, with this or a simpler model; without it OpenCV's own fit.
    """
    corners = _corners(views)
    fit = _opened(views, corners) if start is None else start
    fit = _measured(_with_model(fit, model), corners)
    for _ in range(MOST_STEPS):
        equations = _equations(fit, corners, fit.noise_px)
        step = np.asarray(np.linalg.solve(equations.reduced, equations.right), dtype=float)
        for halving in range(8):
            moved = _moved(fit, equations, step, 0.5**halving, corners)
            cost = _cost(moved, corners, equations.noise)
            if cost <= equations.cost:
                break
        else:
            break
        fit = moved
        if equations.cost - cost < SETTLED * equations.cost:
            break
    equations = _equations(fit, corners, fit.noise_px)
    size = len(fit.lens)
    shared = np.asarray(np.linalg.inv(equations.reduced), dtype=float)
    return replace(fit, covariance=shared[:size, :size])


def held_out_errors(fit: BoardFit, view: BoardView, pose: FloatArray) -> FloatArray:
    """Errors (N, 2), px, of a view that took no part in the fit, at the pose that suits it best.

    Parameters
    ----------
    fit : BoardFit
        Lens and board.
    view : BoardView
        Another view of the same board.
    pose : (6,) array
        About its turn and shift.
    """
    order = {tuple(key): place for key, place in zip(fit.board, fit.shape, strict=True)}
    points = np.array([order.get(tuple(key), key) for key in np.round(view.board_m, DIGITS)])
    for _ in range(12):
        seen, jacobian = _projected(points, pose, fit.lens)
        pull = (view.points_px - seen).ravel()
        step = np.linalg.lstsq(jacobian[:, :6], pull, rcond=None)[0]
        pose = pose + step
        if float(np.abs(jacobian[:, :6] @ step).max()) < 1e-4:
            break
    return _projected(points, pose, fit.lens)[0] - view.points_px


def _opened(views: Sequence[BoardView], corners: _Corners) -> BoardFit:
    """OpenCV's fit of Brown's polynomial, the board taken as flat."""
    unset: Any = None
    _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
        [view.board_m.astype(np.float32) for view in views],
        [view.points_px.astype(np.float32)[:, np.newaxis] for view in views],
        views[0].size,
        unset,
        unset,
    )
    focal = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
    lens = np.concatenate([focal, np.ravel(distortion)[:5]])
    poses = np.array(
        [np.concatenate([np.ravel(t), np.ravel(s)]) for t, s in zip(turns, shifts, strict=True)]
    )
    return BoardFit(MODELS[0], lens, np.zeros((9, 9)), corners.board, corners.board, poses, (), 1.0)


def _with_model(fit: BoardFit, model: LensModel) -> BoardFit:
    lens = np.zeros(4 + model.coefficients)
    common = min(len(lens), len(fit.lens))
    lens[:common] = fit.lens[:common]
    return replace(fit, model=model, lens=lens, shape=fit.shape if model.shaped else fit.board)


def _projected(
    points: FloatArray, pose: FloatArray, lens: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Corners in the picture (N, 2), and their derivative by pose and lens (2 N, 6 + L)."""
    matrix = np.array([[lens[0], 0.0, lens[2]], [0.0, lens[1], lens[3]], [0.0, 0.0, 1.0]])
    seen, jacobian = cv2.projectPoints(points, pose[:3], pose[3:], matrix, lens[4:])
    used = np.asarray(jacobian, dtype=float)[:, : 6 + len(lens)]
    return np.asarray(seen, dtype=float).reshape(-1, 2), used


def _measured(fit: BoardFit, corners: _Corners) -> BoardFit:
    """The fit with its errors, and their noise."""
    errors = tuple(
        _projected(fit.shape[where], pose, fit.lens)[0] - px
        for where, pose, px in zip(corners.places, fit.poses, corners.px, strict=True)
    )
    values = np.concatenate([error.ravel() for error in errors])
    noise = max(1.4826 * float(np.median(np.abs(values))), LEAST_NOISE)
    return replace(fit, errors=errors, noise_px=noise)


def _weights(error: FloatArray, noise: float) -> FloatArray:
    """Of the corners of a view, (2 N,): a corner far off counts little."""
    weight = 1.0 / (1.0 + (error**2).sum(axis=1) / (SOFT_FROM * noise) ** 2)
    return np.repeat(weight, 2) / noise**2


def _cost(fit: BoardFit, corners: _Corners, noise: float) -> float:
    square = np.concatenate([(error**2).sum(axis=1) for error in fit.errors])
    soft = (SOFT_FROM * noise) ** 2
    total = float(np.sum(soft * np.log1p(square / soft))) / noise**2
    off = (fit.shape - fit.board) / (SHAPE_STD * corners.square)
    return total + float((fit.lens[4:] ** 2).sum()) / COEFFICIENT_STD**2 + float((off**2).sum())


def _equations(fit: BoardFit, corners: _Corners, noise: float) -> _Equations:
    lens, count = len(fit.lens), len(fit.board)
    size = lens + (3 * count if fit.model.shaped else 0)
    reduced, right = np.zeros((size, size)), np.zeros(size)
    # Views that are all alike leave the focal length open; it still has an order of magnitude
    reduced[range(4), range(4)] = fit.lens[0] ** -2
    reduced[range(4, lens), range(4, lens)] = COEFFICIENT_STD**-2
    right[4:lens] = -fit.lens[4:] / COEFFICIENT_STD**2
    if fit.model.shaped:
        width = SHAPE_STD * corners.square
        reduced[range(lens, size), range(lens, size)] = width**-2
        right[lens:] = (fit.board - fit.shape).ravel() / width**2
    poses = []
    for where, pose, error in zip(corners.places, fit.poses, fit.errors, strict=True):
        jacobian = _projected(fit.shape[where], pose, fit.lens)[1]
        weight = _weights(error, noise)
        shared = np.zeros((2 * len(where), size))
        shared[:, :lens] = jacobian[:, 6:]
        if fit.model.shaped:
            # a corner moves in the camera's axes as the board's shift does
            turn = np.asarray(cv2.Rodrigues(pose[:3])[0])
            by_place = jacobian[:, 3:6] @ turn
            for row, place in enumerate(where):
                columns = slice(lens + 3 * place, lens + 3 * place + 3)
                shared[2 * row : 2 * row + 2, columns] = by_place[2 * row : 2 * row + 2]
        own = jacobian[:, :6]
        weighed = weight[:, np.newaxis] * own
        inverse = np.asarray(np.linalg.inv(own.T @ weighed), dtype=float)
        cross, pull = weighed.T @ shared, -weighed.T @ error.ravel()
        reduced += shared.T @ (weight[:, np.newaxis] * shared) - cross.T @ inverse @ cross
        right += -shared.T @ (weight * error.ravel()) - cross.T @ inverse @ pull
        poses.append((inverse, cross, pull))
    return _Equations(reduced, right, tuple(poses), _cost(fit, corners, noise), noise)


def _moved(
    fit: BoardFit, equations: _Equations, step: FloatArray, share: float, corners: _Corners
) -> BoardFit:
    size = len(fit.lens)
    own = [inverse @ (pull - cross @ step) for inverse, cross, pull in equations.poses]
    shape = fit.shape
    if fit.model.shaped:
        shape = shape + share * step[size:].reshape(-1, 3)
    moved = replace(
        fit,
        lens=fit.lens + share * step[:size],
        shape=shape,
        poses=fit.poses + share * np.array(own),
    )
    return _measured(moved, corners)


MOST_POINTS = 600
"""Points that compare two models of a lens: a smooth map of five parameters is known long
before."""

BROWN = 5
"""Numbers that the Brown model of a lens file has: k1, k2, p1, p2, k3 as OpenCV orders them."""

FLOOR: FloatArray = np.array([1e-4, 0.05, 0.05, 1e-4, 1e-4])

"""Relative focal length, px, px and two dimensionless: no lens is known better, since focusing and
warming up move it by as much."""


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
