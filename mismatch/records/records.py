"""A campaign laid out in even arrays, one row per trial, so that all trials are fitted at once.

A campaign: what was recorded, trial by trial, in metres, radians and seconds.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from metrology import TooLittleDataError, UsageError
from mismatch.model.baseline import Baseline
from physics.domain import FloatArray

__all__ = ["CampaignRecords", "Records", "Trial", "lay_out"]


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
class CampaignRecords:
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

    def only(self, names: frozenset[str]) -> "CampaignRecords":
        """Campaign with the named trials alone."""
        return CampaignRecords(tuple(t for t in self.trials if t.name in names), self.notes)


@dataclass(frozen=True)
class Records:
    """Samples of T trials, padded to S ball rows and P pendulum rows.

    Attributes
    ----------
    ball_time : (T, S) array
        s on each trial's own clock; padding repeats the last time.
    position : (T, S, 3) array
        m; zero where unused.
    ball_used : (T, S, 3) bool array
        Which coordinates take part in fits.
    pendulum_time, pendulum_angle : (T, P) array
        s, rad.
    pendulum_used : (T, P) bool array
        Which angles take part.
    sigma : (T, 4) array
        White noise of x, y, z (m) and angle (rad).
    backswing : (T,) array
        Nominal, rad; NaN where not known.
    mass, diameter, launch_angle : (T,) array
        Of each trial's ball.
    ball_index : (T,) int array
        Which of `ball_names` flies.
    ball_names : tuple of str
        Balls in the campaign.
    inflation : (4,) array
        Variance in `sigma` over that of one sample, by channel: memory of the noise.
    """

    ball_time: FloatArray
    position: FloatArray
    ball_used: NDArray[np.bool_]
    pendulum_time: FloatArray
    pendulum_angle: FloatArray
    pendulum_used: NDArray[np.bool_]
    sigma: FloatArray
    backswing: FloatArray
    mass: FloatArray
    diameter: FloatArray
    launch_angle: FloatArray
    ball_index: NDArray[np.int64]
    ball_names: tuple[str, ...]
    inflation: FloatArray = field(default_factory=lambda: np.ones(4))

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self.ball_time.shape[0])

    @property
    def order(self) -> FloatArray:
        """(T,) place of each trial in the campaign, −½ to ½."""
        count = self.trials
        return np.arange(count) / max(count - 1, 1) - 0.5

    @property
    def used(self) -> NDArray[np.bool_]:
        """(T, 3S + P) which entries of the stacked record take part: x, y, z, then angles."""
        flat = np.moveaxis(self.ball_used, -1, 1).reshape(self.trials, -1)
        return np.concatenate([flat, self.pendulum_used], axis=1)

    @property
    def values(self) -> FloatArray:
        """(T, 3S + P) the stacked record."""
        flat = np.moveaxis(self.position, -1, 1).reshape(self.trials, -1)
        return np.concatenate([flat, self.pendulum_angle], axis=1)

    @property
    def weights(self) -> FloatArray:
        """(T, 3S + P) one over sigma where used, else zero."""
        s, p = self.ball_time.shape[1], self.pendulum_time.shape[1]
        sigma = np.concatenate(
            [np.repeat(self.sigma[:, :3], s, axis=1), np.repeat(self.sigma[:, 3:], p, axis=1)],
            axis=1,
        )
        return np.where(self.used, 1.0 / sigma, 0.0)

    @property
    def count(self) -> int:
        """Number of entries that take part."""
        return int(self.used.sum())

    @property
    def expected(self) -> float:
        """Chi-square that noise alone leaves: sigma of slow quantities is wide for one sample."""
        ball = self.ball_used.sum(axis=(0, 1)) / self.inflation[:3]
        return float(ball.sum() + self.pendulum_used.sum() / self.inflation[3])

    def keeping(self, kept: NDArray[np.bool_]) -> "Records":
        """Records in which only entries marked in `kept` (T, 3S + P) still take part."""
        s = self.ball_time.shape[1]
        ball = np.moveaxis(kept[:, : 3 * s].reshape(self.trials, 3, s), 1, -1)
        return replace(
            self,
            ball_used=self.ball_used & ball,
            pendulum_used=self.pendulum_used & kept[:, 3 * s :],
        )

    def chosen(self, trials: NDArray[np.bool_]) -> "Records":
        """Records in which only the marked trials (T,) still take part."""
        return replace(
            self,
            ball_used=self.ball_used & trials[:, None, None],
            pendulum_used=self.pendulum_used & trials[:, None],
        )


def lay_out(campaign: CampaignRecords, baseline: Baseline) -> Records:
    """Pad a campaign's trials to even arrays and attach the bodies of the baseline.

    Raises
    ------
    SetupError
        If the baseline does not describe a trial's ball.
    """
    trials = campaign.trials
    count = len(trials)
    s = max(1, *(t.ball_time.size for t in trials))
    p = max(1, *(t.pendulum_time.size for t in trials))
    ball_time, position = np.zeros((count, s)), np.zeros((count, s, 3))
    ball_used = np.zeros((count, s, 3), dtype=bool)
    pendulum_time, angle = np.zeros((count, p)), np.zeros((count, p))
    pendulum_used = np.zeros((count, p), dtype=bool)
    bodies = [baseline.ball(t.ball) if t.ball_time.size else None for t in trials]
    names = tuple(dict.fromkeys(body.name for body in bodies if body is not None))
    for row, trial in enumerate(trials):
        n, m = trial.ball_time.size, trial.pendulum_time.size
        if n:
            ball_time[row, :n], ball_time[row, n:] = trial.ball_time, trial.ball_time[-1]
            finite = np.isfinite(trial.position)
            position[row, :n] = np.where(finite, trial.position, 0.0)
            ball_used[row, :n] = finite
        if m:
            pendulum_time[row, :m] = trial.pendulum_time
            pendulum_time[row, m:] = trial.pendulum_time[-1]
            angle[row, :m] = trial.pendulum_angle
            pendulum_used[row, :m] = np.isfinite(trial.pendulum_angle)
            angle[row] = np.nan_to_num(angle[row])
    return Records(
        ball_time,
        position,
        ball_used,
        pendulum_time,
        angle,
        pendulum_used,
        np.ones((count, 4)),
        np.array([np.nan if t.backswing is None else t.backswing for t in trials]),
        np.array([1.0 if b is None else b.mass for b in bodies]),
        np.array([0.1 if b is None else b.diameter for b in bodies]),
        np.array(
            [np.nan if b is None or b.launch_angle is None else b.launch_angle for b in bodies]
        ),
        np.array([0 if b is None else names.index(b.name) for b in bodies], dtype=np.int64),
        names or ("",),
    )
