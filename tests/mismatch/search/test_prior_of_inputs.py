"""The prior odds of usual input errors come out of campaigns with keys, with an uncertainty."""

import numpy as np

from training.fit_inputs import fit_cost


def test_a_planted_cost_is_found_within_its_uncertainty():
    rng = np.random.default_rng(3)
    off = []
    for _ in range(40):
        lead = rng.uniform(-15.0, 20.0, 60)
        careful = rng.random(60) < 1.0 / (1.0 + np.exp(-0.5 * (lead - 4.0)))
        cost, std = fit_cost(lead[careful], lead[~careful])
        off.append((cost - 4.0) / std)
    assert np.std(off) < 1.4
    assert abs(np.mean(off)) < 0.5


def test_few_campaigns_leave_a_wide_interval():
    few = fit_cost([9.0, 6.0], [1.0, 3.0])
    many = fit_cost([9.0, 6.0] * 10, [1.0, 3.0] * 10)
    assert few[1] > 3.0 * many[1]
