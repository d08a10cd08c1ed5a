"""Number types of the physics package and input validation (DomainError).

One formula serves a float and an array of trials.
"""

import math
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from metrology import DomainError

__all__ = [
    "FloatArray",
    "FloatOrArray",
    "Number",
    "Vector",
    "require_angle",
    "require_finite",
    "require_non_negative",
    "require_positive",
]

FloatArray: TypeAlias = NDArray[np.float64]

Number: TypeAlias = float | FloatArray

"""A float, or an array with one entry per trial or parameter set."""

Vector: TypeAlias = tuple[Number, Number, Number]

"""Components along x, y, z of the world; each a float, or arrays that broadcast together."""

FloatOrArray = TypeVar("FloatOrArray", float, FloatArray)


def _values(value: Number) -> FloatArray:
    return np.atleast_1d(np.asarray(value, dtype=np.float64))


def require_finite(name: str, value: Number) -> None:
    """Reject NaN and infinity.

    Raises
    ------
    DomainError
        If any entry of `value` is not a finite number.
    """
    if not np.all(np.isfinite(_values(value))):
        raise DomainError(f"{name} must be a finite number, not {value}")


def require_positive(name: str, value: Number, unit: str = "") -> None:
    """Reject zero, negative numbers, NaN and infinity.

    Raises
    ------
    DomainError
        If any entry of `value` is not a finite number above zero.
    """
    require_finite(name, value)
    if np.any(_values(value) <= 0.0):
        raise DomainError(f"{name} must be above zero, not {value} {unit}".rstrip())


def require_non_negative(name: str, value: Number, unit: str = "") -> None:
    """Reject negative numbers, NaN and infinity.

    Raises
    ------
    DomainError
        If any entry of `value` is negative or not finite.
    """
    require_finite(name, value)
    if np.any(_values(value) < 0.0):
        raise DomainError(f"{name} can't be negative: {value} {unit}".rstrip())


def require_angle(name: str, value: Number, limit: float = math.pi) -> None:
    """Reject angles beyond ±`limit` (rad).

    Raises
    ------
    DomainError
        If any entry lies outside; the message is in degrees.
    """
    require_finite(name, value)
    if np.any(np.abs(_values(value)) > limit):
        raise DomainError(
            f"{name} of {np.rad2deg(value)} deg is beyond {math.degrees(limit):g} deg",
            hint="Angles of the pendulum are counted from its lowest point.",
        )
