"""Forces of no known form are found as a curve and called unnamed."""

from dataclasses import dataclass

import numpy as np
import pytest

from mismatch import explain
from mismatch.candidates import candidates_for
from mismatch.fitting.hypotheses import fit_hypothesis
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import scan
from mismatch.search.unnamed import (
    KNOTS,
    Drift,
    Field,
    ReadingCurve,
    SmoothCurve,
    TorqueField,
)
from mismatch.verdict import _like_its_weight
from physics.effects import Coordinate, Effect, FlightState, Parameter
from physics.effects.impact import change_restitution
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


def test_an_intermittent_force_is_unnamed_and_no_instrument_error():
    campaign, baseline = struck_campaign((Flutter(), {"a": 0.5}), trials=5, noise=5e-4)
    verdict = explain(campaign, baseline)
    assert [effect.id for effect in verdict.effects] == ["unnamed"]
    assert verdict.location.phase == "flight"
    assert verdict.location.channel in ("horizontal", "along_velocity")


def test_splines_sum_to_a_constant_inside_their_range():
    field = Field(coordinate=Coordinate.TIME, low=0.0, high=2.0)
    values = {p.name: 1.0 for p in field.parameters}

    still, now = np.zeros(11), np.linspace(0.5, 1.5, 11)
    flying = FlightState(now, *[still] * 6, 0.1, 0.1, 1.2, 2e-5, 9.8)
    size, _, _ = field.force(values, flying)
    assert len(field.parameters) == KNOTS
    assert np.ptp(size) < 1e-12


def test_a_curve_is_not_named_when_nothing_is_missing():
    known = prepare(*struck_campaign(seed=4))
    pool = [
        c
        for c in candidates_for(known.forward, known.model, [])
        if isinstance(c.effect, SmoothCurve)
    ]
    scored = scan(known.forward, known.fit, pool).with_likely_widths()
    assert len(pool) == 24
    assert all(
        scored.gain(k)[0] - c.complexity_penalty < 5.0 for k, c in enumerate(scored.candidates)
    )


def test_an_error_of_reading_is_no_torque_of_the_pendulums_weight():
    known = prepare(*struck_campaign(seed=4, trials=3))
    pool = candidates_for(known.forward, known.model, [])
    reading = next(c for c in pool if isinstance(c.effect, ReadingCurve))
    strengths = np.full(len(reading.effect.strengths), 1e-3)
    read = fit_hypothesis(known.forward, known.fit, [reading], [strengths], rounds=1)
    assert not _like_its_weight(known.forward, read)


@dataclass(frozen=True)
class Settling(Effect):
    """A restitution that falls over the first trials and then is constant."""

    id: str = "settling"
    statement: str = "made for this test"
    law: str = r"e = e_0 + a e^{-5 i}"
    source: str = "made for this test"
    phase: str = "contact"
    parameters: tuple[Parameter, ...] = (Parameter("a", "1", 0.02, -1.0, 1.0),)

    def contact(self, values, contact, outcome):
        later = np.exp(-5.0 * (np.asarray(contact.order) + 0.5))
        return change_restitution(contact, outcome, values["a"] * later)


@dataclass(frozen=True)
class Catch(Effect):
    """A torque that pulls to an angle from both sides."""

    id: str = "catch"
    statement: str = "made for this test"
    law: str = r"\tau = -a \sin 6 \varphi"
    source: str = "made for this test"
    phase: str = "swing"
    parameters: tuple[Parameter, ...] = (Parameter("a", "N m", 0.1, -9.0, 9.0),)

    def torque(self, values, swing):
        return -values["a"] * np.sin(6.0 * np.asarray(swing.phi))


@pytest.mark.parametrize(
    ("made", "strength", "kind", "trials"),
    [(Settling(), {"a": 0.06}, Drift, 12), (Catch(), {"a": 1.5}, TorqueField, 4)],
)
def test_a_drift_over_trials_or_a_torque_is_found_as_a_curve(made, strength, kind, trials):
    known = prepare(*struck_campaign((made, strength), trials=trials, noise=5e-4))
    pool = [c for c in candidates_for(known.forward, known.model, []) if isinstance(c.effect, kind)]
    scored = scan(known.forward, known.fit, pool).with_likely_widths()
    gains = [scored.gain(k)[0] - c.complexity_penalty for k, c in enumerate(scored.candidates)]
    best = int(np.argmax(gains))
    assert gains[best] > 12.0
    curve = scored.candidates[best].effect
    values = dict(zip((p.name for p in curve.parameters), scored.gain(best)[1], strict=True))
    if kind is Drift:
        seen = curve.size(values, np.array([-0.5, 0.5]))
        # Per-trial parameters absorb a fraction of the drift.
        assert 0.02 < seen[0] - seen[1] < 0.09
        assert "in the first trial" in curve.in_words(values)
    else:
        assert curve.coordinate is Coordinate.ANGLE
        assert np.diff(curve.size(values, np.array([-0.2, 0.0])))[0] < 0.0
