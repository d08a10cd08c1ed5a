"""Gray frames of a clip's action, motion clock, scene cuts, capture rate.

`Footage` holds the frames in memory where they fit and decodes them again where they don't.
`MotionClock` advances when something moves: how much a sample of frames shows depends on how far
objects move between samples, not on the frame rate or on pauses. So each frame is compared coarsely
with the last one that differed: slow motion ticks when it has come far enough to be visible, fast
motion with every frame, a still picture hardly ever.
The capture rate comes from option, setup file, metadata or container (`choose_capture_rate`), and
can be estimated from a blinking light or a free fall.
"""

import contextlib
import copy
import math
import shutil
import tempfile
import threading
import weakref
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import pairwise
from typing import IO, TYPE_CHECKING, Any, TypeVar

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrology import CalibrationError, ClipError, NotFoundError, UsageError
from metrology.compiled import compiled
from vision.clip.boomerang import Boomerang
from vision.clip.picture import ClipInfo, GrayImage, refuse_giant

if TYPE_CHECKING:
    from vision.clip.clip import ClipReader

__all__ = [
    "CaptureRate",
    "Footage",
    "GrayFrame",
    "MotionClock",
    "RateEstimate",
    "RateSource",
    "choose_capture_rate",
    "nominal_rate_std",
    "rate_from_blinking",
    "rate_from_fall",
]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]

_MAX_CELL_PX = 8
"""Side of the cells whose means are compared, px (chosen): a ball of 5 px fills a third of one."""

_MIN_CELL_PX = 4
"""Smallest side of a cell, px (chosen): in smaller ones noise exceeds the signal of motion."""

_WORD_BYTES = 8
"""Bytes of a 64-bit word, and so gray levels of 8 bit per word."""

_MIN_CELLS_ACROSS = 24
"""Minimum number of cells across a picture (chosen), so that a small one still locates motion."""

_MOTION_SIGMAS = 8.0
"""Standard deviations by which a cell's mean must change to count as motion (chosen)."""

_MIN_MOTION_CHANGE = 1.5 / 255.0
"""Change that counts as motion, fraction of full scale (derived: one and a half gray levels, more
than rounding)."""

_STILL_TICK = 0.25
"""Ticks of the first still frame (chosen): further ones count 1/2, 1/3, ... of it, so that a long
rest counts hardly more than a short one."""


class MotionClock:
    """Detect motion frame by frame and keep a clock that advances with it.

    Attributes
    ----------
    time : float
        Ticks so far: about one for each frame in which something moved.
    cells : (h, w) float32 array
        Mean gray levels of the last frame's cells.
    """

    def __init__(self) -> None:
        self.time = 0.0
        self.cells = np.zeros((0, 0), dtype=np.float32)
        self._reference: FloatImage | None = None
        self._usual = 0.0
        self._still = 0

    def tick(self, frame: GrayImage) -> bool:
        """Add the next frame (H, W); return whether it differs from the last that differed."""
        cells = self.cells = _cells(frame)
        full = 255.0 if frame.dtype == np.uint8 else 65535.0
        usual = _upper_median(cells)
        if self._reference is None:
            self._reference, self._usual = cells, usual
            return False
        gain = usual / self._usual if self._usual > 0.0 else 1.0
        if _differ(cells, self._reference, gain, full):
            self._reference, self._usual = cells, usual
            self._still = 0
            self.time += 1.0
            return True
        self._still += 1
        self.time += _STILL_TICK / self._still
        return False


def _cells(frame: GrayImage) -> FloatImage:
    height, width = frame.shape
    cell = min(max(min(height, width) // _MIN_CELLS_ACROSS, _MIN_CELL_PX), _MAX_CELL_PX)
    size = (max(1, width // cell), max(1, height // cell))
    trimmed = frame[: max(1, size[1] * cell), : max(1, size[0] * cell)]
    if frame.dtype == np.uint8 and cell == _WORD_BYTES:
        cells = np.empty(size[::-1], dtype=np.float32)
        _cells_of_words(np.ascontiguousarray(trimmed).view(np.uint64), cells)
        return cells
    half = (min(2 * size[0], width), min(2 * size[1], height))
    fine = cv2.resize(trimmed, half, interpolation=cv2.INTER_AREA).astype(np.float32)
    return np.asarray(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


@compiled
def _cells_of_words(words: NDArray[np.uint64], cells: FloatImage) -> None:
    """Means of cells of 8 × 8 gray levels, each row of one read as a 64-bit word.

    Quarters of a cell are averaged in whole gray levels, as OpenCV does. Bytes are summed as four
    numbers of 16 bits in one addition, which takes 0.03 ms of the 0.27 ms of decoding a picture.
    """
    bytes_of, pairs_of = np.uint64(0x00FF00FF00FF00FF), np.uint64(0x0000FFFF0000FFFF)
    one, two, four = np.uint64(8), np.uint64(16), np.uint64(32)
    for row in range(cells.shape[0]):
        for column in range(cells.shape[1]):
            total = 0.0
            for half in range(2):
                pairs = np.uint64(0)
                for k in range(4):
                    word = words[8 * row + 4 * half + k, column]
                    pairs += (word & bytes_of) + ((word >> one) & bytes_of)
                quarters = (pairs & pairs_of) + ((pairs >> two) & pairs_of)
                total += np.rint(np.int64(quarters & np.uint64(0xFFFFFFFF)) / 16.0)
                total += np.rint(np.int64(quarters >> four) / 16.0)
            cells[row, column] = 0.25 * total


def _differ(cells: FloatImage, reference: FloatImage, gain: float, full: float) -> bool:
    """Whether some cell changed by more than its noise, global changes of light excluded."""
    change = np.abs(cells - np.float32(gain) * reference)
    most = float(change.max())
    if most <= _MIN_MOTION_CHANGE * full:
        # Most frames of a long rest end here, before the noise is computed.
        return False
    return most > _MOTION_SIGMAS * 1.4826 * _upper_median(change)


def _upper_median(values: FloatImage) -> float:
    """Upper median; twice as fast as `numpy.median`, since every frame needs it."""
    half = values.size // 2
    ordered = values.ravel().copy()
    ordered.partition(half)
    return float(ordered[half])


_MAX_OTHER_SCENE_CORRELATION, _MIN_SAME_SCENE_CORRELATION, _MIN_SCENE_FRAMES = 0.4, 0.7, 5
"""Correlation below which two pictures show different scenes, above which the same, whatever the
camera's shift; and frames that a new scene must last (chosen)."""

_MAX_FADED_CONTRAST, _MIN_FADED_CHANGE, _MAX_SETTLED_CHANGE = 0.5, 0.3, 0.1
"""Contrast of a faded or blank picture over the usual, at most; relative change of its light, at
least; and that of a picture after the fade, at most (chosen: exposure varies less, and what moves
changes the contrast but not the light)."""


class SceneCuts:
    """Detect scene cuts, and blank or faded ends, from frames given in order."""

    def __init__(self) -> None:
        self._found: list[int] = []
        self._light: list[float] = []
        self._contrast: list[float] = []
        self._steady: FloatImage | None = None
        self._other: list[FloatImage] = []
        self._count = 0

    def add(self, cells: FloatImage) -> None:
        """Add the cells (h, w) of the next frame."""
        structure = _structure(cells)
        self._light.append(float(cells.mean()))
        self._contrast.append(float(cells.std()))
        self._count += 1
        if (
            self._steady is None
            or _structure_correlation(structure, self._steady) > _MAX_OTHER_SCENE_CORRELATION
        ):
            # A single black or damaged frame is not another scene.
            self._steady, self._other = structure, []
            return
        if (
            self._other
            and _structure_correlation(structure, self._other[-1]) < _MIN_SAME_SCENE_CORRELATION
        ):
            self._other = []
        self._other.append(structure)
        if len(self._other) == _MIN_SCENE_FRAMES:
            self._found.append(self._count - _MIN_SCENE_FRAMES)
            self._steady, self._other = structure, []

    @property
    def first(self) -> list[int]:
        """First frames of the scenes after the first one."""
        return sorted({*self._found, *self._fades()})

    def _fades(self) -> list[int]:
        """Ends of a blank or faded beginning and begins of such an end."""
        light, contrast = np.array(self._light), np.array(self._contrast)
        flat = contrast < _MAX_FADED_CONTRAST * np.quantile(contrast, 0.9)
        usual = max(float(np.median(light[~flat])), 1e-9) if not flat.all() else 1.0
        change = np.abs(light / usual - 1.0)
        faded = flat & (change > _MIN_FADED_CHANGE)
        settled = np.flatnonzero(change < _MAX_SETTLED_CHANGE)
        if not len(settled):
            return []
        ends = [int(settled[0])] if faded[0] else []
        ends += [int(settled[-1]) + 1] if faded[-1] else []
        return [one for one in ends if _MIN_SCENE_FRAMES <= one <= len(light) - _MIN_SCENE_FRAMES]


def _structure(cells: FloatImage) -> FloatImage:
    """Local contrast, of unit norm; zero where there is none."""
    fine = cells - cv2.blur(cells, (7, 7))
    # The square root keeps one bright edge from dominating.
    fine = np.copysign(np.sqrt(np.abs(fine)), fine)
    norm = math.sqrt(np.vdot(fine, fine))
    return np.asarray(fine / norm if norm > 0.0 else fine, dtype=np.float32)


def _structure_correlation(one: FloatImage, other: FloatImage) -> float:
    """Correlation of two structures; if it is low without shift, the maximum over shifts.

    A picture without structure correlates with any: it shows no scene.
    """
    straight = float(np.vdot(one, other))
    if straight > _MIN_SAME_SCENE_CORRELATION:
        return straight
    if not (one.any() and other.any()):
        return 1.0
    product = np.fft.rfft2(one) * np.conj(np.fft.rfft2(other))
    return max(straight, float(np.fft.irfft2(product, one.shape).max()))


GrayFrame = NDArray[np.uint8] | NDArray[np.uint16]

_NEUTRAL_LEVEL = 128.0
"""Gray level of an uncoloured pixel in a colour-difference picture: the middle of the scale."""

_MAX_HELD_BYTES = 120_000_000
"""Bytes of frames kept while a clip is read and the action's length is unknown (chosen)."""

_MAX_ACTION_BYTES = 100_000_000
"""Bytes of an action kept in memory (chosen): with copies in colour and in a colour difference
three times as much."""

_MAX_SPILLED_BYTES = 2_000_000_000
"""Bytes of an action kept in a temporary file (chosen): reading there takes a thirtieth of
decoding; a minute of motion on a small picture exceeds it."""

_FREE_SPACE_RATIO = 4
"""Free disk space needed, in sizes of the temporary file (chosen): a colour copy follows,
and other programs need space, too."""

_MAX_SAMPLE_BYTES = 50_000_000
"""Bytes of the even sample of longer clips, which doubles while it is gathered (chosen)."""

_MIN_SAMPLES = 24
"""Minimum number of sampled frames, whatever their size (chosen): a median needs some dozen."""

_DECODE_BLOCK_BYTES = 60_000_000
"""Bytes of neighbouring frames decoded at once (chosen)."""

_MAX_STILL_MARGIN = 60
"""Still frames kept before the first motion and after the last (chosen): enough for a
background."""

_MAX_STILL_MARGIN_BYTES = 40_000_000
"""Bytes of these still frames (chosen)."""

_MIN_PICTURE_SIDE_PX = 16
"""Shortest side of a picture, px (chosen): a ball of 5 px with as much around it."""

_IDLE_WEIGHT = 0.15
"""Weight of frame number relative to motion time where a sample of frames is spread (chosen)."""


_Picture = TypeVar("_Picture", bound=GrayFrame)


class _Spilled(Sequence[_Picture]):
    """Frames in an unnamed temporary file, deleted with the last reference to it.

    Parameters
    ----------
    frames : iterable of (H, W) arrays
        All of one size and type, in time order.
    """

    def __init__(self, frames: Iterable[_Picture]) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115, lives as long as this
        weakref.finalize(self, _closed, self._file)
        self._reading = threading.Lock()
        self._count = 0
        for frame in frames:
            self._shape, self._type, self._size = frame.shape, frame.dtype, frame.nbytes
            self._file.write(np.ascontiguousarray(frame).data)
            self._count += 1
        # Flush here, where a full disk still means that nothing is kept.
        self._file.flush()

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: Any) -> Any:
        frame = np.empty(self._shape, self._type)
        with self._reading:
            self._file.seek(int(index) * self._size)
            self._file.readinto(frame.data)
        return frame


def _closed(file: IO[bytes]) -> None:
    with contextlib.suppress(OSError):  # closing flushes again, which fails on a full disk
        file.close()


def _stored(frames: Iterable[_Picture], size: int) -> Sequence[_Picture] | None:
    """Frames of `size` bytes in memory or in a file; None where they fit in neither."""
    if size < _MAX_ACTION_BYTES:
        return list(frames)
    try:
        free = shutil.disk_usage(tempfile.gettempdir()).free
        return (
            _Spilled(frames) if size < min(_MAX_SPILLED_BYTES, free // _FREE_SPACE_RATIO) else None
        )
    except OSError:  # no writable place: decoding again is slower but gives the same frames
        return None


_KEEPING_COST = 3.0
"""Decodings of all colour pictures after which keeping them is worth its cost (chosen)."""


class _Colours:
    """Colour pictures of an action, kept once decoding them has cost as much as keeping them."""

    def __init__(self, clip: "ClipReader", first: int, count: int, pixels: int) -> None:
        self._clip, self._first, self._count = clip, first, count
        self._size, self._decodings = 3 * count * pixels, 0.0

    @cached_property
    def _held(self) -> Sequence[NDArray[np.uint8]] | None:
        return _stored((image for _, image in self._decoded(0, self._count)), self._size)

    def _decoded(self, start: int, stop: int) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        for index, image in self._clip.colour_frames(self._first + start, self._first + stop):
            yield index - self._first, image

    def pictures(self, rows: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """Yield the pictures (H, W, 3) of increasing rows of the action, blue first."""
        if len(rows) == 0:
            return
        start, stop = int(rows[0]), int(rows[-1]) + 1
        if self._decodings >= _KEEPING_COST and self._held is not None:
            yield from ((row, self._held[row]) for row in rows.tolist())
            return
        self._decodings += (stop - start) / self._count
        chosen = set(rows.tolist())
        for row, image in self._decoded(start, stop):
            if row in chosen:
                yield row, image


class Footage:
    """Gray frames of one clip's action, for repeated access while tracking.

    Still frames before the first motion and after the last are dropped except for a margin. Short
    clips are decoded once and held, longer ones kept in a temporary file. Of very long ones only a
    sample and the neighbours of the last frames requested are held and others decoded again, so
    that memory does not grow with the clip. Frames are counted on the camera's even clock from
    `first` on, including those missing from the file.

    Parameters
    ----------
    clip : ClipReader
        The clip.
    sample : int
        Number of frames, spread evenly over the motion, that are always held.
    progress : callable, optional
        Called with the number of frames decoded so far.
    part : tuple of int, optional
        First frame, and the one after the last, of the part of the clip to use; all without.
    lacks : sequence of (int, int)
        Dropped frames that the time stamps do not show: frame of the clip after which they are
        missing, and their number.

    Attributes
    ----------
    parts : tuple of (int, int)
        First frame, and the one after the last, of each scene of the clip.
    backwards : int or None
        The clip's frame from which it shows the same backwards.
    first : int
        The clip's frame that is frame 0 here.
    started : int
        The same counted with missing frames.
    shown : (n,) int array
        Frames of the action present in the file.
    count : int
        Number of frames of the action, missing ones included.
    whole_count : int
        Number of frames of the clip.
    clock : (count,) array
        Motion time (`MotionClock`), ticks.
    sample_index : (n,) int array
        Frames held as the sample.
    shape : (2,) tuple of int
        Height and width, px.
    full_scale : float
        Gray level of white: 255, or 65535 for clips of more than 8 bit.
    """

    def __init__(
        self,
        clip: "ClipReader",
        *,
        sample: int = 96,
        progress: Callable[[int], None] | None = None,
        part: tuple[int, int] | None = None,
        lacks: Sequence[tuple[int, int]] = (),
    ) -> None:
        self._clip = clip
        self._block: dict[int, GrayFrame] = {}
        self._tint: FloatArray | None = None
        gathered = _Gathered(sample)
        times: list[float] = []
        begin, end = (0, None) if part is None else part
        for frame in clip.frames(begin, end):
            _check_size(*frame.gray.shape)
            gathered.add(frame.gray)
            times.append(frame.time_s)
            if progress is not None:
                progress(len(times))
        if not times:
            raise NotFoundError("the clip contains no frame")
        gathered.finish()
        self._held: Sequence[GrayFrame] | None = gathered.held
        self.whole_count = begin + len(times)
        turned = gathered.boomerang.turned
        self.backwards = None if turned is None else begin + turned
        firsts = {*gathered.cuts.first, *([] if turned is None else [turned])}
        marks = [begin, *(begin + first for first in sorted(firsts)), self.whole_count]
        self.parts = tuple(pairwise(marks))
        self.first = begin + gathered.first
        beats = _beats(np.array(times))
        for after, many in lacks:
            beats[max(after + 1 - begin, 0) :] += many
        self.started = begin + int(beats[gathered.first])
        self.shown: NDArray[np.int64] = (
            beats[gathered.first :][: len(gathered.clock)] - beats[gathered.first]
        )
        self.count = int(self.shown[-1]) + 1
        self._row = np.full(self.count, -1, dtype=np.int64)
        self._row[self.shown] = np.arange(len(self.shown))
        self.clock = np.array(gathered.clock)[np.maximum.accumulate(self._row)]
        rows = sorted(gathered.sample)
        self.sample_index = self.shown[rows]
        self._sample, one = gathered.sample, gathered.sample[rows[0]]
        self.shape = int(one.shape[0]), int(one.shape[1])
        self.full_scale, self._frame_bytes = 255.0 if one.dtype == np.uint8 else 65535.0, one.nbytes
        self._colours = _Colours(clip, self.first, len(self.shown), one.size)
        if self._held is None:
            size = len(self.shown) * one.nbytes
            pictures = (picture for _, picture in self._decoded(0, len(self.shown)))
            self._held = _stored(pictures, size)
        if self._held is not None:
            self._sample = {}

    def tinted(self, blueness: float, redness: float) -> "Footage":
        """The same frames as a colour-difference picture instead of gray.

        Parameters
        ----------
        blueness, redness : float
            Weights of the colour differences C_B and C_R of ITU-R BT.601.

        Returns
        -------
        Footage
            Gray level 128 means no colour; a shadow has none.
        """
        other = copy.copy(self)
        luma = np.array([0.114, 0.587, 0.299])
        blue = 0.5 * (np.array([1.0, 0.0, 0.0]) - luma) / (1.0 - luma[0])
        red = 0.5 * (np.array([0.0, 0.0, 1.0]) - luma) / (1.0 - luma[2])
        other._tint = np.array([[*(blueness * blue + redness * red), _NEUTRAL_LEVEL]])
        other._block, other._held, other.full_scale = {}, None, 255.0
        height, width = self.shape
        other._frame_bytes = height * width
        if self._held is not None:
            pictures = (picture for _, picture in other._decoded(0, len(self.shown)))
            other._held = _stored(pictures, len(self.shown) * height * width)
        return other

    def coloured(self, wanted: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """Yield the requested frames present in the file (H, W, 3), blue first, in time order."""
        for row, image in self._colours.pictures(self._held_of(wanted)):
            yield int(self.shown[row]), image

    def missing(self, index: int) -> bool:
        """Whether a frame is missing from the file."""
        return bool(self._row[index] < 0)

    def in_clip(self, index: int) -> int:
        """Number in the clip of a frame, or of the last one before it that the file holds."""
        row = np.searchsorted(self.shown, index, side="right") - 1
        return self.first + int(np.clip(row, 0, len(self.shown) - 1))

    def of_clip(self, index: int) -> int:
        """Number here of a frame of the clip; extrapolated beyond the ends."""
        row = index - self.first
        last = len(self.shown) - 1
        return int(self.shown[min(max(row, 0), last)]) + min(row, 0) + max(row - last, 0)

    def _held_of(self, wanted: NDArray[np.int64]) -> NDArray[np.int64]:
        """Rows of the requested frames that the file holds."""
        rows = self._row[wanted]
        return rows[rows >= 0]

    def _decoded(self, start: int, stop: int) -> Iterator[tuple[int, GrayFrame]]:
        """Pictures of the action from `start` up to, not including, `stop`, decoded again."""
        if self._tint is None:
            for frame in self._clip.frames(self.first + start, self.first + stop):
                yield frame.index - self.first, frame.gray
            return
        for row, image in self._colours.pictures(np.arange(start, min(stop, len(self.shown)))):
            yield row, np.asarray(cv2.transform(image, self._tint), dtype=np.uint8)

    def moved_in(self, part: tuple[int, int]) -> float:
        """Motion from a frame of the clip up to, not including, another one, ticks."""
        rows = np.array([part[0] - self.first, part[1] - 1 - self.first])
        ends = self.shown[np.clip(rows, 0, len(self.shown) - 1)]
        return float(self.clock[ends[1]] - self.clock[ends[0]])

    def frames(self, wanted: NDArray[np.int64]) -> Iterator[tuple[int, GrayFrame]]:
        """Yield the requested frames that the file holds, in time order.

        Parameters
        ----------
        wanted : (n,) int array
            Frame indices, increasing.

        Yields
        ------
        index : int
        gray : (H, W) array
        """
        for row, picture in self._pictures(self._held_of(wanted)):
            yield int(self.shown[row]), picture

    def _pictures(self, rows: NDArray[np.int64]) -> Iterator[tuple[int, GrayFrame]]:
        if len(rows) == 0:
            return
        if self._held is not None:
            for row in rows.tolist():
                yield row, self._held[row]
            return
        if int(rows[-1]) - int(rows[0]) < self._block_length():
            yield from self._from_block(rows)
            return
        chosen = set(rows.tolist())
        for row, picture in self._decoded(int(rows[0]), int(rows[-1]) + 1):
            if row in chosen:
                yield row, picture

    def spread(self, count: int) -> NDArray[np.int64]:
        """At most `count` frames spread evenly over motion time, with some over the pauses."""
        return self._spread(self.shown, count)

    def spread_sample(self, count: int) -> list[GrayFrame]:
        """At most `count` frames of the sample, spread as in `spread`, in time order."""
        held = self._sample if self._held is None else self._held
        return [held[row] for row in self._row[self.spread_index(count)].tolist()]

    def spread_index(self, count: int) -> NDArray[np.int64]:
        """Indices of the frames of `spread_sample`."""
        return self._spread(self.sample_index, count)

    def _spread(self, frames: NDArray[np.int64], count: int) -> NDArray[np.int64]:
        if len(frames) <= count:
            return frames
        ticks = self.clock[frames] - self.clock[frames[0]]
        along = ticks / max(float(ticks[-1]), 1e-6) + _IDLE_WEIGHT * frames / frames[-1]
        marks = np.linspace(along[0], along[-1], count)
        return np.asarray(np.unique(frames[np.searchsorted(along, marks)]))

    def _block_length(self) -> int:
        return max(8, _DECODE_BLOCK_BYTES // self._frame_bytes)

    def _from_block(self, rows: NDArray[np.int64]) -> Iterator[tuple[int, GrayFrame]]:
        """Neighbouring pictures, decoded together with those around them."""
        if not all(row in self._block for row in rows.tolist()):
            spare = self._block_length() - (int(rows[-1]) - int(rows[0]) + 1)
            first = max(0, int(rows[0]) - spare // 2)
            # Release the old block before decoding the new one.
            self._block = {}
            self._block = dict(self._decoded(first, first + self._block_length()))
        for row in rows.tolist():
            yield row, self._block[row]


_MAX_CLOCK_DEVIATION = 0.1
"""Deviation of a frame from an even clock, intervals (chosen; fitted times carry no rounding)."""


def _beats(time_s: FloatArray) -> NDArray[np.int64]:
    """Tick number of each frame on an even clock; the frame order where no such clock fits.

    A gap longer than all frames together counts as no more than their number.
    """
    order = np.arange(len(time_s))
    if len(time_s) < _MIN_CLOCK_FRAMES:
        return order
    steps = np.diff(time_s)
    usual = float(np.median(steps))
    beats = (time_s - time_s[0]) / usual if usual > 0.0 else order.astype(np.float64)
    whole = np.rint(beats)
    if not np.all(np.diff(whole) >= 1.0) or np.abs(beats - whole).max() > _MAX_CLOCK_DEVIATION:
        return order
    return np.concatenate([[0], np.cumsum(np.minimum(np.diff(whole), len(whole)))]).astype(np.int64)


_MIN_CLOCK_FRAMES = 3
"""Minimum number of frames for an even clock (derived: two intervals to compare)."""


def _check_size(height: int, width: int) -> None:
    if min(height, width) < _MIN_PICTURE_SIDE_PX:
        raise ClipError(
            f"pictures of {width} × {height} px are too small to track an object",
            hint=f"Each side needs at least {_MIN_PICTURE_SIDE_PX} px.",
        )
    refuse_giant(height, width)


_MAX_DISTURBANCE_FRAMES, _DISTURBANCE_MARGINS = 4, 2
"""Moving frames of an action that may be a disturbance (derived: too few to fit and test a motion
model), and margins of still frames after which it is over (chosen)."""


@dataclass(frozen=True, eq=False)
class _Action:
    """An action that may be only a disturbance before the real one.

    Attributes
    ----------
    first : int
        Its first frame.
    clock : list of float
        Ticks at its frames.
    sample : dict
        Frames spread over it, by index.
    held : list or None
        All of them, where they fit.
    moves : int
        Frames in which something moved.
    """

    first: int
    clock: list[float]
    sample: dict[int, GrayFrame]
    held: list[GrayFrame] | None
    moves: int


class _Gathered:
    """Frames selected while the clip is decoded."""

    def __init__(self, sample: int) -> None:
        self.held: list[GrayFrame] | None = []
        self.sample: dict[int, GrayFrame] = {}
        self.clock: list[float] = []
        self.first = 0
        self._wanted = sample
        self._motion = MotionClock()
        self.cuts = SceneCuts()
        self.boomerang = Boomerang()
        self._before_motion: deque[tuple[float, GrayFrame]] = deque()
        self._started = False
        self._last_motion = 0
        self._size = 0
        self._stride = 0.0
        self._margin = 0
        self._moves = 0
        self._told = 0
        self._aside: _Action | None = None

    def add(self, gray: GrayFrame) -> None:
        """Add the next frame."""
        moved = self._motion.tick(gray)
        self.cuts.add(self._motion.cells)
        self.boomerang.add(self._motion.cells)
        self._moves += moved
        self._told += 1
        if moved and not self._started:
            self._start()
        if self._started:
            self._store(self._motion.time, gray)
            since = len(self.clock) - 1 - self._last_motion
            few = self._aside is None and self._moves <= _MAX_DISTURBANCE_FRAMES
            if few and since > self._margin:
                self._wait(gray)
                if since > _DISTURBANCE_MARGINS * self._margin:
                    self._set_aside()
        else:
            self._margin = max(3, min(_MAX_STILL_MARGIN, _MAX_STILL_MARGIN_BYTES // gray.nbytes))
            self._wait(gray)
        if moved:
            self._last_motion = len(self.clock) - 1

    def _wait(self, gray: GrayFrame) -> None:
        """Keep a still frame that may be one of the last before the action."""
        self._before_motion.append((self._motion.time, gray))
        if len(self._before_motion) > self._margin:
            self._before_motion.popleft()
            if not self._started:
                self.first += 1

    def _start(self) -> None:
        self._started = True
        for time, gray in self._before_motion:
            self._store(time, gray)
        self._before_motion.clear()

    def _set_aside(self) -> None:
        """Set an early action of few moving frames aside; the real one may follow.

        A codec settles over the first few frames, or a light flashes. That happens once: repeated
        small motion is a slow action.
        """
        self.finish()
        self._aside = _Action(self.first, self.clock, self.sample, self.held, self._moves)
        self.first = self._told - len(self._before_motion)
        self.clock, self.sample, self.held = [], {}, []
        self._started, self._last_motion, self._moves = False, 0, 0
        self._size, self._stride = 0, 0.0

    def finish(self) -> None:
        """Drop frames after the last motion; of two actions keep the longer."""
        if self._aside is not None and self._moves <= self._aside.moves:
            aside = self._aside
            self.first, self.clock, self.sample = aside.first, aside.clock, aside.sample
            self.held = aside.held
            return
        if not self._started:
            self._start()
            return
        count = min(len(self.clock), self._last_motion + 1 + self._margin)
        self.clock = self.clock[:count]
        self.sample = {index: gray for index, gray in self.sample.items() if index < count}
        if self.held is not None:
            self.held = self.held[:count]

    def _store(self, time: float, gray: GrayFrame) -> None:
        index = len(self.clock)
        self.clock.append(time)
        late = index > self._last_motion + self._margin
        if self.held is not None and not late:
            if len(self.held) < index:
                # After a long pause in the action, frames are decoded on request.
                self.held = None
            else:
                self._size += gray.nbytes
                self.held.append(gray)
                if self._size > _MAX_HELD_BYTES:
                    self.held = None
        if not self._stride or self._bucket(index) > self._bucket(next(reversed(self.sample))):
            self.sample[index] = gray
            if len(self.sample) > self._most(gray):
                self._thin_out()

    def _most(self, gray: GrayFrame) -> int:
        return 2 * min(self._wanted, max(_MIN_SAMPLES, _MAX_SAMPLE_BYTES // gray.nbytes))

    def _bucket(self, index: int) -> int:
        return int((self.clock[index] - self.clock[0]) / self._stride)

    def _thin_out(self) -> None:
        spent = max(self.clock[-1] - self.clock[0], 1e-6)
        self._stride = max(2.0 * self._stride, 2.0 * spent / len(self.sample))
        kept: dict[int, GrayFrame] = {}
        last = -1
        for index, gray in self.sample.items():
            if self._bucket(index) > last:
                kept[index] = gray
                last = self._bucket(index)
        self.sample = kept


class RateSource(StrEnum):
    """Source of the capture rate, in order of preference."""

    OPTION = "option"
    SETUP = "setup"
    METADATA = "metadata"
    CONTAINER = "container"
    ASSUMED = "assumed"


ASSUMED_FPS = 600.0
"""Capture rate assumed where none is given, fps (convention: the camera of Ryu et al.)."""

HIGH_SPEED_FPS = 119.0
"""Container rate from which it is the camera's, fps (derived: 119.88 is the slowest nominal
120)."""

_NOMINAL_RATE_STD = (1.0 / 1001.0) / math.sqrt(12.0)
"""Relative standard uncertainty of a nominal rate (derived: uniform between it and 1000/1001 of it,
the broadcast rate of SMPTE ST 12)."""


@dataclass(frozen=True)
class CaptureRate:
    """Frame rate of the camera.

    Attributes
    ----------
    fps : float
        Frames (fields, where they are separated) per second of real time.
    std : float
        Its standard uncertainty, 1/s; infinite where the rate is only assumed.
    source : RateSource
        Where the number comes from.
    notice : str or None
        Warning for the user.
    """

    fps: float
    std: float
    source: RateSource
    notice: str | None = None

    @property
    def known(self) -> bool:
        """Whether the rate has a source; without one there are no seconds."""
        return math.isfinite(self.std)


def nominal_rate_std(fps: float) -> float:
    """Standard uncertainty of a nominal rate, 1/s: 600 may be 599.4."""
    return fps * _NOMINAL_RATE_STD


def choose_capture_rate(
    info: ClipInfo,
    option: float | None = None,
    setup: float | None = None,
    *,
    option_std: float | None = None,
    setup_std: float | None = None,
) -> CaptureRate:
    """Choose the rate: option, setup file, metadata, high container rate, else 600 assumed.

    Parameters
    ----------
    info : ClipInfo
        Of the clip.
    option, setup : float, optional
        Rate from the command line and from the setup file, 1/s.
    option_std, setup_std : float, optional
        Their standard uncertainties, 1/s; without, the rate may be the nominal or broadcast one.

    Returns
    -------
    CaptureRate

    Raises
    ------
    UsageError
        If a given rate is not positive.
    """
    if option is not None:
        return _given(option, option_std, RateSource.OPTION, info)
    if setup is not None:
        return _given(setup, setup_std, RateSource.SETUP, info)
    if info.capture_fps_metadata is not None:
        metadata_fps = info.capture_fps_metadata
        return CaptureRate(metadata_fps, nominal_rate_std(metadata_fps), RateSource.METADATA)
    rate = info.container_fps
    if info.container_declares_rate and rate >= HIGH_SPEED_FPS:
        return CaptureRate(rate, nominal_rate_std(rate), RateSource.CONTAINER)
    said = f"{rate:.4g} frames per second" if info.container_declares_rate else "no frame rate"
    return CaptureRate(
        ASSUMED_FPS,
        math.inf,
        RateSource.ASSUMED,
        f"The camera's frame rate is not known: the file declares {said}. "
        f"{ASSUMED_FPS:g} fps are assumed. Times and speeds are given only if a free fall with a "
        "known scale determines the rate. Pass --fps RATE, or set capture_fps in the setup file.",
    )


def _given(fps: float, std: float | None, source: RateSource, info: ClipInfo) -> CaptureRate:
    if not (math.isfinite(fps) and fps > 0):
        raise UsageError(
            f"a capture rate of {fps:g} fps is not positive", hint="Pass, for example, --fps 600."
        )
    told = info.capture_fps_metadata
    notice = None
    if told is not None and abs(told / fps - 1.0) > 0.005:
        notice = f"The file states {told:g} fps, the {source} {fps:g} fps; the {source} is used."
    std = nominal_rate_std(fps) if std is None else std
    times = float(info.times_shown)
    shown = times * info.container_fps
    if info.times_shown > 1 and info.container_declares_rate and abs(fps / shown - 1.0) < 0.005:
        fps, std = fps / times, std / times
        notice = (
            f"The {source} gives the rate of the file, {shown:g} fps, which shows each picture "
            f"{times:g} times, so {fps:g} different pictures per second are used."
        )
    pictures = 0.5 * info.container_fps
    if info.interlaced and info.container_declares_rate and abs(fps / pictures - 1.0) < 0.005:
        # The file holds that many pictures, each of two fields taken apart in time.
        fps, std = 2.0 * fps, 2.0 * std
        notice = (
            f"The {source} gives the rate of the interlaced pictures, {0.5 * fps:g} fps. Each has "
            f"two fields, so {fps:g} fields per second are used."
        )
    return CaptureRate(fps, std, source, notice)


MIN_BLINK_LOG_RATIO = 8.0
"""Log-likelihood ratio above the best of pure noise (chosen: odds of three thousand to one)."""
MAX_FALSE_BLINK_PROBABILITY = 1e-3
"""Probability that noise is taken for a blinking light (chosen: one clip in a thousand)."""


@dataclass(frozen=True)
class RateEstimate:
    """A capture rate and its standard uncertainty, frames per second."""

    fps: float
    std: float
    source: str


def rate_from_blinking(
    brightness: ArrayLike, blink_hz: float, *, blink_std_hz: float = 0.0, nominal_fps: float
) -> RateEstimate:
    """Capture rate from a light of known blinking rate.

    Parameters
    ----------
    brightness : (N,) array
        Mean gray level at the light, frame by frame.
    blink_hz, blink_std_hz : float
        Rate of the light and its uncertainty, Hz.
    nominal_fps : float
        Approximate rate, within a third of the true one; distinguishes the blink from its aliases.

    Returns
    -------
    RateEstimate

    Raises
    ------
    CalibrationError
        If nothing blinks there, or the light is too fast for this camera.
    """
    signal = np.asarray(brightness, dtype=np.float64)
    if blink_hz > nominal_fps / 2.5:
        raise CalibrationError(
            f"a light of {blink_hz:g} Hz blinks too fast for about {nominal_fps:g} fps",
            hint="Use a light that blinks at less than two fifths of the capture rate.",
        )
    count = len(signal)
    if count * blink_hz / nominal_fps < 3.0:
        raise CalibrationError(
            "the clip contains fewer than three blinks",
            hint="Film longer, or use a light that blinks faster.",
        )
    time = np.arange(count, dtype=np.float64) - 0.5 * (count - 1)
    signal = np.asarray(signal - np.polynomial.Polynomial.fit(time, signal, 1)(time))
    expected = blink_hz / nominal_fps
    trial = np.arange(expected / 1.34, expected * 1.5, 0.1 / count)
    power = np.array([_sine_power(signal, time, f) for f in trial])
    best = float(trial[int(np.argmax(power))])
    for width in (0.1, 0.01, 0.001):
        near = best + np.linspace(-1.0, 1.0, 21) * width / count
        best = float(near[int(np.argmax([_sine_power(signal, time, f) for f in near]))])
    explained = _sine_power(signal, time, best)
    rest = float(signal @ signal) - explained
    noise = max(rest, 1e-12) / (count - 4)
    # An F test of two coefficients, for the best of as many independent frequencies as were tried
    independent = max(2.0, (trial[-1] - trial[0]) * count)
    if (
        explained / (2.0 * noise)
        < MIN_BLINK_LOG_RATIO + np.log(independent / MAX_FALSE_BLINK_PROBABILITY) / 2.0
    ):
        raise CalibrationError(
            f"no blinking of {blink_hz:g} Hz found at the marked place",
            hint="Mark the light itself, and check its rate.",
        )
    amplitude2 = 2.0 * explained / count
    # Cramér–Rao bound of the frequency of a sine in white noise (Rife & Boorstyn 1974)
    std = np.sqrt(6.0 * noise / (np.pi**2 * amplitude2 * count * (count**2 - 1.0)))
    fps = blink_hz / best
    relative = np.hypot(std / best, blink_std_hz / blink_hz)
    return RateEstimate(fps, float(fps * relative), "blinking light")


def _sine_power(signal: FloatArray, time: FloatArray, frequency: float) -> float:
    """Sum of squares explained by the best sine of a frequency (per frame)."""
    angle = 2.0 * np.pi * frequency * time
    design = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    right = design.T @ signal
    return float(right @ np.linalg.solve(design.T @ design, right))


def rate_from_fall(
    heights_m: ArrayLike,
    std_m: ArrayLike,
    frames: ArrayLike,
    *,
    acceleration: float,
    relative_scale_std: float = 0.0,
) -> RateEstimate:
    """Capture rate from free fall with a known scale.

    Parameters
    ----------
    heights_m, std_m : (N,) array
        Heights and their independent standard uncertainties, m.
    frames : (N,) array
        Frame numbers.
    acceleration : float
        Expected downward acceleration, m/s².
    relative_scale_std : float
        Relative standard uncertainty of the scale of the heights.

    Returns
    -------
    RateEstimate

    Raises
    ------
    CalibrationError
        If the heights are not those of a free fall.
    """
    y, std = np.asarray(heights_m, dtype=np.float64), np.asarray(std_m, dtype=np.float64)
    n = np.asarray(frames, dtype=np.float64)
    n = n - n.mean()
    design = np.stack([np.ones_like(n), n, -0.5 * n**2], axis=1) / std[:, np.newaxis]
    inverse = np.linalg.inv(design.T @ design)
    per_frame2 = float((inverse @ design.T @ (y / std))[2])
    if per_frame2 <= 3.0 * np.sqrt(inverse[2, 2]):
        raise CalibrationError(
            "the heights are not those of a free fall",
            hint="Use an interval of flight after the release.",
        )
    fps = float(np.sqrt(acceleration / per_frame2))
    relative = 0.5 * np.hypot(np.sqrt(inverse[2, 2]) / per_frame2, relative_scale_std)
    return RateEstimate(fps, float(fps * relative), "free fall")
