"""Run a campaign: measure every clip once, on many cores or machines."""

import functools
import hashlib
import json
import os
import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from metrology import UsageError
from metrology.files import printable
from pipelines.campaign.files import clip_key
from pipelines.campaign.ledger import AttemptOutcome, Ledger, State, WorkOrder
from pipelines.campaign.results import LabBookRow, Matched
from pipelines.campaign.worker import ClipWorkerDied, Request, WorkerProcess

__all__ = ["CLIP_SUFFIXES", "Crew", "RunOptions", "RunPlan", "find_clips", "local_crew", "run"]

CLIP_SUFFIXES = (".mp4", ".mov", ".avi", ".mkv", ".m4v", ".webm", ".gif", ".mpg", ".mpeg", ".mts")
MAX_ATTEMPTS = 2
"""A clip that ends its worker twice fails: once may be the machine's fault (chosen)."""
_CLIPS_PER_WORKER = 2
"""One being measured and one queued, so that no worker waits for the coordinator."""
_CREW_CHECK_S = 1.0
"""s: idle time after which the crew is checked for lost tasks (chosen)."""
_PAUSE_S_PER_WORKER, _MAX_PAUSE_S = 1e-4, 0.1
"""s: clips that end within this time share one transaction and one round of submissions (chosen:
each worker has its next clip already, which takes longer)."""


_END_PAUSE_S = 0.05
"""s: between two rounds of ending workers (chosen)."""


@dataclass(frozen=True)
class RunOptions:
    """How clips are measured.

    Attributes
    ----------
    fps, ball, wall_grid : str or None
        As typed; the lab book's ball overrides `ball`.
    timeout_s : float
        Time limit per clip, s.
    joint_rate : tuple or None
        As of `Request`.
    memory_bytes : int
        Memory limit per worker.
    command : tuple of str or None
        Worker command instead of the package's own.
    """

    setup: Path | None = None
    fps: str | None = None
    ball: str | None = None
    wall_grid: str | None = None
    timeout_s: float = 900.0
    joint_rate: tuple[float, float, str] | None = None
    memory_bytes: int = 4 * 2**30
    command: tuple[str, ...] | None = None


@dataclass(frozen=True)
class RunPlan:
    """Work of one run.

    Attributes
    ----------
    folder : Path
        Of the campaign.
    purpose : str
        What it is for, if not for the results; shown beside the progress.
    """

    folder: Path
    options: RunOptions
    matched: Matched
    version: str
    purpose: str = ""

    def order(self, clip: Path, sha256: str, ball_at: str | None = None) -> WorkOrder:
        """Build the work order of a clip; `ball_at` is a point on the ball given by the user."""
        digest = _digest(self.options, self.matched.strikes[clip], ball_at)
        path = str(clip.resolve()).encode("utf-8", "backslashreplace").decode()
        return WorkOrder(clip_key(clip), path, sha256, digest, self.version)

    def request(self, clip: Path, ball_at: str | None = None) -> Request:
        """Build the request to the worker."""
        strike, options = self.matched.strikes[clip], self.options
        return Request(
            path=str(clip.resolve()),
            setup=None if options.setup is None else _resolved(options.setup),
            fps=options.fps,
            ball=_ball(options, strike),
            wall_grid=options.wall_grid,
            ball_at=ball_at,
            joint_rate=options.joint_rate,
            tracks=os.path.join(_resolved(self.folder), "tracks", f"{clip_key(clip)}.csv"),
            picture=os.path.join(_resolved(self.folder), "frames", f"{clip_key(clip)}.jpg"),
        )


@functools.lru_cache(maxsize=16)
def _resolved(path: Path) -> str:
    return str(path.resolve())


def _ball(options: RunOptions, strike: LabBookRow | None) -> str | None:
    return strike.ball if strike is not None and strike.ball is not None else options.ball


def _digest(options: RunOptions, strike: LabBookRow | None, ball_at: str | None) -> str:
    """Digest of all inputs of a result besides clip and version."""
    setup = b"" if options.setup is None else options.setup.read_bytes()
    parts: tuple[str | None, ...] = (options.fps, _ball(options, strike), options.wall_grid)
    if ball_at is not None:
        parts = (*parts, ball_at)
    if options.joint_rate is not None:
        parts = (*parts, repr(options.joint_rate))
    return hashlib.sha256(setup + repr(parts).encode()).hexdigest()


def find_clips(given: Sequence[Path]) -> tuple[Path, ...]:
    """Clips among files and folders, in the order given and by name within a folder.

    Raises
    ------
    UsageError
        If a path does not exist, or no clip is found.
    """
    clips: list[Path] = []
    for path in given:
        if path.is_dir():
            clips += sorted(
                file
                for file in path.iterdir()
                if file.suffix.lower() in CLIP_SUFFIXES and not file.name.startswith(".")
            )
        elif path.exists():
            clips.append(path)
        else:
            raise UsageError(
                f"there is no clip or folder {path}",
                hint="Check the path: pass clips, or a folder that contains them.",
            )
    unique = list(dict.fromkeys(clips))
    if not unique:
        raise UsageError(
            "there is no clip in " + ", ".join(str(path) for path in given),
            hint=f"Clips have the endings {', '.join(CLIP_SUFFIXES)}.",
        )
    return tuple(unique)


class Crew(Protocol):
    """A set of workers: local processes or a cluster."""

    size: int

    def submit(self, request: Request) -> "Future[dict[str, Any]]":
        """Start to measure a clip; the future holds the answer of `measure_in_worker`."""
        ...

    def settle_lost(self) -> None:
        """Settle the futures of lost tasks; called while idle."""
        ...


_OWN_THREAD = threading.local()


def measure_in_worker(request: Request, options: RunOptions) -> dict[str, Any]:
    """Measure a clip in this thread's worker process; also called by a cluster's workers.

    Returns
    -------
    dict
        As `worker.answer`, its document as text; ``{"died": …}`` if the worker ended, hung or
        exceeded its memory limit.
    """
    process: WorkerProcess | None = getattr(_OWN_THREAD, "worker", None)
    if process is None:
        process = WorkerProcess(options.timeout_s, options.memory_bytes, options.command)
        _OWN_THREAD.worker = process
        with _STARTED_LOCK:
            _STARTED.append(process)
    try:
        reply = process.ask(request)
        if reply.get("document") is not None:
            reply["document"] = json.dumps(reply["document"])
        return reply
    except ClipWorkerDied as problem:
        return {"died": str(problem)}


_STARTED: list[WorkerProcess] = []
_STARTED_LOCK = threading.Lock()


def _end_workers() -> None:
    with _STARTED_LOCK:
        for process in _STARTED:
            process.close()


class _LocalCrew:
    """Threads of this process, each with its own worker process."""

    def __init__(self, pool: ThreadPoolExecutor, options: RunOptions, size: int) -> None:
        self._pool, self._options, self.size = pool, options, size
        self._pending: set[Future[dict[str, Any]]] = set()

    def submit(self, request: Request) -> "Future[dict[str, Any]]":
        future = self._pool.submit(measure_in_worker, request, self._options)
        self._pending.add(future)
        future.add_done_callback(self._pending.discard)
        return future

    def settle_lost(self) -> None:
        """A thread settles its futures itself."""

    def end(self) -> None:
        """End all workers, even in the middle of a clip: the ledger has the clip measured again."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        while wait(tuple(self._pending), timeout=0.0).not_done:
            # a thread may start a worker after the first round
            _end_workers()
            time.sleep(_END_PAUSE_S)
        self._pool.shutdown()
        _end_workers()


@contextmanager
def local_crew(jobs: int, options: RunOptions) -> Iterator[Crew]:
    """Workers on this machine: `jobs` threads, each with a worker process."""
    crew = _LocalCrew(ThreadPoolExecutor(jobs), options, jobs)
    try:
        yield crew
    finally:
        crew.end()


class _DaskCrew:
    """Workers of a Dask cluster, each with its own process."""

    def __init__(self, client: Any, options: RunOptions, size: int) -> None:
        self._client, self._options, self.size = client, options, size
        self._under_way: dict[Future[dict[str, Any]], Any] = {}
        self._lock = threading.Lock()

    def submit(self, request: Request) -> "Future[dict[str, Any]]":
        answered: Future[dict[str, Any]] = Future()
        task = self._client.submit(
            measure_in_worker,
            request,
            self._options,
            pure=False,
            retries=0,
        )
        with self._lock:
            self._under_way[answered] = task
        task.add_done_callback(lambda done: self._hand_on(done, answered))
        return answered

    def settle_lost(self) -> None:
        """Settle tasks lost with their scheduler: their callbacks are never called."""
        gone = self._client.status not in ("running", "connecting")
        with self._lock:
            lost = [
                answered
                for answered, task in self._under_way.items()
                if gone or task.status in ("cancelled", "lost")
            ]
        for answered in lost:
            self._settle(answered, {"lost": "the cluster is gone"})

    def _hand_on(self, task: Any, answered: "Future[dict[str, Any]]") -> None:
        try:
            reply = task.result()
        except CancelledError:
            # the client cancels all tasks when its scheduler goes away
            reply = {"lost": "the cluster is gone"}
        except Exception as problem:  # a lost cluster worker raises various types
            reply = {"died": f"its worker was lost ({type(problem).__name__})"}
        finally:
            task.release()
        self._settle(answered, reply)

    def _settle(self, answered: "Future[dict[str, Any]]", reply: dict[str, Any]) -> None:
        with self._lock:
            first = self._under_way.pop(answered, None) is not None
        if first:
            answered.set_result(reply)


_CONNECT_TIMEOUT_S = 20.0
"""s (chosen)."""


@contextmanager
def cluster_crew(address: str, options: RunOptions) -> Iterator[Crew]:
    """Workers of a Dask cluster; clips and folder must have the same paths there.

    Raises
    ------
    UsageError
        If Dask is not installed, no scheduler answers at `address`, or it has no workers.
    """
    try:
        from distributed import Client
    except ImportError as problem:
        raise UsageError(
            f"--dask {address} needs the package distributed, which is not installed",
            hint="pip install 'impact-vision[cluster]', or omit --dask to use this machine.",
        ) from problem

    try:
        client: Any = Client(address, timeout=_CONNECT_TIMEOUT_S)  # type: ignore[no-untyped-call]
    except (OSError, TimeoutError, ValueError) as problem:
        raise UsageError(
            f"no Dask scheduler answers at {address}: {problem}",
            hint="Start one with `dask scheduler`, or omit --dask to use this machine.",
        ) from problem
    with client:
        threads = sum(client.nthreads().values())
        if threads == 0:
            raise UsageError(
                f"the cluster at {address} has no workers",
                hint=f"Start some with `dask worker {address}`.",
            )
        yield _DaskCrew(client, options, threads)


@dataclass
class Progress:
    """Progress of a run.

    Attributes
    ----------
    again : dict of str to str
        Clips measured again, and what changed.
    stopped : str or None
        Why the run ended early; unfinished clips wait for the next run.
    purpose : str
        As of `RunPlan`.
    """

    todo: int = 0
    done: int = 0
    failed: int = 0
    again: dict[str, str] = field(default_factory=dict)
    stopped: str | None = None
    purpose: str = ""


def run(
    plan: RunPlan,
    crew: Callable[[], Any],
    *,
    retry_failed: bool = False,
    only: Sequence[str] = (),
    after_each: Callable[[Progress, AttemptOutcome], None] = lambda progress, outcome: None,
) -> Progress:
    """Measure the clips that the ledger does not have yet.

    Parameters
    ----------
    crew : callable
        Returns a context manager of a `Crew`; entered only if there is work.
    only : sequence of str
        Names of clips to measure; the others keep waiting.
    after_each : callable
        Called after each clip with the progress and the result.
    """
    (plan.folder / "tracks").mkdir(parents=True, exist_ok=True)
    (plan.folder / "frames").mkdir(exist_ok=True)
    paths = {clip_key(clip): clip for clip in plan.matched.strikes}
    with Ledger(plan.folder) as ledger:
        points = ledger.points()
        orders = [plan.order(clip, _sha256(clip), points.get(name)) for name, clip in paths.items()]
        again = ledger.plan(orders, retry_failed=retry_failed)
        names = [name for name in ledger.waiting() if name in paths and (not only or name in only)]
        progress = Progress(todo=len(names), again=again, purpose=plan.purpose)
        if names:
            with crew() as hands:
                _work(plan, ledger, hands, paths, names, progress, after_each)
    return progress


@dataclass(frozen=True)
class _Try:
    """A submitted clip: its future, how often it ended its worker, when it began."""

    future: Future[dict[str, Any]]
    deaths: int
    began: float


def _work(
    plan: RunPlan,
    ledger: Ledger,
    crew: Crew,
    paths: dict[str, Path],
    todo: Sequence[str],
    progress: Progress,
    after_each: Callable[[Progress, AttemptOutcome], None],
) -> None:
    """Keep the crew busy with a window of clips, so that memory does not grow with their number.

    All clips that begin or end at about the same time share one transaction of the ledger.
    """
    answered: queue.SimpleQueue[str] = queue.SimpleQueue()
    pending: dict[str, _Try] = {}
    left = list(reversed(todo))
    points = ledger.points()
    while left or pending:
        if progress.stopped is not None:
            left.clear()
        room = _CLIPS_PER_WORKER * crew.size - len(pending)
        batch = [left.pop() for _ in range(min(room, len(left)))]
        deaths = ledger.begin(batch) if batch else {}
        for name in batch:
            future = crew.submit(plan.request(paths[name], points.get(name)))
            pending[name] = _Try(future, deaths[name], time.monotonic())
            future.add_done_callback(functools.partial(_announce, answered, name))
        names = _drained(answered, crew, min(_MAX_PAUSE_S, _PAUSE_S_PER_WORKER * crew.size))
        outcomes = [_outcome(name, pending.pop(name)) for name in names]
        ledger.finish(outcomes)
        for outcome in outcomes:
            if outcome.state == State.WAITING:
                if outcome.died:
                    left.append(outcome.clip)
                else:
                    progress.stopped = outcome.error
                continue
            progress.done += outcome.state == State.DONE
            progress.failed += outcome.state == State.FAILED
            after_each(progress, outcome)


def _announce(answered: "queue.SimpleQueue[str]", name: str, _: object) -> None:
    answered.put(name)


def _drained(answered: "queue.SimpleQueue[str]", crew: Crew, pause_s: float) -> list[str]:
    """Wait for one name, then collect all that arrive within a short pause."""
    names: list[str] = []
    while not names:
        try:
            names = [answered.get(timeout=_CREW_CHECK_S)]
        except queue.Empty:
            crew.settle_lost()
    time.sleep(pause_s)
    while not answered.empty():
        names.append(answered.get())
    return names


def _outcome(clip: str, tried: _Try) -> AttemptOutcome:
    reply, deaths = tried.future.result(), tried.deaths
    seconds = float(reply.get("seconds", time.monotonic() - tried.began))
    if "lost" in reply:
        return AttemptOutcome(clip, State.WAITING, seconds, error=reply["lost"])
    if "died" in reply:
        again = deaths + 1 < MAX_ATTEMPTS
        why = f"{reply['died']}, {'once' if again else f'{deaths + 1} times'}"
        state = State.WAITING if again else State.FAILED
        return AttemptOutcome(clip, state, seconds, error=why, died=True)
    error = None if reply.get("error") is None else printable(reply["error"])
    state = State.DONE if error is None else State.FAILED
    return AttemptOutcome(clip, state, seconds, reply.get("document"), error)


def _sha256(clip: Path) -> str:
    """Digest of a clip's bytes, or of a folder's image files; of nothing if missing."""
    digest = hashlib.sha256()
    for path in sorted(clip.iterdir()) if clip.is_dir() else [clip]:
        try:
            # Opening a pipe would wait for its writer; the worker refuses it by name.
            if not path.is_file():
                return "unreadable"
            with path.open("rb") as file:
                while block := file.read(2**20):
                    digest.update(block)
        except OSError:
            # the worker reports the error when it can't read the file either
            return "unreadable"
    return digest.hexdigest()


def cores() -> int:
    """Number of processes by default."""
    return max(1, len(os.sched_getaffinity(0)))
