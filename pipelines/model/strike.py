"""One strike of `simulate`: its inputs after the swing, its numbers, its two flights."""

import math
from dataclasses import dataclass, replace

import numpy as np

from physics.contact.batch import contact_outcomes
from physics.contact.outcome import ContactOutcome
from physics.effects import Term
from physics.energy import lost_by_pendulum
from physics.flight.flight import FlightPath, fly
from physics.forward import Experiment, closed_form_landing, impulsive_launch, paper_impact
from physics.restitution.restitution import CorLaw
from pipelines.model.effects import alter_outcome, speed_with_losses

__all__ = ["UNITS", "Shift", "Strike", "followed_contacts", "strike_inputs", "strike_numbers"]

UNITS = {
    "backswing_angle": "deg",
    "impact_speed": "m/s",
    "pendulum_speed_before": "m/s",
    "pendulum_speed_after": "m/s",
    "ball_speed": "m/s",
    "launch_angle": "deg",
    "contact_time": "s",
    "cor_speeds": "1",
    "external_impulse": "N s",
    "energy_loss": "J",
    "flight_time": "s",
    "landing_time": "s",
    "landing_distance": "m",
    "landing_distance_closed_form": "m",
    "closed_form_difference": "m",
    "landing_distance_contact_model": "m",
    "launch_angle_contact_model": "deg",
    "ball_speed_contact_model": "m/s",
    "flight_time_contact_model": "s",
}


SMALLEST_COR = 1e-3
"""Share of the speed that a shifted coefficient of restitution is kept above: a law needs e > 0,
and no ball that flies has less."""


@dataclass(frozen=True)
class Shift:
    """One draw of what repeats imperfectly."""

    backswing: float = 0.0
    cor: float = 0.0
    launch_angle: float = 0.0
    contact_time: float = 0.0


@dataclass(frozen=True)
class Strike:
    """Inputs of one strike, after the swing."""

    experiment: Experiment
    backswing: float | None
    speed: float
    cor: float
    contact_time: float


def strike_inputs(
    experiment: Experiment,
    backswing: float | None,
    impact_speed: float | None,
    law: CorLaw,
    effects: tuple[Term, ...],
    shift: Shift,
) -> Strike:
    """Speed, e and contact time of one strike, from the back-swing (rad) or the speed (m/s)."""
    nominal = experiment.ball
    ball = replace(nominal, launch_angle=nominal.launch_angle + shift.launch_angle)
    moved = replace(experiment, ball=ball)
    released = None if backswing is None else abs(backswing) + shift.backswing
    speed = 0.0 if impact_speed is None else impact_speed
    if released is not None:
        speed = speed_with_losses(moved, released, effects)
    e = min(max(float(law(speed)) + shift.cor, SMALLEST_COR), 1.0)
    return Strike(moved, released, speed, e, float(ball.contact_time(speed)) + shift.contact_time)


def followed_contacts(strikes: list[Strike]) -> ContactOutcome:
    """All contacts followed in time, at once."""
    first = strikes[0].experiment
    return contact_outcomes(
        first.pendulum,
        first.ball,
        first.support,
        np.array([s.speed for s in strikes]),
        gravity=first.gravity,
        cor=np.array([s.cor for s in strikes]),
        contact_time=np.array([s.contact_time for s in strikes]),
        angle=np.array([s.experiment.ball.launch_angle for s in strikes]),
    )


def strike_numbers(
    strike: Strike,
    turned: ContactOutcome | None,
    effects: tuple[Term, ...],
    *,
    samples: int = 2,
) -> tuple[dict[str, float], FlightPath, FlightPath | None]:
    """One strike's numbers, the flight from the paper's launch and from the contact in time."""
    moved, speed, e, time = strike.experiment, strike.speed, strike.cor, strike.contact_time
    carried = alter_outcome(moved, speed, e, _paper_outcome(moved, speed, e, time), effects)
    flight = _fly(moved, carried, effects, samples)
    after = float(carried.pendulum_speed_after)
    closed = float(closed_form_landing(moved, impulsive_launch(moved, speed, e, time)).distance)
    distance = float(flight.landing_position[0])
    values: dict[str, float] = {}
    if strike.backswing is not None:
        values["backswing_angle"] = math.degrees(strike.backswing)
    values |= {
        "impact_speed": speed,
        "pendulum_speed_before": speed,
        "pendulum_speed_after": after,
        "contact_time": float(carried.contact_time),
        "cor_speeds": e,
        "external_impulse": moved.pendulum.mass_at_contact * (speed - after),
        "energy_loss": float(lost_by_pendulum(moved.pendulum, speed, after)),
        "ball_speed": float(carried.ball_speed),
        "launch_angle": math.degrees(float(carried.launch_angle)),
        "flight_time": flight.landing_time,
        "landing_time": time + flight.landing_time,
        "landing_distance": distance,
        "landing_distance_closed_form": closed,
        "closed_form_difference": closed - distance,
    }
    if turned is None:
        return values, flight, None
    turned = alter_outcome(moved, speed, e, turned, effects)
    turned_flight = _fly(moved, turned, effects, samples)
    values |= {
        "ball_speed_contact_model": float(turned.ball_speed),
        "launch_angle_contact_model": math.degrees(float(turned.launch_angle)),
        "flight_time_contact_model": turned_flight.landing_time,
        "landing_distance_contact_model": float(turned_flight.landing_position[0]),
    }
    return values, flight, turned_flight


def _paper_outcome(
    experiment: Experiment, speed: float, cor: float, contact_time: float
) -> ContactOutcome:
    """The impulsive launch of Eqs 8 to 10 and 13, 14 as what a contact hands over."""
    after = paper_impact(experiment, speed, cor)
    launch = impulsive_launch(experiment, speed, cor, contact_time)
    cosine, sine = math.cos(experiment.ball.launch_angle), math.sin(experiment.ball.launch_angle)
    turned = float(after.mean_speed) * contact_time / experiment.pendulum.length
    return ContactOutcome(
        impact_speed=speed,
        cor=cor,
        contact_time=contact_time,
        pendulum_speed_after=float(after.speed_after),
        pendulum_angle=experiment.ball.launch_angle + turned,
        ball_x=float(launch.advance) * cosine,
        ball_y=experiment.rest_height + float(launch.advance) * sine,
        ball_vx=float(launch.speed) * cosine,
        ball_vy=float(launch.speed) * sine,
    )


def _fly(
    experiment: Experiment,
    outcome: ContactOutcome,
    effects: tuple[Term, ...],
    samples: int,
) -> FlightPath:
    model = replace(experiment.flight, impact_speed=float(outcome.impact_speed))
    return fly(
        model.with_terms(*effects),
        (float(outcome.ball_x), float(outcome.ball_y), 0.0),
        (float(outcome.ball_vx), float(outcome.ball_vy), 0.0),
        floor=experiment.ball.radius,
        samples=samples,
    )
