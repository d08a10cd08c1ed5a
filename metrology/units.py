"""Unit strings, parsed only where a person types one: ``50mm``, ``0.55 m``, ``600 fps``, ``8.5 deg``."""

from functools import cache
from typing import Any

import pint

from metrology.errors import UnitError

__all__ = ["parse_quantity"]


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
    if isinstance(text, int | float):
        return float(text)
    registry = _registry()
    try:
        number = float(text)
    except ValueError:
        pass
    else:
        return number
    try:
        parsed = registry.Quantity(text.strip())
        return float(parsed.to(unit).magnitude)
    except Exception as problem:
        raise UnitError(
            f"{text!r} is not a quantity in {unit}", hint=f"Write a number with a unit, such as '1 {unit}'."
        ) from problem
