"""From impact speed to landing: the paper's steps a to e, and the same with the contact in time.

Distance to back-swing angle and speed (section V.3), with a prediction interval.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from metrology import Defaults, DomainError
from physics.air import PAPER_AIR, SUBCRITICAL_DRAG, Air
from physics.bodies import (
    GRAVITY,
    PAPER_PENDULUM,
    PAPER_SUPPORT,
    Ball,
    Pendulum,
    Support,
)
from physics.contact import ContactOutcome, ImpulsiveImpact, contact_outcomes, impact
from physics.domain import FloatArray, Number, require_non_negative, require_positive
from physics.effects.base import Term
from physics.effects.flight import CoefficientCurve, Drag, DragByReynolds
from physics.flight import STEP, FlightModel, Landing, Launch, drag_constant, land, land_many
from physics.restitution import CorLaw
from physics.swing import backswing_for_speed, frictionless_speed

__all__ = [
    "Experiment",
    "Plan",
    "PlanScatter",
    "ball_state",
    "closed_form_landing",
    "drag_term",
    "impulsive_launch",
    "numerical_landing",
    "paper_impact",
    "plan_distance",
    "speed_for_distance",
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


DistanceLaw = Callable[[FloatArray], FloatArray]

"""Impact speeds (N,) in m/s to landing distances (N,) in m."""


@dataclass(frozen=True)
class PlanScatter:
    """What repeats imperfectly and what is not known better; one sigma.

    Attributes
    ----------
    backswing : float
        rad, trial to trial.
    launch_angle : float
        rad, trial to trial.
    cor : float
        Trial to trial.
    cor_law : float
        Offset of the law of restitution, shared by all trials.
    launch_angle_law : float
        rad, shared by all trials.
    """

    backswing: float = Defaults.BACKSWING_SCATTER.std
    launch_angle: float = Defaults.LAUNCH_ANGLE_SCATTER.std
    cor: float = Defaults.COR_SCATTER.std
    cor_law: float = Defaults.COR_LAW.std
    launch_angle_law: float = Defaults.LAUNCH_ANGLE_LAW.std


@dataclass(frozen=True)
class Plan:
    """How to strike to reach a distance.

    Attributes
    ----------
    distance : float
        Wanted, m.
    impact_speed, backswing : float
        m/s and rad.
    speed_std, backswing_std : float
        How well the setting is known: what the shared uncertainties (law of restitution, launch
        angle) and the trial's own change in the speed and angle that reach the distance.
    distance_std : float
        Scatter of the distance that a setting leads to, one sigma, m.
    interval : (2,) tuple of float
        95 % prediction interval of the distance of one trial, m.
    """

    distance: float
    impact_speed: float
    backswing: float
    speed_std: float
    backswing_std: float
    distance_std: float
    interval: tuple[float, float]


def speed_for_distance(distance: float, law: DistanceLaw, slowest: float, fastest: float) -> float:
    """Impact speed (m/s) at which `law` gives `distance` (m).

    Raises
    ------
    DomainError
        If the distance is out of reach between `slowest` and `fastest` (m/s).
    """
    require_positive("the distance", distance, "m")

    def miss(speed: float) -> float:
        return float(law(np.array([speed]))[0]) - distance

    near, far = miss(slowest) + distance, miss(fastest) + distance
    if not near <= distance <= far:
        raise DomainError(
            f"a distance of {distance:g} m can't be reached: this pendulum reaches"
            f" {near:.3f} m to {far:.3f} m",
            hint="Ask for a distance in between, or set up a longer or heavier pendulum.",
        )
    return float(scipy.optimize.brentq(miss, slowest, fastest, xtol=1e-12, rtol=1e-13))


def plan_distance(
    experiment: Experiment,
    distance: float,
    *,
    cor: CorLaw | None = None,
    scatter: PlanScatter | None = None,
) -> Plan:
    """Back-swing and impact speed for a wanted landing distance.

    The paper's steps a to e run backwards: launch along θ after Eqs 8 to 10, drag in both
    directions, speed to back-swing by the energy balance of a frictionless pendulum.

    Parameters
    ----------
    experiment : Experiment
    distance : float
        Landing distance of the centre from rest, m.
    cor : CorLaw, optional
        Default the ball's law.
    scatter : PlanScatter, optional
        For the uncertainty.

    Returns
    -------
    Plan

    Raises
    ------
    DomainError
        If the distance is out of the pendulum's reach.
    """
    ball, pendulum = experiment.ball, experiment.pendulum
    law = ball.cor if cor is None else cor
    scatter = PlanScatter() if scatter is None else scatter

    def lands(speed: FloatArray, cor_shift: float = 0.0, angle_shift: float = 0.0) -> FloatArray:
        launch = impulsive_launch(
            experiment,
            speed,
            np.minimum(law(speed) + cor_shift, 1.0),
            launch_angle=ball.launch_angle + angle_shift,
        )
        return np.asarray(numerical_landing(experiment, launch).distance)

    slowest = 0.05
    fastest = frictionless_speed(pendulum, math.pi, ball.launch_angle, experiment.gravity)
    fastest = _fastest_valid(law, slowest, fastest * (1.0 - 1e-9))
    speed = speed_for_distance(distance, lands, slowest, fastest)
    backswing = backswing_for_speed(pendulum, speed, ball.launch_angle, experiment.gravity)

    slopes = _slopes(lands, speed)
    weight = pendulum.mass * experiment.gravity * pendulum.com
    by_angle = weight * math.sin(backswing) * pendulum.length**2 / (pendulum.inertia * speed)
    return _with_scatter(distance, speed, backswing, slopes, by_angle, scatter)


def _fastest_valid(law: CorLaw, slowest: float, fastest: float) -> float:
    """Highest speed up to `fastest` at which the law gives a coefficient of restitution."""

    def valid(speed: float) -> bool:
        try:
            law(speed)
        except DomainError:
            return False
        return True

    if valid(fastest):
        return fastest
    law(slowest)
    low, high = slowest, fastest
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if valid(middle) else (low, middle)
    return low


def _slopes(
    lands: Callable[[FloatArray, float, float], FloatArray], speed: float
) -> tuple[float, float, float]:
    """Change of the distance with speed, with e and with the launch angle."""
    here, step = np.array([speed]), 1e-3
    by_speed = np.diff(lands(speed + speed * np.array([-step, step]), 0.0, 0.0))[0] / speed
    by_cor = (lands(here, step, 0.0) - lands(here, -step, 0.0))[0]
    by_angle = (lands(here, 0.0, step) - lands(here, 0.0, -step))[0]
    return (
        float(by_speed) / (2.0 * step),
        float(by_cor) / (2.0 * step),
        float(by_angle) / (2.0 * step),
    )


def _with_scatter(
    distance: float,
    speed: float,
    backswing: float,
    slopes: tuple[float, float, float],
    speed_by_backswing: float,
    scatter: PlanScatter,
) -> Plan:
    by_speed, by_cor, by_angle = slopes
    shared = (by_cor * scatter.cor_law, by_angle * scatter.launch_angle_law)
    own = (by_cor * scatter.cor, by_angle * scatter.launch_angle)
    swung = speed_by_backswing * scatter.backswing
    distance_std = math.hypot(by_speed * swung, *own, *shared)
    speed_std = math.hypot(*own, *shared) / by_speed
    return Plan(
        distance,
        speed,
        backswing,
        math.hypot(speed_std, swung),
        math.hypot(speed_std / max(speed_by_backswing, 1e-9), scatter.backswing),
        distance_std,
        (distance - 1.96 * distance_std, distance + 1.96 * distance_std),
    )
