"""The shape of a contact: how far the ball has come while the force between mass and ball lasts."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid, solve_ivp

from physics.contact.law import damping_for_cor

__all__ = ["ContactPulse", "contact_pulse"]

FloatArray = NDArray[np.float64]

_POINTS = 201
_STEP = 0.15


@dataclass(frozen=True)
class ContactPulse:
    """A contact in its own units: time 0 to 1 from onset to release, approach speed × duration = 1.

    Attributes
    ----------
    phase : (P,) array
        Time from onset over the duration of contact.
    compression : (P,) array
        Compression over approach speed × duration.
    path : (P,) array
        Distance the ball has moved over its speed at release × duration.
    """

    phase: FloatArray
    compression: FloatArray
    path: FloatArray


def contact_pulse(exponent: float, cor: float) -> ContactPulse:
    """Pulse of a Hunt–Crossley contact F = k δⁿ (1 + c δ') (Hunt & Crossley 1975).

    Parameters
    ----------
    exponent : float
        n: 1 a linear spring, 1.5 Hertz's law.
    cor : float
        Coefficient of restitution of the pulse.

    Returns
    -------
    ContactPulse
        Interpolated between exponents in steps of 0.15 and to the nearest hundredth of `cor`.
    """
    place = (exponent - 1.0) / _STEP
    lower = math.floor(place)
    share = place - lower
    one = _solved(lower, round(cor, 2))
    other = _solved(lower + 1, round(cor, 2))
    return ContactPulse(
        one.phase,
        (1.0 - share) * one.compression + share * other.compression,
        (1.0 - share) * one.path + share * other.path,
    )


@lru_cache(maxsize=256)
def _solved(step: int, cor: float) -> ContactPulse:
    exponent = 1.0 + step * _STEP
    damping = float(damping_for_cor(cor))

    def rates(_: float, state: FloatArray) -> list[float]:
        compression, rate = float(state[0]), float(state[1])
        force = max(compression, 0.0) ** exponent * max(1.0 + damping * rate, 0.0)
        return [rate, -force]

    def released(time: float, state: FloatArray) -> float:
        return float(state[0]) if time > 0.1 else 1.0

    released.terminal = True  # type: ignore[attr-defined]
    solution = solve_ivp(
        rates, (0.0, 50.0), [0.0, 1.0], events=released, rtol=1e-8, atol=1e-10, dense_output=True
    )
    duration = float(solution.t[-1])
    dense: Any = solution.sol
    phase = np.linspace(0.0, 1.0, _POINTS)
    compression, rate = dense(phase * duration)
    speed = 1.0 - rate
    path = cumulative_trapezoid(speed / speed[-1], phase, initial=0)
    return ContactPulse(phase, compression / duration, path)
