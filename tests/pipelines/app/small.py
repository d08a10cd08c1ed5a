"""A small clip, measured once for the tests of the page."""

from functools import cache
from pathlib import Path

import cv2
import numpy as np

from measuring.chain import MeasureOptions, measure_clip
from measuring.measurement import ClipMeasurement
from measuring.setup.file import load_setup

__all__ = ["CLIP", "FALL", "falling", "strike"]

CLIP = Path(__file__).parents[3] / "sample_videos" / "clips" / "jokku_90_small.mp4"
FPS, RADIUS, FALL = 120.0, 9.0, 0.11


@cache
def strike() -> ClipMeasurement:
    """The small sample strike."""
    return measure_clip(
        CLIP, MeasureOptions(setup=load_setup(CLIP.with_suffix(".toml")), cache=True)
    )


def falling(folder: Path, frames: int = 36, scale: int = 1) -> Path:
    """Folder of pictures of a dark ball that falls; `scale` enlarges them."""
    folder.mkdir()
    noise = np.random.default_rng(3)
    for frame in range(frames):
        picture = np.full((200, 120), 190.0)
        at = (60 * 16, round((20 + FALL * frame**2) * 16))
        cv2.circle(picture, at, round(RADIUS * 16), 60.0, -1, cv2.LINE_AA, 4)
        picture = picture + noise.normal(0.0, 1.5, picture.shape)
        image = np.clip(picture, 0, 255).astype(np.uint8)
        if scale > 1:
            image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale), np.uint8)
        cv2.imwrite(str(folder / f"{frame:03d}.png"), image)
    return folder
