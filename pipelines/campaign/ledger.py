"""The ledger of a campaign: one SQLite row per clip, consistent after any kill."""

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
from metrology.files import printable

__all__ = ["AttemptOutcome", "Entry", "Ledger", "State", "WorkOrder", "lock_folder"]


class State(StrEnum):
    """State of a clip."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True)
class WorkOrder:
    """A clip to be measured and all inputs of its result.

    Attributes
    ----------
    clip : str
        Name, the key in all tables.
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


_SQL_BATCH = 500
"""Names per query: the oldest SQLite in use allows 999 parameters."""


@dataclass(frozen=True)
class AttemptOutcome:
    """Result of one attempt.

    Attributes
    ----------
    state : State
        Done or failed; waiting if another attempt is due.
    seconds : float
        Wall time.
    document : str or None
        The clip's JSON as written by `vision measure --json`, passed on unparsed.
    died : bool
        The clip ended its worker; a run killed from outside does not count.
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
    attempts : int
        Attempts begun with this order.
    excluded : str or None
        Why the trial was marked as bad.
    """

    order: WorkOrder
    state: State
    attempts: int
    seconds: float | None
    error: str | None
    excluded: str | None
    document: Mapping[str, Any] | None


_NOT_ONE = (ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError)
"""What a row that this program did not write may raise."""

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
"""Columns every ledger has had; without them the file is not a ledger."""
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
"""Columns that a ledger of an older version may lack; empty then."""


class Ledger:
    """The rows of a campaign in ``ledger.sqlite``.

    Every change is one transaction: a kill leaves each clip as before or as after it.
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
        if path.exists() and not path.is_file():
            raise UsageError(
                f"{path} is not a regular file", hint="Remove it, or pass another folder as --out."
            )
        try:
            self._base = sqlite3.connect(path, timeout=60.0, isolation_level=None)
            self._base.row_factory = sqlite3.Row
            self._base.execute("PRAGMA journal_mode=WAL")
            # losing a row costs a whole measurement: it is on disk before the next clip
            self._base.execute("PRAGMA synchronous=FULL")
            layout = self._base.execute("PRAGMA user_version").fetchone()[0]
            if layout > _LAYOUT:
                raise UsageError(
                    f"{path} was written by a later version of impact-vision",
                    hint="Install that version, or pass another folder as --out.",
                )
            self._refuse_foreign()
            self._add_missing_columns()
            self._base.executescript(_TABLES)
            self._base.execute(f"PRAGMA user_version={_LAYOUT}")
        except UsageError:
            self._base.close()
            raise
        except (sqlite3.Error, ValueError, TypeError, OverflowError) as problem:
            raise UsageError(
                f"can't use {path} as ledger: {problem}",
                hint="Pass a writable folder with free disk space as --out.",
            ) from problem

    def _refuse_foreign(self) -> None:
        """Refuse files that are no ledger: a view or trigger may run for ever.

        Raises
        ------
        UsageError
        """
        held = self._base.execute("SELECT type, name, sql FROM sqlite_master").fetchall()
        odd = [
            row["name"]
            for row in held
            if row["type"] not in ("table", "index")
            or (row["type"] == "table" and not str(row["sql"]).startswith("CREATE TABLE"))
        ]
        named = {row["name"] for row in held if row["type"] == "table"}
        if odd or (named and "clips" not in named):
            raise _foreign()

    def _add_missing_columns(self) -> None:
        """Add columns missing in a ledger of an older version; its rows stay.

        Raises
        ------
        UsageError
            If the file is not a campaign ledger.
        """
        held = {row["name"] for row in self._base.execute("PRAGMA table_info(clips)")}
        if not held:
            return
        if not held >= _FIRST_COLUMNS:
            raise _foreign()
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
                # on a full disk SQLite has rolled back already
                if self._base.in_transaction:
                    self._base.execute("ROLLBACK")
                raise
        except sqlite3.OperationalError as problem:
            raise UsageError(
                f"the ledger can't be written: {problem}",
                hint="Finished clips are kept. Free disk space or make the folder writable, then"
                " run the same command again.",
            ) from problem
        except (sqlite3.Error, TypeError, ValueError, OverflowError) as problem:
            raise _damaged(problem) from problem

    @contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        """Map errors of a damaged file to a message."""
        try:
            yield self._base
        except (sqlite3.Error, *_NOT_ONE) as problem:
            raise _damaged(problem) from problem

    def plan(self, orders: Sequence[WorkOrder], *, retry_failed: bool) -> dict[str, str]:
        """Insert new clips; keep results that were measured with the same inputs.

        A row left `running` by a killed run is set to waiting.

        Returns
        -------
        dict of str to str
            Clips that will be measured again, and what changed.
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
        """Mark clips as being measured; return how often each has ended its worker."""
        started = _now()
        with self._change() as base:
            base.executemany(
                "UPDATE clips SET state='running', started=?, finished=NULL, attempts=attempts+1"
                " WHERE clip=?",
                [(started, clip) for clip in clips],
            )
            deaths: dict[str, int] = {}
            for at in range(0, len(clips), _SQL_BATCH):
                some = clips[at : at + _SQL_BATCH]
                marks = ",".join("?" * len(some))
                deaths |= dict(
                    base.execute(f"SELECT clip, deaths FROM clips WHERE clip IN ({marks})", some)
                )
            return deaths

    def finish(self, outcomes: Sequence[AttemptOutcome]) -> None:
        """Store the results of attempts, and their stage, in one transaction."""
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
        """Mark a trial as bad with a reason, or remove the mark with None.

        Raises
        ------
        UsageError
            If there is no such clip.
        """
        reason = None if reason is None else printable(reason)
        with self._change() as base:
            _found(clip, base.execute("UPDATE clips SET excluded=? WHERE clip=?", (reason, clip)))

    def point_at(self, clip: str, ball_at: str | None) -> None:
        """Schedule a clip again, with a point on the ball (``x,y`` px) or without one.

        Raises
        ------
        UsageError
            If there is no such clip.
        """
        with self._change() as base:
            _found(clip, base.execute("UPDATE clips SET ball_at=? WHERE clip=?", (ball_at, clip)))

    def points(self) -> dict[str, str]:
        """Points on the ball given by the user, by clip.

        Raises
        ------
        UsageError
            If the ledger is damaged, as from `entries`, `waiting` and `counts`.
        """
        with self._reading() as base:
            rows = base.execute("SELECT clip, ball_at FROM clips WHERE ball_at IS NOT NULL")
            return {str(_text(row, "clip")): str(_text(row, "ball_at")) for row in rows}

    def entries(self) -> Iterator[Entry]:
        """All rows in the order of insertion, read one at a time."""
        with self._reading() as base:
            rows = base.execute("SELECT * FROM clips ORDER BY rowid")
        while True:
            with self._reading():
                row = rows.fetchone()
                entry = None if row is None else _entry(row)
            if entry is None:
                return
            # yield outside: an exception of the consumer is not a ledger error
            yield entry

    def copies(self) -> list[dict[str, str | None]]:
        """Groups of measured clips with identical bytes; each with its mark."""
        with self._reading() as base:
            rows = base.execute(
                "SELECT sha256, clip, excluded FROM clips WHERE state='done' ORDER BY rowid"
            )
            alike: dict[str, dict[str, str | None]] = {}
            for row in rows:
                mark = _printed(row, "excluded")
                alike.setdefault(row["sha256"], {})[str(_text(row, "clip"))] = mark
        return [clips for clips in alike.values() if len(clips) > 1]

    def waiting(self) -> list[str]:
        """Names of the clips still to be measured."""
        with self._reading() as base:
            rows = base.execute("SELECT clip FROM clips WHERE state='waiting' ORDER BY rowid")
            return [str(_text(row, "clip")) for row in rows]

    def counts(self) -> dict[State, int]:
        """Number of clips in each state."""
        with self._reading() as base:
            rows = base.execute("SELECT state, COUNT(*) AS number FROM clips GROUP BY state")
            found = {State(row["state"]): int(row["number"]) for row in rows}
        return {state: found.get(state, 0) for state in State}


def _entry(row: sqlite3.Row) -> Entry:
    document = _text(row, "document", optional=True)
    found = None if document is None else json.loads(document)
    if found is not None:
        _require_document(found)
    seconds = row["seconds"]
    if not isinstance(seconds, int | float | None):
        raise TypeError("seconds is not a number")
    order = [str(_text(row, name)) for name in ("clip", "path", "sha256", "options", "version")]
    return Entry(
        WorkOrder(*order),
        State(row["state"]),
        int(row["attempts"]),
        seconds,
        _printed(row, "error"),
        _printed(row, "excluded"),
        found,
    )


def _text(row: sqlite3.Row, name: str, *, optional: bool = False) -> str | None:
    """A cell that must be text."""
    if not (isinstance(row[name], str) or (optional and row[name] is None)):
        raise TypeError(f"{name} is not text")
    return row[name]  # type: ignore[no-any-return]


def _printed(row: sqlite3.Row, name: str) -> str | None:
    """A cell that is text or empty, without control characters."""
    text = _text(row, name, optional=True)
    return None if text is None else printable(text)


def _require_document(found: object) -> None:
    """Raise if a document is not one of `vision measure --json`."""
    if not isinstance(found, dict):
        raise TypeError("a document is not an object")
    quantities = found.get("quantities", {})
    for name, item in quantities.items():
        value, std = item.get("value"), item.get("std")
        if not (isinstance(value, int | float | None) and isinstance(std, int | float | None)):
            raise TypeError(f"{name} is not a number")
        if value is not None and std is None:
            raise TypeError(f"{name} has no uncertainty")
    for warning in found.get("warnings", ()):
        if not isinstance(warning, str):
            raise TypeError("a warning is not text")
    if not isinstance(found.get("motion") or {}, dict):
        raise TypeError("motion is not an object")


def _foreign() -> UsageError:
    return UsageError(
        "ledger.sqlite in this folder is not a campaign ledger",
        hint="Pass another folder as --out.",
    )


def _damaged(problem: Exception) -> UsageError:
    return UsageError(
        f"the ledger of this campaign is damaged: {problem}",
        hint="Restore ledger.sqlite from a copy, or pass another folder as --out: all clips are"
        " then measured again.",
    )


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Lock a campaign's folder for one run; the lock ends with the process.

    Raises
    ------
    UsageError
        If another run holds the lock, or the folder can't be created or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / ".run.lock", os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as problem:
        raise UsageError(
            f"can't write to {folder}: {problem.strerror}",
            hint="Pass a writable folder as --out.",
        ) from problem
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as problem:
            raise UsageError(
                f"another run is active in {folder}",
                hint=f"Show its progress with: vision campaign status {folder}",
            ) from problem
        yield
    finally:
        os.close(handle)


def _found(clip: str, done: sqlite3.Cursor) -> None:
    """Raise if a change affected no row: there is no such clip."""
    if done.rowcount == 0:
        raise UsageError(
            f"there is no clip {clip!r} in this campaign",
            hint="Use the name from results.csv, with its ending.",
        )


def _now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S%z")
