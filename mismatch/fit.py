"""Least squares over trial-to-trial values and shared parameters together.

The trial-to-trial values enter one trial each, so they are eliminated trial by trial (a Schur
complement); what is left is a small system in the parameters that the trials share.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mismatch.forward import NUISANCES, Forward
from mismatch.model import Model
from physics.arrays import FloatArray
from physics.effects import Effect, Parameter

__all__ = [
    "Fit",
    "Free",
    "Linearised",
    "fit_model",
    "free_parameters",
    "linearise",
]

NUISANCE_STEP = 1e-5
STEP_SHARE = 1e-3


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


@dataclass(frozen=True)
class Fit:
    """A model fitted to a campaign.

    Attributes
    ----------
    model : Model
        With its parameters at their best.
    nuisance : (T, q) array
        Trial-to-trial values, the shared laws' offsets not included.
    law_offsets : (balls, 2) array
        Offset of the COR law and of the launch angle (rad) by ball.
    chi2, penalty : float
        Σ (residual/σ)², and Σ (value/prior)² over what has a prior.
    count : int
        Entries fitted.
    free : tuple of Free
        What was varied.
    covariance : (n, n) array
        Of the free parameters, trial-to-trial values marginalised.
    residual : (T, M) array
        (record − prediction)/σ; zero where unused.
    """

    model: Model
    nuisance: FloatArray
    law_offsets: FloatArray
    chi2: float
    penalty: float
    count: int
    free: tuple[Free, ...]
    covariance: FloatArray
    residual: FloatArray = field(repr=False)

    @property
    def objective(self) -> float:
        """What was minimised: chi2 plus penalty."""
        return self.chi2 + self.penalty

    def value(self, index: int) -> tuple[float, float]:
        """Value and standard uncertainty of a free parameter."""
        item = self.free[index]
        value = self.model.entries[item.entry][1][item.parameter.name]
        known = 0.0 if item.parameter.expected is None else item.parameter.width
        return float(value), max(float(np.sqrt(max(self.covariance[index, index], 0.0))), known)

    @property
    def inside_bounds(self) -> bool:
        """Whether every free parameter lies in what nature allows, and not on the edge of it."""
        for index, item in enumerate(self.free):
            value, std = self.value(index)
            p = item.parameter
            edge = 1e-6 * max(abs(p.lower), abs(p.upper))
            if not np.isfinite(std) or not p.lower - edge <= value <= p.upper + edge:
                return False
        return True

    @property
    def believable(self) -> bool:
        """Whether every free parameter also has a size that is met in practice."""
        return self.inside_bounds and all(
            item.parameter.believable(self.value(index)[0]) for index, item in enumerate(self.free)
        )


def free_parameters(model: Model, effects: Sequence[Effect] | None = None) -> tuple[Free, ...]:
    """Every parameter of the named effects of a model (of all of them by default)."""
    return tuple(
        Free(index, parameter)
        for index, (effect, _) in enumerate(model.entries)
        if effects is None or any(effect is one for one in effects)
        for parameter in effect.parameters
    )


def priors(forward: Forward) -> tuple[FloatArray, FloatArray]:
    """Inverse prior variances of the trial-to-trial values, and of the two law offsets."""
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
        own, laws = np.array([np.inf, np.inf, scatter.natural_frequency]), np.zeros(0)
    return 1.0 / np.maximum(own, 1e-12) ** 2, 1.0 / np.maximum(laws, 1e-12) ** 2


def spread_laws(forward: Forward, nuisance: FloatArray, laws: FloatArray) -> FloatArray:
    """Add each ball's law offsets to its trials' own values."""
    if forward.mode != "impact":
        return nuisance
    total = nuisance.copy()
    total[:, 2:4] += laws[forward.records.ball_index]
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
    base = spread_laws(forward, nuisance, laws)
    q = len(NUISANCES[forward.mode])
    steps = _own_steps(forward)
    lanes: list[Model] = [model] * (1 + q)
    own = np.repeat(base[None], 1 + q, axis=0)
    for column in range(q):
        own[1 + column, :, column] += steps[column]
    sizes: list[float] = []
    for item in free:
        step, moved = _moved(model, item)
        sizes.append(step)
        lanes.append(moved)
    lanes.extend(extra)
    sizes.extend(extra_steps)
    own = np.concatenate([own, np.repeat(base[None], len(lanes) - 1 - q, axis=0)])
    predicted = forward.predict(lanes, own)
    weights = forward.records.weights
    residual = (forward.records.values - predicted[0]) * weights
    slopes = (predicted[1:] - predicted[:1]) * weights
    mine = np.moveaxis(slopes[:q], 0, -1) / steps
    theirs = np.moveaxis(slopes[q:], 0, -1) / np.array(sizes or [1.0])[: len(sizes)]
    own_prior, law_prior = priors(forward)
    parts, shared_prior = [], [np.zeros(len(sizes))]
    if forward.mode == "impact":
        for index in range(len(forward.records.ball_names)):
            mask = (forward.records.ball_index == index)[:, None, None]
            parts.append(np.where(mask, mine[..., 2:4], 0.0))
            shared_prior.insert(0, law_prior)
    parts.append(theirs)
    return Linearised(
        residual, mine, np.concatenate(parts, axis=-1), own_prior, np.concatenate(shared_prior)
    )


def _own_steps(forward: Forward) -> FloatArray:
    if forward.mode == "impact":
        return np.array([1e-5, 1e-4, 1e-4, 1e-4])
    if forward.mode == "flight":
        return np.array([1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3])
    return np.array([1e-5, 1e-4, 1e-5])


def _moved(model: Model, item: Free) -> tuple[float, Model]:
    effect, values = model.entries[item.entry]
    parameter = item.parameter
    step = STEP_SHARE * parameter.scale
    if values[parameter.name] + step > parameter.upper:
        step = -step
    moved = dict(values) | {parameter.name: values[parameter.name] + step}
    entries = list(model.entries)
    entries[item.entry] = (effect, moved)
    return step, Model(tuple(entries))


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


def fit_model(
    forward: Forward,
    model: Model,
    free: Sequence[Free],
    start: tuple[FloatArray, FloatArray],
    *,
    rounds: int = 12,
    shape_priors: bool = True,
) -> Fit:
    """Gauss–Newton with step halving.

    Parameters
    ----------
    forward : Forward
        Predictor and records.
    model : Model
        Start values of its parameters.
    free : sequence of Free
        What to vary.
    start : (nuisance, law offsets)
        (T, q) and (balls, 2) arrays.
    rounds : int
        Most steps.
    shape_priors : bool
        Hold shapes near where they start with a prior as wide as their scale.

    Returns
    -------
    Fit
    """
    nuisance, laws = start
    anchors = np.array([_anchor(f, model) for f in free])
    own_prior, law_prior = priors(forward)
    n_laws = laws.size

    def values(m: Model) -> FloatArray:
        return np.array([m.entries[f.entry][1][f.parameter.name] for f in free])

    def penalty(nu: FloatArray, la: FloatArray, m: Model) -> float:
        flat = float(np.sum(la**2 * law_prior)) if la.size else 0.0
        kept = own_prior < 1e15
        return (
            float(np.sum(nu[:, kept] ** 2 * own_prior[kept]))
            + flat
            + float(np.sum(holds * (values(m) - anchors) ** 2))
        )

    def misfit(nu: FloatArray, la: FloatArray, m: Model) -> tuple[float, FloatArray]:
        predicted = forward.predict([m], spread_laws(forward, nu, la)[None])[0]
        scaled = (forward.records.values - predicted) * forward.records.weights
        return float(np.sum(scaled**2)), scaled

    chi2, residual = misfit(nuisance, laws, model)
    excess = max(1.0, chi2 / max(forward.records.count, 1))
    holds = np.array([_hold(f.parameter, excess, shape_priors) for f in free])
    cost = chi2 + penalty(nuisance, laws, model)
    matrix = np.zeros((n_laws + len(free),) * 2)
    damping = 0.0
    for _ in range(rounds):
        system = linearise(forward, model, nuisance, laws, free)
        shared_prior = system.shared_prior.copy()
        shared_prior[n_laws:] += holds
        system = Linearised(system.residual, system.own, system.shared, system.prior, shared_prior)
        pull = np.concatenate([-laws.reshape(-1), -(values(model) - anchors)]) * shared_prior
        kept = own_prior < 1e15
        own_pull = np.where(kept, -nuisance * own_prior, 0.0)
        matrix, vector, inverse, cross = reduce(system, own_pull, pull)
        gradient = np.einsum("tmq,tm->tq", system.own, system.residual) + own_pull
        improved = False
        for _ in range(8):
            move = solve(matrix, vector, damping)
            own_move = np.einsum(
                "tqr,tr->tq", inverse, gradient - np.einsum("tqn,n->tq", cross, move)
            )
            trial_nu = nuisance + own_move * (1.0 / (1.0 + damping))
            trial_laws = laws + move[:n_laws].reshape(laws.shape)
            trial_model = _stepped(model, free, move[n_laws:])
            new_chi2, new_residual = misfit(trial_nu, trial_laws, trial_model)
            new_cost = new_chi2 + penalty(trial_nu, trial_laws, trial_model)
            if new_cost < cost:
                improved = True
                break
            damping = max(4.0 * damping, 0.05)
        gained = cost - new_cost
        if not improved:
            break
        nuisance, laws, model = trial_nu, trial_laws, trial_model
        chi2, residual, cost = new_chi2, new_residual, new_cost
        damping *= 0.2
        if damping < 0.01:
            damping = 0.0
        if gained < 1e-3 + 1e-7 * cost:
            break
    covariance = inverse_of(matrix)[n_laws:, n_laws:]
    return Fit(
        model, nuisance, laws, chi2, penalty(nuisance, laws, model), forward.records.count,
        tuple(free), covariance, residual,
    )  # fmt: skip


def _anchor(item: Free, model: Model) -> float:
    expected = item.parameter.expected
    held = model.entries[item.entry][1][item.parameter.name]
    return float(held) if expected is None else expected


def _hold(p: Parameter, excess: float, shape_priors: bool) -> float:
    """Inverse variance that holds a parameter, as much too sure of itself as the misfit is."""
    if p.expected is not None:
        return excess / p.width**2
    return p.scale**-2 if p.is_shape and shape_priors else 0.0


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


def _stepped(model: Model, free: Sequence[Free], moves: FloatArray) -> Model:
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
    return Model(tuple(entries))
