"""Errors that change slowly along a track: more frames do not average them away.

What biases an outline (shading, a shadow's edge, the scene behind, the far side of a thick mass)
changes as slowly as the thing moves across it, and grows with what leaves the outline uncertain in
a single frame. Each track is taken to have, besides its random errors, a few cosines over the
stretch, each of this many times the random error.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["SLOW_OVER_RANDOM", "slow_error_whitening"]

FloatArray = NDArray[np.float64]

_MODES = 4
SLOW_OVER_RANDOM = 1.5


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
