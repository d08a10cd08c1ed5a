"""Repeatability and reproducibility of a method of measurement (ISO 5725-2)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

__all__ = ["Precision", "precision"]

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
