"""Separate errors that drift over a whole record from laws.

A marker that wobbles or a tracker that drifts bends a path over a short flight as a force does. A
law bends all flights alike; such errors bend each in its own direction. The variance of each cosine
of what the best law leaves over is estimated from its spread over the trials (empirical Bayes).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, fdtrc

from mismatch.forward import Forward
from mismatch.records import slow_cosines
from physics.domain import FloatArray

__all__ = ["Wandering", "wandering_errors"]

COSINES = 16
"""Slowest cosines that are tried: up to eight turns of a marker in one flight."""

MIN_TRIALS = 6
"""Trials from which their scatter says something."""

PRICE = 4.0
"""Chi-square units for a variance that is fitted: two standard deviations, which chance alone
exceeds upward in one of 32."""

TOGETHER = 0.001
"""Probability below which trials deviate in one direction together: that is a law, and no noise."""


@dataclass(frozen=True)
class Wandering:
    """What a fit leaves over of slow errors.

    Attributes
    ----------
    excess : (3, K) array
        Variance of each cosine by coordinate, beyond that of white noise and in its units.
    gain : float
        What it takes off the deviance, its freedom paid for; zero if there is none.
    """

    excess: FloatArray
    gain: float


NONE = Wandering(np.zeros((3, 0)), 0.0)


def wandering_errors(forward: Forward, residual: FloatArray) -> Wandering:
    """Slow errors in what a fit of flights leaves over.

    Parameters
    ----------
    residual : (T, M) array
        (record − prediction) / sigma, white but for them.
    """
    records = forward.records
    if forward.mode != "flight" or records.trials < MIN_TRIALS:
        return NONE
    rows = records.ball_time.shape[1]
    basis = slow_cosines(records, COSINES)
    left = residual[:, : 3 * rows].reshape(records.trials, 3, rows)
    found = np.einsum("tcs,tcsk->tck", left, basis)
    known = np.any(basis != 0.0, axis=2)
    count = known.sum(axis=0)
    variance = np.square(found).sum(axis=0) / np.maximum(count, 1)
    gain = count * (variance - 1.0 - np.log(np.maximum(variance, 1e-300))) - PRICE
    kept = (count >= MIN_TRIALS) & (variance > 1.0) & (gain > 0.0)
    if not kept.any() or _together(found, known, kept):
        return NONE
    # How large a variance of few trials is, is in doubt itself (Student).
    wider = count / np.maximum(count - 2.0, 1.0)
    excess = np.where(kept, variance * wider - 1.0, 0.0)
    return Wandering(excess, float(gain[kept].sum()))


def _together(found: FloatArray, known: np.ndarray, kept: np.ndarray) -> bool:
    """Whether the trials' cosines have means that their scatter does not explain."""
    count = known.sum(axis=0)[kept]
    mean = np.where(known, found, 0.0).sum(axis=0)[kept] / count
    total = np.square(np.where(known, found, 0.0)).sum(axis=0)[kept]
    scatter = np.maximum(total - count * mean**2, 1e-300) / (count - 1.0)
    chance = fdtrc(1.0, count - 1.0, count * mean**2 / scatter)
    fisher = -2.0 * float(np.log(np.maximum(chance, 1e-300)).sum())
    return bool(chdtrc(2.0 * count.size, fisher) < TOGETHER)
