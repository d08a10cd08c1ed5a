"""White or not: the spectrum of what a smooth curve leaves over.

Tracking noise is not white: neighbouring frames share errors. What matters for slow physics is
the noise at low frequency, so the spectrum of a record's residual about a polynomial is fitted
with white noise plus a first-order autoregression (Whittle's likelihood on the cosine transform).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.fft import dct
from scipy.signal import lfilter
from scipy.stats import chi2
from scipy.stats import f as fisher

from physics.arrays import FloatArray

__all__ = ["LEAST", "Spectrum", "SpectrumFit", "fit_spectrum", "shared_deviance", "whiteness"]

DEGREE = 6
LEAST = 24
APART = 0.001
"""Probability below which channels are said to have different memories."""

LARGEST_INFLATION = 40.0
RHOS = 1.0 - np.geomspace(0.7, 0.025, 12)
SHARES = np.linspace(0.03, 0.97, 33)


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
    inflation : float
        Noise power at the pace of slow physics over the variance; 1 if white.
    """

    variance: float
    share: float
    rho: float
    inflation: float = 1.0


def _density(share: float, rho: float, omega: FloatArray) -> FloatArray:
    shape = (1.0 - rho**2) / (1.0 - 2.0 * rho * np.cos(omega) + rho**2)
    return np.asarray(1.0 - share + share * shape)


@lru_cache(maxsize=512)
def _expected(size: int) -> tuple[FloatArray, FloatArray]:
    """Powers that noise of unit variance leaves in the cosines kept: white (n,), correlated (R, n).

    A polynomial takes its part of slow noise along, from cosines beyond its degree as well.
    """
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, size), DEGREE + 1))
    look = dct(np.eye(size) - basis @ basis.T, norm="ortho", axis=0)[DEGREE + 2 :]
    slow = []
    for rho in RHOS:
        ahead = lfilter([1.0], [1.0, -rho], look, axis=1)
        back = lfilter([1.0], [1.0, -rho], look[:, ::-1], axis=1)[:, ::-1]
        slow.append(np.sum(look * (ahead + back - look), axis=1))
    return np.sum(look * look, axis=1), np.array(slow)


@dataclass(frozen=True)
class SpectrumFit:
    """How well every shape of a spectrum fits a channel.

    Attributes
    ----------
    deviance : (R, S) array
        −2 log likelihood by correlation (`RHOS`) and correlated share (`SHARES`).
    variance, rise : (R, S) arrays
        Variance of one sample, and power at the pace of slow physics over it.
    extrapolation : (R, S) array
        Part of the deviance that keeps the power small where no cosine shows it.
    flat : float
        Deviance of white noise.
    level : float
        Variance if the noise is white.
    """

    deviance: FloatArray
    variance: FloatArray
    rise: FloatArray
    extrapolation: FloatArray
    flat: float
    level: float

    def chosen(self, significant: float, shared: FloatArray | None = None) -> Spectrum:
        """White unless memory gains `significant`; the shape by `shared` deviances if given."""
        if self.flat - self.deviance.min() < significant:
            return Spectrum(self.level, 0.0, 0.0)
        cost = self.deviance if shared is None else shared
        # Short records leave a ridge of equally good answers; their mean beats any one of them.
        weight = np.exp(-0.5 * (cost - cost.min()))
        weight /= weight.sum()
        variance = float(np.exp(np.sum(weight * np.log(self.variance))))
        power_there = float(np.exp(np.sum(weight * np.log(self.variance * self.rise))))
        at = np.unravel_index(int(np.argmin(cost)), cost.shape)
        inflation = float(np.clip(power_there / variance, 1.0, LARGEST_INFLATION))
        return Spectrum(variance, float(SHARES[at[1]]), float(RHOS[at[0]]), inflation)


def fit_spectrum(
    pieces: list[tuple[FloatArray, FloatArray]], slow_mode: float = 1.0
) -> SpectrumFit | None:
    """Fit the spectrum of many short records of the same noise.

    Parameters
    ----------
    pieces : list of (time, value)
        Stretches over which the physics is smooth, outliers gone.
    slow_mode : float
        Cosine of a piece at whose pace slow physics competes with noise.

    Returns
    -------
    SpectrumFit or None
        None if there is too little to tell.
    """
    powers, whites, slows, sizes = [], [], [], []
    for time, value in pieces:
        if value.size < LEAST:
            continue
        u = (time - time.mean()) / max(float(np.ptp(time)), 1e-12) * 2.0
        basis, _ = np.linalg.qr(np.vander(u, DEGREE + 1))
        left = value - basis @ (basis.T @ value)
        powers.append(np.asarray(dct(left, norm="ortho"))[DEGREE + 2 :] ** 2)
        white, slow = _expected(value.size)
        whites.append(white)
        slows.append(slow)
        sizes.append(np.full(value.size, value.size))
    if not powers:
        return None
    power, white = np.concatenate(powers), np.concatenate(whites)
    slow = np.concatenate(slows, axis=1)
    omega = np.pi * slow_mode / float(np.median(np.concatenate(sizes)))
    cost, levels = np.zeros((RHOS.size, SHARES.size)), np.zeros((RHOS.size, SHARES.size))
    rise = np.zeros_like(cost)
    for j, share in enumerate(SHARES):
        density = (1.0 - share) * white + share * slow
        levels[:, j] = np.mean(power / density, axis=1)
        rise[:, j] = [float(_density(share, rho, np.array(omega))) for rho in RHOS]
        cost[:, j] = np.log(levels[:, j]) * power.size + np.log(density).sum(axis=1)
    # Power below the slowest cosine seen is an extrapolation: the less of it the better.
    guess = 2.0 * np.log(levels * rise)
    level = float(np.mean(power / white))
    flat = np.log(level) * (power.size + 2.0) + float(np.log(white).sum())
    return SpectrumFit(cost + guess, levels, rise, guess, float(flat), level)


def shared_deviance(fits: list[SpectrumFit]) -> FloatArray | None:
    """Deviance of one shape for several channels; None where they clearly have shapes of their own.

    One tracker saw them all, so one memory is likely, and their records together tell it better.
    """
    if len(fits) < 2:
        return None
    total = np.sum([fit.deviance for fit in fits], axis=0)
    apart = float(total.min() - sum(fit.deviance.min() for fit in fits))
    if apart > chi2.isf(APART, 2 * (len(fits) - 1)):
        return None
    # One memory is one extrapolation, however many channels it was seen in.
    guess = np.mean([fit.extrapolation for fit in fits], axis=0)
    return np.asarray(total - (len(fits) - 1) * guess)


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
