"""The pendulum mass: found behind the ball about to be struck, then followed on its arc."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.arc import fit_arc
from vision.ball import BallFits
from vision.cutout import TYPICAL_GAMMA
from vision.mass import MassPoses
from vision.rest import Rest
from vision.rigid import Patch, Pose, register, warped
from vision.scene import Scene

__all__ = ["find_mass", "follow_mass"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
FloatImage = NDArray[np.float32]

_LOST_AFTER = 4
_LOOK_BACK = 40


def find_mass(
    scene: Scene, rest: Rest, radius: float, at: tuple[float, float] | None = None
) -> tuple[int, Patch, Pose] | None:
    """Find what is about to strike the ball: what moved, stands behind it, and nearly touches it.

    Parameters
    ----------
    scene : Scene
        Footage with its static scene.
    rest : Rest
        The ball before it is struck.
    radius : float
        Ball radius, px.
    at : tuple of float, optional
        A point on the mass just before contact, px, where the user gave one.

    Returns
    -------
    reference frame, Patch, Pose, or None
    """
    best: tuple[int, Patch, Pose] | None = None
    best_gap = -np.inf
    # Late enough to be near the ball, early enough to be seen free of it.
    for index in range(rest.last - 1, max(rest.last - _LOOK_BACK, -1), -2):
        picture = scene.picture(index)
        found = _component_behind(scene, index, picture, rest, radius, at)
        if found is None:
            continue
        patch, anchor, gap = found
        if gap > best_gap:
            best_gap = gap
            best = index, patch, Pose(anchor, 0.0, np.zeros((3, 3)), 1.0, 1.0)
        if gap > max(3.0, 0.1 * radius):
            break
    return best


def _component_behind(
    scene: Scene,
    index: int,
    picture: NDArray[np.float32],
    rest: Rest,
    radius: float,
    at: tuple[float, float] | None,
) -> tuple[Patch, FloatArray, float] | None:
    difference = scene.difference(index, picture)
    moved = np.abs(cv2.GaussianBlur(difference, (0, 0), 0.7)) > 5.0 * scene.background.noise
    height, width = moved.shape
    rows, columns = np.mgrid[0:height, 0:width]
    offset_x, offset_y = columns - rest.centre_px[0], rows - rest.centre_px[1]
    along = offset_x * rest.direction[0] + offset_y * rest.direction[1]
    across = -offset_x * rest.direction[1] + offset_y * rest.direction[0]
    moved &= np.hypot(offset_x, offset_y) > radius + 1.5
    moved &= (along < 0) & (along > -4.0 * radius) & (np.abs(across) < 2.2 * radius)
    thick = cv2.morphologyEx(
        moved.astype(np.uint8), cv2.MORPH_OPEN, _disc(max(1, int(0.15 * radius)))
    )
    count, labels = cv2.connectedComponents(thick)
    rear = rest.centre_px - rest.direction * (radius + 1.0)
    target = rear if at is None else np.array(at)
    best, best_gap = 0, np.inf
    for label in range(1, count):
        member = labels == label
        if np.count_nonzero(member) < max(12.0, 0.15 * radius**2):
            continue
        gap = float(np.hypot(columns[member] - target[0], rows[member] - target[1]).min())
        if gap < best_gap:
            best, best_gap = label, gap
    if best == 0 or best_gap > 1.5 * radius:
        return None
    member = labels == best
    anchor = np.array([columns[member].mean(), rows[member].mean()])
    near = cv2.dilate(member.astype(np.uint8), _disc(3)) > 0
    opacity = _opacity(picture, scene.expected(index), moved & near, member)
    region = near & (np.hypot(offset_x, offset_y) > radius + 1.0)
    gain = scene.views[index].gain
    patch = Patch(
        columns[region] - anchor[0],
        rows[region] - anchor[1],
        (picture[region] / gain).astype(np.float64),
        opacity[region].astype(np.float64),
    )
    clear = float(np.hypot(offset_x[member], offset_y[member]).min()) - radius
    return patch, anchor, clear


def _opacity(
    picture: FloatImage, expected: FloatImage, moved: BoolArray, thick: BoolArray
) -> FloatImage:
    """How much of each pixel the thing covers: all inside, at its edge by the mixture of light."""
    light = np.abs((picture / 255.0) ** TYPICAL_GAMMA - (expected / 255.0) ** TYPICAL_GAMMA)
    core = cv2.erode(moved.astype(np.uint8), _disc(1))
    rim = (cv2.dilate(core, _disc(2)) > 0) & (core == 0)
    usual = float(np.median(light[thick]))
    part = np.clip(light / max(usual, 1e-6), 0.0, 1.0) * rim
    return np.where(core > 0, np.float32(1.0), part).astype(np.float32)


def _disc(radius: int) -> NDArray[np.uint8]:
    size = 2 * radius + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), dtype=np.uint8)


def follow_mass(
    scene: Scene, reference: int, patch: Patch, start: Pose, rest: Rest, ball: BallFits
) -> MassPoses | None:
    """Follow the mass to both ends of the clip, learn its look, and follow it again.

    Parameters
    ----------
    scene : Scene
        Footage with its static scene.
    reference, patch, start
        What `find_mass` returned.
    rest : Rest
        The ball before it is struck.
    ball : BallFits
        The ball, which may hide part of the mass.

    Returns
    -------
    MassPoses or None
        None if it can't be followed, or not on an arc.
    """
    tracker = _Tracker(scene, ball)
    first = tracker.follow(patch, start, reference, rest)
    if len(first) < 6:
        return None
    better = _averaged(scene, patch, first, reference, ball)
    poses = dict(first)
    for index in sorted(first):
        pose = tracker.locate(better, index, poses[index], 0.02)
        if pose is None:
            del poses[index]
        else:
            poses[index] = pose
    order = np.array(sorted(poses), dtype=np.int64)
    if len(order) < 6:
        return None
    arc = fit_arc(
        np.array([poses[int(index)].anchor for index in order]),
        np.array([poses[int(index)].turn for index in order]),
    )
    if arc is None:
        return None
    return MassPoses(order, tuple(poses[int(index)] for index in order), better, arc, reference)


class _Tracker:
    """Registers the mass frame after frame, each predicted from the last few."""

    def __init__(self, scene: Scene, ball: BallFits) -> None:
        self._scene = scene
        self._ball = ball
        self._radius = float(np.median(ball.radius))

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
        return register(
            patch,
            picture,
            self._scene.background.image,
            gain,
            self._scene.noise,
            guess,
            turn_std=turn_std,
            hidden=self._hidden(index),
        )

    def follow(self, patch: Patch, start: Pose, reference: int, rest: Rest) -> dict[int, Pose]:
        """From the reference frame to both ends."""
        own = self.locate(patch, reference, start, 0.01)
        poses = {reference: own if own is not None else start}
        for direction in (-1, 1):
            first = self._first_step(
                patch, poses[reference], reference + direction, direction, rest
            )
            if first is None:
                continue
            poses[reference + direction] = first
            self._walk(patch, poses, reference + 2 * direction, direction)
        return poses

    def _first_step(
        self, patch: Patch, start: Pose, index: int, direction: int, rest: Rest
    ) -> Pose | None:
        """The speed is not known yet: try several."""
        if not 0 <= index < self._scene.count:
            return None
        tried = []
        for share in (0.0, 0.3, 0.6, 0.9, 1.2):
            ahead = start.anchor + direction * share * rest.speed_px * rest.direction
            pose = self.locate(patch, index, replace(start, anchor=ahead), 0.03)
            if pose is not None:
                tried.append(pose)
        return min(tried, key=lambda pose: pose.misfit) if tried else None

    def _walk(self, patch: Patch, poses: dict[int, Pose], index: int, direction: int) -> None:
        missed = 0
        usual = [poses[known].misfit for known in poses]
        while 0 <= index < self._scene.count and missed < _LOST_AFTER:
            guess = _predicted(poses, index, direction)
            pose = self.locate(patch, index, guess, 0.02)
            limit = 2.5 * float(np.median(usual)) + 1.0
            if pose is None or pose.misfit > limit or _leapt(pose, guess):
                missed += 1
            else:
                poses[index] = pose
                usual.append(pose.misfit)
                missed = 0
            index += direction


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
