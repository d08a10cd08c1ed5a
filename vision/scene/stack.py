"""Pictures sorted pixel by pixel: a network of minima and maxima over whole pictures at a time."""

from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["densest", "median_of", "sorted_stack"]

Level = TypeVar("Level", np.uint16, np.float32)


def sorted_stack(pictures: Sequence[NDArray[Level]]) -> list[NDArray[Level]]:
    """Sort each pixel over several pictures.

    Parameters
    ----------
    pictures : sequence of (H, W) arrays
        The pictures.

    Returns
    -------
    list of (H, W) arrays
        The lowest levels, the second lowest, and so on.
    """
    stack = list(pictures)
    for low, high in _comparisons(len(stack)):
        one, other = stack[low], stack[high]
        stack[low], stack[high] = np.minimum(one, other), np.maximum(one, other)
    return stack


def median_of(pictures: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Median of each pixel over several pictures."""
    stack = sorted_stack(pictures)
    middle = len(stack) // 2
    if len(stack) % 2:
        return stack[middle]
    return np.float32(0.5) * (stack[middle - 1] + stack[middle])


def densest(ordered: Sequence[NDArray[np.uint16]], share: float) -> NDArray[np.float32]:
    """Middle of the narrowest interval that holds a share of each pixel's levels.

    Parameters
    ----------
    ordered : sequence of (H, W) arrays
        What `sorted_stack` gave.
    share : float
        That share, 0 to 1.

    Returns
    -------
    (H, W) array
    """
    count = len(ordered)
    reach = min(max(1, round(share * count) - 1), count - 1)
    best = np.full(ordered[0].shape, np.iinfo(np.uint32).max, dtype=np.uint32)
    for first in range(count - reach):
        width = (ordered[first + reach] - ordered[first]).astype(np.uint32)
        np.minimum(best, (width << 8) + np.uint32(first), out=best)
    place = (best & 0xFF).astype(np.int64)
    stack = np.stack(ordered)
    low, high = (
        np.take_along_axis(stack, (place + part)[None], axis=0)[0].astype(np.float32)
        for part in (reach // 2, (reach + 1) // 2)
    )
    return np.asarray(np.float32(0.5) * (low + high))


def _comparisons(count: int) -> Iterator[tuple[int, int]]:
    """Batcher's odd-even merge sort (1968): pairs to be put in order, one after another."""
    width = 1
    while width < count:
        step = width
        while step >= 1:
            for first in range(step % width, count - step, 2 * step):
                for low in range(first, min(first + step, count - step)):
                    if low // (2 * width) == (low + step) // (2 * width):
                        yield low, low + step
            step //= 2
        width *= 2
