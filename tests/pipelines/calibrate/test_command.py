"""`vision calibrate`: boards, lenses, walls and cameras that moved, from the command line."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from calib.camera import Camera, Lens
from metrology import CalibrationError, ClipError, UsageError
from pipelines.calibrate.command import CALIBRATE_COMMANDS
from tests.calib.synthetic import rendered

app = typer.Typer()
for name, command in CALIBRATE_COMMANDS.items():
    app.command(name)(command)
run = CliRunner()


def test_a_board_is_written(tmp_path: Path) -> None:
    target = tmp_path / "board.pdf"
    said = run.invoke(app, ["board", "--pdf", str(target), "--size", "7x5", "--charuco"])
    assert said.exit_code == 0
    assert target.read_bytes().startswith(b"%PDF")
    wrong = run.invoke(app, ["board", "--pdf", str(target), "--size", "big"])
    assert isinstance(wrong.exception, UsageError)


def test_pictures_without_a_board_are_refused(tmp_path: Path) -> None:
    gray = tmp_path / "gray.png"
    cv2.imwrite(str(gray), np.full((120, 160), 128, np.uint8))
    said = run.invoke(app, ["lens", str(gray), "-o", str(tmp_path / "lens.toml")])
    assert isinstance(said.exception, CalibrationError)
    assert not (tmp_path / "lens.toml").exists()
    said = run.invoke(app, ["lens", str(tmp_path / "none.png")])
    assert isinstance(said.exception, ClipError)


@pytest.fixture(scope="module")
def wall_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clip")
    camera = Camera.facing_wall(Lens.centred(320, 180, 380.0), [0.9, 0.5, 2.0], yaw=0.1)
    for index in range(3):
        picture = rendered(camera, seed=index, samples=2)
        cv2.imwrite(str(folder / f"frame{index:03d}.png"), picture.astype(np.uint8))
    return folder


def test_a_wall_is_described(wall_clip: Path) -> None:
    said = run.invoke(app, ["wall", str(wall_clip), "--camera-distance", "2 m"])
    assert said.exit_code == 0, said.exception
    assert "camera 2.00" in said.output
    assert "focal length 3" in said.output


@pytest.mark.slow
def test_a_camera_that_stayed_is_said_to(wall_clip: Path) -> None:
    said = run.invoke(app, ["check", str(wall_clip), "--against", str(wall_clip)])
    assert "has not moved" in said.output


@pytest.fixture(scope="module")
def lamp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Filmed at 585 frames per second: a light of 31 Hz at 40, 20."""
    folder = tmp_path_factory.mktemp("lamp")
    rng = np.random.default_rng(5)
    for index in range(150):
        picture = rng.normal(60.0, 3.0, (48, 64))
        picture[17:24, 37:44] += 80.0 * (np.sin(2.0 * np.pi * 31.0 * index / 585.0) > 0.0)
        cv2.imwrite(str(folder / f"frame{index:03d}.png"), picture.astype(np.uint8))
    return folder


def test_a_light_in_view_tells_the_rate(lamp: Path) -> None:
    said = run.invoke(
        app, ["rate", str(lamp), "--light-at", "40,20", "--blink", "31 Hz", "--fps", "600"]
    )
    assert said.exit_code == 0, said.exception
    value, std = (float(said.output.split()[i]) for i in (2, 4))
    assert abs(value - 585.0) < 4.0 * std
    assert 0.0 < std < 2.0
    assert "The option states 600 fps, which disagrees" in said.output


@pytest.mark.parametrize(
    ("place", "error"), [("10,40", CalibrationError), ("99,20", UsageError), ("here", UsageError)]
)
def test_where_nothing_blinks_there_is_no_rate(
    lamp: Path, place: str, error: type[Exception]
) -> None:
    said = run.invoke(
        app, ["rate", str(lamp), "--light-at", place, "--blink", "31 Hz", "--fps", "600"]
    )
    assert isinstance(said.exception, error)
