"""Lens from pictures of a chessboard or ChArUco board, and how good it is.

`lens.toml`: a lens written down, with its uncertainties; and the board to print.

A calibration board, and where its corners are in a picture.

Lens, poses and shape of the board from its corners in many views, in one robust weighted fit.

A bundle adjustment as in B. Triggs et al., *Bundle adjustment: a modern synthesis*, 1999: the poses
are eliminated view by view, what all views share is solved for. A printed board is never flat, nor
its squares alike; where its corners really are can be among what is solved for.

A lens known before a clip is looked at, and how well.

Lens files of OpenCV and ROS: YAML, both ways.

OpenCV's ``FileStorage`` writes a YAML 1.0 document with matrices tagged ``opencv-matrix``
(``camera_matrix``, ``distortion_coefficients``); the ROS message CameraInfo, as
``camera_calibration`` stores it, has the same names with plain lists, and a ``distortion_model``.
Both count pixel centres from 0 and have OpenCV's order of coefficients.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.camera import Lens, rotation_matrix
from metrology import (
    CalibrationError,
    SetupError,
    parse_toml,
    read_small_text,
    write_text_whole,
    written_whole,
)
from metrology.least_squares import Downhill, descend, minimise

__all__ = [
    "FLOOR",
    "MODELS",
    "NAMES",
    "YAML_SUFFIXES",
    "Board",
    "BoardFit",
    "BoardView",
    "LensPrior",
    "calibrate_lens",
    "find_board",
    "fit_boards",
    "held_out_errors",
    "lens_toml",
    "lens_yaml",
    "prior_of",
    "prior_toml",
    "read_lens",
    "read_lens_yaml",
    "write_board",
    "write_lens",
]

FloatArray = NDArray[np.float64]

GrayImage = NDArray[np.uint8]

LEAST_MARKED = 6

"""Corners of a marked board that must be read: a homography has eight unknowns, four corners; half
as many again tell whether they are on one plane."""

WINDOW_SHARE = 0.35

"""Half the window of the corner search over the smallest distance between corners: below a half, so
that no window holds a neighbour."""

LARGEST_WINDOW = 5

"""px: an edge is one to two pixels wide, and a larger window takes in the bend of the lens."""


@dataclass(frozen=True)
class Board:
    """A calibration board.

    Attributes
    ----------
    columns, rows : int
        Inner corners along both sides.
    square_m : float
        Side of a square, m.
    charuco : bool
        Whether markers stand in the white squares.
    """

    columns: int
    rows: int
    square_m: float = 0.025
    charuco: bool = False

    @property
    def points(self) -> FloatArray:
        """Corners on the board, (columns * rows, 3), m, row by row."""
        rows, columns = np.mgrid[: self.rows, : self.columns]
        flat = np.stack([columns, rows, np.zeros_like(rows)], axis=-1).reshape(-1, 3)
        return np.asarray(flat * self.square_m, dtype=np.float64)

    def opencv(self) -> cv2.aruco.CharucoBoard:
        """The ChArUco board as OpenCV has it."""
        markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
        size = (self.columns + 1, self.rows + 1)
        return cv2.aruco.CharucoBoard(size, self.square_m, 0.75 * self.square_m, markers)


@dataclass(frozen=True, eq=False)
class BoardView:
    """Corners of the board in one picture.

    Attributes
    ----------
    name : str
        Name of the picture.
    size : tuple of int
        Its width and height, px.
    board_m : (N, 3) array
        Corners on the board, m.
    points_px : (N, 2) array
        The same corners in the picture, px.
    """

    name: str
    size: tuple[int, int]
    board_m: FloatArray
    points_px: FloatArray


def find_board(image: GrayImage, board: Board, name: str = "") -> BoardView | None:
    """Find the board in a picture; None if it is not there.

    Parameters
    ----------
    image : (H, W) uint8 array
    board : Board
    name : str
        What to call the picture.

    Raises
    ------
    CalibrationError
        If the picture is mirrored, which a ChArUco board tells.
    """
    size = (image.shape[1], image.shape[0])
    if board.charuco:
        return _marked(image, board, name, size)
    shape = (board.columns, board.rows)
    found, corners = cv2.findChessboardCorners(image, shape)
    if not found:
        found, corners = cv2.findChessboardCornersSB(image, shape, flags=cv2.CALIB_CB_ACCURACY)
    if not found:
        return None
    points = _refined(image, np.asarray(corners, dtype=np.float64).reshape(-1, 2), board)
    return BoardView(name, size, board.points, points)


def _marked(image: GrayImage, board: Board, name: str, size: tuple[int, int]) -> BoardView | None:
    detector = cv2.aruco.CharucoDetector(board.opencv())
    corners, labels, _, _ = detector.detectBoard(image)
    if labels is None or len(labels) < LEAST_MARKED:
        mirrored = detector.detectBoard(np.ascontiguousarray(image[:, ::-1]))[1]
        if mirrored is not None and len(mirrored) >= LEAST_MARKED:
            raise CalibrationError(
                f"{name or 'the picture'} shows the board mirrored",
                hint="Switch off the camera's mirror (selfie) mode.",
            )
        return None
    points = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    return BoardView(name, size, board.points[np.asarray(labels).ravel()], points)


def _refined(image: GrayImage, points: FloatArray, board: Board) -> FloatArray:
    """Corners where the gradients around them meet, the rows running to the right.

    The window stays between the neighbours: a second corner in it would pull the first one over.
    """
    table = points.reshape(board.rows, board.columns, 2)
    # A board turned by half looks the same; one order for all views, for it may not be flat
    if (table[:, -1] - table[:, 0]).mean(axis=0)[0] < 0.0:
        table = table[::-1, ::-1]
    apart = min(
        float(np.linalg.norm(np.diff(table, axis=axis), axis=-1).min()) for axis in range(2)
    )
    half = int(np.clip(WINDOW_SHARE * apart, 2, LARGEST_WINDOW))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    start = np.ascontiguousarray(table.reshape(-1, 1, 2), dtype=np.float32)
    refined = cv2.cornerSubPix(image, start, (half, half), (-1, -1), criteria)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)


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


@dataclass(frozen=True, eq=False)
class _BoardStep:
    """A step (L,) of lens and board, and the equations that it solves."""

    equations: _Equations
    step: FloatArray


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

    def looking(place: BoardFit) -> Downhill[_BoardStep]:
        equations = _equations(place, corners, place.noise_px)
        step = np.asarray(np.linalg.solve(equations.reduced, equations.right), dtype=float)
        return Downhill(equations.cost, _BoardStep(equations, step))

    fit = descend(
        fit,
        looking,
        lambda place, on, share: _moved(place, on.equations, on.step, share, corners),
        lambda place, on: _cost(place, corners, on.equations.noise),
        settled=lambda seen, reached: seen.cost - reached < SETTLED * seen.cost,
        most_steps=MOST_STEPS,
    )
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

    def missed(pose: FloatArray) -> FloatArray:
        return (_projected(points, pose, fit.lens)[0] - view.points_px).ravel()

    def slopes(pose: FloatArray) -> FloatArray:
        return _projected(points, pose, fit.lens)[1][:, :6]

    pose = minimise(missed, pose, slopes=slopes).values
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


YAML_SUFFIXES = (".yaml", ".yml")

_LARGEST = 2**20

"""Bytes: a thousand times what such a file has, so that a clip given by mistake is not read."""

_MOST_NUMBERS = 64

"""Numbers in one entry: the longest of OpenCV, the thin-prism and tilted model, has fourteen."""

_MODELS = ("plumb_bob", "rational_polynomial")

"""Distortion models of ROS that are a lens here; ``equidistant`` is another law."""

SAID_STD: FloatArray = np.array([2e-3, 2.0, 2.0, 5e-3, 1e-2])

"""Of log focal length, principal point (px), k1 and k2 where the file states no uncertainty: what a
dozen pictures of a board give (udacity's 27 pictures of 1280 × 960 px: 1.3e-3, 1.1, 0.9, 2e-3,
3e-3)."""


def _parsed_yaml(text: str) -> Any:
    """YAML without objects, but for the matrices that OpenCV tags; ValueError where it is none."""
    # few measure with such a lens: not loaded before
    import yaml

    class Loader(yaml.SafeLoader):
        pass

    def matrix(loader: yaml.SafeLoader, node: yaml.MappingNode) -> Any:
        return loader.construct_mapping(node, deep=True)

    Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", matrix)
    try:
        return yaml.load(text, Loader=Loader)
    except yaml.YAMLError as problem:
        raise ValueError(str(problem)) from problem


def read_lens_yaml(path: Path) -> LensPrior:
    """Read a lens as OpenCV or ROS wrote it.

    Raises
    ------
    SetupError
        If it can't be read, lacks the camera's matrix or the size of its pictures, or has a
        distortion that is no polynomial or ratio of polynomials.
    """
    table = _document(path)
    camera, bent = _numbers(table, "camera_matrix", path), table.get("distortion_coefficients")
    if camera is None or camera.size != 9:
        raise SetupError(
            f"{path} has no camera_matrix of 3 × 3", hint="Write it with OpenCV or ROS, or TOML."
        )
    model = table.get("distortion_model", _MODELS[0])
    if model not in _MODELS:
        raise SetupError(
            f"{path}: distortion model {model!r} is not known", hint=f"Known: {', '.join(_MODELS)}."
        )
    coefficients = np.zeros(0) if bent is None else _numbers(table, "distortion_coefficients", path)
    assert coefficients is not None
    if coefficients.size > 8 and np.any(coefficients[8:]):
        raise SetupError(
            f"{path}: thin-prism and tilted-sensor coefficients are not known here",
            hint="Calibrate the lens again with at most eight: k1 k2 p1 p2 k3 k4 k5 k6.",
        )
    try:
        width, height = (int(table[f"image_{name}"]) for name in ("width", "height"))
    except (KeyError, TypeError, ValueError) as problem:
        raise SetupError(
            f"{path} does not say how large its pictures are",
            hint="It needs image_width and image_height.",
        ) from problem
    fx, _, cx, _, fy, cy = camera.ravel()[:6]
    lens = Lens(width, height, fx, fy, cx, cy, *coefficients[:8].tolist())
    if width < 1 or height < 1 or fx <= 0.0 or fy <= 0.0:
        raise SetupError(
            f"{path}: a picture or a focal length is not positive",
            hint="Image sizes are counted in px, focal lengths in px, both above zero.",
        )
    return LensPrior(lens, np.maximum(_std(table, lens, path), FLOOR))


def _document(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > _LARGEST:
            raise SetupError(
                f"{path} is too large for a lens file",
                hint="A lens file holds some twenty numbers; is it another file?",
            )
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        raise SetupError(
            f"can't read the lens file {path}: {problem}",
            hint="Name the file that `vision calibrate`, OpenCV or ROS wrote.",
        ) from problem
    # OpenCV's "%YAML:1.0" is no directive of YAML
    text = re.sub(r"\A%YAML[^\n]*\n", "", text.lstrip("\ufeff"))
    try:
        table = _parsed_yaml(text)
    except (ValueError, RecursionError) as problem:
        raise SetupError(
            f"{path} is no YAML: {problem}",
            hint="Save it anew: it is TOML from `vision calibrate`, or YAML from OpenCV or ROS.",
        ) from problem
    if not isinstance(table, dict):
        raise SetupError(f"{path} is no lens file", hint="It holds no table of names.")
    return table


def _numbers(table: dict[str, Any], name: str, path: Path) -> FloatArray | None:
    """A matrix as flat numbers, as OpenCV or ROS has it, or a plain (nested) list."""
    held = table.get(name)
    if held is None:
        return None
    if isinstance(held, dict):
        held = held.get("data")
    rows: list[Any] = held if isinstance(held, list) else [held]
    # two levels and no more: references of YAML within references unfold without end
    flat = [one for row in rows for one in (row if isinstance(row, list) else [row])]
    if len(flat) > _MOST_NUMBERS or any(isinstance(one, list | dict) for one in flat):
        raise SetupError(
            f"{path}: {name} is no matrix of a lens",
            hint="Write a row of numbers, or rows of three, as OpenCV and ROS do.",
        )
    try:
        values = np.array([float(one) for one in flat])
    except (TypeError, ValueError) as problem:
        raise SetupError(
            f"{path}: {name} is no matrix of numbers",
            hint="Write a row of numbers, or rows of three, as OpenCV and ROS do.",
        ) from problem
    if not np.isfinite(values).all():
        raise SetupError(
            f"{path}: {name} is not finite",
            hint="Calibrate the lens again: an entry is nan or inf.",
        )
    return values


def _std(table: dict[str, Any], lens: Lens, path: Path) -> FloatArray:
    """Of log focal length, principal point, k1 and k2: as OpenCV's ``stdDeviationsIntrinsics``."""
    stated = _numbers(table, "std_deviation_intrinsics", path)
    if stated is None or stated.size < 6:
        return SAID_STD
    fx, _, cx, cy, k1, k2 = stated[:6]
    return np.array([fx / lens.fx, cx, cy, k1, k2])


def lens_yaml(prior: LensPrior, name: str = "camera") -> str:
    """Text of a lens file that OpenCV's FileStorage and ROS both read.

    Parameters
    ----------
    prior : LensPrior
    name : str
        Of the camera, as ROS wants one.
    """
    lens = prior.lens
    bent = lens.coefficients
    model = _MODELS[1] if bent.size > 5 else _MODELS[0]
    focal, cx, cy, k1, k2 = prior.std.tolist()
    std = [focal * lens.fx, focal * lens.fy, cx, cy, k1, k2]
    projection = np.hstack([lens.matrix, np.zeros((3, 1))])
    parts = [
        "%YAML:1.0",
        "---",
        f"image_width: {lens.width}",
        f"image_height: {lens.height}",
        f"camera_name: {name}",
        f"distortion_model: {model}",
        _matrix_text("camera_matrix", lens.matrix),
        _matrix_text("distortion_coefficients", bent[np.newaxis]),
        _matrix_text("rectification_matrix", np.eye(3)),
        _matrix_text("projection_matrix", projection),
        "# of fx fy cx cy k1 k2, as calibrateCamera gives them",
        _matrix_text("std_deviation_intrinsics", np.array([std])),
    ]
    return "\n".join(parts) + "\n"


def _matrix_text(name: str, values: FloatArray) -> str:
    listed = ", ".join(repr(float(value)) for value in np.ravel(values))
    rows, columns = values.shape
    return (
        f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n"
        f"   data: [{listed}]"
    )


LEAST_VIEWS = 6

"""Views of the board: each gives two equations for the lens (Zhang 2000), which has ten unknowns
with its distortion; one more shows what is wrong."""

LEAST_TILT_SPREAD = np.radians(8.0)

"""rad: views square on tell focal length and distance by their ratio only (Zhang 2000); a tilt of
8° changes scale across a board, a fifth of its distance wide, by 3 %."""

LEAST_COVERAGE = 0.35

"""Share of the picture: distortion grows with the third power of the radius, and a third of the
area ends at 0.6 of the way to the corner, where k1 does a fifth of what it does there."""

OUTLIER_AT = 3.5

"""Robust standard deviations: one honest view in some thousands is farther off."""

FOLDS = 8

"""Parts for the held-out error, at most: an eighth of the views kept out leaves a lens fitted
nearly as well as with all."""

RICHER_ERROR_RATIO = 0.97

"""A richer model must bring the held-out error down to this part of the simpler one's."""


@dataclass(frozen=True, eq=False)
class LensCalibration:
    """A lens and how well it is known.

    Attributes
    ----------
    lens : Lens
    std : dict of str to float
        Standard uncertainty of each parameter, by its name in `Lens`.
    prior : LensPrior
        The same as what a clip's calibration starts from: correlations kept.
    held_out_rms_px : float
        Reprojection error in views that took no part in the fit: the views are dealt into 8 parts,
        lens and board are fitted to all parts but one, and each view of that one is given the pose
        that suits it best; root mean square, over all corners of all used views, of the distance
        between projected and measured corner.
    rms_px : float
        Reprojection error in the views of the fit.
    used, dropped : tuple of str
        Names of the pictures used, and of those left out as outliers.
    coverage : float
        Share of the picture's area the corners cover.
    model : str
        What was fitted: the simplest model with about the lowest held-out error.
    warnings : tuple of str
    """

    lens: Lens
    std: dict[str, float]
    prior: LensPrior
    held_out_rms_px: float
    rms_px: float
    used: tuple[str, ...]
    dropped: tuple[str, ...]
    coverage: float
    model: str
    warnings: tuple[str, ...] = ()


def calibrate_lens(views: Sequence[BoardView | None]) -> LensCalibration:
    """Fit the lens to views of a board.

    Parameters
    ----------
    views : sequence of BoardView or None
        None for pictures in which no board was found.

    Returns
    -------
    LensCalibration

    Raises
    ------
    CalibrationError
        If there are too few views, or all are alike.
    """
    seen = [view for view in views if view is not None]
    if not seen:
        raise CalibrationError(
            f"the board was found in none of {len(views)} pictures",
            hint="Check the board's size: it counts inner corners, one less than squares.",
        )
    if len(seen) < LEAST_VIEWS:
        raise CalibrationError(
            f"the board was found in only {len(seen)} of {len(views)} pictures",
            hint=f"At least {LEAST_VIEWS} are needed, better 15, tilted in different directions; "
            "the board's size counts inner corners.",
        )
    if len({view.size for view in seen}) > 1:
        # Cameras that crop differ by a pixel or two between modes; the commonest size wins
        sizes = [view.size for view in seen]
        common = max(set(sizes), key=sizes.count)
        odd = [view for view in seen if max(abs(np.subtract(view.size, common))) > 2]
        if odd:
            raise CalibrationError(
                f"{odd[0].name} is {odd[0].size[0]}×{odd[0].size[1]} px, the others are not",
                hint="All pictures must come from one camera in one mode.",
            )
    fits, kept, dropped = _without_outliers(seen)
    spread = _tilt_spread(fits[-1].poses[:, :3])
    if spread < LEAST_TILT_SPREAD:
        raise CalibrationError(
            f"all views are alike: the board's tilt varies by only {np.degrees(spread):.1f} deg",
            hint="Tilt the board by 20 to 40 degrees, to all sides.",
        )
    fit, held_out = _chosen(fits, kept)
    lens = fit.to_lens(kept[0].size)
    # What the fit leaves over is not all noise: the covariance is for what predicts other views
    covariance = fit.covariance * max(1.0, 0.5 * held_out**2 / fit.noise_px**2)
    std = dict(zip(NAMES, np.sqrt(np.diag(covariance)).tolist(), strict=False))
    coverage = _coverage(kept)
    notes = [f"left out as outliers: {', '.join(view.name for view in dropped)}"] if dropped else []
    if coverage < LEAST_COVERAGE:
        notes.append(
            f"the board covers only {100 * coverage:.0f} % of the picture: "
            "distortion outside is extrapolated; hold the board into the corners too"
        )
    return LensCalibration(
        lens=lens,
        std=std,
        prior=prior_of(lens, covariance, np.concatenate([view.points_px for view in kept])),
        held_out_rms_px=held_out,
        rms_px=fit.rms_px,
        used=tuple(view.name for view in kept),
        dropped=tuple(view.name for view in dropped),
        coverage=coverage,
        model=fit.model.name,
        warnings=tuple(notes),
    )


def _without_outliers(
    views: list[BoardView],
) -> tuple[list[BoardFit], list[BoardView], list[BoardView]]:
    """Fits of all models to the views that agree, those views, and the ones left out.

    The richest model is the judge: a simpler one blames the views that reach farthest out.
    """
    kept, dropped = views, list[BoardView]()
    for _ in range(3):
        fits = _fits(kept)
        rms = fits[-1].view_rms_px
        bad = [v for v, value in zip(kept, rms, strict=True) if value > _outlier_limit(rms)]
        if not bad or len(kept) - len(bad) < LEAST_VIEWS:
            return fits, kept, dropped
        dropped += bad
        kept = [view for view in kept if view not in bad]
    return _fits(kept), kept, dropped


def _fits(views: Sequence[BoardView]) -> list[BoardFit]:
    fits: list[BoardFit] = []
    for model in MODELS:
        fits.append(fit_boards(views, model, fits[-1] if fits else None))
    return fits


def _chosen(fits: Sequence[BoardFit], views: Sequence[BoardView]) -> tuple[BoardFit, float]:
    """The simplest fit with about the lowest held-out error, and that error."""
    best: tuple[float, BoardFit] | None = None
    for fit in fits:
        error = _held_out(views, fit)
        if best is None or error < RICHER_ERROR_RATIO * best[0]:
            best = (error, fit)
    assert best is not None
    return best[1], best[0]


def _outlier_limit(rms: FloatArray) -> float:
    middle = float(np.median(rms))
    spread = 1.4826 * float(np.median(np.abs(rms - middle)))
    return middle + OUTLIER_AT * max(spread, 0.05 * middle)


def _tilt_spread(turns: FloatArray) -> float:
    """Largest angle between the boards' normals, rad."""
    normals = np.array([rotation_matrix(turn)[:, 2] for turn in turns])
    return float(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max())


def _coverage(views: Sequence[BoardView]) -> float:
    """Share of 8 by 6 fields of the picture that hold a corner or lie within a board."""
    width, height = views[0].size
    covered = np.zeros((60, 80), dtype=np.uint8)
    for view in views:
        hull = cv2.convexHull((view.points_px * [80 / width, 60 / height]).astype(np.float32))
        cv2.fillConvexPoly(covered, np.round(hull).astype(np.int32), 1)
    return float(covered.mean())


def _held_out(views: Sequence[BoardView], whole: BoardFit) -> float:
    """Reprojection error of views not used in the fit, root mean square over all corners, px.

    The pose of a held-out view is its own; lens and board come from the others.
    """
    squares: list[float] = []
    folds = min(FOLDS, len(views) // 2)
    for fold in range(folds):
        training = [index for index in range(len(views)) if index % folds != fold]
        start = replace(whole, poses=whole.poses[training])
        fit = fit_boards([views[index] for index in training], whole.model, start)
        for index in range(fold, len(views), folds):
            error = held_out_errors(fit, views[index], whole.poses[index])
            squares += list((error**2).sum(axis=1))
    return float(np.sqrt(np.mean(squares)))


A4_M = (0.297, 0.210)

"""m: the sheet, ISO 216."""


def lens_toml(calibration: LensCalibration) -> str:
    """Text of a lens file."""
    lens = calibration.lens
    lines = ["[lens]", f"width = {lens.width}", f"height = {lens.height}"]
    lines += [f"{name} = {getattr(lens, name)!r}" for name in NAMES]
    lines += ["", "[std]"]
    lines += [f"{name} = {calibration.std.get(name, 0.0)!r}" for name in NAMES]
    lines += [
        "",
        "[prior]",
        "# what it all amounts to in log focal length, principal point x and y (px), k1 and k2",
        f"std = {calibration.prior.std.tolist()!r}",
        f"correlation = {np.round(calibration.prior.related, 9).tolist()!r}",
        "",
        "[quality]",
        f'model = "{calibration.model}"',
        f"held_out_rms_px = {calibration.held_out_rms_px!r}",
        f"views = {len(calibration.used)}",
        f"coverage = {calibration.coverage!r}",
    ]
    return "\n".join(lines) + "\n"


def write_lens(path: Path, calibration: LensCalibration) -> None:
    """Write a lens file, whole or not at all: YAML of OpenCV and ROS where its name says so."""
    if path.suffix.lower() in YAML_SUFFIXES:
        write_text_whole(path, lens_yaml(calibration.prior, path.stem))
    else:
        write_text_whole(path, lens_toml(calibration))


def prior_toml(prior: LensPrior) -> str:
    """Text of a lens file for a lens that was read from elsewhere."""
    lens = prior.lens
    lines = ["[lens]", f"width = {lens.width}", f"height = {lens.height}"]
    lines += [f"{name} = {float(getattr(lens, name))!r}" for name in NAMES]
    lines += [
        "",
        "[prior]",
        "# log focal length, principal point x and y (px), k1 and k2",
        f"std = {prior.std.tolist()!r}",
        f"correlation = {np.round(prior.related, 9).tolist()!r}",
    ]
    return "\n".join(lines) + "\n"


def read_lens(path: Path, *, width: int | None = None, height: int | None = None) -> LensPrior:
    """Read a lens file (TOML, or YAML of OpenCV or ROS) for a picture of the given size.

    Parameters
    ----------
    path : Path
    width, height : int, optional
        Size of the clip's picture; the lens is scaled to it. The clip must show the whole picture.

    Raises
    ------
    SetupError
        If the file is missing or wrong, or its picture has another shape.
    """
    if path.suffix.lower() in YAML_SUFFIXES:
        return _for_picture(read_lens_yaml(path), width, height)
    text = read_small_text(
        path,
        what="the lens file",
        hint="Write one with `vision calibrate lens`.",
        error=SetupError,
    )
    table = parse_toml(text, f"the lens file {path}")
    numbers = table.get("lens", {})
    missing = [n for n in ("width", "height", *NAMES[:4]) if n not in numbers]
    if missing:
        raise SetupError(
            f"{path} lacks {', '.join(missing)} in its table [lens]",
            hint="Write it anew with `vision calibrate lens`.",
        )
    lens = Lens(
        int(numbers["width"]),
        int(numbers["height"]),
        *(float(numbers.get(name, 0.0)) for name in NAMES),
    )
    return _for_picture(_prior(lens, table, path), width, height)


def _for_picture(prior: LensPrior, width: int | None, height: int | None) -> LensPrior:
    """The lens scaled to a picture of the same shape."""
    lens = prior.lens
    if width is None or height is None:
        return prior
    if abs(width / height - lens.width / lens.height) > 0.01 * width / height:
        raise SetupError(
            f"the lens was calibrated at {lens.width}×{lens.height} px, the clip has "
            f"{width}×{height}: another shape",
            hint="Calibrate in the mode the clip is filmed in: other modes crop the sensor.",
        )
    return prior.resized(width, height)


def _prior(lens: Lens, table: dict[str, Any], path: Path) -> LensPrior:
    """Uncertainty as the file has it: with correlations, or of each parameter by itself."""
    given = table.get("prior", {})
    if "std" in given and "correlation" in given:
        std, related = (np.asarray(given[key], dtype=float) for key in ("std", "correlation"))
        if std.shape != (5,) or related.shape != (5, 5):
            raise SetupError(
                f"the table [prior] of {path} needs 5 and 5 × 5 numbers",
                hint="Write it anew with `vision calibrate lens`.",
            )
        return LensPrior(lens, np.maximum(std, FLOOR), related)
    own = {name: float(table.get("std", {}).get(name, 0.0)) for name in NAMES}
    spread = [own["fx"] / lens.fx, own["cx"], own["cy"], own["k1"], own["k2"]]
    return LensPrior(lens, np.maximum(np.array(spread), FLOOR))


def write_board(path: Path, board: Board) -> None:
    """Write a board to print at 100 % on A4 paper, as PDF.

    Raises
    ------
    SetupError
        If the board does not fit the paper.
    """
    size = np.array([board.columns + 1, board.rows + 1]) * board.square_m
    if np.any(size > np.array(A4_M) - 0.01):
        raise SetupError(
            f"a board of {1e3 * size[0]:.0f} × {1e3 * size[1]:.0f} mm does not fit A4 paper",
            hint="Choose fewer or smaller squares.",
        )
    cells = (board.columns + 1, board.rows + 1)
    pixels = (cells[0] * 96, cells[1] * 96)
    if board.charuco:
        picture = np.asarray(board.opencv().generateImage(pixels))
    else:
        parity = np.add.outer(np.arange(cells[1]), np.arange(cells[0])) % 2
        small = (255 * parity).astype(np.uint8)
        picture = np.asarray(cv2.resize(small, pixels, interpolation=cv2.INTER_NEAREST))
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"svg.hashsalt": "board"}):
        figure = Figure(figsize=(A4_M[0] / 0.0254, A4_M[1] / 0.0254))
        left, bottom = (np.array(A4_M) - size) / 2.0 / A4_M
        axes = figure.add_axes((left, bottom, size[0] / A4_M[0], size[1] / A4_M[1]))
        axes.imshow(picture, cmap="gray", vmin=0, vmax=255, interpolation="nearest", aspect="auto")
        axes.set_axis_off()
        note = f"print at 100 %; each square {1e3 * board.square_m:g} mm; measure it before use"
        figure.text(0.5, 0.015, note, ha="center", fontsize=7)
        with written_whole(path) as temporary:
            figure.savefig(temporary, format="pdf")
