"""Mechanics, randomness and files of the first generator."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from bench.concealed.campaign import perform
from bench.concealed.world.design import draw_design, view
from bench.concealed.world.draw import drag_stays_positive, draw_campaign, kind_of, level_of
from bench.concealed.world.labs import BASKETBALL, JOKKU, Lab, blank_shots
from bench.concealed.world.motion import move
from bench.concealed.world.recipes import CATALOGUE, UNNAMED, Strength, apply
from bench.concealed.world.shots import concatenate, take
from bench.concealed.world.stages import collide, flight_force
from bench.concealed.world.strength import visibility

LAB = Lab((JOKKU, BASKETBALL), 0.5541, 1.579, 6.0, 0.4553, 0.045, 0.312, 1.18, 1.852e-5, 0.45)
SHOTS = blank_shots(LAB, [JOKKU, BASKETBALL, JOKKU], np.radians([30.0, 90.0, 120.0]))


def test_the_undamped_swing_conserves_energy():
    speed = move(SHOTS).contact.path.state[0, :, 1]
    fall = np.cos(SHOTS.contact_angle) - np.cos(SHOTS.backswing)
    np.testing.assert_allclose(
        0.5 * LAB.inertia * speed**2,
        LAB.pendulum_mass * LAB.gravity * LAB.com * fall,
        rtol=1e-9,
    )


def test_contact_keeps_angular_momentum_and_obeys_the_restitution_law():
    # Without gravity nothing but the two bodies exchanges momentum.
    weightless = replace(SHOTS, gravity=np.full(3, 1e-9))
    contact = collide(weightless, np.array([2.0, 4.0, 7.0]))
    start, end = contact.path.state[0], contact.release
    # Angular momentum about the pivot, whose position follows from first contact.
    pivot_x = -LAB.length * np.sin(SHOTS.contact_angle) - (LAB.face_offset + SHOTS.radius) * np.cos(
        SHOTS.contact_angle
    )
    pivot_y = (
        LAB.support_height + SHOTS.radius + LAB.length * np.cos(SHOTS.contact_angle)
        - (LAB.face_offset + SHOTS.radius) * np.sin(SHOTS.contact_angle)
    )  # fmt: skip
    ball = SHOTS.mass * ((end[:, 2] - pivot_x) * end[:, 5] - (end[:, 3] - pivot_y) * end[:, 4])
    np.testing.assert_allclose(LAB.inertia * end[:, 1] + ball, LAB.inertia * start[:, 1], rtol=1e-7)
    law = SHOTS.cor_a * np.exp(SHOTS.cor_b * contact.impact_speed + SHOTS.cor_c) + SHOTS.cor_d
    np.testing.assert_allclose(contact.cor, law, atol=1e-7)


def test_flight_agrees_with_an_adaptive_integrator_at_tight_tolerance():
    effects = [
        Strength(CATALOGUE["magnus"], 20.0),
        Strength(CATALOGUE["wind"], 1.0),
        Strength(UNNAMED["magnet"], 1.0, {"magnet_x": 0.4, "magnet_y": 0.4, "magnet_width": 0.1}),
    ]
    shots, _ = apply(effects, SHOTS, np.zeros(3))
    motion = move(shots)
    for body in range(3):
        one = take(shots, np.array([body]))

        def rate(t, state, one=one):
            force = flight_force(one, np.array([t]), state[None])[0] / one.mass[0]
            return [state[2], state[3], force[0], force[1] - one.gravity[0]]

        end = motion.flight_time[body]
        exact = solve_ivp(
            rate, (0, end), motion.contact.release[body, 2:], "DOP853", rtol=1e-12, atol=1e-13
        )
        ours = motion.flight.at(np.array([end]), body)[0]
        np.testing.assert_allclose(ours[:2], exact.y[:2, -1], atol=1e-7)
        assert ours[1] == pytest.approx(one.radius[0], abs=1e-9)


def test_every_recipe_changes_the_recording():
    recipes = [*CATALOGUE.values(), *UNNAMED.values()]
    one, still = take(SHOTS, np.array([1])), np.array([0.5])
    time = np.linspace(-0.1, 0.25, 200)
    parts, cameras = [one], [None]
    for recipe in recipes:
        constants = {name: (low + high) / 2 for name, (low, high) in recipe.constants.items()}
        shots, camera = apply([Strength(recipe, recipe.unit, constants)], one, still)
        parts.append(shots)
        cameras.append(camera)
    motion = move(concatenate(parts))
    plain_ball, plain_angle = motion.ball(time, 0), motion.pendulum(time, 0)
    for body, recipe in enumerate(recipes, start=1):
        place, angle = view(motion, body, cameras[body], 0.05, 600.0, (time, time))
        change = np.abs(place - plain_ball).max() + np.abs(angle - plain_angle).max()
        assert change > 1e-7, recipe.name


def test_a_tilted_face_is_absorbed_by_the_launch_angle():
    design = draw_design(np.random.default_rng(3), LAB)
    small = Strength(CATALOGUE["oblique_impact"], 1e-4)
    # A milliradian is far below the stated standard deviation, so almost nothing is left of it.
    assert visibility(design, [small]).matrix[0, 0] < 0.5


# Throws are drawn by the same code as strokes but need no contact, which is what takes time.
THROWN = next(number for number in range(50) if kind_of(5, number) == "twins")


def test_the_same_seed_draws_the_same_campaign(tmp_path):
    for name in ("a", "b"):
        draw_campaign(5, THROWN, tmp_path / name, tmp_path / f"keys-{name}")
    for file in ("ball.csv", "setup.toml"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    keys = [next((tmp_path / f"keys-{name}").iterdir()).read_text() for name in ("a", "b")]
    assert keys[0] == keys[1]
    assert kind_of(5, THROWN) == kind_of(5, THROWN)
    assert [kind_of(5, n) for n in range(50)] != [kind_of(6, n) for n in range(50)]


def test_the_same_seed_gives_the_same_recording(tmp_path):
    design = draw_design(np.random.default_rng(3), LAB)
    short = replace(
        design, ball_of_trial=design.ball_of_trial[:1], backswing_deg=design.backswing_deg[:1],
        timing=design.timing[:1],
    )  # fmt: skip
    drag = [Strength(CATALOGUE["drag"], 0.2)]
    for name in ("a", "b"):
        perform(np.random.default_rng(9), short, drag, tmp_path / name)
    for file in ("ball.csv", "pendulum.csv", "setup.toml"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    perform(np.random.default_rng(10), short, drag, tmp_path / "c")
    assert (tmp_path / "a" / "ball.csv").read_bytes() != (tmp_path / "c" / "ball.csv").read_bytes()


def test_no_pair_makes_the_drag_negative():
    design = draw_design(np.random.default_rng(3), LAB)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        coefficient, drop = rng.uniform(-0.45, 0.45), rng.uniform(0.0, 0.35)
        pair = [Strength(CATALOGUE["drag"], coefficient), Strength(CATALOGUE["drag_crisis"], drop)]
        positive = LAB.drag_coefficient + coefficient - drop > 0.0
        assert drag_stays_positive(design, pair) == positive


def test_the_key_is_not_among_the_files_of_the_engine(tmp_path):
    key = draw_campaign(5, THROWN, tmp_path / "a", tmp_path / "keys")
    files = {path.name for path in (tmp_path / "a").iterdir()}
    assert files <= {"ball.csv", "pendulum.csv", "setup.toml"}
    ball = pd.read_csv(tmp_path / "a" / "ball.csv")
    assert {"trial", "t_s", "x_m", "y_m"} <= set(ball.columns)
    assert key.level == "none" or key.level == level_of(key.delta_chi2)


def test_shots_of_a_batch_are_independent():
    alone = move(take(SHOTS, np.array([1])))
    together = move(concatenate([SHOTS, SHOTS]))
    assert together.landing_time[1] == pytest.approx(alone.landing_time[0], abs=1e-9)
