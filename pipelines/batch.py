"""Many clips at once: processes that outlive crashes, and a folder of results that grows.

Tasks shared out to processes: one that crashes loses its task only, and all end at once.

`vision measure CLIP… --out DIR -j N`: a folder of results that grows clip by clip.
"""

import csv
import hashlib
import io
import json
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Generic, TypeVar

from metrology import ImpactVisionError, UsageError, write_text_whole
from pipelines.measure.chain import MeasureOptions, measure_clip
from pipelines.measure.files import (
    WantedFiles,
    harmless,
    measurement_as_row,
    software_version,
)
from pipelines.report.inputs import quantity_label, quantity_text

__all__ = ["Done", "Folder", "Job", "WorkerDied", "files_of", "measure_all", "run_tasks"]

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


_TOLD = ("contact_time", "ball_speed", "cor")


@dataclass(frozen=True)
class Job:
    """One clip to measure, and where its files go."""

    clip: Path
    options: MeasureOptions
    wanted: WantedFiles
    names: tuple[str, ...]


@dataclass(frozen=True)
class Done:
    """A clip that is measured, or why it is not."""

    clip: Path
    row: Mapping[str, object] | None
    told: str
    problem: ImpactVisionError | None = None


class Folder:
    """The results of a folder: ``results.csv``, one row a clip, and what they were made with.

    Parameters
    ----------
    out : Path
        Made where it does not exist.

    Raises
    ------
    UsageError
        If it can't be made, or holds a ``results.csv`` that is none.
    """

    def __init__(self, out: Path) -> None:
        self.out = out
        self.table = out / "results.csv"
        self._ledger = out / ".measured.json"
        try:
            out.mkdir(parents=True, exist_ok=True)
            self._rows = _read_rows(self.table)
            self._made: dict[str, str] = json.loads(_text(self._ledger) or "{}")
        except (OSError, ValueError, csv.Error) as problem:
            raise UsageError(f"can't use the folder {out}: {problem}") from problem

    def holds(self, clip: Path, digest: str) -> bool:
        """Whether the clip was measured before, from the same file and with the same options."""
        return self._made.get(str(clip)) == digest and str(clip) in self._rows

    def add(self, clip: Path, row: Mapping[str, object], digest: str) -> None:
        """Take up a row, in place of an earlier one of the clip; the table is written whole."""
        self._rows[str(clip)] = {name: _cell(cell) for name, cell in harmless(row).items()}
        self._made[str(clip)] = digest
        columns = dict.fromkeys(name for one in self._rows.values() for name in one)
        text = io.StringIO()
        writer = csv.DictWriter(text, [*columns], restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._rows.values())
        write_text_whole(self.table, text.getvalue())
        write_text_whole(self._ledger, json.dumps(self._made, indent=0))


def files_of(out: Path, clips: Sequence[Path], wanted: WantedFiles) -> dict[Path, WantedFiles]:
    """What is written for each clip: ``DIR/CLIP.json``, and ``DIR/CLIP.NAME`` for each file asked.

    Clips of one name in several folders are told apart by a number.
    """
    taken: dict[str, int] = {}
    placed = {}
    for clip in clips:
        taken[clip.stem] = taken.get(clip.stem, 0) + 1
        number = taken[clip.stem]
        stem = clip.stem if number == 1 else f"{clip.stem}-{number}"

        def beside(asked: Path | None, stem: str = stem) -> Path | None:
            return None if asked is None else out / f"{stem}.{asked.name.lstrip('.')}"

        placed[clip] = replace(
            wanted,
            csv=None,
            json=str(out / f"{stem}.json"),
            tracks=beside(wanted.tracks),
            overlay=beside(wanted.overlay),
            plot=beside(wanted.plot),
            report=beside(wanted.report),
        )
    return placed


def digest_of(clip: Path, said: Sequence[str]) -> str:
    """Of the file as it stands and of what was said."""
    about = clip.stat() if clip.exists() else None
    stamp = "" if about is None else f"{about.st_size} {about.st_mtime_ns}"
    words = "\n".join([software_version(), stamp, *said])
    return hashlib.sha256(words.encode()).hexdigest()


def measure_all(
    jobs: Sequence[Job], folder: Folder, said: Sequence[str], workers: int
) -> Iterator[Done]:
    """Measure the clips that the folder does not hold yet; give each as it finishes.

    Parameters
    ----------
    jobs : sequence of Job
    folder : Folder
        Takes up each row before it is given.
    said : sequence of str
        All options, as typed, and the setup file's text: another word means measuring again.
    workers : int
    """
    digests = {job.clip: digest_of(job.clip, said) for job in jobs}
    left = [job for job in jobs if not folder.holds(job.clip, digests[job.clip])]
    for job in jobs:
        if job not in left:
            yield Done(job.clip, {}, "measured before")
    for job, result in run_tasks(_measured, left, workers):
        if isinstance(result, ImpactVisionError):
            yield Done(job.clip, None, str(result), result)
        elif isinstance(result, WorkerDied):
            problem = ImpactVisionError(f"{job.clip}: {result}")
            yield Done(job.clip, None, str(problem), problem)
        elif isinstance(result, Exception):
            raise result
        else:
            row, told = result
            folder.add(job.clip, row, digests[job.clip])
            yield Done(job.clip, row, told)


def _measured(job: Job) -> tuple[dict[str, object], str]:
    """Measure one clip and write its files; the row, and a line to tell."""
    measured = measure_clip(job.clip, job.options)
    job.wanted.write(measured, job.clip, job.names)
    told = [
        f"{quantity_label(item.name)} {quantity_text(item)}"
        for item in measured.quantities
        if item.name in _TOLD and item.known
    ]
    return measurement_as_row(measured, job.names), ", ".join(told) or "nothing could be measured"


def _read_rows(table: Path) -> dict[str, dict[str, str]]:
    text = _text(table)
    if not text:
        return {}
    rows = [*csv.DictReader(io.StringIO(text))]
    if rows and "clip" not in rows[0]:
        raise ValueError(f"{table} is no table of results: it has no column clip")
    return {row["clip"].removeprefix("'"): row for row in rows}


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.exists() else ""


def _cell(cell: object) -> str:
    return "" if cell is None else str(cell)
