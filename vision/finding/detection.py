"""Round objects in each frame that some background of the clip does not show.

An edge counts where the frame has one and where at least one of three backgrounds (the medians of
its first frames, of its last ones, and of all) is different there: what is always there has no
edges left, and the place that an object has left has none of its own in the frame. Edges vote for
centres along their gradient on both sides, in the colour channel in which they are steepest.
Pictures are reduced to a working width, since finding needs no more.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled
from vision.ball.circles import distinct, fit_to_edges, ordinate_bounds, rows_within
from vision.ball.edges import EdgePoints
from vision.scene import sorted_stack

if TYPE_CHECKING:
    from vision.scene import FilmedScene

__all__ = [
    "Backgrounds",
    "Detections",
    "backgrounds_of",
    "detect",
    "gradient",
    "looked_like",
    "reduced",
    "searched_frames",
    "smoothed",
    "table_of",
    "with_small",
]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
IntArray = NDArray[np.int64]
ColourImage = NDArray[np.uint8]
Whole = np.uint64

WORKING_WIDTH_PX = 320
"""Width to which pictures are reduced. Given by the budget: one vote costs 4 ms there."""

_SMALL_RADIUS_PX = 3.5
"""Radius on a reduced picture below which twice its size shows an object better. Derived: a circle
of fewer edge points than sixteen has none in some of its sectors."""

MAX_FRAMES = 400
"""Frames searched at most. Given by the budget: more cost time, and gaps are filled by fitting."""

_EPOCH_FRAMES = 15
"""Frames in the median of a background. Derived: noise falls to a third."""

_PER_FRAME = 16
"""Detections of a frame at most. Measured: the true ball was among the first six where it was
found at all."""

_RADIUS_STEP = 1.15
"""Ratio of radii that votes are cast for. Derived: the fit pulls in edges 15 % off a radius."""

_MIN_VOTES = 0.3
"""Share of an outline that must vote for its centre. Measured: balls half in a shadow have 0.4."""


@dataclass(frozen=True)
class Detections:
    """Round objects found, rows in order of frames.

    Attributes
    ----------
    frame : (N,) int array
        Frame in which it was found.
    centre_px : (N, 2) array
        Centre, px of the full picture.
    radius_px : (N,) array
        Radius, px.
    coverage : (N,) array
        Part of the outline with an edge along it, 0 to 1.
    sharpness : (N,) array
        Mean steepness of these edges, units of the picture's noise.
    contrast : (N, 3) array
        Mean inside minus that of the background, blue, green, red, gray levels.
    colour : (N, 3) array
        Mean colour inside, blue, green, red, gray levels.
    evenness : (N,) array
        Spread of the ratio to the background inside, in units of noise: about 1 for a shadow.
    light : (N,) array
        That ratio itself: less than 1 for a shadow.
    """

    frame: IntArray
    centre_px: FloatArray
    radius_px: FloatArray
    coverage: FloatArray
    sharpness: FloatArray
    contrast: FloatArray
    colour: FloatArray
    evenness: FloatArray
    light: FloatArray

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def dims_evenly(self) -> NDArray[np.bool_]:
        """Whether each dims what is behind it evenly, to within three times the noise (N,)."""
        return np.asarray((self.light < 1.0) & (self.evenness < 3.0))

    def at(self, rows: IntArray | NDArray[np.bool_]) -> "Detections":
        """Some of the rows."""
        return Detections(*(getattr(self, field.name)[rows] for field in fields(self)))

    def then(self, later: "Detections") -> "Detections":
        """These rows and those of later frames."""
        both = zip(vars(self).values(), vars(later).values(), strict=True)
        return Detections(*(np.concatenate(pair) for pair in both))


@dataclass(frozen=True)
class Backgrounds:
    """What the clip shows at its start, at its end, and most of the time.

    Attributes
    ----------
    scale : float
        Pixels of the full picture for one of the reduced ones.
    pictures : (3, h, w, 3) float32 array
        Blue, green, red, gray levels; smoothed as frames are.
    gradients : (3, 2, h, w, 3) float32 array
        Their derivatives along x and y.
    edge_noise : (h, w) float32 array
        Standard deviation of a derivative from frame to frame.
    noise : float
        That of a pixel of a reduced picture, gray levels.
    """

    scale: float
    pictures: FloatImage
    gradients: FloatImage
    edge_noise: FloatImage
    noise: float


def searched_frames(scene: "FilmedScene") -> IntArray:
    """Frames searched: all that the file holds, or as many spread over the motion."""
    held = scene.held
    return held if len(held) <= MAX_FRAMES else scene.spread(MAX_FRAMES)


def reduced(scene: "FilmedScene", wanted: IntArray, width: int) -> Iterator[ColourImage]:
    """Frames in colour at a working width, in the scene's frame of reference."""
    factor = min(1.0, width / scene.shape[1])
    size = (round(scene.shape[1] * factor), round(scene.shape[0] * factor))
    for _, image in scene.coloured(wanted):
        if factor < 1.0:
            image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        yield image


def backgrounds_of(pictures: NDArray[np.uint8], scale: float) -> Backgrounds:
    """Backgrounds of a clip from its reduced frames (F, h, w, 3)."""
    count = len(pictures)
    part = max(min(_EPOCH_FRAMES, count // 4), 1)
    epochs = (
        np.arange(part),
        np.arange(count - part, count),
        np.unique(np.linspace(0, count - 1, 2 * _EPOCH_FRAMES + 1).astype(int)),
    )
    medians = [_median(pictures[rows]) for rows in epochs]
    smooth = np.stack([smoothed(median) for median in medians])
    gradients = np.stack([np.stack(gradient(picture)) for picture in smooth])
    # deviations from the nearest background, by the median over time where something moves, and
    # by as much more as a codec's pulses ask for where nothing does
    edge, level = [], []
    for row in epochs[2].tolist():
        gx, gy = gradient(smoothed(pictures[row].astype(np.float32)))
        off = np.empty(gx.shape[:2], dtype=np.float32)
        _nearest(gx, gy, gradients, off)
        edge.append(off)
        level.append(float(np.median(np.abs(pictures[row] - medians[2])[::4, ::4])) / 0.6745)
    ordered = sorted_stack(edge)
    middle, upper = ordered[len(edge) // 2], ordered[(3 * len(edge)) // 4]
    usual = max(float(np.median(upper)), _MIN_EDGE_NOISE)
    pulses = usual / max(float(np.median(middle)), _MIN_EDGE_NOISE)
    edge_noise = np.maximum(cv2.GaussianBlur(middle, (0, 0), 2.0) * pulses, usual)
    noise = max(float(np.median(level)), _MIN_NOISE)
    return Backgrounds(scale, smooth, gradients, edge_noise.astype(np.float32), noise)


def _median(stack: NDArray[np.uint8] | FloatImage) -> FloatImage:
    ordered = sorted_stack(list(stack))
    return np.asarray(ordered[len(ordered) // 2], dtype=np.float32)


@compiled
def _nearest(gx: FloatImage, gy: FloatImage, known: FloatImage, off: FloatImage) -> None:
    """Largest difference of a derivative in any channel from the background nearest to it."""
    for row in range(gx.shape[0]):
        for column in range(gx.shape[1]):
            least = np.float32(1e9)
            for k in range(known.shape[0]):
                most = np.float32(0.0)
                for channel in range(3):
                    dx = abs(gx[row, column, channel] - known[k, 0, row, column, channel])
                    dy = abs(gy[row, column, channel] - known[k, 1, row, column, channel])
                    most = max(most, dx, dy)
                least = min(least, most)
            off[row, column] = least


_MIN_NOISE = 0.5
"""Gray levels. Derived: rounding to whole levels leaves 0.3 in each of two pictures."""

_MIN_EDGE_NOISE = 0.15
"""Gray levels per px. Derived: what that rounding leaves after smoothing."""


def smoothed(picture: FloatImage) -> FloatImage:
    """A picture as its edges are sought in."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.8), dtype=np.float32)


def gradient(smooth: FloatImage) -> tuple[FloatImage, FloatImage]:
    """Derivatives along x and y, gray levels per px."""
    gx = cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=1.0 / 32.0)
    gy = cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=1.0 / 32.0)
    return np.asarray(gx, dtype=np.float32), np.asarray(gy, dtype=np.float32)


@compiled
def _new_edges(
    gx: FloatImage,
    gy: FloatImage,
    known: FloatImage,
    noise: FloatImage,
    least: float,
    strength: FloatImage,
    nx: FloatImage,
    ny: FloatImage,
) -> None:
    """Squared steepness and direction of edges that some background (k, 2, h, w, 3) lacks."""
    for row in range(gx.shape[0]):
        for column in range(gx.shape[1]):
            weak = (least * noise[row, column]) ** 2
            for channel in range(3):
                x, y = gx[row, column, channel], gy[row, column, channel]
                own = x * x + y * y
                if own <= weak:
                    continue
                new = np.float32(0.0)
                for k in range(known.shape[0]):
                    dx = x - known[k, 0, row, column, channel]
                    dy = y - known[k, 1, row, column, channel]
                    new = max(new, dx * dx + dy * dy)
                if min(own, new) > weak:
                    weak = min(own, new)
                    strength[row, column] = weak
                    nx[row, column] = x
                    ny[row, column] = y


@compiled
def _edge_crests(
    strength: FloatImage,
    nx: FloatImage,
    ny: FloatImage,
    noise: FloatImage,
    least: float,
    points: FloatImage,
) -> int:
    """Write x, y, nx, ny and strength of pixels steeper than those up and down their slope."""
    count = 0
    for row in range(1, strength.shape[0] - 1):
        for column in range(1, strength.shape[1] - 1):
            square = strength[row, column]
            unit = noise[row, column]
            if square < least * least * unit * unit:
                continue
            x, y = nx[row, column], ny[row, column]
            length = np.sqrt(x * x + y * y)
            ux, uy = x / length, y / length
            across, down = int(np.rint(ux)), int(np.rint(uy))
            ahead = strength[row + down, column + across]
            behind = strength[row - down, column - across]
            if square < ahead or square <= behind:
                continue
            if count >= points.shape[1]:
                return count
            # where between the pixels the crest lies
            top, low, high = np.sqrt(square), np.sqrt(behind), np.sqrt(ahead)
            bend = 2.0 * top - low - high
            off = 0.5 * (high - low) / bend if bend > 1e-6 else 0.0
            points[0, count] = column + off * across
            points[1, count] = row + off * down
            points[2, count] = ux
            points[3, count] = uy
            points[4, count] = top / unit
            count += 1
    return count


_MIN_EDGE = 4.0
"""Steepness of an edge, standard deviations. Derived: noise alone makes one in 15,000 pixels."""

_MAX_EDGES = 3000
"""Edge points of a frame at most. Given by the budget."""


def edges_in(gx: FloatImage, gy: FloatImage, known: Backgrounds) -> EdgePoints:
    """Edges of a smoothed frame's derivatives (h, w, 3) that some background does not have."""
    shape = gx.shape[:2]
    strength = np.zeros(shape, dtype=np.float32)
    nx, ny = np.zeros(shape, dtype=np.float32), np.zeros(shape, dtype=np.float32)
    _new_edges(gx, gy, known.gradients, known.edge_noise, _MIN_EDGE, strength, nx, ny)
    return _crests(strength, nx, ny, known.edge_noise)


def _crests(strength: FloatImage, nx: FloatImage, ny: FloatImage, noise: FloatImage) -> EdgePoints:
    """The steepest edge points of a picture of squared steepness."""
    points = np.empty((5, strength.size // 3), dtype=np.float32)
    count = _edge_crests(strength, nx, ny, noise, _MIN_EDGE, points)
    points = points[:, :count]
    if count > _MAX_EDGES:
        steepest = np.argpartition(-points[4], _MAX_EDGES)[:_MAX_EDGES]
        points = np.ascontiguousarray(points[:, np.sort(steepest)])
    return EdgePoints(*points)


@compiled
def _vote(
    x: FloatImage,
    y: FloatImage,
    nx: FloatImage,
    ny: FloatImage,
    radii: FloatArray,
    margin: int,
    both_sides: bool,
    best: FloatImage,
    layer_of: NDArray[np.uint8],
) -> None:
    """Most edges, over what chance scatters, that point to each place's square from a radius away.

    Written with the radius of which it is so, where they are enough, zero elsewhere. Edges point up
    their slope, or either way. Votes are counted in squares of four pixels first: most places are
    out of the question then.
    """
    height, width = best.shape
    # unsigned, since signed places are checked for counting from the end
    one, two, wide, cells_wide = Whole(1), Whole(2), Whole(width), Whole(width // 4 + 2)
    count, highest = np.zeros(height * width, dtype=np.uint16), best.reshape(height * width)
    layers = layer_of.reshape(height * width)
    coarse = np.zeros((height // 4 + 2) * (width // 4 + 2), dtype=np.uint16)
    cells, places = np.empty((2, 2 * len(x)), dtype=np.uint64)
    for layer in range(len(radii)):
        coarse[:] = 0
        used = kept = Whole(0)
        for k in range(len(x)):
            reach = radii[layer]
            for _ in range(1 + both_sides):
                across = x[k] + reach * nx[k] + margin + 0.5
                down = y[k] + reach * ny[k] + margin + 0.5
                reach = -reach
                if 1.0 <= down < height - 1.0 and 1.0 <= across < width - 1.0:
                    row, column = Whole(down), Whole(across)
                    coarse[((row >> two) + one) * cells_wide + (column >> two) + one] += 1
                    # the first of four cells, in whose middle the vote lies
                    cells[used] = ((row + two) >> two) * cells_wide + ((column + two) >> two)
                    places[used] = row * wide + column
                    used += one
        need = Whole(_MIN_VOTES * 2.0 * np.pi * radii[layer])
        for k in range(used):
            cell = cells[k]
            near = Whole(coarse[cell]) + Whole(coarse[cell + one])
            cell += cells_wide
            near += Whole(coarse[cell]) + Whole(coarse[cell + one])
            if near > need:
                places[kept] = places[k]
                for row in (places[k] - wide, places[k], places[k] + wide):
                    for place in (row - one, row, row + one):
                        count[place] += 1
                kept += one
        worth = 1.0 / (2.0 * np.pi * math.sqrt(radii[layer]))
        for k in range(kept):
            for row in (places[k] - wide, places[k], places[k] + wide):
                for place in (row - one, row, row + one):
                    votes = Whole(count[place])
                    count[place] = 0
                    if votes > need and np.float32(worth * votes) > highest[place]:
                        highest[place] = np.float32(worth * votes)
                        layers[place] = layer


@compiled
def _sharpen_radii(
    x: FloatImage,
    y: FloatImage,
    nx: FloatImage,
    ny: FloatImage,
    radii: FloatArray,
    peaks: FloatArray,
) -> None:
    """Give each peak (x, y, radius) the radius at which most edges lie about it, pointing at it.

    Votes are counted in squares of three pixels, in which those of radii 1.5 px apart meet.
    """
    count, bounds = np.empty(len(radii)), ordinate_bounds(y)
    for place in range(len(peaks)):
        first = np.searchsorted(radii, peaks[place, 2] - 1.5)
        stop = np.searchsorted(radii, peaks[place, 2] + 1.5)
        count[first:stop] = 0.0
        least = radii[first] - 2.0 * max(0.7, 0.1 * radii[first])
        most = radii[stop - 1] + 2.0 * max(0.7, 0.1 * radii[stop - 1])
        begin, end = rows_within(bounds, peaks[place, 1] - most, peaks[place, 1] + most)
        for k in range(begin, end):
            dx, dy = x[k] - peaks[place, 0], y[k] - peaks[place, 1]
            square = dx * dx + dy * dy
            if square > most * most or square < max(least, 0.0) ** 2:
                continue
            rho = math.sqrt(square)
            if abs(dx * nx[k] + dy * ny[k]) < 0.85 * rho:
                continue
            for layer in range(first, stop):
                off = (rho - radii[layer]) / max(0.7, 0.1 * radii[layer])
                if abs(off) < 2.0:
                    count[layer] += math.exp(-0.5 * off * off)
        best = first
        for layer in range(first, stop):
            if count[layer] / math.sqrt(radii[layer]) > count[best] / math.sqrt(radii[best]):
                best = layer
        peaks[place, 2] = radii[best]


def _peaks(
    edges: EdgePoints, shape: tuple[int, int], radii: FloatArray, most: int, both_sides: bool
) -> FloatArray:
    """Centres (x, y) and radius of the circles that most edges vote for (n, 3)."""
    margin = int(np.ceil(0.5 * radii.max())) + 1
    best = np.zeros((shape[0] + 2 * margin, shape[1] + 2 * margin), dtype=np.float32)
    layer_of = np.zeros(best.shape, dtype=np.uint8)
    _vote(edges.x, edges.y, edges.nx, edges.ny, radii, margin, both_sides, best, layer_of)
    highest = cv2.dilate(best, np.ones((3, 3), np.uint8))
    row, column = np.divmod(np.flatnonzero((best > 0.0) & (best == highest)), best.shape[1])
    order = np.argsort(-best[row, column], kind="stable")[:most]
    row, column = row[order], column[order]
    peaks = np.column_stack([column - margin, row - margin, radii[layer_of[row, column]]])
    peaks = peaks.astype(np.float64)
    _sharpen_radii(edges.x, edges.y, edges.nx, edges.ny, radii, peaks)
    return peaks


_SURE_CHANGE = 12.0
"""Units of noise beyond which a change is certain and its size says no more, so that panels and
shading vanish and the outline of what changed stays. Derived: three times the least edge."""

_CHANGE_NOISE = 0.5
"""Units of noise by which the slope of a clipped change scatters. Derived: of the largest of three
smoothed channels."""


@compiled
def _changed(smooth: FloatImage, known: FloatImage, noise: float, changed: FloatImage) -> None:
    """Largest change of any channel from the first and the last background, clipped."""
    for row in range(smooth.shape[0]):
        for column in range(smooth.shape[1]):
            most = np.float32(0.0)
            for k in range(2):
                for channel in range(3):
                    off = abs(smooth[row, column, channel] - known[k, row, column, channel])
                    most = max(most, off)
            changed[row, column] = np.float32(min(float(most) / noise, _SURE_CHANGE))


@compiled
def _presence(
    gx: FloatImage, gy: FloatImage, known: FloatImage, circles: FloatArray, share: FloatArray
) -> None:
    """Share of the slope across each circle's rim that is the frame's, not a background's."""
    height, width = gx.shape[:2]
    for place in range(len(circles)):
        own, other = 0.0, 0.0
        for step in range(48):
            angle = 2.0 * math.pi * step / 48.0
            ux, uy = math.cos(angle), math.sin(angle)
            column = int(np.rint(circles[place, 0] + circles[place, 2] * ux))
            row = int(np.rint(circles[place, 1] + circles[place, 2] * uy))
            if not (1 <= row < height - 1 and 1 <= column < width - 1):
                continue
            here, there = 0.0, 0.0
            for channel in range(3):
                slope = gx[row, column, channel] * ux + gy[row, column, channel] * uy
                here = max(here, abs(slope))
                for k in range(2):
                    slope = known[k, 0, row, column, channel] * ux
                    slope += known[k, 1, row, column, channel] * uy
                    there = max(there, abs(slope))
            own += here
            other += there
        share[place] = own / max(own + other, 1e-6)


_MIN_PRESENCE = 0.5
"""Share of the slope across a rim that must be the frame's. Derived: where an object was or will
be, a background has all of it; where it is, none."""


def whole_circles(
    smooth: FloatImage,
    derivatives: tuple[FloatImage, FloatImage],
    known: Backgrounds,
    radii: FloatArray,
    coarse: FloatArray | None = None,
) -> FloatArray:
    """Circles of what changed as a whole, without those where an object was or will be (n, 5)."""
    shape = smooth.shape[:2]
    changed = np.empty(shape, dtype=np.float32)
    _changed(smooth, known.pictures, known.noise, changed)
    nx, ny = gradient(changed)
    noise = np.full(shape, _CHANGE_NOISE, dtype=np.float32)
    crests = _crests(nx * nx + ny * ny, nx, ny, noise)
    circles = circles_in(crests, shape, radii, coarse, both_sides=False)
    share = np.empty(len(circles))
    _presence(*derivatives, known.gradients, circles, share)
    return circles[share > _MIN_PRESENCE]


def _together(edged: FloatArray, whole: FloatArray) -> FloatArray:
    """Circles of edges and of what changed as a whole; parts of a complete whole are left out."""
    complete = whole[whole[:, 3] > _COMPLETE]
    kept = [one for one in edged if not any(_part_of(one, other) for other in complete)]
    found = np.array([*kept, *whole]).reshape(-1, 5)
    found = found[distinct(found)]
    return found[np.argsort(-_clearness(found), kind="stable")][:_PER_FRAME]


_COMPLETE = 0.85
"""Part of an outline from which it is complete. Derived: at most two of sixteen sectors missed."""


def _part_of(circle: FloatArray, whole: FloatArray) -> bool:
    """Whether a circle is a panel or a spot on a complete one."""
    gap = math.hypot(circle[0] - whole[0], circle[1] - whole[1])
    return bool(gap + circle[2] < 1.1 * whole[2] and circle[2] < 0.75 * whole[2])


def circles_in(
    edges: EdgePoints,
    shape: tuple[int, int],
    radii: FloatArray,
    coarse: FloatArray | None = None,
    *,
    both_sides: bool = True,
) -> FloatArray:
    """Circles of a reduced frame: x, y, radius, coverage, sharpness (n, 5), best first.

    Brighter or darker than what is about them, or brighter only. Those found in the frame at half
    the size, `coarse` (m, 5), are fitted, too: far from an edge its direction scatters by more than
    the square that votes are counted in.
    """
    if len(edges.x) < 8:
        return np.zeros((0, 5))
    starts = _peaks(edges, shape, radii, 4 * _PER_FRAME, both_sides)
    if coarse is not None:
        large = coarse[2.0 * coarse[:, 2] > _MIN_HALVED_PX]
        doubled = np.column_stack([2.0 * large[:, :2] + 0.5, 2.0 * large[:, 2]])
        starts = np.vstack([doubled, starts])
    found = fit_to_edges(edges, starts)
    found = found[found[:, 3] >= _MIN_COVERAGE]
    found = found[np.argsort(-_clearness(found), kind="stable")]
    return found[distinct(found)][:_PER_FRAME]


def _clearness(circles: FloatArray) -> FloatArray:
    """How clear and large circles (n, 5) are (n,)."""
    return np.asarray(circles[:, 3] * np.log1p(circles[:, 4]) * np.sqrt(circles[:, 2]))


_MIN_HALVED_PX = 12.0
"""Radius from which circles are sought at half the size, too. Derived: the direction of an edge of
eight standard deviations scatters by 0.12, which at that distance is half a square of votes."""

_MIN_COVERAGE = 0.45
"""Part of the outline with an edge. Measured: a ball half hidden by a mass keeps half of it."""


def _radii(side: int, small: bool) -> FloatArray:
    """Radii tried, up to what fits the shorter side of a reduced picture."""
    low, high = (1.7, _SMALL_RADIUS_PX) if small else (2.3, max(0.42 * side, 2.3))
    steps = int(np.ceil(np.log(high / low) / np.log(_RADIUS_STEP)))
    return np.asarray(np.geomspace(low, high, steps + 1))


@compiled
def _looks(
    picture: ColourImage, known: FloatImage, circles: FloatArray, noise: float, looks: FloatArray
) -> None:
    """Write contrast (3), colour (3), evenness and light of what circles (n, 5) hold (n, 8)."""
    height, width = picture.shape[:2]
    for place in range(len(circles)):
        x, y = circles[place, 0], circles[place, 1]
        reach = max(0.75 * circles[place, 2], 1.0)
        rows = range(max(0, int(y - reach)), min(height, int(y + reach) + 2))
        columns = range(max(0, int(x - reach)), min(width, int(x + reach) + 2))
        seen, count = np.zeros(3), 0
        behind = np.zeros((known.shape[0], 3))
        for row in rows:
            for column in columns:
                if (column - x) ** 2 + (row - y) ** 2 > reach * reach:
                    continue
                count += 1
                for channel in range(3):
                    seen[channel] += picture[row, column, channel]
                    for k in range(known.shape[0]):
                        behind[k, channel] += known[k, row, column, channel]
        if count == 0:
            looks[place] = 0.0
            continue
        best, most = 0, -1.0
        for k in range(known.shape[0]):
            off = np.abs(seen - behind[k]).sum()
            if off > most:
                best, most = k, off
        light = seen.sum() / max(behind[best].sum(), 1.0)
        squares = 0.0
        for row in rows:
            for column in columns:
                if (column - x) ** 2 + (row - y) ** 2 <= reach * reach:
                    for channel in range(3):
                        left = (
                            picture[row, column, channel]
                            - light * known[best, row, column, channel]
                        )
                        squares += left * left
        looks[place, :3] = (seen - behind[best]) / count
        looks[place, 3:6] = seen / count
        looks[place, 6] = math.sqrt(squares / (3.0 * count)) / noise
        looks[place, 7] = light


def looked_like(picture: ColourImage, known: Backgrounds, circles: FloatArray) -> FloatArray:
    """Contrast (3), colour (3), evenness and light of what circles of a picture hold (n, 8)."""
    looks = np.empty((len(circles), 8))
    _looks(picture, known.pictures, circles, known.noise, looks)
    return looks


def detect(scene: "FilmedScene") -> Detections:
    """Find round objects in every frame searched.

    Parameters
    ----------
    scene : FilmedScene
        The clip's frames, registered.

    Returns
    -------
    Detections
    """
    return _detected(scene, searched_frames(scene), WORKING_WIDTH_PX, small=False)


def with_small(scene: "FilmedScene", coarse: Detections) -> Detections:
    """Detections with smaller objects found at twice the working width, where pictures have it.

    Parameters
    ----------
    scene : FilmedScene
        The clip's frames, registered.
    coarse : Detections
        What `detect` found.

    Returns
    -------
    Detections
    """
    if scene.shape[1] <= 1.5 * WORKING_WIDTH_PX:
        return coarse
    fine = _detected(scene, searched_frames(scene), 2 * WORKING_WIDTH_PX, small=True)
    return _joined(coarse, fine)


def _detected(scene: "FilmedScene", wanted: IntArray, width: int, *, small: bool) -> Detections:
    pictures = np.stack(list(reduced(scene, wanted, width)))
    scale = scene.shape[1] / pictures.shape[2]
    known = backgrounds_of(pictures, scale)
    radii = _radii(min(pictures.shape[1:3]), small)
    halves = None if small else _halved(pictures)
    half_known = None if halves is None else backgrounds_of(halves, 2.0 * scale)
    rows = []
    for index, frame in enumerate(wanted.tolist()):
        picture = pictures[index]
        smooth = smoothed(picture.astype(np.float32))
        if halves is None or half_known is None:
            circles = circles_in(edges_in(*gradient(smooth), known), smooth.shape[:2], radii)
        else:
            edged, whole = _both(smoothed(halves[index].astype(np.float32)), half_known, radii)
            circles = _together(*_both(smooth, known, radii, edged, whole))
        looks = looked_like(picture, known, circles)
        rows.append(np.column_stack([np.full(len(circles), float(frame)), circles, looks]))
    return table_of(np.concatenate(rows), scale)


def _halved(pictures: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Pictures (F, h, w, 3) at half the size."""
    size = (pictures.shape[2] // 2, pictures.shape[1] // 2)
    return np.stack([cv2.resize(one, size, interpolation=cv2.INTER_AREA) for one in pictures])


def _both(
    smooth: FloatImage,
    known: Backgrounds,
    radii: FloatArray,
    edged: FloatArray | None = None,
    whole: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Circles of edges and of what changed as a whole; with those of half the size."""
    shape, derivatives = smooth.shape[:2], gradient(smooth)
    radii = radii[radii < 0.42 * min(shape)]
    return (
        circles_in(edges_in(*derivatives, known), shape, radii, edged),
        whole_circles(smooth, derivatives, known, radii, whole),
    )


def table_of(rows: FloatArray, scale: float) -> Detections:
    """Detections from rows of frame, circle (5) and looks (8), px of the reduced picture."""
    half = 0.5 * (scale - 1.0)
    frame, centre, radius = rows[:, 0].astype(np.int64), rows[:, 1:3] * scale + half, rows[:, 3]
    return Detections(
        frame,
        centre,
        radius * scale,
        rows[:, 4],
        rows[:, 5],
        rows[:, 6:9],
        rows[:, 9:12],
        rows[:, 12],
        rows[:, 13],
    )


def _joined(coarse: Detections, fine: Detections) -> Detections:
    """Both in order of frames; of circles found twice the coarse ones, whose outlines are whole."""
    again = np.zeros(len(fine), dtype=bool)
    for row in range(len(fine)):
        near = slice(*np.searchsorted(coarse.frame, [fine.frame[row], fine.frame[row] + 1]))
        away = np.hypot(*(coarse.centre_px[near] - fine.centre_px[row]).T)
        again[row] = bool(np.any(away < 0.5 * coarse.radius_px[near]))
    new = fine.at(~again)
    columns = [
        np.concatenate([getattr(part, field.name) for part in (coarse, new)])
        for field in fields(Detections)
    ]
    joined = Detections(*columns)
    return joined.at(np.argsort(joined.frame, kind="stable"))
