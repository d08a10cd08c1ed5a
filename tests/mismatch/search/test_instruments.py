"""Flexible camera errors: their cost, and their comparison with two laws."""

from dataclasses import replace

import pytest

from mismatch.candidates import candidates_for
from mismatch.fitting.hypotheses import fit_hypothesis
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import scan
from mismatch.search.naming import _two_instead
from physics.effects import CATALOGUE, Form, effect_named
from tests.mismatch.synthetic import struck_campaign

ALL = [form for forms in CATALOGUE.values() for form in forms]
SHUTTER = next(one for one in CATALOGUE["rolling_shutter"] if one.form == Form.BALL_ONLY)


def best_of(known, effect):
    pool = candidates_for(known.forward, known.fit.model, [effect], unnamed=False)
    scored = scan(known.forward, known.fit, pool)
    looks = [scored.gain(k) for k in range(len(pool))]
    index = max(range(len(pool)), key=lambda k: looks[k][0])
    return fit_hypothesis(known.forward, known.fit, [pool[index]], [looks[index][1]])


def cost_of(effect, size, centre):
    """Cost of an optical axis relative to one without a prior, chi-square units."""
    (strength,) = (p.name for p in effect.strengths)
    values = {strength: size, "centre_along": centre, "centre_up": 0.1}
    known = prepare(*struck_campaign((effect, values)))
    anywhere = tuple(replace(p, expected=None) for p in effect.parameters)
    free, held = best_of(known, replace(effect, parameters=anywhere)), best_of(known, effect)
    return free.gain - held.gain


@pytest.mark.parametrize(("identity", "size"), [("lens_distortion", 1e-3), ("parallax", 0.02)])
def test_an_optical_axis_outside_the_image_has_a_cost(identity, size):
    effect = effect_named(identity)
    assert cost_of(effect, size, 0.1) == pytest.approx(0.0, abs=1.5)
    assert cost_of(effect, size, 1.8) > 2.5


def scanned(*added, seed):
    known = prepare(*struck_campaign(*added, seed=seed))
    pool = candidates_for(known.forward, known.fit.model, ALL)
    return known, scan(known.forward, known.fit, pool)


def test_one_law_that_mimics_two_is_compared_with_them():
    wind, spin = (effect_named("wind"), {"wind_x": -0.3}), (effect_named("magnus"), {"spin": 1.2})
    known, first = scanned(wind, spin, seed=3)
    shutter = best_of(known, SHUTTER)
    assert shutter.reduced_chi2 == pytest.approx(1.0, abs=0.01)
    pairs = _two_instead(first, shutter)
    fits = [fit_hypothesis(known.forward, known.fit, *pair) for pair in pairs]
    assert max(fit.penalised_gain for fit in fits) > shutter.penalised_gain


def test_a_law_that_no_pair_replaces_is_the_answer():
    known, first = scanned((effect_named("backswing_offset"), {"offset": 0.02}), seed=3)
    assert not _two_instead(first, best_of(known, effect_named("backswing_offset")))
