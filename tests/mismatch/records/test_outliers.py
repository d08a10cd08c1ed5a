"""Outliers are found wherever they are."""

from dataclasses import replace

import numpy as np

from mismatch.explain import explain
from mismatch.fitting.prepare import prepare
from mismatch.records import CampaignRecords
from tests.mismatch.synthetic import struck_campaign


def spoilt(campaign: CampaignRecords) -> CampaignRecords:
    """A gap before the last row of the first flight, and that row displaced."""
    first, *others = campaign.trials
    kept = np.r_[0 : first.ball_time.size - 12, first.ball_time.size - 1]
    position = first.position[kept].copy()
    position[-1, :2] += [0.03, 0.003]
    last = replace(first, ball_time=first.ball_time[kept], position=position)
    return CampaignRecords((last, *others))


def test_an_outlier_after_a_gap_is_excluded_and_names_nothing():
    campaign, baseline = struck_campaign(seed=3)
    campaign = spoilt(campaign)
    prepared = prepare(campaign, baseline)
    row = campaign.trials[0].ball_time.size - 1
    # Displaced by 30 sigma in x and 3 in y: both coordinates are outliers.
    assert not prepared.forward.records.ball_used[0, row].any()
    assert prepared.forward.records.ball_used[0, row - 1, :2].all()
    assert explain(campaign, baseline).verdict == "no_mismatch"
