"""A free swing by itself: period and damping of what comes and goes along one line."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metrology import NotFoundError, TooLittleDataError
from metrology.least_squares import fit

__all__ = ["FreeSwing", "fit_free_swing"]

FloatArray = NDArray[np.float64]

LEAST_FRAMES = 12
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
    if len(time) < LEAST_FRAMES:
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
        raise NotFoundError("what comes and goes does not swing freely: no damped swing fits it")
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
