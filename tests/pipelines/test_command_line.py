"""What every command has in common: help with an example, quiet stdout, exit codes."""

import json
import shlex

import pytest
from typer.testing import CliRunner

from pipelines.cli import app

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
    ["simulate --backswing 60deg --ball jokku", "plan --distance 2m --ball jokku", "paper"],
)
def test_json_to_stdout_is_alone_there(command: str) -> None:
    result = CliRunner().invoke(app, [*command.split(), "--json", "-"])
    assert result.exit_code == 0
    json.loads(result.stdout)


def test_the_version_is_told() -> None:
    result = CliRunner().invoke(app, ["--version"])
    assert result.exit_code == 0
    assert result.output.startswith("vision ")
