"""Small pictures around a ball, cut out of frames and background and turned into linear light.

An edge pixel mixes light from ball and background before the camera's transfer curve bends it:
mixed in gray levels as they are, the edge of a dark ball before a bright wall would lie too far
inside.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.scene.scene import Scene, Window

__all__ = ["TYPICAL_GAMMA", "Cutouts", "Hides", "Wanted", "cut_out", "light", "ring_widths"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Hides = Callable[[FloatArray, FloatArray], BoolArray]

# Exponent that sRGB and ITU-R BT.709 come to over the brighter half of their range.
TYPICAL_GAMMA = 1.85

_BLOCK_BYTES = 24_000_000
# Below this part of white the transfer curve is straight.
_DARKEST = 0.05
_LEVEL_STEPS = 16


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
class Wanted:
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


def cut_out(scene: Scene, wanted: Wanted) -> Iterator[tuple[slice, Cutouts]]:
    """Cut out blocks of pieces that fit in memory.

    Parameters
    ----------
    scene : Scene
        Footage with its static scene.
    wanted : Wanted
        Where.

    Yields
    ------
    places : slice
        Which of the wanted pieces the block holds.
    cutouts : Cutouts
    """
    size = 2 * int(np.ceil(wanted.reach)) + 1
    block = max(1, _BLOCK_BYTES // (12 * size * size))
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
    scene: Scene,
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
    into[2] = _looked_up(gray, _tables()[1]) / scene.background.noise[window]
    hidden = None if hides is None else hides(index)
    if hidden is not None:
        y, x = np.mgrid[window].astype(np.float64)
        into[2][hidden(x.ravel(), y.ravel()).reshape(x.shape)] = 0.0
