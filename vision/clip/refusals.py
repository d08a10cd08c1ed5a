"""Refusals of files that are no clips: what they are, and what to pass instead."""

import os
import re
from difflib import get_close_matches
from itertools import islice
from pathlib import Path

from metrology import ClipError
from metrology.files import starts_as_text
from vision.clip.images import is_image

__all__ = ["missing", "too_few", "undecodable", "unreadable"]

_PHOTRON = (
    "a raw recording of Photron",
    "Convert it with Photron FASTCAM Viewer: save as AVI, or as TIFF images in a folder.",
)
_UNSUPPORTED = {
    ".mraw": _PHOTRON,
    ".cih": _PHOTRON,
    ".cihx": _PHOTRON,
    ".r3d": ("a raw recording of RED", "Export it as ProRes or MP4 with REDCINE-X."),
    ".braw": ("a raw recording of Blackmagic", "Export it as ProRes or MP4 with its player."),
    ".seq": ("a recording of NorPix", "Export it as AVI or TIFF images with StreamPix."),
    ".insv": ("a recording of Insta360", "Export a flat MP4 with Insta360 Studio."),
    ".dng": ("a raw photograph", "Convert all pictures to TIFF or PNG in a folder."),
    ".heic": ("a photograph", "Pass the video; a live photo's is the MOV file of the same name."),
    ".zip": ("a packed archive", "Unpack it and pass the video, or the folder of images."),
    ".rar": ("a packed archive", "Unpack it and pass the video, or the folder of images."),
    ".7z": ("a packed archive", "Unpack it and pass the video, or the folder of images."),
}
"""Formats that can't be read, by suffix: what they are, and how to convert them."""


def _recognised(path: Path, head: bytes) -> ClipError | None:
    """Refusal of a known format."""
    named = _UNSUPPORTED.get(path.suffix.lower())
    if named is not None:
        return ClipError(f"{path} is {named[0]}, which is not supported", hint=named[1])
    if head.startswith(b"CI"):
        return ClipError(
            f"{path} is a recording of Phantom that can't be decoded",
            hint="Convert it with Phantom Camera Control (PCC): save as AVI, or as 16 bit TIFF.",
        )
    if (head and starts_as_text(head)) or head.startswith((b"PK", b"\x89HDF")):
        return ClipError(
            f"{path} holds text or a table, not pictures",
            hint=f"Pass tracks of another program so: vision measure --from-tracks {path}",
        )
    return None


def _head(path: Path) -> bytes:
    if not os.access(path, os.R_OK):
        return b""
    with path.open("rb") as file:
        return file.read(_HEAD_BYTES)


_HEAD_BYTES = 4096
"""Bytes by which text is recognised (chosen: binary files have a zero among the first hundred)."""


def missing(place: Path) -> ClipError:
    """Why there is no such file, by its name and its neighbours."""
    hint = "Check the name and the folder."
    if re.match(r"\w{2,}:/", str(place)):
        hint = "It is an address: download the video first, and pass the file."
    elif os.path.lexists(place.with_name(f".{place.name}.icloud")):
        hint = "It is in iCloud alone: download it in the Files app or the Finder."
    elif re.search(r"[*?%]", place.name):
        hint = f"It is a pattern of names: pass the folder of the pictures, {place.parent}."
    elif alike := get_close_matches(place.name, [one.name for one in _neighbours(place)], n=1):
        hint = f"Did you mean {alike[0]}? {hint}"
    return ClipError(f"there is no file {place}", hint=hint)


def too_few(place: Path, frames: int) -> ClipError:
    """A recording of too few pictures for any motion."""
    hint = "Pass the whole recording."
    if is_image(place) and (others := sum(map(is_image, _neighbours(place)))) > 1:
        hint = f"It is one picture of {others}: pass their folder, {place.parent}."
    return ClipError(
        f"{place} has {frames} frame{'s' * (frames > 1)}, too few to show a motion", hint=hint
    )


def _neighbours(place: Path) -> list[Path]:
    try:
        return list(islice(place.parent.iterdir(), _MAX_NEIGHBOURS))
    # no such folder, or no permission to list it
    except (OSError, ValueError):
        return []


_MAX_NEIGHBOURS = 1000
"""Names of a folder compared with a missing one (chosen)."""


def undecodable(path: Path) -> ClipError:
    """A file whose container is read, but none of its pictures."""
    return _recognised(path, _head(path)) or ClipError(
        f"no picture of {path} can be decoded",
        hint="The file is damaged. Copy it from the camera again.",
    )


def unreadable(path: Path, problem: str | None = None) -> ClipError:
    """A file that is no container of pictures."""
    head = _head(path)
    if (named := _recognised(path, head)) is not None:
        return named
    if head[4:8] in (b"ftyp", b"mdat", b"wide", b"moov", b"free", b"skip"):
        return ClipError(
            f"{path} is cut off: its index (moov) is missing or broken",
            hint="The recording was not finished or not copied completely. Copy it from the camera "
            "again; if that does not help, a repair tool such as untrunc can rebuild the index.",
        )
    return ClipError(
        f"{path} cannot be read as a video ({problem or 'unknown format'})",
        hint="Readable formats: MP4, MOV, AVI, MKV, MJPEG and folders of images. The file may have "
        "a wrong suffix, or be damaged at its beginning.",
    )
