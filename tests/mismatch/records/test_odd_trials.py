"""Unusable trials are excluded with a note; a campaign of them is refused."""

import numpy as np
import pytest

from metrology import UsageError
from mismatch.records import CampaignRecords, Trial
from mismatch.sanity import without_odd_trials

TIME = np.arange(60) / 120.0
NONE = np.zeros(0)


def swing(name, angle, time=TIME):
    return Trial(name, NONE, np.zeros((0, 3)), time, angle)


def sound(name, phase=0.0):
    return swing(name, 0.4 * np.cos(9.0 * TIME + phase))


RNG = np.random.default_rng(1)
ODD = {
    "do not follow one another": RNG.permutation(0.4 * np.cos(9.0 * TIME)),
    "nothing moves": np.full(60, 0.2),
    "beyond all bounds": 1e8 * np.cos(9.0 * TIME),
}


@pytest.mark.parametrize("said", ODD)
def test_an_unusable_trial_is_excluded_with_a_note(said):
    campaign = CampaignRecords((sound("a"), swing("odd", ODD[said]), sound("b", 1.0)))
    kept = without_odd_trials(campaign)
    assert [trial.name for trial in kept.trials] == ["a", "b"]
    assert any(said in note and "odd" in note for note in kept.notes)


@pytest.mark.parametrize("said", ODD)
def test_a_campaign_of_unusable_trials_is_refused(said):
    with pytest.raises(UsageError, match=said):
        without_odd_trials(CampaignRecords((swing("1", ODD[said]), swing("2", ODD[said] + 0.01))))


@pytest.mark.parametrize("time", [TIME * 1e12, TIME * 1e-6, TIME * 1e300, TIME + 1e15])
def test_an_impossible_clock_is_refused(time):
    angle = 0.4 * np.cos(9.0 * TIME)
    if np.any(np.diff(time) <= 0.0):
        time = 1e15 + np.arange(60.0)
    with pytest.raises(UsageError, match="none of a motion"):
        without_odd_trials(CampaignRecords((swing("1", angle, time),)))


def test_a_coarse_record_of_a_real_motion_is_no_noise():
    few = np.arange(0.0, 2.0, 0.08)
    noisy = 0.4 * np.cos(9.0 * few) + RNG.normal(0.0, 0.02, few.size)
    campaign = CampaignRecords((swing("1", noisy, few), sound("2")))
    assert without_odd_trials(campaign) is campaign
