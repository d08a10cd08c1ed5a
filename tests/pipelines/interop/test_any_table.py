"""One flight, written as many programs and people write it, is read as the same flight."""

from collections.abc import Callable
from pathlib import Path
from time import process_time

import numpy as np
import pandas as pd
import pytest

from measuring.checker.pace import find_slow_part
from measuring.setup.file import Setup
from metrology import UsageError
from pipelines.api.quantities import measure_options
from pipelines.explain.campaign import load_campaign
from pipelines.interop.external import ExternalTracks
from pipelines.interop.measured import measure_from_tracks, read_tracks
from pipelines.interop.rows import Marks, settled
from pipelines.interop.tables import parse_columns, read_samples
from vision.tracks import MotionKind

ROWS = 80
T = np.arange(ROWS) / 200.0
X, Y = 0.3 + 1.9 * T, 0.4 + 2.2 * T - 0.5 * 9.80665 * T**2


def lines(*columns: np.ndarray, mark: str = ",", decimal: str = ".") -> str:
    rows = zip(*columns, strict=True)
    return "".join(mark.join(f"{v:.5f}".replace(".", decimal) for v in row) + "\n" for row in rows)


def german_thousands(values: np.ndarray) -> list[str]:
    return [f"{v:,.1f}".translate(str.maketrans(",.", ".,")) for v in values]


WRITTEN: dict[str, Callable[[], str]] = {
    "accents": lambda: "Temps (s);Abscisse (m);Ordonnée (m)\n" + lines(T, X, Y, mark=";"),
    "upper case": lambda: "TIME (S),X (CM),Y (CM)\n" + lines(T, 100 * X, 100 * Y),
    "a row of units": lambda: "t,x,y\ns,cm,cm\n" + lines(T, 100 * X, 100 * Y),
    "units in brackets": lambda: "Time,X,Y\n(s),(mm),(mm)\n" + lines(T, 1e3 * X, 1e3 * Y),
    "words for units": lambda: "Time (Seconds),X (Meters),Y (Metres)\n" + lines(T, X, Y),
    "a title": lambda: "Lab 3: a throw\nt (s);x (m);y (m)\n" + lines(T, X, Y, mark=";"),
    "decimal commas in a comma table": lambda: "t,x,y\n" + lines(T, X, Y, decimal=","),
    "quoted decimal commas": lambda: (
        '"t (s)","x (m)","y (m)"\n'
        + lines(T, X, Y, mark='","', decimal=",").replace("\n", '"\n"').join(('"', ""))[:-1]
    ),
    "the separator above": lambda: "sep=;\nt;x;y\n" + lines(T, X, Y, mark=";", decimal=","),
    "no header": lambda: lines(T, X, Y, mark="\t"),
    "a long minus": lambda: "t,x,y\n" + lines(T, X, Y).replace("-", "\u2212"),
    "thousands": lambda: (
        "t;x (mm);y (mm)\n"
        + "".join(
            f"{t:.4f};{x};{y}\n".replace("0.", "0,", 1)
            for t, x, y in zip(T, german_thousands(1e3 * X), german_thousands(1e3 * Y), strict=True)
        )
    ),
    "every picture twice": lambda: (
        "t (s),x (m),y (m)\n" + lines(np.arange(2 * ROWS) / 400, np.repeat(X, 2), np.repeat(Y, 2))
    ),
    "nanoseconds since 1970": lambda: (
        "timestamp,x,y\n"
        + "".join(
            f"{1_700_000_000_000_000_000 + round(1e9 * t)},{x:.5f},{y:.5f}\n"
            for t, x, y in zip(T, X, Y, strict=True)
        )
    ),
    "y is called z": lambda: "t,x,z\n" + lines(T, X, Y),
    "feet without a unit": lambda: "t,x,y\n" + lines(T, X / 0.3048, Y / 0.3048),
    "names, symbols and units": lambda: (
        "Vernier Format 2\na.cmbl 3/12/2024 10:14:27 .\nVideo Analysis\nTime\tX\tY\tX Velocity\n"
        "t\tX\tY\tVx\ns\tm\tm\tm/s\n\n" + lines(T, X, Y, X, mark="\t")
    ),
    "axes in brackets": lambda: (
        "Time,Trajectory 1/0 (X),Trajectory 1/0 (Y)\n" + lines(1e3 * T, 100 * X, 100 * Y)
    ),
    "a language that is not known": lambda: "时间 (s),水平 (米),高度 (米)\n" + lines(T, X, Y),
    "a date beside the time": lambda: (
        '"Date and Time Run #1","Time (s) Run #1","Position X (m) Run #1","Position Y (m) Run #1"\n'
        + "".join(f"11/28/2024 10:14:20,{line}\n" for line in lines(T, X, Y).splitlines())
    ),
    "units in the cells": lambda: (
        "time,x,y\n"
        + "".join(
            f"{t:.5f} s,{x:.3f} cm,{y:.3f} cm\n"
            for t, x, y in zip(T, 100 * X, 100 * Y, strict=True)
        )
    ),
    "exponents of Fortran": lambda: (
        "t,x,y\n"
        + "".join(
            f"{t:.8E},{x:.8E},{y:.8E}\n".replace("E", "D") for t, x, y in zip(T, X, Y, strict=True)
        )
    ),
    "the height is z": lambda: "t,x,y,z\n" + lines(T, X, 1.0 + 0.0 * T, Y),
    "along a diagonal": lambda: (
        "Field,Time,ball,,\n,,X1,Y1,Z1\n" + lines(np.arange(ROWS), T, 0.8 * X, Y, 0.6 * X)
    ),
    "settings of a recording above": lambda: (
        "DataRate\tNumFrames\tUnits\n200\t80\tm\nFrame#\tTime\tball\t\t\n\t\tX1\tY1\tZ1\n"
        + lines(np.arange(ROWS), T, X, 0.0 * T, Y, mark="\t")
    ),
    "x in cm, y in m": lambda: "t (s),x (cm),y (m)\n" + lines(T, 100 * X, Y),
    "decimetres without a unit": lambda: "t,x,y\n" + lines(T, 10 * X, 10 * Y),
    "microseconds without a unit": lambda: "t,x,y\n" + lines(1e6 * T, X, Y),
    "polar": lambda: (
        "t (s),r (m),theta (deg)\n" + lines(T, np.hypot(X, Y), np.degrees(np.arctan2(Y, X)))
    ),
    "names of rows": lambda: (
        "LABEL,ID,TRACK_ID,POSITION_X,POSITION_Y,POSITION_T\nLabel,Spot,Track,X,Y,T\n"
        ",,,(micron),(micron),(sec)\n"
        + "".join(
            f"ID{k},{k},0,{1e6 * x:.1f},{1e6 * y:.1f},{t:.5f}\n"
            for k, (t, x, y) in enumerate(zip(T, X, Y, strict=True))
        )
    ),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_the_same_flight_is_read(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(WRITTEN[name](), encoding="utf-8")
    track = read_tracks(path).tracks[0]
    assert track.time_s is not None
    assert len(track) == ROWS
    step = np.median(np.diff(track.time_s))
    assert step == pytest.approx(1 / 200, rel=0.02)
    # a table in metres is drawn at a millimetre per pixel, y down
    assert track.px[:, 0] / 1e3 == pytest.approx(X, abs=1e-4)
    assert -track.px[:, 1] / 1e3 == pytest.approx(Y, abs=1e-4)
    samples, _ = read_samples(path, {})
    assert samples["y_m"].to_numpy() == pytest.approx(Y, abs=1e-4)


def test_runs_side_by_side_have_their_own_clocks(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    head = ",".join(f"{name} Run #{k}" for k in (1, 2) for name in ("Time (s)", "X (m)", "Y (m)"))
    path.write_text(f"{head}\n" + lines(T, X, Y, T + 1.0, X, Y), encoding="utf-8")
    second = read_tracks(path).tracks[1]
    assert second.name == "run 2"
    assert second.time_s is not None
    assert second.time_s[0] == pytest.approx(1.0)
    assert list(read_samples(path, {})[0]["trial"].unique()) == ["run 1", "run 2"]


def test_objects_stand_above_their_axes(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    heads = [
        "Trajectories",
        ",,rig:ball,,,rig:mass,,",
        "Frame,Time,X,Y,Z,X,Y,Z",
        ",s,mm,mm,mm,mm,mm,mm",
    ]
    level = np.full(ROWS, 12.0)
    rows = lines(np.arange(ROWS), T, 1e3 * X, level, 1e3 * Y, 1e3 * X + 9, level, 1e3 * Y)
    path.write_text("\n".join(heads) + f"\n{rows}", encoding="utf-8")
    ball, mass = read_tracks(path).chosen({}).tracks
    assert (ball.name, mass.name) == ("ball", "pendulum")
    # motion capture points z up
    assert -ball.px[:, 1] / 1e3 == pytest.approx(Y, abs=1e-4)
    assert mass.px[:, 0] - ball.px[:, 0] == pytest.approx(9.0, abs=1e-2)


def test_tracker_masses_with_their_own_clocks(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    head = "#multi:\nmass A\t\t\tmass B\t\t\nt\tx\ty\tt\tx\ty\n"
    path.write_text(head + lines(T, X, Y, T + 1.0, X - 0.2, Y, mark="\t"), encoding="utf-8")
    second = read_tracks(path).tracks[1]
    assert second.time_s is not None
    assert second.time_s[0] == pytest.approx(1.0)
    assert second.px[:, 0] / 1e3 == pytest.approx(X - 0.2, abs=1e-4)


def of_rows(path: Path, *columns: np.ndarray) -> ExternalTracks:
    path.write_text("t (s),x (m),y (m)\n" + lines(*columns), encoding="utf-8")
    return read_tracks(path)


@pytest.mark.parametrize("later", [0.0, 0.0013])
def test_runs_below_each_other_are_not_mixed(later: float, tmp_path: Path) -> None:
    twice = [np.concatenate([one, one]) for one in (T, X, Y)]
    twice[0][ROWS:] += later
    found = of_rows(tmp_path / "a.csv", *twice)
    assert [(one.name, len(one)) for one in found.tracks] == [("run 1", ROWS), ("run 2", ROWS)]
    with pytest.raises(UsageError, match="several runs"):
        found.chosen({})
    assert len(found.chosen({"ball": "run 2"}).tracks[0]) == ROWS
    assert list(read_samples(tmp_path / "a.csv", {})[0]["trial"].unique()) == ["run 1", "run 2"]


def test_rows_out_of_order_are_no_runs(tmp_path: Path) -> None:
    order = np.arange(ROWS)
    order[[30, 31]] = order[[31, 30]]
    assert len(of_rows(tmp_path / "a.csv", T[order], X[order], Y[order]).tracks) == 1


@pytest.mark.parametrize("value", [0.0, -1.0, -9999.0])
def test_marks_of_what_was_lost_are_skipped(value: float, tmp_path: Path) -> None:
    lost = np.arange(ROWS) % 5 == 1
    found = of_rows(tmp_path / "a.csv", T, np.where(lost, value, X), np.where(lost, value, Y))
    assert len(found.tracks[0]) == ROWS - lost.sum()
    assert f"({value:g}, {value:g})" in " ".join(found.notes)


def test_long_tables_take_time_in_proportion(tmp_path: Path) -> None:
    def cost(rows: int) -> float:
        time = np.arange(rows) / 1000.0
        path = tmp_path / f"{rows}.csv"
        # rounded, so that positions come again and again
        table = np.column_stack([time, 0.3 + 0.1 * np.sin(time), 0.4 + 0.1 * np.cos(time)])
        np.savetxt(path, table, "%.4f", ",", header="t (s),x (m),y (m)", comments="")
        external = read_tracks(path)
        track = external.tracks[0]
        assert track.time_s is not None
        began = process_time()
        settled(Marks("ball", track.px, None, track.time_s))
        find_slow_part(track.time_s, track.px)
        return process_time() - began

    cost(1_000)
    assert cost(40_000) < 10.0 * cost(10_000)


def test_a_rest_before_a_throw_is_no_mark_of_what_was_lost(tmp_path: Path) -> None:
    rest = np.repeat(0.0, 20)
    place = [np.concatenate([rest + one[0], one]) for one in (X, Y)]
    found = of_rows(tmp_path / "a.csv", np.arange(ROWS + 20) / 200.0, *place)
    assert len(found.tracks[0]) == ROWS + 20


@pytest.mark.parametrize(
    "said",
    ["t=time, x=POS X (m), y=pos y", "t=1, x=2, y=3", "t=Time (s); x=Pos X (m); y=Pos Y (m)"],
)
def test_columns_are_named_as_people_name_them(said: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Time (s),Pos X (m),Pos Y (m)\n" + lines(T, X, Y), encoding="utf-8")
    track = read_tracks(path, parse_columns(said)).tracks[0]
    assert track.px[:, 0] / 1e3 == pytest.approx(X, abs=1e-4)


def test_contents_are_recognised_whatever_the_ending(tmp_path: Path) -> None:
    text = "t (s),x (m),y (m)\n" + lines(T, X, Y)
    for name, data in {"a.csv": text.encode("utf-16-le"), "a.xlsx": text.encode()}.items():
        (tmp_path / name).write_bytes(data)
        assert len(read_tracks(tmp_path / name).tracks[0]) == ROWS
    (tmp_path / "b.csv").write_bytes(b"%PDF-1.4\n1 0 obj\n")
    with pytest.raises(UsageError, match="a PDF"):
        read_tracks(tmp_path / "b.csv")


def test_formulas_without_results_are_refused_by_their_cell(tmp_path: Path) -> None:
    table = pd.DataFrame({"t (s)": T, "x (m)": [f"={x}*1" for x in X], "y (m)": Y})
    table["y (m)"] = table["x (m)"]
    table.to_excel(tmp_path / "a.xlsx", index=False)
    with pytest.raises(UsageError, match="B2"):
        read_tracks(tmp_path / "a.xlsx")


def test_boxes_of_a_tracker_without_a_header(tmp_path: Path) -> None:
    path = tmp_path / "gt.txt"
    rows = enumerate(zip(100 + 400 * X, 700 - 400 * Y, strict=True), start=1)
    path.write_text("".join(f"{k},1,{x - 44},{y - 44},88,88,1,-1,-1,-1\n" for k, (x, y) in rows))
    assert read_tracks(path).tracks[0].px[:, 0] == pytest.approx(100 + 400 * X)


@pytest.mark.parametrize("head", ["angle (deg)", "Winkel (Grad)", "theta (rad)", "phi"])
def test_an_angle_alone_is_a_swing(head: str, tmp_path: Path) -> None:
    time = np.arange(300) / 60.0
    angle = np.radians(40.0) + 0.2 * np.cos(2.0 * np.pi * time / 1.6)
    angle = angle if "rad" in head and "Grad" not in head else np.degrees(angle) % 360.0
    path = tmp_path / "a.csv"
    path.write_text(f"t (s),{head}\n" + lines(time, angle), encoding="utf-8")
    found = measure_from_tracks(path)
    period = found.quantity("swing_period")
    assert abs(period.value - 1.6) < 3.0 * period.std


def test_the_body_at_rest_is_the_ball_of_a_collision(tmp_path: Path) -> None:
    time, rng = np.arange(120) / 120.0, np.random.default_rng(1)
    after = np.maximum(time - 0.4, 0.0)
    places = (0.27 + 1.2 * time - 1.14 * after, 0.8 + 1.14 * after)
    noisy = [x + rng.normal(0.0, 3e-4, 120) for x in places]
    flat = [0.3 + rng.normal(0.0, 3e-4, 120) for _ in places]
    path = tmp_path / "a.csv"
    head = "t (s),A x (m),A y (m),B x (m),B y (m)\n"
    path.write_text(head + lines(time, noisy[0], flat[0], noisy[1], flat[1]), encoding="utf-8")
    found = measure_from_tracks(path)
    assert found.motion.kind is MotionKind.COLLISION
    for name, true in {
        "speed_after": 1.14,
        "other_speed_before": 1.2,
        "cor_collision": 0.9,
    }.items():
        one = found.quantity(name)
        assert abs(one.value - true) < 3.0 * one.std, name
    stated = measure_from_tracks(path, measure_options(kind="roll"), columns={"ball": "b"})
    assert stated.motion.kind is MotionKind.ROLL


def test_gliders_have_an_x_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t (s),x1 (m),x2 (m)\n" + lines(T, X, X + 1.0), encoding="utf-8")
    assert [one.name for one in read_tracks(path).tracks] == ["1", "2"]


REFUSED = {
    "accelerations": ("t (s),ax (m/s^2),Acceleration y (m/s^2)\n" + lines(T, X, Y), "no positions"),
    "markers without axes": (
        "MARKERS\tball\tmass\n" + lines(T, X, Y, T, X, Y, mark="\t"),
        "names (3, in line 1)",
    ),
    "an unknown unit without a fall": ("t (s),x (ell),y (ell)\n" + lines(T, X, X), "unit=m"),
    "two positions along a line": ("t (s),s1 (m),s2 (m)\n" + lines(T, X, X), "x=NAME"),
    "exchanged axes": ("t (s),x (m),y (m)\n" + lines(T, Y, X), '"x=y (m), y=x (m)"'),
    "a line break in a cell": (
        "t (s),x (m),y (m),note\n0,0,0,\n" + '1,1,1,"a\nb"\n' + "2,2,2,\n",
        "line 3",
    ),
    "mixed commas": ("t,x,y\n" + lines(T, X, Y, decimal=",") + "1,2,3,5,6\n", "semicolons"),
    "numbers without a header": (lines(T, X, Y, X), "t (s),x (m),y (m)"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_can_not_be_read_is_refused_with_its_cure(name: str, tmp_path: Path) -> None:
    text, cure = REFUSED[name]
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError) as refused:
        read_tracks(path)
    assert cure in f"{refused.value.message} {refused.value.hint}"


def test_explain_reads_foreign_tables_and_names_what_it_does_not_use(tmp_path: Path) -> None:
    trials = [f"{name},{line}" for name in "ab" for line in lines(T, 100 * X, 100 * Y).splitlines()]
    path = tmp_path / "a.csv"
    path.write_text(
        "Versuch,Zeit (s),Ort x (cm),Ort y (cm),Wetter\n" + "\n".join(f"{t},1" for t in trials),
        encoding="utf-8",
    )
    found = load_campaign(path, None, Setup())
    assert [trial.name for trial in found.trials] == ["a", "b"]
    assert any("not used: 'Wetter'" in note for note in found.notes)
    sheet = tmp_path / "a.xlsx"
    pd.DataFrame({"t (s)": T, "x (m)": X, "y (m)": Y}).to_excel(sheet, index=False)
    assert len(load_campaign(sheet, None, Setup()).trials) == 1


def test_a_motion_sensor_gives_one_position(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Time (s),Position (m),Velocity (m/s)\n" + lines(T, Y, X), encoding="utf-8")
    track = read_tracks(path).tracks[0]
    assert -track.px[:, 1] / 1e3 == pytest.approx(Y, abs=1e-4)
    assert not track.px[:, 0].any()
    # a cart does not fall: its axis must be named
    path.write_text("Time (s),Position (m)\n" + lines(T, X), encoding="utf-8")
    with pytest.raises(UsageError):
        read_tracks(path)
    cart = read_tracks(path, {"x": "Position (m)"}).tracks[0]
    assert cart.px[:, 0] / 1e3 == pytest.approx(X, abs=1e-4)


def test_timecodes_count_pictures(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    codes = [f"00:00:{k // 25 + 3:02d}:{k % 25:02d}" for k in range(ROWS) if k != 7]
    rows = [f"{x:.5f},{y:.5f}" for k, (x, y) in enumerate(zip(X, Y, strict=True)) if k != 7]
    text = "".join(f"{code},{row}\n" for code, row in zip(codes, rows, strict=True))
    path.write_text("Timecode,x (m),y (m)\n" + text, encoding="utf-8")
    external = read_tracks(path)
    assert np.diff(external.tracks[0].frame).tolist() == [1] * 6 + [2] + [1] * 71
    assert any("25 to a second" in note for note in external.notes)


@pytest.mark.parametrize(
    "head", ["xmin,ymin,xmax,ymax", "left,top,right,bottom", "BB_Left,BB_Top,BB_Width,BB_Height"]
)
def test_boxes_give_centres(head: str, tmp_path: Path) -> None:
    left, top = 900 * X - 20, 700 - 900 * Y - 10
    ends = (left + 40, top + 20)
    if "Width" in head:
        ends = (np.full(ROWS, 40.0), np.full(ROWS, 20.0))
    path = tmp_path / "a.csv"
    path.write_text(f"frame,{head}\n" + lines(np.arange(ROWS), left, top, *ends), encoding="utf-8")
    px = read_tracks(path).tracks[0].px
    assert px == pytest.approx(np.column_stack([900 * X, 700 - 900 * Y]), abs=1e-3)


def test_the_sheet_with_numbers_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.xlsx"
    with pd.ExcelWriter(path) as book:
        pd.DataFrame({"Notes": ["strike 7"]}).to_excel(book, sheet_name="Info", index=False)
        flight = pd.DataFrame({"t (s)": T, "x (m)": X, "y (m)": Y})
        flight.to_excel(book, sheet_name="Data", index=False)
    external = read_tracks(path)
    assert len(external.tracks[0]) == ROWS
    assert any("sheet 'Data' is read, not 'Info'" in note for note in external.notes)


def test_a_table_is_read_whatever_its_ending(tmp_path: Path) -> None:
    # ImageJ writes text that it calls .xls
    path = tmp_path / "a.xls"
    path.write_text("t (s)\tx (m)\ty (m)\n" + lines(T, X, Y, mark="\t"), encoding="utf-8")
    assert len(read_tracks(path).tracks[0]) == ROWS
    path.write_bytes(b"\xd0\xcf\x11\xe0" + bytes(600))
    with pytest.raises(UsageError, match="Excel 97") as refused:
        read_tracks(path)
    assert "Save it as .xlsx" in str(refused.value.hint)


@pytest.mark.parametrize("mark", [",", ";"])
def test_deeplabcuts_labels_are_numbered_by_their_pictures(mark: str, tmp_path: Path) -> None:
    path = tmp_path / "CollectedData.csv"
    rows = [
        mark.join(("labeled-data", "a", f"img{k + 40:03d}.png", f"{x:.3f}", f"{y:.3f}"))
        for k, (x, y) in enumerate(zip(900 * X, 700 - 900 * Y, strict=True))
    ]
    heads = [
        f"{name},,,{a},{b}" for name, a, b in (("scorer", "I", "I"), ("bodyparts", "ball", "ball"))
    ]
    text = "\n".join([*(head.replace(",", mark) for head in (*heads, "coords,,,x,y")), *rows])
    path.write_text(text if mark == "," else text.replace(".", ",").replace(",png", ".png"))
    track = read_tracks(path).tracks[0]
    assert track.frame.tolist() == list(range(40, 40 + ROWS))
    assert track.px[:, 0] == pytest.approx(900 * X, abs=1e-2)
