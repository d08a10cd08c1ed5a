"""A clip: a video file or a folder of images, read from first to last frame with true times.

Times come from presentation stamps only; frames are upright and have square pixels; woven fields
are separated. Nothing is held: memory does not grow with the length of the clip.
"""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from metrology import ClipError
from vision.clip.fields import separate_field
from vision.clip.image_folder import ImageFolder
from vision.clip.info import ClipInfo, Frame, GrayImage
from vision.clip.opening import Fields, open_video
from vision.clip.picture import Upright
from vision.clip.video_file import VideoFile

__all__ = ["Clip", "ClipInfo", "Fields", "Frame"]


FloatArray = NDArray[np.float64]


class _Picture(Protocol):
    @property
    def index(self) -> int: ...

    @property
    def time_s(self) -> float: ...

    def gray(self) -> GrayImage: ...

    def colour(self) -> NDArray[np.uint8]: ...


class Clip:
    """A readable clip; make one with `Clip.open`.

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
        cls, path: str | os.PathLike[str], *, fields: Fields = "auto", least_frames: int = 2
    ) -> "Clip":
        """Open a video file or a folder of images.

        Parameters
        ----------
        path : path
            The file or folder.
        fields : {"auto", "progressive", "top_first", "bottom_first"}
            Whether pictures are two woven fields; "auto" asks the file and then looks for combing.
        least_frames : int
            Fewer frames than this are refused.

        Returns
        -------
        Clip

        Raises
        ------
        ClipError
            If nothing can be read, or too few frames.
        """
        place = Path(path)
        if not place.exists():
            raise ClipError(f"there is no file {place}", hint="Check the name and the folder.")
        if place.is_dir():
            folder = ImageFolder(place)
            clip = cls(folder, folder.info, Upright())
        else:
            if place.stat().st_size == 0:
                raise ClipError(
                    f"{place} is empty",
                    hint="Copy it from the camera once more; it has 0 bytes here.",
                )
            clip = cls(*open_video(place, fields))
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
