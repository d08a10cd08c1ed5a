"""Faults of a camera that bend to much: what they cost."""

from dataclasses import replace

import pytest

from mismatch.candidates import candidates_for
from mismatch.fitting.hypotheses import fit_hypothesis
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import scan
from physics.effects import effect_named
from tests.mismatch.synthetic import struck_campaign


def best_of(known, effect):
    pool = candidates_for(known.forward, known.fit.model, [effect], unnamed=False)
    scored = scan(known.forward, known.fit, pool)
    looks = [scored.gain(k) for k in range(len(pool))]
    index = max(range(len(pool)), key=lambda k: looks[k][0])
    return fit_hypothesis(known.forward, known.fit, [pool[index]], [looks[index][1]])


def cost_of(effect, size, centre):
    """What an axis costs beside one that may be anywhere: chi-square units."""
    (strength,) = (p.name for p in effect.strengths)
    values = {strength: size, "centre_along": centre, "centre_up": 0.1}
    known = prepare(*struck_campaign((effect, values)))
    anywhere = tuple(replace(p, expected=None) for p in effect.parameters)
    free, held = best_of(known, replace(effect, parameters=anywhere)), best_of(known, effect)
    return free.gain - held.gain


@pytest.mark.parametrize(("identity", "size"), [("lens_distortion", 1e-3), ("parallax", 0.02)])
def test_an_optical_axis_beside_the_picture_has_to_be_paid_for(identity, size):
    effect = effect_named(identity)
    assert cost_of(effect, size, 0.1) == pytest.approx(0.0, abs=1.5)
    assert cost_of(effect, size, 1.8) > 2.5
