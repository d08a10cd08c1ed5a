"""The notebooks of the docs run from top to bottom."""

import os
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def test_three_clips_are_shipped() -> None:
    assert len(NOTEBOOKS) == 3


@pytest.mark.parametrize(
    "path",
    [
        # a clip is measured, and physics found, by the tests of those; the third uses both
        pytest.param(path, marks=() if path.stem == "campaign_to_cor_law" else pytest.mark.slow)
        for path in NOTEBOOKS
    ],
    ids=lambda path: path.stem,
)
def test_a_notebook_runs_and_shows_its_results(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    notebook = nbformat.read(path, as_version=4)
    shown = [_kinds(cell) for cell in notebook.cells]
    NotebookClient(
        notebook,
        kernel_name="python3",
        timeout=240,
        resources={"metadata": {"path": str(tmp_path)}},
    ).execute()
    assert [_kinds(cell) for cell in notebook.cells] == shown


def _kinds(cell: nbformat.NotebookNode) -> list[list[str]]:
    """What a cell's outputs are: tables, pictures, text."""
    return [sorted(output.get("data", {"text": ""})) for output in cell.get("outputs", [])]
