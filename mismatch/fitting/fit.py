"""Least squares over trial-to-trial values and shared parameters together."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from mismatch.fitting.normal_equations import (
    Free,
    Linearised,
    fitting_start,
    inverse_of,
    linearise,
    priors,
    reduce,
    solve,
    spread_laws,
)
from mismatch.fitting.shooting import LinearisedArcs, arcs_of, closed, linearise_arcs, moved_arcs
from mismatch.model.forward import Forward, Model
from physics.domain import FloatArray
from physics.effects import Parameter

__all__ = ["Ending", "Fit", "fit_model"]

STEPS_OF_ARCS = 30
"""Steps at most: one that has not settled by then does not settle."""
GAP_WEIGHT = 30.0
"""Weight of a gap between two pieces over that of a row, when steps are compared."""

ROUNDS_IN_ONE = 6
"""Steps in one arc where pieces could not be joined."""

LOST = 100.0
"""Misfit in one arc over that in pieces from which a law is out of step with the record."""

UNFINISHED = 0.02
"""Share of its misfit that the last step of a fit took away, from which more would follow."""


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
    expected : float
        Chi-square that noise alone would leave.
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
    expected: float
    free: tuple[Free, ...]
    covariance: FloatArray
    residual: FloatArray = field(repr=False)
    ending: Ending = Ending.CONVERGED

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


def fit_model(
    forward: Forward,
    model: Model,
    free: Sequence[Free],
    start: tuple[FloatArray, FloatArray],
    *,
    rounds: int = 12,
    shape_priors: bool = True,
) -> Fit:
    """Gauss–Newton with step halving; free swings by multiple shooting.

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
    if forward.mode == "swing" and rounds:
        return _fit_swings(forward, model, free, start[0], shape_priors)
    return _fit_in_one(forward, model, free, start, rounds, shape_priors)


def _fit_in_one(
    forward: Forward,
    model: Model,
    free: Sequence[Free],
    start: tuple[FloatArray, FloatArray],
    rounds: int,
    shape_priors: bool,
) -> Fit:
    nuisance, laws = fitting_start(forward, model, *start)
    anchors = np.array([_anchor(f, model) for f in free])
    own_prior, law_prior = priors(forward, model)
    n_laws = laws.size

    def values(m: Model) -> FloatArray:
        return np.array([m.entries[f.entry][1][f.parameter.name] for f in free])

    def penalty(nu: FloatArray, la: FloatArray, m: Model) -> float:
        flat = float(np.sum(la**2 * law_prior)) if la.size else 0.0
        kept = own_prior < 1e15
        return (
            float(np.sum(nu[:, kept] ** 2 * own_prior[kept]))
            + flat
            + float(np.sum(prior_information * (values(m) - anchors) ** 2))
        )

    def residuals(nu: FloatArray, la: FloatArray, m: Model) -> tuple[float, FloatArray]:
        predicted = forward.predict([m], spread_laws(forward, m, nu, la)[None])[0]
        scaled = (forward.records.values - predicted) * forward.records.weights
        return float(np.sum(scaled**2)), scaled

    chi2, residual = residuals(nuisance, laws, model)
    excess = max(1.0, chi2 / max(forward.records.expected, 1.0))
    prior_information = np.array(
        [_prior_information(f.parameter, excess, shape_priors) for f in free]
    )
    cost = chi2 + penalty(nuisance, laws, model)
    matrix = np.zeros((n_laws + len(free),) * 2)
    damping, ending = 0.0, Ending.UNFINISHED
    for _ in range(rounds):
        system = linearise(forward, model, nuisance, laws, free)
        shared_prior = system.shared_prior.copy()
        shared_prior[n_laws:] += prior_information
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
            new_chi2, new_residual = residuals(trial_nu, trial_laws, trial_model)
            new_cost = new_chi2 + penalty(trial_nu, trial_laws, trial_model)
            if new_cost < cost:
                improved = True
                break
            damping = max(4.0 * damping, 0.05)
        gained = cost - new_cost
        if not improved:
            ending = Ending.CONVERGED
            break
        nuisance, laws, model = trial_nu, trial_laws, trial_model
        chi2, residual, cost = new_chi2, new_residual, new_cost
        damping *= 0.2
        if damping < 0.01:
            damping = 0.0
        if gained < UNFINISHED * cost:
            ending = Ending.CONVERGED
        if gained < 1e-3 + 1e-7 * cost:
            break
    covariance = inverse_of(matrix)[n_laws:, n_laws:]
    return Fit(
        model, nuisance, laws, chi2, penalty(nuisance, laws, model), forward.records.count,
        forward.records.expected, tuple(free), covariance, residual, ending,
    )  # fmt: skip


def _fit_swings(
    forward: Forward,
    model: Model,
    free: Sequence[Free],
    nuisance: FloatArray,
    shape_priors: bool,
) -> Fit:
    """Multiple shooting: states of all pieces start from the record, whatever the start was."""
    anchors, prior_information = (
        _values(model, free),
        np.array([_prior_information(f.parameter, 1.0, shape_priors) for f in free]),
    )
    own_prior, _ = priors(forward, model)
    arcs = arcs_of(forward, nuisance)
    nuisance = np.concatenate([arcs.states[:, 0], nuisance[:, 2:]], axis=1)
    found = linearise_arcs(forward, model, arcs, nuisance, free)
    rows = forward.records.count / max(1, arcs.states[..., 0].size)
    scale = np.array([1.0, 1.0 / forward.small_rate]) * float(forward.records.weights.max())

    def merit(trial: LinearisedArcs, nu: FloatArray, m: Model) -> float:
        gaps = GAP_WEIGHT * rows * float(np.sum((trial.gaps * scale) ** 2))
        held = float(np.sum(nu**2 * np.where(own_prior < 1e15, own_prior, 0.0)))
        return (
            float(np.sum(trial.residual**2))
            + gaps
            + held
            + float(np.sum(prior_information * (_values(m, free) - anchors) ** 2))
        )

    cost, damping = merit(found, nuisance, model), 0.0
    matrix = np.zeros((len(free),) * 2)
    for _ in range(STEPS_OF_ARCS):
        system = replace(found.system, prior=own_prior, shared_prior=prior_information)
        pull = -(_values(model, free) - anchors) * prior_information
        own_pull = np.where(own_prior < 1e15, -nuisance * own_prior, 0.0)
        matrix, vector, inverse, cross = reduce(system, own_pull, pull)
        gradient = np.einsum("tmq,tm->tq", system.own, system.residual) + own_pull
        for _ in range(8):
            move = solve(matrix, vector, damping)
            own = np.einsum("tqr,tr->tq", inverse, gradient - np.einsum("tqn,n->tq", cross, move))
            share = 1.0 / (1.0 + damping)
            nu = nuisance + own * share
            stepped = _stepped(model, free, move * share)
            trial_arcs = moved_arcs(arcs, found, own, move, share)
            trial = linearise_arcs(forward, stepped, trial_arcs, nu, free)
            new = merit(trial, nu, stepped)
            if new < cost:
                break
            damping = max(4.0 * damping, 0.25)
        else:
            break
        gained, cost = cost - new, new
        nuisance, model, arcs, found = nu, stepped, trial_arcs, trial
        nuisance[:, :2] = arcs.states[:, 0]
        damping = 0.0 if damping < 0.3 else 0.2 * damping
        if gained < 1e-3 + 1e-6 * cost:
            break
    found_all = closed(forward, found)
    whole = _fit_in_one(
        forward, model, () if found_all else free, (nuisance, np.zeros((0, 2))),
        0 if found_all else ROUNDS_IN_ONE, shape_priors,
    )  # fmt: skip
    if not found_all:
        lost = whole.chi2 > LOST * max(float(np.sum(found.residual**2)), whole.expected)
        return replace(whole, ending=Ending.LOST if lost else whole.ending)
    penalty = whole.penalty + float(
        np.sum(prior_information * (_values(model, free) - anchors) ** 2)
    )
    return replace(
        whole, penalty=penalty, free=tuple(free), covariance=inverse_of(matrix),
        ending=Ending.CONVERGED,
    )  # fmt: skip


def _values(model: Model, free: Sequence[Free]) -> FloatArray:
    return np.array([model.entries[f.entry][1][f.parameter.name] for f in free])


def _anchor(item: Free, model: Model) -> float:
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
    return replace(model, entries=tuple(entries))
