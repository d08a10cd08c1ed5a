"""Statistics of a campaign against published examples, and laws against truth known beforehand."""

import numpy as np
import pytest
from scipy.stats import binom

from pipelines.campaign.analysis import (
    BallAnalysis,
    agreement,
    find_outliers,
    precision,
)

# NIST/SEMATECH e-Handbook 1.3.5.17.3, Rosner's 54 values: three outliers at 5 %
ROSNER = """-0.25 0.68 0.94 1.15 1.20 1.26 1.26 1.34 1.38 1.43 1.49 1.49 1.55 1.56 1.58 1.65 1.69
1.70 1.76 1.77 1.81 1.91 1.94 1.96 1.99 2.06 2.09 2.10 2.14 2.15 2.23 2.24 2.26 2.35 2.37 2.40 2.47
2.54 2.62 2.64 2.90 2.92 2.92 2.93 3.21 3.26 3.30 3.59 3.68 4.30 4.64 5.34 5.42 6.01"""
# Bland and Altman 1986, Table 1: peak flow by two meters, l/min
WRIGHT = [494, 395, 516, 434, 476, 557, 413, 442, 650, 433, 417, 656, 267, 478, 178, 423, 427]
MINI = [512, 430, 520, 428, 500, 600, 364, 380, 658, 445, 432, 626, 260, 477, 259, 350, 451]


def test_rosners_three_outliers_are_named() -> None:
    values = np.array(ROSNER.split(), float)
    found = find_outliers(values)
    assert sorted(values[item.index] for item in found) == [5.34, 5.42, 6.01]
    assert [item.distance for item in found] == pytest.approx([3.118, 2.942, 3.179], abs=1e-3)
    assert [item.critical for item in found] == pytest.approx([3.158, 3.151, 3.143], abs=2e-3)


def test_an_outlier_is_told_by_the_scatter_that_names_it() -> None:
    distances = np.array([0.3, -0.3, 0.2, -0.2, 0.1, -0.1, 0.0, 0.25, -0.25, 3.0])
    found = find_outliers(distances)
    none = np.zeros((0, 2))
    ball = BallAnalysis("b", (), None, (), None, found, distances, None, None, none, none)
    times = (3.0 - distances.mean()) / distances.std(ddof=1)
    said = ball.why_outlying(found[0])
    assert f"{times:.1f} standard deviations from the other clips" in said
    assert "3.0 stated standard uncertainties from the law of b" in said


def test_clean_sets_have_few_outliers() -> None:
    rng = np.random.default_rng(4)
    named = sum(bool(find_outliers(rng.normal(size=24))) for _ in range(400))
    assert named <= binom.ppf(0.999, 400, 0.05)


def test_the_peak_flow_example_comes_out() -> None:
    found = agreement(np.array(WRIGHT, float), np.array(MINI, float))
    assert found is not None
    assert found.bias == pytest.approx(-2.1, abs=0.05)
    assert found.scatter == pytest.approx(38.8, abs=0.05)
    assert found.limits_std == pytest.approx(16.3, abs=0.1)
    assert found.biased is False


def test_precision_tells_sessions_from_strikes() -> None:
    rng = np.random.default_rng(1)
    session = np.repeat(np.arange(40), 6)
    values = rng.normal(0, 0.005, 240) + rng.normal(0, 0.010, 40)[session]
    found = precision(values, session)
    assert found is not None
    assert found.repeatability_low < 0.005 < found.repeatability_high
    assert found.between == pytest.approx(0.010, rel=0.35)
    assert found.reproducibility == pytest.approx(np.hypot(found.repeatability, found.between))
