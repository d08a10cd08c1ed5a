"""Keep stated inputs uncertain within what the setup states."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from physics.domain import Number, Vector
from physics.effects import (
    Contact,
    Effect,
    FlightState,
    Outcome,
    Parameter,
    Phase,
    SwingState,
    Values,
)
from physics.effects.impact import add_normal_speeds

__all__ = ["STATED_INPUTS", "StatedInputs", "stated_inputs"]

STATED_INPUTS = {
    "inertia": "moment of inertia of the pendulum",
    "pendulum_mass": "mass of the pendulum",
    "com": "distance of the pendulum's centre of mass",
    "ball_mass": "mass of the ball",
    "diameter": "diameter of the ball",
}
"""Inputs whose stated uncertainty every fit keeps, and what they are."""


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
