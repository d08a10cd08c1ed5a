"""Rows of one object in a table: repeats, lost marks, runs, rounded clocks."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from measuring.checker.pace import repeats_of

__all__ = ["Marks", "even_clock", "settled"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Marks:
    """Rows of one object, as in the table but with times in seconds.

    `repeats` counts the rows that hold each position.
    """

    name: str
    place: FloatArray
    frame: FloatArray | None
    time: FloatArray | None
    note: str = ""
    repeats: int = 1

    def for_units(self) -> tuple[FloatArray, FloatArray]:
        """Times and places of the complete rows, in order."""
        assert self.time is not None
        rows = np.isfinite(self.place).all(axis=1) & np.isfinite(self.time)
        time, first = np.unique(self.time[rows], return_index=True)
        return time, self.place[rows][first]

    def unread(self) -> list[str]:
        """What happens to rows that give no mark, or are out of order."""
        key = self.time if self.frame is None else self.frame
        assert key is not None
        whole = np.isfinite(self.place).all(axis=1) & np.isfinite(key)
        count, again = len(whole), int(whole.sum() - len(np.unique(key[whole])))
        said = []
        if self.repeats > 1:
            said.append(
                f"{self.name}: each position stands in {self.repeats} rows, as if every picture"
                " were there so often; the first of them is used."
            )
        if not whole.all():
            said.append(
                f"{self.name}: {int((~whole).sum())} of {count} rows have no position or time"
                f" (the first is row {int(np.argmin(whole)) + 1} below the head) and are skipped."
            )
        stamp = "time" if self.frame is None else "frame"
        if again:
            said.append(
                f"{self.name}: {again} of {count} rows repeat the {stamp} of an earlier row"
                " and are skipped."
            )
        if (back := int(np.sum(np.diff(key[whole]) < 0.0))) > 0:
            said.append(
                f"{self.name}: the {stamp}s run backwards in {back} of {count} rows; the rows are"
                f" put in order of {stamp}."
            )
        return said


def settled(marks: Marks) -> list[Marks]:
    """Runs of an object's rows, without marks of what was lost, on an even clock if they have one.

    Parameters
    ----------
    marks : Marks
        All rows, in the order of the table.
    """
    return [
        _single(replace(run, time=None if run.time is None else even_clock(run.time)))
        for run in _runs(_without_lost(marks))
    ]


MIN_RUN_ROWS = 4
"""Rows of a run (derived: a parabola has three parameters; one more tests it)."""


def _runs(marks: Marks) -> list[Marks]:
    """Runs below each other: the time starts anew, where single rows out of order go back less."""
    key = marks.time if marks.time is not None else marks.frame
    assert key is not None
    known = np.flatnonzero(np.isfinite(key))
    falls = known[1:][np.diff(key[known]) < 0.0]
    parts = np.split(np.arange(len(key)), falls)
    anew = all(key[after[0]] <= np.nanmedian(key[before]) for before, after in pairwise(parts))
    if len(parts) == 1 or not anew or min(map(len, parts)) < MIN_RUN_ROWS:
        return [marks]
    rows = ", ".join(str(part[0] + 1) for part in parts[1:5])
    note = f"The times start anew in row {rows}: there are {len(parts)} runs below each other."
    return [
        replace(
            marks,
            name=f"run {number}",
            place=marks.place[part],
            frame=None if marks.frame is None else marks.frame[part],
            time=None if marks.time is None else marks.time[part],
            note=" ".join(filter(None, (marks.note, note))),
        )
        for number, part in enumerate(parts, start=1)
    ]


def _without_lost(marks: Marks) -> Marks:
    """Blank rows with one constant position at which programs leave what they lost.

    The object comes to it, and leaves it, by much longer steps than any other: a strike from rest
    does not, as it is followed by steps about as long.
    """
    rows = np.flatnonzero(np.isfinite(marks.place).all(axis=1))
    values, which, counts = np.unique(
        marks.place[rows], axis=0, return_inverse=True, return_counts=True
    )
    steps = np.hypot(*np.diff(marks.place[rows], axis=0).T)
    # the mark lies at an end of the longest step
    longest = int(np.argmax(steps)) if len(steps) else 0
    ends = which.ravel()[longest : longest + 2]
    for number in ends:
        lost = which.ravel() == number
        seen = marks.place[rows[~lost]]
        if min(len(seen), counts[number]) < MIN_RUN_ROWS:
            continue
        leaps = steps[lost[1:] != lost[:-1]]
        if not len(leaps) or leaps.min() <= MIN_LEAP * np.hypot(*np.diff(seen, axis=0).T).max():
            continue
        place = marks.place.copy()
        place[rows[lost]] = np.nan
        at = ", ".join(f"{value:g}" for value in values[number])
        note = (
            f"{marks.name}: the position ({at}) stands in {counts[number]} rows, away from the"
            " path: it marks pictures in which the object was lost."
        )
        return replace(marks, place=place, note=" ".join(filter(None, (marks.note, note))))
    return marks


MIN_LEAP = 2.0
"""Step to a mark of what was lost over the longest other step (chosen: a strike makes about 1)."""


def _single(marks: Marks) -> Marks:
    """The first of the rows that repeat a position since every picture is there several times."""
    count = repeats_of(marks.place)
    if count == 1:
        return marks
    new = np.any(np.diff(marks.place, axis=0) != 0.0, axis=1)
    starts = np.concatenate([[0], np.flatnonzero(new) + 1])
    row = np.arange(len(marks.place))
    # of a rest as well, every n-th row
    kept = (row - starts[np.searchsorted(starts, row, side="right") - 1]) % count == 0
    frame, time = (None if one is None else one[kept] for one in (marks.frame, marks.time))
    return replace(marks, place=marks.place[kept], frame=frame, time=time, repeats=count)


def even_clock(time: FloatArray) -> FloatArray:
    """Times of an even clock where the stamps are that clock's, rounded.

    A program that writes milliseconds of 600 pictures per second steps by 1 and 2 ms.
    """
    rows = np.flatnonzero(np.isfinite(time))
    if len(rows) < _MIN_CLOCK_ROWS or np.any(np.diff(time[rows]) <= 0.0):
        return time
    steps = np.diff(time[rows])
    resolution = float(np.max(steps) - np.min(steps))
    fitted = np.polynomial.Polynomial.fit(np.arange(len(rows)), time[rows], 1)(np.arange(len(rows)))
    # Rounding to r makes steps that differ by r, and stamps that deviate by less than r.
    if resolution > 0.75 * float(np.mean(steps)) or np.ptp(time[rows] - fitted) > 1.05 * resolution:
        return time
    even = time.copy()
    even[rows] = fitted
    return even


_MIN_CLOCK_ROWS = 8
"""Rows of a clock that may be rounded (chosen)."""
