"""Planning of a campaign: back-swing and impact speed for a distance."""

import math

import numpy as np
import pytest

from metrology import DomainError
from physics.bodies import BASKETBALL, JOKKU
from physics.forward import (
    Experiment,
    PlanScatter,
    closed_form_landing,
    impulsive_launch,
    numerical_landing,
    plan_distance,
    time_resolved_landing,
)
from physics.restitution import ConstantCor
from physics.swing import frictionless_speed


@pytest.mark.parametrize(("ball", "distance"), [(JOKKU, 1.0), (JOKKU, 2.4), (BASKETBALL, 2.8)])
def test_striking_as_planned_reaches_the_distance(ball: type(JOKKU), distance: float) -> None:
    experiment = Experiment(ball)
    plan = plan_distance(experiment, distance)
    speed = frictionless_speed(experiment.pendulum, plan.backswing, ball.launch_angle)
    assert speed == pytest.approx(plan.impact_speed, rel=1e-9)
    launch = impulsive_launch(experiment, np.array([speed]))
    reached = np.asarray(numerical_landing(experiment, launch).distance)[0]
    assert reached == pytest.approx(distance, abs=1e-6)


def test_the_prediction_interval_covers_single_trials() -> None:
    experiment = Experiment(JOKKU)
    scatter = PlanScatter(math.radians(0.4), math.radians(0.3), 0.006, 0.01, math.radians(0.3))
    plan = plan_distance(experiment, 2.0, scatter=scatter)
    generator = np.random.default_rng(3)
    draws = 4000
    swings = plan.backswing + generator.normal(0.0, scatter.backswing, draws)
    speeds = np.asarray(frictionless_speed(experiment.pendulum, swings, JOKKU.launch_angle))
    cor = JOKKU.cor(speeds) + generator.normal(0.0, math.hypot(0.006, 0.01), draws)
    turn = generator.normal(0.0, math.hypot(scatter.launch_angle, scatter.launch_angle_law), draws)
    launch = impulsive_launch(experiment, speeds, cor, launch_angle=JOKKU.launch_angle + turn)
    reached = np.asarray(numerical_landing(experiment, launch).distance)
    assert np.std(reached) == pytest.approx(plan.distance_std, rel=0.04)
    inside = (plan.interval[0] <= reached) & (reached <= plan.interval[1])
    assert np.mean(inside) == pytest.approx(0.95, abs=0.015)


def test_the_constant_cor_plans_a_smaller_swing() -> None:
    experiment = Experiment(JOKKU)
    variable = plan_distance(experiment, 2.2)
    constant = plan_distance(experiment, 2.2, cor=ConstantCor(float(JOKKU.cor(0.0))))
    assert constant.backswing < variable.backswing


@pytest.mark.parametrize("distance", [-1.0, 0.0, 50.0, float("nan")])
def test_unreachable_distances_are_errors(distance: float) -> None:
    with pytest.raises(DomainError):
        plan_distance(Experiment(JOKKU), distance)


def test_closed_form_and_numerical_path_agree_without_drag() -> None:
    experiment = Experiment(JOKKU, drag_coefficient=0.0)
    launch = impulsive_launch(experiment, np.array([1.0, 2.0, 4.0]))
    closed = np.asarray(closed_form_landing(experiment, launch).distance)
    numerical = np.asarray(numerical_landing(experiment, launch).distance)
    np.testing.assert_allclose(closed, numerical, atol=1e-9)
    with_drag = Experiment(JOKKU)
    difference = np.asarray(closed_form_landing(with_drag, launch).distance) - np.asarray(
        numerical_landing(with_drag, launch).distance
    )
    assert np.all(np.abs(difference) < 0.01)
    assert np.any(np.abs(difference) > 1e-5)


def test_time_resolved_contact_lands_elsewhere_than_the_launch_of_ryu_et_al() -> None:
    experiment = Experiment(JOKKU)
    speeds = np.array([1.1, 3.9])
    _, landing = time_resolved_landing(experiment, speeds)
    paper = numerical_landing(experiment, impulsive_launch(experiment, speeds))
    shift = np.asarray(landing.distance) - np.asarray(paper.distance)
    assert shift[0] < -0.01
    assert shift[1] > 0.1
