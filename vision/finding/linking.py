"""Link detections to tracklets by one log odds: object or false detections.

A chain of detections is worth what its places and looks are more probable under one object than
under false detections spread evenly over the picture. An object goes on at its velocity
up to a Student-t distributed change (gravity, contacts and bounces are its tail), keeps its radius
and colour up to theirs, and is missed in some frames. The best chains are found by dynamic
programming over pairs of detections, so that each state has a velocity, and then exchange tails as
long as all of them together become more probable. `training/fit_finding.py`
estimates the parameters by maximum likelihood from recordings with truth. parameters.json holds
these estimates with 95 % intervals next to the values in use, whose tracklets cover more of the
objects: errors of neighbouring frames are alike, which the likelihood leaves out.
"""

import json
import math
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import resources
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled
from vision.finding.detection import Detections

__all__ = ["MIN_FOUND_ROWS", "LinkParameters", "Tracklet", "link", "link_parameters"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_MAX_GAP = 3
"""Steps between two detections of a chain at most. Derived: a parabola over more is no better than
the free fit that fills gaps."""

_MAX_TRACKLETS = 20
"""Tracklets at most. Measured: the true object was among the best eleven in every clip."""

_ROUNDS, _PER_ROUND = 16, 2
"""Times that the best chains are looked for, those found taken out, and chains of each. Given by
the budget: chains that share detections with better ones are found in later rounds."""


MIN_FOUND_ROWS = 3
"""Frames in which an object is found at least. Derived: fewer determine no motion."""


class LinkParameters(NamedTuple):
    """Parameters of the likelihood.

    Attributes
    ----------
    place_px, place_radii : float
        Standard deviation of a detection's centre: a constant, and a share of its radius.
    change_radii : float
        Scale of a change of velocity, radii per frame².
    change_freedom : float
        Degrees of freedom of its distribution: fewer allow for more contacts and bounces.
    speed_radii : float
        Scale of the first velocity, radii per frame.
    log_radius : float
        Standard deviation of the logarithm of a radius between detections.
    colour : float
        Scale of a change of mean colour, gray levels.
    missed, stays_missed : float
        Probability that an object is missed in a frame, and that one missed is so in the next.
    begins : float
        Probability that a detection begins a chain, and that one ends it.
    looks : tuple of float
        Weights of coverage, for the logarithm of sharpness, and in all.
    """

    place_px: float
    place_radii: float
    change_radii: float
    change_freedom: float
    speed_radii: float
    log_radius: float
    colour: float
    missed: float
    stays_missed: float
    begins: float
    looks: tuple[float, float, float]


@cache
def link_parameters() -> LinkParameters:
    """The parameters in use."""
    text = resources.files("vision.finding").joinpath("parameters.json").read_text("utf-8")
    values = json.loads(text)["linking"]
    coverage, sharpness, constant = map(float, values.pop("looks")["value"])
    single = {name: float(each["value"]) for name, each in values.items()}
    return LinkParameters(**single, looks=(coverage, sharpness, constant))


@dataclass(frozen=True)
class Tracklet:
    """Detections of one object, in time order.

    Attributes
    ----------
    seen : Detections
        Its rows.
    log_odds : float
        Log odds by which it is more probable as one object than as false detections.
    corner_std_px : float or None
        Of its places, where these are of corners that move together and no outline is sought.
    """

    seen: Detections
    log_odds: float
    corner_std_px: float | None = None

    @property
    def frame(self) -> IntArray:
        """Frames (N,)."""
        return self.seen.frame

    @property
    def centre_px(self) -> FloatArray:
        """Centres (N, 2), px."""
        return self.seen.centre_px

    @cached_property
    def radius(self) -> float:
        """Typical radius, px."""
        return float(np.median(self.seen.radius_px))

    def __len__(self) -> int:
        return len(self.seen)

    def where(self, keep: NDArray[np.bool_] | IntArray) -> "Tracklet":
        """Some of the rows, with their share of the log odds."""
        seen = self.seen.at(keep)
        odds = self.log_odds * len(seen) / max(len(self.seen), 1)
        return Tracklet(seen, odds, self.corner_std_px)

    def then(self, tail: "Tracklet") -> "Tracklet":
        """These rows and those of later frames."""
        return Tracklet(self.seen.then(tail.seen), self.log_odds + tail.log_odds)


def node_worth(seen: Detections, parameters: LinkParameters) -> FloatArray:
    """Log odds by which each detection looks like an object (N,)."""
    coverage, sharpness, constant = parameters.looks
    return np.asarray(
        coverage * seen.coverage + sharpness * np.log(np.maximum(seen.sharpness, 1.0)) + constant
    )


def link(
    seen: Detections,
    frames: IntArray,
    shape: tuple[int, int],
    parameters: LinkParameters | None = None,
) -> list[Tracklet]:
    """Link detections to tracklets, those of most log odds first.

    Parameters
    ----------
    seen : Detections
        Detections of all frames searched.
    frames : (K,) int array
        Frames searched, increasing.
    shape : (2,) tuple of int
        Height and width of the picture, px.
    parameters : LinkParameters, optional
        Of the likelihood; those in use without.

    Returns
    -------
    list of Tracklet
    """
    if len(seen) == 0:
        return []
    known = parameters or link_parameters()
    marks = _LinkMarks.of(seen, frames, shape, known)
    pairs = _pairs(marks)
    alive = np.ones(len(seen), dtype=bool)
    chains: list[IntArray] = []
    for _ in range(_ROUNDS):
        best = _chains(seen, marks, pairs, alive)
        for rows in best:
            alive &= ~_explained(seen, rows)
        chains += best
        if not best:
            break
    cut = [part for rows in _exchanged(chains, marks) for part in _parts(rows, marks)]
    found = [Tracklet(seen.at(rows), _whole_odds(rows, marks)) for rows in _joined(cut, marks)]
    return sorted(found, key=lambda one: -one.log_odds)[:_MAX_TRACKLETS]


class _LinkMarks(NamedTuple):
    """What compiled loops read: all detections, false ones for each px², the parameters."""

    frame: FloatArray
    step: IntArray
    centre: FloatArray
    radius: FloatArray
    log_radius: FloatArray
    colour: FloatArray
    worth: FloatArray
    turns: FloatArray
    """Log odds at most of the changes of velocity before and at each row."""
    density: float
    log_missed: float
    weights: LinkParameters

    @classmethod
    def of(
        cls, seen: Detections, frames: IntArray, shape: tuple[int, int], known: LinkParameters
    ) -> "_LinkMarks":
        # false detections for each px²: what is found, spread over the picture
        density = len(seen) / (len(frames) * float(shape[0] * shape[1]))
        return cls(
            *(seen.frame.astype(np.float64), np.searchsorted(frames, seen.frame)),
            *(seen.centre_px, seen.radius_px, np.log(seen.radius_px), seen.colour),
            *(node_worth(seen, known), _most_turns(seen.radius_px, density, known)),
            density=density,
            log_missed=math.log(known.missed),
            weights=known,
        )


def _most_turns(radius: FloatArray, density: float, known: LinkParameters) -> FloatArray:
    """Log odds of two steps without any change, next to the smallest neighbour there could be."""
    noise = known.place_px**2 + (0.5 * known.place_radii * radius) ** 2
    return np.asarray(np.maximum(-2.0 * np.log(4.0 * np.pi * noise * density), 0.0))


@dataclass(frozen=True)
class _LinkedRows:
    """Rows of a chain; at each, log odds of going on there as it does, and of beginning there."""

    rows: IntArray
    held: FloatArray
    anew: FloatArray
    odds: float

    @classmethod
    def of(cls, rows: IntArray, marks: _LinkMarks) -> "_LinkedRows":
        held, anew = np.zeros(len(rows) + 1), np.zeros(len(rows) + 1)
        _own_odds(rows, marks, held, anew)
        return cls(rows, held, anew, _whole_odds(rows, marks))


def _exchanged(chains: list[IntArray], marks: _LinkMarks) -> list[IntArray]:
    """Exchange tails between chains as long as what results is more probable.

    Each chain is the best by itself, so that it runs on through what belongs to another. An
    exchange with nothing cuts a chain, or joins two.
    """
    if not chains:
        return []
    nothing = _LinkedRows.of(np.zeros(0, dtype=np.int64), marks)
    found = [*(_LinkedRows.of(rows, marks) for rows in chains), nothing]
    gains, cuts = np.zeros((0, 0)), np.zeros((0, 0, 2), dtype=np.int64)
    changed = np.ones(len(found), dtype=bool)
    while True:
        more = len(found) - len(gains)
        gains = np.pad(gains, [(0, more), (0, more)])
        cuts = np.pad(cuts, [(0, more), (0, more), (0, 0)])
        starts = np.cumsum([0, *(len(chain.rows) for chain in found)])
        rows, held, anew = (
            np.concatenate([getattr(chain, name) for chain in found])
            for name in ("rows", "held", "anew")
        )
        _weigh_exchanges(changed, starts, rows, held, anew, marks, gains, cuts)
        one, other = divmod(int(gains.argmax()), len(gains))
        if gains[one, other] <= _MIN_GAIN:
            return [chain.rows for chain in found if len(chain.rows) >= MIN_FOUND_ROWS]
        old = found[one], found[other]
        new = _swapped(*old, int(cuts[one, other, 0]), int(cuts[one, other, 1]), marks)
        changed[:] = False
        if sum(each.odds for each in new) <= sum(each.odds for each in old) + _MIN_GAIN:
            # speeds over several rows promised more than the chains themselves hold
            gains[one, other] = 0.0
            continue
        found[one], found[other] = new
        changed[[one, other]] = True
        if all(len(chain.rows) for chain in found):
            changed = np.append(changed, True)
            found.append(nothing)


def _swapped(
    one: _LinkedRows, other: _LinkedRows, i: int, j: int, marks: _LinkMarks
) -> tuple[_LinkedRows, _LinkedRows]:
    return (
        _LinkedRows.of(np.concatenate([one.rows[:i], other.rows[j:]]), marks),
        _LinkedRows.of(np.concatenate([other.rows[:j], one.rows[i:]]), marks),
    )


_MIN_GAIN = 1e-6
"""Log odds that an exchange gains at least. Derived: rounding."""

_SPEED_ROWS = 4
"""Rows over which a speed is taken. Derived: centres found by votes then add a percent of a radius
a frame."""


@compiled
def _whole_odds(rows: IntArray, marks: _LinkMarks) -> float:
    """Log odds of a chain as one object; one too short is none."""
    if len(rows) < MIN_FOUND_ROWS:
        return 0.0
    odds = _begun(rows[0], rows[1], marks) + marks.worth[rows[0]]
    for i in range(1, len(rows)):
        odds += marks.worth[rows[i]] + _alike(rows[i - 1], rows[i], marks)
        missed = marks.step[rows[i]] - marks.step[rows[i - 1]] - 1
        odds += missed * marks.log_missed
        if i > 1:
            odds += _turn(rows[i - 2], rows[i - 1], rows[i], marks)
    return float(odds)


@compiled
def _own_odds(rows: IntArray, marks: _LinkMarks, held: FloatArray, anew: FloatArray) -> None:
    """Write the log odds of going on and of beginning at each row of a chain."""
    count = len(rows)
    for i in range(count):
        last = rows[min(i + _SPEED_ROWS, count - 1)]
        anew[i] = _begun(rows[i], last, marks) if last != rows[i] else _NEVER
        held[i] = anew[i]
        if i > 0:
            held[i] = max(anew[i], _going_on(rows, i, rows, i, marks))


_NEVER = -1e3
"""Log odds of what is excluded, such as an object of one row."""


@compiled
def _going_on(head: IntArray, stop: int, tail: IntArray, start: int, marks: _LinkMarks) -> float:
    """Log odds that a tail goes on from a head."""
    b, c = head[stop - 1], tail[start]
    a = head[max(stop - 1 - _SPEED_ROWS, 0)]
    d = tail[min(start + _SPEED_ROWS, len(tail) - 1)]
    steps = marks.step[c] - marks.step[b] - 1
    if steps >= _MAX_GAP or not _near(b, c, marks):
        return _NEVER
    odds = _alike(b, c, marks) + steps * marks.log_missed
    if a != b:
        odds += _turn(a, b, c, marks)
    if c != d:
        odds += _turn(b, c, d, marks)
    return float(odds)


@compiled
def _weigh_exchanges(
    changed: NDArray[np.bool_],
    starts: IntArray,
    rows: IntArray,
    held: FloatArray,
    anew: FloatArray,
    marks: _LinkMarks,
    gains: FloatArray,
    cuts: IntArray,
) -> None:
    """Write the best exchange of each chain with each other, where one of them has changed."""
    for one in range(len(changed)):
        for other in range(len(changed)):
            if one != other and (changed[one] or changed[other]):
                a, b, c, d = starts[one], starts[one + 1], starts[other], starts[other + 1]
                # one more is held, and begun, than there are rows
                first = slice(a + one, b + one + 1)
                second = slice(c + other, d + other + 1)
                gains[one, other], cuts[one, other, 0], cuts[one, other, 1] = _best_exchange(
                    *(rows[a:b], held[first], anew[first]),
                    *(rows[c:d], held[second], anew[second]),
                    marks,
                )


@compiled
def _best_exchange(
    one: IntArray,
    one_held: FloatArray,
    one_anew: FloatArray,
    other: IntArray,
    other_held: FloatArray,
    other_anew: FloatArray,
    marks: _LinkMarks,
) -> tuple[float, int, int]:
    """Most log odds gained by an exchange of tails, and the rows before it in each chain."""
    best, most_i, most_j = 0.0, 0, 0
    frame, step, j = marks.frame, marks.step, 0
    for i in range(len(one) + 1):
        while j < len(other) and i > 0 and frame[other[j]] <= frame[one[i - 1]]:
            j += 1
        k = j
        while True:
            if (i > 0 or k > 0) and (i < len(one) or k < len(other)):
                first = other_anew[k] if k < len(other) else 0.0
                second = one_anew[i] if i < len(one) else 0.0
                held = one_held[i] + other_held[k]
                # calls take most of the time: only where a tail may go on
                if i > 0 and k < len(other) and step[other[k]] - step[one[i - 1]] <= _MAX_GAP:
                    first = max(first, _promised(one[i - 1], other[k], marks))
                if k > 0 and i < len(one) and step[one[i]] - step[other[k - 1]] <= _MAX_GAP:
                    second = max(second, _promised(other[k - 1], one[i], marks))
                if first + second - held > best:
                    gain = _best_start(one, i, other, k, other_anew, marks) - held
                    gain += _best_start(other, k, one, i, one_anew, marks)
                    if gain > best:
                        gain -= _dropped(one, one_held, i, other, other_held, k, marks)
                        gain -= _dropped(other, other_held, k, one, one_held, i, marks)
                    if gain > best:
                        best, most_i, most_j = gain, i, k
            if k == len(other) or (i < len(one) and frame[other[k]] >= frame[one[i]]):
                break
            k += 1
    return best, most_i, most_j


@compiled
def _best_start(
    head: IntArray, stop: int, tail: IntArray, start: int, anew: FloatArray, marks: _LinkMarks
) -> float:
    """Log odds of a tail: as going on from a head, or as an object that begins."""
    if start == len(tail):
        return 0.0
    if stop == 0:
        return float(anew[start])
    return float(max(anew[start], _going_on(head, stop, tail, start, marks)))


@compiled
def _promised(head: int, tail: int, marks: _LinkMarks) -> float:
    """Log odds of going on from a row to another at most, without the change of velocity."""
    if not _near(head, tail, marks):
        return _NEVER
    return float(_alike(head, tail, marks) + marks.turns[tail])


@compiled
def _dropped(
    head: IntArray,
    head_held: FloatArray,
    stop: int,
    tail: IntArray,
    tail_held: FloatArray,
    start: int,
    marks: _LinkMarks,
) -> float:
    """Log odds of a chain that is too short to be kept, but for where it is joined."""
    if stop + len(tail) - start >= MIN_FOUND_ROWS:
        return 0.0
    lost = 0.0
    for i in range(stop):
        lost += marks.worth[head[i]] + head_held[i]
    for j in range(start, len(tail)):
        lost += marks.worth[tail[j]] + (tail_held[j] if j > start else 0.0)
    return lost


@compiled
def _begun(one: int, other: int, marks: _LinkMarks) -> float:
    """Log odds that an object begins with a step, and another has ended."""
    known = marks.weights
    across = marks.centre[other, 0] - marks.centre[one, 0]
    down = marks.centre[other, 1] - marks.centre[one, 1]
    size = 0.5 * (marks.radius[one] + marks.radius[other])
    share = known.place_radii * size
    reach = known.speed_radii * size * (marks.frame[other] - marks.frame[one])
    scale = 2.0 * (known.place_px * known.place_px + share * share) + reach * reach
    anew = -1.5 * math.log(1.0 + (across * across + down * down) / scale)
    anew += 2.0 * math.log(known.begins)
    return float(anew - math.log(6.2832 * scale * marks.density))


@compiled
def _turn(one: int, middle: int, other: int, marks: _LinkMarks) -> float:
    """Log odds of the change of velocity at a row."""
    known = marks.weights
    earlier = marks.frame[middle] - marks.frame[one]
    elapsed = marks.frame[other] - marks.frame[middle]
    size = 0.5 * (marks.radius[middle] + marks.radius[other])
    ratio = elapsed / earlier
    across = marks.centre[other, 0] - marks.centre[middle, 0]
    down = marks.centre[other, 1] - marks.centre[middle, 1]
    across -= ratio * (marks.centre[middle, 0] - marks.centre[one, 0])
    down -= ratio * (marks.centre[middle, 1] - marks.centre[one, 1])
    share = known.place_radii * size
    pull = known.change_radii * size * 0.5 * elapsed * (elapsed + earlier)
    wide = known.place_px * known.place_px + share * share
    wide = wide * (2.0 + 2.0 * ratio + 2.0 * ratio * ratio) + pull * pull
    freedom = known.change_freedom
    odds = math.log(1.0 + (across * across + down * down) / (wide * freedom))
    return float(-0.5 * (freedom + 2.0) * odds - math.log(6.2832 * wide * marks.density))


def _parts(rows: IntArray, marks: _LinkMarks) -> list[IntArray]:
    """A chain cut where two objects are more probable than one that leaps."""
    cut = np.zeros(len(rows), dtype=np.bool_)
    _leaps(rows, marks, cut)
    cut |= _beyond_reach(
        marks.frame[rows], marks.centre[rows], float(np.median(marks.radius[rows]))
    )
    parts = np.split(rows, np.flatnonzero(cut))
    return [part for part in parts if len(part) >= MIN_FOUND_ROWS]


def _beyond_reach(frame: FloatArray, centre: FloatArray, radius: float) -> NDArray[np.bool_]:
    """Rows that lie further from the one before than the faster side's speed takes it (N,).

    With one radius to spare, for centres that are found off.
    """
    ahead = np.minimum(np.arange(len(frame)) + _SPEED_ROWS, len(frame) - 1)
    behind = np.maximum(np.arange(len(frame)) - _SPEED_ROWS, 0)
    after = np.hypot(*(centre[ahead] - centre).T) / np.maximum(frame[ahead] - frame, 1.0)
    before = np.hypot(*(centre - centre[behind]).T) / np.maximum(frame - frame[behind], 1.0)
    elapsed = np.diff(frame)
    reach = np.maximum(before[:-1], after[1:]) * elapsed + radius
    far = np.hypot(*np.diff(centre, axis=0).T) > reach
    return np.concatenate([[False], far])


@compiled
def _leaps(rows: IntArray, marks: _LinkMarks, cut: NDArray[np.bool_]) -> None:
    """Mark the rows of a chain before which it is rather cut."""
    for j in range(2, len(rows) - 1):
        before, here, after = rows[j - 1], rows[j], rows[j + 1]
        on = _turn(rows[j - 2], before, here, marks) + _turn(before, here, after, marks)
        cut[j] = _begun(here, after, marks) > on + _alike(before, here, marks)


def _joined(chains: list[IntArray], marks: _LinkMarks) -> list[IntArray]:
    """Join heads to tails as long as one object is more probable than two."""
    found = sorted(chains, key=lambda rows: int(rows[0]))
    ends = np.array([_ends(rows) for rows in found], dtype=np.int64).reshape(-1, 4)
    looks = np.array([_looks(rows, marks) for rows in found]).reshape(-1, 4)
    gains = np.full((len(found), len(found)), -np.inf)
    every = np.arange(len(found))
    _weigh(ends, looks, every, every, marks, gains)
    while len(found) and gains.max() > 0.0:
        head, tail = (int(place) for place in np.unravel_index(gains.argmax(), gains.shape))
        found[head] = np.concatenate([found[head], found[tail]])
        ends[head], looks[head] = _ends(found[head]), _looks(found[head], marks)
        every = every[every != tail]
        gains[[head, tail]] = gains[:, [head, tail]] = -np.inf
        new = np.array([head])
        _weigh(ends, looks, new, every, marks, gains)
        _weigh(ends, looks, every, new, marks, gains)
    return [found[place] for place in every]


def _ends(rows: IntArray) -> IntArray:
    """Two rows at the start of a chain and two at its end (4,)."""
    reach = min(len(rows), _SPEED_ROWS) - 1
    return rows[[0, reach, -1 - reach, -1]]


def _looks(rows: IntArray, marks: _LinkMarks) -> FloatArray:
    """Typical radius and colour of a chain (4,)."""
    return np.append(np.median(marks.radius[rows]), np.median(marks.colour[rows], axis=0))


@compiled
def _weigh(
    ends: IntArray,
    looks: FloatArray,
    heads: IntArray,
    tails: IntArray,
    marks: _LinkMarks,
    gains: FloatArray,
) -> None:
    """Write the log odds of one object, seen on both sides of a gap, against two."""
    known = marks.weights
    for head in heads:
        for tail in tails:
            a, b = ends[head, 2:]
            c, d = ends[tail, :2]
            gap = marks.frame[c] - marks.frame[b]
            if gap <= 0.0:
                continue
            fastest = max(_speed(a, b, marks), _speed(c, d, marks))
            if _speed(b, c, marks) * gap > fastest * gap + 0.5 * (looks[head, 0] + looks[tail, 0]):
                gains[head, tail] = -math.inf
                continue
            ratio = math.log(looks[head, 0] / looks[tail, 0]) / known.log_radius
            off = ((looks[head, 1:] - looks[tail, 1:]) ** 2).sum()
            odds = -0.5 * ratio * ratio - 2.0 * math.log(1.0 + off / known.colour**2)
            if gap > 1.0:
                odds += marks.log_missed + (gap - 1.0) * math.log(known.stays_missed)
            odds += _turn(a, b, c, marks) + _turn(b, c, d, marks) - _begun(c, d, marks)
            gains[head, tail] = odds


@compiled
def _speed(one: int, other: int, marks: _LinkMarks) -> float:
    """Speed between two rows, px per frame."""
    away = marks.centre[other] - marks.centre[one]
    elapsed = max(marks.frame[other] - marks.frame[one], 1.0)
    return float(math.sqrt(away[0] * away[0] + away[1] * away[1]) / elapsed)


def _explained(seen: Detections, rows: IntArray) -> NDArray[np.bool_]:
    """Detections that are of a chain, or the same circle found once more."""
    taken = np.zeros(len(seen), dtype=bool)
    taken[rows] = True
    order = np.searchsorted(seen.frame[rows], seen.frame)
    order = np.clip(order, 0, len(rows) - 1)
    owner = rows[order]
    shared = seen.frame[owner] == seen.frame
    away = np.hypot(*(seen.centre_px - seen.centre_px[owner]).T)
    ratio = np.abs(np.log(seen.radius_px / seen.radius_px[owner]))
    return np.asarray(taken | (shared & (away < 0.3 * seen.radius_px[owner]) & (ratio < 0.25)))


@dataclass(frozen=True)
class _Pairs:
    """Links between detections: earlier and later row, and their worth but for motion."""

    early: IntArray
    late: IntArray
    worth: FloatArray
    start: IntArray
    """Where the links to each row begin; one more than rows."""


def _pairs(marks: _LinkMarks) -> _Pairs:
    bounds = np.searchsorted(marks.step, np.arange(int(marks.step.max()) + 2))
    size = len(marks.step) * _MAX_GAP * int(np.diff(bounds).max(initial=1))
    early, late = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    odds = np.empty(size)
    start = np.zeros(len(marks.step) + 1, dtype=np.int64)
    count = _linked(marks, bounds, early, late, odds, start)
    return _Pairs(early[:count], late[:count], odds[:count], start)


@compiled
def _linked(
    marks: _LinkMarks,
    bounds: IntArray,
    early: IntArray,
    late: IntArray,
    odds: FloatArray,
    start: IntArray,
) -> int:
    """Write the links of rows up to three steps apart that look alike."""
    step = marks.step
    count = 0
    for row in range(len(step)):
        start[row] = count
        for gap in range(1, _MAX_GAP + 1):
            place = step[row] - gap
            if place < 0:
                break
            for other in range(bounds[place], bounds[place + 1]):
                if not _near(other, row, marks):
                    continue
                odds[count] = _alike(other, row, marks) + (gap - 1) * marks.log_missed
                early[count], late[count] = other, row
                count += 1
    start[len(step)] = count
    return count


@compiled
def _near(one: int, other: int, marks: _LinkMarks) -> bool:
    """Whether two detections may be of one object: within four scales, sixty of its speed."""
    if abs(marks.log_radius[other] - marks.log_radius[one]) > 4.0 * marks.weights.log_radius:
        return False
    reach = 60.0 * marks.weights.speed_radii * (marks.frame[other] - marks.frame[one]) + 4.0
    reach *= 0.5 * (marks.radius[one] + marks.radius[other])
    across = marks.centre[other, 0] - marks.centre[one, 0]
    down = marks.centre[other, 1] - marks.centre[one, 1]
    return bool(across * across + down * down <= reach * reach)


@compiled
def _alike(one: int, other: int, marks: _LinkMarks) -> float:
    """Log odds by their looks that two detections are of one object.

    Radii of false detections spread over three octaves, colours over a cube.
    """
    log_radius, scale = marks.weights.log_radius, marks.weights.colour
    ratio = (marks.log_radius[other] - marks.log_radius[one]) / log_radius
    off = 0.0
    for channel in range(3):
        off += (marks.colour[other, channel] - marks.colour[one, channel]) ** 2
    odds = -0.5 * ratio * ratio - math.log(log_radius * 2.5066 / 2.0)
    odds += -2.0 * math.log(1.0 + off / (scale * scale))
    return float(odds + 3.0 * math.log(40.0 / (scale + 10.0)))


@compiled
def _best_links(
    marks: _LinkMarks,
    alive: NDArray[np.bool_],
    early: IntArray,
    late: IntArray,
    odds: FloatArray,
    start: IntArray,
    best: FloatArray,
    before: IntArray,
) -> None:
    """Write for each link the worth of the best chain that ends with it, and its link before."""
    frame, centre, radius, worth = marks.frame, marks.centre, marks.radius, marks.worth
    known = marks.weights
    place_px, place_radii, change = known.place_px, known.place_radii, known.change_radii
    freedom, speed, density = known.change_freedom, known.speed_radii, marks.density
    begin_odds = math.log(known.begins)
    time = np.empty(len(early))
    speed_x, speed_y = np.empty(len(early)), np.empty(len(early))
    steep = -0.5 * (freedom + 2.0)
    for k in range(len(early)):
        i, j = early[k], late[k]
        best[k], before[k] = -1e9, -1
        if not (alive[i] and alive[j]):
            continue
        size = 0.5 * (radius[i] + radius[j])
        elapsed = frame[j] - frame[i]
        dx, dy = centre[j, 0] - centre[i, 0], centre[j, 1] - centre[i, 1]
        vx, vy = dx / elapsed, dy / elapsed
        time[k], speed_x[k], speed_y[k] = elapsed, vx, vy
        share = place_radii * size
        noise = place_px * place_px + share * share
        # a first link: any direction, speeds with a long tail
        reach = speed * size * elapsed
        scale = 2.0 * noise + reach * reach
        first = -1.5 * math.log(1.0 + (dx * dx + dy * dy) / scale)
        total = begin_odds + worth[i] + first - math.log(6.2832 * scale * density)
        here = -1
        # no continuation is worth more than one without any change
        most = -math.log(12.5664 * noise * density)
        for m in range(start[i], start[i + 1]):
            if best[m] + most <= total:
                continue
            earlier = time[m]
            ox, oy = (vx - speed_x[m]) * elapsed, (vy - speed_y[m]) * elapsed
            ratio = elapsed / earlier
            pull = change * size * 0.5 * elapsed * (elapsed + earlier)
            wide = noise * (2.0 + 2.0 * ratio + 2.0 * ratio * ratio) + pull * pull
            motion = steep * math.log(1.0 + (ox * ox + oy * oy) / (wide * freedom))
            motion -= math.log(6.2832 * wide * density)
            if best[m] + motion > total:
                total, here = best[m] + motion, m
        best[k], before[k] = total + odds[k] + worth[j], here


def _chains(
    seen: Detections, marks: _LinkMarks, pairs: _Pairs, alive: NDArray[np.bool_]
) -> list[IntArray]:
    """Rows of the best chains that share no detection."""
    best = np.empty(len(pairs.early))
    before = np.empty(len(pairs.early), dtype=np.int64)
    _best_links(marks, alive, pairs.early, pairs.late, pairs.worth, pairs.start, best, before)
    end = math.log(marks.weights.begins)
    used = np.zeros(len(seen), dtype=bool)
    chains: list[IntArray] = []
    rows = np.empty(int(marks.step.max()) + 1, dtype=np.int64)
    order = np.argsort(-best, kind="stable")
    place = count = 0
    while len(chains) < _PER_ROUND:
        place, count = _next_chain(
            *(order, place, best, -end, pairs.early, pairs.late, before, used, rows)
        )
        if count == 0:
            break
        chains.append(rows[:count][::-1].copy())
        used |= _explained(seen, chains[-1])
    return chains


@compiled
def _traced(
    place: int,
    early: IntArray,
    late: IntArray,
    before: IntArray,
    used: NDArray[np.bool_],
    rows: IntArray,
) -> int:
    """Write the rows of the chain that ends with a link, last first; 0 where one is used."""
    if used[late[place]]:
        return 0
    rows[0] = late[place]
    count = 1
    while place >= 0:
        row = early[place]
        if used[row]:
            return 0
        rows[count] = row
        count += 1
        place = before[place]
    return count


@compiled
def _next_chain(
    order: IntArray,
    place: int,
    best: FloatArray,
    least: float,
    early: IntArray,
    late: IntArray,
    before: IntArray,
    used: NDArray[np.bool_],
    rows: IntArray,
) -> tuple[int, int]:
    """Write the next best chain none of whose rows are used; the place after it, and its rows."""
    while place < len(order) and best[order[place]] > least:
        count = _traced(order[place], early, late, before, used, rows)
        place += 1
        if count >= MIN_FOUND_ROWS:
            return place, count
    return place, 0
