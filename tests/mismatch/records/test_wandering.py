"""Errors correlated over a whole flight: autoregression and rotating marker."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mismatch import explain
from mismatch.fitting.prepare import prepare
from mismatch.fitting.wandering import wandering_errors
from mismatch.forward import Forward
from mismatch.records import BallModel, Baseline, CampaignRecords, Trial

GRAVITY, DENSITY = 9.806, 1.2
BALL = BallModel("", 0.0577, 0.066)
BRAKE = 0.5 * DENSITY * np.pi / 4.0 * BALL.diameter**2 / BALL.mass


def remembering(rng, rows, memory):
    """First-order autoregression of unit variance."""
    kept, found = np.exp(-1.0 / memory), np.empty((rows, 2))
    found[0] = rng.standard_normal(2)
    for row in range(1, rows):
        kick = np.sqrt(1.0 - kept**2) * rng.standard_normal(2)
        found[row] = kept * found[row - 1] + kick
    return found


def pulled_back(rng, rows, memory):
    """A randomly driven damped oscillator: smooth from row to row."""
    place, pace, found = np.zeros(2), np.zeros(2), []
    for _ in range(rows + int(20 * memory)):
        pace = pace - place / memory**2 - 1.8 * pace / memory + rng.standard_normal(2)
        place = place + pace
        found.append(place)
    return np.array(found)[-rows:] / np.std(found)


def going_round(rng, rows, memory):
    """An off-centre marker on a ball that rotates once in six correlation times."""
    turned = np.arange(rows) / memory * rng.uniform(0.9, 1.1) + rng.uniform(0.0, 2.0 * np.pi)
    return np.sqrt(2.0) * np.column_stack([np.cos(turned), np.sin(turned)])


def throws(wander, share, lift=0.0, seed=3, trials=9, noise=5e-4, memory=30.0):
    rng = np.random.default_rng(seed)
    made = []
    for number in range(trials):
        time = np.arange(0.0, rng.uniform(0.6, 0.9), 1.0 / 120.0)
        speed, up = rng.uniform(4.0, 7.0), np.radians(rng.uniform(20.0, 60.0))

        def rate(_, s):
            fast = np.hypot(s[2], s[3])
            ax = -BRAKE * fast * (0.45 * s[2] + lift * s[3])
            return [s[2], s[3], ax, -GRAVITY - BRAKE * fast * (0.45 * s[3] - lift * s[2])]

        start = [0.0, 1.2, speed * np.cos(up), speed * np.sin(up)]
        path = solve_ivp(rate, (0.0, 1.0), start, t_eval=time, rtol=1e-9, atol=1e-11).y[:2].T
        white = rng.standard_normal(path.shape)
        errors = np.sqrt(1.0 - share) * white
        if share:
            errors = errors + np.sqrt(share) * wander(rng, time.size, memory)
        seen = np.full((time.size, 3), np.nan)
        seen[:, :2] = path + noise * errors
        made.append(Trial(str(number), time, seen, np.zeros(0), np.zeros(0)))
    known = Baseline({"": BALL}, air_density=DENSITY, effects={"drag": {"drag_coefficient": 0.45}})
    return CampaignRecords(tuple(made)), known


def left_over(campaign, baseline, share=0.0) -> tuple[Forward, np.ndarray]:
    """A forward model with white noise of the drawn size, and the residuals of its baseline."""
    known = prepare(campaign, baseline)
    sigma = np.full_like(known.forward.records.sigma, 5e-4 * np.sqrt(1.0 - share))
    records = replace(known.forward.records, sigma=sigma, inflation=np.ones(4))
    forward = replace(known.forward, records=records)
    off = records.values - forward.predict([known.fit.model], known.fit.nuisance[None])[0]
    return forward, records.weighed(off)


def test_white_noise_has_no_slow_errors():
    gains = [wandering_errors(*left_over(*throws(None, 0.0, seed=seed))).gain for seed in range(6)]
    assert max(gains) < 9.0


@pytest.mark.parametrize("wander", [remembering, pulled_back, going_round])
def test_records_are_white_once_their_slow_errors_are_known(wander):
    forward, left = left_over(*throws(wander, 0.8), share=0.8)
    found = wandering_errors(forward, left)
    assert found.gain > 50.0
    records = replace(forward.records, slow=found.excess)
    assert records.remembers
    assert not forward.records.remembers
    white = records.weighed(forward.records.unweighed(left))
    used = records.used
    before = float(np.mean(left[used] ** 2))
    assert float(np.mean(white[used] ** 2)) < 1.25
    assert before > float(np.mean(white[used] ** 2)) + 0.3
    back = records.unweighed(white)
    assert back[used] == pytest.approx(forward.records.unweighed(left)[used], abs=1e-12)


def test_a_curvature_common_to_all_flights_is_no_slow_error():
    forward, left = left_over(*throws(None, 0.0))
    time = forward.records.ball_time
    share = time / time.max(axis=1, keepdims=True)
    bent = left.copy()
    bent[:, : time.shape[1]] += 8.0 * (share - 0.5) ** 2 * forward.records.ball_used[..., 0]
    assert wandering_errors(forward, bent).gain == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("wander", [remembering, going_round])
def test_slow_errors_name_nothing_and_a_lift_is_still_named(wander):
    for seed in (3, 4, 5):
        assert explain(*throws(wander, 0.8, seed=seed)).effects == ()
    verdict = explain(*throws(wander, 0.8, lift=0.25))
    alike = {one for group in verdict.indistinguishable for one in group}
    named = {effect.id for effect in verdict.effects}
    assert {"magnus", "asymmetric_wake"} & (named | alike)
    assert named <= {"magnus", "asymmetric_wake"} | alike
