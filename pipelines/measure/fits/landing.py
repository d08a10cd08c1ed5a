"""The landing as it is seen: from the frames around touch-down alone, before it and after it.

The fitted flight foretells where it lands from the whole of its path. This is the other way about:
a short piece of path before touch-down, and, where the clip goes on, one after the bounce. Both
meet where and when the ball is on the floor.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metrology import NotFoundError
from pipelines.measure.fits.slow_errors import slow_error_whitening
from pipelines.measure.inputs import Inputs
from pipelines.measure.metres import MetricTracks

__all__ = ["LandingSeen", "landing_seen"]

FloatArray = NDArray[np.float64]

STRETCH_S, LEAST_FRAMES = 0.06, 5
"""Path before touch-down, and after: short enough to hang on nothing of the launch, and over it
drag changes a speed of 5 m/s by a hundredth, which a known pull and a free line take up."""
FLOOR_CONTACT_STD_S = 0.004
"""Half the time that an inflated ball is on the floor: what before and after are apart, s."""
PULL_STD = 0.3
"""Drag and lift along a path so short, m/s²."""


@dataclass(frozen=True)
class LandingSeen:
    """Touch-down.

    Attributes
    ----------
    time_s : float
        First touch, s.
    place_m : (2,) array
        Ball's centre then, ball plane, m.
    covariance : (3, 3) array
        Of time and place.
    bounce_seen : bool
        Whether the path after the bounce took part.
    """

    time_s: float
    place_m: FloatArray
    covariance: FloatArray
    bounce_seen: bool


def landing_seen(tracks: MetricTracks, inputs: Inputs, lands_at: float) -> LandingSeen:
    """Touch-down from the frames around it.

    Parameters
    ----------
    tracks : MetricTracks
        Ball plane.
    inputs : Inputs
        Height of the support and gravity.
    lands_at : float
        About when it lands, s.

    Raises
    ------
    NotFoundError
        If it is not followed down to the floor.
    """
    assert inputs.fall is not None
    floor = float(tracks.rest_m[1]) - inputs.fall
    time = tracks.ball_time_s
    frame_s = float(np.median(np.diff(time)))
    stretch = max(STRETCH_S, LEAST_FRAMES * frame_s)
    before = (time < lands_at) & (time > lands_at - stretch - 0.5 * frame_s)
    if before.sum() < LEAST_FRAMES or lands_at - time[before][-1] > 1.5 * frame_s:
        raise NotFoundError(
            "the ball is not followed through the last frames before it lands",
            hint="Film so that the landing is in the picture.",
        )
    falling = _Piece.fit(tracks, before, lands_at, inputs)
    touch = falling.reaches(floor)
    if touch is None:
        raise NotFoundError("the path just before the landing does not reach the floor")
    elapsed, x = touch
    found = LandingSeen(
        lands_at + elapsed,
        np.array([x, floor]),
        falling.covariance_at(elapsed),
        False,
    )
    after = (time > found.time_s + 2.5 * FLOOR_CONTACT_STD_S) & (time < lands_at + stretch)
    if after.sum() < LEAST_FRAMES:
        return found
    return _with_bounce(found, _Piece.fit(tracks, after, found.time_s, inputs), floor)


def _with_bounce(found: LandingSeen, rising: "_Piece", floor: float) -> LandingSeen:
    """Weigh in when and where the path after the bounce leaves the floor.

    It leaves later than the other came by the time on the floor, which is known to no better than
    itself; what has no such bounce is left alone.
    """
    left = rising.reaches(floor)
    if left is None or rising.values[3] <= 0.0:
        return found
    elapsed, x = left
    lasting = 2.0 * FLOOR_CONTACT_STD_S
    time = elapsed - lasting
    along = x - float(rising.values[2]) * lasting
    spread = rising.covariance_at(elapsed)
    spread[0, 0] += FLOOR_CONTACT_STD_S**2
    # on the floor it is slowed along it, by anything up to what it loses
    spread[1, 1] += (0.5 * float(rising.values[2]) * FLOOR_CONTACT_STD_S) ** 2
    told = np.array([time, along - found.place_m[0]])
    own = found.covariance[:2, :2]
    apart = told @ np.linalg.solve(own + spread[:2, :2], told)
    if apart > _MOST_APART:
        return found
    gain = own @ np.linalg.inv(own + spread[:2, :2])
    moved = gain @ told
    covariance = found.covariance.copy()
    covariance[:2, :2] = own - gain @ own
    return LandingSeen(
        found.time_s + float(moved[0]),
        found.place_m + np.array([float(moved[1]), 0.0]),
        covariance,
        True,
    )


_MOST_APART = 14.0
"""χ² of two degrees of freedom that one bounce in a thousand exceeds."""


@dataclass(frozen=True)
class _Piece:
    """A short piece of flight about a time: x, y, vx, vy, ax, ay there, and their covariance."""

    values: FloatArray
    covariance: FloatArray

    @classmethod
    def fit(
        cls, tracks: MetricTracks, used: NDArray[np.bool_], about_s: float, inputs: Inputs
    ) -> "_Piece":
        elapsed = tracks.ball_time_s[used] - about_s
        std = np.sqrt(np.diagonal(tracks.ball_cov_m2[used], axis1=1, axis2=2))
        std = np.maximum(std, 0.3 * np.median(std, axis=0))
        whiten = slow_error_whitening(elapsed)
        design = np.stack([np.ones_like(elapsed), elapsed, 0.5 * elapsed**2], axis=1)
        values, covariance = np.zeros(6), np.zeros((6, 6))
        for axis, pull in ((0, 0.0), (1, -inputs.gravity)):
            rows = whiten(design / std[:, axis, np.newaxis])
            seen = whiten(tracks.ball_m[used, axis] / std[:, axis])
            rows = np.vstack([rows, [0.0, 0.0, 1.0 / PULL_STD]])
            seen = np.append(seen, pull / PULL_STD)
            spread = np.linalg.inv(rows.T @ rows)
            best = spread @ rows.T @ seen
            freedom = max(len(elapsed) - 2, 1)
            left = seen - rows @ best
            at = [axis, 2 + axis, 4 + axis]
            values[at] = best
            covariance[np.ix_(at, at)] = spread * max(float(left @ left) / freedom, 1.0)
        return cls(values, covariance)

    def reaches(self, height: float) -> tuple[float, float] | None:
        """Time nearest to its own at which it is at a height, and x there; None if it never is."""
        x, y, vx, vy, ax, ay = (float(value) for value in self.values)
        roots = np.roots([0.5 * ay, vy, y - height])
        real = roots[np.abs(roots.imag) < 1e-9].real
        if len(real) == 0:
            return None
        at = float(real[np.argmin(np.abs(real))])
        return at, x + vx * at + 0.5 * ax * at**2

    def covariance_at(self, elapsed: float) -> FloatArray:
        """Covariance (3, 3) of time, x and y of reaching that height."""
        vx = float(self.values[2] + self.values[4] * elapsed)
        vy = float(self.values[3] + self.values[5] * elapsed)
        powers = np.array([1.0, elapsed, 0.5 * elapsed**2])
        slope = np.zeros((3, 6))
        slope[0, [1, 3, 5]] = -powers / vy
        slope[1, [0, 2, 4]] = powers
        slope[1] += vx * slope[0]
        return np.asarray(slope @ self.covariance @ slope.T)
