"""Convex bodies with flat faces: boxes and prisms, their outline, and the shadow behind them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sample_videos.renderer.coverage import PixelGrid, edge_coverage

__all__ = ["Solid", "box", "face_coverage", "outline", "outline_coverage", "prism", "shade_behind"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex body that is its own mirror image through its middle.

    Attributes
    ----------
    vertices : (N, 3) array
        m, in whatever frame the user says.
    faces : tuple of tuples of int
        Vertices of each face, counter-clockwise seen from outside.
    colour : (3,) tuple
        Reflectance.
    """

    vertices: FloatArray
    faces: tuple[tuple[int, ...], ...]
    colour: tuple[float, float, float]

    def moved(self, rotation: FloatArray, shift: FloatArray) -> FloatArray:
        """Vertices rotated and shifted, (..., N, 3) for rotations (..., 3, 3), shifts (..., 3)."""
        turned = self.vertices @ np.swapaxes(rotation, -1, -2)
        return np.asarray(turned + shift[..., np.newaxis, :])


def prism(ring: ArrayLike, axis: ArrayLike, colour: tuple[float, float, float]) -> Solid:
    """Prism on an even, point-symmetric ring (M, 3), counter-clockwise seen against `axis` (3,)."""
    ring = np.asarray(ring, dtype=np.float64)
    count = len(ring)
    vertices = np.concatenate([ring, ring + np.asarray(axis, dtype=np.float64)])
    sides = tuple((i, (i + 1) % count, (i + 1) % count + count, i + count) for i in range(count))
    caps = (tuple(reversed(range(count))), tuple(range(count, 2 * count)))
    return Solid(vertices, sides + caps, colour)


def box(centre: ArrayLike, size: ArrayLike, colour: tuple[float, float, float]) -> Solid:
    """Box along the axes."""
    half = 0.5 * np.asarray(size, dtype=np.float64)
    ring = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]]) * half
    return prism(ring + np.asarray(centre), [0.0, 0.0, 2.0 * half[2]], colour)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Vector product along the last axis; `numpy.cross` is ten times slower on small arrays."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    p, q, r = b[..., 0], b[..., 1], b[..., 2]
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = y * r - z * q
    product[..., 1] = z * p - x * r
    product[..., 2] = x * q - y * p
    return product


def outline(vertices: FloatArray, solid: Solid, eye: FloatArray) -> list[tuple[int, int]]:
    """Edges between what `eye` (3,) sees and what it does not, in order around the outline."""
    seen = [face for face in solid.faces if _facing(vertices, face, eye)]
    edges = {(a, b) for face in seen for a, b in zip(face, face[1:] + face[:1], strict=True)}
    rim = {a: b for a, b in edges if (b, a) not in edges}
    if not rim:
        return []
    start = next(iter(rim))
    path = [(start, rim[start])]
    while path[-1][1] != start and len(path) <= len(rim):
        path.append((path[-1][1], rim[path[-1][1]]))
    return path


def _facing(vertices: FloatArray, face: tuple[int, ...], eye: FloatArray) -> bool:
    a, b, c = (vertices[i] for i in face[:3])
    return bool(np.dot(cross(b - a, c - b), eye - a) > 0.0)


def _paired(sides: list[FloatArray]) -> FloatArray:
    """Coverage from that of the sides: opposite sides cut a strip, strips intersect."""
    half = len(sides) // 2
    strips = [np.maximum(sides[i] + sides[i + half] - 1.0, 0.0) for i in range(half)]
    if half <= 3:
        return np.asarray(np.prod(np.stack(strips), axis=0))
    return np.asarray(np.min(np.stack(strips), axis=0))


def outline_coverage(
    vertices: FloatArray, edges: list[tuple[int, int]], grid: PixelGrid
) -> FloatArray:
    """Coverage of pixels by a solid with `vertices` (..., N, 3) in the camera's frame."""
    return _paired([edge_coverage(_edge_normal(vertices, a, b), grid) for a, b in edges])


def _edge_normal(vertices: FloatArray, a: int, b: int) -> FloatArray:
    # counter-clockwise from outside, with the eye at the origin: the inside is on the left
    return np.asarray(cross(vertices[..., b, :], vertices[..., a, :]))


def face_coverage(vertices: FloatArray, face: tuple[int, ...], grid: PixelGrid) -> FloatArray:
    """Coverage of pixels by one face; zero where it is turned away."""
    middle = vertices.reshape(-1, *vertices.shape[-2:])[
        len(vertices.reshape(-1, *vertices.shape[-2:])) // 2
    ]
    if not _facing(middle, face, np.zeros(3)):
        return np.zeros(grid.xy.shape[1:])
    pairs = zip(face, face[1:] + face[:1], strict=True)
    return _paired([edge_coverage(_edge_normal(vertices, a, b), grid) for a, b in pairs])


def shade_behind(
    points: FloatArray,
    vertices: FloatArray,
    solid: Solid,
    lamp: FloatArray,
    lamp_radius: float,
) -> FloatArray:
    """Share of a lamp's light that a solid takes from points behind it.

    Parameters
    ----------
    points : (3, ...) array
        World, m.
    vertices : (N, 3) array
        Of the solid, world, m.
    lamp : (3,) array
    lamp_radius : float

    Returns
    -------
    (...) array
        0 in full light, 1 in the umbra.
    """
    edges = outline(vertices, solid, lamp)
    if not edges:
        return np.zeros(points.shape[1:])
    middle = vertices.mean(axis=0)
    reach = float(np.linalg.norm(middle - lamp))
    towards = (middle - lamp) / reach
    beyond = np.tensordot(towards, points - _column(lamp, points), axes=1) - reach
    width = np.maximum(lamp_radius * beyond / reach, 1e-4)
    sides = []
    for a, b in edges:
        normal = cross(vertices[b] - lamp, vertices[a] - lamp)
        normal /= np.linalg.norm(normal)
        offset = float(normal @ lamp)
        u = np.clip((np.tensordot(normal, points, axes=1) - offset) / width, -1.0, 1.0)
        sides.append(0.5 + u * (0.75 - 0.25 * u * u))
    return np.asarray(np.where(beyond > 0.0, _paired(sides), 0.0))


def _column(vector: FloatArray, like: FloatArray) -> FloatArray:
    return vector.reshape((3,) + (1,) * (like.ndim - 1))
