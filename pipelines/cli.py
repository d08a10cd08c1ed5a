"""The command line: every command, one shell around them for errors and exit codes."""

import functools
from collections.abc import Callable
from typing import Any

import typer
from rich.console import Console

from metrology import ImpactVisionError
from pipelines.calibrate.command import CALIBRATE_COMMANDS, ClipOrCommand
from pipelines.campaign.command import CAMPAIGN_COMMANDS, ClipsOrCommand
from pipelines.explain.command import explain_command
from pipelines.measure.commands import (
    contact_time_command,
    cor_command,
    demo_command,
    landing_command,
    launch_command,
    measure_command,
)
from pipelines.measure.files.output import software_version
from pipelines.model.plan import plan_command
from pipelines.model.simulate import simulate_command
from pipelines.paper import paper_command
from pipelines.render import render_command

__all__ = ["app"]


def _guarded(command: Callable[..., None]) -> Callable[..., None]:
    """Turn errors raised on purpose into a message and the contract's exit code."""

    @functools.wraps(command)
    def guarded(*args: Any, **options: Any) -> None:
        errors = Console(stderr=True)
        try:
            command(*args, **options)
        except ImpactVisionError as problem:
            errors.print(f"vision: {problem}", highlight=False, markup=False, soft_wrap=True)
            raise typer.Exit(problem.exit_code) from problem
        except KeyboardInterrupt:
            raise typer.Exit(130) from None

    return guarded


app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Measure impact and flight from video, each number with an uncertainty you can defend.",
    epilog="Start with: vision demo",
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"vision {software_version()}")
        raise typer.Exit


@app.callback()
def _main(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version and stop."
    ),
) -> None:
    pass


_COMMANDS: dict[str, Callable[..., None]] = {
    "demo": demo_command,
    "measure": measure_command,
    "contact-time": contact_time_command,
    "launch": launch_command,
    "landing": landing_command,
    "cor": cor_command,
    "simulate": simulate_command,
    "plan": plan_command,
    "paper": paper_command,
    "explain": explain_command,
    "render": render_command,
}

for _name, _command in _COMMANDS.items():
    app.command(_name)(_guarded(_command))

_calibrate = typer.Typer(
    cls=ClipOrCommand,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="From pixels to metres: calibrate CLIP, a lens, a wall; has the camera moved.",
)
for _name, _command in CALIBRATE_COMMANDS.items():
    _calibrate.command(_name)(_guarded(_command))
app.add_typer(_calibrate, name="calibrate")

_campaign = typer.Typer(
    cls=ClipsOrCommand,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="A folder of clips to a law of restitution: campaign CLIPS, its status, bad trials.",
)
for _name, _command in CAMPAIGN_COMMANDS.items():
    _campaign.command(_name)(_guarded(_command))
app.add_typer(_campaign, name="campaign")
