"""Detect clips that show every picture several times, and read each picture once.

Programs that raise a clip's frame rate (25 pictures per second in a file of 50) repeat pictures. An
object then moves in every second step only, which no motion model describes. The repeats are coded
anew and may differ from the first copy by the codec's noise, so changes are compared with the
changes between pictures that differ, in the same clip.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["DistinctPictures", "RepeatDetector", "Repeats"]

FloatImage = NDArray[np.float32]

_MAX_TIMES = 8
"""Largest number of repeats tried, 1 (convention: 30 pictures per second in a file of 240)."""

_MAX_REPEAT_CHANGE = 0.25
"""Largest change within a repeated picture, fraction of the squared change to the next (derived:
half the displacement. Smooth motion changes by nearly equal steps)."""

_MIN_STEPS = 8
"""Minimum number of steps that agree (derived: steps of random size do once in 4**8)."""

_MIN_AGREEING_FRACTION = 0.9
"""Fraction of the steps that must agree (chosen: a bounce may hide one of ten)."""

_MOVING_SIGMAS = 6.0
"""Standard deviations of a moving pixel (derived: no false one among a million pixels)."""

_CHANGED_SIGMAS = 3.0
"""Standard deviations of a pixel that changed (convention). Where a slow object barely moves more
than the noise, a codec's pictures differ more in every second step, and the others are no
repeats."""

_MIN_MOVING_PIXELS = 20
"""Moving pixels of a step; fewer are noise (chosen)."""

_MIN_NOISE_LEVEL = 1e-3
"""Smallest noise assumed, fraction of the mean gray level (derived: rounding to 8 bit)."""

_KEPT_FRACTION = 0.01
"""Fraction of the pixels, those that changed most, that is kept of each step (chosen)."""

_MAX_PIXELS = 200_000
"""Pixels compared in each picture (chosen); in larger pictures whole lines are left out."""


@dataclass(frozen=True)
class Repeats:
    """How often each picture of a clip is shown.

    Attributes
    ----------
    times : int
        1 if no picture is repeated.
    first : int
        Picture at which the first complete group of repeats begins.
    """

    times: int = 1
    first: int = 0


class RepeatDetector:
    """Detect repeated pictures from the changes between neighbours."""

    def __init__(self) -> None:
        self._last: FloatImage | None = None
        self._noise: list[float] = []
        self._changes: list[FloatImage] = []

    def show(self, picture: NDArray[Any]) -> None:
        """Add the next picture (H, W)."""
        stride = -(-picture.size // _MAX_PIXELS)
        lines = picture[::stride].astype(np.float32)
        # Mains flicker changes the whole picture; only motion must count.
        lines *= np.float32(1.0 / max(float(lines.mean()), 1e-3))
        if self._last is not None:
            change = np.abs(lines - self._last)
            self._noise.append(1.5 * float(np.median(change[::3, ::3])) + _MIN_NOISE_LEVEL)
            kept = min(max(int(_KEPT_FRACTION * change.size), 10 * _MIN_MOVING_PIXELS), change.size)
            self._changes.append(np.partition(change, -kept, axis=None)[-kept:])
        self._last = lines

    @property
    def settled(self) -> bool:
        """Whether enough neighbouring steps moved to exclude repeats."""
        if not self._changes or len(self._changes) % _MIN_STEPS:
            return False
        energy = self._energy()
        # What the codec changes within a group is small beside the largest motion.
        large = energy > _MAX_REPEAT_CHANGE * energy.max()
        return int(np.count_nonzero(large[:-1] & large[1:])) >= _MIN_STEPS

    def verdict(self) -> Repeats:
        """The smallest number of repeats with which the steps agree."""
        moving, changed = self._energy() > 0.0, self._energy(_CHANGED_SIGMAS, 1)
        for times in range(2, _MAX_TIMES + 1):
            for phase in range(times):
                if _agrees(moving, changed, times, phase):
                    # Step k lies between pictures k and k + 1; a step ends a group.
                    return Repeats(times, (phase + 1) % times)
        return Repeats()

    def _energy(
        self, sigmas: float = _MOVING_SIGMAS, least: int = _MIN_MOVING_PIXELS
    ) -> NDArray[np.float64]:
        """Squared change of each step in its pixels beyond the noise; 0 where they are too few."""
        if not self._changes:
            return np.zeros(0)
        # Copies share their noise: the steps between different pictures show it.
        limit = sigmas * float(np.quantile(self._noise, 0.9))
        beyond = [change[change > limit] for change in self._changes]
        return np.array(
            [
                float(np.sum(change**2, dtype=np.float64)) if len(change) >= least else 0.0
                for change in beyond
            ]
        )


def _agrees(
    moving: NDArray[np.bool_], changed: NDArray[np.float64], times: int, phase: int
) -> bool:
    """Whether objects move in steps `phase`, `phase + times`, … and hardly change between."""
    begins = np.arange(phase, len(changed) - times, times)
    moved = begins[moving[begins] & moving[begins + times]]
    between = changed[moved[:, np.newaxis] + np.arange(1, times)].max(axis=1, initial=0.0)
    still = between < _MAX_REPEAT_CHANGE * np.minimum(changed[moved], changed[moved + times])
    return len(moved) >= _MIN_STEPS and int(still.sum()) >= _MIN_AGREEING_FRACTION * len(moved)


class _Source(Protocol):
    @property
    def times_s(self) -> NDArray[np.float64]: ...

    def pictures(self) -> Iterator[Any]: ...


@dataclass(frozen=True)
class RenumberedPicture:
    """A picture under another number and time."""

    index: int
    time_s: float
    picture: Any

    def gray(self) -> NDArray[Any]:
        """Gray levels (H, W)."""
        return np.asarray(self.picture.gray())

    def colour(self) -> NDArray[np.uint8]:
        """Colour image (H, W, 3), blue first."""
        return np.asarray(self.picture.colour())


class DistinctPictures:
    """The pictures of a source, each once.

    Parameters
    ----------
    source : object
        With `times_s` and `pictures()`.
    repeats : Repeats
    """

    def __init__(self, source: _Source, repeats: Repeats) -> None:
        self._source = source
        self._repeats = repeats

    @property
    def times(self) -> int:
        """How often the source shows each picture."""
        return self._repeats.times

    @property
    def damaged(self) -> int:
        """Pictures that could not be decoded."""
        return int(getattr(self._source, "damaged", 0))

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times of the pictures, s, 0 at the first."""
        times = self._source.times_s[self._repeats.first :: self._repeats.times]
        return times - times[0] if len(times) else times

    def pictures(self) -> Iterator[RenumberedPicture]:
        """Yield the first copy of each picture, numbered anew."""
        begin = None
        for picture in self._source.pictures():
            since = picture.index - self._repeats.first
            if since < 0 or since % self._repeats.times:
                continue
            begin = picture.time_s if begin is None else begin
            yield RenumberedPicture(since // self._repeats.times, picture.time_s - begin, picture)
