"""`vision calibrate plan`: what to expect before anyone films, and what would help."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bench.planning import PLANNED_QUANTITIES, SETTINGS, compared
from measuring.measurement import QUANTITY_UNITS
from pipelines.calibrate.plan import Filming, PlannedRecording, compare_changes, predict_recording
from pipelines.cli import app

SMALL = Filming(width=432, height=240)


@pytest.fixture(scope="module")
def predicted() -> PlannedRecording:
    return predict_recording(SMALL)


def test_every_quantity_has_an_uncertainty_or_a_reason(predicted: PlannedRecording) -> None:
    assert [one.name for one in predicted.quantities] == list(QUANTITY_UNITS)
    for quantity in predicted.quantities:
        assert (quantity.std is not None and quantity.std > 0.0) or quantity.reason
    assert 0.005 < predicted.metres_per_px < 0.008
    assert predicted.std("landing_distance") == pytest.approx(0.005, rel=0.5)


def test_tape_rate_and_pixels_help_where_they_should(predicted: PlannedRecording) -> None:
    untaped = predict_recording(replace(SMALL, tape_std_m=None))
    finer = predict_recording(replace(SMALL, width=864, height=480))
    for name in ("landing_distance", "ball_speed"):
        taped = predicted.std(name)
        assert untaped.std(name) > 2.0 * taped
        # what pixels don't tell, the tape above all, stays as it is
        assert finer.std(name) < 0.85 * taped
    # a tape tells lengths, and angles only as far as the camera's distance bends them
    assert untaped.std("launch_angle") < 1.3 * predicted.std("launch_angle")


def test_a_landing_out_of_view_is_foreseen() -> None:
    near = predict_recording(replace(SMALL, view_rad=0.58))
    landing = next(one for one in near.quantities if one.name == "landing_distance")
    assert landing.value is None
    assert "leaves the picture" in str(landing.reason)


@pytest.mark.slow
def test_the_change_that_helps_most_comes_first() -> None:
    untaped = predict_recording(replace(SMALL, tape_std_m=None))
    changes = compare_changes(untaped)
    assert changes[0].words.startswith("measure camera distance")
    assert changes[0].gain > 1.5
    assert changes[0].ratio(untaped, "landing_distance") < 0.5
    assert any(change.closes for change in changes)


def test_the_command_writes_json_for_scripts(tmp_path: Path) -> None:
    out = tmp_path / "plan.json"
    told = CliRunner().invoke(
        app,
        ["calibrate", "plan", "--resolution", "432x240", "--no-changes", "--json", str(out)],
    )
    assert told.exit_code == 0, told.output
    assert "landing_distance" in told.stdout
    found = json.loads(out.read_text())
    assert found["quantities"]["landing_distance"]["std"] > 0.0
    assert found["quantities"]["backswing_angle"]["reason"]
    assert found["changes"] == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--resolution", "wide"], "not an image size"),
        (["--resolution", "9x9"], "64 to 8192"),
        (["--field-of-view", "170 deg"], "field of view"),
        (["--field-of-view", "50 deg", "--focal-length", "28mm"], "both field of view"),
        (["--light", "0"], "--light"),
        (["--tape", "-3 mm"], "--tape"),
        (["--shutter", "1/100 s"], "shutter"),
        (["--ball-plane", "9 m"], "behind the ball"),
        (["--lens", "nowhere.toml"], "lens file"),
    ],
)
def test_what_makes_no_sense_is_refused(options: list[str], words: str) -> None:
    told = CliRunner().invoke(app, ["calibrate", "plan", "--no-changes", *options])
    assert told.exit_code == 2, told.output
    assert words in told.output


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_renderer_confirms_the_plan() -> None:
    rows = compared(SETTINGS["dim, small image, distances measured"], 2)
    assert {row.name for row in rows} == set(PLANNED_QUANTITIES)
    z = np.concatenate([np.array(row.errors) / row.predicted for row in rows])
    assert len(z) >= 12
    # sixteen values, correlated within a clip: a factor of two about 1 is what they can tell
    assert 0.3 < np.sqrt(np.mean(z**2)) < 2.0
