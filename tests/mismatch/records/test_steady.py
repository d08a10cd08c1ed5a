"""Errors that differ between trials are not taken for a common law."""

from dataclasses import replace

import numpy as np
import pytest

from mismatch.explain import explain
from mismatch.records import CampaignRecords
from tests.mismatch.synthetic import struck_campaign


def with_wandering_angles(campaign: CampaignRecords, size: float) -> CampaignRecords:
    """Pendulum angles with a different slow error in each trial."""
    rng = np.random.default_rng(12)
    trials = []
    for trial in campaign.trials:
        u = np.linspace(-1.0, 1.0, trial.pendulum_time.size)
        wander = np.polynomial.legendre.legval(u, [0.0, *rng.normal(0.0, size, 4)])
        trials.append(replace(trial, pendulum_angle=trial.pendulum_angle + wander))
    return replace(campaign, trials=tuple(trials))


@pytest.mark.parametrize("size", [pytest.param(5e-3, marks=pytest.mark.slow), 0.02])
def test_drifting_tracks_name_no_physics(size):
    campaign, baseline = struck_campaign(seed=3, trials=3)
    verdict = explain(with_wandering_angles(campaign, size), baseline)
    assert verdict.effects == ()
    assert not verdict.remainder.white
