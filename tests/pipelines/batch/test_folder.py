"""A folder of results: whole at every moment, no row twice, nothing measured twice."""

import csv
from pathlib import Path

import pytest
from typer.testing import CliRunner

import pipelines.measure.commands as batch
from measuring.chain import MeasureOptions
from metrology import UsageError
from pipelines.cli import app
from pipelines.measure.commands import Done, Folder, Job, files_of, measure_all
from pipelines.measure.files import WantedFiles
from tests.pipelines.app.small import falling


def rows(out: Path) -> list[dict[str, str]]:
    with (out / "results.csv").open(encoding="utf-8", newline="") as file:
        return [*csv.DictReader(file)]


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Clips that were measured, in order; the chain itself is not run."""
    done: list[str] = []

    def tasks(function: object, jobs: list[Job], workers: int):
        for job in jobs:
            done.append(job.clip.name)
            yield job, ({"clip": str(job.clip), "ball_speed_m_s": 3.0 + len(done)}, "3 m/s", ())

    monkeypatch.setattr(batch, "run_tasks", tasks)
    return done


def jobs(folder: Path, *names: str) -> list[Job]:
    made = []
    for name in names:
        clip = folder / name
        if not clip.exists():
            clip.write_bytes(name.encode())
        made.append(Job(clip, MeasureOptions(), WantedFiles(), ()))
    return made


def test_the_same_again_goes_on_and_another_word_measures_anew(
    tmp_path: Path, measured: list[str]
) -> None:
    out = tmp_path / "out"
    stopped = measure_all(jobs(tmp_path, "a.mp4", "=b.mp4", "c.mp4"), Folder(out), ["600"], 1)
    assert [next(stopped).clip.name, next(stopped).clip.name] == ["a.mp4", "=b.mp4"]
    stopped.close()
    assert len(rows(out)) == 2
    again = [*measure_all(jobs(tmp_path, "a.mp4", "=b.mp4", "c.mp4"), Folder(out), ["600"], 1)]
    assert measured == ["a.mp4", "=b.mp4", "c.mp4"]
    assert all(isinstance(one, Done) and one.problem is None for one in again)
    [*measure_all(jobs(tmp_path, "a.mp4"), Folder(out), ["500"], 1)]
    assert measured[-1] == "a.mp4"
    assert len(rows(out)) == 3
    assert rows(out)[0]["ball_speed_m_s"] == "7.0"


def test_files_go_beside_each_other_under_the_clips_name(tmp_path: Path) -> None:
    wanted = WantedFiles(report=Path("report.html"), tracks=Path("x/tracks.csv"))
    clips = [Path("a/one.mp4"), Path("b/one.mp4")]
    first, second = files_of(tmp_path, clips, wanted).values()
    assert first.report == tmp_path / "one.report.html"
    assert first.tracks == tmp_path / "one.tracks.csv"
    assert first.json == str(tmp_path / "one.json")
    assert second.report == tmp_path / "one-2.report.html"
    assert first.overlay is None


def test_a_table_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "results.csv").write_text("name,grade\nAda,1\n", encoding="utf-8")
    with pytest.raises(UsageError, match="no column clip"):
        Folder(tmp_path)


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [(["-j", "2"], 2, "--out"), (["--out", "o", "--json", "-"], 2, "results.csv")],
)
def test_options_that_do_not_go_together_are_refused(
    options: list[str], code: int, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["measure", "a.mp4", "b.mp4", *options])
    assert result.exit_code == code
    assert said in result.output


def test_what_cannot_be_read_is_told_and_ends_with_its_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["measure", "no.mp4", "none.mp4", "--out", "o", "-j", "2"])
    assert result.exit_code == 3
    assert "no.mp4" in result.output
    assert "2 of 2" in result.output


@pytest.mark.slow
def test_a_plot_without_curves_does_not_lose_the_clips_row(tmp_path: Path) -> None:
    clip = falling(tmp_path / "drop")
    out = tmp_path / "out"
    words = ["measure", str(clip), "--out", str(out), "--plot", "p.png", "--report", "r.html"]
    result = CliRunner().invoke(app, [*words, "--fps", "240", "-j", "1"])
    assert result.exit_code == 0, result.output
    assert "nothing to plot" in result.output
    assert [row["motion"] for row in rows(out)] == ["drop"]
    assert (out / "drop.r.html").exists()
