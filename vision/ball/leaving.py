"""What lay still and left as one, found by how it moves where its outline is hardly seen.

A white ball before a white wall shows a panel here and its shaded side there, and each of them is
round by itself; leaving slowly, it is half gone from the static scene. But all that belongs to it
left together. Two steps find it:

A part of what the first pictures show and the last ones don't is looked for, as it looked at rest,
from look to look: that gives the course of what left, whichever part of it that is.

Along a course all looks are laid upon one another. What goes along it stands still there, and is
unlike the scene in each of them; what does not is like the scene in most. Of the discs that show so
the outline is fitted in some looks, each by itself: a ball's fits agree.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled
from vision.ball.ball import outlines_near
from vision.ball.choice import BallPath
from vision.ball.courses import lawful_course
from vision.scene import FilmedScene, median_of

__all__ = ["discs_along", "left_at_last"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
IntArray = NDArray[np.int64]

_LOOKS = 160
"""Looks at most: a ball that leaves slowly takes a hundred frames for a diameter or two."""
_WIDTH = 480
"""px: larger pictures are taken at a coarser grain, in which such a ball still has its radius."""
_NOISE_FLOOR = 0.5
"""Gray levels: what codecs leave is no less, however many pixels are averaged."""
_END_SHARE = 0.2
"""Share of the looks that shows the scene as it begins and as it ends, as an epoch of it."""
_CAP = 9.0
"""Square of three standard deviations: what is further off is unlike, however far."""
_PART, _PART_BLOCK = 4.0, 5
"""px of the grain: radius of a part that is looked for, and side of the square in which its corners
count; a ball that can be measured is as large."""
_UNLIKE, _LEAST_QUALITY = 6.0, 0.01
"""Standard deviations by which the first looks differ from the last where something left; and share
of the clearest corner's least eigenvalue that another has, a tenth of its contrast."""
_PARTS, _COURSES, _DISCS = 24, 3, 12
"""Parts that are looked for, courses that are followed and discs that are fitted, at most: what
left shows itself among the first few of each."""
_REACH = 3
"""px of the grain on either side of where the looks before lead: more than a look's way changes."""
_STEADY, _FRESH, _SAME_LIGHT = 0.6, 0.15, 5.0
"""Shares of the last look's velocity and of its light that are taken over: averages of some looks,
since what leaves turns; and standard deviations beyond which a pixel is hidden by something."""
_FEWEST_STILL, _FEWEST_MOVING = 5, 6
"""Looks, of rest and of a parabola with as many to spare as it has unknowns."""
_GONE = 1.5
"""px of the grain from which a thing's own edge no longer covers where it was."""
_ABOUT = 4.0
"""Radii of a part around its course within which its whole is looked for, at least 40 px."""
_ABOUT_PX = 40.0
_SURE, _FULL = 2.0, 10.0
"""Standard deviations of a mean change from which a pixel counts as changed, and in full."""
_SECTORS = 16
"""Sectors of a rim, as of circles of edges."""
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 2 * _SECTORS, endpoint=False)
_RIM_TURNS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Directions (2, 32) in which a rim is looked at."""
_ADJOINED = 0.25
"""Supposed: probability that a sector has another thing, such as its shadow, against it."""
_SOFT_LIMIT = 0.02
"""Probability that a pixel was told wrongly."""
_SMALLEST, _RATIO = 3.5, 0.06
"""px of the grain, and log of a radius to the next, within the width of a rim."""
_RIM, _RIM_PX, _GAP_PX = 0.15, 1.5, 0.5
"""Radii, and px at least, of a rim on either side of an outline; and half an edge's own width."""
_LIKE_SIZE = 0.3
"""Log radius by which two discs about one place are of another size."""
_FITTED = 16
"""Looks in which a disc's outline is fitted: their scatter is good to a fifth."""
_LOOSE = 0.2
"""Log radius over which fits that have nothing in common would scatter."""
_LEAST_SCATTER_PX, _LEAST_SWELLING = 0.05, 0.01
"""px, and log radius: fits scatter by no less."""
_AGREED = 4.0
"""Nats a look by which outlines agree in place and size better than by chance, of a whole outline;
supposed: balls before a wall of their lightness have 4.5 to 7, others 9 and more, discs about a
ball and its shadow together 2."""


@dataclass(frozen=True)
class Looked:
    """Looks at a scene, at the grain at which they are compared, in one light.

    Attributes
    ----------
    frame : (n,) int array
        Frame indices.
    picture : (n, H, W) float32 array
        Gray levels.
    first, last : (H, W) float32 arrays
        What the first looks show, and the last ones.
    noise : float
        Standard deviation of a pixel of a look, gray levels.
    grain : int
        px of the clip in one of these.
    """

    frame: IntArray
    picture: FloatImage
    first: FloatImage
    last: FloatImage
    noise: float
    grain: int

    @classmethod
    def at(cls, scene: FilmedScene) -> "Looked":
        """Look at what moves in a scene."""
        frame, grain = scene.spread(_LOOKS), max(1, -(-scene.shape[1] // _WIDTH))
        size = (scene.shape[1] // grain, scene.shape[0] // grain)
        kept = (slice(size[1] * grain), slice(size[0] * grain))
        pictures = [
            cv2.resize(seen[kept] / scene.views[index].gain, size, interpolation=cv2.INTER_AREA)
            for index, seen in scene.pictures(frame)
        ]
        every = np.stack(pictures).astype(np.float32)
        ends = max(3, round(_END_SHARE * len(frame)))
        first, last = median_of(list(every[:ends])), median_of(list(every[-ends:]))
        return cls(frame, every, first, last, max(scene.noise / grain, _NOISE_FLOOR), grain)

    def row(self, frame: IntArray) -> IntArray:
        """Rows of frames that were looked at."""
        return np.searchsorted(self.frame, frame)

    def far(self, place: FloatArray) -> FloatArray:
        """Places of the grain, px of the clip."""
        return place * self.grain + 0.5 * (self.grain - 1)

    def near(self, place: FloatArray) -> FloatArray:
        """Places in the clip, px of the grain."""
        return (place - 0.5 * (self.grain - 1)) / self.grain


@dataclass(frozen=True)
class Course:
    """How far something had come in each look.

    Attributes
    ----------
    row : (n,) int array
        Looks.
    shift : (n, 2) array
        px of the grain, from where it lay.
    start : (2,) array
        Where it, or a part of it, lay.
    radius : float
        Of that part.
    evidence : float
        For a rest and a law, nats.
    """

    row: IntArray
    shift: FloatArray
    start: FloatArray
    radius: float
    evidence: float


def left_at_last(scene: FilmedScene) -> list[BallPath]:
    """Paths of round things that lay still at first and left as one, most likely first.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.

    Returns
    -------
    list of BallPath
    """
    looked = Looked.at(scene)
    if len(looked.frame) < _FEWEST_STILL + _FEWEST_MOVING:
        return []
    courses = sorted(_courses(looked), key=lambda course: course.evidence, reverse=True)
    found = [pair for one in courses[:_COURSES] for pair in _discs(scene, looked, one)]
    return [path for _, path in sorted(found, key=lambda pair: pair[0], reverse=True)]


def discs_along(
    scene: FilmedScene, frame: IntArray, centre: FloatArray, radius: float
) -> list[BallPath]:
    """Paths of round things that went along with what was followed from where it lay.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    frame : (N,) int array
        Frames in which it was followed.
    centre : (N, 2) array
        Where, px.
    radius : float
        Its radius, px.

    Returns
    -------
    list of BallPath
        Itself among them, where it is round.
    """
    looked = Looked.at(scene)
    common, _, own = np.intersect1d(looked.frame, frame, return_indices=True)
    place = looked.near(centre[own])
    course = _as_course(looked.row(common), place, radius / looked.grain)
    if course is None:
        return []
    found = sorted(_discs(scene, looked, course), key=lambda pair: pair[0], reverse=True)
    return [path for _, path in found]


def _courses(looked: Looked) -> list[Course]:
    """Courses of what the first looks show and the last ones don't."""
    rows = np.arange(len(looked.frame))
    found = []
    for place in _parts(looked):
        way = _template_way(looked, place)
        course = _as_course(rows, way, _PART)
        if course is not None:
            found.append(course)
    return found


def _parts(looked: Looked) -> FloatArray:
    """Where the first looks show what can be told from its surroundings (n, 2), px of the grain.

    Corners (Shi and Tomasi 1994), since an edge does not tell how it goes along itself; the last
    looks show less there.
    """
    ends = max(3, round(_END_SHARE * len(looked.frame)))
    std = looked.noise * math.sqrt(math.pi / ends)
    corner, later = (
        cv2.cornerMinEigenVal(image, _PART_BLOCK) for image in (looked.first, looked.last)
    )
    gone = (np.abs(looked.first - looked.last) > _UNLIKE * std) & (corner > later)
    best = cv2.goodFeaturesToTrack(
        looked.first, _PARTS, _LEAST_QUALITY, _PART, mask=gone.astype(np.uint8)
    )
    return np.zeros((0, 2)) if best is None else best.reshape(-1, 2).astype(np.float64)


def _as_course(row: IntArray, place: FloatArray, radius: float) -> Course | None:
    """The course of what lay still and left by a law; None where it did not."""
    if len(row) < _FEWEST_STILL + _FEWEST_MOVING:
        return None
    law = lawful_course(row, place, radius)
    if law.still < _FEWEST_STILL or law.moving < _FEWEST_MOVING:
        return None
    start = np.median(place[:_FEWEST_STILL], axis=0)
    return Course(row, place - start, start, radius, law.evidence(radius))


def _template_way(looked: Looked, centre: FloatArray) -> FloatArray:
    """Where what lay about a place at first is in each look (n, 2), px of the grain."""
    reach = int(np.ceil(_PART))
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    inside = np.hypot(rows, columns) <= _PART
    way = np.empty((len(looked.frame), 2))
    offsets = np.stack([columns[inside], rows[inside]])
    middle = np.rint(centre).astype(np.int64)
    _followed(looked.picture, looked.first, offsets, middle, looked.noise, way)
    return way


@compiled
def _followed(
    picture: FloatImage,
    first: FloatImage,
    offsets: IntArray,
    middle: IntArray,
    noise: float,
    way: FloatArray,
) -> None:
    """Write where a template is most alike in each look, near where the looks before lead."""
    height, width = first.shape
    count = offsets.shape[1]
    template = np.empty(count)
    for k in range(count):
        column = min(max(middle[0] + offsets[0, k], 0), width - 1)
        template[k] = first[min(max(middle[1] + offsets[1, k], 0), height - 1), column]
    side = 2 * _REACH + 1
    cost = np.empty((side, side))
    x, y, along, down = float(middle[0]), float(middle[1]), 0.0, 0.0
    for look in range(len(picture)):
        left, top = int(np.rint(x + along)) - _REACH, int(np.rint(y + down)) - _REACH
        best_row, best_column = 0, 0
        for i in range(side):
            for j in range(side):
                total = 0.0
                for k in range(count):
                    column = min(max(left + j + offsets[0, k], 0), width - 1)
                    row = min(max(top + i + offsets[1, k], 0), height - 1)
                    off = (picture[look, row, column] - template[k]) / noise
                    total += min(off * off, _CAP)
                cost[i, j] = total
                if total < cost[best_row, best_column]:
                    best_row, best_column = i, j
        new_x = left + best_column + _vertex(cost[best_row], best_column)
        new_y = top + best_row + _vertex(cost[:, best_column], best_row)
        if look > 0:
            along += (1.0 - _STEADY) * (new_x - x - along)
            down += (1.0 - _STEADY) * (new_y - y - down)
        x, y = new_x, new_y
        way[look, 0], way[look, 1] = x, y
        for k in range(count):
            column = min(max(left + best_column + offsets[0, k], 0), width - 1)
            row = min(max(top + best_row + offsets[1, k], 0), height - 1)
            off = picture[look, row, column] - template[k]
            if abs(off) < _SAME_LIGHT * noise:
                template[k] += _FRESH * off


@compiled
def _vertex(cost: FloatArray, place: int) -> float:
    """How far from a lowest value the vertex of the parabola through it and its neighbours is."""
    if place == 0 or place == len(cost) - 1:
        return 0.0
    bend = cost[place - 1] + cost[place + 1] - 2.0 * cost[place]
    return 0.5 * (cost[place - 1] - cost[place + 1]) / bend if bend > 0.0 else 0.0


def _discs(scene: FilmedScene, looked: Looked, course: Course) -> list[tuple[float, BallPath]]:
    """Discs that go along a course, each with how well its outlines agree, nats."""
    gone = np.flatnonzero(np.hypot(*course.shift.T) > _GONE)
    if len(gone) < _FEWEST_MOVING:
        return []
    corner, changed = _changed_along(looked, course, gone)
    rows = gone[np.unique(np.linspace(0, len(gone) - 1, _FITTED).astype(np.int64))]
    found = []
    for x, y, radius in _round_in(changed, 0.25 * min(looked.first.shape)):
        pair = _agreeing(scene, looked, course, rows, corner + np.array([x, y]), radius)
        if pair is not None:
            found.append(pair)
    return found


def _changed_along(looked: Looked, course: Course, rows: IntArray) -> tuple[FloatArray, FloatImage]:
    """How surely each pixel that goes along a course is unlike the scene, 0 to 1, and its corner.

    The scene is what the first or the last looks show, whichever is nearer: each is hidden where
    the thing lay or lies.
    """
    about = max(_ABOUT * course.radius, _ABOUT_PX)
    low = np.maximum(course.start - about, 0).astype(int)
    high = np.minimum(course.start + about + 1, looked.first.shape[::-1]).astype(int)
    y, x = np.mgrid[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    total = np.zeros(x.shape, dtype=np.float32)
    for row in rows.tolist():
        along, down = course.shift[row].astype(np.float32)
        unlike = [
            np.abs(_sampled(looked.picture[course.row[row]] - still, x + along, y + down))
            for still in (looked.first, looked.last)
        ]
        total += np.minimum(np.minimum(*unlike) / looked.noise, math.sqrt(_CAP)) ** 2
    # The mean square of noise alone is 1, with this standard deviation.
    std = math.sqrt(2.0 / len(rows))
    sure = (total / len(rows) - 1.0 - _SURE * std) / ((_FULL - _SURE) * std)
    return low.astype(np.float64), np.clip(sure, _SOFT_LIMIT, 1.0 - _SOFT_LIMIT).astype(np.float32)


def _sampled(image: FloatImage, x: FloatImage, y: FloatImage) -> FloatImage:
    return np.asarray(
        cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32
    )


def _round_in(changed: FloatImage, largest: float) -> list[tuple[int, int, float]]:
    """Discs (column, row, radius) that changed up to their rim and not beyond it, likeliest first.

    Of each sector of a rim either nothing beyond it changed, or something else is there.
    """
    steps = int(max(math.log(largest / _SMALLEST) / _RATIO, 0.0)) + 1
    radii = _SMALLEST * np.exp(_RATIO * np.arange(steps))
    score = np.empty((steps, *changed.shape))
    _score_rims(changed, radii, _RIM_TURNS, score)
    rows, columns = np.ogrid[: changed.shape[0], : changed.shape[1]]
    found = []
    for _ in range(_DISCS):
        size, row, column = np.unravel_index(int(np.argmax(score)), score.shape)
        if not score[size, row, column] > 0.0:
            break
        radius = float(radii[size])
        found.append((int(column), int(row), radius))
        near = np.hypot(columns - column, rows - row) < 0.5 * radius
        like = np.abs(np.log(radii / radius)) < _LIKE_SIZE
        score[like] = np.where(near, 0.0, score[like])
    return found


@compiled
def _nearest(image: FloatImage, x: float, y: float) -> float:
    """The pixel nearest a place; of one outside, the border's."""
    row = min(max(int(np.rint(y)), 0), image.shape[0] - 1)
    return float(image[row, min(max(int(np.rint(x)), 0), image.shape[1] - 1)])


@compiled
def _score_rims(
    changed: FloatImage, radii: FloatArray, turns: FloatArray, score: FloatArray
) -> None:
    """Write the nats for a rim of each radius about each pixel, over one that adjoins all around.

    Two points of each sector stand for it on either side.
    """
    height, width = changed.shape
    adjoined, around = math.log(_ADJOINED), turns.shape[1] // 2
    for size in range(len(radii)):
        rim = max(_RIM_PX, _RIM * radii[size])
        inner, outer = radii[size] - _GAP_PX - 0.5 * rim, radii[size] + _GAP_PX + 0.5 * rim
        for row in range(height):
            for column in range(width):
                total = 0.0
                for part in range(around):
                    within, beyond = 0.0, 0.0
                    for turn in range(2 * part, 2 * part + 2):
                        along, down = turns[0, turn], turns[1, turn]
                        within += 0.5 * _nearest(
                            changed, column + inner * along, row + inner * down
                        )
                        beyond += 0.5 * _nearest(
                            changed, column + outer * along, row + outer * down
                        )
                    total += math.log(within) + max(math.log(1.0 - beyond), adjoined) - adjoined
                score[size, row, column] = total * radii[size]


def _agreeing(
    scene: FilmedScene,
    looked: Looked,
    course: Course,
    rows: IntArray,
    middle: FloatArray,
    radius: float,
) -> tuple[float, BallPath] | None:
    """A disc's path, and how well its outlines agree, nats; None where they hardly do."""
    frame = looked.frame[course.row]
    guess = looked.far(middle + course.shift)
    fits = outlines_near(scene, radius * looked.grain, frame[rows], guess[rows])
    there = fits.found
    if np.count_nonzero(there) < _FEWEST_MOVING:
        return None
    off = fits.centre[there] - guess[rows][there]
    moved = np.median(off, axis=0)
    size = float(np.median(fits.radius[there]))
    # The median distance from the middle of a normal scatter is 1.18 of its standard deviations.
    scatter = float(np.median(np.hypot(*(off - moved).T))) / 1.18 + _LEAST_SCATTER_PX
    swelling = 1.4826 * float(np.median(np.abs(np.log(fits.radius[there] / size))))
    seen = float(fits.contrast[there].sum())
    agreed = 2.0 * math.log(size / scatter) + math.log(_LOOSE / (swelling + _LEAST_SWELLING))
    if seen * agreed < _AGREED * len(rows):
        return None
    contrast = float(np.median(fits.contrast[there]))
    return seen * agreed, _as_path(looked, course, guess + moved, size, contrast)


def _as_path(
    looked: Looked, course: Course, centre: FloatArray, radius: float, coverage: float
) -> BallPath:
    """A disc that goes along a course as what was linked from look to look."""
    count, size = len(centre), radius / looked.grain
    unlike, level = np.zeros(count), np.zeros(count)
    limit = np.array(looked.first.shape[::-1])
    for row, middle in enumerate(looked.near(centre)):
        low = np.clip(np.floor(middle - size), 0, limit - 1).astype(int)
        high = np.clip(np.ceil(middle + size) + 1, low + 1, limit).astype(int)
        window = (slice(low[1], high[1]), slice(low[0], high[0]))
        y, x = np.mgrid[window]
        inside = np.hypot(x - middle[0], y - middle[1]) < max(size, 1.0)
        if not inside.any():
            continue
        seen = looked.picture[course.row[row]][window][inside]
        behind = [np.abs(seen - one[window][inside]).mean() for one in (looked.first, looked.last)]
        unlike[row], level[row] = max(behind) / looked.noise, seen.mean()
    every = np.ones(count)
    frame = looked.frame[course.row]
    return BallPath(frame, centre, radius * every, coverage * every, unlike, every, level)
