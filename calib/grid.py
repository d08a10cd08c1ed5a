"""Find the wall grid in a picture and measure its crossings.

Seeds (two crossing waves in a window's spectrum) are extended over the picture, the most probable
first; the coarse lines among the repeating ones are identified and tested for squares; then each
crossing is measured with its covariance.

Both families of lines are level sets of a smooth map from pixels to the wall: a homography after a
radial distortion. The phase of the picture, multiplied by the wave the map predicts and averaged
locally, is the local error of the map; the map is fitted to these phases.
"""

from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache
from itertools import product
from math import gcd
from typing import Self, TypeVar

import cv2
import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from metrology import CalibrationError
from metrology.compiled import compiled

__all__ = [
    "GridMap",
    "MapSupport",
    "Seed",
    "WallGrid",
    "find_seeds",
    "find_wall_grid",
    "flattened",
    "grow",
    "pixel_grid",
    "ranked",
    "refitted",
]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
Real = TypeVar("Real", np.float32, np.float64)

SPECTRUM_WINDOWS_PX = (32, 64, 128, 256)
"""Sides of the windows searched for waves, px (chosen): from eight lines 4 px apart to ten 25 px
apart."""

MIN_WINDOW_PERIODS = 4.0
"""Minimum number of periods in a window (chosen)."""

MAX_WAVE_FREQUENCY = 0.46
"""Highest frequency of a wave, cycles per px (derived: the Nyquist limit minus blur)."""

MIN_ALIASED_FREQUENCY = 1.0 / 3.0
"""Frequency above which waves may be aliased fine lines, cycles per px (chosen); longer waves are
then searched for, too."""

MIN_LINE_ANGLE = np.radians(30.0)
"""Minimum angle between the families, rad (derived): a wall at 60° along its diagonal shows lines
2 atan(cos 60°) = 53° apart; half of that is beyond any view."""

CONTRAST_LIMIT = 4.0
"""Contrast limit, robust standard deviations (chosen): lines are within, a bright ball is not."""

REDUCED_BLUR_PX = 4.0
"""Standard deviation of a Gaussian, px, from which a picture of half the resolution suffices
(chosen)."""

SPECTRUM_BATCH_PIXELS = 2**18
"""Pixels of the windows transformed in one call (chosen: what the caches hold)."""

WAVELENGTH_BAND = 0.2
"""Half width of a band of wavelengths, in the logarithm (chosen)."""


@dataclass(frozen=True)
class Seed:
    """Two crossing waves in one window.

    Attributes
    ----------
    centre : (2,) array
        Middle of the window, px.
    waves : (2, 2) array
        Rows: wave vectors in cycles per px (x, y).
    window : int
        Side of the window, px.
    strength : float
        Power of the weaker wave over the median of waves of similar length in any direction.
    leading : float
        The same of the stronger wave.
    """

    centre: FloatArray
    waves: FloatArray
    window: int
    strength: float
    leading: float


def flattened(image: FloatArray, scale: float) -> FloatArray:
    """Relative contrast with everything slower than `scale` px removed, extremes clipped.

    Lines are paint: they attenuate light by a factor, in the sun and in a shadow alike.

    Parameters
    ----------
    image : (H, W) array
        Gray levels, any positive scale.
    scale : float
        Standard deviation of the Gaussian that defines the illumination, px.

    Returns
    -------
    (H, W) array
        Relative contrast, clipped at 4 of its robust standard deviations.
    """
    light = smoothed(image, scale)
    floor = 0.02 * float(np.percentile(light, 95)) + 1e-12
    contrast = image / np.maximum(light, floor) - 1.0
    spread = 1.4826 * float(np.median(np.abs(contrast)))
    limit = CONTRAST_LIMIT * max(spread, 0.2 * float(contrast.std()))
    return np.asarray(np.clip(contrast, -limit, limit), dtype=np.float64)


def smoothed(
    image: NDArray[Real], sigma: float, at: tuple[slice, slice] | None = None
) -> NDArray[Real]:
    """Gaussian average of a picture (H, W), computed at reduced size if wide.

    Parameters
    ----------
    image : (H, W) array
    sigma : float
        Standard deviation, px.
    at : tuple of slice, optional
        Rows and columns of the pixels at which it is needed, if not everywhere.
    """
    factor = int(sigma / REDUCED_BLUR_PX)
    height, width = image.shape
    if factor < 2 or min(height, width) < 4 * factor:
        if at is not None:
            return _averaged(_averaged(image, sigma, at[0]).T, sigma, at[1]).T
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma))
    size = (width // factor, height // factor)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    # The means over factor × factor pixels contribute to the average.
    left = np.sqrt(sigma**2 - (factor**2 - 1.0) / 12.0) / factor
    even: NDArray[Real] = np.asarray(cv2.GaussianBlur(small, (0, 0), left), dtype=image.dtype)
    if at is not None:
        return _enlarged(_enlarged(even, height, at[0]).T, width, at[1]).T
    return np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_LINEAR))


def _averaged(image: NDArray[Real], sigma: float, rows: slice) -> NDArray[Real]:
    """Some rows of the Gaussian average over rows."""
    kernel = cv2.getGaussianKernel(round(8.0 * sigma + 1.0) | 1, sigma, cv2.CV_32F)[:, 0]
    reach = len(kernel) // 2
    padded = cv2.copyMakeBorder(image, reach, reach, 0, 0, cv2.BORDER_REFLECT_101)
    return np.asarray(sliding_window_view(padded, len(kernel), axis=0)[rows] @ kernel)


def _enlarged(small: NDArray[Real], height: int, rows: slice) -> NDArray[Real]:
    """Some rows of a picture enlarged to a height, by linear interpolation."""
    wanted = np.arange(*rows.indices(height), dtype=small.dtype)
    place = np.clip((wanted + 0.5) * (len(small) / height) - 0.5, 0.0, len(small) - 1.0)
    above = np.minimum(place.astype(np.int64), len(small) - 2)
    part = (place - above).astype(small.dtype)[:, np.newaxis]
    return np.asarray(small[above] * (1.0 - part) + small[above + 1] * part)


MAX_WINDOW_SEEDS = 8
"""Seeds kept of each window size and kind (chosen)."""


def find_seeds(image: FloatArray) -> list[Seed]:
    """Windows in which two waves cross, the strongest first.

    Parameters
    ----------
    image : (H, W) array
        Gray levels.

    Returns
    -------
    list of Seed
        At most `MAX_WINDOW_SEEDS` of each window size and kind.
    """
    seeds: list[Seed] = []
    for window in SPECTRUM_WINDOWS_PX:
        if window > min(image.shape):
            break
        flat = flattened(image, window / 6.0).astype(np.float32)
        here = _window_seeds(flat, window)
        for alike in (
            [pair[0] for pair in here if pair],
            [one for pair in here for one in pair[1:]],
        ):
            seeds += sorted(alike, key=lambda seed: seed.strength, reverse=True)[:MAX_WINDOW_SEEDS]
    return sorted(seeds, key=lambda seed: seed.strength, reverse=True)


def _starts(length: int, window: int) -> NDArray[np.int64]:
    count = max(1, round(2 * (length - window) / window) + 1)
    return np.unique(np.linspace(0, length - window, count).astype(np.int64))


def _window_seeds(flat: FloatImage, window: int) -> list[list[Seed]]:
    """Seeds of each window; a very fine one is joined by that of longer waves."""
    corners = np.array(
        [
            (left, top)
            for top in _starts(flat.shape[0], window)
            for left in _starts(flat.shape[1], window)
        ]
    )
    waves = _Waves.of(window)
    found: list[list[Seed]] = []
    for some in np.array_split(corners, max(1, len(corners) * window**2 // SPECTRUM_BATCH_PIXELS)):
        patches = np.array([flat[y : y + window, x : x + window] for x, y in some])
        power = _powers(patches)
        seeds = _seeds(power, some, waves, MAX_WAVE_FREQUENCY)
        fine = [
            one is not None and np.linalg.norm(one.waves, axis=1).max() >= MIN_ALIASED_FREQUENCY
            for one in seeds
        ]
        longer = iter(_seeds(power[fine], some[fine], waves, MIN_ALIASED_FREQUENCY))
        for seed, also in zip(seeds, fine, strict=True):
            both = [seed, next(longer) if also else None]
            found.append([one for one in both if one is not None])
    return found


@dataclass(frozen=True)
class _Waves:
    """Wave vectors of a window's spectrum (2 W, W + 1).

    Attributes
    ----------
    window : int
        Side of the window, px.
    radius : (2 W, W + 1) array
        Cycles per px.
    cosine, sine : (2 W, W + 1) arrays
        Of twice the angle.
    order, lengths : (M,) arrays
        Flat indices by increasing radius, and those radii.
    """

    window: int
    radius: FloatArray
    cosine: FloatArray
    sine: FloatArray
    order: NDArray[np.int64]
    lengths: FloatArray

    @classmethod
    @cache
    def of(cls, window: int) -> "_Waves":
        fx = np.fft.rfftfreq(2 * window)[np.newaxis, :]
        fy = np.fft.fftshift(np.fft.fftfreq(2 * window))[:, np.newaxis]
        twice = 2.0 * np.arctan2(fy, fx)
        radius = np.maximum(np.hypot(fx, fy), 1e-9)
        order = np.argsort(radius, axis=None)
        lengths = radius.ravel()[order]
        return cls(window, radius, np.cos(twice), np.sin(twice), order, lengths)

    def alike(self, place: tuple[int, int]) -> NDArray[np.int64]:
        """Flat indices of all waves of similar length."""
        ratio, length = np.exp(WAVELENGTH_BAND), self.radius[place]
        first = self.lengths.searchsorted(length / ratio, side="right")
        return self.order[first : self.lengths.searchsorted(length * ratio, side="left")]


def _powers(patches: FloatImage) -> FloatImage:
    """Power spectra (N, 2 W, W + 1) of windows (N, W, W), tapered."""
    window = patches.shape[-1]
    taper = np.hanning(window + 2)[1:-1].astype(np.float32)
    patches = (patches - patches.mean(axis=(1, 2), keepdims=True)) * np.outer(taper, taper)
    spectrum = scipy.fft.rfft2(patches, (2 * window, 2 * window))
    return np.asarray(np.fft.fftshift(spectrum.real**2 + spectrum.imag**2, axes=1))


def _seeds(
    power: FloatImage, corners: NDArray[np.int64], waves: _Waves, highest: float
) -> list[Seed | None]:
    """The two strongest waves of each window below a frequency."""
    ring = (waves.radius > MIN_WINDOW_PERIODS / waves.window) & (waves.radius < highest)
    kept = power[:, ring]
    if len(kept) == 0:
        return []
    # An even picture has no power in half of its waves or more.
    shown = 2 * np.count_nonzero(kept, axis=1) >= kept.shape[1]
    rows = np.argwhere(ring)
    cosine, sine = (turn[ring].astype(np.float32) for turn in (waves.cosine, waves.sine))
    first = kept.argmax(axis=1)
    alike = cosine * cosine[first, np.newaxis] + sine * sine[first, np.newaxis]
    apart = alike < np.cos(2.0 * MIN_LINE_ANGLE)
    second = np.where(apart, kept, 0.0).argmax(axis=1)
    places = rows[np.stack([first, second], axis=1)]
    vectors = _refined(power, places, 2 * waves.window)
    centres = corners + (waves.window - 1) / 2.0
    seeds: list[Seed | None] = []
    for index, here in enumerate(power):
        if not shown[index]:
            seeds.append(None)
            continue
        strengths = [_relative_power(here, waves, (int(y), int(x))) for y, x in places[index]]
        seeds.append(
            Seed(centres[index], vectors[index], waves.window, min(strengths), strengths[0])
        )
    return seeds


def _relative_power(power: FloatImage, waves: _Waves, place: tuple[int, int]) -> float:
    """Power of a wave over the median of waves of similar length.

    In most textures power grows with wavelength, so a wave is compared with its own band only.
    """
    alike = power.ravel()[waves.alike(place)]
    half = len(alike) // 2
    # np.median takes twice as long because of its checks.
    ordered = np.partition(alike, [half - 1, half])
    middle = 0.5 * float(ordered[half - 1 + len(alike) % 2] + ordered[half])
    return float(power[place] / max(middle, 1e-300))


def _refined(power: FloatImage, places: NDArray[np.int64], size: int) -> FloatArray:
    """Wave vectors (N, 2, 2) of peaks, by parabolas through the log power of their neighbours."""
    each = np.arange(len(power))[:, np.newaxis]
    row, column = places[..., 0], places[..., 1]
    least = np.finfo(power.dtype).tiny

    def log(row: NDArray[np.int64], column: NDArray[np.int64]) -> FloatArray:
        # The spectrum of a real picture is even: the column left of 0 is the one right of it.
        column = np.minimum(np.abs(column), power.shape[2] - 1)
        return np.asarray(np.log(np.maximum(power[each, row % power.shape[1], column], least)))

    middle = log(row, column)
    offsets = []
    for down, along in ((0, 1), (1, 0)):
        before, after = log(row - down, column - along), log(row + down, column + along)
        bend = before - 2.0 * middle + after
        peaked = bend < 0.0
        offset = 0.5 * (before - after) / np.where(peaked, bend, 1.0)
        offsets.append(np.where(peaked, np.clip(offset, -0.5, 0.5), 0.0))
    return np.stack([column + offsets[0], row + offsets[1] - size // 2], axis=-1) / size


AVERAGE_STD_PERIODS = 1.3
"""Standard deviation of the averaging window, periods (chosen): narrow enough to follow the view,
wide enough (three effective periods) to distinguish a wave from an edge."""

MIN_COHERENCE = 8.0
"""|mean|² over its expectation in noise (derived: exceeded by chance once in e⁸ = 3000 windows)."""

_AVERAGE_HALF_WIDTH = 4.5
"""Half width of a Gaussian average, standard deviations (derived: 4, plus reduced resolution)."""

REGION_GROWTH = 1.3
"""Factor by which the region grows in a step (chosen): the map is extrapolated by under a third of
its size."""

MAX_GROWN_PERIOD_PX = 6.0
"""Period above which the map is grown on a reduced picture, px (chosen)."""

MAP_PRIOR_STD = np.array([0.5, 0.5, 0.2, 0.1])
"""Prior standard deviations of perspective (2) and distortion (2), per half width of the picture
(chosen): a 45° oblique view through a 90° lens reaches 1; a fish-eye 0.3."""

_MIN_RELATIVE_DEPTH = 0.05
"""Minimum depth over that at the picture's centre (chosen): nearer is behind or beside the
camera."""

PHASE_STD = 0.03
"""Standard deviation of local phases about a smooth map, periods (chosen)."""


_LINE_OFFSETS = tuple(product((0, 1, -1, 2, -2), repeat=2))
"""Line offsets tried for a separate region along both families (chosen): a map that fits one region
predicts the next better than that."""

_INVALID_MAP_COST = 1e300
"""Misfit of a map that puts part of the wall behind the camera."""

_OFFSET_FIT_STEPS = 4
"""Gauss-Newton steps of such a fit (derived: the second is exact except for the nonlinearity)."""

_MIN_OFFSET_LOG_ODDS, _INDEPENDENT_FRACTION = 5.0, 1.0 / (4.0 * np.pi)
"""Log odds by which a line count must exceed the next (chosen: odds of 150); and independent
fraction of windows one standard deviation apart (derived: from the window's effective area)."""


@compiled
def _mapped(
    px: FloatArray, centre: FloatArray, scale: FloatArray, p: FloatArray, grid: FloatArray
) -> None:
    """Write the grid coordinates of pixels (N, 2), see `GridMap`; NaN behind the camera."""
    # single numbers, since the compiler reads an array anew at every pixel
    xx, xy, x1, yx, yy, y1 = p[0], p[1], p[2], p[3], p[4], p[5]
    zx, zy, second, fourth = p[6], p[7], p[8], p[9]
    left, top, wide, high = centre[0], centre[1], scale[0], scale[1]
    for k in range(len(px)):
        x, y = (px[k, 0] - left) / wide, (px[k, 1] - top) / high
        r2 = x * x + y * y
        bent = 1.0 + r2 * (second + r2 * fourth)
        x, y = x * bent, y * bent
        depth = 1.0 + zx * x + zy * y
        per = 1.0 / depth if depth > _MIN_RELATIVE_DEPTH else np.nan
        grid[k, 0], grid[k, 1] = (xx * x + xy * y + x1) * per, (yx * x + yy * y + y1) * per


@compiled
def _write_phases(
    left: int, top: int, centre: FloatArray, scale: FloatArray, p: FloatArray, turns: FloatImage
) -> None:
    """Write the phases (2, h, w) of both waves, -π to π; 0 where there is none."""
    px, grid = np.empty((turns.shape[2], 2)), np.empty((turns.shape[2], 2))
    px[:, 0] = left + np.arange(len(px))
    for row in range(turns.shape[1]):
        px[:, 1] = top + row
        _mapped(px, centre, scale, p, grid)
        for column in range(len(px)):
            u, v = grid[column, 0], grid[column, 1]
            turns[0, row, column] = 2.0 * np.pi * (u - np.rint(u)) if u == u else 0.0
            turns[1, row, column] = 2.0 * np.pi * (v - np.rint(v)) if v == v else 0.0


@dataclass(frozen=True)
class GridMap:
    """Map from pixels to grid coordinates (in periods).

    Attributes
    ----------
    centre : (2,) array
        Centre of distortion, px.
    scale : (2,) array
        Px per unit of the normalised coordinates.
    parameters : (10,) array
        Homography (rows 1 and 2, then the two perspective terms), then the coefficients of r² and
        r⁴ by which normalised coordinates are multiplied.
    """

    centre: FloatArray
    scale: FloatArray
    parameters: FloatArray

    def __call__(self, px: ArrayLike) -> FloatArray:
        """Grid coordinates (..., 2) of pixels (..., 2)."""
        places = np.ascontiguousarray(px, dtype=np.float64)
        found = np.empty_like(places)
        flat = (-1, 2)
        _mapped(places.reshape(flat), self.centre, self.scale, self.parameters, found.reshape(flat))
        return found

    def turns(
        self, shape: tuple[int, ...], part: tuple[slice, slice] = (slice(None), slice(None))
    ) -> FloatImage:
        """Phases of both waves over a part of a picture, (2, h, w), -π to π; 0 where none."""
        rows, columns = (range(*one.indices(size)) for one, size in zip(part, shape, strict=True))
        found = np.empty((2, len(rows), len(columns)), dtype=np.float32)
        _write_phases(columns.start, rows.start, self.centre, self.scale, self.parameters, found)
        return found

    def jacobian(self, px: ArrayLike) -> FloatArray:
        """Wave vectors: derivative of the grid coordinates by px, (..., 2, 2)."""
        px = np.asarray(px, dtype=np.float64)
        columns = []
        for axis in range(2):
            step = np.zeros(2)
            step[axis] = 0.5
            columns.append(self(px + step) - self(px - step))
        return np.stack(columns, axis=-1)

    def inverse(self, grid: ArrayLike, start: ArrayLike) -> FloatArray:
        """Pixels (N, 2) of grid coordinates (N, 2), by Newton's method from pixels `start`."""
        grid = np.asarray(grid, dtype=np.float64)
        px = np.array(start, dtype=np.float64)
        for _ in range(12):
            px = px - np.linalg.solve(self.jacobian(px), (self(px) - grid)[..., np.newaxis])[..., 0]
        return px

    def rebased(self, matrix: ArrayLike, shift: ArrayLike) -> "GridMap":
        """Map to other grid coordinates, matrix @ old + shift."""
        p = self.parameters
        old = np.array([p[0:3], p[3:6], [p[6], p[7], 1.0]])
        change = np.eye(3)
        change[:2, :2] = matrix
        change[:2, 2] = shift
        new = change @ old
        return replace(self, parameters=np.concatenate([new[0], new[1], p[6:]]))

    def resized(self, sx: float, sy: float) -> "GridMap":
        """The same map for the picture resampled to sx times its width and sy times its height."""
        ratio = np.array([sx, sy])
        return replace(self, centre=(self.centre + 0.5) * ratio - 0.5, scale=self.scale * ratio)

    def moved(self, steps: FloatArray) -> "GridMap":
        """Map with `steps` (10,) added to its parameters."""
        return replace(self, parameters=self.parameters + steps)


@dataclass(frozen=True)
class MapSupport:
    """Local agreement of a map with the picture.

    Attributes
    ----------
    phase : (2, H, W) array
        Phase error of the map, periods, for both families.
    coherence : (2, H, W) array
        |mean|² over its expectation in noise.
    share : (2, H, W) array
        Fraction of the local variance explained by the wave.
    counted : (H, W) array
        Where the line numbers are certain, if not everywhere.
    """

    phase: FloatArray
    coherence: FloatArray
    share: FloatArray
    counted: BoolArray | None = None

    @cached_property
    def area(self) -> NDArray[np.bool_]:
        """Pixels (H, W) at which both families agree with the map."""
        seen = (self.coherence > MIN_COHERENCE) & (np.abs(self.phase) < 0.25)
        both = np.asarray(seen.all(axis=0))
        return both if self.counted is None else both & self.counted

    @cached_property
    def explained(self) -> float:
        """Fraction of the picture's variance explained by both waves together."""
        return float(np.where(self.area, self.share.sum(axis=0), 0.0).mean())


def pixel_grid(shape: tuple[int, ...]) -> FloatArray:
    """Coordinates of all pixels, (H, W, 2)."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return np.stack([columns, rows], axis=-1).astype(np.float64)


@dataclass(frozen=True)
class _Contrast:
    """Relative contrast of a picture, and its average square.

    Attributes
    ----------
    flat, energy : (H, W) float32 arrays
    sigma : float
        Standard deviation of the Gaussian average, px.
    """

    flat: FloatImage
    energy: FloatImage
    sigma: float

    @classmethod
    def of(cls, flat: FloatArray, sigma: float) -> "_Contrast":
        """From relative contrast (H, W)."""
        single = flat.astype(np.float32)
        return cls(single, np.maximum(smoothed(single * single, sigma), np.float32(1e-12)), sigma)

    def cut(self, part: tuple[slice, slice]) -> "_Contrast":
        """A part of the picture."""
        return replace(self, flat=self.flat[part], energy=self.energy[part])

    def demodulated(self, turns: FloatImage, at: tuple[slice, slice] | None = None) -> MapSupport:
        """Compare with a map's waves, whose phases are (2, H, W); `at` some pixels only."""
        independent = np.float32(4.0 * np.pi * self.sigma**2)
        energy = self.energy if at is None else self.energy[at]
        angles, coherences, shares = [], [], []
        for turn in turns:
            real = smoothed(self.flat * np.cos(turn), self.sigma, at)
            imaginary = smoothed(self.flat * np.sin(turn), self.sigma, at)
            share = (real**2 + imaginary**2) / energy
            angles.append(np.arctan2(-imaginary, real) / np.float32(2.0 * np.pi))
            coherences.append(share * independent)
            shares.append(np.float32(2.0) * share)
        phase, coherence, share = (
            np.array(one, dtype=np.float64) for one in (angles, coherences, shares)
        )
        return MapSupport(phase, coherence, share)


def _between(there: BoolArray, stride: int, reach: int) -> tuple[slice, slice, slice]:
    """From the first to the last true one of pixels `stride` apart.

    Returns
    -------
    part : slice
        All pixels that contribute to averages at these, up to `reach` away.
    at : slice
        The pixels within that part.
    own : slice
        Their places among all that are `stride` apart.
    """
    places = np.flatnonzero(there)
    own = slice(int(places[0]), int(places[-1]) + 1)
    first, last = (stride // 2 + stride * int(place) for place in places[[0, -1]])
    part = slice(max(first - reach, 0), last + reach + 1)
    return part, slice(first - part.start, last - part.start + 1, stride), own


def grow(image: FloatArray, seed: Seed) -> tuple[GridMap, MapSupport]:
    """Extend a seed over the picture as far as the map agrees.

    Parameters
    ----------
    image : (H, W) array
        Gray levels.
    seed : Seed
        Two waves in a window.

    Returns
    -------
    GridMap, MapSupport
        The fitted map and its agreement, which may be at reduced resolution. Phase 0 is the
        brightest.
    """
    period = float(1.0 / np.linalg.norm(seed.waves, axis=1).max())
    factor = max(1, int(period / MAX_GROWN_PERIOD_PX))
    if factor > 1:
        size = (image.shape[1] // factor, image.shape[0] // factor)
        ratio = np.array([size[0] / image.shape[1], size[1] / image.shape[0]])
        area = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        small = np.asarray(area, dtype=np.float64)
        centre = (seed.centre + 0.5) * ratio - 0.5
        window = max(1, round(seed.window * float(ratio[0])))
        found, support = grow(
            small, replace(seed, centre=centre, waves=seed.waves / ratio, window=window)
        )
        return found.resized(1.0 / ratio[0], 1.0 / ratio[1]), support
    longest = float(1.0 / np.linalg.norm(seed.waves, axis=1).min())
    sigma = AVERAGE_STD_PERIODS * longest
    flat = flattened(image, 1.5 * longest)
    current = _affine(seed, (image.shape[1], image.shape[0]))
    stride = max(1, int(sigma))
    place = (slice(stride // 2, None, stride),) * 2
    pixels = pixel_grid(image.shape)[place]
    distance = np.linalg.norm(pixels - seed.centre, axis=-1)
    last = np.array(image.shape[::-1]) - 1.0
    farthest = np.linalg.norm(np.maximum(seed.centre, last - seed.centre))
    reach = max(0.5 * seed.window, 3.0 * longest)
    contrast, margin = _Contrast.of(flat, sigma), int(np.ceil(_AVERAGE_HALF_WIDTH * sigma))
    while True:
        near = distance < reach
        rows, columns = (_between(near.any(axis=axis), stride, margin) for axis in (1, 0))
        part, at, own = zip(rows, columns, strict=True)
        there, here = contrast.cut(part), near[own]
        for _ in range(2):
            seen = there.demodulated(current.turns(image.shape, part), at)
            current = _fitted(current, pixels[near], seen.phase[:, here], seen.coherence[:, here])
        agree = (seen.coherence[:, here] > MIN_COHERENCE).all(axis=0)
        if reach > farthest or not agree.any():
            # where the map agrees nowhere there is nothing to extend it from
            break
        reach *= REGION_GROWTH
    support = contrast.demodulated(current.turns(image.shape))
    label = _parts(support.area)
    if label.max() < 2:
        return current, support
    samples = _Samples.of(support, pixels, place)
    current, surely = _renumbered(current, samples, label[place].ravel())
    support = contrast.demodulated(current.turns(image.shape))
    return current, replace(support, counted=np.isin(label, [0, *surely]))


def _parts(area: BoolArray) -> NDArray[np.int32]:
    """Label of the connected region of each pixel, the largest 1; 0 for none or a small one.

    Small regions hold too few lines to be numbered.
    """
    _, label = cv2.connectedComponents(area.astype(np.uint8))
    size = np.bincount(label.ravel())
    size[0] = 0
    large = [int(part) for part in np.argsort(-size) if size[part] > MIN_GRID_AREA * label.size]
    rank = np.zeros(len(size), dtype=np.int32)
    rank[large] = np.arange(1, len(large) + 1)
    return np.asarray(rank[label])


@dataclass(frozen=True)
class _Samples:
    """Phase errors of a map at some pixels.

    Attributes
    ----------
    px : (N, 2) array
    shift : (N, 2) array
        Phase errors, periods.
    weight : (N, 2) array
        Inverse variances, periods^-2.
    """

    px: FloatArray
    shift: FloatArray
    weight: FloatArray

    @classmethod
    def of(cls, support: MapSupport, pixels: FloatArray, place: tuple[slice, slice]) -> Self:
        """From a map's support at some pixels (h, w, 2)."""
        phase, coherence = (
            one[(slice(None), *place)].reshape(2, -1) for one in (support.phase, support.coherence)
        )
        return cls(pixels.reshape(-1, 2), phase.T, _phase_weights(phase, coherence).T)

    def at(self, rows: BoolArray) -> Self:
        """Some of the pixels (N,)."""
        return replace(self, px=self.px[rows], shift=self.shift[rows], weight=self.weight[rows])


def _renumbered(
    current: GridMap, samples: _Samples, label: NDArray[np.int32]
) -> tuple[GridMap, list[int]]:
    """Number the lines of each separate region again; return the map and the certain regions.

    Where an object hides lines from top to bottom, the waves of one region extrapolated across it
    may be off by a whole line, and a bent map then fits both. Each region takes the line offset
    with the best fit, the largest first; a region whose offset is uncertain is dropped.

    Parameters
    ----------
    samples : _Samples
        At N pixels.
    label : (N,) int array
        Region of each pixel, the largest 1; 0 for none.
    """
    surely, aims = [1], current(samples.px) + samples.shift
    for part in range(2, int(label.max()) + 1):
        inside = np.isin(label, [*surely, part])
        chosen, own = samples.at(inside), (label[inside] == part)[:, np.newaxis]
        maps = [
            _fitted_to_coordinates(current, chosen, aims[inside] + own * np.array(lines))
            for lines in _LINE_OFFSETS
        ]
        costs = np.nan_to_num(
            [cost for _, cost in maps], nan=_INVALID_MAP_COST, posinf=_INVALID_MAP_COST
        )
        best, second = np.argsort(costs)[:2]
        spare = max(2 * len(chosen.px) - len(current.parameters), 1)
        # Errors are scaled to the best map if they exceed the assumed ones.
        usual = max(1.0, costs[best] / spare)
        if (
            not _INDEPENDENT_FRACTION * 0.5 * (costs[second] - costs[best])
            > _MIN_OFFSET_LOG_ODDS * usual
        ):
            continue
        surely.append(part)
        aims[label == part] += _LINE_OFFSETS[best]
        if any(_LINE_OFFSETS[best]):
            current = maps[best][0]
    return current, surely


def _fitted_to_coordinates(
    current: GridMap, samples: _Samples, aims: FloatArray
) -> tuple[GridMap, float]:
    """Map that takes pixels to given grid coordinates (N, 2), and its chi-square."""
    for _ in range(_OFFSET_FIT_STEPS):
        current = refitted(current, samples.px, aims - current(samples.px), samples.weight)
    left = aims - current(samples.px)
    strayed = current.parameters[-len(MAP_PRIOR_STD) :] / MAP_PRIOR_STD
    return current, float((samples.weight * left**2).sum() + strayed @ strayed)


def _affine(seed: Seed, size: tuple[int, int]) -> GridMap:
    centre = (np.array(size) - 1.0) / 2.0
    scale = np.full(2, size[0] / 2.0)
    rows = seed.waves * scale
    shift = -seed.waves @ (seed.centre - centre)
    parameters = np.concatenate([rows[0], shift[:1], rows[1], shift[1:], np.zeros(4)])
    return GridMap(centre, scale, parameters)


def _fitted(current: GridMap, px: FloatArray, phase: FloatArray, coherence: FloatArray) -> GridMap:
    """Map corrected for the phases at `px`: one robust Gauss-Newton step with priors."""
    return refitted(current, px, phase.T, _phase_weights(phase, coherence).T)


def _phase_weights(phase: FloatArray, coherence: FloatArray) -> FloatArray:
    """Inverse variances of phases, periods^-2."""
    weight = np.where(coherence > MIN_COHERENCE, np.minimum(coherence, 50.0) / 50.0, 0.0)
    # Cauchy weights: a window on a shadow's edge has a biased phase.
    return weight / (1.0 + (phase / 0.1) ** 2) / PHASE_STD**2


@compiled
def _add_normal_equations(
    px: FloatArray,
    shift: FloatArray,
    weight: FloatArray,
    centre: FloatArray,
    scale: FloatArray,
    p: FloatArray,
    normal: FloatArray,
    right: FloatArray,
) -> None:
    """Add the normal equations of shifts (N, 2) at pixels (N, 2) for a map's parameters."""
    row = np.zeros(10)
    for k in range(len(px)):
        u, v = (px[k, 0] - centre[0]) / scale[0], (px[k, 1] - centre[1]) / scale[1]
        r2 = u * u + v * v
        bent = 1.0 + r2 * (p[8] + r2 * p[9])
        x, y = u * bent, v * bent
        depth = 1.0 + p[6] * x + p[7] * y
        if not depth > _MIN_RELATIVE_DEPTH:
            continue
        for family in range(2):
            first = 3 * family
            value = (p[first] * x + p[first + 1] * y + p[first + 2]) / depth
            along = (p[first] - value * p[6]) * u + (p[first + 1] - value * p[7]) * v
            row[0:6] = 0.0
            row[first], row[first + 1], row[first + 2] = x / depth, y / depth, 1.0 / depth
            row[6], row[7] = -value * x / depth, -value * y / depth
            row[8], row[9] = along * r2 / depth, along * r2 * r2 / depth
            for i in range(10):
                part = weight[k, family] * row[i]
                if part == 0.0:
                    continue
                right[i] += part * shift[k, family]
                for j in range(10):
                    normal[i, j] += part * row[j]


def refitted(current: GridMap, px: FloatArray, shift: FloatArray, weight: FloatArray) -> GridMap:
    """Map corrected for measured shifts, with priors.

    Parameters
    ----------
    px : (N, 2) array
        Positions.
    shift : (N, 2) array
        Error of the mapped grid coordinates there, periods.
    weight : (N, 2) array
        Inverse variances, periods^-2.
    """
    normal, right = np.zeros((10, 10)), np.zeros(10)
    # A single memory layout, so that the loop is compiled once.
    px, shift, weight = (np.ascontiguousarray(one) for one in (px, shift, weight))
    _add_normal_equations(
        px, shift, weight, current.centre, current.scale, current.parameters, normal, right
    )
    normal[np.arange(6, 10), np.arange(6, 10)] += MAP_PRIOR_STD**-2
    right[6:] -= current.parameters[6:] * MAP_PRIOR_STD**-2
    normal[np.arange(6), np.arange(6)] += 1e-6
    return current.moved(np.asarray(np.linalg.solve(normal, right), dtype=np.float64))


PROFILE_BINS = 32
"""Bins per period of the profile across a line (chosen): a line is three bins wide."""

FINE_PER_COARSE = (2, 3, 4, 5, 6, 8, 10)
"""Fine lines per coarse one (convention: rulers and millimetre paper)."""

MIN_HARMONIC_HEIGHT = 5.0
"""Height of a harmonic over the median of its surroundings (chosen)."""

MIN_WAVE_HEIGHT = 3.0
"""The same for the wave itself (chosen); local coherence has confirmed it already."""

MIN_HARMONIC_AMPLITUDE = 0.03
"""Minimum amplitude of a harmonic, fraction of the wave's (chosen): fainter may be shading or
compression."""

MIN_ALIASED_AMPLITUDE = 0.15
"""The same where harmonics alias (chosen: five times as much, since aliases add to them)."""

MIN_ALIAS_FREE_PERIOD_PX = 6.0
"""Period, px, below which harmonics of sharp lines alias onto coarser ones (derived)."""

MAX_HARMONIC = 12
"""Order of the highest harmonic (derived: those of a line a tenth of a period wide vanish at
10)."""


@dataclass(frozen=True)
class Lattice:
    """Coarse lines of one family, relative to the waves first found.

    Attributes
    ----------
    multiple : int
        Periods of the first wave in one coarse period.
    clear : bool
        Whether the wave is significant in the spectrum across its lines.
    offset : float
        Position of a coarse line, coarse periods.
    dark : bool
        Whether lines are darker than the wall.
    template : (12,) array
        Amplitudes of the harmonics 1 to 12 of the profile across a line, positive for a peak.
    fine : int or None
        Fine periods in a coarse one, where fine lines are resolved.
    """

    multiple: int
    clear: bool
    offset: float
    dark: bool
    template: FloatArray
    fine: int | None


def analysed(
    values: FloatArray, coordinate: FloatArray, period_px: float, is_coarse: bool = True
) -> Lattice:
    """Find the coarse lines of one family.

    Parameters
    ----------
    values : (N,) array
        Relative contrast of the pixels on the wall.
    coordinate : (N,) array
        Their grid coordinate across the family's lines, in periods of the wave first found.
    period_px : float
        That period, px.
    is_coarse : bool
        Whether coarser lines are looked for, or the wave is taken for that of the coarse ones.
    """
    multiple, clear = _coarsest(
        values,
        coordinate,
        MIN_HARMONIC_AMPLITUDE if period_px > MIN_ALIAS_FREE_PERIOD_PX else MIN_ALIASED_AMPLITUDE,
    )
    multiple = multiple if is_coarse else 1
    coordinate = coordinate / multiple
    turn = np.exp(-2j * np.pi * coordinate)
    wave = values * turn
    means = [2.0 * np.mean(wave)]
    for _ in range(1, MAX_HARMONIC):
        wave = wave * turn
        means.append(2.0 * np.mean(wave))
    harmonics = np.array(means)
    index = (np.floor((coordinate % 1.0) * PROFILE_BINS)).astype(np.int64) % PROFILE_BINS
    counts = np.maximum(np.bincount(index, minlength=PROFILE_BINS), 1)
    profile = np.bincount(index, weights=values, minlength=PROFILE_BINS) / counts
    profile = profile - profile.mean()
    # Lines are thinner than the gaps between them, so the profile is skewed towards them.
    dark = bool(np.sum(profile**3) <= 0.0)
    sign = -1.0 if dark else 1.0
    offset = -float(np.angle(sign * harmonics[0])) / (2.0 * np.pi)
    order = np.arange(1, MAX_HARMONIC + 1)
    template = (sign * harmonics * np.exp(2j * np.pi * order * offset)).real
    # Fine lines put all their power into the multiples of one harmonic.
    fine = None
    for ratio in (4, 5, 10):
        if period_px * multiple < 2.2 * ratio:
            continue
        around = [abs(template[ratio + side - 1]) for side in (-1, 1) if 1 < ratio + side <= 12]
        if template[ratio - 1] > 1.3 * max(around):
            fine = ratio
            break
    return Lattice(multiple, clear, offset, dark, template, fine)


def _coarsest(values: FloatArray, coordinate: FloatArray, faintest: float) -> tuple[int, bool]:
    start = float(coordinate.min())
    index = ((coordinate - start) * PROFILE_BINS).astype(np.int64)
    sums = np.bincount(index, weights=values - values.mean())
    periods = len(sums) / PROFILE_BINS
    oversampled = 4 * len(sums)
    spectrum = np.abs(np.fft.rfft(sums * np.hanning(len(sums)), oversampled))
    unit = oversampled / PROFILE_BINS  # bins of the spectrum per cycle of the wave

    def height(frequency: float, tolerance: float) -> tuple[float, float]:
        middle, near, far = frequency * unit, 1.0 * unit / periods, 8.0 * unit / periods
        around = np.arange(max(0, int(middle - far)), int(middle + far) + 1)
        distance = np.abs(around - middle)
        # A true peak is a local maximum; the flank of a stronger neighbour is not.
        close = around[distance <= 2.0 * near]
        highest = int(close[np.argmax(spectrum[close])])
        peak = float(spectrum[highest]) if abs(highest - middle) <= tolerance * near else 0.0
        return peak, float(np.median(spectrum[around[distance > 3.0 * near]]))

    reference = height(1.0, 2.0)[0]

    def seen(frequency: float, tolerance: float = 0.8, clear: float = MIN_HARMONIC_HEIGHT) -> bool:
        peak, floor = height(frequency, tolerance)
        return peak > clear * floor and peak > faintest * reference

    best = 1
    for multiple in FINE_PER_COARSE:
        if periods / multiple < 4.0:
            break
        parts = [j for j in range(1, multiple) if gcd(j, multiple) == 1]
        share = np.mean([seen(j / multiple) for j in parts])
        if seen(1 / multiple) and share >= 0.75:
            best = multiple
    return best, seen(1.0, 2.0, MIN_WAVE_HEIGHT)


_CELL_BINS = 20
"""Bins per period of the averaged cell (chosen: a line of a tenth of the period has two)."""


def folded(values: FloatArray, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Average the grid's cells into one picture of two by two cells.

    Parameters
    ----------
    values : (N,) array
    grid : (N, 2) array
        Grid coordinates, periods.

    Returns
    -------
    mean, count : (2 `_CELL_BINS`, 2 `_CELL_BINS`) array
    """
    bins = _CELL_BINS
    index = np.floor((grid % 2.0) * bins).astype(np.int64) % (2 * bins)
    flat_index = index[:, 0] * 2 * bins + index[:, 1]
    count = np.bincount(flat_index, minlength=4 * bins * bins).astype(np.float64)
    total = np.bincount(flat_index, weights=values, minlength=4 * bins * bins)
    mean = total / np.maximum(count, 1.0)
    shape = (2 * bins, 2 * bins)
    return mean.reshape(shape), count.reshape(shape)


def off_axis_power(values: FloatArray, grid: FloatArray) -> float:
    """Power of the pattern that does not belong to continuous lines.

    Continuous lines have power on both axes of the cell's spectrum only; a chessboard has much
    between the axes, and a brick wall (broken joints) also at half orders.

    Returns
    -------
    float
        Power off the axes over the power of the weaker family, noise subtracted.
    """
    mean, count = folded(values, grid)
    noise = float(np.var(values)) / float(np.mean(np.maximum(count, 1.0))) * mean.size
    power = np.abs(np.fft.fft2(mean - mean.mean())) ** 2
    order = np.abs(np.fft.fftfreq(mean.shape[0], 1.0 / mean.shape[0])).round().astype(int)
    low = (order > 0) & (order <= 8)
    off = power[np.ix_(low, low)]
    families = [power[low, 0].sum(), power[0, low].sum()]
    return float(max(off.sum() - noise * off.size, 0.0) / max(min(families), 1e-300))


def squareness(grid_map: GridMap) -> tuple[float, float]:
    """Aspect ratio and angle cosine of the cells, at the focal length that fits best.

    Parameters
    ----------
    grid_map : GridMap
        Map from pixels to grid coordinates.

    Returns
    -------
    aspect, cosine : float
        1 and 0 for a square grid seen by a camera with square pixels.
    """
    p = grid_map.parameters
    to_grid = np.array([p[0:3], p[3:6], [p[6], p[7], 1.0]])
    columns = np.linalg.inv(to_grid)[:, :2]
    best = (np.inf, 1.0, 0.0)
    for focal in np.geomspace(0.4, 20.0, 60):  # in half widths of the picture
        a, b = (columns / np.array([[focal], [focal], [1.0]])).T
        aspect = float(np.linalg.norm(a) / np.linalg.norm(b))
        cosine = float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
        cost = np.log(aspect) ** 2 + cosine**2
        if cost < best[0]:
            best = (cost, aspect, cosine)
    return best[1], best[2]


MAX_BLOCK = 6
"""Maximum side of a block measured as one crossing, periods (chosen: averaging 36 crossings reduces
the noise to a sixth)."""

MIN_BLOCK_CLARITY = 6.0
"""Median amplitude of a block, standard deviations (chosen: phase noise of a sixth of a radian)."""

MAX_SHIFT_STD = 1.0 / 12.0
"""Robust standard deviation of the shifts, periods (derived): six of these change a label by one
line. Structure finer than the lines, or aliased, shifts small blocks by more than noise does."""

MAX_HARMONIC_FREQUENCY = 0.46
"""Highest frequency used, cycles per px (derived: the Nyquist limit minus blur and window)."""

BLOCK_BATCH_PIXELS = 8192
"""Pixels processed at once (chosen: their harmonics fit into a core's cache, a megabyte)."""


@dataclass(frozen=True)
class Nodes:
    """Crossings of the grid and their distances from the mapped positions.

    Attributes
    ----------
    index : (N, 2) int array
        Grid coordinates.
    shift : (N, 2) array
        Mapped coordinate of the crossing minus `index`, periods.
    covariance : (N, 2, 2) array
        Of `shift`, periods².
    strength : (N, 2) array
        Contrast of both families over the picture's typical contrast.
    block : int
        Side of the blocks averaged into a node, periods; blocks do not overlap.
    """

    index: NDArray[np.int64]
    shift: FloatArray
    covariance: FloatArray
    strength: FloatArray
    block: int


def measured_nodes(
    flat: FloatArray,
    grid: FloatArray,
    usable: NDArray[np.bool_],
    frequency: FloatArray,
    templates: tuple[FloatArray, FloatArray],
) -> Nodes:
    """Measure every block of the grid in view.

    Parameters
    ----------
    flat : (H, W) array
        Relative contrast.
    grid : (H, W, 2) array
        Grid coordinates of the pixels by the current map.
    usable : (H, W) bool array
        Where the grid is visible.
    frequency : (2,) array
        Highest local frequency of both families, cycles per px.
    templates : tuple of (12,) arrays
        Harmonics of both profiles, signed as they appear in `flat`.

    Returns
    -------
    Nodes
        From the smallest blocks whose lines are significant and agree with the map.
    """
    orders = tuple(
        _harmonics(template, float(f)) for template, f in zip(templates, frequency, strict=True)
    )
    values, coordinates = flat[usable], grid[usable]
    nodes = None
    for block in range(1, MAX_BLOCK + 1):
        nodes, clarity = _blocks(values, coordinates, block, orders, templates)
        scatter = 1.4826 * np.median(np.abs(nodes.shift)) if len(nodes.shift) else np.inf
        if clarity > MIN_BLOCK_CLARITY and scatter < MAX_SHIFT_STD:
            break
    assert nodes is not None
    return nodes


def _harmonics(template: FloatArray, frequency: float) -> tuple[int, ...]:
    orders = np.arange(1, len(template) + 1)
    strong = np.abs(template) > 0.15 * np.abs(template[0])
    below = orders * frequency < MAX_HARMONIC_FREQUENCY
    chosen = orders[strong & below][:6]
    return tuple(int(k) for k in chosen) or (1,)


def _blocks(
    values: FloatArray,
    coordinates: FloatArray,
    block: int,
    orders: tuple[tuple[int, ...], ...],
    templates: tuple[FloatArray, FloatArray],
) -> tuple[Nodes, float]:
    cell = np.round(coordinates / block).astype(np.int64)
    first = cell.min(axis=0)
    shape = cell.max(axis=0) - first + 1
    label = (cell[:, 0] - first[0]) * shape[1] + cell[:, 1] - first[1]
    size = int(shape[0] * shape[1])
    count, normal, right, square = _normal_equations(
        values, coordinates, coordinates / block - cell, label, size, orders
    )
    unknowns = normal.shape[-1]
    full = count > max(0.6 * np.percentile(count[count > 0], 80), 1.5 * unknowns)
    normal, right, square, count = normal[full], right[full], square[full], count[full]
    ridge = 1e-6 * count[:, np.newaxis, np.newaxis] * np.eye(unknowns)
    inverse = np.linalg.inv(normal + ridge)
    solution = np.einsum("nij,nj->ni", inverse, right)
    left_over = square - np.einsum("ni,ni->n", solution, right)
    variance = np.maximum(left_over, 1e-12) / np.maximum(count - unknowns, 1)
    index = np.argwhere(np.ones(shape, dtype=bool))[full] + first
    shift, covariance, strength, clarity = _shifts(
        solution, inverse * variance[:, np.newaxis, np.newaxis], orders, templates
    )
    return Nodes(index * block, shift, covariance, strength, block), clarity


def _normal_equations(
    values: FloatArray,
    coordinates: FloatArray,
    within: FloatArray,
    label: NDArray[np.int64],
    size: int,
    orders: tuple[tuple[int, ...], ...],
) -> tuple[NDArray[np.int64], FloatArray, FloatArray, FloatArray]:
    """Number of pixels per block, and the normal equations of its illumination and waves.

    Blocks are processed in groups of some thousand pixels, which fit into the caches.
    """
    count = np.bincount(label, minlength=size)
    # Small integers are sorted by radix, not by comparison.
    order = np.argsort(label.astype(np.min_scalar_type(size)), kind="stable")
    ends = np.cumsum(count)
    unknowns = 3 + 2 * sum(len(some) for some in orders)
    products = np.zeros((size, unknowns + 1, unknowns + 1))
    begin = 0
    while begin < size:
        at = int(ends[begin] - count[begin])
        end = max(begin + 1, int(np.searchsorted(ends, at + BLOCK_BATCH_PIXELS)))
        some = order[at : ends[end - 1]]
        columns = np.empty((len(some), unknowns + 1))
        columns[:, 0] = 1.0
        columns[:, 1:3] = within[some]
        columns[:, 3:-1] = _waves(coordinates[some], orders)
        columns[:, -1] = values[some]
        for block in range(begin, end):
            own = columns[ends[block] - count[block] - at : ends[block] - at]
            products[block] = own.T @ own
        begin = end
    return count, products[:, :-1, :-1], products[:, :-1, -1], products[:, -1, -1]


def _waves(coordinates: FloatArray, orders: tuple[tuple[int, ...], ...]) -> FloatImage:
    """Cosine and sine of every order of both families, (N, 2 O)."""
    columns = []
    turns = np.float32(2.0 * np.pi) * (coordinates - np.rint(coordinates)).astype(np.float32)
    for family in range(2):
        once = np.cos(turns[:, family]) + np.complex64(1j) * np.sin(turns[:, family])
        power = once
        for order in range(1, max(orders[family]) + 1):
            power = power * once if order > 1 else once
            if order in orders[family]:
                columns += [power.real, power.imag]
    return np.stack(columns, axis=-1)


def _shifts(
    solution: FloatArray,
    covariance: FloatArray,
    orders: tuple[tuple[int, ...], ...],
    templates: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Shift of both families from the sine terms, which are zero without a shift."""
    blocks = solution.shape[0]
    maps = np.zeros((blocks, 2, solution.shape[1]))
    strength = np.empty((blocks, 2))
    clarity = [np.inf if blocks else 0.0]
    at = 3
    for family in range(2):
        ks = np.array(orders[family])
        template = templates[family][ks - 1]
        cosines = at + 2 * np.arange(len(ks))
        sines = cosines + 1
        at += 2 * len(ks)
        strength[:, family] = solution[:, cosines] @ template / (template @ template)
        noise = np.einsum("nii->ni", covariance)
        slope = 2.0 * np.pi * ks * template * np.maximum(strength[:, family], 0.05)[:, np.newaxis]
        weight = slope**2 / noise[:, sines]
        maps[:, family, sines] = weight / slope / weight.sum(axis=1, keepdims=True)
        amplitude = np.abs(strength[:, family]) * np.linalg.norm(template)
        if blocks:
            clarity.append(np.median(amplitude / np.sqrt(noise[:, cosines].mean(axis=1))))
    shift = np.einsum("nfi,ni->nf", maps, solution)
    spread = np.einsum("nfi,nij,ngj->nfg", maps, covariance, maps)
    return shift, spread, strength, float(min(clarity))


MAX_SEEDS = 12
"""Maximum number of seeds tried (chosen)."""

MAX_SEARCH_WIDTH_PX = 960
"""Width to which larger pictures are reduced for the search, px (chosen: time grows with area)."""

SUFFICIENT_AREA = 0.7
"""Fraction of the picture covered by a lattice that ends the search (chosen)."""

MAX_SPACING_RATIO = 1.6
"""Maximum ratio of both spacings (derived: squares seen at 50° are 1.6 times as high as wide)."""

MIN_GRID_AREA = 0.03
"""Minimum fraction of the picture (chosen): smaller areas have too few lines to number."""

MIN_CANDIDATE_VARIANCE = 0.9
"""Fraction of the best lattice's explained variance from which another is tried, too (chosen)."""

MIN_FUNDAMENTAL_VARIANCE = 0.3
"""Fraction of the best lattice's explained variance that its fundamental waves have (chosen); other
waves are their overtones."""

OVERTONE_ORDERS = range(2, 13)

MAX_WAVE_DIFFERENCE = 0.003
"""Maximum difference of equal waves, cycles per px (chosen)."""


def growths(gray: FloatArray) -> list[tuple[GridMap, MapSupport]]:
    """Grow maps from the seeds in a picture.

    Parameters
    ----------
    gray : (H, W) array
        Gray levels, none negative.

    Returns
    -------
    list of (GridMap, MapSupport)
        Best first; others only if they explain nearly as much, or are its fundamental waves.

    Raises
    ------
    CalibrationError
        If nothing repeats in two directions.
    """
    stripes = 0.0
    for image, ratio in _resolutions(gray):
        grown: list[tuple[GridMap, MapSupport]] = []
        seeds = find_seeds(image)
        tried = _distinct(seeds)[:MAX_SEEDS]
        for seed in tried:
            grid_map, support = grow(image, seed)
            stripes = max(stripes, _striped(support))
            grown.append((grid_map.resized(ratio[0], ratio[1]), support))
            best = max(grown, key=lambda one: one[1].explained)
            lengths = np.linalg.norm(best[0].jacobian(best[0].centre), axis=1)
            if (
                best[1].area.mean() > SUFFICIENT_AREA
                and lengths.max() < MAX_SPACING_RATIO * lengths.min()
            ):
                break
        grown.sort(key=lambda one: one[1].explained, reverse=True)
        if grown and grown[0][1].area.mean() > MIN_GRID_AREA:
            return ranked(grown)
        if seeds:
            clearest = max(seeds, key=lambda seed: seed.leading)
            if not any(seed is clearest for seed in tried):
                stripes = max(stripes, _striped(grow(image, clearest)[1]))
    if stripes > 0.3:
        raise only_stripes()
    raise no_grid()


def ranked(grown: list[tuple[GridMap, MapSupport]]) -> list[tuple[GridMap, MapSupport]]:
    """Order maps: fundamental waves of the best, the best, then those that explain nearly as much.

    Parameters
    ----------
    grown : list of (GridMap, MapSupport)
        The best first.
    """
    best, support = grown[0]
    generators = [
        (one, seen)
        for one, seen in grown[1:]
        if seen.explained > MIN_FUNDAMENTAL_VARIANCE * support.explained
        and seen.area.mean() > 0.5 * support.area.mean()
        and _overtone(one, best) < _overtone(best, one)
    ]
    rivals = [
        one for one in grown[1:] if one[1].explained > MIN_CANDIDATE_VARIANCE * support.explained
    ]
    return [*generators, grown[0], *rivals]


def _overtone(one: GridMap, other: GridMap) -> float:
    """Lowest order at which the other map's waves are overtones of this one's, aliasing included.

    Whole cycles per px added to a wave do not change its samples, so lines that are too fine for
    the pixels appear as coarse ones. Infinite where there is none.
    """
    waves, overtones = one.jacobian(other.centre), other.jacobian(other.centre)

    def order(wave: FloatArray) -> float:
        if (
            min(np.abs(side * ground - wave).max() for ground in waves for side in (-1, 1))
            < MAX_WAVE_DIFFERENCE
        ):
            return 1.0
        for times in OVERTONE_ORDERS:
            for ground in waves:
                rests = (times * ground - wave, times * ground + wave)
                if min(np.abs(rest - np.round(rest)).max() for rest in rests) < MAX_WAVE_DIFFERENCE:
                    return float(times)
        return float("inf")

    highest = max(order(wave) for wave in overtones)
    return highest if highest > 1.0 else float("inf")


def _striped(support: MapSupport) -> float:
    """Fraction of the picture in which at least one family of lines is visible."""
    return float((support.coherence > MIN_COHERENCE).any(axis=0).mean())


def empty_picture() -> CalibrationError:
    """Error for a picture of one even area, as with tracks that come without their clip."""
    return CalibrationError(
        "there is no picture of the wall",
        hint="Pass the clip, too, so that its wall can be calibrated, or a scale.",
    )


def no_grid() -> CalibrationError:
    """Error for a picture without any grid."""
    return CalibrationError(
        "no grid in view: nothing repeats in two directions",
        hint="Light the wall evenly, focus on it, and make its squares at least 3 px wide.",
    )


def only_stripes() -> CalibrationError:
    """Error for lines in one direction only."""
    return CalibrationError(
        "the wall shows lines in one direction only: stripes are no grid",
        hint="The wall needs lines both along and across.",
    )


def _resolutions(gray: FloatArray) -> list[tuple[FloatArray, tuple[float, float]]]:
    """Pictures to search, each with the factors back to the full size."""
    height, width = gray.shape
    if width <= MAX_SEARCH_WIDTH_PX:
        return [(gray, (1.0, 1.0))]
    factor = int(np.ceil(width / MAX_SEARCH_WIDTH_PX))
    size = (width // factor, height // factor)
    small = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), dtype=np.float64)
    return [(small, (width / size[0], height / size[1])), (gray, (1.0, 1.0))]


def _distinct(seeds: list[Seed]) -> list[Seed]:
    """Drop seeds that repeat the waves of two earlier ones."""
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


MIN_NODES = 12
"""Minimum number of crossings (derived): ten camera and lens parameters against two coordinates
each, so that more than half are redundant."""

MAX_OFF_AXIS_POWER = 0.3
"""Maximum off-axis power (chosen): lines have nearly none, a chessboard has all of it there."""

MAX_SQUARE_SKEW = 0.08
"""Maximum |log aspect ratio| and |cosine| of the rectified squares (chosen): a printed grid is
within 1 %, most tiles and bricks deviate by more."""

NODE_OUTLIER_SIGMAS = 4.0
"""Outlier limit, standard deviations (derived: normal errors exceed it in one crossing of 8000)."""

MAX_NODE_ROUNDS, NODE_CONVERGENCE = 4, 0.1
"""Maximum number of rounds of measuring crossings and correcting the map; and convergence limit,
fraction of the crossings' uncertainty (chosen: they depend on the map to second order only)."""

MIN_REGION_PERIODS = 3.0
"""Minimum number of periods in the region (chosen): fewer give no spectrum."""

MIN_PERIOD_PX = 2.5
"""Minimum period, px (chosen): shorter ones may be aliases of finer lines."""

MAX_LINE_MISFIT = 1.0 / 6.0
"""Maximum misfit of single lines, periods (derived): three of these change a label by one line."""


@dataclass(frozen=True, eq=False)
class WallGrid:
    """The measured grid on the wall.

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
        Measured positions of these crossings, px.
    covariance_px2 : (N, 2, 2) array
        Covariance of each, px².
    map : GridMap
        Smooth map from pixels to grid coordinates; for drawing and for wall readings, not for the
        pose of the camera.
    area : (H, W) bool array
        Where the grid is visible.
    dark : bool
        Whether its lines are darker than the wall.
    fine_ratio : int or None
        Fine divisions in one coarse one, where fine lines are resolved.
    origin_m : (2,) array
        Wall coordinates of node (0, 0), m.
    warnings : tuple of str
        Warnings for the user.
    line_share : (2,) array
        Fraction of the variance across the lines of each family that is common to a whole line: a
        thin line, coarsely sampled, is displaced as a whole. Other errors are independent.
    """

    size: tuple[int, int]
    pitch_m: float
    nodes: NDArray[np.int64]
    points_px: FloatArray
    covariance_px2: FloatArray
    map: GridMap
    area: NDArray[np.bool_]
    dark: bool
    fine_ratio: int | None
    origin_m: FloatArray
    warnings: tuple[str, ...] = ()
    line_share: FloatArray = field(default_factory=lambda: np.zeros(2))

    @property
    def wall_m(self) -> FloatArray:
        """Wall coordinates of the nodes, (N, 2), m."""
        return np.asarray(self.origin_m + self.pitch_m * self.nodes)

    def to_wall(self, px: ArrayLike) -> FloatArray:
        """Reading on the wall of pixels (..., 2): wall coordinates (..., 2), m."""
        return np.asarray(self.origin_m + self.pitch_m * self.map(px))

    def with_origin(self, px: ArrayLike, *, snap: bool = False) -> Self:
        """The same grid with the origin of its wall coordinates at `px`.

        Parameters
        ----------
        px : (2,) array
            A position in the picture.
        snap : bool
            Whether to use the crossing nearest to `px`.
        """
        place = self.map(px)
        place = np.round(place) if snap else place
        return replace(self, origin_m=-self.pitch_m * place)


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

    Raises
    ------
    CalibrationError
        If the picture has no grid of squares; the message states what was found instead.
    """
    picture = np.ascontiguousarray(image)
    shown = (picture.tobytes(), picture.shape, picture.dtype.str)
    found = _grid_once(*shown, pitch_m, fine_pitch_m)
    if isinstance(found, CalibrationError):
        raise found.with_traceback(None)
    return found


@lru_cache(maxsize=2)
def _grid_once(
    content: bytes, shape: tuple[int, int], kind: str, pitch_m: float, fine_pitch_m: float | None
) -> WallGrid | CalibrationError:
    """Grid of a picture, or why there is none; a corrected clip is of the same wall as before."""
    try:
        return _grid(np.frombuffer(content, kind).reshape(shape), pitch_m, fine_pitch_m)
    except CalibrationError as problem:
        return problem


def _grid(image: NDArray[np.generic], pitch_m: float, fine_pitch_m: float | None) -> WallGrid:
    gray = np.asarray(image, dtype=np.float64)
    gray = np.asarray(gray - min(float(gray.min()), 0.0))
    grid_map, area, lattices, flat = _lattice(gray)
    pixels = pixel_grid(gray.shape)
    seen = pixels[area]
    sign = -1.0 if lattices[0].dark else 1.0
    templates = (sign * lattices[0].template, sign * lattices[1].template)
    frequency = np.linalg.norm(grid_map.jacobian(seen), axis=-1).max(axis=0)
    for _ in range(MAX_NODE_ROUNDS):
        nodes = measured_nodes(flat, grid_map(pixels), area, frequency, templates)
        nodes, px = _located(nodes, grid_map, seen)
        inlier, factor = _agreeing(nodes)
        variance = np.einsum("nff->nf", nodes.covariance) * factor
        before = grid_map(px)
        grid_map = refitted(grid_map, px, -nodes.shift, inlier[:, np.newaxis] / variance)
        moved = np.abs(grid_map(px) - before) / np.sqrt(variance)
        if np.max(moved[inlier], initial=0.0) < NODE_CONVERGENCE:
            break
    nodes, px = _kept(nodes, px, inlier)
    _require_even_grid(nodes, px)
    inverse = np.linalg.inv(grid_map.jacobian(px))
    covariance = factor * inverse @ nodes.covariance @ np.swapaxes(inverse, 1, 2)
    fine = lattices[0].fine if lattices[0].fine == lattices[1].fine else None
    return WallGrid(
        size=(gray.shape[1], gray.shape[0]),
        pitch_m=pitch_m,
        nodes=nodes.index,
        points_px=px + np.einsum("nij,nj->ni", inverse, nodes.shift),
        covariance_px2=covariance,
        map=grid_map,
        area=area,
        dark=lattices[0].dark,
        fine_ratio=fine,
        origin_m=np.zeros(2),
        warnings=_fine_warning(fine, pitch_m, fine_pitch_m),
        line_share=_line_correlation(nodes),
    )


def _require_even_grid(nodes: Nodes, px: FloatArray) -> None:
    """Reject too few crossings, and crossings that fit no even grid."""
    if len(px) < MIN_NODES:
        raise CalibrationError(
            f"only {len(px)} crossings of a grid are visible",
            hint="At least three by four squares of the wall's grid must be in view.",
        )
    astray = _line_misfit(nodes)
    if not astray < MAX_LINE_MISFIT:
        raise CalibrationError(
            f"lines are visible, but their crossings deviate by {astray:.2f} of a square from any "
            "even grid: the lines cannot be numbered",
            hint="Film with more pixels, from nearer, or with better light on the wall.",
        )


def _lattice(gray: FloatArray) -> tuple[GridMap, NDArray[np.bool_], list[Lattice], FloatArray]:
    """Map to grid coordinates, its region, its two families of lines, and the contrast.

    Aliased fine lines make waves, too: if the best waves make no squares, the next are tried.
    """
    if np.ptp(gray) == 0.0:
        raise empty_picture()
    refusal: CalibrationError | None = None
    for grid_map, support in growths(gray):
        try:
            return _squares(gray, grid_map, support)
        except CalibrationError as problem:
            refusal = refusal or problem
    raise refusal or no_grid()


def _squares(
    gray: FloatArray, grid_map: GridMap, support: MapSupport
) -> tuple[GridMap, NDArray[np.bool_], list[Lattice], FloatArray]:
    shape = gray.shape[::-1]
    area = cv2.resize(support.area.astype(np.uint8), shape, interpolation=cv2.INTER_NEAREST) > 0
    seen = pixel_grid(gray.shape)[area]
    periods = _periods(grid_map, seen)
    if not np.isfinite(periods).all():
        raise no_grid()
    flat = flattened(gray, 1.5 * float(periods.max()))
    first = grid_map(seen)
    if not np.ptp(first, axis=0).min() >= MIN_REGION_PERIODS:
        raise no_grid()
    lattices = [analysed(flat[area], first[:, f], periods[f]) for f in range(2)]
    alike = abs(np.log(periods[0] / periods[1])) < MAX_SQUARE_SKEW
    if alike and lattices[0].multiple != lattices[1].multiple:
        lattices = [
            analysed(flat[area], first[:, f], periods[f], False) if _is_beat(lattice) else lattice
            for f, lattice in enumerate(lattices)
        ]
    if not all(lattice.clear for lattice in lattices):
        raise only_stripes()
    grid_map, lattices = _oriented(grid_map, lattices)
    periods = _periods(grid_map, seen)
    if periods.min() < MIN_PERIOD_PX:
        raise CalibrationError(
            f"the pattern repeats every {periods.min():.1f} px: too fine to number its lines",
            hint="Film from nearer or with more pixels: squares must be at least 3 px wide.",
        )
    flat = flattened(gray, 1.5 * float(periods.max()))
    _require_squares(flat[area], grid_map(seen), grid_map)
    return grid_map, area, lattices, flat


def _is_beat(lattice: Lattice) -> bool:
    """Whether coarse lines of one family alone are so faint that they may be a beat.

    In a picture that was enlarged, lines beat with the pixels that it had before.
    """
    if not 1 < lattice.multiple <= MAX_HARMONIC:
        return False
    coarse, wave = np.abs(lattice.template[[0, lattice.multiple - 1]])
    return bool(coarse < MIN_ALIASED_AMPLITUDE * wave)


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
    off_axis = off_axis_power(values, grid)
    if off_axis > MAX_OFF_AXIS_POWER:
        raise CalibrationError(
            "the pattern has no continuous lines: a chessboard, tiles or bricks",
            hint="The wall needs a grid of lines. For a chessboard use `vision calibrate lens`.",
        )
    aspect, cosine = squareness(grid_map)
    if abs(np.log(aspect)) > MAX_SQUARE_SKEW or abs(cosine) > MAX_SQUARE_SKEW:
        angle = np.degrees(np.arccos(cosine))
        raise CalibrationError(
            f"the lines do not form squares: sides 1 : {aspect:.2f}, angle {angle:.0f} deg",
            hint="Only a grid of squares can be used, filmed with square pixels. If they are"
            " squares, the picture was changed after filming: pass the camera's own file.",
        )


def _located(nodes: Nodes, grid_map: GridMap, seen: FloatArray) -> tuple[Nodes, FloatArray]:
    """Pixel positions of the crossings; those without a solution are dropped."""
    coordinates = grid_map(seen[::5])
    cell = np.round(coordinates / nodes.block).astype(np.int64)
    first = cell.min(axis=0)
    some_pixel = np.zeros(cell.max(axis=0) - first + 1, dtype=np.int64)
    some_pixel[tuple((cell - first).T)] = np.arange(len(cell))
    wanted = np.clip(nodes.index // nodes.block - first, 0, np.array(some_pixel.shape) - 1)
    start = seen[::5][some_pixel[tuple(wanted.T)]]
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
    """Crossings that agree with the map, and the factor by which variances are too small."""
    std = np.sqrt(np.einsum("nff->nf", nodes.covariance))
    typical = np.median(nodes.strength, axis=0)
    visible = ((nodes.strength > 0.4 * typical) & (nodes.strength < 2.5 * typical)).all(axis=1)
    visible &= (std < 4.0 * np.median(std, axis=0)).all(axis=1)
    normalised = np.abs(nodes.shift) / std
    factor = max(1.0, float(1.4826 * np.median(normalised[visible])) ** 2) if visible.any() else 1.0
    inlier = visible & (normalised < NODE_OUTLIER_SIGMAS * np.sqrt(factor)).all(axis=1)
    return inlier, factor


def _line_misfit(nodes: Nodes) -> float:
    """Robust standard deviation of single lines about the map beyond their noise, periods.

    A line displaced as a whole by the pixel grid is off to either side at random and does not
    affect the numbering. Curvature along lines means a wrong map; a crossing that averages several
    lines shows that much less of it.
    """
    excess = []
    for family in range(2):
        shift = nodes.shift[:, family]
        _, line, count = np.unique(nodes.index[:, family], return_inverse=True, return_counts=True)
        middle = np.array([np.median(shift[line == one]) for one in range(len(count))])
        freedom = max(len(shift) - len(count), 1)
        within = np.median(np.abs(shift - middle[line])) ** 2 * len(shift) / freedom
        noise = np.median(nodes.covariance[:, family, family])
        excess.append(1.4826**2 * within - noise)
    return float(nodes.block * np.sqrt(max(0.0, *excess)))


def _line_correlation(nodes: Nodes) -> FloatArray:
    """Intraclass correlation of the shifts along lines, by analysis of variance, (2,)."""
    shares = np.zeros(2)
    for family in range(2):
        shift = nodes.shift[:, family] / np.sqrt(nodes.covariance[:, family, family])
        _, line, count = np.unique(nodes.index[:, family], return_inverse=True, return_counts=True)
        mean = np.bincount(line, shift) / count
        lines, each = len(count), len(shift) / len(count)
        if lines < 3 or each < 2.0:
            continue
        between = float(count @ (mean - shift.mean()) ** 2) / (lines - 1)
        within = float(((shift - mean[line]) ** 2).sum()) / (len(shift) - lines)
        if between > (1.0 + 2.0 * np.sqrt(2.0 / (lines - 1))) * within:
            common = (between - within) / each
            shares[family] = common / (common + within)
    return shares


def _fine_warning(fine: int | None, pitch_m: float, fine_pitch_m: float | None) -> tuple[str, ...]:
    if fine is None or fine_pitch_m is None or fine == round(pitch_m / fine_pitch_m):
        return ()
    return (
        f"the wall shows {fine} fine divisions per coarse one, but {1e3 * pitch_m:g} mm and "
        f"{1e3 * fine_pitch_m:g} mm lines would give {pitch_m / fine_pitch_m:g}. All lengths scale "
        "with the pitch: check [wall] grid and fine_grid",
    )
