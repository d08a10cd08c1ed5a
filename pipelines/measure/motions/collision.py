"""Two like balls or pucks that meet: speeds on both sides, coefficient of restitution."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metrology import TooLittleDataError
from vision.tracks import Track

__all__ = ["Collision", "Passage", "fit_collision"]

FloatArray = NDArray[np.float64]

LINE_FRAMES = 20
"""Frames of a line on one side of the meeting: rolling and sliding slow down little over them."""
LEAST_FRAMES = 4
"""Frames on either side: two give a velocity, two more show whether it is steady."""
CENTRE_STD_SHARE = 0.02
"""Of the radius: how far an outline's centre may lie off the body's, for the line of centres."""


@dataclass(frozen=True)
class Passage:
    """One body on one side of the meeting, by a line or a parabola through its frames.

    Attributes
    ----------
    velocity : (2,) array
        At the meeting, px per unit of time.
    covariance : (2, 2) array
        Its covariance, with the doubt between line and parabola.
    place : (2,) array
        At the meeting, px.
    place_covariance : (2, 2) array
    """

    velocity: FloatArray
    covariance: FloatArray
    place: FloatArray
    place_covariance: FloatArray

    @property
    def speed(self) -> tuple[float, float]:
        """Speed and its standard uncertainty."""
        speed = float(np.hypot(*self.velocity))
        along = self.velocity / speed if speed > 0 else np.array([1.0, 0.0])
        return speed, math.sqrt(float(along @ self.covariance @ along))


@dataclass(frozen=True)
class Collision:
    """Both bodies on both sides; the first is the one that lay still.

    Attributes
    ----------
    time : float
        When they meet, in the unit of the tracks.
    before, after, other_before, other_after : Passage
    cor, cor_std : float
        Parting over approaching speed along the line of centres.
    momentum_apart : float
        Change of the total momentum of two like bodies over its standard uncertainty.
    """

    time: float
    before: Passage
    after: Passage
    other_before: Passage
    other_after: Passage
    cor: float
    cor_std: float
    momentum_apart: float


def fit_collision(ball: Track, other: Track, time: float, clock: FloatArray) -> Collision:
    """Fit a line to each body on each side of the meeting, never across it.

    Parameters
    ----------
    ball, other : Track
        Tracks of both, px.
    time : float
        When they meet, in the unit of `clock`.
    clock : (F,) array
        Time of each frame of the clip: s, or frames.

    Raises
    ------
    TooLittleDataError
        If one of them is not seen on both sides.
    """
    step = float(np.median(np.diff(clock)))
    sides = [
        _passage(track, clock, time, side, step, name)
        for track, name in ((ball, "the ball struck"), (other, "the ball that strikes"))
        for side in (-1, 1)
    ]
    before, other_before = sides[0], sides[2]

    def restitution(moved: list[FloatArray], line: FloatArray) -> float:
        normal = line / np.hypot(*line)
        approach = float((moved[2] - moved[0]) @ normal)
        return float((moved[1] - moved[3]) @ normal) / approach

    velocities = [side.velocity for side in sides]
    line = before.place - other_before.place
    reach = float(np.hypot(*line))
    cor = restitution(velocities, line)
    variance = 0.0
    for index, side in enumerate(sides):
        for value, vector in zip(*np.linalg.eigh(side.covariance), strict=True):
            moved = list(velocities)
            moved[index] = moved[index] + math.sqrt(max(value, 0.0)) * vector
            variance += (restitution(moved, line) - cor) ** 2
    across = np.array([-line[1], line[0]]) / reach
    spread = before.place_covariance + other_before.place_covariance
    centres = CENTRE_STD_SHARE * 0.5 * reach
    shift = math.sqrt(float(across @ spread @ across) + 2.0 * centres**2)
    variance += (restitution(velocities, line + shift * across) - cor) ** 2
    return Collision(
        time,
        before,
        sides[1],
        other_before,
        sides[3],
        cor,
        math.sqrt(variance),
        _momentum_apart(sides),
    )


def _momentum_apart(sides: list[Passage]) -> float:
    """Change of v + v' over its standard uncertainty: like bodies keep it."""
    before, after, other_before, other_after = sides
    change = after.velocity + other_after.velocity - before.velocity - other_before.velocity
    covariance = sum((side.covariance for side in sides), np.zeros((2, 2)))
    return math.sqrt(float(change @ np.linalg.pinv(covariance, hermitian=True) @ change) / 2.0)


def _passage(
    track: Track, clock: FloatArray, time: float, side: int, step: float, name: str
) -> Passage:
    at = clock[track.frame] - time
    used = (side * at > 0.6 * step) & (side * at < (LINE_FRAMES + 0.6) * step)
    if used.sum() < LEAST_FRAMES:
        where = "before" if side < 0 else "after"
        raise TooLittleDataError(
            f"{name} is seen in only {used.sum()} frames just {where} they meet",
            hint="Film both for five frames on each side of the meeting.",
        )
    elapsed, place = at[used] / step, track.centre_px[used]
    std = np.sqrt(0.5 * np.trace(track.covariance_px2[used], axis1=1, axis2=2))
    straight = _line(elapsed, place, std, 1)
    if used.sum() < 2 * LEAST_FRAMES:
        return _in_time(straight, np.zeros(2), step)
    # a body that slows down: the parabola is right where it matters, and costs where it does not
    bent = _line(elapsed, place, std, 2)
    bend, bend_var = bent[2]
    telling = bool(np.any(np.abs(bend) > 3.0 * np.sqrt(bend_var)))
    chosen, rival = (bent, straight) if telling else (straight, bent)
    doubt = np.zeros(2) if telling else 0.5 * (rival[0][1] - chosen[0][1])
    return _in_time(chosen, doubt, step)


_Line = tuple[FloatArray, FloatArray, tuple[FloatArray, FloatArray]]


def _line(elapsed: FloatArray, place: FloatArray, std: FloatArray, degree: int) -> _Line:
    """Coefficients (D+1, 2), their covariance (D+1, D+1, 2), and the bend with its variance."""
    design = elapsed[:, np.newaxis] ** np.arange(degree + 1)
    weight = 1.0 / np.maximum(std, 0.3 * float(np.median(std)))
    rows = design * weight[:, np.newaxis]
    normal = np.linalg.inv(rows.T @ rows)
    best = normal @ rows.T @ (place * weight[:, np.newaxis])
    left = (place - design @ best) * weight[:, np.newaxis]
    freedom = max(len(elapsed) - degree - 1, 1)
    scatter = np.maximum((left**2).sum(axis=0) / freedom, 1.0)
    covariance = normal[:, :, np.newaxis] * scatter
    bend = best[2] if degree == 2 else np.zeros(2)
    bend_var = covariance[2, 2] if degree == 2 else np.full(2, np.inf)
    return best, covariance, (bend, bend_var)


def _in_time(line: _Line, doubt: FloatArray, step: float) -> Passage:
    best, covariance, _ = line
    spread = np.diag(covariance[1, 1]) + np.outer(doubt, doubt)
    return Passage(best[1] / step, spread / step**2, best[0], np.diag(covariance[0, 0]))
