"""Commands that measure clips: demo, measure, contact-time, launch, landing, cor.

Several clips are measured in processes that survive crashes, into a folder of results that grows
clip by clip (`vision measure CLIP… --out DIR -j N`).
"""

import csv
import hashlib
import io
import itertools
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from importlib.resources import files
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from measuring.budget import Propagation
from measuring.chain import MeasureOptions, measure_clip
from measuring.inputs import QuantityName, gather_inputs, kinds_of
from measuring.measurement import QUANTITY_UNITS, ClipMeasurement
from measuring.results import missing_input, motion_seen
from measuring.setup.file import load_setup
from metrology import (
    ImpactVisionError,
    MeasurementError,
    NotFoundError,
    OutputError,
    UsageError,
    write_text_whole,
)
from metrology.files import printable
from metrology.quantity import format_quantity
from pipelines.api.quantities import measure_options
from pipelines.doors import (
    AxesOption,
    BallAtOption,
    BallOption,
    ClipArgument,
    ClipsOrNoneArgument,
    ColumnsOption,
    CsvOption,
    DetectionsOption,
    EveryOption,
    FpsOption,
    FromTracksOption,
    GridOption,
    JobsOption,
    JsonOption,
    KindOption,
    LandingAtOption,
    MassAtOption,
    NoCacheOption,
    OutOption,
    OverlayOption,
    PivotAtOption,
    PlotOption,
    QuietOption,
    ReportOption,
    ScaleOption,
    SetupOption,
    TrackletsOption,
    TracksOption,
    refuse_clashes,
)
from pipelines.measure.files import (
    WantedFiles,
    measurement_as_json,
    measurement_as_row,
    measurements_as_csv,
    results_table,
    software_version,
    without_formulas,
)
from pipelines.processes import PipedProcess
from pipelines.report.inputs import for_people, quantity_label, quantity_text
from pipelines.terminal import counted, screen
from vision.clip.clip import ClipReader
from vision.tracks import MotionKind

__all__ = [
    "Done",
    "Folder",
    "Job",
    "WorkerDied",
    "contact_time_command",
    "cor_command",
    "demo_command",
    "files_of",
    "landing_command",
    "launch_command",
    "measure_all",
    "measure_command",
    "run_tasks",
]

Task = TypeVar("Task")

Result = TypeVar("Result")


class WorkerDied(Exception):
    """The process ended while it worked on the task."""


def run_tasks(
    function: Callable[[Task], Result], tasks: Iterable[Task], workers: int
) -> Iterator[tuple[Task, Result | Exception]]:
    """Run tasks in processes; yield each with its result or exception as they finish.

    Parameters
    ----------
    function : callable
        Defined in a module, so that a fresh process can import it; tasks and results are pickled.
    workers : int
        Number of processes.

    Yields
    ------
    task, result
        The result is `WorkerDied` if the process ended during the task. Leaving the iteration, also
        by Ctrl-C, ends all processes.
    """
    waiting = iter(tasks)
    busy: dict[Any, tuple[PipedProcess, Task]] = {}

    def give(worker: PipedProcess, task: Task) -> None:
        worker.send(task)
        busy[worker.pipe] = worker, task

    try:
        for task in itertools.islice(waiting, max(workers, 1)):
            give(PipedProcess(_serve, function), task)
        while busy:
            for pipe in wait([*busy]):
                worker, done = busy[pipe]
                try:
                    result = worker.pipe.recv()
                except (EOFError, OSError):
                    worker.process.join()
                    result = WorkerDied(f"its process ended with code {worker.process.exitcode}")
                del busy[pipe]
                following = next(waiting, None)
                if following is None or isinstance(result, WorkerDied):
                    worker.end()
                if following is not None:
                    dead = isinstance(result, WorkerDied)
                    give(PipedProcess(_serve, function) if dead else worker, following)
                yield done, result
    finally:
        for worker, _ in busy.values():
            worker.end()


def _serve(pipe: Connection, function: Callable[[Any], Any]) -> None:
    """Answer tasks until the other end of the pipe is closed."""
    with suppress(EOFError, OSError):
        while True:
            task = pipe.recv()
            try:
                answer: Any = function(task)
            except Exception as problem:  # handed to whoever asked, not swallowed
                answer = problem
            pipe.send(answer)


_SUMMARIZED = ("contact_time", "ball_speed", "cor")


@dataclass(frozen=True)
class Job:
    """One clip to measure and its output files."""

    clip: Path
    options: MeasureOptions
    wanted: WantedFiles
    names: tuple[str, ...]


@dataclass(frozen=True)
class Done:
    """A measured clip, or why it was not measured."""

    clip: Path
    row: Mapping[str, object] | None
    summary: str
    problem: ImpactVisionError | None = None
    warnings: tuple[str, ...] = ()


class Folder:
    """Results of a folder: ``results.csv``, one row per clip, and a digest of their options.

    Parameters
    ----------
    out : Path
        Created if it does not exist.

    Raises
    ------
    UsageError
        If it can't be created, or its ``results.csv`` is not a table of results.
    """

    def __init__(self, out: Path) -> None:
        self.out = out
        self.table = out / "results.csv"
        self._ledger = out / ".measured.json"
        try:
            out.mkdir(parents=True, exist_ok=True)
            self._rows = _read_rows(self.table)
            self._made: dict[str, str] = json.loads(_text(self._ledger) or "{}")
        except (OSError, ValueError, csv.Error) as problem:
            raise UsageError(
                f"can't use the folder {out}: {problem}", hint="Name an empty folder with --out."
            ) from problem

    def holds(self, clip: Path, digest: str) -> bool:
        """Whether the clip was measured from the same file with the same options."""
        key = printable(str(clip))
        return self._made.get(key) == digest and key in self._rows

    def add(self, clip: Path, row: Mapping[str, object], digest: str) -> None:
        """Add a row, replacing an earlier one of the clip; the table is written completely."""
        key = printable(str(clip))
        self._rows[key] = {name: _cell(cell) for name, cell in without_formulas(row).items()}
        self._made[key] = digest
        columns = dict.fromkeys(name for one in self._rows.values() for name in one)
        text = io.StringIO()
        writer = csv.DictWriter(text, [*columns], restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._rows.values())
        write_text_whole(self.table, text.getvalue())
        write_text_whole(self._ledger, json.dumps(self._made, indent=0))


def files_of(out: Path, clips: Sequence[Path], wanted: WantedFiles) -> dict[Path, WantedFiles]:
    """Output files of each clip: ``DIR/CLIP.json``, and ``DIR/CLIP.NAME`` for each file requested.

    Clips of the same name in several folders get a number.
    """
    taken: dict[str, int] = {}
    placed = {}
    for clip in clips:
        taken[clip.stem] = taken.get(clip.stem, 0) + 1
        number = taken[clip.stem]
        stem = clip.stem if number == 1 else f"{clip.stem}-{number}"

        def beside(asked: Path | None, stem: str = stem) -> Path | None:
            return None if asked is None else out / f"{stem}.{asked.name.lstrip('.')}"

        placed[clip] = replace(
            wanted,
            csv=None,
            json=str(out / f"{stem}.json"),
            tracks=beside(wanted.tracks),
            overlay=beside(wanted.overlay),
            plot=beside(wanted.plot),
            report=beside(wanted.report),
            detections=beside(wanted.detections),
            tracklets=beside(wanted.tracklets),
        )
    return placed


def digest_of(clip: Path, option_texts: Sequence[str]) -> str:
    """Digest of a clip's size and time stamp, the options and the software version."""
    about = clip.stat() if clip.exists() else None
    stamp = "" if about is None else f"{about.st_size} {about.st_mtime_ns}"
    words = "\n".join([software_version(), stamp, *option_texts])
    return hashlib.sha256(words.encode("utf-8", "backslashreplace")).hexdigest()


def measure_all(
    jobs: Sequence[Job], folder: Folder, option_texts: Sequence[str], workers: int
) -> Iterator[Done]:
    """Measure the clips that the folder does not have yet; yield each as it finishes.

    Parameters
    ----------
    folder : Folder
        Receives each row before it is yielded.
    option_texts : sequence of str
        All options as typed, and the setup file's text; a change means measuring again.
    """
    digests = {job.clip: digest_of(job.clip, option_texts) for job in jobs}
    left = [job for job in jobs if not folder.holds(job.clip, digests[job.clip])]
    for job in jobs:
        if job not in left:
            yield Done(job.clip, {}, "measured before")
    for job, result in run_tasks(_measure_job, left, workers):
        if isinstance(result, ImpactVisionError):
            yield Done(job.clip, None, str(result), result)
        elif isinstance(result, WorkerDied):
            problem = ImpactVisionError(
                f"{job.clip}: {result}",
                hint="Run the same command again. If it fails again, copy the clip anew.",
            )
            yield Done(job.clip, None, str(problem), problem)
        elif isinstance(result, Exception):
            raise result
        else:
            row, summary, warnings = result
            folder.add(job.clip, row, digests[job.clip])
            yield Done(job.clip, row, summary, None, warnings)


def _measure_job(job: Job) -> tuple[dict[str, object], str, tuple[str, ...]]:
    """Measure one clip and write its files; return its row, a summary line and its warnings."""
    measured = measure_clip(job.clip, job.options)
    try:
        job.wanted.write(measured, job.clip, job.names)
    except OutputError:
        raise
    except ImpactVisionError as problem:
        # nothing to draw is no reason to lose the row
        measured = replace(measured, warnings=(*measured.warnings, problem.in_one_line))
    summary = [
        f"{quantity_label(item.name)} {quantity_text(item)}"
        for item in measured.quantities
        if item.name in _SUMMARIZED and item.known
    ]
    said = ", ".join(summary) or "nothing could be measured"
    return measurement_as_row(measured, job.names), said, measured.warnings


def _read_rows(table: Path) -> dict[str, dict[str, str]]:
    text = _text(table)
    if not text:
        return {}
    rows = [*csv.DictReader(io.StringIO(text))]
    if rows and "clip" not in rows[0]:
        raise ValueError(f"{table} is not a table of results: it has no column clip")
    return {row["clip"].removeprefix("'"): row for row in rows}


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.exists() else ""


def _cell(cell: object) -> str:
    return "" if cell is None else str(cell)


BudgetOption = Annotated[
    Propagation,
    typer.Option("--budget", help="Uncertainties by linear response of the fits, or slow refits."),
]

CONTACT = ("contact_frames", "contact_time", "contact_start", "contact_end")
LAUNCH = ("ball_speed", "launch_angle", "pendulum_speed_before", "pendulum_speed_after")
LANDING = (
    "landing_distance",
    "landing_distance_on_wall",
    "landing_time",
    "ball_plane_offset",
    "camera_distance",
)
COR = ("cor_speeds", "cor_launch", "cor_range", "cor", "external_impulse", "energy_loss")


def measure_command(
    clips: ClipsOrNoneArgument = None,
    setup: SetupOption = None,
    fps: FpsOption = None,
    ball: BallOption = None,
    wall_grid: GridOption = None,
    ball_at: BallAtOption = None,
    mass_at: MassAtOption = None,
    pivot_at: PivotAtOption = None,
    landing_at: LandingAtOption = None,
    axes: AxesOption = None,
    kind: KindOption = None,
    csv: CsvOption = None,
    json: JsonOption = None,
    tracks: TracksOption = None,
    detections: DetectionsOption = None,
    tracklets: TrackletsOption = None,
    overlay: OverlayOption = None,
    plot: PlotOption = None,
    report: ReportOption = None,
    out: OutOption = None,
    jobs: JobsOption = None,
    scale: ScaleOption = None,
    from_tracks: FromTracksOption = None,
    columns: ColumnsOption = None,
    every: EveryOption = 1,
    budget: BudgetOption = Propagation.RESPONSE,
    no_cache: NoCacheOption = False,
    quiet: QuietOption = False,
) -> None:
    """Measure contact, launch, landing and COR in one pass over each clip.

    Example: vision measure clip.mp4 --ball jokku --fps 600 --report clip.html

    No grid on the wall: vision measure clip.mp4 --fps 600 --scale "409.9 px/m ± 2 px/m"

    Many clips: vision measure clips/*.mp4 --setup lab.toml --out results -j 2 --report report.html
    writes results/CLIP.json and results/CLIP.report.html for each, and results/results.csv.

    Tracks of another program: vision measure clip.mp4 --from-tracks clip.trk --tracks clip.kva
    """
    wanted, options = _begin(locals())
    clips = list(clips or [])
    if from_tracks is not None:
        _from_tracks(from_tracks, clips, options, wanted, columns)
        return
    if columns is not None or not clips:
        raise UsageError(
            "--columns needs --from-tracks: it names the columns of that table"
            if clips
            else "no clip given",
            hint="vision measure CLIP, or vision measure --from-tracks FILE",
        )
    if out is not None:
        words = (fps, ball, wall_grid, ball_at, mass_at, pivot_at, landing_at, axes, kind)
        option_texts = [str(word) for word in (*words, *_asked(wanted))]
        option_texts += ["" if scale is None else scale, str(budget), str(every)]
        option_texts.append("" if setup is None else setup.read_text(encoding="utf-8"))
        _into_folder(clips, options, wanted, Folder(out), option_texts, jobs or os.cpu_count() or 1)
        return
    if jobs is not None:
        raise UsageError("-j measures several clips into a folder", hint="Add --out DIR.")
    if len(clips) > 1 and {*wanted.files()} - {"--csv"} | {*filter(None, [json])}:
        raise UsageError(
            "all files but --csv take one clip at a time",
            hint="For several clips use one --csv, or --out DIR for all files of each.",
        )
    _several(clips, options, wanted, tuple(QuantityName))


def _begin(given: Mapping[str, Any]) -> tuple[WantedFiles, MeasureOptions]:
    """Requested files and measuring options from a command's arguments by name."""
    named = {one.name for one in fields(WantedFiles)}
    wanted = WantedFiles(**{name: value for name, value in given.items() if name in named})
    how = ("setup", "fps", "ball", "wall_grid", "ball_at", "mass_at", "scale", "budget", "every")
    chosen = {name: given[name] for name in (*how, "kind", "pivot_at", "landing_at", "axes")}
    return wanted, measure_options(**chosen, cache=not given["no_cache"])


def _make(names: tuple[str, ...], needed: str, summary: str, example: str):  # type: ignore[no-untyped-def]
    """Command for one group of quantities."""

    def command(
        clip: ClipArgument,
        setup: SetupOption = None,
        fps: FpsOption = None,
        ball: BallOption = None,
        wall_grid: GridOption = None,
        ball_at: BallAtOption = None,
        mass_at: MassAtOption = None,
        pivot_at: PivotAtOption = None,
        landing_at: LandingAtOption = None,
        axes: AxesOption = None,
        kind: KindOption = None,
        csv: CsvOption = None,
        json: JsonOption = None,
        tracks: TracksOption = None,
        overlay: OverlayOption = None,
        plot: PlotOption = None,
        report: ReportOption = None,
        scale: ScaleOption = None,
        every: EveryOption = 1,
        budget: BudgetOption = Propagation.RESPONSE,
        no_cache: NoCacheOption = False,
        quiet: QuietOption = False,
    ) -> None:
        wanted, options = _begin(locals())
        unmeasurable = f"{quantity_label(needed)} can't be measured from {clip}"
        inputs = gather_inputs(options.setup, options.ball, options.wall_grid)
        stated = options.landing_at is not None
        missing = missing_input(inputs, needed, landing_stated=stated)
        if missing is not None and not wanted.quiet:
            # other quantities are still measured; this warning comes before the wait
            screen(errors=True).print(f"warning: {unmeasurable}: {missing}", soft_wrap=True)
        if not wanted.pictures:
            options = replace(options, wanted=names)
        measured = _one(clip, options, wanted, names)
        quantity = measured.quantity(needed)
        if not quantity.known:
            raise MeasurementError(f"{unmeasurable}: {quantity.reason}")

    command.__doc__ = f"{summary}\n\nExample: {example}"
    return command


contact_time_command = _make(
    CONTACT,
    "contact_time",
    "Contact time: contact frames counted, and the sub-frame value.",
    "vision contact-time clip.mp4 --fps 600",
)
launch_command = _make(
    LAUNCH,
    "ball_speed",
    "Launch angle and speed of the ball, speed of the pendulum before and after.",
    "vision launch clip.mp4 --ball jokku",
)
landing_command = _make(
    LANDING,
    "landing_distance",
    "Landing point and distance, read on the wall and corrected for projection.",
    "vision landing clip.mp4 --wall-grid 50mm --ball jokku",
)
cor_command = _make(
    (*COR, "pendulum_speed_before", "ball_speed"),
    "cor",
    "Coefficient of restitution by three methods, with their agreement.",
    "vision cor clip.mp4 --ball jokku --setup setup.toml",
)


def demo_command(
    out: Annotated[Path, typer.Option("--out", help="Folder to write to.")] = Path("vision-demo"),
) -> None:
    """Measure the sample clip that ships with the package, end to end.

    Example: vision demo
    """
    folder = Path(str(files("sample_videos"))) / "clips"
    clip = folder / "basketball_60.mp4"
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise UsageError(
            f"can't make the folder {out}: {problem.strerror}",
            hint="Name a folder with write permission.",
        ) from problem
    wanted = WantedFiles(
        csv=out / "results.csv",
        json=str(out / "results.json"),
        tracks=out / "tracks.csv",
        overlay=out / "overlay.mp4",
        plot=out / "plots.png",
        report=out / "report.html",
    )
    options = MeasureOptions(setup=load_setup(clip.with_suffix(".toml")))
    _one(clip, options, wanted, tuple(QUANTITY_UNITS), budgets=False)
    screen().print(f"report, overlay, plots and CSV are in {out}/")


def _asked(wanted: WantedFiles) -> list[str]:
    return [f"{option} {path.name}" for option, path in wanted.files().items()]


def _into_folder(
    clips: Sequence[Path],
    options: MeasureOptions,
    wanted: WantedFiles,
    folder: Folder,
    option_texts: Sequence[str],
    workers: int,
) -> None:
    """Measure clips in processes; finished clips stay finished."""
    if wanted.json == "-" or wanted.csv is not None:
        raise UsageError(
            "--out writes results.csv and a JSON file per clip itself",
            hint="Omit --csv and --json.",
        )
    clips = list(dict.fromkeys(clips))
    placed = files_of(folder.out, clips, wanted)
    for clip in clips:
        refuse_clashes(placed[clip].files(), (clip, options.setup.path))
    names = tuple(QUANTITY_UNITS)
    todo = [Job(clip, options, placed[clip], names) for clip in clips]
    errors = screen(errors=True)
    failures: list[ImpactVisionError] = []
    warnings: list[tuple[str, ...]] = []
    count = 0
    try:
        for count, done in enumerate(measure_all(todo, folder, option_texts, workers), start=1):
            warnings.append(done.warnings)
            if done.problem is not None:
                failures.append(done.problem)
            if done.problem is not None or not wanted.quiet:
                errors.print(
                    f"{count}/{len(clips)} {done.clip.name}: {done.summary}", soft_wrap=True
                )
    except KeyboardInterrupt:
        errors.print(
            f"stopped: {count} of {len(clips)} clips are done and in {folder.table}."
            " Run the same command again to continue.",
            soft_wrap=True,
        )
        raise
    if not wanted.quiet:
        for line in counted(warnings):
            errors.print(line, soft_wrap=True)
        screen().print(f"{len(clips) - len(failures)} of {len(clips)} clips are in {folder.table}")
    if failures:
        raise type(failures[0])(f"{len(failures)} of {len(clips)} clips could not be measured")


def _from_tracks(
    path: Path,
    clips: Sequence[Path],
    options: MeasureOptions,
    wanted: WantedFiles,
    columns: str | None,
) -> None:
    """Measure tracks of another program, with or without the clip, or a corrected table."""
    from pipelines.interop.corrected import is_corrected, read_corrected
    from pipelines.interop.measured import measure_from_tracks, settled_columns
    from pipelines.interop.tables import parse_columns

    if len(clips) > 1:
        raise UsageError("--from-tracks takes one clip", hint="Give the tracked clip, or none.")
    clip = clips[0] if clips else None
    wanted.require_clip(clip)
    if is_corrected(path):
        if clip is None or columns is not None:
            raise UsageError(
                f"{path} is a table of objects found in a clip: it needs the clip, no --columns",
                hint=f"vision measure CLIP --from-tracks {path}",
            )
        corrected = replace(options, corrected=read_corrected(path))
        _require_something(_one(clip, corrected, wanted, tuple(QuantityName)), clip)
        return
    wanted.require_following()
    setup = options.setup
    option_texts = settled_columns(path, {**setup.columns, **parse_columns(columns)}, setup.path)
    names = tuple(QuantityName)
    measured = _measured(
        lambda tell: measure_from_tracks(path, options, clip, option_texts, tell),
        clip,
        wanted,
        names,
    )
    _require_something(measured, path)


def _several(
    clips: Sequence[Path], options: MeasureOptions, wanted: WantedFiles, names: tuple[str, ...]
) -> None:
    """Measure all clips; report those that fail and continue."""
    if len(clips) == 1:
        _require_something(_one(clips[0], options, wanted, names), clips[0])
        return
    done: list[ClipMeasurement] = []
    failures: list[ImpactVisionError] = []
    for clip in clips:
        try:
            done.append(_one(clip, options, WantedFiles(quiet=wanted.quiet), names))
        except ImpactVisionError as problem:
            failures.append(problem)
            screen(errors=True).print(f"vision: {problem}", soft_wrap=True)
    if wanted.csv is not None and done:
        write_text_whole(wanted.csv, measurements_as_csv(done, names))
    if failures:
        raise type(failures[0])(f"{len(failures)} of {len(clips)} clips could not be measured")


_REASONS = 3
"""Number of reasons listed if nothing is measured (chosen; the first alone may concern a quantity
that is never measurable)."""


def _require_something(measured: ClipMeasurement, path: Path) -> None:
    """Refuse a measurement without any known quantity.

    Raises
    ------
    MeasurementError
    """
    if any(item.known for item in measured.quantities):
        return
    kind = measured.motion.measured_as
    named = [(item, kinds_of(item.name)) for item in measured.quantities]
    own = [item for item, kinds in named if kind in kinds and len(kinds) < len(MotionKind)]
    said = [item.reason for item in own or measured.quantities if item.reason]
    motion = measured.motion
    none = MotionKind.NONE
    of_none = motion.kind is none or (kind is none and not motion.is_doubtful)
    seen = [motion_seen(measured.tracks)] if of_none else []
    reasons = dict.fromkeys([*seen, *said])
    # "it needs a strike, but …" repeats the cause
    causes = [one for one in reasons if not any(one.endswith(f", but {o}") for o in reasons)]
    found = [finding.sentence.rstrip(".") for finding in measured.findings]
    # missing facts do not explain why no motion is seen; a wrong input does
    wrong = any(finding.key != "facts" for finding in measured.findings)
    causes = found if wrong else [*found, *causes]
    raise MeasurementError(
        f"nothing can be measured from {path}: {'; '.join(causes[:_REASONS])}",
        hint=None
        if wrong and any(finding.option for finding in measured.findings)
        else "A flight must be visible over several frames or marks, a swing from end to end. If"
        " another object was tracked, point with --ball-at and --mass-at; among several tracks name"
        ' the ball with --columns "ball=NAME".',
    )


def _one(
    clip: Path,
    options: MeasureOptions,
    wanted: WantedFiles,
    names: tuple[str, ...],
    *,
    budgets: bool = True,
) -> ClipMeasurement:
    try:
        return _measured(
            lambda tell: measure_clip(clip, options, tell), clip, wanted, names, budgets=budgets
        )
    except NotFoundError:
        # the tables show what there was to choose from
        wanted.write_unchosen(ClipReader.open(clip, every=options.every))
        raise


def _measured(
    measure: Callable[[Callable[[str, float], None]], ClipMeasurement],
    clip: Path | None,
    wanted: WantedFiles,
    names: tuple[str, ...],
    *,
    budgets: bool = True,
) -> ClipMeasurement:
    """Measure with a progress bar on the terminal, write the files and print the results."""
    errors = screen(errors=True)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=errors,
        transient=True,
        disable=wanted.quiet or not errors.is_terminal,
    ) as bar:
        task = bar.add_task("reading", total=1.0)
        measured = measure(lambda step, part: bar.update(task, description=step, completed=part))
        bar.update(task, description="writing", completed=0.5)
        refused: ImpactVisionError | None = None
        try:
            wanted.write(measured, clip, names)
        except ImpactVisionError as problem:
            # print the results before the error
            refused = problem
    if not wanted.quiet:
        for assumption in measured.assumed:
            errors.print(f"assumed: {assumption.sentence}", soft_wrap=True)
    if wanted.json == "-":
        sys.stdout.write(measurement_as_json(measured, names) + "\n")
    elif not wanted.quiet and any(
        item.known and item.name in names for item in measured.quantities
    ):
        screen().print(results_table(measured, names))
        if wanted.report is not None and budgets:
            _print_budgets(measured, names)
    if not wanted.quiet:
        shown = {assumption.sentence for assumption in measured.assumed}
        for warning in measured.warnings:
            if warning in shown:
                continue
            errors.print(f"warning: {warning}", soft_wrap=True)
    if refused is not None:
        raise refused
    return measured


def _print_budgets(measured: ClipMeasurement, names: tuple[str, ...]) -> None:
    console = screen()
    console.print("uncertainty budgets (one standard uncertainty each)")
    for item in map(for_people, measured.quantities):
        if item.name not in names or not item.known:
            continue
        lines = ", ".join(f"{line.source} {line.std:.2g}" for line in item.budget[:4])
        console.print(
            f"  {quantity_label(item.name)}: {format_quantity(item)} = {lines}",
            soft_wrap=True,
        )
