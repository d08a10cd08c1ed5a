"""`vision calibrate`: boards to print, lenses, the wall of a clip, and whether a camera moved.

`vision calibrate rate`: the camera's true capture rate from a light of known rate in view.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from numpy.typing import NDArray

from calib.calibration import Evidence, Parameters
from calib.camera.lens import Board, calibrate_lens, find_board, read_lens, write_board, write_lens
from calib.grid.grid import WallGrid, find_wall_grid
from calib.pose import camera_movement
from calib.solve import solve
from calib.time_base import rate_from_blinking
from metrology import ClipError, UsageError, parse_quantity
from pipelines.calibrate.clip import ClipOrCommand, clip_command, old_view
from pipelines.calibrate.plan import plan_filming_command
from pipelines.calibrate.wizard.answers import (
    board_size,
    distance_from,
    pitch_from,
    point_from,
    rate_from,
)
from pipelines.calibrate.wizard.session import read_view
from pipelines.doors import FileRole
from vision.clip.clip import ClipReader
from vision.clip.footage import choose_capture_rate

__all__ = ["CALIBRATE_COMMANDS", "ClipOrCommand"]


def rate_command(
    clip: Annotated[Path, typer.Argument(help="A clip with the blinking light in view.")],
    light_at: Annotated[str, typer.Option(help="Where the light is: X,Y in px.")],
    blink: Annotated[str, typer.Option(help="How often it blinks, such as '10 Hz'.")],
    blink_std: Annotated[str, typer.Option(help="How well that is known.")] = "0 Hz",
    around: Annotated[int, typer.Option(help="Half the side of the place looked at, px.")] = 4,
    fps: Annotated[
        str | None, typer.Option(help="The rate the camera is thought to have; within a third.")
    ] = None,
) -> None:
    """Measure the capture rate from a light in view that blinks at a known rate."""
    film = ClipReader.open(clip)
    column, row = point_from(light_at, (film.info.width, film.info.height))
    if around < 0:
        raise UsageError(f"--around {around} is no size", hint="Give px, 0 or more.")
    top, left = max(0, round(float(row)) - around), max(0, round(float(column)) - around)
    place = np.s_[top : round(float(row)) + around + 1, left : round(float(column)) + around + 1]
    rate = choose_capture_rate(film.info, None if fps is None else rate_from(fps))
    found = rate_from_blinking(
        [float(frame.gray[place].mean()) for frame in film.frames()],
        parse_quantity(blink, "Hz"),
        blink_std_hz=parse_quantity(blink_std, "Hz"),
        nominal_fps=rate.fps,
    )
    typer.echo(f"capture rate {found.fps:.3f} ± {found.std:.3f} fps, by the {found.source}")
    typer.echo(f"in the setup file: capture_fps = {found.fps:.6g}")
    if abs(found.fps - rate.fps) > max(4.0 * found.std, 1e-3 * rate.fps):
        typer.echo(f"{rate.fps:g} fps, from the {rate.source}, is not what it is", err=True)


FRAMES_AVERAGED = 40

"""Frames whose median shows the wall without what moves: that hides it in fewer than half."""

BoardSize = Annotated[str, typer.Option(help="Inner corners, columns x rows.")]

Square = Annotated[str, typer.Option(help="Side of a square.")]

Charuco = Annotated[bool, typer.Option(help="A ChArUco board: markers in the white squares.")]


def _board(size: str, square: str, charuco: bool) -> Board:
    columns, rows = board_size(size)
    return Board(columns, rows, pitch_from(square), charuco)


def board_command(
    pdf: Annotated[Path, typer.Option(help="The file to write."), FileRole.WRITES],
    size: BoardSize = "8x6",
    square: Square = "25 mm",
    charuco: Charuco = False,
) -> None:
    """Write a calibration board to print at 100 % on A4 paper."""
    write_board(pdf, _board(size, square, charuco))
    typer.echo(f"wrote {pdf}: print at 100 %, glue it on something flat, measure a square")


def lens_command(
    pictures: Annotated[list[Path], typer.Argument(help="Pictures of the board.")],
    size: BoardSize = "8x6",
    square: Square = "25 mm",
    charuco: Charuco = False,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="The lens file to write."), FileRole.WRITES
    ] = Path("lens.toml"),
) -> None:
    """Measure a lens from pictures of a board, and write lens.toml."""
    board = _board(size, square, charuco)
    found = calibrate_lens([find_board(_picture(path), board, path.name) for path in pictures])
    write_lens(out, found)
    lens, std = found.lens, found.std
    typer.echo(
        f"focal length {lens.fx:.1f} ± {std['fx']:.1f} px, k1 {lens.k1:.4f} ± {std['k1']:.4f}"
    )
    typer.echo(f"held-out reprojection error {found.held_out_rms_px:.2f} px; wrote {out}")
    for warning in found.warnings:
        typer.echo(warning, err=True)


def wall_command(
    clip: Annotated[Path, typer.Argument(help="A clip with the wall grid in view.")],
    wall_grid: Annotated[str, typer.Option(help="Distance between coarse lines.")] = "50 mm",
    camera_distance: Annotated[
        str | None, typer.Option(help="Camera to wall by tape, within 5 mm.")
    ] = None,
    lens: Annotated[Path | None, typer.Option(help="A lens file.")] = None,
) -> None:
    """Find the wall grid of a clip and tell where the camera stands."""
    grid = _grid(clip, wall_grid)
    tape = None if camera_distance is None else distance_from(camera_distance)
    prior = None if lens is None else read_lens(lens, width=grid.size[0], height=grid.size[1])
    found = solve(grid, Evidence(camera_distance=tape), lens=prior).calibration
    value, std = found.parameters, Parameters.of(np.sqrt(np.diag(found.covariance)))
    distance, focal = found.camera_distance, found.grid_camera.lens.fx
    typer.echo(f"{len(grid.nodes)} crossings, lines {'dark' if grid.dark else 'bright'}")
    typer.echo(f"camera {distance:.3f} ± {distance * std.log_distance:.3f} m from the wall")
    typer.echo(f"focal length {focal:.1f} ± {focal * std.log_focal:.1f} px")
    typer.echo(f"distortion k1 {value.k1:.3f} ± {std.k1:.3f}")
    if std.log_distance > 0.1:
        typer.echo(
            "the view is nearly square on: tape the camera's distance to pin it down", err=True
        )
    for warning in found.warnings:
        typer.echo(warning, err=True)


def check_command(
    first: Annotated[
        Path, typer.Argument(help="The old setup file (or lens file).", metavar="OLD_SETUP")
    ],
    second: Annotated[Path | None, typer.Argument(help="The new clip.", metavar="NEW_CLIP")] = None,
    against: Annotated[
        Path | None,
        typer.Option(
            help="Instead: the old clip or setup file, with the new clip alone before it."
        ),
    ] = None,
    wall_grid: Annotated[
        str | None, typer.Option(help="Distance between coarse lines; as it was, else 50 mm.")
    ] = None,
) -> None:
    """Tell whether the camera has moved since it was calibrated."""
    if (second is None) == (against is None):
        raise UsageError(
            "two things are compared",
            hint="vision calibrate --check OLD_SETUP NEW_CLIP, or check NEW_CLIP --against OLD.",
        )
    old, new = (first, second) if second is not None else (against, first)
    assert old is not None
    view = old_view(old)
    before = _grid(old, wall_grid or "50 mm") if view is None else read_view(view)
    now = _grid(new, wall_grid or f"{before.pitch_m!r} m")
    if view is not None and abs(now.pitch_m / before.pitch_m - 1.0) > 1e-6:
        raise UsageError(
            f"the old calibration has squares of {1e3 * before.pitch_m:g} mm",
            hint="Leave --wall-grid out.",
        )
    typer.echo(str(camera_movement(before, now)))


def _grid(path: Path, pitch: str) -> WallGrid:
    clip = ClipReader.open(path)
    stride = max(1, clip.info.frames // FRAMES_AVERAGED)
    frames = [frame.gray for frame in clip.frames() if frame.index % stride == 0]
    return find_wall_grid(np.median(frames, axis=0), pitch_m=pitch_from(pitch))


def _picture(path: Path) -> NDArray[np.uint8]:
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None
    if picture is None:
        raise ClipError(f"{path} is no picture that can be read", hint="Give JPEG or PNG files.")
    return np.asarray(picture, dtype=np.uint8)


CALIBRATE_COMMANDS: dict[str, Callable[..., None]] = {
    "clip": clip_command,
    "board": board_command,
    "lens": lens_command,
    "wall": wall_command,
    "check": check_command,
    "rate": rate_command,
    "plan": plan_filming_command,
}

"""Commands under `vision calibrate`, by name."""
