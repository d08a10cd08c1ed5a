"""Read tracks from tables of Tracker, Kinovea, trackpy, DeepLabCut or SLEAP.

Pixel centres are at integers, as in trackpy and DeepLabCut; Tracker's ``pixelx`` and ``pixely``
count from the corner of the first pixel. The meaning of unknown columns is given with --columns or
asked once.
"""

import csv
import io
import math
import pickletools
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tomli_w
from numpy.typing import NDArray

from measuring.checker.fall import (
    MIN_FALL_ROWS,
    TIMES_S,
    TableUnits,
    find_fall,
    turn_of_fall,
    units_by_fall,
)
from measuring.measurement import CAMERA_COLUMNS
from metrology import Defaults, UsageError, parse_quantity, write_text_whole
from metrology.measurands import folded, unit_word
from pipelines.interop.external import (
    ExternalTrack,
    ExternalTracks,
    PlaneOfMotion,
    Program,
)
from pipelines.interop.headers import (
    AxisColumns,
    may_be_position,
    positions_of,
    read_clock,
    read_timecode,
    time_column,
)
from pipelines.interop.layout import (
    along_a_line,
    by_fall,
    numeric_columns,
    with_arm,
    with_centres,
    with_heights,
    without_units,
)
from pipelines.interop.projects import PIXEL_CORNER
from pipelines.interop.rows import Marks, even_clock, settled
from pipelines.interop.sheets import (
    frame_of,
    separator_of,
    sheet_of,
    text_lines,
    text_of,
    with_numbers,
)
from pipelines.terminal import screen

__all__ = [
    "HDF5_SUFFIXES",
    "PROJECT_SUFFIXES",
    "TABLE_SUFFIXES",
    "ColumnUse",
    "ask_columns",
    "column_use",
    "header_of",
    "is_of_a_program",
    "keep_columns",
    "made_elsewhere",
    "parse_columns",
    "plain_name",
    "read_samples",
    "read_table_of_tracks",
    "unit_of",
]

KEYS = {
    "t": "the time",
    "frame": "the frame number, from 0",
    "x": "the position to the right",
    "y": "the position up (of pixels: down)",
    "object": "the name of the object, in a table of several",
    "trial": "the name of the trial, in a table of several",
}

"""Columns that may be named, with their meaning."""

WORD_KEYS = {
    "ball": "name of the track that is the ball",
    "pendulum": "name of the track that is the pendulum's mass",
    "unit": "unit of x and y: px, m, cm, mm, …",
    "t_unit": "unit of the time: s or ms",
}

"""Further keys, whose values are not columns."""

_COLUMN_NAMES: dict[str, tuple[str, ...]] = {
    "t": ("t", "t_s", "time", "time_s", "times", "zeit", "temps", "tiempo", "tempo"),
    "frame": (
        "frame",
        "frame_idx",
        "frame_index",
        "frame_number",
        "frame_no",
        "frame_nr",
        "frames",
        "bild",
        "bild_nr",
        "image",
        "slice",
        "slice_n°",
    ),
    "x": ("x", "x_m", "x_cm", "x_mm", "x_px", "pos_x", "posx", "px", "pixelx", "x_pos"),
    "y": ("y", "y_m", "y_cm", "y_mm", "y_px", "pos_y", "posy", "py", "pixely", "y_pos"),
    "object": ("object", "track_id", "track", "track_n°", "particle", "particle_id", "id", "name"),
    "trial": ("trial", "versuch", "essai", "ensayo", "run", "lauf", "durchgang"),
}
"""Column names that are unambiguous; others are asked for. Of several names of objects the first
counts."""

_UNIT = re.compile(r"[\(\[]\s*([^)\]]+?)\s*[\)\]]|[_ ](px|mm|cm|m|ms|s|in|ft)$", re.IGNORECASE)

_SLASH_UNIT = re.compile(r"\s/\s*(px|mm|cm|m|ms|s|in|ft)\s*$", re.IGNORECASE)
"""A unit as in ``h / cm``."""


@dataclass(frozen=True)
class ColumnUse:
    """Meaning of the columns.

    Attributes
    ----------
    columns : mapping of str to str
        By the keys of `KEYS`; x and y are always there, and t or frame.
    metre : float or None
        Metres per unit of x and y; None if they are pixels.
    second : float
        Seconds per unit of t.
    stretch : float
        Units of x per unit of y.
    """

    columns: Mapping[str, str]
    metre: float | None
    second: float
    stretch: float = 1.0


def parse_columns(text: str | None) -> dict[str, str]:
    """``"t=Zeit (s), x=X (cm), ball=masa A"`` as a mapping.

    Raises
    ------
    UsageError
        If it is not of that form, or has an unknown key.
    """
    found: dict[str, str] = {}
    mark = ";" if re.search(rf";\s*({'|'.join([*KEYS, *WORD_KEYS])})\s*=", text or "") else ","
    for part in next(csv.reader([text or ""], delimiter=mark, skipinitialspace=True), []):
        key, _, value = part.partition("=")
        key, value = key.strip(), value.strip()
        if not part.strip():
            continue
        if key not in KEYS | WORD_KEYS or not value:
            known = ", ".join([*KEYS, *WORD_KEYS])
            raise UsageError(
                f"--columns: {part.strip()!r} is not KEY=NAME",
                hint=f"KEY is one of {known}; as in --columns 't=Time (s), x=X (cm), y=Y (cm)'.",
            )
        found[key] = value
    return found


def column_use(header: Sequence[str], said: Mapping[str, str], table: str) -> ColumnUse:
    """Determine the meaning of the columns.

    Parameters
    ----------
    header : sequence of str
    said : mapping of str to str
        As `parse_columns`; overrides the names' usual meaning.
    table : str
        Name of the table in messages.

    Raises
    ------
    UsageError
        If a named column is missing, or a required one can't be determined.
    """
    columns: dict[str, str] = {}
    for key in KEYS:
        if key in said:
            columns[key] = _meant(said[key], header, table)
            continue
        names = _COLUMN_NAMES[key]
        alike = [name for name in header if plain_name(name) in names]
        if len(alike) == 1 or (alike and key == "object"):
            columns[key] = min(alike, key=lambda name: names.index(plain_name(name)))
    deep = next((name for name in header if plain_name(name) in _HEIGHTS), None)
    if deep is not None and deep not in columns.values():
        columns["z"] = deep
    missing = [key for key in ("x", "y") if key not in columns]
    if "t" not in columns and "frame" not in columns:
        missing.append("t")
    if missing:
        if all(re.fullmatch(r"[-+\d.,eE\s]*", name) for name in header):
            raise UsageError(
                f"{table}: the first line holds numbers, not the names of the columns",
                hint="Write a line of names above it, such as t,x,y for seconds and metres.",
            )
        if not any(may_be_position(name) for name in header if name != time_column(header)):
            raise UsageError(
                f"{table} holds no positions: it has {_listed(header)}",
                hint="Speeds, accelerations and angles do not show where a ball was: export its"
                " position, such as columns t (s), x (m), y (m).",
            )
        height = next((name for name in header if plain_name(name) in _HEIGHTS), "NAME")
        example = ", ".join(f"{key}={height if key == 'y' else 'NAME'}" for key in missing)
        raise UsageError(
            f"{table}: no column found for {' and '.join(missing)}; it has {_listed(header)}",
            hint=f'Pass --columns "{example}", or set them in the table [columns] of the setup'
            " file."
            if len(header) > len(columns)
            else "Export it again with this column; where pictures are numbered, name it frame and"
            " pass --fps.",
        )
    by_axis = [_known_unit(columns[key], "m") for key in "xy"]
    unit = said.get("unit") or by_axis[0] or by_axis[1] or "px"
    t_unit = said.get("t_unit") or _known_unit(columns.get("t", "t"), "s") or "s"
    metre = None if unit.lower() in _PIXEL_WORDS else parse_quantity(f"1 {unit}", "m")
    stretch = 1.0
    if metre is not None and "unit" not in said and all(by_axis):
        stretch = parse_quantity(f"1 {by_axis[1]}", "m") / metre
    return ColumnUse(columns, metre, parse_quantity(f"1 {t_unit}", "s"), stretch)


def _meant(name: str, header: Sequence[str], table: str) -> str:
    """The column that a user names: exactly, in other letter case, without unit, or by number.

    Raises
    ------
    UsageError
        If there is none, or several.
    """
    same = (
        [one for one in header if one == name],
        [one for one in header if folded(one) == folded(name)],
        [one for one in header if plain_name(one) == plain_name(name)],
        [one for k, one in enumerate(header, start=1) if name == str(k)],
    )
    found = next((alike for alike in same if alike), [])
    if len(found) == 1:
        return found[0]
    alike = get_close_matches(name, header, n=1)
    meant = f"Did you mean {alike[0]!r}? " if alike else ""
    raise UsageError(f"{table} has no column {name!r}", hint=f"{meant}It has: {_listed(header)}.")


def ask_columns(header: Sequence[str], said: Mapping[str, str], table: str) -> dict[str, str]:
    """Ask on the terminal for undetermined columns; nothing without a terminal.

    Returns
    -------
    dict of str to str
        The columns given, with the answers.
    """
    answers = dict(said)
    if not header or not (sys.stdin.isatty() and sys.stderr.isatty()):
        return answers
    errors = screen(errors=True)
    for _ in range(len(KEYS)):
        try:
            column_use(header, answers, table)
            break
        except UsageError as problem:
            errors.print(problem.message, soft_wrap=True, markup=False)
        wanted = [key for key in ("x", "y", "t") if _unanswered(key, header, answers)]
        if not wanted:
            break
        for key in wanted:
            number = errors.input(f"Which column is {KEYS[key]}? 1 to {len(header)}: ")
            if number.strip().isdigit() and 1 <= int(number) <= len(header):
                answers[key] = header[int(number) - 1]
    return answers


def keep_columns(setup: Path, columns: Mapping[str, str]) -> None:
    """Add the table ``[columns]`` to a setup file that has none; keep the rest."""
    text = setup.read_text(encoding="utf-8").rstrip()
    write_text_whole(setup, f"{text}\n\n" + tomli_w.dumps({"columns": dict(columns)}))


def _unanswered(key: str, header: Sequence[str], answers: Mapping[str, str]) -> bool:
    if key in answers or (key == "t" and "frame" in answers):
        return False
    return sum(plain_name(name) in _COLUMN_NAMES[key] for name in header) != 1


def plain_name(name: str) -> str:
    """A column's name without its unit, in lower case and without accents."""
    bare = re.sub(r"[\(\[].*?[\)\]]", "", name)
    return re.sub(r"[ \-.'\u2019#]+", "_", folded(_SLASH_UNIT.sub("", bare).strip(" .#")))


def unit_of(name: str) -> str | None:
    """Unit in a column's name: ``Height (cm)``, ``h_cm``."""
    found = _UNIT.search(name.strip()) or _SLASH_UNIT.search(name)
    unit = None if found is None else next(filter(None, found.groups()))
    # Kinovea writes the axis in brackets
    return None if unit is None or unit.lower() in ("x", "y") else unit_word(unit)


_PIXEL_WORDS = ("px", "pixel", "pixels")


def _known_unit(name: str, base: str) -> str | None:
    """A unit in a column's name that can be converted; of another language none."""
    unit = unit_of(name)
    if unit is None or unit.lower() in _PIXEL_WORDS:
        return unit
    try:
        parse_quantity(f"1 {unit}", base)
    except UsageError:
        return None
    return unit


def _listed(header: Sequence[str]) -> str:
    shown = ", ".join(repr(name) for name in header[:12])
    return shown + (f" and {len(header) - 12} more" if len(header) > 12 else "")


FloatArray = NDArray[np.float64]

HDF5_SUFFIXES = (".h5", ".hdf5")

PROJECT_SUFFIXES = (".trk", ".trz", ".kva")

TABLE_SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".xlsx", *HDF5_SUFFIXES)

MIN_LIKELIHOOD = 0.6
"""DeepLabCut's default ``pcutoff``: marks with a lower likelihood are ignored."""

TABLE_PX_PER_M = 1000.0
"""px/m: a table in metres is drawn at one millimetre per pixel (convention)."""

MAX_STEP_DEVIATION = 0.25
"""Fraction of a step by which times may deviate from an even clock (chosen)."""


def read_table_of_tracks(path: Path, said: Mapping[str, str]) -> ExternalTracks:
    """Read a table of tracks of any program.

    Parameters
    ----------
    path : Path
        CSV, TSV or text (any separator, decimal point or comma), XLSX, or the HDF5 of SLEAP or
        DeepLabCut.
    said : mapping of str to str
        Meaning of columns with ambiguous names (`columns.parse_columns`).

    Raises
    ------
    UsageError
        If it can't be read, or its columns can't be determined.
    """
    suffix = path.suffix.lower()
    if suffix in HDF5_SUFFIXES:
        return _hdf5(path)
    if suffix == ".xlsx":
        notes: list[str] = []
        return _spreadsheet(sheet_of(path, notes), path, said, notes)
    lines = text_lines(path, "a table of tracks")
    for recognises, read in _TABLE_READERS:
        if recognises(lines):
            return read(lines, path, said)
    notes = []
    table = frame_of(lines, path, _BARE_COLUMNS, notes)
    return _spreadsheet(table, path, said, notes)


_BARE_COLUMNS = (
    ("t", "x", "y"),
    ("frame", "id", "bb_left", "bb_top", "bb_width", "bb_height", "conf", "world 1", "world 2",
     "world 3"),
)  # fmt: skip
"""Columns of tables without a header: plain positions, and boxes of the MOT Challenge."""


def header_of(path: Path) -> list[str]:
    """Column names of a table of no known program; empty for anything else.

    Raises
    ------
    UsageError
        If it can't be read.
    """
    suffix = path.suffix.lower()
    if suffix not in TABLE_SUFFIXES or suffix in HDF5_SUFFIXES or is_of_a_program(path):
        return []
    if suffix == ".xlsx":
        return list(sheet_of(path).columns)
    return list(frame_of(text_lines(path, "a table of tracks"), path, _BARE_COLUMNS).columns)


_PROGRAM_HEAD_BYTES = 2**16
"""Bytes read to identify the program of a file (chosen: more than the longest header)."""


def made_elsewhere(path: Path, columns: Mapping[str, str]) -> bool:
    """Whether a file is another program's, or a table with named columns.

    Parameters
    ----------
    path : Path
    columns : mapping of str to str
        As `columns.parse_columns`.
    """
    suffix = path.suffix.lower()
    if suffix in PROJECT_SUFFIXES or suffix in HDF5_SUFFIXES:
        return True
    if suffix not in TABLE_SUFFIXES or not path.is_file():
        return False
    return bool({"t", "frame", "x", "y"} & columns.keys()) or is_of_a_program(path)


def is_of_a_program(path: Path) -> bool:
    """Whether a text file's first lines are those of a known program.

    Raises
    ------
    UsageError
        If it can't be read.
    """
    if path.suffix.lower() == ".xlsx":
        return False
    try:
        with path.open("rb") as file:
            head = file.read(_PROGRAM_HEAD_BYTES)
    except OSError as problem:
        raise UsageError(
            f"can't read {path}: {problem.strerror}",
            hint="Check the path and your read permission.",
        ) from problem
    lines = [line for line in text_of(head).splitlines() if line.strip()]
    if not lines:
        return False
    trackpy = {"x", "y", "frame", "mass", "size"} <= {part.strip() for part in lines[0].split(",")}
    return trackpy or any(recognises(lines) for recognises, _ in _TABLE_READERS)


def _is_kinovea_text(lines: Sequence[str]) -> bool:
    return lines[0].lower().startswith("#kinovea")


def _is_deeplabcut(lines: Sequence[str]) -> bool:
    return bool(re.match(r"scorer[,;\t]", lines[0])) and len(lines) > 3


def _is_tracker_text(lines: Sequence[str]) -> bool:
    """Names of the masses above a header that begins with the time."""
    at = 1 if lines[0].startswith("#multi") else 0
    if len(lines) < at + 3:
        return False
    names, header = lines[at], lines[at + 1]
    heads = [_head(head) for head in re.split(r"[\t,;]", header.strip())]
    others = re.split(r"[\t,;]", names)
    return (
        heads[0] == "t"
        and not any(re.fullmatch(r"[-+.\deE]+", part) for part in others if part.strip())
        and {"x", "y", "pixelx", "frame", "r"} & set(heads[1:]) != set()
    )


def _is_sleap(lines: Sequence[str]) -> bool:
    heads = lines[0].split(",")
    return "frame_idx" in heads and any(head.endswith(".x") for head in heads)


def _values(table: pd.DataFrame, name: str) -> FloatArray:
    return np.asarray(pd.to_numeric(table[name], errors="coerce"), dtype=float)


def _track(
    name: str,
    px: FloatArray,
    frame: FloatArray | None = None,
    time_s: FloatArray | None = None,
    extra: Mapping[str, FloatArray] | None = None,
) -> ExternalTrack:
    """A track of the rows with position and time, in order, one per frame."""
    key = time_s if frame is None else frame
    assert key is not None
    known = np.isfinite(px).all(axis=1) & np.isfinite(key)
    _, first = np.unique(key[known], return_index=True)
    rows = np.flatnonzero(known)[first]
    if frame is None:
        assert time_s is not None
        numbers = _frames(time_s[rows])
    else:
        numbers = np.rint(frame[rows]).astype(np.int64)
    kept = {key: values[rows] for key, values in (extra or {}).items()}
    return ExternalTrack(
        name=name,
        frame=numbers,
        px=px[rows],
        time_s=None if time_s is None else time_s[rows],
        std_px=kept.get("std_px"),
        radius_px=kept.get("radius_px"),
    )


def _frames(time_s: FloatArray) -> NDArray[np.int64]:
    """Frame numbers at these times: on an even clock with gaps, otherwise consecutive."""
    if len(time_s) < 2:
        return np.zeros(len(time_s), dtype=np.int64)
    step = np.diff(time_s)
    usual = float(np.median(step[step <= 1.5 * np.min(step)])) if np.min(step) > 0 else 0.0
    if usual <= 0.0:
        return np.arange(len(time_s))
    steps = step / usual
    # above 2**53 every double is an integer, so that integer steps indicate no clock
    countable = float(np.sum(steps)) < 2.0 / np.finfo(np.float64).eps
    if countable and np.max(np.abs(steps - np.rint(steps))) < MAX_STEP_DEVIATION:
        return np.concatenate([[0], np.cumsum(np.rint(steps))]).astype(np.int64)
    return np.arange(len(time_s))


def _rate(tracks: Sequence[ExternalTrack]) -> float | None:
    """Frames per second of tracks with both frames and times, 1/s."""
    for track in tracks:
        if track.time_s is not None and len(track) > 1:
            span = float(track.time_s[-1] - track.time_s[0])
            pictures = float(track.frame[-1] - track.frame[0])
            if span > 0.0 and pictures > 0.0:
                return pictures / span
    return None


def _found(
    path: Path,
    program: Program,
    tracks: Sequence[ExternalTrack],
    plane: PlaneOfMotion | None = None,
    notes: Sequence[str] = (),
) -> ExternalTracks:
    marked = tuple(track for track in tracks if len(track))
    if not marked:
        raise UsageError(
            f"{path} contains no row with time and position",
            hint="Export a column of times or frames and two of positions; --columns names them.",
        )
    return ExternalTracks(path, program, marked, fps=_rate(marked), plane=plane, notes=tuple(notes))


def _table_plane() -> PlaneOfMotion:
    return PlaneOfMotion(TABLE_PX_PER_M, Defaults.STICK_SCALE.std, np.zeros(2))


def _spreadsheet(
    table: pd.DataFrame, path: Path, said: Mapping[str, str], read: Sequence[str] = ()
) -> ExternalTracks:
    """Any table with a header: trackpy's, this toolkit's, or one with named columns."""
    names = set(table.columns)
    if {"x", "y", "frame", "mass", "size"} <= names:
        return _trackpy(table, path)
    if {"object", "frame", "t_s", "x_px", "y_px"} <= names:
        return _own(table, path)
    notes = list(read)
    table = _in_columns(table, notes)
    table, uses = _in_its_plane(table, _uses(table, said, path.name, notes), said, notes)
    marks: list[Marks] = []
    for name, use in uses:
        parts = [(name, table)]
        if _names_objects(table, use, said):
            parts = [(str(one), rows) for one, rows in table.groupby(use.columns["object"])]
        elif "trial" in use.columns:
            column = use.columns["trial"]
            parts = [(f"{column} {one}", rows) for one, rows in table.groupby(column, sort=False)]
        for part, rows in parts:
            marks += _marks(part or path.stem, rows, use, said)
    units = _units(path, uses, marks, said)
    notes += [note for one in marks for note in one.unread()]
    notes += list(dict.fromkeys(one.note for one in marks if one.note)) + list(units.notes)
    tracks = []
    for one in marks:
        place = one.place @ units.axes.T
        if units.metre is not None:
            place = _table_plane().pixels(place * units.metre)
        time = None if one.time is None else one.time * units.second
        tracks.append(_track(one.name, place, one.frame, time))
    plane = None if units.metre is None else _table_plane()
    return _found(path, Program.TABLE, tracks, plane, notes)


def _in_columns(table: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    """Positions x and y of boxes, of arms, and on a line; units in the names."""
    return with_arm(with_heights(without_units(with_centres(table))), notes)


def read_samples(path: Path, said: Mapping[str, str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Any table of positions as samples in SI units, with notes on reading it.

    Parameters
    ----------
    path : Path
        Text or spreadsheet with positions and times, and perhaps trials or runs side by side.
    said : mapping of str to str
        As `parse_columns`.

    Returns
    -------
    table : DataFrame
        Columns trial, t_s, x_m, y_m.
    notes : tuple of str

    Raises
    ------
    UsageError
        If it can't be read, or its units can't be determined.
    """
    notes: list[str] = []
    if path.suffix.lower() == ".xlsx":
        table = sheet_of(path, notes)
    else:
        table = frame_of(text_lines(path, "a table of samples"), path, _BARE_COLUMNS, notes)
    table = _in_columns(table, notes)
    table, uses = _in_its_plane(table, _uses(table, said, path.name, notes), said, notes)
    marks: list[Marks] = []
    facts: list[dict[str, Any]] = []
    for name, use in uses:
        if "t" not in use.columns:
            raise UsageError(
                f"{path.name} has frame numbers and no times",
                hint="Add a column t (s): the frame number over the camera's rate.",
            )
        for trial, rows in _trials(table, use, name or path.stem):
            runs = _marks(trial, rows, use, said)
            marks += runs
            facts += [_constants(rows)] * len(runs)
    used = {column for _, use in uses for column in use.columns.values()}
    unused = [name for name in map(str, table.columns) if name not in used | {*facts[0]}]
    if unused:
        notes.append(f"{path.name}: not used: {_listed(unused)}.")
    units = _units(path, uses, marks, said)
    if units.metre is None:
        raise UsageError(
            f"{path.name} states no unit of its positions, and its fall shows none",
            hint='Pass --columns "unit=cm" (m, cm, mm, in); pixels need a scale: measure them with'
            " vision measure --from-tracks FILE --tracks TRACKS.csv first.",
        )
    notes += [note for one in marks for note in one.unread()]
    notes += list(dict.fromkeys(one.note for one in marks if one.note)) + list(units.notes)
    parts = [
        _samples_of(one, units).assign(**known) for one, known in zip(marks, facts, strict=True)
    ]
    return pd.concat(parts, ignore_index=True), tuple(notes)


def _constants(rows: pd.DataFrame) -> dict[str, Any]:
    """What a table states of a trial beside its samples."""
    kept = ("ball", "session", "backswing_deg")
    return {name: rows[name].iloc[0] for name in kept if name in rows.columns}


def _trials(table: pd.DataFrame, use: ColumnUse, name: str) -> list[tuple[str, pd.DataFrame]]:
    if "trial" not in use.columns:
        return [(name, table)]
    return [(str(one), rows) for one, rows in table.groupby(use.columns["trial"], sort=False)]


def _samples_of(marks: Marks, units: "_TableScale") -> pd.DataFrame:
    assert marks.time is not None
    assert units.metre is not None
    place = marks.place @ units.axes.T * units.metre
    columns = {"t_s": marks.time * units.second, "x_m": place[:, 0], "y_m": place[:, 1]}
    return pd.DataFrame({"trial": marks.name, **columns}).dropna()


def _names_objects(table: pd.DataFrame, use: ColumnUse, said: Mapping[str, str]) -> bool:
    """Whether a column names objects, rather than numbering the rows."""
    if "object" not in use.columns:
        return False
    return "object" in said or 2 * table[use.columns["object"]].nunique() <= len(table)


@dataclass(frozen=True)
class _TableScale:
    """Units and axes of a table by its heads, or by its fall.

    Attributes
    ----------
    metre : float or None
        Metres per unit; None for pixels.
    second : float
        Factor of the times.
    axes : (2, 2) array
        Turns positions upright.
    notes : tuple of str
    """

    metre: float | None
    second: float = 1.0
    axes: FloatArray = field(default_factory=lambda: np.eye(2))
    notes: tuple[str, ...] = ()


def _units(
    path: Path,
    uses: Sequence[tuple[str, ColumnUse]],
    marks: Sequence[Marks],
    said: Mapping[str, str],
) -> _TableScale:
    """Units of a table; refuse those that its fall contradicts.

    Raises
    ------
    UsageError
        If the flight falls along x, or with gravity in another unit only.
    """
    use = uses[0][1]
    seen = [one.for_units() for one in marks if one.time is not None]
    times = ("s",) if _states_seconds(use, said) else tuple(TIMES_S)
    if use.metre is not None:
        axes, notes = _upright(path, use, seen, use.metre)
        fallen = units_by_fall(seen, tuple(TIMES_S))
        if axes is None and fallen is not None and "unit" not in said:
            _refuse_units(path, use, fallen)
        return _TableScale(use.metre, axes=np.eye(2) if axes is None else axes, notes=notes)
    heads = [one.columns[key] for _, one in uses for key in "xy"]
    if "unit" in said or any(_known_unit(head, "m") is not None for head in heads):
        return _TableScale(None)
    found = units_by_fall(seen, times)
    if found is not None:
        metre = parse_quantity(f"1 {found.length}", "m")
        second = TIMES_S[found.time]
        timed = [(second * time, place) for time, place in seen]
        axes, notes = _upright(path, use, timed, metre)
        said_of = (found.note(path.name), *notes)
        return _TableScale(metre, second, np.eye(2) if axes is None else axes, said_of)
    exchanged = [[(time, sign * place[:, ::-1]) for time, place in seen] for sign in (1.0, -1.0)]
    if any(units_by_fall(one, times) is not None for one in exchanged):
        raise _exchanged(path, use)
    if (unit := unit_of(heads[0])) is not None:
        raise UsageError(
            f"{path}: the unit {unit!r} of {heads[0]!r} is not known",
            hint='Pass --columns "unit=m" (or cm, mm, in, px).',
        )
    return _TableScale(None)


def _upright(
    path: Path, use: ColumnUse, seen: Sequence[tuple[FloatArray, FloatArray]], metre: float
) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Axes of a table by the fall with g of its flight, and a note; None without such a fall.

    Raises
    ------
    UsageError
        If it falls along x.
    """
    found = turn_of_fall(seen, metre)
    if found is None:
        return None, ()
    turn, std = found
    if abs(math.cos(turn)) < math.sqrt(0.5):
        raise _exchanged(path, use)
    axes, notes = np.eye(2), []
    if math.cos(turn) < 0.0:
        axes = np.diag([1.0, -1.0])
        turn = math.copysign(math.pi, turn) - turn
        notes.append(f"{path.name}: the flight falls to larger y: y is taken as pointing down and"
                     " turned over.")  # fmt: skip
    if abs(turn) > MAX_TURN_BY_DRAG_RAD:
        notes.append(
            f"{path.name}: the flight falls {abs(math.degrees(turn)):.1f} ±"
            f" {math.degrees(std):.1f}° off the axis y. Unless that is drag, the axes are not"
            " level: turn them upright where the table was made, and export again."
        )
    return axes, tuple(notes)


MAX_TURN_BY_DRAG_RAD = 0.1
"""Turn of a fall by drag, rad (derived: a tenth of the weight at right angles to it)."""


def _exchanged(path: Path, use: ColumnUse) -> UsageError:
    """Refusal of a table whose flight falls along x."""
    x, y = use.columns["x"], use.columns["y"]
    return UsageError(
        f"{path}: x and y are exchanged: the flight falls along the column {x!r}, not {y!r}",
        hint=f'Pass --columns "x={y}, y={x}".',
    )


def _in_its_plane(
    table: pd.DataFrame,
    uses: list[tuple[str, ColumnUse]],
    said: Mapping[str, str],
    notes: list[str],
) -> tuple[pd.DataFrame, list[tuple[str, ColumnUse]]]:
    """Positions in space, as of motion capture, with y up and x along the path.

    The fall shows which axis points up. Without a fall, or of stated axes, nothing is changed.
    """
    spaces = [use.columns for _, use in uses if "z" in use.columns]
    if len(spaces) < len(uses) or {"x", "y"} & said.keys():
        return table, uses
    falls = {up: max(_fall_along(table, one, up) for one in spaces) for up in "yz"}
    if max(falls.values()) == 0.0:
        return table, uses
    up, side = ("z", "y") if falls["z"] > falls["y"] else ("y", "z")
    level = np.vstack(
        [np.diff(np.column_stack([_values(table, one[axis]) for axis in ("x", side)]), axis=0)
         for one in spaces]
    )  # fmt: skip
    level = level[np.isfinite(level).all(axis=1)]
    turn = math.atan(math.tan(0.5 * math.atan2(*_slope(level))))
    found = []
    for name, use in uses:
        own = use.columns
        if abs(turn) > MAX_DEPTH_TURN_RAD:
            along = f"{own['x']}, along the path"
            x, deep = _values(table, own["x"]), _values(table, own[side])
            table = table.assign(**{along: math.cos(turn) * x + math.sin(turn) * deep})
            own = {**own, "x": along}
        found.append((name, replace(use, columns={**own, "y": own[up]})))
    if up == "z":
        notes.append(f"The flight falls along {spaces[0]['z']!r}: it is read as the height.")
    if abs(turn) > MAX_DEPTH_TURN_RAD:
        notes.append(f"The path runs {math.degrees(turn):.0f}° off {spaces[0]['x']!r}: positions"
                     " along it are used.")  # fmt: skip
    return table, found


def _fall_along(table: pd.DataFrame, columns: Mapping[str, str], up: str) -> float:
    """Downward acceleration of the clearest parabola along an axis, in the table's units."""
    clock = columns.get("t") or columns["frame"]
    rows = np.column_stack([_values(table, columns[key]) for key in ("x", up)])
    time = _values(table, clock)
    known = np.isfinite(rows).all(axis=1) & np.isfinite(time)
    time, first = np.unique(time[known], return_index=True)
    found = find_fall(time, rows[known][first]) if len(time) >= MIN_FALL_ROWS else None
    return 0.0 if found is None else max(0.0, -float(found.acceleration[1]))


def _slope(steps: FloatArray) -> tuple[float, float]:
    """Sine and cosine, times a factor, of twice the angle of the direction of most steps."""
    u, v = steps.T
    return 2.0 * float(u @ v), float(u @ u - v @ v)


MAX_DEPTH_TURN_RAD = 0.05
"""Turn of a path off x that is left alone, rad (derived: it shortens x by 0.1 %)."""

_HEIGHTS = frozenset(("z", "z_m", "z_cm", "z_mm", "pos_z", "z_pos", "position_z"))
"""Names of a third dimension, without units."""


def _refuse_units(path: Path, use: ColumnUse, fallen: TableUnits) -> None:
    """Refuse units in the heads with which the flight does not fall with gravity.

    Raises
    ------
    UsageError
    """
    assert use.metre is not None
    wrong, cure = [], []
    if use.metre != parse_quantity(f"1 {fallen.length}", "m"):
        wrong.append(f"{use.columns['x']!r} is in {fallen.length}")
        cure.append(f"unit={fallen.length}")
    if fallen.time != "s":
        wrong.append(f"{use.columns['t']!r} is in {fallen.time}")
        cure.append(f"t_unit={fallen.time}")
    if not wrong:
        return
    metres = fallen.acceleration * use.metre
    slower = math.sqrt(Defaults.GRAVITY.known / metres)
    unit = unit_of(use.columns["x"]) or "m"
    raise UsageError(
        f"{path}: the unit in the head does not fit: the flight falls with {metres:.3g} m/s²;"
        f" {' and '.join(wrong)}",
        hint=f'Pass --columns "{", ".join(cure)}". If the head is right and the times are those of'
        f" a playback {slower:.3g} times slower: --columns unit={unit} and --fps with the camera's"
        " rate.",
    )


def _marks(name: str, rows: pd.DataFrame, use: ColumnUse, said: Mapping[str, str]) -> list[Marks]:
    """The runs of an object's rows, in seconds."""
    place = np.column_stack([_values(rows, use.columns[key]) for key in "xy"])
    place *= [1.0, use.stretch]
    frame = _values(rows, use.columns["frame"]) if "frame" in use.columns else None
    if "t" not in use.columns:
        return settled(Marks(name, place, frame, None))
    column = use.columns["t"]
    timecode = read_timecode(rows[column])
    if timecode is not None:
        numbers, rate = timecode
        note = f"The times are timecodes, {rate} to a second: they are read as picture numbers."
        return settled(Marks(name, place, numbers, None, note))
    clock = read_clock(rows[column], said.get("t_unit") or _known_unit(column, "s"))
    if clock is not None:
        return settled(Marks(name, place, frame, clock.seconds, clock.note))
    return settled(Marks(name, place, frame, _values(rows, column) * use.second))


def _states_seconds(use: ColumnUse, said: Mapping[str, str]) -> bool:
    stated = "t_unit" in said or "t" not in use.columns
    return stated or _known_unit(use.columns["t"], "s") is not None


def _uses(
    table: pd.DataFrame, said: Mapping[str, str], name: str, notes: list[str]
) -> list[tuple[str, ColumnUse]]:
    """Use of the columns for each object that has its own ones, with its name.

    Raises
    ------
    UsageError
        As `column_use`.
    """
    header = list(map(str, table.columns))
    try:
        return [("", column_use(header, said, name))]
    except UsageError:
        pairs = () if {"x", "y"} & said.keys() else positions_of(header)
        if not pairs or (time_column(header) is None and not {"t", "frame"} & said.keys()):
            guessed = _guessed(table, said, name, notes)
            if guessed is not None:
                return [("", guessed)]
        if not pairs:
            raise
        stated = dict(said)
        clock = time_column(header)
        if clock is not None and not {"t", "frame"} & stated.keys():
            stated["t"] = clock
        return [(pair.name, _use_of(pair, header, stated, name)) for pair in pairs]


def _guessed(
    table: pd.DataFrame, said: Mapping[str, str], name: str, notes: list[str]
) -> ColumnUse | None:
    """Use of columns whose names say nothing, by their fall; of a single position, as stated."""
    header = list(map(str, table.columns))
    found = dict(said) if {"x", "y"} & said.keys() else {**said, **(by_fall(table) or {})}
    clock = time_column(header)
    if clock is not None and not {"t", "frame"} & found.keys():
        found["t"] = clock
    places = {"x", "y"} & found.keys()
    others = numeric_columns(table).keys() - {found.get(key) for key in KEYS}
    if not places or (len(places) == 1 and others):
        return None
    listed = ", ".join(f"{key}={found[key]}" for key in KEYS if key in found)
    notes.append(f'{name}: its columns are read as --columns "{listed}" states.')
    added = along_a_line(table, found, unit_of(found[next(iter(places))]))
    if added is not None:
        notes[-1] = f"{notes[-1][:-1]}; there is no {added}: the motion is along a line."
        found[added] = str(table.columns[-1])
    return column_use(list(map(str, table.columns)), found, name)


def _use_of(
    pair: AxisColumns, header: Sequence[str], said: Mapping[str, str], table: str
) -> ColumnUse:
    own = {} if pair.t is None or {"t", "frame"} & said.keys() else {"t": pair.t}
    use = column_use(header, {**said, **own, "x": pair.x, "y": pair.y}, table)
    return use if pair.z is None else replace(use, columns={**use.columns, "z": pair.z})


def _trackpy(table: pd.DataFrame, path: Path) -> ExternalTracks:
    parts = [("particle", table)]
    if "particle" in table:
        parts = [(f"particle {name:g}", rows) for name, rows in table.groupby("particle")]
    tracks = []
    for name, rows in parts:
        # trackpy's size is a radius of gyration of the brightness, not of the outline
        extra = {}
        if "ep" in rows and np.isfinite(_values(rows, "ep")).all():
            extra["std_px"] = np.repeat(_values(rows, "ep")[:, np.newaxis], 2, axis=1)
        place = np.column_stack([_values(rows, "x"), _values(rows, "y")])
        tracks.append(_track(name, place, _values(rows, "frame"), None, extra))
    return _found(path, Program.TRACKPY, tracks)


def _own(table: pd.DataFrame, path: Path) -> ExternalTracks:
    tracks = []
    for name, rows in table.groupby("object", sort=False):
        extra = {}
        if {"x_px_std", "y_px_std"} <= set(rows.columns):
            extra["std_px"] = np.column_stack([_values(rows, f"{key}_px_std") for key in "xy"])
        if "radius_px" in rows:
            extra["radius_px"] = _values(rows, "radius_px")
        place = np.column_stack([_values(rows, "x_px"), _values(rows, "y_px")])
        if set(CAMERA_COLUMNS) <= set(rows.columns):
            place -= np.column_stack([_values(rows, name) for name in CAMERA_COLUMNS])
        tracks.append(_track(str(name), place, _values(rows, "frame"), _values(rows, "t_s"), extra))
    return _found(path, Program.IMPACT_VISION, tracks)


def _tracker_text(lines: Sequence[str], path: Path, said: Mapping[str, str]) -> ExternalTracks:
    """Tracker's File > Export > Data File: names of the masses, then t and their columns."""
    at = 1 if lines[0].startswith("#multi") else 0
    mark = separator_of(lines[at + 1])
    heads = [part.strip() for part in re.split(mark, lines[at + 1].strip(" \r\n"))]
    while heads and not heads[-1]:
        heads.pop()
    over = [part.strip() for part in re.split(mark, lines[at])]
    stated = said.get("unit")
    table = pd.DataFrame(
        [
            [part.strip() for part in re.split(mark, line.strip(" \r\n"))][: len(heads)]
            for line in lines[at + 2 :]
        ]
    )
    table = with_numbers(table.replace("", None))
    time = even_clock(_values(table, 0))  # type: ignore[arg-type]
    marks: list[Marks] = []
    plane = None
    for name, first, end in _spans(over, heads):
        own = {_head(head): first + k for k, head in enumerate(heads[first:end])}
        frame = _values(table, own["frame"]) if "frame" in own else None  # type: ignore[arg-type]
        if {"pixelx", "pixely"} <= own.keys():
            kind, shift = ("pixelx", "pixely"), PIXEL_CORNER
        else:
            kind, shift = ("x", "y"), 0.0
        if not set(kind) <= own.keys():
            raise UsageError(
                f"{path}: the columns of {name} contain no x and y",
                hint="In Tracker, show x and y (or pixelx and pixely) in the table, and export.",
            )
        place = np.column_stack([_values(table, own[part]) for part in kind])  # type: ignore[arg-type]
        if shift == 0.0:
            plane = _table_plane()
            stated = stated or unit_of(heads[own["x"]])
        clock = even_clock(_values(table, own["t"])) if "t" in own else time  # type: ignore[arg-type]
        marks.append(Marks(name, place - shift, frame, clock))
    notes: list[str] = []
    metre = 1.0
    if plane is not None:
        metre, notes = _tracker_unit(marks, stated, path.name)
    tracks = []
    for one in marks:
        notes += one.unread()
        place = one.place if plane is None else plane.pixels(one.place * metre)
        tracks.append(_track(one.name, place, one.frame, one.time))
    return _found(path, Program.TRACKER, tracks, plane, notes)


def _tracker_unit(
    marks: Sequence[Marks], stated: str | None, table: str
) -> tuple[float, list[str]]:
    """Metres per unit: stated, by free fall, or the metre, which is Tracker's default."""
    if stated is not None:
        return parse_quantity(f"1 {stated}", "m"), []
    found = units_by_fall([one.for_units() for one in marks])
    if found is None or found.length == "m":
        return 1.0, []
    return parse_quantity(f"1 {found.length}", "m"), [found.note(table)]


def _head(head: str) -> str:
    """A column's name without its unit."""
    return re.sub(r"\s*[\(\[].*", "", head).strip()


def _spans(over: Sequence[str], heads: Sequence[str]) -> list[tuple[str, int, int]]:
    """Name, first and end column of each mass: names stand above their first column."""
    names = [(name, at) for at, name in enumerate(over) if name] or [("mass A", 1)]
    clocks = [at for at, head in enumerate(heads) if _head(head) == "t"]
    # with a clock for each mass its columns begin there
    starts = clocks if 1 < len(clocks) == len(names) else [at for _, at in names]
    ends = [*starts[1:], len(heads)]
    found = [(name, at, end) for (name, _), at, end in zip(names, starts, ends, strict=True)]
    if (starts[0] >= 1 or starts == clocks) and all(
        {"x", "pixelx"} & set(map(_head, heads[at:end])) for _, at, end in found
    ):
        return found
    width = max(1, (len(heads) - 1) // len(names))
    return [(name, 1 + k * width, 1 + (k + 1) * width) for k, (name, _) in enumerate(names)]


def _metre(said: Mapping[str, str]) -> float:
    """Metres per unit of a program's export; Tracker's default is the metre."""
    return parse_quantity(f"1 {said.get('unit', 'm')}", "m")


def _clock_s(text: str) -> float:
    """Seconds of ``7.25``, or of Kinovea's ``1:07.25`` above one minute.

    Raises
    ------
    ValueError
        For anything else: the last part of ``0:00:07:25`` may be hundredths or frames.
    """
    *minutes, seconds = text.split(":")
    if len(minutes) > 2:
        raise ValueError(text)
    return float(seconds) + sum(
        60.0**power * int(part) for power, part in enumerate(reversed(minutes), start=1)
    )


def _kinovea_text(lines: Sequence[str], path: Path, said: Mapping[str, str]) -> ExternalTracks:
    """Kinovea's Export to spreadsheet > Gnuplot: blocks of ``t x y``, y up."""
    blocks: list[tuple[str, list[list[float]]]] = [("track 1", [])]
    for line in lines:
        if line.startswith("#"):
            title = line.lstrip("# ").strip()
            if title.lower().startswith("kinovea") or title == "T X Y":
                continue
            blocks.append((title, []))
            continue
        parts = line.replace(",", ".").split()
        try:
            blocks[-1][1].append([_clock_s(parts[0]), *map(float, parts[1:3])])
        except ValueError as problem:
            raise UsageError(
                f"{path}: {line.strip()!r} is not a row of T X Y"
                + (
                    f"; the time {parts[0]} may count hundredths or pictures" if ":" in line else ""
                ),
                hint="Choose times in seconds in Kinovea's preferences and export again.",
            ) from problem
    unit = said.get("unit", "px")
    in_px = unit.lower() in ("px", "pixel", "pixels")
    plane = None if in_px else _table_plane()
    tracks = []
    for name, rows in blocks:
        table = np.array([row for row in rows if len(row) == 3], dtype=float).reshape(-1, 3)
        place = table[:, 1:] * [1.0, -1.0]
        if plane is not None:
            place = plane.pixels(table[:, 1:] * _metre(said))
        tracks.append(_track(name, place, None, table[:, 0]))
    notes = () if "unit" in said else ("Kinovea's text states no unit; pixels are assumed.",)
    return _found(path, Program.KINOVEA, tracks, plane, notes)


def _deeplabcut(lines: Sequence[str], path: Path, said: Mapping[str, str]) -> ExternalTracks:
    """Three header lines (four with several animals): scorer, bodyparts, coords."""
    mark = separator_of(lines[0])
    rows = next((k for k, line in enumerate(lines[:5]) if line.startswith("coords")), None)
    if rows is None:
        raise UsageError(
            f"{path} has no line `coords`, which DeepLabCut writes",
            hint="Pass the CSV file of analyze_videos, with its three header lines.",
        )
    heads = [line.split(mark) for line in lines[1 : rows + 1]]
    table, frame = _numbers_of(lines[rows + 1 :], mark, path)
    count = min(len(head) for head in heads)
    named = [tuple(head[k].strip() for head in heads) for k in range(1, count)]
    return _body_parts(named, table[:, 1:], frame, path)


def _body_parts(
    heads: Sequence[tuple[str, ...]], values: FloatArray, frame: FloatArray, path: Path
) -> ExternalTracks:
    """Tracks of DeepLabCut's columns, each named by (individual and) body part, and coordinate."""
    columns: dict[str, dict[str, int]] = {}
    for k, (*part, coordinate) in enumerate(heads):
        columns.setdefault(" ".join(part), {})[coordinate] = k
    tracks, ignored = [], 0
    for name, own in columns.items():
        if not {"x", "y"} <= own.keys():
            continue
        place = values[:, [own["x"], own["y"]]]
        if "likelihood" in own:
            unsure = values[:, own["likelihood"]] < MIN_LIKELIHOOD
            ignored += int(unsure.sum())
            place = np.where(unsure[:, np.newaxis], np.nan, place)
        tracks.append(_track(name, place, frame))
    notes = (f"{ignored} marks with a likelihood below {MIN_LIKELIHOOD:g} are ignored.",)
    return _found(path, Program.DEEPLABCUT, tracks, None, notes if ignored else ())


def _numbers_of(lines: Sequence[str], mark: str, path: Path) -> tuple[FloatArray, FloatArray]:
    """Cells as numbers, and picture numbers: the first column, or those of the pictures' names."""
    try:
        table = with_numbers(pd.read_csv(io.StringIO("\n".join(lines)), sep=mark, header=None))
    except (ValueError, pd.errors.ParserError) as problem:
        raise UsageError(
            f"{path} is cut off or not a table: {problem}",
            hint="Save it again with the program that made it.",
        ) from problem
    values = np.asarray(table.apply(pd.to_numeric, errors="coerce"), dtype=float)
    if np.isfinite(values[:, 0]).any():
        return values, values[:, 0]
    # labelled pictures: folder, clip and name in one column or in three
    named = table.select_dtypes(exclude="number").astype("string").agg("/".join, axis=1)
    return values, np.asarray(pd.to_numeric(named.str.extract(r"(\d+)\D*$")[0]), dtype=float)


def _sleap(lines: Sequence[str], path: Path, said: Mapping[str, str]) -> ExternalTracks:
    """``sleap-convert --format analysis.csv``: a row per animal and frame, NODE.x, NODE.y."""
    table = frame_of(lines, path)
    nodes = [name[:-2] for name in table.columns if name.endswith(".x")]
    tracks = []
    parts = [("", table)]
    if "track" in table and table["track"].notna().any():
        parts = [(f"{name} ", rows) for name, rows in table.groupby("track")]
    for animal, rows in parts:
        for node in nodes:
            place = np.column_stack([_values(rows, f"{node}.{key}") for key in "xy"])
            tracks.append(_track(f"{animal}{node}", place, _values(rows, "frame_idx")))
    return _found(path, Program.SLEAP, tracks)


def _hdf5(path: Path) -> ExternalTracks:
    """SLEAP's analysis file, or what DeepLabCut writes with pandas."""
    try:
        import h5py
    except ImportError as problem:
        raise UsageError(
            f"{path}: reading HDF5 needs the package h5py",
            hint="pip install 'impact-vision[sleap]' (for DeepLabCut, too), or pass a CSV file:"
            " DeepLabCut writes one next to it; sleap-convert --format analysis.csv.",
        ) from problem
    try:
        with h5py.File(path) as file:
            if "tracks" in file:
                return _sleap_h5(file, path)
            for group in file.values():
                if isinstance(group, h5py.Group) and "pandas_type" in group.attrs:
                    return _deeplabcut_h5(group, path)
    except UsageError:
        raise
    # h5py passes on what the library and damaged contents raise
    except (OSError, RuntimeError, ValueError, TypeError, LookupError) as problem:
        raise UsageError(
            f"{path} is not a complete HDF5 file: {problem}",
            hint="Export it again, or pass the CSV file that DeepLabCut writes next to it.",
        ) from problem
    raise UsageError(
        f"{path} is neither an analysis file of SLEAP nor DeepLabCut's",
        hint="Pass the .h5 file of DeepLabCut's analyze_videos, or of sleap-convert --format"
        " analysis.",
    )


def _deeplabcut_h5(group: Any, path: Path) -> ExternalTracks:
    """A table of pandas with the levels scorer, (individuals,) bodyparts and coords."""
    heads, values, frames = _pandas_table(group)
    if not heads or len(heads) != values.shape[1] or len(frames) != len(values):
        raise UsageError(
            f"{path}: its table can't be read",
            hint="Pass the CSV file that DeepLabCut writes next to it.",
        )
    return _body_parts([head[1:] for head in heads], values, frames, path)


def _pandas_table(group: Any) -> tuple[list[tuple[str, ...]], FloatArray, FloatArray]:
    """Names of the columns, cells and row numbers of a stored table, without unpickling."""
    if "table" in group:
        rows = np.asarray(group["table"])
        values = np.asarray(rows["values_block_0"], dtype=float)
        # The names are a pickle: its strings are read, nothing in it is called.
        words = [
            str(argument)
            for _, argument, _ in pickletools.genops(bytes(group.attrs["non_index_axes"]))
            if isinstance(argument, str)
        ]
        return _heads_of(words, values.shape[1]), values, np.asarray(rows["index"], dtype=float)
    levels = int(group.attrs["axis0_nlevels"])
    names = [
        [bytes(one).decode("utf-8", "replace") for one in np.asarray(group[f"axis0_level{k}"])]
        for k in range(levels)
    ]
    labels = [np.asarray(group[f"axis0_label{k}"]) for k in range(levels)]
    heads = [
        tuple(name[int(label[j])] for name, label in zip(names, labels, strict=True))
        for j in range(len(labels[0]))
    ]
    values = np.asarray(group["block0_values"], dtype=float)
    return heads, values, np.asarray(group["axis1"], dtype=float)


def _heads_of(words: Sequence[str], count: int) -> list[tuple[str, ...]]:
    """Names of columns from the strings of a pickle, which stores a repeated one once."""
    coords = [word for word in words if word in ("x", "y", "likelihood")]
    parts = [word for word in words if word not in ("x", "y", "likelihood") and word.isprintable()]
    kinds = list(dict.fromkeys(coords))
    # The first string is the scorer; the others are the body parts in order.
    named = list(dict.fromkeys(parts))
    if len(kinds) * (len(named) - 1) != count:
        return []
    return [(named[0], part, kind) for part in named[1:] for kind in kinds]


def _sleap_h5(file: Any, path: Path) -> ExternalTracks:
    """SLEAP's analysis HDF5: ``tracks`` (animals, 2, nodes, frames)."""
    places = np.asarray(file["tracks"], dtype=float)
    names = [
        [bytes(one).decode("utf-8", "replace") for one in np.asarray(file[key]).ravel()]
        if key in file
        else []
        for key in ("track_names", "node_names")
    ]
    if places.ndim != 4 or places.shape[1] != 2:
        raise UsageError(
            f"{path}: `tracks` is not (animals, 2, nodes, frames)",
            hint="Export it again: sleap-convert --format analysis.",
        )
    frame = np.arange(places.shape[3], dtype=float)
    tracks = []
    for animal, per_node in enumerate(places):
        first = f"{names[0][animal]} " if len(places) > 1 and animal < len(names[0]) else ""
        for node in range(places.shape[2]):
            last = names[1][node] if node < len(names[1]) else f"node {node}"
            tracks.append(_track(f"{first}{last}", per_node[:, node].T, frame))
    return _found(path, Program.SLEAP, tracks)


_Reader = Callable[[Sequence[str], Path, Mapping[str, str]], ExternalTracks]

_TABLE_READERS: tuple[tuple[Callable[[Sequence[str]], bool], _Reader], ...] = (
    (_is_kinovea_text, _kinovea_text),
    (_is_deeplabcut, _deeplabcut),
    (_is_tracker_text, _tracker_text),
    (_is_sleap, _sleap),
)
