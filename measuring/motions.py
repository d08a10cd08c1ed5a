"""Quantities of flight, roll, collision and swing.

If the camera is not square to the plane of motion, the scale changes along the path: over a drop
that fills the picture, 1° of slant mimics 2 % of acceleration. A slant also bends the path and
changes the ball's apparent size; both are fitted together with the flight, which is linear in all
unknowns.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from measuring.checks import (
    MAX_CONTRADICTION,
    Check,
    CheckKind,
    CheckOutcome,
    Contradiction,
    apply_contradictions,
    size_at_scale,
)
from measuring.flight_fit import slow_error_whitening
from measuring.impact import disc_contact
from measuring.inputs import QUANTITY_UNITS, QuantityName, in_pixels
from metrology import (
    Contribution,
    MeasurementError,
    NotFoundError,
    Quantity,
    TooLittleDataError,
    UncertaintySource,
)
from metrology.least_squares import Fitted, fit
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
    "rate_from_gravity",
    "require_upright",
    "running_integral",
    "steady_stretch",
]

FloatArray = NDArray[np.float64]

MIN_FLIGHT_FRAMES = 6
"""Frames: a parabola in two dimensions has six unknowns, each frame two values (derived: twice as
many values as unknowns)."""

_RADIUS_RELATIVE_STD = 0.15
"""Relative rms error of radii of blurred, half-lit or small balls (fitted: recordings annotated by
others)."""

_MIDDLE_FRACTION = 0.6
"""Central fraction of the frames that is surely free of throw and bounce (chosen)."""

_OFF_SIGMAS = 5.0
"""Standard deviations (chosen): no frame in a thousand exceeds it by chance."""

ROLL_STD = math.radians(1.5)
"""rad, std of the roll of a camera set up by eye (assumed)."""

SIZE_TREND_STD = 0.01
"""Relative std of the change of apparent radius that light and blur cause along a path (chosen)."""


@dataclass(frozen=True)
class FlightFrames:
    """Frames of a free flight, in one plane.

    Attributes
    ----------
    time : (N,) array
        s, or frames if the rate is unknown.
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
        """Rows selected by `keep` (N,)."""
        return FlightFrames(
            self.time[keep], self.place[keep], self.std[keep], self.size[keep], self.size_std[keep]
        )


@dataclass(frozen=True)
class FreeFlightPriors:
    """Priors of a free flight.

    Attributes
    ----------
    drag, drag_std : float
        K = ρ S C_D / 2 m, per unit of length.
    growth_std : float
        Relative change of scale along the path, from the camera's unknown slant; 0 if a
        calibration corrects perspective.
    """

    drag: float
    drag_std: float
    growth_std: float


@dataclass(frozen=True)
class _Unknowns:
    """Fitted vector, scaled by the path's length and duration, at its first frame."""

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
        Fall acceleration (positive downwards), speed at the first frame, and its angle above the
        normal to the acceleration; in the units of the path.
    noise, perspective, air : (3,) arrays
        Standard uncertainties of these three from track noise, camera slant and drag.
    path : FlightFrames
        Frames used.
    residual : (N, 2) array
        Measured minus fitted.
    priors : FreeFlightPriors
        Priors used.
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
    def _halves(self) -> tuple[float, float]:
        return _halves_difference(self.path, self.priors)

    @property
    def halves_difference(self) -> float:
        """Difference of the accelerations of both halves, in standard uncertainties."""
        difference, std = self._halves
        return difference / std

    @property
    def change(self) -> FloatArray:
        """Change of acceleration, speed and angle (3,) if the acceleration changes along the line.

        A parabola fitted to a cubic of duration T whose halves differ by D in acceleration errs by
        D T / 5 in the speed at its beginning.
        """
        difference, std = self._halves
        apart = math.sqrt(max(difference**2 - std**2, 0.0)) if math.isfinite(std) else 0.0
        duration = float(self.path.time[-1] - self.path.time[0])
        return np.array([0.5 * apart, 0.2 * apart * duration, 0.0])

    @property
    def length(self) -> float:
        """Distance between the ends of the path, in its unit."""
        return float(np.hypot(*np.ptp(self.path.place, axis=0)))


def steady_stretch(path: FlightFrames) -> FlightFrames:
    """The longest run around the middle that fits one parabola: no hand, no bounce.

    Raises
    ------
    TooLittleDataError
        With fewer than six frames.
    """
    count = len(path.time)
    if count < MIN_FLIGHT_FRAMES:
        raise TooLittleDataError(
            f"the flight is visible in only {count} frames",
            hint="Film so that it stays in view for longer, or at a higher frame rate.",
        )
    kept = np.ones(count, dtype=bool)
    for _ in range(4):
        time = path.time - path.time[kept].mean()
        order = np.flatnonzero(kept)
        margin = int(0.5 * (1.0 - _MIDDLE_FRACTION) * len(order))
        middle = (
            order[margin : len(order) - margin] if len(order) > 2 * MIN_FLIGHT_FRAMES else order
        )
        off = _off(path, time, middle)
        near = _run_about(off < _OFF_SIGMAS, int(middle[len(middle) // 2]))
        done = np.array_equal(near, kept) or not near.any()
        kept = near
        if done:
            break
    if kept.sum() < MIN_FLIGHT_FRAMES:
        raise TooLittleDataError(
            "no six consecutive frames fit one free flight",
            hint="Point at the ball with --ball-at X,Y,FRAME.",
        )
    return path.where(
        kept & (_off(path, path.time - path.time[kept].mean(), np.flatnonzero(kept)) < _OFF_SIGMAS)
    )


def _off(path: FlightFrames, time: FloatArray, used: NDArray[np.intp]) -> FloatArray:
    """Residual of each frame from a parabola through some frames, in standard uncertainties."""
    design = np.stack([np.ones_like(time), time, time**2], axis=1)
    worst = np.zeros(len(time))
    for axis in range(2):
        std = np.maximum(path.std[:, axis], 0.3 * float(np.median(path.std[:, axis])))
        rows = design[used] / std[used, np.newaxis]
        best = np.linalg.lstsq(rows, path.place[used, axis] / std[used], rcond=None)[0]
        left = path.place[:, axis] - design @ best
        residual_std = 1.4826 * float(np.median(np.abs(left[used] / std[used])))
        covariance = np.linalg.pinv(rows.T @ rows)
        predicted = np.einsum("ni,ij,nj->n", design, covariance, design)
        spread = max(residual_std, 1.0) * np.sqrt(std**2 + predicted)
        worst = np.maximum(worst, np.abs(left) / spread)
    return worst


def _run_about(good: NDArray[np.bool_], centre: int) -> NDArray[np.bool_]:
    """The run of good frames around one of them; single outliers do not end it."""
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


def fit_free_flight(
    path: FlightFrames, priors: FreeFlightPriors, *, whole: bool = False
) -> FreeFlight:
    """Fit flight, slant of the camera and drag to the frames of a free flight.

    Parameters
    ----------
    path : FlightFrames
        Any unit of length and time.
    whole : bool
        Whether all frames are fitted, instead of those alone that fit one parabola.

    Raises
    ------
    TooLittleDataError
        If fewer than six frames fit one flight.
    """
    path = path if whole and len(path.time) >= MIN_FLIGHT_FRAMES else steady_stretch(path)
    fitted, units, residual = _fitted(path, priors)
    residual_std = np.sqrt((residual**2).sum(axis=0) / max(len(residual) - 3, 1))
    if np.any(residual_std > np.median(path.std, axis=0)):
        # slowly varying errors scale with random ones: a track noisier than stated is less
        # accurate throughout
        path = replace(path, std=np.maximum(path.std, residual_std))
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
    # the unknowns are linear: their design matrix is whitened once
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
    """Design matrix (N, 2, P): drag and growth act along the observed path."""
    design = np.zeros((len(tau), 2, len(_PLACE)))
    coefficients = np.polynomial.polynomial.polyfit(tau, place, 3 if len(tau) > 12 else 2)
    derivative = np.polynomial.polynomial.polyder(coefficients)
    grid = np.linspace(0.0, 1.0, 201)
    velocity = np.polynomial.polynomial.polyval(grid, derivative).T
    resist = -np.hypot(*velocity.T)[:, np.newaxis] * velocity
    once = running_integral(resist, grid)
    slowed = running_integral(once, grid)
    for axis in range(2):
        design[:, axis, axis] = 1.0
        design[:, axis, 2 + axis] = tau
        design[:, axis, 4 + axis] = 0.5 * tau**2
        design[:, axis, _PLACE["drag"]] = np.interp(tau, grid, slowed[:, axis])
        # true position = observed position (1 + growth · observed position)
        design[:, axis, _PLACE["growth_x"]] = -place[:, 0] * place[:, axis]
        design[:, axis, _PLACE["growth_y"]] = -place[:, 1] * place[:, axis]
    return design


def running_integral(values: FloatArray, grid: FloatArray) -> FloatArray:
    """Integral (N, K) of values (N, K) from the beginning of a grid (N,) on."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(grid)[:, np.newaxis]
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])


def _size_trend(path: FlightFrames, place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Whitened observations of the scale's growth from the apparent size: values and rows.

    For a ball of constant size 1 / radius grows as the scale does.
    """
    good = np.isfinite(path.size) & (path.size > 0)
    if good.sum() < MIN_FLIGHT_FRAMES:
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
    extent = float(np.ptp(along))
    slope = float(along @ (inverse - inverse.mean()) / (along @ along))
    std = math.hypot(noise / math.sqrt(float(along @ along)), SIZE_TREND_STD / extent)
    return np.array([slope / std]), axes[:1] / std


def _outcome(values: FloatArray, units: _Units) -> FloatArray:
    """Acceleration, speed at the first frame, and its angle (rad) above the normal to it."""
    v = _Unknowns(*(float(value) for value in values))
    pull = math.hypot(v.ax, v.ay)
    down = np.array([v.ax, v.ay]) / max(pull, 1e-300)
    rising = -(v.vx * down[0] + v.vy * down[1])
    # to the right, normal to the acceleration
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


def _halves_difference(path: FlightFrames, priors: FreeFlightPriors) -> tuple[float, float]:
    """Difference of the two halves' accelerations, and its standard uncertainty."""
    half = len(path.time) // 2
    if half < MIN_FLIGHT_FRAMES:
        return 0.0, math.inf
    found = []
    for part in (slice(0, half), slice(half, None)):
        keep = np.zeros(len(path.time), dtype=bool)
        keep[part] = True
        fitted, units, _ = _fitted(path.where(keep), priors)
        unit = units.length / units.time**2
        variance = fitted.covariance[_PLACE["ay"], _PLACE["ay"]]
        found.append((fitted.values[_PLACE["ay"]] * unit, math.sqrt(variance) * unit))
    (one, one_std), (other, other_std) = found
    return float(abs(one - other)), math.hypot(one_std, other_std)


COLLISION_LINE_FRAMES = 20
"""Frames of a line on one side of the collision (chosen; bodies hardly slow down over them)."""

MIN_COLLISION_FRAMES = 4
"""Frames on each side: two give a velocity, two more test it (derived)."""

CENTRE_STD_FRACTION = 0.02
"""Of the radius: std of an outline's centre from the body's, for the line of centres (chosen)."""


@dataclass(frozen=True)
class Passage:
    """One body on one side of the collision, by a line or a parabola through its frames.

    Attributes
    ----------
    velocity : (2,) array
        At the collision, px per unit of time.
    covariance : (2, 2) array
        Its covariance, including the choice between line and parabola.
    place : (2,) array
        At the collision, px.
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
    """Both bodies on both sides; the first is the one initially at rest.

    Attributes
    ----------
    time : float
        Time of the collision, in the unit of the tracks.
    cor, cor_std : float
        Separation speed over approach speed along the line of centres.
    momentum_change : float
        Change of the total momentum of two equal bodies over its standard uncertainty.
    """

    time: float
    before: Passage
    after: Passage
    other_before: Passage
    other_after: Passage
    cor: float
    cor_std: float
    momentum_change: float


def fit_collision(ball: Track, other: Track, time: float, clock: FloatArray) -> Collision:
    """Fit a line to each body on each side of the collision, never across it.

    Parameters
    ----------
    ball, other : Track
        Tracks of both, px.
    time : float
        Time of the collision, in the unit of `clock`.
    clock : (F,) array
        Time of each frame of the clip: s or frames.

    Raises
    ------
    TooLittleDataError
        If one of them is not visible on both sides.
    """
    step = float(np.median(np.diff(clock)))
    sides = [
        _passage(track, clock, time, side, step, name)
        for track, name in ((ball, "the struck ball"), (other, "the striking ball"))
        for side in (-1, 1)
    ]
    before, other_before = sides[0], sides[2]

    def restitution(moved: list[FloatArray], line: FloatArray) -> float:
        normal = line / np.hypot(*line)
        approach = float((moved[2] - moved[0]) @ normal)
        return float((moved[1] - moved[3]) @ normal) / approach

    velocities = [side.velocity for side in sides]
    line = before.place - other_before.place
    distance = float(np.hypot(*line))
    cor = restitution(velocities, line)
    variance = 0.0
    for index, side in enumerate(sides):
        for value, vector in zip(*np.linalg.eigh(side.covariance), strict=True):
            moved = list(velocities)
            moved[index] = moved[index] + math.sqrt(max(value, 0.0)) * vector
            variance += (restitution(moved, line) - cor) ** 2
    across = np.array([-line[1], line[0]]) / distance
    spread = before.place_covariance + other_before.place_covariance
    centres = CENTRE_STD_FRACTION * 0.5 * distance
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
        _momentum_change(sides),
    )


def _momentum_change(sides: list[Passage]) -> float:
    """Change of v + v' over its standard uncertainty: zero for equal bodies."""
    before, after, other_before, other_after = sides
    change = after.velocity + other_after.velocity - before.velocity - other_before.velocity
    covariance = sum((side.covariance for side in sides), np.zeros((2, 2)))
    return math.sqrt(float(change @ np.linalg.pinv(covariance, hermitian=True) @ change) / 2.0)


def _passage(
    track: Track, clock: FloatArray, time: float, side: int, step: float, name: str
) -> Passage:
    at = clock[track.frame] - time
    used = (side * at > 0.6 * step) & (side * at < (COLLISION_LINE_FRAMES + 0.6) * step)
    if used.sum() < MIN_COLLISION_FRAMES:
        where = "before" if side < 0 else "after"
        raise TooLittleDataError(
            f"{name} is visible in only {used.sum()} frames just {where} the collision",
            hint="Film both for five frames on each side of the collision.",
        )
    elapsed, place = at[used] / step, track.centre_px[used]
    std = np.sqrt(0.5 * np.trace(track.covariance_px2[used], axis1=1, axis2=2))
    straight = _line(elapsed, place, std, 1)
    if used.sum() < 2 * MIN_COLLISION_FRAMES:
        return _in_time(straight, np.zeros(2), step)
    # for a body that slows down the parabola is right; otherwise it only costs precision
    bent = _line(elapsed, place, std, 2)
    bend, bend_var = bent[2]
    significant = bool(np.any(np.abs(bend) > 3.0 * np.sqrt(bend_var)))
    chosen, other_fit = (bent, straight) if significant else (straight, bent)
    model_std = np.zeros(2) if significant else 0.5 * (other_fit[0][1] - chosen[0][1])
    return _in_time(chosen, model_std, step)


_Line = tuple[FloatArray, FloatArray, tuple[FloatArray, FloatArray]]


def _line(elapsed: FloatArray, place: FloatArray, std: FloatArray, degree: int) -> _Line:
    """Coefficients (D+1, 2), covariance (D+1, D+1, 2), and quadratic term with its variance."""
    design = elapsed[:, np.newaxis] ** np.arange(degree + 1)
    weight = 1.0 / np.maximum(std, 0.3 * float(np.median(std)))
    rows = design * weight[:, np.newaxis]
    normal = np.linalg.inv(rows.T @ rows)
    best = normal @ rows.T @ (place * weight[:, np.newaxis])
    left = (place - design @ best) * weight[:, np.newaxis]
    freedom = max(len(elapsed) - degree - 1, 1)
    residual_std = np.maximum((left**2).sum(axis=0) / freedom, 1.0)
    covariance = normal[:, :, np.newaxis] * residual_std
    bend = best[2] if degree == 2 else np.zeros(2)
    bend_var = covariance[2, 2] if degree == 2 else np.full(2, np.inf)
    return best, covariance, (bend, bend_var)


def _in_time(line: _Line, model_std: FloatArray, step: float) -> Passage:
    best, covariance, _ = line
    spread = np.diag(covariance[1, 1]) + np.outer(model_std, model_std)
    return Passage(best[1] / step, spread / step**2, best[0], np.diag(covariance[0, 0]))


MIN_FREE_SWING_FRAMES = 12
"""Frames: a damped swing has five unknowns (derived: more than twice as many values)."""

MIN_PERIODS = 0.75
"""Periods below which midpoint, amplitude and period are degenerate (chosen)."""

_TRIALS_PER_PERIOD = 12
"""Trial frequencies per resolution of the record (derived: the nearest misses at most 0.6 % of the
peak, 1 − sinc²(1/24))."""

_MAX_SWING_MISFIT = 0.25
"""Median residual over the amplitude beyond which a swing is not free (chosen)."""

FLAT_DAMPING_STD = 1.0
"""Dimensionless std of the prior of the decay over one period (chosen; wide for free swings)."""


@dataclass(frozen=True)
class FreeSwing:
    """A damped swing, fitted; time in the unit of the track.

    Attributes
    ----------
    period, period_std : float
        Of one full swing, at the observed amplitude.
    damping, damping_std : float
        Decay rate of the amplitude, per unit of time.
    amplitude : float
        At the first frame, in the unit of the positions.
    periods : float
        Number of periods in view.
    """

    period: float
    period_std: float
    damping: float
    damping_std: float
    amplitude: float
    periods: float


@dataclass(frozen=True)
class _SwingVector:
    """Fitted vector; phase in turns, rates over the duration."""

    cosine: float
    sine: float
    middle: float
    turns: float
    decay: float


def fit_free_swing(time: FloatArray, place: FloatArray, std: FloatArray) -> FreeSwing:
    """Fit a damped swing to the motion along its main axis.

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
        If less than three quarters of a swing is in view, or it is not free.
    """
    if len(time) < MIN_FREE_SWING_FRAMES:
        raise TooLittleDataError(
            f"the swing is visible in only {len(time)} frames", hint="Film more of it."
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
    if found.turns <= 0 or off > _MAX_SWING_MISFIT * amplitude:
        raise NotFoundError(
            "the oscillation is not a free swing: no damped swing fits it",
            hint="Film several swings without touching it.",
        )
    if found.turns < MIN_PERIODS:
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
    """Start values: the strongest frequency, and the best swing at it."""
    most = max(2.0, len(tau) / 4.0)
    trial = np.arange(0.5, most, 1.0 / _TRIALS_PER_PERIOD)
    angle = 2.0 * np.pi * np.multiply.outer(trial, tau)
    designs = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)], axis=-1)
    # the part of the motion that a swing about a free middle explains (Lomb and Scargle's power)
    explained = (along @ np.linalg.qr(designs)[0]) ** 2
    best = int(np.argmax(explained.sum(axis=-1)))
    turns = float(trial[best])
    cosine, sine, middle = np.linalg.lstsq(designs[best], along, rcond=None)[0]
    return [float(cosine), float(sine), float(middle), turns, 0.0]


Mapping = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

_HORIZONTAL_SLANT = math.radians(6.0)
"""rad, std of the slant of a camera set up by eye (assumed)."""

MIN_FOCAL_OVER_SIZE = 0.9
"""Focal length over the longer side of the picture, of the widest lens expected (58° of view)."""

UNKNOWN_DRAG_OVER_PATH = 0.03
"""K times path length for an unknown ball (chosen: a tennis ball over two metres)."""

_MAX_ANGLE_STD_DEG = 20.0
"""deg, maximum std of a stated direction (chosen)."""

_STEADY_SIGMAS = 4.0
"""Standard deviations between both halves of a flight (convention: exceeded by 1 in 16 000)."""

_OTHER_BALL = "check that the ball was tracked (clip: --ball-at X,Y; tracks: --columns ball=NAME)"

_MIN_FLIGHT_FRACTION = 0.6
"""Minimum fraction of the frames that a motion must explain (chosen)."""

_MAX_RELATIVE_RESIDUAL = 0.01
"""Maximum median residual over path length (chosen; outlines are better, arcs worse)."""

_MOMENTUM_SIGMAS = 4.0
"""Standard deviations (convention: exceeded by 1 collision in 16 000)."""

_GRAVITY_SIGMAS = 3.0
"""Standard deviations (convention: exceeded by 1 flight in 370)."""

MIN_GRAVITY_POWER = 0.5
"""Minimum probability of detecting a relevant deviation for a check to pass (chosen)."""

RELEVANT_FRACTION = 0.1
"""Of gravity: deviation that a check of rate and scale must be able to detect (chosen)."""


@dataclass(frozen=True)
class PlaneScale:
    """Metres per pixel in the plane of motion.

    Attributes
    ----------
    relative_std : float
        Relative standard uncertainty.
    """

    metres_per_px: float
    relative_std: float
    source: UncertaintySource


@dataclass(frozen=True)
class MotionScene:
    """Conversion from pixels and frames to metres and seconds.

    Attributes
    ----------
    clock : (F,) array
        Times of all frames of the clip, in frames.
    fps, fps_std : float
        Frame rate; the std is infinite if it is unknown.
    scale : PlaneScale or None
        None with a calibration, or without any scale.
    mapping : callable or None
        Outline centres and covariances to metres through a calibrated camera.
    mapping_steps : tuple of (source, callable)
        The same with each input of the calibration changed by one standard deviation.
    drag : (2,) tuple of float
        K with its standard uncertainty, 1/m.
    gravity : float
        m/s².
    size : float
        Longer side of the picture, px.
    rate_from_fall : bool
        Whether the rate was estimated from this fall.
    diameter : (2,) tuple of float or None
        Of the ball, m, with its relative standard uncertainty, if the scale has another source.
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
        """Whether the frame rate is known."""
        return math.isfinite(self.fps_std)

    @property
    def metric(self) -> bool:
        """Whether a scale is known."""
        return self.scale is not None or self.mapping is not None


@dataclass(frozen=True)
class MotionResults:
    """Measured quantities of a motion; `gravity` is its fall, which checks rate and scale."""

    quantities: dict[str, Quantity] = field(default_factory=dict)
    checks: tuple[Check, ...] = ()
    gravity: Quantity | None = None


def motion_quantities(tracks: Tracks, scene: MotionScene) -> MotionResults:
    """Quantities of the observed motion; those of other motions are left to the caller."""
    kind = tracks.motion.measured_as
    try:
        if kind in (MotionKind.FLIGHT, MotionKind.DROP):
            return _falling(tracks, scene)
        if kind in (MotionKind.ROLL, MotionKind.SLIDE):
            return _rolling(tracks, scene)
        if kind is MotionKind.SWING:
            return _swinging(tracks, scene)
        if kind is MotionKind.COLLISION:
            return _colliding(tracks, scene)
    except MeasurementError as problem:
        return MotionResults(
            {
                name.value: Quantity.missing(
                    name.value, QUANTITY_UNITS[name.value], problem.in_one_line
                )
                for name in _OF_KIND[kind]
            }
        )
    return MotionResults()


_IN_FLIGHT = (QuantityName.FALL_ACCELERATION, QuantityName.FLIGHT_SPEED)
_IN_A_ROLL = (QuantityName.ROLL_ACCELERATION, QuantityName.ROLL_SPEED)
_OF_KIND: dict[MotionKind, tuple[QuantityName, ...]] = {
    **dict.fromkeys((MotionKind.FLIGHT, MotionKind.DROP), (*_IN_FLIGHT, QuantityName.FLIGHT_ANGLE)),
    **dict.fromkeys((MotionKind.ROLL, MotionKind.SLIDE), _IN_A_ROLL),
    MotionKind.SWING: (QuantityName.SWING_PERIOD, QuantityName.SWING_DAMPING),
    MotionKind.COLLISION: (
        QuantityName.SPEED_BEFORE,
        QuantityName.SPEED_AFTER,
        QuantityName.OTHER_SPEED_BEFORE,
        QuantityName.OTHER_SPEED_AFTER,
        QuantityName.COR_COLLISION,
    ),
}


@dataclass(frozen=True)
class RateFromGravity:
    """Frame rate, 1/s, with its standard uncertainty."""

    fps: float
    std: float


MAX_RATE_RELATIVE_STD = 0.1
"""Relative std beyond which an estimated rate is not used (chosen)."""


def rate_from_gravity(tracks: Tracks, scene: MotionScene) -> RateFromGravity | None:
    """Frame rate at which the flight falls with gravity; None if it is too uncertain.

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
    if (
        flight.acceleration <= 0
        or _steady(flight, len(ball), "in free fall").outcome is CheckOutcome.FAILED
    ):
        return None
    relative_std = 0.5 * std / flight.acceleration
    if relative_std > MAX_RATE_RELATIVE_STD:
        return None
    fps = math.sqrt(scene.gravity / flight.acceleration)
    return RateFromGravity(fps, relative_std * fps)


def applicable(tracks: Tracks) -> Track:
    """Rows of the ball's track to which its motion applies."""
    ball = tracks.ball
    if tracks.motion.frames is None:
        return ball
    first, last = tracks.motion.frames
    kept = ball.where((ball.frame >= first) & (ball.frame <= last))
    return kept if len(kept) else ball


def flight_of(
    ball: Track, scene: MotionScene, mapping: Mapping | None = None, *, rolls: bool = False
) -> FreeFlight:
    """Free flight of a track, in metres with a scale and seconds with a rate, else px and frames.

    What rolls or slides falls along its line.

    Raises
    ------
    MeasurementError
        If there is no free flight.
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
        extent = float(np.hypot(*np.ptp(ball.centre_px, axis=0)))
        focal = MIN_FOCAL_OVER_SIZE * scene.size
        growth = math.tan(_HORIZONTAL_SLANT) * extent / focal
    drag, drag_std = scene.drag
    if not scene.metric:
        extent = max(float(np.hypot(*np.ptp(place, axis=0))), 1e-12)
        drag, drag_std = UNKNOWN_DRAG_OVER_PATH / extent, UNKNOWN_DRAG_OVER_PATH / extent
    time = scene.clock[ball.frame] / (scene.fps if scene.timed else 1.0)
    # a calibration already uses the size
    size = ball.radius_px if chosen is None and ball.sized else np.full(len(ball), np.nan)
    if rolls:
        # the air resists what rolls far less than what it rolls on
        drag, drag_std = 0.0, 0.0
        place, std = _turned_down(place, std)
    path = FlightFrames(time, place, std, size, ball.radius_std_px)
    flight = fit_free_flight(path, FreeFlightPriors(drag, drag_std, growth), whole=rolls)
    if not rolls:
        return flight
    # unlike gravity, what slows a roll may change along its line as a slant of the camera does
    square = fit_free_flight(path, FreeFlightPriors(drag, drag_std, 0.0), whole=True)
    return replace(square, perspective=flight.perspective)


def _turned_down(place: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places and their std (N, 2), turned so that the line of motion ends at the bottom."""
    along = np.linalg.svd(place - place.mean(axis=0), full_matrices=False)[2][0]
    along *= math.copysign(1.0, float((place[-1] - place[0]) @ along))
    turn = np.array([[along[1], -along[0]], -along])
    return place @ turn.T, np.sqrt(std**2 @ (turn.T**2))


def require_upright(tracks: Tracks) -> None:
    """Refuse a clip in which objects fall sideways or up.

    A pendulum shows where down is; without one only the fall does, which a short flight that ends
    on the floor does not show.

    Raises
    ------
    NotFoundError
        If the fall is more oblique than any upright camera.
    """
    fall = tracks.motion.fall_px
    if fall is None or fall[1] > abs(fall[0]):
        return
    if tracks.pendulum is not None:
        mass = np.median(tracks.pendulum.track.centre_px, axis=0) - tracks.pendulum.pivot_px
        if mass[1] > abs(mass[0]):
            return
    side = "top" if -fall[1] > abs(fall[0]) else "right" if fall[0] > 0 else "left"
    raise NotFoundError(
        f"the tracked object falls towards the {side} of the picture: the camera was rotated,"
        " the rotation flag of the file is lost, or it is not the ball in flight",
        hint="Rotate the clip so that the ball falls down and measure that; if the camera was "
        "upright, point at the ball with --ball-at X,Y.",
    )


def _falling(tracks: Tracks, scene: MotionScene) -> MotionResults:
    require_upright(tracks)
    ball = applicable(tracks)
    flight = flight_of(ball, scene)
    values, lines = flight.outcome, _Lines.of(flight, scene, ball)
    budgets = [lines.budget(index, scene) for index in range(3)]
    angle = _angle(float(values[2]), budgets[2], tracks.motion.kind)
    found = {angle.name: angle, **_along_the_path(_IN_FLIGHT, values, budgets, scene)}
    steady = _steady(flight, len(ball), "in free fall")
    acceleration = found[QuantityName.FALL_ACCELERATION.value]
    gravity, by_gravity = _by_gravity(acceleration, scene)
    if steady.outcome is CheckOutcome.FAILED:
        everything = frozenset(QuantityName(name) for name in found)
        found = apply_contradictions(
            found, [Contradiction(everything, math.inf, True, steady.statement)]
        )
    elif by_gravity is not None and by_gravity.outcome is CheckOutcome.FAILED:
        assert acceleration.value is not None
        off = abs(acceleration.value / scene.gravity - 1.0)
        affected = {QuantityName.FALL_ACCELERATION, QuantityName.FLIGHT_SPEED}
        if off > MAX_CONTRADICTION:
            # a deviation this large may be no flight at all
            affected.add(QuantityName.FLIGHT_ANGLE)
        found = apply_contradictions(
            found, [Contradiction(frozenset(affected), off, False, by_gravity.statement)]
        )
    if scene.rate_from_fall and acceleration.known:
        diameter_m = "the capture rate was estimated from this fall; give it with --fps RATE"
        fallen = QuantityName.FALL_ACCELERATION.value
        found[fallen] = Quantity.missing(fallen, "m/s^2", diameter_m)
    size = _size(ball, scene)
    if size is not None and size.outcome is CheckOutcome.FAILED:
        # wrong scale or wrong object: no length is right in either case
        affected = {QuantityName.FALL_ACCELERATION, QuantityName.FLIGHT_SPEED}
        model_std = Contradiction(frozenset(affected), math.inf, True, size.statement)
        found = apply_contradictions(found, [model_std])
    checks = [one for one in (steady, by_gravity, size) if one is not None]
    return MotionResults(found, tuple(checks), gravity)


def _along_the_path(
    names: tuple[QuantityName, QuantityName],
    values: FloatArray,
    budgets: list[tuple[Contribution, ...]],
    scene: MotionScene,
) -> dict[str, Quantity]:
    """Acceleration and speed under these names, in pixels where no scale is known."""
    found: dict[str, Quantity] = {}
    for name, value, budget in zip(names, values.tolist(), budgets, strict=False):
        one = _in_units(name, value, budget, scene)
        found[one.name] = one
        if one.name != name.value:
            unit = QUANTITY_UNITS[name.value]
            found[name.value] = Quantity.missing(name.value, unit, _no_scale(scene))
    return found


def _rolling(tracks: Tracks, scene: MotionScene) -> MotionResults:
    """Acceleration along the line, positive where it speeds up, and speed at the first frame."""
    ball = applicable(tracks)
    roll = flight_of(ball, scene, rolls=True)
    lines = _Lines.of(roll, scene, ball, rolls=True)
    budgets = [lines.budget(index, scene) for index in range(2)]
    found = _along_the_path(_IN_A_ROLL, roll.outcome, budgets, scene)
    steady = _steady(roll, len(ball), "on one line at one acceleration", may_change=True)
    if steady.outcome is CheckOutcome.FAILED:
        everything = frozenset(QuantityName(name) for name in found)
        doubt = Contradiction(everything, math.inf, True, steady.statement)
        found = apply_contradictions(found, [doubt])
    return MotionResults(found, (steady,))


def _size(ball: Track, scene: MotionScene) -> Check | None:
    """Check the size of the tracked object against the given diameter, if a scale is given."""
    if scene.diameter is None or scene.scale is None:
        return None
    measured = 2.0 * float(np.median(ball.radius_px)) * scene.scale.metres_per_px
    diameter_m, relative_std = scene.diameter
    relative_std = float(
        np.linalg.norm([relative_std, scene.scale.relative_std, _RADIUS_RELATIVE_STD])
    )
    advice = (
        f"only part of it, or another object, was tracked: {_OTHER_BALL}; or check --ball and"
        " --scale"
    )
    return size_at_scale(measured, relative_std, diameter_m, advice)


def _by_gravity(fall: Quantity, scene: MotionScene) -> tuple[Quantity | None, Check | None]:
    """Check the fall against gravity; a difference means a wrong rate or scale."""
    if fall.value is None or fall.std is None:
        return None, None
    gravity = replace(fall, name="gravity_check")
    text = f"fall acceleration {fall.value:.2f} ± {fall.std:.2f} m/s²"
    if scene.rate_from_fall:
        statement = f"{text}; the capture rate was estimated from it, so it can't check the rate"
        return gravity, Check(CheckKind.GRAVITY, CheckOutcome.UNDECIDED, statement, 0.0)
    off = abs(fall.value - scene.gravity)
    power = float(
        scipy.special.ndtr(-_GRAVITY_SIGMAS + RELEVANT_FRACTION * scene.gravity / fall.std)
    )
    outcome = CheckOutcome.PASSED if power >= MIN_GRAVITY_POWER else CheckOutcome.UNDECIDED
    if off > _GRAVITY_SIGMAS * fall.std:
        outcome = CheckOutcome.FAILED
        rises = abs(fall.value + scene.gravity) <= _GRAVITY_SIGMAS * fall.std
        advice = (
            "the same acceleration upwards: does y point down in this table, or is the picture"
            " upside down?"
            if rises
            else f"check --fps (now {scene.fps:g} fps) and the scale, and that the motion is free"
            " fall"
        )
        text += f", not {scene.gravity:.2f}: {advice}"
    elif outcome is CheckOutcome.UNDECIDED:
        text += ": too uncertain to check rate and scale"
    return gravity, Check(CheckKind.GRAVITY, outcome, text, power)


@dataclass(frozen=True)
class _Lines:
    """Budget lines of acceleration, speed and angle of a flight.

    Attributes
    ----------
    apart : tuple of (source, (3,) array)
        Change of the three with each step of the mapping.
    """

    flight: FreeFlight
    apart: tuple[tuple[UncertaintySource, FloatArray], ...]
    rolls: bool = False

    @classmethod
    def of(
        cls, flight: FreeFlight, scene: MotionScene, ball: Track, *, rolls: bool = False
    ) -> "_Lines":
        moved = [
            (source, flight_of(ball, scene, to, rolls=rolls)) for source, to in scene.mapping_steps
        ]
        apart = tuple((source, np.abs(o.outcome - flight.outcome)) for source, o in moved)
        return cls(flight, apart, rolls)

    def budget(self, index: int, scene: MotionScene) -> tuple[Contribution, ...]:
        flight = self.flight
        lines = [
            Contribution(UncertaintySource.TRACK_NOISE, float(flight.noise[index])),
            Contribution(UncertaintySource.CAMERA_SLANT, float(flight.perspective[index])),
            Contribution(UncertaintySource.ROLL_CHANGE, float(flight.change[index]))
            if self.rolls
            else Contribution(UncertaintySource.DRAG, float(flight.air[index])),
        ]
        powers = {0: (1.0, 2.0), 1: (1.0, 1.0), 2: (0.0, 0.0)}[index]
        if scene.scale is not None:
            relative_std = powers[0] * scene.scale.relative_std * abs(float(flight.outcome[index]))
            lines.append(Contribution(scene.scale.source, relative_std))
        if scene.timed:
            clock = powers[1] * scene.fps_std / scene.fps * abs(float(flight.outcome[index]))
            lines.append(Contribution(UncertaintySource.CAPTURE_RATE, clock))
        lines += [Contribution(source, float(by[index])) for source, by in self.apart]
        kept = [line for line in lines if line.std > 0 and math.isfinite(line.std)]
        return tuple(sorted(kept, key=lambda line: -line.std))


def _steady(flight: FreeFlight, frames: int, motion: str, *, may_change: bool = False) -> Check:
    """Check that both halves fall equally: a carried or swinging object does not.

    The acceleration of what rolls may change, and the budget holds by how much.

    Any smooth path resembles a parabola for a while, so the run that does must be most of it.
    """
    significant = flight.noise[0] < RELEVANT_FRACTION * abs(flight.acceleration)
    text = (
        f"the accelerations of its two halves differ by {flight.halves_difference:.1f} standard"
        " uncertainties"
    )
    fraction = len(flight.path.time) / frames
    off_by = float(np.median(np.hypot(*flight.residual.T))) / flight.length
    if fraction < _MIN_FLIGHT_FRACTION or off_by > _MAX_RELATIVE_RESIDUAL:
        return Check(
            CheckKind.STEADY_FALL,
            CheckOutcome.FAILED,
            f"the tracked object is not {motion}: {100 * fraction:.0f} % of its frames fit one"
            f" parabola, median residual {100 * off_by:.1f} % of its length; {_OTHER_BALL}",
        )
    if flight.halves_difference > _STEADY_SIGMAS and not may_change:
        return Check(
            CheckKind.STEADY_FALL,
            CheckOutcome.FAILED,
            f"the tracked object is not {motion}: {text}; {_OTHER_BALL}",
        )
    outcome = CheckOutcome.PASSED if significant else CheckOutcome.UNDECIDED
    return Check(CheckKind.STEADY_FALL, outcome, text)


def _angle(value: float, budget: tuple[Contribution, ...], kind: MotionKind) -> Quantity:
    name = QuantityName.FLIGHT_ANGLE.value
    found = Quantity.measured(name, value, "deg", budget)
    if kind is MotionKind.DROP or (found.std or 0.0) > _MAX_ANGLE_STD_DEG:
        return Quantity.missing(
            name, "deg", "it falls nearly from rest, so its path has no angle at the first frame"
        )
    return found


def _no_scale(scene: MotionScene) -> str:
    if not scene.metric:
        return (
            "no scale in the plane of motion: give --scale, or the diameter with --ball where the"
            " ball's size was observed, or film in front of a wall grid; the value in pixels is"
            " given"
        )
    return "the capture rate is unknown: give it with --fps RATE; the value in frames is given"


def _in_units(
    name: QuantityName, value: float, budget: tuple[Contribution, ...], scene: MotionScene
) -> Quantity:
    """In SI if scale and rate are known, else in pixels or frames under that name."""
    squared = name in (QuantityName.FALL_ACCELERATION, QuantityName.ROLL_ACCELERATION)
    if scene.metric and scene.timed:
        unit = "m/s^2" if squared else "m/s"
        return Quantity.measured(name.value, value, unit, budget)
    length = "m" if scene.metric else "px"
    time = ("s^2" if squared else "s") if scene.timed else ("frame^2" if squared else "frame")
    if scene.metric:
        # metres without seconds: given in pixels, so that each name has one unit
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
            f"the capture rate is unknown: give it with --fps RATE; the period is "
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


def _colliding(tracks: Tracks, scene: MotionScene) -> MotionResults:
    """Speeds of two bodies before and after a collision; the first is initially at rest."""
    met = disc_contact(tracks)
    if met is None:
        raise MeasurementError(
            "the two balls are not both visible on both sides of the collision",
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
        lines.append(Contribution(scene.scale.source, scene.scale.relative_std * speed))
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
    """Check that the sum of the velocities of two equal bodies is conserved."""
    apart = collision.momentum_change
    text = f"the sum of both velocities changes by {apart:.1f} standard uncertainties"
    if apart > _MOMENTUM_SIGMAS:
        return Check(
            CheckKind.MOMENTUM,
            CheckOutcome.FAILED,
            f"{text}: the bodies differ in mass, are pushed, or were confused with each other",
        )
    before = collision.other_before.speed
    significant = before[1] < RELEVANT_FRACTION * before[0]
    outcome = CheckOutcome.PASSED if significant else CheckOutcome.UNDECIDED
    return Check(CheckKind.MOMENTUM, outcome, text)
