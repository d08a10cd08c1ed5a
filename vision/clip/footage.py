"""A clip's gray frames, held in memory where they fit and decoded again where they don't."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from metrology import NotFoundError

if TYPE_CHECKING:
    from vision.clip.clip import Clip

__all__ = ["Footage", "GrayFrame"]

GrayFrame = NDArray[np.uint8] | NDArray[np.uint16]

_HELD_BYTES = 120_000_000
# Of longer clips: the even sample, which doubles while it is gathered, and a block of neighbours.
_SAMPLE_BYTES = 50_000_000
_FEWEST_SAMPLES = 24
_BLOCK_BYTES = 60_000_000


class Footage:
    """Gray frames of one clip for the several looks that tracking takes.

    Short clips are decoded once and held. Of longer ones only an even sample is held and the
    neighbours of the frames last asked for, so that memory stays flat in the length of the clip;
    each look elsewhere decodes again what it needs.

    Parameters
    ----------
    clip : Clip
        The clip.
    sample : int
        How many frames, evenly spread, are always held.
    progress : callable, optional
        Called with the number of frames decoded so far.

    Attributes
    ----------
    count : int
        Number of frames in the clip.
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
        self._held: list[GrayFrame] | None = []
        self._block: dict[int, GrayFrame] = {}
        held: dict[int, GrayFrame] = {}
        stride = 1
        count = 0
        size = 0
        for frame in clip.frames():
            gray = frame.gray
            if self._held is not None:
                size += gray.nbytes
                self._held.append(gray)
                if size > _HELD_BYTES:
                    self._held = None
            if count % stride == 0:
                held[count] = gray
                if len(held) > 2 * min(sample, max(_FEWEST_SAMPLES, _SAMPLE_BYTES // gray.nbytes)):
                    stride *= 2
                    held = {index: kept for index, kept in held.items() if index % stride == 0}
            count += 1
            if progress is not None:
                progress(count)
        if count == 0:
            raise NotFoundError("the clip holds no frame to look at")
        self.count = count
        self.sample_index = np.array(sorted(held), dtype=np.int64)
        self.sample_frames = [held[int(index)] for index in self.sample_index]
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
        for frame in self._clip.frames(int(wanted[0]), int(wanted[-1]) + 1):
            if frame.index in chosen:
                yield frame.index, frame.gray

    def _block_length(self) -> int:
        return max(8, _BLOCK_BYTES // self.sample_frames[0].nbytes)

    def _from_block(self, wanted: NDArray[np.int64]) -> Iterator[tuple[int, GrayFrame]]:
        """A few neighbouring frames, decoded together with those around them."""
        if not all(int(index) in self._block for index in wanted):
            spare = self._block_length() - (int(wanted[-1]) - int(wanted[0]) + 1)
            first = max(0, int(wanted[0]) - spare // 2)
            # The old block goes before the new one comes.
            self._block = {}
            for frame in self._clip.frames(first, first + self._block_length()):
                self._block[frame.index] = frame.gray
        for index in wanted:
            yield int(index), self._block[int(index)]
