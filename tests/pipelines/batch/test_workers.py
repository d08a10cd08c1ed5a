"""Processes that share tasks out: what crashes loses its own task, what leaves ends all."""

import multiprocessing
import os
import time

import pytest

from metrology import UsageError
from pipelines.measure.commands import WorkerDied, run_tasks


def _work(task: str) -> str:
    if task == "crash":
        os._exit(7)
    if task == "refuse":
        raise UsageError("no", hint="yes")
    if task == "long":
        time.sleep(60)
    return task.upper()


def test_a_crash_and_a_refusal_take_nothing_else_with_them() -> None:
    results = dict(run_tasks(_work, ["a", "crash", "refuse", "b", "c"], 2))
    assert (results["a"], results["b"], results["c"]) == ("A", "B", "C")
    assert isinstance(results["crash"], WorkerDied)
    assert "7" in str(results["crash"])
    refused = results["refuse"]
    assert isinstance(refused, UsageError)
    assert refused.hint == "yes"


@pytest.mark.parametrize("workers", [2])
def test_leaving_ends_what_still_works(workers: int) -> None:
    going = run_tasks(_work, ["a", "long", "long"], workers)
    assert next(going) == ("a", "A")
    started = time.monotonic()
    going.close()
    assert time.monotonic() - started < 2.0
    assert multiprocessing.active_children() == []
