"""Strengths that differ from ball to ball or trial to trial: how widely, and what that costs.

The own values are Gaussian about the campaign's. Around a fit the records are linear in them, so
the evidence of their scatter is a closed formula (empirical Bayes: Efron and Morris, J. Am. Stat.
Assoc. 70, 311 (1975)), and the scatter is the one of highest evidence.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mismatch.fitting.fit import Fit, fit_model
from mismatch.fitting.normal_equations import (
    Free,
    ball_columns,
    fitting_start,
    linearise,
    priors,
)
from mismatch.model.forward import NUISANCES, Forward, Model, OwnStrength
from physics.domain import FloatArray
from physics.effects import Effect, Level

__all__ = [
    "OwnValues",
    "fit_with_levels",
    "grouped",
    "marginal_by_trial",
    "own_values",
    "price_of_levels",
    "scatter_evidence",
    "with_own_strengths",
]

FACTORS = np.logspace(-2.0, 2.5, 28)
"""Scatters that are looked at, in scales of the strength."""

REFINEMENTS = 40
ROUNDS = 3
"""Fits, each with the scatter that the one before makes likeliest."""

LEAST = 1e-4
"""Scatter, in scales of the strength, that is none."""


@dataclass(frozen=True)
class OwnValues:
    """What an effect's strengths are for each ball, or each trial.

    Attributes
    ----------
    effect : Effect
    names : tuple of str
        Parameters.
    spread : (n,) array
        One sigma of their scatter about the campaign's values.
    value, std : (groups, n) array
        One row for each ball, or each trial.
    """

    effect: Effect
    names: tuple[str, ...]
    spread: FloatArray
    value: FloatArray
    std: FloatArray


def with_own_strengths(model: Model, effects: Sequence[Effect], like: Model) -> Model:
    """The model with own values of all strengths of those effects that live below the campaign.

    Scatters are those that `like` holds, the strengths' scales where it holds none.
    """
    known = {(id(one.effect), one.name): one.spread for one in like.own}
    own = tuple(
        OwnStrength(e, p.name, e.level, known.get((id(e), p.name), p.scale))
        for e in effects
        if e.level is not Level.CAMPAIGN
        for p in e.strengths
    )
    return replace(model, own=own)


def marginal_by_trial(
    own: FloatArray, prior: FloatArray, residual: FloatArray, columns: FloatArray, pull: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Score (T, n) and information (T, n, n) of columns, each trial's own values marginalised.

    Parameters
    ----------
    own : (T, M, q) array
        Derivatives by a trial's own values, whose inverse variances are `prior` (q,) and the
        gradient of whose penalty is `pull` (T, q).
    residual : (T, M) array
    columns : (T, M, n) array
    """
    inner = np.swapaxes(own, 1, 2) @ own + np.diag(prior)
    tiny = 1e-12 * np.einsum("tqq->tq", inner) + 1e-12
    inner = inner + tiny[:, :, None] * np.eye(inner.shape[1])
    cross = np.swapaxes(own, 1, 2) @ columns
    middle = np.linalg.solve(inner, cross)
    gradient = np.einsum("tmq,tm->tq", own, residual) + pull
    score = np.einsum("tmn,tm->tn", columns, residual) - np.einsum("tqn,tq->tn", middle, gradient)
    information = np.swapaxes(columns, 1, 2) @ columns - np.swapaxes(cross, 1, 2) @ middle
    return score, information


def grouped(
    forward: Forward, level: Level, score: FloatArray, information: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Sums over the trials that share a value."""
    if level is Level.TRIAL:
        return score, information
    count = len(forward.records.ball_names)
    total, weight = np.zeros((count, score.shape[1])), np.zeros((count, *information.shape[1:]))
    np.add.at(total, forward.records.ball_index, score)
    np.add.at(weight, forward.records.ball_index, information)
    return total, weight


def _evidence(score: FloatArray, information: FloatArray, spread: FloatArray) -> float:
    """Twice the logarithm of the evidence over that of no scatter."""
    root = spread[:, None] * information * spread
    root = root + np.eye(spread.size)
    scaled = score * spread
    gain = float(np.sum(scaled * np.linalg.solve(root, scaled[..., None])[..., 0]))
    return gain - float(np.linalg.slogdet(root)[1].sum())


def scatter_evidence(
    score: FloatArray, information: FloatArray, scale: FloatArray
) -> tuple[FloatArray, float]:
    """The likeliest scatter of own values (n,), and twice the logarithm of its evidence over none.

    Parameters
    ----------
    score, information : (groups, n) and (groups, n, n) arrays
        Of the own values around no scatter.
    scale : (n,) array
        Of the strengths.
    """
    tried = [_evidence(score, information, k * scale) for k in FACTORS]
    best = int(np.argmax(tried))
    spread = FACTORS[best] * scale
    for _ in range(REFINEMENTS if scale.size > 1 else 0):
        posterior = np.linalg.inv(information + np.diag(spread**-2.0))
        mean = (posterior @ score[..., None])[..., 0]
        squares = (mean**2 + np.einsum("gnn->gn", posterior)).mean(axis=0)
        spread = np.maximum(np.sqrt(squares), LEAST * scale)
    found = _evidence(score, information, spread)
    return (spread, found) if found > 0.0 else (LEAST * scale, 0.0)


def _around(
    forward: Forward, model: Model, nuisance: FloatArray, laws: FloatArray, effect: Effect
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Score and information of an effect's own values by group, and those values (groups, n)."""
    first = len(NUISANCES[forward.mode])
    mine = [first + k for k, one in enumerate(model.own) if one.effect is effect]
    others = [k for k in range(nuisance.shape[1]) if k not in mine]
    system = linearise(forward, model, nuisance, laws, ())
    own_prior, _ = priors(forward, model)
    pull = np.where(own_prior < 1e15, -nuisance * own_prior, 0.0)
    score, information = marginal_by_trial(
        system.own[..., others], own_prior[others], system.residual, system.own[..., mine],
        pull[:, others],
    )  # fmt: skip
    score, information = grouped(forward, effect.level, score, information)
    values = nuisance[:, mine]
    if effect.level is Level.BALL:
        columns = ball_columns(forward, model)
        values = laws[:, [columns.index(k) for k in mine]]
    return score, information, values


def _scattered(model: Model) -> list[Effect]:
    found: list[Effect] = []
    for one in model.own:
        if not any(one.effect is e for e in found):
            found.append(one.effect)
    return found


def _scales(effect: Effect) -> FloatArray:
    return np.array([p.scale for p in effect.strengths])


def _with_likely_scatter(
    forward: Forward, model: Model, nuisance: FloatArray, laws: FloatArray, reduced_chi2: float
) -> Model:
    """The model with each effect's scatter at its likeliest around a point."""
    for effect in _scattered(model):
        score, information, values = _around(forward, model, nuisance, laws, effect)
        at_none = score + (information @ values[..., None])[..., 0]
        spread, _ = scatter_evidence(
            at_none / reduced_chi2, information / reduced_chi2, _scales(effect)
        )
        names = [p.name for p in effect.strengths]
        model = replace(
            model,
            own=tuple(
                replace(one, spread=float(spread[names.index(one.name)]))
                if one.effect is effect
                else one
                for one in model.own
            ),
        )
    return model


def fit_with_levels(
    forward: Forward,
    model: Model,
    free: Sequence[Free],
    start: tuple[FloatArray, FloatArray],
    *,
    rounds: int = 10,
) -> Fit:
    """As `fit_model`, with the scatter of own strengths learnt."""
    fit = None
    for _ in range(ROUNDS if model.own else 0):
        nuisance, laws = fitting_start(forward, model, *start)
        reduced_chi2 = 1.0 if fit is None else fit.reduced_chi2
        model = _with_likely_scatter(forward, model, nuisance, laws, reduced_chi2)
        fit = fit_model(forward, model, free, start, rounds=rounds)
        model, start = fit.model, (fit.nuisance, fit.law_offsets)
    return fit or fit_model(forward, model, free, start, rounds=rounds)


def price_of_levels(forward: Forward, fit: Fit) -> float:
    """What the evidence asks for the freedom of own values, chi-square units."""
    total = 0.0
    for effect in _scattered(fit.model):
        _, information, _ = _around(forward, fit.model, fit.nuisance, fit.law_offsets, effect)
        spread = np.array([one.spread for one in fit.model.own if one.effect is effect])
        root = np.eye(spread.size) + spread[:, None] * information * spread / fit.reduced_chi2
        total += float(np.linalg.slogdet(root)[1].sum())
    return total * fit.reduced_chi2


def own_values(forward: Forward, fit: Fit, effect: Effect) -> OwnValues | None:
    """The strengths of an effect for each ball, or each trial; None where all share one."""
    mine = [one for one in fit.model.own if one.effect is effect]
    if not mine:
        return None
    _, information, off = _around(forward, fit.model, fit.nuisance, fit.law_offsets, effect)
    spread = np.array([one.spread for one in mine])
    held = next(values for one, values in fit.model.entries if one is effect)
    mean = np.array([held[one.name] for one in mine])
    posterior = np.linalg.inv(information / fit.reduced_chi2 + np.diag(spread**-2.0))
    # What the records leave open stays with the campaign's value, and shares its doubt.
    kept = np.einsum("gnn->gn", posterior) / spread**2
    doubt = {
        item.parameter.name: fit.value(k)[1] * np.sqrt(fit.reduced_chi2)
        for k, item in enumerate(fit.free)
        if fit.model.entries[item.entry][0] is effect
    }
    common = np.array([doubt.get(one.name, 0.0) for one in mine])
    std = np.sqrt(np.einsum("gnn->gn", posterior) + (kept * common) ** 2)
    names = tuple(one.name for one in mine)
    return OwnValues(effect, names, spread, mean + off, np.where(np.isfinite(std), std, np.inf))
