"""What a clip shows before any question is asked: its still scene, its rate, the ball followed."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from vision.clip.clip import ClipReader
from vision.clip.footage import CaptureRate, choose_capture_rate
from vision.clip.info import ClipInfo
from vision.following import follow
from vision.tracks import Track, Tracks

__all__ = ["BallSeen", "WizardClip", "look_at", "watch_ball"]

FloatArray = NDArray[np.float64]

FRAMES_LOOKED_AT = 40
"""Frames whose median is the still scene: what moves hides a place in fewer than half of them."""
SQUASHED_S = 0.03
"""A struck ball is round again after this."""
LEAST_FLIGHT = 8
"""Frames of a flight at least: a parabola has six numbers, and two more show a misfit."""


@dataclass(frozen=True, eq=False)
class WizardClip:
    """A clip as the wizard starts from it.

    Attributes
    ----------
    info : ClipInfo
    picture : (H, W) uint8 array
        Median of frames over the whole clip: the scene without what moves.
    first : (H, W) uint8 array
        The first frame.
    rate : CaptureRate
        As the file or an option tells it.
    """

    info: ClipInfo
    picture: NDArray[np.uint8]
    first: NDArray[np.uint8]
    rate: CaptureRate

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.info.width, self.info.height


@dataclass(frozen=True, eq=False)
class BallSeen:
    """What following the ball told.

    Attributes
    ----------
    rest_px : (2,) array or None
        Centre of its outline at rest, px; None if it never rests.
    landing_px : (2,) array or None
        Centre where it is lowest after its flight, px.
    flight : Track or None
        Rows in which it flies and is round, between contact and landing.
    """

    rest_px: FloatArray | None
    landing_px: FloatArray | None
    flight: Track | None

    @classmethod
    def of(cls, tracks: Tracks) -> Self:
        """Sum up tracks."""
        ball = tracks.ball
        if tracks.rest_frames is None:
            return cls(None, None, None)
        first, last = tracks.rest_frames
        still = (ball.frame >= first) & (ball.frame <= last)
        rest = np.median(ball.centre_px[still], axis=0) if still.any() else None
        after = ball.where(ball.frame > last)
        if len(after) < LEAST_FLIGHT:
            return cls(rest, None, None)
        lowest = int(np.argmax(after.centre_px[:, 1]))
        step = float(np.median(np.diff(after.time_s)))
        round_again = after.frame > last + SQUASHED_S / step
        whole = after.quality >= 0.5 * np.median(after.quality)
        flying = after.where(round_again & whole & (np.arange(len(after)) <= lowest))
        return cls(rest, after.centre_px[lowest], flying if len(flying) >= LEAST_FLIGHT else None)


def look_at(path: Path, fps: float | None = None) -> WizardClip:
    """Open a clip and take the median of its frames.

    Raises
    ------
    ClipError
        If it can't be read.
    UsageError
        If `fps` is no rate.
    """
    clip = ClipReader.open(path)
    rate = choose_capture_rate(clip.info, fps)
    stride = max(1, clip.info.frames // FRAMES_LOOKED_AT)
    frames = [frame.gray for frame in clip.frames() if frame.index % stride == 0]
    return WizardClip(
        clip.info,
        _eight_bit(np.median(frames, axis=0), frames[0].dtype),
        _eight_bit(frames[0], frames[0].dtype),
        rate,
    )


def _eight_bit(picture: NDArray[np.generic], stored: np.dtype[np.generic]) -> NDArray[np.uint8]:
    levels = np.asarray(picture, dtype=np.float64) / (257.0 if stored == np.uint16 else 1.0)
    return np.asarray(np.round(levels), dtype=np.uint8)


def watch_ball(
    path: Path,
    fps: float,
    *,
    ball_at: tuple[float, float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> BallSeen:
    """Follow the ball through a clip.

    Raises
    ------
    NotFoundError
        If nothing round moves in it.
    """
    clip = ClipReader.open(path)
    return BallSeen.of(follow(clip, fps, ball_at=ball_at, progress=progress))
