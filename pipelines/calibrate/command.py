"""`vision calibrate`: boards to print, lenses, the wall of a clip, and whether a camera moved.

`vision calibrate rate`: the camera's true capture rate from a light of known rate in view.

`vision calibrate CLIP`: the wizard in the browser, on the terminal, or unattended.

The same questions on a text terminal.
"""

import os
import sys
import webbrowser
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import cv2
import numpy as np
import typer
from numpy.typing import NDArray

from calib.calibration import Evidence, Parameters
from calib.grid import WallGrid, find_wall_grid
from calib.lens import Board, calibrate_lens, find_board, read_lens, write_board, write_lens
from calib.solve import camera_movement, solve
from metrology import (
    CalibrationError,
    ClipError,
    ImpactVisionError,
    NotFoundError,
    UsageError,
    parse_quantity,
)
from physics.bodies import BALLS, PAPER_SUPPORT
from pipelines.calibrate.plan import plan_filming_command
from pipelines.calibrate.wizard.answers import (
    Answers,
    BallKind,
    ball_from,
    board_size,
    distance_from,
    fine_pitch_from,
    lens_from_file,
    look_at,
    pitch_from,
    point_from,
    rate_from,
)
from pipelines.calibrate.wizard.session import Session, lens_for, read_view, with_ball
from pipelines.doors import FileRole
from pipelines.setup.file import load_setup, read_setup
from pipelines.terminal import DefaultCommandGroup
from vision.clip.clip import ClipReader
from vision.clip.footage import choose_capture_rate, rate_from_blinking
from vision.clip.picture import decoded_image

if TYPE_CHECKING:
    from pipelines.web import Jobs

__all__ = [
    "CALIBRATE_COMMANDS",
    "ClipOrCommand",
    "Dialogue",
    "ask_all",
    "find_unattended",
    "session_of",
    "told_of",
]

Changed = Callable[[Answers, str], Answers]


class Dialogue:
    """Somebody to ask.

    Parameters
    ----------
    ask : callable
        Takes a question and what an empty answer means; returns the answer.
    say : callable
        Takes a line to show.
    """

    def __init__(self, ask: Callable[[str, str], str], say: Callable[[str], None]) -> None:
        self.ask = ask
        self.say = say

    def until_right(
        self, session: Session, question: str, default: str, label: str, changed: Changed
    ) -> None:
        """Ask until the answer makes sense, and tell what it did; an empty answer keeps."""
        while True:
            text = self.ask(question, default).strip()
            if text == default:
                return
            try:
                session.apply(label, partial(_with_text, changed, text))
            except ImpactVisionError as problem:
                self.say(f"  {problem.in_one_line}")
                continue
            self.say(f"  {told_of(session)}")
            return


def _with_text(changed: Changed, text: str, answers: Answers) -> Answers:
    return changed(answers, text)


def told_of(session: Session) -> str:
    """What the last answer did to the expected uncertainty, in words."""
    found = session.outlook
    if found.std is None:
        return found.problem
    change = session.changes[-1]
    before = "" if change.before is None else f", before {1e3 * change.before:.3g} mm"
    where = "a supposed landing" if found.supposed else "the landing"
    return f"{where} is expected to ± {1e3 * found.std:.3g} mm{before}"


def ask_all(session: Session, talk: Dialogue, given: frozenset[str] = frozenset()) -> None:
    """Go through the six steps.

    Parameters
    ----------
    session : Session
        Its answers are the defaults.
    talk : Dialogue
    given : frozenset of str
        Questions that options have answered already: "fps", "lens", "wall", "ball", "support",
        "camera_distance", "ball_plane".
    """
    info = session.answers.scene.info
    talk.say(f"1 clip: {info.path.name}, {info.width} × {info.height} px, {info.frames} frames")
    if "fps" not in given:
        _ask_rate(session, talk)
    if "lens" not in given:
        talk.until_right(session, "2 lens file (empty: from the wall grid)", "", "lens", _lens)
    _ask_wall(session, talk, given)
    _ask_ball(session, talk, given)
    for key, question in (
        ("camera_distance", "5 camera to wall by tape, such as '4.00 m ± 5 mm' (empty: not taped)"),
        ("ball_plane", "  ball's plane to wall by tape (empty: not taped)"),
    ):
        if key not in given:
            field = "ball_plane_offset" if key == "ball_plane" else key
            talk.until_right(session, question, "", question.strip("5 "), _distance(field))
    found = session.outlook
    if found.calibration is None:
        talk.say(f"6 check: {found.problem}")
        return
    talk.say(f"6 check: χ² per degree of freedom {found.calibration.chi2_per_dof:.2f}")
    for line in found.budget[:5]:
        talk.say(f"  {line.source}: {1e3 * line.std:.3g} mm")
    for warning in found.warnings:
        talk.say(f"  {warning}")


def _ask_rate(session: Session, talk: Dialogue) -> None:
    known = session.answers.rate_known
    default = f"{session.answers.capture_fps:g}" if known else ""
    question = "  capture rate, frames per second" + ("" if known else " (empty: not known)")
    talk.until_right(session, question, default, "capture rate", _rate)


def _ask_wall(session: Session, talk: Dialogue, given: frozenset[str]) -> None:
    if "wall" not in given:
        pitch = f"{1e3 * session.answers.pitch:g} mm"
        talk.until_right(session, "3 side of a square of the wall grid", pitch, "squares", _pitch)
        fine = session.answers.fine_pitch
        shown = "none" if fine is None else f"{1e3 * fine:g} mm"
        talk.until_right(session, "  fine lines apart, or none", shown, "fine lines", _fine)
    talk.say("3 looking for the wall grid …")
    session.find_grid()
    grid = session.answers.grid
    if grid is None:
        talk.say(f"  {session.grid_problem}")
    else:
        talk.say(f"  {len(grid.nodes)} crossings; {told_of(session)}")


def _ask_ball(session: Session, talk: Dialogue, given: frozenset[str]) -> None:
    if "ball" not in given:
        names = ", ".join(kind.name for kind in session.presets)
        question = f"4 ball: {names}, or diameter and mass ('220 mm, 0.4 kg'; empty: not known)"
        talk.until_right(session, question, "", "ball", lambda a, text: _ball(session, a, text))
    if "support" not in given:
        height = session.answers.support_height
        shown = "" if height is None else f"{height:g} m"
        talk.until_right(session, "  height of the support", shown, "support height", _support)
    if session.answers.rest_px is not None:
        return
    talk.say("  following the ball …")
    try:
        session.follow_ball()
        talk.say(f"  {told_of(session)}")
    except NotFoundError as problem:
        talk.say(f"  {problem.in_one_line}")
        question = "  the ball at rest in the picture, X,Y in px (empty: not known)"
        talk.until_right(session, question, "", "ball at rest", _rest)


def _rate(answers: Answers, text: str) -> Answers:
    return replace(answers, fps=rate_from(text))


def _lens(answers: Answers, text: str) -> Answers:
    return replace(answers, lens=lens_from_file(Path(text), answers.scene.size))


def _pitch(answers: Answers, text: str) -> Answers:
    return replace(answers, pitch=pitch_from(text))


def _fine(answers: Answers, text: str) -> Answers:
    return replace(answers, fine_pitch=fine_pitch_from(text, answers.pitch))


def _ball(session: Session, answers: Answers, text: str) -> Answers:
    kind = ball_from(text, session.presets)
    return with_ball(answers, kind, named=kind in session.presets)


def _support(answers: Answers, text: str) -> Answers:
    known = distance_from(text)
    return replace(answers, support_height=None if known is None else known.value)


def _rest(answers: Answers, text: str) -> Answers:
    return replace(answers, rest_px=point_from(text, answers.scene.size))


def _distance(field: str) -> Changed:
    def changed(answers: Answers, text: str) -> Answers:
        known = distance_from(text)
        if field == "camera_distance":
            return replace(answers, camera_distance=known)
        return replace(answers, ball_plane_offset=known)

    return changed


PRESETS = tuple(
    BallKind(name, ball.diameter, ball.mass, PAPER_SUPPORT.height) for name, ball in BALLS.items()
)


class ClipOrCommand(DefaultCommandGroup):
    """A group whose first word may also be a clip: then the command `clip` is meant."""

    meant = "clip"
    spelled: ClassVar = {"--check": "check"}


_ClipArgument = Annotated[Path, typer.Argument(help="The clip.", metavar="CLIP")]
_FpsOption = Annotated[str | None, typer.Option(help="Capture rate.", metavar="RATE")]
_LensOption = Annotated[Path | None, typer.Option(help="A lens file.")]
_WallGridOption = Annotated[str | None, typer.Option(help="Side of a square.")]
_FineGridOption = Annotated[
    str | None, typer.Option(help="Fine lines apart, or none; a fifth of a square else.")
]
_OriginAtOption = Annotated[
    str | None, typer.Option(help="Where wall coordinates start, px.", metavar="X,Y")
]
_BallOption = Annotated[
    str | None, typer.Option(help="A preset, or '220 mm, 0.4 kg'.", metavar="NAME|DIAMETER")
]
_BallAtOption = Annotated[str | None, typer.Option(help="The ball at rest, px.", metavar="X,Y")]
_SupportHeightOption = Annotated[str | None, typer.Option(help="How far the ball falls.")]
_CameraDistanceOption = Annotated[
    str | None, typer.Option(help="Camera to wall by tape: '4.00 m ± 5 mm'.")
]
_BallPlaneOption = Annotated[
    str | None, typer.Option(help="Ball's plane to wall by tape: '0.45 m ± 5 mm'.")
]
_OutOption = Annotated[
    Path, typer.Option("--out", "-o", help="The setup file to write."), FileRole.WRITES
]
_TerminalOption = Annotated[bool, typer.Option("--terminal", help="Ask on the terminal.")]
_YesOption = Annotated[
    bool, typer.Option("--yes", "-y", help="Ask nothing: what is not said is found.")
]
_BrowserOption = Annotated[bool, typer.Option(help="Open the browser.")]
_PortOption = Annotated[int, typer.Option(help="Of the page; 0: one that is free.", min=0)]


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
    out: _OutOption = Path("setup.toml"),
    terminal: _TerminalOption = False,
    yes: _YesOption = False,
    browser: _BrowserOption = True,
    port: _PortOption = 0,
) -> None:
    """Calibrate a clip step by step, in the browser; writes setup.toml and lens.toml.

    Example: vision calibrate strike.mp4 --wall-grid 50mm --ball jokku --fps 600 --yes
    """
    _require_folder(out)
    session = session_of(
        clip,
        out,
        fps=fps,
        lens=lens,
        wall_grid=wall_grid,
        fine_grid=fine_grid,
        origin_at=origin_at,
        ball=ball,
        ball_at=ball_at,
        support_height=support_height,
        camera_distance=camera_distance,
        ball_plane=ball_plane,
    )
    if yes:
        _unattended(session)
    elif terminal:
        said = {
            "fps": fps,
            "lens": lens,
            "wall": wall_grid,
            "ball": ball,
            "support": support_height,
            "camera_distance": camera_distance,
            "ball_plane": ball_plane,
        }
        _on_terminal(session, frozenset(key for key, text in said.items() if text is not None))
    else:
        _in_browser(session, browser, port)


def session_of(
    clip: Path,
    out: Path,
    *,
    fps: str | None = None,
    lens: Path | None = None,
    wall_grid: str | None = None,
    fine_grid: str | None = None,
    origin_at: str | None = None,
    ball: str | None = None,
    ball_at: str | None = None,
    support_height: str | None = None,
    camera_distance: str | None = None,
    ball_plane: str | None = None,
) -> Session:
    """A calibration with what was said beforehand; the options of `vision calibrate CLIP`.

    Raises
    ------
    ClipError
        If the clip can't be read.
    UsageError
        If one of them can't be.
    """
    answers = Answers(look_at(clip), out=out)
    size = answers.scene.size
    if fps is not None:
        answers = replace(answers, fps=rate_from(fps))
    if lens is not None:
        answers = replace(answers, lens=lens_from_file(lens, size))
    if wall_grid is not None:
        pitch = pitch_from(wall_grid)
        answers = replace(answers, pitch=pitch, fine_pitch=pitch / 5)
    if fine_grid is not None:
        answers = replace(answers, fine_pitch=fine_pitch_from(fine_grid, answers.pitch))
    if origin_at is not None:
        answers = replace(answers, origin_px=point_from(origin_at, size))
    if ball is not None:
        kind = ball_from(ball, PRESETS)
        answers = with_ball(answers, kind, named=kind in PRESETS)
    if ball_at is not None:
        answers = replace(answers, rest_px=point_from(ball_at, size))
    for key, text in (("camera_distance", camera_distance), ("ball_plane_offset", ball_plane)):
        if text is not None:
            answers = replace(answers, **{key: distance_from(text)})  # type: ignore[arg-type]
    if support_height is not None:
        known = distance_from(support_height)
        answers = replace(answers, support_height=None if known is None else known.value)
    return Session(answers, PRESETS, _readable)


def old_view(against: Path) -> Path | None:
    """The lens file with the old view, where `against` is a setup or lens file; None for a clip.

    Raises
    ------
    SetupError
        If the setup file is wrong.
    """
    if against.suffix != ".toml" or against.is_dir():
        return None
    try:
        read_view(against)
    except UsageError:
        told = load_setup(against).camera.lens
        return told if told is not None else lens_for(against)
    return against


def _require_folder(out: Path) -> None:
    folder = out.parent
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise UsageError(
            f"can't write {out}: {folder} is no folder that can be written to",
            hint="Name a file in a folder that exists and that you may write to, with --out.",
        )


def _readable(text: str, folder: Path) -> None:
    read_setup(text, "the new setup file", folder=folder)


def _say(line: str) -> None:
    typer.echo(line, err=True)


def find_unattended(session: Session) -> str:
    """Find grid and ball with nobody asked; says what was not found.

    Raises
    ------
    CalibrationError
        If there is no wall grid.
    """
    session.find_grid()
    if session.answers.grid is None:
        raise CalibrationError(session.grid_problem, hint="Say --wall-grid, or leave --yes out.")
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


def _on_terminal(session: Session, given: frozenset[str]) -> None:
    if not sys.stdin.isatty() and not sys.stdin.readable():
        raise UsageError("there is no terminal to ask on", hint="Say all with options, and --yes.")

    def ask(question: str, default: str) -> str:
        try:
            return str(typer.prompt(question, default=default, show_default=bool(default)))
        except typer.Abort:
            raise KeyboardInterrupt from None

    ask_all(session, Dialogue(ask, typer.echo), given)
    out = session.answers.out
    doubt = f"{out} is there already. Replace it?" if out.exists() else f"Write {out}?"
    if ask(doubt, "yes").strip().lower() not in ("y", "yes"):
        raise UsageError(
            "nothing was written, as you say", hint="Give the command again to write it."
        )
    _write(session)


def _write(session: Session) -> None:
    written = session.save()
    for warning in session.outlook.warnings:
        _say(warning)
    if session.outlook.std is not None:
        typer.echo(told_of(session))
    typer.echo(f"wrote {written.setup} and {written.lens}")


def _in_browser(session: Session, browser: bool, port: int) -> None:
    # NiceGUI takes a second to import, which no other command shall wait for
    from pipelines.calibrate.wizard.page import serve
    from pipelines.web import Jobs

    jobs = Jobs()
    jobs.submit("looking for the wall grid", session.find_grid)
    if session.answers.rest_px is None:
        jobs.submit("following the ball", session.look_for_ball)

    def opened(address: str) -> None:
        shown = browser and _has_display() and webbrowser.open(address)
        typer.echo(f"The calibration is open at\n  {address}")
        if shown:
            typer.echo("Close its window when you are done; Ctrl-C ends it, too.")
        else:
            where = address.split("/")[2].rpartition(":")[2]
            typer.echo(
                "Open this address in a browser on this machine (it works once). From another "
                f"machine, first: ssh -L {where}:127.0.0.1:{where} THIS_MACHINE. Without any "
                "browser: --terminal. Ctrl-C ends it."
            )
        sys.stdout.flush()

    try:
        serve(session, jobs, opened, port=port)
    except KeyboardInterrupt:
        _leave(jobs, 130)
        raise
    if session.written is None:
        _say("the page was closed; nothing was saved")
    else:
        typer.echo(f"wrote {session.written.setup} and {session.written.lens}")
    _leave(jobs, 0)


def _leave(jobs: "Jobs", code: int) -> None:
    """End at once if something is still being worked out.

    Native code that goes on while the interpreter is taken down takes it down hard.
    """
    if jobs.busy:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _has_display() -> bool:
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


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
    data = path.read_bytes() if path.is_file() else b""
    picture = decoded_image(data, cv2.IMREAD_GRAYSCALE, path)
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
