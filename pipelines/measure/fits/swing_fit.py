"""The pendulum before and after contact: a free swing on each side, never across the event."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metrology import TooLittleDataError
from pipelines.measure.fits.least_squares import Fitted, fit

__all__ = ["SwingFit", "fit_swing"]

FloatArray = NDArray[np.float64]

_STEP_S = 0.006
LEAST_FRAMES = 5


@dataclass(frozen=True)
class SwingFit:
    """A stretch of free swing φ'' = −Ω² sin φ.

    Attributes
    ----------
    reference_s : float
        Time at which the state is given, s.
    fitted : Fitted
        Values φ (rad), ω (rad/s), Ω² (1/s²) at `reference_s`.
    """

    reference_s: float
    fitted: Fitted

    def state(self, time_s: float, values: FloatArray | None = None) -> tuple[float, float]:
        """Angle (rad) and angular velocity (rad/s) at a time."""
        angle, rate = _swung(
            self.fitted.values if values is None else values,
            np.array([time_s - self.reference_s]),
        )
        return float(angle[0]), float(rate[0])

    def angles(self, time_s: FloatArray) -> FloatArray:
        """Angles at times, rad."""
        return _swung(self.fitted.values, time_s - self.reference_s)[0]


def fit_swing(
    time_s: FloatArray,
    angle_rad: FloatArray,
    std_rad: FloatArray,
    reference_s: float,
    stiffness: float,
    stiffness_std: float,
) -> SwingFit:
    """Fit a free swing to one side of the contact.

    Parameters
    ----------
    time_s, angle_rad, std_rad : (N,) arrays
        s, rad, rad.
    reference_s : float
        Where the state is wanted.
    stiffness, stiffness_std : float
        Ω² = m g d / I and its standard uncertainty, 1/s².

    Raises
    ------
    TooLittleDataError
        With fewer than five frames.
    """
    if len(time_s) < LEAST_FRAMES:
        raise TooLittleDataError(
            f"the pendulum is seen in only {len(time_s)} frames on one side of the contact",
            hint="Film the mass for five frames on each side of the contact, or at a higher rate.",
        )
    slope, offset = np.polyfit(time_s - reference_s, angle_rad, 1)
    scale = np.maximum(std_rad, 0.3 * float(np.median(std_rad)))

    def residuals(values: FloatArray) -> FloatArray:
        return (_swung(values, time_s - reference_s)[0] - angle_rad) / scale

    return SwingFit(
        reference_s,
        fit(
            residuals,
            [offset, slope, stiffness],
            [offset, slope, stiffness],
            [np.inf, np.inf, stiffness_std],
        ),
    )


def _swung(values: FloatArray, elapsed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angle and rate at times from the state: fixed steps both ways, cubic between."""
    angle = np.empty_like(elapsed)
    rate = np.empty_like(elapsed)
    for side in (-1.0, 1.0):
        here = elapsed * side >= 0
        if np.any(here):
            angle[here], rate[here] = _march(values, elapsed[here], side)
    return angle, rate


def _march(values: FloatArray, elapsed: FloatArray, side: float) -> tuple[FloatArray, FloatArray]:
    phi, omega, stiffness = (float(value) for value in values)
    count = int(np.ceil(np.abs(elapsed).max() / _STEP_S)) + 1
    step = side * _STEP_S
    states = np.empty((count + 1, 3))
    for index in range(count + 1):
        force = -stiffness * math.sin(phi)
        states[index] = phi, omega, force
        middle = -stiffness * math.sin(phi + 0.5 * step * omega + 0.125 * step**2 * force)
        end = -stiffness * math.sin(phi + step * omega + 0.5 * step**2 * middle)
        phi += step * omega + step**2 * (force + 2 * middle) / 6
        omega += step * (force + 4 * middle + end) / 6
    at = np.clip((elapsed / step).astype(int), 0, count - 1)
    part = elapsed - at * step
    begin = states[at]
    jerk = (states[at + 1, 2] - begin[:, 2]) / step
    angle = begin[:, 0] + begin[:, 1] * part + begin[:, 2] * part**2 / 2 + jerk * part**3 / 6
    return angle, begin[:, 1] + begin[:, 2] * part + jerk * part**2 / 2
