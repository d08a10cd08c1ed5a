"""From impact speed to landing: the paper's steps a to e, and the same with the contact in time."""

from dataclasses import dataclass

import numpy as np

from physics.bodies import (
    GRAVITY,
    PAPER_PENDULUM,
    PAPER_SUPPORT,
    Ball,
    Pendulum,
    Support,
)
from physics.contact.contact import ContactOutcome, contact_outcomes
from physics.contact.impact import ImpulsiveImpact, impact
from physics.domain import FloatArray, Number, require_non_negative
from physics.effects.base import Term
from physics.effects.flight import CoefficientCurve, Drag, DragByReynolds
from physics.flight.air import PAPER_AIR, SUBCRITICAL_DRAG, Air
from physics.flight.closed_form import Landing, Launch, drag_constant, land
from physics.flight.flight import STEP, FlightModel, land_many

__all__ = [
    "Experiment",
    "ball_state",
    "closed_form_landing",
    "drag_term",
    "impulsive_launch",
    "numerical_landing",
    "paper_impact",
    "time_resolved_landing",
]


@dataclass(frozen=True)
class Experiment:
    """The bodies and the air of one experiment.

    Attributes
    ----------
    ball : Ball
    pendulum : Pendulum
    support : Support
    air : Air
    gravity : float
        m/s².
    drag_coefficient : float or CoefficientCurve
        C_D, or a curve C_D(Re) looked up along the flight (step b); the closed form takes the
        curve's value at launch.
    """

    ball: Ball
    pendulum: Pendulum = PAPER_PENDULUM
    support: Support = PAPER_SUPPORT
    air: Air = PAPER_AIR
    gravity: float = GRAVITY
    drag_coefficient: float | CoefficientCurve = SUBCRITICAL_DRAG

    @property
    def flight(self) -> FlightModel:
        """The ball in the air: gravity and quadratic drag in both directions."""
        return FlightModel(
            self.ball.mass,
            self.ball.diameter,
            self.air.density,
            self.air.viscosity,
            self.gravity,
            (drag_term(self.drag_coefficient),),
        )

    def drag_at(self, speed: Number) -> Number:
        """C_D at a speed through the air, m/s."""
        if not callable(self.drag_coefficient):
            return self.drag_coefficient
        scale = self.air.density * self.ball.diameter / self.air.viscosity
        return self.drag_coefficient(scale * speed)

    @property
    def rest_height(self) -> float:
        """Height of the ball's centre at rest, m."""
        return self.support.height + self.ball.radius


def paper_impact(
    experiment: Experiment, speed: Number, cor: Number | None = None
) -> ImpulsiveImpact:
    """Step a: the velocities after an instantaneous impact at `speed` (m/s).

    `cor` defaults to the ball's law.
    """
    wanted = experiment.ball.cor(np.asarray(speed)) if cor is None else cor
    return impact(experiment.pendulum.mass_at_contact, experiment.ball.mass, wanted, speed)


def impulsive_launch(
    experiment: Experiment,
    speed: Number,
    cor: Number | None = None,
    contact_time: Number | None = None,
    launch_angle: Number | None = None,
) -> Launch:
    """The paper's launch: along θ, after being carried by v_M^avg Δt.

    `cor` and `contact_time` (s) default to the ball's laws, `launch_angle` (rad) to its angle.
    """
    after = paper_impact(experiment, speed, cor)
    time = experiment.ball.contact_time(np.asarray(speed)) if contact_time is None else contact_time
    angle = experiment.ball.launch_angle if launch_angle is None else launch_angle
    return Launch(after.ball_speed, angle, after.mean_speed * time)


def closed_form_landing(experiment: Experiment, launch: Launch) -> Landing:
    """Eqs 13 to 16."""
    drag = experiment.drag_at(launch.speed)
    constant = drag_constant(experiment.ball, experiment.air, drag)
    return land(launch, experiment.support.height, constant, experiment.gravity)


def numerical_landing(
    experiment: Experiment,
    launch: Launch,
    *,
    step: float = STEP,
) -> Landing:
    """Steps b to e from the paper's launch, drag in both directions."""
    angle, advance = np.asarray(launch.angle), np.asarray(launch.advance)
    state = ball_state(
        advance * np.cos(angle),
        experiment.rest_height + advance * np.sin(angle),
        launch.speed * np.cos(angle),
        launch.speed * np.sin(angle),
    )
    return _fly(experiment, state, step)


def ball_state(x: Number, y: Number, vx: Number, vy: Number) -> FloatArray:
    """States (6, N) of balls that fly in the plane z = 0, from numbers or (N,) arrays."""
    parts = np.broadcast_arrays(*np.atleast_1d(x, y, 0.0, vx, vy, 0.0))
    return np.array(parts, dtype=np.float64)


def drag_term(coefficient: float | CoefficientCurve | FloatArray) -> Term:
    """Drag with a constant coefficient, or with one that is looked up by Reynolds number."""
    if callable(coefficient):
        return Term(DragByReynolds(curve=coefficient), {})
    require_non_negative("the drag coefficient", coefficient)
    return Term(Drag(), {"drag_coefficient": coefficient})


def time_resolved_landing(
    experiment: Experiment,
    speed: FloatArray,
    *,
    cor: Number | None = None,
    contact_time: Number | None = None,
    friction: float = 0.0,
    step: float = STEP,
) -> tuple[ContactOutcome, Landing]:
    """Contact followed in time, then the flight from where it let go; arrays over `speed` (m/s)."""
    outcome = contact_outcomes(
        experiment.pendulum,
        experiment.ball,
        experiment.support,
        speed,
        gravity=experiment.gravity,
        cor=cor,
        contact_time=contact_time,
        friction=friction,
    )
    state = ball_state(outcome.ball_x, outcome.ball_y, outcome.ball_vx, outcome.ball_vy)
    return outcome, _fly(experiment, state, step)


def _fly(experiment: Experiment, state: FloatArray, step: float) -> Landing:
    time, there = land_many(experiment.flight, state, floor=experiment.ball.radius, step=step)
    return Landing(time, there[0])
