"""Numbers as people read them."""

from metrology import Contribution, Quantity, UncertaintySource
from pipelines.report.inputs import quantity_text


def quantity(name: str, value: float, std: float, unit: str) -> Quantity:
    line = Contribution(UncertaintySource.TRACK_NOISE, std)
    return Quantity.measured(name, value, unit, (line,))


def test_contact_times_are_shown_in_milliseconds() -> None:
    assert quantity_text(quantity("contact_time", 0.016795, 0.00101, "s")) == "16.8 ± 1.0 ms"
    assert quantity_text(quantity("contact_end", 0.1066, 0.0042, "s")) == "106.6 ± 4.2 ms"
    assert quantity_text(quantity("landing_time", 0.4806, 0.0012, "s")) == "0.4806 ± 0.0012 s"
