"""`vision render`: a synthetic clip of the experiment with its truth file."""

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, cast

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from calib.camera import Camera, rotation_matrix
from measuring.setup.file import Setup, setup_from
from metrology import UsageError, measurands, parse_quantity, read_number
from physics.bodies import PAPER_PENDULUM, PAPER_SUPPORT
from pipelines.doors import EffectOption, FileRole, NamedBallOption, SetupFileOption
from pipelines.model import (
    added_effects,
    choose_ball,
    experiment_of,
    start_angle,
)
from pipelines.terminal import screen
from sample_videos import Encoding, Physics, Scene, Shake, Shot, Truth, render_clip, strike
from sample_videos.render import SUFFIXES_OF
from sample_videos.shot import View, default_scene
from sample_videos.truth import truth_path

__all__ = ["RenderOptions", "parse_size", "planned_scene", "render_command"]

FACE_FRICTION = 0.08
"""Coulomb coefficient of face and ball (assumed: the struck ball rotates visibly)."""
LIFT = 0.25
"""Lift coefficient per spin ratio, relative to one (assumed: slow spin has less lift)."""
FRAMES_AFTER_LANDING = 14
"""Frames after landing (chosen: the touch-down is visible from both sides)."""
NOISE = {"none": 0.0, "low": 0.5, "good": 1.0, "high": 2.5, "dim": 4.0}
"""Noise relative to a well exposed sensor (assumed): none, a good industrial camera, a phone by
day, indoors, in dim light."""
VIEWS = ("landing", "impact", "oblique")


@dataclass(frozen=True)
class RenderOptions:
    """Options in addition to the setup. SI; None: from the setup, or the default.

    Attributes
    ----------
    backswing : float
        rad.
    size : (2,) tuple of int
        px.
    noise : float
        Relative to the noise of a well exposed sensor; 0 is noise-free.
    readout : float
        Rolling shutter from first to last row, s.
    effects : tuple of str
        Effects of the catalogue, in the format of `parse_effect`.
    dropped : tuple of int
        Captured frames that are missing in the file.
    shake : float
        Tremor of a hand-held camera, px.
    roll : float
        Clockwise roll of the camera, rad.
    """

    backswing: float = math.radians(120.0)
    ball: str | None = None
    size: tuple[int, int] = (432, 240)
    frames: int | None = None
    seed: int = 1
    fps: float | None = None
    shutter: float | None = None
    readout: float = 0.0
    container_fps: float = 30.0
    bitrate: float | None = None
    codec: str = "h264"
    view: str = "landing"
    noise: float = 1.0
    mirrored: bool = False
    effects: tuple[str, ...] = ()
    dropped: tuple[int, ...] = ()
    shake: float = 0.0
    roll: float = 0.0


def parse_size(text: str, low: int = 32, high: int = 4096) -> tuple[int, int]:
    """Width and height, px, from ``432x240``.

    Raises
    ------
    UsageError
        If it is not a size, or out of range.
    """
    found = re.fullmatch(r"\s*(\d{1,5})\s*[x×]\s*(\d{1,5})\s*", text)
    if found is None:
        raise UsageError(f"{text!r} is not an image size", hint="Write it as 432x240.")
    width, height = int(found[1]), int(found[2])
    if not low <= min(width, height) <= max(width, height) <= high:
        raise UsageError(
            f"image size {width} × {height} px", hint=f"Give {low} to {high} px each way."
        )
    return width, height


def planned_scene(setup: Setup, options: RenderOptions) -> tuple[Scene, Shot]:
    """Scene and stroke for a setup and options.

    Raises
    ------
    UsageError
        For invalid options, DomainError for impossible physics.
    """
    if options.view not in VIEWS:
        raise UsageError(f"there is no view {options.view!r}", hint=f"One of {', '.join(VIEWS)}.")
    if options.codec not in SUFFIXES_OF:
        raise UsageError(
            f"there is no codec {options.codec!r}", hint=f"One of {', '.join(SUFFIXES_OF)}."
        )
    scene = _scene(setup, options, 2.6)
    shot = strike(scene, _physics(setup, options))
    landing = float(shot.flight.landing_position[0])
    # the stroke does not depend on the camera: place it once the landing is known
    scene = _scene(setup, options, landing)
    span = shot.landing_time - scene.shutter.first
    count = math.ceil(span * scene.shutter.fps) + FRAMES_AFTER_LANDING
    return replace(scene, frames=options.frames or count), shot


def _physics(setup: Setup, options: RenderOptions) -> Physics:
    experiment = experiment_of(setup, choose_ball(setup, options.ball))
    effects = added_effects(setup, options.effects)
    if contact := [added.effect.id for added in effects if added.alters_contact]:
        raise UsageError(
            f"the effect {contact[0]!r} changes the outcome of the contact, which no film shows",
            hint="Set the ball's cor, or use an effect of the swing or the flight.",
        )
    return Physics(
        start_angle(options.backswing, effects),
        gravity=experiment.gravity,
        air=experiment.air,
        drag_coefficient=experiment.drag_coefficient,
        lift_coefficient=LIFT,
        face_friction=FACE_FRICTION,
        effects=effects,
    )


def _scene(setup: Setup, options: RenderOptions, landing_x: float) -> Scene:
    camera, wall = setup.camera, setup.wall
    distance = camera.distance_to_wall
    plane = wall.ball_plane_offset
    foot = camera.principal_point_on_wall
    scene = default_scene(
        ball=choose_ball(setup, options.ball),
        size=options.size,
        reach=landing_x,
        view=cast(View, options.view),
        distance=None if distance is None else distance[0],
        foot=None if foot is None else (foot[0][0], foot[1][0]),
        plane=0.45 if plane is None else plane[0],
        pendulum=setup.pendulum or PAPER_PENDULUM,
        support=setup.support or PAPER_SUPPORT,
        seed=options.seed,
    )
    fps = options.fps or camera.capture_fps or scene.shutter.fps
    exposure = options.shutter or camera.shutter or min(scene.shutter.exposure, 0.6 / fps)
    first = scene.shutter.first * scene.shutter.fps / fps
    painted = replace(scene.room.wall, pitch=wall.grid or scene.room.wall.pitch)
    if wall.fine_grid is not None:
        painted = replace(painted, fine_pitch=wall.fine_grid)
    codec = cast(Literal["h264", "mjpeg", "ffv1", "png"], options.codec)
    rate = options.bitrate or scene.encoding.bitrate
    sensor = scene.sensor
    if options.noise == 0.0:
        sensor = replace(sensor, full_well=0.0)
    else:
        well = sensor.full_well / options.noise**2
        sensor = replace(sensor, full_well=well, read_noise=sensor.read_noise / options.noise)
    return replace(
        scene,
        shutter=replace(
            scene.shutter, fps=fps, exposure=exposure, readout=options.readout, first=first
        ),
        encoding=Encoding(
            codec, rate, container_fps=options.container_fps, dropped=options.dropped
        ),
        shake=Shake(amplitude=options.shake),
        camera=_rolled(scene.camera, options.roll),
        room=replace(scene.room, wall=painted),
        sensor=sensor,
        mirrored=options.mirrored,
    )


def _rolled(camera: Camera, roll: float) -> Camera:
    turn = rotation_matrix([0.0, 0.0, -roll])
    return replace(camera, rotation=turn @ camera.rotation)


def _filmed(scene: Scene, shot: Shot, out: Path, quiet: bool) -> Truth:
    console = screen(errors=True)
    columns = (TextColumn("rendering"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    hidden = quiet or not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=hidden) as bar:
        task = bar.add_task("", total=scene.frames)
        return render_clip(
            scene, shot, out, progress=lambda done, _: bar.update(task, completed=done)
        )


_OutOption = Annotated[
    Path,
    typer.Option("--out", "-o", help="Clip to write, with the ending of the codec."),
    FileRole.WRITES,
]
_BackswingOption = Annotated[
    str, typer.Option(help="Back-swing angle, such as '90 deg'.", metavar="ANGLE")
]
_SizeOption = Annotated[str, typer.Option(help="Image size, px.", metavar="WxH")]
_FramesOption = Annotated[
    int | None, typer.Option(help="Number of frames; default: until after landing.", min=1)
]
_SeedOption = Annotated[int, typer.Option(help="Random seed of noise and shake.", min=0)]
_FpsOption = Annotated[
    str | None, typer.Option(help="Capture rate; default 600 fps.", metavar="RATE")
]
_ShutterOption = Annotated[
    str | None, typer.Option(help="Exposure time, such as '1/2000 s'.", metavar="TIME")
]
_ReadoutOption = Annotated[
    str, typer.Option(help="Rolling shutter, first row to last.", metavar="TIME")
]
_ContainerFpsOption = Annotated[float, typer.Option(help="Frame rate stated in the file.")]
_BitrateOption = Annotated[
    float | None, typer.Option(help="kbit/s of played time.", metavar="KBIT")
]
_CodecOption = Annotated[str, typer.Option(help="h264, mjpeg, ffv1 (lossless) or png.")]
_ViewOption = Annotated[str, typer.Option(help="landing, impact or oblique.")]
_NoiseOption = Annotated[str, typer.Option(help="none, low, good, high, dim.")]
_DropOption = Annotated[
    list[int] | None, typer.Option(help="Captured frame to drop; repeatable.", min=0)
]
_ShakeOption = Annotated[float, typer.Option(help="Tremor of a hand-held camera, px.", min=0.0)]
_RollOption = Annotated[str, typer.Option(help="Clockwise roll of the camera.")]
_MirroredOption = Annotated[bool, typer.Option(help="The ball is struck to the left.")]
_QuietOption = Annotated[bool, typer.Option("--quiet", help="Print nothing.")]


def render_command(
    out: _OutOption,
    setup: SetupFileOption = None,
    ball: NamedBallOption = None,
    backswing: _BackswingOption = "120 deg",
    size: _SizeOption = "432x240",
    frames: _FramesOption = None,
    seed: _SeedOption = 1,
    fps: _FpsOption = None,
    shutter: _ShutterOption = None,
    readout: _ReadoutOption = "0 s",
    container_fps: _ContainerFpsOption = 30.0,
    bitrate: _BitrateOption = None,
    codec: _CodecOption = "h264",
    view: _ViewOption = "landing",
    noise: _NoiseOption = "good",
    effect: EffectOption = None,
    drop: _DropOption = None,
    shake: _ShakeOption = 0.0,
    roll: _RollOption = "0 deg",
    mirrored: _MirroredOption = False,
    quiet: _QuietOption = False,
) -> None:
    """Render a synthetic clip with its truth file.

    Example: vision render --setup lab.toml --backswing "90 deg" --seed 7 -o clip.mp4
    """
    if noise not in NOISE:
        raise UsageError(f"--noise {noise!r} is unknown", hint=f"One of {', '.join(NOISE)}.")
    if bitrate is not None and not bitrate > 0:
        raise UsageError(
            f"--bitrate {bitrate:g} is not positive", hint="Give it in kbit/s, such as 2000."
        )
    options = RenderOptions(
        backswing=read_number(backswing, measurands.BACKSWING, "--backswing"),
        ball=ball,
        size=parse_size(size),
        frames=frames,
        seed=seed,
        fps=None if fps is None else read_number(fps, measurands.CAPTURE_RATE, "--fps"),
        shutter=None if shutter is None else read_number(shutter, measurands.SHUTTER, "--shutter"),
        readout=parse_quantity(readout, "s"),
        container_fps=container_fps,
        bitrate=None if bitrate is None else 1000.0 * bitrate,
        codec=codec,
        view=view,
        noise=NOISE[noise],
        mirrored=mirrored,
        effects=tuple(effect or ()),
        dropped=tuple(drop or ()),
        shake=shake,
        roll=read_number(roll, measurands.BACKSWING, "--roll"),
    )
    if not out.absolute().parent.is_dir():
        raise UsageError(
            f"can't write {out}: there is no folder {out.parent}",
            hint="Make the folder first, or pass another as --out.",
        )
    scene, shot = planned_scene(setup_from(setup), options)
    _filmed(scene, shot, out, quiet)
    if not quiet:
        typer.echo(f"{out}\n{truth_path(out)}")
