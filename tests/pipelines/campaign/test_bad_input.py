"""What goes wrong around a campaign is named, and the rest goes on."""

import json
import os
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from metrology import UsageError
from pipelines.campaign.conduct import CampaignOptions, conduct
from pipelines.campaign.ledger import AttemptOutcome, Ledger, State, WorkOrder
from pipelines.campaign.run import find_clips
from pipelines.campaign.worker import Request, answer

STAND_IN = Path(__file__).with_name("stand_in.py")
ROOT = Path(__file__).parents[3]
_ON_A_SMALL_DISK = """
import resource, signal, sys
from pathlib import Path
from metrology import UsageError
from pipelines.campaign.results import match_clips
from pipelines.campaign.run import RunOptions, RunPlan, find_clips, local_crew, run
clips, out, stand_in, most = *map(Path, sys.argv[1:4]), int(sys.argv[4])
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
if most:
    # files end there as on a disk that is full
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
options = RunOptions(command=(sys.executable, str(stand_in)))
plan = RunPlan(out, options, match_clips(None, find_clips([clips])), "1")
try:
    print(run(plan, lambda: local_crew(2, options)).done)
except UsageError as problem:
    print(problem)
    sys.exit(problem.exit_code)
"""


def test_no_clips_and_no_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no clip in"):
        find_clips([tmp_path])
    with pytest.raises(UsageError, match="no clip or folder"):
        find_clips([tmp_path / "nothing"])


def test_a_clip_that_is_gone_fails_by_name(tmp_path: Path) -> None:
    reply = answer(Request(path=str(tmp_path / "gone.mp4")))
    assert "gone.mp4" in reply["error"]
    assert reply["document"] is None


def test_a_folder_that_can_not_be_made_is_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "clips").mkdir()
    (tmp_path / "clips" / "a.mp4").write_bytes(b"a")
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(UsageError, match="file"):
        conduct(CampaignOptions(clips=(tmp_path / "clips",), out=tmp_path / "file" / "out"))


@pytest.mark.parametrize("damage", [b"no database", b"SQLite format 3\0" + b"x" * 4096])
def test_a_damaged_ledger_is_refused_in_words(damage: bytes, tmp_path: Path) -> None:
    (tmp_path / "ledger.sqlite").write_bytes(damage)
    with pytest.raises(UsageError, match="ledger"):
        Ledger(tmp_path)


def _with_two_clips(folder: Path) -> None:
    with Ledger(folder) as ledger:
        orders = [WorkOrder(name, name, "0", "0", "1") for name in ("a.mp4", "b.mp4")]
        ledger.plan(orders, retry_failed=False)
        ledger.finish([AttemptOutcome("a.mp4", State.DONE, 1.0, json.dumps({"quantities": {}}))])


@pytest.mark.parametrize(
    "change",
    [
        "document='{\"quantities'",
        "state='gone'",
        "attempts='often'",
        "document=CAST(x'ff7b' AS TEXT)",
    ],
)
def test_a_row_that_can_not_be_one_is_told_as_a_damaged_ledger(change: str, tmp_path: Path) -> None:
    _with_two_clips(tmp_path)
    with sqlite3.connect(tmp_path / "ledger.sqlite") as base:
        base.execute("PRAGMA ignore_check_constraints=ON")
        base.execute(f"UPDATE clips SET {change} WHERE clip='a.mp4'")
    base.close()
    with Ledger(tmp_path) as ledger, pytest.raises(UsageError, match="damaged") as refusal:
        _ = [*ledger.entries(), ledger.counts()]
    assert "--out" in str(refusal.value.hint)


def test_what_the_reader_of_the_rows_raises_is_its_own(tmp_path: Path) -> None:
    _with_two_clips(tmp_path)
    with Ledger(tmp_path) as ledger, pytest.raises(ValueError, match="mine"):
        _ = [float("mine") for _ in ledger.entries()]


def test_on_a_full_disk_nothing_is_lost(tmp_path: Path) -> None:
    clips, out = tmp_path / "clips", tmp_path / "out"
    clips.mkdir()
    out.mkdir()
    for number in range(40):
        (clips / f"strike_{number:02d}.mp4").write_bytes(str(number).encode())
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}

    def ran(most: int) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [
                sys.executable,
                "-c",
                _ON_A_SMALL_DISK,
                str(clips),
                str(out),
                str(STAND_IN),
                str(most),
            ],
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )

    full = ran(150_000)
    assert full.returncode == 2, full.stderr
    assert "the ledger can't be written" in full.stdout
    with Ledger(out) as ledger:
        before = ledger.counts()[State.DONE]
    assert 0 < before < 40
    again = ran(0)
    assert again.returncode == 0, again.stderr
    # what was done before is not done again
    assert int(again.stdout) == 40 - before
