"""A folder of numbered images read as a clip."""

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology import ClipError
from vision.clip.info import ClipInfo, GrayImage

__all__ = ["ImageFolder", "ImageFrame", "is_image"]

_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"}


def is_image(path: Path) -> bool:
    """Whether a file's name is that of an image."""
    return path.suffix.lower() in _SUFFIXES


class ImageFrame:
    """One image, read when it is asked for."""

    def __init__(self, index: int, path: Path, shape: tuple[int, int] | None) -> None:
        self.index = index
        self.time_s = float(index)
        self._path = path
        self._shape = shape

    def gray(self) -> GrayImage:
        """Gray levels (H, W), uint8 or uint16."""
        image = self._read(cv2.IMREAD_UNCHANGED)
        if image.ndim == 3:
            image = image[:, :, :3] if image.shape[2] > 3 else image
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        return image

    def colour(self) -> NDArray[np.uint8]:
        """Colour image (H, W, 3), blue first."""
        return self._read(cv2.IMREAD_COLOR)

    def _read(self, flags: int) -> NDArray[Any]:
        # IMREAD_UNCHANGED skips the camera's orientation tag, so it is asked for without.
        data = np.frombuffer(self._path.read_bytes(), np.uint8)
        image = cv2.imdecode(data, flags | cv2.IMREAD_IGNORE_ORIENTATION) if len(data) else None
        if image is None or image.dtype not in (np.uint8, np.uint16):
            raise ClipError(
                f"{self._path} is no image that can be read",
                hint="Remove it from the folder, or save the images as PNG of 8 or 16 bit.",
            )
        if self._shape is not None and image.shape[:2] != self._shape:
            height, width = self._shape
            raise ClipError(
                f"{self._path} is {image.shape[1]}×{image.shape[0]} px, the images before it are "
                f"{width}×{height} px",
                hint="Keep the images of one recording, and nothing else, in the folder.",
            )
        return np.asarray(image)


class ImageFolder:
    """Images of one folder in natural order (frame2 before frame10).

    Parameters
    ----------
    path : Path
        The folder.

    Raises
    ------
    ClipError
        If there is no image in it, or the first can't be read.
    """

    def __init__(self, path: Path) -> None:
        self._paths = sorted((item for item in path.iterdir() if is_image(item)), key=_natural)
        if not self._paths:
            raise ClipError(
                f"there are no images in the folder {path}",
                hint="Give a video file, or a folder of numbered PNG, JPEG, BMP or TIFF images.",
            )
        first = ImageFrame(0, self._paths[0], None).gray()
        self._shape = (int(first.shape[0]), int(first.shape[1]))
        self.damage: tuple[str, ...] = ()
        self.info = ClipInfo(
            path=path,
            sha256=self._digest(),
            width=self._shape[1],
            height=self._shape[0],
            frames=len(self._paths),
            codec=self._paths[0].suffix.lower().lstrip("."),
            container_fps=1.0,
            container_declares_rate=False,
            duration_s=float(len(self._paths) - 1),
            rotation=0,
            weave="progressive",
            bit_depth=8 * first.dtype.itemsize,
            capture_fps_metadata=None,
            variable_rate=False,
        )

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Numbers of the images, as times."""
        return np.arange(len(self._paths), dtype=np.float64)

    def pictures(self) -> Iterator[ImageFrame]:
        """Give the images in order."""
        for index, path in enumerate(self._paths):
            yield ImageFrame(index, path, self._shape)

    def _digest(self) -> str:
        digest = hashlib.sha256()
        for path in self._paths:
            digest.update(path.name.encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
        return digest.hexdigest()


def _natural(path: Path) -> list[tuple[int, str]]:
    parts = re.findall(r"\d+|\D+", path.name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]
