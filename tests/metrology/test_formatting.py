"""Formatting of values with their uncertainty."""

import math

import pytest

from metrology import Contribution, Quantity
from metrology.quantity import format_pair, format_quantity, format_value


@pytest.mark.parametrize(
    ("value", "std", "unit", "printed"),
    [
        (6.36123, 0.01234, "m/s", "6.361 ± 0.012 m/s"),
        (0.0141291, 0.000123, "s", "0.01413 ± 0.00012 s"),
        (12.34117, 0.0996, "deg", "(12.34 ± 0.10)°"),
        (0.7153, 0.0044, "1", "0.7153 ± 0.0044"),
        (9.0, 1.2, "1", "9.0 ± 1.2"),
        (12347.0, 678.0, "m", "12350 ± 680 m"),
        (9.79, 0.03, "m/s^2", "9.790 ± 0.030 m/s²"),
        (1.2345e-5, 1.2e-7, "Pa s", "(1.234 ± 0.012)·10⁻⁵ Pa s"),
        (0.0, 0.012, "m", "0.000 ± 0.012 m"),
        (-1.5, 0.25, "m", "-1.50 ± 0.25 m"),
        (3.0, None, "m", "3 m"),
        (3.25, 0.0, "m", "3.25 ± 0 m"),
    ],
)
def test_rounding_to_two_digits_of_the_uncertainty(value, std, unit, printed):
    assert format_value(value, std, unit) == printed


def test_a_missing_quantity_has_a_reason():
    missing = Quantity.missing("landing_time", "s", "the ball leaves the frame at 0.31 s")
    assert format_quantity(missing) == "not measured: the ball leaves the frame at 0.31 s"


def test_a_measured_quantity_prints_its_combined_uncertainty():
    budget = (Contribution("scale", 0.003), Contribution("time", 0.004))
    measured = Quantity.measured("ball_speed", 6.36123, "m/s", budget)
    assert format_quantity(measured) == "6.3612 ± 0.0050 m/s"


def test_digits_do_not_exceed_the_precision():
    for std in (0.00995, 0.0995, 0.995, 9.95, 99.5, 995.0):
        _, spread = format_pair(1234.5678, std)
        digits = spread.replace(".", "").strip("0")
        assert len(digits) <= 2
        assert math.isclose(float(spread), std, rel_tol=0.05)
