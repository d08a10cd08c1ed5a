"""White or not: the spectrum of what a smooth curve leaves over.

Tracking noise is not white: neighbouring frames share errors. What matters for slow physics is
the noise at low frequency, so the spectrum of a record's residual about a polynomial is fitted
with white noise plus a first-order autoregression (Whittle's likelihood on the cosine transform).
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import dct
from scipy.optimize import minimize
from scipy.stats import f as fisher

from physics.arrays import FloatArray

__all__ = ["LEAST", "Spectrum", "fit_spectrum", "whiteness"]

DEGREE = 6
LEAST = 24
SIGNIFICANT = 9.0
LARGEST_INFLATION = 40.0


@dataclass(frozen=True)
class Spectrum:
    """Noise model of a channel.

    Attributes
    ----------
    variance : float
        Of one sample, in squared units of the input.
    share : float
        Part of it that is correlated.
    rho : float
        Correlation of that part from one sample to the next.
    """

    variance: float
    share: float
    rho: float

    @property
    def inflation(self) -> float:
        """Noise power at zero frequency over the variance; 1 if white."""
        slow = 1.0 - self.share + self.share * (1.0 + self.rho) / (1.0 - self.rho)
        return float(np.clip(slow, 1.0, LARGEST_INFLATION))


def _density(share: float, rho: float, omega: FloatArray) -> FloatArray:
    shape = (1.0 - rho**2) / (1.0 - 2.0 * rho * np.cos(omega) + rho**2)
    return np.asarray(1.0 - share + share * shape)


def fit_spectrum(pieces: list[tuple[FloatArray, FloatArray]]) -> Spectrum | None:
    """Fit the spectrum of many short records of the same noise.

    Parameters
    ----------
    pieces : list of (time, value)
        Stretches over which the physics is smooth, outliers gone.

    Returns
    -------
    Spectrum or None
        None if there is too little to tell.
    """
    omegas, powers = [], []
    for time, value in pieces:
        if value.size < LEAST:
            continue
        u = (time - time.mean()) / max(float(np.ptp(time)), 1e-12) * 2.0
        basis, _ = np.linalg.qr(np.vander(u, DEGREE + 1))
        left = value - basis @ (basis.T @ value)
        power = np.asarray(dct(left, norm="ortho")) ** 2
        keep = np.arange(DEGREE + 2, value.size)
        omegas.append(np.pi * keep / value.size)
        powers.append(power[keep])
    if not omegas:
        return None
    omega, power = np.concatenate(omegas), np.concatenate(powers)
    white = max(float(power.mean()), 1e-30)

    def cost(p: FloatArray) -> float:
        share, rho = 1.0 / (1.0 + np.exp(-p[0])), 0.3 + 0.68 / (1.0 + np.exp(-p[1]))
        density = _density(share, rho, omega)
        level = float(np.mean(power / density))
        return float(np.log(level) * omega.size + np.sum(np.log(density)))

    flat = float(np.log(white) * omega.size)
    best = min(
        (
            minimize(cost, np.array(start), method="Nelder-Mead", options={"maxiter": 120})
            for start in ((-1.0, 0.5), (-1.0, 2.0))
        ),
        key=lambda result: float(result.fun),
    )
    if flat - float(best.fun) < SIGNIFICANT:
        return Spectrum(white, 0.0, 0.0)
    share = float(1.0 / (1.0 + np.exp(-best.x[0])))
    rho = float(0.3 + 0.68 / (1.0 + np.exp(-best.x[1])))
    level = float(np.mean(power / _density(share, rho, omega)))
    return Spectrum(level, share, rho)


def whiteness(pieces: list[tuple[FloatArray, FloatArray]], low: int = 8) -> float:
    """Probability that standardised residuals have no more low-frequency power than white noise.

    The power of the `low` slowest cosines of each piece is compared with its other power.
    """
    slow, n_slow, fast, n_fast = 0.0, 0, 0.0, 0
    for _, value in pieces:
        if value.size < LEAST:
            continue
        power = np.asarray(dct(value, norm="ortho")) ** 2
        slow += float(power[:low].sum())
        n_slow += low
        fast += float(power[low:].sum())
        n_fast += value.size - low
    if not n_slow or not n_fast or fast <= 0.0:
        return 1.0
    ratio = (slow / n_slow) / (fast / n_fast)
    return float(fisher.sf(ratio, n_slow, n_fast))
