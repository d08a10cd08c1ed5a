"""Display of quantities in a notebook."""

import pytest

import impact_vision as iv
from metrology import Contribution, MeasurementError, Quantity, UncertaintySource, UsageError

FIRST, SECOND = list(UncertaintySource)[:2]


def test_the_budget_lists_variance_fractions_in_descending_order() -> None:
    lines = (Contribution(FIRST, 3.0), Contribution(SECOND, 4.0))
    view = iv.QuantityView.of(Quantity.measured("ball_speed", 7.0, "m/s", lines))
    assert [*view.budget["source"]] == [str(SECOND), str(FIRST)]
    assert [*view.budget["share"]] == pytest.approx([0.64, 0.36])
    assert str(view) == "7.0 ± 5.0 m/s"


def test_a_quantity_is_used_like_a_number() -> None:
    speed = iv.QuantityView("ball_speed", 4.0, 0.1, "m/s", None, ())
    assert f"{speed:.2f}" == "4.00"
    assert f"{speed}" == str(speed)
    for other, value, std in (
        (speed * 2, 8.0, 0.2),
        (2 * speed, 8.0, 0.2),
        (speed / -2, -2.0, 0.05),
        (-speed, -4.0, 0.1),
        (speed + 1, 5.0, 0.1),
        (1 + speed, 5.0, 0.1),
        (speed - 1, 3.0, 0.1),
    ):
        assert (other.value, other.std) == pytest.approx((value, std))
    with pytest.raises(UsageError, match="correlated"):
        speed * speed  # type: ignore[operator]
    with pytest.raises(MeasurementError, match="hidden"):
        2 * iv.QuantityView("ball_speed", None, None, "m/s", "it is hidden")


def test_several_clips_are_for_a_campaign() -> None:
    with pytest.raises(UsageError) as refusal:
        iv.measure(["a.mp4", "b.mp4"])  # type: ignore[arg-type]
    assert "iv.campaign" in str(refusal.value.hint)
