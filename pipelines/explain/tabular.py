"""The door for tables: a CSV file or a DataFrame in, columns of numbers out, and what was read.

Nothing is coerced in silence: encoding, separator, decimal commas and units in the header are
recognised and told, every cell that is no number is counted and named, and what can't be read in
one way only is refused.
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

__all__ = ["Sheet", "TableLike", "name_of", "numbers_of", "read_sheet"]

TableLike = Path | pd.DataFrame

LARGEST = 1 << 30
"""Bytes of a table: a day of film at 600 Hz is a tenth of that."""

MOST_READ = 2_000_000
"""Rows of a table that are kept; of a longer one, one in every few."""

CHUNK = 250_000
"""Rows that are read at a time."""

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}

HEAD = 1 << 18
"""Bytes from which encoding, header and separator are told."""

LOOKED_AT = 500
"""Lines whose fields are counted before anything is read."""

UNITS = {
    "s": {"ms": 1e-3, "us": 1e-6, "min": 60.0},
    "m": {"mm": 1e-3, "cm": 1e-2, "um": 1e-6, "km": 1e3},
    "rad": {"mrad": 1e-3, "deg": np.pi / 180.0},
    "deg": {"rad": 180.0 / np.pi},
    "m_s": {"mm_s": 1e-3, "cm_s": 1e-2, "km_h": 1.0 / 3.6},
}
"""Factors of the units that a header may have in place of the contract's."""

DECIMAL_COMMA = re.compile(r"[+-]?\d*(?:,\d+)?(?:[eE][+-]?\d+)?")
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""What may as well be a thousand."""

NAMED_CELLS = 3
"""Cells that a note names, of those that are no numbers."""


@dataclass(frozen=True)
class Sheet:
    """A table as it was read.

    Attributes
    ----------
    table : DataFrame
        Columns in the units of the contract; cells that may be numbers are as they were written.
    name : str
        What to call it in messages.
    notes : tuple of str
        What was recognised in reading it.
    """

    table: pd.DataFrame
    name: str
    notes: tuple[str, ...] = ()


def name_of(source: TableLike) -> str:
    """What to call the table in a message."""
    return source.name if isinstance(source, Path) else "the table"


def read_sheet(
    source: TableLike, units: Mapping[str, str], words: Sequence[str] = (), rows: int | None = None
) -> Sheet:
    """Read a table.

    Parameters
    ----------
    source : Path or DataFrame
    units : mapping
        Stem of each column of numbers → its unit in the contract: ``{"x": "m"}`` for ``x_m``.
    words : sequence of str
        Columns that are words, whatever they look like.
    rows : int, optional
        Read no more than so many.

    Returns
    -------
    Sheet

    Raises
    ------
    UsageError
        If the file can't be read, or has two columns of one name.
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
    """A column as floats, NaN where there is none; what is no number is noted.

    Parameters
    ----------
    table : DataFrame
    column : str
    what : str
        What to call the table.
    notes : list of str
        Takes what was left out.
    positive : bool
        Whether only numbers above zero make sense.

    Raises
    ------
    UsageError
        If most cells are no numbers, or may be read in two ways.
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
    _note(table, column, what, bad, "no numbers", notes)
    endless = np.isinf(found)
    _note(table, column, what, endless, "infinite", notes)
    found = np.where(endless, np.nan, found)
    if positive:
        low = written & (found <= 0.0)
        _refuse_exact(table, column, what, low, written)
        _note(table, column, what, low, "not above zero", notes)
        found = np.where(low, np.nan, found)
    return np.asarray(found, dtype=np.float64)


def _refuse_most(
    table: pd.DataFrame, column: str, what: str, bad: np.ndarray, written: np.ndarray
) -> None:
    if 2 * int(bad.sum()) <= int(written.sum()) or not bad.any():
        return
    first = int(np.flatnonzero(bad)[0])
    raise UsageError(
        f"{what}: the column {column} holds no numbers: row {first + 1} is"
        f" {_shown(table[column].iloc[first])}",
        hint="Numbers without units, with a point as decimal mark, are expected.",
    )


def _refuse_exact(
    table: pd.DataFrame, column: str, what: str, low: np.ndarray, written: np.ndarray
) -> None:
    """A column of noughts says that all is exact, which is another thing than not known."""
    if 2 * int(low.sum()) <= int(written.sum()) or not low.any():
        return
    first = int(np.flatnonzero(low)[0])
    raise UsageError(
        f"{what}: nothing is known exactly, but {int(low.sum())} of {int(written.sum())} numbers of"
        f" {column} are not above zero (row {first + 1}: {_shown(table[column].iloc[first])})",
        hint="Write a standard uncertainty, or leave the column away where none is known: the"
        " scatter of the table itself then says how far to trust it.",
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
        " they are left out"
    )


def _shown(cell: object) -> str:
    text = "".join(c if c.isprintable() else "?" for c in str(cell))
    return repr(text if len(text) <= 24 else text[:24] + "…")


def _without_commas(
    text: pd.Series, written: pd.Series, column: str, what: str, notes: list[str]
) -> pd.Series:
    """Cells with decimal commas as cells with points, if every cell that needs one has one."""
    held = text[written & text.str.contains(",", regex=False)]
    if held.empty or not held.map(DECIMAL_COMMA.fullmatch).notna().all():
        return text
    if text[written].str.contains(".", regex=False).any():
        return text  # points and commas: none of them is sure
    if held.map(GROUPED.fullmatch).notna().all():
        raise UsageError(
            f"{what}: {_shown(held.iloc[0])} in the column {column} may be a thousand or a decimal",
            hint="Write numbers with a point as decimal mark and without marks between thousands.",
        )
    notes.append(f"{what}: commas in the column {column} are taken as decimal marks")
    return text.str.replace(",", ".", regex=False)


def _in_units(table: pd.DataFrame, units: Mapping[str, str], notes: list[str]) -> pd.DataFrame:
    """Columns whose header names another unit than the contract's, converted and renamed."""
    for stem, unit in units.items():
        for suffix in ("", "_std"):
            wanted = f"{stem}_{unit}{suffix}"
            others = [
                (f"{stem}_{other}{suffix}", factor)
                for other, factor in UNITS.get(unit, {}).items()
                if f"{stem}_{other}{suffix}" in table.columns
            ]
            if not others:
                continue
            if wanted in table.columns or len(others) > 1:
                both = ", ".join([*([wanted] if wanted in table else []), *(n for n, _ in others)])
                raise UsageError(
                    f"the columns {both} say the same twice", hint="Leave one of them."
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
            f"can't read {path}: it is empty", hint="A CSV file with a header line is expected."
        )
    mark = _separator(lines[0])
    header = [name.strip() for name in _fields([lines[0]], mark)[0]]
    _refuse_doubles(header, path.name)
    _refuse_long_rows(path, lines[1 : LOOKED_AT + 1], header, mark)
    if mark != ",":
        notes.append(f"{path.name}: columns are parted by {SEPARATORS[mark]}")
    try:
        return _kept_rows(path, mark, encoding, words, notes, most)
    except (OSError, ValueError, OverflowError) as problem:  # what pandas raises is a ValueError
        said = " ".join(str(problem).split())
        raise UsageError(
            f"can't read {path}: {said}", hint="A CSV file with a header line is expected."
        ) from problem


def _kept_rows(
    path: Path, mark: str, encoding: str, words: Sequence[str], notes: list[str], most: int | None
) -> pd.DataFrame:
    """Rows of the file, or of a long one, one in every few: read piece by piece."""
    every = 1 if most is not None else -(-_lines(path) // MOST_READ) or 1
    if every > 1:
        notes.append(f"{path.name}: of more than {MOST_READ} rows one in {every} is read")
    reader = pd.read_csv(
        path,
        sep=mark,
        encoding=encoding,
        encoding_errors="replace",
        dtype=dict.fromkeys(words, str),
        skipinitialspace=True,
        index_col=False,
        chunksize=CHUNK,
        nrows=most,
        low_memory=False,
    )
    with reader:
        parts = [
            part.iloc[-(number * CHUNK) % every :: every] for number, part in enumerate(reader)
        ]
    table = pd.concat(parts, ignore_index=True)
    table.columns = [str(column).strip() for column in table.columns]
    return table


def _lines(path: Path) -> int:
    with path.open("rb") as file:
        return sum(piece.count(b"\n") for piece in iter(lambda: file.read(1 << 22), b""))


def _head(path: Path) -> tuple[str, str]:
    """The first lines of a regular file of bearable size, and the encoding that wrote it."""
    try:
        if not path.exists():
            raise UsageError(f"can't read {path}: there is no such file", hint="Check its path.")
        if not path.is_file():
            raise UsageError(
                f"can't read {path}: it is no regular file",
                hint="Name a CSV file; a pipe or a device may never end.",
            )
        if path.stat().st_size > LARGEST:
            raise UsageError(
                f"can't read {path}: it has {path.stat().st_size / 1e9:.3g} GB, more than a table"
                f" of samples may have ({LARGEST / 1e9:.3g} GB)",
                hint="Cut it into experiments, or write every n-th row.",
            )
        with path.open("rb") as file:
            raw = file.read(HEAD)
    except (OSError, ValueError) as problem:
        raise UsageError(f"can't read {path}: {problem}", hint="Check its path.") from problem
    encoding = _encoding(raw)
    try:
        # a cut within a character is no fault of the file
        text = codecs.getincrementaldecoder(encoding)().decode(raw)
    except UnicodeDecodeError:
        encoding = "cp1252"
        text = raw.decode(encoding, errors="replace")
    if "\x00" in text or not all(c.isprintable() or c in "\r\n\t" for c in text[:2000]):
        raise UsageError(
            f"can't read {path}: it is no text", hint="A CSV file with a header line is expected."
        )
    return text, encoding


def _encoding(raw: bytes) -> str:
    """Encoding by the byte-order mark, or by every second byte of plain text being zero."""
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
    """The mark that parts most columns of the header."""
    counts = {mark: len(_fields([header], mark)[0]) for mark in SEPARATORS}
    return max(counts, key=lambda mark: counts[mark])


def _fields(lines: Iterable[str], mark: str) -> list[list[str]]:
    """Fields of each line; one empty field for what is no line of a table at all."""
    try:
        return list(csv.reader(lines, delimiter=mark)) or [[""]]
    except csv.Error:
        return [[""]]


def _refuse_doubles(names: Sequence[str], what: str) -> None:
    again = sorted({name for name in names if name and list(names).count(name) > 1})
    if again:
        raise UsageError(
            f"{what} has two columns called {again[0]}", hint="Leave one of them, or rename it."
        )


def _refuse_long_rows(path: Path, lines: Iterable[str], header: Sequence[str], mark: str) -> None:
    """Refuse rows with more fields than the header, which would shift one into the next."""
    for number, fields in enumerate(_fields(lines, mark), 1):
        while len(fields) > len(header) and not fields[-1].strip():
            fields = fields[:-1]
        if len(fields) > len(header):
            hint = "Are there decimal commas? Write decimal points, or part columns by semicolons."
            raise UsageError(
                f"can't read {path}: row {number} has {len(fields)} fields, the header names"
                f" {len(header)} columns",
                hint=hint if mark == "," else "Write one field for each column of the header.",
            )
