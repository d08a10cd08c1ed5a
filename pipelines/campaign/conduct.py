"""Run a campaign and write its results, for command line and Python."""

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from measuring.setup.cor_file import BallLaw, ball_law, with_laws, write_cor_file
from measuring.setup.file import Setup, ball_from_option, meant_name, setup_from
from measuring.setup.tables import checked_values
from metrology import ImpactVisionError, MeasurementError, UsageError, write_text_whole
from metrology.files import printable
from physics.bodies import BALLS
from physics.cor_fit import AveragedLaw, LawKind, lack_of_fit
from pipelines.api.explained import explain as find_missing_physics
from pipelines.api.quantities import measure_options
from pipelines.api.wording import worded_for_python
from pipelines.campaign.analysis import BallAnalysis, CampaignAnalysis, analyse
from pipelines.campaign.files import clip_key, refuse_occupied, staged, sweep
from pipelines.campaign.ledger import AttemptOutcome, Ledger, State, lock_folder
from pipelines.campaign.rate import MAX_PILOTS, common_rate, kept_rate
from pipelines.campaign.report import ReportFacts, draw_figures, write_figures, write_report
from pipelines.campaign.results import (
    ClipResult,
    LabBook,
    LabBookRow,
    Recording,
    clip_results,
    match_clips,
    not_counted,
    read_lab_book,
    recordings,
    results_frame,
    with_known_balls,
    write_tables,
)
from pipelines.campaign.run import (
    Crew,
    Progress,
    RunOptions,
    RunPlan,
    cluster_crew,
    cores,
    find_clips,
    local_crew,
    run,
)
from pipelines.measure.files import software_version
from pipelines.terminal import counted

__all__ = ["Campaign", "CampaignOptions", "Edition", "campaign", "conduct", "publish"]

_SUMMARY_SPEEDS = 9
"""Number of speeds in `cor_at`, evenly across the range fitted (chosen)."""


def summarise(results: Sequence[ClipResult], analysis: CampaignAnalysis) -> dict[str, Any]:
    """The campaign as the contract's ``summary.json``."""
    states = [result.state for result in results]
    return {
        "clips": {
            "done": states.count(State.DONE),
            "failed": states.count(State.FAILED),
            "waiting": states.count(State.WAITING) + states.count(State.RUNNING),
            "excluded": sum(result.excluded is not None for result in results),
        },
        "balls": {ball.ball or "ball": _ball(ball) for ball in analysis.balls},
        "sensors": {
            one.sensor.column: {
                "quantity": one.sensor.quantity,
                "unit": one.sensor.unit,
                "pairs": one.agreement.pairs,
                "bias": {"value": one.agreement.bias, "std": one.agreement.bias_std},
                "limits_of_agreement": [one.agreement.lower, one.agreement.upper],
                "biased": one.agreement.biased,
            }
            for one in analysis.sensors
        },
        "outliers": [
            {"clip": ball.clips[item.index].clip, "why": ball.why_outlying(item)}
            for ball in analysis.balls
            for item in ball.outliers
        ],
        "failed": [
            {"clip": result.clip, "why": result.error}
            for result in results
            if result.state == State.FAILED
        ],
        "excluded": [
            {"clip": result.clip, "why": result.excluded}
            for result in results
            if result.excluded is not None
        ],
        "copies": [
            {"clip": result.clip, "why": result.elsewhere}
            for result in results
            if result.elsewhere is not None
        ],
    }


def laws_of(analysis: CampaignAnalysis) -> dict[str, BallLaw]:
    """The laws of each ball with their probabilities, for `simulate`, `plan` and `explain`."""
    return {
        ball.ball or "ball": ball_law(ball.ball or "ball", ball.fits)
        for ball in analysis.balls
        if ball.fits
    }


def _ball(ball: BallAnalysis) -> dict[str, Any]:
    if not ball.fits:
        return {"law": None, "reason": ball.why_no_law, "clips": len(ball.clips)}
    fit = ball.fits[0]
    low, high = fit.speeds
    speeds = [low + (high - low) * i / (_SUMMARY_SPEEDS - 1) for i in range(_SUMMARY_SPEEDS)]
    precision = ball.precision
    return {
        **fit.to_dict(),
        "clips": len(ball.clips),
        "lack_of_fit_p": _lack_of_fit_p(ball),
        "cor_at": [_at(AveragedLaw(ball.fits), speed) for speed in speeds],
        "laws": {str(other.law): other.probability for other in ball.fits},
        "precision": None
        if precision is None
        else {
            "repeatability": precision.repeatability,
            "repeatability_95": [precision.repeatability_low, precision.repeatability_high],
            "between_sessions": precision.between,
            "reproducibility": precision.reproducibility,
            "sessions": precision.sessions,
        },
        "range_rms_m": None if ball.ranges is None else ball.ranges.rms(),
    }


def _lack_of_fit_p(ball: BallAnalysis) -> float | None:
    """Of the most probable parametric law; None without repeats."""
    law = next(fit.law for fit in ball.fits if fit.law is not LawKind.FREE)
    return None if ball.points is None else lack_of_fit(law, ball.points).p


def _at(averaged: AveragedLaw, speed: float) -> dict[str, Any]:
    following = averaged.next_strike(speed)
    return {
        "speed": speed,
        **averaged.at(speed).to_dict(),
        "next_strike_95": [following.low, following.high],
    }


@dataclass(frozen=True)
class Edition:
    """Everything the results are made from, apart from the ledger.

    Attributes
    ----------
    strikes : mapping of str to Strike or None
        By the clip's name.
    ball : str or None
        Ball of clips for which the lab book names none.
    against_paper : bool
        Draw the paper's laws next to your own.
    """

    folder: Path
    book: LabBook | None
    strikes: Mapping[str, LabBookRow | None]
    setup: Setup
    ball: str | None
    facts: ReportFacts
    against_paper: bool = False

    def copies(self, ledger: Ledger) -> tuple[Recording, ...]:
        """Recordings present under several clip names."""
        return recordings(ledger.copies(), self.strikes)

    def frame(self, ledger: Ledger) -> pd.DataFrame:
        """The table of results."""
        elsewhere = not_counted(self.copies(ledger))
        return results_frame(ledger.entries(), self.strikes, self.book, elsewhere)

    def results(self, ledger: Ledger) -> list[ClipResult]:
        """Results of the campaign's clips."""
        return clip_results(ledger.entries(), self.strikes, not_counted(self.copies(ledger)))


@dataclass(frozen=True)
class Published:
    """What was written."""

    results: list[ClipResult]
    frame: pd.DataFrame
    analysis: CampaignAnalysis


def publish_tables(edition: Edition, ledger: Ledger) -> None:
    """Write only the tables: fast enough to do during the run."""
    with staged(edition.folder, whole=False) as stage:
        write_tables(edition.frame(ledger), stage)


def publish(edition: Edition, ledger: Ledger) -> Published:
    """Write tables, figures, laws, summary and report; all of them or none."""
    results = edition.results(ledger)
    frame = edition.frame(ledger)
    analysis = analyse(results, edition.setup, edition.ball)
    figures = draw_figures(analysis, against_paper=edition.against_paper)
    with staged(edition.folder) as stage:
        write_tables(frame, stage)
        write_figures(figures, stage / "figures")
        summary = json.dumps(summarise(results, analysis), indent=2)
        write_text_whole(stage / "summary.json", summary + "\n")
        laws = laws_of(analysis)
        if laws:
            write_cor_file(stage / "cor.toml", laws)
        page, folder = stage / "report.html", edition.folder
        write_report(page, edition.facts, results, analysis, figures, folder)
    return Published(results, frame, analysis)


TABLES_EVERY_S = 5.0
"""s: shortest time between two updates of the tables; one clip takes longer."""

TABLE_PAUSE_RATIO = 50.0
"""Pause over writing time: writing the tables takes at most 2 % of the run."""


@dataclass(frozen=True)
class CampaignOptions:
    """Options of `vision campaign`."""

    clips: tuple[Path, ...]
    out: Path
    trials: Path | None = None
    setup: Path | Setup | None = None
    fps: str | None = None
    ball: str | None = None
    wall_grid: str | None = None
    jobs: int | None = None
    dask: str | None = None
    only: tuple[str, ...] = ()
    retry_failed: bool = False
    timeout_s: float = 900.0
    against_paper: bool = False
    explain: bool = False


@dataclass(frozen=True)
class Campaign:
    """Results of a campaign.

    Attributes
    ----------
    results : DataFrame
        One row per clip, the lab book's columns first.
    summary : dict
        As ``summary.json``.
    wanting : tuple of str
        Clips that could not be measured, each with its reason.
    again : dict of str to str
        Clips measured again, and what changed.
    explained : str or None
        Summary of the search for missing physics, if requested.
    copies : tuple of str
        Recordings present under several clip names, and the name under which each counts.
    waiting : tuple of str
        Clips left for a later run because only some were requested.
    warnings : tuple of str
        Each once, with the number of clips.
    """

    folder: Path
    results: pd.DataFrame
    summary: dict[str, Any]
    wanting: tuple[str, ...] = ()
    again: dict[str, str] = field(default_factory=dict)
    explained: str | None = None
    copies: tuple[str, ...] = ()
    waiting: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def report(self) -> Path:
        """Path of the report."""
        return self.folder / "report.html"

    def __repr__(self) -> str:
        clips = self.summary["clips"]
        laws = [
            f"{name}: {ball['law'] or 'no law'}" for name, ball in self.summary["balls"].items()
        ]
        return f"Campaign {self.folder}: {clips['done']} measured; " + ", ".join(laws)


def results_folder(clips: Sequence[Path], out: Path | None) -> Path:
    """The folder given, or ``results`` in the first folder of clips.

    Raises
    ------
    UsageError
        If a file is named.
    """
    if out is None:
        return (clips[0] if clips[0].is_dir() else clips[0].parent) / "results"
    if out.suffix.lower() in _FILE_SUFFIXES and not out.is_dir():
        raise UsageError(
            f"--out {out} is the name of a file; a campaign writes a folder of results",
            hint=f"Pass a folder: --out {out.with_suffix('')}. It gets results.csv and .xlsx.",
        )
    return out


_FILE_SUFFIXES = frozenset({".csv", ".xlsx", ".json", ".html", ".txt", ".parquet", ".toml"})


@worded_for_python
@checked_values
def campaign(
    clips: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    out: str | os.PathLike[str] | None = None,
    trials: str | os.PathLike[str] | None = None,
    setup: Setup | str | os.PathLike[str] | None = None,
    fps: str | float | None = None,
    ball: str | None = None,
    wall_grid: str | None = None,
    jobs: int | None = None,
    dask: str | None = None,
    retry_failed: bool = False,
    explain: bool = False,
) -> Campaign:
    """Measure every clip and write tables, figures and laws of restitution.

    A second call resumes where the first stopped. Clips that can't be measured are in `wanting`.

    Parameters
    ----------
    clips : path or sequence of paths
        Clips and folders of clips.
    out : path, optional
        Folder of the campaign; default: ``results`` in the first folder of clips.
    trials : path, optional
        Lab book (CSV or XLSX).
    fps, ball, wall_grid : optional
        As for `measure`; the lab book's ball overrides `ball`.
    jobs : int, optional
        Processes; default: one per core.
    dask : str, optional
        Address of a Dask scheduler whose workers use the same paths.
    explain : bool
        Also search the strikes for missing physics.

    Raises
    ------
    UsageError
        For bad input that is detected before the run begins.
    """
    given = [clips] if isinstance(clips, str | os.PathLike) else clips
    paths = tuple(Path(clip) for clip in given)
    if not paths:
        raise UsageError("no clips were given", hint="Pass clips, or folders of clips.")
    return conduct(
        CampaignOptions(
            clips=paths,
            out=results_folder(paths, None if out is None else Path(out)),
            trials=None if trials is None else Path(trials),
            setup=setup if setup is None or isinstance(setup, Setup) else Path(setup),
            fps=None if fps is None else str(fps),
            ball=ball,
            wall_grid=wall_grid,
            jobs=jobs,
            dask=dask,
            retry_failed=retry_failed,
            explain=explain,
        )
    )


def conduct(
    asked: CampaignOptions,
    on_clip: Callable[[Progress, AttemptOutcome], None] = lambda progress, outcome: None,
) -> Campaign:
    """Measure the remaining clips and write all results.

    Raises
    ------
    UsageError
        For bad input that is detected before the run begins.
    """
    found = find_clips(asked.clips)
    book = None if asked.trials is None else read_lab_book(asked.trials)
    setup = setup_from(asked.setup)
    book = None if book is None else with_known_balls(book, setup.balls)
    measure_options(setup, asked.fps, None, asked.wall_grid)
    matched = match_clips(book, found)
    _require_balls(book, setup, asked.ball)
    absent = tuple(strike.clip for strike in matched.absent)
    with lock_folder(asked.out):
        sweep(asked.out)
        refuse_occupied(asked.out)
        path = _setup_file(asked)
        options = RunOptions(path, asked.fps, asked.ball, asked.wall_grid, asked.timeout_s)
        plan = RunPlan(asked.out, options, matched, software_version())
        facts = ReportFacts(
            title=f"Campaign {printable(asked.out.resolve().name)}",
            version=software_version(),
            setup=None if path is None else path.name,
            notes=_notes(book, absent),
        )
        strikes = {clip_key(clip): strike for clip, strike in matched.strikes.items()}
        edition = Edition(asked.out, book, strikes, setup, asked.ball, facts, asked.against_paper)
        progress = _run(asked, plan, setup, _publishing(edition, on_clip))
        return _published(edition, absent, progress, asked.explain, asked.only)


def _run(
    asked: CampaignOptions,
    plan: RunPlan,
    setup: Setup,
    after_each: Callable[[Progress, AttemptOutcome], None],
) -> Progress:
    """Measure the remaining clips; where no rate is given, some first, to estimate it from all."""

    def measured(plan: RunPlan) -> Progress:
        return run(
            plan,
            lambda: _crew(asked, plan.options),
            retry_failed=asked.retry_failed,
            only=asked.only,
            after_each=after_each,
        )

    if asked.fps is not None or setup.camera.capture_fps is not None:
        return measured(plan)
    joint, first, pilots = kept_rate(plan.folder), Progress(), []
    if joint is None:
        strikes = plan.matched.strikes
        pilots = [clip for clip in strikes if not asked.only or clip_key(clip) in asked.only]
        pilots = pilots[:: -(-len(pilots) // MAX_PILOTS) or 1]
        few = replace(plan.matched, strikes={clip: strikes[clip] for clip in pilots})
        first = measured(replace(plan, matched=few, purpose="to estimate the capture rate"))
        if first.stopped is not None:
            return first
        with Ledger(plan.folder) as ledger:
            joint = common_rate(ledger.entries())
        if joint is not None:
            joint.keep(plan.folder)
    if joint is None:
        others = {clip: row for clip, row in plan.matched.strikes.items() if clip not in pilots}
        plan = replace(plan, matched=replace(plan.matched, strikes=others))
    else:
        rate = (joint.fps, joint.std, joint.notice())
        plan = replace(plan, options=replace(plan.options, joint_rate=rate))
    rest = measured(plan)
    for clip in pilots:
        # measured again for the common rate alone
        rest.again.pop(clip_key(clip), None)
    rest.again.update(first.again)
    return rest


def _setup_file(asked: CampaignOptions) -> Path | None:
    """The setup as a file, for the workers."""
    if not isinstance(asked.setup, Setup):
        return asked.setup
    path = asked.out / "setup.toml"
    write_text_whole(path, asked.setup.to_toml())
    return path


def _crew(asked: CampaignOptions, options: RunOptions) -> AbstractContextManager[Crew]:
    if asked.dask is not None:
        return cluster_crew(asked.dask, options)
    return local_crew(asked.jobs or cores(), options)


def _publishing(
    edition: Edition, on_clip: Callable[[Progress, AttemptOutcome], None]
) -> Callable[[Progress, AttemptOutcome], None]:
    following = time.monotonic() + TABLES_EVERY_S

    def after_each(progress: Progress, outcome: AttemptOutcome) -> None:
        nonlocal following
        on_clip(progress, outcome)
        began = time.monotonic()
        if began > following:
            with Ledger(edition.folder) as ledger:
                publish_tables(edition, ledger)
            ended = time.monotonic()
            following = ended + max(TABLES_EVERY_S, TABLE_PAUSE_RATIO * (ended - began))

    return after_each


def _published(
    edition: Edition,
    absent: tuple[str, ...],
    progress: Progress,
    explained: bool,
    only: tuple[str, ...],
) -> Campaign:
    with Ledger(edition.folder) as ledger:
        copies = tuple(one.message() for one in edition.copies(ledger))
        facts = replace(edition.facts, notes=(*edition.facts.notes, *copies))
        edition = replace(edition, facts=facts)
        published = publish(edition, ledger)
        summarised = _explain(edition, published) if explained else None
        if summarised is not None:
            facts = replace(edition.facts, notes=(*edition.facts.notes, summarised))
            published = publish(replace(edition, facts=facts), ledger)
    # clips not requested in this run are waiting, not failed
    left = [one.clip for one in published.results if only and one.clip not in only]
    waiting = [
        one.clip for one in published.results if one.state == State.WAITING and one.clip in left
    ]
    wanting = [
        f"{result.clip}: {result.error or result.state}"
        for result in published.results
        if result.state != State.DONE and result.clip not in waiting
    ]
    wanting += [f"{name}: in the lab book, but no such clip was given" for name in absent]
    summary = json.loads((edition.folder / "summary.json").read_text(encoding="utf-8"))
    return Campaign(
        edition.folder,
        published.frame,
        summary,
        tuple(wanting),
        progress.again,
        summarised,
        copies,
        tuple(waiting),
        tuple(counted([one.warnings for one in published.results if one.state == State.DONE])),
    )


def _explain(edition: Edition, published: Published) -> str:
    """Search the table of strikes for missing physics; return a summary for the report.

    The full result is written to ``explain.html`` and ``explain.json``.
    """
    used = {result.clip for result in published.results if result.used}
    table = published.frame[published.frame["clip"].isin(used)]
    laws = laws_of(published.analysis)
    document: dict[str, Any]
    try:
        verdict = find_missing_physics(
            trials=table.rename(columns={"clip": "trial"}),
            # the restitution comes from the lab's own strikes, not from a preset
            setup=with_laws(edition.setup, laws) if laws else edition.setup,
        )
    except (MeasurementError, UsageError, ArithmeticError, np.linalg.LinAlgError) as problem:
        # a failed search does not invalidate the measurements
        why = str(problem) if not isinstance(problem, ImpactVisionError) else problem.in_one_line
        document = {"verdict": None, "reason": why}
        summarised = f"Missing physics can't be determined: {why}"
    else:
        verdict.report(edition.folder / "explain.html")
        document = verdict.to_dict()
        summarised = f"Missing physics ({document['verdict']}): see explain.html."
        named = [effect["statement"] for effect in document["effects"]]
        summarised = " ".join([summarised, *named])
    text = json.dumps(document, indent=2, ensure_ascii=False)
    write_text_whole(edition.folder / "explain.json", text + "\n")
    return summarised


def _require_balls(book: LabBook | None, setup: Setup, ball: str | None) -> None:
    """Refuse an unknown ball before the run begins.

    Raises
    ------
    UsageError
    """
    strikes = () if book is None else book.strikes
    for name in dict.fromkeys([ball, *(strike.ball for strike in strikes)]):
        if name is None or name in setup.balls:
            continue
        try:
            ball_from_option(name)
        except UsageError as problem:
            known = ", ".join(setup.balls) or "none"
            meant = meant_name(name, (*setup.balls, *BALLS))
            raise UsageError(
                f"unknown ball {name!r}" + (f"; did you mean {meant!r}?" if meant else ""),
                hint=f"Presets: {', '.join(BALLS)}. Describe another as [balls.{name}] in the"
                f" setup file (there now: {known}).",
            ) from problem


def _notes(book: LabBook | None, absent: Sequence[str]) -> tuple[str, ...]:
    notes = () if book is None else book.notes
    if absent:
        notes += (
            f"In the lab book, but no such clip given: {', '.join(absent[:8])} ({len(absent)}).",
        )
    return notes
