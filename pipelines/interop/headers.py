"""Determine what the columns of any table are: time, positions, objects, units.

Names are compared word by word, without units, run numbers and the words with which programs
describe a position, in English, German, French and Spanish. What remains names the object.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from metrology.measurands import UNIT_OF, folded, unit_word

__all__ = [
    "HEADER_LINES",
    "AxisColumns",
    "Clock",
    "find_header",
    "has_numbers",
    "is_unit_row",
    "is_value",
    "may_be_position",
    "positions_of",
    "read_clock",
    "read_timecode",
    "time_column",
]

FloatArray = NDArray[np.float64]


def _set(words: str) -> frozenset[str]:
    return frozenset(words.split())


_TIME_HEADERS = _set(
    "t time times zeit temps tiempo tempo seconds sekunden timestamp timecode uhrzeit hora heure"
)

_DATE_HEADERS = _set("date datum fecha data")
"""Words of a column beside the time in which programs write the day as well."""

_AXIS_HEADERS = {
    "x": _set("x horizontal horizontale abscisse abscissa abszisse abscisa"),
    "y": _set(
        "y vertical vertikal verticale hohe height hauteur altura altezza ordonnee ordinate"
        " ordenada"
    ),
    "z": _set("z"),
}

_DESCRIPTIONS = _set(
    "position positions pos posicion lage ort coordinate coordinates coord coords"
    " koordinate coordonnee coordenada latest run lauf essai ensayo messung data set"
    " daten serie center centre centroid mittelpunkt track trajectory the of der de la"
    " px pixel pixels mm cm m in ft"
)

_RUNS = _set("run lauf essai ensayo messung versuch durchgang set")
"""Words before the number of a run; another number is that of an object."""

_NOT_POSITIONS = _set(
    "v vx vy vel velocity speed geschwindigkeit vitesse velocidad a ax ay acc acceleration"
    " beschleunigung aceleracion std err error sigma uncertainty"
    " unsicherheit likelihood score confidence size radius r theta angle winkel angulo phi"
    " omega frame bild image step kinetic potential energy energie"
)

_RATE_UNIT = re.compile(r"/\s*s|s\^?-1|s⁻¹|°|deg|rad", re.IGNORECASE)

HEADER_LINES = 40
"""Lines searched for the header (chosen: LabVIEW writes some 25 above it)."""


@dataclass(frozen=True)
class AxisColumns:
    """The columns of an object.

    Attributes
    ----------
    name : str
        Of the object; empty if the header names none.
    x, y : str
    t : str or None
        Its own times; None if the table has one clock.
    z : str or None
        Its third dimension, if the table has one.
    """

    name: str
    x: str
    y: str
    t: str | None = None
    z: str | None = None


def _words(name: str) -> list[str]:
    """Words without units and accents, but with an axis in brackets; numbers apart."""
    bare = re.sub(r"[\(\[](?!\s*[xy]\s*[\)\]]).*?[\)\]]", " ", folded(name))
    return [word for word in re.split(r"[^\w]+|_|(?<=[^\W\d])(?=\d)", bare) if word]


def time_column(header: Sequence[str]) -> str | None:
    """The only column of times, dates aside; None if there is none or several."""
    found = [
        name
        for name in header
        if (words := _words(name)) and set(words) & _TIME_HEADERS and not _axis(words)
    ]
    bare = [name for name in found if not set(_words(name)) & _DATE_HEADERS]
    one = bare if found[1:] else found
    return one[0] if len(one) == 1 else None


def _axis(words: Sequence[str]) -> str | None:
    found = [axis for axis, names in _AXIS_HEADERS.items() if set(words) & names]
    return found[0] if len(found) == 1 else None


def positions_of(header: Sequence[str]) -> tuple[AxisColumns, ...]:
    """Pairs of columns that are the positions of objects, in the order of the table.

    Runs side by side, distinguished by their numbers, are objects. Empty if an object has two
    columns for one axis: they must be named by the user.
    """
    return _pairs(header, runs=False) or _pairs(header, runs=True)


def _pairs(header: Sequence[str], runs: bool) -> tuple[AxisColumns, ...]:
    found: dict[str, dict[str, str]] = {}
    for name in header:
        words = _words(name)
        axis = _axis(words) or ("t" if set(words) & _TIME_HEADERS else None)
        if axis is None or not may_be_position(name) or (axis == "t" and not runs):
            continue
        columns = found.setdefault(_object(words, axis, runs), {})
        if axis in columns:
            return ()
        columns[axis] = name
    return tuple(
        AxisColumns(name, columns["x"], columns["y"], columns.get("t"), columns.get("z"))
        for name, columns in found.items()
        if columns.keys() >= {"x", "y"}
    )


def may_be_position(name: str) -> bool:
    """Whether a column may hold positions or times, rather than velocities, angles and the like."""
    unit = re.search(r"[\(\[](.*?)[\)\]]", name)
    rate = unit is not None and _RATE_UNIT.search(unit[1]) is not None
    # an object may be called A or V, where the unit is a length
    called = (
        {"a", "v"} if unit is not None and unit_word(unit[1]) in _TABLE_UNITS.values() else set()
    )
    return not rate and not set(_words(name)) & _NOT_POSITIONS - called


def _object(words: Sequence[str], axis: str, runs: bool) -> str:
    """What remains of a column's name: the object, with its run if runs are distinguished."""
    known = _DESCRIPTIONS | (_TIME_HEADERS if axis == "t" else _AXIS_HEADERS[axis])
    rest = [word for word in words if word not in known and not word.isdigit()]
    numbers = [word for word in words if word.isdigit()] if runs else []
    run = ["run"] if numbers and set(words) & _RUNS else []
    return " ".join([*rest, *run, *numbers])


def find_header(rows: Sequence[Sequence[str]]) -> int:
    """Number of the header's line: the last one above a line of numbers.

    Of several, as where programs write the settings of a recording above its table, the first that
    names a time or a position.

    Parameters
    ----------
    rows : sequence of sequences of str
        Cells of the first lines.

    Returns
    -------
    int
        0 if there is no line of numbers below a line of words.
    """
    numbers = [_is_of_numbers(row) for row in rows[:HEADER_LINES]]
    found = [at - 1 for at in range(1, len(numbers)) if numbers[at] and not numbers[at - 1]]
    # the names, or those above their units
    naming = (
        at
        for at in found
        if any(time_column(row) or positions_of(row) for row in rows[max(0, at - 1) : at + 1])
    )
    return 0 if numbers[:1] == [True] else next(naming, found[0] if found else 0)


def has_numbers(rows: Sequence[Sequence[str]]) -> bool:
    """Whether one of the first lines is a line of numbers."""
    return any(map(_is_of_numbers, rows[:HEADER_LINES]))


def _is_of_numbers(row: Sequence[str]) -> bool:
    written = [cell for cell in row if cell.strip()]
    values = sum(map(is_value, written))
    return values >= _MIN_VALUES and 2 * values > len(written)


_MIN_VALUES = 2
"""Numbers in the first row below a header (derived: a time and a position)."""


def is_value(cell: str) -> bool:
    """Whether a cell is a number, with or without a unit, a time, a date, or says: none."""
    found = re.fullmatch(r"\s*[-+]?[\d.,:/ T\u2212-]*\d[\d.,:eEdD+Z-]*\s*(\D*)", cell)
    if found is None:
        return cell.strip().casefold() in ("nan", "na", "n/a")
    unit = found[1].strip().split("/")[0]
    return not unit or unit_word(unit) in _TABLE_UNITS


_TABLE_UNITS = UNIT_OF | {"frame": "frame", "frames": "frame"}
"""Units of the cells of a table."""


def is_unit_row(cells: Sequence[str]) -> bool:
    """Whether a row holds nothing but units: ``s,cm,cm`` or ``(s),(cm),(cm)``."""
    written = [cell.strip() for cell in cells if cell.strip()]
    return bool(written) and all(
        re.fullmatch(r"[\(\[].*[\)\]]", cell)
        or unit_word(cell) in _TABLE_UNITS
        or unit_word(re.split(r"[/·*^ ]", cell)[0]) in _TABLE_UNITS
        for cell in written
    )


_SECONDS_PER_DAY = 86400.0

_SERIAL_DAYS = (20_000.0, 80_000.0)
"""Days since 1899-12-30 of the years 1954 to 2119 (convention: Excel)."""

_EPOCH_UNITS = (
    (1.0, "seconds"),
    (1e-3, "milliseconds"),
    (1e-6, "microseconds"),
    (1e-9, "nanoseconds"),
)

_EPOCH_S = (3e8, 5e9)
"""Seconds since 1970 of the years 1979 to 2128."""


@dataclass(frozen=True)
class Clock:
    """Times of a column.

    Attributes
    ----------
    seconds : (N,) array
        From the first one.
    note : str
        How they were read; empty for numbers of seconds.
    """

    seconds: FloatArray
    note: str = ""


def read_clock(cells: "pd.Series[Any]", unit: str | None) -> Clock | None:
    """Times of a column of dates, times of day, serial days or seconds since 1970.

    Parameters
    ----------
    cells : Series
    unit : str or None
        As stated in the header or by the user.

    Returns
    -------
    Clock or None
        None if the cells are plain numbers, whose unit is the header's.
    """
    if pd.api.types.is_datetime64_any_dtype(cells):
        return _since_first(cells, "The times are dates; they are counted from the first one.")
    numbers = pd.to_numeric(cells, errors="coerce")
    known = numbers.notna()
    if known.sum() * 2 > cells.notna().sum():
        if unit is not None or not known.any():
            return None
        return _of_numbers(np.asarray(numbers, dtype=float))
    text = cells.map(lambda cell: "" if pd.isna(cell) else str(cell).strip().replace(",", "."))
    seconds = text.map(_seconds_of_day)
    if seconds.notna().sum() * 2 > (text != "").sum():
        values = np.asarray(seconds, dtype=float)
        begin = values[np.isfinite(values)][0]
        steps = values - begin
        # a recording over midnight
        steps = np.where(steps < -0.5 * _SECONDS_PER_DAY, steps + _SECONDS_PER_DAY, steps)
        return Clock(steps, "The times are times of day; they are counted from the first one.")
    dates = pd.to_datetime(text.where(text != ""), errors="coerce", format="mixed")
    if dates.notna().sum() * 2 > (text != "").sum():
        return _since_first(dates, "The times are dates; they are counted from the first one.")
    return None


def _since_first(dates: "pd.Series[Any]", note: str) -> Clock:
    begin = dates.dropna().iloc[0]
    return Clock(np.asarray((dates - begin).dt.total_seconds(), dtype=float), note)


def _of_numbers(values: FloatArray) -> Clock | None:
    known = values[np.isfinite(values)]
    low, high = float(known.min()), float(known.max())
    since = values - known[0]
    if _SERIAL_DAYS[0] <= low and high <= _SERIAL_DAYS[1] and 0.0 < high - low < 1.0:
        return Clock(
            since * _SECONDS_PER_DAY,
            "The times are serial days of a spreadsheet; they are converted to seconds.",
        )
    for factor, name in _EPOCH_UNITS:
        if _EPOCH_S[0] <= low * factor and high * factor <= _EPOCH_S[1]:
            return Clock(since * factor, f"The times are {name} since 1970.")
    return None


def _seconds_of_day(text: str) -> float:
    """Seconds of ``10:03:07.002`` or ``03:07.002``; NaN for anything else."""
    found = re.fullmatch(r"(?:(\d{1,2}):)?(\d{1,2}):(\d{1,2}(?:\.\d+)?)", text)
    if found is None:
        return float("nan")
    return 3600.0 * int(found[1] or 0) + 60.0 * int(found[2]) + float(found[3])


_TIMECODE = re.compile(r"(\d+):(\d{1,2}):(\d{1,2})[:;](\d{1,3})")

_TIMECODE_RATES = (24, 25, 30, 48, 50, 60, 100, 120, 240)
"""Pictures per second that timecodes count (convention: SMPTE 12M, and recorders)."""


def read_timecode(cells: "pd.Series[Any]") -> tuple[FloatArray, int] | None:
    """Picture numbers of timecodes such as ``00:01:07:23``, and the pictures in their second.

    Returns
    -------
    tuple or None
        None unless most cells are timecodes, and their last parts show how many pictures a second
        has: all of them are counted up.
    """
    found = [_TIMECODE.fullmatch(str(cell).strip()) for cell in cells]
    known = [[int(part) for part in one.groups()] for one in found if one is not None]
    if 2 * len(known) <= len(found):
        return None
    highest = max(one[3] for one in known)
    rate = next((rate for rate in _TIMECODE_RATES if rate > highest), None)
    if rate is None:
        return None
    numbers = np.full(len(found), np.nan)
    numbers[[k for k, one in enumerate(found) if one is not None]] = [
        rate * (3600 * one[0] + 60 * one[1] + one[2]) + one[3] for one in known
    ]
    steps = np.diff(numbers[np.isfinite(numbers)])
    return (numbers, rate) if len(steps) and np.median(steps) == 1.0 else None
