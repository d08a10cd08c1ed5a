"""Bars burnt into pictures are cut off when a clip is opened."""

import cv2
import numpy as np
import pytest

from tests.vision.clip.written_clips import moving_disc, woven, write_clip
from vision.clip.clip import ClipReader

PICTURES = moving_disc(12)


def padded(pictures, bars, level=0):
    left, top, right, bottom = bars
    around = ((top, bottom), (left, right))
    return [np.pad(picture, around, constant_values=level) for picture in pictures]


@pytest.mark.parametrize("level", [0, 200])
@pytest.mark.parametrize("bars", [(0, 30, 0, 30), (140, 0, 142, 0), (40, 30, 40, 30), (0, 0, 0, 8)])
def test_the_scene_between_bars_is_read(tmp_path, bars, level):
    path = write_clip(
        tmp_path / "a.mkv", padded(PICTURES, bars, level), codec="ffv1", pix_fmt="gray"
    )
    clip = ClipReader.open(path)
    assert clip.info.bars == bars
    assert (clip.info.width, clip.info.height) == (160, 120)
    for frame, (_, colour), picture in zip(
        clip.frames(), clip.colour_frames(), PICTURES, strict=True
    ):
        assert np.abs(frame.gray.astype(int) - picture).max() <= 1
        assert colour.shape == (*picture.shape, 3)
    assert f"column {bars[0]} and line {bars[1]} of" in clip.warnings[0]
    whole = ClipReader.open(path, whole=True)
    assert (whole.info.width, whole.info.height) == clip.info.whole_size
    assert whole.warnings == ()


@pytest.mark.parametrize("crf", [12, 35])
def test_bars_of_a_coded_clip_are_found_where_they_are(tmp_path, crf):
    pictures = padded(PICTURES, (44, 30, 36, 22))
    clip = ClipReader.open(write_clip(tmp_path / "a.mp4", pictures, options={"crf": str(crf)}))
    assert clip.info.bars == (44, 30, 36, 22)


def test_bars_of_images_fields_and_turned_clips(tmp_path):
    bars = (20, 10, 30, 40)
    for number, picture in enumerate(padded(PICTURES, bars)):
        cv2.imwrite(str(tmp_path / f"{number}.png"), picture)
    clip = ClipReader.open(tmp_path)
    assert clip.info.bars == bars
    assert np.array_equal(next(clip.frames()).gray, PICTURES[0])
    fields = woven(padded(PICTURES, bars))
    path = write_clip(tmp_path / "f.mkv", fields, codec="ffv1", pix_fmt="gray")
    clip = ClipReader.open(path, fields="top_first")
    assert (clip.info.bars, clip.info.frames) == (bars, 12)
    top = next(clip.frames()).gray[::2].astype(int)
    assert np.abs(top - PICTURES[0][::2]).max() <= 1
    clip = ClipReader.open(
        write_clip(tmp_path / "t.mp4", padded(PICTURES, bars), options={"crf": "8"}, rotation=90)
    )
    assert sorted(clip.info.bars) == sorted(bars)
    assert clip.info.bars != bars
    assert next(clip.frames()).gray.shape == (160, 120)


def test_black_that_an_object_enters_is_no_bar(tmp_path):
    pictures = padded(PICTURES, (0, 30, 0, 0))
    cv2.circle(pictures[-1], (80, 12), 8, 255, -1)
    clip = ClipReader.open(write_clip(tmp_path / "a.mkv", pictures, codec="ffv1", pix_fmt="gray"))
    assert clip.info.height == 150 - clip.info.bars[1]
    assert clip.info.bars[1] <= 4


@pytest.mark.parametrize("velocity", [(5, 0), (0, 4), (4, 3)])
def test_an_object_before_black_has_no_bars(tmp_path, velocity):
    pictures = [np.zeros((120, 160), np.uint8) for _ in range(18)]
    for number, picture in enumerate(pictures):
        # at rest first
        x, y = (40 + max(number - 6, 0) * velocity[0], 40 + max(number - 6, 0) * velocity[1])
        cv2.circle(picture, (x, y), 10, 255, -1)
    clip = ClipReader.open(write_clip(tmp_path / "a.mkv", pictures, codec="ffv1", pix_fmt="gray"))
    assert (clip.info.width, clip.info.height) == (160, 120)
    assert clip.warnings == ()


def test_shading_has_no_bars(tmp_path):
    ramp = np.tile(np.linspace(0, 255, 160), (120, 1)).astype(np.uint8)
    clip = ClipReader.open(write_clip(tmp_path / "a.mkv", [ramp] * 4, codec="ffv1", pix_fmt="gray"))
    assert clip.info.bars == (0, 0, 0, 0)
