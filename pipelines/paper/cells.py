"""One cell of the audit: print, ours, difference, verdict and why."""

from dataclasses import asdict, dataclass
from typing import Literal, TypeAlias

__all__ = ["Cell", "Verdict", "as_rows", "half_digit", "judged"]

Verdict: TypeAlias = Literal[
    "reproduced",
    "rounding",
    "slip in print",
    "not reproducible from what is printed",
]

_BEYOND: Verdict = "not reproducible from what is printed"


@dataclass(frozen=True)
class Cell:
    """A printed number beside ours.

    Attributes
    ----------
    table : int
    row, column : str
    printed, ours, difference : float
        In the table's unit; the difference is ours minus print.
    verdict : Verdict
    note : str
    """

    table: int
    row: str
    column: str
    printed: float
    ours: float
    difference: float
    verdict: Verdict
    note: str


def half_digit(text: str) -> float:
    """Half a unit of the last printed digit."""
    _, _, decimals = text.partition(".")
    return float(0.5 * 10.0 ** -len(decimals))


def judged(
    table: int,
    row: str,
    column: str,
    printed: str,
    ours: float,
    *,
    input_rounding: float = 0.0,
    beyond: Verdict = _BEYOND,
    note: str = "",
    within: str = "",
) -> Cell:
    """Judge a cell.

    Parameters
    ----------
    table, row, column
        Where it is.
    printed : str
        The digits as printed.
    ours : float
        Recomputed.
    input_rounding : float
        How far the printed inputs' own rounding can shift `ours`.
    beyond : Verdict
        Verdict where neither rounding explains the difference.
    note, within : str
        Why, where it is not explained; and what to say where it is.
    """
    difference = ours - float(printed)
    half = half_digit(printed)
    verdict: Verdict
    if abs(difference) <= half * (1.0 + 1e-9):
        verdict, said = "reproduced", within
    elif abs(difference) <= half + input_rounding:
        verdict, said = "rounding", within or "within what the rounding of its inputs allows"
    else:
        verdict, said = beyond, note
    return Cell(table, row, column, float(printed), ours, difference, verdict, said)


def as_rows(cells: tuple[Cell, ...]) -> list[dict[str, object]]:
    """The contract's JSON rows."""
    rows = []
    for cell in cells:
        row = asdict(cell)
        row["print"] = row.pop("printed")
        keys = ("table", "row", "column", "print", "ours", "difference", "verdict", "note")
        rows.append({key: row[key] for key in keys})
    return rows
