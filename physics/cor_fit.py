"""Fit laws of restitution with random effects of session, level and strike.

Strike k of session s at level (setting) l gives e_k at impact speed v_k,

    e_k = f(v_k) + u_s + w_l + ε_k + Σ_j g_kj z_j,

with ε_k ~ N(0, std_k² + σ²) the strike's own error and the strike-to-strike variation,
u_s ~ N(0, τ²) the session's effect, w_l ~ N(0, λ²) the level's effect, z_j ~ N(0, 1) the inputs
shared by all strikes (masses, tape, drag) and g_kj the change of e_k per standard uncertainty of
input j. The laws f are constant, linear, exponential, power, and a free form: a straight line plus
a smooth Gaussian process, restricted to monotone curves.

Every law is linear in its parameters at given hyperparameters (σ, τ, λ, the rate of the
exponential, length and size of the process): these are integrated by adaptive importance sampling
(Cappé et al., J. Comput. Graph. Stat. 13, 907, 2004), the linear parameters exactly. The evidence
of the monotone form is that of the process times the ratio of the posterior to the prior
probability of being monotone (Klugkist and Hoijtink, Comput. Stat. Data Anal. 51, 6367, 2007).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.special import logsumexp
from scipy.stats import f as fisher

from metrology import TooLittleDataError
from metrology.least_squares import minimise
from physics.domain import FloatArray

__all__ = [
    "FREE_KNOTS",
    "LAW_PARAMETERS",
    "AveragedLaw",
    "CorLawFit",
    "CorPoints",
    "Estimate",
    "LackOfFit",
    "LawKind",
    "fit_cor_laws",
    "lack_of_fit",
    "repeated_levels",
]


class LawKind(StrEnum):
    """The laws of restitution that are fitted."""

    EXPONENTIAL = "exponential"
    POWER = "power"
    LINEAR = "linear"
    CONSTANT = "constant"
    FREE = "free"


FREE_KNOTS = 9
"""Number of knots of the free form, evenly over the speeds (chosen: twice the number of bends that
the shortest probable length allows)."""

LAW_PARAMETERS = {
    LawKind.EXPONENTIAL: ("a", "b", "d"),
    LawKind.POWER: ("a",),
    LawKind.LINEAR: ("d", "k"),
    LawKind.CONSTANT: ("d",),
    LawKind.FREE: tuple(f"e{i}" for i in range(1, FREE_KNOTS + 1)),
}
"""Names in the order of the covariance: exponential e = a exp(−b v) + d, power e = 1 − a v^(1/5),
linear e = d + k v, constant e = d; free: e at the knots."""

POWER = 0.2
"""Exponent: leading term for visco-elastic spheres (Kuwabara and Kono 1987)."""

_DRAWS_SEED = 20
"""Random seed: any value; fixed so that results repeat."""

_POSTERIOR_DRAWS = 4000
"""Number of posterior draws: sampling adds 1/√(2·4000) = 1 % to a standard uncertainty."""

_TYPICAL_SCATTER, _SCATTER_SPREAD = 0.005, 1.5
"""Median (dimensionless) and standard deviation of the logarithm of σ, τ and λ: 0.0003 to 0.1 in
95 %. Repeated drops of one ball vary by about 0.005 to 0.01 (ITTF and FIBA rebound tests allow 0.02
to 0.04 between balls); below 0.0003 no reading can show it."""

_MIDDLE = (0.7, 0.3)
"""Mean and standard deviation of e in the middle of the speeds: e lies between 0 and 1."""

_SLOPE = 0.15
"""Standard deviation of the change of e per middle speed, −v de/dv (chosen: the paper's balls have
0.05 and 0.06, tennis balls 0.1)."""

_POWER_PRIOR = (0.25, 0.25)
"""Mean and standard deviation of the power law's coefficient, (s/m)^(1/5)."""

_PRIOR_RATE = (0.7, 1.3)
"""Median of rate times middle speed, and standard deviation of its logarithm: from straight (0.05)
to decayed before the slowest strike (9) in 95 %."""

_PRIOR_LENGTH = (0.4, 0.4)
"""Median of the free form's length as a fraction of the range of speeds, and standard deviation of
its logarithm (chosen: one or two bends over the range)."""

_PRIOR_SIZE = (0.02, 1.0)
"""Median of the free form's departure from a straight line, and standard deviation of its logarithm
(chosen: probabilities of the test sets insensitive between 0.01 and 0.04)."""

_MAX_SCATTER_Z, _MAX_LAW_Z = 5.0, 3.0
"""Standard normal coordinates beyond which hyperparameters stay at their bound: 6e-7 and 0.3 % of
the prior; beyond, exponentials overflow."""

_CURVE_SPEEDS = 12
"""Number of speeds at which curves are compared: a law has at most one bend."""

_MONOTONE_SPEEDS = 33
"""Number of speeds at which the free form is tested: four to a knot."""

_MIN_RELATIVE_SINGULAR = 1e-4
"""Relative singular value below which a parameter direction is dropped: it changes the curve 10 000
times less than the strongest direction."""

_FIRST, _ROUND, _LAST = 1024, 512, 2048
"""Numbers of samples of the importance sampler: first, in a round, for the answer."""

_MAX_ROUNDS = 12
"""Maximum rounds of adaptation; four suffice in nearly all fits."""

_MIN_EFFECTIVE = 0.08
"""Effective fraction of a round below which the target is tempered (chosen: 40 of 512 samples
determine mean and covariance in five dimensions)."""

_T_DOF = 5
"""Degrees of freedom of the proposal: tails heavier than a normal target's (Cappé et al.)."""

_MAX_BATCH = 3_000_000
"""Maximum numbers in one block of designs: 24 MB."""

Labels = NDArray[np.int64]


@dataclass(frozen=True)
class CorPoints:
    """Coefficients of restitution of one ball, N strikes with J shared inputs.

    Attributes
    ----------
    speed : (N,) array
        Impact speed, m/s.
    cor : (N,) array
    std : (N,) array
        Standard uncertainty of each strike, without the shared inputs; 0 where unknown.
    shared : (N, J) array
        Change of e per standard uncertainty of each shared input.
    session : (N,) int array
        Number of the session, from 0.
    level : (N,) int array or None
        Number of the level (setting) that strikes share, from 0; None without repeats.
    """

    speed: FloatArray
    cor: FloatArray
    std: FloatArray
    shared: FloatArray
    session: Labels
    level: Labels | None = None

    @property
    def repeats(self) -> float:
        """Typical number of strikes per level (harmonic mean); infinite without levels."""
        if self.level is None:
            return math.inf
        return float(1.0 / np.mean(1.0 / np.unique(self.level, return_counts=True)[1]))


def repeated_levels(setting: FloatArray) -> Labels | None:
    """Levels of a setting that is repeated on purpose; None if hardly any value recurs.

    Parameters
    ----------
    setting : (N,) array
        Drop height, back-swing, speed: equal where the setting is the same.
    """
    _, level, count = np.unique(setting, return_inverse=True, return_counts=True)
    # measured values recur by chance: levels are meant if most strikes belong to one
    recurs = count[level] > 1
    return level.astype(np.int64) if recurs.mean() > 0.5 else None


@dataclass(frozen=True)
class Estimate:
    """A number with standard uncertainty and 95 % interval."""

    value: float
    std: float
    low: float
    high: float

    def to_dict(self) -> dict[str, object]:
        """Its JSON in results."""
        return {"value": self.value, "std": self.std, "interval_95": [self.low, self.high]}


@dataclass(frozen=True)
class CorLawFit:
    """One law with its posterior.

    Attributes
    ----------
    parameters : dict of str to Estimate
        As `LAW_PARAMETERS`; b in s/m, k in s/m.
    covariance : (P, P) array
        Of the parameters, in that order, in the directions that change the curve.
    probability : float
        Among the laws compared.
    strike_scatter, session_scatter, level_scatter : Estimate
        σ, τ and λ.
    speeds : (2,) tuple of float
        Range of the impact speeds fitted, m/s.
    draws : (K, P) array
        Equally likely parameters.
    scatters : (K, 3) array
        σ, τ and λ of each draw.
    """

    law: LawKind
    parameters: dict[str, Estimate]
    covariance: FloatArray
    log_evidence: float
    probability: float
    strike_scatter: Estimate
    session_scatter: Estimate
    level_scatter: Estimate
    speeds: tuple[float, float]
    draws: FloatArray
    scatters: FloatArray

    def at(self, speed: float) -> Estimate:
        """Coefficient of restitution of the law at an impact speed, m/s."""
        return AveragedLaw((self,)).at(speed)

    def to_dict(self) -> dict[str, object]:
        """Its JSON in results: law, parameters, covariance, speeds, random effects."""
        scatters = "strike_scatter", "session_scatter", "level_scatter"
        return {
            "law": str(self.law),
            "parameters": {name: item.to_dict() for name, item in self.parameters.items()},
            "covariance": self.covariance.tolist(),
            "speeds": list(self.speeds),
            **{name: getattr(self, name).to_dict() for name in scatters},
        }


@dataclass(frozen=True)
class AveragedLaw:
    """Average of laws, weighted by their probabilities (Hoeting et al. 1999).

    The band of the most probable law alone would omit the uncertainty about the law itself.

    Attributes
    ----------
    fits : tuple of CorLawFit
        Of one ball.
    """

    fits: tuple[CorLawFit, ...]

    def at(self, speed: float) -> Estimate:
        """Coefficient of restitution of the law at an impact speed, m/s."""
        return _summary(self._values(speed, strikes=math.inf, new_level=False))

    def level_mean(self, speed: float, strikes: float) -> Estimate:
        """Predict the mean of so many strikes at a new level of that speed, m/s, in a new session.

        Without random effects of level and session, the law's own value.
        """
        return _summary(self._values(speed, strikes=strikes, new_level=True))

    def next_strike(self, speed: float) -> Estimate:
        """Predict the next strike at that speed, m/s, in a new session at a new level."""
        return self.level_mean(speed, 1.0)

    def _values(self, speed: float, *, strikes: float, new_level: bool) -> FloatArray:
        parts = []
        total = sum(fit.probability for fit in self.fits)
        for fit in self.fits:
            # draws are equally likely: take a number proportional to the law's probability
            chosen = np.random.default_rng(_DRAWS_SEED).permutation(len(fit.draws))
            chosen = chosen[: round(fit.probability / total * len(fit.draws))]
            values = curve(fit.law, fit.draws[chosen], np.array([speed]), fit.speeds)[:, 0]
            sigma, tau, lam = fit.scatters[chosen].T
            if new_level:
                noise = np.random.default_rng(_DRAWS_SEED).standard_normal(len(values))
                values = values + np.sqrt(tau**2 + lam**2 + sigma**2 / strikes) * noise
            parts.append(values)
        return np.concatenate(parts)


def _summary(values: FloatArray) -> Estimate:
    low, high = np.quantile(values, [0.025, 0.975])
    return Estimate(float(values.mean()), float(values.std(ddof=1)), float(low), float(high))


def curve(
    law: LawKind, parameters: FloatArray, speed: FloatArray, speeds: tuple[float, float]
) -> FloatArray:
    """Values (K, N) of K sets of parameters (K, P) at N impact speeds, m/s.

    `speeds` is the range of the fit, over which the free form has its knots; it is extended by the
    spline's end slopes.
    """
    if law is LawKind.EXPONENTIAL:
        a, b, d = parameters.T[:, :, None]
        return np.asarray(a * np.exp(-b * speed) + d)
    if law is LawKind.POWER:
        return np.asarray(1.0 - parameters[:, :1] * speed**POWER)
    if law is LawKind.LINEAR:
        return np.asarray(parameters[:, :1] + parameters[:, 1:] * speed)
    if law is LawKind.FREE:
        return np.asarray(parameters @ _spline_rows(speed, speeds).T)
    return np.repeat(parameters[:, :1], len(speed), axis=1)


def _spline_rows(speed: FloatArray, speeds: tuple[float, float]) -> FloatArray:
    """Matrix (N, FREE_KNOTS) from values at the knots to the natural cubic spline at `speed`."""
    knots = np.linspace(*speeds, FREE_KNOTS)
    spline = CubicSpline(knots, np.eye(FREE_KNOTS), bc_type="natural")
    inside = np.clip(speed, *speeds)
    return np.asarray(spline(inside) + (speed - inside)[:, None] * spline(inside, 1))


@dataclass(frozen=True)
class _Cells:
    """Strikes with equal speed, std, session, level and shared inputs as one mean each."""

    speed: FloatArray
    cor: FloatArray
    variance: FloatArray
    count: FloatArray
    squares: FloatArray
    shared: FloatArray
    session: FloatArray | None
    level: FloatArray | None
    speeds: tuple[float, float]

    @property
    def middle(self) -> float:
        return 0.5 * (self.speeds[0] + self.speeds[1])


def _cells(points: CorPoints) -> _Cells:
    level = np.zeros_like(points.session) if points.level is None else points.level
    keys = np.column_stack([points.speed, points.std, points.session, level, points.shared])
    _, first, cell, count = np.unique(
        keys, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    cell = cell.ravel()
    mean = np.bincount(cell, points.cor) / count
    squares = np.bincount(cell, (points.cor - mean[cell]) ** 2)
    session, levels = _groups(points)
    return _Cells(
        speed=points.speed[first],
        cor=mean,
        variance=points.std[first] ** 2,
        count=count.astype(np.float64),
        squares=squares.astype(np.float64),
        shared=points.shared[first],
        session=None if session is None else session[first],
        level=None if levels is None else levels[first],
        speeds=(float(points.speed.min()), float(points.speed.max())),
    )


def _groups(points: CorPoints) -> tuple[FloatArray | None, FloatArray | None]:
    """Indicators (N, S) and (N, L) of sessions and levels that the strikes can tell apart."""
    session, level = _indicators(points.session), None
    if points.level is not None:
        level = _indicators(points.level)
        if level is not None and session is not None:
            pairs = len(np.unique(np.column_stack([points.session, points.level]), axis=0))
            if pairs == session.shape[1] == level.shape[1]:
                session = None  # every session is one level
    return session, level


def _indicators(labels: Labels) -> FloatArray | None:
    """Columns of ones; None with one group, or where every strike is a group of its own."""
    names, number = np.unique(labels, return_inverse=True)
    if not 1 < len(names) < len(labels):
        return None
    return np.asarray(np.eye(len(names))[number.ravel()])


class _Model:
    """A law with its random effects at standard normal hyperparameters z (H, D).

    z holds σ, then τ and λ where there are such groups, then those of the law.
    """

    def __init__(self, law: LawKind, cells: _Cells, strike_scatter: bool) -> None:
        self.law, self.cells = law, cells
        self._present = [strike_scatter, cells.session is not None, cells.level is not None]
        self.scatters = sum(self._present)
        self.size = self.scatters + {LawKind.EXPONENTIAL: 1, LawKind.FREE: 2}.get(law, 0)
        self._rows = _spline_rows(cells.speed, cells.speeds) if law is LawKind.FREE else None

    def scatter(self, z: FloatArray) -> FloatArray:
        """σ, τ, λ (H, 3); 0 for groups that are not there."""
        found = np.zeros((len(z), 3))
        exponent = np.clip(z[:, : self.scatters], -_MAX_SCATTER_Z, _MAX_SCATTER_Z)
        values = _TYPICAL_SCATTER * np.exp(_SCATTER_SPREAD * exponent)
        found[:, self._present] = values
        return found

    @property
    def offset(self) -> FloatArray:
        """Prior mean of e at the cells."""
        if self.law is LawKind.POWER:
            return np.asarray(1.0 - _POWER_PRIOR[0] * self.cells.speed**POWER)
        return np.full_like(self.cells.speed, _MIDDLE[0])

    def basis(self, z: FloatArray) -> FloatArray:
        """Columns (H, C, P) of coefficients with standard normal priors."""
        speed, middle = self.cells.speed, self.cells.middle
        ones = np.full((len(z), len(speed), 1), _MIDDLE[1])
        away = (speed - middle) / middle
        if self.law is LawKind.CONSTANT:
            return ones
        if self.law is LawKind.POWER:
            column = -_POWER_PRIOR[1] * speed**POWER
            return np.broadcast_to(column[None, :, None], (len(z), len(speed), 1))
        if self.law is LawKind.EXPONENTIAL:
            rate = self.rate(z)[:, None] * middle
            return np.concatenate(
                [ones, -_SLOPE * np.expm1(-rate * away)[..., None] / rate[..., None]], 2
            )
        slope = np.broadcast_to(_SLOPE * away[None, :, None], ones.shape)
        if self.law is LawKind.LINEAR:
            return np.concatenate([ones, slope], axis=2)
        assert self._rows is not None
        return np.concatenate([ones, slope, self._rows @ self._process(z)], axis=2)

    def rate(self, z: FloatArray) -> FloatArray:
        """Rate of the exponential (H,), s/m."""
        median, spread = _PRIOR_RATE
        exponent = np.clip(z[:, self.scatters], -_MAX_LAW_Z, _MAX_LAW_Z)
        return np.asarray(median * np.exp(spread * exponent) / self.cells.middle)

    def _process(self, z: FloatArray) -> FloatArray:
        """Cholesky factors (H, FREE_KNOTS, FREE_KNOTS) of the process at the knots."""
        exponent = np.clip(z[:, self.scatters : self.scatters + 2], -_MAX_LAW_Z, _MAX_LAW_Z)
        length = _PRIOR_LENGTH[0] * np.exp(_PRIOR_LENGTH[1] * exponent[:, 0])
        size = _PRIOR_SIZE[0] * np.exp(_PRIOR_SIZE[1] * exponent[:, 1])
        place = np.linspace(0.0, 1.0, FREE_KNOTS)
        apart = (place[:, None] - place) / length[:, None, None]
        kernel = np.exp(-0.5 * apart**2) + 1e-6 * np.eye(FREE_KNOTS)
        return np.asarray(size[:, None, None] * np.linalg.cholesky(kernel))

    def parameters(self, z: FloatArray, coefficients: FloatArray) -> FloatArray:
        """Parameters (H, P) of `LAW_PARAMETERS` from coefficients (H, P)."""
        middle = self.cells.middle
        if self.law is LawKind.POWER:
            return np.asarray(_POWER_PRIOR[0] + _POWER_PRIOR[1] * coefficients[:, :1])
        value = _MIDDLE[0] + _MIDDLE[1] * coefficients[:, :1]
        if self.law is LawKind.CONSTANT:
            return np.asarray(value)
        change = _SLOPE * coefficients[:, 1:2]
        if self.law is LawKind.EXPONENTIAL:
            rate = self.rate(z)[:, None]
            steepness = change / (rate * middle)
            return np.concatenate(
                [-steepness * np.exp(rate * middle), rate, value + steepness], axis=1
            )
        slope = change / middle
        if self.law is LawKind.LINEAR:
            return np.concatenate([value - slope * middle, slope], axis=1)
        knots = np.linspace(*self.cells.speeds, FREE_KNOTS)
        bent = (self._process(z) @ coefficients[:, 2 : 2 + FREE_KNOTS, None])[..., 0]
        return np.asarray(value + slope * (knots - middle) + bent)

    def solved(self, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Log likelihood (H,), mean (H, Q) and precision's Cholesky factor (H, Q, Q)."""
        cells, scatter = self.cells, self.scatter(z)
        effects = [np.broadcast_to(cells.shared, (len(z), *cells.shared.shape))]
        for columns, own in ((cells.session, scatter[:, 1]), (cells.level, scatter[:, 2])):
            if columns is not None:
                effects.append(own[:, None, None] * columns)
        design = np.concatenate([self.basis(z), *effects], axis=2)
        single = cells.variance + scatter[:, :1] ** 2
        root = np.sqrt(cells.count / single)
        weighed = design * root[..., None]
        left = (cells.cor - self.offset) * root
        factor = np.linalg.cholesky(np.eye(design.shape[2]) + np.swapaxes(weighed, 1, 2) @ weighed)
        pull = np.swapaxes(weighed, 1, 2) @ left[..., None]
        half = np.linalg.solve(factor, pull)
        mean = np.linalg.solve(np.swapaxes(factor, 1, 2), half)[..., 0]
        deviance = (left**2).sum(1) - (half[..., 0] ** 2).sum(1) + (cells.squares / single).sum(1)
        volume = (cells.count * np.log(2 * np.pi * single)).sum(1)
        volume += 2 * np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(1)
        return np.asarray(-0.5 * (deviance + volume)), mean, factor

    def in_blocks(self, z: FloatArray) -> list[FloatArray]:
        """Parts of z small enough for `solved`."""
        groups = [g for g in (self.cells.session, self.cells.level) if g is not None]
        columns = 12 + self.cells.shared.shape[1] + sum(g.shape[1] for g in groups)
        rows = max(len(self.cells.speed), columns)
        return np.array_split(z, math.ceil(len(z) * rows * columns / _MAX_BATCH))

    def log_likelihood(self, z: FloatArray) -> FloatArray:
        """Log likelihood (H,) with the linear parameters integrated."""
        return np.concatenate([self.solved(block)[0] for block in self.in_blocks(z)])

    def drawn(self, z: FloatArray, rng: np.random.Generator) -> FloatArray:
        """One posterior draw of the parameters (H, P) at each z."""
        rows = []
        for block in self.in_blocks(z):
            _, mean, factor = self.solved(block)
            noise = rng.standard_normal(mean.shape)[..., None]
            values = mean + np.linalg.solve(np.swapaxes(factor, 1, 2), noise)[..., 0]
            rows.append(self.parameters(block, values))
        return np.vstack(rows)


@dataclass(frozen=True)
class _SpeedSamples:
    """Samples of hyperparameters with normalised weights, and the log evidence."""

    z: FloatArray
    weights: FloatArray
    log_evidence: float


def _sampled(
    log_likelihood: Callable[[FloatArray], FloatArray], size: int, rng: np.random.Generator
) -> _SpeedSamples:
    """Importance samples of a posterior with standard normal prior, adapted in rounds."""
    z = rng.standard_normal((_FIRST, size))
    likelihood = log_likelihood(z)
    log_proposal = _log_normal(z)
    for _ in range(_MAX_ROUNDS):
        log_weight = likelihood + _log_normal(z) - log_proposal
        tempered = _tempered(likelihood, _log_normal(z) - log_proposal)
        mean, factor = _moments(z, tempered)
        effective = 1.0 / (len(z) * (_normalised(log_weight) ** 2).sum())
        if effective > 0.3:
            break
        z, log_proposal = _proposed(mean, factor, _ROUND, rng)
        likelihood = log_likelihood(z)
    z, log_proposal = _proposed(mean, factor, _LAST, rng)
    log_weight = log_likelihood(z) + _log_normal(z) - log_proposal
    evidence = float(logsumexp(log_weight)) - math.log(len(z))
    return _SpeedSamples(z, _normalised(log_weight), evidence)


def _log_normal(z: FloatArray) -> FloatArray:
    return np.asarray(-0.5 * (z**2).sum(axis=1) - 0.5 * z.shape[1] * np.log(2 * np.pi))


def _normalised(log_weight: FloatArray) -> FloatArray:
    return np.asarray(np.exp(log_weight - logsumexp(log_weight)))


def _tempered(likelihood: FloatArray, rest: FloatArray) -> FloatArray:
    """Weights with the largest power of the likelihood that keeps enough effective samples."""
    for power in 0.5 ** np.arange(40):
        weights = _normalised(power * likelihood + rest)
        if 1.0 / (weights**2).sum() >= _MIN_EFFECTIVE * len(weights):
            break
    return weights


def _moments(z: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = weights @ z
    away = z - mean
    covariance = (away * weights[:, None]).T @ away
    factor = np.linalg.cholesky(covariance + 1e-8 * np.eye(len(mean)))
    return mean, factor.astype(np.float64)


def _proposed(
    mean: FloatArray, factor: FloatArray, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draws of a multivariate t, and their log density."""
    size = len(mean)
    normal = rng.standard_normal((count, size))
    scale = np.sqrt(_T_DOF / rng.chisquare(_T_DOF, count))
    unit = normal * scale[:, None]
    half = 0.5 * (_T_DOF + size)
    log_density = (
        math.lgamma(half)
        - math.lgamma(0.5 * _T_DOF)
        - 0.5 * size * math.log(_T_DOF * math.pi)
        - float(np.log(np.diag(factor)).sum())
        - half * np.log1p((unit**2).sum(axis=1) / _T_DOF)
    )
    return mean + unit @ factor.T, np.asarray(log_density)


_MIN_POINTS = 3
"""Minimum number of strikes: with fewer, standard deviation and value can't be separated."""


def fit_cor_laws(points: CorPoints, *, strike_scatter: bool = True) -> tuple[CorLawFit, ...]:
    """Fit all laws; the most probable comes first.

    With a single impact speed only the constant is fitted: nothing distinguishes the others.
    `strike_scatter` False takes every `std` as the whole deviation from the law (printed values).

    Raises
    ------
    TooLittleDataError
        With fewer than three strikes.
    """
    if len(points.speed) < _MIN_POINTS:
        raise TooLittleDataError(
            f"{len(points.speed)} strikes of this ball are too few for a law of restitution",
            hint="Measure at least three, better five at each of three speeds.",
        )
    laws: Sequence[LawKind] = [*LawKind] if np.ptp(points.speed) > 0 else [LawKind.CONSTANT]
    cells = _cells(points)
    fits = [
        fit for fit in (_fit(_Model(law, cells, strike_scatter)) for law in laws) if fit is not None
    ]
    total = logsumexp([fit.log_evidence for fit in fits])
    weighed = [replace(fit, probability=float(np.exp(fit.log_evidence - total))) for fit in fits]
    return tuple(sorted(weighed, key=lambda fit: -fit.probability))


def _fit(model: _Model) -> CorLawFit | None:
    """Posterior of one law; None for a free form that is monotone in no draw."""
    rng = np.random.default_rng(_DRAWS_SEED)
    samples = _sampled(model.log_likelihood, model.size, rng)
    chosen = rng.choice(len(samples.z), _POSTERIOR_DRAWS, p=samples.weights)
    draws, scatters = model.drawn(samples.z[chosen], rng), model.scatter(samples.z[chosen])
    evidence = samples.log_evidence
    if model.law is LawKind.FREE:
        kept = _monotone(draws, model.cells.speeds)
        prior = rng.standard_normal((_POSTERIOR_DRAWS, model.size))
        size = 2 + FREE_KNOTS
        unknowing = model.parameters(prior, rng.standard_normal((_POSTERIOR_DRAWS, size)))
        if not kept.any():
            return None
        evidence += math.log(kept.mean() / _monotone(unknowing, model.cells.speeds).mean())
        # repeat the monotone draws, so that every law has equally many
        repeated = rng.choice(np.flatnonzero(kept), _POSTERIOR_DRAWS)
        draws, scatters = draws[repeated], scatters[repeated]
    values, covariance = _central(model.law, draws, model.cells.speeds)
    names = LAW_PARAMETERS[model.law]
    return CorLawFit(
        law=model.law,
        parameters={
            name: _about(value, column)
            for name, value, column in zip(names, values.tolist(), draws.T, strict=True)
        },
        covariance=covariance,
        log_evidence=evidence,
        probability=1.0,
        strike_scatter=_summary(scatters[:, 0]),
        session_scatter=_summary(scatters[:, 1]),
        level_scatter=_summary(scatters[:, 2]),
        speeds=model.cells.speeds,
        draws=draws,
        scatters=scatters,
    )


def _monotone(draws: FloatArray, speeds: tuple[float, float]) -> NDArray[np.bool_]:
    steps = np.diff(curve(LawKind.FREE, draws, np.linspace(*speeds, _MONOTONE_SPEEDS), speeds))
    return np.asarray((steps <= 0).all(axis=1) | (steps >= 0).all(axis=1))


def _central(
    law: LawKind, draws: FloatArray, speeds: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Parameters of the law nearest to the mean curve, and the covariance of that curve.

    Amplitude, rate and floor of an exponential are strongly and nonlinearly correlated: their means
    describe no probable curve and their covariance overstates the curve's. Hence the curve's
    covariance is mapped to the parameters through its derivatives.
    """
    if law is not LawKind.EXPONENTIAL:
        spread = np.atleast_2d(np.cov(draws, rowvar=False)).astype(np.float64)
        return np.asarray(draws.mean(axis=0), dtype=np.float64), spread
    grid = np.linspace(*speeds, _CURVE_SPEEDS)
    curves = curve(law, draws, grid, speeds)
    mean = curves.mean(axis=0)

    def away(values: FloatArray) -> FloatArray:
        return np.asarray(curve(law, values[None, :], grid, speeds)[0] - mean)

    near = minimise(away, np.median(draws, axis=0))
    inverse: NDArray[np.floating] = np.linalg.pinv(near.jacobian, rcond=_MIN_RELATIVE_SINGULAR)
    covariance = inverse @ np.atleast_2d(np.cov(curves, rowvar=False)) @ inverse.T
    return near.values, np.asarray(0.5 * (covariance + covariance.T))


def _about(value: float, draws: FloatArray) -> Estimate:
    """Standard deviation of the draws about a value that need not be their mean."""
    low, high = np.quantile(draws, [0.025, 0.975])
    std = float(np.sqrt(np.mean((draws - value) ** 2)))
    return Estimate(float(value), std, float(low), float(high))


@dataclass(frozen=True)
class LackOfFit:
    """Lack-of-fit test of a law: level means against the repeats within levels.

    Attributes
    ----------
    p : float or None
        Probability of level means at least as far from the law if it holds and only repeats vary.
    statistic : float or None
        F, the mean square of the levels about the law over that within levels.
    reason : str or None
        Why there is no test.
    """

    p: float | None
    statistic: float | None = None
    reason: str | None = None


_GRID_RATES = 200
"""Number of rates tried for the least-squares exponential: 3 % apart."""


def lack_of_fit(law: LawKind, points: CorPoints) -> LackOfFit:
    """Classical lack-of-fit test (Fisher 1922) of a parametric law, fitted by least squares.

    Parameters
    ----------
    law : LawKind
        Not the free form.
    """
    if points.level is None:
        return LackOfFit(None, reason="no setting is repeated")
    names, level = np.unique(points.level, return_inverse=True)
    level = level.ravel()
    count = np.bincount(level)
    within, between = len(level) - len(names), len(names) - len(LAW_PARAMETERS[law])
    if within < 1:
        return LackOfFit(None, reason="every level has one row: nothing is repeated")
    if between < 1:
        return LackOfFit(None, reason=f"{len(names)} levels leave nothing to test a {law} law with")
    best = math.inf
    statistic = 0.0
    for left in _residuals(law, points):
        mean = np.bincount(level, left) / count
        outer = float((count * mean**2).sum())
        inner = float(((left - mean[level]) ** 2).sum())
        if outer + inner < best:
            best = outer + inner
            statistic = math.inf if inner == 0.0 else outer / between / (inner / within)
    return LackOfFit(float(fisher.sf(statistic, between, within)), statistic)


def _residuals(law: LawKind, points: CorPoints) -> list[FloatArray]:
    """Least-squares residuals of the law; of the exponential, one for each rate tried."""
    speed, ones = points.speed, np.ones_like(points.speed)
    if law is LawKind.POWER:
        return [_left(points.cor - 1.0, speed[:, None] ** POWER)]
    if law is LawKind.CONSTANT:
        return [points.cor - points.cor.mean()]
    if law is LawKind.LINEAR:
        return [_left(points.cor, np.column_stack([ones, speed]))]
    rates = np.geomspace(0.02, 10.0, _GRID_RATES) / (0.5 * (speed.min() + speed.max()))
    return [_left(points.cor, np.column_stack([ones, np.exp(-r * speed)])) for r in rates]


def _left(values: FloatArray, columns: FloatArray) -> FloatArray:
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])
