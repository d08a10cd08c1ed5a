"""Cache of measurement stages, keyed by clip, options, versions and sources.

A key holds everything a result depends on, including the source files, so that results of older
code are never returned. Entries are numbers and names (`metrology.stored`), and only those that
another user could not have written are read.
"""

import hashlib
import os
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Self

from metrology import ClipError
from metrology.stored import MAX_STORED_BYTES, OWN_PACKAGES, dump, load

__all__ = ["FOLDER_VARIABLE", "Cache", "clip_digest", "is_private"]

LIBRARIES = ("av", "numba", "numpy", "opencv-python-headless", "scikit-image", "scipy")
"""Libraries whose versions enter the key."""

LIMIT_BYTES = 1_000_000_000
"""Bytes, about a thousand clips of 1 MB (chosen); the oldest entries are removed first."""

FOLDER_VARIABLE = "IMPACT_VISION_CACHE"
"""Environment variable with the cache folder; "off" disables the cache."""

_ENDING = ".npz"

_OLD_SUFFIX = ".pickle"
"""Suffix of entries of earlier versions: never read, removed first."""

_TEMPORARY = ".writing-"

_ABANDONED_S = 3600.0
"""Age from which a temporary file belongs to a process that was killed, s (chosen)."""


@dataclass(frozen=True)
class Cache:
    """A folder of results, safe for several processes at once.

    Entries are written to a temporary file and renamed, so that no reader sees half of one.
    Unreadable entries count as missing.

    Attributes
    ----------
    folder : Path or None
        None disables the cache.
    """

    folder: Path | None
    limit_bytes: int = LIMIT_BYTES

    @classmethod
    def of_user(cls, *, wanted: bool = True) -> Self:
        """The user's cache; a disabled one if not `wanted`."""
        said = os.environ.get(FOLDER_VARIABLE, "")
        if not wanted or said == "off":
            return cls(None)
        if said:
            return cls(Path(said))
        from platformdirs import user_cache_path

        return cls(user_cache_path("impact-vision", appauthor=False))

    def key(self, stage: str, *parts: object) -> str:
        """Name of an entry: a digest of the stage, the code and all inputs.

        Parameters
        ----------
        stage : str
            Stage of the measurement.
        *parts : object
            Its inputs: numbers, strings and dataclasses of them, compared by their `repr`.
        """
        digest = hashlib.sha256(_code().encode())
        digest.update(repr((stage, parts)).encode())
        return f"{stage}-{digest.hexdigest()[:40]}"

    def get(self, key: str) -> Any | None:
        """Entry of a key; None if it is missing, unreadable or may be another user's."""
        path = self._path(key)
        if path is None or not is_private(path.parent.stat):
            return None
        try:
            # Neither a link nor a pipe is followed.
            descriptor = os.open(path, os.O_RDONLY | _NOFOLLOW | _NONBLOCK)
        except OSError:
            return None
        with open(descriptor, "rb") as file:
            seen = os.fstat(descriptor)
            if not (stat.S_ISREG(seen.st_mode) and is_private(lambda: seen)):
                return None
            if seen.st_size > MAX_STORED_BYTES:
                return None
            try:
                found = load(file.read())
                os.utime(path)
            # a damaged entry may raise any exception
            except Exception:
                return None
        return found

    def put(self, key: str, value: object) -> None:
        """Store a value; do nothing if the folder can't be written or the value not stored."""
        path = self._path(key)
        if path is None:
            return
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            content = dump(value)
            with tempfile.NamedTemporaryFile(
                dir=path.parent, prefix=_TEMPORARY, delete=False
            ) as file:
                file.write(content)
            os.replace(file.name, path)
            self._trim()
        except (OSError, TypeError):
            return

    def clear(self) -> int:
        """Remove every entry; return the bytes freed."""
        freed = 0
        for path, size, _ in self._entries():
            path.unlink(missing_ok=True)
            freed += size
        return freed

    def size(self) -> int:
        """Size of all entries, bytes."""
        return sum(size for _, size, _ in self._entries())

    def _path(self, key: str) -> Path | None:
        return None if self.folder is None else self.folder / (key + _ENDING)

    def _entries(self) -> Iterator[tuple[Path, int, float]]:
        if self.folder is None or not self.folder.is_dir():
            return
        for path in self.folder.iterdir():
            if path.suffix not in (_ENDING, _OLD_SUFFIX) and not path.name.startswith(_TEMPORARY):
                continue
            try:
                seen = path.stat()
            except OSError:
                # another process has removed it
                continue
            yield path, seen.st_size, seen.st_mtime

    def _trim(self) -> None:
        entries = sorted(self._entries(), key=lambda entry: entry[2])
        over = sum(size for _, size, _ in entries) - self.limit_bytes
        now = time.time()
        for path, size, changed in entries:
            abandoned = path.name.startswith(_TEMPORARY) and now - changed > _ABANDONED_S
            if over > 0 or abandoned or path.suffix == _OLD_SUFFIX:
                path.unlink(missing_ok=True)
                over -= size


_NOFOLLOW, _NONBLOCK = getattr(os, "O_NOFOLLOW", 0), getattr(os, "O_NONBLOCK", 0)


def is_private(status: Callable[[], os.stat_result]) -> bool:
    """Whether a file or folder is this user's and nobody else may write to it."""
    if not hasattr(os, "geteuid"):
        return True
    try:
        seen = status()
    except OSError:
        return False
    return seen.st_uid == os.geteuid() and not seen.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def clip_digest(path: Path) -> str:
    """SHA-256 of a file, or of the names and contents of a folder's files in order.

    Raises
    ------
    ClipError
        If it is neither: a pipe may never be written to, a device may never end.
    """
    digest = hashlib.sha256()
    if path.is_dir():
        for part in sorted(one for one in path.iterdir() if one.is_file()):
            digest.update(os.fsencode(part.name))
            digest.update(bytes.fromhex(clip_digest(part)))
        return digest.hexdigest()
    # Without O_NONBLOCK, opening a pipe waits for its writer.
    with open(os.open(path, os.O_RDONLY | _NONBLOCK), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise ClipError(
                f"{path} is not a regular file",
                hint="Pass a video file; a pipe or a device may never end.",
            )
        return hashlib.file_digest(file, "sha256").hexdigest()


@cache
def _code() -> str:
    """Digest of versions, sizes and modification times of everything that computes results."""
    digest = hashlib.sha256(sys.version.encode())
    for library in LIBRARIES:
        try:
            digest.update(f"{library} {version(library)}\n".encode())
        except PackageNotFoundError:
            continue
    root = Path(__file__).parents[1]
    for package in sorted(OWN_PACKAGES):
        for source in sorted((root / package).rglob("*.py")):
            seen = source.stat()
            line = f"{source.relative_to(root)} {seen.st_size} {seen.st_mtime_ns}\n"
            digest.update(line.encode())
    return digest.hexdigest()
