"""`vision campaign` as somebody types it: exit codes, what is refused, what is said."""

import json
import math
import shutil
import sqlite3
import sys
from pathlib import Path

import pandas as pd
import pytest
from click.testing import Result
from typer.testing import CliRunner

from pipelines.campaign import worker
from pipelines.campaign.ledger import Ledger, State
from pipelines.cli import app

STAND_IN = Path(__file__).with_name("stand_in.py")
LAB = """
[pendulum]
length = "0.5541 m"
[balls.red]
mass = "0.3 kg"
diameter = "0.2 m"
"""


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of clips that a stand-in measures, a lab book and a setup."""
    monkeypatch.setattr(worker, "OWN_WORKER", (sys.executable, str(STAND_IN)))
    (tmp_path / "clips").mkdir()
    for name in ("a", "b", "c"):
        (tmp_path / "clips" / f"{name}.mp4").write_bytes(name.encode())
    (tmp_path / "lab.toml").write_text(LAB)
    (tmp_path / "trials.csv").write_text("clip,ball\na,red\nb,red\nc,red\n")
    return tmp_path


def _campaign(lab: Path, *more: str) -> Result:
    given = ["campaign", str(lab / "clips"), "--out", str(lab / "out")]
    given += ["--trials", str(lab / "trials.csv"), "--setup", str(lab / "lab.toml")]
    return CliRunner().invoke(app, [*given, "-j", "1", *more])


def test_too_few_strikes_to_explain_are_told_and_the_campaign_stands(lab: Path) -> None:
    ran = _campaign(lab, "--explain")
    assert ran.exit_code == 0, ran.output
    assert "3 clips measured" in ran.output
    told = json.loads((lab / "out" / "explain.json").read_text())
    assert told["verdict"] is None
    assert told["reason"] in ran.output.replace("\n", " ")
    assert told["reason"][:40] in (lab / "out" / "report.html").read_text()


def test_numbers_that_no_model_fits_end_the_explanation_only(
    lab: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pipelines.campaign import conduct

    def singular(**given: object) -> object:
        raise ArithmeticError("singular matrix")

    monkeypatch.setattr(conduct, "find_missing_physics", singular)
    ran = _campaign(lab, "--explain")
    assert ran.exit_code == 0, ran.output
    assert "singular matrix" in (lab / "out" / "report.html").read_text()


def test_what_could_not_be_measured_is_listed_with_exit_code_4(lab: Path) -> None:
    (lab / "clips" / "refuse.mp4").write_bytes(b"r")
    (lab / "trials.csv").write_text("clip,ball\na,red\nunknown,red\n")
    ran = _campaign(lab)
    assert ran.exit_code == 4
    assert "refuse.mp4: no ball is seen" in ran.output
    assert "unknown: in the lab book, but no such clip was given" in ran.output
    with Ledger(lab / "out") as ledger:
        assert ledger.counts()[State.DONE] == 3


@pytest.mark.parametrize(
    ("book", "said"),
    [
        ("clip,ball\na,blue\n", "unknown ball 'blue'"),
        ("clip,backswing_deg\na,6250\n", "outside the range of a pendulum"),
        ("clip;ball;backswing_deg\na\n", None),
        ("ball\nred\n", "no column 'clip'"),
    ],
)
def test_a_slip_in_the_lab_book_is_refused_before_the_work(
    lab: Path, book: str, said: str | None
) -> None:
    (lab / "trials.csv").write_text(book)
    ran = _campaign(lab, "--quiet")
    assert ran.exit_code == (0 if said is None else 2), ran.output
    if said is not None:
        assert said in ran.output
        assert not (lab / "out" / "ledger.sqlite").exists()


def _same(one: object, other: object) -> bool:
    """Whether nested tables agree up to the rounding of numbers."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-6)
    return one == other


def test_one_recording_under_two_names_counts_once_and_that_is_told(lab: Path) -> None:
    names = [f"s{number}" for number in range(8)]
    (lab / "trials.csv").write_text("clip,ball\n" + "".join(f"{name},red\n" for name in names))
    shutil.rmtree(lab / "clips")
    (lab / "clips").mkdir()
    for name in names:
        (lab / "clips" / f"{name}.mp4").write_bytes(name.encode())
    assert _campaign(lab).exit_code == 0
    once = json.loads((lab / "out" / "summary.json").read_text())
    # entered before the others in the folder's order, in no lab book, and with another result
    (lab / "clips" / "copy.mp4").write_bytes(b"s3")
    shutil.rmtree(lab / "out")
    ran = _campaign(lab)
    assert ran.exit_code == 0, ran.output
    told = "copy.mp4 and s3.mp4 are the same recording: its strike counts once, as s3.mp4"
    assert told in ran.output.replace("\n", " ")
    page = (lab / "out" / "report.html").read_text()
    assert told in page
    assert "not counted: the same recording as s3.mp4" in page
    twice = json.loads((lab / "out" / "summary.json").read_text())
    assert twice["clips"]["done"] == 9
    # summed in another order: the last digits may differ
    assert _same(twice["balls"], once["balls"])
    assert [one["clip"] for one in twice["copies"]] == ["copy.mp4"]
    table = pd.read_csv(lab / "out" / "results.csv").set_index("clip")
    assert table["excluded"].dropna().to_dict() == {"copy.mp4": "the same recording as s3.mp4"}
    with Ledger(lab / "out") as ledger:
        ledger.exclude("copy.mp4", "a copy")
    assert "its strike counts once" not in _campaign(lab).output


def test_one_recording_of_two_balls_is_left_out_until_the_lab_book_is_mended(lab: Path) -> None:
    (lab / "clips" / "b.mp4").write_bytes((lab / "clips" / "a.mp4").read_bytes())
    (lab / "trials.csv").write_text("clip,ball\na,red\nb,jokku\nc,red\n")
    ran = _campaign(lab)
    assert "the lab book names different balls" in ran.output.replace("\n", " ")
    balls = json.loads((lab / "out" / "summary.json").read_text())["balls"]
    assert {name: ball["clips"] for name, ball in balls.items()} == {"red": 1}


def test_clips_that_nobody_asked_for_wait_and_nothing_went_wrong(lab: Path) -> None:
    ran = _campaign(lab, "--only", "a.mp4")
    assert ran.exit_code == 0, ran.output
    assert "2 clips are waiting: run the command without --only" in ran.output.replace("\n", " ")
    page = (lab / "out" / "report.html").read_text()
    assert "2 clips wait" in page
    assert "b.mp4, c.mp4" in page
    again = _campaign(lab)
    assert again.exit_code == 0
    assert "wait" not in again.output


def test_no_clips_are_refused(lab: Path) -> None:
    shutil.rmtree(lab / "clips")
    (lab / "clips").mkdir()
    ran = _campaign(lab)
    assert ran.exit_code == 2
    assert "there is no clip in" in ran.output


def test_a_clip_removed_on_the_way_fails_by_name_and_the_rest_goes_on(
    lab: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker, "OWN_WORKER", (sys.executable, "-m", "pipelines.campaign.worker"))
    for name in ("a", "b"):
        (lab / "clips" / f"{name}.mp4").unlink()
    # gone between the look into the folder and the measurement: a link to nothing
    (lab / "clips" / "gone.mp4").symlink_to(lab / "nothing.mp4")
    ran = _campaign(lab)
    assert ran.exit_code == 4
    assert "gone.mp4" in ran.output
    assert "c.mp4" in ran.output


def test_the_ledger_of_an_older_version_keeps_its_rows(lab: Path) -> None:
    out = lab / "out"
    out.mkdir()
    with sqlite3.connect(out / "ledger.sqlite") as base:
        base.execute(
            "CREATE TABLE clips (clip TEXT PRIMARY KEY, path TEXT, sha256 TEXT, options TEXT,"
            " version TEXT, state TEXT)"
        )
        base.execute("INSERT INTO clips VALUES ('a.mp4', 'x', 'y', 'z', '0', 'done')")
    base.close()
    ran = _campaign(lab)
    assert ran.exit_code == 0, ran.output
    assert "a.mp4 was measured again" in ran.output
    with Ledger(out) as ledger:
        assert ledger.counts()[State.DONE] == 3


def test_a_folder_with_somebody_elses_database_is_left_alone(lab: Path) -> None:
    out = lab / "out"
    out.mkdir()
    with sqlite3.connect(out / "ledger.sqlite") as base:
        base.execute("CREATE TABLE clips (title TEXT)")
    base.close()
    ran = _campaign(lab)
    assert ran.exit_code == 2
    assert "not a campaign ledger" in ran.output


def test_without_pyarrow_the_other_tables_are_written(
    lab: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _campaign(lab)
    assert (lab / "out" / "results.parquet").exists()
    monkeypatch.setattr("pipelines.campaign.results.find_spec", lambda name: None)
    ran = _campaign(lab)
    assert ran.exit_code == 0, ran.output
    assert "impact-vision[parquet]" in ran.output
    assert len(pd.read_csv(lab / "out" / "results.csv")) == 3
    assert not (lab / "out" / "results.parquet").exists()


def test_without_dask_the_extra_is_named(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    ran = _campaign(lab, "--dask", "tcp://127.0.0.1:9")
    assert ran.exit_code == 2
    assert "impact-vision[cluster]" in ran.output
    assert _campaign(lab).exit_code == 0


def test_results_go_next_to_the_clips_and_never_into_a_file(lab: Path) -> None:
    given = ["campaign", str(lab / "clips"), "--setup", str(lab / "lab.toml"), "-j", "1"]
    refused = CliRunner().invoke(app, [*given, "--out", str(lab / "res.csv")])
    assert refused.exit_code == 2
    assert f"--out {lab / 'res'}" in refused.output.replace("\n", "")
    ran = CliRunner().invoke(app, given)
    assert ran.exit_code == 0, ran.output
    assert (lab / "clips" / "results" / "results.csv").is_file()
    # without a terminal each clip has its line
    lines = [line for line in ran.output.splitlines() if "measured in" in line]
    assert [line.split(" ")[0] for line in lines] == ["1/3", "2/3", "3/3"]


def test_a_wrong_input_is_the_reason_of_a_clip(lab: Path) -> None:
    from pipelines.campaign.worker import Request, answer
    from tests.shared_data import shared_folder

    folder = shared_folder("inputs")
    setup, clip = str(folder / "lab.toml"), str(folder / "base_strike.mkv")
    reply = answer(Request(path=clip, setup=setup, fps="600", wall_grid="40mm"))
    assert "--wall-grid 50mm" in str(reply.get("error") or reply["document"]["warnings"][0])
