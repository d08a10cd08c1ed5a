"""Evidence of linear models with Gaussian priors where noise may be known or not.

What a trial repeats imperfectly (impact speed, back-swing, restitution, launch angle) is integrated
out trial by trial; a noise that nobody stated is integrated over a grid of sizes.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp

from mismatch.model.baseline import Scatter
from mismatch.table.table import TrialTable
from physics.domain import FloatArray

__all__ = [
    "NOISE_SIZES",
    "Gram",
    "Posterior",
    "Problem",
    "evidences",
    "gram_of",
    "integrated",
    "posterior_of",
    "unstated",
]

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
