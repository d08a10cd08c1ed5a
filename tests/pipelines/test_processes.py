"""Workers of a killed program end; a terminated one has its exit code."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from tests.shared_data import shared_folder

ROOT = Path(__file__).parents[2]
TASKS = """
from pathlib import Path
from pipelines.measure.commands import run_tasks
from tests.pipelines.test_processes import mark_and_sleep
if __name__ == "__main__":
    for done in run_tasks(mark_and_sleep, [Path("one"), Path("other")], 2):
        print(done)
"""
CLIPS = """
import sys
from concurrent.futures import ThreadPoolExecutor
from pipelines.campaign.worker import Request, WorkerProcess
with ThreadPoolExecutor(2) as pool:
    for _ in range(2):
        pool.submit(WorkerProcess(600.0, 1 << 32).ask, Request(path=sys.argv[1], fps="600"))
"""


def mark_and_sleep(path: Path) -> None:
    """A task that does not end."""
    path.touch()
    time.sleep(600.0)


def cpu_seconds(process: psutil.Process) -> float:
    return sum(process.cpu_times()[:2])


def running(path: Path, script: str, *words: str) -> subprocess.Popen[bytes]:
    path.write_text(script)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "IMPACT_VISION_CACHE": "off"}
    return subprocess.Popen([sys.executable, str(path), *words], env=environment, cwd=path.parent)


def wait_until(condition: Callable[[], bool], seconds: float) -> bool:
    until = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until:
            return False
        time.sleep(0.05)
    return True


@pytest.mark.parametrize("script", [TASKS, CLIPS], ids=["measure --out -j 2", "campaign -j 2"])
def test_workers_end_with_a_killed_parent(script: str, tmp_path: Path) -> None:
    clip = shared_folder("inputs") / "base_strike.mkv"
    parent = running(tmp_path / "run.py", script, str(clip))
    family = psutil.Process(parent.pid)
    try:
        # one of multiprocessing's helpers may be a child, too
        assert wait_until(lambda: len(family.children()) >= 2, 60.0)
        if script == TASKS:
            assert wait_until(lambda: len(list(tmp_path.iterdir())) >= 3, 60.0)
        else:
            # past the imports, at work on the clip
            assert wait_until(lambda: min(map(cpu_seconds, family.children())) > 1.5, 90.0)
        children = family.children()
    finally:
        parent.kill()
        parent.wait()
    assert wait_until(lambda: not any(one.is_running() for one in children), 5.0)


def test_workers_end_while_they_still_import(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text(
        "import multiprocessing, time\nfrom pathlib import Path\n"
        "if multiprocessing.parent_process():\n    Path('began').touch()\n    time.sleep(600)\n"
        "def task(one):\n    return one\n"
    )
    script = (
        "from pipelines.measure.commands import run_tasks\nif __name__ == '__main__':\n"
        "    from slow import task\n    print(*run_tasks(task, [1], 1))\n"
    )
    parent = running(tmp_path / "run.py", script)
    try:
        assert wait_until((tmp_path / "began").exists, 90.0)
        children = psutil.Process(parent.pid).children()
    finally:
        parent.kill()
        parent.wait()
    assert wait_until(lambda: not any(one.is_running() for one in children), 5.0)


@pytest.mark.parametrize("command", ["measure", "campaign", "calibrate", "app"])
def test_a_terminated_command_has_the_exit_code_of_the_signal(command: str, tmp_path: Path) -> None:
    clip = str(shared_folder("inputs") / "base_strike.mkv")
    words = {
        "measure": ["measure", clip, clip, "--fps", "600", "--out", "out", "-j", "2"],
        "campaign": ["campaign", clip, "--fps", "600", "--out", "out", "-j", "2"],
        "calibrate": ["calibrate", clip, "--fps", "600", "--ball", "jokku", "--no-browser"],
        "app": ["app", clip, "--no-browser"],
    }[command]
    script = "from pipelines.cli import app\nif __name__ == '__main__':\n    app()\n"
    run = running(tmp_path / "run.py", script, *words)
    family = psutil.Process(run.pid)
    try:
        if command in ("calibrate", "app"):
            assert wait_until(lambda: bool(family.net_connections("inet")), 60.0)
            # threads of the page are amid native code
            time.sleep(1.5)
        else:
            assert wait_until(lambda: len(family.children(recursive=True)) >= 1, 60.0)
        time.sleep(0.5)
        children = family.children(recursive=True)
        run.send_signal(signal.SIGTERM)
        assert run.wait(timeout=60.0) == 128 + signal.SIGTERM
    finally:
        run.kill()
    assert wait_until(lambda: not any(one.is_running() for one in children), 5.0)
