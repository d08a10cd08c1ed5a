"""Units compared with the SI brochure and NIST SP 811; invalid numbers."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from metrology import UnitError, parse_quantity
from metrology.measurands import parse_measured


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("1 inch", "m", 0.0254),
        ("1 ft", "m", 0.3048),
        ("1 lb", "kg", 0.45359237),
        ("1 oz", "kg", 0.028349523125),
        ("1 mile/hour", "m/s", 0.44704),
        ("1 km/h", "m/s", 1.0 / 3.6),
        ("1 mmHg", "Pa", 133.322387415),
        ("1 psi", "Pa", 6894.757293168),
        ("1 atm", "Pa", 101325.0),
        ("0 degC", "kelvin", 273.15),
        ("32 degF", "kelvin", 273.15),
        ("180 deg", "rad", math.pi),
        ("1 rpm", "rad/s", 2.0 * math.pi / 60.0),
        ("600 fps", "1/s", 600.0),
        ("240 Hz", "1/s", 240.0),
        ("1 g/cm^3", "kg/m^3", 1000.0),
        ("1 kg cm^2", "kg*m^2", 1e-4),
        ("18.52 µPa s", "Pa*s", 1.852e-5),
        ("1/2000 s", "s", 5e-4),
        ("50mm", "m", 0.05),
        (".5 m", "m", 0.5),
        ("5e-2m", "m", 0.05),
        ("+2", "m", 2.0),
        (7, "m", 7.0),
    ],
)
def test_units_agree_with_the_si_brochure(text: str | float, unit: str, value: float) -> None:
    assert parse_quantity(text, unit) == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize(
    "text",
    ["", " ", "m", "50 kg", "50 mmm", "1 m 2", "1e400 m", "nan", "inf m", "0x10 m",
     "1/0 m", "1 m; import os", "--5 m", "1 m^^2", "1 m" * 200],
)  # fmt: skip
def test_an_invalid_length_is_refused(text: str) -> None:
    with pytest.raises(UnitError, match="is not a quantity in m"):
        parse_quantity(text, "m")


@pytest.mark.parametrize(
    ("text", "unit", "value", "std"),
    [
        ("353 gr", "kg", 0.353, None),
        ("0,353 KG", "kg", 0.353, None),
        ("353 Gramm ± 1 Gramm", "kg", 0.353, 0.001),
        ("0.3530(5) kg", "kg", 0.353, 0.0005),
        ("353(2) g", "kg", 0.353, 0.002),
        ("8 zoll", "m", 0.2032, None),
        ("600 Bilder/s", "1/s", 600.0, None),
        ("\u22128.5º", "rad", -0.14835, None),
    ],
)
def test_units_and_numbers_as_people_write_them(
    text: str, unit: str, value: float, std: float | None
) -> None:
    found = parse_measured(text, unit)
    assert found[0] == pytest.approx(value, rel=1e-4)
    assert found[1] == (None if std is None else pytest.approx(std, rel=1e-4))


@pytest.mark.parametrize(
    ("text", "unit", "cure"),
    [("1,500 m", "m", "'1.500 m' or '1500 m'"), ("8.5 Grad", "rad", "'8.5 deg' or '8.5 gon'")],
)
def test_what_has_two_meanings_is_refused_with_both(text: str, unit: str, cure: str) -> None:
    with pytest.raises(UnitError) as refusal:
        parse_quantity(text, unit)
    assert cure in str(refusal.value.hint)


@given(st.floats(-1e12, 1e12))
def test_a_number_survives_its_printing(value: float) -> None:
    assert parse_quantity(f"{value!r} m", "m") == value
    assert parse_quantity(value, "m") == value


def test_an_uncertainty_that_is_not_allowed_is_refused() -> None:
    with pytest.raises(UnitError) as refusal:
        parse_quantity("2 deg ± 0", "rad")
    assert "No uncertainty" in str(refusal.value.hint)
