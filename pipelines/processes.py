"""End workers with the program that started them; raise at SIGTERM."""

import os
import signal
import threading
from multiprocessing import parent_process
from multiprocessing.connection import wait
from types import FrameType

__all__ = ["Terminated", "end_with_parent", "raise_when_terminated"]


class Terminated(KeyboardInterrupt):
    """The program was asked to end by SIGTERM."""


def raise_when_terminated() -> None:
    """Raise `Terminated` at SIGTERM, so that the program tidies up as after Ctrl-C."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise Terminated

    signal.signal(signal.SIGTERM, stop)


def end_with_parent() -> None:
    """End this process of `multiprocessing` as soon as the one that started it is gone.

    A killed parent can't end its workers, and a worker notices it only after its task.
    """
    parent = parent_process()
    if parent is None:
        return

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
