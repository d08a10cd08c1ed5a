"""Footage together with its static scene: differences, expected pictures, each frame's view.

The scene before the strike: with the ball, its shadow and all that leaves with it still there.

Against the scene without the ball, a mass that comes near is one with the shadow of the ball and
with what the ball hides; against the scene before the strike, it is all that differs.

Where the camera looked in each frame, and how bright the light was, from the static scene.

A gain, a shift and a small roll are fitted together by least squares on the pixels where the scene
has structure (Lucas and Kanade 1981); what moves in front is rejected by its residual.

The static scene: what is seen when nothing moves, its noise, and each frame's brightness.

Things that lay still for so long that they look like background, told from what they hid.

A ball that rests for most of the clip is what most frames show at that place. Two states of a
region, with and without the thing, are told apart by the region's own outline: only with the thing
does the picture have a step along it. The same holds for the shadow that left with it.

Pictures sorted pixel by pixel: a network of minima and maxima over whole pictures at a time.
"""

import copy
import itertools
import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, TypeVar

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from vision.clip.footage import Footage, GrayFrame
from vision.tracks import Rest

__all__ = [
    "Aligner",
    "Backdrop",
    "Background",
    "FilmedScene",
    "LightMeter",
    "SceneKnown",
    "Window",
    "brightness",
    "densest",
    "estimate_background",
    "scene_before_strike",
    "sorted_stack",
    "warp_to_scene",
    "without_ghosts",
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
    values = [value for value in np.unique(code).tolist() if _at_one_end(value, len(epochs))]
    for piece in _pieces_of(code, values):
        window = _window(piece.box, usual.shape)
        region = (piece.labels[window] == piece.label).astype(np.uint8)
        others = [epochs[bit][window] for bit in range(len(epochs)) if piece.value >> bit & 1]
        steps = [_step_along(other, region) for other in others]
        best, seen = int(np.argmin(steps)), _step_along(usual[window], region)
        if seen > _LEAST_STEP * least and steps[best] < _SMOOTHER * seen:
            wide = cv2.dilate(region, np.ones((7, 7), np.uint8)) > 0
            clean[window][wide] = others[best][wide]
    return clean


@dataclass(frozen=True)
class _MaybeGhost:
    """Pixels of one value that touch one another, where `labels` is `label`; box as rows, columns.

    Attributes
    ----------
    labels : (H, W) int32 array
    box : (4,) tuple of int
        Top, left, bottom, right.
    """

    value: int
    label: int
    labels: NDArray[np.int32]
    box: tuple[int, int, int, int]

    @property
    def first(self) -> tuple[int, int]:
        """Its first pixel, row by row."""
        row = self.box[0]
        return row, int(np.argmax(self.labels[row] == self.label))


def _pieces_of(code: NDArray[np.uint8], values: list[int]) -> list[_MaybeGhost]:
    """Pieces of these values that are not too small, in the order of their first pixels."""
    found = []
    for value in values:
        alike = (code == value).astype(np.uint8)
        count, labels, boxes, _ = cv2.connectedComponentsWithStats(alike, connectivity=8)
        for label in range(1, count):
            left, top, wide, tall, area = boxes[label].tolist()
            if area >= _SMALLEST:
                box = (top, left, top + tall, left + wide)
                found.append(_MaybeGhost(value, label, np.asarray(labels, np.int32), box))
    return sorted(found, key=lambda piece: piece.first)


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
    begun : (H, W) float32 array or None
        What the clip begins with where nothing moved then, else what most frames show: whole things
        that lay there, where `image` may be a patchwork of them and of what they hid.
    """

    image: FloatImage
    noise: FloatImage
    begun: FloatImage | None = None

    @property
    def at_first(self) -> "Background":
        """The scene as the clip begins."""
        return self if self.begun is None else replace(self, image=self.begun)


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
    the wrong thing, the epoch without its outline is taken (`vision.scene`).

    Parameters
    ----------
    frames : sequence of (H, W) arrays
        Gray levels, registered on one another, in time order.
    scale : float
        Brings them to 0 to 255.
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
    begun = np.where(stable[0], epochs[0], usual)
    return Background(_averaged(clean, epochs, noise), noise, _averaged(begun, epochs, noise))


def _averaged(shown: FloatImage, epochs: list[FloatImage], noise: FloatImage) -> FloatImage:
    """A picture of the scene, with the mean of all epochs that show the same for less noise."""
    total, count = np.zeros_like(shown), np.zeros_like(shown)
    for epoch in epochs:
        agrees = (np.abs(epoch - shown) < np.float32(3.0) * noise).astype(np.float32)
        total += agrees * epoch
        count += agrees
    image = np.where(count > 0, total / np.maximum(count, np.float32(1.0)), shown)
    return image.astype(np.float32)


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


FloatArray = NDArray[np.float64]

_TILES = 12

"""Tiles along each side of the picture from which edges are taken, so that no bright corner
outvotes the rest."""

_POINTS_PER_TILE = 24

"""Points of a tile, the steepest: with twelve by twelve tiles some three thousand, whose mean is
good to a fiftieth of one."""

_ITERATIONS = 6

"""Steps of Gauss-Newton at most: a wander of a pixel settles in three."""

_SPEAKS = 6.0
"""A tile speaks for a fit where its chi-square is lower by three standard deviations: that of a
difference of two squares of unit normals is two."""
_FEWEST_POINTS = 40

"""Points: gain, shift, turn and scale are five unknowns, eight times as many leave room for
outliers."""


@dataclass(frozen=True)
class FrameView:
    """How one frame sees the static scene.

    Attributes
    ----------
    gain : float
        Brightness relative to the scene.
    shift_px : (2,) array
        Where the scene's point (x, y) appears: at (x, y) + shift + roll × (−(y − y₀), x − x₀).
    roll_rad : float
        Roll about the picture's centre.
    shift_std_px : float
        Standard uncertainty of the shift from the picture noise.
    """

    gain: float
    shift_px: FloatArray
    roll_rad: float
    shift_std_px: float

    @property
    def still(self) -> bool:
        """Whether the camera looks exactly as it did at the reference."""
        return self.roll_rad == 0.0 and not np.any(self.shift_px)

    def matrix(self, shape: tuple[int, int]) -> FloatArray:
        """Affine matrix (2, 3) from scene to frame pixels."""
        x0, y0 = 0.5 * (shape[1] - 1), 0.5 * (shape[0] - 1)
        roll = self.roll_rad
        return np.array(
            [
                [1.0, -roll, self.shift_px[0] + roll * y0],
                [roll, 1.0, self.shift_px[1] - roll * x0],
            ]
        )


def warp_to_scene(frame: FloatImage, view: FrameView) -> FloatImage:
    """Resample a frame as the reference camera would have seen it."""
    return frame if view.still else np.asarray(warped(frame, view), dtype=np.float32)


def warped(frame: NDArray[Any], view: FrameView) -> NDArray[Any]:
    """Resample a picture (H, W) or (H, W, 3) as the reference camera would have seen it."""
    height, width = frame.shape[:2]
    return cv2.warpAffine(
        frame,
        view.matrix((height, width)),
        (width, height),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )


def smoothed(frame: FloatImage) -> FloatImage:
    """A picture less the noise that slopes would take for structure."""
    return np.asarray(cv2.GaussianBlur(frame, (0, 0), 1.0), dtype=np.float32)


class Aligner:
    """Registers frames on a picture of the scene.

    Parameters
    ----------
    scene : (H, W) float32 array
        The static scene, or a frame that stands for it.
    noise : float
        Standard deviation of a pixel, gray levels.
    """

    def __init__(self, scene: FloatImage, noise: float) -> None:
        self._scene = scene
        self._noise = noise
        self._smooth = smoothed(scene)
        self._gx = cv2.Scharr(self._smooth, cv2.CV_32F, 1, 0) / 32.0
        self._gy = cv2.Scharr(self._smooth, cv2.CV_32F, 0, 1) / 32.0
        self._rows, self._columns = _structured_points(np.hypot(self._gx, self._gy))
        height, width = scene.shape
        self._centre = (0.5 * (width - 1), 0.5 * (height - 1))
        self._grain = max(1, round(width / _JUMP_WIDTH_PX))
        self._coarse = self._reduced(self._smooth)

    def view(self, frame: FloatImage, start: FrameView | None = None) -> FrameView:
        """Register one frame.

        Parameters
        ----------
        frame : (H, W) float32 array
            Gray levels.
        start : FrameView, optional
            A guess, such as the view of the frame before.
        """
        guess = start if start is not None else FrameView(1.0, np.zeros(2), 0.0, 0.0)
        if len(self._rows) < _FEWEST_POINTS:
            # Too small a picture to tell the camera's motion by.
            return guess
        smooth = smoothed(frame)
        found = self._refine(smooth, guess)
        if found[1] > 1.7:
            # On a copy: the transform works in place.
            jump, _ = cv2.phaseCorrelate(self._coarse.copy(), self._reduced(smooth))
            shift = self._grain * np.array(jump, dtype=np.float64)
            again = self._refine(smooth, FrameView(1.0, shift, 0.0, 0.0))
            # A wall's grid repeats: of two fits about as good, the nearer is right. And what moves
            # may have the strongest edges: the scene is what most of the picture agrees with.
            clearer = again[1] < 0.7 * found[1] and self._prefer(again[2], found[2])
            found = again if clearer else found
        better, worse = _votes(self.gained(smooth, found[0]))
        # along edges of one direction a fit slides from frame to frame
        return found[0] if better >= worse else FrameView(found[0].gain, np.zeros(2), 0.0, 0.0)

    def _reduced(self, smooth: FloatImage) -> FloatImage:
        height, width = smooth.shape[0] // self._grain, smooth.shape[1] // self._grain
        whole = smooth[: height * self._grain, : width * self._grain]
        small = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(small, dtype=np.float32)

    def _refine(self, frame: FloatImage, guess: FrameView) -> tuple[FrameView, float, FloatArray]:
        rows, columns = self._rows, self._columns
        x0, y0 = self._centre
        gx, gy = self._gx[rows, columns], self._gy[rows, columns]
        expected = self._smooth[rows, columns]
        design = np.stack(
            [expected, gx, gy, gy * (columns - x0) - gx * (rows - y0)], axis=1
        ).astype(np.float64)
        shift, roll = guess.shift_px.copy(), guess.roll_rad
        gain, scale, std = guess.gain, 1e9, 0.0
        for _ in range(_ITERATIONS):
            x, y, inside = self._points(FrameView(gain, shift, roll, std), frame.shape)
            if np.count_nonzero(inside) < _FEWEST_POINTS:
                return FrameView(float(gain), shift, float(roll), std), np.inf, np.zeros(0)
            seen = _sampled(frame, x, y)
            residual = (seen - gain * expected).astype(np.float64)
            spread = 1.4826 * float(np.median(np.abs(residual[inside])))
            scale = max(spread, 0.3 * self._noise)
            weight = inside / (1.0 + (residual / (2.0 * scale)) ** 2) ** 2
            weighted = design * weight[:, None]
            normal = weighted.T @ design + np.diag([1e-9, 1e-3, 1e-3, 1e-3])
            step = np.linalg.solve(normal, weighted.T @ residual)
            gain += step[0]
            delta = -step[1:3] / max(gain, 0.05)
            shift += np.clip(delta, -1.5, 1.5)
            roll -= float(np.clip(step[3] / max(gain, 0.05), -0.01, 0.01))
            inverse = np.linalg.inv(normal)
            std = float(scale * np.sqrt(max(inverse[1, 1] + inverse[2, 2], 0.0) / 2))
            if np.hypot(*delta) < 2e-3:
                break
        # The median alone would be content with half of the scene's lines matching.
        quality = float(np.quantile(np.abs(residual[inside]), 0.8)) / (1.28 * self._noise)
        off = np.where(inside, residual / self._noise, np.nan)
        return FrameView(float(gain), shift, float(roll), std), quality, off

    def _points(
        self, view: FrameView, shape: tuple[int, ...]
    ) -> tuple[FloatImage, FloatImage, NDArray[np.bool_]]:
        """Where the scene's points are in a frame (P,), and which of them it shows."""
        x0, y0 = self._centre
        shift, roll = view.shift_px, view.roll_rad
        x = (self._columns + shift[0] - roll * (self._rows - y0)).astype(np.float32)
        y = (self._rows + shift[1] + roll * (self._columns - x0)).astype(np.float32)
        return x, y, (x > 1) & (y > 1) & (x < shape[1] - 2) & (y < shape[0] - 2)

    def halves(self) -> tuple["Aligner", "Aligner"]:
        """Two that register on every other tile each, like the fields of a chessboard."""
        tile = np.arange(len(self._rows)) // _POINTS_PER_TILE
        return self._on((tile // _TILES + tile) % 2 == 0), self._on(
            (tile // _TILES + tile) % 2 == 1
        )

    def _on(self, kept: NDArray[np.bool_]) -> "Aligner":
        other = copy.copy(self)
        other._rows, other._columns = self._rows[kept], self._columns[kept]
        return other

    def gained(self, smooth: FloatImage, view: FrameView) -> FloatArray:
        """Mean chi-square by which each tile (T,) of a smoothed frame agrees better with a view.

        Of each tile the light is its own, so that a change of light, slow over the picture, speaks
        neither for a shift nor against it.
        """
        still = FrameView(view.gain, np.zeros(2), 0.0, 0.0)
        known, left = np.ones(len(self._rows), dtype=bool), []
        for one in (still, view):
            x, y, inside = self._points(one, smooth.shape)
            known &= inside
            off = _sampled(smooth, x, y) - one.gain * self._smooth[self._rows, self._columns]
            off = off.reshape(-1, _POINTS_PER_TILE) / self._noise
            off = off - np.median(off, axis=1, keepdims=True)
            left.append(np.minimum(off**2, _SPEAKS**2))
        counted = known.reshape(-1, _POINTS_PER_TILE)
        gain = np.where(counted, left[0] - left[1], 0.0).sum(axis=1)
        return np.asarray(gain / np.maximum(counted.sum(axis=1), 1))

    def _prefer(self, one: FloatArray, other: FloatArray) -> bool:
        """Whether more tiles of the picture speak for one fit than for another.

        Both are residuals (P,) over the noise, NaN outside the frame, or empty where there is none.
        """
        if not (one.size and other.size):
            return bool(one.size)
        gain = (other**2 - one**2).reshape(-1, _POINTS_PER_TILE)
        known = np.isfinite(gain)
        spread = _SPEAKS * np.sqrt(np.maximum(known.sum(axis=1), 1))
        for_one = np.where(known, gain, 0.0).sum(axis=1)
        return int(np.sum(for_one > spread)) > int(np.sum(for_one < -spread))


_SPEAKS_FOR = 0.5
"""Chi-square a point by which a tile speaks for a shift or against it. Derived: 24 points scatter
by less."""


def _votes(gains: FloatArray) -> tuple[int, int]:
    """How many tiles speak for a shift, and how many against it."""
    return int(np.sum(gains > _SPEAKS_FOR)), int(np.sum(gains < -_SPEAKS_FOR))


_JUMP_WIDTH_PX = 320
"""Width at which a camera's jump is looked for. Derived: it is found to a tenth of a pixel there,
and a fit at full size goes on from there."""


def _sampled(frame: FloatImage, x: FloatImage, y: FloatImage) -> FloatImage:
    """The frame at scattered points."""
    return np.asarray(
        cv2.remap(frame, x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0],
        dtype=np.float32,
    )


def _structured_points(
    gradient: FloatImage,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pick the steepest pixels of each tile of the picture."""
    height, width = gradient.shape
    rows, columns = [], []
    row_edges = np.linspace(3, height - 3, _TILES + 1).astype(int)
    column_edges = np.linspace(3, width - 3, _TILES + 1).astype(int)
    for top, bottom in pairwise(row_edges):
        for left, right in pairwise(column_edges):
            tile = gradient[top:bottom, left:right]
            if tile.size < _POINTS_PER_TILE:
                continue
            steepest = np.argpartition(tile.ravel(), -_POINTS_PER_TILE)[-_POINTS_PER_TILE:]
            rows.append(top + steepest // tile.shape[1])
            columns.append(left + steepest % tile.shape[1])
    nowhere = np.zeros(0, dtype=np.int64)
    return np.concatenate([nowhere, *rows]), np.concatenate([nowhere, *columns])


IntArray = NDArray[np.int64]

Window = tuple[slice, slice]

_WHOLE: Window = (slice(None), slice(None))

_SAMPLES = 45

"""Frames from which the background is made: a ball or mass that covers a pixel in fewer than half
leaves the median alone."""

# Of these, every so many tell whether the camera moves.
_TRIAL_STEP = 2

# A camera whose pictures wander by less than this (95th percentile) stands on a tripod; codecs do
# as much.
_UNSTEADY_PX = 0.25

"""px: a camera whose pictures wander by less than this (95th percentile) stands on a tripod, since
codecs do as much."""

_UNKNOWN = np.float32(255.0)
"""Gray levels, noise of a scene that was never seen: full scale."""

_FEWEST_UNCOVERED = 3

"""Frames: a median of fewer does not leave out one that is wrong."""


_CERTAIN = 3.0
"""Standard deviations of a sign test. Convention."""


def _moves(aligner: Aligner, frames: Iterable[FloatImage]) -> bool:
    """Whether a shift by one half of the picture makes the other half agree better.

    Along edges of one direction, and where the light changes, each half finds a shift of its own.
    """
    one, other = aligner.halves()
    gains = [
        far.gained(smoothed(frame), near.view(frame))
        for frame in frames
        for near, far in ((one, other), (other, one))
    ]
    better, worse = _votes(np.concatenate(gains))
    return better - worse > _CERTAIN * math.sqrt(better + worse)


@dataclass(frozen=True)
class SceneKnown:
    """What is known of a static scene.

    Attributes
    ----------
    image, earlier : Background
        From a frame on, and before it.
    until : int
        That frame.
    """

    image: Background
    earlier: Background
    until: int

    @property
    def throughout(self) -> "SceneKnown":
        """The same from the first frame on: what lay in the scene stands before it from there."""
        return replace(self, until=0)


_UPRIGHT_VIEW = FrameView(1.0, np.zeros(2), 0.0, 0.0)
"""Of a frame that sees the scene as it is."""


class FilmedScene:
    """A clip's frames seen against the static scene.

    All positions are those of the scene: frames of a hand-held camera are resampled onto it.

    Parameters
    ----------
    footage : Footage
        The frames.

    Attributes
    ----------
    background : Background
        The static scene.
    views : dict of int to FrameView
        How each frame looked at so far sees it.
    hand_held : bool
        Whether the camera moves.
    """

    def __init__(self, footage: Footage) -> None:
        self._footage = footage
        self._full_scale = np.float32(255.0 / footage.full_scale)
        samples = footage.spread_sample(_SAMPLES)
        rough = Aligner(self._gray(samples[len(samples) // 2]), 2.0)
        trial = [rough.view(self._gray(sample)) for sample in samples[::_TRIAL_STEP]]
        shifts = np.array([view.shift_px for view in trial])
        shifts -= np.median(shifts, axis=0)
        wander = float(np.percentile(np.hypot(shifts[:, 0], shifts[:, 1]), 95))
        self.hand_held = wander > _UNSTEADY_PX and _moves(rough, map(self._gray, samples))
        self.background = self._still(samples, rough)
        self.noise = float(np.median(self.background.noise))
        self.views: dict[int, FrameView] = {}
        self._small: tuple[tuple[int, int], dict[int, NDArray[np.uint8]]] = ((0, 0), {})
        self._until, self._earlier = 0, self.background
        self._first = self.background
        self._aligner = Aligner(self.background.image, self.noise)
        self._meter = LightMeter(self.background.image, self.noise)
        if self.hand_held:
            self._register()

    def anew(self) -> "FilmedScene":
        """The same scene, of which more can be uncovered; frames are registered once for both."""
        return copy.copy(self)

    def tinted(self, blueness: float, redness: float) -> "FilmedScene":
        """The same scene in one colour: see `Footage.tinted`.

        Frames are registered as they are in gray, and their light is taken to be steady: a colour
        difference hardly changes with it.
        """
        other = copy.copy(self)
        shifts = self.shifts()
        other.views = {
            index: replace(self.views[index], gain=1.0)
            if shifts is not None
            else FrameView(1.0, np.zeros(2), 0.0, 0.0)
            for index in range(self.count)
        }
        other._footage = self._footage.tinted(blueness, redness)
        other._full_scale = np.float32(1.0)
        wanted = other._footage.spread_index(_SAMPLES)
        other.background = estimate_background([picture for _, picture in other.pictures(wanted)])
        other.noise = float(np.median(other.background.noise))
        other._until, other._earlier = 0, other.background
        return other

    def as_it_began(self) -> "FilmedScene | None":
        """The same frames against the scene as the clip begins; None where it is much the same."""
        known = self._first
        apart = np.abs(known.at_first.image - known.image) > _DIFFERENT * known.noise
        apart = cv2.morphologyEx(apart.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        if not apart.any():
            return None
        other = copy.copy(self)
        other.background = known.at_first
        other._until, other._earlier = 0, other.background
        return other

    def coloured(self, wanted: IntArray) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """Give frames (H, W, 3), blue first, as the reference camera would have seen them."""
        for (index, gray), (_, image) in zip(
            self._footage.frames(wanted), self._footage.coloured(wanted), strict=True
        ):
            view = self.view(index, gray)
            yield index, image if view.still else warped(image, view)

    def coloured_small(
        self, wanted: IntArray, size: tuple[int, int]
    ) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """The same reduced to a width and height; those of the last size asked for are kept."""
        if self._small[0] != size:
            self._small = size, {}
        kept = self._small[1]
        new = wanted[[index not in kept for index in wanted.tolist()]]
        for index, image in self.coloured(new):
            kept[index] = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
        yield from ((index, kept[index]) for index in wanted.tolist())

    def _still(self, samples: list[GrayFrame], rough: Aligner) -> Background:
        if not self.hand_held:
            return estimate_background(samples, float(self._full_scale))
        grays = [self._gray(sample) for sample in samples]
        views = [rough.view(gray) for gray in grays]
        # The scene is where the camera looks on average, not where it looked in one frame.
        usual = np.median([view.shift_px for view in views], axis=0)
        centred = [replace(view, shift_px=view.shift_px - usual) for view in views]
        return estimate_background(
            [warp_to_scene(gray, view) for gray, view in zip(grays, centred, strict=True)]
        )

    def _register(self) -> None:
        """Register all frames of a moving camera, each from the view of the frame before."""
        for index, frame in self._frames(np.arange(self.count)):
            if frame is None:
                self.views[index] = self.views.get(index - 1, _UPRIGHT_VIEW)
            else:
                self.view(index, frame)

    @property
    def count(self) -> int:
        """Number of frames."""
        return self._footage.count

    @property
    def held(self) -> IntArray:
        """Frames that the file holds."""
        return np.asarray(self._footage.shown)

    def shown(self, wanted: IntArray) -> IntArray:
        """Those of some frames that the file holds."""
        return wanted[[not self._footage.missing(index) for index in wanted.tolist()]]

    def spread(self, count: int) -> IntArray:
        """So many frames spread evenly over what moves."""
        return self._footage.spread(count)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        return self._footage.shape

    def uncover(
        self,
        frames: IntArray,
        hidden: list[NDArray[np.bool_]],
        where: FloatImage,
        soonest: int | None = None,
        since: int = 0,
    ) -> None:
        """Put into the static scene what is seen in some frames where a thing stood in it.

        Parameters
        ----------
        frames : (n,) int array
            Frames, increasing, in which the thing is not there.
        hidden : list of (H, W) bool arrays
            For each, what else stands before the scene.
        where : (H, W) float32 array
            1 where the scene is to be replaced, fading to 0.
        soonest : int, optional
            So many frames of each pixel, those in which it is uncovered first, must agree with all:
            something else may come into the place of what left. Where they do not, and where too
            few show it, the scene is not known and its noise is full scale.
        since : int
            Frame from which on the scene is another: what lay there may be part of it before.
        """
        rows, columns = np.nonzero(where > 0)
        seen = np.full((len(frames), len(rows)), np.nan, dtype=np.float32)
        for place, (index, picture) in enumerate(self.pictures(frames)):
            free = ~hidden[place][rows, columns]
            gain = np.float32(self.views[index].gain)
            seen[place, free] = picture[rows[free], columns[free]] / gain
        known = np.count_nonzero(np.isfinite(seen), axis=0) >= min(_FEWEST_UNCOVERED, len(frames))
        image, noise = self.background.image.copy(), self.background.noise.copy()
        if known.any():
            share = where[rows, columns][known]
            middle = np.nanmedian(seen[:, known], axis=0)
            old = image[rows[known], columns[known]]
            image[rows[known], columns[known]] = share * middle + (1 - share) * old
        if soonest is not None and known.any():
            late = np.cumsum(np.isfinite(seen), axis=0) > soonest
            early = np.nanmedian(np.where(late, np.nan, seen)[:, known], axis=0)
            agree = np.abs(early - middle) < _STEADY * noise[rows[known], columns[known]]
            known[known] = agree
        if soonest is not None:
            noise[rows[~known], columns[~known]] = _UNKNOWN
        if since > 0:
            self._until, self._earlier = since, self.background
        self.background = replace(self.background, image=image, noise=noise)

    def _gray(self, frame: GrayFrame) -> FloatImage:
        gray = frame.astype(np.float32)
        if self._full_scale != 1.0:
            gray *= self._full_scale
        return gray

    @property
    def known(self) -> "SceneKnown":
        """What is known of the static scene."""
        return SceneKnown(self.background, self._earlier, self._until)

    def restore(self, known: "SceneKnown") -> None:
        """Take back what was put into the static scene since then."""
        self.background, self._earlier, self._until = known.image, known.earlier, known.until

    def view(self, index: int, frame: GrayFrame) -> FrameView:
        """How a frame, as it was stored, sees the scene; registered once."""
        known = self.views.get(index)
        if known is None:
            if self.hand_held:
                known = self._aligner.view(self._gray(frame), self.views.get(index - 1))
            else:
                gain = self._meter.gain(frame, float(self._full_scale))
                known = FrameView(gain, np.zeros(2), 0.0, 0.0)
            self.views[index] = known
        return known

    def pictures(self, wanted: IntArray) -> Iterator[tuple[int, FloatImage]]:
        """Give frames as the reference camera would have seen them, 0 to 255.

        One that is missing from the file shows nothing but the static scene.
        """
        for index, frame in self._frames(wanted):
            if frame is None:
                yield index, self._unseen(index, _WHOLE)
            else:
                yield index, warp_to_scene(self._gray(frame), self.view(index, frame))

    def _frames(self, wanted: IntArray) -> Iterator[tuple[int, GrayFrame | None]]:
        held = self._footage.frames(wanted)
        for index in wanted.tolist():
            yield index, None if self._footage.missing(index) else next(held)[1]

    def _unseen(self, index: int, window: Window) -> FloatImage:
        """A window of a frame that is missing from the file: the static scene with its noise."""
        self.views.setdefault(index, self.views.get(index - 1, _UPRIGHT_VIEW))
        still = self.expected(index, window)
        noise = np.random.default_rng(index).normal(size=still.shape).astype(np.float32)
        return np.clip(still + self.usual_noise[window] * noise, 0.0, 255.0)

    def windows(
        self, wanted: IntArray, windows: list[Window]
    ) -> Iterator[tuple[int, FloatImage | NDArray[np.uint8]]]:
        """Give a window (rows, columns) of each of these frames, 0 to 255."""
        for (index, frame), window in zip(self._frames(wanted), windows, strict=True):
            if frame is None:
                yield index, self._unseen(index, window)
                continue
            view = self.view(index, frame)
            if not view.still:
                yield index, self._warped_window(frame, view, window)
            elif frame.dtype == np.uint8:
                yield index, frame[window].astype(np.uint8, copy=False)
            else:
                yield index, self._gray(frame[window])

    def _warped_window(self, frame: GrayFrame, view: FrameView, window: Window) -> FloatImage:
        """A window as the reference camera would have seen it, from the pixels that it needs."""
        (top, bottom), (left, right) = ((part.start, part.stop) for part in window)
        if bottom <= top or right <= left:
            return np.zeros((max(bottom - top, 0), max(right - left, 0)), dtype=np.float32)
        matrix = view.matrix(self.shape)
        corners = np.array([[left, top, 1], [right, top, 1], [left, bottom, 1], [right, bottom, 1]])
        reached = corners @ matrix.T
        limit = np.array(frame.shape[1::-1]) - 1
        first = np.clip(np.floor(reached.min(axis=0)).astype(int) - 1, 0, limit)
        last = np.clip(np.ceil(reached.max(axis=0)).astype(int) + 1, 0, limit)
        needed = self._gray(frame[first[1] : last[1] + 1, first[0] : last[0] + 1])
        matrix[:, 2] += matrix[:, :2] @ [left, top] - first
        return np.asarray(
            cv2.warpAffine(
                needed,
                matrix,
                (right - left, bottom - top),
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_REPLICATE,
            ),
            dtype=np.float32,
        )

    def picture(self, index: int) -> FloatImage:
        """One such frame."""
        return next(self.pictures(np.array([index])))[1]

    def expected(self, index: int, window: Window = _WHOLE) -> FloatImage:
        """The static scene in this frame's brightness, all of it or a window (rows, columns)."""
        image = self._seen_in(index).image[window]
        return np.asarray(image * np.float32(self.views[index].gain))

    def noise_in(self, index: int, window: Window = _WHOLE) -> FloatImage:
        """Standard deviation of a frame's pixels about the static scene, gray levels."""
        return self._seen_in(index).noise[window]

    @property
    def usual_noise(self) -> FloatImage:
        """Standard deviation of a frame's pixels about other frames, gray levels.

        Where the static scene was never seen frames are as steady as elsewhere.
        """
        noise = self.background.noise
        return np.where(noise < _UNKNOWN, noise, np.float32(self.noise))

    def _seen_in(self, index: int) -> Background:
        return self._earlier if index < self._until else self.background

    def difference(self, index: int, picture: FloatImage, window: Window = _WHOLE) -> FloatImage:
        """Picture minus static scene, all of it or a window (rows, columns)."""
        return np.asarray(picture[window] - self.expected(index, window))

    def shifts(self) -> NDArray[np.float64] | None:
        """Shift of the scene in every frame (F, 2), px; None for a camera that stands still."""
        if not self.hand_held:
            return None
        return np.array([self.views[index].shift_px for index in range(self.count)])


_STILL_SAMPLES = 15

"""Frames of the ball at rest that are averaged: noise falls to a quarter."""

_LEAST_FRAMES = 9

"""Frames of rest: fewer than two for each of four quarters tell nothing of what moves."""

_STEADY = 3.0

"""Standard deviations of noise: one pixel in 370 differs by more without anything moving."""

# Frames, of those sampled, in which a pixel may differ by accident.
_STRAY = 1

_CLOSED = 0.5


def scene_before_strike(scene: FilmedScene, rest: Rest, radius: float) -> FloatImage:
    """Median of the frames in which the ball lies still.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    rest : Rest
        The ball before it is struck.
    radius : float
        Ball radius, px.

    Returns
    -------
    (H, W) float32 array
        In reference brightness. Where the frames do not agree with one another, because something
        lingers there for part of the time, the static scene.
    """
    if rest.last - rest.first < _LEAST_FRAMES:
        return scene.background.image
    wanted = np.unique(np.linspace(rest.first, rest.last, _STILL_SAMPLES).astype(np.int64))
    even = [
        picture / np.float32(scene.views[index].gain)
        for index, picture in scene.pictures(scene.shown(wanted))
    ]
    stack = sorted_stack(even)
    middle, still = stack[len(stack) // 2], scene.background.image
    quarter = len(stack) // 4
    noise = scene.background.noise
    steady = stack[-1 - quarter] - stack[quarter] < _STEADY * noise
    return np.where(steady & ~_lingering(stack, still, noise, radius), middle, still)


def _lingering(
    stack: list[FloatImage], still: FloatImage, noise: FloatImage | float, radius: float
) -> NDArray[np.bool_]:
    """Where a thing stands for most of the time that uncovers the static scene for the rest.

    A thick, slow mass may leave the middle of its way to the ball uncovered in no frame at all.
    """
    low, high = stack[_STRAY], stack[-1 - _STRAY]
    uncovered = np.minimum(np.abs(low - still), np.abs(high - still)) < _STEADY * noise
    other = np.abs(stack[len(stack) // 2] - still) > _STEADY * noise
    gone = (uncovered & other & (high - low > 2.0 * _STEADY * noise)).astype(np.uint8)
    gone = cv2.morphologyEx(gone, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    size = 2 * int(_CLOSED * radius) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.asarray((cv2.morphologyEx(gone, cv2.MORPH_CLOSE, kernel) > 0) & other)


_LIGHT_PX = 12.0
"""px, of the ball's radius in the small picture in which light is told: light that lamps throw is
even over so few, and a median over that many pixels is cheap."""

_LIT_SIGMA = 2.0
"""px of that picture over which the light found is smoothed, supposed."""

_LEVELS = 100.0
"""Steps of the ratio of light by which a median is taken: 1 %, about the noise of a pixel."""

_DARKEST_SCENE = 4.0
"""Gray levels: darker parts of a scene tell no ratio."""

_LIGHTS, _MAX_LIT_BYTES = 96, 64_000_000
"""Frames whose light is kept, a byte a pixel at most: those about a strike are looked at again and
again; and bytes of scenes lit by it, of all backdrops together (chosen)."""


class _LitScenes:
    """Scenes in the light of frames, those used last."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[int, int], FloatImage] = OrderedDict()
        self._using = threading.Lock()

    def of(self, key: tuple[int, int], make: Callable[[], FloatImage]) -> FloatImage:
        """The one of a backdrop and a frame, made unless it is kept."""
        with self._using:
            known = self._kept.pop(key, None)
        lit = make() if known is None else known
        with self._using:
            self._kept[key] = lit
            while len(self._kept) > max(1, _MAX_LIT_BYTES // lit.nbytes):
                self._kept.popitem(last=False)
        return lit


_LIT_SCENES, _BACKDROPS = _LitScenes(), itertools.count()


class Backdrop:
    """What lies behind a body that moves before the scene.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    image : (H, W) float32 array
        The scene without the body, in reference brightness.
    radius : float
        Ball radius, px.
    relit : bool
        Whether it is seen in each frame's own light: shadows of things out of view sweep over it.
    """

    def __init__(
        self, scene: FilmedScene, image: FloatImage, radius: float, *, relit: bool = False
    ) -> None:
        self._scene, self._image, self._radius, self.relit = scene, image, radius, relit
        self._number = next(_BACKDROPS)
        self._light = lru_cache(_LIGHTS)(self._light_in)

    def in_frame(self, index: int) -> FloatImage:
        """What lies behind in a frame, in reference brightness (H, W)."""
        if not self.relit:
            return self._image
        key = self._number, index
        return _LIT_SCENES.of(key, lambda: _lit_by(self._light(index), self._image))

    def _light_in(self, index: int) -> NDArray[np.uint8]:
        even = self._scene.picture(index) / np.float32(self._scene.views[index].gain)
        return _light_of(even, self._image, self._radius)


def _light_of(picture: FloatImage, image: FloatImage, radius: float) -> NDArray[np.uint8]:
    """The light of a picture over that of a scene, in a smaller picture of so many steps.

    Parameters
    ----------
    picture, image : (H, W) float32 arrays
        The picture, and the scene in another light.
    radius : float
        px: what covers less than half of the square about a disc of this radius is no light.

    Returns
    -------
    (h, w) uint8 array
    """
    share = min(1.0, _LIGHT_PX / radius)
    ratio = np.clip(picture / np.maximum(image, _DARKEST_SCENE), 0.0, 255.0 / _LEVELS)
    small = cv2.resize(ratio, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
    size = 2 * max(1, round(share * radius)) + 1
    return np.asarray(cv2.medianBlur(np.rint(small * _LEVELS).astype(np.uint8), size))


def _lit_by(light: NDArray[np.uint8], image: FloatImage) -> FloatImage:
    """A scene (H, W) in a light (h, w) of so many steps, smoothly."""
    smooth = cv2.GaussianBlur(light.astype(np.float32) / _LEVELS, (0, 0), _LIT_SIGMA)
    height, width = image.shape
    return np.asarray(image * cv2.resize(smooth, (width, height), interpolation=cv2.INTER_LINEAR))
