"""Calibration boards: print them, and find their corners in pictures."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology import CalibrationError, SetupError, UsageError, written_whole

__all__ = ["DICTIONARIES", "Board", "BoardView", "dictionary_from", "find_board", "write_board"]

FloatArray = NDArray[np.float64]

GrayImage = NDArray[np.uint8]

DICTIONARIES: dict[str, int] = {
    name.removeprefix("DICT_").upper(): int(getattr(cv2.aruco, name))
    for name in dir(cv2.aruco)
    if name.startswith("DICT_")
}
"""OpenCV's predefined dictionaries of markers."""

_FAMILIES = tuple(
    name
    for name in DICTIONARIES
    if not name.endswith(("X4_50", "X5_50", "X6_50", "X7_50", "_100", "_250"))
)
"""Those of which the others are beginnings."""

PRINTED_DICTIONARY, PRINTED_MARKER_RATIO = "5X5_250", 0.75
"""Dictionary of printed boards, and side of their markers over that of a square (chosen)."""

MIN_MARKERS = 4
"""Minimum number of markers that identify a board (derived: a homography has four points)."""

A4_M = (0.297, 0.210)
"""Size of the sheet, m (convention: ISO 216)."""

MIN_CHARUCO_CORNERS = 6
"""Minimum number of corners of a ChArUco board (derived: a homography needs four; half as many
again test the plane)."""

CORNER_WINDOW_FRACTION = 0.35
"""Half width of the corner search over the smallest corner distance (derived: below a half, so that
no window contains a neighbour)."""

MAX_CORNER_WINDOW_PX = 5
"""Maximum half width, px (chosen): an edge is 1 to 2 px wide; larger windows include distortion."""


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
        Whether there are markers in the white squares.
    dictionary : str or None
        Of the markers ("4X4_50"); None: found in each picture, and `PRINTED_DICTIONARY` for print.
    marker_m : float or None
        Side of a marker, m; None: likewise, and `PRINTED_MARKER_RATIO` of a square for print.
    old_layout : bool
        Whether the markers are placed as by OpenCV before 4.6.
    """

    columns: int
    rows: int
    square_m: float = 0.025
    charuco: bool = False
    dictionary: str | None = None
    marker_m: float | None = None
    old_layout: bool = False

    @property
    def points(self) -> FloatArray:
        """Corners on the board, (columns * rows, 3), m, row by row."""
        rows, columns = np.mgrid[: self.rows, : self.columns]
        flat = np.stack([columns, rows, np.zeros_like(rows)], axis=-1).reshape(-1, 3)
        return np.asarray(flat * self.square_m, dtype=np.float64)

    def opencv(self) -> cv2.aruco.CharucoBoard:
        """The ChArUco board as an OpenCV object."""
        name = self.dictionary or PRINTED_DICTIONARY
        markers = cv2.aruco.getPredefinedDictionary(DICTIONARIES[name])
        size = (self.columns + 1, self.rows + 1)
        side = self.marker_m or PRINTED_MARKER_RATIO * self.square_m
        board = cv2.aruco.CharucoBoard(size, self.square_m, side, markers)
        board.setLegacyPattern(self.old_layout)
        return board


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
    name : str
        Name of the picture.

    Raises
    ------
    CalibrationError
        If a ChArUco board appears mirrored.
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
    known = _recognised(image, board)
    if known is None:
        if _recognised(np.ascontiguousarray(image[:, ::-1]), board) is not None:
            raise CalibrationError(
                f"{name or 'the picture'} shows the board mirrored",
                hint="Switch off the camera's mirror (selfie) mode.",
            )
        return None
    corners, labels, _, _ = cv2.aruco.CharucoDetector(known.opencv()).detectBoard(image)
    if labels is None or len(labels) < MIN_CHARUCO_CORNERS:
        return None
    points = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    return BoardView(name, size, board.points[np.asarray(labels).ravel()], points)


def _recognised(image: GrayImage, board: Board) -> Board | None:
    """The board with the dictionary, layout and marker size seen in a picture."""
    names = [board.dictionary] if board.dictionary else list(_FAMILIES)
    seen = [(name, *_markers(image, name)) for name in names]
    name, quads, labels = max(seen, key=lambda one: len(one[2]))
    if len(labels) < MIN_MARKERS:
        return None
    fits = [
        fit
        for old in (False, True)
        if (fit := _fit(replace(board, dictionary=name, old_layout=old), quads, labels)) is not None
    ]
    return min(fits, key=lambda fit: fit[1])[0] if fits else None


def _markers(image: GrayImage, name: str) -> tuple[FloatArray, NDArray[np.int64]]:
    """Corners (N, 4, 2) of the markers of a dictionary, px, and their numbers."""
    family = cv2.aruco.getPredefinedDictionary(DICTIONARIES[name])
    corners, labels, _ = cv2.aruco.ArucoDetector(family).detectMarkers(image)
    if not len(corners):
        return np.zeros((0, 4, 2)), np.zeros(0, dtype=np.int64)
    quads = np.asarray(corners, dtype=np.float64).reshape(-1, 4, 2)
    return quads, np.asarray(labels, dtype=np.int64).ravel()


def _fit(board: Board, quads: FloatArray, labels: NDArray[np.int64]) -> tuple[Board, float] | None:
    """The board with its markers' side, and the misfit of their centres in squares."""
    places = [np.asarray(one)[:, :2] for one in board.opencv().getObjPoints()]
    used = labels < len(places)
    if used.sum() < MIN_MARKERS:
        return None
    centres = np.array([places[label].mean(axis=0) for label in labels[used]])
    seen = quads[used].mean(axis=1)
    found: Any = cv2.findHomography(seen, centres, cv2.RANSAC, 0.2 * board.square_m)
    matrix, inside = found
    if matrix is None or int(np.sum(inside)) < MIN_MARKERS:
        return None
    flat = cv2.perspectiveTransform(quads[used].reshape(-1, 1, 2), matrix).reshape(-1, 4, 2)
    sides = np.linalg.norm(flat - np.roll(flat, 1, axis=1), axis=2)
    misfit = float(np.median(np.linalg.norm(flat.mean(axis=1) - centres, axis=1))) / board.square_m
    missed = 1.0 - float(np.mean(inside))
    side = board.marker_m or min(float(np.median(sides)), 0.99 * board.square_m)
    return replace(board, marker_m=side), misfit + missed


def _refined(image: GrayImage, points: FloatArray, board: Board) -> FloatArray:
    """Corners where the gradients around them meet, rows running to the right.

    The window excludes the neighbours: a second corner in it would bias the first.
    """
    table = points.reshape(board.rows, board.columns, 2)
    # A board turned by 180° looks the same; all views need one order, since it may not be flat.
    if (table[:, -1] - table[:, 0]).mean(axis=0)[0] < 0.0:
        table = table[::-1, ::-1]
    apart = min(
        float(np.linalg.norm(np.diff(table, axis=axis), axis=-1).min()) for axis in range(2)
    )
    half = int(np.clip(CORNER_WINDOW_FRACTION * apart, 2, MAX_CORNER_WINDOW_PX))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    start = np.ascontiguousarray(table.reshape(-1, 1, 2), dtype=np.float32)
    refined = cv2.cornerSubPix(image, start, (half, half), (-1, -1), criteria)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)


def dictionary_from(text: str) -> str:
    """Name of a dictionary as typed: "4x4_50", "DICT_4X4_50".

    Raises
    ------
    UsageError
        If there is none of that name.
    """
    name = text.strip().upper().removeprefix("DICT_")
    if name not in DICTIONARIES:
        listed = ", ".join(sorted(set(DICTIONARIES)))
        raise UsageError(f"there is no dictionary {text!r}", hint=f"There are {listed}.")
    return name


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
