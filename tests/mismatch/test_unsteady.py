"""A strength that varies between trials is no law common to all."""

import numpy as np
import pytest

from mismatch.candidates import candidates_for
from mismatch.fitting.hypotheses import fit_hypothesis
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import heterogeneity, scan
from mismatch.verdict import Doubt, pass_gate
from physics.effects import CATALOGUE
from physics.effects.flight import Magnus
from tests.mismatch.synthetic import struck_campaign


class TurnedMagnus(Magnus):
    """Spin that changes its sign between trials, by far more than its mean."""

    def force(self, values, flight):
        own = {"spin": values["spin"] * (1.0 + 6.0 * np.asarray(flight.order))}
        return super().force(own, flight)


@pytest.mark.parametrize(("law", "unsteady"), [(Magnus(), False), (TurnedMagnus(), True)])
def test_a_strength_that_varies_between_trials_is_detected(law, unsteady):
    known = prepare(*struck_campaign((law, {"spin": 6.0}), noise=5e-4))
    lift = CATALOGUE["magnus"][0]
    (pool,) = [c for c in candidates_for(known.forward, known.model, [lift], unnamed=False)
               if c.effect.level is lift.level]  # fmt: skip
    _, values = scan(known.forward, known.fit, [pool]).gain(0)
    answer = fit_hypothesis(known.forward, known.fit, [pool], [values])
    (seen,) = heterogeneity(known.forward, answer.fit)
    assert (seen.chance < 1e-3) == unsteady
    doubts = pass_gate(known, answer, "explained", None).doubts
    assert (Doubt.UNSTEADY in doubts) == unsteady
