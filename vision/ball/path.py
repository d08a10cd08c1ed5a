"""Where one round object was in some of the frames, before it is fitted."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = ["BallPath"]


@dataclass(frozen=True)
class BallPath:
    """A round object in the frames in which it was found.

    Attributes
    ----------
    frame : (N,) int array
        Frame indices, increasing.
    centre_px : (N, 2) array
        Centres, px.
    radius_px : (N,) array
        Radii, px.
    """

    frame: NDArray[np.int64]
    centre_px: NDArray[np.float64]
    radius_px: NDArray[np.float64]

    def where(self, keep: NDArray[np.bool_]) -> "BallPath":
        """Some of the rows (N,)."""
        return BallPath(self.frame[keep], self.centre_px[keep], self.radius_px[keep])

    @cached_property
    def radius(self) -> float:
        """Typical radius, px."""
        return float(np.median(self.radius_px))
