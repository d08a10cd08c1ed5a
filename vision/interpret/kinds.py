"""Which kind of motion a track, or a ball with its striker, shows, with a calibrated probability.

Every explanation of the whole track (free fall with bounces, straight path, swing, circle, carried)
is fitted and has a cost in nats; what the costs and a few ratios of the fits are worth as a
probability was fitted to tracks with truth by `training/fit_motion_kinds.py`.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache
from importlib import resources

import numpy as np

from vision.interpret.explanations import MIN_ROWS, Explained
from vision.interpret.features import FEATURES, features_of
from vision.interpret.models import FloatArray, Observations, Swing
from vision.interpret.segments import (
    Event,
    Model,
    Segment,
    contact_between,
    events_between,
    segment_of,
)

__all__ = ["Interpretation", "Kind", "interpret"]


class Kind(StrEnum):
    """Kinds of motion, by the names of the results."""

    STRIKE = "strike"
    FLIGHT = "flight"
    DROP = "drop"
    SWING = "swing"
    COLLISION = "collision"
    BOUNCE = "bounce"
    ROLL = "roll"
    SLIDE = "slide"
    CIRCLE = "circle"
    CARRIED = "carried"
    NONE = "none"


@dataclass(frozen=True)
class Interpretation:
    """What happens to a tracked object.

    Attributes
    ----------
    kind : Kind
        The most probable one.
    probabilities : mapping of Kind to float
        Of all kinds; sum 1.
    segments : tuple of Segment
        Of the explanation that belongs to the kind.
    events : tuple of Event
        Between the segments and within them, in time order.
    reasons : tuple of str
        Why, in whole sentences.
    frames : (2,) tuple of int or None
        First and last frame of the motion itself: the free fall from release to first bounce, the
        swing, the roll; from rest to the end of the free motion for a strike and a collision.
    rest : (2,) tuple of int or None
        First and last frame at rest before it moves.
    gravity_px : (2,) tuple of float or None
        Acceleration shared by all free falls, px per frame²; None where it falls not.
    noise_px : float
        Standard deviation of the track's noise.
    noise_correlation : float
        Between neighbouring rows.
    costs : mapping of str to float
        Of each explanation, nats; the difference of two is their log odds before calibration.
    """

    kind: Kind
    probabilities: Mapping[Kind, float]
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
def _coefficients() -> tuple[tuple[Kind, ...], FloatArray]:
    """Kinds and their coefficients (kinds, features), fitted by training/fit_motion_kinds.py."""
    text = resources.files("vision.interpret").joinpath("motion_kinds.json").read_text("utf-8")
    data = json.loads(text)
    kinds = tuple(Kind(name) for name in data["coefficients"])
    rows = [[data["coefficients"][kind][name][0] for name in FEATURES] for kind in kinds]
    return kinds, np.array(rows)


def probabilities_of(values: FloatArray) -> dict[Kind, float]:
    """Probability of each kind from features."""
    kinds, coefficients = _coefficients()
    score = coefficients @ values
    share = np.exp(score - score.max())
    share /= share.sum()
    found = dict.fromkeys(Kind, 0.0)
    found.update(zip(kinds, share.tolist(), strict=True))
    return found


def interpret(
    ball: Observations, striker: Observations | None = None, rolls: float = 1.0
) -> Interpretation:
    """Which kind of motion a track shows, or a ball with the one that may have struck it.

    Parameters
    ----------
    ball : Observations
        What is measured.
    striker : Observations, optional
        What came to it: a pendulum's mass, another ball.
    rolls : float
        Probability that it rolls where it may roll or slide, from its appearance; a track of the
        centre does not distinguish them.

    Returns
    -------
    Interpretation
    """
    values, one, other = features_of(ball, striker)
    if one is None:
        shares = dict.fromkeys(Kind, 0.0) | {Kind.NONE: 1.0}
        reason = f"It is seen in {len(ball)} frames only; {MIN_ROWS} are needed to fit a motion."
        return Interpretation(Kind.NONE, shares, (), (), (reason,), None, None, None, math.nan, 0.0)
    shares = probabilities_of(values)
    shares[Kind.ROLL], shares[Kind.SLIDE] = (
        shares[Kind.ROLL] * rolls,
        shares[Kind.ROLL] * (1.0 - rolls),
    )
    kind = max(shares, key=lambda name: shares[name])
    segments, down = _segments(one, kind)
    events = list(events_between(segments, down)) if kind is not Kind.CIRCLE else []
    main = _main(kind, segments)
    rests = [each for each in segments if each.model is Model.REST]
    rests = [each for each in rests if main is not None and each.last < main.first]
    if kind in _STRUCK and main is not None and rests:
        late = [event for event in events if event.frame > main.first + 1]
        events = [contact_between(rests[-1], main), *late]
    features = dict(zip(FEATURES, values.tolist(), strict=True))
    falls_at_all = features["fall_share"] > 0.5 and kind in _FALLING
    return Interpretation(
        kind,
        shares,
        segments,
        tuple(sorted(events, key=lambda event: event.frame)),
        _reasons(one, other, kind, features, segments),
        _frames(kind, segments, main),
        (rests[0].first, rests[-1].last) if rests else None,
        (float(one.gravity[0]), float(one.gravity[1])) if falls_at_all else None,
        one.noise,
        one.alike,
        one.costs,
    )


_FALLING = (Kind.STRIKE, Kind.FLIGHT, Kind.DROP, Kind.BOUNCE)
_STRUCK = (Kind.STRIKE, Kind.COLLISION)


def _segments(one: Explained, kind: Kind) -> tuple[tuple[Segment, ...], FloatArray | None]:
    """Segments of the explanation that belongs to a kind, and which way things fall."""
    if kind in _FALLING:
        return one.segments(one.fall), one.gravity
    if kind in (Kind.ROLL, Kind.SLIDE, Kind.COLLISION):
        return one.segments(one.slope), None
    whole = one.swing if kind is Kind.SWING else one.circle if kind is Kind.CIRCLE else None
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


def _main(kind: Kind, segments: tuple[Segment, ...]) -> Segment | None:
    """The segment that gives a kind its name: the first at least half as long as the longest."""
    model = Model.FALL if kind in _FALLING else Model.SLOPE
    moves = [each for each in segments if each.model is not Model.REST]
    named = [each for each in moves if each.model is model] or moves
    longest = max((each.last - each.first for each in named), default=0)
    if kind in (Kind.ROLL, Kind.SLIDE):
        return next((each for each in named if each.last - each.first == longest), None)
    return next((each for each in named if 2 * (each.last - each.first) >= longest), None)


def _frames(
    kind: Kind, segments: tuple[Segment, ...], main: Segment | None
) -> tuple[int, int] | None:
    """Frames of the motion itself."""
    if main is None or kind is Kind.NONE:
        return None
    if kind in _STRUCK:
        return segments[0].first, main.last
    if kind in _FALLING or kind in (Kind.ROLL, Kind.SLIDE):
        return main.first, main.last
    moves = [each for each in segments if each.model is not Model.REST]
    return moves[0].first, moves[-1].last


def _reasons(
    one: Explained,
    other: Explained | None,
    kind: Kind,
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
    if kind is Kind.DROP:
        found.append("It falls straight from rest.")
    elif kind is Kind.FLIGHT:
        found.append("It was already moving when the free flight began.")
    elif kind is Kind.BOUNCE:
        found.append("It bounces, and how it was released is not in view.")
    elif kind is Kind.SWING and one.swing is not None:
        found.append(
            f"A pendulum's swing with a period of {one.swing.period:.5g} ± "
            f"{one.swing.period_std:.2g} frames, {one.swing.periods:.2g} periods in view ({noise})."
        )
    elif kind is Kind.CIRCLE and one.circle is not None:
        found.append(
            f"A turn at constant rate, {one.circle.period:.4g} frames a turn, axes 1 to"
            f" {one.circle.ratio:.2f}."
        )
    elif kind in (Kind.ROLL, Kind.SLIDE):
        found.append(f"It moves along one straight line at constant acceleration ({noise}).")
    elif kind is Kind.CARRIED:
        found.append("No motion model explains it better than a smooth path of any shape.")
    elif kind is Kind.NONE:
        found.append(f"No motion beyond the noise of {one.noise:.2g} px and drift.")
    if kind in (Kind.STRIKE, Kind.COLLISION):
        met = features["pair_approach"] > 0.5
        what = "a pendulum" if kind is Kind.STRIKE else "another body"
        found.append(
            f"It was at rest and left when {what} reached it."
            if met
            else "It was at rest and left within a few frames; what struck it is not seen to."
        )
    return tuple(found)
