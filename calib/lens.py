"""Lens from pictures of a chessboard or ChArUco board, and how good it is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.camera import Lens, rotation_matrix
from metrology import CalibrationError

__all__ = ["Board", "BoardView", "LensCalibration", "calibrate_lens", "find_board"]

FloatArray = NDArray[np.float64]
GrayImage = NDArray[np.uint8]

LEAST_VIEWS = 6
LEAST_TILT_SPREAD = np.radians(8.0)
LEAST_COVERAGE = 0.35
OUTLIER_AT = 3.5
FOLDS = 12


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


@dataclass(frozen=True, eq=False)
class LensCalibration:
    """A lens and how well it is known.

    Attributes
    ----------
    lens : Lens
    std : dict of str to float
        Standard uncertainty of each parameter, by its name in `Lens`.
    held_out_rms_px : float
        Reprojection error in views that took no part in the fit, as far out as that fit reaches.
    rms_px : float
        Reprojection error in the views of the fit.
    used, dropped : tuple of str
        Names of the pictures used, and of those left out as outliers.
    coverage : float
        Share of the picture's area the corners cover.
    warnings : tuple of str
    """

    lens: Lens
    std: dict[str, float]
    held_out_rms_px: float
    rms_px: float
    used: tuple[str, ...]
    dropped: tuple[str, ...]
    coverage: float
    warnings: tuple[str, ...] = ()


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
        detector = cv2.aruco.CharucoDetector(board.opencv())
        corners, labels, _, _ = detector.detectBoard(image)
        if labels is None or len(labels) < 6:
            mirrored = detector.detectBoard(np.ascontiguousarray(image[:, ::-1]))[1]
            if mirrored is not None and len(mirrored) >= 6:
                raise CalibrationError(
                    f"{name or 'the picture'} shows the board mirrored",
                    hint="Switch off the camera's mirror (selfie) mode.",
                )
            return None
        points = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
        return BoardView(name, size, board.points[np.asarray(labels).ravel()], points)
    found, corners = cv2.findChessboardCornersSB(
        image, (board.columns, board.rows), flags=cv2.CALIB_CB_ACCURACY
    )
    if not found:
        found, corners = cv2.findChessboardCorners(image, (board.columns, board.rows))
        if not found:
            return None
        criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
        corners = cv2.cornerSubPix(image, corners, (5, 5), (-1, -1), criteria)
    points = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    return BoardView(name, size, board.points, points)


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
            hint=f"At least {LEAST_VIEWS} are needed, better 15, tilted in different directions.",
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
    kept, dropped = seen, []
    for _ in range(3):
        fit = _fit(kept)
        limit = _outlier_limit(fit.view_rms)
        bad = [v for v, rms in zip(kept, fit.view_rms, strict=True) if rms > limit]
        if not bad or len(kept) - len(bad) < LEAST_VIEWS:
            break
        dropped += bad
        kept = [view for view in kept if view not in bad]
    fit = _fit(kept)
    spread = _tilt_spread(fit.turns)
    if spread < LEAST_TILT_SPREAD:
        raise CalibrationError(
            f"all views are alike: the board's tilt varies by only {np.degrees(spread):.1f} deg",
            hint="Tilt the board by 20 to 40 degrees, to all sides.",
        )
    coverage = _coverage(kept)
    notes = [f"left out as outliers: {', '.join(view.name for view in dropped)}"] if dropped else []
    if coverage < LEAST_COVERAGE:
        notes.append(
            f"the board covers only {100 * coverage:.0f} % of the picture: "
            "distortion outside is extrapolated; hold the board into the corners too"
        )
    return LensCalibration(
        lens=fit.lens,
        std=fit.std,
        held_out_rms_px=_held_out(kept, fit),
        rms_px=fit.rms,
        used=tuple(view.name for view in kept),
        dropped=tuple(view.name for view in dropped),
        coverage=coverage,
        warnings=tuple(notes),
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    lens: Lens
    std: dict[str, float]
    rms: float
    view_rms: FloatArray
    turns: FloatArray
    shifts: FloatArray


def _fit(views: Sequence[BoardView]) -> _Fit:
    """Lens and poses; the board is taken to be flat.

    Fitting the board's shape too lowers the error of the fit and raises that of held-out views.
    """
    unset: Any = None
    rms, matrix, distortion, turns, shifts, deviations, _, per_view = cv2.calibrateCameraExtended(
        [view.board_m.astype(np.float32) for view in views],
        [view.points_px.astype(np.float32)[:, np.newaxis] for view in views],
        views[0].size,
        unset,
        unset,
    )
    k1, k2, p1, p2, k3 = (float(value) for value in np.ravel(distortion)[:5])
    fx, fy, cx, cy = (float(matrix[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    lens = Lens(*views[0].size, fx, fy, cx, cy, k1, k2, p1, p2, k3)
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    std = dict(zip(names, (float(s) for s in np.ravel(deviations)[:9]), strict=True))
    return _Fit(
        lens=lens,
        std=std,
        rms=float(rms),
        view_rms=np.ravel(per_view).astype(np.float64),
        turns=np.array([np.ravel(turn) for turn in turns], dtype=np.float64),
        shifts=np.array([np.ravel(shift) for shift in shifts], dtype=np.float64),
    )


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


def _held_out(views: Sequence[BoardView], whole: _Fit) -> float:
    """Reprojection error of views not used in the fit, root mean square over all corners, px.

    The pose of a held-out view is its own; only lens and board come from the others. Corners
    farther out than three views of the fit reach are left out: a polynomial says nothing there.
    """
    squares: list[float] = []
    folds = min(FOLDS, len(views) // 2)
    for fold in range(folds):
        training = [view for i, view in enumerate(views) if i % folds != fold]
        fit = _fit(training)
        centre = [fit.lens.cx, fit.lens.cy]
        reach = sorted(np.linalg.norm(v.points_px - centre, axis=1).max() for v in training)[-3]
        lens = (fit.lens.matrix, fit.lens.coefficients)
        for index in range(fold, len(views), folds):
            view = views[index]
            board = view.board_m
            turn, shift = cv2.solvePnPRefineLM(
                board, view.points_px, *lens, whole.turns[index].copy(), whole.shifts[index].copy()
            )
            seen = np.asarray(cv2.projectPoints(board, turn, shift, *lens)[0])[:, 0]
            within = np.linalg.norm(view.points_px - centre, axis=1) <= reach
            squares += list(((seen - view.points_px) ** 2).sum(axis=1)[within])
    return float(np.sqrt(np.mean(squares)))
