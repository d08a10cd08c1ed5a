"""Tables with a few numbers per trial: read, and held against the setup's model."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from metrology import UsageError
from mismatch.table.explain import TableExplained, explain_table
from mismatch.table.table import CHANNELS, TrialTable
from physics.arrays import FloatArray
from physics.effects import Effect
from pipelines.explain.io import baseline_for_balls
from pipelines.explain.tabular import TableLike, read_table
from pipelines.setup.file import Setup

__all__ = ["explain_trial_table", "is_trial_table", "load_trial_table"]

COLUMNS = {
    "impact_speed": ("impact_speed_m_s", "pendulum_speed_before_m_s"),
    "ball_speed": ("ball_speed_m_s",),
    "range": ("range_m", "landing_distance_m"),
}
"""Names of each number; the second ones are those that `vision measure --csv` writes."""

BACKSWING = ("backswing_deg", "backswing_angle_deg")
TRIAL = ("trial", "clip")


def is_trial_table(path: TableLike) -> bool:
    """Whether a table's header is that of a trial table: numbers of trials, and no times."""
    try:
        header = read_table(path) if isinstance(path, pd.DataFrame) else pd.read_csv(path, nrows=0)
    except (OSError, UnicodeDecodeError, ValueError):
        return False
    names = {str(name).strip() for name in header.columns}
    results = {name for key in ("ball_speed", "range") for name in COLUMNS[key]}
    return "t_s" not in names and bool(names & (results | {*COLUMNS["impact_speed"]}))


def load_trial_table(path: TableLike) -> TrialTable:
    """Read a trial table.

    Raises
    ------
    UsageError
        If it can't be read, has no rows, or holds numbers that can't be.
    """
    table = read_table(path)
    notes: list[str] = []
    table = _without_doubles(table, notes)
    found = {key: _first(table, names) for key, names in COLUMNS.items()}
    values = np.column_stack([_numbers(table, found[key], notes) for key in CHANNELS])
    stds = np.column_stack(
        [_numbers(table, None if (n := found[key]) is None else f"{n}_std", []) for key in CHANNELS]
    )
    swing = _first(table, BACKSWING)
    backswing = np.deg2rad(_numbers(table, swing, notes))
    name = _first(table, TRIAL)
    names = (
        [str(n) for n in table[name]] if name else [str(k + 1) for k in range(len(table))]
    )  # fmt: skip
    balls: list[str | None] = [None] * len(table)
    if "ball" in table:
        balls = [None if pd.isna(b) else str(b).strip() for b in table["ball"]]
    started = np.isfinite(values[:, 0]) | np.isfinite(backswing)
    kept = started & np.isfinite(values[:, 1:]).any(axis=1)
    left_out = [n for n, k in zip(names, kept, strict=True) if not k]
    if left_out and kept.any():
        notes.append(
            f"{len(left_out)} rows lack a start or a result and were left out:"
            f" trial {', '.join(left_out[:6])}"
        )
    whole = TrialTable(tuple(names), tuple(balls), values, stds, backswing, tuple(notes))
    return whole.chosen(kept) if kept.any() else whole


def explain_trial_table(
    path: TableLike,
    setup: Setup,
    hold_out: Sequence[str] = (),
    own: Sequence[Effect] = (),
) -> TableExplained:
    """Explain a trial table with the setup's model.

    Raises
    ------
    UsageError
        For a table or setup that can't be used.
    TooLittleDataError
        If there are too few trials.
    """
    table = load_trial_table(path)
    baseline = baseline_for_balls(setup, {name or "" for name in table.balls}, struck=True)
    return explain_table(table, baseline, own=own, hold_out=hold_out)


def _first(table: pd.DataFrame, names: Sequence[str]) -> str | None:
    return next((name for name in names if name in table.columns), None)


def _numbers(table: pd.DataFrame, column: str | None, notes: list[str]) -> FloatArray:
    if column is None or column not in table:
        return np.full(len(table), np.nan)
    numbers = np.asarray(pd.to_numeric(table[column], errors="coerce"), dtype=np.float64)
    bad = int((~np.isfinite(numbers) & table[column].notna().to_numpy()).sum())
    if bad:
        notes.append(f"{column}: {bad} entries are no numbers; left out")
    return np.where(np.isfinite(numbers), numbers, np.nan)


def _without_doubles(table: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    if table.empty:
        raise UsageError("the table has a header but no rows")
    doubled = table.duplicated()
    if int(doubled.sum()):
        notes.append(f"{int(doubled.sum())} rows are given twice; left out")
        table = table[~doubled]
    name = _first(table, TRIAL)
    if name is not None and table[name].duplicated().any():
        again = ", ".join(str(n) for n in table.loc[table[name].duplicated(), name].unique()[:4])
        notes.append(f"trial {again} has several rows; each is taken as a trial of its own")
    return table.reset_index(drop=True)
