"""What the paper prints: Tables 2 to 10, digit by digit (the number of digits matters).

One cell of the audit: print, ours, difference, verdict and why.
"""

from dataclasses import asdict, dataclass
from typing import Literal, TypeAlias

__all__ = [
    "BACKSWINGS_DEG",
    "TABLE_5",
    "TABLE_5_PERCENT",
    "TABLE_6",
    "TABLE_7",
    "TABLE_8",
    "TABLE_9",
    "TABLE_10",
    "TABLE_10_PERCENT",
    "WANTED_DISTANCES",
    "WANTED_IMPULSES",
    "Cell",
    "Verdict",
    "as_rows",
    "half_digit",
    "judged",
]

BACKSWINGS_DEG = (30, 60, 90, 120)

"""deg: the settings of Tables 5 to 8."""

TABLE_5 = {
    "jokku": {
        "variable": ("0.5148", "1.198", "1.808", "2.341"),
        "constant": ("0.5234", "1.236", "1.881", "2.481"),
        "experiment": ("0.5181", "1.1893", "1.7932", "2.3603"),
    },
    "basketball": {
        "variable": ("0.5701", "1.339", "2.063", "2.732"),
        "constant": ("0.5764", "1.375", "2.139", "2.861"),
        "experiment": ("0.5688", "1.3354", "2.0716", "2.7500"),
    },
}

TABLE_5_PERCENT = {
    "jokku": {
        "variable": ("-0.6409", "0.7348", "0.8235", "-0.8196"),
        "constant": ("1.0189", "3.9300", "4.8943", "5.1118"),
    },
    "basketball": {
        "variable": ("0.2219", "0.2731", "-0.4149", "-0.6555"),
        "constant": ("1.3294", "2.9690", "3.2538", "4.0353"),
    },
}

TABLE_6 = {
    "jokku": {
        "variable": ("0.6510", "1.3197", "1.8267", "2.2155"),
        "constant": ("0.6614", "1.3574", "1.8926", "2.3059"),
    },
    "basketball": {
        "variable": ("1.0771", "2.2774", "3.1908", "3.8927"),
        "constant": ("1.0896", "2.3280", "3.2826", "4.0213"),
    },
}

WANTED_IMPULSES = {"jokku": (1.0, 1.4, 1.8, 2.2), "basketball": (1.5, 2.5, 3.5, 3.8)}

"""N s: the columns of Table 7."""

TABLE_7 = {
    "jokku": {
        "variable": ("1.740", "2.449", "3.166", "3.888"),
        "constant": ("1.698", "2.378", "3.057", "3.736"),
    },
    "basketball": {
        "variable": ("1.451", "2.436", "3.432", "3.732"),
        "constant": ("1.427", "2.370", "3.329", "3.614"),
    },
}

TABLE_8 = {
    "jokku": {
        "variable": ("45.78", "64.73", "88.58", "118.95"),
        "constant": ("44.73", "62.35", "84.94", "112.47"),
    },
    "basketball": {
        "variable": ("40.76", "67.31", "103.38", "116.19"),
        "constant": ("40.14", "65.39", "99.00", "111.17"),
    },
}

WANTED_DISTANCES = {
    "jokku": (1.0, 1.4, 1.8, 2.2, 2.5),
    "basketball": (1.0, 1.4, 1.8, 2.2, 2.8),
}

"""m: the columns of Table 9."""

TABLE_9 = {
    "jokku": ("52.64", "69.16", "89.36", "111.62", "129.81"),
    "basketball": ("49.01", "65.05", "81.88", "99.61", "128.90"),
}

TABLE_10 = {
    "jokku": ("1.0024", "1.4055", "1.8068", "2.2082", "2.5183"),
    "basketball": ("1.0029", "1.4067", "1.8076", "2.2096", "2.8178"),
}

TABLE_10_PERCENT = {
    "jokku": ("0.2432", "0.3569", "0.3765", "0.3704", "0.7319"),
    "basketball": ("0.2852", "0.4765", "0.4247", "0.4376", "0.6362"),
}

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
