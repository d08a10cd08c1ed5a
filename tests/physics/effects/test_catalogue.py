"""Effects of the catalogue: documentation, neutral values, hand-computed cases."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from metrology import UsageError
from physics.effects import (
    CATALOGUE,
    CameraView,
    Contact,
    Effect,
    FlightState,
    Outcome,
    SwingState,
    effect_named,
)
from physics.effects.base import Form

CONTRACT = [
    "drag",
    "drag_crisis",
    "density_lapse",
    "magnus",
    "spin_decay",
    "wind",
    "buoyancy",
    "asymmetric_wake",
    "velocity_dependent_cor",
    "effective_mass",
    "oblique_impact",
    "support_friction",
    "contact_displacement",
    "pivot_recoil",
    "support_recoil",
    "bearing_friction",
    "viscous_damping",
    "pendulum_drag",
    "backswing_offset",
    "time_base",
    "length_scale",
    "camera_roll",
    "parallax",
    "lens_distortion",
    "rolling_shutter",
    "origin_offset",
    "dropped_frames",
]
ALL = [effect for forms in CATALOGUE.values() for effect in forms]

FLIGHT = FlightState(0.1, 0.5, 0.4, 0.0, 3.0, 4.0, 0.0, 0.35, 0.2, 1.2, 1.8e-5, 9.81, 0.5, 10.0)
SWING = SwingState(0.3, 4.0, 1.6, 6.0, 0.45, 0.55, 9.81)
CONTACT = Contact(6.0, 0.15, 0.55, 1.6, 0.35, 0.2, 0.72, 9.81)
OUTCOME = Outcome(0.015, 2.9, 0.2, 0.04, 0.42, 0.0, 5.2, 0.8, 0.0)
VIEW = CameraView(0.1, 0.5, 0.3, 0.0, 3.0, -1.0, 0.0, 0.2, 4.0, 0.0, 0.41, 1.0, 0.3, 1.0)


def test_every_documented_id_exists():
    assert set(CONTRACT) == set(CATALOGUE)


@pytest.mark.parametrize("effect", ALL, ids=lambda e: f"{e.id}-{e.form}")
def test_an_effect_is_documented_and_bounded(effect: Effect):
    assert effect.statement.endswith(".")
    assert effect.law
    assert effect.source
    assert effect.separating
    assert effect.hooks
    for p in effect.parameters:
        assert p.lower < p.upper
        assert p.scale > 0.0
        assert p.lower <= p.neutral <= p.upper or p.is_shape


@pytest.mark.parametrize("effect", ALL, ids=lambda e: f"{e.id}-{e.form}")
def test_a_neutral_effect_changes_nothing(effect: Effect):
    values = effect.neutral
    if "force" in effect.hooks:
        assert np.allclose(effect.force(values, FLIGHT), 0.0)
    if "torque" in effect.hooks:
        assert effect.torque(values, SWING) == pytest.approx(0.0)
    if "start" in effect.hooks:
        assert effect.start(values, 1.0) == 1.0
    if "contact" in effect.hooks:
        after = effect.contact(values, CONTACT, OUTCOME)
        assert vars(after) == pytest.approx(vars(OUTCOME))
    if "clock" in effect.hooks:
        assert effect.clock(values, 0.2) == pytest.approx(0.2)
    if "image" in effect.hooks:
        assert effect.image(values, VIEW) == pytest.approx((0.5, 0.3, 0.0))
    if "angle" in effect.hooks:
        assert effect.angle(values, VIEW) == pytest.approx(0.2)


def test_drag_by_hand():
    fx, fy, fz = effect_named("drag").force({"drag_coefficient": 0.5}, FLIGHT)
    size = 0.5 * 1.2 * 0.5 * np.pi * 0.01 * 25.0
    assert (fx, fy, fz) == pytest.approx((-0.6 * size, -0.8 * size, 0.0))


def test_back_spin_lifts_and_does_no_work():
    fx, fy, _ = effect_named("magnus").force({"spin": 10.0}, FLIGHT)
    assert fx * 3.0 + fy * 4.0 == pytest.approx(0.0)
    assert fy > 0.0


def test_buoyancy_is_the_weight_of_the_air():
    _, fy, _ = effect_named("buoyancy").force({"fraction": 1.0}, FLIGHT)
    assert fy == pytest.approx(1.2 * np.pi / 6.0 * 0.008 * 9.81)


def test_wind_as_fast_as_the_ball_gives_the_drag_of_the_other_components():
    flight = FlightState(0.0, 0.0, 1.0, 0.0, 3.0, 0.0, 0.0, 0.35, 0.2, 1.2, 1.8e-5, 9.81, 0.5)
    drag = effect_named("drag").force({"drag_coefficient": 0.5}, flight)[0]
    wind = effect_named("wind").force({"wind_x": 3.0}, flight)[0]
    assert drag + wind == pytest.approx(0.0)


def test_wind_with_the_velocity_of_the_ball_gives_no_drag():
    flight = FlightState(0.0, 0.0, 1.0, 0.0, 3.0, -1.0, 2.0, 0.35, 0.2, 1.2, 1.8e-5, 9.81, 0.5)
    drag = effect_named("drag").force({"drag_coefficient": 0.5}, flight)
    (law,) = [one for one in CATALOGUE["wind"] if one.form == Form.FROM_ANYWHERE]
    wind = law.force({"wind_x": 3.0, "wind_y": -1.0, "wind_z": 2.0}, flight)
    assert np.add(drag, wind) == pytest.approx(0.0)


def _flying(height=1.0, speed=3.0, drag=0.5, diameter=0.2):
    return FlightState(
        0.0, 0.0, height, 0.0, speed, 0.0, 0.0, 0.35, diameter, 1.2, 1.8e-5, 9.81, drag
    )


def test_the_wind_decreases_towards_the_floor():
    """By the seventh root: at a 128th of a metre half as fast, on the floor not at all."""
    uniform, held, *_ = CATALOGUE["wind"]
    at_one_metre = held.force({"wind_x": 2.0}, _flying(1.0))[0]
    assert at_one_metre == pytest.approx(uniform.force({"wind_x": 2.0}, _flying(1.0))[0])
    low = held.force({"wind_x": 2.0}, _flying(1.0 / 128.0))[0]
    assert low == pytest.approx(uniform.force({"wind_x": 1.0}, _flying())[0])
    assert held.force({"wind_x": 2.0}, _flying(0.0))[0] == pytest.approx(0.0)


def test_drag_with_a_boundary_layer_is_that_of_spheres():
    """Clift, Grace and Weber's table: 1.09 at a Reynolds number of 100, 0.47 at 1000."""
    constant, layer = CATALOGUE["drag"]
    values = {"drag_coefficient": 0.4, "layer": 9.06}

    def coefficient(reynolds):
        slow = _flying(speed=reynolds * 1.8e-5 / (1.2 * 0.2))
        push = layer.force(values, slow)[0]
        return 0.4 * push / constant.force({"drag_coefficient": 0.4}, slow)[0]

    assert coefficient(4e4) == pytest.approx(0.4)
    assert coefficient(100.0) / coefficient(1000.0) == pytest.approx(1.09 / 0.47, rel=0.06)


def test_higher_restitution_conserves_momentum():
    after = effect_named("velocity_dependent_cor").contact({"slope": 0.02}, CONTACT, OUTCOME)
    normal = 0.5 * (CONTACT.angle + OUTCOME.pendulum_angle)
    ball = 0.35 * ((after.vx - 5.2) * np.cos(normal) + (after.vy - 0.8) * np.sin(normal))
    pendulum = CONTACT.inertial_mass * (after.pendulum_speed - 2.9)
    assert ball + pendulum == pytest.approx(0.0, abs=1e-12)
    assert ball > 0.0


def test_friction_changes_both_momenta_but_not_the_separation_speed():
    friction = effect_named("support_friction")
    after = friction.contact({"friction_coefficient": 0.5}, CONTACT, OUTCOME)
    ball, pendulum = after.vx - OUTCOME.vx, after.pendulum_speed - OUTCOME.pendulum_speed
    normal = np.cos(0.5 * (CONTACT.angle + OUTCOME.pendulum_angle))
    taken = 0.5 * 0.35 * 9.81 * OUTCOME.contact_time
    assert 0.35 * ball / normal + CONTACT.inertial_mass * pendulum == pytest.approx(-taken)
    assert ball / normal == pytest.approx(pendulum)
    assert after.contact_time > OUTCOME.contact_time


def test_a_rotation_about_a_point_keeps_that_point():
    turn = next(e for e in CATALOGUE["camera_roll"] if e.form == "about a point")
    roll, (px, py) = 0.1, (0.5, 0.3)
    shift = {
        "shift_x": px - px * np.cos(roll) + py * np.sin(roll),
        "shift_y": py - px * np.sin(roll) - py * np.cos(roll),
    }
    assert turn.image({"roll": roll, **shift}, VIEW)[:2] == pytest.approx((px, py))


def test_a_stretch_about_a_point_keeps_that_point():
    """A zoom about the middle of the picture was parallax alone, and in no group with the scale."""
    stretch = next(e for e in CATALOGUE["length_scale"] if e.form == "about a point")
    shift = {"shift_x": -0.1 * VIEW.x, "shift_y": -0.1 * VIEW.y}
    seen = stretch.image({"scale_error": 0.1, **shift}, VIEW)
    assert seen[:2] == pytest.approx((VIEW.x, VIEW.y))


def test_a_faster_camera_has_seen_less_time():
    assert effect_named("time_base").clock({"rate_error": 0.25}, 1.0) == pytest.approx(0.8)


def test_a_rotated_camera_keeps_distances():
    x, y, _ = effect_named("camera_roll").image({"roll": 0.1}, VIEW)
    assert np.hypot(x, y) == pytest.approx(np.hypot(0.5, 0.3))


def test_a_wrong_name_is_refused():
    with pytest.raises(UsageError, match="magnuss"):
        effect_named("magnuss")


def _of_form(name: str, form: Form) -> Effect:
    (found,) = (one for one in CATALOGUE[name] if one.form == form)
    return found


@pytest.mark.parametrize(
    ("over_critical", "left"), [(0.4, 0.0), (2.0, 1.0 - 0.25 * 0.30103), (10.0, 0.75)]
)
def test_a_lower_drag_coefficient_needs_a_higher_reynolds_number(over_critical, left):
    crisis = _of_form("drag_crisis", Form.RECOVERING)
    critical = float(FLIGHT.reynolds) / over_critical
    values = {"coefficient_drop": 0.3, "critical_reynolds": critical, "recovery": 0.25}
    fx, fy, _ = crisis.force(values, FLIGHT)
    size = 0.5 * 1.2 * 0.3 * np.pi * 0.01 * 25.0
    assert (fx, fy) == pytest.approx((0.6 * left * size, 0.8 * left * size), rel=1e-3, abs=1e-3)


def test_a_spin_braked_with_its_square_is_the_solution_of_that_law():
    decay = _of_form("spin_decay", Form.BY_THE_SQUARE)
    rate, start = 2.0, 10.0
    spin = solve_ivp(lambda _, w: -rate * w * w / start, (0.0, 0.4), [start], rtol=1e-9).y[0, -1]
    flight = replace(FLIGHT, time=0.4, spin=start)
    lost = np.array(decay.force({"decay_rate": rate}, flight))
    before, after = (
        np.array(effect_named("magnus").force({"spin": w}, flight)) for w in (start, spin)
    )
    assert lost == pytest.approx(after - before, rel=1e-6)


@pytest.mark.parametrize("rate", [-8.0, 8.0])
def test_fractional_powers_of_the_rate_dissipate(rate):
    swing = replace(SWING, omega=rate)
    sticky = _of_form("viscous_damping", Form.TWO_THIRDS)
    thin = _of_form("pendulum_drag", Form.THREE_HALVES)
    against = -np.sign(rate)
    assert sticky.torque({"viscous_coefficient": 0.5}, swing) == pytest.approx(against * 2.0)
    assert thin.torque({"drag_torque": 0.5}, swing) == pytest.approx(against * 0.5 * 8.0**1.5)
