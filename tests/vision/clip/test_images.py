"""Sequences of images: animated WebP, TIFF stacks, raw mosaics, and every n-th picture."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from metrology import ClipError
from tests.vision.clip.written_clips import write_clip
from vision.clip.clip import ClipReader
from vision.clip.mosaic import mosaic_of

SIZE = (96, 128)


def scene(number: int) -> np.ndarray:
    """A smooth coloured background and a ball that moves."""
    rows, columns = np.indices(SIZE)
    picture = np.stack([60 + 0.4 * columns, 110 + 0.3 * rows, 90 + 0.3 * columns], axis=-1)
    apart = np.hypot(columns - 20 - 6 * number, rows - 40)
    return np.where(apart[..., np.newaxis] < 9, [40, 120, 220], picture).astype(np.uint8)


def raw(picture: np.ndarray, *, green_first: bool) -> np.ndarray:
    filters = [[1, 0], [2, 1]] if green_first else [[0, 1], [1, 2]]
    mosaic = np.empty(picture.shape[:2], np.uint16)
    for row in range(2):
        for column in range(2):
            mosaic[row::2, column::2] = picture[row::2, column::2, filters[row][column]]
    return mosaic * 16


def test_an_animated_webp_is_read_picture_by_picture(tmp_path: Path) -> None:
    path = tmp_path / "moving.bin"
    frames = [Image.fromarray(scene(k)[:, :, ::-1]) for k in range(6)]
    frames[0].save(
        path, "WEBP", save_all=True, append_images=frames[1:], duration=33, lossless=True
    )
    clip = ClipReader.open(path)
    assert (clip.info.frames, clip.info.width, clip.info.height) == (6, 128, 96)
    assert not clip.info.container_declares_rate
    for (index, colour), frame in zip(clip.colour_frames(), clip.frames(), strict=True):
        assert np.array_equal(colour, scene(index))
        assert frame.gray.shape == SIZE
    assert clip.capture_times(100.0) == pytest.approx(np.arange(6) / 100.0)
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(ClipError):
        ClipReader.open(path)


@pytest.mark.parametrize("green_first", [True, False])
def test_a_raw_mosaic_is_averaged(green_first: bool, tmp_path: Path) -> None:
    for k in range(4):
        cv2.imwrite(str(tmp_path / f"{k}.tif"), raw(scene(k), green_first=green_first))
    clip = ClipReader.open(tmp_path)
    assert any("raw" in text for text in clip.warnings)
    found = mosaic_of(raw(scene(0), green_first=green_first))
    assert found is not None
    assert found.green_first is green_first
    gray = next(iter(clip.frames())).gray.astype(float)
    flat = gray[60:90, 60:120]
    assert np.abs(np.diff(flat, axis=1)).max() < 0.02 * flat.mean()
    true = scene(0).astype(float) @ [0.25, 0.5, 0.25] * 16
    assert np.median(np.abs(gray - true)) < 0.02 * np.median(true)
    colour = next(iter(clip.colour_frames()))[1]
    assert abs(float(colour[70, 90, 1]) - scene(0)[70, 90, 1]) < 4


def test_other_pictures_have_no_mosaic() -> None:
    noise = np.random.default_rng(1)
    assert mosaic_of(scene(0)) is None
    assert mosaic_of(cv2.cvtColor(scene(0), cv2.COLOR_BGR2GRAY)) is None
    assert mosaic_of(noise.integers(0, 255, SIZE).astype(np.uint8)) is None
    lines = np.tile([20, 20, 200, 200], (96, 32)).astype(np.uint8)
    assert mosaic_of(lines) is None
    assert mosaic_of(np.zeros(SIZE, np.uint8)) is None


def test_every_third_picture_keeps_the_camera_s_clock(tmp_path: Path) -> None:
    for k in range(10):
        cv2.imwrite(str(tmp_path / f"{k:03d}.png"), scene(k))
    clip = ClipReader.open(tmp_path, every=3)
    assert (clip.info.frames, clip.info.every) == (4, 3)
    assert clip.capture_times(600.0) == pytest.approx(np.array([0, 3, 6, 9]) / 600.0)
    seen = [colour for _, colour in clip.colour_frames()]
    assert all(np.array_equal(one, scene(3 * k)) for k, one in enumerate(seen))
    with pytest.raises(ClipError, match="1 frame"):
        ClipReader.open(tmp_path, every=10)


def test_a_tiff_stack_is_a_clip_of_its_pictures(tmp_path: Path) -> None:
    deep = [np.full((32, 40), 257 * level, dtype=np.uint16) for level in (10, 20, 30)]
    stack = [Image.fromarray(one) for one in deep]
    path = tmp_path / "stack.tif"
    stack[0].save(path, save_all=True, append_images=stack[1:])
    clip = ClipReader.open(path)
    assert (clip.info.frames, clip.info.bit_depth, clip.info.codec) == (3, 16, "tif")
    np.testing.assert_array_equal([frame.gray for frame in clip.frames()], deep)
    assert [image.max() for _, image in clip.colour_frames()] == [10, 20, 30]


def test_a_raw_video_is_averaged_over_its_filters(tmp_path: Path) -> None:
    pictures = []
    for k in range(3):
        levels = np.full((48, 64), 60, dtype=np.uint8)
        levels[0::2, 0::2], levels[1::2, 1::2] = 20, 140
        levels[10:30, 10 + 6 * k : 30 + 6 * k] += 80
        pictures.append(levels)
    clip = ClipReader.open(write_clip(tmp_path / "a.mkv", pictures, codec="ffv1", pix_fmt="gray"))
    assert any("mosaic of colour filters" in said for said in clip.warnings)
    for frame in clip.frames():
        assert float(np.ptp(frame.gray[34:44, 4:60])) <= 1
    blue, green, red = next(clip.colour_frames())[1][38, 30]
    found = [*sorted((int(blue), int(red))), int(green)]
    np.testing.assert_allclose(found, [20, 140, 60], atol=1)


def test_a_folder_of_videos_is_no_folder_of_images(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"")
    with pytest.raises(ClipError) as refused:
        ClipReader.open(tmp_path)
    assert "vision campaign" in str(refused.value.hint)


def numbered(folder: Path, name: str, shade: int, count: int = 8) -> None:
    folder.mkdir(exist_ok=True)
    for k in range(count):
        picture = np.full((40, 60), shade + k, np.uint8)
        cv2.imwrite(str(folder / name.format(k)), picture)


def test_other_files_in_a_folder_of_images(tmp_path: Path) -> None:
    folder = tmp_path / "images"
    numbered(folder, "img{:03d}.PNG", 60)
    for k in range(8):
        (folder / f"._img{k:03d}.png").write_bytes(b"\0\5\x16\7")
    cv2.imwrite(str(folder / "background.png"), np.zeros((20, 30), np.uint8))
    clip = ClipReader.open(folder)
    assert [int(frame.gray[0, 0]) for frame in clip.frames()] == list(range(60, 68))
    assert any("background.png" in warning for warning in clip.warnings)


def test_two_recordings_in_a_folder_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "images"
    numbered(folder, "left{:03d}.png", 60)
    numbered(folder, "right{:03d}.png", 90)
    with pytest.raises(ClipError, match="of 2 recordings: left000"):
        ClipReader.open(folder)


@pytest.mark.parametrize(
    ("name", "cure"), [("A{}.DNG", "convert them to TIFF"), ("a{}.mov", "holds videos")]
)
def test_a_folder_without_images_is_named_by_what_it_holds(
    tmp_path: Path, name: str, cure: str
) -> None:
    for k in range(8):
        (tmp_path / name.format(k)).write_bytes(b"x")
    with pytest.raises(ClipError) as refused:
        ClipReader.open(tmp_path)
    assert cure in str(refused.value)


@pytest.mark.parametrize(
    ("name", "head", "said"),
    [
        ("a.zip", b"PK\3\4", "Unpack it"),
        ("a.seq", b"\xed\xfe", "StreamPix"),
        ("a.cine", b"CI\x2c\0\1\0", "Phantom Camera Control"),
    ],
)
def test_files_that_are_not_read_name_their_export(
    tmp_path: Path, name: str, head: bytes, said: str
) -> None:
    path = tmp_path / name
    path.write_bytes(head + bytes(4000))
    with pytest.raises(ClipError) as refused:
        ClipReader.open(path)
    assert said in str(refused.value)
