"""Whether two pieces of path are of one thing that was not seen for a while: odds, in nats.

Each piece ends, or begins, by a law of motion: a parabola through the looks nearest to the gap, for
as many of them as it explains. Both laws are led into the gap, each with the uncertainty that it
has there. One thing flies on by one law, or changes it once in the gap, at any moment, where both
then are in one place; of two things that have nothing to do with one another the later is anywhere,
at any speed. The odds of the one against the other, and those of size and light, multiply.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["PieceOfPath", "one_thing"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FEWEST_LOOKS = 3
"""Looks: what is seen in fewer has no law."""

_LOOKS = (34, 24, 17, 12, 8, 6, 4, 3)
"""Looks that a law is fitted to, tried from the most on: ever two thirds of those before."""

_SCATTER_RADII, _SCATTER_PX = 0.1, 0.3
"""Radii, and px, by which a look scatters, supposed."""

_MOSTLY, _OFF = 0.8, 3.0
"""Share of the looks that a law explains at least, and scatters beyond which it does not."""

_WHOLE, _USUALLY = 0.8, 0.75
"""Part of the usual outline that is seen of what is not half hidden; and the part of the looks that
show no more than usual, supposed."""

_ROUNDS = 4
"""Rounds of reweighting, supposed: outliers are out after a few."""

_SLACK_RADII, _SLACK_PX, _SLACK_SPEED = 0.25, 1.0, 0.02
"""Radii, px, and share of the speed, supposed: what neighbouring looks are off by together, where a
thing is half hidden, and what drag and lens make of a parabola."""

_BREAKS = 0.1
"""Part of the gaps in which a thing is struck, bounces or is let go, supposed."""

_MOMENTS = 33
"""Moments of a gap at which the law may change."""

_SIZE, _SIZES = 0.15, 0.8
"""Log radius by which two looks at one thing differ, and by which two things do, supposed."""

_LIGHT, _LIGHTS = 20.0, 60.0
"""Gray levels by which two looks at one thing differ, and two things do, supposed."""

_LIGHT_LOOKS = 6
"""Looks nearest to the gap whose light is compared."""


class PieceOfPath(Protocol):
    """What is asked of a piece, of each of its looks."""

    @property
    def frame(self) -> IntArray:
        """Frames (N,), increasing."""

    @property
    def centre_px(self) -> FloatArray:
        """Centres (N, 2), px."""

    @property
    def radius_px(self) -> FloatArray:
        """Radii (N,), px."""

    @property
    def coverage(self) -> FloatArray:
        """Parts of the outline that were seen (N,)."""

    @property
    def level(self) -> FloatArray:
        """Mean light (N,), gray levels."""


@dataclass(frozen=True)
class _Law:
    """Place, velocity and acceleration (3, 2) at a moment, with their covariance along one axis.

    `bend` is the scatter of accelerations that was supposed beforehand, px per frame².
    """

    moment: float
    state: FloatArray
    covariance: FloatArray
    bend: float

    def at(self, moments: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places (n, 2) at other moments, and their variances (n,)."""
        powers = _powers(moments - self.moment)
        return powers @ self.state, np.einsum("ni,ij,nj->n", powers, self.covariance, powers)


def one_thing(head: PieceOfPath, tail: PieceOfPath, reach_px: float) -> float:
    """Log odds that a later piece goes on with a thing rather than being another one.

    Parameters
    ----------
    head, tail : PieceOfPath
        The earlier and the later piece.
    reach_px : float
        Extent of the region in which things are seen, px.

    Returns
    -------
    float
        Nats; minus infinity where the pieces overlap, or are of too few looks.
    """
    gap = float(tail.frame[0] - head.frame[-1])
    if gap < 1.0 or min(len(head.frame), len(tail.frame)) < FEWEST_LOOKS:
        return -math.inf
    middle = 0.5 * float(tail.frame[0] + head.frame[-1])
    nearest, next_ones = _whole(head)[::-1], _whole(tail)
    sizes = (float(np.median(head.radius_px[nearest])), float(np.median(tail.radius_px[next_ones])))
    before = _law(head.frame[nearest], head.centre_px[nearest], sizes[0], middle)
    after = _law(tail.frame[next_ones], tail.centre_px[next_ones], sizes[1], middle)
    radius = min(sizes)
    moves = math.log1p(-_BREAKS) + _flies_on(before, after, radius, reach_px)
    moments = np.linspace(head.frame[-1], tail.frame[0], _MOMENTS)
    broken = math.log(_BREAKS) + _meets(before, after, moments, radius, reach_px)
    lights = (head.level[nearest[:_LIGHT_LOOKS]], tail.level[next_ones[:_LIGHT_LOOKS]])
    alike = _odds(math.log(sizes[1] / sizes[0]), _SIZE, _SIZES)
    alike += _odds(float(np.median(lights[1]) - np.median(lights[0])), _LIGHT, _LIGHTS)
    return float(np.logaddexp(moves, broken)) + alike


def _whole(piece: PieceOfPath) -> IntArray:
    """Looks at which it is not half hidden, where there are enough of them: others lie aside."""
    usual = float(np.quantile(piece.coverage, _USUALLY))
    whole = np.flatnonzero(piece.coverage >= _WHOLE * usual)
    return whole if len(whole) >= FEWEST_LOOKS else np.arange(len(piece.frame))


def _powers(time: FloatArray) -> FloatArray:
    return np.column_stack([np.ones_like(time), time, 0.5 * time * time])


def _law(frame: IntArray, centre: FloatArray, radius: float, moment: float) -> _Law:
    """The law of the looks nearest to the gap, first in order, for as many as it explains."""
    for count in _LOOKS:
        if count > len(frame) and count != FEWEST_LOOKS:
            continue
        law, explained = _fitted(frame[:count], centre[:count], radius, moment)
        if explained >= _MOSTLY:
            break
    return law


def _fitted(
    frame: IntArray, centre: FloatArray, radius: float, moment: float
) -> tuple[_Law, float]:
    """A parabola through some looks at a moment, and the share of them that it explains."""
    scatter = _SCATTER_RADII * radius + _SCATTER_PX
    span = float(np.ptp(frame))
    # in its span a velocity may change by about as much as there is of it
    speed = float(np.hypot(*(centre[-1] - centre[0]))) / span
    bend = (speed + radius / span) / span
    powers = _powers(np.asarray(frame - moment, dtype=np.float64))
    prior = np.diag([0.0, 0.0, (scatter / bend) ** 2])
    weight = np.ones(len(frame))
    for _ in range(_ROUNDS):
        normal = (powers * weight[:, None]).T @ powers + prior
        state = np.linalg.solve(normal, (powers * weight[:, None]).T @ centre)
        off = np.hypot(*(centre - powers @ state).T) / scatter
        weight = 1.0 / (1.0 + (off / _OFF) ** 2) ** 2
    spare = max(len(frame) - FEWEST_LOOKS, 1)
    worse = max(1.0, float((weight * off**2).sum()) / (2.0 * spare))
    covariance = np.asarray(worse * scatter**2 * np.linalg.inv(normal), dtype=np.float64)
    return _Law(moment, state.astype(np.float64), covariance, bend), float(np.mean(off < _OFF))


def _flies_on(before: _Law, after: _Law, radius: float, reach_px: float) -> float:
    """Log odds that two laws at one moment are one, against a later one of any state."""
    apart = after.state - before.state
    speed = max(float(np.hypot(*law.state[1])) for law in (before, after))
    bend = max(before.bend, after.bend)
    slack = np.diag([(_SLACK_RADII * radius + _SLACK_PX) ** 2, (_SLACK_SPEED * speed) ** 2, 0.0])
    one = before.covariance + after.covariance + slack
    # what is at rest is as likely as what goes as fast as anything
    any_speed = math.hypot(speed, radius * bend**0.5)
    any_state = one + np.diag([reach_px**2 / 12.0, any_speed**2, bend**2])
    return _log_normal(apart, one) - _log_normal(apart, any_state)


def _meets(before: _Law, after: _Law, moments: FloatArray, radius: float, reach_px: float) -> float:
    """Log odds that two laws are in one place at one of the moments, against anywhere."""
    (here, variance), (there, other) = before.at(moments), after.at(moments)
    square = ((there - here) ** 2).sum(axis=1)
    one = variance + other + (_SLACK_RADII * radius + _SLACK_PX) ** 2
    anywhere = one + reach_px**2 / 12.0
    odds = np.log(anywhere / one) - 0.5 * square * (1.0 / one - 1.0 / anywhere)
    return float(np.logaddexp.reduce(odds)) - math.log(len(moments))


def _log_normal(apart: FloatArray, covariance: FloatArray) -> float:
    """Log density of a difference (3, 2) of which both axes have one covariance, but for 2π."""
    _, size = np.linalg.slogdet(covariance)
    return float(-size - 0.5 * (apart * np.linalg.solve(covariance, apart)).sum())


def _odds(apart: float, one: float, other: float) -> float:
    """Log odds of a difference between two looks at one thing, and looks at two."""
    wide = math.hypot(one, other)
    return math.log(wide / one) - 0.5 * apart**2 * (1.0 / one**2 - 1.0 / wide**2)
