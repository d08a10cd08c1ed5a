"""Where in a picture something repeats in two directions, and how: seeds for the wall grid."""

from dataclasses import dataclass

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

__all__ = ["PERIODS_ACROSS", "Seed", "find_seeds", "flattened", "smoothed"]

FloatArray = NDArray[np.float64]

WINDOWS = (32, 64, 128, 256)
PERIODS_ACROSS = 4.0
"""A window holds at least this many periods of what is looked for in it."""
HIGHEST_FREQUENCY = 0.46
FOLDED_FREQUENCY = 1.0 / 3.0
"""Cycles per px; waves above may be fine lines folded over, so longer ones are looked for, too."""
SMALLEST_ANGLE = np.radians(30.0)
CLIP_AT = 4.0
SMOOTH_FROM = 4.0
"""Px: an average as wide as this is smooth enough to be interpolated between pixels twice as far
apart."""
SPECTRA_AT_ONCE = 2**18
"""Pixels of the windows that are transformed in one go: as much as the caches hold."""
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
    light = smoothed(image, scale)
    floor = 0.02 * float(np.percentile(light, 95)) + 1e-12
    contrast = image / np.maximum(light, floor) - 1.0
    spread = 1.4826 * float(np.median(np.abs(contrast)))
    limit = CLIP_AT * max(spread, 0.2 * float(contrast.std()))
    return np.asarray(np.clip(contrast, -limit, limit), dtype=np.float64)


def smoothed(image: FloatArray, sigma: float) -> FloatArray:
    """Gaussian average of a picture (H, W), wide ones of a smaller picture.

    Parameters
    ----------
    image : (H, W) array
    sigma : float
        Standard deviation, px.
    """
    factor = int(sigma / SMOOTH_FROM)
    height, width = image.shape
    if factor < 2 or min(height, width) < 4 * factor:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma))
    size = (width // factor, height // factor)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    # the means over factor x factor pixels have averaged already
    left = np.sqrt(sigma**2 - (factor**2 - 1.0) / 12.0) / factor
    small = cv2.GaussianBlur(small, (0, 0), left)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR))


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
        here = _window_seeds(flat, window)
        for alike in (
            [pair[0] for pair in here if pair],
            [one for pair in here for one in pair[1:]],
        ):
            seeds += sorted(alike, key=lambda seed: seed.strength, reverse=True)[:keep]
    return sorted(seeds, key=lambda seed: seed.strength, reverse=True)


def _starts(length: int, window: int) -> NDArray[np.int64]:
    count = max(1, round(2 * (length - window) / window) + 1)
    return np.unique(np.linspace(0, length - window, count).astype(np.int64))


def _window_seeds(flat: FloatArray, window: int) -> list[list[Seed]]:
    """The seed of each window; where it is very fine, also that of its longer waves."""
    corners = np.array(
        [
            (left, top)
            for top in _starts(flat.shape[0], window)
            for left in _starts(flat.shape[1], window)
        ]
    )
    waves = _Waves.of(window)
    found: list[list[Seed]] = []
    for some in np.array_split(corners, max(1, len(corners) * window**2 // SPECTRA_AT_ONCE)):
        patches = np.array([flat[y : y + window, x : x + window] for x, y in some])
        power = _powers(patches)
        seeds = _seeds(power, some, waves, HIGHEST_FREQUENCY)
        fine = [
            one is not None and np.linalg.norm(one.waves, axis=1).max() >= FOLDED_FREQUENCY
            for one in seeds
        ]
        longer = iter(_seeds(power[fine], some[fine], waves, FOLDED_FREQUENCY))
        for seed, also in zip(seeds, fine, strict=True):
            both = [seed, next(longer) if also else None]
            found.append([one for one in both if one is not None])
    return found


@dataclass(frozen=True)
class _Waves:
    """Wave vectors of a window's spectrum (2 W, W + 1): lengths, twice their angles, their side."""

    window: int
    radius: FloatArray
    cosine: FloatArray
    sine: FloatArray

    @classmethod
    def of(cls, window: int) -> "_Waves":
        fx = np.fft.rfftfreq(2 * window)[np.newaxis, :]
        fy = np.fft.fftshift(np.fft.fftfreq(2 * window))[:, np.newaxis]
        twice = 2.0 * np.arctan2(fy, fx)
        radius = np.maximum(np.hypot(fx, fy), 1e-9)
        return cls(window, radius, np.cos(twice), np.sin(twice))


def _powers(patches: FloatArray) -> FloatArray:
    """Power spectra (N, 2 W, W + 1) of windows (N, W, W), tapered."""
    window = patches.shape[-1]
    taper = np.hanning(window + 2)[1:-1]
    patches = (patches - patches.mean(axis=(1, 2), keepdims=True)) * np.outer(taper, taper)
    spectrum = scipy.fft.rfft2(patches, (2 * window, 2 * window))
    return np.asarray(np.fft.fftshift(spectrum.real**2 + spectrum.imag**2, axes=1))


def _seeds(
    power: FloatArray, corners: NDArray[np.int64], waves: _Waves, highest: float
) -> list[Seed | None]:
    """The two waves with the most power in each window, of those up to a frequency."""
    ring = (waves.radius > PERIODS_ACROSS / waves.window) & (waves.radius < highest)
    kept = power[:, ring]
    if len(kept) == 0:
        return []
    floor = np.median(kept, axis=1)
    rows = np.argwhere(ring)
    cosine, sine = waves.cosine[ring], waves.sine[ring]
    first = kept.argmax(axis=1)
    alike = cosine * cosine[first, np.newaxis] + sine * sine[first, np.newaxis]
    apart = alike < np.cos(2.0 * SMALLEST_ANGLE)
    second = np.where(apart, kept, 0.0).argmax(axis=1)
    seeds: list[Seed | None] = []
    for index, corner in enumerate(corners):
        if floor[index] <= 0.0:
            seeds.append(None)
            continue
        here = power[index]
        places = [(int(row), int(column)) for row, column in rows[[first[index], second[index]]]]
        vectors = np.array([_refined(here, place, 2 * waves.window) for place in places])
        strengths = [_above_its_kind(here, waves.radius, place) for place in places]
        centre = corner + (waves.window - 1) / 2.0
        seeds.append(Seed(centre, vectors, waves.window, min(strengths), strengths[0]))
    return seeds


def _above_its_kind(power: FloatArray, radius: FloatArray, place: tuple[int, int]) -> float:
    """Power of a wave over the median of all waves about as long.

    Most textures are the stronger the longer the wave: what stands out of all waves need not stand
    out of its own kind.
    """
    ratio = np.exp(ALIKE)
    alike = (radius < radius[place] * ratio) & (radius > radius[place] / ratio)
    return float(power[place] / max(float(np.median(power[alike])), 1e-300))


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
