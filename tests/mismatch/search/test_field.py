"""Forces that no law of the catalogue or of the search has: found as a curve, called unnamed."""

from dataclasses import dataclass

import numpy as np

from mismatch import explain
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import scan
from mismatch.model.candidates import candidates_for
from mismatch.search.unnamed import KNOTS, Field
from physics.effects import Coordinate, Effect, Parameter
from tests.mismatch.synthetic import struck_campaign


@dataclass(frozen=True)
class Flutter(Effect):
    """A horizontal force that changes its sign twice during a flight."""

    id: str = "flutter"
    statement: str = "made for this test"
    law: str = r"F = a \sin(2 \pi t / 0.25)"
    source: str = "made for this test"
    phase: str = "flight"
    parameters: tuple[Parameter, ...] = (Parameter("a", "N", 0.1, -9.0, 9.0),)

    def force(self, values, flight):
        size = values["a"] * np.sin(2.0 * np.pi * flight.time / 0.25) + 0.0 * np.asarray(flight.x)
        return size, np.zeros_like(size), np.zeros_like(size)


def test_a_force_that_comes_and_goes_is_unnamed_and_no_fault_of_the_instrument():
    campaign, baseline = struck_campaign((Flutter(), {"a": 0.5}), noise=5e-4)
    verdict = explain(campaign, baseline)
    assert [effect.id for effect in verdict.effects] == ["unnamed"]
    assert verdict.location.phase == "flight"
    assert verdict.location.channel in ("horizontal", "along_velocity")


def test_splines_add_up_to_a_constant_inside_their_range():
    field = Field(coordinate=Coordinate.TIME, low=0.0, high=2.0)
    values = {p.name: 1.0 for p in field.parameters}

    class Flying:
        time = np.linspace(0.5, 1.5, 11)
        x = np.zeros(11)
        y = np.zeros(11)
        speed = np.ones(11)

    size, _, _ = field.force(values, Flying())
    assert len(field.parameters) == KNOTS
    assert np.ptp(size) < 1e-12


def test_the_freedom_of_a_curve_is_paid_for_where_nothing_is_missing():
    known = prepare(*struck_campaign(seed=4))
    pool = [
        c for c in candidates_for(known.forward, known.model, []) if isinstance(c.effect, Field)
    ]
    scored = scan(known.forward, known.fit, pool).with_likely_widths()
    assert len(pool) == 8
    assert all(
        scored.gain(k)[0] - c.complexity_penalty < 5.0 for k, c in enumerate(scored.candidates)
    )
