"""`Clip`: a recording as an iterable of frames and times.

`render`: a synthetic clip with its truth.
"""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from metrology import UsageError, measurands, read_number
from pipelines.api.quantities import Given, SetupLike, setup_from
from pipelines.model.options import angle_of
from pipelines.render import NOISE, RenderOptions, parse_size, planned_scene
from sample_videos import Truth, render_clip
from vision.clip.clip import ClipReader as Recording
from vision.clip.footage import choose_capture_rate
from vision.clip.info import ClipInfo, GrayImage

__all__ = ["Clip", "render"]


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


def render(
    path: str | os.PathLike[str],
    *,
    setup: SetupLike = None,
    backswing: Given = "120 deg",
    ball: str | None = None,
    size: str | tuple[int, int] = (432, 240),
    frames: int | None = None,
    seed: int = 1,
    fps: Given | None = None,
    shutter: Given | None = None,
    view: str = "landing",
    noise: str = "good",
    effects: Sequence[str] = (),
    mirrored: bool = False,
) -> Truth:
    """Film the experiment with a virtual camera; the truth is written beside the clip.

    Parameters
    ----------
    path : path
        The clip to write: .mp4, or what the codec wants.
    setup : Setup or path, optional
        The paper's experiment where it is silent.
    backswing : float or str
        deg, or such as "90 deg".
    ball : str, optional
        A preset, or a ball of the setup.
    size : (width, height) or str
        px, or "432x240".
    frames : int, optional
        Default: until shortly after landing.
    seed : int
        The same seed gives the same clip.
    fps : float or str, optional
        Capture rate, 1/s; default the setup's, else 600.
    shutter : float or str, optional
        Exposure time, s or such as "1/2000 s".
    view : {"landing", "impact", "oblique"}
    noise : {"none", "low", "good", "high", "dim"}
    effects : sequence of str
        Of the catalogue, with their values: "magnus:spin=10".
    mirrored : bool
        The ball is struck to the left.

    Returns
    -------
    Truth
        What really happened, frame by frame.

    Raises
    ------
    UsageError
        For options that can't be.
    """
    if noise not in NOISE:
        raise UsageError(f"noise {noise!r} is not known", hint=f"One of {', '.join(NOISE)}.")
    out = Path(path)
    if not out.absolute().parent.is_dir():
        raise UsageError(f"can't write {out}: there is no folder {out.parent}")
    text = size if isinstance(size, str) else f"{size[0]}x{size[1]}"
    options = RenderOptions(
        backswing=angle_of(str(backswing)),
        ball=ball,
        size=parse_size(text),
        frames=frames,
        seed=seed,
        fps=None if fps is None else read_number(fps, measurands.CAPTURE_RATE, "fps"),
        shutter=None if shutter is None else read_number(shutter, measurands.SHUTTER, "shutter"),
        view=view,
        noise=NOISE[noise],
        effects=tuple(effects),
        mirrored=mirrored,
    )
    scene, shot = planned_scene(setup_from(setup), options)
    return render_clip(scene, shot, out)
