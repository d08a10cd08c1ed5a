"""Physically impossible answers: not given, but they limit the confidence."""

from types import SimpleNamespace

import numpy as np
import pytest

from mismatch.candidates import Candidate
from mismatch.fitting.fit import Ending, Fit, free_parameters
from mismatch.fitting.hypotheses import Hypothesis, fit_hypothesis
from mismatch.fitting.prepare import prepare
from mismatch.forward import ForwardModel
from mismatch.records import BallModel, Baseline, CampaignRecords, Trial
from mismatch.search.naming import Naming
from mismatch.verdict import DOUBTED, Doubt, pass_gate
from physics.effects import CATALOGUE, EffectId, effect_named

GRAVITY = 9.806


@pytest.fixture(scope="module")
def pushed():
    """Throws accelerated along their velocity by 0.03 v² (m/s²): a negative drag."""
    rng = np.random.default_rng(4)
    step, rows = 1e-3, 500
    trials = []
    for number in range(4):
        place, velocity = np.array([0.0, 1.0]), np.array([2.0 + number, 3.0])
        path = np.empty((rows, 2))
        for row in range(rows):
            path[row] = place
            pull = 0.03 * float(np.hypot(*velocity)) * velocity - np.array([0.0, GRAVITY])
            place = place + step * velocity + 0.5 * step**2 * pull
            velocity = velocity + step * pull
        seen = path[::10] + 1e-3 * rng.standard_normal((rows // 10, 2))
        flat = np.column_stack([seen, np.full(len(seen), np.nan)])
        times = step * np.arange(0, rows, 10)
        trials.append(Trial(str(number), times, flat, np.zeros(0), np.zeros(0)))
    return prepare(CampaignRecords(tuple(trials)), Baseline({"": BallModel("", 0.0577, 0.066)}))


def _fitted(known, identity):
    candidate = Candidate(CATALOGUE[identity][0])
    start = np.array([p.neutral for p in candidate.effect.strengths])
    return fit_hypothesis(known.forward, known.fit, [candidate], [start])


def test_no_name_is_confident_if_an_impossible_answer_is_better(pushed):
    forbidden, other = _fitted(pushed, EffectId.DRAG), _fitted(pushed, "lens_distortion")
    assert forbidden.forbidden
    assert forbidden.fit.ending is Ending.CONVERGED
    assert not other.forbidden
    naming = Naming(other, (forbidden, other), 12.0, None)
    assert naming.outdone
    passed = pass_gate(pushed, other, "explained", None, outdone=naming.outdone)
    assert Doubt.OUTDONE in passed.doubts
    assert passed.most <= DOUBTED


def test_an_impossible_answer_that_is_not_better_has_no_effect(pushed):
    other = _fitted(pushed, "lens_distortion")
    forbidden = _fitted(pushed, EffectId.DRAG)
    assert not Naming(forbidden, (forbidden, other), 12.0, None).outdone
    assert not Naming(other, (other,), 12.0, None).outdone


def _fitted_law(effect, values, stds, gain):
    """A law fitted to strikes with given values and standard uncertainties."""
    model = ForwardModel(((effect, values),))
    fit = Fit(
        model, np.zeros((12, 4)), np.zeros((1, 2)), 6700.0, 0.0, 6700, 6700.0,
        free_parameters(model), np.diag(np.square(stds)), np.zeros((12, 600)),
    )  # fmt: skip
    return Hypothesis((Candidate(effect),), fit, gain)


@pytest.mark.parametrize(
    ("drop", "std", "excluded"), [(0.66, 0.78, False), (0.66, 0.02, True), (-0.05, 0.3, True)]
)
def test_a_partly_observed_drag_crisis_is_not_excluded(drop, std, excluded):
    """Its depth and its speed are correlated; the largest depth, 0.6, fits equally well."""
    crisis, lens = effect_named("drag_crisis"), effect_named("lens_distortion")
    values = {"coefficient_drop": drop, "critical_reynolds": 8.5e4, "width": 0.2}
    fallen = _fitted_law(crisis, values, (std, 2.8e4, 0.06), 300.0)
    bent = _fitted_law(lens, lens.neutral | {"radial": 7e-4}, (2e-4, 0.3, 0.2), 302.0)
    assert not fallen.allowed
    naming = Naming(bent, (bent, fallen), 12.0, SimpleNamespace(candidates=()))
    assert (fallen not in naming.rivals()) is excluded
