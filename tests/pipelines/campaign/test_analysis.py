"""Statistics of a campaign against published examples, and laws against truth known beforehand."""

import numpy as np
import pytest
from scipy.stats import binom

from pipelines.campaign.analysis import (
    AveragedLaw,
    BallAnalysis,
    CorPoints,
    agreement,
    find_outliers,
    fit_cor_laws,
    precision,
)
from pipelines.setup.cor_file import LawKind

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


def _campaign(rng: np.random.Generator) -> CorPoints:
    """Eight back-swings, three strikes each in three sessions, jokku's law (Eq. 24)."""
    speed = np.repeat([1.1, 1.6, 2.2, 2.7, 3.1, 3.5, 3.8, 4.0], 3)
    session = np.tile([0, 1, 2], 8)
    cor = _law(speed) + rng.normal(0, 0.008, 24) + rng.normal(0, 0.003, 3)[session]
    shared = np.full((24, 1), 0.004)
    return CorPoints(speed, cor + shared[:, 0] * rng.normal(), np.full(24, 0.006), shared, session)


def _law(speed: np.ndarray) -> np.ndarray:
    return 0.1305 * np.exp(-0.2685 * speed - 0.1953) + 0.6746


@pytest.mark.parametrize("campaigns", [3, pytest.param(60, marks=pytest.mark.slow)])
def test_intervals_hold_the_law_as_often_as_they_say(campaigns: int) -> None:
    rng = np.random.default_rng(7)
    held = []
    for _ in range(campaigns):
        fits = {fit.law: fit for fit in fit_cor_laws(_campaign(rng))}
        fit = fits[LawKind.EXPONENTIAL]
        for speed in (1.5, 2.5, 3.5):
            found = fit.at(speed)
            held.append(found.low <= _law(np.array(speed)) <= found.high)
        truth = {"a": 0.1305 * np.exp(-0.1953), "b": 0.2685, "d": 0.6746}
        held += [
            fit.parameters[name].low <= v <= fit.parameters[name].high for name, v in truth.items()
        ]
    # six statements a campaign are not independent: count them as two
    assert np.mean(held) >= binom.ppf(0.001, 2 * campaigns, 0.95) / (2 * campaigns)


def test_the_law_of_a_constant_ball_is_not_called_exponential_with_certainty() -> None:
    rng = np.random.default_rng(3)
    speed = np.linspace(1, 4, 24)
    points = CorPoints(
        speed,
        0.75 + rng.normal(0, 0.006, 24),
        np.full(24, 0.006),
        np.zeros((24, 0)),
        np.zeros(24, int),
    )
    fits = {fit.law: fit for fit in fit_cor_laws(points)}
    assert fits[LawKind.CONSTANT].probability > 0.4
    assert fits[LawKind.POWER].probability < 0.01
    assert fits[LawKind.CONSTANT].at(2.0).value == pytest.approx(0.75, abs=0.005)


def test_a_shared_error_does_not_average_away() -> None:
    rng = np.random.default_rng(5)
    points = _campaign(rng)
    large = CorPoints(points.speed, points.cor, points.std, 10 * points.shared, points.session)
    fits = [
        {fit.law: fit for fit in fit_cor_laws(each)}[LawKind.CONSTANT].parameters["d"].std
        for each in (points, large)
    ]
    assert fits[1] > 0.035
    assert fits[0] < 0.5 * fits[1]


def test_the_band_holds_the_doubt_about_the_law_itself() -> None:
    rng = np.random.default_rng(4)
    speed = np.repeat([1.0, 2.5, 4.0], 3)
    cor = 0.75 - 0.012 * (speed - 2.5) + rng.normal(0.0, 0.004, len(speed))
    own, none = np.full(len(speed), 0.004), np.zeros(len(speed), np.int64)
    fits = fit_cor_laws(CorPoints(speed, cor, own, np.zeros((len(speed), 1)), none))
    averaged = AveragedLaw(fits)
    for at in (1.0, 4.0):
        mean = sum(fit.probability * fit.at(at).value for fit in fits)
        spread = sum(
            fit.probability * (fit.at(at).std ** 2 + (fit.at(at).value - mean) ** 2) for fit in fits
        )
        assert averaged.at(at).value == pytest.approx(mean, abs=5e-4)
        assert averaged.at(at).std == pytest.approx(np.sqrt(spread), rel=0.1)
        assert averaged.next_strike(at).std >= averaged.at(at).std
