"""Fit models to campaigns by Gauss–Newton steps; free swings by multiple shooting.

Trial-to-trial values enter one trial each and are eliminated trial by trial (a Schur complement),
which leaves a small system in the parameters that trials share. Over many periods a small error of
a torque turns the phase around, so each record of a free swing is cut into pieces of about a
period, each of which starts from a state read off the record; the steps close the gaps between
pieces while they fit (Bock, Springer Ser. Chem. Phys. 18, 102 (1981)).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mismatch.forward import NUISANCES, Forward, ForwardModel, batch_terms
from mismatch.records import Records
from physics.domain import FloatArray
from physics.effects import Coordinate, Effect, EffectId, Level, Parameter
from physics.integrator import Trajectory, integrate

__all__ = [
    "AT_SETTING",
    "FIRST_STEPS",
    "FROM_THE_RECORD",
    "GROUPED",
    "MIN_ROWS",
    "PIECE_STEPS",
    "Arcs",
    "Ending",
    "Fit",
    "Free",
    "Linearised",
    "LinearisedArcs",
    "SwingSeen",
    "SwingStart",
    "arcs_of",
    "closed",
    "fit_model",
    "fitting_start",
    "free_parameters",
    "grouped_columns",
    "held_information",
    "inverse_of",
    "kept_free",
    "left_open",
    "linearise",
    "linearise_arcs",
    "moved_arcs",
    "moved_by_a_step",
    "priors",
    "reduce",
    "rows_at_rest",
    "seen_in_halves",
    "seen_swings",
    "solve",
    "spread_laws",
]

STEP_SHARE = 1e-3

"""Share of a parameter's scale per step of a difference: far above rounding, far below where it
bends."""


@dataclass(frozen=True)
class Free:
    """A parameter that a fit may change: which effect of the model, which parameter."""

    entry: int
    parameter: Parameter


@dataclass(frozen=True)
class Linearised:
    """Normal equations around a point, trial-to-trial values still in.

    Attributes
    ----------
    residual : (T, M) array
        (record − prediction) / sigma, zero where unused.
    own : (T, M, q) array
        Derivatives of the scaled prediction by the trial's own values.
    shared : (T, M, n) array
        Derivatives by the shared parameters: those of each ball and session, then the model's.
    prior : (q,) array, and
    shared_prior : (n,) array
        Inverse variances.
    """

    residual: FloatArray
    own: FloatArray
    shared: FloatArray
    prior: FloatArray
    shared_prior: FloatArray


def free_parameters(
    model: ForwardModel, effects: Sequence[Effect] | None = None
) -> tuple[Free, ...]:
    """Every parameter of the named effects of a model (of all of them by default)."""
    return tuple(
        Free(index, parameter)
        for index, (effect, _) in enumerate(model.entries)
        if effects is None or any(effect is one for one in effects)
        for parameter in effect.parameters
    )


def kept_free(fit: "Fit", model: ForwardModel) -> tuple[Free, ...]:
    """What a fit leaves open and a model grown from it still holds, where it stands there."""
    return tuple(
        Free(index, item.parameter)
        for item in fit.free
        for index, (effect, _) in enumerate(model.entries)
        if effect is fit.model.entries[item.entry][0]
    )


def left_open(fit: "Fit", effects: Sequence[Effect]) -> "Fit":
    """A fit with further effects left open where they stand, as far as their widths say."""
    more = free_parameters(fit.model, effects)
    widths = np.array([item.parameter.width for item in more])
    penalty = fit.penalty + float(np.sum(np.square(_values(fit.model, more) / widths)))
    held = len(fit.free)
    covariance = np.diag(np.concatenate([np.zeros(held), np.square(widths)]))
    covariance[:held, :held] = fit.covariance
    return replace(fit, free=(*fit.free, *more), covariance=covariance, penalty=penalty)


def held_information(free: Sequence[Free]) -> FloatArray:
    """(n,) inverse prior variances of parameters that a prior holds near nothing; else 0."""
    return np.array([f.parameter.width**-2.0 if f.parameter.is_held else 0.0 for f in free])


def priors(forward: Forward, model: ForwardModel) -> tuple[FloatArray, FloatArray]:
    """Inverse prior variances of the trial-to-trial values, and of each group's offsets.

    Those of the model's own strengths come last; what trials of a ball or of a session share is no
    trial's own.
    """
    scatter = forward.baseline.scatter
    if forward.mode == "impact":
        own = np.array([np.inf, scatter.backswing, scatter.cor, scatter.launch_angle])
        laws = np.array([scatter.cor_law, scatter.launch_angle_law, *forward.at_setting])
    elif forward.mode == "flight":
        measured = forward.records.ball_used.any(axis=(0, 1))
        # A coordinate nobody measured keeps what it starts with.
        free = np.where(measured, np.inf, 1e-9)
        own, laws = np.concatenate([free, free]), np.zeros(0)
    else:
        known = (scatter.natural_frequency, scatter.angle_zero, forward.uneven)
        own = np.array([np.inf, np.inf, *known])
        laws = np.zeros(0)
    mine = [one.spread if one.level is Level.TRIAL else 0.0 for one in model.own]
    groups = [one.spread for one in model.own if one.level in GROUPED]
    own, laws = np.concatenate([own, mine]), np.concatenate([laws, groups])
    return 1.0 / np.maximum(own, 1e-12) ** 2, 1.0 / np.maximum(laws, 1e-12) ** 2


AT_SETTING = (1, 2, 3)
"""Columns of a strike's own values that repeats of a setting may share."""

GROUPED = frozenset({Level.BALL, Level.SESSION, Level.SETTING})
"""Levels of which several trials, but not all, share a value."""


def grouped_columns(forward: Forward, model: ForwardModel) -> tuple[tuple[int, Level], ...]:
    """Columns of the trial-to-trial values of which the trials of a group share an offset."""
    first = len(NUISANCES[forward.mode])
    laws = tuple((column, Level.BALL) for column in (2, 3)) if forward.mode == "impact" else ()
    repeats = AT_SETTING if forward.at_setting else ()
    return (
        *laws,
        *((column, Level.SETTING) for column in repeats),
        *((first + k, s.level) for k, s in enumerate(model.own) if s.level in GROUPED),
    )


def _most_groups(forward: Forward, model: ForwardModel) -> int:
    """Groups at the level that has most of them: rows that a level has not stay at zero."""
    levels = {Level.BALL, *(level for _, level in grouped_columns(forward, model))}
    return max(len(forward.records.groups(level)[1]) for level in levels)


def fitting_start(
    forward: Forward, model: ForwardModel, nuisance: FloatArray, laws: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Start values in the shape that a model needs: its further own strengths start at the mean."""
    own = len(NUISANCES[forward.mode]) + len(model.own)
    shape = (_most_groups(forward, model), len(grouped_columns(forward, model)))
    if not shape[1]:
        shape = (0, 0)
    wide, offsets = np.zeros((forward.records.trials, own)), np.zeros(shape)
    held = min(own, nuisance.shape[1])
    wide[:, :held] = nuisance[:, :held]
    if laws.size and offsets.size:
        rows, kept = min(shape[0], laws.shape[0]), min(shape[1], laws.shape[1])
        offsets[:rows, :kept] = laws[:rows, :kept]
    return wide, offsets


def spread_laws(
    forward: Forward, model: ForwardModel, nuisance: FloatArray, laws: FloatArray
) -> FloatArray:
    """Add each group's offsets to its trials' own values."""
    if not laws.size:
        return nuisance
    total = nuisance.copy()
    for place, (column, level) in enumerate(grouped_columns(forward, model)):
        total[:, column] += laws[forward.records.groups(level)[0], place]
    return total


def linearise(
    forward: Forward,
    model: ForwardModel,
    nuisance: FloatArray,
    laws: FloatArray,
    free: Sequence[Free],
    extra: Sequence[ForwardModel] = (),
    extra_steps: Sequence[float] = (),
) -> Linearised:
    """Residuals and derivatives around a point.

    `extra` models each differ from `model` by one small step of one further parameter; their
    columns come after those of `free`.
    """
    base = spread_laws(forward, model, nuisance, laws)
    steps = _own_steps(forward, model)
    q = len(steps)
    rows: list[ForwardModel] = [model] * (1 + q)
    own = np.repeat(base[None], 1 + q, axis=0)
    for column in range(q):
        own[1 + column, :, column] += steps[column]
    sizes: list[float] = []
    for item in free:
        step, moved = moved_by_a_step(model, item)
        sizes.append(step)
        rows.append(moved)
    rows.extend(extra)
    sizes.extend(extra_steps)
    own = np.concatenate([own, np.repeat(base[None], len(rows) - 1 - q, axis=0)])
    predicted = forward.predict(rows, own)
    residual = forward.records.weighed(forward.records.values - predicted[0])
    slopes = forward.records.weighed(predicted[1:] - predicted[:1])
    mine = np.moveaxis(slopes[:q], 0, -1) / steps
    theirs = np.moveaxis(slopes[q:], 0, -1) / np.array(sizes or [1.0])[: len(sizes)]
    return _with_groups(forward, model, residual, mine, theirs)


def _with_groups(
    forward: Forward,
    model: ForwardModel,
    residual: FloatArray,
    mine: FloatArray,
    theirs: FloatArray,
) -> Linearised:
    """The system of residuals and slopes, with a column for each offset that a group shares."""
    own_prior, law_prior = priors(forward, model)
    parts, shared_prior = [], [np.zeros(theirs.shape[-1])]
    columns = grouped_columns(forward, model)
    if columns:
        group = np.stack([forward.records.groups(one)[0] for _, one in columns], axis=-1)
        for index in range(_most_groups(forward, model)):
            parts.append(
                np.where(
                    (group == index)[:, None], mine[..., [column for column, _ in columns]], 0.0
                )
            )
            shared_prior.insert(0, law_prior)
    parts.append(theirs)
    return Linearised(
        residual, mine, np.concatenate(parts, axis=-1), own_prior, np.concatenate(shared_prior)
    )


def _own_steps(forward: Forward, model: ForwardModel) -> FloatArray:
    if forward.mode == "impact":
        steps = [1e-5, 1e-4, 1e-4, 1e-4]
    elif forward.mode == "flight":
        steps = [1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3]
    else:
        steps = [*STATE_STEPS, FREQUENCY_STEP, 1e-5, LOSS_STEP]
    for one in model.own:
        steps += [STEP_SHARE * p.scale for p in one.effect.strengths if p.name == one.name]
    return np.array(steps)


def moved_by_a_step(model: ForwardModel, item: Free) -> tuple[float, ForwardModel]:
    """The step of a derivative, and the model moved by it."""
    effect, values = model.entries[item.entry]
    parameter = item.parameter
    step = STEP_SHARE * parameter.scale
    if values[parameter.name] + step > parameter.upper:
        step = -step
    moved = dict(values) | {parameter.name: values[parameter.name] + step}
    entries = list(model.entries)
    entries[item.entry] = (effect, moved)
    return step, replace(model, entries=tuple(entries))


def reduce(
    system: Linearised, own_pull: FloatArray, shared_pull: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Eliminate the trials' own values.

    Parameters
    ----------
    own_pull : (T, q) array
        −prior × current value, the gradient of the penalty.
    shared_pull : (n,) array
        Likewise for the shared parameters.

    Returns
    -------
    matrix : (n, n) array
        Information on the shared parameters.
    vector : (n,) array
        Its right-hand side.
    inverse : (T, q, q) array
        Inverse information on each trial's own values.
    cross : (T, q, n) array
        What couples the two.
    """
    own_t = np.swapaxes(system.own, 1, 2)
    a = own_t @ system.own + np.diag(system.prior)
    b = own_t @ system.shared
    # A tiny ridge relative to each diagonal keeps directions that no row sees from growing.
    diagonal = np.einsum("tqq->tq", a)
    inverse = np.linalg.inv(
        a + np.einsum("tq,qr->tqr", 1e-12 * diagonal + 1e-12, np.eye(a.shape[1]))
    )
    g = np.einsum("tmq,tm->tq", system.own, system.residual) + own_pull
    h = np.einsum("tmn,tm->n", system.shared, system.residual) + shared_pull
    c = np.einsum("tmn,tmk->nk", system.shared, system.shared, optimize=True)
    c = c + np.diag(system.shared_prior)
    middle = inverse @ b
    matrix = c - np.einsum("tqn,tqk->nk", b, middle)
    vector = h - np.einsum("tqn,tq->n", middle, g)
    # Where the trials' own values take all of a parameter up, rounding alone is left, of any sign.
    np.fill_diagonal(matrix, np.maximum(np.diag(matrix), 1e-12 * np.diag(c)))
    return matrix, vector, inverse, b


def solve(matrix: FloatArray, vector: FloatArray, damping: float = 0.0) -> FloatArray:
    """Solve a symmetric system scaled to unit diagonal, small directions damped."""
    if vector.size == 0:
        return vector
    if not (np.isfinite(matrix).all() and np.isfinite(vector).all()):
        return np.zeros_like(vector)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix * scale[:, None] * scale[None, :]
    scaled = scaled + (1e-10 + damping) * np.eye(len(vector))
    return np.asarray(np.linalg.solve(scaled, vector * scale) * scale)


def inverse_of(matrix: FloatArray) -> FloatArray:
    """Pseudo-inverse of a symmetric matrix, scaled to unit diagonal; infinite if it holds NaN."""
    if matrix.size == 0:
        return matrix
    if not np.isfinite(matrix).all():
        return np.full_like(matrix, np.inf)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix * scale[:, None] * scale[None, :]
    inverse = np.linalg.pinv(scaled, rcond=1e-12, hermitian=True)
    return np.asarray(inverse * scale[:, None] * scale[None, :])


WILD = 20.0

"""Logarithm of a frequency over the expected one that is no pendulum's: e to the twentieth."""

WINDOW = 0.09

"""Periods on each side of an instant over which a cubic follows a swing."""

MIN_ROWS = 5

"""Rows: a damped swing has four unknowns, and one more shows whether it is one."""

MAX_ROWS = 200

"""Rows of a local fit: the nearest ones, so that a slow swing at a high rate costs no more."""

TURNED = 0.25

"""Share of the amplitude that a swing must come back through before it counts as a half swing."""

STILL, MAX_STILL = 4.0, 0.2

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


RESTS = 3.0
"""Scatters of a reading from the place of rest that two readings in a row leave while it swings."""

QUIET = 3.0 * 1.17
"""Times 1/√n, by how much the scatter of n readings may exceed that of one while nothing moves:
three standard errors of a median absolute deviation, 1.17/√n of a Gaussian's (Rousseeuw and Croux,
J. Am. Stat. Assoc. 88, 1273 (1993))."""

LAST_SWINGS = 2.0
"""Half swings before rest in which friction is no small part of the weight where they turn back:
each loses twice the angle that friction can hold, so that all before turn beyond three times that
angle. A sign that is smoothed over a step is no friction that holds."""


def rows_at_rest(records: Records, rate: float) -> NDArray[np.bool_]:
    """(T, P) rows of a pendulum that comes to rest, held by friction beside its zero.

    Those of its last swing are among them: it turns back with a third of what friction takes.

    Parameters
    ----------
    rate : float
        Of small swings, rad/s: half a swing distinguishes rest from a turning point.
    """
    found = np.zeros(records.pendulum_used.shape, dtype=bool)
    for trial in range(records.trials):
        rows = np.flatnonzero(records.pendulum_used[trial])
        time, angle = records.pendulum_time[trial, rows], records.pendulum_angle[trial, rows]
        if rows.size < 2 * MIN_ROWS:
            continue
        scatter = max(_scatter(angle), 1e-12)
        back = np.floor((time[-1] - time) * rate / math.pi).astype(int)
        last = angle[back == 0]
        middle, moving = float(np.median(last)), 0
        while last.size >= MIN_ROWS:
            apart = abs(float(np.median(last)) - middle) * math.sqrt(last.size)
            wide = 1.4826 * float(np.median(np.abs(last - np.median(last))))
            most = 1.0 + QUIET / math.sqrt(last.size)
            if wide > most * scatter or apart > 2.0 * RESTS * scatter:
                break
            moving += 1
            last = angle[back == moving]
        if not moving:
            continue
        off = np.abs(angle - middle) > RESTS * scatter
        swung = np.flatnonzero(off[1:] & off[:-1])
        stopped = time[int(swung[-1]) + 1] if swung.size else time[0]
        found[trial, rows[time > stopped - LAST_SWINGS * math.pi / rate]] = True
    return found


def _seen(time: FloatArray, angle: FloatArray) -> SwingSeen:
    if angle.size < MIN_ROWS:
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
    tail = angle[-max(MIN_ROWS, angle.size // 2) :]
    inner = 0.5 * float(tail.min() + tail.max())
    return inner if np.ptp(tail) > 0.1 * np.ptp(angle) else middle


def _passages(time: FloatArray, angle: FloatArray, amplitude: float) -> FloatArray:
    """Times at which the swing passes its middle, noise about it not counted twice."""
    found: list[float] = []
    turned, peak, before = True, 0.0, amplitude
    still = min(STILL * _scatter(angle), MAX_STILL * amplitude)
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
    if time.size < MIN_ROWS:
        return states
    for row, instant in enumerate(at):
        apart = np.abs(time - instant)
        near = np.flatnonzero(apart < WINDOW * period)
        if near.size < MIN_ROWS or near.size > MAX_ROWS:
            near = np.argsort(apart)[: MIN_ROWS if near.size < MIN_ROWS else MAX_ROWS]
        if apart[near].max() > period / 3.0:
            continue
        scale = max(float(apart[near].max()), 1e-12)
        degree = 3 if near.size > MIN_ROWS else 2
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

"""Likewise by the logarithm of the frequency."""

LOSS_STEP = 1e-3

"""Likewise by the share of the losses, which move a path far less than its frequency does."""


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
class SwingStart:
    """Where a fit of free swings starts, and when it is left.

    Attributes
    ----------
    arcs : Arcs, optional
        Pieces of a fit before; read off the record by default.
    hopeless : float
        Cost from which a fit that creeps is left: another law is far ahead of it.
    least : float
        Cost that steps as good as the last one must be able to reach, lest the fit be left.
    """

    arcs: Arcs | None = None
    hopeless: float = math.inf
    least: float = math.inf


FROM_THE_RECORD = SwingStart()


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
    follow : (T, J, 2, 3 + k + n) array
        How the pieces' states follow from first state, frequency, own strengths and the model's.
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
    nuisance : (T, q) array
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


def _read(path: Trajectory, arcs: Arcs, clock: FloatArray, component: int) -> FloatArray:
    """Angles or their rates (L, T, P) of all rows, each read in its own piece."""
    rows = path.states.shape[2]
    trials, pieces = arcs.states.shape[:2]
    step = arcs.span / (path.states.shape[0] - 1)
    place = clock / step[:, None]
    cell = np.clip(place.astype(np.int64), 0, path.states.shape[0] - 2)
    u = place - cell
    column = np.arange(trials)[:, None] * pieces + arcs.index
    row = np.arange(rows)[:, None, None]
    a, b = (path.states[at, component, row, column] for at in (cell, cell + 1))
    da, db = (path.rates[at, component, row, column] * step[:, None] for at in (cell, cell + 1))
    u2, u3 = u * u, u * u * u
    return np.asarray(
        a * (2 * u3 - 3 * u2 + 1) + da * (u3 - 2 * u2 + u) + b * (3 * u2 - 2 * u3) + db * (u3 - u2)
    )


def _swung(
    forward: Forward,
    models: Sequence[ForwardModel],
    arcs: Arcs,
    states: FloatArray,
    values: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Angles (L, T, P) of the rows, and states (L, T, J, 2) where the pieces end.

    `values` (L, T, q) are those of each trial.
    """
    own = values[..., len(NUISANCES["swing"]) :]
    rows, (trials, pieces) = len(models), arcs.states.shape[:2]
    terms = batch_terms(models, np.repeat(own, pieces, axis=1))
    start = np.moveaxis(states, -1, 0).reshape(2, rows, trials * pieces)
    # A step beyond any pendulum is turned back by its misfit, not by an overflow.
    frequency = np.clip(np.repeat(values[..., 2], pieces, axis=-1), -WILD, WILD)
    order = np.repeat(forward.records.order, pieces)
    span = np.repeat(arcs.span, pieces)
    losses = 1.0 + np.repeat(values[..., 4], pieces, axis=-1) if values[..., 4].any() else 1.0
    rates = forward.swing_rates(
        terms, span / PIECE_STEPS, np.exp(2.0 * frequency), order, losses=losses
    )
    with np.errstate(over="ignore", invalid="ignore"):
        path = integrate(rates, start, span, PIECE_STEPS)
    label = forward.records.pendulum_time - forward.records.pendulum_time[:, :1]
    clock = forward.true_time(
        batch_terms(models, own), np.broadcast_to(label, (rows, *label.shape))
    )
    local = clock - (label - arcs.since)
    with np.errstate(invalid="ignore"):
        seen = _read(path, arcs, local, 0)
        if any("angle" in term.effect.hooks for term in terms):
            seen = forward.angles_seen(terms, seen, _read(path, arcs, local, 1), label)
    ends = np.moveaxis(path.states[-1].reshape(2, rows, trials, pieces), 0, -1)
    return seen, ends


def linearise_arcs(
    forward: Forward,
    model: ForwardModel,
    arcs: Arcs,
    nuisance: FloatArray,
    laws: FloatArray,
    free: Sequence[Free],
    extra: Sequence[ForwardModel] = (),
    extra_steps: Sequence[float] = (),
) -> LinearisedArcs:
    """Residuals and derivatives of all pieces, with the gaps between them closed to first order.

    `extra` as in `linearise`.
    """
    base = spread_laws(forward, model, nuisance, laws)
    own_steps = _own_steps(forward, model)
    moved_values = [2, *range(4 if forward.uneven else 5, len(own_steps))]
    rows = [model] * (1 + len(STATE_STEPS) + len(moved_values))
    sizes = []
    for item in free:
        size, moved = moved_by_a_step(model, item)
        sizes.append(size)
        rows.append(moved)
    rows.extend(extra)
    sizes.extend(extra_steps)
    states = np.repeat(arcs.states[None], len(rows), axis=0)
    values = np.repeat(base[None], len(rows), axis=0)
    for column, size in enumerate(STATE_STEPS):
        states[1 + column, ..., column] += size
    for lane, column in enumerate(moved_values, 1 + len(STATE_STEPS)):
        values[lane, :, column] += own_steps[column]
    steps = np.array([*STATE_STEPS, *own_steps[moved_values], *sizes])
    seen, ends = _swung(forward, rows, arcs, states, values)
    # What ran off to infinity is as wrong as can be, and no number to step by.
    seen, ends = (np.nan_to_num(np.clip(a, -FAR, FAR), nan=FAR) for a in (seen, ends))
    slopes = np.moveaxis(seen[1:] - seen[:1], 0, -1) / steps
    transfer = np.moveaxis(ends[1:] - ends[:1], 0, -1) / steps
    if not forward.uneven:
        slopes, transfer = (np.insert(part, 3, 0.0, axis=-1) for part in (slopes, transfer))
    gaps = np.zeros_like(arcs.states)
    gaps[:, :-1] = np.where(arcs.live[:, 1:, None], ends[0, :, :-1] - arcs.states[:, 1:], 0.0)
    follow, close = _followed(transfer, gaps)
    left = np.where(
        forward.records.pendulum_used,
        forward.records.pendulum_angle - seen[0] - base[:, 3:4],
        0.0,
    )
    return _joined(forward, model, arcs, left, slopes, (gaps, follow, close))


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
    model: ForwardModel,
    arcs: Arcs,
    left: FloatArray,
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
    zero = np.ones((*left.shape, 1))
    theirs = 4 + len(model.own)
    own = np.concatenate([columns[..., :3], zero, columns[..., 3:theirs]], axis=-1)
    mine, shared = (
        np.concatenate([np.zeros((records.trials, ball, part.shape[-1])), part], axis=1)
        for part in (own * weights[..., None], columns[..., theirs:] * weights[..., None])
    )
    residual = np.concatenate([np.zeros((records.trials, ball)), (left - shift) * weights], axis=1)
    system = _with_groups(forward, model, residual, mine, shared)
    return LinearisedArcs(system, left * weights, gaps, follow, close)


def moved_arcs(
    arcs: Arcs, found: LinearisedArcs, own: FloatArray, shared: FloatArray, share: float
) -> Arcs:
    """Pieces after a share of a step.

    Parameters
    ----------
    own : (T, 5 + k) array
        Steps of the trials' own values, what their groups are moved by included.
    shared : (n,) array
        Steps of the model's parameters.
    """
    everywhere = np.broadcast_to(shared, (len(own), shared.size))
    step = np.concatenate([own[:, :3], own[:, 4:], everywhere], axis=1)
    states = (found.follow @ step[:, None, :, None])[..., 0] + found.close
    return replace(arcs, states=arcs.states + share * states)


def closed(forward: Forward, found: LinearisedArcs) -> bool:
    """Whether the pieces make one arc: what would close them moves no row by `SHUT` sigma."""
    weights = forward.records.weights[:, 3 * forward.records.ball_time.shape[1] :]
    largest = weights.max(axis=1)
    sigma = np.where(largest > 0.0, 1.0 / np.maximum(largest, 1e-12), np.inf)
    return bool(np.all(np.abs(found.close[..., 0]) < SHUT * sigma[:, None]))


def goes_with_the_rate(effect: Effect) -> bool:
    """Whether an effect is a torque that a bearing or the air takes from a swing."""
    return effect.coordinate is Coordinate.RATE and "torque" in effect.hooks


STEPS_OF_ARCS = 30

"""Steps at most: one that has not settled by then does not settle."""

MAX_WAIT = 8
"""Steps at most until damping is lowered again. Chosen; insensitive between 4 and 16."""

GAP_WEIGHT = 30.0

"""Weight of a gap between two pieces over that of a row, when steps are compared."""

ROUNDS_IN_ONE = 6

"""Steps in one arc where pieces could not be joined."""

DESCENTS = 2

"""Times that steps go on after gaps that they left were closed."""

CLOSINGS = 6

"""Newton's steps that close gaps; each squares what is left."""

CREEPING = 0.5

"""Share of its cost that a step must take away, lest a fit that is far behind be left."""

LOST = 100.0

"""Misfit in one arc over that in pieces from which a law is out of step with the record."""

STALLED = 1e-3

"""Share of the cost below which a damped step says that damping, not the record, has ended it."""

MAX_DAMPINGS = 8

"""Steps that are tried at most, each damped more than the one before."""

ALONG_BEND = (1.0, 0.5, 0.2, 0.05)

"""Shares of a whole step that are tried along its bend."""

FIRST_STEPS = 3

"""Steps after which a fit far behind another is left: Gauss and Newton have then gone most of the
distance."""

SETTLED = 0.02

"""Chi-square units below which a step ends a fit: odds then change by one per cent at most."""

UNFINISHED = 0.02

"""Share of its misfit that the last step of a fit took away, from which more would follow."""


BEYOND, MAX_BEYOND = 2.0, 0.1
"""Standard uncertainties by which a fitted strength may lie beyond what nature allows, as chance
takes it there in one case of forty; and the share of its scale that this may come to at most."""


class Ending(Enum):
    """How a fit ended."""

    CONVERGED = "converged"
    """Nothing is left to gain nearby."""

    UNFINISHED = "unfinished"
    """Steps ran out, or failed, while there was still something to gain."""

    LOST = "lost"
    """A long swing could not be followed in one arc: the law gets out of step with the record."""


@dataclass(frozen=True)
class Fit:
    """A model fitted to a campaign.

    Attributes
    ----------
    model : ForwardModel
        With its parameters at their best.
    nuisance : (T, q) array
        Trial-to-trial values, the shared laws' offsets not included.
    law_offsets : (groups, columns) array
        Offset of the COR law and of the launch angle (rad) by ball.
    chi2, penalty : float
        Σ (residual/σ)², and Σ (value/prior)² over what has a prior.
    count : int
        Entries fitted.
    expected : float
        Chi-square that noise alone would leave.
    free : tuple of Free
        What was varied.
    covariance : (n, n) array
        Of the free parameters, trial-to-trial values marginalised.
    residual : (T, M) array
        (record − prediction)/σ; zero where unused.
    arcs : Arcs, optional
        Where the pieces of a free swing ended, which the next fit may start from.
    """

    model: ForwardModel
    nuisance: FloatArray
    law_offsets: FloatArray
    chi2: float
    penalty: float
    count: int
    expected: float
    free: tuple[Free, ...]
    covariance: FloatArray
    residual: FloatArray = field(repr=False)
    ending: Ending = Ending.CONVERGED
    arcs: Arcs | None = field(default=None, repr=False)

    @property
    def objective(self) -> float:
        """What was minimised: chi2 plus penalty."""
        return self.chi2 + self.penalty

    @property
    def reduced_chi2(self) -> float:
        """Chi-square over what noise leaves, at least one: the unit of differences."""
        return max(1.0, self.chi2 / max(self.expected, 1.0))

    def value(self, index: int) -> tuple[float, float]:
        """Value and standard uncertainty of a free parameter."""
        item = self.free[index]
        value = self.model.entries[item.entry][1][item.parameter.name]
        known = item.parameter.width if item.parameter.is_known else 0.0
        return float(value), max(float(np.sqrt(max(self.covariance[index, index], 0.0))), known)

    @property
    def inside_bounds(self) -> bool:
        """Whether every free parameter lies in what nature allows, and not on the edge of it.

        What a baseline leaves open, or states, is given its own doubt: a drag that is not there is
        found a little below zero as often as above.
        """
        for index, item in enumerate(self.free):
            value, std = self.value(index)
            p = item.parameter
            edge = 1e-6 * max(abs(p.lower), abs(p.upper))
            if p.is_held or self.model.entries[item.entry][0].id == EffectId.DRAG:
                edge = max(edge, min(BEYOND * std, MAX_BEYOND * p.scale))
            if not np.isfinite(std) or not p.lower - edge <= value <= p.upper + edge:
                return False
        return True

    @property
    def may_be_inside(self) -> bool:
        """Whether what nature allows is not excluded: no strength beyond it by more than its doubt.

        Where a law is seen begin and not end, its strength and its place stand in for each other:
        on the bound, away from zero, it fits as well to less than one unit of chi-square.
        """
        for index, item in enumerate(self.free):
            (value, std), p = self.value(index), item.parameter
            doubt = 0.0 if p.is_shape else std
            below, above = (doubt if bound != p.neutral else 0.0 for bound in (p.lower, p.upper))
            if not np.isfinite(std) or not p.lower - below <= value <= p.upper + above:
                return False
        return True

    @property
    def believable(self) -> bool:
        """Whether what is named also has a size that is met in practice.

        What a baseline leaves open is held by its own width, and takes part of any misfit.
        """
        values = (
            (f.parameter, float(np.clip(self.value(k)[0], f.parameter.lower, f.parameter.upper)))
            for k, f in enumerate(self.free)
        )
        return self.inside_bounds and all(p.is_held or p.believable(v) for p, v in values)


def fit_model(
    forward: Forward,
    model: ForwardModel,
    free: Sequence[Free],
    start: tuple[FloatArray, FloatArray],
    *,
    rounds: int = 12,
    shape_priors: bool = True,
    settled: bool = False,
    swing: SwingStart = FROM_THE_RECORD,
    abandon: float = math.inf,
) -> Fit:
    """Gauss–Newton with step halving; free swings by multiple shooting.

    Parameters
    ----------
    forward : Forward
        Predictor and records.
    model : ForwardModel
        Start values of its parameters.
    free : sequence of Free
        What to vary.
    start : (nuisance, law offsets)
        (T, q) and (balls, 2) arrays.
    rounds : int
        Most steps.
    shape_priors : bool
        Hold shapes near where they start with a prior as wide as their scale.
    settled : bool
        Whether the offsets of balls and sessions stay as they are.
    swing : SwingStart
        Of free swings: the pieces to start from, and when to give up.
    abandon : float
        Of strikes and throws: objective above which a fit is left after `FIRST_STEPS` steps.

    Returns
    -------
    Fit
    """
    if forward.mode == "swing" and rounds:
        return _fit_swings(forward, model, free, start, shape_priors, settled, swing)
    return _fit_in_one(forward, model, free, start, rounds, shape_priors, settled, abandon)


def _as_they_are(system: Linearised, pull: FloatArray, groups: int) -> None:
    """Take the offsets of balls and sessions, which come first, out of a step."""
    system.shared[..., :groups] = 0.0
    pull[:groups] = 0.0


def _fit_in_one(
    forward: Forward,
    model: ForwardModel,
    free: Sequence[Free],
    start: tuple[FloatArray, FloatArray],
    rounds: int,
    shape_priors: bool,
    settled: bool,
    abandon: float = math.inf,
) -> Fit:
    nuisance, laws = fitting_start(forward, model, *start)
    anchors = np.array([_anchor(f, model) for f in free])
    own_prior, law_prior = priors(forward, model)
    n_laws = laws.size

    def penalty(nu: FloatArray, la: FloatArray, m: ForwardModel) -> float:
        flat = float(np.sum(la**2 * law_prior)) if la.size else 0.0
        kept = own_prior < 1e15
        return (
            float(np.sum(nu[:, kept] ** 2 * own_prior[kept]))
            + flat
            + float(np.sum(prior_information * (_values(m, free) - anchors) ** 2))
        )

    ((chi2, residual),) = _residuals(forward, [(nuisance, laws, model)])
    excess = max(1.0, chi2 / max(forward.records.expected, 1.0))
    prior_information = np.array(
        [_prior_information(f.parameter, excess, shape_priors) for f in free]
    )
    cost = chi2 + penalty(nuisance, laws, model)
    matrix = np.zeros((n_laws + len(free),) * 2)
    damping, ending = 0.0, Ending.UNFINISHED
    for taken in range(rounds):
        if taken >= FIRST_STEPS and cost > abandon:
            break
        system = linearise(forward, model, nuisance, laws, free)
        shared_prior = system.shared_prior.copy()
        shared_prior[n_laws:] += prior_information
        system = Linearised(system.residual, system.own, system.shared, system.prior, shared_prior)
        pull = np.concatenate([-laws.reshape(-1), -(_values(model, free) - anchors)]) * shared_prior
        if settled:
            _as_they_are(system, pull, n_laws)
        kept = own_prior < 1e15
        own_pull = np.where(kept, -nuisance * own_prior, 0.0)
        matrix, vector, inverse, cross = reduce(system, own_pull, pull)
        gradient = np.einsum("tmq,tm->tq", system.own, system.residual) + own_pull
        normal = _NormalEquations(matrix, vector, inverse, cross, gradient)
        here = _PlaceOfFit((nuisance, laws, model), cost, chi2, residual)
        found, damping = _stepped_down(forward, system, normal, here, free, penalty, damping)
        gained = cost - found.cost
        if not gained > 0.0:
            ending = Ending.CONVERGED
            break
        (nuisance, laws, model), cost, chi2, residual = (
            found.point, found.cost, found.chi2, found.residual
        )  # fmt: skip
        damping *= 0.2
        if damping < 0.01:
            damping = 0.0
        ending = Ending.CONVERGED if gained < UNFINISHED * cost else Ending.UNFINISHED
        if gained < SETTLED + 1e-7 * cost:
            break
    covariance = inverse_of(matrix)[n_laws:, n_laws:]
    return Fit(
        model, nuisance, laws, chi2, penalty(nuisance, laws, model), forward.records.count,
        forward.records.expected, tuple(free), covariance, residual, ending,
    )  # fmt: skip


Point: TypeAlias = tuple[FloatArray, FloatArray, ForwardModel]

"""Trial-to-trial values, laws' offsets, and the model."""

Step: TypeAlias = tuple[FloatArray, FloatArray]

"""Moves of the trials' own values (T, q), and of laws and shared parameters (n,)."""


@dataclass(frozen=True)
class _PlaceOfFit:
    """Where a fit stands, and what that costs."""

    point: Point
    cost: float
    chi2: float
    residual: FloatArray


@dataclass(frozen=True)
class _NormalEquations:
    """The normal equations of a step, trial-to-trial values eliminated."""

    matrix: FloatArray
    vector: FloatArray
    inverse: FloatArray
    cross: FloatArray
    gradient: FloatArray

    def step(self, damping: float = 0.0) -> Step:
        """Gauss and Newton's, damped by Levenberg and Marquardt's."""
        move = solve(self.matrix, self.vector, damping)
        pull = self.gradient - np.einsum("tqn,n->tq", self.cross, move)
        return np.einsum("tqr,tr->tq", self.inverse, pull), move


def _moved(point: Point, free: Sequence[Free], step: Step, share: float = 1.0) -> Point:
    (nuisance, laws, model), (own, move) = point, step
    return (
        nuisance + share * own, laws + share * move[: laws.size].reshape(laws.shape),
        _stepped(model, free, share * move[laws.size :]),
    )  # fmt: skip


def _stepped_down(
    forward: Forward,
    system: Linearised,
    normal: _NormalEquations,
    stand: _PlaceOfFit,
    free: Sequence[Free],
    penalty: Callable[[FloatArray, FloatArray, ForwardModel], float],
    damping: float,
) -> tuple[_PlaceOfFit, float]:
    """A better place, or the same one, and the damping that led there."""

    def at(*points: Point) -> list[_PlaceOfFit]:
        found = zip(points, _residuals(forward, points), strict=True)
        return [
            _PlaceOfFit(point, chi2 + penalty(*point), chi2, residual)
            for point, (chi2, residual) in found
        ]

    dampings = [damping]
    while len(dampings) < MAX_DAMPINGS:
        dampings.append(max(4.0 * dampings[-1], 0.05))

    def damped(by: float) -> Point:
        own, move = normal.step(by)
        return _moved(stand.point, free, (own / (1.0 + by), move))

    # Where the first step fails most others do, and together they cost little more than one.
    tried = at(damped(damping))
    if not tried[0].cost < stand.cost:
        tried += at(*(damped(by) for by in dampings[1:]))
    last = _first_below(tried, stand.cost)
    found = tried[last]
    damping = dampings[last] if found.cost < stand.cost else max(4.0 * dampings[last], 0.05)
    best = min(found, stand, key=lambda one: one.cost)
    if damping and stand.cost - best.cost < STALLED * stand.cost + 1e-3:
        # Damping holds back above all what the records hardly determine: a turned face trades
        # with the launch angle along a valley, which is followed along its bend.
        whole = normal.step()
        bend = _bend(forward, system, normal, whole, stand.point, free)
        bent = at(
            *(
                _moved(stand.point, free, (whole[0] + k * bend[0], whole[1] + k * bend[1]), k)
                for k in ALONG_BEND
            )
        )
        found = bent[_first_below(bent, best.cost)]
        if found.cost < best.cost:
            return found, 0.0
    return best, damping


def _first_below(places: Sequence[_PlaceOfFit], cost: float) -> int:
    """The first place that costs less, the last where none does."""
    return next((k for k, one in enumerate(places) if one.cost < cost), len(places) - 1)


PROBE = 0.1

"""Share of a step at which the bend of its path is measured."""


def _bend(
    forward: Forward,
    system: Linearised,
    normal: _NormalEquations,
    step: Step,
    point: Point,
    free: Sequence[Free],
) -> Step:
    """What to add to a step, times its share, so that it keeps to its valley to second order.

    Geodesic acceleration (Transtrum and Sethna, arXiv:1201.5885): one more prediction gives the
    second derivative along the step. Zero where the probe runs off.
    """
    own, move = step
    ((_, probed),) = _residuals(forward, [_moved(point, free, step, PROBE)])
    along = np.einsum("tmq,tq->tm", system.own, own) + system.shared @ move
    bent = (system.residual - PROBE * along - probed) / PROBE**2
    if not np.isfinite(bent).all():
        return np.zeros_like(own), np.zeros_like(move)
    pull = -np.einsum("tmq,tm->tq", system.own, bent)
    vector = -np.einsum("tmn,tm->n", system.shared, bent)
    vector = vector - np.einsum("tqn,tq->n", normal.inverse @ normal.cross, pull)
    return replace(normal, vector=vector, gradient=pull).step()


def _residuals(forward: Forward, points: Sequence[Point]) -> list[tuple[float, FloatArray]]:
    """Chi-square and the residuals over their noise at each of several points."""
    own = np.stack([spread_laws(forward, model, own, laws) for own, laws, model in points])
    predicted = forward.predict([model for _, _, model in points], own)
    scaled = forward.records.weighed(forward.records.values - predicted)
    return [(float(np.sum(one**2)), one) for one in scaled]


@dataclass(frozen=True)
class _PlaceOfArcs:
    """Where a fit of pieces stands, and what that costs."""

    point: Point
    arcs: Arcs
    found: LinearisedArcs
    cost: float

    @property
    def chi2(self) -> float:
        """Of the pieces as they are, gaps and all."""
        return float(np.sum(self.found.residual**2))


@dataclass(frozen=True)
class _SwingFit:
    """Free swings to be fitted in pieces: what may be varied, and what holds it."""

    forward: Forward
    free: Sequence[Free]
    anchors: FloatArray
    prior: FloatArray
    own_prior: FloatArray
    law_prior: FloatArray
    settled: bool

    def penalty(self, point: Point) -> float:
        """How far values are from what was known of them."""
        nuisance, laws, model = point
        own = float(np.sum(nuisance**2 * np.where(self.own_prior < 1e15, self.own_prior, 0.0)))
        groups = float(np.sum(laws**2 * self.law_prior)) if laws.size else 0.0
        off = _values(model, self.free) - self.anchors
        return own + groups + float(np.sum(self.prior * off**2))

    def _centred(self, point: Point) -> Point:
        """The same losses of each release, reported as shares of what they lose on average.

        Far off the noise nothing else keeps strengths from being halved and all shares doubled.
        """
        nuisance, laws, model = point
        lossy = {k for k, (effect, _) in enumerate(model.entries) if goes_with_the_rate(effect)}
        place = NUISANCES["swing"].index("losses")
        level = 1.0 + float(np.mean(nuisance[:, place]))
        mine = [f for f in self.free if f.entry in lossy and not f.parameter.is_shape]
        if not self.forward.uneven or level <= 0.0 or {f.entry for f in mine} != lossy:
            return point
        nuisance = nuisance.copy()
        nuisance[:, place] = (1.0 + nuisance[:, place]) / level - 1.0
        entries = [(effect, dict(values)) for effect, values in model.entries]
        for item in mine:
            entries[item.entry][1][item.parameter.name] *= level
        return nuisance, laws, replace(model, entries=tuple(entries))

    def at(self, point: Point, arcs: Arcs) -> _PlaceOfArcs:
        """The place of some values; each record's first state is that of its first piece."""
        nuisance, laws, model = self._centred(point)
        nuisance = np.concatenate([arcs.states[:, 0], nuisance[:, 2:]], axis=1)
        point = nuisance, laws, model
        found = linearise_arcs(self.forward, model, arcs, nuisance, laws, self.free)
        records = self.forward.records
        rows = records.count / max(1, arcs.states[..., 0].size)
        scale = np.array([1.0, 1.0 / self.forward.small_rate]) * float(records.weights.max())
        gaps = GAP_WEIGHT * rows * float(np.sum((found.gaps * scale) ** 2))
        cost = float(np.sum(found.residual**2)) + gaps + self.penalty(point)
        return _PlaceOfArcs(point, arcs, found, cost)

    def moved(self, place: _PlaceOfArcs, step: Step, share: float) -> _PlaceOfArcs:
        """The place after a share of a step."""
        (_, laws, model), (own, move) = place.point, step
        groups, shared = move[: laws.size].reshape(laws.shape), move[laws.size :]
        together = spread_laws(self.forward, model, own, groups)
        arcs = moved_arcs(place.arcs, place.found, together, shared, share)
        return self.at(_moved(place.point, self.free, step, share), arcs)

    def normal(self, place: _PlaceOfArcs) -> _NormalEquations:
        """The step's equations about a place."""
        nuisance, laws, model = place.point
        shared_prior = place.found.system.shared_prior.copy()
        shared_prior[laws.size :] += self.prior
        system = replace(place.found.system, shared_prior=shared_prior)
        off = _values(model, self.free) - self.anchors
        pull = -np.concatenate([laws.reshape(-1), off]) * shared_prior
        if self.settled:
            _as_they_are(system, pull, laws.size)
        own_pull = np.where(self.own_prior < 1e15, -nuisance * self.own_prior, 0.0)
        matrix, vector, inverse, cross = reduce(system, own_pull, pull)
        gradient = np.einsum("tmq,tm->tq", system.own, system.residual) + own_pull
        return _NormalEquations(matrix, vector, inverse, cross, gradient)

    def covariance(self, place: _PlaceOfArcs, excess: float) -> FloatArray:
        """(n, n) of the free parameters, which readers widen by a misfit of `excess`.

        How unevenly releases lose was determined with the misfit counted as noise: it is not to be
        widened once more.
        """
        prior = place.found.system.prior.copy()
        prior[NUISANCES["swing"].index("losses")] *= excess
        found = replace(place.found, system=replace(place.found.system, prior=prior))
        laws = place.point[1].size
        return inverse_of(self.normal(replace(place, found=found)).matrix)[laws:, laws:]

    def descended(self, place: _PlaceOfArcs, start: SwingStart) -> tuple[_PlaceOfArcs, bool]:
        """Where steps end, and whether they were given up.

        Damping that had to be taken back is lowered later the next time.
        """
        damping, hopeless, calm, wait = 0.0, start.hopeless, 0, 1
        for left in reversed(range(STEPS_OF_ARCS)):
            normal, before = self.normal(place), damping
            settled = SETTLED + 1e-6 * place.cost
            for _ in range(8):
                moved = self.moved(place, normal.step(damping), 1.0 / (1.0 + damping))
                if moved.cost < place.cost + settled:
                    break
                damping = max(4.0 * damping, 0.25)
            gained = place.cost - moved.cost
            place = moved if gained > 0.0 else place
            if gained < settled:
                break
            calm = calm + 1 if damping == before else 0
            wait = min(2 * wait, MAX_WAIT) if damping > before else wait
            if calm >= wait:
                damping, calm = (0.0 if damping < 0.3 else 0.2 * damping), 0
            if place.cost > hopeless and gained < CREEPING * place.cost:
                return place, True
            if left < STEPS_OF_ARCS - FIRST_STEPS and place.cost - left * gained > start.least:
                return place, True
        return place, place.cost > min(hopeless, start.least)

    def shut(self, place: _PlaceOfArcs) -> _PlaceOfArcs:
        """The same values with the gaps closed, as far as Newton's steps close them."""
        nuisance, laws, _ = place.point
        still = np.zeros_like(nuisance), np.zeros(laws.size + len(self.free))
        for _ in range(CLOSINGS):
            if closed(self.forward, place.found):
                break
            place = self.moved(place, still, 1.0)
        return place


def _fit_swings(
    forward: Forward,
    model: ForwardModel,
    free: Sequence[Free],
    begun: tuple[FloatArray, FloatArray],
    shape_priors: bool,
    settled: bool,
    start: SwingStart,
) -> Fit:
    """Multiple shooting: states of all pieces start from the record, or from those of a fit."""
    prior = np.array([_prior_information(f.parameter, 1.0, shape_priors) for f in free])
    own_prior, law_prior = priors(forward, model)
    anchors = np.array([_anchor(f, model) for f in free])
    pieces = _SwingFit(forward, free, anchors, prior, own_prior, law_prior, settled)
    nuisance, laws = fitting_start(forward, model, *begun)
    arcs = arcs_of(forward, nuisance) if start.arcs is None else start.arcs
    place = pieces.at((nuisance, laws, model), arcs)
    apart = np.inf
    for _ in range(DESCENTS):
        place, left = pieces.descended(place, start)
        apart = min(apart, place.chi2)
        if left:
            return _fit_of(pieces, place, Ending.LOST)
        if closed(forward, place.found):
            return _fit_of(pieces, place, Ending.CONVERGED)
        place = pieces.shut(place)
        if not closed(forward, place.found):
            break
    least = LOST * max(apart, forward.records.expected)
    if closed(forward, place.found):
        return _fit_of(pieces, place, Ending.LOST if place.chi2 > least else Ending.UNFINISHED)
    nuisance, laws, model = place.point
    whole = _fit_in_one(
        forward, model, free, (nuisance, laws), ROUNDS_IN_ONE, shape_priors, settled
    )
    return replace(whole, ending=Ending.LOST if whole.chi2 > least else whole.ending)


def _fit_of(pieces: _SwingFit, place: _PlaceOfArcs, ending: Ending) -> Fit:
    """The fit at a place; what closes the last gaps, a tenth of sigma, is taken to first order."""
    records, residual = pieces.forward.records, place.found.system.residual
    nuisance, laws, model = place.point
    chi2 = float(np.sum(residual**2))
    if ending is Ending.LOST:
        # Far apart, pieces that are closed to first order say nothing.
        chi2 = max(place.cost, chi2)
    excess = max(1.0, chi2 / max(records.expected, 1.0))
    covariance = pieces.covariance(place, excess)
    return Fit(
        model, nuisance, laws, chi2, pieces.penalty(place.point), records.count, records.expected,
        tuple(pieces.free), covariance, residual, ending, place.arcs,
    )  # fmt: skip


def _values(model: ForwardModel, free: Sequence[Free]) -> FloatArray:
    return np.array([model.entries[f.entry][1][f.parameter.name] for f in free])


def _anchor(item: Free, model: ForwardModel) -> float:
    expected = item.parameter.expected
    held = model.entries[item.entry][1][item.parameter.name]
    return float(held) if expected is None else expected


def _prior_information(p: Parameter, excess: float, shape_priors: bool) -> float:
    """Inverse variance of a parameter's prior, as much too sure of itself as the misfit is."""
    if p.is_held:
        return 1.0 / p.width**2
    if p.expected is not None:
        return excess / p.width**2
    return p.scale**-2 if p.is_shape and shape_priors else 0.0


def _stepped(model: ForwardModel, free: Sequence[Free], moves: FloatArray) -> ForwardModel:
    entries = [(effect, dict(values)) for effect, values in model.entries]
    for item, move in zip(free, moves, strict=True):
        p = item.parameter
        values = entries[item.entry][1]
        # Ten scales at once is further than a linear step can be trusted.
        reach = 40.0 * p.scale if not p.is_shape else 1.0 * p.scale
        new = values[p.name] + float(np.clip(move, -reach, reach))
        if p.is_shape:
            new = float(np.clip(new, p.lower, p.upper))
        values[p.name] = new
    return replace(model, entries=tuple(entries))
