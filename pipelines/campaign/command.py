"""`vision campaign`: a folder of clips measured once each, whatever happens, and what they say."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from metrology import MeasurementError, UsageError
from pipelines.campaign.conduct import Campaign, CampaignOptions, conduct
from pipelines.campaign.ledger import AttemptOutcome, Ledger, State
from pipelines.campaign.run import Progress as RunProgress
from pipelines.campaign.run import stop_on_signals
from pipelines.doors import FpsOption, GridOption, SetupOption
from pipelines.terminal import DefaultCommandGroup, screen

__all__ = [
    "CAMPAIGN_COMMANDS",
    "ClipsOrCommand",
    "campaign_command",
    "mark_command",
    "status_command",
]


class ClipsOrCommand(DefaultCommandGroup):
    """A group whose first word may also be a clip or folder: then `run` is meant."""

    meant = "run"


_ClipsArgument = Annotated[
    list[Path], typer.Argument(metavar="CLIPS|FOLDER...", help="Clips, or folders of clips.")
]
_OutOption = Annotated[Path, typer.Option("--out", help="Folder of the campaign.")]
_TrialsOption = Annotated[Path | None, typer.Option("--trials", help="The lab book (CSV or XLSX).")]
_BallOption = Annotated[
    str | None, typer.Option("--ball", help="Ball where the lab book names none.")
]
_JobsOption = Annotated[
    int | None, typer.Option("-j", "--jobs", min=1, help="Processes; default: cores.")
]
_DaskOption = Annotated[
    str | None,
    typer.Option(
        "--dask",
        metavar="tcp://HOST:PORT|QUEUE",
        help="A Dask cluster; or a queue of dask-jobqueue, such as slurm (-j: jobs).",
    ),
]
_OnlyOption = Annotated[
    list[str] | None, typer.Option("--only", help="Measure this clip only; may be repeated.")
]
_RetryFailedOption = Annotated[
    bool, typer.Option("--retry-failed", help="Try failed clips once more.")
]
_TimeoutOption = Annotated[
    float, typer.Option("--timeout", min=1.0, help="Longest time for one clip, s.")
]
_AgainstPaperOption = Annotated[
    bool, typer.Option("--paper", help="Draw the paper's laws beside one's own.")
]
_ExplainOption = Annotated[
    bool, typer.Option("--explain", help="Look for missing physics in the strikes.")
]
_WatchOption = Annotated[
    bool, typer.Option("--watch", help="Open a page to watch, point at balls, mark trials.")
]
_QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no table.")]


def campaign_command(
    clips: _ClipsArgument,
    out: _OutOption,
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
    """Measure every clip of a campaign once and turn them into figures and a law of restitution.

    The same command again goes on where it stopped. Example:
    vision campaign clips/ --trials trials.csv --setup lab.toml --out campaign
    """
    asked = CampaignOptions(
        clips=tuple(clips),
        out=out,
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
            screen(errors=True).print(f"{clip} was measured again: {what} changed since")
        for told in done.copies:
            screen(errors=True).print(told, soft_wrap=True)
        measured = done.summary["clips"]["done"]
        screen().print(f"{measured} clips measured; report: {done.report}")
        if done.explained is not None:
            screen().print(done.explained, soft_wrap=True)
        if done.waiting:
            screen(errors=True).print(
                f"{len(done.waiting)} clips wait: the same command without --only goes on with them"
            )
    if done.wanting:
        raise MeasurementError(
            f"{len(done.wanting)} clips could not be measured:\n" + "\n".join(done.wanting[:50]),
            hint="After mending, give the same command with --retry-failed.",
        )


def _watched(asked: CampaignOptions, quiet: bool) -> Campaign:
    """Conduct the campaign beside its page, and again whenever the page asks for it."""
    from pipelines.campaign.watch import watched

    errors = screen(errors=True)
    asked.out.mkdir(parents=True, exist_ok=True)
    page = watched(
        asked.out, lambda address: errors.print(f"watch it at {address}", soft_wrap=True)
    )
    while True:
        page.running = True
        done = _with_progress(asked, quiet)
        page.running = False
        if page.closed.is_set():
            return done
        errors.print(f"report: {done.report}; close the page, or press Ctrl-C, to end")
        try:
            if not page.wait():
                return done
        except KeyboardInterrupt:
            return done


def _with_progress(asked: CampaignOptions, quiet: bool) -> Campaign:
    """Conduct the campaign with a bar on a terminal; Ctrl-C and SIGTERM say how to go on."""
    stop_on_signals()
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
            bar.update(task, total=progress.todo, completed=progress.done + progress.failed)
            if outcome.state == State.FAILED and not quiet:
                errors.print(f"{outcome.clip}: {outcome.error}", soft_wrap=True)

        try:
            return conduct(asked, on_clip)
        except KeyboardInterrupt:
            errors.print(
                f"stopped; what is done is kept in {asked.out}."
                " The same command goes on where it stopped."
            )
            raise


def status_command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a campaign.")],
) -> None:
    """Say how far a campaign is, while it runs or afterwards.

    Example: vision campaign status campaign
    """
    if not (folder / "ledger.sqlite").is_file():
        raise UsageError(
            f"{folder} holds no campaign", hint="Name the folder that was given with --out."
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
    """Mark a trial as bad with a reason, or take the mark back by giving none.

    A bad trial keeps its row, stands in the report with its reason, and is left out of the laws
    the next time the campaign's command is given. Example:
    vision campaign mark campaign strike_17.mp4 --bad "the ball was not at rest"
    """
    if not (folder / "ledger.sqlite").is_file():
        raise UsageError(
            f"{folder} holds no campaign", hint="Name the folder that was given with --out."
        )
    with Ledger(folder) as ledger:
        ledger.exclude(clip, reason)
    done = "is no longer marked" if reason is None else "is marked as bad"
    screen().print(f"{clip} {done}; give the campaign's command again to publish it.")


CAMPAIGN_COMMANDS: dict[str, Callable[..., None]] = {
    "run": campaign_command,
    "status": status_command,
    "mark": mark_command,
}
"""Commands under ``vision campaign``; the first is meant where none is named."""
