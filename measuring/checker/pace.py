"""Find repeated pictures, and a part in slow motion, from a track alone.

At the ends of slow motion the speed jumps along the path, by one factor and back, where no force
acts. A strike or a bounce changes the direction, or acts once and leaves the fall as it is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from measuring.checker.fall import find_fall, fit_fall

__all__ = ["SlowPart", "find_slow_part", "repeats_of"]

FloatArray = NDArray[np.float64]

_PACE_STEPS = (8, 4)
"""Steps on each side of a jump (chosen: many for noisy steps, few for a short part)."""

_MIN_FACTOR = 1.8
"""Slow motion (convention: factors are 2, 4, 8, …; less may be friction)."""

_MAX_FROZEN = 0.1
"""Speed in a repeated picture over the usual (chosen: noise of the track is less)."""

_MAX_TURN = 0.1
"""Change of direction at a jump, rad (chosen: that of a fall within a step of 1/30 s)."""

_MAX_MISMATCH = 0.25
"""Relative difference of factors that are one (chosen: they are found to some percent)."""

_MIN_FAST_ROWS = 7
"""Rows next to slow motion that test a known fall (derived: twice a parabola's parameters, and 1).
"""

_MIN_SIGMAS, _MIN_SPEED_SIGMAS = 6.0, 3.0
"""Jump of speed, and slower speed, over their standard uncertainties (chosen)."""

_MIN_RUNS, _MIN_EQUAL = 8, 0.9
"""Runs of equal rows that show a repetition, and the fraction that has one length (chosen)."""

_MAX_REPEATS = 10
"""Equal rows of a moving object; more are a rest (chosen)."""


@dataclass(frozen=True)
class SlowPart:
    """Slow motion before, after or between parts at another speed.

    Attributes
    ----------
    first, last : int
        Rows of the track.
    factor : float
        Times slower than the parts around it; infinite for one picture.
    """

    first: int
    last: int
    factor: float


def repeats_of(place: FloatArray) -> int:
    """How many rows in a row hold each position of the moving object; 1 if each is new."""
    change = np.flatnonzero(np.any(np.diff(place, axis=0) != 0.0, axis=1)) + 1
    runs = np.diff(change)
    runs = runs[runs <= _MAX_REPEATS]
    if len(runs) < _MIN_RUNS:
        return 1
    usual = int(np.median(runs))
    return usual if np.mean(runs == usual) >= _MIN_EQUAL else 1


def find_slow_part(time: FloatArray, place: FloatArray) -> SlowPart | None:
    """Slow motion in the middle of a track; None if there is none.

    Parameters
    ----------
    time : (N,) array
        Increasing.
    place : (N, 2) array
    """
    return _frozen(time, place) or next(
        (one for steps in _PACE_STEPS if (one := _slow_part(time, place, steps)) is not None), None
    )


def _frozen(time: FloatArray, place: FloatArray) -> SlowPart | None:
    """A part in which an object stands still and then goes on as before; a rest begins or ends."""
    steps = _PACE_STEPS[0]
    if len(time) < 4 * steps:
        return None
    velocity = np.diff(place, axis=0) / np.diff(time)[:, None]
    speed = np.hypot(*velocity.T)
    still = np.concatenate([[False], speed < _MAX_FROZEN * np.quantile(speed, 0.75), [False]])
    first, last = np.flatnonzero(np.diff(still.astype(int))).reshape(-1, 2).T
    for begin, end in zip(first.tolist(), last.tolist(), strict=True):
        if end - begin < steps or begin < steps or end > len(velocity) - steps:
            continue
        before, noise = _at_end(velocity[begin - steps : begin][::-1])
        after, more = _at_end(velocity[end : end + steps])
        usual = 0.5 * float(np.hypot(*before) + np.hypot(*after))
        # the noise of a rest is no motion that goes on
        moves = usual > _MIN_SIGMAS * max(noise, more)
        if moves and np.hypot(*(after - before)) < _MAX_MISMATCH * usual:
            return SlowPart(begin, end, float("inf"))
    return None


def _slow_part(time: FloatArray, place: FloatArray, steps: int) -> SlowPart | None:
    jumps = _jumps(time, place, steps)
    # more of them are a jerky motion
    if len(jumps) == 2:
        (first, slower), (last, faster) = jumps
        one = slower < 1.0 < faster and abs(np.log(slower * faster)) < _MAX_MISMATCH
        if one and _slow_throughout(time, place, (first, last), steps):
            return SlowPart(first, last, float(np.sqrt(faster / slower)))
    for row, factor in jumps:
        if _falls_alike(time, place, row, factor):
            end = len(time) - 1
            return SlowPart(0, row, factor) if factor > 1.0 else SlowPart(row, end, 1.0 / factor)
    return None


def _slow_throughout(
    time: FloatArray, place: FloatArray, part: tuple[int, int], steps: int
) -> bool:
    """Whether a part is slower than what is on both its sides; a swing is not, from turn to turn.

    It is longer than the steps in which both jumps are seen: a turn has two sides, too.
    """
    first, last = part
    speed = np.hypot(*(place[steps:] - place[:-steps]).T) / (time[steps:] - time[:-steps])
    inside = speed[first : last - steps]
    return last - first > 2 * steps and bool(inside.max() < min(speed[first - steps], speed[last]))


def _falls_alike(time: FloatArray, place: FloatArray, row: int, factor: float) -> bool:
    """Whether the fall changes with the square of the speed's factor, as only a clock's does."""
    before, after = (time[: row + 1], place[: row + 1]), (time[row + 1 :], place[row + 1 :])
    slow, fast = (before, after) if factor > 1.0 else (after, before)
    fall = find_fall(*slow)
    if fall is None:
        return False
    ratio = max(factor, 1.0 / factor) ** 2
    # a few fast pictures show a fall at a known acceleration that they would not reveal alone
    seen = find_fall(*fast) or (fit_fall(*fast) if len(fast[0]) > _MIN_FAST_ROWS else None)
    if seen is None:
        return False
    expected = ratio * fall.acceleration
    allowed = 2.0 * _MAX_MISMATCH * float(np.hypot(*expected)) + _MIN_SPEED_SIGMAS * seen.std
    changed = float(np.hypot(*(seen.acceleration - fall.acceleration)))
    return bool(
        np.hypot(*(seen.acceleration - expected)) < allowed and changed > _MIN_SIGMAS * seen.std
    )


def _jumps(time: FloatArray, place: FloatArray, steps: int) -> list[tuple[int, float]]:
    """Rows at which the speed jumps along the path, with its factor; the clearest of neighbours.

    The step at the jump is not used: part of it may have either speed.
    """
    velocity = np.diff(place, axis=0) / np.diff(time)[:, None]
    found: list[tuple[int, float, float]] = []
    for first in range(steps, len(velocity) - steps, _BLOCK_ROWS):
        rows = np.arange(first, min(first + _BLOCK_ROWS, len(velocity) - steps))
        spans = np.lib.stride_tricks.sliding_window_view(velocity, steps, axis=0).swapaxes(1, 2)
        before, noise = _at_end(spans[rows - steps, ::-1])
        after, more = _at_end(spans[rows + 1])
        speeds = np.stack([np.hypot(*before.T), np.hypot(*after.T)])
        slow, fast = np.sort(speeds, axis=0)
        std = np.hypot(noise, more)
        jump = (slow > _MIN_SPEED_SIGMAS * np.minimum(noise, more)) & (fast >= _MIN_FACTOR * slow)
        jump &= fast - slow > _MIN_SIGMAS * std
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = np.arccos(np.clip((before * after).sum(axis=1) / (slow * fast), -1.0, 1.0))
            turn -= 2.0 * np.hypot(noise / speeds[0], more / speeds[1])
            factor, clear = speeds[1] / speeds[0], (fast - slow) / std
        for at in np.flatnonzero(jump & (turn < _MAX_TURN)):
            found.append((int(rows[at]), float(factor[at]), float(clear[at])))
    kept: list[tuple[int, float, float]] = []
    for jump in found:
        if kept and jump[0] - kept[-1][0] <= steps:
            kept[-1] = max(kept[-1], jump, key=lambda one: one[2])
        else:
            kept.append(jump)
    return [(row, factor) for row, factor, _ in kept]


def _at_end(velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Velocities (…, N, 2) extrapolated by half a step to before the first, with their std."""
    middle = np.arange(velocity.shape[-2]) + 0.5
    design = np.column_stack([np.ones_like(middle), middle])
    inverse = np.linalg.inv(design.T @ design)
    fitted = inverse @ design.T @ velocity
    rest = velocity - design @ fitted
    noise = np.sqrt((rest**2).sum(axis=(-2, -1)) / (2 * (len(middle) - 2)))
    largest = np.abs(velocity).max(axis=(-2, -1))
    return fitted[..., 0, :], noise * np.sqrt(inverse[0, 0]) + 1e-12 * largest


_BLOCK_ROWS = 65_536
"""Rows computed at once (chosen: some ten megabytes)."""
