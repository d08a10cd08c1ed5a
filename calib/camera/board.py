"""A calibration board, and where its corners are in a picture."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology import CalibrationError

__all__ = ["Board", "BoardView", "find_board"]

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
