"""The time-resolved contact: conservation laws and published values."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.special import beta

from metrology import DomainError
from physics.bodies import (
    BALLS,
    JOKKU,
    PAPER_PENDULUM,
    PAPER_SUPPORT,
    ContactTimeLaw,
    Pendulum,
    Support,
)
from physics.contact import (
    ContactOutcome,
    HuntCrossley,
    contact_outcomes,
    damping_for_cor,
    elastic_contact_time,
    simulate_contact,
)
from tests.shared_data import shared_folder

FIELDS = (
    "cor",
    "contact_time",
    "pendulum_speed_after",
    "pendulum_angle",
    "ball_x",
    "ball_y",
    "ball_vx",
    "ball_vy",
    "ball_spin",
)


@pytest.mark.parametrize("friction", [pytest.param(0.0, marks=pytest.mark.slow), 0.1])
@pytest.mark.parametrize("name", list(BALLS))
def test_adaptive_and_fixed_step_solvers_agree(name: str, friction: float) -> None:
    ball = BALLS[name]
    for speed in (0.5, 2.0, 4.5):
        one = simulate_contact(PAPER_PENDULUM, ball, PAPER_SUPPORT, speed, friction=friction)
        many = contact_outcomes(
            PAPER_PENDULUM, ball, PAPER_SUPPORT, np.array([speed]), friction=friction
        ).at(0)
        for field in FIELDS:
            near = 3e-4 if friction else 2e-5
            assert getattr(one.outcome, field) == pytest.approx(
                getattr(many, field), rel=near, abs=near
            ), field


def test_calibration_returns_the_law_and_the_time() -> None:
    speeds = np.array([0.3, 1.0, 2.5, 4.0, 7.0])
    for cor in (0.3, 0.6, 0.9, 1.0):
        out = contact_outcomes(
            PAPER_PENDULUM, JOKKU, PAPER_SUPPORT, speeds, cor=cor, contact_time=0.012
        )
        np.testing.assert_allclose(out.cor, cor, rtol=1e-6)
        np.testing.assert_allclose(out.contact_time, 0.012, rtol=1e-6)


def test_an_elastic_contact_conserves_energy() -> None:
    run = simulate_contact(
        PAPER_PENDULUM,
        JOKKU,
        PAPER_SUPPORT,
        3.0,
        law=HuntCrossley(60000.0, 0.0, 1.34),
        samples=401,
    )
    body, gravity = PAPER_PENDULUM, 9.806
    stored = 60000.0 * run.compression**2.34 / 2.34
    energy = (
        0.5 * body.inertia * run.omega**2
        - body.mass * gravity * body.com * np.cos(run.phi)
        + 0.5 * JOKKU.mass * (run.ball_vx**2 + run.ball_vy**2)
        + JOKKU.mass * gravity * run.ball_y
        + stored
    )
    np.testing.assert_allclose(energy, energy[0], atol=2e-6)


def test_the_force_is_the_balls_momentum() -> None:
    run = simulate_contact(PAPER_PENDULUM, JOKKU, PAPER_SUPPORT, 3.0, samples=4001)
    impulse_x = np.trapezoid(run.force * np.cos(run.phi), run.time)
    assert impulse_x == pytest.approx(JOKKU.mass * run.outcome.ball_vx, rel=1e-6)
    after = run.time >= run.lift_off
    up = np.trapezoid((run.force * np.sin(run.phi))[after], run.time[after])
    weight = JOKKU.mass * 9.806 * (run.time[-1] - run.lift_off)
    assert up - weight == pytest.approx(JOKKU.mass * run.outcome.ball_vy, rel=2e-3)
    # the balance of angular momentum about the pivot
    body = PAPER_PENDULUM
    pivot_x, pivot_y = (float(p) for p in run.scene.pivot)
    lever = (run.ball_x - pivot_x) * np.sin(run.phi) - (run.ball_y - pivot_y) * np.cos(run.phi)
    torque = -run.force * lever - body.mass * 9.806 * body.com * np.sin(run.phi)
    gained = body.inertia * (run.omega[-1] - run.omega[0])
    assert np.trapezoid(torque, run.time) == pytest.approx(gained, rel=1e-5)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.15, 0.999), st.floats(1.05, 1.9))
def test_head_on_the_damping_is_that_of_the_energy_balance(e: float, exponent: float) -> None:
    # a very long, heavy pendulum met at its lowest point, no gravity: one dimension
    law_time = ContactTimeLaw(0.01, 2.0, exponent)
    ball = replace(JOKKU, launch_angle=0.0, contact_time=law_time)
    body = Pendulum(length=1000.0, inertia=5.0e6, mass=5.0, com=1000.0)
    reduced = 5.0 * ball.mass / (5.0 + ball.mass)
    damping = float(damping_for_cor(e)) / 2.0
    law = HuntCrossley(3e4, damping, exponent)
    run = simulate_contact(body, ball, PAPER_SUPPORT, 2.0, gravity=0.0, law=law)
    assert run.outcome.cor == pytest.approx(e, abs=2e-6)
    after = 2.0 - run.outcome.ball_vx * ball.mass / 5.0
    assert run.outcome.pendulum_speed_after == pytest.approx(after, rel=1e-6)
    assert reduced > 0.0


def test_elastic_contact_time_of_hertz() -> None:
    assert elastic_contact_time(1.0) == pytest.approx(math.pi)
    assert elastic_contact_time(1.5) == pytest.approx(
        2.0 * 1.25**0.4 * float(beta(0.4, 0.5)) / 2.5, rel=1e-12
    )
    assert elastic_contact_time(1.5) == pytest.approx(3.218, abs=1e-3)


def test_the_launch_direction_depends_on_speed() -> None:
    out = contact_outcomes(PAPER_PENDULUM, JOKKU, PAPER_SUPPORT, np.array([1.1, 2.3, 3.9]))
    angles = np.rad2deg(np.asarray(out.launch_angle))
    assert np.all(np.diff(angles) > 0.5)
    assert 4.0 < angles[0] < 6.0
    assert 9.0 < angles[2] < 10.5


def test_friction_of_the_face_lifts_and_turns_the_ball() -> None:
    smooth = contact_outcomes(PAPER_PENDULUM, JOKKU, PAPER_SUPPORT, np.array([3.0]))
    rough = contact_outcomes(PAPER_PENDULUM, JOKKU, PAPER_SUPPORT, np.array([3.0]), friction=0.1)
    assert float(np.ravel(rough.launch_angle)[0]) > float(np.ravel(smooth.launch_angle)[0])
    assert float(np.ravel(rough.ball_spin)[0]) < 0.0
    assert float(np.ravel(smooth.ball_spin)[0]) == 0.0


def test_a_rough_support_holds_the_ball_back() -> None:
    slow = np.array([0.4])
    free = contact_outcomes(PAPER_PENDULUM, JOKKU, PAPER_SUPPORT, slow)
    held = contact_outcomes(PAPER_PENDULUM, JOKKU, Support(0.312, friction=0.6), slow)
    assert float(np.ravel(held.ball_vx)[0]) < float(np.ravel(free.ball_vx)[0])


@pytest.mark.parametrize("given_times", [True, False])
def test_contacts_of_an_independent_simulator_are_reproduced(given_times: bool) -> None:
    """With its contact times, or with the presets' (which were set after it): all else follows."""
    table = json.loads((shared_folder("concealed_dev") / "01" / "public.json").read_text())
    for name, ball in BALLS.items():
        rows = table["balls"][name]["baseline_contact"]
        speed = np.array([row["v_M0"] for row in rows])
        time = np.array([row["dt_s"] for row in rows]) if given_times else None
        out = contact_outcomes(PAPER_PENDULUM, ball, PAPER_SUPPORT, speed, contact_time=time)
        for field, key, near in (
            ("cor", "e", 1e-6),
            ("contact_time", "dt_s", 6e-4),
            ("pendulum_speed_after", "v_M", 1e-3),
            ("pendulum_angle", "phi_release", 2e-5 if given_times else 1e-3),
            ("ball_x", "x", 5e-4),
            ("ball_y", "y", 5e-4),
            ("ball_vx", "vx", 6e-3),
            ("ball_vy", "vy", 2.5e-2),
        ):
            theirs = np.array([row[key] for row in rows])
            np.testing.assert_allclose(getattr(out, field), theirs, atol=near, err_msg=field)


def test_one_friction_coefficient_explains_spin_and_direction_of_an_independent_ball() -> None:
    """The friction that gives a ray-traced clip's spin also gives its launch, to a tenth."""
    truth = json.loads((shared_folder("rendered") / "jokku_120" / "truth.json").read_text())

    def strike(friction: float) -> ContactOutcome:
        return contact_outcomes(
            PAPER_PENDULUM,
            JOKKU,
            PAPER_SUPPORT,
            np.array([truth["v_M0"]]),
            cor=truth["COR"],
            contact_time=truth["contact"]["dt_s"],
            friction=friction,
        ).at(0)

    friction = brentq(
        lambda mu: float(strike(mu).ball_spin) - truth["spin_rad_s"], 0.1, 0.25, xtol=5e-3
    )
    found = strike(float(friction))
    assert math.degrees(float(found.launch_angle)) == pytest.approx(truth["launch_deg"], abs=0.15)
    assert found.ball_vx == pytest.approx(truth["v_B"][0], abs=0.01)
    smooth = math.degrees(float(strike(0.0).launch_angle))
    assert abs(smooth - truth["launch_deg"]) > 1.0


def test_dimensions_scale() -> None:
    """Lengths x 2, times x 3, masses x 5: speeds, angles and positions must follow."""
    length, time, mass = 2.0, 3.0, 5.0
    body = Pendulum(
        PAPER_PENDULUM.length * length,
        PAPER_PENDULUM.inertia * mass * length**2,
        PAPER_PENDULUM.mass * mass,
        PAPER_PENDULUM.com * length,
        None,
        PAPER_PENDULUM.face_offset * length,
    )
    ball = replace(JOKKU, mass=JOKKU.mass * mass, diameter=JOKKU.diameter * length)
    small = contact_outcomes(
        PAPER_PENDULUM, JOKKU, PAPER_SUPPORT, np.array([3.0]), cor=0.7, contact_time=0.014
    ).at(0)
    large = contact_outcomes(
        body,
        ball,
        Support(0.312 * length),
        np.array([3.0 * length / time]),
        gravity=9.806 * length / time**2,
        cor=0.7,
        contact_time=0.014 * time,
    ).at(0)
    assert large.pendulum_angle == pytest.approx(small.pendulum_angle, rel=1e-6)
    assert large.ball_vy == pytest.approx(small.ball_vy * length / time, rel=1e-6)
    assert large.ball_x == pytest.approx(small.ball_x * length, rel=1e-6)


@pytest.mark.parametrize(
    ("speed", "cor", "time"),
    [(-1.0, 0.7, 0.015), (2.0, 1.2, 0.015), (2.0, 0.0, 0.015), (2.0, 0.7, 0.0), (1e-4, 0.7, 0.015)],
)
def test_bad_input_is_an_error_never_a_nan(speed: float, cor: float, time: float) -> None:
    with pytest.raises(DomainError):
        contact_outcomes(
            PAPER_PENDULUM,
            JOKKU,
            PAPER_SUPPORT,
            np.array([speed]),
            cor=cor,
            contact_time=time,
        )
    with pytest.raises(DomainError):
        simulate_contact(PAPER_PENDULUM, JOKKU, PAPER_SUPPORT, speed, cor=cor, contact_time=time)


def test_bodies_that_cannot_exist_are_refused() -> None:
    with pytest.raises(DomainError, match="mass"):
        replace(JOKKU, mass=-0.3)
    with pytest.raises(DomainError, match="length"):
        Pendulum(0.0, 1.0, 6.0, 0.4)
    with pytest.raises(DomainError, match="launch angle"):
        replace(JOKKU, launch_angle=2.0)
    with pytest.raises(DomainError, match="height"):
        Support(-0.1)
