"""From a clip to tracks without a click: find, link, select, fit, interpret; data flows forward."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from metrology import NotFoundError
from metrology.kept import KeptResults
from vision.ball.appearance import extended_by_appearance
from vision.ball.ball import NEAR_RADII, BallFits, follow_ball, outlines_near, trusted_rows
from vision.ball.outline import nothing_found
from vision.ball.path import BallPath
from vision.ball.refine import refine_ball
from vision.blow import blow_weights
from vision.clip.footage import Footage
from vision.finding.bodies import rigid_bodies
from vision.finding.detection import detect, searched_frames, with_small
from vision.finding.linking import MIN_FOUND_ROWS, Tracklet, link
from vision.finding.selection import FoundObjects, Selection, comes_to, select
from vision.lost import LostFrames, lost_frames
from vision.motions.motion import interpret_tracks
from vision.pendulum.face import Striking
from vision.pendulum.search import Striker, find_striker, pendulum_track
from vision.scene import FilmedScene
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
    from vision.stages import GivenObjects

__all__ = [
    "MAX_LOOKS",
    "LookedAtObject",
    "find_objects",
    "follow",
    "look_at",
    "track_of",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Point = tuple[float, float] | tuple[float, float, int]

_MAX_BREAKS = 3
"""Times that a clip is followed anew where it lacks frames, the last for one side of them alone."""


def follow(
    clip: "ClipReader",
    capture_fps: float,
    *,
    ball_at: Point | None = None,
    mass_at: Point | None = None,
    given: "GivenObjects | None" = None,
    kind: MotionKind | None = None,
    progress: Callable[[float], None] | None = None,
    kept: KeptResults | None = None,
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
    given : GivenObjects, optional
        A corrected table, which takes the place of detecting, or of detecting and linking.
    kind : MotionKind, optional
        The kind of motion, where the automatic one is wrong.
    progress : callable, optional
        Called with the part done, 0 to 1.
    kept : KeptResults, optional
        Of an earlier call for the same clip.

    Returns
    -------
    Tracks

    Raises
    ------
    NotFoundError
        If nothing round moves in the clip, or nothing where the user points.
    UsageError
        If the corrected table is of another clip.
    """
    kept = kept or KeptResults()
    at = ball_at or mass_at or (None if given is None else given.point)
    recording = _one_scene(clip, at, kept)
    if given is not None:
        given.require_within(recording.whole)
    for looks_left in range(_MAX_BREAKS, -1, -1):
        tracks, scene, seen = _followed_in(
            recording, capture_fps, ball_at, mass_at, given, kind, progress, kept
        )
        others = [other.track for other in tracks.others]
        lost = lost_frames(seen, others, tracks.pendulum)
        if lost is None or not looks_left:
            break
        lost = _leap_in(scene, lost, seen)
        if lost.sure and looks_left > 1:
            recording = recording.lacking(clip, lost)
        else:
            recording = recording.beside(clip, lost, _left_in((seen, *others)))
    return replace(tracks.in_clip(recording.place(capture_fps)), lacks=recording.lacks)


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

    def place(self, capture_fps: float) -> PlaceInClip:
        """Where its frames are in the clip."""
        footage = self.footage
        return PlaceInClip(footage.shown, footage.first, footage.started, self.whole, capture_fps)

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


def find_objects(
    scene: FilmedScene, at: tuple[float, float, int | None] | None, given: "GivenObjects | None"
) -> FoundObjects | None:
    """Detect, link and select; None where surely nothing is found."""
    frames = searched_frames(scene)
    seen = detect(scene) if given is None else given.seen
    tracklets = [] if given is None else list(given.tracklets)
    tracklets = tracklets or link(seen, frames, scene.shape)
    selection = select(tracklets, len(frames), scene.shape)
    sure = selection.probability.max(initial=0.0) >= _SURE_OBJECT
    if given is None and (at is not None or not sure):
        # a small object shows better at a higher resolution
        seen = with_small(scene, seen)
        tracklets = link(seen, frames, scene.shape)
        selection = select(tracklets, len(frames), scene.shape)
    if given is None and not _has_likely(tracklets, selection, at):
        tracklets = [*tracklets, *rigid_bodies(scene, frames)]
        selection = select(tracklets, len(frames), scene.shape)
    if not tracklets:
        return None
    found = FoundObjects(seen, tuple(tracklets), selection, int(selection.order[0]), False)
    if at is None:
        if given is not None and given.measured is not None:
            return replace(found, chosen=given.measured, pointed=True)
        return None if selection.none >= _SURE_OBJECT else found
    away = np.array([_distance(tracklet, at) for tracklet in tracklets])
    if not np.any(away < 1.0):
        return None
    order = selection.order
    return replace(found, chosen=int(order[np.flatnonzero(away[order] < 1.0)[0]]), pointed=True)


def _has_likely(
    tracklets: list[Tracklet], selection: Selection, at: tuple[float, float, int | None] | None
) -> bool:
    """Whether something round is likely what is measured, or lies where somebody points.

    A place without a frame is passed by more than what is meant.
    """
    own = [at is None or _distance(one, at) < 1.0 for one in tracklets]
    if at is not None and at[2] is None:
        return any(own)
    return bool(selection.probability[own].max(initial=0.0) >= _LIKELY_OBJECT)


def _distance(tracklet: Tracklet, at: tuple[float, float, int | None]) -> float:
    """Distance of a point from a tracklet, radii: in its frame, or where it is nearest."""
    x, y, frame = at
    away = np.hypot(*(tracklet.centre_px - np.array([x, y])).T) / tracklet.seen.radius_px
    if frame is None:
        return float(away.min())
    near = np.abs(tracklet.frame - frame)
    nearest = near == near.min()
    return float(away[nearest].min()) if near.min() <= MIN_FOUND_ROWS else np.inf


def _path_of(tracklet: Tracklet) -> BallPath:
    return BallPath(tracklet.frame, tracklet.centre_px, tracklet.seen.radius_px)


def _fit(scene: FilmedScene, path: BallPath, contrast: FloatArray) -> tuple[FilmedScene, BallFits]:
    """Fit outlines along a path in gray; else against what is behind it, or in its own colour."""
    picture, agreement = scene, _agreement(scene, path)
    if agreement < _ENOUGH:
        known = scene.known
        _uncover(scene, path)
        again = _agreement(scene, path)
        if again <= agreement:
            scene.restore(known)
        agreement = max(agreement, again)
    blue, green, red = contrast
    luma = 0.114 * blue + 0.587 * green + 0.299 * red
    chroma = np.array([blue - luma, red - luma])
    if agreement < _ENOUGH and np.hypot(*chroma) >= 1.0:
        tinted = scene.tinted(*(chroma / np.abs(chroma).max()).tolist())
        _uncover(tinted, path)
        picture = tinted if _agreement(tinted, path) > agreement else scene
    return picture, follow_ball(picture, path)


_ENOUGH = 0.9
"""Share of the detections that agree with outlines beyond which no other picture is tried.
Convention: one in ten is hidden or smeared."""

_LOOKS = 40
"""Detections, spread over the path, by which a picture is chosen. Given by the budget: their share
scatters by less than a tenth."""


def _agreement(scene: FilmedScene, path: BallPath) -> float:
    """Share of the detections near which an outline fits."""
    rows = np.unique(np.linspace(0, len(path.frame) - 1, _LOOKS).astype(int))
    frame, guess = path.frame[rows], path.centre_px[rows]
    fits = outlines_near(scene, path.radius, frame, guess)
    away = np.hypot(*(fits.centre - guess).T)
    return float(np.mean(fits.found & (away < NEAR_RADII * path.radius_px[rows] + 1.0)))


_UNCOVERED_FRAMES = 21
"""Frames in the median of what is behind an object. Derived: noise falls to a quarter."""

_CLEAR_RADII = 2.5
"""Radii beyond which an object leaves a place clear. Derived: both outlines and their shadows."""


def _uncover(scene: FilmedScene, path: BallPath) -> None:
    """Put into the static scene what is behind an object where it lay at first and at last."""
    radius = path.radius
    for place in (path.centre_px[0], path.centre_px[-1]):
        away = np.hypot(*(path.centre_px - place).T)
        if np.count_nonzero(away < radius) < MIN_FOUND_ROWS:
            continue
        clear = np.interp(scene.held, path.frame, away) > _CLEAR_RADII * radius
        frames = scene.held[clear]
        if len(frames) < MIN_FOUND_ROWS:
            continue
        rows = np.unique(np.linspace(0, len(frames) - 1, _UNCOVERED_FRAMES).astype(int))
        height, width = scene.shape
        row, column = np.ogrid[:height, :width]
        off = np.hypot(column - place[0], row - place[1])
        where = np.clip(1.6 * radius + 3.0 - off, 0.0, 1.0).astype(np.float32)
        nothing = np.zeros(scene.shape, dtype=bool)
        scene.uncover(frames[rows], [nothing] * len(rows), where)


def _followed_in(
    recording: _Recording,
    capture_fps: float,
    ball_at: Point | None,
    mass_at: Point | None,
    given: "GivenObjects | None",
    kind: MotionKind | None,
    progress: Callable[[float], None] | None,
    kept: KeptResults,
) -> tuple[Tracks, FilmedScene, Track]:
    """Follow ball and pendulum through a recording; the scene, and every place the ball is seen.

    All in the recording's own frames.
    """
    footage = recording.footage
    scene = kept.once("scene", id(footage), lambda: FilmedScene(footage)).anew()
    _tell(progress, 0.2)
    own = None if given is None else given.in_footage(footage)
    found = find_objects(scene, _located(ball_at, footage), own)
    if found is None:
        raise _no_ball(ball_at)
    _tell(progress, 0.4)
    place = recording.place(capture_fps)
    viewed = place.frame(np.array(list(scene.views), dtype=np.int64)).tolist()
    shifts = [view.shift_px for view in scene.views.values()]
    kept.watch(found.in_clip(place), dict(zip(viewed, shifts, strict=True)))
    found, seen = _most_probable(scene, found, ball_at, mass_at, kept)
    scene, picture, rough, rest = seen.scene, seen.picture, seen.rough, seen.rest
    came, striker = seen.came, seen.striker
    _tell(progress, 0.8)
    fits = rough
    outlined = found.ball.corner_std_px is None
    if picture is scene and outlined:
        fits = refine_ball(scene, rough, None if striker is None else striker.mass.hides)
    _tell(progress, 1.0)
    ball = track_of(fits, capture_fps)
    if not outlined:
        # what its corners span is no ball's size
        ball = replace(ball, radius_std_px=np.full(len(ball), np.nan))
    rest_frames = None if rest is None else _still_until(rest, fits)
    others = _others(scene, found, came, capture_fps)
    beside = others[0].track if came is not None else None
    pendulum = _pendulum(striker, rest, capture_fps)
    struck = striker is not None and striker.surely_struck
    motion = interpret_tracks(ball, pendulum, beside, kind, kept, struck=struck)
    motion = motion.of_object(found.probability)
    if motion.kind is MotionKind.SWING:
        rest_frames = None
    unmet = motion.kind in (MotionKind.NONE, MotionKind.SWING) and mass_at is None
    if unmet and striker is not None and not striker.surely_struck:
        striker, pendulum = None, None
    tracks = Tracks(
        ball=ball,
        pendulum=pendulum,
        background=scene.background.image,
        rest_frames=rest_frames,
        others=others,
        dismissed=_dismissed(found, others, capture_fps),
        warnings=tuple(
            list(recording.said)
            + _warnings(found, came, motion.kind is MotionKind.STRIKE, striker, footage)
            + _picture_warnings(picture is not scene)
            + _camera_warnings(scene, footage)
        ),
        shift_px=scene.shifts(),
        motion=motion,
        reasons=_reasons(found),
        found=found,
    )
    seen_at = fits if picture is not scene or not outlined else _with_gaps(scene, fits)
    return tracks, scene, track_of(seen_at, capture_fps)


@dataclass(frozen=True)
class LookedAtObject:
    """An object in rough outlines, where it rested, and what met or struck it there.

    Attributes
    ----------
    scene : FilmedScene
        Of which what is behind this object is known.
    picture : FilmedScene
        In which its outline shows best.
    rough : BallFits
    rest : Rest or None
    came : Tracklet or None
    striker : Striker or None
    """

    scene: FilmedScene
    picture: FilmedScene
    rough: BallFits
    rest: Rest | None
    came: Tracklet | None
    striker: Striker | None

    @property
    def surely_struck(self) -> bool:
        """Whether a pendulum surely struck it."""
        return self.striker is not None and self.striker.surely_struck


def _most_probable(
    scene: FilmedScene,
    found: FoundObjects,
    ball_at: Point | None,
    mass_at: Point | None,
    kept: KeptResults,
) -> tuple[FoundObjects, LookedAtObject]:
    """The object that is measured: rivals are looked at that would be if they were struck."""
    seen: dict[int, LookedAtObject] = {}
    selection, gain = found.selection, math.exp(blow_weights().choice)
    for place in [found.chosen] if found.pointed else found.selection.order[:MAX_LOOKS].tolist():
        share = selection.probability
        if max((share[one] for one in seen), default=0.0) >= share[place] * gain:
            break
        one = look_at(scene.anew(), replace(found, chosen=place), mass_at, kept)
        if one is not None:
            seen[place] = one
            struck = [own for own, other in seen.items() if other.surely_struck]
            selection = found.selection.after_looks(struck)
    if not seen:
        raise _no_ball(ball_at)
    for place, one in seen.items():
        came = [k for k, other in enumerate(found.tracklets) if other is one.came]
        if came and not found.pointed:
            selection = selection.where_it_met(place, came[0])
    chosen = max(seen, key=lambda place: float(selection.probability[place]))
    return replace(found, selection=selection, chosen=chosen), seen[chosen]


MAX_LOOKS = 6
"""Objects of which it is seen whether one was struck. Given by the budget."""


def look_at(
    scene: FilmedScene, found: FoundObjects, mass_at: Point | None, kept: KeptResults
) -> LookedAtObject | None:
    """Fit the chosen object roughly and find what struck it; None where it has no outline."""
    if found.ball.corner_std_px is None:
        contrast = np.median(found.ball.seen.contrast, axis=0)
        picture, rough = _fit(scene, _path_of(found.ball), contrast)
        if len(rough) < MIN_FOUND_ROWS:
            return None
        rough = extended_by_appearance(picture, rough)
    else:
        picture, rough = scene, by_corners(found.ball, found.ball.corner_std_px)
    rest = find_rest(rough.frame, rough.centre, float(np.median(rough.radius)))
    if rest is None:
        return LookedAtObject(scene, picture, rough, None, None, None)
    rough = rough.at(rough.frame >= rest.first)
    came = _came(found, rest)
    striker = _striker(scene, rest, rough, mass_at, kept)
    if came is not None and striker is not None:
        swung = mass_at is not None or striker.surely_struck
        swung = swung and not _came_straight(came, rest, striker)
        came, striker = (None, striker) if swung else (came, None)
    return LookedAtObject(scene, picture, rough, rest, came, striker)


def by_corners(body: Tracklet, std_px: float) -> BallFits:
    """Places of a body of any shape in place of outlines; it has no radius to measure by."""
    fits = nothing_found(len(body))
    fits.found[:] = True
    fits.centre[:] = body.centre_px
    fits.radius[:] = body.seen.radius_px
    fits.covariance[:] = std_px**2 * np.eye(2)
    fits.bound[:] = fits.covariance / 9.0
    fits.rms_residual[:], fits.contrast[:] = 1.0, body.seen.coverage
    return BallFits(body.frame, fits, frozenset(body.frame.tolist()))


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
    return fits.together(more.at(more.fits.found))


def _striker(
    scene: FilmedScene, rest: Rest, rough: BallFits, at: Point | None, kept: KeptResults
) -> Striker | None:
    """What struck the ball: in gray, before the scene as it began, and in colour or if small.

    The last frame of rest is known to a frame or so: what swings there and contradicts the strike
    may agree with it a frame sooner or later.
    """
    first = find_striker(scene, rest, rough, at, kept=kept)
    if first is not None and first.surely_struck:
        return first
    tried = [first]
    if first is not None and first.striking is not Striking.UNKNOWN:
        for last in (rest.last - 1, rest.last + 1):
            other = find_striker(scene, replace(rest, last=last), rough, at, kept=kept)
            if other is not None and other.surely_struck:
                return other
            tried.append(other)
    pictures = [] if (begun := scene.as_it_began()) is None else [begun]
    if first is None:
        tried.append(find_striker(scene, rest, rough, at, small=True))
    else:
        pictures += [scene.tinted(1.0, 0.0), scene.tinted(0.0, 1.0)]
    tried += [find_striker(picture, rest, rough, at) for picture in pictures]
    seen = [one for one in tried if one is not None]
    agree = [one for one in seen if one.striking is Striking.AGREES]
    sure = [one for one in agree if one.surely_struck]
    return next(iter([*sure, *agree, *seen]), None)


def _still_until(rest: Rest, fits: BallFits) -> tuple[int, int]:
    """First and last frame of rest; beside the mass only fits that know of it tell how long."""
    radius = float(np.median(fits.radius))
    finer = find_rest(fits.frame, fits.centre, radius)
    if finer is None or np.hypot(*(finer.centre_px - rest.centre_px)) > NEAR_RADII * radius:
        return rest.first, rest.last
    return rest.first, finer.last


def _one_scene(clip: "ClipReader", at: Point | None, kept: KeptResults) -> _Recording:
    """The scene pointed at, or in which most moves."""
    footage = kept.once("footage", id(clip), lambda: Footage(clip))
    if len(footage.parts) == 1:
        return _Recording(footage, footage.whole_count, footage.parts[0])
    forwards = [one for one in footage.parts if one[0] < (footage.backwards or one[1])]
    chosen = max(forwards, key=footage.moved_in)
    if at is not None and len(at) == 3:
        frame = at[2]
        chosen = next((part for part in footage.parts if part[0] <= frame < part[1]), chosen)
    cuts = ", ".join(f"{part[0] - 1} and {part[0]}" for part in footage.parts[1:])
    only = f"Only frames {chosen[0]} to {chosen[1] - 1} are measured"
    said = (
        f"The clip is cut between frames {cuts}: another scene or a fade. {only}; cut the others"
        " out and measure them, or point into one with --ball-at X,Y,FRAME."
    )
    if footage.backwards is not None:
        back = f"From frame {footage.backwards} on the clip shows the same backwards (a boomerang)"
        said = f"{back}. {only}."
    part = kept.once("part", (id(clip), chosen), lambda: Footage(clip, part=chosen))
    return _Recording(part, footage.whole_count, chosen, said=(said,))


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


def track_of(fits: BallFits, fps: float) -> Track:
    """Outlines as a track, at a rate."""
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


def _pendulum(striker: Striker | None, rest: Rest | None, fps: float) -> PendulumTrack | None:
    return None if striker is None or rest is None else pendulum_track(striker, rest, fps)


def _came(found: FoundObjects, rest: Rest) -> Tracklet | None:
    """The other tracklet that came to the one at rest and met it as it left, if there is one."""
    size = found.ball.radius
    came = (one for one in found.rivals if comes_to(one, rest.centre_px, size, rest.last))
    return next(came, None)


def _came_straight(came: Tracklet, rest: Rest, striker: Striker) -> bool:
    """Whether it came straighter than on the arc on which a striker would have swung that far."""
    path = came.centre_px[came.frame <= rest.last]
    chord = path[-1] - path[0]
    length = float(np.hypot(*chord))
    bow = length**2 / (8.0 * striker.mass.arc.radius_px)
    off = (path - path[0]) @ np.array([-chord[1], chord[0]]) / max(length, 1e-6)
    return bow > _MIN_BOW_PX and float(np.abs(off).max()) < 0.5 * bow


_MIN_BOW_PX = 1.0
"""Bow of an arc that centres found by votes show, px. Derived: twice their scatter."""


def _others(
    scene: FilmedScene, found: FoundObjects, came: Tracklet | None, fps: float
) -> tuple[FollowedObject, ...]:
    """What else is round and moves: what met the ball is fitted as finely, the others as found."""
    objects = []
    if came is not None:
        fits = trusted_rows(follow_ball(scene, _path_of(came)))
        met = ("It came to the ball at rest and met it.",)
        track = track_of(fits, fps) if len(fits) >= MIN_FOUND_ROWS else _tracklet_track(came, fps)
        objects.append(FollowedObject(track, MotionModel.ROLL, met))
    for other in found.rivals:
        if other is came or not _an_object(found, other):
            continue
        model = MotionModel.SHADOW if _maybe_shadow(other) else MotionModel.UNKNOWN
        objects.append(FollowedObject(_tracklet_track(other, fps), model, _looks(other)))
    return tuple(objects)


_SURE_OBJECT = 0.9
"""Probability from which a choice is sure. Convention."""

_LIKELY_OBJECT = 0.5
"""Probability below which nothing round is likely to be what is measured. Convention."""

_OTHER_OBJECT = 0.99
"""Probability alone from which another object is listed. Convention: a clip with a ball has some
twenty other tracklets."""


def _an_object(found: FoundObjects, other: Tracklet) -> bool:
    """Whether a tracklet would surely be selected if it were alone, and is no shadow."""
    place = next(k for k, one in enumerate(found.tracklets) if one is other)
    return bool(found.selection.alone[place] > _OTHER_OBJECT and not _maybe_shadow(other))


def _maybe_shadow(tracklet: Tracklet) -> bool:
    """Whether it dims what is behind it evenly in most frames."""
    return bool(np.mean(tracklet.seen.dims_evenly) > 0.5)


def _looks(tracklet: Tracklet) -> tuple[str, ...]:
    seen = tracklet.seen
    if tracklet.corner_std_px is not None:
        return (f"Its corners move together in {len(tracklet)} frames; it need not be round.",)
    return (
        f"It was found in {len(tracklet)} frames, {100 * np.median(seen.coverage):.0f} % of its"
        f" outline seen, radius {tracklet.radius:.1f} px.",
    )


def _dismissed(
    found: FoundObjects, others: tuple[FollowedObject, ...], fps: float
) -> tuple[FollowedObject, ...]:
    """What was found and is most probably no object of its own."""
    return tuple(
        FollowedObject(
            _tracklet_track(other, fps),
            MotionModel.SHADOW if _maybe_shadow(other) else MotionModel.UNKNOWN,
            _looks(other),
        )
        for other in found.rivals
        if not _an_object(found, other)
    )


def _reasons(found: FoundObjects) -> tuple[str, ...]:
    if found.pointed:
        return ("You pointed at it.",)
    return (
        f"Of {len(found.tracklets)} objects found it is the measured one with a probability of"
        f" {found.probability:.2f}: {_looks(found.ball)[0]}",
    )


def _picture_warnings(tinted: bool) -> list[str]:
    if not tinted:
        return []
    return [
        "In gray the ball's outline is not clear: it is followed in its colour, which codecs store "
        "less sharply."
    ]


def _tell(progress: Callable[[float], None] | None, part: float) -> None:
    if progress is not None:
        progress(part)


def _tracklet_track(tracklet: Tracklet, fps: float) -> Track:
    count = len(tracklet)
    radius = tracklet.seen.radius_px
    std = 0.05 * radius + 0.2
    return Track(
        frame=tracklet.frame,
        time_s=tracklet.frame / fps,
        centre_px=tracklet.centre_px,
        covariance_px2=std[:, None, None] ** 2 * np.eye(2),
        bound_px2=np.zeros((count, 2, 2)),
        radius_px=radius,
        radius_std_px=std,
        quality=tracklet.seen.coverage,
    )


def _pointer(tracklet: Tracklet, footage: Footage) -> str:
    """The option that points at an object where it was seen most clearly."""
    clearest = int(np.argmax(tracklet.seen.coverage * tracklet.seen.sharpness))
    x, y = tracklet.centre_px[clearest]
    return f"--ball-at {x:.0f},{y:.0f},{footage.in_clip(int(tracklet.frame[clearest]))}"


def _warnings(
    found: FoundObjects,
    came: Tracklet | None,
    struck: bool,
    striker: Striker | None,
    footage: Footage,
) -> list[str]:
    said = []
    if came is not None:
        said.append(
            "Several balls move; the one that lay still and was struck is measured, "
            "the others are listed."
        )
    elif found.rivals and found.probability < 0.9:
        said.append(
            f"It is not certain which object is the ball (probability {found.probability:.2f}). If "
            f"another is, point at it with {_pointer(found.rivals[0], footage)}."
        )
    if striker is not None:
        said += striker.warnings
    elif struck and came is None:
        said.append("No pendulum was found behind the ball; point at its mass with --mass-at X,Y.")
    return said
