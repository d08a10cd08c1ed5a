"""Read CSV files and DataFrames as columns of numbers; report their format.

Encoding, separator, decimal commas and units in the header are recognised and reported. Cells that
are not numbers are counted and named; ambiguous input is refused.
"""

import codecs
import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from metrology import UsageError
from physics.domain import FloatArray
from pipelines.interop.sheets import refuse_sideways

__all__ = ["NoTableError", "Sheet", "TableLike", "name_of", "numbers_of", "read_sheet"]

TableLike = Path | pd.DataFrame

MAX_TABLE_BYTES = 1 << 30
"""Bytes: ten days of samples at 600 Hz."""

MAX_TABLE_ROWS = 2_000_000
"""Rows kept of a table; of a longer one every n-th row is read (chosen)."""

CHUNK_ROWS = 250_000
"""Rows read at a time (chosen)."""

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}

HEAD_BYTES = 1 << 18
"""Bytes from which encoding, header and separator are determined (chosen)."""

CHECKED_LINES = 500
"""Lines whose fields are counted before reading (chosen)."""

UNIT_FACTORS = {
    "s": {"ms": 1e-3, "us": 1e-6, "min": 60.0},
    "m": {"mm": 1e-3, "cm": 1e-2, "um": 1e-6, "km": 1e3},
    "rad": {"mrad": 1e-3, "deg": np.pi / 180.0},
    "deg": {"rad": 180.0 / np.pi},
    "m_s": {"mm_s": 1e-3, "cm_s": 1e-2, "km_h": 1.0 / 3.6},
}
"""Factors of units accepted in a header instead of the contract's."""

COMMA_NUMBER = re.compile(r"[+-]?\d*(?:,\d+)?(?:[eE][+-]?\d+)?")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""Pattern that may also be a thousands separator."""

NAMED_CELLS = 3
"""Cells without a number listed in a note (chosen)."""


class NoTableError(UsageError):
    """A file that no reader can take for a table: it is not text, or its columns are ambiguous."""


@dataclass(frozen=True)
class Sheet:
    """A table as read.

    Attributes
    ----------
    table : DataFrame
        Columns in the units of the contract; cells of numeric columns are not parsed yet.
    name : str
        Its name in messages.
    notes : tuple of str
        Format recognised on reading.
    """

    table: pd.DataFrame
    name: str
    notes: tuple[str, ...] = ()


def name_of(source: TableLike) -> str:
    """Name of the table in messages."""
    return source.name if isinstance(source, Path) else "the table"


def read_sheet(
    source: TableLike, units: Mapping[str, str], words: Sequence[str] = (), rows: int | None = None
) -> Sheet:
    """Read a table.

    Parameters
    ----------
    units : mapping
        Stem of each column of numbers → its unit in the contract: ``{"x": "m"}`` for ``x_m``.
    words : sequence of str
        Columns that are always words.
    rows : int, optional
        Maximum number of rows to read.

    Raises
    ------
    UsageError
        If the file can't be read, or has two columns of the same name.
    """
    notes: list[str] = []
    if isinstance(source, Path):
        table = _read(source, words, notes, rows)
    else:
        table = source.copy()
        table.columns = [str(name).strip() for name in table.columns]
        _refuse_doubles(list(table.columns), "the table")
    for name in words:
        if name in table:
            known = table[name].notna()
            table[name] = table[name].astype(object).where(~known, table[name].astype(str))
    return Sheet(_in_units(table, units, notes), name_of(source), tuple(notes))


def numbers_of(
    table: pd.DataFrame, column: str, what: str, notes: list[str], *, positive: bool = False
) -> FloatArray:
    """A column as floats, NaN where empty; cells that are not numbers are noted.

    Parameters
    ----------
    what : str
        Name of the table.
    notes : list of str
        Receives the notes.
    positive : bool
        Whether only positive numbers are valid.

    Raises
    ------
    UsageError
        If most cells are not numbers, or the column is ambiguous.
    """
    cells = table[column]
    words = cells.notna()
    if cells.dtype == object or pd.api.types.is_string_dtype(cells.dtype):
        text = cells.where(words, "").astype(str).str.strip()
        words = text != ""
        cells = _without_commas(text, words, column, what, notes)
    found = np.asarray(pd.to_numeric(cells, errors="coerce"), dtype=np.float64)
    written = words.to_numpy(dtype=bool)
    bad = written & np.isnan(found)
    _refuse_most(table, column, what, bad, written)
    _note(table, column, what, bad, "not numbers", notes)
    endless = np.isinf(found)
    _note(table, column, what, endless, "infinite", notes)
    found = np.where(endless, np.nan, found)
    if positive:
        low = written & (found <= 0.0)
        _refuse_exact(table, column, what, low, written)
        _note(table, column, what, low, "not positive", notes)
        found = np.where(low, np.nan, found)
    return np.asarray(found, dtype=np.float64)


def _refuse_most(
    table: pd.DataFrame, column: str, what: str, bad: np.ndarray, written: np.ndarray
) -> None:
    if 2 * int(bad.sum()) <= int(written.sum()) or not bad.any():
        return
    first = int(np.flatnonzero(bad)[0])
    raise UsageError(
        f"{what}: the column {column} contains no numbers: row {first + 1} is"
        f" {_shown(table[column].iloc[first])}",
        hint="Write numbers without units, with a decimal point.",
    )


def _refuse_exact(
    table: pd.DataFrame, column: str, what: str, low: np.ndarray, written: np.ndarray
) -> None:
    """Refuse a column of zero uncertainties, which means exact rather than unknown."""
    if 2 * int(low.sum()) <= int(written.sum()) or not low.any():
        return
    first = int(np.flatnonzero(low)[0])
    raise UsageError(
        f"{what}: no measurement is exact, but {int(low.sum())} of {int(written.sum())} numbers of"
        f" {column} are not positive (row {first + 1}: {_shown(table[column].iloc[first])})",
        hint="Write standard uncertainties, or omit the column if they are unknown: they are then"
        " estimated from the residuals.",
    )


def _note(
    table: pd.DataFrame, column: str, what: str, bad: np.ndarray, why: str, notes: list[str]
) -> None:
    rows = np.flatnonzero(bad)
    if not rows.size:
        return
    shown = ", ".join(f"row {k + 1}: {_shown(table[column].iloc[k])}" for k in rows[:NAMED_CELLS])
    more = ", …" if rows.size > NAMED_CELLS else ""
    notes.append(
        f"{what}: {rows.size} of {len(table)} cells of {column} are {why} ({shown}{more});"
        " they are ignored"
    )


def _shown(cell: object) -> str:
    text = "".join(c if c.isprintable() else "?" for c in str(cell))
    return repr(text if len(text) <= 24 else text[:24] + "…")


def _without_commas(
    text: pd.Series, written: pd.Series, column: str, what: str, notes: list[str]
) -> pd.Series:
    """Convert decimal commas to points, if every number with a mark has a comma."""
    held = text[written & text.str.contains(",", regex=False)]
    if held.empty or not held.map(COMMA_NUMBER.fullmatch).notna().all():
        return text
    if text[written].str.contains(".", regex=False).any():
        return text  # both points and commas: ambiguous
    if held.map(THOUSANDS.fullmatch).notna().all():
        raise UsageError(
            f"{what}: {_shown(held.iloc[0])} in the column {column} may be a thousand or a decimal",
            hint="Write numbers with a decimal point and without thousands separators.",
        )
    notes.append(f"{what}: commas in the column {column} are read as decimal commas")
    return text.str.replace(",", ".", regex=False)


def _in_units(table: pd.DataFrame, units: Mapping[str, str], notes: list[str]) -> pd.DataFrame:
    """Convert and rename columns whose header has another unit than the contract's."""
    for stem, unit in units.items():
        for suffix in ("", "_std"):
            wanted = f"{stem}_{unit}{suffix}"
            others = [
                (f"{stem}_{other}{suffix}", factor)
                for other, factor in UNIT_FACTORS.get(unit, {}).items()
                if f"{stem}_{other}{suffix}" in table.columns
            ]
            if not others:
                continue
            if wanted in table.columns or len(others) > 1:
                both = ", ".join([*([wanted] if wanted in table else []), *(n for n, _ in others)])
                raise UsageError(
                    f"the columns {both} are the same quantity", hint="Remove one of them."
                )
            name, factor = others[0]
            said: list[str] = []
            values = numbers_of(table, name, "the table", said) * factor
            notes += said
            notes.append(f"the column {name} is converted to {wanted}")
            table = table.drop(columns=name).assign(**{wanted: values})
    return table


def _read(path: Path, words: Sequence[str], notes: list[str], most: int | None) -> pd.DataFrame:
    head, encoding = _head(path)
    if encoding not in ("utf-8", "utf-8-sig"):
        notes.append(f"{path.name}: read as {encoding}")
    lines = head.lstrip("\r\n").splitlines()
    if not lines or not lines[0].strip():
        raise UsageError(
            f"can't read {path}: it is empty", hint="Pass a CSV file with a header line."
        )
    mark = _separator(lines[0])
    refuse_sideways(path, lines[0].count(mark) + 1)
    header = [name.strip() for name in _fields([lines[0]], mark)[0]]
    _refuse_doubles(header, path.name)
    _refuse_open_quotes(path)
    _refuse_long_rows(path, lines[1 : CHECKED_LINES + 1], header, mark)
    if mark != ",":
        notes.append(f"{path.name}: columns are separated by {SEPARATORS[mark]}")
    try:
        return _kept_rows(path, mark, encoding, words, notes, most)
    except (OSError, ValueError, OverflowError) as problem:  # what pandas raises is a ValueError
        said = " ".join(str(problem).split())
        raise UsageError(
            f"can't read {path}: {said}", hint="Pass a CSV file with a header line."
        ) from problem


def _kept_rows(
    path: Path, mark: str, encoding: str, words: Sequence[str], notes: list[str], most: int | None
) -> pd.DataFrame:
    """Rows of the file, or every n-th row of a long one, read in chunks."""
    every = 1 if most is not None else -(-_lines(path) // MAX_TABLE_ROWS) or 1
    if every > 1:
        notes.append(f"{path.name}: of more than {MAX_TABLE_ROWS} rows one in {every} is read")
    reader = pd.read_csv(
        path,
        sep=mark,
        encoding=encoding,
        encoding_errors="replace",
        dtype=dict.fromkeys(words, str),
        skipinitialspace=True,
        index_col=False,
        chunksize=CHUNK_ROWS,
        nrows=most,
        low_memory=False,
    )
    with reader:
        parts = [
            part.iloc[-(number * CHUNK_ROWS) % every :: every] for number, part in enumerate(reader)
        ]
    table = pd.concat(parts, ignore_index=True)
    table.columns = [str(column).strip() for column in table.columns]
    return table


def _lines(path: Path) -> int:
    with path.open("rb") as file:
        return sum(piece.count(b"\n") for piece in iter(lambda: file.read(1 << 22), b""))


def _head(path: Path) -> tuple[str, str]:
    """The first lines of a regular file of acceptable size, and its encoding."""
    try:
        if not path.exists():
            raise UsageError(f"can't read {path}: no such file", hint="Check the path.")
        if not path.is_file():
            raise UsageError(
                f"can't read {path}: not a regular file",
                hint="Pass a CSV file rather than a pipe or device.",
            )
        if path.stat().st_size > MAX_TABLE_BYTES:
            raise UsageError(
                f"can't read {path}: it has {path.stat().st_size / 1e9:.3g} GB; the limit is"
                f" {MAX_TABLE_BYTES / 1e9:.3g} GB",
                hint="Split it into experiments, or write every n-th row.",
            )
        with path.open("rb") as file:
            raw = file.read(HEAD_BYTES)
    except (OSError, ValueError) as problem:
        raise UsageError(f"can't read {path}: {problem}", hint="Check the path.") from problem
    encoding = _encoding(raw)
    try:
        # a cut within a multi-byte character is not an error of the file
        text = codecs.getincrementaldecoder(encoding)().decode(raw)
    except UnicodeDecodeError:
        encoding = "cp1252"
        text = raw.decode(encoding, errors="replace")
    if "\x00" in text or not all(c.isprintable() or c in "\r\n\t" for c in text[:2000]):
        raise NoTableError(
            f"can't read {path}: it is not text", hint="Pass a CSV file with a header line."
        )
    return text, encoding


def _encoding(raw: bytes) -> str:
    """Encoding from the byte-order mark, or from zeros in every second byte of plain text."""
    for mark, name in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF32_LE, "utf-32"),
        (codecs.BOM_UTF32_BE, "utf-32"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if raw.startswith(mark):
            return name
    start = np.frombuffer(raw[:512], dtype=np.uint8)
    for offset, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        half = start[offset::2]
        if half.size > 8 and (half == 0).mean() > 0.9 and (start[1 - offset :: 2] > 0).all():
            return name
    return "utf-8"


def _separator(header: str) -> str:
    """The mark that separates most columns of the header."""
    counts = {mark: len(_fields([header], mark)[0]) for mark in SEPARATORS}
    return max(counts, key=lambda mark: counts[mark])


def _fields(lines: Iterable[str], mark: str) -> list[list[str]]:
    """Fields of each line; one empty field for a line that is not part of a table."""
    try:
        return list(csv.reader(lines, delimiter=mark)) or [[""]]
    except csv.Error:
        return [[""]]


def _refuse_open_quotes(path: Path) -> None:
    """Refuse a quote that is not closed in its line: it would swallow the lines that follow."""
    with path.open("rb") as file:
        for number, line in enumerate(file, start=1):
            if line.count(b'"') % 2:
                raise UsageError(
                    f"can't read {path}: the quotation mark in line {number} is not closed, and"
                    " would join the lines that follow into one cell",
                    hint='Remove the quotation mark (") in that line, or close it there.',
                )


def _refuse_doubles(names: Sequence[str], what: str) -> None:
    again = sorted({name for name in names if name and list(names).count(name) > 1})
    if again:
        raise NoTableError(
            f"{what} has two columns called {again[0]}", hint="Remove or rename one of them."
        )


def _refuse_long_rows(path: Path, lines: Iterable[str], header: Sequence[str], mark: str) -> None:
    """Refuse rows with more fields than the header, which would shift columns."""
    for number, fields in enumerate(_fields(lines, mark), 1):
        while len(fields) > len(header) and not fields[-1].strip():
            fields = fields[:-1]
        if len(fields) > len(header):
            hint = "If it uses decimal commas, write decimal points, or separate columns by ;."
            raise UsageError(
                f"can't read {path}: row {number} has {len(fields)} fields, the header"
                f" {len(header)} columns",
                hint=hint if mark == "," else "Write one field per column of the header.",
            )
