"""A campaign on a Dask cluster of other processes, whose workers and scheduler go away."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from metrology import UsageError
from pipelines.campaign.ledger import AttemptOutcome, Ledger, State
from pipelines.campaign.results import match_clips
from pipelines.campaign.run import Progress, RunOptions, RunPlan, cluster_crew, find_clips, run

STAND_IN = Path(__file__).with_name("stand_in.py")
ROOT = Path(__file__).parents[3]


@dataclass
class Cluster:
    """A scheduler and workers, each a process of its own."""

    folder: Path
    processes: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def start(self, module: str, *options: str) -> subprocess.Popen[bytes]:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "STAND_IN_SECONDS": "0.4"}
        process = subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{module}", *options],
            env=environment,
            cwd=self.folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.processes.append(process)
        return process

    @property
    def address(self) -> str:
        import json

        return str(json.loads((self.folder / "scheduler.json").read_text())["address"])


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    (tmp_path / "dask").mkdir()
    made = Cluster(tmp_path / "dask")
    made.start(
        "dask_scheduler", "--port", "0", "--host", "127.0.0.1", "--no-dashboard",
        "--scheduler-file", "scheduler.json",
    )  # fmt: skip
    for _ in range(2):
        made.start(
            "dask_worker", "--scheduler-file", "scheduler.json", "--nworkers", "1",
            "--nthreads", "1", "--no-dashboard", "--no-nanny", "--death-timeout", "60",
        )  # fmt: skip
    until = time.monotonic() + 60
    while not (made.folder / "scheduler.json").exists() and time.monotonic() < until:
        time.sleep(0.1)
    _wait_for_workers(made.address, 2)
    yield made
    for process in made.processes:
        process.kill()
        process.wait()


def _wait_for_workers(address: str, number: int) -> None:
    from distributed import Client

    with Client(address, timeout="60s") as client:
        client.wait_for_workers(number, timeout=60)


def _plan(tmp_path: Path, count: int) -> RunPlan:
    clips = tmp_path / "clips"
    clips.mkdir(exist_ok=True)
    for number in range(count):
        (clips / f"strike_{number:02d}.mp4").write_bytes(str(number).encode())
    options = RunOptions(command=(sys.executable, str(STAND_IN)))
    return RunPlan(tmp_path / "out", options, match_clips(None, find_clips([clips])), "1")


def _counts(out: Path) -> dict[State, int]:
    with Ledger(out) as ledger:
        return dict(ledger.counts())


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_clips_go_to_both_workers_and_a_worker_that_dies_loses_none(
    cluster: Cluster, tmp_path: Path
) -> None:
    plan = _plan(tmp_path, 16)
    ended = threading.Timer(2.5, cluster.processes[-1].kill)
    ended.start()
    progress = run(plan, lambda: cluster_crew(cluster.address, plan.options))
    ended.join()
    assert (progress.done, progress.failed, progress.stopped) == (16, 0, None)
    assert _counts(tmp_path / "out")[State.DONE] == 16


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_a_scheduler_that_goes_away_leaves_the_rest_waiting(
    cluster: Cluster, tmp_path: Path
) -> None:
    plan = _plan(tmp_path, 40)
    clips_seen: list[str] = []

    def end_the_scheduler(progress: Progress, outcome: AttemptOutcome) -> None:
        clips_seen.append(outcome.clip)
        if len(clips_seen) == 3:
            cluster.processes[0].kill()

    address = cluster.address
    progress = run(plan, lambda: cluster_crew(address, plan.options), after_each=end_the_scheduler)
    assert progress.stopped == "the cluster is gone"
    counts = _counts(tmp_path / "out")
    assert counts[State.DONE] == progress.done
    assert counts.get(State.FAILED, 0) == 0
    assert 0 < progress.done < 40
    # the same command on this machine goes on with the rest
    from pipelines.campaign.run import local_crew

    later = run(plan, lambda: local_crew(2, plan.options))
    assert later.done == 40 - progress.done
    assert _counts(tmp_path / "out")[State.DONE] == 40


def test_an_address_where_nobody_answers_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipelines.campaign.run._CONNECT_TIMEOUT_S", 0.3)
    with (
        pytest.raises(UsageError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"),
        cluster_crew("tcp://127.0.0.1:9", RunOptions()),
    ):
        pass
