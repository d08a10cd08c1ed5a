"""The doors of every command: which files it writes, and how whatever stops it is told.

What can be refused is refused before the work begins: an output that can't be written, that is an
input, or that two options name.

Options that several commands take, each declared once: what it is called, and what it says.
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
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, get_type_hints

import typer

if TYPE_CHECKING:
    from metrology import MeasurementError

__all__ = [
    "DEBUG",
    "BallAtOption",
    "BallOption",
    "ClipArgument",
    "ClipsOrNoneArgument",
    "ColumnsOption",
    "CorLawOption",
    "CorOption",
    "CsvOption",
    "DragOption",
    "EffectOption",
    "FileRole",
    "FpsOption",
    "FromTracksOption",
    "GridOption",
    "JobsOption",
    "JsonOption",
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
    "TracksOption",
    "guarded",
    "loading",
    "refuse_clashes",
]

DEBUG = "IMPACT_VISION_DEBUG"
"""Environment: set, a numerical failure keeps its traceback; ``vision --debug`` sets it."""

_ABOUT_FILES = frozenset(
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
"""What the system says of files that people name, or of disks: no bug of ours."""

_NUMERICAL_LIBRARIES = frozenset({"numpy", "scipy"})
"""What they refuse with a ValueError of their own is no number or no optimum."""

_ENDED_BY_SIGNAL = 128
"""Exit codes of a process that a signal ended start here (POSIX shells)."""


class FileRole(Enum):
    """What a command does with the file of an option; stands in the option's annotation."""

    WRITES = "writes"


def guarded(command: Callable[..., None]) -> Callable[..., None]:
    """Check a command's files, and turn what stops it into a message and the contract's exit code.

    Parameters
    ----------
    command : callable
        A typer command; options that write a file carry `FileRole.WRITES` in their annotation.

    Returns
    -------
    callable
        Raises ``typer.Exit`` instead of the project's errors, of a full disk, a closed pipe, an
        interrupt (130), and of numbers that no fit can be made of (4).
    """
    from metrology import ImpactVisionError
    from metrology.files import shown_path
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
        except KeyboardInterrupt:
            raise typer.Exit(_ENDED_BY_SIGNAL + signal.SIGINT) from None
        except BrokenPipeError:
            _silence_stdout()
            raise typer.Exit(_ENDED_BY_SIGNAL + signal.SIGPIPE) from None
        except OSError as problem:
            if problem.errno in (errno.ENOSPC, errno.EDQUOT):
                _silence_stdout()
                end(f"the disk is full: {problem.strerror}\nMake room and ask again.", 2)
            if problem.filename is None or problem.errno not in _ABOUT_FILES:
                raise
            end(
                f"can't use {shown_path(problem.filename)}: {problem.strerror}\n"
                "Check the name, and that you may read or write there.",
                2,
            )
        except MemoryError:
            end(f"there is not enough memory{_limit_told()}\n{_MORE_MEMORY}", 2)
        except (ArithmeticError, ValueError) as problem:
            if not _is_numerical(problem):
                raise
            if os.environ.get(DEBUG):
                raise
            failed = _no_fit(problem)
            end(str(failed), failed.exit_code)

    return run


_MORE_MEMORY = "A clip needs about a gigabyte: raise the limit (ulimit -v)."
_LITTLE_MEMORY = 1 << 30
"""Bytes of address space below which the libraries themselves may not fit."""


def _memory_limit() -> int | None:
    """Bytes of address space that this process may have; None where nothing limits it."""
    try:
        import resource
    except ImportError:
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else int(limit)


def _limit_told() -> str:
    limit = _memory_limit()
    return "" if limit is None else f": the process may have {limit >> 20} MiB"


@contextmanager
def loading() -> Iterator[None]:
    """Tell libraries that do not fit into a limit of memory from libraries that are not there.

    Raises
    ------
    typer.Exit
        With code 2, after saying so; an ImportError without such a limit stays one.
    """
    try:
        yield
    except (ImportError, MemoryError):
        limit = _memory_limit()
        if limit is None or limit > _LITTLE_MEMORY:
            raise
        typer.echo(f"vision: the libraries do not fit{_limit_told()}\n{_MORE_MEMORY}", err=True)
        raise typer.Exit(2) from None


def _is_numerical(problem: Exception) -> bool:
    """Whether numbers failed, not the program: singular, not finite, without an optimum.

    A ValueError counts only where a numerical library itself raised it about its arguments.
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
        hint="Look at the input as a plot: are the columns, units and times what they should be? "
        "vision --debug and the same words show where it stopped.",
    )


def refuse_clashes(outputs: Mapping[str, Path], inputs: Iterable[Path | None]) -> None:
    """Refuse files that can't be written, that are read, or that are named twice.

    Parameters
    ----------
    outputs : mapping
        What people typed ("--csv") → the file.
    inputs : iterable of Path or None
        What is read; it need not be there.

    Raises
    ------
    UsageError
    """
    from metrology import UsageError, refuse_unwritable

    read = [path for path in inputs if path is not None and os.path.isfile(path)]
    taken: dict[str, str] = {}
    for option, path in outputs.items():
        refuse_unwritable(path)
        if any(path.exists() and path.samefile(given) for given in read):
            raise UsageError(
                f"{option} {path}: that file is read, and can't be written, too",
                hint="Name another file to write.",
            )
        place = os.path.realpath(path)
        if place in taken and (os.path.isfile(path) or not os.path.lexists(path)):
            raise UsageError(
                f"{path} is named twice: for {taken[place]} and for {option}",
                hint="One would overwrite the other; name two files.",
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
    """What people type for a parameter: ``--csv``."""
    typed = [word for one in described for word in getattr(one, "param_decls", ())]
    return next((word for word in typed if word.startswith("--")), f"--{name.replace('_', '-')}")


@contextmanager
def _tidy_when_terminated() -> Iterator[None]:
    """Let a SIGTERM unwind the stack, so that temporary files go."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def unwind(number: int, frame: FrameType | None) -> None:
        raise SystemExit(_ENDED_BY_SIGNAL + number)

    before = signal.signal(signal.SIGTERM, unwind)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _silence_stdout() -> None:
    """Keep the interpreter from flushing once more, at its end, what can't be written."""
    with suppress(io.UnsupportedOperation), open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), sys.stdout.fileno())


ClipArgument = Annotated[Path, typer.Argument(metavar="CLIP", help="Video or folder of pictures.")]
ClipsOrNoneArgument = Annotated[
    list[Path] | None, typer.Argument(metavar="CLIP...", help="Videos to measure.")
]
SetupOption = Annotated[Path | None, typer.Option("--setup", help="What the lab knows (TOML).")]
FpsOption = Annotated[str | None, typer.Option("--fps", help="Capture rate, such as 600.")]
BallOption = Annotated[
    str | None, typer.Option("--ball", help="jokku, basketball, or a diameter such as 220mm.")
]
GridOption = Annotated[
    str | None, typer.Option("--wall-grid", help="Side of the wall's squares, such as 50mm.")
]
ScaleOption = Annotated[
    str | None,
    typer.Option("--scale", help="In the plane of motion: '2.44 mm/px', '410 px/m ± 2 px/m'."),
]
BallAtOption = Annotated[
    str | None, typer.Option("--ball-at", metavar="X,Y[,FRAME]", help="A point on the ball, px.")
]
MassAtOption = Annotated[
    str | None, typer.Option("--mass-at", metavar="X,Y[,FRAME]", help="A point on the mass, px.")
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
OverlayOption = Annotated[
    Path | None, typer.Option("--overlay", help="Write an overlay video."), FileRole.WRITES
]
PlotOption = Annotated[
    Path | None, typer.Option("--plot", help="Write plots (.png or .svg)."), FileRole.WRITES
]
ReportOption = Annotated[
    Path | None,
    typer.Option("--report", help="Write a one-page HTML report; prints the budgets, too."),
    FileRole.WRITES,
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Several clips: a folder for results.csv and files."),
]
JobsOption = Annotated[
    int | None, typer.Option("-j", min=1, help="With --out: processes; default one a core.")
]
FromTracksOption = Annotated[
    Path | None,
    typer.Option("--from-tracks", help="Tracks of another program instead of following the clip."),
]
ColumnsOption = Annotated[
    str | None,
    typer.Option("--columns", help="Of such a table: 't=Time (s), x=X (cm), y=Y (cm), ball=A'."),
]
NoCacheOption = Annotated[
    bool, typer.Option("--no-cache", help="Measure afresh, whatever was measured before.")
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
