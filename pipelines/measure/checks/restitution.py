"""The estimates of the coefficient of restitution: their mean, and whether they agree."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtr

from metrology import Contribution, Quantity, UncertaintySource
from pipelines.measure.checks.power import LEAST_POWER
from pipelines.measure.derived import DERIVED
from pipelines.report import Check, CheckKind, CheckOutcome

__all__ = ["ESTIMATES", "fused_cor"]

FloatArray = NDArray[np.float64]

ESTIMATES = ("cor_speeds", "cor_launch", "cor_range")
_SIGMAS, _CHANCE = 3.0, 0.003
RELEVANT = 0.1
"""Difference between two estimates that would matter, of the coefficient of restitution."""
MODEL_STD = {"cor_speeds": 0.002, "cor_launch": 0.004, "cor_range": 0.004}
"""What each estimate leaves out: the rigid balance of Eqs 8-10 knows no ball that slides."""


def fused_cor(
    values: FloatArray,
    random: FloatArray,
    systematic: dict[UncertaintySource, FloatArray],
    found: dict[str, Quantity],
) -> tuple[Quantity, Check | None]:
    """Best linear unbiased mean of the estimates that exist, and their agreement.

    Parameters
    ----------
    values, random, systematic
        As in `Evaluated`.
    found : dict
        Quantities by name; one that is missing there takes no part.
    """
    names = list(DERIVED)
    estimates = [name for name in ESTIMATES if found[name].known]
    if not estimates:
        return Quantity.missing("cor", "1", str(found["cor_speeds"].reason)), None
    at = [names.index(name) for name in estimates]
    covariance = random[np.ix_(at, at)].copy()
    for column in systematic.values():
        share = np.nan_to_num(column[at])
        covariance += np.outer(share, share)
    covariance += np.diag([MODEL_STD[name] ** 2 for name in estimates])
    covariance += 1e-8 * np.eye(len(at))
    weight = np.linalg.solve(covariance, np.ones(len(at)))
    weight /= weight.sum()
    # noise that all estimates share can drive weights beyond 0..1: no estimate is trusted backwards
    weight = np.clip(weight, 0.0, None)
    weight /= weight.sum()
    value = float(weight @ values[at])
    std = float(np.sqrt(weight @ covariance @ weight))
    fused = Quantity.measured("cor", value, "1", (Contribution(UncertaintySource.COR_MEAN, std),))
    if len(at) < 2:
        return fused, None
    return fused, _agreement(values[at], covariance, estimates)


def _agreement(values: FloatArray, covariance: FloatArray, estimates: list[str]) -> Check:
    step = np.diff(np.eye(len(values)), axis=0)
    apart = step @ values
    spread = step @ covariance @ step.T
    chance = float(chdtrc(len(apart), apart @ np.linalg.solve(spread, apart)))
    listed = ", ".join(f"{name} {value:.3f}" for name, value in zip(estimates, values, strict=True))
    closest = float(np.sqrt(np.diag(spread).min()))
    power = float(ndtr(-_SIGMAS + RELEVANT / closest))
    if chance < _CHANCE:
        text = (
            f"the estimates of the coefficient of restitution disagree ({listed}):"
            " check the pendulum's inertia and the ball's mass in the setup file"
        )
        return Check(CheckKind.COR_AGREEMENT, CheckOutcome.FAILED, text, power)
    if power < LEAST_POWER:
        text = f"the estimates ({listed}) are too unsure to tell a difference of {RELEVANT:g}"
        return Check(CheckKind.COR_AGREEMENT, CheckOutcome.UNDECIDED, text, power)
    return Check(CheckKind.COR_AGREEMENT, CheckOutcome.PASSED, f"they agree ({listed})", power)
