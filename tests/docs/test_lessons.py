"""Lessons: every command on the pages runs, and its results are those on the page."""

import json
import math
import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from pipelines.cli import app

ROOT = Path(__file__).parents[2]
LESSONS = ROOT / "docs" / "lessons"
RESULTS = json.loads((ROOT / "docs" / "results" / "lessons.json").read_text(encoding="utf-8"))
CLIPS = ROOT / "sample_videos" / "clips"


def commands(name: str) -> list[str]:
    page = (LESSONS / f"{name}.md").read_text(encoding="utf-8")
    return re.findall(r"^\$ vision (.*)$", page, re.MULTILINE)


def run(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Results of the page's first command, run in a folder with its clip alone."""
    for path in (*LESSONS.glob(f"{name}.mp4"), *CLIPS.glob("jokku_90_small.*")):
        shutil.copy(path, folder)
    monkeypatch.chdir(folder)
    (command,) = commands(name)
    words = [*shlex.split(command), "--json", "out.json", "--no-cache"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    return dict(json.loads((folder / "out.json").read_text(encoding="utf-8")))


@pytest.mark.parametrize("name", ["drop", "throw", "swing", "bounce", "strike"])
def test_the_command_of_a_lesson_gives_what_the_page_shows(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = run(name, tmp_path, monkeypatch)
    assert found["motion"]["kind"] == RESULTS[name]["kind"]
    assert RESULTS[name]["quantities"]
    for key, stored in RESULTS[name]["quantities"].items():
        entry = found["quantities"][key]
        # processors round differently, and what hardly fits decides differently then
        assert abs(entry["value"] - stored["value"]) < stored["std"], key
        assert abs(entry["value"] - stored["true"]) < 4.0 * entry["std"], key


def test_each_lesson_is_a_page_with_a_clip() -> None:
    for name in RESULTS:
        page = (LESSONS / f"{name}.md").read_text(encoding="utf-8")
        assert ".mp4" in page
        assert len(page.split()) < 400
        assert all(math.isfinite(q["value"]) for q in RESULTS[name]["quantities"].values())
