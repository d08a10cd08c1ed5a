"""Restitution against speed: three laws, fitted hierarchically and weighed by evidence.

A clip k in session s gives e_k at impact speed v_k,

    e_k = f(v_k; θ) + u_s + ε_k + Σ_j g_kj z_j,

ε_k ~ N(0, std_k² + σ²) its own error and the strike's scatter, u_s ~ N(0, τ²) what a session has in
common, z_j ~ N(0, 1) the inputs that all clips share (masses, inertia, tape), g_kj what one
standard uncertainty of such an input does to e_k. Every law is linear in its parameters but for the
rate of the exponential, so that they are integrated exactly and rate, σ and τ on a grid (Gelman et
al., Bayesian Data Analysis, 3rd ed., ch. 5 and 14).
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import least_squares
from scipy.special import logsumexp

from metrology import TooLittleDataError
from pipelines.setup.cor_file import PARAMETERS, LawKind

__all__ = ["AveragedLaw", "CorLawFit", "CorPoints", "Estimate", "fit_cor_laws"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class CorPoints:
    """Coefficients of restitution of one ball, N clips with J shared inputs.

    Attributes
    ----------
    speed : (N,) array
        Impact speed, m/s.
    cor : (N,) array
    std : (N,) array
        Standard uncertainty of each clip's own.
    shared : (N, J) array
        What one standard uncertainty of each shared input does to e.
    session : (N,) int array
        Number of the session, from 0.
    """

    speed: FloatArray
    cor: FloatArray
    std: FloatArray
    shared: FloatArray
    session: NDArray[np.int64]


@dataclass(frozen=True)
class Estimate:
    """A number with standard uncertainty and 95 % interval."""

    value: float
    std: float
    low: float
    high: float


@dataclass(frozen=True)
class CorLawFit:
    """One law and how well it is known.

    Attributes
    ----------
    law : LawKind
    parameters : dict of str to Estimate
        exponential: e = a exp(−b v) + d, b in s/m; power: e = 1 − a v^(1/5); constant: e = d.
    covariance : (P, P) array
        Of the parameters, in that order, as far as they move the curve.
    log_evidence : float
    probability : float
        Among the laws compared.
    strike_scatter, session_scatter : Estimate
        σ and τ.
    speeds : (2,) tuple of float
        Range of the impact speeds fitted, m/s.
    draws : (K, P + 2) array
        Equally likely parameters, σ and τ.
    """

    law: LawKind
    parameters: dict[str, Estimate]
    covariance: FloatArray
    log_evidence: float
    probability: float
    strike_scatter: Estimate
    session_scatter: Estimate
    speeds: tuple[float, float]
    draws: FloatArray

    def at(self, speed: float) -> Estimate:
        """Coefficient of restitution at an impact speed, m/s: of the law."""
        return _summary(_evaluate(self.law, self.draws, speed))

    def next_strike(self, speed: float) -> Estimate:
        """What the next strike at that speed, in a session of its own, will show."""
        scatter = np.hypot(self.draws[:, -2], self.draws[:, -1])
        noise = np.random.default_rng(_SEED).standard_normal(len(scatter))
        return _summary(_evaluate(self.law, self.draws, speed) + scatter * noise)


@dataclass(frozen=True)
class AveragedLaw:
    """What all laws compared say together, each with its probability (Hoeting et al. 1999).

    The likeliest law alone would leave the doubt about the law itself out of its band.

    Attributes
    ----------
    fits : tuple of CorLawFit
        Of one ball.
    """

    fits: tuple[CorLawFit, ...]

    def at(self, speed: float) -> Estimate:
        """Coefficient of restitution at an impact speed, m/s."""
        return _summary(self._values(speed, next_strike=False))

    def next_strike(self, speed: float) -> Estimate:
        """What the next strike at that speed, in a session of its own, will show."""
        return _summary(self._values(speed, next_strike=True))

    def _values(self, speed: float, *, next_strike: bool) -> FloatArray:
        parts = []
        for fit in self.fits:
            # equally likely draws: any of them, in the number that the law is worth
            chosen = np.random.default_rng(_SEED).permutation(len(fit.draws))
            draws = fit.draws[chosen[: round(fit.probability * len(fit.draws))]]
            values = _evaluate(fit.law, draws, speed)
            if next_strike:
                noise = np.random.default_rng(_SEED).standard_normal(len(draws))
                values = values + np.hypot(draws[:, -2], draws[:, -1]) * noise
            parts.append(values)
        return np.concatenate(parts)


_SEED = 20
"""Any number: draws that do not change from run to run."""
_DRAWS = 4000
"""Sampling adds 1/√(2·4000) = 1 % to a standard uncertainty."""
_CURVE_SPEEDS = 12
"""Speeds along the range fitted at which curves are compared; a law bends once at most."""
_SMALLEST_DIRECTION = 1e-4
"""Directions of the parameters that move the curve 10 000 times less than the strongest say
nothing of it."""
_POWER = 0.2
"""Kuwabara and Kono 1987: leading term for visco-elastic spheres."""
_RATES = np.geomspace(0.03, 3.0, 48)
"""s/m. Below, the exponential is a straight line over any speed range a pendulum has; above, it
is over before the slowest strike. Log-uniform: the rate's size is not known."""
_SCATTERS = np.concatenate([[0.0], np.geomspace(5e-4, 0.1, 14)])
"""A scatter below 0.0005 is below every camera; 0.1 is more than between a new and a flat ball."""
_TYPICAL_SCATTER = 0.01
"""Scale of the half-Cauchy prior of σ and τ: repeated drops of one ball scatter by about 0.01
(ITTF and FIBA rebound tests allow 0.02 to 0.04 between balls)."""
# mean and std of the linear parameters: any ball's e lies between 0 and 1
_PRIOR = {
    LawKind.EXPONENTIAL: ((0.15, 0.3), (0.65, 0.3)),
    LawKind.POWER: ((0.25, 0.25),),
    LawKind.CONSTANT: ((0.7, 0.3),),
}
"""Mean and standard deviation of the linear parameters, dimensionless: any ball's e lies between 0
and 1."""


def fit_cor_laws(points: CorPoints) -> tuple[CorLawFit, ...]:
    """Fit the three laws, the likeliest first.

    Raises
    ------
    TooLittleDataError
        With fewer than three clips: scatter and level can't both be told.
    """
    if len(points.speed) < 3:
        raise TooLittleDataError(
            f"too few clips of this ball for a law of restitution ({len(points.speed)})",
            hint="Measure three at least, better five at each of three speeds.",
        )
    fits = [_fit(law, points) for law in LawKind]
    total = logsumexp([fit.log_evidence for fit in fits])
    weighed = [_with_probability(fit, float(np.exp(fit.log_evidence - total))) for fit in fits]
    return tuple(sorted(weighed, key=lambda fit: -fit.probability))


def _with_probability(fit: CorLawFit, probability: float) -> CorLawFit:
    values = {name: getattr(fit, name) for name in fit.__dataclass_fields__}
    return CorLawFit(**{**values, "probability": probability})


@dataclass(frozen=True)
class _Posterior:
    """Gaussian posterior of the linear parameters at one point of the grid."""

    log_weight: float
    mean: FloatArray
    factor: FloatArray
    rate: float
    scatter: tuple[float, float]


def _fit(law: LawKind, points: CorPoints) -> CorLawFit:
    sessions = len(np.unique(points.session))
    rates: Sequence[float] = _RATES.tolist() if law is LawKind.EXPONENTIAL else [0.0]
    between: Sequence[float] = _SCATTERS.tolist() if sessions > 1 else [0.0]
    grid = [
        posterior
        for sigma, tau in itertools.product(_SCATTERS.tolist(), between)
        for posterior in _given_scatter(law, points, sigma, tau, rates)
    ]
    weights = np.array([item.log_weight for item in grid])
    evidence = float(logsumexp(weights))
    draws = _drawn(law, grid, np.exp(weights - evidence))
    names = PARAMETERS[law]
    columns = draws[:, : len(names)]
    speeds = np.linspace(points.speed.min(), points.speed.max(), _CURVE_SPEEDS)
    values, covariance = _along_curve(law, draws, speeds)
    return CorLawFit(
        law=law,
        parameters={
            name: _about(value, column)
            for name, value, column in zip(names, values.tolist(), columns.T, strict=True)
        },
        covariance=covariance,
        log_evidence=evidence,
        probability=1.0,
        strike_scatter=_summary(draws[:, -2]),
        session_scatter=_summary(draws[:, -1]),
        speeds=(float(points.speed.min()), float(points.speed.max())),
        draws=draws,
    )


def _given_scatter(
    law: LawKind, points: CorPoints, sigma: float, tau: float, rates: Sequence[float]
) -> list[_Posterior]:
    """Exact posteriors of the linear parameters for each rate, at given scatters."""
    common = [points.shared]
    if tau > 0:
        common.append(tau * np.eye(int(points.session.max()) + 1)[points.session])
    own = points.std**2 + sigma**2
    solve, log_det = _whitener(own, np.hstack(common))
    prior = np.array(_PRIOR[law])
    log_prior = _log_scatter_prior(sigma) + _log_scatter_prior(tau) - float(np.log(len(rates)))
    bases, offset = _bases(law, points.speed, np.asarray(rates))
    columns = bases.transpose(1, 0, 2).reshape(len(points.speed), -1)
    solved = solve(columns).reshape(len(points.speed), *bases.shape[::2]).transpose(1, 0, 2)
    residual = points.cor - offset - bases @ prior[:, 0]
    precision = np.diag(prior[:, 1] ** -2.0) + np.swapaxes(bases, 1, 2) @ solved
    factor = np.linalg.cholesky(precision)
    pull = np.einsum("rnp,rn->rp", solved, residual)
    step = np.linalg.solve(precision, pull[..., None])[..., 0]
    chi2 = np.einsum("rn,nr->r", residual, solve(residual.T)) - np.einsum("rp,rp->r", pull, step)
    log_volume = 2 * np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    log_volume += 2 * np.log(prior[:, 1]).sum() + residual.shape[1] * np.log(2 * np.pi)
    weight = log_prior - 0.5 * (chi2 + log_det + log_volume)
    return [
        _Posterior(float(weight[r]), prior[:, 0] + step[r], factor[r], rate, (sigma, tau))
        for r, rate in enumerate(rates)
    ]


def _whitener(own: FloatArray, common: FloatArray):  # type: ignore[no-untyped-def]
    """Solve with diag(own) + common commonᵀ by Woodbury's identity; and its log determinant."""
    scaled = common / own[:, None]
    inner = cho_factor(np.eye(common.shape[1]) + common.T @ scaled, lower=True)

    def solve(right: FloatArray) -> FloatArray:
        part = right / (own if right.ndim == 1 else own[:, None])
        return np.asarray(part - scaled @ cho_solve(inner, scaled.T @ right))

    log_det = float(np.log(own).sum() + 2 * np.log(np.diag(inner[0])).sum())
    return solve, log_det


def _log_scatter_prior(scatter: float) -> float:
    """Half-Cauchy density times the width of the grid's cell, normalised over the grid."""
    edges = np.concatenate([[0.0], np.sqrt(_SCATTERS[1:-1] * _SCATTERS[2:]), [np.inf]])
    edges = np.concatenate([[0.0], [_SCATTERS[1] / 2], edges[1:]])
    index = int(np.searchsorted(_SCATTERS, scatter))
    mass = 2 / np.pi * np.diff(np.arctan(edges / _TYPICAL_SCATTER))
    return float(np.log(mass[index]))


def _bases(law: LawKind, speed: FloatArray, rates: FloatArray) -> tuple[FloatArray, float]:
    """Columns (R, N, P) that the linear parameters multiply, and what stands without any."""
    if law is LawKind.EXPONENTIAL:
        decay = np.exp(-rates[:, None] * speed)
        return np.stack([decay, np.ones_like(decay)], axis=2), 0.0
    if law is LawKind.POWER:
        return -(speed[None, :, None] ** _POWER), 1.0
    return np.ones((1, len(speed), 1)), 0.0


def _drawn(law: LawKind, grid: Sequence[_Posterior], weights: FloatArray) -> FloatArray:
    rng = np.random.default_rng(_SEED)
    rows = []
    counts = rng.multinomial(_DRAWS, weights / weights.sum())
    for item, count in zip(grid, counts, strict=True):
        if count == 0:
            continue
        normal = rng.standard_normal((len(item.mean), count))
        linear = (item.mean[:, None] + np.linalg.solve(item.factor.T, normal)).T
        if law is LawKind.EXPONENTIAL:
            # a rate is drawn within its cell of the logarithmic grid, not on its centre
            cell = np.log(_RATES[1] / _RATES[0])
            rate = item.rate * np.exp(cell * (rng.random(count) - 0.5))
            linear = np.stack([linear[:, 0], rate, linear[:, 1]], axis=1)
        scatter = np.broadcast_to(item.scatter, (count, 2))
        rows.append(np.hstack([linear, scatter]))
    return np.vstack(rows)


def _along_curve(
    law: LawKind, draws: FloatArray, speeds: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Parameters of the mean curve, and the covariance that gives back the curve's own.

    Amplitude, rate and floor of an exponential trade against each other far beyond what a
    straight line describes, so that their means lie on no likely curve and their own covariance
    overstates the curve's. What is handed on is the law nearest to the mean curve, with the
    curve's covariance seen through its derivatives.
    """
    curves = np.stack([_evaluate(law, draws, float(v)) for v in speeds], axis=1)
    count = len(PARAMETERS[law])
    start = draws[:, :count].mean(axis=0)
    mean = curves.mean(axis=0)

    def away(values: FloatArray) -> FloatArray:
        return np.asarray(_evaluate_at(law, values, speeds) - mean)

    near = least_squares(away, start, method="lm")
    inverse: FloatArray = np.linalg.pinv(
        np.asarray(near.jac, dtype=float), rcond=_SMALLEST_DIRECTION
    )
    covariance = inverse @ np.atleast_2d(np.cov(curves, rowvar=False)) @ inverse.T
    return np.asarray(near.x), np.asarray(0.5 * (covariance + covariance.T))


def _evaluate_at(law: LawKind, values: FloatArray, speeds: FloatArray) -> FloatArray:
    return np.array([float(_evaluate(law, values[None, :], float(v))[0]) for v in speeds])


def _about(value: float, draws: FloatArray) -> Estimate:
    """Spread of the draws about a value that need not be their mean."""
    low, high = np.quantile(draws, [0.025, 0.975])
    std = float(np.sqrt(np.mean((draws - value) ** 2)))
    return Estimate(float(value), std, float(low), float(high))


def _evaluate(law: LawKind, draws: FloatArray, speed: float) -> FloatArray:
    if law is LawKind.EXPONENTIAL:
        return np.asarray(draws[:, 0] * np.exp(-draws[:, 1] * speed) + draws[:, 2])
    if law is LawKind.POWER:
        return np.asarray(1.0 - draws[:, 0] * speed**_POWER)
    return np.asarray(draws[:, 0])


def _summary(values: FloatArray) -> Estimate:
    low, high = np.quantile(values, [0.025, 0.975])
    return Estimate(float(values.mean()), float(values.std(ddof=1)), float(low), float(high))
