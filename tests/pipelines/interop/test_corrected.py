"""Tables of objects found are written, corrected by hand and measured again."""

from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import impact_vision as iv
from metrology import UsageError
from pipelines.cli import app
from tests.vision.ball.painted import exposed, wall, with_ball

FRAMES = 40
HEIGHTS = (36.0, 92.0)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two balls thrown towards each other: the upper to the right, the lower to the left."""
    folder = tmp_path_factory.mktemp("two") / "balls"
    folder.mkdir()
    for index in range(FRAMES):
        fall = 0.02 * (index - 20) ** 2
        upper = (20.0 + 4 * index, HEIGHTS[0] - 8.0 + fall)
        lower = (185.0 - 3 * index, HEIGHTS[1] - 8.0 + fall)
        light = with_ball(with_ball(wall(120, 200), upper, 10.0), lower, 9.0)
        cv2.imwrite(str(folder / f"{index:03d}.png"), exposed(light, 1.5, index))
    return folder


def measured(clip: Path, *options: str | Path) -> tuple[int, str]:
    words = ["measure", clip, "--fps", "240", "--scale", "4.26 mm/px", *options]
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert "Traceback" not in result.output
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture(scope="module")
def tables(clip: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    folder = tmp_path_factory.mktemp("tables")
    found = tuple(folder / f"{name}.csv" for name in ("detections", "tracklets", "tracks"))
    options = ("--detections", found[0], "--tracklets", found[1], "--tracks", found[2])
    code, said = measured(clip, *options)
    assert code == 0, said
    return found


def ball_of(tracks: Path) -> pd.DataFrame:
    table = pd.read_csv(tracks)
    return table[table["object"] == "ball"]


def swapped(table: pd.DataFrame) -> pd.DataFrame:
    """The other tracklet marked as measured: the one of the other ball."""
    chosen = table.loc[table["measured"] == 1, "tracklet"].iloc[0]
    usual = table.groupby("tracklet")["y_px"].median()
    far = (usual - usual[chosen]).abs()
    counts = table.groupby("tracklet").size()
    other = counts[far > 30.0].idxmax()
    return table.assign(measured=(table["tracklet"] == other).astype(int))


def test_the_tables_hold_what_was_found(tables: tuple[Path, Path, Path]) -> None:
    seen, linked = pd.read_csv(tables[0]), pd.read_csv(tables[1])
    assert seen["frame"].between(0, FRAMES - 1).all()
    assert seen["frame"].nunique() == FRAMES
    own = linked[linked["measured"] == 1]
    assert {"score", "kind"} <= {*seen} & {*linked}
    assert own["score"].median() > seen["score"].median() - 1e-6
    assert (own["kind"] == "object").mean() > 0.9
    ball = ball_of(tables[2])
    near = own.merge(ball, on="frame", suffixes=("", "_fit"))
    assert len(near) > 30
    assert np.hypot(near["x_px"] - near["x_px_fit"], near["y_px"] - near["y_px_fit"]).max() < 2.0
    assert linked.groupby("tracklet")["probability"].first().sum() <= 1.0 + 1e-4


@pytest.mark.parametrize("separator", [",", ";"])
def test_a_swapped_choice_is_followed(
    separator: str, clip: Path, tables: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    corrected, again = tmp_path / "corrected.csv", tmp_path / "again.csv"
    table = swapped(pd.read_csv(tables[1]))
    table.to_csv(corrected, index=False, sep=separator, decimal="," if separator == ";" else ".")
    code, said = measured(clip, "--from-tracks", corrected, "--tracks", again)
    assert code == 0, said
    before, after = ball_of(tables[2]), ball_of(again)
    assert len(after) > 30
    assert abs(after["y_px"].median() - before["y_px"].median()) > 40.0
    assert np.diff(after["x_px"]).mean() * np.diff(before["x_px"]).mean() < 0.0


def test_corrected_detections_are_linked_anew(
    clip: Path, tables: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    corrected, again = tmp_path / "corrected.csv", tmp_path / "again.csv"
    seen = pd.read_csv(tables[0])
    height = ball_of(tables[2])["y_px"].median()
    seen[(seen["y_px"] - height).abs() > 30.0].to_csv(corrected, index=False)
    code, said = measured(clip, "--from-tracks", corrected, "--tracks", again)
    assert code == 0, said
    assert abs(ball_of(again)["y_px"].median() - height) > 40.0


def test_python_measures_a_corrected_table(clip: Path) -> None:
    first = iv.measure(clip, fps=240, scale="4.26 mm/px")
    other = iv.measure(clip, fps=240, scale="4.26 mm/px", tracklets=swapped(first.tracklets))
    assert len(first.detections) >= len(first.tracklets)
    speeds = [
        np.diff(one.tracks.query("object == 'ball'")["x_px"]).mean() for one in (first, other)
    ]
    assert sorted(speeds) == pytest.approx([-3.0, 4.0], abs=0.05)
    assert other.tracklets["measured"].sum() > 30


def both_marked(table: pd.DataFrame) -> pd.DataFrame:
    return table.assign(measured=1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (both_marked, "two rows in frame"),
        (lambda table: table.drop(columns="light"), "lacks the columns light"),
        (lambda table: table.assign(frame=table["frame"] + 1000), "the clip has 40 frames"),
        (lambda table: table.assign(measured=2), "measured is 2"),
        (lambda table: table.assign(x_px="left"), "x_px is left"),
        (lambda table: table.head(2), "no object of 3 rows"),
        (lambda table: table.head(0), "is empty"),
    ],
)
def test_mistakes_in_a_table_are_named(
    change, said: str, clip: Path, tables: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    corrected = tmp_path / "corrected.csv"
    change(pd.read_csv(tables[1])).to_csv(corrected, index=False)
    code, output = measured(clip, "--from-tracks", corrected)
    assert code == 2
    assert said in output


def test_tables_are_refused_before_the_work(tmp_path: Path) -> None:
    missing = Path("no-such-clip.mp4")
    out = tmp_path / "a.csv"
    for options, said in (
        (("--tracklets", tmp_path / "no" / "a.csv"), "a.csv"),
        (("--tracklets", out, "--csv", out), "named twice"),
        (("--detections", tmp_path / "a.parquet"), "unknown file ending"),
    ):
        code, output = measured(missing, *options)
        assert code == 2
        assert said in output
    assert [*tmp_path.iterdir()] == []


def test_a_corrected_table_needs_its_clip(tables: tuple[Path, Path, Path], tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["measure", "--from-tracks", str(tables[1])])
    assert result.exit_code == 2
    assert "it needs the clip" in " ".join(result.output.split())
    plain = ["measure", "--from-tracks", str(tables[2]), "--tracklets", str(tmp_path / "a.csv")]
    result = CliRunner().invoke(app, plain)
    assert result.exit_code == 2
    assert "nothing is searched" in " ".join(result.output.split())


@pytest.mark.parametrize(
    ("table", "said"),
    [(pd.DataFrame({"frame": [1]}), "lacks the columns"), (3, "is no table")],
)
def test_a_table_of_no_objects_is_refused_in_python(table, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        iv.measure("a.mp4", tracklets=table)


def test_what_was_found_is_written_where_no_ball_is(tmp_path: Path) -> None:
    still = tmp_path / "still"
    still.mkdir()
    for index in range(12):
        cv2.imwrite(str(still / f"{index:03d}.png"), exposed(wall(120, 200), 1.5, index))
    found = tmp_path / "detections.csv"
    code, said = measured(still, "--detections", found)
    assert code == 4
    assert "no ball found" in said
    assert {"frame", "x_px", "y_px", "radius_px", "score", "kind"} <= {*pd.read_csv(found)}
