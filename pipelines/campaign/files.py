"""Check, sweep and replace the files in a campaign's folder."""

import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from metrology import UsageError
from metrology.files import shown_path

__all__ = ["FOLDERS", "PUBLISHED", "clip_key", "refuse_occupied", "staged", "sweep"]

PUBLISHED = (
    "results.csv",
    "results.xlsx",
    "results.parquet",
    "summary.json",
    "cor.toml",
    "report.html",
)
"""Files that every publishing replaces or removes."""

FOLDERS = ("tracks", "frames", "figures")
"""Folders of a campaign."""

_READ_AND_WRITTEN = ("ledger.sqlite", "ledger.sqlite-wal", "ledger.sqlite-shm", ".run.lock")

_STAGE = ".publishing-"

_LEFTOVER = re.compile(r"\..*-[0-9a-f]{12}(\.\w+)?", re.DOTALL)
"""Temporary names of `metrology.files.written_whole`."""


def clip_key(clip: Path) -> str:
    """Name of a clip in ledger and tables; bytes that are no UTF-8 are written as escapes."""
    return clip.name.encode("utf-8", "backslashreplace").decode()


def refuse_occupied(folder: Path) -> None:
    """Refuse a folder in which something else has the name of a file or folder to be written.

    Raises
    ------
    UsageError
        Before anything is measured.
    """
    wanted = [(name, stat.S_ISREG, "a file") for name in (*PUBLISHED, *_READ_AND_WRITTEN)]
    wanted += [(name, stat.S_ISDIR, "a folder") for name in FOLDERS]
    for name, is_right, kind in wanted:
        path = folder / name
        try:
            mode = path.stat().st_mode
        except FileNotFoundError:
            continue
        except OSError as problem:
            raise UsageError(
                f"can't use {shown_path(path)}: {problem.strerror}",
                hint="Remove it, or pass another folder as --out.",
            ) from problem
        if not is_right(mode):
            raise UsageError(
                f"{shown_path(path)} is not {kind}, but the campaign writes {kind} of that name",
                hint="Remove it, or pass another folder as --out.",
            )


def sweep(folder: Path) -> None:
    """Remove temporary files that a killed run left; the caller holds the folder's lock."""
    for place in (folder, *(folder / name for name in FOLDERS)):
        if not place.is_dir():
            continue
        for path in place.iterdir():
            if path.name.startswith(_STAGE) and path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            elif _LEFTOVER.fullmatch(path.name) and path.is_file():
                with suppress(OSError):
                    path.unlink()


@contextmanager
def staged(folder: Path, *, whole: bool = True) -> Iterator[Path]:
    """Yield a folder whose files replace those of `folder` together, if the block succeeds.

    If one can't be replaced, all are restored.

    Parameters
    ----------
    whole : bool
        Remove files of `PUBLISHED` that the block did not write: they would no longer agree with
        the others.

    Raises
    ------
    UsageError
        If a file can't be replaced.
    """
    stage = folder / f"{_STAGE}{secrets.token_hex(6)}"
    stage.mkdir()
    try:
        yield stage
        names = sorted(str(path.relative_to(stage)) for path in stage.rglob("*") if path.is_file())
        stale = [name for name in PUBLISHED if whole and (folder / name).exists()]
        _replace(stage, folder, names, [name for name in stale if name not in names])
    except OSError as problem:
        raise UsageError(
            f"can't write the results to {folder}: {problem.strerror}",
            hint="Free disk space and run the same command again: the ledger keeps the results.",
        ) from problem
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _replace(stage: Path, folder: Path, names: Sequence[str], stale: Sequence[str]) -> None:
    """Rename all files; the old ones are kept until the last new one has its name."""
    before = stage / "before"
    for name in (*names, *stale):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (before / name).parent.mkdir(parents=True, exist_ok=True)
        if (folder / name).exists():
            _keep(folder / name, before / name)
    done: list[str] = []
    try:
        for name in (*names, *stale):
            done.append(name)
            if name in names:
                os.replace(stage / name, folder / name)
            else:
                (folder / name).unlink()
    except BaseException:
        for name in done:
            if (before / name).exists():
                os.replace(before / name, folder / name)
            else:
                (folder / name).unlink(missing_ok=True)
        raise


def _keep(path: Path, under: Path) -> None:
    """Keep a file under a second name; its own name stays valid."""
    try:
        os.link(path, under)
    except OSError:  # a file system without links
        shutil.copy2(path, under)
