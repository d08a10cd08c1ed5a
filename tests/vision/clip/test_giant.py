"""Pictures too large to work with are refused by their header, before anything is unpacked."""

import io
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from metrology import ClipError
from vision.clip.clip import ClipReader
from vision.clip.picture import decoded_image, refuse_giant


def _png(width: int, height: int) -> bytes:
    """A PNG that says it is so large, and holds nothing of it."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        check = zlib.crc32(kind + data)
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", check)

    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")


@pytest.mark.parametrize("size", [(60_000, 60_000), (30_000, 30_000), (40_000, 64), (64, 40_000)])
def test_a_giant_is_refused_by_its_header(size: tuple[int, int], tmp_path: Path) -> None:
    for number in range(3):
        (tmp_path / f"{number}.png").write_bytes(_png(*size))
    with pytest.raises(ClipError, match="too large to work with"):
        ClipReader.open(tmp_path)


def test_the_largest_sensors_are_let_in() -> None:
    refuse_giant(5_000, 9_000)
    refuse_giant(16, 32_766)
    refuse_giant(8_192, 8_192)
    with pytest.raises(ClipError, match="67 million"):
        refuse_giant(8_193, 8_192)


def test_what_is_no_image_is_none_and_an_image_is_itself() -> None:
    picture = np.arange(48, dtype=np.uint8).reshape(6, 8)
    held = io.BytesIO(cv2.imencode(".png", picture)[1].tobytes()).getvalue()
    found = decoded_image(held, cv2.IMREAD_UNCHANGED, "a.png")
    np.testing.assert_array_equal(found, picture)
    assert decoded_image(b"", cv2.IMREAD_UNCHANGED, "a.png") is None
    assert decoded_image(b"nothing", cv2.IMREAD_UNCHANGED, "a.png") is None
    assert decoded_image(_png(20, 20), cv2.IMREAD_UNCHANGED, "a.png") is None
