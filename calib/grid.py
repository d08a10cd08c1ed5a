"""The wall grid: found by itself, at sub-pixel precision, with the experiment in front of it."""

from dataclasses import dataclass, replace
from typing import Self

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.grid_lattice import Lattice, analysed, off_axis_share, squareness
from calib.grid_nodes import Nodes, measured_nodes
from calib.grid_phase import COHERENT, GridMap, Support, grow, pixel_grid, refitted
from calib.grid_spectrum import Seed, find_seeds, flattened
from metrology import CalibrationError

__all__ = ["WallGrid", "find_wall_grid"]

FloatArray = NDArray[np.float64]

SEEDS_TRIED = 8
SEARCH_WIDTH = 960
ENOUGH_AREA = 0.7
MOST_UNEVEN = 1.6
LEAST_AREA = 0.03
LEAST_NODES = 12
MOST_OFF_AXIS = 0.3
MOST_SKEW = 0.08
REJECT_AT = 4.0
MOST_ASTRAY = 1.0 / 12.0
"""Crossings about their map, periods: six of these make a label wrong by one line."""


@dataclass(frozen=True, eq=False)
class WallGrid:
    """The lines on the wall, measured.

    Attributes
    ----------
    size : tuple of int
        Width and height of the picture, px.
    pitch_m : float
        Distance between coarse lines, m.
    nodes : (N, 2) int array
        Grid coordinates: columns counted to the right, rows counted upwards from the node nearest
        the middle of the picture.
    points_px : (N, 2) array
        Where these crossings are measured in the picture, px.
    covariance_px2 : (N, 2, 2) array
        Covariance of each, px². The crossings' errors are independent of each other.
    residual_px : (N, 2) array
        Measured minus mapped position, px.
    map : GridMap
        Smooth map from pixels to grid coordinates; for drawing and for wall readings, not for the
        pose of the camera.
    area : (H, W) bool array
        Where the grid is seen.
    dark : bool
        Whether its lines are darker than the wall.
    fine_ratio : int or None
        Fine divisions in one coarse one, where fine lines are resolved.
    origin_m : (2,) array
        Wall coordinates of node (0, 0), m.
    warnings : tuple of str
        What the user should know.
    """

    size: tuple[int, int]
    pitch_m: float
    nodes: NDArray[np.int64]
    points_px: FloatArray
    covariance_px2: FloatArray
    residual_px: FloatArray
    map: GridMap
    area: NDArray[np.bool_]
    dark: bool
    fine_ratio: int | None
    origin_m: FloatArray
    warnings: tuple[str, ...] = ()

    @property
    def wall_m(self) -> FloatArray:
        """Wall coordinates of the nodes, (N, 2), m."""
        return np.asarray(self.origin_m + self.pitch_m * self.nodes)

    def to_wall(self, px: ArrayLike) -> FloatArray:
        """Reading on the wall of pixels (..., 2): wall coordinates (..., 2), m."""
        return np.asarray(self.origin_m + self.pitch_m * self.map(px))

    def with_origin(
        self, px: ArrayLike, wall: ArrayLike = (0.0, 0.0), *, snap: bool = False
    ) -> Self:
        """The same grid with its wall coordinates moved.

        Parameters
        ----------
        px : (2,) array
            A place in the picture.
        wall : (2,) array
            The wall coordinates it shall have, m.
        snap : bool
            Take the crossing nearest to `px` instead of `px` itself.
        """
        place = self.map(px)
        place = np.round(place) if snap else place
        return replace(self, origin_m=np.asarray(wall, dtype=np.float64) - self.pitch_m * place)


def find_wall_grid(
    image: NDArray[np.generic], *, pitch_m: float = 0.05, fine_pitch_m: float | None = 0.01
) -> WallGrid:
    """Find the grid on the wall in a picture of the scene.

    Parameters
    ----------
    image : (H, W) array
        Gray levels, any type; best the average of a clip's frames.
    pitch_m : float
        Distance between coarse lines, m.
    fine_pitch_m : float or None
        Distance between fine lines, m; None if there are none.

    Returns
    -------
    WallGrid

    Raises
    ------
    CalibrationError
        If there is no grid of squares in the picture; the message says what was found instead.
    """
    gray = np.asarray(image, dtype=np.float64)
    gray = np.asarray(gray - min(float(gray.min()), 0.0))
    grid_map, support = _best_growth(gray)
    shape = gray.shape[::-1]
    area = cv2.resize(support.area.astype(np.uint8), shape, interpolation=cv2.INTER_NEAREST) > 0
    pixels = pixel_grid(gray.shape)
    seen = pixels[area]
    periods = _periods(grid_map, seen)
    if not np.isfinite(periods).all():
        raise _nothing()
    flat = flattened(gray, 1.5 * float(periods.max()))
    first = grid_map(seen)
    lattices = [analysed(flat[area], first[:, f], periods[f]) for f in range(2)]
    if not all(lattice.clear for lattice in lattices):
        raise _stripes()
    grid_map, lattices = _oriented(grid_map, lattices)
    flat = flattened(gray, 1.5 * float(_periods(grid_map, seen).max()))
    _require_squares(flat[area], grid_map(seen), grid_map)
    sign = -1.0 if lattices[0].dark else 1.0
    templates = (sign * lattices[0].template, sign * lattices[1].template)
    frequency = np.linalg.norm(grid_map.jacobian(seen), axis=-1).max(axis=0)
    for _ in range(4):
        nodes = measured_nodes(flat, grid_map(pixels), area, frequency, templates)
        nodes, px = _located(nodes, grid_map, seen)
        inlier, factor = _agreeing(nodes)
        variance = np.einsum("nff->nf", nodes.covariance) * factor
        grid_map = refitted(grid_map, px, -nodes.shift, inlier[:, np.newaxis] / variance)
    nodes, px = _kept(nodes, px, inlier)
    if len(px) < LEAST_NODES:
        raise CalibrationError(
            f"only {len(px)} crossings of a grid are in view",
            hint="Show at least three by four squares of the wall's grid.",
        )
    astray = float(np.sqrt((nodes.shift**2).mean()))
    if not astray < MOST_ASTRAY:
        raise CalibrationError(
            f"lines are seen, but their crossings lie {astray:.2f} of a square off any even grid: "
            "they can't be counted surely",
            hint="Film with more pixels, nearer, or with better light on the wall.",
        )
    inverse = np.linalg.inv(grid_map.jacobian(px))
    residual = np.einsum("nij,nj->ni", inverse, nodes.shift)
    covariance = factor * inverse @ nodes.covariance @ np.swapaxes(inverse, 1, 2)
    fine = lattices[0].fine if lattices[0].fine == lattices[1].fine else None
    return WallGrid(
        size=(gray.shape[1], gray.shape[0]),
        pitch_m=pitch_m,
        nodes=nodes.index,
        points_px=px + residual,
        covariance_px2=covariance,
        residual_px=residual,
        map=grid_map,
        area=area,
        dark=lattices[0].dark,
        fine_ratio=fine,
        origin_m=np.zeros(2),
        warnings=_fine_warning(fine, pitch_m, fine_pitch_m),
    )


def _best_growth(gray: FloatArray) -> tuple[GridMap, Support]:
    best: tuple[float, GridMap, Support] | None = None
    stripes = 0.0
    for image, ratio in _resolutions(gray):
        seeds = find_seeds(image)
        for seed in _distinct(seeds)[:SEEDS_TRIED]:
            grid_map, support = grow(image, seed)
            stripes = max(stripes, _striped(support))
            if best is None or support.worth > best[0]:
                best = (support.worth, grid_map.resized(ratio[0], ratio[1]), support)
            lengths = np.linalg.norm(best[1].jacobian(best[1].centre), axis=1)
            if best[2].area.mean() > ENOUGH_AREA and lengths.max() < MOST_UNEVEN * lengths.min():
                break
        if best is not None and best[2].area.mean() > LEAST_AREA:
            return best[1], best[2]
        if seeds:
            clearest = max(seeds, key=lambda seed: seed.leading)
            stripes = max(stripes, _striped(grow(image, clearest)[1]))
    if stripes > 0.3:
        raise _stripes()
    raise _nothing()


def _striped(support: Support) -> float:
    """Share of the picture in which at least one family of lines is seen."""
    return float((support.coherence > COHERENT).any(axis=0).mean())


def _nothing() -> CalibrationError:
    return CalibrationError(
        "no grid is in view: nothing repeats in two directions",
        hint="Light the wall evenly, focus on it, and let its squares be 3 px wide or more.",
    )


def _stripes() -> CalibrationError:
    return CalibrationError(
        "there are lines in one direction, but none that cross them: stripes are no grid",
        hint="The wall needs lines both along and across.",
    )


def _resolutions(gray: FloatArray) -> list[tuple[FloatArray, tuple[float, float]]]:
    """Pictures to search, each with the factors back to the full size."""
    height, width = gray.shape
    if width <= SEARCH_WIDTH:
        return [(gray, (1.0, 1.0))]
    factor = int(np.ceil(width / SEARCH_WIDTH))
    size = (width // factor, height // factor)
    small = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), dtype=np.float64)
    return [(small, (width / size[0], height / size[1])), (gray, (1.0, 1.0))]


def _distinct(seeds: list[Seed]) -> list[Seed]:
    """Drop seeds that show the waves of an earlier one nearby: trying them twice tells nothing."""
    kept: list[Seed] = []
    for seed in seeds:
        twins = [
            other
            for other in kept
            if np.abs(np.abs(other.waves) - np.abs(seed.waves)).max() < 0.5 / seed.window
        ]
        if len(twins) < 2:
            kept.append(seed)
    return kept


def _periods(grid_map: GridMap, px: FloatArray) -> FloatArray:
    """Median period of both families, px."""
    frequency = np.linalg.norm(grid_map.jacobian(px[::7]), axis=-1)
    return np.asarray(1.0 / np.median(frequency, axis=0))


def _oriented(grid_map: GridMap, lattices: list[Lattice]) -> tuple[GridMap, list[Lattice]]:
    """Grid coordinates in coarse pitches, x right, y up, 0 at the crossing nearest the middle."""
    matrix = np.diag([1.0 / lattice.multiple for lattice in lattices])
    grid_map = grid_map.rebased(matrix, [-lattice.offset for lattice in lattices])
    wave = grid_map.jacobian(grid_map.centre)
    if abs(wave[0, 0]) * abs(wave[1, 1]) < abs(wave[0, 1]) * abs(wave[1, 0]):
        lattices = lattices[::-1]
        grid_map = grid_map.rebased([[0.0, 1.0], [1.0, 0.0]], [0.0, 0.0])
        wave = wave[::-1]
    grid_map = grid_map.rebased(np.diag([np.sign(wave[0, 0]), -np.sign(wave[1, 1])]), [0.0, 0.0])
    return grid_map.rebased(np.eye(2), -np.round(grid_map(grid_map.centre))), lattices


def _require_squares(values: FloatArray, grid: FloatArray, grid_map: GridMap) -> None:
    off_axis = off_axis_share(values, grid)
    if off_axis > MOST_OFF_AXIS:
        raise CalibrationError(
            "what repeats here is not lines that run through: a chessboard, tiles, bricks",
            hint="The wall needs a grid of lines; a chessboard belongs to `vision calibrate lens`.",
        )
    aspect, cosine = squareness(grid_map)
    if abs(np.log(aspect)) > MOST_SKEW or abs(cosine) > MOST_SKEW:
        angle = np.degrees(np.arccos(cosine))
        raise CalibrationError(
            f"the lines do not enclose squares: sides 1 : {aspect:.2f}, angle {angle:.0f} deg",
            hint="Only a grid of squares can be used, filmed with square pixels.",
        )


def _located(nodes: Nodes, grid_map: GridMap, seen: FloatArray) -> tuple[Nodes, FloatArray]:
    """Pixels of the nodes; those whose pixel can't be had are dropped."""
    coordinates = grid_map(seen[::5])
    cell = {tuple(key): i for i, key in enumerate(np.round(coordinates / nodes.block).astype(int))}
    start = seen[::5][[cell.get(tuple(key), 0) for key in nodes.index // nodes.block]]
    px = grid_map.inverse(nodes.index.astype(np.float64), start)
    good = np.isfinite(px).all(axis=1) & (np.abs(grid_map(px) - nodes.index).max(axis=1) < 1e-6)
    return _kept(nodes, px, good)


def _kept(nodes: Nodes, px: FloatArray, keep: NDArray[np.bool_]) -> tuple[Nodes, FloatArray]:
    return replace(
        nodes,
        index=nodes.index[keep],
        shift=nodes.shift[keep],
        covariance=nodes.covariance[keep],
        strength=nodes.strength[keep],
    ), px[keep]


def _agreeing(nodes: Nodes) -> tuple[NDArray[np.bool_], float]:
    """Nodes that agree with the map, and the factor by which variances fall short of scatter."""
    std = np.sqrt(np.einsum("nff->nf", nodes.covariance))
    typical = np.median(nodes.strength, axis=0)
    visible = ((nodes.strength > 0.4 * typical) & (nodes.strength < 2.5 * typical)).all(axis=1)
    visible &= (std < 4.0 * np.median(std, axis=0)).all(axis=1)
    normalised = np.abs(nodes.shift) / std
    factor = max(1.0, float(1.4826 * np.median(normalised[visible])) ** 2) if visible.any() else 1.0
    inlier = visible & (normalised < REJECT_AT * np.sqrt(factor)).all(axis=1)
    return inlier, factor


def _fine_warning(fine: int | None, pitch_m: float, fine_pitch_m: float | None) -> tuple[str, ...]:
    if fine is None or fine_pitch_m is None or fine == round(pitch_m / fine_pitch_m):
        return ()
    return (
        f"the wall shows {fine} fine divisions in one coarse one; {1e3 * pitch_m:g} mm with "
        f"{1e3 * fine_pitch_m:g} mm gradations would have {pitch_m / fine_pitch_m:g}: "
        "check the pitch",
    )
