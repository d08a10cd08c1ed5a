"""Vertical wind in the plane of flight, for throws integrated by scipy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mismatch import explain
from mismatch.records import BallModel, Baseline, CampaignRecords, Trial

MASS, DIAMETER, COEFFICIENT, DENSITY = 0.05, 0.11, 0.47, 1.2
BRAKE = 0.5 * DENSITY * np.pi / 4.0 * DIAMETER**2 * COEFFICIENT / MASS
NOISE = 1e-3


def throws(along: float, up: float, seed: int) -> CampaignRecords:
    """Nine throws at 100 Hz in wind."""
    rng, trials = np.random.default_rng(seed), []
    for number in range(9):
        speed, angle = rng.uniform(3.0, 6.0), np.radians(rng.uniform(20.0, 65.0))
        time = np.arange(0.0, min(2.0 * speed * np.sin(angle) / 9.81 + 0.1, 1.0), 0.01)

        def rate(_, s):
            moving = np.array([s[2] - along, s[3] - up])
            pull = -BRAKE * np.hypot(*moving) * moving
            return [s[2], s[3], pull[0], pull[1] - 9.80665]

        start = [0.0, 1.0, speed * np.cos(angle), speed * np.sin(angle)]
        path = solve_ivp(rate, (0.0, 1.1), start, t_eval=time, rtol=1e-9, atol=1e-11).y[:2].T
        seen = path + NOISE * rng.standard_normal(path.shape)
        seen = np.column_stack([seen, np.full(time.size, np.nan)])
        trials.append(Trial(str(number), time, seen, np.zeros(0), np.zeros(0)))
    return CampaignRecords(tuple(trials))


@pytest.mark.slow
@pytest.mark.parametrize(("along", "up"), [(0.0, 1.0), (0.6, -0.8)])
def test_a_vertical_wind_is_only_a_wind(along, up):
    known = {"drag": {"drag_coefficient": COEFFICIENT}}
    baseline = Baseline({"": BallModel("", MASS, DIAMETER)}, effects=known, air_density=DENSITY)
    (named,) = explain(throws(along, up, 4), baseline).effects
    assert named.id == "wind"
    found = {p.name: p for p in named.parameters}
    for name, true in (("wind_x", along), ("wind_y", up)):
        assert found[name].value == pytest.approx(true, abs=3.0 * found[name].std)
        assert found[name].std < 0.3
