"""Parsing of numbers with units and uncertainties: accepted and refused."""

import math

import pytest

from metrology import (
    DomainError,
    UnitError,
    measurands,
    parse_measured,
    read_given,
    read_number,
    read_scale,
)
from metrology.measurands import Measurand

KINDS = [kind for kind in vars(measurands).values() if isinstance(kind, Measurand)]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_every_kind_accepts_its_example_and_limits_and_nothing_beyond(kind: Measurand) -> None:
    given = read_given(kind.example, kind)
    assert kind.lowest <= given.value <= kind.highest
    assert kind.require(kind.lowest) == kind.lowest
    for beyond in (math.nan, math.inf, -math.inf, 1e300, -1e300):
        with pytest.raises((DomainError, UnitError)):
            read_number(beyond, kind)
    for nonsense in ("", "much", "nan m", "1 furlong/fortnight^3", "--1", True):
        with pytest.raises(UnitError):
            read_number(nonsense, kind)
    with pytest.raises(DomainError) as why:
        kind.require(math.nextafter(kind.highest, math.inf) * 1.001 + 1e-300)
    assert kind.why in str(why.value)


def test_an_angle_needs_its_unit() -> None:
    for read in (read_number, read_given):
        for bare in (0.15, "0.15"):
            with pytest.raises(DomainError, match="degrees or radians"):
                read(bare, measurands.LAUNCH_ANGLE)
    assert read_number("0", measurands.LAUNCH_ANGLE) == 0.0
    assert read_number("0.15 rad", measurands.LAUNCH_ANGLE) == 0.15


@pytest.mark.parametrize(
    ("typed", "unit", "value", "std"),
    [
        ("0.353 kg ± 0.001 kg", "kg", 0.353, 0.001),
        ("353 g +- 1 g", "kg", 0.353, 0.001),
        ("353 ± 1 g", "kg", 0.353, 0.001),
        ("353 g ± 1", "kg", 0.353, 0.001),
        ("(353 ± 1) g", "kg", 0.353, 0.001),
        ("0.353 kg ± 1 %", "kg", 0.353, 0.00353),
        ("600 fps ± 0.5 fps", "1/s", 600.0, 0.5),
        ("26 degC ± 1 degC", "kelvin", 299.15, 1.0),
        ("79 degF ± 1.8 degF", "kelvin", 299.2611, 1.0),
        ("1/2000 s ± 1/100000 s", "s", 0.0005, 1e-5),
        ("8.5 deg +/- 0.3 deg", "rad", math.radians(8.5), math.radians(0.3)),
        ("4.00 m", "m", 4.0, None),
        (0.47, "1", 0.47, None),
    ],
)
def test_an_uncertainty_is_read_as_people_write_it(
    typed: str | float, unit: str, value: float, std: float | None
) -> None:
    read = parse_measured(typed, unit)
    assert read[0] == pytest.approx(value, rel=1e-6)
    assert read[1] == (None if std is None else pytest.approx(std, rel=1e-6))


@pytest.mark.parametrize("typed", ["4 m ± -1 mm", "4 m ± 1 kg", "4 m ±", "± 1 mm", "4 m ± nan"])
def test_a_wrong_uncertainty_is_refused(typed: str) -> None:
    with pytest.raises(UnitError):
        parse_measured(typed, "m")


def test_nothing_is_known_without_uncertainty() -> None:
    with pytest.raises(DomainError, match="uncertainty of zero"):
        read_given("4 m ± 0 mm", measurands.CAMERA_DISTANCE)


@pytest.mark.parametrize(
    ("typed", "value", "std"),
    [
        ("2.44 mm/px", 2.44e-3, 0.005 * 2.44e-3),
        ("2.44 mm/px ± 0.01 mm/px", 2.44e-3, 1e-5),
        ("409.9 px/m ± 2 px/m", 1 / 409.9, 2 / 409.9**2),
        ("409.9 ± 2 px/m", 1 / 409.9, 2 / 409.9**2),
        ("4.099 px/cm ± 0.5 %", 1 / 409.9, 0.005 / 409.9),
        ("10 px/inch ± 1 %", 0.00254, 0.0000254),
        ("100 pixels / m", 0.01, 0.005 * 0.01),
        (0.00244, 2.44e-3, 0.005 * 2.44e-3),
    ],
)
def test_a_scale_is_read_either_way_round(typed: str | float, value: float, std: float) -> None:
    assert read_scale(typed, "--scale") == pytest.approx((value, std), rel=1e-9)


@pytest.mark.parametrize(
    "typed", ["2 mm", "409.9 px", "2 mm/px ± 1 mm", "0 px/m", "3 px/m ± 0", ""]
)
def test_an_invalid_scale_is_refused(typed: str) -> None:
    with pytest.raises((UnitError, DomainError), match="--scale"):
        read_scale(typed, "--scale")
