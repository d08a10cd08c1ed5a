"""The camera's frame rate where the file tells it.

Known: Android's ``com.android.capture.fps`` (a ``moov/meta`` key, written for slow motion); Sony's
non-real-time metadata, an XML ``<VideoFrame … captureFps="959.04p"/>`` inside the file or beside it
as ``STEMM01.XML``; Matroska or other tags named like a capture rate. Apple's and GoPro's high-speed
modes keep the true rate as the container's own.
"""

import re
from collections.abc import Mapping
from pathlib import Path

__all__ = ["capture_fps_in_file", "capture_fps_in_tags"]

_TAG = re.compile(r"captur\w*[ ._-]?(fps|frame[ _-]?rate)", re.IGNORECASE)
_NUMBER = re.compile(r"(\d+(?:\.\d+)?)(?:\s*/\s*(\d+(?:\.\d+)?))?")
_SONY = re.compile(rb"captureFps\s*=\s*[\"'](\d+(?:\.\d+)?)[pi]?[\"']")
_LOOK_BYTES = 1 << 20


def capture_fps_in_tags(tags: Mapping[str, str]) -> float | None:
    """Find a capture rate among a container's tags, 1/s."""
    for key, value in tags.items():
        if _TAG.search(key):
            number = _NUMBER.match(value.strip())
            if number is not None:
                rate = float(number.group(1)) / float(number.group(2) or 1.0)
                if rate > 0:
                    return rate
    return None


def capture_fps_in_file(path: Path) -> float | None:
    """Find Sony's XML at the file's beginning or end, or in the file beside it, 1/s."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(0)
        parts = [file.read(_LOOK_BYTES)]
        if size > _LOOK_BYTES:
            file.seek(max(_LOOK_BYTES, size - _LOOK_BYTES))
            parts.append(file.read(_LOOK_BYTES))
    sidecar = path.with_name(f"{path.stem}M01.XML")
    if sidecar.is_file():
        parts.append(sidecar.read_bytes()[:_LOOK_BYTES])
    for part in parts:
        found = _SONY.search(part)
        if found is not None and float(found.group(1)) > 0:
            return float(found.group(1))
    return None
