"""Tracks of ball and pendulum in pixels, the kind of motion, and the ball's rest."""

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from vision.finding.selection import FoundObjects

__all__ = [
    "Face",
    "FollowedObject",
    "Motion",
    "MotionKind",
    "MotionModel",
    "PendulumTrack",
    "Rest",
    "Track",
    "Tracks",
    "find_rest",
]

FloatArray = NDArray[np.float64]


class MotionKind(Enum):
    """What happens in a clip."""

    STRIKE = "strike"
    """A ball at rest is struck by a pendulum and flies."""
    FLIGHT = "flight"
    """An object flies freely and is struck by nothing in the clip: thrown, launched."""
    DROP = "drop"
    """An object falls freely from rest, straight down."""
    SWING = "swing"
    """An object swings on an arc and strikes nothing."""
    COLLISION = "collision"
    """One of two equal balls hits the other at rest and sets it in motion."""
    BOUNCE = "bounce"
    """An object falls freely and bounces; its release is not in view."""
    ROLL = "roll"
    """An object moves along a straight line at constant acceleration: it rolls."""
    SLIDE = "slide"
    """The same, without rolling."""
    CIRCLE = "circle"
    """An object turns at a constant rate."""
    CARRIED = "carried"
    """An object follows a smooth path of any shape, as a hand moves it."""
    NONE = "none"
    """No motion that any of these explains."""

    @property
    def noun(self) -> str:
        """The kind as a noun."""
        return "carried motion" if self is MotionKind.CARRIED else str(self.value)


class MotionModel(Enum):
    """Motion model of a tracked object, or what it is instead of an object."""

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
    """The kind of motion and its probability.

    Attributes
    ----------
    kind : MotionKind
        The most probable kind.
    probability : float
        Its probability among the kinds, 0 to 1; once the object is known, that object and kind are
        right.
    reasons : tuple of str
        The evidence, in whole sentences.
    frames : (2,) tuple of int or None
        First and last frame of `Tracks.ball` to which it applies: the free flight without throw
        and bounce, the swing; for a strike and a collision from the end of the rest to that of the
        free motion.
        None if there is no such interval.
    alternatives : tuple of (MotionKind, float)
        Every other kind and its probability, most probable first.
    fall_px : (2,) tuple of float or None
        Acceleration of free fall, px per frame², y down; None where there is no certain one.
    events : tuple of (str, int)
        What happens and its frame, in order: "release", "contact", "bounce", "landing", "stop".
    given : bool
        Whether a person states the kind.
    """

    kind: MotionKind
    probability: float
    reasons: tuple[str, ...] = ()
    frames: tuple[int, int] | None = None
    alternatives: tuple[tuple[MotionKind, float], ...] = ()
    fall_px: tuple[float, float] | None = None
    events: tuple[tuple[str, int], ...] = ()
    given: bool = False

    def of_object(self, probability: float) -> "Motion":
        """The same where it is the right object with a probability: then only is a kind right."""
        rest = tuple((kind, share * probability) for kind, share in self.alternatives)
        return replace(self, probability=self.probability * probability, alternatives=rest)

    @property
    def measured_probability(self) -> float:
        """Probability of a kind with the same quantities: free falls are all alike."""
        alike = sum(part for kind, part in self.alternatives if {kind, self.kind} <= _FALLS)
        return self.probability + alike

    @property
    def is_doubtful(self) -> bool:
        """Whether it is more probably no such motion, and nobody states it."""
        return not self.given and self.measured_probability < _MIN_MEASURED

    @property
    def measured_as(self) -> MotionKind:
        """The kind whose quantities are measured: a bounce's arcs are flights; of some none are."""
        if self.is_doubtful:
            return MotionKind.NONE
        if self.kind is MotionKind.BOUNCE:
            return MotionKind.FLIGHT
        return self.kind if self.kind not in _UNMEASURED else MotionKind.NONE


_FALLS = {MotionKind.FLIGHT, MotionKind.DROP, MotionKind.BOUNCE}

_MIN_MEASURED = 0.5
"""Probability of object and kind from which its quantities are given. Convention."""

_UNMEASURED = (MotionKind.CIRCLE, MotionKind.CARRIED)
"""Kinds of motion that are recognised but of which no quantity is measured."""


@dataclass(frozen=True)
class PlaceInClip:
    """Map frame numbers of the camera's even clock to those of a clip.

    Attributes
    ----------
    shown : (n,) int array
        Those that the clip contains, increasing.
    first : int
        The clip's frame that is the first of them.
    started : int
        Its number from the clip's first frame, missing frames included.
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
        """Whether the clip contains each frame."""
        return np.isin(frame, self.shown)

    def frame(self, frame: NDArray[np.int64]) -> NDArray[np.int64]:
        """Frame numbers in the clip, or of the last frame before them that it contains."""
        row = np.searchsorted(self.shown, frame, side="right") - 1
        return self.first + np.clip(row, 0, len(self.shown) - 1)

    def span(self, frames: tuple[int, int]) -> tuple[int, int]:
        """First and last frame in the clip's numbering."""
        first, last = self.frame(np.array(frames)).tolist()
        return first, last

    def time_s(self, frame: NDArray[np.int64]) -> FloatArray:
        """Times of frames, s from the clip's first."""
        return (frame + self.started) / self.fps

    def each(self, rows: FloatArray) -> FloatArray:
        """Rows of each tracked frame, taken for each frame of the clip; its ends repeat."""
        inside = np.clip(np.arange(self.count) - self.first, 0, len(self.shown) - 1)
        return np.asarray(rows[self.shown[inside]])


@dataclass(frozen=True)
class Track:
    """Track of one object. Rows are frames in which it was found, in time order.

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
        Its standard uncertainty, px; infinite if the radius was not observed.
    quality : (N,) array
        0 (unreliable) to 1 (clean).
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

    @property
    def sized(self) -> bool:
        """Whether the radius was observed."""
        return bool(np.isfinite(self.radius_std_px).all())

    def where(self, keep: NDArray[np.bool_]) -> Self:
        """Rows for which `keep` (N,) is true."""
        return replace(self, **{name: getattr(self, name)[keep] for name in Track.__annotations__})

    def in_clip(self, place: "PlaceInClip") -> Self:
        """The same track with the clip's frame numbers."""
        kept = self.where(place.held(self.frame))
        return replace(kept, frame=place.frame(kept.frame), time_s=place.time_s(kept.frame))


@dataclass(frozen=True)
class FollowedObject:
    """A further tracked object.

    Attributes
    ----------
    track : Track
        Its track.
    model : MotionModel
        Its motion model.
    reasons : tuple of str
        Why it is not the measured object, in whole sentences.
    """

    track: Track
    model: MotionModel = MotionModel.UNKNOWN
    reasons: tuple[str, ...] = ()

    @property
    def ball_at(self) -> tuple[int, int, int] | None:
        """x, y (px) and frame for `--ball-at` to select it: its frame of highest quality."""
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
        Frame it refers to; the others follow from the swing.
    edge_px : (2,) array
        Foremost edge of the mass, px.
    edge_std_px : float
        Its standard uncertainty along the motion, px.
    middle_px : (2,) array or None
        Middle between the near and the far rim of the face, px; None where they can't be
        distinguished.
    middle_std_px : float
        Its standard uncertainty along the motion, px.
    spherical : bool
        Whether it is the front of a round bob, whose middle moves in the plane of the ball's.
    """

    frame: int
    edge_px: FloatArray
    edge_std_px: float
    middle_px: FloatArray | None = None
    middle_std_px: float = math.inf
    spherical: bool = False


@dataclass(frozen=True)
class PendulumTrack:
    """The pendulum mass on its arc: a rigid body rotating about a fixed pivot, in pixels.

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
        Standard uncertainty common to all angles, rad: from the position of the pivot, and from
        the offset of the tracked point from the arm.
    seen_pivot : (array, array) or None
        Pivot (2,), px, and covariance (2, 2), px², by the path, where a person stated another.
    """

    track: Track
    angle_rad: FloatArray
    angle_std_rad: FloatArray
    pivot_px: FloatArray
    pivot_covariance_px2: FloatArray
    arm_px: float
    face: Face
    zero_std_rad: float = 0.0
    seen_pivot: tuple[FloatArray, FloatArray] | None = None

    def about(self, pivot_px: FloatArray, std_px: float) -> Self:
        """The same track about a pivot (2,) that a person stated, px."""
        offset = self.track.centre_px - pivot_px
        before = self.track.centre_px[:, 0] - self.pivot_px[0]
        sign = -1.0 if before @ np.sin(self.angle_rad) < 0.0 else 1.0
        return replace(
            self,
            angle_rad=np.unwrap(np.arctan2(sign * offset[:, 0], offset[:, 1])),
            pivot_px=pivot_px,
            pivot_covariance_px2=std_px**2 * np.eye(2),
            arm_px=float(np.hypot(*offset.T).mean()),
            seen_pivot=(self.pivot_px, self.pivot_covariance_px2),
        )

    def in_clip(self, place: PlaceInClip) -> Self:
        """The same track with the clip's frame numbers."""
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
    """All tracks of one clip.

    Attributes
    ----------
    ball : Track
        The measured object: the ball that is struck, the object that flies or falls, the bob that
        swings (see `motion`).
    pendulum : PendulumTrack or None
        None where no pendulum is in view.
    background : (H, W) float32 array
        The static scene without moving objects, gray levels.
    rest_frames : (2,) tuple of int or None
        First and last frame of the ball's rest before it is struck; None without one.
    others : tuple of FollowedObject
        Other tracked objects (a struck puck's striker first, a second ball).
    dismissed : tuple of FollowedObject
        Rejected candidates for the ball, with reasons: a shadow, a ghost, a hand.
    warnings : tuple of str
        Warnings for the user, in whole sentences.
    shift_px : (F, 2) array or None
        Hand-held camera: position of the scene's points in each frame of the clip, relative to the
        scene (all positions above are the scene's); None for a fixed camera.
    motion : Motion
        The kind of motion.
    reasons : tuple of str
        Why `ball` was selected, in whole sentences.
    lacks : tuple of (int, int)
        Dropped frames that the time stamps do not show, detected from the flight: frame of the
        clip after which they are missing, and their number.
    found : FoundObjects or None
        Detections and tracklets from which they were made; None for tracks of another program.
    landing_px : (2,) array or None
        Where a person states that the ball's centre lands, px.
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
    lacks: tuple[tuple[int, int], ...] = ()
    found: "FoundObjects | None" = None
    landing_px: FloatArray | None = None

    def on_clock(self, clock: FloatArray) -> FloatArray:
        """Times of the clip's frames (F,) in camera frames, dropped ones included."""
        later = np.zeros(len(clock))
        for after, many in self.lacks:
            later[after + 1 :] += many
        return clock + later

    def in_clip(self, place: PlaceInClip) -> Self:
        """The same tracks with the clip's frame numbers."""
        rest, motion, shift = self.rest_frames, self.motion, self.shift_px
        if motion.frames is not None:
            motion = replace(motion, frames=place.span(motion.frames))
        events = tuple((name, place.span((at, at))[0]) for name, at in motion.events)
        motion = replace(motion, events=events)
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
            found=None if self.found is None else self.found.in_clip(place),
        )


IntArray = NDArray[np.int64]

_MIN_REST_FRAMES = 3
"""Minimum number of frames (derived: a median of fewer does not exclude an outlier)."""

_DEPARTURE_MARGIN = 12
"""Frames before departure that are not used for the rest position (chosen): a constant acceleration
moves by an eighth of a radius or more in longer times. Twice as many determine a standard deviation
to a fifth (derived)."""


_MIN_SPEED_PX, _MAX_FRAMES_PER_RADIUS = 1e-3, 13.0
"""Minimum speed, px per frame, and maximum number of frames per radius of motion (derived: the ball
of Ryu et al. at 600 fps)."""


@dataclass(frozen=True)
class Rest:
    """The ball at rest.

    Attributes
    ----------
    first, last : int
        First and last frame of the rest.
    centre_px : (2,) array
        Position, px.
    direction : (2,) array
        Unit vector of the departure.
    speed_px : float
        Speed soon after departure, px per frame.
    """

    first: int
    last: int
    centre_px: FloatArray
    direction: FloatArray
    speed_px: float

    def frames_along(self, radii: float, radius: float, least: int = 1) -> int:
        """Number of frames, at least `least`, in which the ball moves by so many of its radii, px.

        An interval defined by the motion has the same duration at a lower frame rate; a higher
        one, or a slow ball, needs no more frames.
        """
        each = min(radius / max(self.speed_px, _MIN_SPEED_PX), _MAX_FRAMES_PER_RADIUS)
        return max(least, round(radii * each))


_MAX_DISPLACEMENT_FRAMES, _MIN_REST_AFTER = 6, 12
"""Maximum frames of a displacement at rest, and minimum frames of the rest after it (chosen): a
struck ball flies on."""

_MIN_DISPLACEMENT_RADII, _MAX_RELATIVE_MOTION = 0.5, 0.1
"""Minimum displacement, radii; and maximum motion after it, fraction of it (chosen)."""


def find_rest(frame: IntArray, centre: FloatArray, radius: float) -> Rest | None:
    """Find a first interval of rest that ends in motion.

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
    if len(frame) < 2 * _MIN_REST_FRAMES:
        return None
    departure = _departure(centre, radius)
    if departure is None:
        return None
    settled = _settled(centre, departure, radius)
    if settled is not None:
        # It was another object, such as a shadow, or was displaced by hand.
        return find_rest(frame[settled:], centre[settled:], radius)
    if departure < _MIN_REST_FRAMES:
        return None
    resting = _latest_rest(centre, departure)
    place = np.median(resting, axis=0)
    last = _last_still(frame, centre - place, departure)
    after = slice(departure, min(departure + 12, len(frame)))
    if after.stop - after.start < 2:
        return None
    run = centre[after][-1] - centre[after][0]
    elapsed = float(frame[after][-1] - frame[after][0])
    length = float(np.hypot(*run))
    if length < 1e-6:
        return None
    return Rest(int(frame[0]), int(frame[last]), place, run / length, length / elapsed)


def _last_still(frame: IntArray, away: FloatArray, departure: int) -> int:
    """Row of the last frame of rest: a push that lasts for some frames begins there.

    It is the beginning and the duration of a uniform acceleration, after which the ball goes on
    evenly, for which the squares about it are least.
    """
    near = slice(max(departure - _PUSH_ROWS, 0), departure + _PUSH_ROWS)
    time, place = frame[near].astype(np.float64), away[near]
    rows = np.arange(near.start, departure)
    since = np.maximum(time - frame[rows][:, None], 0.0)[:, None]
    lasts = _PUSH_FRAMES[None, :, None]
    path = np.where(since < lasts, since**2 / (2.0 * lasts), since - 0.5 * lasts)
    # of squares about a path along its velocity, what the velocity explains is missing
    explained = np.sum((path @ place) ** 2, axis=2) / np.maximum((path**2).sum(axis=2), 1e-12)
    return int(rows[np.unravel_index(np.argmax(explained), explained.shape)[0]])


_PUSH_ROWS = 24
"""Rows before and after the departure that are compared. Convention: contact and some flight."""

_PUSH_FRAMES = np.append(1e-3, np.geomspace(1.0, 32.0, 11))
"""Durations of a push that are tried, frames: a blow, and steps of a half. Convention."""


def _settled(centre: FloatArray, departure: int, radius: float) -> int | None:
    """Row from which it is at rest again after a small displacement; None if it moves on."""
    if departure == 0:
        return None
    for row in range(
        departure + 1, min(departure + _MAX_DISPLACEMENT_FRAMES, len(centre) - _MIN_REST_AFTER) + 1
    ):
        place = np.median(centre[row : row + _MIN_REST_AFTER], axis=0)
        stirred = float(np.hypot(*(centre[row : row + _MIN_REST_AFTER] - place).T).max())
        hopped = float(np.hypot(*(place - np.median(centre[:departure], axis=0))))
        if hopped > _MIN_DISPLACEMENT_RADII * radius and stirred < _MAX_RELATIVE_MOTION * hopped:
            return row
    return None


def _latest_rest(centre: FloatArray, departure: int) -> FloatArray:
    """Positions that determine the rest position and its standard deviation.

    The latest before departure: earlier ones may share an error, if an object was next to the
    ball, or agree too well, if a recording begins with copies of one picture.
    """
    if departure < 2 * _DEPARTURE_MARGIN:
        return centre[:departure]
    return centre[max(0, departure - 3 * _DEPARTURE_MARGIN) : departure - _DEPARTURE_MARGIN]


def _departure(centre: FloatArray, radius: float) -> int | None:
    """Row at which the ball leaves for good: it moves by a radius without returning first.

    A few bad fits, when something passes in front, are no departure, and neither are bad ones at
    the start: the rest position is where the ball is most of the time.
    """
    start = np.median(centre[:_MIN_REST_FRAMES], axis=0)
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
