"""Commands of `vision calibrate`: set-up, boards, lenses, walls, rates, moves."""

import os
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import typer

from calib.board import Board, dictionary_from, find_board, write_board
from calib.calibration import Evidence, Known, Parameters
from calib.grid import WallGrid, find_wall_grid
from calib.lens import calibrate_lens, read_lens, write_lens
from calib.solve import camera_movement, solve
from measuring.setup.file import load_setup
from metrology import (
    CalibrationError,
    Defaults,
    NotFoundError,
    UsageError,
    parse_quantity,
    read_given,
    read_number,
)
from metrology.measurands import CAMERA_DISTANCE, CAPTURE_RATE, GRID_PITCH
from pipelines.calibrate.answers import open_scene, picture_of_board, point_from
from pipelines.calibrate.plan import plan_filming_command
from pipelines.calibrate.saving import lens_for, read_view
from pipelines.calibrate.session import Session, session_of
from pipelines.doors import FileRole
from pipelines.terminal import DefaultCommandGroup
from vision.clip.clip import ClipReader
from vision.clip.footage import choose_capture_rate, rate_from_blinking

__all__ = [
    "CALIBRATE_COMMANDS",
    "ClipOrCommand",
    "describe_outlook",
    "find_unattended",
]


def describe_outlook(session: Session) -> str:
    """Effect of the last answer on the expected uncertainty, as text."""
    found = session.outlook
    if found.std is None:
        return found.problem
    change = session.changes[-1]
    before = "" if change.before is None else f", before {1e3 * change.before:.3g} mm"
    where = "an assumed landing" if found.assumed else "the landing"
    return f"{where} is expected to ± {1e3 * found.std:.3g} mm{before}"


class ClipOrCommand(DefaultCommandGroup):
    """A group in which a clip as first word means `clip`."""

    meant = "clip"
    spelled: ClassVar = {"--check": "check"}


_ClipArgument = Annotated[Path, typer.Argument(help="The clip.", metavar="CLIP")]
_FpsOption = Annotated[str | None, typer.Option(help="Capture rate.", metavar="RATE")]
_LensOption = Annotated[Path | None, typer.Option(help="A lens file.")]
_WallGridOption = Annotated[str | None, typer.Option(help="Side of a grid square.")]
_FineGridOption = Annotated[
    str | None, typer.Option(help="Distance of fine lines, or none; default: 1/5 of a square.")
]
_OriginAtOption = Annotated[
    str | None, typer.Option(help="Origin of the wall coordinates, px.", metavar="X,Y")
]
_BallOption = Annotated[
    str | None, typer.Option(help="A preset, or '220 mm, 0.4 kg'.", metavar="NAME|DIAMETER")
]
_BallAtOption = Annotated[
    str | None, typer.Option(help="Position of the ball at rest, px.", metavar="X,Y")
]
_SupportHeightOption = Annotated[
    str | None, typer.Option(help="Height of the support above the landing level.")
]
_CameraDistanceOption = Annotated[
    str | None, typer.Option(help="Measured distance camera to wall: '4.00 m ± 5 mm'.")
]
_BallPlaneOption = Annotated[
    str | None, typer.Option(help="Measured distance ball's plane to wall: '0.45 m ± 5 mm'.")
]
_PendulumMassOption = Annotated[str | None, typer.Option(help="Mass of all that swings.")]
_PendulumLengthOption = Annotated[str | None, typer.Option(help="Pivot to where it strikes.")]
_PendulumComOption = Annotated[str | None, typer.Option(help="Pivot to its centre of mass.")]
_PendulumInertiaOption = Annotated[str | None, typer.Option(help="Inertia about the pivot.")]
_PendulumPeriodOption = Annotated[
    str | None, typer.Option(help="Instead: period of small swings, for the inertia.")
]
_SetupOption = Annotated[
    Path | None, typer.Option(help="Setup file to begin with; its other tables are kept.")
]
_OutOption = Annotated[
    Path, typer.Option("--out", "-o", help="Setup file to write."), FileRole.WRITES
]
_YesOption = Annotated[
    bool, typer.Option("--yes", "-y", help="Ask nothing; find what is not given.")
]
_BrowserOption = Annotated[bool, typer.Option(help="Open the browser.")]
_PortOption = Annotated[int, typer.Option(help="Port of the page; 0: any free one.", min=0)]


def clip_command(
    clip: _ClipArgument,
    fps: _FpsOption = None,
    lens: _LensOption = None,
    wall_grid: _WallGridOption = None,
    fine_grid: _FineGridOption = None,
    origin_at: _OriginAtOption = None,
    ball: _BallOption = None,
    ball_at: _BallAtOption = None,
    support_height: _SupportHeightOption = None,
    camera_distance: _CameraDistanceOption = None,
    ball_plane: _BallPlaneOption = None,
    pendulum_mass: _PendulumMassOption = None,
    pendulum_length: _PendulumLengthOption = None,
    pendulum_com: _PendulumComOption = None,
    pendulum_inertia: _PendulumInertiaOption = None,
    pendulum_period: _PendulumPeriodOption = None,
    setup: _SetupOption = None,
    out: _OutOption = Path("setup.toml"),
    yes: _YesOption = False,
    browser: _BrowserOption = True,
    port: _PortOption = 0,
) -> None:
    """Calibrate a clip step by step on the page; write setup.toml and lens.toml.

    Example: vision calibrate strike.mp4 --wall-grid 50mm --ball jokku --fps 600 --yes
    """
    _require_folder(out)
    session = session_of(
        clip,
        out,
        setup=setup,
        fps=fps,
        lens=None if lens is None else str(lens),
        wall_grid=wall_grid,
        fine_grid=fine_grid,
        origin_at=origin_at,
        ball=ball,
        ball_at=ball_at,
        support_height=support_height,
        camera_distance=camera_distance,
        ball_plane=ball_plane,
        pendulum_mass=pendulum_mass,
        pendulum_length=pendulum_length,
        pendulum_com=pendulum_com,
        pendulum_inertia=pendulum_inertia,
        pendulum_period=pendulum_period,
    )
    if yes:
        _unattended(session)
    else:
        # import here: NiceGUI takes a second, which other commands must not pay
        from pipelines.app.command import set_up_clip

        set_up_clip(session, browser=browser, port=port)


def old_view(against: Path) -> Path | None:
    """The lens file with the old view if `against` is a setup or lens file; None for a clip.

    Raises
    ------
    SetupError
        If the setup file is invalid.
    """
    if against.suffix != ".toml" or against.is_dir():
        return None
    try:
        read_view(against)
    except UsageError:
        lens = load_setup(against).camera.lens
        return lens if lens is not None else lens_for(against)
    return against


def _require_folder(out: Path) -> None:
    folder = out.parent
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise UsageError(
            f"can't write {out}: {folder} is not a writable folder",
            hint="Pass a file in an existing, writable folder as --out.",
        )


def _say(line: str) -> None:
    typer.echo(line, err=True)


def find_unattended(session: Session) -> str:
    """Find grid and ball without questions; return what was not found.

    Raises
    ------
    CalibrationError
        If no wall grid is found.
    """
    session.find_grid()
    if session.answers.grid is None:
        raise CalibrationError(session.grid_problem, hint="Pass --wall-grid, or omit --yes.")
    if session.answers.rest_px is None:
        try:
            session.follow_ball()
        except NotFoundError as problem:
            return f"the ball was not followed: {problem.in_one_line}"
    return ""


def _unattended(session: Session) -> None:
    if missing := find_unattended(session):
        _say(missing)
    _write(session)


def _write(session: Session) -> None:
    written = session.save()
    for warning in session.outlook.warnings:
        _say(warning)
    if session.outlook.std is not None:
        typer.echo(describe_outlook(session))
    typer.echo(f"wrote {written}")


def rate_command(
    clip: Annotated[Path, typer.Argument(help="A clip with the blinking light in view.")],
    light_at: Annotated[str, typer.Option(help="Position of the light: X,Y in px.")],
    blink: Annotated[str, typer.Option(help="Blink rate, such as '10 Hz'.")],
    blink_std: Annotated[str, typer.Option(help="Its standard uncertainty.")] = "0 Hz",
    around: Annotated[int, typer.Option(help="Half-width of the region evaluated, px.")] = 4,
    fps: Annotated[
        str | None, typer.Option(help="The rate the camera is thought to have; within a third.")
    ] = None,
) -> None:
    """Measure the capture rate from a light that blinks at a known rate."""
    film = ClipReader.open(clip)
    column, row = point_from(light_at, (film.info.width, film.info.height))
    if around < 0:
        raise UsageError(f"--around {around} is negative", hint="Pass 0 px or more.")
    top, left = max(0, round(float(row)) - around), max(0, round(float(column)) - around)
    place = np.s_[top : round(float(row)) + around + 1, left : round(float(column)) + around + 1]
    rate = choose_capture_rate(film.info, None if fps is None else read_number(fps, CAPTURE_RATE))
    found = rate_from_blinking(
        [float(frame.gray[place].mean()) for frame in film.frames()],
        parse_quantity(blink, "Hz"),
        blink_std_hz=parse_quantity(blink_std, "Hz"),
        nominal_fps=rate.fps,
    )
    typer.echo(f"capture rate {found.fps:.3f} ± {found.std:.3f} fps, by the {found.source}")
    typer.echo(f"in the setup file: capture_fps = {found.fps:.6g}")
    if abs(found.fps - rate.fps) > max(4.0 * found.std, 1e-3 * rate.fps):
        typer.echo(f"The {rate.source} states {rate.fps:g} fps, which disagrees", err=True)


BoardSize = Annotated[str, typer.Option(help="Inner corners, columns x rows.")]

Square = Annotated[str, typer.Option(help="Side of a board square.")]

Charuco = Annotated[bool, typer.Option(help="ChArUco board: markers in the white squares.")]


Dictionary = Annotated[
    str | None,
    typer.Option(help="Its markers, such as 4X4_50; default: found, or 5X5_250 for print."),
]

Marker = Annotated[
    str | None,
    typer.Option(help="Side of a marker; default: found, or 3/4 of a square for print."),
]


def _board(
    size: str, square: str, charuco: bool, dictionary: str | None, marker: str | None
) -> Board:
    columns, rows = _inner_corners(size)
    side = read_number(square, GRID_PITCH)
    known = Board(columns, rows, side, charuco or dictionary is not None or marker is not None)
    if dictionary is not None:
        known = replace(known, dictionary=dictionary_from(dictionary))
    if marker is None:
        return known
    smaller = read_number(marker, GRID_PITCH)
    if smaller >= side:
        raise UsageError(
            f"--marker {marker} is not smaller than a square of {1e3 * side:g} mm",
            hint="Pass the side of a marker, and as --square the side of a square around it.",
        )
    return replace(known, marker_m=smaller)


def _inner_corners(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"\s*(\d+)\s*[x×]\s*(\d+)\s*", text)
    if match is None or min(int(n) for n in match.groups()) < 3:
        raise UsageError(
            f"{text!r} is not a board size", hint="Write inner corners as columns x rows: 8x6."
        )
    return int(match[1]), int(match[2])


def _taped(text: str) -> Known:
    given = read_given(text, CAMERA_DISTANCE, "--camera-distance")
    return Known(given.value, Defaults.TAPE.std if given.std is None else given.std)


def board_command(
    pdf: Annotated[Path, typer.Option(help="PDF file to write."), FileRole.WRITES],
    size: BoardSize = "8x6",
    square: Square = "25 mm",
    charuco: Charuco = False,
    dictionary: Dictionary = None,
    marker: Marker = None,
) -> None:
    """Write a calibration board to print at 100 % on A4 paper."""
    write_board(pdf, _board(size, square, charuco, dictionary, marker))
    typer.echo(f"wrote {pdf}. Print it at 100 %, glue it to a flat plate and measure a square")


def lens_command(
    pictures: Annotated[list[Path], typer.Argument(help="Images of the board.")],
    size: BoardSize = "8x6",
    square: Square = "25 mm",
    charuco: Charuco = False,
    dictionary: Dictionary = None,
    marker: Marker = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Lens file to write."), FileRole.WRITES
    ] = Path("lens.toml"),
) -> None:
    """Calibrate a lens from images of a board; write lens.toml."""
    board = _board(size, square, charuco, dictionary, marker)
    found = calibrate_lens(
        [find_board(picture_of_board(path), board, path.name) for path in pictures]
    )
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
        str | None, typer.Option(help="Measured distance camera to wall (± 5 mm assumed).")
    ] = None,
    lens: Annotated[Path | None, typer.Option(help="A lens file.")] = None,
) -> None:
    """Find the wall grid of a clip and determine the camera position."""
    grid = _grid(clip, wall_grid)
    tape = None if camera_distance is None else _taped(camera_distance)
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
            "the camera is almost perpendicular to the wall: pass --camera-distance", err=True
        )
    for warning in found.warnings:
        typer.echo(warning, err=True)


def check_command(
    first: Annotated[
        Path, typer.Argument(help="Old setup file or lens file.", metavar="OLD_SETUP")
    ],
    second: Annotated[Path | None, typer.Argument(help="The new clip.", metavar="NEW_CLIP")] = None,
    against: Annotated[
        Path | None,
        typer.Option(help="Old clip or setup file; then the only argument is the new clip."),
    ] = None,
    wall_grid: Annotated[
        str | None,
        typer.Option(help="Distance between coarse lines; default: as before, or 50 mm."),
    ] = None,
) -> None:
    """Test whether the camera has moved since its calibration."""
    if (second is None) == (against is None):
        raise UsageError(
            "two files are needed: the old calibration and the new clip",
            hint="Run vision calibrate check OLD_SETUP NEW_CLIP, or check NEW_CLIP --against OLD.",
        )
    old, new = (first, second) if second is not None else (against, first)
    assert old is not None
    view = old_view(old)
    before = _grid(old, wall_grid or "50 mm") if view is None else read_view(view)
    now = _grid(new, wall_grid or f"{before.pitch_m!r} m")
    if view is not None and abs(now.pitch_m / before.pitch_m - 1.0) > 1e-6:
        raise UsageError(
            f"--wall-grid differs from the old calibration's {1e3 * before.pitch_m:g} mm",
            hint="Omit --wall-grid.",
        )
    typer.echo(str(camera_movement(before, now)))


def _grid(path: Path, pitch: str) -> WallGrid:
    return find_wall_grid(open_scene(path).picture, pitch_m=read_number(pitch, GRID_PITCH))


CALIBRATE_COMMANDS: dict[str, Callable[..., None]] = {
    "clip": clip_command,
    "board": board_command,
    "lens": lens_command,
    "wall": wall_command,
    "check": check_command,
    "rate": rate_command,
    "plan": plan_filming_command,
}

"""Commands of `vision calibrate`, by name."""
