"""The public API: fast import, display of results, tables, input validation."""

import inspect
import json
import math
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import impact_vision as iv
import sample_videos
from measuring.chain import FollowedClip, MeasureOptions, measure_tracks
from measuring.inputs import gather_inputs
from metrology import (
    ClipError,
    MeasurementError,
    SetupError,
    UncertaintySource,
    UsageError,
    measurands,
    read_number,
    read_scale,
)
from physics.bodies import BALLS, PAPER_PENDULUM, PAPER_SUPPORT
from physics.restitution import ConstantCor
from pipelines.api.quantities import length_text

CLIPS = Path(sample_videos.__file__).parent / "clips"
CLIP = CLIPS / "jokku_90_small.mp4"
MEASURE = ["path", "setup", "fps", "ball", "wall_grid", "ball_at", "mass_at", "cache"]
COR = (
    "distance", "impact_speed", "contact_time", "launch_angle", "support_height", "ball_mass",
    "effective_mass", "ball_diameter",
)  # fmt: skip
EXPLAIN = ["balls", "pendulum", "trials", "setup", "hold_out", "effects"]


@pytest.fixture(scope="module")
def measured() -> iv.Measurement:
    return iv.measure(CLIP, setup=CLIP.with_suffix(".toml"))


def test_import_loads_nothing_heavy() -> None:
    told = subprocess.run(
        [sys.executable, "-c", "import impact_vision, sys; print(*sorted(sys.modules))"],
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = {name.partition(".")[0] for name in told.stdout.split()}
    assert not loaded & {"cv2", "scipy", "pandas", "numpy", "matplotlib", "pipelines", "rich"}
    assert len(told.stdout.split()) < 120


def test_the_public_names_are_complete() -> None:
    for name in iv.__all__:
        assert getattr(iv, name) is not None
        assert name in dir(iv)
    with pytest.raises(AttributeError, match="no_such"):
        iv.no_such  # noqa: B018


def test_the_package_only_re_exports() -> None:
    source = Path(str(iv.__file__)).read_text(encoding="utf-8")
    assert len(source.splitlines()) < 150


@pytest.mark.parametrize(("function", "names"), [(iv.measure, MEASURE), (iv.explain, EXPLAIN)])
def test_signatures_are_as_documented(function: object, names: list[str]) -> None:
    assert [*inspect.signature(function).parameters][: len(names)] == names  # type: ignore[arg-type]


def test_a_quantity_has_its_budget(measured: iv.Measurement) -> None:
    speed = measured.ball_speed
    assert speed is measured.quantities["ball_speed"]
    assert float(speed) == speed.value
    assert "±" in str(speed)
    assert "m/s" in speed._repr_html_()
    budget = speed.budget
    assert list(budget.columns) == ["source", "std", "share"]
    assert budget["std"].is_monotonic_decreasing
    assert np.hypot.reduce(budget["std"]) == pytest.approx(speed.std)
    assert budget["share"].sum() == pytest.approx(1.0)


def test_a_missing_quantity_has_a_reason_and_no_value(measured: iv.Measurement) -> None:
    missing = measured.backswing_angle
    assert missing.value is None
    assert missing.budget.empty
    assert str(missing.reason) in str(missing)
    with pytest.raises(MeasurementError):
        float(missing)
    with pytest.raises(AttributeError, match="no_such"):
        measured.no_such  # noqa: B018


def test_a_measurement_is_a_document_a_row_a_table_and_a_page(
    measured: iv.Measurement, tmp_path: Path
) -> None:
    document = measured.to_dict()
    assert document["quantities"]["ball_speed"]["value"] == measured.ball_speed.value
    assert document["motion"]["kind"] == measured.motion.kind.value == "strike"
    row = measured.to_frame()
    assert len(row) == 1
    assert row["ball_speed_m_s"].item() == measured.ball_speed.value
    tracks = measured.tracks
    assert set(tracks["object"]) >= {"ball", "pendulum"}
    stds = np.sqrt(np.diagonal(measured.covariance("ball"), axis1=1, axis2=2))
    assert stds == pytest.approx(tracks.loc[tracks["object"] == "ball", ["x_m_std", "y_m_std"]])
    assert "ball speed" in repr(measured)
    shown = measured._repr_html_()
    assert "data:image/jpeg" in shown
    assert "ball speed at release" in shown
    assert len(measured.plot().axes) >= 3
    assert "<html" in measured.report(tmp_path / "r.html").read_text(encoding="utf-8")
    overlay = iv.Clip(measured.overlay(tmp_path / "o.mp4"))
    assert len(overlay) == document["clip"]["frames"]


def test_its_tracks_can_be_explained_directly(measured: iv.Measurement) -> None:
    setup = CLIP.with_suffix(".toml")
    flight = iv.explain(balls=measured.tracks, setup=setup)
    swing = iv.explain(pendulum=measured.tracks, setup=setup)
    for verdict in (flight, swing):
        assert verdict.verdict in ("no_mismatch", "explained", "ambiguous", "unexplained")
        assert verdict.to_dict()["verdict"] == verdict.verdict
        assert verdict._repr_html_()
    assert flight.plot().axes


def test_quantities_are_correlated_as_their_sources_are(measured: iv.Measurement) -> None:
    after, before, speed = (
        measured.ufloat(name)
        for name in ("pendulum_speed_after", "pendulum_speed_before", "ball_speed")
    )
    for number, view in ((before, measured.pendulum_speed_before), (speed, measured.ball_speed)):
        assert (number.n, number.s) == pytest.approx((view.value, view.std))
    # Eq. 2 from its three speeds; the scale of the picture cancels
    e = (speed - after) / before
    independent = math.hypot(speed.s, after.s, e.n * before.s) / before.n
    assert e.n == pytest.approx(measured.cor_speeds.value, abs=0.03)
    assert not math.isclose(e.s, independent, rel_tol=0.01)
    together = measured.ufloat("ball_speed", "pendulum_speed_after", "pendulum_speed_before")
    assert together == (speed, after, before)
    assert (measured.ufloat("cor") - measured.ufloat("cor")).s == 0.0
    cor, estimate = measured.ufloat("cor"), measured.ufloat("cor_speeds")
    assert (cor - estimate).s < math.hypot(cor.s, estimate.s)
    with pytest.raises(UsageError, match="no 'speed'"):
        measured.ufloat("speed")
    with pytest.raises(MeasurementError):
        measured.ufloat("swing_period")


def test_a_measurement_is_explained_and_drawn_on_axes(
    measured: iv.Measurement, monkeypatch: pytest.MonkeyPatch
) -> None:
    # the clip's own campaign, as `vision explain CLIP` makes it
    asked: list[Any] = []
    campaign = "pipelines.explain.campaign.explain_campaign"
    monkeypatch.setattr(campaign, lambda *words, **named: asked.append((words, named)))
    monkeypatch.setattr("pipelines.api.explained.Verdict", lambda _: None)
    measured.explain(hold_out=("1",))
    [((records, setup), named)] = asked
    assert records.calibrated
    assert records.widths.keys() >= {"time_base", "length_scale"}
    assert setup.ball is not None
    assert named == {"hold_out": ("1",)}
    axes = Figure().subplots()
    assert measured.plot(ax=axes) is axes
    assert axes.lines
    assert measured.plot(ax=Figure().subplots(), panel="speeds").get_title() == "Speeds"
    with pytest.raises(UsageError, match="no panel 'speed'"):
        measured.plot(ax=axes, panel="speed")


def test_a_clip_is_frames_and_times() -> None:
    clip = iv.Clip(CLIP, fps=600)
    times = [time for image, time in clip if image.shape == (116, 208)]
    assert len(times) == len(clip)
    assert times == pytest.approx(clip.times)
    assert times[6] == pytest.approx(0.01)
    image, time = clip.frame(6)
    assert (time, image.ndim) == (times[6], 2)
    with pytest.raises(IndexError):
        clip.frame(len(clip))


def test_simulate_plan_and_cor_are_consistent() -> None:
    planned = iv.plan("2 m", ball="jokku")
    struck = iv.simulate(backswing=planned.backswing_angle, ball="jokku")
    assert struck.landing_distance.value == pytest.approx(2.0, abs=0.002)
    assert planned.to_dict()["quantities"]["impact_speed"]["unit"] == "m/s"
    assert struck.to_frame()["landing_distance_m"].item() == struck.landing_distance.value
    assert struck.plot().axes
    ball = BALLS["jokku"]
    given = {
        "impact_speed": struck.impact_speed.value,
        "contact_time": struck.contact_time.value,
        "launch_angle": np.degrees(ball.launch_angle),
        "support_height": PAPER_SUPPORT.height,
        "ball_mass": ball.mass,
        "effective_mass": PAPER_PENDULUM.mass_at_contact,
        "ball_diameter": ball.diameter,
    }
    distance = struck.quantities["landing_distance"].value
    e = iv.cor(distance=distance, **given)
    assert isinstance(e, float)
    assert e == pytest.approx(struck.cor_speeds.value, abs=0.01)
    many = iv.cor(distance=np.array([distance, 1.1 * distance]), **given)
    assert many[0] == pytest.approx(e)
    assert many[1] > many[0]


def test_a_constant_law_may_be_a_number() -> None:
    half = iv.simulate(impact_speed="3 m/s", ball="jokku", cor=0.5)
    assert half.cor_speeds.value == pytest.approx(float(ConstantCor(0.5)(3.0)))


def test_impossible_input_is_refused_before_any_work() -> None:
    with pytest.raises(UsageError, match="grid"):
        iv.measure(CLIP, wall_grid=50.0)
    with pytest.raises(UsageError, match="capture rate"):
        iv.measure(CLIP, fps=-600)
    with pytest.raises(UsageError, match="X,Y"):
        iv.measure(CLIP, ball_at=(1, 2, 3, 4))
    with pytest.raises(UsageError, match="not both"):
        iv.explain(balls=pd.DataFrame(), trials=pd.DataFrame())


@pytest.mark.parametrize(
    ("function", "keyword", "meant"),
    [
        (iv.measure, "grid", "wall_grid"),
        (iv.calibrate, "wallgrid", "wall_grid"),
        (iv.simulate, "back_swing", "backswing"),
        (iv.plan, "balls", "ball"),
        (iv.render, "sizes", "size"),
        (iv.explain, "ball", "balls"),
        (iv.cor, "mass", "ball_mass"),
        (iv.campaign, "set_up", "setup"),
        (iv.Clip, "fsp", "fps"),
        (iv.Setup().having, "key", "keys"),
    ],
)
def test_a_wrong_keyword_is_refused_with_the_right_ones(
    function: Callable[..., object], keyword: str, meant: str
) -> None:
    with pytest.raises(UsageError, match=rf"'{keyword}'.*nearest is '{meant}'") as told:
        function(**{keyword: "x"})
    listed = {word.strip(" .") for word in str(told.value.hint).partition("takes")[2].split(",")}
    assert listed == {*inspect.signature(function).parameters} - {"self"}


def test_too_few_and_too_many_values_are_refused() -> None:
    with pytest.raises(UsageError, match=r"measure: .*'path'"):
        iv.measure()
    with pytest.raises(UsageError, match="plan: too many"):
        iv.plan("2 m", "jokku")


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (lambda: iv.Setup(ball="jokku"), "Setup: ball can't be 'jokku'"),
        (lambda: iv.Setup(bal=None), "Setup has no 'bal'; the nearest is 'ball'"),
        (lambda: iv.Setup.load(None), "load: path can't be None"),
        (lambda: iv.Setup().having("ball"), "having: keys can't be 'ball'"),
        (lambda: iv.Setup().having({3: "jokku"}), "having: keys can't be"),
        (lambda: iv.simulate(backswing=[60, 90]), "backswing can't be"),
        (
            lambda: iv.simulate(backswing_deg=60, effects="magnus:spin=10"),
            "effects can't be 'magnus",
        ),
        (lambda: iv.simulate(backswing_deg=60, setup={"ball": "jokku"}), "setup can't be"),
        (lambda: iv.measure(None), "path can't be None"),
        (lambda: iv.measure(CLIP, setup=3), "setup can't be 3"),
        (lambda: iv.Clip(CLIP).frame("3"), "index can't be '3'"),
        (lambda: iv.explain(balls=[1, 2]), "no table"),
        (lambda: iv.explain(balls=pd.DataFrame(), effects=[3]), "3 is no effect"),
        (lambda: iv.render("a.mp4", size=(10,)), "size can't be"),
        (lambda: iv.render("a.mp4", frames="many"), "frames can't be 'many'"),
        (lambda: iv.cor(**dict.fromkeys(COR, "2 m")), "could not convert"),
        (lambda: iv.cor(**{key: [1, 2] for key in COR[1:]}, distance=[1, 2, 3]), "shape"),
    ],
)
def test_a_value_of_another_kind_is_refused(asked: Callable[[], object], said: str) -> None:
    with pytest.raises(UsageError, match=re.escape(said)):
        asked()


def test_numbers_and_points_may_be_numpy_types() -> None:
    angle = iv.simulate(backswing_deg=np.float32(90), ball="jokku").backswing_angle.value
    assert angle == pytest.approx(90.0)
    assert iv.Clip(CLIP).frame(np.int64(2)).time_s > 0.0
    with pytest.raises(ClipError):
        iv.measure("nowhere.mp4", ball_at=np.array([1.0, 2.0]), wall_grid=np.float64(0.05))


@pytest.mark.parametrize("length", [0.05, np.float64(0.05), np.float32(0.05), "50 mm"])
def test_a_length_is_a_number_of_any_kind_or_text(length: float | str) -> None:
    typed = length_text(length)
    assert typed is not None
    assert read_number(typed, measurands.GRID_PITCH) == pytest.approx(0.05)
    with pytest.raises(UsageError, match="no length"):
        length_text((0.05, 0.01))


@pytest.mark.parametrize("cache", [True, False])
def test_the_cache_option_reaches_the_chain(
    cache: bool, measured: iv.Measurement, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[bool] = []

    def chain(path: Path, options: MeasureOptions, _: object) -> object:
        asked.append(options.cache)
        return measured.record

    monkeypatch.setattr("pipelines.api.measured.measure_clip", chain)
    iv.measure(CLIP, cache=cache)
    assert asked == [cache]


def test_a_given_scale_is_used_without_wall_and_ball(
    measured: iv.Measurement,
) -> None:
    """The scale is what the wall gave, the speed to be found is the renderer's."""
    truth = json.loads(CLIP.with_suffix(".truth.json").read_text(encoding="utf-8"))["quantities"]
    tracks, rate = measured.record.tracks, measured.record.rate
    ball = measured.tracks.query("object == 'ball'")
    per_px = float(np.ptp(ball["x_m"]) / np.ptp(ball["x_px"]))
    followed = FollowedClip(
        tracks,
        np.arange(float(tracks.ball.frame[-1] + 1)),
        rate,
        gather_inputs(iv.Setup(), None, None),
        read_scale(f"{1.0 / per_px} px/m ± 3 %"),
    )
    found = {quantity.name: quantity for quantity in measure_tracks(followed).results.quantities}
    speed = found["ball_speed"]
    assert speed.known, speed.reason
    assert speed.value == pytest.approx(truth["ball_speed"]["value"], abs=2.0 * speed.std)
    lines = {line.source: line.std for line in speed.budget}
    assert lines[UncertaintySource.SCALE] == pytest.approx(0.03 * speed.value, rel=0.2)
    assert UncertaintySource.BALL_DIAMETER not in lines
    assert not found["landing_distance"].known


def test_the_catalogue_and_its_base_class_are_public() -> None:
    assert "magnus" in iv.effects.CATALOGUE
    assert inspect.isclass(iv.effects.Effect)


def test_a_setup_is_read_edited_and_written_back(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text('[wall]\ngrid = "50 mm"\n[ball]\npreset = "jokku"\n')
    edited = iv.Setup.load(path).having({"ball.mass": "0.351 kg ± 1 g", "wall.grid": "4 cm"})
    again = iv.Setup.load(edited.save(tmp_path / "other.toml"))
    assert (again.ball.mass, again.ball.mass_std) == (0.351, 0.001)
    assert again.wall.grid == pytest.approx(0.04)
    assert again == edited
    with pytest.raises(SetupError, match="grid"):
        edited.having({"wall.grid": "50"})
