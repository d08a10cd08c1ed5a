"""A rigid thing followed by its look: a patch registered against the known background.

The patch is a layer: its look T and its opacity α in the patch's own coordinates. A frame shows
α·T + (1 − α)·B where the patch lies; B is the known background there, so that grid lines sliding by
behind its edge pull nothing. Shift and turn are fitted by Gauss–Newton on this difference.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Patch", "Pose", "register", "sampled", "warped"]

FloatImage = NDArray[np.float32]
FloatArray = NDArray[np.float64]

# Neighbouring residuals share interpolation and coding errors; so many pixels count as one.
_CORRELATED_PIXELS = 4.0
_SLOPE = np.array([-0.5, 0.0, 0.5])
_FLAT = np.array([0.25, 0.5, 0.25])
_LEAST_SEEN = 0.33
_ROW = 16384
# How far a patch may move while it is registered, px.
_REACH = 12
_SHORT = 4e-3
_SHORTISH = 5e-2
_MOST_SHARE = 0.7


@dataclass(frozen=True)
class Patch:
    """The look of a rigid thing.

    Attributes
    ----------
    x, y : (n,) arrays
        Patch coordinates about its anchor, px.
    look : (n,) array
        Gray level of the thing, in reference brightness.
    opacity : (n,) array
        0 where the background is seen, 1 where the thing is.
    """

    x: FloatArray
    y: FloatArray
    look: FloatArray
    opacity: FloatArray


@dataclass(frozen=True)
class Pose:
    """Where the patch lies in a frame.

    Attributes
    ----------
    anchor : (2,) array
        Where its anchor is, px.
    turn : float
        Turn in the picture, rad, from +x towards +y.
    covariance : (3, 3) array
        Of anchor x, y (px) and turn (rad).
    misfit : float
        Root mean square residual over noise.
    seen : float
        Part of the opaque patch in view and not hidden, 0 to 1.
    """

    anchor: FloatArray
    turn: float
    covariance: FloatArray
    misfit: float
    seen: float


def sampled(
    pictures: FloatImage, x: NDArray[Any], y: NDArray[Any], interpolation: int = cv2.INTER_CUBIC
) -> FloatImage:
    """Gray levels of a picture (H, W) or several (H, W, C) at points (n,): (n,) or (n, C).

    OpenCV takes fewer than 32768 points in a row: they are laid out in several.
    """
    count = len(x)
    rows = max(1, -(-count // _ROW))
    maps = np.zeros((2, rows * _ROW if rows > 1 else count), dtype=np.float32)
    maps[0, :count], maps[1, :count] = x, y
    u, v = maps.reshape(2, rows, -1)
    found = cv2.remap(pictures, u, v, interpolation, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found.reshape(-1, *found.shape[2:])[:count])


def warped(patch: Patch, anchor: FloatArray, turn: float) -> tuple[FloatArray, FloatArray]:
    """Picture coordinates of the patch's points."""
    cosine, sine = np.cos(turn), np.sin(turn)
    return (
        anchor[0] + cosine * patch.x - sine * patch.y,
        anchor[1] + sine * patch.x + cosine * patch.y,
    )


def register(
    patch: Patch,
    frame: FloatImage,
    background: FloatImage,
    gain: float,
    noise: float,
    start: Pose,
    *,
    turn_std: float,
    hidden: tuple[float, float, float] | None = None,
    hold: FloatArray | None = None,
    iterations: int = 12,
) -> Pose | None:
    """Find the patch in a frame.

    Parameters
    ----------
    patch : Patch
        What to look for.
    frame, background : (H, W) float32 arrays
        The frame, and the static scene in reference brightness.
    gain : float
        Brightness of the frame relative to the scene.
    noise : float
        Standard deviation of a pixel, gray levels.
    start : Pose
        First guess.
    turn_std : float
        How well the guess's turn is known, rad; the fit is held to it that much.
    hidden : tuple of float, optional
        Centre x, y and radius of a disc in which something else may be in front, px.
    hold : (2, 2) array, optional
        Information (1/px²) by which the anchor is held to the guess: across a known arc, say.
    iterations : int
        Steps at most.

    Returns
    -------
    Pose or None
        None where less than a third of it is in view.
    """
    known = _Known(start, turn_std, np.zeros((2, 2)) if hold is None else hold)
    fit = _Registration(patch, frame, background, gain, noise, known, hidden)
    for _ in range(iterations):
        if fit.seen < _LEAST_SEEN:
            return None
        if fit.advance():
            break
    return fit.pose()


@dataclass(frozen=True)
class _Known:
    """What is known of a pose beforehand."""

    pose: Pose
    turn_std: float
    hold: FloatArray


class _Registration:
    """Gauss–Newton on one patch in one frame."""

    def __init__(
        self,
        patch: Patch,
        frame: FloatImage,
        background: FloatImage,
        gain: float,
        noise: float,
        known: _Known,
        hidden: tuple[float, float, float] | None,
    ) -> None:
        self._patch, self._noise, self._hidden = patch, noise, hidden
        self._anchor, self._turn = known.pose.anchor.copy(), known.pose.turn
        self._known = known
        self._shape = frame.shape
        self._x, self._y = patch.x.astype(np.float32), patch.y.astype(np.float32)
        self._opacity = patch.opacity.astype(np.float32)
        self._opaque = float(patch.opacity.sum())
        self._whole = (patch.look * gain).astype(np.float32)
        self._look = self._opacity * self._whole
        self._clear = (np.float32(1.0) - self._opacity) * np.float32(gain)
        self._step = np.zeros(3)
        self._lengths = (np.inf, np.inf)
        self._steps = 0
        self._cut_out(frame, background)
        self._place()

    def _cut_out(self, frame: FloatImage, background: FloatImage) -> None:
        """Both pictures with their gradients, as far as the patch may come."""
        x, y = warped(self._patch, self._anchor, self._turn)
        height, width = self._shape
        self._left, self._top = max(0, int(x.min()) - _REACH), max(0, int(y.min()) - _REACH)
        right = max(min(width, int(x.max()) + _REACH + 2), self._left + 1)
        bottom = max(min(height, int(y.max()) + _REACH + 2), self._top + 1)
        window = (slice(self._top, bottom), slice(self._left, right))
        self._frame, self._scene = _with_gradient(frame[window]), _with_gradient(background[window])

    def _place(self) -> None:
        """Where the patch's points lie now, and which of them count."""
        cosine, sine = np.float32(np.cos(self._turn)), np.float32(np.sin(self._turn))
        self._ax = -sine * self._x - cosine * self._y
        self._ay = cosine * self._x - sine * self._y
        x = self._ay + np.float32(self._anchor[0])
        y = np.float32(self._anchor[1]) - self._ax
        height, width = self._shape
        inside = (x > 1) & (y > 1) & (x < width - 2) & (y < height - 2)
        if self._hidden is not None:
            dx, dy = x - np.float32(self._hidden[0]), y - np.float32(self._hidden[1])
            inside &= dx * dx + dy * dy > np.float32(self._hidden[2] ** 2)
        self._inside = inside
        self._u, self._v = x - np.float32(self._left), y - np.float32(self._top)
        self.seen = float(np.dot(self._opacity, inside)) / self._opaque

    def _sampled(self) -> tuple[FloatImage, FloatImage]:
        """Frame and uncovered scene with their slopes at the points, (n, 3) each."""
        return self._at_points(self._frame), self._clear[:, None] * self._at_points(self._scene)

    def _at_points(self, pictures: FloatImage) -> FloatImage:
        # Smooth slopes are less led astray by what the patch does not describe.
        seen = sampled(pictures, self._u, self._v, cv2.INTER_LINEAR)
        seen[:, 0] = sampled(np.ascontiguousarray(pictures[:, :, 0]), self._u, self._v)
        return seen

    def advance(self) -> bool:
        """One step; returns whether it was the last."""
        frame, scene = self._sampled()
        # The light on the thing changes a little as it turns: brightness is free.
        held = self._look * self._inside
        bright = float(np.dot(held, frame[:, 0])) / max(float(np.dot(held, self._whole)), 1e-9)
        difference = frame - scene
        residual = difference[:, 0] - self._look * np.float32(bright)
        dx, dy = difference[:, 1], difference[:, 2]
        jacobian = np.stack([dx, dy, dx * self._ax + dy * self._ay, -self._look])
        size = np.abs(residual[self._inside])
        half = len(size) // 2
        usual = float(np.partition(size, half)[half]) if len(size) else 0.0
        self._scale = max(1.4826 * usual, 0.7 * self._noise)
        weight = 1.0 / (1.0 + (residual * np.float32(1.0 / (3.0 * self._scale))) ** 2)
        self._weight = weight * weight * self._inside
        self._residual = residual
        weighted = jacobian * self._weight
        normal = (weighted @ jacobian.T).astype(np.float64)
        pull = (weighted @ residual).astype(np.float64)
        prior = np.zeros((3, 3))
        prior[:2, :2] = self._known.hold
        prior[2, 2] = self._known.turn_std**-2
        off = np.array([*(self._anchor - self._known.pose.anchor), 0.0])
        off[2] = self._turn - self._known.pose.turn
        normal[:3, :3] += self._scale**2 * prior
        pull[:3] += self._scale**2 * (prior @ off)
        normal += np.diag([1e-6, 1e-6, 1e-6, 1e-3 * self._opaque])
        self._normal = normal
        return self._go(-np.linalg.solve(normal, pull)[:3])

    def _go(self, step: FloatArray) -> bool:
        # Redescending weights make steps fall short by a constant share: it is learnt on the way.
        before = self._step
        share = float(step @ before) / max(float(before @ before), 1e-12)
        step = step / (1.0 - float(np.clip(share, 0.0, _MOST_SHARE))) if self._steps else step
        length = float(np.hypot(step[0], step[1]))
        limit = min(1.0, 1.5 / max(length, 1e-9))
        self._anchor = self._anchor + limit * step[:2]
        self._turn += float(np.clip(step[2], -0.1, 0.1)) * limit
        self._step = np.zeros(3) if limit < 1.0 else step
        self._steps += 1
        done = length < _SHORT and self._lengths[1] < _SHORTISH
        self._lengths = (self._lengths[1], length)
        if not done:
            self._place()
        return done

    def pose(self) -> Pose | None:
        """Where the patch has come to lie; None if it does not lie still."""
        if self._lengths[1] > 0.5 or self.seen < _LEAST_SEEN:
            return None
        covariance = np.linalg.inv(self._normal)[:3, :3] * self._scale**2 * _CORRELATED_PIXELS
        spread = float(np.dot(self._weight, self._residual**2)) / float(self._weight.sum() + 1e-9)
        misfit = float(np.sqrt(spread)) / self._noise
        return Pose(self._anchor, self._turn, covariance, misfit, self.seen)


def _with_gradient(window: FloatImage) -> FloatImage:
    """A picture and its slopes along x and y, as channels."""
    gx = cv2.sepFilter2D(window, cv2.CV_32F, _SLOPE, _FLAT)
    gy = cv2.sepFilter2D(window, cv2.CV_32F, _FLAT, _SLOPE)
    return np.asarray(cv2.merge([np.ascontiguousarray(window), gx, gy]))
