"""The ball in the picture: a sphere, flattened and widened where a face presses it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.camera.camera import Camera
from sample_videos.renderer.coverage import PixelGrid, Window, quadric_coverage
from sample_videos.renderer.light import lamp_light, sphere_shade
from sample_videos.renderer.stage import into_camera
from sample_videos.renderer.textures import ball_reflectance
from sample_videos.scene import BallLook, Scene

__all__ = ["BallPose", "ball_layer"]

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
