"""`vision calibrate plan`: predict the uncertainties of a planned recording.

The stroke is simulated and its tracks are those that tracking would give. The camera is fitted to
the grid as it would be seen; from there the measuring chain computes all budgets.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from string import ascii_lowercase
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table

from calib.calibration import Calibration
from calib.camera import Lens
from calib.lens import LensPrior, read_lens
from calib.solve import (
    BALL_ERROR_PX,
    MASS_ERROR_PX,
    PictureNoise,
    SeenFall,
    board_lens,
    edge_std,
    lens_of_view,
    planned_grid,
    solve,
)
from measuring.budget import ClipConditions as Known
from measuring.budget import (
    derived_values,
    random_covariance,
    systematic_budget,
    values_after_move,
)
from measuring.gravity import seen_fall
from measuring.impact import find_impact
from measuring.inputs import gather_inputs
from measuring.metres import CameraMapping, scene_evidence, tracks_in_metres
from measuring.results import Evaluated, NoScale, results_of
from measuring.setup.file import BallSetup, CameraSetup, Setup, WallSetup, setup_from
from metrology import (
    Defaults,
    MeasurementError,
    Quantity,
    UsageError,
    measurands,
    parse_quantity,
    read_number,
)
from physics.bodies import JOKKU, PAPER_PENDULUM, PAPER_SUPPORT, Ball, Pendulum, Support
from pipelines.doors import NamedBallOption, NoTableOption, ResultsJsonOption
from pipelines.model import (
    choose_ball,
    quantities_document,
)
from pipelines.render import parse_size
from pipelines.terminal import screen, write_json
from sample_videos.bodies import pivot, swing_rotation
from sample_videos.scene import Scene, Sensor
from sample_videos.shot import Shot, default_scene, staged
from vision.clip.footage import CaptureRate, RateSource, nominal_rate_std
from vision.tracks import Face, Motion, MotionKind, PendulumTrack, Track, Tracks

__all__ = [
    "Filming",
    "PlannedRecording",
    "compare_changes",
    "film_scene",
    "plan_filming_command",
    "planned_setup",
    "planned_tracks",
    "predict_recording",
]

FloatArray = NDArray[np.float64]

BoolArray = NDArray[np.bool_]

FILMED_BEFORE_S = 0.084
"""s: start of a planned clip before contact: 50 frames at 600 fps, the length of a swing fit."""

PLANNED_FACE_STD_PX = 0.2
"""px: standard uncertainty of a tracked edge of the face (assumed)."""

_EDGE = 1.0


@dataclass(frozen=True)
class Filming:
    """Conditions of a recording.

    Attributes
    ----------
    width, height : int
        px.
    fps : float
        Capture rate, 1/s.
    exposure_s : float
        Exposure time.
    distance_m : float
        Camera to wall.
    plane_m : float
        Ball plane in front of the wall.
    view_rad : float or None
        Horizontal angle of view; None: just includes pendulum and landing.
    light : float
        1 if the wall is well exposed at 1/1000 s without gain.
    gray_std : float or None
        Image noise in gray levels of 255, instead of `light`.
    tape_std_m : float or None
        Standard uncertainty of distances measured by hand; None if none is measured.
    lens : LensPrior or None
        A calibrated lens; its view applies, and its image has `width` and `height`.
    seed : int
        Seed of the small rotations of a camera placed by eye, and of rendered noise.
    """

    ball: Ball = JOKKU
    backswing_deg: float = 90.0
    width: int = 640
    height: int = 360
    fps: float = 600.0
    exposure_s: float = 1e-3
    distance_m: float = 4.0
    plane_m: float = 0.45
    view_rad: float | None = None
    light: float = 1.0
    gray_std: float | None = None
    tape_std_m: float | None = 0.005
    lens: LensPrior | None = None
    pendulum: Pendulum = PAPER_PENDULUM
    support: Support = PAPER_SUPPORT
    seed: int = 1

    @property
    def noise(self) -> PictureNoise:
        """Image noise."""
        by_light = PictureNoise.by_light(self.light, self.exposure_s)
        return by_light if self.gray_std is None else replace(by_light, gray_std=self.gray_std)


def film_scene(filming: Filming) -> tuple[Scene, Shot]:
    """The scene as seen by the camera, and the stroke.

    Raises
    ------
    DomainError, UsageError
        If the stroke is impossible, or can't be filmed under these conditions.
    """

    def scene_until(landing_x: float) -> Scene:
        scene = default_scene(
            ball=filming.ball,
            size=(filming.width, filming.height),
            reach=landing_x,
            distance=filming.distance_m,
            plane=filming.plane_m,
            pendulum=filming.pendulum,
            support=filming.support,
            seed=filming.seed,
        )
        first = -(math.floor(FILMED_BEFORE_S * filming.fps) + 0.37) / filming.fps
        shutter = replace(scene.shutter, fps=filming.fps, exposure=filming.exposure_s, first=first)
        return replace(scene, shutter=shutter, sensor=_sensor(filming))

    _, shot = staged(filming.backswing_deg, scene_until(2.0))
    scene = scene_until(float(shot.flight.landing_position[0]))
    camera = scene.camera
    if filming.lens is not None:
        scene = replace(scene, camera=replace(camera, lens=filming.lens.lens))
    elif filming.view_rad is not None:
        lens = lens_of_view(filming.width, filming.height, filming.view_rad)
        scene = replace(scene, camera=replace(camera, lens=replace(lens, k1=camera.lens.k1)))
    return staged(filming.backswing_deg, scene, after=max(4, int(0.02 * filming.fps)))


def _sensor(filming: Filming) -> Sensor:
    """Sensor with that noise: with little light, gain lowers its saturation capacity."""
    usual = Sensor()
    if filming.gray_std is None:
        share = min(filming.light * filming.exposure_s / 1e-3, 1.0)
        return replace(usual, full_well=usual.full_well * share)
    low, high = 1e-4, 1e3
    for _ in range(60):
        share = math.sqrt(low * high)
        noisier = PictureNoise.by_light(share, 1e-3).gray_std > filming.gray_std
        low, high = (share, high) if noisier else (low, share)
    return replace(usual, full_well=usual.full_well * low)


def planned_tracks(filming: Filming, scene: Scene, shot: Shot) -> Tracks:
    """Tracks expected from the clip: true positions with their uncertainties."""
    shutter, camera = scene.shutter, scene.camera
    time = shutter.first + np.arange(scene.frames) / shutter.fps
    moment = shot.motion.at(time)
    centre, radius = camera.sphere_outline(moment.ball, scene.ball.radius)
    ball = _track(filming, shutter.fps, centre, radius, BALL_ERROR_PX)
    ball = ball.where(_inside(ball, camera.lens.width, camera.lens.height))
    resting = np.flatnonzero(time < 0.0)
    rest = None if len(resting) == 0 else (0, int(resting[-1]))
    return Tracks(
        ball=ball,
        pendulum=_pendulum(filming, scene, moment.phi, len(resting)),
        background=np.zeros((camera.lens.height, camera.lens.width), dtype=np.float32),
        rest_frames=rest,
        motion=Motion(MotionKind.STRIKE, 1.0),
    )


def _track(
    filming: Filming, fps: float, centre: FloatArray, radius: FloatArray, own: float
) -> Track:
    way = np.hypot(*np.gradient(centre, axis=0).T) * fps * filming.exposure_s
    std = edge_std(filming.noise, radius, way, own)
    bound = edge_std(filming.noise, radius, way, 0.0)
    plane = np.eye(2)
    return Track(
        frame=np.arange(len(centre)),
        time_s=np.arange(len(centre)) / fps,
        centre_px=centre,
        covariance_px2=std[:, None, None] ** 2 * plane,
        bound_px2=bound[:, None, None] ** 2 * plane,
        radius_px=radius,
        radius_std_px=std,
        quality=np.ones(len(centre)),
    )


def _inside(track: Track, width: int, height: int) -> BoolArray:
    """Rows in which the whole outline is inside the image."""
    margin = track.radius_px[:, np.newaxis] + _EDGE
    within = (track.centre_px > margin) & (track.centre_px < [width, height] - margin)
    return np.asarray(within.all(axis=1))


def _pendulum(
    filming: Filming, scene: Scene, phi: FloatArray, touching: int
) -> PendulumTrack | None:
    """Track of the striking mass, as far as it is inside the image; None if it never is."""
    camera, body, block = scene.camera, scene.pendulum, scene.room.block
    hub = pivot(scene)
    hanging = np.array([body.face_offset - 0.5 * block[0], -body.length, 0.0])
    centre = camera.project(hub + swing_rotation(phi) @ hanging)
    scale = camera.lens.fx / (camera.position[2] - scene.room.plane)
    size = np.full(len(phi), 0.5 * math.sqrt(block[0] * block[1]) * scale)
    track = _track(filming, scene.shutter.fps, centre, size, MASS_ERROR_PX)
    track = track.where(_inside(track, camera.lens.width, camera.lens.height))
    if len(track) == 0:
        return None
    hub_px = camera.project(hub)
    offset = track.centre_px - hub_px
    arm = float(np.median(np.hypot(*offset.T)))
    std = np.sqrt(track.covariance_px2[:, 0, 0])
    return PendulumTrack(
        track=track,
        angle_rad=np.arctan2(offset[:, 0], offset[:, 1]),
        angle_std_rad=std / arm,
        pivot_px=hub_px,
        pivot_covariance_px2=0.04 * np.eye(2),
        arm_px=arm,
        face=_face(scene, hub, phi, int(track.frame[track.frame <= touching].max(initial=0))),
    )


def _face(scene: Scene, hub: FloatArray, phi: FloatArray, frame: int) -> Face:
    """The face in a frame: its centre and its visible rim."""
    body, half = scene.pendulum, 0.5 * scene.room.block[2]
    turn = swing_rotation(phi[frame])
    middle, near, far = (
        scene.camera.project(hub + turn @ np.array([body.face_offset, -body.length, depth]))
        for depth in (0.0, half, -half)
    )
    if near[0] > far[0]:
        return Face(frame, near, PLANNED_FACE_STD_PX)
    return Face(frame, far, PLANNED_FACE_STD_PX, middle, PLANNED_FACE_STD_PX)


MIN_GRID_PITCH_PX, MIN_OUTLINE_RADIUS_PX = 3.6, 5.0
"""px: smallest squares that the grid search finds reliably (from rendered walls), and smallest ball
radius with a reliable outline fit (assumed)."""

CLOSER_TAPE_STD_M = 0.002
"""m: uncertainty of a length of metres read twice by two people (assumed)."""


@dataclass(frozen=True)
class PlannedRecording:
    """Predicted results of a recording.

    Attributes
    ----------
    quantities : tuple of Quantity
        In the order of the contract; values are those of the simulated stroke.
    metres_per_px : float
        On the ball plane, at the ball at rest.
    lens : Lens
        Of the camera.
    """

    filming: Filming
    quantities: tuple[Quantity, ...]
    metres_per_px: float
    lens: Lens
    warnings: tuple[str, ...]

    def std(self, name: str) -> float | None:
        """Standard uncertainty of a quantity; None where it can't be measured."""
        return next(one.std for one in self.quantities if one.name == name)


@dataclass(frozen=True)
class FilmingChange:
    """A change of the filming conditions and its effect.

    Attributes
    ----------
    gain : float
        Reduction of the uncertainties: geometric mean of old over new, over the quantities
        measurable in both cases.
    opens, closes : tuple of str
        Quantities that become measurable, and those that are lost.
    """

    words: str
    predicted: PlannedRecording
    gain: float
    opens: tuple[str, ...]
    closes: tuple[str, ...]

    def ratio(self, before: PlannedRecording, name: str) -> float | None:
        """New over old uncertainty of a quantity; None if one of them is missing."""
        old, new = before.std(name), self.predicted.std(name)
        return new / old if new is not None and old else None


def planned_setup(filming: Filming, scene: Scene) -> Setup:
    """The lab's setup file for these conditions."""
    ball, tape = scene.ball, filming.tape_std_m
    distance = float(scene.camera.position[2])
    return Setup(
        camera=CameraSetup(filming.fps, None if tape is None else (distance, tape)),
        wall=WallSetup(
            scene.room.wall.pitch,
            scene.room.wall.fine_pitch,
            None if tape is None else (scene.room.plane, tape),
        ),
        ball=BallSetup(ball.name, ball.diameter, ball.mass, ball.launch_angle, ball.cor),
        pendulum=scene.pendulum,
        support=scene.support,
    )


def predict_recording(filming: Filming) -> PlannedRecording:
    """Predict the uncertainty of every quantity of a planned recording.

    Raises
    ------
    CalibrationError
        If the wall's grid would not be visible well enough.
    DomainError, UsageError
        If the stroke is impossible, or can't be filmed under these conditions.
    """
    scene, shot = film_scene(filming)
    tracks = planned_tracks(filming, scene, shot)
    inputs = gather_inputs(planned_setup(filming, scene), None, None)
    rate = CaptureRate(filming.fps, nominal_rate_std(filming.fps), RateSource.SETUP)
    calibration = _calibrated(filming, scene, tracks, Known(inputs, rate, None))
    known = Known(inputs, rate, calibration)
    results = results_of(_evaluated(known, tracks, scene), tracks, NoScale(""))
    lens = scene.camera.lens
    scale = float(scene.camera.position[2] - scene.room.plane) / lens.fx
    return PlannedRecording(filming, results.quantities, scale, lens, _warnings(scene, scale))


def _warnings(scene: Scene, metres_per_px: float) -> tuple[str, ...]:
    warnings = []
    pitch = scene.room.wall.pitch * (scene.camera.lens.fx / float(scene.camera.position[2]))
    if pitch < MIN_GRID_PITCH_PX:
        warnings.append(
            f"the lines of the wall are only {pitch:.1f} px apart; below {MIN_GRID_PITCH_PX} px "
            "the grid may not be found. Film with more pixels or from nearer"
        )
    radius = scene.ball.radius / metres_per_px
    if radius < MIN_OUTLINE_RADIUS_PX:
        warnings.append(f"the ball has a diameter of only {2 * radius:.0f} px; film from nearer")
    return tuple(warnings)


def _times(known: Known, scene: Scene) -> FloatArray:
    return np.arange(scene.frames) / known.rate.fps


def _calibrated(filming: Filming, scene: Scene, tracks: Tracks, known: Known) -> Calibration:
    def see_fall(calibration: Calibration) -> SeenFall | None:
        return seen_fall(replace(known, calibration=calibration), tracks, _times(known, scene))

    grid = planned_grid(scene.camera, scene.room.wall.pitch)
    evidence = scene_evidence(tracks, known.inputs)
    return solve(grid, evidence, lens=filming.lens, see_fall=see_fall).calibration


def _evaluated(known: Known, tracks: Tracks, scene: Scene) -> Evaluated:
    inputs, calibration = known.inputs, known.calibration
    assert calibration is not None
    nothing = Evaluated(known, None, None, np.zeros(0), np.zeros((0, 0)), {}, "")
    try:
        metric = tracks_in_metres(tracks, CameraMapping(calibration), _times(known, scene))
        impact = find_impact(metric, inputs)
    except MeasurementError as problem:
        return replace(nothing, refusal=problem.message)

    def values(moved: Known) -> FloatArray:
        assert moved.calibration is not None
        again = tracks_in_metres(tracks, CameraMapping(moved.calibration), _times(moved, scene))
        return values_after_move(impact, again, moved.inputs)

    return Evaluated(
        known,
        metric,
        impact,
        derived_values(impact, inputs),
        random_covariance(impact, inputs),
        systematic_budget(known, values, np.inf),
        "",
    )


def compare_changes(
    before: PlannedRecording, progress: Callable[[str], None] | None = None
) -> tuple[FilmingChange, ...]:
    """Effects of changed conditions, the most helpful first.

    A change that can't be filmed (no grid, exposure longer than a frame) is omitted.
    """
    changes = []
    for words, filming in _tried(before):
        if progress is not None:
            progress(words)
        try:
            after = predict_recording(filming)
        except MeasurementError:
            continue
        changes.append(_compared(words, before, after))
    return tuple(sorted(changes, key=lambda c: (len(c.closes) - len(c.opens), -c.gain)))


def _tried(before: PlannedRecording) -> list[tuple[str, Filming]]:
    f = before.filming
    lens = before.lens
    tried: list[tuple[str, Filming]] = []
    if f.tape_std_m is None:
        taped = replace(f, tape_std_m=Defaults.TAPE.std)
        tried.append(("measure camera distance and ball plane (± 5 mm)", taped))
    elif f.tape_std_m > CLOSER_TAPE_STD_M:
        closer = replace(f, tape_std_m=CLOSER_TAPE_STD_M)
        tried.append(("measure both distances to ± 2 mm", closer))
    if f.lens is None:
        tried.append(("calibrate the lens with a board", replace(f, lens=board_lens(lens))))
        farther = replace(f, distance_m=1.5 * f.distance_m, view_rad=_zoomed(before))
        tried.append(("1.5 × the distance, zoomed in", farther))
    width, height = f.width * 3 // 2, f.height * 3 // 2
    finer = None if f.lens is None else f.lens.resized(width, height)
    return [
        *tried,
        ("0.8 × the distance", replace(f, distance_m=0.8 * f.distance_m, view_rad=_view(lens))),
        ("2 × the frame rate", replace(f, fps=2 * f.fps, exposure_s=_shutter(f, 2 * f.fps))),
        ("4 × the light", replace(f, light=4 * f.light, gray_std=_halved(f.gray_std))),
        ("0.5 × the exposure time", replace(f, exposure_s=0.5 * f.exposure_s)),
        ("1.5 × the pixels each way", replace(f, width=width, height=height, lens=finer)),
    ]


def _view(lens: Lens) -> float:
    """Horizontal angle of view, rad."""
    return 2.0 * math.atan(0.5 * (lens.width - 1) / lens.fx)


def _zoomed(before: PlannedRecording) -> float:
    """Angle of view that shows as much of the ball plane from 1.5 × the distance."""
    f = before.filming
    share = (f.distance_m - f.plane_m) / (1.5 * f.distance_m - f.plane_m)
    return 2.0 * math.atan(share * math.tan(0.5 * _view(before.lens)))


def _shutter(filming: Filming, fps: float) -> float:
    return min(filming.exposure_s, 1.0 / fps)


def _halved(value: float | None) -> float | None:
    return None if value is None else 0.5 * value


def _compared(words: str, before: PlannedRecording, after: PlannedRecording) -> FilmingChange:
    names = [one.name for one in before.quantities]
    old = {name: before.std(name) for name in names}
    new = {name: after.std(name) for name in names}
    both = [name for name in names if old[name] and new[name]]
    logs = [math.log(float(old[n] or 1.0) / float(new[n] or 1.0)) for n in both]
    return FilmingChange(
        words,
        after,
        math.exp(float(np.mean(logs))) if logs else 1.0,
        tuple(name for name in names if old[name] is None and new[name] is not None),
        tuple(name for name in names if old[name] is not None and new[name] is None),
    )


FILM_WIDTH_M = 0.036
"""m: width of 35 mm film (ISO 1007), the reference of equivalent focal lengths."""

TABLE_QUANTITIES = {
    "contact_time": "Δt",
    "ball_speed": "speed",
    "launch_angle": "angle",
    "landing_distance": "landing",
    "cor": "COR",
}

MIN_GAIN_FACTOR = 1.03
"""Smallest improvement that is reported: less than 3 % is irrelevant (chosen)."""


_ResolutionOption = Annotated[str, typer.Option(help="Image size, px.", metavar="WxH")]
_DistanceOption = Annotated[str, typer.Option(help="Distance camera to wall.")]
_FieldOfViewOption = Annotated[
    str | None,
    typer.Option(help="Horizontal; default: just includes pendulum and landing."),
]
_FocalLengthOption = Annotated[
    str | None, typer.Option(help="Instead: 35 mm equivalent, such as 28mm.")
]
_LensOption = Annotated[Path | None, typer.Option(help="Lens file from `vision calibrate lens`.")]
_FpsOption = Annotated[str, typer.Option(help="Capture rate.")]
_ShutterOption = Annotated[str, typer.Option(help="Exposure time.")]
_LightOption = Annotated[
    float,
    typer.Option(help="1: wall well exposed at 1/1000 s without gain; a gymnasium has 0.1."),
]
_NoiseOption = Annotated[
    float | None,
    typer.Option(help="Instead: pixel noise on the wall, gray levels of 255."),
]
_BackswingOption = Annotated[str, typer.Option(help="Release angle of the pendulum.")]
_BallPlaneOption = Annotated[str, typer.Option(help="Distance of the ball plane from the wall.")]
_TapeOption = Annotated[
    str, typer.Option(help="Standard uncertainty of both measured distances, or none.")
]
_SetupOption = Annotated[
    Path | None, typer.Option(help="Setup file (TOML): ball, pendulum, support.")
]
_ChangesOption = Annotated[
    bool, typer.Option("--changes/--no-changes", help="Compare changed conditions.")
]


def plan_filming_command(
    resolution: _ResolutionOption = "640x360",
    distance: _DistanceOption = "4 m",
    field_of_view: _FieldOfViewOption = None,
    focal_length: _FocalLengthOption = None,
    lens: _LensOption = None,
    fps: _FpsOption = "600 fps",
    shutter: _ShutterOption = "1/1000 s",
    light: _LightOption = 1.0,
    noise: _NoiseOption = None,
    ball: NamedBallOption = None,
    backswing: _BackswingOption = "90 deg",
    ball_plane: _BallPlaneOption = "0.45 m",
    tape: _TapeOption = "5 mm",
    setup: _SetupOption = None,
    changes: _ChangesOption = True,
    json_to: ResultsJsonOption = None,
    quiet: NoTableOption = False,
) -> None:
    """Predict the uncertainty of every quantity before filming, and which change helps most.

    Example: vision calibrate plan --resolution 1280x720 --fps 240 --distance 3.5m --tape none
    """
    known = setup_from(setup)
    width, height = parse_size(resolution, 64, 8192)
    filming = Filming(
        ball=choose_ball(known, ball),
        backswing_deg=math.degrees(read_number(backswing, measurands.BACKSWING, "--backswing")),
        width=width,
        height=height,
        fps=read_number(fps, measurands.CAPTURE_RATE, "--fps"),
        exposure_s=read_number(shutter, measurands.SHUTTER, "--shutter"),
        distance_m=read_number(distance, measurands.CAMERA_DISTANCE, "--distance"),
        plane_m=read_number(ball_plane, measurands.BALL_PLANE_OFFSET, "--ball-plane"),
        view_rad=_view_asked(field_of_view, focal_length),
        light=_positive("--light", light),
        gray_std=None if noise is None else _positive("--noise", noise),
        tape_std_m=None if tape == "none" else _positive("--tape", parse_quantity(tape, "m")),
        lens=None if lens is None else read_lens(lens, width=width, height=height),
        pendulum=known.pendulum or PAPER_PENDULUM,
        support=known.support or PAPER_SUPPORT,
    )
    errors = screen(errors=True)
    predicted = predict_recording(filming)
    tried: tuple[FilmingChange, ...] = ()
    if changes:
        with errors.status("") as status:
            tried = compare_changes(predicted, lambda words: status.update(f"trying: {words}"))
    if not write_json(_document(predicted, tried), json_to) and not quiet:
        _print(screen(), predicted, tried)
    if not quiet:
        for warning in predicted.warnings:
            errors.print(f"warning: {warning}", soft_wrap=True)


def _positive(option: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0.0):
        raise UsageError(f"{option} {value:g} is not positive", hint="Give a positive number.")
    return value


def _view_asked(field_of_view: str | None, focal_length: str | None) -> float | None:
    if field_of_view is not None and focal_length is not None:
        raise UsageError("both field of view and focal length are given", hint="Give one of them.")
    if focal_length is not None:
        focal = _positive("--focal-length", parse_quantity(focal_length, "m"))
        return 2.0 * math.atan(0.5 * FILM_WIDTH_M / focal)
    if field_of_view is None:
        return None
    return read_number(field_of_view, measurands.FIELD_OF_VIEW, "--field-of-view")


def _document(predicted: PlannedRecording, tried: tuple[FilmingChange, ...]) -> dict[str, Any]:
    extra: dict[str, Any] = {
        "metres_per_px": predicted.metres_per_px,
        "field_of_view_deg": _degrees(predicted),
        "noise_gray_levels": predicted.filming.noise.gray_std,
        "changes": [_change(change) for change in tried],
    }
    return quantities_document(predicted.quantities, predicted.warnings, **extra)


def _change(change: FilmingChange) -> dict[str, Any]:
    return {
        "change": change.words,
        "gain": change.gain,
        "opens": list(change.opens),
        "closes": list(change.closes),
        "quantities": quantities_document(change.predicted.quantities, ())["quantities"],
    }


def _degrees(predicted: PlannedRecording) -> float:
    return math.degrees(2.0 * math.atan(0.5 * (predicted.lens.width - 1) / predicted.lens.fx))


def _print(console: Console, predicted: PlannedRecording, tried: tuple[FilmingChange, ...]) -> None:
    f = predicted.filming
    console.print(
        f"{f.ball.name}, {f.backswing_deg:g} deg, filmed with {f.width} × {f.height} px at "
        f"{f.fps:g} fps from {f.distance_m:g} m: {1e3 * predicted.metres_per_px:.1f} mm per px, "
        f"{_degrees(predicted):.0f} deg of view",
    )
    keys = dict(zip((change.words for change in tried), ascii_lowercase, strict=False))
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("quantity", "about", "expected ±", "unit", "helps most"):
        right = heading in ("about", "expected ±")
        table.add_column(heading, justify="right" if right else "left", no_wrap=True)
    for quantity in predicted.quantities:
        table.add_row(*_row(quantity, predicted, tried, keys))
    console.print(table)
    for reason in dict.fromkeys(one.reason for one in predicted.quantities if one.reason):
        names = ", ".join(one.name for one in predicted.quantities if one.reason == reason)
        console.print(f"– {names}: {reason}")
    if tried:
        _print_changes(console, predicted, tried, keys)


def _row(
    quantity: Quantity,
    predicted: PlannedRecording,
    tried: tuple[FilmingChange, ...],
    keys: dict[str, str],
) -> list[str]:
    name = quantity.name
    if quantity.value is None or quantity.std is None:
        opener = next((keys[change.words] for change in tried if name in change.opens), "")
        return [name, "–", "", quantity.unit, opener and f"{opener} makes it measurable"]
    ratios = [(change.ratio(predicted, name) or 1.0, change.words) for change in tried]
    ratio, words = min(ratios, default=(1.0, ""))
    digits = min(max(1 - math.floor(math.log10(quantity.std)), 0), 8)
    return [
        name,
        f"{quantity.value:.{digits}f}",
        f"{quantity.std:.{digits}f}",
        quantity.unit,
        f"{keys[words]} × {ratio:.2f}" if ratio < 1.0 / MIN_GAIN_FACTOR else "",
    ]


def _print_changes(
    console: Console,
    predicted: PlannedRecording,
    tried: tuple[FilmingChange, ...],
    keys: dict[str, str],
) -> None:
    table = Table(title="Changes: new ± over old", box=box.SIMPLE_HEAD)
    for heading in ("", "change"):
        table.add_column(heading)
    for heading in ("all", *TABLE_QUANTITIES.values()):
        table.add_column(heading, justify="right", no_wrap=True)
    for change in tried:
        ratios = [change.ratio(predicted, name) for name in TABLE_QUANTITIES]
        cells = ["–" if ratio is None else f"{ratio:.2f}" for ratio in ratios]
        table.add_row(keys[change.words], change.words, f"{1.0 / change.gain:.2f}", *cells)
    console.print(table)
    for change in tried:
        for verb, names in (("makes measurable", change.opens), ("loses", change.closes)):
            if names:
                words = f"{keys[change.words]} {verb} {', '.join(names)}"
                console.print(words)
    best = tried[0]
    if best.opens or best.gain > MIN_GAIN_FACTOR:
        console.print(
            f"Helps most: {best.words} (± becomes {100.0 / best.gain:.0f} % on average"
            f"{', and more can be measured' if best.opens else ''})",
        )
    else:
        console.print("No change has a relevant effect.")
