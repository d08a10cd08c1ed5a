"""Small pictures around a ball, cut out of frames and background and turned into linear light.

An edge pixel mixes light from ball and background before the camera's transfer curve bends it:
mixed in gray levels as they are, the edge of a dark ball before a bright wall would lie too far
inside.

Edge points of a picture: where it is steepest, to a fraction of a pixel, and which way.

How a ball's edge looks across the outline: point spread, exposure smear, a sphere's shading.

Two profiles over the distance from the outline: how much of the pixel the ball covers, and the same
weighted with n_z, the part of the sphere's normal towards the camera, after which the light on a
sphere falls off near its limb. Both are blurred by a Gaussian point spread, the pixel's own size
and the exposure's smear along the outline's normal.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled
from vision.scene import FilmedScene, Window

__all__ = [
    "TYPICAL_GAMMA",
    "CutPlaces",
    "Cutouts",
    "EdgePoints",
    "EdgeProfile",
    "Hides",
    "cut_out",
    "edge_points",
    "piece_bytes",
    "places",
    "ring_widths",
]

FloatArray = NDArray[np.float64]

FloatImage = NDArray[np.float32]

IntArray = NDArray[np.int64]

BoolArray = NDArray[np.bool_]

Hides = Callable[[FloatArray, FloatArray], BoolArray]

# Exponent that sRGB and ITU-R BT.709 come to over the brighter half of their range.
TYPICAL_GAMMA = 1.85

_BLOCK_BYTES = 24_000_000
"""Bytes worked on at once: they stay within a processor's cache."""

# Below this part of white the transfer curve is straight.
_DARKEST = 0.05

_LEVEL_STEPS = 16
"""Steps per gray level of a table: rounding is a thirtieth of one, less than any noise."""


def ring_widths(radius: float) -> tuple[float, float]:
    """How far inside and outside the outline pixels are used, px."""
    return float(np.clip(0.2 * radius, 2.2, 6.0)), float(np.clip(0.2 * radius, 2.5, 4.0))


@dataclass(frozen=True)
class Cutouts:
    """Square pieces of several frames, of one size.

    Attributes
    ----------
    corner : (F, 2) int array
        x, y of each piece's first pixel, px.
    gray, background : (F, P, P) float32 arrays
        Light of the frame and of the static scene in this frame's brightness, 0 to 255.
    inverse_noise : (F, P, P) float32 array
        One over the standard deviation of their difference; 0 outside the picture and where
        something else is in front.
    """

    corner: IntArray
    gray: FloatImage
    background: FloatImage
    inverse_noise: FloatImage

    def at(self, places: IntArray) -> "Cutouts":
        """Some of the pieces."""
        return Cutouts(
            self.corner[places],
            self.gray[places],
            self.background[places],
            self.inverse_noise[places],
        )


@dataclass(frozen=True)
class CutPlaces:
    """Where to cut.

    Attributes
    ----------
    frame : (F,) int array
        Frame indices, increasing.
    centre : (F, 2) array
        Middle of each piece, px.
    reach : float
        Half width, px.
    hides : callable, optional
        Gives for a frame what may stand in front, or None.
    """

    frame: IntArray
    centre: FloatArray
    reach: float
    hides: Callable[[int], Hides | None] | None = None


def light(gray: FloatImage | NDArray[np.uint8]) -> FloatImage:
    """Light that a gray level (0 to 255) stands for, 0 to 255 as well."""
    return _looked_up(gray, _tables()[0])


def _looked_up(gray: FloatImage | NDArray[np.uint8], table: FloatImage) -> FloatImage:
    if gray.dtype == np.uint8:
        return np.asarray(cv2.LUT(gray, table[::_LEVEL_STEPS]))
    place = np.clip(gray * np.float32(_LEVEL_STEPS) + np.float32(0.5), 0, len(table) - 1)
    return np.asarray(table.take(place.astype(np.int32)))


@cache
def _tables() -> tuple[FloatImage, FloatImage]:
    """Light, and one over its slope, for gray levels in fine steps."""
    part = np.arange(255 * _LEVEL_STEPS + 1) / (255.0 * _LEVEL_STEPS)
    slope = TYPICAL_GAMMA * np.maximum(part, _DARKEST) ** (TYPICAL_GAMMA - 1.0)
    return (255.0 * part**TYPICAL_GAMMA).astype(np.float32), (1.0 / slope).astype(np.float32)


def cut_out(scene: FilmedScene, wanted: CutPlaces) -> Iterator[tuple[slice, Cutouts]]:
    """Cut out blocks of pieces that fit in memory.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    wanted : CutPlaces
        Where.

    Yields
    ------
    places : slice
        Which of the wanted pieces the block holds.
    cutouts : Cutouts
    """
    size = _side(wanted.reach)
    block = max(1, _BLOCK_BYTES // piece_bytes(wanted.reach))
    corner = np.rint(wanted.centre).astype(np.int64) - size // 2
    whole = _whole_windows(corner, size, scene.shape)
    windows = scene.windows(wanted.frame, whole)
    for start in range(0, len(wanted.frame), block):
        places = slice(start, min(start + block, len(wanted.frame)))
        frames = wanted.frame[places]
        pieces = np.zeros((3, len(frames), size, size), dtype=np.float32)
        for row in range(len(frames)):
            index, gray = next(windows)
            window = whole[start + row]
            inner = _inner(window, corner[start + row])
            _fill(scene, index, window, gray, pieces[:, row][(slice(None), *inner)], wanted.hides)
        yield places, Cutouts(corner[places], pieces[0], pieces[1], pieces[2])


def piece_bytes(reach: float) -> int:
    """Bytes of a piece so wide to either side, px: gray level, scene and noise in float32."""
    return 12 * _side(reach) ** 2


def _side(reach: float) -> int:
    return 2 * int(np.ceil(reach)) + 1


def _whole_windows(corner: IntArray, size: int, shape: tuple[int, int]) -> list[Window]:
    """The parts of the pieces that lie in the picture."""
    low = np.clip(corner, 0, [shape[1], shape[0]])
    high = np.clip(corner + size, 0, [shape[1], shape[0]])
    return [
        (slice(int(top), int(bottom)), slice(int(left), int(right)))
        for (left, top), (right, bottom) in zip(low, high, strict=True)
    ]


def _inner(window: Window, corner: IntArray) -> Window:
    """The same part in the piece's own pixels."""
    rows, columns = window
    left, top = int(corner[0]), int(corner[1])
    return (
        slice(rows.start - top, rows.stop - top),
        slice(columns.start - left, columns.stop - left),
    )


def _fill(
    scene: FilmedScene,
    index: int,
    window: Window,
    gray: FloatImage | NDArray[np.uint8],
    into: FloatImage,
    hides: Callable[[int], Hides | None] | None,
) -> None:
    if gray.size == 0:
        return
    into[0] = light(gray)
    into[1] = light(scene.expected(index, window))
    into[2] = _looked_up(gray, _tables()[1]) / scene.noise_in(index, window)
    hidden = None if hides is None else hides(index)
    if hidden is not None:
        rows, columns = (np.arange(part.start, part.stop, dtype=np.float64) for part in window)
        x, y = np.tile(columns, len(rows)), np.repeat(rows, len(columns))
        into[2][hidden(x, y).reshape(gray.shape)] = 0.0


_STEEP = 6.0
"""Standard deviations of noise: in a picture of a million pixels none is as steep by chance."""

_MOST_EDGES = 6000
"""Edge points kept, the steepest, supposed: more only cost time."""


@dataclass(frozen=True)
class EdgePoints:
    """Points on edges.

    Attributes
    ----------
    x, y : (n,) arrays
        Where, px.
    nx, ny : (n,) arrays
        Unit vector up the slope.
    strength : (n,) array
        Steepness; unit noise gives about 1.
    """

    x: FloatImage
    y: FloatImage
    nx: FloatImage
    ny: FloatImage
    strength: FloatImage


def edge_points(level: FloatImage, left: int, top: int) -> EdgePoints:
    """Find the edge points of a picture, thinned along their gradient.

    Parameters
    ----------
    level : (H, W) float32 array
        The picture, in units of its noise.
    left, top : int
        Where its first pixel lies.
    """
    smooth = cv2.GaussianBlur(level, (0, 0), 0.8)
    gx = np.asarray(cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=0.1), dtype=np.float32)
    gy = np.asarray(cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=0.1), dtype=np.float32)
    steepness = np.asarray(cv2.magnitude(gx, gy), dtype=np.float32)
    steepness[:1], steepness[-1:], steepness[:, :1], steepness[:, -1:] = 0, 0, 0, 0
    count, least = int(np.count_nonzero(steepness > np.float32(_STEEP))), _STEEP
    if count > 4 * _MOST_EDGES:
        least = float(np.partition(steepness, -4 * _MOST_EDGES, axis=None)[-4 * _MOST_EDGES])
    points = np.empty((5, count), dtype=np.float32)
    count = _crests(steepness, gx, gy, least, left, top, points)
    return EdgePoints(*points[:, :count])


@compiled
def _crests(
    steepness: FloatImage,
    gx: FloatImage,
    gy: FloatImage,
    least: float,
    left: int,
    top: int,
    points: FloatImage,
) -> int:
    """Write what `EdgePoints` holds of pixels steeper than those up and down their slope."""
    count = 0
    for row in range(1, steepness.shape[0] - 1):
        for column in range(1, steepness.shape[1] - 1):
            strength = steepness[row, column]
            if not strength > least:
                continue
            nx, ny = gx[row, column] / strength, gy[row, column] / strength
            step_x, step_y = int(np.rint(nx)), int(np.rint(ny))
            ahead = steepness[row + step_y, column + step_x]
            behind = steepness[row - step_y, column - step_x]
            if strength < ahead or strength <= behind:
                continue
            bend = max(np.float32(2.0) * strength - ahead - behind, np.float32(1e-6))
            offset = np.float32(0.5) * (ahead - behind) / bend
            offset = min(max(offset, np.float32(-0.5)), np.float32(0.5))
            away = offset * math.sqrt(float(step_x * step_x + step_y * step_y))
            points[0, count], points[1, count] = column + left + away * nx, row + top + away * ny
            points[2, count], points[3, count], points[4, count] = nx, ny, strength
            count += 1
    return count


def places(mask: NDArray[np.bool_]) -> tuple[IntArray, IntArray]:
    """Rows and columns that are set, in reading order."""
    if not mask.any():
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    x, y = cv2.findNonZero(mask.view(np.uint8)).reshape(-1, 2).T.astype(np.int64)
    return y, x


# Fine enough to be looked up without interpolation: rounding by half a step is a hundredth of the
# narrowest edge, and of either sign.
_STEP = 0.0125

_SMEAR_STEPS = 8
"""Steps of the table between two smears, supposed: a profile hardly changes in between."""

# How far from the outline the tables reach, px: further than any ring of pixels does.
_REACH = 16.0

_TYPICAL_INNER = 5.0
"""px inside an outline whose gray levels stand for the ball: beyond its blur, within its
shading."""


class EdgeProfile:
    """Tabulated edge profiles of a sphere's outline.

    Parameters
    ----------
    radius : float
        Outline radius, px.
    spread : float
        Standard deviation of the point spread, px.
    most_smear : float
        Longest exposure smear that will be asked for, px.

    Attributes
    ----------
    tables : (4, n) float32 array
        Coverage, its slope over depth (1/px), shading profile about its mean, its slope: over the
        depth, one smear after the other.
    steps : (5,) array
        Places per px of depth; place of depth 0, rounded down; smears per px; places of one smear;
        the longest smear.
    """

    def __init__(self, radius: float, spread: float, most_smear: float) -> None:
        self.radius = radius
        self.spread = spread
        smears = np.arange(int(np.ceil(most_smear / (_STEP * _SMEAR_STEPS))) + 1)
        margin = 4.0 * spread + 1.0 + 0.5 * _STEP * _SMEAR_STEPS * len(smears)
        around = round((_REACH + margin) / _STEP)
        depth = np.arange(-around, around + 1) * _STEP
        # The outline itself lies on a table point: half of it is inside.
        inside = np.where(depth < 0, 1.0, np.where(depth > 0, 0.0, 0.5))
        normal = np.sqrt(np.clip(1.0 - (1.0 + depth / radius) ** 2, 0.0, 1.0)) * inside
        # As a difference from its mean, the shading is well told apart from the covered part.
        within = (depth < 0) & (depth > -_TYPICAL_INNER)
        normal -= float(normal[within].mean()) * inside
        half = round(_REACH / _STEP)
        self._low, self._count = -half * _STEP, 2 * half + 1
        self._most = len(smears) - 1
        tables = np.empty((4, len(smears), self._count), dtype=np.float32)
        for place, shape in enumerate((inside, normal)):
            sharp = _blurred(shape, spread)
            total = np.concatenate([[0.0], np.cumsum(sharp)])
            for smear in smears:
                row = _smeared(sharp, total, int(smear), around, half)
                tables[2 * place, smear] = row
                tables[2 * place + 1, smear] = np.gradient(row, _STEP)
        self.tables = tables.reshape(4, -1)
        per_px = 1.0 / _STEP
        self.steps = np.array(
            [per_px, half + 0.5, per_px / _SMEAR_STEPS, 2.0 * half + 1.0, len(smears) - 1.0]
        )

    def __call__(self, depth: FloatImage, smear: FloatImage | None = None) -> list[FloatImage]:
        """Look the profiles up.

        Parameters
        ----------
        depth : array
            Distance outside the outline (negative inside), px.
        smear : array, optional
            Smear along the outline's normal, px; of the same shape.

        Returns
        -------
        list of four arrays of that shape
            Coverage, its slope over depth (1/px), shading profile about its mean, its slope.
        """
        place = depth * np.float32(1.0 / _STEP)
        place += np.float32(0.5 - self._low / _STEP)
        np.clip(place, 0, self._count - 1, out=place)
        column = place.astype(np.int32)
        if smear is not None and self._most > 0:
            row = smear * np.float32(1.0 / (_STEP * _SMEAR_STEPS))
            row += np.float32(0.5)
            column += np.minimum(row, self._most).astype(np.int32) * np.int32(self._count)
        return [table.take(column) for table in self.tables]


def _blurred(shape: FloatArray, spread: float) -> FloatArray:
    """Blur by the point spread and the pixel's own width; ends are continued."""
    reach = int(np.ceil((4.0 * spread + 0.5) / _STEP))
    axis = np.arange(-reach, reach + 1) * _STEP
    kernel = np.exp(-0.5 * (axis / max(spread, _STEP)) ** 2)
    total = np.concatenate([[0.0], np.cumsum(kernel)])
    half = round(0.5 / _STEP)
    places = np.arange(len(kernel))
    upper, lower = np.minimum(places + half + 1, len(kernel)), np.maximum(places - half, 0)
    boxed = total[upper] - total[lower]
    padded = np.pad(shape, reach, mode="edge")
    size = len(padded) + len(boxed)
    product = np.fft.rfft(padded, size) * np.fft.rfft(boxed / boxed.sum(), size)
    return np.asarray(np.fft.irfft(product, size)[2 * reach : 2 * reach + len(shape)])


def _smeared(
    sharp: FloatArray, total: FloatArray, smear: int, around: int, half: int
) -> FloatArray:
    """Mean over a box of so many smear steps, on the middle of the table; ends weigh a half."""
    middle = np.arange(around - half, around + half + 1)
    if smear == 0:
        return np.asarray(sharp[middle])
    box = smear * _SMEAR_STEPS // 2
    whole = total[middle + box + 1] - total[middle - box]
    return np.asarray((whole - 0.5 * (sharp[middle - box] + sharp[middle + box])) / (2 * box))
