"""Defaults of missing inputs, each with uncertainty, unit and source.

All commands take such numbers from here, and results list which ones they used.
"""

import math
from dataclasses import dataclass

__all__ = ["Default", "Defaults"]


@dataclass(frozen=True)
class Default:
    """A number used until a better one is given.

    Attributes
    ----------
    name : str
        Description.
    value : float or None
        In `unit`; None where only an uncertainty is assumed.
    std : float
        Standard uncertainty: in `unit`, or relative if `relative`.
    unit : str
        SI.
    source : str
        Origin of the numbers.
    relative : bool
        Whether `std` is a fraction of the value.
    """

    name: str
    value: float | None
    std: float
    unit: str
    source: str
    relative: bool = False

    def std_of(self, value: float) -> float:
        """Standard uncertainty of a given value, in its unit."""
        return self.std * abs(value) if self.relative else self.std

    @property
    def known(self) -> float:
        """The value.

        Raises
        ------
        ValueError
            If there is none.
        """
        if self.value is None:
            raise ValueError(f"there is no default of {self.name}")
        return self.value


class Defaults:
    """Every default by name."""

    GRAVITY = Default(
        "gravity", 9.806, 0.01, "m/s^2",
        "Table 3 of the paper; on the ground between 9.780 (equator) and 9.832 (poles), a"
        " uniform distribution of standard deviation 0.015, less away from its ends",
    )  # fmt: skip
    DRAG_COEFFICIENT = Default(
        "drag coefficient", 0.47, 0.1, "1",
        "smooth sphere at Re 1e3 to 1e5 (Clift and Gauvin 1971: 0.39 to 0.51); seams, panels and"
        " a nearby drag crisis add 0.1",
    )  # fmt: skip
    SPIN = Default(
        "spin of a ball struck off a face", 0.0, 4.0, "rad/s",
        "assumed: friction at the face gives a few rad/s, invisible in most clips",
    )  # fmt: skip
    AIR_DENSITY = Default(
        "air density", 1.180, 0.02, "kg/m^3",
        "Table 3 of the paper (26 degC, dry); ±4 K and ±10 hPa elsewhere are 1.6 %",
    )  # fmt: skip
    AIR_VISCOSITY = Default(
        "viscosity of air", 1.852e-5, 0.02, "Pa s", "Table 3 of the paper; Sutherland's law is good"
        " to 2 %", relative=True,
    )  # fmt: skip
    AIR_TEMPERATURE = Default(
        "air temperature", 299.15, 1.0, "K", "Table 3 of the paper; a room's thermometer"
    )
    AIR_PRESSURE = Default(
        "air pressure", 101325.0, 1000.0, "Pa", "standard atmosphere (ISO 2533); weather at sea"
        " level varies by ±10 hPa",
    )  # fmt: skip
    HUMIDITY = Default("relative humidity", 0.5, 0.2, "1", "rooms have 20 % to 80 %")
    BALL_MASS = Default(
        "mass of the ball", None, 0.003, "kg", "kitchen scale: 1 g in 350 g", relative=True
    )
    BALL_DIAMETER = Default(
        "diameter of the ball", None, 0.002, "m", "tape around the girth: 1.3 mm in 630 mm",
        relative=True,
    )  # fmt: skip
    LAUNCH_ANGLE = Default(
        "angle of the face at contact", None, math.radians(0.3), "rad",
        "a bubble level held to the bar: a third of a degree",
    )  # fmt: skip
    PENDULUM_LENGTH = Default(
        "length of the pendulum", None, 0.002, "m", "tape from pivot to face: 1 mm in 0.55 m",
        relative=True,
    )  # fmt: skip
    PENDULUM_INERTIA = Default(
        "inertia of the pendulum", None, 0.01, "kg m^2",
        "I = m g d (T/2π)²: a period timed over ten swings by hand is good to 0.5 %, its square"
        " to 1 %; a sum of its components is no better", relative=True,
    )  # fmt: skip
    PENDULUM_MASS = Default(
        "mass of the pendulum", None, 0.01, "kg", "bathroom scale: 50 g in 6 kg", relative=True
    )
    CENTRE_OF_MASS = Default(
        "pivot to centre of mass", None, 0.015, "m", "balanced on an edge: 7 mm in 0.46 m",
        relative=True,
    )  # fmt: skip
    EFFECTIVE_MASS = Default(
        "effective mass of the pendulum", None, 0.01, "kg", "I/L², as the inertia", relative=True
    )
    SUPPORT_HEIGHT = Default("height of the support", None, 0.001, "m", "steel rule: 1 mm")
    TAPE = Default("a length measured by hand", None, 0.005, "m", "tape over metres: 5 mm")
    GRID_PITCH = Default(
        "pitch of the wall grid", 0.05, 0.001, "m",
        "the paper's grid of 50 mm; printed and hung within 0.1 %", relative=True,
    )  # fmt: skip
    PLANE_SCALE = Default(
        "scale in the plane of motion", None, 0.005, "m/px",
        "a rule held up by hand: its ends marked to 1 px each in 300 px are 0.5 %, and 1 cm off the"
        " plane at 4 m is 0.25 %", relative=True,
    )  # fmt: skip
    STICK_SCALE = Default(
        "scale of another program's track", None, 0.02, "px/m",
        "a stick nearer or farther than the motion: 2.8 % in Tracker's example BallToss",
        relative=True,
    )  # fmt: skip
    VISIBLE_DEPTH = Default(
        "depth of the mass' visible side", 0.0, 0.007, "1",
        "a mass 6 cm thick seen from 4 m: its near side, 3 cm nearer, is enlarged by 0.03/4",
    )  # fmt: skip
    RINGING = Default(
        "pendulum's rate just after contact", 0.0, 0.01, "1",
        "assumed: the bar rings after the impact, and the ball hides part of it",
    )  # fmt: skip
    PUSH_SLANT = Default(
        "angle between a contact force and the contact's normal", 0.0, 0.2 / math.sqrt(3.0), "rad",
        "assumed: friction of 0.2 tilts the force by at most 0.2 rad, uniformly (GUM 4.3.7)",
    )  # fmt: skip
    CAMERA_ROLL = Default(
        "roll of a camera set up by eye", 0.0, math.radians(1.0), "rad", "a degree is just visible"
    )
    CAMERA_SLANT = Default(
        "slant of a camera set up by eye", 0.0, math.radians(6.0), "rad",
        "converging lines of a wall are invisible below 10°: a uniform distribution of 6°",
    )  # fmt: skip
    LENS_DISTORTION = Default(
        "distortion of an uncalibrated lens", 0.0, 0.01, "1",
        "displacement of the picture's edge over its distance from the axis: lenses of cameras and"
        " phones have 0.5 % to 2 %",
    )  # fmt: skip
    PLANE_DEPTH = Default(
        "depth of the plane of motion", None, 0.01, "m",
        "the ball flies 4 cm in front of or behind the given plane, seen from 4 m",
        relative=True,
    )  # fmt: skip
    LEVEL_AXES = Default(
        "level of the axes of positions", 0.0, math.radians(0.2), "rad",
        "a horizontal edge of 1 m in view, its ends marked to 1 px each in 400 px: 0.2 degrees",
    )  # fmt: skip
    READING_AXIS = Default(
        "distance of a pendulum's axis from the centre of angle readings, over the arm", 0.0,
        0.01, "1", "an encoder's disc of 10 mm radius set by hand to 0.1 mm, or an axis marked to"
        " 3 mm at 0.3 m from the mass",
    )  # fmt: skip
    BEARING_REPEATS = Default(
        "variation of a bearing's losses between releases", None, 0.05, "N m",
        "assumed: three releases of an encoder's dry bearing differ by 1.5 %",
        relative=True,
    )  # fmt: skip
    MIN_DRAG_COEFFICIENT = Default(
        "minimum drag coefficient of a body in air", 0.07, 0.01, "1",
        "smooth sphere beyond the crisis, from a figure (Achenbach, J. Fluid Mech. 54, 565)",
    )  # fmt: skip
    NOMINAL_RATE = Default(
        "a camera's nominal rate", None, 0.001, "1/s",
        "59.94 is called 60 (1000/1001); quartz itself is good to 50 ppm", relative=True,
    )  # fmt: skip
    BACKSWING_SCATTER = Default(
        "standard deviation of the back-swing", 0.0, math.radians(0.2), "rad",
        "a protractor with lines of 1°, read to a fifth",
    )  # fmt: skip
    LAUNCH_ANGLE_SCATTER = Default(
        "standard deviation of the launch angle", 0.0, math.radians(0.2), "rad",
        "a ball placed by hand 0.7 mm higher or lower against the face",
    )  # fmt: skip
    COR_SCATTER = Default(
        "standard deviation of the coefficient of restitution", 0.0, 0.005, "1",
        "assumed for repeated strikes of one setting; [scatter] of the setup replaces it",
    )  # fmt: skip
    COR_LAW = Default(
        "offset of a law of restitution", 0.0, 0.01, "1",
        "assumed for a law fitted at a handful of speeds; [scatter] of the setup replaces it",
    )  # fmt: skip
    ANGLE_ZERO = Default(
        "zero of an angle reading", 0.0, math.radians(1.0), "rad", "levelled by eye"
    )
    LAUNCH_ANGLE_LAW = Default(
        "offset of a ball's launch angle", 0.0, math.radians(0.3), "rad", "bubble level"
    )
    CONTACT_TIME = Default(
        "contact time of the presets", None, 0.001, "s", "assumed, see `physics.bodies.Ball`"
    )
