"""A clip: a video file or a folder of images, read from first to last frame with true times.

Times come from presentation stamps only; frames are upright and have square pixels; woven fields
are separated. Nothing is held: memory does not grow with the length of the clip.

What is settled when a video is opened: fields, orientation, clock, and what to warn of.

A folder of numbered images read as a clip.

Interlaced clips: two fields, half an interval apart, woven into one picture.

Whether pictures are woven is told by the file, or seen from combing: lines of one field are held
against the mean of the lines above and below, which belong to the other field. Where things move,
fields taken at the same time agree, fields taken apart in time do not, and the more the further
apart. So the top lines of pictures n−1, n and n+1 are each compared with the bottom lines of
picture n:

    progressive     0 within a picture, 1 interval to either neighbour
    top field first 1/2 interval within, 1/2 to the next, 3/2 to the last
    bottom first    1/2 interval within, 3/2 to the next, 1/2 to the last

Video files through PyAV: opened, checked, and decoded from first to last picture.

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
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, Literal, Protocol

import av
import cv2
import numpy as np
from av.error import FFmpegError
from av.stream import Disposition
from numpy.typing import NDArray

from metrology import ClipError
from vision.clip.picture import (
    ClipInfo,
    Frame,
    GrayImage,
    Upright,
    Weave,
    bit_depth,
    colour_image,
    decoded_image,
    luma_image,
    refuse_giant,
    shrink_of,
    upright_of,
)

__all__ = [
    "ClipReader",
    "VideoFile",
    "capture_fps_in_tags",
    "separate_field",
]

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
        first, stamps, interlaced = None, [], False
        # of pictures of 68 MB, not all are held at once
        for picture in islice(self.pictures(), _TRIAL_PICTURES):
            first = first or picture.frame
            stamps.append(picture.frame.pts)
            interlaced |= bool(picture.frame.interlaced_frame)
        if first is None:
            raise ClipError(
                f"no picture of {path} can be decoded",
                hint="The file is damaged. Copy it from the camera once more.",
            )
        self._by_order = None in stamps or bool(np.any(np.diff(np.array(stamps)) <= 0))
        self.first_picture = first
        self.declared_interlaced = interlaced

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


FloatImage = NDArray[np.float32]

# Moving pixels, and looks at three pictures in a row, after which the question is settled.
_ENOUGH_PIXELS = 6000

_ENOUGH_LOOKS = 6

"""Looks after which combing is settled: six that agree do so by chance in one of 32."""

_FEWEST_LOOKS = 3

"""Looks at least: of three that agree, one may still be chance, two can't be outvoted."""

_AGREEING = 0.6

"""Share of the looks that must agree: more than half, by a margin."""

# Whole pictures taken for fields cost more than the other way round: the sum must be clear.
_CLEAR = 1.5

_CLEAR_LOOK = 0.5

# Fewer moving pixels than this in one look are noise.
_LEAST_PIXELS = 20

_NOISE_FACTOR = 6.0

"""Times the noise of a change: in a picture of a million pixels none passes by chance."""

_LEVEL = 100.0

"""Gray levels that lines are scaled to, so that flicker is no motion."""

_CYCLE = 6

"""Pictures of which three in a row are looked at: neighbours show motion, and the pause covers more
of the clip."""


def separate_field(picture: NDArray[Any], bottom: bool) -> NDArray[Any]:
    """Take one field out of a woven picture, on the picture's own pixel grid.

    The lines of the other field are interpolated from those above and below, so that both fields
    keep their places: without that, every second field would stand half a line pair too high.

    Parameters
    ----------
    picture : (H, W) or (H, W, 3) integer array
        Woven picture.
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
    """Sums over the moving pixels of three pictures in a row, of squares."""

    pixels: int
    within: float
    to_next: float
    to_last: float

    def verdict(self, clear: float) -> Weave:
        """Judge by mean squares, in which the scene's own texture adds the same to all three.

        With h the change in half an interval, woven fields leave h² within a picture and to the
        nearer neighbour, 9 h² to the farther; whole pictures leave 0 within and 4 h² to both. So
        the step from near to far has to be `clear` times that from within to near.
        """
        near, far = sorted((self.to_next, self.to_last))
        if far < 1.25 * near or far - near < clear * (near - self.within):
            return "progressive"
        return "top_first" if self.to_next < self.to_last else "bottom_first"


_LEAST_LINES = 4

"""Lines of a picture: a bottom line with a top line on either side, and their pair."""


class CombingDetector:
    """Weighs combing over the pictures shown to it, until what moves has told enough.

    Parameters
    ----------
    pictures : int, optional
        How many pictures there are: of a few, as a fall of half a second has, all are looked at.
    """

    def __init__(self, pictures: int | None = None) -> None:
        self._few = pictures is not None and pictures < _CYCLE * _ENOUGH_LOOKS
        self._held: list[FloatImage] = []
        self._seen: list[_Evidence] = []

    @property
    def settled(self) -> bool:
        """Whether enough moving pixels have been seen."""
        enough = sum(look.pixels for look in self._seen) >= _ENOUGH_PIXELS
        return enough and len(self._seen) >= _ENOUGH_LOOKS

    def wants(self, index: int) -> bool:
        """Whether picture `index` is to be shown: three in a row, then a pause, or all of few."""
        return self._few or index % _CYCLE < 3

    def show(self, picture: GrayImage) -> None:
        """Look at the next picture that is wanted, as stored."""
        if picture.shape[0] < _LEAST_LINES:
            return
        lines = picture[: picture.shape[0] // 2 * 2].astype(np.float32)
        # Mains flicker changes all of a picture; only what moves in it is to count.
        self._held.append(lines * np.float32(_LEVEL / max(float(lines.mean()), 1e-3)))
        if len(self._held) == 3:
            self._weigh(*self._held)
            del self._held[: 1 if self._few else 3]

    def _weigh(self, last: FloatImage, now: FloatImage, following: FloatImage) -> None:
        # Bottom lines of `now` against the mean of the top lines around them.
        bottom = now[1:-2:2]
        # Pictures two intervals apart, line by line of the same field: where things move.
        change = np.abs(following[1:-2:2] - last[1:-2:2])
        noise = 1.5 * float(np.median(change[::3, ::3])) + 1e-3 * _LEVEL
        moving = change > _NOISE_FACTOR * noise
        count = int(np.count_nonzero(moving))
        if count < _LEAST_PIXELS:
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
        """Judge by the sum, where most looks agree with it: damage and bounces speak once."""
        seen = self._seen
        total = _Evidence(
            sum(look.pixels for look in seen),
            sum(look.within for look in seen),
            sum(look.to_next for look in seen),
            sum(look.to_last for look in seen),
        )
        weave = total.verdict(_CLEAR)
        agreeing = sum(look.verdict(_CLEAR_LOOK) == weave for look in seen)
        if len(seen) < _FEWEST_LOOKS or agreeing < _AGREEING * len(seen):
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

# Looking for woven fields stops after this many pixels, some 0.05 s of decoding, but not before so
# many pictures; broadcast sizes, which alone are recorded in fields, are worth a longer look.
_COMBING_PIXELS = 16_000_000

_COMBING_PICTURES = 48

"""Pictures that are looked at for combing, supposed: a throw or a swing moves in as many."""

_BROADCAST_PICTURES = 300

"""Pictures, ten seconds of broadcast, whose pictures are combed more often than others."""

_BROADCAST_HEIGHTS = (480, 486, 512, 576, 608, 1080, 1088)

"""Rows of the interlaced formats: 480 and 576 lines (ITU-R BT.601), 1080 (BT.709), with the rows
that codecs add."""


def open_video(
    path: Path, fields: Fields, *, whole: bool = False
) -> tuple[VideoFile, ClipInfo, Upright]:
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
    video : VideoFile
    info : ClipInfo
    upright : Upright

    Raises
    ------
    ClipError
        If it can't be read.
    """
    video = VideoFile(path)
    times = video.packets.times
    weave, notes = _weave(video) if fields == "auto" else (fields, [])
    upright, note = upright_of(video.first_picture, video.pixel_aspect)
    notes += [note] if note else []
    parts = 1 if weave == "progressive" else 2
    height, width = video.first_picture.height, video.first_picture.width
    width = round(width * upright.stretch)
    if upright.stretch != 1.0:
        notes.append(
            f"Stored pixels are {upright.stretch:.4f} times as wide as high; pictures are "
            "stretched to square pixels."
        )
    if upright.swap:
        height, width = width, height
    shrink, note = (1, None) if whole else shrink_of(height, width)
    notes += [note] if note else []
    upright = replace(upright, shrink=shrink)
    rate = 1.0 / times.interval_s if times.interval_s > 0 else video.declared_rate
    info = ClipInfo(
        path=path,
        sha256=video.sha256(),
        width=width // shrink,
        height=height // shrink,
        frames=parts * len(times.seconds),
        codec=video.codec,
        container_fps=parts * rate,
        container_declares_rate=True,
        duration_s=float(times.seconds[-1]) + (parts - 1) * 0.5 / rate,
        rotation=upright.rotation,
        weave=weave,
        bit_depth=bit_depth(video.first_picture),
        capture_fps_metadata=video.capture_fps(),
        variable_rate=times.variable,
        warnings=tuple(_file_warnings(video) + notes),
    )
    return video, info, upright


def _weave(video: VideoFile) -> tuple[Weave, list[str]]:
    height, width = video.first_picture.height, video.first_picture.width
    broadcast = height in _BROADCAST_HEIGHTS
    least = _BROADCAST_PICTURES if broadcast else _COMBING_PICTURES
    detector = CombingDetector(len(video.packets.times.seconds))
    for picture in islice(video.pictures(), max(least, _COMBING_PIXELS // (height * width))):
        if detector.wants(picture.index):
            detector.show(picture.gray())
        if detector.settled:
            break
    seen = detector.verdict()
    half_line = (
        "the fields are separated, which doubles the frame rate, and each is resampled onto the "
        "full picture's lines, which takes out the half-line offset between them"
    )
    if video.declared_interlaced:
        if seen != "progressive":
            return seen, [f"The clip is interlaced: {half_line}."]
        if detector.settled:
            return "progressive", [
                "The file calls its pictures interlaced, but what moves in them shows no combing; "
                "they are taken as whole pictures."
            ]
        return video.declared_order, [
            f"The clip is interlaced, says the file, and too little moves to check it: {half_line}."
        ]
    if seen == "progressive":
        return seen, []
    return seen, [f"The pictures are combed: two fields woven without a flag; {half_line}."]


def _file_warnings(video: VideoFile) -> list[str]:
    packets = video.packets
    times = packets.times
    found = len(times.seconds)
    notes = []
    if packets.declared > found + packets.edited_out:
        notes.append(
            f"The file is cut off: it declares {packets.declared} pictures and holds {found} "
            f"({100 * found / packets.declared:.0f} %); what is there is read."
        )
    elif packets.declared_s and found > 1 and not packets.declared:
        end = float(times.seconds[-1]) + times.interval_s
        # Sound may outlast the pictures in a whole file, and a last frame may be shown long.
        if not packets.whole and end < 0.98 * packets.declared_s - 2.0 * times.interval_s:
            notes.append(
                f"The file is cut off: it declares {packets.declared_s:.2f} s and ends at "
                f"{end:.2f} s ({100 * end / packets.declared_s:.0f} %); what is there is read."
            )
    if packets.corrupt:
        notes.append(f"{packets.corrupt} packets of the file are damaged.")
    if not packets.stamped:
        notes.append(
            "The file has no usable time stamps; its frames are taken to be evenly spaced at "
            f"{video.declared_rate:.4g} frames per second."
        )
    if times.missing:
        notes.append(
            f"{times.missing} frames are missing from an otherwise even clock (dropped while "
            "recording); the gaps keep their time."
        )
    return notes


_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"}


def is_image(path: Path) -> bool:
    """Whether a file's name is that of an image."""
    return path.suffix.lower() in _SUFFIXES


class ImageFrame:
    """One image, read when it is asked for."""

    def __init__(self, index: int, path: Path, shape: tuple[int, int] | None) -> None:
        self.index = index
        self.time_s = float(index)
        self._path = path
        self._shape = shape

    def gray(self) -> GrayImage:
        """Gray levels (H, W), uint8 or uint16."""
        image = self._read(cv2.IMREAD_UNCHANGED)
        if image.ndim == 3:
            image = image[:, :, :3] if image.shape[2] > 3 else image
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        return image

    def colour(self) -> NDArray[np.uint8]:
        """Colour image (H, W, 3), blue first."""
        return self._read(cv2.IMREAD_COLOR)

    def _read(self, flags: int) -> NDArray[Any]:
        # IMREAD_UNCHANGED skips the camera's orientation tag, so it is asked for without.
        data = self._path.read_bytes()
        image = decoded_image(data, flags | cv2.IMREAD_IGNORE_ORIENTATION, self._path)
        if image is None or image.dtype not in (np.uint8, np.uint16):
            raise ClipError(
                f"{self._path} is no image that can be read",
                hint="Remove it from the folder, or save the images as PNG of 8 or 16 bit.",
            )
        if self._shape is not None and image.shape[:2] != self._shape:
            height, width = self._shape
            raise ClipError(
                f"{self._path} is {image.shape[1]}×{image.shape[0]} px, the images before it are "
                f"{width}×{height} px",
                hint="Keep the images of one recording, and nothing else, in the folder.",
            )
        return np.asarray(image)


class ImageFolder:
    """Images of one folder in natural order (frame2 before frame10).

    Parameters
    ----------
    path : Path
        The folder.
    whole : bool
        As in `ClipReader.open`.

    Raises
    ------
    ClipError
        If there is no image in it, or the first can't be read.
    """

    def __init__(self, path: Path, *, whole: bool = False) -> None:
        self._paths = sorted((item for item in path.iterdir() if is_image(item)), key=_natural)
        if not self._paths:
            raise ClipError(
                f"there are no images in the folder {path}",
                hint="Give a video file, or a folder of numbered PNG, JPEG, BMP or TIFF images.",
            )
        first = ImageFrame(0, self._paths[0], None).gray()
        self._shape = (int(first.shape[0]), int(first.shape[1]))
        self.damage: tuple[str, ...] = ()
        shrink, note = (1, None) if whole else shrink_of(*self._shape)
        self.upright = Upright(shrink=shrink)
        self.info = ClipInfo(
            path=path,
            sha256=self._digest(),
            width=self._shape[1] // shrink,
            height=self._shape[0] // shrink,
            frames=len(self._paths),
            codec=self._paths[0].suffix.lower().lstrip("."),
            container_fps=1.0,
            container_declares_rate=False,
            duration_s=float(len(self._paths) - 1),
            rotation=0,
            weave="progressive",
            bit_depth=8 * first.dtype.itemsize,
            capture_fps_metadata=None,
            variable_rate=False,
            warnings=() if note is None else (note,),
        )

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Numbers of the images, as times."""
        return np.arange(len(self._paths), dtype=np.float64)

    def pictures(self) -> Iterator[ImageFrame]:
        """Give the images in order."""
        for index, path in enumerate(self._paths):
            yield ImageFrame(index, path, self._shape)

    def _digest(self) -> str:
        digest = hashlib.sha256()
        for path in self._paths:
            digest.update(path.name.encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
        return digest.hexdigest()


def _natural(path: Path) -> list[tuple[int, str]]:
    parts = re.findall(r"\d+|\D+", path.name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


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
        What is known of it.
    """

    def __init__(self, source: VideoFile | ImageFolder, info: ClipInfo, upright: Upright) -> None:
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
    ) -> "ClipReader":
        """Open a video file or a folder of images.

        Parameters
        ----------
        path : path
            The file or folder.
        fields : {"auto", "progressive", "top_first", "bottom_first"}
            Whether pictures are two woven fields; "auto" asks the file and then looks for combing.
        least_frames : int
            Fewer frames than this are refused.
        whole : bool
            Whether pictures keep their size, however large; without, very large ones are shrunk.

        Returns
        -------
        ClipReader

        Raises
        ------
        ClipError
            If nothing can be read, or too few frames.
        """
        place = Path(path)
        if not os.path.exists(place):
            raise ClipError(f"there is no file {place}", hint="Check the name and the folder.")
        if place.is_dir():
            folder = ImageFolder(place, whole=whole)
            clip = cls(folder, folder.info, folder.upright)
        else:
            if not place.is_file():
                raise ClipError(
                    f"{place} is no regular file",
                    hint="Name a video file; a pipe or a device may never end.",
                )
            if place.stat().st_size == 0:
                raise ClipError(
                    f"{place} is empty",
                    hint="Copy it from the camera once more; it has 0 bytes here.",
                )
            clip = cls(*open_video(place, fields, whole=whole))
        if clip.info.frames < least_frames:
            raise ClipError(
                f"{place} holds {clip.info.frames} frame; nothing moves in a still picture",
                hint="Give the whole recording.",
            )
        return clip

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is odd about the file, with the damage met while decoding so far."""
        return self.info.warnings + self._damage

    def capture_times(self, capture_fps: float) -> FloatArray:
        """Times of all frames on the camera's clock.

        Taken from the packets' stamps; once the clip has been read to its end, from the frames that
        came out of it. Where frames were dropped or the rate varies, these are not evenly spaced.

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
        """Give the frames from `start` up to, not including, `stop`, in order.

        Decoding always begins at the first frame, since seeks land on wrong frames in many files.

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
        """Give index and colour image (H, W, 3), blue first, of the same frames as `frames`."""
        for index, _, picture, bottom in self._placed(start, stop):
            image = picture.colour()
            if bottom is not None:
                image = separate_field(image, bottom)
            yield index, self._turned(image)

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
                "left out; those after them may be damaged up to the next key frame.",
            )
        if count != expected:
            self.info = replace(self.info, frames=count)
