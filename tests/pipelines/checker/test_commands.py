"""Every command reports the same wrong input with the same cure."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipelines.cli import app
from tests.shared_data import shared_folder

WRONG = [
    (["--fps", "600", "--wall-grid", "40mm"], "--wall-grid 50mm"),
    (["--fps", "300", "--wall-grid", "50mm"], "--fps 600"),
]


@pytest.mark.parametrize(("options", "cure"), WRONG)
@pytest.mark.parametrize("command", ["measure", "landing", "calibrate"])
def test_the_cure_is_the_same(
    command: str, options: list[str], cure: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("IMPACT_VISION_CACHE", str(tmp_path.parent / "kept"))
    clip = str(shared_folder("inputs") / "base_strike.mkv")
    more = ["--yes", "--out", str(tmp_path / "lab.toml")] if command == "calibrate" else []
    ran = CliRunner().invoke(app, [command, clip, *options, "--ball", "jokku", *more])
    said = " ".join(ran.output.split())
    assert "Likely cause: " in said
    cause = said.split("Likely cause: ", 1)[1]
    assert cure in cause[: cause.index(": --") + 40]
    assert ran.exit_code in (0, 4, 2)
