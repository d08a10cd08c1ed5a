"""The pendulum mass as it was followed: its poses, and what it hides.

The pendulum mass before it strikes: what moved, stands behind the ball and nearly touches it.

What moved is often the mass together with its shadow, or with the bar. Thresholds from the noise up
to the strongest change peel one from the other; which of the pieces moves as one rigid thing is
told by following them.

Whether what was followed can have struck the ball: what two bodies do in a blow, in pixels.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.ball.ball import BallFits
from vision.ball.outline.edges import TYPICAL_GAMMA, Hides
from vision.ball.rest import Rest
from vision.pendulum.arc import Arc
from vision.pendulum.rigid import Patch, Pose
from vision.scene.scene import FilmedScene

__all__ = ["MassCandidate", "MassPoses", "Striking", "find_mass", "restitution_px", "striking"]

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

    def hides(self, index: int) -> Hides | None:
        """Where the mass stands in a frame, as something that may hide the ball."""
        place = int(np.searchsorted(self.frame, index))
        if place >= len(self.frame) or self.frame[place] != index:
            return None
        pose = self.poses[place]
        left, top = int(np.floor(self.patch.x.min())) - 1, int(np.floor(self.patch.y.min())) - 1
        columns = np.rint(self.patch.x - left).astype(np.int64)
        rows = np.rint(self.patch.y - top).astype(np.int64)
        solid = np.zeros((rows.max() + 2, columns.max() + 2), dtype=bool)
        solid[rows, columns] = self.patch.opacity > _SOLID
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

_LOOK_BACK = 40
"""Frames before the strike that are looked at for a mass, supposed: it swings through some of its
own widths in them."""

_LOWEST_SIGMA = 5.0
"""Standard deviations of noise: of a picture of a million pixels less than one passes by chance."""

_LEVELS = 5
"""Thresholds that are tried, each a fixed factor above the last, from noise to the strongest
difference."""

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
    before: FloatImage,
    at: tuple[float, float] | None = None,
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
    before : (H, W) float32 array
        The scene before the strike (`vision.scene.scene.scene_before_strike`).
    at : tuple of float, optional
        A point on the mass just before contact, px, where the user gave one.

    Returns
    -------
    tuple of MassCandidate
        Largest first: what moved as a whole, then the pieces of it that differ more and more from
        the scene. Empty if nothing moved behind the ball.
    """
    best: dict[int, MassCandidate] = {}
    free = max(3.0, 0.1 * radius)
    # Late enough to be near the ball, early enough to be seen free of it.
    for index in range(rest.last - 1, max(rest.last - _LOOK_BACK, -1), -2):
        for level, found in _pieces(scene, index, rest, radius, before, at):
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
    rest: Rest,
    radius: float,
    before: FloatImage,
    at: tuple[float, float] | None,
) -> Iterator[tuple[int, MassCandidate]]:
    """The piece nearest to the ball's rear at each threshold, in one frame."""
    picture = scene.picture(index)
    expected = np.asarray(before * np.float32(scene.views[index].gain))
    change = np.abs(cv2.GaussianBlur(picture - expected, (0, 0), 0.7))
    behind = _Behind(rest, radius, change.shape)
    lowest = _LOWEST_SIGMA * scene.background.noise
    if not np.any(behind.region):
        return
    strongest = float(np.percentile((change / lowest)[behind.region], 99.5))
    factors = np.geomspace(1.0, max(0.6 * strongest, 1.0), _LEVELS)
    for level, factor in enumerate(factors):
        moved = (change > factor * lowest) & behind.region
        member = behind.nearest(moved, at)
        if member is not None:
            yield level, _cut_out(scene, index, picture, expected, behind, member, moved)


class _Behind:
    """The part of the picture behind the ball, and distances in it."""

    def __init__(self, rest: Rest, radius: float, shape: tuple[int, ...]) -> None:
        self.rest, self.radius = rest, radius
        self.rows, self.columns = np.mgrid[0 : shape[0], 0 : shape[1]]
        x, y = self.columns - rest.centre_px[0], self.rows - rest.centre_px[1]
        along = x * rest.direction[0] + y * rest.direction[1]
        across = -x * rest.direction[1] + y * rest.direction[0]
        self.from_centre = np.hypot(x, y)
        self.region = self.from_centre > radius + 1.5
        self.region &= (along < 0) & (along > -4.0 * radius) & (np.abs(across) < 2.2 * radius)

    def nearest(self, moved: BoolArray, at: tuple[float, float] | None) -> BoolArray | None:
        """The thick piece nearest to the ball's rear, or to where the user points."""
        kernel = _disc(max(1, int(0.15 * self.radius)))
        thick = cv2.morphologyEx(moved.astype(np.uint8), cv2.MORPH_OPEN, kernel)
        count, labels = cv2.connectedComponents(thick)
        rear = self.rest.centre_px - self.rest.direction * (self.radius + 1.0)
        target = rear if at is None else np.array(at)
        away = np.hypot(self.columns - target[0], self.rows - target[1])
        best, best_gap = 0, 1.5 * self.radius
        for label in range(1, count):
            member = labels == label
            if np.count_nonzero(member) < max(12.0, 0.15 * self.radius**2):
                continue
            gap = float(away[member].min())
            if gap < best_gap:
                best, best_gap = label, gap
        return None if best == 0 else np.asarray(labels == best)


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


_BEFORE, _GAP, _AFTER = 10, 8, 14
"""Frames before the strike, between, and after it over which speeds are compared: the gap is longer
than any contact at usual rates, supposed."""

_FEWEST_PLACES = 4
"""Places: a straight line has two unknowns, and two more show whether it is one."""

# Balls give back a tenth to all of the speed of approach; the rest is the coarseness of this look.
_LEAST, _MOST = 0.1, 1.15


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
    agrees = _LEAST < restitution < _MOST
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
    late = rest.last + _GAP
    coming = _slope(mass.frame, angle, rest.last - _BEFORE, rest.last)
    going = _slope(mass.frame, angle, late, late + _AFTER)
    flying = _slope(ball.frame, ball.centre @ rest.direction, late, late + _AFTER)
    if coming is None or going is None or flying is None or coming * along <= 0.0:
        return None
    return (flying - going * along) / (coming * along)


def _slope(frame: NDArray[np.int64], value: FloatArray, first: int, last: int) -> float | None:
    used = (frame >= first) & (frame <= last)
    if np.count_nonzero(used) < _FEWEST_PLACES:
        return None
    return float(np.polyfit(frame[used].astype(np.float64), value[used], 1)[0])
