"""What every command has in common: help with an example, quiet stdout, exit codes."""

import json
import shlex
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipelines.cli import _COMMANDS, app

ROOT = Path(__file__).parents[2]

COMMANDS = [
    "demo",
    "measure",
    "contact-time",
    "launch",
    "landing",
    "cor",
    "simulate",
    "plan",
    "paper",
    "explain",
    "render",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_shows_an_example_with_options_that_exist(command: str) -> None:
    shown = CliRunner().invoke(app, [command, "--help"]).output
    words = " ".join(shown.split())
    example = words.partition("Example: ")[2]
    assert example.startswith(f"vision {command}")
    typed = shlex.split(example.partition("Options:")[0].partition("Arguments:")[0])
    listed = words.partition("Options:")[2]
    assert all(option in listed for option in typed if option.startswith("--"))


def test_without_arguments_the_way_in_is_named() -> None:
    result = CliRunner().invoke(app, [])
    assert "vision demo" in result.output


@pytest.mark.parametrize("command", ["no-such-command", "measure --no-such-option a.mp4", "plan"])
def test_bad_usage_ends_with_2(command: str) -> None:
    result = CliRunner().invoke(app, command.split())
    assert result.exit_code == 2
    assert "Traceback" not in result.output


@pytest.mark.parametrize(
    "command",
    [
        "simulate --backswing 60deg --ball jokku",
        "plan --distance 2m --ball jokku",
        pytest.param("paper", marks=pytest.mark.slow),
    ],
)
def test_json_to_stdout_is_alone_there(command: str) -> None:
    result = CliRunner().invoke(app, [*command.split(), "--json", "-"])
    assert result.exit_code == 0
    json.loads(result.stdout)


def test_the_version_is_told() -> None:
    result = CliRunner().invoke(app, ["--version"])
    assert result.exit_code == 0
    assert result.output.startswith("vision ")


def test_help_version_and_a_mistyped_command_import_next_to_nothing() -> None:
    script = (
        "import sys\n"
        "from typer.testing import CliRunner\n"
        "from pipelines.cli import app\n"
        "before = set(sys.modules)\n"
        "for line in ('--help', '--version', 'mesure'):\n"
        "    CliRunner().invoke(app, [line])\n"
        "print(len(sys.modules), *sorted({name.partition('.')[0] for name in sys.modules}))"
    )
    count, *rooms = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout.split()
    heavy = {"numpy", "scipy", "cv2", "pandas", "matplotlib", "av", "pint", "nicegui"}
    assert heavy.isdisjoint(rooms)
    assert int(count) < 400


@pytest.mark.parametrize("name", [n for n, one in _COMMANDS.items() if one.group is None])
def test_the_list_of_commands_says_what_each_says_of_itself(name: str) -> None:
    command = _COMMANDS[name]
    documented = getattr(import_module(command.module), command.name).__doc__
    assert documented.strip().splitlines()[0] == command.summary


def test_measuring_loads_neither_plots_nor_tables_nor_the_web_before_they_are_wanted() -> None:
    script = "import sys, pipelines.measure.commands\nprint(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout.split()
    unwanted = {"matplotlib", "pandas", "nicegui", "scipy.stats", "sample_videos", "PIL.ImageDraw"}
    unwanted |= {"scipy.special", "scipy.optimize", "jinja2", "pint", "numba", "yaml"}
    assert unwanted.isdisjoint(loaded)


def test_what_is_there_at_the_end_of_a_command_is_not_looked_through_for_waste() -> None:
    script = (
        "import atexit, gc\n"
        "atexit.register(lambda: print(gc.get_freeze_count(), len(gc.get_objects())))\n"
        "from pipelines.cli import app\n"
        "app(['--version'])"
    )
    told = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout.split()
    frozen, looked_through = int(told[-2]), int(told[-1])
    assert frozen > 1000
    assert looked_through < 0.1 * frozen
