"""How well fitted parameters are known where the law behind them is not quite right."""

import numpy as np

from mismatch.fitting.fit import Fit
from mismatch.fitting.normal_equations import inverse_of, linearise
from mismatch.model.forward import Forward
from physics.arrays import FloatArray

__all__ = ["robust_spread", "trial_pulls"]

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
    plain = plain * np.sqrt(fit.misfit)
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


def _pulls(forward: Forward, fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Information on the shared parameters (n, n), and each trial's pull on them (trials, n)."""
    system = linearise(forward, fit.model, fit.nuisance, fit.law_offsets, fit.free)
    first = system.shared.shape[-1] - len(fit.free)
    # Shapes keep the hold they were fitted with; a place that no row tells apart has no slope.
    prior = system.shared_prior.copy()
    prior[first:] += [1.0 / f.parameter.scale**2 if f.parameter.is_shape else 0.0 for f in fit.free]
    cross = np.swapaxes(system.own, 1, 2) @ system.shared
    inner = np.swapaxes(system.own, 1, 2) @ system.own + np.diag(system.prior)
    tiny = 1e-12 * np.einsum("tqq->tq", inner) + 1e-12
    inner = inner + tiny[:, :, None] * np.eye(inner.shape[1])
    left = system.shared - system.own @ np.linalg.solve(inner, cross)
    information = np.einsum("tmn,tmk->nk", system.shared, left) + np.diag(prior)
    pulls = np.einsum("tmn,tm->tn", left, system.residual)
    pulls = pulls[np.abs(system.residual).sum(axis=1) > 0.0]
    return information, pulls
