"""HDR pictures show their light; formats that are not supported are named."""

from fractions import Fraction

import av
import numpy as np
import pytest

from metrology import ClipError
from tests.vision.clip.written_clips import scene
from vision.clip.clip import ClipReader


def pq(light):
    """Signal of a luminance, 1 at 10 000 cd/m² (SMPTE ST 2084)."""
    powered = light**0.1593017578125
    return ((0.8359375 + 18.8515625 * powered) / (1.0 + 18.6875 * powered)) ** 78.84375


def hlg(light):
    """Signal of scene light, 1 at the peak (ARIB STD-B67)."""
    upper = 0.17883277 * np.log(np.maximum(12.0 * light - 0.28466892, 1e-9)) + 0.55991073
    return np.where(light <= 1.0 / 12.0, np.sqrt(3.0 * light), upper)


def written(path, signal, transfer):
    """Three pictures (H, W) of 10 bit and limited range."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=30)
        stream.height, stream.width = signal.shape
        stream.pix_fmt = "yuv420p10le"
        stream.codec_context.color_range = 1
        stream.codec_context.color_trc = transfer
        for number in range(3):
            frame = av.VideoFrame(signal.shape[1], signal.shape[0], "yuv420p10le")
            for plane, levels in zip(
                frame.planes, (64.0 + 876.0 * signal, 512.0, 512.0), strict=True
            ):
                words = np.zeros((plane.height, plane.line_size // 2), np.uint16)
                words[:, : plane.width] = np.round(levels)
                plane.update(words.tobytes())
            frame.pts, frame.time_base = number, Fraction(1, 30)
            frame.color_range, frame.color_trc = 1, transfer
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize(("curve", "transfer", "peak"), [(pq, 16, 0.1), (hlg, 18, 1.0)])
def test_levels_follow_the_light(tmp_path, curve, transfer, peak):
    light = (scene(60.0, 60.0) / 255.0) ** 2.4
    path = written(tmp_path / "hdr.mkv", curve(peak * light), transfer)
    gray = next(ClipReader.open(path).frames()).gray / 65535.0
    assert np.abs(gray - light ** (1.0 / 2.4)).max() < 0.01


def test_other_pictures_of_ten_bit_are_unchanged(tmp_path):
    signal = scene(60.0, 60.0) / 255.0
    path = written(tmp_path / "sdr.mkv", signal, 1)
    gray = next(ClipReader.open(path).frames()).gray / 65535.0
    assert np.abs(gray - signal).max() < 0.002


@pytest.mark.parametrize(
    ("name", "content", "cure"),
    [
        ("a.mraw", b"\x00" * 4096, "Photron FASTCAM Viewer"),
        ("a.cih", b"#Camera Information Header", "Photron FASTCAM Viewer"),
    ],
)
def test_formats_that_can_not_be_read_are_named(tmp_path, name, content, cure):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ClipError, match="not supported") as refusal:
        ClipReader.open(tmp_path / name)
    assert cure in str(refusal.value)
