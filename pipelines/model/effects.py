"""Effects of the catalogue in the forward model: ``--effect magnus:spin=10``, [model] effects."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from metrology import UsageError
from physics import effects as catalogue
from physics.arrays import Number, Vector
from physics.contact.outcome import ContactOutcome
from physics.flight.forces import Acceleration
from physics.forward import Experiment
from physics.swing import frictionless_speed, swing
from pipelines.setup.file import Setup

__all__ = ["AddedEffect", "added_effects", "alter_outcome", "parse_effect", "speed_with_losses"]

_BASELINE = ("gravity", "drag")


@dataclass(frozen=True)
class AddedEffect:
    """An effect with the values of its parameters.

    Attributes
    ----------
    effect : Effect
    values : mapping of str to float
    """

    effect: catalogue.Effect
    values: Mapping[str, float]

    @property
    def flies(self) -> bool:
        """Whether it puts a force on the ball in flight."""
        return "force" in self.effect.hooks

    @property
    def swings(self) -> bool:
        """Whether it acts on the pendulum before the ball is met."""
        return bool({"torque", "start"} & self.effect.hooks)

    @property
    def alters_contact(self) -> bool:
        """Whether it changes what the contact hands over."""
        return "contact" in self.effect.hooks

    def acceleration(
        self, experiment: Experiment, speed: float, company_spin: float
    ) -> Acceleration:
        """The effect's force as an acceleration; `company_spin`: spin of all effects, rad/s."""
        ball, air = experiment.ball, experiment.air

        def accelerate(time: Number, position: Vector, velocity: Vector, spin: Vector) -> Vector:
            flight = catalogue.FlightState(
                time,
                *position,
                *velocity,
                mass=ball.mass,
                diameter=ball.diameter,
                air_density=air.density,
                air_viscosity=air.viscosity,
                gravity=experiment.gravity,
                drag_coefficient=experiment.drag_at(speed),
                spin=company_spin,
                impact_speed=speed,
            )
            x, y, z = self.effect.force(self.values, flight)
            return x / ball.mass, y / ball.mass, z / ball.mass

        return accelerate


def parse_effect(text: str) -> AddedEffect:
    """Read ``ID`` or ``ID:NAME=VALUE,NAME=VALUE``.

    Raises
    ------
    UsageError
        For an effect or parameter that is not in the catalogue, or a value that is no number.
    """
    name, _, rest = text.partition(":")
    given: dict[str, float] = {}
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        try:
            given[key.strip()] = float(value)
        except ValueError as problem:
            raise UsageError(
                f"--effect {text!r}: {part!r} sets no number",
                hint="Write --effect magnus:spin=10.",
            ) from problem
        if not equals:
            raise UsageError(f"--effect {text!r}: write NAME=VALUE, not {part!r}")
    return _added(name.strip(), given)


def _added(name: str, given: Mapping[str, float]) -> AddedEffect:
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
    return AddedEffect(effect, {**effect.neutral, **given})


def added_effects(setup: Setup, options: tuple[str, ...]) -> tuple[AddedEffect, ...]:
    """Effects of the setup's [model] and of the command line, besides gravity and drag."""
    named = [
        _added(name, setup.model.parameters.get(name, {}))
        for name in setup.model.effects
        if name not in _BASELINE
    ]
    return (*named, *(parse_effect(text) for text in options))


def speed_with_losses(
    experiment: Experiment, backswing: float, effects: tuple[AddedEffect, ...]
) -> float:
    """Impact speed (m/s) from a back-swing angle (rad), with whatever acts on the swing."""
    pendulum, angle = experiment.pendulum, experiment.ball.launch_angle
    start = backswing
    braking = []
    for added in effects:
        if "start" in added.effect.hooks:
            start = float(np.asarray(added.effect.start(added.values, start)))
        if "torque" in added.effect.hooks:
            braking.append(added)
    if not braking:
        return float(frictionless_speed(pendulum, start, angle, experiment.gravity))

    def torque(phi: float, omega: float) -> float:
        state = catalogue.SwingState(
            phi,
            omega,
            pendulum.inertia,
            pendulum.mass,
            pendulum.com,
            pendulum.length,
            experiment.gravity,
        )
        return float(sum(np.asarray(b.effect.torque(b.values, state)) for b in braking))

    return swing(
        pendulum, start, angle, torque=torque, gravity=experiment.gravity, samples=2
    ).speed_at_contact


def alter_outcome(
    experiment: Experiment,
    speed: float,
    cor: float,
    outcome: ContactOutcome,
    effects: tuple[AddedEffect, ...],
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
