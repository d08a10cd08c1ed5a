"""Uncertainty as the root sum of squares of the budget (GUM, 5.1.2)."""

import pytest

from metrology import Contribution, Quantity, UncertaintySource

FIRST, SECOND = list(UncertaintySource)[:2]


def test_contributions_add_in_squares() -> None:
    both = (Contribution(FIRST, 3.0), Contribution(SECOND, 4.0))
    measured = Quantity.measured("ball_speed", 7, "m/s", both)
    assert measured.std == pytest.approx(5.0)
    assert measured.known
    assert isinstance(measured.value, float)


def test_a_missing_quantity_has_a_reason_instead_of_a_value() -> None:
    missing = Quantity.missing("cor", "1", "no mass")
    assert (missing.value, missing.std, missing.reason) == (None, None, "no mass")
    assert not missing.known
