"""Text on images, with the signs that uncertainties need (± ° ²), which OpenCV's fonts lack."""

from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

__all__ = ["line_height", "text_width", "write_text"]

Colour = tuple[int, int, int]


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
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
    mask = Image.new("L", (patch.shape[1], patch.shape[0]))
    ImageDraw.Draw(mask).text((0, 0), text, font=_font(size), fill=255)
    cover = np.asarray(mask, np.float32)[:, :, None] / 255.0
    patch[:] = np.round(patch * (1.0 - cover) + np.array(colour, np.float32) * cover).astype(
        np.uint8
    )
