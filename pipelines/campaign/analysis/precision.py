"""Repeatability and reproducibility of a method of measurement (ISO 5725-2).

Agreement of camera and sensor (Bland and Altman, Lancet 327, 307, 1986).

Strikes that do not belong: the generalised ESD test (Rosner, Technometrics 25, 165, 1983).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import t as student

__all__ = ["Agreement", "Outlier", "Precision", "agreement", "find_outliers", "precision"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Precision:
    """Standard deviations as ISO 5725-2 has them, in the unit of the values.

    Attributes
    ----------
    repeatability : float
        s_r, within a session.
    repeatability_low, repeatability_high : float
        95 % interval of s_r.
    between : float or None
        s_L, between sessions; None with one session.
    reproducibility : float or None
        s_R = √(s_r² + s_L²).
    values, sessions : int
        How many.
    """

    repeatability: float
    repeatability_low: float
    repeatability_high: float
    between: float | None
    reproducibility: float | None
    values: int
    sessions: int

    @property
    def limit(self) -> float:
        """r: two strikes of a session differ by less in 95 of 100 cases (2.8 s_r)."""
        return 1.96 * math.sqrt(2.0) * self.repeatability


def precision(values: FloatArray, session: NDArray[np.int64], fitted: int = 0) -> Precision | None:
    """Precision from `values` (N,) in sessions; None where no session repeats anything.

    Parameters
    ----------
    values : (N,) array
        Residuals against what is common (the law at each impact speed), or values at one level.
    session : (N,) int array
    fitted : int
        Parameters of the law that took freedom from the residuals.
    """
    names, number = np.unique(session, return_counts=True)
    within = len(values) - len(names) - fitted
    if within < 1:
        return None
    means = np.array([values[session == name].mean() for name in names])
    own_mean = means[np.searchsorted(names, session)]
    inner = float(((values - own_mean) ** 2).sum())
    s_r2 = inner / within
    between: float | None = None
    if len(names) > 1:
        grand = values.mean()
        outer = float((number * (means - grand) ** 2).sum()) / (len(names) - 1)
        typical = (len(values) - (number**2).sum() / len(values)) / (len(names) - 1)
        between = float(np.sqrt(max(0.0, (outer - s_r2) / typical)))
    return Precision(
        repeatability=float(np.sqrt(s_r2)),
        repeatability_low=float(np.sqrt(inner / chi2.ppf(0.975, within))),
        repeatability_high=float(np.sqrt(inner / chi2.ppf(0.025, within))),
        between=between,
        reproducibility=None if between is None else float(np.hypot(np.sqrt(s_r2), between)),
        values=len(values),
        sessions=len(names),
    )


@dataclass(frozen=True)
class Agreement:
    """Differences camera − sensor of N pairs, in the unit of both.

    Attributes
    ----------
    bias, bias_std : float
        Mean difference and its standard uncertainty.
    scatter : float
        Standard deviation of the differences.
    lower, upper : float
        95 % limits of agreement.
    limits_std : float
        Standard uncertainty of either limit, √(3/N) of the scatter.
    slope, slope_std : float
        Of the differences over the means: does the disagreement grow with the quantity?
    pairs : int
    means, differences : (N,) array
    """

    bias: float
    bias_std: float
    scatter: float
    lower: float
    upper: float
    limits_std: float
    slope: float
    slope_std: float
    pairs: int
    means: FloatArray
    differences: FloatArray

    @property
    def biased(self) -> bool | None:
        """Whether the bias is beyond chance (95 %); None with fewer than three pairs."""
        if self.pairs < 3:
            return None
        return bool(abs(self.bias) > student.ppf(0.975, self.pairs - 1) * self.bias_std)


def agreement(camera: FloatArray, sensor: FloatArray) -> Agreement | None:
    """Compare pairs (N,); None with fewer than two."""
    both = np.isfinite(camera) & np.isfinite(sensor)
    camera, sensor = camera[both], sensor[both]
    number = len(camera)
    if number < 2:
        return None
    differences, means = camera - sensor, (camera + sensor) / 2
    bias, scatter = float(differences.mean()), float(differences.std(ddof=1))
    slope, slope_std = _slope(means, differences)
    return Agreement(
        bias=bias,
        bias_std=scatter / np.sqrt(number),
        scatter=scatter,
        lower=bias - 1.96 * scatter,
        upper=bias + 1.96 * scatter,
        limits_std=float(np.sqrt(3 / number) * scatter),
        slope=slope,
        slope_std=slope_std,
        pairs=number,
        means=means,
        differences=differences,
    )


def _slope(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    centred = x - x.mean()
    spread = float((centred**2).sum())
    if len(x) < 3 or spread == 0:
        return 0.0, float("inf")
    slope = float((centred * y).sum()) / spread
    rest = y - y.mean() - slope * centred
    return slope, float(np.sqrt((rest**2).sum() / (len(x) - 2) / spread))


FALSE_ALARMS = 0.05

"""Chance that a clean set has any outlier named."""

_MOST_SHARE = 0.2

"""More than a fifth are no outliers but another population."""


@dataclass(frozen=True)
class Outlier:
    """A value that the test names.

    Attributes
    ----------
    index : int
        Into the values tested.
    distance : float
        From the mean of the others kept, in their standard deviations.
    critical : float
        What the test allows.
    """

    index: int
    distance: float
    critical: float


def find_outliers(values: FloatArray) -> tuple[Outlier, ...]:
    """Outliers among `values` (N,), the furthest first; none is looked for in fewer than six.

    Values are standardised residuals against a law, so that slow and fast strikes compare.
    """
    kept = np.flatnonzero(np.isfinite(values))
    number = len(kept)
    if number < 6:
        return ()
    removed: list[Outlier] = []
    named = 0
    for i in range(1, max(1, int(_MOST_SHARE * number)) + 1):
        sample = values[kept]
        spread = float(sample.std(ddof=1))
        if spread == 0:
            break
        distances = np.abs(sample - sample.mean()) / spread
        worst = int(distances.argmax())
        critical = _critical(number, i)
        removed.append(Outlier(int(kept[worst]), float(distances[worst]), critical))
        if distances[worst] > critical:
            named = i
        kept = np.delete(kept, worst)
    return tuple(removed[:named])


def _critical(number: int, i: int) -> float:
    left = number - i
    quantile = student.ppf(1 - FALSE_ALARMS / (2 * (left + 1)), left - 1)
    return float(left * quantile / np.sqrt((left - 1 + quantile**2) * (left + 1)))
