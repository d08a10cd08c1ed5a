"""Distance to back-swing angle and speed (section V.3), with a prediction interval."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from metrology import Defaults, DomainError
from physics.domain import FloatArray, require_positive
from physics.forward import Experiment, impulsive_launch, numerical_landing
from physics.restitution.restitution import CorLaw
from physics.swing import backswing_for_speed, frictionless_speed

__all__ = ["Plan", "PlanScatter", "plan_distance", "speed_for_distance"]

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
    return float(brentq(miss, slowest, fastest, xtol=1e-12, rtol=1e-13))


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
