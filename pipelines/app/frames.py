"""Frames of a clip as JPEG, decoded once and in order on a thread of their own."""

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Condition, Lock, Thread

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology import ImpactVisionError
from vision.clip.clip import ClipReader
from vision.clip.picture import ClipInfo

__all__ = ["FrameStore"]

MAX_SHOWN_WIDTH = 1920
"""Width above which frames are reduced for the page, px (chosen: a large screen)."""

MAX_FRAME_BYTES = 2_000_000_000
"""Size of the temporary file at which decoding stops, bytes (chosen: 20,000 frames of 100 kB)."""

MAX_NEAR_FRAMES = 50
"""Frames ahead of decoding up to which it is waited for (chosen: decoded in 0.2 s)."""

MAX_LAST_FRAME_S = 2.0
"""s that closing waits for the frame being decoded (chosen: one of 4K takes 0.1 s)."""

_QUALITY = [int(cv2.IMWRITE_JPEG_QUALITY), 88]


class FrameStore:
    """All frames of a clip in a temporary file; any of them is read in a millisecond.

    Parameters
    ----------
    path : Path
        The clip; it is opened on the thread, so that this returns at once.

    Attributes
    ----------
    info : ClipInfo or None
        None until the clip is opened.
    problem : str
        Why the clip can't be read; empty if it can.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.info: ClipInfo | None = None
        self.problem = ""
        self._file = tempfile.TemporaryFile(prefix="vision-frames-")  # noqa: SIM115
        self._places: list[tuple[int, int]] = []
        self._changed = Condition()
        self._ended = False
        self._clip: ClipReader | None = None
        self._ahead: Iterator[NDArray[np.uint8]] = iter(())
        self._next_ahead = -1
        self._seeking = Lock()
        self._thread = Thread(target=self._work, daemon=True)
        self._thread.start()

    @property
    def ready(self) -> int:
        """Number of frames decoded so far."""
        return len(self._places)

    @property
    def ended(self) -> bool:
        """Whether no further frame will come."""
        return self._ended

    def jpeg(self, index: int, wait_s: float = 0.0) -> bytes | None:
        """A frame; None if it is not there after `wait_s`, or does not exist."""
        if index > len(self._places) + MAX_NEAR_FRAMES and (sought := self._sought(index)):
            return sought
        until = time.monotonic() + wait_s
        with self._changed:
            while index >= len(self._places) and not self._ended:
                left = until - time.monotonic()
                if left <= 0.0 or not self._changed.wait(left):
                    break
            if not 0 <= index < len(self._places):
                return None
            start, size = self._places[index]
            self._file.seek(start)
            return self._file.read(size)

    def _sought(self, index: int) -> bytes | None:
        """A frame that is not decoded yet; None where it can't be found by its time stamp."""
        with self._seeking:
            if self._clip is None or self._ended:
                return None
            if index != self._next_ahead:
                self._ahead = self._clip.sought_frames(index)
            self._next_ahead = index + 1
            image = next(self._ahead, None)
            return None if image is None else _encoded(image)

    def wait_until_open(self, wait_s: float) -> bool:
        """Wait for the clip's properties, or for the reason why there are none."""
        with self._changed:
            return self._changed.wait_for(lambda: self.info is not None or self._ended, wait_s)

    def close(self) -> None:
        """Stop decoding and remove the file."""
        with self._changed:
            self._ended = True
            self._places.clear()
            self._file.close()
            self._changed.notify_all()
        self._thread.join(MAX_LAST_FRAME_S)

    def _work(self) -> None:
        try:
            # a clip of one frame is shown, though nothing can be measured in it
            clip = ClipReader.open(self.path, least_frames=1)
            self._clip = clip
            self._tell(clip.info)
            for image in self._shown(clip):
                if not self._add(image):
                    return
            self._tell(clip.info)
        except ImpactVisionError as problem:
            self.problem = problem.in_one_line
        except (OSError, MemoryError) as problem:
            self.problem = f"The frames can't be kept: {problem}. Free space on the disk."
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _tell(self, info: ClipInfo) -> None:
        with self._changed:
            self.info = info
            self._changed.notify_all()

    def _shown(self, clip: ClipReader) -> Iterator[bytes]:
        for _, image in clip.colour_frames():
            yield _encoded(image)

    def _add(self, content: bytes) -> bool:
        """Append a frame; false if no more are wanted."""
        with self._changed:
            if self._ended:
                return False
            start = self._file.seek(0, 2)
            if start + len(content) > MAX_FRAME_BYTES:
                self.problem = f"Only the first {len(self._places)} frames are shown."
                return False
            self._file.write(content)
            self._places.append((start, len(content)))
            self._changed.notify_all()
            return True


def _encoded(image: NDArray[np.uint8]) -> bytes:
    height, width = image.shape[:2]
    if width > MAX_SHOWN_WIDTH:
        size = (MAX_SHOWN_WIDTH, round(height * MAX_SHOWN_WIDTH / width))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    return bytes(cv2.imencode(".jpg", image, _QUALITY)[1])
