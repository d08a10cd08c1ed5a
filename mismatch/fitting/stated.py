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
    FlightState,
    Outcome,
    Parameter,
    Phase,
    SwingState,
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
    "ball_mass": "mass of the ball",
    "diameter": "diameter of the ball",
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
    """Relative errors of the stated pendulum and ball, shared by all trials."""

    id: str = "stated_inputs"
    statement: str = "Mass, size or inertia differ from what the setup states."
    law: str = r"x = x_0\,(1 + \delta)"
    source: str = "derived: first order in each error"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = ()
    sharp: bool = False

    def _error(self, values: Values, name: str) -> Number:
        return values.get(name, 0.0)

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Weight's torque over inertia, changed by their errors."""
        change = (
            self._error(values, "pendulum_mass")
            + self._error(values, "com")
            - self._error(values, "inertia")
        )
        weight = swing.mass * swing.gravity * swing.com * np.sin(swing.phi)
        return -weight * change

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Speeds after contact, by the ratio of the two masses that meet."""
        fraction = contact.ball_mass / (contact.inertial_mass + contact.ball_mass)
        speed = np.hypot(outcome.vx, outcome.vy)
        change = (
            fraction * speed * (self._error(values, "inertia") - self._error(values, "ball_mass"))
        )
        return add_normal_speeds(contact, outcome, change, change)

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Drag over mass, changed by the errors of mass and diameter."""
        change = 2.0 * self._error(values, "diameter") - self._error(values, "ball_mass")
        k = -flight.dynamic_area * flight.drag_coefficient * flight.speed * change
        return k * flight.vx, k * flight.vy, k * flight.vz


@dataclass(frozen=True)
class UsualInputs(StatedInputs):
    """Errors of stated inputs and of instruments as careful laboratories have them."""

    id: str = USUAL_INPUTS
    statement: str = "Inputs and instruments are off by what careful laboratories have."
    separating: str = "the masses weighed and the scale, level and clock measured once more"
    looseness: float = 0.0

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Masses as in `StatedInputs`; a longer pendulum is faster at its face, and lighter."""
        longer = self._error(values, "length")
        masses = dict(values) | {"inertia": self._error(values, "inertia") - 2.0 * longer}
        found = super().contact(masses, contact, outcome)
        return add_normal_speeds(
            contact, found, longer * np.hypot(outcome.vx, outcome.vy), 0.0 * longer
        )

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Drag over mass, changed by the errors of air, mass and diameter."""
        denser = self._error(values, "air_density")
        masses = dict(values) | {"ball_mass": self._error(values, "ball_mass") - denser}
        return super().force(masses, flight)

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
