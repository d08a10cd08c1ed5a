"""Stretches of a path that one constant acceleration explains, and a course from rest on."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled

__all__ = ["LawfulCourse", "bends_up", "lawful_course", "lawful_stretch"]

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]

_TRIALS = 200
"""Sets of looks tried: of two hundred one is free of outliers even where only a fifth of all looks
is right."""

# Of so many sets one agrees by chance more often than any given one does, nats.
_SEARCHED = float(np.log(_TRIALS))

_FEWEST = 5
"""Looks: a parabola has three unknowns, and two more show whether it is one."""

# Circles of edges scatter by about this: px, and in radii.
_PATH_SCATTER_PX = 0.7

_PATH_SCATTER_RADII = 0.12
"""Radii, scatter of a rough outline about its path, supposed."""

# A look that is off the motion costs so many nats: some are mistaken.
_OFF_PRICE = 1.0

_LEAST_TRAVEL = 1.0

_STILL_FROM = 3
"""Frames whose median tells where a thing lies at first."""

_STRAY_PRICE = 2.0
"""Nats: a fine fit off its course, or a gap in it, is rarer than a rough look that is."""


@dataclass(frozen=True)
class LawfulStretch:
    """The part of a path that one constant acceleration explains.

    Attributes
    ----------
    first, last : int
        Its first and last frame.
    looks : int
        How many looks agree.
    evidence : float
        How much more likely they are so than by chance, nats; 0 where there is no such stretch.
    travel_px : float
        How far it goes, px.
    """

    first: int
    last: int
    looks: int
    evidence: float
    travel_px: float


def lawful_stretch(frame: IntArray, centre: FloatArray, radius: float) -> LawfulStretch:
    """Find the stretch of a path with the most evidence for a constant acceleration.

    Parameters
    ----------
    frame : (N,) int array
        Frames, increasing.
    centre : (N, 2) array
        Centres, px.
    radius : float
        Radius, px.

    Returns
    -------
    LawfulStretch
        With no evidence where the thing stays where it is.
    """
    count = len(frame)
    nothing = LawfulStretch(int(frame[0]), int(frame[0]), 0, 0.0, 0.0)
    if count < _FEWEST:
        return nothing
    tolerance = _tolerance(radius)
    chosen = _triples(count)
    explained = np.empty(5)
    _explained(frame.astype(np.float64), centre, chosen, tolerance, radius, explained)
    first, last, looks = (int(value) for value in explained[:3])
    if looks == 0:
        return nothing
    return LawfulStretch(
        int(frame[first]), int(frame[last]), looks, float(explained[3]), float(explained[4])
    )


@dataclass(frozen=True)
class LawfulCourse:
    """A thing that lies still, leaves, and follows one law of motion from then on.

    Attributes
    ----------
    still, moving : int
        Frames in which it is where it lay, and where the law has it.
    astray, missed : int
        Frames in which it is elsewhere, and in which it is not seen in between.
    hidden : float
        How many of those missed are not there, or follow from others: what hides it for one frame
        does for the next.
    absent : int
        How many are not there.
    last : int
        The last frame in which the law has it, or it lies still.
    travel_px : float
        How far it goes by the law, px.
    """

    still: int
    moving: int
    astray: int
    missed: int
    hidden: float
    absent: int
    last: int
    travel_px: float

    def evidence(self, radius: float) -> float:
        """How much more likely it is so than by chance, nats, told as finely as by that radius."""
        agree = self.still + self.moving - _FEWEST
        gained = agree * math.log1p(self.travel_px / _tolerance(radius))
        return gained - _STRAY_PRICE * (self.astray + self.missed - self.hidden)


def lawful_course(
    frame: IntArray, centre: FloatArray, radius: float, shown: IntArray | None = None
) -> LawfulCourse:
    """Find the rest and the law that explain most of a path from its start on.

    Parameters
    ----------
    frame : (N,) int array
        Frames, increasing.
    centre : (N, 2) array
        Centres, px.
    radius : float
        Radius, px.
    shown : (n,) int array, optional
        Frames that there are, increasing; every one without.

    Returns
    -------
    LawfulCourse
    """
    away = np.hypot(*(centre - np.median(centre[:_STILL_FROM], axis=0)).T)
    near = away < _tolerance(radius)
    run = np.cumsum(np.where(near, 0.5, -1.0))
    ends = int(np.argmax(run)) + 1 if len(run) and run.max() > 0.0 else 0
    found = []
    for left in sorted({0, ends}):
        law = lawful_stretch(frame[left:], centre[left:], radius) if left < len(frame) else None
        moving, travel = (law.looks, law.travel_px) if law is not None else (0, 0.0)
        last = law.last if law is not None and moving else int(frame[max(left - 1, 0)])
        still = int(np.count_nonzero(near[:left]))
        if law is not None and moving and still:
            # What lay further off than it can have gone since is another thing.
            speed = travel / max(law.last - law.first, 1)
            gone = float(away[frame == law.first][0])
            if gone > speed * (law.first - int(frame[left - 1])) + 2.0 * _tolerance(radius):
                still = 0
        astray = len(frame) - still - moving
        missed = int(np.ptp(frame)) + 1 - len(frame)
        gaps = np.diff(frame if shown is None else np.searchsorted(shown, frame)) - 1
        absent = missed - int(gaps.sum())
        hidden = _hidden(gaps) + absent
        found.append(LawfulCourse(still, moving, astray, missed, hidden, absent, last, travel))
    return max(found, key=lambda course: course.evidence(radius))


def _hidden(gaps: IntArray) -> float:
    """Frames of gaps that are no further surprise: of those so long or longer, one in each is."""
    long = gaps[gaps > 0].astype(np.float64)
    return float((long - 1.0 - np.log(long)).sum())


def _tolerance(radius: float) -> float:
    return _PATH_SCATTER_PX + _PATH_SCATTER_RADII * radius


@compiled
def _explained(
    frame: FloatArray,
    centre: FloatArray,
    chosen: IntArray,
    tolerance: float,
    radius: float,
    best: FloatArray,
) -> None:
    """Find the run of looks with the most evidence among those about sets of three chosen ones.

    Writes its first and last look, how many agree, the evidence and how far it goes, px; nought
    agree where no run has evidence. Of equals the longest is taken.
    """
    best[:] = 0.0
    off = np.empty(len(frame), dtype=np.bool_)
    for trial in range(len(chosen)):
        _astray(frame, centre, chosen[trial], tolerance, off)
        # as far on either side of the chosen ones as most agree, and no further
        first, last, gain, most = chosen[trial, 0], chosen[trial, 2], 0.0, 0.0
        for k in range(first - 1, -1, -1):
            gain += -1.0 if off[k] else 0.5
            if gain > most:
                first, most = k, gain
        gain, most = 0.0, 0.0
        for k in range(last + 1, len(frame)):
            gain += -1.0 if off[k] else 0.5
            if gain > most:
                last, most = k, gain
        looks, low_x, high_x, low_y, high_y = 0, np.inf, -np.inf, np.inf, -np.inf
        for k in range(first, last + 1):
            if not off[k]:
                looks += 1
                low_x, high_x = min(low_x, centre[k, 0]), max(high_x, centre[k, 0])
                low_y, high_y = min(low_y, centre[k, 1]), max(high_y, centre[k, 1])
        travel = math.hypot(high_x - low_x, high_y - low_y) if looks > 0 else 0.0
        if travel < _LEAST_TRAVEL * radius or looks < _FEWEST:
            continue
        evidence = (looks - 3) * math.log1p(travel / tolerance) - _SEARCHED
        evidence -= _OFF_PRICE * (last + 1 - first - looks)
        longer = last - first > best[1] - best[0]
        if evidence > best[3] or (evidence == best[3] and longer and best[2] > 0.0):
            best[0], best[1], best[2], best[3], best[4] = first, last, looks, evidence, travel


@compiled
def _astray(
    frame: FloatArray,
    centre: FloatArray,
    chosen: IntArray,
    tolerance: float,
    off: NDArray[np.bool_],
) -> None:
    """Write which looks lie off the parabola through three chosen ones."""
    begin, middle, end = chosen
    span = max(frame[end] - frame[begin], 1.0)
    part = (frame[middle] - frame[begin]) / span
    x, y = centre[begin]
    dx, dy = centre[end, 0] - x, centre[end, 1] - y
    bend = part * part - part
    bend_x = (centre[middle, 0] - x - part * dx) / bend
    bend_y = (centre[middle, 1] - y - part * dy) / bend
    for k in range(len(frame)):
        time = (frame[k] - frame[begin]) / span
        away_x = centre[k, 0] - x - time * (dx - bend_x + time * bend_x)
        away_y = centre[k, 1] - y - time * (dy - bend_y + time * bend_y)
        off[k] = math.hypot(away_x, away_y) > tolerance


@cache
def _triples(count: int) -> IntArray:
    """Sets of three looks at all distances, the same for all paths of a length.

    Short ones are as frequent as long ones: a thing that bounces often is lawful in between.
    """
    rng = np.random.default_rng(count)
    longest = float(count - 1)
    span = np.rint(4.0 * (longest / 4.0) ** rng.uniform(size=_TRIALS)).astype(np.int64)
    start = np.floor(rng.uniform(size=_TRIALS) * (count - span)).astype(np.int64)
    middle = start + 1 + np.floor(rng.uniform(size=_TRIALS) * (span - 1)).astype(np.int64)
    return np.column_stack([start, middle, start + span])


_LIKELY_SIGMAS = 3.0
"""Standard deviations from which a bend is no chance: of straight ways one in 740 seems to."""

_LEAST_STD_PX = 0.05
"""px: no outline is known better over a whole path."""

_MOST_ALIKE = 0.9
"""Correlation of neighbouring residuals from which no more can be told from a short path."""

_LENS_BENDS = 0.01
"""Sagitta over length of a straight line in a picture: what lenses of cameras and telephones leave,
supposed."""


def bends_up(frame: IntArray, centre: FloatArray, radius: float) -> bool:
    """Whether a way very likely bends upwards, as a bob's does where it is lowest; no fall does.

    What is braked as it comes down the picture goes straight.

    Parameters
    ----------
    frame : (N,) int array
        Increasing.
    centre : (N, 2) array
        px, y down.
    radius : float
        px.
    """
    stretch = lawful_stretch(frame, centre, radius)
    inside = (frame >= stretch.first) & (frame <= stretch.last)
    if np.count_nonzero(inside) < _FEWEST:
        return False
    time = (frame[inside] - frame[inside].mean()).astype(np.float64)
    place = centre[inside]
    powers = np.column_stack([np.ones_like(time), time, 0.5 * time * time])
    motion = np.linalg.lstsq(powers, place, rcond=None)[0]
    course = motion[1] / max(float(np.hypot(*motion[1])), 1e-9)
    down = float(motion[2, 1] - (motion[2] @ course) * course[1])
    random = _scattered(powers, place - powers @ motion, _LEAST_STD_PX)
    return down < -_LIKELY_SIGMAS * float(np.hypot(random, _lens_acceleration(place, powers)))


def _scattered(powers: FloatArray, left: FloatArray, least: float) -> float:
    """Standard uncertainty of an acceleration (px per frame²) by what its law leaves, px.

    Slow errors count by how alike those of neighbouring frames are.
    """
    spare = max(len(left) - 3, 1)
    scatter = float(np.sqrt((left**2).sum() / (2.0 * spare)))
    alike = float((left[1:] * left[:-1]).sum() / max((left**2).sum(), 1e-12))
    alike = min(max(alike, 0.0), _MOST_ALIKE)
    noise = max(scatter, least) * np.sqrt((1.0 + alike) / (1.0 - alike))
    return float(noise * np.sqrt(np.linalg.inv(powers.T @ powers)[2, 2]))


def _lens_acceleration(place: FloatArray, powers: FloatArray) -> float:
    """Acceleration (px per frame²) that a lens makes of a straight way of so long a span."""
    length, span = float(np.hypot(*np.ptp(place, axis=0))), float(np.ptp(powers[:, 1]))
    return 8.0 * _LENS_BENDS * length / span**2
