"""The overlay video: every frame with what was found in it, written whole or not at all."""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from av.error import FFmpegError
from numpy.typing import NDArray

from metrology import UsageError, written_whole
from vision.clip.clip import Clip
from vision.overlay import OVERLAY_SUFFIXES
from vision.overlay.drawing import OverlayPainter
from vision.overlay.marks import OverlayMarks
from vision.tracks import Tracks

__all__ = ["OVERLAY_SUFFIXES", "OverlayMarks", "overlay_still", "png_bytes", "write_overlay"]

_PLAYED_FPS = 30


def write_overlay(
    path: Path,
    clip: Clip,
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
    clip : Clip
        What was measured.
    tracks : Tracks
        What was found in it.
    marks : OverlayMarks, optional
        Contact, grid, landing and captions.
    progress : callable, optional
        Called with the number of frames written so far.

    Raises
    ------
    UsageError
        If the file's kind is unknown or its folder can't be written to.
    ClipError
        If the clip can't be read any more.
    """
    if path.suffix.lower() not in OVERLAY_SUFFIXES:
        raise UsageError(
            f"an overlay can't be written as {path.suffix or path.name}",
            hint=f"Name a file that ends in {', '.join(OVERLAY_SUFFIXES)}.",
        )
    painter = OverlayPainter(clip.info.width, clip.info.height, tracks, marks or OverlayMarks())
    with written_whole(path) as temporary:
        try:
            _encode(temporary, clip, painter, progress)
        except FFmpegError as problem:
            raise UsageError(
                f"the overlay {path} can't be written: {problem.strerror}",
                hint="Is there room on the disk?",
            ) from problem


def _encode(
    path: Path, clip: Clip, painter: OverlayPainter, progress: Callable[[int], None] | None
) -> None:
    height, width = painter.shape
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=_PLAYED_FPS)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.options = {"crf": "20", "preset": "superfast"}
        for count, (index, picture) in enumerate(clip.colour_frames()):
            frame = av.VideoFrame.from_ndarray(painter.paint(index, picture), format="bgr24")
            frame.pts, frame.time_base = count, Fraction(1, _PLAYED_FPS)
            container.mux(stream.encode(frame))
            if progress is not None:
                progress(count + 1)
        container.mux(stream.encode())


def overlay_still(
    clip: Clip, tracks: Tracks, marks: OverlayMarks | None = None, *, frame: int | None = None
) -> NDArray[np.uint8]:
    """Draw one frame of the overlay as an image (H, W, 3), blue first.

    Parameters
    ----------
    clip : Clip
    tracks : Tracks
    marks : OverlayMarks, optional
    frame : int, optional
        Which frame; if not given, the last one with the ball in view, so that its whole path shows.

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


def _last_in_view(clip: Clip, tracks: Tracks) -> int:
    x, y = tracks.ball.centre_px.T
    inside = (x > 0) & (x < clip.info.width - 1) & (y > 0) & (y < clip.info.height - 1)
    return int(tracks.ball.frame[inside][-1]) if inside.any() else 0


def png_bytes(image: NDArray[np.uint8]) -> bytes:
    """Encode an image (H, W, 3), blue first, as PNG."""
    return bytes(cv2.imencode(".png", image)[1])
