"""Robust least squares with priors, covariances and response to inputs.

`fit` is for data with standard uncertainties, `minimise` for bounds or an unknown scale, and
`descend` for structured problems (a scene, the views of a board). They share the loss. A covariance
is widened by misfit.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrology.errors import NoFitError

__all__ = [
    "Downhill",
    "Fitted",
    "Optimum",
    "Residuals",
    "bounded_robust",
    "descend",
    "fit",
    "minimise",
    "moved_fit",
]

FloatArray = NDArray[np.float64]
State = TypeVar("State")
Step = TypeVar("Step")
Residuals = Callable[[FloatArray], FloatArray]
"""Parameters (P,) to standardised residuals (N,)."""

_SOFT_SIGMAS = 2.5
"""Residual from which the loss is linear (soft L1), standard deviations (derived: exceeded by one
in eighty of Gaussian noise)."""
_MAX_STEPS = 12
"""Maximum Gauss-Newton steps (chosen): convergence is quadratic, a handful is usual."""
_MAX_HALVINGS = 12
"""Maximum halvings of a step (chosen): to a four-thousandth of it."""
_MAX_CHI2_AS_STATED = 1.2
"""χ² per degree of freedom above which the noise exceeds the stated one and the fit is repeated
with rescaled priors (chosen)."""


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
        From the median absolute residual, to ignore a few outliers, times the correlation of
        neighbouring residuals; at least 1.
    jacobian : (N, P) array
        Of the residuals by the parameters.
    centre : (P,) array
        Of the priors.
    precision : (P, P) array
        Of the priors.
    prior_weight : float
        Factor of the priors, for data noisier than stated.
    """

    values: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    chi2_per_dof: float
    jacobian: FloatArray
    centre: FloatArray
    precision: FloatArray
    prior_weight: float

    @property
    def determined(self) -> NDArray[np.bool_]:
        """Whether data or prior determine each parameter (P,); a covariance of others says nothing.

        What they do not determine is left out of the inverse, which makes its variance small.
        """
        information = self.jacobian.T @ self.jacobian / self.chi2_per_dof + self.precision
        return np.asarray(np.diagonal(self.covariance @ information) > 0.5)


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
        Initial parameters.
    prior, prior_std : (P,) arrays, optional
        Gaussian priors; an infinite std is no prior.
    channels : int
        Number of interleaved series of residuals (2 for x, y, x, y, …).
    stacked : bool
        Whether `residuals` also maps stacks of parameters (K, P) to (K, N), so that a Jacobian
        needs one call.

    Raises
    ------
    NoFitError
        If the residuals are not finite at the start: the motion does not match the model.
    """
    values = np.asarray(start, dtype=float)
    centre = values if prior is None else np.asarray(prior, dtype=float)
    precision = _precision(prior_std, len(values))
    slope = _slope_of_stack if stacked else _slope
    weight = 1.0
    values, left, jacobian = _descend(residuals, slope, values, centre, precision)
    chi2 = _chi2(left, len(values), channels)
    if chi2 > _MAX_CHI2_AS_STATED:
        # Data noisier than stated get less weight relative to the priors, too.
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
    """The fit after a small change of its data, model or priors, to first order.

    At an optimum the gradient is zero. If an input p changes, the parameters change by −H⁻¹ ∂g/∂p
    (implicit function theorem), one linear solve. The residuals' second derivatives are neglected
    in H, as in every Gauss–Newton step.

    Parameters
    ----------
    fitted : Fitted
        Before the change.
    residuals : callable
        After it; as many as before, in the same order.
    prior, prior_std : (P,) arrays, optional
        Priors after it; with the same weight relative to the data.

    Returns
    -------
    Fitted
        With changed values; all else as before.

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
        raise ValueError("the number of residuals changed: repeat the fit")

    # Second derivative of the soft-L1 loss at the old residuals: a common change of the data may
    # far exceed their noise, and the derivative there would be meaningless.
    bend = (1.0 + (fitted.residuals / _SOFT_SIGMAS) ** 2) ** -1.5
    weighed = fitted.jacobian.T * bend
    change = weighed @ (left - fitted.residuals) + fitted.prior_weight * (
        precision @ (values - centre) - fitted.precision @ (values - fitted.centre)
    )
    curvature = weighed @ fitted.jacobian + fitted.prior_weight * fitted.precision
    step = np.linalg.lstsq(curvature, change, rcond=None)[0]
    return replace(fitted, values=values - step)


@dataclass(frozen=True)
class Optimum:
    """Result of `minimise`.

    Attributes
    ----------
    values : (P,) array
    residuals : (N,) array
        At the optimum.
    jacobian : (N, P) array
        Of the residuals, weighted by the loss: its product with itself is the curvature of the
        cost.
    cost : float
        Half the sum of the squares, linear beyond the scale of the loss.
    """

    values: FloatArray
    residuals: FloatArray
    jacobian: FloatArray
    cost: float


def minimise(
    residuals: Residuals,
    start: ArrayLike,
    *,
    soft_from: float = np.inf,
    slopes: Residuals | None = None,
    stacked: bool = False,
    low: ArrayLike = -np.inf,
    high: ArrayLike = np.inf,
    tolerance: float = 1e-8,
    most_evaluations: int | None = None,
) -> Optimum:
    """Minimise residuals within bounds, by scipy's trust regions.

    Parameters
    ----------
    residuals : callable
        (P,) parameters to (N,) residuals.
    start : (P,) array
        Initial parameters, within the bounds.
    soft_from : float
        Residual from which the loss is linear (soft L1); infinite by default.
    slopes : callable, optional
        (P,) parameters to the Jacobian (N, P); else by differences.
    stacked : bool
        As in `fit`.
    low, high : (P,) arrays or floats
        Bounds.
    tolerance : float
        Relative change of cost or parameters at convergence.
    most_evaluations : int, optional
        Of the residuals, the Jacobian's not counted.

    Raises
    ------
    NoFitError
        If the residuals are not finite at the start.
    """
    # Importing takes longer than most fits.
    from scipy.optimize import least_squares

    if stacked and slopes is None:
        slopes = partial(_slope_of_stack, residuals)
    try:
        found = least_squares(
            residuals,
            np.asarray(start, dtype=float),
            jac="2-point" if slopes is None else slopes,
            bounds=(np.asarray(low, dtype=float), np.asarray(high, dtype=float)),
            loss="soft_l1" if np.isfinite(soft_from) else "linear",
            f_scale=soft_from if np.isfinite(soft_from) else 1.0,
            ftol=tolerance,
            xtol=tolerance,
            max_nfev=most_evaluations,
        )
    except ValueError as problem:
        raise NoFitError(
            "the measured motion does not match this model",
            hint="Look at the overlay and check that the right object was tracked.",
        ) from problem
    jacobian = np.asarray(found.jac, dtype=float)
    return Optimum(np.asarray(found.x), np.asarray(found.fun), jacobian, float(found.cost))


@dataclass(frozen=True)
class Downhill(Generic[Step]):
    """Cost and Gauss-Newton step at one point.

    Attributes
    ----------
    step : object
        The Gauss-Newton step.
    gain : float
        Its predicted gain; NaN where unknown.
    """

    cost: float
    step: Step
    gain: float = np.nan


def bounded_robust(
    residuals: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    scale: float,
    typical_step: FloatArray,
    most: int,
) -> tuple[float, FloatArray]:
    """Minimise residuals with a Cauchy loss within bounds, for starts far from the minimum.

    Parameters
    ----------
    residuals : callable
        Gives the residuals (n,) at values (k,).
    start : (k,) array
        Where to begin.
    bounds : (2,) tuple of (k,) arrays
        Lowest and highest values.
    scale : float
        Size of a residual beyond which it counts less.
    typical_step : (k,) array
        Change of each value that matters.
    most : int
        Evaluations at most.

    Returns
    -------
    cost : float
    values : (k,) array
    """
    from scipy.optimize import least_squares

    fitted = least_squares(
        residuals,
        start,
        bounds=bounds,
        loss="cauchy",
        f_scale=scale,
        max_nfev=most,
        x_scale=typical_step,
    )
    return float(fitted.cost), np.asarray(fitted.x, dtype=np.float64)


_MAX_STATE_HALVINGS = 8
"""Lengths of a step that are tried (chosen: the shortest is 1/128 of it)."""


def descend(
    start: State,
    looking: Callable[[State], Downhill[Step]],
    moved: Callable[[State, Step, float], State],
    cost: Callable[[State, Step], float],
    *,
    settled: Callable[[Downhill[Step], float], bool],
    most_steps: int,
) -> State:
    """Gauss-Newton steps with halving, for states of any kind.

    Parameters
    ----------
    looking : callable
        State to its cost and step.
    moved : callable
        State after a fraction of a step.
    cost : callable
        Cost of a state, with the weights of the step; NaN is rejected.
    settled : callable
        Whether a step with its new cost was the last.
    """
    place = start
    for _ in range(most_steps):
        seen = looking(place)
        for halving in range(_MAX_STATE_HALVINGS):
            there = moved(place, seen.step, 0.5**halving)
            reached = cost(there, seen.step)
            if reached <= seen.cost:
                break
        else:
            return place
        place = there
        if settled(seen, reached):
            return place
    return place


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
    """Gauss-Newton steps to the minimum: parameters, residuals and Jacobian there."""

    def cost(at: FloatArray, residuals: FloatArray) -> float:
        soft = _SOFT_SIGMAS**2 * (np.hypot(1.0, residuals / _SOFT_SIGMAS) - 1.0)
        total = float(soft.sum() + 0.5 * (at - centre) @ precision @ (at - centre))
        return total if np.isfinite(total) else np.inf

    left = residuals(values)
    for _ in range(_MAX_STEPS):
        jacobian = slope(residuals, values)
        weight = 1.0 / np.hypot(1.0, left / _SOFT_SIGMAS)
        normal = jacobian.T @ (weight[:, np.newaxis] * jacobian) + precision
        if not np.isfinite(normal).all():
            raise NoFitError(
                "the tracked motion does not match this model",
                hint="Check the capture rate (--fps), and that ball and mass were tracked.",
            )
        downhill = jacobian.T @ (weight * left) + precision @ (values - centre)
        step = -np.linalg.lstsq(normal, downhill, rcond=None)[0]
        # Remaining gain in χ², compared with 1.
        settled = float(step @ normal @ step) < 1e-4
        for _ in range(_MAX_HALVINGS):
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
    # Residuals below the stated noise leave room for correlated errors.
    return max(spread**2 * _correlation(left, channels), 1.0) * share


def _correlation(left: FloatArray, channels: int) -> float:
    """Frames per independent frame: the tracking errors of neighbouring frames are correlated.

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
    """Central differences for all parameters, from one stack of them, (N, P)."""
    steps = _steps(values)
    moved = np.diag(steps)
    ahead, behind = np.split(residuals(np.concatenate([values + moved, values - moved])), 2)
    return np.asarray((ahead - behind).T / (2.0 * steps))


def _slope(residuals: Residuals, values: FloatArray) -> FloatArray:
    """Central differences for one parameter after the other, (N, P)."""
    steps = _steps(values)
    columns = [residuals(values + move) - residuals(values - move) for move in np.diag(steps)]
    return np.stack(columns, axis=1) / (2.0 * steps)
