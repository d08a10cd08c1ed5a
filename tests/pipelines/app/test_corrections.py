"""Corrections: what is written is read again, a mistake is named, marks reach the table."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from measuring.measurement import Axes
from metrology import OutputError, UsageError
from pipelines.app.corrections import (
    END_STD_PX,
    FIXED_POINTS,
    ClipInputs,
    Corrections,
    History,
    ObjectMark,
    Stick,
    as_command,
    as_python,
    corrected_table,
    cure_of,
    options_of,
    read_corrections,
    write_corrections,
)
from vision.tracks import MotionKind

CLIP = Path("/lab/a strike.mp4")
STICK = "[stick]\nx0_px = 0\ny0_px = 0\nx1_px = {x}\ny1_px = 0\nlength = {length}"
KNOWN = ("fps", "wall_grid", "scale")


def test_corrections_survive_the_file(tmp_path: Path) -> None:
    file = tmp_path / "a.mp4.corrections.toml"
    assert read_corrections(file) == Corrections()
    inputs = ClipInputs(fps="600 fps ± 0.5 fps", ball='a "ball"', setup="lab.toml")
    corrections = Corrections(
        inputs,
        (ObjectMark(3, 1.25, -0.5), ObjectMark(9, 2.0, 4.0, moved=True)),
        ObjectMark(0, 7.0, 8.0),
        Stick(1.5, 2.0, 301.5, 402.0, "1 m ± 2 mm"),
        (120.5, -8.0),
        (310.0, 88.25),
        Axes(10.0, 20.5, -7.0),
        (ObjectMark(4, 1.0, 2.0),),
    )
    write_corrections(file, corrections)
    assert read_corrections(file) == corrections
    write_corrections(file, Corrections())
    assert not file.exists()
    with pytest.raises(OutputError, match="can't write"):
        write_corrections(tmp_path / "nowhere" / "a.toml", corrections)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[[ball]", "not valid TOML"),
        ("balls = 1", "balls is not known"),
        ("[inputs]\nspeed = '1'", "speed is not known"),
        ("inputs = 3", "inputs is no table"),
        ("[inputs]\nfps = 600", "fps is not in quotes"),
        ("ball = 3", "ball is no list of tables"),
        ("[[ball]]\nframe = 1.5\nx_px = 1\ny_px = 1", "number 1: frame is 1.5"),
        ("[[ball]]\nframe = -1\nx_px = 1\ny_px = 1", "frame is -1"),
        ("[[ball]]\nframe = 1\nx_px = nan\ny_px = 1", "x_px is nan"),
        ("[[ball]]\nframe = 1\nx_px = true\ny_px = 1", "x_px is True"),
        ("[[ball]]\nframe = 1\nx_px = [1]\ny_px = 1", "x_px is"),
        ("[mass]\nframe = 1\nx_px = 1", "mass: y_px is missing"),
        ("[mass]\nframe = 1\nz_px = 1", "mass: [xyz]_px is "),
        ("[pivot]\nx_px = 1.0", "pivot: y_px is missing"),
        ("[landing]\nx_px = 1.0", "landing: y_px is missing"),
        ("[pivot]\nx_px = 1\ny_px = inf", "pivot: y_px is inf"),
        ("[stick]\nx0_px = 1\nlength = '1 m'", "stick: y0_px is missing"),
        (STICK.format(x="0.0", length="'1 m'"), "stick is 0.0 px long"),
        (STICK.format(x="9.0", length="'1 kg'"), "length '1 kg'"),
        (STICK.format(x="9.0", length="1"), "length is not in quotes"),
        (STICK.format(x="inf", length="'1 m'"), "x1_px is inf"),
        ("mass = [1]", "mass is no table"),
    ],
)
def test_a_file_edited_wrongly_is_refused_with_the_place(
    tmp_path: Path, text: str, said: str
) -> None:
    file = tmp_path / "a.corrections.toml"
    file.write_text(text)
    with pytest.raises(UsageError, match=said) as refused:
        read_corrections(file)
    assert refused.value.hint


def test_undo_and_redo_return_every_state() -> None:
    states = [Corrections(ball=(ObjectMark(k, 1.0, 1.0),)) for k in range(3)]
    history = History(states[0])
    assert not history.undo()
    assert [history.change(one) for one in states] == [False, True, True]
    assert history.undo()
    assert history.now == states[1]
    assert history.redo()
    assert history.now == states[2]
    history.undo()
    assert history.change(states[0])
    # what was undone before a change is gone
    assert not history.can_redo
    history.undo()
    assert history.now == states[1]


def _table() -> pd.DataFrame:
    """Two objects 50 px apart; the first is measured."""
    rows = [
        (number, frame, 20.0 + frame, 30.0 + 50.0 * number, 5.0, int(number == 0))
        for number in range(2)
        for frame in range(6)
        if frame != 4
    ]
    names = ["tracklet", "frame", "x_px", "y_px", "radius_px", "measured"]
    return pd.DataFrame(rows, columns=names)


def test_a_mark_on_another_object_selects_it() -> None:
    table = corrected_table(_table(), (ObjectMark(2, 24.0, 78.0),))
    assert table is not None
    assert set(table[table["measured"] == 1]["tracklet"]) == {1}
    assert len(table) == 10
    # the later mark counts
    both = (ObjectMark(2, 24.0, 78.0), ObjectMark(3, 23.0, 31.0))
    again = corrected_table(_table(), both)
    assert again is not None
    assert set(again[again["measured"] == 1]["tracklet"]) == {0}


def test_what_is_ignored_leaves_the_most_probable_other_object() -> None:
    found = pd.concat([_table(), _table().assign(tracklet=lambda one: one["tracklet"] + 2)])
    found = found.assign(probability=found["tracklet"].map({0: 0.6, 1: 0.1, 2: 0.2, 3: 0.1}))
    found.loc[found["tracklet"] > 0, "measured"] = 0
    found.loc[found["tracklet"] > 1, "x_px"] += 100.0
    table = corrected_table(found, (), (ObjectMark(2, 23.0, 31.0),))
    assert table is not None
    assert set(table["tracklet"]) == {1, 2, 3}
    assert set(table[table["measured"] == 1]["tracklet"]) == {2}
    # another one ignored changes nothing of what is measured
    table = corrected_table(found, (), (ObjectMark(2, 23.0, 81.0),))
    assert table is not None
    assert set(table[table["measured"] == 1]["tracklet"]) == {0}
    assert corrected_table(found, (), (ObjectMark(2, 400.0, 400.0),)) is None


def test_a_dragged_outline_replaces_or_adds_a_row() -> None:
    table = corrected_table(
        _table(), (ObjectMark(2, 99.0, 98.0, True), ObjectMark(4, 77.0, 76.0, True))
    )
    assert table is not None
    own = table[table["measured"] == 1].set_index("frame")
    assert own.loc[2, ["x_px", "y_px"]].tolist() == [99.0, 98.0]
    assert own.loc[4, ["x_px", "y_px", "radius_px", "tracklet"]].tolist() == [77.0, 76.0, 5.0, 0.0]
    assert own.loc[3, "x_px"] == 23.0
    assert own.index.tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    "marks",
    [
        (),
        (ObjectMark(2, 22.0, 55.0),),
        (ObjectMark(4, 24.0, 30.0),),
        (ObjectMark(700, 24.0, 30.0),),
    ],
)
def test_a_mark_on_nothing_found_makes_no_table(marks: tuple[ObjectMark, ...]) -> None:
    assert corrected_table(_table(), marks) is None
    assert corrected_table(None, marks) is None


def test_the_command_and_python_say_what_is_measured(tmp_path: Path) -> None:
    setup = tmp_path / "lab.toml"
    setup.write_text("[camera]\ncapture_fps = 240\n")
    clip = tmp_path / "a strike.mp4"
    inputs = ClipInputs(fps="600", ball="jokku", wall_grid="50mm", setup="lab.toml", kind="swing")
    corrections = Corrections(inputs, (ObjectMark(3, 10.5, 20.0),), ObjectMark(1, 5.0, 6.0))
    options = options_of(clip, corrections, corrected=False)
    assert (options.fps, options.ball, options.wall_grid) == (600.0, "jokku", "50mm")
    assert (options.ball_at, options.mass_at) == ((10.5, 20.0, 3), (5.0, 6.0, 1))
    assert options.kind is MotionKind.SWING
    assert options.setup.camera.capture_fps == 240.0
    command = as_command(CLIP, corrections, corrected=False)
    assert command == (
        "vision measure '/lab/a strike.mp4' --fps 600 --ball jokku --wall-grid 50mm"
        " --setup /lab/lab.toml --kind swing --ball-at 10.5,20,3 --mass-at 5,6,1"
    )
    table = as_command(CLIP, corrections, corrected=True)
    assert "--ball-at" not in table
    assert table.endswith("--from-tracks '/lab/a strike.mp4.corrected.csv'")
    python = as_python(CLIP, corrections, corrected=True)
    assert "wall_grid='50mm'" in python
    assert "tracklets='/lab/a strike.mp4.corrected.csv'" in python
    compile(python, "cell", "exec")


def test_a_wrong_input_is_a_sentence(tmp_path: Path) -> None:
    for inputs, said in (
        (ClipInputs(fps="fast"), "--fps"),
        (ClipInputs(scale="1 mm/px", wall_grid="50mm"), "both set the scale"),
        (ClipInputs(setup="none.toml"), "none.toml"),
        (ClipInputs(kind="dance"), "dance"),
    ):
        with pytest.raises(UsageError, match=said):
            options_of(tmp_path / "a.mp4", Corrections(inputs), corrected=False)


def test_a_stick_gives_the_scale_with_the_uncertainty_of_its_ends_and_length() -> None:
    stick = Stick(10.0, 20.0, 310.0, 420.0, "2 m ± 4 mm")
    options = options_of(CLIP, Corrections(stick=stick), corrected=False)
    assert options.scale_m_per_px is not None
    value, std = options.scale_m_per_px
    assert value == pytest.approx(2.0 / 500.0)
    # ends placed at random as well as stated, the length as measured
    noise = np.random.default_rng(5).normal(size=(4000, 5))
    ends = np.array([10.0, 20.0, 310.0, 420.0]) + END_STD_PX * noise[:, :4]
    lengths = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
    assert std == pytest.approx(np.std((2.0 + 0.004 * noise[:, 4]) / lengths), rel=0.05)
    assert "--scale '250 px/m ± " in as_command(CLIP, Corrections(stick=stick), corrected=False)
    assert "scale='250 px/m ± " in as_python(CLIP, Corrections(stick=stick), corrected=False)


@pytest.mark.parametrize("point", FIXED_POINTS)
def test_a_placed_point_is_an_option_in_command_and_python(point: str) -> None:
    corrections = Corrections(**{point: (120.5, -8.0)})
    options = options_of(CLIP, corrections, corrected=False)
    assert getattr(options, f"{point}_at") == (120.5, -8.0)
    assert f"--{point}-at 120.5,-8" in as_command(CLIP, corrections, corrected=False)
    assert f"{point}_at='120.5,-8'" in as_python(CLIP, corrections, corrected=False)


def test_placed_axes_are_an_option_in_command_and_python() -> None:
    corrections = Corrections(axes=Axes(10.0, 20.5, -7.0))
    assert options_of(CLIP, corrections, corrected=False).axes == corrections.axes
    assert "--axes 10,20.5,-7" in as_command(CLIP, corrections, corrected=False)
    assert "axes='10,20.5,-7'" in as_python(CLIP, corrections, corrected=False)


def test_a_proposed_option_is_an_input_of_the_clip() -> None:
    assert cure_of("--scale '2.44 mm/px'", KNOWN) == ("scale", "2.44 mm/px")
    assert cure_of("--wall-grid 50mm", KNOWN) == ("wall_grid", "50mm")
    assert cure_of('measure both again. distance_to_wall = "4 m" in [camera]', KNOWN) is None
    assert cure_of("--fps", KNOWN) is None
