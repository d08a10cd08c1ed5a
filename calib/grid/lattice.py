"""Which of the repeating lines are the coarse ones, where they lie, and whether they are a grid.

Measured positions of the grid's nodes, block by block, each with its own noise.
"""

from dataclasses import dataclass
from math import gcd

import numpy as np
from numpy.typing import NDArray

from calib.grid.spectrum import GridMap

__all__ = ["Lattice", "Nodes", "analysed", "measured_nodes", "off_axis_share", "squareness"]

FloatArray = NDArray[np.float64]

BoolArray = NDArray[np.bool_]

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
    order = np.argsort(label, kind="stable")
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


def _waves(coordinates: FloatArray, orders: tuple[tuple[int, ...], ...]) -> FloatArray:
    """Cosine and sine of every order of both families, (N, 2 O)."""
    columns = []
    for family in range(2):
        once = np.exp(2j * np.pi * coordinates[:, family])
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
    clarity = []
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
        clarity.append(np.median(amplitude / np.sqrt(noise[:, cosines].mean(axis=1))))
    shift = np.einsum("nfi,ni->nf", maps, solution)
    spread = np.einsum("nfi,nij,ngj->nfg", maps, covariance, maps)
    return shift, spread, strength, float(min(clarity))
