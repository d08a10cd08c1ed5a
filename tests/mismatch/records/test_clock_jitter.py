"""Clock jitter: noise along the trajectory, common to all coordinates."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mismatch.explain import explain
from mismatch.fitting.prepare import prepare
from mismatch.records import BallModel, Baseline, CampaignRecords, Trial
from mismatch.verdict import Doubt
from tests.mismatch.synthetic import struck_campaign

GRAVITY = 9.80665
JITTER, NOISE = 2.5e-3, 2e-3


MASS, DIAMETER = 0.02, 0.15


def throws(jitter: float, drag: float = 0.0, seed: int = 2) -> tuple[CampaignRecords, Baseline]:
    """Eight throws at 60 Hz with jitter of the frame times."""
    rng = np.random.default_rng(seed)
    trials = []
    for number in range(8):
        written = np.arange(0.0, rng.uniform(0.5, 0.8), 1.0 / 60.0)
        true = written + 0.05 + jitter * rng.standard_normal(written.size)
        order = np.argsort(true)
        speed, up = rng.uniform(3.0, 6.0), rng.uniform(0.2, 0.9)
        start = [0.0, 1.2, 0.0, speed * np.cos(up), speed * np.sin(up), rng.normal(0.0, 0.4)]

        def rate(_, s):
            v = s[3:]
            return [*v, *(-drag * np.linalg.norm(v) * v - [0.0, GRAVITY, 0.0])]

        path = solve_ivp(rate, (0.0, 1.0), start, t_eval=true[order], rtol=1e-9, atol=1e-11)
        seen = np.empty((true.size, 3))
        seen[order] = path.y[:3].T
        seen += NOISE * rng.standard_normal(seen.shape)
        trials.append(Trial(str(number), written, seen, np.zeros(0), np.zeros(0)))
    return CampaignRecords(tuple(trials)), Baseline({"": BallModel("", MASS, DIAMETER)})


def test_clock_jitter_is_reported_and_nothing_is_named():
    campaign = throws(JITTER)
    noise = prepare(*campaign).noise
    # Fast rows with large jitter are excluded as outliers first.
    assert noise.jitter == pytest.approx(JITTER, rel=0.25)
    assert noise.sigma[:, :3] == pytest.approx(NOISE, rel=0.4)
    verdict = explain(*campaign)
    assert verdict.verdict == "no_mismatch"
    assert any("times of the samples scatter" in note for note in verdict.notes)


def test_jitter_of_a_tenth_of_the_motion_gives_no_verdict():
    campaign = throws(0.02)
    assert prepare(*campaign).noise.jitter == pytest.approx(0.02, rel=0.25)
    verdict = explain(*campaign)
    assert verdict.verdict == "unexplained"
    assert Doubt.NOISE in verdict.doubts
    assert not verdict.effects


def short_throws(
    seed: int, brake: float = 0.0, rough: float = 1.0
) -> tuple[CampaignRecords, Baseline]:
    """Eleven throws of 13 rows with noise correlated over five rows and clock jitter."""
    rng = np.random.default_rng(seed)
    trials = []
    for number in range(11):
        written = np.arange(13) / 50.0
        true = written + 0.05 + rough * 6e-3 * rng.standard_normal(written.size)
        speed, up = rng.uniform(4.0, 6.0), rng.uniform(0.5, 0.9)

        def rate(_, s):
            pull = -brake * np.hypot(*s[2:]) * s[2:]
            return [s[2], s[3], pull[0], pull[1] - GRAVITY]

        start = [0.0, 0.3, speed * np.cos(up), speed * np.sin(up)]
        path = solve_ivp(rate, (0.0, 0.4), start, rtol=1e-9, atol=1e-11, dense_output=True)
        along, height = path.sol(true)[:2]
        slow = rng.standard_normal((13, 3))
        for row in range(1, 13):
            slow[row] = 0.8 * slow[row - 1] + 0.6 * slow[row]
        off = rough * slow * [0.03, 0.012, 0.0]
        seen = np.stack([along, height], axis=1) + off[:, :2]
        seen = np.column_stack([seen, np.full(13, np.nan)])
        trials.append(Trial(str(number), written, seen, np.zeros(0), np.zeros(0)))
    return CampaignRecords(tuple(trials)), Baseline({"": BallModel("", 2.7e-3, 0.04)})


@pytest.mark.parametrize("seed", [1, 5, 6])
def test_slow_noise_is_not_underestimated_by_second_differences(seed):
    prepared = prepare(*short_throws(seed))
    assert prepared.noise.jitter > 0.0
    assert prepared.fit.reduced_chi2 < 1.3


@pytest.mark.parametrize("seed", [1, pytest.param(7, marks=pytest.mark.slow)])
def test_slow_noise_in_short_trials_is_no_force(seed):
    assert not explain(*short_throws(seed)).effects


@pytest.mark.slow
def test_drag_is_found_in_slow_noise_of_short_trials():
    strength = 0.5 * Baseline({}).air_density * np.pi / 4.0 * 0.04**2 / 2.7e-3
    (named,) = explain(*short_throws(7, 0.47 * strength, rough=0.2)).effects
    assert named.id == "drag"
    assert named.probability > 0.8
    (found,) = named.parameters
    assert found.value == pytest.approx(0.47, abs=3.0 * found.std)


@pytest.mark.slow
def test_drag_is_found_with_clock_jitter():
    strength = 0.5 * Baseline({}).air_density * np.pi / 4.0 * DIAMETER**2 / MASS
    (named,) = explain(*throws(JITTER, drag=0.47 * strength)).effects
    assert named.id == "drag"
    (found,) = named.parameters
    assert found.value == pytest.approx(0.47, abs=3.0 * found.std)


def test_an_exact_clock_has_no_jitter():
    assert prepare(*throws(0.0)).noise.jitter == 0.0
    assert prepare(*struck_campaign(seed=3)).noise.jitter == 0.0


def test_weighted_noise_is_white_and_invertible():
    rng = np.random.default_rng(9)
    known = prepare(*throws(0.0)).forward.records
    way = rng.normal(0.0, 1.5, 3)
    records = replace(known, jitter=np.broadcast_to(way, known.position.shape))
    count = known.ball_time.shape[1]
    noise = rng.standard_normal((500, known.trials, 3, count)) + (
        way[:, None] * rng.standard_normal((500, known.trials, 1, count))
    )
    sigma = known.sigma[:, :3, None]
    flat = (noise * sigma).reshape(500, known.trials, -1)
    entries = np.concatenate(
        [flat, np.zeros((500, known.trials, known.pendulum_time.shape[1]))], axis=-1
    )
    white = records.weighed(entries)
    used = records.used[0, : 3 * count].reshape(3, count).all(axis=0)
    rows = white[:, 0, : 3 * count].reshape(500, 3, count)[..., used]
    covariance = np.einsum("nas,nbs->ab", rows, rows) / (500 * used.sum())
    assert covariance == pytest.approx(np.eye(3), abs=0.03)
    back = records.unweighed(white)
    assert back == pytest.approx(np.where(records.used, entries, 0.0))
