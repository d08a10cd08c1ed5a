"""Tasks shared out to processes: one that crashes loses its task only, and all end at once."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

__all__ = ["WorkerDied", "run_tasks"]

Task = TypeVar("Task")
Result = TypeVar("Result")

# Forked copies of OpenCV's and BLAS' threads hang; a fresh interpreter does not.
_FRESH = multiprocessing.get_context("spawn")
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class WorkerDied(Exception):
    """The process ended while it had the task."""


class _Worker(Generic[Task]):
    """A process with the pipe to it, and the task it is at."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.pipe, theirs = _FRESH.Pipe()
        self.task: Task | None = None
        self.process = _FRESH.Process(target=_serve, args=(theirs, function), daemon=True)
        self.process.start()
        theirs.close()

    def give(self, task: Task) -> None:
        """Hand over a task; one that has died meanwhile is noticed when it should answer."""
        self.task = task
        with suppress(OSError):
            self.pipe.send(task)

    def end(self) -> None:
        """End it, whatever it is at."""
        self.process.terminate()
        self.process.join()
        self.pipe.close()


def run_tasks(
    function: Callable[[Task], Result], tasks: Iterable[Task], workers: int
) -> Iterator[tuple[Task, Result | Exception]]:
    """Do the tasks in processes; give each with its result, or what it raised, as they finish.

    Parameters
    ----------
    function : callable
        Of a module, so that a fresh process finds it; tasks and results are pickled.
    tasks : iterable
    workers : int
        Processes at once.

    Yields
    ------
    task, result
        `WorkerDied` as the result where the process ended with the task in hand. Leaving the
        iteration, by Ctrl-C too, ends all processes.
    """
    waiting = iter(tasks)
    busy: list[_Worker[Task]] = []
    try:
        for task in waiting:
            busy.append(_started(function, task))
            if len(busy) >= max(workers, 1):
                break
        while busy:
            ready = wait([worker.pipe for worker in busy])
            for worker in [one for one in busy if one.pipe in ready]:
                done = worker.task
                assert done is not None
                alive = True
                try:
                    result = worker.pipe.recv()
                except (EOFError, OSError):
                    worker.process.join()
                    result = WorkerDied(f"its process ended with code {worker.process.exitcode}")
                    alive = False
                following = next(waiting, None)
                if following is not None and alive:
                    worker.give(following)
                else:
                    busy.remove(worker)
                    worker.end()
                    if following is not None:
                        busy.append(_started(function, following))
                yield done, result
    finally:
        for worker in busy:
            worker.end()


def _started(function: Callable[[Task], Result], task: Task) -> _Worker[Task]:
    worker: _Worker[Task] = _Worker(function)
    worker.give(task)
    return worker


def _serve(pipe: Connection, function: Callable[[Any], Any]) -> None:
    """What a worker does: answer until the other end is gone."""
    # Ctrl-C reaches every process of the terminal; only the first one decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in _ONE_THREAD:
        os.environ.setdefault(name, "1")
    with suppress(EOFError, OSError):
        while True:
            task = pipe.recv()
            try:
                answer: Any = function(task)
            except Exception as problem:  # handed to whoever asked, not swallowed
                answer = problem
            pipe.send(answer)
