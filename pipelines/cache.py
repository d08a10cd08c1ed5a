"""Cache of measurement stages, keyed by clip, options, versions and sources.

A key holds everything a result depends on, including the source files, so that results of older
code are never returned.
"""

import hashlib
import os
import pickle
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Self

import typer
from typer.core import TyperGroup

from metrology import ClipError

__all__ = ["CACHE_COMMANDS", "Cache", "CacheGroup", "clip_digest"]

PACKAGES = ("calib", "metrology", "physics", "pipelines", "vision")
"""Packages whose sources enter the key."""

LIBRARIES = ("av", "numba", "numpy", "opencv-python-headless", "scikit-image", "scipy")
"""Libraries whose versions enter the key."""

LIMIT_BYTES = 1_000_000_000
"""Bytes, about a thousand clips of 1 MB (chosen); the oldest entries are removed first."""

FOLDER_VARIABLE = "IMPACT_VISION_CACHE"
"""Environment variable with the cache folder; "off" disables the cache."""

_SUFFIX = ".pickle"


@dataclass(frozen=True)
class Cache:
    """A folder of results, safe for several processes at once.

    Entries are written to a temporary file and renamed, so that no reader sees half of one.
    Unreadable entries count as missing.

    Attributes
    ----------
    folder : Path or None
        None disables the cache.
    limit_bytes : int
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
        """Entry of a key; None if it is missing or unreadable."""
        path = self._path(key)
        if path is None:
            return None
        try:
            found = pickle.loads(path.read_bytes())
            os.utime(path)
        # a damaged pickle may raise any exception
        except Exception:
            return None
        return found

    def put(self, key: str, value: object) -> None:
        """Store a value; do nothing if the folder can't be written."""
        path = self._path(key)
        if path is None:
            return
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
                pickle.dump(value, file, protocol=5)
            os.replace(file.name, path)
            self._trim()
        except OSError:
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
        return None if self.folder is None else self.folder / (key + _SUFFIX)

    def _entries(self) -> Iterator[tuple[Path, int, float]]:
        if self.folder is None or not self.folder.is_dir():
            return
        for path in self.folder.glob(f"*{_SUFFIX}"):
            try:
                seen = path.stat()
            except OSError:
                # another process has removed it
                continue
            yield path, seen.st_size, seen.st_mtime

    def _trim(self) -> None:
        entries = sorted(self._entries(), key=lambda entry: entry[2])
        over = sum(size for _, size, _ in entries) - self.limit_bytes
        for path, size, _ in entries:
            if over <= 0:
                return
            path.unlink(missing_ok=True)
            over -= size


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
            digest.update(part.name.encode())
            digest.update(bytes.fromhex(clip_digest(part)))
        return digest.hexdigest()
    # Without O_NONBLOCK, opening a pipe waits for its writer.
    with open(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
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
    for package in PACKAGES:
        for source in sorted((root / package).rglob("*.py")):
            seen = source.stat()
            line = f"{source.relative_to(root)} {seen.st_size} {seen.st_mtime_ns}\n"
            digest.update(line.encode())
    return digest.hexdigest()


class CacheGroup(TyperGroup):
    """The commands under `vision cache`."""


def show_command() -> None:
    """Show the cache folder and its size.

    Example: vision cache show
    """
    kept = Cache.of_user()
    if kept.folder is None:
        typer.echo(f"the cache is off ({FOLDER_VARIABLE}=off)")
        return
    typer.echo(f"{kept.folder}: {kept.size() / 1e6:.1f} MB of {kept.limit_bytes / 1e6:.0f} MB")


def clear_command() -> None:
    """Empty the cache; every clip is then measured again.

    Example: vision cache clear
    """
    typer.echo(f"{Cache.of_user().clear() / 1e6:.1f} MB removed")


CACHE_COMMANDS: dict[str, Callable[..., Any]] = {"show": show_command, "clear": clear_command}
"""Commands under `vision cache`, by name."""
