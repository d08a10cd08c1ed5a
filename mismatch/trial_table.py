"""Which sets of effects a trial table calls for: every set by evidence and prior.

How well an answer foretells trials of a table that it has not seen.

Evidence of linear models with Gaussian priors where noise may be known or not.

What a trial repeats imperfectly (impact speed, back-swing, restitution, launch angle) is integrated
out trial by trial; a noise that nobody stated is integrated over a grid of sizes.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp

from mismatch.candidates import Candidate, start_values
from mismatch.forward import Model
from mismatch.records.records import Scatter
from mismatch.table.table import (
    LEAST_TRIALS,
    NUISANCES,
    Strength,
    TableForward,
    TrialTable,
    strengths_of,
)
from mismatch.verdict import HeldOut
from physics.domain import FloatArray
from physics.effects import CATALOGUE

__all__ = ["Answer", "Posterior", "Search", "search", "table_held_out", "unstated"]

NOISE_SIZES = (
    (0.001, 0.003, 0.01, 0.03),
    (0.001, 0.002, 0.004, 0.008, 0.016, 0.032),
    (0.001, 0.002, 0.004, 0.008, 0.016, 0.032, 0.064),
)

"""Tried where no uncertainty is stated: shares of the two speeds, and m of the range."""

INFLATIONS = (1.0, 2.0, 4.0, 8.0)

"""Factors on the noise that are averaged over, each double the last, as likely as each other."""

DOUBT = 0.1

"""Prior probability of each inflation: a stated uncertainty is tested, not believed."""


@dataclass(frozen=True)
class Problem:
    """A table around one point of its models, linearised.

    Attributes
    ----------
    residual : (T, 3) array
        Recorded less predicted numbers; NaN where not recorded.
    columns : (T, 3, M) array
        Derivatives of the predictions by shared parameters.
    jacobian : (T, 3, 4) array
        Derivatives by each trial's own values.
    """

    residual: FloatArray
    columns: FloatArray
    jacobian: FloatArray


@dataclass(frozen=True)
class Gram:
    """Products of whitened columns, one set for each of G noise sizes.

    Attributes
    ----------
    information : (G, M, M) array
    score : (G, M) array
    constant : (G,) array
        Log-likelihood of the point itself, with the prior of the noise.
    chi2_at_zero : (G,) array
        Chi-square of the point.
    noise : (G, 3) array
        Sizes of unstated noise as in `NOISE_SIZES`, or factors on stated noise.
    """

    information: FloatArray
    score: FloatArray
    constant: FloatArray
    chi2_at_zero: FloatArray
    noise: FloatArray


@dataclass(frozen=True)
class Posterior:
    """Shared parameters given the data.

    Attributes
    ----------
    log_evidence : float
    mean, std : (M,) array
        Of parameters, less the values that their priors are centred on.
    chi2 : float
        Misfit at the mean, averaged over the noise.
    noise : (3,) array
        Mean size of unstated noise, or mean factor on stated noise.
    """

    log_evidence: float
    mean: FloatArray
    std: FloatArray
    chi2: float
    noise: FloatArray


def unstated(table: TrialTable) -> tuple[bool, bool, bool]:
    """Which channels have numbers without an uncertainty, of those where one is needed."""
    needed = np.isfinite(table.values)
    # Without a back-swing to hold it against, an unstated error of the impact speed can't be told
    # from errors of what follows, which are counted already.
    needed[:, 0] &= np.isfinite(table.backswing)
    lacking = np.asarray((needed & ~np.isfinite(table.stds)).any(axis=0))
    return bool(lacking[0]), bool(lacking[1]), bool(lacking[2])


def _noise_grid(table: TrialTable) -> tuple[FloatArray, FloatArray]:
    """(G, 3) sizes or factors of the noise, and (G,) their log prior probabilities."""
    axes: list[tuple[float, ...]] = []
    priors: list[tuple[float, ...]] = []
    held = (np.isfinite(table.backswing).any(), *table.present[1:])
    for channel, lacking in enumerate(unstated(table)):
        sizes = NOISE_SIZES[channel] if lacking else INFLATIONS if held[channel] else (1.0,)
        weights = [1.0 / len(sizes)] * len(sizes)
        if sizes is INFLATIONS:
            weights = [1.0 - DOUBT * (len(sizes) - 1), *[DOUBT] * (len(sizes) - 1)]
        axes.append(sizes)
        priors.append(tuple(weights))
    grid = np.array(list(itertools.product(*axes)))
    return grid, np.log(np.array(list(itertools.product(*priors)))).sum(axis=1)


def _covariances(
    table: TrialTable, scatter: Scatter, jacobian: FloatArray, used: FloatArray, grid: FloatArray
) -> FloatArray:
    """Covariance of each trial's numbers, (G, T, 3, 3)."""
    # Unstated noise is a share of the speeds, but metres of the range.
    scale = np.column_stack([np.nan_to_num(table.values[:, :2]), np.ones(table.trials)])
    scale[:, 0] *= np.isfinite(table.backswing)
    lacking = np.array(unstated(table))
    std = grid[:, None, :] * np.where(lacking, scale, np.nan_to_num(table.stds))
    own = np.empty((len(grid), table.trials, 4))
    own[..., 0] = std[..., 0]
    own[..., 1] = scatter.backswing
    own[..., 2] = scatter.cor
    own[..., 3] = scatter.launch_angle
    spread = jacobian[None] * own[:, :, None, :]
    covariance = spread @ np.swapaxes(spread, -1, -2)
    direct = np.square(std)
    # The impact speed's own error is among the trial's values already.
    direct[..., 0] = 1e-12
    covariance += direct[..., None] * np.eye(3)
    both = used[:, :, None] * used[:, None, :]
    return np.where(both > 0.0, covariance, np.eye(3))


def gram_of(problem: Problem, table: TrialTable, scatter: Scatter) -> Gram:
    """Whiten a problem under every size of noise."""
    used = np.isfinite(problem.residual).astype(np.float64)
    residual = np.nan_to_num(problem.residual)
    columns = np.nan_to_num(problem.columns) * used[..., None]
    jacobian = np.nan_to_num(problem.jacobian) * used[..., None]
    grid, prior = _noise_grid(table)
    covariance = _covariances(table, scatter, jacobian, used, grid)
    root = np.linalg.cholesky(covariance)
    shape = (*covariance.shape[:2], 3, columns.shape[-1])
    white = np.linalg.solve(root, np.broadcast_to(columns, shape))
    left = np.linalg.solve(root, np.broadcast_to(residual[..., None], (*shape[:3], 1)))[..., 0]
    log_size = 2.0 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=(1, 2))
    chi2_at_zero = np.square(left).sum(axis=(1, 2))
    count = float(used.sum())
    return Gram(
        np.einsum("gtcm,gtcn->gmn", white, white),
        np.einsum("gtcm,gtc->gm", white, left),
        prior - 0.5 * (chi2_at_zero + log_size + count * np.log(2.0 * np.pi)),
        chi2_at_zero,
        grid,
    )


def posterior_of(
    gram: Gram, columns: NDArray[np.int64], width: FloatArray, sign: FloatArray
) -> Posterior:
    """Integrate the chosen columns over Gaussian priors of zero mean.

    Parameters
    ----------
    gram : Gram
    columns : (k,) int array
        Which parameters are free.
    width : (k,) array
        Prior standard deviations.
    sign : (k,) array
        1 or −1 for a parameter that nature keeps on one side of zero (a half Gaussian), else 0.
    """
    pick = np.ix_(np.arange(len(gram.constant)), columns, columns)
    information = gram.information[pick]
    score = gram.score[:, columns]
    precision = information + np.diag(1.0 / np.square(width))
    covariance = np.linalg.inv(precision)
    mean = np.einsum("gij,gj->gi", covariance, score)
    std = np.sqrt(np.einsum("gii->gi", covariance))
    _, size = np.linalg.slogdet(precision * width[:, None] * width[None, :])
    log_evidence = gram.constant + 0.5 * np.einsum("gi,gi->g", score, mean) - 0.5 * size
    bound = sign != 0.0
    if bound.any():
        inside = log_ndtr(sign[bound] * mean[:, bound] / std[:, bound]) + np.log(2.0)
        log_evidence = log_evidence + inside.sum(axis=1)
    total = float(logsumexp(log_evidence))
    share = np.exp(log_evidence - total)
    middle = share @ mean
    spread = np.sqrt(share @ (np.square(std) + np.square(mean - middle)))
    fitted = np.einsum("gij,gi,gj->g", information, mean, mean)
    chi2 = gram.chi2_at_zero - 2.0 * np.einsum("gi,gi->g", score, mean) + fitted
    return Posterior(
        total,
        middle,
        spread,
        float(share @ chi2),
        share @ gram.noise,
    )


def integrated(gram: Gram, count: int, width: FloatArray) -> Gram:
    """Products with the first `count` parameters integrated over their priors, for good.

    Parameters
    ----------
    width : (count,) array
        Prior standard deviations.
    """
    precision = gram.information[:, :count, :count] + np.diag(1.0 / np.square(width))
    cross = gram.information[:, :count, count:]
    pulled = np.linalg.solve(precision, gram.score[:, :count, None])[..., 0]
    held = np.linalg.solve(precision, cross)
    _, size = np.linalg.slogdet(precision * width[:, None] * width[None, :])
    gain = np.einsum("gi,gi->g", gram.score[:, :count], pulled)
    return Gram(
        gram.information[:, count:, count:] - np.einsum("gim,gin->gmn", cross, held),
        gram.score[:, count:] - np.einsum("gim,gi->gm", cross, pulled),
        gram.constant + 0.5 * gain - 0.5 * size,
        gram.chi2_at_zero - gain,
        gram.noise,
    )


def evidences(
    gram: Gram, sets: NDArray[np.int64], width: FloatArray, sign: FloatArray
) -> FloatArray:
    """Log evidence of many sets of k parameters at once.

    Parameters
    ----------
    sets : (P, k) int array
    width, sign : (M,) array
        Of every parameter, as in `posterior_of`.

    Returns
    -------
    (P,) array
    """
    if sets.shape[1] == 0:
        return np.full(len(sets), logsumexp(gram.constant))
    widths, signs = width[sets], sign[sets]
    own = np.einsum("pi,ij->pij", 1.0 / np.square(widths), np.eye(sets.shape[1]))
    precision = gram.information[:, sets[:, :, None], sets[:, None, :]] + own
    score = gram.score[:, sets]
    covariance = np.linalg.inv(precision)
    mean = np.einsum("gpij,gpj->gpi", covariance, score)
    std = np.sqrt(np.einsum("gpii->gpi", covariance))
    _, size = np.linalg.slogdet(precision * widths[:, :, None] * widths[:, None, :])
    inside = np.where(signs != 0.0, log_ndtr(signs * mean / std) + np.log(2.0), 0.0)
    gain = 0.5 * np.einsum("gpi,gpi->gp", score, mean) - 0.5 * size + inside.sum(axis=-1)
    return np.asarray(logsumexp(gram.constant[:, None] + gain, axis=0))


SIZE_PRIOR = (0.5, 0.4, 0.09, 0.01)

"""Prior probability that nothing, one, two, three things are missing, shared by sets of a size."""

SEED_PAIRS = 30

"""Pairs that are refined, the best of a linear look first; supposed."""

MOST_REFINED = 24

"""Groups that are refined at most, the best first; supposed."""

REFINED_WITHIN = 9.0

"""Nats behind the best: a group farther behind has a share below 1e-4 of the posterior."""

TOLD_APART = 2.0

"""Nats from which one form is told from another: odds of seven to one."""

STEPS = np.array([1e-3, 1e-4, 1e-4, 1e-4])

"""Steps of differences by the nuisances, in their units: far above rounding, far below where a
landing bends."""

ROUNDS = 4

"""Rounds of Gauss-Newton: a landing is nearly straight in what is open, so that it settles in
two."""


@dataclass(frozen=True)
class Answer:
    """A set of effects with its evidence.

    Attributes
    ----------
    members : tuple of Candidate
        In the form that fits best; empty for the baseline as it is.
    posterior : Posterior
        Shared trial-to-trial values first (restitution and launch angle of each ball), then the
        members' strengths.
    log_weight : float
        Evidence times prior, all forms and shapes of these ids together.
    problem : Problem
        The table linearised about the answer.
    model : Model
        The baseline with the members in it, at their posterior means.
    """

    members: tuple[Candidate, ...]
    posterior: Posterior
    log_weight: float
    problem: Problem
    model: Model

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids, in order of the alphabet."""
        return tuple(sorted(member.id for member in self.members))


@dataclass(frozen=True)
class Search:
    """Every set of effects, weighed.

    Attributes
    ----------
    answers : tuple of Answer
        Those that matter, best first.
    probabilities : (n,) array
        Of each answer, among all sets there are.
    inclusion : mapping
        Id → probability of all sets that hold it.
    laws : int
        How many of the shared parameters are trial-to-trial values of the balls.
    """

    answers: tuple[Answer, ...]
    probabilities: FloatArray
    inclusion: Mapping[str, float]
    laws: int


@dataclass(frozen=True)
class _Point:
    """Where to linearise: a model, and shared offsets (2 B,) of restitution and launch angle."""

    model: Model
    offsets: FloatArray


def _linearised(
    forward: TableForward, point: _Point, free: Sequence[tuple[Candidate, Strength]]
) -> Problem:
    """Residuals and derivatives at a point, by finite differences in one prediction."""
    records = forward.forward.records
    count, balls = forward.table.trials, len(records.ball_names)
    base = np.zeros((count, 4))
    for ball in range(balls):
        mine = records.ball_index == ball
        base[mine, 2] += point.offsets[2 * ball]
        base[mine, 3] += point.offsets[2 * ball + 1]
    models, rows, steps = [point.model] * (1 + len(NUISANCES)), [base], []
    for place, step in enumerate(STEPS):
        moved = base.copy()
        moved[:, place] += step
        rows.append(moved)
    for candidate, one in free:
        held = next((v for e, v in point.model.entries if e is candidate.effect), None)
        values = dict(held) if held is not None else start_values(candidate, point.model)
        step = 1e-3 * one.parameter.scale * (one.sign or 1)
        if not one.parameter.lower <= values[one.parameter.name] + step <= one.parameter.upper:
            step = -step
        values[one.parameter.name] += step
        models.append(_put(point.model, candidate, values))
        rows.append(base)
        steps.append(step)
    seen = forward.predict(models, np.stack(rows))
    plain = seen[0]
    own = np.moveaxis((seen[1:5] - plain) / STEPS[:, None, None], 0, -1)
    # What was read as impact speed is the true one less its error.
    own[:, 0, 0] = -1.0
    shared = np.zeros((count, 3, 2 * balls))
    for ball in range(balls):
        mine = records.ball_index == ball
        shared[mine, :, 2 * ball : 2 * ball + 2] = own[mine, :, 2:]
    columns = [shared]
    if steps:
        columns.append(np.moveaxis((seen[5:] - plain) / np.array(steps)[:, None, None], 0, -1))
    return Problem(forward.table.values - plain, np.concatenate(columns, axis=-1), own)


def _put(model: Model, candidate: Candidate, values: dict[str, float]) -> Model:
    kept = tuple((e, v) for e, v in model.entries if e is not candidate.effect)
    return replace(model, entries=kept).having(candidate.effect, values).order()


def _widths(forward: TableForward) -> FloatArray:
    scatter = forward.forward.baseline.scatter
    balls = len(forward.forward.records.ball_names)
    return np.tile([scatter.cor_law, scatter.launch_angle_law], balls)


def refined(
    forward: TableForward, model: Model, members: Sequence[Candidate]
) -> tuple[Posterior, Problem, Model] | None:
    """Posterior of one set, linearised again and again where its mean lies.

    Returns
    -------
    tuple or None
        None where a mean leaves what nature allows.
    """
    free = [(c, one) for c in members for one in strengths_of(c, model)]
    scatter, laws = forward.forward.baseline.scatter, _widths(forward)
    width = np.concatenate([laws, [one.width for _, one in free]])
    sign = np.concatenate([np.zeros(laws.size), [float(one.sign) for _, one in free]])
    start = np.concatenate([np.zeros(laws.size), [one.start for _, one in free]])
    everything = np.arange(width.size, dtype=np.int64)
    off = np.zeros(width.size)
    for _ in range(ROUNDS):
        values, place = model, laws.size
        for candidate in members:
            own = start_values(candidate, model)
            for one in strengths_of(candidate, model):
                moved = float(start[place] + off[place])
                own[one.parameter.name] = float(
                    np.clip(moved, one.parameter.lower, one.parameter.upper)
                )
                off[place] = own[one.parameter.name] - start[place]
                place += 1
            values = _put(values, candidate, own)
        problem = _linearised(forward, _Point(values, off[: laws.size]), free)
        about = Problem(problem.residual + problem.columns @ off, problem.columns, problem.jacobian)
        posterior = posterior_of(gram_of(about, forward.table, scatter), everything, width, sign)
        settled = bool(np.all(np.abs(posterior.mean - off) < 0.01 * posterior.std))
        off = posterior.mean.copy()
        if settled:
            break
    for place, (_, one) in enumerate(free, start=laws.size):
        value = start[place] + posterior.mean[place]
        slack = posterior.std[place] if one.sign else 0.0
        if not one.parameter.lower - slack <= value <= one.parameter.upper + slack:
            return None
    return posterior, about, values


@dataclass(frozen=True)
class _Pool:
    """All candidates around the baseline, with the trial-to-trial values already integrated out."""

    candidates: tuple[Candidate, ...]
    columns: tuple[tuple[int, ...], ...]
    width: FloatArray
    sign: FloatArray
    gram: Gram
    laws: int

    def evidence(self, sets: Sequence[tuple[int, ...]]) -> dict[tuple[int, ...], float]:
        """Log evidence of sets of candidates."""
        found: dict[tuple[int, ...], float] = {}
        by_size: dict[int, list[tuple[int, ...]]] = {}
        for members in sets:
            free = sum(len(self.columns[m]) for m in members)
            by_size.setdefault(free, []).append(members)
        for size, mine in by_size.items():
            columns = [[c for m in members for c in self.columns[m]] for members in mine]
            index = np.array(columns, dtype=np.int64).reshape(len(mine), size)
            evidence = evidences(self.gram, index, self.width, self.sign)
            found |= dict(zip(mine, evidence.tolist(), strict=True))
        return found


def _pool(forward: TableForward, model: Model, candidates: Sequence[Candidate]) -> _Pool:
    laws = _widths(forward)
    free = [(c, one) for c in candidates for one in strengths_of(c, model)]
    columns, place = [], 0
    for candidate in candidates:
        count = len(strengths_of(candidate, model))
        columns.append(tuple(range(place, place + count)))
        place += count
    problem = _linearised(forward, _Point(model, np.zeros(laws.size)), free)
    gram = gram_of(problem, forward.table, forward.forward.baseline.scatter)
    return _Pool(
        tuple(candidates),
        tuple(columns),
        np.array([one.width for _, one in free]),
        np.array([float(one.sign) for _, one in free]),
        integrated(gram, laws.size, laws),
        laws.size,
    )


def _different(pool: _Pool, members: Sequence[int]) -> bool:
    return len({pool.candidates[m].id for m in members}) == len(members)


def _scanned(pool: _Pool, most: int) -> dict[tuple[int, ...], float]:
    """Log evidence of every single and pair, and of triples grown from the best pairs."""
    every = range(len(pool.candidates))
    found = pool.evidence([(), *((m,) for m in every)])
    if most < 2:
        return found
    pairs = pool.evidence([p for p in itertools.combinations(every, 2) if _different(pool, p)])
    found |= pairs
    if most < 3:
        return found
    triples = {
        tuple(sorted((*pair, more)))
        for pair in sorted(pairs, key=lambda p: -pairs[p])[:SEED_PAIRS]
        for more in every
        if _different(pool, (*pair, more))
    }
    return found | pool.evidence(sorted(triples))


def _usual(
    pool: _Pool, forms: Sequence[tuple[float, tuple[int, ...]]]
) -> tuple[float, tuple[int, ...]]:
    """The likeliest form, or the usual one where the table can't tell them apart.

    The usual form is the one that a setup file means.
    """

    def unusual(members: tuple[int, ...]) -> int:
        laws = [pool.candidates[m].effect for m in members]
        return sum(law.form != CATALOGUE[law.id][0].form for law in laws if law.id in CATALOGUE)

    top = max(forms)[0]
    alike = [one for one in forms if one[0] > top - TOLD_APART]
    return min(alike, key=lambda one: (unusual(one[1]), -one[0]))


def search(
    forward: TableForward, model: Model, candidates: Sequence[Candidate], most: int = 3
) -> Search:
    """Weigh every set of up to `most` effects.

    Parameters
    ----------
    forward : TableForward
    model : Model
        The baseline's effects.
    candidates : sequence of Candidate
        What may be missing.
    most : int
        Largest set.

    Returns
    -------
    Search
    """
    pool = _pool(forward, model, candidates)
    by_ids: dict[tuple[str, ...], list[tuple[float, tuple[int, ...]]]] = {}
    for members, evidence in _scanned(pool, most).items():
        ids = tuple(sorted(pool.candidates[m].id for m in members))
        by_ids.setdefault(ids, []).append((evidence, members))
    kinds = len({c.id for c in pool.candidates})
    weighed = []
    for ids, forms in by_ids.items():
        share = math.log(SIZE_PRIOR[len(ids)] / math.comb(kinds, len(ids)))
        variants = math.prod(sum(c.id == i for c in pool.candidates) for i in ids)
        together = float(logsumexp([evidence for evidence, _ in forms])) - math.log(variants)
        best = _usual(pool, forms)
        weighed.append((share + together, best[0], best[1]))
    weighed.sort(key=lambda item: -item[0])
    answers, ids_of, weights = [], [], []
    for rank, (weight, evidence, members) in enumerate(weighed):
        chosen = tuple(pool.candidates[m] for m in members)
        ids_of.append(tuple(c.id for c in chosen))
        weights.append(weight)
        if members and (rank >= MOST_REFINED or weight < weighed[0][0] - REFINED_WITHIN):
            continue
        again = refined(forward, model, chosen)
        if again is None:
            weights[-1] = -np.inf
            continue
        posterior, problem, moved = again
        # All forms of these ids move with the one that fits best.
        weights[-1] = weight + posterior.log_evidence - evidence
        answers.append(Answer(chosen, posterior, weights[-1], problem, moved))
    answers.sort(key=lambda answer: -answer.log_weight)
    total = float(logsumexp(weights))
    shares = np.exp(np.array(weights) - total)
    inclusion = {
        one: float(sum(p for p, ids in zip(shares, ids_of, strict=True) if one in ids))
        for one in {c.id for c in pool.candidates}
    }
    chances = np.exp(np.array([answer.log_weight for answer in answers]) - total)
    return Search(tuple(answers), chances, inclusion, pool.laws)


RESAMPLED = 2000

"""Resamples: a probability of 0.95 is then good to 0.005."""


def _foretold(
    forward: TableForward, laws: int, answer: Answer, kept_out: NDArray[np.bool_]
) -> FloatArray:
    """Errors (T, 3) of an answer that was trained without the marked trials."""
    scatter = forward.forward.baseline.scatter
    width = np.tile([scatter.cor_law, scatter.launch_angle_law], laws // 2)
    strengths = [s for c in answer.members for s in strengths_of(c, answer.model)]
    width = np.concatenate([width, [s.width for s in strengths]])
    sign = np.concatenate([np.zeros(laws), [float(s.sign) for s in strengths]])
    problem = answer.problem
    seen = np.where(kept_out[:, None], np.nan, problem.residual)
    gram = gram_of(Problem(seen, problem.columns, problem.jacobian), forward.table, scatter)
    posterior = posterior_of(gram, np.arange(width.size, dtype=np.int64), width, sign)
    return np.asarray(problem.residual - problem.columns @ posterior.mean)


def _errors(
    forward: TableForward, laws: int, answer: Answer, kept_out: NDArray[np.bool_] | None
) -> FloatArray:
    if kept_out is not None:
        return _foretold(forward, laws, answer, kept_out)[kept_out]
    count = forward.table.trials
    return np.concatenate(
        [_foretold(forward, laws, answer, np.arange(count) == k)[k : k + 1] for k in range(count)]
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def table_held_out(
    forward: TableForward,
    laws: int,
    null: Answer,
    best: Answer,
    kept_out: NDArray[np.bool_] | None = None,
) -> HeldOut | None:
    """Errors on unseen trials before and after.

    Parameters
    ----------
    laws : int
        How many shared parameters are trial-to-trial values of the balls.
    kept_out : (T,) bool array, optional
        Trials to keep out together; by default each is kept out in turn.

    Returns
    -------
    HeldOut or None
        None where too few trials would be left.
    """
    table = forward.table
    channel = 2 if table.present[2] else 1
    before = _errors(forward, laws, null, kept_out)[:, channel]
    after = _errors(forward, laws, best, kept_out)[:, channel]
    told = np.isfinite(before) & np.isfinite(after)
    if int(told.sum()) < 2 or table.trials - 1 < LEAST_TRIALS - 1:
        return None
    before, after = before[told], after[told]
    picks = np.random.default_rng(3).integers(0, before.size, (RESAMPLED, before.size))
    ratio = np.sqrt(
        np.square(before)[picks].mean(axis=1)
        / np.maximum(np.square(after)[picks].mean(axis=1), 1e-24)
    )
    low, high = np.quantile(ratio, (0.025, 0.975))
    names = table.names
    if kept_out is not None:
        names = tuple(n for n, out in zip(table.names, kept_out, strict=True) if out)
    return HeldOut(
        names, _rms(before), _rms(after), (float(low), float(high)),
        "m" if channel == 2 else "m_s",
    )  # fmt: skip
