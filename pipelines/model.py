"""Forward model: `vision simulate` and `vision plan`, with plots and output.

Simulates a strike from back-swing or impact speed to landing, or inverts it for a wanted distance
(section V.3), with effects of the catalogue (``--effect magnus:spin=10``, [model] effects).
"""

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.table import Table

from measuring.setup.cor_file import BallLaw, law_of_ball, read_cor_file
from measuring.setup.file import (
    BallSetup,
    Origin,
    RigNumber,
    Setup,
    ball_from_option,
    rig_of,
    setup_from,
)
from measuring.setup.tables import read_parameter
from metrology import (
    Contribution,
    Defaults,
    DomainError,
    Quantity,
    SetupError,
    UncertaintySource,
    UsageError,
    measurands,
    read_number,
    write_text_whole,
)
from physics import bodies
from physics import effects as catalogue
from physics.air import SUBCRITICAL_DRAG, DragCurve, drag_curve
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
from physics.restitution import ConstantCor, CorLaw, parse_cor_law
from physics.swing import backswing_for_speed, frictionless_speed, swing
from pipelines.doors import (
    CorLawOption,
    CorOption,
    DragOption,
    EffectOption,
    FileRole,
    NamedBallOption,
    NoTableOption,
    ResultsCsvOption,
    ResultsJsonOption,
    SetupFileOption,
)
from pipelines.terminal import screen, write_json

if TYPE_CHECKING:
    from pipelines.report.plots import Picture

__all__ = [
    "AskedExperiment",
    "Planning",
    "added_effects",
    "alter_outcome",
    "asked",
    "ball_asked",
    "choose_ball",
    "choose_cor",
    "choose_drag",
    "experiment_of",
    "flights_figure",
    "parse_effect",
    "plan",
    "plan_command",
    "plan_figure",
    "planned_figure",
    "quantities_as_csv",
    "quantities_document",
    "scatter_of",
    "send_out",
    "simulate",
    "simulate_command",
    "speed_with_losses",
    "start_angle",
]

_DEFAULT_BALL = "jokku"


def choose_ball(setup: Setup, option: str | None) -> bodies.Ball:
    """The ball of `ball_asked` in the form that the physics needs."""
    return ball_asked(setup, option).body()


def ball_asked(setup: Setup, option: str | None) -> BallSetup:
    """The ball of ``--ball``, of the setup file, or the paper's jokku ball.

    Raises
    ------
    UsageError
        If the option is unknown, or the setup has several balls and none is chosen.
    """
    if option is not None:
        return setup.balls.get(option) or ball_from_option(option)
    if setup.ball is not None:
        return setup.ball
    if len(setup.balls) == 1:
        return next(iter(setup.balls.values()))
    if setup.balls:
        raise UsageError(
            f"the setup file has several balls: {', '.join(setup.balls)}",
            hint="Choose one with --ball NAME.",
        )
    return BallSetup.preset(_DEFAULT_BALL)


def choose_cor(ball: bodies.Ball, option: str) -> tuple[CorLaw, bool]:
    """The law requested by ``--cor``, and whether it is the ball's own fitted law.

    ``variable`` is the ball's law, ``constant`` its value at zero speed (as the paper defines its
    constant law), anything else a number or a formula in v.

    Raises
    ------
    UsageError
        If the text is none of these.
    """
    if option == "variable":
        return ball.cor, True
    if option == "constant":
        return ConstantCor(float(ball.cor(0.0))), False
    return parse_cor_law(option), False


def choose_drag(option: str) -> float | DragCurve:
    """``--drag``: a number, or the name of a drag curve.

    Raises
    ------
    UsageError
        If it is neither.
    """
    try:
        number = float(option)
    except ValueError:
        return drag_curve(option)
    return measurands.DRAG_COEFFICIENT.require(number, option)


def experiment_of(setup: Setup, ball: bodies.Ball, drag_option: str | None = None) -> Experiment:
    """Bodies and air of the setup; the paper's where it states none."""
    effects = setup.model.effects
    drag = setup.model.parameters.get("drag", {}).get("drag_coefficient", SUBCRITICAL_DRAG)
    chosen: float | DragCurve = drag if "drag" in effects else 0.0
    if drag_option is not None:
        chosen = choose_drag(drag_option)
    return Experiment(
        ball,
        setup.pendulum or bodies.PAPER_PENDULUM,
        setup.support or bodies.PAPER_SUPPORT,
        setup.air,
        bodies.GRAVITY,
        chosen,
    )


@dataclass(frozen=True)
class AskedExperiment:
    """The requested experiment and its law of restitution.

    Attributes
    ----------
    campaign : BallLaw or None
        Origin of the law, if it is from a campaign.
    ball : BallSetup or None
        The requested ball.
    uncertain : tuple of (UncertaintySource, Experiment)
        The experiment with one uncertain input larger by its standard uncertainty, for each.
    """

    experiment: Experiment
    law: CorLaw
    campaign: BallLaw | None = None
    ball: BallSetup | None = None
    uncertain: tuple[tuple[UncertaintySource, Experiment], ...] = ()

    def scatter_at(self, speed: float | None, scatter: PlanScatter) -> PlanScatter:
        """Trial-to-trial variation, with the uncertainty of a campaign's law at a speed, m/s."""
        if self.campaign is None or speed is None:
            return scatter
        return self.campaign.scatter_at(speed, scatter)


def asked(
    setup: Setup, ball: str | None, cor: str, drag: str | None, cor_law: Path | None = None
) -> AskedExperiment:
    """Combine setup and options: ball, restitution and drag.

    Raises
    ------
    UsageError
        If an option is unknown; SetupError if the file of laws can't be read.
    """
    chosen = ball_asked(setup, ball)
    struck = chosen.body()
    campaign = None if cor_law is None else law_of_ball(read_cor_file(cor_law), struck.name)
    if campaign is not None:
        struck = campaign.struck(struck)
    law, own = choose_cor(struck, cor)
    experiment = experiment_of(setup, struck, drag)
    uncertain = _uncertain_inputs(setup, chosen, experiment)
    return AskedExperiment(experiment, law, campaign if own else None, chosen, uncertain)


def _uncertain_inputs(
    setup: Setup, ball: BallSetup, experiment: Experiment
) -> tuple[tuple[UncertaintySource, Experiment], ...]:
    rig, body = rig_of(setup, ball), experiment.pendulum

    def pendulum(**larger: float) -> Experiment:
        return replace(experiment, pendulum=replace(body, **larger))

    def heavier(mass: float) -> Experiment:
        return replace(experiment, ball=replace(experiment.ball, mass=mass))

    def wider(diameter: float) -> Experiment:
        return replace(experiment, ball=replace(experiment.ball, diameter=diameter))

    def support(height: float) -> Experiment:
        return replace(experiment, support=bodies.Support(height))

    def air(density: float) -> Experiment:
        return replace(experiment, air=replace(experiment.air, density=density))

    def drag(coefficient: float) -> Experiment:
        return replace(experiment, drag_coefficient=coefficient)

    tried: list[tuple[UncertaintySource, RigNumber | None, Callable[[float], Experiment]]] = [
        (UncertaintySource.PENDULUM_INERTIA, rig.inertia, lambda x: pendulum(inertia=x)),
        (UncertaintySource.PENDULUM_LENGTH, rig.length, lambda x: pendulum(length=x)),
        (UncertaintySource.PENDULUM_MASS, rig.pendulum_mass, lambda x: pendulum(mass=x)),
        (UncertaintySource.CENTRE_OF_MASS, rig.com, lambda x: pendulum(com=x)),
        (
            UncertaintySource.EFFECTIVE_MASS,
            rig.effective_mass,
            lambda x: pendulum(effective_mass=x),
        ),
        (UncertaintySource.SUPPORT_HEIGHT, rig.support_height, support),
        (UncertaintySource.BALL_MASS, rig.ball_mass, heavier),
        (UncertaintySource.BALL_DIAMETER, rig.ball_diameter, wider),
        (UncertaintySource.AIR_DENSITY, rig.air_density, air),
    ]
    if experiment.drag_coefficient == rig.drag_coefficient.value:
        tried.append((UncertaintySource.DRAG_COEFFICIENT, rig.drag_coefficient, drag))
    return tuple(
        (source, moved(known.value + known.std))
        for source, known, moved in tried
        if known is not None and known.std_from is Origin.SETUP
    )


def scatter_of(setup: Setup, ball: BallSetup | None = None) -> PlanScatter:
    """The setup's standard deviations; default 0.2 deg, 0.2 deg, 0.005, 0.01 and 0.3 deg.

    The uncertainty of the ball's launch angle is given with the angle.
    """
    stated = None if ball is None else ball.launch_angle_std
    given = {} if stated is None else {"launch_angle_law": stated}
    given |= {
        name: value
        for name in ("backswing", "launch_angle", "cor", "cor_law", "launch_angle_law")
        if (value := getattr(setup.scatter, name)) is not None
    }
    return PlanScatter(**given)


def quantities_document(
    quantities: Sequence[Quantity], warnings: Sequence[str], **extra: Any
) -> dict[str, Any]:
    """The contract's ``{"quantities": …, "warnings": …}`` with any further keys."""
    table = {
        one.name: {"value": one.value, "std": one.std, "unit": one.unit}
        if one.known
        else {"value": None, "unit": one.unit, "reason": one.reason}
        for one in quantities
    }
    return {"quantities": table, "warnings": list(warnings), **extra}


_UNIT_SUFFIX = {"1": "", "m/s": "_m_s", "N s": "_N_s"}


def quantities_as_csv(quantities: Sequence[Quantity]) -> str:
    """One row; columns NAME_UNIT and NAME_UNIT_std as in the contract."""
    row: dict[str, object] = {}
    for quantity in quantities:
        name = quantity.name + _UNIT_SUFFIX.get(quantity.unit, f"_{quantity.unit}")
        row[name] = quantity.value
        row[f"{name}_std"] = quantity.std
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(row), lineterminator="\n")
    writer.writeheader()
    writer.writerow(row)
    return text.getvalue()


def send_out(
    title: str,
    quantities: Sequence[Quantity],
    warnings: Sequence[str],
    *,
    json_to: str | None,
    csv_to: Path | None,
    quiet: bool,
) -> None:
    """Write the requested output: JSON, CSV, and a table on stdout unless JSON goes there."""
    if csv_to is not None:
        write_text_whole(csv_to, quantities_as_csv(quantities))
    if not write_json(quantities_document(quantities, warnings), json_to) and not quiet:
        screen().print(_table(title, quantities))
    if not quiet:
        shell = screen(errors=True)
        for warning in warnings:
            shell.print(f"warning: {warning}", soft_wrap=True)


def _table(title: str, quantities: Sequence[Quantity]) -> Table:
    table = Table(title=title)
    table.add_column("quantity")
    table.add_column("value", justify="right")
    table.add_column("std", justify="right")
    table.add_column("unit")
    for quantity in quantities:
        if quantity.value is None or quantity.std is None:
            table.add_row(quantity.name, "–", "", quantity.reason or quantity.unit)
            continue
        digits = 4
        if quantity.std > 0.0:
            digits = min(max(1 - math.floor(math.log10(quantity.std)), 0), 8)
        std = f"{quantity.std:.{digits}f}" if quantity.std > 0.0 else "exact"
        table.add_row(quantity.name, f"{quantity.value:.{digits}f}", std, quantity.unit)
    return table


_BASELINE = ("gravity", "drag")


def parse_effect(text: str) -> Term:
    """Read ``ID`` or ``ID:NAME=VALUE,NAME=VALUE``.

    Raises
    ------
    UsageError
        For an unknown effect or parameter, or a value that is not a number.
    """
    name, _, rest = text.partition(":")
    effect, given = catalogue.effect_named(name.strip()), {}
    for part in filter(None, rest.split(",")):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals:
            raise UsageError(
                f"--effect {text!r}: {part!r} sets no number",
                hint="Write --effect magnus:spin=10.",
            )
        try:
            given[key] = read_parameter(effect.id, key, value).value
        except SetupError as problem:
            raise UsageError(
                f"--effect {text!r}: {problem.message}", hint=problem.hint
            ) from problem
    return _added(effect.id, given)


def _added(name: str, given: Mapping[str, float]) -> Term:
    effect = catalogue.effect_named(name)
    known = [p.name for p in effect.parameters]
    if unknown := sorted(set(given) - set(known)):
        raise UsageError(
            f"the effect {name!r} has no parameter {unknown[0]!r}",
            hint=f"Its parameters: {', '.join(known)}.",
        )
    if effect.phase == "measurement":
        raise UsageError(
            f"{name!r} is an error of the recording, not of the motion",
            hint="Use `vision render` to put it into a clip, `vision explain` to find it in one.",
        )
    if missing := [p.name for p in effect.strengths if p.name not in given]:
        raise UsageError(
            f"the effect {name!r} needs a value for {', '.join(missing)}",
            hint=f"Write --effect {name}:{missing[0]}=VALUE, or [model.{name}] in the setup file.",
        )
    return Term(effect, {**effect.neutral, **given})


def added_effects(setup: Setup, options: tuple[str, ...]) -> tuple[Term, ...]:
    """Effects of the setup's [model] and of the command line, besides gravity and drag."""
    named = [
        _added(name, setup.model.parameters.get(name, {}))
        for name in setup.model.effects
        if name not in _BASELINE
    ]
    return (*named, *(parse_effect(text) for text in options))


def speed_with_losses(experiment: Experiment, backswing: float, effects: tuple[Term, ...]) -> float:
    """Impact speed (m/s) from a back-swing angle (rad), with all effects of the swing."""
    pendulum, angle = experiment.pendulum, experiment.ball.launch_angle
    start = start_angle(backswing, effects)
    if not any(added.brakes for added in effects):
        return float(frictionless_speed(pendulum, start, angle, experiment.gravity))
    return swing(
        pendulum, start, angle, terms=effects, gravity=experiment.gravity, samples=2
    ).speed_at_contact


def start_angle(backswing: float, effects: tuple[Term, ...]) -> float:
    """Actual start angle (rad) of the pendulum."""
    start = backswing
    for added in effects:
        if added.alters_start:
            start = float(np.asarray(added.effect.start(added.values, start)))
    return start


def alter_outcome(
    experiment: Experiment,
    speed: float,
    cor: float,
    outcome: ContactOutcome,
    effects: tuple[Term, ...],
) -> ContactOutcome:
    """The outcome of the contact (floats), with the effects that change it."""
    acting = [added for added in effects if added.alters_contact]
    if not acting:
        return outcome
    pendulum, ball = experiment.pendulum, experiment.ball
    contact = catalogue.Contact(
        speed / pendulum.length,
        ball.launch_angle,
        pendulum.length,
        pendulum.inertia,
        ball.mass,
        ball.diameter,
        cor,
        experiment.gravity,
    )
    handed = catalogue.Outcome(
        outcome.contact_time,
        outcome.pendulum_speed_after,
        outcome.pendulum_angle,
        outcome.ball_x,
        outcome.ball_y,
        0.0,
        outcome.ball_vx,
        outcome.ball_vy,
        0.0,
    )
    for added in acting:
        handed = added.effect.contact(added.values, contact, handed)
    return replace(
        outcome,
        contact_time=float(np.asarray(handed.contact_time)),
        pendulum_speed_after=float(np.asarray(handed.pendulum_speed)),
        pendulum_angle=float(np.asarray(handed.pendulum_angle)),
        ball_x=float(np.asarray(handed.x)),
        ball_y=float(np.asarray(handed.y)),
        ball_vx=float(np.asarray(handed.vx)),
        ball_vy=float(np.asarray(handed.vy)),
    )


def flights_figure(
    experiment: Experiment, impulsive: FlightPath, turned: FlightPath | None
) -> "Picture":
    """The ball's path from the paper's launch and from the time-resolved contact."""
    from pipelines.report.plots import BLUE, GRAY, ORANGE, styled_figure

    with styled_figure() as figure:
        axes = figure.subplots()
        axes.axhline(experiment.ball.radius, color=GRAY, lw=0.8, ls=":")
        for flight, colour, label in (
            (impulsive, BLUE, "impulsive launch (steps a to e)"),
            (turned, ORANGE, "time-resolved contact"),
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
) -> "Picture":
    """Distance against back-swing angle (rad), the wanted point, and the extrapolated range."""
    from pipelines.report.plots import BLUE, GRAY, ORANGE, styled_figure

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
        axes.plot([], [], color=GRAY, lw=1.0, ls="--", label="outside the fitted speeds")
        axes.legend(loc="upper left")
    return figure


SIMULATED_UNITS = {
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

MIN_COR = 1e-3
"""Lower limit of a shifted COR, 1: a law needs e > 0, and every ball that flies has more."""


@dataclass(frozen=True)
class Shift:
    """One draw of the trial-to-trial variation."""

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
    e = min(max(float(law(speed)) + shift.cor, MIN_COR), 1.0)
    return StrikeInputs(
        moved, released, speed, e, float(ball.contact_time(speed)) + shift.contact_time
    )


def simulate_contacts(strikes: list[StrikeInputs]) -> ContactOutcome:
    """Simulate all contacts in time, at once."""
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
    """One strike's numbers, and its flights from the paper's launch and the resolved contact."""
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
    """The impulsive launch of Eqs 8 to 10, 13 and 14 as the outcome of a contact."""
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
    flight : FlightPath
        The numerical path from the paper's launch, with all forces.
    contact_flight : FlightPath or None
        The path from the time-resolved contact; None if that contact can't be simulated.
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
    uncertain: Sequence[tuple[UncertaintySource, Experiment]] = (),
) -> Simulation:
    """Steps a to e of the paper from a back-swing angle (rad) or an impact speed (m/s).

    Parameters
    ----------
    backswing, impact_speed : float, optional
        Exactly one of them, rad or m/s.
    cor : CorLaw, optional
        Default: the ball's law.
    scatter : PlanScatter
        For the standard uncertainties.
    effects : tuple of Term
        Further effects of the catalogue.
    uncertain : sequence of (UncertaintySource, Experiment)
        The experiment with one uncertain input larger by its standard uncertainty, for each.

    Raises
    ------
    UsageError
        If both or neither of back-swing and impact speed are given.
    DomainError
        For inputs outside the range of every law.
    """
    if (backswing is None) == (impact_speed is None):
        raise UsageError(
            "pass either a back-swing angle or an impact speed",
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
    for source, moved in uncertain:
        struck = strike_inputs(moved, backswing, impact_speed, law, effects, Shift())
        contact = None if why else simulate_contacts([struck]).at(0)
        others.append((source, strike_numbers(struck, contact, effects)[0]))
    budgets = {
        name: (*_budget(name, runs, sources), *_by_uncertain(name, best, others)) for name in best
    }
    quantities = [
        Quantity.measured(name, value, SIMULATED_UNITS[name], budgets[name])
        for name, value in best.items()
    ]
    if contact_flight is None:
        quantities += [
            Quantity.missing(n, unit, why)
            for n, unit in SIMULATED_UNITS.items()
            if n not in best and "model" in n
        ]
    warnings = _warnings(experiment, best["impact_speed"], law, best["ball_speed"])
    return Simulation(tuple(quantities), warnings, flight, contact_flight)


def _contacts(strikes: list[StrikeInputs]) -> tuple[list[ContactOutcome | None], str]:
    """Outcomes of the time-resolved contacts, or None for each and the reason."""
    try:
        followed = simulate_contacts(strikes)
        return [followed.at(i) for i in range(len(strikes))], ""
    except DomainError as problem:
        return [None] * len(strikes), problem.message


def _sources(
    scatter: PlanScatter, by_backswing: bool
) -> list[tuple[UncertaintySource, tuple[Shift, Shift]]]:
    """Trial-to-trial variations, each one standard deviation down and up."""
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


def _by_uncertain(
    name: str, best: dict[str, float], others: list[tuple[UncertaintySource, dict[str, float]]]
) -> tuple[Contribution, ...]:
    """Change of a quantity per uncertain input, by one standard uncertainty."""
    return tuple(Contribution(source, abs(other[name] - best[name])) for source, other in others)


def _warnings(
    experiment: Experiment, speed: float, law: CorLaw, highest_speed: float
) -> tuple[str, ...]:
    ball, air = experiment.ball, experiment.air
    notes = list(air.notes)
    low, high = ball.cor_range
    if law == ball.cor and not low * 0.98 <= speed <= high * 1.02:
        notes.append(
            f"the impact speed {speed:.3f} m/s is outside {low:.2f} to {high:.2f} m/s, the fitted"
            f" range of the {ball.name}'s law of restitution: extrapolated"
        )
    reynolds = air.reynolds(highest_speed, ball.diameter)
    if isinstance(experiment.drag_coefficient, DragCurve):
        notes += experiment.drag_coefficient.notes(0.3 * reynolds, reynolds)
    elif reynolds > 1.5e5:
        notes.append(
            f"at Re = {reynolds:.2g} the drag coefficient may drop (drag crisis);"
            " it is assumed constant here"
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
    """Simulate a strike and the subsequent flight.

    Example: vision simulate --backswing "90 deg" --ball jokku --effect magnus:spin=10
    """
    known = setup_from(setup)
    wanted = asked(known, ball, cor, drag, cor_law)
    released = (
        None if backswing is None else read_number(backswing, measurands.BACKSWING, "--backswing")
    )
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
        uncertain=wanted.uncertain,
    )
    send_out(
        f"{wanted.experiment.ball.name}, simulated",
        result.quantities,
        result.warnings,
        json_to=json_to,
        csv_to=csv_to,
        quiet=quiet,
    )
    if plot is not None:
        from pipelines.report.plots import save_figure

        save_figure(flights_figure(wanted.experiment, result.flight, result.contact_flight), plot)


_CONTACT_ANGLE = ("backswing_angle_contact_model", "deg")


@dataclass(frozen=True)
class Planning:
    """The numbers of a plan."""

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
    """Back-swing and speed for `distance` (m), with the variable and the constant COR.

    Parameters
    ----------
    distance : float
        m.
    cor : CorLaw, optional
        Default: the ball's law.

    Raises
    ------
    DomainError
        If the pendulum can't reach the distance.
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
    constant = _at_rest(law)
    if constant is not None and not isinstance(law, ConstantCor):
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


def _at_rest(law: CorLaw) -> ConstantCor | None:
    """The constant COR of the paper, at zero speed; None for a power law of the speed."""
    try:
        return ConstantCor(float(law(0.0)))
    except DomainError:
        return None


def _alternative(
    experiment: Experiment, distance: float, law: CorLaw, scatter: PlanScatter | None
) -> list[Quantity]:
    """The same plan with the constant COR of the paper, if it reaches the distance."""
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
    """Angle and speed with the time-resolved instead of the instantaneous contact."""
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
            return [Quantity.missing(name, unit, "not reachable with time-resolved contact")]
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
            f"the impact speed {found.impact_speed:.3f} m/s is outside {low:.2f} to {high:.2f}"
            f" m/s, the fitted range of the {experiment.ball.name}'s law of restitution:"
            " the plan is an extrapolation"
        )
    return tuple(notes)


def planned_figure(experiment: Experiment, law: CorLaw, planned: Planning) -> "Picture":
    """Plot distance against back-swing for both laws, with the plan."""
    low, high = experiment.ball.cor_range
    pendulum, ball = experiment.pendulum, experiment.ball
    angles = np.linspace(1.5 * ball.launch_angle, math.pi, 90)
    speeds = np.asarray(frictionless_speed(pendulum, angles, ball.launch_angle, experiment.gravity))

    def distances(by: CorLaw) -> FloatArray:
        launch = impulsive_launch(experiment, speeds, np.asarray(by(speeds)))
        return np.asarray(numerical_landing(experiment, launch).distance)

    curves = {"variable COR": distances(law)}
    constant = _at_rest(law)
    if constant is not None:
        curves["constant COR"] = distances(constant)
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
        Path | None, typer.Option(help="Plot distance by angle: .png or .svg."), FileRole.WRITES
    ] = None,
    quiet: NoTableOption = False,
) -> None:
    """Find the back-swing angle and impact speed for a landing distance.

    Example: vision plan --distance 2.5m --ball jokku

    For the number of strikes a law of restitution needs, see: vision plan campaign --help
    """
    known = setup_from(setup)
    wanted = asked(known, ball, cor, drag, cor_law)
    metres = read_number(distance, measurands.DISTANCE, "--distance")
    scatter = scatter_of(known, wanted.ball)
    planned = plan(wanted.experiment, metres, cor=wanted.law, scatter=scatter)
    if wanted.campaign is not None:
        # the law's uncertainty depends on the planned speed
        scatter = wanted.scatter_at(planned.plan.impact_speed, scatter)
        planned = plan(wanted.experiment, metres, cor=wanted.law, scatter=scatter)
    send_out(
        f"{wanted.experiment.ball.name}, {distance}",
        planned.quantities,
        planned.warnings,
        json_to=json_to,
        csv_to=csv_to,
        quiet=quiet,
    )
    if plot is not None:
        from pipelines.report.plots import save_figure

        save_figure(planned_figure(wanted.experiment, wanted.law, planned), plot)
