"""Sequences of images: folders of numbered files, animated WebP, TIFF stacks."""

import hashlib
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology import ClipError
from vision.clip.mosaic import Mosaic, mosaic_of
from vision.clip.picture import (
    ClipInfo,
    GrayImage,
    Upright,
    decoded_image,
    refuse_giant,
    shrink_of,
)

__all__ = ["MOSAIC_NOTE", "Animation", "ImageFolder", "ImageFrame", "is_animation", "is_image"]

FloatArray = NDArray[np.float64]

MOSAIC_NOTE = (
    "The images are raw (a mosaic of colour filters): it is averaged for gray pictures. Colours are"
    " not calibrated, and red and blue may be exchanged."
)

_IMAGE_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"}

_VIDEO_SUFFIXES = {".mp4", ".mov", ".avi", ".mkv", ".m4v", ".webm", ".mts", ".cine", ".wmv"}


def is_image(path: Path) -> bool:
    """Whether a file's suffix is that of an image."""
    return path.suffix.lower() in _IMAGE_SUFFIXES


class ImageFrame:
    """One image, read on request."""

    def __init__(
        self,
        index: int,
        path: Path,
        shape: tuple[int, int] | None,
        time_s: float | None = None,
        mosaic: Mosaic | None = None,
    ) -> None:
        self.index = index
        self.time_s = float(index) if time_s is None else time_s
        self._path = path
        self._shape = shape
        self._mosaic = mosaic

    def stored(self) -> NDArray[Any]:
        """The image as it is stored, gray or colour."""
        return self._read(cv2.IMREAD_UNCHANGED)

    def gray(self) -> GrayImage:
        """Gray levels (H, W), uint8 or uint16."""
        image = self._read(cv2.IMREAD_UNCHANGED)
        if image.ndim == 3:
            image = image[:, :, :3] if image.shape[2] > 3 else image
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        return image if self._mosaic is None else self._mosaic.gray(image)

    def colour(self) -> NDArray[np.uint8]:
        """Colour image (H, W, 3), blue first."""
        if self._mosaic is not None:
            return self._mosaic.colour(self._read(cv2.IMREAD_UNCHANGED))
        return self._read(cv2.IMREAD_COLOR)

    def _read(self, flags: int) -> NDArray[Any]:
        # IMREAD_UNCHANGED skips the camera's orientation tag, so the others must skip it, too.
        data = self._path.read_bytes()
        image = decoded_image(data, flags | cv2.IMREAD_IGNORE_ORIENTATION, self._path)
        if image is None or image.dtype not in (np.uint8, np.uint16):
            raise ClipError(
                f"{self._path} cannot be read as an image",
                hint="Remove it from the folder, or save the images as PNG of 8 or 16 bit.",
            )
        if self._shape is not None and image.shape[:2] != self._shape:
            height, width = self._shape
            raise ClipError(
                f"{self._path} is {image.shape[1]}×{image.shape[0]} px, the images before it are "
                f"{width}×{height} px",
                hint="Keep only the images of one recording in the folder.",
            )
        return np.asarray(image)


class ImageFolder:
    """Images of one folder in natural order (frame2 before frame10).

    Parameters
    ----------
    path : Path
        The folder.
    whole : bool
        As in `ClipReader.open`.

    Raises
    ------
    ClipError
        If there is no image in it, or the first can't be read.
    """

    def __init__(self, path: Path, *, whole: bool = False) -> None:
        # macOS keeps a hidden file beside each image
        held = [one for one in path.iterdir() if not one.name.startswith(".")]
        images = sorted((one for one in held if is_image(one)), key=_natural)
        if not images:
            raise _no_images(path, held)
        self._paths, aside = _one_series(path, images)
        self._times, said = _times_of_names([path.name for path in self._paths])
        first = ImageFrame(0, self._paths[0], None).stored()
        self._mosaic = mosaic_of(first)
        self.size = (int(first.shape[0]), int(first.shape[1]))
        codec = self._paths[0].suffix.lower().lstrip(".")
        notes = (aside, said, None if self._mosaic is None else MOSAIC_NOTE)
        self.upright, self.info = _described(
            path, self._digest(), first, self._times, codec, notes, whole=whole
        )

    @property
    def times_s(self) -> FloatArray:
        """Image numbers, used as times; 0 at the first."""
        return self._times

    def pictures(self) -> Iterator[ImageFrame]:
        """Yield the images in order."""
        for index, path in enumerate(self._paths):
            time = float(self._times[index])
            yield ImageFrame(index, path, self.size, time, self._mosaic)

    def _digest(self) -> str:
        digest = hashlib.sha256()
        for path in self._paths:
            digest.update(os.fsencode(path.name))
            digest.update(hashlib.sha256(path.read_bytes()).digest())
        return digest.hexdigest()


def _no_images(path: Path, held: Sequence[Path]) -> ClipError:
    """Why a folder is no clip, by what it holds."""
    hint = "Pass a video file, or a folder of numbered PNG, JPEG, BMP or TIFF images."
    videos = [one for one in held if one.suffix.lower() in _VIDEO_SUFFIXES]
    raws = [one for one in held if one.suffix.lower() in _RAW_SUFFIXES]
    if videos:
        hint = (
            f"It holds videos ({videos[0].name}, …): pass one of them, or measure all with"
            " vision campaign FOLDER (in Python: iv.campaign)."
        )
    elif raws:
        hint = (
            f"It holds {len(raws)} raw or phone photographs ({raws[0].suffix}): convert them to"
            " TIFF or PNG with the camera's program, one file each with its number."
        )
    elif any(one.is_dir() for one in held):
        hint = "It holds folders: pass the one with the images."
    return ClipError(f"there are no images in the folder {path}", hint=hint)


def _one_series(path: Path, images: Sequence[Path]) -> tuple[list[Path], str | None]:
    """The images of the recording, and a note on single ones beside it.

    Raises
    ------
    ClipError
        If there are several recordings: series whose names differ in more than their numbers.
    """
    series: dict[str, list[Path]] = {}
    for image in images:
        series.setdefault(re.sub(r"\d+", "#", image.name).lower(), []).append(image)
    long = [one for one in series.values() if len(one) > _MAX_SINGLE_IMAGES]
    if len(series) == 1 or 2 * sum(map(len, long)) < len(images):
        return list(images), None
    if len(long) > 1:
        listed = ", ".join(f"{one[0].name} and {len(one) - 1} more" for one in long)
        raise ClipError(
            f"{path} holds the images of {len(long)} recordings: {listed}",
            hint="Put each recording into a folder of its own.",
        )
    others = [one.name for one in images if one not in set(long[0])]
    listed = ", ".join(others[:_MAX_SINGLE_IMAGES])
    return long[0], f"{len(others)} images are no part of the series and not read: {listed}."


_MAX_SINGLE_IMAGES = 3
"""Images that are no recording of their own: a background, a thumbnail, a calibration (chosen)."""

_RAW_SUFFIXES = {".dng", ".heic", ".heif", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".rw2", ".orf"}


def _described(
    path: Path,
    sha256: str,
    first: NDArray[Any],
    times: FloatArray,
    codec: str,
    notes: Sequence[str | None],
    *,
    whole: bool,
) -> tuple[Upright, ClipInfo]:
    """Orientation and properties of a sequence of images."""
    height, width = int(first.shape[0]), int(first.shape[1])
    shrink, note = (1, None) if whole else shrink_of(height, width)
    info = ClipInfo(
        path=path,
        sha256=sha256,
        width=width // shrink,
        height=height // shrink,
        frames=len(times),
        codec=codec,
        container_fps=1.0,
        container_declares_rate=False,
        duration_s=float(times[-1]),
        rotation=0,
        weave="progressive",
        bit_depth=8 * first.dtype.itemsize,
        capture_fps_metadata=None,
        variable_rate=False,
        warnings=tuple(one for one in (note, *notes) if one is not None),
    )
    return Upright(shrink=shrink), info


class AnimationFrame:
    """One picture of an animation or a stack."""

    def __init__(self, index: int, stored: NDArray[Any], mosaic: Mosaic | None = None) -> None:
        self.index = index
        self.time_s = float(index)
        self.stored = stored
        self._mosaic = mosaic

    def gray(self) -> GrayImage:
        """Gray levels (H, W), uint8 or uint16."""
        if self.stored.ndim == 3:
            return np.asarray(cv2.cvtColor(self.stored, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        return self.stored if self._mosaic is None else self._mosaic.gray(self.stored)

    def colour(self) -> NDArray[np.uint8]:
        """Colour image (H, W, 3), blue first."""
        if self.stored.ndim == 3:
            return self.stored
        if self._mosaic is not None:
            return self._mosaic.colour(self.stored)
        eight = self.stored >> (8 * (self.stored.itemsize - 1))
        return np.asarray(cv2.cvtColor(eight.astype(np.uint8), cv2.COLOR_GRAY2BGR), np.uint8)


class Animation:
    """An animated WebP or a stack of TIFF; its pictures count, its playback times do not.

    Parameters
    ----------
    path : Path
    whole : bool
        As in `ClipReader.open`.

    Raises
    ------
    ClipError
        If it can't be read.
    """

    def __init__(self, path: Path, *, whole: bool = False) -> None:
        self._path = path
        self._mosaic: Mosaic | None = None
        first = next(self.pictures()).stored
        self._mosaic = mosaic_of(first)
        self.size = (int(first.shape[0]), int(first.shape[1]))
        with _opened(path) as image:
            count = int(getattr(image, "n_frames", 1))
        self._times = np.arange(count, dtype=np.float64)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        notes = (None if self._mosaic is None else MOSAIC_NOTE,)
        codec = path.suffix.lower().lstrip(".")
        self.upright, self.info = _described(
            path, digest, first, self._times, codec, notes, whole=whole
        )

    @property
    def times_s(self) -> FloatArray:
        """Numbers of the pictures, used as times."""
        return self._times

    def pictures(self) -> Iterator[AnimationFrame]:
        """Yield the pictures in order."""
        with _opened(self._path) as image:
            for index in range(int(getattr(image, "n_frames", 1))):
                try:
                    image.seek(index)
                    picture = _pixels(image)
                except (EOFError, OSError, ValueError) as problem:
                    if index:
                        return
                    raise ClipError(
                        f"no picture of {self._path} can be decoded",
                        hint="The file is damaged. Save it again, or as MP4.",
                    ) from problem
                yield AnimationFrame(index, picture, self._mosaic)


def _pixels(image: Any) -> NDArray[Any]:
    """Gray levels of 8 or 16 bit, or colours (blue first)."""
    if image.mode == "L" or image.mode.startswith("I;16"):
        gray = np.asarray(image)
        return gray.astype(gray.dtype.newbyteorder("="))
    return np.ascontiguousarray(np.asarray(image.convert("RGB"))[:, :, ::-1])


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    from PIL import Image, UnidentifiedImageError

    try:
        image = Image.open(path)
    except (UnidentifiedImageError, OSError, ValueError, Image.DecompressionBombError) as problem:
        raise ClipError(
            f"{path} cannot be read as a series of pictures", hint="Save it again, or as MP4."
        ) from problem
    with image:
        width, height = image.size
        refuse_giant(height, width, path)
        yield image


def is_animation(path: Path) -> bool:
    """Whether a file is a WebP or TIFF, of which FFmpeg reads only the first picture."""
    with path.open("rb") as file:
        head = file.read(12)
    return (head[:4] == b"RIFF" and head[8:12] == b"WEBP") or head[:4] in (b"II*\0", b"MM\0*")


_MAX_NUMBER_STEP = 10
"""Step of the images' numbers up to which they count pictures (chosen); larger ones are times."""


def _times_of_names(names: Sequence[str]) -> tuple[FloatArray, str | None]:
    """Times of images in pictures, from the numbers in their names, and a note.

    Images whose numbers have holes, or go in steps of two, were taken out of a recording: their
    numbers are its clock. Names without one number that counts give the order.
    """
    order = np.arange(len(names), dtype=np.float64)
    groups = [re.findall(r"\d+", name) for name in names]
    if len(names) < 3 or len({len(group) for group in groups}) != 1 or not groups[0]:
        return order, None
    numbers = np.array([[int(part[-15:]) for part in group] for group in groups], dtype=np.int64)
    counting = [column for column in numbers.T if np.all(np.diff(column) > 0)]
    if len(counting) != 1:
        return order, None
    steps = np.diff(counting[0])
    step = int(np.gcd.reduce(steps))
    if step > _MAX_NUMBER_STEP or int(np.median(steps)) != step:
        return order, None
    since = (counting[0] - counting[0][0]).astype(np.float64)
    lacking = int((steps // step - 1).sum())
    said = []
    if step > 1:
        said.append(
            f"The images' numbers go in steps of {step}: the camera's rate is taken to be that of"
            " the numbers."
        )
    if lacking:
        holes = [
            f"{counting[0][k]} and {counting[0][k + 1]}" for k in np.flatnonzero(steps > step)[:4]
        ]
        said.append(
            f"{lacking} images are missing, between the numbers {', '.join(holes)}; the times of"
            " the others account for them."
        )
    return since, " ".join(said) or None


def _natural(path: Path) -> list[tuple[int, str]]:
    parts = re.findall(r"\d+|\D+", path.name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]
