"""Inputs of a measurement; names and units of quantities."""

import math
from dataclasses import dataclass, replace
from enum import StrEnum

from measuring.setup.file import BallSetup, Origin, Rig, Setup, ball_from_option, rig_of
from metrology import measurands, read_given
from physics import bodies
from physics.air import Air
from vision.tracks import MotionKind

__all__ = [
    "LENGTHLESS_UNITS",
    "QUANTITY_UNITS",
    "TIMELESS_UNITS",
    "Assumption",
    "Inputs",
    "QuantityName",
    "gather_inputs",
    "in_pixels",
    "kinds_of",
    "main_quantities",
    "quantities_except",
]

UNKNOWN_DRAG = 0.02
"""1/m, value and std of ½ρSC_D/m for a ball of unknown mass (the paper's balls: 0.018 to 0.02;
lighter ones: 0.02 to 0.05)."""

UNKNOWN_LIFT_STD = 0.02
"""1/s, std of lift per speed of such a ball at the assumed spin (the paper's balls: 0.02)."""


@dataclass(frozen=True)
class Assumption:
    """A value that is assumed since it was not given.

    Attributes
    ----------
    sentence : str
        What is assumed, its consequence and the option.
    concerned : frozenset of str
        Names of the quantities that depend on it.
    """

    sentence: str
    concerned: frozenset[str]


@dataclass(frozen=True)
class Inputs:
    """Prior knowledge, SI; None: neither given nor preset.

    Attributes
    ----------
    setup : Setup
        As read.
    ball : BallSetup or None
        The struck ball.
    pendulum : Pendulum
        The given one, or that of the paper.
    fall : float or None
        Height of fall from rest to landing (height of the support), m.
    gravity : float
        m/s².
    grid_pitch, fine_pitch : float
        m.
    rig : Rig
        Every property of the apparatus with its uncertainty and source.
    assumed : tuple of str
        Warnings about values taken from the paper.
    arm_factor : float
        Factor on the pendulum's arm, whose visible side is in front of the ball plane.
    after_factor : float
        Factor on the pendulum's rate after contact, for bar vibration and occlusion by the ball.
    normal_sigmas : float
        Shift of the probability that a round bob's contact normal is the line of centres, in
        standard uncertainties.
    """

    setup: Setup
    ball: BallSetup | None
    pendulum: bodies.Pendulum
    fall: float | None
    air: Air
    gravity: float
    grid_pitch: float
    fine_pitch: float
    rig: Rig
    assumed: tuple[Assumption, ...]
    arm_factor: float = 1.0
    after_factor: float = 1.0
    normal_sigmas: float = 0.0

    @property
    def pendulum_stiffness(self) -> float:
        """Ω² = m g d / I of the free swing, 1/s²."""
        body = self.pendulum
        return body.mass * self.gravity * body.com / body.inertia

    def fitted_alike(self, other: "Inputs") -> bool:
        """Whether the fits have the same inputs; other inputs only affect derived values."""
        body = self.pendulum
        if self.rig.length.value_from is Origin.PRESET:
            # a given length places the pivot
            body = replace(body, length=other.pendulum.length)
        same = replace(self, pendulum=body, arm_factor=other.arm_factor)
        same = replace(same, after_factor=other.after_factor, normal_sigmas=other.normal_sigmas)
        return same == other

    @property
    def drag_per_metre(self) -> tuple[float, float]:
        """K = ρ S C_D / 2 m with its std, 1/m; a default if the mass is unknown."""
        if self.ball is None or self.ball.mass is None:
            return UNKNOWN_DRAG, UNKNOWN_DRAG
        area = math.pi * self.ball.diameter**2 / 4
        per_coefficient = 0.5 * self.air.density * area / self.ball.mass
        drag = self.rig.drag_coefficient
        std = math.hypot(drag.std, drag.value * self.rig.air_density.relative_std)
        return drag.value * per_coefficient, std * per_coefficient

    @property
    def lift_std(self) -> float:
        """Lift per speed from an unobserved slow spin, 1/s: ½ ρ S R ω / m."""
        if self.ball is None or self.ball.mass is None:
            return UNKNOWN_LIFT_STD
        radius = self.ball.diameter / 2
        area = math.pi * radius**2
        return 0.5 * self.air.density * area * radius * self.rig.spin.std / self.ball.mass


def chosen_ball(setup: Setup, ball: str | None) -> BallSetup | None:
    """The ball of the option, or of the setup file if that has one.

    Raises
    ------
    UsageError
        If the option is neither preset nor diameter.
    """
    if ball is not None:
        return setup.balls.get(ball) or ball_from_option(ball)
    if setup.ball is None and len(setup.balls) == 1:
        return next(iter(setup.balls.values()))
    return setup.ball


def gather_inputs(setup: Setup, ball: str | None, wall_grid: str | None) -> Inputs:
    """Merge setup file and options; options take precedence.

    Raises
    ------
    UsageError
        If an option is no quantity, preset or pitch, or out of range.
    """
    chosen = chosen_ball(setup, ball)
    if wall_grid is not None:
        squares = read_given(wall_grid, measurands.GRID_PITCH, "--wall-grid")
        wall = replace(setup.wall, grid=squares.value, grid_std=squares.std)
        setup = replace(setup, wall=wall)
    rig = rig_of(setup, chosen)
    pitch = rig.grid_pitch.value
    assumed: list[Assumption] = []
    pendulum = setup.pendulum
    if pendulum is None:
        pendulum = bodies.PAPER_PENDULUM
        assumed.append(
            Assumption(
                "No pendulum given: the one of Ryu et al. (6.0 kg, 1.579 kg m²) is assumed. COR,"
                " impulse and energy hold only for that pendulum. Set [pendulum] in the setup"
                " file.",
                frozenset(_OF_THE_PENDULUM),
            )
        )
    fall = None if rig.support_height is None else rig.support_height.value
    if rig.support_height is not None and rig.support_height.value_from is Origin.PRESET:
        assumed.append(
            Assumption(
                "No support height given: 0.312 m (Ryu et al.) is assumed. Landing and its COR hold"
                " only for that height. Set [support] height in the setup file.",
                frozenset(OF_THE_SUPPORT),
            )
        )
    return Inputs(
        setup=setup,
        ball=chosen,
        pendulum=pendulum,
        fall=fall,
        air=setup.air,
        gravity=rig.gravity.value,
        grid_pitch=pitch,
        fine_pitch=setup.wall.fine_grid or pitch / 5,
        rig=rig,
        assumed=tuple(assumed),
    )


class QuantityName(StrEnum):
    """Name of a quantity, as in the files."""

    CONTACT_FRAMES = "contact_frames"
    CONTACT_TIME = "contact_time"
    CONTACT_START = "contact_start"
    CONTACT_END = "contact_end"
    PENDULUM_SPEED_BEFORE = "pendulum_speed_before"
    PENDULUM_SPEED_AFTER = "pendulum_speed_after"
    BALL_SPEED = "ball_speed"
    LAUNCH_ANGLE = "launch_angle"
    LANDING_DISTANCE = "landing_distance"
    LANDING_DISTANCE_ON_WALL = "landing_distance_on_wall"
    LANDING_TIME = "landing_time"
    COR_SPEEDS = "cor_speeds"
    COR_LAUNCH = "cor_launch"
    COR_RANGE = "cor_range"
    COR = "cor"
    EXTERNAL_IMPULSE = "external_impulse"
    ENERGY_LOSS = "energy_loss"
    BACKSWING_ANGLE = "backswing_angle"
    BALL_PLANE_OFFSET = "ball_plane_offset"
    CAMERA_DISTANCE = "camera_distance"
    FALL_ACCELERATION = "fall_acceleration"
    FLIGHT_SPEED = "flight_speed"
    FLIGHT_ANGLE = "flight_angle"
    SWING_PERIOD = "swing_period"
    SWING_DAMPING = "swing_damping"
    SPEED_BEFORE = "speed_before"
    SPEED_AFTER = "speed_after"
    OTHER_SPEED_BEFORE = "other_speed_before"
    OTHER_SPEED_AFTER = "other_speed_after"
    COR_COLLISION = "cor_collision"
    COR_BOUNCE = "cor_bounce"
    ROLL_ACCELERATION = "roll_acceleration"
    ROLL_SPEED = "roll_speed"
    FALL_ACCELERATION_PX = "fall_acceleration_px"
    FLIGHT_SPEED_PX = "flight_speed_px"
    SPEED_BEFORE_PX = "speed_before_px"
    SPEED_AFTER_PX = "speed_after_px"
    OTHER_SPEED_BEFORE_PX = "other_speed_before_px"
    OTHER_SPEED_AFTER_PX = "other_speed_after_px"
    ROLL_ACCELERATION_PX = "roll_acceleration_px"
    ROLL_SPEED_PX = "roll_speed_px"


_STRIKE_ONLY = (MotionKind.STRIKE,)

_FALL = (MotionKind.FLIGHT, MotionKind.DROP)

_MET = (MotionKind.COLLISION,)

_ROLLS = (MotionKind.ROLL, MotionKind.SLIDE)

_ANY_KIND = tuple(MotionKind)

_QUANTITY_TABLE: dict[QuantityName, tuple[str, tuple[MotionKind, ...]]] = {
    QuantityName.CONTACT_FRAMES: ("1", _STRIKE_ONLY + _MET),
    QuantityName.CONTACT_TIME: ("s", _STRIKE_ONLY + _MET),
    QuantityName.CONTACT_START: ("s", _STRIKE_ONLY + _MET),
    QuantityName.CONTACT_END: ("s", _STRIKE_ONLY + _MET),
    QuantityName.PENDULUM_SPEED_BEFORE: ("m/s", _STRIKE_ONLY),
    QuantityName.PENDULUM_SPEED_AFTER: ("m/s", _STRIKE_ONLY),
    QuantityName.BALL_SPEED: ("m/s", _STRIKE_ONLY),
    QuantityName.LAUNCH_ANGLE: ("deg", _STRIKE_ONLY),
    QuantityName.LANDING_DISTANCE: ("m", _STRIKE_ONLY),
    QuantityName.LANDING_DISTANCE_ON_WALL: ("m", _STRIKE_ONLY),
    QuantityName.LANDING_TIME: ("s", _STRIKE_ONLY),
    QuantityName.COR_SPEEDS: ("1", _STRIKE_ONLY),
    QuantityName.COR_LAUNCH: ("1", _STRIKE_ONLY),
    QuantityName.COR_RANGE: ("1", _STRIKE_ONLY),
    QuantityName.COR: ("1", _STRIKE_ONLY),
    QuantityName.EXTERNAL_IMPULSE: ("N s", _STRIKE_ONLY),
    QuantityName.ENERGY_LOSS: ("J", _STRIKE_ONLY),
    QuantityName.BACKSWING_ANGLE: ("deg", _STRIKE_ONLY),
    QuantityName.BALL_PLANE_OFFSET: ("m", _ANY_KIND),
    QuantityName.CAMERA_DISTANCE: ("m", _ANY_KIND),
    QuantityName.FALL_ACCELERATION: ("m/s^2", _FALL),
    QuantityName.FLIGHT_SPEED: ("m/s", _FALL),
    QuantityName.FLIGHT_ANGLE: ("deg", _FALL),
    QuantityName.SWING_PERIOD: ("s", (MotionKind.SWING,)),
    QuantityName.SWING_DAMPING: ("1/s", (MotionKind.SWING,)),
    QuantityName.SPEED_BEFORE: ("m/s", _MET),
    QuantityName.SPEED_AFTER: ("m/s", _MET),
    QuantityName.OTHER_SPEED_BEFORE: ("m/s", _MET),
    QuantityName.OTHER_SPEED_AFTER: ("m/s", _MET),
    QuantityName.COR_COLLISION: ("1", _MET),
    QuantityName.COR_BOUNCE: ("1", (MotionKind.BOUNCE,)),
    QuantityName.ROLL_ACCELERATION: ("m/s^2", _ROLLS),
    QuantityName.ROLL_SPEED: ("m/s", _ROLLS),
}

QUANTITY_UNITS: dict[str, str] = {name.value: unit for name, (unit, _) in _QUANTITY_TABLE.items()}


OF_THE_SUPPORT = (
    QuantityName.LANDING_DISTANCE,
    QuantityName.LANDING_DISTANCE_ON_WALL,
    QuantityName.LANDING_TIME,
    QuantityName.COR_RANGE,
    QuantityName.COR,
)
_OF_THE_PENDULUM = (
    QuantityName.COR_SPEEDS,
    QuantityName.COR_LAUNCH,
    QuantityName.COR_RANGE,
    QuantityName.COR,
    QuantityName.EXTERNAL_IMPULSE,
    QuantityName.ENERGY_LOSS,
)
"""Quantities that depend on the height of the support, and on the pendulum's properties."""

TIMELESS_UNITS = frozenset({"1", "deg", "m", "px"})
LENGTHLESS_UNITS = frozenset({"1", "deg", "s", "1/s", "px", "px/s", "px/s^2"})
"""Units of quantities that a wrong rate, or a wrong scale, leaves unchanged."""


def quantities_except(units: frozenset[str]) -> frozenset[str]:
    """Quantities in other units."""
    return frozenset(name for name, unit in QUANTITY_UNITS.items() if unit not in units)


"""Quantities of every clip, in order; ``cor`` is the mean of the estimates."""

_IN_PIXELS = {
    QuantityName.FALL_ACCELERATION: QuantityName.FALL_ACCELERATION_PX,
    QuantityName.FLIGHT_SPEED: QuantityName.FLIGHT_SPEED_PX,
    QuantityName.SPEED_BEFORE: QuantityName.SPEED_BEFORE_PX,
    QuantityName.SPEED_AFTER: QuantityName.SPEED_AFTER_PX,
    QuantityName.OTHER_SPEED_BEFORE: QuantityName.OTHER_SPEED_BEFORE_PX,
    QuantityName.OTHER_SPEED_AFTER: QuantityName.OTHER_SPEED_AFTER_PX,
    QuantityName.ROLL_ACCELERATION: QuantityName.ROLL_ACCELERATION_PX,
    QuantityName.ROLL_SPEED: QuantityName.ROLL_SPEED_PX,
}


def in_pixels(name: QuantityName) -> QuantityName:
    """Name of the same quantity in pixels, used without a scale."""
    return _IN_PIXELS[name]


def kinds_of(name: str) -> tuple[MotionKind, ...]:
    """Motions in which a quantity can be measured."""
    entry = _QUANTITY_TABLE.get(QuantityName(name))
    return _ANY_KIND if entry is None else entry[1]


_MAIN: dict[MotionKind, tuple[QuantityName, ...]] = {
    MotionKind.STRIKE: (
        QuantityName.CONTACT_TIME,
        QuantityName.PENDULUM_SPEED_BEFORE,
        QuantityName.BALL_SPEED,
        QuantityName.LAUNCH_ANGLE,
        QuantityName.LANDING_DISTANCE,
        QuantityName.COR,
    ),
    MotionKind.SWING: (QuantityName.SWING_PERIOD, QuantityName.SWING_DAMPING),
    MotionKind.COLLISION: (
        QuantityName.CONTACT_TIME,
        QuantityName.SPEED_BEFORE,
        QuantityName.SPEED_AFTER,
        QuantityName.OTHER_SPEED_BEFORE,
        QuantityName.OTHER_SPEED_AFTER,
        QuantityName.COR_COLLISION,
    ),
    **dict.fromkeys(
        (*_FALL, MotionKind.BOUNCE),
        (
            QuantityName.FALL_ACCELERATION,
            QuantityName.FLIGHT_SPEED,
            QuantityName.FLIGHT_ANGLE,
            QuantityName.COR_BOUNCE,
        ),
    ),
    **dict.fromkeys(_ROLLS, (QuantityName.ROLL_ACCELERATION, QuantityName.ROLL_SPEED)),
}


def main_quantities(kind: MotionKind) -> tuple[QuantityName, ...]:
    """At most six quantities that describe a motion; with their std twelve columns.

    Where no scale is known, those in pixels take their places.
    """
    main = _MAIN.get(kind, ())
    return main + tuple(_IN_PIXELS[name] for name in main if name in _IN_PIXELS)
