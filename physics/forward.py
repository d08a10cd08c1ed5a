"""Forward model from impact speed to landing (steps a to e), and its inversions.

`plan_distance` finds back-swing and speed for a distance (section V.3) with a prediction interval;
`cor_from_range` solves Eq. 17, an implicit equation, for the coefficient of restitution.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Self

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
from physics.contact import (
    ContactOutcome,
    ImpulsiveImpact,
    contact_outcomes,
    cor_from_ball_speed,
    impact,
)
from physics.domain import FloatArray, Number, require_non_negative, require_positive
from physics.effects.base import Term
from physics.effects.flight import CoefficientCurve, Drag, DragByReynolds
from physics.flight import (
    FLIGHT_STEP_S,
    FlightModel,
    Landing,
    Launch,
    drag_constant,
    drag_free_distance,
    land,
    land_many,
)
from physics.restitution import CorLaw
from physics.swing import backswing_for_speed, frictionless_speed

__all__ = [
    "Experiment",
    "Plan",
    "PlanScatter",
    "RangeInputs",
    "ball_state",
    "closed_form_landing",
    "cor_from_range",
    "drag_term",
    "impulsive_launch",
    "numerical_landing",
    "paper_impact",
    "plan_distance",
    "sensitivities",
    "speed_for_distance",
    "time_resolved_landing",
]


@dataclass(frozen=True)
class Experiment:
    """The bodies and the air of one experiment.

    Attributes
    ----------
    gravity : float
        m/s².
    drag_coefficient : float or CoefficientCurve
        C_D, or a curve C_D(Re) evaluated along the flight (step b); the closed form uses the
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
    """The paper's launch: along θ, after a displacement by v_M^avg Δt.

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


def numerical_landing(experiment: Experiment, launch: Launch) -> Landing:
    """Steps b to e from the paper's launch, drag in both directions."""
    angle, advance = np.asarray(launch.angle), np.asarray(launch.advance)
    state = ball_state(
        advance * np.cos(angle),
        experiment.rest_height + advance * np.sin(angle),
        launch.speed * np.cos(angle),
        launch.speed * np.sin(angle),
    )
    return _fly(experiment, state, FLIGHT_STEP_S)


def ball_state(x: Number, y: Number, vx: Number, vy: Number) -> FloatArray:
    """States (6, N) of balls that fly in the plane z = 0, from numbers or (N,) arrays."""
    parts = np.broadcast_arrays(*np.atleast_1d(x, y, 0.0, vx, vy, 0.0))
    return np.array(parts, dtype=np.float64)


def drag_term(coefficient: float | CoefficientCurve | FloatArray) -> Term:
    """Drag with a constant coefficient, or with one that depends on the Reynolds number."""
    if callable(coefficient):
        return Term(DragByReynolds(curve=coefficient), {})
    require_non_negative("the drag coefficient", coefficient)
    return Term(Drag(), {"drag_coefficient": coefficient})


def time_resolved_landing(
    experiment: Experiment,
    speed: FloatArray,
    *,
    cor: Number | None = None,
    step: float = FLIGHT_STEP_S,
) -> tuple[ContactOutcome, Landing]:
    """Resolved contact, then the flight from release; arrays over `speed` (m/s)."""
    outcome = contact_outcomes(
        experiment.pendulum,
        experiment.ball,
        experiment.support,
        speed,
        gravity=experiment.gravity,
        cor=cor,
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
    """Standard deviations between trials, and standard uncertainties shared by them.

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
    """Setting that reaches a distance.

    Attributes
    ----------
    distance : float
        Wanted, m.
    impact_speed, backswing : float
        m/s and rad.
    speed_std, backswing_std : float
        Standard uncertainty of the setting: from the shared uncertainties (law of restitution,
        launch angle) and the trial's own change in the speed and angle that reach the distance.
    distance_std : float
        Standard deviation of the distance for a setting, m.
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
        If the distance is outside the range between `slowest` and `fastest` (m/s).
    """
    require_positive("the distance", distance, "m")

    def miss(speed: float) -> float:
        return float(law(np.array([speed]))[0]) - distance

    near, far = miss(slowest) + distance, miss(fastest) + distance
    if not near <= distance <= far:
        raise DomainError(
            f"a distance of {distance:g} m can't be reached: this pendulum reaches"
            f" {near:.3f} m to {far:.3f} m",
            hint="Choose a distance in between, or a longer or heavier pendulum.",
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

    The paper's steps a to e inverted: launch along θ after Eqs 8 to 10, drag in both directions,
    speed to back-swing by the energy balance of a frictionless pendulum.

    Parameters
    ----------
    distance : float
        Landing distance of the centre from rest, m.
    cor : CorLaw, optional
        Default the ball's law.
    scatter : PlanScatter, optional
        For the uncertainty.

    Raises
    ------
    DomainError
        If the distance is outside the pendulum's range.
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

    fastest = frictionless_speed(pendulum, math.pi, ball.launch_angle, experiment.gravity)
    slowest, fastest = _valid_speeds(law, _MIN_PLANNED_SPEED, fastest * (1.0 - 1e-9))
    speed = speed_for_distance(distance, lands, slowest, fastest)
    backswing = backswing_for_speed(pendulum, speed, ball.launch_angle, experiment.gravity)

    slopes = _slopes(lands, speed)
    weight = pendulum.mass * experiment.gravity * pendulum.com
    by_angle = weight * math.sin(backswing) * pendulum.length**2 / (pendulum.inertia * speed)
    return _with_scatter(distance, speed, backswing, slopes, by_angle, scatter)


_MIN_PLANNED_SPEED = 0.05
"""Minimum impact speed in planning, m/s (chosen): it moves a ball by millimetres."""


def _valid_speeds(law: CorLaw, slowest: float, fastest: float) -> tuple[float, float]:
    """Part of `slowest` to `fastest` in which the law gives a coefficient of restitution.

    Raises
    ------
    DomainError
        If there is none.
    """

    def valid(speed: float) -> bool:
        try:
            law(speed)
        except DomainError:
            return False
        return True

    def edge(inside: float, outside: float) -> float:
        for _ in range(40):
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if valid(middle) else (inside, middle)
        return inside

    if valid(slowest) and valid(fastest):
        return slowest, fastest
    tried = np.geomspace(slowest, fastest, 60).tolist()
    holds = [k for k, speed in enumerate(tried) if valid(speed)]
    if not holds:
        law(fastest)
    first, last = holds[0], holds[-1]
    low = tried[first] if first == 0 else edge(tried[first], tried[first - 1])
    high = tried[last] if last == len(tried) - 1 else edge(tried[last], tried[last + 1])
    return low, high


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


@dataclass(frozen=True)
class RangeInputs:
    """All that Eq. 17 takes; each a float, or an array over trials or Monte-Carlo draws.

    Attributes
    ----------
    distance : float or array
        x of the ball's centre at landing from rest, m.
    impact_speed : float or array
        v_M⁰, m/s.
    contact_time : float or array
        Δt, s.
    launch_angle : float or array
        θ, rad.
    support_height : float or array
        h_s, m.
    ball_mass, effective_mass : float or array
        m_B and M_E, kg.
    ball_diameter : float or array
        m.
    air_density : float or array
        kg/m³.
    gravity : float or array
        m/s².
    """

    distance: Number
    impact_speed: Number
    contact_time: Number
    launch_angle: Number
    support_height: Number
    ball_mass: Number
    effective_mass: Number
    ball_diameter: Number
    drag_coefficient: Number
    air_density: Number
    gravity: Number = GRAVITY

    @classmethod
    def of(
        cls,
        pendulum: Pendulum,
        ball: Ball,
        support: Support,
        air: Air,
        *,
        distance: Number,
        impact_speed: Number,
        contact_time: Number,
        drag_coefficient: Number,
        gravity: float = GRAVITY,
    ) -> Self:
        """Collect the inputs from bodies and measured values."""
        return cls(
            distance,
            impact_speed,
            contact_time,
            ball.launch_angle,
            support.height,
            ball.mass,
            pendulum.mass_at_contact,
            ball.diameter,
            drag_coefficient,
            air.density,
            gravity,
        )

    @property
    def drag_constant(self) -> Number:
        """K = ρ S C_D / (2 m), 1/m."""
        area = 0.25 * np.pi * self.ball_diameter**2
        return 0.5 * self.air_density * area * self.drag_coefficient / self.ball_mass


def _check_inputs(inputs: RangeInputs) -> None:
    for name in ("distance", "impact_speed", "ball_mass", "effective_mass", "ball_diameter"):
        require_positive(f"the {name.replace('_', ' ')}", getattr(inputs, name))
    for name in ("contact_time", "support_height", "drag_coefficient", "air_density"):
        require_non_negative(f"the {name.replace('_', ' ')}", getattr(inputs, name))
    require_positive("gravity", inputs.gravity, "m/s^2")


def _ball_speed(inputs: RangeInputs, carried: Number) -> Number:
    """Speed that lands the ball at the distance after a displacement `carried` along θ (m)."""
    cosine, sine = np.cos(inputs.launch_angle), np.sin(inputs.launch_angle)
    flown = drag_free_distance(inputs.distance - carried * cosine, inputs.drag_constant)
    fall = inputs.support_height + carried * sine + flown * sine / cosine
    if np.any(np.asarray(fall) <= 0.0) or np.any(np.asarray(flown) <= 0.0):
        raise DomainError(
            "no ball launched at this angle lands at this distance",
            hint="Check the distance, the support height and the launch angle.",
        )
    speed: Number = flown / cosine * (inputs.gravity / (2.0 * fall)) ** 0.5
    return speed


def cor_from_range(inputs: RangeInputs) -> Number:
    """Coefficient of restitution from where the ball landed (Eq. 17).

    v_M^avg on the right of Eq. 17 depends on e through v_M; the equation is iterated to a fixed
    point, a strong contraction since the contact is a small fraction of the whole path.

    Returns
    -------
    float or array
        e. Not limited to (0, 1]: measured distances may give other values.

    Raises
    ------
    DomainError
        For inputs outside their domain or a distance that no launch at θ gives.
    """
    _check_inputs(inputs)
    mean_speed: Number = inputs.impact_speed
    before: Number = np.inf
    ball_speed: Number = 0.0
    for _ in range(60):
        ball_speed = _ball_speed(inputs, mean_speed * inputs.contact_time)
        after = inputs.impact_speed - inputs.ball_mass * ball_speed / inputs.effective_mass
        mean_speed = 0.5 * (inputs.impact_speed + after)
        moved = float(np.max(np.abs(ball_speed - before)))
        if moved < 1e-13 * float(np.max(np.abs(ball_speed))):
            break
        before = ball_speed
    else:
        raise DomainError(
            "Eq. 17 has no fixed point for these inputs",
            hint="Check that the contact time is in seconds: some hundredths are usual.",
        )
    return cor_from_ball_speed(
        inputs.effective_mass, inputs.ball_mass, inputs.impact_speed, ball_speed
    )


def sensitivities(inputs: RangeInputs) -> dict[str, float]:
    """∂e/∂(input) of every input at a point, by central differences of 1e-5.

    Parameters
    ----------
    inputs : RangeInputs
        Floats.

    Returns
    -------
    dict of str to float
        By field name; per unit of the input.
    """
    result = {}
    for name in (f.name for f in fields(inputs)):
        centre = float(getattr(inputs, name))
        delta = 1e-5 * abs(centre) if centre else 1e-5
        low, high = max(centre - delta, 0.0), centre + delta
        pair = np.asarray(cor_from_range(replace(inputs, **{name: np.array([low, high])})))
        result[name] = float((pair[1] - pair[0]) / (high - low))
    return result
