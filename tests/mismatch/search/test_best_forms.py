"""The form of a law that was best alone need not be the best one beside a fellow."""

from mismatch.candidates import candidates_for
from mismatch.fitting.hypotheses import fit_hypothesis
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import scan
from mismatch.search.naming import _in_best_forms
from physics.effects import CATALOGUE, Form, effect_named
from tests.mismatch.synthetic import struck_campaign

SOFTER, YIELDING = effect_named("contact_displacement"), effect_named("pivot_recoil")
WAY_ALONE = next(e for e in CATALOGUE["contact_displacement"] if e.form == Form.WAY_ALONE)
EFFECTS = [one for forms in CATALOGUE.values() for one in forms]


def test_laws_are_fitted_in_the_forms_that_fit_together():
    """A softer ball under a yielding pivot was told as a shorter way, with a third law beside."""
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
