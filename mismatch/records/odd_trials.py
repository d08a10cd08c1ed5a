"""Trials that say nothing of their own, or whose clock can't be believed."""

from dataclasses import replace
from enum import Enum

import numpy as np
from scipy.stats import rankdata

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

ROUGH = 1.2
"""Rank von Neumann ratio from which samples do not follow one another: of noise it is 2 ± 2/√n, of
a motion that is sampled ten times in its course a few hundredths."""

ENOUGH = 8
"""Samples that can tell whether they follow one another."""

LONGEST, SHORTEST = 1e5, 1e-5
"""s that a record may last: a day, and the contact of the hardest bodies."""

FARTHEST = 1e6
"""m or rad: beyond the sky, and a wheel no pendulum."""

LEAST_WAY = 1e-9
"""m or rad: no instrument sees less."""

CLOCK = 1e-2
"""Share of a step that the rounding of a clock may be."""

SEEN = 0.05
"""m that the ball must get on in a pause for its way to say anything."""


def without_odd_trials(campaign: Campaign) -> Campaign:
    """The campaign without trials that say nothing of their own, or nothing at all.

    Those are copies of others, trials whose clock jumps ahead or can't be one, in which nothing
    moves, and whose samples do not follow one another: noise alone, or rows in no order.

    Raises
    ------
    UsageError
        If no trial is left.
    """
    kept: list[Trial] = []
    odd: dict[_Odd, list[str]] = {}
    for trial in campaign.trials:
        why = _oddity(trial, kept)
        if why is None:
            kept.append(trial)
        else:
            odd.setdefault(why, []).append(trial.name)
    if not kept:
        worst = max((why for why in odd if why is not _Odd.COPY), key=lambda why: len(odd[why]))
        raise UsageError(
            worst.value.format(f"every trial ({', '.join(odd[worst][:4])})"), hint=_HINTS[worst]
        )
    notes = [*campaign.notes]
    for why, names in odd.items():
        listed = f"{', '.join(names[:6])}{', …' if len(names) > 6 else ''}"
        notes.append(f"{why.value.format(f'trial {listed}')}; left out")
    return replace(campaign, trials=tuple(kept), notes=tuple(notes)) if odd else campaign


class _Odd(Enum):
    """What is odd about trials, as a note says it of them."""

    COPY = "what {} recorded repeats other trials number by number, which is no further evidence"
    JUMP = "the clock jumps ahead in {}, while the ball does not"
    CLOCK = "the times in {} are none of a motion that anyone could film"
    FAR = "positions or angles in {} are beyond all bounds"
    STILL = "nothing moves in {}"
    ROUGH = "the samples of {} do not follow one another"


_HINTS = {
    _Odd.JUMP: "While t_s goes on, the ball does not; are the times those of the frames?",
    _Odd.CLOCK: "t_s is in seconds, and needs decimals enough to tell one sample from the next.",
    _Odd.FAR: "Positions are in metres and angles in radians.",
    _Odd.STILL: "Each trial needs a moving ball or a swinging pendulum.",
    _Odd.ROUGH: "Are the rows in order, and is it one trial under each name? Or is it noise alone?",
}


def _oddity(trial: Trial, others: list[Trial]) -> _Odd | None:
    if not _believable_clock(trial.ball_time) or not _believable_clock(trial.pendulum_time):
        return _Odd.CLOCK
    series = _series(trial)
    if any(float(np.abs(values).max()) > FARTHEST for values in series):
        return _Odd.FAR
    if series and all(float(np.ptp(values)) < LEAST_WAY for values in series):
        return _Odd.STILL
    rough = [_roughness(values) for values in series if values.size >= ENOUGH]
    if rough and min(rough) > ROUGH:
        return _Odd.ROUGH
    if _clock_jumps(trial.ball_time, trial.position):
        return _Odd.JUMP
    return _Odd.COPY if any(_same(trial, other) for other in others) else None


def _series(trial: Trial) -> list[FloatArray]:
    """What was recorded, channel by channel."""
    channels = [*trial.position.T, trial.pendulum_angle]
    finite = [np.asarray(values[np.isfinite(values)]) for values in channels]
    return [values for values in finite if values.size]


def _roughness(values: FloatArray) -> float:
    """Rank von Neumann ratio (Bartels, J. Am. Stat. Assoc. 77, 40 (1982)): 2 for noise."""
    ranks = rankdata(values)
    spread = float(np.square(ranks - ranks.mean()).sum())
    return float(np.square(np.diff(ranks)).sum()) / spread if spread > 0.0 else 2.0


def _believable_clock(time: FloatArray) -> bool:
    if time.size < 2:
        return True
    span = float(time[-1] - time[0])
    if not SHORTEST < span < LONGEST:
        return False
    rounding = float(np.spacing(np.abs(time).max()))
    return rounding < CLOCK * float(np.median(np.diff(time)))


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
