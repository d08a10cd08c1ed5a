"""The results of a campaign as one table: a row per clip, the lab book's columns first."""

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from metrology import UsageError, write_text_whole
from metrology.files import written_whole
from pipelines.campaign.lab_book import SENSORS, LabBook, Strike
from pipelines.campaign.ledger import Entry, State
from pipelines.measure.files.output import column_name, harmless

__all__ = ["ClipResult", "clip_results", "results_frame", "write_tables"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ClipResult:
    """What is known of one clip, from the ledger and the lab book.

    Attributes
    ----------
    entry : Entry
    strike : Strike or None
    """

    entry: Entry
    strike: Strike | None

    @property
    def clip(self) -> str:
        """Name of the clip."""
        return self.entry.order.clip

    @property
    def used(self) -> bool:
        """Whether it was measured and nobody marked it as bad."""
        return self.entry.state == State.DONE and self.entry.excluded is None

    @property
    def ball(self) -> str:
        """Name of the ball; empty where nobody said."""
        return "" if self.strike is None or self.strike.ball is None else self.strike.ball

    @property
    def session(self) -> str:
        """Name of the session; empty where nobody said."""
        return "" if self.strike is None or self.strike.session is None else self.strike.session

    def quantity(self, name: str) -> tuple[float, float]:
        """Value and standard uncertainty; nan where not measured."""
        item = self._quantities.get(name, {})
        if item.get("value") is None:
            return np.nan, np.nan
        return float(item["value"]), float(item["std"])

    def shared(self, name: str) -> dict[str, float]:
        """Lines of the quantity's budget that all clips of one setup have in common."""
        lines = self._document.get("budget", {}).get(name, [])
        return {line["source"]: float(line["std"]) for line in lines if line.get("shared")}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the measurement."""
        return tuple(self._document.get("warnings", ()))

    @property
    def _document(self) -> Mapping[str, Any]:
        return self.entry.document or {}

    @property
    def _quantities(self) -> Mapping[str, Any]:
        found: Mapping[str, Any] = self._document.get("quantities", {})
        return found

    def row(self, columns: tuple[str, ...]) -> dict[str, object]:
        """Row of the results, `columns` of the lab book first."""
        cells = {} if self.strike is None else self.strike.cells
        row: dict[str, object] = {"clip": self.clip}
        row |= {name: cells.get(name) for name in columns if name != "clip"}
        reasons: dict[str, object] = {}
        for name, item in self._quantities.items():
            column = column_name(name, item["unit"])
            row[column], row[f"{column}_std"] = item.get("value"), item.get("std")
            if item.get("value") is None:
                reasons[f"reason_{name}"] = item.get("reason")
        motion = self._document.get("motion") or {}
        row["motion"] = motion.get("kind")
        row |= reasons
        row["warnings"] = " | ".join(self.warnings) or None
        row["state"], row["error"] = str(self.entry.state), self.entry.error
        row["excluded"] = self.entry.excluded
        return row


def clip_results(
    entries: Iterable[Entry], strikes: Mapping[str, Strike | None]
) -> list[ClipResult]:
    """Join ledger and lab book by the clip's name."""
    return [
        ClipResult(entry, strikes.get(entry.order.clip))
        for entry in entries
        if entry.order.clip in strikes
    ]


def results_frame(results: Iterable[ClipResult], book: LabBook | None) -> pd.DataFrame:
    """One row per clip that is done or failed; columns in the contract's order."""
    columns = ("clip",) if book is None else book.columns
    rows = [
        result.row(columns)
        for result in results
        if result.entry.state in (State.DONE, State.FAILED)
    ]
    if not rows:
        return pd.DataFrame({name: pd.Series(dtype=object) for name in ("clip", "state", "error")})
    frame = pd.DataFrame(rows)
    tail = ["motion", *[name for name in frame if str(name).startswith("reason_")]]
    tail += ["warnings", "state", "error", "excluded"]
    head = [name for name in frame if name not in tail]
    frame = frame[[*head, *tail]]
    numbers = {sensor.column for sensor in SENSORS} | {"backswing_deg"}
    for name in map(str, frame.columns):
        if name in numbers or name.endswith("_std"):
            frame[name] = pd.to_numeric(frame[name])
    return frame


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
