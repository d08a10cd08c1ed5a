"""Numbers with their uncertainty as they are printed: two significant digits of it (GUM, 7.2.6)."""

import math

from metrology.quantity import Quantity

__all__ = ["format_pair", "format_quantity", "format_unit", "format_value"]

_UNITS = {"1": "", "deg": "°", "m/s^2": "m/s²", "kg m^2": "kg m²", "N s": "N s"}
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SMALL, _LARGE = 1e-4, 1e6
"""Sizes, in the number's own unit, beyond which a power of ten is written, as printf's %g does."""


def format_quantity(quantity: Quantity) -> str:
    """Print a quantity: ``"6.361 ± 0.012 m/s"``, or why there is none.

    Parameters
    ----------
    quantity : Quantity

    Returns
    -------
    str
    """
    if quantity.value is None:
        return f"not measured: {quantity.reason}" if quantity.reason else "not measured"
    return format_value(quantity.value, quantity.std, quantity.unit)


def format_value(value: float, std: float | None, unit: str) -> str:
    """Print value, standard uncertainty (left out where it is not known) and unit."""
    suffix = format_unit(unit)
    gap = "" if suffix in ("", "°") else " "
    size = max(abs(value), std or 0.0)
    exponent = 0
    if math.isfinite(size) and size > 0 and not _SMALL <= size < _LARGE:
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
    """Print value and standard uncertainty, both rounded to two significant digits of the latter.

    Parameters
    ----------
    value : float
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
    # Rounding 0.0996 to two digits gives 0.10: the digits are counted after rounding.
    place = math.floor(math.log10(float(f"{std:.1e}"))) - 1
    if place >= 0:
        return f"{round(value, -place):.0f}", f"{round(std, -place):.0f}"
    return f"{value:.{-place}f}", f"{std:.{-place}f}"


def format_unit(unit: str) -> str:
    """Spell a unit for readers: nothing for 1, ° for deg, m/s² for m/s^2."""
    return _UNITS.get(unit, unit)
