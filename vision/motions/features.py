"""Features of a track, or a pair, from which its kind of motion is estimated."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vision.motions.explanations import MIN_ROWS, Explained, explain
from vision.motions.models import DISCREPANCY, FloatArray, Observations
from vision.motions.segments import Division, Model, Span, segment_of

__all__ = ["FEATURES", "departure_of", "features_of"]

FEATURES = (
    "one",
    "fall_cost",
    "straight_cost",
    "swing_cost",
    "circle_cost",
    "carried_cost",
    "rest_cost",
    "fall_misfit",
    "straight_misfit",
    "swing_misfit",
    "circle_misfit",
    "moved_noise",
    "moved_radius",
    "swing_periods",
    "swing_hangs",
    "circle_round",
    "fall_share",
    "fall_sag",
    "fall_down",
    "fall_from_rest",
    "fall_rest_before",
    "fall_sudden",
    "fall_sideways",
    "fall_upwards",
    "fall_bounces",
    "straight_share",
    "straight_upright",
    "straight_speeds_up",
    "straight_rest_before",
    "straight_sudden",
    "straight_begins",
    "rows",
    "pair",
    "pair_near",
    "pair_approach",
    "pair_transfer",
    "pair_arc",
    "pair_straight",
    "pair_falls",
)
"""What the probability is computed from, in the order of the fitted coefficients."""


def _log_odds(cost: float, least: float) -> float:
    """Difference of two costs, compressed: 3 gives 0.7, 300 gives 4.6."""
    return -math.log1p(max(cost - least, 0.0) / 3.0)


def _level(value: float, scale: float) -> float:
    """A non-negative size, compressed."""
    return math.log1p(max(value, 0.0) / scale)


def _sigmoid(value: float) -> float:
    return 0.5 * (1.0 + math.tanh(0.5 * value))


def features_of(
    ball: Observations, striker: Observations | None = None
) -> tuple[FloatArray, "Explained | None", "Explained | None"]:
    """Features of a track or a pair, in the order of `FEATURES`, and the fits behind them."""
    if len(ball) < MIN_ROWS:
        return np.eye(len(FEATURES))[0], None, None
    one = explain(ball)
    values = {"one": 1.0, "rows": math.log(len(one.seen) / 100.0)}
    values |= _costs(one) | _shapes(one) | _falling(one) | _sliding(one)
    other = None
    if striker is not None and len(striker) >= MIN_ROWS:
        other = explain(striker)
        values |= _pair(one, other, values)
    return np.array([values.get(name, 0.0) for name in FEATURES]), one, other


def _costs(one: Explained) -> dict[str, float]:
    cost = one.costs
    least = min(value for name, value in cost.items() if name != "free")
    names = ("fall", "straight", "swing", "circle", "carried", "rest")
    return {f"{name}_cost": _log_odds(cost[name], least) for name in names}


def _shapes(one: Explained) -> dict[str, float]:
    inner = one.seen.rows(one.core)
    extent = max(float(np.hypot(*np.ptp(inner.place, axis=0))), 1e-6)
    found = {
        "moved_noise": _level(extent, 5.0 * one.noise) / 2.0,
        "moved_radius": _level(extent, one.seen.radius),
        "fall_misfit": _relative(_spread(_left_by(one, one.fall)), one.noise, extent),
        "straight_misfit": _relative(_spread(_left_by(one, one.slope)), one.noise, extent),
    }
    if one.swing is not None:
        off = _relative(_spread(one.swing.residual), one.noise, extent)
        good = _sigmoid(off - 2.0)
        found |= {
            "swing_misfit": off,
            "swing_periods": good * min(one.swing.periods, 4.0) ** 0.5,
            "swing_hangs": good * one.swing.hangs * min(one.swing.amplitude, 1.0),
        }
    if one.circle is not None:
        off = _relative(_spread(one.circle.residual), one.noise, extent)
        turned = min(one.circle.turned / (2.0 * math.pi), 1.0)
        found |= {
            "circle_misfit": off,
            "circle_round": _sigmoid(off - 2.0) * turned * one.circle.ratio**0.5,
        }
    return found


def _spread(residual: FloatArray) -> float:
    """Root mean square without the worst twentieth, px."""
    squares = np.sort((residual**2).sum(axis=1))
    return math.sqrt(0.5 * float(np.mean(squares[: max(int(0.95 * len(squares)), 1)])))


def _relative(spread: float, noise: float, extent: float) -> float:
    """How small what a model leaves is beside the extent, 0 (all of it) to about 6."""
    beyond = math.sqrt(max(spread**2 - noise**2, 0.0)) + 0.002 * extent
    return math.log(max(extent / beyond, 1.0))


def _left_by(one: Explained, division: Division) -> FloatArray:
    """What the model of a division leaves; a stretch it has no model for counts as at rest."""
    seen, left = one.seen, np.zeros_like(one.seen.place)
    for span in division.spans:
        rows = slice(span.first, span.stop)
        time = seen.frame[rows] - seen.frame[span.first]
        place = seen.place[rows]
        if span.model is Model.FALL:
            place = place - 0.5 * np.outer(time**2, one.gravity)
            design = np.vander(time, min(2, len(time)), increasing=True)
        elif span.model is Model.SLOPE:
            design = np.vander(time, min(3, len(time)), increasing=True)
        else:
            design = np.ones((len(time), 1))
        left[rows] = place - design @ np.linalg.lstsq(design, place, rcond=None)[0]
    return left


def _rest_before(one: Explained, division: Division, index: int) -> bool:
    """Whether a motion follows a rest, or a contact that moves the body by less than its size."""
    before = division.spans[:index]
    if len(before) >= 2 and before[-1].model is Model.CARRIED:
        push = one.seen.place[before[-1].first : before[-1].stop]
        if np.hypot(*(push[-1] - push[0])) < 2.0 * one.seen.radius:
            before = before[:-1]
    return bool(before) and before[-1].model is Model.REST


def _first_move(spans: Sequence[Span], model: Model) -> int | None:
    """Index of the longest span of a model, or of the first that is half as long."""
    lengths = [one.stop - one.first if one.model is model else 0 for one in spans]
    if not lengths or max(lengths) == 0:
        return None
    return next(index for index, size in enumerate(lengths) if 2 * size >= max(lengths))


def _falling(one: Explained) -> dict[str, float]:
    """How the free fall begins, and what share of the motion it is."""
    spans = one.fall.spans
    index = _first_move(spans, Model.FALL)
    pull = float(np.hypot(*one.gravity))
    if index is None or pull <= 0.0:
        return {}
    down = one.gravity / pull
    falling = [span for span in spans if span.model is Model.FALL]
    moved = sum(span.stop - span.first for span in spans if span.model is not Model.REST)
    share = sum(span.stop - span.first for span in falling) / max(moved, 1)
    longest = max(one.seen.frame[span.stop - 1] - one.seen.frame[span.first] for span in falling)
    span = spans[index]
    segment = segment_of(one.seen, span, one.noise, one.worth)
    frames = max(float(segment.last - segment.first), 1.0)
    sag = 0.125 * pull * float(longest) ** 2
    start = segment.parameters[1] if len(segment.parameters) > 1 else np.zeros(2)
    spread = segment.spread(segment.first)[1]
    along, across = float(start @ down), float(start @ np.array([-down[1], down[0]]))
    path = abs(along) * frames + 0.5 * pull * frames**2
    speed = float(np.hypot(*start))
    rest = _rest_before(one, one.fall, index)
    # frames it would have fallen from rest to be as fast, beside those that it is seen to fall
    early = max(speed - 2.0 * spread, 0.0) / pull
    sure = _sigmoid(4.0 * math.log(max(sag, 1e-9) / (4.0 * one.noise))) * share
    bounces = sum(
        1
        for before, after in pairwise(spans)
        if before.model is Model.FALL
        and after.model is Model.FALL
        and _turns_up(one, before, after, down)
    )
    return {
        "fall_share": sure,
        "fall_sag": _level(sag, one.seen.radius),
        "fall_down": sure * float(down[1]),
        "fall_from_rest": sure * math.exp(-early / (0.15 * frames + 1.0)),
        "fall_rest_before": sure * rest,
        "fall_sudden": sure * rest * _sigmoid(1.5 * (early - 3.0)),
        "fall_sideways": sure * min(abs(across) * frames / max(path, 1e-9), 2.0),
        "fall_upwards": sure * min(max(-along - 2.0 * spread, 0.0) / (pull * frames), 1.0),
        "fall_bounces": sure * min(bounces, 3),
    }


def _turns_up(one: Explained, before: Span, after: Span, down: FloatArray) -> bool:
    first = segment_of(one.seen, before, one.noise)
    second = segment_of(one.seen, after, one.noise)
    frame = 0.5 * (first.last + second.first)
    return bool(first.at(frame)[1] @ down > 0.0 > second.at(frame)[1] @ down)


def _sliding(one: Explained) -> dict[str, float]:
    """How the straight motion begins and goes on."""
    spans = one.slope.spans
    index = _first_move(spans, Model.SLOPE)
    if index is None:
        return {}
    moved = sum(span.stop - span.first for span in spans if span.model is not Model.REST)
    share = sum(span.stop - span.first for span in spans if span.model is Model.SLOPE) / max(
        moved, 1
    )
    segment = segment_of(one.seen, spans[index], one.noise, one.worth)
    frames = max(float(segment.last - segment.first), 1.0)
    start, pull = segment.parameters[1:2], segment.parameters[2:3]
    if len(pull) == 0:
        return {"straight_share": share}
    speed, gained = float(np.hypot(*start[0])), 2.0 * frames * float(np.hypot(*pull[0]))
    sense = 1.0 if float(start[0] @ pull[0]) >= 0.0 else -1.0
    rest = _rest_before(one, one.slope, index)
    noise = segment.spread(segment.first)[1]
    sudden = max(speed - 3.0 * noise, 0.0) / max(speed + 0.3 * gained, 1e-9)
    return {
        "straight_share": share,
        "straight_upright": share * abs(float(one.direction[1])) ** 4,
        "straight_speeds_up": share * sense * gained / max(speed + gained, 1e-9),
        "straight_rest_before": share * rest,
        "straight_sudden": share * rest * sudden,
        "straight_begins": share
        * math.exp(-3.0 * max(speed - 2.0 * noise, 0.0) / max(gained, 1e-9)),
    }


def _pair(one: Explained, other: Explained, values: dict[str, float]) -> dict[str, float]:
    """How the striker and the ball met."""
    left = departure_of(one)
    if left is None:
        return {}
    met = _meeting(one, other, left)
    if met is None:
        return {}
    share = met.near * met.approach
    bends = _arc(other, left)
    return {
        "pair": 1.0,
        "pair_near": met.near,
        "pair_approach": share,
        "pair_transfer": share * met.transfer,
        "pair_arc": share * bends,
        "pair_straight": share * (1.0 - bends),
        "pair_falls": share * values.get("fall_sudden", 0.0),
    }


def departure_of(one: Explained) -> float | None:
    """Frame at which the ball leaves its rest, None where it never rests first.

    The first time that it gets farther than its radius: before, it may be disturbed in its place.
    """
    rests = [
        index
        for index, span in enumerate(one.free.spans[:-1])
        if span.model is Model.REST
        and one.free.spans[index + 1].model is not Model.REST
        and span.stop - span.first >= 3
    ]
    for index in rests:
        span = one.free.spans[index]
        still = np.median(one.seen.place[span.first : span.stop], axis=0)
        later = [other.first for other in one.free.spans[index + 1 :] if other.model is Model.REST]
        moved = one.seen.place[span.stop : later[0] if later else len(one.seen)] - still
        if index == rests[-1] or np.hypot(*moved.T).max() > one.seen.radius:
            return float(one.seen.frame[span.stop - 1])
    # a slow drift of its outline may hide the rest from the division
    return float(one.seen.frame[one.core.start - 1]) if one.core.start >= 3 else None


@dataclass(frozen=True)
class _Meeting:
    """How near the two were at departure, how fast, how much velocity passed over; 0 to 1 each."""

    near: float
    approach: float
    transfer: float


def _meeting(one: Explained, other: Explained, left: float) -> _Meeting | None:
    ball, striker = one.seen, other.seen
    reach = float(np.clip(0.03 * striker.span, 6.0, 15.0))
    steps = float(np.median(np.diff(striker.frame)))
    before = _velocity(striker, left - reach * steps, left)
    after = _velocity(striker, left + 0.3 * reach * steps, left + 1.3 * reach * steps)
    gained = _velocity(ball, left + 0.3 * reach * steps, left + 1.3 * reach * steps)
    if before is None or gained is None:
        return None
    here = np.median(ball.place[ball.frame <= left][-5:], axis=0)
    towards = here - before.place
    apart = float(np.hypot(*towards))
    # where it would be when the ball leaves, against the sizes of both
    gap = max(apart - abs(before.speed) * 0.5 * reach * steps, 0.0)
    near = _sigmoid(4.0 * (1.6 - gap / (ball.radius + striker.radius)))
    closing = float(before.velocity @ towards) / max(apart, 1e-9)
    approach = _sigmoid(2.0 * (closing / max(3.0 * before.std, 0.03 * gained.speed) - 1.5))
    if after is None:
        return _Meeting(near, approach, 0.5)
    lost = before.velocity - after.velocity
    unit = gained.velocity / max(gained.speed, 1e-9)
    given = float(lost @ unit)
    spread = 2.0 * math.hypot(before.std, after.std) + 0.05 * before.speed
    return _Meeting(near, approach, _sigmoid(2.0 * (given / spread - 1.0)))


@dataclass(frozen=True)
class _Velocity:
    place: FloatArray
    velocity: FloatArray
    std: float

    @property
    def speed(self) -> float:
        return float(np.hypot(*self.velocity))


def _velocity(seen: Observations, first: float, last: float) -> _Velocity | None:
    """Mean position and velocity between two frames."""
    rows = (seen.frame >= first - 1e-9) & (seen.frame <= last + 1e-9)
    if np.count_nonzero(rows) < 3:
        return None
    time = seen.frame[rows] - seen.frame[rows].mean()
    place = seen.place[rows]
    velocity = time @ place / (time @ time)
    std = max(float(np.median(seen.std)), seen.noise) / math.sqrt(float(time @ time))
    return _Velocity(place.mean(axis=0), velocity, std)


def _arc(other: Explained, left: float) -> float:
    """How surely the striker goes on an arc that bends upwards before it strikes, 0 to 1."""
    rows = other.seen.frame <= left
    if np.count_nonzero(rows) < MIN_ROWS:
        return 0.5
    seen = other.seen.rows(rows)
    span = Span(Model.PARABOLA, 0, len(seen))
    segment = segment_of(seen, span, other.noise, other.worth)
    frames = float(segment.last - segment.first)
    _, velocity, pull = segment.at(segment.first + 0.5 * frames)
    speed = float(np.hypot(*velocity))
    if speed <= 0.0 or len(segment.covariance) < 3:
        return 0.5
    normal = np.array([velocity[1], -velocity[0]]) / speed
    normal = normal if normal[1] < 0.0 else -normal
    bend = 0.125 * frames**2 * float(pull @ normal)
    std = 0.25 * frames**2 * math.sqrt(max(float(segment.covariance[2, 2]), 0.0))
    spread = math.hypot(3.0 * std, DISCREPANCY * speed * frames)
    return _sigmoid(2.0 * (bend / spread - 1.5))
