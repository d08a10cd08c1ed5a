"""Numbers as people read them."""

from metrology import Contribution, Quantity, UncertaintySource
from pipelines.report.inputs import quantity_rows, quantity_text


def quantity(name: str, value: float, std: float, unit: str) -> Quantity:
    line = Contribution(UncertaintySource.TRACK_NOISE, std)
    return Quantity.measured(name, value, unit, (line,))


def test_contact_times_are_shown_in_milliseconds() -> None:
    assert quantity_text(quantity("contact_time", 0.016795, 0.00101, "s")) == "16.8 ± 1.0 ms"
    assert quantity_text(quantity("contact_end", 0.1066, 0.0042, "s")) == "106.6 ± 4.2 ms"
    assert quantity_text(quantity("landing_time", 0.4806, 0.0012, "s")) == "0.4806 ± 0.0012 s"


def test_what_is_missing_is_said_once_after_what_is_known() -> None:
    reason = "the ball leaves the picture before it lands"
    rows = quantity_rows(
        [
            Quantity.missing("landing_distance", "m", reason),
            quantity("ball_speed", 2.5, 0.1, "m/s"),
            Quantity.missing("backswing", "deg", "the pendulum is already swinging"),
            Quantity.missing("landing_time", "s", reason),
        ]
    )
    assert [known for _, _, known in rows] == [True, False, False]
    assert rows[0][:2] == ("ball speed at release", "2.50 ± 0.10 m/s")
    assert rows[1][0].count(";") == 1
    assert reason in rows[1][1]
