"""Run tasks in processes until done, out of time or stopped by the user."""

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

__all__ = ["Stop", "run_until"]

Task = TypeVar("Task")
Result = TypeVar("Result")


class Stop:
    """Stop condition: after `minutes`, or at the first Ctrl-C or SIGTERM."""

    def __init__(self, minutes: float | None = None) -> None:
        self._end = None if minutes is None else time.monotonic() + 60.0 * minutes
        self._asked = False

    @property
    def now(self) -> bool:
        """Whether to stop."""
        return self._asked or (self._end is not None and time.monotonic() > self._end)

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Treat the first signal as a request to stop; the second one ends the process."""
        before = {s: signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)}

        def ask(number: int, _frame: FrameType | None) -> None:
            self._asked = True
            signal.signal(number, before[signal.Signals(number)])

        for number in before:
            signal.signal(number, ask)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def _deaf() -> None:
    # Ctrl-C reaches every process of the group; workers finish their task.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_until(
    stop: Stop, work: Callable[[Task], Result], tasks: Sequence[Task], jobs: int
) -> list[Result | None]:
    """Run tasks in order in `jobs` processes; tasks not started before the stop give None.

    Parameters
    ----------
    work : callable
        Must be importable by the workers.

    Returns
    -------
    list
        One entry per task.
    """
    results: list[Result | None] = [None] * len(tasks)
    with stop.listening(), ProcessPoolExecutor(jobs, initializer=_deaf) as pool:
        running: dict[Future[Result], int] = {}
        ahead = iter(enumerate(tasks))
        while True:
            while len(running) < jobs and not stop.now:
                following = next(ahead, None)
                if following is None:
                    break
                running[pool.submit(work, following[1])] = following[0]
            if not running:
                return results
            finished, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                results[running.pop(future)] = future.result()
