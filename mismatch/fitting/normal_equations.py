"""Normal equations around a point: the prediction's derivatives, and the system they make.

The trial-to-trial values enter one trial each, so they are eliminated trial by trial (a Schur
complement); what is left is a small system in the parameters that the trials share.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mismatch.model.forward import NUISANCES, Forward, Model
from physics.domain import FloatArray
from physics.effects import Effect, Level, Parameter

__all__ = [
    "Free",
    "Linearised",
    "ball_columns",
    "fitting_start",
    "free_parameters",
    "inverse_of",
    "linearise",
    "moved_by_a_step",
    "priors",
    "reduce",
    "solve",
    "spread_laws",
]

NUISANCE_STEP = 1e-5
"""Share of a nuisance's width per step of a difference: far above rounding, far below where it
bends."""
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
        Derivatives by the shared parameters: two per ball (impact mode), then the model's.
    prior : (q,) array, and
    shared_prior : (n,) array
        Inverse variances.
    """

    residual: FloatArray
    own: FloatArray
    shared: FloatArray
    prior: FloatArray
    shared_prior: FloatArray


def free_parameters(model: Model, effects: Sequence[Effect] | None = None) -> tuple[Free, ...]:
    """Every parameter of the named effects of a model (of all of them by default)."""
    return tuple(
        Free(index, parameter)
        for index, (effect, _) in enumerate(model.entries)
        if effects is None or any(effect is one for one in effects)
        for parameter in effect.parameters
    )


def priors(forward: Forward, model: Model) -> tuple[FloatArray, FloatArray]:
    """Inverse prior variances of the trial-to-trial values, and of each ball's offsets.

    Those of the model's own strengths come last; what a ball's trials share is no trial's own.
    """
    scatter = forward.baseline.scatter
    if forward.mode == "impact":
        own = np.array([np.inf, scatter.backswing, scatter.cor, scatter.launch_angle])
        laws = np.array([scatter.cor_law, scatter.launch_angle_law])
    elif forward.mode == "flight":
        measured = forward.records.ball_used.any(axis=(0, 1))
        # A coordinate nobody measured keeps what it starts with.
        free = np.where(measured, np.inf, 1e-9)
        own, laws = np.concatenate([free, free]), np.zeros(0)
    else:
        own = np.array([np.inf, np.inf, scatter.natural_frequency, scatter.angle_zero])
        laws = np.zeros(0)
    mine = [one.spread if one.level is Level.TRIAL else 0.0 for one in model.own]
    balls = [one.spread for one in model.own if one.level is Level.BALL]
    own, laws = np.concatenate([own, mine]), np.concatenate([laws, balls])
    return 1.0 / np.maximum(own, 1e-12) ** 2, 1.0 / np.maximum(laws, 1e-12) ** 2


def ball_columns(forward: Forward, model: Model) -> tuple[int, ...]:
    """Columns of the trial-to-trial values that the trials of a ball share an offset of."""
    first = len(NUISANCES[forward.mode])
    laws = (2, 3) if forward.mode == "impact" else ()
    shared = (first + k for k, one in enumerate(model.own) if one.level is Level.BALL)
    return (*laws, *shared)


def fitting_start(
    forward: Forward, model: Model, nuisance: FloatArray, laws: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Start values in the shape that a model needs: its further own strengths start at the mean."""
    own = len(NUISANCES[forward.mode]) + len(model.own)
    shape = (len(forward.records.ball_names), len(ball_columns(forward, model)))
    if not shape[1]:
        shape = (0, 0)
    wide, offsets = np.zeros((forward.records.trials, own)), np.zeros(shape)
    held = min(own, nuisance.shape[1])
    wide[:, :held] = nuisance[:, :held]
    if laws.size and offsets.size:
        kept = min(shape[1], laws.shape[1])
        offsets[:, :kept] = laws[:, :kept]
    return wide, offsets


def spread_laws(
    forward: Forward, model: Model, nuisance: FloatArray, laws: FloatArray
) -> FloatArray:
    """Add each ball's offsets to its trials' own values."""
    if not laws.size:
        return nuisance
    total = nuisance.copy()
    total[:, list(ball_columns(forward, model))] += laws[forward.records.ball_index]
    return total


def linearise(
    forward: Forward,
    model: Model,
    nuisance: FloatArray,
    laws: FloatArray,
    free: Sequence[Free],
    extra: Sequence[Model] = (),
    extra_steps: Sequence[float] = (),
) -> Linearised:
    """Residuals and derivatives around a point.

    `extra` models each differ from `model` by one small step of one further parameter; their
    columns come after those of `free`.
    """
    base = spread_laws(forward, model, nuisance, laws)
    steps = _own_steps(forward, model)
    q = len(steps)
    rows: list[Model] = [model] * (1 + q)
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
    weights = forward.records.weights
    residual = (forward.records.values - predicted[0]) * weights
    slopes = (predicted[1:] - predicted[:1]) * weights
    mine = np.moveaxis(slopes[:q], 0, -1) / steps
    theirs = np.moveaxis(slopes[q:], 0, -1) / np.array(sizes or [1.0])[: len(sizes)]
    own_prior, law_prior = priors(forward, model)
    parts, shared_prior = [], [np.zeros(len(sizes))]
    columns = list(ball_columns(forward, model))
    if columns:
        for index in range(len(forward.records.ball_names)):
            mask = (forward.records.ball_index == index)[:, None, None]
            parts.append(np.where(mask, mine[..., columns], 0.0))
            shared_prior.insert(0, law_prior)
    parts.append(theirs)
    return Linearised(
        residual, mine, np.concatenate(parts, axis=-1), own_prior, np.concatenate(shared_prior)
    )


def _own_steps(forward: Forward, model: Model) -> FloatArray:
    if forward.mode == "impact":
        steps = [1e-5, 1e-4, 1e-4, 1e-4]
    elif forward.mode == "flight":
        steps = [1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3]
    else:
        steps = [1e-5, 1e-4, 1e-5, 1e-5]
    for one in model.own:
        steps += [STEP_SHARE * p.scale for p in one.effect.strengths if p.name == one.name]
    return np.array(steps)


def moved_by_a_step(model: Model, item: Free) -> tuple[float, Model]:
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
    # A tiny ridge relative to each diagonal keeps directions that no row sees out of the way.
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
