"""A further law beyond the model discrepancy of the first one."""

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
    """Laws that reduce a misfit of 10 % of the noise of 10,000 rows by `gain`, more by `form`."""
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
def test_model_discrepancy_of_a_contact_law_limits_a_further_contact_law(further, as_contact):
    """Errors of the release state are marginalised component by component.

    A shifted origin only changes where the flight starts and counts as the contact's.
    """
    arm, law = effect_named("effective_mass"), effect_named(further)
    alone, both = answer(4000.0, arm), answer(4130.0, arm, law)
    assert both.penalised_gain - alone.penalised_gain > CHANCE
    assert _supported(STRIKES, both, alone, CHANCE) is not as_contact
    pool = [Candidate(law, (), 1)]
    assert _worth_a_fit(STRIKES, alone, pool, [(130.0, 0, np.zeros(1))], CHANCE) is not as_contact
    # A gain of a quarter exceeds the model discrepancy.
    assert _supported(STRIKES, answer(5000.0, arm, law), alone, CHANCE)


def test_a_further_law_has_to_exceed_chance():
    arm, law = effect_named("effective_mass"), effect_named("parallax")
    assert not _supported(STRIKES, answer(420.0, arm, law), answer(410.0, arm), CHANCE)
    pool = [Candidate(law, (), 1)]
    assert not _worth_a_fit(STRIKES, answer(410.0, arm), pool, [(10.0, 0, np.zeros(1))], CHANCE)


def test_laws_without_model_discrepancy_have_to_exceed_chance_only():
    """A steady side force and another COR, 61 units ahead of a face with friction."""
    face = answer(3400.0, effect_named("oblique_impact"))
    wake, restitution = effect_named("asymmetric_wake"), effect_named("velocity_dependent_cor")
    assert _supported(STRIKES, answer(3475.0, wake, restitution), face, CHANCE)
    beside = answer(3475.0, effect_named("oblique_impact"), restitution)
    assert not _supported(STRIKES, beside, face, CHANCE)


@pytest.mark.parametrize(("further", "reported"), [(5580.0, True), (5235.0, False)])
def test_model_discrepancy_is_not_counted_twice(further, reported):
    """Without its wind, a wrong clock needs twice the usual model discrepancy."""
    clock, wind = effect_named("time_base"), effect_named("wind")
    alone = answer(5210.0, clock, form=FormEvidence(further - 5235.0, 367.0, 2.0))
    both = answer(further, clock, wind)
    more = both.penalised_gain - alone.penalised_gain
    assert CHANCE < more < 0.008 * alone.gain
    assert _supported(STRIKES, both, alone, CHANCE) is reported


def test_each_of_two_names_replaces_its_kind():
    """Friction and a shifted origin are different kinds, as are camera roll and friction."""
    best = answer(200.0, effect_named("viscous_damping"), effect_named("camera_roll"))
    both = answer(199.0, effect_named("origin_offset"), effect_named("bearing_friction"))
    one = answer(198.0, effect_named("viscous_damping"), effect_named("origin_offset"))
    reported = (("viscous_damping", "bearing_friction"), ("camera_roll", "origin_offset"))
    assert _groups(best, [both]) == reported
    assert _groups(best, [both, one]) == reported


@pytest.mark.slow
def test_friction_is_found_with_any_camera_roll():
    """Its gain is below a hundredth of the camera's, but the camera cannot mimic it."""
    turned = (effect_named("camera_roll"), {"roll": 0.02})
    slowed = (effect_named("viscous_damping"), {"viscous_coefficient": 0.06})
    verdict = explain(*struck_campaign(turned, slowed))
    reported = {effect.id for effect in verdict.effects}
    alike = {one for group in verdict.indistinguishable for one in group}
    assert len(reported) == 2
    assert "camera_roll" in reported
    assert "viscous_damping" in reported | alike
