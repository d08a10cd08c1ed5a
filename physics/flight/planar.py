"""Flights in the plane of the picture, compiled: what a fit marches a thousand times.

`FlightModel` with drag and lift alone, by what a clip shows: K and the lift, not the masses and
coefficients behind them. A flight is x, y (m), vx, vy (m/s), K = ρ S C_D / 2 m (1/m), lift
(acceleration normal to the velocity per speed, 1/s; positive lifts a ball that flies to +x) and
gravity (m/s²).
"""

import math

import numpy as np

from metrology.compiled import compiled
from physics.domain import FloatArray

__all__ = ["flown", "rates", "time_of_fall"]

_STEP_S, _LEAST_STEP_S = 0.05, 1e-6
"""Runge–Kutta steps: a ball that drag slows by a tenth in a second is right to 1e-8 m with them."""

_NEWTON_STEPS = 6
"""Steps: Newton doubles the digits in each, and a sample of the path starts with three."""
# A search may try forces that would blow the path up.
_MOST_DRAG, _MOST_LIFT, _MOST_GRAVITY = 1.0, 5.0, 99.0


@compiled
def rates(flight: FloatArray, state: FloatArray, rate: FloatArray) -> None:
    """Put the rates (4,) of a state x, y, vx, vy into `rate`, m/s and m/s²."""
    drag = min(max(flight[4], -_MOST_DRAG), _MOST_DRAG)
    lift = min(max(flight[5], -_MOST_LIFT), _MOST_LIFT)
    gravity = min(max(flight[6], -_MOST_GRAVITY), _MOST_GRAVITY)
    vx, vy = state[2], state[3]
    resist = drag * math.hypot(vx, vy)
    rate[0], rate[1] = vx, vy
    rate[2] = -resist * vx - lift * vy
    rate[3] = -resist * vy + lift * vx - gravity


@compiled
def _march(flight: FloatArray, step: float, states: FloatArray, slopes: FloatArray) -> None:
    """Fill states and slopes (n + 1, 4) on an even grid from time 0, by Runge–Kutta."""
    state, second, third, fourth = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    for k in range(4):
        states[0, k] = flight[k]
    last = len(states) - 1
    for n in range(last):
        rates(flight, states[n], slopes[n])
        for k in range(4):
            state[k] = states[n, k] + 0.5 * step * slopes[n, k]
        rates(flight, state, second)
        for k in range(4):
            state[k] = states[n, k] + 0.5 * step * second[k]
        rates(flight, state, third)
        for k in range(4):
            state[k] = states[n, k] + step * third[k]
        rates(flight, state, fourth)
        for k in range(4):
            more = slopes[n, k] + 2.0 * (second[k] + third[k]) + fourth[k]
            states[n + 1, k] = states[n, k] + step / 6.0 * more
    rates(flight, states[last], slopes[last])


@compiled
def _read(
    states: FloatArray, slopes: FloatArray, step: float, time: float, found: FloatArray
) -> None:
    """The state (4,) at a time, by the cubic between two steps; the last one is continued."""
    place = time / step
    cell = min(max(int(place), 0), len(states) - 2)
    u = place - cell
    square, cube = u * u, u * u * u
    for k in range(4):
        found[k] = (
            states[cell, k] * (2.0 * cube - 3.0 * square + 1.0)
            + slopes[cell, k] * step * (cube - 2.0 * square + u)
            + states[cell + 1, k] * (3.0 * square - 2.0 * cube)
            + slopes[cell + 1, k] * step * (cube - square)
        )


@compiled
def flown(flights: FloatArray, elapsed: FloatArray) -> FloatArray:
    """States x, y, vx, vy (K, N, 4) of flights (K, 7) at times (N,) from their reference, s.

    Times before the reference are marched back to. A path that a search drives to infinity is
    worth nothing, and says so by NaN.
    """
    found = np.empty((len(flights), len(elapsed), 4))
    earliest, latest = 0.0, 0.0
    for n in range(len(elapsed)):
        earliest, latest = min(earliest, elapsed[n]), max(latest, elapsed[n])
    for back in (True, False):
        until = min(earliest, -_LEAST_STEP_S) if back else max(latest, _LEAST_STEP_S)
        steps = math.ceil(abs(until) / _STEP_S)
        states, slopes = np.empty((steps + 1, 4)), np.empty((steps + 1, 4))
        for row in range(len(flights)):
            _march(flights[row], until / steps, states, slopes)
            for n in range(len(elapsed)):
                if (elapsed[n] < 0.0) == back:
                    _read(states, slopes, until / steps, elapsed[n], found[row, n])
    return found


@compiled
def time_of_fall(flight: FloatArray, height: float, longest: float) -> float:
    """Time after which a flight (7,) comes down to a height (m), s; NaN if not within `longest`."""
    steps = math.ceil(max(longest, _LEAST_STEP_S) / _STEP_S)
    step = max(longest, _LEAST_STEP_S) / steps
    states, slopes = np.empty((steps + 1, 4)), np.empty((steps + 1, 4))
    _march(flight, step, states, slopes)
    here = np.empty(4)
    for n in range(steps):
        if states[n, 1] > height and states[n + 1, 1] <= height:
            at = n * step
            for _ in range(_NEWTON_STEPS):
                _read(states, slopes, step, at, here)
                at -= (here[1] - height) / here[3]
            return at
    return math.nan
