"""Clip properties; conversion of decoded pictures to upright images."""

import io
import math
import threading
import warnings
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from metrology import ClipError

__all__ = [
    "ClipInfo",
    "Frame",
    "GrayImage",
    "Upright",
    "Weave",
    "bit_depth",
    "colour_image",
    "decoded_image",
    "has_luma_plane",
    "luma_image",
    "refuse_giant",
    "shrink_of",
    "upright_of",
]

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
    """Properties of a clip from its headers and packets.

    Attributes
    ----------
    path : Path
        The clip.
    sha256 : str
        Of the file; for a folder of images, of their names and contents in order.
    width, height : int
        Size of the frames after turning and resampling to square pixels, px.
    frames : int
        Number of frames: counted from the packets when the clip is opened, and from the decoder
        once it has been read to its end.
    codec : str
        Name of the codec ("h264"), or the suffix of a folder's images.
    container_fps : float
        Usual frame rate on the container's clock, 1/s, doubled where fields are separated. For a
        folder of images 1 per second, so that times count frames.
    container_declares_rate : bool
        False for a folder of images.
    duration_s : float
        From the first frame to the last on the container's clock, s.
    rotation : int
        Degrees by which the stored pictures were turned counterclockwise to stand upright.
    weave : {"progressive", "top_first", "bottom_first"}
        Whether stored pictures are interlaced, and which field came first.
    bit_depth : int
        Bits per luma sample as stored.
    capture_fps_metadata : float or None
        Frame rate of the camera if the file states it, 1/s.
    variable_rate : bool
        Whether frame times do not fit an even clock, up to missing frames and the clock's ticks.
    warnings : tuple of str
        Warnings about the file, in whole sentences.
    times_shown : Fraction
        Frames of the file per picture; the frames are the pictures, each once.
    first_shown : Fraction
        Place of the first picture in the file, in frames; it is shown from the next frame on.
    every : int
        Only every n-th picture is read.
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
    times_shown: Fraction = Fraction(1)
    first_shown: Fraction = Fraction(0)
    every: int = 1
    bars: tuple[int, int, int, int] = (0, 0, 0, 0)

    @property
    def whole_size(self) -> tuple[int, int]:
        """Width and height of the frames with bars, px."""
        left, top, right, bottom = self.bars
        return self.width + left + right, self.height + top + bottom

    @property
    def frames_per_picture(self) -> float:
        """Frames of the file per frame that is read at full rate."""
        return float(self.times_shown) / (2.0 if self.interlaced else 1.0)

    def frames_in_file(self, frames: NDArray[np.int64]) -> NDArray[np.int64]:
        """Numbers in the file, from 0, of frames; of two fields that of their picture."""
        fields = 2 if self.interlaced else 1
        step = self.every * self.times_shown
        return np.array(
            [math.ceil(self.first_shown + int(n) // fields * step) for n in frames], np.int64
        )

    def frames_of_file(self, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        """Inverse of `frames_in_file`; -1 before the first frame."""
        fields = 2 if self.interlaced else 1
        step = self.every * self.times_shown
        return np.array(
            [max(-1, fields * math.floor((int(n) - self.first_shown) / step)) for n in numbers],
            np.int64,
        )

    @property
    def interlaced(self) -> bool:
        """Whether stored pictures are interlaced."""
        return self.weave != "progressive"


_FULL_RANGE = 2
"""FFmpeg's colour range of full-scale pictures (convention: AVCOL_RANGE_JPEG)."""

_MATRIX_UNITY = 65536
"""Fixed-point 1 of a container's display matrix (convention: 16.16 bits, ISO/IEC 14496-12)."""

_MAX_ZERO_FRACTION = 1e-3
"""Fraction of the largest entry of a display matrix below which another counts as zero (derived:
less shifts by under one pixel in a thousand)."""


@dataclass(frozen=True)
class Upright:
    """Transformation of stored pictures to upright ones with square pixels.

    Attributes
    ----------
    swap, mirror_x, mirror_y : bool
        Transpose first, then mirror.
    stretch : float
        Width over height of a stored pixel; pictures are resampled along their lines to
        square pixels.
    shrink : int
        Factor by which pictures are reduced (block means).
    """

    swap: bool = False
    mirror_x: bool = False
    mirror_y: bool = False
    stretch: float = 1.0
    shrink: int = 1

    @property
    def rotation(self) -> int:
        """Degrees counterclockwise by which the stored picture is turned."""
        if self.swap:
            return 90 if self.mirror_y else 270
        return 180 if self.mirror_x and self.mirror_y else 0

    def apply(self, image: NDArray[Any]) -> NDArray[Any]:
        """Turn one image (H, W) or (H, W, 3)."""
        if self.stretch != 1.0:
            image = _stretched(image, self.stretch)
        if self.shrink > 1:
            image = _shrunk(image, self.shrink)
        if self.swap:
            image = image.swapaxes(0, 1)
        if self.mirror_x:
            image = image[:, ::-1]
        if self.mirror_y:
            image = image[::-1]
        return np.ascontiguousarray(image)


def _stretched(image: NDArray[Any], stretch: float) -> NDArray[Any]:
    height, width = image.shape[:2]
    # Pixel centres are integers, so the left edge at -1/2 must stay fixed.
    matrix = np.array([[stretch, 0.0, 0.5 * (stretch - 1.0)], [0.0, 1.0, 0.0]])
    return cv2.warpAffine(
        image,
        matrix,
        (round(width * stretch), height),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )


def _shrunk(image: NDArray[Any], shrink: int) -> NDArray[Any]:
    height, width = image.shape[0] // shrink, image.shape[1] // shrink
    whole = image[: shrink * height, : shrink * width]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))


def shrink_of(height: int, width: int) -> tuple[int, str | None]:
    """Factor by which large pictures are reduced before measuring.

    Beyond some hundred pixels across, texture and lighting limit the accuracy of an outline, while
    the computing time grows with the number of pixels.

    Parameters
    ----------
    height, width : int
        px.

    Returns
    -------
    shrink : int
        As in `Upright`.
    warning : str or None
        Present if the factor is not 1.
    """
    if height * width <= _MAX_FULL_SIZE_PIXELS:
        return 1, None
    shrink = 2
    while (height // shrink) * (width // shrink) > _MAX_REDUCED_PIXELS:
        shrink += 1
    if height % shrink or width % shrink:
        # the next one may need no cropping
        shrink += not (height % (shrink + 1) or width % (shrink + 1))
    return shrink, (
        f"The pictures, {width} × {height} px, are measured at 1/{shrink} of their size. All "
        "pixel values, including points and scales you pass, refer to pictures of "
        f"{width // shrink} × {height // shrink} px."
    )


def upright_of(frame: Any, pixel_aspect: float) -> tuple[Upright, str | None]:
    """Read a decoded frame's display matrix.

    Parameters
    ----------
    frame : av.VideoFrame
        The first frame of the clip.
    pixel_aspect : float
        Width over height of a stored pixel.

    Returns
    -------
    upright : Upright
    warning : str or None
        Present if the matrix is not made of quarter turns and mirrors.
    """
    data = frame.side_data.get("DISPLAYMATRIX")
    if data is None:
        return Upright(stretch=pixel_aspect), None
    matrix = np.frombuffer(bytes(data), dtype=np.int32).reshape(3, 3)[:2, :2] / _MATRIX_UNITY
    # Enlargement is ignored: unequal enlargement is given by the pixel aspect.
    large = np.abs(matrix) > _MAX_ZERO_FRACTION * max(
        float(np.max(np.abs(matrix))), 1.0 / _MATRIX_UNITY
    )
    straight, crossed = (bool(np.all(large == which)) for which in (np.eye(2), 1 - np.eye(2)))
    (a, b), (c, d) = matrix.tolist()
    if not (straight or crossed):
        return Upright(stretch=pixel_aspect), (
            "The file asks for a rotation other than a quarter turn; the pictures are measured as "
            "stored. Angles to the horizontal are off by that rotation."
        )
    if straight:
        return Upright(False, a < 0, d < 0, pixel_aspect), None
    return Upright(True, c < 0, b < 0, pixel_aspect), None


def bit_depth(frame: Any) -> int:
    """Bits of a decoded frame's luma samples."""
    return int(max(component.bits for component in frame.format.components[:3]))


def luma_image(frame: Any) -> GrayImage:
    """Gray image of a decoded frame, from the luma plane where there is one.

    Returns
    -------
    (H, W) uint8 array, or uint16 scaled to 16 bit for deeper pictures. Limited range (16 to 235) is
    stretched to the full scale.
    """
    name = frame.format.name
    depth = bit_depth(frame)
    if not has_luma_plane(name):
        deep = depth > 8
        pixels = _converted(frame, "rgb48le" if deep else "rgb24")
        mixed: GrayImage = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), pixels.dtype)
        return mixed
    if depth <= 8:
        gray = _stored(frame, np.dtype(np.uint8))
        if _full_range(frame):
            return gray.copy()
        return np.asarray(cv2.LUT(gray, _limited_table(8)), np.uint8)
    order = ">u2" if name.endswith("be") else "<u2"
    shift = 16 - depth if name.startswith(("p0", "p2", "p4")) else 0
    levels = _stored(frame, np.dtype(order)) >> shift
    table = _full_table(depth) if _full_range(frame) else _limited_table(depth)
    transfer = int(getattr(frame, "color_trc", 0) or 0)
    if transfer in (_PQ, _HLG):
        table = _display_levels(transfer)[table]
    scaled: GrayImage = table[np.minimum(levels, len(table) - 1)]
    return scaled


def _stored(frame: Any, kind: np.dtype[Any]) -> NDArray[Any]:
    """Samples (H, W) of the first plane, top line first."""
    plane = frame.planes[0]
    if plane.line_size < 0:
        # Phantom's and Windows' files store the bottom line first.
        return np.asarray(frame.to_ndarray()[: frame.height, : frame.width])
    lines = np.frombuffer(plane, kind).reshape(-1, plane.line_size // kind.itemsize)
    return lines[: frame.height, : frame.width]


def colour_image(frame: Any) -> NDArray[np.uint8]:
    """Colour image (H, W, 3), blue first, of a decoded frame."""
    return np.asarray(_converted(frame, "bgr24"))


_THREAD_CONVERTERS = threading.local()


def _converted(frame: Any, pixels: str) -> Any:
    """Frame in another pixel format.

    One converter serves all frames of a thread: creating one takes forty times as long as using it.
    """
    if not hasattr(_THREAD_CONVERTERS, "one"):
        _THREAD_CONVERTERS.one = VideoReformatter()
    return _THREAD_CONVERTERS.one.reformat(frame, format=pixels).to_ndarray()


def has_luma_plane(name: str) -> bool:
    """Whether the first plane of a pixel format is luma."""
    return name.startswith(("yuv4", "yuvj4", "yuva4", "nv", "gray", "p01", "p21", "p41"))


def _full_range(frame: Any) -> bool:
    name = frame.format.name
    if name.startswith("yuvj"):
        return True
    declared = int(frame.color_range)
    return declared == _FULL_RANGE or (name.startswith("gray") and declared != 1)


_PQ, _HLG = 16, 18
"""FFmpeg's transfer characteristics of HDR pictures (convention: ITU-T H.273)."""

_PEAK_NITS, _GAMMA = 1000.0, 2.4
"""Luminance shown as white, cd/m² (convention: nominal peak of HLG, ITU-R BT.2100), and exponent of
the levels of other pictures (convention: ITU-R BT.1886)."""


@cache
def _display_levels(transfer: int) -> GrayImage:
    """Levels of 16 bit in the gamma of other pictures, by level of an HDR picture.

    The curves of HDR would move the outline of a bright ball: its edge is where the light is half.
    """
    signal = np.arange(65536) / 65535.0
    if transfer == _PQ:
        # SMPTE ST 2084
        powered = signal ** (32.0 / 2523.0)
        ratio = np.maximum(powered - 0.8359375, 0.0) / (18.8515625 - 18.6875 * powered)
        light = 1e4 / _PEAK_NITS * ratio ** (8192.0 / 1305.0)
    else:
        # ARIB STD-B67
        upper = (np.exp((signal - 0.55991073) / 0.17883277) + 0.28466892) / 12.0
        light = np.where(signal <= 0.5, signal**2 / 3.0, upper)
    shown = np.clip(light, 0.0, 1.0) ** (1.0 / _GAMMA)
    return np.round(65535.0 * shown).astype(np.uint16)


@cache
def _limited_table(depth: int) -> GrayImage:
    scale = 1 << (depth - 8)
    white = 255.0 if depth == 8 else 65535.0
    level = (np.arange(1 << depth) - 16 * scale) * white / (219 * scale)
    rounded = np.round(np.clip(level, 0, white))
    return rounded.astype(np.uint8) if depth == 8 else rounded.astype(np.uint16)


@cache
def _full_table(depth: int) -> GrayImage:
    top = (1 << depth) - 1
    return np.round(np.arange(1 << depth) * (65535.0 / top)).astype(np.uint16)


_MAX_SIDE_PX = 32_766
"""Longest side, px (convention: OpenCV's resampling counts pixels in 15 bits)."""
_MAX_PICTURE_PIXELS = 1 << 26
"""Most pixels of a picture (chosen): 8192 × 8192; the largest film sensors have 50 million."""
_MAX_FULL_SIZE_PIXELS = 2560 * 1600
"""Most pixels of a picture measured at full size (chosen). The outline of a ball a tenth as high as
such a picture has 500 px; its systematic error of 0.07 px is 1/2000 of the radius."""
_MAX_REDUCED_PIXELS = 1024 * 768
"""Most pixels of a larger picture after its reduction (chosen): lenses and codecs resolve half of
the pixels of a 4K recording, and following takes time in proportion to the pixels."""


def refuse_giant(height: int, width: int, name: object = "") -> None:
    """Refuse a picture that is too large to work with, from its header alone.

    Parameters
    ----------
    height, width : int
        px.
    name : object
        Name of the picture in the message.

    Raises
    ------
    ClipError
    """
    if max(height, width) > _MAX_SIDE_PX or height * width > _MAX_PICTURE_PIXELS:
        raise ClipError(
            f"{name}: pictures of {width} × {height} px are too large to measure".lstrip(": "),
            hint=f"Crop or reduce them to at most {_MAX_SIDE_PX} px a side and"
            f" {_MAX_PICTURE_PIXELS / 1e6:.0f} million pixels.",
        )


def decoded_image(data: bytes, flags: int, name: object) -> NDArray[Any] | None:
    """Decode an image file with OpenCV; None if it is not an image.

    Parameters
    ----------
    data : bytes
        The whole file.
    flags : int
        ``cv2.IMREAD_…``.
    name : object
        Name of the image in a message.

    Raises
    ------
    ClipError
        If it is too large; its header is read before anything is unpacked.
    """
    width, height = _size_in_header(data)
    refuse_giant(height, width, name)
    if not data:
        return None
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        return None


def _size_in_header(data: bytes) -> tuple[int, int]:
    """Width and height in an image's header, px; zeros if unreadable."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            # Pillow's own limit only warns; `refuse_giant` decides.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data)) as image:
                return image.size
    except Image.DecompressionBombError:
        return _MAX_PICTURE_PIXELS, _MAX_PICTURE_PIXELS
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError):
        return 0, 0
