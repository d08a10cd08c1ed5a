"""Link detections to tracklets by one log odds: object or false detections.

A chain of detections is worth what its places and looks are more probable under one object than
under false detections spread evenly over the picture. An object goes on at its velocity
up to a Student-t distributed change (gravity, contacts and bounces are its tail), keeps its radius
and colour up to theirs, and is missed in some frames. The best chains are found by dynamic
programming over pairs of detections, so that each state has a velocity. `training/fit_finding.py`
estimates the parameters by maximum likelihood from recordings with truth. parameters.json holds
these estimates with 95 % intervals next to the values in use, whose tracklets cover more of the
objects: errors of neighbouring frames are alike, which the likelihood leaves out.
"""

import json
import math
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import resources
from itertools import pairwise

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


@dataclass(frozen=True)
class LinkParameters:
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
    looks = tuple(values.pop("looks")["value"])
    return LinkParameters(**{name: each["value"] for name, each in values.items()}, looks=looks)


@dataclass(frozen=True)
class Tracklet:
    """Detections of one object, in time order.

    Attributes
    ----------
    seen : Detections
        Its rows.
    log_odds : float
        Log odds by which it is more probable as one object than as false detections.
    """

    seen: Detections
    log_odds: float

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
        return Tracklet(seen, self.log_odds * len(seen) / max(len(self.seen), 1))

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
    step = np.searchsorted(frames, seen.frame)
    worth = node_worth(seen, known)
    # false detections for each px²: what is found, spread over the picture
    density = len(seen) / (len(frames) * float(shape[0] * shape[1]))
    pairs = _pairs(seen, step, worth, known, density)
    alive = np.ones(len(seen), dtype=bool)
    found: list[Tracklet] = []
    for _ in range(_ROUNDS):
        chains = _chains(seen, step, worth, pairs, alive, known, density)
        for rows, odds in chains:
            found.append(Tracklet(seen.at(rows), odds))
            alive &= ~_explained(seen, rows)
        if not chains:
            break
    found = [part for one in found for part in _parts(one, known, density)]
    found = _joined(found, known, density)
    return sorted(found, key=lambda one: -one.log_odds)[:_MAX_TRACKLETS]


def _parts(one: Tracklet, known: LinkParameters, density: float) -> list[Tracklet]:
    """A chain cut where two objects are more probable than one that leaps.

    Each chain is best by itself, so that it runs on through what belongs to another.
    """
    cut = np.zeros(len(one), dtype=np.bool_)
    seen = one.seen
    _leaps(
        seen.frame.astype(np.float64),
        seen.centre_px,
        seen.radius_px,
        seen.colour,
        known.place_px,
        known.place_radii,
        known.change_radii,
        known.change_freedom,
        known.speed_radii,
        known.log_radius,
        known.colour,
        known.begins,
        density,
        cut,
    )
    cut |= _beyond_reach(seen.frame.astype(np.float64), seen.centre_px, one.radius)
    ends = np.concatenate([[0], np.flatnonzero(cut), [len(one)]])
    parts = [np.arange(first, stop) for first, stop in pairwise(ends.tolist()) if stop - first >= 3]
    return [Tracklet(seen.at(rows), one.log_odds * len(rows) / len(one)) for rows in parts]


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


_SPEED_ROWS = 4
"""Rows over which a speed is taken. Derived: centres found by votes then add a percent of a radius
a frame."""


@compiled
def _leaps(
    frame: FloatArray,
    centre: FloatArray,
    radius: FloatArray,
    colour: FloatArray,
    place_px: float,
    place_radii: float,
    change: float,
    freedom: float,
    speed: float,
    log_radius: float,
    colour_scale: float,
    begins: float,
    density: float,
    cut: NDArray[np.bool_],
) -> None:
    """Mark the rows of a chain before which it is rather cut."""
    count = len(frame)
    turn = np.zeros(count)
    for j in range(1, count - 1):
        turn[j] = _turn(frame, centre, radius, j, place_px, place_radii, change, freedom, density)
    for j in range(2, count - 1):
        anew = _begun(frame, centre, radius, j, place_px, place_radii, speed, begins, density)
        alike = _alike(radius, colour, j - 1, j, log_radius, colour_scale)
        cut[j] = anew > turn[j - 1] + turn[j] + alike


@compiled
def _begun(
    frame: FloatArray,
    centre: FloatArray,
    radius: FloatArray,
    j: int,
    place_px: float,
    place_radii: float,
    speed: float,
    begins: float,
    density: float,
) -> float:
    """Log odds that one chain ends before a row, and another begins there with its first step."""
    size = 0.5 * (radius[j] + radius[j + 1])
    dx, dy = centre[j + 1, 0] - centre[j, 0], centre[j + 1, 1] - centre[j, 1]
    share, reach = place_radii * size, speed * size * (frame[j + 1] - frame[j])
    scale = 2.0 * (place_px * place_px + share * share) + reach * reach
    anew = -1.5 * math.log(1.0 + (dx * dx + dy * dy) / scale)
    return float(anew + 2.0 * math.log(begins) - math.log(6.2832 * scale * density))


@compiled
def _turn(
    frame: FloatArray,
    centre: FloatArray,
    radius: FloatArray,
    j: int,
    place_px: float,
    place_radii: float,
    change: float,
    freedom: float,
    density: float,
) -> float:
    """Log odds of the change of velocity at a row of a chain."""
    earlier, elapsed = frame[j] - frame[j - 1], frame[j + 1] - frame[j]
    size = 0.5 * (radius[j] + radius[j + 1])
    ratio = elapsed / earlier
    ox = centre[j + 1, 0] - centre[j, 0] - ratio * (centre[j, 0] - centre[j - 1, 0])
    oy = centre[j + 1, 1] - centre[j, 1] - ratio * (centre[j, 1] - centre[j - 1, 1])
    share = place_radii * size
    pull = change * size * 0.5 * elapsed * (elapsed + earlier)
    wide = (place_px * place_px + share * share) * (2.0 + 2.0 * ratio + 2.0 * ratio * ratio)
    wide += pull * pull
    odds = -0.5 * (freedom + 2.0) * math.log(1.0 + (ox * ox + oy * oy) / (wide * freedom))
    return float(odds - math.log(6.2832 * wide * density))


def _joined(found: list[Tracklet], known: LinkParameters, density: float) -> list[Tracklet]:
    """Join heads to tails as long as one object is more probable than two."""
    chains = sorted(found, key=lambda one: int(one.frame[0]))
    ends = np.array([_ends(one) for one in chains]).reshape(-1, 16)
    gains = np.full((len(chains), len(chains)), -np.inf)
    weights = np.array([getattr(known, name) for name in _JOIN_WEIGHTS])
    every = np.arange(len(chains))
    _weigh(ends, every, every, weights, density, gains)
    while len(chains) and gains.max() > 0.0:
        head, tail = (int(place) for place in np.unravel_index(gains.argmax(), gains.shape))
        whole = chains[head].then(chains[tail])
        chains[head] = Tracklet(whole.seen, whole.log_odds + float(gains[head, tail]))
        ends[head] = _ends(chains[head])
        every = every[every != tail]
        gains[[head, tail]] = gains[:, [head, tail]] = -np.inf
        new = np.array([head])
        _weigh(ends, new, every, weights, density, gains)
        _weigh(ends, every, new, weights, density, gains)
    return [chains[place] for place in every]


_JOIN_WEIGHTS = (
    *("place_px", "place_radii", "change_radii", "change_freedom", "speed_radii", "begins"),
    *("log_radius", "colour", "missed", "stays_missed"),
)


def _ends(one: Tracklet) -> FloatArray:
    """Frame, x and y of two rows at its end and of two at its start, radius and colour (16,)."""
    reach = min(len(one) - 1, 3)
    rows = np.array([-1 - reach, -1, 0, reach])
    places = np.column_stack([one.frame[rows], one.centre_px[rows]])
    colour = np.median(one.seen.colour, axis=0)
    return np.concatenate([places.ravel(), [one.radius], colour])


@compiled
def _weigh(
    ends: FloatArray,
    heads: IntArray,
    tails: IntArray,
    weights: FloatArray,
    density: float,
    gains: FloatArray,
) -> None:
    """Write the log odds of one object, seen on both sides of a gap, against two."""
    place_px, place_radii, change, freedom, speed, begins = weights[:6]
    log_radius, colour, missed, stays_missed = weights[6:]
    frame, centre, radius = np.empty(4), np.empty((4, 2)), np.empty(4)
    for head in heads:
        for tail in tails:
            if ends[tail, 6] <= ends[head, 3]:
                continue
            for row in range(4):
                source = ends[head] if row < 2 else ends[tail]
                frame[row] = source[3 * row]
                centre[row, 0], centre[row, 1] = source[3 * row + 1], source[3 * row + 2]
            radius[:] = 0.5 * (ends[head, 12] + ends[tail, 12])
            motion = _gap_odds(
                *(frame, centre, radius, place_px, place_radii),
                *(change, freedom, speed, begins, density),
            )
            ratio = math.log(ends[head, 12] / ends[tail, 12]) / log_radius
            off = 0.0
            for channel in range(13, 16):
                off += (ends[head, channel] - ends[tail, channel]) ** 2
            looks = -0.5 * ratio * ratio - 2.0 * math.log(1.0 + off / (colour * colour))
            gap = frame[2] - frame[1]
            if gap > 1.0:
                looks += math.log(missed) + (gap - 1.0) * math.log(stays_missed)
            gains[head, tail] = motion + looks


@compiled
def _gap_odds(
    frame: FloatArray,
    centre: FloatArray,
    radius: FloatArray,
    place_px: float,
    place_radii: float,
    change: float,
    freedom: float,
    speed: float,
    begins: float,
    density: float,
) -> float:
    """Log odds by motion that the last two of four rows go on from the first two."""
    fastest = 0.0
    for row in range(0, 4, 2):
        dx, dy = centre[row + 1, 0] - centre[row, 0], centre[row + 1, 1] - centre[row, 1]
        fastest = max(fastest, math.sqrt(dx * dx + dy * dy) / max(frame[row + 1] - frame[row], 1.0))
    gx, gy = centre[2, 0] - centre[1, 0], centre[2, 1] - centre[1, 1]
    if math.sqrt(gx * gx + gy * gy) > fastest * (frame[2] - frame[1]) + radius[0]:
        return -math.inf
    anew = _begun(frame, centre, radius, 2, place_px, place_radii, speed, begins, density)
    first = _turn(frame, centre, radius, 1, place_px, place_radii, change, freedom, density)
    return (
        first
        + _turn(frame, centre, radius, 2, place_px, place_radii, change, freedom, density)
        - anew
    )


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


def _pairs(
    seen: Detections,
    step: IntArray,
    worth: FloatArray,
    known: LinkParameters,
    density: float,
) -> _Pairs:
    bounds = np.searchsorted(step, np.arange(int(step.max()) + 2))
    size = len(seen) * _MAX_GAP * int(np.diff(bounds).max(initial=1))
    early, late = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    odds = np.empty(size)
    start = np.zeros(len(seen) + 1, dtype=np.int64)
    count = _linked(
        step,
        bounds,
        seen.frame.astype(np.float64),
        seen.centre_px,
        seen.radius_px,
        seen.colour,
        known.log_radius,
        known.colour,
        known.missed,
        known.speed_radii,
        early,
        late,
        odds,
        start,
    )
    return _Pairs(early[:count], late[:count], odds[:count], start)


@compiled
def _linked(
    step: IntArray,
    bounds: IntArray,
    frame: FloatArray,
    centre: FloatArray,
    radius: FloatArray,
    colour: FloatArray,
    log_radius: float,
    colour_scale: float,
    missed: float,
    speed: float,
    early: IntArray,
    late: IntArray,
    odds: FloatArray,
    start: IntArray,
) -> int:
    """Write the links of rows up to three steps apart that look alike."""
    count = 0
    for row in range(len(step)):
        start[row] = count
        for gap in range(1, 4):
            place = step[row] - gap
            if place < 0:
                break
            for other in range(bounds[place], bounds[place + 1]):
                if abs(math.log(radius[row] / radius[other])) > 4.0 * log_radius:
                    continue
                dx, dy = centre[row, 0] - centre[other, 0], centre[row, 1] - centre[other, 1]
                elapsed = frame[row] - frame[other]
                size = 0.5 * (radius[row] + radius[other])
                if dx * dx + dy * dy > (60.0 * speed * elapsed + 4.0) ** 2 * size * size:
                    continue
                alike = _alike(radius, colour, other, row, log_radius, colour_scale)
                odds[count] = alike + (gap - 1) * math.log(missed)
                early[count], late[count] = other, row
                count += 1
    start[len(step)] = count
    return count


@compiled
def _alike(
    radius: FloatArray,
    colour: FloatArray,
    one: int,
    other: int,
    log_radius: float,
    colour_scale: float,
) -> float:
    """Log odds by their looks that two detections are of one object.

    Radii of false detections spread over three octaves, colours over a cube.
    """
    ratio = math.log(radius[other] / radius[one]) / log_radius
    off = 0.0
    for channel in range(3):
        off += (colour[other, channel] - colour[one, channel]) ** 2
    odds = -0.5 * ratio * ratio - math.log(log_radius * 2.5066 / 2.0)
    odds += -2.0 * math.log(1.0 + off / (colour_scale * colour_scale))
    return odds + 3.0 * math.log(40.0 / (colour_scale + 10.0))


@compiled
def _best_links(
    frame: FloatArray,
    centre: FloatArray,
    radius: FloatArray,
    worth: FloatArray,
    alive: NDArray[np.bool_],
    early: IntArray,
    late: IntArray,
    odds: FloatArray,
    start: IntArray,
    place_px: float,
    place_radii: float,
    change: float,
    freedom: float,
    speed: float,
    begins: float,
    density: float,
    best: FloatArray,
    before: IntArray,
) -> None:
    """Write for each link the worth of the best chain that ends with it, and its link before."""
    begin_odds = math.log(begins)
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
    seen: Detections,
    step: IntArray,
    worth: FloatArray,
    pairs: _Pairs,
    alive: NDArray[np.bool_],
    known: LinkParameters,
    density: float,
) -> list[tuple[IntArray, float]]:
    """Rows and log odds of the best chains that share no detection."""
    best = np.empty(len(pairs.early))
    before = np.empty(len(pairs.early), dtype=np.int64)
    _best_links(
        seen.frame.astype(np.float64),
        seen.centre_px,
        seen.radius_px,
        worth,
        alive,
        pairs.early,
        pairs.late,
        pairs.worth,
        pairs.start,
        known.place_px,
        known.place_radii,
        known.change_radii,
        known.change_freedom,
        known.speed_radii,
        known.begins,
        density,
        best,
        before,
    )
    end = math.log(known.begins)
    used = np.zeros(len(seen), dtype=bool)
    chains: list[tuple[IntArray, float]] = []
    rows = np.empty(int(step.max()) + 1, dtype=np.int64)
    for place in np.argsort(-best, kind="stable").tolist():
        if best[place] + end <= 0.0 or len(chains) >= _PER_ROUND:
            break
        count = _traced(place, pairs.early, pairs.late, before, used, rows)
        if count < 3:
            continue
        chain = rows[:count][::-1].copy()
        used |= _explained(seen, chain)
        chains.append((chain, float(best[place]) + end))
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
