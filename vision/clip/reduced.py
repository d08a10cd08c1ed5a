"""Pictures of a large video at a fraction of their size, decoded once."""

import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from vision.clip.picture import bit_depth, has_luma_plane

__all__ = ["ReducedVideo"]

_MAX_KEPT_BYTES = 150_000_000
"""Bytes of reduced pictures kept in memory (chosen): a hundred of 1280 × 720 px."""


class _Video(Protocol):
    damaged: int

    @property
    def times_s(self) -> NDArray[np.float64]: ...

    def pictures(self) -> Iterator[Any]: ...


class ReducedVideo:
    """A video whose pictures are block means of the stored ones.

    Decoding a large picture takes longer than all work on the reduced one, and several stages read
    a clip from its beginning: the first pictures are kept, and each is decoded once if all fit.

    Parameters
    ----------
    video : VideoFile
    shrink : int
        Factor, which divides both sides of the pictures.
    """

    def __init__(self, video: _Video, shrink: int) -> None:
        self._video, self._shrink = video, shrink
        self._kept: list[Any] = []
        self._bytes = 0
        self._converter = VideoReformatter()
        self._reading = threading.Lock()
        self._rest: Iterator[Any] | None = None

    @property
    def damaged(self) -> int:
        """Number of pictures that could not be decoded in the last pass."""
        return self._video.damaged

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Time of every picture, s, 0 at the first."""
        return self._video.times_s

    def pictures(self) -> Iterator[Any]:
        """Yield the pictures in order."""
        place = 0
        while self._bytes <= _MAX_KEPT_BYTES:
            with self._reading:
                if place == len(self._kept) and not self._keep_next():
                    return
                picture = self._kept[place]
            yield picture
            place += 1
        self._rest = None
        yield from self._kept[place:]
        place = max(place, len(self._kept))
        for picture in self._video.pictures():
            if picture.index >= place:
                yield self._reduced(picture)

    def _keep_next(self) -> bool:
        """Decode one picture more; False at the end."""
        if self._rest is None:
            self._rest = self._video.pictures()
        picture = next(self._rest, None)
        if picture is None:
            return False
        small = self._reduced(picture)
        self._kept.append(small)
        self._bytes += sum(plane.buffer_size for plane in small.frame.planes)
        return True

    def _reduced(self, picture: Any) -> Any:
        frame, name = picture.frame, picture.frame.format.name
        if not has_luma_plane(name):
            name = "rgb48le" if bit_depth(frame) > 8 else "rgb24"
        small = self._converter.reformat(
            frame,
            width=frame.width // self._shrink,
            height=frame.height // self._shrink,
            format=name,
            interpolation="AREA",
        )
        # means of a mosaic are gray
        return replace(picture, frame=small, mosaic=None)
