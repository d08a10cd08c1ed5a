"""A piece of what moved, registered freely from frame to frame on its way to the ball."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vision.pendulum.mass_search import MassCandidate
from vision.pendulum.rigid import Patch, Pose, register

if TYPE_CHECKING:
    from vision.pendulum.pendulum import Follower

__all__ = ["FreeTracker"]

FloatArray = NDArray[np.float64]

_LOST_AFTER = 4
_FEWEST = 6
_TRIAL_FRAMES = 14
_MOST_FRAMES = 60
_LEAST_ADVANCE_PX = 1.0
# A pose lies off the prediction by no more than this, px or of the step, and rad.
_LEAP_PX, _LEAP_SHARE, _LEAP_TURN = 1.5, 0.4, 0.06
_SPEEDS = (0.0, 0.3, 0.6, 0.9, 1.2)


class FreeTracker:
    """Registers a piece frame after frame, each predicted from the last few.

    Parameters
    ----------
    follower : Follower
        The clip before the strike.
    """

    def __init__(self, follower: "Follower") -> None:
        self._follower = follower

    def coming(self, piece: MassCandidate) -> dict[int, Pose]:
        """Poses by frame on the way to the ball; empty where it does not come."""
        rest = self._follower.rest
        start = Pose(piece.anchor, 0.0, np.zeros((3, 3)), 1.0, 1.0)
        own = self._locate(piece.patch, piece.frame, start, 0.01)
        poses = {piece.frame: own if own is not None else start}
        self._extend(piece.patch, poses, -1, _TRIAL_FRAMES)
        if len(poses) < _FEWEST:
            return {}
        steps = np.array([poses[index].anchor for index in sorted(poses)])
        if float((steps[-1] - steps[0]) @ rest.direction) < _LEAST_ADVANCE_PX:
            return {}
        self._extend(piece.patch, poses, -1, _MOST_FRAMES)
        self._extend(piece.patch, poses, 1, rest.last - piece.frame)
        return poses

    def _locate(self, patch: Patch, index: int, guess: Pose, turn_std: float) -> Pose | None:
        """Register one frame."""
        glimpse = next(self._follower.glimpses(index))
        return register(
            patch,
            glimpse.picture,
            glimpse.behind,
            glimpse.gain,
            glimpse.noise,
            guess,
            turn_std=turn_std,
            hidden=glimpse.hidden,
        )

    def _extend(self, patch: Patch, poses: dict[int, Pose], direction: int, frames: int) -> None:
        """Go on from the last known frame in one direction, for so many frames at most."""
        if frames < 1:
            return
        end = max(poses) if direction > 0 else min(poses)
        if not any(end - direction * step in poses for step in range(1, _LOST_AFTER + 1)):
            first = self._first_step(patch, poses[end], end + direction, direction)
            if first is None:
                return
            end += direction
            poses[end] = first
            frames -= 1
        self._walk(patch, poses, end + direction, direction, frames)

    def _first_step(self, patch: Patch, start: Pose, index: int, direction: int) -> Pose | None:
        """The speed is not known yet: try several."""
        rest = self._follower.rest
        if not 0 <= index < self._follower.scene.count:
            return None
        tried = []
        for share in _SPEEDS:
            ahead = start.anchor + direction * share * rest.speed_px * rest.direction
            pose = self._locate(patch, index, replace(start, anchor=ahead), 0.03)
            if pose is not None:
                tried.append(pose)
        return min(tried, key=lambda pose: pose.misfit) if tried else None

    def _walk(
        self, patch: Patch, poses: dict[int, Pose], index: int, direction: int, frames: int
    ) -> None:
        missed = 0
        stop = index + direction * frames
        usual = [pose.misfit for pose in poses.values()]
        while 0 <= index < self._follower.scene.count and index != stop and missed < _LOST_AFTER:
            guess = _predicted(poses, index, direction)
            pose = self._locate(patch, index, guess, 0.02)
            limit = 2.5 * float(np.median(usual)) + 1.0
            step = self._follower.rest.speed_px
            if pose is None or pose.misfit > limit or _leapt(pose, guess, step):
                missed += 1
            else:
                poses[index] = pose
                usual.append(pose.misfit)
                missed = 0
            index += direction


def _leapt(pose: Pose, guess: Pose, step_px: float) -> bool:
    """Whether a pose lies off the prediction by more than a swing explains."""
    off = float(np.hypot(*(pose.anchor - guess.anchor)))
    return off > max(_LEAP_PX, _LEAP_SHARE * step_px) or abs(pose.turn - guess.turn) > _LEAP_TURN


def _predicted(poses: dict[int, Pose], index: int, direction: int) -> Pose:
    known = sorted(poses, reverse=direction < 0)[-5:]
    times = np.array(known, dtype=np.float64)
    values = np.array([[*poses[k].anchor, poses[k].turn] for k in known])
    degree = 1 if len(known) < 5 else 2
    ahead = np.array(
        [np.polyval(np.polyfit(times - index, column, degree), 0.0) for column in values.T]
    )
    return Pose(ahead[:2], float(ahead[2]), np.zeros((3, 3)), 1.0, 1.0)
