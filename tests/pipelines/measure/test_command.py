"""The commands that measure clips, on a clip that ships with the package and on bad input."""

import csv
import io
import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import sample_videos
from measuring.budget import Propagation
from measuring.chain import MeasureOptions
from measuring.checks import MIN_CHECK_POWER
from measuring.impact import disc_contact
from measuring.measurement import ClipMeasurement
from measuring.setup.file import read_setup
from metrology import ClipError, SetupError, UnitError, parse_measured, parse_quantity
from pipelines.cli import app
from tests.shared_data import shared_folder
from vision.clip.clip import ClipReader
from vision.following import follow

CLIPS = Path(sample_videos.__file__).parent / "clips"
TRACK_COLUMNS = (
    "frame,t_s,object,x_px,y_px,x_px_std,y_px_std,x_m,y_m,x_m_std,y_m_std,radius_px,"
    "phi_rad,phi_rad_std,phi_zero_std"
)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("measured")
    clip = CLIPS / "basketball_60.mp4"
    arguments = ["measure", str(clip), "--setup", str(clip.with_suffix(".toml")), "--quiet"]
    for option, name in [
        ("--json", "r.json"),
        ("--csv", "r.csv"),
        ("--tracks", "t.csv"),
        ("--overlay", "o.mp4"),
        ("--report", "r.html"),
        ("--plot", "p.png"),
    ]:
        arguments += [option, str(folder / name)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    return folder


def truth() -> dict[str, float]:
    text = (CLIPS / "basketball_60.truth.json").read_text(encoding="utf-8")
    values = {name: item["value"] for name, item in json.loads(text)["quantities"].items()}
    return values | {"cor": values["cor_speeds"]}


@pytest.mark.parametrize(
    ("name", "within"),
    [
        ("ball_speed", 0.005 * 3.79),
        ("launch_angle", 0.3),
        ("landing_distance", 0.003 * 1.35),
        ("landing_distance_on_wall", 0.003 * 1.5),
        ("landing_time", 0.002),
        ("contact_time", 2.5 / 600),
        ("contact_frames", 2),
        ("pendulum_speed_before", 0.03),
        ("cor_speeds", 0.03),
        ("cor_launch", 0.02),
        ("cor", 0.02),
        ("ball_plane_offset", 0.02),
    ],
)
def test_the_sample_clip_is_measured(measured: Path, name: str, within: float) -> None:
    quantity = json.loads((measured / "r.json").read_text(encoding="utf-8"))["quantities"][name]
    assert quantity["value"] == pytest.approx(truth()[name], abs=within)
    assert abs(quantity["value"] - truth()[name]) < 4 * quantity["std"]


def test_the_papers_ways_to_the_balls_speed_stand_beside_it(measured: Path) -> None:
    document = json.loads((measured / "r.json").read_text(encoding="utf-8"))
    beside = document["beside"]
    frames, pendulum = beside["ball_speed_per_frame"], beside["ball_speed_eq7"]
    assert abs(frames["value"] - truth()["ball_speed"]) < 3 * frames["std"]
    # Eq. 7 lets all of the pendulum's change of speed act on the ball, gravity included
    assert pendulum["value"] > truth()["ball_speed"]
    check = next(item for item in document["checks"] if "paper's methods" in item["name"])
    # they agree; whether a wrong speed would be detected is the check's power, not its wording
    assert check["passed"] is not False
    assert (check["passed"] is None) == (check["power"] < MIN_CHECK_POWER)
    assert "Eq. 7" in check["statement"]


def test_json_and_csv_are_the_contracts(measured: Path) -> None:
    document = json.loads((measured / "r.json").read_text(encoding="utf-8"))
    assert {"clip", "time_base", "quantities", "warnings", "software"} <= set(document)
    assert document["time_base"]["source"] == "setup"
    assert document["time_base"]["gravity_check"]["value"] == pytest.approx(9.806, abs=0.3)
    assert document["quantities"]["backswing_angle"]["value"] is None
    assert document["quantities"]["backswing_angle"]["reason"]
    row = next(csv.DictReader(io.StringIO((measured / "r.csv").read_text(encoding="utf-8"))))
    assert {"clip", "ball_speed_m_s", "ball_speed_m_s_std", "external_impulse_N_s"} <= set(row)
    assert {"contact_frames", "launch_angle_deg", "cor_launch"} <= set(row)
    assert row["reason_backswing_angle"] == document["quantities"]["backswing_angle"]["reason"]
    assert (row["capture_fps"], row["capture_fps_source"]) == ("600.0", "setup")
    eq7 = document["beside"]["ball_speed_eq7"]["value"]
    assert float(row["ball_speed_eq7_m_s"]) == pytest.approx(eq7)
    tracks = (measured / "t.csv").read_text(encoding="utf-8").splitlines()
    assert tracks[0] == TRACK_COLUMNS
    assert {line.split(",")[2] for line in tracks[1:]} == {"ball", "pendulum"}


def test_a_budget_adds_up_to_its_uncertainty_largest_line_first(measured: Path) -> None:
    document = json.loads((measured / "r.json").read_text(encoding="utf-8"))
    for name, quantity in document["quantities"].items():
        if quantity["value"] is None:
            assert name not in document["budget"]
            continue
        stds = [line["std"] for line in document["budget"][name]]
        assert stds == sorted(stds, reverse=True)
        assert math.hypot(*stds) == pytest.approx(quantity["std"], rel=1e-9)


def test_the_pendulums_track_is_that_of_the_rendered_one(measured: Path) -> None:
    table = pd.read_csv(measured / "t.csv")
    truth = json.loads((CLIPS / "basketball_60.truth.json").read_text(encoding="utf-8"))
    swing = table[table["object"] == "pendulum"]
    phi = np.asarray(truth["frames"]["phi_rad"])[swing["frame"]]
    off = swing["phi_rad"] - phi
    # all angles of a clip share an error of a degree or so: where the pivot is taken to be
    assert np.abs(off.median()) < np.radians(1.5)
    assert np.abs(off).max() < np.radians(2.0)
    # what is left beside it, slow errors along the swing among it, is what a row states
    left = np.sqrt(np.mean((off - off.median()) ** 2))
    assert 0.4 < left / swing["phi_rad_std"].median() < 2.0
    resting = table[(table["object"] == "ball") & (table["t_s"] < 0.06)][["x_m", "y_m"]].median()
    pivot = np.subtract(truth["pivot_m"], truth["frames"]["ball_m"][0])[:2] + resting
    x, y = (swing[["x_m", "y_m"]] - pivot).to_numpy().T
    assert np.abs(np.arctan2(x, -y) - phi).max() < np.radians(2.5)
    assert np.ptp(np.hypot(x, y)) < 0.03
    assert table.loc[table["object"] == "ball", "phi_rad"].isna().all()


def greens(clip: ClipReader) -> int:
    """Pixels of the colour in which the wall's grid is drawn."""
    _, picture = next(iter(clip.colour_frames(100, 101)))
    blue, green, red = picture.astype(int).transpose(2, 0, 1)
    return int(((green > red + 40) & (green > blue + 15)).sum())


def test_pictures_are_written(measured: Path) -> None:
    overlay = ClipReader.open(measured / "o.mp4")
    assert overlay.info.frames > 250
    assert greens(overlay) > greens(ClipReader.open(CLIPS / "basketball_60.mp4")) + 500
    assert "<html" in (measured / "r.html").read_text(encoding="utf-8").lower()
    assert (measured / "p.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["measure", "nowhere.mp4"], 3, "nowhere.mp4"),
        (["landing", "x.mp4", "--ball", "football-ish"], 2, "preset"),
        (["landing", "x.mp4", "--wall-grid", "50 kg"], 2, "50 kg"),
        (["launch", "x.mp4", "--fps", "-3"], 2, "--fps"),
        (["measure", "x.mp4", "--scale", "409.9 px/s"], 2, "--scale"),
        (["measure", "x.mp4", "--scale", "409.9"], 2, "m/px"),
        (["measure", "x.mp4", "--scale", "-2 mm/px"], 2, "--scale"),
        (["launch", "x.mp4", "--scale", "2 mm/px", "--wall-grid", "50mm"], 2, "not both"),
        (["launch", "x.mp4", "--ball-at", "12"], 2, "--ball-at"),
        (["cor", "x.mp4", "--setup", "none.toml"], 2, "none.toml"),
        (["measure", "a.mp4", "b.mp4", "--report", "r.html"], 2, "one clip"),
    ],
)
def test_bad_input_is_told(arguments: list[str], code: int, said: str) -> None:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == code
    assert said in result.output
    assert "Traceback" not in result.output


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--json", "nowhere/r.json"], "the folder nowhere does not exist"),
        (["--csv", "."], "a folder"),
        (["--overlay", "o.txt"], ".mp4"),
        (["--plot", "p.bmp"], ".png"),
        (["--overlay", "clip.mp4"], "is an input"),
        (["--csv", "r.csv", "--tracks", "r.csv"], "named twice"),
    ],
)
def test_files_that_cannot_be_written_are_told_before_anything_is_measured(
    options: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    clip = tmp_path / "clip.mp4"
    clip.write_bytes(b"not looked at")
    for command in ("measure", "launch"):
        result = CliRunner().invoke(app, [command, "clip.mp4", *options])
        assert result.exit_code == 2
        assert said in result.output
    assert list(tmp_path.iterdir()) == [clip]
    assert clip.read_bytes() == b"not looked at"


@pytest.mark.parametrize(
    "options",
    [
        # a smaller clip at a wrong rate is in test_bad_clips
        pytest.param(["--fps", "30"], marks=pytest.mark.slow, id="wrong rate"),
        pytest.param(
            ["--wall-grid", "100mm", "--setup", str(CLIPS / "basketball_60.toml")],
            marks=pytest.mark.slow,
            id="wrong pitch",
        ),
    ],
)
def test_what_gravity_contradicts_is_withheld(options: list[str]) -> None:
    clip = str(CLIPS / "basketball_60.mp4")
    result = CliRunner().invoke(app, ["landing", clip, "--ball", "basketball", *options])
    assert result.exit_code == 4
    assert "free fall gives" in result.output


def test_an_input_that_a_quantity_needs_is_missed_before_the_work_begins(tmp_path: Path) -> None:
    clip = tmp_path / "notes.mp4"
    clip.write_text("not a video", encoding="utf-8")
    result = CliRunner().invoke(app, ["landing", str(clip)])
    assert result.exit_code == 3
    assert result.output.index("height of the support") < result.output.index("not pictures")


def test_a_text_under_a_videos_name_is_refused(tmp_path: Path) -> None:
    clip = tmp_path / "notes.mp4"
    clip.write_text("not a video", encoding="utf-8")
    result = CliRunner().invoke(app, ["contact-time", str(clip)])
    assert result.exit_code == 3
    assert "video" in result.output


@pytest.mark.parametrize("text", ["5 kg", "", "nan", "1/0 s", "50 parsecs of mm", "[1]"])
def test_what_is_no_length_is_refused(text: str) -> None:
    with pytest.raises(UnitError):
        parse_quantity(text, "m")


def test_quantities_are_parsed_with_their_uncertainty() -> None:
    assert parse_quantity("50mm", "m") == pytest.approx(0.05)
    assert parse_quantity("1/2000 s", "s") == pytest.approx(0.0005)
    assert parse_quantity("26 degC", "kelvin") == pytest.approx(299.15)
    assert parse_measured("4.00 m ± 5 mm", "m") == pytest.approx((4.0, 0.005))


def test_a_slip_in_the_setup_names_the_nearest_key() -> None:
    with pytest.raises(SetupError, match="nearest is 'capture_fps'"):
        read_setup("[camera]\ncapture_fsp = 600")


def test_a_pendulum_of_ones_own_has_its_own_effective_mass() -> None:
    setup = read_setup('[pendulum]\nlength = "0.6 m"\ninertia = "1.8 kg m^2"')
    assert setup.pendulum is not None
    assert setup.pendulum.mass_at_contact == pytest.approx(1.8 / 0.36)


def test_real_pucks_meet_at_frame_67() -> None:
    clip = ClipReader.open(shared_folder("clips") / "puck_collision_A_canon240.mp4")
    met = disc_contact(follow(clip, 240.0))
    assert met is not None
    assert met.time_s * 240.0 == pytest.approx(67.0, abs=1.0)


def test_budget_refit_reaches_the_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[MeasureOptions] = []

    def measure(path: Path, options: MeasureOptions, progress: object = None) -> ClipMeasurement:
        told.append(options)
        raise ClipError("enough")

    monkeypatch.setattr("pipelines.measure.commands.measure_clip", measure)
    clip = str(CLIPS / "basketball_60.mp4")
    for command in ("measure", "contact-time", "launch", "landing", "cor"):
        assert CliRunner().invoke(app, [command, clip, "--budget", "refit"]).exit_code == 3
        assert CliRunner().invoke(app, [command, clip]).exit_code == 3
    assert [one.budget for one in told] == [Propagation.REFIT, Propagation.RESPONSE] * 5


@pytest.mark.slow
def test_both_ways_to_a_budget_agree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMPACT_VISION_CACHE", str(tmp_path / "kept"))
    clip = CLIPS / "basketball_60.mp4"
    arguments = ["measure", str(clip), "--setup", str(clip.with_suffix(".toml")), "--quiet"]
    documents = []
    for how in Propagation:
        out = tmp_path / f"{how}.json"
        assert (
            not CliRunner().invoke(app, [*arguments, "--budget", how, "--json", str(out)]).exit_code
        )
        documents.append(json.loads(out.read_text(encoding="utf-8"))["quantities"])
    for name, quantity in documents[0].items():
        if quantity["value"] is not None:
            assert documents[1][name]["std"] == pytest.approx(quantity["std"], rel=0.02), name


def test_what_has_no_curves_is_told_and_written_all_the_same(tmp_path: Path) -> None:
    clip = shared_folder("clips") / "puck_collision_A_canon240.mp4"
    arguments = ["measure", str(clip), "--fps", "240"]
    arguments += ["--plot", str(tmp_path / "p.png"), "--json", str(tmp_path / "r.json")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert "nothing to plot" in result.output
    assert "COR along the line of centres" in result.output
    assert (tmp_path / "r.json").exists()
    assert not (tmp_path / "p.png").exists()
    # with a scale there are curves
    result = CliRunner().invoke(app, [*arguments, "--ball", "50mm"])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "p.png").exists()
