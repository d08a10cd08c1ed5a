"""Robust least squares with Gaussian priors, and a covariance that owns up to misfit."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

__all__ = ["Fitted", "fit"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Fitted:
    """Result of a fit.

    Attributes
    ----------
    values : (P,) array
        Parameters.
    covariance : (P, P) array
        Their covariance, widened by `chi2_per_dof` where that exceeds one.
    residuals : (N,) array
        Standardised residuals of the data.
    chi2_per_dof : float
        Robust: from the median absolute residual, so that a few outliers don't count.
    """

    values: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    chi2_per_dof: float


def fit(
    residuals: Callable[[FloatArray], FloatArray],
    start: ArrayLike,
    prior: ArrayLike | None = None,
    prior_std: ArrayLike | None = None,
) -> Fitted:
    """Fit parameters to standardised residuals with a soft-L1 loss.

    Parameters
    ----------
    residuals : callable
        (P,) parameters to (N,) residuals over their standard uncertainty.
    start : (P,) array
        Where to start.
    prior, prior_std : (P,) arrays, optional
        Gaussian priors; an infinite std is no prior.

    Returns
    -------
    Fitted
    """
    start = np.asarray(start, dtype=float)
    centre = start if prior is None else np.asarray(prior, dtype=float)
    inverse = np.zeros_like(start) if prior_std is None else 1.0 / np.asarray(prior_std, float)

    def stacked(values: FloatArray) -> FloatArray:
        return np.concatenate([residuals(values), (values - centre) * inverse])

    solution = least_squares(
        stacked, start, loss="soft_l1", f_scale=2.5, x_scale="jac", method="trf", max_nfev=60
    )
    values = np.asarray(solution.x)
    left = residuals(values)
    count = len(left)
    spread = 1.4826 * float(np.median(np.abs(left))) if count else 1.0
    chi2 = max(spread**2, 1.0) * count / max(count - len(start), 1)
    jacobian = _jacobian(residuals, values)
    information = jacobian.T @ jacobian / max(chi2, 1.0) + np.diag(inverse**2)
    return Fitted(
        values, np.asarray(np.linalg.pinv(information, hermitian=True), float), left, chi2
    )


def _jacobian(function: Callable[[FloatArray], FloatArray], values: FloatArray) -> FloatArray:
    steps = 1e-6 * np.maximum(np.abs(values), 1e-2)
    columns = []
    for index, step in enumerate(steps):
        moved = np.zeros_like(values)
        moved[index] = step
        columns.append((function(values + moved) - function(values - moved)) / (2 * step))
    return np.stack(columns, axis=1)
