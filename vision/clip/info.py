"""What is known of a clip before anything in it is looked at, and one frame of it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["ClipInfo", "Frame", "GrayImage", "Weave"]

GrayImage = NDArray[np.uint8] | NDArray[np.uint16]
Weave = Literal["progressive", "top_first", "bottom_first"]


@dataclass(frozen=True)
class Frame:
    """One frame, upright, square pixels, gray.

    Attributes
    ----------
    index : int
        From 0 in the order of presentation.
    time_s : float
        Time on the container's clock, s, 0 at the first frame.
    gray : (H, W) uint8 or uint16 array
        Luma on the full scale: 0 is black and 255 white; of clips with more than 8 bit, 65535 is
        white.
    """

    index: int
    time_s: float
    gray: GrayImage


@dataclass(frozen=True)
class ClipInfo:
    """What the file says, and what a look at its packets adds.

    Attributes
    ----------
    path : Path
        The clip.
    sha256 : str
        Of the file; of a folder of images: of their names and contents in order.
    width, height : int
        Size of the frames as handed on (turned upright, square pixels), px.
    frames : int
        Number of frames: counted over the packets when the clip is opened, and the number that came
        out of the decoder once it has been read to its end.
    codec : str
        Name of the codec ("h264"), or the suffix of a folder's images.
    container_fps : float
        Usual frame rate on the container's clock, 1/s, doubled where fields are separated. A folder
        of images has no clock: 1 per second there, so that times count frames.
    container_declares_rate : bool
        False for a folder of images.
    duration_s : float
        From the first frame to the last on the container's clock, s.
    rotation : int
        Degrees by which the stored pictures were turned counterclockwise to stand upright.
    weave : {"progressive", "top_first", "bottom_first"}
        Whether stored pictures are two woven fields, and which came first.
    bit_depth : int
        Bits per luma sample as stored.
    capture_fps_metadata : float or None
        Frame rate of the camera if the file tells it, 1/s.
    variable_rate : bool
        Whether frame times do not fit an even clock, up to missing frames and the clock's ticks.
    warnings : tuple of str
        What is odd about the file, in whole sentences.
    """

    path: Path
    sha256: str
    width: int
    height: int
    frames: int
    codec: str
    container_fps: float
    container_declares_rate: bool
    duration_s: float
    rotation: int
    weave: Weave
    bit_depth: int
    capture_fps_metadata: float | None
    variable_rate: bool
    warnings: tuple[str, ...] = ()

    @property
    def interlaced(self) -> bool:
        """Whether stored pictures are two woven fields."""
        return self.weave != "progressive"

    def capture_time(self, time_s: float, capture_fps: float) -> float:
        """Turn a time on the container's clock into one on the camera's, s.

        Parameters
        ----------
        time_s : float
            As in `Frame.time_s`.
        capture_fps : float
            Frames (fields, where they are separated) per second of the camera.
        """
        return time_s * self.container_fps / capture_fps
