"""Measured positions of the grid's nodes, block by block, each with its own noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Nodes", "measured_nodes"]

FloatArray = NDArray[np.float64]

LARGEST_BLOCK = 6
CLEAR = 6.0
"""Amplitude over its standard deviation that a block must reach in the median."""
EVEN = 1.0 / 12.0
"""Robust scatter of the shifts, periods: six of these make a label wrong by one line.

What is finer than the lines, or folded over by the pixels, shifts small blocks, more than noise.
"""
BELOW_NYQUIST = 0.46
PIXELS_AT_ONCE = 8192


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
        if clarity > CLEAR and scatter < EVEN:
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
