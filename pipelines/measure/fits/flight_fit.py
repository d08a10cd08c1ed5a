"""The flight: gravity, drag and a little lift fitted to the path after release (Eqs 11-12)."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from metrology import TooLittleDataError
from metrology.least_squares import Fitted, fit, moved_fit
from physics.flight.motion import PlanarFlight
from physics.integrator import Trajectory, integrate
from pipelines.measure.fits.slow_errors import slow_error_whitening

__all__ = ["FlightFit", "FlightPriors", "fit_flight"]

FloatArray = NDArray[np.float64]

_STEP_S, _LEAST_STEP_S = 0.05, 1e-6
"""Runge–Kutta steps: a ball that drag slows by a tenth in a second is right to 1e-8 m with them."""
_LONGEST_FALL_S = 6.0
_NEWTON_STEPS = 6
LEAST_FRAMES = 6
_FAR_OFF = 12.0


@dataclass(frozen=True)
class FlightPriors:
    """What is known of the forces before looking: value and standard uncertainty each.

    Attributes
    ----------
    gravity, gravity_std : float
        m/s²; an infinite std leaves gravity to the data (the self-check).
    drag, drag_std : float
        K = ρ S C_D / 2 m, 1/m.
    lift, lift_std : float
        Acceleration normal to the velocity per speed, 1/s; it lifts a ball flying to +x.
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
        """Time after which the centre is at `height` on its way down, s; None if it never is."""
        chosen = self.fitted.values if values is None else values
        path = _path(chosen[np.newaxis], _surely_fallen(chosen, height))
        heights = path.states[:, 1, 0]
        below = np.flatnonzero((heights[:-1] > height) & (heights[1:] <= height))
        if len(below) == 0:
            return None
        at = float(below[0] * path.step)
        for _ in range(_NEWTON_STEPS):
            state = path.at(np.array([[at]]))[:, 0, 0]
            at -= float((state[1] - height) / state[3])
        return at + self.reference_s


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
        Random part of their uncertainty, m².
    reference_s : float
        Where the state is wanted, s.
    priors : FlightPriors
        On the forces.
    near : FlightFit, optional
        The fit to data of just these frames that differ little: it is moved to first order.

    Raises
    ------
    TooLittleDataError
        With fewer than six frames.
    """
    if len(time_s) < LEAST_FRAMES:
        raise TooLittleDataError(
            f"the ball is seen in only {len(time_s)} frames of its flight",
            hint="Film so that the ball stays in the picture for longer, or at a higher rate.",
        )
    std = np.sqrt(np.diagonal(covariance_m2, axis1=1, axis2=2))
    if near is None:
        steady = _steady(time_s, position_m, std, priors.gravity)
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
    whiten = slow_error_whitening(elapsed)

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


def _steady(
    time_s: FloatArray, position_m: FloatArray, std_m: FloatArray, gravity: float
) -> NDArray[np.bool_]:
    """Frames that lie between their neighbours; whitening would spread one that is far off."""
    steady = np.ones(len(time_s), dtype=bool)
    if len(time_s) < 2 * LEAST_FRAMES:
        return steady
    since, until = np.diff(time_s)[:-1, np.newaxis], np.diff(time_s)[1:, np.newaxis]
    chord = (position_m[:-2] * until + position_m[2:] * since) / (since + until)
    bend = (position_m[1:-1] - chord - 0.5 * gravity * since * until * [0.0, 1.0]) / std_m[1:-1]
    off = np.hypot(*(bend - np.median(bend, axis=0)).T)
    near = np.maximum(np.append(off[1:], 0.0), np.append(0.0, off[:-1]))
    steady[1:-1] = (off < _FAR_OFF * max(float(np.median(off)), 1.0)) | (off < near)
    return steady


def _surely_fallen(values: FloatArray, height: float) -> float:
    """Time by which a flight will have come down to a height, s: twice what it takes in vacuum."""
    up, pull = float(values[3]), max(float(values[6]), 1.0)
    fall = (up + math.sqrt(max(up**2 + 2.0 * pull * (float(values[1]) - height), 0.0))) / pull
    return min(max(2.0 * fall, 0.0) + _STEP_S, _LONGEST_FALL_S)


@np.errstate(over="ignore", invalid="ignore")
def _flown(values: FloatArray, elapsed: FloatArray) -> FloatArray:
    """x, y, vx, vy (..., N, 4) at times (N,) of one flight (7,) or a stack of them (..., 7)."""
    lanes = values.reshape(-1, values.shape[-1])
    states = np.empty((len(lanes), len(elapsed), 4))
    for here in (elapsed < 0.0, elapsed >= 0.0):
        if np.any(here):
            times = elapsed[here]
            path = _path(lanes, float(times[np.argmax(np.abs(times))]))
            states[:, here] = np.moveaxis(
                path.at(np.broadcast_to(times, (len(lanes), len(times)))), 0, -1
            )
    return states.reshape(*values.shape[:-1], len(elapsed), 4)


# a path that a search drives to infinity is worth nothing, and says so by NaN
@np.errstate(over="ignore", invalid="ignore")
def _path(lanes: FloatArray, until: float) -> Trajectory:
    """Flights (K, 7) from their reference to a time, s, before or after it."""
    # a search may try forces that would blow the path up
    drag, lift, gravity = np.clip(lanes[:, 4:].T, [[-1], [-5], [-99]], [[1], [5], [99]])

    model = PlanarFlight(drag, lift, gravity)
    until = until if abs(until) > _LEAST_STEP_S else _LEAST_STEP_S
    steps = int(np.ceil(abs(until) / _STEP_S))
    return integrate(model.rates, lanes[:, :4].T, np.array(until), steps)
