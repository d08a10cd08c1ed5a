"""Robust least squares with Gaussian priors, and a covariance that owns up to misfit."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrology import TooLittleDataError

__all__ = ["Fitted", "fit"]

FloatArray = NDArray[np.float64]

_SOFT_FROM = 2.5
_MOST_STEPS = 12
_MOST_HALVINGS = 12
_RENEW_AT = 1.2


@dataclass(frozen=True)
class Fitted:
    """Result of a fit.

    Attributes
    ----------
    values : (P,) array
        Parameters.
    covariance : (P, P) array
        Their covariance, widened by `chi2_per_dof`.
    residuals : (N,) array
        Standardised residuals of the data.
    chi2_per_dof : float
        At least one: from the median absolute residual, so that a few outliers don't count, times
        the correlation of neighbouring residuals.
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
    *,
    channels: int = 1,
) -> Fitted:
    """Fit parameters to standardised residuals with a soft-L1 loss, by Gauss-Newton steps.

    Parameters
    ----------
    residuals : callable
        (P,) parameters to (N,) residuals over their standard uncertainty.
    start : (P,) array
        Where to start.
    prior, prior_std : (P,) arrays, optional
        Gaussian priors; an infinite std is no prior.
    channels : int
        How many interleaved series the residuals are (2 for x, y, x, y, …).

    Returns
    -------
    Fitted

    Raises
    ------
    TooLittleDataError
        If the residuals are no numbers at the start: the motion is nothing like the model.
    """
    values = np.asarray(start, dtype=float)
    centre = values if prior is None else np.asarray(prior, dtype=float)
    precision = np.zeros((len(values), len(values)))
    if prior_std is not None:
        precision = np.diag(1.0 / np.asarray(prior_std, float) ** 2)

    values, left, jacobian = _descend(residuals, values, centre, precision)
    chi2 = _chi2(left, len(values), channels)
    if chi2 > _RENEW_AT:
        # Data that are worth less than they say are worth less beside the priors, too.
        values, left, jacobian = _descend(residuals, values, centre, chi2 * precision)
        chi2 = _chi2(left, len(values), channels)
    information = jacobian.T @ jacobian / chi2 + precision
    covariance = np.asarray(np.linalg.pinv(information, hermitian=True), float)
    return Fitted(values, covariance, left, chi2)


def _descend(
    residuals: Callable[[FloatArray], FloatArray],
    values: FloatArray,
    centre: FloatArray,
    precision: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss-Newton steps to the least cost: parameters, residuals and Jacobian there."""

    def cost(at: FloatArray, misfit: FloatArray) -> float:
        soft = _SOFT_FROM**2 * (np.hypot(1.0, misfit / _SOFT_FROM) - 1.0)
        total = float(soft.sum() + 0.5 * (at - centre) @ precision @ (at - centre))
        return total if np.isfinite(total) else np.inf

    left = residuals(values)
    for _ in range(_MOST_STEPS):
        jacobian = _jacobian(residuals, values)
        weight = 1.0 / np.hypot(1.0, left / _SOFT_FROM)
        normal = jacobian.T @ (weight[:, np.newaxis] * jacobian) + precision
        if not np.isfinite(normal).all():
            raise TooLittleDataError(
                "the motion followed is not one that this model can fit",
                hint="Check the capture rate (--fps), and that ball and mass were followed.",
            )
        downhill = jacobian.T @ (weight * left) + precision @ (values - centre)
        step = -np.linalg.lstsq(normal, downhill, rcond=None)[0]
        # the gain in chi² still to be had, against the unit that matters
        settled = float(step @ normal @ step) < 1e-4
        for _ in range(_MOST_HALVINGS):
            moved = residuals(values + step)
            if settled or cost(values + step, moved) <= cost(values, left):
                values, left = values + step, moved
                break
            step = 0.5 * step
        else:
            break
        if settled:
            break
    return values, left, jacobian


def _chi2(left: FloatArray, parameters: int, channels: int) -> float:
    count = len(left)
    spread = 1.4826 * float(np.median(np.abs(left))) if count else 1.0
    share = count / max(count - parameters, 1)
    return max(max(spread**2, 1.0) * share * _correlation(left, channels), 1.0)


def _correlation(left: FloatArray, channels: int) -> float:
    """Frames per independent frame: what follows an edge is off alike in neighbouring frames.

    From the lag-one correlation ρ of the residuals, (1 + ρ) / (1 − ρ), of a first-order process.
    """
    series = np.clip(left, -4.0, 4.0).reshape(-1, channels)
    if len(series) < 8:
        return 1.0
    series = series - series.mean(axis=0)
    lag = float((series[1:] * series[:-1]).sum() / max((series**2).sum(), 1e-12))
    lag = min(max(lag, 0.0), 0.9)
    return (1.0 + lag) / (1.0 - lag)


def _jacobian(function: Callable[[FloatArray], FloatArray], values: FloatArray) -> FloatArray:
    steps = 1e-6 * np.maximum(np.abs(values), 1e-2)
    columns = []
    for index, step in enumerate(steps):
        moved = np.zeros_like(values)
        moved[index] = step
        columns.append((function(values + moved) - function(values - moved)) / (2 * step))
    return np.stack(columns, axis=1)
