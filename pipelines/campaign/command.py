"""Command line of `vision campaign`: run, status, mark."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from metrology import MeasurementError, UsageError
from pipelines.campaign.conduct import Campaign, CampaignOptions, conduct, results_folder
from pipelines.campaign.ledger import AttemptOutcome, Ledger, State
from pipelines.campaign.results import parquet_is_written
from pipelines.campaign.run import Progress as RunProgress
from pipelines.doors import FpsOption, GridOption, SetupOption
from pipelines.processes import raise_when_terminated
from pipelines.terminal import DefaultCommandGroup, screen

__all__ = [
    "CAMPAIGN_COMMANDS",
    "ClipsOrCommand",
    "campaign_command",
    "mark_command",
    "status_command",
]


class ClipsOrCommand(DefaultCommandGroup):
    """A group in which a clip or folder as first word means `run`."""

    meant = "run"


_ClipsArgument = Annotated[
    list[Path], typer.Argument(metavar="CLIPS|FOLDER...", help="Clips, or folders of clips.")
]
_OutOption = Annotated[
    Path | None,
    typer.Option("--out", help="Results folder of the campaign; default: FOLDER/results."),
]
_TrialsOption = Annotated[Path | None, typer.Option("--trials", help="Lab book (CSV or XLSX).")]
_BallOption = Annotated[
    str | None, typer.Option("--ball", help="Ball of clips without one in the lab book.")
]
_JobsOption = Annotated[
    int | None, typer.Option("-j", "--jobs", min=1, help="Processes; default: number of cores.")
]
_DaskOption = Annotated[
    str | None,
    typer.Option("--dask", metavar="tcp://HOST:PORT", help="Address of a Dask cluster."),
]
_OnlyOption = Annotated[
    list[str] | None, typer.Option("--only", help="Measure only this clip; repeatable.")
]
_RetryFailedOption = Annotated[bool, typer.Option("--retry-failed", help="Try failed clips again.")]
_TimeoutOption = Annotated[
    float, typer.Option("--timeout", min=1.0, help="Time limit per clip, s.")
]
_AgainstPaperOption = Annotated[
    bool, typer.Option("--paper", help="Draw the paper's laws next to your own.")
]
_ExplainOption = Annotated[
    bool, typer.Option("--explain", help="Search the strikes for missing physics.")
]
_WatchOption = Annotated[
    bool, typer.Option("--watch", help="Open a page: progress, select balls, mark trials.")
]
_QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no table.")]


def campaign_command(
    clips: _ClipsArgument,
    out: _OutOption = None,
    trials: _TrialsOption = None,
    setup: SetupOption = None,
    fps: FpsOption = None,
    ball: _BallOption = None,
    wall_grid: GridOption = None,
    jobs: _JobsOption = None,
    dask: _DaskOption = None,
    only: _OnlyOption = None,
    retry_failed: _RetryFailedOption = False,
    timeout: _TimeoutOption = 900.0,
    against_paper: _AgainstPaperOption = False,
    explain: _ExplainOption = False,
    watch: _WatchOption = False,
    quiet: _QuietOption = False,
) -> None:
    """Measure all clips of a campaign; write tables, figures and a law of restitution.

    The same command resumes where it stopped. Example:
    vision campaign clips/ --trials trials.csv --setup lab.toml --out campaign
    """
    asked = CampaignOptions(
        clips=tuple(clips),
        out=results_folder(clips, out),
        trials=trials,
        setup=setup,
        fps=fps,
        ball=ball,
        wall_grid=wall_grid,
        jobs=jobs,
        dask=dask,
        only=tuple(only or ()),
        retry_failed=retry_failed,
        timeout_s=timeout,
        against_paper=against_paper,
        explain=explain,
    )
    done = _watched(asked, quiet) if watch else _with_progress(asked, quiet)
    if not quiet:
        for clip, what in done.again.items():
            screen(errors=True).print(f"{clip} was measured again: its {what} changed")
        for said in (*done.copies, *done.warnings):
            screen(errors=True).print(said, soft_wrap=True)
        measured = done.summary["clips"]["done"]
        screen().print(f"{measured} clips measured; report: {done.report}")
        if not parquet_is_written():
            screen(errors=True).print(
                "results.parquet was not written: pyarrow is not installed."
                " If you need it: pip install 'impact-vision[parquet]'",
                soft_wrap=True,
            )
        if done.explained is not None:
            screen().print(done.explained, soft_wrap=True)
        if done.waiting:
            screen(errors=True).print(
                f"{len(done.waiting)} clips are waiting: run the command without --only for them"
            )
    if done.wanting:
        raise MeasurementError(
            f"{len(done.wanting)} clips could not be measured:\n" + "\n".join(done.wanting[:50]),
            hint="Remove the cause, then run the same command with --retry-failed.",
        )


def _watched(asked: CampaignOptions, quiet: bool) -> Campaign:
    """Run the campaign with its page open, and again whenever the page requests it."""
    from pipelines.app.command import watch_campaign

    errors = screen(errors=True)
    asked.out.mkdir(parents=True, exist_ok=True)
    page = watch_campaign(
        asked.out, lambda address: errors.print(f"progress page: {address}", soft_wrap=True)
    )
    while True:
        page.running = True
        done = _with_progress(asked, quiet)
        page.running = False
        if page.closed.is_set():
            return done
        errors.print(f"report: {done.report}. Close the page or press Ctrl-C to end")
        try:
            if not page.wait():
                return done
        except KeyboardInterrupt:
            return done


def _with_progress(asked: CampaignOptions, quiet: bool) -> Campaign:
    """Run the campaign with a progress bar; print how to resume after Ctrl-C or SIGTERM."""
    raise_when_terminated()
    errors = screen(errors=True)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=errors,
        transient=True,
        disable=quiet or not errors.is_terminal,
    ) as bar:
        task = bar.add_task("measuring", total=None)

        def on_clip(progress: RunProgress, outcome: AttemptOutcome) -> None:
            finished = progress.done + progress.failed
            bar.update(
                task,
                description=f"measuring {progress.purpose}",
                total=progress.todo,
                completed=finished,
            )
            failed = outcome.state == State.FAILED
            if not quiet and (failed or not errors.is_terminal):
                count = f"{finished}/{progress.todo} "
                said = outcome.error if failed else f"measured in {outcome.seconds:.1f} s"
                said = ", ".join(filter(None, (said, progress.purpose)))
                errors.print(f"{count}{outcome.clip}: {said}", soft_wrap=True, markup=False)

        try:
            return conduct(asked, on_clip)
        except KeyboardInterrupt:
            errors.print(
                f"Stopped. Finished clips are kept in {asked.out}."
                " The same command resumes where it stopped."
            )
            raise


def status_command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a campaign.")],
) -> None:
    """Show the progress of a campaign, during or after its run.

    Example: vision campaign status campaign
    """
    if not (folder / "ledger.sqlite").is_file():
        raise UsageError(
            f"{folder} contains no campaign", hint="Pass the folder that was given as --out."
        )
    with Ledger(folder) as ledger:
        counts = ledger.counts()
        screen().print(", ".join(f"{number} {state}" for state, number in counts.items()))
        table = Table("clip", "state", "tries", "time", "why")
        for entry in ledger.entries():
            if entry.state != State.DONE or entry.excluded is not None:
                seconds = "" if entry.seconds is None else f"{entry.seconds:.1f} s"
                why = entry.excluded or entry.error or ""
                table.add_row(entry.order.clip, str(entry.state), str(entry.attempts), seconds, why)
        if table.row_count:
            screen().print(table)


def mark_command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a campaign.")],
    clip: Annotated[str, typer.Argument(metavar="CLIP", help="Name of the clip.")],
    reason: Annotated[
        str | None, typer.Option("--bad", metavar="REASON", help="Why the trial is bad.")
    ] = None,
) -> None:
    """Mark a trial as bad with a reason; without --bad, remove the mark.

    A bad trial keeps its row, appears in the report with its reason, and is excluded from the laws
    at the next run of the campaign command. Example:
    vision campaign mark campaign strike_17.mp4 --bad "the ball was not at rest"
    """
    if not (folder / "ledger.sqlite").is_file():
        raise UsageError(
            f"{folder} contains no campaign", hint="Pass the folder that was given as --out."
        )
    with Ledger(folder) as ledger:
        ledger.exclude(clip, reason)
    done = "is no longer marked" if reason is None else "is marked as bad"
    screen().print(f"{clip} {done}. Run the campaign command again to update the results.")


CAMPAIGN_COMMANDS: dict[str, Callable[..., None]] = {
    "run": campaign_command,
    "status": status_command,
    "mark": mark_command,
}
"""Commands of ``vision campaign``; the first is the default."""
