"""`vision measure CLIP… --out DIR -j N`: a folder of results that grows clip by clip."""

import csv
import hashlib
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from metrology import ImpactVisionError, UsageError, write_text_whole
from pipelines.batch.workers import WorkerDied, run_tasks
from pipelines.measure.chain import MeasureOptions, measure_clip
from pipelines.measure.files.output import harmless, measurement_as_row, software_version
from pipelines.measure.files.wanted import Wanted
from pipelines.report.labels import quantity_label, quantity_text

__all__ = ["Done", "Folder", "Job", "files_of", "measure_all"]

_TOLD = ("contact_time", "ball_speed", "cor")


@dataclass(frozen=True)
class Job:
    """One clip to measure, and where its files go."""

    clip: Path
    options: MeasureOptions
    wanted: Wanted
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


def files_of(out: Path, clips: Sequence[Path], wanted: Wanted) -> dict[Path, Wanted]:
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
