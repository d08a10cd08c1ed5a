"""`vision plan`: the back-swing angle and impact speed for a wanted distance (section V.3)."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from metrology import (
    Contribution,
    DomainError,
    Quantity,
    UncertaintySource,
    measurands,
    read_number,
)
from physics.domain import FloatArray
from physics.forward import (
    Experiment,
    Plan,
    PlanScatter,
    impulsive_launch,
    numerical_landing,
    plan_distance,
    time_resolved_landing,
)
from physics.restitution import ConstantCor, CorLaw
from physics.swing import backswing_for_speed, frictionless_speed
from pipelines.doors import FileRole
from pipelines.figures import Picture, save_figure
from pipelines.model.options import (
    asked,
    scatter_of,
    send_out,
    setup_or_default,
)
from pipelines.model.simulate import plan_figure
from pipelines.options import (
    CorLawOption,
    CorOption,
    DragOption,
    NamedBallOption,
    NoTableOption,
    ResultsCsvOption,
    ResultsJsonOption,
    SetupFileOption,
)

__all__ = ["Planning", "plan", "plan_command", "planned_figure"]


_CONTACT_ANGLE = ("backswing_angle_contact_model", "deg")


@dataclass(frozen=True)
class Planning:
    """A plan in numbers.

    Attributes
    ----------
    quantities : tuple of Quantity
    warnings : tuple of str
    plan : Plan
    """

    quantities: tuple[Quantity, ...]
    warnings: tuple[str, ...]
    plan: Plan


def plan(
    experiment: Experiment,
    distance: float,
    *,
    cor: CorLaw | None = None,
    scatter: PlanScatter | None = None,
) -> Planning:
    """Back-swing and speed for `distance` (m), by the variable and by the constant COR.

    Parameters
    ----------
    experiment : Experiment
    distance : float
        m.
    cor : CorLaw, optional
        Default the ball's law.
    scatter : PlanScatter, optional

    Returns
    -------
    Planning

    Raises
    ------
    DomainError
        If the distance is out of the pendulum's reach.
    """
    law = experiment.ball.cor if cor is None else cor
    found = plan_distance(experiment, distance, cor=law, scatter=scatter)
    quantities = [
        _quantity(
            "backswing_angle",
            math.degrees(found.backswing),
            "deg",
            math.degrees(found.backswing_std),
        ),
        _quantity("impact_speed", found.impact_speed, "m/s", found.speed_std),
        _quantity("landing_distance", distance, "m", found.distance_std),
        _quantity("landing_distance_low_95", found.interval[0], "m", 0.0),
        _quantity("landing_distance_high_95", found.interval[1], "m", 0.0),
    ]
    constant = ConstantCor(float(law(0.0)))
    if not isinstance(law, ConstantCor):
        quantities += _alternative(experiment, distance, constant, scatter)
    try:
        quantities += _by_contact_model(experiment, distance, law, found)
    except DomainError as problem:
        quantities.append(Quantity.missing(*_CONTACT_ANGLE, problem.message))
    return Planning(tuple(quantities), _warnings(experiment, found, law), found)


def _quantity(name: str, value: float, unit: str, std: float) -> Quantity:
    return Quantity.measured(
        name, value, unit, (Contribution(UncertaintySource.TRIAL_SCATTER, std),)
    )


def _alternative(
    experiment: Experiment, distance: float, law: CorLaw, scatter: PlanScatter | None
) -> list[Quantity]:
    """The same plan with the constant COR of the paper, where it reaches that far."""
    other = plan_distance(experiment, distance, cor=law, scatter=scatter)
    return [
        _quantity(
            "backswing_angle_constant_cor",
            math.degrees(other.backswing),
            "deg",
            math.degrees(other.backswing_std),
        ),
        _quantity("impact_speed_constant_cor", other.impact_speed, "m/s", other.speed_std),
    ]


def _by_contact_model(
    experiment: Experiment, distance: float, law: CorLaw, found: Plan
) -> list[Quantity]:
    """Angle and speed when the contact is followed in time instead of taken as instantaneous."""
    name, unit = _CONTACT_ANGLE
    angle, gravity = experiment.ball.launch_angle, experiment.gravity
    fastest = frictionless_speed(experiment.pendulum, math.pi, angle, gravity)

    def lands(speed: FloatArray) -> FloatArray:
        _, landing = time_resolved_landing(experiment, speed, cor=np.asarray(law(speed)))
        return np.asarray(landing.distance)

    slowest, speed = 0.6 * found.impact_speed, min(1.5 * found.impact_speed, fastest)
    for _ in range(3):
        grid = np.linspace(slowest, speed, 7)
        reached = lands(grid)
        if not reached[0] <= distance <= reached[-1]:
            return [Quantity.missing(name, unit, "out of reach when contact is followed in time")]
        above = int(np.clip(np.searchsorted(reached, distance), 1, 6))
        slowest, speed = float(grid[above - 1]), float(grid[above])
    speed = float(np.interp(distance, reached, grid))
    swing = backswing_for_speed(experiment.pendulum, speed, angle, gravity)
    return [
        _quantity(name, math.degrees(swing), unit, math.degrees(found.backswing_std)),
        _quantity("impact_speed_contact_model", speed, "m/s", found.speed_std),
    ]


def _warnings(experiment: Experiment, found: Plan, law: CorLaw) -> tuple[str, ...]:
    low, high = experiment.ball.cor_range
    notes = list(experiment.air.notes)
    if law == experiment.ball.cor and not low * 0.98 <= found.impact_speed <= high * 1.02:
        notes.append(
            f"an impact speed of {found.impact_speed:.3f} m/s is outside {low:.2f} to {high:.2f}"
            f" m/s, where the law of restitution of the {experiment.ball.name} was fitted:"
            " the plan is an extrapolation"
        )
    return tuple(notes)


def planned_figure(experiment: Experiment, law: CorLaw, planned: Planning) -> Picture:
    """Distance over back-swing by the law and by a constant one, with the plan on it."""
    low, high = experiment.ball.cor_range
    pendulum, ball = experiment.pendulum, experiment.ball
    angles = np.linspace(1.5 * ball.launch_angle, math.pi, 90)
    speeds = np.asarray(frictionless_speed(pendulum, angles, ball.launch_angle, experiment.gravity))

    def distances(by: CorLaw) -> FloatArray:
        launch = impulsive_launch(experiment, speeds, np.asarray(by(speeds)))
        return np.asarray(numerical_landing(experiment, launch).distance)

    curves = {"variable COR": distances(law), "constant COR": distances(ConstantCor(law(0.0)))}
    relative = planned.plan.distance_std / planned.plan.distance

    def fitted(angle: float) -> bool:
        speed = float(frictionless_speed(pendulum, angle, ball.launch_angle, experiment.gravity))
        return low <= speed <= high

    return plan_figure(
        angles,
        curves,
        relative * curves["variable COR"],
        (planned.plan.backswing, planned.plan.distance),
        fitted,
    )


def plan_command(
    distance: Annotated[str, typer.Option(help="Wanted landing distance, such as 2.5m.")],
    ball: NamedBallOption = None,
    cor: CorOption = "variable",
    cor_law: CorLawOption = None,
    drag: DragOption = None,
    setup: SetupFileOption = None,
    json_to: ResultsJsonOption = None,
    csv_to: ResultsCsvOption = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw distance by angle: .png or .svg."), FileRole.WRITES
    ] = None,
    quiet: NoTableOption = False,
) -> None:
    """Plan a strike: the back-swing angle and impact speed that reach a distance.

    Example: vision plan --distance 2.5m --ball jokku

    How many strikes a law of restitution needs: vision plan campaign --help
    """
    known = setup_or_default(setup)
    wanted = asked(known, ball, cor, drag, cor_law)
    metres = read_number(distance, measurands.DISTANCE, "--distance")
    scatter = scatter_of(known, wanted.ball)
    planned = plan(wanted.experiment, metres, cor=wanted.law, scatter=scatter)
    if wanted.campaign is not None:
        # how well the law is known depends on the speed that the plan asks for
        scatter = wanted.scatter_at(planned.plan.impact_speed, scatter)
        planned = plan(wanted.experiment, metres, cor=wanted.law, scatter=scatter)
    if plot is not None:
        save_figure(planned_figure(wanted.experiment, wanted.law, planned), plot)
    send_out(
        f"{wanted.experiment.ball.name}, {distance}",
        planned.quantities,
        planned.warnings,
        json_to=json_to,
        csv_to=csv_to,
        quiet=quiet,
    )
