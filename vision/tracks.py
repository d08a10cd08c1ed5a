"""What the vision room hands on: where ball and pendulum were, frame by frame, in pixels.

When and where the ball lay still before it was struck.
"""

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Face",
    "FollowedObject",
    "Motion",
    "MotionKind",
    "MotionModel",
    "PendulumTrack",
    "Rest",
    "Track",
    "TrackedFeature",
    "Tracks",
    "find_rest",
]

FloatArray = NDArray[np.float64]
TrackedFeature = Literal["outline", "edge", "centre"]


class MotionKind(Enum):
    """What happens in a clip."""

    STRIKE = "strike"
    """A ball lies still, a pendulum strikes it, it flies."""
    FLIGHT = "flight"
    """Something flies freely that nothing in the clip was seen to strike: thrown, launched."""
    DROP = "drop"
    """Something falls freely from rest, straight down."""
    SWING = "swing"
    """Something swings on an arc and strikes nothing."""
    COLLISION = "collision"
    """Of two like balls one moves, meets the other at rest, and sets it in motion."""
    NONE = "none"
    """Nothing moves in a way that any of these explains."""


class MotionModel(Enum):
    """How one followed object moves, or what it is instead of an object."""

    STILL = "still"
    FLIGHT = "free flight"
    SWING = "swing on an arc"
    ROLL = "roll or slide"
    CARRIED = "carried by a hand or another thing"
    SHADOW = "shadow of another object"
    GHOST = "ghost of the background"
    GLINT = "glint or panel on another object"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Motion:
    """What was seen to happen, with the doubt that the other explanations leave.

    Attributes
    ----------
    kind : MotionKind
        The likeliest explanation.
    probability : float
        Its probability beside the other kinds, 0 to 1.
    reasons : tuple of str
        What speaks for it, in whole sentences.
    frames : (2,) tuple of int or None
        First and last frame of `Tracks.ball` to which it applies: the free flight without the
        throw and the bounce, the swing; for a strike and a collision from rest to the end of the
        free motion. None where there is no such stretch.
    alternatives : tuple of (MotionKind, float)
        Every other kind and its probability, likeliest first.
    fall_px : (2,) tuple of float or None
        Acceleration of what falls, px per frame², y down; None where none is sure.
    """

    kind: MotionKind
    probability: float
    reasons: tuple[str, ...] = ()
    frames: tuple[int, int] | None = None
    alternatives: tuple[tuple[MotionKind, float], ...] = ()
    fall_px: tuple[float, float] | None = None


@dataclass(frozen=True)
class PlaceInClip:
    """Where frames that were followed on the camera's even clock are in a clip.

    Attributes
    ----------
    shown : (n,) int array
        Which of them the clip holds, increasing.
    first : int
        The clip's frame that is the first of them.
    started : int
        How many frames after the clip's first, missing ones included, that is.
    count : int
        Number of frames of the clip.
    fps : float
        Frames per second of the camera.
    """

    shown: NDArray[np.int64]
    first: int
    started: int
    count: int
    fps: float

    def held(self, frame: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which of some frames the clip holds."""
        return np.isin(frame, self.shown)

    def frame(self, frame: NDArray[np.int64]) -> NDArray[np.int64]:
        """The clip's own numbers of frames, or of the last ones before them that it holds."""
        row = np.searchsorted(self.shown, frame, side="right") - 1
        return self.first + np.clip(row, 0, len(self.shown) - 1)

    def span(self, frames: tuple[int, int]) -> tuple[int, int]:
        """A first and a last frame in the clip's own numbers."""
        first, last = self.frame(np.array(frames)).tolist()
        return first, last

    def time_s(self, frame: NDArray[np.int64]) -> FloatArray:
        """Times of frames, s from the clip's first."""
        return (frame + self.started) / self.fps

    def each(self, rows: FloatArray) -> FloatArray:
        """Of rows for each frame followed, those for each of the clip; its ends as the nearest."""
        inside = np.clip(np.arange(self.count) - self.first, 0, len(self.shown) - 1)
        return np.asarray(rows[self.shown[inside]])


@dataclass(frozen=True)
class Track:
    """One object followed through the clip. Rows are frames in which it was found, in time order.

    Pixel centres are integers, (0, 0) is the centre of the top-left pixel, y points down.

    Attributes
    ----------
    frame : (N,) int array
        Frame index from 0 in decode order.
    time_s : (N,) array
        Mid-exposure time on the capture clock, s, 0 at frame 0.
    centre_px : (N, 2) array
        Centre of the outline (not yet the projection of the sphere's centre), px.
    covariance_px2 : (N, 2, 2) array
        Covariance of `centre_px`, px².
    bound_px2 : (N, 2, 2) array
        Cramér–Rao bound of the same fit, px².
    radius_px : (N,) array
        Outline radius, px; for the pendulum the size of the mass.
    radius_std_px : (N,) array
        Its standard uncertainty, px.
    quality : (N,) array
        0 (doubtful) to 1 (clean).
    """

    frame: NDArray[np.int64]
    time_s: FloatArray
    centre_px: FloatArray
    covariance_px2: FloatArray
    bound_px2: FloatArray
    radius_px: FloatArray
    radius_std_px: FloatArray
    quality: FloatArray

    def __len__(self) -> int:
        return len(self.frame)

    def where(self, keep: NDArray[np.bool_]) -> Self:
        """Rows for which `keep` (N,) is true."""
        return replace(self, **{name: getattr(self, name)[keep] for name in Track.__annotations__})

    def in_clip(self, place: "PlaceInClip") -> Self:
        """The same track with the clip's own frames."""
        kept = self.where(place.held(self.frame))
        return replace(kept, frame=place.frame(kept.frame), time_s=place.time_s(kept.frame))


@dataclass(frozen=True)
class FollowedObject:
    """A further object that was followed, and what it is.

    Attributes
    ----------
    track : Track
        Where it was.
    model : MotionModel
        How it moves.
    reasons : tuple of str
        Why it is not what was measured, in whole sentences.
    """

    track: Track
    model: MotionModel = MotionModel.UNKNOWN
    reasons: tuple[str, ...] = ()

    @property
    def ball_at(self) -> tuple[int, int, int] | None:
        """x, y (px) and frame at which `--ball-at` points at it: where it was seen most clearly."""
        if len(self.track) == 0:
            return None
        clearest = int(np.argmax(self.track.quality))
        x, y = np.rint(self.track.centre_px[clearest]).astype(int).tolist()
        return x, y, int(self.track.frame[clearest])


@dataclass(frozen=True)
class Face:
    """The striking face at the height of the ball's centre, in one of the frames of the mass.

    Attributes
    ----------
    frame : int
        Frame in which it is there; the others follow from the swing.
    edge_px : (2,) array
        Foremost edge of the mass, px.
    edge_std_px : float
        Its standard uncertainty along the motion, px.
    middle_px : (2,) array or None
        Middle between the near and the far rim of the face, px; None where they can't be told
        apart.
    middle_std_px : float
        Its standard uncertainty along the motion, px.
    spherical : bool
        Whether it is the front of a round bob, whose middle goes in the plane of the ball's.
    """

    frame: int
    edge_px: FloatArray
    edge_std_px: float
    middle_px: FloatArray | None = None
    middle_std_px: float = math.inf
    spherical: bool = False


@dataclass(frozen=True)
class PendulumTrack:
    """The pendulum mass on its arc: a rigid body turning about a fixed pivot, seen in pixels.

    Attributes
    ----------
    track : Track
        The mass: `centre_px` is the centre of its visible outline.
    angle_rad : (N,) array
        Angle about the pivot in the picture, rad, increasing as the mass moves towards the ball;
        0 where the mass hangs straight below the pivot in the picture (along +y).
    angle_std_rad : (N,) array
        Standard uncertainty of each angle from the picture noise, rad.
    pivot_px : (2,) array
        Pivot, px.
    pivot_covariance_px2 : (2, 2) array
        Its covariance, px².
    arm_px : float
        Distance from the pivot to the mass centre, px.
    face : Face
        The striking face.
    zero_std_rad : float
        Standard uncertainty of what all angles are off by together, rad: where the pivot is taken
        to be, and how far the point that is followed lies beside the arm.
    """

    track: Track
    angle_rad: FloatArray
    angle_std_rad: FloatArray
    pivot_px: FloatArray
    pivot_covariance_px2: FloatArray
    arm_px: float
    face: Face
    zero_std_rad: float = 0.0

    def in_clip(self, place: PlaceInClip) -> Self:
        """The same track with the clip's own frames."""
        held = place.held(self.track.frame)
        return replace(
            self,
            track=self.track.in_clip(place),
            angle_rad=self.angle_rad[held],
            angle_std_rad=self.angle_std_rad[held],
            face=replace(self.face, frame=place.span((self.face.frame, self.face.frame))[0]),
        )


@dataclass(frozen=True)
class Tracks:
    """All that was followed in one clip.

    Attributes
    ----------
    ball : Track
        What is measured: the ball that is struck, the thing that flies or falls, the bob that
        swings (`motion` says which).
    pendulum : PendulumTrack or None
        None where no pendulum is in view.
    background : (H, W) float32 array
        The static scene without the moving things, gray levels.
    rest_frames : (2,) tuple of int or None
        First and last frame in which the ball lies still before it is struck; None if it never
        does.
    others : tuple of FollowedObject
        Other things that were followed (a struck puck's striker first, a second ball).
    dismissed : tuple of FollowedObject
        What moved, too, and is taken for no ball, with the reasons: a shadow, a ghost, a hand.
    warnings : tuple of str
        What the user should know, in whole sentences.
    shift_px : (F, 2) array or None
        Hand-held camera: where the scene's points lie in each frame of the clip, relative to the
        scene (all positions above are the scene's); None for a camera that stands still.
    motion : Motion
        What happens in the clip.
    reasons : tuple of str
        Why `ball` is taken for the ball, in whole sentences.
    maybe_shadow : bool
        Whether `ball` may be a shadow instead: it takes an even part of the wall's light.
    lacks : tuple of (int, int)
        Frames of the clip after which so many are lost without a trace in its times: what flies
        tells it.
    """

    ball: Track
    pendulum: PendulumTrack | None
    background: NDArray[np.float32]
    rest_frames: tuple[int, int] | None
    others: tuple[FollowedObject, ...] = ()
    dismissed: tuple[FollowedObject, ...] = ()
    warnings: tuple[str, ...] = ()
    shift_px: FloatArray | None = None
    motion: Motion = Motion(MotionKind.NONE, 0.0)
    reasons: tuple[str, ...] = ()
    maybe_shadow: bool = False
    lacks: tuple[tuple[int, int], ...] = ()

    def on_clock(self, clock: FloatArray) -> FloatArray:
        """Times of the clip's frames (F,), in frames of the camera, lost ones counted."""
        later = np.zeros(len(clock))
        for after, many in self.lacks:
            later[after + 1 :] += many
        return clock + later

    def in_clip(self, place: PlaceInClip) -> Self:
        """The same tracks with the clip's own frames."""
        rest, motion, shift = self.rest_frames, self.motion, self.shift_px
        if motion.frames is not None:
            motion = replace(motion, frames=place.span(motion.frames))
        others, dismissed = (
            tuple(replace(one, track=one.track.in_clip(place)) for one in objects)
            for objects in (self.others, self.dismissed)
        )
        return replace(
            self,
            ball=self.ball.in_clip(place),
            pendulum=None if self.pendulum is None else self.pendulum.in_clip(place),
            rest_frames=None if rest is None else place.span(rest),
            others=others,
            dismissed=dismissed,
            motion=motion,
            shift_px=None if shift is None else place.each(shift),
        )


IntArray = NDArray[np.int64]

_FEWEST = 3
"""Frames: a median of fewer does not leave out one that is wrong."""

_STRETCH = 12

"""Frames: what starts evenly from rest is not yet gone by a radius's eighth in fewer, and twice as
many tell a scatter to a fifth."""


_SLOWEST_PX, _MOST_EACH = 1e-3, 13.0
"""px per frame, below which a flight tells no time; and frames for each radius at most: as many as
a ball of the paper takes at 600 fps, where there are enough."""


@dataclass(frozen=True)
class Rest:
    """The ball lying still.

    Attributes
    ----------
    first, last : int
        First and last frame in which it lies still.
    centre_px : (2,) array
        Where, px.
    direction : (2,) array
        Unit vector in which it leaves.
    speed_px : float
        How fast it goes soon after, px per frame.
    """

    first: int
    last: int
    centre_px: FloatArray
    direction: FloatArray
    speed_px: float

    def frames_along(self, radii: float, radius: float, least: int = 1) -> int:
        """In how many frames, at least so many, the ball flies so many of its radii, px each.

        A stretch of time that is told by how fast things go is the same stretch for a slower
        camera; a faster one, or a slow ball, needs no more frames of it.
        """
        each = min(radius / max(self.speed_px, _SLOWEST_PX), _MOST_EACH)
        return max(least, round(radii * each))


_HOP, _STAYS = 6, 12
"""Frames of a hop at most, and of rest after it at least, supposed: what is struck flies on."""

_HOP_RADII, _HOPPED_STILL = 0.5, 0.1
"""Radii of a hop at least; part of it by which what then lies still stirs, supposed."""


def find_rest(frame: IntArray, centre: FloatArray, radius: float) -> Rest | None:
    """Find a first stretch of rest that ends in motion.

    Parameters
    ----------
    frame : (N,) int array
        Frame indices.
    centre : (N, 2) array
        Ball centres, px.
    radius : float
        Ball radius, px.

    Returns
    -------
    Rest or None
        None if the ball moves from the start, or never leaves.
    """
    if len(frame) < 2 * _FEWEST:
        return None
    departure = _departure(centre, radius)
    if departure is None:
        return None
    settled = _settled(centre, departure, radius)
    if settled is not None:
        # What lay there was another thing, a shadow say, or was put elsewhere by hand.
        return find_rest(frame[settled:], centre[settled:], radius)
    if departure < _FEWEST:
        return None
    resting = _latest_rest(centre, departure)
    place = np.median(resting, axis=0)
    scatter = 1.4826 * np.median(np.hypot(*(resting - place).T))
    tolerance = max(4.0 * float(scatter), 0.003 * radius + 0.05)
    still = np.hypot(*(centre[:departure] - place).T) <= tolerance
    last = int(np.nonzero(still)[0][-1]) if np.any(still) else departure - 1
    after = slice(departure, min(departure + 12, len(frame)))
    if after.stop - after.start < 2:
        return None
    run = centre[after][-1] - centre[after][0]
    elapsed = float(frame[after][-1] - frame[after][0])
    length = float(np.hypot(*run))
    if length < 1e-6:
        return None
    return Rest(int(frame[0]), int(frame[last]), place, run / length, length / elapsed)


def _settled(centre: FloatArray, departure: int, radius: float) -> int | None:
    """Row from which it lies still again, a hop from where it lay; None where it moves on."""
    if departure == 0:
        return None
    for row in range(departure + 1, min(departure + _HOP, len(centre) - _STAYS) + 1):
        place = np.median(centre[row : row + _STAYS], axis=0)
        stirred = float(np.hypot(*(centre[row : row + _STAYS] - place).T).max())
        hopped = float(np.hypot(*(place - np.median(centre[:departure], axis=0))))
        if hopped > _HOP_RADII * radius and stirred < _HOPPED_STILL * hopped:
            return row
    return None


def _latest_rest(centre: FloatArray, departure: int) -> FloatArray:
    """Places that tell where the ball lies, and how far they stray.

    The latest before it starts: earlier ones may be off together, where a thing stood beside the
    ball, or agree too well, where a recording begins with copies of one picture.
    """
    if departure < 2 * _STRETCH:
        return centre[:departure]
    return centre[max(0, departure - 3 * _STRETCH) : departure - _STRETCH]


def _departure(centre: FloatArray, radius: float) -> int | None:
    """Row at which the ball leaves for good: it goes a radius away without coming back first.

    A few bad fits, while something passes in front or beside, are no departure, and neither are
    bad ones at the start: where the ball dwells for most of that time is where it lies.
    """
    start = np.median(centre[:_FEWEST], axis=0)
    far = np.flatnonzero(np.hypot(*(centre - start).T) > radius)
    if len(far) == 0:
        return None
    if far[0] == 0:
        return 0
    before = centre[: far[0]]
    tolerance = 0.12 * radius + 0.3
    departure = 0
    for place in (start, np.median(before, axis=0)):
        near = np.flatnonzero(np.hypot(*(before - place).T) <= tolerance)
        if len(near) and len(near) > 0.5 * (near[-1] + 1):
            departure = max(departure, int(near[-1]) + 1)
    return departure
