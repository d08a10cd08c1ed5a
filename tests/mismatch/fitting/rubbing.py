"""Free swings with bearing friction, integrated independently of the engine."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

FloatArray = NDArray[np.float64]


def swung(
    start: float,
    time: FloatArray,
    stiffness: float,
    friction: Callable[[float], float],
    linear: float = 0.0,
) -> FloatArray:
    """Angle at the given times, until friction stops the pendulum.

    Friction, a function of the rate, and `linear` are torques over inertia, 1/s² and 1/s;
    stiffness is that of gravity, 1/s².
    """
    angle, began, way = np.full(time.size, np.nan), 0.0, -np.sign(start)
    state, soon = np.array([start, 0.0]), 1e-5
    while stiffness * abs(np.sin(state[0])) > friction(0.0) and began < time[-1]:

        def rate(_, s, way=way):
            return [s[1], -stiffness * np.sin(s[0]) - linear * s[1] - way * friction(s[1])]

        def turns(_, s, way=way):
            return s[1] * way

        turns.terminal, turns.direction = True, -1
        gained = rate(began, state)[1] * soon
        begin = np.add(state, [0.5 * gained * soon, gained])
        path = solve_ivp(rate, (began + soon, began + 9.0), begin,
                         events=turns, rtol=1e-10, atol=1e-12, dense_output=True)  # fmt: skip
        mine = (time >= began) & (time <= path.t[-1])
        if mine.any():
            angle[mine] = path.sol(time[mine])[0]
        began, state, way = path.t[-1], np.array([path.y[0, -1], 0.0]), -way
    angle[time >= began] = state[0]
    return angle
