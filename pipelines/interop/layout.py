"""Find time and positions by the values of columns whose names do not say.

Names in a language that is not known, one position of a motion sensor, and the edges of boxes that
a detector draws. What the values say is used only where a free fall confirms it.
"""

import re
from collections.abc import Mapping
from itertools import permutations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from measuring.checker.fall import MIN_FALL_ROWS, TIMES_S, units_by_fall
from metrology.measurands import folded, unit_word
from pipelines.interop.headers import is_unit_row, may_be_position
from pipelines.interop.sheets import with_numbers

__all__ = ["along_a_line", "by_fall", "numeric_columns", "with_arm", "with_centres",
           "with_heights",
           "without_units"]  # fmt: skip

FloatArray = NDArray[np.float64]

_BOXES = (
    ("xmin", "ymin", "xmax", "ymax"),
    ("x_min", "y_min", "x_max", "y_max"),
    ("left", "top", "right", "bottom"),
)
_SIZED_BOXES = (
    ("left", "top", "width", "height"),
    ("bb_left", "bb_top", "bb_width", "bb_height"),
)
"""Names of a box's edges in px, as detectors write them."""

_MAX_GUESSED = 2
"""Columns of positions that the values can tell apart (derived: of a plane)."""


def numeric_columns(table: pd.DataFrame) -> dict[str, FloatArray]:
    """Columns that may hold times or positions, by name."""
    found = {}
    for name in map(str, table.columns):
        values = np.asarray(pd.to_numeric(table[name], errors="coerce"), dtype=float)
        if may_be_position(name) and 2 * np.isfinite(values).sum() > len(values) > 0:
            found[name] = values
    return found


def by_fall(table: pd.DataFrame) -> dict[str, str] | None:
    """Columns t, x and y, or t and y, with which the table's flight falls with gravity.

    Returns
    -------
    dict of str to str or None
        None if there are none, or several choices.
    """
    values = numeric_columns(table)
    found = []
    for clock, time in values.items():
        rest = [name for name in values if name != clock]
        known = np.isfinite(time)
        if not 0 < len(rest) <= _MAX_GUESSED or np.any(np.diff(time[known]) <= 0.0):
            continue
        for order in permutations(rest):
            places = [values[name] for name in order]
            # of one position: the height
            place = np.column_stack(places if len(order) > 1 else [np.zeros(len(time)), *places])
            rows = known & np.isfinite(place).all(axis=1)
            if rows.sum() >= MIN_FALL_ROWS and _falls(time[rows], place[rows]):
                keys = "txy" if len(order) > 1 else "ty"
                found.append(dict(zip(keys, (clock, *order), strict=True)))
    return found[0] if len(found) == 1 else None


def _falls(time: FloatArray, place: FloatArray) -> bool:
    turned = place * [1.0, -1.0]
    return any(units_by_fall([(time, one)], tuple(TIMES_S)) is not None for one in (place, turned))


def along_a_line(table: pd.DataFrame, columns: Mapping[str, str], unit: str | None) -> str | None:
    """Add a column of zeros for the axis that a motion along a line lacks; its key, if added."""
    missing = {"x", "y"} - columns.keys()
    if len(missing) != 1:
        return None
    table[f"zero ({unit})" if unit else "zero"] = 0.0
    return missing.pop()


def with_heights(table: pd.DataFrame) -> pd.DataFrame:
    """The table with heights of zero for several objects that have only an x: gliders on a rail."""
    names = [str(name) for name in table.columns if may_be_position(str(name))]
    alone = [name for name in names if re.search(_LONE_X, name)]
    if len(alone) < 2 or any(re.search(_LONE_X.replace("x", "y"), name) for name in names):
        return table
    turned = [re.sub(_LONE_X, "y", name, count=1) for name in alone]
    return table.assign(**dict.fromkeys(turned, 0.0))


_LONE_X = r"(?i)(?<![^\W_])x(?=\d|\b|_)"
"""The letter of the axis in a column's name."""


def with_centres(table: pd.DataFrame) -> pd.DataFrame:
    """The table with centres x and y of boxes, if its columns are the edges of boxes."""
    names = {folded(str(name)): name for name in table.columns}
    for edges in (*_BOXES, *_SIZED_BOXES):
        if not names.keys() >= set(edges) or {"x", "y"} & names.keys():
            continue
        left, top, wide, high = (
            pd.to_numeric(table[names[edge]], errors="coerce") for edge in edges
        )
        if edges in _SIZED_BOXES:
            wide, high = left + wide, top + high
        centred = {"x (px)": 0.5 * (left + wide), "y (px)": 0.5 * (top + high)}
        return table.drop(columns=[names[edge] for edge in edges]).assign(**centred)
    return table


_ANGLES = frozenset(
    ("theta", "angle", "winkel", "angulo", "angolo", "phi", "deflection", "auslenkung")
)
"""Words of a column of angles."""

_RADII = frozenset(["r", "radius", "rho"])

MIN_DEGREES = 2.5 * np.pi
"""Largest angle without a unit that may be in rad (chosen: a turn and a quarter)."""

ARM_PX = 1000.0
"""Arm of an angle without a length, px (chosen: the rounding of positions does not matter)."""


def with_arm(table: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    """The table with positions on an arm, if it holds angles and no positions.

    An angle alone is that of an arm of unknown length, which swings about its mean.
    """
    words = {name: frozenset(re.findall(r"[^\W\d_]+", folded(name))) for name in table.columns}
    angles = [
        name for name, own in words.items() if own & _ANGLES and not re.search(r"/\s*s", name)
    ]
    if len(angles) != 1 or any(own & {"x", "y"} for own in words.values()):
        return table
    angle = np.asarray(pd.to_numeric(table[angles[0]], errors="coerce"), dtype=float)
    unit = re.search(r"deg|grad|°|rad", folded(angles[0]))
    known = angle[np.isfinite(angle)]
    in_rad = unit[0] == "rad" if unit else bool(len(known)) and np.ptp(known) < MIN_DEGREES
    angle = angle if in_rad else np.radians(angle)
    radius = next((name for name, own in words.items() if own & _RADII), None)
    if radius is None:
        mean = np.angle(np.nanmean(np.exp(1j * angle)))
        x, y, head = ARM_PX * np.sin(angle - mean), ARM_PX * np.cos(angle - mean), "px"
        notes.append(
            f"The column {angles[0]!r} is read as the angle of an arm, in"
            f" {'rad' if in_rad else 'degrees'}; its length is not known, so lengths and speeds"
            " are not in metres."
        )
    else:
        length = np.asarray(pd.to_numeric(table[radius], errors="coerce"), dtype=float)
        x, y = length * np.cos(angle), length * np.sin(angle)
        found = re.search(r"[\(\[](.*?)[\)\]]", radius)
        head = found[1] if found else ""
        notes.append(f"The positions are computed from {radius!r} and {angles[0]!r}.")
    return table.drop(columns=angles).assign(**{f"x ({head})": x, f"y ({head})": y})


_VALUE_UNIT = r"\s*([-+]?\d[\d.,]*(?:[eE][-+]?\d+)?)\s*([^\W\d]+)\s*"


def without_units(table: pd.DataFrame) -> pd.DataFrame:
    """Move a unit that stands in every cell of a column into the column's name."""
    for name in table.select_dtypes(exclude="number").columns:
        words = table[name].dropna().astype("string")
        if not len(words) or re.fullmatch(_VALUE_UNIT, words.iloc[0]) is None:
            continue
        parts = words.str.extract(f"^{_VALUE_UNIT}$")
        units = parts[1].dropna().map(unit_word).unique()
        if len(units) == 1 and is_unit_row([str(units[0])]):
            cells = parts[0].reindex(table.index)
            table = table.assign(**{name: cells}).rename(columns={name: f"{name} ({units[0]})"})
    return with_numbers(table)
