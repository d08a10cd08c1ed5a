"""Unit strings, parsed only where a person types one: ``50mm``, ``600 fps``, ``8.5 deg``."""

import math
import re
from functools import cache
from typing import Any

import pint
from pint.errors import PintError

from metrology.errors import UnitError

__all__ = ["parse_quantity", "parse_with_uncertainty"]


_FLOAT = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_NUMBER_AND_UNIT = re.compile(rf"({_FLOAT})(?:\s*/\s*({_FLOAT}))?\s*([A-Za-zµμ°%][\w\s*/^°%-]*)?")


@cache
def _registry() -> Any:
    registry: Any = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
    registry.define("frame = []")
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
        if unit_text:
            parsed = _registry().Quantity(magnitude, _registry().parse_units(unit_text))
            magnitude = float(parsed.to(unit).magnitude)
    except (PintError, ArithmeticError, ValueError, TypeError, AssertionError) as problem:
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
    if isinstance(text, str):
        for sign in ("±", "+/-", "+-"):
            if sign in text:
                value, std = (part.strip() for part in text.split(sign, 1))
                spread = parse_quantity(std, unit)
                if spread < 0:
                    raise UnitError(f"the uncertainty in {text!r} is negative")
                return parse_quantity(value, unit), spread
    return parse_quantity(text, unit), default_std
