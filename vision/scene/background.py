"""The static scene: what is seen when nothing moves, its noise, and each frame's brightness."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import scipy.special
from numpy.typing import NDArray

from vision.scene.ghosts import without_ghosts
from vision.scene.stack import densest, median_of, sorted_stack

__all__ = ["Background", "LightMeter", "brightness", "estimate_background"]

FloatImage = NDArray[np.float32]

_LEVEL_BINS = 16
_LAW_PIXELS = 60_000
# Fixed-point steps of a gray level.
_STEPS = 128
_EPOCHS = 5
# The static scene is seen in at least this part of the frames, wherever it is seen at all.
_DENSEST = 0.35
# An epoch that scatters by more than this, over noise, shows something that moves.
_STABLE = 3.0
_BAND_PIXELS = 6_000_000
_BRIGHTNESS_PIXELS = 4000
_FEWEST_LIT = 50
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
    the wrong thing, the epoch without its outline is taken (`vision.scene.ghosts`).

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
    gains = scale / (gains / np.median(gains))
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
