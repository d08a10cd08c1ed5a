"""The best form of a law alone may differ from the best form in a pair."""

from mismatch.candidates import candidates_for
from mismatch.fitting.hypotheses import Hypothesis, fit_hypothesis
from mismatch.fitting.prepare import Prepared, prepare
from mismatch.fitting.scan import scan
from mismatch.search.naming import KNOWN_GAIN, _goes_first, _in_best_forms, name_effects
from physics.effects import CATALOGUE, Effect, Form, effect_named
from tests.mismatch.synthetic import struck_campaign

SOFTER, YIELDING = effect_named("contact_displacement"), effect_named("pivot_recoil")
WAY_ALONE = next(e for e in CATALOGUE["contact_displacement"] if e.form == Form.WAY_ALONE)
EFFECTS = [one for forms in CATALOGUE.values() for one in forms]


def test_laws_are_fitted_in_the_jointly_best_forms():
    """A softer ball with a compliant pivot."""
    struck = ((SOFTER, {"relative_change": 0.2}), (YIELDING, {"lost_share": 0.01}))
    known = prepare(*struck_campaign(*struck))
    laws = [WAY_ALONE, YIELDING, effect_named("effective_mass")]
    pool = candidates_for(known.forward, known.fit.model, laws, unnamed=False)
    scored = scan(known.forward, known.fit, pool)
    starts = [scored.gain(k)[1] for k in range(3)]
    alone = fit_hypothesis(known.forward, known.fit, pool[:1], starts[:1])
    three = fit_hypothesis(known.forward, known.fit, list(pool), starts)
    tried = [alone, three]
    larger, smaller = _in_best_forms(known.forward, known.fit, EFFECTS, three, alone, tried)
    assert larger.fit.chi2 < three.fit.chi2
    assert [(m.id, m.effect.form) for m in smaller.members] == [
        (SOFTER.id, SOFTER.form), (YIELDING.id, YIELDING.form),
    ]  # fmt: skip
    assert smaller.penalised_gain > larger.penalised_gain
    assert smaller in tried


def _fitted_together(known: Prepared, *laws: Effect) -> Hypothesis:
    pool = candidates_for(known.forward, known.fit.model, laws, unnamed=False)
    scored = scan(known.forward, known.fit, pool)
    return fit_hypothesis(
        known.forward, known.fit, list(pool), [scored.gain(k)[1] for k in range(len(laws))]
    )


def test_three_laws_are_compared_with_every_two_of_them():
    """A law selected first may become unnecessary when others are added."""
    draught, shutter = effect_named("wind"), effect_named("rolling_shutter")
    struck = ((SOFTER, {"relative_change": -0.2}), (draught, {"wind_x": 0.8}))
    known = prepare(*struck_campaign(*struck))
    three = _fitted_together(known, shutter, draught, SOFTER)
    alone = _fitted_together(known, shutter, draught)
    _, smaller = _in_best_forms(known.forward, known.fit, EFFECTS, three, alone, [alone, three])
    assert sorted(smaller.ids) == sorted((SOFTER.id, draught.id))
    assert smaller.penalised_gain > alone.penalised_gain + 100.0


def test_the_second_law_is_compared_with_others_in_all_their_forms():
    """A camera rotated about a point also shifts the image; another form does so partly."""
    slowed = (effect_named("viscous_damping"), {"viscous_coefficient": 0.06})
    shifted = (effect_named("origin_offset"), {"offset_x": 1e-3})
    known = prepare(*struck_campaign(slowed, shifted))
    turns = CATALOGUE["camera_roll"]
    found = name_effects(known.forward, known.fit, [slowed[0], shifted[0], *turns], unnamed=False)
    assert found.best is not None
    answers = {frozenset(h.ids) for h in (found.best, *found.rivals())}
    assert answers == {frozenset((slowed[0].id, one)) for one in ("origin_offset", "camera_roll")}
    forms = {h.members[-1].effect.form for h in found.rivals() if h.ids[0] == slowed[0].id}
    # a camera rotated about all axes has the cost of its weights and is no candidate
    assert {Form.ABOUT_A_POINT, Form.BALL_ONLY} <= forms


def test_a_known_law_does_not_count_in_the_gain_of_the_second():
    """A gain of one law over its alternative does not count for the second law."""
    bearing, oil = effect_named("bearing_friction"), effect_named("viscous_damping")
    known = prepare(*struck_campaign((bearing, {"dry_torque": 0.1})))
    alone, rival = (_fitted_together(known, law) for law in (bearing, oil))
    both = _fitted_together(known, bearing, effect_named("density_lapse"))
    assert abs(both.gain - alone.gain) < 1.0
    assert both.gain > rival.gain + KNOWN_GAIN * both.reduced_chi2
    assert not _goes_first(known.forward, both, rival, [alone, rival, both], 12.0)
