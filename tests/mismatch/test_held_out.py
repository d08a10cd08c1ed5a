"""Held-out trials are chosen so that the others can predict them."""

from dataclasses import dataclass

import numpy as np

from mismatch import verdict
from mismatch.candidates import candidates_for
from mismatch.fitting.hypotheses import fit_hypothesis
from mismatch.fitting.prepare import prepare
from mismatch.records import CampaignRecords
from mismatch.verdict import hold_out, predict
from physics.domain import Vector
from physics.effects import Effect, FlightState, Parameter, Values
from tests.mismatch.synthetic import struck_campaign


@dataclass(frozen=True)
class Fan(Effect):
    """A force upwards beyond two metres, which only hard shots reach."""

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Upwards beyond two metres."""
        nothing = np.zeros_like(np.asarray(flight.x))
        return nothing, values["strength"] / (1.0 + np.exp((2.0 - flight.x) / 0.02)), nothing


def test_held_out_trials_are_predictable_from_the_others():
    """Only the two hard shots reach it, and both would be held out as third of three."""
    law = Fan("fan", "", "", "", "flight", (Parameter("strength", "N", 0.1, -10.0, 10.0),))
    campaign, baseline = struck_campaign((law, {"strength": 1.0}))
    order = (0, 1, 3, 2, 4, 7, 5, 6)
    known = prepare(CampaignRecords(tuple(campaign.trials[k] for k in order)), baseline)
    pool = candidates_for(known.forward, known.fit.model, [law], unnamed=False)
    found = fit_hypothesis(known.forward, known.fit, pool, [np.zeros(1)])
    proof = hold_out(known.forward, known.fit, found)
    assert proof is not None
    assert {"2", "5"} < set(proof.trials)
    assert proof.rmse_after < proof.rmse_before
    assert proof.gain is not None
    assert proof.gain > 100.0
    asked = hold_out(known.forward, known.fit, found, np.arange(8) % 3 == 2)
    assert asked is not None
    assert asked.trials == ("2", "5")
    assert asked.rmse_after > 2.0 * asked.rmse_before


def test_a_set_is_predicted_once_for_all_answers_that_are_tested(monkeypatch):
    """Each of four answers of a long swing predicted the same baseline anew, 9 of 46 s."""
    law = Fan("fan", "", "", "", "flight", (Parameter("strength", "N", 0.1, -10.0, 10.0),))
    known = prepare(*struck_campaign((law, {"strength": 1.0}), trials=5))
    pool = candidates_for(known.forward, known.fit.model, [law], unnamed=False)
    sets = [
        fit_hypothesis(known.forward, known.fit, pool, [np.array([size])]) for size in (0.0, 0.5)
    ]
    extrapolated, seen = [], verdict._extrapolation

    def counted(forward, fit, free):
        extrapolated.append(id(fit))
        return seen(forward, fit, free)

    monkeypatch.setattr(verdict, "_extrapolation", counted)
    shared = {}
    _, first = predict(known.forward, known.fit, sets[:1], known=shared)
    _, second = predict(known.forward, known.fit, sets[::-1], known=shared)
    assert sorted(extrapolated) == sorted({id(known.fit), *(id(h.fit) for h in sets)})
    assert first.items() <= second.items()
