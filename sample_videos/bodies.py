"""Solids of a scene: outlines, pixel coverage and shadows.

Everything is seen from the camera's centre. A pixel looks along (x, y, 1) in the camera's frame,
with x and y free of distortion: straight edges stay straight and a sphere is bounded by a cone.
Coverage is exact for straight edges, and accurate to 1e-3 for round ones.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.camera import Lens
from metrology import Defaults
from physics.contact import ContactScene
from sample_videos.scene import Scene, SwingingScale

__all__ = [
    "PixelGrid",
    "Solid",
    "Window",
    "bob_centre",
    "box",
    "face_coverage",
    "outline",
    "outline_coverage",
    "pendulum_solids",
    "pivot",
    "pixel_coverage",
    "quadric_coverage",
    "rest_centre",
    "scale_pose",
    "scale_solids",
    "shade_behind",
    "standing_solids",
    "swing_rotation",
]

FloatArray = NDArray[np.float64]

MIN_EDGE_SLOPE = 1e-3

"""Below this fraction of its length an edge's direction counts as along an axis, where the area of
a pixel that it cuts off is a rectangle's."""


@dataclass(frozen=True)
class Window:
    """A rectangle of pixels: rows top <= v < bottom, columns left <= u < right."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def empty(self) -> bool:
        """Whether there is no pixel in it."""
        return self.bottom <= self.top or self.right <= self.left

    @property
    def slices(self) -> tuple[slice, slice]:
        """Slices of an image."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def rows(self) -> slice:
        """Slice of its rows."""
        return slice(self.top, self.bottom)

    def overlaps(self, other: "Window") -> bool:
        """Whether the two have a pixel in common."""
        return (
            self.top < other.bottom
            and other.top < self.bottom
            and self.left < other.right
            and other.left < self.right
        )

    def joined(self, other: "Window") -> "Window":
        """Smallest window that holds both."""
        return Window(
            min(self.top, other.top),
            max(self.bottom, other.bottom),
            min(self.left, other.left),
            max(self.right, other.right),
        )


@dataclass(frozen=True)
class PixelGrid:
    """Viewing directions of a picture's pixels.

    Attributes
    ----------
    xy : (2, H, W) array
        Undistorted normalised coordinates of pixel centres.
    slope : (4, H, W) array
        dx/du, dx/dv, dy/du, dy/dv, 1/px.
    """

    xy: FloatArray
    slope: FloatArray

    @classmethod
    def of_lens(cls, lens: Lens) -> "PixelGrid":
        """Grid of all pixels of a lens' picture."""
        u, v = np.meshgrid(np.arange(lens.width), np.arange(lens.height))
        px = np.stack([u, v], axis=-1).astype(np.float64)

        def look(du: float, dv: float) -> FloatArray:
            return np.moveaxis(lens.undistort(lens.from_pixels(px + np.array([du, dv]))), -1, 0)

        along_u = look(0.5, 0.0) - look(-0.5, 0.0)
        along_v = look(0.0, 0.5) - look(0.0, -0.5)
        slope = np.stack([along_u[0], along_v[0], along_u[1], along_v[1]])
        return cls(look(0.0, 0.0), slope)

    def crop(self, window: Window) -> "PixelGrid":
        """The part inside a window (a view)."""
        rows, columns = window.slices
        return PixelGrid(self.xy[:, rows, columns], self.slope[:, rows, columns])


def pixel_coverage(distance: FloatArray, along_u: FloatArray, along_v: FloatArray) -> FloatArray:
    """Area of a unit pixel inside a half-plane.

    Parameters
    ----------
    distance : array
        Of the pixel's centre from the edge, px, positive inside.
    along_u, along_v : array
        Unit normal of the edge.

    Returns
    -------
    array
        0 to 1: the integral over the trapezoid that a square's shadow along the normal is.
    """
    one, two = np.abs(along_u), np.abs(along_v)
    long, short = np.maximum(one, two), np.maximum(np.minimum(one, two), MIN_EDGE_SLOPE)
    outer, inner = 0.5 * (long + short), 0.5 * (long - short)
    s = np.clip(distance, -outer, outer)
    area = (s + outer) ** 2
    area -= np.maximum(s + inner, 0.0) ** 2
    area -= np.maximum(s - inner, 0.0) ** 2
    return np.asarray(np.clip(area / (2.0 * long * short), 0.0, 1.0))


def edge_coverage(normal: FloatArray, grid: PixelGrid) -> FloatArray:
    """Coverage by the half-plane on the positive side of a plane through the camera's centre.

    Parameters
    ----------
    normal : (..., 3) array
        Normal of that plane in the camera's frame; leading axes broadcast against (H, W).

    Returns
    -------
    (H, W) array
    """
    a, b, c = normal[..., 0], normal[..., 1], normal[..., 2]
    value = a * grid.xy[0] + b * grid.xy[1] + c
    along_u = a * grid.slope[0] + b * grid.slope[2]
    along_v = a * grid.slope[1] + b * grid.slope[3]
    steep = 1.0 / np.maximum(np.hypot(along_u, along_v), 1e-300)
    return pixel_coverage(value * steep, along_u * steep, along_v * steep)


def quadric_coverage(centre: FloatArray, form: FloatArray, grid: PixelGrid) -> FloatArray:
    """Coverage by the ellipsoid (p - c)ᵀ Q (p - c) <= 1.

    The cone of sight lines that touch it is (dᵀQc)² = (dᵀQd)(cᵀQc - 1).

    Parameters
    ----------
    centre : (..., 3) array
        c in the camera's frame, m; leading axes broadcast against (H, W).
    form : (3, 3) array
        Q, 1/m².

    Returns
    -------
    (H, W) array
    """
    x, y = grid.xy
    pull = centre @ form
    m = np.sum(pull * centre, axis=-1) - 1.0
    along = pull[..., 0] * x + pull[..., 1] * y + pull[..., 2]
    qx = form[0, 0] * x + form[0, 1] * y + form[0, 2]
    qy = form[1, 0] * x + form[1, 1] * y + form[1, 2]
    qz = form[2, 0] * x + form[2, 1] * y + form[2, 2]
    value = along**2 - m * (qx * x + qy * y + qz)
    slope_x = 2.0 * (along * pull[..., 0] - m * qx)
    slope_y = 2.0 * (along * pull[..., 1] - m * qy)
    along_u = slope_x * grid.slope[0] + slope_y * grid.slope[2]
    along_v = slope_x * grid.slope[1] + slope_y * grid.slope[3]
    steep = np.maximum(np.hypot(along_u, along_v), 1e-300)
    pixel_area = np.abs(grid.slope[0] * grid.slope[3] - grid.slope[1] * grid.slope[2])
    curved = (
        0.5 * (m * (form[0, 0] + form[1, 1]) - pull[..., 0] ** 2 - pull[..., 1] ** 2) * pixel_area
    )
    # For a disc of radius r the value is curved·(r² - ρ²): this is its exact root, not a first step
    root = np.sqrt(np.maximum(0.25 * steep**2 + curved * value, 0.0))
    distance = value / (0.5 * steep + root)
    radius = np.maximum(root / curved, 0.5)
    # a pixel's two ends along the edge lie farther out than its middle: by 1/(24 r) on the mean
    return pixel_coverage(distance - 1.0 / (24.0 * radius), along_u / steep, along_v / steep)


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex body that is its own mirror image through its middle.

    Attributes
    ----------
    vertices : (N, 3) array
        m, in the frame of the caller.
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
    """Edges between faces visible and invisible from `eye` (3,), in order around the outline."""
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
    """Fraction of a lamp's light that a solid blocks for points behind it.

    Parameters
    ----------
    points : (3, ...) array
        World, m.
    vertices : (N, 3) array
        Of the solid, world, m.
    lamp : (3,) array

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


# reflectance (red, green, blue), shares of the light, chosen by eye: the stand
STEEL = (0.2, 0.205, 0.22)

# likewise by eye, share of the light: the bar
BAR = (0.5, 0.5, 0.48)

# likewise by eye, share of the light: the plate
PLATE = (0.46, 0.46, 0.44)

CORD = (0.15, 0.14, 0.13)

"""Likewise by eye, share of the light: a hanging cord."""


def contact_scene(scene: Scene) -> ContactScene:
    """Pendulum, ball and support placed so that they touch at the scene's contact angle."""
    gravity = Defaults.GRAVITY.known
    return ContactScene(scene.pendulum, scene.ball, scene.support, gravity, scene.contact_angle)


def pivot(scene: Scene) -> FloatArray:
    """Pivot of the pendulum, world (3,), m."""
    x, y = contact_scene(scene).pivot
    return np.array([float(x), float(y), scene.room.plane])


def rest_centre(scene: Scene) -> FloatArray:
    """Ball's centre at rest, world (3,), m."""
    return np.array([0.0, scene.support.height + scene.ball.radius, scene.room.plane])


def swing_rotation(phi: FloatArray) -> FloatArray:
    """Rotations (..., 3, 3) about z by phi (...): from the hanging pendulum to the world."""
    c, s, zero = np.cos(phi), np.sin(phi), np.zeros_like(phi)
    rows = [[c, -s, zero], [s, c, zero], [zero, zero, zero + 1.0]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def _cylinder(
    start: FloatArray, end: FloatArray, radius: float, colour: tuple[float, float, float]
) -> Solid:
    axis = end - start
    helper = (
        np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.9 * np.linalg.norm(axis) else np.eye(3)[1]
    )
    one = np.cross(axis, helper)
    one /= np.linalg.norm(one)
    two = np.cross(axis, one) / np.linalg.norm(axis)
    turn = np.arange(12)[:, np.newaxis] * (np.pi / 6.0)
    ring = start + radius * (np.cos(turn) * one + np.sin(turn) * two)
    return prism(ring, axis, colour)


def standing_solids(scene: Scene) -> list[Solid]:
    """All static solids, farthest from the camera first."""
    solids: list[Solid] = []
    plane = scene.room.plane
    if scene.room.show_rig:
        x, y, _ = pivot(scene)
        solids.append(box([x + 0.12, y + 0.0, 0.008], [0.12, 0.2, 0.016], PLATE))
        solids.append(
            _cylinder(
                np.array([x + 0.1, y + 0.02, 0.016]),
                np.array([x + 0.02, y + 0.06, plane - 0.04]),
                0.013,
                STEEL,
            )
        )
        for lean in (0.1, -0.05):
            foot = np.array([x + lean, y, plane - 0.06])
            solids.append(
                _cylinder(foot, np.array([x + 0.06, y + 0.9, plane - 0.06]), 0.012, STEEL)
            )
        solids.append(box([x, y, plane - 0.05], [0.1, 0.06, 0.05], STEEL))
    if scene.room.show_support:
        top = scene.support.height
        solids.append(
            _cylinder(np.array([0, 0.0, plane]), np.array([0, 0.014, plane]), 0.075, STEEL)
        )
        solids.append(
            _cylinder(np.array([0, 0.014, plane]), np.array([0, top - 0.02, plane]), 0.012, STEEL)
        )
        solids.append(
            _cylinder(np.array([0, top - 0.02, plane]), np.array([0, top, plane]), 0.035, STEEL)
        )
    return solids


def pendulum_solids(scene: Scene) -> list[Solid]:
    """Bar, hub and striking block about the pivot, hanging straight down, m, in painting order."""
    if not scene.room.show_rig:
        return []
    length, face = scene.pendulum.length, scene.pendulum.face_offset
    depth, height, thick = scene.room.block
    bar, room = scene.room.bar_width, scene.room
    struck = [box([face - 0.5 * depth, -length, 0], [depth, height, thick], room.block_colour)]
    return [
        box([0, -0.5 * length + 0.01, 0], [bar, length - 0.02, min(0.012, bar)], BAR),
        *([] if room.bob_radius else struck),
        _cylinder(np.array([0, 0, -0.01]), np.array([0, 0, 0.035]), 0.022, PLATE),
    ]


def bob_centre(scene: Scene) -> FloatArray:
    """Middle of a spherical bob about the pivot, hanging straight down (3,), m."""
    pendulum = scene.pendulum
    return np.array([pendulum.face_offset - scene.room.bob_radius, -pendulum.length, 0.0])


def scale_solids(scale: SwingingScale) -> list[Solid]:
    """Cord and scale about the hook, hanging straight down, m."""
    height = scale.size[1]
    return [
        box([0, -0.5 * scale.length, 0], [0.006, scale.length, 0.006], CORD),
        box([0, -scale.length - 0.5 * height, 0], scale.size, scale.colour),
    ]


def scale_pose(scale: SwingingScale, times: FloatArray) -> FloatArray:
    """Angle of a swinging scale at `times` (...), rad."""
    turn = 2.0 * np.pi * scale.frequency * times + scale.phase
    return np.asarray(scale.amplitude * np.sin(turn))
