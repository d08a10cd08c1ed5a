"""What an effect is: one object that serves simulator, renderer and mismatch engine alike.

An effect overrides one or more hooks. Every hook is a pure function of the effect's parameter
values and of a state whose entries are floats or arrays that broadcast together (trials, parameter
sets), and leaves what it is given unchanged at the parameters' neutral values.

==========  ==================================================================================
hook        gives
==========  ==================================================================================
force       force on the ball in flight, N, along x, y, z of the world
torque      torque on the pendulum, N m, positive forward
start       back-swing angle that the pendulum really starts from, rad
contact     what the contact hands over to flight and swing
clock       time that really passed since contact onset, s, for what the recording's clock says
image       where the camera puts the ball, m
angle       the pendulum angle that the camera shows, rad
==========  ==================================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar, Literal, TypeAlias

import numpy as np

from physics.arrays import FloatArray, Number, Vector
from physics.effects.parameter import Extent, Parameter, Size

__all__ = [
    "Contact",
    "Coordinate",
    "Effect",
    "Extent",
    "FlightState",
    "Outcome",
    "Parameter",
    "Phase",
    "Size",
    "SwingState",
    "Values",
    "View",
]

Phase: TypeAlias = Literal["flight", "contact", "swing", "measurement"]
Values: TypeAlias = Mapping[str, Number]


class Coordinate(Enum):
    """What a law depends on most, and along which its form may thus be a little wrong."""

    SPEED = "speed"
    TIME = "time"
    HEIGHT = "height"
    PLACE = "place"
    RATE = "rate"
    ANGLE = "angle"


@dataclass(frozen=True)
class FlightState:
    """A ball in the air. Shapes broadcast; SI; x along the wall, y up from the floor, z off it.

    Attributes
    ----------
    time : Number
        Since the ball's release, s.
    x, y, z, vx, vy, vz : Number
        Centre of the ball and its velocity, m and m/s.
    mass, diameter : Number
        kg, m.
    air_density, air_viscosity, gravity : Number
        kg/m³, Pa s, m/s².
    drag_coefficient, spin : Number
        What the model holds for them, for the effects that build on drag or spin (1, rad/s
        counter-clockwise about z, which is back-spin).
    impact_speed : Number
        The trial's nominal impact speed, m/s.
    order : Number
        Place of the trial in the campaign, −½ for the first to ½ for the last.
    """

    time: Number
    x: Number
    y: Number
    z: Number
    vx: Number
    vy: Number
    vz: Number
    mass: Number
    diameter: Number
    air_density: Number
    air_viscosity: Number
    gravity: Number
    drag_coefficient: Number = 0.0
    spin: Number = 0.0
    impact_speed: Number = 0.0
    order: Number = 0.0

    @property
    def speed(self) -> FloatArray:
        """|v|, m/s."""
        squares = np.square(self.vx) + np.square(self.vy) + np.square(self.vz)
        speed: FloatArray = np.sqrt(np.asarray(squares, dtype=np.float64))
        return speed

    @property
    def area(self) -> Number:
        """Cross-section, m²."""
        return np.pi / 4.0 * np.square(self.diameter)

    @property
    def volume(self) -> Number:
        """m³."""
        return np.pi / 6.0 * np.asarray(self.diameter) ** 3

    @property
    def reynolds(self) -> Number:
        """Reynolds number ρ v d / μ (Eq. 4)."""
        return self.air_density * self.speed * self.diameter / self.air_viscosity

    @property
    def dynamic_area(self) -> Number:
        """½ρA, kg/m: a drag or lift coefficient times this times v² is a force."""
        return 0.5 * self.air_density * self.area


@dataclass(frozen=True)
class SwingState:
    """A pendulum on its way.

    Attributes
    ----------
    phi, omega : Number
        Angle from the lowest point, rad, and its rate, rad/s.
    inertia, mass, com, length, gravity : Number
        kg m², kg, m, m, m/s².
    order : Number
        Place of the trial in the campaign, −½ to ½.
    """

    phi: Number
    omega: Number
    inertia: Number
    mass: Number
    com: Number
    length: Number
    gravity: Number
    order: Number = 0.0


@dataclass(frozen=True)
class Contact:
    """What goes into a contact.

    Attributes
    ----------
    omega : Number
        Pendulum's rate at onset, rad/s.
    angle : Number
        Impact angle past the lowest point, rad.
    length, inertia : Number
        Pendulum, m and kg m².
    ball_mass, diameter : Number
        kg, m.
    restitution : Number
        What the model holds for the coefficient of restitution at this speed.
    gravity : Number
        m/s².
    order : Number
        Place of the trial in the campaign, −½ to ½.
    """

    omega: Number
    angle: Number
    length: Number
    inertia: Number
    ball_mass: Number
    diameter: Number
    restitution: Number
    gravity: Number
    order: Number = 0.0

    @property
    def impact_speed(self) -> Number:
        """Speed of the contact point at onset, m/s."""
        return self.omega * self.length

    @property
    def inertial_mass(self) -> Number:
        """I/L², kg."""
        return self.inertia / np.square(self.length)


@dataclass(frozen=True)
class Outcome:
    """What a contact hands over, at release.

    Attributes
    ----------
    contact_time : Number
        s.
    pendulum_speed, pendulum_angle : Number
        Speed of the contact point, m/s, and angle, rad.
    x, y, z, vx, vy, vz : Number
        Ball's centre, m (x from its rest position, y from the floor), and velocity, m/s.
    """

    contact_time: Number
    pendulum_speed: Number
    pendulum_angle: Number
    x: Number
    y: Number
    z: Number
    vx: Number
    vy: Number
    vz: Number


@dataclass(frozen=True)
class View:
    """What a camera sees of a ball and a pendulum at one instant.

    Attributes
    ----------
    time : Number
        On the recording's clock since contact onset (or since the first sample), s.
    x, y, z, vx, vy, vz : Number
        Ball, m and m/s.
    phi, omega : Number
        Pendulum, rad and rad/s.
    rest_x, rest_y : Number
        Ball's centre before the contact, or where its record starts, m.
    centre_x, centre_y, half_width : Number
        Middle and half the width of what the campaign's balls pass through, m.
    length : Number
        Of the pendulum, m; its lowest point is level with the resting ball.
    """

    time: Number
    x: Number
    y: Number
    z: Number
    vx: Number
    vy: Number
    vz: Number
    phi: Number
    omega: Number
    rest_x: Number
    rest_y: Number
    centre_x: Number
    centre_y: Number
    half_width: Number
    length: Number = 0.0


@dataclass(frozen=True)
class Effect:
    """A piece of physics, or a fault of the measurement, that a model may hold or lack.

    Attributes
    ----------
    id : str
        As in the contract.
    statement : str
        What it means that the model lacks it, one sentence in plain words.
    law : str
        LaTeX.
    source : str
        Where the law is from.
    phase : Phase
        Where it acts.
    parameters : tuple of Parameter
        What the law leaves open.
    form : str
        Which of several laws that go by the same id; "" if there is one.
    confusable : tuple of str
        Effects that are often taken for it; the engine tests at run time which of them are.
    separating : str
        The measurement that tells it from those.
    requires : tuple of str
        Effects without which it does nothing.
    certain : bool
        Whether nature always has it, so that a model without it lacks something for sure.
    looseness : float
        How much, relative to itself, the law differs from one apparatus or author to the next once
        its strength is matched (one sigma); 0 for what is exact.
    coordinate : Coordinate
        Along which it does.
    axes : int
        How many coordinates of the ball must be recorded for it to show.
    sharp : bool
        Whether it may start, end or peak within a small part of the motion, which takes fine steps.
    """

    id: str
    statement: str
    law: str
    source: str
    phase: Phase
    parameters: tuple[Parameter, ...]
    form: str = ""
    confusable: tuple[str, ...] = ()
    separating: str = ""
    requires: tuple[str, ...] = field(default=())
    certain: bool = False
    looseness: float = 0.1
    coordinate: Coordinate = Coordinate.SPEED
    axes: int = 1
    sharp: bool = True

    HOOKS: ClassVar[tuple[str, ...]] = (
        "force",
        "torque",
        "start",
        "contact",
        "clock",
        "image",
        "angle",
    )

    @property
    def hooks(self) -> frozenset[str]:
        """Names of the hooks that this effect overrides."""
        mine = type(self)
        return frozenset(
            name for name in Effect.HOOKS if getattr(mine, name) is not getattr(Effect, name)
        )

    @property
    def neutral(self) -> dict[str, float]:
        """Parameter values at which nothing changes; shapes take the middle of their grid."""
        return {
            p.name: p.grid[len(p.grid) // 2] if p.is_shape else p.neutral for p in self.parameters
        }

    @property
    def strengths(self) -> tuple[Parameter, ...]:
        """Parameters that say how much."""
        return tuple(p for p in self.parameters if not p.is_shape)

    @property
    def shapes(self) -> tuple[Parameter, ...]:
        """Parameters that say where or how."""
        return tuple(p for p in self.parameters if p.is_shape)

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Force on the ball, N."""
        raise NotImplementedError(f"{self.id} puts no force on the ball")

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Torque on the pendulum, N m, positive forward."""
        raise NotImplementedError(f"{self.id} puts no torque on the pendulum")

    def start(self, values: Values, backswing: Number) -> Number:
        """Back-swing angle that the pendulum starts from, rad, given the nominal one."""
        return backswing

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Outcome of the contact, given the outcome without this effect."""
        return outcome

    def clock(self, values: Values, time: Number) -> Number:
        """Time since contact onset that really passed, s, given what the clock says."""
        return time

    def image(self, values: Values, view: View) -> Vector:
        """Where the recording puts the ball, m."""
        return view.x, view.y, view.z

    def angle(self, values: Values, view: View) -> Number:
        """Angle that the recording gives the pendulum, rad."""
        return view.phi
