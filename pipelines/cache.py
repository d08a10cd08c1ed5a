"""What was worked out from a clip before: kept on disk, and found again by what it followed from.

A key holds everything that a result depends on: the clip's own bytes, what was said of it, the
versions of what worked it out, and the sources themselves, so that a change of the code is never
answered with what the code before it found.

`vision cache`: what is kept of clips measured before.
"""

import hashlib
import os
import pickle
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

__all__ = ["CACHE_COMMANDS", "Cache", "CacheGroup", "clip_digest"]

PACKAGES = ("calib", "metrology", "physics", "pipelines", "vision")

LIBRARIES = ("av", "numba", "numpy", "opencv-python-headless", "scikit-image", "scipy")

LIMIT_BYTES = 1_000_000_000

"""Bytes, about a thousand clips of 1 MB; the oldest entries go first."""

FOLDER_VARIABLE = "IMPACT_VISION_CACHE"

"""Environment variable with the folder to use; "off" keeps nothing."""

_SUFFIX = ".pickle"


@dataclass(frozen=True)
class Cache:
    """A folder of results, safe for several processes at once.

    Entries are written aside and then renamed, so that no reader sees half of one; one that can't
    be read counts as missing.

    Attributes
    ----------
    folder : Path or None
        None keeps nothing.
    limit_bytes : int
    """

    folder: Path | None
    limit_bytes: int = LIMIT_BYTES

    @classmethod
    def of_user(cls, *, wanted: bool = True) -> Self:
        """The user's own cache; one that keeps nothing where it is not wanted."""
        said = os.environ.get(FOLDER_VARIABLE, "")
        if not wanted or said == "off":
            return cls(None)
        if said:
            return cls(Path(said))
        from platformdirs import user_cache_path

        return cls(user_cache_path("impact-vision", appauthor=False))

    def key(self, stage: str, *parts: object) -> str:
        """Name of an entry: a digest of the stage, the code and everything it follows from.

        Parameters
        ----------
        stage : str
            What is kept.
        *parts : object
            What it depends on; numbers, words and dataclasses of them: their `repr` tells it all.
        """
        digest = hashlib.sha256(_code().encode())
        digest.update(repr((stage, parts)).encode())
        return f"{stage}-{digest.hexdigest()[:40]}"

    def get(self, key: str) -> Any | None:
        """The entry of a key; None where there is none, or it can't be read."""
        path = self._path(key)
        if path is None:
            return None
        try:
            found = pickle.loads(path.read_bytes())
            os.utime(path)
        # a damaged pickle may raise anything
        except Exception:
            return None
        return found

    def put(self, key: str, value: object) -> None:
        """Keep a value; a folder that can't be written to keeps nothing."""
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
        """Remove every entry; how many bytes that freed."""
        freed = 0
        for path, size, _ in self._entries():
            path.unlink(missing_ok=True)
            freed += size
        return freed

    def size(self) -> int:
        """Bytes that the entries take."""
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
                # another process has removed it meanwhile
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
    """SHA-256 of a file, or of the names and contents of a folder's files in order."""
    digest = hashlib.sha256()
    if path.is_dir():
        for part in sorted(one for one in path.iterdir() if one.is_file()):
            digest.update(part.name.encode())
            digest.update(bytes.fromhex(clip_digest(part)))
        return digest.hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@cache
def _code() -> str:
    """Versions, and when which source was last written: what a result may change with."""
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
    """Say where results are kept, and how much of the disk they take.

    Example: vision cache show
    """
    kept = Cache.of_user()
    if kept.folder is None:
        typer.echo(f"nothing is kept ({FOLDER_VARIABLE}=off)")
        return
    typer.echo(f"{kept.folder}: {kept.size() / 1e6:.1f} MB of {kept.limit_bytes / 1e6:.0f} MB")


def clear_command() -> None:
    """Remove what is kept; every clip is then measured afresh.

    Example: vision cache clear
    """
    typer.echo(f"{Cache.of_user().clear() / 1e6:.1f} MB removed")


CACHE_COMMANDS: dict[str, Callable[..., Any]] = {"show": show_command, "clear": clear_command}

"""Commands under `vision cache`, by name."""
