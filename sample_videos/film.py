"""Render frames of a scene: moving bodies, exposure, optics and sensor."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.camera import Camera, Lens, rotation_matrix
from sample_videos.bodies import (
    PixelGrid,
    Solid,
    Window,
    bob_centre,
    face_coverage,
    outline,
    outline_coverage,
    pendulum_solids,
    pivot,
    quadric_coverage,
    scale_pose,
    scale_solids,
    shade_behind,
    swing_rotation,
)
from sample_videos.scene import BallLook, Lamp, Lighting, LooseBall, Scene, Sensor
from sample_videos.shot import SceneMotion
from sample_videos.stage import (
    Panorama,
    Stage,
    ball_reflectance,
    build_stage,
    closed_sky,
    face_lights,
    into_camera,
    lamp_light,
    sphere_shade,
    window_of,
)

__all__ = [
    "Actor",
    "BallPose",
    "Film",
    "RoundActor",
    "SolidActor",
]

FloatArray = NDArray[np.float64]

EDGE_SUPERSAMPLING = 4

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
        """Depth of the compression by the face, m."""
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
    """Fraction of each pixel whose sight lines meet the ball on the free side of the face."""
    axis = camera.rotation @ (pose.compression / pose.depth)
    limit = pose.radius - pose.depth
    steps = (np.arange(EDGE_SUPERSAMPLING) + 0.5) / EDGE_SUPERSAMPLING - 0.5
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
            kept += np.clip(0.5 + (limit - reach) * EDGE_SUPERSAMPLING / pixel, 0.0, 1.0)
    return kept / EDGE_SUPERSAMPLING**2


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
    """Light (3, M) that the visible pixels receive from the ball's surface."""
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
    # The floor reflects light from below.
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
    """A moving body during one exposure, at sub-exposures 0 … S - 1."""

    windows: list[Window]

    def layer(self, part: int, window: Window, grid: PixelGrid) -> Layer:
        """Coverage (h, w) and light (3, h, w) in one sub-exposure."""
        ...

    def shade(self, points: FloatArray, lamp: Lamp) -> FloatArray:
        """Mean blocked fraction of a lamp's light at points (3, ...) over the exposure."""
        ...

    def closes_sky(self, points: FloatArray, normals: FloatArray) -> FloatArray | None:
        """Blocked fraction of the ambient light at points; None where negligible."""
        ...

    def shadow_points(self) -> FloatArray:
        """World points (N, 3) whose shadows bound this body's shadow."""
        ...


@dataclass(eq=False)
class SolidActor:
    """A box or prism.

    Attributes
    ----------
    vertices : (S, R, N, 3) array
        World, m, per sub-exposure and row; R is 1 without rolling shutter.
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
        """Blocked fraction of a lamp's light at points (3, ...), at mid-exposure."""
        here = self._middle(len(self.vertices) // 2)
        return shade_behind(points, here, self.solid, np.array(lamp.position), lamp.radius)

    def closes_sky(self, points: FloatArray, normals: FloatArray) -> FloatArray | None:
        """None: negligible for a small box."""
        return None

    def shadow_points(self) -> FloatArray:
        """World points (N, 3) whose shadows bound this body's shadow."""
        return self._middle(len(self.vertices) // 2)


@dataclass(eq=False)
class RoundActor:
    """A ball.

    Attributes
    ----------
    poses : list of BallPose
        Per sub-exposure.
    shaded_by : list of (centre (3,), radius)
        Spheres representing bodies that may cast a shadow on it.
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
        """Blocked fraction of a lamp's light at points (3, ...), at mid-exposure."""
        return sphere_shade(
            points, self._pose.middle, self._pose.radius, np.array(lamp.position), lamp.radius
        )

    def closes_sky(self, points: FloatArray, normals: FloatArray) -> FloatArray | None:
        """Blocked fraction of the ambient light at points (3, ...)."""
        return closed_sky(points, normals, self._pose.middle, self._pose.radius)

    def shadow_points(self) -> FloatArray:
        """World points (N, 3) whose shadows bound this body's shadow."""
        return self._pose.bounds()


Float32 = NDArray[np.float32]

WHITE = 1.22

"""Light at full scale with gain 1, a factor on the reference: a white wall is then at 80 %."""


def vignette(lens: Lens, sensor: Sensor) -> Float32:
    """Fraction of light that reaches each pixel, (H, W, 1)."""
    u = (np.arange(lens.width) - lens.cx) / (0.5 * lens.width)
    v = (np.arange(lens.height) - lens.cy) / (0.5 * lens.height)
    square = 0.5 * (u[np.newaxis, :] ** 2 + v[:, np.newaxis] ** 2)
    return np.asarray(1.0 - sensor.vignetting * square, dtype=np.float32)[..., np.newaxis]


def flicker_gain(
    start: FloatArray, exposure: float, lighting: Lighting, phase: float
) -> FloatArray:
    """Mean of the mains' light over exposures from `start` (N,) s lasting `exposure` s, (N,)."""
    turn = 2.0 * np.pi * lighting.flicker_hz
    middle = start + 0.5 * exposure
    smear = np.sinc(lighting.flicker_hz * exposure)
    return np.asarray(1.0 + lighting.flicker * smear * np.cos(turn * middle + phase))


def developed(
    light: Float32, gain: FloatArray, shade: Float32, sensor: Sensor, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Picture of the light (H, W, 3) under row gains (H,).

    Returns
    -------
    (H, W, 3) array
        uint8, blue green red.
    """
    if sensor.blur > 0.0:
        spread = cv2.GaussianBlur(light, (0, 0), sensor.blur, borderType=cv2.BORDER_REPLICATE)
        light = np.asarray(spread, dtype=np.float32)
    rows = (gain * sensor.gain / WHITE).astype(np.float32)[:, np.newaxis, np.newaxis]
    level = light * (shade * rows)
    if sensor.full_well > 0.0:
        variance = np.maximum(level, 0.0) * np.float32(1.0 / sensor.full_well)
        variance += np.float32((sensor.read_noise / sensor.full_well) ** 2)
        level += rng.standard_normal(level.shape, dtype=np.float32) * np.sqrt(variance)
    tone = np.clip(level, 0.0, 1.0) ** np.float32(1.0 / sensor.gamma)
    return np.asarray(tone * np.float32(255.0) + np.float32(0.5), dtype=np.uint8)


@dataclass(frozen=True)
class Canvas:
    """Camera of one frame, its pixels, and the stage in view."""

    camera: Camera
    grid: PixelGrid
    stage: Stage
    lamps: tuple[Lamp, ...]


def exposed(canvas: Canvas, actors: list[Actor]) -> Float32:
    """Light (H, W, 3), blue green red, on the mean over the exposure.

    `actors` are in painting order: each hides those before it.
    """
    picture = _background(canvas, actors)
    for group in _touching(actors):
        _paint(picture, canvas, group)
    return picture


def _background(canvas: Canvas, actors: list[Actor]) -> Float32:
    stage = canvas.stage
    picture = stage.lights[0].copy()
    for actor in actors:
        _dim_sky(picture, canvas, actor)
    for lamp, light in zip(canvas.lamps, stage.lights[1:], strict=True):
        free: Float32 | None = None
        for actor in actors:
            window = _shadow_window(canvas, actor, lamp)
            if window.empty:
                continue
            rows, columns = window.slices
            shade = actor.shade(stage.points[:, rows, columns], lamp)
            if free is None:
                free = np.ones(picture.shape[:2], dtype=np.float32)
            free[rows, columns] *= 1.0 - shade
        picture += light if free is None else light * free[..., np.newaxis]
    return picture


def _dim_sky(picture: Float32, canvas: Canvas, actor: Actor) -> None:
    height, width = picture.shape[:2]
    bounds = actor.shadow_points()
    middle = bounds.mean(axis=0)
    reach = 7.0 * float(np.abs(bounds - middle).max())
    around = middle + reach * np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]])
    window = window_of(canvas.camera.project(around), width, height)
    if window.empty:
        return
    rows, columns = window.slices
    points = canvas.stage.points[:, rows, columns]
    closed = actor.closes_sky(points, canvas.stage.normals[:, rows, columns])
    if closed is not None:
        picture[rows, columns] *= (1.0 - closed)[..., np.newaxis].astype(np.float32)


def _shadow_window(canvas: Canvas, actor: Actor, lamp: Lamp) -> Window:
    """Pixels in which the shadow can be: on the wall, on the floor, and on what stands between."""
    source = np.array(lamp.position)
    points = actor.shadow_points()
    middle = points.mean(axis=0)
    height, width = canvas.grid.xy.shape[1:]
    ray = points - source
    # the penumbra reaches as far beyond as the lamp is wide, times the lengthening
    with np.errstate(divide="ignore", invalid="ignore"):
        to_wall = np.where(ray[:, 2] < -1e-6, -source[2] / ray[:, 2], np.inf)
        to_floor = np.where(ray[:, 1] < -1e-6, -source[1] / ray[:, 1], np.inf)
    reach = np.minimum(np.minimum(to_wall, to_floor), 20.0)
    fall = source + ray * reach[:, np.newaxis]
    grown = lamp.radius * max(float(reach.max()) - 1.0, 0.0)
    on_wall = source + ray * np.minimum(to_wall, 20.0)[:, np.newaxis]
    on_floor = source + ray * np.minimum(to_floor, 20.0)[:, np.newaxis]
    spots = [fall]
    if np.any(to_floor < to_wall) and np.any(to_wall < to_floor):
        spots += [np.maximum(on_wall, 0.0 * on_wall + [-np.inf, 0, 0]), on_floor * [1, 0, 1]]
    spot = np.concatenate(spots)
    spot[:, 1:] = np.maximum(spot[:, 1:], 0.0)
    corners = np.concatenate([spot - grown, spot + grown, middle[np.newaxis]])
    corners[:, 1:] = np.maximum(corners[:, 1:], 0.0)
    corners[:, 2] = np.minimum(corners[:, 2], 0.6 * canvas.camera.position[2])
    return window_of(canvas.camera.project(corners), width, height, 1.0)


def _touching(actors: list[Actor]) -> list[list[Actor]]:
    """Actors whose pixels overlap, in painting order within each group."""
    groups: list[list[Actor]] = []
    for actor in actors:
        meets = [g for g in groups if any(_overlap(actor, other) for other in g)]
        groups = [g for g in groups if g not in meets]
        groups.append([a for g in meets for a in g] + [actor])
    order = {id(actor): i for i, actor in enumerate(actors)}
    return [sorted(g, key=lambda a: order[id(a)]) for g in groups]


def _hull(actor: Actor) -> Window:
    window = actor.windows[0]
    for other in actor.windows[1:]:
        window = window.joined(other)
    return window


def _overlap(one: Actor, two: Actor) -> bool:
    return _hull(one).overlaps(_hull(two))


def _paint(picture: Float32, canvas: Canvas, group: list[Actor]) -> None:
    parts = max(len(actor.windows) for actor in group)
    hulls = [h for h in map(_hull, group) if not h.empty]
    if not hulls:
        return
    hull = hulls[0]
    for other in hulls[1:]:
        hull = hull.joined(other)
    rows, columns = hull.slices
    under = picture[rows, columns]
    total = np.zeros_like(under)
    for part in range(parts):
        here = under.copy()
        for actor in group:
            own = part * len(actor.windows) // parts
            window = actor.windows[own]
            if window.empty:
                continue
            cover, light = actor.layer(own, window, canvas.grid.crop(window))
            inner = here[
                window.top - hull.top : window.bottom - hull.top,
                window.left - hull.left : window.right - hull.left,
            ]
            colour = np.moveaxis(light[::-1], 0, -1)
            inner += cover[..., np.newaxis] * (colour - inner)
        total += here
    picture[rows, columns] = total / parts


MAX_SUBEXPOSURE_STEP_PX = 0.4

"""Longest way between sub-exposures: well inside a pixel, so that they add up to a smear."""

MAX_SUBEXPOSURES = 24

"""Sub-exposures of a frame at most: a smear of 24 px is then still smooth."""


class Film:
    """Renders the frames of a scene one by one; frames are independent of each other."""

    def __init__(self, scene: Scene, motion: SceneMotion) -> None:
        self.scene, self.motion = scene, motion
        lens = scene.camera.lens
        self._grid = PixelGrid.of_lens(lens)
        self._vignette = vignette(lens, scene.sensor)
        rng = np.random.default_rng([scene.seed, 1])
        self._phase = float(rng.uniform(0.0, 2.0 * np.pi))
        self._sway = _sway(scene, rng)
        self._stage = build_stage(scene, scene.camera) if scene.shake.still else None
        margin = 2 + int(np.ceil(np.abs(self._sway).max()))
        self._panorama = None if scene.shake.still else Panorama(scene, margin)
        self._pendulum, self._pivot = pendulum_solids(scene), pivot(scene)

    def camera(self, frame: int) -> Camera:
        """Camera during a captured frame: that of the scene, turned by what it shakes."""
        camera = self.scene.camera
        if self.scene.shake.still:
            return camera
        right, down = self._sway[frame]
        lens = camera.lens
        turn = rotation_matrix([-down / lens.fy, right / lens.fx, 0.0])
        return Camera(lens, turn @ camera.rotation, camera.position)

    def row_times(self, frame: int) -> FloatArray:
        """Mid-exposure of each row, (H,) s; a single entry with a global shutter."""
        middle = self.scene.frame_time(frame)
        readout = self.scene.shutter.readout
        if readout == 0.0:
            return np.array([middle])
        height = self.scene.camera.lens.height
        return middle + readout * (np.arange(height) / (height - 1) - 0.5)

    def frame(self, frame: int) -> NDArray[np.uint8]:
        """Picture (H, W, 3), uint8, blue green red, of a captured frame."""
        scene = self.scene
        light = self.light(frame)
        rows = np.broadcast_to(self.row_times(frame), (scene.camera.lens.height,))
        exposure = scene.shutter.exposure
        gain = flicker_gain(rows - 0.5 * exposure, exposure, scene.room.lighting, self._phase)
        noise = np.random.default_rng([scene.seed, 2, frame])
        picture = developed(light, gain, self._vignette, scene.sensor, noise)
        return np.ascontiguousarray(picture[:, ::-1]) if scene.mirrored else picture

    def light(self, frame: int) -> NDArray[np.float32]:
        """Light (H, W, 3) on the sensor before the optics blur it, not mirrored."""
        camera = self.camera(frame)
        stage = self._stage if self._panorama is None else self._panorama.stage(camera)
        if stage is None:
            raise AssertionError("a film has either a stage or a panorama")
        canvas = Canvas(camera, self._grid, stage, self.scene.room.lighting.lamps)
        return exposed(canvas, self._actors(frame, camera))

    def ball_coverage(self, frame: int) -> FloatArray:
        """Mean fraction of each pixel covered by the ball over the exposure, (H, W)."""
        camera = self.camera(frame)
        total = np.zeros(self._grid.xy.shape[1:])
        struck = [
            actor
            for actor in self._actors(frame, camera)
            if isinstance(actor, RoundActor) and actor.struck
        ]
        for actor in struck:
            for part, window in enumerate(actor.windows):
                cover, _ = actor.layer(part, window, self._grid.crop(window))
                total[window.slices] += cover / len(actor.windows)
        return total

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """All frames that are not dropped, in order."""
        for index in self.kept():
            yield self.frame(index)

    def kept(self) -> list[int]:
        """Captured frames that reach the file."""
        dropped = set(self.scene.encoding.dropped)
        return [i for i in range(self.scene.frames) if i not in dropped]

    def _parts(self, times: FloatArray, way_px: float) -> FloatArray:
        """Instants (S, R) of the sub-exposures for what moves `way_px` in the exposure."""
        count = int(np.clip(np.ceil(way_px / MAX_SUBEXPOSURE_STEP_PX), 1, MAX_SUBEXPOSURES))
        offsets = ((np.arange(count) + 0.5) / count - 0.5) * self.scene.shutter.exposure
        return np.asarray(times[np.newaxis, :] + offsets[:, np.newaxis])

    def _way(self, points: FloatArray, camera: Camera) -> float:
        """Longest way in the picture between first and last row of points (2, N, 3), px."""
        px = camera.project(points)
        return float(np.nan_to_num(np.linalg.norm(px[1] - px[0], axis=-1)).max())

    def _actors(self, frame: int, camera: Camera) -> list[Actor]:
        scene, times = self.scene, self.row_times(frame)
        ends = self.scene.frame_time(frame) + np.array([-0.5, 0.5]) * scene.shutter.exposure
        moments = self.motion.at(ends)
        actors: list[Actor] = []
        for scale in scene.room.scales:
            way = scale.frequency * scale.length * scale.amplitude * 6.3 * scene.shutter.exposure
            parts = self._parts(times, way * camera.lens.fx / 3.0)
            turns = swing_rotation(scale_pose(scale, parts))
            actors += [
                SolidActor(s, s.moved(turns, np.array(scale.hook)), scene, camera)
                for s in scale_solids(scale)
            ]
        for loose in scene.room.loose_balls:
            actors.append(self._loose(loose, times, camera))
        block = self._block_path(moments.phi)
        parts = self._parts(
            times,
            max(self._way(block, camera), self._way(moments.ball[:, np.newaxis], camera)),
        )
        if not self._near(block, moments.ball, camera):
            swing_parts = self._parts(times, self._way(block, camera))
            ball_parts = self._parts(times, self._way(moments.ball[:, np.newaxis], camera))
        else:
            swing_parts = ball_parts = parts
        striker = block.mean(axis=(0, 1))
        ball = self._ball(ball_parts, camera, [(striker, 0.048)] if self._pendulum else [])
        phi = self.motion.at(swing_parts.ravel()).phi.reshape(swing_parts.shape)
        turns = swing_rotation(phi)
        pendulum: list[Actor] = [self._swinging(s, turns, camera, ball) for s in self._pendulum]
        if self._pendulum and scene.room.bob_radius:
            pendulum.append(self._bob(turns, camera))
        actors += self._ordered(pendulum, ball, float(np.mean(phi)), camera)
        return actors

    def _swinging(
        self, solid: Solid, turns: FloatArray, camera: Camera, ball: RoundActor | None
    ) -> SolidActor:
        return SolidActor(solid, solid.moved(turns, self._pivot), self.scene, camera, ball)

    def _bob(self, turns: FloatArray, camera: Camera) -> RoundActor:
        room = self.scene.room
        centres = turns @ bob_centre(self.scene) + self._pivot
        look = BallLook("plain", room.block_colour)
        poses = [
            BallPose(centre, np.eye(3), np.zeros(3), room.bob_radius, look) for centre in centres
        ]
        return RoundActor(poses, self.scene, camera, [])

    def _ordered(
        self, pendulum: list[Actor], ball: RoundActor | None, phi: float, camera: Camera
    ) -> list[Actor]:
        """The ball hides the pendulum if the camera is on the ball's side of the striking face."""
        if ball is None:
            return pendulum
        normal = np.array([np.cos(phi), np.sin(phi), 0.0])
        ahead = float(normal @ (camera.position - self._pivot))
        in_front = ahead > self.scene.pendulum.face_offset
        return [*pendulum, ball] if in_front else [ball, *pendulum]

    def _block_path(self, phi: FloatArray) -> FloatArray:
        """Corners of the lower end of the pendulum at both ends of the exposure, (2, N, 3)."""
        length = self.scene.pendulum.length
        low = np.array([[-0.05, -length - 0.05, 0.0], [0.05, -length - 0.05, 0.0], [0, -length, 0]])
        turns = swing_rotation(phi)
        return np.asarray(low @ np.swapaxes(turns, -1, -2) + self._pivot)

    def _near(self, block: FloatArray, ball: FloatArray, camera: Camera) -> bool:
        gap = np.linalg.norm(block.mean(axis=(0, 1)) - ball.mean(axis=0))
        return bool(gap < 3.0 * self.scene.ball.radius)

    def _ball(
        self, parts: FloatArray, camera: Camera, shaded_by: list[tuple[FloatArray, float]]
    ) -> RoundActor | None:
        if not self.scene.room.show_ball:
            return None
        moments = self.motion.at(parts.ravel())
        count, rows = parts.shape
        centres = moments.ball.reshape(count, rows, 3)
        # turn and squeeze hardly change within a readout: the ball's own row stands for all
        row = self._row_of(centres[count // 2], camera) if rows > 1 else 0
        poses = [
            BallPose(
                centres[i],
                moments.attitude[i * rows + row],
                moments.compression[i * rows + row],
                self.scene.ball.radius,
                self.scene.look,
            )
            for i in range(count)
        ]
        return RoundActor(poses, self.scene, camera, shaded_by, struck=True)

    def _row_of(self, centres: FloatArray, camera: Camera) -> int:
        v = camera.project(centres)[:, 1]
        return int(np.nanargmin(np.abs(v - np.arange(len(v)))))

    def _loose(self, loose: LooseBall, times: FloatArray, camera: Camera) -> RoundActor:
        way = np.linalg.norm(loose.velocity) * self.scene.shutter.exposure
        parts = self._parts(times, float(way) * camera.lens.fx / 3.0)
        poses = []
        for instants in parts:
            centre = np.array(loose.centre) + instants[:, np.newaxis] * np.array(loose.velocity)
            rolled = -instants[len(instants) // 2] * loose.velocity[0] / loose.radius
            attitude = (
                rotation_matrix([0.3, 0.2, 0.0])
                if rolled == 0
                else rotation_matrix([0.0, 0.0, rolled])
            )
            poses.append(BallPose(centre, attitude, np.zeros(3), loose.radius, loose.look))
        return RoundActor(poses, self.scene, camera, [])


def _sway(scene: Scene, rng: np.random.Generator) -> FloatArray:
    """How far the view has moved right and down in each frame, (N, 2) px."""
    shake, count = scene.shake, scene.frames
    times = np.arange(count) / scene.shutter.fps
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, 5))
    speed = shake.frequency * rng.uniform(0.4, 1.6, (2, 5))
    tremor = np.sin(2.0 * np.pi * speed[..., np.newaxis] * times + phase[..., np.newaxis])
    moved = shake.amplitude * np.sqrt(2.0 / 5.0) * tremor.sum(axis=1).T
    moved = moved + times[:, np.newaxis] * np.array(shake.drift)
    if shake.bump is not None:
        moved[shake.bump[0] :] += np.array(shake.bump[1:])
    return np.asarray(moved)
