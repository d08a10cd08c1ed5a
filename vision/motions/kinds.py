"""Kind of motion of a track, or of a ball with its striker, with its probability.

Every explanation of the whole track (free fall with bounces, straight path, swing, circle, carried)
is fitted and has a cost, minus its log likelihood; what the costs and a few ratios of the fits mean
as a probability was fitted to tracks with truth by `training/fit_motion_kinds.py`.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources

import numpy as np

from metrology.kept import KeptResults
from vision.blow import blow_weights
from vision.motions.explanations import MIN_ROWS, Explained
from vision.motions.features import FEATURES, MIN_TRACK_ROWS, departure_of, features_of
from vision.motions.models import DISCREPANCY, FloatArray, Observations, Swing
from vision.motions.segments import (
    Event,
    Model,
    Segment,
    contact_between,
    events_between,
    segment_of,
)
from vision.tracks import MotionKind

__all__ = ["Interpretation", "interpret"]


@dataclass(frozen=True)
class Interpretation:
    """What happens to a tracked object.

    Attributes
    ----------
    kind : MotionKind
        The most probable one.
    probabilities : mapping of MotionKind to float
        Of all kinds; sum 1.
    segments : tuple of Segment
        Of the explanation that belongs to the kind.
    events : tuple of Event
        Between the segments and within them, in time order.
    reasons : tuple of str
        Why, in whole sentences.
    frames : (2,) tuple of int or None
        First and last frame of the motion itself: the free fall from release to first bounce, the
        swing, the roll; from the end of the rest to that of the free motion for a strike and a
        collision.
    rest : (2,) tuple of int or None
        First and last frame at rest before it moves.
    gravity_px : (2,) tuple of float or None
        Acceleration shared by all free falls, px per frame²; None where nothing falls, or its
        direction is uncertain.
    noise_px : float
        Standard deviation of the track's noise.
    noise_correlation : float
        Between neighbouring rows.
    costs : mapping of str to float
        Of each explanation; the difference of two is their log odds before calibration.
    """

    kind: MotionKind
    probabilities: Mapping[MotionKind, float]
    segments: tuple[Segment, ...]
    events: tuple[Event, ...]
    reasons: tuple[str, ...]
    frames: tuple[int, int] | None
    rest: tuple[int, int] | None
    gravity_px: tuple[float, float] | None
    noise_px: float
    noise_correlation: float
    costs: Mapping[str, float] = field(default_factory=dict)

    @property
    def probability(self) -> float:
        """Of the most probable kind."""
        return self.probabilities[self.kind]


@cache
def _coefficients() -> tuple[tuple[MotionKind, ...], FloatArray]:
    """Kinds and their coefficients (kinds, features), fitted by training/fit_motion_kinds.py."""
    text = resources.files("vision.motions").joinpath("motion_kinds.json").read_text("utf-8")
    data = json.loads(text)
    kinds = tuple(MotionKind(name) for name in data["coefficients"])
    rows = [[data["coefficients"][kind.value][name][0] for name in FEATURES] for kind in kinds]
    return kinds, np.array(rows)


def probabilities_of(values: FloatArray) -> dict[MotionKind, float]:
    """Probability of each kind from features."""
    kinds, coefficients = _coefficients()
    score = coefficients @ values
    share = np.exp(score - score.max())
    share /= share.sum()
    found = dict.fromkeys(MotionKind, 0.0)
    found.update(zip(kinds, share.tolist(), strict=True))
    return found


def interpret(
    ball: Observations,
    striker: Observations | None = None,
    *,
    hangs: bool = False,
    struck: bool = False,
    given: MotionKind | None = None,
    kept: KeptResults | None = None,
) -> Interpretation:
    """Which kind of motion a track shows, or a ball with the one that may have struck it.

    Parameters
    ----------
    ball : Observations
        What is measured.
    striker : Observations, optional
        What came to it: a pendulum's mass, another ball.
    hangs : bool
        Whether the striker is known to turn about a pivot above it, so that it is no second ball.
    struck : bool
        Whether the striker surely is a pendulum that gave the ball its speed.
    given : MotionKind, optional
        The kind to explain the track as; its probability stays that of the track.
    kept : KeptResults, optional
        Of an earlier call for the same striker.
    """
    values, one, other = features_of(ball, striker, kept)
    if one is None:
        # so few rows test no kind: each remains as probable as any other
        shares = dict.fromkeys(MotionKind, 1.0 / len(MotionKind))
        reason = f"It is seen in {len(ball)} frames only; a motion needs {MIN_TRACK_ROWS}."
        return Interpretation(
            MotionKind.NONE, shares, (), (), (reason,), None, None, None, math.nan, 0.0
        )
    shares = _beside(probabilities_of(values), hangs=hangs, struck=struck)
    if departure_of(one) is None:
        # by definition what is struck or hit was at rest
        shares = _without(shares, _STRUCK)
    elif striker is None:
        # and another ball hit it
        shares = _without(shares, (MotionKind.COLLISION,))
    kind = given or max(shares, key=lambda name: shares[name])
    segments, down = _segments(one, kind)
    events = list(events_between(segments, down)) if kind is not MotionKind.CIRCLE else []
    main = _main(kind, segments)
    rests = [each for each in segments if each.model is Model.REST]
    rests = [each for each in rests if main is not None and each.last < main.first]
    if kind in _STRUCK and main is not None and rests:
        late = [event for event in events if event.frame > main.first + 1]
        events = [contact_between(rests[-1], main), *late]
    features = dict(zip(FEATURES, values.tolist(), strict=True))
    return Interpretation(
        kind,
        shares,
        segments,
        tuple(sorted(events, key=lambda event: event.frame)),
        _reasons(one, other, kind, features, segments),
        _frames(kind, segments, main),
        (rests[0].first, rests[-1].last) if rests else None,
        _fall(one) if sum(shares[each] for each in _FALLING) > _SURE_SHARE else None,
        one.noise,
        one.alike,
        one.costs,
    )


def _beside(
    shares: Mapping[MotionKind, float], *, hangs: bool, struck: bool
) -> dict[MotionKind, float]:
    """Probabilities where the striker hangs, and so is no ball, or surely gave the blow."""
    found = dict(shares)
    if hangs:
        found[MotionKind.STRIKE] += found[MotionKind.COLLISION]
        found[MotionKind.COLLISION] = 0.0
    if struck:
        found[MotionKind.STRIKE] *= math.exp(blow_weights().strike)
    whole = sum(found.values())
    return {kind: share / whole for kind, share in found.items()}


def _without(
    shares: Mapping[MotionKind, float], kinds: tuple[MotionKind, ...]
) -> dict[MotionKind, float]:
    """Probabilities if some kinds are excluded."""
    left = 1.0 - sum(shares[kind] for kind in kinds)
    if left <= 0.0:
        return dict.fromkeys(MotionKind, 0.0) | {MotionKind.NONE: 1.0}
    return {kind: 0.0 if kind in kinds else share / left for kind, share in shares.items()}


_SURE_SIGMAS = 5.0
"""Standard deviations of an acceleration from which its direction is stated. Derived: a fifth of a
radian."""


_SURE_SHARE = 0.9
"""Probability of a free fall from which its direction is stated. Convention: one in ten errs."""


def _fall(one: Explained) -> tuple[float, float] | None:
    """Acceleration shared by all free falls, if its direction is certain."""
    information = 0.0
    for span in one.fall.spans:
        if span.model is not Model.FALL or span.stop - span.first < MIN_ROWS:
            continue
        each = segment_of(one.seen, replace(span, model=Model.PARABOLA), one.noise, one.worth)
        length = float(np.hypot(*(each.at(each.last)[0] - each.at(each.first)[0])))
        # a lens bends a straight path by so much of its length
        lens = 8.0 * DISCREPANCY * length / max(each.last - each.first, 1) ** 2
        information += 1.0 / (4.0 * float(each.covariance[2, 2]) + lens**2)
    across, down = one.gravity.tolist()
    if information <= 0.0 or math.hypot(across, down) < _SURE_SIGMAS / math.sqrt(information):
        return None
    return across, down


_FALLING = (MotionKind.STRIKE, MotionKind.FLIGHT, MotionKind.DROP, MotionKind.BOUNCE)
_STRUCK = (MotionKind.STRIKE, MotionKind.COLLISION)


def _segments(one: Explained, kind: MotionKind) -> tuple[tuple[Segment, ...], FloatArray | None]:
    """Segments of the explanation that belongs to a kind, and which way things fall."""
    if kind in _FALLING:
        return one.segments(one.fall), one.gravity
    if kind in (MotionKind.ROLL, MotionKind.SLIDE, MotionKind.COLLISION):
        return one.segments(one.slope), None
    whole = (
        one.swing if kind is MotionKind.SWING else one.circle if kind is MotionKind.CIRCLE else None
    )
    if whole is None:
        return one.segments(one.free), None
    inner = one.seen.rows(one.core)
    size = len(whole.linear)
    middle = Segment(
        Model.SWING if isinstance(whole, Swing) else Model.CIRCLE,
        int(inner.frame[0]),
        int(inner.frame[-1]),
        whole.linear,
        np.full((size, size), np.nan),
        whole.period,
    )
    if isinstance(whole, Swing):
        middle = replace(
            middle,
            period_std=whole.period_std,
            amplitude=whole.amplitude,
            damping=whole.damping,
        )
    ends = [
        span
        for span in one.free.spans
        if span.stop <= one.core.start or span.first >= one.core.stop
    ]
    outer = [segment_of(one.seen, span, one.noise, one.worth) for span in ends]
    before = [each for each in outer if each.last < middle.first]
    after = [each for each in outer if each.first > middle.last]
    return (*before, middle, *after), None


def _main(kind: MotionKind, segments: tuple[Segment, ...]) -> Segment | None:
    """The segment that gives a kind its name: the first at least half as long as the longest."""
    model = Model.FALL if kind in _FALLING else Model.SLOPE
    moves = [each for each in segments if each.model is not Model.REST]
    still = [each for each in segments if each.model is Model.REST]
    if kind in _STRUCK and still:
        # what lies still before it is struck moves after its longest rest
        rest = max(still, key=lambda each: each.last - each.first)
        moves = [each for each in moves if each.first > rest.last] or moves
    named = [each for each in moves if each.model is model] or moves
    longest = max((each.last - each.first for each in named), default=0)
    if kind in (MotionKind.ROLL, MotionKind.SLIDE):
        return next((each for each in named if each.last - each.first == longest), None)
    return next((each for each in named if 2 * (each.last - each.first) >= longest), None)


def _frames(
    kind: MotionKind, segments: tuple[Segment, ...], main: Segment | None
) -> tuple[int, int] | None:
    """Frames of the motion itself."""
    if main is None or kind is MotionKind.NONE:
        return None
    first, last = _unbroken(segments, main)
    if kind in _STRUCK:
        still = [each.last for each in segments if each.model is Model.REST and each.last < first]
        return max(still, default=first), last
    if kind in _FALLING or kind in (MotionKind.ROLL, MotionKind.SLIDE):
        return first, last
    moves = [each for each in segments if each.model is not Model.REST]
    return moves[0].first, moves[-1].last


_MAX_JUMP = 0.1
"""Of the speed: larger changes of velocity between segments are a bounce or a hit. Chosen;
insensitive between 0.05 and 0.2: drag and lens change it by less, impacts by more."""


def _unbroken(segments: tuple[Segment, ...], main: Segment) -> tuple[int, int]:
    """Frames of a segment with those that continue it: drag or a lens may break it without event.

    Continued are position and velocity, within what is known of them and a fraction of the speed;
    nothing that falls rises again without an event.
    """
    first = last = segments.index(main)
    while last + 1 < len(segments) and _continued(segments[last], segments[last + 1]):
        last += 1
    while first > 0 and _continued(segments[first - 1], segments[first]):
        first -= 1
    return segments[first].first, segments[last].last


def _continued(before: Segment, after: Segment) -> bool:
    if before.model is not after.model or before.model not in (Model.FALL, Model.SLOPE):
        return False
    frame = 0.5 * (before.last + after.first)
    (place, slow, pull), (there, fast, _) = before.at(frame), after.at(frame)
    if before.model is Model.FALL and slow @ pull > 0.0 > fast @ pull:
        return False
    speed = min(float(np.hypot(*slow)), float(np.hypot(*fast)))
    place_std = math.hypot(before.spread(frame)[0], after.spread(frame)[0])
    speed_std = math.hypot(before.spread(frame)[1], after.spread(frame)[1])
    apart, jump = float(np.hypot(*(there - place))), float(np.hypot(*(fast - slow)))
    return jump < 4.0 * speed_std + _MAX_JUMP * speed and apart < 4.0 * place_std + speed


def _reasons(
    one: Explained,
    other: Explained | None,
    kind: MotionKind,
    features: Mapping[str, float],
    segments: tuple[Segment, ...],
) -> tuple[str, ...]:
    """Why this kind, in whole sentences with numbers."""
    found = list[str]()
    noise = f"noise {one.noise:.2g} px"
    falling = [each for each in segments if each.model is Model.FALL]
    if kind in _FALLING and falling:
        rows = sum(each.last - each.first + 1 for each in falling)
        pull = float(np.hypot(*one.gravity))
        found.append(
            f"Free fall in {len(falling)} arc{'s' * (len(falling) > 1)} with one acceleration of"
            f" {pull:.3g} px per frame² in {rows} frames ({noise})."
        )
    if kind is MotionKind.DROP:
        found.append("It falls straight from rest.")
    elif kind is MotionKind.FLIGHT:
        found.append("It was already moving when the free flight began.")
    elif kind is MotionKind.BOUNCE:
        found.append("It bounces, and how it was released is not in view.")
    elif kind is MotionKind.SWING and one.swing is not None:
        found.append(
            f"A pendulum's swing with a period of {one.swing.period:.5g} ± "
            f"{one.swing.period_std:.2g} frames, {one.swing.periods:.2g} periods in view ({noise})."
        )
    elif kind is MotionKind.CIRCLE and one.circle is not None:
        found.append(
            f"A turn about a centre, {one.circle.period:.4g} frames a turn, axes 1 to"
            f" {one.circle.ratio:.2f}."
        )
    elif kind in (MotionKind.ROLL, MotionKind.SLIDE):
        found.append(f"It moves along one straight line at constant acceleration ({noise}).")
    elif kind is MotionKind.CARRIED:
        found.append("No motion model explains it better than a smooth path of any shape.")
    elif kind is MotionKind.NONE:
        found.append(f"No motion beyond the noise of {one.noise:.2g} px and drift.")
    if kind in (MotionKind.STRIKE, MotionKind.COLLISION):
        met = features["pair_arc"] + features["pair_straight"] > 0.5
        what = "a pendulum" if kind is MotionKind.STRIKE else "another body"
        found.append(
            f"It was at rest and left when {what} reached it."
            if met
            else "It was at rest and left within a few frames; what struck it is not seen to."
        )
    return tuple(found)
