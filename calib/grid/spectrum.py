"""Where in a picture something repeats in two directions, and how: seeds for the wall grid.

The wall grid as two phase fields over the picture, grown from a seed.

Both families of lines are level sets of a smooth map from pixels to the wall: a homography behind a
radial distortion. The picture, multiplied by the wave the map predicts and averaged locally, tells
by its phase how far off the map is, everywhere at once; the map is then fitted to that.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "GridMap",
    "MapSupport",
    "Seed",
    "find_seeds",
    "flattened",
    "grow",
    "pixel_grid",
    "refitted",
]

FloatArray = NDArray[np.float64]

WINDOWS = (32, 64, 128, 256)
"""px: windows in which waves are looked for, each twice as large, from eight lines of 4 px to ten
of 25 px."""

PERIODS_ACROSS = 4.0

"""A window holds at least this many periods of what is looked for in it."""

HIGHEST_FREQUENCY = 0.46
"""Per px, as in `calib.grid.grid`: below half a period per pixel, less what blur takes."""

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


WINDOW_PERIODS = 1.3
"""Periods, standard deviation of the window: narrow enough to follow the view, wide enough (three
periods in effect) to know a wave from an edge."""

COHERENT = 8.0

"""|mean|² over its expectation in noise: exceeded by chance once in e^8 = 3000 windows."""

GROWTH = 1.3
"""Factor by which the region grows in a step, supposed: the map is extrapolated by less than a
third of its size."""

PERIOD_WANTED = 6.0

"""Larger periods are grown on a smaller picture, px."""

# Widths within which a map may stray from an affine one: perspective, then distortion, in units of
# the half width of the picture. A view 45° oblique through a 90° lens reaches 1; a fish-eye 0.3.
PRIOR_STD = np.array([0.5, 0.5, 0.2, 0.1])

PHASE_STD = 0.03
"""Periods, supposed: how far local phases may be from a smooth map of few parameters."""


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
        n = (np.asarray(px, dtype=np.float64) - self.centre) / self.scale
        p = self.parameters
        r2 = (n * n).sum(axis=-1, keepdims=True)
        u = n * (1.0 + r2 * (p[8] + r2 * p[9]))
        x, y = u[..., 0], u[..., 1]
        depth = 1.0 + p[6] * x + p[7] * y
        depth = np.where(depth > 0.05, depth, np.nan)
        return np.stack(
            [(p[0] * x + p[1] * y + p[2]) / depth, (p[3] * x + p[4] * y + p[5]) / depth], axis=-1
        )

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

    def derivative(self, px: FloatArray) -> FloatArray:
        """Derivative of the grid coordinates of pixels (N, 2) by the parameters, (N, 2, 10)."""
        columns = []
        for column in range(10):
            step = np.zeros(10)
            step[column] = 1e-5 * max(1.0, abs(self.parameters[column]))
            change = self.moved(step)(px) - self.moved(-step)(px)
            columns.append(change / (2.0 * step[column]))
        return np.asarray(np.nan_to_num(np.stack(columns, axis=-1)))

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
    """

    phase: FloatArray
    coherence: FloatArray
    share: FloatArray

    @property
    def area(self) -> NDArray[np.bool_]:
        """Pixels at which both families are seen where the map has them, (H, W)."""
        seen = (self.coherence > COHERENT) & (np.abs(self.phase) < 0.25)
        return np.asarray(seen.all(axis=0))

    @property
    def explained(self) -> float:
        """Share of the whole picture's variance that both waves explain together."""
        return float(np.where(self.area, self.share.sum(axis=0), 0.0).mean())


def pixel_grid(shape: tuple[int, ...]) -> FloatArray:
    """Coordinates of all pixels, (H, W, 2)."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return np.stack([columns, rows], axis=-1).astype(np.float64)


def demodulated(flat: FloatArray, phase: FloatArray, sigma: float) -> MapSupport:
    """Compare a picture with the waves of a map.

    Parameters
    ----------
    flat : (H, W) array
        Relative contrast.
    phase : (H, W, 2) array
        Grid coordinates of every pixel.
    sigma : float
        Standard deviation of the Gaussian average, px.
    """
    energy = np.maximum(smoothed(flat * flat, sigma), 1e-12)
    independent = 4.0 * np.pi * sigma**2
    angles, coherences, shares = [], [], []
    for family in range(2):
        turn = 2.0 * np.pi * np.nan_to_num(phase[..., family])
        real = smoothed(flat * np.cos(turn), sigma)
        imaginary = smoothed(flat * np.sin(turn), sigma)
        square = real**2 + imaginary**2
        angles.append(np.arctan2(-imaginary, real) / (2.0 * np.pi))
        coherences.append(square * independent / energy)
        shares.append(2.0 * square / energy)
    return MapSupport(np.array(angles), np.array(coherences), np.array(shares))


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
    support = demodulated(flat, current(pixels), sigma)
    while True:
        for _ in range(2):
            near = place & (distance < reach)
            phase, coherence = support.phase[:, near], support.coherence[:, near]
            current = _fitted(current, pixels[near], phase, coherence)
            support = demodulated(flat, current(pixels), sigma)
        if reach > distance.max():
            return current, support
        reach *= GROWTH


def _affine(seed: Seed, size: tuple[int, int]) -> GridMap:
    centre = (np.array(size) - 1.0) / 2.0
    scale = np.full(2, size[0] / 2.0)
    rows = seed.waves * scale
    shift = -seed.waves @ (seed.centre - centre)
    parameters = np.concatenate([rows[0], shift[:1], rows[1], shift[1:], np.zeros(4)])
    return GridMap(centre, scale, parameters)


def _fitted(current: GridMap, px: FloatArray, phase: FloatArray, coherence: FloatArray) -> GridMap:
    """Map moved to meet the phases found at `px`: one robust Gauss–Newton step with priors."""
    weight = np.where(coherence > COHERENT, np.minimum(coherence, 50.0) / 50.0, 0.0)
    # Cauchy weights: a window on a shadow's edge has a phase of its own
    weight = weight / (1.0 + (phase / 0.1) ** 2) / PHASE_STD**2
    derivative = np.moveaxis(current.derivative(px), 1, 0)
    normal = np.einsum("fni,fn,fnj->ij", derivative, weight, derivative)
    right = np.einsum("fni,fn,fn->i", derivative, weight, phase)
    return _stepped(current, normal, right)


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
    derivative = current.derivative(px)
    normal = np.einsum("nfi,nf,nfj->ij", derivative, weight, derivative)
    right = np.einsum("nfi,nf,nf->i", derivative, weight, shift)
    return _stepped(current, normal, right)


def _stepped(current: GridMap, normal: FloatArray, right: FloatArray) -> GridMap:
    normal, right = normal.copy(), right.copy()
    normal[np.arange(6, 10), np.arange(6, 10)] += PRIOR_STD**-2
    right[6:] -= current.parameters[6:] * PRIOR_STD**-2
    normal[np.arange(6), np.arange(6)] += 1e-6
    return current.moved(np.asarray(np.linalg.solve(normal, right), dtype=np.float64))
