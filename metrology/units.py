"""Unit strings, parsed only where a person types one: ``50mm``, ``600 fps``, ``8.5 deg``."""

import math
import re
from functools import cache
from typing import Any

from metrology.errors import UnitError

__all__ = ["parse_measured", "parse_quantity", "parse_with_uncertainty"]


_FLOAT = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_PLUS_MINUS = ("±", "+/-", "+-")
_IN_BRACKETS = re.compile(r"\(([^()]*)\)\s*([^()]*)")
_NUMBER_AND_UNIT = re.compile(rf"({_FLOAT})(?:\s*/\s*({_FLOAT}))?\s*([A-Za-zµμ°%][\w\s*/^°%-]*)?")


PLAIN_UNITS: dict[str, dict[str, float]] = {
    "m": {"m": 1.0, "cm": 0.01, "mm": 0.001},
    "kg": {"kg": 1.0, "g": 0.001},
    "s": {"s": 1.0, "ms": 0.001},
    "1/s": {"fps": 1.0, "Hz": 1.0},
    "m/s": {"m/s": 1.0},
    "m/px": {"m/px": 1.0, "cm/px": 0.01, "mm/px": 0.001},
    "px/m": {"px/m": 1.0, "px/cm": 100.0, "px/mm": 1000.0},
    "kg m^2": {"kg m^2": 1.0},
    "kg/m^3": {"kg/m^3": 1.0},
}
"""What nearly everybody writes, by the unit wanted: factors known without a registry of all units,
which takes longer to load than a clip that was measured before takes to be shown again."""


@cache
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
    registry.define("frame = []")
    # of a camera, not the length of 1/96 inch that style sheets mean by it
    registry.define("@alias pixel = px")
    registry.define("fps = 1 / second")
    return registry


def parse_quantity(text: str | float, unit: str) -> float:
    """Turn what a person typed into a float in `unit`.

    Parameters
    ----------
    text : str or float
        ``"50mm"``, ``"1/2000 s"``, or a bare number, which is taken to be in `unit` already.
    unit : str
        The unit wanted, as pint spells it ("m", "kg/m^3", "rad").

    Returns
    -------
    float

    Raises
    ------
    UnitError
        If the text is no number, or has another dimension.
    """
    if isinstance(text, int | float) and not isinstance(text, bool):
        return _finite(float(text), str(text), unit)
    match = _NUMBER_AND_UNIT.fullmatch(str(text).strip())
    if match is None:
        raise _no_quantity(str(text), unit)
    numerator, denominator, unit_text = match.groups()
    try:
        magnitude = float(numerator) / float(denominator or 1)
        plain = PLAIN_UNITS.get(unit, {}).get((unit_text or "").strip())
        if plain is not None:
            magnitude *= plain
        elif unit_text:
            parsed = _registry().Quantity(magnitude, _registry().parse_units(unit_text))
            magnitude = float(parsed.to(unit).magnitude)
    # pint has errors of its own, and lets those of what it parses with through
    except Exception as problem:
        raise _no_quantity(str(text), unit) from problem
    return _finite(magnitude, str(text), unit)


def _finite(value: float, text: str, unit: str) -> float:
    if not math.isfinite(value):
        raise _no_quantity(text, unit)
    return value


def _no_quantity(text: str, unit: str) -> UnitError:
    return UnitError(
        f"{text!r} is not a quantity in {unit}",
        hint=f"Write a number with a unit, such as '1 {unit}'.",
    )


def parse_with_uncertainty(text: str | float, unit: str, default_std: float) -> tuple[float, float]:
    """Turn ``"4.00 m ± 5 mm"`` (or ``+/-``, ``+-``) into value and standard uncertainty in `unit`.

    Parameters
    ----------
    text : str or float
        A quantity, with or without its standard uncertainty.
    unit : str
        The unit wanted.
    default_std : float
        Standard uncertainty where none is written, in `unit`.

    Returns
    -------
    value, std : float

    Raises
    ------
    UnitError
        If either part is no quantity of that dimension, or the uncertainty is negative.
    """
    value, std = parse_measured(text, unit)
    return value, default_std if std is None else std


def parse_measured(text: str | float, unit: str) -> tuple[float, float | None]:
    """Turn ``"0.353 kg ± 1 g"`` into value and standard uncertainty, None where none is written.

    A unit on one side of the sign serves both (``"450 ± 10 mm"``); ``± 0.5 %`` is a share of the
    value; a temperature's uncertainty is a difference (``"26 degC ± 1 degC"`` is ± 1 K).

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
        If either part is no quantity of that dimension, or the uncertainty is negative.
    """
    if not isinstance(text, str):
        return parse_quantity(text, unit), None
    plain = text.strip()
    bracketed = _IN_BRACKETS.fullmatch(plain)
    if bracketed is not None:
        plain = f"{bracketed[1]} {bracketed[2]}"
    for sign in _PLUS_MINUS:
        if sign in plain:
            value, _, spread = (part.strip() for part in plain.partition(sign))
            return _value_and_std(value, spread, unit, text)
    return parse_quantity(plain, unit), None


def _value_and_std(value: str, spread: str, unit: str, text: str) -> tuple[float, float]:
    left, right = _NUMBER_AND_UNIT.fullmatch(value), _NUMBER_AND_UNIT.fullmatch(spread)
    if left is None or right is None:
        raise _no_quantity(text, unit)
    share = (right[3] or "").strip() == "%"
    own = left[3] or ("" if share else right[3]) or ""
    number = parse_quantity(f"{left[1]}/{left[2] or 1} {own}", unit)
    size = float(right[1]) / float(right[2] or 1)
    if share:
        std = 0.01 * size * abs(number)
    else:
        step = (right[3] or own).strip()
        # a difference: where a unit has another zero (degC), that zero drops out
        std = size * (parse_quantity(f"1 {step}", unit) - parse_quantity(f"0 {step}", unit))
    if not std >= 0:
        raise UnitError(f"the uncertainty in {text!r} is negative")
    return number, _finite(std, text, unit)
