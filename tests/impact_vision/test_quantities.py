"""Display of quantities in a notebook."""

import pytest

import impact_vision as iv
from metrology import Contribution, Quantity, UncertaintySource

FIRST, SECOND = list(UncertaintySource)[:2]


def test_the_budget_lists_variance_fractions_in_descending_order() -> None:
    lines = (Contribution(FIRST, 3.0), Contribution(SECOND, 4.0))
    view = iv.QuantityView.of(Quantity.measured("ball_speed", 7.0, "m/s", lines))
    assert [*view.budget["source"]] == [str(SECOND), str(FIRST)]
    assert [*view.budget["share"]] == pytest.approx([0.64, 0.36])
    assert str(view) == "7.0 ± 5.0 m/s"
