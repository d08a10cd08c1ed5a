"""A fit finds for a law with a place what it finds when it starts from there."""

from dataclasses import replace

import numpy as np
import pytest

from mismatch.candidates import candidates_for
from mismatch.fitting import hypotheses
from mismatch.fitting.fit import Ending
from mismatch.fitting.hypotheses import SLACK, as_fitted, fit_hypothesis
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import scan
from mismatch.records import BallModel, Baseline, CampaignRecords, Trial
from mismatch.search import naming
from mismatch.search.naming import _best_by_law, _by_law
from mismatch.search.unnamed import Magnet, ResistanceCurve, SmoothCurve
from physics.effects import CATALOGUE, EffectId
from tests.mismatch.synthetic import struck_campaign

GRAVITY = 9.806


@pytest.fixture(scope="module")
def tethered():
    """Throws of a body on a soft thread that is taut beyond 0.9 m from where it is tied."""
    rng = np.random.default_rng(6)
    step, trials = 5e-4, []
    for number in range(6):
        place, velocity = np.array([0.0, 1.0]), np.array([2.2 + 0.2 * number, 1.5])
        path = []
        for _ in range(1200):
            path.append(place)
            apart = place - np.array([0.2, 1.0])
            length = float(np.hypot(*apart))
            pull = -12.0 * max(length - 0.6, 0.0) * apart / max(length, 1e-9)
            velocity = velocity + step * (pull - np.array([0.0, GRAVITY]))
            place = place + step * velocity
        seen = np.array(path)[::16] + 5e-4 * rng.standard_normal((75, 2))
        flat = np.column_stack([seen, np.full(75, np.nan)])
        trials.append(Trial(str(number), 16 * step * np.arange(75), flat, np.zeros(0), np.zeros(0)))
    return prepare(CampaignRecords(tuple(trials)), Baseline({"": BallModel("", 0.06, 0.065)}))


def test_a_place_far_from_every_start_is_found_at_once(tethered):
    """A taut thread was left 55 units short of its own best fit, and lost to a false pair."""
    forward, base = tethered.forward, tethered.fit
    pool = [c for c in candidates_for(forward, base.model, []) if isinstance(c.effect, Magnet)]
    ranked = _best_by_law(scan(forward, base, pool), 1.0)
    _, index, values = ranked[0]
    found = fit_hypothesis(forward, base, [pool[index]], [values])
    again = fit_hypothesis(forward, base, *as_fitted(found.members, found.fit), start=found.fit)
    assert found.fit.ending is Ending.CONVERGED
    assert found.fit.objective - again.fit.objective < 3.0 * SLACK


@pytest.mark.parametrize(
    ("place_x", "place_y", "reach", "strength"), [(0.72, 0.33, 0.069, 1.5), (0.4, 0.45, 0.06, 1.0)]
)
def test_a_pull_from_below_is_no_push_from_above(place_x, place_y, reach, strength):
    """A push from 14 cm above took its place, 300 units behind, with a false drag beside it."""
    place = {"place_x": place_x, "place_y": place_y, "reach": reach}
    prepared = prepare(*struck_campaign((Magnet(), place | {"strength": strength}), seed=5))
    forward, base = prepared.forward, prepared.fit
    pool = candidates_for(forward, base.model, [Magnet()], unnamed=False)
    there = replace(pool[0], shape=tuple(place.items()))
    true = fit_hypothesis(forward, base, [there], [np.array([strength])])
    scored = scan(forward, base, pool)
    (found,) = naming._singles(forward, base, scored, _best_by_law(scored))
    assert found.fit.objective < true.fit.objective + SLACK


def test_a_law_whose_fit_has_ended_is_not_fitted_again(tethered, monkeypatch):
    """A tenth of the time went into fits that had converged and moved by nothing."""
    forward, base = tethered.forward, tethered.fit
    laws = [CATALOGUE["drag"][0], CATALOGUE["buoyancy"][0], Magnet()]
    pool = candidates_for(forward, base.model, laws, unnamed=False)
    ranked = _best_by_law(scan(forward, base, pool), anywhere=True)
    tried = [fit_hypothesis(forward, base, [pool[at]], [values]) for _, at, values in ranked]
    assert {h.fit.ending for h in tried} == {Ending.CONVERGED}
    monkeypatch.setattr(naming, "FIRST_REACH", np.inf)
    monkeypatch.setattr(naming, "_continued", lambda forward, base, h, rival: None)
    kept = naming._those_that_compete_finished(forward, base, tried)
    assert [one is None for one in kept] == [h.ids == (Magnet().id,) for h in tried]


def test_a_fit_is_left_where_as_much_gain_again_would_not_reach_its_rival(tethered, monkeypatch):
    """One law that ran away along its valley took 10 of 24 seconds, far behind the answer."""
    forward, base = tethered.forward, tethered.fit
    pool = [c for c in candidates_for(forward, base.model, []) if isinstance(c.effect, Magnet)]
    _, index, values = _best_by_law(scan(forward, base, pool), 1.0)[-1]
    rounds = []
    fitted = hypotheses._fitted_from

    def counted(*args, **options):
        rounds.append(1)
        return fitted(*args, **options)

    monkeypatch.setattr(hypotheses, "_fitted_from", counted)
    alone = fit_hypothesis(forward, base, [pool[index]], [values])
    free, rounds[:] = len(rounds), []
    least = alone.fit.objective - 2.0 * abs(base.objective - alone.fit.objective)
    fit_hypothesis(forward, base, [pool[index]], [values], rival=least)
    assert len(rounds) < free


def test_curves_do_not_crowd_out_laws_without_a_name(tethered):
    forward, base = tethered.forward, tethered.fit
    effects = [effect for forms in CATALOGUE.values() for effect in forms]
    scored = scan(forward, base, candidates_for(forward, base.model, effects)).with_likely_widths()
    first, _ = _by_law(_best_by_law(scored, 1.0), scored.candidates)
    found = [scored.candidates[index].effect for _, index, _ in first]
    nameless = [effect for effect in found if effect.id == EffectId.UNNAMED]
    assert sum(isinstance(effect, SmoothCurve) for effect in nameless) >= 3
    assert sum(not isinstance(effect, SmoothCurve) for effect in nameless) >= 3


def test_a_coefficient_of_resistance_may_change_with_time(tethered):
    curves = [
        c.effect
        for c in candidates_for(tethered.forward, tethered.fit.model, [])
        if isinstance(c.effect, ResistanceCurve)
    ]
    assert len(curves) == 4
    assert len({curve.coordinate for curve in curves}) == 4
