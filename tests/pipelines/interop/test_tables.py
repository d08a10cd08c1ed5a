"""Tables of other programs, in the forms in which those programs write them."""

import numpy as np
import pytest

from measuring.chain import MeasureOptions
from measuring.checks import CheckKind
from measuring.setup.file import load_setup
from metrology import UsageError
from pipelines.interop.external import Program
from pipelines.interop.measured import (
    measure_from_tracks,
    read_tracks,
    settled_columns,
    track_table,
)
from pipelines.interop.tables import column_use, keep_columns, made_elsewhere, parse_columns

# as Kinovea 0.8 exports to Gnuplot on a French machine
KINOVEA = """#Kinovea Trajectory data export
#T X Y

# métatarses
0.000 77,20 -21,97
0.008 72,19 -25,96
0.016 68,20 -29,94

# hanche
0.000 214,79 269,23
0.008 210,79 268,24
"""
# as Tracker exports a data file: one mass, and several
TRACKER = "\tmass A\t\t\nt\tx\ty\t\n0.000E0\t1.000E-1\t2.000E-1\t\n1.000E-1\t2.000E-1\t2.500E-1\t\n"
TRACKER_MULTI = (
    "#multi:\n,bola,,,,,bob,,,,,\n"
    "t,frame,x,y,pixelx,pixely,frame,x,y,pixelx,pixely,\n"
    "0.0,10,0.1,0.2,100.5,200.5,10,0.5,0.6,300.5,400.5,\n"
    "0.1,11,0.2,0.3,110.5,190.5,11,0.5,0.6,,,\n"
)
DEEPLABCUT = """scorer,DLC_resnet50_ballNov21shuffle1_100000,DLC_resnet50_ballNov21shuffle1_100000,\
DLC_resnet50_ballNov21shuffle1_100000
bodyparts,ball,ball,ball
coords,x,y,likelihood
0,12.5,20.25,0.99
1,13.0,21.0,0.40
2,,,
3,639.4,479.4,1.0
"""
SLEAP = """track,frame_idx,instance.score,ball.x,ball.y,ball.score,bob.x,bob.y,bob.score
,0,0.93,101.5,55.25,0.97,140.0,60.0,0.88
,1,,102.0,56.0,,,,
,3,0.51,103.0,57.0,0.20,141.0,61.0,0.30
"""
TRACKPY = """,y,x,mass,size,ecc,signal,raw_mass,ep,frame,particle
0,20.5,10.5,300.1,2.1,0.1,20.0,400.0,0.05,0,0
1,21.5,12.5,301.1,2.1,0.1,20.0,400.0,0.05,1,0
0,80.5,70.5,300.1,2.1,0.1,20.0,400.0,0.05,0,1
"""
GERMAN = "Zeit (ms);X [cm];Y [cm]\n0,0;1,5;2,0\n10,0;2,5;2,5\n30,0;4,5;3,0\n"


@pytest.fixture
def written(tmp_path):
    def write(name: str, text: str):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_kinovea_text_with_decimal_commas(written) -> None:
    path = written("a.txt", KINOVEA)
    external = read_tracks(path, {"unit": "cm"})
    assert [one.name for one in external.tracks] == ["métatarses", "hanche"]
    assert external.plane is not None
    metres = external.plane.metres(external.tracks[0].px)
    assert metres[0].tolist() == pytest.approx([0.7720, -0.2197])
    assert external.tracks[0].frame.tolist() == [0, 1, 2]
    assert external.fps == pytest.approx(125.0)
    in_px = read_tracks(path)
    assert in_px.plane is None
    assert in_px.tracks[0].px[0].tolist() == pytest.approx([77.20, 21.97])
    assert in_px.notes


def test_kinovea_text_beyond_a_minute_counts_minutes(written) -> None:
    path = written("a.txt", KINOVEA.replace("0.008", "1:00.008").replace("0.016", "2:01:00.016"))
    assert read_tracks(path).tracks[0].time_s.tolist() == pytest.approx([0.0, 60.008, 7260.016])
    with pytest.raises(UsageError, match="not a row of T X Y") as refused:
        read_tracks(written("b.txt", KINOVEA.replace("0.008", "0:00:00:01")))
    assert "times in seconds" in refused.value.hint


def test_a_mistyped_time_tells_of_no_clock(written) -> None:
    path = written("a.txt", KINOVEA.replace("0.008", "0.008e-300"))
    assert read_tracks(path).tracks[0].frame.tolist() == [0, 1, 2]


def test_tracker_text(written) -> None:
    external = read_tracks(written("a.txt", TRACKER))
    assert external.program is Program.TRACKER
    assert external.plane is not None
    assert external.plane.metres(external.tracks[0].px)[1].tolist() == pytest.approx([0.2, 0.25])
    several = read_tracks(written("b.txt", TRACKER_MULTI))
    assert [one.name for one in several.tracks] == ["bola", "bob"]
    assert several.tracks[0].frame.tolist() == [10, 11]
    # pixels count from the corner of the first
    assert several.tracks[0].px[0].tolist() == [100.0, 200.0]
    assert len(several.tracks[1]) == 1


def test_deeplabcut_leaves_out_what_the_network_doubts(written) -> None:
    external = read_tracks(written("a.csv", DEEPLABCUT))
    assert external.program is Program.DEEPLABCUT
    assert external.tracks[0].name == "ball"
    assert external.tracks[0].frame.tolist() == [0, 3]
    assert "1 marks" in external.notes[0]


def test_sleap_tables(written, tmp_path) -> None:
    external = read_tracks(written("a.csv", SLEAP))
    assert external.program is Program.SLEAP
    assert {one.name: len(one) for one in external.tracks} == {"ball": 3, "bob": 2}
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.analysis.h5"
    places = np.full((1, 2, 2, 4), np.nan)
    places[0, :, 0, :] = [[1.0, 2.0, np.nan, 4.0], [5.0, 6.0, np.nan, 8.0]]
    with h5py.File(path, "w") as file:
        file["tracks"] = places
        file["node_names"] = np.array([b"ball", b"bob"])
        file["track_names"] = np.array([b"track_0"])
    external = read_tracks(path)
    assert [one.name for one in external.tracks] == ["ball"]
    assert external.tracks[0].frame.tolist() == [0, 1, 3]
    assert external.tracks[0].px[2].tolist() == [4.0, 8.0]
    (tmp_path / "cut.h5").write_bytes(path.read_bytes()[:300])
    with pytest.raises(UsageError, match="not a complete HDF5"):
        read_tracks(tmp_path / "cut.h5")


def test_trackpy_tables(written) -> None:
    external = read_tracks(written("a.csv", TRACKPY))
    assert external.program is Program.TRACKPY
    assert external.tracks[0].px.tolist() == [[10.5, 20.5], [12.5, 21.5]]
    assert external.tracks[0].std_px is not None
    assert len(external.tracks) == 2


def test_a_spreadsheet_with_columns_of_its_own(written) -> None:
    path = written("a.csv", GERMAN)
    said = parse_columns("t=Zeit (ms), x=X [cm], y=Y [cm]")
    assert made_elsewhere(path, said)
    table = track_table(path, said)
    assert table["t_s"].tolist() == pytest.approx([0.0, 0.01, 0.03])
    assert table["x_m"].tolist() == pytest.approx([0.015, 0.025, 0.045])
    assert table["frame"].tolist() == [0, 1, 3]


@pytest.mark.parametrize("sized", [False, True])
def test_a_size_that_nobody_saw_checks_nothing(written, sized: bool) -> None:
    time = np.arange(0.0, 0.4, 0.01)
    x, y = 300.0 * time, 200.0 - 200.0 * time + 0.5 * 981.0 * time**2
    columns = "frame,t_s,object,x_px,y_px" + (",radius_px" if sized else "")
    rows = [
        f"{k},{t:.4f},ball,{a:.3f},{b:.3f}" + (",4.0" if sized else "")
        for k, (t, a, b) in enumerate(zip(time, x, y, strict=True))
    ]
    path = written("marks.csv", "\n".join([columns, *rows, ""]))
    options = MeasureOptions(fps=100.0, ball="80mm", scale_m_per_px=(0.01, 1e-4))
    kinds = [check.kind for check in measure_from_tracks(path, options).checks]
    assert (CheckKind.BALL_SIZE in kinds) is sized


def test_columns_that_nothing_tells_are_asked_for(written) -> None:
    path = written("a.csv", "when,right,up\n0,1,2\n1,2,3\n")
    with pytest.raises(UsageError, match="'when', 'right', 'up'") as refusal:
        read_tracks(path)
    assert "x=NAME, y=NAME, t=NAME" in str(refusal.value.hint)
    with pytest.raises(UsageError, match="no column 'left'"):
        read_tracks(path, {"x": "left"})
    with pytest.raises(UsageError, match="not KEY=NAME"):
        parse_columns("abscissa=right")


def test_columns_are_kept_in_the_setup(written) -> None:
    setup = written("lab.toml", "# our lab\n[wall]\ngrid = '50 mm'\n")
    keep_columns(setup, parse_columns('t=Zeit (s), "x=X, links (cm)"') | {"y": "Y"})
    assert setup.read_text().startswith("# our lab\n")
    known = load_setup(setup)
    assert known.columns == {"t": "Zeit (s)", "x": "X, links (cm)", "y": "Y"}
    assert known.having({"wall.grid": "40 mm"}).columns == known.columns


def test_a_terminal_is_asked_once(written, monkeypatch) -> None:
    path = written("a.csv", "when,right,up\n0,1,2\n1,2,3\n")
    setup = written("lab.toml", "[wall]\ngrid = '50 mm'\n")
    for stream in ("stdin", "stderr"):
        monkeypatch.setattr(f"sys.{stream}.isatty", lambda: True)
    asked = iter(["2", "3", "1"])
    monkeypatch.setattr("rich.console.Console.input", lambda self, text: next(asked))
    said = settled_columns(path, {}, setup)
    assert said == {"x": "right", "y": "up", "t": "when"}
    kept = load_setup(setup).columns
    assert kept == said
    assert settled_columns(path, kept, setup) == said
    assert len(read_tracks(path, kept).tracks[0]) == 2


def test_units_come_from_headers_or_are_said() -> None:
    use = column_use(["Time (ms)", "x_mm", "y_mm"], {}, "a.csv")
    assert (use.metre, use.second) == (pytest.approx(1e-3), pytest.approx(1e-3))
    assert column_use(["t", "x", "y"], {}, "a.csv").metre is None
    assert column_use(["t", "x", "y"], {"unit": "in"}, "a.csv").metre == pytest.approx(0.0254)
    with pytest.raises(UsageError, match="parsec"):
        column_use(["t", "x", "y"], {"unit": "parsecs of mm"}, "a.csv")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.csv", b""),
        ("a.csv", b"t,x,y\n"),
        ("a.xlsx", b"no zip"),
        ("a.csv", b"scorer,DLC\nbodyparts,a\n1,2\n3,4\n"),
        ("a.doc", b"x"),
        ("a.csv", bytes(range(256))),
        ("a.csv", b"t\n0.0,1.5,2.5\n0.1,1.6,2.4\n0.2,1.7,2.3\n"),
    ],
)
def test_what_is_no_table_is_refused_in_words(name, data, tmp_path) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(UsageError):
        read_tracks(path)
