"""Robust least squares with Gaussian priors, a covariance that owns up to misfit, and responses.

The one door for fits: the parameters are few, residuals are cheap in stacks, and what is wanted of
an optimum, beside the parameters, is how it moves with everything that went into it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrology.errors import NoFitError

__all__ = ["Fitted", "Residuals", "fit", "moved_fit"]

FloatArray = NDArray[np.float64]
Residuals = Callable[[FloatArray], FloatArray]
"""Parameters (P,) to standardised residuals (N,)."""

_SOFT_FROM = 2.5
"""Standard deviations from which a residual counts linearly (soft L1): of Gaussian noise one in
eighty is beyond."""
_MOST_STEPS = 12
"""Gauss-Newton steps at most: near an optimum each doubles the digits, a handful is usual."""
_MOST_HALVINGS = 12
"""Halvings of a step at most: where a four-thousandth of it gains nothing, there is nothing to."""
_RENEW_AT = 1.2
"""Factor, χ² per degree of freedom above which the noise is larger than was said."""


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
    jacobian : (N, P) array
        Of the residuals by the parameters.
    centre : (P,) array
        Of the priors.
    precision : (P, P) array
        Of the priors.
    prior_weight : float
        By which it was multiplied beside data that are worth less than they say.
    """

    values: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    chi2_per_dof: float
    jacobian: FloatArray
    centre: FloatArray
    precision: FloatArray
    prior_weight: float


def fit(
    residuals: Residuals,
    start: ArrayLike,
    prior: ArrayLike | None = None,
    prior_std: ArrayLike | None = None,
    *,
    channels: int = 1,
    stacked: bool = False,
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
    stacked : bool
        Whether `residuals` takes stacks of parameters (K, P) to (K, N), too: then a Jacobian is one
        call.

    Returns
    -------
    Fitted

    Raises
    ------
    NoFitError
        If the residuals are no numbers at the start: the motion is nothing like the model.
    """
    values = np.asarray(start, dtype=float)
    centre = values if prior is None else np.asarray(prior, dtype=float)
    precision = _precision(prior_std, len(values))
    slope = _slope_of_stack if stacked else _slope
    weight = 1.0
    values, left, jacobian = _descend(residuals, slope, values, centre, precision)
    chi2 = _chi2(left, len(values), channels)
    if chi2 > _RENEW_AT:
        # Data that are worth less than they say are worth less beside the priors, too.
        weight = chi2
        values, left, jacobian = _descend(residuals, slope, values, centre, weight * precision)
        chi2 = _chi2(left, len(values), channels)
    information = jacobian.T @ jacobian / chi2 + precision
    covariance = np.asarray(np.linalg.pinv(information, hermitian=True), float)
    return Fitted(values, covariance, left, chi2, jacobian, centre, precision, weight)


def moved_fit(
    fitted: Fitted,
    residuals: Residuals,
    prior: ArrayLike | None = None,
    prior_std: ArrayLike | None = None,
) -> Fitted:
    """The fit after its data, model or priors moved a little, to first order.

    At an optimum the gradient is zero, and stays so as an input p moves: the parameters follow by
    −H⁻¹ ∂g/∂p (implicit function theorem), one linear solve. What the residuals' own curvature adds
    to H is left out, as in every Gauss–Newton step.

    Parameters
    ----------
    fitted : Fitted
        Before.
    residuals : callable
        After; as many as before, each at its old place.
    prior, prior_std : (P,) arrays, optional
        Priors after; as weighed against the data as before.

    Returns
    -------
    Fitted
        With moved values; all else as before.

    Raises
    ------
    ValueError
        If there are not as many residuals as before.
    """
    values = fitted.values
    centre = fitted.centre if prior is None else np.asarray(prior, dtype=float)
    precision = fitted.precision if prior_std is None else _precision(prior_std, len(values))
    left = residuals(values)
    if left.shape != fitted.residuals.shape:
        raise ValueError("residuals came or went: the fit has to be done anew")

    # second derivative of the soft-L1 loss; the data may move by far more than their noise, all
    # alike, so that its slope there would say nothing
    bend = (1.0 + (fitted.residuals / _SOFT_FROM) ** 2) ** -1.5
    weighed = fitted.jacobian.T * bend
    change = weighed @ (left - fitted.residuals) + fitted.prior_weight * (
        precision @ (values - centre) - fitted.precision @ (values - fitted.centre)
    )
    curvature = weighed @ fitted.jacobian + fitted.prior_weight * fitted.precision
    step = np.linalg.lstsq(curvature, change, rcond=None)[0]
    return replace(fitted, values=values - step)


def _precision(std: ArrayLike | None, count: int) -> FloatArray:
    if std is None:
        return np.zeros((count, count))
    return np.diag(1.0 / np.asarray(std, float) ** 2)


def _descend(
    residuals: Residuals,
    slope: Callable[[Residuals, FloatArray], FloatArray],
    values: FloatArray,
    centre: FloatArray,
    precision: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss-Newton steps to the least cost: parameters, residuals and Jacobian there."""

    def cost(at: FloatArray, residuals: FloatArray) -> float:
        soft = _SOFT_FROM**2 * (np.hypot(1.0, residuals / _SOFT_FROM) - 1.0)
        total = float(soft.sum() + 0.5 * (at - centre) @ precision @ (at - centre))
        return total if np.isfinite(total) else np.inf

    left = residuals(values)
    for _ in range(_MOST_STEPS):
        jacobian = slope(residuals, values)
        weight = 1.0 / np.hypot(1.0, left / _SOFT_FROM)
        normal = jacobian.T @ (weight[:, np.newaxis] * jacobian) + precision
        if not np.isfinite(normal).all():
            raise NoFitError(
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


def _steps(values: FloatArray) -> FloatArray:
    return np.asarray(1e-6 * np.maximum(np.abs(values), 1e-2))


def _slope_of_stack(residuals: Residuals, values: FloatArray) -> FloatArray:
    """Central differences by all parameters, from one stack of them, (N, P)."""
    steps = _steps(values)
    moved = np.diag(steps)
    ahead, behind = np.split(residuals(np.concatenate([values + moved, values - moved])), 2)
    return np.asarray((ahead - behind).T / (2.0 * steps))


def _slope(residuals: Residuals, values: FloatArray) -> FloatArray:
    """Central differences by one parameter after the other, (N, P)."""
    steps = _steps(values)
    columns = [residuals(values + move) - residuals(values - move) for move in np.diag(steps)]
    return np.stack(columns, axis=1) / (2.0 * steps)
