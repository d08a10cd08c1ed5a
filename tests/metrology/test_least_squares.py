"""Least squares compared with closed forms, and responses with new fits."""

import ast
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from metrology import NoFitError
from metrology.least_squares import (
    Downhill,
    Residuals,
    descend,
    fit,
    minimise,
    moved_fit,
)

FloatArray = NDArray[np.float64]
TIME = np.linspace(0.0, 1.0, 60)


def decay(data: FloatArray, std: float = 0.01) -> Residuals:
    """An exponential a exp(-b t) + c against data."""

    def residuals(values: FloatArray) -> FloatArray:
        a, b, c = (values[..., [index]] for index in range(3))
        return np.asarray((a * np.exp(-b * TIME) + c - data) / std)

    return residuals


def data_of(seed: int) -> FloatArray:
    noise = np.random.default_rng(seed).normal(0.0, 0.01, len(TIME))
    noise[7], noise[31] = 0.08, -0.06
    return np.asarray(2.0 * np.exp(-1.5 * TIME) + 0.3 + noise)


def test_a_straight_line_has_the_known_covariance() -> None:
    design = np.stack([np.ones_like(TIME), TIME], axis=1) / 0.1
    noise = np.random.default_rng(1).uniform(-0.5, 0.5, len(TIME))
    data = design @ [1.0, -2.0] + noise
    found = fit(lambda values: design @ values - data, [0.0, 0.0])
    assert found.chi2_per_dof < 1.3
    expected = np.linalg.inv(design.T @ design) * found.chi2_per_dof
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-4)
    assert np.abs(found.values - [1.0, -2.0]).max() < 0.05


def test_a_stack_of_parameters_gives_the_same_fit_as_one_after_the_other() -> None:
    start, spread = [1.0, 1.0, 0.0], [np.inf, 0.5, np.inf]
    one = fit(decay(data_of(2)), start, start, spread)
    stack = fit(decay(data_of(2)), start, start, spread, stacked=True)
    np.testing.assert_allclose(stack.values, one.values, rtol=1e-9)
    np.testing.assert_allclose(stack.covariance, one.covariance, rtol=1e-6)


@pytest.mark.parametrize("moved_by", [1e-4, 0.05])
def test_the_response_to_changed_data_equals_a_new_fit(moved_by: float) -> None:
    """Also by five times the noise, with outliers that the loss holds back."""
    data = data_of(3)
    drift = moved_by * (1.0 + TIME)
    start = [2.0, 1.5, 0.3]
    near = fit(decay(data), start, stacked=True)
    near = fit(decay(data), near.values, stacked=True)
    anew = fit(decay(data + drift), near.values, stacked=True)
    anew = fit(decay(data + drift), anew.values, stacked=True)
    response = moved_fit(near, decay(data + drift))
    change = anew.values - near.values
    assert np.abs(response.values - anew.values).max() < 0.02 * np.abs(change).max() + 1e-6


def test_the_response_to_changed_priors_equals_a_new_fit() -> None:
    data, spread = data_of(4), [np.inf, 0.02, np.inf]
    near = fit(decay(data), [2.0, 1.5, 0.3], [2.0, 1.4, 0.3], spread, stacked=True)
    anew = fit(decay(data), near.values, [2.0, 1.404, 0.3], spread, stacked=True)
    response = moved_fit(near, decay(data), [2.0, 1.404, 0.3], spread)
    change = anew.values - near.values
    assert np.abs(change[1]) > 0.05 * 0.02
    # the misfit that weighs the priors may change with them
    assert np.abs(response.values - anew.values).max() < 0.06 * np.abs(change).max()


def test_residuals_of_varying_number_are_refused() -> None:
    near = fit(decay(data_of(5)), [2.0, 1.5, 0.3], stacked=True)
    with pytest.raises(ValueError, match="repeat the fit"):
        moved_fit(near, lambda values: decay(data_of(5))(values)[1:])


def test_outliers_affect_a_robust_minimum_little_and_a_plain_one_much() -> None:
    data, start = data_of(4), [2.0, 1.5, 0.3]
    data[10] += 1.0
    plain = minimise(decay(data), start)
    soft = minimise(decay(data), start, soft_from=2.5)
    clean = minimise(decay(data_of(4)), start, soft_from=2.5)
    assert (
        np.abs(soft.values - clean.values).max() < 0.2 * np.abs(plain.values - clean.values).max()
    )
    np.testing.assert_allclose(soft.values, fit(decay(data), start).values, rtol=1e-4)
    left = soft.residuals / 2.5
    assert soft.cost == pytest.approx(2.5**2 * float((np.sqrt(1.0 + left**2) - 1.0).sum()))


def test_a_minimum_stays_within_its_bounds() -> None:
    found = minimise(decay(data_of(5)), [1.0, 1.0, 0.1], high=[np.inf, 1.2, np.inf])
    assert found.values[1] == pytest.approx(1.2, abs=1e-3)
    assert minimise(decay(data_of(5)), [1.0, 1.0, 0.1]).values[1] > 1.3


def test_non_finite_residuals_are_refused() -> None:
    with pytest.raises(NoFitError):
        minimise(lambda values: np.full(3, np.nan) + values[0], [1.0])


def test_a_descent_halves_steps_that_are_too_long_and_stops_without_gain() -> None:
    """Newton's step for the root of the arc tangent leaps ever farther away from 1.4 on."""
    looks: list[float] = []

    def looking(x: float) -> Downhill[float]:
        looks.append(x)
        return Downhill(float(np.arctan(x)) ** 2, float(-np.arctan(x) * (1.0 + x * x)))

    found = descend(
        3.0,
        looking,
        lambda x, step, share: x + share * step,
        lambda x, _: float(np.arctan(x)) ** 2,
        settled=lambda seen, reached: seen.cost - reached < 1e-12,
        most_steps=20,
    )
    assert abs(found) < 1e-6
    assert 3 < len(looks) < 12
    stuck = descend(
        1.0,
        looking,
        lambda x, step, share: x - share * step,
        lambda x, _: float(np.arctan(x)) ** 2,
        settled=lambda *_: False,
        most_steps=20,
    )
    assert stuck == 1.0


def test_all_modules_use_the_unit_parser() -> None:
    """Fits elsewhere call it; what scipy has for them is asked here alone."""
    root = Path(__file__).parents[2]
    solvers = {"least_squares", "leastsq", "curve_fit"}
    round_it = []
    for package in ("calib", "physics", "vision", "measuring", "pipelines", "mismatch"):
        for path in (root / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                module = getattr(node, "module", "") or ""
                names = {
                    one.name for one in getattr(node, "names", ()) if isinstance(one, ast.alias)
                }
                imported = module.startswith("scipy") and solvers & names
                called = isinstance(node, ast.Attribute) and node.attr in solvers
                if imported or called:
                    round_it.append(f"{path.relative_to(root)}:{getattr(node, 'lineno', 0)}")
    assert round_it == []
