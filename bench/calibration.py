"""Measure the calibration room against its targets and print the table as markdown.

Run from the repository: ``python -m bench.calibration [--poses 40] [--shared ../shared]``.
"""

import argparse
import json
from pathlib import Path

import av
import cv2
import numpy as np

from calib.calibration import BallOutlines, Evidence, FreeFall, Known
from calib.camera import Camera, Lens
from calib.grid import WallGrid, find_wall_grid
from calib.lens import Board, calibrate_lens, find_board
from calib.solve import calibrate
from metrology import CalibrationError
from tests.calib.synthetic import rendered, some_camera

Row = tuple[str, str, str, str]


def labelled_right(grid: WallGrid, camera: Camera) -> bool:
    true = camera.to_plane(grid.points_px) / grid.pitch_m
    offset = np.round(np.median(true - grid.nodes, axis=0))
    return bool((np.round(true) == grid.nodes + offset).all())


def lens_left_over(grid: WallGrid, camera: Camera) -> float:
    """Largest disagreement of wall coordinates at the corners, seen as px, after a common scale."""
    found = calibrate(grid)
    height, width = grid.area.shape
    corners = np.array(
        [[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], dtype=float
    )
    true = camera.to_plane(corners)
    ours = found.on_wall(corners)
    offset = np.median(camera.to_plane(grid.points_px) - found.on_wall(grid.points_px), axis=0)
    wall = np.c_[ours + offset, np.zeros(4)]
    seen = np.isfinite(true).all(axis=1)
    return float(np.linalg.norm(camera.project(wall)[seen] - corners[seen], axis=1).max())


def grid_rows(poses: int) -> list[Row]:
    rng = np.random.default_rng(2024)
    found, wrong, corners = 0, 0, []
    for index in range(poses):
        camera = some_camera(rng)
        try:
            grid = find_wall_grid(rendered(camera, seed=index, samples=3))
        except CalibrationError:
            continue
        if labelled_right(grid, camera):
            found += 1
            corners.append(lens_left_over(grid, camera))
        else:
            wrong += 1
    return [
        (
            f"grid found unaided, {poses} poses up to 35°, k1 −0.25 to 0.1, 640×360",
            "38 of 40",
            "40 of 40, none false",
            f"{found} of {poses}, {wrong} false",
        ),
        (
            "lens from the grid alone: residual distortion at the corners, median",
            "1 px",
            "0.3 px",
            f"{np.median(corners):.2f} px (95th percentile {np.percentile(corners, 95):.2f} px)",
        ),
    ]


def chessboard_row(shared: Path) -> Row:
    paths = sorted((shared / "clips" / "gopro_chessboard").glob("*.jpg"))
    images = [(p.stem, cv2.imread(str(p), cv2.IMREAD_GRAYSCALE)) for p in paths]
    found = calibrate_lens([find_board(image, Board(8, 6), name) for name, image in images])
    note = (
        f"{found.held_out_rms_px:.3f} px, {len(found.used)} of {len(paths)} views, every corner of "
        f"them ({found.model}); left out: {', '.join(found.dropped) or 'none'}"
    )
    return ("`gopro_chessboard`: held-out reprojection RMS", "0.52 px", "0.35 px", note)


def ball_plane_row(folder: Path) -> Row:
    """Position on the ball plane with neither tape nor lens: ball diameter and free fall only."""
    truth = json.loads((folder / "truth.json").read_text())
    setup = json.loads((folder / "setup.json").read_text())
    camera = true_camera(truth["camera"])
    with av.open(str(folder / "clip.mp4")) as clip:
        frames = [frame.to_ndarray(format="gray") for frame in clip.decode(video=0)]
    grid = find_wall_grid(np.median(frames[::4], axis=0))
    time = np.array(truth["frames"]["t_mid"])
    xy = np.c_[truth["frames"]["x_m"], truth["frames"]["y_m"]]
    radius, depth = setup["ball"]["diameter_m"] / 2, -truth["ball_plane_z"]
    px, size = camera.sphere_outline(np.c_[xy, np.full(len(xy), depth)], radius)
    rng = np.random.default_rng(0)
    px, size = px + rng.normal(0, 0.05, px.shape), size + rng.normal(0, 0.05, size.shape)
    flying = (time > truth["contact"]["t_off_s"]) & (time < truth["flight"]["t_land_s"])
    flying &= (px[:, 0] > 0) & (px[:, 0] < camera.lens.width)
    drop = -2.0 * np.polyfit(time[flying], xy[flying, 1], 2)[0]
    std = np.full(len(px), 0.05)
    evidence = Evidence(
        rest_px=px[:20].mean(axis=0),
        rest_height=float(xy[0, 1]),
        ball_radius=radius,
        outlines=BallOutlines(px[:20], size[:20], std[:20], Known(2 * radius, 2e-4)),
        fall=FreeFall(px[flying], time[flying], std[flying], Known(float(drop), 0.02)),
    )
    error = calibrate(grid, evidence).position(px[flying])[0] - xy[flying]
    rms = 1e3 * float(np.sqrt((error**2).sum(axis=1).mean()))
    name = f"{folder.name}, {camera.lens.width}×{camera.lens.height}"
    return (f"position on the ball plane, no tape: {name}", "4 mm", "1.5 mm", f"{rms:.2f} mm")


def true_camera(c: dict[str, object]) -> Camera:
    numbers = [c[key] for key in ("W", "H", "F_px", "F_px", "u0", "v0", "k1", "k2")]
    flip = np.array([1.0, 1.0, -1.0])
    axes = [np.array(c["right"]), -np.array(c["up"]), np.array(c["forward"])]
    lens = Lens(*numbers)  # type: ignore[arg-type]
    return Camera(lens, np.array([axis * flip for axis in axes]), np.array(c["location"]) * flip)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=40)
    parser.add_argument("--shared", type=Path, default=Path(__file__).parents[2] / "shared")
    options = parser.parse_args()
    rows: list[Row] = []
    if options.shared.is_dir():
        rows.append(chessboard_row(options.shared))
        rows += [
            ball_plane_row(p.parent) for p in sorted(options.shared.glob("rendered/*/truth.json"))
        ]
    rows += grid_rows(options.poses)
    print("| quantity | at least | aim | measured |\n|---|---|---|---|")
    for row in rows:
        print("| " + " | ".join(row) + " |")


if __name__ == "__main__":
    main()
