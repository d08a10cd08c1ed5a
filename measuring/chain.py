"""Measurement of one clip: track, calibrate, fit, evaluate; each stage cached.

Tracks depend on the clip, its rate and the points given; fits also on all other options; the
measurement also on the quantities asked for.
"""

import functools
import os
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration, ContradictionError
from calib.grid import WallGrid
from calib.solve import LOG_FOCAL_STD, Solved
from measuring.bounce import bounce_restitution
from measuring.budget import (
    ClipConditions,
    Propagation,
    derived_values,
    impact_after_move,
    random_covariance,
    systematic_budget,
    values_after_move,
    values_of,
)
from measuring.cache import Cache, clip_digest
from measuring.checker.clips import clip_findings
from measuring.checks import CheckKind, CheckOutcome
from measuring.gravity import scale_std, seen_fall, with_fitted_slant
from measuring.impact import Impact, find_impact, next_strike_time, other_strikes
from measuring.inputs import (
    LENGTHLESS_UNITS,
    OF_THE_SUPPORT,
    TIMELESS_UNITS,
    Assumption,
    Inputs,
    chosen_ball,
    gather_inputs,
    kinds_of,
    quantities_except,
)
from measuring.measurement import Axes, ClipMeasurement, motion_warning, on_axes
from measuring.metres import (
    STATED_STD_PX,
    AssumedLens,
    BallScale,
    CameraMapping,
    MetricTracks,
    PlaneMapping,
    assumed_lens,
    calibrate_clip,
    radius_relative_std,
    tracks_in_metres,
)
from measuring.motions import (
    Mapping,
    MotionResults,
    MotionScene,
    PlaneScale,
    applicable,
    motion_quantities,
    rate_from_gravity,
    require_upright,
)
from measuring.results import (
    Evaluated,
    NoScale,
    Results,
    motion_seen,
    needed,
    results_of,
    stated_landing_off,
    stated_pivot_off,
)
from measuring.setup.file import Origin, Setup
from metrology import (
    CalibrationError,
    MeasurementError,
    Quantity,
    UncertaintySource,
    UsageError,
)
from metrology.compiled import with_stack_space
from metrology.kept import KeptResults
from vision.clip.clip import ClipReader
from vision.clip.footage import CaptureRate, RateSource, choose_capture_rate
from vision.clip.picture import ClipInfo
from vision.following import follow
from vision.stages import GivenObjects
from vision.tracks import FollowedObject, MotionKind, Tracks

__all__ = [
    "FittedClip",
    "FollowedClip",
    "Found",
    "MeasureOptions",
    "fit_tracks",
    "fitted_once",
    "measure_clip",
    "measure_tracks",
    "measured_once",
    "measurement_of",
    "quantities_of",
    "tracked_once",
    "with_bounce",
]

_Progress = Callable[[str, float], None]

_Measure = Callable[..., ClipMeasurement]


def measured_once(measure: _Measure) -> _Measure:
    """Return a measuring function that first looks up the cache.

    Parameters
    ----------
    measure : callable
        Takes a path, options, a progress callable and kept results.
    """

    @functools.wraps(measure)
    def measured(
        path: Path,
        options: "MeasureOptions | None" = None,
        progress: _Progress | None = None,
        kept: KeptResults | None = None,
    ) -> ClipMeasurement:
        if options is not None and options.axes is not None:
            # no number depends on them
            plain = measured(path, replace(options, axes=None), progress, kept)
            placed = replace(plain, axes=options.axes)
            if not np.isfinite(on_axes(placed, np.zeros((1, 2)))).all():
                raise UsageError(
                    f"--axes {options.axes.x_px:g},{options.axes.y_px:g} is too far outside the"
                    " picture: the camera sees no point of the plane of motion there",
                    hint="Place the origin in the picture, or near it.",
                )
            return placed
        path = Path(path)
        stored = Cache.of_user(wanted=options is not None and options.cache)
        if stored.folder is None or options is None or not os.path.exists(path):
            return measure(path, options, progress, kept)
        followed_from = (clip_digest(path), _lens_digest(options))
        keys = [
            stored.key("measurement", *followed_from, replace(options, wanted=wanted))
            for wanted in dict.fromkeys((None, options.wanted))
        ]
        for key in keys:
            found = stored.get(key)
            if isinstance(found, ClipMeasurement):
                return replace(found, info=replace(found.info, path=path))
        made = measure(path, options, progress, kept)
        stored.put(keys[-1], made)
        return made

    return measured


def _lens_digest(options: "MeasureOptions") -> str | None:
    lens = options.setup.camera.lens
    return clip_digest(lens) if lens is not None and lens.is_file() else None


@dataclass(frozen=True, eq=False)
class FollowedTracks:
    """Result of tracking a clip to its end.

    Attributes
    ----------
    clock : (F,) array
        Mid-exposure time of every frame, in frames of the camera.
    info : ClipInfo
        With the number of decoded frames.
    warnings : tuple of str
        Of reading and decoding the clip.
    """

    tracks: Tracks
    clock: NDArray[np.float64]
    info: ClipInfo
    warnings: tuple[str, ...]


def tracked_once(
    clip: ClipReader, capture_fps: float, options: "MeasureOptions", follow: Callable[[], Tracks]
) -> FollowedTracks:
    """Track a clip, or load its tracks from the cache.

    Parameters
    ----------
    capture_fps : float
        Frame rate used for tracking, 1/s.
    options : MeasureOptions
        The points given, and whether the cache is used.
    follow : callable
        Does the tracking.
    """
    kept = Cache.of_user(wanted=options.cache)
    given = (options.ball_at, options.mass_at, clip.info.every, options.corrected, options.kind)
    key = kept.key("tracks", clip.info.sha256, capture_fps, *given)
    found = kept.get(key)
    if isinstance(found, FollowedTracks):
        return replace(found, info=replace(found.info, path=clip.info.path))
    tracks = follow()
    clock = tracks.on_clock(clip.capture_times(1.0))
    made = FollowedTracks(tracks, clock, clip.info, clip.warnings)
    kept.put(key, made)
    return made


FloatArray = NDArray[np.float64]

Point = tuple[float, float] | tuple[float, float, int]

_MIN_RELATIVE_VARIANCE = 1e-12
"""Of the largest variance: below is rounding error of a double (chosen)."""


@dataclass(frozen=True)
class MeasureOptions:
    """Options of one measurement.

    `scale_m_per_px` is a scale in the plane of motion with its standard uncertainty, m/px; with it
    the wall is not calibrated. `joint_rate` is used where no rate is given. `wanted` names the
    quantities to evaluate, with everything their uncertainties and checks need; None: all. Of
    `every` n pictures one is read. `pivot_at` takes the place of the fitted pivot (px),
    `landing_at` that of the flight's end, `corrected` that of what is found in the clip, `kind`
    that of the most probable kind of motion. `axes` are those of positions in metres.
    """

    setup: Setup = field(default_factory=Setup)
    fps: float | None = None
    fps_std: float | None = None
    ball: str | None = None
    wall_grid: str | None = None
    ball_at: Point | None = None
    mass_at: Point | None = None
    pivot_at: tuple[float, float] | None = None
    landing_at: tuple[float, float] | None = None
    axes: Axes | None = None
    budget: Propagation = Propagation.RESPONSE
    scale_m_per_px: tuple[float, float] | None = None
    joint_rate: CaptureRate | None = None
    cache: bool = False
    wanted: tuple[str, ...] | None = None
    every: int = 1
    corrected: GivenObjects | None = None
    kind: MotionKind | None = None

    @property
    def known(self) -> Setup:
        """The setup with the ball given beside it."""
        return replace(self.setup, ball=chosen_ball(self.setup, self.ball))


@dataclass(frozen=True, eq=False)
class FollowedClip:
    """Tracks and inputs of a clip; measuring is a pure function of them.

    Attributes
    ----------
    tracks : Tracks
        In pixels.
    clock : (F,) array
        Mid-exposure time of every frame of the clip, in frames of the camera.
    rate : CaptureRate
        As given or assumed.
    scale_m_per_px : (2,) tuple of float or None
        Scale in the plane of motion with its standard uncertainty, if given.
    """

    tracks: Tracks
    clock: FloatArray
    rate: CaptureRate
    inputs: Inputs
    scale_m_per_px: tuple[float, float] | None = None

    def seconds(self, fps: float) -> FloatArray:
        """Times of all frames at a rate, s."""
        return self.clock / fps


@dataclass(frozen=True, eq=False)
class FittedClip:
    """Motion in metres and seconds, and its fits, from which every quantity is evaluated.

    Attributes
    ----------
    followed : FollowedClip
        On the final clock.
    refusal : str
        Why there is no impact.
    """

    followed: FollowedClip
    wall: "WallScene"
    scene: ClipConditions
    metric: MetricTracks | None = None
    impact: Impact | None = None
    refusal: str = ""


@dataclass(frozen=True, eq=False)
class Found:
    """Results that follow from the tracks.

    Attributes
    ----------
    rate : CaptureRate
        As given, or estimated from free fall.
    assumed : tuple of Assumption
        What is assumed since it was not given.
    plane : PlaneMapping or None
        Pixels to metres in the plane of motion; None without a scale.
    """

    results: Results
    rate: CaptureRate
    evaluated: Evaluated
    calibration: Calibration | None
    grid: WallGrid | None
    warnings: tuple[str, ...]
    assumed: tuple[Assumption, ...] = ()
    plane: PlaneMapping | None = None


@measured_once
@with_stack_space
def measure_clip(
    path: Path,
    options: MeasureOptions | None = None,
    progress: Callable[[str, float], None] | None = None,
    kept: KeptResults | None = None,
) -> ClipMeasurement:
    """Measure one clip.

    Parameters
    ----------
    path : Path
        Video file or folder of pictures.
    options : MeasureOptions, optional
        Setup and overrides.
    progress : callable, optional
        Called with the name of the step and its completed fraction.
    kept : KeptResults, optional
        Of earlier measurements: what the options do not change is not computed again.

    Returns
    -------
    ClipMeasurement
        Quantities that can't be measured carry their reason.

    Raises
    ------
    ClipError, NotFoundError
        If the clip can't be read, or nothing moves in it.
    """
    options = options or MeasureOptions()
    report = progress or (lambda _step, _part: None)
    inputs = gather_inputs(options.setup, options.ball, options.wall_grid)
    clip = _opened(path, options.every, kept)
    camera = options.setup.camera
    rate = choose_capture_rate(
        clip.info,
        options.fps,
        camera.capture_fps,
        option_std=options.fps_std,
        setup_std=camera.capture_fps_std,
    )

    def follow_it() -> Tracks:
        return follow(
            clip,
            rate.fps,
            ball_at=options.ball_at,
            mass_at=options.mass_at,
            given=options.corrected,
            kind=options.kind,
            progress=lambda part: report("following ball and pendulum", part),
            kept=kept,
        )

    seen = tracked_once(clip, rate.fps, options, follow_it)
    if not rate.known and options.joint_rate is not None:
        rate = options.joint_rate
    tracks = seen.tracks if options.pivot_at is None else _about(seen.tracks, options.pivot_at)
    tracks = tracks if options.landing_at is None else _landing(tracks, options.landing_at)
    followed = FollowedClip(tracks, seen.clock, rate, inputs, options.scale_m_per_px)
    fitted = fitted_once(clip, options, lambda: fit_tracks(followed, report, kept))
    found = quantities_of(fitted, report, options.budget, options.wanted)
    off = (*stated_pivot_off(tracks), *stated_landing_off(found.evaluated))
    doubts = [one.statement for one in off]
    return measurement_of(seen.info, followed, found, (*seen.warnings, *doubts))


_MIN_ARM_RADII = 2.0
"""Distance of the pivot from the mass, radii of it (chosen: what is nearer is the mass)."""


def _about(tracks: Tracks, pivot_at: tuple[float, float]) -> Tracks:
    """Tracks with the stated pivot."""
    pendulum, shown = tracks.pendulum, f"--pivot-at {pivot_at[0]:g},{pivot_at[1]:g}"
    if pendulum is None:
        raise UsageError(
            f"{shown} is given, but no pendulum was tracked",
            hint="Point at its mass with --mass-at X,Y, or leave the pivot out.",
        )
    arm = np.hypot(*(pendulum.track.centre_px - pivot_at).T)
    if arm.min() < _MIN_ARM_RADII * float(np.median(pendulum.track.radius_px)):
        raise UsageError(
            f"{shown} is on the path of the pendulum's mass",
            hint="Give the point about which it turns; it may be outside the frame.",
        )
    return replace(tracks, pendulum=pendulum.about(np.array(pivot_at), STATED_STD_PX))


def _landing(tracks: Tracks, landing_at: tuple[float, float]) -> Tracks:
    """Tracks with the stated landing."""
    if tracks.motion.measured_as is not MotionKind.STRIKE:
        raise UsageError(
            f"--landing-at {landing_at[0]:g},{landing_at[1]:g} is given, but the motion is"
            f" {tracks.motion.measured_as.noun}, and the landing is measured of a struck ball only",
            hint="Leave it out, or pass --kind strike if the ball is struck.",
        )
    place, size = np.array(landing_at), np.array(tracks.background.shape[::-1])
    room = float(np.median(tracks.ball.radius_px))
    if np.any(place < -room) or np.any(place > size - 1 + room):
        raise UsageError(
            f"--landing-at {landing_at[0]:g},{landing_at[1]:g} is outside the picture of"
            f" {size[0]} × {size[1]} px",
            hint="Give the ball's centre where it lands in the picture; x counts from the left, y"
            " from the top.",
        )
    return replace(tracks, landing_px=place)


def _opened(path: Path, every: int, kept: KeptResults | None) -> ClipReader:
    def opened() -> ClipReader:
        return ClipReader.open(path, every=every, least_frames=MIN_MOTION_FRAMES)

    if kept is None or not os.path.exists(path):
        return opened()
    return kept.once("clip", (path, clip_digest(path), every), opened)


MIN_MOTION_FRAMES = 4
"""Frames of a recording (derived: a parabola has three parameters; one more tests it)."""


def measurement_of(
    info: ClipInfo, followed: FollowedClip, found: Found, warnings: Sequence[str] = ()
) -> ClipMeasurement:
    """Combine tracks and results into the measurement of a clip.

    Parameters
    ----------
    found : Found
        From `followed`.
    warnings : sequence of str
        From reading the clip; they come first.
    """
    findings = clip_findings(followed, found.grid, found)
    explained = {
        check.statement
        for check in found.results.checks
        if findings and check.kind in (CheckKind.GRAVITY, CheckKind.BALL_SIZE)
    }
    later = [one for one in found.warnings if one not in explained]
    results = found.results
    clocks = next((finding for finding in findings if finding.key == "pace"), None)
    if clocks is not None:
        results = results.withheld(clocks.sentence)
    return ClipMeasurement(
        info=info,
        rate=found.rate,
        quantities=results.quantities,
        other_speeds=results.other_speeds,
        gravity=results.gravity,
        checks=found.results.checks,
        warnings=tuple(
            dict.fromkeys(
                [
                    *(finding.sentence for finding in findings),
                    *(one.sentence for one in found.assumed),
                    *warnings,
                    *motion_warning(followed.tracks.motion),
                    *later,
                ]
            )
        ),
        tracks=_timed(followed.tracks, followed.seconds(found.rate.fps)),
        grid=found.grid,
        calibration=found.calibration,
        impact=found.evaluated.impact,
        defaults=followed.inputs.rig.defaults_used,
        findings=findings,
        assumed=found.assumed,
        joint=results.joint,
        plane=found.plane,
    )


def measure_tracks(
    followed: FollowedClip,
    progress: Callable[[str, float], None] | None = None,
    propagation: Propagation = Propagation.RESPONSE,
) -> Found:
    """Everything after tracking: calibrate, fit, propagate, check.

    Parameters
    ----------
    progress : callable, optional
        Called with the name of the step and its completed fraction.
    propagation : Propagation
        How the systematic budget is propagated.
    """
    return quantities_of(fit_tracks(followed, progress), progress, propagation)


def fitted_once(
    clip: ClipReader, options: MeasureOptions, fit: Callable[[], FittedClip]
) -> FittedClip:
    """Fit the tracks, or load the fits made for other quantities of the same clip.

    Parameters
    ----------
    options : MeasureOptions
        The quantities asked for do not affect the fits.
    fit : callable
        Does the fitting.
    """
    kept = Cache.of_user(wanted=options.cache)
    fit_options = replace(options, wanted=None, budget=Propagation.RESPONSE)
    key = kept.key("fits", clip.info.sha256, _lens_digest(options), fit_options)
    found = kept.get(key)
    if isinstance(found, FittedClip):
        return found
    made = fit()
    if options.wanted is not None:
        # a complete measurement is cached itself
        kept.put(key, made)
    return made


def fit_tracks(
    followed: FollowedClip,
    progress: Callable[[str, float], None] | None = None,
    kept: KeptResults | None = None,
) -> FittedClip:
    """Calibrate, determine the clock and fit the motion: everything before single quantities.

    Parameters
    ----------
    progress : callable, optional
        Called with the name of the step and its completed fraction.
    kept : KeptResults, optional
        Of earlier fits of the same clip.
    """
    report = progress or (lambda _step, _part: None)
    inputs, rate = followed.inputs, followed.rate
    tracks = _timed(followed.tracks, followed.seconds(rate.fps))
    report("calibrating", 0.0)
    wall = WallScene(refusal=NoScale(_WALL_UNKNOWN))
    if followed.scale_m_per_px is None:
        wall = _calibrated(tracks, inputs, kept)
    if not rate.known:
        rate = _rate_by_fall(replace(followed, tracks=tracks), wall)
        tracks = _timed(tracks, followed.seconds(rate.fps))
    followed = replace(followed, tracks=tracks, rate=rate)
    scene = _conditions(followed, wall)
    wall = _with_free_fall(wall, followed, scene)
    scene = replace(scene, calibration=wall.calibration)
    report("calibrating", 1.0)
    fitted = FittedClip(followed, wall, scene)
    if tracks.motion.measured_as is MotionKind.NONE:
        return replace(fitted, refusal=motion_seen(tracks))
    if tracks.motion.kind in _OTHER_MOTIONS:
        seen = f"the motion is a {tracks.motion.kind.value}, not a strike"
        return replace(fitted, refusal=seen)
    try:
        require_upright(tracks)
        if scene.calibration is None:
            scene = with_fitted_slant(scene, tracks, followed.seconds(scene.rate.fps))
            fitted = replace(fitted, scene=scene)
        metric = _in_metres(scene, followed.seconds(scene.rate.fps), tracks)
        return replace(fitted, metric=metric, impact=find_impact(metric, scene.inputs))
    except MeasurementError as problem:
        return replace(fitted, refusal=problem.in_one_line)


def quantities_of(
    fitted: FittedClip,
    progress: Callable[[str, float], None] | None = None,
    propagation: Propagation = Propagation.RESPONSE,
    wanted: Collection[str] | None = None,
) -> Found:
    """Evaluate a fitted clip: quantities with their budgets, checks, warnings.

    Parameters
    ----------
    progress : callable, optional
        Called with the name of the step and its completed fraction.
    propagation : Propagation
        How the systematic budget is propagated.
    wanted : collection of str, optional
        Names of the quantities asked for; what only others need is not evaluated.
    """
    report = progress or (lambda _step, _part: None)
    followed, wall, scene = fitted.followed, fitted.wall, fitted.scene
    tracks = followed.tracks
    evaluated = _evaluate(fitted, report, propagation, needed(wanted))
    moving = _motion_scene(scene, followed, wall)
    motion = with_bounce(motion_quantities(tracks, moving), tracks, moving)
    results = results_of(evaluated, tracks, wall.refusal, motion, wanted)
    assumed = _assumptions(scene, wall, tracks)
    notice, said = scene.rate.notice, {one.sentence for one in assumed}
    warnings = [] if notice is None or notice in said else [notice]
    warnings += tracks.warnings
    if wall.calibration is not None:
        warnings += wall.calibration.warnings
    else:
        warnings.append(f"the wall gives no calibration: {wall.refusal.reason}")
    warnings += results.warnings
    warnings += _two_strikes(evaluated, tracks)
    plane = _plane(evaluated, results, moving, tracks)
    return Found(
        results, scene.rate, evaluated, wall.calibration, wall.grid, tuple(warnings), assumed, plane
    )


def _plane(
    evaluated: Evaluated, results: Results, moving: MotionScene, tracks: Tracks
) -> PlaneMapping | None:
    """The plane of motion as the quantities use it; None where they have no scale."""
    scene = evaluated.scene
    if scene.calibration is not None:
        return CameraMapping(scene.calibration)
    if evaluated.impact is not None:
        known = {one.name for one in results.quantities if one.known}
        return scene.plane_of_ball(tracks) if "ball_speed" in known else None
    if moving.scale is None:
        return None
    first = tracks.ball.centre_px[0]
    return BallScale(moving.scale.metres_per_px, first, first)


def _assumptions(
    scene: ClipConditions, wall: "WallScene", tracks: Tracks
) -> tuple[Assumption, ...]:
    """What is assumed since it was not given, each with its consequence and the option."""
    inputs, assumed = scene.inputs, list[Assumption]()
    if scene.rate.source is RateSource.ASSUMED and scene.rate.notice is not None:
        assumed.append(Assumption(scene.rate.notice, quantities_except(TIMELESS_UNITS)))
    if wall.grid is not None and inputs.setup.wall.grid is None:
        sentence = (
            f"No grid pitch given: squares of {1e3 * inputs.grid_pitch:g} mm (Ryu et al.) are"
            " assumed. Every length is proportional to it. Pass --wall-grid."
        )
        assumed.append(Assumption(sentence, quantities_except(LENGTHLESS_UNITS)))
    kind = tracks.motion.measured_as
    assumed += [
        one
        for one in inputs.assumed
        if any(kind in kinds_of(name) for name in one.concerned)
        and not (tracks.landing_px is not None and one.concerned == {*OF_THE_SUPPORT})
    ]
    return tuple(assumed)


def _other_strike(tracks: Tracks, other: FollowedObject) -> str:
    assert tracks.rest_frames is not None
    assert other.ball_at is not None
    first, last = other.track.frame[[0, -1]]
    x, y, frame = other.ball_at
    return (
        f"TWO STRIKES: in frames {first} to {last} another ball leaves the same place. The one "
        f"that leaves after frame {tracks.rest_frames[1]} is measured. To measure the other, cut "
        f"the clip, or point at it with --ball-at {x},{y},{frame}."
    )


def _two_strikes(evaluated: Evaluated, tracks: Tracks) -> list[str]:
    """Warn if the clip shows two strikes, and state which was measured."""
    impact = evaluated.impact
    messages = [_other_strike(tracks, other) for other in other_strikes(tracks)]
    again = None if impact is None else next_strike_time(impact.tracks, impact.last_flight_s)
    if again is None:
        return messages
    return [
        *messages,
        f"TWO STRIKES: the ball is at rest again at {again:.3f} s and leaves once more. The first "
        "strike is measured. To measure the second, cut the clip there.",
    ]


def _timed(tracks: Tracks, time_s: FloatArray) -> Tracks:
    """Tracks on the camera's clock: dropped frames and variable rates leave gaps."""
    ball = replace(tracks.ball, time_s=time_s[tracks.ball.frame])
    others = tuple(
        replace(other, track=replace(other.track, time_s=time_s[other.track.frame]))
        for other in tracks.others
    )
    pendulum = tracks.pendulum
    if pendulum is not None:
        mass = replace(pendulum.track, time_s=time_s[pendulum.track.frame])
        pendulum = replace(pendulum, track=mass)
    return replace(tracks, ball=ball, others=others, pendulum=pendulum)


def _conditions(followed: FollowedClip, wall: "WallScene") -> ClipConditions:
    """Clip-wide conditions that may be wrong, at their best estimates."""
    pendulum = followed.tracks.pendulum
    return ClipConditions(
        followed.inputs,
        followed.rate,
        wall.calibration,
        metres_per_px=followed.scale_m_per_px,
        lens=None if wall.calibration is not None else _assumed(followed.tracks),
        zero_std_rad=0.0 if pendulum is None else pendulum.zero_std_rad,
        pivot_steps_px=() if pendulum is None else _principal_steps(pendulum.pivot_covariance_px2),
        round_bob=pendulum is not None and pendulum.face.spherical,
    )


def _assumed(tracks: Tracks) -> AssumedLens:
    return assumed_lens(tracks.ball, tracks.background.shape)


def _principal_steps(covariance: FloatArray) -> tuple[tuple[float, float], ...]:
    """One standard deviation along each principal axis of a covariance (2, 2)."""
    squares, axes = np.linalg.eigh(covariance)
    steps = (axes * np.sqrt(np.maximum(squares, 0.0))).T
    return tuple((float(x), float(y)) for x, y in steps)


def with_bounce(motion: MotionResults, tracks: Tracks, scene: MotionScene) -> MotionResults:
    """The same with the restitution of a bounce, where a flight or a drop shows one.

    What is not in free fall has none.
    """
    if tracks.motion.measured_as not in (MotionKind.FLIGHT, MotionKind.DROP):
        return motion
    fps = scene.fps if scene.timed else None
    bounce = bounce_restitution(tracks, scene.clock, fps)
    if bounce is None:
        return motion
    for check in motion.checks:
        if check.kind is CheckKind.STEADY_FALL and check.outcome is CheckOutcome.FAILED:
            bounce = Quantity.missing(bounce.name, bounce.unit, check.statement)
    return replace(motion, quantities=motion.quantities | {bounce.name: bounce})


def _rate_by_fall(followed: FollowedClip, wall: "WallScene") -> CaptureRate:
    """Frame rate at which the flight in view falls with gravity; the assumed rate if none does."""
    rate = followed.rate
    scene = _conditions(followed, wall)
    moving = _motion_scene(scene, followed, wall)
    if not moving.metric or followed.tracks.motion.measured_as not in _FALLING_KINDS:
        return rate
    try:
        estimate = rate_from_gravity(followed.tracks, moving)
    except MeasurementError:
        return rate
    if estimate is None:
        return rate
    notice = (
        f"Frame rate not given. Estimated from gravity: {estimate.fps:.4g} ± {estimate.std:.2g} "
        "fps; times and speeds depend on it. Pass --fps RATE, or set capture_fps in the setup file."
    )
    return replace(rate, fps=estimate.fps, std=estimate.std, notice=notice)


_WALL_UNKNOWN = "with a given scale of the plane of motion, the position of the wall is unknown"

_FALLING_KINDS = (MotionKind.STRIKE, MotionKind.FLIGHT, MotionKind.DROP)


def _motion_scene(scene: ClipConditions, followed: FollowedClip, wall: "WallScene") -> MotionScene:
    """Conversion of pixels and frames to metres and seconds for motions other than strikes."""
    calibration = wall.calibration
    mapping: Mapping | None = None
    steps: list[tuple[UncertaintySource, Mapping]] = []
    if calibration is not None:
        mapping = CameraMapping(calibration).ball
        for part in calibration.sources:
            values, vectors = np.linalg.eigh(part.covariance)
            steps += [
                (
                    part.name,
                    CameraMapping(
                        calibration.with_parameters(calibration.vector + np.sqrt(value) * vector)
                    ).ball,
                )
                for value, vector in zip(values, vectors.T, strict=True)
                if value > _MIN_RELATIVE_VARIANCE * values[-1] > 0
            ]
    inputs = scene.inputs
    return MotionScene(
        clock=followed.clock,
        fps=scene.rate.fps,
        fps_std=scene.rate.std,
        scale=None if mapping is not None else _plane_scale(scene, followed.tracks, wall),
        mapping=mapping,
        mapping_steps=tuple(steps),
        drag=inputs.drag_per_metre,
        gravity=inputs.gravity,
        size=float(max(followed.tracks.background.shape)),
        rate_from_fall=scene.rate.source is RateSource.ASSUMED,
        diameter=_given_diameter(scene) if followed.tracks.ball.sized else None,
    )


def _given_diameter(scene: ClipConditions) -> tuple[float, float] | None:
    """Diameter and its relative std, if the scale has another source."""
    diameter = scene.inputs.rig.ball_diameter
    if scene.metres_per_px is None or diameter is None:
        return None
    return diameter.value, diameter.relative_std


def _plane_scale(scene: ClipConditions, tracks: Tracks, wall: "WallScene") -> PlaneScale | None:
    """Scale in the plane of motion without a calibration."""
    if scene.metres_per_px is not None:
        per_px, std = scene.metres_per_px
        return PlaneScale(per_px, std / per_px, UncertaintySource.SCALE)
    if scene.inputs.ball is None or not tracks.ball.sized or wall.refusal.contradicts:
        return None
    ball = applicable(tracks)
    lens = scene.lens or _assumed(tracks)
    across = lens.across(ball.centre_px, ball.radius_px)
    radius = float(np.median(across))
    scaled_mad = 1.4826 * float(np.median(np.abs(across - radius)))
    # the elongation of a sphere's image scales with the inverse square of the focal length
    longer = 2.0 * LOG_FOCAL_STD * (float(np.median(ball.radius_px)) / radius - 1.0)
    diameter = scene.inputs.rig.ball_diameter
    assert diameter is not None
    relative_std = np.linalg.norm(
        [diameter.relative_std, radius_relative_std(ball), scaled_mad / radius, longer]
    )
    per_px = 0.5 * diameter.value / radius
    return PlaneScale(per_px, float(relative_std), UncertaintySource.BALL_DIAMETER)


@dataclass(frozen=True)
class WallScene:
    """Calibrated scene from the wall, or why there is none."""

    solved: Solved | None = None
    refusal: NoScale = field(default_factory=NoScale)

    @property
    def calibration(self) -> Calibration | None:
        return None if self.solved is None else self.solved.calibration

    @property
    def grid(self) -> WallGrid | None:
        return None if self.solved is None else self.solved.grid


def _calibrated(tracks: Tracks, inputs: Inputs, kept: KeptResults | None) -> WallScene:
    try:
        return WallScene(calibrate_clip(tracks, inputs, kept))
    except ContradictionError as problem:
        text = f"{problem.message}; {_sizes(inputs)}"
        return WallScene(refusal=NoScale(text, contradicts=True))
    except CalibrationError as problem:
        return WallScene(refusal=NoScale(problem.in_one_line))


def _with_free_fall(wall: WallScene, followed: FollowedClip, scene: ClipConditions) -> WallScene:
    """Include free fall in the calibration if no distance is measured and the rate is known.

    A fall that contradicts the other data is left to the check by gravity.
    """
    if wall.solved is None or wall.solved.evidence.taped:
        return wall
    if scene.rate.source is RateSource.ASSUMED:
        return wall
    fall = seen_fall(scene, followed.tracks, followed.seconds(scene.rate.fps))
    if fall is None:
        return wall
    try:
        return replace(wall, solved=wall.solved.weighing(fall))
    except CalibrationError:
        return wall


def _sizes(inputs: Inputs) -> str:
    """Sizes that contradict each other, with the options to correct them."""
    squares = f"squares of {1e3 * inputs.grid_pitch:g} mm"
    if inputs.ball is None:
        return f"{squares} and the measured distances contradict each other: check --wall-grid"
    return (
        f"{squares} and a ball of {1e3 * inputs.ball.diameter:g} mm"
        " contradict each other: check --wall-grid and --ball, and that the ball was tracked"
    )


_OTHER_MOTIONS = (MotionKind.SWING, MotionKind.COLLISION, MotionKind.DROP)


def _evaluate(
    fitted: FittedClip,
    report: Callable[[str, float], None],
    propagation: Propagation,
    names: frozenset[str],
) -> Evaluated:
    followed, scene = fitted.followed, fitted.scene
    metric, impact = fitted.metric, fitted.impact
    if metric is None or impact is None:
        return Evaluated(
            scene, None, None, np.zeros(0), np.zeros((0, 0)), {}, fitted.refusal, names
        )
    steps = 0

    def values(moved: ClipConditions) -> FloatArray:
        nonlocal steps
        steps += 1
        report("propagating uncertainty", min(1.0, steps / 30))
        if not moved.places_as(scene):
            again = _in_metres(moved, followed.seconds(moved.rate.fps), followed.tracks)
            return values_after_move(impact, again, moved.inputs, propagation, names)
        if moved.inputs.fitted_alike(scene.inputs):
            return values_of(unmoved(), moved.inputs, names)
        return values_after_move(impact, metric, moved.inputs, propagation, names)

    @functools.cache
    def unmoved() -> Impact | None:
        return impact_after_move(impact, metric, scene.inputs, propagation)

    return Evaluated(
        scene,
        metric,
        impact,
        derived_values(impact, scene.inputs, names),
        random_covariance(impact, scene.inputs, names),
        systematic_budget(scene, values, scale_std(scene, followed.tracks)),
        "",
        names,
    )


def _in_metres(scene: ClipConditions, times: FloatArray, tracks: Tracks) -> MetricTracks:
    mapping = (
        scene.plane_of_ball(tracks)
        if scene.calibration is None
        else CameraMapping(scene.calibration)
    )
    length = scene.inputs.rig.length
    known = None
    if length.value_from is not Origin.PRESET:
        known = scene.inputs.pendulum.length, length.relative_std
    return tracks_in_metres(tracks, mapping, times, scene.zero_rad, scene.pivot_px, known)
