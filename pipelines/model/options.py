"""What `simulate` and `plan` share: which ball, law and experiment, and how results go out.

Effects of the catalogue in the forward model: ``--effect magnus:spin=10``, [model] effects.
"""

import csv
import io
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from metrology import (
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
from physics.contact import ContactOutcome
from physics.effects import Term
from physics.forward import Experiment, PlanScatter
from physics.restitution import ConstantCor, CorLaw, parse_cor_law
from physics.swing import frictionless_speed, swing
from pipelines.setup.cor_file import BallLaw, law_of_ball, read_cor_file
from pipelines.setup.file import BallSetup, Setup, ball_from_option, load_setup
from pipelines.setup.rig import Origin, RigNumber, rig_of
from pipelines.setup.tables import read_parameter
from pipelines.terminal import screen

__all__ = [
    "AskedExperiment",
    "added_effects",
    "alter_outcome",
    "angle_of",
    "asked",
    "ball_asked",
    "choose_ball",
    "choose_cor",
    "choose_drag",
    "experiment_of",
    "parse_effect",
    "quantities_as_csv",
    "quantities_as_json",
    "scatter_of",
    "send_out",
    "setup_or_default",
    "speed_with_losses",
    "start_angle",
]

_DEFAULT_BALL = "jokku"


def setup_or_default(path: Path | None) -> Setup:
    """The setup file, or the paper's experiment where none is given."""
    return Setup() if path is None else load_setup(path)


def choose_ball(setup: Setup, option: str | None) -> bodies.Ball:
    """The ball of `ball_asked` as the physics needs it."""
    return ball_asked(setup, option).body()


def ball_asked(setup: Setup, option: str | None) -> BallSetup:
    """The ball of ``--ball``, of the setup file, or the paper's jokku ball.

    Raises
    ------
    UsageError
        If the option names nothing, or the setup has several balls and none is chosen.
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
    """The law that ``--cor`` asks for, and whether it is the ball's own fitted law.

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


def angle_of(text: str) -> float:
    """An angle in rad; a bare number is in degrees, as a protractor reads."""
    try:
        typed: str | float = math.radians(float(text))
    except ValueError:
        typed = text
    return read_number(typed, measurands.BACKSWING)


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
    """Bodies and air of the setup, the paper's where it is silent."""
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
    """The experiment that was asked for, and its law of restitution.

    Attributes
    ----------
    experiment : Experiment
    law : CorLaw
    campaign : BallLaw or None
        Where the law comes from, if a campaign found it.
    ball : BallSetup or None
        As asked for.
    unsure : tuple of (UncertaintySource, Experiment)
        The experiment with each number whose uncertainty the setup gives that much larger.
    """

    experiment: Experiment
    law: CorLaw
    campaign: BallLaw | None = None
    ball: BallSetup | None = None
    unsure: tuple[tuple[UncertaintySource, Experiment], ...] = ()

    def scatter_at(self, speed: float | None, scatter: PlanScatter) -> PlanScatter:
        """The scatter with what a campaign knows of the law at an impact speed, m/s."""
        if self.campaign is None or speed is None:
            return scatter
        return self.campaign.scatter_at(speed, scatter)


def asked(
    setup: Setup, ball: str | None, cor: str, drag: str | None, cor_law: Path | None = None
) -> AskedExperiment:
    """Setup and options together: which ball, with which restitution and drag.

    Raises
    ------
    UsageError
        If an option names nothing, SetupError if the file of laws can't be read.
    """
    chosen = ball_asked(setup, ball)
    struck = chosen.body()
    campaign = None if cor_law is None else law_of_ball(read_cor_file(cor_law), struck.name)
    if campaign is not None:
        struck = campaign.struck(struck)
    law, own = choose_cor(struck, cor)
    experiment = experiment_of(setup, struck, drag)
    unsure = _unsure(setup, chosen, experiment)
    return AskedExperiment(experiment, law, campaign if own else None, chosen, unsure)


def _unsure(
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
    """The setup's scatter; where it is silent, 0.2 deg, 0.2 deg, 0.005, 0.01 and 0.3 deg.

    How well the ball's launch angle is known stands beside the angle, too.
    """
    stated = None if ball is None else ball.launch_angle_std
    given = {} if stated is None else {"launch_angle_law": stated}
    given |= {
        name: value
        for name in ("backswing", "launch_angle", "cor", "cor_law", "launch_angle_law")
        if (value := getattr(setup.scatter, name)) is not None
    }
    return PlanScatter(**given)


def quantities_as_json(
    quantities: Sequence[Quantity], warnings: Sequence[str], **extra: Any
) -> str:
    """The contract's ``{"quantities": …, "warnings": …}`` with any further keys."""
    table: dict[str, Any] = {}
    for quantity in quantities:
        if quantity.known:
            table[quantity.name] = {
                "value": quantity.value,
                "std": quantity.std,
                "unit": quantity.unit,
            }
        else:
            table[quantity.name] = {
                "value": None,
                "unit": quantity.unit,
                "reason": quantity.reason,
            }
    document = {"quantities": table, "warnings": list(warnings), **extra}
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)


_UNIT_SUFFIX = {"1": "", "m/s": "_m_s", "N s": "_N_s"}


def quantities_as_csv(quantities: Sequence[Quantity]) -> str:
    """One row; columns NAME_UNIT and NAME_UNIT_std as the contract spells them."""
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
    """Write what was asked for: JSON, CSV, and a table on stdout unless JSON goes there."""
    document = quantities_as_json(quantities, warnings)
    if csv_to is not None:
        write_text_whole(csv_to, quantities_as_csv(quantities))
    if json_to not in (None, "-"):
        write_text_whole(Path(str(json_to)), document + "\n")
    if json_to == "-":
        sys.stdout.write(document + "\n")
    elif not quiet:
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
        For an effect or parameter that is not in the catalogue, or a value that is no number.
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
            f"{name!r} is a fault of the recording, not of the motion",
            hint="`vision render` puts it into a clip; `vision explain` finds it in one.",
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
    """Impact speed (m/s) from a back-swing angle (rad), with whatever acts on the swing."""
    pendulum, angle = experiment.pendulum, experiment.ball.launch_angle
    start = start_angle(backswing, effects)
    if not any(added.brakes for added in effects):
        return float(frictionless_speed(pendulum, start, angle, experiment.gravity))
    return swing(
        pendulum, start, angle, terms=effects, gravity=experiment.gravity, samples=2
    ).speed_at_contact


def start_angle(backswing: float, effects: tuple[Term, ...]) -> float:
    """Back-swing angle (rad) that the pendulum really starts from."""
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
    """What the contact hands over (floats), with the effects that act in it."""
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
