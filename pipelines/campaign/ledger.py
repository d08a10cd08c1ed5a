"""The ledger of a campaign: one row per clip, in a file that survives whatever ends the run."""

import fcntl
import json
import os
import sqlite3
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Self

from metrology import UsageError

__all__ = ["AttemptOutcome", "Entry", "Ledger", "State", "WorkOrder", "lock_folder"]


class State(StrEnum):
    """How far a clip is."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True)
class WorkOrder:
    """A clip to be measured and all that its result depends on.

    Attributes
    ----------
    clip : str
        Name, the key everywhere.
    path : str
    sha256 : str
        Of the clip's bytes.
    options : str
        Digest of setup, ball and options.
    version : str
        Of the software.
    """

    clip: str
    path: str
    sha256: str
    options: str
    version: str


_NAMES_AT_ONCE = 500
"""SQLite takes 999 parameters in its oldest build still in use."""


@dataclass(frozen=True)
class AttemptOutcome:
    """What came of one try.

    Attributes
    ----------
    clip : str
    state : State
        Done or failed; waiting where another try is due.
    seconds : float
        Wall time.
    document : str or None
        The clip's JSON as `vision measure --json` writes it: text, which the coordinator of a
        thousand workers hands on without looking into it.
    error : str or None
    died : bool
        The clip ended its worker: a run that is killed from outside does not count against it.
    """

    clip: str
    state: State
    seconds: float
    document: str | None = None
    error: str | None = None
    died: bool = False


@dataclass(frozen=True)
class Entry:
    """A row of the ledger, as `WorkOrder` and `AttemptOutcome` left it.

    Attributes
    ----------
    order : WorkOrder
    state : State
    attempts : int
        Tries begun with this order.
    seconds : float or None
    error : str or None
    excluded : str or None
        Why somebody marked the trial as bad.
    document : mapping or None
    """

    order: WorkOrder
    state: State
    attempts: int
    seconds: float | None
    error: str | None
    excluded: str | None
    document: Mapping[str, Any] | None


_LAYOUT = 1
_TABLES = """
CREATE TABLE IF NOT EXISTS clips (
    clip TEXT PRIMARY KEY, path TEXT NOT NULL, sha256 TEXT NOT NULL, options TEXT NOT NULL,
    version TEXT NOT NULL,
    state TEXT NOT NULL CHECK (state IN ('waiting', 'running', 'done', 'failed')),
    started TEXT, finished TEXT, seconds REAL, error TEXT,
    attempts INTEGER NOT NULL DEFAULT 0, deaths INTEGER NOT NULL DEFAULT 0,
    excluded TEXT, ball_at TEXT, document TEXT
);
CREATE TABLE IF NOT EXISTS stages (
    clip TEXT NOT NULL, stage TEXT NOT NULL, input TEXT NOT NULL, options TEXT NOT NULL,
    version TEXT NOT NULL, state TEXT NOT NULL, seconds REAL, finished TEXT, error TEXT,
    PRIMARY KEY (clip, stage)
);
"""
_FIRST_COLUMNS = frozenset({"clip", "path", "sha256", "options", "version", "state"})
"""Without these a row says nothing."""
_LATER_COLUMNS = {
    "started": "TEXT",
    "finished": "TEXT",
    "seconds": "REAL",
    "error": "TEXT",
    "attempts": "INTEGER NOT NULL DEFAULT 0",
    "deaths": "INTEGER NOT NULL DEFAULT 0",
    "excluded": "TEXT",
    "ball_at": "TEXT",
    "document": "TEXT",
}
"""Columns that an older version may lack, with what they hold then: nothing."""


class Ledger:
    """The rows of a campaign in ``ledger.sqlite``.

    Every change is one transaction: after a kill each clip is either as before or as after it.
    Use it as a context manager.

    Parameters
    ----------
    folder : Path
        Of the campaign.

    Raises
    ------
    UsageError
        If the folder's ledger can't be opened, or was written by a later version.
    """

    def __init__(self, folder: Path) -> None:
        path = folder / "ledger.sqlite"
        try:
            self._base = sqlite3.connect(path, timeout=60.0, isolation_level=None)
            self._base.row_factory = sqlite3.Row
            self._base.execute("PRAGMA journal_mode=WAL")
            # a finished clip costs seconds to minutes; its row is on the disk before the next
            self._base.execute("PRAGMA synchronous=FULL")
            layout = self._base.execute("PRAGMA user_version").fetchone()[0]
            if layout > _LAYOUT:
                raise UsageError(
                    f"{path} was written by a later version of vision",
                    hint="Install that version, or give another folder with --out.",
                )
            self._add_missing_columns()
            self._base.executescript(_TABLES)
            self._base.execute(f"PRAGMA user_version={_LAYOUT}")
        except (sqlite3.Error, UnicodeDecodeError) as problem:
            raise UsageError(
                f"can't use {path} as ledger: {problem}",
                hint="Give a folder that you may write to, on a disk with room.",
            ) from problem

    def _add_missing_columns(self) -> None:
        """Give a ledger of an older version the columns that it lacks; its rows stay.

        Raises
        ------
        UsageError
            If it is no ledger of ours at all.
        """
        held = {row["name"] for row in self._base.execute("PRAGMA table_info(clips)")}
        if not held:
            return
        if not held >= _FIRST_COLUMNS:
            raise UsageError(
                "ledger.sqlite in this folder is no ledger of a campaign",
                hint="Give another folder with --out.",
            )
        for name, kind in _LATER_COLUMNS.items():
            if name not in held:
                self._base.execute(f"ALTER TABLE clips ADD COLUMN {name} {kind}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._base.close()

    @contextmanager
    def _change(self) -> Iterator[sqlite3.Connection]:
        try:
            self._base.execute("BEGIN IMMEDIATE")
            try:
                yield self._base
                self._base.execute("COMMIT")
            except BaseException:
                # a full disk has rolled back already
                if self._base.in_transaction:
                    self._base.execute("ROLLBACK")
                raise
        except sqlite3.OperationalError as problem:
            raise UsageError(
                f"the ledger can't be written: {problem}",
                hint="What is done is kept. Make room on the disk (or leave the folder writable)"
                " and give the same command again.",
            ) from problem
        except sqlite3.DatabaseError as problem:
            raise _damaged(problem) from problem

    @contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        """Whatever a damaged file holds in place of a row is told in words."""
        try:
            yield self._base
        except (sqlite3.Error, ValueError, TypeError) as problem:
            raise _damaged(problem) from problem

    def plan(self, orders: Sequence[WorkOrder], *, retry_failed: bool) -> dict[str, str]:
        """Enter what is to be done, keep what was done with the same inputs.

        A row left `running` by a run that was killed waits again.

        Returns
        -------
        dict of str to str
            Clips that are measured again although they were done, and what changed.
        """
        again: dict[str, str] = {}
        with self._change() as base:
            known = {row["clip"]: row for row in base.execute("SELECT * FROM clips")}
            for order in orders:
                row = known.get(order.clip)
                if row is None:
                    base.execute(
                        "INSERT INTO clips (clip, path, sha256, options, version, state)"
                        " VALUES (?, ?, ?, ?, ?, 'waiting')",
                        (order.clip, order.path, order.sha256, order.options, order.version),
                    )
                    continue
                changed = [
                    what
                    for what, column, now in (
                        ("clip", "sha256", order.sha256),
                        ("setup or options", "options", order.options),
                        ("version", "version", order.version),
                    )
                    if row[column] != now
                ]
                if changed and row["state"] in (State.DONE, State.FAILED):
                    again[order.clip] = " and ".join(changed)
                retried = retry_failed and row["state"] == State.FAILED
                if changed or retried or row["state"] == State.RUNNING:
                    afresh = bool(changed) or retried
                    base.execute(
                        "UPDATE clips SET path=?, sha256=?, options=?, version=?, state='waiting',"
                        " attempts=CASE WHEN ? THEN 0 ELSE attempts END,"
                        " deaths=CASE WHEN ? THEN 0 ELSE deaths END, error=NULL,"
                        " document=CASE WHEN ? THEN NULL ELSE document END WHERE clip=?",
                        (
                            order.path,
                            order.sha256,
                            order.options,
                            order.version,
                            afresh,
                            afresh,
                            bool(changed),
                            order.clip,
                        ),
                    )
                elif row["path"] != order.path:
                    base.execute("UPDATE clips SET path=? WHERE clip=?", (order.path, order.clip))
        return again

    def begin(self, clips: Sequence[str]) -> dict[str, int]:
        """Mark clips as being measured; returns how often each has ended its worker before."""
        started = _now()
        with self._change() as base:
            base.executemany(
                "UPDATE clips SET state='running', started=?, finished=NULL, attempts=attempts+1"
                " WHERE clip=?",
                [(started, clip) for clip in clips],
            )
            deaths: dict[str, int] = {}
            for at in range(0, len(clips), _NAMES_AT_ONCE):
                some = clips[at : at + _NAMES_AT_ONCE]
                marks = ",".join("?" * len(some))
                deaths |= dict(
                    base.execute(f"SELECT clip, deaths FROM clips WHERE clip IN ({marks})", some)
                )
            return deaths

    def finish(self, outcomes: Sequence[AttemptOutcome]) -> None:
        """Write what came of tries, and their stage, in one transaction."""
        finished = _now()
        with self._change() as base:
            base.executemany(
                "UPDATE clips SET state=?, finished=?, seconds=?, error=?, document=?,"
                " deaths=deaths+? WHERE clip=?",
                [
                    (
                        one.state,
                        finished,
                        one.seconds,
                        one.error,
                        one.document,
                        int(one.died),
                        one.clip,
                    )
                    for one in outcomes
                ],
            )
            base.executemany(
                "INSERT OR REPLACE INTO stages SELECT clip, 'measure', sha256, options, version,"
                " state, seconds, finished, error FROM clips WHERE clip=?",
                [(one.clip,) for one in outcomes],
            )

    def exclude(self, clip: str, reason: str | None) -> None:
        """Mark a trial as bad with a reason, or take the mark back with None.

        Raises
        ------
        UsageError
            If there is no such clip.
        """
        with self._change() as base:
            _found(clip, base.execute("UPDATE clips SET excluded=? WHERE clip=?", (reason, clip)))

    def point_at(self, clip: str, ball_at: str | None) -> None:
        """Have a clip measured again, with a point on the ball (``x,y`` px) or without one.

        Raises
        ------
        UsageError
            If there is no such clip.
        """
        with self._change() as base:
            _found(clip, base.execute("UPDATE clips SET ball_at=? WHERE clip=?", (ball_at, clip)))

    def points(self) -> dict[str, str]:
        """Where somebody pointed at the ball, by clip.

        Raises
        ------
        UsageError
            If the ledger is damaged, as from `entries`, `waiting` and `counts`.
        """
        with self._reading() as base:
            rows = base.execute("SELECT clip, ball_at FROM clips WHERE ball_at IS NOT NULL")
            return {row["clip"]: row["ball_at"] for row in rows}

    def entries(self) -> Iterator[Entry]:
        """All rows in the order they were entered, read one at a time."""
        with self._reading() as base:
            rows = base.execute("SELECT * FROM clips ORDER BY rowid")
        while True:
            with self._reading():
                row = rows.fetchone()
                entry = None if row is None else _entry(row)
            if entry is None:
                return
            # outside: what the reader of the rows raises is no fault of the ledger
            yield entry

    def copies(self) -> list[dict[str, str | None]]:
        """Groups of clips that were measured and hold the same bytes; each with its mark."""
        with self._reading() as base:
            rows = base.execute(
                "SELECT sha256, clip, excluded FROM clips WHERE state='done' ORDER BY rowid"
            )
            alike: dict[str, dict[str, str | None]] = {}
            for row in rows:
                alike.setdefault(row["sha256"], {})[row["clip"]] = row["excluded"]
        return [clips for clips in alike.values() if len(clips) > 1]

    def waiting(self) -> list[str]:
        """Names of the clips still to be measured."""
        with self._reading() as base:
            rows = base.execute("SELECT clip FROM clips WHERE state='waiting' ORDER BY rowid")
            return [row["clip"] for row in rows]

    def counts(self) -> dict[State, int]:
        """How many clips are in each state."""
        with self._reading() as base:
            rows = base.execute("SELECT state, COUNT(*) AS number FROM clips GROUP BY state")
            found = {State(row["state"]): int(row["number"]) for row in rows}
        return {state: found.get(state, 0) for state in State}


def _entry(row: sqlite3.Row) -> Entry:
    return Entry(
        WorkOrder(row["clip"], row["path"], row["sha256"], row["options"], row["version"]),
        State(row["state"]),
        int(row["attempts"]),
        row["seconds"],
        row["error"],
        row["excluded"],
        None if row["document"] is None else json.loads(row["document"]),
    )


def _damaged(problem: Exception) -> UsageError:
    return UsageError(
        f"the ledger of this campaign is damaged: {problem}",
        hint="Put a copy of ledger.sqlite in its place, or give another folder with --out:"
        " the clips are measured again then.",
    )


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Hold a campaign's folder for one run; the lock ends with the process, however it ends.

    Raises
    ------
    UsageError
        If another run holds it, or the folder can't be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / ".run.lock", os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as problem:
        raise UsageError(
            f"can't write to {folder}: {problem.strerror}",
            hint="Give a folder that you may write to with --out.",
        ) from problem
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as problem:
            raise UsageError(
                f"another run is at work in {folder}",
                hint=f"Look at it with: vision campaign status {folder}",
            ) from problem
        yield
    finally:
        os.close(handle)


def _found(clip: str, done: sqlite3.Cursor) -> None:
    """Refuse a change that met no row: there is no such clip."""
    if done.rowcount == 0:
        raise UsageError(
            f"there is no clip {clip!r} in this campaign",
            hint="Its name is that in results.csv, with its ending.",
        )


def _now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S%z")
