"""The pendulum before and after contact: a free swing on each side, never across the event.

Errors that change slowly along a track: more frames do not average them away.

What biases an outline (shading, a shadow's edge, the scene behind, the far side of a thick mass)
changes as slowly as the thing moves across it, and grows with what leaves the outline uncertain in
a single frame. Each track is taken to have, besides its random errors, a few cosines over the
stretch, each of this many times the random error.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metrology import TooLittleDataError
from metrology.least_squares import Fitted, fit, moved_fit
from physics.integrator import Trajectory, integrate
from physics.swing import SwingModel

__all__ = ["SLOW_OVER_RANDOM", "SwingFit", "fit_swing", "slow_error_whitening"]

FloatArray = NDArray[np.float64]

_STEP_S, _LEAST_STEP_S = 0.015, 1e-6

"""Runge–Kutta steps: a swing of a second is right to 1e-7 rad with them."""

LEAST_FRAMES = 5
"""Frames: a swing has three unknowns, and two to spare show whether it is one."""


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
        angle, rate = self.states(np.array([time_s]), values)
        return float(angle[0]), float(rate[0])

    def states(
        self, time_s: FloatArray, values: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Angles (rad) and angular velocities (rad/s) at times (N,)."""
        chosen = self.fitted.values if values is None else values
        return _swung(chosen, time_s - self.reference_s)

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
        Where the state is wanted.
    stiffness, stiffness_std : float
        Ω² = m g d / I and its standard uncertainty, 1/s².
    near : SwingFit, optional
        The fit to data of just these frames that differ little: it is moved to first order.

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

    prior, spread = [offset, slope, stiffness], [np.inf, np.inf, stiffness_std]
    if near is None:
        fitted = fit(residuals, prior, prior, spread, stacked=True)
    else:
        fitted = moved_fit(near.fitted, residuals, prior, spread)
    return SwingFit(reference_s, fitted)


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


def _path(rows: FloatArray, until: float) -> Trajectory:
    """Swings (K, 3) from their reference to a time, s, before or after it."""
    # only Ω² = m g d / I counts
    model = SwingModel(length=1.0, inertia=1.0, mass=rows[:, 2], com=1.0, gravity=1.0)
    until = until if abs(until) > _LEAST_STEP_S else _LEAST_STEP_S
    return integrate(
        model.rates, rows[:, :2].T, np.array(until), int(np.ceil(abs(until) / _STEP_S))
    )


_MODES = 4
"""Cosines that slow errors of an outline are made of: what changes faster looks like noise."""

SLOW_OVER_RANDOM = 1.5
"""Times the random error, supposed: what a followed outline is off by over many frames."""


def slow_error_whitening(
    time_s: FloatArray, *, offset: bool = False
) -> Callable[[FloatArray], FloatArray]:
    """Whitening for standardised residuals with slow errors among them.

    The covariance is the unit matrix plus one of low rank, Ψ Ψᵀ = U s² Uᵀ; its inverse root is
    I − U (1 − 1 / √(1 + s²)) Uᵀ.

    Parameters
    ----------
    time_s : (N,) array
        Times of the residuals, s.
    offset : bool
        Whether a constant error counts too, where the fit itself does not take it up.

    Returns
    -------
    callable
        (N, ...) residuals over their random standard uncertainty to whitened ones.
    """
    phase = (time_s - time_s[0]) / max(float(np.ptp(time_s)), 1e-9)
    order = np.arange(0 if offset else 1, _MODES + 1)
    modes = np.cos(np.pi * phase[:, np.newaxis] * order)
    axes, size, _ = np.linalg.svd(SLOW_OVER_RANDOM * modes, full_matrices=False)
    shrink = 1.0 - 1.0 / np.sqrt(1.0 + size**2)

    # residuals of a search that ran away to infinity come out as NaN
    @np.errstate(invalid="ignore", over="ignore")
    def whiten(left: FloatArray) -> FloatArray:
        along = np.tensordot(axes.T, left, axes=1)
        return np.asarray(left - np.tensordot(axes * shrink, along, axes=1))

    return whiten
