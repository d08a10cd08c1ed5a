"""`vision simulate`: the forward model, from back-swing or impact speed to landing.

One strike of `simulate`: its inputs after the swing, its numbers, its two flights.

Pictures of `simulate` and `plan`.

`vision plan`: the back-swing angle and impact speed for a wanted distance (section V.3).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import matplotlib
import numpy as np
import typer

from metrology import (
    Contribution,
    Defaults,
    DomainError,
    Quantity,
    UncertaintySource,
    UsageError,
    measurands,
    read_number,
)
from physics.air import DragCurve
from physics.bodies import lost_by_pendulum
from physics.contact import ContactOutcome, contact_outcomes
from physics.domain import FloatArray, require_positive
from physics.effects import Term
from physics.flight import FlightPath, fly
from physics.forward import (
    Experiment,
    Plan,
    PlanScatter,
    closed_form_landing,
    impulsive_launch,
    numerical_landing,
    paper_impact,
    plan_distance,
    time_resolved_landing,
)
from physics.restitution import ConstantCor, CorLaw
from physics.swing import backswing_for_speed, frictionless_speed
from pipelines.doors import FileRole
from pipelines.model.options import (
    added_effects,
    alter_outcome,
    angle_of,
    asked,
    scatter_of,
    send_out,
    setup_or_default,
    speed_with_losses,
)
from pipelines.options import (
    CorLawOption,
    CorOption,
    DragOption,
    EffectOption,
    NamedBallOption,
    NoTableOption,
    ResultsCsvOption,
    ResultsJsonOption,
    SetupFileOption,
)
from pipelines.report.plots import Picture, save_figure

__all__ = [
    "BLUE",
    "GRAY",
    "ORANGE",
    "Planning",
    "flights_figure",
    "plan",
    "plan_command",
    "plan_figure",
    "planned_figure",
    "saved_figure",
    "simulate",
    "simulate_command",
]

BLUE, ORANGE, GRAY = "#1f6fb4", "#d95f02", "#666666"

_STYLE: Any = {
    "font.size": 9,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "svg.hashsalt": "impact-vision",
}

"""Points of type and lines: legible where a page is printed at half its size."""


@contextmanager
def styled_figure(width: float = 6.4, height: float = 3.6) -> Iterator[Picture]:
    """A figure to draw on in the style of these plots; sizes in inches."""
    with matplotlib.rc_context(_STYLE):
        yield Picture(figsize=(width, height), dpi=150, layout="constrained")


@contextmanager
def saved_figure(path: Path, width: float = 6.4, height: float = 3.6) -> Iterator[Picture]:
    """A figure that is written whole to `path` (.png or .svg) when the block succeeds.

    Raises
    ------
    UsageError
        For another kind of file.
    """
    with styled_figure(width, height) as figure:
        yield figure
        save_figure(figure, path)


def flights_figure(
    experiment: Experiment, impulsive: FlightPath, turned: FlightPath | None
) -> Picture:
    """The ball's path by the paper's launch and by the contact followed in time."""
    with styled_figure() as figure:
        axes = figure.subplots()
        axes.axhline(experiment.ball.radius, color=GRAY, lw=0.8, ls=":")
        for flight, colour, label in (
            (impulsive, BLUE, "launched along the contact angle (steps a to e)"),
            (turned, ORANGE, "contact followed in time"),
        ):
            if flight is None:
                continue
            x, y = flight.position[:, 0], flight.position[:, 1]
            axes.plot(x, y, color=colour, label=label)
            axes.plot(x[-1], y[-1], "o", color=colour, ms=4)
        axes.annotate("centre at landing", (0.0, experiment.ball.radius), va="bottom", color=GRAY)
        axes.set(xlabel="x from rest (m)", ylabel="height of the centre (m)")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return figure


def plan_figure(
    angles: FloatArray,
    curves: dict[str, FloatArray],
    std: FloatArray,
    wanted: tuple[float, float],
    fitted: Callable[[float], bool],
) -> Picture:
    """Distance over back-swing angle (rad), the wanted point, and where the law is extrapolated."""
    degrees = np.rad2deg(angles)
    with styled_figure() as figure:
        axes = figure.subplots()
        inside = np.array([fitted(float(angle)) for angle in angles])
        for (label, distance), colour in zip(curves.items(), (BLUE, ORANGE), strict=False):
            axes.plot(degrees, distance, color=colour, lw=1.0, ls="--")
            axes.plot(degrees[inside], distance[inside], color=colour, label=label)
        first = next(iter(curves.values()))
        axes.fill_between(
            degrees, first - 1.96 * std, first + 1.96 * std, color=BLUE, alpha=0.15, lw=0
        )
        axes.plot(math.degrees(wanted[0]), wanted[1], "o", color="black", ms=5)
        axes.set(xlabel="back-swing angle (deg)", ylabel="landing distance (m)")
        axes.plot([], [], color=GRAY, lw=1.0, ls="--", label="beyond the fitted speeds")
        axes.legend(loc="upper left")
    return figure


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
class StrikeInputs:
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
) -> StrikeInputs:
    """Speed, e and contact time of one strike, from the back-swing (rad) or the speed (m/s)."""
    nominal = experiment.ball
    ball = replace(nominal, launch_angle=nominal.launch_angle + shift.launch_angle)
    moved = replace(experiment, ball=ball)
    released = None if backswing is None else abs(backswing) + shift.backswing
    speed = 0.0 if impact_speed is None else impact_speed
    if released is not None:
        speed = speed_with_losses(moved, released, effects)
    e = min(max(float(law(speed)) + shift.cor, SMALLEST_COR), 1.0)
    return StrikeInputs(
        moved, released, speed, e, float(ball.contact_time(speed)) + shift.contact_time
    )


def followed_contacts(strikes: list[StrikeInputs]) -> ContactOutcome:
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
    strike: StrikeInputs,
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


@dataclass(frozen=True)
class Simulation:
    """A simulated strike.

    Attributes
    ----------
    quantities : tuple of Quantity
        Named as in the contract.
    warnings : tuple of str
    flight : FlightPath
        The numerical path by the paper's launch, with all forces.
    contact_flight : FlightPath or None
        The path from the time-resolved contact; None where that contact can't be followed.
    """

    quantities: tuple[Quantity, ...]
    warnings: tuple[str, ...]
    flight: FlightPath
    contact_flight: FlightPath | None


def simulate(
    experiment: Experiment,
    *,
    backswing: float | None = None,
    impact_speed: float | None = None,
    cor: CorLaw | None = None,
    scatter: PlanScatter | None = None,
    effects: tuple[Term, ...] = (),
    unsure: Sequence[tuple[UncertaintySource, Experiment]] = (),
) -> Simulation:
    """Steps a to e of the paper from a back-swing angle (rad) or an impact speed (m/s).

    Parameters
    ----------
    experiment : Experiment
    backswing, impact_speed : float, optional
        Exactly one of them, rad or m/s.
    cor : CorLaw, optional
        Default the ball's.
    scatter : PlanScatter
        For the standard uncertainties.
    effects : tuple of Term
        Further physics from the catalogue.
    unsure : sequence of (UncertaintySource, Experiment)
        The experiment with a number one standard uncertainty larger, for each that is unsure.

    Returns
    -------
    Simulation

    Raises
    ------
    UsageError
        If both or neither of back-swing and impact speed are given.
    DomainError
        For inputs that no law holds for.
    """
    if (backswing is None) == (impact_speed is None):
        raise UsageError(
            "give either a back-swing angle or an impact speed",
            hint="For example --backswing 90deg, or --impact-speed 3.2.",
        )
    if impact_speed is not None:
        require_positive("the impact speed", impact_speed, "m/s")
    law = experiment.ball.cor if cor is None else cor
    sources = _sources(PlanScatter() if scatter is None else scatter, backswing is not None)
    shifts = [Shift()] + [shift for _, both in sources for shift in both]
    strikes = [strike_inputs(experiment, backswing, impact_speed, law, effects, s) for s in shifts]
    turned, why = _contacts(strikes)
    runs = [strike_numbers(s, t, effects)[0] for s, t in zip(strikes, turned, strict=True)]
    best, flight, contact_flight = strike_numbers(strikes[0], turned[0], effects, samples=201)
    others = []
    for source, moved in unsure:
        struck = strike_inputs(moved, backswing, impact_speed, law, effects, Shift())
        contact = None if why else followed_contacts([struck]).at(0)
        others.append((source, strike_numbers(struck, contact, effects)[0]))
    budgets = {
        name: (*_budget(name, runs, sources), *_by_unsure(name, best, others)) for name in best
    }
    quantities = [
        Quantity.measured(name, value, UNITS[name], budgets[name]) for name, value in best.items()
    ]
    if contact_flight is None:
        quantities += [
            Quantity.missing(n, unit, why)
            for n, unit in UNITS.items()
            if n not in best and "model" in n
        ]
    warnings = _warnings(experiment, best["impact_speed"], law, best["ball_speed"])
    return Simulation(tuple(quantities), warnings, flight, contact_flight)


def _contacts(strikes: list[StrikeInputs]) -> tuple[list[ContactOutcome | None], str]:
    """What contacts followed in time hand over, or none of them and why."""
    try:
        followed = followed_contacts(strikes)
        return [followed.at(i) for i in range(len(strikes))], ""
    except DomainError as problem:
        return [None] * len(strikes), problem.message


def _sources(
    scatter: PlanScatter, by_backswing: bool
) -> list[tuple[UncertaintySource, tuple[Shift, Shift]]]:
    """What repeats imperfectly, each one standard deviation down and up."""
    cor = math.hypot(scatter.cor, scatter.cor_law)
    angle = math.hypot(scatter.launch_angle, scatter.launch_angle_law)
    time = Defaults.CONTACT_TIME.std
    sources = [
        (UncertaintySource.COR, (Shift(cor=-cor), Shift(cor=cor))),
        (UncertaintySource.LAUNCH_ANGLE, (Shift(launch_angle=-angle), Shift(launch_angle=angle))),
        (UncertaintySource.CONTACT_TIME, (Shift(contact_time=-time), Shift(contact_time=time))),
    ]
    swing = scatter.backswing
    if by_backswing:
        sources.append(
            (UncertaintySource.BACKSWING, (Shift(backswing=-swing), Shift(backswing=swing)))
        )
    return sources


def _budget(
    name: str,
    runs: list[dict[str, float]],
    sources: list[tuple[UncertaintySource, tuple[Shift, Shift]]],
) -> tuple[Contribution, ...]:
    """Half the change of a quantity between minus and plus one standard deviation, by source."""
    return tuple(
        Contribution(source, 0.5 * abs(runs[2 * i + 2][name] - runs[2 * i + 1][name]))
        for i, (source, _) in enumerate(sources)
    )


def _by_unsure(
    name: str, best: dict[str, float], others: list[tuple[UncertaintySource, dict[str, float]]]
) -> tuple[Contribution, ...]:
    """Change of a quantity with each number that is unsure, one standard uncertainty larger."""
    return tuple(Contribution(source, abs(other[name] - best[name])) for source, other in others)


def _warnings(
    experiment: Experiment, speed: float, law: CorLaw, highest_speed: float
) -> tuple[str, ...]:
    ball, air = experiment.ball, experiment.air
    notes = list(air.notes)
    low, high = ball.cor_range
    if law == ball.cor and not low * 0.98 <= speed <= high * 1.02:
        notes.append(
            f"the impact speed of {speed:.3f} m/s is outside {low:.2f} to {high:.2f} m/s,"
            f" where the law of restitution of the {ball.name} was fitted: extrapolated"
        )
    reynolds = air.reynolds(highest_speed, ball.diameter)
    if isinstance(experiment.drag_coefficient, DragCurve):
        notes += experiment.drag_coefficient.notes(0.3 * reynolds, reynolds)
    elif reynolds > 1.5e5:
        notes.append(
            f"at Re = {reynolds:.2g} the drag coefficient may fall (drag crisis);"
            " it is taken as constant here"
        )
    return tuple(notes)


def simulate_command(
    backswing: Annotated[
        str | None, typer.Option(help="Back-swing angle, such as '90 deg'.", metavar="ANGLE")
    ] = None,
    impact_speed: Annotated[
        str | None, typer.Option(help="Impact speed, such as '3.2 m/s'.", metavar="V")
    ] = None,
    cor: CorOption = "variable",
    ball: NamedBallOption = None,
    effect: EffectOption = None,
    cor_law: CorLawOption = None,
    drag: DragOption = None,
    setup: SetupFileOption = None,
    json_to: ResultsJsonOption = None,
    csv_to: ResultsCsvOption = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw the path: .png or .svg."), FileRole.WRITES
    ] = None,
    quiet: NoTableOption = False,
) -> None:
    """Simulate a strike and the flight after it.

    Example: vision simulate --backswing "90 deg" --ball jokku --effect magnus:spin=10
    """
    known = setup_or_default(setup)
    wanted = asked(known, ball, cor, drag, cor_law)
    released = None if backswing is None else angle_of(backswing)
    speed = (
        None
        if impact_speed is None
        else read_number(impact_speed, measurands.SPEED, "--impact-speed")
    )
    added = added_effects(known, tuple(effect or ()))
    reached = speed
    if released is not None:
        reached = speed_with_losses(wanted.experiment, released, added)
    result = simulate(
        wanted.experiment,
        backswing=released,
        impact_speed=speed,
        cor=wanted.law,
        scatter=wanted.scatter_at(reached, scatter_of(known, wanted.ball)),
        effects=added,
        unsure=wanted.unsure,
    )
    if plot is not None:
        save_figure(flights_figure(wanted.experiment, result.flight, result.contact_flight), plot)
    send_out(
        f"{wanted.experiment.ball.name}, simulated",
        result.quantities,
        result.warnings,
        json_to=json_to,
        csv_to=csv_to,
        quiet=quiet,
    )


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
    return Planning(tuple(quantities), _planning_warnings(experiment, found, law), found)


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


def _planning_warnings(experiment: Experiment, found: Plan, law: CorLaw) -> tuple[str, ...]:
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
