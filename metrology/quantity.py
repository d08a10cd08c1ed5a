"""Measured quantities with uncertainty budget (GUM), and their formatting.

Printed uncertainties have two significant digits (GUM 7.2.6).
"""

import math
from dataclasses import dataclass
from enum import StrEnum

__all__ = [
    "Contribution",
    "Quantity",
    "UncertaintySource",
    "format_pair",
    "format_quantity",
    "format_unit",
    "format_value",
]


class UncertaintySource(StrEnum):
    """An input whose uncertainty enters a result (GUM 3.3); the value is its printed name.

    Decisions compare members, never the text.
    """

    TRACK_NOISE = "noise of the tracks"
    CAPTURE_RATE = "capture rate"
    RELEASE_INSTANT = "moment of release"
    FRAME_COUNT = "onset and release between frames"
    COR_MEAN = "balance of rigid bodies"
    PENDULUM_INERTIA = "inertia of the pendulum"
    PENDULUM_LENGTH = "length of the pendulum"
    PENDULUM_MASS = "mass of the pendulum"
    CENTRE_OF_MASS = "pivot to centre of mass"
    PENDULUM_ARM = "depth of the mass' visible side"
    PENDULUM_ZERO = "zero of the pendulum's angle"
    PENDULUM_PIVOT = "pivot of the pendulum in the picture"
    PENDULUM_RINGING = "pendulum just after contact"
    CONTACT_NORMAL = "direction of a round bob's contact"
    SUPPORT_HEIGHT = "height of the support"
    BALL_MASS = "mass of the ball"
    CAMERA_ROLL = "roll of the camera (no grid)"
    CAMERA_SLANT = "tilt of the camera (no grid)"
    SCALE = "scale of lengths"
    PERSPECTIVE = "depth of the motion's plane"
    DRAG = "drag of the air"
    ROLL_CHANGE = "change of the acceleration along the line"
    CONTRADICTION = "contradiction between estimates"

    GRID_LINES = "grid lines"
    GRID_PITCH = "pitch of the grid"
    LENS_UNKNOWN = "lens not calibrated"
    LENS_CALIBRATION = "lens calibration"
    CAMERA_DISTANCE = "measured camera distance"
    CAMERA_X = "measured camera position, x"
    CAMERA_Y = "measured camera position, y"
    AXIS_FOOT_X = "measured axis foot, x"
    AXIS_FOOT_Y = "measured axis foot, y"
    BALL_PLANE_OFFSET = "measured ball plane offset"
    BALL_DIAMETER = "ball diameter"
    FREE_FALL = "free fall"
    BALL_PLANE_GUESS = "assumed ball plane offset"
    BALL_CENTRE = "ball in the picture"

    TRIAL_SCATTER = "variation between trials"
    COR = "coefficient of restitution"
    LAUNCH_ANGLE = "launch angle"
    CONTACT_TIME = "contact time"
    BACKSWING = "back-swing"
    DISTANCE = "distance"
    EFFECTIVE_MASS = "effective mass"
    DRAG_COEFFICIENT = "drag coefficient"
    AIR_DENSITY = "air density"
    GRAVITY = "gravity"
    SUPPORT = "support height"
    MASS_OF_BALL = "ball mass"

    @property
    def shared_by_setup(self) -> bool:
        """Whether all clips of one laboratory and one setup file share its error.

        Errors of single clips (noise, the camera's position for it) average out over a campaign;
        shared ones do not.
        """
        return self not in _SOURCES_OF_ONE_CLIP


_SOURCES_OF_ONE_CLIP = frozenset(
    {
        UncertaintySource.TRACK_NOISE,
        UncertaintySource.RELEASE_INSTANT,
        UncertaintySource.FRAME_COUNT,
        UncertaintySource.PENDULUM_ZERO,
        UncertaintySource.PENDULUM_PIVOT,
        UncertaintySource.DRAG,
        UncertaintySource.CONTRADICTION,
        UncertaintySource.GRID_LINES,
        UncertaintySource.FREE_FALL,
        UncertaintySource.BALL_CENTRE,
        UncertaintySource.TRIAL_SCATTER,
        UncertaintySource.COR,
        UncertaintySource.LAUNCH_ANGLE,
        UncertaintySource.CONTACT_TIME,
        UncertaintySource.BACKSWING,
        UncertaintySource.DISTANCE,
    }
)


@dataclass(frozen=True)
class Contribution:
    """One line of an uncertainty budget.

    Attributes
    ----------
    source : UncertaintySource
        The input the uncertainty comes from.
    std : float
        Its contribution to the quantity's uncertainty (k = 1), in the quantity's unit.
    """

    source: UncertaintySource
    std: float


@dataclass(frozen=True)
class Quantity:
    """A value with uncertainty, or the reason why there is none.

    Attributes
    ----------
    name : str
        Name as in the results table ("launch_angle").
    value : float or None
        Best estimate; None where it could not be measured.
    std : float or None
        Combined standard uncertainty, k = 1.
    unit : str
        Unit of value and std ("m", "s", "deg", "m/s", "1").
    reason : str or None
        Why there is no value.
    budget : tuple of Contribution
        Independent contributions whose root sum of squares is `std`.
    """

    name: str
    value: float | None
    std: float | None
    unit: str
    reason: str | None = None
    budget: tuple[Contribution, ...] = ()

    @classmethod
    def measured(
        cls, name: str, value: float, unit: str, budget: tuple[Contribution, ...]
    ) -> "Quantity":
        """Build a quantity whose standard uncertainty is the root sum of squares of its budget."""
        std = math.sqrt(sum(line.std**2 for line in budget))
        return cls(name, float(value), std, unit, None, budget)

    @classmethod
    def missing(cls, name: str, unit: str, reason: str) -> "Quantity":
        """Build a quantity that could not be measured, with the reason why."""
        return cls(name, None, None, unit, reason)

    @property
    def known(self) -> bool:
        """Whether there is a value."""
        return self.value is not None


_UNIT_SIGNS = {"1": "", "deg": "°"}

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_MIN_PLAIN, _MAX_PLAIN = 1e-4, 1e6
"""Range, in the number's unit, outside which a power of ten is written (convention: printf's
%g)."""


def format_quantity(quantity: Quantity) -> str:
    """Format a quantity: ``"6.361 ± 0.012 m/s"``, or why there is none."""
    if quantity.value is None:
        return f"not measured: {quantity.reason}" if quantity.reason else "not measured"
    return format_value(quantity.value, quantity.std, quantity.unit)


def format_value(value: float, std: float | None, unit: str) -> str:
    """Format value, standard uncertainty (omitted if unknown) and unit."""
    suffix = format_unit(unit)
    gap = "" if suffix in ("", "°") else " "
    size = max(abs(value), std or 0.0)
    exponent = 0
    if math.isfinite(size) and size > 0 and not _MIN_PLAIN <= size < _MAX_PLAIN:
        exponent = math.floor(math.log10(size))
    if std is None and not exponent:
        return f"{format_pair(value, None)[0]}{gap}{suffix}"
    scale = 10.0**exponent
    printed, spread = format_pair(value / scale, None if std is None else std / scale)
    body = printed if spread is None else f"{printed} ± {spread}"
    if exponent:
        power = str(exponent).translate(_SUPERSCRIPT)
        body = f"({body})·10{power}" if spread is not None else f"{body}·10{power}"
    elif suffix == "°" and spread is not None:
        return f"({body})°"
    return f"{body}{gap}{suffix}"


def format_pair(value: float, std: float | None) -> tuple[str, str | None]:
    """Format value and standard uncertainty, both to two significant digits of the latter.

    Parameters
    ----------
    std : float or None
        Standard uncertainty; without one (or with zero) the value gets six digits.

    Returns
    -------
    value, std : str
        `std` is None where none is known.
    """
    if std is None:
        return f"{value:.6g}", None
    if std == 0 or not math.isfinite(std):
        return f"{value:.6g}", f"{std:g}"
    # Rounding 0.0996 to two digits gives 0.10: count the digits after rounding.
    place = math.floor(math.log10(float(f"{std:.1e}"))) - 1
    if place >= 0:
        return f"{round(value, -place):.0f}", f"{round(std, -place):.0f}"
    return f"{value:.{-place}f}", f"{std:.{-place}f}"


def format_unit(unit: str) -> str:
    """Format a unit for readers: nothing for 1, ° for deg, m/s² for m/s^2."""
    return _UNIT_SIGNS.get(unit, unit.replace("^2", "²"))
