"""Contact with a tilted face: conserved quantities."""

import numpy as np
import pytest

from physics.effects import CATALOGUE, Contact, Form, Outcome

LENGTH, INERTIA, MASS, RADIUS, PACE, ANGLE = 0.55, 1.6, 0.35, 0.1, 3.0, 0.15
SHELL_INERTIA = 2.0 / 3.0 * MASS * RADIUS**2
TURNS = [-0.2, -0.05, 0.1, 0.25]


def blow(restitution):
    """A straight blow without weight or way: pendulum's point and ball along one line."""
    contact = Contact(PACE / LENGTH, ANGLE, LENGTH, INERTIA, MASS, 2.0 * RADIUS, restitution, 0.0)
    heavy = INERTIA / LENGTH**2
    ball = (1.0 + restitution) * PACE * heavy / (heavy + MASS)
    x, y = ball * np.cos(ANGLE), ball * np.sin(ANGLE)
    after = PACE - MASS / heavy * ball
    return contact, Outcome(0.0, after, ANGLE, 0.0, 0.4, 0.0, x, y, 0.0)


def form_of(name):
    return next(one for one in CATALOGUE["oblique_impact"] if one.form == name)


def values_of(effect, turn, spin=0.0):
    given = {"turn": turn, "offset": -RADIUS * np.sin(turn), "spin_share": spin}
    return {p.name: given[p.name] for p in effect.parameters}


def centre(form, turn, met_at):
    """Ball's centre from the pivot, (2,) m, as the face meets it."""
    way = ANGLE + turn if form != Form.TURNED_ON_ARM else ANGLE
    anchor = LENGTH * np.array([np.sin(met_at), -np.cos(met_at)])
    return anchor + RADIUS * np.array([np.cos(way), np.sin(way)])


FACES = [Form.SMOOTH_FACE, Form.RUBBING_FACE, Form.TURNED_FACE, Form.TURNED_ON_ARM]


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("form", FACES)
def test_a_perfect_face_without_friction_loses_no_energy(form, turn):
    effect = form_of(form)
    after = effect.contact(values_of(effect, turn), *blow(1.0))
    ball = 0.5 * MASS * (after.vx**2 + after.vy**2)
    pendulum = 0.5 * INERTIA * (after.pendulum_speed / LENGTH) ** 2
    assert ball + pendulum == pytest.approx(0.5 * INERTIA * (PACE / LENGTH) ** 2, rel=1e-6)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(("form", "spin"), [(FACES[0], 0.0), *((one, 0.15) for one in FACES[1:])])
def test_angular_momentum_about_the_pivot_is_conserved(form, spin, turn):
    effect = form_of(form)
    after = effect.contact(values_of(effect, turn, spin), *blow(0.7))
    place = centre(form, turn, after.pendulum_angle)
    ball = MASS * (place[0] * after.vy - place[1] * after.vx)
    own = SHELL_INERTIA * spin * PACE / RADIUS
    pendulum = INERTIA * after.pendulum_speed / LENGTH
    # The face that meets the ball sooner does so at another angle, second order in the turn.
    assert ball + own + pendulum == pytest.approx(INERTIA * PACE / LENGTH, rel=1e-3)


def test_one_face_rotation_deflects_large_and_small_balls_alike():
    contact, before = blow(0.7)
    wide = Contact(**(vars(contact) | {"diameter": 2.0 * contact.diameter}))
    ways = {}
    for form in (Form.SMOOTH_FACE, Form.TURNED_FACE):
        effect = form_of(form)
        pushed = [effect.contact(values_of(effect, 0.2), one, before) for one in (contact, wide)]
        ways[form] = [float(np.arctan2(one.vy, one.vx)) for one in pushed]
    assert ways[Form.TURNED_FACE] == pytest.approx([ANGLE + 0.2] * 2)
    assert ways[Form.SMOOTH_FACE][0] == pytest.approx(ANGLE + 0.2)
    assert ways[Form.SMOOTH_FACE][1] < ANGLE + 0.12


def test_a_rotated_face_makes_contact_earlier():
    effect = form_of(Form.TURNED_ON_ARM)
    contact, before = blow(0.7)
    after = effect.contact(values_of(effect, 0.2), contact, before)
    # By geometry: the distance of the ball's centre from the turned face falls to the radius.
    rest = LENGTH * np.array([np.sin(ANGLE), -np.cos(ANGLE)])
    rest = rest + RADIUS * np.array([np.cos(ANGLE), np.sin(ANGLE)])
    angles = np.linspace(ANGLE - 0.02, ANGLE, 200001)
    anchors = LENGTH * np.stack([np.sin(angles), -np.cos(angles)], axis=1)
    normals = np.stack([np.cos(angles + 0.2), np.sin(angles + 0.2)], axis=1)
    apart = ((rest - anchors) * normals).sum(axis=1)
    met = angles[np.argmax(apart <= RADIUS)]
    assert after.pendulum_angle - ANGLE == pytest.approx(met - ANGLE, rel=0.02)
    assert after.contact_time == pytest.approx((met - ANGLE) / contact.omega, rel=0.02)
