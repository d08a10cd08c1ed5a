"""Explaining campaigns, tables and clips: from what the user has to the engine's answer.

Tables with a few numbers per trial: read, and held against the setup's model.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from metrology import UsageError
from mismatch import CampaignRecords, EngineVerdict, Explained, Options, explain_in_full
from mismatch.table.explain import TableExplained, explain_table
from mismatch.table.table import CHANNELS, TrialTable
from physics.domain import FloatArray
from physics.effects import Effect
from pipelines.explain.campaign import baseline_for_balls, baseline_from_setup, load_campaign
from pipelines.explain.clips import (
    ClipCampaign,
    campaign_from_clips,
    clip_facts,
    with_rig,
    within_calibration,
)
from pipelines.explain.own_effects import check_effect, load_effects, under_guard
from pipelines.explain.tabular import TableLike, name_of, numbers_of, read_sheet
from pipelines.setup.file import Setup, load_setup

__all__ = [
    "explain_campaign",
    "explain_clips",
    "explain_files",
    "explain_files_in_full",
    "explain_table_file",
    "is_trial_table",
    "load_trial_table",
]

COLUMNS = {
    "impact_speed": ("impact_speed_m_s", "pendulum_speed_before_m_s"),
    "ball_speed": ("ball_speed_m_s",),
    "range": ("range_m", "landing_distance_m"),
}

"""Names of each number; the second ones are those that `vision measure --csv` writes."""

UNITS = {
    "impact_speed": "m_s", "pendulum_speed_before": "m_s", "ball_speed": "m_s",
    "range": "m", "landing_distance": "m", "backswing": "deg", "backswing_angle": "deg",
}  # fmt: skip

"""Stem of each column of numbers → its unit."""

BACKSWING = ("backswing_deg", "backswing_angle_deg")

TRIAL = ("trial", "clip")


def is_trial_table(path: TableLike) -> bool:
    """Whether a table's header is that of a trial table: numbers of trials, and no times."""
    try:
        columns = set(read_sheet(path, UNITS, rows=1).table.columns)
    except UsageError:
        return False  # told in full when its samples are read
    results = {name for key in ("ball_speed", "range") for name in COLUMNS[key]}
    return "t_s" not in columns and bool(columns & (results | {*COLUMNS["impact_speed"]}))


def load_trial_table(path: TableLike) -> TrialTable:
    """Read a trial table.

    Raises
    ------
    UsageError
        If it can't be read, has no rows, or holds numbers that can't be.
    """
    sheet = read_sheet(path, UNITS, ("trial", "clip", "ball"))
    what, notes = name_of(path), list(sheet.notes)
    table = _without_doubles(sheet.table, notes)

    def column(name: str | None, *, positive: bool = False) -> FloatArray:
        if name is None or name not in table:
            return np.full(len(table), np.nan)
        return numbers_of(table, name, what, notes, positive=positive)

    found = {key: _first(table, names) for key, names in COLUMNS.items()}
    values = np.column_stack([column(found[key]) for key in CHANNELS])
    stds = np.column_stack(
        [column(f"{name}_std" if (name := found[key]) else None, positive=True) for key in CHANNELS]
    )
    backswing = np.deg2rad(column(_first(table, BACKSWING)))
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


OwnEffects = Path | Sequence[Effect] | None

"""A user's own effects: a Python file that holds them, or the objects."""


def explain_files(
    ball: TableLike | None,
    pendulum: TableLike | None,
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> EngineVerdict:
    """Explain a campaign from its tables.

    Parameters
    ----------
    ball, pendulum : Path, DataFrame or None
        Tables as in the contract; one may be missing.
    setup : Path or Setup
        What the lab knows.
    hold_out : tuple of str, optional
        Names of trials to keep out of the fit.
    effects : Path or sequence of Effect, optional
        A user's own.

    Returns
    -------
    EngineVerdict

    Raises
    ------
    UsageError
        For files that can't be read or don't hold what is needed.
    TooLittleDataError
        If there is too little to tell.
    """
    return explain_files_in_full(ball, pendulum, setup, hold_out, effects).verdict


def explain_files_in_full(
    ball: TableLike | None,
    pendulum: TableLike | None,
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> Explained:
    """As `explain_files`, with the fits that plots and reports need."""
    known = setup if isinstance(setup, Setup) else load_setup(setup)
    return explain_campaign(load_campaign(ball, pendulum, known), known, hold_out, effects)


def explain_clips(
    clips: Sequence[Path],
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
    trials: Path | None = None,
    *,
    strikes: bool = False,
) -> Explained:
    """Measure clips and explain them as one campaign, one trial a clip.

    Parameters
    ----------
    clips : sequence of Path
        One strike each; what can't be measured is left out and noted.
    setup : Path or Setup
        What the lab knows.
    hold_out : tuple of str, optional
        Names of clips (without ending) to keep out of the fit.
    effects : Path or sequence of Effect, optional
        A user's own.
    trials : Path, optional
        A table of the clips with their back-swings and balls.
    strikes : bool
        Compare swing and contact, too, where all back-swings are known.

    Raises
    ------
    ClipError, MeasurementError
        If no clip can be read and measured.
    """
    known = with_rig(setup if isinstance(setup, Setup) else load_setup(setup))
    facts = None if trials is None else clip_facts(trials)
    campaign = campaign_from_clips(clips, known, facts, strikes=strikes)
    return explain_campaign(campaign, known, hold_out, effects)


def explain_table_file(
    table: TableLike,
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> TableExplained:
    """Explain a table with a few numbers per trial.

    Raises
    ------
    UsageError
        For a table or setup that can't be used.
    TooLittleDataError
        If there are too few trials.
    """
    known = setup if isinstance(setup, Setup) else load_setup(setup)
    own = _own(effects)
    with under_guard(own):
        return explain_trial_table(table, known, hold_out or (), own)


def explain_campaign(
    campaign: CampaignRecords,
    known: Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> Explained:
    """Explain a campaign that has been read or measured already."""
    baseline = baseline_from_setup(known, campaign)
    own = _own(effects)
    with under_guard(own):
        explained = explain_in_full(
            campaign, baseline, options=Options(hold_out=hold_out or (), effects=own)
        )
    if not isinstance(campaign, ClipCampaign):
        return explained
    verdict = within_calibration(explained.verdict, campaign.widths, known=campaign.calibrated)
    return replace(explained, verdict=verdict)


def _own(effects: OwnEffects) -> tuple[Effect, ...]:
    if isinstance(effects, Path):
        return load_effects(effects)
    for effect in effects or ():
        check_effect(effect)
    return tuple(effects or ())
