"""Fits of restitution laws."""

import numpy as np
import pytest

from metrology import DomainError, TooLittleDataError
from physics.bodies import JOKKU
from physics.restitution import ConstantCor, PowerLawCor, compare_cor_fits, fit_cor

SPEEDS = np.linspace(0.5, 6.0, 12)


def test_exact_data_return_their_parameters() -> None:
    fit = fit_cor(SPEEDS, JOKKU.cor(SPEEDS), model="exponential")
    best = {p.name: p.value for p in fit.parameters}
    assert best["rate"] == pytest.approx(0.2685, rel=1e-4)
    assert best["floor"] == pytest.approx(0.6746, rel=1e-4)
    assert best["amplitude"] == pytest.approx(0.1305 * np.exp(-0.1953), rel=1e-4)
    np.testing.assert_allclose(fit.law(SPEEDS), JOKKU.cor(SPEEDS), atol=1e-7)


@pytest.mark.parametrize(
    ("model", "truth"),
    [
        ("exponential", JOKKU.cor),
        ("power", PowerLawCor(0.19)),
        ("constant", ConstantCor(0.74)),
    ],
)
def test_the_law_that_made_the_data_is_preferred(model: str, truth: PowerLawCor) -> None:
    generator = np.random.default_rng(5)
    noisy = truth(SPEEDS) + generator.normal(0.0, 0.0008, SPEEDS.size)
    fits = compare_cor_fits(SPEEDS, noisy, np.full(SPEEDS.size, 0.0008))
    assert fits[0].model == model


def test_intervals_have_their_nominal_coverage() -> None:
    generator = np.random.default_rng(11)
    std = np.full(SPEEDS.size, 0.003)
    held = []
    for _ in range(200):
        noisy = PowerLawCor(0.19)(SPEEDS) + generator.normal(0.0, std)
        parameter = fit_cor(SPEEDS, noisy, std, model="power").parameters[0]
        held.append(parameter.low <= 0.19 <= parameter.high)
    assert 0.90 <= np.mean(held) <= 0.99


def test_too_few_points_and_unknown_laws_are_errors() -> None:
    with pytest.raises(TooLittleDataError):
        fit_cor(np.array([1.0, 2.0]), np.array([0.8, 0.7]), model="exponential")
    with pytest.raises(TooLittleDataError):
        compare_cor_fits(np.array([]), np.array([]))
    with pytest.raises(DomainError):
        fit_cor(SPEEDS, JOKKU.cor(SPEEDS), model="parabola")
    with pytest.raises(DomainError):
        fit_cor(-SPEEDS, JOKKU.cor(SPEEDS), model="power")
    assert {f.model for f in compare_cor_fits(SPEEDS[:2], np.array([0.8, 0.7]))} == {
        "power",
        "constant",
    }
