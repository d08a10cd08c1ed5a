"""Calibrate a lens from board pictures; read and write lens files.

Lens, poses and shape of the board are fitted to the corners of many views in one robust bundle
adjustment (B. Triggs et al., *Bundle adjustment: a modern synthesis*, 1999): the poses are
eliminated view by view, and the shared parameters solved for. A printed board is never flat nor its
squares equal, so the corners' true positions can be fitted, too.

Files are `lens.toml` (a lens with its uncertainties), and YAML of OpenCV or ROS. OpenCV's
``FileStorage`` writes YAML 1.0 with matrices tagged ``opencv-matrix`` (``camera_matrix``,
``distortion_coefficients``); the ROS message CameraInfo, as ``camera_calibration`` stores it, has
the same names with plain lists, and a ``distortion_model``. Both count pixel centres from 0 and use
OpenCV's order of coefficients.
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

from calib.board import BoardView
from calib.camera import Lens, rotation_matrix
from metrology import (
    CalibrationError,
    SetupError,
    parse_toml,
    read_small_text,
    write_text_whole,
)
from metrology.least_squares import Downhill, descend, minimise

__all__ = [
    "LENS_MODELS",
    "LENS_PARAMETERS",
    "MIN_LENS_STD",
    "YAML_SUFFIXES",
    "BoardFit",
    "LensPrior",
    "calibrate_lens",
    "fit_boards",
    "held_out_errors",
    "lens_toml",
    "lens_yaml",
    "prior_of",
    "prior_toml",
    "read_lens",
    "read_lens_yaml",
    "write_lens",
]

FloatArray = NDArray[np.float64]

GrayImage = NDArray[np.uint8]

IntArray = NDArray[np.int64]

LENS_PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")

MAX_BOARD_STEPS = 25
"""Maximum number of Levenberg-Marquardt steps (chosen)."""

BOARD_CONVERGENCE = 1e-4
"""Relative change of the cost at convergence (derived: with a hundred points, a hundredth of the
chi² that moves a parameter by its std)."""

COEFFICIENT_STD = 1.0
"""Prior std of distortion coefficients, 1 (chosen: any lens that gives a picture)."""

SHAPE_STD = 0.02
"""Prior std of a corner's position on paper or cardboard, fraction of a square (chosen)."""

CORNER_SOFT_SIGMAS = 4.0
"""Error from which a corner loses weight (Geman-McClure), standard deviations (derived: exceeded by
one in 3000 of normal errors in two directions)."""

MIN_CORNER_NOISE_PX = 0.01
"""Minimum noise of a corner, px (chosen), so that exact corners have finite weight."""

BOARD_DECIMALS = 9
"""Decimals of positions in m (chosen: a nanometre distinguishes the corners of any board)."""


@dataclass(frozen=True)
class LensModel:
    """A model to fit.

    Attributes
    ----------
    name : str
        Description.
    coefficients : int
        Distortion coefficients, of OpenCV's: 5 for Brown's polynomial, 8 for a ratio.
    shaped : bool
        Whether the board's corners may deviate from their nominal positions.
    """

    name: str
    coefficients: int
    shaped: bool


LENS_MODELS = (
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
    lens : (4 + coefficients,) array
        fx, fy, cx, cy, then the coefficients in OpenCV's order.
    covariance : array
        Of `lens`, square, for corners with the noise `noise_px`.
    board, shape : (P, 3) arrays
        Nominal and fitted positions of the board's corners, m.
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
        return Lens(*size, **dict(zip(LENS_PARAMETERS, self.lens.tolist(), strict=False)))


@dataclass(frozen=True, eq=False)
class _Corners:
    """Corners of all views, each with its index in the board's corners."""

    places: tuple[IntArray, ...]
    px: tuple[FloatArray, ...]
    board: FloatArray
    square: float


@dataclass(frozen=True, eq=False)
class _Equations:
    """Normal equations with the poses eliminated, and the terms that give the poses."""

    reduced: FloatArray
    right: FloatArray
    poses: tuple[tuple[FloatArray, FloatArray, FloatArray], ...]
    cost: float
    noise: float


@dataclass(frozen=True, eq=False)
class _BoardStep:
    """A step (L,) of lens and board, and its equations."""

    equations: _Equations
    step: FloatArray


def _corners(views: Sequence[BoardView]) -> _Corners:
    every = np.concatenate([view.board_m for view in views])
    board, where = np.unique(np.round(every, BOARD_DECIMALS), axis=0, return_inverse=True)
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
    start : BoardFit, optional
        A fit to the same views, with this or a simpler model; without it OpenCV's own fit.
    """
    corners = _corners(views)
    fit = _opencv_fit(views, corners) if start is None else start
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
        settled=lambda seen, reached: seen.cost - reached < BOARD_CONVERGENCE * seen.cost,
        most_steps=MAX_BOARD_STEPS,
    )
    equations = _equations(fit, corners, fit.noise_px)
    size = len(fit.lens)
    shared = np.asarray(np.linalg.inv(equations.reduced), dtype=float)
    return replace(fit, covariance=shared[:size, :size])


def held_out_errors(fit: BoardFit, view: BoardView, pose: FloatArray) -> FloatArray:
    """Errors (N, 2), px, of a view not used in the fit, at its best pose.

    Parameters
    ----------
    fit : BoardFit
        Lens and board.
    view : BoardView
        Another view of the same board.
    pose : (6,) array
        Approximate pose.
    """
    order = {tuple(key): place for key, place in zip(fit.board, fit.shape, strict=True)}
    points = np.array(
        [order.get(tuple(key), key) for key in np.round(view.board_m, BOARD_DECIMALS)]
    )

    def missed(pose: FloatArray) -> FloatArray:
        return (_projected(points, pose, fit.lens)[0] - view.points_px).ravel()

    def slopes(pose: FloatArray) -> FloatArray:
        return _projected(points, pose, fit.lens)[1][:, :6]

    pose = minimise(missed, pose, slopes=slopes).values
    return _projected(points, pose, fit.lens)[0] - view.points_px


def _opencv_fit(views: Sequence[BoardView], corners: _Corners) -> BoardFit:
    """OpenCV's fit of Brown's polynomial with a flat board."""
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
    return BoardFit(
        LENS_MODELS[0], lens, np.zeros((9, 9)), corners.board, corners.board, poses, (), 1.0
    )


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
    noise = max(1.4826 * float(np.median(np.abs(values))), MIN_CORNER_NOISE_PX)
    return replace(fit, errors=errors, noise_px=noise)


def _weights(error: FloatArray, noise: float) -> FloatArray:
    """Weights (2 N,) of the corners of a view, small for outliers."""
    weight = 1.0 / (1.0 + (error**2).sum(axis=1) / (CORNER_SOFT_SIGMAS * noise) ** 2)
    return np.repeat(weight, 2) / noise**2


def _cost(fit: BoardFit, corners: _Corners, noise: float) -> float:
    square = np.concatenate([(error**2).sum(axis=1) for error in fit.errors])
    soft = (CORNER_SOFT_SIGMAS * noise) ** 2
    total = float(np.sum(soft * np.log1p(square / soft))) / noise**2
    off = (fit.shape - fit.board) / (SHAPE_STD * corners.square)
    return total + float((fit.lens[4:] ** 2).sum()) / COEFFICIENT_STD**2 + float((off**2).sum())


def _equations(fit: BoardFit, corners: _Corners, noise: float) -> _Equations:
    lens, count = len(fit.lens), len(fit.board)
    size = lens + (3 * count if fit.model.shaped else 0)
    reduced, right = np.zeros((size, size)), np.zeros(size)
    # Views with equal tilt do not determine the focal length; the prior keeps it finite.
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
            # A corner moves in the camera's axes as the board's translation does.
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


MAX_PRIOR_POINTS = 600
"""Maximum number of points for comparing lens models (chosen: ample for five parameters)."""

MIN_LENS_STD: FloatArray = np.array([1e-4, 0.05, 0.05, 1e-4, 1e-4])
"""Minimum std of relative focal length, principal point (px), k1, k2 (chosen: changes from focusing
and warming up)."""


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
        std = np.maximum(self.std * [1.0, sx, sy, 1.0, 1.0], MIN_LENS_STD)
        return LensPrior(self.lens.resized(width, height), std, self.correlation)


def prior_of(lens: Lens, covariance: FloatArray, seen_px: FloatArray) -> LensPrior:
    """Uncertainty of a lens in the five parameters that are fitted to a clip.

    The parameters of a rich model are correlated; what matters is the uncertainty of positions in
    the picture. The five get the covariance that gives the same.

    Parameters
    ----------
    covariance : (P, P) array
        Of fx, fy, cx, cy and the distortion coefficients in OpenCV's order.
    seen_px : (N, 2) array
        Positions in the picture at which the lens was measured.
    """
    chosen = seen_px[np.unique(np.linspace(0, len(seen_px) - 1, MAX_PRIOR_POINTS).astype(int))]
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
    return LensPrior(lens, np.maximum(std, MIN_LENS_STD), five / np.outer(std, std))


YAML_SUFFIXES = (".yaml", ".yml")

_MAX_LENS_FILE_BYTES = 2**20
"""Maximum size of a lens file, bytes (chosen: a thousand times the usual one, so that a clip passed
by mistake is not read)."""

_MAX_ENTRY_NUMBERS = 64
"""Maximum number of values in one entry (derived: OpenCV's longest model has fourteen)."""

_ROS_MODELS = ("plumb_bob", "rational_polynomial")
"""Supported distortion models of ROS; ``equidistant`` is another model."""

UNSTATED_LENS_STD: FloatArray = np.array([2e-3, 2.0, 2.0, 5e-3, 1e-2])
"""Std of log focal length, principal point (px), k1, k2 where the file states none (chosen: a dozen
board pictures; Udacity's 27 of 1280 × 960 px give 1.3e-3, 1.1, 0.9, 2e-3, 3e-3)."""


def _parsed_yaml(text: str) -> Any:
    """Parse YAML without objects except OpenCV's matrices; ValueError if it is not YAML."""
    # Imported here since few clips need it.
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
    """Read a lens file of OpenCV or ROS.

    Raises
    ------
    SetupError
        If it can't be read, lacks the camera matrix or the picture size, or has an unsupported
        distortion model.
    """
    table = _document(path)
    camera, bent = _numbers(table, "camera_matrix", path), table.get("distortion_coefficients")
    if camera is None or camera.size != 9:
        raise SetupError(
            f"{path} has no camera_matrix of 3 × 3",
            hint="Write it with OpenCV or ROS, or use TOML.",
        )
    model = table.get("distortion_model", _ROS_MODELS[0])
    if model not in _ROS_MODELS:
        raise SetupError(
            f"{path}: distortion model {model!r} is not supported",
            hint=f"Supported: {', '.join(_ROS_MODELS)}.",
        )
    coefficients = np.zeros(0) if bent is None else _numbers(table, "distortion_coefficients", path)
    assert coefficients is not None
    if coefficients.size > 8 and np.any(coefficients[8:]):
        raise SetupError(
            f"{path}: thin-prism and tilted-sensor coefficients are not supported",
            hint="Calibrate the lens again with at most eight: k1 k2 p1 p2 k3 k4 k5 k6.",
        )
    try:
        width, height = (int(table[f"image_{name}"]) for name in ("width", "height"))
    except (KeyError, TypeError, ValueError) as problem:
        raise SetupError(
            f"{path} does not state the size of its pictures",
            hint="Add image_width and image_height.",
        ) from problem
    fx, _, cx, _, fy, cy = camera.ravel()[:6]
    lens = Lens(width, height, fx, fy, cx, cy, *coefficients[:8].tolist())
    if width < 1 or height < 1 or fx <= 0.0 or fy <= 0.0:
        raise SetupError(
            f"{path}: the picture size or focal length is not positive",
            hint="Give both in px, above zero.",
        )
    return LensPrior(lens, np.maximum(_std(table, lens, path), MIN_LENS_STD))


def _document(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > _MAX_LENS_FILE_BYTES:
            raise SetupError(
                f"{path} is too large for a lens file",
                hint="A lens file has some twenty numbers; check that this is the right file.",
            )
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        raise SetupError(
            f"can't read the lens file {path}: {problem}",
            hint="Pass a file written by `vision calibrate`, OpenCV or ROS.",
        ) from problem
    # OpenCV's "%YAML:1.0" is not a valid YAML directive.
    text = re.sub(r"\A%YAML[^\n]*\n", "", text.lstrip("\ufeff"))
    try:
        table = _parsed_yaml(text)
    except (ValueError, RecursionError) as problem:
        raise SetupError(
            f"{path} is not YAML: {problem}",
            hint="Write it again: TOML with `vision calibrate`, or YAML with OpenCV or ROS.",
        ) from problem
    if not isinstance(table, dict):
        raise SetupError(
            f"{path} is not a lens file",
            hint="It has no top-level table. Pass a file of `vision calibrate`, OpenCV or ROS.",
        )
    return table


def _numbers(table: dict[str, Any], name: str, path: Path) -> FloatArray | None:
    """A matrix of OpenCV or ROS, or a plain (nested) list, as flat numbers."""
    held = table.get(name)
    if held is None:
        return None
    if isinstance(held, dict):
        held = held.get("data")
    rows: list[Any] = held if isinstance(held, list) else [held]
    # Two levels only: nested YAML references could expand without end.
    flat = [one for row in rows for one in (row if isinstance(row, list) else [row])]
    if len(flat) > _MAX_ENTRY_NUMBERS or any(isinstance(one, list | dict) for one in flat):
        raise SetupError(
            f"{path}: {name} is not a matrix of a lens",
            hint="Write a row of numbers, or rows of three, as OpenCV and ROS do.",
        )
    try:
        values = np.array([float(one) for one in flat])
    except (TypeError, ValueError) as problem:
        raise SetupError(
            f"{path}: {name} is not a matrix of numbers",
            hint="Write a row of numbers, or rows of three, as OpenCV and ROS do.",
        ) from problem
    if not np.isfinite(values).all():
        raise SetupError(
            f"{path}: {name} is not finite",
            hint="Calibrate the lens again: an entry is nan or inf.",
        )
    return values


def _std(table: dict[str, Any], lens: Lens, path: Path) -> FloatArray:
    """Std of log focal length, principal point, k1, k2, as OpenCV's ``stdDeviationsIntrinsics``."""
    stated = _numbers(table, "std_deviation_intrinsics", path)
    if stated is None or stated.size < 6:
        return UNSTATED_LENS_STD
    fx, _, cx, cy, k1, k2 = stated[:6]
    return np.array([fx / lens.fx, cx, cy, k1, k2])


def lens_yaml(prior: LensPrior, name: str = "camera") -> str:
    """Text of a lens file that both OpenCV's FileStorage and ROS can read.

    Parameters
    ----------
    name : str
        Name of the camera, which ROS requires.
    """
    lens = prior.lens
    bent = lens.coefficients
    model = _ROS_MODELS[1] if bent.size > 5 else _ROS_MODELS[0]
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


MIN_VIEWS = 6
"""Minimum number of board views (derived: each gives two equations (Zhang 2000) for ten unknowns;
one more reveals errors)."""

MIN_TILT_RANGE = np.radians(8.0)
"""Minimum range of tilts, rad (derived): perpendicular views determine only the ratio of focal
length and distance (Zhang 2000); 8° changes the scale across a board, a fifth of its distance wide,
by 3 %."""

MIN_BOARD_COVERAGE = 0.35
"""Minimum covered fraction of the picture (derived): a third of the area ends at 0.6 of the
corner's radius, where k1 acts a fifth as much, since distortion grows with the radius cubed."""

VIEW_OUTLIER_SIGMAS = 3.5
"""Outlier limit of a view, robust standard deviations (derived: one in some thousands exceeds
it)."""

MAX_FOLDS = 8
"""Maximum number of cross-validation folds (chosen: a fit to 7/8 is nearly as good as to all)."""

RICHER_ERROR_RATIO = 0.97
"""Held-out error of a richer model over the simpler one's, below which it is preferred (chosen)."""


@dataclass(frozen=True, eq=False)
class LensCalibration:
    """A lens and its uncertainty.

    Attributes
    ----------
    std : dict of str to float
        Standard uncertainty of each parameter, by its name in `Lens`.
    prior : LensPrior
        The same as a clip's calibration uses it, with correlations.
    held_out_rms_px : float
        Reprojection error by cross-validation in at most 8 folds: lens and board are fitted to the
        other folds, and each held-out view gets its best pose; root mean square distance between
        projected and measured corners.
    rms_px : float
        Reprojection error in the views of the fit.
    used, dropped : tuple of str
        Names of the pictures used, and of those dropped as outliers.
    coverage : float
        Fraction of the picture covered by corners.
    model : str
        The simplest model with about the lowest held-out error.
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

    Raises
    ------
    CalibrationError
        If there are too few views, or all are alike.
    """
    seen = [view for view in views if view is not None]
    _refuse_few_or_unlike(seen, len(views))
    fits, kept, dropped = _without_outliers(seen)
    spread = _tilt_spread(fits[-1].poses[:, :3])
    if spread < MIN_TILT_RANGE:
        raise CalibrationError(
            f"all views are alike: the board's tilt varies by only {np.degrees(spread):.1f} deg",
            hint="Tilt the board by 20 to 40 degrees in all directions.",
        )
    fit, held_out = _chosen(fits, kept)
    lens = fit.to_lens(kept[0].size)
    # Residuals are not all noise: scale the covariance to the held-out error.
    covariance = fit.covariance * max(1.0, 0.5 * held_out**2 / fit.noise_px**2)
    std = dict(zip(LENS_PARAMETERS, np.sqrt(np.diag(covariance)).tolist(), strict=False))
    coverage = _coverage(kept)
    notes = [f"dropped as outliers: {', '.join(view.name for view in dropped)}"] if dropped else []
    if coverage < MIN_BOARD_COVERAGE:
        notes.append(
            f"the board covers only {100 * coverage:.0f} % of the picture; outside, distortion is "
            "extrapolated. Take pictures with the board in the corners, too"
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


def _refuse_few_or_unlike(seen: list[BoardView], pictures: int) -> None:
    if not seen:
        raise CalibrationError(
            f"no board found in {pictures} pictures",
            hint="Check the board's size: it counts inner corners, one less than squares. For one"
            " with markers pass --charuco, and --dictionary and --marker if they are not found.",
        )
    if len(seen) < MIN_VIEWS:
        raise CalibrationError(
            f"the board was found in only {len(seen)} of {pictures} pictures",
            hint=f"At least {MIN_VIEWS} are needed, better 15, tilted in different directions; "
            "the board's size counts inner corners.",
        )
    if len({view.size for view in seen}) > 1:
        # Cameras that crop differ by a pixel or two between modes; the most frequent size is used.
        sizes = [view.size for view in seen]
        common = max(set(sizes), key=sizes.count)
        odd = [view for view in seen if max(abs(np.subtract(view.size, common))) > 2]
        if odd:
            raise CalibrationError(
                f"{odd[0].name} is {odd[0].size[0]}×{odd[0].size[1]} px, the others are not",
                hint="Use pictures of one camera in one mode.",
            )


def _without_outliers(
    views: list[BoardView],
) -> tuple[list[BoardFit], list[BoardView], list[BoardView]]:
    """Fits of all models to the views that agree, those views, and the dropped ones.

    The richest model decides: a simpler one would drop the views that extend farthest out.
    """
    kept, dropped = views, list[BoardView]()
    for _ in range(3):
        fits = _fits(kept)
        rms = fits[-1].view_rms_px
        bad = [v for v, value in zip(kept, rms, strict=True) if value > _outlier_limit(rms)]
        if not bad or len(kept) - len(bad) < MIN_VIEWS:
            return fits, kept, dropped
        dropped += bad
        kept = [view for view in kept if view not in bad]
    return _fits(kept), kept, dropped


def _fits(views: Sequence[BoardView]) -> list[BoardFit]:
    fits: list[BoardFit] = []
    for model in LENS_MODELS:
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
    return middle + VIEW_OUTLIER_SIGMAS * max(spread, 0.05 * middle)


def _tilt_spread(turns: FloatArray) -> float:
    """Largest angle between the boards' normals, rad."""
    normals = np.array([rotation_matrix(turn)[:, 2] for turn in turns])
    return float(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max())


def _coverage(views: Sequence[BoardView]) -> float:
    """Fraction of the picture within the convex hull of some view's corners."""
    width, height = views[0].size
    covered = np.zeros((60, 80), dtype=np.uint8)
    for view in views:
        hull = cv2.convexHull((view.points_px * [80 / width, 60 / height]).astype(np.float32))
        cv2.fillConvexPoly(covered, np.round(hull).astype(np.int32), 1)
    return float(covered.mean())


def _held_out(views: Sequence[BoardView], whole: BoardFit) -> float:
    """Cross-validated reprojection error, root mean square over all corners, px.

    Only the pose of a held-out view is fitted to it.
    """
    squares: list[float] = []
    folds = min(MAX_FOLDS, len(views) // 2)
    for fold in range(folds):
        training = [index for index in range(len(views)) if index % folds != fold]
        start = replace(whole, poses=whole.poses[training])
        fit = fit_boards([views[index] for index in training], whole.model, start)
        for index in range(fold, len(views), folds):
            error = held_out_errors(fit, views[index], whole.poses[index])
            squares += list((error**2).sum(axis=1))
    return float(np.sqrt(np.mean(squares)))


def lens_toml(calibration: LensCalibration) -> str:
    """Text of a lens file."""
    lens = calibration.lens
    lines = ["[lens]", f"width = {lens.width}", f"height = {lens.height}"]
    lines += [f"{name} = {getattr(lens, name)!r}" for name in LENS_PARAMETERS]
    lines += ["", "[std]"]
    lines += [f"{name} = {calibration.std.get(name, 0.0)!r}" for name in LENS_PARAMETERS]
    lines += [
        "",
        "[prior]",
        "# std and correlation of log focal length, principal point x and y (px), k1 and k2",
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
    """Write a lens file atomically: YAML for OpenCV and ROS if its suffix is .yaml or .yml."""
    if path.suffix.lower() in YAML_SUFFIXES:
        write_text_whole(path, lens_yaml(calibration.prior, path.stem))
    else:
        write_text_whole(path, lens_toml(calibration))


def prior_toml(prior: LensPrior) -> str:
    """Text of a lens file for a lens read from elsewhere."""
    lens = prior.lens
    lines = ["[lens]", f"width = {lens.width}", f"height = {lens.height}"]
    lines += [f"{name} = {float(getattr(lens, name))!r}" for name in LENS_PARAMETERS]
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
    width, height : int, optional
        Size of the clip's picture; the lens is scaled to it. The clip must show the whole picture.

    Raises
    ------
    SetupError
        If the file is missing or invalid, or its picture has another aspect ratio.
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
    missing = [n for n in ("width", "height", *LENS_PARAMETERS[:4]) if n not in numbers]
    if missing:
        raise SetupError(
            f"{path} lacks {', '.join(missing)} in its table [lens]",
            hint="Write it again with `vision calibrate lens`.",
        )
    lens = Lens(
        int(numbers["width"]),
        int(numbers["height"]),
        *(float(numbers.get(name, 0.0)) for name in LENS_PARAMETERS),
    )
    return _for_picture(_prior(lens, table, path), width, height)


def _for_picture(prior: LensPrior, width: int | None, height: int | None) -> LensPrior:
    """The lens scaled to a picture of the same aspect ratio."""
    lens = prior.lens
    if width is None or height is None:
        return prior
    if abs(width / height - lens.width / lens.height) > 0.01 * width / height:
        raise SetupError(
            f"the lens was calibrated at {lens.width}×{lens.height} px, the clip has "
            f"{width}×{height}: another aspect ratio",
            hint="Calibrate in the mode used for filming: other modes crop the sensor.",
        )
    return prior.resized(width, height)


def _prior(lens: Lens, table: dict[str, Any], path: Path) -> LensPrior:
    """Uncertainty in the file: with correlations, or of each parameter."""
    given = table.get("prior", {})
    if "std" in given and "correlation" in given:
        std, related = (np.asarray(given[key], dtype=float) for key in ("std", "correlation"))
        if std.shape != (5,) or related.shape != (5, 5):
            raise SetupError(
                f"the table [prior] of {path} needs 5 and 5 × 5 numbers",
                hint="Write it again with `vision calibrate lens`.",
            )
        return LensPrior(lens, np.maximum(std, MIN_LENS_STD), related)
    own = {name: float(table.get("std", {}).get(name, 0.0)) for name in LENS_PARAMETERS}
    spread = [own["fx"] / lens.fx, own["cx"], own["cy"], own["k1"], own["k2"]]
    return LensPrior(lens, np.maximum(np.array(spread), MIN_LENS_STD))
