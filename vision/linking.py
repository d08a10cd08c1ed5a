"""Circle candidates of many frames joined into paths: the best smooth chains there are.

Found by dynamic programming. The state is a pair of candidates, so that each has a velocity; a
change
of velocity costs, up to the price of a collision, and so does a change of radius. The best chain
is taken out, then the next.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.circles import Circles

__all__ = ["Path", "link_circles"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_REACH = 3
_COLLISION_PRICE = 1.2
_MISS_PRICE = 0.25
# Edges less steep than this (over noise) may be noise, and count next to nothing.
_FAINT = 5.0
# A ball's outline does not swell by more than this (natural logarithm) from one look to the next.
_MOST_SWELLING = 0.45


@dataclass(frozen=True)
class Path:
    """One round thing followed over the frames looked at.

    Attributes
    ----------
    frame : (N,) int array
        Frame indices, increasing.
    centre_px : (N, 2) array
        Centres, px.
    radius_px : (N,) array
        Radii, px.
    coverage, sharpness : (N,) arrays
        As in `Circles`.
    """

    frame: IntArray
    centre_px: FloatArray
    radius_px: FloatArray
    coverage: FloatArray
    sharpness: FloatArray

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
    def clarity(self) -> float:
        """How clear the outline is: covered part times steepness over noise, typical value."""
        return float(np.median(self.coverage) * np.median(self.sharpness))


# Where links to a candidate come from: sources, velocities, scores, identities.
_Incoming = tuple[IntArray, FloatArray, FloatArray, IntArray]


@dataclass(frozen=True)
class _Nodes:
    step: IntArray
    frame: IntArray
    table: FloatArray
    worth: FloatArray


def link_circles(frames: IntArray, circles: list[Circles], *, most: int = 6) -> list[Path]:
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
    list of Path
    """
    nodes = _nodes(frames, circles)
    alive = np.ones(len(nodes.step), dtype=bool)
    paths = []
    for _ in range(most):
        chain = _best_chain(nodes, alive, len(frames))
        if len(chain) < 3:
            break
        table = nodes.table[chain]
        paths.append(Path(nodes.frame[chain], table[:, :2], table[:, 2], table[:, 3], table[:, 4]))
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
    worth = table[:, 3] ** 2 * np.clip(steepness, 0.02, 1.3) * size
    return _Nodes(step, frames[step], table, worth)


def _claimed(nodes: _Nodes, chain: IntArray) -> NDArray[np.bool_]:
    """Nodes of the chain, and those that describe part of the same thing at the same moment."""
    claimed = np.zeros(len(nodes.step), dtype=bool)
    for member in chain:
        x, y, radius = nodes.table[member, :3]
        same = nodes.step == nodes.step[member]
        gap = np.hypot(nodes.table[:, 0] - x, nodes.table[:, 1] - y)
        claimed |= same & (gap < np.maximum(radius, 0.6 * (radius + nodes.table[:, 2])))
    claimed[chain] = True
    return claimed


def _best_chain(nodes: _Nodes, alive: NDArray[np.bool_], steps: int) -> IntArray:
    members = [np.nonzero(alive & (nodes.step == step))[0] for step in range(steps)]
    count = len(nodes.step)
    incoming: list[_Incoming] = [
        (np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64))
    ] * count
    links: list[tuple[int, int, int]] = []
    continued: dict[int, NDArray[np.bool_]] = {}
    best_link, best_score = -1, -np.inf
    for step in range(steps):
        before = [members[earlier] for earlier in range(max(0, step - _REACH), step)]
        sources = np.concatenate(before) if before else np.zeros(0, np.int64)
        if len(sources) == 0:
            continue
        targets = members[step]
        if len(targets) == 0:
            continue
        velocity, score, previous = _links(nodes, targets, sources, incoming, continued)
        identity = np.arange(score.size).reshape(score.shape) + len(links)
        links += list(
            zip(
                np.tile(sources, len(targets)).tolist(),
                np.repeat(targets, len(sources)).tolist(),
                previous.ravel().tolist(),
                strict=True,
            )
        )
        for place, node in enumerate(targets):
            incoming[node] = (sources, velocity[place], score[place], identity[place])
        top = int(np.argmax(score))
        if score.flat[top] > best_score:
            best_score, best_link = float(score.flat[top]), int(identity.flat[top])
    chain: list[int] = []
    link = best_link
    while link >= 0:
        first, second, previous_link = links[link]
        chain.append(second)
        if previous_link < 0:
            chain.append(first)
        link = previous_link
    return np.array(chain[::-1], dtype=np.int64)


def _links(
    nodes: _Nodes,
    targets: IntArray,
    sources: IntArray,
    incoming: list[_Incoming],
    continued: dict[int, NDArray[np.bool_]],
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Score the links from each source to each target, each with the best link that led to it.

    Where something stands about where a link would go on to, a leap to something else is no motion
    but a mistake of identity, and not allowed.
    """
    place, radius = nodes.table[targets, :2], nodes.table[targets, 2]
    elapsed = (nodes.frame[targets[0]] - nodes.frame[sources]).astype(np.float64)
    moved = place[:, None] - nodes.table[sources, :2][None]
    velocity = moved / elapsed[None, :, None]
    ratio = np.abs(np.log(radius[:, None] / nodes.table[sources, 2][None]))
    missed = nodes.step[targets[0]] - nodes.step[sources] - 1
    own = nodes.worth[targets][:, None] - np.minimum((ratio / 0.2) ** 2, 9.0) * 0.3
    own = np.where(ratio > _MOST_SWELLING, -np.inf, own - _MISS_PRICE * missed)
    distance = np.hypot(moved[..., 0], moved[..., 1])
    score = nodes.worth[sources][None] + own - 0.03 * distance / radius[:, None]
    previous = np.full(score.shape, -1, dtype=np.int64)
    allowed = 1.0 * radius[:, None] + 0.2 * distance + 1.0
    for index, source in enumerate(sources):
        _, arrived, reached, identity = incoming[source]
        if len(reached) == 0:
            continue
        turned = (velocity[:, index, None] - arrived[None]) * elapsed[index]
        bend = (turned[..., 0] ** 2 + turned[..., 1] ** 2) / allowed[:, index, None] ** 2
        alike = ratio[:, index] < 0.25
        goes_on = np.any(bend[alike] < 0.25, axis=0) | continued.get(int(source), False)
        continued[int(source)] = goes_on
        cap = _COLLISION_PRICE + 0.02 * distance[:, index, None] / radius[:, None]
        price = np.where((bend > 1.0) & goes_on[None], np.inf, np.minimum(0.3 * bend, cap))
        total = reached[None] - price
        top = np.argmax(total, axis=1)
        best = total[np.arange(len(targets)), top] + own[:, index]
        better = best > score[:, index]
        score[better, index] = best[better]
        previous[better, index] = identity[top[better]]
    return velocity, score, previous
