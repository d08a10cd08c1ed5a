"""Every command, page and Python function reports the same wrong input with the same cure."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from bench.inputs.everywhere import ASKED, CLIP_FOLDER, WRONG, is_same
from pipelines.cli import app


@pytest.mark.parametrize("wrong", WRONG)
def test_the_finding_is_the_same_everywhere(
    wrong: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("IMPACT_VISION_CACHE", str(tmp_path.parent / "kept"))
    for name, ask in ASKED.items():
        said = ask(WRONG[wrong], tmp_path)
        assert is_same(name, WRONG[wrong], said), (name, said)


def test_what_is_assumed_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMPACT_VISION_CACHE", str(tmp_path.parent / "kept"))
    ran = CliRunner().invoke(
        app, ["measure", str(CLIP_FOLDER / "jokku_90_small.mp4"), "--fps", "600", "--ball", "jokku"]
    )
    said = ran.stderr.splitlines()
    assumed = [line for line in said if line.startswith("assumed: ")]
    assert said[: len(assumed)] == assumed
    for fact in ("grid pitch", "pendulum", "support height"):
        assert any(f"No {fact} given" in line for line in assumed)
    assert not [line for line in said if line.startswith("warning") and "No pendulum" in line]
