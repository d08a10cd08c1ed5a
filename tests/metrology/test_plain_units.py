"""Plain units compared with pint."""

import subprocess
import sys

import pint
import pytest

from metrology import UnitError, parse_quantity
from metrology.measurands import PLAIN_UNITS

PLAIN = [(unit, typed) for unit, row in PLAIN_UNITS.items() for typed in row]


@pytest.fixture(scope="module")
def registry() -> "pint.UnitRegistry[float]":
    units: pint.UnitRegistry[float] = pint.UnitRegistry()
    units.define("frame = []")
    units.define("fps = 1 / second")
    return units


@pytest.mark.parametrize(("unit", "typed"), PLAIN)
def test_plain_units_agree_with_pint(
    unit: str, typed: str, registry: "pint.UnitRegistry[float]"
) -> None:
    expected = registry.Quantity(12.5, registry.parse_units(typed)).to(unit).magnitude
    assert parse_quantity(f"12.5 {typed}", unit) == pytest.approx(expected, rel=1e-12)


def test_a_fraction_takes_its_unit_too() -> None:
    assert parse_quantity("1/2000 s", "s") == pytest.approx(5e-4)
    assert parse_quantity("1/4 ms", "s") == pytest.approx(2.5e-4)


def test_other_units_are_known_too() -> None:
    assert parse_quantity("5 furlongs", "m") == pytest.approx(5 * 201.168, rel=1e-4)


@pytest.mark.parametrize("text", ["5 kg", "5 m/s", "5 mm mm", "5 (", "m"])
def test_another_dimension_is_refused(text: str) -> None:
    with pytest.raises(UnitError):
        parse_quantity(text, "m")


def test_plain_units_need_no_registry() -> None:
    script = (
        "import sys, metrology\nmetrology.parse_quantity('50mm', 'm')\nprint('pint' in sys.modules)"
    )
    told = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    ).stdout
    assert told.strip() == "False"
