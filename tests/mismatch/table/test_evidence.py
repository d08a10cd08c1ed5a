"""Evidence and posteriors of trial tables against explicit densities and draws."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import binom, multivariate_normal, norm

from mismatch.records import Scatter
from mismatch.trial_table import (
    DOUBT,
    INFLATIONS,
    Gram,
    Problem,
    TrialTable,
    evidences,
    gram_of,
    integrated,
    posterior_of,
)

TRIALS, SPEED_STD, RANGE_STD = 8, 0.03, 0.02
WIDTH = np.array([0.5, 0.2])
SCATTER = Scatter(backswing=0.01, cor=0.02, launch_angle=0.01)
RNG = np.random.default_rng(3)
COLUMNS = RNG.normal(size=(TRIALS, 2))
JACOBIAN = RNG.normal(size=(TRIALS, 4))
OWN = np.array([SPEED_STD, SCATTER.backswing, SCATTER.cor, SCATTER.launch_angle])
CHANCES = np.array([1.0 - DOUBT * (len(INFLATIONS) - 1), *[DOUBT] * (len(INFLATIONS) - 1)])


def noise(factor: float) -> np.ndarray:
    """Variance of each range: trial-to-trial variation and reading."""
    return np.square(JACOBIAN * OWN).sum(axis=1) + (factor * RANGE_STD) ** 2


def gram(residual: np.ndarray) -> Gram:
    """Ranges only, with stated uncertainties and known impact speeds."""
    values, stds = np.full((TRIALS, 3), np.nan), np.full((TRIALS, 3), np.nan)
    values[:, 0], values[:, 2], stds[:, 0], stds[:, 2] = 4.0, 3.0, SPEED_STD, RANGE_STD
    names = tuple(map(str, range(TRIALS)))
    table = TrialTable(names, (None,) * TRIALS, values, stds, np.full(TRIALS, np.nan))
    left, columns = np.full((TRIALS, 3), np.nan), np.full((TRIALS, 3, 2), np.nan)
    jacobian = np.zeros((TRIALS, 3, 4))
    left[:, 2], columns[:, 2], jacobian[:, 2] = residual, COLUMNS, JACOBIAN
    return gram_of(Problem(left, columns, jacobian), table, SCATTER)


def drawn(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Parameters drawn from their prior, and the ranges they give."""
    truth = rng.normal(scale=WIDTH)
    spread = np.sqrt(noise(float(rng.choice(INFLATIONS, p=CHANCES))))
    return truth, COLUMNS @ truth + rng.normal(scale=spread)


@pytest.mark.parametrize("chosen", [(), (0,), (1,), (0, 1)])
def test_evidence_is_the_density_of_the_data(chosen: tuple[int, ...]) -> None:
    _, residual = drawn(np.random.default_rng(4))
    picked = list(chosen)
    spread = COLUMNS[:, picked] * WIDTH[picked]
    wanted = logsumexp([
        np.log(chance) + multivariate_normal.logpdf(
            residual, cov=spread @ spread.T + np.diag(noise(factor)))
        for factor, chance in zip(INFLATIONS, CHANCES, strict=True)
    ])  # fmt: skip
    sets = np.array([picked], dtype=np.int64).reshape(1, len(picked))
    assert evidences(gram(residual), sets, WIDTH, np.zeros(2)).item() == pytest.approx(wanted)
    if chosen:
        found = posterior_of(gram(residual), sets[0], WIDTH[picked], np.zeros(len(picked)))
        assert found.log_evidence == pytest.approx(wanted)


def test_a_signed_parameter_is_integrated_over_one_side() -> None:
    _, residual = drawn(np.random.default_rng(5))
    at = np.linspace(0.0, 8.0 * WIDTH[0], 20001)
    logs = [
        np.log(chance)
        + norm.logpdf(residual - COLUMNS[:, :1].T * at[:, None], scale=np.sqrt(noise(factor))).sum(
            axis=1
        )
        for factor, chance in zip(INFLATIONS, CHANCES, strict=True)
    ]
    weighed = np.exp(logsumexp(logs, axis=0)) * 2.0 * norm.pdf(at, scale=WIDTH[0])
    wanted = float(np.log(np.trapezoid(weighed, at)))
    sign = np.array([1.0])
    found = posterior_of(gram(residual), np.array([0]), WIDTH[:1], sign)
    assert found.log_evidence == pytest.approx(wanted, abs=1e-4)


def test_the_order_of_integration_does_not_change_the_evidence() -> None:
    _, residual = drawn(np.random.default_rng(6))
    both = np.array([[0, 1]])
    left = integrated(gram(residual), 1, WIDTH[:1])
    assert evidences(left, np.array([[0]]), WIDTH[1:], np.zeros(1)) == pytest.approx(
        evidences(gram(residual), both, WIDTH, np.zeros(2))
    )


def test_posterior_intervals_have_their_coverage() -> None:
    rng = np.random.default_rng(7)
    scores = []
    for _ in range(300):
        truth, residual = drawn(rng)
        found = posterior_of(gram(residual), np.array([0, 1]), WIDTH, np.zeros(2))
        scores.append((truth - found.mean) / found.std)
    for level in (0.68, 0.95):
        low, high = binom.ppf([0.0005, 0.9995], 300, level)
        inside = (np.abs(scores) <= norm.ppf(0.5 + 0.5 * level)).sum(axis=0)
        assert np.all((low <= inside) & (inside <= high)), (level, inside)


def test_odds_of_two_answers_are_calibrated() -> None:
    """Half of 400 tables have the first effect; its stated probabilities are calibrated."""
    rng = np.random.default_rng(8)
    stated, there = [], []
    for _ in range(400):
        truth = rng.normal(scale=WIDTH) * (rng.random() < 0.5)
        spread = np.sqrt(noise(float(rng.choice(INFLATIONS, p=CHANCES))))
        held = gram(COLUMNS[:, :1] @ truth[:1] + rng.normal(scale=spread))
        with_it = evidences(held, np.array([[0]]), WIDTH, np.zeros(2)).item()
        stated.append(1.0 / (1.0 + np.exp(logsumexp(held.constant) - with_it)))
        there.append(truth[0] != 0.0)
    stated, there = np.array(stated), np.array(there)
    spread = float(np.sqrt((stated * (1.0 - stated)).sum()))
    assert abs(float(there.sum() - stated.sum())) < 3.5 * spread
    sure = stated > 0.9
    assert there[sure].sum() >= binom.ppf(0.001, sure.sum(), 0.9)
    assert there[~sure].mean() < 0.5
