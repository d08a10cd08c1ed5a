"""Round things among what moved: circles voted for by the edges that the static scene lacks.

Each edge pixel of the difference image votes for the centres that lie a radius away along its
gradient,
on both sides, since a panelled ball is brighter than the wall here and darker there. The vote is
taken at several picture scales, so that one short list of radii covers balls of 5 to 200 pixels.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Circles", "find_circles"]

FloatImage = NDArray[np.float32]
FloatArray = NDArray[np.float64]

# Radii at each scale, px of that scale; an octave, so that the scales join without a gap.
_RADII = np.array([2.6, 3.0, 3.5, 4.0, 4.6, 5.3])
_COARSE_RADII = np.array([3.5, 4.0, 4.6, 5.3, 6.1, 7.0])
_SECTORS = 16
_MOST_EDGES = 6000


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
    """

    centre_px: FloatArray
    radius_px: FloatArray
    coverage: FloatArray
    sharpness: FloatArray

    def __len__(self) -> int:
        return len(self.radius_px)


# Centre x, y, radius, coverage, sharpness.
_Circle = tuple[float, float, float, float, float]


@dataclass(frozen=True)
class _Edges:
    x: FloatArray
    y: FloatArray
    nx: FloatArray
    ny: FloatArray
    strength: FloatArray


def find_circles(
    picture: FloatImage,
    expected: FloatImage,
    noise: FloatImage,
    *,
    radii: tuple[float, float] | None = None,
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
    radii : tuple of float, optional
        Smallest and largest radius wanted, px; by default 2.5 px to a quarter of the picture
        height.
    most : int
        How many candidates to return at most.
    least_coverage : float
        Part of the outline that must have an edge.

    Returns
    -------
    Circles
    """
    difference = picture - expected
    low, high = radii if radii is not None else (2.5, 0.25 * min(difference.shape))
    found: list[_Circle] = []
    scale = 1
    normalised = difference / noise
    while True:
        table = _RADII if scale == 1 else _COARSE_RADII
        wanted = table[(table * scale >= 0.8 * low) & (table * scale <= 1.25 * high)]
        if len(wanted):
            level = _shrunk(normalised, scale)
            edges = _edges(level, 6.0)
            if len(edges.x) >= 8:
                found += _voted(edges, level.shape, wanted, scale, most, least_coverage)
        scale *= 2
        if _COARSE_RADII[0] * scale > high or min(difference.shape) // scale < 16:
            break
    if radii is None:
        found += _blobs(normalised, low, high)
    found = sorted(found, key=_rank)[: 3 * most]
    weighed = [
        (*circle[:4], circle[4] * _substance(circle, picture, expected, noise)) for circle in found
    ]
    return _distinct(weighed, most)


def _blobs(normalised: FloatImage, low: float, high: float) -> list[_Circle]:
    """Compact things whose outline is too blurred or too ragged for a circle of edges."""
    height, width = normalised.shape
    scale = 2 if min(height, width) >= 240 else 1
    level = _shrunk(normalised, scale)
    above = (np.abs(level) > 5.0 / scale).astype(np.uint8)
    mask = cv2.morphologyEx(above, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels, boxes, centres = cv2.connectedComponentsWithStats(mask)
    found = []
    for label in range(1, count):
        left, top, wide, tall, area = (int(value) for value in boxes[label])
        radius = float(np.sqrt(area / np.pi))
        if not low <= radius * scale <= high or max(wide, tall) > 3.5 * radius:
            continue
        x, y = centres[label]
        rows, columns = np.nonzero(labels[top : top + tall, left : left + wide] == label)
        reach = np.hypot(columns + left - x, rows + top - y)
        round_part = float(np.mean(reach <= 1.1 * radius))
        if round_part < 0.8:
            continue
        strength = float(np.median(np.abs(level[rows + top, columns + left])))
        half = 0.5 * (scale - 1)
        found.append(
            (x * scale + half, y * scale + half, radius * scale, 0.7 * round_part, strength)
        )
    return found


def _substance(
    circle: _Circle, picture: FloatImage, expected: FloatImage, noise: FloatImage
) -> float:
    """1 for a thing, less for a shadow, which only dims what lies under it evenly."""
    x, y, radius = circle[:3]
    reach = 0.7 * radius
    height, width = picture.shape
    rows = slice(max(0, int(y - reach)), min(height, int(y + reach) + 2))
    columns = slice(max(0, int(x - reach)), min(width, int(x + reach) + 2))
    row, column = np.mgrid[rows, columns]
    inside = np.hypot(column - x, row - y) <= reach
    if np.count_nonzero(inside) < 5:
        return 1.0
    seen, scene = picture[rows, columns][inside], expected[rows, columns][inside]
    ratio = float(np.median(seen / np.maximum(scene, 1.0)))
    if ratio > 0.97:
        return 1.0
    left_over = 1.4826 * float(np.median(np.abs(seen - ratio * scene)))
    even = float(np.hypot(np.median(noise[rows, columns]), 0.02 * np.median(seen)))
    return float(np.clip((left_over / (3.0 * even)) ** 2, 0.15, 1.0))


def _shrunk(image: FloatImage, scale: int) -> FloatImage:
    if scale == 1:
        return image
    size = (image.shape[1] // scale, image.shape[0] // scale)
    trimmed = image[: size[1] * scale, : size[0] * scale]
    return np.asarray(cv2.resize(trimmed, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _edges(level: FloatImage, threshold: float) -> _Edges:
    """Edge pixels, thinned along their gradient; unit noise gives unit steepness."""
    smooth = cv2.GaussianBlur(level, (0, 0), 0.8)
    gx = cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=0.1)
    gy = cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=0.1)
    steepness = cv2.magnitude(gx, gy)
    steepness[:1], steepness[-1:], steepness[:, :1], steepness[:, -1:] = 0, 0, 0, 0
    rows, columns = np.nonzero(steepness > threshold)
    if len(rows) > 4 * _MOST_EDGES:
        values = steepness[rows, columns]
        keep = np.argpartition(values, -4 * _MOST_EDGES)[-4 * _MOST_EDGES :]
        rows, columns = rows[keep], columns[keep]
    strength = steepness[rows, columns]
    nx, ny = gx[rows, columns] / strength, gy[rows, columns] / strength
    step_x, step_y = np.rint(nx).astype(int), np.rint(ny).astype(int)
    crest = (strength >= steepness[rows + step_y, columns + step_x]) & (
        strength > steepness[rows - step_y, columns - step_x]
    )
    rows, columns, nx, ny, strength = (part[crest] for part in (rows, columns, nx, ny, strength))
    ahead = steepness[rows + step_y[crest], columns + step_x[crest]]
    behind = steepness[rows - step_y[crest], columns - step_x[crest]]
    offset = 0.5 * (ahead - behind) / np.maximum(2 * strength - ahead - behind, 1e-6)
    length = np.hypot(step_x[crest], step_y[crest])
    offset = np.clip(offset, -0.5, 0.5) * length
    return _Edges(
        (columns + offset * nx).astype(np.float64),
        (rows + offset * ny).astype(np.float64),
        nx.astype(np.float64),
        ny.astype(np.float64),
        strength.astype(np.float64),
    )


def _voted(
    edges: _Edges,
    shape: tuple[int, ...],
    radii: FloatArray,
    scale: int,
    most: int,
    least_coverage: float,
) -> list[_Circle]:
    height, width = shape
    margin = int(np.ceil(radii.max()))
    rows, columns = height + 2 * margin, width + 2 * margin
    sign = np.array([-1.0, 1.0])[:, None, None]
    reach = radii[None, :, None] * sign
    x = np.rint(edges.x + reach * edges.nx).astype(np.int64) + margin
    y = np.rint(edges.y + reach * edges.ny).astype(np.int64) + margin
    layer = np.broadcast_to(np.arange(len(radii))[None, :, None], x.shape)
    inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
    flat = (layer * rows + y) * columns + x
    votes = np.bincount(flat[inside], minlength=len(radii) * rows * columns).astype(np.float32)
    votes = votes.reshape(len(radii), rows, columns)
    found = []
    support = np.stack(
        [
            cv2.boxFilter(layer_votes, -1, (3, 3), normalize=False) / np.float32(2 * np.pi * radius)
            for layer_votes, radius in zip(votes, radii, strict=True)
        ]
    )
    best = support.max(axis=0)
    crest = (best > 0.3) & (best == cv2.dilate(best, np.ones((3, 3), np.uint8)))
    peak_rows, peak_columns = np.nonzero(crest)
    order = np.argsort(-best[peak_rows, peak_columns])[:most]
    peak_rows, peak_columns = peak_rows[order], peak_columns[order]
    peak_radii = radii[support[:, peak_rows, peak_columns].argmax(axis=0)]
    for row, column, radius in zip(peak_rows, peak_columns, peak_radii, strict=True):
        refined = _refined(edges, float(column - margin), float(row - margin), float(radius))
        if refined is not None and refined[3] >= least_coverage:
            half = 0.5 * (scale - 1)
            found.append(
                (
                    refined[0] * scale + half,
                    refined[1] * scale + half,
                    refined[2] * scale,
                    refined[3],
                    refined[4],
                )
            )
    return found


def _refined(edges: _Edges, x0: float, y0: float, radius: float) -> _Circle | None:
    """Fit the circle to its edge points, nearer ones only; say how much of it they cover."""
    around = (np.abs(edges.x - x0) < 1.6 * radius + 2) & (np.abs(edges.y - y0) < 1.6 * radius + 2)
    edges = _Edges(
        edges.x[around], edges.y[around], edges.nx[around], edges.ny[around], edges.strength[around]
    )
    for _ in range(3):
        dx, dy = edges.x - x0, edges.y - y0
        rho = np.hypot(dx, dy)
        tolerance = max(1.0, 0.15 * radius)
        near = np.abs(rho - radius) < tolerance
        if np.count_nonzero(near) < 6:
            return None
        ux, uy = dx[near] / np.maximum(rho[near], 1e-6), dy[near] / np.maximum(rho[near], 1e-6)
        radial = np.abs(ux * edges.nx[near] + uy * edges.ny[near])
        good = radial > 0.85
        if np.count_nonzero(good) < 6:
            return None
        ux, uy, gap = ux[good], uy[good], rho[near][good] - radius
        strength = edges.strength[near][good]
        weight = np.exp(-0.5 * (gap / (0.5 * tolerance)) ** 2)
        design = np.stack([ux, uy, np.ones_like(ux)], axis=1)
        weighted = design * weight[:, None]
        step = np.linalg.solve(weighted.T @ design + 1e-3 * np.eye(3), weighted.T @ gap)
        x0, y0, radius = x0 + step[0], y0 + step[1], radius + step[2]
        if radius < 1.5:
            return None
    close = weight > 0.3
    sector = ((np.arctan2(uy, ux) / (2 * np.pi) + 0.5) * _SECTORS).astype(int) % _SECTORS
    best = np.zeros(_SECTORS)
    np.maximum.at(best, sector[close], strength[close])
    return x0, y0, radius, float(np.mean(best > 0)), float(np.mean(np.minimum(best, 200.0)))


def _distinct(found: list[_Circle], most: int) -> Circles:
    """Keep the best of those that describe the same circle."""
    ranked = sorted(found, key=lambda circle: -circle[3] * np.log1p(circle[4]) * np.sqrt(circle[2]))
    outer = [circle for circle in ranked if circle[3] >= 0.7]
    ranked = [circle for circle in ranked if not any(_panel(circle, other) for other in outer)]
    kept: list[_Circle] = []
    for circle in ranked:
        if not any(_same(circle, other) for other in kept):
            kept.append(circle)
        if len(kept) == most:
            break
    table = np.array(kept, dtype=np.float64).reshape(-1, 5)
    return Circles(table[:, :2], table[:, 2], table[:, 3], table[:, 4])


def _rank(circle: _Circle) -> float:
    return -circle[3] * math.log1p(circle[4]) * math.sqrt(circle[2])


def _same(circle: _Circle, other: _Circle) -> bool:
    gap = np.hypot(circle[0] - other[0], circle[1] - other[1])
    return bool(gap < 0.5 * max(circle[2], other[2]) and 0.6 < circle[2] / other[2] < 1.6)


def _panel(circle: _Circle, other: _Circle) -> bool:
    """Whether `circle` is only a panel or a highlight on the ball `other`."""
    gap = np.hypot(circle[0] - other[0], circle[1] - other[1])
    inside = gap + circle[2] < 1.1 * other[2] and circle[2] < 0.75 * other[2]
    return bool(inside and other[4] > 0.3 * circle[4])
