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

from measuring.checker.fall import MIN_FALL_ROWS, units_by_fall
from pipelines.interop.headers import folded, is_unit_row, may_be_position, unit_word
from pipelines.interop.sheets import with_numbers

__all__ = ["along_a_line", "by_fall", "numeric_columns", "with_centres", "without_units"]

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
    return any(units_by_fall([(time, one)], ("s", "ms")) is not None for one in (place, turned))


def along_a_line(table: pd.DataFrame, columns: Mapping[str, str], unit: str | None) -> str | None:
    """Add a column of zeros for the axis that a motion along a line lacks; its key, if added."""
    missing = {"x", "y"} - columns.keys()
    if len(missing) != 1:
        return None
    table[f"zero ({unit})" if unit else "zero"] = 0.0
    return missing.pop()


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
