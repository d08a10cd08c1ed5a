"""`Clip`: a recording as an iterable of frames and times."""

import os
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from metrology import measurands, read_number
from pipelines.api.asked import Given
from vision.clip.capture_rate import choose_capture_rate
from vision.clip.clip import Clip as Recording
from vision.clip.info import ClipInfo, GrayImage

__all__ = ["Clip", "TimedFrame"]


class TimedFrame(NamedTuple):
    """A gray frame, (H, W) uint8 or uint16, and its time on the camera's clock, s."""

    image: GrayImage
    time_s: float


class Clip:
    """A recording; iterate over it for frames and times, as often as you like.

    Frames are upright with square pixels; woven fields are separated. Nothing is held in memory.

    Parameters
    ----------
    path : path
        Video file or folder of pictures.
    fps : float or str, optional
        Capture rate; default what the file tells.

    Attributes
    ----------
    info : ClipInfo
        Size, frames, codec, rates as the file tells them.
    capture_fps : float
        1/s.

    Raises
    ------
    ClipError
        If nothing can be read.

    Examples
    --------
    >>> for image, time_s in iv.Clip("a.mp4", fps=600):  # doctest: +SKIP
    ...     print(time_s, image.mean())
    """

    def __init__(self, path: str | os.PathLike[str], *, fps: Given | None = None) -> None:
        self._recording = Recording.open(path)
        given = None if fps is None else read_number(fps, measurands.CAPTURE_RATE, "fps")
        self.capture_fps = choose_capture_rate(self._recording.info, given, None).fps

    @classmethod
    def open(cls, path: str | os.PathLike[str], *, fps: Given | None = None) -> "Clip":
        """As the constructor."""
        return cls(path, fps=fps)

    @property
    def info(self) -> ClipInfo:
        """What is known of the file."""
        return self._recording.info

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is odd about the file, with damage met so far."""
        return self._recording.warnings

    @property
    def times(self) -> NDArray[np.float64]:
        """Times (frames,) on the camera's clock, s."""
        return self._recording.capture_times(self.capture_fps)

    def __len__(self) -> int:
        return self.info.frames

    def __iter__(self) -> Iterator[TimedFrame]:
        times = self.times
        for frame in self._recording.frames():
            yield TimedFrame(frame.gray, float(times[frame.index]))

    def frame(self, index: int) -> TimedFrame:
        """One frame, counted from 0; all before it are decoded, since seeks are not exact."""
        if not 0 <= index < len(self):
            raise IndexError(f"the clip has frames 0 to {len(self) - 1}, no {index}")
        image = next(iter(self._recording.frames(index, index + 1))).gray
        return TimedFrame(image, float(self.times[index]))

    def __repr__(self) -> str:
        info = self.info
        return (
            f"Clip({str(info.path)!r}: {info.width} × {info.height} px, {info.frames} frames,"
            f" {self.capture_fps:g} fps)"
        )
