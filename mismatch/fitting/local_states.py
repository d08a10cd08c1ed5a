"""States of a swinging pendulum read off the record itself, with no model of its losses."""

import math
from dataclasses import dataclass

import numpy as np

from mismatch.records.records import Records
from physics.arrays import FloatArray

__all__ = ["SwingSeen", "local_states", "seen_in_halves", "seen_swings"]

WINDOW = 0.09
"""Periods on each side of an instant over which a cubic follows a swing."""

FEWEST = 5
MOST = 200
"""Rows of a local fit: the nearest ones, so that a slow swing at a high rate costs no more."""

TURNED = 0.25
"""Share of the amplitude that a swing must come back through before it counts as a half swing."""


@dataclass(frozen=True)
class SwingSeen:
    """What a record says about its swing before anything is fitted.

    Attributes
    ----------
    rate : float
        Angular frequency of small swings, rad/s; NaN where less than one half swing was seen.
    middle, amplitude : float
        rad.
    half_swings : int
        Passages from one side to the other.
    pace : float
        Angular frequency as seen, at the swing's own amplitude, rad/s; NaN as `rate`.
    """

    rate: float
    middle: float
    amplitude: float
    half_swings: int
    pace: float = math.nan


def seen_swings(records: Records) -> tuple[SwingSeen, ...]:
    """Frequency, middle and amplitude of every trial, from its passages through the middle."""
    found = []
    for trial in range(records.trials):
        used = records.pendulum_used[trial]
        found.append(_seen(records.pendulum_time[trial, used], records.pendulum_angle[trial, used]))
    return tuple(found)


def seen_in_halves(records: Records) -> tuple[SwingSeen, ...]:
    """What the first and the second half of every record show: losses part their amplitudes."""
    found = []
    for trial in range(records.trials):
        used = records.pendulum_used[trial]
        time, angle = records.pendulum_time[trial, used], records.pendulum_angle[trial, used]
        cut = time.size // 2
        found += [_seen(time[:cut], angle[:cut]), _seen(time[cut:], angle[cut:])]
    return tuple(found)


def _seen(time: FloatArray, angle: FloatArray) -> SwingSeen:
    if angle.size < FEWEST:
        return SwingSeen(math.nan, 0.0, 0.0, 0)
    low, high = float(angle.min()), float(angle.max())
    middle, amplitude = 0.5 * (low + high), max(0.5 * (high - low), 1e-12)
    passed = _passages(time, angle - _running_middle(angle, middle), amplitude)
    if passed.size < 2:
        return SwingSeen(math.nan, middle, amplitude, int(passed.size))
    # A swing of amplitude A takes 1 + A²/16 + … longer; the mean amplitude is good enough here.
    mean = min(_mean_amplitude(time, angle, passed), 3.0)
    longer = 1.0 + mean**2 / 16.0 + 11.0 * mean**4 / 3072.0 + 173.0 * mean**6 / 737280.0
    half = float(passed[-1] - passed[0]) / (passed.size - 1)
    pace = math.pi / half
    return SwingSeen(pace * longer, middle, amplitude, int(passed.size), pace)


def _running_middle(angle: FloatArray, middle: float) -> float:
    """The middle of the slow end, where losses have brought both sides together."""
    tail = angle[-max(FEWEST, angle.size // 2) :]
    inner = 0.5 * float(tail.min() + tail.max())
    return inner if np.ptp(tail) > 0.1 * np.ptp(angle) else middle


def _passages(time: FloatArray, angle: FloatArray, amplitude: float) -> FloatArray:
    """Times at which the swing passes its middle, noise about it not counted twice."""
    found: list[float] = []
    turned, peak, before = True, 0.0, amplitude
    for at in range(1, angle.size):
        peak = max(peak, abs(float(angle[at])))
        turned = turned or peak > TURNED * before
        if angle[at - 1] * angle[at] <= 0.0 and angle[at] != angle[at - 1] and turned:
            share = angle[at - 1] / (angle[at - 1] - angle[at])
            found.append(float(time[at - 1] + share * (time[at] - time[at - 1])))
            turned, peak, before = False, 0.0, peak
    return np.array(found)


def _mean_amplitude(time: FloatArray, angle: FloatArray, passed: FloatArray) -> float:
    cuts = np.searchsorted(time, passed)
    parts = [part for part in np.split(angle, cuts)[1:-1] if part.size]
    centre = 0.5 * (max(float(p.max()) for p in parts) + min(float(p.min()) for p in parts))
    peaks = [float(np.abs(part - centre).max()) for part in parts]
    return float(np.sqrt(np.mean(np.square(peaks))))


def local_states(records: Records, trial: int, at: FloatArray, rate: float) -> FloatArray:
    """Angle and rate of a trial at some instants, by cubics through the rows nearby.

    Parameters
    ----------
    records : Records
    trial : int
    at : (J,) array
        s after the trial's first row.
    rate : float
        Angular frequency of its swing, rad/s.

    Returns
    -------
    (J, 2) array
        rad and rad/s; NaN where fewer than five rows lie within a third of a period.
    """
    used = records.pendulum_used[trial]
    time = records.pendulum_time[trial, used] - records.pendulum_time[trial, 0]
    angle = records.pendulum_angle[trial, used]
    period = 2.0 * math.pi / rate
    states = np.full((at.size, 2), np.nan)
    if time.size < FEWEST:
        return states
    for row, instant in enumerate(at):
        apart = np.abs(time - instant)
        near = np.flatnonzero(apart < WINDOW * period)
        if near.size < FEWEST or near.size > MOST:
            near = np.argsort(apart)[: FEWEST if near.size < FEWEST else MOST]
        if apart[near].max() > period / 3.0:
            continue
        scale = max(float(apart[near].max()), 1e-12)
        degree = 3 if near.size > FEWEST else 2
        fitted = np.polynomial.polynomial.polyfit(
            (time[near] - instant) / scale, angle[near], degree
        )
        states[row] = fitted[0], fitted[1] / scale
    return states
