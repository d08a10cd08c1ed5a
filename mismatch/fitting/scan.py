"""Score candidates around a fit, and estimate how strengths vary between trials.

Around a fitted model the records are linear in small strengths, and everything the fit may still
change is projected out. Per-trial strengths are Gaussian about the campaign's value; the evidence
of their spread is a closed formula (empirical Bayes: Efron and Morris, J. Am. Stat. Assoc. 70, 311
(1975)), and the spread of highest evidence is used.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.special import chdtrc

from mismatch.candidates import Candidate, start_values, steps_of
from mismatch.fitting.fit import (
    FROM_THE_RECORD,
    GROUPED,
    Arcs,
    Fit,
    Free,
    Linearised,
    SwingStart,
    arcs_of,
    fit_model,
    fitting_start,
    grouped_columns,
    held_information,
    inverse_of,
    linearise,
    linearise_arcs,
    priors,
    reduce,
)
from mismatch.forward import NUISANCES, Forward, ForwardModel, OwnStrength
from physics.domain import FloatArray
from physics.effects import Effect, EffectId, Level

__all__ = [
    "Scan",
    "fit_with_levels",
    "heterogeneity",
    "own_values",
    "price",
    "price_of_levels",
    "robust_spread",
    "scan",
    "scatter_evidence",
    "score_of_own",
    "slopes_left",
    "with_own_strengths",
]

FACTORS = np.logspace(-2.0, 2.5, 28)

"""Scatters that are tried, in scales of the strength."""

REFINEMENTS = 40

ROUNDS = 3

"""Fits, each with the scatter that the one before makes most probable."""

MIN_SPREAD = 1e-4

"""Scatter, in scales of the strength, that is none."""


@dataclass(frozen=True)
class _Place:
    """A model with the values that it is linearised around; of free swings their pieces, too."""

    model: ForwardModel
    nuisance: FloatArray
    laws: FloatArray
    arcs: Arcs | None = None


def _place_of(fit: Fit) -> _Place:
    return _Place(fit.model, fit.nuisance, fit.law_offsets, fit.arcs)


def _linearised(
    forward: Forward,
    at: _Place,
    free: Sequence[Free],
    extra: Sequence[ForwardModel] = (),
    extra_steps: Sequence[float] = (),
) -> Linearised:
    """Around a place; of free swings around their pieces, which are as straight as strikes are.

    In one arc of many periods a small torque turns the phase around, and a law that is out of step
    with the record has no slope towards the right one.
    """
    if forward.mode != "swing":
        return linearise(forward, at.model, at.nuisance, at.laws, free, extra, extra_steps)
    arcs = arcs_of(forward, at.nuisance) if at.arcs is None else at.arcs
    return linearise_arcs(
        forward, at.model, arcs, at.nuisance, at.laws, free, extra, extra_steps
    ).system


@dataclass(frozen=True)
class OwnValues:
    """What an effect's strengths are for each ball, session or trial.

    Attributes
    ----------
    effect : Effect
    names : tuple of str
        Parameters.
    spread : (n,) array
        One sigma of their scatter about the campaign's values.
    value, std : (groups, n) array
        One row for each ball, session or trial.
    """

    effect: Effect
    names: tuple[str, ...]
    spread: FloatArray
    value: FloatArray
    std: FloatArray


def with_own_strengths(
    model: ForwardModel, effects: Sequence[Effect], like: ForwardModel
) -> ForwardModel:
    """The model with own values of all strengths of those effects that live below the campaign.

    Scatters are those that `like` holds, the strengths' scales where it holds none. What `like`
    leaves open of the instrument in each trial stays open.
    """
    known = {(id(one.effect), one.name): one.spread for one in like.own}
    open_still = tuple(one for one in like.own if one.effect.level is Level.CAMPAIGN)
    own = tuple(
        OwnStrength(e, p.name, e.level, known.get((id(e), p.name), p.scale))
        for e in effects
        if e.level is not Level.CAMPAIGN
        for p in e.strengths
    )
    return replace(model, own=(*open_still, *own))


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
    index, names = forward.records.groups(level)
    count = len(names)
    total, weight = np.zeros((count, score.shape[1])), np.zeros((count, *information.shape[1:]))
    np.add.at(total, index, score)
    np.add.at(weight, index, information)
    return total, weight


def _evidence_of_levels(score: FloatArray, information: FloatArray, spread: FloatArray) -> float:
    """Twice the logarithm of the evidence over that of no scatter."""
    root = spread[:, None] * information * spread
    root = root + np.eye(spread.size)
    scaled = score * spread
    gain = float(np.sum(scaled * np.linalg.solve(root, scaled[..., None])[..., 0]))
    return gain - float(np.linalg.slogdet(root)[1].sum())


def score_of_own(
    forward: Forward,
    model: ForwardModel,
    nuisance: FloatArray,
    system: Linearised,
    mine: Sequence[int],
) -> tuple[FloatArray, FloatArray]:
    """Score (T, n) and information (T, n, n) of some of the trials' own values, others integrated.

    Parameters
    ----------
    nuisance : (T, q) array
        Own values about which the system is linear.
    mine : sequence of int
        Columns of those that are asked for.
    """
    others = [k for k in range(nuisance.shape[1]) if k not in mine]
    prior, _ = priors(forward, model)
    pull = np.where(prior < 1e15, -nuisance * prior, 0.0)
    return marginal_by_trial(
        system.own[..., others], prior[others], system.residual, system.own[..., list(mine)],
        pull[:, others],
    )  # fmt: skip


def scatter_evidence(
    score: FloatArray, information: FloatArray, scale: FloatArray
) -> tuple[FloatArray, float]:
    """Most probable spread of own values (n,), and twice the logarithm of its evidence over none.

    Parameters
    ----------
    score, information : (groups, n) and (groups, n, n) arrays
        Of the own values around no scatter.
    scale : (n,) array
        Of the strengths.
    """
    tried = [_evidence_of_levels(score, information, k * scale) for k in FACTORS]
    best = int(np.argmax(tried))
    spread = FACTORS[best] * scale
    for _ in range(REFINEMENTS if scale.size > 1 else 0):
        posterior = np.linalg.inv(information + np.diag(spread**-2.0))
        mean = (posterior @ score[..., None])[..., 0]
        squares = (mean**2 + np.einsum("gnn->gn", posterior)).mean(axis=0)
        spread = np.maximum(np.sqrt(squares), MIN_SPREAD * scale)
    found = _evidence_of_levels(score, information, spread)
    return (spread, found) if found > 0.0 else (MIN_SPREAD * scale, 0.0)


def _around(
    forward: Forward, at: _Place, effect: Effect
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Score and information of an effect's own values by group, and those values (groups, n)."""
    model, nuisance = at.model, at.nuisance
    first = len(NUISANCES[forward.mode])
    mine = [first + k for k, one in enumerate(model.own) if one.effect is effect]
    score, information = score_of_own(forward, model, nuisance, _linearised(forward, at, ()), mine)
    score, information = grouped(forward, effect.level, score, information)
    values = nuisance[:, mine]
    if effect.level in GROUPED:
        columns = [column for column, _ in grouped_columns(forward, model)]
        count = len(forward.records.groups(effect.level)[1])
        values = at.laws[:count, [columns.index(k) for k in mine]]
    return score, information, values


def _scattered(model: ForwardModel) -> list[Effect]:
    """Effects whose scatter is learnt: how far an instrument may be off is known."""
    found: list[Effect] = []
    for one in model.own:
        if one.effect.level is not Level.CAMPAIGN and not any(one.effect is e for e in found):
            found.append(one.effect)
    return found


def _scales(effect: Effect) -> FloatArray:
    return np.array([p.scale for p in effect.strengths])


def _with_likely_scatter(forward: Forward, at: _Place, reduced_chi2: float) -> ForwardModel:
    """The model with each effect's scatter at its most probable around a place."""
    model = at.model
    for effect in _scattered(model):
        score, information, values = _around(forward, replace(at, model=model), effect)
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
    model: ForwardModel,
    free: Sequence[Free],
    start: tuple[FloatArray, FloatArray],
    *,
    rounds: int = 10,
    swing: SwingStart = FROM_THE_RECORD,
    abandon: float = np.inf,
) -> Fit:
    """As `fit_model`, with the scatter of own strengths learnt."""
    fit = None
    for _ in range(ROUNDS if model.own else 0):
        at = _Place(model, *fitting_start(forward, model, *start), swing.arcs)
        reduced_chi2 = 1.0 if fit is None else fit.reduced_chi2
        model = _with_likely_scatter(forward, at, reduced_chi2)
        fit = fit_model(forward, model, free, start, rounds=rounds, swing=swing)
        model, start = fit.model, (fit.nuisance, fit.law_offsets)
        swing = replace(swing, arcs=fit.arcs)
    return fit or fit_model(
        forward, model, free, start, rounds=rounds, swing=swing, abandon=abandon
    )


def price_of_levels(forward: Forward, fit: Fit) -> float:
    """What the evidence asks for the freedom of own values, chi-square units."""
    total = 0.0
    for effect in _scattered(fit.model):
        _, information, _ = _around(forward, _place_of(fit), effect)
        spread = np.array([one.spread for one in fit.model.own if one.effect is effect])
        root = np.eye(spread.size) + spread[:, None] * information * spread / fit.reduced_chi2
        total += float(np.linalg.slogdet(root)[1].sum())
    return total * fit.reduced_chi2


def own_values(forward: Forward, fit: Fit, effect: Effect) -> OwnValues | None:
    """The strengths of an effect for each ball, session or trial; None where all share one."""
    mine = [one for one in fit.model.own if one.effect is effect]
    if not mine:
        return None
    spread = np.array([one.spread for one in mine])
    held = next(values for one, values in fit.model.entries if one is effect)
    mean = np.array([held[one.name] for one in mine])
    _, _, off = _around(forward, _place_of(fit), effect)
    std = _own_std(forward, fit, mine)
    names = tuple(one.name for one in mine)
    return OwnValues(effect, names, spread, mean + off, np.where(np.isfinite(std), std, np.inf))


def _own_std(forward: Forward, fit: Fit, mine: Sequence[OwnStrength]) -> FloatArray:
    """Standard uncertainties (groups, n) of the campaign's value plus what each group is off it.

    Of all that was fitted together: what the records leave open stays with the campaign's value and
    shares its doubt, and a ruler that is left open moves every ball's drag alike.
    """
    system = _linearised(forward, _place_of(fit), fit.free)
    laws = fit.law_offsets.size
    prior = system.shared_prior.copy()
    prior[laws:] += held_information(fit.free)
    prior[laws:] += [f.parameter.scale**-2.0 if f.parameter.is_shape else 0.0 for f in fit.free]
    # A misfit counts as noise; what is known beforehand stays as sure as it was.
    noise = np.sqrt(fit.reduced_chi2)
    weighed = replace(
        system, own=system.own / noise, shared=system.shared / noise, shared_prior=prior
    )
    nothing = np.zeros(fit.nuisance.shape)
    matrix, _, inverse, cross = reduce(weighed, nothing, np.zeros(prior.size))
    shared = inverse_of(matrix)
    of_mean = [
        laws + k
        for one in mine
        for k, item in enumerate(fit.free)
        if fit.model.entries[item.entry][0] is one.effect and item.parameter.name == one.name
    ]
    columns = [column for column, _ in grouped_columns(forward, fit.model)]
    first = len(NUISANCES[forward.mode])
    places = [first + next(k for k, o in enumerate(fit.model.own) if o is one) for one in mine]
    if mine[0].level in GROUPED:
        count = len(forward.records.groups(mine[0].level)[1])
        rows = [
            [group * len(columns) + columns.index(place) for place in places]
            for group in range(count)
        ]
        parts = [shared[np.ix_([*row, *of_mean], [*row, *of_mean])] for row in rows]
    else:
        along = -inverse @ cross
        parts = [
            np.block([[own + a @ shared @ a.T, a @ shared], [shared @ a.T, shared]])[
                np.ix_(which, which)
            ]
            for own, a in zip(inverse, along, strict=True)
            for which in ([*places, *(inverse.shape[1] + k for k in of_mean)],)
        ]
    n = len(mine)
    total = [part[:n, :n] + part[n:, n:] + part[:n, n:] + part[n:, :n] for part in parts]
    variance = np.array([np.diag(one) for one in total])
    return np.asarray(np.sqrt(np.where(variance > 0.0, variance, np.inf)))


LINEAR_SHARE = 0.5

"""Share of a step by which the linear score may misjudge it; assumed."""

TRIALS_AT_ONCE = 20
"""Trials that a scan holds at once: it needs some 3 MB for each, whatever their number. Chosen;
insensitive between 10 and 100."""

LANES_AT_ONCE = 48

"""Trajectories integrated at once, so that their states stay within a processor's cache."""

WIDTHS = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)

"""Widths of the priors of curves that are tried, in units of the declared one."""


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
        start, over none; zero for those that all trials share.
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
        """Whether strengths lie within what nature allows, give or take `slack` sigma.

        A drag that the model holds is also given half its change: a straight line through a bent
        law misses by as much where there is none.
        """
        strengths = self.candidates[index].effect.strengths
        bent = LINEAR_SHARE if self.candidates[index].id == EffectId.DRAG else 0.0
        for column, p, value in zip(self.columns[index], strengths, values, strict=True):
            reach = slack / np.sqrt(max(self.information[column, column], 1e-300))
            reach += bent * abs(value - self.start[column]) * (self.start[column] > p.lower)
            if not p.lower - reach <= value <= p.upper + reach:
                return False
        return True


def price(block: FloatArray, held: FloatArray) -> float:
    """What the evidence asks for weights held by a prior, chi-square units; 0 for free strengths.

    Parameters
    ----------
    block : (n, n) array
        Information on the strengths.
    held : (n,) array
        Inverse prior variances; 0 for free strengths, over which the weights are marginal.
    """
    known, free = held > 0.0, held <= 0.0
    if not known.any():
        return 0.0
    inner, cross = block[np.ix_(known, known)], block[np.ix_(free, known)]
    if free.any():
        inner = inner - cross.T @ np.linalg.pinv(block[np.ix_(free, free)], hermitian=True) @ cross
    root = np.sqrt(held[known])
    size = np.linalg.slogdet(np.eye(root.size) + inner / np.outer(root, root))[1]
    return float(max(size, 0.0))


def _evidence(block: FloatArray, score: FloatArray, held: FloatArray) -> float:
    return float(score @ np.linalg.solve(block + np.diag(held), score)) - price(block, held)


@dataclass(frozen=True)
class _Steps:
    """Models that differ from a fit's by one small step of one strength of a candidate.

    Attributes
    ----------
    models, sizes, starts : list
        One for each strength: the model, the step, and where the strength starts.
    columns : list of tuple of int
        Which of them belong to each candidate.
    """

    models: list[ForwardModel]
    sizes: list[float]
    starts: list[float]
    columns: list[tuple[int, ...]]


def _steps_from(fit: Fit, candidates: Sequence[Candidate]) -> _Steps:
    steps = _Steps([], [], [], [])
    for candidate in candidates:
        values = start_values(candidate, fit.model)
        first = len(steps.models)
        for parameter, size, moved in steps_of(candidate, values):
            steps.models.append(fit.model.having(candidate.effect, moved).order())
            steps.sizes.append(size)
            steps.starts.append(values[parameter.name])
        steps.columns.append(tuple(range(first, len(steps.models))))
    return steps


def _in_parts(
    forward: Forward, fit: Fit, steps: _Steps
) -> Iterator[tuple[Forward, _Place, _Steps]]:
    """The campaign in parts of `TRIALS_AT_ONCE` trials; free swings, which are few, as a whole."""
    place, trials = _place_of(fit), forward.records.trials
    if forward.mode == "swing" or trials <= TRIALS_AT_ONCE:
        yield forward, place, steps
        return
    for rows in np.array_split(np.arange(trials), -(-trials // TRIALS_AT_ONCE)):
        cut: dict[int, Effect] = {}
        model = place.model.of_trials(rows, cut)
        models = [one.of_trials(rows, cut) for one in steps.models]
        yield (
            forward.of_trials(rows),
            replace(place, model=model, nuisance=place.nuisance[rows]),
            replace(steps, models=models),
        )


def _with_steps(forward: Forward, place: _Place, free: Sequence[Free], steps: _Steps) -> Linearised:
    """The system about a fit, with a column for each step after those of the fit; rows in use."""
    base = _linearised(forward, place, free)
    used = forward.records.used.any(axis=0)
    blocks = [base.shared[:, used]]
    for first in range(0, len(steps.models), LANES_AT_ONCE):
        lanes = slice(first, first + LANES_AT_ONCE)
        part = _linearised(forward, place, (), steps.models[lanes], steps.sizes[lanes])
        blocks.append(part.shared[:, used, place.laws.size :])
    prior = np.concatenate([base.shared_prior, np.zeros(len(steps.models))])
    return Linearised(
        base.residual[:, used], base.own[:, used], np.concatenate(blocks, axis=-1), base.prior,
        prior,
    )  # fmt: skip


def scan(forward: Forward, fit: Fit, candidates: Sequence[Candidate]) -> Scan:
    """Score candidates around a fitted model."""
    steps = _steps_from(fit, candidates)
    laws, held = fit.law_offsets.size, fit.law_offsets.size + len(fit.free)
    own_prior, law_prior = priors(forward, fit.model)
    held_back = held_information(fit.free)
    values_now = np.array([fit.value(index)[0] for index in range(len(fit.free))])
    size = held + len(steps.models)
    matrix, vector, alone = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    own: dict[int, list[tuple[FloatArray, FloatArray]]] = {}
    for part, place, moved in _in_parts(forward, fit, steps):
        system = _with_steps(part, place, fit.free, moved)
        known = system.shared_prior
        system = replace(system, shared_prior=np.zeros(size))
        own_pull = np.where(own_prior < 1e15, -place.nuisance * own_prior, 0.0)
        information, score, _, _ = reduce(system, own_pull, np.zeros(size))
        matrix, vector = matrix + information, vector + score
        alone += np.einsum("tmn,tmn->n", system.shared, system.shared)
        for index, candidate in enumerate(candidates):
            if candidate.effect.level is not Level.CAMPAIGN:
                slopes = system.shared[..., [held + column for column in steps.columns[index]]]
                own.setdefault(index, []).append(
                    marginal_by_trial(system.own, system.prior, system.residual, slopes, own_pull)
                )
    known[laws:held] += held_back
    matrix += np.diag(known)
    vector[:laws] -= (fit.law_offsets * law_prior).reshape(-1) if laws else 0.0
    vector[laws:held] -= values_now * held_back
    matrix, vector = _beside_what_is_held(matrix, vector, held)
    # Columns that the rest explains fully carry rounding noise alone.
    weak = np.diag(matrix) < 1e-7 * alone[held:] + 1e-30
    matrix[weak, :], matrix[:, weak], vector[weak] = 0.0, 0.0, 0.0
    matrix[weak, weak] = 1.0
    scattered = np.zeros(len(candidates))
    for index, parts in own.items():
        effect = candidates[index].effect
        scores, blocks = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        score, block = grouped(forward, effect.level, scores, blocks)
        scattered[index] = scatter_evidence(score, block, _scales(effect))[1]
    return Scan(
        tuple(candidates), tuple(steps.columns), matrix, vector, np.array(steps.starts), scattered
    )


def _beside_what_is_held(
    matrix: FloatArray, vector: FloatArray, held: int
) -> tuple[FloatArray, FloatArray]:
    """Information and score of the last columns, the first `held` ones marginalised."""
    if not held:
        return matrix, vector
    a, b = matrix[:held, :held], matrix[:held, held:]
    diagonal = np.diag(a)
    scale = np.where(diagonal > 1e-200, 1.0 / np.sqrt(np.maximum(diagonal, 1e-200)), 0.0)
    scaled = a * scale[:, None] * scale + 1e-9 * np.eye(held)
    middle = np.linalg.solve(scaled, b * scale[:, None]) * scale[:, None]
    return matrix[held:, held:] - b.T @ middle, vector[held:] - middle.T @ vector[:held]


MIN_WEIGHT = 1e-3

"""Information of a trial over that of the best one below which it does not count for a strength."""

MIN_TRIALS = 6

"""Trials from which their scatter says something."""


def robust_spread(forward: Forward, fit: Fit) -> FloatArray:
    """Standard uncertainties that hold where the law is not quite right.

    Each trial pulls the parameters in a direction; how far the pulls scatter shows how well they
    are known, whatever left the residuals over (sandwich estimate by trial: Liang and Zeger,
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
    if trials < max(MIN_TRIALS, freedom + 2) or not np.isfinite(information).all():
        return np.asarray(plain)
    inverse = inverse_of(information)
    pulls = pulls - pulls.mean(axis=0)
    spread = inverse @ (pulls.T @ pulls) @ inverse * trials / (trials - freedom)
    return np.asarray(np.maximum(plain, np.sqrt(np.maximum(np.diag(spread)[first:], 0.0))))


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
        counted = weight > MIN_WEIGHT * max(float(weight.max(initial=0.0)), 1e-300)
        degrees = int(counted.sum()) - 1
        if degrees < 1 or not np.isfinite(pull[counted]).all():
            found.append(Heterogeneity(1.0, 0.0))
            continue
        mine, own = weight[counted], pull[counted]
        q = float(np.sum(own**2 / mine))
        total = float(mine.sum())
        room = total - float(np.sum(mine**2)) / total
        spread = np.sqrt(max(q - degrees, 0.0) / max(room, 1e-300))
        found.append(Heterogeneity(float(chdtrc(degrees, q)), float(spread)))
    return tuple(found)


def _pulls(forward: Forward, fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Information on the shared parameters (n, n), and each trial's pull on them (trials, n)."""
    left, system = _without_own(forward, fit)
    first = system.shared.shape[-1] - len(fit.free)
    # Shapes keep the hold they were fitted with; a place that no row distinguishes has no slope.
    prior = system.shared_prior.copy()
    prior[first:] += [1.0 / f.parameter.scale**2 if f.parameter.is_shape else 0.0 for f in fit.free]
    prior[first:] += held_information(fit.free)
    information = np.einsum("tmn,tmk->nk", system.shared, left) + np.diag(prior)
    pulls = np.einsum("tmn,tm->tn", left, system.residual)
    pulls = pulls[np.abs(system.residual).sum(axis=1) > 0.0]
    return information, pulls


def slopes_left(
    forward: Forward,
    fit: Fit,
    models: Sequence[ForwardModel],
    steps: Sequence[float],
    *,
    each: bool = False,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Slopes by further parameters, what a fit can't take up of them, and its residual.

    Parameters
    ----------
    models, steps
        Each differs from the fitted model by one step of one further parameter.
    each : bool
        Whether every trial has values of its own of those, which then come trial by trial.

    Returns
    -------
    (T, M, n), (T, M, n) and (T, M) arrays
    """
    left, system = _without_own(forward, fit, models, steps, each=each)
    held = left.shape[-1] - len(models) * (left.shape[0] if each else 1)
    prior = system.shared_prior[:held].copy()
    prior[held - len(fit.free) :] += held_information(fit.free)
    shared, slopes = system.shared[..., :held], system.shared[..., held:]
    inner = np.einsum("tmn,tmk->nk", shared, left[..., :held]) + np.diag(prior)
    cross = np.einsum("tmn,tmk->nk", shared, left[..., held:])
    beyond = left[..., held:] - left[..., :held] @ (inverse_of(inner) @ cross)
    return slopes, beyond, system.residual


def _of_each_trial(system: Linearised, count: int) -> Linearised:
    """The system with its last columns, `count` of them, anew for every trial."""
    shared, last = system.shared[..., :-count], system.shared[..., -count:]
    trials, rows = last.shape[:2]
    anew = np.einsum("tu,tmn->tmun", np.eye(trials), last).reshape(trials, rows, trials * count)
    prior = np.concatenate([system.shared_prior[:-count], np.zeros(trials * count)])
    return replace(system, shared=np.concatenate([shared, anew], axis=-1), shared_prior=prior)


def _without_own(
    forward: Forward,
    fit: Fit,
    models: Sequence[ForwardModel] = (),
    steps: Sequence[float] = (),
    *,
    each: bool = False,
) -> tuple[FloatArray, Linearised]:
    """Slopes by the shared parameters less what trials' own values take up (T, M, n), and all.

    `models` and `steps` as in `slopes_left`.
    """
    system = _linearised(forward, _place_of(fit), fit.free, models, steps)
    if each:
        system = _of_each_trial(system, len(models))
    cross = np.swapaxes(system.own, 1, 2) @ system.shared
    inner = np.swapaxes(system.own, 1, 2) @ system.own + np.diag(system.prior)
    tiny = 1e-12 * np.einsum("tqq->tq", inner) + 1e-12
    inner = inner + tiny[:, :, None] * np.eye(inner.shape[1])
    return system.shared - system.own @ np.linalg.solve(inner, cross), system
