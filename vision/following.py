"""From a clip to tracks without a click: static scene, what moved before it, ball, pendulum."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from metrology import NotFoundError
from metrology.compiled import map_in_threads
from vision.ball.ball import (
    SMALL_RADIUS,
    BallFits,
    follow_ball,
    outlines_near,
    trusted_rows,
)
from vision.ball.choice import (
    LEFT_AS_ONE,
    SHADES,
    BallPath,
    Choice,
    Way,
    apart,
    approach,
    cast_by,
    choose_ball,
    described,
    encloses,
    lay_before,
    link_circles,
    path_score,
    rivals,
    uncovered,
    untangled,
)
from vision.ball.circles import Circles, find_circles
from vision.ball.courses import LawfulCourse, bends_up, lawful_course
from vision.ball.leaving import discs_along, left_at_last
from vision.ball.outline import joined
from vision.ball.refine import refine_ball
from vision.ball.silhouette import follow_silhouette, moving_colours
from vision.clip.footage import Footage
from vision.lost import LostFrames, lost_frames
from vision.motions.motion import interpret_tracks
from vision.pendulum.face import Striking
from vision.pendulum.search import Striker, find_striker, pendulum_track
from vision.scene import FilmedScene, SceneKnown
from vision.tracks import (
    FollowedObject,
    MotionKind,
    MotionModel,
    PendulumTrack,
    PlaceInClip,
    Rest,
    Track,
    Tracks,
    find_rest,
)

if TYPE_CHECKING:
    from vision.clip.clip import ClipReader

__all__ = ["follow"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
IntArray = NDArray[np.int64]
Point = tuple[float, float] | tuple[float, float, int]

# Frames looked at over the whole action, at first and at most.
_LOOKS = 48
_MOST_LOOKS = 256
"""Frames looked at over the whole action at most: more only cost time."""
# Between looks a thing goes no further, and turns off its way by no more, in radii, if more looks
# can help it; one that went so far when it was lost is looked for nearby.
_LONGEST_STEP, _LONGEST_TURN, _LOST_STEP = 2.5, 0.35, 0.2
_MOST_CLOSER = 150
"""Frames that are looked at more closely: more only cost time, since a path needs few."""
# An outline of which less stands out than this part of the usual is looked at again; what is found
# further away, in radii, is something else.
_CLEAR, _ELSEWHERE = 0.6, 0.3
_FEWEST_ROWS = 3
"""Frames in which a ball is found at least: fewer tell no motion."""
_LEAST_WORTH = 20.0
"""Nats, weighed by how clear it is, from which on no colour is asked: balls of clips in which they
stand out from the wall have 60 to 330, shadows and parts of a pendulum taken for one 3 to 20."""
_ALL_ALONG = 0.95
"""Part of the frames from the clip's first to the end of the law that a rest and a law explain,
those that the file lacks left aside: less leaves doubt where it lay, or whether it is one thing.
"""
_TELLING = 10.0
"""Nats by which one course is the likelier whatever else speaks for either, supposed."""
_FEWEST_STILL = 5
"""Frames at rest that a scene as the clip begins must show: what goes on from the first frame to
the last, as a pendulum does, is seen no better in it."""
_LEAST_BOW_PX = 1.0
"""px by which a way bows from a line at least to tell an arc: looks err by half of that."""
_STRAIGHTER = 0.2
"""Of that bow, what a way that is no arc bows by at most, supposed: a part of a mass that turns as
it comes, looked at as a circle, was seen to bow by 0.4 of what it does."""
_NOT_MET = (MotionKind.NONE, MotionKind.SWING)
"""Kinds of motion before which nothing lay still to be met, unless what met it was surely seen."""
_LEFT_TRIED = 3
"""Things that left that are followed at most: a ball and shadows of it are among the first."""
_AS_GOOD = 0.5
"""Share of the score of what is unclear in gray from which what is clear in colour is taken, and of
the lawful frames of a shadow in which what casts it is seen to fly."""
_SHADE_LOOKS, _INNER_PART, _FEWEST_SHADED, _LEAST_LIT = 7, 0.6, 8, 8.0
"""Looks at a thing that may be a shadow; part of its radius inside its soft rim; pixels, and gray
levels of the wall, from which a part of the light can be told; supposed."""
_EVEN = 2.0
"""Scatter of the light that a shadow leaves, over that of noise: of a shaded ball it is nine and
more in rooms drawn at random, three for a white ball before a white wall."""
_CAST_SIZE = (0.75, 2.0)
"""Radii of a shadow over those of what casts it: a lamp as far before it as the wall is behind it
doubles it, a camera near by sees it smaller, and its soft rim may be lost; supposed."""
_MORE_EVEN = 1.5
"""Times that what casts a shadow is less even than it, supposed: in rooms drawn at random balls
were so by 10 to 80 of their noise, and their shadows by 2 to 16."""
_NEARLY_ALL, _WHOLE, _STEADY_SIZE = 0.8, 0.75, 0.03
"""Share of the frames, share of the outline, and scatter of its log radius from frame to frame, of
what is seen clearly in gray, supposed: colour is looked at where one of them fails."""
_AGAIN = 2
"""Rounds of looking where the ball was not found along its way."""
_MOST_LEAPS = 3
"""Times that a clip is followed anew where it lacks frames, the last for one side of them alone."""
_OTHERS_FOLLOWED = 3.0
"""Times the frames of the clip in which other things are followed as finely as the ball: three of
them, or more where each is seen for a part of it; more only cost time."""


def follow(
    clip: "ClipReader",
    capture_fps: float,
    *,
    ball_at: Point | None = None,
    mass_at: Point | None = None,
    progress: Callable[[float], None] | None = None,
) -> Tracks:
    """Find and follow the ball and the pendulum mass through a clip.

    Parameters
    ----------
    clip : ClipReader
        The clip.
    capture_fps : float
        Frames per second at which it was recorded.
    ball_at : tuple, optional
        x, y (px) and, if wanted, frame of a point on the ball, where the automatic choice is wrong.
    mass_at : tuple, optional
        The same for the pendulum mass, just before contact.
    progress : callable, optional
        Called with the part done, 0 to 1.

    Returns
    -------
    Tracks

    Raises
    ------
    NotFoundError
        If nothing round moves in the clip, or nothing where the user points.
    """
    recording = _one_scene(clip, ball_at or mass_at)
    for looks_left in range(_MOST_LEAPS, -1, -1):
        footage = recording.footage
        tracks, scene, seen = _followed_in(recording, capture_fps, ball_at, mass_at, progress)
        others = [other.track for other in tracks.others]
        lost = lost_frames(seen, others, tracks.pendulum)
        if lost is None or not looks_left:
            break
        lost = _leap_in(scene, lost, seen)
        if lost.sure and looks_left > 1:
            recording = recording.lacking(clip, lost)
        else:
            recording = recording.beside(clip, lost, _left_in((seen, *others)))
    first, started, whole = footage.first, footage.started, recording.whole
    place = PlaceInClip(footage.shown, first, started, whole, capture_fps)
    return replace(tracks.in_clip(place), lacks=recording.lacks)


@dataclass(frozen=True)
class _Recording:
    """The part of a clip that is followed.

    Attributes
    ----------
    footage : Footage
    whole : int
        Number of frames of the clip.
    part : tuple of int
        First frame, and the one after the last, of that part.
    lacks : tuple of (int, int)
        Frames of the clip after which so many are lost without a trace.
    said : tuple of str
        What is to be said of it.
    """

    footage: Footage
    whole: int
    part: tuple[int, int]
    lacks: tuple[tuple[int, int], ...] = ()
    said: tuple[str, ...] = ()

    def lacking(self, clip: "ClipReader", lost: LostFrames) -> "_Recording":
        """The same with lost frames counted."""
        lacks = (*self.lacks, (self.footage.in_clip(lost.after), lost.count))
        said = (*self.said, f"{self._leap(lost)}, which are counted as lost there.")
        footage = Footage(clip, part=self.part, lacks=lacks)
        return replace(self, footage=footage, lacks=lacks, said=said)

    def beside(self, clip: "ClipReader", lost: LostFrames, left: int | None) -> "_Recording":
        """One side of lost frames alone: where a thing left its rest, or else more moves."""
        after = self.footage.in_clip(lost.after)
        sides = ((self.part[0], after + 1), (after + 1, self.part[1]))
        part = max(sides, key=self.footage.moved_in)
        if left is not None:
            part = sides[0] if self.footage.in_clip(left) <= after else sides[1]
        lacks = tuple(one for one in self.lacks if part[0] <= one[0] < part[1] - 1)
        only = (
            f"{self._leap(lost)}, or so: how many can't be told surely. Only frames {part[0]} to "
            f"{part[1] - 1} are measured."
        )
        footage, said = Footage(clip, part=part, lacks=lacks), (*self.said, only)
        return _Recording(footage, self.whole, part, lacks, said)

    def _leap(self, lost: LostFrames) -> str:
        after = self.footage.in_clip(lost.after)
        return (
            f"FRAMES ARE MISSING between frames {after} and {after + 1} of the file, and its times "
            f"don't tell: all that moves leaps on as far as in {lost.count} frames"
        )


def _left_in(tracks: Sequence[Track]) -> int | None:
    """The frame in which the first of some tracks that lay still left its rest."""
    for track in tracks:
        rest = find_rest(track.frame, track.centre_px, float(np.median(track.radius_px)))
        if rest is not None:
            return rest.last
    return None


def _leap_in(scene: FilmedScene, lost: LostFrames, ball: Track) -> LostFrames:
    """Where the picture changes most about the ball between two laws, frames are missing."""
    frames = np.arange(lost.after, lost.before + 1)
    near = np.interp([lost.after, lost.before], ball.frame, np.arange(len(ball))).astype(int)
    reach = 2.0 * float(np.median(ball.radius_px))
    places = ball.centre_px[near[0] : near[1] + 1]
    low = np.clip(places.min(axis=0) - reach, 0, np.array(scene.shape[::-1]) - 2).astype(int)
    high = np.maximum(places.max(axis=0) + reach, low + 2).astype(int)
    window = (slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0])))
    pictures = [picture[window] for _, picture in scene.pictures(frames)]
    change = [float(np.abs(late - early).mean()) for early, late in pairwise(pictures)]
    return replace(lost, after=lost.after + int(np.argmax(change)))


def _followed_in(
    recording: _Recording,
    capture_fps: float,
    ball_at: Point | None,
    mass_at: Point | None,
    progress: Callable[[float], None] | None,
) -> tuple[Tracks, FilmedScene, Track]:
    """Follow ball and pendulum through a recording; the scene, and every place the ball is seen.

    All in the recording's own frames.
    """
    footage = recording.footage
    scene = FilmedScene(footage)
    _tell(progress, 0.2)
    seen = _seen(scene, _located(ball_at, footage))
    if seen is None:
        raise _no_ball(ball_at)
    scene = seen.scene
    choice, rough = seen.choice, seen.rough
    _tell(progress, 0.6)
    rest = find_rest(rough.frame, rough.centre, float(np.median(rough.radius)))
    striker = None
    if rest is not None:
        # What lay elsewhere until then was another thing.
        rough = rough.at(rough.frame >= rest.first)
        striker = _striker(scene, rest, rough, mass_at)
    choice, striker = _what_struck(choice, striker, pointed_at=mass_at is not None)
    seen = replace(seen, choice=choice)
    _tell(progress, 0.8)
    if seen.tinted is None:
        fits = refine_ball(scene, rough, None if striker is None else striker.mass.hides)
    else:
        fits = rough
    _tell(progress, 1.0)
    ball = _track(fits, capture_fps)
    rest_frames = None if rest is None else _still_until(rest, fits)
    others = _others(seen, capture_fps)
    came = others[0].track if choice.struck and others else None
    pendulum = _pendulum(striker, rest, capture_fps)
    motion = interpret_tracks(ball, pendulum, came)
    if motion.kind is MotionKind.SWING:
        # What seemed to lie still was at its turning point.
        rest_frames = None
    if motion.kind in _NOT_MET and striker is not None and not striker.surely_struck:
        striker, pendulum = None, None
    tracks = Tracks(
        ball=ball,
        pendulum=pendulum,
        background=scene.background.image,
        rest_frames=rest_frames,
        others=others,
        dismissed=_dismissed(seen.picture, choice, capture_fps),
        warnings=tuple(
            list(recording.said)
            + _warnings(choice, motion.kind, rest, striker, footage)
            + seen.warnings
            + _camera_warnings(scene, footage)
        ),
        shift_px=scene.shifts(),
        motion=motion,
        reasons=choice.reasons,
        maybe_shadow=seen.only_dims,
    )
    seen_at = fits if seen.tinted is not None else _with_gaps(scene, fits)
    return tracks, scene, _track(seen_at, capture_fps)


def _with_gaps(scene: FilmedScene, fits: BallFits) -> BallFits:
    """The same with outlines between them, wherever they lie: a leap makes all about it strays."""
    every = np.arange(int(fits.frame[0]), int(fits.frame[-1]) + 1)
    missed = scene.shown(np.setdiff1d(every, fits.frame))
    if len(missed) == 0:
        return fits
    guess = np.column_stack(
        [np.interp(missed, fits.frame, fits.centre[:, axis]) for axis in (0, 1)]
    )
    more = BallFits(missed, outlines_near(scene, float(np.median(fits.radius)), missed, guess))
    more = more.at(more.fits.found)
    order = np.argsort(np.concatenate([fits.frame, more.frame]), kind="stable")
    frame = np.concatenate([fits.frame, more.frame])
    return BallFits(frame, joined([fits.fits, more.fits])).at(order)


def _striker(scene: FilmedScene, rest: Rest, rough: BallFits, at: Point | None) -> Striker | None:
    """What struck the ball, in gray; where nothing shows there, in the colours of what moves.

    Against what the first frames show a mass is whole that hangs for long where most frames show
    it. A mass that is small beside the ball is looked for last.
    """
    found = find_striker(scene, rest, rough, at)
    if found is None or not found.surely_struck:
        begun = scene.as_it_began()
        other = None if begun is None else find_striker(begun, rest, rough, at)
        if other is not None and other.surely_struck:
            return other
    if found is not None:
        return found
    colours = [scene.tinted(float(blue), float(red)) for blue, red in moving_colours(scene)]
    for small, pictures in ((False, colours), (True, [scene, *colours])):
        for picture in pictures:
            found = find_striker(picture, rest, rough, at, small=small)
            if found is not None and found.striking is Striking.AGREES:
                return found
    return None


def _what_struck(
    choice: Choice, striker: Striker | None, *, pointed_at: bool
) -> tuple[Choice, Striker | None]:
    """Whether a ball or what swings struck: a ball that came to the other may only pass by."""
    if striker is None:
        return choice, None
    if pointed_at:
        return replace(choice, struck=False), striker
    if any(_came_straight(other, choice, striker) for other in (*choice.others, *choice.dismissed)):
        return choice, None
    if not choice.struck or striker.surely_struck:
        return replace(choice, struck=False), striker
    return choice, None


def _came_straight(other: BallPath, choice: Choice, striker: Striker) -> bool:
    """Whether what struck is a round thing that came straighter than on an arc as it has.

    Such an arc may hang on a few frames in which a hand was followed with the thing.
    """
    mass = striker.mass
    length, sagitta = approach(choice.ball, other)
    bow = length**2 / (8.0 * mass.arc.radius_px)
    if bow < _LEAST_BOW_PX or sagitta > _STRAIGHTER * bow:
        return False
    away = apart(other, Way(mass.frame, mass.anchor, other.radius))
    return len(away) >= _FEWEST_ROWS and float(np.median(away)) < other.radius


def _still_until(rest: Rest, fits: BallFits) -> tuple[int, int]:
    """First and last frame of rest; beside the mass only fits that know of it tell how long."""
    radius = float(np.median(fits.radius))
    finer = find_rest(fits.frame, fits.centre, radius)
    if finer is None or np.hypot(*(finer.centre_px - rest.centre_px)) > _ELSEWHERE * radius:
        return rest.first, rest.last
    return rest.first, finer.last


def _one_scene(clip: "ClipReader", at: Point | None) -> _Recording:
    """The scene pointed at, or in which most moves."""
    footage = Footage(clip)
    if len(footage.parts) == 1:
        return _Recording(footage, footage.whole_count, footage.parts[0])
    chosen = max(footage.parts, key=footage.moved_in)
    if at is not None and len(at) == 3:
        frame = at[2]
        chosen = next((part for part in footage.parts if part[0] <= frame < part[1]), chosen)
    cuts = ", ".join(f"{part[0] - 1} and {part[0]}" for part in footage.parts[1:])
    said = (
        f"The clip is cut between frames {cuts}: another scene follows. Only frames {chosen[0]} to "
        f"{chosen[1] - 1} are measured; cut the others out and measure them by themselves, or "
        "point into one with --ball-at X,Y,FRAME."
    )
    return _Recording(Footage(clip, part=chosen), footage.whole_count, chosen, said=(said,))


def _others(seen: "_Seen", fps: float) -> tuple[FollowedObject, ...]:
    """What else is round and moves; the first few as finely as the ball itself."""
    scene, choice = seen.picture, seen.choice
    tracks: list[FollowedObject] = []
    left = _OTHERS_FOLLOWED * scene.count
    for place, path in enumerate(choice.others):
        if any(_is_once_more(_path_track(path, fps), told.track) for told in tracks):
            continue
        left -= float(np.ptp(path.frame)) + 1.0
        fits = seen.fits_along(path) if left >= 0.0 else None
        if fits is not None and len(fits.frame) >= 5:
            track = _track(fits, fps)
        else:
            track = _path_track(path, fps)
        if any(_is_once_more(track, told.track) for told in tracks):
            continue
        if choice.struck and place == 0:
            met = ("It came to the one that lay still and met it.",)
            tracks.append(FollowedObject(track, MotionModel.ROLL, met))
        else:
            label = described(path, choice.ball, scene.background.image)
            tracks.append(FollowedObject(track, *label))
    return tuple(tracks)


def _is_once_more(track: Track, told: Track) -> bool:
    """Whether a track is of a thing that was followed already."""
    _, own, theirs = np.intersect1d(track.frame, told.frame, return_indices=True)
    if 2 * len(own) < len(track):
        return False
    away = np.hypot(*(track.centre_px[own] - told.centre_px[theirs]).T)
    return bool(np.median(away) < _ELSEWHERE * np.median(track.radius_px))


def _dismissed(scene: FilmedScene, choice: Choice, fps: float) -> tuple[FollowedObject, ...]:
    """What moves and is taken for no ball, as it was seen from look to look, and why."""
    return tuple(
        FollowedObject(
            _path_track(path, fps), *described(path, choice.ball, scene.background.image)
        )
        for path in choice.dismissed
    )


def _camera_warnings(scene: FilmedScene, footage: Footage) -> list[str]:
    shifts = scene.shifts()
    if shifts is None:
        return []
    step = np.hypot(*np.diff(shifts, axis=0).T)
    usual = float(np.median(step))
    worst = int(np.argmax(step))
    if step[worst] > max(1.5, 8.0 * usual):
        return [
            f"The camera was bumped between frames {footage.in_clip(worst)} and "
            f"{footage.in_clip(worst) + 1} "
            f"(by {step[worst]:.1f} px); the frames are registered on the scene."
        ]
    return ["The camera moved (hand-held?); all frames are registered on the still scene."]


def _tell(progress: Callable[[float], None] | None, part: float) -> None:
    if progress is not None:
        progress(part)


@dataclass(frozen=True)
class _Light:
    """The light of a thing over that of the wall behind it.

    Attributes
    ----------
    left : float
        Median of that ratio.
    spread : float
        Its scatter over that of noise.
    """

    left: float
    spread: float

    @property
    def dims(self) -> bool:
        """Whether as much of the wall's light is left as shadows leave."""
        return SHADES[0] < self.left < SHADES[1]

    @property
    def like_a_shadow(self) -> bool:
        """Whether an even part of the wall's light is left."""
        return self.left < SHADES[1] and self.spread < _EVEN

    def rather_a_shadow(self, other: "_Light") -> bool:
        """Whether it dims the wall, and that is less even than it."""
        return self.dims and _MORE_EVEN * self.spread < other.spread


@dataclass(frozen=True)
class _Seen:
    """What was taken for the ball, and the picture in which it is seen best.

    Attributes
    ----------
    scene : FilmedScene
        In gray.
    tinted : FilmedScene or None
        In the thing's own colour, where that shows more.
    choice : Choice
    rough : BallFits
    light : _Light or None
        Beside the wall's, where there is enough of it.
    """

    scene: FilmedScene
    tinted: FilmedScene | None
    choice: Choice
    rough: BallFits
    light: _Light | None = None

    @property
    def picture(self) -> FilmedScene:
        """The scene in which paths were looked for."""
        return self.scene if self.tinted is None else self.tinted

    @property
    def worth(self) -> float:
        """How much speaks for the choice, weighed by the part of it that bears a closer look."""
        found = np.isin(self.choice.ball.frame, self.rough.frame)
        return path_score(self.choice.ball) * float(np.mean(found))

    @property
    def only_dims(self) -> bool:
        """Whether it takes an even part of the wall's light, as a shadow does."""
        return self.light is not None and self.light.like_a_shadow

    @cached_property
    def course(self) -> LawfulCourse:
        """The rest and the law that explain the frames in which it was followed."""
        rough = self.rough
        size = float(np.median(rough.radius))
        return lawful_course(rough.frame, rough.centre, size, self.scene.held)

    @cached_property
    def clear(self) -> bool:
        """Whether a sharp, whole outline of steady size was found in nearly every frame."""
        return _clearly_seen(self.rough, self.scene.held)

    @property
    def speaks_for_itself(self) -> bool:
        """Whether it is clearly seen and moves as a law asks for that is no bob's."""
        return self.clear and self.worth > _LEAST_WORTH and not self.like_a_bob

    @property
    def like_a_bob(self) -> bool:
        """Whether its way bends upwards, and nothing came to it where it lay still."""
        ball = self.choice.ball
        return not self.choice.reached and bends_up(ball.frame, ball.centre_px, ball.radius)

    @property
    def doubtful(self) -> bool:
        """Whether something else may be the ball."""
        agree = self.course.still + self.course.moving
        whole = agree >= _ALL_ALONG * (self.course.last + 1 - self.course.absent)
        return self.only_dims or not (whole and self.speaks_for_itself)

    def outdoes(self, other: "_Seen") -> bool:
        """Whether it is rather the ball than what was seen against another scene."""
        is_none, other_is_none = (
            seen.only_dims or seen.like_a_bob or seen.course.moving == 0 for seen in (self, other)
        )
        if is_none != other_is_none:
            return other_is_none
        casts, other_casts = other._falls_from(self), self._falls_from(other)
        if casts != other_casts:
            return casts
        size = max(float(np.median(seen.rough.radius)) for seen in (self, other))
        own, theirs = self.course.evidence(size), other.course.evidence(size)
        # What lies and flies in neither, as a bag that swings, is told by neither.
        told = max(own, theirs) > 0.0 and abs(own - theirs) > _TELLING
        if told and own > theirs and self.course.still >= _FEWEST_STILL:
            return True
        # A ball and its shadow as one may have a course, too, but no clear outline.
        if told and own < theirs and other.clear:
            return False
        return self.speaks_for_itself and self.worth > other.worth

    @property
    def moves_all_along(self) -> bool:
        """Whether one law explains it from the first frame in which it is seen, without a rest."""
        course = self.course
        return course.still == 0 and course.moving >= _ALL_ALONG * len(self.rough)

    @property
    def way(self) -> Way:
        """Where its outlines are up to the end of its course; then it may be another thing."""
        rough = self.rough.at(self.rough.frame <= self.course.last)
        return Way(rough.frame, rough.centre, float(np.median(rough.radius)))

    def _falls_from(self, other: "_Seen") -> bool:
        """Whether it goes as the other's shadow does, and is more like one than the other is."""
        if self.light is None or other.light is None:
            return False
        return self.light.rather_a_shadow(other.light) and self.thrown_by(other.way)

    def thrown_by(self, ball: BallPath | Way) -> bool:
        """Whether it goes as a shadow of that, by its outlines or, where they hop, its looks."""
        return _throws(ball, self.way) or _throws(ball, self.choice.ball)

    @property
    def warnings(self) -> list[str]:
        """What is to be said of the picture."""
        if self.only_dims:
            x, y = self.choice.ball.centre_px[-1]
            return [
                f"What is followed to x = {x:.0f}, y = {y:.0f} px takes an even part of the wall's "
                "light, as a shadow does. If it is none, or to measure what cast it, point with "
                "--ball-at X,Y,FRAME."
            ]
        if self.tinted is None:
            return []
        return [
            "In gray the ball's outline is not clear: it is followed by the silhouette of its "
            "colour, which codecs store less sharply."
        ]

    def fits_along(self, path: BallPath) -> BallFits:
        """Another path, as finely."""
        if self.tinted is not None:
            fits = follow_silhouette(self.tinted, path)
            return trusted_rows(fits) if len(fits) else fits
        return refine_ball(self.scene, follow_ball(self.scene, path))


def _seen(scene: FilmedScene, at: tuple[float, float, int | None] | None) -> _Seen | None:
    """Find the ball against what most frames show and, if in doubt, against what the first show.

    What lay in the scene for about as long as it was gone is in the one a patchwork, and in the
    other whole: it leaves a whole outline there, which tells where it lay.
    """
    best = _seen_against(scene, at)
    if at is not None:
        return best
    if best is not None and not best.doubtful:
        return _whole_of(best) or _what_casts(best) or best
    begun = scene.as_it_began()
    found = None if begun is None else _seen_in_gray(begun, at)
    if found is not None and (best is None or found.outdoes(best)):
        best = found
    left = _seen_leaving(scene, best)
    if left is not None and (best is None or left.outdoes(best)):
        best = left
    return best if best is None else _whole_of(best) or _what_casts(best) or best


def _seen_leaving(scene: FilmedScene, best: "_Seen | None") -> "_Seen | None":
    """What lay still and left as one, whether its outline was seen or not."""
    begun = scene.as_it_began() or scene
    found = [_followed_whole(scene, path, best) for path in left_at_last(begun)[:_LEFT_TRIED]]
    return _most_lawful([seen for seen in found if seen is not None and not seen.only_dims])


def _whole_of(seen: "_Seen") -> "_Seen | None":
    """What a thing that lay still and left is a part of, if that left as lawfully."""
    course, rough = seen.course, seen.rough
    if seen.tinted is not None or min(course.still, course.moving) < _FEWEST_STILL:
        return None
    begun = seen.scene.as_it_began() or seen.scene
    discs = discs_along(begun, rough.frame, rough.centre, float(np.median(rough.radius)))
    paths = sorted((*seen.choice.others, *seen.choice.dismissed), key=path_score, reverse=True)
    enclosing = [path for path in (*paths, *discs) if encloses(path, seen.choice.ball)]
    enclosing = enclosing[:_LEFT_TRIED]
    found = [_followed_whole(seen.scene, path, seen) for path in enclosing]
    whole = _most_lawful([one for one in found if one is not None and not one.only_dims])
    if whole is None or whole.like_a_bob:
        return None
    size = float(np.median(whole.rough.radius))
    return whole if whole.course.evidence(size) > course.evidence(size) - _TELLING else None


def _followed_whole(scene: FilmedScene, path: BallPath, best: "_Seen | None") -> "_Seen | None":
    """Follow what left as one, against the scene that shows more of its course."""
    begun = scene.as_it_began()
    found, known = [], {}
    for against in (scene,) if begun is None else (begun, scene):
        before = against.known
        rough = _followed_back(against, path, follow_ball(against, path))
        if len(rough) >= _FEWEST_ROWS:
            lone = Choice(path, (), False, reasons=(LEFT_AS_ONE,))
            choice = lone if best is None else best.choice.of_whole(path)
            found.append(_Seen(against, None, choice, rough))
            known[id(against)] = against.known
        against.restore(before)
    seen = _most_lawful(found)
    if seen is None:
        return None
    seen.scene.restore(known[id(seen.scene)])
    return replace(seen, light=_light(seen.scene, seen))


def _most_lawful(found: list["_Seen"]) -> "_Seen | None":
    """The one that a rest and a law explain best; of those about as good, one that is clear."""
    if not found:
        return None
    told = [seen.course.evidence(float(np.median(seen.rough.radius))) for seen in found]
    near = [place for place, nats in enumerate(told) if nats > max(told) - _TELLING]
    return found[max(near, key=lambda place: (found[place].clear, told[place]))]


def _seen_against(scene: FilmedScene, at: tuple[float, float, int | None] | None) -> _Seen | None:
    """Find the ball in gray and, where that leaves doubt, in the colours of what moves."""
    gray = _seen_in_gray(scene, at)
    # Of several alike, one colour may show another one, and loses the rest; a single one beside the
    # ball is often the ball once more, seen in part.
    if (
        gray is not None
        and not gray.only_dims
        and (gray.speaks_for_itself or len(gray.choice.beside) > 1)
    ):
        return gray
    best = gray
    for colour in moving_colours(scene):
        tinted = scene.tinted(float(colour[0]), float(colour[1]))
        choice = choose_ball(Looks(tinted).paths(), at)
        if choice is None or choice.ball.radius < SMALL_RADIUS:
            continue
        found = _Seen(scene, tinted, choice, follow_silhouette(tinted, choice.ball))
        if len(found.rough) < _FEWEST_ROWS:
            continue
        found = replace(found, rough=trusted_rows(found.rough))
        if best is None or _preferred(found, best, gray):
            best = found
    return best


def _preferred(found: _Seen, best: _Seen, gray: _Seen | None) -> bool:
    """Whether what a colour shows is taken instead of what was best so far."""
    if gray is not None and gray.only_dims and gray.speaks_for_itself:
        # What dims the wall and moves as a law asks for is the ball, or the ball's shadow.
        return _casts(found, gray) and (best is gray or found.worth > best.worth)
    # What is clear and speaks for itself about as well is better than what is not clear.
    share = _AS_GOOD if found.clear else 1.0
    return found.worth > share * best.worth


def _light(scene: FilmedScene, seen: _Seen) -> _Light | None:
    """The light of what was followed over the wall's; None where there is too little to tell.

    A ball has its own pattern and shading; where it is of the wall's lightness, only its shadow may
    be seen in gray.
    """
    path, left, spread = seen.choice.ball, [], []
    rows = np.unique(np.linspace(len(path.frame) // 2, len(path.frame) - 1, _SHADE_LOOKS))
    for row in rows.astype(int).tolist():
        index, radius = int(path.frame[row]), _INNER_PART * path.radius_px[row]
        low = np.maximum(np.ceil(path.centre_px[row] - radius), 0).astype(int)
        high = np.minimum(path.centre_px[row] + radius + 1, scene.shape[::-1]).astype(int)
        high = np.maximum(high, low)  # it may have left the picture
        window = (slice(low[1], high[1]), slice(low[0], high[0]))
        y, x = np.mgrid[window]
        inside = np.hypot(x - path.centre_px[row, 0], y - path.centre_px[row, 1]) < radius
        behind = scene.expected(index, window)[inside]
        lit = behind > _LEAST_LIT
        if np.count_nonzero(lit) < _FEWEST_SHADED:
            continue
        ratio = scene.picture(index)[window][inside][lit] / behind[lit]
        usual = float(np.median(ratio))
        noise = float(np.median(scene.usual_noise[window][inside][lit] / behind[lit]))
        left.append(usual)
        spread.append(1.4826 * float(np.median(np.abs(ratio - usual))) / noise)
    return _Light(float(np.median(left)), float(np.median(spread))) if left else None


def _casts(found: _Seen, shade: _Seen) -> bool:
    """Whether a thing lies elsewhere and moves as what casts a shadow does."""
    return _throws(found.choice.ball, shade.choice.ball)


def _throws(ball: BallPath | Way, dark: BallPath | Way) -> bool:
    """Whether a path lies elsewhere than another, which goes as its shadow does."""
    away = apart(dark, ball)
    if len(away) == 0 or not _CAST_SIZE[0] < dark.radius / ball.radius < _CAST_SIZE[1]:
        return False
    return bool(np.median(away) > ball.radius and cast_by(dark, ball))


def _seen_in_gray(scene: FilmedScene, at: tuple[float, float, int | None] | None) -> _Seen | None:
    looks = Looks(scene)
    choice = choose_ball(looks.paths(), at, scene.background.image)
    if choice is None:
        return None
    choice, rough = _followed(looks, choice, at)
    rough = _followed_back(scene, choice.ball, rough)
    if len(rough) < _FEWEST_ROWS:
        return None
    seen = _Seen(scene, None, choice, rough)
    if at is None and choice.reached and seen.moves_all_along:
        seen = _not_reached(looks, seen) or seen
    return seen if at is not None else replace(seen, light=_light(scene, seen))


def _not_reached(looks: "Looks", seen: _Seen) -> _Seen | None:
    """What else is the ball where what seemed to be reached at rest was on its way all along."""
    scene = looks.scene
    choice = choose_ball(looks.joined(), None, scene.background.image, (seen.way,))
    if choice is None or choice.ball is seen.choice.ball:
        return None
    choice, rough = _followed(looks, choice, None)
    rough = _followed_back(scene, choice.ball, rough)
    return _Seen(scene, None, choice, rough) if len(rough) >= _FEWEST_ROWS else None


def _what_casts(shade: _Seen) -> _Seen | None:
    """What it falls from, where what was taken for the ball is rather a shadow of that.

    Of a ball and a light on it, which both go as what casts it does, the ball.
    """
    scene, choice, known = shade.scene, shade.choice, shade.scene.known
    if shade.light is None or not shade.light.dims:
        return None
    found: list[tuple[_Seen, SceneKnown]] = []
    moved = shade.course.moving
    for path in sorted((*choice.others, *choice.dismissed), key=path_score, reverse=True):
        if not shade.thrown_by(path):
            continue
        scene.restore(known)
        rough = _followed_back(scene, path, follow_ball(scene, path))
        if len(rough) < _FEWEST_ROWS:
            continue
        seen = _Seen(scene, None, choice.instead(path), rough)
        seen = replace(seen, light=_light(scene, seen))
        if seen.light is None or seen.only_dims or seen.course.moving < _AS_GOOD * moved:
            continue
        if shade.light.rather_a_shadow(seen.light):
            found.append((seen, scene.known))
    scene.restore(known)
    if not found:
        return None
    best, known = found[0]
    for seen, against in found[1:]:
        if encloses(seen.choice.ball, best.choice.ball):
            best, known = seen, against
    scene.restore(known)
    return best


def _clearly_seen(rough: BallFits, held: IntArray) -> bool:
    """Whether a sharp, whole outline of steady size was found in nearly every frame held."""
    if len(rough) < 2 or float(np.median(rough.radius)) < SMALL_RADIUS:
        # Half as many samples of colour as of gray tell nothing of a ball of a few pixels.
        return len(rough) >= 2
    span = int(np.ptp(np.searchsorted(held, rough.frame[[0, -1]]))) + 1
    step = np.abs(np.diff(np.log(rough.radius)))
    sharp = len(rough) - len(rough.swept)
    return bool(
        sharp > _NEARLY_ALL * span
        and np.median(rough.fits.contrast) > _WHOLE
        and 1.4826 * np.median(step) < _STEADY_SIZE
    )


class Looks:
    """Round things that moved, looked for as densely as they move fast, turn and meet.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    """

    def __init__(self, scene: FilmedScene) -> None:
        self.scene = scene
        self._found: dict[int, Circles] = {}

    @property
    def frames(self) -> IntArray:
        """Frames looked at (n,), increasing."""
        return np.array(sorted(self._found), dtype=np.int64)

    def paths(self) -> list[BallPath]:
        """Look over the whole action, first widely, then where it is not sure who went where."""
        scene = self.scene
        paths = self._linked(scene.spread(_LOOKS))
        while len(closer := self._unsure(paths)):
            paths = self._linked(closer)
        if uncovered(scene, self._found):
            looks = self.frames
            self._found.clear()
            paths = self._linked(looks)
        closer = _meetings(paths, self.frames)
        return untangled(self._linked(closer) if len(closer) else paths)

    def again(self, frames: IntArray) -> bool:
        """Look at more frames; whether there were any that had not been looked at."""
        new = np.setdiff1d(frames, self.frames)[: max(_MOST_LOOKS - len(self._found), 0)]
        self._found |= dict(zip(new.tolist(), _circles(self.scene, new), strict=True))
        return len(new) > 0

    def joined(self) -> list[BallPath]:
        """Paths through what was found so far."""
        return untangled(self._linked(self.frames))

    def _linked(self, looks: IntArray) -> list[BallPath]:
        """Paths through what is found at these looks and was found at earlier ones."""
        new = np.setdiff1d(looks, self.frames)
        self._found |= dict(zip(new.tolist(), _circles(self.scene, new), strict=True))
        every = self.frames
        return link_circles(every, [self._found[int(index)] for index in every])

    def _unsure(self, paths: list[BallPath]) -> IntArray:
        """Frames halfway between looks between which a likely thing goes far, turns or is lost."""
        looks = self.frames
        gap = np.diff(looks)
        likely = rivals(paths)
        wanted = np.full(len(gap), not likely)
        for path in likely:
            wanted |= _lost_between(path, looks, self.scene.shape)
        wanted &= gap > 1
        halfway = looks[:-1][wanted] + gap[wanted] // 2
        spare = min(self.scene.count, _MOST_LOOKS) - len(looks)
        # The widest first.
        order = np.argsort(-gap[wanted], kind="stable")
        return np.asarray(np.sort(halfway[order][: max(spare, 0)]))


def _followed(
    looks: Looks, choice: Choice, at: tuple[float, float, int | None] | None
) -> tuple[Choice, BallFits]:
    """Follow the choice; look again where it was missed, and choose anew where that shows more."""
    rough = follow_ball(looks.scene, choice.ball)
    for _ in range(_AGAIN):
        missed = _missed(rough)
        if not looks.again(missed):
            break
        better = choose_ball(looks.joined(), at, looks.scene.background.image)
        if better is None or not _news(better.ball, rough, missed):
            break
        if choice.reached and not better.reached:
            # What was reached is the ball, whether it is seen in these looks or not.
            break
        choice, rough = better, follow_ball(looks.scene, better.ball)
    return choice, rough


def _followed_back(scene: FilmedScene, path: BallPath, rough: BallFits) -> BallFits:
    """Follow what stood in the static scene back to where it lay.

    Before it left, the scene may have held it in part, in whole or not at all: what shows it in
    most frames is right.
    """
    for _ in range(_AGAIN):
        if len(rough) == 0:
            break
        radius, first = float(np.median(rough.radius)), scene.known
        if not lay_before(scene, rough.frame, rough.centre, radius):
            break
        best, known = rough, first
        for tried in (scene.known, scene.known.throughout):
            scene.restore(tried)
            again = follow_ball(scene, path)
            if len(again) > len(best):
                best, known = again, tried
        scene.restore(known)
        if best is rough:
            break
        rough = best
    # Once it is known where the ball is, what is behind it may be known from the first frame on.
    scene.restore(scene.known.throughout)
    return rough


def _missed(rough: BallFits) -> IntArray:
    """Frames on the way in which the ball was not found, or hardly."""
    if len(rough) == 0:
        return np.zeros(0, dtype=np.int64)
    clear = rough.fits.contrast >= _CLEAR * float(np.median(rough.fits.contrast))
    way = np.arange(int(rough.frame[0]), int(rough.frame[-1]) + 1)
    return np.setdiff1d(way, rough.frame[clear])


def _news(path: BallPath, rough: BallFits, missed: IntArray) -> bool:
    """Whether a path goes where the ball was missed, elsewhere than where it was fitted."""
    frame, own, _ = np.intersect1d(path.frame, missed, return_indices=True)
    if len(frame) == 0 or len(rough) == 0:
        return len(frame) > 0
    fitted = np.isin(frame, rough.frame)
    there = rough.centre[np.searchsorted(rough.frame, frame[fitted])]
    off = np.hypot(*(path.centre_px[own[fitted]] - there).T) > _ELSEWHERE * path.radius
    return bool(np.any(~fitted) or np.any(off))


def _lost_between(path: BallPath, looks: IntArray, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """After which looks, the last one left out, a path is not sure."""
    wanted = np.zeros(len(looks) - 1, dtype=bool)
    if len(path.frame) < 2:
        return wanted
    at = np.searchsorted(looks, path.frame)
    moved = np.diff(path.centre_px, axis=0) / path.radius
    elapsed = np.diff(path.frame)[:, None].astype(np.float64)
    step = np.hypot(*moved.T)
    turned = np.zeros(len(step))
    if len(step) > 1:
        change = np.hypot(*(np.diff(moved / elapsed, axis=0) * elapsed[1:]).T)
        turned[1:], turned[:-1] = change, np.maximum(turned[:-1], change)
    for place in np.flatnonzero((step > _LONGEST_STEP) | (turned > _LONGEST_TURN)):
        wanted[at[place] : at[place + 1]] = True
    # A thing that is lost while it moves and is not on its way out may be found again.
    if step[0] > _LOST_STEP and _stays(path.centre_px[1], path.centre_px[0], shape):
        wanted[: at[0]] = True
    if step[-1] > _LOST_STEP and _stays(path.centre_px[-2], path.centre_px[-1], shape):
        wanted[at[-1] :] = True
    return wanted


def _stays(before: FloatArray, last: FloatArray, shape: tuple[int, int]) -> bool:
    """Whether one step more leads to a place inside the picture."""
    ahead = 2.0 * last - before
    return bool(np.all(ahead >= 0) and ahead[0] < shape[1] and ahead[1] < shape[0])


def _circles(scene: FilmedScene, looks: IntArray) -> list[Circles]:
    """Round things in each of these frames."""
    noise = scene.background.noise

    def find(pair: tuple[FloatImage, FloatImage]) -> Circles:
        return find_circles(*pair, noise)

    seen = ((picture, scene.expected(index)) for index, picture in scene.pictures(looks))
    return list(map_in_threads(find, seen))


def _meetings(paths: list[BallPath], looks: IntArray) -> IntArray:
    """Frames around moments in which two like things meet: a closer look tells who is who."""
    stride = int(np.ceil(np.median(np.diff(looks)))) if len(looks) > 1 else 1
    if stride <= 1:
        return np.zeros(0, dtype=np.int64)
    wanted: set[int] = set()
    likely = rivals(paths)
    for place, path in enumerate(likely):
        for other in likely[place + 1 :]:
            common, own, theirs = np.intersect1d(path.frame, other.frame, return_indices=True)
            gap = np.hypot(*(path.centre_px[own] - other.centre_px[theirs]).T)
            for frame in common[gap < 5.0 * path.radius]:
                wanted |= set(range(int(frame) - 2 * stride, int(frame) + 2 * stride + 1))
    inside = [frame for frame in wanted if looks[0] <= frame <= looks[-1]]
    return np.array(sorted(inside)[:_MOST_CLOSER], dtype=np.int64)


def _located(point: Point | None, footage: Footage) -> tuple[float, float, int | None] | None:
    """A point with its frame, if it has one, counted from the action's first."""
    if point is None:
        return None
    frame = footage.of_clip(int(point[2])) if len(point) == 3 else None
    return float(point[0]), float(point[1]), frame


def _no_ball(ball_at: Point | None) -> NotFoundError:
    if ball_at is not None:
        return NotFoundError(
            f"nothing round passes x = {ball_at[0]:g}, y = {ball_at[1]:g} px",
            hint="Give a point on the ball in the frame that you name: --ball-at X,Y,FRAME.",
        )
    return NotFoundError(
        "no ball found: nothing round moves before a still background",
        hint="Check that the ball moves in the clip and is at least 5 pixels across, "
        "or point at it with --ball-at X,Y,FRAME.",
    )


def _track(fits: BallFits, fps: float) -> Track:
    covariance = fits.fits.covariance
    return Track(
        frame=fits.frame,
        time_s=fits.frame / fps,
        centre_px=fits.centre,
        covariance_px2=covariance,
        bound_px2=fits.fits.bound,
        radius_px=fits.radius,
        radius_std_px=np.sqrt(0.5 * np.trace(covariance, axis1=1, axis2=2)),
        quality=fits.fits.contrast,
    )


def _path_track(path: BallPath, fps: float) -> Track:
    count = len(path.frame)
    std = 0.05 * path.radius_px + 0.2
    covariance = std[:, None, None] ** 2 * np.eye(2)
    return Track(
        frame=path.frame,
        time_s=path.frame / fps,
        centre_px=path.centre_px,
        covariance_px2=covariance,
        bound_px2=np.zeros((count, 2, 2)),
        radius_px=path.radius_px,
        radius_std_px=std,
        quality=path.coverage,
    )


def _pendulum(striker: Striker | None, rest: Rest | None, fps: float) -> PendulumTrack | None:
    return None if striker is None or rest is None else pendulum_track(striker, rest, fps)


def _pointer(path: BallPath, footage: Footage) -> str:
    """The option that points at a thing where it was seen most clearly."""
    clearest = int(np.argmax(path.coverage * path.sharpness))
    x, y = path.centre_px[clearest]
    return f"--ball-at {x:.0f},{y:.0f},{footage.in_clip(int(path.frame[clearest]))}"


_MET = (MotionKind.STRIKE, MotionKind.COLLISION)


def _warnings(
    choice: Choice,
    kind: MotionKind,
    rest: Rest | None,
    striker: Striker | None,
    footage: Footage,
) -> list[str]:
    said = []
    if choice.struck and kind in _MET:
        said.append(
            "Several balls move; the one that lay still and was struck is measured, "
            "the others are listed."
        )
    elif choice.doubt is not None and all(choice.doubt is not path for path in choice.others):
        said.append(
            "Another thing moves that might be the ball as well as what was taken for it; if it "
            f"is, point at that with {_pointer(choice.doubt, footage)}."
        )
    elif choice.others:
        said.append(
            f"{1 + len(choice.others)} round things move; the clearest is taken for the ball. "
            f"If it is the next clearest, point at that with {_pointer(choice.others[0], footage)}."
        )
    if striker is not None:
        said += striker.warnings
    elif rest is not None and not choice.struck:
        said.append("No pendulum was found behind the ball; point at its mass with --mass-at X,Y.")
    return said
