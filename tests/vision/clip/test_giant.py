"""Very large pictures: shrunk where that loses nothing, refused by their header where not."""

import io
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from metrology import ClipError
from tests.vision.clip.written_clips import write_clip
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
    with pytest.raises(ClipError, match="too large to measure"):
        ClipReader.open(tmp_path)


def test_the_largest_sensors_are_let_in() -> None:
    refuse_giant(5_000, 9_000)
    refuse_giant(16, 32_766)
    refuse_giant(8_192, 8_192)
    with pytest.raises(ClipError, match="67 million"):
        refuse_giant(8_193, 8_192)


def _spotted(count: int) -> list[NDArray[np.uint8]]:
    """Pictures of 2700 × 1801 px with a soft spot that goes on by 40 px, first at 1200, 600."""
    row, column = np.arange(1801.0)[:, None], np.arange(2700.0)
    return [
        np.round(
            200.0 * np.exp(-((column - 1200 - 40 * k) ** 2 + (row - 600) ** 2) / (2 * 30.0**2))
        ).astype(np.uint8)
        for k in range(count)
    ]


def _middle(picture: NDArray[np.generic]) -> NDArray[np.float64]:
    weight = picture.astype(np.float64)
    row, column = np.indices(picture.shape)
    return np.array([(weight * column).sum(), (weight * row).sum()]) / weight.sum()


@pytest.mark.parametrize(("folder", "turned"), [(True, None), (False, None), (False, 90)])
def test_very_large_pictures_are_measured_at_a_third_of_their_size(
    tmp_path: Path, folder: bool, turned: int | None
) -> None:
    if folder:
        for k, picture in enumerate(_spotted(3)):
            cv2.imwrite(str(tmp_path / f"{k}.png"), picture)
        path = tmp_path
    else:
        stored = _spotted(3) if turned is None else [np.rot90(one, -1) for one in _spotted(3)]
        even = [np.ascontiguousarray(one[:, :-1] if turned else one[:-1]) for one in stored]
        path = write_clip(
            tmp_path / "large.mp4",
            even,
            options={"qp": "0", "preset": "ultrafast"},
            rotation=turned,
        )
    clip = ClipReader.open(path)
    assert (clip.info.width, clip.info.height) == (900, 600)
    assert "2700 × 180" in clip.warnings[0]
    assert "900 × 600" in clip.warnings[0]
    for k, frame in enumerate(clip.frames()):
        # the middle of pixels 3i to 3i + 2 lies at 3i + 1; a turned picture lost its first row
        there = np.array([1200.0 + 40 * k, 600.0 - (turned is not None)])
        np.testing.assert_allclose(_middle(frame.gray), (there - 1.0) / 3.0, atol=0.02)
    assert next(clip.colour_frames())[1].shape == (600, 900, 3)
    whole = ClipReader.open(path, whole=True)
    assert whole.warnings == ()
    assert next(whole.frames()).gray.shape == (whole.info.height, whole.info.width)
    assert whole.info.width == 2700


def test_a_large_video_is_decoded_once_and_read_alike_where_it_does_not_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = [one[:-1] for one in _spotted(30)]
    path = write_clip(tmp_path / "a.mp4", stored, options={"preset": "ultrafast"})
    clip = ClipReader.open(path)
    first = [frame.gray for frame in clip.frames()]
    kept = path.read_bytes()
    path.unlink()
    assert len(first) == 30
    np.testing.assert_array_equal([frame.gray for frame in clip.frames()], first)
    path.write_bytes(kept)
    monkeypatch.setattr("vision.clip.reduced._MAX_KEPT_BYTES", 5_000_000)
    short = ClipReader.open(path)
    for _ in range(2):
        frames = list(short.frames())
        assert [frame.index for frame in frames] == list(range(30))
        np.testing.assert_array_equal([frame.gray for frame in frames], first)


def test_what_is_no_image_is_none_and_an_image_is_itself() -> None:
    picture = np.arange(48, dtype=np.uint8).reshape(6, 8)
    held = io.BytesIO(cv2.imencode(".png", picture)[1].tobytes()).getvalue()
    found = decoded_image(held, cv2.IMREAD_UNCHANGED, "a.png")
    np.testing.assert_array_equal(found, picture)
    assert decoded_image(b"", cv2.IMREAD_UNCHANGED, "a.png") is None
    assert decoded_image(b"nothing", cv2.IMREAD_UNCHANGED, "a.png") is None
    assert decoded_image(_png(20, 20), cv2.IMREAD_UNCHANGED, "a.png") is None
