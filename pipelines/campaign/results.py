"""The lab book of a campaign, and its results as one table with a row per clip."""

import csv
import io
import itertools
import math
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from measuring.inputs import QUANTITY_UNITS, main_quantities
from metrology import UsageError, parse_quantity, write_text_whole
from metrology.files import printable, written_whole
from metrology.measurands import folded
from pipelines.campaign.files import clip_key
from pipelines.campaign.ledger import Entry, State
from pipelines.interop.sheets import refuse_sideways
from pipelines.measure.files import column_name, without_formulas
from vision.tracks import MotionKind

__all__ = [
    "ANALYSED",
    "CLIP_COLUMN",
    "SENSORS",
    "ClipResult",
    "LabBook",
    "LabBookRow",
    "Matched",
    "Recording",
    "SensorColumn",
    "clip_results",
    "match_clips",
    "not_counted",
    "parquet_is_written",
    "read_lab_book",
    "recordings",
    "results_frame",
    "with_known_balls",
    "write_tables",
]

CLIP_COLUMN = "clip"
"""Column of the clip's name in lab books and results."""


@dataclass(frozen=True)
class SensorColumn:
    """A column of the lab book that holds another instrument's reading of a quantity.

    Attributes
    ----------
    column : str
        In the lab book; its standard uncertainty, where known, in ``<column>_std``.
    quantity : str
        The clip's corresponding quantity.
    unit : str
        Unit of both.
    label : str
        Name of the instrument in figures.
    lowest, highest : float
        Range of the instrument, in `unit`; a cell outside is refused.
    """

    column: str
    quantity: str
    unit: str
    label: str
    lowest: float
    highest: float


SENSORS = (
    SensorColumn("contact_time_fsr_s", "contact_time", "s", "force sensor", 0.0, 1.0),
    SensorColumn("backswing_encoder_deg", "backswing_angle", "deg", "encoder", -180.0, 180.0),
    SensorColumn("impact_speed_encoder_m_s", "pendulum_speed_before", "m/s", "encoder", 0.0, 100.0),
    SensorColumn("landing_tape_m", "landing_distance", "m", "tape", 0.0, 100.0),
)

"""Limits of the apparatus: a ball's contact is shorter than 1 s, a pendulum turns at most 180° and
stays below 100 m/s, a hall is shorter than 100 m."""


@dataclass(frozen=True)
class LabBookRow:
    """One line of the lab book.

    Attributes
    ----------
    clip : str
        As written, with or without its ending.
    ball : str or None
        Preset, name in the setup, or diameter.
    cells : mapping of str to object
        All columns as read, including sensors, in the order of the table.
    """

    clip: str
    ball: str | None
    backswing_deg: float | None
    session: str | None
    cells: Mapping[str, object]

    def sensor(self, sensor: SensorColumn) -> tuple[float, float] | None:
        """Value and standard uncertainty (nan if not given); None without a reading."""
        value = self.cells.get(sensor.column)
        if not isinstance(value, float):
            return None
        std = self.cells.get(f"{sensor.column}_std")
        return value, std if isinstance(std, float) else math.nan


@dataclass(frozen=True)
class LabBook:
    """Strikes in the order written.

    Attributes
    ----------
    columns : tuple of str
        Columns of the table, `clip` first.
    notes : tuple of str
        Format recognised (separator, decimal comma).
    """

    strikes: tuple[LabBookRow, ...]
    columns: tuple[str, ...]
    notes: tuple[str, ...] = ()


_MAX_LAB_BOOK_BYTES = 64 * 2**20
"""64 MiB (chosen: 100 000 lines need less than 20)."""

_MAX_BACKSWING_DEG = 180.0
"""Degrees: the pendulum is upright."""

_NUMERIC = ("backswing_deg", *(sensor.column for sensor in SENSORS))


def read_lab_book(path: Path) -> LabBook:
    """Read `path`, CSV (comma, semicolon or tab; decimal point or comma) or XLSX.

    Raises
    ------
    UsageError
        If it can't be read, has no column ``clip``, names a clip twice, or a numeric cell does not
        parse; the message gives line and column.
    """
    table, notes, above = _table(path)
    table.columns = [str(column).strip() for column in table.columns]
    table.index = pd.RangeIndex(above + 2, above + 2 + len(table))
    table, converted = _with_known_columns(path, table)
    notes = (*notes, *converted)
    repeated = [name for name in table.columns if list(table.columns).count(name) > 1]
    if repeated:
        raise UsageError(f"{path} has two columns {repeated[0]!r}", hint="Rename one of them.")
    if "clip" not in table.columns:
        raise UsageError(
            f"{path} has no column 'clip'; its columns are {', '.join(table.columns[:12])}",
            hint="Name the column with the clips' file names 'clip'.",
        )
    strikes = tuple(
        _strike(path, line, row)
        for line, row in zip(table.index, table.to_dict("records"), strict=True)
        if any(str(cell).strip() for cell in row.values())
    )
    _refuse_twice(path, strikes)
    columns = ("clip", *(name for name in table.columns if name != CLIP_COLUMN))
    return _without_reserved(LabBook(strikes, columns, notes))


def with_known_balls(book: LabBook, names: Iterable[str]) -> LabBook:
    """The lab book with the balls' names spelled as in the set-up: letter case is ignored."""
    known = {name.casefold(): name for name in names}
    strikes = tuple(
        row if row.ball is None else replace(row, ball=known.get(row.ball.casefold(), row.ball))
        for row in book.strikes
    )
    return replace(book, strikes=strikes)


_METRES, _SECONDS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}, {"s": 1.0, "ms": 1e-3}
_ANGLE = {"deg": 1.0, "grad": 1.0, "degrees": 1.0, "rad": 180.0 / math.pi}
_M_PER_S = {"m_s": 1.0, "m/s": 1.0, "cm_s": 1e-2, "cm/s": 1e-2, "km_h": 1 / 3.6, "km/h": 1 / 3.6}
_COLUMN_UNITS: dict[str, tuple[str, Mapping[str, float]]] = {
    "backswing_deg": ("backswing", _ANGLE),
    "contact_time_fsr_s": ("contact_time_fsr", _SECONDS),
    "backswing_encoder_deg": ("backswing_encoder", _ANGLE),
    "impact_speed_encoder_m_s": ("impact_speed_encoder", _M_PER_S),
    "landing_tape_m": ("landing_tape", _METRES),
}
"""Columns of numbers: their stem, and factors of units that are converted."""


def _with_known_columns(path: Path, table: pd.DataFrame) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Rename and convert columns that are known under another spelling or unit.

    Raises
    ------
    UsageError
        If a known quantity has no unit or an unknown one: its cells would be kept as text.
    """
    notes: list[str] = []
    renamed: dict[str, str] = {}
    for name in map(str, table.columns):
        if name in _RESERVED:
            # of the results' own: kept under another name
            continue
        bare, suffix = _bare_name(name)
        if bare in _WORD_COLUMNS and not suffix:
            renamed[name] = _WORD_COLUMNS[bare]
            continue
        for wanted, (stem, factors) in _COLUMN_UNITS.items():
            unit = bare.removeprefix(f"{stem}_")
            if bare == wanted:
                renamed[name] = wanted + suffix
            elif bare == stem:
                raise UsageError(
                    f"{path}: the column {name!r} states no unit",
                    hint="Name it by its unit:"
                    f" {', '.join(f'{stem}_{one}{suffix}' for one in factors)}.",
                )
            elif bare.startswith(f"{stem}_") and unit in factors:
                cells = [
                    _converted(path, line, name, cell, factors[unit])
                    for line, cell in zip(table.index.tolist(), table[name], strict=True)
                ]
                table[name] = pd.Series(cells, index=table.index, dtype=object)
                renamed[name] = wanted + suffix
                notes.append(f"The column {name} is converted to {wanted}{suffix}.")
    given = list(renamed.values())
    clash = [new for new in given if given.count(new) > 1]
    if clash:
        raise UsageError(f"{path} has two columns for {clash[0]}", hint="Remove one of them.")
    known = {*renamed, *_RESERVED}
    unused = [name for name in map(str, table.columns) if name not in known]
    return table.rename(columns=renamed), (*notes, *_unused_notes(unused))


def _bare_name(name: str) -> tuple[str, str]:
    """A column's name in small letters with its unit behind it, and its ending ``_std``."""
    unit = re.sub(r"[\(\[/]\s*(.*?)\s*[\)\]]?\s*$", r" \1", name).strip().replace("°", "deg")
    plain = re.sub(r"[\s\-]+", "_", folded(unit))
    suffix = "_std" if plain.endswith("_std") else ""
    bare = plain.removesuffix(suffix)
    for word, stem in _STEMS.items():
        if bare == word or bare.startswith(f"{word}_"):
            return stem + bare.removeprefix(word), suffix
    return bare, suffix


_WORD_COLUMNS = {
    word: column
    for column, words in {
        "clip": "clip video film file filename datei fichier archivo",
        "ball": "ball kugel balle ballon pelota bola",
        "session": "session sitzung seance sesion",
    }.items()
    for word in words.split()
}
"""Names of columns of words, without accents."""

_STEMS = {
    "backswing_angle": "backswing",
    "auslenkung": "backswing",
    "angle_de_lacher": "backswing",
    "amplitude": "backswing",
    "amplitud": "backswing",
    "massband": "landing_tape",
}
"""Other names of numbers."""


def _unused_notes(names: Sequence[str]) -> tuple[str, ...]:
    """Which columns are kept without being used, with the names that may be meant."""
    if not names:
        return ()
    said = f"Columns of the lab book that are kept but not used: {', '.join(names)}."
    for name in names:
        words = set(_bare_name(name)[0].split("_"))
        for wanted, (stem, _) in _COLUMN_UNITS.items():
            if words & ({*stem.split("_")} - {"time", "speed"}):
                said += f" If {name} is the instrument's reading, name it {wanted}, or with its"
                said += f" unit, as {stem}_cm." if wanted.endswith("_m") else " unit."
                break
    return (said,)


def _converted(path: Path, line: int, column: str, cell: object, factor: float) -> object:
    text = str(cell).strip()
    return "" if not text else repr(factor * _number(path, line, column, text))


_RESERVED = frozenset(
    {"motion", "warnings", "state", "error", "excluded"}
    | {f"reason_{name}" for name in QUANTITY_UNITS}
    | {column_name(name, unit) for name, unit in QUANTITY_UNITS.items()}
    | {f"{column_name(name, unit)}_std" for name, unit in QUANTITY_UNITS.items()}
)
"""Columns of the results: a column of the lab book with such a name gets another one."""


def _without_reserved(book: LabBook) -> LabBook:
    """The lab book with names of its own where they are names of results."""
    renamed: dict[str, str] = {}
    for name in book.columns:
        if name in _RESERVED:
            other = f"book_{name}"
            while other in book.columns:
                other = f"book_{other}"
            renamed[name] = other
    if not renamed:
        return book
    strikes = tuple(
        replace(row, cells={renamed.get(name, name): cell for name, cell in row.cells.items()})
        for row in book.strikes
    )
    columns = tuple(renamed.get(name, name) for name in book.columns)
    listed = ", ".join(f"{name} as {other}" for name, other in renamed.items())
    note = f"Columns of the lab book that have the name of a result are kept: {listed}."
    return LabBook(strikes, columns, (*book.notes, note))


def _table(path: Path) -> tuple[pd.DataFrame, tuple[str, ...], int]:
    """Cells below the header, notes, and the number of lines above the header."""
    _refuse_other_files(path)
    if path.suffix.lower() == ".xlsx":
        return _sheet(path), (), 0
    text = _text(path)
    _refuse_long(path, text.count("\n") - 1)
    _refuse_open_quotes(path, text)
    above = _lines_above(text)
    below = text.splitlines(keepends=True)[above:]
    head = below[0] if text.strip() else ""
    separator = max((",", ";", "\t"), key=head.count)
    refuse_sideways(path, head.count(separator) + 1)
    try:
        table = pd.read_csv(
            io.StringIO("".join(below)),
            sep=separator,
            dtype=str,
            keep_default_na=False,
            header=None,
        )
    except (pd.errors.ParserError, pd.errors.EmptyDataError) as problem:
        raise UsageError(
            f"{path} is not a table: {str(problem).split('C error: ')[-1].strip()}",
            hint="Give each line as many cells as the header; quote cells with a separator.",
        ) from problem
    # missing cells at the end of a line are empty
    table = table.fillna("")
    table.columns = table.iloc[0]
    table = table.iloc[1:]
    notes = () if separator == "," else (f"columns of {path.name} are separated by {separator!r}",)
    if above:
        notes = (*notes, f"The first {above} lines of {path.name}, above its header, are not used.")
    return table, notes, above


def _refuse_other_files(path: Path) -> None:
    if path.exists() and not path.is_file():
        kind = "a folder" if path.is_dir() else "a device or a pipe"
        raise UsageError(
            f"the lab book {path} is {kind}", hint="Give a CSV or XLSX file with a column 'clip'."
        )
    if not path.is_file():
        raise UsageError(
            f"there is no lab book {path}", hint="Give a CSV or XLSX file with a column 'clip'."
        )
    if path.stat().st_size > _MAX_LAB_BOOK_BYTES:
        raise UsageError(f"{path} is larger than 64 MB", hint="Check that it is the lab book.")


def _sheet(path: Path) -> pd.DataFrame:
    """Cells of a spreadsheet, dates as text."""
    try:
        sheet = pd.read_excel(path, dtype=object, nrows=MAX_LAB_BOOK_ROWS + 1).fillna("")
    except Exception as problem:  # openpyxl raises many types on damaged files
        raise UsageError(
            f"{path} is not a readable XLSX file: {problem}",
            hint="Save it again as .xlsx or .csv.",
        ) from problem
    _refuse_long(path, len(sheet))
    cells = sheet.map(lambda cell: cell.isoformat() if hasattr(cell, "isoformat") else cell)
    return cells


def _refuse_open_quotes(path: Path, text: str) -> None:
    for number, line in enumerate(text.splitlines(), start=1):
        if line.count('"') % 2:
            raise UsageError(
                f"{path}, line {number}: the quotation mark is not closed in its line, and would"
                " join the lines that follow into one cell",
                hint='Remove the quotation mark ("), or write the cell in one line.',
            )


MAX_LAB_BOOK_ROWS = 100_000
"""Rows of a lab book, one per clip (chosen: more clips than years of work give)."""


def _refuse_long(path: Path, rows: int) -> None:
    if rows > MAX_LAB_BOOK_ROWS:
        raise UsageError(
            f"{path} has more than {MAX_LAB_BOOK_ROWS:,} rows; a lab book has one row per clip",
            hint="Check that it is the lab book, not a table of marks; or keep its clips' rows.",
        )


def _lines_above(text: str) -> int:
    """Lines above the one with a column of clips, such as a title."""
    for number, line in enumerate(text.splitlines()[:_TITLE_LINES]):
        cells = [cell.strip(' "\ufeff') for cell in re.split(r"[,;\t]", line)]
        if any(_WORD_COLUMNS.get(_bare_name(cell)[0]) == CLIP_COLUMN for cell in cells):
            return number
    return 0


_TITLE_LINES = 12
"""Lines in which the header is searched (chosen)."""


def _text(path: Path) -> str:
    raw = path.read_bytes()
    for mark, encoding in ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if raw.startswith(mark):
            return raw.decode(encoding, errors="replace")
    if b"\x00" in raw:
        raise UsageError(
            f"{path} is not text, or is UTF-16 without a byte order mark",
            hint="Save it as CSV in UTF-8, or as .xlsx.",
        )
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        # the usual encoding of Western European spreadsheets that do not write UTF-8
        return raw.decode("cp1252", errors="replace")


def _strike(path: Path, line: int, row: Mapping[object, object]) -> LabBookRow:
    cells: dict[str, object] = {str(name): _tidy(cell) for name, cell in row.items()}
    clip = cells.get("clip")
    if clip is None or not str(clip).strip():
        raise UsageError(
            f"{path}, line {line}: the clip's name is missing",
            hint="Fill in the cell, or delete the line.",
        )
    for column in (*_NUMERIC, *(f"{name}_std" for name in _NUMERIC)):
        if cells.get(column) is not None:
            cells[column] = _number(path, line, column, cells[column])
    for sensor in SENSORS:
        value = cells.get(sensor.column)
        if isinstance(value, float) and not sensor.lowest <= value <= sensor.highest:
            stem, factors = _COLUMN_UNITS[sensor.column]
            others = [
                f"{stem}_{unit}"
                for unit, factor in factors.items()
                if factor != 1.0 and sensor.lowest <= value * factor <= sensor.highest
            ]
            raise UsageError(
                f"{path}, line {line}: {sensor.column} is {value:g} {sensor.unit}, outside the"
                f" range of a {sensor.label}",
                hint=f"Give a value from {sensor.lowest:g} to {sensor.highest:g} {sensor.unit}"
                + (f", or name the column by its unit: {', '.join(others)}." if others else "."),
            )
        std = cells.get(f"{sensor.column}_std")
        if isinstance(std, float) and std <= 0:
            raise UsageError(
                f"{path}, line {line}: {sensor.column}_std must be positive",
                hint="Leave the cell empty if the uncertainty is unknown.",
            )
    backswing = cells.get("backswing_deg")
    if isinstance(backswing, float) and not abs(backswing) <= _MAX_BACKSWING_DEG:
        raise UsageError(
            f"{path}, line {line}: backswing_deg is {backswing:g}, outside the range of a pendulum",
            hint=f"Give an angle from 0 to {_MAX_BACKSWING_DEG:.0f} degrees.",
        )
    return LabBookRow(
        clip=str(clip),
        ball=None if cells.get("ball") is None else str(cells["ball"]),
        backswing_deg=backswing if isinstance(backswing, float) else None,
        session=None if cells.get("session") is None else str(cells["session"]),
        cells=cells,
    )


def _tidy(cell: object) -> object:
    text = printable(str(cell).strip())
    return text or None


def _number(path: Path, line: int, column: str, cell: object) -> float:
    text = str(cell).replace("\u2212", "-")
    if text.count(",") == 1 and "." not in text:
        text = text.replace(",", ".")
    try:
        value = float(text)
    except ValueError:
        value = _with_unit(column, text)
    if not math.isfinite(value):
        raise UsageError(
            f"{path}, line {line}: {column} is {cell!r}, which is not a number",
            hint="Write it as 12.5 or 12,5, or leave the cell empty.",
        )
    return value


def _with_unit(column: str, text: str) -> float:
    """A number with its unit in the cell, in the unit of the column; NaN if it is none."""
    unit = next((one for one in _UNITS_AT_END if column.removesuffix("_std").endswith(one)), "")
    try:
        return parse_quantity(text.replace("°", " deg"), _UNITS_AT_END[unit]) if unit else math.nan
    except UsageError:
        return math.nan


_UNITS_AT_END = {"_deg": "deg", "_m_s": "m/s", "_m": "m", "_s": "s"}
"""Units at the end of a column's name; the longer ones first."""


def _refuse_twice(path: Path, strikes: Sequence[LabBookRow]) -> None:
    seen: dict[str, int] = {}
    for strike in strikes:
        if strike.clip in seen:
            raise UsageError(
                f"{path} names the clip {strike.clip!r} twice",
                hint="Each line of the lab book must describe one strike with its own clip.",
            )
        seen[strike.clip] = 1
    if not strikes:
        raise UsageError(f"{path} has no line below its header", hint="Write one line per strike.")


@dataclass(frozen=True)
class Matched:
    """Clips with their lines of the lab book.

    Attributes
    ----------
    strikes : mapping of Path to Strike or None
        The strike of each clip; None if the lab book does not name it.
    absent : tuple of LabBookRow
        Lines of the lab book whose clip was not given.
    """

    strikes: Mapping[Path, LabBookRow | None]
    absent: tuple[LabBookRow, ...] = ()


def match_clips(book: LabBook | None, clips: Sequence[Path]) -> Matched:
    """Assign lines of the lab book to clips.

    Raises
    ------
    UsageError
        If two clips have the same name, which is their key in all tables.
    """
    by_name: dict[str, Path] = {}
    for clip in clips:
        for name in {clip.name, clip.stem, clip_key(clip)}:
            if by_name.setdefault(name, clip) != clip:
                raise UsageError(
                    f"two clips are called {name!r}: {by_name[name]} and {clip}",
                    hint="Rename one: the name is the clip's key in lab book and results.",
                )
    strikes: dict[Path, LabBookRow | None] = dict.fromkeys(clips)
    absent = []
    for strike in () if book is None else book.strikes:
        found = by_name.get(Path(strike.clip).name)
        if found is None:
            absent.append(strike)
        elif strikes[found] is not None:
            raise UsageError(
                f"the lab book names {found.name} twice, with and without its ending",
                hint="Each line of the lab book must describe one strike with its own clip.",
            )
        else:
            strikes[found] = strike
    return Matched(strikes, tuple(absent))


@dataclass(frozen=True)
class Recording:
    """One recording given under several names.

    Attributes
    ----------
    clips : tuple of str
        Its names that are not marked as bad.
    counted : str or None
        The name under which its strike counts; None if the lab book names two balls for it.
    marked : str or None
        A name before `counted` that is marked as bad.
    """

    clips: tuple[str, ...]
    counted: str | None
    marked: str | None = None

    def message(self) -> str:
        """Describe the finding, its consequence and what to do."""
        names = " and ".join(self.clips)
        if self.counted is None:
            return (
                f"{names} are the same recording, but the lab book names different balls: it is"
                " excluded from the laws. Correct the lab book, or mark the wrong names as bad."
            )
        if self.marked is not None:
            return (
                f"{self.counted} is the same recording as {self.marked}, which is marked as bad,"
                " but it counts. Mark it as bad too, unless only the copy is bad."
            )
        return f"{names} are the same recording: its strike counts once, as {self.counted}."


def recordings(
    copies: Iterable[Mapping[str, str | None]], strikes: Mapping[str, LabBookRow | None]
) -> tuple[Recording, ...]:
    """Find recordings given under several names; only one name may count.

    Parameters
    ----------
    copies : iterable of mapping
        As `Ledger.copies` gives them.
    strikes : mapping of str to LabBookRow or None
        Clips of this campaign by name. A name in the lab book takes precedence.
    """
    found = []
    for group in copies:
        here = {clip: mark for clip, mark in group.items() if clip in strikes}
        clips = tuple(clip for clip, mark in here.items() if mark is None)
        first = next(iter(here), None)
        marked = first if first not in clips else None
        if not clips or (len(clips) == 1 and marked is None):
            continue
        written = {clip: row for clip in clips if (row := strikes[clip]) is not None}
        balls = {row.ball for row in written.values()}
        counted = next(iter(written or clips)) if len(balls) <= 1 else None
        found.append(Recording(clips, counted, marked))
    return tuple(found)


def not_counted(found: Iterable[Recording]) -> dict[str, str]:
    """Clips excluded from the laws because of `recordings`, with the reason."""
    return {
        clip: "same recording, two balls in the lab book"
        if one.counted is None
        else f"the same recording as {one.counted}"
        for one in found
        for clip in one.clips
        if clip != one.counted
    }


FloatArray = NDArray[np.float64]

ANALYSED = (
    "pendulum_speed_before",
    "pendulum_speed_after",
    "cor",
    "contact_time",
    "ball_speed",
    "launch_angle",
    "landing_distance",
    "external_impulse",
    "energy_loss",
    "backswing_angle",
)

"""Quantities used by the analysis of a campaign; the tables have all."""

_FRAME_ROWS = 1000
"""Rows converted at once (chosen: bounds memory)."""


@dataclass(frozen=True)
class ClipResult:
    """What the analysis needs of one clip, kept small for 100 000 clips.

    Attributes
    ----------
    elsewhere : str or None
        Why it is not counted under this name (`not_counted`).
    values : (Q, 2) array
        Value and standard uncertainty of each of `ANALYSED`; nan where not measured.
    shared : mapping of str to float
        Lines of the COR's budget that are common to all clips of a setup.
    """

    clip: str
    state: State
    error: str | None
    excluded: str | None
    elsewhere: str | None
    seconds: float | None
    strike: LabBookRow | None
    values: FloatArray
    shared: Mapping[str, float]
    warnings: tuple[str, ...]

    @property
    def used(self) -> bool:
        """Whether the clip was measured, is not marked as bad, and counts under its name."""
        return self.state == State.DONE and self.excluded is None and self.elsewhere is None

    @property
    def ball(self) -> str:
        """Name of the ball; empty if not given."""
        return "" if self.strike is None or self.strike.ball is None else self.strike.ball

    @property
    def session(self) -> str:
        """Name of the session; empty if not given."""
        return "" if self.strike is None or self.strike.session is None else self.strike.session

    def quantity(self, name: str) -> tuple[float, float]:
        """Value and standard uncertainty of one of `ANALYSED`; nan where not measured."""
        value, std = self.values[ANALYSED.index(name)]
        return float(value), float(std)


def clip_results(
    entries: Iterable[Entry], strikes: Mapping[str, LabBookRow | None], elsewhere: Mapping[str, str]
) -> list[ClipResult]:
    """Join ledger and lab book by the clip's name; `elsewhere` as from `not_counted`."""
    return [
        _result(entry, strikes[entry.order.clip], elsewhere.get(entry.order.clip))
        for entry in entries
        if entry.order.clip in strikes
    ]


def _result(entry: Entry, strike: LabBookRow | None, elsewhere: str | None) -> ClipResult:
    document = entry.document or {}
    quantities: Mapping[str, Any] = document.get("quantities", {})
    values = np.full((len(ANALYSED), 2), np.nan)
    for row, name in zip(values, ANALYSED, strict=True):
        item = quantities.get(name, {})
        if item.get("value") is not None:
            row[:] = item["value"], item["std"]
    lines = document.get("budget", {}).get("cor", [])
    return ClipResult(
        clip=entry.order.clip,
        state=entry.state,
        error=entry.error,
        excluded=entry.excluded,
        elsewhere=elsewhere,
        seconds=entry.seconds,
        strike=strike,
        values=values,
        shared={line["source"]: float(line["std"]) for line in lines if line.get("shared")},
        warnings=tuple(map(sys.intern, document.get("warnings", ()))),
    )


def _row(
    entry: Entry, strike: LabBookRow | None, columns: tuple[str, ...], elsewhere: str | None
) -> dict[str, object]:
    """Row of the results, `columns` of the lab book first."""
    cells = {} if strike is None else strike.cells
    document = entry.document or {}
    row: dict[str, object] = {"clip": entry.order.clip}
    row |= {name: cells.get(name) for name in columns if name != CLIP_COLUMN}
    reasons: dict[str, object] = {}
    for name, item in document.get("quantities", {}).items():
        column = column_name(name, item["unit"])
        row[column], row[f"{column}_std"] = item.get("value"), item.get("std")
        if item.get("value") is None:
            reasons[f"reason_{name}"] = item.get("reason")
    row["motion"] = (document.get("motion") or {}).get("kind")
    row |= reasons
    row["warnings"] = " | ".join(document.get("warnings", ())) or None
    row["state"], row["error"] = str(entry.state), entry.error
    row["excluded"] = entry.excluded or elsewhere
    return row


def results_frame(
    entries: Iterable[Entry],
    strikes: Mapping[str, LabBookRow | None],
    book: LabBook | None,
    elsewhere: Mapping[str, str],
) -> pd.DataFrame:
    """One row per clip that is done or failed.

    The columns are those of the lab book, the main quantities of the motions seen, all other
    quantities, and state and reasons.

    ``excluded`` gives the reason for each clip excluded from the laws: a mark, or `elsewhere` as
    from `not_counted`.
    """
    columns = ("clip",) if book is None else book.columns
    rows = (
        _row(entry, strikes[entry.order.clip], columns, elsewhere.get(entry.order.clip))
        for entry in entries
        if entry.order.clip in strikes and entry.state in (State.DONE, State.FAILED)
    )
    parts = [pd.DataFrame(part) for part in _batches(rows)]
    if not parts:
        return pd.DataFrame({name: pd.Series(dtype=object) for name in ("clip", "state", "error")})
    # infer types per part; columns empty in a part must not decide the type of the whole
    frame = pd.concat([part.dropna(axis="columns", how="all") for part in parts])
    frame = frame.reindex(columns=list(dict.fromkeys(name for part in parts for name in part)))
    tail = ["motion", *[name for name in frame if str(name).startswith("reason_")]]
    tail += ["warnings", "state", "error", "excluded"]
    first = [name for name in frame if name in columns]
    main = [name for name in main_columns(frame) if name not in first]
    others = [name for name in frame if name not in {*first, *main, *tail}]
    frame = frame[[*first, *main, *others, *tail]].reset_index(drop=True)
    numbers = {f"{name}{std}" for name in _NUMERIC for std in ("", "_std")}
    numbers |= {name for name in _RESERVED if name.endswith("_std")}
    for name in map(str, frame.columns):
        if name in numbers:
            frame[name] = pd.to_numeric(frame[name])
    return frame


def main_columns(frame: pd.DataFrame) -> list[str]:
    """Columns of the main quantities of the kinds of motion in a table, the most frequent first."""
    seen = frame["motion"].dropna().value_counts().index if "motion" in frame else ()
    names = dict.fromkeys(name for kind in seen for name in main_quantities(MotionKind(kind)))
    heads = list(map(str, frame))
    found = []
    for name in names:
        # without a scale the unit depends on whether the rate is known
        starts = column_name(name, QUANTITY_UNITS[name]) if name in QUANTITY_UNITS else None
        found += [
            head
            for head in heads
            if head in (starts, f"{starts}_std") or (starts is None and head.startswith(name))
        ]
    return found


def _short(frame: pd.DataFrame) -> pd.DataFrame:
    """The table for people: lab book and main quantities, without quantities that no clip has."""
    known = {f"{column_name(n, u)}{std}" for n, u in QUANTITY_UNITS.items() for std in ("", "_std")}
    main = [name for name in main_columns(frame) if frame[name].notna().any()]
    hidden = {name for name in map(str, frame) if name in known or name.startswith("reason_")}
    return frame[[name for name in frame if name in main or name not in hidden]]


def _batches(rows: Iterator[dict[str, object]]) -> Iterator[list[dict[str, object]]]:
    while batch := list(itertools.islice(rows, _FRAME_ROWS)):
        yield batch


def parquet_is_written() -> bool:
    """Whether pyarrow, of the extra ``parquet``, is installed."""
    return find_spec("pyarrow") is not None


def write_tables(frame: pd.DataFrame, folder: Path) -> None:
    """Write ``results.csv``, ``.xlsx`` and, where pyarrow is installed, ``.parquet``, atomically.

    The workbook has two sheets: the main quantities, and all columns.

    Raises
    ------
    UsageError
        If the disk is full or the folder can't be written to.
    """
    frame = frame.map(lambda cell: printable(cell) if isinstance(cell, str) else cell)
    frame.columns = pd.Index([printable(str(name)) for name in frame.columns])
    texts = frame.select_dtypes(include=["object", "string"]).columns
    plain = pd.DataFrame(
        [
            without_formulas({str(name): cell for name, cell in row.items()})
            for row in frame.to_dict("records")
        ],
        columns=frame.columns,
    )
    heads = {name: name for name in plain.columns}
    plain.columns = pd.Index([str(head) for head in without_formulas(heads).values()])
    buffer = io.StringIO()
    plain.to_csv(buffer, index=False, lineterminator="\n", quoting=csv.QUOTE_MINIMAL)
    try:
        write_text_whole(folder / "results.csv", buffer.getvalue())
        with (
            written_whole(folder / "results.xlsx") as temporary,
            pd.ExcelWriter(temporary, engine="openpyxl") as book,
        ):
            _short(plain).to_excel(book, index=False, sheet_name="results")
            plain.to_excel(book, index=False, sheet_name="all columns")
        if parquet_is_written():
            with written_whole(folder / "results.parquet") as temporary:
                _storable(frame, texts).to_parquet(temporary, index=False)
    except OSError as problem:
        raise UsageError(
            f"can't write the results to {folder}: {problem.strerror}",
            hint="Free disk space and run the same command again: the ledger keeps the results.",
        ) from problem


def _storable(frame: pd.DataFrame, texts: Iterable[object]) -> pd.DataFrame:
    """Convert to one type per column, as parquet requires."""
    kept = frame.copy()
    for name in texts:
        filled = kept[name].dropna()
        if filled.map(lambda cell: isinstance(cell, int | float)).all():
            kept[name] = pd.to_numeric(kept[name])
        else:
            kept[name] = kept[name].map(lambda cell: None if cell is None else str(cell))
    return kept
