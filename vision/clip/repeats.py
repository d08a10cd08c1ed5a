"""Detect clips that show every picture several times, and read each picture once.

Programs that raise a clip's frame rate (25 pictures per second in a file of 50, or 24 in one of 30
or 60) repeat pictures. An object then moves in some steps only, which no motion model describes.
The repeats are coded anew and may differ from the first copy by the codec's noise, so changes are
compared with the changes between pictures that differ, in the same clip.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["DistinctPictures", "PictureSource", "RepeatDetector", "Repeats"]

FloatImage = NDArray[np.float32]

_MAX_TIMES = 8
"""Largest number of repeats tried, 1 (convention: 30 pictures per second in a file of 240)."""

_CADENCES = tuple(
    Fraction(*pair) for pair in ((60, 24), (60, 25), (50, 24), (50, 30), (30, 24), (30, 25))
)
"""Frames per picture where the rate was raised by no whole number (convention: rates of films and
broadcasts)."""

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
    times : Fraction
        Frames per picture; 1 if no picture is repeated.
    shift : Fraction
        Place of the first complete group of repeats, in frames, above -1; the group begins at the
        next frame.
    """

    times: Fraction = Fraction(1)
    shift: Fraction = Fraction(0)

    def begins(self, frames: int) -> NDArray[np.int64]:
        """The first frame of each group."""
        count = max(0, math.floor((frames - 1 - self.shift) / self.times) + 1)
        return np.array([math.ceil(self.shift + k * self.times) for k in range(count)], np.int64)


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
        lone = int(np.count_nonzero(large[:-2] & ~large[1:-1] & large[2:]))
        both = int(np.count_nonzero(large[:-1] & large[1:]))
        return both >= _MIN_STEPS and lone <= (1.0 - _MIN_AGREEING_FRACTION) * both

    def verdict(self) -> Repeats:
        """The smallest number of repeats with which the steps agree."""
        moving, changed = self._energy() > 0.0, self._energy(_CHANGED_SIGMAS, 1)
        for times in (*map(Fraction, range(2, _MAX_TIMES + 1)), *_CADENCES):
            for phase in range(1 - times.denominator, times.numerator + 1 - times.denominator):
                found = Repeats(times, Fraction(phase, times.denominator))
                if _agrees(moving, changed, found):
                    return found
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


def _agrees(moving: NDArray[np.bool_], changed: NDArray[np.float64], repeats: Repeats) -> bool:
    """Whether objects move where groups of repeats begin, and hardly change between."""
    # step k lies between frames k and k + 1
    begins = repeats.begins(len(changed) + 1) - 1
    begins = begins[begins >= 0]
    first, last = begins[:-1], begins[1:]
    moved = moving[first] & moving[last] & (last - first > 1)
    first, last = first[moved], last[moved]
    limit = _MAX_REPEAT_CHANGE * np.minimum(changed[first], changed[last])
    still = np.array(
        [
            changed[a + 1 : b].max() < most
            for a, b, most in zip(first, last, limit.tolist(), strict=True)
        ]
    )
    if len(still) < _MIN_STEPS or still.sum() < _MIN_AGREEING_FRACTION * len(still):
        return False
    # no object moves in the other steps
    large = changed > _MAX_REPEAT_CHANGE * float(np.median(changed[first]))
    return int(large[begins].sum()) >= _MIN_AGREEING_FRACTION * int((large & moving).sum())


class PictureSource(Protocol):
    """Pictures in order, and their times."""

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Time of every picture, s."""

    def pictures(self) -> Iterator[Any]:
        """Yield the pictures."""


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

    def __init__(self, source: PictureSource, repeats: Repeats) -> None:
        self._source = source
        self._repeats = repeats

    @property
    def times(self) -> Fraction:
        """Frames of the source per picture."""
        return self._repeats.times

    @property
    def shift(self) -> Fraction:
        """Place of the first picture, in frames of the source."""
        return self._repeats.shift

    @property
    def damaged(self) -> int:
        """Pictures that could not be decoded."""
        return int(getattr(self._source, "damaged", 0))

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times of the pictures, s, 0 at the first: even where their groups are not."""
        given, repeats = self._source.times_s, self._repeats
        count = len(repeats.begins(len(given)))
        if count < 2:
            return np.zeros(count)
        places = float(repeats.shift) + float(repeats.times) * np.arange(count)
        before = 2.0 * given[0] - given[1]
        times = np.interp(places, np.arange(-1, len(given)), [before, *given])
        return np.asarray(times - times[0])

    def pictures(self) -> Iterator[RenumberedPicture]:
        """Yield the first copy of each picture, numbered anew."""
        repeats, times = self._repeats, self.times_s
        begin = None
        for picture in self._source.pictures():
            number = math.floor((picture.index - repeats.shift) / repeats.times)
            if number < 0 or math.ceil(repeats.shift + number * repeats.times) != picture.index:
                continue
            begin = picture.time_s if begin is None else begin
            known = number < len(times)
            time = float(times[number]) if known else picture.time_s - begin
            yield RenumberedPicture(number, time, picture)
