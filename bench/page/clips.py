"""Clips made for the page: a very long one, and many short ones."""

from collections.abc import Iterator
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from physics.bodies import GRAVITY

__all__ = ["BALL_MM", "CLIP_FPS", "long_clip", "short_clips"]

CLIP_FPS = 240
DRAWN_RADIUS_PX = 9.0

_FALL_PX = 0.05
"""Half the acceleration, px per frame squared; chosen: 60 frames of fall are 180 px."""

BALL_MM = 1e3 * 2.0 * DRAWN_RADIUS_PX * GRAVITY / (2.0 * _FALL_PX * CLIP_FPS**2)
"""Diameter, mm; derived: the ball of `DRAWN_RADIUS_PX` that falls so with gravity."""


def _write(path: Path, pictures: Iterator[NDArray[np.uint8]], size: tuple[int, int]) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=CLIP_FPS)
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        stream.options = {"preset": "ultrafast", "crf": "20"}
        for picture in pictures:
            frame = av.VideoFrame.from_ndarray(picture, format="gray")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _with_ball(ground: NDArray[np.uint8], y: float) -> NDArray[np.uint8]:
    picture = ground.copy()
    at = (round(16 * ground.shape[1] / 2), round(16 * y))
    return np.asarray(cv2.circle(picture, at, round(16 * DRAWN_RADIUS_PX), 60, -1, cv2.LINE_AA, 4))


def long_clip(path: Path, frames: int, size: tuple[int, int] = (432, 240)) -> Path:
    """A clip in which a ball falls once, in the middle of a long rest."""
    noise = np.random.default_rng(7)
    grounds = [
        np.clip(noise.normal(190.0, 4.0, size[::-1]), 0, 255).astype(np.uint8) for _ in range(8)
    ]

    def pictures() -> Iterator[NDArray[np.uint8]]:
        for frame in range(frames):
            since = min(max(frame - frames // 2, 0), 60)
            yield _with_ball(grounds[frame % 8], 25.0 + _FALL_PX * since**2)

    _write(path, pictures(), size)
    return path


def short_clips(folder: Path, count: int) -> list[str]:
    """Names of short clips of falls, each with noise of its own."""
    folder.mkdir()
    names = [f"fall-{number:02d}.mp4" for number in range(count)]
    for seed, name in enumerate(names):
        noise = np.random.default_rng(seed)

        def pictures(noise: np.random.Generator = noise) -> Iterator[NDArray[np.uint8]]:
            for frame in range(55):
                ground = np.clip(noise.normal(190.0, 4.0, (200, 120)), 0, 255).astype(np.uint8)
                yield _with_ball(ground, 20.0 + _FALL_PX * frame**2)

        _write(folder / name, pictures(), (120, 200))
    return names
