"""Quantities of the motions that are no strike, each with its budget or the reason why not.

A free flight or drop by itself: acceleration, speed and direction, and what perspective hides.

Seen by a camera that is not square to the plane of motion, the scale grows along the path: over a
drop that fills the picture a slant of 1° looks like an acceleration that is 2 % off. A slant also
bends the path in a way of its own, and the ball's size changes with it: both are fitted together
with the flight, which is linear in all of its unknowns.

Two like balls or pucks that meet: speeds on both sides, coefficient of restitution.

A free swing by itself: period and damping of what comes and goes along one line.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from metrology import (
    Contribution,
    MeasurementError,
    NotFoundError,
    Quantity,
    TooLittleDataError,
    UncertaintySource,
)
from metrology.least_squares import Fitted, fit
from pipelines.measure.checks import WITHHELD_BEYOND, Contradiction, doubted, size_at_scale
from pipelines.measure.flight_fit import slow_error_whitening
from pipelines.measure.impact import disc_contact
from pipelines.measure.inputs import QuantityName, in_pixels
from pipelines.report import Check, CheckKind, CheckOutcome
from vision.tracks import MotionKind, Track, Tracks

__all__ = [
    "Collision",
    "FlightFrames",
    "FreeFlight",
    "FreeFlightPriors",
    "FreeSwing",
    "Mapping",
    "MotionResults",
    "MotionScene",
    "Passage",
    "PlaneScale",
    "applicable",
    "fit_collision",
    "fit_free_flight",
    "fit_free_swing",
    "flight_of",
    "motion_quantities",
    "rate_by_fall",
    "require_upright",
    "steady_stretch",
]

FloatArray = NDArray[np.float64]

LEAST_FRAMES = 6

"""Frames: a parabola in two directions has six unknowns and each frame two numbers; half are to
spare."""

_OUTLINED = 0.15
"""Of the radius: what outlines of balls that are smeared, half lit or a few pixels wide are off by,
root mean square over recordings that others marked."""

_MIDDLE_SHARE = 0.6

"""Of the stretch: what a throw or a bounce does not reach; the rest must carry on from there."""

_OFF_SIGMAS = 5.0

"""Standard deviations: of a flight of a thousand frames none is farther off by chance."""

ROLL_STD = math.radians(1.5)

"""A camera set up by eye, rad."""

SIZE_TREND_STD = 0.01

"""Relative change of the apparent radius along a path that light and blur alone may cause."""


@dataclass(frozen=True)
class FlightFrames:
    """Frames of a free flight, in one plane.

    Attributes
    ----------
    time : (N,) array
        s, or frames where nobody knows the rate.
    place : (N, 2) array
        x to the right, y up, m or px.
    std : (N, 2) array
        Random standard uncertainty of each coordinate.
    size, size_std : (N,) arrays
        Apparent radius and its random standard uncertainty, px.
    """

    time: FloatArray
    place: FloatArray
    std: FloatArray
    size: FloatArray
    size_std: FloatArray

    def where(self, keep: NDArray[np.bool_]) -> "FlightFrames":
        """Rows for which `keep` (N,) is true."""
        return FlightFrames(
            self.time[keep], self.place[keep], self.std[keep], self.size[keep], self.size_std[keep]
        )


@dataclass(frozen=True)
class FreeFlightPriors:
    """What is known before looking.

    Attributes
    ----------
    drag, drag_std : float
        K = ρ S C_D / 2 m, over the unit of length.
    growth_std : float
        Relative growth of the scale over the length of the path, from how square the camera stands
        to the plane of motion; 0 where a calibration has taken perspective off.
    """

    drag: float
    drag_std: float
    growth_std: float


@dataclass(frozen=True)
class _Unknowns:
    """Names of the fitted vector: over the path's length and duration, at its first frame."""

    x: float
    y: float
    vx: float
    vy: float
    ax: float
    ay: float
    drag: float
    growth_x: float
    growth_y: float


_PLACE = {name: index for index, name in enumerate(_Unknowns.__annotations__)}


@dataclass(frozen=True)
class FreeFlight:
    """A fitted free flight.

    Attributes
    ----------
    acceleration, speed, angle_deg : float
        Fall acceleration (downwards positive), speed at the first frame, and its angle above the
        horizontal, which is square to the acceleration; in the units of the path.
    noise, perspective, air : (3,) arrays
        Standard uncertainties of these three from the noise of the track, the camera's slant, and
        drag.
    path : FlightFrames
        The frames that belong to it.
    residual : (N, 2) array
        Measured minus fitted.
    priors : FreeFlightPriors
        It was fitted with.
    """

    acceleration: float
    speed: float
    angle_deg: float
    noise: FloatArray
    perspective: FloatArray
    air: FloatArray
    path: FlightFrames
    residual: FloatArray
    priors: FreeFlightPriors

    @property
    def outcome(self) -> FloatArray:
        """Acceleration, speed and angle, (3,)."""
        return np.array([self.acceleration, self.speed, self.angle_deg])

    @cached_property
    def halves_apart(self) -> float:
        """How far the accelerations of both halves are apart, in standard uncertainties."""
        return _halves_apart(self.path, self.priors)

    @property
    def length(self) -> float:
        """From one end of the path to the other, in its unit."""
        return float(np.hypot(*np.ptp(self.path.place, axis=0)))


def steady_stretch(path: FlightFrames) -> FlightFrames:
    """The longest run about the middle that carries on as a parabola: no hand, no bounce.

    Raises
    ------
    TooLittleDataError
        With fewer than six frames.
    """
    count = len(path.time)
    if count < LEAST_FRAMES:
        raise TooLittleDataError(
            f"the flight is seen in only {count} frames",
            hint="Film so that it stays in the picture for longer, or at a higher rate.",
        )
    kept = np.ones(count, dtype=bool)
    for _ in range(4):
        time = path.time - path.time[kept].mean()
        order = np.flatnonzero(kept)
        margin = int(0.5 * (1.0 - _MIDDLE_SHARE) * len(order))
        middle = order[margin : len(order) - margin] if len(order) > 2 * LEAST_FRAMES else order
        off = _off(path, time, middle)
        near = _run_about(off < _OFF_SIGMAS, int(middle[len(middle) // 2]))
        done = np.array_equal(near, kept) or not near.any()
        kept = near
        if done:
            break
    if kept.sum() < LEAST_FRAMES:
        raise TooLittleDataError(
            "no six frames in a row lie on one free flight",
            hint="Point at the ball with --ball-at X,Y,FRAME.",
        )
    return path.where(
        kept & (_off(path, path.time - path.time[kept].mean(), np.flatnonzero(kept)) < _OFF_SIGMAS)
    )


def _off(path: FlightFrames, time: FloatArray, used: NDArray[np.intp]) -> FloatArray:
    """How far each frame is from the parabola through some of them, in standard uncertainties."""
    design = np.stack([np.ones_like(time), time, time**2], axis=1)
    worst = np.zeros(len(time))
    for axis in range(2):
        std = np.maximum(path.std[:, axis], 0.3 * float(np.median(path.std[:, axis])))
        rows = design[used] / std[used, np.newaxis]
        best = np.linalg.lstsq(rows, path.place[used, axis] / std[used], rcond=None)[0]
        left = path.place[:, axis] - design @ best
        scatter = 1.4826 * float(np.median(np.abs(left[used] / std[used])))
        covariance = np.linalg.pinv(rows.T @ rows)
        predicted = np.einsum("ni,ij,nj->n", design, covariance, design)
        spread = max(scatter, 1.0) * np.sqrt(std**2 + predicted)
        worst = np.maximum(worst, np.abs(left) / spread)
    return worst


def _run_about(good: NDArray[np.bool_], centre: int) -> NDArray[np.bool_]:
    """The run of good frames about one of them; single frames that are off do not end it."""
    patched = good.copy()
    patched[1:-1] |= good[:-2] & good[2:]
    first = last = centre
    while first > 0 and patched[first - 1]:
        first -= 1
    while last < len(good) - 1 and patched[last + 1]:
        last += 1
    run = np.zeros(len(good), dtype=bool)
    run[first : last + 1] = True
    return run


def fit_free_flight(path: FlightFrames, priors: FreeFlightPriors) -> FreeFlight:
    """Fit flight, slant of the camera and drag to the frames of a free flight.

    Parameters
    ----------
    path : FlightFrames
        Any unit of length and time.
    priors : FreeFlightPriors

    Raises
    ------
    TooLittleDataError
        If fewer than six frames belong together.
    """
    path = steady_stretch(path)
    fitted, units, residual = _fitted(path, priors)
    scatter = np.sqrt((residual**2).sum(axis=0) / max(len(residual) - 3, 1))
    if np.any(scatter > np.median(path.std, axis=0)):
        # errors that change slowly grow with those that do not: a track that scatters more than it
        # says is worth less throughout
        path = replace(path, std=np.maximum(path.std, scatter))
        fitted, units, residual = _fitted(path, priors)
    values = _outcome(fitted.values, units)
    slope = np.stack(
        [
            (_outcome(fitted.values + step, units) - _outcome(fitted.values - step, units)) / 2e-5
            for step in 1e-5 * np.eye(len(fitted.values))
        ],
        axis=1,
    )
    total = np.diag(slope @ fitted.covariance @ slope.T)
    square = _without(fitted.covariance, ["growth_x", "growth_y"])
    airless = _without(square, ["drag"])
    by_square = np.diag(slope @ square @ slope.T)
    by_noise = np.diag(slope @ airless @ slope.T)
    return FreeFlight(
        float(values[0]),
        float(values[1]),
        float(np.degrees(values[2])),
        np.sqrt(by_noise) * [1.0, 1.0, math.degrees(1.0)],
        np.sqrt(np.maximum(total - by_square, 0.0)) * [1.0, 1.0, math.degrees(1.0)],
        np.sqrt(np.maximum(by_square - by_noise, 0.0)) * [1.0, 1.0, math.degrees(1.0)],
        path,
        residual,
        priors,
    )


@dataclass(frozen=True)
class _Units:
    length: float
    time: float


def _fitted(path: FlightFrames, priors: FreeFlightPriors) -> tuple[Fitted, _Units, FloatArray]:
    units = _Units(
        max(float(np.hypot(*np.ptp(path.place, axis=0))), 1e-12),
        float(path.time[-1] - path.time[0]),
    )
    tau = (path.time - path.time[0]) / units.time
    centre = path.place.mean(axis=0)
    place = (path.place - centre) / units.length
    std = np.maximum(path.std, 0.3 * np.median(path.std, axis=0)) / units.length
    design = _design(tau, place)
    whiten = slow_error_whitening(tau)
    size, size_rows = _size_trend(path, place)
    # the unknowns enter linearly: what turns them into residuals is whitened once
    rows = np.zeros((2 * len(tau) + 2 * len(size), len(_PLACE)))
    seen = np.zeros(len(rows))
    rows[: 2 * len(tau)] = whiten(design / std[..., np.newaxis]).reshape(-1, len(_PLACE))
    seen[: 2 * len(tau)] = whiten(place / std).ravel()
    rows[2 * len(tau) :: 2, -2:], seen[2 * len(tau) :: 2] = size_rows, size

    def residuals(values: FloatArray) -> FloatArray:
        return np.asarray(values @ rows.T - seen)

    start = np.zeros(len(_PLACE))
    for axis in range(2):
        bend, slope, offset = np.polyfit(tau, place[:, axis], 2)
        start[[axis, 2 + axis, 4 + axis]] = offset, slope, 2.0 * bend
    pull = abs(float(start[_PLACE["ay"]]))
    prior = np.zeros(len(_PLACE))
    spread = np.full(len(_PLACE), np.inf)
    prior[_PLACE["drag"]] = priors.drag * units.length
    spread[_PLACE["drag"]] = max(priors.drag_std * units.length, 1e-9)
    spread[_PLACE["ax"]] = max(ROLL_STD * pull, 1e-9)
    spread[[_PLACE["growth_x"], _PLACE["growth_y"]]] = max(priors.growth_std, 1e-9)
    fitted = fit(residuals, start, prior, spread, channels=2, stacked=True)
    left = (place - design @ fitted.values) * units.length
    return fitted, units, left


def _design(tau: FloatArray, place: FloatArray) -> FloatArray:
    """(N, 2, P): place over the unknowns; drag and growth act along the path as it is seen."""
    design = np.zeros((len(tau), 2, len(_PLACE)))
    coefficients = np.polynomial.polynomial.polyfit(tau, place, 3 if len(tau) > 12 else 2)
    derivative = np.polynomial.polynomial.polyder(coefficients)
    grid = np.linspace(0.0, 1.0, 201)
    velocity = np.polynomial.polynomial.polyval(grid, derivative).T
    resist = -np.hypot(*velocity.T)[:, np.newaxis] * velocity
    once = _integral(resist, grid)
    slowed = _integral(once, grid)
    for axis in range(2):
        design[:, axis, axis] = 1.0
        design[:, axis, 2 + axis] = tau
        design[:, axis, 4 + axis] = 0.5 * tau**2
        design[:, axis, _PLACE["drag"]] = np.interp(tau, grid, slowed[:, axis])
        # true place = seen place (1 + growth · seen place): what was seen is short of it by that
        design[:, axis, _PLACE["growth_x"]] = -place[:, 0] * place[:, axis]
        design[:, axis, _PLACE["growth_y"]] = -place[:, 1] * place[:, axis]
    return design


def _integral(values: FloatArray, grid: FloatArray) -> FloatArray:
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(grid)[:, np.newaxis]
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])


def _size_trend(path: FlightFrames, place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The apparent size along the path as observations of the growth: values and rows, whitened.

    A ball of one size shows the depth of the plane: 1 / radius grows as the scale does.
    """
    good = np.isfinite(path.size) & (path.size > 0)
    if good.sum() < LEAST_FRAMES:
        return np.zeros(0), np.zeros((0, 2))
    usual = float(np.median(path.size[good]))
    inverse = usual / path.size[good] - 1.0
    noise = max(
        1.4826 * float(np.median(np.abs(inverse - np.median(inverse)))),
        float(np.median(path.size_std[good])) / usual,
        1e-4,
    )
    seen = place[good] - place[good].mean(axis=0)
    axes = np.linalg.svd(seen, full_matrices=False)[2]
    along = seen @ axes[0]
    reach = float(np.ptp(along))
    slope = float(along @ (inverse - inverse.mean()) / (along @ along))
    std = math.hypot(noise / math.sqrt(float(along @ along)), SIZE_TREND_STD / reach)
    return np.array([slope / std]), axes[:1] / std


def _outcome(values: FloatArray, units: _Units) -> FloatArray:
    """Acceleration, speed at the first frame, angle (rad) above square to the acceleration."""
    v = _Unknowns(*(float(value) for value in values))
    pull = math.hypot(v.ax, v.ay)
    down = np.array([v.ax, v.ay]) / max(pull, 1e-300)
    rising = -(v.vx * down[0] + v.vy * down[1])
    # to the right, square to the acceleration
    across = v.vx * -down[1] + v.vy * down[0]
    signed = pull if v.ay <= 0 else -pull
    if v.ay > 0:
        rising, across = -rising, -across
    speed = math.hypot(v.vx, v.vy)
    return np.array(
        [
            signed * units.length / units.time**2,
            speed * units.length / units.time,
            math.atan2(rising, abs(across)),
        ]
    )


def _without(covariance: FloatArray, names: list[str]) -> FloatArray:
    """Covariance if these unknowns were known exactly."""
    fixed = [_PLACE[name] for name in names]
    free = [index for index in range(len(covariance)) if index not in fixed]
    block = covariance[np.ix_(fixed, fixed)]
    cross = covariance[np.ix_(free, fixed)]
    left = covariance[np.ix_(free, free)] - cross @ np.linalg.pinv(block, hermitian=True) @ cross.T
    out = np.zeros_like(covariance)
    out[np.ix_(free, free)] = left
    return out


def _halves_apart(path: FlightFrames, priors: FreeFlightPriors) -> float:
    """Difference of the two halves' accelerations over its standard uncertainty."""
    half = len(path.time) // 2
    if half < LEAST_FRAMES:
        return 0.0
    found = []
    for part in (slice(0, half), slice(half, None)):
        keep = np.zeros(len(path.time), dtype=bool)
        keep[part] = True
        fitted, units, _ = _fitted(path.where(keep), priors)
        unit = units.length / units.time**2
        variance = fitted.covariance[_PLACE["ay"], _PLACE["ay"]]
        found.append((fitted.values[_PLACE["ay"]] * unit, math.sqrt(variance) * unit))
    (one, one_std), (other, other_std) = found
    return float(abs(one - other) / math.hypot(one_std, other_std))


LINE_FRAMES = 20

"""Frames of a line on one side of the meeting: rolling and sliding slow down little over them."""

LEAST_COLLISION_FRAMES = 4

"""Frames on either side: two give a velocity, two more show whether it is steady."""

CENTRE_STD_SHARE = 0.02

"""Of the radius: how far an outline's centre may lie off the body's, for the line of centres."""


@dataclass(frozen=True)
class Passage:
    """One body on one side of the meeting, by a line or a parabola through its frames.

    Attributes
    ----------
    velocity : (2,) array
        At the meeting, px per unit of time.
    covariance : (2, 2) array
        Its covariance, with the doubt between line and parabola.
    place : (2,) array
        At the meeting, px.
    place_covariance : (2, 2) array
    """

    velocity: FloatArray
    covariance: FloatArray
    place: FloatArray
    place_covariance: FloatArray

    @property
    def speed(self) -> tuple[float, float]:
        """Speed and its standard uncertainty."""
        speed = float(np.hypot(*self.velocity))
        along = self.velocity / speed if speed > 0 else np.array([1.0, 0.0])
        return speed, math.sqrt(float(along @ self.covariance @ along))


@dataclass(frozen=True)
class Collision:
    """Both bodies on both sides; the first is the one that lay still.

    Attributes
    ----------
    time : float
        When they meet, in the unit of the tracks.
    before, after, other_before, other_after : Passage
    cor, cor_std : float
        Parting over approaching speed along the line of centres.
    momentum_apart : float
        Change of the total momentum of two like bodies over its standard uncertainty.
    """

    time: float
    before: Passage
    after: Passage
    other_before: Passage
    other_after: Passage
    cor: float
    cor_std: float
    momentum_apart: float


def fit_collision(ball: Track, other: Track, time: float, clock: FloatArray) -> Collision:
    """Fit a line to each body on each side of the meeting, never across it.

    Parameters
    ----------
    ball, other : Track
        Tracks of both, px.
    time : float
        When they meet, in the unit of `clock`.
    clock : (F,) array
        Time of each frame of the clip: s, or frames.

    Raises
    ------
    TooLittleDataError
        If one of them is not seen on both sides.
    """
    step = float(np.median(np.diff(clock)))
    sides = [
        _passage(track, clock, time, side, step, name)
        for track, name in ((ball, "the ball struck"), (other, "the ball that strikes"))
        for side in (-1, 1)
    ]
    before, other_before = sides[0], sides[2]

    def restitution(moved: list[FloatArray], line: FloatArray) -> float:
        normal = line / np.hypot(*line)
        approach = float((moved[2] - moved[0]) @ normal)
        return float((moved[1] - moved[3]) @ normal) / approach

    velocities = [side.velocity for side in sides]
    line = before.place - other_before.place
    reach = float(np.hypot(*line))
    cor = restitution(velocities, line)
    variance = 0.0
    for index, side in enumerate(sides):
        for value, vector in zip(*np.linalg.eigh(side.covariance), strict=True):
            moved = list(velocities)
            moved[index] = moved[index] + math.sqrt(max(value, 0.0)) * vector
            variance += (restitution(moved, line) - cor) ** 2
    across = np.array([-line[1], line[0]]) / reach
    spread = before.place_covariance + other_before.place_covariance
    centres = CENTRE_STD_SHARE * 0.5 * reach
    shift = math.sqrt(float(across @ spread @ across) + 2.0 * centres**2)
    variance += (restitution(velocities, line + shift * across) - cor) ** 2
    return Collision(
        time,
        before,
        sides[1],
        other_before,
        sides[3],
        cor,
        math.sqrt(variance),
        _momentum_apart(sides),
    )


def _momentum_apart(sides: list[Passage]) -> float:
    """Change of v + v' over its standard uncertainty: like bodies keep it."""
    before, after, other_before, other_after = sides
    change = after.velocity + other_after.velocity - before.velocity - other_before.velocity
    covariance = sum((side.covariance for side in sides), np.zeros((2, 2)))
    return math.sqrt(float(change @ np.linalg.pinv(covariance, hermitian=True) @ change) / 2.0)


def _passage(
    track: Track, clock: FloatArray, time: float, side: int, step: float, name: str
) -> Passage:
    at = clock[track.frame] - time
    used = (side * at > 0.6 * step) & (side * at < (LINE_FRAMES + 0.6) * step)
    if used.sum() < LEAST_COLLISION_FRAMES:
        where = "before" if side < 0 else "after"
        raise TooLittleDataError(
            f"{name} is seen in only {used.sum()} frames just {where} they meet",
            hint="Film both for five frames on each side of the meeting.",
        )
    elapsed, place = at[used] / step, track.centre_px[used]
    std = np.sqrt(0.5 * np.trace(track.covariance_px2[used], axis1=1, axis2=2))
    straight = _line(elapsed, place, std, 1)
    if used.sum() < 2 * LEAST_COLLISION_FRAMES:
        return _in_time(straight, np.zeros(2), step)
    # a body that slows down: the parabola is right where it matters, and costs where it does not
    bent = _line(elapsed, place, std, 2)
    bend, bend_var = bent[2]
    telling = bool(np.any(np.abs(bend) > 3.0 * np.sqrt(bend_var)))
    chosen, rival = (bent, straight) if telling else (straight, bent)
    doubt = np.zeros(2) if telling else 0.5 * (rival[0][1] - chosen[0][1])
    return _in_time(chosen, doubt, step)


_Line = tuple[FloatArray, FloatArray, tuple[FloatArray, FloatArray]]


def _line(elapsed: FloatArray, place: FloatArray, std: FloatArray, degree: int) -> _Line:
    """Coefficients (D+1, 2), their covariance (D+1, D+1, 2), and the bend with its variance."""
    design = elapsed[:, np.newaxis] ** np.arange(degree + 1)
    weight = 1.0 / np.maximum(std, 0.3 * float(np.median(std)))
    rows = design * weight[:, np.newaxis]
    normal = np.linalg.inv(rows.T @ rows)
    best = normal @ rows.T @ (place * weight[:, np.newaxis])
    left = (place - design @ best) * weight[:, np.newaxis]
    freedom = max(len(elapsed) - degree - 1, 1)
    scatter = np.maximum((left**2).sum(axis=0) / freedom, 1.0)
    covariance = normal[:, :, np.newaxis] * scatter
    bend = best[2] if degree == 2 else np.zeros(2)
    bend_var = covariance[2, 2] if degree == 2 else np.full(2, np.inf)
    return best, covariance, (bend, bend_var)


def _in_time(line: _Line, doubt: FloatArray, step: float) -> Passage:
    best, covariance, _ = line
    spread = np.diag(covariance[1, 1]) + np.outer(doubt, doubt)
    return Passage(best[1] / step, spread / step**2, best[0], np.diag(covariance[0, 0]))


LEAST_SWING_FRAMES = 12

"""Frames: a damped swing has five unknowns and each frame one number; more than half are to
spare."""

LEAST_PERIODS = 0.75

"""Below, a part of a swing tells neither its middle nor its amplitude, and so no period."""

_TRIALS_PER_PERIOD = 12

"""Trial frequencies per resolution of the record (one over its length): the nearest misses 0.6 % of
the peak at most, 1 − sinc²(1/24)."""

_MOST_MISFIT = 0.25

"""Of the amplitude: what misses a damped swing by more does not swing freely."""

FLAT_DAMPING_STD = 1.0

"""Decay over one period that nobody expects to be exceeded by what swings freely, 1."""


@dataclass(frozen=True)
class FreeSwing:
    """A damped swing, fitted; time in the unit of the track.

    Attributes
    ----------
    period, period_std : float
        Of one full swing, at the amplitude seen.
    damping, damping_std : float
        Rate at which the amplitude decays, over the unit of time.
    amplitude : float
        At the first frame, in the unit of the places.
    periods : float
        How many are seen.
    """

    period: float
    period_std: float
    damping: float
    damping_std: float
    amplitude: float
    periods: float


@dataclass(frozen=True)
class _SwingVector:
    """Names of the fitted vector; phase in turns, rates over the stretch."""

    cosine: float
    sine: float
    middle: float
    turns: float
    decay: float


def fit_free_swing(time: FloatArray, place: FloatArray, std: FloatArray) -> FreeSwing:
    """Fit a damped swing to the way along the line that it swings on.

    Parameters
    ----------
    time : (N,) array
        s or frames.
    place : (N, 2) array
        px or m.
    std : (N,) array
        Random standard uncertainty along one axis.

    Raises
    ------
    TooLittleDataError, NotFoundError
        If less than three quarters of a swing is seen, or it is no free swing.
    """
    if len(time) < LEAST_SWING_FRAMES:
        raise TooLittleDataError(
            f"the swing is seen in only {len(time)} frames", hint="Film more of it."
        )
    centred = place - place.mean(axis=0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    span = float(time[-1] - time[0])
    tau = (time - time[0]) / span
    floor = np.maximum(std, 0.3 * float(np.median(std)))

    def model(values: FloatArray) -> FloatArray:
        v = _SwingVector(*values)
        angle = 2.0 * np.pi * v.turns * tau
        wave = v.cosine * np.cos(angle) + v.sine * np.sin(angle)
        return np.asarray(v.middle + np.exp(-np.clip(v.decay, -20.0, 20.0) * tau) * wave)

    start = _start(tau, along)
    turns = start[_INDEX["turns"]]
    spread = np.array([np.inf, np.inf, np.inf, np.inf, max(FLAT_DAMPING_STD * turns, 0.1)])
    prior = np.array(start)
    prior[_INDEX["decay"]] = 0.0
    fitted = fit(lambda values: (model(values) - along) / floor, start, prior, spread)
    found = _SwingVector(*(float(value) for value in fitted.values))
    amplitude = math.hypot(found.cosine, found.sine)
    off = float(np.median(np.abs(model(fitted.values) - along)))
    if found.turns <= 0 or off > _MOST_MISFIT * amplitude:
        raise NotFoundError(
            "what comes and goes does not swing freely: no damped swing fits it",
            hint="Film several swings without a touch, or say what is to be measured.",
        )
    if found.turns < LEAST_PERIODS:
        raise TooLittleDataError(
            f"only {found.turns:.2f} of a full swing is in view", hint="Film a whole swing."
        )
    turn_std = math.sqrt(float(fitted.covariance[_INDEX["turns"], _INDEX["turns"]]))
    decay_std = math.sqrt(float(fitted.covariance[_INDEX["decay"], _INDEX["decay"]]))
    return FreeSwing(
        span / found.turns,
        span / found.turns * turn_std / found.turns,
        found.decay / span,
        decay_std / span,
        amplitude,
        found.turns,
    )


_INDEX = {name: index for index, name in enumerate(_SwingVector.__annotations__)}


def _start(tau: FloatArray, along: FloatArray) -> list[float]:
    """The strongest frequency, and the swing of that frequency that fits best."""
    # imported where it is used: few clips show a swing, and it takes long to import
    from scipy.signal import lombscargle

    most = max(2.0, len(tau) / 4.0)
    trial = np.arange(0.5, most, 1.0 / _TRIALS_PER_PERIOD)
    power = lombscargle(tau, along, 2.0 * np.pi * trial, floating_mean=True)
    turns = float(trial[int(np.argmax(power))])
    angle = 2.0 * np.pi * turns * tau
    design = np.stack([np.cos(angle), np.sin(angle), np.ones_like(tau)], axis=1)
    cosine, sine, middle = np.linalg.lstsq(design, along, rcond=None)[0]
    return [float(cosine), float(sine), float(middle), turns, 0.0]


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

_OTHER_BALL = "is it the ball? (--ball-at in a clip, --columns ball=NAME among tracks)"

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
    diameter : (2,) tuple of float or None
        Of the ball, m, with its relative standard uncertainty, where something else than it tells
        the scale.
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
    diameter: tuple[float, float] | None = None

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
    budget = _Lines.of(flight, in_frames, ball).budget(0, in_frames)
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


def require_upright(tracks: Tracks) -> None:
    """Refuse a clip in which things fall sideways or up: nothing tells where down is but the fall.

    Raises
    ------
    NotFoundError
        If what falls does so more aslant than any camera is held that is meant to be upright.
    """
    fall = tracks.motion.fall_px
    if fall is None or fall[1] > abs(fall[0]):
        return
    side = "top" if -fall[1] > abs(fall[0]) else "right" if fall[0] > 0 else "left"
    raise NotFoundError(
        f"what was followed falls towards the {side} of the picture: the camera lay on its side,"
        " the file lost how it is to be turned, or it is not the ball in flight",
        hint="Turn the clip so that the ball falls down, and measure that; where the camera stood "
        "upright, point at the ball with --ball-at X,Y.",
    )


def _falling(tracks: Tracks, scene: MotionScene) -> MotionResults:
    require_upright(tracks)
    ball = applicable(tracks)
    flight = flight_of(ball, scene)
    values, lines = flight.outcome, _Lines.of(flight, scene, ball)
    budgets = [lines.budget(index, scene) for index in range(3)]
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
    size = _size(ball, scene)
    if size is not None and size.outcome is CheckOutcome.FAILED:
        # another scale, or another thing: a length is right in neither case
        hangs = {QuantityName.FALL_ACCELERATION, QuantityName.FLIGHT_SPEED}
        doubt = Contradiction(frozenset(hangs), math.inf, True, size.statement)
        found = doubted(found, [doubt])
    checks = [one for one in (steady, by_gravity, size) if one is not None]
    return MotionResults(found, tuple(checks), gravity)


def _size(ball: Track, scene: MotionScene) -> Check | None:
    """Whether what was followed is as large as the ball is said to be, where a scale is given."""
    if scene.diameter is None or scene.scale is None:
        return None
    looks = 2.0 * float(np.median(ball.radius_px)) * scene.scale.metres_per_px
    told, share = scene.diameter
    share = float(np.linalg.norm([share, scene.scale.share, _OUTLINED]))
    advice = (
        f"a part of it was followed, or another thing: {_OTHER_BALL}; or check --ball and --scale"
    )
    return size_at_scale(looks, share, told, advice)


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
    power = float(scipy.special.ndtr(-_GRAVITY_SIGMAS + RELEVANT_SHARE * scene.gravity / fall.std))
    outcome = CheckOutcome.PASSED if power >= LEAST_POWER else CheckOutcome.UNDECIDED
    if off > _GRAVITY_SIGMAS * fall.std:
        outcome = CheckOutcome.FAILED
        rises = abs(fall.value + scene.gravity) <= _GRAVITY_SIGMAS * fall.std
        advice = (
            "it falls upwards as fast as it should fall down: does y point down in this table, or"
            " is the picture upside down?"
            if rises
            else f"check --fps (another rate than {scene.fps:g} fps?) and the scale, and that it"
            " falls freely"
        )
        text += f", not {scene.gravity:.2f}: {advice}"
    elif outcome is CheckOutcome.UNDECIDED:
        text += ": too unsure to tell anything of rate and scale"
    return gravity, Check(CheckKind.GRAVITY, outcome, text, power)


@dataclass(frozen=True)
class _Lines:
    """Budget lines of acceleration, speed and angle of a flight.

    Attributes
    ----------
    flight : FreeFlight
    apart : tuple of (source, (3,) array)
        By how much the three change with each step of the mapping.
    """

    flight: FreeFlight
    apart: tuple[tuple[UncertaintySource, FloatArray], ...]

    @classmethod
    def of(cls, flight: FreeFlight, scene: MotionScene, ball: Track) -> "_Lines":
        moved = [(source, flight_of(ball, scene, to)) for source, to in scene.mapping_steps]
        return cls(
            flight, tuple((source, np.abs(o.outcome - flight.outcome)) for source, o in moved)
        )

    def budget(self, index: int, scene: MotionScene) -> tuple[Contribution, ...]:
        flight = self.flight
        lines = [
            Contribution(UncertaintySource.TRACK_NOISE, float(flight.noise[index])),
            Contribution(UncertaintySource.CAMERA_SLANT, float(flight.perspective[index])),
            Contribution(UncertaintySource.DRAG, float(flight.air[index])),
        ]
        powers = {0: (1.0, 2.0), 1: (1.0, 1.0), 2: (0.0, 0.0)}[index]
        if scene.scale is not None:
            share = powers[0] * scene.scale.share * abs(float(flight.outcome[index]))
            lines.append(Contribution(scene.scale.source, share))
        if scene.timed:
            clock = powers[1] * scene.fps_std / scene.fps * abs(float(flight.outcome[index]))
            lines.append(Contribution(UncertaintySource.CAPTURE_RATE, clock))
        lines += [Contribution(source, float(by[index])) for source, by in self.apart]
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
            f" flight, {100 * off_by:.1f} % of its length off; {_OTHER_BALL}",
        )
    if flight.halves_apart > _STEADY_SIGMAS:
        return Check(
            CheckKind.STEADY_FALL,
            CheckOutcome.FAILED,
            f"what was followed does not fall freely: {text}; {_OTHER_BALL}",
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
