"""The moving things in one exposure: their coverage, colour and shadows."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calib.camera.camera import Camera
from sample_videos.renderer.ball_shape import BallPose, ball_layer
from sample_videos.renderer.bodies import (
    Solid,
    face_coverage,
    outline,
    outline_coverage,
    shade_behind,
)
from sample_videos.renderer.coverage import PixelGrid, Window
from sample_videos.renderer.light import closed_sky, sphere_shade
from sample_videos.renderer.stage import face_lights, into_camera, window_of
from sample_videos.scene import Lamp, Scene

__all__ = ["Actor", "RoundActor", "SolidActor"]

FloatArray = NDArray[np.float64]
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
