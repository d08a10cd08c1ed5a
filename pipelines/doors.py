"""Command wrapper and shared options: file checks, messages and exit codes.

Output files are checked before the work begins: an output must be writable, must not be an input,
and must not be named by two options.
"""

import errno
import functools
import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, get_type_hints

import typer

if TYPE_CHECKING:
    from metrology import MeasurementError

__all__ = [
    "DATE",
    "DEBUG",
    "BallAtOption",
    "BallOption",
    "ClipArgument",
    "ClipsOrNoneArgument",
    "ColumnsOption",
    "CorLawOption",
    "CorOption",
    "CsvOption",
    "DetectionsOption",
    "DragOption",
    "EffectOption",
    "EveryOption",
    "FileRole",
    "FpsOption",
    "FromTracksOption",
    "GridOption",
    "JobsOption",
    "JsonOption",
    "KindOption",
    "MassAtOption",
    "NamedBallOption",
    "NoCacheOption",
    "NoTableOption",
    "OutOption",
    "OverlayOption",
    "PlotOption",
    "QuietOption",
    "ReportOption",
    "ResultsCsvOption",
    "ResultsJsonOption",
    "ScaleOption",
    "SetupFileOption",
    "SetupOption",
    "TrackletsOption",
    "TracksOption",
    "guarded",
    "loading",
    "refuse_clashes",
]

DEBUG = "IMPACT_VISION_DEBUG"
"""Environment variable: keep the traceback of a numerical failure (set by ``vision --debug``)."""

DATE = "IMPACT_VISION_DATE"
"""Environment variable: day written into reports and SVGs (set by ``--date``); else there is none,
so that the same run gives the same bytes."""

_FILE_ERRORS = frozenset(
    {
        errno.ENOENT,
        errno.EACCES,
        errno.EPERM,
        errno.ENAMETOOLONG,
        errno.EISDIR,
        errno.ENOTDIR,
        errno.ELOOP,
        errno.EIO,
        errno.EROFS,
        errno.ESTALE,
        errno.ENXIO,
    }
)
"""System errors about named files or disks; they are the user's to fix, not bugs."""

_NUMERICAL_LIBRARIES = frozenset({"numpy", "scipy"})
"""Libraries whose own ValueError means that the numbers can't be fitted."""

_SIGNAL_EXIT_CODE = 128
"""Offset of the exit code of a process ended by a signal (POSIX shells)."""


class FileRole(Enum):
    """Role of the file of an option, stored in the option's annotation."""

    WRITES = "writes"


def guarded(command: Callable[..., None]) -> Callable[..., None]:
    """Wrap a command: check its files first; map exceptions to messages and exit codes.

    Parameters
    ----------
    command : callable
        A typer command; options that write a file carry `FileRole.WRITES` in their annotation.

    Returns
    -------
    callable
        Raises ``typer.Exit`` for the project's errors, a full disk, a closed pipe, an interrupt
        (130), SIGTERM (143) and numbers that can't be fitted (4).
    """
    from metrology import ImpactVisionError
    from metrology.files import shown_path
    from pipelines.processes import Terminated
    from pipelines.terminal import screen

    @functools.wraps(command)
    def run(*args: Any, **options: Any) -> None:
        def end(message: str, code: int) -> NoReturn:
            screen(errors=True).print(f"vision: {message}", soft_wrap=True)
            raise typer.Exit(code)

        try:
            with _tidy_when_terminated():
                _check_files(command, options)
                with loading():
                    command(*args, **options)
                sys.stdout.flush()
        except ImpactVisionError as problem:
            end(str(problem), problem.exit_code)
        except KeyboardInterrupt as stop:
            number = signal.SIGTERM if isinstance(stop, Terminated) else signal.SIGINT
            raise typer.Exit(_SIGNAL_EXIT_CODE + number) from None
        except BrokenPipeError:
            _silence_stdout()
            raise typer.Exit(_SIGNAL_EXIT_CODE + signal.SIGPIPE) from None
        except OSError as problem:
            if problem.errno in (errno.ENOSPC, errno.EDQUOT):
                _silence_stdout()
                end(f"the disk is full: {problem.strerror}\nFree some space and run it again.", 2)
            if problem.filename is None or problem.errno not in _FILE_ERRORS:
                raise
            end(
                f"can't use {shown_path(problem.filename)}: {problem.strerror}\n"
                "Check the name and the permissions of the file and its folder.",
                2,
            )
        except MemoryError:
            end(f"there is not enough memory{_limit_text()}\n{_MEMORY_HINT}", 2)
        except (ArithmeticError, ValueError) as problem:
            if not _is_numerical(problem):
                raise
            if os.environ.get(DEBUG):
                raise
            failed = _no_fit(problem)
            end(str(failed), failed.exit_code)

    return run


_MEMORY_HINT = "A clip needs about a gigabyte: raise the limit (ulimit -v)."
_MIN_MEMORY_LIMIT = 1 << 30
"""Bytes; smaller limits on address space may not hold the libraries themselves."""


def _memory_limit() -> int | None:
    """Limit of this process's address space, bytes; None if there is none."""
    try:
        import resource
    except ImportError:
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else int(limit)


def _limit_text() -> str:
    limit = _memory_limit()
    return "" if limit is None else f": this process is limited to {limit >> 20} MiB"


@contextmanager
def loading() -> Iterator[None]:
    """Distinguish libraries that exceed a memory limit from libraries that are missing.

    Raises
    ------
    typer.Exit
        With code 2 and a message; without such a limit an ImportError is raised as it is.
    """
    try:
        yield
    except (ImportError, MemoryError):
        limit = _memory_limit()
        if limit is None or limit > _MIN_MEMORY_LIMIT:
            raise
        typer.echo(f"vision: loading the libraries failed{_limit_text()}\n{_MEMORY_HINT}", err=True)
        raise typer.Exit(2) from None


def _is_numerical(problem: Exception) -> bool:
    """Whether a numerical operation failed: singular, not finite, no optimum.

    A ValueError counts only if a numerical library raised it.
    """
    from numpy.linalg import LinAlgError

    if isinstance(problem, ArithmeticError | LinAlgError):
        return True
    trace = problem.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    inmost = "" if trace is None else str(trace.tb_frame.f_globals.get("__name__", ""))
    return inmost.split(".")[0] in _NUMERICAL_LIBRARIES


def _no_fit(problem: Exception) -> "MeasurementError":
    from metrology import NoFitError

    return NoFitError(
        f"these numbers can't be fitted: {problem}",
        hint="Plot the input: check columns, units and times. Run the same command as vision "
        "--debug COMMAND to see the traceback.",
    )


_ENDINGS = {
    "--overlay": (".mp4", ".mov", ".mkv"),
    "--plot": (".png", ".svg"),
    "--detections": (".csv",),
    "--tracklets": (".csv",),
}
"""File endings of the options that require one."""


def refuse_clashes(outputs: Mapping[str, Path], inputs: Iterable[Path | None]) -> None:
    """Refuse outputs that can't be written, are also inputs, are named twice or end wrongly.

    Parameters
    ----------
    outputs : mapping
        Option as typed ("--csv") → file.
    inputs : iterable of Path or None
        Files that are read; they need not exist.

    Raises
    ------
    UsageError
    """
    from metrology import UsageError, refuse_unwritable

    read = [path for path in inputs if path is not None and os.path.isfile(path)]
    taken: dict[str, str] = {}
    for option, path in outputs.items():
        refuse_unwritable(path)
        endings = _ENDINGS.get(option, ())
        if endings and path.suffix.lower() not in endings:
            raise UsageError(
                f"{option} {path}: unknown file ending",
                hint=f"Name a file that ends in {', '.join(endings)}.",
            )
        if any(path.exists() and path.samefile(given) for given in read):
            raise UsageError(
                f"{option} {path}: the same file is an input",
                hint="Name another file for the output.",
            )
        place = os.path.realpath(path)
        if place in taken and (os.path.isfile(path) or not os.path.lexists(path)):
            raise UsageError(
                f"{path} is named twice: for {taken[place]} and for {option}",
                hint="One would overwrite the other. Name two files.",
            )
        taken[place] = option


def _check_files(command: Callable[..., None], options: Mapping[str, Any]) -> None:
    written = {
        name: _option(name, hint.__metadata__)
        for name, hint in get_type_hints(command, include_extras=True).items()
        if FileRole.WRITES in getattr(hint, "__metadata__", ())
    }
    outputs = {
        written[name]: Path(str(value))
        for name, value in options.items()
        if name in written and value is not None and str(value) != "-"
    }
    given = [
        path
        for name, value in options.items()
        if name not in written
        for path in (value if isinstance(value, list | tuple) else [value])
        if isinstance(path, Path)
    ]
    refuse_clashes(outputs, given)


def _option(name: str, described: tuple[Any, ...]) -> str:
    """Option as typed for a parameter: ``--csv``."""
    typed = [word for one in described for word in getattr(one, "param_decls", ())]
    return next((word for word in typed if word.startswith("--")), f"--{name.replace('_', '-')}")


@contextmanager
def _tidy_when_terminated() -> Iterator[None]:
    """Raise `Terminated` at SIGTERM, so that temporary files are removed."""
    from pipelines.processes import raise_when_terminated

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    raise_when_terminated()
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _silence_stdout() -> None:
    """Redirect stdout to the null device: flushing at exit would fail again."""
    with suppress(io.UnsupportedOperation), open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), sys.stdout.fileno())


ClipArgument = Annotated[Path, typer.Argument(metavar="CLIP", help="Video or folder of pictures.")]
ClipsOrNoneArgument = Annotated[
    list[Path] | None, typer.Argument(metavar="CLIP...", help="Videos to measure.")
]
SetupOption = Annotated[Path | None, typer.Option("--setup", help="Setup file of the lab (TOML).")]
FpsOption = Annotated[str | None, typer.Option("--fps", help="Capture rate, such as 600.")]
BallOption = Annotated[
    str | None, typer.Option("--ball", help="jokku, basketball, or 220mm, or '220mm, 0.35kg'.")
]
GridOption = Annotated[
    str | None, typer.Option("--wall-grid", help="Side of the wall's grid squares, such as 50mm.")
]
ScaleOption = Annotated[
    str | None,
    typer.Option("--scale", help="Scale in the plane of motion: 2.44 mm/px, 410 px/m ± 2 px/m."),
]
EveryOption = Annotated[
    int, typer.Option("--every", metavar="N", help="Read only every N-th picture.")
]
BallAtOption = Annotated[
    str | None, typer.Option("--ball-at", metavar="X,Y[,FRAME]", help="A point on the ball, px.")
]
MassAtOption = Annotated[
    str | None, typer.Option("--mass-at", metavar="X,Y[,FRAME]", help="A point on the mass, px.")
]
PivotAtOption = Annotated[
    str | None, typer.Option("--pivot-at", metavar="X,Y", help="The pendulum's pivot, px.")
]
LandingAtOption = Annotated[
    str | None, typer.Option("--landing-at", metavar="X,Y", help="Ball's centre at landing, px.")
]
AxesOption = Annotated[
    str | None,
    typer.Option(
        "--axes", metavar="X,Y[,DEG]", help="Origin (px) and turn of the axes of the tracks."
    ),
]
KindOption = Annotated[
    str | None,
    typer.Option("--kind", metavar="KIND", help="Kind of motion, if the one found is wrong."),
]
CsvOption = Annotated[
    Path | None, typer.Option("--csv", help="Write results as CSV."), FileRole.WRITES
]
JsonOption = Annotated[
    str | None, typer.Option("--json", help="Write JSON; - for stdout."), FileRole.WRITES
]
TracksOption = Annotated[
    Path | None, typer.Option("--tracks", help="Write the tracks as CSV."), FileRole.WRITES
]
DetectionsOption = Annotated[
    Path | None,
    typer.Option("--detections", help="Write all round objects found as CSV."),
    FileRole.WRITES,
]
TrackletsOption = Annotated[
    Path | None,
    typer.Option("--tracklets", help="Write these linked to objects, and which is measured."),
    FileRole.WRITES,
]
OverlayOption = Annotated[
    Path | None, typer.Option("--overlay", help="Write an overlay video."), FileRole.WRITES
]
PlotOption = Annotated[
    Path | None, typer.Option("--plot", help="Write plots (.png or .svg)."), FileRole.WRITES
]
ReportOption = Annotated[
    Path | None,
    typer.Option("--report", help="Write a one-page HTML report; also prints the budgets."),
    FileRole.WRITES,
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Folder for results.csv and the files of each clip."),
]
JobsOption = Annotated[
    int | None, typer.Option("-j", min=1, help="With --out: number of processes; default: cores.")
]
FromTracksOption = Annotated[
    Path | None,
    typer.Option(
        "--from-tracks", help="Read tracks of another program, or a corrected --tracklets table."
    ),
]
ColumnsOption = Annotated[
    str | None,
    typer.Option("--columns", help="Columns of that table: 't=Time (s), x=X (cm), y=Y (cm)'."),
]
NoCacheOption = Annotated[
    bool, typer.Option("--no-cache", help="Measure again; ignore earlier results.")
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No table, no warnings.")]
ResultsJsonOption = Annotated[
    str | None,
    typer.Option("--json", help="Results as JSON; - for stdout.", metavar="FILE"),
    FileRole.WRITES,
]
ResultsCsvOption = Annotated[
    Path | None, typer.Option("--csv", help="Results as CSV, one row."), FileRole.WRITES
]
SetupFileOption = Annotated[Path | None, typer.Option("--setup", help="Setup file (TOML).")]
NamedBallOption = Annotated[
    str | None,
    typer.Option("--ball", help="A preset, or a ball of the setup file.", metavar="NAME"),
]
CorOption = Annotated[
    str,
    typer.Option("--cor", help="variable, constant, a number, or a law in v (m/s).", metavar="LAW"),
]
CorLawOption = Annotated[
    Path | None,
    typer.Option("--cor-law", help="Laws of restitution of a campaign (cor.toml).", metavar="FILE"),
]
DragOption = Annotated[
    str | None,
    typer.Option(
        "--drag", help="Drag coefficient, or a curve: smooth, soccer, basketball.", metavar="C"
    ),
]
EffectOption = Annotated[
    list[str] | None,
    typer.Option(
        "--effect", help="Add an effect of the catalogue: magnus:spin=10.", metavar="ID:NAME=X"
    ),
]
NoTableOption = Annotated[bool, typer.Option("--quiet", help="No table, no warnings.")]
