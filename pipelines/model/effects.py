"""Effects of the catalogue in the forward model: ``--effect magnus:spin=10``, [model] effects."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from metrology import SetupError, UsageError
from physics import effects as catalogue
from physics.contact.contact import ContactOutcome
from physics.effects import Term
from physics.forward import Experiment
from physics.swing import frictionless_speed, swing
from pipelines.setup.file import Setup
from pipelines.setup.schema import read_parameter

__all__ = [
    "added_effects",
    "alter_outcome",
    "parse_effect",
    "speed_with_losses",
    "start_angle",
]

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
