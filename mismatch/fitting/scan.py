"""Score every candidate at once: how much chi-square would each, or each pair, take away.

Around a fitted model the records are linear in small strengths, and everything the fit may still
change (trial-to-trial values, the laws' offsets, parameters already in the model) is projected out.

How well fitted parameters are known where the law behind them is not quite right.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.stats import chi2

from mismatch.fitting.fit import Fit
from mismatch.fitting.levels import grouped, marginal_by_trial, scatter_evidence
from mismatch.fitting.normal_equations import Linearised, inverse_of, linearise, priors, reduce
from mismatch.model.candidates import Candidate, start_values, steps_of
from mismatch.model.forward import Forward, Model
from physics.domain import FloatArray
from physics.effects import Level

__all__ = [
    "Heterogeneity",
    "Scan",
    "heterogeneity",
    "price",
    "robust_spread",
    "scan",
    "trial_pulls",
]

LANES_AT_ONCE = 48
"""Trajectories integrated at once, so that their states stay within a processor's cache."""

WIDTHS = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)

"""Widths of the priors of curves that are looked at, in units of the declared one."""


@dataclass(frozen=True)
class Scan:
    """Information and score of the candidates' strengths around a fit.

    Attributes
    ----------
    candidates : tuple of Candidate
        What was scored.
    columns : tuple of tuple of int
        Which columns belong to each.
    information : (n, n) array
        Fisher information of all columns, everything else marginalised.
    score : (n,) array
        Gradient of the log likelihood; information⁻¹ score is the estimate.
    start : (n,) array
        Value of each strength in the model the scan starts from.
    scattered : (candidates,) array
        Evidence of strengths that scatter from ball to ball or trial to trial about where they
        start, over none; nought for those that all trials share.
    """

    candidates: tuple[Candidate, ...]
    columns: tuple[tuple[int, ...], ...]
    information: FloatArray
    score: FloatArray
    start: FloatArray
    scattered: FloatArray = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def prior(self) -> FloatArray:
        """(n,) inverse variances of weights that a prior holds near nothing; 0 for the others."""
        held = [p for one in self.candidates for p in one.effect.strengths]
        return np.array([1.0 / p.width**2 if p.is_held else 0.0 for p in held])

    def with_likely_widths(self) -> "Scan":
        """The scan with each curve's prior as wide as gives the highest evidence."""
        chosen = []
        for candidate, columns in zip(self.candidates, self.columns, strict=True):
            strengths = candidate.effect.strengths
            if not strengths or not all(p.is_held for p in strengths):
                chosen.append(candidate)
                continue
            which = np.array(columns)
            block, score = self.information[np.ix_(which, which)], self.score[which]
            held = self.prior[which]
            factor = max(WIDTHS, key=lambda k: _evidence(block, score, held / k**2))
            wider = tuple(
                replace(p, width=factor * p.width) if p.is_held else p
                for p in candidate.effect.parameters
            )
            chosen.append(replace(candidate, effect=replace(candidate.effect, parameters=wider)))
        return replace(self, candidates=tuple(chosen))

    def gain(self, *indices: int, score: FloatArray | None = None) -> tuple[float, FloatArray]:
        """Chi-square that the candidates together would take away, and their strengths."""
        which = np.array([c for i in indices for c in self.columns[i]])
        s = (self.score if score is None else score)[which]
        block, held = self.information[np.ix_(which, which)], self.prior[which]
        g = block + np.diag(held)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(g), 1e-300))
        scaled = g * scale[:, None] * scale[None, :] + 1e-6 * np.eye(len(which))
        estimate = np.linalg.solve(scaled, s * scale) * scale
        if len(indices) == 1 and self.scattered.size:
            scattered = float(self.scattered[indices[0]])
            if scattered > float(estimate @ s) - price(block, held):
                return scattered, self.start[which]
        return float(estimate @ s) - price(block, held), estimate + self.start[which]

    def allowed(self, index: int, values: FloatArray, slack: float = 2.0) -> bool:
        """Whether strengths lie within what nature allows, give or take `slack` sigma."""
        strengths = self.candidates[index].effect.strengths
        for column, p, value in zip(self.columns[index], strengths, values, strict=True):
            sigma = 1.0 / np.sqrt(max(self.information[column, column], 1e-300))
            if value < p.lower - slack * sigma or value > p.upper + slack * sigma:
                return False
        return True

    def gains(self) -> FloatArray:
        """(candidates,) chi-square taken away by each alone; −inf where nature forbids it."""
        result = np.full(len(self.candidates), -np.inf)
        for index in range(len(self.candidates)):
            gain, values = self.gain(index)
            if self.allowed(index, values):
                result[index] = gain
        return result


def price(block: FloatArray, held: FloatArray) -> float:
    """What the evidence asks for weights held by a prior, chi-square units; 0 for free strengths.

    Parameters
    ----------
    block : (n, n) array
        Information on the weights.
    held : (n,) array
        Inverse prior variances.
    """
    if not held.size or not held.all():
        return 0.0
    root = np.sqrt(held)
    return float(np.linalg.slogdet(np.eye(held.size) + block / np.outer(root, root))[1])


def _evidence(block: FloatArray, score: FloatArray, held: FloatArray) -> float:
    return float(score @ np.linalg.solve(block + np.diag(held), score)) - price(block, held)


def scan(forward: Forward, fit: Fit, candidates: Sequence[Candidate]) -> Scan:
    """Score candidates around a fitted model."""
    models: list[Model] = []
    sizes: list[float] = []
    starts: list[float] = []
    columns: list[tuple[int, ...]] = []
    for candidate in candidates:
        values = start_values(candidate, fit.model)
        mine = []
        for parameter, step, moved in steps_of(candidate, values):
            mine.append(len(models))
            models.append(fit.model.having(candidate.effect, moved).order())
            sizes.append(step)
            starts.append(values[parameter.name])
        columns.append(tuple(mine))
    free = list(fit.free)
    base = linearise(forward, fit.model, fit.nuisance, fit.law_offsets, free)
    held = base.shared.shape[-1]
    blocks = [base.shared]
    for first in range(0, len(models), LANES_AT_ONCE):
        part = linearise(
            forward, fit.model, fit.nuisance, fit.law_offsets, (),
            models[first : first + LANES_AT_ONCE], sizes[first : first + LANES_AT_ONCE],
        )  # fmt: skip
        blocks.append(part.shared[..., fit.law_offsets.size :])
    shared = np.concatenate(blocks, axis=-1)
    prior = np.concatenate([base.shared_prior, np.zeros(len(models))])
    own_prior, law_prior = priors(forward, fit.model)
    kept = own_prior < 1e15
    own_pull = np.where(kept, -fit.nuisance * np.where(kept, own_prior, 0.0), 0.0)
    shared_pull = np.zeros(shared.shape[-1])
    if fit.law_offsets.size:
        shared_pull[: fit.law_offsets.size] = (-fit.law_offsets * law_prior).reshape(-1)
    system = Linearised(base.residual, base.own, shared, base.prior, prior)
    matrix, vector, _, _ = reduce(system, own_pull, shared_pull)
    if held:
        a, b = matrix[:held, :held], matrix[:held, held:]
        diagonal = np.diag(a)
        scale = np.where(diagonal > 1e-200, 1.0 / np.sqrt(np.maximum(diagonal, 1e-200)), 0.0)
        scaled = a * scale[:, None] * scale + 1e-9 * np.eye(held)
        middle = np.linalg.solve(scaled, b * scale[:, None]) * scale[:, None]
        matrix, vector = (
            matrix[held:, held:] - b.T @ middle,
            vector[held:] - middle.T @ vector[:held],
        )
    # Columns that the rest explains fully carry rounding noise alone.
    alone = np.einsum("tmn,tmn->n", shared[..., held:], shared[..., held:])
    weak = np.diag(matrix) < 1e-7 * alone + 1e-30
    matrix[weak, :], matrix[:, weak], vector[weak] = 0.0, 0.0, 0.0
    matrix[weak, weak] = 1.0
    scattered = np.zeros(len(candidates))
    for index, candidate in enumerate(candidates):
        if candidate.effect.level is not Level.CAMPAIGN:
            slopes = shared[..., [held + column for column in columns[index]]]
            score, block = grouped(
                forward, candidate.effect.level,
                *marginal_by_trial(base.own, base.prior, base.residual, slopes, own_pull),
            )  # fmt: skip
            scales = np.array([p.scale for p in candidate.effect.strengths])
            scattered[index] = scatter_evidence(score, block, scales)[1]
    return Scan(tuple(candidates), tuple(columns), matrix, vector, np.array(starts), scattered)


LEAST_WEIGHT = 1e-3
"""Information of a trial over that of the best one below which it tells nothing of a strength."""

LEAST_TRIALS = 6

"""Trials from which their scatter says something."""


def robust_spread(forward: Forward, fit: Fit) -> FloatArray:
    """Standard uncertainties that hold where the law is not quite right.

    Each trial pulls the parameters its own way; how far the pulls scatter says how well they are
    known, whatever left the residuals over (sandwich estimate by trial: Liang and Zeger,
    Biometrika 73, 13 (1986)). Never below what the noise alone gives, inflated by the misfit.

    Returns
    -------
    (n,) array
        One per free parameter.
    """
    plain = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    plain = plain * np.sqrt(fit.reduced_chi2)
    information, pulls = _pulls(forward, fit)
    first = information.shape[0] - len(fit.free)
    trials, freedom = pulls.shape[0], pulls.shape[1]
    if trials < max(LEAST_TRIALS, freedom + 2) or not np.isfinite(information).all():
        return np.asarray(plain)
    inverse = inverse_of(information)
    pulls = pulls - pulls.mean(axis=0)
    spread = inverse @ (pulls.T @ pulls) @ inverse * trials / (trials - freedom)
    return np.asarray(np.maximum(plain, np.sqrt(np.maximum(np.diag(spread)[first:], 0.0))))


def trial_pulls(forward: Forward, fit: Fit) -> FloatArray:
    """How far leaving each trial out would move each free parameter, to first order.

    Returns
    -------
    (trials that take part, n) array
    """
    information, pulls = _pulls(forward, fit)
    if not (np.isfinite(information).all() and np.isfinite(pulls).all()):
        return np.zeros((0, len(fit.free)))
    moved: FloatArray = pulls @ inverse_of(information)
    return moved[:, information.shape[0] - len(fit.free) :]


@dataclass(frozen=True)
class Heterogeneity:
    """How far a strength differs from trial to trial beyond what noise and stated scatter allow.

    Attributes
    ----------
    chance : float
        Probability of so much scatter if all trials shared one strength (Cochran's Q).
    spread : float
        One sigma of the trials' own strengths, in the parameter's unit (DerSimonian and Laird,
        Control. Clin. Trials 7, 177 (1986)).
    """

    chance: float
    spread: float


def heterogeneity(forward: Forward, fit: Fit) -> tuple[Heterogeneity, ...]:
    """Cochran's Q of each free parameter over the trials; the misfit counts as noise."""
    left, system = _without_own(forward, fit)
    first = system.shared.shape[-1] - len(fit.free)
    pulls = np.einsum("tmn,tm->tn", left, system.residual)[:, first:]
    weights = np.einsum("tmn,tmn->tn", left, system.shared)[:, first:] / fit.reduced_chi2
    pulls = pulls / fit.reduced_chi2
    found = []
    for pull, weight in zip(pulls.T, weights.T, strict=True):
        tells = weight > LEAST_WEIGHT * max(float(weight.max(initial=0.0)), 1e-300)
        degrees = int(tells.sum()) - 1
        if degrees < 1 or not np.isfinite(pull[tells]).all():
            found.append(Heterogeneity(1.0, 0.0))
            continue
        mine, own = weight[tells], pull[tells]
        q = float(np.sum(own**2 / mine))
        total = float(mine.sum())
        room = total - float(np.sum(mine**2)) / total
        spread = np.sqrt(max(q - degrees, 0.0) / max(room, 1e-300))
        found.append(Heterogeneity(float(chi2.sf(q, degrees)), float(spread)))
    return tuple(found)


def _pulls(forward: Forward, fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Information on the shared parameters (n, n), and each trial's pull on them (trials, n)."""
    left, system = _without_own(forward, fit)
    first = system.shared.shape[-1] - len(fit.free)
    # Shapes keep the hold they were fitted with; a place that no row tells apart has no slope.
    prior = system.shared_prior.copy()
    prior[first:] += [1.0 / f.parameter.scale**2 if f.parameter.is_shape else 0.0 for f in fit.free]
    information = np.einsum("tmn,tmk->nk", system.shared, left) + np.diag(prior)
    pulls = np.einsum("tmn,tm->tn", left, system.residual)
    pulls = pulls[np.abs(system.residual).sum(axis=1) > 0.0]
    return information, pulls


def _without_own(forward: Forward, fit: Fit) -> tuple[FloatArray, Linearised]:
    """Slopes by the shared parameters less what trials' own values take up (T, M, n), and all."""
    system = linearise(forward, fit.model, fit.nuisance, fit.law_offsets, fit.free)
    cross = np.swapaxes(system.own, 1, 2) @ system.shared
    inner = np.swapaxes(system.own, 1, 2) @ system.own + np.diag(system.prior)
    tiny = 1e-12 * np.einsum("tqq->tq", inner) + 1e-12
    inner = inner + tiny[:, :, None] * np.eye(inner.shape[1])
    return system.shared - system.own @ np.linalg.solve(inner, cross), system
