"""A further law beside one whose form is loose: what has to be more than the form's error."""

from types import SimpleNamespace

import numpy as np
import pytest

from mismatch import explain
from mismatch.candidates import Candidate
from mismatch.explain import _groups
from mismatch.fitting.fit import Fit
from mismatch.fitting.hypotheses import EXACT, FormEvidence, Hypothesis
from mismatch.forward import Model
from mismatch.search.naming import _supported, _worth_a_fit
from physics.effects import Effect, effect_named
from tests.mismatch.synthetic import struck_campaign

STRIKES = SimpleNamespace(mode="impact")
CHANCE = 12.0


def answer(gain: float, *laws: Effect, form: FormEvidence = EXACT) -> Hypothesis:
    """Laws that take `gain` off a misfit of a tenth of 10,000 rows' noise, and more by `form`."""
    fit = Fit(
        Model(()), np.zeros((12, 4)), np.zeros((1, 2)), 10_400.0, 0.0, 10_000, 10_000.0, (),
        np.zeros((0, 0)), np.zeros((12, 900)),
    )  # fmt: skip
    return Hypothesis(tuple(Candidate(law, (), 1) for law in laws), fit, gain, form)


@pytest.mark.parametrize(
    ("further", "as_contact"),
    [
        ("parallax", False),
        ("magnus", False),
        ("pivot_recoil", True),
        ("support_recoil", True),
        ("origin_offset", True),
    ],
)
def test_a_contact_of_loose_form_doubts_a_further_law_of_the_contact_alone(further, as_contact):
    """Errors of what it hands over to the flight are integrated over, part by part.

    A shifted origin says no more than where the flight starts, and counts as the contact's.
    """
    arm, law = effect_named("effective_mass"), effect_named(further)
    alone, both = answer(4000.0, arm), answer(4130.0, arm, law)
    assert both.penalised_gain - alone.penalised_gain > CHANCE
    assert _supported(STRIKES, both, alone, CHANCE) is not as_contact
    pool = [Candidate(law, (), 1)]
    assert _worth_a_fit(STRIKES, alone, pool, [(130.0, 0, np.zeros(1))], CHANCE) is not as_contact
    # A gain of a quarter is beyond what a form is wrong by.
    assert _supported(STRIKES, answer(5000.0, arm, law), alone, CHANCE)


def test_a_further_law_of_any_phase_has_to_beat_chance():
    arm, law = effect_named("effective_mass"), effect_named("parallax")
    assert not _supported(STRIKES, answer(420.0, arm, law), answer(410.0, arm), CHANCE)
    pool = [Candidate(law, (), 1)]
    assert not _worth_a_fit(STRIKES, answer(410.0, arm), pool, [(10.0, 0, np.zeros(1))], CHANCE)


def test_laws_that_do_without_a_loose_one_have_only_chance_to_beat():
    """A steady side force and another COR were left at 61 units for a face that rubs."""
    face = answer(3400.0, effect_named("oblique_impact"))
    wake, restitution = effect_named("asymmetric_wake"), effect_named("velocity_dependent_cor")
    assert _supported(STRIKES, answer(3475.0, wake, restitution), face, CHANCE)
    beside = answer(3475.0, effect_named("oblique_impact"), restitution)
    assert not _supported(STRIKES, beside, face, CHANCE)


@pytest.mark.parametrize(("further", "told"), [(5580.0, True), (5235.0, False)])
def test_what_errors_of_form_have_taken_up_is_not_asked_for_twice(further, told):
    """Without its wind a wrong clock needs errors of form that are twice as large as is usual."""
    clock, wind = effect_named("time_base"), effect_named("wind")
    alone = answer(5210.0, clock, form=FormEvidence(further - 5235.0, 367.0, 2.0))
    both = answer(further, clock, wind)
    more = both.penalised_gain - alone.penalised_gain
    assert CHANCE < more < 0.008 * alone.gain
    assert _supported(STRIKES, both, alone, CHANCE) is told


def test_of_two_names_each_takes_the_place_of_its_kind():
    """Friction was grouped with a shifted origin, and a turned camera with friction."""
    best = answer(200.0, effect_named("viscous_damping"), effect_named("camera_roll"))
    both = answer(199.0, effect_named("origin_offset"), effect_named("bearing_friction"))
    one = answer(198.0, effect_named("viscous_damping"), effect_named("origin_offset"))
    told = (("viscous_damping", "bearing_friction"), ("camera_roll", "origin_offset"))
    assert _groups(best, [both]) == told
    assert _groups(best, [both, one]) == told


@pytest.mark.slow
def test_friction_beside_a_turned_camera_is_told_however_much_the_camera_is_turned():
    """It gains less than a hundredth of what the camera does, and nothing that a camera can do."""
    turned = (effect_named("camera_roll"), {"roll": 0.02})
    slowed = (effect_named("viscous_damping"), {"viscous_coefficient": 0.06})
    verdict = explain(*struck_campaign(turned, slowed))
    told = {effect.id for effect in verdict.effects}
    alike = {one for group in verdict.indistinguishable for one in group}
    assert len(told) == 2
    assert "camera_roll" in told
    assert "viscous_damping" in told | alike
