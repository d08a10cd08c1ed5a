"""XML and ZIP files of strangers, opened so that none of them can take the machine with it."""

import zipfile
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from metrology import UsageError

__all__ = ["numbers", "read_bytes", "read_member", "root_of", "text_of"]

LARGEST_BYTES = 256 * 2**20
"""256 MiB: a track of a million marks in Tracker's XML is below 200."""
_MOST = f"{LARGEST_BYTES >> 20} MiB at most"


def read_bytes(path: Path, what: str) -> bytes:
    """All of a file.

    Raises
    ------
    UsageError
        If it can't be read, or is too large to be `what`.
    """
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise UsageError(
                f"{path} is too large to be {what} ({LARGEST_BYTES >> 20} MiB at most)"
            )
        return path.read_bytes()
    except OSError as problem:
        raise UsageError(f"can't read {path}: {problem.strerror}") from problem


def root_of(data: bytes, path: Path, what: str) -> Element:
    """Root of an XML document; entities and external references are refused.

    Raises
    ------
    UsageError
        If it is broken, or does what no file of tracks does.
    """
    try:
        root: Element = fromstring(data, forbid_dtd=True)
    except DefusedXmlException as problem:
        raise UsageError(
            f"{path} declares XML entities, which no {what} does; it was not read",
            hint="Save it anew from the program that made it.",
        ) from problem
    except (ParseError, LookupError, ValueError) as problem:
        raise UsageError(
            f"{path} is no {what}: {problem}",
            hint="Is it cut off? Save it anew from the program that made it.",
        ) from problem
    return root


def read_member(path: Path, suffix: str, what: str) -> bytes:
    """The one file of a ZIP whose name ends in `suffix`.

    Raises
    ------
    UsageError
        If the archive is broken, holds no such file, or one that unpacks to more than can be.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            inside = [one for one in archive.infolist() if one.filename.lower().endswith(suffix)]
            if not inside:
                raise UsageError(f"{path} holds no {suffix} file", hint=f"It is no {what}.")
            if len(inside) > 1:
                names = ", ".join(one.filename for one in inside[:4])
                raise UsageError(
                    f"{path} holds several {suffix} files: {names}",
                    hint="Unpack it and name the one that is meant.",
                )
            # as much as may be and one byte: what its directory says of its size may be a lie
            with archive.open(inside[0]) as file:
                data = file.read(LARGEST_BYTES + 1)
    except (zipfile.BadZipFile, zipfile.LargeZipFile, EOFError, RuntimeError, OSError) as problem:
        raise UsageError(
            f"{path} is no whole {what}: {problem}",
            hint="Is it cut off? Save it anew from the program that made it.",
        ) from problem
    except NotImplementedError as problem:
        raise UsageError(f"{path} is packed in a way that can't be read: {problem}") from problem
    if len(data) > LARGEST_BYTES:
        raise UsageError(f"{inside[0].filename} in {path} is too large ({LARGEST_BYTES >> 20} MiB)")
    return data


def text_of(parent: Element, name: str) -> str | None:
    """Text of the first child `name`, None where there is none."""
    child = parent.find(name)
    return None if child is None or child.text is None else child.text.strip()


def numbers(text: str | None, count: int) -> tuple[float, ...] | None:
    """``"x;y;t"`` as numbers; None where it is not so many."""
    if text is None:
        return None
    try:
        values = tuple(float(part) for part in text.split(";"))
    except ValueError:
        return None
    return values[:count] if len(values) >= count else None
