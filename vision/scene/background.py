"""The static scene: what is seen when nothing moves, its noise, and each frame's brightness.

Things that lay still for so long that they look like background, told from what they hid.

A ball that rests for most of the clip is what most frames show at that place. Two states of a
region, with and without the thing, are told apart by the region's own outline: only with the thing
does the picture have a step along it. The same holds for the shadow that left with it.

Pictures sorted pixel by pixel: a network of minima and maxima over whole pictures at a time.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeVar

import cv2
import numpy as np
import scipy
import skimage
from numpy.typing import NDArray

__all__ = [
    "Background",
    "LightMeter",
    "brightness",
    "densest",
    "estimate_background",
    "sorted_stack",
]

FloatImage = NDArray[np.float32]

_DIFFERENT = 6.0
"""Standard deviations by which an epoch differs from the rest: in a picture of a million pixels
none does by chance."""

_SMALLEST = 40
"""px: of smaller pieces it does not matter which picture is the background, a ball that is seen has
more."""

# A thing's outline is a step that the noise does not make, and that is gone without the thing.
_LEAST_STEP = 1.5

_SMOOTHER = 0.4
"""Of the step at its rim, supposed: what was uncovered ends in the wall behind it without one."""


def without_ghosts(
    epochs: list[FloatImage],
    stable: list[NDArray[np.bool_]],
    usual: FloatImage,
    noise: FloatImage,
) -> FloatImage:
    """Replace regions of the usual picture that show something that was not always there.

    Parameters
    ----------
    epochs : list of (H, W) float32 arrays
        The scene in successive parts of the clip.
    stable : list of (H, W) bool arrays
        Where nothing moved in each part; elsewhere it tells nothing of the scene.
    usual : (H, W) float32 array
        What is shown most of the time.
    noise : (H, W) float32 array
        Standard deviation of a frame's pixel, gray levels.

    Returns
    -------
    (H, W) float32 array
    """
    clean = usual.copy()
    code = np.zeros(usual.shape, dtype=np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    for bit, (epoch, still) in enumerate(zip(epochs, stable, strict=True)):
        differs = ((np.abs(epoch - usual) > _DIFFERENT * noise) & still).astype(np.uint8)
        opened = cv2.morphologyEx(differs, cv2.MORPH_OPEN, kernel)
        code |= np.where(opened > 0, np.uint8(1 << bit), np.uint8(0))
    # Pixels that differ in the same epochs belong together: the ball that left, apart from the mass
    # that swung into its place.
    least = float(np.median(noise))
    pieces = skimage.measure.label(code, connectivity=2)  # type: ignore[no-untyped-call]
    for piece in skimage.measure.regionprops(pieces, intensity_image=code):  # type: ignore[no-untyped-call]
        value = int(piece.intensity_max)
        if piece.area < _SMALLEST or not _at_one_end(value, len(epochs)):
            continue
        window = _window(piece.bbox, usual.shape)
        region = (pieces[window] == piece.label).astype(np.uint8)
        others = [epochs[bit][window] for bit in range(len(epochs)) if value >> bit & 1]
        steps = [_step_along(other, region) for other in others]
        best, seen = int(np.argmin(steps)), _step_along(usual[window], region)
        if seen > _LEAST_STEP * least and steps[best] < _SMOOTHER * seen:
            wide = cv2.dilate(region, np.ones((7, 7), np.uint8)) > 0
            clean[window][wide] = others[best][wide]
    return clean


def _at_one_end(code: int, epochs: int) -> bool:
    """Whether an alternative is what the clip begins or ends with: a thing that lay and left.

    What is seen for a while in between is something that swung by.
    """
    ends = [(1 << run) - 1 for run in range(1, epochs)]
    ends += [((1 << run) - 1) << (epochs - run) for run in range(1, epochs)]
    return code in ends


def _window(box: tuple[int, int, int, int], shape: tuple[int, ...]) -> tuple[slice, slice]:
    top, left, bottom, right = box
    return (
        slice(max(0, top - 8), min(shape[0], bottom + 8)),
        slice(max(0, left - 8), min(shape[1], right + 8)),
    )


def _step_along(picture: FloatImage, region: NDArray[np.uint8]) -> float:
    """Mean step of the picture across the region's outline, gray levels per pixel."""
    soft = cv2.GaussianBlur(region.astype(np.float32), (0, 0), 1.5)
    nx, ny = cv2.Scharr(soft, cv2.CV_32F, 1, 0), cv2.Scharr(soft, cv2.CV_32F, 0, 1)
    length = np.hypot(nx, ny)
    smooth = cv2.GaussianBlur(picture, (0, 0), 1.5)
    gx = cv2.Scharr(smooth, cv2.CV_32F, 1, 0) / 32.0
    gy = cv2.Scharr(smooth, cv2.CV_32F, 0, 1) / 32.0
    across = (gx * nx + gy * ny) / np.maximum(length, 1e-6)
    # Smoothed along the outline, so that lines of the scene that cross it cancel.
    weight = length * (length > 0.3 * length.max())
    mean = cv2.GaussianBlur(across * weight, (0, 0), 3.0)
    norm = cv2.GaussianBlur(weight, (0, 0), 3.0)
    local = np.abs(mean) / np.maximum(norm, 1e-6)
    return float(np.sum(local * weight) / max(float(np.sum(weight)), 1e-6))


Level = TypeVar("Level", np.uint16, np.float32)


def sorted_stack(pictures: Sequence[NDArray[Level]]) -> list[NDArray[Level]]:
    """Sort each pixel over several pictures.

    Parameters
    ----------
    pictures : sequence of (H, W) arrays
        The pictures.

    Returns
    -------
    list of (H, W) arrays
        The lowest levels, the second lowest, and so on.
    """
    stack = list(pictures)
    for low, high in _comparisons(len(stack)):
        one, other = stack[low], stack[high]
        stack[low], stack[high] = np.minimum(one, other), np.maximum(one, other)
    return stack


def median_of(pictures: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Median of each pixel over several pictures."""
    stack = sorted_stack(pictures)
    middle = len(stack) // 2
    if len(stack) % 2:
        return stack[middle]
    return np.float32(0.5) * (stack[middle - 1] + stack[middle])


def densest(ordered: Sequence[NDArray[np.uint16]], share: float) -> NDArray[np.float32]:
    """Middle of the narrowest interval that holds a share of each pixel's levels.

    Parameters
    ----------
    ordered : sequence of (H, W) arrays
        What `sorted_stack` gave.
    share : float
        That share, 0 to 1.

    Returns
    -------
    (H, W) array
    """
    count = len(ordered)
    reach = min(max(1, round(share * count) - 1), count - 1)
    best = np.full(ordered[0].shape, np.iinfo(np.uint32).max, dtype=np.uint32)
    for first in range(count - reach):
        width = (ordered[first + reach] - ordered[first]).astype(np.uint32)
        np.minimum(best, (width << 8) + np.uint32(first), out=best)
    place = (best & 0xFF).astype(np.int64)
    stack = np.stack(ordered)
    low, high = (
        np.take_along_axis(stack, (place + part)[None], axis=0)[0].astype(np.float32)
        for part in (reach // 2, (reach + 1) // 2)
    )
    return np.asarray(np.float32(0.5) * (low + high))


def _comparisons(count: int) -> Iterator[tuple[int, int]]:
    """Batcher's odd-even merge sort (1968): pairs to be put in order, one after another."""
    width = 1
    while width < count:
        step = width
        while step >= 1:
            for first in range(step % width, count - step, 2 * step):
                for low in range(first, min(first + step, count - step)):
                    if low // (2 * width) == (low + step) // (2 * width):
                        yield low, low + step
            step //= 2
        width *= 2


_LEVEL_BINS = 16
"""Levels of gray between which noise is taken as steady: noise changes over the scale by about
three."""

_LAW_PIXELS = 60_000
"""Pixels that tell the law of noise: the deviation of a sixteenth of them is good to 1.2 %."""

# Fixed-point steps of a gray level.
_STEPS = 128
"""Fixed-point steps of a gray level: rounding is then a hundredth of the noise of any sensor."""

_EPOCHS = 5
"""Parts of the clip whose medians are compared: in some part what moves or lies still has not yet
come or has gone."""

# The static scene is seen in at least this part of the frames, wherever it is seen at all.
_DENSEST = 0.35

_STABLE = 3.0
"""Standard deviations of noise: an epoch that scatters by more shows something that moves."""

_LEAST_GAIN = 0.05
"""Share of the usual light below which a frame is black."""
_BAND_PIXELS = 6_000_000
"""Pixels worked on at once, for a stack of some ten megabytes."""

_BRIGHTNESS_PIXELS = 4000
"""Pixels that tell a frame's gain: at 1 % of noise each to 0.02 %."""

_FEWEST_LIT = 50
"""Pixels: fewer, at some per cent of noise each, leave the gain open by half a per cent."""

# Rounding to whole gray levels and the codec's quantiser leave about this much where a clip looks
# noise-free.
_NOISE_FLOOR = 0.6

# Residual unsteadiness of a registered picture: edges of the scene are that much less certain.
_JITTER_PX = 0.06


@dataclass(frozen=True)
class Background:
    """The static scene in reference brightness.

    Attributes
    ----------
    image : (H, W) float32 array
        Gray levels (0 to 255, also for deeper clips).
    noise : (H, W) float32 array
        Standard deviation of one frame's pixel about it, gray levels.
    """

    image: FloatImage
    noise: FloatImage


class LightMeter:
    """Tells how much brighter a frame is than the scene, things in front ignored.

    Parameters
    ----------
    image : (H, W) float32 array
        The static scene, gray levels.
    noise : float
        Standard deviation of a pixel, gray levels.
    """

    def __init__(self, image: FloatImage, noise: float) -> None:
        self._step = max(1, int(np.sqrt(image.size / _BRIGHTNESS_PIXELS)))
        expected = image[:: self._step, :: self._step].ravel()
        lit = expected > max(8.0, 0.25 * float(np.median(expected)))
        self._places = np.nonzero(lit)[0]
        self._expected = expected[lit].astype(np.float32)
        self._near = np.float32(3.0 * noise + 1.0)

    def gain(self, frame: NDArray[Any], scale: float = 1.0) -> float:
        """Gain of one frame, 1 where both match; `scale` brings its gray levels to 0 to 255."""
        if len(self._places) < _FEWEST_LIT:
            return 1.0
        seen = frame[:: self._step, :: self._step].ravel()[self._places] * np.float32(scale)
        expected = self._expected
        ratio = seen / expected
        gain = float(np.partition(ratio, len(ratio) // 2)[len(ratio) // 2])
        for _ in range(2):
            inlier = np.abs(seen - np.float32(gain) * expected) < self._near
            if np.count_nonzero(inlier) < _FEWEST_LIT:
                break
            known = expected * inlier
            gain = float(np.dot(seen, known) / np.dot(expected, known))
        return gain


def brightness(frame: FloatImage, image: FloatImage, noise: float) -> float:
    """Estimate how much brighter `frame` is than the background `image`, things in front ignored.

    Parameters
    ----------
    frame, image : (H, W) float32 arrays
        Gray levels.
    noise : float
        Standard deviation of a pixel, gray levels.

    Returns
    -------
    float
        The gain: 1 where both are equally bright.
    """
    return LightMeter(image, noise).gain(frame)


def estimate_background(frames: Sequence[NDArray[Any]], scale: float = 1.0) -> Background:
    """Estimate the static scene from frames spread over the clip.

    Brightness is equalised first, so that mains flicker does not blur the medians. The clip is cut
    into epochs with a median each. A pixel takes the level about which its levels crowd most, since
    what moves shows ever other ones; where something lay still for so long that they crowd about
    the wrong thing, the epoch without its outline is taken (`vision.scene.background`).

    Parameters
    ----------
    frames : sequence of (H, W) arrays
        Gray levels, registered on one another, in time order.
    scale : float
        Brings them to 0 to 255.

    Returns
    -------
    Background
    """
    reference = frames[len(frames) // 2].astype(np.float32) * np.float32(scale)
    meter = LightMeter(reference, 2.0)
    gains = np.array([meter.gain(frame, scale) for frame in frames])
    # a black frame, of a fade or a cut, is no light to divide by
    usual_gain = max(float(np.median(gains)), _LEAST_GAIN)
    gains = scale / np.maximum(gains / usual_gain, _LEAST_GAIN)
    height, width = reference.shape
    rows = max(16, _BAND_PIXELS // (len(frames) * width))
    parts = min(_EPOCHS, max(1, len(frames) // 3))
    states = np.empty((2 * parts + 1, height, width), dtype=np.float32)
    for top in range(0, height, rows):
        band = slice(top, top + rows)
        levels = [_fixed_point(f[band], gain) for f, gain in zip(frames, gains, strict=True)]
        states[:, band] = _states(levels, parts)
    usual, epochs, spreads = states[0], list(states[1 : parts + 1]), list(states[parts + 1 :])
    noise = _noise_by_level(usual, median_of(spreads))
    stable = [spread < np.float32(_STABLE) * noise for spread in spreads]
    clean = without_ghosts(epochs, stable, usual, noise)
    total, count = np.zeros_like(clean), np.zeros_like(clean)
    for epoch in epochs:
        agrees = (np.abs(epoch - clean) < np.float32(3.0) * noise).astype(np.float32)
        total += agrees * epoch
        count += agrees
    image = np.where(count > 0, total / np.maximum(count, np.float32(1.0)), clean)
    return Background(image.astype(np.float32), noise)


def _states(frames: list[NDArray[np.uint16]], parts: int) -> list[FloatImage]:
    """What is seen most of the time, and each epoch's median and spread, gray levels."""
    level = np.float32(1.0 / _STEPS)
    middles, spreads = [], []
    for part in np.array_split(np.arange(len(frames)), parts):
        stack = sorted_stack([frames[index] for index in part])
        low, high = stack[(len(part) - 1) // 2], stack[len(part) // 2]
        middles.append((low.astype(np.float32) + high) * (np.float32(0.5) * level))
        quarter = len(part) // 4
        wide = stack[len(part) - 1 - quarter] - stack[quarter]
        spreads.append(wide * (level / np.float32(_quartile_width(len(part)))))
    return [densest(sorted_stack(frames), _DENSEST) * level, *middles, *spreads]


def _fixed_point(frame: NDArray[Any], scale: float) -> NDArray[np.uint16]:
    """Gray levels in whole steps of a 128th, which sort fast."""
    if frame.dtype == np.uint8:
        levels = np.minimum(np.arange(256) * (scale * _STEPS) + 0.5, 65535.0).astype(np.uint16)
        return np.asarray(cv2.LUT(frame, levels))
    steps = frame.astype(np.float32) * np.float32(scale * _STEPS) + np.float32(0.5)
    return np.asarray(np.clip(steps, 0, 65535), dtype=np.uint16)


def _quartile_width(count: int) -> float:
    """Expected distance of the two order statistics used, for unit normal noise."""
    quarter = count // 4
    probability = (count - quarter - 0.375) / (count + 0.25)
    return max(2.0 * float(scipy.special.ndtri(probability)), 0.3)


def _noise_by_level(image: FloatImage, spread: FloatImage) -> FloatImage:
    """Turn each pixel's own spread, which moving things inflate, into a law of brightness."""
    step = max(1, int(np.sqrt(image.size / _LAW_PIXELS)))
    flat, values = image[::step, ::step].ravel(), spread[::step, ::step].ravel()
    edges = np.quantile(flat, np.linspace(0.0, 1.0, _LEVEL_BINS + 1))
    centres, levels = [], []
    for low, high in pairwise(edges):
        inside = (flat >= low) & (flat <= high)
        if np.count_nonzero(inside) >= 30:
            centres.append(0.5 * (low + high))
            levels.append(float(np.median(values[inside])))
    table = np.interp(np.arange(256.0), centres, levels) if centres else np.ones(256)
    law = table.astype(np.float32).take(np.clip(image, 0, 255).astype(np.int32))
    across = cv2.Scharr(image, cv2.CV_32F, 1, 0, scale=1 / 32)
    down = cv2.Scharr(image, cv2.CV_32F, 0, 1, scale=1 / 32)
    unsteady = np.float32(_JITTER_PX**2) * (across * across + down * down)
    return np.asarray(np.sqrt(law * law + np.float32(_NOISE_FLOOR**2) + unsteady))
