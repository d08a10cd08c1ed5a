"""Trials that say nothing of their own, or whose clock can't be believed."""

import numpy as np

from metrology import UsageError
from mismatch.records.campaign import Campaign, Trial
from physics.arrays import FloatArray

__all__ = ["without_odd_trials"]

HOLE = 6.0
"""Median steps from which a pause of the clock may be a jump."""

BESIDE = 8
"""Rows on each side that tell how fast the ball is there."""

JUMPED = 0.5
"""Share of a pause that the ball's way must leave over before the clock has jumped."""

SEEN = 0.05
"""m that the ball must get on in a pause for its way to say anything."""


def without_odd_trials(campaign: Campaign) -> Campaign:
    """The campaign without copies of trials and without trials whose clock jumps ahead.

    Raises
    ------
    UsageError
        If the clock jumps in every trial.
    """
    kept: list[Trial] = []
    copies: list[str] = []
    jumping: list[str] = []
    for trial in campaign.trials:
        if _clock_jumps(trial.ball_time, trial.position):
            jumping.append(trial.name)
        elif any(_same(trial, other) for other in kept):
            copies.append(trial.name)
        else:
            kept.append(trial)
    if not kept:
        raise UsageError(
            f"the clock jumps ahead in every trial ({', '.join(jumping[:4])})",
            hint="While t_s goes on, the ball does not; are the times those of the frames?",
        )
    notes = [*campaign.notes]
    if copies:
        notes.append(
            f"trials {', '.join(copies[:6])} repeat other trials number by number, which is no"
            " further evidence; left out"
        )
    if jumping:
        notes.append(
            f"the clock jumps ahead in trial {', '.join(jumping[:6])}, while the ball does not;"
            " left out"
        )
    return Campaign(tuple(kept), tuple(notes)) if copies or jumping else campaign


def _same(one: Trial, other: Trial) -> bool:
    return np.array_equal(one.position, other.position, equal_nan=True) and np.array_equal(
        one.pendulum_angle, other.pendulum_angle, equal_nan=True
    )


def _clock_jumps(time: FloatArray, position: FloatArray) -> bool:
    """Whether the ball gets on far less in a pause of the clock than its speed on both sides says.

    Under a constant force the way is the mean of both velocities times the time.
    """
    found = np.asarray(np.isfinite(position).any(axis=0))
    rows = np.isfinite(position[:, found]).all(axis=1)
    if not found.any():
        return False
    time, place = time[rows], position[rows][:, found]
    if time.size < 2 * BESIDE:
        return False
    steps = np.diff(time)
    for at in np.flatnonzero(steps > HOLE * np.median(steps)) + 1:
        if at < BESIDE or time.size - at < BESIDE:
            continue
        before, after = slice(at - BESIDE, at), slice(at, at + BESIDE)
        first, v1 = _line(time[before], place[before], time[at - 1])
        last, v2 = _line(time[after], place[after], time[at])
        if np.linalg.norm(v1) < 0.2 * np.linalg.norm(v2):
            continue  # struck in between
        pause = float(steps[at - 1])
        way = 0.5 * (v1 + v2) * pause
        length = float(np.linalg.norm(way))
        if length > SEEN and float((last - first) @ way) < (1.0 - JUMPED) * length**2:
            return True
    return False


def _line(time: FloatArray, place: FloatArray, at: float) -> tuple[FloatArray, FloatArray]:
    """Place at a time and velocity, by a straight line through a few rows."""
    slope, level = np.polyfit(time - at, place, 1)
    return level, slope
