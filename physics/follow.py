"""scipy's adaptive solvers, run until one of several events ends the motion."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from physics.domain import FloatArray

__all__ = ["Event", "SolvedPath", "follow_until"]

Rates = Callable[[float, FloatArray], Sequence[float] | FloatArray]


@dataclass(frozen=True)
class Event:
    """A function of the state whose zero ends the motion.

    Attributes
    ----------
    function : callable
        (time, state) to float.
    direction : float
        −1 only where it falls through zero, +1 only where it rises, 0 both.
    """

    function: Callable[[float, FloatArray], float]
    direction: float = 0.0


@dataclass(frozen=True)
class SolvedPath:
    """What the solver found.

    Attributes
    ----------
    end : float
        Time at the end, s.
    state : (S,) array
        State at the end.
    ended_by : int or None
        Index of the event that ended it; None if time ran out.
    at : callable
        States (S, N) at times (N,), from the solver's dense output.
    """

    end: float
    state: FloatArray
    ended_by: int | None
    at: Callable[[FloatArray], FloatArray]


def follow_until(
    rates: Rates,
    start: FloatArray,
    span: tuple[float, float],
    events: Sequence[Event],
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
    events : sequence of Event
    method : str
        scipy's name of the solver.
    relative, absolute : float
        Tolerances.
    **options : float
        `first_step`, `max_step` as scipy takes them.

    Returns
    -------
    SolvedPath
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
    solver: Any = solve_ivp
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
