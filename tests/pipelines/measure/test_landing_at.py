"""A landing point that a person states."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from measuring.chain import MeasureOptions, measure_clip
from measuring.measurement import ClipMeasurement
from measuring.setup.file import load_setup
from metrology import UsageError
from pipelines.api.quantities import measure_options
from pipelines.measure.files import overlay_marks
from tests.pipelines.app.small import CLIP, falling, strike

TRUTH = json.loads(CLIP.with_suffix(".truth.json").read_text(encoding="utf-8"))["quantities"]


def given() -> MeasureOptions:
    return measure_options(load_setup(CLIP.with_suffix(".toml")), cache=True)


def found_at() -> tuple[float, float]:
    place = overlay_marks(strike()).landing_px
    assert place is not None
    return float(place[0]), float(place[1])


def pull(measured: ClipMeasurement, name: str) -> float:
    quantity = measured.quantity(name)
    assert quantity.value is not None, quantity.reason
    assert quantity.std is not None
    return abs(quantity.value - TRUTH[name]["value"]) / quantity.std


def test_a_landing_stated_where_it_is_gives_the_true_distance() -> None:
    here = measure_clip(CLIP, replace(given(), landing_at=found_at()))
    for name in ("landing_distance", "landing_distance_on_wall", "landing_time", "cor_range"):
        assert pull(here, name) < 2.0
    assert not any("landing point" in one for one in here.warnings)
    # the place was stated, so the height of the support is not assumed
    assert any("support height" in one for one in strike().warnings)
    assert not any("support height" in one for one in here.warnings)


def test_the_distance_follows_the_stated_point_which_is_doubted_off_the_path() -> None:
    x, y = found_at()
    there = measure_clip(CLIP, replace(given(), landing_at=(x + 10.0, y)))
    shown = there.quantity("landing_distance")
    before, after = strike().quantity("landing_distance").value, shown.value
    assert before is not None
    assert after is not None
    # the point or the flight is wrong by as much
    assert shown.std is not None
    assert shown.std > 0.9 * (after - before)
    elsewhere = measure_clip(CLIP, replace(given(), landing_at=(x - 40.0, y)))
    refused = elsewhere.quantity("landing_distance")
    assert refused.value is None
    assert "--landing-at" in str(refused.reason)
    metres_per_px = TRUTH["landing_distance"]["value"] / (x - rest_x())
    assert after - before == pytest.approx(10.0 * metres_per_px, rel=0.1)
    warning = next(one for one in there.warnings if "stated landing point" in one)
    assert f"{1e3 * (after - before):.0f} mm beyond" in warning
    assert "--landing-at" in warning
    assert np.allclose(overlay_marks(there).landing_px, (x + 10.0, y))


def rest_x() -> float:
    ball = strike().tracks.ball
    return float(ball.centre_px[0, 0])


def test_without_a_grid_the_stated_landing_is_measured_as_the_speed_is() -> None:
    options = measure_options(fps="600", ball="201.75mm", scale="73.5 px/m ± 1.5 px/m", cache=True)
    without = measure_clip(CLIP, options).quantity("landing_distance")
    assert "--landing-at" in str(without.reason)
    stated = measure_clip(CLIP, replace(options, landing_at=found_at()))
    assert pull(stated, "landing_distance") < 2.0
    assert pull(stated, "ball_speed") < 2.0


@pytest.mark.parametrize("landing", ["120,8,3", "there", "nan,2"])
def test_a_wrong_point_is_refused(landing: str) -> None:
    with pytest.raises(UsageError, match="--landing-at"):
        measure_options(landing_at=landing)


@pytest.mark.parametrize("place", [(9999.0, 50.0), (100.0, -400.0)])
def test_a_landing_outside_the_picture_is_refused(place: tuple[float, float]) -> None:
    with pytest.raises(UsageError, match=r"outside the picture of 208 × 116 px") as refused:
        measure_clip(CLIP, replace(given(), landing_at=place))
    assert refused.value.hint is not None


def test_a_fall_has_no_landing(tmp_path: Path) -> None:
    clip = falling(tmp_path / "fall")
    with pytest.raises(UsageError, match="a struck ball only"):
        measure_clip(clip, measure_options(fps="240", landing_at=(60.0, 150.0), cache=True))
