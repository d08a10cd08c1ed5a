"""Motion models of part of a track: polynomial, swing, circle, random path.

Time is in frames, positions in px with y down. Every cost is minus a log
likelihood with the same constant left off (independent noise of the track's own size), so costs of
one track can be subtracted from each other.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy
from numpy.typing import NDArray

from metrology.least_squares import bounded_robust

__all__ = [
    "DISCREPANCY",
    "Observations",
    "Polynomials",
    "Swing",
    "fit_circle",
    "fit_swing",
    "random_process_cost",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

DISCREPANCY = 0.004
"""Model error per length of a segment, from lens distortion, perspective and drag.
Derived: k1 of -0.03 at the edge of the picture moves a point by 0.4 % of half its width."""

MIN_STD_PX = 0.03
"""px; convention: no outline is located better by the tracker of this project."""

MAX_ROWS = 400
"""Rows to which a swing, a circle or a random process is fitted when models are compared; a longer
track is thinned evenly. Chosen; 200 to 800 give the same kinds, the time grows in proportion."""


MAX_ROW_COST = 12.0
"""Cost of a row that belongs to something else. Derived: one row in 100 anywhere in
an area of 1,000 noise areas."""


@dataclass(frozen=True)
class Observations:
    """Where one object was seen.

    Attributes
    ----------
    frame : (n,) float array
        Increasing.
    place : (n, 2) array
        px, y down.
    std : (n,) array
        Stated standard uncertainty of each coordinate, px.
    radius : float
        Median radius, px.
    """

    frame: FloatArray
    place: FloatArray
    std: FloatArray
    radius: float

    @classmethod
    def of(
        cls, frame: IntArray, place: FloatArray, std: FloatArray | float, radius: float
    ) -> "Observations":
        """Rows sorted by frame, without those that are not finite and doubled frames."""
        times, spots = np.asarray(frame, dtype=np.float64), np.asarray(place, dtype=np.float64)
        spread = np.broadcast_to(np.asarray(std, dtype=np.float64), times.shape)
        good = np.isfinite(times) & np.isfinite(spots).all(axis=1)
        times, first = np.unique(times[good], return_index=True)
        spread = np.nan_to_num(spread[good][first], nan=1.0, posinf=1e3)
        return cls(times, spots[good][first], np.maximum(spread, MIN_STD_PX), max(radius, 0.5))

    def __len__(self) -> int:
        return len(self.frame)

    def rows(self, keep: BoolArray | IntArray | slice) -> "Observations":
        """Some of the rows."""
        return Observations(self.frame[keep], self.place[keep], self.std[keep], self.radius)

    def thinned(self, count: int = MAX_ROWS) -> "Observations":
        """At most so many rows, evenly chosen."""
        if len(self) <= count:
            return self
        return self.rows(np.unique(np.linspace(0, len(self) - 1, count).astype(np.int64)))

    @property
    def span(self) -> float:
        """Frames from first to last."""
        return float(self.frame[-1] - self.frame[0])

    @property
    def noise(self) -> float:
        """Standard deviation of the independent noise by third differences, px.

        Where the frames are sparse these hold motion, too, so the stated uncertainty limits it on
        both sides.
        """
        stated = float(np.median(self.std))
        if len(self) < 8:
            return stated
        steps = np.diff(self.frame)
        even = (np.abs(steps[:-2] - steps[1:-1]) < 0.5) & (np.abs(steps[1:-1] - steps[2:]) < 0.5)
        third = np.diff(self.place, 3, axis=0)[even]
        if len(third) < 5:
            return stated
        # 1, 3, 3, 1: variance 20; 1.4826 makes a median deviation a standard deviation
        seen = 1.4826 * float(np.median(np.abs(third))) / math.sqrt(20.0)
        return float(np.clip(seen, 0.3 * stated, 3.0 * stated))

    def without_outliers(self) -> "Observations":
        """The rows without those that stray, seen again where two stray near each other."""
        once = self.rows(self._agreeing())
        return once.rows(once._agreeing())

    def _agreeing(self) -> BoolArray:
        """Rows that at least one of three predictions from their neighbours agrees with.

        Predicted from both sides, from those before and from those after: what bounces agrees with
        one of them, an isolated wrong row with none.
        """
        count = len(self)
        if count < 7:
            return np.ones(count, dtype=bool)
        time, place = self.frame, self.place
        index = np.arange(count)

        def from_line(first: IntArray, second: IntArray) -> FloatArray:
            share = (time - time[first]) / np.maximum(time[second] - time[first], 1e-9)
            return place[first] + share[:, None] * (place[second] - place[first])

        before = from_line(np.maximum(index - 2, 0), np.maximum(index - 1, 1))
        after = from_line(np.minimum(index + 1, count - 2), np.minimum(index + 2, count - 1))
        both = from_line(np.maximum(index - 1, 0), np.minimum(index + 1, count - 1))
        off = np.stack([np.hypot(*(place - at).T) for at in (before, after, both)])
        off[0, :2], off[1, -2:], off[2, [0, -1]] = np.inf, np.inf, np.inf
        steps = np.diff(time)
        bend = np.median(np.hypot(*np.diff(place, 2, axis=0).T))
        # a bend grows with the square of the time over which a line is carried on
        gap = np.maximum(np.append(steps, 0.0), np.insert(steps, 0, 0.0)) / np.median(steps)
        noise = np.hypot(self.noise, self.std)
        good = off.min(axis=0) < 8.0 * noise + 3.0 * bend * np.minimum(gap, 5.0) ** 2
        # more than a few are no outliers but the motion itself
        return good if np.mean(good) > 0.8 else np.ones(count, dtype=bool)


class Polynomials:
    """Least-squares polynomials over any run of rows, by sums of powers kept for all rows."""

    def __init__(self, seen: Observations, noise: float) -> None:
        self.middle = 0.5 * float(seen.frame[0] + seen.frame[-1])
        self.unit = max(0.5 * seen.span, 1.0)
        self.time = (seen.frame - self.middle) / self.unit
        self.noise, self.place = noise, seen.place
        # stated uncertainties set the weights of rows, not the size of the noise
        relative = np.clip(np.median(seen.std) / seen.std, 0.2, 2.0)
        self.weight = relative**2
        powers = np.vander(self.time, 5, increasing=True) * self.weight[:, None]
        self._powers = _summed(powers)
        self._count = np.concatenate([[0], np.cumsum(np.ones(len(seen)))])

    def moments(self, values: FloatArray) -> FloatArray:
        """Sums of a coordinate times powers of time, and of its square, up to each row."""
        with_powers = np.vander(self.time, 3, increasing=True) * values[:, None]
        squares = values[:, None] ** 2
        return _summed(np.column_stack([with_powers, squares]) * self.weight[:, None])

    def runs(self, first: IntArray, stop: IntArray) -> "Runs":
        """Runs of rows [first, stop), to which polynomials are fitted."""
        powers = self._powers[stop] - self._powers[first]
        centre = powers[:, 1] / np.maximum(powers[:, 0], 1e-12)
        s0, s1, s2, s3, s4 = powers.T
        second = s2 - centre * s1
        third = s3 - 3.0 * centre * s2 + 2.0 * centre**2 * s1
        fourth = s4 - 4.0 * centre * s3 + 6.0 * centre**2 * s2 - 3.0 * centre**3 * s1
        return Runs(first, stop, centre, np.maximum(s0, 1e-12), second, third, fourth)

    def misfit(self, squares: FloatArray, first: IntArray, stop: IntArray) -> FloatArray:
        """Cost of residual squares of both coordinates over runs, as natural logarithm."""
        length = np.hypot(*(self.place[stop - 1] - self.place[first]).T)
        most = 1.0 + (DISCREPANCY * length / self.noise) ** 2
        many = self._count[stop] - self._count[first]
        # the variance that explains the residuals best, between noise and noise with model error
        wider = np.clip(0.5 * squares / (many * self.noise**2), 1.0, most)
        return np.asarray(0.5 * squares / (self.noise**2 * wider) + many * np.log(wider))


def _summed(rows: FloatArray) -> FloatArray:
    return np.concatenate([np.zeros((1, rows.shape[1])), np.cumsum(rows, axis=0)])


@dataclass(frozen=True)
class Runs:
    """Runs of rows with the sums of powers of time about the mean time of each."""

    first: IntArray
    stop: IntArray
    centre: FloatArray
    count: FloatArray
    second: FloatArray
    third: FloatArray
    fourth: FloatArray

    def squares(self, moments: FloatArray, order: int) -> FloatArray:
        """Residual sums of squares about polynomials of an order (-1: none) of each run.

        By projection on powers of time made orthogonal to the lower ones.
        """
        zeroth, first, second, left = (moments[self.stop] - moments[self.first]).T
        if order >= 0:
            left = left - zeroth**2 / self.count
        if order >= 1:
            slope = first - self.centre * zeroth
            spread = np.maximum(self.second, 1e-18)
            left = left - slope**2 / spread
        if order >= 2:
            bent = second - 2.0 * self.centre * first + self.centre**2 * zeroth
            bent = bent - self.second / self.count * zeroth - self.third / spread * slope
            norm = self.fourth - self.second**2 / self.count - self.third**2 / spread
            # as large as rounding: no bend can be determined
            some = norm > 1e-10 * self.fourth + 1e-20
            left = left - np.where(some, bent**2 / np.where(some, norm, 1.0), 0.0)
        return np.asarray(np.maximum(left, 0.0))


@dataclass(frozen=True)
class Swing:
    """A pendulum seen by any camera, or (amplitude 0) a turn at constant rate.

    Position is `centre` + `drift` (t - t0) + `across` sin θ + `along` (1 - cos θ), with θ the angle
    of a pendulum whose amplitude decays exponentially.

    Attributes
    ----------
    period, period_std : float
        Mean from the first to the last passage through the lowest point, frames.
    amplitude : float
        At the first frame, rad.
    damping : float
        Of the amplitude, 1 / frame.
    phase : float
        At the first frame, rad.
    linear : (k, 2) array
        Centre, across, along, drift, px.
    residual : (n, 2) array
        px.
    periods : float
        In view.
    covariance : (4, 4) array
        Of log frequency, phase, log amplitude, damping times span.
    """

    period: float
    period_std: float
    amplitude: float
    damping: float
    phase: float
    linear: FloatArray
    residual: FloatArray
    periods: float
    covariance: FloatArray

    @property
    def hangs(self) -> float:
        """Fraction of the arm that points down the picture, -1 to 1."""
        arm = -self.linear[2]
        return float(arm[1] / max(float(np.hypot(*arm)), 1e-9))


_MAX_AMPLITUDE = math.radians(150.0)
"""Beyond it a pendulum's motion is that of a body thrown about its pivot, seldom filmed."""


@cache
def _decay_of_amplitude() -> tuple[FloatArray, FloatArray]:
    """Amplitudes (rad) and the decay (damping times time) by which they differ.

    Friction takes 2 c of the mean square of the rate from the energy 1 - cos A, so that
    dA / dt = -8 c (E / K - 1 + m) / sin A with m = sin² (A / 2); for small swings -c A.
    """
    sizes = np.geomspace(1e-4, _MAX_AMPLITUDE, 2000)
    modulus = np.sin(0.5 * sizes) ** 2
    ratio = scipy.special.ellipe(modulus) / scipy.special.ellipk(modulus) - 1.0 + modulus
    # below 0.01 rad the difference of near numbers loses its digits, and the limit holds
    slope = np.where(sizes < 0.01, 1.0 / sizes, np.sin(sizes) / (8.0 * ratio))
    steps = 0.5 * (slope[1:] + slope[:-1]) * np.diff(sizes)
    return sizes, np.concatenate([[0.0], np.cumsum(steps)])


def _angle(values: FloatArray, time: FloatArray, span: float) -> tuple[FloatArray, FloatArray]:
    """Angle of a damped pendulum (slow decay) and its phase."""
    frequency, phase, log_amplitude, decay = values
    start = min(math.exp(log_amplitude), _MAX_AMPLITUDE)
    sizes, decays = _decay_of_amplitude()
    size = np.interp(np.interp(start, sizes, decays) - decay * time / span, decays, sizes)
    modulus = np.sin(0.5 * size) ** 2
    quarter = scipy.special.ellipk(modulus)
    # the frequency grows as the amplitude decays; `frequency` is its mean over the stretch
    rate = 1.0 / quarter
    steps = np.diff(time, prepend=time[0])
    turned = np.cumsum(steps * 0.5 * (rate + np.concatenate([rate[:1], rate[:-1]])))
    # beyond two frames a period no track shows it
    turned *= math.exp(min(frequency, math.log(math.pi))) * time[-1] / max(float(turned[-1]), 1e-12)
    at = phase + turned
    sine = scipy.special.ellipj(2.0 * quarter * at / math.pi, modulus)[0]
    return 2.0 * np.arcsin(np.clip(np.sin(0.5 * size) * sine, -1.0, 1.0)), at


def _columns(values: FloatArray, time: FloatArray, span: float, drifts: bool) -> FloatArray:
    angle, _ = _angle(values, time, span)
    start = min(math.exp(values[2]), _MAX_AMPLITUDE)
    columns = [
        np.ones_like(time),
        np.sin(angle) / math.sin(min(start, 0.5 * math.pi)),
        (1.0 - np.cos(angle)) / (1.0 - math.cos(start)),
    ]
    if drifts:
        columns.append(time / span - 0.5)
    return np.column_stack(columns)


def _linear(
    values: FloatArray, columns: FloatArray, place: FloatArray, weight: FloatArray
) -> FloatArray:
    """What enters linearly, with no rise where it is more than an arc's."""
    weighted, right = columns * weight[:, None], place * weight[:, None]
    linear = np.linalg.lstsq(weighted, right, rcond=1e-7)[0]
    start = min(math.exp(values[2]), _MAX_AMPLITUDE)
    # a bob rises by (1 - cos) for sin to the side, its plane seen from 60° aside at most
    most = 2.0 * (1.0 - math.cos(start)) / math.sin(min(start, 0.5 * math.pi))
    if np.hypot(*linear[2]) > most * np.hypot(*linear[1]):
        flat = np.delete(weighted, 2, axis=1)
        linear = np.insert(np.linalg.lstsq(flat, right, rcond=1e-7)[0], 2, 0.0, axis=0)
    return np.asarray(linear)


def _frequencies(time: FloatArray, place: FloatArray, span: float) -> FloatArray:
    """Angular frequencies (rad / frame) at which the track oscillates most, best first."""
    least = np.median(np.diff(time))
    highest = min(math.pi / (1.5 * least), 2.0 * math.pi * 90.0 / span)
    grid = np.concatenate(
        [
            2.0 * math.pi * np.array([0.1, 0.15, 0.25, 0.35]) / span,
            np.arange(0.5, highest * span / (2.0 * math.pi), 0.125) * 2.0 * math.pi / span,
        ]
    )
    detrended = (
        place
        - np.polynomial.polynomial.polyval(
            time / span, np.polynomial.polynomial.polyfit(time / span, place, 1)
        ).T
    )
    left = []
    for data in (place - place.mean(axis=0), detrended):
        phase = np.outer(grid, time)
        design = np.stack([np.cos(phase), np.sin(phase)], axis=2)
        design = design - design.mean(axis=1, keepdims=True)
        normal = np.einsum("fni,fnj->fij", design, design) + 1e-9 * len(time) * np.eye(2)
        right = np.einsum("fni,nk->fik", design, data)
        gain = np.einsum("fik,fik->f", np.linalg.solve(normal, right), right)
        left.append(gain / max(float((data**2).sum()), 1e-12))
    found: list[float] = []
    for gain in left:
        peaks = np.flatnonzero(
            (gain >= np.concatenate([[-1.0], gain[:-1]]))
            & (gain >= np.concatenate([gain[1:], [-1.0]]))
        )
        best = peaks[np.argsort(-gain[peaks])][:3]
        for one in best:
            if all(abs(math.log(grid[one] / known)) > 0.02 for known in found):
                found.append(float(grid[one]))
    return np.array(found)


_AMPLITUDES = np.radians([12.0, 50.0, 110.0])
"""Amplitudes from which a swing is refined."""


def fit_swing(seen: Observations, noise: float) -> Swing | None:
    """Fit a pendulum's swing to all rows.

    Frequencies of a periodogram, refined together with amplitude, phase and decay; all that enters
    linearly (where the pivot is, how the camera sees the plane) is solved for.

    Parameters
    ----------
    noise : float
        px.

    Returns
    -------
    Swing or None
        None with fewer than eight rows.
    """
    if len(seen) < 8 or seen.span <= 0.0:
        return None
    few, span = seen.thinned(140), seen.span
    rough = seen.thinned(70)
    time = few.frame - seen.frame[0]

    def solved(values: FloatArray, drifts: bool, few: Observations) -> FloatArray:
        time, weight = few.frame - seen.frame[0], 1.0 / np.hypot(noise, 0.2 * few.std)
        columns = _columns(values, time, span, drifts)
        linear = _linear(values, columns, few.place, weight)
        left = (few.place - columns @ linear) * weight[:, None]
        # a weak prior keeps decay (0.5 ± 2 over the stretch) and amplitude where they are not seen
        prior = [(values[3] - 0.5) / 2.0, (values[2] - math.log(0.5)) / 1.5]
        return np.concatenate([left.ravel(), prior])

    scale = max(3.0, DISCREPANCY * float(np.hypot(*np.ptp(few.place, axis=0))) / noise)
    lower = [-np.inf, -np.inf, math.log(0.02), -0.5]
    upper = [np.inf, np.inf, math.log(_MAX_AMPLITUDE), 6.0]
    trial = [
        (float(np.log1p((solved(first, drifts, rough) / scale) ** 2).sum()), first, drifts)
        for first, drifts in _swing_starts(time, few.place, span)
    ]

    def refined(
        first: FloatArray, drifts: bool, rows: Observations, steps: int
    ) -> tuple[float, FloatArray, bool]:
        steps_of = np.array([0.5 / max(math.exp(first[0]) * span, 1.0), 0.3, 0.5, 0.5])
        cost, values = bounded_robust(
            lambda tried: solved(tried, drifts, rows),
            first,
            (np.array(lower), np.array(upper)),
            scale,
            steps_of,
            steps,
        )
        return cost, values, drifts

    trial.sort(key=lambda one: one[0])
    tried = [refined(first, drifts, rough, 8) for _, first, drifts in trial[:6]]
    tried.sort(key=lambda one: one[0])
    best: tuple[float, FloatArray, bool] | None = None
    for _, first, drifts in tried[:2]:
        found = refined(first, drifts, few, 25)
        if best is None or found[0] < best[0]:
            best = found
        # down to the noise: no other start fits better
        if np.mean(np.minimum(solved(found[1], drifts, few) ** 2, 25.0)) < 1.3:
            break
    assert best is not None
    _, values, drifts = best
    return _finished(seen, values, drifts)


def _swing_starts(
    time: FloatArray, place: FloatArray, span: float
) -> Iterator[tuple[FloatArray, bool]]:
    """Starting values of a swing, and whether the camera's view of it may drift."""
    flat = place - place.mean(axis=0)
    main = flat @ np.linalg.svd(flat, full_matrices=False)[2][0]
    for frequency in _frequencies(time, place, span):
        turn = frequency * time
        waves = np.column_stack([np.sin(turn), np.cos(turn), np.ones_like(turn)])
        sine, cosine, _ = np.linalg.lstsq(waves, main, rcond=None)[0]
        seen_phase = math.atan2(float(cosine), float(sine))
        # a bob that swings beyond the horizontal comes back twice: half the frequency
        options = [(1.0, amplitude, seen_phase) for amplitude in _AMPLITUDES]
        options += [(0.5, _AMPLITUDES[-1], third * math.pi / 3.0) for third in range(3)]
        for share, amplitude, phase in options:
            first = np.array([math.log(frequency * share), phase, math.log(amplitude), 0.3])
            yield first, frequency * share * span > 3.0 * math.pi


def _finished(seen: Observations, values: FloatArray, drifts: bool) -> Swing:
    """The swing refined on every row, its covariance by what it leaves."""
    time, span = seen.frame - seen.frame[0], seen.span
    reliable = 1.0 / np.maximum(seen.std, 0.3 * np.median(seen.std))

    def left(at: FloatArray) -> tuple[FloatArray, FloatArray]:
        columns = _columns(at, time, span, drifts)
        linear = _linear(at, columns, seen.place, reliable)
        return seen.place - columns @ linear, linear

    steps = np.array([0.02 / max(math.exp(values[0]) * span, 1.0), 1e-4, 1e-3, 1e-3])
    residual, linear = left(values)
    covariance = np.eye(4)
    for _ in range(3):
        slopes = np.stack(
            [
                ((left(values + h)[0] - left(values - h)[0]) / (2.0 * h.sum())).ravel()
                for h in np.diag(steps)
            ],
            axis=1,
        )
        off = np.hypot(*residual.T)
        typical = max(1.4826 * float(np.median(off)), 1e-3)
        weight = np.repeat(1.0 / (1.0 + (off / (3.0 * typical)) ** 2), 2)
        normal = slopes.T @ (slopes * weight[:, None])
        # amplitude and decay stay within the prior of the search
        prior = np.diag([0.0, 0.0, 1.0 / 1.5**2, 0.25]) * typical**2
        normal = normal + prior + 1e-12 * np.diag(np.diag(normal))
        covariance = np.linalg.pinv(normal)
        step = -covariance @ (slopes.T @ (residual.ravel() * weight))
        # within the linear range: half a period over the stretch, half a radian
        limit = np.array([math.pi / max(math.exp(values[0]) * span, 1.0), 0.5, 0.3, 0.5])
        trial = values + step / max(1.0, float(np.max(np.abs(step) / limit)))
        trial[2] = min(max(trial[2], math.log(0.02)), math.log(_MAX_AMPLITUDE))
        trial[3] = min(max(trial[3], -0.5), 6.0)
        again, other = left(trial)
        if np.log1p((again / typical) ** 2).sum() > np.log1p((residual / typical) ** 2).sum():
            break
        values, residual, linear = trial, again, other
    variance = float(np.mean(residual**2)) * len(residual) / max(len(residual) - 5, 1)
    covariance = covariance * variance * _correlation_time(residual)
    omega = math.exp(values[0])
    period = _between_passages(values, time, span)
    return Swing(
        period,
        period * math.sqrt(max(float(covariance[0, 0]), 0.0)),
        math.exp(values[2]),
        float(values[3]) / span,
        float(values[1]),
        linear,
        residual,
        omega * span / (2.0 * math.pi),
        covariance,
    )


def _between_passages(values: FloatArray, time: FloatArray, span: float) -> float:
    """Mean period from the first to the last passage through the lowest point in view."""
    fine = np.linspace(0.0, span, max(len(time), 400))
    turned = _angle(values, fine, span)[1] / math.pi
    passages = np.arange(math.ceil(turned[0]), math.floor(turned[-1]) + 1)
    if len(passages) < 3:
        return 2.0 * math.pi * math.exp(-values[0])
    at = np.interp(passages[[0, -1]], turned, fine)
    return float(2.0 * (at[1] - at[0]) / (len(passages) - 1))


def correlation(residual: FloatArray) -> float:
    """Correlation of what neighbouring rows leave, 0 to 0.95."""
    if len(residual) < 6:
        return 0.0
    left = residual - residual.mean(axis=0)
    limit = 4.0 * max(float(np.median(np.abs(left))), 1e-9)
    left = np.clip(left, -limit, limit)
    alike = float((left[1:] * left[:-1]).sum() / max(float((left**2).sum()), 1e-12))
    return min(max(alike, 0.0), 0.95)


def _correlation_time(residual: FloatArray) -> float:
    alike = correlation(residual)
    return (1.0 + alike) / (1.0 - alike)


@dataclass(frozen=True)
class Circle:
    """A turn about a fixed centre, seen as an ellipse; of several turns friction changes the rate.

    Attributes
    ----------
    period : float
        In the mean, frames.
    ratio : float
        Short axis over long one.
    turned : float
        Angle through which it turns in view, rad.
    residual : (n, 2) array
        px.
    linear : (3, 2) array
        Centre, coefficients of cosine and sine, px.
    """

    period: float
    ratio: float
    turned: float
    residual: FloatArray
    linear: FloatArray


def fit_circle(seen: Observations) -> Circle | None:
    """Fit a turn to all rows; None with fewer than eight."""
    if len(seen) < 8 or seen.span <= 0.0:
        return None
    few = seen.thinned(160)
    time, share = few.frame - seen.frame[0], (seen.frame - seen.frame[0]) / seen.span

    def cost(log_rate: float) -> float:
        return float((_turned(math.exp(log_rate) * time, few.place)[0] ** 2).sum())

    starts = _frequencies(time, few.place, seen.span)
    best = min((float(np.log(rate)) for rate in starts), key=cost)
    width = min(0.7, 1.0 / max(math.exp(best) * seen.span / (2.0 * math.pi), 0.5) * 0.3)
    found = scipy.optimize.minimize_scalar(
        cost, bounds=(best - width, best + width), method="bounded", options={"xatol": 1e-5}
    )
    turn = math.exp(float(found.x)) * seen.span * share
    slowed = _slowed(seen, share)
    if slowed is not None and _left(slowed, seen) < _left(turn, seen):
        turn = slowed
    residual, linear = _turned(turn, seen.place)
    axes = np.linalg.svd(linear[1:], compute_uv=False)
    ratio = float(axes[1] / max(float(axes[0]), 1e-9))
    turned = abs(float(turn[-1] - turn[0]))
    return Circle(2.0 * math.pi * seen.span / max(turned, 1e-9), ratio, turned, residual, linear)


def _turned(turn: FloatArray, place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What a turn by angles about the best centre leaves, and its centre and axes."""
    columns = np.column_stack([np.ones_like(turn), np.cos(turn), np.sin(turn)])
    linear = np.linalg.lstsq(columns, place, rcond=1e-7)[0]
    return place - columns @ linear, linear


def _left(turn: FloatArray, seen: Observations) -> float:
    return float(np.median((_turned(turn, seen.place)[0] ** 2).sum(axis=1)))


_SLOWING = 6
"""Degree of the angle over time. Convention: a turn that dies out and stops needs about as many."""


def _slowed(seen: Observations, share: FloatArray) -> FloatArray | None:
    """Angles of a turn whose rate changes, from an ellipse through all places.

    None where they lie on no ellipse, or of less than two turns, whose rate is not seen to change.
    """
    middle = seen.place.mean(axis=0)
    size = max(float(seen.place.std()), 1e-9)
    x, y = ((seen.place - middle) / size).T
    conic = np.linalg.lstsq(
        np.column_stack([x * x, x * y, y * y, x, y]), np.ones_like(x), rcond=1e-9
    )[0]
    form = np.array([[conic[0], 0.5 * conic[1]], [0.5 * conic[1], conic[2]]])
    if np.linalg.eigvalsh(form)[0] <= 1e-6:
        return None
    centre = -0.5 * np.linalg.solve(form, conic[3:])
    round_x, round_y = np.linalg.cholesky(form).T @ (np.array([x, y]) - centre[:, None])
    angle = _unwrapped(np.arctan2(round_y, round_x), seen.frame)
    if abs(angle[-1] - angle[0]) < 4.0 * math.pi:
        return None
    powers = np.vander(share, _SLOWING + 1, increasing=True)[:, 1:]
    start: FloatArray = np.asarray(
        np.polynomial.polynomial.polyfit(share, angle, _SLOWING)[1:], dtype=np.float64
    )

    def left(values: FloatArray) -> FloatArray:
        return _turned(powers @ values, seen.place)[0].ravel()

    free = np.full(_SLOWING, np.inf)
    _, values = bounded_robust(
        left, start, (-free, free), 3.0 * seen.noise, np.ones(_SLOWING), _ROUNDS
    )
    return np.asarray(powers @ values)


_ROUNDS = 60
"""Evaluations of a turn at most. Given by the budget: it settles in about ten."""

_RATE_SHARE = 0.3
"""Of the rate between two rows in the rate that is carried on. Convention: of about six rows."""


def _unwrapped(angle: FloatArray, frame: FloatArray) -> FloatArray:
    """Angles that go on as fast as before, however many turns a gap hides."""
    found, rate = angle.copy(), 0.0
    for row, step in enumerate(np.diff(frame).tolist(), start=1):
        ahead = found[row - 1] + rate * step
        found[row] += 2.0 * math.pi * round((ahead - found[row]) / (2.0 * math.pi))
        rate += _RATE_SHARE * ((found[row] - found[row - 1]) / step - rate)
    return found


_PROCESS = np.geomspace(1e-4, 1.0, 9)
"""Process noise of a hand's motion tried, as acceleration std over the largest one seen."""


def random_process_cost(seen: Observations, noise: float) -> float:
    """Cost of a smooth random process (integrated Wiener) with the best process noise.

    What a hand carries, or anything that no law below explains. Each row is predicted from those
    before it; both coordinates share the gain.
    """
    few = seen.thinned()
    if len(few) < 4:
        return 0.0
    time, place = few.frame, few.place
    steps = np.diff(time)
    speed = np.diff(place, axis=0) / steps[:, None]
    largest = max(float(np.abs(np.diff(speed, axis=0)).max()), 1e-6)
    process = (_PROCESS * largest) ** 2
    count = len(process)
    at, moving = np.tile(place[0], (count, 1)), np.zeros((count, 2))
    variance = noise**2
    pxx = np.full(count, variance)
    pxv = np.zeros(count)
    pvv = np.full(count, float(np.mean(speed**2)) + variance)
    cost = np.zeros(count)
    for row in range(1, len(time)):
        dt = steps[row - 1]
        at = at + dt * moving
        pxx, pxv, pvv = (
            pxx + dt * (2.0 * pxv + dt * pvv) + process * dt**3 / 3.0,
            pxv + dt * pvv + process * dt**2 / 2.0,
            pvv + process * dt,
        )
        spread = pxx + variance
        off = place[row] - at
        off_by = np.minimum(0.5 * (off**2).sum(axis=1) / spread, MAX_ROW_COST)
        cost += off_by + np.log(spread / variance)
        gain, turn = pxx / spread, pxv / spread
        at = at + gain[:, None] * off
        moving = moving + turn[:, None] * off
        pvv = pvv - turn * pxv
        pxv = pxv * (1.0 - gain)
        pxx = pxx * (1.0 - gain)
    return float(cost.min()) * len(seen) / len(few) + 0.5 * math.log(2.0 * len(seen))
