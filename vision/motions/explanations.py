"""A track under every explanation: fall, straight path, swing, circle, hand, rest."""

import math
from dataclasses import dataclass, replace

import numpy as np

from vision.motions.models import (
    DISCREPANCY,
    MAX_ROW_COST,
    Circle,
    FloatArray,
    Observations,
    Polynomials,
    Swing,
    correlation,
    fit_circle,
    fit_swing,
    random_process_cost,
)
from vision.motions.segments import (
    Division,
    Model,
    Segment,
    divide,
    falls,
    segment_of,
    straight,
)

__all__ = ["MIN_ROWS", "Explained", "explain"]


@dataclass(frozen=True)
class Explained:
    """A track under every explanation."""

    seen: Observations
    noise: float
    alike: float
    core: slice
    free: Division
    fall: Division
    gravity: FloatArray
    slope: Division
    direction: FloatArray
    swing: Swing | None
    circle: Circle | None
    costs: dict[str, float]

    @property
    def worth(self) -> float:
        """Independent rows for each row."""
        return (1.0 - self.alike) / (1.0 + self.alike)

    def segments(self, division: Division) -> tuple[Segment, ...]:
        """Polynomials of a division."""
        return tuple(segment_of(self.seen, one, self.noise, self.worth) for one in division.spans)


_ANY = (Model.REST, Model.LINE, Model.PARABOLA)

MIN_ROWS = 6
"""Rows: a parabola has three unknowns a coordinate; with fewer than twice as many nothing is left
to test it."""


def explain(seen: Observations) -> Explained:
    """Fit every explanation."""
    seen = seen.without_outliers()
    noise = seen.noise
    free = _divided_by_likelihood(seen, noise)
    core = _core(seen, free, noise)
    swing = fit_swing(seen.rows(core), noise)
    left = residual_of(seen, free)
    if swing is not None and _typical(swing.residual) < _typical(left):
        left = swing.residual
    alike = correlation(left)
    # errors that change slowly are no motion: their size counts, and fewer rows are independent
    noise = max(noise, min(_typical(left), _NOISE_FACTORS[-1] * noise))
    worth = (1.0 - alike) / (1.0 + alike)
    sums = Polynomials(seen, noise)
    free = divide(seen, sums, _ANY, worth)
    fall, gravity = _best_fall(seen, sums, free, worth)
    slope, direction = _best_slope(seen, sums, free, core, worth)
    inner = seen.rows(core)
    circle = fit_circle(inner)
    outside = _cost_outside(free, core, sums, worth)
    costs = {
        "free": free.cost,
        "fall": fall.cost,
        "straight": slope.cost,
        "swing": _whole_cost(inner, swing, noise, worth, 10) + outside,
        "circle": _whole_cost(inner, circle, noise, worth, 12) + outside,
        "carried": worth * random_process_cost(seen, noise),
        "rest": worth * _rest_cost(seen, noise),
    }
    return Explained(
        seen, noise, alike, core, free, fall, gravity, slope, direction, swing, circle, costs
    )


_NOISE_FACTORS = (1.0, 1.8, 3.2, 6.0)
"""Slow noise over the independent one, as it is tried. Convention: even steps of a logarithm."""


def _divided_by_likelihood(seen: Observations, noise: float) -> Division:
    """The division by the size of noise for which its residuals are most likely.

    Many segments leave little noise, few leave more that is correlated: the likelihood of residuals
    as a first-order autoregression, with the cost of the segments, weighs one against the other.
    """
    best: tuple[float, Division] | None = None
    for factor in _NOISE_FACTORS:
        division = divide(seen, Polynomials(seen, factor * noise), _ANY)
        left = residual_of(seen, division)
        alike = correlation(left)
        variance = max(_typical(left) ** 2 * (1.0 - alike**2), (0.5 * noise) ** 2)
        numbers = sum(_NUMBERS[one.model] for one in division.spans)
        cost = len(seen) * math.log(variance) + 0.5 * numbers * math.log(2.0 * len(seen))
        if best is None or cost < best[0] - 1e-6:
            best = cost, division
    assert best is not None
    return best[1]


_NUMBERS = {Model.REST: 3, Model.LINE: 5, Model.PARABOLA: 7}
"""Parameters of a segment and of where it begins."""


def _typical(residual: FloatArray) -> float:
    """Standard deviation by the median."""
    return 1.4826 * float(np.median(np.abs(residual)))


def residual_of(seen: Observations, division: Division) -> FloatArray:
    left = np.zeros_like(seen.place)
    for one in division.spans:
        rows = slice(one.first, one.stop)
        segment = segment_of(seen, one, 1.0)
        time = seen.frame[rows] - seen.frame[one.first]
        powers = np.vander(time, len(segment.parameters), increasing=True)
        left[rows] = seen.place[rows] - powers @ segment.parameters
    return left


_STAYS = 0.02
"""Of the extent: what is held by a hand before it is let go moves less. Chosen; insensitive between
0.01 and 0.04."""


def _core(seen: Observations, free: Division, noise: float) -> slice:
    """Rows from the first to the last that are not at rest, nor near where it began or ended."""
    moves = [one for one in free.spans if one.model is not Model.REST]
    if not moves:
        return slice(0, len(seen))
    extent = np.hypot(
        *(np.percentile(seen.place, 95, axis=0) - np.percentile(seen.place, 5, axis=0))
    )
    near = max(4.0 * noise, _STAYS * float(extent))
    ends = []
    for place in (seen.place, seen.place[::-1]):
        away = np.hypot(*(place - np.median(place[:3], axis=0)).T) > near
        ends.append(max(int(np.argmax(away)) - 1, 0) if away.any() else 0)
    # where the division found the rest itself its end is sharper
    first = moves[0].first or ends[0]
    stop = moves[-1].stop if moves[-1].stop < len(seen) else len(seen) - ends[1]
    return slice(first, stop) if stop - first >= MIN_ROWS else slice(0, len(seen))


def _best_fall(
    seen: Observations, sums: Polynomials, free: Division, worth: float
) -> tuple[Division, FloatArray]:
    """The division into falls with one acceleration, of least cost over candidates for it."""
    candidates = list[tuple[float, FloatArray]]()
    for one in free.spans:
        if one.stop - one.first < 4:
            continue
        segment = segment_of(seen, replace(one, model=Model.PARABOLA), sums.noise)
        std = 2.0 * math.sqrt(max(float(segment.covariance[2, 2]), 1e-30))
        pull = 2.0 * segment.parameters[2]
        candidates.append((float(np.hypot(*pull)) / std, pull))
    candidates.sort(key=lambda one: -one[0])
    best: tuple[Division, FloatArray] | None = None
    tried = list[FloatArray]()
    for _, gravity in candidates[:6]:
        if any(np.hypot(*(gravity - known)) < 0.1 * np.hypot(*known) for known in tried):
            continue
        tried.append(gravity)
        division = divide(seen, sums, falls(seen, gravity), worth)
        again = _shared_gravity(seen, division, gravity)
        other = divide(seen, sums, falls(seen, again), worth)
        if other.cost < division.cost:
            division, gravity = other, again
        if best is None or division.cost < best[0].cost:
            best = division, gravity
        if len(tried) >= 2:
            break
    if best is None:
        return divide(seen, sums, falls(seen, np.zeros(2)), worth), np.zeros(2)
    return best


def _shared_gravity(seen: Observations, division: Division, default: FloatArray) -> FloatArray:
    """Least-squares acceleration common to all falls of a division."""
    top, bottom = np.zeros(2), 0.0
    for one in division.spans:
        if one.model is not Model.FALL or one.stop - one.first < 4:
            continue
        time = seen.frame[one.first : one.stop] - seen.frame[one.first]
        line = np.vander(time, 2)
        half = 0.5 * time**2
        bent = half - line @ np.linalg.lstsq(line, half, rcond=None)[0]
        top += bent @ seen.place[one.first : one.stop]
        bottom += float(bent @ bent)
    return top / bottom if bottom > 0.0 else default


def _best_slope(
    seen: Observations, sums: Polynomials, free: Division, core: slice, worth: float
) -> tuple[Division, FloatArray]:
    """The division into motions along one straight line."""
    moves = [one for one in free.spans if one.model is not Model.REST]
    pieces = [core]
    if moves:
        longest = max(moves, key=lambda one: one.stop - one.first)
        pieces.append(slice(longest.first, longest.stop))
    best: tuple[Division, FloatArray] | None = None
    for rows in pieces:
        place = seen.place[rows]
        middle = np.median(place, axis=0)
        direction = np.linalg.svd(place - place.mean(axis=0), full_matrices=False)[2][0]
        normal = np.array([-direction[1], direction[0]])
        along, across = (seen.place - middle) @ direction, (seen.place - middle) @ normal
        across = across - _bowed(along, across, rows)
        division = divide(seen, sums, straight(seen, along, across), worth)
        if best is None or division.cost < best[0].cost:
            best = division, direction
    assert best is not None
    return best


_BOW = 0.015
"""Sagitta of a straight path over its length that a lens may make of it. Derived: twice that of k1
of -0.03 along the edge of the picture, where distortion bends most."""


def _bowed(along: FloatArray, across: FloatArray, rows: slice) -> FloatArray:
    """The line through some rows, bent by no more than a lens bends it."""
    length = max(float(np.ptp(along[rows])), 1e-6)
    unit = along / length

    def line(values: FloatArray) -> FloatArray:
        design = np.vander(unit, 2)
        return np.asarray(design @ np.linalg.lstsq(design[rows], values[rows], rcond=None)[0])

    if len(unit[rows]) < MIN_ROWS:
        return line(across)
    bent = unit**2 - line(unit**2)
    left = across - line(across)
    bow = float(bent[rows] @ left[rows]) / max(float(bent[rows] @ bent[rows]), 1e-12)
    most = 4.0 * _BOW * length
    return np.asarray(line(across) + float(np.clip(bow, -most, most)) * bent)


def _whole_cost(
    seen: Observations, fitted: Swing | Circle | None, noise: float, worth: float, parameters: int
) -> float:
    """Cost of one model for all rows, as natural logarithm."""
    if fitted is None:
        return 1e6
    squares = (fitted.residual**2).sum(axis=1)
    return worth * _misfit(squares, seen, noise) + 0.5 * parameters * math.log(
        max(2.0 * len(seen) * worth, 2.0)
    )


def _misfit(squares: FloatArray, seen: Observations, noise: float) -> float:
    length = float(np.hypot(*np.ptp(seen.place, axis=0)))
    most = 1.0 + (DISCREPANCY * length / noise) ** 2
    # the median of squares of two coordinates is 1.386 variances
    wider = float(np.clip(np.median(squares) / 1.386 / noise**2, 1.0, most))
    each = np.minimum(0.5 * squares / (noise**2 * wider), MAX_ROW_COST)
    return float(each.sum()) + len(seen) * math.log(wider)


def _rest_cost(seen: Observations, noise: float) -> float:
    off = seen.place - np.median(seen.place, axis=0)
    return float(0.5 * (off**2).sum() / noise**2) + math.log(2.0 * len(seen))


def _cost_outside(free: Division, core: slice, sums: Polynomials, worth: float) -> float:
    """Cost of the rests before and after the motion."""
    cost = 0.0
    for first, stop in ((0, core.start), (core.stop, len(sums.time))):
        if stop - first < 2:
            continue
        ends = np.array([first]), np.array([stop])
        squares = np.zeros(1)
        for axis in range(2):
            squares += sums.runs(*ends).squares(sums.moments(sums.place[:, axis]), 0)
        rest = min(float(sums.misfit(squares, *ends)[0]), MAX_ROW_COST * (stop - first))
        cost += worth * rest + math.log(2.0 * len(sums.time)) + 4.0
    return cost
