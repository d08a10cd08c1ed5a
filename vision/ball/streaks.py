"""Balls smeared by the exposure, or of a few pixels: a disc swept along a line, fitted to its area.

An outline is sharp where little moved while the shutter was open; of a ball that goes half its
diameter and more in that time two caps are left and a haze between them. What is fitted there is
the whole area,

    I = (1 − w)·B + w·(a + b·x + c·y),

B the known static scene, w the part of the exposure in which a disc that goes along a line covers
the pixel, and a, b, c its light (what shading leaves when it is smeared), eliminated as in
`outline`. Centre, motion and, where wanted, the radius are iterated. The picture is taken at the
coarsest grain that still tells the radius: that is enough for what is smeared over many pixels.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled
from vision.ball.outline import OutlineFits, nothing_found
from vision.scene import FilmedScene, Window

__all__ = ["Sweep", "Swept", "fit_sweep", "swept_outlines"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
IntArray = NDArray[np.int64]

_GRAIN = 8.0
"""px: radius at which a disc is fitted, supposed; a tenth of a pixel of it is a hundredth of the
ball's radius."""
_MARGIN = 0.6
"""Radii beyond the swept disc that are looked at, so that a larger one would be seen."""
_STEPS, _PLAIN_STEPS, _SETTLED = 24, 8, 0.01
"""Steps at most, those among them without outliers, and px of the coarse picture: a shorter one is
the last."""
_DAMPING = (0.0, 0.1, 1.0, 10.0)
"""Shares of the normal matrix' diagonal that are added until a step helps."""
_NUDGE = 0.05
"""px, for derivatives: far below the blur of any edge."""
_SOFT = 1.0
"""px: width over which an edge is taken to run."""
_OUTLYING = 3.0
"""Standard deviations at which a pixel counts a quarter."""
_RADIUS_STD, _CENTRE_STD = 0.15, 0.5
"""Radii: how far off a radius is taken to be, and a centre that was foretold."""
_SECTORS = 8
"""Parts of the picture whose errors are taken to be independent of one another."""


@dataclass(frozen=True)
class Sweep:
    """A disc that goes along a line: centre at mid-exposure (2,), motion (2,) and radius, px."""

    centre: FloatArray
    motion: FloatArray
    radius: float


@dataclass(frozen=True)
class Swept:
    """A fitted disc.

    Attributes
    ----------
    covariance : (2, 2) array
        Of the centre, px².
    explained : float
        Part of what changed there that it explains, 0 to 1.
    """

    sweep: Sweep
    covariance: FloatArray
    explained: float


def fit_sweep(
    picture: FloatImage,
    expected: FloatImage,
    noise: float,
    start: Sweep,
    *,
    free_radius: bool = False,
) -> Swept | None:
    """Fit a swept disc to a small picture.

    Parameters
    ----------
    picture, expected : (H, W) float32 arrays
        A part of a frame, and of the static scene in its brightness, gray levels.
    noise : float
        Standard deviation of a pixel of their difference.
    start : Sweep
        Where to begin, px of that part.
    free_radius : bool
        Whether the radius is fitted, too.

    Returns
    -------
    Swept or None
        None where nothing changed, or the disc leaves the picture.
    """
    grain = max(1, int(start.radius / _GRAIN))
    seen, scene = _coarse(picture, grain), _coarse(expected, grain)
    if min(seen.shape) < 3:
        return None
    half = 0.5 * (grain - 1)
    values = np.array([*(start.centre - half), *start.motion, start.radius]) / grain
    if np.hypot(*values[2:4]) < _SOFT:
        # At rest the derivatives over the motion vanish: it would stay there.
        values[2:4] = _SOFT, 0.0
    fit = _StreakFit(seen, scene, noise / grain, values, free_radius)
    if not fit.run():
        return None
    found = Sweep(fit.values[:2] * grain + half, fit.values[2:4] * grain, fit.values[4] * grain)
    return Swept(found, fit.covariance() * grain**2, fit.explained())


def _coarse(image: FloatImage, grain: int) -> FloatArray:
    if grain == 1:
        return image.astype(np.float64)
    size = (image.shape[1] // grain, image.shape[0] // grain)
    if min(size) == 0:
        return np.zeros((0, 0))
    trimmed = image[: size[1] * grain, : size[0] * grain]
    return cv2.resize(trimmed, size, interpolation=cv2.INTER_AREA).astype(np.float64)


class _StreakFit:
    """One picture; values are x, y, motion x, y and radius, px of the coarse picture."""

    def __init__(
        self, seen: FloatArray, scene: FloatArray, noise: float, values: FloatArray, radius: bool
    ) -> None:
        self._scene = scene.ravel()
        self._change = seen.ravel() - self._scene
        self._noise = max(noise, 0.5)
        self.values, self._start = values.copy(), values.copy()
        self._free = np.array([True, True, True, True, radius])
        held = np.array([_CENTRE_STD, _CENTRE_STD, 2.0, 2.0, _RADIUS_STD]) * values[4]
        self._held = held**-2.0
        self._weight = np.ones_like(self._change)
        self._shape = seen.shape

    def run(self) -> bool:
        """Iterate; whether a disc was found within the picture."""
        if float(np.abs(self._change).max()) < 3.0 * self._noise:
            return False
        left = self._left(self.values)
        for place in range(_STEPS):
            scale = max(1.4826 * float(np.median(np.abs(left))), self._noise)
            if place < _PLAIN_STEPS:
                # From afar nothing is an outlier: what is off says where to go.
                scale = max(scale, float(np.sqrt(np.mean(left * left))))
                self._weight = np.full_like(left, scale**-2.0)
            else:
                self._weight = 1.0 / (1.0 + (left / (_OUTLYING * scale)) ** 2) ** 2 / scale**2
            cost, here = self._cost(self.values)
            normal, pull = self._equations(left)
            for damping in _DAMPING:
                step = self._step(normal, pull, damping)
                tried = self.values + step
                tried[4] = max(tried[4], 1.0)
                found, there = self._cost(tried)
                if found < cost:
                    break
            else:
                if place >= _PLAIN_STEPS:
                    break
                left = here
                continue
            self.values, left = tried, there
            if place >= _PLAIN_STEPS and float(np.abs(step).max()) < _SETTLED:
                break
        inside = (self.values[:2] > -1.0) & (self.values[:2] < np.array(self._shape)[::-1])
        return bool(np.all(inside))

    def explained(self) -> float:
        """Part of the change within the disc's reach that it explains."""
        near = np.empty(self._shape)
        _cover(self.values, _SOFT + 1.0, near)
        there = near.ravel() > 0.0
        left, change = self._left(self.values)[there], self._change[there]
        total = float(change @ change)
        return max(0.0, 1.0 - float(left @ left) / total) if total > 0.0 else 0.0

    def covariance(self) -> FloatArray:
        """Of the centre: each sector's pull as it is, since errors of neighbours are alike."""
        left = self._left(self.values)
        weighted = self._slope() * self._weight[:, None]
        normal, _ = self._equations(left)
        rows, columns = np.indices(self._shape)
        turn = np.arctan2(rows - self.values[1], columns - self.values[0]).ravel()
        sector = ((turn / (2 * np.pi) + 0.5) * _SECTORS).astype(np.int64) % _SECTORS
        pull = np.stack(
            [np.bincount(sector, column * left, _SECTORS) for column in weighted.T],
            axis=1,
        )
        inverse = np.linalg.inv(normal)
        share = _SECTORS / (_SECTORS - 4.0)
        whole = inverse @ (share * pull.T @ pull + normal) @ inverse
        return np.asarray(whole[:2, :2])

    def _cost(self, values: FloatArray) -> tuple[float, FloatArray]:
        """What values cost, and what they leave."""
        left = self._left(values)
        off = (values - self._start)[self._free]
        return float(self._weight @ (left * left) + self._held[self._free] @ (off * off)), left

    def _left(self, values: FloatArray) -> FloatArray:
        """What a disc at values (5,) leaves unexplained (n,), its light eliminated."""
        left = np.empty(self._change.size)
        cover = np.empty(self._shape)
        _cover(values, 0.0, cover)
        _leave(cover.ravel(), self._shape[1], values, self._change, self._scene, self._weight, left)
        return left

    def _slope(self) -> FloatArray:
        """Derivatives of what is left over the free values (n, f)."""
        nudges = _NUDGE * np.eye(5)[self._free]
        columns = [self._left(self.values - off) - self._left(self.values + off) for off in nudges]
        return np.column_stack(columns) / (2.0 * _NUDGE)

    def _equations(self, left: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Normal matrix and pull of the free values."""
        slope = self._slope()
        held = self._held[self._free]
        weighted = slope * self._weight[:, None]
        off = (self.values - self._start)[self._free]
        return weighted.T @ slope + np.diag(held), weighted.T @ left - held * off

    def _step(self, normal: FloatArray, pull: FloatArray, damping: float) -> FloatArray:
        """Damped step (Marquardt 1963), no longer than the radius."""
        step = np.zeros(5)
        step[self._free] = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), pull)
        longest = max(float(np.hypot(step[0], step[1])), 1e-9)
        return np.asarray(step * min(1.0, self.values[4] / longest))


@compiled
def _cover(values: FloatArray, reach: float, cover: FloatArray) -> None:
    """Part of the exposure in which a disc at values (5,) covers each pixel (h, w)."""
    length = math.sqrt(values[2] ** 2 + values[3] ** 2)
    ux, uy = 1.0, 0.0
    if length >= 1e-6:
        ux, uy = values[2] / length, values[3] / length
    wide = math.sqrt(length * length + _SOFT * _SOFT)
    square = (values[4] + reach) ** 2
    for row in range(cover.shape[0]):
        for column in range(cover.shape[1]):
            x, y = column - values[0], row - values[1]
            along, across = x * ux + y * uy, y * ux - x * uy
            total = 0.0
            for place in range(3):
                off = across + 0.5 * (place - 1) * _SOFT
                half = math.sqrt(max(square - off * off, 0.0))
                lap = min(along + 0.5 * wide, half) - max(along - 0.5 * wide, -half)
                total += max(lap, 0.0)
            cover[row, column] = total / (3.0 * wide)


@compiled
def _leave(
    cover: FloatArray,
    width: int,
    values: FloatArray,
    change: FloatArray,
    scene: FloatArray,
    weight: FloatArray,
    left: FloatArray,
) -> None:
    """What a disc that covers pixels so leaves of their change, its light by least squares."""
    normal, pull = np.zeros((3, 3)), np.zeros(3)
    basis, usual = np.empty(3), 0.0
    for place in range(len(cover)):
        usual += weight[place]
        if cover[place] == 0.0:
            continue
        basis[0] = cover[place]
        basis[1] = cover[place] * (place % width - values[0]) / values[4]
        basis[2] = cover[place] * (place // width - values[1]) / values[4]
        target = change[place] + cover[place] * scene[place]
        for i in range(3):
            pull[i] += weight[place] * basis[i] * target
            for j in range(i + 1):
                normal[i, j] += weight[place] * basis[i] * basis[j]
    for i in range(3):
        # Without it a disc that covers nothing has no light at all.
        normal[i, i] += 1e-6 * usual * (1.0 if i == 0 else 30.0)
    for i in range(3):  # Cholesky, and the triangles solved in place
        for j in range(i + 1):
            for k in range(j):
                normal[i, j] -= normal[i, k] * normal[j, k]
            normal[i, j] = math.sqrt(normal[i, i]) if i == j else normal[i, j] / normal[j, j]
        for k in range(i):
            pull[i] -= normal[i, k] * pull[k]
        pull[i] /= normal[i, i]
    for i in range(2, -1, -1):
        for k in range(i + 1, 3):
            pull[i] -= normal[k, i] * pull[k]
        pull[i] /= normal[i, i]
    for place in range(len(cover)):
        x, y = (place % width - values[0]) / values[4], (place // width - values[1]) / values[4]
        light = pull[0] + pull[1] * x + pull[2] * y
        left[place] = change[place] + cover[place] * (scene[place] - light)


def swept_outlines(
    scene: FilmedScene, frame: IntArray, starts: list[Sweep], *, free_radius: bool = False
) -> tuple[OutlineFits, list[Sweep]]:
    """Fit a swept disc in each of several frames.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    frame : (F,) int array
        Frames, increasing.
    starts : list of Sweep
        Where to begin in each, px of the scene.
    free_radius : bool
        Whether radii are fitted.

    Returns
    -------
    OutlineFits
        `contrast` is the part of the change there that the disc explains.
    list of Sweep
        What was fitted; the start where nothing was.
    """
    fits, sweeps = nothing_found(len(frame)), list(starts)
    windows = [_window(start, scene.shape) for start in starts]
    for place, (index, gray) in enumerate(scene.windows(frame, windows)):
        if min(gray.shape) < 4:
            continue
        window = windows[place]
        corner = np.array([window[1].start, window[0].start], dtype=np.float64)
        start = starts[place]
        noise = float(np.median(scene.background.noise[window]))
        inside = Sweep(start.centre - corner, start.motion, start.radius)
        found = fit_sweep(
            gray.astype(np.float32),
            scene.expected(index, window),
            noise,
            inside,
            free_radius=free_radius,
        )
        if found is None:
            continue
        sweep = found.sweep
        sweeps[place] = Sweep(sweep.centre + corner, sweep.motion, sweep.radius)
        fits.found[place] = True
        fits.centre[place] = sweeps[place].centre
        fits.radius[place] = sweep.radius
        fits.covariance[place] = found.covariance
        fits.bound[place] = found.covariance
        fits.rms_residual[place] = 1.0
        fits.contrast[place] = found.explained
    return fits, sweeps


def _window(start: Sweep, shape: tuple[int, int]) -> Window:
    reach = np.abs(0.5 * start.motion) + (1.0 + _MARGIN) * start.radius + 2.0
    low = np.floor(start.centre - reach).astype(int)
    high = np.ceil(start.centre + reach).astype(int) + 1
    limit = np.array([shape[1], shape[0]])
    low, high = np.clip(low, 0, limit), np.clip(high, 0, limit)
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))
