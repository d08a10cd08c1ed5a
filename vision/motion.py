"""What moves how: motion models of followed things, and what happens in a clip.

How lawfully a thing moves: the stretch of its path that a constant acceleration explains.

A thrown, struck or falling ball runs along a parabola, a rolling one along a line; a hand, a blob
or a string of unrelated edges does not. Each look beyond the three that fix the motion, and that
lies where the motion says, would have lain there by chance with a probability of about tolerance
over travel; the logarithms add up to the evidence.

Whether a thing swings: a decaying oscillation on an arc, as one linear fit for each frequency.

A bob on a cord or rod of length l at the small angle φ = a cos(ωt) e^(-γt) is at x = l sin φ,
y = l cos φ: along the arc terms in ω, across it in 2ω, each decaying. With the decay taken to
first order all of them are linear in their amplitudes once ω is given.

What happens in a clip: a strike, a flight, a drop, a swing, a collision, or nothing.

The explanations compete. Each says where the followed thing is in the frames that it claims, to
within a scatter s; a frame that it leaves unexplained may be anywhere in the area A that was
travelled. Its log evidence is the sum of log(A / 2πs²) - d²/2s² over its frames, less
the price of its parameters (Schwarz 1978); a thing that follows no law has none. Errors of
neighbouring frames are alike, so that many frames count for no more than a few dozen.

What moves lawfully falls, or goes straight on as what rolls or slides does, perhaps braked, or is
bent by something else. Which of them is told by the accelerations of its arcs beside how well they
are known, over all sizes that gravity may have in a picture: neither scale nor rate is needed.
"""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import scipy
from numpy.typing import NDArray

from metrology.compiled import compiled
from vision.tracks import Motion, MotionKind, Track

__all__ = ["LawfulCourse", "bends_up", "lawful_course", "lawful_stretch", "motion_of"]

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


_FREQUENCIES = 80
"""Frequencies tried for a swing, geometrically, and refined afterwards; supposed."""

# Periods shorter than so many frames are not told from noise.
_SHORTEST_PERIOD = 8.0

# Less than this part of a period is an arc that turns back: below it nothing is known of a swing.
_LEAST_PERIODS = 0.35

_ROUNDS = 4
"""Rounds of reweighting, supposed: outliers are out after a few."""

PARAMETERS = 15
"""Numbers of a swing: columns of both axes, and the frequency."""


@dataclass(frozen=True)
class Oscillation:
    """A swing.

    Attributes
    ----------
    omega : float
        Angular frequency, rad per frame.
    residual_px : (N,) array
        Distance of each position from it, px.
    periods : float
        How many periods were seen.
    """

    omega: float
    residual_px: FloatArray
    periods: float


def fit_oscillation(time: FloatArray, centre: FloatArray, scale_px: float) -> Oscillation | None:
    """Fit a swing to positions.

    Parameters
    ----------
    time : (N,) array
        Frames.
    centre : (N, 2) array
        Positions, px.
    scale_px : float
        Residual beyond which a position loses weight, px.

    Returns
    -------
    Oscillation or None
        None where there are too few positions.
    """
    if len(time) < 2 * PARAMETERS:
        return None
    span = float(time[-1] - time[0])
    spacing = span / (len(time) - 1)
    shortest = max(_SHORTEST_PERIOD, 4.0 * spacing)
    lowest, highest = 2 * np.pi * _LEAST_PERIODS / span, 2 * np.pi / shortest
    if highest <= lowest:
        return None
    shifted = time - time[0]
    best, cost = None, np.inf
    for omega in np.geomspace(lowest, highest, _FREQUENCIES):
        residual = _residual(shifted, centre, float(omega), scale_px)
        robust = float(np.mean(np.minimum(residual, 3.0 * scale_px)))
        if robust < cost:
            best, cost = Oscillation(float(omega), residual, omega * span / (2 * np.pi)), robust
    return best


def _residual(time: FloatArray, centre: FloatArray, omega: float, scale_px: float) -> FloatArray:
    span = float(time[-1])
    turn = omega * time
    ones = np.ones_like(time)
    design = np.column_stack(
        [
            ones,
            np.cos(turn),
            np.sin(turn),
            time / span * np.cos(turn),
            time / span * np.sin(turn),
            np.cos(2 * turn),
            np.sin(2 * turn),
        ]
    )
    weight = ones
    residual = np.zeros_like(time)
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)[:, None]
        # A ridge: below half a period the columns are nearly one another's.
        normal = (design * root).T @ (design * root) + 1e-6 * len(time) * np.eye(design.shape[1])
        amplitude = np.linalg.solve(normal, (design * weight[:, None]).T @ centre)
        residual = np.hypot(*(centre - design @ amplitude).T)
        weight = 1.0 / (1.0 + (residual / scale_px) ** 2) ** 2
    return residual


_LEAST_REST = 5
"""Frames: what is at rest for fewer may only pass its turning point."""

# What a law leaves over: px, and in radii (deformation, drag, a camera that is not ideal).
_SCATTER_PX = 0.4

_SCATTER_RADII = 0.04
"""Radii, scatter of an outline about its path, supposed."""

_MOST_INDEPENDENT = 40.0
"""Frames that count as independent at most: errors of neighbours are alike, as the ball looks
alike."""

# A law may leave this part of the frames it claims unexplained (mistaken fits).
_STRAY = 0.05

# A swing is all of the motion, or none of it; so is an arc of its frames.
_WHOLE = 0.8

_OFF_LAW = 3.0
"""Scatters: what is further off follows another law; of honest frames one in ninety is."""

# Nothing is surer than this: what was not thought of is left.
_MOST_CERTAIN = 0.99

# A strike, a drop and a throw differ by how the motion begins. Odds where that was not seen.
_UNSEEN_STRIKER_ODDS = 3.0
_MOST_RESTS = 3
"""Places in which a thing lies, one after the other, supposed: with more of them any way is one."""
_PENDULUM_ODDS, _UNSURE_PENDULUM_ODDS = 100.0, 5.0
"""Odds of a strike where a pendulum came as it left: one that swings and whose speeds agree with
the blow, and a thing of which one of them is not known; supposed. Of 46 pendulums of three
renderers that were followed 43 were of the first kind."""
# A free motion that begins so many frames, or this part of itself, after the rest began otherwise.
_AT_ONCE, _AT_ONCE_SHARE = 3, 0.25

# A drop goes along its acceleration: sideways by less than this part of the way.
_DROP_SIDEWAYS = 0.06

_DROP_ODDS = 30.0
"""Odds, supposed: of a fall straight down that begins at rest being a drop, or of one with speed
sideways being none."""

_BEGINS_AT_REST = 0.15
"""Of the way that a fall's speed covers in its span: slower is let go, not thrown."""

_SLOWEST_FALL, _FASTEST_FALL = 6.5e-7, 9.8
"""Radii per frame², of what falls with 9.81 m/s²: a ball of 0.3 m at 10,000 frames per second, and
one of 5 mm at 20."""

_UPRIGHT = 0.17
"""rad: a camera held upright leans by less than 10°, one standard deviation, supposed."""

_LENS_BENDS = 0.01
"""Sagitta over length of a straight line in a picture: what lenses of cameras and telephones leave,
supposed."""

# How often what falls was thrown under any camera, thrown under an upright one, or goes up and down
# along one line; and how often what does not fall goes straight on evenly, braked, or down a slope,
# or is held on an arc.
_ANY, _UNDER, _PLUMB = 0.1, 0.6, 0.3
_EVENLY, _BRAKED, _DOWNHILL, _HELD = 0.45, 0.3, 0.15, 0.1
"""Supposed, each sums to one; twice as much of one is a factor of two in the odds at most."""

_ARC_LESS_PARABOLA = 1.0 / (3.0 * 175.0**0.5)
"""Of S³/L²: root mean square of what a parabola leaves of an arc of radius L, S to either side of
its middle: the s³/6L² by which its chord is shorter, less the straight part of that."""

_SIZES = 600
"""Sizes of the acceleration summed over, log-evenly, and again about what is measured."""

_MOST_ARCS = 16
"""Arcs looked for, supposed: of a ball that bounces more often the first tell how it falls."""

_TELLING = 3.0
"""Nats of evidence, odds of twenty, from which an arc counts beside others."""

_SAME_FALL = 0.1
"""Share by which one fall seems to differ, one standard deviation, supposed: a radius is told to a
few per cent where a ball is smeared or small, and air resists.
"""

_FALLS_TOO = 0.7
"""Supposed: how often what falls in one arc falls in another one, too, instead of rolling."""

_BENT_ALIKE = 0.5
"""Log size: how far strengths of one drive differ from arc to arc, supposed."""

_BENT, _NOT_BENT = 0.05, 2.0
"""Beta distribution of how often a path is bent by neither gravity nor friction: by a drive of its
own, a hand, an unseen bounce; one arc in forty by itself, one in three where another one is."""

_BLOW_FRAMES = 20
"""Frames on either side of a meeting: rolling and sliding slow down little over them."""

_MASS_RATIO, _STEADY_SHARE, _UNSEEN_BLOW = 0.7, 0.05, 0.5
"""Log ratio of the masses of two balls of one size, one standard deviation; share of a velocity
that friction takes over so many frames; and how likely a blow is of which one side was not seen;
supposed."""

_SURE_SIGMAS = 5.0
"""Standard deviations of an acceleration from which its direction is told: to a fifth of a radian.
"""

_LIKELY_SIGMAS = 3.0
"""Standard deviations from which a bend is no chance: of straight ways one in 740 seems to."""

_UNHEARD_OF = 1e-12
"""Relative likelihood of an acceleration beyond all sizes: something makes a path do that, too."""

_LEAST_STD_PX = 0.05
"""px: no outline is known better over a whole path."""

_MOST_ALIKE = 0.9
"""Correlation of neighbouring residuals from which no more can be told from a short path."""


@dataclass(frozen=True)
class _Flight:
    """The stretch of free motion: frames, motion in it, and its log evidence, nats.

    `falls` is the probability that it falls, beside going straight on or being bent otherwise;
    `held` that it is held from above, as a bob is, if it does not fall.
    """

    first: int
    last: int
    log_evidence: float
    velocity: FloatArray
    acceleration: FloatArray
    acceleration_std: float
    radius: float
    bends: "_Bend"
    falls: float = 0.5
    held: float = 0.0


@dataclass(frozen=True)
class _Bend:
    """How likely an acceleration is of what falls, rolls, is held, or is bent by anything else.

    In units of the likelihood at its best estimate.
    """

    falling: float
    rolling: float
    held: float
    other: float

    @property
    def straight(self) -> float:
        """Of what does not fall, and is bent by nothing else."""
        return self.rolling + self.held


def motion_of(
    ball: Track,
    rest_frames: tuple[int, int] | None,
    *,
    pendulum: bool,
    sure: bool = True,
    striker: Track | None = None,
) -> Motion:
    """Say what happened to the ball.

    Parameters
    ----------
    ball : Track
        What was followed.
    rest_frames : tuple of int or None
        First and last frame in which it lies still before it leaves.
    pendulum : bool
        Whether a pendulum was followed to it.
    sure : bool
        Whether that is one: it swings on an arc, and its speeds agree with the blow.
    striker : Track, optional
        Another ball that came to it while it lay still.

    Returns
    -------
    Motion
    """
    if rest_frames is not None and rest_frames[1] - rest_frames[0] < _LEAST_REST:
        # What is released stays that long about where it turns.
        rest_frames = None
    moving = ball.where(ball.frame >= (0 if rest_frames is None else rest_frames[1]))
    if len(moving) < _FEWEST:
        return Motion(MotionKind.NONE, 1.0, ("Too few frames show anything that moves.",))
    scatter = _SCATTER_PX + _SCATTER_RADII * float(np.median(ball.radius_px))
    extent = float(np.hypot(*np.ptp(moving.centre_px, axis=0)))
    scatter = float(np.hypot(scatter, _LENS_BENDS / 3.0 * extent))
    area = float(np.prod(np.ptp(moving.centre_px, axis=0) + 2.0 * moving.radius_px[0]))
    flight = _flight(moving, scatter, area)
    swing = _swing_log_evidence(ball, scatter, area) if rest_frames is None else 0.0
    straight = 0.0
    if rest_frames is None:
        still = _still_log_evidence(moving, scatter, area)
        straight = max(_straight_log_evidence(moving, scatter, area), still)
    log_evidence = {MotionKind.NONE: straight}
    if swing > 0.0:
        log_evidence[MotionKind.SWING] = swing
    reasons: dict[MotionKind, tuple[str, ...]] = {
        MotionKind.NONE: ("What moves follows neither a free flight nor a swing, or rolls on.",),
        MotionKind.SWING: ("It goes to and fro on an arc.",),
    }
    if flight is not None:
        met = _exchanged(ball, rest_frames, striker)
        if not (pendulum and sure) or rest_frames is None:
            # What a pendulum meets at rest may roll as well as fly, and so may a ball met by one.
            otherwise = flight.log_evidence + math.log(1.0 - (flight.falls if met is None else met))
            held = flight.held if rest_frames is None else 0.0
            rolls = otherwise + math.log1p(-held)
            log_evidence[MotionKind.NONE] = float(np.logaddexp(straight, rolls))
            if held > 0.0:
                swings = otherwise + math.log(held)
                log_evidence[MotionKind.SWING] = float(np.logaddexp(swing, swings))
        for kind, odds, reason in _beginnings(
            flight, rest_frames, met, _struck_odds(pendulum, sure)
        ):
            log_evidence[kind] = flight.log_evidence + float(np.log(odds))
            reasons[kind] = (reason,)
    return _judged(log_evidence, reasons, flight, rest_frames, ball)


def _judged(
    log_evidence: dict[MotionKind, float],
    reasons: dict[MotionKind, tuple[str, ...]],
    flight: _Flight | None,
    rest_frames: tuple[int, int] | None,
    ball: Track,
) -> Motion:
    best = max(log_evidence.values())
    weight = {kind: float(np.exp(value - best)) for kind, value in log_evidence.items()}
    total = sum(weight.values())
    spare = (1.0 - _MOST_CERTAIN) / len(MotionKind)
    probability = {
        kind: _MOST_CERTAIN * weight.get(kind, 0.0) / total + spare for kind in MotionKind
    }
    ranked = sorted(MotionKind, key=lambda kind: -probability[kind])
    kind = ranked[0]
    frames: tuple[int, int] | None = (int(ball.frame[0]), int(ball.frame[-1]))
    if kind is MotionKind.NONE:
        frames = None
    elif kind is not MotionKind.SWING and flight is not None:
        begins = flight.first if rest_frames is None else min(flight.first, rest_frames[1])
        frames = (begins, flight.last)
    return Motion(
        kind,
        probability[kind],
        reasons.get(kind, ()),
        frames,
        tuple((other, probability[other]) for other in ranked[1:]),
        None if flight is None else _sure_fall(flight),
    )


def _sure_fall(flight: _Flight) -> tuple[float, float] | None:
    """The acceleration of what likely falls, px per frame², where its direction is sure."""
    across, down = flight.acceleration.tolist()
    known = np.hypot(across, down) > _SURE_SIGMAS * flight.acceleration_std
    return (across, down) if flight.falls > 0.5 and known else None


def _flight(moving: Track, scatter: float, area: float) -> _Flight | None:
    """The free motion: of several arcs the surest that falls, with what the others say to that.

    What bounces, or rolls off an edge, follows one law after another. All that falls in a clip does
    so alike; bends as strong that differ are no gravity's, and weaker ones may be what rolls.
    """
    arcs = _arcs(moving, scatter, area)
    if not arcs:
        return None
    whole = sum(arc.log_evidence for arc in arcs)
    telling = [arc for arc in arcs if arc.log_evidence > _TELLING] or arcs[:1]
    none = _mixed(telling, [arc.bends.straight for arc in telling])
    likely = [_if_falls_as(arc, telling) for arc in telling]
    upright = float(np.sum(likely))
    falls = upright / max(upright + none, np.finfo(float).tiny)
    falls = float(np.clip(falls, 1.0 - _MOST_CERTAIN, _MOST_CERTAIN))
    best = telling[int(np.argmax(likely))]
    if falls > 0.5:
        alike = [
            arc for arc in telling if _as(arc, best) > max(arc.bends.straight, arc.bends.other)
        ]
        best = max([*alike, best], key=lambda arc: arc.log_evidence)
    else:
        best = arcs[0]
    return replace(best, log_evidence=whole, falls=falls, held=_if_held(telling))


def _if_held(arcs: list[_Flight]) -> float:
    """Probability that what does not fall is held in all arcs, as a bob is by what holds it."""
    tightest = max(arcs, key=lambda arc: arc.bends.held / max(arc.bends.straight, _UNHEARD_OF))
    turned = [arc.bends.held / _HELD * _turns_as(arc, tightest) for arc in arcs]
    held = _HELD * float(np.prod(turned))
    free = _mixed(arcs, [arc.bends.rolling for arc in arcs])
    return float(np.clip(held / max(held + free, np.finfo(float).tiny), 0.0, _MOST_CERTAIN))


def _turns_as(arc: _Flight, other: _Flight) -> float:
    """How likely an arc turns across its way as on a circle of the radius of another one's."""
    if arc is other:
        return 1.0
    across, own = _across(arc)
    there, theirs = _across(other)
    expected = there * (own / theirs) ** 2
    spread = (
        arc.acceleration_std,
        other.acceleration_std * (own / theirs) ** 2,
        _SAME_FALL * expected,
    )
    return math.exp(-0.5 * ((across - expected) / float(np.hypot.reduce(spread))) ** 2)


def _across(arc: _Flight) -> tuple[float, float]:
    """Acceleration across the mean course towards the side that faces up, and the mean speed."""
    course = arc.velocity + 0.5 * (arc.last - arc.first) * arc.acceleration
    speed = max(float(np.hypot(*course)), 1e-9)
    return _inwards(arc.acceleration, course / speed), speed


def _inwards(acceleration: FloatArray, course: FloatArray) -> float:
    """Part of an acceleration across a course of unit length, towards the side that faces up."""
    across = float(acceleration[0] * course[1] - acceleration[1] * course[0])
    return across * (float(np.sign(course[0])) or 1.0)


def _if_falls_as(arc: _Flight, arcs: list[_Flight]) -> float:
    """Likelihood of all arcs where one of them falls: the others fall alike, roll, or are bent."""
    others = [one for one in arcs if one is not arc]
    alike = [_FALLS_TOO * _as(one, arc) for one in others]
    straight = [
        same + (1.0 - _FALLS_TOO) * one.bends.straight
        for same, one in zip(alike, others, strict=True)
    ]
    # one fall that several arcs tell of is one, and counts once
    told = 1.0 + sum(
        same / (like + one.bends.other)
        for same, like, one in zip(alike, straight, others, strict=True)
    )
    return _FALLS_TOO * arc.bends.falling * _mixed(others, straight) / told


def _as(arc: _Flight, other: _Flight) -> float:
    """Likelihood of an arc's acceleration if it falls as another one does."""
    # nearer to the camera it falls faster in the picture, and is as much larger
    scale = arc.radius / other.radius
    apart = float(np.hypot(*(arc.acceleration - scale * other.acceleration)))
    alike = _SAME_FALL * float(np.hypot(*other.acceleration))
    spread = float(np.hypot(arc.acceleration_std, scale * np.hypot(other.acceleration_std, alike)))
    return float((arc.acceleration_std / spread) ** 2 * np.exp(-0.5 * (apart / spread) ** 2))


def _mixed(arcs: list[_Flight], straight: list[float]) -> float:
    """Likelihood of arcs that are `straight` so likely, where any may be bent otherwise instead.

    How often that is, is as unknown as a beta distribution makes it: the first is rare, more of
    them are not; and what bends one bends another about as much.
    """
    if not arcs:
        return 1.0
    size = np.log([max(float(np.hypot(*arc.acceleration)), 1e-12) for arc in arcs])
    weight = [
        1.0 - min(like / (like + arc.bends.other), 1.0)
        for like, arc in zip(straight, arcs, strict=True)
    ]
    usual = float(np.average(size, weights=np.maximum(weight, 1e-9)))
    gain = np.log(_FASTEST_FALL / _SLOWEST_FALL) / (_BENT_ALIKE * np.sqrt(2.0 * np.pi))
    apart, together = np.ones(1), np.ones(1)
    for arc, like, own in zip(arcs, straight, size, strict=True):
        near = gain * np.exp(-0.5 * ((own - usual) / _BENT_ALIKE) ** 2)
        apart = np.convolve(apart, [like, arc.bends.other])
        together = np.convolve(together, [like, arc.bends.other * near])
    # how strongly the first is bent, nobody foretells, and another thing may bend the next
    ways = apart
    ways[2:] = np.maximum(apart[2:], together[2:] / gain)
    many = np.arange(len(ways))
    odds = scipy.special.beta(_BENT + many, _NOT_BENT + len(arcs) - many)
    return float(ways @ odds / scipy.special.beta(_BENT, _NOT_BENT))


def _arcs(moving: Track, scatter: float, area: float) -> list[_Flight]:
    """The stretches that one law each explains, surest first, taken out one after the other."""
    radius = float(np.median(moving.radius_px))
    left, found = [moving], list[_Flight]()
    while left and len(found) < _MOST_ARCS:
        piece = left.pop(0)
        stretch = lawful_stretch(piece.frame, piece.centre_px, radius)
        if stretch.evidence <= 0.0:
            continue
        first, last = _extended(piece, stretch, scatter)
        ends = int(piece.frame[first] > moving.frame[0]) + int(piece.frame[last] < moving.frame[-1])
        rows = np.arange(len(piece))
        inside = piece.where((rows >= first) & (rows <= last))
        found.append(_arc(inside, scatter, area, len(moving), ends))
        rest = (rows < first, rows > last)
        left += [piece.where(side) for side in rest if np.count_nonzero(side) >= _FEWEST]
    return found


def _extended(piece: Track, stretch: LawfulStretch, scatter: float) -> tuple[int, int]:
    """First and last row to which the law of a stretch goes on."""
    inside = (piece.frame >= stretch.first) & (piece.frame <= stretch.last)
    time = (piece.frame - stretch.first).astype(np.float64)
    law = np.polyfit(time[inside], piece.centre_px[inside], 2)
    near = np.hypot(*(piece.centre_px - np.vander(time, 3) @ law).T) < _OFF_LAW * scatter
    first, last = int(np.argmax(inside)), len(inside) - 1 - int(np.argmax(inside[::-1]))
    while first > 0 and near[first - 1]:
        first -= 1
    while last < len(near) - 1 and near[last + 1]:
        last += 1
    return first, last


def _arc(seen: Track, scatter: float, area: float, frames: int, ends: int) -> _Flight:
    """The law of a stretch, with so many ends that might be elsewhere on the path."""
    time = (seen.frame - seen.frame[0]).astype(np.float64)
    place = seen.centre_px
    powers = np.column_stack([np.ones_like(time), time, 0.5 * time * time])
    motion = np.linalg.lstsq(powers, place, rcond=None)[0]
    left = place - powers @ motion
    std = _acceleration_std(seen, powers, left)
    radius = float(np.median(seen.radius_px))
    off = np.hypot(*left.T)
    left_over = max(float(np.sqrt(np.mean(off**2))), _LEAST_STD_PX)
    fits = _log_evidence(off, scatter, area, 6, frames)
    if np.mean(off < _OFF_LAW * scatter) < _WHOLE:
        # pieces of several motions, or of none
        fits = 0.0
    return _Flight(
        int(seen.frame[0]),
        int(seen.frame[-1]),
        max(0.0, fits - ends * float(np.log(frames))),
        motion[1],
        motion[2],
        std,
        radius,
        _bend(motion[2], std, _Way(place[-1] - place[0], float(time[-1]), left_over), radius),
    )


def _acceleration_std(track: Track, powers: FloatArray, left: FloatArray) -> float:
    """Standard uncertainty of an acceleration (px per frame²) by its residuals and by the lens."""
    stated = np.sqrt(0.5 * np.median(np.trace(track.covariance_px2, axis1=1, axis2=2)))
    random = _scattered(powers, left, max(float(stated), _LEAST_STD_PX))
    return float(np.hypot(random, _lens_acceleration(track.centre_px, powers)))


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


@dataclass(frozen=True)
class _Way:
    """Where a stretch leads: its chord (2,), its frames, and what a parabola leaves of it, px."""

    chord: FloatArray
    frames: float
    left: float

    def off_arc(self, sizes: FloatArray) -> FloatArray:
        """What a parabola would leave of an arc of such centripetal accelerations, px."""
        speed = max(float(np.hypot(*self.chord)) / self.frames, 1e-9)
        return _ARC_LESS_PARABOLA * (0.5 * self.frames) ** 3 * sizes**2 / speed


def _bend(acceleration: FloatArray, std: float, way: _Way, radius: float) -> _Bend:
    """How likely an acceleration (2,), px per frame², is of what falls, rolls or is bent otherwise.

    Its size is anything that gravity may look like, log-evenly; the direction of what falls is any,
    or down, or, where it goes up and down, that of its way; what rolls is braked or sped up along
    its way; what is held from above, as a bob is, turns upwards, along an arc and no parabola, and
    gravity speeds it up or brakes it along its way by anything.
    """
    size = float(np.hypot(*acceleration))
    course = way.chord / max(float(np.hypot(*way.chord)), 1e-9)
    along = float(acceleration @ course)
    across = _inwards(acceleration, course)
    low, high = _SLOWEST_FALL * radius, _FASTEST_FALL * radius
    near = np.clip(size + std * np.linspace(-8.0, 8.0, _SIZES), low, high)
    sizes = np.unique(np.concatenate([np.geomspace(low, high, _SIZES), near]))
    share = np.gradient(np.log(sizes)) / np.log(high / low)

    def like(off: FloatArray | float, spread: FloatArray | float = std) -> FloatArray:
        return np.asarray(np.exp(-0.5 * (np.asarray(off) / spread) ** 2))

    # an average over all directions: exp(x cos φ) over the circle is I0(x)
    anywhere = share @ (like(sizes - size) * scipy.special.ive(0, sizes * size / std**2))
    leaning = np.hypot(std, _UPRIGHT * sizes)
    under = share @ (like(sizes - acceleration[1]) * like(acceleration[0], leaning) * std / leaning)
    sped_up = float(like(across)) * float(share @ like(sizes - along))
    braked = float(like(across)) * float(share @ like(sizes + along))
    # a way that is plumb is what falls straight; what rolls goes in any direction
    tilt = float(np.arctan2(abs(course[0]), abs(course[1])))
    plumb = float(like(tilt, _UPRIGHT)) * np.sqrt(0.5 * np.pi) / _UPRIGHT
    falling = _ANY * anywhere + _UNDER * under + _PLUMB * plumb * 0.5 * (sped_up + braked)
    rolling = _EVENLY * float(like(size)) + _BRAKED * braked + _DOWNHILL * sped_up
    # towards the side of its way that faces up: half of all directions
    above = 2.0 * scipy.special.ndtr(across / std)
    pulled = like(sizes - size) * scipy.special.ive(0, sizes * size / std**2)
    turned = like(way.off_arc(sizes * abs(across) / max(size, 1e-12)), way.left)
    held = _HELD * float(above * (share @ (pulled * turned)))
    return _Bend(float(falling), float(rolling), held, max(float(anywhere), _UNHEARD_OF))


def _swing_log_evidence(ball: Track, scatter: float, area: float) -> float:
    swing = fit_oscillation(ball.frame.astype(np.float64), ball.centre_px, scatter)
    if swing is None:
        return 0.0
    if np.mean(swing.residual_px < _OFF_LAW * scatter) < _WHOLE:
        return 0.0
    return _log_evidence(swing.residual_px, scatter, area, PARAMETERS, len(ball))


def _straight_log_evidence(moving: Track, scatter: float, area: float) -> float:
    """What rolls or slides goes straight on at an even speed; so does a little of any swing."""
    time = (moving.frame - moving.frame[0]).astype(np.float64)
    powers = np.column_stack([np.ones_like(time), time])
    motion = np.linalg.lstsq(powers, moving.centre_px, rcond=None)[0]
    residual = np.hypot(*(moving.centre_px - powers @ motion).T)
    return _log_evidence(residual, scatter, area, 4, len(moving))


def _still_log_evidence(moving: Track, scatter: float, area: float) -> float:
    """What lies still, is put elsewhere and lies there, a few frames in between left aside."""
    away = np.full(len(moving), np.inf)
    best = 0.0
    for place in range(1, _MOST_RESTS + 1):
        left = moving.centre_px[away > _OFF_LAW * scatter]
        if len(left) < _LEAST_REST:
            break
        about = np.hypot(*(moving.centre_px - np.median(left, axis=0)).T)
        away = np.minimum(away, about)
        # two of place, and when it was put there
        told = _log_evidence(away, scatter, area, 3 * place - 1, len(moving))
        best = max(best, told)
    return best


def _log_evidence(
    residual: FloatArray, scatter: float, area: float, parameters: int, frames: int
) -> float:
    """Log evidence of an explanation of some of so many frames, nats."""
    gain = np.log(area / (2 * np.pi * scatter**2)) - 0.5 * (residual / scatter) ** 2
    gain = np.maximum(gain, np.log(_STRAY))
    share = min(1.0, _MOST_INDEPENDENT / frames)
    count = max(len(gain) * share, 1.0)
    return max(0.0, float(gain.sum()) * share - 0.5 * parameters * float(np.log(count)))


def _exchanged(
    ball: Track, rest_frames: tuple[int, int] | None, striker: Track | None
) -> float | None:
    """Probability that what came to a ball at rest struck it; None where nothing came.

    What it lost of its velocity then is what the ball gained, over the ratio of their masses; two
    ends of one body, or a thing that passes before the ball, lose nothing.
    """
    if rest_frames is None or striker is None:
        return None
    left = rest_frames[1]
    before = _mean_velocity(striker, left - _BLOW_FRAMES, left - 1)
    after = _mean_velocity(striker, left + 1, left + _BLOW_FRAMES)
    gained = _mean_velocity(ball, left + 1, left + _BLOW_FRAMES)
    if before is None or after is None or gained is None:
        return _UNSEEN_BLOW
    stds = [before[1], after[1], gained[1], _STEADY_SHARE * float(np.hypot(*before[0]))]
    spread = float(np.hypot.reduce(stds))
    lost = before[0] - after[0]
    ratios = np.exp(_MASS_RATIO * np.linspace(-4.0, 4.0, 161))
    apart = np.hypot(*(lost[:, None] - ratios * gained[0][:, None]))
    weight = np.exp(-0.5 * (np.log(ratios) / _MASS_RATIO) ** 2)
    struck = float(weight @ np.exp(-0.5 * (apart / spread) ** 2) / weight.sum())
    passed = float(np.exp(-0.5 * (np.hypot(*lost) / spread) ** 2))
    tiny = np.finfo(float).tiny
    share = (struck + tiny) / (struck + passed + 2.0 * tiny)
    return float(np.clip(share, 1.0 - _MOST_CERTAIN, _MOST_CERTAIN))


def _mean_velocity(track: Track, first: int, last: int) -> tuple[FloatArray, float] | None:
    """Velocity (2,) over some frames with its standard uncertainty, px per frame."""
    rows = (track.frame >= first) & (track.frame <= last)
    if np.count_nonzero(rows) < _FEWEST - 1:
        return None
    time = track.frame[rows] - track.frame[rows].mean()
    place = track.centre_px[rows]
    velocity = time @ place / (time @ time)
    left = place - place.mean(axis=0) - time[:, None] * velocity
    scatter = float(np.sqrt((left**2).sum() / (2.0 * (len(time) - 2))))
    return velocity, max(scatter, _LEAST_STD_PX) / float(np.sqrt(time @ time))


def _beginnings(
    flight: _Flight,
    rest_frames: tuple[int, int] | None,
    met: float | None,
    struck: float,
) -> list[tuple[MotionKind, float, str]]:
    """How a free motion may have begun: kind, odds, and the reason for it.

    `met` is the probability that another ball struck it, None where none came to it; `struck` are
    the odds that a pendulum did, nought where none came to it.
    """
    falls = flight.falls
    drop = falls * _drop_odds(flight, rest_frames is not None)
    said_drop = (MotionKind.DROP, drop, "It falls straight down from rest.")
    thrown = (MotionKind.FLIGHT, falls, "It flies freely, and nothing was seen to strike it.")
    if rest_frames is None:
        return [thrown, said_drop]
    if met is not None:
        return [
            (MotionKind.COLLISION, met, "Another ball met it while it lay still, and slowed down."),
            (MotionKind.STRIKE, 0.01, "It lay still and left."),
        ]
    # What is struck flies at once; what is let go, or carried off first, does not.
    late = flight.first - rest_frames[1] > max(
        _AT_ONCE, _AT_ONCE_SHARE * (flight.last - flight.first)
    )
    if struck > 0.0 and not late:
        return [
            (MotionKind.STRIKE, struck, "It lay still, a pendulum met it, and it flew."),
            thrown,
        ]
    odds = falls / _UNSEEN_STRIKER_ODDS if late else falls * _UNSEEN_STRIKER_ODDS
    return [(MotionKind.STRIKE, odds, "It lay still and left at once."), thrown, said_drop]


def _struck_odds(pendulum: bool, sure: bool) -> float:
    """Odds that a pendulum struck what left as it came."""
    if not pendulum:
        return 0.0
    return _PENDULUM_ODDS if sure else _UNSURE_PENDULUM_ODDS


def _drop_odds(flight: _Flight, from_rest: bool) -> float:
    """Odds of a drop against a throw."""
    span = float(flight.last - flight.first)
    size = float(np.hypot(*flight.acceleration))
    if size == 0.0:
        return 1.0 / _DROP_ODDS
    down = flight.acceleration / size
    along = float(flight.velocity @ down) * span + 0.5 * size * span**2
    across = abs(float(flight.velocity[0] * down[1] - flight.velocity[1] * down[0])) * span
    upwards = float(flight.velocity @ down) < -0.05 * size * span
    if upwards or across > _DROP_SIDEWAYS * along:
        return 1.0 / _DROP_ODDS
    begins = float(np.hypot(*flight.velocity)) < _BEGINS_AT_REST * size * span
    return _DROP_ODDS if from_rest or begins else _DROP_ODDS / 3.0
