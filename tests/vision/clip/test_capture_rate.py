"""Which rate is taken for the camera's, by rank, and how sure it is."""

from dataclasses import replace

import pytest

from metrology import UsageError
from tests.vision.clip.written_clips import moving_disc, write_clip
from vision.clip.clip import ClipReader, capture_fps_in_tags
from vision.clip.footage import choose_capture_rate


@pytest.fixture
def info(tmp_path):
    return ClipReader.open(write_clip(tmp_path / "a.mp4", moving_disc(3))).info


def test_rank(info):
    told = replace(info, capture_fps_metadata=240.0)
    fast = replace(info, container_fps=239.76)
    assert choose_capture_rate(told, 300.0, 500.0).source == "option"
    assert choose_capture_rate(told, None, 500.0).fps == 500.0
    assert choose_capture_rate(told).source == "metadata"
    assert choose_capture_rate(replace(told, container_fps=120.0)).fps == 240.0
    assert choose_capture_rate(fast).source == "container"
    assert choose_capture_rate(replace(info, container_fps=119.88)).source == "container"


def test_assumption_is_loud(info):
    rate = choose_capture_rate(info)
    assert (rate.fps, rate.source) == (600.0, "assumed")
    # nothing is known of it: no seconds, no speeds
    assert not rate.known
    assert "assumed" in rate.notice
    assert "--fps" in rate.notice
    assert "30 frames per second" in rate.notice


def test_contradiction_is_said(info):
    told = replace(info, capture_fps_metadata=240.0)
    assert "240 fps" in choose_capture_rate(told, 600.0).notice
    assert choose_capture_rate(told, 240.0).notice is None


def test_a_nominal_rate_covers_the_broadcast_one(info):
    rate = choose_capture_rate(info, 600.0)
    assert 0.5 * 0.6 < 3**0.5 * 2 * rate.std < 1.1 * 0.6
    assert choose_capture_rate(info, 600.0, option_std=0.01).std == 0.01


def test_the_rate_of_woven_pictures_is_half_that_of_their_fields(info):
    woven = replace(info, weave="top_first", container_fps=59.94)
    of_pictures, of_fields = (choose_capture_rate(woven, rate) for rate in (29.97, 59.94))
    assert of_pictures.fps == pytest.approx(59.94)
    assert of_pictures.notice is not None
    assert of_fields.fps == 59.94
    assert of_fields.notice is None
    assert choose_capture_rate(woven, None, 30.0, setup_std=0.01).std == 0.02
    assert choose_capture_rate(replace(info, container_fps=59.94), 29.97).fps == 29.97


@pytest.mark.parametrize("wrong", [0.0, -30.0, float("nan"), float("inf")])
def test_senseless_rates_are_refused(info, wrong):
    with pytest.raises(UsageError):
        choose_capture_rate(info, wrong)


def test_android_tag_is_read_from_the_file(tmp_path):
    path = write_clip(
        tmp_path / "slow.mp4", moving_disc(3), metadata={"com.android.capture.fps": "240.000000"},
        container_options={"movflags": "use_metadata_tags"},
    )  # fmt: skip
    assert ClipReader.open(path).info.capture_fps_metadata == 240.0


def test_sony_sidecar_and_embedded_xml(tmp_path):
    path = write_clip(tmp_path / "C0001.mp4", moving_disc(3))
    assert ClipReader.open(path).info.capture_fps_metadata is None
    xml = b'<VideoFormat><VideoFrame captureFps="959.04p" formatFps="23.98p"/></VideoFormat>'
    sidecar = tmp_path / "C0001M01.XML"
    sidecar.write_bytes(xml)
    assert ClipReader.open(path).info.capture_fps_metadata == 959.04
    sidecar.unlink()
    # A box that players skip, as the camera writes it.
    path.write_bytes(path.read_bytes() + (len(xml) + 8).to_bytes(4) + b"free" + xml)
    assert ClipReader.open(path).info.capture_fps_metadata == 959.04


def test_tags_that_are_no_rate():
    assert capture_fps_in_tags({"capture_fps": "unknown", "title": "capture"}) is None
    assert capture_fps_in_tags({"CAPTURE_FRAME_RATE": "60000/1001"}) == pytest.approx(
        59.94, abs=0.01
    )
