"""The README's commands run in an empty folder."""

import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipelines.cli import app

README = Path(__file__).parents[2] / "README.md"


def commands() -> list[str]:
    """What the README says works as it stands."""
    text = README.read_text(encoding="utf-8")
    block = text.partition("These work as they stand")[2].split("```")[1]
    return [line for line in block.splitlines() if line.startswith("vision ")]


def run(command: str) -> None:
    result = CliRunner().invoke(app, shlex.split(command)[1:])
    assert result.exit_code == 0, result.output


def test_readme_commands_without_a_clip_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    quick = [command for command in commands() if command.split()[1] in ("simulate", "plan")]
    assert len(quick) == 2
    for command in quick:
        run(command)


@pytest.mark.slow
def test_all_of_them_run_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert len(commands()) >= 5
    for command in commands():
        run(command)
    assert (tmp_path / "strike.html").is_file()


def test_the_readme_explains_plain_vision_before_using_it() -> None:
    text = README.read_text(encoding="utf-8")
    assert text.index("source .venv/bin/activate") < text.index("\nvision ")


def test_the_docs_load_no_external_resource() -> None:
    site = (README.parent / "mkdocs.yml").read_text(encoding="utf-8")
    assert "http" not in site
    docs = README.parent / "docs"
    script = docs / "mathjax" / "tex-chtml-full.js"
    assert script.is_file()
    assert (docs / "mathjax" / "LICENSE").is_file()
    assert f"mathjax/{script.name}" in site
