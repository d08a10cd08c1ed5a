"""Wall grid between four handles that a person sets.

The image between them is rectified and searched for lines. Without lines the handles themselves
are the grid.
"""

from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.grid import GridMap, WallGrid, find_wall_grid, refitted
from metrology import CalibrationError, UsageError

__all__ = ["WallSource", "grid_from_corners", "starting_corners"]

FloatArray = NDArray[np.float64]

WallSource = Literal["found", "corners", "hand"]
"""Grid found automatically, measured between the handles, or only the handles themselves."""

HANDLE_STD_PX = 0.7
"""px: standard uncertainty of a handle set with the loupe (assumed: half a pixel to one)."""

SQUARE_PX = (32, 60)
"""px per square of the rectified image, smallest and largest: below, fine lines of a tenth alias;
above, it is slow."""

MAX_RECTIFIED_PX = 1400
"""px: largest side of the rectified image (chosen; walls rarely need more)."""

RATIOS = (1, 2, 4, 5, 10)
"""Fine squares per coarse one: common divisions of rulers and grids."""

MAX_RATIO_ERROR = 0.05
"""Relative difference of the measured ratio from the nearest of `RATIOS`; neighbours differ by at
least 20 %."""


def starting_corners(grid: WallGrid | None, size: tuple[int, int]) -> FloatArray:
    """Initial handles, (4, 2): on crossings of the grid, or else inside the image."""
    box = np.array([[0.2, 0.8], [0.8, 0.8], [0.8, 0.2], [0.2, 0.2]]) * (np.array(size) - 1.0)
    if grid is None:
        return box
    used: list[int] = []
    for corner in box:
        far = np.linalg.norm(grid.points_px - corner, axis=1)
        far[used] = np.inf
        used.append(int(np.argmin(far)))
    return np.asarray(grid.points_px[used])


def grid_from_corners(
    picture: NDArray[np.generic],
    corners: FloatArray,
    squares: tuple[int, int],
    *,
    pitch_m: float,
    fine_pitch_m: float | None,
) -> tuple[WallGrid, WallSource]:
    """Measure the grid between four handles.

    Parameters
    ----------
    picture : (H, W) array
    corners : (4, 2) array
        Lower left, lower right, upper right, upper left, px.
    squares : tuple of int
        Squares between them, across and up.
    pitch_m, fine_pitch_m : float
        m.

    Returns
    -------
    WallGrid
        Its origin is the lower left handle.
    source : {"corners", "hand"}
        Whether lines were measured between the handles, or only the handles are used.

    Raises
    ------
    UsageError
        If the handles enclose no area in that order, or no square is between them.
    """
    wide, high = squares
    scale, warp = _straightening(corners, squares)
    height, width = picture.shape
    size = (int(wide * scale) + 1, int(high * scale) + 1)
    gray = np.asarray(picture, dtype=np.float32)
    straight = cv2.warpPerspective(gray, warp, size, flags=cv2.INTER_CUBIC)
    try:
        found = find_wall_grid(straight, pitch_m=pitch_m, fine_pitch_m=fine_pitch_m)
        ratio = _ratio(found, scale)
    except CalibrationError:
        return _by_hand(corners, squares, (width, height), pitch_m), "hand"
    found = replace(found, nodes=found.nodes + np.round(_origin_shift(found, scale)).astype(int))
    return _in_picture(found, warp, corners, (width, height), pitch_m / ratio), "corners"


def _straightening(corners: FloatArray, squares: tuple[int, int]) -> tuple[float, FloatArray]:
    """Px per square, and the homography (3, 3) that rectifies the image between the handles.

    Raises
    ------
    UsageError
        If the handles enclose no area in their order, or no square is between them.
    """
    wide, high = squares
    if wide < 1 or high < 1:
        raise UsageError("no square is between the handles", hint="Enter 1 or more squares.")
    turns = np.diff(np.vstack([corners, corners[:2]]), axis=0)
    cross = turns[:-1, 0] * turns[1:, 1] - turns[:-1, 1] * turns[1:, 0]
    if not (cross < -16.0).all():
        raise UsageError(
            "the four handles are out of order or in a line",
            hint="Order: lower left, lower right, upper right, upper left.",
        )
    sides = np.linalg.norm(turns, axis=1)
    per_square = float(max(sides[[0, 2]].max() / wide, sides[[1, 3]].max() / high))
    scale = float(np.clip(1.2 * per_square, *SQUARE_PX))
    scale = min(scale, MAX_RECTIFIED_PX / max(wide, high))
    flat = np.array([[0, high], [wide, high], [wide, 0], [0, 0]], dtype=np.float64) * scale
    warp = cv2.getPerspectiveTransform(corners.astype(np.float32), flat.astype(np.float32))
    return scale, np.asarray(warp, dtype=np.float64)


def _in_picture(
    found: WallGrid, warp: FloatArray, corners: FloatArray, size: tuple[int, int], pitch_m: float
) -> WallGrid:
    """Map a grid found in the rectified image to the original image."""
    width, height = size
    back = np.asarray(np.linalg.inv(warp), dtype=np.float64)
    jacobian = _jacobian(back, found.points_px)
    points = _moved(back, found.points_px)
    covariance = jacobian @ found.covariance_px2 @ np.swapaxes(jacobian, 1, 2)
    grid_map = _map_through(points, found.nodes.astype(np.float64), (width, height))
    area = np.zeros((height, width), dtype=np.uint8)
    cv2.fillConvexPoly(area, np.round(corners).astype(np.int32), 1)
    return WallGrid(
        size=(width, height),
        pitch_m=pitch_m,
        nodes=found.nodes,
        points_px=points,
        covariance_px2=covariance,
        map=grid_map,
        area=area > 0,
        dark=found.dark,
        fine_ratio=found.fine_ratio,
        origin_m=np.zeros(2),
        warnings=found.warnings,
    )


def _ratio(found: WallGrid, scale: float) -> int:
    """Number of lines' squares per square entered."""
    middle = np.array(found.size) / 2.0
    period = 1.0 / np.linalg.norm(found.map.jacobian(middle), axis=1)
    ratio = scale / float(np.sqrt(period.prod()))
    best = min(RATIOS, key=lambda candidate: abs(np.log(ratio / candidate)))
    if abs(np.log(ratio / best)) > MAX_RATIO_ERROR:
        raise CalibrationError(
            "the lines between the handles do not match the number of squares entered",
            hint="Drag the handles onto crossings of the grid.",
        )
    return best


def _origin_shift(found: WallGrid, scale: float) -> FloatArray:
    """Shift of the nodes that makes the lower left handle (0, 0)."""
    corner = np.array([0.0, found.size[1] - 1.0])
    return -np.asarray(found.map(corner))


def _by_hand(
    corners: FloatArray, squares: tuple[int, int], size: tuple[int, int], pitch_m: float
) -> WallGrid:
    wide, high = squares
    nodes = np.array([[0, 0], [wide, 0], [wide, high], [0, high]])
    area = np.zeros(size[::-1], dtype=np.uint8)
    cv2.fillConvexPoly(area, np.round(corners).astype(np.int32), 1)
    return WallGrid(
        size=size,
        pitch_m=pitch_m,
        nodes=nodes,
        points_px=corners,
        covariance_px2=np.tile(HANDLE_STD_PX**2 * np.eye(2), (4, 1, 1)),
        map=_homography(corners, nodes.astype(np.float64), size),
        area=area > 0,
        dark=True,
        fine_ratio=None,
        origin_m=np.zeros(2),
        warnings=(
            "no lines were found between the handles: the grid is as accurate as the four handles "
            "set by hand",
        ),
    )


def _homography(px: FloatArray, nodes: FloatArray, size: tuple[int, int]) -> GridMap:
    """Map from pixels to grid coordinates, a bare homography."""
    centre = (np.array(size) - 1.0) / 2.0
    scale = np.full(2, size[0] / 2.0)
    near = (px - centre) / scale
    matrix = np.asarray(cv2.findHomography(near, nodes)[0], dtype=np.float64)
    matrix = matrix / matrix[2, 2]
    parameters = np.concatenate([matrix[0], matrix[1], matrix[2, :2], np.zeros(2)])
    return GridMap(centre, scale, parameters)


def _map_through(px: FloatArray, nodes: FloatArray, size: tuple[int, int]) -> GridMap:
    """Map including the lens's distortion, through all crossings."""
    grid_map = _homography(px, nodes, size)
    weight = np.full(nodes.shape, 1e4)
    for _ in range(4):
        grid_map = refitted(grid_map, px, nodes - grid_map(px), weight)
    return grid_map


def _moved(matrix: FloatArray, px: FloatArray) -> FloatArray:
    lifted = np.c_[px, np.ones(len(px))] @ matrix.T
    return np.asarray(lifted[:, :2] / lifted[:, 2:])


def _jacobian(matrix: FloatArray, px: FloatArray) -> FloatArray:
    steps = [_moved(matrix, px + 0.5 * e) - _moved(matrix, px - 0.5 * e) for e in np.eye(2)]
    return np.stack(steps, axis=-1)
