"""Explaining campaigns, tables and clips: from what the user has to the engine's answer."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mismatch import Campaign, Explained, Options, Verdict, explain_in_full
from mismatch.table.explain import TableExplained
from physics.effects import Effect
from pipelines.explain.clips import ClipCampaign, campaign_from_clips, clip_facts, with_rig
from pipelines.explain.io import baseline_from_setup, load_campaign, load_effects
from pipelines.explain.systematics import within_calibration
from pipelines.explain.tables import explain_trial_table
from pipelines.explain.tabular import TableLike
from pipelines.setup.file import Setup, load_setup

__all__ = [
    "OwnEffects",
    "explain_campaign",
    "explain_clips",
    "explain_files",
    "explain_files_in_full",
    "explain_table_file",
]

OwnEffects = Path | Sequence[Effect] | None
"""A user's own effects: a Python file that holds them, or the objects."""


def explain_files(
    ball: TableLike | None,
    pendulum: TableLike | None,
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> Verdict:
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
    Verdict

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
    return explain_trial_table(table, known, hold_out or (), own)


def explain_campaign(
    campaign: Campaign,
    known: Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> Explained:
    """Explain a campaign that has been read or measured already."""
    baseline = baseline_from_setup(known, campaign)
    own = _own(effects)
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
    return tuple(effects or ())
