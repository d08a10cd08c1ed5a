"""The wall grid: found by itself, at sub-pixel precision, with the experiment in front of it.

Candidates for the wall grid: every seed grown, the likeliest first.

Which of the repeating lines are the coarse ones, where they lie, and whether they are a grid.

Measured positions of the grid's nodes, block by block, each with its own noise.

Where in a picture something repeats in two directions, and how: seeds for the wall grid.

The wall grid as two phase fields over the picture, grown from a seed.

Both families of lines are level sets of a smooth map from pixels to the wall: a homography behind a
radial distortion. The picture, multiplied by the wave the map predicts and averaged locally, tells
by its phase how far off the map is, everywhere at once; the map is then fitted to that.
"""

from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import product
from math import gcd
from typing import Self, TypeVar

import cv2
import numpy as np
import scipy
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

WINDOWS = (32, 64, 128, 256)
"""px: windows in which waves are looked for, each twice as large, from eight lines of 4 px to ten
of 25 px."""

PERIODS_ACROSS = 4.0

"""A window holds at least this many periods of what is looked for in it."""

HIGHEST_FREQUENCY = 0.46
"""Per px, as in `calib.grid`: below half a period per pixel, less what blur takes."""

FOLDED_FREQUENCY = 1.0 / 3.0

"""Cycles per px; waves above may be fine lines folded over, so longer ones are looked for, too."""

SMALLEST_ANGLE = np.radians(30.0)
"""rad between both families of lines: a wall seen at 60° along its diagonal shows them 53° apart, 2
atan(cos 60°); half of that is beyond any view."""

CLIP_AT = 4.0
"""Robust standard deviations: lines are within, a bright ball or a dark mass is cut to that."""

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


def smoothed(image: NDArray[Real], sigma: float) -> NDArray[Real]:
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
        flat = flattened(image, window / 6.0).astype(np.float32)
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


def _window_seeds(flat: FloatImage, window: int) -> list[list[Seed]]:
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
    """Wave vectors of a window's spectrum (2 W, W + 1): lengths, twice their angles, their side.

    Attributes
    ----------
    window : int
        Side of the window, px.
    radius : (2 W, W + 1) array
        Cycles per px.
    cosine, sine : (2 W, W + 1) arrays
        Of twice the angle.
    order, lengths : (M,) arrays
        Flat places by increasing radius, and those radii.
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
        """Flat places of all waves about as long as one."""
        ratio, length = np.exp(ALIKE), self.radius[place]
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
    """The two waves with the most power in each window, of those up to a frequency."""
    ring = (waves.radius > PERIODS_ACROSS / waves.window) & (waves.radius < highest)
    kept = power[:, ring]
    if len(kept) == 0:
        return []
    # a picture that is even has no power in half of its waves or more
    shown = 2 * np.count_nonzero(kept, axis=1) >= kept.shape[1]
    rows = np.argwhere(ring)
    cosine, sine = (turn[ring].astype(np.float32) for turn in (waves.cosine, waves.sine))
    first = kept.argmax(axis=1)
    alike = cosine * cosine[first, np.newaxis] + sine * sine[first, np.newaxis]
    apart = alike < np.cos(2.0 * SMALLEST_ANGLE)
    second = np.where(apart, kept, 0.0).argmax(axis=1)
    places = rows[np.stack([first, second], axis=1)]
    vectors = _refined(power, places, 2 * waves.window)
    centres = corners + (waves.window - 1) / 2.0
    seeds: list[Seed | None] = []
    for index, here in enumerate(power):
        if not shown[index]:
            seeds.append(None)
            continue
        strengths = [_above_its_kind(here, waves, (int(y), int(x))) for y, x in places[index]]
        seeds.append(
            Seed(centres[index], vectors[index], waves.window, min(strengths), strengths[0])
        )
    return seeds


def _above_its_kind(power: FloatImage, waves: _Waves, place: tuple[int, int]) -> float:
    """Power of a wave over the median of all waves about as long.

    Most textures are the stronger the longer the wave: what stands out of all waves need not stand
    out of its own kind.
    """
    alike = power.ravel()[waves.alike(place)]
    half = len(alike) // 2
    # np.median takes as long again for what it checks
    ordered = np.partition(alike, [half - 1, half])
    middle = 0.5 * float(ordered[half - 1 + len(alike) % 2] + ordered[half])
    return float(power[place] / max(middle, 1e-300))


def _refined(power: FloatImage, places: NDArray[np.int64], size: int) -> FloatArray:
    """Wave vectors (N, 2, 2) of peaks, by parabolas through the logarithm of their neighbours."""
    each = np.arange(len(power))[:, np.newaxis]
    row, column = places[..., 0], places[..., 1]
    least = np.finfo(power.dtype).tiny

    def log(row: NDArray[np.int64], column: NDArray[np.int64]) -> FloatArray:
        # The spectrum of a real picture is even: the column left of 0 is the one right of it
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


WINDOW_PERIODS = 1.3
"""Periods, standard deviation of the window: narrow enough to follow the view, wide enough (three
periods in effect) to know a wave from an edge."""

COHERENT = 8.0

"""|mean|² over its expectation in noise: exceeded by chance once in e^8 = 3000 windows."""

_AVERAGED = 4.5
"""Standard deviations on either side that a Gaussian average is taken over, and what a smaller
picture adds to it."""

GROWTH = 1.3
"""Factor by which the region grows in a step, supposed: the map is extrapolated by less than a
third of its size."""

PERIOD_WANTED = 6.0

"""Larger periods are grown on a smaller picture, px."""

# Widths within which a map may stray from an affine one: perspective, then distortion, in units of
# the half width of the picture. A view 45° oblique through a 90° lens reaches 1; a fish-eye 0.3.
PRIOR_STD = np.array([0.5, 0.5, 0.2, 0.1])

_LEAST_DEPTH = 0.05
"""Of that in the picture's middle, supposed: what is nearer is behind the camera, or beside it."""

PHASE_STD = 0.03
"""Periods, supposed: how far local phases may be from a smooth map of few parameters."""


_COUNTS = tuple(product((0, 1, -1, 2, -2), repeat=2))
"""Lines by which a part of the grid may be miscounted along both families, supposed: maps that fit
one part well foretell the next to less than that."""

_BEHIND = 1e300
"""Misfit of a map that puts some of the wall behind the camera."""

_COUNT_ROUNDS = 4
"""Steps of a fit: the second is exact but for what bends."""

_SURELY_COUNTED, _SHARED = 5.0, 1.0 / (4.0 * np.pi)
"""Nats by which a count is likelier than the next, odds of 150; and how far windows whose middles
lie a standard deviation apart count each for itself: by the area that such a window averages over.
"""


@compiled
def _placed(
    x: float, y: float, centre: FloatArray, scale: FloatArray, p: FloatArray
) -> tuple[float, float]:
    """Grid coordinates of a pixel: see `GridMap`; NaN behind the camera."""
    x, y = (x - centre[0]) / scale[0], (y - centre[1]) / scale[1]
    r2 = x * x + y * y
    bent = 1.0 + r2 * (p[8] + r2 * p[9])
    x, y = x * bent, y * bent
    depth = 1.0 + p[6] * x + p[7] * y
    if not depth > _LEAST_DEPTH:
        return np.nan, np.nan
    return (p[0] * x + p[1] * y + p[2]) / depth, (p[3] * x + p[4] * y + p[5]) / depth


@compiled
def _mapped(
    px: FloatArray, centre: FloatArray, scale: FloatArray, p: FloatArray, grid: FloatArray
) -> None:
    """Write the grid coordinates of pixels (N, 2)."""
    for k in range(len(px)):
        grid[k, 0], grid[k, 1] = _placed(px[k, 0], px[k, 1], centre, scale, p)


@compiled
def _turned(
    left: int, top: int, centre: FloatArray, scale: FloatArray, p: FloatArray, turns: FloatImage
) -> None:
    """Write the phases (2, h, w) of both waves, -π to π; 0 where there is none."""
    for row in range(turns.shape[1]):
        for column in range(turns.shape[2]):
            u, v = _placed(float(left + column), float(top + row), centre, scale, p)
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
        _turned(columns.start, rows.start, self.centre, self.scale, self.parameters, found)
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
    """How well a map fits, over the picture.

    Attributes
    ----------
    phase : (2, H, W) array
        What the picture says beyond the map, in periods, for both families.
    coherence : (2, H, W) array
        |mean|² over its expectation in noise.
    share : (2, H, W) array
        Share of the local variance that the wave carries.
    counted : (H, W) array
        Where the lines seen are surely numbered, if they are not everywhere.
    """

    phase: FloatArray
    coherence: FloatArray
    share: FloatArray
    counted: BoolArray | None = None

    @cached_property
    def area(self) -> NDArray[np.bool_]:
        """Pixels at which both families are seen where the map has them, (H, W)."""
        seen = (self.coherence > COHERENT) & (np.abs(self.phase) < 0.25)
        both = np.asarray(seen.all(axis=0))
        return both if self.counted is None else both & self.counted

    @cached_property
    def explained(self) -> float:
        """Share of the whole picture's variance that both waves explain together."""
        return float(np.where(self.area, self.share.sum(axis=0), 0.0).mean())


def pixel_grid(shape: tuple[int, ...]) -> FloatArray:
    """Coordinates of all pixels, (H, W, 2)."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return np.stack([columns, rows], axis=-1).astype(np.float64)


@dataclass(frozen=True)
class _Contrast:
    """What is compared with waves: a picture's relative contrast, and its average square.

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
        """Of relative contrast (H, W)."""
        single = flat.astype(np.float32)
        return cls(single, np.maximum(smoothed(single * single, sigma), np.float32(1e-12)), sigma)

    def around(self, points: BoolArray) -> tuple[slice, slice]:
        """Rows and columns that the averages at some points (H, W) are taken over."""
        reach = int(np.ceil(_AVERAGED * self.sigma))
        return _between(np.any(points, axis=1), reach), _between(np.any(points, axis=0), reach)

    def cut(self, part: tuple[slice, slice]) -> "_Contrast":
        """A part of the picture."""
        return replace(self, flat=self.flat[part], energy=self.energy[part])

    def demodulated(self, turns: FloatImage, at: BoolArray | None = None) -> MapSupport:
        """Compare with a map's waves, whose phases are (2, H, W); `at` some pixels (H, W) only."""
        independent = np.float32(4.0 * np.pi * self.sigma**2)
        energy = self.energy if at is None else self.energy[at]
        angles, coherences, shares = [], [], []
        for turn in turns:
            real = smoothed(self.flat * np.cos(turn), self.sigma)
            imaginary = smoothed(self.flat * np.sin(turn), self.sigma)
            if at is not None:
                real, imaginary = real[at], imaginary[at]
            share = (real**2 + imaginary**2) / energy
            angles.append(np.arctan2(-imaginary, real) / np.float32(2.0 * np.pi))
            coherences.append(share * independent)
            shares.append(np.float32(2.0) * share)
        phase, coherence, share = (
            np.array(one, dtype=np.float64) for one in (angles, coherences, shares)
        )
        return MapSupport(phase, coherence, share)


def _between(there: BoolArray, reach: int) -> slice:
    """From the first to the last, and so many beyond."""
    places = np.flatnonzero(there)
    if len(places) == 0:
        return slice(None)
    return slice(max(int(places[0]) - reach, 0), int(places[-1]) + reach + 1)


def grow(image: FloatArray, seed: Seed) -> tuple[GridMap, MapSupport]:
    """Extend a seed over the picture as far as it holds.

    Parameters
    ----------
    image : (H, W) array
        Gray levels.
    seed : Seed
        Two waves in a window.

    Returns
    -------
    GridMap, Support
        The fitted map, and how well it fits; the support may be at a lower resolution than the
        picture. A phase of 0 is that of the brightest places.
    """
    period = float(1.0 / np.linalg.norm(seed.waves, axis=1).max())
    factor = max(1, int(period / PERIOD_WANTED))
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
    sigma = WINDOW_PERIODS * longest
    flat = flattened(image, 1.5 * longest)
    pixels = pixel_grid(image.shape)
    current = _affine(seed, (image.shape[1], image.shape[0]))
    place = np.zeros(image.shape, dtype=bool)
    stride = max(1, int(sigma))
    place[stride // 2 :: stride, stride // 2 :: stride] = True
    distance = np.linalg.norm(pixels - seed.centre, axis=-1)
    reach = max(0.5 * seed.window, 3.0 * longest)
    contrast = _Contrast.of(flat, sigma)
    while True:
        near = place & (distance < reach)
        part = contrast.around(near)
        there, here = contrast.cut(part), near[part]
        for _ in range(2):
            seen = there.demodulated(current.turns(image.shape, part), here)
            current = _fitted(current, pixels[near], seen.phase, seen.coherence)
        if reach > distance.max():
            break
        reach *= GROWTH
    support = contrast.demodulated(current.turns(image.shape))
    label = _parts(support.area)
    if label.max() < 2:
        return current, support
    current, surely = _recounted(current, _Samples.of(support, pixels, place), label[place])
    support = contrast.demodulated(current.turns(image.shape))
    return current, replace(support, counted=np.isin(label, [0, *surely]))


def _parts(area: BoolArray) -> NDArray[np.int32]:
    """Which separate part of an area each pixel lies in, the largest 1; 0 for none, or a small one.

    Small ones hold too few lines to be counted, and change no map.
    """
    _, label = cv2.connectedComponents(area.astype(np.uint8))
    size = np.bincount(label.ravel())
    size[0] = 0
    large = [int(part) for part in np.argsort(-size) if size[part] > LEAST_AREA * label.size]
    rank = np.zeros(len(size), dtype=np.int32)
    rank[large] = np.arange(1, len(large) + 1)
    return np.asarray(rank[label])


@dataclass(frozen=True)
class _Samples:
    """What the picture says of a map at some pixels.

    Attributes
    ----------
    px : (N, 2) array
    shift : (N, 2) array
        What is missing from the mapped grid coordinates there, periods.
    weight : (N, 2) array
        Inverse variances, periods^-2.
    """

    px: FloatArray
    shift: FloatArray
    weight: FloatArray

    @classmethod
    def of(cls, support: MapSupport, pixels: FloatArray, place: BoolArray) -> Self:
        """Of a map's support at some pixels (H, W)."""
        phase, coherence = support.phase[:, place], support.coherence[:, place]
        return cls(pixels[place], phase.T, _trusted(phase, coherence).T)

    def at(self, rows: BoolArray) -> Self:
        """Some of the pixels (N,)."""
        return replace(self, px=self.px[rows], shift=self.shift[rows], weight=self.weight[rows])


def _recounted(
    current: GridMap, samples: _Samples, label: NDArray[np.int32]
) -> tuple[GridMap, list[int]]:
    """Number the lines of each separate part of a grid anew; the map, and the parts that stand.

    Where something hides the lines from top to bottom, waves of one part that are led across it
    may meet those of the other a whole line off, and a bent map fits both. Each part is counted as
    many lines on or back as its map is the likeliest for, the largest part first; one of which the
    count is not sure is left out.

    Parameters
    ----------
    current : GridMap
    samples : _Samples
        At N pixels.
    label : (N,) int array
        Which part each pixel lies in, the largest 1; 0 for none.
    """
    surely, aims = [1], current(samples.px) + samples.shift
    for part in range(2, int(label.max()) + 1):
        inside = np.isin(label, [*surely, part])
        chosen, own = samples.at(inside), (label[inside] == part)[:, np.newaxis]
        maps = [_aimed(current, chosen, aims[inside] + own * np.array(lines)) for lines in _COUNTS]
        costs = np.nan_to_num([cost for _, cost in maps], nan=_BEHIND, posinf=_BEHIND)
        best, second = np.argsort(costs)[:2]
        spare = max(2 * len(chosen.px) - len(current.parameters), 1)
        # errors are as large as the best map has them, where that is more than was supposed
        usual = max(1.0, costs[best] / spare)
        if not _SHARED * 0.5 * (costs[second] - costs[best]) > _SURELY_COUNTED * usual:
            continue
        surely.append(part)
        aims[label == part] += _COUNTS[best]
        if any(_COUNTS[best]):
            current = maps[best][0]
    return current, surely


def _aimed(current: GridMap, samples: _Samples, aims: FloatArray) -> tuple[GridMap, float]:
    """Map that takes pixels to given grid coordinates (N, 2), and its misfit as a chi-square."""
    for _ in range(_COUNT_ROUNDS):
        current = refitted(current, samples.px, aims - current(samples.px), samples.weight)
    left = aims - current(samples.px)
    strayed = current.parameters[-len(PRIOR_STD) :] / PRIOR_STD
    return current, float((samples.weight * left**2).sum() + strayed @ strayed)


def _affine(seed: Seed, size: tuple[int, int]) -> GridMap:
    centre = (np.array(size) - 1.0) / 2.0
    scale = np.full(2, size[0] / 2.0)
    rows = seed.waves * scale
    shift = -seed.waves @ (seed.centre - centre)
    parameters = np.concatenate([rows[0], shift[:1], rows[1], shift[1:], np.zeros(4)])
    return GridMap(centre, scale, parameters)


def _fitted(current: GridMap, px: FloatArray, phase: FloatArray, coherence: FloatArray) -> GridMap:
    """Map moved to meet the phases found at `px`: one robust Gauss–Newton step with priors."""
    return refitted(current, px, phase.T, _trusted(phase, coherence).T)


def _trusted(phase: FloatArray, coherence: FloatArray) -> FloatArray:
    """Inverse variances of phases, periods^-2."""
    weight = np.where(coherence > COHERENT, np.minimum(coherence, 50.0) / 50.0, 0.0)
    # Cauchy weights: a window on a shadow's edge has a phase of its own
    return weight / (1.0 + (phase / 0.1) ** 2) / PHASE_STD**2


@compiled
def _pulled(
    px: FloatArray,
    shift: FloatArray,
    weight: FloatArray,
    centre: FloatArray,
    scale: FloatArray,
    p: FloatArray,
    normal: FloatArray,
    right: FloatArray,
) -> None:
    """Add what shifts (N, 2) of pixels (N, 2) ask of a map's parameters: normal equations."""
    row = np.zeros(10)
    for k in range(len(px)):
        u, v = (px[k, 0] - centre[0]) / scale[0], (px[k, 1] - centre[1]) / scale[1]
        r2 = u * u + v * v
        bent = 1.0 + r2 * (p[8] + r2 * p[9])
        x, y = u * bent, v * bent
        depth = 1.0 + p[6] * x + p[7] * y
        if not depth > _LEAST_DEPTH:
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
                right[i] += part * shift[k, family]
                for j in range(10):
                    normal[i, j] += part * row[j]


def refitted(current: GridMap, px: FloatArray, shift: FloatArray, weight: FloatArray) -> GridMap:
    """Map moved to meet measured shifts.

    Parameters
    ----------
    current : GridMap
    px : (N, 2) array
        Places.
    shift : (N, 2) array
        What is missing from the mapped grid coordinates there, periods.
    weight : (N, 2) array
        Inverse variances, periods^-2.
    """
    normal, right = np.zeros((10, 10)), np.zeros(10)
    # one layout, for which alone the loop is compiled
    px, shift, weight = (np.ascontiguousarray(one) for one in (px, shift, weight))
    _pulled(px, shift, weight, current.centre, current.scale, current.parameters, normal, right)
    normal[np.arange(6, 10), np.arange(6, 10)] += PRIOR_STD**-2
    right[6:] -= current.parameters[6:] * PRIOR_STD**-2
    normal[np.arange(6), np.arange(6)] += 1e-6
    return current.moved(np.asarray(np.linalg.solve(normal, right), dtype=np.float64))


BINS = 32

"""Bins of a period of the profile across a line: a line is a tenth of a period wide, three bins."""

COARSER = (2, 3, 4, 5, 6, 8, 10)

"""Fine lines per coarse one, as rulers and millimetre paper have them: factors of ten, and those
between."""

SIGNIFICANT = 5.0

"""A line of the spectrum must stand this far above the median of its surroundings."""

CLEAR = 3.0

"""Standard deviations for the wave itself, since local coherence has vouched for it already."""

FAINTEST = 0.03

"""Share of the profile, supposed: a harmonic fainter than this may be shading or compression."""

FAINTEST_ALIASED = 0.15

"""Share of the profile where harmonics fold over, supposed: five times as much, since what folds
over adds to them."""

ALIAS_FREE = 6.0

"""Below this period (px) the harmonics of sharp lines alias to where coarser lines would be."""

HIGHEST_HARMONIC = 12

"""Order: the harmonics of a line a tenth of a period wide fade out at ten."""


@dataclass(frozen=True)
class Lattice:
    """The coarse lines of one family within the waves first found.

    Attributes
    ----------
    multiple : int
        How many periods of the wave first found make one coarse period.
    clear : bool
        Whether the wave stands out of the spectrum of what else varies in its direction.
    offset : float
        Where a coarse line lies, in coarse periods.
    dark : bool
        Whether lines are darker than the wall.
    template : (12,) array
        Amplitudes of the harmonics 1 to 12 of the profile across a line, positive for a peak.
    fine : int or None
        How many fine periods there are in a coarse one, where fine lines are seen.
    """

    multiple: int
    clear: bool
    offset: float
    dark: bool
    template: FloatArray
    fine: int | None


def analysed(values: FloatArray, coordinate: FloatArray, period_px: float) -> Lattice:
    """Find the coarse lines in one family.

    Parameters
    ----------
    values : (N,) array
        Relative contrast of the pixels on the wall.
    coordinate : (N,) array
        Their grid coordinate across the family's lines, in periods of the wave first found.
    period_px : float
        That period, px.
    """
    multiple, clear = _coarsest(
        values, coordinate, FAINTEST if period_px > ALIAS_FREE else FAINTEST_ALIASED
    )
    coordinate = coordinate / multiple
    turn = np.exp(-2j * np.pi * coordinate)
    wave = values * turn
    means = [2.0 * np.mean(wave)]
    for _ in range(1, HIGHEST_HARMONIC):
        wave = wave * turn
        means.append(2.0 * np.mean(wave))
    harmonics = np.array(means)
    index = (np.floor((coordinate % 1.0) * BINS)).astype(np.int64) % BINS
    counts = np.maximum(np.bincount(index, minlength=BINS), 1)
    profile = np.bincount(index, weights=values, minlength=BINS) / counts
    profile = profile - profile.mean()
    # Lines are thinner than the gaps between them, so the profile is skewed towards them
    dark = bool(np.sum(profile**3) <= 0.0)
    sign = -1.0 if dark else 1.0
    offset = -float(np.angle(sign * harmonics[0])) / (2.0 * np.pi)
    order = np.arange(1, HIGHEST_HARMONIC + 1)
    template = (sign * harmonics * np.exp(2j * np.pi * order * offset)).real
    # Fine lines put all their strength into the multiples of one harmonic
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
    index = ((coordinate - start) * BINS).astype(np.int64)
    sums = np.bincount(index, weights=values - values.mean())
    periods = len(sums) / BINS
    oversampled = 4 * len(sums)
    spectrum = np.abs(np.fft.rfft(sums * np.hanning(len(sums)), oversampled))
    unit = oversampled / BINS  # bins of the spectrum per cycle of the wave

    def height(frequency: float, tolerance: float) -> tuple[float, float]:
        middle, near, far = frequency * unit, 1.0 * unit / periods, 8.0 * unit / periods
        around = np.arange(max(0, int(middle - far)), int(middle + far) + 1)
        distance = np.abs(around - middle)
        # A true peak is highest at its own place; a stronger neighbour's flank is not
        close = around[distance <= 2.0 * near]
        highest = int(close[np.argmax(spectrum[close])])
        peak = float(spectrum[highest]) if abs(highest - middle) <= tolerance * near else 0.0
        return peak, float(np.median(spectrum[around[distance > 3.0 * near]]))

    reference = height(1.0, 2.0)[0]

    def seen(frequency: float, tolerance: float = 0.8, clear: float = SIGNIFICANT) -> bool:
        peak, floor = height(frequency, tolerance)
        return peak > clear * floor and peak > faintest * reference

    best = 1
    for multiple in COARSER:
        if periods / multiple < 4.0:
            break
        parts = [j for j in range(1, multiple) if gcd(j, multiple) == 1]
        share = np.mean([seen(j / multiple) for j in parts])
        if seen(1 / multiple) and share >= 0.75:
            best = multiple
    return best, seen(1.0, 2.0, CLEAR)


def folded(values: FloatArray, grid: FloatArray, bins: int = 20) -> tuple[FloatArray, FloatArray]:
    """Average two by two cells of the grid into one picture.

    Parameters
    ----------
    values : (N,) array
    grid : (N, 2) array
        Grid coordinates, periods.
    bins : int
        Bins per period.

    Returns
    -------
    mean, count : (2 bins, 2 bins) array
    """
    index = np.floor((grid % 2.0) * bins).astype(np.int64) % (2 * bins)
    flat_index = index[:, 0] * 2 * bins + index[:, 1]
    count = np.bincount(flat_index, minlength=4 * bins * bins).astype(np.float64)
    total = np.bincount(flat_index, weights=values, minlength=4 * bins * bins)
    mean = total / np.maximum(count, 1.0)
    shape = (2 * bins, 2 * bins)
    return mean.reshape(shape), count.reshape(shape)


def off_axis_share(values: FloatArray, grid: FloatArray) -> float:
    """How much of the pattern is not lines that run through.

    Lines put their strength on the two axes of the cell's spectrum. A chessboard has much between
    the axes; a brick wall, whose joints are broken, between and at half orders.

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
    """Aspect ratio and cosine of the angle of the cells, at the focal length that suits best.

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


LARGEST_BLOCK = 6

"""Crossings on a side that are measured together at most: 36 of them take the noise of one down to
a sixth."""

CLEAR_BLOCK = 6.0

"""Standard deviations that the amplitude of a block must reach in the median: phase noise is its
inverse, a sixth of a radian."""

EVEN = 1.0 / 12.0

"""Robust scatter of the shifts, periods: six of these make a label wrong by one line.

What is finer than the lines, or folded over by the pixels, shifts small blocks, more than noise.
"""

BELOW_NYQUIST = 0.46

"""Per px: half a period per pixel is the limit of sampling, less what blur and the window take."""

PIXELS_AT_ONCE = 8192

"""Pixels worked on at once, so that their harmonics stay within the cache of a core (a
megabyte)."""


@dataclass(frozen=True)
class Nodes:
    """Nodes of the grid and how far each lies from where the map has it.

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
    """Measure every block of the grid that is in view.

    Parameters
    ----------
    flat : (H, W) array
        Relative contrast.
    grid : (H, W, 2) array
        Grid coordinates of the pixels by the present map.
    usable : (H, W) bool array
        Where the grid is seen.
    frequency : (2,) array
        Highest local frequency of both families, cycles per px.
    templates : tuple of (12,) arrays
        Harmonics of both profiles, signed as they appear in `flat`.

    Returns
    -------
    Nodes
        From the smallest blocks in which the lines stand clear of the noise and agree with the map.
    """
    orders = tuple(
        _harmonics(template, float(f)) for template, f in zip(templates, frequency, strict=True)
    )
    values, coordinates = flat[usable], grid[usable]
    nodes = None
    for block in range(1, LARGEST_BLOCK + 1):
        nodes, clarity = _blocks(values, coordinates, block, orders, templates)
        scatter = 1.4826 * np.median(np.abs(nodes.shift)) if len(nodes.shift) else np.inf
        if clarity > CLEAR_BLOCK and scatter < EVEN:
            break
    assert nodes is not None
    return nodes


def _harmonics(template: FloatArray, frequency: float) -> tuple[int, ...]:
    orders = np.arange(1, len(template) + 1)
    strong = np.abs(template) > 0.15 * np.abs(template[0])
    below = orders * frequency < BELOW_NYQUIST
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
    """Per block: how many pixels, and the normal equations of its light and waves.

    Block after block, some thousand pixels at a time: what is worked on stays in the caches.
    """
    count = np.bincount(label, minlength=size)
    # short numbers are sorted by their digits, not by comparing them
    order = np.argsort(label.astype(np.min_scalar_type(size)), kind="stable")
    ends = np.cumsum(count)
    unknowns = 3 + 2 * sum(len(some) for some in orders)
    products = np.zeros((size, unknowns + 1, unknowns + 1))
    begin = 0
    while begin < size:
        at = int(ends[begin] - count[begin])
        end = max(begin + 1, int(np.searchsorted(ends, at + PIXELS_AT_ONCE)))
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
    """Shift of both families from the sine terms their known profile should not have."""
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


SEEDS_TRIED = 12

"""Seeds of a lattice that are tried at most, supposed: what is not among the best dozen is no
wall."""

SEARCH_WIDTH = 960

"""px, supposed: wider pictures are reduced for the search, whose time goes with their area."""

ENOUGH_AREA = 0.7

"""Share of the picture in which a lattice that is found leaves no room for a better one."""

MOST_UNEVEN = 1.6

"""Ratio of both spacings: squares seen at 50° are 1.6 times as high as wide, and a wall is filmed
within that."""

LEAST_AREA = 0.03

"""Share of the picture: what is smaller has too few lines on each side to count them by."""

RIVAL = 0.9

"""Waves that explain this much of what the best explain may be the grid's as well."""

GENERATOR = 0.3

"""Share of the best evidence that the waves which generate a lattice have; the others are their
overtones."""

OVERTONES = range(2, 13)

SAME = 0.003

"""Cycles per px by which waves known over many periods differ at most where they are one."""


def growths(gray: FloatArray) -> list[tuple[GridMap, MapSupport]]:
    """Grow maps from the seeds in a picture.

    Parameters
    ----------
    gray : (H, W) array
        Gray levels, none negative.

    Returns
    -------
    list of (GridMap, Support)
        Best first; others only if they explain nearly as much of the picture, or explain the best.

    Raises
    ------
    CalibrationError
        If nothing repeats in two directions.
    """
    stripes = 0.0
    for image, ratio in _resolutions(gray):
        grown: list[tuple[GridMap, MapSupport]] = []
        seeds = find_seeds(image)
        tried = _distinct(seeds)[:SEEDS_TRIED]
        for seed in tried:
            grid_map, support = grow(image, seed)
            stripes = max(stripes, _striped(support))
            grown.append((grid_map.resized(ratio[0], ratio[1]), support))
            best = max(grown, key=lambda one: one[1].explained)
            lengths = np.linalg.norm(best[0].jacobian(best[0].centre), axis=1)
            if best[1].area.mean() > ENOUGH_AREA and lengths.max() < MOST_UNEVEN * lengths.min():
                break
        grown.sort(key=lambda one: one[1].explained, reverse=True)
        if grown and grown[0][1].area.mean() > LEAST_AREA:
            return ranked(grown)
        if seeds:
            clearest = max(seeds, key=lambda seed: seed.leading)
            if not any(seed is clearest for seed in tried):
                stripes = max(stripes, _striped(grow(image, clearest)[1]))
    if stripes > 0.3:
        raise only_stripes()
    raise no_grid()


def ranked(grown: list[tuple[GridMap, MapSupport]]) -> list[tuple[GridMap, MapSupport]]:
    """Order maps: generators of the best, then the best, then what explains nearly as much.

    Parameters
    ----------
    grown : list of (GridMap, Support)
        The best first.
    """
    best, support = grown[0]
    generators = [
        (one, seen)
        for one, seen in grown[1:]
        if seen.explained > GENERATOR * support.explained
        and seen.area.mean() > 0.5 * support.area.mean()
        and _overtone(one, best) < _overtone(best, one)
    ]
    rivals = [one for one in grown[1:] if one[1].explained > RIVAL * support.explained]
    return [*generators, grown[0], *rivals]


def _overtone(one: GridMap, other: GridMap) -> float:
    """Lowest order at which the other map's waves are overtones of this one's, as pixels see them.

    To the pixels a wave is the same whatever whole number of cycles per px is added to it: fine
    lines that are too fine for them come back as coarse ones. Infinite where there is none.
    """
    waves, overtones = one.jacobian(other.centre), other.jacobian(other.centre)

    def order(wave: FloatArray) -> float:
        if min(np.abs(side * ground - wave).max() for ground in waves for side in (-1, 1)) < SAME:
            return 1.0
        for times in OVERTONES:
            for ground in waves:
                rests = (times * ground - wave, times * ground + wave)
                if min(np.abs(rest - np.round(rest)).max() for rest in rests) < SAME:
                    return float(times)
        return float("inf")

    highest = max(order(wave) for wave in overtones)
    return highest if highest > 1.0 else float("inf")


def _striped(support: MapSupport) -> float:
    """Share of the picture in which at least one family of lines is seen."""
    return float((support.coherence > COHERENT).any(axis=0).mean())


def nothing_shown() -> CalibrationError:
    """Refusal of a picture that is one even area, as of tracks that come without their clip."""
    return CalibrationError(
        "there is no picture of the wall",
        hint="Give the clip, too, so that its wall can be calibrated, or a scale.",
    )


def no_grid() -> CalibrationError:
    """Refusal of a picture without any grid."""
    return CalibrationError(
        "no grid is in view: nothing repeats in two directions",
        hint="Light the wall evenly, focus on it, and let its squares be 3 px wide or more.",
    )


def only_stripes() -> CalibrationError:
    """Refusal of lines in one direction only."""
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


LEAST_NODES = 12

"""Crossings: a camera has ten unknowns with its lens and each crossing two numbers, so that more
than half are to spare."""

MOST_OFF_AXIS = 0.3

"""Share of the pattern between the axes of the grid: lines have nearly none, and a chessboard has
all of it."""

MOST_SKEW = 0.08

"""Ratio less one, and cosine, of the sides of a square once the view is undone, supposed: a printed
grid is within 1 %, most tiles and bricks are oblong by more."""

REJECT_AT = 4.0

"""Standard deviations: of normal errors one crossing in eight thousand is farther from the map in
one of its two directions."""

MOST_ROUNDS, SETTLED = 4, 0.1

"""Rounds of measuring the nodes and moving the map; it has settled where it moves by less than this
share of their standard uncertainty, for the nodes hang on it to second order only."""

FEWEST_PERIODS = 3.0
"""Periods of a wave that a part of the picture must hold: less shows no grid, and no spectrum."""

LEAST_PERIOD = 2.5

"""Px; what repeats faster may as well be something finer that the pixels have folded over."""

MOST_ASTRAY = 1.0 / 6.0

"""Misfit of single lines, periods: three of these make a label wrong by one line."""


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
        Covariance of each, px².
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
    line_share : (2,) array
        Share of the variance across the lines of each family that is one for all of a line: pixels
        that sample a thin line coarsely put it aside as a whole. Else errors are independent.
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
    line_share: FloatArray = field(default_factory=lambda: np.zeros(2))

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
    grid_map, area, lattices, flat = _lattice(gray)
    pixels = pixel_grid(gray.shape)
    seen = pixels[area]
    sign = -1.0 if lattices[0].dark else 1.0
    templates = (sign * lattices[0].template, sign * lattices[1].template)
    frequency = np.linalg.norm(grid_map.jacobian(seen), axis=-1).max(axis=0)
    for _ in range(MOST_ROUNDS):
        nodes = measured_nodes(flat, grid_map(pixels), area, frequency, templates)
        nodes, px = _located(nodes, grid_map, seen)
        inlier, factor = _agreeing(nodes)
        variance = np.einsum("nff->nf", nodes.covariance) * factor
        before = grid_map(px)
        grid_map = refitted(grid_map, px, -nodes.shift, inlier[:, np.newaxis] / variance)
        moved = np.abs(grid_map(px) - before) / np.sqrt(variance)
        if np.max(moved[inlier], initial=0.0) < SETTLED:
            break
    nodes, px = _kept(nodes, px, inlier)
    _require_an_even_grid(nodes, px)
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
        line_share=_line_share(nodes),
    )


def _require_an_even_grid(nodes: Nodes, px: FloatArray) -> None:
    """Refuse too few crossings, and crossings that lie on no even grid."""
    if len(px) < LEAST_NODES:
        raise CalibrationError(
            f"only {len(px)} crossings of a grid are in view",
            hint="Show at least three by four squares of the wall's grid.",
        )
    astray = _astray(nodes)
    if not astray < MOST_ASTRAY:
        raise CalibrationError(
            f"lines are seen, but their crossings lie {astray:.2f} of a square off any even grid: "
            "they can't be counted surely",
            hint="Film with more pixels, nearer, or with better light on the wall.",
        )


def _lattice(gray: FloatArray) -> tuple[GridMap, NDArray[np.bool_], list[Lattice], FloatArray]:
    """Map to grid coordinates, where it holds, its two families of lines, and the contrast.

    Fine lines folded over by the pixels make waves of their own: where the best waves make no
    squares, the next may.
    """
    if np.ptp(gray) == 0.0:
        raise nothing_shown()
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
    if not np.ptp(first, axis=0).min() >= FEWEST_PERIODS:
        raise no_grid()
    lattices = [analysed(flat[area], first[:, f], periods[f]) for f in range(2)]
    if not all(lattice.clear for lattice in lattices):
        raise only_stripes()
    grid_map, lattices = _oriented(grid_map, lattices)
    periods = _periods(grid_map, seen)
    if periods.min() < LEAST_PERIOD:
        raise CalibrationError(
            f"what repeats does so every {periods.min():.1f} px: too fine to be counted surely",
            hint="Film nearer or with more pixels: squares must be 3 px wide or more.",
        )
    flat = flattened(gray, 1.5 * float(periods.max()))
    _require_squares(flat[area], grid_map(seen), grid_map)
    return grid_map, area, lattices, flat


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
    """Nodes that agree with the map, and the factor by which variances fall short of scatter."""
    std = np.sqrt(np.einsum("nff->nf", nodes.covariance))
    typical = np.median(nodes.strength, axis=0)
    visible = ((nodes.strength > 0.4 * typical) & (nodes.strength < 2.5 * typical)).all(axis=1)
    visible &= (std < 4.0 * np.median(std, axis=0)).all(axis=1)
    normalised = np.abs(nodes.shift) / std
    factor = max(1.0, float(1.4826 * np.median(normalised[visible])) ** 2) if visible.any() else 1.0
    inlier = visible & (normalised < REJECT_AT * np.sqrt(factor)).all(axis=1)
    return inlier, factor


def _astray(nodes: Nodes) -> float:
    """Robust scatter of single lines about the map beyond their noise, periods.

    A line that is off as a whole, as the pixels may have it, is off to either side at random and
    does no harm to the count. What bends along lines is a wrong map; a node that averages several
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


def _line_share(nodes: Nodes) -> FloatArray:
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
        f"the wall shows {fine} fine divisions in one coarse one; {1e3 * pitch_m:g} mm with "
        f"{1e3 * fine_pitch_m:g} mm gradations would have {pitch_m / fine_pitch_m:g}: "
        "check the pitch",
    )
