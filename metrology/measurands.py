"""Parse numbers with units and test them against their valid ranges.

Every length, mass, rate and angle has a `Measurand`: its unit and valid range, with the reason.
Options, setup file and wizard use the same ones, so that a number outside is rejected before any
work with the same message. Units are parsed only here: ``50mm``, ``600 fps``, ``8.5 deg``.
"""

import math
import re
import unicodedata
from dataclasses import dataclass
from functools import cache
from typing import Any

from metrology.defaults import Defaults
from metrology.errors import DomainError, UnitError, UsageError

__all__ = [
    "AIR_DENSITY",
    "AIR_PRESSURE",
    "AIR_TEMPERATURE",
    "AIR_VISCOSITY",
    "ANGLE_STD",
    "BACKSWING",
    "BALL_DIAMETER",
    "BALL_MASS",
    "BALL_PLANE_OFFSET",
    "CAMERA_DISTANCE",
    "CAPTURE_RATE",
    "CENTRE_OF_MASS",
    "DISTANCE",
    "DRAG_COEFFICIENT",
    "EFFECTIVE_MASS",
    "FIELD_OF_VIEW",
    "FINE_PITCH",
    "GRID_PITCH",
    "HUMIDITY",
    "LAUNCH_ANGLE",
    "PENDULUM_INERTIA",
    "PENDULUM_LENGTH",
    "PENDULUM_MASS",
    "POSITION_STD",
    "SHUTTER",
    "SPEED",
    "STICK_LENGTH",
    "SUPPORT_HEIGHT",
    "UNIT_OF",
    "WALL_COORDINATE",
    "Given",
    "Measurand",
    "folded",
    "parse_measured",
    "parse_quantity",
    "read_given",
    "read_number",
    "read_scale",
    "unit_word",
]

_FLOAT_PATTERN = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"

_PLUS_MINUS = ("±", "+/-", "+-")

_IN_BRACKETS = re.compile(r"\(([^()]*)\)\s*([^()]*)")

_CONCISE = re.compile(r"([+-]?\d+(?:[.,](\d+))?)\((\d+)\)\s*([^()]*)")
"""``0.3530(5) kg``: the uncertainty in units of the last digit (GUM 7.2.2)."""

_TYPESET = str.maketrans("\u2212\u2013\u00ba\u02da", "--°°")
"""Minus signs and degree signs of text processors and other keyboards."""

_NUMBER_AND_UNIT = re.compile(
    rf"({_FLOAT_PATTERN})(?:\s*/\s*({_FLOAT_PATTERN}))?\s*([A-Za-zµμ°%][\w\s*/^°%-]*)?"
)

PLAIN_UNITS: dict[str, dict[str, float]] = {
    "m": {"m": 1.0, "cm": 0.01, "mm": 0.001},
    "kg": {"kg": 1.0, "g": 0.001},
    "s": {"s": 1.0, "ms": 0.001},
    "1/s": {"fps": 1.0, "Hz": 1.0},
    "m/s": {"m/s": 1.0},
    "m/px": {"m/px": 1.0, "cm/px": 0.01, "mm/px": 0.001},
    "px/m": {"px/m": 1.0, "px/cm": 100.0, "px/mm": 1000.0},
    "kg*m^2": {"kg m^2": 1.0, "kg*m^2": 1.0, "g cm^2": 1e-7},
    "kg/m^3": {"kg/m^3": 1.0},
    "rad": {"rad": 1.0, "mrad": 0.001, "deg": math.pi / 180.0, "°": math.pi / 180.0},
    "Pa": {"Pa": 1.0, "hPa": 100.0, "kPa": 1000.0},
    "Pa*s": {"Pa s": 1.0, "Pa*s": 1.0, "mPa s": 0.001},
    "1": {"%": 0.01},
}
"""Conversion factors of common units to the unit wanted: a registry of all units takes longer to
load than a cached clip takes to show again."""


_UNIT_WORDS = {
    "s": "sec secs second seconds sekunde sekunden seconde secondes segundo segundos",
    "ms": "msec millisecond milliseconds millisekunden millisecondes milisegundos",
    "us": "µs microsecond microseconds",
    "m": "meter meters metre metres metro metros",
    "cm": "centimeter centimeters centimetre centimetres zentimeter centimetro centimetros",
    "mm": "millimeter millimeters millimetre millimetres milimetro milimetros",
    "um": "µm micron microns micrometer micrometre",
    "in": "inch inches zoll pouce pouces pulgada pulgadas",
    "ft": "foot feet fuss pied pieds pie pies",
    "px": "pixel pixels pix pixeles",
    "kg": "kilo kilos kilogramm kilogramme kilogrammes kilogramo kilogramos",
    # a grain, which others abbreviate so, weighs no ball
    "g": "gr grs gramm gramme grammes gramo gramos",
    "deg": "degre degres grado grados",
    "fps": "bilder/s images/s img/s fotogramas/s bps ips",
}
UNIT_OF = {word: unit for unit, words in _UNIT_WORDS.items() for word in (unit, *words.split())}
"""Units by their names in English, German, French and Spanish, folded."""


def unit_word(text: str) -> str:
    """A unit as written anywhere, ``Seconds``, ``CM``, ``Gramm``; others stay."""
    return UNIT_OF.get(folded(text.strip()).replace("\u03bc", "µ"), text)


def folded(text: str) -> str:
    """Lower case without accents: ``Höhe`` and ``HOHE`` are ``hohe``."""
    plain = unicodedata.normalize("NFKD", text.casefold())
    return "".join(letter for letter in plain if not unicodedata.combining(letter))


@cache
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
    registry.define("frame = []")
    # Pixel of a camera, not the length of 1/96 inch in style sheets.
    registry.define("@alias pixel = px")
    registry.define("fps = 1 / second")
    return registry


def parse_quantity(text: str | float, unit: str) -> float:
    """Convert text to a float in `unit`.

    Parameters
    ----------
    text : str or float
        ``"50mm"``, ``"1/2000 s"``, or a bare number, which is already in `unit`.
    unit : str
        The unit wanted, as pint spells it ("m", "kg/m^3", "rad").

    Raises
    ------
    UnitError
        If the text is not a number, or has another dimension.
    """
    if isinstance(text, int | float) and not isinstance(text, bool):
        return _finite(float(text), str(text), unit)
    match = _NUMBER_AND_UNIT.fullmatch(_with_decimal_points(str(text).strip()))
    if match is None:
        raise _no_quantity(str(text), unit)
    numerator, denominator, typed_unit = match.groups()
    unit_text = None if typed_unit is None else unit_word(typed_unit)
    if (typed_unit or "").strip().casefold() == "grad":
        raise UnitError(
            f"{text!r}: 'grad' may be degrees or gradians",
            hint=f"Write '{numerator} deg' or '{numerator} gon'.",
        )
    try:
        magnitude = float(numerator) / float(denominator or 1)
        plain = PLAIN_UNITS.get(unit, {}).get((unit_text or "").strip())
        if plain is not None:
            magnitude *= plain
        elif unit_text:
            parsed = _registry().Quantity(magnitude, _registry().parse_units(unit_text))
            magnitude = float(parsed.to(unit).magnitude)
    # pint has its own errors and passes on those of its parsers.
    except Exception as problem:
        raise _no_quantity(str(text), unit) from problem
    return _finite(magnitude, str(text), unit)


_DECIMAL_COMMA = re.compile(r"(?<![\d.,])(\d*),(\d+)(?![\d.,])")


def _with_decimal_points(text: str) -> str:
    """Text with decimal commas as points.

    Raises
    ------
    UnitError
        For ``1,500``, which may be a thousand.
    """

    def point(found: re.Match[str]) -> str:
        if len(found[2]) == _THOUSAND_DIGITS and found[1].lstrip("0"):
            said = [text.replace(found[0], f"{found[1]}{mark}{found[2]}") for mark in (".", "")]
            raise UnitError(
                f"{text!r}: the comma may separate decimals or thousands",
                hint=f"Write {said[0]!r} or {said[1]!r}.",
            )
        return f"{found[1]}.{found[2]}"

    return _DECIMAL_COMMA.sub(point, text.translate(_TYPESET))


_THOUSAND_DIGITS = 3
"""Digits behind a comma that may separate thousands (convention)."""


def _finite(value: float, text: str, unit: str) -> float:
    if not math.isfinite(value):
        raise _no_quantity(text, unit)
    return value


def _no_quantity(text: str, unit: str) -> UnitError:
    with_doubt = any(sign in text for sign in ("±", "+-", "+/-"))
    return UnitError(
        f"{text!r} is not a quantity in {unit}",
        hint="No uncertainty is accepted here: write only the number and its unit."
        if with_doubt
        else f"Write a number with a unit, such as '1 {unit}'.",
    )


def parse_measured(text: str | float, unit: str) -> tuple[float, float | None]:
    """Convert ``"0.353 kg ± 1 g"`` to value and standard uncertainty, None if none is given.

    A unit on one side of the sign applies to both (``"450 ± 10 mm"``); ``± 0.5 %`` is relative; a
    temperature's uncertainty is a difference (``"26 degC ± 1 degC"`` is ± 1 K).

    Parameters
    ----------
    text : str or float
        A quantity, with or without its standard uncertainty.
    unit : str
        The unit wanted.

    Returns
    -------
    value : float
    std : float or None

    Raises
    ------
    UnitError
        If either part has not that dimension, or the uncertainty is negative.
    """
    if not isinstance(text, str):
        return parse_quantity(text, unit), None
    plain = text.strip()
    if concise := _CONCISE.fullmatch(plain):
        size = int(concise[3]) * 10.0 ** -len(concise[2] or "")
        plain = f"{concise[1]} ± {size} {concise[4]}"
    bracketed = _IN_BRACKETS.fullmatch(plain)
    if bracketed is not None:
        plain = f"{bracketed[1]} {bracketed[2]}"
    for sign in _PLUS_MINUS:
        if sign in plain:
            value, _, spread = (part.strip() for part in plain.partition(sign))
            return _value_and_std(value, spread, unit, text)
    return parse_quantity(plain, unit), None


def _value_and_std(value: str, spread: str, unit: str, text: str) -> tuple[float, float]:
    value, spread = _with_decimal_points(value), _with_decimal_points(spread)
    left, right = _NUMBER_AND_UNIT.fullmatch(value), _NUMBER_AND_UNIT.fullmatch(spread)
    if left is None or right is None:
        wrong = value if left is None else spread
        raise UnitError(f"{wrong!r} in {text!r} is not a number", hint="Write it as 1.2 m ± 0.1 m.")
    share = (right[3] or "").strip() == "%"
    own = left[3] or ("" if share else right[3]) or ""
    number = parse_quantity(f"{left[1]}/{left[2] or 1} {own}", unit)
    size = float(right[1]) / float(right[2] or 1)
    if share:
        std = 0.01 * size * abs(number)
    else:
        step = (right[3] or own).strip()
        # A difference, so that the zero of a unit such as degC cancels.
        std = size * (parse_quantity(f"1 {step}", unit) - parse_quantity(f"0 {step}", unit))
    if not std >= 0:
        raise UnitError(
            f"the uncertainty in {text!r} is negative", hint="Write it as 1.2 m ± 0.1 m."
        )
    return number, _finite(std, text, unit)


@dataclass(frozen=True)
class Measurand:
    """A kind of number that users type.

    Attributes
    ----------
    name : str
        Its name in a sentence ("the side of a square of the wall grid").
    unit : str
        SI unit of the value.
    lowest, highest : float
        Valid range, both ends included, in `unit`.
    why : str
        Reason for the range.
    example : str
        Example text.
    """

    name: str
    unit: str
    lowest: float
    highest: float
    why: str
    example: str

    def require(self, value: float, typed: object = None) -> float:
        """Reject a number outside the range.

        Parameters
        ----------
        value : float
            In `unit`.
        typed : object, optional
            The user's text, for the message.

        Returns
        -------
        float
            `value`.

        Raises
        ------
        DomainError
            If it is not finite or outside the range; the message states the range's reason.
        """
        if math.isfinite(value) and self.lowest <= value <= self.highest:
            return value
        said = f"{value:g} {self.unit}" if self.unit != "1" else f"{value:g}"
        if self.unit == "rad":
            said = f"{math.degrees(value):g} deg"
        told = "" if typed is None or str(typed) == said else f"{typed!r}: "
        raise DomainError(f"{told}{self.name} can't be {said}; {self.why}", hint=self.advice)

    @property
    def advice(self) -> str:
        """How to write one."""
        if self.unit == "1":
            return f"Write for example {self.example!r}."
        return f"Write it with its unit, such as {self.example!r}."


@dataclass(frozen=True)
class Given:
    """A number as given: value and, if stated, standard uncertainty, SI."""

    value: float
    std: float | None = None


def read_number(typed: str | float, what: Measurand, place: str = "") -> float:
    """A number without uncertainty, in the measurand's unit.

    Parameters
    ----------
    place : str
        The option (``--fps``), for the message.

    Raises
    ------
    UnitError
        If it has not that dimension.
    DomainError
        If it is out of range.
    """
    try:
        _refuse_bare_angle(typed, what)
        return what.require(parse_quantity(typed, what.unit), typed)
    except UsageError as problem:
        raise _at(place, problem, what) from problem


def _refuse_bare_angle(typed: str | float, what: Measurand) -> None:
    if what.unit != "rad":
        return
    try:
        bare = float(_with_decimal_points(str(typed)))
    except ValueError:
        return
    if bare and math.isfinite(bare):
        raise DomainError(
            f"{typed!r} has no unit: degrees or radians", hint=f"Write '{bare:g} deg'."
        )


def read_given(typed: str | float, what: Measurand, place: str = "") -> Given:
    """A number with or without its standard uncertainty, in the measurand's unit.

    Parameters
    ----------
    place : str
        The option (``--fps``), for the message.

    Raises
    ------
    UnitError
        If either part has not that dimension.
    DomainError
        If the value is out of range, or the uncertainty is zero.
    """
    try:
        _refuse_bare_angle(typed, what)
        value, std = parse_measured(typed, what.unit)
        what.require(value, typed)
    except UsageError as problem:
        raise _at(place, problem, what) from problem
    if std == 0.0:
        raise DomainError(
            f"{place} {typed!r}: an uncertainty of zero is not possible".strip(),
            hint="Leave out the ± part to use the default uncertainty.",
        )
    return Given(value, std)


def read_scale(typed: str | float, place: str = "") -> tuple[float, float]:
    """Read a scale in the plane of motion, as length per pixel or pixels per length.

    Parameters
    ----------
    typed : str or float
        ``"2.44 mm/px"``, ``"409.9 px/m ± 2 px/m"``; a bare number is in m/px.
    place : str
        The option (``--scale``), for the message.

    Returns
    -------
    value, std : float
        m/px; the standard uncertainty of `Defaults.PLANE_SCALE` if none is given.

    Raises
    ------
    UnitError
        If it is neither.
    DomainError
        If it is out of range, or its uncertainty is zero.
    """
    try:
        given = read_given(typed, PLANE_SCALE, place)
    except UnitError:
        try:
            turned = read_given(typed, PIXELS_PER_METRE, place)
        except UnitError:
            raise UnitError(
                f"{place} {typed!r} is not a scale".strip(),
                hint=f"Write '{PLANE_SCALE.example}' or '{PIXELS_PER_METRE.example} ± 2 px/m'.",
            ) from None
        std = None if turned.std is None else turned.std / turned.value**2
        given = Given(1.0 / turned.value, std)
    std = Defaults.PLANE_SCALE.std_of(given.value) if given.std is None else given.std
    return given.value, std


def _at(place: str, problem: UsageError, what: Measurand) -> UsageError:
    """The same error with the option's name in front, in words for this kind of number."""
    plain = _no_quantity("", what.unit)
    message = problem.message.replace(plain.message[2:], f" can't be read as {what.name}")
    hint = what.advice if problem.hint == plain.hint else problem.hint
    return type(problem)(f"{place} {message}".strip(), hint=hint)


_RIG_RANGE = "pendulums from a finger's breadth to a house are supported"

CAPTURE_RATE = Measurand(
    "a capture rate", "1/s", 1.0, 1e7, "cameras take 1 to ten million frames per second", "600 fps"
)

PLANE_SCALE = Measurand(
    "a scale", "m/px", 1e-8, 1.0,
    "a pixel shows between 10 nm (a microscope) and 1 m (a stadium from afar)", "2.44 mm/px",
)  # fmt: skip

PIXELS_PER_METRE = Measurand(
    "a scale", "px/m", 1.0, 1e8,
    "a metre is between one pixel (a stadium from afar) and 1e8 (a microscope)", "409.9 px/m",
)  # fmt: skip

SHUTTER = Measurand(
    "a shutter time", "s", 1e-9, 10.0, "shutter times are nanoseconds to seconds", "1/2000 s"
)

CAMERA_DISTANCE = Measurand(
    "a camera's distance from the wall", "m", 0.02, 1000.0,
    "a camera sees a wall from 2 cm to 1 km", "4.00 m ± 5 mm",
)  # fmt: skip

WALL_COORDINATE = Measurand(
    "a position on the wall", "m", -1000.0, 1000.0, "walls are less than 1 km wide", "1.10 m"
)

GRID_PITCH = Measurand(
    "a square of the wall grid", "m", 1e-3, 2.0, "squares are 1 mm to 2 m wide", "50 mm"
)

FINE_PITCH = Measurand(
    "the distance between fine lines", "m", 1e-4, 2.0, "fine lines are 0.1 mm to 2 m apart", "10 mm"
)

BALL_PLANE_OFFSET = Measurand(
    "the ball plane's distance from the wall", "m", 0.0, 100.0,
    "the ball flies in front of the wall, less than 100 m from it", "0.45 m",
)  # fmt: skip

BALL_MASS = Measurand(
    "a ball's mass", "kg", 1e-6, 100.0, "balls weigh a milligram to 100 kg", "0.353 kg"
)

BALL_DIAMETER = Measurand(
    "a ball's diameter", "m", 1e-3, 2.0, "balls are 1 mm to 2 m across", "220 mm"
)

LAUNCH_ANGLE = Measurand(
    "a launch angle", "rad", -math.pi / 2, math.pi / 2, "it lies within ±90° of the horizontal",
    "8.5 deg",
)  # fmt: skip

BACKSWING = Measurand(
    "a back-swing angle", "rad", -math.pi, math.pi, "a pendulum is let go within ±180° of its"
    " lowest point", "90 deg",
)  # fmt: skip

PENDULUM_LENGTH = Measurand("a pendulum's length", "m", 0.01, 100.0, _RIG_RANGE, "0.5541 m")

PENDULUM_INERTIA = Measurand(
    "a pendulum's moment of inertia", "kg*m^2", 1e-9, 1e7, _RIG_RANGE, "1.579 kg m^2"
)

PENDULUM_MASS = Measurand("a pendulum's mass", "kg", 1e-4, 1e5, _RIG_RANGE, "6.0 kg")

CENTRE_OF_MASS = Measurand(
    "the distance from the pivot to the centre of mass", "m", 1e-3, 100.0, _RIG_RANGE, "0.4553 m"
)

EFFECTIVE_MASS = Measurand("an effective mass", "kg", 1e-4, 1e5, _RIG_RANGE, "5.1667 kg")

SUPPORT_HEIGHT = Measurand(
    "the height of the support", "m", 0.0, 100.0, "the ball falls from 0 to 100 m", "0.3120 m"
)

AIR_TEMPERATURE = Measurand(
    "an air temperature", "kelvin", 200.0, 350.0, "air outdoors and in labs has 200 K to 350 K",
    "26 degC",
)  # fmt: skip

AIR_PRESSURE = Measurand(
    "an air pressure", "Pa", 1e4, 2e5, "air pressures are 100 hPa to 2000 hPa", "1013.25 hPa"
)

HUMIDITY = Measurand("a relative humidity", "1", 0.0, 1.0, "it is between 0 and 1", "50 %")

AIR_DENSITY = Measurand(
    "a density of the air", "kg/m^3", 1e-6, 20.0, "gases have up to 20 kg/m³", "1.180 kg/m^3"
)

AIR_VISCOSITY = Measurand(
    "a viscosity of the air", "Pa*s", 1e-7, 1e-3, "gases have 1e-7 to 1e-3 Pa s", "1.852e-5 Pa s"
)

DRAG_COEFFICIENT = Measurand(
    "a drag coefficient", "1", 0.0, 1.6, "spheres have 0.1 to 0.5, blunt bodies up to 1.6", "0.47"
)

FIELD_OF_VIEW = Measurand(
    "a field of view", "rad", math.radians(2.0), math.radians(130.0),
    "lenses of cameras see 2° to 130°", "50 deg",
)  # fmt: skip

SPEED = Measurand(
    "a speed", "m/s", 1e-3, 1000.0, "impact speeds are between 1 mm/s and 1 km/s", "3.2 m/s"
)

DISTANCE = Measurand(
    "a distance", "m", 1e-3, 1000.0, "balls land between 1 mm and 1 km away", "2.5 m"
)

STICK_LENGTH = Measurand(
    "a stick's length", "m", 1e-3, 100.0, "it is between 1 mm and 100 m", "1 m"
)

ANGLE_STD = Measurand(
    "the standard deviation of an angle", "rad", 0.0, math.pi, "it is less than half a turn",
    "0.2 deg",
)  # fmt: skip

POSITION_STD = Measurand(
    "the noise of positions", "m", 1e-9, 100.0, "position noise is between 1 nm and 100 m",
    "1.7 mm",
)  # fmt: skip
