"""Strikes that do not belong: the generalised ESD test (Rosner, Technometrics 25, 165, 1983)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

__all__ = ["FALSE_ALARMS", "Outlier", "find_outliers"]

FloatArray = NDArray[np.float64]

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
