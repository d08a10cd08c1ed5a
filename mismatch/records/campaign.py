"""A campaign: what was recorded, trial by trial, in metres, radians and seconds."""

from dataclasses import dataclass

import numpy as np

from metrology import TooLittleDataError, UsageError
from physics.arrays import FloatArray

__all__ = ["Campaign", "Trial"]


@dataclass(frozen=True)
class Trial:
    """One recorded shot, drop, flight or swing. Every trial has a clock of its own.

    Attributes
    ----------
    name : str
        What the column ``trial`` says.
    ball_time : (n,) array
        s, increasing.
    position : (n, 3) array
        Ball's centre x, y, z, m; NaN where a coordinate was not measured.
    pendulum_time, pendulum_angle : (m,) array
        s and rad.
    ball : str or None
        Name of the ball.
    backswing : float or None
        Nominal back-swing angle, rad.
    position_std : (n, 3) array or None
        Claimed standard uncertainty, m. Tested against the data, not believed.
    """

    name: str
    ball_time: FloatArray
    position: FloatArray
    pendulum_time: FloatArray
    pendulum_angle: FloatArray
    ball: str | None = None
    backswing: float | None = None
    position_std: FloatArray | None = None

    def __post_init__(self) -> None:
        for name, times in (("ball", self.ball_time), ("pendulum", self.pendulum_time)):
            if times.size > 1 and np.any(np.diff(times) <= 0.0):
                raise UsageError(
                    f"trial {self.name}: the {name}'s clock does not run forward",
                    hint="Times must increase within a trial; are two trials mixed?",
                )

    @property
    def samples(self) -> int:
        """Number of rows, ball and pendulum together."""
        return self.ball_time.size + self.pendulum_time.size


@dataclass(frozen=True)
class Campaign:
    """Trials that one model should explain.

    Attributes
    ----------
    trials : tuple of Trial
        In the order they were recorded.
    notes : tuple of str
        What was set right or left out while reading.
    """

    trials: tuple[Trial, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.trials:
            raise TooLittleDataError("there is no trial in the data")

    @property
    def channels(self) -> tuple[int, ...]:
        """Indices of the coordinates that were measured (0, 1, 2 for x, y, z)."""
        return tuple(
            axis
            for axis in range(3)
            if any(np.isfinite(trial.position[:, axis]).any() for trial in self.trials)
        )

    def only(self, names: frozenset[str]) -> "Campaign":
        """Campaign with the named trials alone."""
        return Campaign(tuple(t for t in self.trials if t.name in names), self.notes)
