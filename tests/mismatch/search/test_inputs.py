"""Names compete with usual errors of stated inputs and instruments."""

from types import SimpleNamespace

import numpy as np
import pytest

from mismatch.explain import explain
from mismatch.fitting.prepare import prepare
from mismatch.fitting.stated import stated_inputs, usual_inputs
from mismatch.records import Baseline
from mismatch.search import inputs
from mismatch.search.inputs import beside_usual_inputs
from mismatch.search.naming import Naming, name_effects
from physics.effects import CATALOGUE
from tests.mismatch.synthetic import struck_campaign

INPUTS = usual_inputs((), ())
CLOCK = CATALOGUE["time_base"][0]
USUAL = {
    "inertia": 0.002, "ball_mass": -0.001, "scale": 0.0016, "level": 0.0007, "zero": 0.0009,
    "rate": -0.0003, "origin_y": 0.0006,
}  # fmt: skip


@pytest.fixture(scope="module")
def careful():
    """Verdict on a laboratory whose inputs and instruments are off as careful ones are."""
    return explain(*struck_campaign((INPUTS, USUAL), noise=5e-4))


def test_a_careful_laboratory_has_nothing_missing(careful):
    """A ruler off by 0.16 % was reported as effective_mass 0.66 and parallax 0.59."""
    assert all(effect.probability < 0.5 for effect in careful.effects)


def test_what_the_inputs_are_off_by_is_reported(careful):
    told = [note for note in careful.notes if "Measure it again" in note]
    assert any(note.startswith("zero of the setup") for note in told)


def test_a_law_of_the_contact_stays_among_usual_errors():
    law = CATALOGUE["velocity_dependent_cor"][0]
    campaign = struck_campaign((law, {law.strengths[0].name: 0.06}), (INPUTS, USUAL), noise=5e-4)
    verdict = explain(*campaign)
    assert "velocity_dependent_cor" in [e.id for e in verdict.effects if e.probability > 0.5]


def test_inputs_without_errors_leave_the_baseline_as_it_is():
    campaign, baseline = struck_campaign(trials=4, noise=5e-4)
    prepared = prepare(campaign, baseline)
    fit = prepared.fit
    with_inputs = fit.model.having(INPUTS, INPUTS.neutral)
    plain, other = prepared.forward.predict(
        [fit.model, with_inputs], np.stack([_spread(prepared)] * 2)
    )
    assert other == pytest.approx(plain, abs=1e-12)
    nothing = Naming(None, (), 12.0, SimpleNamespace(candidates=()))
    assert beside_usual_inputs(prepared, nothing).opened is None


@pytest.mark.parametrize(
    ("added", "opened"), [((CLOCK, {"rate_error": -8e-4}), False), ((INPUTS, USUAL), True)]
)
def test_errors_far_smaller_than_usual_take_the_place_of_no_name(added, opened):
    """A clock off by 0.08 % was set aside for errors all below 0.7 of their usual size."""
    prepared = prepare(*struck_campaign(added, seed=8))
    found = name_effects(prepared.forward, prepared.fit, CATALOGUE["time_base"], unnamed=False)
    assert found.best is not None
    assert (beside_usual_inputs(prepared, found).opened is not None) == opened


def _spread(prepared):
    nuisance = np.array(prepared.fit.nuisance)
    nuisance[:, 2:4] += prepared.fit.law_offsets[prepared.forward.records.ball_index]
    return nuisance


@pytest.mark.parametrize(
    ("alone", "beside", "opened"),
    [(90.0, 99.0, False), (90.0, 101.0, True), (101.0, 90.0, True), (-101.0, 108.0, False)],
)
def test_inputs_are_opened_where_they_are_ahead(alone, beside, opened, monkeypatch):
    """A rolling shutter next to a lens was left out: usual errors were 2 of 1,713 ahead."""
    sets = (_set_with_inputs(alone), _set_with_inputs(beside, names=1))
    monkeypatch.setattr(inputs, "_in_place_of_names", lambda *_: sets)
    monkeypatch.setattr(inputs, "_beside", lambda *_: _set_with_inputs(0.0))
    forward = SimpleNamespace(mode="impact", baseline=Baseline({}))
    best = SimpleNamespace(reduced_chi2=1.0)
    naming = SimpleNamespace(best=best, height=lambda _: 100.0)
    prepared = SimpleNamespace(forward=forward, fit=None)
    monkeypatch.setattr(inputs, "replace", lambda _, **given: given)
    found = beside_usual_inputs(prepared, naming)
    assert (found.opened is not None) == opened
    assert found.sets[-2:] == tuple(one for one in sets if one.allowed)


def _set_with_inputs(evidence, names=0):
    """A set of usual errors and names; of a negative size if a fit left its bounds."""
    members = (SimpleNamespace(effect=INPUTS),) * (1 + names)
    allowed = evidence >= 0.0
    return SimpleNamespace(penalised_gain=abs(evidence), members=members, fit=None, allowed=allowed)


def test_inputs_have_the_same_odds_in_place_of_a_first_and_of_a_further_name(monkeypatch):
    """Beside a name they were spared what a further name costs: a right lens got 0.15."""
    monkeypatch.setattr(inputs, "fit_hypothesis", lambda *_, **__: SimpleNamespace(gain=50.0))
    monkeypatch.setattr(inputs, "as_fitted", lambda members, _: ([*members], [0.0]))
    monkeypatch.setattr(inputs, "replace", lambda _, gain: gain)
    named = SimpleNamespace(members=("support_friction",), fit=None)
    gains = [inputs._beside(None, None, found, INPUTS) for found in (None, named)]
    assert gains[0] == gains[1] == 50.0 - inputs.PRIOR_COST


def test_what_is_open_or_named_already_is_not_opened_twice():
    names = {p.name for p in usual_inputs(stated_inputs({"inertia": 0.01}), ()).parameters}
    assert "inertia" not in names
    assert "ball_mass" in names
    names = {p.name for p in usual_inputs((), ("camera_roll",)).parameters}
    assert names.isdisjoint({"level", "zero"})
    assert "scale" in names
