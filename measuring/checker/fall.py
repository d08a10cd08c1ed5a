"""Find the free flight in a track and its acceleration, whatever the units."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metrology import Defaults

__all__ = ["MIN_FALL_ROWS", "TIMES_S", "Fall", "TableUnits", "find_fall", "fit_fall",
           "turn_of_fall", "units_by_fall"]  # fmt: skip

FloatArray = NDArray[np.float64]

_FRACTIONS = (1.0, 0.85, 0.7, 0.6, 0.5, 0.4, 0.32, 0.25, 0.2, 0.15, 0.1)
"""Lengths of the windows tried, fractions of the track (chosen: steps of a fifth)."""

MIN_FALL_ROWS = 10
"""Rows of a window (chosen: seven more than a parabola has parameters)."""

_MAX_NOISE_RATIO = 1.6
"""Residuals over the noise of a window that is a parabola (chosen: drag and rounding add some)."""

_MIN_SIGNIFICANCE = 12.0
"""Acceleration over its standard uncertainty (chosen: less can't tell inches from centimetres)."""


@dataclass(frozen=True)
class Fall:
    """A flight.

    Attributes
    ----------
    first, last : int
        Rows of the track.
    acceleration : (2,) array
        Along both axes, units of the table.
    std : float
        Standard uncertainty of each.
    """

    first: int
    last: int
    acceleration: FloatArray
    std: float


def find_fall(time: FloatArray, place: FloatArray) -> Fall | None:
    """The longest part of a track that is a parabola with a clear acceleration.

    Parameters
    ----------
    time : (N,) array
        Increasing.
    place : (N, 2) array

    Returns
    -------
    Fall or None
        None if there is no such part.
    """
    noise = _noise(place)
    count = len(time)
    for length in sorted(
        {max(MIN_FALL_ROWS, round(part * count)) for part in _FRACTIONS}, reverse=True
    ):
        found = [
            fall
            for first in range(0, count - length + 1, max(1, length // 10))
            if (fall := _parabola(time, place, first, first + length, noise)) is not None
        ]
        if found:
            return max(found, key=lambda fall: float(np.abs(fall.acceleration).max()) / fall.std)
    return None


def _noise(place: FloatArray) -> FloatArray:
    """Standard deviation along each axis from third differences, which remove smooth motion."""
    third = np.abs(np.diff(place, n=3, axis=0))
    if not len(third):
        return np.zeros(2)
    scatter = 1.4826 * np.median(third, axis=0) / np.sqrt(20.0)
    return np.asarray(np.maximum(scatter, 1e-9 * max(float(np.ptp(place)), 1e-300)))


def _parabola(
    time: FloatArray, place: FloatArray, first: int, end: int, noise: FloatArray
) -> Fall | None:
    t = time[first:end]
    if not t[-1] > t[0]:
        return None
    found, rms = _fitted(t, place[first:end], noise)
    if np.any(rms > _MAX_NOISE_RATIO * noise):
        return None
    if float(np.abs(found.acceleration).max()) < _MIN_SIGNIFICANCE * found.std:
        return None
    return Fall(first, end - 1, found.acceleration, found.std)


def fit_fall(time: FloatArray, place: FloatArray) -> Fall:
    """Acceleration of a whole track, however uncertain."""
    return _fitted(time, place, _noise(place))[0]


def _fitted(t: FloatArray, place: FloatArray, noise: FloatArray) -> tuple[Fall, FloatArray]:
    """Parabola through all rows, and its residuals along each axis."""
    half = 0.5 * float(t[-1] - t[0])
    s = (t - t.mean()) / half
    design = np.column_stack([np.ones_like(s), s, s**2])
    inverse = np.linalg.inv(design.T @ design)
    fitted = inverse @ design.T @ place
    rest = place - design @ fitted
    rms = np.sqrt((rest**2).sum(axis=0) / (len(s) - 3))
    std = 2.0 * float(np.sqrt(inverse[2, 2]) * np.max(np.maximum(rms, noise))) / half**2
    return Fall(0, len(t) - 1, 2.0 * fitted[2] / half**2, std), rms


_LENGTHS_M = {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
TIMES_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
"""Units of time tried, s."""

_MAX_GRAVITY_DEVIATION = 0.06
"""Relative deviation of a fall from gravity (chosen: a stick's scale and drag are within 3 %; the
units nearest to each other differ by a factor of 2.5)."""


@dataclass(frozen=True)
class TableUnits:
    """Units of a table that make its flight a free fall.

    Attributes
    ----------
    length, time : str
        "cm", "s".
    acceleration : float
        Downwards, in these units.
    """

    length: str
    time: str
    acceleration: float

    def note(self, table: str) -> str:
        """What was concluded, and how to override it."""
        units, stated = f"unit is {self.length}", f"unit={self.length}"
        if self.time != "s":
            units = f"units are {self.length} and {self.time}"
            stated = f'"unit={self.length}, t_unit={self.time}"'
        return (
            f"{table} states no unit. Its flight falls with {self.acceleration:.4g}"
            f" {self.length}/{self.time}²: the {units}. To state it, pass --columns {stated}."
        )


def units_by_fall(
    tracks: Sequence[tuple[FloatArray, FloatArray]], times: Sequence[str] = ("s",)
) -> TableUnits | None:
    """Units with which a track falls upright with g; None if none or several do.

    In images y points down: a table whose objects fall to larger y is in pixels.

    Parameters
    ----------
    tracks : sequence of (time, place)
    times : sequence of str
        Possible units of the time.
    """
    found: dict[tuple[str, str], float] = {}
    for time, place in tracks:
        fall = find_fall(time, place) if len(time) >= MIN_FALL_ROWS else None
        if fall is None:
            continue
        down = -float(fall.acceleration[1])
        for length, metre in _LENGTHS_M.items():
            for unit in times:
                ratio = down * metre / TIMES_S[unit] ** 2 / Defaults.GRAVITY.known
                if abs(ratio - 1.0) < _MAX_GRAVITY_DEVIATION:
                    found[length, unit] = down
    if len(found) != 1:
        return None
    (length, unit), down = next(iter(found.items()))
    return TableUnits(length, unit, down)


def turn_of_fall(
    tracks: Sequence[tuple[FloatArray, FloatArray]], metre: float
) -> tuple[float, float] | None:
    """Angle from downwards (−y) to the fall with g of the first track that has one.

    Parameters
    ----------
    tracks : sequence of (time, place)
        Times in s.
    metre : float
        Metres per unit of the places.

    Returns
    -------
    tuple of float or None
        Counterclockwise, with its standard uncertainty, rad.
    """
    for time, place in tracks:
        fall = find_fall(time, place) if len(time) >= MIN_FALL_ROWS else None
        if fall is None:
            continue
        size = float(np.hypot(*fall.acceleration))
        if abs(size * metre / Defaults.GRAVITY.known - 1.0) < _MAX_GRAVITY_DEVIATION:
            x, y = fall.acceleration
            return float(np.arctan2(x, -y)), fall.std / size
    return None
