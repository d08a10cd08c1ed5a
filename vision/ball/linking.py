"""Circle candidates of many frames joined into paths: the best smooth chains there are.

Found by dynamic programming. The state is a pair of candidates, so that each has a velocity; a
change
of velocity costs, up to the price of a collision, and so does a change of radius. The best chain
is taken out, then the next.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

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
    members = [np.nonzero(alive & (nodes.step == step))[0] for step in range(steps)]
    links = _Links(nodes, max(len(found) for found in members) * _REACH)
    for step in range(1, steps):
        targets = members[step]
        sources = np.concatenate(members[max(0, step - _REACH) : step])
        if len(sources) and len(targets):
            links.add(targets, sources)
    return links.best()


class _Links:
    """Links between candidates, each with the score of the best chain that ends in it.

    Of every node the links that arrive there are kept in rows of equal length.
    """

    def __init__(self, nodes: _Nodes, most: int) -> None:
        count = len(nodes.step)
        self._nodes, self._most = nodes, most
        self._source = np.full((count, most), -1, dtype=np.int64)
        self._velocity = np.zeros((count, most, 2))
        self._score = np.full((count, most), -np.inf)
        self._previous = np.full((count, most), -1, dtype=np.int64)
        self._continued = np.zeros((count, most), dtype=bool)
        self._sudden = np.zeros((count, most), dtype=bool)

    def best(self) -> IntArray:
        """Nodes of the best chain there is, in time order."""
        if self._score.size == 0 or not np.isfinite(self._score.max()):
            return np.zeros(0, dtype=np.int64)
        link = int(np.argmax(self._score))
        chain = []
        while link >= 0:
            node, place = divmod(link, self._most)
            chain.append(node)
            first = int(self._source[node, place])
            link = int(self._previous[node, place])
        chain.append(first)
        return np.array(chain[::-1], dtype=np.int64)

    def add(self, targets: IntArray, sources: IntArray) -> None:
        """Score the links from each source to each target, with the best that led to the source.

        Where something stands about where a link would go on to, a leap to something else is no
        motion but a mistake of identity, and not allowed.
        """
        nodes = self._nodes
        place, radius = nodes.table[targets, :2], nodes.table[targets, 2]
        elapsed = (nodes.frame[targets[0]] - nodes.frame[sources]).astype(np.float64)
        moved = place[:, None] - nodes.table[sources, :2][None]
        velocity = moved / elapsed[None, :, None]
        ratio = np.abs(np.log(radius[:, None] / nodes.table[sources, 2][None]))
        missed = nodes.step[targets[0]] - nodes.step[sources] - 1
        own = nodes.score[targets][:, None] - np.minimum((ratio / 0.2) ** 2, 9.0) * 0.3
        own = np.where(ratio > _MOST_SWELLING, -np.inf, own - _MISS_PRICE * missed)
        distance = np.hypot(moved[..., 0], moved[..., 1])
        total = self._continuing(sources, velocity, elapsed, ratio, distance, radius)
        top = np.argmax(total, axis=2)
        through = np.take_along_axis(total, top[..., None], axis=2)[..., 0] + own
        alone = nodes.score[sources][None] + own - 0.03 * distance / radius[:, None]
        better = through > alone
        count = len(sources)
        self._source[targets, :count] = sources
        self._velocity[targets, :count] = velocity
        self._score[targets, :count] = np.where(better, through, alone)
        self._previous[targets, :count] = np.where(better, sources * self._most + top, -1)
        came = self._velocity[np.broadcast_to(sources, top.shape), top]
        faster = distance / elapsed > _SUDDEN_RATIO * np.hypot(came[..., 0], came[..., 1])
        far = distance > _SUDDEN_RADII * radius[:, None]
        self._sudden[targets, :count] = better & faster & far

    def _continuing(
        self,
        sources: IntArray,
        velocity: FloatArray,
        elapsed: FloatArray,
        ratio: FloatArray,
        distance: FloatArray,
        radius: FloatArray,
    ) -> FloatArray:
        """Score of each link into a source (last axis) that goes on to a target (first axis)."""
        allowed = 1.0 * radius[:, None] + _BENDING * distance + 1.0
        arrived, reached = self._velocity[sources], self._score[sources]
        turned = (velocity[:, :, None] - arrived[None]) * elapsed[None, :, None, None]
        bend = (turned[..., 0] ** 2 + turned[..., 1] ** 2) / allowed[..., None] ** 2
        straight = (bend < 0.25) & (ratio < _MOST_SWELLING)[..., None]
        goes_on = np.any(straight, axis=0) | self._continued[sources]
        self._continued[sources] = goes_on
        cap = (
            _COLLISION_PRICE + _LEAP_PRICE * np.sqrt(bend) * (allowed / radius[:, None])[..., None]
        )
        stopped = _SUDDEN_RATIO * np.hypot(velocity[..., 0], velocity[..., 1])[
            ..., None
        ] < np.hypot(arrived[..., 0], arrived[..., 1])
        price = np.where((bend > 1.0) & goes_on[None], np.inf, np.minimum(0.3 * bend, cap))
        price = np.where(stopped & self._sudden[sources][None], np.inf, price)
        return np.asarray(reached[None] - price)
