"""Agreement of camera and sensor (Bland and Altman, Lancet 327, 307, 1986)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

__all__ = ["Agreement", "agreement"]

FloatArray = NDArray[np.float64]


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
