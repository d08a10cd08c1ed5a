"""A clip's gray frames, held in memory where they fit and decoded again where they don't.

A clock that ticks when something moves: frames before and after the action count for nothing.

What a look at every so-many frames can tell depends on how far things move between looks, not on
the frame rate nor on how long nothing happened. So each frame is held, coarsely, against the last
one that differed: a slow motion ticks when it has come far enough to be seen, a fast one with every
frame, a still picture hardly ever.

How many frames per second the camera took, who says so, and how well it is known.

The capture rate, checked against what keeps time in view: a blinking light, free fall.
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
from itertools import pairwise
from typing import IO, TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrology import CalibrationError, ClipError, NotFoundError, UsageError
from metrology.compiled import compiled
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

# Side of the cells whose means are compared, px: a ball of 5 px fills a third of one.
_CELL = 8

_FINEST_CELL = 4
"""px: smaller cells are noisier than what moves is strong."""

_BYTES = 8
"""Of a word: a cell's width in gray levels of 8 bits for which its rows are words."""

# A small picture still gets so many cells across.
_CELLS_ACROSS = 24
"""Cells across a picture at least, so that a small one still shows where something moves."""

# Means of a cell that move by so many of their own noise, and at least this much of white, moved.
_SIGMA = 8.0

_LEAST_CHANGE = 1.5 / 255.0
"""Of full scale, one and a half gray levels: less is rounding."""

# Still frames tick like 1, 1/2, 1/3, ... of this.
_STILL_TICK = 0.25
"""Frames: still frames tick like 1, 1/2, 1/3, ... of this, so that a long rest counts as little as
a short one."""


class MotionClock:
    """Tells for each frame shown to it, in order, whether something moved, and keeps the time.

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
        """Show the next frame (H, W); says whether it differs from the last that differed."""
        cells = self.cells = _cells(frame)
        full = 255.0 if frame.dtype == np.uint8 else 65535.0
        usual = _middle(cells)
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
    cell = min(max(min(height, width) // _CELLS_ACROSS, _FINEST_CELL), _CELL)
    size = (max(1, width // cell), max(1, height // cell))
    trimmed = frame[: max(1, size[1] * cell), : max(1, size[0] * cell)]
    if frame.dtype == np.uint8 and cell == _BYTES:
        cells = np.empty(size[::-1], dtype=np.float32)
        _cells_of_words(np.ascontiguousarray(trimmed).view(np.uint64), cells)
        return cells
    half = (min(2 * size[0], width), min(2 * size[1], height))
    fine = cv2.resize(trimmed, half, interpolation=cv2.INTER_AREA).astype(np.float32)
    return np.asarray(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


@compiled
def _cells_of_words(words: NDArray[np.uint64], cells: FloatImage) -> None:
    """Means of cells of eight by eight gray levels, each row of one read as a word.

    Of the means of its quarters in whole gray levels, as OpenCV gives them. Bytes are summed as
    four numbers of 16 bits in one addition: 0.03 ms of a picture that takes 0.27 to decode.
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
    """Whether some cell changed by more than its noise, a change of light left aside."""
    change = np.abs(cells - np.float32(gain) * reference)
    most = float(change.max())
    if most <= _LEAST_CHANGE * full:
        # most frames of a long still: their noise need not be told
        return False
    return most > _SIGMA * 1.4826 * _middle(change)


def _middle(values: FloatImage) -> float:
    """Upper median; `numpy.median` takes twice as long, and it is taken of every frame."""
    half = values.size // 2
    ordered = values.ravel().copy()
    ordered.partition(half)
    return float(ordered[half])


# Pictures of one scene correlate by more than the second, of two by less than the first, whatever
# the camera shifts by; a new scene is there for so many frames.
_OTHER_SCENE, _SAME_SCENE, _FEWEST_FRAMES = 0.4, 0.7, 5


class SceneCuts:
    """Finds where a clip goes on with another scene: frames are shown to it in order.

    Attributes
    ----------
    first : list of int
        First frames of the scenes after the first one.
    """

    def __init__(self) -> None:
        self.first: list[int] = []
        self._steady: FloatImage | None = None
        self._other: list[FloatImage] = []
        self._count = 0

    def add(self, cells: FloatImage) -> None:
        """Show the cells (h, w) of the next frame."""
        structure = _structure(cells)
        self._count += 1
        if self._steady is None or _alike(structure, self._steady) > _OTHER_SCENE:
            # A black frame, or a damaged one, is no other scene.
            self._steady, self._other = structure, []
            return
        if self._other and _alike(structure, self._other[-1]) < _SAME_SCENE:
            self._other = []
        self._other.append(structure)
        if len(self._other) == _FEWEST_FRAMES:
            self.first.append(self._count - _FEWEST_FRAMES)
            self._steady, self._other = structure, []


def _structure(cells: FloatImage) -> FloatImage:
    """What stands out of its surroundings, of unit norm; zero where nothing does."""
    fine = cells - cv2.blur(cells, (7, 7))
    # Compressed, so that one bright edge is not all there is.
    fine = np.copysign(np.sqrt(np.abs(fine)), fine)
    norm = math.sqrt(np.vdot(fine, fine))
    return np.asarray(fine / norm if norm > 0.0 else fine, dtype=np.float32)


def _alike(one: FloatImage, other: FloatImage) -> float:
    """Correlation of two structures, at the shift at which it is highest where it is low at none.

    One without structure is like anything: it shows no scene.
    """
    straight = float(np.vdot(one, other))
    if straight > _SAME_SCENE:
        return straight
    if not (one.any() and other.any()):
        return 1.0
    product = np.fft.rfft2(one) * np.conj(np.fft.rfft2(other))
    return max(straight, float(np.fft.irfft2(product, one.shape).max()))


GrayFrame = NDArray[np.uint8] | NDArray[np.uint16]

_NEUTRAL = 128.0
"""Level of a picture in one colour where there is none of it: the middle of the scale."""

_HELD_BYTES = 120_000_000
"""Bytes of frames that are kept while a clip is read and its action's length is not known yet."""

_ACTION_BYTES = 350_000_000
"""Bytes of an action that is kept whole once its length is known, supposed: with a picture of one
colour beside it, a gigabyte holds it, and looks at some hundred thousand frames are not decoded."""

_SPILLED_BYTES = 2_000_000_000
"""Bytes of an action that is kept in a temporary file, supposed: a look there costs a thirtieth of
decoding, and what moves for a minute on a small picture goes beyond it."""

_SPARE_SPACE = 4
"""Of a temporary file's size, what must be free where it is written: a picture of one colour
follows beside it, and others need room, too."""

# Of longer clips: the even sample, which doubles while it is gathered, and a block of neighbours.
_SAMPLE_BYTES = 50_000_000

_FEWEST_SAMPLES = 24
"""Frames of a spread sample at least, however large they are: a median needs some dozen."""

_BLOCK_BYTES = 60_000_000
"""Bytes that are worked on at once."""

# Still frames kept before the first motion and after the last: enough to know what lay still.
_MARGIN = 60

_MARGIN_BYTES = 40_000_000
"""Bytes of the frames before and after the span that are kept."""

_SMALLEST_SIDE = 16
"""px: a ball of 5 px with as much around it."""

# Weight of plain time beside the time told by motion, where frames are spread.
_IDLE_SHARE = 0.15


class _Spilled(Sequence[GrayFrame]):
    """Frames in a temporary file, which has no name and goes with what refers to it.

    Parameters
    ----------
    frames : iterable of (H, W) arrays
        All of one size and type, in time order.
    """

    def __init__(self, frames: Iterable[GrayFrame]) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115, lives as long as this
        weakref.finalize(self, _closed, self._file)
        self._reading = threading.Lock()
        self._count = 0
        for frame in frames:
            self._shape, self._type, self._size = frame.shape, frame.dtype, frame.nbytes
            self._file.write(np.ascontiguousarray(frame).data)
            self._count += 1
        # here, while a full disk still means that nothing is kept
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
    with contextlib.suppress(OSError):  # what a full disk did not take is not asked for again
        file.close()


def _kept(frames: Iterable[GrayFrame], size: int) -> Sequence[GrayFrame] | None:
    """Frames of so many bytes in memory or in a file; None where they are too many for either."""
    if size < _ACTION_BYTES:
        return list(frames)
    try:
        free = shutil.disk_usage(tempfile.gettempdir()).free
        return _Spilled(frames) if size < min(_SPILLED_BYTES, free // _SPARE_SPACE) else None
    except OSError:  # nowhere to write: decoding again takes longer and gives the same
        return None


class Footage:
    """Gray frames of one clip's action for the several looks that tracking takes.

    Still frames before the first motion and after the last are left out, but for a few. Short
    clips are decoded once and held, longer ones kept in a temporary file. Of still longer ones only
    a sample is held and the neighbours of the frames last asked for, so that memory stays flat in
    the length of the clip; each look elsewhere decodes again what it needs. Frames are counted on
    the camera's even clock from `first` on, those that are missing from the file among them.

    Parameters
    ----------
    clip : ClipReader
        The clip.
    sample : int
        How many frames, spread evenly over what moves, are always held.
    progress : callable, optional
        Called with the number of frames decoded so far.
    part : tuple of int, optional
        First frame, and the one after the last, of the part of the clip that is looked at; all of
        it without.
    lacks : sequence of (int, int)
        The clip's frames after which it lacks so many without a trace in its times.

    Attributes
    ----------
    parts : tuple of (int, int)
        First frame, and the one after the last, of each scene of the clip: one where it is not
        cut.
    first : int
        The clip's frame that is frame 0 here.
    started : int
        How many frames after the clip's first, missing ones included, that is.
    shown : (n,) int array
        Which frames of the action the file holds.
    count : int
        Number of frames of the action, missing ones included.
    whole_count : int
        Number of frames of the clip.
    clock : (count,) array
        Time told by what moves (`vision.clip.footage`), ticks.
    sample_index : (n,) int array
        Which frames are held as the sample.
    sample_frames : list of (H, W) arrays
        Those frames.
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
            raise NotFoundError("the clip holds no frame to look at")
        gathered.finish()
        self._held: Sequence[GrayFrame] | None = gathered.held
        self.whole_count = begin + len(times)
        marks = [begin, *(begin + first for first in gathered.cuts.first), self.whole_count]
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
        self.sample_frames = [gathered.sample[row] for row in rows]
        self.full_scale = 255.0 if self.sample_frames[0].dtype == np.uint8 else 65535.0
        if self._held is None:
            size = len(self.shown) * self.sample_frames[0].nbytes
            pictures = (picture for _, picture in self._decoded(0, len(self.shown)))
            self._held = _kept(pictures, size)

    def tinted(self, blueness: float, redness: float) -> "Footage":
        """The same frames in one colour instead of in gray.

        Parameters
        ----------
        blueness, redness : float
            Weights of the colour differences C_B and C_R of ITU-R BT.601.

        Returns
        -------
        Footage
            Whose gray levels are 128 where there is no colour; a shadow has none.
        """
        other = copy.copy(self)
        luma = np.array([0.114, 0.587, 0.299])
        blue = 0.5 * (np.array([1.0, 0.0, 0.0]) - luma) / (1.0 - luma[0])
        red = 0.5 * (np.array([0.0, 0.0, 1.0]) - luma) / (1.0 - luma[2])
        other._tint = np.array([[*(blueness * blue + redness * red), _NEUTRAL]])
        other._block, other._held, other.full_scale = {}, None, 255.0
        sample: dict[int, GrayFrame] = {}
        wanted = set(self._row[self.sample_index].tolist())

        def sampled() -> Iterator[GrayFrame]:
            for row, picture in other._decoded(0, len(self.shown)):
                if row in wanted:
                    sample[row] = picture
                yield picture

        pictures = sampled()
        if self._held is not None:
            height, width = self.shape
            other._held = _kept(pictures, len(self.shown) * height * width)
        deque(pictures, maxlen=0)  # where they are not kept, they are only looked at
        other.sample_frames = [sample[row] for row in self._row[self.sample_index].tolist()]
        return other

    def coloured(self, wanted: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """Give those of some frames that the file holds (H, W, 3), blue first, in time order."""
        rows = self._held_of(wanted)
        if len(rows) == 0:
            return
        chosen = set(rows.tolist())
        start, stop = self.first + int(rows[0]), self.first + int(rows[-1]) + 1
        for index, image in self._clip.colour_frames(start, stop):
            if index - self.first in chosen:
                yield int(self.shown[index - self.first]), image

    def missing(self, index: int) -> bool:
        """Whether a frame is missing from the file."""
        return bool(self._row[index] < 0)

    def in_clip(self, index: int) -> int:
        """The clip's own number of a frame, or of the last one before it that the file holds."""
        row = np.searchsorted(self.shown, index, side="right") - 1
        return self.first + int(np.clip(row, 0, len(self.shown) - 1))

    def of_clip(self, index: int) -> int:
        """Which frame one of the clip is, as they are counted here; beyond the ends, by itself."""
        row = index - self.first
        last = len(self.shown) - 1
        return int(self.shown[min(max(row, 0), last)]) + min(row, 0) + max(row - last, 0)

    def _held_of(self, wanted: NDArray[np.int64]) -> NDArray[np.int64]:
        """Rows of the pictures that the file holds of some frames."""
        rows = self._row[wanted]
        return rows[rows >= 0]

    def _decoded(self, start: int, stop: int) -> Iterator[tuple[int, GrayFrame]]:
        """Pictures of the action from `start` up to, not including, `stop`, decoded anew."""
        start, stop = self.first + start, self.first + stop
        if self._tint is None:
            for frame in self._clip.frames(start, stop):
                yield frame.index - self.first, frame.gray
            return
        for index, image in self._clip.colour_frames(start, stop):
            tinted = cv2.transform(image, self._tint)
            yield index - self.first, np.asarray(tinted, dtype=np.uint8)

    def moved_in(self, part: tuple[int, int]) -> float:
        """How much moved from a frame of the clip up to, not including, another one, ticks."""
        rows = np.array([part[0] - self.first, part[1] - 1 - self.first])
        ends = self.shown[np.clip(rows, 0, len(self.shown) - 1)]
        return float(self.clock[ends[1]] - self.clock[ends[0]])

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        height, width = self.sample_frames[0].shape
        return int(height), int(width)

    def frames(self, wanted: NDArray[np.int64]) -> Iterator[tuple[int, GrayFrame]]:
        """Give those of the wanted frames that the file holds, in time order.

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
        """So many frames, or all, spread evenly over what moves, some over the time between."""
        return self._spread(self.shown, count)

    def spread_sample(self, count: int) -> list[GrayFrame]:
        """So many frames of the sample, or all, spread alike, in time order."""
        return [
            self.sample_frames[int(place)]
            for place in np.searchsorted(self.sample_index, self.spread_index(count))
        ]

    def spread_index(self, count: int) -> NDArray[np.int64]:
        """Which frames `spread_sample` gives."""
        return self._spread(self.sample_index, count)

    def _spread(self, frames: NDArray[np.int64], count: int) -> NDArray[np.int64]:
        if len(frames) <= count:
            return frames
        ticks = self.clock[frames] - self.clock[frames[0]]
        along = ticks / max(float(ticks[-1]), 1e-6) + _IDLE_SHARE * frames / frames[-1]
        marks = np.linspace(along[0], along[-1], count)
        return np.asarray(np.unique(frames[np.searchsorted(along, marks)]))

    def _block_length(self) -> int:
        return max(8, _BLOCK_BYTES // self.sample_frames[0].nbytes)

    def _from_block(self, rows: NDArray[np.int64]) -> Iterator[tuple[int, GrayFrame]]:
        """A few neighbouring pictures, decoded together with those around them."""
        if not all(row in self._block for row in rows.tolist()):
            spare = self._block_length() - (int(rows[-1]) - int(rows[0]) + 1)
            first = max(0, int(rows[0]) - spare // 2)
            # The old block goes before the new one comes.
            self._block = {}
            self._block = dict(self._decoded(first, first + self._block_length()))
        for row in rows.tolist():
            yield row, self._block[row]


_OFF_BEAT = 0.1
"""Intervals that a frame may be off an even clock, supposed: times of one come free of rounding."""


def _beats(time_s: FloatArray) -> NDArray[np.int64]:
    """Which beat of the camera's even clock each frame is; their order where no clock fits them.

    A pause longer than all that was filmed tells no motion, and counts for no more than that.
    """
    order = np.arange(len(time_s))
    if len(time_s) < _FEWEST_BEATS:
        return order
    steps = np.diff(time_s)
    usual = float(np.median(steps))
    beats = (time_s - time_s[0]) / usual if usual > 0.0 else order.astype(np.float64)
    whole = np.rint(beats)
    if not np.all(np.diff(whole) >= 1.0) or np.abs(beats - whole).max() > _OFF_BEAT:
        return order
    return np.concatenate([[0], np.cumsum(np.minimum(np.diff(whole), len(whole)))]).astype(np.int64)


_FEWEST_BEATS = 3
"""Frames whose times tell whether a clock is even."""


def _check_size(height: int, width: int) -> None:
    if min(height, width) < _SMALLEST_SIDE:
        raise ClipError(
            f"pictures of {width} × {height} px are too small to follow anything in",
            hint=f"Each side needs at least {_SMALLEST_SIDE} px.",
        )
    refuse_giant(height, width)


_FEWEST_MOVES, _LONG_STILL = 4, 2
"""Frames in which something moved, that are too few for a law of motion and two more to show it;
and margins of still frames after which what they belong to is over."""


@dataclass(frozen=True, eq=False)
class _Action:
    """What is kept of an action that may not be the one.

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
    """What is kept of the frames while they are decoded, and of which ones."""

    def __init__(self, sample: int) -> None:
        self.held: list[GrayFrame] | None = []
        self.sample: dict[int, GrayFrame] = {}
        self.clock: list[float] = []
        self.first = 0
        self._wanted = sample
        self._motion = MotionClock()
        self.cuts = SceneCuts()
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
        """Take the next frame."""
        moved = self._motion.tick(gray)
        self.cuts.add(self._motion.cells)
        self._moves += moved
        self._told += 1
        if moved and not self._started:
            self._start()
        if self._started:
            self._store(self._motion.time, gray)
            since = len(self.clock) - 1 - self._last_motion
            few = self._aside is None and self._moves <= _FEWEST_MOVES
            if few and since > self._margin:
                self._wait(gray)
                if since > _LONG_STILL * self._margin:
                    self._set_aside()
        else:
            self._margin = max(3, min(_MARGIN, _MARGIN_BYTES // gray.nbytes))
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
        """Too few frames moved to show anything, and long ago: what action there is comes later.

        A codec settles over the first few frames, and a light flashes. That is so once: what stirs
        now and then for all of a clip is slow.
        """
        self.finish()
        self._aside = _Action(self.first, self.clock, self.sample, self.held, self._moves)
        self.first = self._told - len(self._before_motion)
        self.clock, self.sample, self.held = [], {}, []
        self._started, self._last_motion, self._moves = False, 0, 0
        self._size, self._stride = 0, 0.0

    def finish(self) -> None:
        """Leave out what follows the last motion, and of two actions the one of fewer frames."""
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
                # There was a long pause in the action: its frames are decoded when asked for.
                self.held = None
            else:
                self._size += gray.nbytes
                self.held.append(gray)
                if self._size > _HELD_BYTES:
                    self.held = None
        if not self._stride or self._bucket(index) > self._bucket(next(reversed(self.sample))):
            self.sample[index] = gray
            if len(self.sample) > self._most(gray):
                self._thin_out()

    def _most(self, gray: GrayFrame) -> int:
        return 2 * min(self._wanted, max(_FEWEST_SAMPLES, _SAMPLE_BYTES // gray.nbytes))

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
    """Who says how fast the camera ran; in the order in which they are believed."""

    OPTION = "option"
    SETUP = "setup"
    METADATA = "metadata"
    CONTAINER = "container"
    ASSUMED = "assumed"


ASSUMED_FPS = 600.0
"""fps, the paper's camera: a guess where nobody says the rate, and told as one."""

HIGH_SPEED_FPS = 119.0

"""From here up a container's rate is the camera's; 119.88 is the slowest nominal "120"."""

# A nominal rate may be the broadcast one, 1000/1001 of it (SMPTE ST 12): a rectangle of that width.
_NOMINAL_SPREAD = (1.0 / 1001.0) / math.sqrt(12.0)


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
        What the user must know about it.
    """

    fps: float
    std: float
    source: RateSource
    notice: str | None = None

    @property
    def known(self) -> bool:
        """Whether anything tells the rate: only then are there seconds."""
        return math.isfinite(self.std)


def nominal_rate_std(fps: float) -> float:
    """Standard uncertainty of a rate that is only known by its name, 1/s: 600 may be 599.4."""
    return fps * _NOMINAL_SPREAD


def choose_capture_rate(
    info: ClipInfo,
    option: float | None = None,
    setup: float | None = None,
    *,
    option_std: float | None = None,
    setup_std: float | None = None,
) -> CaptureRate:
    """Choose: option, else setup file, metadata, container rate if high; 600 is assumed at last.

    Parameters
    ----------
    info : ClipInfo
        Of the clip.
    option, setup : float, optional
        Rate from the command line and from the setup file, 1/s.
    option_std, setup_std : float, optional
        Their standard uncertainties, 1/s; if not given, nominal and broadcast rate are both held
        possible.

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
        f"CAPTURE RATE ASSUMED: {info.path.name} declares {said} and not the camera's rate; "
        f"{ASSUMED_FPS:g} fps is assumed. Times and speeds are given only where a free fall with a "
        "known scale tells the rate: give the true one with --fps RATE or capture_fps in the "
        "setup file.",
    )


def _given(fps: float, std: float | None, source: RateSource, info: ClipInfo) -> CaptureRate:
    if not (math.isfinite(fps) and fps > 0):
        raise UsageError(
            f"a capture rate of {fps:g} fps makes no sense", hint="Give it as --fps 600."
        )
    told = info.capture_fps_metadata
    notice = None
    if told is not None and abs(told / fps - 1.0) > 0.005:
        notice = (
            f"The file itself says {told:g} fps, the {source} {fps:g} fps; the {source} is used."
        )
    std = nominal_rate_std(fps) if std is None else std
    pictures = 0.5 * info.container_fps
    if info.interlaced and info.container_declares_rate and abs(fps / pictures - 1.0) < 0.005:
        # that is how many pictures the file holds, and each is two fields taken apart in time
        fps, std = 2.0 * fps, 2.0 * std
        notice = (
            f"The {source} gives the rate of the woven pictures, {0.5 * fps:g} fps; each is two "
            f"fields, so {fps:g} fields per second are measured."
        )
    return CaptureRate(fps, std, source, notice)


CLEAR = 8.0
"""Log-likelihood beyond that of the best of pure noise: odds of three thousand to one."""
FALSE_ALARM = 1e-3
"""Chance that noise is taken for a blinking light: one clip in a thousand."""


@dataclass(frozen=True)
class RateEstimate:
    """A capture rate and its standard uncertainty, frames per second."""

    fps: float
    std: float
    source: str


def rate_from_blinking(
    brightness: ArrayLike, blink_hz: float, *, blink_std_hz: float = 0.0, nominal_fps: float
) -> RateEstimate:
    """Capture rate from a light of known rate.

    Parameters
    ----------
    brightness : (N,) array
        Mean gray level of the place where the light is, frame by frame.
    blink_hz, blink_std_hz : float
        Rate of the light and its uncertainty, Hz.
    nominal_fps : float
        Rate thought to be right; only tells the blink from its aliases. The true rate must lie
        within a third of it.

    Returns
    -------
    RateEstimate

    Raises
    ------
    CalibrationError
        If nothing there blinks, or too fast for this camera.
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
            "the clip holds fewer than three blinks",
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
    if explained / (2.0 * noise) < CLEAR + np.log(independent / FALSE_ALARM) / 2.0:
        raise CalibrationError(
            f"nothing there blinks at {blink_hz:g} Hz",
            hint="Mark the light itself, and check its rate.",
        )
    amplitude2 = 2.0 * explained / count
    # Cramér–Rao bound of the frequency of a sine in white noise (Rife & Boorstyn 1974)
    std = np.sqrt(6.0 * noise / (np.pi**2 * amplitude2 * count * (count**2 - 1.0)))
    fps = blink_hz / best
    relative = np.hypot(std / best, blink_std_hz / blink_hz)
    return RateEstimate(fps, float(fps * relative), "blinking light")


def _sine_power(signal: FloatArray, time: FloatArray, frequency: float) -> float:
    """Sum of squares that the best sine of a frequency (per frame) takes away."""
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
    """Capture rate from free fall whose scale is known by other means.

    Parameters
    ----------
    heights_m, std_m : (N,) array
        Heights and their independent standard uncertainties, m.
    frames : (N,) array
        Frame numbers.
    acceleration : float
        Downward acceleration to expect, m/s².
    relative_scale_std : float
        Relative standard uncertainty of the scale of the heights.

    Returns
    -------
    RateEstimate

    Raises
    ------
    CalibrationError
        If the heights do not fall.
    """
    y, std = np.asarray(heights_m, dtype=np.float64), np.asarray(std_m, dtype=np.float64)
    n = np.asarray(frames, dtype=np.float64)
    n = n - n.mean()
    design = np.stack([np.ones_like(n), n, -0.5 * n**2], axis=1) / std[:, np.newaxis]
    inverse = np.linalg.inv(design.T @ design)
    per_frame2 = float((inverse @ design.T @ (y / std))[2])
    if per_frame2 <= 3.0 * np.sqrt(inverse[2, 2]):
        raise CalibrationError(
            "the heights do not fall freely", hint="Give a stretch of flight after the release."
        )
    fps = float(np.sqrt(acceleration / per_frame2))
    relative = 0.5 * np.hypot(np.sqrt(inverse[2, 2]) / per_frame2, relative_scale_std)
    return RateEstimate(fps, float(fps * relative), "free fall")
