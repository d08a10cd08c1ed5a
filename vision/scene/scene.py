"""Footage together with its static scene: differences, expected pictures, each frame's view.

The scene before the strike: with the ball, its shadow and all that leaves with it still there.

Against the scene without the ball, a mass that comes near is one with the shadow of the ball and
with what the ball hides; against the scene before the strike, it is all that differs.

Where the camera looked in each frame, and how bright the light was, from the static scene.

A gain, a shift and a small roll are fitted together by least squares on the pixels where the scene
has structure (Lucas and Kanade 1981); what moves in front is rejected by its residual.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.ball.rest import Rest
from vision.clip.footage import Footage, GrayFrame
from vision.scene.background import Background, LightMeter, estimate_background

__all__ = ["Aligner", "FilmedScene", "Window", "scene_before_strike", "warp_to_scene"]

FloatImage = NDArray[np.float32]

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
    if view.still:
        return frame
    height, width = frame.shape
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpAffine(
        frame,
        view.matrix((height, width)),
        (width, height),
        flags=flags,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(warped, dtype=np.float32)


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
        self._smooth = cv2.GaussianBlur(scene, (0, 0), 1.0)
        self._gx = cv2.Scharr(self._smooth, cv2.CV_32F, 1, 0) / 32.0
        self._gy = cv2.Scharr(self._smooth, cv2.CV_32F, 0, 1) / 32.0
        self._rows, self._columns = _structured_points(np.hypot(self._gx, self._gy))
        height, width = scene.shape
        self._centre = (0.5 * (width - 1), 0.5 * (height - 1))

    def view(self, frame: FloatImage, start: FrameView | None = None) -> FrameView:
        """Register one frame.

        Parameters
        ----------
        frame : (H, W) float32 array
            Gray levels.
        start : FrameView, optional
            A guess, such as the view of the frame before.

        Returns
        -------
        FrameView
        """
        guess = start if start is not None else FrameView(1.0, np.zeros(2), 0.0, 0.0)
        if len(self._rows) < _FEWEST_POINTS:
            # Too small a picture to tell the camera's motion by.
            return guess
        smooth = np.asarray(cv2.GaussianBlur(frame, (0, 0), 1.0), dtype=np.float32)
        found = self._refine(smooth, guess)
        if found[1] > 1.7:
            # On copies: the transform works in place.
            jump, _ = cv2.phaseCorrelate(self._smooth.copy(), smooth.copy())
            again = self._refine(smooth, FrameView(1.0, np.array(jump, dtype=np.float64), 0.0, 0.0))
            # A wall's grid repeats: of two fits about as good, the nearer is right. And what moves
            # may have the strongest edges: the scene is what most of the picture agrees with.
            better = again[1] < 0.7 * found[1] and self._prefer(again[2], found[2])
            found = again if better else found
        return found[0]

    def _refine(self, frame: FloatImage, guess: FrameView) -> tuple[FrameView, float, FloatArray]:
        rows, columns = self._rows, self._columns
        x0, y0 = self._centre
        height, width = frame.shape
        gx, gy = self._gx[rows, columns], self._gy[rows, columns]
        expected = self._smooth[rows, columns]
        design = np.stack(
            [expected, gx, gy, gy * (columns - x0) - gx * (rows - y0)], axis=1
        ).astype(np.float64)
        shift, roll = guess.shift_px.copy(), guess.roll_rad
        gain, scale, std = guess.gain, 1e9, 0.0
        for _ in range(_ITERATIONS):
            x = (columns + shift[0] - roll * (rows - y0)).astype(np.float32)
            y = (rows + shift[1] + roll * (columns - x0)).astype(np.float32)
            inside = (x > 1) & (y > 1) & (x < width - 2) & (y < height - 2)
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
        self.hand_held = wander > _UNSTEADY_PX
        self.background = self._still(samples, rough)
        self.noise = float(np.median(self.background.noise))
        self.views: dict[int, FrameView] = {}
        self._until, self._earlier = 0, self.background
        self._aligner = Aligner(self.background.image, self.noise)
        self._meter = LightMeter(self.background.image, self.noise)

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

    @property
    def count(self) -> int:
        """Number of frames."""
        return self._footage.count

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
        if soonest is not None:
            late = np.cumsum(np.isfinite(seen), axis=0) > soonest
            early = np.nanmedian(np.where(late, np.nan, seen)[:, known], axis=0)
            agree = np.abs(early - middle) < _STEADY * noise[rows[known], columns[known]]
            known[known] = agree
            noise[rows[~known], columns[~known]] = _UNKNOWN
        if since > 0:
            self._until, self._earlier = since, self.background
        self.background = replace(self.background, image=image, noise=noise)

    def _gray(self, frame: GrayFrame) -> FloatImage:
        return np.asarray(frame.astype(np.float32) * self._full_scale)

    def restore(self, background: Background) -> None:
        """Take back what was put into the static scene."""
        self.background, self._until = background, 0

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
        """Give frames as the reference camera would have seen them, 0 to 255."""
        for index, frame in self._footage.frames(wanted):
            yield index, warp_to_scene(self._gray(frame), self.view(index, frame))

    def windows(
        self, wanted: IntArray, windows: list[Window]
    ) -> Iterator[tuple[int, FloatImage | NDArray[np.uint8]]]:
        """Give a window (rows, columns) of each of these frames, 0 to 255."""
        for (index, frame), window in zip(self._footage.frames(wanted), windows, strict=True):
            view = self.view(index, frame)
            if not view.still:
                yield index, warp_to_scene(self._gray(frame), view)[window]
            elif frame.dtype == np.uint8:
                yield index, frame[window].astype(np.uint8, copy=False)
            else:
                yield index, self._gray(frame[window])

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

    def _seen_in(self, index: int) -> Background:
        return self._earlier if index < self._until else self.background

    def difference(self, index: int, picture: FloatImage, window: Window = _WHOLE) -> FloatImage:
        """Picture minus static scene, all of it or a window (rows, columns)."""
        return np.asarray(picture[window] - self.expected(index, window))

    def shifts(self) -> NDArray[np.float64] | None:
        """Shift of the scene in every frame (F, 2), px; None for a camera that stands still."""
        if not self.hand_held:
            return None
        missing = np.setdiff1d(np.arange(self.count), np.array(sorted(self.views), dtype=np.int64))
        for _ in self.pictures(missing):
            pass
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
        picture / np.float32(scene.views[index].gain) for index, picture in scene.pictures(wanted)
    ]
    stack = np.sort(np.stack(even), axis=0)
    middle, still = stack[len(stack) // 2], scene.background.image
    quarter = len(stack) // 4
    noise = scene.background.noise
    steady = stack[-1 - quarter] - stack[quarter] < _STEADY * noise
    return np.where(steady & ~_lingering(stack, still, noise, radius), middle, still)


def _lingering(
    stack: FloatImage, still: FloatImage, noise: FloatImage | float, radius: float
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
