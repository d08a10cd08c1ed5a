"""Select the body that strikes the ball, follow it, and find its face.

Candidates are pieces that differ from the scene in brightness and bodies that swing into the
resting ball (`vision.pendulum.candidates`). Each is followed as a body that turns with its arm and
as one that does not; the one that explains the pictures best is selected, and the evidence for the
next best is its doubt.

The face of a spherical bob is the point where its outline, a circle, meets the ball: two spheres
touch on the line between their centres, so that it follows from both radii and from the height of
the bob relative to the ball.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology.kept import KeptResults
from metrology.least_squares import minimise
from vision.ball.ball import BallFits
from vision.ball.edges import TYPICAL_GAMMA
from vision.pendulum.arc import ImagedSwing, Patch
from vision.pendulum.candidates import SwungBody, propose_bodies
from vision.pendulum.face import MassCandidate, MassPoses, Striking, find_face, find_mass
from vision.pendulum.pendulum import (
    Follower,
    Swinging,
    follow_body,
    follow_on,
    follow_piece,
    most_explained,
)
from vision.scene import Backdrop, FilmedScene, FrameView, scene_before_strike
from vision.tracks import Face, PendulumTrack, Rest, Track

__all__ = ["Striker", "another_body", "find_striker", "pendulum_track", "settles", "steadiest"]

FloatArray = NDArray[np.float64]

FloatImage = NDArray[np.float32]

_FRAMES = 10
"""Frames just before the strike in which the mass is outlined, as for its face."""

_BALL_MARGIN_PX = 2.5
"""px around the ball's outline that its blur may reach: two and a half standard deviations of a
point spread of one pixel."""

_ROUNDS = 3
"""Rounds of choosing rim points and fitting (chosen): the choice hardly changes after two."""

_ANGLES = 72
"""Rays around a circle: one each 5°, a few pixels apart on a rim of fifty."""

_STEP_PX = 0.25
"""px between samples along a ray: four to a pixel, so that interpolation loses nothing."""

# Of the bob's radius: where its outline is looked for, and where it is as light as at the rim.
_REACH, _LIMB = (0.5, 1.6), (0.6, 0.85)

# A rim point counts where the bob stands out from the wall by this share of the light.
_MIN_CONTRAST = 0.06

_MIN_RIM_POINTS = 12
"""Points of the rim: a circle has three unknowns, and a sixth of all rays must agree."""

_DARKEST = 0.02
"""Of full scale: below this the gamma curve of a camera turns into a straight line (ITU-R BT.709
does at 0.018)."""

# px: an unknown transfer curve and the limb's shading move the edge at half light by so much.
_MIN_STD_PX = 0.2

# Of the size of what was followed: a rim far smaller or larger is that of something else.
_MIN_BOB, _MAX_BOB = 0.3, 2.0

# A square's rim departs from a circle by 0.12 of its radius.
_ROUND_SHARE = 0.06

# Half the arc about the arm's direction in which a rod hides the rim, rad.
_ROD = 0.5


def find_bob_face(
    scene: FilmedScene,
    mass: MassPoses,
    swing: ImagedSwing,
    rest: Rest,
    radius: float,
    before: Backdrop,
) -> tuple[Face, FloatArray] | None:
    """Find where a round bob will touch the ball.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    mass : MassPoses
        The bob as it was followed.
    swing : ImagedSwing
        Its arc.
    rest : Rest
        The ball before it is struck.
    radius : float
        Its radius, px.
    before : (H, W) float32 array
        The scene before the strike.

    Returns
    -------
    face : Face
        Its edge is the point of the bob foremost along the motion that the ball meets.
    centre : (2,) array
        The bob's own centre from its anchor, px. None for both where no outline stands out.
    """
    coming = np.flatnonzero(mass.frame <= rest.last)
    if len(coming) == 0:
        return None
    size = float(np.sqrt(mass.patch.opacity.sum() / np.pi))
    gap = np.hypot(*(mass.anchor[coming] - rest.centre_px).T) - radius - size - _BALL_MARGIN_PX
    clear = coming[gap > 0.3 * size][-_FRAMES:]
    if len(clear) < 3:
        return None
    arm = mass.anchor[clear[-1]] - swing.pivot_px
    rod = float(np.arctan2(-arm[1], -arm[0]))
    centre, circle, std, left = np.zeros(2), size, np.inf, np.inf
    for _ in range(_ROUNDS):
        rim = _rim(scene, mass, clear, before, centre, circle, rod)
        if len(rim) < _MIN_RIM_POINTS:
            return None
        centre, circle, std, left = _circle(rim, circle)
        if not _MIN_BOB * size < circle < _MAX_BOB * size:
            return None
    if left > _ROUND_SHARE * circle:
        return None
    frame = int(clear[-1])
    at, pivot = mass.anchor[frame] + centre, swing.pivot_px + centre
    down = (at - pivot) / np.hypot(*(at - pivot))
    forward = np.array([down[1], -down[0]])
    forward = forward if forward @ rest.direction > 0 else -forward
    # when they touch, the ball's centre lies so far beyond the bob's along the arm
    away = float(np.hypot(*(rest.centre_px - pivot)))
    reach, touching = float(np.hypot(*(at - pivot))), radius + circle
    beyond = (away**2 - reach**2 - touching**2) / (2.0 * reach)
    ahead = float(np.sqrt(max(touching**2 - min(abs(beyond), circle) ** 2, 0.0))) - radius
    edge_std = max(std, _MIN_STD_PX)
    return Face(int(mass.frame[frame]), at + ahead * forward, edge_std, spherical=True), centre


def _about_centre(found: Swinging, centre: FloatArray) -> Swinging:
    """A round bob about its own centre (2,) from its anchor, px.

    Its look does not turn: any point of it that is followed goes round a circle of the same size,
    about a pivot that is as far off as the point is.
    """
    mass, arc, patch = found.mass, found.mass.arc, found.mass.patch
    poses = tuple(replace(pose, anchor=pose.anchor + centre) for pose in mass.poses)
    shifted = replace(patch, x=patch.x - centre[0], y=patch.y - centre[1])
    arc = replace(arc, centre_px=arc.centre_px + centre)
    swing = replace(
        found.swing,
        pivot_px=found.swing.pivot_px + centre,
        centre_px=found.swing.centre_px + centre,
    )
    mass = replace(mass, poses=poses, patch=shifted, arc=arc)
    return replace(found, mass=mass, swing=swing)


def _about_any_point(found: Swinging) -> Swinging:
    """A round bob whose outline does not stand out, with the pivot as unsure as its centre.

    The piece that is followed may be the bob with its shadow: the centre is taken to be anywhere in
    a disc of its size, by half a radius off each way, root mean square, and so is the pivot.
    """
    mass, arc = found.mass, found.mass.arc
    unsure = np.zeros_like(arc.covariance)
    unsure[:2, :2] = 0.25 * mass.patch.opacity.sum() / np.pi * np.eye(2)
    return replace(found, mass=replace(mass, arc=replace(arc, covariance=arc.covariance + unsure)))


def _rim(
    scene: FilmedScene,
    mass: MassPoses,
    rows: NDArray[np.int64],
    before: Backdrop,
    centre: FloatArray,
    radius: float,
    rod: float,
) -> FloatArray:
    """Points (n, 2) of the rim about the anchor, px, where light is half that of bob and wall."""
    turn = np.linspace(-np.pi, np.pi, _ANGLES, endpoint=False)
    free = np.abs(np.angle(np.exp(1j * (turn - rod)))) > _ROD
    turn = turn[free]
    away = np.arange(_REACH[0] * radius, _REACH[1] * radius, _STEP_PX)
    ray = np.column_stack([np.cos(turn), np.sin(turn)])
    spot = centre + away[None, :, None] * ray[:, None]
    total = np.zeros(spot.shape[:2])
    for row in rows:
        index = int(mass.frame[row])
        at = (spot + mass.anchor[row]).astype(np.float32)
        seen = _light(_at(scene.picture(index), at) / scene.views[index].gain)
        total += seen / _light(_at(before.in_frame(index), at)) / len(rows)
    limb = (away > _LIMB[0] * radius) & (away < _LIMB[1] * radius)
    inside = np.median(total[:, limb], axis=1)
    outside = np.median(total[:, away > (_REACH[1] - 0.3) * radius], axis=1)
    points = []
    for ray_at, profile, dark, bright in zip(ray, total, inside, outside, strict=True):
        if abs(bright - dark) < _MIN_CONTRAST or abs(bright - 1.0) > 0.5 * abs(dark - 1.0):
            continue
        half = (profile - dark) / (bright - dark) - 0.5
        cross = np.flatnonzero((half[:-1] < 0.0) & (half[1:] >= 0.0))
        if len(cross) == 1:
            place = int(cross[0])
            part = -half[place] / (half[place + 1] - half[place])
            points.append(centre + (away[place] + part * _STEP_PX) * ray_at)
    return np.array(points)


def _at(picture: FloatImage, at: NDArray[np.float32]) -> FloatArray:
    border = cv2.BORDER_REPLICATE
    seen = cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_CUBIC, borderMode=border)
    return np.asarray(seen, dtype=np.float64)


def _light(gray: FloatArray) -> FloatArray:
    """Light of a gray level, kept off zero, for it is divided by."""
    return np.asarray(np.maximum(gray / 255.0, _DARKEST) ** TYPICAL_GAMMA)


def _circle(rim: FloatArray, radius: float) -> tuple[FloatArray, float, float, float]:
    """Centre, radius, how well its foremost point is known, and scatter of the rim, px."""

    def residuals(state: FloatArray) -> FloatArray:
        return np.asarray(np.hypot(*(rim - state[:2]).T) - state[2])

    start = [*np.median(rim, axis=0), radius]
    found = minimise(residuals, start, soft_from=0.1)
    left = 1.4826 * float(np.median(np.abs(found.residuals)))
    slopes = found.jacobian
    covariance = np.linalg.pinv(slopes.T @ slopes) * left**2
    # neighbouring rays share their errors
    std = float(np.sqrt(3.0 * (covariance[0, 0] + covariance[2, 2])))
    return found.values[:2], float(found.values[2]), std, left


Point = tuple[float, float] | tuple[float, float, int]

_BESIDE_ARM = 0.1
"""Of the radius of a disc as large as what is followed: how far its middle lies beside the arm, by
the light on one side, a shadow beside it, and the pivot that follows from both. Over ray-traced
clips of another renderer all angles of a clip are off together by 0.8°, root mean square."""

_OFF_CENTRE = 0.22
"""Of the radius of such a disc: how far its middle is from that of the mass along either axis, root
mean square (fitted: 30 ray-traced strikes with truth)."""

# Two followed pieces are one body where their arcs share the pivot to so many px over the arm.
_SAME_PIVOT = 0.15

_SAME_RATE = 0.05
"""Relative: two turns that differ by less are one, since a rate is known to a few per cent over a
trial."""

_NESTED, _SOLID = 0.5, 0.5
"""Of the smaller of two pieces: what lies on the other where they are one thing; and the opacity
from which a pixel counts as covered."""

_AS_EVEN = 1.5
"""Factor: scatters that differ by less are alike, as those of forty frames are that follow the same
body; a mass with its shadow scatters twice as far as the mass."""

_AS_CLEAR = 2.0
"""Factor: what leaves more of the pictures where it lies than that is another thing than it was cut
out as (chosen); pieces that follow the same body differ by up to 1.4 in two renderers."""

_EVEN_PX = 0.1
"""px: what scatters less swings evenly, whatever else does so better; outlines of one frame are
known to about that."""

_SWINGS_RAD = 0.3
"""rad: a shorter arc may be the path of a deflected ball (chosen)."""

_BENDS = 4.0
"""Times the scatter about an arc that its middle lies off the chord: less is a straight path."""

_UNEXPLAINED, _FAR_LESS = 4.0, 0.75
"""Times the noise that is left where the body lies, from which on light may have changed behind it;
and share of that which another light must leave at most (chosen): in 17 of 18 rendered clips 1.3
to 4.3 are left, before a wall over which shadows sweep 5 to 11."""

_EVENLY_PX, _SURELY_EVEN_PX, _REACHES = 1.0, 0.15, 0.25
"""Scatter of a turn, px, above which it is not even, and below which it surely is; and maximum
distance of a body from the point of contact when the ball leaves, ball radii (chosen)."""
_NEARLY_AS_MUCH = 0.75
"""Fraction of what a body explains that a piece of it explains at least (chosen)."""
_COLOURED = 0.4
"""Fraction of the squared contrast in lightness below which a body is followed in its colour
(chosen)."""

# A rival that explains less than this part of what the best one does is no rival.
_RIVAL = 0.3


@dataclass(frozen=True)
class Striker:
    """What struck the ball.

    Attributes
    ----------
    mass : MassPoses
        Where it was.
    swing : ImagedSwing
        Its arc in the picture.
    face : Face
        Where it strikes.
    reasons : tuple of str
        Why it is taken for the striker, in whole sentences.
    doubt : float
        0 where nothing else comes into question, towards 1 where another thing explains as much.
    striking : Striking
        Whether its speeds agree with the ball's.
    """

    mass: MassPoses
    swing: ImagedSwing
    face: Face
    reasons: tuple[str, ...]
    doubt: float
    striking: Striking

    @property
    def surely_struck(self) -> bool:
        """Whether it swings on an arc that bends, and its speeds agree with the blow.

        What rolls or slides goes straight.
        """
        way = self.mass.arc.span_rad * self.mass.arc.radius_px
        sagitta = way**2 / (8.0 * self.mass.arc.radius_px)
        bends = sagitta > max(1.0, _BENDS * self.mass.arc.scatter_px)
        swings = self.mass.arc.span_rad > _SWINGS_RAD
        return self.striking is Striking.AGREES and bends and swings

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know."""
        if self.doubt < 0.5:
            return ()
        x, y = self.mass.anchor[-1]
        return (
            "Two things move towards the ball on different arcs; the one near "
            f"x = {x:.0f}, y = {y:.0f} px is taken for the pendulum's mass. "
            "Point at the right one with --mass-at X,Y.",
        )


def find_striker(
    scene: FilmedScene,
    rest: Rest,
    ball: BallFits,
    mass_at: Point | None = None,
    *,
    small: bool = False,
    kept: KeptResults | None = None,
) -> Striker | None:
    """Find and follow what strikes the ball.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    rest : Rest
        The ball before it is struck.
    ball : BallFits
        The ball.
    mass_at : tuple, optional
        x, y (px) of a point on the striker just before contact, where the user gave one.
    small : bool
        Whether it may be small beside the ball.
    kept : KeptResults, optional
        Of an earlier search in the same footage.

    Returns
    -------
    Striker or None
        None if nothing swings towards the ball.
    """
    at = None if mass_at is None else (float(mass_at[0]), float(mass_at[1]))
    near = _near_strike(ball, rest)

    def searched() -> "tuple[_StrikerSearch | None, dict[int, FrameView]]":
        return _searched(scene, rest, near, at, small), dict(scene.views)

    depends = (scene.known, rest, near.frame, near.centre, near.radius, at, small)
    search, views = (kept or KeptResults()).once(f"striker at {rest.last}", depends, searched)
    scene.views.update(views)
    return None if search is None else search.striker(ball)


_SEARCHED_RADII, _SEARCHED_FRAMES = 4.6, 16
"""Radii that the ball flies, and frames at least, beyond which the search looks at nothing
(derived: twice as far as bodies are followed to be compared)."""


def _near_strike(ball: BallFits, rest: Rest) -> BallFits:
    """The ball as far as the search follows anything, with its usual radius in each frame."""
    radius = np.full(len(ball), np.median(ball.radius))
    far = rest.last + rest.frames_along(_SEARCHED_RADII, float(radius[0]), _SEARCHED_FRAMES)
    rows = np.arange(min(int(np.searchsorted(ball.frame, far, side="right")) + 1, len(ball)))
    return replace(ball, fits=replace(ball.fits, radius=radius)).at(rows)


def _searched(
    scene: FilmedScene, rest: Rest, ball: BallFits, at: tuple[float, float] | None, small: bool
) -> "_StrikerSearch | None":
    """Search among pieces, and among proposed bodies unless a piece is sure."""
    scenes = _scenes_before(scene, rest, ball)
    pieces = _StrikerSearch.of_pieces(scene, rest, ball, scenes, at, small)
    if pieces is not None and pieces.is_sure:
        return pieces
    bodies = propose_bodies(scene, rest, float(np.median(ball.radius)), at)
    swung = _StrikerSearch.of_bodies(scene, rest, ball, scenes, bodies)
    if pieces is None or (swung is not None and swung.is_better_than(pieces)):
        return swung
    return pieces


def _scenes_before(scene: FilmedScene, rest: Rest, ball: BallFits) -> tuple[Backdrop, Backdrop]:
    """The scene before the strike: steady, and in each frame's own light."""
    radius = float(np.median(ball.radius))
    image = scene_before_strike(scene, rest, radius)
    return Backdrop(scene, image, radius), Backdrop(scene, image, radius, relit=True)


@dataclass(frozen=True)
class _StrikerSearch:
    """Pieces of what moved, followed before a scene, and the one that struck.

    Attributes
    ----------
    lit : Backdrop
        The scene before the strike in each frame's own light.
    others : tuple of Swinging
        Other bodies that agree as well with the strike.
    """

    follower: Follower
    lit: Backdrop
    best: Swinging
    others: tuple[Swinging, ...]

    @classmethod
    def of_pieces(
        cls,
        scene: FilmedScene,
        rest: Rest,
        ball: BallFits,
        scenes: tuple[Backdrop, Backdrop],
        at: tuple[float, float] | None,
        small: bool,
    ) -> "_StrikerSearch | None":
        """Follow pieces of what differs in brightness; None where nothing swings to the ball."""

        def through(before: Backdrop, lit: Backdrop) -> _StrikerSearch | None:
            follower = Follower(scene, rest, ball, before)
            followed: list[Swinging] = []
            for piece in find_mass(scene, rest, follower.radius, before, at, small=small):
                if followed and settles(steadiest(followed), piece, follower):
                    continue
                one = follow_piece(follower, piece)
                # What explains no more than the scene without it is none.
                if one is not None and one.gain > 0.0:
                    followed.append(one)
            return cls._of(follower, lit, followed)

        return cls._before_each_scene(scenes, through)

    @classmethod
    def of_bodies(
        cls,
        scene: FilmedScene,
        rest: Rest,
        ball: BallFits,
        scenes: tuple[Backdrop, Backdrop],
        bodies: Sequence[SwungBody],
    ) -> "_StrikerSearch | None":
        """Follow proposed bodies, in colour where they are about as light as the scene."""
        if not bodies:
            return None
        if bodies[0].gray < _COLOURED:
            scene = scene.tinted(*bodies[0].colour.tolist())
            scenes = _scenes_before(scene, rest, ball)

        def through(before: Backdrop, lit: Backdrop) -> _StrikerSearch | None:
            follower = Follower(scene, rest, ball, before)
            followed: list[Swinging] = []
            for body in bodies:
                if body.with_arm and any(_is_even(one) for one in followed):
                    continue
                one = follow_body(follower, body)
                if one is not None and one.gain > 0.0:
                    followed.append(one)
            return cls._of(follower, lit, followed)

        return cls._before_each_scene(scenes, through)

    @classmethod
    def _before_each_scene(
        cls,
        scenes: tuple[Backdrop, Backdrop],
        through: Callable[[Backdrop, Backdrop], "_StrikerSearch | None"],
    ) -> "_StrikerSearch | None":
        """Search before the steady scene; where that leaves much, in each frame's own light."""
        before, lit = scenes
        search = through(before, lit)
        if search is None or not search.explains_all:
            again = through(lit, lit)
            if again is not None and (search is None or again.explains_more_than(search)):
                return again
        return search

    @classmethod
    def _of(
        cls, follower: Follower, lit: Backdrop, followed: list[Swinging]
    ) -> "_StrikerSearch | None":
        if not followed:
            return None
        best = steadiest(followed)
        likely = (one for one in followed if one.striking <= best.striking)
        others = tuple(one for one in likely if another_body(one, best))
        return cls(follower, lit, best, others)

    @property
    def is_sure(self) -> bool:
        """Whether it explains the strike and the pictures, and reaches the point of contact."""
        even = self.best.scatter_px < _SURELY_EVEN_PX
        return self.explains_all and even and self._gap_radii() < _REACHES

    def _gap_radii(self) -> float:
        """Distance of the body from the point of contact when the ball leaves, ball radii."""
        rest, mass = self.follower.rest, self.best.mass
        place = int(np.argmin(np.abs(mass.frame - rest.last)))
        pose, patch, radius = mass.poses[place], mass.patch, self.follower.radius
        solid = patch.opacity > _SOLID
        cosine, sine = np.cos(pose.turn), np.sin(pose.turn)
        x, y = patch.x[solid], patch.y[solid]
        contact = rest.centre_px - radius * rest.direction - pose.anchor
        away = np.hypot(cosine * x - sine * y - contact[0], sine * x + cosine * y - contact[1])
        return float(away.min(initial=np.inf)) / radius

    def is_better_than(self, pieces: "_StrikerSearch") -> bool:
        """Whether a body is another thing than a piece, or explains much more of the pictures."""
        body, piece = self.best, pieces.best
        if body.striking != piece.striking:
            return body.striking < piece.striking
        if _shared_area(piece.mass, body.mass) < _NESTED:
            return True
        uneven = body.scatter_px > max(_AS_EVEN * piece.scatter_px, _EVEN_PX)
        return piece.gain < (_RIVAL if uneven else _NEARLY_AS_MUCH) * body.gain

    @property
    def explains_all(self) -> bool:
        """Whether it agrees with the strike and leaves hardly more of the pictures than noise."""
        return self.best.striking is Striking.AGREES and self.best.misfit < _UNEXPLAINED

    def explains_more_than(self, other: "_StrikerSearch") -> bool:
        """Whether it agrees better with the strike, or as well and leaves far less of pictures."""
        if self.best.striking != other.best.striking:
            return self.best.striking < other.best.striking
        return self.best.misfit < _FAR_LESS * other.best.misfit

    def striker(self, ball: BallFits) -> Striker:
        """Follow the best one to both ends of the clip, behind the whole ball; find its face."""
        searched = self.follower
        follower = Follower(searched.scene, searched.rest, ball, searched.before)
        scenes_before = follower.before, self.lit
        best = follow_on(follower, self.best)
        scene, rest, radius = follower.scene, follower.rest, follower.radius
        face: Face | None = None
        if not best.swing.turns:
            bob = find_bob_face(scene, best.mass, best.swing, rest, radius, scenes_before[0])
            if bob is None:
                best = _about_any_point(best)
            else:
                face, best = bob[0], _about_centre(best, bob[1])
        if face is None:
            face = find_face(scene, best.mass, rest, radius, *scenes_before)
        doubt = max((one.gain for one in self.others), default=0.0) / max(best.gain, 1e-9)
        doubt = doubt if doubt > _RIVAL else 0.0
        return Striker(best.mass, best.swing, face, _reasons(best), doubt, best.striking)


def _is_even(one: Swinging) -> bool:
    """Whether it agrees with the strike and turns evenly on its way to the ball."""
    return one.striking is Striking.AGREES and one.scatter_px < _EVENLY_PX


def steadiest(followed: list[Swinging]) -> Swinging:
    """Of the pieces that agree best with the strike and explain much, the one that swings evenly.

    A piece that holds a mass together with its shadow explains more of what moved than the mass
    alone, but no one rigid thing turns as both do: what is registered slides from one to the other.
    """
    agreeing = min(one.striking for one in followed)
    likely = [one for one in followed if one.striking == agreeing]
    most = max(one.gain for one in likely)
    likely = [one for one in likely if one.gain >= _RIVAL * most]
    clearest = min(one.misfit for one in likely)
    likely = [one for one in likely if one.misfit <= _AS_CLEAR * clearest]
    least = min(one.scatter_px for one in likely)
    even = [one for one in likely if one.scatter_px <= max(_AS_EVEN * least, _EVEN_PX)]
    return max(even, key=lambda one: one.gain)


def settles(best: Swinging, piece: MassCandidate, follower: Follower) -> bool:
    """Whether a piece of the best body so far cannot be taken instead, so that nobody follows it.

    The body swings so evenly that no other is preferred for that, and it explains more than all
    that differs from the scene where the piece lies. What is nested in it is no rival either.
    """
    if best.striking is not Striking.AGREES or best.scatter_px > _EVEN_PX:
        return False
    if not most_explained(follower, piece, best) < best.gain:
        return False
    theirs = _covered_in(piece.frame, best.mass)
    return _shared(_covered(piece.patch, piece.anchor, 0.0), theirs) > _NESTED


def another_body(one: Swinging, best: Swinging) -> bool:
    """Whether two followed pieces are different bodies: elsewhere, and another pivot or rate.

    A piece of a body, or the body with its shadow, departs from its arc and is the same body.
    """
    if _shared_area(one.mass, best.mass) > _NESTED:
        return False
    arm = float(np.hypot(*(best.swing.centre_px - best.swing.pivot_px)))
    apart = float(np.hypot(*(one.swing.pivot_px - best.swing.pivot_px)))
    if apart > _SAME_PIVOT * arm:
        return True
    common = np.intersect1d(one.mass.frame, best.mass.frame)
    if len(common) < 2:
        return False
    turned = [
        float(np.ptp(each.swing.angle_of(each.mass.anchor[np.isin(each.mass.frame, common)])))
        for each in (one, best)
    ]
    return abs(turned[0] - turned[1]) > _SAME_RATE * max(turned)


def _shared_area(one: MassPoses, other: MassPoses) -> float:
    """Part of the smaller of two pieces that lies on the other, in a frame that shows both."""
    common = np.intersect1d(one.frame, other.frame)
    if len(common) == 0:
        return 0.0
    index = int(common[len(common) // 2])
    return _shared(_covered_in(index, one), _covered_in(index, other))


def _shared(ours: set[tuple[int, int]], theirs: set[tuple[int, int]]) -> float:
    return len(ours & theirs) / max(min(len(ours), len(theirs)), 1)


def _covered_in(index: int, mass: MassPoses) -> set[tuple[int, int]]:
    """Pixels that a mass covers in a frame in which it was found."""
    pose = mass.poses[int(np.searchsorted(mass.frame, index))]
    return _covered(mass.patch, pose.anchor, pose.turn)


def _covered(patch: Patch, anchor: FloatArray, turn: float) -> set[tuple[int, int]]:
    """Pixels that a patch covers where it lies so."""
    solid = patch.opacity > _SOLID
    x, y = patch.x[solid], patch.y[solid]
    cosine, sine = np.cos(turn), np.sin(turn)
    column = np.rint(anchor[0] + cosine * x - sine * y).astype(np.int64)
    row = np.rint(anchor[1] + sine * x + cosine * y).astype(np.int64)
    return set(zip(column.tolist(), row.tolist(), strict=True))


def _reasons(best: Swinging) -> tuple[str, ...]:
    shape = "turns with its arm" if best.swing.turns else "keeps its look as it swings: it is round"
    words = {
        Striking.AGREES: "Its speeds before and after agree with the ball's.",
        Striking.UNKNOWN: "It is not seen on both sides of the strike.",
        Striking.CONTRADICTS: "Its speeds do not agree with the ball's.",
    }
    return (
        f"It swings about one pivot towards the ball in {len(best.mass.frame)} frames and {shape}.",
        words[best.striking],
    )


def pendulum_track(striker: Striker, rest: Rest, fps: float) -> PendulumTrack:
    """The striker as a track.

    Parameters
    ----------
    rest : Rest
        The ball before it is struck; it tells which way is forward.
    fps : float
        Frames per second.
    """
    mass, swing = striker.mass, striker.swing
    sign = 1.0 if rest.direction[0] >= 0 else -1.0
    # the angle in the plane of the swing, which an oblique view distorts
    offset = np.column_stack(swing.in_plane(mass.anchor))
    angle = np.unwrap(np.arctan2(sign * offset[:, 0], offset[:, 1]))
    size = float(np.sqrt(mass.patch.opacity.sum() / np.pi))
    followed = np.array([pose.covariance[:2, :2] for pose in mass.poses])
    # a piece may lack a part of the mass or hold its arm; a circle was fitted to a round bob
    off_px = 0.0 if striker.face.spherical else _OFF_CENTRE * size
    covariance = followed + off_px**2 * np.eye(2)
    count = len(mass.frame)
    track = Track(
        frame=mass.frame,
        time_s=mass.frame / fps,
        centre_px=mass.anchor,
        covariance_px2=covariance,
        bound_px2=followed / 4.0,
        radius_px=np.full(count, size),
        radius_std_px=np.full(count, 0.05 * size),
        quality=np.array([pose.seen for pose in mass.poses]),
    )
    return PendulumTrack(
        track=track,
        angle_rad=angle,
        angle_std_rad=np.array([np.sqrt(pose.covariance[2, 2]) for pose in mass.poses]),
        pivot_px=swing.pivot_px,
        pivot_covariance_px2=mass.arc.covariance[:2, :2],
        arm_px=float(np.hypot(*offset.T).mean()),
        face=striker.face,
        zero_std_rad=_BESIDE_ARM * size / float(np.hypot(*offset.T).mean()),
    )
