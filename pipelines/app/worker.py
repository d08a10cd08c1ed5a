"""Measure clips in a separate process, with progress; the newest task counts."""

import sys
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from threading import RLock, Thread
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from measuring.chain import MeasureOptions, measure_clip
from metrology import ImpactVisionError, NotFoundError
from metrology.kept import KeptResults
from pipelines.processes import PipedProcess
from vision.stages import candidate_table, detect, given_objects, link

if TYPE_CHECKING:
    import pandas as pd

    from measuring.measurement import ClipMeasurement
    from vision.finding.selection import FoundObjects

__all__ = ["ClipAnswer", "Measurer", "Task"]


@dataclass(frozen=True)
class Task:
    """A clip to measure.

    Attributes
    ----------
    number : int
        Increasing.
    corrected : DataFrame or None
        Tracklets in place of those found.
    """

    number: int
    clip: Path
    options: MeasureOptions
    corrected: "pd.DataFrame | None" = None


@dataclass(frozen=True)
class ClipAnswer:
    """What the process reports.

    Attributes
    ----------
    number : int
        Of the task.
    step : str
        What is being done.
    part : float
        Completed fraction of it.
    candidates : DataFrame or None
        Tracklets found, also before the end and where none could be measured.
    problem : str
        Why nothing was measured.
    """

    number: int
    step: str = ""
    part: float = 0.0
    measured: "ClipMeasurement | None" = None
    candidates: "pd.DataFrame | None" = None
    problem: str = ""
    done: bool = True


class Measurer:
    """A process that measures; it starts with the first task and stays ready for the next.

    Parameters
    ----------
    on_answer : callable
        Called on a thread with each `ClipAnswer` to the newest task.
    """

    def __init__(self, on_answer: Callable[[ClipAnswer], None]) -> None:
        self._on_answer = on_answer
        self._lock = RLock()
        self._process: PipedProcess | None = None
        self._number = 0

    def start(self) -> None:
        """Start the process, so that the first task need not wait for it."""
        with self._lock:
            if self._process is not None:
                return
            self._process = PipedProcess(_serve)
            Thread(target=self._listen, args=(self._process,), daemon=True).start()

    def measure(
        self, clip: Path, options: MeasureOptions, corrected: "pd.DataFrame | None" = None
    ) -> int:
        """Measure a clip instead of what is being measured; return the task's number."""
        with self._lock:
            self.start()
            self._number += 1
            task = Task(self._number, clip, options, corrected)
            assert self._process is not None
            self._process.send(task)
            return task.number

    def stop(self) -> None:
        """Abandon the task, if there is one."""
        with self._lock:
            self._number += 1
            if self._process is not None:
                # the thread that listens has nothing to report of this one
                process, self._process = self._process, None
                process.end()

    def _listen(self, process: PipedProcess) -> None:
        while True:
            try:
                answer = process.pipe.recv()
            except (EOFError, OSError):
                break
            self._pass_on(answer)
        with self._lock:
            if process is not self._process:
                return
            # a process whose pipe has closed may still count as alive for a moment
            self._process, number = None, self._number
        problem = "The measuring process ended unexpectedly. Measure again."
        self._pass_on(ClipAnswer(number, problem=problem))

    def _pass_on(self, answer: ClipAnswer) -> None:
        if answer.number == self._number:
            self._on_answer(answer)


class _Superseded(Exception):
    """A newer task has arrived."""


def _serve(pipe: Connection) -> None:
    """Answer tasks until the other end of the pipe is closed."""
    kept = KeptResults()
    with suppress(EOFError, OSError):
        while True:
            task = pipe.recv()
            while pipe.poll():
                task = pipe.recv()
            with suppress(_Superseded):
                pipe.send(_answer(task, pipe, kept))


def _answer(task: Task, pipe: Connection, kept: KeptResults) -> ClipAnswer:
    def tell(step: str, part: float) -> None:
        if pipe.poll():
            raise _Superseded
        pipe.send(ClipAnswer(task.number, step, part, done=False))

    def show(found: "FoundObjects", shifts: Mapping[int, NDArray[np.float64]]) -> None:
        table = candidate_table(found)
        # places in the frames of a camera that moves
        away = [shifts.get(at, np.zeros(2)) for at in table["frame"]]
        table[["x_px", "y_px"]] += np.reshape(away, (-1, 2))
        pipe.send(ClipAnswer(task.number, candidates=table, done=False))

    kept.watch = show
    try:
        return measured_answer(task, tell, kept)
    except ImpactVisionError as problem:
        return ClipAnswer(task.number, problem=problem.in_one_line)
    except (OSError, MemoryError) as problem:
        return ClipAnswer(task.number, problem=f"The clip can't be measured: {problem}.")
    except (_Superseded, EOFError):
        raise
    except Exception as problem:  # a bug: the page stays usable, the terminal has the details
        traceback.print_exc(file=sys.stderr)
        said = f"A defect of this program stopped the measurement ({type(problem).__name__})."
        return ClipAnswer(task.number, problem=f"{said} Please report the text in the terminal.")


def measured_answer(
    task: Task, tell: Callable[[str, float], None], kept: KeptResults | None = None
) -> ClipAnswer:
    """Measure a task's clip; where no ball is found, the answer holds what was.

    Raises
    ------
    ImpactVisionError
        If the clip can't be read or the input is invalid.
    """
    options = task.options
    if task.corrected is not None:
        options = replace(options, corrected=given_objects(task.corrected))
    try:
        measured = measure_clip(task.clip, options, tell, kept)
    except NotFoundError as problem:
        seen = detect(task.clip)
        linked = link(seen).assign(measured=0, probability=0.0) if len(seen) else None
        return ClipAnswer(task.number, candidates=linked, problem=problem.in_one_line)
    found = measured.tracks.found
    candidates = None if found is None else candidate_table(found)
    return ClipAnswer(task.number, measured=measured, candidates=candidates)
