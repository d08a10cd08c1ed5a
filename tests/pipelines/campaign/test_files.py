"""Files of a campaign are refused, swept and replaced together."""

import json
import os
import sqlite3
from pathlib import Path

import pandas as pd
import pytest

from measuring.inputs import QUANTITY_UNITS, main_quantities
from metrology import UsageError
from pipelines.campaign.conduct import CampaignOptions, conduct
from pipelines.campaign.files import PUBLISHED, clip_key, refuse_occupied, staged, sweep
from pipelines.campaign.ledger import AttemptOutcome, Ledger, State, WorkOrder
from pipelines.campaign.results import read_lab_book, results_frame, write_tables
from pipelines.measure.files import column_name
from vision.tracks import MotionKind

RESULTS = ["motion", "warnings", "state", "error", "excluded", "reason_cor"] + [
    column_name(name, unit) + std for name, unit in QUANTITY_UNITS.items() for std in ("", "_std")
]


def ledger_with(folder: Path, clip: str) -> Ledger:
    ledger = Ledger(folder)
    ledger.plan([WorkOrder(clip, clip, "0", "0", "1")], retry_failed=False)
    document = '{"quantities": {"ball_speed": {"value": 1.5, "std": 0.1, "unit": "m/s"}}}'
    ledger.finish([AttemptOutcome(clip, State.DONE, 1.0, document)])
    return ledger


@pytest.mark.parametrize("name", RESULTS)
def test_a_column_of_the_lab_book_keeps_its_cells(name: str, tmp_path: Path) -> None:
    book_file = tmp_path / "trials.csv"
    book_file.write_text(f"clip,{name}\na.mp4,mine\n")
    book = read_lab_book(book_file)
    assert any(f"{name} as book_{name}" in note for note in book.notes)
    with ledger_with(tmp_path, "a.mp4") as ledger:
        frame = results_frame(ledger.entries(), {"a.mp4": book.strikes[0]}, book, {})
    row = frame.iloc[0]
    assert row[f"book_{name}"] == "mine"
    assert row["ball_speed_m_s"] == 1.5
    assert row["state"] == "done"


def test_text_of_any_kind_is_written(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"a\xff\x1b=.mp4")
    clip = clip_key(path)
    book_file = tmp_path / "trials.csv"
    book_file.write_text("clip,=1+1,note\nb.mp4,=2+2,x\x0by\x00z\n".replace("\x00", "\x01"))
    book = read_lab_book(book_file)
    with ledger_with(tmp_path, clip) as ledger:
        ledger.exclude(clip, "no\x0bway")
        frame = results_frame(ledger.entries(), {clip: book.strikes[0]}, book, {})
        assert next(ledger.entries()).excluded == "no\ufffdway"
    write_tables(frame, tmp_path)
    table = pd.read_csv(tmp_path / "results.csv")
    sheet = pd.read_excel(tmp_path / "results.xlsx")
    for found in (table.iloc[0], sheet.iloc[0]):
        assert found["clip"] == "a\\udcff\ufffd=.mp4"
        assert found["'=1+1"] == "'=2+2"
        assert found["note"] == "x\ufffdy\ufffdz"
        assert found["excluded"] == "no\ufffdway"


def make(path: Path, kind: str) -> None:
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.write_text("x")


@pytest.mark.timeout(30)
@pytest.mark.parametrize(
    ("name", "kind"),
    [(name, kind) for name in (*PUBLISHED, "ledger.sqlite") for kind in ("pipe", "folder")]
    + [(name, kind) for name in ("tracks", "frames", "figures") for kind in ("pipe", "file")]
    + [(".run.lock", "folder"), (".run.lock", "pipe")],
)
def test_what_is_in_the_way_is_refused_before_the_work(
    name: str, kind: str, tmp_path: Path
) -> None:
    (tmp_path / "a.mp4").write_bytes(b"a")
    out = tmp_path / "out"
    out.mkdir()
    make(out / name, kind)
    with pytest.raises(UsageError, match=r"--out|writable") as refusal:
        conduct(CampaignOptions(clips=(tmp_path / "a.mp4",), out=out))
    assert str(out) in str(refusal.value)
    assert {path.name for path in out.iterdir()} <= {name, ".run.lock"}


@pytest.mark.timeout(120)
def test_pipes_and_odd_names_fail_by_name(tmp_path: Path) -> None:
    clips = tmp_path / "clips"
    clips.mkdir()
    os.mkfifo(clips / "pipe.mp4")
    odd = clips / os.fsdecode(b"\xff$\x1b[31m=.mp4")
    odd.write_bytes(b"no video")
    done = conduct(CampaignOptions(clips=(clips,), out=tmp_path / "out", jobs=1))
    pipe, other = done.wanting
    assert pipe.startswith("pipe.mp4: ")
    assert "not a regular file" in pipe
    assert other.startswith(clip_key(odd))
    assert len(pd.read_csv(tmp_path / "out" / "results.csv")) == 2


FOREIGN = {
    "other table": "CREATE TABLE notes (text)",
    "view": "CREATE VIEW clips AS WITH RECURSIVE n(clip) AS (SELECT 1 UNION ALL SELECT clip + 1"
    " FROM n) SELECT clip, clip AS path, clip AS sha256, clip AS options, clip AS version, clip AS"
    " state FROM n",
    "trigger": "CREATE TABLE clips (clip, path, sha256, options, version, state);"
    "CREATE TRIGGER t AFTER UPDATE ON clips BEGIN DELETE FROM clips; END",
    "columns": "CREATE TABLE clips (clip, path)",
}


@pytest.mark.timeout(20)
@pytest.mark.parametrize("what", FOREIGN)
def test_a_foreign_ledger_is_refused(what: str, tmp_path: Path) -> None:
    base = sqlite3.connect(tmp_path / "ledger.sqlite")
    base.executescript(FOREIGN[what])
    base.close()
    with pytest.raises(UsageError, match="not a campaign ledger"):
        Ledger(tmp_path)


@pytest.mark.parametrize(
    "change",
    [
        "clip=x'ff'",
        "path=x'00ff'",
        "seconds='long'",
        "seconds=x'00'",
        "error=x'ff'",
        "excluded=x'ff'",
        "document='[]'",
        "document='{\"quantities\": []}'",
        'document=\'{"quantities": {"cor": 1}}\'',
        'document=\'{"quantities": {"cor": {"value": "high", "std": 1}}}\'',
        'document=\'{"quantities": {"cor": {"value": 1}}}\'',
        "document='{\"warnings\": [1]}'",
        "document='{\"motion\": 1}'",
        "document=x'ff'",
        "attempts=x'ff'",
    ],
)
def test_cells_of_a_wrong_kind_are_damage(change: str, tmp_path: Path) -> None:
    ledger_with(tmp_path, "a.mp4").__exit__()
    base = sqlite3.connect(tmp_path / "ledger.sqlite")
    base.execute(f"UPDATE clips SET {change}")
    base.commit()
    base.close()
    with Ledger(tmp_path) as ledger, pytest.raises(UsageError, match="damaged"):
        _ = list(ledger.entries())


def write(folder: Path, *names: str, fails: bool = False) -> None:
    with staged(folder) as stage:
        for name in names:
            (stage / name).parent.mkdir(exist_ok=True)
            (stage / name).write_text("new")
        if fails:
            raise RuntimeError


def test_files_are_replaced_together_or_not_at_all(tmp_path: Path) -> None:
    for name in PUBLISHED:
        (tmp_path / name).write_text("old")
    with pytest.raises(RuntimeError):
        write(tmp_path, "results.csv", fails=True)
    assert {(tmp_path / name).read_text() for name in PUBLISHED} == {"old"}
    # the last of the files can't be replaced
    (tmp_path / "summary.json").unlink()
    (tmp_path / "summary.json").mkdir()
    with pytest.raises(UsageError, match="can't write the results"):
        write(tmp_path, "cor.toml", "results.csv", "summary.json", "report.html")
    kept = [name for name in PUBLISHED if name != "summary.json"]
    assert {(tmp_path / name).read_text() for name in kept} == {"old"}
    (tmp_path / "summary.json").rmdir()
    write(tmp_path, "figures/cor.svg", "results.csv", "summary.json")
    # cor.toml of an earlier run would no longer agree
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "figures",
        "results.csv",
        "summary.json",
    ]
    assert (tmp_path / "results.csv").read_text() == "new"


def test_leftovers_of_a_killed_run_are_swept(tmp_path: Path) -> None:
    own = ["my-notes.txt", ".hidden", "a-0123456789ab.csv"]
    for name in (*own, ".results-0123456789ab.csv", ".a.mp4-00ff00ff00ff.jpg"):
        (tmp_path / name).write_text("x")
    (tmp_path / ".publishing-0123456789ab").mkdir()
    (tmp_path / ".publishing-0123456789ab" / "results.csv").write_text("x")
    sweep(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(own)


def test_an_empty_folder_is_not_occupied(tmp_path: Path) -> None:
    refuse_occupied(tmp_path)


def strike_document() -> str:
    quantities = {
        name: {"value": 1.0, "std": 0.1, "unit": unit}
        if name in ("cor", "ball_speed", "camera_distance")
        else {"value": None, "unit": unit, "reason": "out of view"}
        for name, unit in QUANTITY_UNITS.items()
    }
    return json.dumps({"quantities": quantities, "motion": {"kind": "strike"}})


def test_the_main_quantities_come_first_and_the_rest_is_on_a_second_sheet(tmp_path: Path) -> None:
    book_file = tmp_path / "trials.csv"
    book_file.write_text("clip,remark\na.mp4,warm\n")
    book = read_lab_book(book_file)
    with Ledger(tmp_path) as ledger:
        ledger.plan([WorkOrder("a.mp4", "a.mp4", "0", "0", "1")], retry_failed=False)
        ledger.finish([AttemptOutcome("a.mp4", State.DONE, 1.0, strike_document())])
        frame = results_frame(ledger.entries(), {"a.mp4": book.strikes[0]}, book, {})
    main = [column_name(name, QUANTITY_UNITS[name]) for name in main_quantities(MotionKind.STRIKE)]
    twelve = [head for name in main for head in (name, f"{name}_std")]
    assert len(twelve) == 12
    assert list(frame.columns[:14]) == ["clip", "remark", *twelve]
    assert {name for name in RESULTS if name != "reason_cor"} <= {*frame.columns}
    write_tables(frame, tmp_path)
    sheets = pd.read_excel(tmp_path / "results.xlsx", sheet_name=None)
    assert list(sheets) == ["results", "all columns"]
    short = ["clip", "remark", "ball_speed_m_s", "ball_speed_m_s_std", "cor", "cor_std", "motion"]
    assert list(sheets["results"].columns)[:7] == short
    assert not [name for name in sheets["results"] if str(name).startswith("reason_")]
    assert list(sheets["all columns"].columns) == list(pd.read_csv(tmp_path / "results.csv"))
