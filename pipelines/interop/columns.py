"""What the columns of somebody's table mean: recognised, said with --columns, or asked once."""

import csv
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import tomli_w

from metrology import UsageError, parse_quantity, write_text_whole
from pipelines.terminal import screen

__all__ = ["ColumnUse", "ask_columns", "column_use", "keep_columns", "parse_columns"]

KEYS = {
    "t": "the time",
    "frame": "the picture's number, from 0",
    "x": "the position to the right",
    "y": "the position up (of pixels: down)",
    "object": "the name of what was tracked, where a table holds several",
    "trial": "the name of the trial, where a table holds several",
}
"""Columns that may be named, and what each holds."""
WORDS = {
    "ball": "name of the track that is the ball",
    "pendulum": "name of the track that is the pendulum's mass",
    "unit": "unit of x and y: px, m, cm, mm, …",
    "t_unit": "unit of the time: s or ms",
}
"""Further keys, whose values are no columns."""

_KNOWN = {
    "t": ("t", "t_s", "time", "time_s", "times", "zeit", "temps", "tiempo", "tempo"),
    "frame": ("frame", "frame_idx", "frame_index", "frame_number", "frames", "bild", "image"),
    "x": ("x", "x_m", "x_cm", "x_mm", "x_px", "pos_x", "posx", "px", "pixelx", "x_pos"),
    "y": ("y", "y_m", "y_cm", "y_mm", "y_px", "pos_y", "posy", "py", "pixely", "y_pos"),
    "object": ("object", "track", "particle", "particle_id", "id", "name"),
    "trial": ("trial",),
}
"""Names that mean what they say in every table seen; whatever else is asked for."""
_UNIT = re.compile(r"[\(\[]\s*([^)\]]+?)\s*[\)\]]|[_ ](px|mm|cm|m|ms|s|in|ft)$", re.IGNORECASE)


@dataclass(frozen=True)
class ColumnUse:
    """Which column holds what.

    Attributes
    ----------
    columns : mapping of str to str
        By the keys of `KEYS`; x and y are always there, and t or frame.
    metre : float or None
        Metres per unit of x and y; None where they are pixels.
    second : float
        Seconds per unit of t.
    """

    columns: Mapping[str, str]
    metre: float | None
    second: float


def parse_columns(text: str | None) -> dict[str, str]:
    """``"t=Zeit (s), x=X (cm), ball=masa A"`` as a mapping.

    Raises
    ------
    UsageError
        If it is not of that form, or a key means nothing here.
    """
    found: dict[str, str] = {}
    for part in next(csv.reader([text or ""], skipinitialspace=True), []):
        key, _, value = part.partition("=")
        key, value = key.strip(), value.strip()
        if not part.strip():
            continue
        if key not in KEYS | WORDS or not value:
            known = ", ".join([*KEYS, *WORDS])
            raise UsageError(
                f"--columns: {part.strip()!r} is not KEY=NAME",
                hint=f"KEY is one of {known}; as in --columns 't=Time (s), x=X (cm), y=Y (cm)'.",
            )
        found[key] = value
    return found


def column_use(header: Sequence[str], said: Mapping[str, str], table: str) -> ColumnUse:
    """Find out which column is which.

    Parameters
    ----------
    header : sequence of str
    said : mapping of str to str
        As `parse_columns`; goes before what a name seems to mean.
    table : str
        What to call the table in a message.

    Raises
    ------
    UsageError
        If a column that was said is not there, or one that is needed can't be told.
    """
    columns: dict[str, str] = {}
    for key in KEYS:
        if key in said:
            if said[key] not in header:
                raise UsageError(
                    f"{table} has no column {said[key]!r}", hint=f"It has: {_listed(header)}."
                )
            columns[key] = said[key]
            continue
        alike = [name for name in header if _plain(name) in _KNOWN[key]]
        if len(alike) == 1:
            columns[key] = alike[0]
    missing = [key for key in ("x", "y") if key not in columns]
    if "t" not in columns and "frame" not in columns:
        missing.append("t")
    if missing:
        example = ", ".join(f"{key}=NAME" for key in missing)
        raise UsageError(
            f"{table} does not say which column is {' and which is '.join(missing)};"
            f" it has {_listed(header)}",
            hint=f'Say it: --columns "{example}", or in the table [columns] of the setup file.',
        )
    unit = said.get("unit") or _unit_of(columns["x"]) or "px"
    t_unit = said.get("t_unit") or _unit_of(columns.get("t", "t")) or "s"
    metre = None if unit.lower() in ("px", "pixel", "pixels") else parse_quantity(f"1 {unit}", "m")
    return ColumnUse(columns, metre, parse_quantity(f"1 {t_unit}", "s"))


def ask_columns(header: Sequence[str], said: Mapping[str, str], table: str) -> dict[str, str]:
    """Ask on the terminal for what `column_use` can't tell; nothing where there is no terminal.

    Returns
    -------
    dict of str to str
        What was said before, with the answers.
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
    """Add the table ``[columns]`` to a setup file that has none; the rest of it stays as it is."""
    text = setup.read_text(encoding="utf-8").rstrip()
    write_text_whole(setup, f"{text}\n\n" + tomli_w.dumps({"columns": dict(columns)}))


def _unanswered(key: str, header: Sequence[str], answers: Mapping[str, str]) -> bool:
    if key in answers or (key == "t" and "frame" in answers):
        return False
    return sum(_plain(name) in _KNOWN[key] for name in header) != 1


def _plain(name: str) -> str:
    """A column's name without its unit in brackets, in lower case."""
    bare = re.sub(r"[\(\[].*?[\)\]]", "", name).strip().lower()
    return re.sub(r"[ \-.]+", "_", bare)


def _unit_of(name: str) -> str | None:
    found = _UNIT.search(name.strip())
    return None if found is None else (found[1] or found[2])


def _listed(header: Sequence[str]) -> str:
    shown = ", ".join(repr(name) for name in header[:12])
    return shown + (f" and {len(header) - 12} more" if len(header) > 12 else "")
