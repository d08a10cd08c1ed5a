"""Work behind the page: one piece after another, so that the page never waits and never races."""

from collections import deque
from collections.abc import Callable
from threading import Lock, Thread

from metrology import ImpactVisionError

__all__ = ["Jobs"]


class Jobs:
    """Pieces of work done in the order they come in, on a thread that ends with the program.

    Attributes
    ----------
    problem : str
        Why the last piece did not succeed; empty if it did.
    revision : int
        Grows whenever something begins or ends.
    """

    def __init__(self) -> None:
        self.problem = ""
        self.revision = 0
        self._lock = Lock()
        self._waiting: deque[tuple[str, Callable[[], object]]] = deque()
        self._thread: Thread | None = None
        self._now = ""

    @property
    def busy(self) -> str:
        """What is being done, empty if nothing is."""
        with self._lock:
            return self._now or (self._waiting[0][0] if self._waiting else "")

    def submit(self, label: str, job: Callable[[], object]) -> None:
        """Do `job` when all before it is done; errors raised on purpose end up in `problem`."""
        with self._lock:
            self._waiting.append((label, job))
            self.revision += 1
            if self._thread is None:
                self._thread = Thread(target=self._work, daemon=True)
                self._thread.start()

    def _work(self) -> None:
        try:
            while (job := self._next()) is not None:
                try:
                    job()
                    self.problem = ""
                except ImpactVisionError as problem:
                    self.problem = problem.in_one_line
        finally:
            # also where a bug ends the thread: the next piece starts another
            with self._lock:
                self._thread, self._now = None, ""
                self.revision += 1

    def _next(self) -> Callable[[], object] | None:
        with self._lock:
            self.revision += 1
            if not self._waiting:
                # nobody may believe the thread alive once it has seen that nothing waits
                self._thread, self._now = None, ""
                return None
            self._now, job = self._waiting.popleft()
            return job
