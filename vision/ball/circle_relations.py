"""Circles beside one another: the same one, a panel of a larger one, the softness about one."""

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["Circle", "middle", "panel_of", "part_of", "rank", "same", "shown"]

FloatImage = NDArray[np.float32]
# Centre x, y, radius, coverage, sharpness.
Circle = tuple[float, float, float, float, float]

# Outlines whose covered parts differ by less are as complete.
_AS_COMPLETE = 0.15
# A rim that changed by less than this part of the middle is blur.
_FAINT_SHARE = 0.25


def rank(circle: Circle) -> float:
    """How clear and large a circle is, the clearest lowest."""
    return -circle[3] * math.log1p(circle[4]) * math.sqrt(circle[2])


def same(circle: Circle, other: Circle) -> bool:
    """Whether two circles describe the same thing."""
    gap = math.hypot(circle[0] - other[0], circle[1] - other[1])
    return bool(gap < 0.5 * max(circle[2], other[2]) and 0.6 < circle[2] / other[2] < 1.6)


def shown(circle: Circle, other: Circle, normalised: FloatImage) -> bool:
    """Whether the circle of what changed is no more than the softness about another one."""
    gap = math.hypot(circle[0] - other[0], circle[1] - other[1])
    if gap > 0.6 * circle[2] or other[2] > circle[2] or other[3] <= circle[3] - _AS_COMPLETE:
        return False
    return not _larger(circle, other) or _faint_beside(circle, other, normalised)


def _faint_beside(circle: Circle, other: Circle, normalised: FloatImage) -> bool:
    """Whether what a circle holds beyond a smaller one is next to nothing beside that."""
    x, y, radius = circle[:3]
    top, left = max(0, int(y - radius)), max(0, int(x - radius))
    window = np.abs(normalised[top : int(y + radius) + 2, left : int(x + radius) + 2])
    rows, columns = np.ogrid[top : top + window.shape[0], left : left + window.shape[1]]
    away = np.hypot(columns - x, rows - y)
    from_other = np.hypot(columns - other[0], rows - other[1])
    beside = window[(away < radius - 0.5) & (from_other > other[2] + 0.5)]
    within = window[from_other < other[2]]
    if len(beside) < 5 or len(within) < 5:
        return True
    return middle(beside) < _FAINT_SHARE * middle(within)


def part_of(circle: Circle, whole: Circle) -> bool:
    """Whether a circle is a part of something that changed all over."""
    gap = math.hypot(circle[0] - whole[0], circle[1] - whole[1])
    inside = gap + circle[2] < 1.1 * whole[2]
    return inside and whole[3] > 1.0 - _AS_COMPLETE and _larger(whole, circle)


def _larger(circle: Circle, other: Circle) -> bool:
    return circle[2] - other[2] > 0.12 * circle[2] + 1.0


def panel_of(circle: Circle, other: Circle) -> bool:
    """Whether `circle` is only a panel or a highlight on the ball `other`."""
    gap = math.hypot(circle[0] - other[0], circle[1] - other[1])
    inside = gap + circle[2] < 1.1 * other[2] and circle[2] < 0.75 * other[2]
    return bool(inside and other[4] > 0.3 * circle[4])


def middle(values: NDArray[np.floating]) -> float:
    """Upper median of a few values, without the ceremony that makes `numpy.median` slow on them."""
    half = len(values) // 2
    return float(np.partition(values, half)[half])
