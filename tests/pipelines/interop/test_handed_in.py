"""Tables as people hand them in come out right without an option, or with the one they gave."""

import json
import pickle
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from measuring.checker.fall import find_fall, units_by_fall
from metrology import MeasurementError, UsageError
from pipelines.api.quantities import measure_options
from pipelines.cli import app
from pipelines.interop.headers import positions_of, read_clock, time_column
from pipelines.interop.measured import measure_from_tracks, read_tracks
from pipelines.interop.tables import parse_columns
from tests.shared_data import shared_folder

NAMED = "ball=mass B, pendulum=Mass A"
FILES = [
    ("r06_plain_txy_metres.csv", "", "the unit is m"),
    ("r07_tracker_two_masses_uneven_columns.txt", NAMED, ""),
    ("r08_tracker_centimetres.txt", "", "the unit is cm"),
    ("r09_excel_dates.xlsx", "", "times are dates"),
    ("r10_excel_serial_days.xlsx", "", "serial days"),
    ("r11_vernier.csv", "", ""),
    ("r12_pasco_two_head_lines.csv", "", ""),
    ("r14_kinovea_timeseries.csv", "", ""),
    ("r15_tracker_second_mass_has_more_columns.txt", NAMED, "4 of 303 rows have no position"),
    ("r16_wide_two_objects.csv", "", "4 of 303 rows have no position"),
]
COMPARED = ("ball_speed", "launch_angle", "pendulum_speed_before", "contact_time", "cor_speeds")


@pytest.mark.parametrize(("name", "columns", "note"), FILES)
def test_a_table_comes_out_right(name: str, columns: str, note: str) -> None:
    folder = shared_folder("inputs")
    truth = json.loads((folder / "truth.json").read_text())
    found = measure_from_tracks(
        folder / name, measure_options(ball="jokku"), columns=parse_columns(columns)
    )
    alone = len(read_tracks(folder / name).tracks) == 1
    # a ball alone does not show what set it in motion
    assert found.motion.kind.value in ({"strike", "flight"} if alone else {"strike"})
    assert found.rate.fps == pytest.approx(600.0, rel=1e-4)
    assert note in " ".join(found.warnings)
    known = [one for one in map(found.quantity, COMPARED) if one.known]
    assert len(known) == (2 if alone else len(COMPARED))
    for one in known:
        assert abs(one.value - truth[one.name]["value"]) < 2.0 * one.std, one.name


def test_deeplabcuts_own_file_is_read() -> None:
    pytest.importorskip("h5py", reason="h5py comes with the extra sleap")
    folder = shared_folder("inputs")
    truth = json.loads((folder / "truth.json").read_text())
    options = measure_options(ball="jokku", fps="600", scale="73.4 px/m")
    found = measure_from_tracks(folder / "r13_dlc.h5", options)
    for name in COMPARED:
        one = found.quantity(name)
        assert abs(one.value - truth[name]["value"]) < 2.0 * one.std, name


def test_deeplabcuts_table_is_read_without_unpickling(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="h5py comes with the extra sleap")
    heads = [("DLC", part, kind) for part in ("ball", "mass") for kind in ("x", "y", "likelihood")]
    rows = np.zeros(5, dtype=[("index", "i8"), ("values_block_0", "f8", (6,))])
    rows["index"] = np.arange(5)
    rows["values_block_0"] = np.arange(30).reshape(5, 6)
    rows["values_block_0"][:, [2, 5]] = 0.99
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("df_with_missing")
        group.attrs["pandas_type"] = np.bytes_(b"frame_table")
        group.attrs["non_index_axes"] = np.void(pickle.dumps([(1, heads)], protocol=0))
        group.create_dataset("table", data=rows)
    found = read_tracks(tmp_path / "a.h5")
    assert [track.name for track in found.tracks] == ["ball", "mass"]
    assert found.tracks[1].px[2].tolist() == [15.0, 16.0]


@pytest.mark.parametrize(
    ("header", "pairs"),
    [
        ("t,x,y", [("", "x", "y")]),
        ("Run 1: Time (s),Run 1: X (m),Run 1: Y (m)", [("", "Run 1: X (m)", "Run 1: Y (m)")]),
        (
            "Zeit;Kugel x;Kugel y;Pendel x;Pendel y",
            [("kugel", "Kugel x", "Kugel y"), ("pendel", "Pendel x", "Pendel y")],
        ),
        ("temps;hauteur (m);abscisse (m)", [("", "abscisse (m)", "hauteur (m)")]),
        ("t,X Velocity (m/s),Y Velocity (m/s),X (m),Y (m)", [("", "X (m)", "Y (m)")]),
        ("t,ball_x,ball_y,ball_x_std", [("ball", "ball_x", "ball_y")]),
        (
            "Run 1: X,Run 1: Y,Run 2: X,Run 2: Y",
            [("run 1", "Run 1: X", "Run 1: Y"), ("run 2", "Run 2: X", "Run 2: Y")],
        ),
        ("t,vx,vy", []),
        ("t,x", []),
    ],
)
def test_headers_of_several_languages(header: str, pairs: list[tuple[str, str, str]]) -> None:
    names = header.split(";") if ";" in header else header.split(",")
    assert [(one.name, one.x, one.y) for one in positions_of(names)] == pairs


def test_the_time_is_one_column() -> None:
    assert time_column(["Latest: Time (s)", "Latest: X (m)"]) == "Latest: Time (s)"
    assert time_column(["Zeit", "Time", "x"]) is None


@pytest.mark.parametrize(
    ("cells", "steps"),
    [
        (["10:03:07.002", "10:03:07.004"], [0.0, 0.002]),
        (["23:59:59.5", "00:00:00.5"], [0.0, 1.0]),
        (["03:07,25", "03:07,75"], [0.0, 0.5]),
        (["2024-05-14 10:03:07.5", "2024-05-14 10:03:09"], [0.0, 1.5]),
        ([45426.5, 45426.5 + 1.0 / 86400.0], [0.0, 1.0]),
        ([1_700_000_000.0, 1_700_000_001.5], [0.0, 1.5]),
        ([1_700_000_000_000.0, 1_700_000_000_004.0], [0.0, 0.004]),
    ],
)
def test_times_of_all_kinds(cells: list[object], steps: list[float]) -> None:
    clock = read_clock(pd.Series(cells), None)
    assert clock is not None
    assert clock.note
    assert clock.seconds == pytest.approx(steps, abs=2e-6)


def test_plain_seconds_are_left_alone() -> None:
    assert read_clock(pd.Series([0.0, 0.5]), None) is None
    assert read_clock(pd.Series([45426.5, 45427.0]), "s") is None


@pytest.mark.parametrize(
    ("scale", "tick", "unit"),
    [(1.0, 1.0, "m"), (100.0, 1.0, "cm"), (1000.0, 1e3, "mm"), (1 / 0.0254, 1.0, "in")],
)
def test_units_follow_from_a_fall(scale: float, tick: float, unit: str) -> None:
    time = np.arange(60) / 240.0
    rng = np.random.default_rng(3)
    place = np.column_stack([1.5 * time, 1.0 + 2.0 * time - 0.5 * 9.81 * time**2])
    place = scale * (place + rng.normal(0.0, 1e-3, place.shape))
    found = units_by_fall([(tick * time, place)], ("s", "ms"))
    assert found is not None
    assert (found.length, found.time) == (unit, "s" if tick == 1.0 else "ms")
    # image coordinates point down, and a swing is no fall
    assert units_by_fall([(tick * time, place * [1.0, -1.0])], ("s", "ms")) is None
    swing = scale * np.column_stack([np.sin(9.0 * time), -np.cos(9.0 * time)])
    assert units_by_fall([(tick * time, swing + rng.normal(0.0, 1e-4, swing.shape))]) is None


def test_a_fall_within_a_longer_record_is_found() -> None:
    time = np.arange(200) / 240.0
    since = np.clip(time - 0.2, 0.0, None)
    rng = np.random.default_rng(4)
    place = np.column_stack([2.0 * since, 1.0 - 0.5 * 9.81 * since**2])
    place[150:] = place[150]
    fall = find_fall(time, place + rng.normal(0.0, 1e-3, place.shape))
    assert fall is not None
    assert 40 <= fall.first < fall.last <= 155
    assert abs(fall.acceleration[1] + 9.81) < 5.0 * fall.std


def test_rows_without_a_mark_are_accounted_for(tmp_path: Path) -> None:
    rows = [f"{0.01 * k:.2f},{k},{k * k}" for k in range(12)]
    rows[4], rows[7] = "0.03,3,9", "0.07,,"
    (tmp_path / "a.csv").write_text("t,x,y\n" + "\n".join(rows) + "\n")
    found = read_tracks(tmp_path / "a.csv")
    assert len(found.tracks[0]) == 10
    said = " ".join(found.notes)
    assert "1 of 12 rows have no position" in said
    assert "1 of 12 rows repeat the time" in said


def test_a_misspelt_ball_is_suggested() -> None:
    found = read_tracks(shared_folder("inputs") / "r16_wide_two_objects.csv")
    assert found.chosen({"ball": "BALL"}).tracks[0].name == "ball"
    with pytest.raises(UsageError, match="no track 'bal'") as refusal:
        found.chosen({"ball": "bal"})
    assert "Did you mean 'ball'?" in str(refusal.value.hint)


def test_decimal_commas_in_options() -> None:
    assert measure_options(fps="240,5").fps == 240.5
    with pytest.raises(UsageError):
        measure_options(scale="1,500 m/px")


def test_a_stray_quote_is_refused_with_its_line() -> None:
    from pipelines.explain.tabular import read_sheet

    with pytest.raises(UsageError, match="line 5"):
        read_sheet(shared_folder("inputs") / "explain_trials_two_quotes.csv", {})


def thrown_table(head: str, order: str, rows: int = 120) -> str:
    noise = np.random.default_rng(1)
    lines = [head]
    for number in range(rows):
        t = number / 240.0
        x, y = 0.3 + 2.1 * t, 0.4 + 2.6 * t - 4.9 * t * t
        x, y = x + noise.normal(0.0, 5e-4), y + noise.normal(0.0, 5e-4)
        cells = {"t": t, "x": x, "y": y}
        lines.append(",".join(f"{cells[letter]:.6g}" for letter in order))
    return "\n".join(lines) + "\n"


def test_exchanged_columns_are_named_with_their_cure(tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    table.write_text(thrown_table("t,x,y", "tyx"))
    with pytest.raises(UsageError, match="x and y are exchanged") as refusal:
        measure_from_tracks(table, measure_options(ball="220 mm"))
    assert '--columns "x=y, y=x"' in str(refusal.value)
    cured = measure_from_tracks(
        table, measure_options(ball="220 mm"), columns=parse_columns("x=y, y=x")
    )
    assert cured.quantity("flight_speed").known


def test_a_few_rows_are_no_motion(tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    table.write_text(thrown_table("t,x,y", "txy", rows=3))
    with pytest.raises(MeasurementError, match="only 3 rows"):
        measure_from_tracks(table, measure_options(ball="220 mm"))


@pytest.mark.parametrize(
    ("head", "cause", "cure"),
    [
        ("t (s),x (cm),y (cm)", r"'x \(cm\)' is in m", "unit=m"),
        ("t (ms),x (m),y (m)", "", ""),
        ("t (s),x (mm),y (mm)", r"'x \(mm\)' is in m", "unit=m"),
    ],
)
def test_a_unit_in_the_head_that_no_fall_has(
    head: str, cause: str, cure: str, tmp_path: Path
) -> None:
    table = tmp_path / "t.csv"
    table.write_text(thrown_table(head, "txy"))
    if not cause:
        # gravity in m/ms² fits no unit
        assert read_tracks(table).notes == ()
        return
    with pytest.raises(UsageError, match=cause) as refusal:
        read_tracks(table)
    assert f'--columns "{cure}"' in str(refusal.value)
    assert read_tracks(table, parse_columns(cure)).plane is not None


def test_milliseconds_under_a_head_of_seconds(tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    rows = [row.split(",") for row in thrown_table("t,x,y", "txy").splitlines()[1:]]
    lines = ["t (s),x (m),y (m)", *(f"{1e3 * float(t):.6g},{x},{y}" for t, x, y in rows)]
    table.write_text("\n".join(lines))
    with pytest.raises(UsageError, match=r"'t \(s\)' is in ms"):
        read_tracks(table)
    assert read_tracks(table, parse_columns("t_unit=ms")).fps == pytest.approx(240.0, rel=1e-3)


def test_metres_that_point_down_are_turned_over(tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    rows = [row.split(",") for row in thrown_table("t,x,y", "txy").splitlines()[1:]]
    lines = ["t (s),x (m),y (m)", *(f"{t},{x},{-float(y)}" for t, x, y in rows)]
    table.write_text("\n".join(lines))
    found = measure_from_tracks(table, measure_options(ball="220 mm"))
    assert "turned over" in " ".join(found.warnings)
    assert found.quantity("flight_angle").value == pytest.approx(51.1, abs=1.5)


def test_rows_out_of_order_are_put_in_order_and_told(tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    head, *rows = thrown_table("t,x,y", "txy").splitlines()
    table.write_text("\n".join([head, *reversed(rows)]))
    found = read_tracks(table)
    assert "run backwards in 119 of 120 rows" in found.notes[0]
    assert np.all(np.diff(found.tracks[0].time_s) > 0.0)


def _thrown(path: Path, step: float, head: str) -> Path:
    """Marks of a throw at 60 pictures per second and 410 px/m, whose ball has no size."""
    seconds = np.arange(40) / 60.0
    noise = np.random.default_rng(1).normal(0.0, 0.3, (40, 2))
    x = 100.0 + 410.0 * 2.0 * seconds + noise[:, 0]
    y = 300.0 - 410.0 * (1.5 * seconds - 0.5 * 9.81 * seconds**2) + noise[:, 1]
    table = np.column_stack([60.0 * step * seconds, x, y])
    np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.6g")
    return path


def test_without_size_or_scale_the_fall_is_given_in_pixels(tmp_path: Path) -> None:
    per_second = _thrown(tmp_path / "t.csv", 1.0 / 60.0, "t (s),x (px),y (px)")
    per_frame = _thrown(tmp_path / "f.csv", 1.0, "frame,x (px),y (px)")
    for path, falls, unit in (
        (per_second, 410.0 * 9.81, "px/s^2"),
        (per_frame, 410.0 * 9.81 / 3600.0, "px/frame^2"),
    ):
        for ball in (None, "220 mm"):
            found = measure_from_tracks(path, measure_options(ball=ball))
            fall = found.quantity("fall_acceleration_px")
            assert fall.unit == unit
            assert fall.value == pytest.approx(falls, rel=0.03)
            assert fall.value is not None
            assert 0.0 < (fall.std or 0.0) < 0.02 * fall.value
            assert not found.quantity("fall_acceleration").known
            assert "--scale" in (found.quantity("fall_acceleration").reason or "")
    facts = [one for one in found.findings if one.key == "facts"]
    assert facts[0].option == "--fps RATE --scale VALUE"


def test_too_few_pictures_are_named_as_the_cause(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    rows = [f"{n},{x:.1f},{y:.1f}" for n, (x, y) in enumerate(rng.uniform(0.0, 300.0, (6, 2)))]
    (tmp_path / "t.csv").write_text("\n".join(["frame,x,y", *rows]) + "\n")
    found = measure_from_tracks(tmp_path / "t.csv", measure_options(fps="60"))
    assert not any(one.known for one in found.quantities)
    assert "seen in only 6 pictures" in (found.quantity("ball_speed").reason or "")


def test_nothing_is_stated_across_two_speeds_of_a_recording(tmp_path: Path) -> None:
    fast, slow = 8.0 / 240.0, 1.0 / 240.0
    steps = np.repeat([fast, slow, fast], [5, 60, 5])
    seconds = np.concatenate([[0.0], np.cumsum(steps)])
    noise = np.random.default_rng(3).normal(0.0, 3e-4, (len(seconds), 2))
    place = np.column_stack([1.9 * seconds, 2.2 * seconds - 0.5 * 9.81 * seconds**2]) + noise
    table = np.column_stack([np.arange(len(seconds)) / 30.0, place])
    path = tmp_path / "t.csv"
    np.savetxt(path, table, delimiter=",", header="t (s),x (m),y (m)", comments="")
    found = measure_from_tracks(path, measure_options(ball="220 mm"))
    assert [one.name for one in found.quantities if one.known] == []
    assert "in slow motion" in (found.quantity("flight_speed").reason or "")
    assert found.findings[0].key == "pace"
    ran = CliRunner().invoke(app, ["measure", "--from-tracks", str(path), "--ball", "220 mm"])
    assert ran.exit_code == 4
    assert ran.stdout == ""
    assert "Export it again at one speed" in ran.stderr.split("nothing can be measured")[1]
