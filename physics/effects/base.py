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

A number that a law leaves open, and what is known of it beforehand.

The forms that several laws of one id come in.

An effect at work: a law with values for its parameters, in all of a batch or in some.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, StrEnum
from functools import cached_property
from types import EllipsisType
from typing import ClassVar, Literal, TypeAlias

import numpy as np

from physics.domain import FloatArray, Number, Vector

__all__ = [
    "LARGEST_SIZE",
    "CameraView",
    "Contact",
    "Coordinate",
    "Effect",
    "EffectId",
    "Extent",
    "FlightState",
    "Form",
    "Level",
    "Outcome",
    "Parameter",
    "Phase",
    "Size",
    "SwingState",
    "Term",
    "Values",
]

OUTLIER_COST = 12.0

"""Chi-square units for a value from the list of outliers: odds of one to four hundred."""

USUAL = 6.0

"""Widths up to which a value is no outlier: beyond six standard deviations a Gaussian prior has
odds of one in 5e8, below those of `OUTLIER_COST`."""

OUTLIER_WIDTH = 0.005

"""Relative width of such a value: a wrong frame rate or ruler is wrong by a round factor, read as
well as a nominal rate is kept, half a per cent."""


class EffectId(StrEnum):
    """Ids of the effects that a law or a search treats apart: decisions compare these."""

    GRAVITY = "gravity"
    """Always in a model; no entry of the catalogue."""
    DRAG = "drag"
    MAGNUS = "magnus"
    DRAG_CRISIS = "drag_crisis"
    TIME_BASE = "time_base"
    LENGTH_SCALE = "length_scale"
    CAMERA_ROLL = "camera_roll"
    ORIGIN_OFFSET = "origin_offset"
    UNNAMED = "unnamed"
    """Whatever is in no catalogue: several may stand in one model."""


class Extent(Enum):
    """What a campaign stretches a shape's grid, scale and lower bound over.

    They are then given in shares of it: 0 where it begins, 1 where it ends; of a length or a
    duration, in shares of its size.
    """

    FIXED = "fixed"
    RECORD_TIME = "record time"
    FLIGHT_TIME = "flight time"
    WAY = "way"
    HEIGHT = "height"
    LENGTH_OF_WAY = "length of the way"


class Size(Enum):
    """What the bodies of a campaign multiply a parameter's scale and bounds, or its width, by."""

    ONE = "1"
    BALL_WEIGHT = "m g of the ball"
    PENDULUM_TORQUE = "m g d of the pendulum, over that of the paper's"
    SPIN = "speed of the ball over its radius"
    BOARD = "air density times the fifth power of the pendulum's length"


LARGEST_SIZE = {
    Size.ONE: 1.0,
    Size.BALL_WEIGHT: 10.0,
    Size.PENDULUM_TORQUE: 10.0,
    Size.SPIN: 3300.0,
    Size.BOARD: 10.0,
}
"""What each can be where the bodies are not known yet: a golf ball leaves its tee with 70 m/s at
21 mm radius (3300 /s); balls and pendulums that people strike and swing in a laboratory weigh at
most ten newtons, and ten times the paper's torque."""


class Level(Enum):
    """What shares one value of a law's strengths; below the campaign they scatter about a mean."""

    CAMPAIGN = "campaign"
    SESSION = "session"
    BALL = "ball"
    TRIAL = "trial"


@dataclass(frozen=True)
class Parameter:
    """A number that an effect's law leaves open.

    Attributes
    ----------
    name : str
        As in results and setup files.
    unit : str
        "1" for none.
    scale : float
        Size that would be unremarkable; the width of its prior.
    lower, upper : float
        What nature allows. A fit outside rejects the effect.
    neutral : float
        Value at which the effect vanishes.
    grid : tuple of float
        For a shape (a place, a width, an exponent), which says where the law acts but not how
        strongly: values to try first. Empty for a strength.
    meaning : str
        In words.
    width : float
        Standard deviation of what is found in practice: a ruler is read within a few per cent.
        A size far beyond it counts against the effect. Infinite where the bounds say it all.
    expected : float, optional
        What nature is known to give it, with that width; the neutral value if not given.
    outliers : tuple of float
        Values that do happen, far beyond the width (a clip played back at half its rate).
    over : Extent
        What the grid is stretched over; as it stands by default.
    in_units_of : Size
        What scale and bounds are multiplied by; nothing by default.
    width_in : Size
        Likewise for the width.
    """

    name: str
    unit: str
    scale: float
    lower: float
    upper: float
    neutral: float = 0.0
    grid: tuple[float, ...] = ()
    meaning: str = ""
    width: float = float("inf")
    expected: float | None = None
    outliers: tuple[float, ...] = ()
    over: Extent = Extent.FIXED
    in_units_of: Size = Size.ONE
    width_in: Size = Size.ONE

    @property
    def is_shape(self) -> bool:
        """Whether the parameter says where or how, but not how much."""
        return bool(self.grid)

    @property
    def is_known(self) -> bool:
        """Whether nature gives it a size other than none."""
        return self.expected is not None and self.expected != self.neutral

    @property
    def is_held(self) -> bool:
        """Whether it is one weight of many, each held near nothing by its width."""
        return self.expected is not None and self.expected == self.neutral

    def believable(self, value: float) -> bool:
        """Whether a value is within bounds and, where outliers are listed, usual or one of them."""
        edge = 1e-6 * max(abs(self.lower), abs(self.upper))
        if not self.lower - edge <= value <= self.upper + edge:
            return False
        near = abs(value - self.neutral) <= USUAL * self.width
        reach = 2.0 * OUTLIER_WIDTH
        return (
            not self.outliers
            or near
            or any(abs(value - one) <= reach * (1.0 + abs(one)) for one in self.outliers)
        )

    def prior_penalty(self, value: float) -> float:
        """What a value costs in chi-square units by its prior: a Gaussian, and rare spikes."""
        middle = self.neutral if self.expected is None else self.expected
        plain = ((value - middle) / self.width) ** 2
        spikes = (
            OUTLIER_COST + ((value - one) / (OUTLIER_WIDTH * (1.0 + abs(one)))) ** 2
            for one in self.outliers
        )
        return float(min(plain, *spikes)) if self.outliers else float(plain)


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
    DIRECTION = "direction"
    """Of the velocity above the horizontal."""
    ORDER = "order"
    """Of the trials."""


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

    @cached_property
    def speed(self) -> FloatArray:
        """|v|, m/s."""
        squares = np.square(self.vx) + np.square(self.vy) + np.square(self.vz)
        speed: FloatArray = np.sqrt(np.asarray(squares, dtype=np.float64))
        return speed

    @property
    def direction(self) -> FloatArray:
        """Of the velocity, rad above the horizontal."""
        across = np.hypot(np.asarray(self.vx, dtype=np.float64), self.vz)
        return np.asarray(np.arctan2(self.vy, across))

    def along(self, coordinate: Coordinate) -> Number:
        """Where the ball is along a coordinate of a law; the speed where it has none in flight."""
        places: dict[Coordinate, Number] = {
            Coordinate.TIME: self.time,
            Coordinate.PLACE: self.x,
            Coordinate.HEIGHT: self.y,
            Coordinate.ORDER: self.order,
        }
        if coordinate is Coordinate.DIRECTION:
            return self.direction
        return places.get(coordinate, self.speed)

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


STICTION_RATE = 0.02
"""rad/s below which dry friction is smoothed at least, so that a pendulum may come to rest."""


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
    gained : Number
        Rate that the weight adds within a step of the solver, rad/s.
    """

    phi: Number
    omega: Number
    inertia: Number
    mass: Number
    com: Number
    length: Number
    gravity: Number
    order: Number = 0.0
    gained: Number = 0.0

    @property
    def sense(self) -> Number:
        """Sign of the motion, smoothed over a step about a turning point.

        A sign that jumps between two steps leaves an error of a step's friction. This one goes too
        far on either side by as much as a hyperbolic tangent is short of it, in the first moment:
        neither rate nor place after the turning point differ from those of a jump.
        """
        short = np.tanh(self.omega / np.maximum(np.abs(self.gained), STICTION_RATE))
        return short * (1.0 + math.pi**2 / 12.0 * (1.0 - np.square(short)))


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
class CameraView:
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
    planar : bool
        Whether it is a fault of one camera that sees a plane: places in space come from several
        cameras, or other instruments.
    by_air : bool
        Whether the air does it, which then resists the motion as well.
    levels : tuple of Level
        At which its strengths may live: a coefficient of drag differs from ball to ball, a draught
        from day to day, the spin of a throw from throw to throw.
    level : Level
        At which they do in this one.
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
    planar: bool = False
    by_air: bool = False
    levels: tuple[Level, ...] = (Level.CAMPAIGN,)
    level: Level = Level.CAMPAIGN
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
        if mine not in _OVERRIDDEN:
            _OVERRIDDEN[mine] = frozenset(
                name for name in Effect.HOOKS if getattr(mine, name) is not getattr(Effect, name)
            )
        return _OVERRIDDEN[mine]

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

    def image(self, values: Values, view: CameraView) -> Vector:
        """Where the recording puts the ball, m."""
        return view.x, view.y, view.z

    def angle(self, values: Values, view: CameraView) -> Number:
        """Angle that the recording gives the pendulum, rad."""
        return view.phi


_OVERRIDDEN: dict[type[Effect], frozenset[str]] = {}
"""Hooks that each kind of effect overrides: they are asked for in every step of every march."""


class Form(StrEnum):
    """Which of several laws of one id; the value is what verdicts print.

    A user's own effect may have any text as its form.
    """

    ARM = "arm"
    MASS = "mass"
    GEOMETRY = "geometry"
    RUBBING_FACE = "rubbing face"
    SMOOTH_FACE = "smooth face"
    TURNED_FACE = "turned face"
    TURNED_ON_ARM = "face turned on the arm"
    WHOLE_CONTACT = "whole contact"
    UNTIL_LIFT_OFF = "until lift-off"
    BALL_ALONE = "ball alone"
    OVER_A_WAY = "over a way"
    WAY_ALONE = "way alone"
    PENDULUM_ALONE = "pendulum alone"
    LINEAR = "linear"
    POWER = "power"
    VISCOELASTIC = "viscoelastic"
    CONSTANT_TORQUE = "constant torque"
    UNDER_LOAD = "under load"
    STRIBECK = "Stribeck"
    GIVING = "gives before it slips"
    FALLING = "falls with the rate"
    GIVING_FALLING = "gives before it slips and falls with the rate"
    OF_IMPACT_SPEED = "of impact speed"
    OF_VERTICAL_SPEED = "of vertical speed"
    CONSTANT = "constant"
    WHOLE_VELOCITY = "whole velocity"
    KICK_AT_RELEASE = "kick at release"
    ABOUT_THE_ORIGIN = "about the origin"
    ABOUT_THE_START = "about the start"
    ABOUT_A_POINT = "about a point"
    THREE_AXES = "three axes"
    PERSPECTIVE = "perspective"
    LEANING = "leaning plane"
    TWO_TERMS = "two radial terms"
    BALL_ONLY = "ball only"
    OTHER_ROWS = "other rows"
    SPIN_VECTOR = "spin about any axis"
    SATURATING = "saturating"
    SATURATING_VECTOR = "saturating, spin about any axis"
    STEADILY = "steadily"
    BY_REYNOLDS_NUMBER = "by Reynolds number"
    THICKENING_LAYER = "a layer that thickens"
    RECOVERING = "recovers beyond the crisis"
    BY_THE_SQUARE = "with the square of the spin"
    TWO_THIRDS = "with the power two thirds"
    THREE_HALVES = "with the power three halves"
    HELD_BY_THE_FLOOR = "held back by the floor"
    ALONG_AND_UP = "along the flight, rising or sinking"
    FROM_ANY_SIDE = "from any side"
    FROM_ANYWHERE = "from anywhere"


@dataclass(frozen=True)
class Term:
    """An effect with the values of its parameters.

    Attributes
    ----------
    effect : Effect
    values : mapping of str to Number
        A number each, or arrays that broadcast with the members of the batch it acts in.
    where : slice or Ellipsis
        Members along the batch's first axis in which the effect acts; Ellipsis: in all.
    """

    effect: Effect
    values: Mapping[str, Number]
    where: slice | EllipsisType = ...

    @property
    def flies(self) -> bool:
        """Whether it puts a force on the ball in flight."""
        return "force" in self.effect.hooks

    @property
    def brakes(self) -> bool:
        """Whether it puts a torque on the pendulum."""
        return "torque" in self.effect.hooks

    @property
    def alters_contact(self) -> bool:
        """Whether it changes what the contact hands over."""
        return "contact" in self.effect.hooks

    @property
    def alters_start(self) -> bool:
        """Whether it changes where the pendulum starts from."""
        return "start" in self.effect.hooks
