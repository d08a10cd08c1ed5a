"""Classical Runge-Kutta for a batch of bodies with Hermite interpolation."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bench.concealed.world.shots import Array

__all__ = ["Path", "first_crossing", "integrate"]

Rate = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Path:
    """States on an even grid of each body: state and rate (steps, n, k), step (n,)."""

    step: Array
    state: Array
    rate: Array

    def at(self, time: Array, body: int) -> Array:
        """States (len(time), k) of one body; outside the grid the end intervals continue."""
        scaled = time / self.step[body]
        index = np.clip(scaled.astype(int), 0, len(self.state) - 2)
        return _hermite(
            (scaled - index)[:, None],
            self.state[index, body],
            self.state[index + 1, body],
            self.rate[index, body] * self.step[body],
            self.rate[index + 1, body] * self.step[body],
        )

    def each_at(self, time: Array) -> Array:
        """State (n, k) of every body at its own time (n,)."""
        scaled = time / self.step
        index = np.clip(scaled.astype(int), 0, len(self.state) - 2)
        body = np.arange(len(self.step))
        return _hermite(
            (scaled - index)[:, None],
            self.state[index, body],
            self.state[index + 1, body],
            self.rate[index, body] * self.step[:, None],
            self.rate[index + 1, body] * self.step[:, None],
        )


def _hermite(s: Array, left: Array, right: Array, left_rate: Array, right_rate: Array) -> Array:
    return (
        (1 + 2 * s) * (1 - s) ** 2 * left
        + s * (1 - s) ** 2 * left_rate
        + s**2 * (3 - 2 * s) * right
        + s**2 * (s - 1) * right_rate
    )


def integrate(
    rate: Rate,
    start: Array,
    step: Array,
    steps: int,
    finished: Callable[[Array, Array], bool] | None = None,
) -> Path:
    """Integrate `start` (n, k) by `steps` steps of size (n,), one size per body.

    `finished(time, state)` ends the integration when it is true for all bodies.
    """
    states, rates = [start], [rate(np.zeros_like(step), start)]
    wide = step[:, None]
    for number in range(steps):
        time, state, k1 = number * step, states[-1], rates[-1]
        k2 = rate(time + step / 2, state + wide / 2 * k1)
        k3 = rate(time + step / 2, state + wide / 2 * k2)
        k4 = rate(time + step, state + wide * k3)
        states.append(state + wide / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
        rates.append(rate(time + step, states[-1]))
        if finished is not None and number % 20 == 19 and finished(time + step, states[-1]):
            break
    return Path(step=step, state=np.array(states), rate=np.array(rates))


def first_crossing(path: Path, value: Callable[[Array], Array], after: int = 1) -> Array:
    """Time (n,) at which `value(state)` first rises through zero after step `after`."""
    values = value(path.state)
    rising = (values[after:-1] < 0) & (values[after + 1 :] >= 0)
    if not rising.any(axis=0).all():
        raise ArithmeticError("a body does not reach the event")
    index = rising.argmax(axis=0) + after
    low, high = index * path.step, (index + 1) * path.step
    for _ in range(44):
        middle = (low + high) / 2
        below = value(path.each_at(middle)) < 0
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return (low + high) / 2
