"""Where a thing of one colour is, from its silhouette: no edge need be sharp, nor the thing round.

In a picture in one colour (`FilmedScene.tinted`) a thing lies before the scene as a patch of about
one level, with soft edges, since codecs store colour coarsely. Its centre is that of the patch
inside which the change is more than half of the thing's own. Where a thing ends is a matter of
that level when it fades, as a bag about a ball does: the centres at a lower and a higher level say
how much, and that is stated. What is partly hidden shows an arc of its outline; a circle of the
size that it has in the other frames is laid through that. A ball may be paler where it is lit, and
what is behind it of another colour above than below: along each ray the outline is where the change
is half of what it is a little inside there, so that neither moves it to one side.

The colour is that in which what moves stands out: a ball as light as the wall may have another. A
shadow has no colour of its own and neither has a change of light, so that in colour differences
(C_B and C_R of ITU-R BT.601) only things are left. What moved there is weighed by its square; the
directions of that sum are the colours worth looking in. Codecs store colour at half the sharpness:
it is asked only where gray leaves doubt.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import scipy
import skimage
from numpy.typing import NDArray

from vision.ball.ball import BallFits
from vision.ball.choice import BallPath
from vision.ball.outline import OutlineFits, nothing_found
from vision.scene import FilmedScene, Window

__all__ = [
    "TINT_STD_PX",
    "follow_silhouette",
    "moving_colours",
]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
IntArray = NDArray[np.int64]

TINT_STD_PX = 0.25
"""px: colour samples lie at the left pixel of two, or between them, as few files tell (ITU-T H.273,
chroma sample location): half a pixel apart."""
_FRAMES = 15
"""Frames whose median shows the scene's own colour, supposed: a thing is elsewhere in most."""
_GRAIN = 2
"""px: colour is stored for each second one."""
_SMOOTH = 3
"""Colour samples that are averaged: a codec's blocks differ by less."""
_COLOUR_SIGMA = 8.0
"""Standard deviations of noise: see `MotionClock`."""
_LEAST_NOISE = 0.5
"""Levels: what rounding leaves, 1/√12, and the codec's quantiser."""
_FEWEST = 20
"""Colour samples that changed in all frames together: fewer are no thing."""
_LEAST_COLOUR = 5.0
"""Levels: a weaker colour is lost in the codec's quantiser, supposed."""


def moving_colours(scene: FilmedScene) -> list[FloatArray]:
    """Directions in the plane of C_B and C_R in which what moves differs from the scene.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.

    Returns
    -------
    list of (2,) arrays
        Unit vectors, the strongest first; none where what moves has no colour of its own.
    """
    wanted = scene.spread(_FRAMES)
    stack = np.stack([_colour_differences(image) for _, image in scene.coloured(wanted)])
    change = stack - np.median(stack, axis=0)
    noise = 1.4826 * np.median(np.abs(change), axis=(0, 1, 2)) + _LEAST_NOISE
    moved = change[np.sum((change / noise) ** 2, axis=3) > _COLOUR_SIGMA**2]
    if len(moved) < _FEWEST:
        return []
    square, axes = np.linalg.eigh((moved.T @ moved / len(moved)).astype(np.float64))
    return [axes[:, k] for k in (1, 0) if square[k] > _LEAST_COLOUR**2]


def _colour_differences(image: NDArray[np.uint8]) -> FloatImage:
    """C_B and C_R (h, w, 2) of an image (H, W, 3), blue first."""
    size = (max(1, image.shape[1] // _GRAIN), max(1, image.shape[0] // _GRAIN))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    both = cv2.cvtColor(small, cv2.COLOR_BGR2YCrCb)[:, :, :0:-1].astype(np.float32)
    return np.asarray(cv2.blur(both, (_SMOOTH, _SMOOTH)), dtype=np.float32)


_LEVELS = (0.35, 0.5, 0.65)
"""Of a thing's own change: half, and as far below and above it as the middle third of its edge."""
_SOFT = 0.3
"""Of a thing's own change: over so much a pixel passes from outside to inside, as an edge."""
_BAND, _BEYOND, _RAY_STEP_PX = (0.15, 0.3), 0.3, 0.25
"""Radii inside a thing's outline whose median change is its own there, beyond the edge's softness
and near enough to share its light, supposed; radii outside it that are looked at; and px between
samples of a ray, a tenth of what codecs leave of an edge in colour."""
_REACH = 2.2
"""Radii about the guess that are looked at: a streak of two diameters, and what is behind."""
_CORE = 0.5
"""Radii about the guess whose median is the thing's own change: half of it may be hidden."""
_SIGMA = 6.0
"""Standard deviations of noise below which nothing is told: see `vision.scene`."""
_LEAST_SOLID = 0.8
"""Area over that of the ellipse of the same moments: one for a disc, 0.97 for a square; what has a
hole or an arm has less; supposed."""
_FIRST_OFF, _LAST_OFF, _ARC_STEPS = 0.3, 0.03, 12
"""Radii off a circle at which a point of an outline counts a quarter, at first and at last; and
steps in between; supposed."""
_FEWEST_POINTS = 12
"""Points of an outline: four times a circle's unknowns."""
_ROUND, _MOSTLY, _LEAST_ARC, _MOST_BEYOND, _WHOLE_RIM = 0.5, 0.5, 0.3, 0.1, 0.8
"""Share of the rim on the circle of what is round; of the frames in which it must be; share of the
rim that holds a circle of known size; of an outline, outside; and of a rim from which on it does
not matter what lies outside, since a streak has two caps; supposed."""
_OTHER_SIZE = 2.0
"""Factor between two sizes from which on they are of two things, supposed: what comes nearer grows
by less while it is in view."""
_RIM_PARTS = 36
"""Parts of a rim, one each 10°, in which points are counted."""
_COURSE, _MOST_MISSED, _AHEAD_SHARE = 4, 2, 0.5
"""Frames that foretell the next; frames without a patch that end the search; and share of a frame's
way that a thing may lie off where it was foretold."""
_SIZE_FRAMES = 15
"""Frames, the nearest, that tell the size at one: the median of fifteen leaves out seven."""
_INDEPENDENT = 8
"""Independent parts that an outline is taken to have: see `vision.ball.outline`."""


_LET_GO = 0.2
"""Log radius by which a patch shrinks from frame to frame where what held it lets go, supposed: a
ball that comes nearer at ten frames a second grows by a tenth."""


@dataclass(frozen=True)
class _Patch:
    """The patch above one level: centre (2,), half widths, solidity, and which pixels it is."""

    centre: FloatArray
    narrow: float
    wide: float
    solid: float
    piece: NDArray[np.uint8]


@dataclass(frozen=True)
class _Silhouette:
    """What is seen in one frame.

    Attributes
    ----------
    centre, covariance : (2,) and (2, 2) arrays
        Of the patch, px; and by how much that depends on where the thing is taken to end, px².
    narrow, wide : float
        Its half widths, px.
    solid : float
        Its area over that of the ellipse of the same moments.
    outline : (n, 2) array
        Points of its outline, px.
    """

    centre: FloatArray
    covariance: FloatArray
    narrow: float
    wide: float
    solid: float
    outline: FloatArray


@dataclass(frozen=True)
class _Circle:
    """A circle through part of an outline.

    Attributes
    ----------
    centre, covariance : (2,) and (2, 2) arrays
        px, and px².
    radius : float
        px.
    share : float
        Of the rim, where the outline lies on it.
    beyond : float
        Of the outline, what lies outside: a streak does, what is hidden or cut off does not.
    """

    centre: FloatArray
    covariance: FloatArray
    radius: float
    share: float
    beyond: float

    @property
    def whole(self) -> bool:
        """Whether a disc, of which something may be hidden, has this outline."""
        hidden = self.share > _LEAST_ARC and self.beyond < _MOST_BEYOND
        return hidden or self.share > _WHOLE_RIM


def follow_silhouette(scene: FilmedScene, path: BallPath) -> BallFits:
    """Follow a thing of one colour along a path and beyond its ends for as long as it is seen.

    Parameters
    ----------
    scene : FilmedScene
        In one colour: see `FilmedScene.tinted`.
    path : BallPath
        Where it was in some frames.

    Returns
    -------
    BallFits
        `contrast` is how solid its patch is, or the share of the rim that is seen.
    """
    return _Silhouettes(scene, path.radius).along(path)


class _Silhouettes:
    """Patches by frame, and circles through what is seen of their outlines."""

    def __init__(self, scene: FilmedScene, radius: float) -> None:
        self._scene, self._radius = scene, radius
        self._seen: dict[int, _Silhouette] = {}

    def along(self, path: BallPath) -> BallFits:
        """Everything that is found."""
        frame = np.arange(int(path.frame[0]), int(path.frame[-1]) + 1)
        guess = np.column_stack([np.interp(frame, path.frame, x) for x in path.centre_px.T])
        self._look(frame, guess)
        for direction in (-1, 1):
            self._go_on(direction)
        return self._fitted()

    def _look(self, frame: IntArray, guess: FloatArray) -> None:
        scene = self._scene
        windows = [_window(start, self._radius, scene.shape) for start in guess]
        for place, (index, picture) in enumerate(scene.windows(frame, windows)):
            corner = _corner(windows[place])
            start = guess[place] - corner
            ratio = _own_change(scene, index, picture, windows[place], start, self._radius)
            seen = None if ratio is None else _silhouette(ratio, start, corner, self._radius)
            if seen is not None:
                self._seen[index] = seen

    def _go_on(self, direction: int) -> None:
        """Beyond an end, straight on from the last few frames."""
        known = np.array(sorted(self._seen), dtype=np.int64)
        if len(known) < _COURSE:
            return
        missed, index = 0, int(known[-1 if direction > 0 else 0]) + direction
        while 0 <= index < self._scene.count and missed < _MOST_MISSED:
            known = np.array(sorted(self._seen), dtype=np.int64)
            last = known[-_COURSE:] if direction > 0 else known[:_COURSE]
            place = np.array([self._seen[int(at)].centre for at in last])
            course = np.polyfit(last - index, place, 1)
            if not np.all((course[-1] > 0.0) & (course[-1] < np.array(self._scene.shape)[::-1])):
                return
            self._look(np.array([index]), course[-1:])
            seen = self._seen.get(index)
            missed += 1
            if seen is not None:
                away = float(np.hypot(*(seen.centre - course[-1])))
                if away < self._radius + _AHEAD_SHARE * float(np.hypot(*course[0])):
                    missed = 0
                else:
                    del self._seen[index]
            index += direction

    def _fitted(self) -> BallFits:
        """Circles where the thing is round; patches where it is not, or smeared."""
        frame = np.array(sorted(self._seen), dtype=np.int64)
        fits = nothing_found(len(frame))
        seen = [self._seen[int(index)] for index in frame]
        # What is cut off by something before it is as wide as it is.
        free = [_circle(one.outline, one.centre, one.wide, None) for one in seen]
        good = np.array(
            [one is not None and one.whole and one.share > _ROUND for one in free], dtype=bool
        )
        known = np.flatnonzero(good)
        round_thing = len(known) >= max(_COURSE, _MOSTLY * len(seen))
        size = np.array([0.0 if one is None else one.radius for one in free])
        for row, one in enumerate(seen):
            circle = free[row]
            if round_thing:
                near = np.sort(known[np.argsort(np.abs(frame[known] - frame[row]))[:_SIZE_FRAMES]])
                radius = _size_at(int(frame[row]), frame[near], size[near])
                start = one.centre if circle is None else circle.centre
                circle = _circle(one.outline, start, radius, radius)
                if circle is not None and circle.whole and _of_size(circle.radius, self._radius):
                    covariance = circle.covariance + one.covariance
                    _write(fits, row, circle.centre, covariance, circle.radius, circle.share)
                    continue
            if one.solid > _LEAST_SOLID and _of_size(one.narrow, self._radius):
                covariance = one.covariance.copy()
                if circle is not None:
                    # Two outlines of one thing: neither is known to be the right one.
                    gap = circle.centre - one.centre
                    covariance += 0.25 * np.outer(gap, gap)
                _write(fits, row, one.centre, covariance, one.narrow, one.solid)
        return _let_go(BallFits(frame, fits).at(fits.found))


def _let_go(fits: BallFits) -> BallFits:
    """Without the ends in which its patch is one with that of what holds it, a hand say.

    From one frame to the next a patch of both shrinks to the thing's own, which nothing that comes
    nearer does.
    """
    size = np.log(fits.radius)
    half = (len(size) + 1) // 2
    first = _held_until(size, half)
    last = len(size) - _held_until(size[::-1], len(size) - half)
    rows = np.arange(len(size))
    return fits.at((rows >= first) & (rows < last))


def _held_until(size: FloatArray, half: int) -> int:
    """How many of the first log radii (n,), at most `half`, are those of a thing that is held."""
    until = 0
    for row in range(1, half + 1):
        own = size[row : row + _SIZE_FRAMES]
        if len(own) < _COURSE or abs(size[row] - size[row - 1]) < _LET_GO:
            continue
        if float(np.median(size[:row]) - np.median(own)) > _LET_GO:
            until = row
    return until


def _write(
    fits: OutlineFits,
    row: int,
    centre: FloatArray,
    covariance: FloatArray,
    radius: float,
    contrast: float,
) -> None:
    siting = TINT_STD_PX**2 * np.eye(2)
    fits.found[row] = True
    fits.centre[row], fits.radius[row] = centre, radius
    fits.covariance[row], fits.bound[row] = covariance + siting, siting
    fits.rms_residual[row], fits.contrast[row] = 1.0, contrast


def _of_size(found: float, known: float) -> bool:
    """Whether a size may be that of the thing looked for: a panel of a ball is another thing."""
    return known / _OTHER_SIZE < found < known * _OTHER_SIZE


def _size_at(index: int, frame: IntArray, radius: FloatArray) -> float:
    """The radius at a frame, by a robust line through those near it: what comes nearer grows."""
    if len(frame) < 2 * _COURSE:
        return float(np.median(radius))
    _, level, _, _ = scipy.stats.theilslopes(radius, frame - index)
    return float(np.clip(level, 0.8 * radius.min(), 1.25 * radius.max()))


def _window(start: FloatArray, radius: float, shape: tuple[int, int]) -> Window:
    reach = _REACH * radius + 4.0
    low = np.clip(np.floor(start - reach), 0, [shape[1], shape[0]]).astype(int)
    high = np.clip(np.ceil(start + reach) + 1, 0, [shape[1], shape[0]]).astype(int)
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _corner(window: Window) -> FloatArray:
    return np.array([window[1].start, window[0].start], dtype=np.float64)


def _own_change(
    scene: FilmedScene,
    index: int,
    picture: NDArray[np.floating] | NDArray[np.uint8],
    window: Window,
    guess: FloatArray,
    radius: float,
) -> FloatImage | None:
    """Change of each pixel over the thing's own; None where there is nothing."""
    if min(picture.shape) < 4:
        return None
    change = picture.astype(np.float32) - scene.expected(index, window)
    rows, columns = np.mgrid[: change.shape[0], : change.shape[1]]
    core = np.hypot(columns - guess[0], rows - guess[1]) < max(_CORE * radius, 1.5)
    if not core.any():
        return None
    own = float(np.median(change[core]))
    if abs(own) < _SIGMA * float(np.median(scene.noise_in(index, window))):
        return None
    return np.asarray(change / np.float32(own), dtype=np.float32)


def _silhouette(
    ratio: FloatImage, guess: FloatArray, corner: FloatArray, radius: float
) -> _Silhouette | None:
    patches = [_patch(ratio, level, guess, radius) for level in _LEVELS]
    found = [patch for patch in patches if patch is not None]
    middle = patches[len(patches) // 2]
    if middle is None or len(found) < len(_LEVELS):
        return None
    contours = skimage.measure.find_contours(ratio * middle.piece, _LEVELS[1])  # type: ignore[no-untyped-call]
    points = np.concatenate([*contours, np.zeros((0, 2))])[:, ::-1]
    inside = np.all((points > 0.5) & (points < np.array(ratio.shape)[::-1] - 1.5), axis=1)
    outline = _halfway(ratio, points[inside], middle.centre, middle.wide)
    return _Silhouette(
        middle.centre + corner,
        np.cov(np.array([patch.centre for patch in found]).T),
        middle.narrow,
        middle.wide,
        middle.solid,
        outline + corner,
    )


def _halfway(
    ratio: FloatImage, outline: FloatArray, centre: FloatArray, radius: float
) -> FloatArray:
    """Points near an outline where the change is half of what it is a little inside there."""
    if len(outline) == 0:
        return outline
    away = outline - centre
    outwards = away / np.maximum(np.hypot(*away.T), 1e-6)[:, None]
    steps = np.arange(-_BAND[1] * radius, _BEYOND * radius, _RAY_STEP_PX)
    x, y = np.moveaxis(outline[:, None] + outwards[:, None] * steps[:, None], 2, 0)
    along = scipy.ndimage.map_coordinates(ratio, [y, x], order=1, cval=np.nan)
    band = steps <= -_BAND[0] * radius
    half = _LEVELS[1] * np.median(along[:, band], axis=1)
    below = (along < half[:, None]) & ~band
    after, rows = np.argmax(below, axis=1), np.arange(len(outline))
    # what is nothing a little inside, as before what hides it, has no edge of its own there
    seen = below.any(axis=1) & (half > _LEVELS[0] * _LEVELS[1])
    before = np.maximum(after - 1, 0)
    fall = along[rows, before] - along[rows, after]
    part = (along[rows, before] - half) / np.where(fall > 0.0, fall, 1.0)
    found = outline + outwards * (steps[before] + np.clip(part, 0.0, 1.0) * _RAY_STEP_PX)[:, None]
    return np.asarray(found[seen & np.isfinite(part)])


def _patch(ratio: FloatImage, level: float, guess: FloatArray, radius: float) -> _Patch | None:
    """The piece above a level that has most in common with a disc about the guess."""
    count, labels = cv2.connectedComponents((ratio > level).astype(np.uint8))
    if count < 2:
        return None
    rows, columns = np.mgrid[: ratio.shape[0], : ratio.shape[1]]
    near = np.hypot(columns - guess[0], rows - guess[1]) < radius
    shared = np.bincount(labels[near], minlength=count)
    shared[0] = 0
    best = int(np.argmax(shared))
    if shared[best] == 0:
        return None
    grown = cv2.dilate((labels == best).astype(np.uint8), np.ones((3, 3), np.uint8))
    piece = np.asarray(grown, dtype=np.uint8)
    weight = np.clip((ratio - level) / _SOFT + 0.5, 0.0, 1.0) * piece
    area = float(weight.sum())
    x, y = float((weight * columns).sum()) / area, float((weight * rows).sum()) / area
    pairs = np.stack([(columns - x).ravel(), (rows - y).ravel()])
    moment = (pairs * weight.ravel()) @ pairs.T
    narrow, wide = 2.0 * np.sqrt(np.maximum(np.linalg.eigvalsh(moment / area), 1e-6))
    solid = area / (np.pi * narrow * wide)
    return _Patch(np.array([x, y]), float(narrow), float(wide), float(solid), piece)


def _circle(
    points: FloatArray, start: FloatArray, size: float, radius: float | None
) -> _Circle | None:
    """Lay a circle, of known radius or not, through what is seen of an outline.

    What hides the rest of it has an outline, too: points far off count less and less.
    """
    if len(points) < _FEWEST_POINTS:
        return None
    centre, now = start.copy(), size
    for tolerance in np.geomspace(_FIRST_OFF, _LAST_OFF, _ARC_STEPS) * size:
        away = points - centre
        distance = np.maximum(np.hypot(*away.T), 1e-6)
        normals, left = away / distance[:, None], distance - now
        weight = 1.0 / (1.0 + (left / tolerance) ** 2) ** 2
        design = normals if radius is not None else np.column_stack([normals, np.ones(len(left))])
        weighted = design * weight[:, None]
        normal = weighted.T @ design + 1e-6 * np.eye(design.shape[1])
        step = np.linalg.solve(normal, weighted.T @ left)
        centre = centre + step[:2]
        now = now if radius is not None else now + float(step[2])
        if np.hypot(*(centre - start)) > size or not _of_size(now, size):
            return None
    on = np.abs(left) < 2.0 * _LAST_OFF * size
    turn = np.arctan2(normals[on, 1], normals[on, 0])
    parts = np.unique(((turn / (2 * np.pi) + 0.5) * _RIM_PARTS).astype(int) % _RIM_PARTS)
    share = len(parts) / _RIM_PARTS
    if share == 0.0:
        return None
    # Points of one part of an outline are off together.
    scatter = float(np.sum(weight * left**2)) / float(weight.sum())
    inverse = np.linalg.inv(normal / float(weight.sum()) * _INDEPENDENT * share)
    covariance = (scatter + TINT_STD_PX**2) * inverse[:2, :2]
    beyond = float(np.mean(left > 2.0 * _LAST_OFF * size))
    return _Circle(centre, covariance, now, share, beyond)
