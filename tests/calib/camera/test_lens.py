"""Lens calibration from board views: values, uncertainty, refusals."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.board import Board, BoardView, dictionary_from, find_board, write_board
from calib.camera import Camera, Lens, rotation_matrix
from calib.lens import (
    LENS_MODELS,
    calibrate_lens,
    fit_boards,
    held_out_errors,
    read_lens,
    write_lens,
)
from metrology import CalibrationError, SetupError, UsageError
from tests.shared_data import shared_folder

BOARD = Board(8, 6, 0.03)
TRUE = Lens(640, 480, 500.0, 502.0, 322.0, 236.0, k1=-0.2, k2=0.05)


def view(
    seed: int,
    *,
    alike: bool = False,
    noise: float = 0.1,
    lens: Lens = TRUE,
    bulge: float = 0.0,
    away: float = 0.35,
) -> BoardView:
    rng = np.random.default_rng(seed)
    tilt = rng.uniform(-0.02, 0.02, 3) if alike else rng.uniform(-0.6, 0.6, 3)
    camera = Camera(lens, rotation_matrix(tilt), np.zeros(3))
    middle = BOARD.points - BOARD.points.mean(axis=0)
    middle[:, 2] = bulge * (1.0 - (middle[:, 0] / 0.1) ** 2)
    place = np.array([0.0, 0.0, 0.4]) if alike else np.r_[rng.uniform(-0.1, 0.1, 2), away]
    px = lens.to_pixels(lens.distort((p := middle @ camera.rotation.T + place)[:, :2] / p[:, 2:]))
    return BoardView(f"view{seed}", (640, 480), BOARD.points, px + rng.normal(0, noise, px.shape))


def test_the_lens_is_recovered_within_its_uncertainty() -> None:
    found = calibrate_lens([view(seed) for seed in range(8)])
    for name in ("fx", "fy", "cx", "cy", "k1"):
        error = getattr(found.lens, name) - getattr(TRUE, name)
        assert abs(error) < 4.5 * found.std[name], name
    assert found.held_out_rms_px < 0.25
    assert not found.dropped


def test_a_simple_lens_and_a_flat_board_are_recognised() -> None:
    assert calibrate_lens([view(seed) for seed in range(12)]).model == LENS_MODELS[0].name


def test_held_out_views_detect_a_wide_lens_and_a_bent_board() -> None:
    wide = Lens(640, 480, 281.0, 282.0, 325.0, 248.0, 0.45, 0.05, 0.0, 0.0, 0.0, 0.75, 0.15)
    views = [view(seed, lens=wide, bulge=0.002, away=0.22) for seed in range(16)]
    found = calibrate_lens(views)
    assert found.model == LENS_MODELS[3].name
    # the noise of the corners is 0.14 px in length
    assert found.held_out_rms_px < 0.2
    looks = np.stack(np.meshgrid(np.linspace(-0.5, 0.5, 7), np.linspace(-0.4, 0.4, 5)), axis=-1)
    off = found.lens.to_pixels(found.lens.distort(looks)) - wide.to_pixels(wide.distort(looks))
    assert np.linalg.norm(off, axis=-1).max() < 1.0
    flat = fit_boards(views, LENS_MODELS[2])
    assert flat.rms_px > 1.5 * found.rms_px


def test_the_held_out_error_is_that_of_views_the_fit_never_saw() -> None:
    views = [view(seed) for seed in range(8)]
    fit = fit_boards(views[1:], LENS_MODELS[0])
    own = fit_boards(views, LENS_MODELS[0]).poses[0]
    error = held_out_errors(fit, views[0], own + 0.01)
    # two axes of 0.1 px, less the six numbers of the pose that the 96 coordinates give
    assert np.sqrt((error**2).sum(axis=1).mean()) == pytest.approx(0.137, rel=0.15)


def test_the_prior_of_an_image_position_equals_that_of_the_lens() -> None:
    found = calibrate_lens([view(seed) for seed in range(10)])
    lens, prior = found.lens, found.prior
    assert np.sqrt(np.diag(prior.covariance)) == pytest.approx(prior.std)
    assert prior.std[0] == pytest.approx(found.std["fx"] / lens.fx, rel=0.3)
    # k1 and k2 trade off: together they leave the corner less open than each by itself
    assert prior.related[3, 4] < -0.8


def test_a_bad_view_is_dropped_and_named() -> None:
    views = [view(seed) for seed in range(9)]
    views[4] = replace(views[4], points_px=view(4, noise=3.0).points_px)
    found = calibrate_lens(views)
    assert found.dropped == ("view4",)
    assert "view4" in found.warnings[0]


@pytest.mark.parametrize(
    ("views", "reason"),
    [
        ([None] * 10, "no board found"),
        ([view(s) for s in range(3)] + [None] * 4, "only 3 of 7"),
        ([view(s, alike=True) for s in range(8)], "alike"),
        ([view(1)] * 8, "alike"),
    ],
)
def test_insufficient_views_are_refused(views: list[BoardView | None], reason: str) -> None:
    with pytest.raises(CalibrationError, match=reason) as refusal:
        calibrate_lens(views)
    assert refusal.value.hint


def test_a_mirrored_charuco_board_is_recognised() -> None:
    board = Board(7, 5, 0.03, charuco=True)
    picture = cv2.copyMakeBorder(
        board.opencv().generateImage((640, 480)), 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255
    )
    seen = find_board(picture, board)
    assert seen is not None
    assert len(seen.points_px) == 35
    with pytest.raises(CalibrationError, match="mirrored"):
        find_board(np.ascontiguousarray(picture[:, ::-1]), board, "a.jpg")


@pytest.mark.parametrize("old_layout", [False, True])
@pytest.mark.parametrize(
    ("dictionary", "ratio"),
    [("4X4_50", 0.6), ("5X5_100", 0.8), ("6X6_250", 0.5), ("ARUCO_ORIGINAL", 0.7),
     ("APRILTAG_36H11", 0.75)],
)  # fmt: skip
def test_any_charuco_board_is_found(dictionary: str, ratio: float, old_layout: bool) -> None:
    # an even number of rows: only there do the two layouts differ
    printed = Board(8, 5, 0.03, True, dictionary, ratio * 0.03, old_layout)
    flat = printed.opencv().generateImage((720, 480), marginSize=20)
    turn = np.array([[0.8, 0.1, 60.0], [-0.08, 0.85, 70.0], [1e-4, 5e-5, 1.0]])
    picture = cv2.warpPerspective(flat, turn, (720, 520), borderValue=255, flags=cv2.INTER_AREA)
    seen = find_board(picture, Board(8, 5, 0.03, charuco=True))
    stated = find_board(picture, printed)
    assert seen is not None
    assert stated is not None
    assert len(seen.points_px) == len(stated.points_px) == 40
    assert np.array_equal(seen.board_m, stated.board_m)
    matrix = cv2.findHomography(seen.board_m[:, :2], seen.points_px)[0]
    fitted = cv2.perspectiveTransform(seen.board_m[:, np.newaxis, :2], matrix)[:, 0]
    assert np.sqrt(((fitted - seen.points_px) ** 2).mean()) < 0.5


def test_a_dictionary_is_named_as_opencv_names_it() -> None:
    assert dictionary_from("dict_4x4_50") == dictionary_from("4X4_50") == "4X4_50"
    with pytest.raises(UsageError, match="no dictionary"):
        dictionary_from("3X3")


def test_a_board_of_the_wrong_size_is_not_found() -> None:
    picture = np.kron(np.indices((7, 9)).sum(axis=0) % 2, np.ones((40, 40))) * 200 + 30
    picture = np.pad(picture, 40, constant_values=230).astype(np.uint8)
    assert find_board(picture, BOARD) is not None
    assert find_board(picture, Board(9, 6)) is None


def test_lens_files_round_trip_and_scale(tmp_path: Path) -> None:
    found = calibrate_lens([view(seed) for seed in range(7)])
    path = tmp_path / "lens.toml"
    write_lens(path, found)
    assert read_lens(path).lens == found.lens
    assert read_lens(path).covariance == pytest.approx(found.prior.covariance, rel=1e-6)
    assert read_lens(path, width=320, height=240).lens.fx == pytest.approx(found.lens.fx / 2)
    with pytest.raises(SetupError, match="another aspect ratio"):
        read_lens(path, width=640, height=360)
    path.write_text("[lens]\nwidth = 3\n")
    with pytest.raises(SetupError, match="lacks height"):
        read_lens(path)
    with pytest.raises(SetupError, match="can't read"):
        read_lens(tmp_path / "none.toml")
    with pytest.raises(UsageError, match="can't write"):
        write_lens(tmp_path / "no" / "lens.toml", found)


def test_boards_are_printed_to_scale(tmp_path: Path) -> None:
    path = tmp_path / "board.pdf"
    write_board(path, Board(8, 6, 0.025, charuco=True))
    assert path.read_bytes().startswith(b"%PDF")
    with pytest.raises(SetupError, match="does not fit"):
        write_board(path, Board(8, 6, 0.05))


@pytest.mark.slow
def test_a_real_wide_lens() -> None:
    folder = shared_folder("clips") / "gopro_chessboard"
    pictures = sorted(folder.glob("*.jpg"))
    views = [
        find_board(cv2.imread(str(p), cv2.IMREAD_GRAYSCALE), Board(8, 6), p.stem) for p in pictures
    ]
    found = calibrate_lens(views)
    assert found.held_out_rms_px < 0.25
    assert len(found.used) >= 30
    assert found.lens.fx == pytest.approx(560.0, rel=0.01)
