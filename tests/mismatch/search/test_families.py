"""A law in several forms has one name and the evidence of all forms."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mismatch.search.naming import Naming
from physics.effects import CATALOGUE, Contact, Level, Outcome, SwingState

CONTACT = Contact(6.0, 0.15, 0.55, 1.6, 0.35, 0.2, 0.72, 9.81)
OUTCOME = Outcome(0.015, 2.9, 0.2, 0.04, 0.42, 0.0, 5.2, 0.8, 0.0)


def fitted(ids, gain, form=""):
    """The attributes of a fit that the evidence uses."""
    members = tuple(
        SimpleNamespace(id=one, effect=SimpleNamespace(form=form, level=Level.CAMPAIGN))
        for one in ids
    )
    return SimpleNamespace(
        ids=ids, members=members, penalised_gain=gain, quality=gain, allowed=True, reduced_chi2=1.0,
        has_unnamed="unnamed" in ids, fit=SimpleNamespace(inside_bounds=True),
    )  # fmt: skip


def scanned(*forms):
    return SimpleNamespace(
        candidates=[
            SimpleNamespace(id=one, effect=SimpleNamespace(form=form, level=Level.CAMPAIGN))
            for one, form in forms
        ]
    )


def test_evidence_is_averaged_over_the_forms_of_a_law():
    alike = [fitted(("lift",), 50.0, form) for form in ("a", "b", "c")]
    other = fitted(("wind",), 50.0)
    scan = scanned(("lift", "a"), ("lift", "b"), ("lift", "c"), ("wind", ""))
    naming = Naming(alike[0], (*alike, other), 12.0, scan)
    # Three equally good forms have the evidence of one law with one form.
    assert naming.families[("lift",)].penalised_gain == pytest.approx(50.0)
    assert naming.families[("wind",)].penalised_gain == pytest.approx(50.0)
    # One good form of three has the cost of having been selected.
    lone = (alike[0], fitted(("lift",), 10.0, "b"), fitted(("lift",), 10.0, "c"), other)
    naming = Naming(alike[0], lone, 12.0, scan)
    assert naming.families[("lift",)].penalised_gain == pytest.approx(50.0 - 2.2 * np.log(3.0))


def test_unnamed_laws_are_not_forms_of_one_another():
    """Worse unnamed curves do not reduce the evidence of the best unnamed law."""
    power, *curves = (fitted(("unnamed",), gain, str(gain)) for gain in (50.0, 40.0, 30.0, 20.0))
    wind = fitted(("wind",), 54.0)
    scan = scanned(("wind", ""), *(("unnamed", str(k)) for k in range(4)))
    alone = Naming(wind, (wind, power), 12.0, scan)
    beside = Naming(wind, (wind, power, *curves), 12.0, scan)
    assert alone.families[("unnamed",)].penalised_gain == pytest.approx(50.0)
    assert beside.families[("unnamed",)].penalised_gain == pytest.approx(50.0, abs=0.05)
    alike = Naming(wind, (wind, power, power), 12.0, scan)
    assert alike.families[("unnamed",)].penalised_gain == pytest.approx(50.0 + 2.2 * np.log(2.0))


@pytest.mark.parametrize(
    ("gain", "beside", "first"),
    [
        (50.0, (), "lens"),
        (56.0, (), "unnamed"),
        (53.0, (52.9,), "unnamed"),
        (56.0, ("wind",), "lens"),
    ],
)
def test_a_name_comes_first_unless_an_unnamed_law_is_more_probable(gain, beside, first):
    """An unnamed law 8.6 units ahead comes before a name despite its lower prior."""
    further = tuple(one for one in beside if isinstance(one, str))
    lens = fitted(("lens", *further), 54.0)
    nameless = [fitted(("unnamed", *further), one) for one in (gain, *beside) if one not in further]
    scan = scanned(("lens", ""), ("wind", ""), ("unnamed", "a"), ("unnamed", "b"))
    found = Naming(lens, (lens, *nameless), 12.0, scan).with_likeliest()
    assert found.best.ids[0] == first


def test_a_lower_ball_is_hit_later_and_pushed_down():
    form = next(e for e in CATALOGUE["effective_mass"] if e.form == "geometry")
    lever = next(e for e in CATALOGUE["effective_mass"] if e.form == "arm")
    after = form.contact({"arm_error": 0.01}, CONTACT, OUTCOME)
    alone = lever.contact({"arm_error": 0.01}, CONTACT, OUTCOME)
    # The triangle of pivot, face and ball with a fixed horizontal side.
    length, radius, angle = 0.55, 0.1, 0.15
    across = length * np.sin(angle) + radius * np.cos(angle)
    met = next(
        phi
        for phi in np.linspace(angle + 0.02, angle - 0.02, 400001)
        if 1.01 * length * np.sin(phi) + radius * np.cos(phi) <= across
    )
    turned = met - angle
    assert after.pendulum_angle - alone.pendulum_angle - turned == pytest.approx(0.0, abs=2e-5)
    assert np.arctan2(after.vy, after.vx) < np.arctan2(OUTCOME.vy, OUTCOME.vx)
    # With a vertical face only the lever arm changes.
    upright = replace(CONTACT, angle=0.0)
    both = [one.contact({"arm_error": 0.01}, upright, OUTCOME) for one in (form, lever)]
    assert vars(both[0]) == pytest.approx(vars(both[1]))


def test_friction_ends_where_the_support_ends():
    form = next(e for e in CATALOGUE["support_friction"] if e.form == "over a way")
    lost = [
        OUTCOME.vx - form.contact({"friction_coefficient": 0.5, "way": way}, CONTACT, OUTCOME).vx
        for way in (0.001, 0.01, 0.02, 0.04, 0.08)
    ]
    assert np.all(np.diff(lost[:4]) > 0.0)
    assert lost[3] == pytest.approx(lost[4])
    # Half of the distance under a half-sine force takes u = 0.7: u - sin(pi u)/pi = 1/2.
    assert lost[2] / lost[3] == pytest.approx(0.734, abs=0.01)


def test_a_loaded_bearing_has_more_friction_at_high_speed():
    forms = {e.form: e for e in CATALOGUE["bearing_friction"]}
    fast = SwingState(0.0, 5.0, 1.6, 6.0, 0.45, 0.55, 9.81)
    slow = replace(fast, omega=0.3)
    plain, loaded, stribeck = (
        [abs(float(forms[name].torque({"dry_torque": 0.1}, s))) for s in (slow, fast)]
        for name in ("constant torque", "under load", "Stribeck")
    )
    assert plain == pytest.approx([0.1, 0.1])
    assert loaded == pytest.approx([0.1 * (1 + 0.09 * 0.45 / 9.81), 0.1 * (1 + 25 * 0.45 / 9.81)])
    assert stribeck == pytest.approx([0.1 * (1 + 0.5 * np.exp(-0.36)), 0.1])
