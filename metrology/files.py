"""Read small text files safely; write files atomically.

An existing file keeps its mode and its links: a symbolic link is followed; a device or a pipe is
written to and never replaced (POSIX `rename` would put a file in its place).
"""

import codecs
import errno
import os
import re
import secrets
import stat
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from metrology.errors import ImpactVisionError, OutputError, SetupError, UsageError

__all__ = [
    "parse_toml",
    "printable",
    "read_small_text",
    "refuse_unwritable",
    "shown_path",
    "starts_as_text",
    "write_each",
    "write_text_whole",
    "written_whole",
]

MAX_SHOWN_LINE = 100
"""Characters of a line shown in a message (chosen: a line of a terminal)."""

MAX_TEXT_BYTES = 4 << 20
"""Maximum size of a setup, lens or law file, bytes (chosen: a hundred times the usual)."""

_BYTE_ORDER_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


def starts_as_text(head: bytes) -> bool:
    """Whether the first bytes of a file are those of a text."""
    return head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or b"\0" not in head


def read_small_text(
    path: Path, *, what: str = "", hint: str = "", error: type[UsageError] = UsageError
) -> str:
    """Read a text file: UTF-8, or UTF-16 with a byte order mark.

    Parameters
    ----------
    what : str
        Description for the message: "the setup file".
    hint : str
        Advice for the message.
    error : type
        Exception to raise.

    Raises
    ------
    UsageError
        If there is no such file, or it is not regular (a pipe, a device, a folder), larger than
        4 MiB, or not text.
    """
    name = f"{what} {shown_path(path)}".strip()
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a device or a pipe"
            raise error(f"can't read {name}: it is {kind}", hint=hint or "Pass a file.")
        if status.st_size > MAX_TEXT_BYTES:
            raise error(
                f"can't read {name}: it has {status.st_size / 2**20:.0f} MiB, the limit is "
                f"{MAX_TEXT_BYTES >> 20} MiB",
                hint=hint or "Check that this is the right file.",
            )
        raw = path.read_bytes()
    except OSError as problem:
        raise error(
            f"can't read {name}: {problem.strerror}",
            hint=hint or "Check the name, and that you may read the file.",
        ) from problem
    encoding = next(
        (name for mark, name in _BYTE_ORDER_MARKS.items() if raw.startswith(mark)), "utf-8"
    )
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError as problem:
        raise error(
            f"can't read {name}: byte {problem.start} is not {encoding.upper()} text",
            hint="Save it as UTF-8.",
        ) from problem


def parse_toml(text: str, name: str) -> dict[str, Any]:
    """Parse a TOML file's text.

    Parameters
    ----------
    name : str
        Name of the file in a message.

    Raises
    ------
    SetupError
        If it is not TOML, or has an integer over 64 bits or too deeply nested lists.
    """
    try:
        held = tomllib.loads(text)
        _require_sizes(held, name, "")
        return held
    except RecursionError as problem:
        raise SetupError(
            f"{name} is not valid TOML: too deeply nested lists",
            hint="Write one list of numbers for a key.",
        ) from problem
    except ValueError as problem:
        place = re.search(r"at line (\d+)", str(problem))
        lines = text.splitlines() or [""]
        line = lines[int(place[1]) - 1 if place else -1].strip()
        line = line if len(line) <= MAX_SHOWN_LINE else ""
        raise SetupError(
            f"{name} is not valid TOML: {_shortened(str(problem))}" + (f": {line}" if line else ""),
            hint=_toml_cure(line, str(problem)),
        ) from problem


_TYPESET_QUOTES = "[\u201c-\u201f\u2018-\u201b\u00ab\u00bb]"
"""Quotation marks that text processors write for straight ones."""


def _toml_cure(line: str, problem: str) -> str:
    """What to write instead of a line that is not TOML."""
    key, equals, value = (part.strip() for part in line.partition("="))
    if "overwrite" in problem or "twice" in problem:
        return f"{key} stands twice: delete one of the lines."
    if re.search(_TYPESET_QUOTES, line):
        straight = re.sub(_TYPESET_QUOTES, '"', line)
        return f"Replace the typographic quotation marks by straight ones: {straight}"
    if "\\" in value:
        return f"Write the path with slashes: {key} = {value.replace(chr(92), '/')}"
    if line.startswith(("//", ";", "%", "--")):
        return f"A comment begins with #: # {line.lstrip('/;%- ')}"
    if line.startswith("{"):
        return "It is JSON. Write a table as [ball], then a line for each key: mass = '0.35 kg'."
    if equals and not value:
        return f"Write the value of {key}, or delete the line."
    if not equals and (pair := re.fullmatch(r"([\w.]+)(?::|\s)\s*(.*)", line)):
        # as in YAML and INI files
        text = pair[2].strip("\"' ")
        return (
            f'Write {pair[1]} = "{text}"' if text else f"Write the name of a table as [{pair[1]}]"
        )
    if equals and re.fullmatch(r'"?\w[^"#]*"?', value) and value.count('"') < 2:
        return f'Write the text between two quotation marks: {key} = "{value.strip(chr(34))}"'
    return 'A line reads key = value, with texts in quotes: diameter = "0.2 m".'


def _require_sizes(held: object, name: str, place: str) -> None:
    """Reject integers beyond TOML's 64 bits, which may exceed the range of a float."""
    if isinstance(held, dict):
        for key, value in held.items():
            _require_sizes(value, name, f"{place}.{key}" if place else str(key))
    elif isinstance(held, list):
        for value in held:
            _require_sizes(value, name, place)
    elif isinstance(held, int) and held.bit_length() > _TOML_BITS:
        raise SetupError(
            f"{name}: {_shortened(place)} is a whole number of {len(str(abs(held)))} digits",
            hint="Whole numbers have 19 digits at most; write a larger one as 1.5e30.",
        )


_TOML_BITS = 63
"""Bits of an integer without its sign (convention: TOML v1.0.0)."""
_DISK_ERRORS = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS})


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path; its content gets the name `path` only if the block succeeds.

    Parameters
    ----------
    path : Path
        The final file. The temporary one keeps its suffix, which encoders depend on.

    Yields
    ------
    Path
        Path to write to.

    Raises
    ------
    OutputError
        If the folder does not exist or can't be written to, or the disk is full.
    """
    direct = _is_special(path)
    target = path if direct else Path(os.path.realpath(path))
    folder = Path(tempfile.gettempdir()) if direct else target.parent
    # The name is set before the file exists: a signal in between leaves nothing behind.
    temporary = folder / f".{path.stem[:40]}-{secrets.token_hex(6)}{path.suffix}"
    try:
        with _system_errors(path):
            temporary.touch(mode=0o600, exist_ok=False)
        with _system_errors(path, _DISK_ERRORS):
            yield temporary
        with _system_errors(path):
            if direct:
                _pour(temporary, target)
            else:
                os.chmod(temporary, _mode_of(target))
                os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def write_text_whole(path: Path, text: str) -> None:
    """Write a UTF-8 text file atomically; bytes of file names that are none become escapes."""
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


def write_each(writers: Iterable[Callable[[], object]]) -> None:
    """Write several files; one that can't be written does not stop the others.

    Raises
    ------
    ImpactVisionError
        The first problem, with the messages of all; `OutputError` if any is one.
    """
    problems: list[ImpactVisionError] = []
    for write in writers:
        try:
            write()
        except ImpactVisionError as problem:
            problems.append(problem)
    if problems:
        first = min(problems, key=lambda one: not isinstance(one, OutputError))
        raise type(first)("\n".join(one.message for one in problems), hint=first.hint)


def refuse_unwritable(path: Path) -> None:
    """Raise if a file can't be written, before its content is computed.

    Raises
    ------
    OutputError
        If its folder does not exist or can't be written to, or a folder has that name.
    """
    if _is_special(path):
        return
    with _system_errors(path):
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder")
        if not target.parent.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"the folder {path.parent} does not exist")
        if not os.access(target.parent, os.W_OK):
            raise PermissionError(errno.EACCES, f"you may not write to {target.parent}")


@contextmanager
def _system_errors(path: Path, codes: frozenset[int] | None = None) -> Iterator[None]:
    """Convert a system error to `OutputError`; with `codes`, only these errors."""
    try:
        yield
    except OSError as problem:
        if codes is not None and problem.errno not in codes:
            raise
        raise OutputError(
            f"can't write {shown_path(path)}: {problem.strerror or problem}",
            hint="Choose a file in an existing folder that you may write to, on a disk with space.",
        ) from problem


def _is_special(path: Path) -> bool:
    """Whether it is an open stream, or neither a file nor a folder."""
    if path.is_absolute() and path.parts[1:2] in (("dev",), ("proc",)):
        return True
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _pour(source: Path, target: Path) -> None:
    with source.open("rb") as content, _opened_special(target) as out:
        while block := content.read(1 << 20):
            rest = memoryview(block)
            while rest:
                rest = rest[out.write(rest) or 0 :]


_MAX_READER_WAIT_S = 5.0
"""Time that a pipe waits for its reader, s (chosen: a shell starts both ends within a second)."""


def _opened_special(target: Path) -> BinaryIO:
    """Open a device, or a pipe once something reads it."""
    until = time.monotonic() + _MAX_READER_WAIT_S
    while True:
        try:
            out = os.open(target, os.O_WRONLY | os.O_APPEND | getattr(os, "O_NONBLOCK", 0))
        except OSError as problem:
            if problem.errno != errno.ENXIO or not target.is_fifo():
                raise
            if time.monotonic() > until:
                raise OSError(errno.ENXIO, "nothing reads this pipe") from problem
            time.sleep(0.05)
            continue
        os.set_blocking(out, True)
        return open(out, "ab", buffering=0)


def _mode_of(target: Path) -> int:
    """Mode of the existing file; otherwise the default of the user's mask."""
    try:
        return stat.S_IMODE(target.stat().st_mode)
    except OSError:
        mask = os.umask(0o077)
        os.umask(mask)
        return 0o666 & ~mask


_UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")
"""Characters that terminals, spreadsheets, XML or UTF-8 can't hold; tab and line feed are none."""


def printable(text: str) -> str:
    """Text with each control character or lone surrogate replaced by ``�``."""
    return _UNPRINTABLE.sub("\ufffd", text)


def shown_path(path: str | Path) -> str:
    """A path for a message, shortened if long."""
    return _shortened(printable(str(path)))


def _shortened(text: str) -> str:
    return text if len(text) <= 200 else f"{text[:80]}…{text[-80:]} ({len(text)} characters)"
