"""The pendulum mass followed on its arc: which piece of what moved it is, and where it went."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.ball.ball import BallFits
from vision.ball.rest import Rest
from vision.pendulum.arc import Arc, fit_arc
from vision.pendulum.mass import MassPoses
from vision.pendulum.mass_search import MassCandidate
from vision.pendulum.rigid import Patch, Pose, register, warped
from vision.pendulum.striker import striking
from vision.scene.scene import Scene

__all__ = ["follow_mass"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]

_LOST_AFTER = 4
_FEWEST = 6
_LEARNT_EVERY = 4
_TRIAL_FRAMES = 14
_LEAST_ADVANCE_PX = 1.0
_SHADOW_LEAVES = 30
# A candidate that fits at most so much worse than the best one may be as rigid.
_AS_RIGID = 2.0
_LEAST_TWIST = 0.003


def follow_mass(
    scene: Scene,
    candidates: tuple[MassCandidate, ...],
    rest: Rest,
    ball: BallFits,
    before: FloatImage,
) -> MassPoses | None:
    """Follow each candidate through the clip, and keep the rigid thing that can have struck.

    Parameters
    ----------
    scene : Scene
        Footage with its static scene.
    candidates : tuple of MassCandidate
        What `find_mass` returned, largest first.
    rest : Rest
        The ball before it is struck.
    ball : BallFits
        The ball, which may hide part of the mass.
    before : (H, W) float32 array
        The scene before the strike (`scene_before_strike`).

    Returns
    -------
    MassPoses or None
        None if none can be followed on an arc.
    """
    tracker = _Tracker(scene, ball, rest, before)
    sound = [swing for swing in (_swing_in(tracker, piece, rest) for piece in candidates) if swing]
    if not sound:
        return None
    rigid = _AS_RIGID * min(swing.misfit for swing in sound)
    followed = [_followed(scene, tracker, swing, ball) for swing in sound if swing.misfit <= rigid]
    return min(
        (mass for mass in followed if mass is not None),
        key=lambda mass: (striking(mass, ball, rest), _off_arc(mass)),
        default=None,
    )


def _off_arc(mass: MassPoses) -> float:
    """How badly a track lies on an arc and turns with it; one that was lost early is much worse."""
    away = mass.anchor - mass.arc.centre_px
    turned = np.array([pose.turn for pose in mass.poses]) - np.arctan2(away[:, 1], away[:, 0])
    turned = np.angle(np.exp(1j * (turned - turned[0])))
    twist = float(np.median(np.abs(turned - np.median(turned))))
    return mass.arc.scatter_px * max(twist, _LEAST_TWIST) / len(mass.frame) ** 2


@dataclass(frozen=True)
class _SwingIn:
    """A candidate followed on its way to the ball, and the usual misfit of its look."""

    piece: MassCandidate
    poses: dict[int, Pose]
    misfit: float


def _swing_in(tracker: "_Tracker", piece: MassCandidate, rest: Rest) -> _SwingIn | None:
    start = Pose(piece.anchor, 0.0, np.zeros((3, 3)), 1.0, 1.0)
    own = tracker.locate(piece.patch, piece.frame, start, 0.01)
    poses = {piece.frame: own if own is not None else start}
    tracker.extend(piece.patch, poses, -1, _TRIAL_FRAMES)
    if len(poses) < _FEWEST:
        return None
    steps = np.array([poses[index].anchor for index in sorted(poses)])
    if float((steps[-1] - steps[0]) @ rest.direction) < _LEAST_ADVANCE_PX:
        return None
    tracker.extend(piece.patch, poses, -1, tracker.count)
    tracker.extend(piece.patch, poses, 1, rest.last - piece.frame)
    misfit = float(np.median([pose.misfit for at, pose in poses.items() if at != piece.frame]))
    return _SwingIn(piece, poses, misfit)


def _arc_of(poses: dict[int, Pose]) -> Arc | None:
    order = sorted(poses)
    return fit_arc(
        np.array([poses[index].anchor for index in order]),
        np.array([poses[index].turn for index in order]),
    )


def _followed(
    scene: Scene, tracker: "_Tracker", swing: _SwingIn, ball: BallFits
) -> MassPoses | None:
    """Learn the look on the way to the ball, and follow it to both ends of the clip."""
    piece = swing.piece
    better = _averaged(scene, piece.patch, swing.poses, piece.frame, ball)
    poses = {}
    for index in sorted(swing.poses):
        pose = tracker.locate(better, index, swing.poses[index], 0.02)
        if pose is not None:
            poses[index] = pose
    coming = _arc_of(poses) if len(poses) >= _FEWEST else None
    if coming is None:
        return None
    tracker.extend(better, poses, -1, tracker.count, coming)
    tracker.extend(better, poses, 1, tracker.count, coming)
    arc = _arc_of(poses)
    if arc is None:
        return None
    order = np.array(sorted(poses), dtype=np.int64)
    found = tuple(poses[int(index)] for index in order)
    return MassPoses(order, found, better, arc, piece.frame)


class _Tracker:
    """Registers the mass frame after frame, each predicted from the last few."""

    def __init__(self, scene: Scene, ball: BallFits, rest: Rest, before: FloatImage) -> None:
        self._scene = scene
        self._ball = ball
        self._rest = rest
        self._before = before
        self._radius = float(np.median(ball.radius))

    @property
    def count(self) -> int:
        """Frames of the clip."""
        return self._scene.count

    def _hidden(self, index: int) -> tuple[float, float, float] | None:
        frames = self._ball.frame
        if len(frames) == 0 or index < frames[0] - 3 or index > frames[-1] + 3:
            return None
        centre = self._ball.centre
        x = float(np.interp(index, frames, centre[:, 0]))
        y = float(np.interp(index, frames, centre[:, 1]))
        return x, y, self._radius + 1.5

    def locate(self, patch: Patch, index: int, guess: Pose, turn_std: float) -> Pose | None:
        """Register one frame."""
        picture = self._scene.picture(index)
        gain = self._scene.views[index].gain
        found = [
            register(
                patch,
                picture,
                behind,
                gain,
                self._scene.noise,
                guess,
                turn_std=turn_std,
                hidden=self._hidden(index),
            )
            for behind in self._behind(index)
        ]
        return min(
            (pose for pose in found if pose is not None), key=lambda pose: pose.misfit, default=None
        )

    def _behind(self, index: int) -> tuple[FloatImage, ...]:
        """What may lie behind the mass: the ball's shadow does not leave at once."""
        if index <= self._rest.last:
            return (self._before,)
        if index <= self._rest.last + _SHADOW_LEAVES:
            return (self._before, self._scene.background.image)
        return (self._scene.background.image,)

    def extend(
        self,
        patch: Patch,
        poses: dict[int, Pose],
        direction: int,
        frames: int,
        arc: Arc | None = None,
    ) -> None:
        """Go on from the last known frame in one direction, for so many frames at most.

        Where the arc is known, the mass turns as it goes round.
        """
        if frames < 1:
            return
        end = max(poses) if direction > 0 else min(poses)
        if not _beside(poses, end, -direction):
            first = self._first_step(patch, poses[end], end + direction, direction)
            if first is None:
                return
            end += direction
            poses[end] = first
            frames -= 1
        self._walk(patch, poses, end + direction, direction, frames, arc)

    def _first_step(self, patch: Patch, start: Pose, index: int, direction: int) -> Pose | None:
        """The speed is not known yet: try several."""
        if not 0 <= index < self._scene.count:
            return None
        tried = []
        for share in (0.0, 0.3, 0.6, 0.9, 1.2):
            ahead = start.anchor + direction * share * self._rest.speed_px * self._rest.direction
            pose = self.locate(patch, index, replace(start, anchor=ahead), 0.03)
            if pose is not None:
                tried.append(pose)
        return min(tried, key=lambda pose: pose.misfit) if tried else None

    def _walk(
        self,
        patch: Patch,
        poses: dict[int, Pose],
        index: int,
        direction: int,
        frames: int,
        arc: Arc | None,
    ) -> None:
        missed = 0
        stop = index + direction * frames
        usual = [poses[known].misfit for known in poses]
        while 0 <= index < self._scene.count and index != stop and missed < _LOST_AFTER:
            guess = _predicted(poses, index, direction)
            if arc is not None:
                guess = replace(guess, turn=_turned(arc, poses, guess.anchor))
            pose = self.locate(patch, index, guess, 0.02)
            limit = 2.5 * float(np.median(usual)) + 1.0
            if pose is None or pose.misfit > limit or _leapt(pose, guess):
                missed += 1
            else:
                poses[index] = pose
                usual.append(pose.misfit)
                missed = 0
                # a short way in tells little of the arc: it is learnt on the way
                if arc is not None and len(poses) % _LEARNT_EVERY == 0:
                    arc = _arc_of(poses) or arc
            index += direction


def _beside(poses: dict[int, Pose], index: int, direction: int) -> bool:
    """Whether a neighbour towards `direction` is known, so that there is a speed to go on with."""
    return any(index + direction * step in poses for step in range(1, _LOST_AFTER + 1))


def _turned(arc: Arc, poses: dict[int, Pose], anchor: FloatArray) -> float:
    """Turn of a body on an arc when its anchor is there."""
    known = np.array([pose.anchor for pose in poses.values()]) - arc.centre_px
    here = anchor - arc.centre_px
    angle = np.arctan2(known[:, 1], known[:, 0]) - np.arctan2(here[1], here[0])
    angle = np.arctan2(np.sin(angle), np.cos(angle))
    return float(np.median([pose.turn for pose in poses.values()] - angle))


def _leapt(pose: Pose, guess: Pose) -> bool:
    """Whether a pose lies off the prediction by more than any blow between two frames explains."""
    return (
        float(np.hypot(*(pose.anchor - guess.anchor))) > 1.5 or abs(pose.turn - guess.turn) > 0.06
    )


def _predicted(poses: dict[int, Pose], index: int, direction: int) -> Pose:
    known = sorted(poses, reverse=direction < 0)[-5:]
    times = np.array(known, dtype=np.float64)
    values = np.array([[*poses[k].anchor, poses[k].turn] for k in known])
    degree = 1 if len(known) < 5 else 2
    ahead = np.array(
        [np.polyval(np.polyfit(times - index, column, degree), 0.0) for column in values.T]
    )
    return Pose(ahead[:2], float(ahead[2]), np.zeros((3, 3)), 1.0, 1.0)


def _averaged(
    scene: Scene, patch: Patch, poses: dict[int, Pose], reference: int, ball: BallFits
) -> Patch:
    """Look and opacity from frames in which the mass lies before different parts of the wall."""
    radius = float(np.median(ball.radius))
    near = sorted(poses, key=lambda index: abs(index - reference))[:24]
    total = np.zeros(len(patch.x))
    weight = np.zeros(len(patch.x))
    height, width = scene.shape
    for index in near:
        pose = poses[index]
        x, y = warped(patch, pose.anchor, pose.turn)
        good = (x > 1) & (y > 1) & (x < width - 2) & (y < height - 2)
        place = np.searchsorted(ball.frame, index)
        if 0 <= place < len(ball.frame):
            centre = ball.centre[place]
            good &= np.hypot(x - centre[0], y - centre[1]) > radius + 1.5
        u, v = x.astype(np.float32)[None], y.astype(np.float32)[None]
        border = cv2.BORDER_REPLICATE
        value = cv2.remap(scene.picture(index), u, v, cv2.INTER_CUBIC, borderMode=border)[0]
        total += good * value / scene.views[index].gain
        weight += good
    enough = weight >= max(3.0, 0.25 * len(near))
    look = np.where(enough, total / np.maximum(weight, 1.0), patch.look)
    return replace(patch, look=look)
