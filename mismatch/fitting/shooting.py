"""Fits of free swings by multiple shooting.

Over many periods a small error of a torque turns the phase around, and a fit of one long arc from
afar ends anywhere. So every record is cut into pieces of about a period, each of which starts from
a state read off the record itself; Gauss–Newton steps close the gaps between the pieces while they
fit, and end on one arc (Bock, Springer Ser. Chem. Phys. 18, 102 (1981)).

States of a swinging pendulum read off the record itself, with no model of its losses.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mismatch.fitting.normal_equations import Free, Linearised, moved_by_a_step
from mismatch.model.forward import Forward, Model, batch_terms
from mismatch.records.records import Records
from physics.domain import FloatArray
from physics.integrator import Trajectory, integrate

__all__ = [
    "PIECE_STEPS",
    "LinearisedArcs",
    "SwingSeen",
    "arcs_of",
    "closed",
    "linearise_arcs",
    "moved_arcs",
    "seen_in_halves",
    "seen_swings",
]

WILD = 20.0
"""Logarithm of a frequency over the expected one that is no pendulum's: e to the twentieth."""

WINDOW = 0.09

"""Periods on each side of an instant over which a cubic follows a swing."""

FEWEST = 5
"""Rows: a damped swing has four unknowns, and one more shows whether it is one."""

MOST = 200

"""Rows of a local fit: the nearest ones, so that a slow swing at a high rate costs no more."""

TURNED = 0.25

"""Share of the amplitude that a swing must come back through before it counts as a half swing."""

STILL, MOST_STILL = 4.0, 0.2
"""Scatters of one reading that a half swing must exceed, lest the noise about a pendulum that has
come to rest count (1 reading in 16,000 is further off); and the share of the widest swing that this
may ask for at most, for where few readings fall into a period, their bends are the swing's own."""


@dataclass(frozen=True)
class SwingSeen:
    """What a record says about its swing before anything is fitted.

    Attributes
    ----------
    rate : float
        Angular frequency of small swings, rad/s; NaN where less than one half swing was seen.
    middle, amplitude : float
        rad.
    half_swings : int
        Passages from one side to the other.
    pace : float
        Angular frequency as seen, at the swing's own amplitude, rad/s; NaN as `rate`.
    """

    rate: float
    middle: float
    amplitude: float
    half_swings: int
    pace: float = math.nan


def seen_swings(records: Records) -> tuple[SwingSeen, ...]:
    """Frequency, middle and amplitude of every trial, from its passages through the middle."""
    found = []
    for trial in range(records.trials):
        used = records.pendulum_used[trial]
        found.append(_seen(records.pendulum_time[trial, used], records.pendulum_angle[trial, used]))
    return tuple(found)


def seen_in_halves(records: Records) -> tuple[SwingSeen, ...]:
    """What the first and the second half of every record show: losses part their amplitudes."""
    found = []
    for trial in range(records.trials):
        used = records.pendulum_used[trial]
        time, angle = records.pendulum_time[trial, used], records.pendulum_angle[trial, used]
        cut = time.size // 2
        found += [_seen(time[:cut], angle[:cut]), _seen(time[cut:], angle[cut:])]
    return tuple(found)


def _seen(time: FloatArray, angle: FloatArray) -> SwingSeen:
    if angle.size < FEWEST:
        return SwingSeen(math.nan, 0.0, 0.0, 0)
    low, high = float(angle.min()), float(angle.max())
    middle, amplitude = 0.5 * (low + high), max(0.5 * (high - low), 1e-12)
    passed = _passages(time, angle - _running_middle(angle, middle), amplitude)
    if passed.size < 2:
        return SwingSeen(math.nan, middle, amplitude, int(passed.size))
    # A swing of amplitude A takes 1 + A²/16 + … longer; the mean amplitude is good enough here.
    mean = min(_mean_amplitude(time, angle, passed), 3.0)
    longer = 1.0 + mean**2 / 16.0 + 11.0 * mean**4 / 3072.0 + 173.0 * mean**6 / 737280.0
    half = float(passed[-1] - passed[0]) / (passed.size - 1)
    pace = math.pi / half
    return SwingSeen(pace * longer, middle, amplitude, int(passed.size), pace)


def _running_middle(angle: FloatArray, middle: float) -> float:
    """The middle of the slow end, where losses have brought both sides together."""
    tail = angle[-max(FEWEST, angle.size // 2) :]
    inner = 0.5 * float(tail.min() + tail.max())
    return inner if np.ptp(tail) > 0.1 * np.ptp(angle) else middle


def _passages(time: FloatArray, angle: FloatArray, amplitude: float) -> FloatArray:
    """Times at which the swing passes its middle, noise about it not counted twice."""
    found: list[float] = []
    turned, peak, before = True, 0.0, amplitude
    still = min(STILL * _scatter(angle), MOST_STILL * amplitude)
    for at in range(1, angle.size):
        peak = max(peak, abs(float(angle[at])))
        turned = turned or peak > max(TURNED * before, still)
        if angle[at - 1] * angle[at] <= 0.0 and angle[at] != angle[at - 1] and turned:
            share = angle[at - 1] / (angle[at - 1] - angle[at])
            found.append(float(time[at - 1] + share * (time[at] - time[at - 1])))
            turned, peak, before = False, 0.0, peak
    return np.array(found)


def _scatter(angle: FloatArray) -> float:
    """Scatter of one reading from the bends of the record, robust; smooth motion adds little."""
    bends = np.diff(angle, 2)
    # A second difference of independent readings has the variance 1 + 4 + 1.
    return float(1.4826 * np.median(np.abs(bends))) / math.sqrt(6.0)


def _mean_amplitude(time: FloatArray, angle: FloatArray, passed: FloatArray) -> float:
    cuts = np.searchsorted(time, passed)
    parts = [part for part in np.split(angle, cuts)[1:-1] if part.size]
    centre = 0.5 * (max(float(p.max()) for p in parts) + min(float(p.min()) for p in parts))
    peaks = [float(np.abs(part - centre).max()) for part in parts]
    return float(np.sqrt(np.mean(np.square(peaks))))


def local_states(records: Records, trial: int, at: FloatArray, rate: float) -> FloatArray:
    """Angle and rate of a trial at some instants, by cubics through the rows nearby.

    Parameters
    ----------
    records : Records
    trial : int
    at : (J,) array
        s after the trial's first row.
    rate : float
        Angular frequency of its swing, rad/s.

    Returns
    -------
    (J, 2) array
        rad and rad/s; NaN where fewer than five rows lie within a third of a period.
    """
    used = records.pendulum_used[trial]
    time = records.pendulum_time[trial, used] - records.pendulum_time[trial, 0]
    angle = records.pendulum_angle[trial, used]
    period = 2.0 * math.pi / rate
    states = np.full((at.size, 2), np.nan)
    if time.size < FEWEST:
        return states
    for row, instant in enumerate(at):
        apart = np.abs(time - instant)
        near = np.flatnonzero(apart < WINDOW * period)
        if near.size < FEWEST or near.size > MOST:
            near = np.argsort(apart)[: FEWEST if near.size < FEWEST else MOST]
        if apart[near].max() > period / 3.0:
            continue
        scale = max(float(apart[near].max()), 1e-12)
        degree = 3 if near.size > FEWEST else 2
        fitted = np.polynomial.polynomial.polyfit(
            (time[near] - instant) / scale, angle[near], degree
        )
        states[row] = fitted[0], fitted[1] / scale
    return states


PIECE_STEPS = 64

"""Runge–Kutta steps of a piece, which is about one period long."""

SHUT = 0.1

"""Sigma by which closing the last gaps may still move a row."""

FAR = 1e3

"""rad and rad/s beyond which a swing has run off."""

STATE_STEPS = (1e-5, 1e-4)
"""rad and rad/s, steps of a difference: far above rounding, far below where a swing bends."""

FREQUENCY_STEP = 1e-5
"""Relative step of a difference by the frequency: far above rounding, far below where a swing
bends."""


@dataclass(frozen=True)
class Arcs:
    """The pieces of all trials.

    Attributes
    ----------
    states : (T, J, 2) array
        Angle (rad) and rate (rad/s) where each piece starts.
    span : (T,) array
        Length of a piece, s.
    index : (T, P) int array
        Which piece each row of the record lies in.
    since : (T, P) array
        s from the start of its piece.
    live : (T, J) bool array
        Which pieces begin before the last row that takes part; the others are never joined.
    """

    states: FloatArray
    span: FloatArray
    index: NDArray[np.int64]
    since: FloatArray
    live: NDArray[np.bool_]

    @property
    def pieces(self) -> int:
        """Pieces of a trial."""
        return int(self.states.shape[1])


@dataclass(frozen=True)
class LinearisedArcs:
    """A linearised system whose gaps are closed, and what closes them.

    Attributes
    ----------
    system : Linearised
        As for one arc: the residual is that of closed pieces, to first order.
    residual : (T, P) array
        Scaled residual of the pieces as they are.
    gaps : (T, J, 2) array
        End of each piece minus start of the next; the last one zero.
    follow : (T, J, 2, 3 + n) array
        How the pieces' states follow from first state, frequency and shared parameters.
    close : (T, J, 2) array
        What closes the gaps.
    """

    system: Linearised
    residual: FloatArray
    gaps: FloatArray
    follow: FloatArray
    close: FloatArray


def arcs_of(forward: Forward, nuisance: FloatArray) -> Arcs:
    """Cut the records into pieces; states come from the records, gaps in them are bridged.

    Parameters
    ----------
    nuisance : (T, 4) array
        Of which frequency (logarithm of the ratio to the records' median) and zero are used.
    """
    records = forward.records
    count = max(1, forward.steps // PIECE_STEPS)
    span = forward.swing_time / count
    label = records.pendulum_time - records.pendulum_time[:, :1]
    index = np.clip((label / span[:, None]).astype(np.int64), 0, count - 1)
    states = np.zeros((records.trials, count, 2))
    for trial in range(records.trials):
        if not records.pendulum_used[trial].any():
            continue
        rate = forward.small_rate * math.exp(float(nuisance[trial, 2]))
        starts = span[trial] * np.arange(count)
        found = local_states(records, trial, starts, rate)
        found[:, 0] -= nuisance[trial, 3]
        states[trial] = _bridged(found, float(span[trial]), rate, nuisance[trial, :2])
    last = np.where(records.pendulum_used, index, -1).max(axis=1)
    live = np.arange(count) <= last[:, None]
    return Arcs(states, span, index, label - index * span[:, None], live)


def _bridged(states: FloatArray, span: float, rate: float, first: FloatArray) -> FloatArray:
    """States where the record says nothing, swung on without losses from the piece before."""
    states = states.copy()
    if not np.isfinite(states[0]).all():
        states[0] = first
    for row in range(1, len(states)):
        if np.isfinite(states[row]).all():
            continue

        def rates(_: FloatArray, state: FloatArray) -> FloatArray:
            return np.stack([state[1], -(rate**2) * np.sin(state[0])])

        states[row] = integrate(rates, states[row - 1], np.array(span), PIECE_STEPS).states[-1]
    return states


def _read(path: Trajectory, arcs: Arcs, clock: FloatArray) -> FloatArray:
    """Angles (L, T, P) of all rows, each read in its own piece."""
    rows = path.states.shape[2]
    trials, pieces = arcs.states.shape[:2]
    step = arcs.span / (path.states.shape[0] - 1)
    place = clock / step[:, None]
    cell = np.clip(place.astype(np.int64), 0, path.states.shape[0] - 2)
    u = place - cell
    column = np.arange(trials)[:, None] * pieces + arcs.index
    row = np.arange(rows)[:, None, None]
    a, b = path.states[cell, 0, row, column], path.states[cell + 1, 0, row, column]
    da = path.rates[cell, 0, row, column] * step[:, None]
    db = path.rates[cell + 1, 0, row, column] * step[:, None]
    u2, u3 = u * u, u * u * u
    return np.asarray(
        a * (2 * u3 - 3 * u2 + 1) + da * (u3 - 2 * u2 + u) + b * (3 * u2 - 2 * u3) + db * (u3 - u2)
    )


def _swung(
    forward: Forward, models: Sequence[Model], arcs: Arcs, states: FloatArray, frequency: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Angles (L, T, P) of the rows, and states (L, T, J, 2) where the pieces end."""
    rows, (trials, pieces) = len(models), arcs.states.shape[:2]
    terms = batch_terms(models)
    start = np.moveaxis(states, -1, 0).reshape(2, rows, trials * pieces)
    # A step beyond any pendulum is turned back by its misfit, not by an overflow.
    stiffer = np.exp(2.0 * np.clip(np.repeat(frequency, pieces, axis=-1), -WILD, WILD))
    order = np.repeat(forward.records.order, pieces)
    rates = forward.swing_rates(terms, stiffer, order)
    with np.errstate(over="ignore", invalid="ignore"):
        path = integrate(rates, start, np.repeat(arcs.span, pieces), PIECE_STEPS)
    label = forward.records.pendulum_time - forward.records.pendulum_time[:, :1]
    clock = forward.true_time(terms, np.broadcast_to(label, (rows, *label.shape)))
    local = clock - (label - arcs.since)
    seen = _read(path, arcs, local)
    ends = np.moveaxis(path.states[-1].reshape(2, rows, trials, pieces), 0, -1)
    return seen, ends


def linearise_arcs(
    forward: Forward, model: Model, arcs: Arcs, nuisance: FloatArray, free: Sequence[Free]
) -> LinearisedArcs:
    """Residuals and derivatives of all pieces, with the gaps between them closed to first order."""
    rows = [model, model, model, model]
    sizes = []
    for item in free:
        size, moved = moved_by_a_step(model, item)
        sizes.append(size)
        rows.append(moved)
    states = np.repeat(arcs.states[None], len(rows), axis=0)
    frequency = np.repeat(nuisance[None, :, 2], len(rows), axis=0)
    for column, size in enumerate(STATE_STEPS):
        states[1 + column, ..., column] += size
    frequency[3] += FREQUENCY_STEP
    steps = np.array([*STATE_STEPS, FREQUENCY_STEP, *sizes])
    seen, ends = _swung(forward, rows, arcs, states, frequency)
    # What ran off to infinity is as wrong as can be, and no number to step by.
    seen, ends = (np.nan_to_num(np.clip(a, -FAR, FAR), nan=FAR) for a in (seen, ends))
    slopes = np.moveaxis(seen[1:] - seen[:1], 0, -1) / steps
    transfer = np.moveaxis(ends[1:] - ends[:1], 0, -1) / steps
    gaps = np.zeros_like(arcs.states)
    gaps[:, :-1] = np.where(arcs.live[:, 1:, None], ends[0, :, :-1] - arcs.states[:, 1:], 0.0)
    follow, close = _followed(transfer, gaps)
    return _joined(forward, arcs, nuisance, seen[0], slopes, (gaps, follow, close))


def _followed(transfer: FloatArray, gaps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How states follow from the first one (T, J, 2, 3 + n), and what closes the gaps."""
    trials, pieces, _, columns = transfer.shape
    follow = np.zeros((trials, pieces, 2, columns))
    close = np.zeros((trials, pieces, 2))
    follow[:, 0, 0, 0] = follow[:, 0, 1, 1] = 1.0
    for j in range(pieces - 1):
        along = transfer[:, j, :, :2]
        follow[:, j + 1] = along @ follow[:, j]
        follow[:, j + 1, :, 2:] += transfer[:, j, :, 2:]
        close[:, j + 1] = (along @ close[:, j, :, None])[..., 0] + gaps[:, j]
    return follow, close


def _joined(
    forward: Forward,
    arcs: Arcs,
    nuisance: FloatArray,
    seen: FloatArray,
    slopes: FloatArray,
    joints: tuple[FloatArray, FloatArray, FloatArray],
) -> LinearisedArcs:
    gaps, follow, close = joints
    records = forward.records
    ball = 3 * records.ball_time.shape[1]
    weights = records.weights[:, ball:]
    rows = np.arange(records.trials)[:, None]
    here = slopes[..., None, :2]
    columns = (here @ follow[rows, arcs.index])[..., 0, :]
    columns[..., 2:] += slopes[..., 2:]
    shift = (here @ close[rows, arcs.index][..., None])[..., 0, 0]
    left = np.where(records.pendulum_used, records.pendulum_angle - seen - nuisance[:, 3:4], 0.0)
    zero = np.ones((*left.shape, 1))
    own = np.concatenate([columns[..., :3], zero], axis=-1) * weights[..., None]
    shared = columns[..., 3:] * weights[..., None]
    blank = np.zeros((records.trials, ball))
    system = Linearised(
        np.concatenate([blank, (left - shift) * weights], axis=1),
        np.concatenate([np.zeros((*blank.shape, 4)), own], axis=1),
        np.concatenate([np.zeros((*blank.shape, shared.shape[-1])), shared], axis=1),
        np.zeros(4),
        np.zeros(shared.shape[-1]),
    )
    return LinearisedArcs(system, left * weights, gaps, follow, close)


def moved_arcs(
    arcs: Arcs, found: LinearisedArcs, own: FloatArray, shared: FloatArray, share: float
) -> Arcs:
    """Pieces after a share of a step: own values (T, 4) and shared parameters (n,)."""
    step = np.concatenate([own[:, :3], np.broadcast_to(shared, (len(own), shared.size))], axis=1)
    states = (found.follow @ step[:, None, :, None])[..., 0] + found.close
    return replace(arcs, states=arcs.states + share * states)


def closed(forward: Forward, found: LinearisedArcs) -> bool:
    """Whether the pieces make one arc: what would close them moves no row by `SHUT` sigma."""
    weights = forward.records.weights[:, 3 * forward.records.ball_time.shape[1] :]
    largest = weights.max(axis=1)
    sigma = np.where(largest > 0.0, 1.0 / np.maximum(largest, 1e-12), np.inf)
    return bool(np.all(np.abs(found.close[..., 0]) < SHUT * sigma[:, None]))
