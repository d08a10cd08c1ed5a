"""A clip's gray frames, held in memory where they fit and decoded again where they don't."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from metrology import NotFoundError

if TYPE_CHECKING:
    from vision.clip import Clip

__all__ = ["Footage", "GrayFrame"]

GrayFrame = NDArray[np.uint8] | NDArray[np.uint16]

_HELD_BYTES = 160_000_000


class Footage:
    """Gray frames of one clip for the several looks that tracking takes.

    Short clips are decoded once and held. Of longer ones only an even sample is held, so that
    memory stays flat in the length of the clip, and each look decodes again what it needs.

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
                if len(held) > 2 * sample:
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
        chosen = set(wanted.tolist())
        for frame in self._clip.frames(int(wanted[0]), int(wanted[-1]) + 1):
            if frame.index in chosen:
                yield frame.index, frame.gray
