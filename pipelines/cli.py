"""The command line: every command, one shell around them for errors and exit codes.

A command's module is imported when the command is called, so that help and errors come at once.
"""

import atexit
import functools
import gc
import os
from importlib import import_module
from typing import Any, NamedTuple

import typer
from typer.core import TyperGroup

from pipelines.doors import DEBUG, guarded, loading

__all__ = ["app"]

# matrices are small here: threads inside a product wait for each other longer than they work
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# what a command imports stays: looking for waste among it after every 700 objects is in vain
gc.set_threshold(50_000)
# nor is it looked through at the end, which takes a tenth of a second, a fifth after measuring
atexit.register(gc.freeze)


class _Command(NamedTuple):
    """Where a command is, and the first line of its help; of a group, where its commands are."""

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
    "contact-time": _Command(
        _MEASURE,
        "contact_time_command",
        "How long mass and ball touch: frames counted, and the time between frames.",
    ),
    "launch": _Command(
        _MEASURE,
        "launch_command",
        "Launch angle and speed of the ball, speed of the pendulum before and after.",
    ),
    "landing": _Command(
        _MEASURE,
        "landing_command",
        "Where the ball lands, as read on the wall and corrected for projection.",
    ),
    "cor": _Command(
        _MEASURE,
        "cor_command",
        "Coefficient of restitution estimated three ways, with their agreement.",
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
    "explain": _Command(
        "pipelines.explain.command",
        "explain_command",
        "Find where simulation and recording differ and which physics is missing.",
    ),
    "effects": _Command(
        "pipelines.explain.own_effects",
        "EFFECT_COMMANDS",
        "Check effects of your own before they take part in explaining.",
        "EffectCommands",
    ),
    "render": _Command(
        "pipelines.render", "render_command", "Render a synthetic clip with its truth file."
    ),
    "calibrate": _Command(
        "pipelines.calibrate.command",
        "CALIBRATE_COMMANDS",
        "From pixels to metres: calibrate CLIP, a lens, a wall; has the camera moved.",
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
        "What is kept of clips measured before, so that they need not be followed again.",
        "CacheGroup",
    ),
    "campaign": _Command(
        "pipelines.campaign.command",
        "CAMPAIGN_COMMANDS",
        "A folder of clips to a law of restitution: campaign CLIPS, its status, bad trials.",
        "ClipsOrCommand",
    ),
}


class _LazyGroup(TyperGroup):
    """A group that imports a command when it is called, and none to list them."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        # what is offered where a name is mistyped comes from here
        self.commands: Any = dict.fromkeys(_COMMANDS)

    def list_commands(self, ctx: Any) -> list[str]:
        """The commands' names, in the table's order."""
        return list(_COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command; None where there is none of this name."""
        return _loaded(cmd_name) if cmd_name in _COMMANDS else None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands with their summaries, as the table has them."""
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
    """The command or group of a name, imported now."""
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
        False, "--debug", help="Show the traceback where numbers can't be fitted."
    ),
) -> None:
    if debug:
        os.environ[DEBUG] = "1"
