"""Effect model: base class, parameters, states and hooks of the effect catalogue.

The same effect object serves simulator, renderer and mismatch engine. It overrides one or more
hooks. Every hook is a pure function of the effect's parameter values and of a state whose entries
are floats or arrays that broadcast together (trials, parameter sets), and changes nothing at the
parameters' neutral values.

==========  ==================================================================================
hook        returns
==========  ==================================================================================
force       force on the ball in flight, N, along x, y, z of the world
torque      torque on the pendulum, N m, positive forward
start       true back-swing angle, rad
contact     state of ball and pendulum at release
clock       true time since contact onset, s, for the recorded time
image       recorded position of the ball, m
angle       recorded angle of the pendulum, rad
==========  ==================================================================================
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
    "MAX_SIZE",
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
"""Cost of a value from the list of outliers, chi-square (chosen: odds of one to four hundred)."""

MAX_USUAL_WIDTHS = 6.0
"""Widths up to which a value is no outlier (derived: beyond, a Gaussian prior has odds of one in
5e8, below those of `OUTLIER_COST`)."""

OUTLIER_WIDTH = 0.005
"""Relative width of an outlier (chosen): a wrong frame rate or ruler is wrong by a round factor,
with the tolerance of a nominal rate, half a per cent."""


class EffectId(StrEnum):
    """Ids of the effects that code treats specially; comparisons use these."""

    GRAVITY = "gravity"
    """In every model; not in the catalogue."""
    DRAG = "drag"
    MAGNUS = "magnus"
    DRAG_CRISIS = "drag_crisis"
    TIME_BASE = "time_base"
    LENGTH_SCALE = "length_scale"
    CAMERA_ROLL = "camera_roll"
    ORIGIN_OFFSET = "origin_offset"
    UNNAMED = "unnamed"
    """A force outside the catalogue; a model may have several."""


class Extent(Enum):
    """Quantity of a campaign that scales a shape's grid, scale and lower bound.

    They are then fractions of it: 0 at its beginning, 1 at its end; for a length or a duration,
    fractions of its size.
    """

    FIXED = "fixed"
    RECORD_TIME = "record time"
    FLIGHT_TIME = "flight time"
    WAY = "way"
    HEIGHT = "height"
    LENGTH_OF_WAY = "length of the way"


class Size(Enum):
    """Factor, from the bodies of a campaign, of a parameter's scale and bounds, or its width."""

    ONE = "1"
    BALL_WEIGHT = "m g of the ball"
    PENDULUM_TORQUE = "m g d of the pendulum, over that of the paper's"
    SPIN = "speed of the ball over its radius"
    BOARD = "air density times the fifth power of the pendulum's length"


MAX_SIZE = {
    Size.ONE: 1.0,
    Size.BALL_WEIGHT: 10.0,
    Size.PENDULUM_TORQUE: 10.0,
    Size.SPIN: 3300.0,
    Size.BOARD: 10.0,
}
"""Maximum of each factor where the bodies are not known (chosen): a golf ball leaves its tee with
70 m/s at 21 mm radius (3300 /s); laboratory balls weigh at most ten newtons, and pendulums have at
most ten times the paper's torque."""


class Level(Enum):
    """Group that shares a law's strengths; below the campaign they vary about a mean."""

    CAMPAIGN = "campaign"
    SESSION = "session"
    SETTING = "setting"
    BALL = "ball"
    TRIAL = "trial"


@dataclass(frozen=True)
class Parameter:
    """A free parameter of an effect's law.

    Attributes
    ----------
    name : str
        Name in results and setup files.
    unit : str
        "1" for none.
    scale : float
        Typical size; the width of its prior.
    lower, upper : float
        Physical bounds. A fit outside rejects the effect.
    neutral : float
        Value at which the effect vanishes.
    grid : tuple of float
        For a shape (a position, a width, an exponent), which determines where the law acts but not
        how strongly: initial values. Empty for a strength.
    meaning : str
        Description.
    width : float
        Standard deviation in practice: a ruler is read to a few per cent. A size far beyond it
        counts against the effect. Infinite where the bounds suffice.
    expected : float, optional
        Natural value, with that width; the neutral value if not given.
    outliers : tuple of float
        Possible values far beyond the width (a clip played back at half its rate).
    over : Extent
        Quantity that scales the grid; none by default.
    in_units_of : Size
        Factor of scale and bounds; 1 by default.
    width_in : Size
        Factor of the width.
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
        """Whether the parameter determines where or how, not how much."""
        return bool(self.grid)

    @property
    def is_known(self) -> bool:
        """Whether its natural value is not the neutral one."""
        return self.expected is not None and self.expected != self.neutral

    @property
    def is_held(self) -> bool:
        """Whether it is one weight of many, each with a prior around neutral."""
        return self.expected is not None and self.expected == self.neutral

    def believable(self, value: float) -> bool:
        """Whether a value is within bounds and, where outliers are listed, usual or one of them."""
        edge = 1e-6 * max(abs(self.lower), abs(self.upper))
        if not self.lower - edge <= value <= self.upper + edge:
            return False
        near = abs(value - self.neutral) <= MAX_USUAL_WIDTHS * self.width
        reach = 2.0 * OUTLIER_WIDTH
        return (
            not self.outliers
            or near
            or any(abs(value - one) <= reach * (1.0 + abs(one)) for one in self.outliers)
        )

    def prior_penalty(self, value: float) -> float:
        """Negative log prior of a value, in chi-square units: a Gaussian, and rare outliers."""
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
    """Variable that a law depends on most, along which its form may deviate."""

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
    """State of a ball in flight. Shapes broadcast; SI; x along the wall, y up, z off the wall.

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
        Values in the model, for effects that build on drag or spin (1, rad/s counter-clockwise
        about z, which is back-spin).
    impact_speed : Number
        The trial's nominal impact speed, m/s.
    order : Number
        Position of the trial in the campaign, −½ for the first to ½ for the last.
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
        """Value of a coordinate of a law; the speed for those without a value in flight."""
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


MIN_SMOOTHING_RATE = 0.02
"""Minimum rate of the friction's smoothing, rad/s (chosen), so that a pendulum may come to rest."""


@dataclass(frozen=True)
class SwingState:
    """State of a swinging pendulum.

    Attributes
    ----------
    phi, omega : Number
        Angle from the lowest point, rad, and its rate, rad/s.
    inertia, mass, com, length, gravity : Number
        kg m², kg, m, m, m/s².
    order : Number
        Position of the trial in the campaign, −½ to ½.
    gained : Number
        Change of rate by the weight within a step of the solver, rad/s.
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

        A sign that changes between two steps causes an error of a step's friction. This function
        overshoots on either side by as much as a hyperbolic tangent falls short, in the first
        moment: neither rate nor angle after the turning point differ from those of a jump.
        """
        short = np.tanh(self.omega / np.maximum(np.abs(self.gained), MIN_SMOOTHING_RATE))
        return short * (1.0 + math.pi**2 / 12.0 * (1.0 - np.square(short)))


@dataclass(frozen=True)
class Contact:
    """State at the onset of a contact.

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
        Coefficient of restitution in the model at this speed.
    gravity : Number
        m/s².
    order : Number
        Position of the trial in the campaign, −½ to ½.
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
    """State at release.

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
    """State of ball and pendulum at one instant, as input of the camera effects.

    Attributes
    ----------
    time : Number
        On the recording's clock since contact onset (or since the first sample), s.
    x, y, z, vx, vy, vz : Number
        Ball, m and m/s.
    phi, omega : Number
        Pendulum, rad and rad/s.
    rest_x, rest_y : Number
        Ball's centre before the contact, or at the start of its record, m.
    centre_x, centre_y, half_width : Number
        Middle and half the width of the region of the campaign's trajectories, m.
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
    """A physical effect, or a measurement error, that a model may contain or lack.

    Attributes
    ----------
    id : str
        Id of the contract.
    statement : str
        What it means that the model lacks it, in one sentence.
    law : str
        LaTeX.
    source : str
        Reference of the law.
    phase : Phase
        Where it acts.
    parameters : tuple of Parameter
        Free parameters of the law.
    form : str
        Which of several laws with the same id; "" if there is one.
    separating : str
        The measurement that distinguishes it from those.
    requires : tuple of str
        Effects without which it has no influence.
    certain : bool
        Whether it always exists in nature, so that a model without it is surely incomplete.
    looseness : float
        Relative model discrepancy (k = 1) between apparatuses or authors after its strength is
        matched; 0 for an exact law.
    coordinate : Coordinate
        Variable along which it deviates.
    axes : int
        Number of recorded coordinates of the ball needed to detect it.
    planar : bool
        Whether it is an error of a single camera that sees a plane; positions in space come from
        several cameras or other instruments.
    by_air : bool
        Whether the air causes it, which then has drag, too.
    levels : tuple of Level
        Levels at which its strengths may vary: a drag coefficient differs between balls, a draught
        between days, the spin of a throw between throws.
    level : Level
        Level in this instance.
    sharp : bool
        Whether it may start, end or peak within a small part of the motion, which needs fine steps.
    """

    id: str
    statement: str
    law: str
    source: str
    phase: Phase
    parameters: tuple[Parameter, ...]
    form: str = ""
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
        "force", "torque", "start", "contact", "clock", "image", "angle", "inputs",
    )  # fmt: skip

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
        """Parameter values without effect; shapes take the middle of their grid."""
        return {
            p.name: p.grid[len(p.grid) // 2] if p.is_shape else p.neutral for p in self.parameters
        }

    @property
    def strengths(self) -> tuple[Parameter, ...]:
        """Parameters that determine how much."""
        return tuple(p for p in self.parameters if not p.is_shape)

    @property
    def shapes(self) -> tuple[Parameter, ...]:
        """Parameters that determine where or how."""
        return tuple(p for p in self.parameters if p.is_shape)

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Force on the ball, N."""
        raise NotImplementedError(f"{self.id} has no force on the ball")

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Torque on the pendulum, N m, positive forward."""
        raise NotImplementedError(f"{self.id} has no torque on the pendulum")

    def start(self, values: Values, backswing: Number) -> Number:
        """True back-swing angle, rad, given the nominal one."""
        return backswing

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Outcome of the contact, given the outcome without this effect."""
        return outcome

    def clock(self, values: Values, time: Number) -> Number:
        """True time since contact onset, s, given the recorded one."""
        return time

    def image(self, values: Values, view: CameraView) -> Vector:
        """Recorded position of the ball, m."""
        return view.x, view.y, view.z

    def angle(self, values: Values, view: CameraView) -> Number:
        """Recorded angle of the pendulum, rad."""
        return view.phi

    def inputs(self, values: Values) -> Values:
        """True over stated value of bodies and air, by name."""
        return {}


def rows_of(value: Number, where: slice | EllipsisType) -> Number:
    """Rows of a batch of a value that differs from row to row; one shared by all as it is."""
    return value[where] if isinstance(value, np.ndarray) and value.ndim > 1 else value


_OVERRIDDEN: dict[type[Effect], frozenset[str]] = {}
"""Hooks that each class of effect overrides, cached since every solver step needs them."""


class Form(StrEnum):
    """Which of several laws of one id; the value appears in verdicts.

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
    values : mapping of str to Number
        A number each, or arrays that broadcast with the members of the batch in which it acts.
    where : slice or Ellipsis
        Members along the batch's first axis in which the effect acts; Ellipsis for all.
    """

    effect: Effect
    values: Mapping[str, Number]
    where: slice | EllipsisType = ...

    @property
    def flies(self) -> bool:
        """Whether it has a force on the ball in flight."""
        return "force" in self.effect.hooks

    @property
    def brakes(self) -> bool:
        """Whether it has a torque on the pendulum."""
        return "torque" in self.effect.hooks

    @property
    def alters_contact(self) -> bool:
        """Whether it changes the state at release."""
        return "contact" in self.effect.hooks

    @property
    def alters_start(self) -> bool:
        """Whether it changes the pendulum's initial angle."""
        return "start" in self.effect.hooks
