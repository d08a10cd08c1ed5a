"""Three roads to the coefficient of restitution, fused, and whether they agree."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from metrology import Contribution, Quantity, UncertaintySource
from pipelines.measure.derived import DERIVED
from pipelines.report import Check

__all__ = ["ROADS", "fused_cor"]

FloatArray = NDArray[np.float64]

ROADS = ("cor_speeds", "cor_launch", "cor_range")
MODEL_STD = {"cor_speeds": 0.002, "cor_launch": 0.004, "cor_range": 0.004}
"""What each road leaves out: the rigid balance of Eqs 8-10 knows no ball that slides and spins."""


def fused_cor(
    values: FloatArray,
    random: FloatArray,
    systematic: dict[UncertaintySource, FloatArray],
    found: dict[str, Quantity],
) -> tuple[Quantity, Check | None]:
    """Best linear unbiased mean of the roads that exist, and their agreement.

    Parameters
    ----------
    values, random, systematic
        As in `Evaluated`.
    found : dict
        Quantities by name; a road that is missing there takes no part.
    """
    names = list(DERIVED)
    roads = [road for road in ROADS if found[road].known]
    if not roads:
        return Quantity.missing("cor", "1", str(found["cor_speeds"].reason)), None
    at = [names.index(road) for road in roads]
    covariance = random[np.ix_(at, at)].copy()
    for column in systematic.values():
        share = np.nan_to_num(column[at])
        covariance += np.outer(share, share)
    covariance += np.diag([MODEL_STD[road] ** 2 for road in roads])
    covariance += 1e-8 * np.eye(len(at))
    weight = np.linalg.solve(covariance, np.ones(len(at)))
    weight /= weight.sum()
    # noise that all roads share can drive weights beyond 0..1: no road is trusted backwards
    weight = np.clip(weight, 0.0, None)
    weight /= weight.sum()
    value = float(weight @ values[at])
    std = float(np.sqrt(weight @ covariance @ weight))
    fused = Quantity.measured("cor", value, "1", (Contribution(UncertaintySource.COR_MEAN, std),))
    if len(at) < 2:
        return fused, None
    return fused, _agreement(values[at], covariance, roads)


def _agreement(values: FloatArray, covariance: FloatArray, roads: list[str]) -> Check:
    step = np.diff(np.eye(len(values)), axis=0)
    apart = step @ values
    spread = step @ covariance @ step.T
    chance = float(chdtrc(len(apart), apart @ np.linalg.solve(spread, apart)))
    listed = ", ".join(f"{road} {value:.3f}" for road, value in zip(roads, values, strict=True))
    if chance < 0.003:
        text = (
            f"the roads to the coefficient of restitution disagree ({listed}):"
            " check the pendulum's inertia and the ball's mass in the setup file"
        )
        return Check("agreement of the roads to the COR", False, text)
    return Check("agreement of the roads to the COR", True, f"the roads agree ({listed})")
