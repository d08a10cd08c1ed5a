"""Paint: the wall's grid, floor and ball, each averaged over what a pixel sees of it."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from sample_videos.scene import BallLook, Wall

__all__ = ["ball_reflectance", "floor_reflectance", "mottle", "wall_reflectance"]

FloatArray = NDArray[np.float64]

TILE = 256
"""px, side of the tile that a rough surface repeats: more than most pictures show of it at once."""
PATCHES = 12
"""Patches of the ball, as a football's pentagons: wherever it turns, some are seen."""


@lru_cache(maxsize=8)
def _tile(seed: int, grain: float) -> FloatArray:
    noise = gaussian_filter(
        np.random.default_rng(seed).standard_normal((TILE, TILE)), grain, mode="wrap"
    )
    return np.asarray(noise / noise.std())


def mottle(x: FloatArray, y: FloatArray, scale: float, seed: int, grain: float = 2.0) -> FloatArray:
    """Smooth random field over the plane, mean 0, deviation 1; `scale` m is one grain."""
    step = grain / scale
    where = np.stack([y * step, x * step])
    return np.asarray(map_coordinates(_tile(seed, grain), where, order=1, mode="grid-wrap"))


def _lines(at: FloatArray, footprint: FloatArray, pitch: float, width: float) -> FloatArray:
    """Share of an interval of length `footprint` about `at` that lines of a ruling take up."""

    def inked(x: FloatArray) -> FloatArray:
        turn = x / pitch + 0.5
        whole = np.floor(turn)
        return whole * width + np.clip((turn - whole - 0.5) * pitch + 0.5 * width, 0.0, width)

    spread = np.maximum(footprint, 1e-6)
    return np.asarray((inked(at + 0.5 * spread) - inked(at - 0.5 * spread)) / spread)


def wall_reflectance(
    x: FloatArray, y: FloatArray, step_x: FloatArray, step_y: FloatArray, wall: Wall, seed: int
) -> FloatArray:
    """Reflectance (3, ...) of the wall at x, y (m), averaged over step_x by step_y."""
    from_x, from_y = x - wall.origin[0], y - wall.origin[1]
    light = np.ones_like(x)
    rulings = (
        (wall.pitch, wall.line_width, wall.contrast),
        (wall.fine_pitch, wall.fine_width, wall.fine_contrast),
    )
    for pitch, width, contrast in rulings:
        if contrast > 0.0:
            light *= 1.0 - contrast * _lines(from_x, step_x, pitch, width)
            light *= 1.0 - contrast * _lines(from_y, step_y, pitch, width)
    light *= 1.0 + 0.012 * mottle(x, y, 0.02, seed) + 0.02 * mottle(x, y, 0.35, seed + 1)
    warm = 0.012 * mottle(x, y, 0.5, seed + 2)
    tint = np.stack([1.0 + warm, np.ones_like(warm), 1.0 - warm])
    return np.asarray(np.reshape(wall.colour, (3,) + (1,) * x.ndim) * tint * light)


def floor_reflectance(
    x: FloatArray, z: FloatArray, colour: tuple[float, float, float], seed: int
) -> FloatArray:
    """Reflectance (3, ...) of the floor at x, z (m)."""
    grain = 0.1 * mottle(x, z, 0.015, seed + 3) + 0.06 * mottle(x, z, 0.1, seed + 4)
    return np.asarray(np.reshape(colour, (3,) + (1,) * x.ndim) * np.clip(1.0 + grain, 0.5, 1.6))


def _icosahedron() -> FloatArray:
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    corners = [(0.0, a, b * golden) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    rows = [np.roll(corner, shift) for corner in corners for shift in range(3)]
    return np.asarray(np.array(rows) / np.hypot(1.0, golden))


CORNERS = _icosahedron()


def ball_reflectance(normal: FloatArray, footprint: FloatArray, look: BallLook) -> FloatArray:
    """Reflectance (M, 3) of a painted ball.

    Parameters
    ----------
    normal : (M, 3) array
        Outward unit normal in the ball's own frame.
    footprint : (M,) array
        Angle on the ball that a pixel covers, rad.
    """
    base, mark = np.array(look.base), np.array(look.mark)
    if look.pattern == "plain":
        return np.broadcast_to(base, normal.shape).copy()
    if look.pattern == "jokku":
        nearest = np.arccos(np.clip((normal @ CORNERS.T).max(axis=1), -1.0, 1.0))
        share = np.clip(0.5 + (0.34 - nearest) / footprint, 0.0, 1.0)
        seam = np.zeros_like(share)
    else:
        x, y, z = normal.T
        width = 0.028
        rims = np.stack([np.abs(y), np.abs(z), np.abs(np.abs(x) - 0.7) * 1.4])
        away = rims.min(axis=0)
        share = np.clip(0.5 + (width - away) / footprint, 0.0, 1.0) * np.minimum(
            1.0, 2.0 * width / footprint
        )
        seam = share
    ground = base
    if look.pattern == "basketball":
        pebbles = (
            np.sin(23 * normal[:, 0] + 4)
            * np.sin(29 * normal[:, 1])
            * np.sin(31 * normal[:, 2] + 1)
        )
        fade = np.exp(-((30.0 * footprint) ** 2) / 8.0)
        ground = base * (1.0 + 0.25 * (pebbles * fade * (1.0 - seam))[:, np.newaxis])
    return np.asarray(ground + share[:, np.newaxis] * (mark - ground))
