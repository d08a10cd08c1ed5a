"""Which of the round things that moved is the ball.

Ghosts: circles of edges that only the static scene has, where something was or will be.

A thing that lies still for most of a clip becomes part of the static scene; before it comes, or
after it has left, its outline shows all the same, but it is not in the picture. There the scene is
put right from the frames that show what is behind it, and the thing itself is seen again.

Who is who where paths end or meet: heads joined to tails by one global assignment.

A chain that is best by itself may change from one thing to another: from a puck to the one that it
strikes, say. So at every moment at which a path ends or two meet, all paths are cut, and heads and
tails are joined anew by the assignment that is best for all together (Kuhn 1955, `scipy.optimize.
linear_sum_assignment`): each tail begins near where its head would have gone. A thing that lies
still and is struck is still near its place in the next frame, the striker is not.

Circle candidates of many frames joined into paths: the best smooth chains there are.

Found by dynamic programming. The state is a pair of candidates, so that each has a velocity; a
change
of velocity costs, up to the price of a collision, and so does a change of radius. The best chain
is taken out, then the next.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from metrology.compiled import compiled
from vision.ball.circles import Circles
from vision.ball.courses import lawful_stretch
from vision.ball.joining import one_thing
from vision.scene import FilmedScene
from vision.tracks import MotionModel

__all__ = [
    "LEFT_AS_ONE",
    "SHADES",
    "BallPath",
    "Choice",
    "Way",
    "apart",
    "approach",
    "cast_by",
    "choose_ball",
    "described",
    "encloses",
    "lay_before",
    "link_circles",
    "path_score",
    "rivals",
    "uncovered",
    "untangled",
]

FloatImage = NDArray[np.float32]

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

_OTHER_LOOK, _OTHER_LOOK_PRICE = 60.0, 0.6

"""Gray levels, and nats at most, supposed: a ball's mean light changes less as it turns and is
smeared; what strikes it and goes on as fast as it came is told from it by its light alone."""

_SUDDEN_RADII, _SUDDEN_RATIO = 3.0, 5.0

"""Radii, and times the step before: one so long begins a flight as fast, or leaps elsewhere."""

_BENDING = 0.35

"""Of the step: what falls goes that much further in each look than before, soon after release."""

_STRAIGHT_LINK = 0.25

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
_FAINT_LINK = 5.0

# An outline of which the static scene has more than the picture is a ghost's: it counts from
# nothing at the first part of presence to in full at the second.
_GHOST, _PRESENT = 0.3, 0.5

_WHOLE, _USUAL_SCORE, _MOST_RAISED = 0.85, 1.0, 3.0

"""Of the outline, of one of usual size, and times: what is whole, clear, and raised at most."""

# Of two outlines one within the other the larger is another thing from this ratio on.
_ENCLOSING_LINK = 1.5

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
    coverage, sharpness, presence, level : (N,) arrays
        As in `Circles`.
    """

    frame: IntArray
    centre_px: FloatArray
    radius_px: FloatArray
    coverage: FloatArray
    sharpness: FloatArray
    presence: FloatArray
    level: FloatArray

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

    @cached_property
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
        columns = (table[:, :2], table[:, 2], table[:, 3], table[:, 4])
        paths.append(BallPath(nodes.frame[chain], *columns, nodes.presence[chain], table[:, 5]))
        alive &= ~_claimed(nodes, chain)
    return paths


def _nodes(frames: IntArray, circles: list[Circles]) -> _Nodes:
    step = np.concatenate(
        [np.full(len(found), index) for index, found in enumerate(circles)]
    ).astype(np.int64)
    tables = [
        np.column_stack(
            [found.centre_px, found.radius_px, found.coverage, found.sharpness, found.level]
        )
        for found in circles
    ]
    table = np.concatenate(tables) if tables else np.zeros((0, 6))
    steepness = np.log(np.maximum(table[:, 4], 1.0) / _FAINT_LINK) / np.log(60.0 / _FAINT_LINK)
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
            & (nodes.table[:, 2] < _ENCLOSING_LINK * radius)
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
        if turned_x * turned_x + turned_y * turned_y < _STRAIGHT_LINK * allowed * allowed:
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
    lighter = (table[end, 5] - table[start, 5]) / _OTHER_LOOK
    own -= _OTHER_LOOK_PRICE * min(lighter * lighter, 1.0)
    alone = own_score[start] + own - _FIRST_PRICE * distance / radius
    if best + own > alone:
        score[end, place], previous[end, place] = best + own, start * most + top
        far = distance > _SUDDEN_RADII * radius
        sudden[end, place] = far and speed > _SUDDEN_RATIO * top_speed
    else:
        score[end, place] = alone


# A thing that came less far than this (in radii) only wobbles: a swinging scale, a codec's blocks.
# Half of it is enough where a law explains the way.
_LEAST_TRAVEL, _LEAST_LAWFUL_TRAVEL = 2.0, 1.0

_ONE_SIZE = 0.06

"""Log radius: circles of one ball scatter by this from look to look, one standard deviation."""

_RADIUS_TOLERANCE = 0.3

"""Log radius: looks whose radius differs by more belong to another thing."""

# Steepness over noise at which an outline counts as nothing, and as clear.
_FAINT, _CLEAR = 5.0, 60.0

_FEWEST_STILL = 3

"""Frames: of three that agree one may still be chance, of two none can be outvoted."""

_STILL_RADII = 0.15

"""Radii: what stays within these lies still, as noise of an outline is a tenth of that."""

# Something that lay still and then flies was struck: that is what clips are made for.
_STRUCK_BONUS = 2.0

_FEWEST_LAWFUL, _SURELY_LAWFUL = 6, 5.0
"""Looks, twice a parabola's three unknowns; and nats of evidence for a law, odds of 150, of what is
taken for struck."""
_AS_CLEAR = 0.4
"""Share of the clearest thing's clarity that another thing has at least if it is as real."""

# A pendulum's way of two diameters of the ball bends by 7 to 9 %; what rolls or slides goes along
# a line.
_LEAST_APPROACH = 4.0

_TIED = 0.5
"""Share of the best score above which another thing may be the ball as well, supposed."""
_FEWEST_COMMON, _MOSTLY, _LAWFUL_PART = 4, 0.7, 0.4
"""Looks in common that tell whether two go together; share of them, and of a way, that is most."""
_COMMON_SHARE, _LARGER = 0.5, (0.9, 2.0)
"""Of the shorter way's looks, in which a thing and its shadow are seen together; how much larger
the shadow's way is than the thing's: 1 for the sun, 2 for a lamp as far before the thing as the
wall is behind it."""
SHADES, _EVENLY, _FAINT_SHADOW = (0.4, 0.95), 0.1, 20.0
"""Light left in a shadow, over the light without it; its scatter; steepness of its edge, in noise:
lamps are wide and several."""
_CAME, _TOUCHED = 1.25, 1.6

"""Distances of centres of two that touch: further off it came from elsewhere, nearer it met, as far
as circles of edges and looks some frames apart tell."""

_STRAIGHT = 0.04

"""Sagitta over length: a path bent less is a straight one as far as its looks tell."""

_FEWEST_CAME = 4

"""Looks: a line has two unknowns, and two more show whether it is one."""

_EARLY_SHARE = 0.25
"""Supposed: share of a flight's looks that may still be of rest: its first frames hardly move."""

# An outline so complete, this much larger, may enclose a glint.
_CREDIBLE = 0.62

_ONE_KIND = 0.3
"""Log radius by which two balls of one kind seem to differ at most: one that is smeared on its way
is outlined a fifth too large, supposed."""
_ENCLOSING = 1.4

"""Ratio of radii from which a circle encloses another, as far apart as two edges of one ball never
are."""


LEFT_AS_ONE = "It lay still and left, and all that it consists of left together."


@dataclass(frozen=True)
class Choice:
    """The ball's path, other candidates', and whether the choice was close.

    Attributes
    ----------
    ball : BallPath
        The one chosen.
    others : tuple of BallPath
        Other round things that travelled and are about as clear, best first.
    struck : bool
        Whether another of them met it while it lay still.
    doubt : BallPath or None
        What might be the ball as well: it speaks for itself nearly as clearly.
    dismissed : tuple of BallPath
        What travelled, too, and is no ball like it.
    reasons : tuple of str
        What speaks for the ball, in whole sentences.
    strikers : tuple of BallPath
        What moves and reached it while it lay still.
    """

    ball: BallPath
    others: tuple[BallPath, ...]
    struck: bool
    doubt: BallPath | None = None
    dismissed: tuple[BallPath, ...] = ()
    reasons: tuple[str, ...] = ()
    strikers: tuple[BallPath, ...] = ()

    @property
    def reached(self) -> bool:
        """Whether it lay still until something that moves reached it."""
        return bool(self.strikers)

    def instead(self, ball: BallPath) -> "Choice":
        """The choice of what casts a shadow, where the shadow was clearer."""
        others = tuple(path for path in self.others if path is not ball)
        rest = tuple(path for path in self.dismissed if path is not ball)
        said = "Something clearer goes as its shadow does and dims the wall more evenly."
        return Choice(ball, others, False, None, (self.ball, *rest), (said,))

    def of_whole(self, ball: BallPath) -> "Choice":
        """The choice of what left as one, where a part of it or something else was taken."""
        every = (self.ball, *self.others, *self.dismissed)
        rest = tuple(path for path in every if path is not ball)
        said = LEFT_AS_ONE if len(rest) == len(every) else "What was clearer lies within it."
        return Choice(ball, (), False, None, rest, (said,))

    @property
    def beside(self) -> tuple[BallPath, ...]:
        """Others in view with the ball; what was seen before or after may be the ball itself."""
        first, last = self.ball.frame[[0, -1]]
        return tuple(one for one in self.others if one.frame[-1] >= first and one.frame[0] <= last)


def trimmed(path: BallPath) -> BallPath:
    """Leave out candidates whose radius is not that of the clearest ones."""
    # A panel or a highlight inside the ball is round too: what counts is the length of edge seen.
    # Round ball and shadow as one a circle is larger, but ever of another size.
    weight = path.coverage**2 * np.log1p(path.sharpness) * path.radius_px**1.5
    size = np.log(path.radius_px)
    agree = np.exp(-0.5 * ((size[:, None] - size) / _ONE_SIZE) ** 2)
    typical = path.radius_px[int(np.argmax(agree @ weight))]
    keep = np.abs(np.log(path.radius_px / typical)) < _RADIUS_TOLERANCE
    keep &= path.sharpness > 0.3 * np.median(path.sharpness[keep])
    return path.where(keep)


@dataclass(frozen=True)
class Way:
    """Where a thing of a size was, frame by frame.

    Attributes
    ----------
    frame : (N,) int array
    centre_px : (N, 2) array
    radius : float
        px.
    """

    frame: IntArray
    centre_px: FloatArray
    radius: float


def choose_ball(
    paths: list[BallPath],
    at: tuple[float, float, int | None] | None,
    background: FloatImage | None = None,
    moved: Sequence[Way] = (),
) -> Choice | None:
    """Choose the ball: clear all around, far-travelled, long in view; or what the user points at.

    Of several alike, it is the one that lay still and was met by another.

    Parameters
    ----------
    paths : list of BallPath
        What was linked.
    at : tuple, optional
        x, y (px) and frame (or None) of a point on the ball.
    background : (H, W) float32 array, optional
        The static scene, gray levels: what only dims it may be another's shadow.
    moved : sequence of Way, optional
        What was seen, frame by frame, to move all along: it never lay still.

    Returns
    -------
    Choice or None
        None if nothing round moved.
    """
    clean = [trimmed(path) for path in paths]
    if at is not None:
        near = [path for path in clean if len(path.frame) >= 2 and _passes(path, at)]
        if not near:
            return None
        ball = min(near, key=lambda path: _gap(path, at))
        others = tuple(path for path in clean if path is not ball and _moves(path))
        return Choice(ball, others, False, reasons=("It was pointed at.",))
    moving = _outermost([path for path in clean if _moves(path)])
    if background is not None:
        moving = _lit(moving, background)
    if not moving:
        return None
    lay = [path for path in clean if not any(_goes_along(path, way) for way in moved)]
    struck, reachers = _struck(lay, moving, background)
    scores = {id(path): path_score(path) for path in (*moving, *struck)}
    # What reached it is the striker, however clearly that is seen.
    wanted = sorted(struck or moving, key=lambda path: scores[id(path)], reverse=True)
    known = {id(path) for path in wanted}
    left = [path for path in moving if id(path) not in known]
    ranked = wanted + sorted(left, key=lambda path: scores[id(path)], reverse=True)
    best = ranked[0]
    alike = [path for path in ranked if path is best or _alike(path, best)]
    told = {id(path) for path in alike}
    dismissed = tuple(path for path in clean if _moves(path) and id(path) not in told)
    for path in alike:
        came = [
            other
            for other in ranked
            if other is not path and _of_a_size(path, other) and _rolled_to(path, other)
        ]
        if came:
            known = {id(path), *(id(one) for one in came)}
            others = (*came, *(one for one in alike if id(one) not in known))
            dismissed = tuple(one for one in dismissed if id(one) not in known)
            reasons = _reasons(path, wanted, scores, True)
            return Choice(path, others, True, None, dismissed, reasons, others)
    strikers = tuple(reachers.get(id(best), ()))
    tied = [path for path in wanted[1:] if scores[id(path)] > _TIED * scores[id(best)]]
    reasons = _reasons(best, wanted, scores, bool(strikers))
    doubt = tied[0] if tied else None
    return Choice(best, tuple(alike[1:]), False, doubt, dismissed, reasons, strikers)


def _reasons(
    ball: BallPath, wanted: list[BallPath], scores: dict[int, float], struck: bool
) -> tuple[str, ...]:
    """What speaks for the ball, in whole sentences."""
    stretch = lawful_stretch(ball.frame, ball.centre_px, ball.radius)
    said = [
        f"{100 * float(np.median(ball.coverage)):.0f} % of its outline is seen, and one law of "
        f"motion explains {stretch.looks} of {len(ball.frame)} looks at it."
    ]
    if struck:
        said.insert(0, "It lay still until another thing that moves reached it, and then left.")
    others = [scores[id(path)] for path in wanted if path is not ball]
    if others and scores[id(ball)] > 0.0:
        share = 100 * max(others) / scores[id(ball)]
        said.append(f"The next likely one has {share:.0f} % of its score.")
    return tuple(said)


def described(
    path: BallPath, ball: BallPath, background: FloatImage
) -> tuple[MotionModel, tuple[str, ...]]:
    """Say what a thing that moves is instead of the ball, and why.

    Parameters
    ----------
    path : BallPath
        The thing.
    ball : BallPath
        What was chosen.
    background : (H, W) float32 array
        The static scene, gray levels.

    Returns
    -------
    label : MotionModel
    reasons : tuple of str
        In whole sentences.
    """
    presence = float(np.median(path.presence))
    if presence < _PRESENCE:
        seen = f"{100 * presence:.0f} %"
        return MotionModel.GHOST, (f"Only {seen} of its outline's edge is in the picture itself.",)
    _, own, theirs = np.intersect1d(path.frame, ball.frame, return_indices=True)
    gap = path.centre_px[own] - ball.centre_px[theirs]
    if len(own) >= _FEWEST_COMMON:
        inside = np.hypot(*gap.T) + path.radius_px[own] < 1.2 * ball.radius_px[theirs]
        if np.mean(inside) > _MOSTLY:
            return MotionModel.GLINT, ("It lies within the ball's outline and moves with it.",)
        # Where a shadow falls goes with the ball, by a rule that hardly bends.
        line = np.vander(np.linspace(-1.0, 1.0, len(own)), 2)
        rest = gap - line @ np.linalg.lstsq(line, gap, rcond=None)[0]
        follows = float(np.hypot(*rest.std(axis=0))) < _STILL_RADII * path.radius * path.travel
        if follows and _dims(path, background):
            return MotionModel.SHADOW, ("It goes with the ball and only dims what is behind it.",)
    if _dims(path, background) and float(np.median(path.sharpness)) < _FAINT_SHADOW:
        return MotionModel.SHADOW, ("It only dims what is behind it, with a soft edge.",)
    stretch = lawful_stretch(path.frame, path.centre_px, path.radius)
    part = stretch.looks / len(path.frame)
    if part < _LAWFUL_PART:
        return MotionModel.CARRIED, (
            f"No law of free motion explains more than {100 * part:.0f} % of its way: "
            "a hand, or what it carries.",
        )
    size = path.radius / ball.radius
    return MotionModel.UNKNOWN, (
        f"It is {size:.1f} times as large as the ball and less clear, or less lawful in its way.",
    )


def _dims(path: BallPath, background: FloatImage) -> bool:
    """Whether it is darker than what is behind it, evenly, but not dark itself."""
    column, row = np.rint(path.centre_px).astype(int).T
    row = np.clip(row, 0, background.shape[0] - 1)
    column = np.clip(column, 0, background.shape[1] - 1)
    ratio = path.level / np.maximum(background[row, column], 1.0)
    low, high = SHADES
    return bool(low < np.median(ratio) < high and np.std(ratio) < _EVENLY)


def _lit(paths: list[BallPath], background: FloatImage) -> list[BallPath]:
    """Without the shadows that others of them cast on the wall."""
    return [
        path
        for path in paths
        if not (
            _dims(path, background)
            and any(other is not path and _softer(path, other) for other in paths)
        )
    ]


def _softer(path: BallPath, other: BallPath) -> bool:
    """Whether a path may be that of the other's shadow: a lamp's size makes its edge softer."""
    softer = np.median(path.sharpness) <= np.median(other.sharpness)
    return bool(softer and cast_by(path, other))


def together(path: BallPath | Way, other: BallPath | Way) -> tuple[IntArray, FloatArray]:
    """Rows of a path while another is seen, too, and where that is then (n, 2), px.

    Of two things side by side each may be found in looks in which the other is not; where the other
    is lost for longer than it is usually from look to look, it may be anywhere.
    """
    inside = (path.frame >= other.frame[0]) & (path.frame <= other.frame[-1])
    rows = np.flatnonzero(inside)
    frame = path.frame[rows]
    after = np.searchsorted(other.frame, frame)
    gap = np.where(
        other.frame[after] == frame, 0, other.frame[after] - other.frame[np.maximum(after - 1, 0)]
    )
    usual = float(np.median(np.diff(other.frame))) if len(other.frame) > 1 else 1.0
    kept = gap <= (_REACH + 1) * usual
    there = [np.interp(frame[kept], other.frame, other.centre_px[:, axis]) for axis in (0, 1)]
    return rows[kept], np.column_stack(there)


def apart(path: BallPath | Way, other: BallPath | Way) -> FloatArray:
    """How far a path is from another while both are seen (n,), px."""
    rows, there = together(path, other)
    return np.asarray(np.hypot(*(path.centre_px[rows] - there).T))


def cast_by(path: BallPath | Way, other: BallPath | Way) -> bool:
    """Whether a path goes as the other's shadow does, on a wall along which it flies.

    A lamp throws the way on the wall as it is, only larger; two things of which each goes its own
    way bend or turn differently.
    """
    own, beside = together(path, other)
    if len(own) < max(_FEWEST_LAWFUL, _COMMON_SHARE * min(len(path.frame), len(other.frame))):
        return False
    way = beside - beside.mean(axis=0)
    cast = path.centre_px[own] - path.centre_px[own].mean(axis=0)
    size = float((way * way).sum())
    if np.sqrt(size / len(own)) < _STILL_RADII * other.radius:
        return False
    larger = float((way * cast).sum()) / size
    off = float(np.sqrt(((cast - larger * way) ** 2).sum() / len(own)))
    return _LARGER[0] < larger < _LARGER[1] and off < _STILL_RADII * path.radius


def rivals(paths: list[BallPath]) -> list[BallPath]:
    """The clearest path of something that moves, and those that might be taken for it."""
    moving = _outermost([path for path in (trimmed(path) for path in paths) if _moves(path)])
    if not moving:
        return []
    best = max(moving, key=path_score)
    return [path for path in moving if path is best or _alike(path, best)]


def _struck(
    paths: list[BallPath], moving: list[BallPath], background: FloatImage | None
) -> tuple[list[BallPath], dict[int, list[BallPath]]]:
    """What lay still until something that moves reached it, and then left: wanted before all else.

    It need not have gone far: a clip may end soon after the strike. With them, by identity, what
    reached each.
    """
    clearest = max(_clarity(path) for path in moving)
    sure = [
        path
        for path in paths
        if len(path.frame) >= _FEWEST_LAWFUL
        and _clarity(path) > _AS_CLEAR * clearest
        and lawful_stretch(path.frame, path.centre_px, path.radius).evidence > _SURELY_LAWFUL
    ]
    met, came = (
        {
            id(path): [o for o in moving if reached(path, o) and not _set_going_with(path, o)]
            for path in sure
        }
        for reached in (_met_at_rest, _appeared_at)
    )
    reachers = {place: [*others, *came[place]] for place, others in met.items()}
    reached = {place for place, others in reachers.items() if others}
    # Where a ball passes its own shadow each seems to reach the other: a striker nothing reached.
    first = {
        place for place in reached if any(id(other) not in reached for other in reachers[place])
    }
    wanted = first or reached
    came_up = [path for path in sure if id(path) in wanted]
    if not any(met[id(path)] and _sure_itself(path, background) for path in came_up):
        strikers = {id(other) for place in wanted for other in reachers[place]}
        wanted |= {
            id(path) for path in sure if id(path) not in strikers and _as_likely(path, came_up)
        }
    found = [path for path in paths if id(path) in wanted]
    lay = [path for path in found if _rested(path)]
    # What comes up as another one leaves, and goes as its shadow does, was not there before.
    kept = [path for path in found if _rested(path) or not any(cast_by(path, one) for one in lay)]
    return kept, reachers


def _goes_along(path: BallPath, way: Way) -> bool:
    """Whether a path is where a thing was that was followed frame by frame."""
    away = apart(path, way)
    return len(away) > _MOSTLY * len(path.frame) and float(np.median(away)) < 0.5 * path.radius


def _sure_itself(path: BallPath, background: FloatImage | None) -> bool:
    """Whether what was met was seen to lie still, or can't be a shadow of what did."""
    return _rested(path) or (background is not None and not _dims(path, background))


def _as_likely(path: BallPath, came_up: list[BallPath]) -> bool:
    """Whether what lay still is as likely the ball as what came up where something arrived.

    That those lay where they are first seen is supposed; what was seen to lie still and speaks for
    itself more, or far more than one that was seen to lie still as well, is as likely.
    """
    score = path_score(path)
    return (
        bool(came_up)
        and all(
            (_TIED if _rested(one) else 1.0) * score > path_score(one) and not _part_of(path, one)
            for one in came_up
        )
        and _rested(path)
    )


def _moves(path: BallPath) -> bool:
    if len(path.frame) < 4 or path.travel < _LEAST_LAWFUL_TRAVEL:
        return False
    if path.travel >= _LEAST_TRAVEL:
        return True
    law = lawful_stretch(path.frame, path.centre_px, path.radius)
    return len(path.frame) >= _FEWEST_LAWFUL and law.evidence > _SURELY_LAWFUL


def path_score(path: BallPath) -> float:
    """How much there is to a path: a clear outline, and a motion that a law explains.

    Parameters
    ----------
    path : BallPath
        The path.

    Returns
    -------
    float
        Nats of evidence for its motion, weighed by how clear and steady it is.
    """
    steady = 1.0 / (1.0 + 10.0 * float(np.std(np.log(path.radius_px))))
    return float(_clarity(path) * steady * _smoothness(path) * _evidence(path))


def _clarity(path: BallPath) -> float:
    """How complete and clear the outline is; the steepness of a glint adds no more."""
    steepness = np.log(max(float(np.median(path.sharpness)), 1.0) / _FAINT)
    steep = np.clip(steepness / np.log(_CLEAR / _FAINT), 0.02, 1.3)
    size = np.clip(path.radius / 10.0, 0.1, 4.0) ** 0.25
    return float(np.median(path.coverage) ** 2 * steep * size)


def _evidence(path: BallPath) -> float:
    """Evidence for a lawful motion, nats; more where it lay still until then."""
    stretch = lawful_stretch(path.frame, path.centre_px, path.radius)
    before = path.frame < stretch.first
    lay_still = False
    if np.count_nonzero(before) >= _FEWEST_STILL:
        place = path.centre_px[before]
        away = np.hypot(*(place - np.median(place, axis=0)).T)
        lay_still = bool(np.median(away) < _STILL_RADII * path.radius + 0.5)
    return float((1.0 + stretch.evidence) * (_STRUCK_BONUS if lay_still else 1.0))


def _outermost(paths: list[BallPath]) -> list[BallPath]:
    """Without what lies in another and moves with it: a glint, a panel, a hub."""
    return [path for path in paths if not any(_within(path, other) for other in paths)]


def encloses(path: BallPath, other: BallPath) -> bool:
    """Whether another, clearly smaller one lies within its outline wherever both are seen.

    Parameters
    ----------
    path, other : BallPath
        The paths.

    Returns
    -------
    bool
    """
    return path.radius > _ENCLOSING * other.radius and _part_of(other, path)


def _part_of(path: BallPath, other: BallPath) -> bool:
    """Whether it lies within another one's outline wherever both are seen."""
    _, own, theirs = np.intersect1d(path.frame, other.frame, return_indices=True)
    if len(own) < _FEWEST_COMMON:
        return False
    gap = np.hypot(*(path.centre_px[own] - other.centre_px[theirs]).T)
    inside = gap + path.radius_px[own] < 1.1 * other.radius_px[theirs]
    return bool(np.mean(inside) > _MOSTLY)


def _within(path: BallPath, other: BallPath) -> bool:
    """Whether a path is of something inside the outline of another credible one."""
    if path.radius > other.radius / _ENCLOSING or np.median(other.coverage) < _CREDIBLE:
        return False
    _, own, theirs = np.intersect1d(path.frame, other.frame, return_indices=True)
    if len(own) < max(4, 0.5 * len(path.frame)):
        return False
    gap = np.hypot(*(path.centre_px[own] - other.centre_px[theirs]).T)
    inside = gap + path.radius_px[own] < 1.1 * other.radius_px[theirs]
    return bool(np.mean(inside) > 0.7 and _evidence(other) > 0.4 * _evidence(path))


def _smoothness(path: BallPath) -> float:
    """1 for motion that runs on, 0 for a hand's or a blob's jitter."""
    if len(path.frame) < 5:
        return 0.7
    away = np.hypot(*(path.centre_px - path.centre_px[0]).T)
    left = int(np.argmax(away > _STILL_RADII * path.radius + 1.0)) if away.any() else 0
    # What lies still only jitters: how smoothly it goes is seen from where it leaves.
    left = max(0, min(left, len(path.frame) - 5))
    step = np.diff(path.centre_px[left:], axis=0) / np.diff(path.frame[left:])[:, None]
    speed = float(np.median(np.hypot(*step.T)))
    bend = float(np.median(np.hypot(*np.diff(step, axis=0).T)))
    return 1.0 / (1.0 + bend / (speed + 0.02 * path.radius))


def _of_a_size(path: BallPath, other: BallPath) -> bool:
    """Whether two may be balls of one kind, of which one is seen less clearly."""
    return abs(math.log(path.radius / other.radius)) < _ONE_KIND


def _alike(path: BallPath, best: BallPath) -> bool:
    same_size = abs(np.log(path.radius / best.radius)) < 0.2
    return bool(
        same_size
        and path.clarity > 0.4 * best.clarity
        and path_score(path) > 0.08 * path_score(best)
    )


def _left_rest(path: BallPath, departure: int) -> bool:
    """Whether rest explains the looks until a frame better than one motion from first to last.

    What is slow at first seems to lie still over a few looks.
    """
    before, after = path.where(path.frame <= departure), path.where(path.frame > departure)
    if len(before.frame) == 0 or len(after.frame) < _FEWEST_LAWFUL:
        return True
    time = (path.frame - departure) / float(np.ptp(path.frame))
    design = np.vander(time, 3)
    motion = design @ np.linalg.lstsq(design, path.centre_px, rcond=None)[0]
    moved = np.hypot(*(path.centre_px - motion).T)[: len(before.frame)]
    stirred = np.hypot(*(before.centre_px - np.median(before.centre_px, axis=0)).T)
    if np.median(moved) < np.median(stirred):
        return False
    law = lawful_stretch(path.frame, path.centre_px, path.radius)
    early = np.count_nonzero((path.frame >= law.first) & (path.frame < departure))
    if early <= max(3, _EARLY_SHARE * law.looks):
        return True
    # It may leap between things at rest; what was struck goes on by a law of its own.
    own = lawful_stretch(after.frame, after.centre_px, path.radius)
    return own.looks > _MOSTLY * len(after.frame) and own.evidence > _SURELY_LAWFUL


def _rested(path: BallPath) -> bool:
    """Whether it was seen to lie still, and left by a law of motion, whatever set it going."""
    start = np.median(path.centre_px[:_FEWEST_STILL], axis=0)
    away = np.hypot(*(path.centre_px - start).T)
    moved = np.flatnonzero(away > 0.7 * path.radius)
    if len(moved) == 0:
        return False
    still = np.flatnonzero(away[: moved[0]] < _STILL_RADII * path.radius)
    if len(still) < _FEWEST_LAWFUL or still[-1] + 1 - len(still) > len(still):
        return False
    after = path.where(path.frame > path.frame[still[-1]])
    if len(after.frame) < _FEWEST_LAWFUL or not _left_rest(path, int(path.frame[still[-1]])):
        return False
    law = lawful_stretch(after.frame, after.centre_px, path.radius)
    return law.looks > _MOSTLY * len(after.frame) and law.evidence > _SURELY_LAWFUL


def _set_going_with(path: BallPath, other: BallPath) -> bool:
    """Whether `other` lay still, too, and left with `path`: a ball sets off with its shadow."""
    if other is path:
        return True
    return _rested(other) and (cast_by(path, other) or _departure(other) >= _departure(path))


def _departure(path: BallPath) -> int:
    """The last frame in which it is seen where it is seen first."""
    start = np.median(path.centre_px[:_FEWEST_STILL], axis=0)
    away = np.hypot(*(path.centre_px - start).T)
    return int(path.frame[max(int(np.argmax(away > 0.7 * path.radius)) - 1, 0)])


def _met_at_rest(path: BallPath, other: BallPath) -> bool:
    """Whether `path` lay still until `other` touched it."""
    start = path.centre_px[: max(3, len(path.frame) // 10)].mean(axis=0)
    away = np.hypot(*(path.centre_px - start).T)
    moved = np.nonzero(away > 0.7 * path.radius)[0]
    if len(moved) == 0 or moved[0] < 2:
        return False
    still = np.flatnonzero(away[: moved[0]] < _STILL_RADII * path.radius + 1.0)
    departure = path.frame[still[-1]] if len(still) else path.frame[moved[0]]
    gap = np.hypot(*(other.centre_px - start).T)
    beside = np.abs(other.frame - departure) <= max(3, int(np.median(np.diff(path.frame))) * 3)
    own_start = other.centre_px[: max(3, len(other.frame) // 10)].mean(axis=0)
    touching = path.radius + other.radius
    came = np.hypot(*(own_start - start)) > _CAME * touching
    until = beside & (other.frame <= departure)
    if np.any(until) and gap[until].min() + path.radius < other.radius:
        # It passes before it: a solid thing is struck from outside.
        return False
    if not (np.any(beside) and gap[beside].min() < _TOUCHED * touching and came):
        return False
    return _left_rest(path, int(departure))


def _appeared_at(path: BallPath, other: BallPath) -> bool:
    """Whether `path` is first seen, in motion, where another thing arrives that was seen before.

    What lies still for most of a clip may pass for the static scene until it is struck.
    """
    touching = path.radius + other.radius
    before = other.frame < path.frame[0]
    if np.count_nonzero(before) < _FEWEST_CAME:
        return False
    arriving = other.where(before)
    start = path.centre_px[0]
    came = np.hypot(*(arriving.centre_px[0] - start)) > _CAME * touching
    # It may be lost as it touches; in between it goes no further than one of them is wide.
    recent = _last(arriving)
    course = np.polyfit(arriving.frame[recent] - path.frame[0], arriving.centre_px[recent], 1)
    unseen = float(path.frame[0] - arriving.frame[-1]) * float(np.hypot(*course[0]))
    apart = float(np.hypot(*(course[1] - start)))
    # What comes to light within the other's outline is a part of it, a glint say.
    beside = other.radius - path.radius < apart < _TOUCHED * touching
    return bool(came and beside and unseen < touching)


def _rolled_to(path: BallPath, other: BallPath) -> bool:
    """Whether the other met it at rest, and came along a line: what swings is a pendulum."""
    if not _met_at_rest(path, other):
        return False
    length, sagitta = approach(path, other)
    return length > _LEAST_APPROACH * path.radius and sagitta < _STRAIGHT * length


def approach(path: BallPath, other: BallPath) -> tuple[float, float]:
    """How far another came until a thing left its rest, and how far its way bowed from a line, px.

    Nothing where it was seen on its way too seldom.

    Parameters
    ----------
    path : BallPath
        What lay still.
    other : BallPath
        What came.
    """
    start = path.centre_px[: max(3, len(path.frame) // 10)].mean(axis=0)
    gone = np.hypot(*(path.centre_px - start).T) > 0.7 * path.radius
    came = other.centre_px[other.frame < path.frame[int(np.argmax(gone))]]
    came = came[np.hypot(*(came - came[:1]).T) > 0.0]
    if len(came) < _FEWEST_CAME:
        return 0.0, 0.0
    along, _, _ = np.linalg.svd((came - came.mean(axis=0)).T, full_matrices=False)
    way = (came - came.mean(axis=0)) @ along
    length = float(np.ptp(way[:, 0]))
    sagitta = abs(float(np.polyfit(way[:, 0], way[:, 1], 2)[0])) * (0.5 * length) ** 2
    return length, sagitta


def _passes(path: BallPath, at: tuple[float, float, int | None]) -> bool:
    return _gap(path, at) < 1.5 * path.radius


def _gap(path: BallPath, at: tuple[float, float, int | None]) -> float:
    distance = np.hypot(path.centre_px[:, 0] - at[0], path.centre_px[:, 1] - at[1])
    if at[2] is not None:
        nearest = int(np.argmin(np.abs(path.frame - at[2])))
        return float(distance[max(0, nearest - 1) : nearest + 2].min())
    return float(distance.min())


_PRESENCE = 0.35

"""Share of a circle's inside that differs from the background, supposed: less is a ring around
nothing."""

_COVERAGE = 0.65

"""Share of a circle's rim that has an edge: two thirds, since a third may be hidden."""

_SAME_RADII, _SAME_SIZE = 0.2, 0.2

"""Radii, and log radius: looks nearer and more alike than this are of one thing."""

_MOST_GHOSTS = 3

"""Places that are looked for where something lay in the background, supposed: a clip shows one ball
at rest or two."""

_FEWEST_LOOKS = 4

"""Looks that must agree on such a place: of noise none do."""

_MOST_FRAMES = 9

"""Frames whose median fills such a place: it leaves out what passes in fewer than half."""

_MARGIN_RADII, _MARGIN_PX = 1.1, 1.0

"""Radii, and px: around an outline, as far as its blur and its error reach."""

_FADE_PX = 2.0

# Other things hide the scene out to a little beyond their outline.
_BEYOND_PX = 2.0


@dataclass(frozen=True)
class _Ghost:
    """Where the static scene shows a round thing that is not there in these frames."""

    frame: IntArray
    centre: FloatArray
    radius: float


def uncovered(scene: FilmedScene, found: dict[int, Circles]) -> bool:
    """Take ghosts out of the static scene.

    Parameters
    ----------
    scene : FilmedScene
        Whose background is put right.
    found : dict of int to Circles
        All candidates by frame.

    Returns
    -------
    bool
        Whether there was a ghost, and the candidates should be looked for again.
    """
    ghosts = _ghosts(found)
    for ghost in ghosts:
        _uncover(scene, ghost, found)
    return bool(ghosts)


def _ghosts(found: dict[int, Circles]) -> list[_Ghost]:
    """Outlines without presence that stand in one place in several looks, most seen first."""
    rows = [
        (frame, *circles.centre_px[place], circles.radius_px[place])
        for frame, circles in sorted(found.items())
        for place in np.nonzero((circles.presence < _PRESENCE) & (circles.coverage > _COVERAGE))[0]
    ]
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    ghosts: list[_Ghost] = []
    while len(table) >= _FEWEST_LOOKS and len(ghosts) < _MOST_GHOSTS:
        gap = np.hypot(table[:, None, 1] - table[None, :, 1], table[:, None, 2] - table[None, :, 2])
        size = np.abs(np.log(table[:, None, 3] / table[None, :, 3]))
        like = (gap < _SAME_RADII * table[:, 3] + 1.0) & (size < _SAME_SIZE)
        best = int(np.argmax(like.sum(axis=1)))
        member = like[best]
        if member.sum() < _FEWEST_LOOKS:
            break
        middle = np.median(table[member, 1:], axis=0)
        frames = np.unique(table[member, 0]).astype(np.int64)
        ghosts.append(_Ghost(frames, middle[:2], float(middle[2])))
        table = table[~member]
    return ghosts


def _uncover(scene: FilmedScene, ghost: _Ghost, found: dict[int, Circles]) -> None:
    chosen = np.unique(np.linspace(0, len(ghost.frame) - 1, _MOST_FRAMES).astype(np.int64))
    frames = ghost.frame[chosen]
    centre, radius = ghost.centre, ghost.radius
    rows, columns = np.ogrid[: scene.shape[0], : scene.shape[1]]
    away = np.hypot(columns - centre[0], rows - centre[1])
    reach = _MARGIN_RADII * radius + _MARGIN_PX
    where = np.clip((reach + _FADE_PX - away) / _FADE_PX, 0.0, 1.0).astype(np.float32)
    hidden = []
    for frame in frames:
        others = found[int(frame)]
        mask = np.zeros(scene.shape, dtype=bool)
        for place in range(len(others)):
            there = others.presence[place] > _PRESENCE and others.coverage[place] > 0.7
            if there:
                x, y = others.centre_px[place]
                mask |= np.hypot(columns - x, rows - y) < others.radius_px[place] + _BEYOND_PX
        hidden.append(mask)
    scene.uncover(frames, hidden, where)


_SOONEST = 3
"""Looks at what a thing uncovers, the soonest, that must agree with the later ones: what strikes or
pushes it follows it into its place."""

_MOST_LEAVING = 60
"""Frames of its leaving that are looked at, supposed: a thing that leaves more slowly uncovers a
sixtieth of its width in each."""

_OFF_OUTLINE = 0.03
"""Radii by which a rough outline may be off."""

_STOOD_THERE = 0.2
"""Share of the disc that must have looked like the static scene before, and unlike it since: half
of what a ghost shows where a patchwork of thing and wall was taken for the scene, supposed."""

_UNLIKE, _LIKE = 6.0, 3.0
"""Standard deviations of noise, unlike and like: see `vision.scene`."""


def lay_before(scene: FilmedScene, frame: IntArray, centre: FloatArray, radius: float) -> bool:
    """Take what was followed out of the static scene where it lay at first.

    Where a thing fills much of the picture, it leaves its place so slowly that it, or a patchwork
    of it and the wall, passes for the static scene there. What is behind it is seen after it left;
    what is first seen in the middle of the picture has not come from nowhere and lay there, too.

    Parameters
    ----------
    scene : FilmedScene
        Whose background is put right.
    frame : (N,) int array
        Frames in which the thing was seen.
    centre : (N, 2) array
        Where, px.
    radius : float
        Its radius, px.

    Returns
    -------
    bool
        Whether it stood in the static scene, and should be followed again.
    """
    height, width = scene.shape
    rows, columns = np.ogrid[:height, :width]
    inside = np.hypot(columns - centre[0, 0], rows - centre[0, 1]) < radius
    known, before = scene.known, scene.background
    if not (0.0 < centre[0, 0] < width and 0.0 < centre[0, 1] < height):
        return False
    like = np.zeros(scene.shape, dtype=bool)
    for index, picture in scene.pictures(np.unique([0, int(frame[0]) // 2])):
        like |= np.abs(picture / scene.views[index].gain - before.image) < _LIKE * before.noise
    if np.mean(like[inside]) < _STOOD_THERE:
        return False
    _see_behind(scene, frame, centre, radius)
    changed = np.abs(scene.background.image - before.image) > _UNLIKE * before.noise
    if np.mean((changed & like)[inside]) > _STOOD_THERE:
        return True
    scene.restore(known)
    return False


def _see_behind(scene: FilmedScene, frame: IntArray, centre: FloatArray, radius: float) -> None:
    """Put into the static scene what is seen where a thing lay at first, once it has left."""
    leaving = _leaving(centre, radius)
    if len(leaving) < _FEWEST_LOOKS:
        return
    rows, columns = np.ogrid[: scene.shape[0], : scene.shape[1]]
    close = (1.0 + _OFF_OUTLINE) * radius + _BEYOND_PX
    hidden = [np.hypot(columns - x, rows - y) < close for x, y in centre[leaving]]
    away = np.hypot(columns - centre[0, 0], rows - centre[0, 1])
    where = np.clip((close + _FADE_PX - away) / _FADE_PX, 0.0, 1.0).astype(np.float32)
    scene.uncover(frame[leaving], hidden, where, _SOONEST, int(frame[leaving[0]]))


def _leaving(centre: FloatArray, radius: float) -> IntArray:
    """Rows in which a thing leaves its first place, until it shares nothing with it."""
    away = np.hypot(*(centre - centre[0]).T)
    moving = np.flatnonzero(away > _FADE_PX + _OFF_OUTLINE * radius)
    gone = np.flatnonzero(away > 2.0 * (_MARGIN_RADII * radius + _BEYOND_PX))
    first = int(moving[0]) if len(moving) else len(centre)
    last = min(int(gone[0]) + _SOONEST if len(gone) else len(centre), len(centre))
    return np.arange(first, last, max(1, (last - first) // _MOST_LEAVING))


# A step so long, in radii, and so much faster than those before and after it both, is a leap to
# something else: what is struck or let go is as fast afterwards, what is caught was before.
_LEAP_RADII, _LEAP_RATIO = 3.0, 5.0

_QUICKER, _FURTHER = 1.5, 0.75
"""Times the greatest speed nearby, and radii more, beyond which a step leads to another thing: what
bounces or is let go changes its speed by less, and circles of one thing lie nearer; supposed."""

_OTHER_LIGHT = 60.0

"""Gray levels, supposed: the mean light of one thing does not change by a quarter of the scale
between two looks and stay so."""

_FEWEST_STEADY, _STEADY = 4, 8

"""Looks on either side of such a change that agree, at least and at most."""

_MEETING_RADII = 3.0

"""Radii between centres: two balls touch at two, and a frame earlier they are a little apart."""

_LOOKS_BACK = 4

"""Looks from which a velocity is told: two give one, two more average it."""

# Off its prediction by this (radii, and px) costs one; more than the cap costs no more.
_OFF_RADII, _OFF_PX = 0.25, 1.0

_CAP = 12.0

"""Nats: beyond this two pieces are not of one thing, and how far beyond does not matter."""

_SWOLLEN = 0.15

"""Log radius per unit of cost: a circle's radius scatters by as much, supposed."""

# Joining otherwise than the chains did must be better by this.
_LIGHTER = 20.0

"""Gray levels per unit of cost: half of what two things that look alike differ by."""

_CLEARLY = 1.5

"""Nats by which joining otherwise than the chains did must be better: odds of four and a half."""

_FEWEST = 3

"""Looks: what is seen in fewer is no path."""

_MOST_MEETINGS = 12

"""Meetings that are looked at, the earliest: a strike is among the first."""


def untangled(paths: list[BallPath]) -> list[BallPath]:
    """Exchange tails where another assignment explains all paths better.

    Parameters
    ----------
    paths : list of BallPath
        What `link_circles` returned.

    Returns
    -------
    list of BallPath
        Of the same candidates; a head or tail that belongs to nothing else stands for itself.
    """
    paths = [piece for path in paths for piece in _unleapt(path)]
    for moment in _moments(paths):
        paths = _rejoined(paths, moment)
    return _bridged(paths)


def _bridged(paths: list[BallPath]) -> list[BallPath]:
    """Join pieces of one thing between which it was hidden, or not found, for a while."""
    if len(paths) < 2:
        return paths
    reach = float(np.ptp(np.concatenate([path.centre_px for path in paths]), axis=0).max())
    odds = np.array([[one_thing(head, tail, reach) for tail in paths] for head in paths])
    # of so many pieces any may be what a thing goes on as
    least, paths = math.log(len(paths)) + _CLEARLY, list(paths)
    while odds.max() > least:
        # The surest first: what it takes up is no longer there for others.
        head, tail = divmod(int(np.argmax(odds)), len(paths))
        paths[head] = paths[head].then(paths[tail])
        paths = paths[:tail] + paths[tail + 1 :]
        odds = np.delete(np.delete(odds, tail, axis=0), tail, axis=1)
        head -= head > tail
        odds[head] = [one_thing(paths[head], path, reach) for path in paths]
        odds[:, head] = [one_thing(path, paths[head], reach) for path in paths]
    return paths


def _last(path: BallPath) -> NDArray[np.bool_]:
    return np.arange(len(path.frame))[::-1] < _LOOKS_BACK


def _lighter(head: BallPath, tail: BallPath) -> float:
    """How much lighter or darker a tail is than its head, in tolerances."""
    change = tail.level[:_LOOKS_BACK].mean() - head.level[-_LOOKS_BACK:].mean()
    return abs(float(change)) / _LIGHTER


def _unleapt(path: BallPath) -> list[BallPath]:
    """A path cut where it leaps to another thing that is as slow, or to one of other light."""
    elapsed = np.diff(path.frame).astype(np.float64)
    step = np.hypot(*np.diff(path.centre_px, axis=0).T)
    speed = step / elapsed
    ends = [0]
    for place in np.flatnonzero(step > _LEAP_RADII * path.radius):
        sides = (speed[max(0, place - _LOOKS_BACK) : place], speed[place + 1 :][:_LOOKS_BACK])
        usual = max((float(np.median(side)) for side in sides if len(side)), default=np.inf)
        if speed[place] > _LEAP_RATIO * usual + 1e-9:
            ends.append(int(place) + 1)
    ends = sorted({*ends, *_too_far(path), *_other_light(path.level), len(path.frame)})
    if len(ends) == 2:
        return [path]
    rows = np.arange(len(path.frame))
    pieces = [path.where((rows >= first) & (rows < last)) for first, last in pairwise(ends)]
    return [piece for piece in pieces if len(piece.frame) >= _FEWEST]


def _too_far(path: BallPath) -> list[int]:
    """Rows to which it came further than its speed before or after explains: from another's place.

    A ball at rest may not be seen, and its shadow beside it is; when it flies, it is seen.
    """
    elapsed = np.diff(path.frame).astype(np.float64)
    step = np.hypot(*np.diff(path.centre_px, axis=0).T)
    speed = step / elapsed
    rows = []
    for place in range(_LOOKS_BACK, len(step) - _LOOKS_BACK + 1):
        before, after = speed[place - _LOOKS_BACK : place], speed[place + 1 :][:_LOOKS_BACK]
        usual = max(float(before.max()), float(after.max(initial=0.0)))
        if step[place] > _QUICKER * usual * elapsed[place] + _FURTHER * path.radius:
            rows.append(place + 1)
    return rows


def _other_light(level: FloatArray) -> list[int]:
    """Rows at which the light of what is followed changes for good."""
    rows = []
    own_step = np.abs(np.diff(level, prepend=level[:1]))
    for row in range(_FEWEST_STEADY, len(level) - _FEWEST_STEADY + 1):
        own = float(own_step[row])
        if own <= 0.5 * _OTHER_LIGHT:
            continue
        before, after = level[max(0, row - _STEADY) : row], level[row : row + _STEADY]
        step = abs(float(np.median(after) - np.median(before)))
        scatter = max(float(np.ptp(part)) for part in (before[-_LOOKS_BACK:], after[:_LOOKS_BACK]))
        if step > _OTHER_LIGHT and own > 0.5 * step and scatter < 0.5 * step:
            rows.append(row)
    return rows


def _moments(paths: list[BallPath]) -> list[int]:
    """Frames after which a path ends while another is near, in time order."""
    found: set[int] = set()
    for path in paths:
        last = int(path.frame[-1])
        for other in paths:
            if other is path or not int(other.frame[0]) < last < int(other.frame[-1]):
                continue
            after = int(np.searchsorted(other.frame, last, side="right"))
            gap = float(np.hypot(*(other.centre_px[after] - path.centre_px[-1])))
            if gap < _MEETING_RADII * max(path.radius, other.radius):
                found.add(last)
    return sorted(found)[:_MOST_MEETINGS]


def _rejoined(paths: list[BallPath], moment: int) -> list[BallPath]:
    """Cut all paths after a frame and join heads and tails anew."""
    live = [path for path in paths if path.frame[0] <= moment < path.frame[-1]]
    ended = [path for path in paths if path.frame[-1] == moment]
    rest = [path for path in paths if not any(path is one for one in live + ended)]
    heads = [path.where(path.frame <= moment) for path in live] + ended
    tails = [path.where(path.frame > moment) for path in live]
    if not tails:
        return paths
    cost = np.array([[_cost(head, tail) for tail in tails] for head in heads])
    before = float(sum(cost[place, place] for place in range(len(tails))))
    rows, columns = scipy.optimize.linear_sum_assignment(cost)
    if before - float(cost[rows, columns].sum()) < _CLEARLY:
        return paths
    joined = list(rest)
    for row, head in enumerate(heads):
        own = columns[rows == row]
        if len(own) and cost[row, own[0]] < _CAP:
            joined.append(head.then(tails[int(own[0])]))
        else:
            joined += [thing for thing in (head,) if len(thing.frame) >= _FEWEST]
            joined += [tails[int(at)] for at in own if len(tails[int(at)].frame) >= _FEWEST]
    return joined


def _cost(head: BallPath, tail: BallPath) -> float:
    """How far a tail begins from where its head would have gone, in tolerances."""
    frame = head.frame[-_LOOKS_BACK:].astype(np.float64)
    place = head.centre_px[-_LOOKS_BACK:]
    if len(frame) > 1:
        slope, start = np.polyfit(frame - frame[-1], place, 1)
    else:
        slope, start = np.zeros(2), place[-1]
    expected = start + slope * (float(tail.frame[0]) - frame[-1])
    radius = head.radius
    off = float(np.hypot(*(tail.centre_px[0] - expected))) / (_OFF_RADII * radius + _OFF_PX)
    swollen = abs(float(np.log(tail.radius / radius))) / _SWOLLEN
    return min(off + swollen + _lighter(head, tail), _CAP)
