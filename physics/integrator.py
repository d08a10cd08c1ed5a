"""Integrate many trajectories with fixed steps, or one with scipy until an event."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from physics.domain import FloatArray, Number

__all__ = [
    "Rates",
    "SolvedPath",
    "Trajectory",
    "ZeroCrossing",
    "crossing",
    "follow_until",
    "integrate",
    "runge_kutta_step",
]

Rates = Callable[[Any, FloatArray], FloatArray]

"""(time, state of shape (c, ...)) → rates of the same shape."""


class Trajectory:
    """States on an even time grid for each trajectory, interpolated by cubic Hermite.

    Parameters
    ----------
    step : array that broadcasts to the trajectories' shape
        Grid spacing, s.
    states, rates : (n + 1, c, ...) array
        Value and time derivative of each of the c components at each grid time.
    """

    def __init__(self, step: FloatArray, states: FloatArray, rates: FloatArray) -> None:
        self.step = step
        self.states = states
        self.rates = rates

    def at(self, time: FloatArray, wanted: int | None = None) -> FloatArray:
        """States at times of shape (..., s), which may differ from trajectory to trajectory.

        Beyond the ends of the grid the last cubic is extrapolated.

        Parameters
        ----------
        wanted : int, optional
            Number of components to read, from the first one; all by default.

        Returns
        -------
        (c, ..., s) array
        """
        count, components = self.states.shape[0] - 1, self.states.shape[1]
        wanted = components if wanted is None else wanted
        shape, reads = time.shape[:-1], time.shape[-1]
        many = math.prod(shape)
        step = np.broadcast_to(self.step, shape).reshape(many, 1)
        place = time.reshape(many, reads) / step
        cell = np.clip(place.astype(np.int64), 0, count - 1)
        u = place - cell
        u2, u3 = u * u, u * u * u
        begin, end = 2 * u3 - 3 * u2 + 1, 3 * u2 - 2 * u3
        leaving, arriving = (u3 - 2 * u2 + u) * step, (u3 - u2) * step
        states, rates = self.states.ravel(), self.rates.ravel()
        # Component by component with flat indices: a quarter of the time of fancy indexing.
        here = cell * (components * many) + np.arange(many)[:, None]
        values = np.empty((wanted, many, reads))
        for component, value in enumerate(values):
            if not (self.states[:, component].any() or self.rates[:, component].any()):
                value[:] = 0.0
                continue
            first = here + component * many
            after = first + components * many
            value[:] = states.take(first) * begin
            value += rates.take(first) * leaving
            value += states.take(after) * end
            value += rates.take(after) * arriving
        return values.reshape(wanted, *shape, reads)


def runge_kutta_step(
    rates: Rates,
    time: Number,
    state: FloatArray,
    step: Number,
    first: FloatArray | None = None,
) -> FloatArray:
    """One classical fourth-order step.

    Parameters
    ----------
    rates : callable
        (time, state) → rates.
    time, step : float or array of the trajectories' shape
        s; a negative step goes back.
    state : (c, ...) array
    first : (c, ...) array, optional
        Rates at `time`, if already known.

    Returns
    -------
    (c, ...) array
    """
    k1 = rates(time, state) if first is None else first
    k2 = rates(time + 0.5 * step, state + 0.5 * step * k1)
    k3 = rates(time + 0.5 * step, state + 0.5 * step * k2)
    k4 = rates(time + step, state + step * k3)
    after: FloatArray = state + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return after


def integrate(rates: Rates, start: FloatArray, duration: FloatArray, steps: int) -> Trajectory:
    """Classic Runge–Kutta of fourth order on an even grid.

    Parameters
    ----------
    rates : callable
        (time, state) → rates.
    start : (c, ...) array
        State at time zero.
    duration : array
        Duration, s, per trajectory.
    steps : int
        Number of steps.
    """
    step = np.asarray(duration, dtype=np.float64) / steps
    states = np.empty((steps + 1, *start.shape))
    slopes = np.empty_like(states)
    state = start
    for index in range(steps):
        time = step * index
        first = rates(time, state)
        states[index], slopes[index] = state, first
        state = runge_kutta_step(rates, time, state, step, first)
    states[steps], slopes[steps] = state, rates(step * steps, state)
    return Trajectory(step, states, slopes)


def crossing(path: Trajectory, level: FloatArray) -> FloatArray:
    """First time at which component 0 rises through `level`; the end of the grid if never.

    Returns
    -------
    array of the trajectories' shape
    """
    above = path.states[:, 0] >= level
    first = np.argmax(above, axis=0)
    last = path.states.shape[0] - 1
    first = np.where(above.any(axis=0), np.maximum(first, 1), last)
    step = np.broadcast_to(path.step, first.shape)

    def node(grid: FloatArray, index: np.ndarray) -> FloatArray:
        picked: FloatArray = np.take_along_axis(grid[:, 0], index[None], axis=0)[0]
        return picked

    # Newton steps on the cubic of the cell in which it rises through.
    below, over = node(path.states, first - 1), node(path.states, first)
    slope, end_slope = node(path.rates, first - 1) * step, node(path.rates, first) * step
    square = 3.0 * (over - below) - 2.0 * slope - end_slope
    cube = 2.0 * (below - over) + slope + end_slope
    u = np.clip((level - below) / np.where(over > below, over - below, 1.0), 0.0, 1.0)
    for _ in range(4):
        value = below + u * (slope + u * (square + u * cube))
        rate = slope + u * (2.0 * square + 3.0 * u * cube)
        u = u - (value - level) / np.where(np.abs(rate) > 1e-9 * step, rate, step)
        u = np.clip(u, 1.0 - first, last + 1.0 - first)
    time: FloatArray = (first - 1 + u) * step
    return time


SolverRates = Callable[[float, FloatArray], Sequence[float] | FloatArray]


@dataclass(frozen=True)
class ZeroCrossing:
    """A function of the state whose zero ends the motion.

    Attributes
    ----------
    function : callable
        (time, state) to float.
    direction : float
        −1 for falling zeros only, +1 for rising ones only, 0 for both.
    """

    function: Callable[[float, FloatArray], float]
    direction: float = 0.0


@dataclass(frozen=True)
class SolvedPath:
    """Solution of an integration.

    Attributes
    ----------
    end : float
        Time at the end, s.
    state : (S,) array
        State at the end.
    ended_by : int or None
        Index of the event that ended it; None at the end of `span`.
    at : callable
        States (S, N) at times (N,), from the solver's dense output.
    """

    end: float
    state: FloatArray
    ended_by: int | None
    at: Callable[[FloatArray], FloatArray]


def follow_until(
    rates: SolverRates,
    start: FloatArray,
    span: tuple[float, float],
    events: Sequence[ZeroCrossing],
    *,
    method: str,
    relative: float,
    absolute: float,
    **options: float,
) -> SolvedPath:
    """Integrate until an event or the end of `span`.

    Parameters
    ----------
    rates : callable
        (time, state) to rates of the state.
    start : (S,) array
        State at the beginning of `span`.
    span : two floats
        s.
    method : str
        scipy's name of the solver.
        Name of scipy's solver.
        Tolerances.
    **options : float
        `first_step`, `max_step` of scipy.
    """
    functions: list[Any] = []
    for event in events:

        def watch(
            time: float,
            state: FloatArray,
            function: Callable[[float, FloatArray], float] = event.function,
        ) -> float:
            return function(time, state)

        marked: Any = watch
        marked.terminal, marked.direction = True, event.direction
        functions.append(marked)
    solver: Any = scipy.integrate.solve_ivp
    solved = solver(
        rates,
        span,
        start,
        method=method,
        events=functions,
        dense_output=True,
        rtol=relative,
        atol=absolute,
        **options,
    )
    hit = [i for i, times in enumerate(solved.t_events) if times.size]
    return SolvedPath(
        float(solved.t[-1]),
        np.asarray(solved.y[:, -1]),
        hit[0] if hit else None,
        solved.sol,
    )
