"""The commands that measure clips: demo, measure, contact-time, launch, landing, cor."""

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from metrology import (
    ImpactVisionError,
    MeasurementError,
    UsageError,
    write_text_whole,
)
from metrology.quantity import format_quantity
from pipelines.api.quantities import measure_options
from pipelines.batch import Folder, Job, files_of, measure_all
from pipelines.doors import refuse_clashes
from pipelines.measure.budget import Propagation
from pipelines.measure.chain import MeasureOptions, measure_clip
from pipelines.measure.files import (
    WantedFiles,
    measurement_as_json,
    measurements_as_csv,
    results_table,
)
from pipelines.measure.inputs import QuantityName, gather_inputs, kinds_of
from pipelines.measure.measurement import QUANTITY_UNITS, ClipMeasurement
from pipelines.measure.results import missing_input
from pipelines.options import (
    BallAtOption,
    BallOption,
    ClipArgument,
    ClipsOrNoneArgument,
    ColumnsOption,
    CsvOption,
    FpsOption,
    FromTracksOption,
    GridOption,
    JobsOption,
    JsonOption,
    MassAtOption,
    NoCacheOption,
    OutOption,
    OverlayOption,
    PlotOption,
    QuietOption,
    ReportOption,
    ScaleOption,
    SetupOption,
    TracksOption,
)
from pipelines.report import quantity_label
from pipelines.setup.file import load_setup
from pipelines.terminal import screen
from vision.tracks import MotionKind

__all__ = [
    "contact_time_command",
    "cor_command",
    "demo_command",
    "landing_command",
    "launch_command",
    "measure_command",
]

BudgetOption = Annotated[
    Propagation,
    typer.Option("--budget", help="Uncertainties: linear response of the fits, or slow refits."),
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
    csv: CsvOption = None,
    json: JsonOption = None,
    tracks: TracksOption = None,
    overlay: OverlayOption = None,
    plot: PlotOption = None,
    report: ReportOption = None,
    out: OutOption = None,
    jobs: JobsOption = None,
    scale: ScaleOption = None,
    from_tracks: FromTracksOption = None,
    columns: ColumnsOption = None,
    budget: BudgetOption = Propagation.RESPONSE,
    no_cache: NoCacheOption = False,
    quiet: QuietOption = False,
) -> None:
    """Measure contact, launch, landing and COR in one pass over each clip.

    Example: vision measure clip.mp4 --ball jokku --fps 600 --report clip.html

    No grid on the wall: vision measure clip.mp4 --fps 600 --scale "409.9 px/m ± 2 px/m"

    Many clips: vision measure clips/*.mp4 --setup lab.toml --out results -j 2 --report report.html
    writes results/CLIP.json and results/CLIP.report.html for each, and results/results.csv.

    Tracked elsewhere: vision measure clip.mp4 --from-tracks clip.trk --tracks clip.kva
    """
    wanted, options = _begin(locals())
    clips = list(clips or [])
    if from_tracks is not None:
        _from_tracks(from_tracks, clips, options, wanted, columns)
        return
    if columns is not None or not clips:
        raise UsageError(
            "--columns tells the columns of --from-tracks"
            if clips
            else "there is no clip to measure",
            hint="vision measure CLIP, or vision measure --from-tracks FILE",
        )
    if out is not None:
        said = [str(word) for word in (fps, ball, wall_grid, ball_at, mass_at, *_asked(wanted))]
        said += ["" if scale is None else scale, str(budget)]
        said.append("" if setup is None else setup.read_text(encoding="utf-8"))
        _into_folder(clips, options, wanted, Folder(out), said, jobs or os.cpu_count() or 1)
        return
    if jobs is not None:
        raise UsageError("-j measures several clips at once into a folder", hint="Add --out DIR.")
    if len(clips) > 1 and (tracks or overlay or plot or report or json):
        raise UsageError(
            "--tracks, --overlay, --plot, --report and --json take one clip at a time",
            hint="Several clips go into one --csv, or with all their files into --out DIR.",
        )
    _several(clips, options, wanted, tuple(QuantityName))


def _begin(given: Mapping[str, Any]) -> tuple[WantedFiles, MeasureOptions]:
    """What to write and how to measure, of a command's arguments by their names."""
    wanted = WantedFiles(**{one.name: given[one.name] for one in fields(WantedFiles)})
    wanted.require_kinds()
    how = ("setup", "fps", "ball", "wall_grid", "ball_at", "mass_at", "scale", "budget")
    chosen = {name: given[name] for name in how}
    return wanted, measure_options(**chosen, cache=not given["no_cache"])


def _make(names: tuple[str, ...], needed: str, summary: str, example: str):  # type: ignore[no-untyped-def]
    """Command for one group of quantities; they differ in nothing else."""

    def command(
        clip: ClipArgument,
        setup: SetupOption = None,
        fps: FpsOption = None,
        ball: BallOption = None,
        wall_grid: GridOption = None,
        ball_at: BallAtOption = None,
        mass_at: MassAtOption = None,
        csv: CsvOption = None,
        json: JsonOption = None,
        tracks: TracksOption = None,
        overlay: OverlayOption = None,
        plot: PlotOption = None,
        report: ReportOption = None,
        scale: ScaleOption = None,
        budget: BudgetOption = Propagation.RESPONSE,
        no_cache: NoCacheOption = False,
        quiet: QuietOption = False,
    ) -> None:
        wanted, options = _begin(locals())
        unmeasurable = f"{quantity_label(needed)} can't be measured from {clip}"
        inputs = gather_inputs(options.setup, options.ball, options.wall_grid)
        missing = missing_input(inputs, needed)
        if missing is not None and not wanted.quiet:
            # what else the clip shows is told all the same, but whoever waits for this one need not
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
    "How long mass and ball touch: frames counted, and the time between frames.",
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
    "Where the ball lands, as read on the wall and corrected for projection.",
    "vision landing clip.mp4 --wall-grid 50mm --ball jokku",
)
cor_command = _make(
    (*COR, "pendulum_speed_before", "ball_speed"),
    "cor",
    "Coefficient of restitution estimated three ways, with their agreement.",
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
        raise UsageError(f"can't make the folder {out}: {problem.strerror}") from problem
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
    files = (wanted.tracks, wanted.overlay, wanted.plot, wanted.report)
    return ["" if path is None else path.name for path in files]


def _into_folder(
    clips: Sequence[Path],
    options: MeasureOptions,
    wanted: WantedFiles,
    folder: Folder,
    said: Sequence[str],
    workers: int,
) -> None:
    """Measure clips in processes; what is done stays done, whatever happens to the rest."""
    if wanted.json == "-" or wanted.csv is not None:
        raise UsageError(
            "--out writes its own results.csv and a JSON of each clip",
            hint="Leave --csv and --json away.",
        )
    clips = list(dict.fromkeys(clips))
    placed = files_of(folder.out, clips, wanted)
    for clip in clips:
        placed[clip].require_kinds()
        refuse_clashes(placed[clip].files(), (clip, options.setup.path))
    names = tuple(QUANTITY_UNITS)
    todo = [Job(clip, options, placed[clip], names) for clip in clips]
    errors = screen(errors=True)
    failures: list[ImpactVisionError] = []
    count = 0
    try:
        for count, done in enumerate(measure_all(todo, folder, said, workers), start=1):
            if done.problem is not None:
                failures.append(done.problem)
            if done.problem is not None or not wanted.quiet:
                errors.print(f"{count}/{len(clips)} {done.clip.name}: {done.told}", soft_wrap=True)
    except KeyboardInterrupt:
        errors.print(
            f"stopped: {count} of {len(clips)} clips are done, and in {folder.table}."
            " The same command again goes on with the rest.",
            soft_wrap=True,
        )
        raise
    if not wanted.quiet:
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
    """Measure what another program tracked, with the clip or without."""
    from pipelines.interop.measured import measure_from_tracks, settled_columns
    from pipelines.interop.tables import parse_columns

    if len(clips) > 1:
        raise UsageError(
            "--from-tracks goes with one clip", hint="Give the clip that was tracked, or none."
        )
    clip = clips[0] if clips else None
    wanted.require_clip(clip)
    setup = options.setup
    said = settled_columns(path, {**setup.columns, **parse_columns(columns)}, setup.path)
    names = tuple(QuantityName)
    measured = _measured(
        lambda tell: measure_from_tracks(path, options, clip, said, tell), clip, wanted, names
    )
    _require_something(measured, path)


def _several(
    clips: Sequence[Path], options: MeasureOptions, wanted: WantedFiles, names: tuple[str, ...]
) -> None:
    """Measure all clips; one that fails is told and does not take the others with it."""
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


def _require_something(measured: ClipMeasurement, path: Path) -> None:
    """Refuse a measurement in which nothing is known.

    Raises
    ------
    MeasurementError
    """
    if any(item.known for item in measured.quantities):
        return
    kind = measured.motion.kind
    named = [(item, kinds_of(item.name)) for item in measured.quantities]
    own = [item for item, kinds in named if kind in kinds and len(kinds) < len(MotionKind)]
    reason = (own or list(measured.quantities))[0].reason
    raise MeasurementError(f"nothing can be measured from {path}: {reason}")


def _one(
    clip: Path,
    options: MeasureOptions,
    wanted: WantedFiles,
    names: tuple[str, ...],
    *,
    budgets: bool = True,
) -> ClipMeasurement:
    return _measured(
        lambda tell: measure_clip(clip, options, tell), clip, wanted, names, budgets=budgets
    )


def _measured(
    measure: Callable[[Callable[[str, float], None]], ClipMeasurement],
    clip: Path | None,
    wanted: WantedFiles,
    names: tuple[str, ...],
    *,
    budgets: bool = True,
) -> ClipMeasurement:
    """Measure with a bar on the terminal, write the files, and tell."""
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
        wanted.write(measured, clip, names)
    if wanted.json == "-":
        sys.stdout.write(measurement_as_json(measured, names) + "\n")
    elif not wanted.quiet:
        screen().print(results_table(measured, names))
        if wanted.report is not None and budgets:
            _print_budgets(measured, names)
    if not wanted.quiet:
        for warning in measured.warnings:
            errors.print(f"warning: {warning}", soft_wrap=True)
    return measured


def _print_budgets(measured: ClipMeasurement, names: tuple[str, ...]) -> None:
    console = screen()
    console.print("uncertainty budgets (one standard uncertainty each)")
    for item in measured.quantities:
        if item.name not in names or not item.known:
            continue
        lines = ", ".join(f"{line.source} {line.std:.2g}" for line in item.budget[:4])
        console.print(
            f"  {quantity_label(item.name)}: {format_quantity(item)} = {lines}",
            soft_wrap=True,
        )
