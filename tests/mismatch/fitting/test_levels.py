"""Parameters per ball, session and trial, on flights integrated by scipy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mismatch import explain
from mismatch.candidates import candidates_for
from mismatch.fitting.hypotheses import EXPECTED, Hypothesis, fit_hypothesis
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import own_values, scatter_evidence
from mismatch.forward import Forward, ForwardModel, OwnStrength
from mismatch.records import BallModel, Baseline, CampaignRecords, Trial
from mismatch.verdict import Doubt, pass_gate
from physics.effects import CATALOGUE, Effect, Level
from physics.effects.base import Form
from tests.mismatch.synthetic import struck_campaign, thrown_campaign

GRAVITY = 9.80665
DENSITY = 1.2
MASS, DIAMETER = 0.0027, 0.04
NOISE = 0.002


def _flight(
    drag: float, spin: np.ndarray, velocity: np.ndarray, time: np.ndarray, wind: float = 0.0
) -> np.ndarray:
    area = np.pi / 4.0 * DIAMETER**2

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        v = state[3:]
        past = v - [wind, 0.0, 0.0]
        air = 0.5 * DENSITY * area / MASS * (
            -drag * float(np.linalg.norm(past)) * past + 0.5 * DIAMETER * np.cross(spin, v)
        )  # fmt: skip
        return np.concatenate([v, air - [0.0, GRAVITY, 0.0]])

    start = np.concatenate([[0.0, 1.0, 0.0], velocity])
    path = solve_ivp(rate, (0.0, time[-1]), start, "DOP853", t_eval=time, rtol=1e-8)
    return np.asarray(path.y[:3].T)


def _campaign(
    drags: list[float], spins: np.ndarray, balls: list[str], seed: int = 3
) -> tuple[CampaignRecords, Baseline]:
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 0.6, 1.0 / 60.0)
    trials = []
    for index, (drag, spin, ball) in enumerate(zip(drags, spins, balls, strict=True)):
        velocity = np.array([rng.uniform(4.0, 7.0), rng.uniform(0.5, 2.5), rng.normal(0.0, 0.5)])
        seen = _flight(drag, spin, velocity, time)
        seen = seen + NOISE * rng.standard_normal(seen.shape)
        trials.append(Trial(str(index), time, seen, np.zeros(0), np.zeros(0), ball))
    bodies = {name: BallModel(name, MASS, DIAMETER) for name in set(balls)}
    baseline = Baseline(bodies, air_density=DENSITY, effects={})
    return CampaignRecords(tuple(trials)), baseline


def _fitted(
    campaign: CampaignRecords, baseline: Baseline, laws: list[Effect]
) -> tuple[Forward, Hypothesis]:
    """A set of laws fitted at their levels."""
    prepared = prepare(campaign, baseline)
    found = candidates_for(prepared.forward, prepared.model, laws, unnamed=False)
    members = [
        next(c for c in found if c.effect.level is law.level and c.id == law.id) for law in laws
    ]
    start = [np.full(len(m.effect.strengths), 0.1) for m in members]
    return prepared.forward, fit_hypothesis(prepared.forward, prepared.fit, members, start)


def _at(law: Effect, level: Level) -> Effect:
    return replace(law, level=level)


DRAG = CATALOGUE["drag"][0]
ROLL = next(one for one in CATALOGUE["camera_roll"] if one.form == Form.BALL_ONLY)
SPIN = next(one for one in CATALOGUE["magnus"] if one.form == Form.SPIN_VECTOR)


def test_every_throw_has_its_own_spin_about_any_axis():
    spins = np.random.default_rng(8).normal(0.0, (60.0, 60.0, 120.0), (8, 3))
    campaign = _campaign([0.45] * 8, spins, ["white"] * 8)
    _, shared = _fitted(*campaign, [DRAG, _at(SPIN, Level.CAMPAIGN)])
    forward, each = _fitted(*campaign, [DRAG, _at(SPIN, Level.TRIAL)])
    assert shared.reduced_chi2 > 3.0
    assert each.reduced_chi2 < 1.2
    assert each.penalised_gain > shared.penalised_gain + 100.0
    own = own_values(forward, each.fit, each.members[1].effect)
    assert own is not None
    assert own.names == ("spin", "spin_x", "spin_y")
    assert np.all(np.abs(own.value - spins[:, [2, 0, 1]]) < 4.0 * own.std)


def test_spins_whose_mean_is_zero_are_named_from_what_they_predict():
    """Spins of table tennis predict ten times better; they were capped at 0.45 as unsteady."""
    spins = np.random.default_rng(8).normal(0.0, (60.0, 60.0, 120.0), (8, 3))
    verdict = explain(*_campaign([0.45] * 8, spins, ["white"] * 8))
    found = {effect.id: effect.probability for effect in verdict.effects}
    assert set(found) == {"drag", "magnus"}
    assert found["magnus"] > 0.7


def test_different_balls_have_different_coefficients_and_equal_ones_share_one():
    balls, nothing = ["soft", "smooth", "rough"] * 2, np.zeros((6, 3))
    for drags, differ in (([0.3, 0.45, 0.75] * 2, True), ([0.45] * 6, False)):
        campaign = _campaign(drags, nothing, balls)
        _, shared = _fitted(*campaign, [_at(DRAG, Level.CAMPAIGN)])
        forward, each = _fitted(*campaign, [_at(DRAG, Level.BALL)])
        assert (each.penalised_gain > shared.penalised_gain) == differ
        own = own_values(forward, each.fit, each.members[0].effect)
        assert own is not None
        names = forward.records.ball_names
        true = np.array([drags[balls.index(name)] for name in names])
        assert np.all(np.abs(own.value[:, 0] - true) < 3.0 * own.std[:, 0])
        assert np.all(own.std < 0.05)


def test_per_ball_drag_is_limited_by_the_length_scale():
    balls, drags = ["soft", "smooth", "rough"] * 2, [0.3, 0.45, 0.75] * 2
    rng = np.random.default_rng(12)
    pulls = []
    for draw in range(6):
        campaign, baseline = _campaign(drags, np.zeros((6, 3)), balls, seed=draw)
        stretched = 1.0 + 0.005 * rng.standard_normal()
        trials = tuple(replace(t, position=stretched * t.position) for t in campaign.trials)
        law = [_at(DRAG, Level.BALL)]
        forward, each = _fitted(CampaignRecords(trials), baseline, law)
        own = own_values(forward, each.fit, each.members[0].effect)
        assert own is not None
        true = np.array([drags[balls.index(name)] for name in forward.records.ball_names])
        off = own.value[:, 0] - true
        pulls.append(off / own.std[:, 0])
    assert np.sqrt(np.mean(np.square(pulls))) < 1.6
    assert np.sqrt(np.mean(np.square(pulls))) > 0.4


def _in_sessions(draughts: dict[str, float]) -> tuple[CampaignRecords, Baseline]:
    """Four throws of two balls in each session, in the wind of that session."""
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 0.6, 1.0 / 60.0)
    trials = []
    for session, draught in draughts.items():
        for index in range(4):
            start = np.array([rng.uniform(4.0, 7.0), rng.uniform(0.5, 2.5), 0.0])
            seen = _flight(0.45, np.zeros(3), start, time, draught)
            seen = seen + NOISE * rng.standard_normal(seen.shape)
            name, ball = f"{session} {index}", ("white", "red")[index % 2]
            blank = np.zeros(0)
            trials.append(Trial(name, time, seen, blank, blank, ball, session=session))
    bodies = {name: BallModel(name, MASS, DIAMETER) for name in ("white", "red")}
    known = Baseline(bodies, air_density=DENSITY, effects={"drag": {"drag_coefficient": 0.45}})
    return CampaignRecords(tuple(trials)), known


WIND = CATALOGUE["wind"][0]


def test_the_wind_of_each_session_is_estimated():
    draughts = {"Monday": 0.9, "Tuesday": -0.7, "Friday": 0.1}
    campaign = _in_sessions(draughts)
    _, shared = _fitted(*campaign, [_at(WIND, Level.CAMPAIGN)])
    forward, each = _fitted(*campaign, [_at(WIND, Level.SESSION)])
    assert each.reduced_chi2 < 1.2
    assert each.penalised_gain > shared.penalised_gain + 50.0
    own = own_values(forward, each.fit, each.members[0].effect)
    assert own is not None
    _, names = forward.records.groups(Level.SESSION)
    assert names == tuple(draughts)
    assert np.all(np.abs(own.value[:, 0] - list(draughts.values())) < 4.0 * own.std[:, 0])
    assert np.all(own.std < 0.1)


def test_sessions_with_one_wind_share_it():
    campaign = _in_sessions(dict.fromkeys(("Monday", "Tuesday", "Friday"), 0.8))
    _, shared = _fitted(*campaign, [_at(WIND, Level.CAMPAIGN)])
    _, each = _fitted(*campaign, [_at(WIND, Level.SESSION)])
    assert shared.penalised_gain > each.penalised_gain


def test_strikes_determine_the_camera_roll_of_each_session():
    campaign, baseline = struck_campaign()
    turns = {"first": 0.012, "second": -0.009}
    trials = []
    for index, trial in enumerate(campaign.trials):
        session = ("first", "second")[index % 2]
        cosine, sine = np.cos(turns[session]), np.sin(turns[session])
        x, y, z = trial.position.T
        seen = np.column_stack([cosine * x - sine * y, sine * x + cosine * y, z])
        trials.append(replace(trial, position=seen, session=session))
    forward, each = _fitted(CampaignRecords(tuple(trials)), baseline, [_at(ROLL, Level.SESSION)])
    own = own_values(forward, each.fit, each.members[0].effect)
    assert own is not None
    assert each.reduced_chi2 < 1.2
    assert np.all(np.abs(own.value[:, 0] - list(turns.values())) < 4.0 * own.std[:, 0])
    assert np.all(own.std < 1e-3)


def test_without_sessions_there_is_no_session_level():
    campaign, baseline = struck_campaign()
    forward = prepare(campaign, baseline).forward
    assert forward.records.groups(Level.SESSION)[1] == ()
    found = candidates_for(forward, ForwardModel(), [WIND, ROLL], unnamed=False)
    assert {one.effect.level for one in found} == {Level.CAMPAIGN}


def test_an_answer_without_drag_has_a_cost():
    campaign = _campaign([0.45] * 3, np.zeros((3, 3)), ["white"] * 3)
    _, known = _fitted(*campaign, [DRAG])
    _, other = _fitted(*campaign, [_at(SPIN, Level.CAMPAIGN)])
    assert known.lacking == ()
    assert other.lacking == ("drag",)
    assert replace(other, lacking=()).penalised_gain == pytest.approx(
        other.penalised_gain + EXPECTED
    )


def test_per_trial_parameters_far_above_the_noise_are_suspect():
    spins = np.random.default_rng(8).normal(0.0, 100.0, (4, 3))
    campaign = _campaign([0.45] * 4, spins, ["white"] * 4)
    prepared = prepare(*campaign)
    _, each = _fitted(*campaign, [DRAG, _at(SPIN, Level.TRIAL)])
    assert Doubt.EACH_ITS_OWN not in pass_gate(prepared, each, "explained", None).doubts
    far = replace(each, fit=replace(each.fit, chi2=20.0 * each.fit.expected))
    passed = pass_gate(prepared, far, "explained", None)
    assert Doubt.EACH_ITS_OWN in passed.against


def test_the_prior_of_a_spin_is_plausible():
    model = ForwardModel(((SPIN, {"spin": 10.0, "spin_x": 0.0, "spin_y": 0.0}),))
    limit = SPIN.strengths[0].upper
    wild = replace(model, own=(OwnStrength(SPIN, "spin", Level.TRIAL, limit),))
    assert not wild.scatters_within_reason
    assert model.scatters_within_reason


def test_the_variation_between_trials_is_estimated():
    rng = np.random.default_rng(4)
    information = np.tile(np.diag([4.0, 9.0]), (60, 1, 1))
    noise = rng.standard_normal((60, 2)) * [2.0, 3.0]
    spread, gain = scatter_evidence(noise, information, np.ones(2))
    assert gain < 3.0
    own = rng.standard_normal((60, 2)) * [5.0, 1.0]
    score = noise + (information @ own[..., None])[..., 0]
    spread, gain = scatter_evidence(score, information, np.ones(2))
    assert gain > 50.0
    np.testing.assert_allclose(spread, [5.0, 1.0], rtol=0.35)


def test_levels_are_declared_on_the_effect():
    assert {level.value for level in CATALOGUE["drag"][0].levels} == {"campaign", "ball"}
    assert all("trial" in {lv.value for lv in e.levels} for e in CATALOGUE["magnus"])


def test_a_clock_that_drifts_over_the_throws_is_a_clock():
    """A drifting clock was time_base 0.22: errors that wander had taken up what it bends."""
    campaign, baseline = thrown_campaign()
    rates = np.linspace(-0.02, 0.04, len(campaign.trials))
    trials = tuple(
        replace(trial, ball_time=trial.ball_time * (1.0 + rate))
        for trial, rate in zip(campaign.trials, rates, strict=True)
    )
    verdict = explain(CampaignRecords(trials), baseline)
    (clock,) = [effect for effect in verdict.effects if effect.id == "time_base"]
    assert clock.probability > 0.5
    found = {p.name: p.value for p in clock.parameters}
    assert found["drift"] == pytest.approx(0.06, rel=0.15)
