"""Best division of a track into segments of motion models (dynamic programming)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from vision.motions.models import FloatArray, IntArray, Observations, Polynomials

__all__ = [
    "Division",
    "Event",
    "EventKind",
    "Model",
    "Segment",
    "Span",
    "contact_between",
    "divide",
    "events_between",
    "falls",
    "segment_of",
    "straight",
]

MAX_KNOTS = 130
"""Rows at which a segment may begin; half of them even, half where the velocity changes most.
Chosen: the time grows with its square, and boundaries are refined to the row afterwards."""

_BREAK_COST = 4.0
"""Cost of each further segment, in addition to its parameters: about one break in 50 rows. Chosen;
insensitive between 2 and 8 (bench/motion_kinds.py)."""

_OTHER_COST = 1.5
"""Cost of a row for a free parabola where a hypothesis has no model. Chosen between 1 (the cost
a row of a true model with unit noise: a free parabola would always win) and 3."""


class Model(StrEnum):
    """How a segment moves."""

    REST = "rest"
    LINE = "line"
    PARABOLA = "parabola"
    FALL = "free fall"
    SLOPE = "straight, constant acceleration"
    SWING = "swing"
    CIRCLE = "circle"
    CARRIED = "carried"


class EventKind(StrEnum):
    """What happens between two segments."""

    RELEASE = "release"
    CONTACT = "contact"
    BOUNCE = "bounce"
    LANDING = "landing"
    TURN = "turning point"
    STOP = "stop"
    CHANGE = "change"


@dataclass(frozen=True)
class Segment:
    """A stretch that one model explains.

    Attributes
    ----------
    first, last : int
        Frames.
    parameters : (k, 2) array
        Polynomial coefficients in frames from `first`, px (constant, velocity, half the
        acceleration); of a swing or circle centre, across, along and, if fitted, drift.
    covariance : (k, k) array
        Of one coordinate's coefficients, the same for both.
    period : float
        Frames, of a swing or circle; else NaN.
    amplitude : float
        rad, at the first frame of a swing; else NaN.
    damping : float
        1 / frame.
    """

    model: Model
    first: int
    last: int
    parameters: FloatArray
    covariance: FloatArray
    period: float = math.nan
    period_std: float = math.nan
    amplitude: float = math.nan
    damping: float = math.nan

    def at(self, frame: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration of a polynomial segment at a frame."""
        time = frame - self.first
        rows = np.zeros((3, 2))
        rows[: len(self.parameters)] = self.parameters[:3]
        return (
            rows[0] + time * (rows[1] + time * rows[2]),
            rows[1] + 2.0 * time * rows[2],
            2 * rows[2],
        )

    def spread(self, frame: float) -> tuple[float, float]:
        """Standard uncertainties of one coordinate's position and velocity at a frame."""
        time, size = frame - self.first, len(self.covariance)
        at = np.array([1.0, time, time * time])[:size]
        rate = np.array([0.0, 1.0, 2.0 * time])[:size]
        return (
            math.sqrt(max(float(at @ self.covariance @ at), 0.0)),
            math.sqrt(max(float(rate @ self.covariance @ rate), 0.0)),
        )


@dataclass(frozen=True)
class Event:
    """What happens, when, with its standard uncertainty in frames."""

    kind: EventKind
    frame: float
    std: float


@dataclass(frozen=True)
class Span:
    """Rows [first, stop) with the model that explains them."""

    model: Model
    first: int
    stop: int


@dataclass(frozen=True)
class Division:
    """A track divided: its spans, and its cost in natural logarithms."""

    spans: tuple[Span, ...]
    cost: float


@dataclass(frozen=True)
class _Choice:
    """A model that may explain a span: coordinates with the polynomial order of each."""

    model: Model
    coordinates: tuple[tuple[FloatArray, int], ...]
    min_rows: int
    row_cost: float = 0.0

    @property
    def parameters(self) -> int:
        return sum(order + 1 for _, order in self.coordinates)


def _choices(seen: Observations, models: Sequence[Model]) -> list[_Choice]:
    x, y = seen.place.T
    orders = {Model.REST: (0, 2), Model.LINE: (1, 3), Model.PARABOLA: (2, 4)}
    return [
        _Choice(model, ((x, orders[model][0]), (y, orders[model][0])), orders[model][1])
        for model in models
    ]


def falls(seen: Observations, gravity: FloatArray) -> list[_Choice]:
    """Rest, free fall with one acceleration (px per frame²), and a free parabola at a cost."""
    time = seen.frame - seen.frame.mean()
    fallen = seen.place - 0.5 * np.outer(time**2, gravity)
    x, y = seen.place.T
    return [
        *_choices(seen, [Model.REST]),
        _Choice(Model.FALL, ((fallen[:, 0], 1), (fallen[:, 1], 1)), 3),
        _Choice(Model.CARRIED, ((x, 2), (y, 2)), 4, _OTHER_COST),
    ]


def straight(seen: Observations, along: FloatArray, across: FloatArray) -> list[_Choice]:
    """Rest, constant acceleration along one line, and a free parabola at a cost."""
    x, y = seen.place.T
    return [
        *_choices(seen, [Model.REST]),
        _Choice(Model.SLOPE, ((along, 2), (across, -1)), 3),
        _Choice(Model.CARRIED, ((x, 2), (y, 2)), 4, _OTHER_COST),
    ]


def divide(
    seen: Observations,
    sums: Polynomials,
    choices: Sequence[_Choice] | Sequence[Model],
    worth: float = 1.0,
) -> Division:
    """Divide a track into the spans of least cost.

    Parameters
    ----------
    sums : Polynomials
        Of the same rows.
    choices : sequence of Model, or what `falls` and `straight` return
        Models that may explain a span.
    worth : float
        Independent rows for each row, 0 to 1.
    """
    listed = [one for one in choices if isinstance(one, _Choice)]
    listed += _choices(seen, [one for one in choices if isinstance(one, Model)])
    pricing = _Pricing(sums, listed, len(seen), worth)
    knots = _knots(seen, sums.noise)
    first, stop = np.triu_indices(len(knots), 1)
    cost, model = pricing.least(knots[first], knots[stop])
    size = len(knots)
    table, which = np.full((size, size), np.inf), np.zeros((size, size), dtype=np.int64)
    table[first, stop], which[first, stop] = cost, model
    best, before = np.full(size, np.inf), np.zeros(size, dtype=np.int64)
    best[0] = 0.0
    for index in range(1, size):
        total = best[:index] + table[:index, index]
        before[index] = int(np.argmin(total))
        best[index] = total[before[index]]
    bounds = [size - 1]
    while bounds[-1] > 0:
        bounds.append(int(before[bounds[-1]]))
    rows = knots[bounds[::-1]]
    if len(knots) <= len(seen):
        rows = _refined(rows, knots, pricing)
    cost, model = pricing.least(rows[:-1], rows[1:])
    spans = [
        Span(listed[which].model, int(start), int(end))
        for which, start, end in zip(model, rows[:-1], rows[1:], strict=True)
    ]
    return Division(tuple(spans), float(cost.sum()) - _BREAK_COST)


class _Pricing:
    """Cost of spans under each of several models."""

    def __init__(self, sums: Polynomials, choices: list[_Choice], rows: int, worth: float) -> None:
        self._sums, self._choices, self._worth = sums, choices, worth
        self._moments = [[sums.moments(values) for values, _ in one.coordinates] for one in choices]
        self._parameter = 0.5 * math.log(max(2.0 * rows * worth, 2.0))

    def least(self, first: IntArray, stop: IntArray) -> tuple[FloatArray, IntArray]:
        """Least cost of each span and the model that has it."""
        rows = stop - first
        runs, costs = self._sums.runs(first, stop), []
        for one, moments in zip(self._choices, self._moments, strict=True):
            squares = np.zeros(len(first))
            for (_, order), moment in zip(one.coordinates, moments, strict=True):
                squares = squares + runs.squares(moment, order)
            cost = self._worth * (self._sums.misfit(squares, first, stop) + one.row_cost * rows)
            cost = cost + self._parameter * one.parameters + _BREAK_COST
            # too short for its parameters: allowed at the cost of an unexplained row each
            costs.append(np.where(rows >= one.min_rows, cost, cost + 8.0 * rows))
        table = np.stack(costs)
        model = np.argmin(table, axis=0)
        return table[model, np.arange(len(first))], model


def _knots(seen: Observations, noise: float) -> IntArray:
    count = len(seen)
    if count < MAX_KNOTS:
        return np.arange(count + 1)
    even = np.linspace(0, count, MAX_KNOTS // 2).astype(np.int64)
    # second difference over three rows to each side
    change, place = np.zeros(count), seen.place
    change[3:-3] = np.hypot(*(place[6:] - 2.0 * place[3:-3] + place[:-6]).T)
    chosen = list[int]()
    while len(chosen) < MAX_KNOTS // 2:
        row = int(np.argmax(change))
        if change[row] <= 3.0 * noise:
            break
        chosen += [row, row + 1]
        change[max(row - 1, 0) : row + 2] = 0.0
    return np.unique(np.concatenate([even, np.array(chosen, dtype=np.int64)]))


def _refined(rows: IntArray, knots: IntArray, pricing: _Pricing) -> IntArray:
    """Boundaries moved to the row of least cost between the neighbouring knots."""
    rows = rows.copy()
    for index in range(1, len(rows) - 1):
        place = int(np.searchsorted(knots, rows[index]))
        low = max(int(knots[max(place - 1, 0)]), int(rows[index - 1]) + 1)
        high = min(int(knots[min(place + 1, len(knots) - 1)]), int(rows[index + 1]) - 1)
        trial = np.arange(low, high + 1)
        if len(trial) > 1:
            first = np.concatenate([np.full(len(trial), rows[index - 1]), trial])
            stop = np.concatenate([trial, np.full(len(trial), rows[index + 1])])
            cost, _ = pricing.least(first, stop)
            rows[index] = trial[int(np.argmin(cost[: len(trial)] + cost[len(trial) :]))]
    return rows


_ORDER = {Model.REST: 0, Model.LINE: 1}


def segment_of(seen: Observations, span: Span, noise: float, worth: float = 1.0) -> Segment:
    """The polynomial of a span with its covariance."""
    rows = seen.rows(slice(span.first, span.stop))
    order = min(_ORDER.get(span.model, 2), max(len(rows) - 1, 0))
    time = rows.frame - rows.frame[0]
    unit = max(float(time[-1]), 1.0)
    design = np.vander(time / unit, order + 1, increasing=True)
    weight = np.median(rows.std) / rows.std
    found = np.linalg.lstsq(design * weight[:, None], rows.place * weight[:, None], rcond=None)[0]
    left = (rows.place - design @ found) * weight[:, None]
    spare = max(2 * (len(rows) - order - 1), 1)
    variance = max(float((left**2).sum()) / spare, noise**2) / worth
    scale = unit ** -np.arange(order + 1, dtype=np.float64)
    normal = (design * weight[:, None]).T @ (design * weight[:, None])
    covariance = np.linalg.pinv(normal) * variance * np.outer(scale, scale)
    return Segment(
        span.model,
        int(rows.frame[0]),
        int(rows.frame[-1]),
        found * scale[:, None],
        covariance,
    )


def events_between(segments: Sequence[Segment], down: FloatArray | None) -> tuple[Event, ...]:
    """What happens at each boundary of polynomial segments, and where a segment turns round."""
    found = list[Event]()
    for index, segment in enumerate(segments):
        if index:
            before = segments[index - 1]
            whole = {before.model, segment.model} & {Model.SWING, Model.CIRCLE}
            found.append(_let_go(before, segment) if whole else _met(before, segment, down))
        turn = _turned(segment)
        if turn is not None:
            found.append(turn)
    return tuple(found)


def contact_between(rest: Segment, motion: Segment) -> Event:
    """When a body at rest was struck: where its motion, carried back, leaves the place of rest.

    A contact that lasts for several frames lies about this frame; the gap between the two segments
    adds to the uncertainty.
    """
    found = _met(rest, motion, None)
    gap = max(motion.first - rest.last - 1, 0)
    # uniform over the gap
    return Event(EventKind.CONTACT, found.frame, math.hypot(found.std, 0.29 * gap))


def _let_go(before: Segment, after: Segment) -> Event:
    """Release of a swing, or its end, somewhere between the two segments."""
    kind = EventKind.RELEASE if before.model is Model.REST else EventKind.STOP
    kind = kind if Model.REST in (before.model, after.model) else EventKind.CHANGE
    gap = max(after.first - before.last, 1)
    # uniform over the gap, and a frame until the bob has left its extreme visibly
    return Event(kind, 0.5 * (before.last + after.first), 0.29 * gap + 1.0)


def _met(before: Segment, after: Segment, down: FloatArray | None) -> Event:
    """The event at which two segments are nearest to each other."""
    low, high = before.last - 1.5, after.first + 1.5
    trial = np.linspace(low, high, 81)
    apart = np.array([np.hypot(*(after.at(one)[0] - before.at(one)[0])) for one in trial])
    frame = float(trial[int(np.argmin(apart))])
    (_, slow, pull), (_, fast, push) = before.at(frame), after.at(frame)
    change = float(np.hypot(*(fast - slow)))
    place_std = math.hypot(before.spread(frame)[0], after.spread(frame)[0])
    speed_std = math.hypot(before.spread(frame)[1], after.spread(frame)[1])
    gap = max(after.first - before.last, 1)
    bend = float(np.hypot(*(push - pull)))
    std = min(place_std / max(change, 1e-9), speed_std / max(bend, 1e-9) + 0.5, 0.29 * gap + 3.0)
    return Event(_named(before, after, frame, down), frame, max(std, 0.01))


def _named(before: Segment, after: Segment, frame: float, down: FloatArray | None) -> EventKind:
    slow, fast = before.at(frame)[1], after.at(frame)[1]
    if before.model is Model.REST:
        noise = 4.0 * after.spread(frame)[1]
        _, _, push = after.at(frame)
        gained = float(np.hypot(*push)) * 2.0
        sudden = float(np.hypot(*fast)) > noise + gained
        return EventKind.CONTACT if sudden else EventKind.RELEASE
    if after.model is Model.REST:
        return EventKind.STOP
    if down is not None and float(np.hypot(*down)) > 0.0:
        unit = down / np.hypot(*down)
        if slow @ unit > 0.0 and fast @ unit < 0.5 * slow @ unit:
            return EventKind.BOUNCE if fast @ unit < 0.0 else EventKind.LANDING
    if before.model is Model.CARRIED:
        return EventKind.RELEASE
    return EventKind.CHANGE


def _turned(segment: Segment) -> Event | None:
    """Where a segment's motion along its acceleration comes to a stop and turns round."""
    if len(segment.parameters) < 3 or segment.model in (Model.SWING, Model.CIRCLE):
        return None
    _, speed, pull = segment.at(segment.first)
    size = float(pull @ pull)
    if size <= 0.0:
        return None
    frame = segment.first - float(speed @ pull) / size
    if not segment.first < frame < segment.last:
        return None
    return Event(EventKind.TURN, frame, segment.spread(frame)[1] / math.sqrt(size))
