"""The results of a campaign as one table: a row per clip, the lab book's columns first."""

import csv
import io
import itertools
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from metrology import UsageError, write_text_whole
from metrology.files import written_whole
from pipelines.campaign.lab_book import CLIP_COLUMN, SENSORS, LabBook, LabBookRow
from pipelines.campaign.ledger import Entry, State
from pipelines.measure.files.output import column_name, harmless

__all__ = ["ANALYSED", "ClipResult", "clip_results", "results_frame", "write_tables"]

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
"""Quantities that the analysis of a campaign looks at; the tables hold all."""
_ROWS_AT_ONCE = 1000
"""Rows written in one transaction: a second of work is lost at most."""


@dataclass(frozen=True)
class ClipResult:
    """What the analysis needs of one clip, small enough for a hundred thousand of them.

    Attributes
    ----------
    clip : str
    state : State
    error, excluded : str or None
    seconds : float or None
    strike : LabBookRow or None
    values : (Q, 2) array
        Value and standard uncertainty of each of `ANALYSED`; nan where not measured.
    shared : mapping of str to float
        Lines of the COR's budget that all clips of one setup have in common.
    warnings : tuple of str
    """

    clip: str
    state: State
    error: str | None
    excluded: str | None
    seconds: float | None
    strike: LabBookRow | None
    values: FloatArray
    shared: Mapping[str, float]
    warnings: tuple[str, ...]

    @property
    def used(self) -> bool:
        """Whether it was measured and nobody marked it as bad."""
        return self.state == State.DONE and self.excluded is None

    @property
    def ball(self) -> str:
        """Name of the ball; empty where nobody said."""
        return "" if self.strike is None or self.strike.ball is None else self.strike.ball

    @property
    def session(self) -> str:
        """Name of the session; empty where nobody said."""
        return "" if self.strike is None or self.strike.session is None else self.strike.session

    def quantity(self, name: str) -> tuple[float, float]:
        """Value and standard uncertainty of one of `ANALYSED`; nan where not measured."""
        value, std = self.values[ANALYSED.index(name)]
        return float(value), float(std)


def clip_results(
    entries: Iterable[Entry], strikes: Mapping[str, LabBookRow | None]
) -> list[ClipResult]:
    """Join ledger and lab book by the clip's name."""
    return [
        _result(entry, strikes[entry.order.clip])
        for entry in entries
        if entry.order.clip in strikes
    ]


def _result(entry: Entry, strike: LabBookRow | None) -> ClipResult:
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
        seconds=entry.seconds,
        strike=strike,
        values=values,
        shared={line["source"]: float(line["std"]) for line in lines if line.get("shared")},
        warnings=tuple(map(sys.intern, document.get("warnings", ()))),
    )


def _row(entry: Entry, strike: LabBookRow | None, columns: tuple[str, ...]) -> dict[str, object]:
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
    row["excluded"] = entry.excluded
    return row


def results_frame(
    entries: Iterable[Entry], strikes: Mapping[str, LabBookRow | None], book: LabBook | None
) -> pd.DataFrame:
    """One row per clip that is done or failed; columns in the contract's order."""
    columns = ("clip",) if book is None else book.columns
    rows = (
        _row(entry, strikes[entry.order.clip], columns)
        for entry in entries
        if entry.order.clip in strikes and entry.state in (State.DONE, State.FAILED)
    )
    parts = [pd.DataFrame(part) for part in _batches(rows)]
    if not parts:
        return pd.DataFrame({name: pd.Series(dtype=object) for name in ("clip", "state", "error")})
    # each part alone decides its columns' types: what is empty there says nothing of the others
    frame = pd.concat([part.dropna(axis="columns", how="all") for part in parts])
    frame = frame.reindex(columns=list(dict.fromkeys(name for part in parts for name in part)))
    tail = ["motion", *[name for name in frame if str(name).startswith("reason_")]]
    tail += ["warnings", "state", "error", "excluded"]
    frame = frame[[*[name for name in frame if name not in tail], *tail]].reset_index(drop=True)
    numbers = {sensor.column for sensor in SENSORS} | {"backswing_deg"}
    for name in map(str, frame.columns):
        if name in numbers or name.endswith("_std"):
            frame[name] = pd.to_numeric(frame[name])
    return frame


def _batches(rows: Iterator[dict[str, object]]) -> Iterator[list[dict[str, object]]]:
    while batch := list(itertools.islice(rows, _ROWS_AT_ONCE)):
        yield batch


def write_tables(frame: pd.DataFrame, folder: Path) -> None:
    """Write ``results.csv``, ``.xlsx`` and ``.parquet``, each whole or not at all.

    Raises
    ------
    UsageError
        If the disk is full or the folder can't be written to.
    """
    texts = frame.select_dtypes(include=["object", "string"]).columns
    plain = pd.DataFrame(
        [
            harmless({str(name): cell for name, cell in row.items()})
            for row in frame.to_dict("records")
        ],
        columns=frame.columns,
    )
    buffer = io.StringIO()
    plain.to_csv(buffer, index=False, lineterminator="\n", quoting=csv.QUOTE_MINIMAL)
    try:
        write_text_whole(folder / "results.csv", buffer.getvalue())
        with written_whole(folder / "results.xlsx") as temporary:
            plain.to_excel(temporary, index=False, sheet_name="results")
        with written_whole(folder / "results.parquet") as temporary:
            _storable(frame, texts).to_parquet(temporary, index=False)
    except OSError as problem:
        raise UsageError(
            f"can't write the results to {folder}: {problem.strerror}",
            hint="Make room on the disk and give the same command again: the ledger has them.",
        ) from problem


def _storable(frame: pd.DataFrame, texts: Iterable[object]) -> pd.DataFrame:
    """Columns of one type each, as parquet wants them."""
    kept = frame.copy()
    for name in texts:
        filled = kept[name].dropna()
        if filled.map(lambda cell: isinstance(cell, int | float)).all():
            kept[name] = pd.to_numeric(kept[name])
        else:
            kept[name] = kept[name].map(lambda cell: None if cell is None else str(cell))
    return kept
