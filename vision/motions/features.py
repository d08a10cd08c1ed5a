"""Features of a track, or a pair, from which its kind of motion is estimated."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from metrology.kept import KeptResults
from vision.motions.explanations import MIN_ROWS, Explained, explain
from vision.motions.models import DISCREPANCY, FloatArray, Observations
from vision.motions.segments import Division, Model, Segment, Span, segment_of

__all__ = ["FEATURES", "MIN_TRACK_ROWS", "departure_of", "features_of"]

FEATURES = (
    "one",
    "straight_cost",
    "swing_cost",
    "circle_cost",
    "fall_misfit",
    "circle_misfit",
    "moved_radius",
    "swing_hangs",
    "fall_share",
    "fall_sag",
    "fall_down",
    "fall_oblique",
    "fall_from_rest",
    "fall_rest_before",
    "fall_sideways",
    "fall_upwards",
    "fall_bounces",
    "fall_breaks",
    "straight_share",
    "straight_upright",
    "straight_sudden",
    "straight_breaks",
    "path_straight",
    "path_bow",
    "path_turns",
    "path_jump",
    "path_back",
    "pull_down",
    "parts",
    "rows",
    "pair",
    "pair_near",
    "pair_transfer",
    "pair_arc",
    "pair_straight",
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


MIN_TRACK_ROWS = 8
"""Rows from which a kind is stated. Given by the fit: no track that it has seen has fewer."""


def features_of(
    ball: Observations, striker: Observations | None = None, kept: KeptResults | None = None
) -> tuple[FloatArray, "Explained | None", "Explained | None"]:
    """Features of a track or a pair, in the order of `FEATURES`, and the fits behind them."""
    if len(ball) < MIN_TRACK_ROWS:
        return np.eye(len(FEATURES))[0], None, None
    one = explain(ball)
    values = {"one": 1.0, "rows": math.log(len(one.seen) / 100.0)}
    values["parts"] = math.log(len(one.free.spans))
    values |= _costs(one) | _shapes(one) | _falling(one) | _sliding(one) | _course(one)
    other = None
    if striker is not None and len(striker) >= MIN_ROWS:
        kept = kept or KeptResults()
        other = kept.once("striker's motion", striker, lambda: explain(striker))
        values |= _pair(one, other)
    return np.array([values.get(name, 0.0) for name in FEATURES]), one, other


def _costs(one: Explained) -> dict[str, float]:
    cost = one.costs
    least = min(value for name, value in cost.items() if name != "free")
    return {
        f"{name}_cost": _log_odds(cost[name], least) for name in ("straight", "swing", "circle")
    }


def _shapes(one: Explained) -> dict[str, float]:
    inner = one.seen.rows(one.core)
    extent = max(float(np.hypot(*np.ptp(inner.place, axis=0))), 1e-6)
    found = {
        "moved_radius": _level(extent, one.seen.radius),
        "fall_misfit": _relative(_spread(_left_by(one, one.fall)), one.noise, extent),
    }
    if one.swing is not None:
        off = _relative(_spread(one.swing.residual), one.noise, extent)
        hangs = one.swing.hangs * min(one.swing.amplitude, 1.0)
        found["swing_hangs"] = _sigmoid(off - 2.0) * hangs
    if one.circle is not None:
        found["circle_misfit"] = _relative(_spread(one.circle.residual), one.noise, extent)
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
    joints = [
        _turns_up(one, before, after, down)
        for before, after in pairwise(spans)
        if before.model is Model.FALL and after.model is Model.FALL
    ]
    bounces = sum(joints)
    return {
        "fall_share": sure,
        "fall_sag": _level(sag, one.seen.radius),
        "fall_down": sure * float(down[1]),
        # cameras stand upright or lie on their side, slopes are between
        "fall_oblique": sure * 2.0 * abs(float(down[0] * down[1])),
        "fall_from_rest": sure * math.exp(-early / (0.15 * frames + 1.0)),
        "fall_rest_before": sure * rest,
        "fall_sideways": sure * min(abs(across) * frames / max(path, 1e-9), 2.0),
        "fall_upwards": sure * min(max(-along - 2.0 * spread, 0.0) / (pull * frames), 1.0),
        "fall_bounces": sure * min(bounces, 3),
        "fall_breaks": math.log1p(len(joints) - bounces),
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
    slopes = [span for span in spans if span.model is Model.SLOPE]
    share = sum(span.stop - span.first for span in slopes) / max(moved, 1)
    segment = segment_of(one.seen, spans[index], one.noise, one.worth)
    frames = max(float(segment.last - segment.first), 1.0)
    start, pull = segment.parameters[1:2], segment.parameters[2:3]
    if len(pull) == 0:
        return {"straight_share": share}
    speed, gained = float(np.hypot(*start[0])), 2.0 * frames * float(np.hypot(*pull[0]))
    rest = _rest_before(one, one.slope, index)
    noise = segment.spread(segment.first)[1]
    sudden = max(speed - 3.0 * noise, 0.0) / max(speed + 0.3 * gained, 1e-9)
    return {
        "straight_share": share,
        "straight_upright": share * abs(float(one.direction[1])) ** 4,
        "straight_sudden": share * rest * sudden,
        "straight_breaks": math.log(len(slopes)),
    }


def _course(one: Explained) -> dict[str, float]:
    """Form of the path, how often it turns round, how suddenly its velocity changes."""
    place = one.seen.rows(one.core).place
    extent = max(float(np.hypot(*np.ptp(place, axis=0))), 1e-6)
    off = place - place.mean(axis=0)
    unit = np.linalg.svd(off, full_matrices=False)[2][0]
    along, across = off @ unit, off @ np.array([-unit[1], unit[0]])
    design = np.vander(along / extent, 3, increasing=True)
    bent = np.linalg.lstsq(design, across, rcond=None)[0]
    left = np.column_stack([across - design @ bent, np.zeros(len(across))])
    turns = _turns(along, 4.0 * one.noise + 0.02 * extent)
    moves = [
        each
        for each in one.segments(one.free)
        if each.last > each.first + 2 and each.model is not Model.REST
    ]
    found = {
        "path_straight": _relative(math.sqrt(2.0) * _spread(left), one.noise, extent),
        "path_bow": _level(0.25 * abs(float(bent[2])) / extent, 0.02),
        "path_turns": math.log1p(turns),
    }
    return found | _jump(moves) | {"pull_down": _pull_down(moves)}


def _turns(along: FloatArray, least: float) -> int:
    """How often a coordinate turns round by more than a distance."""
    count, sense, extreme = 0, 0, float(along[0])
    for value in along.tolist():
        if (value - extreme) * (sense or math.copysign(1, value - extreme)) > 0.0 and sense:
            extreme = value
        elif abs(value - extreme) > least:
            count += sense != 0
            sense, extreme = (1 if value > extreme else -1), value
    return count


def _jump(moves: Sequence[Segment]) -> dict[str, float]:
    """The largest sudden change of velocity between two moving segments, over their speeds."""
    most, back = 0.0, 0.0
    for before, after in pairwise(moves):
        frame = 0.5 * (before.last + after.first)
        slow, fast = before.at(frame)[1], after.at(frame)[1]
        spread = 3.0 * math.hypot(before.spread(frame)[1], after.spread(frame)[1])
        speed = max(float(np.hypot(*slow)), float(np.hypot(*fast)), 1e-9)
        jump = max(float(np.hypot(*(fast - slow))) - spread, 0.0) / speed
        if jump > most:
            most = jump
            back = -float(slow @ fast) / max(float(np.hypot(*slow) * np.hypot(*fast)), 1e-9)
    return {"path_jump": min(most, 2.0), "path_back": min(most, 1.0) * back}


def _pull_down(moves: Sequence[Segment]) -> float:
    """How far one acceleration serves all moving segments, times its share downwards."""
    pulls, spreads, frames = list[FloatArray](), list[float](), list[float]()
    for each in moves:
        if len(each.parameters) < 3 or each.last - each.first < MIN_ROWS:
            continue
        lasts = float(each.last - each.first)
        length = float(np.hypot(*(each.at(each.last)[0] - each.at(each.first)[0])))
        # a lens bends a straight path by so much of its length
        lens = 8.0 * DISCREPANCY * length / lasts**2
        pulls.append(each.at(each.first)[2])
        spreads.append(4.0 * max(float(each.covariance[2, 2]), 0.0) + lens**2)
        frames.append(lasts)
    if not pulls:
        return 0.0
    table, spread = np.array(pulls), np.array(spreads)
    squares = (table**2).sum(axis=1)
    surest = int(np.argmax(squares / spread))
    weight = np.array(frames) / (1.0 + spread / (0.1 * squares[surest] + 1e-30))
    mean = weight @ table / weight.sum()
    size = float(np.hypot(*mean))
    even = size**2 / max(float(weight @ squares / weight.sum()), 1e-30)
    sure = even * _sigmoid(math.sqrt(float(squares[surest] / spread[surest])) - 4.0)
    return sure * float(mean[1]) / max(size, 1e-30)


def _pair(one: Explained, other: Explained) -> dict[str, float]:
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
        "pair_transfer": share * met.transfer,
        "pair_arc": share * bends,
        "pair_straight": share * (1.0 - bends),
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
