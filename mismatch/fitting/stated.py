"""Keep inputs uncertain within what is stated or a careful laboratory has."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from physics.domain import Number, Vector
from physics.effects import (
    CameraView,
    Contact,
    Effect,
    EffectId,
    Outcome,
    Parameter,
    Phase,
    Values,
)
from physics.effects.impact import add_normal_speeds

__all__ = [
    "STATED_INPUTS",
    "USUAL_INPUTS",
    "StatedInputs",
    "UsualInputs",
    "stated_inputs",
    "usual_inputs",
]

STATED_INPUTS = {
    "inertia": "moment of inertia of the pendulum",
    "pendulum_mass": "mass of the pendulum",
    "com": "distance of the pendulum's centre of mass",
    "length": "length of the pendulum",
    "ball_mass": "mass of the ball",
    "diameter": "diameter of the ball",
    "air_density": "density of the air",
}
"""Inputs whose stated uncertainty every fit keeps, and what they are."""

CAREFUL = (
    ("inertia", "1", 0.002, ()),
    ("pendulum_mass", "1", 0.001, ()),
    ("com", "1", 0.001, ()),
    ("length", "1", 0.001, ()),
    ("ball_mass", "1", 0.001, ()),
    ("diameter", "1", 0.001, ()),
    ("air_density", "1", 0.01, ()),
    ("scale", "1", 0.001, (EffectId.LENGTH_SCALE,)),
    ("level", "rad", 0.001, (EffectId.CAMERA_ROLL,)),
    ("zero", "rad", 0.001, (EffectId.CAMERA_ROLL,)),
    ("rate", "1", 0.0003, (EffectId.TIME_BASE,)),
    ("origin_x", "m", 0.001, (EffectId.ORIGIN_OFFSET,)),
    ("origin_y", "m", 0.001, (EffectId.ORIGIN_OFFSET,)),
)
"""Input, unit, standard uncertainty in a careful laboratory, and the effects that are that error
itself. Convention: masses and lengths read to 0.1 %; an inertia from a period timed to 0.1 %; a
rule of 1 m whose ends are marked to 1 mm gives scale, level, zero of the angle and origin; air from
a barometer and a thermometer; a clock between quartz (50 ppm) and a rounded rate (1000/1001)."""

USUAL_INPUTS = "usual_inputs"
"""Id of what a careful laboratory leaves open."""


@dataclass(frozen=True)
class StatedInputs(Effect):
    """Relative errors of the stated pendulum, ball and air, shared by all trials."""

    id: str = "stated_inputs"
    statement: str = "Mass, size or inertia differ from what the setup states."
    law: str = r"x = x_0\,(1 + \delta)"
    source: str = "derived: first order in each error"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = ()
    sharp: bool = False

    def _error(self, values: Values, name: str) -> Number:
        return values.get(name, 0.0)

    def inputs(self, values: Values) -> Values:
        """Bodies and air as they are."""
        return {name: 1.0 + off for name, off in values.items() if name in STATED_INPUTS}

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Speeds after contact, by the ratio of the two masses that meet.

        A longer pendulum is faster at its face, and lighter.
        """
        fraction = contact.ball_mass / (contact.inertial_mass + contact.ball_mass)
        speed, longer = np.hypot(outcome.vx, outcome.vy), self._error(values, "length")
        heavier = self._error(values, "inertia") - 2.0 * longer - self._error(values, "ball_mass")
        change = fraction * speed * heavier
        return add_normal_speeds(contact, outcome, change + longer * speed, change)


@dataclass(frozen=True)
class UsualInputs(StatedInputs):
    """Errors of stated inputs and of instruments as careful laboratories have them."""

    id: str = USUAL_INPUTS
    statement: str = "Inputs and instruments are off by what careful laboratories have."
    separating: str = "the masses weighed and the scale, level and clock measured once more"
    looseness: float = 0.0

    def clock(self, values: Values, time: Number) -> Number:
        """A frame rate that is not quite the nominal one."""
        return time / (1.0 + self._error(values, "rate"))

    def image(self, values: Values, view: CameraView) -> Vector:
        """Scale and level about the ball's rest position, and the place of the origin."""
        scale, level = self._error(values, "scale"), self._error(values, "level")
        across, up = view.x - view.rest_x, view.y - view.rest_y
        return (
            view.x + scale * across - level * up + self._error(values, "origin_x"),
            view.y + scale * up + level * across + self._error(values, "origin_y"),
            view.z,
        )

    def angle(self, values: Values, view: CameraView) -> Number:
        """The pendulum's angle, its zero off."""
        return view.phi + self._error(values, "zero")


def usual_inputs(stated: Collection[Effect], besides: Collection[str]) -> Effect:
    """What a careful laboratory leaves open beyond what its setup states.

    Parameters
    ----------
    stated : effects
        What is open already.
    besides : ids
        Of effects that are named: an error of the ruler is one, whatever its size.
    """
    known = {p.name for effect in stated for p in effect.parameters}
    parameters = tuple(
        Parameter(name, unit, width, -0.5, 0.5, width=width, expected=0.0)
        for name, unit, width, same in CAREFUL
        if name not in known and not set(same).intersection(besides)
    )
    return UsualInputs(parameters=parameters)


def stated_inputs(relative: Mapping[str, float | None]) -> tuple[Effect, ...]:
    """The open errors of a setup; none where it states no uncertainty.

    Parameters
    ----------
    relative : mapping
        Key of `STATED_INPUTS` → relative standard uncertainty, None where none is stated.
    """
    parameters = tuple(
        Parameter(
            name, "1", std, -0.5, 0.5, width=std, expected=0.0, meaning=f"error of the {what}"
        )
        for name, what in STATED_INPUTS.items()
        for std in (relative.get(name),)
        if std
    )
    return (StatedInputs(parameters=parameters),) if parameters else ()
