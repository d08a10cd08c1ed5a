"""Round things among what moved: circles voted for by the edges that the static scene lacks.

Each edge pixel of the difference image votes for the centres that lie a radius away along its
gradient, on both sides, since a panelled ball is brighter than the wall here and darker there. The
vote is taken at several picture scales, so that one short list of radii covers 5 to 200 pixels.

Circles beside one another: the same one, a panel of a larger one, the softness about one.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled
from vision.ball.edges import EdgePoints, edge_points, places

__all__ = ["Circles", "distinct", "find_circles", "fit_to_edges", "ordinate_bounds", "rows_within"]

FloatImage = NDArray[np.float32]

# Centre x, y, radius, coverage, sharpness.
Circle = tuple[float, float, float, float, float]


def rank(circle: Circle) -> float:
    """How clear and large a circle is, the clearest lowest."""
    return -circle[3] * math.log1p(circle[4]) * math.sqrt(circle[2])


def panel_of(circle: Circle, other: Circle) -> bool:
    """Whether `circle` is only a panel or a highlight on the ball `other`."""
    gap = math.hypot(circle[0] - other[0], circle[1] - other[1])
    inside = gap + circle[2] < 1.1 * other[2] and circle[2] < 0.75 * other[2]
    return bool(inside and other[4] > 0.3 * circle[4])


def middle(values: NDArray[np.floating]) -> float:
    """Upper median of a few values, without the ceremony that makes `numpy.median` slow on them."""
    half = len(values) // 2
    return float(np.partition(values, half)[half])


FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]

# Radii at each scale, px of that scale; an octave, so that the scales join without a gap.
_RADII = np.array([2.6, 3.0, 3.5, 4.0, 4.6, 5.3])

_COARSE_RADII = np.array([3.5, 4.0, 4.6, 5.3, 6.1, 7.0])
"""px, radii on halved pictures: each 15 % above the last, as far as a circle of the next still has
its edges within its ring."""

_SECTORS = 16
"""Sectors of a rim, supposed: an edge in each shows a whole circle."""

_FEWEST_EDGES = 8
"""Edge points: a circle has three unknowns, more than half are to spare."""

# A level of fewer pixels than this is searched whole.
_SMALL_LEVEL = 20_000

# Mean change of a cell of a few pixels, in units of a pixel's noise, that may belong to an edge of
# 6 units: far above that mean's own noise.
_STIRRED = 1.5

_SUBSTANCE_RADIUS = 10.0
"""px: inside larger circles every second pixel, or third, tells as much."""

_PRESENCE_POINTS = 48
"""Points of a rim: one each 7.5°."""
_RIM = tuple(
    turned(np.linspace(0.0, 2.0 * np.pi, _PRESENCE_POINTS, endpoint=False))
    for turned in (np.cos, np.sin)
)
"""Where they lie, for a rim of radius 1."""

_CIRCLE_STEPS, _RING = 3, 0.15
"""Steps of a circle's fit, supposed: the third hardly moves it; and radii on either side of it in
which edges belong to it, at least 1 px."""

_ALONG, _FEWEST_NEAR = 0.85, 6
"""Cosine between an edge's slope and the radius, at least: 32°; and edges, twice a circle's three
unknowns."""

_FLAT, _LEAST_FITTED = 1e-3, 1.5
"""Edges' worth that holds a circle where they do not tell a direction; and px of radius."""

_NEAR_RIM, _STEEPEST = 0.3, 200.0
"""Weight from which an edge covers its sector; and units of noise beyond which an edge is no
clearer: a black ball before white."""

_SQUARE_WITHIN = math.sqrt(0.5)
"""Radii: half the side of the square within a circle."""


@dataclass(frozen=True)
class Circles:
    """Circle candidates of one frame, best first.

    Attributes
    ----------
    centre_px : (N, 2) array
        Centres, px.
    radius_px : (N,) array
        Radii, px.
    coverage : (N,) array
        Part of the outline with an edge along it, 0 to 1.
    sharpness : (N,) array
        Mean edge steepness along the outline, in units of what the picture noise alone gives.
    presence : (N,) array
        Part of the outline's edge that is in the picture rather than in the static scene: a ghost,
        where something was or will be, has next to none, 0 to 1.
    level : (N,) array
        Mean gray level inside, 0 to 255.
    """

    centre_px: FloatArray
    radius_px: FloatArray
    coverage: FloatArray
    sharpness: FloatArray
    presence: FloatArray
    level: FloatArray

    def __len__(self) -> int:
        return len(self.radius_px)


def find_circles(
    picture: FloatImage,
    expected: FloatImage,
    noise: FloatImage,
    *,
    radii: tuple[float, float],
    most: int = 8,
    least_coverage: float = 0.55,
) -> Circles:
    """Find round things that stand before the static scene.

    Parameters
    ----------
    picture : (H, W) float32 array
        A frame, gray levels.
    expected : (H, W) float32 array
        The static scene in its brightness.
    noise : (H, W) float32 array
        Standard deviation of a pixel of their difference, gray levels.
    radii : tuple of float
        Smallest and largest radius wanted, px.
    most : int
        How many candidates to return at most.
    least_coverage : float
        Part of the outline that must have an edge.
    """
    low, high = radii
    normalised = (picture - expected) / noise
    found: list[Circle] = []
    for scale, wanted in _scales(low, high, min(picture.shape)):
        circles = _searched(_shrunk(normalised, scale), scale, wanted, most)
        found += [_enlarged(circle, scale) for circle in circles if circle[3] >= least_coverage]
    found = [circle for circle in found if 0.95 * low < circle[2] < 1.05 * high]
    found = sorted(found, key=rank)[: 3 * most]
    weighed = [
        (*circle[:4], circle[4] * _substance(circle, picture, expected, noise)) for circle in found
    ]
    return _distinct(weighed, most, picture, expected)


def _searched(level: FloatImage, scale: int, radii: FloatArray, most: int) -> list[Circle]:
    """Circles of one scale, px of that scale."""
    voted = [
        (edges, peaks)
        for left, top, window in _windows(level, scale, float(radii.max()))
        if len((edges := edge_points(window, left, top)).x) >= _FEWEST_EDGES
        and len(peaks := _peaks(edges, left, top, window.shape, radii, most))
    ]
    # Of each scale only the best go on, wherever they lie.
    support = np.concatenate([peaks[:, 3] for _, peaks in voted] or [np.zeros(0)])
    least = float(np.sort(support)[-most]) if len(support) > most else 0.0
    found: list[Circle] = []
    for edges, peaks in voted:
        found += map(tuple, fit_to_edges(edges, peaks[peaks[:, 3] >= least, :3]).tolist())
    return found


def _scales(low: float, high: float, size: int) -> Iterator[tuple[int, FloatArray]]:
    """Scales at which to look, and the radii to look for at each, px of that scale."""
    scale = 1
    while True:
        table = _RADII if scale == 1 else _COARSE_RADII
        wanted = table[(table * scale >= 0.8 * low) & (table * scale <= 1.25 * high)]
        if len(wanted):
            yield scale, wanted
        scale *= 2
        if _COARSE_RADII[0] * scale > high or size // scale < 16:
            return


def _windows(
    level: FloatImage, scale: int, largest: float
) -> Iterator[tuple[int, int, FloatImage]]:
    """The parts of a level in which something moved, with a margin of the largest radius.

    Coarse levels are small and taken whole.
    """
    if level.size < _SMALL_LEVEL:
        yield 0, 0, level
        return
    cell = 4 if scale == 1 else 2
    coarse = np.abs(_shrunk(level, cell))
    # A codec's errors run over many pixels: their own spread tells what is stirred.
    usual = 7.5 * middle(coarse[::2, ::2].ravel())
    stirred = coarse > min(max(usual, _STIRRED), 2.0 * _STIRRED)
    reach = int(np.ceil(largest / cell)) + 1
    grown = cv2.dilate(stirred.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8))
    count, _, boxes, _ = cv2.connectedComponentsWithStats(grown)
    height, width = level.shape
    for label in range(1, count):
        left, top, wide, tall = (int(value) * cell for value in boxes[label, :4])
        # Cells at the far edges stand for the pixels beyond the last whole cell too.
        right = width if left + wide > width - 2 * cell else left + wide
        bottom = height if top + tall > height - 2 * cell else top + tall
        yield left, top, level[top:bottom, left:right]


def _enlarged(circle: Circle, scale: int) -> Circle:
    """A circle of a level in px of the picture."""
    half = 0.5 * (scale - 1)
    x, y, radius, coverage, sharpness = circle
    return x * scale + half, y * scale + half, radius * scale, coverage, sharpness


def _substance(
    circle: Circle, picture: FloatImage, expected: FloatImage, noise: FloatImage
) -> float:
    """1 for a thing, less for a shadow, which only dims what lies under it evenly."""
    x, y, radius = circle[:3]
    reach = 0.7 * radius
    height, width = picture.shape
    step = 1 + int(reach / _SUBSTANCE_RADIUS)
    top, bottom = max(0, int(y - reach)), min(height, int(y + reach) + 2)
    left, right = max(0, int(x - reach)), min(width, int(x + reach) + 2)
    rows, columns = slice(top, bottom, step), slice(left, right, step)
    # a third of what `numpy.ogrid` takes, which is asked for each circle
    row, column = np.arange(top, bottom, step)[:, np.newaxis], np.arange(left, right, step)
    inside = (column - x) ** 2 + (row - y) ** 2 <= reach * reach
    if np.count_nonzero(inside) < 5:
        return 1.0
    seen, scene = picture[rows, columns][inside], expected[rows, columns][inside]
    ratio = middle(seen / np.maximum(scene, np.float32(1.0)))
    if ratio > 0.97:
        return 1.0
    left_over = 1.4826 * middle(np.abs(seen - np.float32(ratio) * scene))
    even = math.hypot(middle(noise[rows, columns].ravel()), 0.02 * middle(seen))
    return min(max((left_over / (3.0 * even)) ** 2, 0.15), 1.0)


def _shrunk(image: FloatImage, scale: int) -> FloatImage:
    if scale == 1:
        return image
    size = (image.shape[1] // scale, image.shape[0] // scale)
    trimmed = image[: size[1] * scale, : size[0] * scale]
    return np.asarray(cv2.resize(trimmed, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _peaks(
    edges: EdgePoints, left: int, top: int, shape: tuple[int, ...], radii: FloatArray, most: int
) -> FloatArray:
    """Centres (x, y), radius and support of the circles that most edges of a window vote for."""
    margin = int(np.ceil(radii.max())) + 1
    layers = np.zeros((len(radii), shape[0] + 2 * margin, shape[1] + 2 * margin), dtype=np.float32)
    _vote(edges.x, edges.y, edges.nx, edges.ny, radii, margin - left, margin - top, layers)
    layers *= (1.0 / (2 * np.pi * radii)).astype(np.float32)[:, np.newaxis, np.newaxis]
    best = layers.max(axis=0)
    crest = (best > 0.3) & (best == cv2.dilate(best, np.ones((3, 3), np.uint8)))
    y, x = places(crest)
    order = np.argsort(-best[y, x])[:most]
    y, x = y[order], x[order]
    radius = radii[np.argmax(layers[:, y, x], axis=0)]
    return np.column_stack([x - margin + left, y - margin + top, radius, best[y, x]])


@compiled
def _vote(
    x: FloatImage,
    y: FloatImage,
    nx: FloatImage,
    ny: FloatImage,
    radii: FloatArray,
    right: int,
    down: int,
    votes: FloatImage,
) -> None:
    """Count for each radius where edges point, on both sides, in the pixels around it, too.

    The votes (k, H, W) are shifted.
    """
    for layer in range(len(radii)):
        for k in range(len(x)):
            for side in range(-1, 2, 2):
                reach = np.float32(radii[layer] * side)
                column = int(np.rint(x[k] + reach * nx[k])) + right
                row = int(np.rint(y[k] + reach * ny[k])) + down
                # edges lie inside the picture: no vote leaves the margin
                for beside in range(row - 1, row + 2):
                    for along in range(column - 1, column + 2):
                        votes[layer, beside, along] += np.float32(1.0)


def fit_to_edges(edges: EdgePoints, start: FloatArray) -> FloatArray:
    """Fit circles (x, y, radius) to the edges near them; add coverage and sharpness (n, 5)."""
    found = np.column_stack([start, np.zeros((len(start), 2))])
    alive = np.empty(len(start), dtype=np.bool_)
    _fit_circles(edges.x, edges.y, edges.nx, edges.ny, edges.strength, found, alive)
    return found[alive]


def distinct(circles: FloatArray) -> NDArray[np.bool_]:
    """Which of some circles (n, 3 or more) describe nothing that an earlier one does (n,)."""
    first = np.ones(len(circles), dtype=np.bool_)
    _write_first(np.ascontiguousarray(circles), first)
    return first


@compiled
def _write_first(circles: FloatArray, first: NDArray[np.bool_]) -> None:
    for place in range(len(circles)):
        for other in range(place):
            if not first[other]:
                continue
            x, y = circles[place, 0] - circles[other, 0], circles[place, 1] - circles[other, 1]
            larger = max(circles[place, 2], circles[other, 2])
            ratio = circles[place, 2] / circles[other, 2]
            if x * x + y * y < 0.25 * larger * larger and 0.6 < ratio < 1.6:
                first[place] = False
                break


@compiled
def _fit_circles(
    x: FloatImage,
    y: FloatImage,
    nx: FloatImage,
    ny: FloatImage,
    strength: FloatImage,
    circles: FloatArray,
    alive: NDArray[np.bool_],
) -> None:
    bounds = ordinate_bounds(y)
    for place in range(len(circles)):
        alive[place] = _fit_circle(x, y, nx, ny, strength, bounds, circles[place])


@compiled
def ordinate_bounds(y: FloatImage) -> FloatImage:
    """Largest ordinate of each point and those before it, least of it and those after (2, n)."""
    count = len(y)
    bounds = np.empty((2, count), dtype=np.float32)
    highest, least = y[0], y[count - 1]
    for k in range(count):
        highest, least = max(highest, y[k]), min(least, y[count - 1 - k])
        bounds[0, k], bounds[1, count - 1 - k] = highest, least
    return bounds


@compiled
def rows_within(bounds: FloatImage, low: float, high: float) -> tuple[int, int]:
    """The first of the points that may have ordinates in a range, and the one after the last.

    They are few where points are in the order of a picture's rows.
    """
    first = np.searchsorted(bounds[0], low)
    return int(first), int(np.searchsorted(bounds[1], high, side="right"))


@compiled
def _fit_circle(
    x: FloatImage,
    y: FloatImage,
    nx: FloatImage,
    ny: FloatImage,
    strength: FloatImage,
    bounds: FloatImage,
    circle: FloatArray,
) -> bool:
    """Move a circle (x, y, radius, …) to the edges near it by least squares; whether it stands.

    Its coverage and sharpness are written behind the three.
    """
    best = np.zeros(_SECTORS)
    for step in range(_CIRCLE_STEPS):
        tolerance = max(1.0, _RING * circle[2])
        last, near = step == _CIRCLE_STEPS - 1, 0
        a, b, c, d, e, f = _FLAT, 0.0, 0.0, _FLAT, 0.0, _FLAT
        p, q, r = 0.0, 0.0, 0.0
        least, most = circle[2] - tolerance, circle[2] + tolerance
        first, stop = rows_within(bounds, circle[1] - most, circle[1] + most)
        for k in range(first, stop):
            dx, dy = x[k] - circle[0], y[k] - circle[1]
            square = dx * dx + dy * dy
            if square >= most * most or square <= least * least:
                continue
            rho = math.sqrt(square)
            gap = rho - circle[2]
            ux, uy = dx / rho, dy / rho
            if abs(ux * nx[k] + uy * ny[k]) <= _ALONG:
                continue
            near += 1
            off = gap / tolerance
            weight = math.exp(-2.0 * off * off)
            a, b, c = a + weight * ux * ux, b + weight * ux * uy, c + weight * ux
            d, e, f = d + weight * uy * uy, e + weight * uy, f + weight
            p, q, r = p + weight * ux * gap, q + weight * uy * gap, r + weight * gap
            if last and weight > _NEAR_RIM:
                sector = int((math.atan2(uy, ux) / (2 * math.pi) + 0.5) * _SECTORS) % _SECTORS
                best[sector] = max(best[sector], strength[k])
        if near < _FEWEST_NEAR:
            return False
        # by Cramer's rule
        one, two, three = d * f - e * e, c * e - b * f, b * e - c * d
        whole = a * one + b * two + c * three
        four, five, six = a * f - c * c, b * c - a * e, a * d - b * b
        circle[0] += (one * p + two * q + three * r) / whole
        circle[1] += (two * p + four * q + five * r) / whole
        circle[2] += (three * p + five * q + six * r) / whole
        if circle[2] < _LEAST_FITTED:
            return False
    covered, steep = 0, 0.0
    for k in range(_SECTORS):
        if best[k] > 0.0:
            covered += 1
        steep += min(best[k], _STEEPEST)
    circle[3], circle[4] = covered / _SECTORS, steep / _SECTORS
    return True


def _presence(circle: Circle, picture: FloatImage, expected: FloatImage) -> float:
    """Which of the two an outline's edge belongs to: 1 the picture, 0 the static scene."""
    x, y, radius = circle[:3]
    reach = max(1.0, 0.12 * radius)
    rho = np.array([[radius - reach], [radius + reach]])
    columns = np.rint(x + rho * _RIM[0]).astype(np.int64)
    rows = np.rint(y + rho * _RIM[1]).astype(np.int64)
    inside = (columns >= 0) & (rows >= 0)
    inside &= (columns < picture.shape[1]) & (rows < picture.shape[0])
    seen = np.all(inside, axis=0)
    if np.count_nonzero(seen) < _FEWEST_EDGES:
        return 1.0
    rows, columns = rows[:, seen], columns[:, seen]
    now = np.abs(np.diff(picture[rows, columns], axis=0))
    always = np.abs(np.diff(expected[rows, columns], axis=0))
    return float(np.sum(now) / max(float(np.sum(now) + np.sum(always)), 1e-6))


def _distinct(found: list[Circle], most: int, picture: FloatImage, expected: FloatImage) -> Circles:
    """Keep the best of those that describe the same circle."""
    ranked = sorted(found, key=rank)
    outer = [circle for circle in ranked if circle[3] >= 0.7]
    ranked = [circle for circle in ranked if not any(panel_of(circle, other) for other in outer)]
    table = np.array(ranked, dtype=np.float64).reshape(-1, 5)
    table = table[distinct(table)][:most]
    kept = [(row[0], row[1], row[2], row[3], row[4]) for row in table.tolist()]
    presence = np.array([_presence(circle, picture, expected) for circle in kept])
    level = np.array([_level(circle, picture) for circle in kept])
    return Circles(table[:, :2], table[:, 2], table[:, 3], table[:, 4], presence, level)


def _level(circle: Circle, picture: FloatImage) -> float:
    """Mean gray level of the square within a circle: what tells a dark thing from a bright one."""
    x, y, radius = circle[:3]
    reach = _SQUARE_WITHIN * radius
    rows = slice(max(0, int(y - reach)), max(0, int(y + reach)) + 1)
    columns = slice(max(0, int(x - reach)), max(0, int(x + reach)) + 1)
    inside = picture[rows, columns]
    return float(inside.mean()) if inside.size else 0.0
