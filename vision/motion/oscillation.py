"""Whether a thing swings: a decaying oscillation on an arc, as one linear fit for each frequency.

A bob on a cord or rod of length l at the small angle φ = a cos(ωt) e^(-γt) is at x = l sin φ,
y = l cos φ: along the arc terms in ω, across it in 2ω, each decaying. With the decay taken to
first order all of them are linear in their amplitudes once ω is given.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["PARAMETERS", "Oscillation", "fit_oscillation"]

FloatArray = NDArray[np.float64]

_FREQUENCIES = 80
# Periods shorter than so many frames are not told from noise.
_SHORTEST_PERIOD = 8.0
# Less than this part of a period is an arc that turns back: below it nothing is known of a swing.
_LEAST_PERIODS = 0.35
_ROUNDS = 4
# Columns of both axes, and the frequency.
PARAMETERS = 15


@dataclass(frozen=True)
class Oscillation:
    """A swing.

    Attributes
    ----------
    omega : float
        Angular frequency, rad per frame.
    residual_px : (N,) array
        Distance of each position from it, px.
    periods : float
        How many periods were seen.
    """

    omega: float
    residual_px: FloatArray
    periods: float


def fit_oscillation(time: FloatArray, centre: FloatArray, scale_px: float) -> Oscillation | None:
    """Fit a swing to positions.

    Parameters
    ----------
    time : (N,) array
        Frames.
    centre : (N, 2) array
        Positions, px.
    scale_px : float
        Residual beyond which a position loses weight, px.

    Returns
    -------
    Oscillation or None
        None where there are too few positions.
    """
    if len(time) < 2 * PARAMETERS:
        return None
    span = float(time[-1] - time[0])
    spacing = span / (len(time) - 1)
    shortest = max(_SHORTEST_PERIOD, 4.0 * spacing)
    lowest, highest = 2 * np.pi * _LEAST_PERIODS / span, 2 * np.pi / shortest
    if highest <= lowest:
        return None
    shifted = time - time[0]
    best, cost = None, np.inf
    for omega in np.geomspace(lowest, highest, _FREQUENCIES):
        residual = _residual(shifted, centre, float(omega), scale_px)
        robust = float(np.mean(np.minimum(residual, 3.0 * scale_px)))
        if robust < cost:
            best, cost = Oscillation(float(omega), residual, omega * span / (2 * np.pi)), robust
    return best


def _residual(time: FloatArray, centre: FloatArray, omega: float, scale_px: float) -> FloatArray:
    span = float(time[-1])
    turn = omega * time
    ones = np.ones_like(time)
    design = np.column_stack(
        [
            ones,
            np.cos(turn),
            np.sin(turn),
            time / span * np.cos(turn),
            time / span * np.sin(turn),
            np.cos(2 * turn),
            np.sin(2 * turn),
        ]
    )
    weight = ones
    residual = np.zeros_like(time)
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)[:, None]
        # A ridge: below half a period the columns are nearly one another's.
        normal = (design * root).T @ (design * root) + 1e-6 * len(time) * np.eye(design.shape[1])
        amplitude = np.linalg.solve(normal, (design * weight[:, None]).T @ centre)
        residual = np.hypot(*(centre - design @ amplitude).T)
        weight = 1.0 / (1.0 + (residual / scale_px) ** 2) ** 2
    return residual
