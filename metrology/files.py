"""The doors for files: what is read is a small regular text, what is written is whole or not there.

A file that is there keeps its mode and its links: a symbolic link is followed, a device or a pipe
is written to and never replaced (POSIX `rename` would put a file in its place).
"""

import codecs
import errno
import os
import secrets
import stat
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from metrology.errors import OutputError, SetupError, UsageError

__all__ = [
    "parse_toml",
    "read_small_text",
    "refuse_unwritable",
    "shown_path",
    "write_text_whole",
    "written_whole",
]

LARGEST_TEXT = 4 << 20
"""Bytes of a setup, a lens or a law: a hundred times what the longest of ours has."""

_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


def read_small_text(
    path: Path, *, what: str = "", hint: str = "", error: type[UsageError] = UsageError
) -> str:
    """Read a text file that a person wrote: UTF-8, or UTF-16 with its mark.

    Parameters
    ----------
    path : Path
    what : str
        What the file should be, for the message: "the setup file".
    hint : str
        What would help.
    error : type
        What is raised.

    Raises
    ------
    UsageError
        If there is no such file, it is no regular file (a pipe, a device, a folder), larger than
        4 MiB, or no text.
    """
    name = f"{what} {shown_path(path)}".strip()
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a device or a pipe"
            raise error(f"can't read {name}: it is {kind}", hint=hint or "Give a file.")
        if status.st_size > LARGEST_TEXT:
            raise error(
                f"can't read {name}: {status.st_size / 2**20:.0f} MiB, and at most "
                f"{LARGEST_TEXT >> 20} MiB are read",
                hint=hint or "Is it another file that was meant?",
            )
        raw = path.read_bytes()
    except OSError as problem:
        raise error(
            f"can't read {name}: {problem.strerror}",
            hint=hint or "Is the name right, and may you read it?",
        ) from problem
    encoding = next((name for mark, name in _MARKS.items() if raw.startswith(mark)), "utf-8")
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError as problem:
        raise error(
            f"can't read {name}: its byte {problem.start} is no {encoding.upper()} text",
            hint="Save it as UTF-8.",
        ) from problem


def parse_toml(text: str, name: str) -> dict[str, Any]:
    """Turn the text of a TOML file into its tables.

    Parameters
    ----------
    text : str
    name : str
        What to call the file in a message.

    Raises
    ------
    SetupError
        If it is no TOML, has a number of more digits than Python reads, or tables in tables
        without end.
    """
    try:
        held = tomllib.loads(text)
        _require_sizes(held, name, "")
        return held
    except RecursionError as problem:
        raise SetupError(
            f"{name} is not valid TOML: lists in lists without end",
            hint="Write one list of numbers for a key.",
        ) from problem
    except ValueError as problem:
        raise SetupError(
            f"{name} is not valid TOML: {_in_short(str(problem))}",
            hint='A line reads key = value, with texts in quotes: diameter = "0.2 m".',
        ) from problem


def _require_sizes(held: object, name: str, place: str) -> None:
    """Refuse whole numbers beyond the 64 bits that TOML has: no float holds the longest of them."""
    if isinstance(held, dict):
        for key, value in held.items():
            _require_sizes(value, name, f"{place}.{key}" if place else str(key))
    elif isinstance(held, list):
        for value in held:
            _require_sizes(value, name, place)
    elif isinstance(held, int) and held.bit_length() > _TOML_BITS:
        raise SetupError(
            f"{name}: {_in_short(place)} is a whole number of {len(str(abs(held)))} digits",
            hint="Whole numbers have 19 digits at most; write a larger one as 1.5e30.",
        )


_TOML_BITS = 63
"""TOML v1.0.0, Integer: 64 bits with the sign."""
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS})


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a temporary path; its content takes the name `path` only if the block succeeds.

    Parameters
    ----------
    path : Path
        The file wanted at the end. The temporary one keeps its suffix, which encoders look at.

    Yields
    ------
    Path
        Where to write.

    Raises
    ------
    OutputError
        If the folder does not exist or can't be written to, or the disk is full.
    """
    direct = _is_special(path)
    target = path if direct else Path(os.path.realpath(path))
    folder = Path(tempfile.gettempdir()) if direct else target.parent
    # named before it is made: a signal in between leaves nothing behind
    temporary = folder / f".{path.stem[:40]}-{secrets.token_hex(6)}{path.suffix}"
    try:
        with _told(path):
            temporary.touch(mode=0o600, exist_ok=False)
        with _told(path, _NO_ROOM):
            yield temporary
        with _told(path):
            if direct:
                _pour(temporary, target)
            else:
                os.chmod(temporary, _mode_of(target))
                os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def write_text_whole(path: Path, text: str) -> None:
    """Write a text file in one go, UTF-8."""
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def refuse_unwritable(path: Path) -> None:
    """Refuse a file that can't be written, before the work that makes its content.

    Parameters
    ----------
    path : Path

    Raises
    ------
    OutputError
        If its folder does not exist or can't be written to, or a folder has that name.
    """
    if _is_special(path):
        return
    with _told(path):
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "there is a folder of that name")
        if not target.parent.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"there is no folder {path.parent}")
        if not os.access(target.parent, os.W_OK):
            raise PermissionError(errno.EACCES, f"you may not write to {target.parent}")


@contextmanager
def _told(path: Path, codes: frozenset[int] | None = None) -> Iterator[None]:
    """Turn an error of the system into a message; with `codes`, only these errors."""
    try:
        yield
    except OSError as problem:
        if codes is not None and problem.errno not in codes:
            raise
        raise OutputError(
            f"can't write {shown_path(path)}: {problem.strerror or problem}",
            hint="Name a file in a folder that exists, that you may write to, on a disk with room.",
        ) from problem


def _is_special(path: Path) -> bool:
    """Whether it is an open stream, or something that is neither a file nor a folder."""
    if path.is_absolute() and path.parts[1:2] in (("dev",), ("proc",)):
        return True
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _pour(source: Path, target: Path) -> None:
    with source.open("rb") as content, target.open("ab", buffering=0) as out:
        while block := content.read(1 << 20):
            rest = memoryview(block)
            while rest:
                rest = rest[out.write(rest) or 0 :]


def _mode_of(target: Path) -> int:
    """The mode of the file that is there; else what the user's mask leaves."""
    try:
        return stat.S_IMODE(target.stat().st_mode)
    except OSError:
        mask = os.umask(0o077)
        os.umask(mask)
        return 0o666 & ~mask


def shown_path(path: str | Path) -> str:
    """A path as a message names it: in short where it is long."""
    return _in_short(str(path))


def _in_short(text: str) -> str:
    return text if len(text) <= 200 else f"{text[:80]}…{text[-80:]} ({len(text)} characters)"
