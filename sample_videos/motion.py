"""Where ball and pendulum are at any instant: what the renderer takes, whatever physics made it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline

from calib.camera.camera import rotation_matrix
from metrology import DomainError

__all__ = ["HermiteCurve", "Piece", "SampledMotion", "SceneMotion", "SceneState"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class SceneState:
    """State of the moving things at N instants, world frame, SI.

    Attributes
    ----------
    ball : (N, 3) array
        Centre of the ball, m.
    attitude : (N, 3, 3) array
        Rotation from the ball's own frame, in which its panels are painted, to the world.
    compression : (N, 3) array
        Points from the ball's centre to the face that presses it, m; its length is the depth by
        which the ball is flattened there. Zero where nothing presses.
    phi : (N,) array
        Angle of the pendulum, rad, 0 at the lowest point, positive forward.
    """

    ball: FloatArray
    attitude: FloatArray
    compression: FloatArray
    phi: FloatArray


class SceneMotion(Protocol):
    """Anything that knows where ball and pendulum are."""

    def at(self, times: ArrayLike) -> SceneState:
        """State at `times` (N,), s; t = 0 is the first touch of face and ball."""
        ...


@dataclass(frozen=True)
class Piece:
    """Samples of a smooth stretch of a curve: instants (M,) s, values (M, K), rates (M, K)."""

    time: FloatArray
    value: FloatArray
    rate: FloatArray

    def __post_init__(self) -> None:
        if len(self.time) < 2 or np.any(np.diff(self.time) <= 0.0):
            raise DomainError("a stretch of a motion needs two or more instants, in rising order")


class HermiteCurve:
    """A piecewise smooth curve: cubic Hermite within each piece, kinks where pieces meet.

    Before the first and after the last sample it goes on straight.

    Parameters
    ----------
    pieces : sequence of Piece
        In time order, each starting where the one before ends.
    """

    def __init__(self, pieces: tuple[Piece, ...]) -> None:
        self._starts = np.array([piece.time[0] for piece in pieces[1:]])
        self._splines = [CubicHermiteSpline(p.time, p.value, p.rate) for p in pieces]
        self._first, self._last = pieces[0], pieces[-1]

    @classmethod
    def constant(cls, value: ArrayLike) -> "HermiteCurve":
        """A curve that stays at `value` (K,)."""
        row = np.asarray(value, dtype=np.float64)
        level = np.stack([row, row])
        return cls((Piece(np.array([0.0, 1.0]), level, np.zeros_like(level)),))

    def at(self, times: ArrayLike) -> FloatArray:
        """Values at `times` (N,), (N, K)."""
        t = np.asarray(times, dtype=np.float64)
        start, end = self._first.time[0], self._last.time[-1]
        inside = np.clip(t, start, end)
        index = np.searchsorted(self._starts, inside, side="right")
        found = np.empty((len(t), self._first.value.shape[1]))
        for i in np.unique(index):
            here = index == i
            found[here] = self._splines[i](inside[here])
        early, late = np.minimum(t - start, 0.0), np.maximum(t - end, 0.0)
        found += early[:, np.newaxis] * self._first.rate[0]
        found += late[:, np.newaxis] * self._last.rate[-1]
        return found


@dataclass(frozen=True)
class SampledMotion:
    """A motion given by curves.

    Attributes
    ----------
    ball : HermiteCurve
        Centre, (N, 3) m.
    pendulum : HermiteCurve
        Angle, (N, 1) rad.
    compression : HermiteCurve
        As in `SceneState`, (N, 3) m.
    turn : HermiteCurve
        Angle by which the ball has turned about `spin_axis`, (N, 1) rad.
    spin_axis : (3,) array
        Unit vector in the world.
    attitude : (3, 3) array
        Rotation from the ball's own frame to the world at turn 0.
    """

    ball: HermiteCurve
    pendulum: HermiteCurve
    compression: HermiteCurve
    turn: HermiteCurve
    spin_axis: FloatArray
    attitude: FloatArray

    def at(self, times: ArrayLike) -> SceneState:
        """State at `times` (N,), s."""
        t = np.atleast_1d(np.asarray(times, dtype=np.float64))
        angle = self.turn.at(t)[:, 0]
        unique, inverse = np.unique(angle, return_inverse=True)
        turned = np.stack([rotation_matrix(self.spin_axis * a) @ self.attitude for a in unique])
        return SceneState(
            ball=self.ball.at(t),
            attitude=turned[inverse],
            compression=self.compression.at(t),
            phi=self.pendulum.at(t)[:, 0],
        )
