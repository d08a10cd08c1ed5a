"""Concealed runs: interruption and resumption."""

import json
import subprocess
import sys
import time

import pytest

from bench.concealed.__main__ import Shelf, _answered, _options
from bench.concealed.run import Stop, run_until
from bench.concealed.world.draw import draw_campaign


def _double(task):
    return 2 * task


def _slow(task):
    time.sleep(0.2)
    return task


def test_all_tasks_are_done_in_order():
    assert run_until(Stop(), _double, [1, 2, 3, 4], 2) == [2, 4, 6, 8]


def test_tasks_not_started_in_time_give_none():
    assert run_until(Stop(minutes=0.0), _double, [1, 2], 1) == [None, None]
    found = run_until(Stop(minutes=0.3 / 60.0), _slow, list(range(40)), 1)
    assert found[0] == 0
    assert found[-1] is None


def test_an_interrupted_run_returns_its_answers():
    code = (
        "import time, os, signal\n"
        "from bench.concealed.run import Stop, run_until\n"
        "from tests.bench.test_run import _slow\n"
        "import threading\n"
        "threading.Timer(1.0, lambda: os.kill(os.getpid(), signal.SIGTERM)).start()\n"
        "print(sum(r is not None for r in run_until(Stop(), _slow, list(range(200)), 1)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 1 <= int(done.stdout) < 100


@pytest.mark.slow
def test_answers_of_a_stopped_run_count_in_the_next_run(tmp_path, monkeypatch):
    shelf = Shelf(tmp_path, 3, "engine")
    for number in (0, 1):
        draw_campaign(3, number, shelf.campaign(number), shelf.keys)
    shelf.answers.mkdir()
    kept = {"verdict": "no_mismatch", "seconds": 1.0}
    (shelf.answers / "0000.json").write_text(json.dumps(kept))
    asked = ["proof", "--campaigns", "2", "--seed", "3", "--jobs", "1", "--minutes", "0"]
    monkeypatch.setattr(sys, "argv", asked)
    own = _answered(_options(), shelf, Stop(minutes=0.0))
    assert [scored.judgement.key.number for scored in own] == [0]
