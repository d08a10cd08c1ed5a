"""Outlines fitted in several frames, as a table."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

__all__ = ["OutlineFits", "joined", "nothing_found"]

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class OutlineFits:
    """One row per frame.

    Attributes
    ----------
    found : (F,) bool array
        Whether there is an outline at all; the other rows mean nothing.
    centre : (F, 2) array
        Centre, px.
    radius : (F,) array
        Mean radius, px.
    covariance : (F, 2, 2) array
        Of the centre, px²; from the scatter that each sector of the outline shows.
    bound : (F, 2, 2) array
        Cramér–Rao bound of the same from noise and contrast alone, px².
    misfit : (F,) array
        Root mean square residual over noise.
    contrast : (F,) array
        Part of the sectors whose edge stands out from the noise, 0 to 1.
    normal : (F, 5, 5) array
        Normal matrix of centre, radius and ellipse at the solution, 1/px².
    pull : (F, 5) array
        What each of them is still pulled by there, 1/px.
    """

    found: BoolArray
    centre: FloatArray
    radius: FloatArray
    covariance: FloatArray
    bound: FloatArray
    misfit: FloatArray
    contrast: FloatArray
    normal: FloatArray
    pull: FloatArray

    def __len__(self) -> int:
        return len(self.found)

    def at(self, places: IntArray | BoolArray) -> "OutlineFits":
        """Some of the rows."""
        return OutlineFits(*(getattr(self, field.name)[places] for field in fields(self)))

    def put(self, places: IntArray | BoolArray, other: "OutlineFits") -> None:
        """Overwrite some of the rows."""
        for field in fields(self):
            getattr(self, field.name)[places] = getattr(other, field.name)


def nothing_found(count: int) -> OutlineFits:
    """A table of so many frames in which nothing was found yet."""
    return OutlineFits(
        np.zeros(count, dtype=bool),
        np.zeros((count, 2)),
        np.zeros(count),
        np.zeros((count, 2, 2)),
        np.zeros((count, 2, 2)),
        np.zeros(count),
        np.zeros(count),
        np.zeros((count, 5, 5)),
        np.zeros((count, 5)),
    )


def joined(parts: list[OutlineFits]) -> OutlineFits:
    """Tables one below the other."""
    return OutlineFits(
        *(
            np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(OutlineFits)
        )
    )
