"""A clip's gray frames, held in memory where they fit and decoded again where they don't."""

from collections import deque
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from metrology import ClipError, NotFoundError
from vision.clip.motion_clock import MotionClock

if TYPE_CHECKING:
    from vision.clip.clip import Clip

__all__ = ["Footage", "GrayFrame"]

GrayFrame = NDArray[np.uint8] | NDArray[np.uint16]

_HELD_BYTES = 120_000_000
# Of longer clips: the even sample, which doubles while it is gathered, and a block of neighbours.
_SAMPLE_BYTES = 50_000_000
_FEWEST_SAMPLES = 24
_BLOCK_BYTES = 60_000_000
# Still frames kept before the first motion and after the last: enough to know what lay still.
_MARGIN = 60
_MARGIN_BYTES = 40_000_000
# A ball of 5 px with as much around it; OpenCV's resampling counts pixels in 15 bits.
_SMALLEST_SIDE, _LARGEST_SIDE = 16, 32_766
# Weight of plain time beside the time told by motion, where frames are spread.
_IDLE_SHARE = 0.15


class Footage:
    """Gray frames of one clip's action for the several looks that tracking takes.

    Still frames before the first motion and after the last are left out, but for a few. Short
    clips are decoded once and held. Of longer ones only a sample is held and the neighbours of the
    frames last asked for, so that memory stays flat in the length of the clip; each look elsewhere
    decodes again what it needs. Frames are counted from `first`.

    Parameters
    ----------
    clip : Clip
        The clip.
    sample : int
        How many frames, spread evenly over what moves, are always held.
    progress : callable, optional
        Called with the number of frames decoded so far.

    Attributes
    ----------
    first : int
        The clip's frame that is frame 0 here.
    count : int
        Number of frames of the action.
    whole_count : int
        Number of frames of the clip.
    clock : (count,) array
        Time told by what moves (`vision.clip.motion_clock`), ticks.
    sample_index : (n,) int array
        Which frames are held as the sample.
    sample_frames : list of (H, W) arrays
        Those frames.
    full_scale : float
        Gray level of white: 255, or 65535 for clips of more than 8 bit.
    """

    def __init__(
        self, clip: "Clip", *, sample: int = 96, progress: Callable[[int], None] | None = None
    ) -> None:
        self._clip = clip
        self._block: dict[int, GrayFrame] = {}
        gathered = _Gathered(sample)
        count = 0
        for frame in clip.frames():
            _check_size(*frame.gray.shape)
            gathered.add(frame.gray)
            count += 1
            if progress is not None:
                progress(count)
        if count == 0:
            raise NotFoundError("the clip holds no frame to look at")
        gathered.finish()
        self._held = gathered.held
        self.whole_count = count
        self.first = gathered.first
        self.clock = np.array(gathered.clock)
        self.count = len(self.clock)
        self.sample_index = np.array(sorted(gathered.sample), dtype=np.int64)
        self.sample_frames = [gathered.sample[int(index)] for index in self.sample_index]
        self.full_scale = 255.0 if self.sample_frames[0].dtype == np.uint8 else 65535.0

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        height, width = self.sample_frames[0].shape
        return int(height), int(width)

    def frames(self, wanted: NDArray[np.int64]) -> Iterator[tuple[int, GrayFrame]]:
        """Give the wanted frames in time order.

        Parameters
        ----------
        wanted : (n,) int array
            Frame indices, increasing.

        Yields
        ------
        index : int
        gray : (H, W) array
        """
        if len(wanted) == 0:
            return
        if self._held is not None:
            for index in wanted:
                yield int(index), self._held[int(index)]
            return
        if int(wanted[-1]) - int(wanted[0]) < self._block_length():
            yield from self._from_block(wanted)
            return
        chosen = set(wanted.tolist())
        start, stop = self.first + int(wanted[0]), self.first + int(wanted[-1]) + 1
        for frame in self._clip.frames(start, stop):
            if frame.index - self.first in chosen:
                yield frame.index - self.first, frame.gray

    def spread(self, count: int) -> NDArray[np.int64]:
        """So many frames, or all, spread evenly over what moves, some over the time between."""
        return self._spread(np.arange(self.count), count)

    def spread_sample(self, count: int) -> list[GrayFrame]:
        """So many frames of the sample, or all, spread alike, in time order."""
        return [
            self.sample_frames[int(place)]
            for place in np.searchsorted(self.sample_index, self._spread(self.sample_index, count))
        ]

    def _spread(self, frames: NDArray[np.int64], count: int) -> NDArray[np.int64]:
        if len(frames) <= count:
            return frames
        ticks = self.clock[frames] - self.clock[frames[0]]
        along = ticks / max(float(ticks[-1]), 1e-6) + _IDLE_SHARE * frames / frames[-1]
        marks = np.linspace(along[0], along[-1], count)
        return np.asarray(np.unique(frames[np.searchsorted(along, marks)]))

    def _block_length(self) -> int:
        return max(8, _BLOCK_BYTES // self.sample_frames[0].nbytes)

    def _from_block(self, wanted: NDArray[np.int64]) -> Iterator[tuple[int, GrayFrame]]:
        """A few neighbouring frames, decoded together with those around them."""
        if not all(int(index) in self._block for index in wanted):
            spare = self._block_length() - (int(wanted[-1]) - int(wanted[0]) + 1)
            first = max(0, int(wanted[0]) - spare // 2)
            # The old block goes before the new one comes.
            self._block = {}
            start = self.first + first
            for frame in self._clip.frames(start, start + self._block_length()):
                self._block[frame.index - self.first] = frame.gray
        for index in wanted:
            yield int(index), self._block[int(index)]


def _check_size(height: int, width: int) -> None:
    if min(height, width) < _SMALLEST_SIDE:
        raise ClipError(
            f"pictures of {width} × {height} px are too small to follow anything in",
            hint=f"Each side needs at least {_SMALLEST_SIDE} px.",
        )
    if max(height, width) > _LARGEST_SIDE:
        raise ClipError(
            f"pictures of {width} × {height} px are too large to resample",
            hint=f"Crop or shrink them to at most {_LARGEST_SIDE} px a side.",
        )


class _Gathered:
    """What is kept of the frames while they are decoded, and of which ones."""

    def __init__(self, sample: int) -> None:
        self.held: list[GrayFrame] | None = []
        self.sample: dict[int, GrayFrame] = {}
        self.clock: list[float] = []
        self.first = 0
        self._wanted = sample
        self._motion = MotionClock()
        self._lead: deque[tuple[float, GrayFrame]] = deque()
        self._started = False
        self._last_motion = 0
        self._size = 0
        self._stride = 0.0
        self._margin = 0

    def add(self, gray: GrayFrame) -> None:
        """Take the next frame."""
        moved = self._motion.tick(gray)
        if self._started:
            self._store(self._motion.time, gray)
        elif moved:
            self._start()
            self._store(self._motion.time, gray)
        else:
            self._margin = max(3, min(_MARGIN, _MARGIN_BYTES // gray.nbytes))
            self._lead.append((self._motion.time, gray))
            if len(self._lead) > self._margin:
                self._lead.popleft()
                self.first += 1
        if moved:
            self._last_motion = len(self.clock) - 1

    def _start(self) -> None:
        self._started = True
        for time, gray in self._lead:
            self._store(time, gray)
        self._lead.clear()

    def finish(self) -> None:
        """Leave out what follows the last motion."""
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
