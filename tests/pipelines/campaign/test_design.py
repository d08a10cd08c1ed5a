"""The plan of a campaign, held against campaigns drawn by its own recipe."""

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from metrology import DomainError
from physics.bodies import BALLS, PAPER_PENDULUM
from pipelines.campaign.design import Precisions, design_campaign
from pipelines.cli import app

JOKKU = BALLS["jokku"]
PLAIN = Precisions(clip=0.008, strike=0.006, session=0.0, shared={}, source="a test")


def designed(target: float = 0.003, precisions: Precisions = PLAIN):
    return design_campaign(JOKKU.cor, PAPER_PENDULUM, JOKKU, target, precisions)


def test_simulated_campaigns_reach_the_precision_that_was_planned() -> None:
    """Straight least squares on drawn strikes: nothing of the design's own algebra."""
    design = designed()
    speed = np.repeat(
        [one.impact_speed for one in design.settings], [one.strikes for one in design.settings]
    )
    law = JOKKU.cor
    truth = np.array([law.amplitude * math.exp(-law.shift), law.rate, law.floor])
    grid = np.linspace(speed.min(), speed.max(), 30)

    def curve(v, parameters):
        a, b, d = parameters
        return a * np.exp(-b * v) + d

    def slopes(v):
        steps = 1e-5 * np.eye(3)
        return np.stack([(curve(v, truth + h) - curve(v, truth - h)) / 2e-5 for h in steps], -1)

    scatter = math.hypot(0.008, 0.006) * np.random.default_rng(1).standard_normal((len(speed), 900))
    moved = np.linalg.lstsq(slopes(speed), scatter, rcond=None)[0]
    worst = np.std(slopes(grid) @ moved, axis=1).max()
    assert worst == pytest.approx(design.random_std, rel=0.12)
    assert design.std <= 0.003
    # P s² / N of Kiefer and Wolfowitz, up to whole strikes
    assert design.strikes >= 3 * (0.008**2 + 0.006**2) / 0.003**2 - 1
    assert design.strikes < 1.6 * 3 * (0.008**2 + 0.006**2) / 0.003**2


def test_optimal_back_swings_beat_even_ones() -> None:
    design = designed()
    assert len(design.settings) == 3
    even = np.linspace(design.settings[0].impact_speed, design.settings[-1].impact_speed, 8)
    law = JOKKU.cor

    def information(speeds, counts):
        bent = np.exp(-law.rate * speeds)
        g = np.column_stack([bent, -speeds * bent, np.ones_like(speeds)])
        return np.linalg.det(g.T @ (np.asarray(counts)[:, None] / np.sum(counts) * g))

    own = np.array([one.impact_speed for one in design.settings])
    assert information(own, [one.strikes for one in design.settings]) > 1.5 * information(
        even, np.ones(8)
    )


def test_half_the_target_needs_four_times_the_strikes_and_sessions_do_not_average() -> None:
    assert designed(0.0015).strikes == pytest.approx(4 * designed().strikes, rel=0.15)
    between = Precisions(0.008, 0.006, 0.004, {}, "a test")
    design = designed(0.003, between)
    assert design.sessions >= 0.004**2 / (0.25 * 0.003**2)
    assert design.std <= 0.003
    assert all(one.strikes % design.sessions == 0 for one in design.settings)


def test_what_is_shared_sets_a_floor_and_says_what_to_measure_first() -> None:
    shared = {"mass of the ball": 0.0005, "depth of the mass' visible side": 0.004}
    design = designed(0.003, Precisions(0.008, 0.006, 0.0, shared, "a test"))
    assert not design.reachable
    name, std, needed = design.first[0]
    assert (name, std) == ("depth of the mass' visible side", 0.004)
    assert needed == pytest.approx(math.sqrt(0.003**2 - 0.0005**2))
    # the smaller one alone can't make it
    assert design.first[1][2] == 0.0


@pytest.mark.parametrize("target", [0.0, -1.0, 2.0, math.nan])
def test_a_target_that_can_not_be_is_refused(target) -> None:
    with pytest.raises(DomainError):
        designed(target)


def test_the_command(tmp_path) -> None:
    runner = CliRunner()
    ran = runner.invoke(app, ["plan", "campaign", "--target-cor-std", "0.003", "--json", "-"])
    assert ran.exit_code == 0, ran.output
    told = json.loads(ran.stdout)
    assert told["reachable"]
    assert told["quantities"]["cor_law_std"]["value"] <= 0.003
    assert told["quantities"]["strikes"]["value"] == sum(s["strikes"] for s in told["settings"])
    unreachable = runner.invoke(app, ["plan", "campaign", "--target-cor-std", "0.00001"])
    assert unreachable.exit_code == 4
    assert "Measure the inertia of the pendulum better first" in unreachable.output
    nothing = runner.invoke(
        app, ["plan", "campaign", "--target-cor-std", "0.003", "--pilot", str(tmp_path)]
    )
    assert nothing.exit_code == 2
    # without a name the plan of one strike is meant
    refused = runner.invoke(app, ["plan", "--distance", "2 parsecs of mm"])
    assert refused.exit_code == 2
    assert "--distance" in refused.output
    assert "Example: vision plan --distance" in runner.invoke(app, ["plan", "--help"]).output
