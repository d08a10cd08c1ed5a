"""Classical Runge–Kutta in bare floats or arrays: flies one ball or thousands at once."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from metrology import DomainError
from physics.arrays import FloatArray, Number, Vector
from physics.flight.forces import Acceleration, SpinRate, total_acceleration

__all__ = ["BallState", "fly_many", "march", "runge_kutta_step", "sample_flights"]

NO_SPIN: Vector = (0.0, 0.0, 0.0)


class BallState(NamedTuple):
    """Position (m), velocity (m/s) and spin (rad/s), components of floats or arrays."""

    position: Vector
    velocity: Vector
    spin: Vector = NO_SPIN


def _ahead(base: Vector, step: Number, rate: Vector) -> Vector:
    return base[0] + step * rate[0], base[1] + step * rate[1], base[2] + step * rate[2]


def _blend(a: Vector, b: Vector, c: Vector, d: Vector) -> Vector:
    return (
        a[0] + 2.0 * (b[0] + c[0]) + d[0],
        a[1] + 2.0 * (b[1] + c[1]) + d[1],
        a[2] + 2.0 * (b[2] + c[2]) + d[2],
    )


def runge_kutta_step(
    time: Number,
    state: BallState,
    step: Number,
    forces: Sequence[Acceleration],
    spin_rate: SpinRate | None = None,
) -> BallState:
    """One classical fourth-order step.

    Parameters
    ----------
    time, step : float or array
        s.
    state : BallState
    forces : sequence of Acceleration
    spin_rate : SpinRate, optional
        Without it the spin is constant.

    Returns
    -------
    BallState
    """
    x, v, w = state
    half = 0.5 * step
    middle = time + half
    a1 = total_acceleration(forces, time, x, v, w)
    w1 = spin_rate(time, x, v, w) if spin_rate else NO_SPIN
    x2, v2 = _ahead(x, half, v), _ahead(v, half, a1)
    s2 = _ahead(w, half, w1) if spin_rate else w
    a2 = total_acceleration(forces, middle, x2, v2, s2)
    w2 = spin_rate(middle, x2, v2, s2) if spin_rate else NO_SPIN
    x3, v3 = _ahead(x, half, v2), _ahead(v, half, a2)
    s3 = _ahead(w, half, w2) if spin_rate else w
    a3 = total_acceleration(forces, middle, x3, v3, s3)
    w3 = spin_rate(middle, x3, v3, s3) if spin_rate else NO_SPIN
    x4, v4 = _ahead(x, step, v3), _ahead(v, step, a3)
    s4 = _ahead(w, step, w3) if spin_rate else w
    a4 = total_acceleration(forces, time + step, x4, v4, s4)
    sixth = step / 6.0
    spin = w
    if spin_rate:
        w4 = spin_rate(time + step, x4, v4, s4)
        spin = _ahead(w, sixth, _blend(w1, w2, w3, w4))
    return BallState(
        _ahead(x, sixth, _blend(v, v2, v3, v4)), _ahead(v, sixth, _blend(a1, a2, a3, a4)), spin
    )


def march(
    state: BallState,
    duration: Number,
    steps: int,
    forces: Sequence[Acceleration],
    spin_rate: SpinRate | None = None,
    *,
    time: Number = 0.0,
) -> BallState:
    """Advance by `duration` (s, negative goes back) in `steps` equal steps."""
    step = duration / steps
    for count in range(steps):
        state = runge_kutta_step(time + count * step, state, step, forces, spin_rate)
    return state


def sample_flights(
    times: FloatArray,
    state: BallState,
    forces: Sequence[Acceleration],
    spin_rate: SpinRate | None = None,
    *,
    start: Number = 0.0,
    longest_step: float = 0.02,
) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities of one or many flights at given times.

    Parameters
    ----------
    times : (T,) or (T, N) array
        s, increasing along the first axis; with (T, N) every flight has its own.
    state : BallState
        State at `start`; components float or (N,).
    forces, spin_rate
        The model; their parameters may be arrays (N,).
    start : float or (N,) array
        When the flights begin, s; earlier samples go back along the same law.
    longest_step : float
        Longest step between samples, s.

    Returns
    -------
    position, velocity : (T, 3) or (T, N, 3) arrays
        m, m/s.
    """
    shape = np.broadcast_shapes(np.shape(times)[1:], np.shape(start), _shape(state, forces))
    position = np.empty((len(times), *shape, 3))
    velocity = np.empty_like(position)
    now = start
    for row, when in enumerate(times):
        gap = when - now
        steps = max(1, int(np.ceil(np.max(np.abs(gap)) / longest_step)))
        state = march(state, gap, steps, forces, spin_rate, time=now)
        now = when
        for axis in range(3):
            position[row, ..., axis] = state.position[axis]
            velocity[row, ..., axis] = state.velocity[axis]
    return position, velocity


def fly_many(
    state: BallState,
    forces: Sequence[Acceleration],
    spin_rate: SpinRate | None = None,
    *,
    floor: Number = 0.0,
    step: float = 0.02,
    longest: float = 20.0,
) -> tuple[FloatArray, BallState]:
    """Fly many balls to the floor at once.

    Parameters
    ----------
    state : BallState
        At launch; components float or (N,).
    forces, spin_rate
        The model; their parameters may be arrays (N,).
    floor : float or (N,) array
        Height of the ball's centre at landing, m.
    step : float
        Step, s.
    longest : float
        Longest flight followed, s.

    Returns
    -------
    time : (N,) array
        Landing times, s after launch.
    BallState
        At landing; components (N,).

    Raises
    ------
    DomainError
        If a ball has not landed within `longest`, or starts below the floor.
    """
    shape = np.broadcast_shapes(np.shape(floor), _shape(state, forces)) or (1,)
    state = BallState(*(_arrays(part, shape) for part in state))
    level = np.broadcast_to(np.asarray(floor, dtype=np.float64), shape)
    if np.any(np.asarray(state.position[1]) < level):
        raise DomainError("a flight can't start below the floor")
    landed = np.zeros(shape, dtype=bool)
    since = np.zeros(shape)
    bracket = state
    for count in range(int(np.ceil(longest / step))):
        after = runge_kutta_step(count * step, state, step, forces, spin_rate)
        below = np.asarray(after.position[1]) <= level
        arrives = below & ~landed & (np.asarray(after.velocity[1]) < 0.0)
        if arrives.any():
            bracket = _pick(arrives, state, bracket)
            since = np.where(arrives, count * step, since)
            landed |= arrives
        if landed.all():
            return _land(bracket, since, step, forces, spin_rate, level)
        state = after
    raise DomainError(
        f"{int(np.sum(~landed))} of {landed.size} balls have not landed after {longest:g} s",
        hint="Is there gravity, and is the wind or lift of a believable size?",
    )


def _shape(state: BallState, forces: Sequence[Acceleration]) -> tuple[int, ...]:
    """Shape of state and forces together: a force's parameters may be arrays of their own."""
    gain = total_acceleration(forces, 0.0, *state)
    return np.broadcast_shapes(*(np.shape(c) for part in (*state, gain) for c in part))


def _arrays(part: Vector, shape: tuple[int, ...]) -> Vector:
    a, b, c = (np.array(np.broadcast_to(np.asarray(v, dtype=np.float64), shape)) for v in part)
    return a, b, c


def _pick(choose: NDArray[np.bool_], these: BallState, others: BallState) -> BallState:
    def part(a: Vector, b: Vector) -> Vector:
        return (
            np.where(choose, a[0], b[0]),
            np.where(choose, a[1], b[1]),
            np.where(choose, a[2], b[2]),
        )

    return BallState(*(part(a, b) for a, b in zip(these, others, strict=True)))


def _land(
    bracket: BallState,
    since: FloatArray,
    step: float,
    forces: Sequence[Acceleration],
    spin_rate: SpinRate | None,
    level: FloatArray,
) -> tuple[FloatArray, BallState]:
    """Newton's method on the last step's length, from where each ball was still above the floor."""
    fall = np.full(since.shape, 0.5 * step)
    there = bracket
    for _ in range(6):
        there = runge_kutta_step(since, bracket, fall, forces, spin_rate)
        miss = np.asarray(there.position[1]) - level
        if np.max(np.abs(miss)) < 1e-12:
            break
        slope = np.minimum(np.asarray(there.velocity[1]), -1e-9)
        fall = np.clip(fall - miss / slope, 0.0, step)
    return since + fall, there
