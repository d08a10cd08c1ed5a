"""Normal equations compared with explicit least squares."""

from types import SimpleNamespace

import numpy as np
import pytest

from mismatch.fitting.fit import Linearised, priors, reduce, solve
from mismatch.fitting.scan import marginal_by_trial, price, scatter_evidence
from mismatch.forward import ForwardModel
from mismatch.records import Scatter

TRIALS, ROWS, OWN, SHARED = 5, 9, 2, 3


def _made(rng: np.random.Generator) -> tuple[Linearised, np.ndarray, np.ndarray]:
    """A linear campaign drawn from its priors, with the truth."""
    own = rng.normal(size=(TRIALS, ROWS, OWN))
    shared = rng.normal(size=(TRIALS, ROWS, SHARED))
    prior, shared_prior = np.array([4.0, 0.5]), np.array([1.0, 9.0, 0.3])
    mine = rng.normal(size=(TRIALS, OWN)) / np.sqrt(prior)
    all_share = rng.normal(size=SHARED) / np.sqrt(shared_prior)
    residual = np.einsum("tmq,tq->tm", own, mine) + shared @ all_share
    residual = residual + rng.normal(size=(TRIALS, ROWS))
    return Linearised(residual, own, shared, prior, shared_prior), mine, all_share


def _whole(system: Linearised) -> tuple[np.ndarray, np.ndarray]:
    """Full information matrix and right-hand side; shared parameters come last."""
    count = TRIALS * OWN + SHARED
    design = np.zeros((TRIALS * ROWS, count))
    for t in range(TRIALS):
        rows = slice(t * ROWS, (t + 1) * ROWS)
        design[rows, t * OWN : (t + 1) * OWN] = system.own[t]
        design[rows, TRIALS * OWN :] = system.shared[t]
    held = np.concatenate([np.tile(system.prior, TRIALS), system.shared_prior])
    return design.T @ design + np.diag(held), design.T @ system.residual.ravel()


def test_eliminating_per_trial_parameters_changes_no_answer() -> None:
    system, _, _ = _made(np.random.default_rng(1))
    matrix, vector, inverse, cross = reduce(system, np.zeros((TRIALS, OWN)), np.zeros(SHARED))
    whole, right = _whole(system)
    expected = np.linalg.solve(whole, right)
    found = solve(matrix, vector)
    assert found == pytest.approx(expected[TRIALS * OWN :], rel=1e-7)
    assert np.linalg.inv(matrix) == pytest.approx(
        np.linalg.inv(whole)[TRIALS * OWN :, TRIALS * OWN :], rel=1e-7
    )
    gradient = np.einsum("tmq,tm->tq", system.own, system.residual)
    mine = np.einsum("tqr,tr->tq", inverse, gradient - cross @ found)
    assert mine.ravel() == pytest.approx(expected[: TRIALS * OWN], rel=1e-6)


def test_intervals_of_shared_parameters_have_their_coverage() -> None:
    rng, z = np.random.default_rng(2), []
    for _ in range(200):
        system, _, true = _made(rng)
        matrix, vector, _, _ = reduce(system, np.zeros((TRIALS, OWN)), np.zeros(SHARED))
        std = np.sqrt(np.diag(np.linalg.inv(matrix)))
        z.append((solve(matrix, vector) - true) / std)
    # of 200 draws 190 ± 3.1 should be inside
    assert (np.count_nonzero(np.abs(z) < 1.96, axis=0) >= 178).all()
    assert np.std(z, axis=0) == pytest.approx(np.ones(SHARED), abs=0.2)


def test_the_score_of_a_trial_excludes_its_own_parameters() -> None:
    system, _, _ = _made(np.random.default_rng(3))
    score, information = marginal_by_trial(
        system.own, system.prior, system.residual, system.shared, np.zeros((TRIALS, OWN))
    )
    for t in range(TRIALS):
        # covariance of rows with common parameters of known prior (Rasmussen, eq. 2.36)
        covariance = np.eye(ROWS) + system.own[t] @ np.diag(1.0 / system.prior) @ system.own[t].T
        weighed = np.linalg.solve(covariance, system.shared[t])
        assert score[t] == pytest.approx(weighed.T @ system.residual[t], rel=1e-6)
        assert information[t] == pytest.approx(weighed.T @ system.shared[t], rel=1e-6)


def test_the_evidence_for_variation_is_the_ratio_of_two_gaussians() -> None:
    rng = np.random.default_rng(4)
    information = np.full((6, 1, 1), 25.0)
    value = rng.normal(0.0, 0.8, (6, 1)) + rng.normal(0.0, 0.2, (6, 1))
    spread, found = scatter_evidence(25.0 * value, information, np.array([1.0]))
    total = spread[0] ** 2 + 1.0 / 25.0

    def minus_twice_log_density(variance: float) -> float:
        return float(np.sum(value**2) / variance + 6 * np.log(variance))

    expected = minus_twice_log_density(1.0 / 25.0) - minus_twice_log_density(total)
    assert found == pytest.approx(expected, rel=1e-9)
    assert spread[0] == pytest.approx(0.8, rel=0.5)


def test_weights_with_a_prior_cost_their_information_gain() -> None:
    # the prior's volume over the posterior's (MacKay, Information Theory, section 28.1)
    assert price(np.diag([99.0, 3.0]), np.ones(2)) == pytest.approx(np.log(100.0 * 4.0))
    # a free strength is in the fit either way and has no cost; weights with a prior have one
    assert price(np.diag([99.0, 3.0]), np.array([1.0, 0.0])) == pytest.approx(np.log(100.0))
    assert price(np.diag([99.0, 3.0]), np.zeros(2)) == 0.0


def test_parameters_of_a_ball_have_the_priors_of_the_setup() -> None:
    scatter = Scatter(backswing=0.004, cor=0.005, launch_angle=0.003, cor_law=0.02,
                      launch_angle_law=0.05)  # fmt: skip
    forward = SimpleNamespace(
        mode="impact", baseline=SimpleNamespace(scatter=scatter), at_setting=()
    )
    own, laws = priors(forward, ForwardModel(()))
    assert laws**-0.5 == pytest.approx([0.02, 0.05])
    assert own[1:] ** -0.5 == pytest.approx([0.004, 0.005, 0.003])
    assert own[0] < 1e-12 or not np.isfinite(1.0 / own[0])
