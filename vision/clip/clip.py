"""Read a clip (video file or image folder) as upright frames with exact times.

Times come from presentation time stamps only; frames are upright with square pixels, and interlaced
fields are separated. Frames are decoded on request, so memory does not grow with the clip's length.

**Frame times.** Containers round time stamps to their ticks: in a Matroska file (1 ms), 600 frames
per second appear as steps of 1 and 2 ms. If every stamp lies within a tick of an even clock
(missing frames allowed), that clock is the better estimate of each time. Otherwise the rate varies
and the stamps are used unchanged.

**Interlacing.** It is declared by the file, or detected from combing: lines of one field are
compared with the mean of the lines above and below, which belong to the other field. Where objects
move, the difference grows with the time between the fields. So the top lines of pictures n−1, n and
n+1 are each compared with the bottom lines of picture n:

    progressive     0 within a picture, 1 interval to either neighbour
    top field first 1/2 interval within, 1/2 to the next, 3/2 to the last
    bottom first    1/2 interval within, 3/2 to the next, 1/2 to the last

**Capture rate.** It is read from Android's ``com.android.capture.fps`` (a ``moov/meta`` key,
written for slow motion), from Sony's non-real-time metadata (an XML ``<VideoFrame …
captureFps="959.04p"/>`` in the file or next to it as ``STEMM01.XML``), and from Matroska or other
tags with such a name. High-speed modes of Apple and GoPro keep the true rate as the container's
own.
"""

import hashlib
import math
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any, Literal, Protocol

import av
import numpy as np
from av.error import FFmpegError
from av.stream import Disposition
from numpy.typing import NDArray

from metrology import ClipError
from vision.clip.bars import Bars, TrimmedPictures, bar_note, find_bars
from vision.clip.images import MOSAIC_NOTE, Animation, ImageFolder, is_animation
from vision.clip.mosaic import Mosaic, mosaic_of
from vision.clip.picture import (
    ClipInfo,
    Frame,
    GrayImage,
    Upright,
    Weave,
    bit_depth,
    colour_image,
    luma_image,
    refuse_giant,
    shrink_of,
    upright_of,
)
from vision.clip.reduced import ReducedVideo
from vision.clip.refusals import missing, too_few, undecodable, unreadable
from vision.clip.repeats import DistinctPictures, RepeatDetector, Repeats

__all__ = [
    "ClipReader",
    "VideoFile",
    "capture_fps_in_tags",
    "separate_field",
]

FloatArray = NDArray[np.float64]

_Images = ImageFolder | Animation


@dataclass(frozen=True)
class FrameTimes:
    """Time of each frame.

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
        Number of frames that the even clock has and the clip lacks.
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
        Rates that the container declares; one that fits every stamp is preferred to the fitted
        rate.

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
    """Tick number of each stamp on an even clock, and the clock's interval in container ticks."""
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


_CAPTURE_RATE_TAG = re.compile(r"captur\w*[ ._-]?(fps|frame[ _-]?rate)", re.IGNORECASE)

_RATE_NUMBER = re.compile(r"(\d+(?:\.\d+)?)(?:\s*/\s*(\d+(?:\.\d+)?))?")

_SONY_CAPTURE_RATE = re.compile(rb"captureFps\s*=\s*[\"'](\d+(?:\.\d+)?)[pi]?[\"']")

_HEADER_BYTES = 1 << 20
"""Bytes searched at either end of a file, where headers usually are (convention)."""


def capture_fps_in_tags(tags: Mapping[str, str]) -> float | None:
    """Capture rate among a container's tags, 1/s."""
    for key, value in tags.items():
        if _CAPTURE_RATE_TAG.search(key):
            number = _RATE_NUMBER.match(value.strip())
            if number is not None:
                rate = float(number.group(1)) / float(number.group(2) or 1.0)
                if rate > 0:
                    return rate
    return None


def capture_fps_in_file(path: Path) -> float | None:
    """Capture rate in Sony's XML at the file's beginning or end, or in a sidecar file, 1/s."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(0)
        parts = [file.read(_HEADER_BYTES)]
        if size > _HEADER_BYTES:
            file.seek(max(_HEADER_BYTES, size - _HEADER_BYTES))
            parts.append(file.read(_HEADER_BYTES))
    sidecar = path.with_name(f"{path.stem}M01.XML")
    if sidecar.is_file():
        parts.append(sidecar.read_bytes()[:_HEADER_BYTES])
    for part in parts:
        found = _SONY_CAPTURE_RATE.search(part)
        if found is not None and float(found.group(1)) > 0:
            return float(found.group(1))
    return None


_MAX_DECODER_THREADS = 8
"""Threads of a decoder (chosen): beyond eight, frames wait for each other."""

_BOTTOM_SHOWN_FIRST = (3, 4)  # AV_FIELD_BB, AV_FIELD_TB
"""FFmpeg's field orders that show the bottom field first (convention: codec_par.h)."""

_TRIAL_PICTURES = 24
"""Pictures decoded on opening to check time stamps (derived: H.264 and HEVC reorder at most 16)."""


@dataclass(frozen=True)
class VideoPicture:
    """One decoded picture as stored."""

    index: int
    time_s: float
    frame: Any
    mosaic: Mosaic | None = None

    def gray(self) -> GrayImage:
        """Luma (H, W) on the full scale."""
        gray = luma_image(self.frame)
        return gray if self.mosaic is None else self.mosaic.gray(gray)

    def colour(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), blue first."""
        if self.mosaic is not None:
            return self.mosaic.colour(luma_image(self.frame))
        return colour_image(self.frame)


@dataclass(frozen=True)
class Packets:
    """Properties of a clip that its packets give without decoding.

    Attributes
    ----------
    times : FrameTimes
        Time of every picture, in the order of presentation.
    declared : int
        Number of pictures declared by the container; 0 if it declares none.
    declared_s : float or None
        Duration that the container declares, s.
    edited_out : int
        Number of pictures that an edit list hides.
    whole : bool
        Whether the container could be read to its end, and has other streams that may set its
        duration.
    corrupt : int
        Packets that the demuxer marked as damaged.
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
        If it is missing, empty, not a video, or cannot be decoded.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damaged = 0
        self.mosaic: Mosaic | None = None
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
        first, stamps, interlaced = None, [], False
        # Pictures may take 68 MB each: keep only the first.
        for picture in islice(self.pictures(), _TRIAL_PICTURES):
            first = first or picture.frame
            stamps.append(picture.frame.pts)
            interlaced |= bool(picture.frame.interlaced_frame)
        if first is None:
            raise undecodable(path)
        self._by_order = None in stamps or bool(np.any(np.diff(np.array(stamps)) <= 0))
        self.first_picture = first
        if first.format.name.startswith("gray"):
            self.mosaic = mosaic_of(luma_image(first))
        self.declared_interlaced = interlaced

    def pictures(self) -> Iterator[VideoPicture]:
        """Decode from the beginning; damaged packets are skipped and counted in `damaged`."""
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
                        hint="Cut the recording there and measure both pieces.",
                    )
                zero = time if zero is None else zero
                if time <= last:
                    time = last + (times.interval_s if np.isfinite(times.interval_s) else 0.0)
                last = time
                yield VideoPicture(index, time - zero, frame, self.mosaic)
                index += 1

    def pictures_from(self, index: int) -> Iterator[VideoPicture]:
        """Decode from the key frame before a picture; none where stamps do not identify it."""
        packets, stamps = self.packets, self.packets.times.stamps
        if self._by_order or not packets.stamped or packets.edited_out or index >= len(stamps):
            return
        with self._opened() as (container, stream):
            container.seek(int(stamps[index]), stream=stream)
            for frame in self._decoded(container, stream):
                known = np.flatnonzero(stamps == frame.pts)
                if not len(known) or known[0] > index:
                    return
                if known[0] == index:
                    seconds = float(packets.times.seconds[index])
                    yield VideoPicture(index, seconds, frame, self.mosaic)
                    index += 1

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Time of every picture from its packet's stamp, s, 0 at the first."""
        return self.packets.times.seconds

    def sha256(self) -> str:
        """Digest of the file."""
        with self.path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    def capture_fps(self) -> float | None:
        """Frame rate of the camera if the file states it, 1/s."""
        return capture_fps_in_tags(self.tags) or capture_fps_in_file(self.path)

    def _time_by_order(self, index: int) -> float:
        times = self.packets.times
        if index < len(times.seconds):
            return float(times.seconds[index])
        beyond = index + 1 - len(times.seconds)
        end = float(times.seconds[-1]) if len(times.seconds) else -times.interval_s
        return end + beyond * times.interval_s

    def _decoded(self, container: Any, stream: Any) -> Iterator[Any]:
        # Frame threads conceal an error with whatever the neighbour has decoded so far, so that a
        # damaged file gives different pictures at every reading. Slice threads are repeatable.
        stream.thread_type = "SLICE"
        stream.codec_context.thread_count = min(_MAX_DECODER_THREADS, os.cpu_count() or 1)
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
            # The file ends early; the pictures before are valid, their count shows how many.
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
            # With shared or missing stamps, assume an even clock at the declared rate.
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
            # Tags in another encoding do not prevent decoding.
            container = av.open(
                name, options={"protocol_whitelist": "file"}, metadata_errors="replace"
            )
        except FFmpegError as problem:
            raise unreadable(self.path, problem.strerror) from problem
        try:
            if container.format.name == "tty":
                # text, which would be drawn as on a terminal
                raise unreadable(self.path)
            stream = _moving_pictures(container)
            if stream is None and any(not one.codec_context for one in container.streams.video):
                raise ClipError(
                    f"the codec of {self.path} is not supported",
                    hint="Copy the file from the camera again. If that does not help, export it as"
                    " MP4 with the camera's own program.",
                )
            if stream is None:
                raise ClipError(
                    f"{self.path} holds {_contents(container)} and no video",
                    hint="Pass the file that contains the video.",
                )
            yield container, stream
        finally:
            container.close()


def _declared_duration(container: Any, stream: Any) -> float | None:
    if stream.duration is not None:
        return float(stream.duration * stream.time_base)
    return None if container.duration is None else float(container.duration) / av.time_base


def _moving_pictures(container: Any) -> Any | None:
    """The decodable video stream with the largest pictures, cover art excluded."""
    streams = [
        stream
        for stream in container.streams.video
        # Without a decoder there is no codec context and no size.
        if stream.codec_context and not stream.disposition & Disposition.attached_pic
    ]
    return max(streams, key=lambda stream: stream.width * stream.height, default=None)


def _contents(container: Any) -> str:
    kinds = sorted({str(stream.type) for stream in container.streams})
    return " and ".join(kinds) if kinds else "nothing"


FloatImage = NDArray[np.float32]

_SETTLED_COMBING_PIXELS = 6000
"""Moving pixels after which the combing test may stop (chosen)."""

_SETTLED_TRIPLES = 6
"""Triples of pictures after which the test may stop (derived: six agree by chance once in 32)."""

_MIN_TRIPLES = 3
"""Minimum number of triples (chosen: two could not be outvoted)."""

_MIN_AGREEING_FRACTION = 0.6
"""Fraction of the triples that must agree (chosen: more than half, with a margin)."""

_MIN_COMBING_CONTRAST = 1.5
"""Contrast of the summed test statistic, 1 (chosen). Whole pictures taken for fields cost more than
fields taken for whole pictures, so the sum must be clear."""

_MIN_TRIPLE_CONTRAST = 0.5
"""The same for a single triple, 1 (chosen)."""

_MIN_MOVING_PIXELS = 20
"""Moving pixels of a triple; fewer are noise (chosen)."""

_MOVING_SIGMAS = 6.0
"""Standard deviations of a moving pixel (derived: no false one among a million pixels)."""

_NORMAL_GRAY_LEVEL = 100.0
"""Mean gray level that pictures are scaled to (convention), so that flicker is no motion."""

_COMBING_PERIOD = 7
"""Period of the sampling, pictures: three in a row show motion, then a pause so that the samples
cover more of the clip; odd, so that what returns every second or fourth picture averages out."""


def separate_field(picture: NDArray[Any], bottom: bool) -> NDArray[Any]:
    """Extract one field of an interlaced picture, on the picture's own pixel grid.

    The lines of the other field are interpolated from those above and below. Otherwise every
    second field would appear shifted by half a line pair.

    Parameters
    ----------
    picture : (H, W) or (H, W, 3) integer array
        Interlaced picture.
    bottom : bool
        Whether to take lines 1, 3, 5, … and not 0, 2, 4, ….

    Returns
    -------
    array of the same shape and type
    """
    field = picture.copy()
    first = 1 if bottom else 0
    missing = np.arange(1 - first, picture.shape[0], 2)
    above = np.clip(missing - 1, first, None)
    below = np.where(missing + 1 < picture.shape[0], missing + 1, missing - 1)
    above = np.where(missing == 0, below, above)
    wide = picture.astype(np.uint32)
    field[missing] = ((wide[above] + wide[below] + 1) // 2).astype(picture.dtype)
    return field


@dataclass(frozen=True)
class _Evidence:
    """Number of moving pixels in three pictures in a row, and sums of squared differences."""

    pixels: int
    within: float
    to_next: float
    to_last: float

    def verdict(self, clear: float) -> Weave:
        """Compare mean squares; the scene's own texture adds the same amount to all three.

        With h the change in half an interval, woven fields give h² within a picture and to the
        nearer neighbour, 9 h² to the farther; whole pictures give 0 within and 4 h² to both. So
        the step from near to far must be `clear` times that from within to near. A codec that
        stores every other picture worse makes a step, too, but leaves less within a picture.
        """
        near, far = sorted((self.to_next, self.to_last))
        if near > _MAX_NEAR_TO_WITHIN * self.within:
            return "progressive"
        if far < 1.25 * near or far - near < clear * (near - self.within):
            return "progressive"
        return "top_first" if self.to_next < self.to_last else "bottom_first"


_MAX_NEAR_TO_WITHIN = 2.0
"""Mean square to the nearer neighbour over that within a picture: the same in woven fields
(derived; measured 1.0 to 1.2), 2.9 and more in whole pictures that were taken for woven."""

_MIN_LINES = 4
"""Lines of a picture (derived): a bottom line between two top lines, and its pair."""


class CombingDetector:
    """Detect interlacing from combing in moving regions.

    Parameters
    ----------
    pictures : int, optional
        Number of pictures; in a short clip (a fall of half a second) all are examined.
    """

    def __init__(self, pictures: int | None = None) -> None:
        self._few = pictures is not None and pictures < _COMBING_PERIOD * _SETTLED_TRIPLES
        self._held: list[FloatImage] = []
        self._seen: list[_Evidence] = []

    @property
    def settled(self) -> bool:
        """Whether there are enough moving pixels to decide."""
        enough = sum(look.pixels for look in self._seen) >= _SETTLED_COMBING_PIXELS
        return enough and len(self._seen) >= _SETTLED_TRIPLES

    def wants(self, index: int) -> bool:
        """Whether picture `index` is sampled: three in a row, then a pause; all of a short clip."""
        return self._few or index % _COMBING_PERIOD < 3

    def show(self, picture: GrayImage) -> None:
        """Add the next sampled picture, as stored."""
        if picture.shape[0] < _MIN_LINES:
            return
        lines = picture[: picture.shape[0] // 2 * 2].astype(np.float32)
        # Mains flicker changes the whole picture; only motion must count.
        self._held.append(lines * np.float32(_NORMAL_GRAY_LEVEL / max(float(lines.mean()), 1e-3)))
        if len(self._held) == 3:
            self._weigh(*self._held)
            del self._held[: 1 if self._few else 3]

    def _weigh(self, last: FloatImage, now: FloatImage, following: FloatImage) -> None:
        # Bottom lines of `now` are compared with the mean of the top lines around them.
        bottom = now[1:-2:2]
        # The same field two intervals apart shows where objects move.
        change = np.abs(following[1:-2:2] - last[1:-2:2])
        noise = 1.5 * float(np.median(change[::3, ::3])) + 1e-3 * _NORMAL_GRAY_LEVEL
        moving = change > _MOVING_SIGMAS * noise
        count = int(np.count_nonzero(moving))
        if count < _MIN_MOVING_PIXELS:
            return
        here = bottom[moving]
        self._seen.append(
            _Evidence(
                count,
                _square(here - _between(now, moving)),
                _square(here - _between(following, moving)),
                _square(here - _between(last, moving)),
            )
        )

    def verdict(self) -> Weave:
        """Decide by the sum if most triples agree: damage and bounces appear in single ones."""
        seen = self._seen
        total = _Evidence(
            sum(look.pixels for look in seen),
            sum(look.within for look in seen),
            sum(look.to_next for look in seen),
            sum(look.to_last for look in seen),
        )
        weave = total.verdict(_MIN_COMBING_CONTRAST)
        agreeing = sum(look.verdict(_MIN_TRIPLE_CONTRAST) == weave for look in seen)
        if len(seen) < _MIN_TRIPLES or agreeing < _MIN_AGREEING_FRACTION * len(seen):
            return "progressive"
        return weave


def _square(difference: FloatImage) -> float:
    return float(np.sum(difference * difference, dtype=np.float64))


def _between(picture: FloatImage, where: NDArray[np.bool_]) -> FloatImage:
    """Mean of the top lines above and below the bottom lines' pixels `where`."""
    above, below = picture[0:-2:2], picture[2::2]
    mean: FloatImage = 0.5 * (above[where] + below[where])
    return mean


Fields = Literal["auto", "progressive", "top_first", "bottom_first"]

_MAX_COMBING_PIXELS = 16_000_000
"""Pixels after which the combing test stops (chosen: about 0.05 s of decoding)."""

_MIN_COMBING_PICTURES = 48
"""Minimum number of pictures for the combing test (chosen: a throw or swing moves in as many)."""

_MIN_BROADCAST_PICTURES = 300
"""The same for broadcast sizes (chosen: ten seconds), which are interlaced more often."""

_BROADCAST_HEIGHTS = (480, 486, 512, 576, 608, 1080, 1088)
"""Rows of the interlaced formats (convention): 480 and 576 lines (ITU-R BT.601), 1080 (BT.709),
with the rows that codecs add."""


def open_video(
    path: Path, fields: Fields, *, whole: bool = False
) -> tuple["_Source", ClipInfo, Upright]:
    """Open a video file.

    Parameters
    ----------
    path : Path
        An existing file that is not empty.
    fields : {"auto", "progressive", "top_first", "bottom_first"}
        As in `ClipReader.open`.
    whole : bool
        As in `ClipReader.open`.

    Returns
    -------
    source : VideoFile or DistinctPictures
    info : ClipInfo
    upright : Upright

    Raises
    ------
    ClipError
        If it can't be read.
    """
    video = VideoFile(path)
    times = video.packets.times
    upright, turn_note = upright_of(video.first_picture, video.pixel_aspect)
    size = (video.first_picture.height, video.first_picture.width)
    pictures, bars, (height, width) = _without_bars(video, size, whole=whole)
    sides = (height, round(width * upright.stretch))
    shrink, size_note = (1, None) if whole else shrink_of(*sides[:: -1 if upright.swap else 1])
    if pictures is video and _reducible(video, upright, fields, shrink):
        pictures = ReducedVideo(video, shrink)
        fields, height, width = "progressive", height // shrink, width // shrink
    else:
        upright = replace(upright, shrink=shrink)
    source, detector, notes = _distinct(pictures, height, width)
    if fields == "auto":
        weave, weave_notes = _weave(video, detector)
        notes += weave_notes
    else:
        weave = fields
    notes += [turn_note] if turn_note else []
    parts = 1 if weave == "progressive" else 2
    width = round(width * upright.stretch)
    if upright.stretch != 1.0:
        notes.append(
            f"Stored pixels are {upright.stretch:.4f} times as wide as high; pictures are "
            "resampled to square pixels."
        )
    if upright.swap:
        height, width = width, height
    notes += [size_note] if size_note else []
    rate = 1.0 / times.interval_s if times.interval_s > 0 else video.declared_rate
    shown = source.times if isinstance(source, DistinctPictures) else Fraction(1)
    seconds = source.times_s
    rate /= float(shown)
    info = ClipInfo(
        path=path,
        sha256=video.sha256(),
        width=width // upright.shrink,
        height=height // upright.shrink,
        frames=parts * len(seconds),
        codec=video.codec,
        container_fps=parts * rate,
        container_declares_rate=True,
        duration_s=float(seconds[-1]) + (parts - 1) * 0.5 / rate,
        rotation=upright.rotation,
        weave=weave,
        bit_depth=bit_depth(video.first_picture),
        capture_fps_metadata=video.capture_fps(),
        variable_rate=times.variable,
        warnings=tuple(_file_warnings(video) + notes),
        times_shown=shown,
        first_shown=source.shift if isinstance(source, DistinctPictures) else Fraction(0),
        bars=bars.around(size, upright),
    )
    return source, info, upright


def _reducible(video: VideoFile, upright: Upright, fields: Fields, shrink: int) -> bool:
    """Whether whole pictures may be reduced as soon as they are decoded.

    No interlaced format has more lines than `_BROADCAST_HEIGHTS`.
    """
    height, width = video.first_picture.height, video.first_picture.width
    whole = fields == "progressive" or (
        fields == "auto" and height > max(_BROADCAST_HEIGHTS) and not video.declared_interlaced
    )
    even = height % shrink == 0 and width % shrink == 0
    return shrink > 1 and whole and even and upright.stretch == 1.0


def _without_bars(
    source: VideoFile | _Images, size: tuple[int, int], *, whole: bool
) -> tuple["_Source", Bars, tuple[int, int]]:
    """The source without bars, the bars, and height and width of its pictures."""
    bars = Bars() if whole else find_bars(source)
    if bars == Bars():
        return source, bars, size
    within = size[0] - bars.top - bars.bottom, size[1] - bars.left - bars.right
    return TrimmedPictures(source, bars), bars, within


def _distinct(
    source: "_Source", height: int, width: int
) -> tuple["_Source", CombingDetector, list[str]]:
    """The source without repeats, the combing of its pictures, and notes."""
    repeats = RepeatDetector()
    combing = _examined(source, height, width, repeats)
    found = repeats.verdict()
    if found.times == 1:
        return source, combing, []
    distinct = DistinctPictures(source, found)
    shown, first = found.times, math.ceil(found.shift)
    how = f"every picture {shown} times"
    if shown.denominator > 1:
        how = f"{shown.denominator} pictures in {shown.numerator} frames, some of them repeated"
    note = (
        f"The file shows {how} (frame rate raised by a program): the repeats are dropped. Times,"
        " frame rate and frame numbers are those of the different pictures: number n is frame"
        f" {float(shown):g}·n{f' + {first}' if first else ''} of the file, counted from 0."
    )
    return distinct, _examined(distinct, height, width), [note]


def _examined(
    source: "_Source",
    height: int,
    width: int,
    repeats: RepeatDetector | None = None,
) -> CombingDetector:
    """Show the first pictures to the detectors until they have seen enough."""
    broadcast = height in _BROADCAST_HEIGHTS
    least = _MIN_BROADCAST_PICTURES if broadcast else _MIN_COMBING_PICTURES
    detector = CombingDetector(len(source.times_s))
    pictures: Iterator[_Picture] = iter(source.pictures())
    for picture in islice(pictures, max(least, _MAX_COMBING_PIXELS // (height * width))):
        if not detector.settled and detector.wants(picture.index):
            detector.show(picture.gray())
        if repeats is not None:
            repeats.show(picture.gray())
        if detector.settled and (repeats is None or repeats.settled):
            break
    return detector


def _weave(video: VideoFile, detector: CombingDetector) -> tuple[Weave, list[str]]:
    seen = detector.verdict()
    half_line = (
        "the fields are separated, which doubles the frame rate, and each is interpolated to the "
        "full picture's lines, which removes the half-line offset between them"
    )
    if video.declared_interlaced:
        if seen != "progressive":
            return seen, [f"The clip is interlaced: {half_line}."]
        if detector.settled:
            return "progressive", [
                "The file declares interlaced pictures, but moving objects show no combing; they "
                "are used as whole pictures."
            ]
        return video.declared_order, [
            f"The file declares interlaced pictures; too little moves to check it: {half_line}."
        ]
    if seen == "progressive":
        return seen, []
    return seen, [f"The pictures are interlaced without a flag (combing): {half_line}."]


def _file_warnings(video: VideoFile) -> list[str]:
    packets = video.packets
    times = packets.times
    found = len(times.seconds)
    notes = []
    if packets.declared > found + packets.edited_out:
        notes.append(
            f"The file is cut off: it declares {packets.declared} pictures and holds {found} "
            f"({100 * found / packets.declared:.0f} %). Only these are measured."
        )
    elif packets.declared_s and found > 1 and not packets.declared:
        end = float(times.seconds[-1]) + times.interval_s
        # Sound may outlast the pictures in a complete file, and a last frame may be shown long.
        if not packets.whole and end < 0.98 * packets.declared_s - 2.0 * times.interval_s:
            notes.append(
                f"The file is cut off: it declares {packets.declared_s:.2f} s and ends at "
                f"{end:.2f} s ({100 * end / packets.declared_s:.0f} %). Only this is measured."
            )
    if packets.corrupt:
        notes.append(f"{packets.corrupt} packets of the file are damaged.")
    if not packets.stamped:
        notes.append(
            "The file has no usable time stamps; its frames are assumed evenly spaced at "
            f"{video.declared_rate:.4g} frames per second."
        )
    if video.mosaic is not None:
        notes.append(MOSAIC_NOTE)
    if times.missing:
        notes.append(
            f"{times.missing} frames are missing from an otherwise even clock (dropped while "
            "recording). The times of the other frames account for them."
        )
    return notes


def _opened_images(images: _Images, *, whole: bool) -> "ClipReader":
    """A clip of images without bars and repeats."""
    trimmed, bars, (height, width) = _without_bars(images, images.size, whole=whole)
    source, _, notes = _distinct(trimmed, height, width)
    info = replace(
        images.info,
        width=width // images.upright.shrink,
        height=height // images.upright.shrink,
        bars=bars.around(images.size, images.upright),
        warnings=(*images.info.warnings, *notes),
    )
    if not isinstance(source, DistinctPictures):
        return ClipReader(source, info, images.upright)
    info = replace(
        info,
        frames=len(source.times_s),
        container_fps=info.container_fps / float(source.times),
        duration_s=float(source.times_s[-1]),
        times_shown=source.times,
        first_shown=source.shift,
    )
    return ClipReader(source, info, images.upright)


_Source = VideoFile | ReducedVideo | TrimmedPictures | _Images | DistinctPictures


class _Picture(Protocol):
    @property
    def index(self) -> int: ...

    @property
    def time_s(self) -> float: ...

    def gray(self) -> GrayImage: ...

    def colour(self) -> NDArray[np.uint8]: ...


class ClipReader:
    """A readable clip; make one with `ClipReader.open`.

    Attributes
    ----------
    info : ClipInfo
        Its properties.
    """

    def __init__(self, source: _Source, info: ClipInfo, upright: Upright) -> None:
        self._source = source
        self._upright = upright
        self._damage: tuple[str, ...] = ()
        self._read_times: FloatArray | None = None
        self.info = info

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        *,
        fields: Fields = "auto",
        least_frames: int = 2,
        whole: bool = False,
        every: int = 1,
    ) -> "ClipReader":
        """Open a video file, an animated WebP, a TIFF stack or a folder of images.

        Parameters
        ----------
        path : path
            The file or folder.
        fields : {"auto", "progressive", "top_first", "bottom_first"}
            Whether pictures are interlaced; "auto" reads the file's flag and tests for combing.
        least_frames : int
            Minimum number of frames.
        whole : bool
            Whether very large pictures keep their size instead of being reduced.
        every : int
            Read only every n-th picture; the times stay those of the camera.

        Returns
        -------
        ClipReader

        Raises
        ------
        ClipError
            If it can't be read, or has too few frames.
        """
        place = Path(path)
        if not os.path.exists(place):
            raise missing(place)
        if place.is_dir():
            clip = _opened_images(ImageFolder(place, whole=whole), whole=whole)
        else:
            if not place.is_file():
                raise ClipError(
                    f"{place} is not a regular file",
                    hint="Pass a video file; a pipe or a device may never end.",
                )
            if place.stat().st_size == 0:
                raise ClipError(
                    f"{place} is empty",
                    hint="It has 0 bytes. Copy it from the camera again.",
                )
            if is_animation(place):
                clip = _opened_images(Animation(place, whole=whole), whole=whole)
            else:
                clip = cls(*open_video(place, fields, whole=whole))
        if every > 1:
            clip = clip._thinned(every)
        if clip.info.frames < least_frames:
            raise too_few(place, clip.info.frames)
        return clip

    def _thinned(self, every: int) -> "ClipReader":
        source = DistinctPictures(self._source, Repeats(Fraction(every)))
        fields = 2 if self.info.interlaced else 1
        info = replace(self.info, frames=fields * len(source.times_s), every=every)
        return ClipReader(source, info, self._upright)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the file, including damage found while decoding so far."""
        return bar_note(self.info) + self.info.warnings + self._damage

    def capture_times(self, capture_fps: float) -> FloatArray:
        """Times of all frames on the camera's clock.

        Taken from the packets' stamps, or from the decoded frames once the clip has been read to
        its end. Where frames were dropped or the rate varies, they are not evenly spaced.

        Parameters
        ----------
        capture_fps : float
            Frames (fields, where they are separated) per second of the camera.

        Returns
        -------
        (frames,) array
            s, 0 at the first frame.
        """
        times = self._read_times
        if times is None:
            times = self._source.times_s
            if self.info.interlaced:
                half = 1.0 / self.info.container_fps
                times = np.stack([times, times + half], axis=1).ravel()
        return times * (self.info.container_fps / capture_fps)

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        """Yield the frames from `start` up to, not including, `stop`, in order.

        Decoding always begins at the first frame, since seeking is inexact in many files.

        Parameters
        ----------
        start, stop : int
            Frame indices.

        Yields
        ------
        Frame
        """
        for index, time_s, picture, bottom in self._placed(start, stop):
            gray = picture.gray()
            if bottom is not None:
                gray = separate_field(gray, bottom)
            yield Frame(index, time_s, self._turned(gray))

    def colour_frames(
        self, start: int = 0, stop: int | None = None
    ) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """Yield index and colour image (H, W, 3), blue first, of the same frames as `frames`."""
        for index, _, picture, bottom in self._placed(start, stop):
            image = picture.colour()
            if bottom is not None:
                image = separate_field(image, bottom)
            yield index, self._turned(image)

    def sought_frames(self, start: int) -> Iterator[NDArray[np.uint8]]:
        """Yield colour images of the frames from `start`, without decoding all before it.

        Nothing is yielded where frames and stored pictures are not the same.
        """
        if isinstance(self._source, VideoFile) and self.info.weave == "progressive":
            for picture in self._source.pictures_from(start):
                yield self._turned(picture.colour())

    def _turned(self, image: NDArray[Any]) -> NDArray[Any]:
        return image if self._upright == Upright() else self._upright.apply(image)

    def _placed(
        self, start: int, stop: int | None
    ) -> Iterator[tuple[int, float, _Picture, bool | None]]:
        weave = self.info.weave
        half = 1.0 / self.info.container_fps
        times: list[float] = []
        for picture in self._source.pictures():
            fields = (
                (None,) if weave == "progressive" else (weave != "top_first", weave == "top_first")
            )
            for part, bottom in enumerate(fields):
                index = picture.index * len(fields) + part
                if stop is not None and index >= stop:
                    return
                times.append(picture.time_s + part * half)
                if index >= start:
                    yield index, times[-1], picture, bottom
        self._reached_end(np.array(times))

    def _reached_end(self, times: FloatArray) -> None:
        self._read_times = times
        count, expected = len(times), self.info.frames
        damaged = getattr(self._source, "damaged", 0)
        if damaged or count < expected:
            lost = max(damaged, expected - count)
            self._damage = (
                f"{lost} of {max(expected, count + lost)} pictures could not be decoded and are "
                "skipped; those after them may be damaged up to the next key frame.",
            )
        if count != expected:
            self.info = replace(self.info, frames=count)
