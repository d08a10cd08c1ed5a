"""The quantities of the contract: their names, units, and the motions that they belong to."""

from enum import StrEnum

from vision.tracks import MotionKind

__all__ = ["QUANTITY_UNITS", "QuantityName", "in_pixels", "kinds_of"]


class QuantityName(StrEnum):
    """Name of a quantity, as files spell it."""

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
    FALL_ACCELERATION_PX = "fall_acceleration_px"
    FLIGHT_SPEED_PX = "flight_speed_px"
    SPEED_BEFORE_PX = "speed_before_px"
    SPEED_AFTER_PX = "speed_after_px"
    OTHER_SPEED_BEFORE_PX = "other_speed_before_px"
    OTHER_SPEED_AFTER_PX = "other_speed_after_px"


_STRIKE = (MotionKind.STRIKE,)
_FALL = (MotionKind.FLIGHT, MotionKind.DROP)
_MET = (MotionKind.COLLISION,)
_ANY = tuple(MotionKind)

_TABLE: dict[QuantityName, tuple[str, tuple[MotionKind, ...]]] = {
    QuantityName.CONTACT_FRAMES: ("1", _STRIKE + _MET),
    QuantityName.CONTACT_TIME: ("s", _STRIKE + _MET),
    QuantityName.CONTACT_START: ("s", _STRIKE + _MET),
    QuantityName.CONTACT_END: ("s", _STRIKE + _MET),
    QuantityName.PENDULUM_SPEED_BEFORE: ("m/s", _STRIKE),
    QuantityName.PENDULUM_SPEED_AFTER: ("m/s", _STRIKE),
    QuantityName.BALL_SPEED: ("m/s", _STRIKE),
    QuantityName.LAUNCH_ANGLE: ("deg", _STRIKE),
    QuantityName.LANDING_DISTANCE: ("m", _STRIKE),
    QuantityName.LANDING_DISTANCE_ON_WALL: ("m", _STRIKE),
    QuantityName.LANDING_TIME: ("s", _STRIKE),
    QuantityName.COR_SPEEDS: ("1", _STRIKE),
    QuantityName.COR_LAUNCH: ("1", _STRIKE),
    QuantityName.COR_RANGE: ("1", _STRIKE),
    QuantityName.COR: ("1", _STRIKE),
    QuantityName.EXTERNAL_IMPULSE: ("N s", _STRIKE),
    QuantityName.ENERGY_LOSS: ("J", _STRIKE),
    QuantityName.BACKSWING_ANGLE: ("deg", _STRIKE),
    QuantityName.BALL_PLANE_OFFSET: ("m", _ANY),
    QuantityName.CAMERA_DISTANCE: ("m", _ANY),
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
}

QUANTITY_UNITS: dict[str, str] = {name.value: unit for name, (unit, _) in _TABLE.items()}
"""Quantities that every clip answers for, in order; ``cor`` is the mean of the estimates."""

_IN_PIXELS = {
    QuantityName.FALL_ACCELERATION: QuantityName.FALL_ACCELERATION_PX,
    QuantityName.FLIGHT_SPEED: QuantityName.FLIGHT_SPEED_PX,
    QuantityName.SPEED_BEFORE: QuantityName.SPEED_BEFORE_PX,
    QuantityName.SPEED_AFTER: QuantityName.SPEED_AFTER_PX,
    QuantityName.OTHER_SPEED_BEFORE: QuantityName.OTHER_SPEED_BEFORE_PX,
    QuantityName.OTHER_SPEED_AFTER: QuantityName.OTHER_SPEED_AFTER_PX,
}


def in_pixels(name: QuantityName) -> QuantityName:
    """The name of the same quantity where no scale is known."""
    return _IN_PIXELS[name]


def kinds_of(name: str) -> tuple[MotionKind, ...]:
    """The motions in which a quantity can be measured."""
    entry = _TABLE.get(QuantityName(name))
    return _ANY if entry is None else entry[1]
