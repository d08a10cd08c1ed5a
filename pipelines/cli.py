"""Command line: table of commands, each imported when it is called."""

import atexit
import functools
import gc
import os
import time
from importlib import import_module
from typing import Any, NamedTuple

import typer
from typer.core import TyperGroup

from pipelines.doors import DATE, DEBUG, guarded, loading

__all__ = ["app"]

# Matrices are small: threads inside one product cost more than they save.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Imported modules stay alive: frequent garbage collection among them finds nothing.
gc.set_threshold(50_000)
# The collection at exit would take 0.1 to 0.2 s.
atexit.register(gc.freeze)


class _Command(NamedTuple):
    """Module and name of a command or group, and its one-line summary."""

    module: str
    name: str
    summary: str
    group: str | None = None


_MEASURE = "pipelines.measure.commands"
_COMMANDS = {
    "demo": _Command(
        _MEASURE,
        "demo_command",
        "Measure the sample clip that ships with the package, end to end.",
    ),
    "measure": _Command(
        _MEASURE,
        "measure_command",
        "Measure contact, launch, landing and COR in one pass over each clip.",
    ),
    "app": _Command(
        "pipelines.app.command",
        "app_command",
        "Open the page: measure a clip, see everything, correct by dragging.",
    ),
    "contact-time": _Command(
        _MEASURE,
        "contact_time_command",
        "Contact time: contact frames counted, and the sub-frame value.",
    ),
    "launch": _Command(
        _MEASURE,
        "launch_command",
        "Launch angle and speed of the ball, speed of the pendulum before and after.",
    ),
    "landing": _Command(
        _MEASURE,
        "landing_command",
        "Landing point and distance, read on the wall and corrected for projection.",
    ),
    "cor": _Command(
        _MEASURE,
        "cor_command",
        "Coefficient of restitution by three methods, with their agreement.",
    ),
    "simulate": _Command(
        "pipelines.model", "simulate_command", "Simulate a strike and the subsequent flight."
    ),
    "plan": _Command(
        "pipelines.campaign.design",
        "PLAN_COMMANDS",
        "Plan a strike that reaches a distance; plan campaign: how many strikes for a law.",
        "DistanceOrCommand",
    ),
    "paper": _Command(
        "pipelines.paper",
        "paper_command",
        "Recompute every table of the paper, compare with the print, and redraw its figures.",
    ),
    "law": _Command(
        "pipelines.law",
        "law_command",
        "Fit a law of restitution to a table of strikes, heights or bounce times.",
    ),
    "explain": _Command(
        "pipelines.explain.command",
        "explain_command",
        "Find where simulation and recording differ and which physics is missing.",
    ),
    "effects": _Command(
        "pipelines.explain.own_effects",
        "EFFECT_COMMANDS",
        "Check your own effects before vision explain uses them.",
        "EffectCommands",
    ),
    "render": _Command(
        "pipelines.render", "render_command", "Render a synthetic clip with its truth file."
    ),
    "calibrate": _Command(
        "pipelines.calibrate.command",
        "CALIBRATE_COMMANDS",
        "From pixels to metres: calibrate a clip, a lens or a wall; check camera motion.",
        "ClipOrCommand",
    ),
    "convert": _Command(
        "pipelines.interop.measured",
        "convert_command",
        "Convert tracks or a lens between programs.",
    ),
    "cache": _Command(
        "pipelines.cache",
        "CACHE_COMMANDS",
        "Show or clear the cache of earlier measurements.",
        "CacheGroup",
    ),
    "campaign": _Command(
        "pipelines.campaign.command",
        "CAMPAIGN_COMMANDS",
        "Measure a folder of clips and fit a law of restitution; status; bad trials.",
        "ClipsOrCommand",
    ),
}


class _LazyGroup(TyperGroup):
    """A group that imports a command only when it is called."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        # click suggests corrections of a mistyped command from these names
        self.commands: Any = dict.fromkeys(_COMMANDS)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Accept ``--date`` behind the command, too."""
        words = [word for word in args if word != "--date"]
        return super().parse_args(ctx, ["--date", *words] if len(words) < len(args) else words)

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of the commands, in the order of the table."""
        return list(_COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Command of this name; None if there is none."""
        return _loaded(cmd_name) if cmd_name in _COMMANDS else None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands with their summaries."""
        room = formatter.width - 6 - max(map(len, _COMMANDS))
        with formatter.section("Commands"):
            formatter.write_dl(
                [(name, _shortened(one.summary, room)) for name, one in _COMMANDS.items()]
            )


def _shortened(text: str, length: int) -> str:
    if len(text) <= length:
        return text.rstrip(".")
    return text[: length - 3].rsplit(" ", 1)[0] + "..."


@functools.cache
def _loaded(name: str) -> Any:
    """Import the command or group of this name."""
    command = _COMMANDS[name]
    with loading():
        module = import_module(command.module)
    found = getattr(module, command.name)
    if command.group is None:
        alone = typer.Typer(
            add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False
        )
        alone.command(name)(guarded(found))
        return typer.main.get_command(alone)
    group = typer.Typer(
        cls=getattr(module, command.group),
        no_args_is_help=True,
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        help=command.summary,
    )
    group.callback()(lambda: None)
    for part, function in found.items():
        group.command(part)(guarded(function))
    return typer.main.get_command(group)


app = typer.Typer(
    cls=_LazyGroup,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Measure impact and flight from video, each number with an uncertainty you can defend.",
    epilog="Start with: vision demo",
)


def _version(wanted: bool) -> None:
    if not wanted:
        return
    from importlib.metadata import PackageNotFoundError, version

    try:
        typer.echo(f"vision {version('impact-vision')}")
    except PackageNotFoundError:
        typer.echo("vision 0+unknown")
    raise typer.Exit


@app.callback()
def _main(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version and stop."
    ),
    debug: bool = typer.Option(
        False, "--debug", help="Show the traceback when a fit fails numerically."
    ),
    date: bool = typer.Option(
        False, "--date", help="Write today's date into reports and SVGs (of any command)."
    ),
) -> None:
    if debug:
        os.environ[DEBUG] = "1"
    os.environ.pop(DATE, None)
    if date:
        os.environ[DATE] = time.strftime("%Y-%m-%d")
