"""Wrong, scarce or contradictory data give no confident name."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from metrology import TooLittleDataError, UsageError
from mismatch import CampaignRecords, Options, Trial, explain
from mismatch.fitting.prepare import prepare
from mismatch.fitting.stated import stated_inputs
from mismatch.records import Baseline
from mismatch.sanity import refuse_nonsense, without_odd_trials
from physics.bodies import GRAVITY, PAPER_PENDULUM
from physics.effects import CATALOGUE, Effect, Parameter
from tests.mismatch.synthetic import struck_campaign, thrown_campaign


def confident(verdict) -> list[str]:
    if verdict.indistinguishable:
        return []
    return [effect.id for effect in verdict.effects if effect.probability > 0.95]


def test_one_trial_without_missing_physics_names_nothing():
    campaign, baseline = thrown_campaign()
    verdict = explain(CampaignRecords(campaign.trials[:1]), baseline)
    assert not confident(verdict)


def test_one_throw_gives_neither_an_unnamed_law_nor_two_effects():
    campaign, baseline = thrown_campaign(scale=1.05)
    verdict = explain(CampaignRecords(campaign.trials[:1]), baseline)
    assert "unnamed" not in [effect.id for effect in verdict.effects]
    assert len(verdict.effects) <= 1
    assert not confident(verdict)


@pytest.mark.parametrize("make", [thrown_campaign, struck_campaign])
def test_copies_of_one_trial_are_no_further_evidence(make):
    campaign, baseline = make(seed=3)
    one = campaign.trials[0]
    copies = tuple(replace(one, name=str(index)) for index in range(4))
    verdict = explain(CampaignRecords(copies), baseline)
    assert not confident(verdict)
    assert any("trial 1, 2, 3 recorded repeats other trials" in note for note in verdict.notes)


def test_the_period_of_free_swings_names_neither_clock_nor_law():
    """Swings 12 % slower than the setup predicts; the cause is undetermined."""
    body = PAPER_PENDULUM
    rate = 0.88 * np.sqrt(body.mass * GRAVITY * body.com / body.inertia)
    generator = np.random.default_rng(5)
    time = np.arange(0.0, 6.0, 1.0 / 60.0)
    trials = []
    for number, amplitude in enumerate((0.5, 0.9, 0.7, 0.3)):
        # the exact swing: sin(φ/2) = k sn(K − ω t | k²), with k the sine of half the amplitude
        part = np.sin(0.5 * amplitude)
        sn = ellipj(ellipk(part**2) - rate * time, part**2)[0]
        angle = 2.0 * np.arcsin(part * sn) + generator.normal(0.0, 2e-3, time.size)
        trials.append(Trial(str(number), np.zeros(0), np.zeros((0, 3)), time, angle))
    verdict = explain(CampaignRecords(tuple(trials)), Baseline({}, body))
    assert verdict.verdict == "no_mismatch"


def test_missing_values_are_left_out():
    campaign, baseline = struck_campaign(seed=3)
    holed = []
    for trial in campaign.trials:
        position = trial.position.copy()
        position[::7] = np.nan
        holed.append(replace(trial, position=position))
    verdict = explain(CampaignRecords(tuple(holed)), baseline)
    assert verdict.verdict == "no_mismatch"


def test_a_setup_that_contradicts_the_data_is_refused():
    campaign, baseline = struck_campaign(seed=3)
    wrong = tuple(replace(t, backswing=2.2 * t.backswing) for t in campaign.trials)
    with pytest.raises(UsageError, match="contradicts"):
        explain(CampaignRecords(wrong), baseline)


def test_scaled_trajectories_are_a_wrong_unit_only_in_all_trials():
    """How far the refitted baseline diverges depends on rounding; in which trials does not."""
    campaign, baseline = struck_campaign(seed=3)
    prepared = prepare(campaign, baseline)

    def refuse(*scales: float) -> None:
        """Check trajectories scaled by these factors against the baseline of the true ones."""
        forward = prepared.forward
        position = np.array(scales)[:, None, None] * forward.records.position
        records = replace(forward.records, position=position)
        refuse_nonsense(campaign, replace(prepared, forward=replace(forward, records=records)))

    refuse(*[1.0] * 8)
    with pytest.raises(UsageError, match=r"comes near trial 0, 1, 4\n"):
        refuse(4e4, 4e4, 1.0, 1.0, 4e4, 1.0, 1.0, 1.0)
    with pytest.raises(UsageError, match=r"trial 2 spread .* units seem to differ by row"):
        refuse(1.0, 1.0, 1000.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    with pytest.raises(UsageError, match=r"spread 1e\+03 times as far"):
        refuse(*[1000.0] * 8)


@pytest.mark.parametrize("wrong", [(0,), (1, 4), (0, 1, 3, 4, 5, 6, 7)])
def test_trials_in_centimetres_are_named_even_where_the_baseline_followed_them(wrong):
    """Of eight the first, the slowest, was explained by a baseline at 36,000 times the noise."""
    campaign, baseline = struck_campaign(seed=3)
    trials = [
        replace(trial, position=100.0 * trial.position) if k in wrong else trial
        for k, trial in enumerate(campaign.trials)
    ]
    which = ", ".join(map(str, wrong))
    with pytest.raises(UsageError, match=f"trial {which} spread .* units seem to differ by row"):
        explain(CampaignRecords(tuple(trials)), baseline)


def test_a_record_that_ends_at_the_contact_is_not_in_another_unit():
    """A ball at rest, seen for 16 rows, was called a five hundredth of the flights of others."""
    campaign, baseline = struck_campaign(seed=3)
    fifth = campaign.trials[4]
    rest = replace(fifth, ball_time=fifth.ball_time[:16], position=fifth.position[:16])
    short = CampaignRecords((*campaign.trials[:4], rest, *campaign.trials[5:]))
    refuse_nonsense(short, prepare(short, baseline))


def test_a_wrong_pendulum_in_the_setup_gives_no_confident_name():
    campaign, baseline = struck_campaign(seed=3)
    heavy = replace(baseline.pendulum, inertia=1.5 * baseline.pendulum.inertia)
    verdict = explain(campaign, replace(baseline, pendulum=heavy))
    assert all(effect.probability < 0.8 for effect in verdict.effects)
    assert any("check pendulum" in note for note in verdict.notes)


def test_an_input_that_would_be_off_by_more_than_half_is_refused():
    """Stated to 20 %, an inertia of six times its size was only a note beside "unexplained"."""
    campaign, baseline = struck_campaign(seed=3)
    heavy = replace(baseline.pendulum, inertia=6.0 * baseline.pendulum.inertia)
    stated = stated_inputs({"inertia": 0.2, "ball_mass": 0.05})
    with pytest.raises(UsageError, match=r"inertia would be off by -83 %, stated ± 20 %"):
        explain(campaign, replace(baseline, pendulum=heavy, instruments=stated))


def test_a_users_effect_that_raises_is_named_in_the_error():
    class Raising(Effect):
        def force(self, values, flight):
            raise ZeroDivisionError("no wind tunnel")

    raising = Raising("tunnel", "", "", "", "flight", (Parameter("k", "N", 1.0, -9.0, 9.0),))
    campaign, baseline = thrown_campaign()
    with pytest.raises(UsageError, match=r"tunnel.*no wind tunnel"):
        explain(campaign, baseline, options=Options(effects=(raising,)))


def test_a_users_effect_that_gives_no_numbers_is_refused():
    class Void(Effect):
        def force(self, values, flight):
            return values["k"] * np.nan, 0.0 * flight.vy, 0.0 * flight.vy

    void = Void("void", "", "", "", "flight", (Parameter("k", "N", 1.0, -9.0, 9.0),))
    for campaign, baseline in (thrown_campaign(), struck_campaign(seed=3)):
        with pytest.raises(UsageError, match=r"void.*no numbers"):
            explain(campaign, baseline, options=Options(effects=(void,)))


@pytest.mark.parametrize("make", [thrown_campaign, struck_campaign])
def test_millimetres_for_metres_are_refused(make):
    campaign, baseline = make(seed=3)
    large = tuple(replace(t, position=1e3 * t.position) for t in campaign.trials)
    with pytest.raises(UsageError) as refused:
        explain(CampaignRecords(large), baseline)
    assert "metres" in (refused.value.hint or "")


@pytest.mark.parametrize("make", [thrown_campaign, struck_campaign])
def test_swapped_columns_are_refused(make):
    campaign, baseline = make(seed=3)
    with pytest.raises(UsageError, match="swapped"):
        explain(_swapped(campaign), baseline)


@pytest.mark.parametrize("make", [thrown_campaign, struck_campaign])
def test_positions_counted_downward_are_refused(make):
    campaign, baseline = make(seed=3)
    down = tuple(replace(t, position=t.position * [1.0, -1.0, 1.0]) for t in campaign.trials)
    with pytest.raises(UsageError, match="y_m runs downward"):
        explain(CampaignRecords(down), baseline)


def _swapped(campaign: CampaignRecords) -> CampaignRecords:
    return CampaignRecords(
        tuple(replace(t, position=t.position[:, [1, 0, 2]]) for t in campaign.trials)
    )


@pytest.mark.parametrize("make", [thrown_campaign, struck_campaign])
def test_a_clock_that_jumps_ahead_in_one_trial_names_no_physics(make):
    campaign, baseline = make(seed=3)
    odd = campaign.trials[2]
    late = np.where(np.arange(odd.ball_time.size) > 40, odd.ball_time + 1.0, odd.ball_time)
    trials = [*campaign.trials]
    trials[2] = replace(odd, ball_time=late)
    verdict = explain(CampaignRecords(tuple(trials)), baseline)
    assert verdict.verdict == "no_mismatch"
    assert any("jumps ahead in trial 2" in note for note in verdict.notes)


def test_a_clock_that_jumps_ahead_in_every_trial_is_refused():
    campaign, baseline = thrown_campaign()
    jumping = [
        replace(t, ball_time=np.where(np.arange(t.ball_time.size) > 40, 0.5, 0.0) + t.ball_time)
        for t in campaign.trials
    ]
    with pytest.raises(UsageError, match="every trial"):
        explain(CampaignRecords(tuple(jumping)), baseline)


def test_a_gap_in_a_flight_is_no_jump_of_its_clock():
    campaign, _ = struck_campaign(seed=3)
    holed = []
    for trial in campaign.trials:
        rows = np.r_[0:90, 130 : trial.ball_time.size]
        holed.append(replace(trial, ball_time=trial.ball_time[rows], position=trial.position[rows]))
    kept = without_odd_trials(CampaignRecords(tuple(holed)))
    assert len(kept.trials) == len(holed)


def test_a_misfit_without_location_or_name_is_not_explained():
    campaign, baseline = struck_campaign(seed=3, trials=5)
    odd = tuple(
        replace(
            t, pendulum_angle=t.pendulum_angle + 0.2 * (-1) ** k * np.sin(40.0 * t.pendulum_time)
        )
        for k, t in enumerate(campaign.trials)
    )
    verdict = explain(CampaignRecords(odd), baseline)
    assert verdict.verdict == "unexplained"
    assert verdict.effects == ()


def test_holding_every_trial_out_is_refused():
    campaign, baseline = thrown_campaign()
    names = tuple(trial.name for trial in campaign.trials)
    with pytest.raises(TooLittleDataError, match="none is left"):
        explain(campaign, baseline, options=Options(hold_out=names))


def test_a_ball_table_without_a_number_is_no_free_swing():
    campaign, baseline = struck_campaign(seed=3)
    empty = tuple(replace(t, position=np.full_like(t.position, np.nan)) for t in campaign.trials)
    with pytest.raises(TooLittleDataError, match="no position of the ball"):
        explain(CampaignRecords(empty), baseline)


def test_a_stated_uncertainty_is_tested():
    campaign, baseline = thrown_campaign()
    for factor in (1 / 3, 3.0):
        sigma = prepare(campaign, baseline).noise.sigma[0, 0]
        claimed = tuple(
            replace(t, position_std=np.full(t.position.shape, factor * sigma))
            for t in campaign.trials
        )
        verdict = explain(CampaignRecords(claimed), baseline)
        assert verdict.verdict == "no_mismatch"
        assert any("the file states" in note for note in verdict.notes)


def test_too_few_rows_in_each_trial_are_refused():
    campaign, baseline = thrown_campaign()
    few = tuple(
        Trial(t.name, t.ball_time[:3], t.position[:3], np.zeros(0), np.zeros(0))
        for t in campaign.trials[:4]
    )
    with pytest.raises(TooLittleDataError):
        explain(CampaignRecords(few), baseline)


def test_implausible_parameter_values_are_rejected():
    rate = CATALOGUE["time_base"][0].parameters[0]
    scale = CATALOGUE["length_scale"][0].parameters[0]
    assert rate.believable(0.03)
    assert rate.believable(19.0)  # 30 frames per second written for 600
    assert rate.believable(-0.95)
    assert not rate.believable(0.35)
    assert rate.prior_penalty(19.0) < rate.prior_penalty(0.15)
    assert not scale.believable(-0.25)


@pytest.mark.slow
def test_a_measured_calibration_narrows_the_length_scale():
    campaign, baseline = thrown_campaign(scale=1.03)
    free = explain(campaign, baseline)
    held = explain(
        campaign, baseline, options=Options(widths={"length_scale": 5e-4, "time_base": 0.01})
    )
    assert "length_scale" in {one for group in free.indistinguishable for one in group}
    assert "length_scale" not in {effect.id for effect in held.effects}
