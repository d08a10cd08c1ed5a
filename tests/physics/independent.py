"""Gragg–Bulirsch–Stoer integrator, independent of the package."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rates = Callable[[float, Array], Array]


def extrapolated(
    rates: Callable[[float, Array], Array], state: Array, end: float, steps: int
) -> Array:
    """State at `end` after `steps` macro steps of order 16, from time 0."""
    span = end / steps
    for count in range(steps):
        state = _macro(rates, count * span, state, span)
    return state


def _macro(rates: Rates, time: float, state: Array, span: float) -> Array:
    substeps = [2 * k for k in range(1, 9)]
    table: list[list[Array]] = []
    for row, n in enumerate(substeps):
        h = span / n
        before, here = state, state + h * rates(time, state)
        for i in range(1, n):
            before, here = here, before + 2.0 * h * rates(time + i * h, here)
        smooth = 0.5 * (before + here + h * rates(time + span, here))
        line = [smooth]
        for column in range(1, row + 1):
            ratio = (substeps[row] / substeps[row - column]) ** 2
            line.append(line[-1] + (line[-1] - table[-1][column - 1]) / (ratio - 1.0))
        table.append(line)
    return table[-1][-1]
