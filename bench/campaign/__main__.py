"""What a campaign must reach: a law that holds, nothing lost, scaling, memory.

``python -m bench.campaign [--quick] [--rows coverage kills scheduler] [--filmed FOLDER]`` prints
the table as markdown; with a folder that ``bench.campaign.filmed`` filled, what its clips say, too.
Laws are judged on campaigns drawn from the paper's law with strikes, sessions and shared inputs
that scatter; the scheduler with a crew that only waits as long as clips were measured to take.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from heapq import heappop, heappush
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaign.filmed import Laboratory, judged, scaling
from pipelines.campaign.analysis import CorPoints, fit_cor_laws
from pipelines.campaign.ledger import Ledger, State, WorkOrder
from pipelines.campaign.results import Matched
from pipelines.campaign.run import Progress, RunOptions, RunPlan, _work
from pipelines.campaign.worker import Request
from pipelines.setup.cor_file import LawKind

BALLS = {
    # a, b, d of Eqs 24 and 25 with c taken into a
    "jokku": (0.1305 * np.exp(-0.1953), 0.2685, 0.6746),
    "basketball": (0.1305 * np.exp(-0.1953), 0.2685, 0.8246),
}
SPEEDS = np.array([1.1, 1.6, 2.2, 2.7, 3.1, 3.5, 3.8, 4.0])


def law(parameters: tuple[float, float, float], speed: np.ndarray) -> np.ndarray:
    """Exponential law."""
    a, b, d = parameters
    return a * np.exp(-b * speed) + d


def coverage(campaigns: int, seed: int) -> list[str]:
    """How often the stated 95 % intervals hold the law and its parameters."""
    rng = np.random.default_rng(seed)
    curve, parameters, following = [], [], []
    for _ in range(campaigns):
        truth = BALLS[("jokku", "basketball")[rng.integers(2)]]
        repeats, sessions = rng.integers(2, 6), rng.integers(1, 5)
        speed = np.repeat(SPEEDS, repeats) * (1 + 0.01 * rng.standard_normal(8 * repeats))
        session = rng.integers(sessions, size=len(speed))
        strike, between = rng.uniform(0.002, 0.01), rng.uniform(0.0, 0.006)
        std, shared = rng.uniform(0.003, 0.012), rng.uniform(0.0, 0.01)
        cor = law(truth, speed) + shared * rng.standard_normal()
        cor += rng.normal(0, np.hypot(strike, std), len(speed))
        cor += rng.normal(0, between, sessions)[session]
        points = CorPoints(
            speed,
            cor,
            np.full(len(speed), std),
            np.full((len(speed), 1), shared),
            np.unique(session, return_inverse=True)[1],
        )
        fit = {one.law: one for one in fit_cor_laws(points)}[LawKind.EXPONENTIAL]
        for name, value in zip("abd", truth, strict=True):
            parameters.append(fit.parameters[name].low <= value <= fit.parameters[name].high)
        for at in (1.3, 2.5, 3.7):
            found, value = fit.at(at), float(law(truth, np.array(at)))
            curve.append(found.low <= value <= found.high)
            seen = value + rng.normal(0, np.hypot(strike, between))
            band = fit.next_strike(at)
            following.append(band.low <= seen <= band.high)
    return [
        f"| law within its 95 % band ({campaigns} campaigns) | 88–99 % | {np.mean(curve):.1%} |",
        f"| intervals of the law's parameters | 88–99 % | {np.mean(parameters):.1%} |",
        f"| next strike within its prediction band | 88–99 % | {np.mean(following):.1%} |",
    ]


class WaitingCrew:
    """Workers that take as long as a clip and do nothing; one thread keeps all their clocks."""

    def __init__(self, size: int, seconds: Sequence[float], faster: float) -> None:
        self.size, self._seconds, self._faster = size, seconds, faster
        self._free = [0.0] * size
        self._due: list[tuple[float, int, Future[dict[str, Any]]]] = []
        self._count = 0
        self._change = threading.Condition()
        threading.Thread(target=self._serve, daemon=True).start()

    def submit(self, request: Request) -> "Future[dict[str, Any]]":
        """Begin on the worker that is free first."""
        future: Future[dict[str, Any]] = Future()
        with self._change:
            length = self._seconds[self._count % len(self._seconds)] / self._faster
            start = max(heappop(self._free), time.monotonic())
            heappush(self._free, start + length)
            heappush(self._due, (start + length, self._count, future))
            self._count += 1
            self._change.notify()
        return future

    def look_after(self) -> None:
        """Nothing goes away here."""

    def _serve(self) -> None:
        while True:
            with self._change:
                while not self._due or self._due[0][0] > time.monotonic():
                    wait = None if not self._due else max(0.0, self._due[0][0] - time.monotonic())
                    self._change.wait(wait)
                _, _, future = heappop(self._due)
            future.set_result({"document": TEXT, "seconds": 1.0})


DOCUMENT = {
    "quantities": {f"quantity_{i}": {"value": 1.0, "std": 0.1, "unit": "m"} for i in range(20)},
    "budget": {f"quantity_{i}": [{"source": "x", "std": 0.1}] * 12 for i in range(20)},
    "warnings": [],
}
"""As large as the document of a real clip, about 20 kB."""
TEXT = json.dumps(DOCUMENT)
"""As a worker hands it over."""


def scheduler(clips: int, workers: int, seconds: Sequence[float]) -> list[str]:
    """Time over what `workers` would need without a coordinator, and its memory."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        paths = {f"{i}.mp4": Path(f"{i}.mp4") for i in range(clips)}
        plan = RunPlan(out, RunOptions(), Matched(dict.fromkeys(paths.values())), "1")
        crew = WaitingCrew(workers, seconds, 1.0)
        with Ledger(out) as ledger:
            orders = [WorkOrder(name, name, "0", "0", "1") for name in paths]
            ledger.plan(orders, retry_failed=False)
            began = time.monotonic()
            _work(plan, ledger, crew, paths, ledger.waiting(), Progress(), lambda *_: None)
            took = time.monotonic() - began
            done = ledger.counts()[State.DONE]
    alone = clips * float(np.mean(seconds)) / workers
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return [
        f"| {workers} simulated workers, {clips:,} clips of {np.mean(seconds):.1f} s:"
        f" scheduler's share | 20 % | {max(0.0, took / alone - 1):.1%} ({done:,} done) |",
        f"| memory of the coordinator | 1 GB | {memory:.0f} MB |",
    ]


def kills(number: int) -> list[str]:
    """Run the slow test that kills a campaign `number` times and counts what is lost."""
    name = "test_killed_at_random_moments_nothing_is_lost_and_nothing_done_twice"
    test = f"tests/pipelines/campaign/test_run.py::{name}"
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-m", "slow or not slow", f"{test}[{number}]"],
        capture_output=True,
        text=True,
        check=False,
    )
    said = "0; 0" if ran.returncode == 0 else ran.stdout[-300:]
    return [f"| killed (−9) at {number} random moments: clips lost; done twice | 0; 0 | {said} |"]


ROWS: dict[str, Callable[[argparse.Namespace], list[str]]] = {
    "coverage": lambda given: coverage(10 if given.quick else 50, given.seed),
    "kills": lambda given: kills(1 if given.quick else 30),
    "scheduler": lambda given: scheduler(10_000 if given.quick else 100_000, 1000, given.seconds),
}
"""Parts that can be run one by one."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.campaign", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of everything")
    parser.add_argument("--rows", nargs="+", choices=[*ROWS], default=[*ROWS], help="only these")
    parser.add_argument("--seed", type=int, default=12)
    parser.add_argument(
        "--seconds", type=float, nargs="+", default=[3.0], help="measured times of clips"
    )
    parser.add_argument("--filmed", type=Path, help="folder of bench.campaign.filmed, run before")
    given = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    print("| | at least | measured |\n|---|---|---|")
    for name in given.rows:
        for line in ROWS[name](given):
            print(line, flush=True)
    if given.filmed is not None:
        lab = Laboratory(given.filmed)
        for line in [*judged(lab, given.filmed / "campaign"), *scaling(lab)]:
            print(line, flush=True)


if __name__ == "__main__":
    main()
