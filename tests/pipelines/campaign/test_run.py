"""A campaign that is killed, whose clips crash, hang or are refused, loses nothing."""

import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from metrology import UsageError
from pipelines.campaign.ledger import Ledger, lock_folder
from pipelines.campaign.results import match_clips
from pipelines.campaign.run import RunOptions, RunPlan, find_clips, local_crew, run

STAND_IN = Path(__file__).with_name("stand_in.py")
ROOT = Path(__file__).parents[3]


def _clips(folder: Path, names: list[str]) -> Path:
    folder.mkdir()
    for name in names:
        (folder / f"{name}.mp4").write_bytes(name.encode())
    return folder


def _plan(clips: Path, out: Path, version: str = "1", **options: object) -> RunPlan:
    chosen = RunOptions(command=(sys.executable, str(STAND_IN)), **options)  # type: ignore[arg-type]
    return RunPlan(out, chosen, match_clips(None, find_clips([clips])), version)


def _run(plan: RunPlan, **options: object):  # type: ignore[no-untyped-def]
    return run(plan, lambda: local_crew(2, plan.options), **options)  # type: ignore[arg-type]


def _states(out: Path) -> dict[str, tuple[str, str | None, int]]:
    with Ledger(out) as ledger:
        return {e.order.clip: (str(e.state), e.error, e.attempts) for e in ledger.entries()}


def test_every_clip_is_done_once_and_bad_ones_are_put_aside(tmp_path: Path) -> None:
    clips = _clips(tmp_path / "clips", ["a", "b", "crash", "hang", "refuse"])
    plan = _plan(clips, tmp_path / "out", timeout_s=1.5)
    progress = _run(plan)
    states = _states(tmp_path / "out")
    assert (progress.done, progress.failed) == (2, 3)
    assert states["a.mp4"] == ("done", None, 1)
    assert states["crash.mp4"][0] == "failed"
    assert "signal 9" in states["crash.mp4"][1]
    assert states["crash.mp4"][2] == 2
    assert "longer than 1.5 s" in states["hang.mp4"][1]
    assert states["refuse.mp4"] == ("failed", "no ball is seen", 1)
    # the same command again has nothing to do; failed clips are tried again when asked
    assert _run(plan).todo == 0
    assert _run(plan, retry_failed=True, only=("refuse.mp4",)).todo == 1


def test_a_changed_clip_or_version_is_measured_again_and_said(tmp_path: Path) -> None:
    clips = _clips(tmp_path / "clips", ["a", "b"])
    _run(_plan(clips, tmp_path / "out"))
    (clips / "a.mp4").write_bytes(b"filmed anew")
    again = _run(_plan(clips, tmp_path / "out"))
    assert (again.todo, again.again) == (1, {"a.mp4": "clip"})
    later = _run(_plan(clips, tmp_path / "out", version="2"))
    assert later.again == {"a.mp4": "version", "b.mp4": "version"}
    assert _states(tmp_path / "out")["a.mp4"][0] == "done"


_COORDINATOR = """
import sys
from pathlib import Path
from pipelines.campaign.results import match_clips
from pipelines.campaign.ledger import lock_folder
from pipelines.campaign.run import RunOptions, RunPlan, find_clips, local_crew, run
clips, out, stand_in = map(Path, sys.argv[1:])
options = RunOptions(command=(sys.executable, str(stand_in)))
plan = RunPlan(out, options, match_clips(None, find_clips([clips])), "1")
with lock_folder(out):
    run(plan, lambda: local_crew(2, options))
"""


@pytest.mark.parametrize("kills", [1, pytest.param(30, marks=pytest.mark.slow)])
def test_killed_at_random_moments_nothing_is_lost_and_nothing_done_twice(
    tmp_path: Path, kills: int
) -> None:
    names = [f"strike_{i:02d}" for i in range(12 if kills == 1 else 60)]
    clips, out = _clips(tmp_path / "clips", names), tmp_path / "out"
    out.mkdir()
    moments = random.Random(11)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "STAND_IN_SECONDS": "0.2"}
    command = [sys.executable, "-c", _COORDINATOR, str(clips), str(out), str(STAND_IN)]
    finished_before: dict[str, str] = {}
    for _ in range(kills):
        process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
        time.sleep(moments.uniform(1.5, 3.5))
        process.send_signal(signal.SIGKILL)
        process.wait()
        base = sqlite3.connect(out / "ledger.sqlite")
        try:
            rows = base.execute("SELECT clip, finished FROM clips WHERE state='done'").fetchall()
        except sqlite3.OperationalError:
            rows = []
        base.close()
        done = dict(rows)
        # what was done stays done, and was not measured a second time
        assert finished_before.items() <= done.items()
        finished_before = done
    subprocess.run(command, env=environment, check=True, stderr=subprocess.DEVNULL, timeout=120)
    states = _states(out)
    assert {clip for clip, (state, *_) in states.items() if state == "done"} == {
        f"{name}.mp4" for name in names
    }
    in_flight = 2 * 2
    assert sum(tries - 1 for _, _, tries in states.values()) <= in_flight * kills


def test_a_second_run_in_the_same_folder_is_refused(tmp_path: Path) -> None:
    with (
        lock_folder(tmp_path / "out"),
        pytest.raises(UsageError, match="another run is active"),
        lock_folder(tmp_path / "out"),
    ):
        pass


def test_a_ledger_of_a_later_version_is_refused(tmp_path: Path) -> None:
    with Ledger(tmp_path):
        pass
    base = sqlite3.connect(tmp_path / "ledger.sqlite")
    base.execute("PRAGMA user_version=99")
    base.close()
    with pytest.raises(UsageError, match="later version"):
        Ledger(tmp_path)


def test_the_published_tables_keep_lab_book_and_reasons(tmp_path: Path) -> None:
    from measuring.setup.cor_file import read_cor_file
    from measuring.setup.file import Setup
    from pipelines.campaign.conduct import Edition, publish
    from pipelines.campaign.report import ReportFacts
    from pipelines.campaign.results import read_lab_book

    names = [f"s{i:02d}" for i in range(14)]
    clips, out = _clips(tmp_path / "clips", [*names, "refuse"]), tmp_path / "out"
    book_path = tmp_path / "trials.csv"
    lines = ["clip,ball,session,remark,impact_speed_encoder_m_s"]
    lines += [f"{name},jokku,{'ab'[i % 2]},=evil(),2.0" for i, name in enumerate(names)]
    book_path.write_text("\n".join(lines))
    book = read_lab_book(book_path)
    plan = RunPlan(
        out,
        RunOptions(command=(sys.executable, str(STAND_IN))),
        match_clips(book, find_clips([clips])),
        "1",
    )
    _run(plan)
    strikes = {clip.name: strike for clip, strike in plan.matched.strikes.items()}
    edition = Edition(out, book, strikes, Setup(), None, ReportFacts("C", "1", None))
    with Ledger(out) as ledger:
        ledger.exclude("s03.mp4", "ball rolled")
        publish(edition, ledger)
    table = pd.read_csv(out / "results.csv")
    assert list(table.columns[:5]) == [
        "clip",
        "ball",
        "session",
        "remark",
        "impact_speed_encoder_m_s",
    ]
    by_clip = table.set_index("clip")
    assert by_clip.loc["s00.mp4", "remark"] == "'=evil()"
    assert by_clip.loc["s00.mp4", "reason_landing_distance"] == "out of view"
    assert (
        len(pd.read_parquet(out / "results.parquet"))
        == len(pd.read_excel(out / "results.xlsx"))
        == 15
    )
    laws = read_cor_file(out / "cor.toml")
    summary = json.loads((out / "summary.json").read_text())
    assert summary["clips"] == {"done": 14, "failed": 1, "waiting": 0, "excluded": 1}
    assert summary["excluded"] == [{"clip": "s03.mp4", "why": "ball rolled"}]
    ball = summary["balls"]["jokku"]
    assert ball["clips"] == 13
    middle = ball["cor_at"][4]
    truth = 0.1073 * 2.718281828 ** (-0.2685 * middle["speed"]) + 0.6746
    assert abs(middle["value"] - truth) < 3 * middle["std"]
    # what simulate and plan are handed is the band of the report
    for one in ball["cor_at"]:
        assert abs(laws["jokku"].law(one["speed"]) - one["value"]) < 0.1 * one["std"]
        assert laws["jokku"].std_at(one["speed"]) == pytest.approx(one["std"], rel=0.1)
    assert summary["sensors"]["impact_speed_encoder_m_s"]["pairs"] == 13
    page = (out / "report.html").read_text()
    assert "ball rolled" in page
    assert "http" not in page.replace("http://www.w3.org", "")
