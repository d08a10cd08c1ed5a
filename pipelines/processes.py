"""Begin worker processes, end them with their parent; raise at SIGTERM."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import ForkingPickler
from types import FrameType
from typing import Any

__all__ = ["ONE_THREAD", "PipedProcess", "Terminated", "raise_when_terminated"]

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of a worker: the others already use all cores."""


# Forked copies of the threads of OpenCV, BLAS and servers hang; a fresh interpreter does not.
_FRESH = multiprocessing.get_context("spawn")


class PipedProcess:
    """A fresh process with a pipe to it.

    Parameters
    ----------
    serve : callable
        Runs in the process, which ends with its parent, with the other end of the pipe and `more`.
    """

    def __init__(self, serve: Callable[..., None], *more: Any) -> None:
        self.pipe, theirs = _FRESH.Pipe()
        # in bytes: what they import is imported after the parent is watched
        task = bytes(ForkingPickler.dumps((serve, more)))
        self.process = _FRESH.Process(target=_begin, args=(theirs, task), daemon=True)
        self.process.start()
        theirs.close()

    def send(self, task: Any) -> None:
        """Send a task; a dead process is noticed when its answer is read."""
        with suppress(OSError):
            self.pipe.send(task)

    def end(self) -> None:
        """Terminate the process."""
        self.process.terminate()
        self.process.join()


class Terminated(KeyboardInterrupt):
    """The program was asked to end by SIGTERM."""


def raise_when_terminated() -> None:
    """Raise `Terminated` at SIGTERM, so that the program tidies up as after Ctrl-C."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise Terminated

    signal.signal(signal.SIGTERM, stop)


def _begin(pipe: Connection, task: bytes) -> None:
    _begin_worker()
    serve, more = ForkingPickler.loads(task)
    serve(pipe, *more)


def _begin_worker() -> None:
    """Prepare this process of `multiprocessing`: one thread, and it ends with its parent.

    A killed parent can't end its workers, and a worker notices it only after its task.
    """
    # Ctrl-C reaches every process of the terminal; the parent decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)
    parent = parent_process()
    if parent is None:
        return

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
