"""The wall grid: found, numbered, with uncertainty, or refused."""

import json
import time
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.camera import Camera, Lens
from calib.grid import GridMap, MapSupport, WallGrid, find_wall_grid, ranked
from metrology import CalibrationError
from tests.calib.synthetic import line_grid, rendered, some_camera
from tests.shared_data import shared_folder
from vision.clip.clip import ClipReader


def labelling_error(grid: WallGrid, camera: Camera) -> tuple[float, np.ndarray]:
    """Wrong labels (a common offset is free), and normalised position errors."""
    true = camera.to_plane(grid.points_px) / grid.pitch_m
    offset = np.round(np.median(true - grid.nodes, axis=0))
    wrong = float(np.abs(np.round(true) - grid.nodes - offset).max())
    wall = np.c_[(grid.nodes + offset) * grid.pitch_m, np.zeros(len(true))]
    std = np.sqrt(np.einsum("nii->ni", grid.covariance_px2))
    return wrong, (grid.points_px - camera.project(wall)) / std


@pytest.mark.parametrize("seed", range(5))
def test_a_grid_is_found_at_any_pose_behind_the_experiment(seed: int) -> None:
    camera = some_camera(np.random.default_rng(seed), (432, 240))
    grid = find_wall_grid(rendered(camera, seed=seed, samples=3))
    wrong, normalised = labelling_error(grid, camera)
    assert wrong == 0.0
    assert len(grid.nodes) > 80
    assert 0.4 < np.sqrt((normalised**2).mean()) < 1.8
    assert np.abs(normalised.mean(axis=0)).max() < 0.3


@pytest.mark.parametrize(
    "hidden",
    [
        "right",
        pytest.param("left", marks=pytest.mark.slow),
        pytest.param("top", marks=pytest.mark.slow),
        pytest.param("middle", marks=pytest.mark.slow),
    ],
)
def test_a_grid_half_hidden_by_a_textured_object(hidden: str) -> None:
    camera = some_camera(np.random.default_rng(101), (432, 240))
    picture = rendered(camera, seed=1, samples=3)
    cover = {
        "left": np.s_[:, :216],
        "right": np.s_[:, 216:],
        "top": np.s_[:120],
        "middle": np.s_[:, 108:324],
    }[hidden]
    rng = np.random.default_rng(3)
    texture = cv2.GaussianBlur(rng.normal(0.0, 240.0, picture[cover].shape), (0, 0), 3.0)
    picture[cover] = np.clip(110.0 + texture, 0.0, 255.0)
    grid = find_wall_grid(picture)
    assert labelling_error(grid, camera)[0] == 0.0
    assert len(grid.nodes) > 60


@pytest.mark.parametrize("seed", [114, 223, 226])
def test_lines_on_both_sides_of_a_post_are_numbered_as_one_grid(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lens = Lens.centred(432, 240, 780.0 + 60.0 * rng.random())
    place = [0.5 + 0.1 * rng.random(), 0.5, 4.4 + 0.4 * rng.random()]
    camera = Camera.facing_wall(lens, place, yaw=0.05 * rng.normal())
    picture = rendered(camera, seed=seed, samples=3)
    width, left = 432.0 * rng.uniform(0.12, 0.3), 432.0 * rng.uniform(0.3, 0.6)
    post = picture[:, int(left) : int(left + width)]
    texture = cv2.GaussianBlur(rng.normal(0.0, 1.0, post.shape), (0, 0), 2.0)
    post[:] = 90.0 + 12.0 * texture / texture.std() + rng.normal(0.0, 1.5, post.shape)
    grid = find_wall_grid(picture)
    assert labelling_error(grid, camera)[0] == 0.0
    # on both sides of it
    assert np.count_nonzero(grid.points_px[:, 0] < left) > 20
    assert np.count_nonzero(grid.points_px[:, 0] > left + width) > 20


def test_lines_that_cannot_be_numbered_reliably_are_refused() -> None:
    """Hairlines sampled so coarsely that they come and go, with a false rhythm of their own."""
    rng = np.random.default_rng(13)
    cameras = [some_camera(rng, (208, 116)) for _ in range(14)]
    for index in (5, 13):
        with pytest.raises(CalibrationError) as refusal:
            find_wall_grid(rendered(cameras[index], seed=13 + index, samples=3))
        assert refusal.value.hint


@pytest.mark.parametrize("enlarged", [1.0, 2.0, 2.2, 4.0])
def test_a_small_image_with_aliased_fine_lines_is_numbered_correctly(enlarged: float) -> None:
    """Squares of 3.3 px in one of the clips that ship, fine lines beyond what pixels resolve.

    Every third line of the enlarged picture falls on pixels alike: in one direction such a beat
    was taken for coarse lines.
    """
    clip = Path(__file__).parents[3] / "sample_videos" / "clips" / "jokku_90_small.mp4"
    truth = json.loads(clip.with_suffix(".truth.json").read_text(encoding="utf-8"))
    frames = [f.gray for f in ClipReader.open(clip).frames() if f.index % 8 == 0]
    wall = np.median(frames, axis=0)
    grid = find_wall_grid(cv2.resize(wall, None, fx=enlarged, fy=enlarged))
    camera = camera_of(truth["camera"])
    points = (grid.points_px + 0.5) / enlarged - 0.5
    true = (camera.to_plane(points) - truth["wall"]["origin"]) / 0.05
    off = true - grid.nodes - np.round(np.median(true - grid.nodes, axis=0))
    assert np.abs(off).max() < 0.3
    assert len(grid.nodes) > 80


FOLDED = Camera.facing_wall(Lens.centred(432, 240, 809.3), [0.52, 0.51, 4.6], yaw=0.002)
"""Squares of 8.8 px; lines every 1.76 px are shown by the pixels as if every 2.3 px."""


@pytest.mark.parametrize("fine_depth", [0.18, 0.42])
def test_squares_are_found_among_aliased_fine_lines(fine_depth: float) -> None:
    wall = partial(line_grid, width=0.002, depth=0.72, fine_depth=fine_depth)
    grid = find_wall_grid(rendered(FOLDED, wall, samples=5, blur=0.3, noise=1.0))
    assert labelling_error(grid, FOLDED)[0] == 0.0
    assert len(grid.nodes) > 150


def test_aliased_fine_lines_are_not_taken_for_the_grid() -> None:
    wall = partial(line_grid, pitch=0.01, width=0.001, fine=None)
    with pytest.raises(CalibrationError, match="too fine"):
        find_wall_grid(rendered(FOLDED, wall, samples=5, blur=0.3, noise=1.0))


@pytest.mark.parametrize(("order", "expected"), [(5, True), (1, False)])
def test_aliased_harmonics_are_assigned_to_their_fundamental(order: int, expected: bool) -> None:
    ground = GridMap(np.zeros(2), np.ones(2), np.array([0.1136, 0, 0, 0, 0.1137, 0, 0, 0, 0, 0]))
    fold = np.array([[1.0, 0.0], [0.0, 1.0]]) if order == 5 else np.zeros((2, 2))
    waves = order * ground.jacobian(np.zeros(2)) - fold
    other = GridMap(
        np.zeros(2), np.ones(2), np.array([*waves[0], 0, *waves[1], 0, 0, 0, 0, 0], dtype=float)
    )
    support = MapSupport(np.zeros((2, 4, 4)), np.full((2, 4, 4), 20.0), np.full((2, 4, 4), 0.1))
    better = MapSupport(support.phase, support.coherence, 2.0 * support.share)
    first = ranked([(other, better), (ground, support)])[0][0]
    assert (first is ground) is expected


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_found_at_forty_poses() -> None:
    rng = np.random.default_rng(11)
    for seed in range(40):
        camera = some_camera(rng)
        grid = find_wall_grid(rendered(camera, seed=seed, samples=3))
        assert labelling_error(grid, camera)[0] == 0.0


@pytest.mark.parametrize(
    ("clip", "tolerance"), [("basketball_60_wide", 0.3), ("jokku_90_small", 0.2)]
)
def test_found_in_ray_traced_frames(clip: str, tolerance: float) -> None:
    folder = shared_folder("rendered") / clip
    truth = json.loads((folder / "truth.json").read_text())
    av = pytest.importorskip("av")
    with av.open(str(folder / "clip.mp4")) as container:
        frames = [f.to_ndarray(format="gray") for f in container.decode(video=0)]
    grid = find_wall_grid(np.median(frames[::8], axis=0))
    camera = true_camera(truth["camera"])
    true = (camera.to_plane(grid.points_px) - [truth["grid"]["gx"], truth["grid"]["gy"]]) / 0.05
    offset = np.round(np.median(true - grid.nodes, axis=0))
    assert (np.round(true) == grid.nodes + offset).all()
    wall = (grid.nodes + offset) * 0.05 + [truth["grid"]["gx"], truth["grid"]["gy"]]
    error = grid.points_px - camera.project(np.c_[wall, np.zeros(len(wall))])
    assert np.sqrt((error**2).mean()) < tolerance
    assert np.abs(error.mean(axis=0)).max() < 0.05


def true_camera(c: dict) -> Camera:
    lens = Lens(c["W"], c["H"], c["F_px"], c["F_px"], c["u0"], c["v0"], c["k1"], c["k2"])
    flip = np.array([1.0, 1.0, -1.0])
    axes = [np.array(c["right"]), -np.array(c["up"]), np.array(c["forward"])]
    return Camera(lens, np.array([axis * flip for axis in axes]), np.array(c["location"]) * flip)


def camera_of(c: dict) -> Camera:
    """Camera of a clip that ships."""
    fields = ("width", "height", "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    lens = Lens(*(c[key] for key in fields))
    return Camera(lens, np.array(c["rotation_world_to_camera"]), np.array(c["position_m"]))


@pytest.fixture(scope="module")
def square_camera() -> Camera:
    return Camera.facing_wall(Lens.centred(432, 240, 520.0), [0.9, 0.5, 2.5], yaw=0.05)


def test_bright_lines_on_a_dark_wall(square_camera: Camera) -> None:
    picture = rendered(square_camera, lambda xy: 1.2 - line_grid(xy, fine=None), shadow=False)
    grid = find_wall_grid(picture, fine_pitch_m=None)
    assert not grid.dark
    true = square_camera.to_plane(grid.points_px) / 0.05
    assert np.abs(true - np.round(true)).max() < 0.2


def test_the_same_wall_is_searched_once_and_another_pitch_anew(square_camera: Camera) -> None:
    wall = rendered(square_camera, seed=5, samples=2)
    start = time.process_time()
    first = find_wall_grid(wall)
    searched = time.process_time() - start
    again = find_wall_grid(wall.copy())
    assert time.process_time() - start - searched < 0.1 * searched
    assert np.array_equal(first.points_px, again.points_px)
    assert find_wall_grid(wall, pitch_m=0.1, fine_pitch_m=0.02).pitch_m == 0.1
    for _ in range(2):
        with pytest.raises(CalibrationError):
            find_wall_grid(np.full((60, 80), 128.0))


def test_the_origin_is_the_given_one(square_camera: Camera) -> None:
    grid = find_wall_grid(rendered(square_camera))
    moved = grid.with_origin(grid.points_px[7], snap=True)
    assert moved.wall_m[7] == pytest.approx([0.0, 0.0])
    assert moved.to_wall(grid.points_px[7]) == pytest.approx([0.0, 0.0], abs=0.006)


def stripes(xy: np.ndarray) -> np.ndarray:
    return line_grid(np.stack([xy[..., 0], np.full(xy.shape[:-1], 0.025)], axis=-1), fine=None)


def chessboard(xy: np.ndarray) -> np.ndarray:
    return 0.2 + 0.8 * (np.floor(xy / 0.06).sum(axis=-1) % 2)


def bricks(xy: np.ndarray) -> np.ndarray:
    row = np.floor(xy[..., 1] / 0.07)
    along = (xy[..., 0] + 0.06 * (row % 2)) / 0.12
    joint = (np.abs(along - np.round(along)) < 0.05) | (xy[..., 1] / 0.07 - row < 0.1)
    return np.where(joint, 1.0, 0.5)


def oblongs(xy: np.ndarray) -> np.ndarray:
    return line_grid(xy * [1.0, 0.6], fine=None)


@pytest.mark.parametrize(
    ("wall", "reason"),
    [
        (lambda xy: np.ones(xy.shape[:-1]), "no grid"),
        (stripes, "one direction"),
        (chessboard, "chessboard"),
        (bricks, "bricks|squares"),
        (oblongs, "squares"),
    ],
)
def test_an_image_without_a_grid_is_refused_with_a_reason(
    wall: object, reason: str, square_camera: Camera
) -> None:
    with pytest.raises(CalibrationError, match=reason) as refusal:
        find_wall_grid(rendered(square_camera, wall))
    assert refusal.value.hint


@pytest.mark.parametrize("pitch", [6, 14])
def test_a_few_lines_on_a_uniform_image_are_refused_with_a_reason(pitch: int) -> None:
    y, x = np.mgrid[0:180, 0:320]
    end = 40 + int(2.6 * pitch)
    lines = ((x % pitch < 1.5) | (y % pitch < 1.5)) & (x >= 40) & (x < end) & (y >= 40) & (y < end)
    with pytest.raises(CalibrationError) as refusal:
        find_wall_grid(np.where(lines, 100, 120).astype(np.uint8))
    assert refusal.value.hint


def test_gradations_that_contradict_the_stated_pitch_are_reported() -> None:
    camera = Camera.facing_wall(Lens.centred(640, 360, 760.0), [0.4, 0.3, 1.2])
    grid = find_wall_grid(rendered(camera, shadow=False), pitch_m=0.1, fine_pitch_m=0.01)
    assert grid.fine_ratio == 5
    assert "check [wall] grid" in grid.warnings[0]
