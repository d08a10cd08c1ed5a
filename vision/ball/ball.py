"""The ball, frame by frame: from a rough path to a fitted outline in each frame that shows it.

Frames held against their neighbours: what does not belong is told, and what is left is honest.

Each position is predicted without itself, by a parabola through the frames on both sides, and by
one through those of either side alone, since a strike or a bounce breaks the motion. A position
that none of the three explains does not belong. How far the others lie from their predictions,
beside what they state, says by how much the stated uncertainty is too small.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled
from vision.ball.courses import lawful_stretch
from vision.ball.edges import Cutouts, CutPlaces, EdgeProfile, cut_out, ring_widths
from vision.ball.outline import (
    FitRules,
    OutlineFits,
    Start,
    fit_outlines,
    joined,
    nothing_found,
    voted_outlines,
)
from vision.ball.path import BallPath
from vision.ball.streaks import Sweep, swept_outlines
from vision.scene import FilmedScene

__all__ = [
    "LEAST_CONTRAST",
    "NEAR_RADII",
    "SMALL_RADIUS",
    "BallFits",
    "expected_places",
    "follow_ball",
    "off_flight",
    "outlines_near",
    "trusted_rows",
]

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]

BoolArray = NDArray[np.bool_]

_EACH_SIDE = 5
"""Frames on either side that foretell a place: a parabola has three unknowns, and the rest
averages."""

_ALONE = 6
"""Frames on one side that foretell a place where nothing is seen on the other: twice a parabola's
three unknowns."""

_FEWEST = 4
"""Frames: a parabola has three unknowns, and one more shows whether it is one."""

# Frames further away than this tell nothing.
_FURTHEST = 12

_ROUNDS = 3
"""Rounds of reweighting, supposed: outliers are out after two."""

# Off by so many combined standard uncertainties, and by at least this (px, and in radii).
_OFF_SIGMA = 5.0

_LEAST_OFF_PX, _LEAST_OFF_RADII = 0.6, 0.03
"""px, and share of the radius, that an outline may be off its neighbours' path, supposed: a fit's
own error and the ball's pattern as it turns."""

_SWOLLEN = 0.1
"""Relative radius: a ball does not grow by a tenth over a few frames."""

# A flight of so many frames is judged as a whole: drag and lens bend it no more than a cubic.
_FLIGHT_FRAMES = 24

_FLIGHT_DEGREE = 3
"""Degree in time: a parabola with what drag makes of it."""

_FLIGHT_ROUNDS = 12
"""Rounds of reweighting at most, supposed."""

# Of so many parts of a flight, no more than this many rest: the top of a throw, a release.
_PARTS, _MOST_RESTING = 8, 2


@dataclass(frozen=True)
class Expected:
    """What the other frames say of each frame.

    Attributes
    ----------
    centre : (N, 2) array
        Where it should be, px; NaN where too few others are near.
    off : (N,) bool array
        Whether the frame lies elsewhere, or is of another size.
    excess : (N,) array
        Squared distance from the prediction over what both state, per axis; NaN where unknown.
    swollen : (N,) bool array
        Whether the frame is of another size.
    """

    centre: FloatArray
    off: BoolArray
    excess: FloatArray
    swollen: BoolArray


def expected_places(
    frame: IntArray, centre: FloatArray, radius: FloatArray, variance: FloatArray
) -> Expected:
    """Predict each frame from the others.

    Parameters
    ----------
    frame : (N,) int array
        Frames, increasing.
    centre : (N, 2) array
        Positions, px.
    radius : (N,) array
        Radii, px.
    variance : (N,) array
        Stated variance of a position along one axis, px².
    """
    count = len(frame)
    if count < _FEWEST + 1:
        nothing, unknown = np.zeros(count, dtype=bool), np.full((count, 2), np.nan)
        return Expected(unknown, nothing, unknown[:, 0], nothing)
    guesses = [
        _expected_place(frame, centre, variance, np.array(steps))
        for steps in (
            [*range(-_EACH_SIDE, 0), *range(1, _EACH_SIDE + 1)],
            range(-_ALONE, 0),
            range(1, _ALONE + 1),
        )
    ]
    places = np.stack([guess for guess, _ in guesses])
    away = np.hypot(*np.moveaxis(centre - places, 2, 0))
    scaled = away**2 / (2.0 * (variance + np.stack([spread for _, spread in guesses])))
    known = np.isfinite(scaled)
    scaled = np.where(known, scaled, np.inf)
    best, rows = np.argmin(scaled, axis=0), np.arange(count)
    nearest = np.where(known, away, np.inf).min(axis=0)
    floor = _LEAST_OFF_PX + _LEAST_OFF_RADII * float(np.median(radius))
    excess = scaled[best, rows]
    off = np.isfinite(excess) & (nearest > floor) & (excess > 0.5 * _OFF_SIGMA**2)
    swollen = np.abs(np.log(radius / _near_radius(frame, radius))) > _SWOLLEN
    stated = np.where(np.isfinite(excess), excess, np.nan)
    return Expected(places[best, rows], off | swollen, stated, swollen)


def off_flight(
    frame: IntArray, centre: FloatArray, radius: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Frames of a long free flight that lie off it as a whole.

    A run of frames that is drawn off by the same thing, such as the ball's shadow on the floor, is
    smooth by itself; the flight is not drawn off with it.

    Parameters
    ----------
    frame, centre, radius : arrays
        As in `expected_places`.

    Returns
    -------
    centre : (N, 2) array
        Where the flight is, px; NaN outside it.
    off : (N,) bool array
        Whether the frame lies elsewhere.
    """
    place, off = np.full((len(frame), 2), np.nan), np.zeros(len(frame), dtype=bool)
    usual = float(np.median(radius))
    stretch = lawful_stretch(frame, centre, usual)
    inside = np.flatnonzero((frame >= stretch.first) & (frame <= stretch.last))
    if len(inside) < _FLIGHT_FRAMES or stretch.looks < _FLIGHT_FRAMES:
        return place, off
    floor = _LEAST_OFF_PX + _LEAST_OFF_RADII * usual
    parts = np.array_split(centre[inside], _PARTS)
    resting = [float(np.hypot(*_spread(part))) < 2.0 * floor for part in parts]
    if sum(resting) > _MOST_RESTING:
        # Mostly rest, before or after the motion: no one law holds there.
        return place, off
    time = np.interp(frame[inside], [stretch.first, stretch.last], [-1.0, 1.0])
    design = np.vander(time, _FLIGHT_DEGREE + 1)
    weight = np.ones(len(inside))
    for _ in range(_FLIGHT_ROUNDS):
        weighted = design * weight[:, None]
        fitted = np.linalg.solve(weighted.T @ design, weighted.T @ centre[inside])
        away = np.hypot(*(centre[inside] - design @ fitted).T)
        scale = max(1.2 * float(np.median(away)), 0.02)
        weight = 1.0 / (1.0 + (away / (3.0 * scale)) ** 2) ** 2
    place[inside] = design @ fitted
    beyond = away > max(floor, _OFF_SIGMA * scale)
    # what the stretch begins with, as a push that is not over, is not yet of the flight
    off[inside] = beyond & ~np.logical_and.accumulate(beyond)
    return place, off


def _spread(centre: FloatArray) -> FloatArray:
    """How far positions reach along each axis, the outermost left aside."""
    # numpy's quantile takes ten times as long over some tens of positions
    ordered, last = np.sort(centre, axis=0), len(centre) - 1
    below = int(0.1 * last)
    part, above = 0.1 * last - below, min(below + 1, last)
    low = (1.0 - part) * ordered[below] + part * ordered[above]
    high = (1.0 - part) * ordered[last - below] + part * ordered[last - above]
    return np.asarray(high - low)


def _near_radius(frame: IntArray, radius: FloatArray) -> FloatArray:
    """Usual radius of the frames around each, itself left out; its own where there are few."""
    steps = np.array([*range(-_FURTHEST, 0), *range(1, _FURTHEST + 1)])
    rows, near = _neighbours(frame, steps)
    values = np.where(near, radius[rows], np.nan)
    few = near.sum(axis=1) < _FEWEST
    values[few] = radius[few, None]
    return _middle_of_known(values)


def _middle_of_known(values: FloatArray, axis: int = 1) -> FloatArray:
    """Median without NaN, NaN where all are: numpy's takes ten times as long over short rows."""
    ordered = np.sort(values, axis=axis)  # NaN last
    known = np.count_nonzero(~np.isnan(values), axis=axis, keepdims=True)
    low, high = np.maximum(known - 1, 0) // 2, np.minimum(known // 2, values.shape[axis] - 1)
    ends = [np.take_along_axis(ordered, place, axis) for place in (low, high)]
    return np.asarray(0.5 * (ends[0] + ends[1])).squeeze(axis)


def _neighbours(frame: IntArray, steps: IntArray) -> tuple[IntArray, BoolArray]:
    """Rows so many steps from each, and which of them are there and near enough."""
    count = len(frame)
    rows = np.arange(count)[:, None] + steps
    inside = (rows >= 0) & (rows < count)
    rows = np.clip(rows, 0, count - 1)
    return rows, inside & (np.abs(frame[rows] - frame[:, None]) <= _FURTHEST)


def _expected_place(
    frame: IntArray, centre: FloatArray, variance: FloatArray, steps: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Robust parabola through the rows so many steps away, and its variance at each row.

    The variance is what is stated, or what the residuals say where that is more; NaN where too few
    rows are near. Through only just enough of them goes a line.
    """
    place, spread = np.empty((len(frame), 2)), np.empty(len(frame))
    _foretold(frame, centre, variance, steps, place, spread)
    return place, spread


@compiled
def _foretold(
    frame: IntArray,
    centre: FloatArray,
    variance: FloatArray,
    steps: IntArray,
    place: FloatArray,
    spread: FloatArray,
) -> None:
    """Write what `_expected_place` hands back."""
    most = len(steps)
    time, x, y, stated, weight, square, room = np.empty((7, most))
    motion = np.empty(7)
    for row in range(len(frame)):
        place[row, :] = np.nan
        spread[row] = np.nan
        near = 0
        for step in steps:
            other = row + step
            if 0 <= other < len(frame) and abs(frame[other] - frame[row]) <= _FURTHEST:
                time[near] = (frame[other] - frame[row]) / _FURTHEST
                x[near] = centre[other, 0] - centre[row, 0]
                y[near] = centre[other, 1] - centre[row, 1]
                stated[near] = variance[other] + 1e-6
                weight[near] = 1.0 / stated[near]
                near += 1
        if near < _FEWEST:
            continue
        typical, middle = _middle_of(stated, near, room), 0.0
        for _ in range(_ROUNDS):
            _parabola(time[:near], x, y, weight, 1e9 if near <= _FEWEST else 1e-9, motion)
            for k in range(near):
                left_x = x[k] - motion[0] - time[k] * (motion[1] + time[k] * motion[2])
                left_y = y[k] - motion[3] - time[k] * (motion[4] + time[k] * motion[5])
                square[k] = left_x * left_x + left_y * left_y
            middle = _middle_of(square, near, room)
            usual = 4.0 * max(middle, typical)
            for k in range(near):
                weight[k] = 1.0 / (stated[k] * (1.0 + square[k] / usual) ** 2)
        place[row, 0], place[row, 1] = centre[row, 0] + motion[0], centre[row, 1] + motion[3]
        spread[row] = motion[6] * max(1.0, middle / (1.4 * typical))


@compiled
def _middle_of(values: FloatArray, count: int, room: FloatArray) -> float:
    """Median of the first few values."""
    for k in range(count):
        value, j = values[k], k
        while j > 0 and room[j - 1] > value:
            room[j] = room[j - 1]
            j -= 1
        room[j] = value
    return 0.5 * float(room[(count - 1) // 2] + room[count // 2])


@compiled
def _parabola(
    time: FloatArray,
    x: FloatArray,
    y: FloatArray,
    weight: FloatArray,
    straight: float,
    motion: FloatArray,
) -> None:
    """Write level, slope and bend of x and of y over time, and the variance of a level.

    `straight` is information on the bend.
    """
    a, b, c, d, e = 1e-9, 0.0, 0.0, 0.0, straight
    pull = np.zeros((2, 3))
    for k in range(len(time)):
        first = weight[k] * time[k]
        second = first * time[k]
        a, b, c = a + weight[k], b + first, c + second
        d, e = d + second * time[k], e + second * time[k] * time[k]
        pull[0, 0], pull[1, 0] = pull[0, 0] + weight[k] * x[k], pull[1, 0] + weight[k] * y[k]
        pull[0, 1], pull[1, 1] = pull[0, 1] + first * x[k], pull[1, 1] + first * y[k]
        pull[0, 2], pull[1, 2] = pull[0, 2] + second * x[k], pull[1, 2] + second * y[k]
    # by Cramer's rule; the sum of squared times stands in two places
    middle = c + 1e-9
    one, two, three = middle * e - d * d, c * d - b * e, b * d - c * middle
    four, five, six = a * e - c * c, b * c - a * d, a * middle - b * b
    whole = a * one + b * two + c * three
    for axis in range(2):
        p, q, r = pull[axis]
        motion[3 * axis] = (one * p + two * q + three * r) / whole
        motion[3 * axis + 1] = (two * p + four * q + five * r) / whole
        motion[3 * axis + 2] = (three * p + five * q + six * r) / whole
    motion[6] = one / whole


LEAST_CONTRAST = 0.35
"""Share of full contrast along an outline, supposed: less is a ball half hidden, or none."""

# Balls smaller than this are too few pixels for the outline model; the circle of their edges is
# used.
SMALL_RADIUS = 6.0

_FELT_RADII = 0.12
"""Radii from which a coarse outline is felt at least: as wide as its soft edge."""

_SHARP_PX, _SHARPER = 0.6, 2.5
"""px, standard deviation of a sharp edge's blur: a pixel's own width and some optics; and factor
from an edge to the next sharper one, supposed: what a fit leaves is less than that part of the
width of its edge."""

_LOST_AFTER = 4
"""Frames without an outline that end a path: one or two may be hidden or dropped."""

_AHEAD = 8
"""Frames fitted at once: as far ahead as a parabola foretells a place within the reach of a fit,
supposed."""

# An outline of which so much less stands out than usual is looked at twice.
_DIM = 0.8
"""Share of the usual: an outline of which so much less stands out is looked at twice."""

_PATH_FRAMES = 12
"""Frames before that foretell a place: four times a parabola's three unknowns."""

_OFF_PATH = 0.08
"""Radii that an outline may be off the path of its neighbours, supposed: more is another thing."""

_CLEAREST, _SIZES_APART = 0.75, 0.06
"""Quantile of the contrasts from which outlines tell the ball's size; and share of it by which
another is off: three standard deviations of a radius that is fitted free."""

# From a guess as near as this the sharp edge is found.
_NEAR_PX = 1.5
"""px: from a guess as near as this the sharp edge is found, as wide as its blur."""

_SAME_START = 0.05
"""Radii: two starts nearer than this end in the same outline."""

_SECOND_LOOKS = 2

# Sizes tried, of a path's own; looks at which they are; a contrast over all of them that is beyond
# doubt; how much better another size must be.
_SIZES = (1.0, 0.8, 1.25)

_SIZE_LOOKS = 9
"""Frames in which another size is tried, supposed: their median leaves a few wrong ones out."""

_DISC_SIZES, _LARGER = (1.0, 1.4), 1.15
"""Of a small path's own radius: discs that are tried, and the ratio from which it is another."""

_BORNE_OUT = 0.5

_OTHER_SIZE = 1.3
"""Factor on the evidence by which another size must be better, supposed: a pattern on the ball may
look like an edge."""

# Rounds of leaving out what does not belong; where more than this part would go, nothing does.
_DROPS = 4

_MOST_OFF = 0.3
"""Share of the frames: where more are off, it is the path that is wrong and not the outlines."""

# From frame to frame, and while the shutter is open, in radii: what goes less is not smeared.
_QUICK, _SMEARED = 0.5, 0.5

_USUAL_DUTY = 0.5
"""Share of the time between frames that a shutter is open, where the clip does not tell."""

_EXPLAINED, _OTHER_MOTION = 0.7, 0.5
"""Share of the change that a swept disc must explain; share of radius and way by which its motion
may be another than asked for; both supposed."""

_BESIDE, _LOOK_STD = 1.5, 0.1
"""Radii off a look at which a circle is another thing's; and scatter of a look, supposed."""

_NOTHING = 0.3
"""Share of the change: where a disc explains less there is none, whatever its outline seemed."""

_AHEAD_SHARE = 0.3
"""Share of a frame's way that a ball may lie off where it was foretold."""

_MOST_MISSED = 2
"""Frames without a streak that end the search."""

_STREAK_STD = 0.02
"""Of length and radius: how far off a streak's middle is where the light of its ends differs."""

_LAST_ROWS = 4
"""Rows that foretell the next: a parabola's three unknowns, and one to spare."""

_FEWEST_SHARP, _FEWEST_STILL_ROWS = 5, 3
"""Frames: of fewer the median is no better than the path's own."""

_MEDIAN_EXCESS, _OFF_EXCESS = 0.693, 12.5
"""Dimensionless: the median of half a squared distance in two dimensions (ln 2), and five standard
deviations of it (25/2)."""

# Frames on each side over which the scatter is judged, and how much a variance may grow.
_WINDOW = 7
"""Frames on each side over which the scatter is judged: the variance of fifteen is good to 40 %."""

_MOST_WIDENED = 400.0
"""Factor by which a variance may grow: twenty standard deviations; what is farther off is no
measurement."""


@dataclass(frozen=True)
class BallFits:
    """Outline fits of one ball in time order.

    Attributes
    ----------
    frame : (N,) int array
        Frame indices.
    fits : OutlineFits
        One row per frame, in scene coordinates.
    unrefined : frozenset of int
        Frames without an outline: smeared, so that its area was fitted, or found by its looks.
    """

    frame: IntArray
    fits: OutlineFits
    unrefined: frozenset[int] = frozenset()

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def centre(self) -> FloatArray:
        """Centres (N, 2), px."""
        return self.fits.centre

    @property
    def radius(self) -> FloatArray:
        """Radii (N,), px."""
        return self.fits.radius

    def at(self, places: IntArray | BoolArray) -> "BallFits":
        """Some of the rows."""
        return replace(self, frame=self.frame[places], fits=self.fits.at(places))

    def together(self, other: "BallFits") -> "BallFits":
        """Rows of both in time order."""
        frame = np.concatenate([self.frame, other.frame])
        order = np.argsort(frame, kind="stable")
        fits = joined([self.fits, other.fits]).at(order)
        return BallFits(frame[order], fits, self.unrefined | other.unrefined)


def follow_ball(scene: FilmedScene, path: BallPath) -> BallFits:
    """Fit the ball along a path, between its looks, and beyond both ends for as long as it is seen.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    path : BallPath
        Where the ball was in some frames.

    Returns
    -------
    BallFits
        With radius free; for later refinement.
    """
    search = _Search(scene, _size(scene, path))
    inside = scene.shown(np.arange(int(path.frame[0]), int(path.frame[-1]) + 1))
    guess = np.column_stack(
        [np.interp(inside, path.frame, path.centre_px[:, axis]) for axis in (0, 1)]
    )
    near_look = np.isin(inside, np.add.outer(path.frame, (-1, 0, 1)))
    fits = search.run(inside, guess, near_look)
    found = BallFits(inside, fits).at(fits.found)
    found = found.at(_plausible(found, search.radius))
    found = _gaps_filled(search, found, inside)
    if len(found) == 0:
        return found
    found = _reached(scene, search, found)
    # Ends that were fitted in the wrong place, and led nowhere, stand right by now.
    further = _reached(scene, search, found)
    found = further if len(further) > len(found) else found
    return _Smears(scene, path, _as_looked(path, found)).filled()


NEAR_RADII = 0.3
"""Radii within which two fits are of one object. Derived: a centre found by votes is that good."""


def _as_looked(path: BallPath, found: BallFits) -> BallFits:
    """Leave out outlines of successive frames in which the ball was looked at in another place.

    Where the ball hides the scene behind it nearly always, an outline may settle on the edge
    between what is known of the scene and what is not. One look alone may be what is wrong.
    """
    looked = np.flatnonzero(np.isin(found.frame, path.frame))
    look = path.centre_px[np.searchsorted(path.frame, found.frame[looked])]
    away = np.hypot(*(found.centre[looked] - look).T)
    beside = np.pad(away > NEAR_RADII * path.radius + 1.0, 1)
    again = beside[1:-1] & (beside[:-2] | beside[2:])
    return found.at(np.setdiff1d(np.arange(len(found)), looked[again]))


def outlines_near(
    scene: FilmedScene, radius: float, frame: IntArray, guess: FloatArray
) -> OutlineFits:
    """Outlines of about a radius near some guesses, each frame by itself, however small.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    radius : float
        px.
    frame : (N,) int array
        Frames.
    guess : (N, 2) array
        Where it may be, px.
    """
    return _Search(scene, radius).outlines(frame, guess)


class _Smears:
    """Frames in which the ball is smeared: its area is fitted, as a disc swept along its way.

    Where it goes less than a part of its radius from frame to frame nothing is done.
    """

    def __init__(self, scene: FilmedScene, path: BallPath, found: BallFits) -> None:
        self._scene, self._found = scene, found
        looks = path.where(~np.isin(path.frame, found.frame))
        frame = np.concatenate([found.frame, looks.frame])
        order = np.argsort(frame, kind="stable")
        self._known = frame[order]
        self._place = np.concatenate([found.centre, looks.centre_px])[order]
        self._radius = path.radius if len(found) < _FEWEST_SHARP else float(np.median(found.radius))
        self._duty = _USUAL_DUTY
        self._fits: dict[int, tuple[OutlineFits, float]] = {}
        self._empty: set[int] = set()
        self._standing: tuple[IntArray, FloatArray] | None = None

    def filled(self) -> BallFits:
        """What was found, with the frames in which it was smeared."""
        if len(self._known) < 2 or self._radius < SMALL_RADIUS:
            return self._found
        velocity = self._velocity()
        quick = np.hypot(*velocity.T) > _QUICK * self._radius
        if not quick.any():
            return self._found
        self._learn(velocity, quick)
        smeared = self._duty * np.hypot(*velocity.T) > _SMEARED * self._radius
        between = self._between(quick)
        if not smeared.any() and len(between) == 0:
            return self._found
        where = np.column_stack(
            [np.interp(between, self._known, self._place[:, axis]) for axis in (0, 1)]
        )
        along = np.column_stack(
            [np.interp(between, self._known, velocity[:, axis]) for axis in (0, 1)]
        )
        self._fit(self._known[quick], self._place[quick], velocity[quick])
        self._fit(between, where, along)
        for direction in (-1, 1):
            for end in self._ends(direction):
                self._go_on(end, direction)
        return trusted_rows(self._merged())

    def _ends(self, direction: int) -> list[int]:
        """Frames that stand, of which it went fast, and beyond which nothing is known."""
        frame, place = self._rows()
        if len(frame) < 2:
            return []
        step = np.hypot(*np.diff(place, axis=0).T) / np.diff(frame)
        quick = np.concatenate([step[:1], step]) > _QUICK * self._radius
        quick |= np.concatenate([step, step[-1:]]) > _QUICK * self._radius
        alone = ~np.isin(frame + direction, frame)
        return [int(index) for index in frame[quick & alone]]

    def _velocity(self) -> FloatArray:
        frame = self._known.astype(np.float64)
        return np.column_stack([np.gradient(self._place[:, axis], frame) for axis in (0, 1)])

    def _between(self, quick: BoolArray) -> IntArray:
        """Frames on the way in which nothing was found while it went fast."""
        way = np.arange(int(self._known[0]), int(self._known[-1]) + 1)
        after = np.clip(np.searchsorted(self._known, way), 1, len(self._known) - 1)
        return way[~np.isin(way, self._known) & (quick[after] | quick[after - 1])]

    def _learn(self, velocity: FloatArray, quick: BoolArray) -> None:
        """Radius and open shutter, from frames in which it is nearly sharp and most smeared."""
        speed = np.hypot(*velocity.T)
        slow = np.argsort(speed, kind="stable")[:_SIZE_LOOKS]
        fast = np.flatnonzero(quick)[np.argsort(-speed[quick], kind="stable")][:_SIZE_LOOKS]
        rows = np.unique(slow)
        fits, _ = self._swept(self._known[rows], self._place[rows], velocity[rows], True)
        good = fits.found & (fits.contrast > _EXPLAINED)
        if np.count_nonzero(good) >= _FEWEST_STILL_ROWS:
            self._radius = float(np.median(fits.radius[good]))
        rows = np.unique(fast)
        fits, sweeps = self._swept(self._known[rows], self._place[rows], velocity[rows], False)
        motion = np.array([sweep.motion for sweep in sweeps])
        square = np.maximum(np.sum(velocity[rows] ** 2, axis=1), 1e-9)
        duty = np.sum(motion * velocity[rows], axis=1) / square
        good = fits.found & (fits.contrast > _EXPLAINED) & (duty > 0.0) & (duty < 1.1)
        if np.count_nonzero(good) >= _FEWEST_STILL_ROWS:
            self._duty = float(np.median(duty[good]))

    def _swept(
        self, frame: IntArray, place: FloatArray, velocity: FloatArray, free_radius: bool
    ) -> tuple[OutlineFits, list[Sweep]]:
        starts = [
            Sweep(centre, self._duty * along, self._radius)
            for centre, along in zip(place, velocity, strict=True)
        ]
        return swept_outlines(self._scene, frame, starts, free_radius=free_radius)

    def _fit(self, frame: IntArray, place: FloatArray, velocity: FloatArray) -> None:
        """Keep what explains the picture and went as far as its way asks for."""
        self._standing = None
        fits, sweeps = self._swept(frame, place, velocity, False)
        away = np.hypot(*(fits.centre - place).T)
        for row, index in enumerate(frame.tolist()):
            if not fits.found[row] or fits.contrast[row] < _NOTHING:
                self._empty.add(index)
                continue
            speed = float(np.hypot(*velocity[row]))
            expected, other = self._duty * velocity[row], sweeps[row].motion
            # A streak has no direction.
            off = min(np.hypot(*(other - expected)), np.hypot(*(other + expected)))
            near = off < _OTHER_MOTION * (self._radius + self._duty * speed)
            near &= away[row] < _OTHER_MOTION * self._radius + _AHEAD_SHARE * speed
            if fits.contrast[row] > _EXPLAINED and near:
                length = float(np.hypot(*other))
                fits.covariance[row] += (_STREAK_STD * (length + self._radius)) ** 2 * np.eye(2)
                self._fits[index] = (fits.at(np.array([row])), length)

    def _go_on(self, end: int, direction: int) -> None:
        """Beyond an end, for as long as it is seen, or to where it is known again."""
        index, missed = end + direction, 0
        while 0 <= index < self._scene.count and missed < _MOST_MISSED:
            frame, place = self._rows()
            if index in frame:
                return
            beside = np.flatnonzero((frame < index) if direction > 0 else (frame > index))
            last = beside[-_LAST_ROWS:] if direction > 0 else beside[:_LAST_ROWS]
            if len(last) < 2:
                return
            time = (frame[last] - index).astype(np.float64)
            degree = min(2, len(time) - 1) if missed == 0 else 1
            course = np.polyfit(time, place[last], degree)
            centre, velocity = course[-1], course[-2]
            if not _inside(centre, self._scene.shape):
                return
            if np.hypot(*velocity) < _QUICK * self._radius:
                return
            self._fit(np.array([index]), centre[None], velocity[None])
            missed = 0 if index in self._fits else missed + 1
            index += direction

    def _rows(self) -> tuple[IntArray, FloatArray]:
        """Frames and places that stand: outlines, and streaks instead of them."""
        if self._standing is None:
            chosen = self._chosen()
            kept = ~np.isin(self._found.frame, [*chosen, *self._empty])
            frame = np.concatenate([self._found.frame[kept], np.array([*chosen], dtype=np.int64)])
            places = [fits.centre for fits in chosen.values()]
            order = np.argsort(frame, kind="stable")
            place = np.concatenate([self._found.centre[kept], *places])[order]
            self._standing = frame[order], place
        return self._standing

    def _chosen(self) -> dict[int, OutlineFits]:
        """Streaks of frames in which no outline was found, or that are long."""
        own = set(self._found.frame.tolist())
        return {
            index: fits
            for index, (fits, length) in self._fits.items()
            if index not in own or length > _SMEARED * self._radius
        }

    def _merged(self) -> BallFits:
        found, chosen = self._found, self._chosen()
        kept = found.at(~np.isin(found.frame, [*chosen, *self._empty]))
        frame = np.concatenate([kept.frame, np.array(list(chosen), dtype=np.int64)])
        every = joined([kept.fits, *chosen.values()])
        order = np.argsort(frame, kind="stable")
        return BallFits(frame[order], every.at(order), frozenset(chosen))


def _inside(centre: FloatArray, shape: tuple[int, int]) -> bool:
    return bool(np.all(centre >= 0) and centre[0] < shape[1] and centre[1] < shape[0])


def _reached(scene: FilmedScene, search: "_Search", found: BallFits) -> BallFits:
    """Go on beyond both ends, and hold every frame against its neighbours."""
    table = _FitTable(scene.count, found)
    for direction in (-1, 1):
        _extend(scene, search, table, direction)
    found = table.rows()
    if search.radius >= SMALL_RADIUS:
        found = _of_one_size(scene, _reconsidered(search, found))
    return _consistent(search, found)


def _size(scene: FilmedScene, path: BallPath) -> float:
    """The radius that most of the looks bear out, px.

    Where the rim is faint, as a ball's shaded side before a wall like it, circles of edges are
    drawn through what is clear inside it; an outline of the right size explains more of the
    picture.
    """
    if path.radius < SMALL_RADIUS:
        return _disc_size(scene, path)
    rows = np.unique(np.linspace(0, len(path.frame) - 1, _SIZE_LOOKS).astype(np.int64))
    frame, guess = path.frame[rows], path.centre_px[rows]
    best, best_score = path.radius, 0.0
    for factor in _SIZES:
        fits = _Search(scene, factor * path.radius).run(
            frame, guess, np.zeros(len(rows), dtype=bool), afar=True
        )
        fits = fits.at(fits.found)
        borne_out = float(fits.contrast.sum()) / len(rows)
        if factor == 1.0 and borne_out > _BORNE_OUT:
            return path.radius
        if len(fits) < 3:
            continue
        radius = float(np.median(fits.radius))
        here = borne_out * radius / float(np.median(fits.rms_residual))
        if here > (_OTHER_SIZE if best_score > 0.0 else 1.0) * best_score:
            best, best_score = (path.radius if factor == 1.0 else radius), here
    return best


def _disc_size(scene: FilmedScene, path: BallPath) -> float:
    """The radius of a small ball, by the area that a shaded disc explains.

    A ball that is lighter than the wall above and darker below has an edge across its middle: a
    circle of edges may be that of its light part alone.
    """
    rows = np.unique(np.linspace(0, len(path.frame) - 1, _SIZE_LOOKS).astype(np.int64))
    velocity = np.gradient(path.centre_px, path.frame, axis=0)[rows]
    best, best_share = path.radius, 0.0
    for factor in _DISC_SIZES:
        radius = factor * path.radius
        starts = [
            Sweep(centre, _USUAL_DUTY * along, radius)
            for centre, along in zip(path.centre_px[rows], velocity, strict=True)
        ]
        fits, _ = swept_outlines(scene, path.frame[rows], starts, free_radius=True)
        if np.count_nonzero(fits.found) < _FEWEST_STILL_ROWS:
            continue
        share = float(np.median(fits.contrast[fits.found]))
        found = float(np.median(fits.radius[fits.found]))
        larger = _LARGER * path.radius < found < 2.0 * path.radius
        if share > max(_EXPLAINED, best_share) and larger:
            best, best_share = found, share
    return best


def _consistent(search: "_Search", found: BallFits) -> BallFits:
    """Fit frames that lie off their neighbours' motion again from there; leave out what stays."""
    for _ in range(_SECOND_LOOKS):
        expected = _expected(found)
        places = np.nonzero(expected.off & np.isfinite(expected.centre[:, 0]))[0]
        if len(places) == 0:
            break
        nothing = np.zeros(len(places), dtype=bool)
        again = search.run(found.frame[places], expected.centre[places], nothing)
        before = np.hypot(*(found.centre[places] - expected.centre[places]).T)
        nearer = again.found & (
            np.hypot(*(again.centre - expected.centre[places]).T) < 0.7 * before
        )
        found.fits.put(places[nearer], again.at(nearer))
        if not nearer.any():
            break
    return trusted_rows(found)


def trusted_rows(found: BallFits) -> BallFits:
    """Leave out frames that do not belong, and widen what states too little.

    Parameters
    ----------
    found : BallFits
        Fits of one ball.

    Returns
    -------
    BallFits
        Those that lie where their neighbours say. Where positions scatter about their neighbours'
        motion by more than they state, their covariances are scaled up.
    """
    for _ in range(_DROPS):
        expected = _expected(found)
        if not expected.off.any() or expected.off.mean() > _MOST_OFF:
            break
        # The worst of a run of neighbours first: it may be what puts the others off.
        worst = expected.off & (expected.excess >= _around(expected.excess, np.nanmax))
        found = found.at(~worst)
    near = np.abs(found.frame[:, None] - found.frame) <= _FURTHEST
    dim = found.fits.contrast < _DIM * np.median(found.fits.contrast)
    # For a few dim frames far from all others no neighbour speaks, and hardly their outline.
    found = found.at(~(dim & (near.sum(axis=1) <= _FEWEST)))
    expected = _expected(found)
    known = np.where(np.isfinite(expected.excess), expected.excess, np.nan)
    local = _around(known, _middle_of_known) / _MEDIAN_EXCESS
    factor = np.clip(np.nan_to_num(local, nan=1.0), 1.0, _MOST_WIDENED)
    covariance = found.fits.covariance * factor[:, None, None]
    return replace(found, fits=replace(found.fits, covariance=covariance))


def _expected(found: BallFits) -> Expected:
    """What its neighbours, and the flight as a whole, say of each frame."""
    variance = 0.5 * np.trace(found.fits.covariance, axis1=1, axis2=2)
    near = expected_places(found.frame, found.centre, found.radius, variance)
    # Where all scatter, one that scatters alike belongs to them: what they state is too little.
    usual = np.nan_to_num(_around(near.excess, _middle_of_known) / _MEDIAN_EXCESS, nan=1.0)
    alone = near.off & ~(near.excess < _OFF_EXCESS * np.maximum(usual, 1.0))
    flight, off = off_flight(found.frame, found.centre, found.radius)
    return Expected(
        np.where(off[:, None], flight, near.centre),
        alone | near.swollen | off,
        np.where(off, np.inf, near.excess),
        near.swollen,
    )


def _around(values: FloatArray, statistic: Callable[[FloatArray, int], FloatArray]) -> FloatArray:
    """A statistic of each value and its neighbours, NaN left out."""
    padded = np.pad(values, _WINDOW, constant_values=np.nan)
    stack = np.lib.stride_tricks.sliding_window_view(padded, 2 * _WINDOW + 1).copy()
    known = np.isfinite(stack).any(axis=1)
    stack[~known] = 1.0
    return np.asarray(np.where(known, statistic(stack, 1), np.nan))


def _gaps_filled(search: "_Search", found: BallFits, inside: IntArray) -> BallFits:
    """Look once more, between their neighbours, for frames in which nothing plausible was found."""
    missing = np.setdiff1d(inside, found.frame)
    if len(missing) == 0 or len(found) < 2:
        return found
    guess = np.column_stack(
        [np.interp(missing, found.frame, found.centre[:, axis]) for axis in (0, 1)]
    )
    fits = search.run(missing, guess, np.zeros(len(missing), dtype=bool), afar=True)
    every = found.together(BallFits(missing, fits).at(fits.found))
    return every.at(_plausible(every, search.radius))


def _reconsidered(search: "_Search", found: BallFits) -> BallFits:
    """Look again where a dim outline leaves the path of the frames before it.

    Over its own shadow on the floor a ball's edge is easily taken for the shadow's.
    """
    fits, frame = found.fits, found.frame
    clear = fits.contrast >= _DIM * np.median(fits.contrast)
    for place in np.nonzero(~clear)[0]:
        before = np.nonzero(clear[:place])[0][-_PATH_FRAMES:]
        if len(before) < _PATH_FRAMES or frame[place] - frame[before[0]] > 2 * _PATH_FRAMES:
            continue
        time = (frame[before] - frame[place]).astype(np.float64)
        ahead = np.asarray(np.polyfit(time, fits.centre[before], 2)[2])
        away = float(np.hypot(*(fits.centre[place] - ahead)))
        if away > _OFF_PATH * search.radius + 1.0:
            row = np.array([place])
            again = search.run(frame[row], ahead[None], np.zeros(1, dtype=bool))
            nearer = float(np.hypot(*(again.centre[0] - ahead)))
            if again.found[0] and nearer < 0.5 * away:
                fits.put(row, again)
                away = nearer
        clear[place] = away <= _OFF_PATH * search.radius
    return found


def _of_one_size(scene: FilmedScene, found: BallFits) -> BallFits:
    """Outline anew, at the size of what is seen most clearly, what came out of another size.

    Where a ball's rim is faint, an edge inside it is found in all frames of its rest alike, so that
    no neighbour doubts it; the whole outline explains more of the picture and leaves less over.
    """
    fits = found.fits
    if len(found) < _FEWEST_STILL_ROWS:
        return found
    clearest = fits.contrast >= np.quantile(fits.contrast, _CLEAREST)
    size = float(np.median(fits.radius[clearest]))
    other = np.nonzero(np.abs(fits.radius / size - 1.0) > _SIZES_APART)[0]
    if len(other) == 0:
        return found
    again = _Search(scene, size).outlines(found.frame[other], found.centre[other])
    better = again.found & (again.contrast > fits.contrast[other])
    better &= again.rms_residual < fits.rms_residual[other]
    fits.put(other[better], again.at(better))
    return found


class _Search:
    """Fits coarse, then fine; where a start was too far off, votes for the circle nearby first."""

    def __init__(self, scene: FilmedScene, radius: float) -> None:
        self._scene = scene
        self.radius = radius
        inner, outer = ring_widths(radius)
        self._sharp = EdgeProfile(radius, _SHARP_PX, 0.0)
        self._fine_rules = FitRules(3, 0.1 * radius, inner, outer, 6, 0.05)
        self._softer: list[tuple[EdgeProfile, FitRules]] = []
        for soft in _soft_edges(radius):
            # a large ball goes many px in a frame, all of them a small part of it
            wide = replace(
                self._fine_rules, inner=max(1.6 * inner, soft), outer=max(1.6 * outer, soft)
            )
            self._softer.append((EdgeProfile(radius, soft, 0.0), wide))
        felt = _FELT_RADII * radius
        outer = self._softer[0][1].outer
        self._reach = radius + outer + max(min(6.0, 0.4 * radius), felt) + 2.0

    def run(
        self, frame: IntArray, guess: FloatArray, trusted: BoolArray, *, afar: bool = False
    ) -> OutlineFits:
        """Outlines near the guesses; a trusted guess stands for itself where nothing fits.

        With `afar`, no guess is taken to be near enough for the sharp edge to be felt.
        """
        if self.radius < SMALL_RADIUS:
            return self._voted(frame, guess, trusted)
        fits = self._fitted(frame, guess, afar)
        lost = np.nonzero(~fits.found)[0]
        if len(lost):
            voted = voted_outlines(self._scene, frame[lost], guess[lost], self.radius)
            again = self._fitted(frame[lost], voted.centre, True)
            again.found[:] &= voted.found
            # A ball too smeared for the outline model is still where its circle was found.
            stays = trusted[lost] & ~again.found
            again.put(stays, voted.at(stays))
            fits.put(lost, again)
        return fits

    def outlines(self, frame: IntArray, guess: FloatArray) -> OutlineFits:
        """Outlines near guesses from which no sharp edge need be felt."""
        return self._fitted(frame, guess, True)

    def _voted(self, frame: IntArray, guess: FloatArray, trusted: BoolArray) -> OutlineFits:
        """Circles near the guesses; what stands beside the ball is not taken for it.

        A look of the whole picture saw what a search of its surroundings may miss.
        """
        fits = voted_outlines(self._scene, frame, guess, self.radius)
        away = np.hypot(*(fits.centre - guess).T)
        beside = trusted & (~fits.found | (away > _BESIDE * self.radius + 1.0))
        fits.found[beside] = True
        fits.centre[beside], fits.radius[beside] = guess[beside], self.radius
        fits.covariance[beside] = (_LOOK_STD * self.radius + 0.2) ** 2 * np.eye(2)
        fits.bound[beside] = fits.covariance[beside] / 9.0
        fits.rms_residual[beside], fits.contrast[beside] = 1.0, LEAST_CONTRAST
        return fits

    def _fitted(self, frame: IntArray, guess: FloatArray, afar: bool) -> OutlineFits:
        fits = nothing_found(len(frame))
        for part, pieces in cut_out(self._scene, CutPlaces(frame, guess, self._reach)):
            places, start = np.arange(part.start, part.stop), _round_start(guess[part], self.radius)
            fits.put(places, (self._from_afar if afar else self._from_near)(pieces, start))
        return fits

    def _from_near(self, pieces: Cutouts, start: Start) -> OutlineFits:
        """Fit with a sharp edge at once; from afar only what looks as if it needs it."""
        fine = fit_outlines(pieces, self._sharp, start, self._fine_rules)
        fine.found[:] &= self._believable(fine, start.centre)
        again = np.nonzero(_doubtful(fine, start.centre))[0]
        if len(again):
            fine.put(again, self._from_afar(pieces.at(again), start.at(again)))
        return fine

    def _from_afar(self, pieces: Cutouts, start: Start) -> OutlineFits:
        """Fit with a soft edge, which is felt from further off, and then with sharper ones."""
        radius, better = self.radius, start
        found = np.ones(len(start.centre), dtype=bool)
        for profile, rules in self._softer:
            coarse = fit_outlines(pieces, profile, better, rules)
            found &= coarse.found
            centre = np.where(found[:, None], coarse.centre, start.centre)
            size = np.where(found, coarse.radius, radius)
            better = _round_start(centre, np.clip(size, 0.85 * radius, 1.15 * radius))
        fine = fit_outlines(pieces, self._sharp, better, self._fine_rules)
        fine.found[:] &= found & self._believable(fine, start.centre)
        return fine

    def _believable(self, fits: OutlineFits, guess: FloatArray) -> BoolArray:
        swollen = np.abs(np.log(np.maximum(fits.radius, 0.1) / self.radius))
        moved = np.hypot(*(fits.centre - guess).T)
        clear = fits.contrast >= LEAST_CONTRAST
        return np.asarray(clear & (swollen < 0.2) & (moved < 0.8 * self.radius))


def _soft_edges(radius: float) -> list[float]:
    """Widths of the edges that a start from afar is fitted with, softest first, px.

    What a soft edge leaves must be within the reach of the next: a large ball needs some between.
    """
    softest = max(_SHARP_PX, _FELT_RADII * radius)
    steps = max(1, round(np.log(softest / _SHARP_PX) / np.log(_SHARPER)))
    return [float(soft) for soft in np.geomspace(softest, _SHARP_PX, steps + 1)[:-1]]


def _doubtful(fits: OutlineFits, guess: FloatArray) -> BoolArray:
    """Whether a fit may have settled on a panel or a shadow near the guess."""
    away = np.hypot(*(fits.centre - guess).T)
    doubtful = ~fits.found | (away > _NEAR_PX)
    if len(fits) >= _AHEAD:
        doubtful |= fits.contrast < 0.8 * np.median(fits.contrast)
        doubtful |= fits.rms_residual > 1.4 * np.median(fits.rms_residual)
    return np.asarray(doubtful)


def _round_start(centre: FloatArray, radius: float | FloatArray) -> Start:
    shape = np.zeros((len(centre), 3))
    shape[:, 0] = radius
    return Start(centre, shape, np.zeros((len(centre), 2)))


def _plausible(found: BallFits, radius: float) -> BoolArray:
    """Leave out fits that leap off the path of their neighbours and back."""
    count = len(found)
    if count < 5:
        return np.ones(count, dtype=bool)
    places = np.arange(count)[:, None] + np.array([-3, -2, -1, 1, 2, 3])
    known = (places >= 0) & (places < count)
    near = found.centre[np.clip(places, 0, count - 1)]
    near[~known] = np.nan
    expected = _middle_of_known(near)
    span = _middle_of_known(np.abs(near - expected[:, None]))
    near_by = np.abs(found.centre - expected) <= 3.0 * span + 0.3 * radius + 1.0
    return np.asarray(np.all(near_by, axis=1))


class _FitTable:
    """Fits by frame index, found or not yet."""

    def __init__(self, count: int, known: BallFits) -> None:
        self.fits = nothing_found(count)
        self.fits.put(known.frame, known.fits)

    def known(self, direction: int, most: int) -> IntArray:
        """The outermost known frames in one direction, in time order."""
        known = np.nonzero(self.fits.found)[0]
        return known[-most:] if direction > 0 else known[:most]

    def rows(self) -> BallFits:
        """What is known, in time order."""
        known = np.nonzero(self.fits.found)[0]
        return BallFits(known, self.fits.at(known))


def _extend(scene: FilmedScene, search: _Search, table: _FitTable, direction: int) -> None:
    """Go on from one end until the ball is lost, a few frames predicted at a time."""
    known = table.known(direction, 2)
    if len(known) < 2:
        return
    missed, frame = 0, int(known[-1 if direction > 0 else 0]) + direction
    while 0 <= frame < scene.count and missed < _LOST_AFTER:
        block = frame + direction * np.arange(_AHEAD if missed == 0 else 1)
        block = block[(block >= 0) & (block < scene.count)]
        guess = np.array([_predicted(table, direction, int(index))[0] for index in block])
        inside = np.all((guess >= 0) & (guess < [scene.shape[1], scene.shape[0]]), axis=1)
        if not inside[0]:
            return
        block, guess = block[inside], guess[inside]
        order = np.argsort(block)
        nothing = np.zeros(len(block), dtype=bool)
        fits = search.run(block[order], guess[order], nothing, afar=True)
        for row, index in enumerate(block.tolist()):
            start, speed = _predicted(table, direction, index)
            if row and np.hypot(*(guess[row] - start)) > _SAME_START * search.radius:
                # Predicted from too far back: once more, from its neighbours.
                break
            fit = fits.at(np.argsort(order)[row : row + 1])
            away = float(np.hypot(*(fit.centre[0] - start)))
            frame = index + direction
            if not fit.found[0] or away > 0.4 * search.radius + 0.3 * speed:
                missed += 1
                break
            table.fits.put(np.array([index]), fit)
            missed = 0


def _predicted(table: _FitTable, direction: int, index: int) -> tuple[FloatArray, float]:
    """Where the last few frames lead, and the speed there, px per frame."""
    known = table.known(direction, 4)
    time = (known - index).astype(np.float64)
    centre = table.fits.centre[known]
    slope = (centre[-1] - centre[0]) / (time[-1] - time[0])
    end = -1 if direction > 0 else 0
    return centre[end] - slope * time[end], float(np.hypot(*slope))
