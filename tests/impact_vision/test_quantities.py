"""Quantities in a notebook: display, arithmetic, names and messages."""

from pathlib import Path

import pytest

import impact_vision as iv
from metrology import Contribution, MeasurementError, Quantity, UncertaintySource, UsageError
from pipelines.api import shown
from pipelines.api.quantities import Quantities
from pipelines.api.shown import notebook_progress
from pipelines.api.wording import in_python

SPEED = Quantity("ball_speed", 3.0, 0.1, "m/s")
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
        (1 - speed, -3.0, 0.1),
    ):
        assert (other.value, other.std) == pytest.approx((value, std))
    with pytest.raises(UsageError, match="correlated"):
        speed * speed  # type: ignore[operator]
    for other_kind in (lambda: 1 / speed, lambda: speed**2, lambda: 2**speed):
        with pytest.raises(UsageError, match="ufloat"):
            other_kind()
    with pytest.raises(MeasurementError, match="hidden"):
        2 * iv.QuantityView("ball_speed", None, None, "m/s", "it is hidden")


def test_several_clips_are_for_a_campaign() -> None:
    with pytest.raises(UsageError) as refusal:
        iv.measure(["a.mp4", "b.mp4"])  # type: ignore[arg-type]
    assert "iv.campaign" in str(refusal.value.hint)


@pytest.mark.parametrize(
    ("command", "python"),
    [
        ("Pass --wall-grid 50mm.", 'Pass wall_grid="50mm".'),
        ("for example --fps 240 --ball 220mm (or", 'for example fps=240, ball="220mm" (or'),
        ("instead: --scale '410 px/m')", 'instead: scale="410 px/m")'),
        ("point at it with --ball-at 12,88,3.", "point at it with ball_at=(12, 88, 3)."),
        ("with --mass-at X,Y and --ball-at X,Y", "with mass_at=(X, Y) and ball_at=(X, Y)"),
        ("check --wall-grid and --ball, and that", "check wall_grid and ball, and that"),
        ("Pass --fps RATE, or set capture_fps", "Pass fps=RATE, or set capture_fps"),
        ("give --ball jokku or a setup file", 'give ball="jokku" or a setup file'),
    ],
)  # fmt: skip
def test_messages_name_arguments(command: str, python: str) -> None:
    assert in_python(command) == python


def test_errors_of_functions_name_arguments(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="scale and wall_grid") as refusal:
        iv.measure(tmp_path, scale="1 mm/px", wall_grid="50mm")
    assert "--" not in str(refusal.value)
    with pytest.raises(UsageError) as refusal:
        iv.measure(tmp_path, ball_at="here")
    assert "--" not in str(refusal.value)


def test_an_angle_needs_its_unit() -> None:
    with pytest.raises(UsageError, match="degrees or radians") as refusal:
        iv.simulate(backswing=90)
    assert "'90 deg'" in str(refusal.value)
    with pytest.raises(UsageError, match="degrees or radians"):
        iv.render("a.mp4", backswing="90")
    asked = (
        {"backswing": "90 deg"}, {"backswing_deg": 90}, {"backswing_angle": "1.5707963267949 rad"},
    )  # fmt: skip
    found = [iv.simulate(**names, ball="jokku") for names in asked]  # type: ignore[arg-type]
    speeds = [one.impact_speed.value for one in found]
    assert speeds == pytest.approx([speeds[0]] * 3)
    again = iv.simulate(backswing=found[0].backswing, ball="jokku")
    assert again.impact_speed.value == pytest.approx(speeds[0])
    with pytest.raises(UsageError, match="backswing_deg"):
        iv.simulate(backswing="90 deg", backswing_deg=90)  # type: ignore[call-arg]


def test_other_names_of_a_quantity_find_it() -> None:
    quantities = Quantities([Quantity("backswing_angle", 90.0, 1.0, "deg"), SPEED])
    for name in ("backswing", "backswing_deg", "backswing_angle", "backswing_angle_deg"):
        assert quantities[name].name == "backswing_angle"
    assert quantities["ball_speed_m_s"] is quantities["ball_speed"]
    assert list(quantities) == ["backswing_angle", "ball_speed"]
    assert "speed" not in quantities


def test_a_campaign_in_python_has_the_folder_and_refusals_of_the_command(tmp_path: Path) -> None:
    with pytest.raises(UsageError) as refused:
        iv.campaign([tmp_path / "a.mp4"], out=tmp_path / "res.csv")
    assert "is the name of a file" in str(refused.value)
    assert "--out" not in str(refused.value)
    (tmp_path / "a.mp4").write_bytes(b"no video")
    assert iv.campaign(tmp_path).wanting
    assert (tmp_path / "results" / "results.csv").is_file()


def test_quantities_are_compared_and_rounded_as_numbers() -> None:
    speed = Quantities([Quantity.measured("ball_speed", -5.126, "m/s", [])])["ball_speed"]
    assert speed < -5.0
    assert speed <= -5.126 <= speed
    assert abs(speed) > 5.0
    assert round(speed, 1) == -5.1


def test_a_notebook_shows_the_step_and_its_fraction(monkeypatch: pytest.MonkeyPatch) -> None:
    shells = pytest.importorskip("IPython.core.interactiveshell").InteractiveShell
    publishers = pytest.importorskip("IPython.core.displaypub")
    with notebook_progress() as show:
        assert show is None
    shell = shells.instance(display_pub_class=publishers.CapturingDisplayPublisher)
    try:
        shell.kernel = object()
        monkeypatch.setattr(shown, "_PATIENCE_S", -1.0)
        with notebook_progress() as show:
            assert show is not None
            show("Tracking", 0.1)
            show("Tracking", 0.5)
        said = [one["data"]["text/plain"] for one in shell.display_pub.outputs]
    finally:
        shells.clear_instance()
    assert said == ["Tracking: 10 %", "Tracking: 50 %", ""]
