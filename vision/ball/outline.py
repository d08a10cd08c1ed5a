"""Sub-pixel outlines of a ball: an edge model fitted to the pixels against the known background.

In a ring of pixels about the outline, each a mixture of background and ball,

    I = k·(1 − G₀(ρ))·B + A·G₀(ρ) + C·G₁(ρ),

B is the known background (so that grid lines behind the ball pull nothing), G₀ the covered part of
the pixel and G₁ the same times the sphere's shading (`edge_profile`). k (a shadow behind the ball),
A and C (whatever colour and shading the ball has there) are free in each sector of the outline, so
that neither panels nor light bias it; they are eliminated (variable projection, Golub
and Pereyra 1973) and only the outline's few parameters are iterated. Sectors that the model does
not describe lose weight. Many frames are fitted at once.

The circle of edges nearest a guess: all that a ball of a few pixels allows.

The outline's normal equations, compiled: each sector's linear part solved and projected out.

All sums run over the pixels of one sector of one frame. Pixels are the rows x, y (offsets from the
whole pixel about which the ring is laid), picture, background and inverse noise of a float32 array
(5, n), sorted by sector; sector s holds the places `first[s]` to `first[s + 1]`. Matrices and
vectors of all sectors carry the sector first.

Outlines fitted in several frames, as a table.
"""

import math
from collections import deque
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled, map_in_threads
from vision.ball.circles import find_circles
from vision.ball.edges import Cutouts, EdgeProfile
from vision.scene import FilmedScene, Window

__all__ = [
    "RADIUS_STD_PX",
    "FitRules",
    "OutlineFits",
    "Start",
    "fit_outlines",
    "joined",
    "nothing_found",
    "panelled",
    "voted_outlines",
    "weighted",
]

FloatArray = NDArray[np.float64]

BoolArray = NDArray[np.bool_]

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class OutlineFits:
    """One row per frame.

    Attributes
    ----------
    found : (F,) bool array
        Whether there is an outline at all; the other rows mean nothing.
    centre : (F, 2) array
        Centre, px.
    radius : (F,) array
        Mean radius, px.
    covariance : (F, 2, 2) array
        Of the centre, px²; from the scatter that each sector of the outline shows.
    bound : (F, 2, 2) array
        Cramér–Rao bound of the same from noise and contrast alone, px².
    rms_residual : (F,) array
        Root mean square residual over noise.
    contrast : (F,) array
        Part of the sectors whose edge stands out from the noise, 0 to 1.
    normal : (F, 5, 5) array
        Normal matrix of centre, radius and ellipse at the solution, 1/px².
    pull : (F, 5) array
        What each of them is still pulled by there, 1/px.
    """

    found: BoolArray
    centre: FloatArray
    radius: FloatArray
    covariance: FloatArray
    bound: FloatArray
    rms_residual: FloatArray
    contrast: FloatArray
    normal: FloatArray
    pull: FloatArray

    def __len__(self) -> int:
        return len(self.found)

    def at(self, places: IntArray | BoolArray) -> "OutlineFits":
        """Some of the rows."""
        return OutlineFits(*(getattr(self, field.name)[places] for field in fields(self)))

    def put(self, places: IntArray | BoolArray, other: "OutlineFits") -> None:
        """Overwrite some of the rows."""
        for field in fields(self):
            getattr(self, field.name)[places] = getattr(other, field.name)


def nothing_found(count: int) -> OutlineFits:
    """A table of so many frames in which nothing was found yet."""
    return OutlineFits(
        np.zeros(count, dtype=bool),
        np.zeros((count, 2)),
        np.zeros(count),
        np.zeros((count, 2, 2)),
        np.zeros((count, 2, 2)),
        np.zeros(count),
        np.zeros(count),
        np.zeros((count, 5, 5)),
        np.zeros((count, 5)),
    )


def joined(parts: list[OutlineFits]) -> OutlineFits:
    """Tables one below the other."""
    return OutlineFits(
        *(
            np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(OutlineFits)
        )
    )


FloatImage = NDArray[np.float32]

Single = np.float32

_SETTLED = 0.3

"""px: a step below which sectors are judged by how far off they are, and by their panels."""

SLACK_PX = 0.8

"""px: so far at most a centre lies off the whole pixel about which its ring is laid: 1/√2."""

_FEWEST_PIXELS = 24

"""Pixels of an outline: it has three unknowns and each of eight sectors three more."""

_FEWEST_IN_SECTOR = 5

"""Pixels of a sector: its light has three unknowns, two are to spare."""

_FEWEST_SECTORS, _LEAST_SECTORS = 4, 0.4

"""Sectors in view, and part of all: an arc of less hardly tells a radius, supposed."""

_NARROW = 1.6

"""px inside the outline that are used of a sector that an edge of the ball's own crosses: the
outline's blur."""

_LONGEST_STEP = 0.35

"""Of the ring's inner width: a longer step may leave the ring."""

_BASIS = 3

"""Unknowns of a sector's light: shadow factor, level and slope."""

_PANELLED = 1.4

"""Times the usual misfit: a sector that fits so much worse has something in it that the model does
not know."""

_RIDGE = 1e-8

"""Relative: directions in which a sector's three numbers are told apart by less than this part of
the rest are not told apart at all."""

_OFFSET_SCALES = 2.0

_LEAST_OFFSET = 0.03

"""px: sectors of one outline agree no better, whatever the noise."""

_CLUSTERS = 8

"""Independent parts that an outline is taken to have."""

_CLEAR_SIGMA = 2.0

"""Times the misfit: a sector of which a shift by a pixel is less is no edge, supposed."""


@compiled
def _inverted(matrix: FloatArray, count: int, ridge: float, found: FloatArray) -> None:
    """Invert the first rows of a positive definite matrix plus a multiple of one (Gauss–Jordan)."""
    for i in range(count):
        for j in range(count):
            found[i, j] = matrix[i, j]
        found[i, i] += ridge
    for k in range(count):
        pivot = 1.0 / found[k, k]
        found[k, k] = 1.0
        for j in range(count):
            found[k, j] *= pivot
        for i in range(count):
            if i != k:
                share = found[i, k]
                found[i, k] = 0.0
                for j in range(count):
                    found[i, j] -= share * found[k, j]


@compiled
def _upper_middle(values: FloatArray, count: int) -> float:
    """Upper median of the first so many values, which are put into order; 0 of none."""
    for k in range(1, count):
        value, j = values[k], k
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
    return values[count // 2] if count > 0 else 0.0


class _Pieces(NamedTuple):
    """The pixels around each frame's outline: see `Cutouts`."""

    gray: FloatImage
    background: FloatImage
    inverse_noise: FloatImage
    corner: IntArray


class _Ring(NamedTuple):
    """Which pixels about a whole pixel make up the ring, the same for all frames.

    Attributes
    ----------
    places : (2, n) int array
        x, y, sorted by sectors of about four pixels of outline, px.
    bounds : (S + 1,) int array
        Where each sector's begin.
    widths : (2,) array
        How far the ring reaches inside and outside the outline, px.
    reach : int
        Of the outermost pixel, px.
    """

    places: IntArray
    bounds: IntArray
    widths: FloatArray
    reach: int


class _Edge(NamedTuple):
    """How an edge looks: tables (4, n) and steps (5,) of `EdgeProfile`, and what its light may be.

    The priors (3,) are information on a sector's shadow factor (about 1), level and slope.
    """

    tables: FloatImage
    steps: FloatArray
    priors: FloatArray


class _Ending(NamedTuple):
    """When a fit ends, and with how much.

    Attributes
    ----------
    size : int
        Of how many of centre, radius, ellipse the normal equations are wanted at the end: 3 or 5.
    iterations : int
        Steps at most.
    tolerance : float
        A step shorter than this is the last, px.
    narrow : bool
        Whether of sectors with a panel in them only what lies close to the rim is used.
    """

    size: int
    iterations: int
    tolerance: float
    narrow: bool


class _Sums(NamedTuple):
    """Each sector's equations where the outline lies, and its weight: see `weighted`.

    Attributes
    ----------
    information : (F, S, 5, 5) array
    score : (F, S, 5) array
    square, counted, weight : (F, S) arrays
        Of one frame, each without F.
    """

    information: FloatArray
    score: FloatArray
    square: FloatArray
    counted: FloatArray
    weight: FloatArray


class _Scratch(NamedTuple):
    """Room for one frame's sums.

    Attributes
    ----------
    pixels, work : (5, n) and (12, n) float32 arrays
        A ring's pixels, and what a sector makes of them.
    first : (S + 1,) int array
        Where each sector's pixels begin.
    small : (5, 5, 5) array
    spread : (S,) array
    step, middle : (3,) and (2,) arrays
        The latest step, and the whole pixel about which the ring lies, px.
    """

    pixels: FloatImage
    work: FloatImage
    first: IntArray
    small: FloatArray
    spread: FloatArray
    step: FloatArray
    middle: FloatArray


@compiled
def _gathered(
    pieces: _Pieces, frame: int, ring: _Ring, outline: FloatArray, scratch: _Scratch
) -> bool:
    """Pick the pixels of a ring out of one frame; whether enough of it is in view."""
    gray, background = pieces.gray[frame], pieces.background[frame]
    inverse_noise, corner = pieces.inverse_noise[frame], pieces.corner[frame]
    pixels, first, middle = scratch.pixels, scratch.first, scratch.middle
    places, bounds, widths, reach = ring.places, ring.bounds, ring.widths, ring.reach
    width = gray.shape[0]
    middle[0], middle[1] = np.rint(outline[0]), np.rint(outline[1])
    column, row = int(middle[0]) - corner[0], int(middle[1]) - corner[1]
    for s in range(len(first)):
        first[s] = 0
    if column < reach or row < reach or column >= width - reach or row >= width - reach:
        return False
    away_x, away_y = Single(outline[0] - middle[0]), Single(outline[1] - middle[1])
    radius, near, far = Single(outline[2]), Single(-widths[0]), Single(widths[1])
    count, every, sectors = 0, 0, 0
    for s in range(len(bounds) - 1):
        first[s] = count
        for k in range(bounds[s], bounds[s + 1]):
            x, y = places[0, k], places[1, k]
            weight = inverse_noise[row + y, column + x]
            dx, dy = Single(x) - away_x, Single(y) - away_y
            depth = math.sqrt(dx * dx + dy * dy) - radius
            if depth > near and depth < far and weight > 0:
                pixels[0, count], pixels[1, count] = Single(x), Single(y)
                pixels[2, count] = gray[row + y, column + x]
                pixels[3, count] = background[row + y, column + x]
                pixels[4, count] = weight
                count += 1
        every += count - first[s]
        if count - first[s] >= _FEWEST_IN_SECTOR:
            sectors += 1
        else:
            count = first[s]
    first[len(bounds) - 1] = count
    most = len(bounds) - 1
    return every >= _FEWEST_PIXELS and sectors >= max(_FEWEST_SECTORS, _LEAST_SECTORS * most)


@compiled
def _laid_out(
    pixels: FloatImage,
    low: int,
    high: int,
    outline: FloatArray,
    middle: FloatArray,
    smear: FloatArray,
    tables: FloatImage,
    steps: FloatArray,
    inner: float,
    size: int,
    work: FloatImage,
) -> int:
    """Basis, picture and slopes of a sector's pixels over their noise; how many of them count.

    The rows of `work` become: the background, the ball's light and its shading; the picture; what
    the three of the basis change by per px of depth; and the depth's derivatives by the outline.
    """
    away_x, away_y = Single(outline[0] - middle[0]), Single(outline[1] - middle[1])
    radius, even, odd = Single(outline[2]), Single(outline[3]), Single(outline[4])
    move_x, move_y = Single(smear[0]), Single(smear[1])
    per_step, zero, per_row = Single(steps[0]), Single(steps[1]), Single(steps[2])
    columns, last = int(steps[3]), Single(steps[3] - 1.0)
    most = Single(steps[4])
    limit, two = Single(-inner), Single(2.0)
    count = 0
    for k in range(low, high):
        dx, dy = pixels[0, k] - away_x, pixels[1, k] - away_y
        rho = math.sqrt(dx * dx + dy * dy)
        depth = rho - radius
        if depth < limit:
            continue
        ux, uy = dx / rho, dy / rho
        cos2, sin2 = ux * ux - uy * uy, two * ux * uy
        depth -= even * cos2 + odd * sin2
        place = int(min(max(depth * per_step + zero, Single(0.0)), last))
        along = abs(ux * move_x + uy * move_y) * per_row + Single(0.5)
        place += int(min(along, most)) * columns
        weight = pixels[4, k]
        seen, cover, slope = pixels[3, k] * weight, tables[0, place], tables[1, place]
        work[0, count] = seen - cover * seen
        work[1, count] = cover * weight
        work[2, count] = tables[2, place] * weight
        work[3, count] = pixels[2, k] * weight
        work[4, count] = seen * slope
        work[5, count] = weight * slope
        work[6, count] = tables[3, place] * weight
        work[7, count], work[8, count], work[9, count] = ux, uy, Single(1.0)
        if size > _BASIS:
            work[10, count], work[11, count] = cos2, sin2
        count += 1
    return count


@compiled
def _light_sums(work: FloatImage, count: int, plain: FloatArray, right: FloatArray) -> float:
    """Normal equations of a sector's light; returns their trace.

    Sums that are kept side by side don't wait for each other.
    """
    zero = Single(0.0)
    p00, p01, p02, p11, p12, p22 = zero, zero, zero, zero, zero, zero
    r0, r1, r2 = zero, zero, zero
    for k in range(count):
        scene, light, shading, seen = work[0, k], work[1, k], work[2, k], work[3, k]
        p00 += scene * scene
        p01 += scene * light
        p02 += scene * shading
        p11 += light * light
        p12 += light * shading
        p22 += shading * shading
        r0 += scene * seen
        r1 += light * seen
        r2 += shading * seen
    plain[0, 0], plain[1, 1], plain[2, 2] = p00, p11, p22
    plain[0, 1] = plain[1, 0] = p01
    plain[0, 2] = plain[2, 0] = p02
    plain[1, 2] = plain[2, 1] = p12
    right[0], right[1], right[2] = r0, r1, r2
    return float(plain[0, 0] + plain[1, 1] + plain[2, 2])


@compiled
def _outline_sums(
    work: FloatImage,
    count: int,
    size: int,
    cross: FloatArray,
    information: FloatArray,
    score: FloatArray,
) -> None:
    """Products of the outline's derivatives with the light's, the residuals and each other."""
    for j in range(size):
        c0, c1, c2, pull = Single(0.0), Single(0.0), Single(0.0), Single(0.0)
        for k in range(count):
            along = work[7 + j, k] * work[4, k]
            work[7 + j, k] = along
            c0 += along * work[0, k]
            c1 += along * work[1, k]
            c2 += along * work[2, k]
            pull += along * work[3, k]
        cross[0, j], cross[1, j], cross[2, j], score[j] = c0, c1, c2, pull
        for i in range(j + 1):
            total = Single(0.0)
            for k in range(count):
                total += work[7 + i, k] * work[7 + j, k]
            information[i, j] = total


@compiled
def _summed(
    work: FloatImage,
    count: int,
    priors: FloatArray,
    size: int,
    small: FloatArray,
    information: FloatArray,
    score: FloatArray,
) -> float:
    """Solve a sector's light, and sum up residuals and derivatives; the squared residuals.

    `small` (5, 5, 5) is room to work in.
    """
    plain, inverse, cross, carried, linear = small[0], small[1], small[2], small[3], small[4]
    trace = _light_sums(work, count, plain, linear[0])
    for i in range(_BASIS):
        plain[i, i] += priors[i]
    # the priors keep this regular even for a sector without pixels
    _inverted(plain, _BASIS, 1e-9, inverse)
    for i in range(_BASIS):
        plain[i, i] -= priors[i]
        linear[1, i] = inverse[i, 0] * priors[0]
        for j in range(_BASIS):
            linear[1, i] += inverse[i, j] * linear[0, j]
    shadow, level, shade = Single(linear[1, 0]), Single(linear[1, 1]), Single(linear[1, 2])
    square = Single(0.0)
    for k in range(count):
        left = work[3, k] - shadow * work[0, k] - level * work[1, k] - shade * work[2, k]
        work[4, k] = shadow * work[4, k] - level * work[5, k] - shade * work[6, k]
        work[3, k] = left
        square += left * left
    _inverted(plain, _BASIS, _RIDGE * trace + 1e-6, inverse)
    for i in range(_BASIS):
        linear[2, i] = linear[0, i]
        for j in range(_BASIS):
            linear[2, i] -= plain[i, j] * linear[1, j]
    _outline_sums(work, count, size, cross, information, score)
    for j in range(size):
        for i in range(_BASIS):
            carried[i, j] = 0.0
            for k in range(_BASIS):
                carried[i, j] += inverse[i, k] * cross[k, j]
            score[j] -= carried[i, j] * linear[2, i]
    for i in range(size):
        for j in range(i, size):
            for k in range(_BASIS):
                information[i, j] -= cross[k, i] * carried[k, j]
            information[j, i] = information[i, j]
    return float(square)


@compiled
def panelled(square: FloatArray, size: FloatArray, work: FloatArray) -> float:
    """Squared residual per spare pixel above which a panel's edge is in a sector.

    Parameters
    ----------
    square, size : (S,) arrays
        Sum of squared residuals over noise of each sector, and how many pixels count.
    work : (S,) array
        Room to work in.
    """
    count = 0
    for s in range(len(size)):
        if size[s] > 0:
            work[count] = math.sqrt(square[s] / max(size[s] - _BASIS, 1.0))
            count += 1
    return (_PANELLED * max(_upper_middle(work, count), 0.5)) ** 2


@compiled
def weighted(
    information: FloatArray,
    score: FloatArray,
    square: FloatArray,
    size: FloatArray,
    settled: bool,
    work: FloatArray,
    weight: FloatArray,
) -> None:
    """Weights of sectors: those that do not fit the model, or lie off the others, count less.

    A panel's edge just inside a white ball before a white wall is sharper than the outline itself;
    it is told by its offset. No sector tells the outline better than the sectors agree, however
    sharp its edge.

    Parameters
    ----------
    information : (S, m, m) array
        Of centre x, y, radius and, for m = 5, ellipse, the linear part eliminated.
    score : (S, m) array
        What pulls at them.
    square, size : (S,) arrays
        See `panelled`.
    settled : bool
        Whether the outline is near enough for sectors to be judged by their offset from it.
    work, weight : (S,) arrays
        Room to work in; takes the weights.
    """
    sectors = len(size)
    typical = panelled(square, size, work) / _PANELLED**2
    for s in range(sectors):
        off = square[s] / max(size[s] - _BASIS, 1.0) / typical
        weight[s] = (2.0 / (1.0 + off)) ** 2 / typical if size[s] > 0 else 0.0
    if not settled:
        return
    every, outward = 0, 0
    for s in range(sectors):
        if size[s] > 0:
            work[every] = abs(score[s, 2]) / max(information[s, 2, 2], 1e-9)
            every += 1
    usual = _upper_middle(work, every)
    for s in range(sectors):
        if size[s] > 0 and score[s, 2] > 0.0:
            work[outward] = score[s, 2] / max(information[s, 2, 2], 1e-9)
            outward += 1
    if outward > _BASIS:
        usual = min(usual, _upper_middle(work, outward))
    scale = max(1.4826 * usual, _LEAST_OFFSET)
    for s in range(sectors):
        offset = score[s, 2] / max(information[s, 2, 2], 1e-9)
        robust = 1.0 / (1.0 + (offset / (_OFFSET_SCALES * scale)) ** 2)
        if offset < 0.0:
            robust *= robust
        weight[s] *= robust / (1.0 + scale * scale * information[s, 2, 2] * weight[s])


@compiled
def _equations(
    scratch: _Scratch,
    outline: FloatArray,
    smear: FloatArray,
    edge: _Edge,
    narrow: bool,
    size: int,
    sums: _Sums,
) -> None:
    """All sectors' equations; where it is `narrow`, without what panels do further inside."""
    pixels, first, middle = scratch.pixels, scratch.first, scratch.middle
    work, small = scratch.work, scratch.small
    square, count, most = sums.square, sums.counted, 0.0
    for again in range(2 if narrow else 1):
        inner = _NARROW if again else 1e9
        for s in range(len(first) - 1):
            panel = count[s] > 0 and square[s] > most * max(count[s] - _BASIS, 1.0)
            if again and not panel:
                continue
            inside = _laid_out(
                pixels, first[s], first[s + 1], outline, middle, smear, edge.tables, edge.steps,
                inner, size, work,
            )  # fmt: skip
            if again and inside < _FEWEST_IN_SECTOR:
                inside = 0
            count[s] = inside
            square[s] = _summed(
                work, inside, edge.priors, size, small, sums.information[s], sums.score[s]
            )
        if narrow:
            most = panelled(square, count, scratch.spread)


@compiled
def _step(sums: _Sums, held: FloatArray, swollen: float, scratch: _Scratch) -> float:
    """One Gauss–Newton step of what is free; returns how far the centre goes, px."""
    information, score, weight = sums.information, sums.score, sums.weight
    small, step, free = scratch.small, scratch.step, len(held)
    normal, inverse, pull = small[0], small[1], small[2, 0]
    trace = 0.0
    for i in range(free):
        pull[i] = -held[i] * swollen
        for j in range(free):
            normal[i, j] = 0.0
        for s in range(len(weight)):
            pull[i] += weight[s] * score[s, i]
            for j in range(free):
                normal[i, j] += weight[s] * information[s, i, j]
        trace += normal[i, i]
    for i in range(free):
        normal[i, i] += held[i]
    _inverted(normal, free, 1e-6 * trace, inverse)
    for i in range(free):
        step[i] = 0.0
        for j in range(free):
            step[i] += inverse[i, j] * pull[j]
    return math.hypot(step[0], step[1])


@compiled
def _fitted(
    pieces: _Pieces,
    frame: int,
    ring: _Ring,
    edge: _Edge,
    held: FloatArray,
    smear: FloatArray,
    ending: _Ending,
    scratch: _Scratch,
    now: FloatArray,
    sums: _Sums,
) -> bool:
    """Fit the outline of one frame; whether there is one."""
    radius, free, length = now[2], len(held), 1e9
    for k in range(ending.iterations + 1):
        # at the end the equations are set up once more where the outline came to lie
        last = k == ending.iterations or length < ending.tolerance
        if not _gathered(pieces, frame, ring, now, scratch):
            return False
        settled = last or length < _SETTLED
        wanted = ending.size if last else 3
        _equations(scratch, now, smear, edge, settled and ending.narrow, wanted, sums)
        weighted(
            sums.information, sums.score, sums.square, sums.counted, settled, scratch.spread,
            sums.weight,
        )  # fmt: skip
        if last:
            break
        length = _step(sums, held, now[2] - radius, scratch)
        if not length < 1e6:
            return False
        limit = min(1.0, _LONGEST_STEP * ring.widths[0] / max(length, 1e-12))
        for i in range(free):
            now[i] += limit * scratch.step[i]
    return True


@compiled
def fitted_outlines(
    pieces: _Pieces,
    ring: _Ring,
    edge: _Edge,
    held: FloatArray,
    smear: FloatArray,
    ending: _Ending,
    low: int,
    high: int,
    outline: FloatArray,
    found: BoolArray,
    sums: _Sums,
) -> None:
    """Fit the outlines of some frames, one after the other.

    Parameters
    ----------
    pieces, ring, edge, ending
    held : (2,) or (3,) array
        Information on centre and radius at the start: as many are free.
    smear : (F, 2) array
        Motion during the exposure, px.
    low, high : int
        Frames.
    outline : (F, 5) array
        Centre, radius and ellipse, at the start and then at the end, px.
    found : (F,) bool array
        Takes whether there is an outline.
    sums : _Sums
        Takes each sector's equations at the end, and its weight.
    """
    sectors, most = len(ring.bounds) - 1, ring.places.shape[1]
    scratch = _Scratch(
        np.empty((5, most), dtype=np.float32),
        np.empty((12, most), dtype=np.float32),
        np.empty(sectors + 1, dtype=np.int64),
        np.empty((5, 5, 5)),
        np.empty(sectors),
        np.empty(3),
        np.empty(2),
    )
    for f in range(low, high):
        own = _Sums(
            sums.information[f], sums.score[f], sums.square[f], sums.counted[f], sums.weight[f]
        )
        found[f] = _fitted(pieces, f, ring, edge, held, smear[f], ending, scratch, outline[f], own)


_BATCH = 16

"""Frames that one core fits before it takes the next, supposed."""

_SECTOR_PX, _SECTORS = 4.0, (6, 160)

"""px of outline, and how many at least and at most: a sector of less than four pixels of outline
has too few pixels for its light; one of many more holds more than one light, and a ball's own
lines. The most is what memory allows."""

RADIUS_STD_PX = 0.13
"""What outlines of balls in flight are off by as a whole: root mean square over eleven ray-traced
clips of another renderer 0.13 px, over nine own ones 0.10 px, for radii of 4 to 33 px."""

_SHADOW_PRIOR = 0.3

"""Prior width of a sector's shadow factor, about 1."""

_SHADING_PRIOR = 255.0

"""Gray levels, prior width of the light of a sector: full scale, that is none."""

_SMALL_RADIUS = 10.0

"""px: smaller balls show less of their light within a sector, and its priors narrow with them."""


@dataclass(frozen=True)
class FitRules:
    """How to fit.

    Attributes
    ----------
    free : int
        2: centre only; 3: and radius.
    radius_std : float
        How far from the starting radius a free one may be, one sigma, px.
    inner, outer : float
        How far the ring reaches inside and outside the outline, px.
    iterations : int
        Steps at most.
    tolerance : float
        A step shorter than this is the last, px.
    shape_pull : bool
        Whether radius and ellipse are wanted in the normal equations that are handed back.
    panels : bool
        Whether, with the centre only free, a sector that fits badly is taken to have a panel of the
        ball's own in it, and used close to the rim only.
    """

    free: int = 2
    radius_std: float = np.inf
    inner: float = 6.0
    outer: float = 4.0
    iterations: int = 8
    tolerance: float = 1e-2
    shape_pull: bool = False
    panels: bool = True


@dataclass(frozen=True)
class Start:
    """Where the fits begin.

    Attributes
    ----------
    centre : (F, 2) array
        Centres, px.
    shape : (F, 3) array
        Radius and ellipse a, b: the outline is r + a cos 2θ + b sin 2θ, px; what is not free is
        held there.
    smear : (F, 2) array
        Motion during the exposure, px.
    """

    centre: FloatArray
    shape: FloatArray
    smear: FloatArray

    def at(self, places: IntArray | slice) -> "Start":
        """Some of them."""
        return Start(self.centre[places], self.shape[places], self.smear[places])


def fit_outlines(
    cutouts: Cutouts, profile: EdgeProfile, start: Start, rules: FitRules
) -> OutlineFits:
    """Fit a ball's outline in several frames.

    Parameters
    ----------
    cutouts : Cutouts
        The pixels around, one piece per frame.
    profile : EdgeProfile
        Edge profiles for about this radius.
    start : Start
        Where to begin, one row per frame.
    rules : FitRules
        How to fit.

    Returns
    -------
    OutlineFits
        Of all frames; `found` is false where too little of the outline is in view.
    """
    count = len(start.centre)
    fits = nothing_found(count)
    if count == 0:
        return fits
    usual = float(np.median(start.shape[:, 0]))
    ring = _ring_about(usual, rules.inner, rules.outer)
    outline = np.column_stack([start.centre, start.shape])
    held = np.zeros(rules.free)
    if rules.free > 2:
        held[2] = 1.0 / rules.radius_std**2
    size, shape = 5 if rules.shape_pull else 3, (count, len(ring.bounds) - 1)
    sums = _Sums(
        np.zeros((*shape, 5, 5)),
        np.zeros((*shape, 5)),
        np.zeros(shape),
        np.zeros(shape),
        np.zeros(shape),
    )
    pieces = _Pieces(cutouts.gray, cutouts.background, cutouts.inverse_noise, cutouts.corner)
    edge = _Edge(profile.tables, profile.steps, _priors(usual))
    narrow = rules.panels and rules.free == 2
    ending = _Ending(size, rules.iterations, rules.tolerance, narrow)

    def run(first: int) -> None:
        # Each writes rows of its own.
        last = min(first + _BATCH, count)
        fitted_outlines(
            pieces, ring, edge, held, start.smear, ending, first, last, outline, fits.found, sums
        )

    deque(map_in_threads(run, range(0, count, _BATCH)), maxlen=0)
    fits.centre[:], fits.radius[:] = outline[:, :2], outline[:, 2]
    if fits.found.any():
        _state(fits, sums, held, size)
    return fits


def _state(fits: OutlineFits, sums: _Sums, held: FloatArray, size: int) -> None:
    """Write what the fits say of themselves, where there is an outline."""
    rows, free = fits.found, len(held)
    every = sums.information[rows, :, :size, :size]
    weight, count = sums.weight[rows], sums.counted[rows]
    whole = np.einsum("ns,nsij->nij", weight, every)
    score = weight[:, :, None] * sums.score[rows, :, :size]
    seen = np.count_nonzero(count, axis=1)
    inverse = _inverses(whole[:, :free, :free], held)
    share = seen / np.maximum(seen - free, 1)
    meat = _clustered(score[:, :, :free]) * share[:, None, None]
    if free < 3 <= size:
        # a radius that is held is off itself, which an arc turns into an error of the centre
        lever = RADIUS_STD_PX * whole[:, :free, 2]
        meat += lever[:, :, None] * lever[:, None, :]
    spare = np.maximum(count.sum(axis=1) - _BASIS * seen, 1.0)
    rms_residual = np.sqrt(sums.square[rows].sum(axis=1) / spare)
    strength = every[:, :, 0, 0] + every[:, :, 1, 1]
    clear = strength > (_CLEAR_SIGMA * rms_residual[:, None]) ** 2
    fits.covariance[rows] = (inverse @ meat @ inverse)[:, :2, :2]
    fits.bound[rows] = _inverses(every[:, :, :free, :free].sum(axis=1), held)[:, :2, :2]
    fits.rms_residual[rows] = rms_residual
    fits.contrast[rows] = np.mean(clear, axis=1)
    fits.normal[rows, :size, :size] = whole
    fits.pull[rows, :size] = score.sum(axis=1)


def _inverses(matrices: FloatArray, held: FloatArray) -> FloatArray:
    """Inverses of normal matrices (F, m, m) with what is held added, kept regular."""
    trace = np.trace(matrices, axis1=1, axis2=2)[:, None, None]
    ridge = 1e-9 * (trace + 1e-9) * np.eye(len(held))
    return np.asarray(np.linalg.inv(matrices + np.diag(held) + ridge))


def _clustered(score: FloatArray) -> FloatArray:
    """Sum of the outer products of the sectors' scores (F, S, P), neighbours' cross terms with it.

    What a panel, a shadow or a highlight does to the outline it does over several sectors (Newey
    and West 1987, around the circle).
    """
    reach = score.shape[1] // _CLUSTERS
    meat = np.einsum("nsi,nsj->nij", score, score)
    for lag in range(1, reach + 1):
        cross = np.einsum("nsi,nsj->nij", score, np.roll(score, lag, axis=1))
        meat += (1.0 - lag / (reach + 1.0)) * (cross + np.swapaxes(cross, 1, 2))
    return np.asarray(meat)


def _ring_about(radius: float, inner: float, outer: float) -> _Ring:
    """The ring of an outline of a radius, reaching so far inside and outside of it, px."""
    reach = int(np.ceil(radius + outer + SLACK_PX))
    axis = np.arange(-reach, reach + 1)
    y, x = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    rho = np.hypot(x, y)
    near = (rho > max(radius - inner - SLACK_PX, 0.5)) & (rho < radius + outer + SLACK_PX)
    x, y = x[near], y[near]
    count = int(np.clip(round(2 * np.pi * radius / _SECTOR_PX), *_SECTORS))
    sector = np.floor((np.arctan2(y, x) / (2 * np.pi) + 0.5) * count).astype(np.int64) % count
    order = np.argsort(sector, kind="stable")
    return _Ring(
        np.stack([x[order], y[order]]),
        np.searchsorted(sector[order], np.arange(count + 1)),
        np.array([inner, outer]),
        reach,
    )


def _priors(radius: float) -> FloatArray:
    """Information on a sector's k, A and C: a small ball has too few pixels to free them."""
    small = min(1.0, radius / _SMALL_RADIUS)
    width = np.array([_SHADOW_PRIOR * small, _SHADING_PRIOR, _SHADING_PRIOR * small])
    return np.asarray(width**-2.0)


_VOTED_STD = 0.15

"""px, of a circle by votes, supposed: half of what rounding to pixels leaves, 1/√12."""

# How much a circle's radius scatters (natural logarithm).
_SWELLING = 0.15

"""Log radius: how much a circle's radius scatters by votes, supposed."""

_SMALLEST_WINDOW = 16

"""px: in a smaller window no ring of the smallest ball has its background."""


def voted_outlines(
    scene: FilmedScene, frame: IntArray, guess: FloatArray, radius: float
) -> OutlineFits:
    """Find the circle of edges nearest each guess.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    frame : (F,) int array
        Frame indices, increasing.
    guess : (F, 2) array
        Where it may be, px.
    radius : float
        Its radius, px.
    """
    fits = nothing_found(len(frame))
    windows = [_window(start, radius, scene.shape) for start in guess]
    for place, (index, gray) in enumerate(scene.windows(frame, windows)):
        if min(gray.shape) >= _SMALLEST_WINDOW:
            picture = gray.astype(np.float32)
            _vote(scene, index, picture, windows[place], guess[place], radius, fits, place)
    return fits


def _window(start: FloatArray, radius: float, shape: tuple[int, int]) -> Window:
    reach = int(np.ceil(2.5 * radius + 6))
    x, y = int(start[0]), int(start[1])
    return (
        slice(max(0, y - reach), max(0, min(shape[0], y + reach + 1))),
        slice(max(0, x - reach), max(0, min(shape[1], x + reach + 1))),
    )


def _vote(
    scene: FilmedScene,
    index: int,
    picture: FloatImage,
    window: Window,
    start: FloatArray,
    radius: float,
    fits: OutlineFits,
    place: int,
) -> None:
    circles = find_circles(
        picture,
        scene.expected(index, window),
        np.ascontiguousarray(scene.noise_in(index, window)),
        radii=(0.75 * radius, 1.3 * radius),
        most=8,
        least_coverage=0.5,
    )
    if len(circles) == 0:
        return
    centres = circles.centre_px + np.array([window[1].start, window[0].start])
    gap = np.hypot(*(centres - start).T)
    swollen = np.log(circles.radius_px / radius) / _SWELLING
    clear = circles.coverage * np.log1p(circles.sharpness)
    clear /= (1.0 + (gap / radius) ** 2) * (1.0 + swollen**2)
    best = int(np.argmax(clear))
    std = max(_VOTED_STD, 0.03 * radius) * max(1.0, 30.0 / float(circles.sharpness[best]))
    # A circle of another size is not the outline: its centre may be off by as much.
    std = float(np.hypot(std, circles.radius_px[best] - radius))
    fits.found[place] = True
    fits.centre[place] = centres[best]
    fits.radius[place] = circles.radius_px[best]
    fits.covariance[place] = std**2 * np.eye(2)
    fits.bound[place] = std**2 / 9.0 * np.eye(2)
    fits.rms_residual[place] = 1.0
    fits.contrast[place] = circles.coverage[best]
