"""Circle candidates of many frames joined into paths: the best smooth chains there are.

Found by dynamic programming. The state is a pair of candidates, so that each has a velocity; a
change
of velocity costs, up to the price of a collision, and so does a change of radius. The best chain
is taken out, then the next.
"""

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled
from vision.ball.circles import Circles

__all__ = ["BallPath", "link_circles"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_REACH = 3
"""Looks that may lie between two of one path: a ball is hidden in one or two."""
_COLLISION_PRICE = 1.2
"""Nats at most for a change of velocity, supposed: a ball may be struck, but not often."""
_MISS_PRICE = 0.25
"""Nats for each look without the ball, supposed: three in four are found."""
_LEAP_PRICE = 0.25
"""Nats more for each radius a look by which a velocity changes, supposed: bounces are few radii."""
_SUDDEN_RADII, _SUDDEN_RATIO = 3.0, 5.0
"""Radii, and times the step before: one so long begins a flight as fast, or leaps elsewhere."""
_BENDING = 0.35
"""Of the step: what falls goes that much further in each look than before, soon after release."""
_STRAIGHT = 0.25
"""Square of a turn over what is allowed: half of that is straight, supposed."""
_BEND_PRICE = 0.3
"""Nats for a turn by all that is allowed, supposed."""
_SIZE_SCATTER, _SIZE_PRICE, _MOST_SIZES = 0.2, 0.3, 9.0
"""Log radius by which circles of one thing differ, nats for as much, and its square at most,
supposed."""
_FIRST_PRICE = 0.03
"""Nats for each radius of a first link, supposed: the nearer is the likelier."""
_TRIES = 3
"""Times the paths wanted: chains of two are none, but a few may be in the way of one."""
# Edges less steep than this (over noise) may be noise, and count next to nothing.
_FAINT = 5.0
# An outline of which the static scene has more than the picture is a ghost's: it counts from
# nothing at the first part of presence to in full at the second.
_GHOST, _PRESENT = 0.3, 0.5
_WHOLE, _USUAL_SCORE, _MOST_RAISED = 0.85, 1.0, 3.0
"""Of the outline, of one of usual size, and times: what is whole, clear, and raised at most."""
# Of two outlines one within the other the larger is another thing from this ratio on.
_ENCLOSING = 1.5
# A ball's outline does not swell by more than this (natural logarithm) from one look to the next.
_MOST_SWELLING = 0.45


@dataclass(frozen=True)
class BallPath:
    """One round thing followed over the frames looked at.

    Attributes
    ----------
    frame : (N,) int array
        Frame indices, increasing.
    centre_px : (N, 2) array
        Centres, px.
    radius_px : (N,) array
        Radii, px.
    coverage, sharpness, presence : (N,) arrays
        As in `Circles`.
    """

    frame: IntArray
    centre_px: FloatArray
    radius_px: FloatArray
    coverage: FloatArray
    sharpness: FloatArray
    presence: FloatArray

    def where(self, keep: NDArray[np.bool_]) -> "BallPath":
        """Some of the looks (N,)."""
        return BallPath(*(getattr(self, field.name)[keep] for field in fields(self)))

    def then(self, tail: "BallPath") -> "BallPath":
        """Join a later path to the end."""
        return BallPath(
            *(
                np.concatenate([getattr(self, field.name), getattr(tail, field.name)])
                for field in fields(self)
            )
        )

    @property
    def radius(self) -> float:
        """Typical radius, px."""
        return float(np.median(self.radius_px))

    @property
    def travel(self) -> float:
        """How far it came, in radii."""
        span = np.ptp(self.centre_px, axis=0)
        return float(np.hypot(span[0], span[1]) / self.radius)

    @property
    def step(self) -> float:
        """How far it goes from look to look while it moves, in radii: the quicker quarter."""
        moved = np.hypot(*np.diff(self.centre_px, axis=0).T)
        return float(np.quantile(moved, 0.75) / self.radius)

    @property
    def clarity(self) -> float:
        """How clear the outline is: covered part times steepness over noise, typical value."""
        return float(np.median(self.coverage) * np.median(self.sharpness))


@dataclass(frozen=True)
class _Nodes:
    step: IntArray
    frame: IntArray
    table: FloatArray
    score: FloatArray
    presence: FloatArray


def link_circles(frames: IntArray, circles: list[Circles], *, most: int = 8) -> list[BallPath]:
    """Join candidates into paths, best first.

    Parameters
    ----------
    frames : (K,) int array
        The frames looked at, increasing.
    circles : list of Circles
        Candidates of each.
    most : int
        How many paths to return at most.

    Returns
    -------
    list of BallPath
    """
    nodes = _nodes(frames, circles)
    alive = np.ones(len(nodes.step), dtype=bool)
    paths: list[BallPath] = []
    for _ in range(_TRIES * most):
        chain = _best_chain(nodes, alive, len(frames))
        if len(chain) < 2 or len(paths) == most:
            break
        if len(chain) < 3:
            # Two clear strangers: longer chains of fainter things may be left.
            alive[chain] = False
            continue
        table = nodes.table[chain]
        columns = (table[:, :2], table[:, 2], table[:, 3], table[:, 4], nodes.presence[chain])
        paths.append(BallPath(nodes.frame[chain], *columns))
        alive &= ~_claimed(nodes, chain)
    return paths


def _nodes(frames: IntArray, circles: list[Circles]) -> _Nodes:
    step = np.concatenate(
        [np.full(len(found), index) for index, found in enumerate(circles)]
    ).astype(np.int64)
    tables = [
        np.column_stack([found.centre_px, found.radius_px, found.coverage, found.sharpness])
        for found in circles
    ]
    table = np.concatenate(tables) if tables else np.zeros((0, 5))
    steepness = np.log(np.maximum(table[:, 4], 1.0) / _FAINT) / np.log(60.0 / _FAINT)
    # Of two round things that move as one, the larger is the ball and the smaller its panel.
    size = np.clip(table[:, 2] / 10.0, 0.1, 4.0) ** 0.2
    presence = np.concatenate([found.presence for found in circles] or [np.zeros(0)])
    there = np.clip((presence - _GHOST) / (_PRESENT - _GHOST), 0.02, 1.0)
    score = table[:, 3] ** 2 * np.clip(steepness, 0.02, 1.3) * size * there
    # Prices are those of clear things; where all there is is faint, it is what there is to link.
    whole = score[(table[:, 3] > _WHOLE) & (presence > _PRESENT)]
    if len(whole):
        score *= np.clip(_USUAL_SCORE / np.quantile(whole, 0.9), 1.0, _MOST_RAISED)
    return _Nodes(step, frames[step], table, score, presence)


def _claimed(nodes: _Nodes, chain: IntArray) -> NDArray[np.bool_]:
    """Nodes of the chain, and those that describe part of the same thing at the same moment."""
    claimed = np.zeros(len(nodes.step), dtype=bool)
    for member in chain:
        x, y, radius = nodes.table[member, :3]
        same = nodes.step == nodes.step[member]
        gap = np.hypot(nodes.table[:, 0] - x, nodes.table[:, 1] - y)
        claimed |= (
            same
            & (gap < np.maximum(radius, 0.6 * (radius + nodes.table[:, 2])))
            & (nodes.table[:, 2] < _ENCLOSING * radius)
        )
    claimed[chain] = True
    return claimed


def _best_chain(nodes: _Nodes, alive: NDArray[np.bool_], steps: int) -> IntArray:
    """Nodes of the best chain through what is alive, in time order.

    Of every node the links that arrive there are kept in rows of equal length, each with the score
    of the best chain that ends in it.
    """
    members = np.flatnonzero(alive)
    first = np.searchsorted(nodes.step[members], np.arange(steps + 1))
    count, most = len(nodes.step), int(np.diff(first).max(initial=0)) * _REACH
    source = np.full((count, most), -1, dtype=np.int64)
    score, previous = np.full((count, most), -np.inf), np.full((count, most), -1, dtype=np.int64)
    if score.size == 0:
        return np.zeros(0, dtype=np.int64)
    _score_links(
        nodes.table,
        nodes.score,
        nodes.frame,
        nodes.step,
        members,
        first,
        source,
        np.zeros((count, most, 2)),
        score,
        previous,
        np.zeros((count, most), dtype=np.bool_),
        np.zeros((count, most), dtype=np.bool_),
    )
    link = int(np.argmax(score))
    if not np.isfinite(score.flat[link]):
        return np.zeros(0, dtype=np.int64)
    chain = []
    while link >= 0:
        node, place = divmod(link, most)
        chain.append(node)
        link = int(previous[node, place])
    chain.append(int(source[node, place]))
    return np.array(chain[::-1], dtype=np.int64)


@compiled
def _score_links(
    table: FloatArray,
    own_score: FloatArray,
    frame: IntArray,
    step: IntArray,
    members: IntArray,
    first: IntArray,
    source: IntArray,
    velocity: FloatArray,
    score: FloatArray,
    previous: IntArray,
    continued: NDArray[np.bool_],
    sudden: NDArray[np.bool_],
) -> None:
    """Score the links from each candidate to each later one, with the best that led there.

    Parameters
    ----------
    table, own_score, frame, step : (n, …) arrays
        Of each candidate.
    members : (m,) int array
        Candidates that may be linked.
    first : (K + 1,) int array
        Where in `members` each look's begin.
    source, score, previous : (n, most) arrays
        Take where each link begins, the score of the best chain that ends in it, and the link
        before it (its place in all), −1 where it is the first.
    velocity, continued, sudden : (n, most, …) arrays
        Room to work in: velocity of a link, px per frame; whether something stands where it goes on
        to; whether it is much faster than what led there.
    """
    for look in range(1, len(first) - 1):
        low, high = first[max(0, look - _REACH)], first[look]
        for k in range(low, high):
            for t in range(high, first[look + 1]):
                _mark_continued(members[k], members[t], table, frame, velocity, score, continued)
        for t in range(high, first[look + 1]):
            for k in range(low, high):
                _score_link(
                    members[k],
                    members[t],
                    k - low,
                    table,
                    own_score,
                    frame,
                    step,
                    source,
                    velocity,
                    score,
                    previous,
                    continued,
                    sudden,
                )


@compiled
def _mark_continued(
    start: int,
    end: int,
    table: FloatArray,
    frame: IntArray,
    velocity: FloatArray,
    score: FloatArray,
    continued: NDArray[np.bool_],
) -> None:
    """Say of the links into a candidate which of them go straight on to another one."""
    if abs(math.log(table[end, 2] / table[start, 2])) >= _MOST_SWELLING:
        return
    dx, dy = table[end, 0] - table[start, 0], table[end, 1] - table[start, 1]
    elapsed = float(frame[end] - frame[start])
    allowed = table[end, 2] + _BENDING * math.hypot(dx, dy) + 1.0
    for m in range(score.shape[1]):
        turned_x, turned_y = (
            dx - velocity[start, m, 0] * elapsed,
            dy - velocity[start, m, 1] * elapsed,
        )
        if turned_x * turned_x + turned_y * turned_y < _STRAIGHT * allowed * allowed:
            continued[start, m] = True


@compiled
def _score_link(
    start: int,
    end: int,
    place: int,
    table: FloatArray,
    own_score: FloatArray,
    frame: IntArray,
    step: IntArray,
    source: IntArray,
    velocity: FloatArray,
    score: FloatArray,
    previous: IntArray,
    continued: NDArray[np.bool_],
    sudden: NDArray[np.bool_],
) -> None:
    """Score one link.

    Where something stands about where a link would go on to, a leap to something else is no motion
    but a mistake of identity, and not allowed.
    """
    most, radius = score.shape[1], table[end, 2]
    dx, dy = table[end, 0] - table[start, 0], table[end, 1] - table[start, 1]
    elapsed, distance = float(frame[end] - frame[start]), math.hypot(dx, dy)
    source[end, place] = start
    velocity[end, place, 0], velocity[end, place, 1] = dx / elapsed, dy / elapsed
    ratio = abs(math.log(radius / table[start, 2]))
    if ratio > _MOST_SWELLING:
        return
    allowed, speed = radius + _BENDING * distance + 1.0, distance / elapsed
    best, top, top_speed = -np.inf, -1, 0.0
    for m in range(most):
        if not score[start, m] > best:
            # a price is never below nought
            continue
        came_x, came_y = velocity[start, m, 0], velocity[start, m, 1]
        came = math.hypot(came_x, came_y)
        turned_x, turned_y = dx - came_x * elapsed, dy - came_y * elapsed
        bend = (turned_x * turned_x + turned_y * turned_y) / (allowed * allowed)
        if bend > 1.0 and continued[start, m]:
            continue
        if sudden[start, m] and _SUDDEN_RATIO * speed < came:
            continue
        cap = _COLLISION_PRICE + _LEAP_PRICE * math.sqrt(bend) * allowed / radius
        total = score[start, m] - min(_BEND_PRICE * bend, cap)
        if total > best:
            best, top, top_speed = total, m, came
    missed = step[end] - step[start] - 1
    own = own_score[end] - _MISS_PRICE * missed
    own -= _SIZE_PRICE * min((ratio / _SIZE_SCATTER) ** 2, _MOST_SIZES)
    alone = own_score[start] + own - _FIRST_PRICE * distance / radius
    if best + own > alone:
        score[end, place], previous[end, place] = best + own, start * most + top
        far = distance > _SUDDEN_RADII * radius
        sudden[end, place] = far and speed > _SUDDEN_RATIO * top_speed
    else:
        score[end, place] = alone
