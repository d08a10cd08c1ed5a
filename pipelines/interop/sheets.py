"""Read any text or spreadsheet as a table with a header and numbers.

Encoding, separator, decimal marks, lines above the header and units below it are recognised.
"""

import csv
import io
import re
import warnings
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pandas as pd

from metrology import UsageError
from pipelines.interop.external import read_bytes
from pipelines.interop.headers import (
    HEADER_LINES,
    find_header,
    has_numbers,
    is_unit_row,
    is_value,
    positions_of,
)

__all__ = [
    "frame_of",
    "read_table",
    "refuse_sideways",
    "separator_of",
    "sheet_of",
    "text_lines",
    "text_of",
    "with_numbers",
]

MAX_COLUMNS = 2000
"""Columns of a table; more are a matrix, or a table written sideways. Chosen: the widest sheets of
motion capture have some hundreds."""

_BLANKS = r"\s+(?![(\[])"
"""Blanks between columns; a unit in brackets belongs to the name before it."""


def text_of(data: bytes) -> str:
    """Text of unknown encoding: UTF-8, UTF-16 with or without a byte order mark, or Latin-1."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace")
    for first, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        # of text in Latin letters every second byte is zero
        if data[first::2].count(0) > _MIN_WIDE * len(data[first::2]):
            return data.decode(name, errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


_MIN_WIDE = 0.9
"""Fraction of zeros among every second byte of UTF-16 (chosen: names may have other letters)."""


def text_lines(path: Path, what: str) -> list[str]:
    """Lines of a text that are not blank, without a spreadsheet's line ``sep=;``.

    Raises
    ------
    UsageError
        If it can't be read, or is empty.
    """
    data = read_bytes(path, what)
    kind = next((kind for mark, kind in _NO_TEXT.items() if data.startswith(mark)), None)
    if kind is not None:
        raise UsageError(
            f"can't read {path}: it holds {kind}, whatever its name says",
            hint="Export a table as CSV: a header line and one row per mark or trial.",
        )
    text = text_of(data)
    lines = [line for line in text.splitlines() if line.strip()]
    if lines and re.fullmatch(r"\"?sep=.\"?", lines[0].strip(), re.IGNORECASE):
        lines = lines[1:]
    if not lines:
        raise UsageError(
            f"{path} is empty",
            hint="Export it again: a header line and one row per mark or trial.",
        )
    return lines


_NO_TEXT = {
    b"%PDF": "a PDF",
    b"\x89PNG": "a picture",
    b"\xff\xd8\xff": "a picture",
    b"PK\x03\x04": "an archive or a spreadsheet",
    b"\xd0\xcf\x11\xe0": "an old or locked spreadsheet",
    b"\x1f\x8b": "a compressed file",
    b"\x89HDF": "HDF5",
}
"""Contents by the first bytes of files (convention: their formats)."""


def read_table(path: Path, what: str, notes: list[str] | None = None) -> pd.DataFrame:
    """Read any table with a header line: text with any separator and decimals, or XLSX.

    Parameters
    ----------
    path : Path
    what : str
        Kind of table, for messages.
    notes : list of str, optional
        Receives what was not as usual.

    Raises
    ------
    UsageError
        If it can't be read, is empty, or a quote swallows lines.
    """
    if path.suffix.lower() == ".xlsx":
        return sheet_of(path)
    return frame_of(text_lines(path, what), path, notes=notes)


def frame_of(
    lines: Sequence[str],
    path: Path,
    bare: Sequence[Sequence[str]] = (),
    notes: list[str] | None = None,
) -> pd.DataFrame:
    """A table from the lines of a text.

    Parameters
    ----------
    lines : sequence of str
        Without blank ones.
    path : Path
        For messages.
    bare : sequence of sequences of str
        Names of the columns of tables without a header, by their number.
    notes : list of str, optional
        Receives what was not as usual.

    Raises
    ------
    UsageError
        If there is no header, or the rows do not fit it.
    """
    notes = [] if notes is None else notes
    at = next((k for k, line in enumerate(lines) if not line.startswith(("#", "%", "//"))), 0)
    if at > 0 and not re.search(r"[A-Za-z]", lines[at]):
        # the header itself is a comment, as in numpy.savetxt
        at -= 1
        lines = [*lines[:at], lines[at].lstrip("#%/ "), *lines[at + 1 :]]
    searched = lines[at : at + HEADER_LINES]
    # not that of a title above the header
    mark = separator_of(next((one for one in searched[:-1] if _is_split(one)), searched[0]))
    first = [_cells(line, mark) for line in searched]
    refuse_sideways(path, max(map(len, first)))
    above = find_header(first)
    mark = separator_of(lines[at + above])
    rows: Sequence[str] = lines[at + above + 1 :]
    header = _heads([_cells(line, mark) for line in searched[: above + 1]])
    if header and all(is_value(cell) for cell in header if cell):
        header, rows = _named(header, bare, path, notes), [lines[at + above], *rows]
    if mark == ",":
        rows = _joined_decimals(rows, len(header), path, notes)
    return with_numbers(_parsed(header, rows, mark, path, len(lines) - len(rows)))


def _is_split(line: str) -> bool:
    return any(mark in line for mark in "\t;,")


def _cells(line: str, mark: str) -> list[str]:
    if len(mark) > 1:
        return re.split(mark, line.strip())
    try:
        return next(csv.reader([line.strip("\r\n")], delimiter=mark, skipinitialspace=True), [])
    except csv.Error:
        return line.split(mark)


def _heads(above: Sequence[Sequence[str]]) -> list[str]:
    """Names of the columns from all lines above the numbers: names, units, and objects above."""
    *over, names = [[cell.strip() for cell in row] for row in above]
    units: list[str] = []
    if over and is_unit_row(names):
        units, names = [cell.strip("()[] ") for cell in names], over.pop()
    if len(set(names)) < len(names) or "" in names[:-1]:
        named = [
            joined for row in over[: -_MAX_NAME_LINES - 1 : -1] if (joined := _below(row, names))
        ]
        # names rather than the serial numbers of markers
        names = min(named, key=lambda one: sum(map(str.isdigit, "".join(one))), default=names)
    pairs = zip_longest(names, units, fillvalue="")
    return [f"{name} ({unit})" if unit else name for name, unit in pairs]


def _below(objects: Sequence[str], axes: Sequence[str]) -> list[str]:
    """Axes with the object's name, which stands above the first of its columns, or above each.

    Empty unless these are positions.
    """
    spread = list(objects)
    for at in range(1, len(spread)):
        spread[at] = spread[at] or spread[at - 1]
    joined = [" ".join(filter(None, pair)) for pair in zip_longest(spread, axes, fillvalue="")]
    return joined if len(objects) <= len(axes) and positions_of(joined) else []


_MAX_NAME_LINES = 4
"""Lines of objects above the names of the axes (convention: OptiTrack writes type, name and id)."""


def _named(
    header: Sequence[str], bare: Sequence[Sequence[str]], path: Path, notes: list[str]
) -> list[str]:
    """Names of the columns of a table without a header.

    Raises
    ------
    UsageError
        If they are unknown.
    """
    for names in bare:
        if len(header) == len(names):
            listed = ", ".join(names)
            notes.append(f"{path.name} has no header; its columns are read as {listed}.")
            return list(names)
    raise UsageError(
        f"{path.name} has no header: its first line holds numbers ({', '.join(header[:4])})",
        hint="Write the names of the columns into a first line, such as t (s),x (m),y (m).",
    )


def _joined_decimals(
    rows: Sequence[str], count: int, path: Path, notes: list[str]
) -> Sequence[str]:
    """Rows with twice the cells of the header, whose decimal commas split every number.

    Raises
    ------
    UsageError
        If commas separate columns and decimals in some rows.
    """
    cells = [_cells(row, ",") for row in rows]
    widths = np.array([len(row) for row in cells])
    if not len(rows) or '"' in rows[0] or not np.mean(widths > count) > _MIN_SPLIT_ROWS:
        return rows
    digits = all(re.fullmatch(r"\d+", cell.strip()) for row in cells for cell in row[1::2])
    if np.all(widths == 2 * count) and digits:
        notes.append(f"{path.name}: commas separate columns and decimals; they are distinguished.")
        return [
            ",".join(f"{a}.{b}" for a, b in zip(row[::2], row[1::2], strict=True)) for row in cells
        ]
    worst = int(np.argmax(widths))
    raise UsageError(
        f"{path}: row {worst + 1} has {widths[worst]} cells, the header {count}: commas separate"
        " the columns and seem to be decimal commas, too",
        hint="Export it with decimal points, or with semicolons between the columns.",
    )


_MIN_SPLIT_ROWS = 0.5
"""Fraction of rows longer than the header that are no slips (chosen)."""


def _parsed(
    header: Sequence[str], rows: Sequence[str], mark: str, path: Path, above: int
) -> pd.DataFrame:
    """Cells as text or numbers; `above` counts the lines above the rows."""
    if len(mark) > 1:
        rows, mark = ["\t".join(_cells(row, mark)) for row in rows], "\t"
    text = io.StringIO()
    csv.writer(text, delimiter=mark, lineterminator="\n").writerow(header)
    text.write("\n".join(rows))
    text.seek(0)
    try:
        with warnings.catch_warnings():
            # rows longer than the header: pandas would drop the surplus cells
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table = pd.read_csv(
                text, sep=mark, skipinitialspace=True, engine="python", index_col=False
            )
    except pd.errors.ParserWarning as problem:
        raise UsageError(
            f"{path} has rows with more cells than its header names ({len(header)}, in line"
            f" {above}): {mark.join(header)[:80]}",
            hint="Write a name above every column, such as t (s),ball x (m),ball y (m).",
        ) from problem
    except (ValueError, pd.errors.ParserError) as problem:
        raise UsageError(
            f"{path} is not a table: {problem}{_quote_text(rows, above)}",
            hint="Write a header line and one row per mark.",
        ) from problem
    if len(table) != len(rows):
        raise UsageError(
            f"{path}: {len(rows)} lines follow the header, but they hold {len(table)}"
            f" rows{_quote_text(rows, above)}",
            hint="Remove the stray quotation mark, or the line break within a cell: it joins lines"
            " into one cell.",
        )
    table.columns = pd.Index([str(name).strip() for name in table.columns])
    return table


def _quote_text(rows: Sequence[str], above: int) -> str:
    """Line in which a quotation mark is not closed, for a message."""
    first = next((k for k, row in enumerate(rows, start=1) if row.count('"') % 2), None)
    return "" if first is None else f"; the quotation mark in line {above + first} is not closed"


def refuse_sideways(path: Path, columns: int) -> None:
    """Refuse a table with more columns than any table of trials or samples has."""
    if columns > MAX_COLUMNS:
        raise UsageError(
            f"can't read {path}: its first line has more than {MAX_COLUMNS} columns",
            hint="Write one row per sample or trial; a table that runs sideways has to be turned.",
        )


def sheet_of(path: Path, notes: list[str] | None = None) -> pd.DataFrame:
    """The first sheet of a spreadsheet that holds rows of numbers; else its first.

    Parameters
    ----------
    path : Path
    notes : list of str, optional
        Receives which sheet is read, if it is not the first of several with numbers.

    Raises
    ------
    UsageError
        If it can't be read.
    """
    if not read_bytes(path, "a spreadsheet").startswith(b"PK"):
        # a text under the name of a spreadsheet
        return frame_of(text_lines(path, "a spreadsheet"), path, notes=notes)
    try:
        book = pd.read_excel(path, sheet_name=None, header=None, dtype=object)
        sheets = {name: sheet.dropna(how="all") for name, sheet in book.items()}
    # openpyxl raises many types on damaged files
    except Exception as problem:
        raise UsageError(
            f"{path} is not a spreadsheet: {problem}", hint="Save it again as .xlsx or .csv."
        ) from problem
    filled = [name for name, sheet in sheets.items() if has_numbers(_head_of(sheet))]
    if not filled:
        _refuse_formulas(path)
    chosen = (filled or list(sheets))[0]
    if notes is not None and (filled[1:] or chosen != next(iter(sheets))):
        others = ", ".join(repr(name) for name in sheets if name != chosen)
        notes.append(f"{path.name}: the sheet {chosen!r} is read, not {others}.")
    table = sheets[chosen]
    cells = _head_of(table)
    at = find_header(cells)
    if table.empty:
        return table
    names = _heads(cells[: at + 1])
    table = table.iloc[at + 1 :].reset_index(drop=True)
    table.columns = pd.Index([name or f"Unnamed: {k}" for k, name in enumerate(names)])
    return with_numbers(table.infer_objects())


def _refuse_formulas(path: Path) -> None:
    """Refuse a spreadsheet of formulas whose results are not stored.

    Raises
    ------
    UsageError
    """
    from openpyxl import load_workbook  # type: ignore[import-untyped]

    for sheet in load_workbook(path, read_only=True):
        for row in sheet.iter_rows(max_row=HEADER_LINES):
            formula = next((cell for cell in row if cell.data_type == "f"), None)
            if formula is not None:
                raise UsageError(
                    f"{path}: the cell {formula.coordinate} of {sheet.title!r} holds a formula"
                    " without its result",
                    hint="Open it in the spreadsheet program and save it there: that stores the"
                    " results. Or save it as .csv.",
                )


def _head_of(table: pd.DataFrame) -> list[list[str]]:
    head = table.head(HEADER_LINES).map(lambda cell: "" if pd.isna(cell) else str(cell))
    return list(head.to_numpy().tolist())


def separator_of(line: str) -> str:
    """Separator of a header: tab, semicolon or comma; blanks without any."""
    return next((mark for mark in ("\t", ";", ",") if mark in line), _BLANKS)


_TYPED_MARKS = str.maketrans({"\u2212": "-", "\u2013": "-", "\u00a0": "", "\u202f": "", "'": ""})
"""Minus signs and separators of thousands as typeset."""


def with_numbers(table: pd.DataFrame) -> pd.DataFrame:
    """Convert columns of numbers with a decimal comma, marks of thousands or a long minus."""
    for name in table.columns:
        if pd.api.types.is_numeric_dtype(table[name]):
            continue
        words = table[name].astype("string").str.strip().str.translate(_TYPED_MARKS)
        comma, point = words.str.rfind(","), words.str.rfind(".")
        if bool(((comma > point) & (point >= 0)).any()):
            words = words.str.replace(".", "", regex=False)
        elif bool(((point > comma) & (comma >= 0)).any()):
            words = words.str.replace(",", "", regex=False)
        words = words.str.replace(",", ".", regex=False)
        # Fortran writes 1.5D-03
        words = words.str.replace(r"(?<=\d)[dD](?=[-+]?\d+$)", "e", regex=True)
        number = pd.to_numeric(words, errors="coerce")
        if number.notna().any() and number.notna().sum() >= words.notna().sum():
            table[name] = number.astype(float)
    return table
