"""Clips written for tests: a bright disc on a path before a static scene."""

from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT = 160, 120


def scene(x: float, y: float, *, radius: float = 14.0, size=(WIDTH, HEIGHT)) -> NDArray[np.uint8]:
    """A disc with a soft edge before a smooth wall with a few dark lines."""
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    wall = 110.0 + 0.2 * columns - 0.1 * rows
    wall[:, 20::40] -= 40.0
    wall[15::30] -= 40.0
    cover = np.clip(radius + 0.5 - np.hypot(columns - x, rows - y), 0.0, 1.0)
    return np.round(wall * (1 - cover) + 235.0 * cover).astype(np.uint8)


def moving_disc(count: int, speed: float = 3.0) -> list[NDArray[np.uint8]]:
    """Frames of a disc that moves to the right and a little down."""
    return [scene(20.0 + speed * index, 50.0 + 0.2 * speed * index) for index in range(count)]


def woven(fields: Sequence[NDArray[np.uint8]], *, bottom_first: bool = False):
    """Weave consecutive pictures, two at a time, as fields of one."""
    pictures = []
    for first, second in zip(fields[::2], fields[1::2], strict=True):
        picture = first.copy()
        picture[0 if bottom_first else 1 :: 2] = second[0 if bottom_first else 1 :: 2]
        pictures.append(picture)
    return pictures


def write_clip(
    path: Path,
    images: Iterable[NDArray[np.generic]],
    *,
    codec: str = "libx264",
    rate: Fraction | int = 30,
    pix_fmt: str = "yuv420p",
    stamps: Sequence[int] | None = None,
    time_base: Fraction | None = None,
    metadata: dict[str, str] | None = None,
    container_options: dict[str, str] | None = None,
    options: dict[str, str] | None = None,
    rotation: int | None = None,
    full_range: bool = False,
    pixel_aspect: int | None = None,
) -> Path:
    """Write gray images (H, W) as a clip; 16-bit images keep the bits that the pixel format has."""
    with av.open(str(path), "w", options=container_options or {}) as container:
        if metadata:
            container.metadata.update(metadata)
        stream = None
        for index, image in enumerate(images):
            if stream is None:
                stream = container.add_stream(codec, rate=rate, options=options or {})
                stream.height, stream.width = image.shape[:2]
                stream.pix_fmt = pix_fmt
                stream.codec_context.color_range = 2 if full_range else 1
                if time_base is not None:
                    stream.codec_context.time_base = time_base
                if pixel_aspect is not None:
                    stream.codec_context.sample_aspect_ratio = Fraction(pixel_aspect)
                if rotation is not None:
                    stream.set_display_rotation(rotation)
            frame = _frame(np.asarray(image), pix_fmt, full_range)
            frame.pts = index if stamps is None else stamps[index]
            frame.time_base = time_base or Fraction(1, 1) / Fraction(rate)
            container.mux(stream.encode(frame))
        assert stream is not None
        container.mux(stream.encode())
    return path


def repeated(path: Path, long_path: Path, times: int) -> Path:
    """Join a clip to itself, packet by packet, without decoding."""
    with av.open(str(long_path), "w") as target:
        stream = None
        for turn in range(times):
            with av.open(str(path)) as source:
                video = source.streams.video[0]
                stream = stream or target.add_stream_from_template(video)
                step = int(video.duration)
                for packet in source.demux(video):
                    if packet.size:
                        packet.pts += turn * step
                        packet.dts += turn * step
                        packet.stream = stream
                        target.mux(packet)
    return long_path


def write_sound(path: Path) -> Path:
    """A file with a tone and no picture."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        tone = (0.1 * np.sin(np.arange(44100) * 0.06)).astype(np.float32)[None]
        frame = av.AudioFrame.from_ndarray(tone, format="fltp", layout="mono")
        frame.sample_rate = 44100
        frame.pts = 0
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def _frame(image: NDArray[np.generic], pix_fmt: str, full_range: bool) -> av.VideoFrame:
    """A picture whose luma plane holds the image, at the range wanted, and gray chroma."""
    height, width = image.shape[:2]
    frame = av.VideoFrame(width, height, pix_fmt)
    depth = 10 if "10" in pix_fmt else 8
    top = (1 << depth) - 1
    level = image.astype(np.float64) / (255.0 if image.dtype == np.uint8 else 65535.0)
    scale = 1 << (depth - 8)
    luma = level * top if full_range else 16 * scale + level * 219 * scale
    kind = np.uint16 if depth > 8 else np.uint8
    for number, plane in enumerate(frame.planes):
        words = np.zeros((plane.height, plane.line_size // kind().itemsize), kind)
        words[:] = 1 << (depth - 1)
        if number == 0:
            words[:, :width] = np.round(luma)
        plane.update(words.tobytes())
    frame.color_range = 2 if full_range else 1
    return frame
