"""Draw tracks, contact, landing and numbers on a clip and write the overlay video.

Text is drawn with DejaVu Sans, since OpenCV's fonts lack the signs ± ° ².
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import av
import cv2
import numpy as np
from av.error import FFmpegError
from numpy.typing import NDArray

from metrology import UsageError, written_whole
from vision.clip.clip import ClipReader
from vision.tracks import MotionKind, PendulumTrack, Track, Tracks

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont

__all__ = [
    "OVERLAY_SUFFIXES",
    "OverlayMarks",
    "overlay_still",
    "png_bytes",
    "write_overlay",
]

OVERLAY_SUFFIXES = (".mp4", ".mov", ".mkv")
"""File suffixes of overlay videos."""


Colour = tuple[int, int, int]


@cache
def _font(size: int) -> "FreeTypeFont":
    import matplotlib
    from PIL import ImageFont

    # DejaVu Sans comes with matplotlib, so that text looks the same on every machine.
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(str(path), size)


def line_height(size: int) -> int:
    """Distance between lines of text, px."""
    return round(1.45 * size)


def text_width(text: str, size: int) -> int:
    """Width of a line of text, px."""
    return int(np.ceil(_font(size).getlength(text)))


def write_text(
    image: NDArray[np.uint8], text: str, corner: tuple[int, int], size: int, colour: Colour
) -> None:
    """Write a line into an image (H, W, 3) in place, blue first; `corner` is its upper left, px."""
    width, height = text_width(text, size) + 2, line_height(size)
    left, top = max(0, corner[0]), max(0, corner[1])
    patch = image[top : top + height, left : left + width]
    if not text or patch.size == 0:
        return
    from PIL import Image, ImageDraw

    mask = Image.new("L", (patch.shape[1], patch.shape[0]))
    ImageDraw.Draw(mask).text((0, 0), text, font=_font(size), fill=255)
    cover = np.asarray(mask, np.float32)[:, :, None] / 255.0
    patch[:] = np.round(patch * (1.0 - cover) + np.array(colour, np.float32) * cover).astype(
        np.uint8
    )


@dataclass(frozen=True)
class OverlayMarks:
    """Marks on the picture; all optional.

    Attributes
    ----------
    contact : (2,) tuple of int or None
        First and last frame in contact, both included.
    grid_px : (N, 2) array or None
        Wall grid points, px.
    landing_px : (2,) array or None
        Position of the ball's centre at landing, px.
    landing_label : str
        Label of the landing point.
    captions : tuple of str
        Results in lines, written below the picture.
    capture_fps : float or None
        Frames per second of the camera, for the displayed time; not shown if None.
    """

    contact: tuple[int, int] | None = None
    grid_px: NDArray[np.float64] | None = None
    landing_px: NDArray[np.float64] | None = None
    landing_label: str = "landing"
    captions: tuple[str, ...] = ()
    capture_fps: float | None = None


ColourImage = NDArray[np.uint8]

FloatArray = NDArray[np.float64]

_BALL_COLOUR: Colour = (0, 159, 230)
"""Blue, green, red of 255 (convention: palette of Okabe and Ito 2008, distinguishable with any
colour vision)."""

_STRIKER_COLOUR: Colour = (233, 180, 86)
"""Blue, green, red of 255, from the same palette."""

_GRID_COLOUR: Colour = (115, 158, 0)
"""Blue, green, red of 255, from the same palette."""

_LANDING_COLOUR: Colour = (167, 121, 204)
"""Blue, green, red of 255, from the same palette."""

_CONTACT_COLOUR: Colour = (0, 94, 213)
"""Blue, green, red of 255, from the same palette."""

_STRIP_COLOUR: Colour = (32, 28, 26)
"""Blue, green, red of 255, nearly black: background of text."""

_TEXT_COLOUR: Colour = (240, 240, 240)
"""Blue, green, red of 255: text."""

_DIM_TEXT: Colour = (170, 170, 170)
"""Blue, green, red of 255: less important text."""

_MIN_OVERLAY_WIDTH = 1000
"""Width to which narrower pictures are enlarged, px (chosen), so that sub-pixel marks show."""

_MAX_ENLARGEMENT = 6
"""Maximum enlargement (chosen): beyond, pixels dominate the picture."""

_DRAWING_BITS = 4
"""Fractional bits of OpenCV's drawing coordinates (chosen: a sixteenth of a pixel)."""

_MAX_DRAWN_GAP = 3
"""Longest gap through which a track is drawn, frames (chosen)."""


class OverlayPainter:
    """Draw on the frames of one clip.

    Parameters
    ----------
    width, height : int
        Size of the clip's frames, px.
    """

    def __init__(self, width: int, height: int, tracks: Tracks, marks: OverlayMarks) -> None:
        self._tracks, self._marks = tracks, marks
        self.scale = int(np.clip(round(_MIN_OVERLAY_WIDTH / width), 1, _MAX_ENLARGEMENT))
        self._picture = (width * self.scale, height * self.scale)
        self._size = int(np.clip(self._picture[0] / 56, 13, 30))
        self._thick = max(1, round(self._picture[0] / 640))
        self._strip = self._make_strip()
        self._shift = np.zeros(2)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the result, px; both even, as video codecs require."""
        return self._picture[1] + self._picture[1] % 2 + self._strip.shape[0], (
            self._picture[0] + self._picture[0] % 2
        )

    def paint(self, index: int, picture: ColourImage) -> ColourImage:
        """Draw on one frame.

        Parameters
        ----------
        index : int
            Frame index.
        picture : (H, W, 3) uint8 array
            The frame, blue first.

        Returns
        -------
        (H', W', 3) uint8 array
        """
        canvas = np.zeros((*self.shape, 3), np.uint8)
        view = canvas[: self._picture[1], : self._picture[0]]
        view[:] = cv2.resize(picture, self._picture, interpolation=cv2.INTER_CUBIC)
        if self._tracks.shift_px is not None:
            self._shift = self._tracks.shift_px[index]
        self._draw_grid(view)
        if self._tracks.pendulum is not None:
            self._draw_pendulum(view, index, self._tracks.pendulum)
        if self._tracks.motion.kind is MotionKind.COLLISION and self._tracks.others:
            self._draw_ball(view, index, self._tracks.others[0].track, _STRIKER_COLOUR)
        self._draw_ball(view, index, self._tracks.ball, _BALL_COLOUR)
        self._draw_landing(view)
        self._draw_contact(view, index)
        canvas[-self._strip.shape[0] :] = self._strip
        self._write_running_numbers(canvas[-self._strip.shape[0] :], index)
        return canvas

    def _make_strip(self) -> ColourImage:
        """The text strip without its running numbers: captions in as many columns as fit."""
        size, step = self._size, line_height(self._size)
        captions = self._marks.captions
        widest = max((text_width(text, size) for text in captions), default=1) + 2 * size
        room = self._picture[0] - 2 * size
        columns = int(np.clip(room // widest, 1, 3))
        rows = -(-len(captions) // columns)
        height = step * (rows + 1) + size
        strip = np.empty(
            (height + height % 2, self._picture[0] + self._picture[0] % 2, 3), np.uint8
        )
        strip[:] = _STRIP_COLOUR
        for number, text in enumerate(captions):
            column, row = divmod(number, max(rows, 1))
            corner = (size + column * (room // columns), size // 2 + step * (row + 1))
            write_text(strip, text, corner, size, _TEXT_COLOUR)
        return strip

    def _write_running_numbers(self, strip: ColourImage, index: int) -> None:
        rate = self._marks.capture_fps
        parts = [f"frame {index}"]
        if rate is not None:
            parts.append(f"t = {1000.0 * index / rate:.1f} ms")
        row = _row(self._tracks.ball, index)
        if row is not None:
            ball = self._tracks.ball
            x, y = ball.centre_px[row]
            size = f", radius {ball.radius_px[row]:.2f} px" if ball.sized else ""
            parts.append(f"ball ({x:.2f}, {y:.2f}) px{size}")
        if self._tracks.pendulum is not None:
            row = _row(self._tracks.pendulum.track, index)
            if row is not None:
                angle = np.degrees(self._tracks.pendulum.angle_rad[row])
                parts.append(f"pendulum {angle:+.2f}°")
        write_text(strip, "   ".join(parts), (self._size, self._size // 2), self._size, _DIM_TEXT)

    def _place(self, points: FloatArray) -> NDArray[np.int32]:
        """Scene to canvas pixels in fixed point; pixel centres are at integers in both."""
        shifted = np.asarray(points, np.float64) + self._shift
        enlarged = (shifted + 0.5) * self.scale - 0.5
        return np.round(enlarged * (1 << _DRAWING_BITS)).astype(np.int32)

    def _circle(
        self, view: ColourImage, centre: FloatArray, radius: float, colour: Colour, thick: int
    ) -> None:
        x, y = self._place(centre).tolist()
        size = max(1, round(radius * self.scale * (1 << _DRAWING_BITS)))
        cv2.circle(view, (x, y), size, colour, thick, cv2.LINE_AA, _DRAWING_BITS)

    def _draw_trail(self, view: ColourImage, track: Track, index: int, colour: Colour) -> None:
        past = track.frame <= index
        centres, frames = track.centre_px[past], track.frame[past]
        if len(frames) == 0:
            return
        for run in np.split(centres, np.flatnonzero(np.diff(frames) > _MAX_DRAWN_GAP) + 1):
            points = self._place(run).reshape(-1, 1, 2)
            cv2.polylines(view, [points], False, colour, self._thick, cv2.LINE_AA, _DRAWING_BITS)

    def _draw_ball(self, view: ColourImage, index: int, ball: Track, colour: Colour) -> None:
        self._draw_trail(view, ball, index, colour)
        row = _row(ball, index)
        if row is None:
            return
        if ball.sized:
            self._circle(view, ball.centre_px[row], float(ball.radius_px[row]), colour, self._thick)
        self._circle(view, ball.centre_px[row], 1.5 * self._thick / self.scale, colour, -1)

    def _draw_pendulum(self, view: ColourImage, index: int, pendulum: PendulumTrack) -> None:
        self._draw_trail(view, pendulum.track, index, _STRIKER_COLOUR)
        row = _row(pendulum.track, index)
        if row is None:
            return
        mass = pendulum.track.centre_px[row]
        ends = self._place(np.array([pendulum.pivot_px, mass]))
        # The pivot is often above the picture: OpenCV clips the line, and the dot is not visible.
        cv2.line(
            view, ends[0].tolist(), ends[1].tolist(), _STRIKER_COLOUR, self._thick, cv2.LINE_AA,
            _DRAWING_BITS
        )  # fmt: skip
        for point in (pendulum.pivot_px, mass):
            self._circle(view, point, 2.5 * self._thick / self.scale, _STRIKER_COLOUR, -1)

    def _draw_grid(self, view: ColourImage) -> None:
        if self._marks.grid_px is None:
            return
        arm = round(2.5 * self._thick) << _DRAWING_BITS
        for x, y in self._place(self._marks.grid_px).tolist():
            cv2.line(view, (x - arm, y), (x + arm, y), _GRID_COLOUR, 1, cv2.LINE_AA, _DRAWING_BITS)
            cv2.line(view, (x, y - arm), (x, y + arm), _GRID_COLOUR, 1, cv2.LINE_AA, _DRAWING_BITS)

    def _draw_landing(self, view: ColourImage) -> None:
        if self._marks.landing_px is None:
            return
        centre = self._place(self._marks.landing_px)
        arm = round(0.7 * self._size) << _DRAWING_BITS
        for across in (np.array([arm, arm]), np.array([arm, -arm])):
            ends = (centre - across).tolist(), (centre + across).tolist()
            cv2.line(view, *ends, _LANDING_COLOUR, self._thick + 1, cv2.LINE_AA, _DRAWING_BITS)
        x, y = (centre >> _DRAWING_BITS).tolist()
        label = self._marks.landing_label
        left = min(x + self._size, view.shape[1] - text_width(label, self._size) - 4)
        corner = (left, y - 2 * self._size)
        write_text(view, label, (corner[0] + 1, corner[1] + 1), self._size, _STRIP_COLOUR)
        write_text(view, label, corner, self._size, _LANDING_COLOUR)

    def _draw_contact(self, view: ColourImage, index: int) -> None:
        contact = self._marks.contact
        if contact is None or not contact[0] <= index <= contact[1]:
            return
        border = 2 * self._thick + 1
        corner = (view.shape[1] - 1 - border // 2, view.shape[0] - 1 - border // 2)
        cv2.rectangle(view, (border // 2, border // 2), corner, _CONTACT_COLOUR, border)
        label = f"contact {index - contact[0] + 1}/{contact[1] - contact[0] + 1}"
        size = round(1.3 * self._size)
        width, height = text_width(label, size) + size, line_height(size) + size // 3
        view[border : border + height, border : border + width] = _CONTACT_COLOUR
        write_text(view, label, (border + size // 2, border + size // 6), size, (255, 255, 255))


def _row(track: Track, index: int) -> int | None:
    place = int(np.searchsorted(track.frame, index))
    return place if place < len(track) and track.frame[place] == index else None


_OVERLAY_FPS = 30
"""Frame rate of an overlay, fps (chosen: any screen can play it)."""


def write_overlay(
    path: Path,
    clip: ClipReader,
    tracks: Tracks,
    marks: OverlayMarks | None = None,
    *,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Write the overlay video (H.264, 30 frames per second).

    Parameters
    ----------
    path : Path
        A .mp4, .mov or .mkv file.
    clip : ClipReader
        The measured clip.
    tracks : Tracks
        Its tracks.
    marks : OverlayMarks, optional
        Contact, grid, landing and captions.
    progress : callable, optional
        Called with the number of frames written so far.

    Raises
    ------
    UsageError
        If the suffix is unknown or the folder can't be written to.
    ClipError
        If the clip can't be read any more.
    """
    if path.suffix.lower() not in OVERLAY_SUFFIXES:
        raise UsageError(
            f"an overlay can't be written as {path.suffix or path.name}",
            hint=f"Choose a file name that ends in {', '.join(OVERLAY_SUFFIXES)}.",
        )
    painter = OverlayPainter(clip.info.width, clip.info.height, tracks, marks or OverlayMarks())
    with written_whole(path) as temporary:
        try:
            _encode(temporary, clip, painter, progress)
        except FFmpegError as problem:
            raise UsageError(
                f"the overlay {path} can't be written: {problem.strerror}",
                hint="Check that the disk has free space.",
            ) from problem


def _encode(
    path: Path, clip: ClipReader, painter: OverlayPainter, progress: Callable[[int], None] | None
) -> None:
    height, width = painter.shape
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=_OVERLAY_FPS)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.options = {"crf": "20", "preset": "superfast"}
        for count, (index, picture) in enumerate(clip.colour_frames()):
            frame = av.VideoFrame.from_ndarray(painter.paint(index, picture), format="bgr24")
            frame.pts, frame.time_base = count, Fraction(1, _OVERLAY_FPS)
            container.mux(stream.encode(frame))
            if progress is not None:
                progress(count + 1)
        container.mux(stream.encode())


def overlay_still(
    clip: ClipReader, tracks: Tracks, marks: OverlayMarks | None = None, *, frame: int | None = None
) -> NDArray[np.uint8]:
    """Draw one frame of the overlay as an image (H, W, 3), blue first.

    Parameters
    ----------
    frame : int, optional
        Frame number; by default the last one with the ball in view, which shows its whole path.

    Raises
    ------
    UsageError
        If the clip has no such frame.
    """
    if frame is None:
        frame = _last_in_view(clip, tracks)
    painter = OverlayPainter(clip.info.width, clip.info.height, tracks, marks or OverlayMarks())
    for index, picture in clip.colour_frames(frame, frame + 1):
        return painter.paint(index, picture)
    raise UsageError(f"{clip.info.path} has no frame {frame}")


def _last_in_view(clip: ClipReader, tracks: Tracks) -> int:
    x, y = tracks.ball.centre_px.T
    inside = (x > 0) & (x < clip.info.width - 1) & (y > 0) & (y < clip.info.height - 1)
    return int(tracks.ball.frame[inside][-1]) if inside.any() else 0


def png_bytes(image: NDArray[np.uint8]) -> bytes:
    """Encode an image (H, W, 3), blue first, as PNG."""
    return bytes(cv2.imencode(".png", image)[1])
