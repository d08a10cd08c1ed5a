"""Significance thresholds of the search."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from mismatch.candidates import candidates_for
from mismatch.explain import explain
from mismatch.fitting import hypotheses
from mismatch.fitting.hypotheses import null_threshold
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import price, scan
from mismatch.records import BallModel, Baseline, CampaignRecords, Trial
from mismatch.sanity import dropped_in_each
from mismatch.search.naming import name_effects
from physics.effects import CATALOGUE
from tests.mismatch.synthetic import struck_campaign

EFFECTS = [effect for forms in CATALOGUE.values() for effect in forms]


@pytest.fixture(scope="module")
def clean():
    return prepare(*struck_campaign(seed=3))


def test_the_threshold_holds_for_the_whole_catalogue(clean):
    pool = candidates_for(clean.forward, clean.model, EFFECTS)
    scored = scan(clean.forward, clean.fit, pool)
    at_5_percent, at_0_1_percent = null_threshold(scored, 0.05), null_threshold(scored, 0.001)
    # One signed effect: 2.7 and 9.5; a few dozen different ones cost several units more.
    assert 7.0 < at_5_percent < 12.0
    assert 14.0 < at_0_1_percent < 20.0


@pytest.fixture
def many_draws(monkeypatch):
    """The default draws determine the threshold to half a unit, these to a tenth."""
    monkeypatch.setattr(hypotheses, "DRAWS", 48_000)


@pytest.mark.slow
@pytest.mark.usefixtures("many_draws")
def test_an_unnamed_law_has_the_cost_of_its_rarity(clean):
    pool = candidates_for(clean.forward, clean.model, EFFECTS)
    named = scan(clean.forward, clean.fit, [c for c in pool if c.id != "unnamed"])
    every = scan(clean.forward, clean.fit, pool)
    # Searching for all of them hardly raises the threshold of named effects.
    assert null_threshold(every) - null_threshold(named) < 0.3


def test_the_cost_of_weights_equals_their_evidence():
    """Compared with the evidence: a Gaussian over all rows, free strengths nearly unknown."""
    rng = np.random.default_rng(4)
    columns, widths = rng.normal(size=(12, 3)), np.array([1e3, 0.7, 3.0])
    columns[:, 0] += columns[:, 1]
    seen = rng.normal(size=12)

    def evidence(which: list[int]) -> float:
        spread = columns[:, which] * widths[which]
        covariance = np.eye(12) + spread @ spread.T
        return 2.0 * float(multivariate_normal.logpdf(seen, np.zeros(12), covariance))

    information, score = columns.T @ columns, columns.T @ seen
    held = np.array([0.0, *widths[1:] ** -2.0])
    gain = score @ np.linalg.solve(information + np.diag(held), score)
    alone = score[0] ** 2 / information[0, 0]
    asked = price(information, held)
    assert gain - asked - alone == pytest.approx(evidence([0, 1, 2]) - evidence([0]), abs=1e-3)
    assert price(information, np.zeros(3)) == 0.0


@pytest.mark.slow
@pytest.mark.usefixtures("many_draws")
def test_a_law_of_many_weights_does_not_raise_the_threshold_of_others(clean):
    """A law with many weights changes the threshold of others by less than 1.5 units."""
    every = candidates_for(clean.forward, clean.model, EFFECTS)
    partly = [c for c in every if 0 < sum(p.is_held for p in c.effect.strengths) < len(
        c.effect.strengths)]  # fmt: skip
    others = [c for c in every if c not in partly]
    assert len(partly) >= 3
    thresholds = [null_threshold(scan(clean.forward, clean.fit, pool)) for pool in (every, others)]
    # A vertical wind is one more law of this kind; each law adds to the threshold.
    assert thresholds[0] - thresholds[1] < 0.5


def dropped_ball(drag: float) -> tuple[CampaignRecords, Baseline]:
    """A fall of one second with much noise, whose baseline is gravity only."""
    rng = np.random.default_rng(2)
    time = np.arange(0.0, 1.0, 1.0 / 60.0)
    height = 8.0 - 0.5 * 9.806 * time**2 + drag * time**4 + rng.normal(0.0, 0.02, time.size)
    position = np.column_stack([np.full((time.size, 2), np.nan), np.zeros(time.size)])
    position[:, 1], position[:, 2] = height, np.nan
    trial = Trial("1", time, position, np.zeros(0), np.zeros(0))
    return CampaignRecords((trial,)), Baseline({"": BallModel("", 0.06, 0.1)})


def test_drag_has_no_search_cost_for_a_model_without_it():
    ruler_and_clock = {"length_scale": 1e-5, "time_base": 1e-5}
    prepared = prepare(*dropped_ball(0.045), ruler_and_clock)
    naming = name_effects(prepared.forward, prepared.fit, EFFECTS)
    assert naming.best is not None
    assert naming.best.ids == ("drag",)
    assert naming.best.penalised_gain < naming.threshold


def test_a_fall_without_drag_names_no_drag():
    assert explain(*dropped_ball(0.0)).effects == ()


def test_frames_can_be_missing_but_not_extra(clean):
    jumps = dropped_in_each(clean.forward, clean.fit)
    assert jumps is not None
    assert jumps.parameters[0].lower == 0.0
