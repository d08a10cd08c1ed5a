"""The number types of the physics room: one formula serves a float and an array of trials alike."""

from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["FloatArray", "FloatOrArray", "Number", "Vector"]

FloatArray: TypeAlias = NDArray[np.float64]
Number: TypeAlias = float | FloatArray
"""A float, or an array with one entry per trial or parameter set."""

Vector: TypeAlias = tuple[Number, Number, Number]
"""Components along x, y, z of the world; each a float, or arrays that broadcast together."""

FloatOrArray = TypeVar("FloatOrArray", float, FloatArray)
