"""The flight: gravity, drag and a little lift fitted to the path after release (Eqs 11-12)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metrology import TooLittleDataError
from pipelines.measure.fits.least_squares import Fitted, fit
from pipelines.measure.fits.slow_errors import slow_error_whitening

__all__ = ["FlightFit", "FlightPriors", "fit_flight"]

FloatArray = NDArray[np.float64]

_STEP_S = 0.03
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

    def falls_to(self, height: float, values: FloatArray | None = None) -> float | None:
        """Time after which the centre is at `height` on its way down, s; None if it never is."""
        chosen = self.fitted.values if values is None else values
        times = np.arange(0.0, 6.0, 0.02)
        above = _flown(chosen, times)[:, 1] > height
        below = np.flatnonzero(above[:-1] & ~above[1:])
        if len(below) == 0:
            return None
        at = float(times[below[0]])
        for _ in range(6):
            state = _flown(chosen, np.array([at]))[0]
            at -= float((state[1] - height) / state[3])
        return at + self.reference_s


def fit_flight(
    time_s: FloatArray,
    position_m: FloatArray,
    covariance_m2: FloatArray,
    reference_s: float,
    priors: FlightPriors,
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
        return whiten((_flown(values, elapsed)[:, :2] - position_m) / std).ravel()

    fitted = fit(residuals, start, start, spread, channels=2)
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


def _flown(values: FloatArray, elapsed: FloatArray) -> FloatArray:
    states = np.empty((len(elapsed), 4))
    for side in (-1.0, 1.0):
        here = elapsed * side >= 0
        if np.any(here):
            states[here] = _march(values, elapsed[here], side)
    return states


# a path that a search drives to infinity is worth nothing, and says so by NaN
@np.errstate(over="ignore", invalid="ignore")
def _march(values: FloatArray, elapsed: FloatArray, side: float) -> FloatArray:
    # a search may try forces that would blow the path up
    drag, lift, gravity = (float(v) for v in np.clip(values[4:], [-1, -5, -99], [1, 5, 99]))

    def acceleration(vx: float, vy: float) -> tuple[float, float]:
        resist = drag * (vx * vx + vy * vy) ** 0.5
        return -resist * vx - lift * vy, -resist * vy + lift * vx - gravity

    count = int(np.ceil(np.abs(elapsed).max() / _STEP_S)) + 1
    step = side * _STEP_S
    x, y, vx, vy = (float(value) for value in values[:4])
    states = np.empty((count + 1, 6))
    for index in range(count + 1):
        ax, ay = acceleration(vx, vy)
        states[index] = x, y, vx, vy, ax, ay
        mx, my = acceleration(vx + 0.5 * step * ax, vy + 0.5 * step * ay)
        ex, ey = acceleration(vx + step * mx, vy + step * my)
        x += step * vx + step**2 * (ax + 2 * mx) / 6
        y += step * vy + step**2 * (ay + 2 * my) / 6
        vx += step * (ax + 4 * mx + ex) / 6
        vy += step * (ay + 4 * my + ey) / 6
    at = np.clip((elapsed / step).astype(int), 0, count - 1)
    part = (elapsed - at * step)[:, None]
    begin = states[at]
    jerk = (states[at + 1, 4:] - begin[:, 4:]) / step
    position = begin[:, :2] + begin[:, 2:4] * part + begin[:, 4:] * part**2 / 2 + jerk * part**3 / 6
    velocity = begin[:, 2:4] + begin[:, 4:] * part + jerk * part**2 / 2
    return np.hstack([position, velocity])
