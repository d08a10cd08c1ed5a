"""Pieces that may be the striking mass, its poses, its face, and tests of it.

A camera to one side sees the face of a thick mass as a strip: its foremost edge is the far rim; its
side meets its face at the near rim. The ball meets the face between the two.

What differs from the scene is often the mass together with its shadow or its arm. Thresholds from
the noise up to the strongest difference separate one from the other; following them shows which
piece moves as one rigid body.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from metrology.least_squares import minimise
from vision.ball.ball import BallFits
from vision.ball.edges import TYPICAL_GAMMA, Hides
from vision.pendulum.arc import Arc, Patch, Pose, sampled
from vision.scene import Backdrop, FilmedScene
from vision.tracks import Face, Rest

__all__ = [
    "COMPARED_WAYS",
    "MassCandidate",
    "MassPoses",
    "Striking",
    "find_face",
    "find_mass",
    "restitution_px",
    "striking",
]

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]

# Opacity above which a pixel belongs to the mass; low, so that its soft edge counts.
_SOLID = 0.1


@dataclass(frozen=True)
class MassPoses:
    """The mass in each frame in which it was found.

    Attributes
    ----------
    frame : (N,) int array
        Frame indices.
    poses : tuple of Pose
        Where it lay.
    patch : Patch
        Its look.
    arc : Arc
        Circle through its anchors.
    reference : int
        Frame in which the patch has turn 0.
    """

    frame: IntArray
    poses: tuple[Pose, ...]
    patch: Patch
    arc: Arc
    reference: int

    @property
    def anchor(self) -> FloatArray:
        """Anchors (N, 2), px."""
        return np.array([pose.anchor for pose in self.poses])

    @cached_property
    def _solid(self) -> tuple[NDArray[np.bool_], int, int]:
        """Which pixels of the patch hide what is behind, and x and y of the first of them, px."""
        left, top = int(np.floor(self.patch.x.min())) - 1, int(np.floor(self.patch.y.min())) - 1
        columns = np.rint(self.patch.x - left).astype(np.int64)
        rows = np.rint(self.patch.y - top).astype(np.int64)
        solid = np.zeros((rows.max() + 2, columns.max() + 2), dtype=bool)
        solid[rows, columns] = self.patch.opacity > _SOLID
        return solid, left, top

    def hides(self, index: int) -> Hides | None:
        """Where the mass stands in a frame, as something that may hide the ball."""
        place = int(np.searchsorted(self.frame, index))
        if place >= len(self.frame) or self.frame[place] != index:
            return None
        pose, (solid, left, top) = self.poses[place], self._solid
        cosine, sine = np.cos(pose.turn), np.sin(pose.turn)

        def inside(x: FloatArray, y: FloatArray) -> NDArray[np.bool_]:
            dx, dy = x - pose.anchor[0], y - pose.anchor[1]
            column = np.rint(cosine * dx + sine * dy - left).astype(np.int64)
            row = np.rint(-sine * dx + cosine * dy - top).astype(np.int64)
            within = (column >= 0) & (row >= 0) & (column < solid.shape[1]) & (row < solid.shape[0])
            hidden = np.zeros(x.shape, dtype=bool)
            hidden[within] = solid[row[within], column[within]]
            return hidden

        return inside


BoolArray = NDArray[np.bool_]

FloatImage = NDArray[np.float32]

_LOOK_BACK, _MIN_LOOKS = 3.0, 12

"""Ball's radii of flight, and frames at least, in which a mass is sought before the strike (chosen:
it swings through some of its own widths in them)."""

_LOWEST_SIGMA = 5.0

"""Standard deviations of noise: of a picture of a million pixels less than one passes by chance."""

_LEVELS = 5

"""Thresholds that are tried, each a fixed factor above the last, from noise to the strongest
difference."""

_THICKNESS, _SMALL_THICKNESS = 0.15, 0.06
"""Ball's radii: the least half thickness of a mass, and that of a small one before a large ball,
which is looked for where nothing else struck; an arm or a cord is thinner (chosen)."""
_BEHIND, _BESIDE = 4.0, 2.2
"""Ball's radii, behind its middle and to either side, in which a mass is looked for: it is near
when it strikes, and hardly larger than the ball (chosen)."""

_SMOOTHED_PX, _AROUND_PX = 0.7, 8
"""px: standard deviation by which noise is smoothed before it is compared, and how far beyond a
piece its smoothing and its edge reach, with some to spare."""

# A piece that lost less than this part of its area at a higher threshold is the same piece.
_SAME_AREA = 0.85


@dataclass(frozen=True)
class MassCandidate:
    """A piece of what moved that may be the mass.

    Attributes
    ----------
    frame : int
        Frame in which it was cut out.
    patch : Patch
        Its look.
    anchor : (2,) array
        Where it lay in that frame, px.
    gap_px : float
        How far it was from the ball's outline, px.
    """

    frame: int
    patch: Patch
    anchor: FloatArray
    gap_px: float


def find_mass(
    scene: FilmedScene,
    rest: Rest,
    radius: float,
    before: Backdrop,
    at: tuple[float, float] | None = None,
    *,
    small: bool = False,
) -> tuple[MassCandidate, ...]:
    """Find what may be about to strike the ball.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    rest : Rest
        The ball before it is struck.
    radius : float
        Ball radius, px.
    before : Backdrop
        The scene before the strike (`vision.scene.scene_before_strike`).
    at : tuple of float, optional
        A point on the mass just before contact, px, where the user gave one.
    small : bool
        Whether to look for masses that are small beside the ball, too.

    Returns
    -------
    tuple of MassCandidate
        Largest first: what moved as a whole, then the pieces of it that differ more and more from
        the scene. Empty if nothing moved behind the ball.
    """
    best: dict[int, MassCandidate] = {}
    free = max(3.0, 0.1 * radius)
    # Late enough to be near the ball, early enough to be seen free of it.
    back = rest.frames_along(_LOOK_BACK, radius, _MIN_LOOKS)
    step = -2 if back >= 2 * _MIN_LOOKS else -1
    behind = _Behind(rest, radius, scene.shape, _SMALL_THICKNESS if small else _THICKNESS)
    if not np.any(behind.region):
        return ()
    lowest = _LOWEST_SIGMA * scene.usual_noise[behind.window]
    for index in range(rest.last - 1, max(rest.last - back, -1), step):
        for level, found in _pieces(scene, index, behind, lowest, before, at):
            if level not in best or best[level].gap_px < min(found.gap_px, free):
                best[level] = found
        if best and min(piece.gap_px for piece in best.values()) > free:
            break
    return _distinct(sorted(best.values(), key=_area, reverse=True))


def _distinct(pieces: list[MassCandidate]) -> tuple[MassCandidate, ...]:
    kept: list[MassCandidate] = []
    for piece in pieces:
        if not kept or _area(piece) < _SAME_AREA * _area(kept[-1]):
            kept.append(piece)
    return tuple(kept)


def _area(piece: MassCandidate) -> float:
    return float(piece.patch.opacity.sum())


def _pieces(
    scene: FilmedScene,
    index: int,
    behind: "_Behind",
    lowest: FloatImage,
    before: Backdrop,
    at: tuple[float, float] | None,
) -> Iterator[tuple[int, MassCandidate]]:
    """The piece nearest to the ball's rear at each threshold, in one frame."""
    window = behind.window
    picture = scene.picture(index)[window]
    expected = np.asarray(before.in_frame(index)[window] * np.float32(scene.views[index].gain))
    change = np.abs(cv2.GaussianBlur(picture - expected, (0, 0), _SMOOTHED_PX))
    strongest = float(np.percentile((change / lowest)[behind.region], 99.5))
    factors = np.geomspace(1.0, max(0.6 * strongest, 1.0), _LEVELS)
    for level, factor in enumerate(factors):
        moved = (change > factor * lowest) & behind.region
        member = behind.nearest(moved, at)
        if member is not None:
            yield level, _cut_out(scene, index, picture, expected, behind, member, moved)


class _Behind:
    """The part of the picture behind the ball, and distances in a window (rows, columns) of it."""

    def __init__(self, rest: Rest, radius: float, shape: tuple[int, ...], thick: float) -> None:
        self.rest, self.radius, self.thick = rest, radius, thick
        self.window = _window_behind(rest, radius, shape)
        self.rows, self.columns = np.mgrid[self.window]
        x, y = self.columns - rest.centre_px[0], self.rows - rest.centre_px[1]
        along = x * rest.direction[0] + y * rest.direction[1]
        across = -x * rest.direction[1] + y * rest.direction[0]
        self.from_centre = np.hypot(x, y)
        self.region = self.from_centre > radius + 1.5
        self.region &= (along < 0) & (along > -_BEHIND * radius)
        self.region &= np.abs(across) < _BESIDE * radius

    def nearest(self, moved: BoolArray, at: tuple[float, float] | None) -> BoolArray | None:
        """The thick piece nearest to the ball's rear, or to where the user points."""
        kernel = _disc(max(1, int(self.thick * self.radius)))
        thick = cv2.morphologyEx(moved.astype(np.uint8), cv2.MORPH_OPEN, kernel)
        count, labels = cv2.connectedComponents(thick)
        rear = self.rest.centre_px - self.rest.direction * (self.radius + 1.0)
        target = rear if at is None else np.array(at)
        away = np.hypot(self.columns - target[0], self.rows - target[1])
        least = max(12.0, self.thick**2 / _THICKNESS * self.radius**2)
        best, best_gap = 0, 1.5 * self.radius
        for label in range(1, count):
            member = labels == label
            if np.count_nonzero(member) < least:
                continue
            gap = float(away[member].min())
            if gap < best_gap:
                best, best_gap = label, gap
        return None if best == 0 else np.asarray(labels == best)


def _window_behind(rest: Rest, radius: float, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns that hold all of it, and what its edge needs of pixels around."""
    along = np.asarray(rest.direction)
    across = np.array([-along[1], along[0]])
    ends = np.array([(0.0, _BESIDE), (0.0, -_BESIDE), (-_BEHIND, _BESIDE), (-_BEHIND, -_BESIDE)])
    corners = rest.centre_px + radius * ends @ np.array([along, across])
    limit = shape[1::-1]
    left, top = np.clip(np.floor(corners.min(axis=0)).astype(int) - _AROUND_PX, 0, limit)
    right, bottom = np.clip(np.ceil(corners.max(axis=0)).astype(int) + _AROUND_PX, 0, limit)
    return slice(top, bottom), slice(left, right)


def _cut_out(
    scene: FilmedScene,
    index: int,
    picture: FloatImage,
    expected: FloatImage,
    behind: _Behind,
    member: BoolArray,
    moved: BoolArray,
) -> MassCandidate:
    columns, rows = behind.columns, behind.rows
    anchor = np.array([columns[member].mean(), rows[member].mean()])
    near = cv2.dilate(member.astype(np.uint8), _disc(3)) > 0
    opacity = _opacity(picture, expected, moved & near, member)
    region = near & (behind.from_centre > behind.radius + 1.0)
    gain = scene.views[index].gain
    patch = Patch(
        columns[region] - anchor[0],
        rows[region] - anchor[1],
        (picture[region] / gain).astype(np.float64),
        opacity[region].astype(np.float64),
    )
    gap = float(behind.from_centre[member].min()) - behind.radius
    return MassCandidate(index, patch, anchor, gap)


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


COMPARED_WAYS = (0.75, 1.0, 1.1)

"""Ball's radii of flight before the strike, between, and after it over which speeds are compared:
true contacts of two renderers last as long as the ball then takes for 0.44 to 0.89 of its
radius."""

_MIN_PLACES = 4

"""Places: a straight line has two unknowns, and two more show whether it is one."""

# Balls give back a tenth to all of the speed of approach; the rest is the coarseness of this look.
_MIN_RESTITUTION, _MAX_RESTITUTION = 0.1, 1.15


class Striking(IntEnum):
    """How well a thing's motion agrees with its having struck the ball, best first."""

    AGREES = 0
    UNKNOWN = 1
    CONTRADICTS = 2


def striking(mass: MassPoses, ball: BallFits, rest: Rest) -> Striking:
    """Judge a followed thing by the restitution that its speeds and the ball's would mean."""
    restitution = restitution_px(mass, ball, rest)
    if restitution is None:
        return Striking.UNKNOWN
    agrees = _MIN_RESTITUTION < restitution < _MAX_RESTITUTION
    return Striking.AGREES if agrees else Striking.CONTRADICTS


def restitution_px(mass: MassPoses, ball: BallFits, rest: Rest) -> float | None:
    """Coefficient of restitution from speeds in the picture, Newton's e = (v_B − v_M) / v_M0.

    Parameters
    ----------
    mass : MassPoses
        What was followed.
    ball : BallFits
        The ball.
    rest : Rest
        The ball before it is struck.

    Returns
    -------
    float or None
        None where the thing is not seen on both sides of the blow.
    """
    centre = mass.arc.centre_px
    offset = mass.anchor - centre
    angle = np.unwrap(np.arctan2(offset[:, 1], offset[:, 0]))
    lever = rest.centre_px - centre
    # what an angle from +x towards +y moves along the ball's departure, at the ball
    along = float(-lever[1] * rest.direction[0] + lever[0] * rest.direction[1])
    radius = float(np.median(ball.radius))
    late = rest.last + rest.frames_along(COMPARED_WAYS[1], radius)
    least = _MIN_PLACES
    before, after = (rest.frames_along(way, radius, least) for way in COMPARED_WAYS[::2])
    coming = _slope(mass.frame, angle, rest.last - before, rest.last)
    going = _slope(mass.frame, angle, late, late + after)
    flying = _slope(ball.frame, ball.centre @ rest.direction, late, late + after)
    if coming is None or going is None or flying is None or coming * along <= 0.0:
        return None
    return (flying - going * along) / (coming * along)


def _slope(frame: NDArray[np.int64], value: FloatArray, first: int, last: int) -> float | None:
    used = (frame >= first) & (frame <= last)
    if np.count_nonzero(used) < _MIN_PLACES:
        return None
    return float(np.polyfit(frame[used].astype(np.float64), value[used], 1)[0])


_FRAMES = 10

"""Frames just before the strike in which the face is measured: near enough to the ball to see it
under the same slant (chosen)."""

_MIN_COUNT = 3

"""Frames: a median of fewer does not leave out one that is wrong."""

_STEP_PX = 0.5

# How far from the middle of the mass, and from the ball's height, it is looked at, in ball radii.
_BACK, _AHEAD, _HALF_HEIGHT = 0.7, 1.8, 0.35

_MIN_HALF_HEIGHT_PX = 2.0

# What stands around the edge: the strip of the face behind it, and the wall ahead of it.
_STRIP, _WALL, _MIN_WALL_PX = 0.5, 0.2, 3.0

"""Radii of the ball, and px at least (chosen): what stands around the edge, the strip of the face
behind it and the wall ahead of it."""

_CUT_OFF, _CUT_OFF_PX = 0.2, 1.0
"""Radii of the ball, and px at least, by which a piece that was cut out ends elsewhere than its
face: 0.17, root mean square, over rooms of two renderers."""

_APART = 0.5
"""The same for a piece that does not reach to the ball's height (chosen)."""

# How far ahead of the anchor a face may be, in ball radii.
_REACH = 1.2

_CORNER_PX = 1.5

"""px from the corners of the face within which both edges blur into each other: a point spread is
about a pixel wide."""

# Share of its contrast that a row across the mass has at least.
_COVERED = 0.85

_BALL_MARGIN_PX = 2.5

"""px around the ball's outline that its blur may reach: two and a half standard deviations of a
point spread of one pixel."""

_DARKEST = 0.02

"""Of full scale: below this the gamma curve of a camera turns into a straight line (ITU-R BT.709
does at 0.018)."""

# Samples half a pixel apart, interpolated, coded in blocks: so many count as one.
_CORRELATED = 8.0

_MIN_STD_PX = 0.08

"""px (chosen): what an edge is off by besides noise, since its blur is no exact Gaussian."""

# F of two more parameters that is not met by chance, where a slot of the side may look alike.
_TELLING = 12.0

_MIN_CONTRAST = 0.06

"""Of the wall's light: less is shading of the wall itself (chosen)."""

_MIN_STRIP_PX = 0.7

"""px: a strip narrower than the point spread can't be distinguished from a blurred edge."""

# Light that a shadow leaves, between that of the face and of the wall.
_MIN_SHADE = 0.25

"""Of the light between that of the face and of the wall (chosen): what a shadow leaves at
least."""

_BLUR_PX = (0.4, 2.5)

"""px, standard deviation of the edge: sharper than pixels themselves average can't be measured, and
softer is no edge to measure."""

_MAX_TILT = 0.5

# Relative change of cost and parameters at which a fit has come to rest.
_SETTLED = 1e-6

_NORMAL_PEAK = float(1.0 / np.sqrt(2.0 * np.pi))


@dataclass(frozen=True)
class _Strip:
    """What is seen about the face, in the body's own axes, averaged over frames.

    Attributes
    ----------
    ahead, height : (n,) arrays
        Along the motion from the anchor, and along the arm from the ball's height, px.
    ratio : (n,) array
        Light over that of the scene behind: 1 where nothing is in front.
    """

    ahead: FloatArray
    height: FloatArray
    ratio: FloatArray

    def between(self, low: float, high: float) -> "_Strip":
        """The part of it from `low` to `high` along the motion."""
        kept = (self.ahead > low) & (self.ahead < high)
        return _Strip(self.ahead[kept], self.height[kept], self.ratio[kept])

    def on_the_mass(self, edge: float) -> "_Strip":
        """The heights at which the mass reaches from its middle to near the edge."""
        within = (self.ahead > 0.0) & (self.ahead < edge - _CORNER_PX)
        rows = np.unique(self.height[within])
        shade = [float(np.median(self.ratio[within & (self.height == row)])) for row in rows]
        contrast = np.abs(np.array(shade) - 1.0)
        usual = float(np.median(contrast)) if len(rows) else 0.0
        outside = rows[contrast < _COVERED * usual]
        away = np.abs(self.height[:, None] - outside[None]).min(axis=1, initial=np.inf)
        kept = away > _CORNER_PX
        return _Strip(self.ahead[kept], self.height[kept], self.ratio[kept])


def find_face(
    scene: FilmedScene, mass: MassPoses, rest: Rest, radius: float, *scenes_before: Backdrop
) -> Face:
    """Find the foremost edge of the mass at the ball's height, and the middle of its face.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    mass : MassPoses
        The mass as it was followed.
    rest : Rest
        The ball before it is struck.
    radius : float
        Its radius, px.
    *scenes_before : Backdrop
        The scene before the strike; the next is asked where no edge stands out before one.

    Returns
    -------
    Face
        Where no edge stands out, as far ahead as the piece that was followed reaches at the ball's
        height; where it does not reach there, what it is a part of may end far from it.
    """
    body = _Body.of(mass, rest)
    found, place = None, len(body.poses) - 1
    for before in scenes_before:
        look = _Look(scene, body, rest, radius, before)
        start = look.outermost(look.clear_by(_REACH * radius))
        if start is None:
            continue
        places = look.clear_by(start + max(_WALL * radius, _MIN_WALL_PX))
        strip = look.seen(places)
        if strip is not None:
            found = _fitted(strip, start, radius)
            place = int(places[-1])
        if found is not None:
            break
    cut = _cut_out_front(body, mass.patch, radius)
    # what does not move with the piece is smeared over the frames and shows no second rim
    apart = cut.edge_std >= _APART * radius
    if found is None or found.edge_std >= cut.edge_std or (apart and found.middle is None):
        found = cut

    def picture_px(ahead: float) -> FloatArray:
        return np.asarray(body.placed(np.array([[ahead, 0.0]]), place)[0])

    return Face(
        frame=int(body.frame[place]),
        edge_px=picture_px(found.edge),
        edge_std_px=found.edge_std,
        middle_px=None if found.middle is None else picture_px(found.middle),
        middle_std_px=found.middle_std,
    )


@dataclass(frozen=True)
class _Body:
    """Axes that go with the mass: its motion from the anchor, the arm from the ball's height."""

    frame: NDArray[np.int64]
    poses: tuple[Pose, ...]
    axes: FloatArray
    height: float

    @classmethod
    def of(cls, mass: MassPoses, rest: Rest) -> "_Body":
        """From the poses before the strike, or from the first where there is none."""
        count = max(int(np.count_nonzero(mass.frame <= rest.last)), 1)
        last = mass.poses[count - 1]
        arm = last.anchor - mass.arc.centre_px
        arm = arm / np.hypot(*arm)
        forward = np.array([arm[1], -arm[0]])
        forward = forward if forward @ rest.direction > 0 else -forward
        height = float((rest.centre_px - last.anchor) @ arm)
        return cls(mass.frame[:count], mass.poses[:count], np.stack([forward, arm]), height)

    def placed(self, spot: FloatArray, place: int) -> FloatArray:
        """Where points (n, 2) of the body lie in the picture, px."""
        pose = self.poses[place]
        turn = pose.turn - self.poses[-1].turn
        turning = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        return np.asarray(pose.anchor + (spot + np.array([0.0, self.height])) @ self.axes @ turning)


@dataclass(frozen=True)
class _Look:
    """What is seen about the face."""

    scene: FilmedScene
    body: _Body
    rest: Rest
    radius: float
    before: Backdrop

    def clear_by(self, ahead: float) -> NDArray[np.int64]:
        """The last poses in which so much ahead of the anchor is free of the ball, px."""
        middle = np.zeros((1, 2))
        every = range(len(self.body.poses))
        spot = np.array([self.body.placed(middle, place)[0] for place in every])
        gap = np.hypot(*(self.rest.centre_px - spot).T) - self.radius - _BALL_MARGIN_PX
        clear = np.flatnonzero(gap > ahead)
        return clear[-_FRAMES:] if len(clear) >= _MIN_COUNT else np.argsort(-gap)[:_MIN_COUNT][::-1]

    def seen(self, places: NDArray[np.int64]) -> _Strip | None:
        """Light over that of the scene behind, averaged over poses; None if hardly in view."""
        reach = max(_HALF_HEIGHT * self.radius, _MIN_HALF_HEIGHT_PX)
        along = np.arange(-_BACK * self.radius, _AHEAD * self.radius, _STEP_PX)
        rows = np.linspace(-reach, reach, 2 * int(np.ceil(reach)) + 1)
        spot = np.column_stack([grid.ravel() for grid in np.meshgrid(along, rows)])
        total, count = np.zeros(len(spot)), np.zeros(len(spot))
        for place in places:
            index = int(self.body.frame[place])
            at = self.body.placed(spot, int(place))
            free = np.hypot(*(at - self.rest.centre_px).T) > self.radius + _BALL_MARGIN_PX
            height, width = self.scene.shape
            free &= (at > 1).all(axis=1) & (at < [width - 2, height - 2]).all(axis=1)
            light = _light(_at(self.scene.picture(index), at) / self.scene.views[index].gain)
            total += free * light / _light(_at(self.before.in_frame(index), at))
            count += free
        enough = count >= max(_MIN_COUNT, 0.7 * len(places))
        if not enough.any():
            return None
        return _Strip(spot[enough, 0], spot[enough, 1], total[enough] / count[enough])

    def outermost(self, places: NDArray[np.int64]) -> float | None:
        """Where, going ahead from the middle of the mass, the wall begins, px; None if nowhere."""
        strip = self.seen(places)
        if strip is None:
            return None
        place = np.unique(strip.ahead)
        profile = np.array([np.median(strip.ratio[strip.ahead == one]) for one in place])
        inside = np.abs(place) < max(0.15 * self.radius, _STEP_PX)
        if not inside.any():
            return None
        side = float(np.median(profile[inside]))
        bare = (np.abs(profile - 1.0) <= 0.5 * abs(side - 1.0))[place > 0]
        wall = np.flatnonzero(bare)
        if abs(side - 1.0) < _MIN_CONTRAST or len(wall) == 0:
            return None
        # from light to dark a profile passes the wall's light without being wall
        wide = int(np.ceil(max(_WALL * self.radius, _MIN_WALL_PX) / _STEP_PX))
        lasting = [first for first in wall if bare[first : first + wide].all()]
        wall = np.array(lasting) if lasting else wall
        return float(place[place > 0][wall[0]]) - 0.5 * _STEP_PX


def _at(picture: FloatImage, spot: FloatArray) -> FloatArray:
    return np.asarray(sampled(picture, spot[:, 0], spot[:, 1]), dtype=float)


def _light(gray: FloatArray) -> FloatArray:
    """Light of a gray level, kept off zero, for it is divided by."""
    return np.asarray(np.maximum(gray / 255.0, _DARKEST) ** TYPICAL_GAMMA)


@dataclass(frozen=True)
class _Edges:
    edge: float
    edge_std: float
    middle: float | None
    middle_std: float


def _cut_out_front(body: _Body, patch: Patch, radius: float) -> _Edges:
    """How far ahead of the anchor a piece reaches at the ball's height, or anywhere, px."""
    pose = body.poses[-1]
    cosine, sine = np.cos(pose.turn), np.sin(pose.turn)
    solid = patch.opacity > 0.5
    x, y = patch.x[solid], patch.y[solid]
    ahead, along = body.axes @ [cosine * x - sine * y, sine * x + cosine * y]
    level = np.abs(along - body.height) < max(_HALF_HEIGHT * radius, _MIN_HALF_HEIGHT_PX)
    if level.any():
        return _Edges(float(ahead[level].max()), max(_CUT_OFF * radius, _CUT_OFF_PX), None, np.inf)
    return _Edges(float(ahead.max(initial=0.0)), _APART * radius, None, np.inf)


def _fitted(strip: _Strip, start: float, radius: float) -> _Edges | None:
    """The edge alone, or the two rims of the face where they can be distinguished."""
    beyond = max(_WALL * radius, _MIN_WALL_PX)
    strip = strip.on_the_mass(start).between(start - _STRIP * radius - 2.0, start + beyond)
    if len(strip.ahead) < 40:
        return None
    side = float(np.median(strip.ratio[strip.ahead < start - 1.0]))
    one = _StripFit.of(strip, np.array([start, 0.0, 0.8, 1.0, side]))
    span = start - float(strip.ahead.min())
    twos = [
        _StripFit.of(strip, np.array([start - 0.5 * width, 0.0, 0.8, 1.0, side, side, width]))
        for width in np.linspace(0.15, 0.85, 5) * span
    ]
    two = min(twos, key=lambda fit: fit.cost)
    shaded = [
        _StripFit.of(strip, np.array([*two.values, 0.5 * (two.values[3] + two.values[5]), width]))
        for width in (1.0, 3.0)
    ]
    three = min(shaded, key=lambda fit: fit.cost)
    wall, face, shade, deep = three.values[[3, 5, 7, 8]]
    between = _MIN_SHADE < (shade - face) / (wall - face + 1e-9) < 1.0 - _MIN_CONTRAST
    if three.tells_more_than(two) and between and deep > _MIN_STRIP_PX:
        two = three
    middle, width = float(two.values[0]), float(two.values[6])
    apart = abs(float(two.values[5] - two.values[4])) > _MIN_CONTRAST
    sharp = float(two.values[2]) < 0.95 * _BLUR_PX[1]
    if two.tells_more_than(one) and apart and sharp and _MIN_STRIP_PX < width < span - 1.0:
        return _Edges(
            middle + 0.5 * width,
            max(float(np.hypot(two.std[0], 0.5 * two.std[6])), _MIN_STD_PX),
            middle,
            max(float(two.std[0]), _MIN_STD_PX),
        )
    return _Edges(float(one.values[0]), max(float(one.std[0]), _MIN_STD_PX), None, np.inf)


@dataclass(frozen=True)
class _StripFit:
    values: FloatArray
    std: FloatArray
    cost: float
    free: float

    @classmethod
    def of(cls, strip: _Strip, start: FloatArray) -> "_StripFit":
        """Least squares of a blurred step, or of two of them."""

        def residuals(values: FloatArray) -> FloatArray:
            return _model(strip, values) - strip.ratio

        def slopes(values: FloatArray) -> FloatArray:
            return _slopes(strip, values)

        first, last = float(strip.ahead.min()), float(strip.ahead.max())
        low = np.array([first, -_MAX_TILT, _BLUR_PX[0], *[0.0] * 6])[: len(start)]
        most = [last, _MAX_TILT, _BLUR_PX[1], *[np.inf] * 3, last - first, np.inf, last - first]
        high = np.array(most)[: len(start)]
        scale = 1.4826 * float(np.median(np.abs(residuals(start)))) + 1e-3
        found = minimise(
            residuals,
            start,
            slopes=slopes,
            low=low,
            high=high,
            soft_from=scale,
            tolerance=_SETTLED,
        )
        left, jacobian = found.residuals, found.jacobian
        cost = float(left @ left)
        spread = cost / max(len(left) - len(start), 1) * _CORRELATED
        covariance = np.linalg.pinv(jacobian.T @ jacobian) * spread
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return cls(found.values, std, cost, len(left) / _CORRELATED - len(start))

    def tells_more_than(self, simpler: "_StripFit") -> bool:
        """Whether two parameters more make it better than chance does."""
        left = max(self.cost / max(self.free, 1.0), 1e-12)
        return 0.5 * (simpler.cost - self.cost) / left > _TELLING


@dataclass(frozen=True)
class _StripParts:
    """What a strip's parameters say; fewer of them leave out the second rim, then the shadow."""

    place: float
    tilt: float
    blur: float
    wall: float
    side: float
    face: float
    width: float
    shade: float
    deep: float

    @classmethod
    def of(cls, values: FloatArray) -> "_StripParts":
        place, tilt, blur, wall, side = (float(one) for one in values[:5])
        face, width = values[5:7] if len(values) > 5 else (side, 0.0)
        shade, deep = values[7:9] if len(values) > 7 else (wall, 0.0)
        more = (float(one) for one in (face, width, shade, deep))
        return cls(place, tilt, blur, wall, side, *more)

    def rims(self, strip: _Strip) -> tuple[FloatArray, FloatArray, FloatArray]:
        """How far points are behind the shadow's edge, the far rim and the near one, in blurs."""
        behind = self.place + self.tilt * strip.height - strip.ahead
        half = 0.5 * self.width
        return (
            (behind + half + self.deep) / self.blur,
            (behind + half) / self.blur,
            (behind - half) / self.blur,
        )


def _model(strip: _Strip, values: FloatArray) -> FloatArray:
    """Light over that behind: the wall, maybe the mass' shadow on it, the face, and the side."""
    parts = _StripParts.of(values)
    shadow, far, near = parts.rims(strip)
    shown = parts.wall + (parts.shade - parts.wall) * scipy.special.ndtr(shadow)
    shown += (parts.face - parts.shade) * scipy.special.ndtr(far)
    return np.asarray(shown + (parts.side - parts.face) * scipy.special.ndtr(near))


def _slopes(strip: _Strip, values: FloatArray) -> FloatArray:
    """How that changes with each parameter, (n, p)."""
    parts = _StripParts.of(values)
    rims = parts.rims(strip)
    covered = [np.asarray(scipy.special.ndtr(rim)) for rim in rims]
    # each step's height by its slope: what a pixel's move of its edge changes
    steps = (parts.shade - parts.wall, parts.face - parts.shade, parts.side - parts.face)
    edges = [
        step * np.exp(-0.5 * rim * rim) * (_NORMAL_PEAK / parts.blur)
        for step, rim in zip(steps, rims, strict=True)
    ]
    moved = edges[0] + edges[1] + edges[2]
    blurred = -(edges[0] * rims[0] + edges[1] * rims[1] + edges[2] * rims[2])
    wall, shade = 1.0 - covered[0], covered[0] - covered[1]
    face, side = covered[1] - covered[2], covered[2]
    width = 0.5 * (edges[0] + edges[1] - edges[2])
    columns = [moved, moved * strip.height, blurred, wall, side, face, width, shade, edges[0]]
    if len(values) < 9:
        columns[3] = wall + shade
    if len(values) < 7:
        columns[4] = side + face
    return np.column_stack(columns[: len(values)])
