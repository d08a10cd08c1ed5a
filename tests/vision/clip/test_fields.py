"""Woven fields: seen without a flag, separated in the right order, each on its own lines."""

import numpy as np
import pytest

from tests.shared_data import shared_folder
from tests.vision.clip.written_clips import HEIGHT, moving_disc, scene, woven, write_clip
from vision.clip.clip import ClipReader, separate_field
from vision.following import follow

LOSSLESS = {"qp": "0", "preset": "ultrafast"}


def centroid(gray):
    weight = np.clip(gray.astype(float) - 190, 0, None)
    rows, columns = np.indices(gray.shape)
    return (weight * columns).sum() / weight.sum(), (weight * rows).sum() / weight.sum()


@pytest.mark.parametrize("bottom_first", [False, True])
def test_woven_fields_are_found_and_separated(tmp_path, bottom_first):
    fields = moving_disc(40, 2.0)
    path = write_clip(
        tmp_path / "i.mp4", woven(fields, bottom_first=bottom_first), options=LOSSLESS
    )
    clip = ClipReader.open(path)
    assert clip.info.weave == ("bottom_first" if bottom_first else "top_first")
    assert clip.info.interlaced
    assert clip.info.frames == 40
    assert clip.info.container_fps == pytest.approx(60)
    assert any("half-line offset" in warning for warning in clip.warnings)
    frames = list(clip.frames())
    assert [frame.time_s for frame in frames] == pytest.approx(np.arange(40) / 60)
    found = np.array([centroid(frame.gray) for frame in frames])
    true = np.array([centroid(field) for field in fields])
    # A wrong order or half-line offset would be 1 px or 2 px in every second frame.
    assert np.abs(found - true).max() < 0.15
    assert frames[0].gray.shape[0] == HEIGHT


@pytest.mark.parametrize("name", ["jokku_90_small", "basketball_120_dim"])
def test_fields_are_seen_through_codec_noise_and_flicker(tmp_path, name):
    whole = ClipReader.open(shared_folder("rendered") / name / "clip.mp4")
    assert whole.info.weave == "progressive"
    fields = [frame.gray for frame in whole.frames(0, 180)]
    path = write_clip(tmp_path / "i.mp4", woven(fields, bottom_first=True), options={"crf": "20"})
    assert ClipReader.open(path).info.weave == "bottom_first"


def test_progressive_pictures_are_left_alone(tmp_path):
    path = write_clip(tmp_path / "p.mp4", moving_disc(40, 2.0), options={"crf": "23"})
    assert ClipReader.open(path).info.weave == "progressive"


def _drop() -> tuple[list[np.ndarray], np.ndarray]:
    """Twenty-six pictures of a disc that falls freely, and its places."""
    rng = np.random.default_rng(5)
    places = np.array([(150.0, 25.0 + 0.28 * k**2) for k in range(26)])
    pictures = [
        np.clip(scene(x, y, size=(320, 240)) + rng.normal(0.0, 1.5, (240, 320)), 0, 255)
        for x, y in places
    ]
    return [picture.astype(np.uint8) for picture in pictures], places


@pytest.mark.parametrize("bottom_first", [False, True])
def test_a_woven_drop_of_half_a_second_is_followed_field_by_field(tmp_path, bottom_first):
    fields, places = _drop()
    path = write_clip(
        tmp_path / "i.mp4", woven(fields, bottom_first=bottom_first), options={"crf": "20"}
    )
    clip = ClipReader.open(path)
    assert clip.info.weave == ("bottom_first" if bottom_first else "top_first")
    ball = follow(clip, 60.0).ball
    assert len(ball) >= 22
    # on the place of the neighbouring field a ball at the end would lie 14 px off; half the height,
    # coded anew, leaves its outline up to a pixel
    assert np.hypot(*(ball.centre_px - places[ball.frame]).T).max() < 2.0


def test_a_short_drop_of_whole_pictures_is_left_alone(tmp_path):
    path = write_clip(tmp_path / "p.mp4", _drop()[0], options={"crf": "20"})
    assert ClipReader.open(path).info.weave == "progressive"


def test_a_still_clip_is_progressive(tmp_path):
    rng = np.random.default_rng(3)
    still = [
        np.clip(scene(60, 60) + rng.normal(0, 4, (HEIGHT, 160)), 0, 255).astype(np.uint8)
        for _ in range(20)
    ]
    path = write_clip(tmp_path / "s.mp4", still)
    assert ClipReader.open(path).info.weave == "progressive"


def test_declared_fields_are_believed_where_nothing_moves(tmp_path):
    options = {"flags": "+ildct+ilme", "x264-params": "tff=1:interlaced=1"}
    path = write_clip(tmp_path / "d.mp4", [scene(60, 60)] * 10, options=options)
    clip = ClipReader.open(path)
    assert clip.info.interlaced
    assert clip.info.frames == 20


def test_the_user_may_say_otherwise(tmp_path):
    fields = moving_disc(20, 2.0)
    path = write_clip(tmp_path / "i.mp4", woven(fields), options=LOSSLESS)
    assert ClipReader.open(path, fields="progressive").info.frames == 10
    assert ClipReader.open(path, fields="bottom_first").info.weave == "bottom_first"


def test_a_ramp_survives_separation():
    ramp = np.tile(np.arange(0, 200, 2, dtype=np.uint8)[:, None], (1, 8))
    for bottom in (False, True):
        field = separate_field(ramp, bottom)
        assert np.array_equal(field[1:-1], ramp[1:-1])


def test_capture_times_count_fields(tmp_path):
    path = write_clip(tmp_path / "i.mp4", woven(moving_disc(40, 2.0)), options=LOSSLESS)
    clip = ClipReader.open(path)
    assert clip.capture_times(600.0) == pytest.approx(np.arange(40) / 600)
    list(clip.frames())
    assert clip.capture_times(600.0) == pytest.approx(np.arange(40) / 600)
