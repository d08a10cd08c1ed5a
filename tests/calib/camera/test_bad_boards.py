"""Bad images of calibration boards are refused and leave no file."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from calib.board import Board
from calib.camera import rotation_matrix
from calib.lens import read_lens
from pipelines.cli import app

Picture = NDArray[np.uint8]
FOCAL, SIZE, CELL = 500.0, (320, 240), 24


def printed(charuco: bool) -> Picture:
    """An 8 x 6 board with its white margin, 24 px a square."""
    if charuco:
        board = Board(8, 6, charuco=True).opencv().generateImage((9 * CELL, 7 * CELL))
    else:
        parity = np.add.outer(np.arange(7), np.arange(9)) % 2
        board = np.kron(parity, np.full((CELL, CELL), 255))
    return np.pad(np.asarray(board), CELL, constant_values=255).astype(np.uint8)


def taken(turn: tuple[float, float, float], *, charuco: bool = False) -> Picture:
    """The board, turned, through a pinhole."""
    flat = printed(charuco)
    height, width = flat.shape
    scale = 0.26 / width
    middle = np.array([[scale, 0, -0.5 * scale * width], [0, scale, -0.5 * scale * height]])
    place = np.vstack([middle, [0.0, 0.0, 1.0]])
    axes = rotation_matrix(turn)
    pose = np.column_stack([axes[:, :2], [0.0, 0.0, 0.55]])
    lens = np.array([[FOCAL, 0, 159.5], [0, FOCAL, 119.5], [0, 0, 1]])
    seen = cv2.warpPerspective(flat, lens @ pose @ place, SIZE, borderValue=(120.0,))
    noise = np.random.default_rng(round(1e3 * abs(sum(turn)))).normal(0.0, 2.0, seen.shape)
    return np.clip(seen + noise, 0, 255).astype(np.uint8)


TURNS = [
    (0.5, 0.0, 0.0),
    (-0.5, 0.0, 0.1),
    (0.0, 0.5, 0.0),
    (0.0, -0.5, -0.1),
    (0.35, 0.35, 0.0),
    (-0.35, 0.35, 0.05),
    (0.3, -0.4, 0.0),
    (0.05, 0.0, 0.2),
]


def written(folder: Path, pictures: list[Picture]) -> list[str]:
    paths = [folder / f"board{index}.png" for index in range(len(pictures))]
    for path, picture in zip(paths, pictures, strict=True):
        cv2.imwrite(str(path), picture)
    return [str(path) for path in paths]


def told(paths: list[str], out: Path, *options: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["calibrate", "lens", *paths, "--out", str(out), *options])
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return written(tmp_path_factory.mktemp("boards"), [taken(turn) for turn in TURNS])


def test_good_pictures_give_a_lens(good: list[str], tmp_path: Path) -> None:
    code, words = told(good, tmp_path / "lens.toml")
    assert code == 0, words
    prior = read_lens(tmp_path / "lens.toml")
    assert abs(prior.lens.fx - FOCAL) < max(4.0 * prior.std[0] * FOCAL, 2.0)


@pytest.mark.parametrize(
    ("chosen", "options", "reason"),
    [
        (slice(0, 8), ["--size", "9x6"], "of 8 pictures"),
        (slice(0, 8), ["--size", "8by6"], "is not a board size"),
        (slice(0, 3), [], "only 3 of 3"),
        ([7] * 8, [], "alike"),
    ],
)
def test_boards_that_do_not_determine_the_lens_are_refused(
    good: list[str],
    tmp_path: Path,
    chosen: slice | list[int],
    options: list[str],
    reason: str,
) -> None:
    paths = good[chosen] if isinstance(chosen, slice) else [good[index] for index in chosen]
    code, words = told(paths, tmp_path / "lens.toml", *options)
    assert code in (2, 4), words
    assert reason in words
    assert "inner corners" in words or "Tilt" in words
    assert not (tmp_path / "lens.toml").exists()


def test_a_mirrored_board_is_refused(tmp_path: Path) -> None:
    mirrored = [np.ascontiguousarray(taken(turn, charuco=True)[:, ::-1]) for turn in TURNS[:2]]
    code, words = told(written(tmp_path, mirrored), tmp_path / "lens.toml", "--charuco")
    assert code == 4, words
    assert "mirrored" in words
    assert not (tmp_path / "lens.toml").exists()


def test_a_folder_without_write_permission_is_reported(good: list[str], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    for folder in (tmp_path / "file", tmp_path / "none"):
        code, words = told(good, folder / "lens.toml")
        assert code == 2, words
        assert "can't write" in words


def test_a_file_that_is_no_image_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no picture")
    code, words = told([str(tmp_path / "notes.txt")], tmp_path / "lens.toml")
    assert code == 3, words
    assert "is not a readable image" in words
