"""Video files through PyAV: opened, checked, and decoded from first to last picture.

Frame times from the container's time stamps: sorted, and freed of their rounding.

Containers round time stamps to their ticks: 600 frames per second in a Matroska file (1 ms) come as
steps of 1 and 2 ms. Where every stamp lies within a tick of an even clock (frames missing from it
allowed), that clock is the better estimate of each time; where not, the rate varies and the stamps
stand.

The camera's frame rate where the file tells it.

Known: Android's ``com.android.capture.fps`` (a ``moov/meta`` key, written for slow motion); Sony's
non-real-time metadata, an XML ``<VideoFrame … captureFps="959.04p"/>`` inside the file or beside it
as ``STEMM01.XML``; Matroska or other tags named like a capture rate. Apple's and GoPro's high-speed
modes keep the true rate as the container's own.
"""

import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.error import FFmpegError
from av.stream import Disposition
from numpy.typing import NDArray

from metrology import ClipError
from vision.clip.picture import GrayImage, Weave, colour_image, luma_image, refuse_giant

__all__ = ["VideoFile", "capture_fps_in_tags"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class FrameTimes:
    """When each frame is shown.

    Attributes
    ----------
    stamps : (N,) int array
        Time stamps in ticks, increasing.
    seconds : (N,) array
        Times, s, 0 at the first frame.
    interval_s : float
        Usual interval between frames, s; NaN for a single frame.
    variable : bool
        Whether the stamps do not fit an even clock.
    missing : int
        Frames that an even clock has and the clip has not.
    """

    stamps: NDArray[np.int64]
    seconds: FloatArray
    interval_s: float
    variable: bool
    missing: int


def frame_times(
    stamps: NDArray[np.int64], tick_s: float, declared_fps: tuple[float, ...] = ()
) -> FrameTimes:
    """Build the table of times.

    Parameters
    ----------
    stamps : (N,) int array
        Presentation time stamps in any order; repeated ones are kept once.
    tick_s : float
        Length of a tick, s.
    declared_fps : tuple of float
        Rates that the container declares; one that fits every stamp as well is preferred to the
        fitted rate.

    Returns
    -------
    FrameTimes
    """
    ticks = np.unique(stamps)
    since = (ticks - ticks[0]).astype(np.float64) if len(ticks) else np.zeros(0)
    if len(ticks) < 3:
        interval = tick_s * since[-1] if len(ticks) == 2 else np.nan
        return FrameTimes(ticks, tick_s * since, float(interval), False, 0)
    count, interval_ticks = _even_clock(since)
    declared_ticks = [1.0 / (fps * tick_s) for fps in declared_fps if fps > 0]
    for candidate in (*declared_ticks, interval_ticks):
        if not _fits(since, count, candidate):
            continue
        interval_ticks = candidate
        missing = int(count[-1]) + 1 - len(count)
        seconds = tick_s * interval_ticks * count
        return FrameTimes(ticks, seconds, tick_s * interval_ticks, False, missing)
    usual = float(np.median(np.diff(since)))
    return FrameTimes(ticks, tick_s * since, tick_s * usual, True, 0)


def _even_clock(since: FloatArray) -> tuple[FloatArray, float]:
    """Which beat of an even clock each stamp is, and the clock's interval in ticks."""
    steps = np.diff(since)
    beats = np.maximum(1.0, np.round(steps / np.median(steps)))
    count = np.concatenate([[0.0], np.cumsum(beats)])
    interval = _slope(count, since)
    count = np.round(since / interval)
    if np.any(np.diff(count) < 1):
        count = np.concatenate([[0.0], np.cumsum(beats)])
    return count, _slope(count, since)


def _fits(since: FloatArray, count: FloatArray, interval: float) -> bool:
    residual = since - count * interval
    return float(np.ptp(residual)) <= 2.0


def _slope(count: FloatArray, since: FloatArray) -> float:
    centred = count - count.mean()
    return float(centred @ since / (centred @ centred))


_TAG = re.compile(r"captur\w*[ ._-]?(fps|frame[ _-]?rate)", re.IGNORECASE)

_NUMBER = re.compile(r"(\d+(?:\.\d+)?)(?:\s*/\s*(\d+(?:\.\d+)?))?")

_SONY = re.compile(rb"captureFps\s*=\s*[\"'](\d+(?:\.\d+)?)[pi]?[\"']")

_LOOK_BYTES = 1 << 20
"""Bytes at either end of a file that hold its headers, as a rule."""


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


_MOST_THREADS = 8
"""Threads of a decoder: beyond eight, frames wait for each other."""

_BOTTOM_SHOWN_FIRST = (3, 4)  # AV_FIELD_BB, AV_FIELD_TB
"""Numbers of FFmpeg for a field order that shows the bottom field first: AV_FIELD_BB, AV_FIELD_TB,
from its header codec_par.h."""

# Pictures decoded when a clip is opened, to see whether their time stamps can be trusted: more than
# any codec reorders.
_TRIAL_PICTURES = 24


@dataclass(frozen=True)
class VideoPicture:
    """One decoded picture as stored."""

    index: int
    time_s: float
    frame: Any

    def gray(self) -> GrayImage:
        """Luma (H, W) on the full scale."""
        return luma_image(self.frame)

    def colour(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), blue first."""
        return colour_image(self.frame)


@dataclass(frozen=True)
class Packets:
    """What the packets tell without being decoded.

    Attributes
    ----------
    times : FrameTimes
        Time of every picture, in the order of presentation.
    declared : int
        Pictures that the container says it holds; 0 where it does not say.
    declared_s : float or None
        Duration that the container declares, s.
    edited_out : int
        Pictures that an edit list hides.
    whole : bool
        Whether the container could be read to its end, and pictures set its duration.
    corrupt : int
        Packets that the container's reader found damaged.
    stamped : bool
        Whether packets carry time stamps at all.
    """

    times: FrameTimes
    declared: int
    declared_s: float | None
    edited_out: int
    whole: bool
    corrupt: int
    stamped: bool


class VideoFile:
    """One video file.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    ClipError
        If it is missing, empty, no video, or nothing in it can be decoded.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damaged = 0
        with self._opened() as (container, stream):
            self.codec = str(stream.codec_context.name)
            refuse_giant(stream.codec_context.height, stream.codec_context.width, path)
            self.tags = {**container.metadata, **stream.metadata}
            aspect = stream.sample_aspect_ratio
            self.pixel_aspect = float(aspect) if aspect else 1.0
            declared = (stream.average_rate, stream.guessed_rate, stream.base_rate)
            self._declared_rates = tuple(float(rate) for rate in declared if rate)
            self.declared_rate = self._declared_rates[0] if self._declared_rates else 25.0
            self.packets = self._read_packets(container, stream)
            self.declared_order: Weave = (
                "bottom_first"
                if stream.codec_context.field_order in _BOTTOM_SHOWN_FIRST
                else "top_first"
            )
        self._by_order = False
        trial = list(islice(self.pictures(), _TRIAL_PICTURES))
        if not trial:
            raise ClipError(
                f"no picture of {path} can be decoded",
                hint="The file is damaged. Copy it from the camera once more.",
            )
        stamps = [picture.frame.pts for picture in trial]
        self._by_order = None in stamps or bool(np.any(np.diff(np.array(stamps)) <= 0))
        self.first_picture = trial[0].frame
        self.declared_interlaced = any(picture.frame.interlaced_frame for picture in trial)

    def pictures(self) -> Iterator[VideoPicture]:
        """Decode from the beginning; damaged packets are left out and counted in `damaged`."""
        self.damaged = 0
        times = self.packets.times
        index, zero, last, size = 0, None, -np.inf, None
        with self._opened() as (container, stream):
            for frame in self._decoded(container, stream):
                if self._by_order or frame.pts is None:
                    time = self._time_by_order(index)
                else:
                    place = int(np.searchsorted(times.stamps, frame.pts))
                    known = place < len(times.stamps) and times.stamps[place] == frame.pts
                    tick = float(frame.time_base or stream.time_base)
                    first = times.stamps[0] if len(times.stamps) else frame.pts
                    time = float(times.seconds[place]) if known else (frame.pts - int(first)) * tick
                size = size or (frame.width, frame.height)
                if (frame.width, frame.height) != size:
                    raise ClipError(
                        f"the pictures of {self.path} change size at frame {index}, from "
                        f"{size[0]}×{size[1]} to {frame.width}×{frame.height} px",
                        hint="Cut the recording there and measure the parts.",
                    )
                zero = time if zero is None else zero
                if time <= last:
                    time = last + (times.interval_s if np.isfinite(times.interval_s) else 0.0)
                last = time
                yield VideoPicture(index, time - zero, frame)
                index += 1

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Time of every picture after its packet's stamp, s, 0 at the first."""
        return self.packets.times.seconds

    def sha256(self) -> str:
        """Digest of the file."""
        with self.path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    def capture_fps(self) -> float | None:
        """Frame rate of the camera, where the file tells it, 1/s."""
        return capture_fps_in_tags(self.tags) or capture_fps_in_file(self.path)

    def _time_by_order(self, index: int) -> float:
        times = self.packets.times
        if index < len(times.seconds):
            return float(times.seconds[index])
        beyond = index + 1 - len(times.seconds)
        end = float(times.seconds[-1]) if len(times.seconds) else -times.interval_s
        return end + beyond * times.interval_s

    def _decoded(self, container: Any, stream: Any) -> Iterator[Any]:
        # threads over frames conceal an error with whatever its neighbour has decoded by then, so
        # that one damaged file gives other pictures at every reading; over slices they do not
        stream.thread_type = "SLICE"
        stream.codec_context.thread_count = min(_MOST_THREADS, os.cpu_count() or 1)
        for packet in self._demuxed(container, stream):
            try:
                frames = packet.decode()
            except FFmpegError:
                self.damaged += 1
                continue
            for frame in frames:
                if frame.is_corrupt:
                    self.damaged += 1
                else:
                    yield frame

    def _demuxed(self, container: Any, stream: Any) -> Iterator[Any]:
        try:
            yield from container.demux(stream)
        except FFmpegError:
            # The container breaks off here; what came before stands, its count tells how much.
            self._broken_off = True

    def _read_packets(self, container: Any, stream: Any) -> Packets:
        shown: list[int] = []
        stamped, corrupt, count, hidden = True, 0, 0, 0
        self._broken_off = False
        for packet in self._demuxed(container, stream):
            if packet.size == 0 or packet.is_discard:
                hidden += packet.size > 0
                continue
            count += 1
            corrupt += bool(packet.is_corrupt)
            stamp = packet.pts if packet.pts is not None else packet.dts
            if stamp is None:
                stamped = False
            else:
                shown.append(int(stamp))
        tick = float(stream.time_base)
        if len(set(shown)) < count:
            # Packets that share a stamp or have none leave an even clock at the declared rate.
            stamped = False
            step = max(1, round(1.0 / (self.declared_rate * tick)))
            shown = list(range(0, count * step, step))
        return Packets(
            frame_times(np.array(shown, dtype=np.int64), tick, self._declared_rates),
            int(stream.frames),
            _declared_duration(container, stream),
            hidden,
            not self._broken_off and len(container.streams) > 1,
            corrupt,
            stamped,
        )

    @contextmanager
    def _opened(self) -> Iterator[tuple[Any, Any]]:
        try:
            # An absolute name is never taken for a protocol; a playlist must not reach the network.
            name = str(self.path.resolve())
            # tags in another encoding are no reason not to look at the pictures
            container = av.open(
                name, options={"protocol_whitelist": "file"}, metadata_errors="replace"
            )
        except FFmpegError as problem:
            raise _unreadable(self.path, problem) from problem
        try:
            stream = _moving_pictures(container)
            if stream is None and any(not one.codec_context for one in container.streams.video):
                raise ClipError(
                    f"{self.path} holds pictures in a form that no decoder here knows",
                    hint="Copy it from the camera once more; where that does not help, have the"
                    " camera's own program export it as MP4.",
                )
            if stream is None:
                raise ClipError(
                    f"{self.path} holds {_contents(container)} and no video",
                    hint="Give the file with the pictures.",
                )
            yield container, stream
        finally:
            container.close()


def _declared_duration(container: Any, stream: Any) -> float | None:
    if stream.duration is not None:
        return float(stream.duration * stream.time_base)
    return None if container.duration is None else float(container.duration) / av.time_base


def _moving_pictures(container: Any) -> Any | None:
    """The video stream with the largest pictures that can be decoded, cover art aside."""
    streams = [
        stream
        for stream in container.streams.video
        # without a decoder there is no codec context, and no size
        if stream.codec_context and not stream.disposition & Disposition.attached_pic
    ]
    return max(streams, key=lambda stream: stream.width * stream.height, default=None)


def _contents(container: Any) -> str:
    kinds = sorted({str(stream.type) for stream in container.streams})
    return " and ".join(kinds) if kinds else "nothing"


def _unreadable(path: Path, problem: FFmpegError) -> ClipError:
    head = b""
    if os.access(path, os.R_OK):
        with path.open("rb") as file:
            head = file.read(12)
    if head[4:8] in (b"ftyp", b"mdat", b"wide", b"moov", b"free", b"skip"):
        return ClipError(
            f"{path} is cut off: its index (moov) is missing or broken",
            hint="The recording was not finished or not copied whole. Copy it from the camera once "
            "more; where that does not help, a repair tool such as untrunc can rebuild the index.",
        )
    return ClipError(
        f"{path} is no video that can be read ({problem.strerror or 'unknown format'})",
        hint="MP4, MOV, AVI, MKV, MJPEG and folders of images can be read. The file may be "
        "something else under a video's name, or damaged at its beginning.",
    )
