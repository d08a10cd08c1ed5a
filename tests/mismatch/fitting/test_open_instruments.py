"""Trials with unknown axis, rest position, horizontal and centres."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mismatch import explain
from mismatch.explain import _with_held
from mismatch.fitting.fit import fit_model, free_parameters, kept_free
from mismatch.fitting.prepare import prepare
from mismatch.records import Baseline, CampaignRecords, Trial
from physics.bodies import GRAVITY, JOKKU, PAPER_PENDULUM, PAPER_SUPPORT
from physics.effects import Effect, Form, Level, effect_named
from physics.effects.measurement import (
    BehindTheBall,
    CameraRoll,
    OriginOffset,
    PivotElsewhere,
    WanderingCentre,
)
from tests.mismatch.synthetic import struck_campaign, thrown_campaign

ARM = PAPER_PENDULUM.length
SLOWED = (effect_named("bearing_friction"), {"dry_torque": 0.8})


def _held(fault: Effect, width: float) -> Effect:
    parameters = tuple(replace(p, width=width, expected=0.0) for p in fault.parameters)
    return replace(fault, parameters=parameters, levels=(Level.CAMPAIGN, Level.TRIAL))


WANDERING = (
    _held(WanderingCentre(), 1e-3),
    replace(_held(BehindTheBall(), 1e-3), levels=(Level.CAMPAIGN,)),
)
ROLL = _held(CameraRoll(id="roll_of_the_clip", form=Form.ABOUT_THE_START), np.radians(1.0))
FAULTS = (_held(PivotElsewhere(), 0.01), _held(OriginOffset(id="rest_elsewhere"), 2e-3))


def _read_off_wrong_points(
    campaign: CampaignRecords, seed: int = 3
) -> tuple[CampaignRecords, np.ndarray]:
    """Angles about points displaced from the axis, and those points (T, 2)."""
    rng = np.random.default_rng(seed)
    wrong = np.array([8e-3, -9e-3]) + 5e-3 * rng.standard_normal((len(campaign.trials), 2))
    trials = []
    for trial, (dx, dy) in zip(campaign.trials, wrong, strict=True):
        x, down = ARM * np.sin(trial.pendulum_angle), ARM * np.cos(trial.pendulum_angle)
        shifted = trial.position + 1.5e-3 * rng.standard_normal(3)
        angle = np.arctan2(x - dx, down + dy)
        trials.append(replace(trial, pendulum_angle=angle, position=shifted))
    return CampaignRecords(tuple(trials)), wrong


def _campaign(*added: tuple[Effect, dict[str, float]]) -> tuple[CampaignRecords, Baseline]:
    campaign, baseline = struck_campaign(*added)
    return _read_off_wrong_points(campaign)[0], baseline


def test_the_axis_of_each_clip_is_found():
    campaign, baseline = struck_campaign()
    seen, wrong = _read_off_wrong_points(campaign)
    assert prepare(seen, baseline).fit.reduced_chi2 > 5.0
    fit = prepare(seen, replace(baseline, instruments=FAULTS)).fit
    assert fit.reduced_chi2 < 1.2
    names = [one.name for one in fit.model.own]
    shared = {item.parameter.name: fit.value(k)[0] for k, item in enumerate(fit.free)}
    for axis, name in enumerate(("pivot_x", "pivot_y")):
        found = shared[name] + fit.nuisance[:, 4 + names.index(name)]
        assert np.sqrt(np.mean(np.square(found - wrong[:, axis]))) < 3e-3


@pytest.mark.slow
def test_a_displaced_axis_is_no_physics():
    campaign, baseline = _campaign()
    assert explain(campaign, replace(baseline, instruments=FAULTS)).effects == ()


def _turned(campaign: CampaignRecords, degrees: float) -> CampaignRecords:
    """The campaign as recorded by a camera rolled about the ball's rest position."""
    tilt = np.radians(degrees)
    turn = np.array([[np.cos(tilt), -np.sin(tilt), 0], [np.sin(tilt), np.cos(tilt), 0], [0, 0, 1]])
    rest = np.array([0.0, PAPER_SUPPORT.height + 0.5 * JOKKU.diameter, 0.0])
    return CampaignRecords(
        tuple(
            replace(t, position=np.nan_to_num(t.position - rest) @ turn.T + rest + 0.0 * t.position)
            for t in campaign.trials
        )
    )


def test_a_fixed_instrument_does_not_change_the_others():
    campaign, baseline = struck_campaign()
    seen, wrong = _read_off_wrong_points(_turned(campaign, 1.5))
    prepared = prepare(seen, replace(baseline, instruments=(ROLL, *FAULTS)))
    roll = {item.parameter.name: prepared.fit.value(k) for k, item in enumerate(prepared.fit.free)}
    assert roll["roll"][0] == pytest.approx(np.radians(1.5), abs=3.0 * roll["roll"][1])
    held = _with_held(prepared, frozenset({ROLL.id}))
    names = [one.name for one in held.model.own]
    assert names == ["pivot_x", "pivot_y", "offset_x", "offset_y"]
    assert held.nuisance.shape[1] == 4 + len(names)
    shared = {item.parameter.name: held.value(k)[0] for k, item in enumerate(held.free)}
    assert "roll" not in shared
    found = shared["pivot_y"] + held.nuisance[:, 4 + names.index("pivot_y")]
    assert np.sqrt(np.mean(np.square(found - wrong[:, 1]))) < 5e-3
    assert held.objective > prepared.fit.objective + 50.0


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [0.0, 1.5])
def test_an_unmeasured_tilt_is_reported_if_visible(degrees):
    campaign, baseline = struck_campaign()
    open_still = replace(baseline, instruments=(ROLL,))
    seen = _turned(campaign, degrees)
    assert explain(seen, open_still).effects == ()
    verdict = explain(seen, replace(open_still, assumed=frozenset({ROLL.id})))
    if not degrees:
        assert verdict.effects == ()
        return
    (named,) = verdict.effects
    assert named.id == "camera_roll"
    assert named.probability > 0.5
    (roll,) = (p for p in named.parameters if p.name == "roll")
    assert roll.value == pytest.approx(np.radians(degrees), abs=4.0 * roll.std)
    assert roll.std < np.radians(0.2)


@pytest.mark.slow
def test_bearing_friction_is_found_with_a_displaced_axis():
    campaign, baseline = _campaign(SLOWED)
    verdict = explain(campaign, replace(baseline, instruments=FAULTS))
    alike = {one for group in verdict.indistinguishable for one in group}
    assert len(verdict.effects) == 1
    assert "bearing_friction" in alike | {verdict.effects[0].id}


def _outlines_drawn(campaign: CampaignRecords, seed: int = 5) -> CampaignRecords:
    """Throws with centre errors of 0.5 mm: slow in each trial, and common to all."""
    rng = np.random.default_rng(seed)
    trials = []
    for trial in campaign.trials:
        x = trial.position[:, :1]
        share = (x - x[0]) / (x[-1] - x[0])
        slow = np.cos(np.pi * np.array([2.0, 3.0]) * share) @ rng.normal(0.0, 5e-4, (2, 2))
        wall = 1e-3 * np.exp(-0.5 * ((x - 0.15) / 0.06) ** 2) * np.array([1.0, -1.0])
        position = trial.position.copy()
        position[:, :2] += slow + wall
        trials.append(replace(trial, position=position))
    return CampaignRecords(tuple(trials))


@pytest.mark.slow
def test_displaced_outlines_are_no_physics():
    campaign, baseline = thrown_campaign()
    seen = _outlines_drawn(campaign)
    assert explain(seen, baseline).effects != ()
    assert explain(seen, replace(baseline, instruments=WANDERING)).effects == ()


@pytest.mark.slow
def test_a_force_in_flight_is_found_with_displaced_outlines():
    campaign, baseline = thrown_campaign()
    pushed = tuple(
        replace(
            t, position=t.position + np.outer(np.maximum(t.ball_time - 0.3, 0.0) ** 2, [1, 0, 0])
        )
        for t in campaign.trials
    )
    seen = _outlines_drawn(CampaignRecords(pushed))
    verdict = explain(seen, replace(baseline, instruments=WANDERING))
    assert [effect.id for effect in verdict.effects] == ["unnamed"]
    assert verdict.location is not None
    assert verdict.location.phase == "flight"


def test_a_displaced_axis_is_found_in_free_swings():
    """Trajectories by scipy, read about a point displaced from the axis."""
    arm, wrong = 0.4, np.array([5e-3, -3e-3])
    rng = np.random.default_rng(8)
    time = np.arange(0.0, 5.0, 0.02)

    def rates(_: float, state: np.ndarray) -> list[float]:
        return [state[1], -GRAVITY / arm * np.sin(state[0]) - 0.02 * state[1]]

    trials = []
    for number, width in enumerate((1.5, -1.1, 0.8)):
        path = solve_ivp(rates, (0.0, 5.0), [width, 0.0], "LSODA", time, rtol=1e-9, atol=1e-10)
        phi = path.y[0]
        read = np.arctan2(arm * np.sin(phi) - wrong[0], arm * np.cos(phi) + wrong[1])
        seen = read + rng.normal(0.0, 1e-3, time.size)
        trials.append(Trial(str(number), np.zeros(0), np.zeros((0, 3)), time, seen))
    body = replace(PAPER_PENDULUM, length=arm, com=arm, mass=0.5, inertia=0.5 * arm**2)
    shared = replace(_held(PivotElsewhere(), 0.01), levels=(Level.CAMPAIGN,))
    baseline = Baseline({}, body, instruments=(shared,))
    prepared = prepare(CampaignRecords(tuple(trials)), baseline)
    damped = effect_named("viscous_damping")
    model = prepared.fit.model.having(damped, damped.neutral)
    free = (*kept_free(prepared.fit, model), *free_parameters(model, [damped]))
    start = (prepared.fit.nuisance, prepared.fit.law_offsets)
    fit = fit_model(prepared.forward, model, free, start)
    found = {item.parameter.name: fit.value(k) for k, item in enumerate(fit.free)}
    assert fit.reduced_chi2 < 1.2
    for name, true in zip(("pivot_x", "pivot_y"), wrong, strict=True):
        value, std = found[name]
        # A displacement by a fraction s of the arm gives an error of order s².
        assert value == pytest.approx(true, abs=3.0 * std + 1e-4)
        assert std < 1e-3
    assert found["viscous_coefficient"][0] == pytest.approx(0.02 * body.inertia, rel=0.02)
