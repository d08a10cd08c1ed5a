"""`vision campaign`: a folder of clips measured once each, whatever happens, and what they say."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from typer.core import TyperGroup

from metrology import MeasurementError, UsageError
from pipelines.campaign.lab_book import LabBook, match_clips, read_lab_book
from pipelines.campaign.ledger import Ledger, Outcome, State, lock_folder
from pipelines.campaign.publish import Edition, publish, publish_tables
from pipelines.campaign.report import ReportFacts
from pipelines.campaign.run import (
    Plan,
    RunOptions,
    cluster_crew,
    cores,
    find_clips,
    local_crew,
    run,
    stop_on_signals,
)
from pipelines.campaign.run import Progress as RunProgress
from pipelines.measure.files.output import software_version
from pipelines.setup.file import Setup, ball_from_option, load_setup
from pipelines.terminal import screen

__all__ = [
    "CAMPAIGN_COMMANDS",
    "ClipsOrCommand",
    "campaign_command",
    "mark_command",
    "status_command",
]


class ClipsOrCommand(TyperGroup):
    """A group whose first word may also be a clip or folder: then `run` is meant."""

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]
        """Put the command's name in where it is left out."""
        if args and args[0] not in self.commands and args[0] not in ("--help", "-h"):
            args = ["run", *args]
        return super().parse_args(ctx, args)


_TABLES_EVERY_S = 5.0
"""The tables are written anew at most this often while clips come in; a clip takes longer."""


def campaign_command(
    clips: Annotated[
        list[Path], typer.Argument(metavar="CLIPS|FOLDER...", help="Clips, or folders of clips.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder of the campaign.")],
    trials: Annotated[
        Path | None, typer.Option("--trials", help="The lab book (CSV or XLSX).")
    ] = None,
    setup: Annotated[
        Path | None, typer.Option("--setup", help="What the lab knows (TOML).")
    ] = None,
    fps: Annotated[str | None, typer.Option("--fps", help="Capture rate, such as 600.")] = None,
    ball: Annotated[
        str | None, typer.Option("--ball", help="Ball where the lab book names none.")
    ] = None,
    wall_grid: Annotated[
        str | None, typer.Option("--wall-grid", help="Side of the wall's squares, such as 50mm.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option("-j", "--jobs", min=1, help="Processes; default: cores.")
    ] = None,
    dask: Annotated[
        str | None, typer.Option("--dask", metavar="tcp://HOST:PORT", help="A Dask cluster.")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option("--only", help="Measure this clip only; may be repeated.")
    ] = None,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Try failed clips once more.")
    ] = False,
    timeout: Annotated[
        float, typer.Option("--timeout", min=1.0, help="Longest time for one clip, s.")
    ] = 900.0,
    against_paper: Annotated[
        bool, typer.Option("--paper", help="Draw the paper's laws beside one's own.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no table.")] = False,
) -> None:
    """Measure every clip of a campaign once and turn them into figures and a law of restitution.

    The same command again goes on where it stopped. Example:
    vision campaign clips/ --trials trials.csv --setup lab.toml --out campaign
    """
    found = find_clips(clips)
    book = None if trials is None else read_lab_book(trials)
    read = Setup() if setup is None else load_setup(setup)
    options = RunOptions(setup, fps, ball, wall_grid, timeout)
    matched = match_clips(book, found)
    _require_balls(book, read, ball)
    plan = Plan(out, options, matched, software_version())
    strikes = {clip.name: strike for clip, strike in matched.strikes.items()}
    notes = _notes(book, [strike.clip for strike in matched.absent])
    facts = ReportFacts(
        f"Campaign {out.resolve().name}",
        software_version(),
        None if setup is None else setup.name,
        notes,
    )
    edition = Edition(out, book, strikes, read, ball, facts, against_paper)
    with lock_folder(out):
        _measure(plan, edition, jobs, dask, retry_failed, tuple(only or ()), quiet)
        with Ledger(out) as ledger:
            publish(edition, ledger)
            _tell(out, ledger, [strike.clip for strike in matched.absent], quiet)


def _require_balls(book: LabBook | None, setup: Setup, ball: str | None) -> None:
    """Refuse a ball that nobody knows before hours of work.

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
            raise UsageError(
                f"nobody says what ball {name!r} is",
                hint=f"Describe it as [balls.{name}] in the setup file (there: {known}).",
            ) from problem


def _notes(book: LabBook | None, absent: list[str]) -> tuple[str, ...]:
    notes = () if book is None else book.notes
    if absent:
        notes += (f"{len(absent)} clips of the lab book were not given: {', '.join(absent[:8])}.",)
    return notes


def _measure(
    plan: Plan,
    edition: Edition,
    jobs: int | None,
    dask: str | None,
    retry_failed: bool,
    only: tuple[str, ...],
    quiet: bool,
) -> None:
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
        last_tables = time.monotonic()

        def after_each(progress: RunProgress, outcome: Outcome) -> None:
            nonlocal last_tables
            bar.update(task, total=progress.todo, completed=progress.done + progress.failed)
            if outcome.state == State.FAILED and not quiet:
                errors.print(f"{outcome.clip}: {outcome.error}", soft_wrap=True)
            if time.monotonic() - last_tables > _TABLES_EVERY_S:
                with Ledger(plan.folder) as ledger:
                    publish_tables(edition, ledger)
                last_tables = time.monotonic()

        def crew():  # type: ignore[no-untyped-def]
            if dask is not None:
                return cluster_crew(dask, plan.options)
            return local_crew(jobs or cores(), plan.options)

        try:
            done = run(plan, crew, retry_failed=retry_failed, only=only, after_each=after_each)
        except KeyboardInterrupt:
            errors.print(
                f"stopped; what is done is kept in {plan.folder}."
                " The same command goes on where it stopped."
            )
            raise
    if not quiet:
        for clip, what in done.again.items():
            errors.print(f"{clip} was measured again: {what} changed since", soft_wrap=True)


def _tell(folder: Path, ledger: Ledger, absent: list[str], quiet: bool) -> None:
    """Print the state of the campaign and end with 4 where not every clip was measured.

    Raises
    ------
    MeasurementError
    """
    counts = ledger.counts()
    if not quiet:
        screen().print(f"{counts[State.DONE]} clips measured; report: {folder / 'report.html'}")
    wanting = [
        f"{entry.order.clip}: {entry.error or entry.state}"
        for entry in ledger.entries()
        if entry.state != State.DONE
    ]
    wanting += [f"{name}: named in the lab book, not given" for name in absent]
    if wanting:
        raise MeasurementError(
            f"{len(wanting)} clips could not be measured:\n" + "\n".join(wanting[:50]),
            hint="After mending, give the same command with --retry-failed.",
        )


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
