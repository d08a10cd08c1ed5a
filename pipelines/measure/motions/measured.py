"""Quantities of the motions that are no strike, each with its budget or the reason why not."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from metrology import Contribution, MeasurementError, Quantity, UncertaintySource
from pipelines.measure.checks.consequences import WITHHELD_BEYOND, Contradiction, doubted
from pipelines.measure.fits.discs import disc_contact
from pipelines.measure.inputs import QuantityName, in_pixels
from pipelines.measure.motions.collision import Collision, Passage, fit_collision
from pipelines.measure.motions.free_flight import (
    FlightFrames,
    FreeFlight,
    FreeFlightPriors,
    fit_free_flight,
)
from pipelines.measure.motions.swing import fit_free_swing
from pipelines.report import Check, CheckKind, CheckOutcome
from vision.tracks import MotionKind, Track, Tracks

__all__ = [
    "Mapping",
    "MotionResults",
    "MotionScene",
    "PlaneScale",
    "applicable",
    "flight_of",
    "motion_quantities",
    "rate_by_fall",
]

FloatArray = NDArray[np.float64]
Mapping = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

_HORIZONTAL_SLANT = math.radians(6.0)
"""A camera set up by eye, rad."""
NARROWEST_FOCAL_OVER_SIZE = 0.9
"""Focal length over the picture's longer side of the widest lens to expect (58° of view)."""
UNKNOWN_DRAG_OVER_PATH = 0.03
"""K times the path, for a ball of which nothing is known: a tennis ball over two metres."""
_MOST_ANGLE_STD = 20.0
"""deg: a direction that is less sure is none."""
_STEADY_SIGMAS = 4.0
"""Standard deviations between both halves of a flight: one honest flight in sixteen thousand is
farther apart."""
_LEAST_SHARE = 0.6
"""Of the frames that a motion must explain to be called by its name: more than half, by a
margin."""
_MOST_OFF_BY = 0.01
"""Of the path's length: outlines of balls are found to better than that, arcs miss it."""
_MOMENTUM_SIGMAS = 4.0
"""Standard deviations: of honest collisions one in sixteen thousand is farther off."""
_GRAVITY_SIGMAS = 3.0
"""Standard deviations: of honest flights one in 370 is farther off."""
LEAST_POWER = 0.5
RELEVANT_SHARE = 0.1
"""Share of gravity: what a check must be able to see to say anything about rate and scale."""


@dataclass(frozen=True)
class PlaneScale:
    """Metres per pixel in the plane of motion.

    Attributes
    ----------
    metres_per_px : float
    share : float
        Relative standard uncertainty.
    source : UncertaintySource
    """

    metres_per_px: float
    share: float
    source: UncertaintySource


@dataclass(frozen=True)
class MotionScene:
    """What turns pixels and frames into metres and seconds.

    Attributes
    ----------
    clock : (F,) array
        Times of all frames of the clip, in frames.
    fps, fps_std : float
        Rate; an infinite uncertainty where nobody knows it.
    scale : PlaneScale or None
        None where there is a calibration, or no scale at all.
    mapping : callable or None
        Outline centres and covariances to metres through a calibrated camera.
    mapping_steps : tuple of (source, callable)
        The same with each input of the calibration one standard deviation off.
    drag : (2,) tuple of float
        K with its standard uncertainty, 1/m.
    gravity : float
        m/s².
    size : float
        Longer side of the picture, px.
    rate_from_fall : bool
        Whether this very fall told the rate.
    """

    clock: FloatArray
    fps: float
    fps_std: float
    scale: PlaneScale | None
    mapping: Mapping | None
    mapping_steps: tuple[tuple[UncertaintySource, Mapping], ...]
    drag: tuple[float, float]
    gravity: float
    size: float
    rate_from_fall: bool = False

    @property
    def timed(self) -> bool:
        """Whether frames are seconds."""
        return math.isfinite(self.fps_std)

    @property
    def metric(self) -> bool:
        """Whether pixels are metres."""
        return self.scale is not None or self.mapping is not None


@dataclass(frozen=True)
class MotionResults:
    """What was measured of a motion; `gravity` is its fall as the check of rate and scale."""

    quantities: dict[str, Quantity] = field(default_factory=dict)
    checks: tuple[Check, ...] = ()
    gravity: Quantity | None = None


def motion_quantities(tracks: Tracks, scene: MotionScene) -> MotionResults:
    """Quantities of the motion seen; those of other motions are left to the caller."""
    kind = tracks.motion.kind
    try:
        if kind in (MotionKind.FLIGHT, MotionKind.DROP):
            return _falling(tracks, scene)
        if kind is MotionKind.SWING:
            return _swinging(tracks, scene)
        if kind is MotionKind.COLLISION:
            return _meeting(tracks, scene)
    except MeasurementError as problem:
        return MotionResults(
            {
                name.value: Quantity.missing(name.value, unit, problem.in_one_line)
                for name, unit in _UNITS[kind].items()
            }
        )
    return MotionResults()


_UNITS: dict[MotionKind, dict[QuantityName, str]] = {
    kind: {
        QuantityName.FALL_ACCELERATION: "m/s^2",
        QuantityName.FLIGHT_SPEED: "m/s",
        QuantityName.FLIGHT_ANGLE: "deg",
    }
    for kind in (MotionKind.FLIGHT, MotionKind.DROP)
} | {
    MotionKind.SWING: {QuantityName.SWING_PERIOD: "s", QuantityName.SWING_DAMPING: "1/s"},
    MotionKind.COLLISION: {
        QuantityName.SPEED_BEFORE: "m/s",
        QuantityName.SPEED_AFTER: "m/s",
        QuantityName.OTHER_SPEED_BEFORE: "m/s",
        QuantityName.OTHER_SPEED_AFTER: "m/s",
        QuantityName.COR_COLLISION: "1",
    },
}


@dataclass(frozen=True)
class RateByFall:
    """A capture rate, frames per second, with its standard uncertainty."""

    fps: float
    std: float


MOST_RATE_SHARE = 0.1
"""Relative uncertainty of a rate beyond which it tells no seconds."""


def rate_by_fall(tracks: Tracks, scene: MotionScene) -> RateByFall | None:
    """The rate at which the flight falls with gravity; None where it tells too little of it.

    Raises
    ------
    MeasurementError
        If there is no free flight.
    """
    in_frames = replace(scene, fps=1.0, fps_std=math.inf)
    ball = applicable(tracks)
    flight = flight_of(ball, in_frames)
    values = np.array([flight.acceleration, flight.speed, flight.angle_deg])
    budget = _Lines(values, flight).budget(0, in_frames, ball)
    std = math.sqrt(sum(line.std**2 for line in budget))
    if flight.acceleration <= 0 or _steady(flight, len(ball)).outcome is CheckOutcome.FAILED:
        return None
    share = 0.5 * std / flight.acceleration
    if share > MOST_RATE_SHARE:
        return None
    fps = math.sqrt(scene.gravity / flight.acceleration)
    return RateByFall(fps, share * fps)


def applicable(tracks: Tracks) -> Track:
    """The rows of the ball's track to which its motion applies."""
    ball = tracks.ball
    if tracks.motion.frames is None:
        return ball
    first, last = tracks.motion.frames
    kept = ball.where((ball.frame >= first) & (ball.frame <= last))
    return kept if len(kept) else ball


def flight_of(ball: Track, scene: MotionScene, mapping: Mapping | None = None) -> FreeFlight:
    """The free flight of a track, in metres where there is a scale and seconds where a rate.

    Raises
    ------
    MeasurementError
        If there is no free flight in it.
    """
    chosen = scene.mapping if mapping is None else mapping
    std_px = np.sqrt(np.diagonal(ball.covariance_px2, axis1=1, axis2=2))
    if chosen is not None:
        place, covariance = chosen(ball.centre_px, ball.covariance_px2)
        std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        growth = 0.0
    else:
        per_px = 1.0 if scene.scale is None else scene.scale.metres_per_px
        place = ball.centre_px * [per_px, -per_px]
        std = std_px * per_px
        reach = float(np.hypot(*np.ptp(ball.centre_px, axis=0)))
        focal = NARROWEST_FOCAL_OVER_SIZE * scene.size
        growth = math.tan(_HORIZONTAL_SLANT) * reach / focal
    drag, drag_std = scene.drag
    if not scene.metric:
        reach = max(float(np.hypot(*np.ptp(place, axis=0))), 1e-12)
        drag, drag_std = UNKNOWN_DRAG_OVER_PATH / reach, UNKNOWN_DRAG_OVER_PATH / reach
    time = scene.clock[ball.frame] / (scene.fps if scene.timed else 1.0)
    # with a calibration the size has done its part already
    size = ball.radius_px if chosen is None else np.full(len(ball), np.nan)
    path = FlightFrames(time, place, std, size, ball.radius_std_px)
    return fit_free_flight(path, FreeFlightPriors(drag, drag_std, growth))


_NAMES = (QuantityName.FALL_ACCELERATION, QuantityName.FLIGHT_SPEED, QuantityName.FLIGHT_ANGLE)


def _falling(tracks: Tracks, scene: MotionScene) -> MotionResults:
    ball = applicable(tracks)
    flight = flight_of(ball, scene)
    values = np.array([flight.acceleration, flight.speed, flight.angle_deg])
    lines = [_Lines(values, flight)]
    budgets = [lines[0].budget(index, scene, ball) for index in range(3)]
    found: dict[str, Quantity] = {}
    angle = _angle(float(values[2]), budgets[2], tracks.motion.kind)
    found[angle.name] = angle
    for index, name in enumerate(_NAMES[:2]):
        one = _in_units(name, float(values[index]), budgets[index], scene)
        found[one.name] = one
        if one.name != name.value:
            reason = _no_scale(scene)
            found[name.value] = Quantity.missing(
                name.value, _UNITS[MotionKind.FLIGHT][name], reason
            )
    steady = _steady(flight, len(ball))
    acceleration = found[QuantityName.FALL_ACCELERATION.value]
    gravity, by_gravity = _by_gravity(acceleration, scene)
    if steady.outcome is CheckOutcome.FAILED:
        everything = frozenset(QuantityName(name) for name in found)
        found = doubted(found, [Contradiction(everything, math.inf, True, steady.statement)])
    elif by_gravity is not None and by_gravity.outcome is CheckOutcome.FAILED:
        assert acceleration.value is not None
        off = abs(acceleration.value / scene.gravity - 1.0)
        hangs = {QuantityName.FALL_ACCELERATION, QuantityName.FLIGHT_SPEED}
        if off > WITHHELD_BEYOND:
            # what falls so much otherwise may be no flight at all
            hangs.add(QuantityName.FLIGHT_ANGLE)
        found = doubted(found, [Contradiction(frozenset(hangs), off, False, by_gravity.statement)])
    if scene.rate_from_fall and acceleration.known:
        told = "the fall told the capture rate, which nobody says: give it with --fps RATE"
        fallen = QuantityName.FALL_ACCELERATION.value
        found[fallen] = Quantity.missing(fallen, "m/s^2", told)
    checks = [steady] if by_gravity is None else [steady, by_gravity]
    return MotionResults(found, tuple(checks), gravity)


def _by_gravity(fall: Quantity, scene: MotionScene) -> tuple[Quantity | None, Check | None]:
    """Whether it falls as gravity has it; rate or scale are wrong where it does not."""
    if fall.value is None or fall.std is None:
        return None, None
    gravity = replace(fall, name="gravity_check")
    text = f"it falls with {fall.value:.2f} ± {fall.std:.2f} m/s²"
    if scene.rate_from_fall:
        said = f"{text}, which told the capture rate and so can't check it"
        return gravity, Check(CheckKind.GRAVITY, CheckOutcome.UNDECIDED, said, 0.0)
    off = abs(fall.value - scene.gravity)
    power = float(ndtr(-_GRAVITY_SIGMAS + RELEVANT_SHARE * scene.gravity / fall.std))
    outcome = CheckOutcome.PASSED if power >= LEAST_POWER else CheckOutcome.UNDECIDED
    if off > _GRAVITY_SIGMAS * fall.std:
        outcome = CheckOutcome.FAILED
        text += (
            f", not {scene.gravity:.2f}: check --fps (another rate than {scene.fps:g} fps?) and the"
            " scale, and that it falls freely"
        )
    elif outcome is CheckOutcome.UNDECIDED:
        text += ": too unsure to tell anything of rate and scale"
    return gravity, Check(CheckKind.GRAVITY, outcome, text, power)


@dataclass(frozen=True)
class _Lines:
    """Budget lines of acceleration, speed and angle of a flight."""

    values: FloatArray
    flight: FreeFlight

    def budget(self, index: int, scene: MotionScene, ball: Track) -> tuple[Contribution, ...]:
        flight = self.flight
        lines = [
            Contribution(UncertaintySource.TRACK_NOISE, float(flight.noise[index])),
            Contribution(UncertaintySource.CAMERA_SLANT, float(flight.perspective[index])),
            Contribution(UncertaintySource.DRAG, float(flight.air[index])),
        ]
        powers = {0: (1.0, 2.0), 1: (1.0, 1.0), 2: (0.0, 0.0)}[index]
        if scene.scale is not None:
            share = powers[0] * scene.scale.share * abs(float(self.values[index]))
            lines.append(Contribution(scene.scale.source, share))
        if scene.timed:
            clock = powers[1] * scene.fps_std / scene.fps * abs(float(self.values[index]))
            lines.append(Contribution(UncertaintySource.CAPTURE_RATE, clock))
        for source, moved in scene.mapping_steps:
            other = flight_of(ball, scene, moved)
            there = np.array([other.acceleration, other.speed, other.angle_deg])
            lines.append(Contribution(source, abs(float(there[index] - self.values[index]))))
        kept = [line for line in lines if line.std > 0 and math.isfinite(line.std)]
        return tuple(sorted(kept, key=lambda line: -line.std))


def _steady(flight: FreeFlight, frames: int) -> Check:
    """Whether the whole falls alike: what is carried, rolls or swings does so over short runs only.

    Any smooth path looks like a parabola for a while: the run that does must be most of it.
    """
    telling = flight.noise[0] < RELEVANT_SHARE * abs(flight.acceleration)
    text = (
        f"the accelerations of its two halves are {flight.halves_apart:.1f} standard uncertainties"
        " apart"
    )
    share = len(flight.path.time) / frames
    off_by = float(np.median(np.hypot(*flight.residual.T))) / flight.length
    if share < _LEAST_SHARE or off_by > _MOST_OFF_BY:
        return Check(
            CheckKind.STEADY_FALL,
            CheckOutcome.FAILED,
            f"what was followed does not fall freely: {100 * share:.0f} % of its frames lie on one"
            f" flight, {100 * off_by:.1f} % of its length off; point at the ball with --ball-at",
        )
    if flight.halves_apart > _STEADY_SIGMAS:
        return Check(
            CheckKind.STEADY_FALL,
            CheckOutcome.FAILED,
            f"what was followed does not fall freely: {text}; point at the ball with --ball-at",
        )
    outcome = CheckOutcome.PASSED if telling else CheckOutcome.UNDECIDED
    return Check(CheckKind.STEADY_FALL, outcome, text)


def _angle(value: float, budget: tuple[Contribution, ...], kind: MotionKind) -> Quantity:
    name = QuantityName.FLIGHT_ANGLE.value
    found = Quantity.measured(name, value, "deg", budget)
    if kind is MotionKind.DROP or (found.std or 0.0) > _MOST_ANGLE_STD:
        return Quantity.missing(
            name, "deg", "it falls nearly from rest: its path has no angle at the first frame"
        )
    return found


def _no_scale(scene: MotionScene) -> str:
    if not scene.metric:
        return (
            "nothing gives a scale in the plane of motion: give the diameter with --ball, or"
            " --scale, or film before a wall grid; the same in pixels is given"
        )
    return "the camera's rate is not known: give it with --fps RATE; the same in frames is given"


def _in_units(
    name: QuantityName, value: float, budget: tuple[Contribution, ...], scene: MotionScene
) -> Quantity:
    """In SI where scale and rate are known, else in pixels or frames under the name for that."""
    squared = name is QuantityName.FALL_ACCELERATION
    if scene.metric and scene.timed:
        unit = "m/s^2" if squared else "m/s"
        return Quantity.measured(name.value, value, unit, budget)
    length = "m" if scene.metric else "px"
    time = ("s^2" if squared else "s") if scene.timed else ("frame^2" if squared else "frame")
    if scene.metric:
        # metres without seconds: in pixels, so that a name has one meaning
        per_px = 1.0 if scene.scale is None else scene.scale.metres_per_px
        if scene.scale is None:
            return Quantity.missing(in_pixels(name).value, f"px/{time}", _no_scale(scene))
        value /= per_px
        budget = tuple(replace(line, std=line.std / per_px) for line in budget)
        length = "px"
    return Quantity.measured(in_pixels(name).value, value, f"{length}/{time}", budget)


def _swinging(tracks: Tracks, scene: MotionScene) -> MotionResults:
    bob = applicable(tracks)
    std = np.sqrt(0.5 * np.trace(bob.covariance_px2, axis1=1, axis2=2))
    swing = fit_free_swing(scene.clock[bob.frame], bob.centre_px, std)
    period, damping = QuantityName.SWING_PERIOD.value, QuantityName.SWING_DAMPING.value
    if not scene.timed:
        reason = (
            f"the camera's rate is not known: give it with --fps RATE; the period is "
            f"{swing.period:.2f} ± {swing.period_std:.2g} frames, the damping "
            f"{swing.damping:.2g} ± {swing.damping_std:.1g} per frame"
        )
        return MotionResults(
            {
                period: Quantity.missing(period, "s", reason),
                damping: Quantity.missing(damping, "1/s", reason),
            }
        )
    rate = scene.fps_std / scene.fps
    seconds = swing.period / scene.fps
    per_second = swing.damping * scene.fps
    noise = UncertaintySource.TRACK_NOISE
    return MotionResults(
        {
            period: Quantity.measured(
                period,
                seconds,
                "s",
                (
                    Contribution(noise, swing.period_std / scene.fps),
                    Contribution(UncertaintySource.CAPTURE_RATE, rate * seconds),
                ),
            ),
            damping: Quantity.measured(
                damping,
                per_second,
                "1/s",
                (
                    Contribution(noise, swing.damping_std * scene.fps),
                    Contribution(UncertaintySource.CAPTURE_RATE, rate * abs(per_second)),
                ),
            ),
        }
    )


def _meeting(tracks: Tracks, scene: MotionScene) -> MotionResults:
    """Speeds of two bodies before and after they meet; the first is the one that lay still."""
    met = disc_contact(tracks)
    if met is None:
        raise MeasurementError(
            "the two balls are not both seen on both sides of their meeting",
            hint="Film both for five frames before and after.",
        )
    in_frames = met.time_s * _tracks_fps(tracks)
    other = tracks.others[0].track
    collision = fit_collision(tracks.ball, other, in_frames, scene.clock)
    found: dict[str, Quantity] = {}
    sides = {
        QuantityName.SPEED_BEFORE: collision.before,
        QuantityName.SPEED_AFTER: collision.after,
        QuantityName.OTHER_SPEED_BEFORE: collision.other_before,
        QuantityName.OTHER_SPEED_AFTER: collision.other_after,
    }
    for name, side in sides.items():
        one = _speed(name, side, scene)
        found[one.name] = one
        if one.name != name.value:
            found[name.value] = Quantity.missing(name.value, "m/s", _no_scale(scene))
    cor = QuantityName.COR_COLLISION.value
    found[cor] = Quantity.measured(
        cor, collision.cor, "1", (Contribution(UncertaintySource.TRACK_NOISE, collision.cor_std),)
    )
    check = _momentum(collision)
    if check.outcome is CheckOutcome.FAILED or not -0.2 < collision.cor < 1.2:
        found[cor] = Quantity.missing(cor, "1", check.statement)
    return MotionResults(found, (check,))


def _tracks_fps(tracks: Tracks) -> float:
    frame, time = tracks.ball.frame, tracks.ball.time_s
    return float((frame[-1] - frame[0]) / (time[-1] - time[0]))


def _speed(name: QuantityName, side: Passage, scene: MotionScene) -> Quantity:
    speed, std = side.speed
    lines = [Contribution(UncertaintySource.TRACK_NOISE, std)]
    factor = 1.0
    if scene.scale is not None:
        factor = scene.scale.metres_per_px
        lines.append(Contribution(scene.scale.source, scene.scale.share * speed))
    if scene.timed:
        factor *= scene.fps
        lines.append(
            Contribution(UncertaintySource.CAPTURE_RATE, scene.fps_std / scene.fps * speed)
        )
    if scene.scale is not None and not scene.timed:
        factor = 1.0
    budget = tuple(replace(line, std=line.std * factor) for line in lines if line.std > 0)
    if scene.scale is not None and scene.timed:
        return Quantity.measured(name.value, speed * factor, "m/s", budget)
    unit = "px/s" if scene.timed else "px/frame"
    return Quantity.measured(in_pixels(name).value, speed * factor, unit, budget)


def _momentum(collision: Collision) -> Check:
    """Two like bodies keep the sum of their velocities over a short contact."""
    apart = collision.momentum_apart
    text = f"the sum of both velocities changes by {apart:.1f} standard uncertainties"
    if apart > _MOMENTUM_SIGMAS:
        return Check(
            CheckKind.MOMENTUM,
            CheckOutcome.FAILED,
            f"{text}: the two are not alike, are pushed, or were taken for one another",
        )
    before = collision.other_before.speed
    telling = before[1] < RELEVANT_SHARE * before[0]
    outcome = CheckOutcome.PASSED if telling else CheckOutcome.UNDECIDED
    return Check(CheckKind.MOMENTUM, outcome, text)
