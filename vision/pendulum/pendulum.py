"""Follow a body that swings into the ball to both ends of the clip.

A piece of what differs from the scene is first registered freely from frame to frame on its way to
the ball, which gives a first pivot. Then all pictures share one pivot, for a body that turns with
its arm and for one whose appearance does not turn; the likelihood of the pictures selects one of
the two.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vision.ball.ball import BallFits
from vision.pendulum.arc import Arc, ImagedSwing, Patch, Pose, fit_arc, fit_imaged_swing, register
from vision.pendulum.candidates import SwungBody
from vision.pendulum.face import MassCandidate, MassPoses, Striking, striking
from vision.pendulum.layer import (
    Bundle,
    Glimpse,
    Placed,
    bundle,
    differing,
    learnt_look,
    locate_along,
    registration_step,
    segmented,
)
from vision.scene import Backdrop, FilmedScene
from vision.tracks import Rest

__all__ = ["Follower", "Swinging", "follow_body", "follow_on", "follow_piece", "most_explained"]

FloatArray = NDArray[np.float64]

_LOST_AFTER = 4
"""Frames without the mass that end a trial: one or two may be hidden or dropped."""

_MIN_COUNT = 6
"""Poses: fewer tell no circle from a line."""

_TRIAL_WAY, _TRIAL_FRAMES = 1.1, 8
"""Ball's radii of flight, and frames at least, of a trial: enough for a mass to move by its own
size (chosen)."""

_MAX_WAY, _MAX_FRAMES = 4.6, 16
"""Ball's radii of flight, and frames at least, from which the pivot is found first (chosen): the
swing is followed on from there."""

_MIN_ADVANCE_PX = 1.0

# A pose lies off the prediction by no more than this, px or of the step, and rad.
_LEAP_PX, _LEAP_SHARE, _LEAP_TURN = 1.5, 0.4, 0.06

_SPEEDS = (0.0, 0.3, 0.6, 0.9, 1.2)
"""Share of the speed before the strike that the mass may keep, as far as a lighter or heavier ball
leaves it; steps of a third."""


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
        self.extend(piece.patch, poses, -1, self._follower.frames(_TRIAL_WAY, _TRIAL_FRAMES))
        if len(poses) < _MIN_COUNT:
            return {}
        steps = np.array([poses[index].anchor for index in sorted(poses)])
        if float((steps[-1] - steps[0]) @ rest.direction) < _MIN_ADVANCE_PX:
            return {}
        self.extend(piece.patch, poses, -1, self._follower.frames(_MAX_WAY, _MAX_FRAMES))
        self.extend(piece.patch, poses, 1, rest.last - piece.frame)
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

    def extend(self, patch: Patch, poses: dict[int, Pose], direction: int, frames: int) -> None:
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
        return min(tried, key=lambda pose: pose.rms_residual) if tried else None

    def _walk(
        self, patch: Patch, poses: dict[int, Pose], index: int, direction: int, frames: int
    ) -> None:
        missed = 0
        stop = index + direction * frames
        usual = [pose.rms_residual for pose in poses.values()]
        while 0 <= index < self._follower.scene.count and index != stop and missed < _LOST_AFTER:
            guess = _predicted(poses, index, direction)
            pose = self._locate(patch, index, guess, 0.02)
            limit = 2.5 * float(np.median(usual)) + 1.0
            step = self._follower.rest.speed_px
            if pose is None or pose.rms_residual > limit or _leapt(pose, guess, step):
                missed += 1
            else:
                poses[index] = pose
                usual.append(pose.rms_residual)
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
    ahead = np.polyfit(times - index, values, degree)[-1]
    return Pose(ahead[:2], float(ahead[2]), np.zeros((3, 3)), 1.0, 1.0)


FloatImage = NDArray[np.float32]

_BUNDLED = 14
"""Frames fitted together: a swing has six shared unknowns, and the rest only adds time."""

_MIN_LOST, _MAX_LOST = 6, 40
"""Frames, at least and most, for which the mass may be hidden: as long as it needs to pass behind
the ball."""

_SHADOW_LEAVES = 2.3
"""Ball's radii of flight within which its shadow has left the wall behind the mass (chosen)."""

_BALL_MARGIN_PX = 1.5
"""px around the ball's outline that its blur may reach: a point spread is about a pixel wide."""

# Of what the body usually explains of a picture, what it explains where it is.
_STILL_EXPLAINED = 0.5

_KNOWN = 6
"""Frames from which the next pose is predicted (derived: twice the unknowns of a parabola)."""

# A blow takes up to so much of the rate; a prediction is off by so much at least, px.
_BLOW, _OFF_PX = 0.75, 1.5

_CURVED_PX = 1e5
"""px: a circle of that radius is straight within a pixel over any picture."""

# How far a body with depth is off the arc of a flat one, px and rad; a round one turns freely.
_STRAY_PX, _LEFT_PX, _STRAY_RAD, _NO_TURN = 0.5, 5.0, 0.02, 1e-4

_REFITTED, _OPAQUE = 24, 0.95
"""Frames after which an arc is fitted anew on the way, and minimum opacity of a point that shows
the light of a body alone (chosen)."""

_PROPOSED_PX = 3.0
"""Search range of a proposed body in the first pictures, px (chosen: a pixel of the working
picture)."""

_USUAL_RESIDUAL = 1.5
"""Factor: a misfit that is this much over the usual is looked into (chosen)."""

_BEFORE, _TRIAL, _COMPARED = 2.3, 2.2, 18
"""Ball's radii of flight before and after it was last seen at rest, and how many frames of them, in
which bodies are compared (chosen)."""

_LAST_WAY = 3.0
"""Ball's radii of flight before it was last seen at rest in which a swing turns nearly evenly: a
free swing's rate changes by a few per cent in them, and its change is even."""

_MIN_SCATTERED = 8
"""Frames: a parabola has three unknowns, and the scatter about it needs some more."""

# Looks that fit nearly alike leave it to the turns: more than this part of the arm's turn is one.
_ALIKE, _HALF_TURNED = 0.01, 0.6


@dataclass(frozen=True)
class Swinging:
    """A piece followed as a swinging body.

    Attributes
    ----------
    mass : MassPoses
        Where it was.
    swing : ImagedSwing
        Its arc.
    striking : Striking
        Whether its motion agrees with having struck the ball.
    gain : float
        Log-likelihood that it adds around the strike over scenes without it.
    scatter_px : float
        How far its places on the way to the ball stray from a turn that speeds up evenly, px; ∞
        where it is seen in too few frames to tell.
    """

    mass: MassPoses
    swing: ImagedSwing
    striking: Striking
    gain: float
    scatter_px: float
    by_motion: bool = False

    @property
    def misfit(self) -> float:
        """What is usually left of a picture where the body lies, over noise."""
        return float(np.median([pose.rms_residual for pose in self.mass.poses]))


class Follower:
    """Looks for swinging bodies in a clip.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    rest : Rest
        The ball before it is struck.
    ball : BallFits
        The ball, which may hide part of the body.
    before : Backdrop
        The scene before the strike (`scene_before_strike`).
    """

    def __init__(self, scene: FilmedScene, rest: Rest, ball: BallFits, before: Backdrop) -> None:
        self.scene, self.rest, self.ball, self.before = scene, rest, ball, before
        self.radius = float(np.median(ball.radius))
        self.after = Backdrop(scene, scene.background.image, self.radius, relit=before.relit)
        self._latest: tuple[int, FloatImage] | None = None

    def frames(self, radii: float, least: int = 1) -> int:
        """In how many frames, at least so many, the ball flies so many of its radii."""
        return self.rest.frames_along(radii, self.radius, least)

    @property
    def compared(self) -> list[int]:
        """The frames around the strike in which bodies are compared."""
        first, end = self.rest.last - self.frames(_BEFORE), self.rest.last + self.frames(_TRIAL)
        every = range(first, end, max(1, (end - first) // _COMPARED))
        return [index for index in every if 0 <= index < self.scene.count]

    def hidden(self, index: int) -> tuple[float, float, float] | None:
        """The disc in which the ball may be in front."""
        frames = self.ball.frame
        if len(frames) == 0 or index > frames[-1] + 3:
            return None
        if index < frames[0]:
            return (*self.rest.centre_px, self.radius + _BALL_MARGIN_PX)
        x, y = self._flown[index - frames[0]].tolist()
        return x, y, self.radius + _BALL_MARGIN_PX

    @cached_property
    def _flown(self) -> FloatArray:
        """Where the ball is in each frame from its first on (n, 2), px."""
        frames, centre = self.ball.frame, self.ball.centre
        every = np.arange(frames[0], frames[-1] + 4)
        return np.column_stack([np.interp(every, frames, axis) for axis in centre.T])

    def glimpses(self, index: int) -> Iterator[Glimpse]:
        """A picture before each scene that may lie behind: the ball's shadow leaves late."""
        # one frame is looked at several times in a row
        if self._latest is None or self._latest[0] != index:
            self._latest = index, self.scene.picture(index)
        picture = self._latest[1]
        gain = self.scene.views[index].gain
        left = self.rest.last + self.frames(_SHADOW_LEAVES)
        behind = [self.before.in_frame(index)] if index <= left else []
        if index > self.rest.last:
            behind.append(self.after.in_frame(index))
        for image in behind:
            yield Glimpse(index, picture, image, gain, self.scene.noise, self.hidden(index))

    def locate(
        self, patch: Patch, swing: ImagedSwing, index: int, guess: float, reach: float
    ) -> tuple[Placed, Glimpse] | None:
        """Where along its arc the body is in a frame, and before which scene."""
        found = [
            (placed, glimpse)
            for glimpse in self.glimpses(index)
            if (placed := locate_along(patch, swing, glimpse, guess, reach)) is not None
        ]
        return min(found, key=lambda pair: pair[0].rms_residual, default=None)


def follow_piece(follower: Follower, piece: MassCandidate) -> Swinging | None:
    """Follow a piece of what moved past the strike as a swinging body.

    Returns
    -------
    Swinging or None
        None where it does not come towards the ball on an arc.
    """
    free = FreeTracker(follower).coming(piece)
    if len(free) < _MIN_COUNT:
        return None
    return _followed(follower, piece, free)


def _followed(
    follower: Follower, piece: MassCandidate, free: dict[int, Pose], *, by_motion: bool = False
) -> Swinging | None:
    """Fit its arc to first poses, and follow it past the strike."""
    opaque = _OPAQUE if by_motion else 0.0
    fitted = [
        one for turns in (True, False) if (one := _fitted(follower, piece, free, turns, opaque))
    ]
    fitted = [one for one in fitted if _hangs(follower, one[1].swing)]
    if not fitted:
        return None
    patch, coming = _likelier(fitted, free)
    frames = _spread(free)
    seen = np.isfinite(coming.angles)
    angles = np.interp(np.array(sorted(free)), frames[seen], coming.angles[seen])
    walk = _Walk(follower, patch, coming.swing, piece.frame, by_motion=by_motion)
    for frame, angle in zip(sorted(free), angles, strict=True):
        walk.look(frame, float(angle), 0.0)
    if len(walk.known) < _MIN_COUNT:
        return None
    walk.go(1, follower.rest.last + follower.frames(_TRIAL, _MIN_COUNT))
    return walk.swinging()


def follow_body(follower: Follower, body: SwungBody) -> Swinging | None:
    """Follow a proposed body past the strike.

    Returns
    -------
    Swinging or None
        None where it does not swing towards the ball.
    """
    # the pictures may be those of a colour
    spot = np.rint(np.column_stack([body.patch.x, body.patch.y]) + body.swing.centre_px).astype(int)
    picture = follower.scene.picture(body.frame)
    look = picture[spot[:, 1], spot[:, 0]] / follower.scene.views[body.frame].gain
    body = replace(body, patch=replace(body.patch, look=look.astype(np.float64)))
    free = _along(follower, body)
    if len(free) < _MIN_COUNT:
        return None
    frames = _spread(free)
    glimpses = [next(follower.glimpses(int(frame))) for frame in frames]
    angles = np.array([free[int(frame)].turn for frame in frames])
    first = bundle(body.patch, body.swing, glimpses, angles, oblique=False)
    if first is None:
        return None
    patch, middle = body.patch, np.zeros(2)
    if not body.with_arm:
        patch = segmented(body.patch, first.swing, glimpses, first.angles)
        middle = patch.opacity @ np.column_stack([patch.x, patch.y]) / patch.opacity.sum()
    swing = replace(first.swing, centre_px=first.swing.centre_px + middle)
    patch = replace(patch, x=patch.x - middle[0], y=patch.y - middle[1])
    known = np.isfinite(first.angles)
    every = np.array(sorted(free))
    angles = np.interp(every, frames[known], first.angles[known])
    angles[every == body.frame] = 0.0
    registered = {
        int(frame): _registered_freely(follower, patch, swing, int(frame), float(angle))
        for frame, angle in zip(every, angles, strict=True)
    }
    free = {frame: pose for frame, pose in registered.items() if pose is not None}
    if body.frame not in free or len(free) < _MIN_COUNT:
        return None
    FreeTracker(follower).extend(patch, free, -1, follower.frames(_MAX_WAY, _MAX_FRAMES))
    piece = MassCandidate(body.frame, patch, swing.centre_px, 0.0)
    return _followed(follower, piece, free, by_motion=True)


def _registered_freely(
    follower: Follower, patch: Patch, swing: ImagedSwing, frame: int, angle: float
) -> Pose | None:
    """A pose near an angle of a swing, free to leave the arc and to turn."""
    glimpse = next(follower.glimpses(frame))
    start = Pose(swing.middle(angle), angle, np.zeros((3, 3)), 1.0, 1.0)
    return register(
        patch,
        glimpse.picture,
        glimpse.behind,
        glimpse.gain,
        glimpse.noise,
        start,
        turn_std=0.1,
        hidden=glimpse.hidden,
    )


def _along(follower: Follower, body: SwungBody) -> dict[int, Pose]:
    """Poses of a body near where its motion before contact predicts it."""
    arm = float(np.hypot(*(body.swing.centre_px - body.swing.pivot_px)))
    free: dict[int, Pose] = {}
    first, last = min(body.angles), follower.rest.last
    rate = (max(body.angles.values()) - min(body.angles.values())) / max(
        max(body.angles) - first, 1
    )
    sign = 1.0 if body.angles[max(body.angles)] >= body.angles[first] else -1.0
    for frame in range(first, last + 1):
        guess = sign * rate * (frame - body.frame)
        if frame == body.frame:
            free[frame] = Pose(body.swing.centre_px, 0.0, np.zeros((3, 3)), 1.0, 1.0)
            continue
        reach = (_PROPOSED_PX + 0.15 * abs(guess) * arm) / arm
        glimpse = next(follower.glimpses(frame))
        found = locate_along(body.patch, body.swing, glimpse, guess, reach)
        if found is not None and abs(found.angle - guess) < 1.5 * reach:
            middle = body.swing.middle(found.angle)
            free[frame] = Pose(
                middle, found.angle, np.zeros((3, 3)), found.rms_residual, found.seen
            )
    return free


def follow_on(follower: Follower, found: Swinging) -> Swinging:
    """Follow it to both ends of the clip, on the arc that its whole way tells."""
    mass = found.mass
    walk = _Walk(follower, mass.patch, found.swing, mass.reference, by_motion=found.by_motion)
    walk.known.update(zip(found.mass.frame.tolist(), found.mass.poses, strict=True))
    walk.go(-1, -1)
    walk.go(1, follower.scene.count)
    return walk.swinging()


class _Walk:
    """A body followed from frame to frame: registered near where its arc and rate predict it."""

    def __init__(
        self,
        follower: Follower,
        patch: Patch,
        swing: ImagedSwing,
        reference: int,
        *,
        by_motion: bool,
    ) -> None:
        self._follower, self._patch, self._reference = follower, patch, reference
        self.swing = swing
        self.known: dict[int, Pose] = {}
        self._by_motion = by_motion
        self._arm = float(np.hypot(*(swing.centre_px - swing.pivot_px)))
        self._explained: list[float] = []

    def look(self, index: int, guess: float, reach: float) -> bool:
        """Look for the body in a frame at an angle, or that far to either side of it."""
        pose = self._registered(index, guess)
        if pose is None or (reach > 0.0 and not self._as_usual(pose, guess)):
            found = self._follower.locate(self._patch, self.swing, index, guess, reach)
            if found is None or found[0].explained < _STILL_EXPLAINED * self._usual():
                return False
            self._explained.append(found[0].explained)
            pose = self._registered(index, found[0].angle)
        if pose is None:
            return False
        self.known[index] = pose
        return True

    def _usual(self) -> float:
        return float(np.median(self._explained)) if self._explained else 0.0

    def _as_usual(self, pose: Pose, guess: float) -> bool:
        usual = float(np.median([one.rms_residual for one in self.known.values()]))
        off = float(np.hypot(*(pose.anchor - self.swing.middle(guess))))
        return pose.rms_residual < _USUAL_RESIDUAL * usual and off < _OFF_PX

    def _registered(self, index: int, angle: float) -> Pose | None:
        """Registered freely along the arc, held a little across it and in its turn."""
        swing = self.swing
        shift, _ = swing.per_radian(angle)
        across = np.array([shift[1], -shift[0]]) / np.hypot(*shift)
        turn = angle if swing.turns else 0.0
        start = Pose(swing.middle(angle), turn, np.zeros((3, 3)), 1.0, 1.0)
        found = [
            register(
                self._patch,
                glimpse.picture,
                glimpse.behind,
                glimpse.gain,
                glimpse.noise,
                start,
                turn_std=_STRAY_RAD if swing.turns else _NO_TURN,
                hidden=glimpse.hidden,
                anchor_information=np.outer(across, across) / _STRAY_PX**2,
            )
            for glimpse in self._follower.glimpses(index)
        ]
        poses = [pose for pose in found if pose is not None]
        near = [one for one in poses if np.hypot(*(one.anchor - start.anchor)) < _LEFT_PX]
        return min(near, key=lambda pose: pose.rms_residual, default=None)

    def go(self, direction: int, stop: int) -> None:
        """Go on from the last known frame until the body is lost for long."""
        index = (max(self.known) if direction > 0 else min(self.known)) + direction
        missed, patience = 0, _MIN_LOST
        while 0 <= index < self._follower.scene.count and index * direction < stop * direction:
            last, rate = self._rate(direction)
            gap = abs(index - last)
            guess = float(self.swing.angle_of(self.known[last].anchor)) + rate * gap
            reach = _OFF_PX / self._arm + _BLOW * abs(rate) * gap
            patience = _patience(self._follower.radius, abs(rate) * self._arm)
            missed = 0 if self.look(index, guess, min(reach, 0.5)) else missed + 1
            if self._by_motion and missed == 0 and len(self.known) % _REFITTED == 0:
                poses = [self.known[frame] for frame in sorted(self.known)]
                self.swing = fit_imaged_swing(self.swing, poses).swing
            if missed >= patience:
                return
            index += direction

    def _rate(self, direction: int) -> tuple[int, float]:
        """The last known frame, and the rate there in rad per frame gone."""
        order = sorted(self.known, reverse=direction < 0)[-_KNOWN:]
        angle = self.swing.angle_of(np.array([self.known[frame].anchor for frame in order]))
        step = np.abs(np.array(order, dtype=np.float64) - order[-1])
        if len(order) < 2:
            return order[-1], 0.0
        ahead = step.mean() - step
        return order[-1], float(ahead @ np.unwrap(angle) / (ahead @ ahead))

    def swinging(self) -> Swinging:
        """What was followed, with the arc that the whole way tells."""
        follower = self._follower
        order = np.array(sorted(self.known), dtype=np.int64)
        poses = tuple(self.known[int(frame)] for frame in order)
        through = fit_imaged_swing(self.swing, poses)
        swing = through.swing
        points = np.array([pose.anchor for pose in poses])
        angle = swing.angle_of(points)
        arm = float(np.hypot(*(swing.centre_px - swing.pivot_px)))
        off = np.hypot(
            *(np.array([swing.middle(one) for one in angle]) - [p.anchor for p in poses]).T
        )
        scatter = 1.4826 * float(np.median(off))
        covariance = np.eye(3)
        covariance[:2, :2] = through.pivot_covariance_px2
        arc = Arc(swing.pivot_px, arm, covariance, scatter, float(np.ptp(np.unwrap(angle))))
        mass = MassPoses(order, poses, self._patch, arc, self._reference)
        last = follower.rest.last
        near = follower.frames(_LAST_WAY, _MIN_SCATTERED)
        coming = (order <= last) & (order > last - near)
        scatter_px = _scatter(order[coming], np.unwrap(angle)[coming]) * arm
        strikes = striking(mass, follower.ball, follower.rest)
        return Swinging(mass, swing, strikes, self._gain(), scatter_px, self._by_motion)

    def _gain(self) -> float:
        """What the body explains around the strike; frames in which it was lost count nothing."""
        total = 0.0
        for index in self._follower.compared:
            if index not in self.known:
                continue
            placing = _placing(self.known[index])
            held = [
                one
                for glimpse in self._follower.glimpses(index)
                if (one := registration_step(self._patch, placing, glimpse)) is not None
            ]
            total += min((one.gain_of_it for one in held), default=0.0)
        return total


def most_explained(follower: Follower, piece: MassCandidate, body: Swinging) -> float:
    """The gain, at most, that a piece can have as a part of a body that was followed.

    No look explains more than all that differs from the scene where the piece lies.

    Parameters
    ----------
    body : Swinging
        Which it is taken to move with.

    Returns
    -------
    float
        See `Swinging.gain`; infinite where the body was lost in a frame that counts.
    """
    poses = dict(zip(body.mass.frame.tolist(), body.mass.poses, strict=True))
    if not {piece.frame, *follower.compared} <= set(poses):
        return math.inf
    own = poses[piece.frame]
    cosine, sine = math.cos(own.turn), math.sin(own.turn)
    x, y = piece.patch.x + piece.anchor[0] - own.anchor[0], piece.patch.y + piece.anchor[1]
    y = y - own.anchor[1]
    in_body = replace(piece.patch, x=cosine * x + sine * y, y=cosine * y - sine * x)
    total = 0.0
    for index in follower.compared:
        placing = _placing(poses[index])
        total += min(differing(in_body, placing, one) for one in follower.glimpses(index))
    return total


def _placing(pose: Pose) -> FloatArray:
    """Where a pose puts its patch, (6,)."""
    cosine, sine = math.cos(pose.turn), math.sin(pose.turn)
    return np.array([*pose.anchor, cosine, -sine, sine, cosine])


def _scatter(frame: NDArray[np.int64], angle: FloatArray) -> float:
    """Root mean square of what is left of angles after a parabola over the frames, rad."""
    if len(frame) < _MIN_SCATTERED:
        return float("inf")
    at = frame - frame.mean()
    left = angle - np.polyval(np.polyfit(at, angle, 2), at)
    return float(np.sqrt((left**2).sum() / (len(frame) - 3)))


def _likelier(fitted: list[tuple[Patch, Bundle]], free: dict[int, Pose]) -> tuple[Patch, Bundle]:
    """Of a turning and a round body the likelier; where the looks fit alike, by the free turns."""
    patch, best = max(fitted, key=lambda pair: pair[1].gain)
    if min(pair[1].gain for pair in fitted) < (1.0 - _ALIKE) * best.gain or len(fitted) < 2:
        return patch, best
    order = sorted(free)
    angle = best.swing.angle_of(np.array([free[frame].anchor for frame in order]))
    turn = np.array([free[frame].turn for frame in order])
    turns = bool(np.polyfit(angle, turn, 1)[0] > _HALF_TURNED)
    return next(pair for pair in fitted if pair[1].swing.turns == turns)


def _spread(free: dict[int, Pose]) -> NDArray[np.int64]:
    """Some of the frames, evenly."""
    order = np.array(sorted(free), dtype=np.int64)
    places = np.unique(np.linspace(0, len(order) - 1, _BUNDLED).astype(np.int64))
    return order[places]


def _fitted(
    follower: Follower, piece: MassCandidate, free: dict[int, Pose], turns: bool, opaque: float
) -> tuple[Patch, Bundle] | None:
    """The look and the arc of a piece, as a body that turns with its arm or not."""
    order = sorted(free)
    points = np.array([free[index].anchor for index in order])
    turned = np.array([free[index].turn for index in order])
    arc = fit_arc(points, turned if turns else None)
    pivot = _overhead(follower, piece) if arc is None else arc.centre_px
    if np.hypot(*(pivot - piece.anchor)) > _CURVED_PX:
        pivot = _overhead(follower, piece)
    swing = ImagedSwing(pivot, 0.0, 1.0, free[piece.frame].anchor, turns)
    frames = _spread(free)
    glimpses = [next(follower.glimpses(int(frame))) for frame in frames]
    angles = np.array([float(swing.angle_of(free[int(frame)].anchor)) for frame in frames])
    patch = piece.patch
    found = bundle(patch, swing, glimpses, angles, oblique=False)
    if found is None:
        return None
    patch = learnt_look(patch, found.swing, glimpses, found.angles, opaque=opaque)
    again = bundle(patch, found.swing, glimpses, found.angles)
    return None if again is None else (patch, again)


def _hangs(follower: Follower, swing: ImagedSwing) -> bool:
    """Whether the pivot is above the body."""
    along = follower.rest.direction
    up = np.array([along[1], -along[0]])
    up = up if up[1] < 0 else -up
    return float((swing.pivot_px - swing.centre_px) @ up) > 0.0


def _overhead(follower: Follower, piece: MassCandidate) -> FloatArray:
    """A pivot to start from where the way is straight: over the body, out of the picture."""
    along = follower.rest.direction
    up = np.array([along[1], -along[0]])
    up = up if up[1] < 0 else -up
    return np.asarray(piece.anchor + 8.0 * follower.radius * up)


def _patience(radius: float, speed_px: float) -> int:
    """For how many frames the ball may hide the body."""
    return int(np.clip(radius / max(speed_px, 1e-3), _MIN_LOST, _MAX_LOST))
