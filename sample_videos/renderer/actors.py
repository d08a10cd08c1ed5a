"""The moving things in one exposure: their coverage, colour and shadows.

The ball in the picture: a sphere, flattened and widened where a face presses it.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calib.camera import Camera
from sample_videos.bodies import (
    PixelGrid,
    Solid,
    Window,
    face_coverage,
    outline,
    outline_coverage,
    quadric_coverage,
    shade_behind,
)
from sample_videos.scene import BallLook, Lamp, Scene
from sample_videos.stage import (
    ball_reflectance,
    closed_sky,
    face_lights,
    into_camera,
    lamp_light,
    sphere_shade,
    window_of,
)

__all__ = ["Actor", "BallPose", "RoundActor", "SolidActor"]

FloatArray = NDArray[np.float64]

CLIP_SAMPLES = 4

"""Samples a pixel each way where a plane cuts the outline: an edge is right to a sixteenth."""


@dataclass(frozen=True, eq=False)
class BallPose:
    """A ball in one sub-exposure.

    Attributes
    ----------
    centre : (R, 3) array
        World, m, per row (R is 1 without rolling shutter).
    attitude : (3, 3) array
        Own frame to world.
    compression : (3,) array
        As in `motion.Moment`.
    radius : float
        m.
    look : BallLook
    """

    centre: FloatArray
    attitude: FloatArray
    compression: FloatArray
    radius: float
    look: BallLook

    @property
    def middle(self) -> FloatArray:
        """Centre seen by the middle row, (3,)."""
        return np.asarray(self.centre[len(self.centre) // 2])

    @property
    def depth(self) -> float:
        """How deep the face presses, m."""
        return float(np.linalg.norm(self.compression))

    def form(self) -> FloatArray:
        """Q of the ellipsoid (p - c)ᵀ Q (p - c) = 1 in the world, (3, 3): wider across the push."""
        if self.depth == 0.0:
            return np.eye(3) / self.radius**2
        axis = self.compression / self.depth
        wide = self.radius * (1.0 + self.look.bulge * self.depth / (2.0 * self.radius))
        along = np.outer(axis, axis)
        return np.asarray(along / self.radius**2 + (np.eye(3) - along) / wide**2)

    def bounds(self) -> FloatArray:
        """Corners (..., 3) of boxes that hold the ball at every row."""
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        ends = self.centre[[0, len(self.centre) // 2, -1]]
        return np.asarray((ends[:, np.newaxis] + signs * (1.05 * self.radius)).reshape(-1, 3))


def ball_layer(
    pose: BallPose,
    window: Window,
    grid: PixelGrid,
    camera: Camera,
    scene: Scene,
    shaded_by: list[tuple[FloatArray, float]],
) -> tuple[FloatArray, FloatArray]:
    """Coverage (h, w) and light (3, h, w), red green blue, of a ball."""
    rows = pose.centre[window.rows] if len(pose.centre) > 1 else pose.centre
    centre = into_camera(rows, camera)[:, np.newaxis]
    form = camera.rotation @ pose.form() @ camera.rotation.T
    cover = quadric_coverage(centre, form, grid)
    if pose.depth > 0.0:
        cover = cover * _kept(pose, centre, form, camera, grid)
    light = np.zeros((3, *cover.shape))
    seen = cover > 0.0
    if seen.any():
        light[:, seen] = _shaded(pose, seen, centre, form, camera, grid, scene, shaded_by)
    return cover, light


def _entry(
    centre: FloatArray, form: FloatArray, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where sight lines enter and leave the ellipsoid, in multiples of (x, y, 1)."""
    d = np.stack([x, y, np.ones_like(x)], axis=-1)
    pull = d @ form
    square = np.sum(pull * d, axis=-1)
    along = np.sum(pull * centre, axis=-1)
    rest = np.sum((centre @ form) * centre, axis=-1) - 1.0
    root = np.sqrt(np.maximum(along**2 - square * rest, 0.0))
    return (along - root) / square, (along + root) / square, d


def _kept(
    pose: BallPose, centre: FloatArray, form: FloatArray, camera: Camera, grid: PixelGrid
) -> FloatArray:
    """Share of each pixel whose sight lines meet the ball on the free side of the face."""
    axis = camera.rotation @ (pose.compression / pose.depth)
    limit = pose.radius - pose.depth
    steps = (np.arange(CLIP_SAMPLES) + 0.5) / CLIP_SAMPLES - 0.5
    pixel = float(centre[..., 2].mean()) * float(
        np.sqrt(np.abs(grid.slope[0] * grid.slope[3] - grid.slope[1] * grid.slope[2]).mean())
    )
    kept = np.zeros(grid.xy.shape[1:])
    for dv in steps:
        for du in steps:
            x = grid.xy[0] + du * grid.slope[0] + dv * grid.slope[1]
            y = grid.xy[1] + du * grid.slope[2] + dv * grid.slope[3]
            near, far, d = _entry(centre, form, x, y)
            reach = np.minimum(
                (near[..., np.newaxis] * d - centre) @ axis,
                (far[..., np.newaxis] * d - centre) @ axis,
            )
            kept += np.clip(0.5 + (limit - reach) * CLIP_SAMPLES / pixel, 0.0, 1.0)
    return kept / CLIP_SAMPLES**2


def _shaded(
    pose: BallPose,
    seen: NDArray[np.bool_],
    centre: FloatArray,
    form: FloatArray,
    camera: Camera,
    grid: PixelGrid,
    scene: Scene,
    shaded_by: list[tuple[FloatArray, float]],
) -> FloatArray:
    """Light (3, M) that the seen pixels get from the ball's surface."""
    middle = np.broadcast_to(centre, (*seen.shape, 3))[seen]
    near, _, d = _entry(middle, form, grid.xy[0][seen], grid.xy[1][seen])
    offset = near[:, np.newaxis] * d - middle
    normal = offset @ form
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    facing = np.clip(-np.sum(normal * d, axis=1) / np.linalg.norm(d, axis=1), 0.05, 1.0)
    across = np.sqrt(np.abs(grid.slope[0] * grid.slope[3] - grid.slope[1] * grid.slope[2]))[seen]
    footprint = across * middle[:, 2] / pose.radius / np.sqrt(facing)
    world_normal = normal @ camera.rotation
    outward = offset @ camera.rotation
    own = outward @ pose.attitude
    own /= np.linalg.norm(own, axis=1, keepdims=True)
    paint = ball_reflectance(own, footprint, pose.look).T
    points = (pose.middle + outward).T
    lighting = scene.room.lighting
    up = world_normal[:, 1]
    # from below comes what the floor sends back
    light = np.array(lighting.ambient)[:, np.newaxis] * (0.72 + 0.28 * up) * paint
    sight = d @ camera.rotation
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    for lamp in lighting.lamps:
        reach = lamp_light(points, world_normal.T, lamp)
        for other, radius in shaded_by:
            reach = reach * (
                1.0 - sphere_shade(points, other, radius, np.array(lamp.position), lamp.radius)
            )
        towards = np.array(lamp.position) - points.T
        half = towards / np.linalg.norm(towards, axis=1, keepdims=True) - sight
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        shine = pose.look.gloss * np.clip(np.sum(half * world_normal, axis=1), 0.0, 1.0) ** 24
        light = light + np.array(lamp.colour)[:, np.newaxis] * reach * (paint + shine)
    return np.asarray(light)


Layer = tuple[FloatArray, FloatArray]


class Actor(Protocol):
    """A moving thing during one exposure, at sub-exposures 0 … S - 1."""

    windows: list[Window]

    def layer(self, part: int, window: Window, grid: PixelGrid) -> Layer:
        """Coverage (h, w) and light (3, h, w) in one sub-exposure."""
        ...

    def shade(self, points: FloatArray, lamp: Lamp) -> FloatArray:
        """Share of a lamp's light taken from points (3, ...) on the mean over the exposure."""
        ...

    def closes_sky(self, points: FloatArray, normals: FloatArray) -> FloatArray | None:
        """Share of the light from everywhere taken from points; None where it is not worth it."""
        ...

    def shadow_points(self) -> FloatArray:
        """World points (N, 3) whose shadows bound this thing's shadow."""
        ...


@dataclass(eq=False)
class SolidActor:
    """A box or prism.

    Attributes
    ----------
    solid : Solid
    vertices : (S, R, N, 3) array
        World, m, per sub-exposure and row; R is 1 without rolling shutter.
    scene : Scene
    camera : Camera
    shaded_by : RoundActor or None
        The ball, whose shadow may fall on it.
    """

    solid: Solid
    vertices: FloatArray
    scene: Scene
    camera: Camera
    shaded_by: "RoundActor | None" = None

    def __post_init__(self) -> None:
        lens = self.camera.lens
        seen = self.camera.project(self.vertices)
        self.windows = [window_of(px, lens.width, lens.height) for px in seen]
        self._seen = into_camera(self.vertices, self.camera)

    def _middle(self, part: int) -> FloatArray:
        rows = self.vertices.shape[1]
        return np.asarray(self.vertices[part, rows // 2])

    def layer(self, part: int, window: Window, grid: PixelGrid) -> Layer:
        """Coverage (h, w) and light (3, h, w) in one sub-exposure."""
        vertices = self._seen[part]
        rows = vertices[window.rows] if len(vertices) > 1 else vertices
        rows = rows[:, np.newaxis]
        here = self._middle(part)
        edges = outline(here, self.solid, self.camera.position)
        shape = grid.xy.shape[1:]
        if not edges:
            return np.zeros(shape), np.zeros((3, *shape))
        cover = outline_coverage(rows, edges, grid)
        total, light = np.full(shape, 1e-9), np.zeros((3, *shape))
        for face in self.solid.faces:
            share = face_coverage(rows, face, grid)
            if share.any():
                total += share
                light += share * self._face_light(here, face)[:, np.newaxis, np.newaxis]
        return cover, light / total

    def _face_light(self, vertices: FloatArray, face: tuple[int, ...]) -> FloatArray:
        lights = face_lights(vertices, face, self.scene)
        middle = vertices[list(face)].mean(axis=0)[:, np.newaxis]
        total = lights[0].copy()
        for light, lamp in zip(lights[1:], self.scene.room.lighting.lamps, strict=True):
            free = 1.0 if self.shaded_by is None else 1.0 - self.shaded_by.shade(middle, lamp)[0]
            total += free * light
        return total * self.solid.colour

    def shade(self, points: FloatArray, lamp: Lamp) -> FloatArray:
        """Share of a lamp's light taken from points (3, ...), at the middle of the exposure."""
        here = self._middle(len(self.vertices) // 2)
        return shade_behind(points, here, self.solid, np.array(lamp.position), lamp.radius)

    def closes_sky(self, points: FloatArray, normals: FloatArray) -> FloatArray | None:
        """Nothing: a small box takes too little."""
        return None

    def shadow_points(self) -> FloatArray:
        """World points (N, 3) whose shadows bound this thing's shadow."""
        return self._middle(len(self.vertices) // 2)


@dataclass(eq=False)
class RoundActor:
    """A ball.

    Attributes
    ----------
    poses : list of BallPose
        Per sub-exposure.
    scene : Scene
    camera : Camera
    shaded_by : list of (centre (3,), radius)
        Spheres that stand for what may throw a shadow on it.
    struck : bool
        Whether it is the ball that the pendulum meets.
    """

    poses: list[BallPose]
    scene: Scene
    camera: Camera
    shaded_by: list[tuple[FloatArray, float]]
    struck: bool = False

    def __post_init__(self) -> None:
        lens = self.camera.lens
        self.windows = [
            window_of(self.camera.project(pose.bounds()), lens.width, lens.height)
            for pose in self.poses
        ]

    @property
    def _pose(self) -> BallPose:
        return self.poses[len(self.poses) // 2]

    def layer(self, part: int, window: Window, grid: PixelGrid) -> Layer:
        """Coverage (h, w) and light (3, h, w) in one sub-exposure."""
        return ball_layer(self.poses[part], window, grid, self.camera, self.scene, self.shaded_by)

    def shade(self, points: FloatArray, lamp: Lamp) -> FloatArray:
        """Share of a lamp's light taken from points (3, ...), at the middle of the exposure."""
        return sphere_shade(
            points, self._pose.middle, self._pose.radius, np.array(lamp.position), lamp.radius
        )

    def closes_sky(self, points: FloatArray, normals: FloatArray) -> FloatArray | None:
        """Share of the light from everywhere taken from points (3, ...)."""
        return closed_sky(points, normals, self._pose.middle, self._pose.radius)

    def shadow_points(self) -> FloatArray:
        """World points (N, 3) whose shadows bound this thing's shadow."""
        return self._pose.bounds()
