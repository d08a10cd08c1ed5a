"""Fits of free flight (Eqs 11-12), free swing and landing.

The landing is fitted to the frames around touch-down alone, before and after the bounce; both
pieces meet where and when the ball is on the floor.

Biases of an outline (shading, a shadow's edge, the background, the far side of a thick mass) vary
slowly as the object moves, so more frames do not average them away. Each track is assumed to have,
in addition to random errors, a few cosines over its duration, each a multiple of the random error.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from measuring.inputs import Inputs
from measuring.metres import MetricTracks
from metrology import NotFoundError, TooLittleDataError
from metrology.least_squares import Fitted, fit, moved_fit
from physics.flight import flown, time_of_fall
from physics.integrator import Trajectory, integrate
from physics.swing import SwingModel

__all__ = [
    "MAX_CONTACT_S",
    "SLOW_OVER_RANDOM",
    "FlightFit",
    "FlightPriors",
    "LandingSeen",
    "SwingFit",
    "fit_flight",
    "fit_swing",
    "flight_end",
    "flight_whitening",
    "landing_seen",
    "slow_error_whitening",
]

FloatArray = NDArray[np.float64]

_SWING_STEP_S, _MIN_STEP_S = 0.015, 1e-6
"""s, Runge–Kutta step (chosen: a swing of 1 s is accurate to 1e-7 rad) and its minimum."""

_EXTENSION_FACTOR = 1.5
"""Factor by which an integrated swing is extended when read beyond its end (chosen)."""

MIN_SWING_FIT_FRAMES = 5
"""Frames: a swing has three unknowns; two more test the fit (derived)."""


@dataclass(frozen=True)
class SwingFit:
    """A free swing φ'' = −Ω² sin φ.

    Attributes
    ----------
    reference_s : float
        Time at which the state is given, s.
    fitted : Fitted
        Values φ (rad), ω (rad/s), Ω² (1/s²) at `reference_s`.
    noise_factor : float
        Random error of the angles over the stated one, at most 1: errors larger than stated widen
        `fitted`.
    """

    reference_s: float
    fitted: Fitted
    noise_factor: float = 1.0

    def state(self, time_s: float) -> tuple[float, float]:
        """Angle (rad) and angular velocity (rad/s) at a time."""
        angle, rate = self.states(np.array([time_s]))
        return float(angle[0]), float(rate[0])

    def states(
        self, time_s: FloatArray, values: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Angles (rad) and angular velocities (rad/s) at times (N,)."""
        elapsed = time_s - self.reference_s
        if values is None:
            return self._integrated.at(elapsed)
        return _swung(values, elapsed)

    @cached_property
    def _integrated(self) -> "_ExtendableSwing":
        return _ExtendableSwing(self.fitted.values)

    def angles(self, time_s: FloatArray) -> FloatArray:
        """Angles at times, rad."""
        return self.states(time_s)[0]


def fit_swing(
    time_s: FloatArray,
    angle_rad: FloatArray,
    std_rad: FloatArray,
    reference_s: float,
    stiffness: float,
    stiffness_std: float,
    near: SwingFit | None = None,
) -> SwingFit:
    """Fit a free swing to one side of the contact.

    Parameters
    ----------
    time_s, angle_rad, std_rad : (N,) arrays
        s, rad, rad.
    reference_s : float
        Time of the state, s.
    stiffness, stiffness_std : float
        Ω² = m g d / I and its standard uncertainty, 1/s².
    near : SwingFit, optional
        Fit to slightly different data of the same frames: updated to first order.

    Raises
    ------
    TooLittleDataError
        With fewer than five frames.
    """
    if len(time_s) < MIN_SWING_FIT_FRAMES:
        raise TooLittleDataError(
            f"the pendulum is seen in only {len(time_s)} frames on one side of the contact",
            hint="Film the mass for five frames on each side of the contact, or at a higher rate.",
        )
    slope, offset = np.polyfit(time_s - reference_s, angle_rad, 1)
    stated = np.maximum(std_rad, 0.3 * float(np.median(std_rad)))

    def residuals_over(factor: float) -> Callable[[FloatArray], FloatArray]:
        return lambda values: (
            (_swung(values, time_s - reference_s)[0] - angle_rad) / (factor * stated)
        )

    prior, spread = [offset, slope, stiffness], [np.inf, np.inf, stiffness_std]
    if near is not None:
        residuals = residuals_over(near.noise_factor)
        moved = moved_fit(near.fitted, residuals, prior, spread)
        return SwingFit(reference_s, moved, near.noise_factor)
    fitted = fit(residuals_over(1.0), prior, prior, spread, stacked=True)
    factor = _noise_factor(fitted.residuals)
    if factor < 1.0:
        fitted = fit(residuals_over(factor), prior, prior, spread, stacked=True)
    return SwingFit(reference_s, fitted, factor)


_MIN_NOISE_FACTOR = 0.05
"""Least random error over the stated one (chosen: stated errors are overestimated by up to 10)."""


def _noise_factor(left: FloatArray) -> float:
    """Random error over the stated one by residuals (N,) of a swing, at most 1.

    An upper limit of one standard deviation, with the correlation of neighbouring residuals.
    """
    count = len(left)
    variance = float(left @ left) / max(count - 3, 1)
    alike = float(left[1:] @ left[:-1]) / max(float(left @ left), 1e-300)
    alike = min(max(alike, 0.0), 0.9)
    variance *= (1.0 + alike) / (1.0 - alike) * (1.0 + math.sqrt(2.0 / count))
    return min(1.0, max(_MIN_NOISE_FACTOR, math.sqrt(variance)))


def _swung(values: FloatArray, elapsed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angle and rate (..., N) at times (N,) from a state (3,) or a stack of states (..., 3)."""
    rows = values.reshape(-1, values.shape[-1])
    states = np.empty((2, len(rows), len(elapsed)))
    for here in (elapsed < 0.0, elapsed >= 0.0):
        if np.any(here):
            times = elapsed[here]
            path = _path(rows, float(times[np.argmax(np.abs(times))]))
            states[:, :, here] = path.at(np.broadcast_to(times, (len(rows), len(times))))
    angle, rate = states.reshape(2, *values.shape[:-1], len(elapsed))
    return angle, rate


class _ExtendableSwing:
    """One swing evaluated at many times; integrated again only beyond the range covered.

    Parameters
    ----------
    values : (3,) array
        The state at the reference.
    """

    def __init__(self, values: FloatArray) -> None:
        self._values = values[np.newaxis]
        self._paths: dict[bool, tuple[float, Trajectory]] = {}

    def at(self, elapsed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Angle and rate (N,) at times (N,) from the reference, s."""
        states = np.empty((2, len(elapsed)))
        for later in (False, True):
            here = (elapsed >= 0.0) == later
            if np.any(here):
                times = elapsed[here]
                path = self._covering(later, float(np.abs(times).max()))
                states[:, here] = path.at(times[np.newaxis])[:, 0]
        return states[0], states[1]

    def _covering(self, later: bool, until: float) -> Trajectory:
        reached, path = self._paths.get(later, (-1.0, None))
        if path is None or until > reached:
            reached = max(until, _EXTENSION_FACTOR * reached)
            path = _path(self._values, reached if later else -reached)
            self._paths[later] = reached, path
        return path


def _path(rows: FloatArray, until: float) -> Trajectory:
    """Swings (K, 3) integrated from their reference to a time, s, before or after it."""
    # the swing depends only on Ω² = m g d / I
    model = SwingModel(length=1.0, inertia=1.0, mass=rows[:, 2], com=1.0, gravity=1.0)
    until = until if abs(until) > _MIN_STEP_S else _MIN_STEP_S
    return integrate(
        model.rates, rows[:, :2].T, np.array(until), int(np.ceil(abs(until) / _SWING_STEP_S))
    )


_SLOW_MODES = 4
"""Number of cosines of slowly varying errors (chosen); faster variation is noise."""

SLOW_OVER_RANDOM = 1.5
"""Amplitude of slowly varying errors over the random error (assumed)."""


def slow_error_whitening(time_s: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Whitening of standardised residuals that contain slowly varying errors.

    The covariance is the unit matrix plus one of low rank, Ψ Ψᵀ = U s² Uᵀ; its inverse root is
    I − U (1 − 1 / √(1 + s²)) Uᵀ.

    Parameters
    ----------
    time_s : (N,) array
        Times of the residuals, s.

    Returns
    -------
    callable
        (N, ...) residuals over their random standard uncertainty to whitened ones.
    """
    return _whitening(SLOW_OVER_RANDOM * _cosines(time_s, np.arange(1, _SLOW_MODES + 1)))


FLIGHT_RANDOM, FLIGHT_DRIFT = 0.5, 1.0
"""Random error per frame of a flight, and random walk over all frames, relative to the stated std.
Fitted to true positions of three renderers (18, 22, 12 flights): random 0.40, 0.45, 0.52;
cosines of order 1: 0.53, 0.22, 0.43; order 2: 0.24, 0.21, 0.23; order 3: 0.19, 0.11, 0.16, where
this walk has 0.45, 0.23, 0.15."""

_DRIFT_MODES = 8
"""Number of cosines of the walk (chosen); further ones are below the random error."""


def flight_whitening(time_s: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Whitening of a flight's residuals over the stated std of each frame.

    A constant error is absorbed by the fit. A random walk of d in total has d √2 / (π k) in its
    cosine of order k.

    Parameters
    ----------
    time_s : (N,) array
        Times of the residuals, s.
    """
    order = np.arange(1, _DRIFT_MODES + 1)
    drift = FLIGHT_DRIFT * math.sqrt(2.0) / (math.pi * order)
    whiten = _whitening(drift / FLIGHT_RANDOM * _cosines(time_s, order))
    return lambda left: whiten(left / FLIGHT_RANDOM)


def _cosines(time_s: FloatArray, order: NDArray[np.int64]) -> FloatArray:
    """Cosines of given orders over the range of times (N,), (N, K)."""
    if len(time_s) == 0:
        return np.zeros((0, len(order)))
    phase = (time_s - time_s[0]) / max(float(np.ptp(time_s)), 1e-9)
    return np.asarray(np.cos(np.pi * phase[:, np.newaxis] * order))


def _whitening(slow: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Inverse root of the unit matrix plus Ψ Ψᵀ for slowly varying errors Ψ (N, K)."""
    if len(slow) == 0:
        return lambda left: left
    axes, size, _ = np.linalg.svd(slow, full_matrices=False)
    shrink = 1.0 - 1.0 / np.sqrt(1.0 + size**2)

    # a diverging search gives NaN
    @np.errstate(invalid="ignore", over="ignore")
    def whiten(left: FloatArray) -> FloatArray:
        along = np.tensordot(axes.T, left, axes=1)
        return np.asarray(left - np.tensordot(axes * shrink, along, axes=1))

    return whiten


_MIN_FALL_S = 0.05
"""s, minimum integration time of a fall (chosen)."""

_MAX_FALL_S = 6.0
"""s, maximum duration of a fall (chosen: 170 m)."""

MIN_FLIGHT_FRAMES = 6
"""Frames: a parabola in two dimensions has six unknowns, each frame two values (derived: twice as
many values as unknowns)."""

_MAX_RESIDUAL_RATIO = 12.0
"""Residual over the median beyond which a frame shows another object (chosen); no outline error is
as large."""


@dataclass(frozen=True)
class FlightPriors:
    """Priors of the forces: value and standard uncertainty each.

    Attributes
    ----------
    gravity, gravity_std : float
        m/s²; an infinite std fits gravity to the data (self-check).
    drag, drag_std : float
        K = ρ S C_D / 2 m, 1/m.
    lift, lift_std : float
        Acceleration normal to the velocity per speed, 1/s; upwards for a ball flying to +x.
    """

    gravity: float
    gravity_std: float
    drag: float
    drag_std: float
    lift: float
    lift_std: float


@dataclass(frozen=True)
class FlightFit:
    """A fitted flight.

    Attributes
    ----------
    reference_s : float
        Time of the state, s.
    fitted : Fitted
        x, y (m), vx, vy (m/s), K (1/m), lift (1/s), g (m/s²).
    time_s : (N,) array
        Times of the frames used.
    residual_m : (N, 2) array
        Measured minus fitted, m.
    """

    reference_s: float
    fitted: Fitted
    time_s: FloatArray
    residual_m: FloatArray

    def states(self, time_s: FloatArray, values: FloatArray | None = None) -> FloatArray:
        """x, y, vx, vy at times; (N, 4)."""
        chosen = self.fitted.values if values is None else values
        return _flown(chosen, np.asarray(time_s, dtype=float) - self.reference_s)

    def restarted(self, reference_s: float) -> Self:
        """The same path with its state at another time, s."""
        state = self.states(np.array([reference_s]))[0]
        values = np.concatenate([state, self.fitted.values[4:]])
        return replace(self, reference_s=reference_s, fitted=replace(self.fitted, values=values))

    def falls_to(self, height: float, values: FloatArray | None = None) -> float | None:
        """Time at which the centre reaches `height` on its way down, s; None if it does not."""
        chosen = self.fitted.values if values is None else values
        after = time_of_fall(chosen, height, _max_fall_time(chosen, height))
        return None if math.isnan(after) else after + self.reference_s


def fit_flight(
    time_s: FloatArray,
    position_m: FloatArray,
    covariance_m2: FloatArray,
    reference_s: float,
    priors: FlightPriors,
    near: FlightFit | None = None,
) -> FlightFit:
    """Fit the flight to positions in the ball plane.

    Parameters
    ----------
    time_s : (N,) array
        s.
    position_m : (N, 2) array
        x to the right, y up, m.
    covariance_m2 : (N, 2, 2) array
        Random part of the covariance, m².
    reference_s : float
        Time of the state, s.
    priors : FlightPriors
        Of the forces.
    near : FlightFit, optional
        Fit to slightly different data of the same frames: updated to first order.

    Raises
    ------
    TooLittleDataError
        With fewer than six frames.
    """
    if len(time_s) < MIN_FLIGHT_FRAMES:
        raise TooLittleDataError(
            f"the ball is seen in only {len(time_s)} frames of its flight",
            hint="Film so that the ball stays in the picture for longer, or at a higher rate.",
        )
    std = np.sqrt(np.diagonal(covariance_m2, axis1=1, axis2=2))
    if near is None:
        steady = _consistent(time_s, position_m, std, priors.gravity)
        time_s, position_m, std = time_s[steady], position_m[steady], std[steady]
    std = np.maximum(std, 0.3 * np.median(std, axis=0))
    elapsed = time_s - reference_s
    start = np.array([0.0, 0.0, 0.0, 0.0, priors.drag, priors.lift, priors.gravity])
    for axis, bend in ((0, 0.0), (1, -0.5 * priors.gravity)):
        slope, offset = np.polyfit(elapsed, position_m[:, axis] - bend * elapsed**2, 1)
        start[axis], start[2 + axis] = offset, slope
    spread = np.array(
        [np.inf] * 4 + [priors.drag_std, priors.lift_std, priors.gravity_std], dtype=float
    )
    whiten = flight_whitening(elapsed)

    def residuals(values: FloatArray) -> FloatArray:
        off = (_flown(values, elapsed)[..., :2] - position_m) / std
        white = np.moveaxis(whiten(np.moveaxis(off, -2, 0)), 0, -2)
        return white.reshape(*values.shape[:-1], -1)

    if near is None:
        fitted = fit(residuals, start, start, spread, channels=2, stacked=True)
    else:
        fitted = moved_fit(near.fitted, residuals, start, spread)
    left = position_m - _flown(fitted.values, elapsed)[:, :2]
    return FlightFit(reference_s, fitted, time_s, left)


def _consistent(
    time_s: FloatArray, position_m: FloatArray, std_m: FloatArray, gravity: float
) -> NDArray[np.bool_]:
    """Frames consistent with their neighbours; whitening would spread an outlier."""
    steady = np.ones(len(time_s), dtype=bool)
    if len(time_s) < 2 * MIN_FLIGHT_FRAMES:
        return steady
    since, until = np.diff(time_s)[:-1, np.newaxis], np.diff(time_s)[1:, np.newaxis]
    chord = (position_m[:-2] * until + position_m[2:] * since) / (since + until)
    bend = (position_m[1:-1] - chord - 0.5 * gravity * since * until * [0.0, 1.0]) / std_m[1:-1]
    off = np.hypot(*(bend - np.median(bend, axis=0)).T)
    near = np.maximum(np.append(off[1:], 0.0), np.append(0.0, off[:-1]))
    steady[1:-1] = (off < _MAX_RESIDUAL_RATIO * max(float(np.median(off)), 1.0)) | (off < near)
    return steady


def _max_fall_time(values: FloatArray, height: float) -> float:
    """Upper bound of the time of fall to a height, s: twice that in vacuum."""
    up, pull = float(values[3]), max(float(values[6]), 1.0)
    fall = (up + math.sqrt(max(up**2 + 2.0 * pull * (float(values[1]) - height), 0.0))) / pull
    return min(max(2.0 * fall, 0.0) + _MIN_FALL_S, _MAX_FALL_S)


def _flown(values: FloatArray, elapsed: FloatArray) -> FloatArray:
    """x, y, vx, vy (..., N, 4) at times (N,) of one flight (7,) or a stack of them (..., 7)."""
    rows = np.ascontiguousarray(values.reshape(-1, values.shape[-1]), dtype=float)
    states = flown(rows, np.asarray(elapsed, dtype=float))
    return states.reshape(*values.shape[:-1], len(elapsed), 4)


MAX_CONTACT_S = 0.025
"""s, maximum contact time (chosen; the paper's inflated balls: 14 to 19 ms); later frames are in
flight."""

_BOUNCE_M = 0.01
"""m, minimum rise after a bounce (chosen: five times the 2 mm accuracy of an outline)."""

_JUMP_RADII = 0.5

_MIN_STANDING_FRAMES = 5
"""Minimum frames of a ball at rest (chosen: their median resists a single outlier)."""

_MAX_ACCELERATION = 15.0
"""m/s², maximum acceleration in flight (chosen: 1.5 g, with drag and lift of a fast light ball)."""


def flight_end(tracks: MetricTracks, inputs: Inputs, left: float) -> float:
    """Time before which the ball is certainly in flight, s.

    Parameters
    ----------
    tracks : MetricTracks
        Ball plane.
    inputs : Inputs
        Height of fall, if known.
    left : float
        Time at which the ball has left its rest, s.

    Returns
    -------
    float
        The earliest of: reaching the floor, rising again after the fall, a jump of the path,
        standing still longer than at an apex; just after the last frame if there is none.
    """
    after = np.flatnonzero(tracks.ball_time_s > left + MAX_CONTACT_S)
    time, place = tracks.ball_time_s[after], tracks.ball_m[after]
    if len(time) == 0:
        return float(tracks.ball_time_s[-1]) + 1e-9
    ends = [float(time[-1]) + 1e-9]
    jump = _jump(time, place, tracks)
    if jump is not None:
        ends.append(float(time[jump]))
    stop = _stop(time, place, tracks, inputs.gravity)
    if stop is not None:
        ends.append(float(time[stop]))
    height = place[:, 1]
    if inputs.fall is not None:
        floor = tracks.rest_m[1] - inputs.fall
        ends.append(_touch_down(time, tracks, floor, inputs.gravity))
        if inputs.fall < _noise(tracks):
            ends.append(_first_bounce(time, tracks, left, inputs.gravity))
    # a jump starts another motion: a second strike has an apex of its own
    highest = int(np.argmax(height[:jump]))
    lowest = highest + int(np.argmin(height[highest:jump]))
    if np.any(height[lowest:] - height[lowest] > _BOUNCE_M):
        ends.append(float(time[lowest]))
    return min(ends)


def _touch_down(time: FloatArray, tracks: MetricTracks, floor: float, gravity: float) -> float:
    """Last time up to which a fit of free fall has not yet come down to the floor, s."""
    rows = np.isin(tracks.ball_time_s, time)
    fallen = tracks.ball_m[rows, 1] + 0.5 * gravity * (time - time[0]) ** 2
    weight = 1.0 / np.sqrt(tracks.ball_cov_m2[rows, 1, 1])
    for count in range(len(time), MIN_FLIGHT_FRAMES - 1, -1):
        elapsed = time[:count] - time[0]
        speed, height = np.polyfit(elapsed, fallen[:count], 1, w=weight[:count])
        up = speed**2 + 2.0 * gravity * (height - floor)
        if up > 0.0 and (speed + math.sqrt(up)) / gravity >= elapsed[-1]:
            return float(time[count - 1]) + 1e-9
    return float(time[0])


_BOUNCES_FOLLOWED = 20
"""Bounces after which a ball counts as rolling (chosen)."""

_BOUNCES, _SPEEDS = np.linspace(0.0, 0.95, 20), 100
"""Fractions of the speed that a bounce keeps, and number of upward speeds, which are compared
(chosen: steps of a twentieth and a hundredth)."""


def _first_bounce(time: FloatArray, tracks: MetricTracks, left: float, gravity: float) -> float:
    """Time at which a ball that was struck on the floor comes back to it, s.

    Its arcs follow from its upward speed and what a bounce keeps of it. Both are fitted to all
    heights with an offset, since the floor's shadow displaces a ball at rest.
    """
    rows = np.isin(tracks.ball_time_s, time)
    place, weight = tracks.ball_m[rows], 1.0 / np.sqrt(tracks.ball_cov_m2[rows, 1, 1])
    fastest = float(np.hypot(*(place[-1] - place[0]))) / max(time[-1] - time[0], 1e-9)
    upward = np.linspace(0.0, fastest, _SPEEDS + 1)[1:, None]
    misfit = np.array(
        [
            _misfit(_arcs(time - left, upward, kept, gravity), place[:, 1], weight)
            for kept in _BOUNCES
        ]
    )
    best = int(np.argmin(misfit.min(axis=0)))
    return left + 2.0 * float(upward[best, 0]) / gravity


def _arcs(elapsed: FloatArray, upward: FloatArray, kept: float, gravity: float) -> FloatArray:
    """Heights (n, F) over the floor of balls that leave it upwards (n, 1) and bounce."""
    speed, since = upward * np.ones_like(elapsed), elapsed * np.ones_like(upward)
    for _ in range(_BOUNCES_FOLLOWED):
        landed = since * gravity > 2.0 * speed
        since = np.where(landed, since - 2.0 * speed / gravity, since)
        speed = np.where(landed, kept * speed, speed)
    return np.asarray(np.maximum(speed * since - 0.5 * gravity * since**2, 0.0))


def _misfit(heights: FloatArray, seen: FloatArray, weight: FloatArray) -> FloatArray:
    """Sum of absolute deviations over std of seen heights (F,) from each of (n, F), shifted."""
    left = seen - heights
    left = left - np.median(left, axis=1, keepdims=True)
    return np.asarray((weight * np.abs(left)).sum(axis=1))


def _stop(time: FloatArray, place: FloatArray, tracks: MetricTracks, gravity: float) -> int | None:
    """First frame from which the ball stands still: caught, or in a frozen picture.

    A ball at its apex is also slow, but falls away from it on both sides.
    """
    noise = _noise(tracks)
    away = np.hypot(*(place - np.median(place[-_MIN_STANDING_FRAMES:], axis=0)).T) > noise
    came = int(np.flatnonzero(away)[-1]) + 1 if np.any(away) else 0
    if len(time) - came < _MIN_STANDING_FRAMES:
        return None
    half = 0.5 * float(time[-1] - time[came])
    return came + 1 if 0.5 * gravity * half**2 > 2.0 * noise else None


def _noise(tracks: MetricTracks) -> float:
    """Apparent displacement of a ball at rest, at most, m."""
    return 6.0 * float(np.median(np.sqrt(np.trace(tracks.ball_cov_m2, axis1=1, axis2=2))))


def _jump(time: FloatArray, place: FloatArray, tracks: MetricTracks) -> int | None:
    """First frame from which the path no longer continues from its past.

    Single outliers are left to the robust fit.
    """
    noise = _noise(tracks)
    last, so_far = 1, 0
    for k in range(2, len(time)):
        before = time[last] - time[so_far]
        velocity = (place[last] - place[so_far]) / before
        ahead = time[k : k + 2] - time[last]
        missed = np.hypot(*(place[k : k + 2] - place[last] - velocity * ahead[:, None]).T)
        allowed = (
            _JUMP_RADII * tracks.radius_m
            + 0.5 * _MAX_ACCELERATION * ahead * (ahead + before)
            + noise * (1.0 + ahead / before)
        )
        if np.all(missed > allowed):
            return k
        if missed[0] <= allowed[0]:
            last, so_far = k, last
    return None


LANDING_STRETCH_S, FRAMES_AROUND_LANDING = 0.06, 5
"""s, and minimum frames, of path before and after touch-down (chosen: independent of the launch;
drag changes 5 m/s by 1 % over it, which the fitted acceleration absorbs)."""

FLOOR_CONTACT_STD_S = 0.004
"""s, half the time of an inflated ball on the floor: std between the two pieces (chosen)."""

ACCELERATION_STD = 0.3
"""m/s², std of drag and lift over so short a path (assumed: some per cent of gravity)."""


@dataclass(frozen=True)
class LandingSeen:
    """Observed touch-down.

    Attributes
    ----------
    time_s : float
        First contact with the floor, s.
    place_m : (2,) array
        Centre of the ball then, ball plane, m.
    covariance : (3, 3) array
        Of time and place.
    bounce_seen : bool
        Whether the path after the bounce was used.
    """

    time_s: float
    place_m: FloatArray
    covariance: FloatArray
    bounce_seen: bool


def landing_seen(tracks: MetricTracks, inputs: Inputs, lands_at: float) -> LandingSeen:
    """Fit touch-down to the frames around it.

    Parameters
    ----------
    tracks : MetricTracks
        Ball plane.
    inputs : Inputs
        Height of the support and gravity.
    lands_at : float
        Approximate time of landing, s.

    Raises
    ------
    NotFoundError
        If the ball is not tracked down to the floor.
    """
    assert inputs.fall is not None
    floor = float(tracks.rest_m[1]) - inputs.fall
    time = tracks.ball_time_s
    frame_s = float(np.median(np.diff(time)))
    stretch = max(LANDING_STRETCH_S, FRAMES_AROUND_LANDING * frame_s)
    before = (time < lands_at) & (time > lands_at - stretch - 0.5 * frame_s)
    if before.sum() < FRAMES_AROUND_LANDING or lands_at - time[before][-1] > 1.5 * frame_s:
        raise NotFoundError(
            "the ball is not tracked in the last frames before it lands",
            hint="Film so that the landing is in view.",
        )
    falling = _Piece.fit(tracks, before, lands_at, inputs)
    touch = falling.reaches(floor)
    if touch is None:
        raise NotFoundError(
            "the path just before the landing does not reach the floor",
            hint="Film until the ball has touched the floor.",
        )
    elapsed, x = touch
    found = LandingSeen(
        lands_at + elapsed,
        np.array([x, floor]),
        falling.covariance_at(elapsed),
        False,
    )
    after = (time > found.time_s + 2.5 * FLOOR_CONTACT_STD_S) & (time < lands_at + stretch)
    if after.sum() < FRAMES_AROUND_LANDING:
        return found
    return _with_bounce(found, _Piece.fit(tracks, after, found.time_s, inputs), floor)


def _with_bounce(found: LandingSeen, rising: "_Piece", floor: float) -> LandingSeen:
    """Combine touch-down with the path after the bounce.

    The ball leaves the floor after the time on it, whose std is as large as itself; a path without
    such a bounce is ignored.
    """
    left = rising.reaches(floor)
    if left is None or rising.values[3] <= 0.0:
        return found
    elapsed, x = left
    lasting = 2.0 * FLOOR_CONTACT_STD_S
    time = elapsed - lasting
    along = x - float(rising.values[2]) * lasting
    spread = rising.covariance_at(elapsed)
    spread[0, 0] += FLOOR_CONTACT_STD_S**2
    # friction on the floor may take any part of the horizontal speed
    spread[1, 1] += (0.5 * float(rising.values[2]) * FLOOR_CONTACT_STD_S) ** 2
    difference = np.array([time, along - found.place_m[0]])
    own = found.covariance[:2, :2]
    apart = difference @ np.linalg.solve(own + spread[:2, :2], difference)
    if apart > _MAX_BOUNCE_CHI2:
        return found
    gain = own @ np.linalg.inv(own + spread[:2, :2])
    moved = gain @ difference
    covariance = found.covariance.copy()
    covariance[:2, :2] = own - gain @ own
    return LandingSeen(
        found.time_s + float(moved[0]),
        found.place_m + np.array([float(moved[1]), 0.0]),
        covariance,
        True,
    )


_MAX_BOUNCE_CHI2 = 14.0
"""χ² of two degrees of freedom at a probability of 0.1 % (convention; 13.8)."""


@dataclass(frozen=True)
class _Piece:
    """A short piece of flight: x, y, vx, vy, ax, ay at a time, and their covariance."""

    values: FloatArray
    covariance: FloatArray

    @classmethod
    def fit(
        cls, tracks: MetricTracks, used: NDArray[np.bool_], about_s: float, inputs: Inputs
    ) -> "_Piece":
        elapsed = tracks.ball_time_s[used] - about_s
        std = np.sqrt(np.diagonal(tracks.ball_cov_m2[used], axis1=1, axis2=2))
        std = np.maximum(std, 0.3 * np.median(std, axis=0))
        whiten = slow_error_whitening(elapsed)
        design = np.stack([np.ones_like(elapsed), elapsed, 0.5 * elapsed**2], axis=1)
        values, covariance = np.zeros(6), np.zeros((6, 6))
        for axis, pull in ((0, 0.0), (1, -inputs.gravity)):
            rows = whiten(design / std[:, axis, np.newaxis])
            seen = whiten(tracks.ball_m[used, axis] / std[:, axis])
            rows = np.vstack([rows, [0.0, 0.0, 1.0 / ACCELERATION_STD]])
            seen = np.append(seen, pull / ACCELERATION_STD)
            spread = np.linalg.inv(rows.T @ rows)
            best = spread @ rows.T @ seen
            freedom = max(len(elapsed) - 2, 1)
            left = seen - rows @ best
            at = [axis, 2 + axis, 4 + axis]
            values[at] = best
            covariance[np.ix_(at, at)] = spread * max(float(left @ left) / freedom, 1.0)
        return cls(values, covariance)

    def reaches(self, height: float) -> tuple[float, float] | None:
        """Time nearest to the reference at which a height is reached, and x there, or None."""
        x, y, vx, vy, ax, ay = (float(value) for value in self.values)
        roots = np.roots([0.5 * ay, vy, y - height])
        real = roots[np.abs(roots.imag) < 1e-9].real
        if len(real) == 0:
            return None
        at = float(real[np.argmin(np.abs(real))])
        return at, x + vx * at + 0.5 * ax * at**2

    def covariance_at(self, elapsed: float) -> FloatArray:
        """Covariance (3, 3) of time, x and y at that height."""
        vx = float(self.values[2] + self.values[4] * elapsed)
        vy = float(self.values[3] + self.values[5] * elapsed)
        powers = np.array([1.0, elapsed, 0.5 * elapsed**2])
        slope = np.zeros((3, 6))
        slope[0, [1, 3, 5]] = -powers / vy
        slope[1, [0, 2, 4]] = powers
        slope[1] += vx * slope[0]
        return np.asarray(slope @ self.covariance @ slope.T)
