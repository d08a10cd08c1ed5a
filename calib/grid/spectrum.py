"""Where in a picture something repeats in two directions, and how: seeds for the wall grid."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["PERIODS_ACROSS", "Seed", "find_seeds", "flattened"]

FloatArray = NDArray[np.float64]

WINDOWS = (32, 64, 128, 256)
PERIODS_ACROSS = 4.0
"""A window holds at least this many periods of what is looked for in it."""
HIGHEST_FREQUENCY = 0.46
FOLDED_FREQUENCY = 1.0 / 3.0
"""Cycles per px; waves above may be fine lines folded over, so longer ones are looked for, too."""
SMALLEST_ANGLE = np.radians(30.0)
CLIP_AT = 4.0
ALIKE = 0.2
"""Waves this near in length, by its logarithm, are of one kind."""


@dataclass(frozen=True)
class Seed:
    """Two waves seen in one window.

    Attributes
    ----------
    centre : (2,) array
        Middle of the window, px.
    waves : (2, 2) array
        Rows: wave vectors in cycles per px (x, y).
    window : int
        Side of the window, px.
    strength : float
        Power of the weaker wave over the median of waves about as long, whichever way they run.
    leading : float
        The same of the wave with the most power.
    """

    centre: FloatArray
    waves: FloatArray
    window: int
    strength: float
    leading: float


def flattened(image: FloatArray, scale: float) -> FloatArray:
    """Relative contrast with everything slower than `scale` px removed, extremes clipped.

    Lines are paint: they dim the light by a factor, in the sun and in the shadow alike.

    Parameters
    ----------
    image : (H, W) array
        Gray levels, any positive scale.
    scale : float
        Standard deviation of the Gaussian that counts as the light, px.

    Returns
    -------
    (H, W) array
        Relative contrast, clipped at 4 of its robust standard deviations.
    """
    light = cv2.GaussianBlur(image, (0, 0), scale)
    floor = 0.02 * float(np.percentile(light, 95)) + 1e-12
    contrast = image / np.maximum(light, floor) - 1.0
    spread = 1.4826 * float(np.median(np.abs(contrast)))
    limit = CLIP_AT * max(spread, 0.2 * float(contrast.std()))
    return np.asarray(np.clip(contrast, -limit, limit), dtype=np.float64)


def find_seeds(image: FloatArray, *, keep: int = 8) -> list[Seed]:
    """Windows in which two waves cross, the clearest first.

    Parameters
    ----------
    image : (H, W) array
        Gray levels.
    keep : int
        How many seeds to keep of each window size.

    Returns
    -------
    list of Seed
    """
    seeds: list[Seed] = []
    for window in WINDOWS:
        if window > min(image.shape):
            break
        flat = flattened(image, window / 6.0)
        here = [
            _window_seeds(flat, left, top, window)
            for top in _starts(image.shape[0], window)
            for left in _starts(image.shape[1], window)
        ]
        for alike in (
            [pair[0] for pair in here if pair],
            [one for pair in here for one in pair[1:]],
        ):
            seeds += sorted(alike, key=lambda seed: seed.strength, reverse=True)[:keep]
    return sorted(seeds, key=lambda seed: seed.strength, reverse=True)


def _starts(length: int, window: int) -> NDArray[np.int64]:
    count = max(1, round(2 * (length - window) / window) + 1)
    return np.unique(np.linspace(0, length - window, count).astype(np.int64))


def _window_seeds(flat: FloatArray, left: int, top: int, window: int) -> list[Seed]:
    """The seed of a window; where it is very fine, also that of its longer waves."""
    seed = _seed(flat, left, top, window, HIGHEST_FREQUENCY)
    if seed is None or np.linalg.norm(seed.waves, axis=1).max() < FOLDED_FREQUENCY:
        return [] if seed is None else [seed]
    longer = _seed(flat, left, top, window, FOLDED_FREQUENCY)
    return [seed] if longer is None else [seed, longer]


def _seed(flat: FloatArray, left: int, top: int, window: int, highest: float) -> Seed | None:
    patch = flat[top : top + window, left : left + window]
    taper = np.hanning(window + 2)[1:-1]
    size = 2 * window
    spectrum = np.fft.rfft2((patch - patch.mean()) * np.outer(taper, taper), (size, size))
    power = np.abs(np.fft.fftshift(spectrum, axes=0)) ** 2
    fx = np.fft.rfftfreq(size)[np.newaxis, :]
    fy = np.fft.fftshift(np.fft.fftfreq(size))[:, np.newaxis]
    radius = np.maximum(np.hypot(fx, fy), 1e-9)
    ring = (radius > PERIODS_ACROSS / window) & (radius < highest)
    floor = float(np.median(power[ring]))
    if floor <= 0.0:
        return None
    first = _peak(np.where(ring, power, 0.0))
    angle = np.arctan2(fy, fx)
    apart = np.abs(np.angle(np.exp(2j * (angle - angle[first])))) / 2.0
    second = _peak(np.where(ring & (apart > SMALLEST_ANGLE), power, 0.0))
    waves = np.array([_refined(power, place, size) for place in (first, second)])
    strengths = [_above_its_kind(power, radius, place) for place in (first, second)]
    centre = np.array([left, top]) + (window - 1) / 2.0
    return Seed(centre, waves, window, min(strengths), strengths[0])


def _above_its_kind(power: FloatArray, radius: FloatArray, place: tuple[int, int]) -> float:
    """Power of a wave over the median of all waves about as long.

    Most textures are the stronger the longer the wave: what stands out of all waves need not stand
    out of its own kind.
    """
    alike = np.abs(np.log(radius / radius[place])) < ALIKE
    return float(power[place] / max(float(np.median(power[alike])), 1e-300))


def _peak(power: FloatArray) -> tuple[int, int]:
    row, column = np.unravel_index(int(np.argmax(power)), power.shape)
    return int(row), int(column)


def _refined(power: FloatArray, place: tuple[int, int], size: int) -> FloatArray:
    """Wave vector of a peak, by parabolas through the logarithm of its neighbours."""
    row, column = place
    offsets = []
    for step in ((1, 0), (0, 1)):
        values = [power[place]]
        for side in (-1, 1):
            r = (row + side * step[0]) % power.shape[0]
            # The spectrum of a real picture is even: the column left of 0 is the one right of it
            c = min(abs(column + side * step[1]), power.shape[1] - 1)
            values.append(power[r, c])
        middle, before, after = np.log(np.maximum(values, 1e-300))
        bend = before - 2.0 * middle + after
        offset = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
        offsets.append(float(np.clip(offset, -0.5, 0.5)))
    return np.array([column + offsets[1], row + offsets[0] - size // 2]) / size
