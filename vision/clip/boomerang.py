"""Clips that show the same backwards from their middle on, as telephones can."""

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Boomerang"]

FloatImage = NDArray[np.float32]

_SIZE = (16, 16)
"""Cells to which a picture is reduced. Convention: a ball still changes one."""

_MAX_FRAMES = 3000
"""Frames of such a clip at most. Given by the budget: 3 MB; telephones make a second or two."""

_MIN_FRAMES = 12
"""Frames of such a clip at least. Convention: six of a motion and the same again."""

_LAG = 20
"""Part of the clip after which a moving thing is elsewhere. Convention."""

_ALIKE = 0.5
"""Change between a frame and its twin over that after a lag, at most. Derived: twins differ by the
noise of two frames, whatever else moves on differs by its motion."""


class Boomerang:
    """Finds where a clip turns round, from frames given in order."""

    def __init__(self) -> None:
        self._cells: list[FloatImage] = []
        self._count = 0

    def add(self, cells: FloatImage) -> None:
        """Add the cells (h, w) of the next frame."""
        self._count += 1
        if self._count <= _MAX_FRAMES:
            small = cv2.resize(cells, _SIZE, interpolation=cv2.INTER_AREA)
            self._cells.append(np.asarray(small, dtype=np.float32))

    @property
    def turned(self) -> int | None:
        """First frame that is shown again backwards; None where the clip does not turn round."""
        if self._count > _MAX_FRAMES:
            return None
        cells, found = np.array(self._cells), None
        while (turn := _turn(cells)) is not None:
            cells, found = cells[:turn], turn
        return found


def _turn(cells: NDArray[np.float32]) -> int | None:
    """First frame of the second half (N, h, w) that mirrors the first in time."""
    count = len(cells)
    if count < _MIN_FRAMES:
        return None
    lag = max(count // _LAG, 1)
    for last in (count - 1, count - 2, count):
        early = np.arange(max(last - count + 1, 0), (last + 1) // 2)
        moved = _change(cells[early], cells[np.minimum(early + lag, count - 1)])
        quick = moved >= np.median(moved)
        apart = _change(cells[early], cells[last - early])
        if np.percentile(apart[quick], 90.0) < _ALIKE * np.percentile(moved[quick], 10.0):
            return last // 2 + 1
    return None


def _change(one: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.float32]:
    """Largest change of a cell in each frame (n,)."""
    return np.asarray(np.abs(one - other).max(axis=(1, 2)))
