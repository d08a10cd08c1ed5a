"""Laws of restitution against truth known beforehand."""

import numpy as np
import pytest
from scipy.stats import binom

from physics.cor_fit import AveragedLaw, CorPoints, LawKind, fit_cor_laws


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
