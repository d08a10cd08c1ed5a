"""From a clip to a measurement, unattended."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.free_fall import with_free_fall
from calib.grid.grid import WallGrid
from calib.plausibility import ContradictionError
from calib.pose import FOCAL_OVER_WIDTH
from metrology import CalibrationError, MeasurementError
from pipelines.measure.budget import Propagation, Scene, systematic_budget, values_after_move
from pipelines.measure.calibrated import calibrate_clip, known_lens, scene_evidence
from pipelines.measure.derived import derived_values, random_covariance
from pipelines.measure.fits.gravity import contradicts_gravity
from pipelines.measure.fits.impact import find_impact
from pipelines.measure.inputs import Inputs, gather_inputs
from pipelines.measure.measurement import Measurement
from pipelines.measure.metres import BallScale, CameraMapping, MetricTracks, tracks_in_metres
from pipelines.measure.results import Evaluated, NoScale, results_of
from pipelines.setup.file import Setup
from vision.clip.capture_rate import CaptureRate, choose_capture_rate
from vision.clip.clip import Clip
from vision.following import follow
from vision.tracks import Tracks

__all__ = ["MeasureOptions", "measure_clip", "weighed_by_fall"]

FloatArray = NDArray[np.float64]
Point = tuple[float, float] | tuple[float, float, int]

_RADIUS_STD_PX = 0.1


@dataclass(frozen=True)
class MeasureOptions:
    """What the user said on the command line."""

    setup: Setup = field(default_factory=Setup)
    fps: float | None = None
    fps_std: float | None = None
    ball: str | None = None
    wall_grid: str | None = None
    ball_at: Point | None = None
    mass_at: Point | None = None
    budget: Propagation = Propagation.RESPONSE


def measure_clip(
    path: Path,
    options: MeasureOptions | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Measurement:
    """Measure one clip.

    Parameters
    ----------
    path : Path
        Video file or folder of pictures.
    options : MeasureOptions, optional
        Setup and overrides.
    progress : callable, optional
        Called with the step's name and the part of it that is done.

    Returns
    -------
    Measurement
        Quantities that can't be measured carry their reason.

    Raises
    ------
    ClipError, NotFoundError
        If the clip can't be read, or nothing in it moves.
    """
    options = options or MeasureOptions()
    tell = progress or (lambda _step, _part: None)
    inputs = gather_inputs(options.setup, options.ball, options.wall_grid)
    clip = Clip.open(path)
    camera = options.setup.camera
    rate = choose_capture_rate(
        clip.info,
        options.fps,
        camera.capture_fps,
        option_std=options.fps_std,
        setup_std=camera.capture_fps_std,
    )
    tracks = follow(
        clip,
        rate.fps,
        ball_at=options.ball_at,
        mass_at=options.mass_at,
        progress=lambda part: tell("following ball and pendulum", part),
    )
    tracks = _timed(tracks, clip.capture_times(rate.fps))
    tell("calibrating", 0.0)
    wall = _calibrated(tracks, inputs, rate, clip)
    calibration = wall.calibration
    tell("calibrating", 1.0)
    warnings = [*clip.warnings, *tracks.warnings, *inputs.assumed]
    if rate.notice:
        warnings.insert(0, rate.notice)
    if calibration is not None:
        warnings += calibration.warnings
    else:
        warnings.append(f"no calibration from the wall: {wall.refusal.reason}")
    evaluated = _evaluate(Scene(inputs, rate, calibration), clip, tracks, tell, options.budget)
    results = results_of(evaluated, tracks, wall.refusal)
    return Measurement(
        info=clip.info,
        rate=rate,
        quantities=results.quantities,
        beside=results.beside,
        gravity=results.gravity,
        checks=results.checks,
        warnings=tuple(dict.fromkeys([*warnings, *results.warnings])),
        tracks=tracks,
        grid=wall.grid,
        calibration=calibration,
        impact=evaluated.impact,
        defaults=inputs.rig.defaults_used,
    )


def _timed(tracks: Tracks, time_s: FloatArray) -> Tracks:
    """The tracks on the camera's own clock: dropped frames and variable rates leave gaps."""
    ball = replace(tracks.ball, time_s=time_s[tracks.ball.frame])
    pendulum = tracks.pendulum
    if pendulum is not None:
        mass = replace(pendulum.track, time_s=time_s[pendulum.track.frame])
        pendulum = replace(pendulum, track=mass)
    return replace(tracks, ball=ball, pendulum=pendulum)


@dataclass(frozen=True)
class _Wall:
    """What the wall gave: a calibration with its grid, or why there is none."""

    calibration: Calibration | None = None
    grid: WallGrid | None = None
    refusal: NoScale = field(default_factory=NoScale)


def _calibrated(tracks: Tracks, inputs: Inputs, rate: CaptureRate, clip: Clip) -> _Wall:
    try:
        calibration, grid = calibrate_clip(tracks, inputs)
    except ContradictionError as problem:
        text = f"{problem.message}; {_sizes(inputs)}"
        return _Wall(refusal=NoScale(text, contradicts=True))
    except CalibrationError as problem:
        return _Wall(refusal=NoScale(problem.in_one_line))
    camera, wall = inputs.setup.camera, inputs.setup.wall
    taped = camera.distance_to_wall is not None and wall.ball_plane_offset is not None
    if taped or not rate.known:
        return _Wall(calibration, grid)
    scene = Scene(inputs, rate, calibration)
    return _Wall(
        weighed_by_fall(calibration, grid, tracks, scene, clip.capture_times(rate.fps)), grid
    )


def _sizes(inputs: Inputs) -> str:
    """What can't all be right, with the options that would put it right."""
    squares = f"squares of {1e3 * inputs.grid_pitch:g} mm"
    if inputs.ball is None:
        return f"{squares} and the taped distances contradict each other: check --wall-grid"
    return (
        f"{squares} and a ball of {1e3 * inputs.ball.diameter:g} mm"
        " contradict each other: check --wall-grid and --ball, and that the ball was followed"
    )


def weighed_by_fall(
    calibration: Calibration, grid: WallGrid, tracks: Tracks, scene: Scene, time_s: FloatArray
) -> Calibration:
    """Where nothing is taped, the flight's own free fall tells the scale of the ball plane.

    A fall that contradicts the rest is left to the self-check by gravity.
    """
    try:
        free = find_impact(_in_metres(scene, time_s, tracks), scene.inputs).free_flight
        gravity = float(free.fitted.values[6])
        if contradicts_gravity(gravity, scene.inputs.gravity):
            return calibration
        by_rate = 2.0 * gravity * scene.rate.std / scene.rate.fps
        std = float(np.hypot(np.sqrt(free.fitted.covariance[6, 6]), by_rate))
        flying = np.isin(time_s[tracks.ball.frame], free.time_s)
        fused = with_free_fall(
            calibration,
            grid,
            scene_evidence(tracks, scene.inputs),
            (gravity, std),
            scene.inputs.gravity,
            px=tracks.ball.centre_px[flying],
            lens=known_lens(tracks, scene.inputs),
        )
    except MeasurementError:
        return calibration
    return calibration if fused.contradiction is not None else fused.calibration


def _evaluate(
    scene: Scene,
    clip: Clip,
    tracks: Tracks,
    tell: Callable[[str, float], None],
    propagation: Propagation,
) -> Evaluated:
    nothing = Evaluated(scene, None, None, np.zeros(0), np.zeros((0, 0)), {}, "")
    try:
        metric = _in_metres(scene, clip.capture_times(scene.rate.fps), tracks)
        impact = find_impact(metric, scene.inputs)
    except MeasurementError as problem:
        return replace(nothing, refusal=problem.in_one_line)
    steps = 0

    def values(moved: Scene) -> FloatArray:
        nonlocal steps
        steps += 1
        tell("propagating uncertainty", min(1.0, steps / 30))
        again = _in_metres(moved, clip.capture_times(moved.rate.fps), tracks)
        return values_after_move(impact, again, moved.inputs, propagation)

    return Evaluated(
        scene,
        metric,
        impact,
        derived_values(impact, scene.inputs),
        random_covariance(impact, scene.inputs),
        systematic_budget(scene, values, _scale_std(scene, tracks)),
        "",
    )


def _in_metres(scene: Scene, times: FloatArray, tracks: Tracks) -> MetricTracks:
    if scene.calibration is not None:
        return tracks_in_metres(tracks, CameraMapping(scene.calibration), times)
    ball = tracks.ball
    diameter = 1.0 if scene.inputs.ball is None else scene.inputs.ball.diameter
    still = slice(None)
    if tracks.rest_frames is not None:
        first, last = tracks.rest_frames
        first_row, end_row = np.searchsorted(ball.frame, [first, last + 1])
        still = slice(first_row, max(end_row, first_row + 1))
    radius = float(np.median(ball.radius_px))
    rest = np.median(ball.centre_px[still], axis=0)
    scale = BallScale(
        scene.scale * diameter / (2 * radius),
        rest,
        np.median(ball.centre_px, axis=0),
        scene.roll_rad,
        float(np.tan(scene.slant_rad)) / (FOCAL_OVER_WIDTH * tracks.background.shape[1]),
    )
    return tracks_in_metres(tracks, scale, times)


def _scale_std(scene: Scene, tracks: Tracks) -> float:
    diameter = scene.inputs.rig.ball_diameter
    if diameter is None:
        return np.inf
    return float(np.hypot(diameter.relative_std, _RADIUS_STD_PX / np.median(tracks.ball.radius_px)))
