"""The static scene: what is seen when nothing moves, its noise, and each frame's brightness."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import scipy.special
from numpy.typing import NDArray

from vision.ghosts import without_ghosts

__all__ = ["Background", "LightMeter", "brightness", "estimate_background"]

FloatImage = NDArray[np.float32]

_LEVEL_BINS = 16
_EPOCHS = 5
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


def estimate_background(frames: list[FloatImage]) -> Background:
    """Estimate the static scene from frames spread over the clip.

    Brightness is equalised first, so that mains flicker does not blur the medians. The clip is cut
    into
    epochs with a median each. A pixel takes what most epochs agree on; where something lay still
    for most
    of the clip, so that they agree on the wrong thing, the epoch without its outline is taken
    (`vision.ghosts`).

    Parameters
    ----------
    frames : list of (H, W) float32 arrays
        Gray levels, 0 to 255, registered on one another, in time order.

    Returns
    -------
    Background
    """
    reference = frames[len(frames) // 2]
    gains = np.array([brightness(frame, reference, 2.0) for frame in frames])
    gains /= np.median(gains)
    even = [frame / np.float32(gain) for frame, gain in zip(frames, gains, strict=True)]
    epochs, spreads = [], []
    for part in np.array_split(np.arange(len(even)), min(_EPOCHS, max(1, len(even) // 3))):
        stack = np.stack([even[index] for index in part])
        stack.sort(axis=0)
        low, high = (len(part) - 1) // 2, len(part) // 2
        epochs.append(0.5 * (stack[low] + stack[high]))
        quarter = len(part) // 4
        factor = np.float32(_quartile_width(len(part)))
        spreads.append((stack[len(part) - 1 - quarter] - stack[quarter]) / factor)
    usual = np.median(np.stack(epochs), axis=0).astype(np.float32)
    noise = _noise_by_level(usual, np.median(np.stack(spreads), axis=0).astype(np.float32))
    clean = without_ghosts(epochs, usual, noise)
    agree = [np.abs(epoch - clean) < 3.0 * noise for epoch in epochs]
    total = sum(np.where(yes, epoch, 0.0) for yes, epoch in zip(agree, epochs, strict=True))
    count = sum(yes.astype(np.float32) for yes in agree)
    image = np.where(count > 0, total / np.maximum(count, 1.0), clean)
    return Background(image.astype(np.float32), noise)


def _quartile_width(count: int) -> float:
    """Expected distance of the two order statistics used, for unit normal noise."""
    quarter = count // 4
    probability = (count - quarter - 0.375) / (count + 0.25)
    return max(2.0 * float(scipy.special.ndtri(probability)), 0.3)


def _noise_by_level(image: FloatImage, spread: FloatImage) -> FloatImage:
    """Turn each pixel's own spread, which moving things inflate, into a law of brightness."""
    flat, values = image.ravel(), spread.ravel()
    edges = np.quantile(flat[::7], np.linspace(0.0, 1.0, _LEVEL_BINS + 1))
    centres, levels = [], []
    for low, high in pairwise(edges):
        inside = (flat >= low) & (flat <= high)
        if np.count_nonzero(inside) >= 30:
            centres.append(0.5 * (low + high))
            levels.append(float(np.median(values[inside])))
    law = np.interp(flat, centres, levels) if centres else np.full(flat.shape, 1.0)
    across = cv2.Scharr(image, cv2.CV_32F, 1, 0, scale=1 / 32)
    steepness = np.hypot(across, cv2.Scharr(image, cv2.CV_32F, 0, 1, scale=1 / 32))
    unsteady = (_JITTER_PX * steepness) ** 2
    noise = np.sqrt(law.reshape(image.shape) ** 2 + _NOISE_FLOOR**2 + unsteady)
    return np.asarray(noise, dtype=np.float32)
