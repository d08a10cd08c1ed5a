"""`vision explain`: where simulation and recording differ, what was left out, and the proof."""

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from metrology import UsageError, write_text_whole
from mismatch import Campaign, Explained, Options, Verdict, explain_in_full
from mismatch.table.explain import TableExplained
from pipelines.explain.clips import ClipCampaign, campaign_from_clips, clip_facts, with_rig
from pipelines.explain.io import baseline_from_setup, load_campaign, load_effects
from pipelines.explain.model import improved_setup
from pipelines.explain.plots import draw_explained
from pipelines.explain.report import write_explain_report
from pipelines.explain.systematics import within_calibration
from pipelines.explain.tables import explain_trial_table, is_trial_table
from pipelines.setup.file import Setup, load_setup

__all__ = [
    "explain_campaign",
    "explain_clips",
    "explain_command",
    "explain_files",
    "explain_files_in_full",
    "explain_table_file",
]


def explain_files(
    ball: Path | None,
    pendulum: Path | None,
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects_file: Path | None = None,
) -> Verdict:
    """Explain a campaign from its files.

    Parameters
    ----------
    ball, pendulum : Path or None
        CSV files as in the contract; one may be missing.
    setup : Path or Setup
        What the lab knows.
    hold_out : tuple of str, optional
        Names of trials to keep out of the fit.
    effects_file : Path, optional
        A Python file with a user's own effects.

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
    return explain_files_in_full(ball, pendulum, setup, hold_out, effects_file).verdict


def explain_files_in_full(
    ball: Path | None,
    pendulum: Path | None,
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects_file: Path | None = None,
) -> Explained:
    """As `explain_files`, with the fits that plots and reports need."""
    known = setup if isinstance(setup, Setup) else load_setup(setup)
    return explain_campaign(load_campaign(ball, pendulum, known), known, hold_out, effects_file)


def explain_clips(
    clips: Sequence[Path],
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects_file: Path | None = None,
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
    effects_file : Path, optional
        A Python file with a user's own effects.
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
    return explain_campaign(campaign, known, hold_out, effects_file)


def explain_table_file(
    table: Path,
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects_file: Path | None = None,
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
    own = () if effects_file is None else load_effects(effects_file)
    return explain_trial_table(table, known, hold_out or (), own)


def explain_campaign(
    campaign: Campaign,
    known: Setup,
    hold_out: tuple[str, ...] | None = None,
    effects_file: Path | None = None,
) -> Explained:
    """Explain a campaign that has been read or measured already."""
    baseline = baseline_from_setup(known, campaign)
    own = () if effects_file is None else load_effects(effects_file)
    explained = explain_in_full(
        campaign, baseline, options=Options(hold_out=hold_out or (), effects=own)
    )
    if not isinstance(campaign, ClipCampaign):
        return explained
    return replace(explained, verdict=within_calibration(explained.verdict, campaign.widths))


def explain_command(
    inputs: Annotated[
        list[Path] | None,
        typer.Argument(
            help="BALL.csv, a table of trials, or clips.", metavar="[BALL.csv | CLIP...]"
        ),
    ] = None,
    setup: Annotated[Path | None, typer.Option(help="What the lab knows (TOML).")] = None,
    pendulum: Annotated[Path | None, typer.Option(help="The pendulum's samples (CSV).")] = None,
    trials: Annotated[
        Path | None,
        typer.Option(help="Clips only: a table clip,backswing_deg,ball of what was written down."),
    ] = None,
    strikes: Annotated[
        bool, typer.Option(help="Clips only: compare swing and contact, too, not flights alone.")
    ] = False,
    hold_out: Annotated[
        str | None, typer.Option(help="Trials to keep out of the fit, separated by commas.")
    ] = None,
    effects: Annotated[
        Path | None, typer.Option(help="A Python file with effects of your own.")
    ] = None,
    json_file: Annotated[
        str | None, typer.Option("--json", help="Write the verdict as JSON ('-': stdout).")
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Write the story as HTML.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Write the plots (.png or .svg).")] = None,
    model: Annotated[
        Path | None, typer.Option(help="Write the improved model as a setup file (TOML).")
    ] = None,
    quiet: Annotated[bool, typer.Option(help="Print nothing but results asked for.")] = False,
) -> None:
    """Find where simulation and recording differ and what physics was left out.

    Example: vision explain ball.csv --pendulum pendulum.csv --setup setup.toml --report story.html
    """
    if setup is None:
        raise UsageError(
            "explain needs a setup file: it says what the model already knows",
            hint="vision explain BALL.csv --setup SETUP.toml",
        )
    ball = _ball_file(inputs or [])
    held = tuple(name.strip() for name in hold_out.split(",")) if hold_out else None
    explained: Explained | TableExplained
    if inputs and ball is None:
        explained = explain_clips(inputs, setup, held, effects, trials, strikes=strikes)
    elif ball is not None and is_trial_table(ball):
        if pendulum is not None:
            raise UsageError(
                f"{ball} holds numbers of whole trials; a pendulum's samples don't go with them",
                hint="Leave --pendulum away.",
            )
        explained = explain_table_file(ball, setup, held, effects)
    else:
        explained = explain_files_in_full(ball, pendulum, setup, held, effects)
    text = json.dumps(explained.verdict.to_json(), indent=1, allow_nan=False)
    if json_file == "-":
        sys.stdout.write(text + "\n")
    elif json_file is not None:
        write_text_whole(Path(json_file), text + "\n")
    if plot is not None:
        draw_explained(explained, plot)
    if report is not None:
        write_explain_report(explained, report)
    if model is not None:
        write_text_whole(model, improved_setup(setup, explained))
    if not quiet and json_file != "-":
        sys.stdout.write(explained.verdict.text() + "\n")


def _ball_file(inputs: list[Path]) -> Path | None:
    if not inputs:
        return None
    tables = [path for path in inputs if path.suffix.lower() in (".csv", ".tsv", ".txt")]
    if len(tables) == len(inputs) == 1:
        return tables[0]
    if tables:
        raise UsageError(
            "explain takes one ball file, or clips, not both and not several tables",
            hint="Put all trials into one file with a column `trial`.",
        )
    return None
