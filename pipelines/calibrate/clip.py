"""`vision calibrate CLIP`: the wizard in the browser, on the terminal, or unattended."""

import os
import sys
import webbrowser
from dataclasses import replace
from pathlib import Path
from typing import Annotated, ClassVar

import typer

from metrology import CalibrationError, NotFoundError, UsageError
from physics.bodies import BALLS, PAPER_SUPPORT
from pipelines.calibrate.wizard.answers import (
    Answers,
    BallKind,
    ball_from,
    distance_from,
    fine_pitch_from,
    lens_from_file,
    pitch_from,
    point_from,
    rate_from,
)
from pipelines.calibrate.wizard.scene import look_at
from pipelines.calibrate.wizard.session import Session, lens_for, read_view, with_ball
from pipelines.calibrate.wizard.terminal import Dialogue, ask_all, told_of
from pipelines.command_group import DefaultCommandGroup
from pipelines.doors import FileRole
from pipelines.setup.file import load_setup, read_setup
from pipelines.web.guard import Jobs

__all__ = ["ClipOrCommand", "clip_command", "find_unattended", "old_view", "session_of"]

PRESETS = tuple(
    BallKind(name, ball.diameter, ball.mass, PAPER_SUPPORT.height) for name, ball in BALLS.items()
)


class ClipOrCommand(DefaultCommandGroup):
    """A group whose first word may also be a clip: then the command `clip` is meant."""

    meant = "clip"
    spelled: ClassVar = {"--check": "check"}


def clip_command(
    clip: Annotated[Path, typer.Argument(help="The clip.", metavar="CLIP")],
    fps: Annotated[str | None, typer.Option(help="Capture rate.", metavar="RATE")] = None,
    lens: Annotated[Path | None, typer.Option(help="A lens file.")] = None,
    wall_grid: Annotated[str | None, typer.Option(help="Side of a square.")] = None,
    fine_grid: Annotated[
        str | None, typer.Option(help="Fine lines apart, or none; a fifth of a square else.")
    ] = None,
    origin_at: Annotated[
        str | None, typer.Option(help="Where wall coordinates start, px.", metavar="X,Y")
    ] = None,
    ball: Annotated[
        str | None, typer.Option(help="A preset, or '220 mm, 0.4 kg'.", metavar="NAME|DIAMETER")
    ] = None,
    ball_at: Annotated[
        str | None, typer.Option(help="The ball at rest, px.", metavar="X,Y")
    ] = None,
    support_height: Annotated[str | None, typer.Option(help="How far the ball falls.")] = None,
    camera_distance: Annotated[
        str | None, typer.Option(help="Camera to wall by tape: '4.00 m ± 5 mm'.")
    ] = None,
    ball_plane: Annotated[
        str | None, typer.Option(help="Ball's plane to wall by tape: '0.45 m ± 5 mm'.")
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="The setup file to write."), FileRole.WRITES
    ] = Path("setup.toml"),
    terminal: Annotated[bool, typer.Option("--terminal", help="Ask on the terminal.")] = False,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Ask nothing: what is not said is found.")
    ] = False,
    browser: Annotated[bool, typer.Option(help="Open the browser.")] = True,
    port: Annotated[int, typer.Option(help="Of the page; 0: one that is free.", min=0)] = 0,
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
        raise UsageError("nothing was written, as you say")
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
    from pipelines.web.serving import serve

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


def _leave(jobs: Jobs, code: int) -> None:
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
