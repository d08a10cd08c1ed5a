"""Laws in another form still get their one name."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from mismatch import explain
from mismatch.candidates import Candidate
from mismatch.fitting.fit import fit_model, free_parameters
from mismatch.fitting.hypotheses import _sizes, form_evidence, left_by_forms
from mismatch.fitting.prepare import prepare
from physics.effects import CATALOGUE, Contact, Effect, Outcome, Parameter
from tests.mismatch.synthetic import struck_campaign


@dataclass(frozen=True)
class Kick(Effect):
    """A support with an impulse proportional to the root of the impact speed."""

    id: str = "kick"
    statement: str = "made for this test"
    law: str = r"\Delta v_y = a \sqrt{u}"
    source: str = "made for this test"
    phase: str = "contact"
    parameters: tuple[Parameter, ...] = (Parameter("a", "1", 0.02, -1.0, 1.0),)

    def contact(self, values, contact, outcome):
        gained = values["a"] * np.sqrt(contact.impact_speed)
        lifted = outcome.y + 0.2 * gained * outcome.contact_time
        return replace(outcome, vy=outcome.vy + gained, y=lifted)


@dataclass(frozen=True)
class Saturating(Effect):
    """Lift whose coefficient saturates with the spin ratio."""

    id: str = "saturating"
    statement: str = "made for this test"
    law: str = r"C_L = S / (2 S + 0.4)"
    source: str = "Sawicki, Hubbard and Stronge, Am. J. Phys. 71, 1152 (2003)"
    phase: str = "flight"
    parameters: tuple[Parameter, ...] = (Parameter("spin", "rad/s", 10.0, 0.0, 400.0),)

    def force(self, values, flight):
        ratio = 0.5 * flight.diameter * values["spin"] / flight.speed
        k = flight.dynamic_area * flight.speed * ratio / (2.0 * ratio + 0.4)
        return -k * flight.vy, k * flight.vx, np.zeros_like(k)


@dataclass(frozen=True)
class Steeper(Effect):
    """Lift that grows with the square of the speed."""

    id: str = "steeper"
    statement: str = "made for this test"
    law: str = r"C_L = a"
    source: str = "made for this test"
    phase: str = "flight"
    parameters: tuple[Parameter, ...] = (Parameter("a", "1", 0.1, -1.0, 1.0),)

    def force(self, values, flight):
        k = values["a"] * flight.dynamic_area * flight.speed
        return -k * flight.vy, k * flight.vx, np.zeros_like(k)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("made", "strength", "name"),
    [(Kick(), {"a": 0.12}, "support_recoil"), (Saturating(), {"spin": 14.0}, "magnus")],
)
def test_another_form_of_a_law_gets_its_name_and_no_second_one(made, strength, name):
    campaign, baseline = struck_campaign((made, strength), noise=5e-4)
    verdict = explain(campaign, baseline)
    assert len(verdict.effects) == 1
    (named,) = verdict.effects
    groups = [group for group in verdict.indistinguishable if named.id in group]
    assert name == named.id or any(name in group for group in groups)


def fitted_with(effect, strength, noise=5e-4):
    campaign, baseline = struck_campaign(strength, noise=noise)
    known = prepare(campaign, baseline)
    model = known.fit.model.having(effect, dict(effect.neutral)).order()
    free = free_parameters(model, [effect])
    start = (known.fit.nuisance, known.fit.law_offsets)
    return known.forward, fit_model(known.forward, model, free, start)


def test_a_law_in_its_exact_form_gains_nothing_from_model_discrepancy():
    magnus = CATALOGUE["magnus"][0]
    forward, fit = fitted_with(magnus, (magnus, {"spin": 14.0}))
    found = form_evidence(forward, fit, [magnus])
    assert found.gain < 3.0
    assert found.absorbed < 15.0


def test_the_misfit_of_another_form_is_absorbed_by_model_discrepancy():
    magnus = CATALOGUE["magnus"][0]
    forward, fit = fitted_with(magnus, (Saturating(), {"spin": 14.0}), noise=2e-4)
    over = fit.chi2 - fit.expected
    found = form_evidence(forward, fit, [magnus])
    assert over > 100.0
    assert found.size > 0.0
    assert found.absorbed > 0.7 * over


def test_an_exact_law_has_no_model_discrepancy():
    exact = replace(CATALOGUE["magnus"][0], looseness=0.0)
    forward, fit = fitted_with(exact, (Saturating(), {"spin": 14.0}), noise=2e-4)
    assert form_evidence(forward, fit, [exact]).gain == 0.0


def test_support_recoil_does_not_explain_a_slower_pendulum():
    """The impulse on the ball and on the pendulum are equal and opposite."""
    contact = Contact(6.0, 0.15, 0.55, 1.6, 0.35, 0.2, 0.72, 9.81)
    before = Outcome(0.015, 2.9, 0.2, 0.04, 0.42, 0.0, 5.2, 0.8, 0.0)
    kicked = replace(before, vy=before.vy + 0.3)
    sizes = _sizes(contact, before, kicked)
    assert sizes["vx"] == sizes["vy"] == pytest.approx(0.3)
    assert contact.inertial_mass * sizes["pendulum_speed"] == pytest.approx(0.35 * 0.3)
    assert sizes["pendulum_angle"] < sizes["x"] / contact.length
    # An effect that slows both bodies has a common discrepancy in both.
    slowed = replace(before, vx=before.vx - 0.1, pendulum_speed=before.pendulum_speed - 0.1)
    assert _sizes(contact, before, slowed)["pendulum_speed"] == pytest.approx(0.1, rel=0.01)


def test_model_discrepancy_covers_other_forms_but_not_swings():
    magnus, friction = CATALOGUE["magnus"][0], CATALOGUE["bearing_friction"][0]
    forward, fit = fitted_with(magnus, (Steeper(), {"a": 0.3}), noise=2e-4)
    left = {
        law.id: left_by_forms(forward, fit, [magnus], Candidate(law))
        for law in (Steeper(), friction)
    }
    over = fit.chi2 - fit.expected
    assert over > 100.0
    assert 0.5 * over < left["steeper"] < 5.0 * over
    assert left["bearing_friction"] < 0.01 * left["steeper"]


def test_model_discrepancy_grows_with_the_square_of_the_strength():
    magnus = CATALOGUE["magnus"][0]
    left = []
    for spin in (7.0, 14.0):
        forward, fit = fitted_with(magnus, (magnus, {"spin": spin}), noise=2e-4)
        left.append(left_by_forms(forward, fit, [magnus], Candidate(Steeper())))
    assert left[1] / left[0] == pytest.approx(4.0, rel=0.3)


def test_without_model_discrepancy_the_misfit_is_unrestricted():
    exact = replace(CATALOGUE["magnus"][0], looseness=0.0)
    forward, fit = fitted_with(exact, (exact, {"spin": 14.0}))
    friction = Candidate(CATALOGUE["bearing_friction"][0])
    assert left_by_forms(forward, fit, [exact], friction) == np.inf
