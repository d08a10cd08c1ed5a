"""A free flight or drop by itself: acceleration, speed and direction, and what perspective hides.

Seen by a camera that is not square to the plane of motion, the scale grows along the path: over a
drop that fills the picture a slant of 1° looks like an acceleration that is 2 % off. A slant also
bends the path in a way of its own, and the ball's size changes with it: both are fitted together
with the flight, which is linear in all of its unknowns.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from metrology import TooLittleDataError
from metrology.least_squares import Fitted, fit
from pipelines.measure.fits.swing_fit import slow_error_whitening

__all__ = ["FlightFrames", "FreeFlight", "FreeFlightPriors", "fit_free_flight", "steady_stretch"]

FloatArray = NDArray[np.float64]

LEAST_FRAMES = 6
"""Frames: a parabola in two directions has six unknowns and each frame two numbers; half are to
spare."""
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
    halves_apart : float
        How far the accelerations of both halves are apart, in standard uncertainties.
    """

    acceleration: float
    speed: float
    angle_deg: float
    noise: FloatArray
    perspective: FloatArray
    air: FloatArray
    path: FlightFrames
    residual: FloatArray
    halves_apart: float

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
        if np.array_equal(near, kept):
            break
        kept = near
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
        _halves_apart(path, priors),
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

    def residuals(values: FloatArray) -> FloatArray:
        left = whiten((design @ values - place) / std).ravel()
        trend = size_rows @ values[-2:] - size
        return np.concatenate([left, trend, np.zeros(len(trend) % 2)])

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
    fitted = fit(residuals, start, prior, spread, channels=2)
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
