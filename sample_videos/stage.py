"""Static part of the picture: wall, floor, solids, light and shadows."""

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from calib.camera import Camera, Lens
from sample_videos.bodies import (
    PixelGrid,
    Solid,
    Window,
    face_coverage,
    shade_behind,
    standing_solids,
)
from sample_videos.scene import BallLook, Lamp, Scene, Wall

__all__ = [
    "Panorama",
    "Stage",
    "ball_reflectance",
    "build_stage",
    "closed_sky",
    "face_lights",
    "into_camera",
    "lamp_light",
    "sphere_shade",
    "window_of",
]

FloatArray = NDArray[np.float64]

TILE = 256

"""px, side of the tile that a rough surface repeats: more than most pictures show of it at once."""


@lru_cache(maxsize=8)
def _tile(seed: int, grain: float) -> FloatArray:
    noise = gaussian_filter(
        np.random.default_rng(seed).standard_normal((TILE, TILE)), grain, mode="wrap"
    )
    return np.asarray(noise / noise.std())


def mottle(x: FloatArray, y: FloatArray, scale: float, seed: int, grain: float = 2.0) -> FloatArray:
    """Smooth random field over the plane, mean 0, deviation 1; `scale` m is one grain."""
    step = grain / scale
    where = np.stack([y * step, x * step])
    return np.asarray(map_coordinates(_tile(seed, grain), where, order=1, mode="grid-wrap"))


def _lines(at: FloatArray, footprint: FloatArray, pitch: float, width: float) -> FloatArray:
    """Fraction of an interval of length `footprint` about `at` that lines of a ruling take up."""

    def inked(x: FloatArray) -> FloatArray:
        turn = x / pitch + 0.5
        whole = np.floor(turn)
        return whole * width + np.clip((turn - whole - 0.5) * pitch + 0.5 * width, 0.0, width)

    spread = np.maximum(footprint, 1e-6)
    return np.asarray((inked(at + 0.5 * spread) - inked(at - 0.5 * spread)) / spread)


def wall_reflectance(
    x: FloatArray, y: FloatArray, step_x: FloatArray, step_y: FloatArray, wall: Wall, seed: int
) -> FloatArray:
    """Reflectance (3, ...) of the wall at x, y (m), averaged over step_x by step_y."""
    from_x, from_y = x - wall.origin[0], y - wall.origin[1]
    light = np.ones_like(x)
    rulings = (
        (wall.pitch, wall.line_width, wall.contrast),
        (wall.fine_pitch, wall.fine_width, wall.fine_contrast),
    )
    for pitch, width, contrast in rulings:
        if contrast > 0.0:
            light *= 1.0 - contrast * _lines(from_x, step_x, pitch, width)
            light *= 1.0 - contrast * _lines(from_y, step_y, pitch, width)
    light *= 1.0 + 0.012 * mottle(x, y, 0.02, seed) + 0.02 * mottle(x, y, 0.35, seed + 1)
    warm = 0.012 * mottle(x, y, 0.5, seed + 2)
    tint = np.stack([1.0 + warm, np.ones_like(warm), 1.0 - warm])
    return np.asarray(np.reshape(wall.colour, (3,) + (1,) * x.ndim) * tint * light)


def floor_reflectance(
    x: FloatArray, z: FloatArray, colour: tuple[float, float, float], seed: int
) -> FloatArray:
    """Reflectance (3, ...) of the floor at x, z (m)."""
    grain = 0.1 * mottle(x, z, 0.015, seed + 3) + 0.06 * mottle(x, z, 0.1, seed + 4)
    return np.asarray(np.reshape(colour, (3,) + (1,) * x.ndim) * np.clip(1.0 + grain, 0.5, 1.6))


def _icosahedron() -> FloatArray:
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    corners = [(0.0, a, b * golden) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    rows = [np.roll(corner, shift) for corner in corners for shift in range(3)]
    return np.asarray(np.array(rows) / np.hypot(1.0, golden))


BALL_CORNERS = _icosahedron()


def ball_reflectance(normal: FloatArray, footprint: FloatArray, look: BallLook) -> FloatArray:
    """Reflectance (M, 3) of a painted ball.

    Parameters
    ----------
    normal : (M, 3) array
        Outward unit normal in the ball's own frame.
    footprint : (M,) array
        Angle on the ball that a pixel covers, rad.
    """
    base, mark = np.array(look.base), np.array(look.mark)
    if look.pattern == "plain":
        return np.broadcast_to(base, normal.shape).copy()
    if look.pattern == "jokku":
        nearest = np.arccos(np.clip((normal @ BALL_CORNERS.T).max(axis=1), -1.0, 1.0))
        share = np.clip(0.5 + (0.34 - nearest) / footprint, 0.0, 1.0)
        seam = np.zeros_like(share)
    else:
        x, y, z = normal.T
        width = 0.028
        rims = np.stack([np.abs(y), np.abs(z), np.abs(np.abs(x) - 0.7) * 1.4])
        away = rims.min(axis=0)
        share = np.clip(0.5 + (width - away) / footprint, 0.0, 1.0) * np.minimum(
            1.0, 2.0 * width / footprint
        )
        seam = share
    ground = base
    if look.pattern == "basketball":
        pebbles = (
            np.sin(23 * normal[:, 0] + 4)
            * np.sin(29 * normal[:, 1])
            * np.sin(31 * normal[:, 2] + 1)
        )
        fade = np.exp(-((30.0 * footprint) ** 2) / 8.0)
        ground = base * (1.0 + 0.25 * (pebbles * fade * (1.0 - seam))[:, np.newaxis])
    return np.asarray(ground + share[:, np.newaxis] * (mark - ground))


LIGHT_REFERENCE_M = np.array([0.5, 0.4, 0.45])

"""m: where the lamps' light is one, about the ball's place at rest."""


def _column(vector: FloatArray, like: FloatArray) -> FloatArray:
    return vector.reshape((3,) + (1,) * (like.ndim - 1))


def lamp_light(points: FloatArray, normals: FloatArray, lamp: Lamp) -> FloatArray:
    """Irradiance (...) at points (3, ...) with unit normals (3, ...), cosine over square."""
    position = np.array(lamp.position)
    away = _column(position, points) - points
    square = np.sum(away * away, axis=0)
    reference = float(np.sum((position - LIGHT_REFERENCE_M) ** 2))
    cosine = np.sum(away * normals, axis=0) / np.sqrt(square)
    # the terminator is as soft as the lamp is large
    soft = lamp.radius / np.sqrt(reference)
    lit = np.where(cosine > soft, cosine, np.maximum(cosine + soft, 0.0) ** 2 / (4.0 * soft))
    return np.asarray(lamp.power * 1.6 * lit * reference / square)


def sphere_shade(
    points: FloatArray, centre: FloatArray, radius: float, lamp: FloatArray, lamp_radius: float
) -> FloatArray:
    """Fraction (...) of a lamp's light that a sphere blocks at points (3, ...)."""
    to_lamp = _column(lamp, points) - points
    to_ball = centre.reshape(_column(lamp, points).shape) - points
    lamp_distance = np.sqrt(np.sum(to_lamp * to_lamp, axis=0))
    ball_distance = np.sqrt(np.sum(to_ball * to_ball, axis=0))
    cosine = np.sum(to_lamp * to_ball, axis=0) / (lamp_distance * ball_distance)
    apart = np.arccos(np.clip(cosine, -1.0, 1.0))
    size = np.arcsin(np.clip(radius / ball_distance, 0.0, 1.0))
    u = np.clip((size - apart) * lamp_distance / lamp_radius, -1.0, 1.0)
    share = 0.5 + u * (0.75 - 0.25 * u * u)
    return np.asarray(np.where(ball_distance < lamp_distance, share, 0.0))


def closed_sky(
    points: FloatArray, normals: FloatArray, centre: FloatArray, radius: float
) -> FloatArray:
    """Fraction (...) of the ambient light that a sphere blocks at points (3, ...)."""
    to_ball = _column(centre, points) - points
    square = np.maximum(np.sum(to_ball * to_ball, axis=0), radius**2)
    cosine = np.sum(to_ball * normals, axis=0) / np.sqrt(square)
    factor = np.maximum(cosine, 0.0) * radius**2 / square
    # cut off where it no longer shows, so that only pixels near the ball need be touched
    return np.asarray(np.clip((factor - 0.02) / 0.98, 0.0, 0.9))


Float32 = NDArray[np.float32]

SUPERSAMPLING = 3

"""Samples a pixel each way of the still picture: printed lines thinner than a pixel keep their
share."""

MARGIN_PX = 2

"""px around it, as far as a lens smears."""

MAX_SIGHT_LINE_M = 50.0

"""m; a sight line that meets nothing ends here, farther than any wall is."""


@dataclass(frozen=True)
class Stage:
    """Light that leaves the still things, apart by where it came from, with nothing moving about.

    Attributes
    ----------
    lights : tuple of (H, W, 3) arrays
        Towards the camera, blue green red: first from everywhere, then from each lamp.
    points : (3, H, W) array
        Where each pixel's sight line ends, world, m.
    normals : (3, H, W) array
        Of the surface there.
    """

    lights: tuple[Float32, ...]
    points: FloatArray
    normals: FloatArray


def into_camera(points: FloatArray, camera: Camera) -> FloatArray:
    """World points (..., 3) in the camera's frame."""
    return np.asarray((points - camera.position) @ camera.rotation.T)


def window_of(px: FloatArray, width: int, height: int, margin: float = MARGIN_PX) -> Window:
    """Window around pixels (..., 2); the whole picture where one of them can't be seen."""
    flat = px.reshape(-1, 2)
    if not np.all(np.isfinite(flat)):
        return Window(0, height, 0, width)
    low, high = flat.min(axis=0) - margin, flat.max(axis=0) + margin + 1.0
    left, right = np.clip([np.floor(low[0]), np.ceil(high[0])], 0, width).astype(int)
    top, bottom = np.clip([np.floor(low[1]), np.ceil(high[1])], 0, height).astype(int)
    return Window(int(top), int(bottom), int(left), int(right))


def _supersampled(lens: Lens, times: int) -> Lens:
    return lens.resized(lens.width * times, lens.height * times)


def _surfaces(camera: Camera, grid: PixelGrid) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Where the sight lines meet wall or floor (3, H, W), and which meet the floor (H, W)."""
    xy = grid.xy
    ray = np.tensordot(camera.rotation.T, np.stack([*xy, np.ones_like(xy[0])]), axes=1)
    start = camera.position
    with np.errstate(divide="ignore", invalid="ignore"):
        to_wall = np.where(ray[2] < 0, -start[2] / ray[2], np.inf)
        to_floor = np.where(ray[1] < 0, -start[1] / ray[1], np.inf)
    reach = np.nan_to_num(
        np.minimum(to_wall, to_floor), nan=MAX_SIGHT_LINE_M, posinf=MAX_SIGHT_LINE_M
    )
    points = start[:, np.newaxis, np.newaxis] + ray * np.minimum(reach, MAX_SIGHT_LINE_M)
    return points, to_floor < to_wall


def _normals(on_floor: NDArray[np.bool_]) -> FloatArray:
    up, out = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    return np.where(on_floor, up[:, np.newaxis, np.newaxis], out[:, np.newaxis, np.newaxis])


def build_stage(scene: Scene, camera: Camera) -> Stage:
    """Render the still things as `camera` sees them."""
    grid = PixelGrid.of_lens(camera.lens)
    layers = _layers(scene, camera, grid)
    lights = tuple(_shrunk(layer, camera.lens) for layer in layers)
    return Stage(lights, *_places(scene, camera, grid))


class Panorama:
    """The still things a little beyond the picture's edges, for a camera that turns.

    Parameters
    ----------
    margin : int
        By how many pixels the view may move.
    """

    def __init__(self, scene: Scene, margin: int) -> None:
        self._scene = scene
        lens = scene.camera.lens
        self._grid = PixelGrid.of_lens(lens)
        self._wide = replace(
            lens,
            width=lens.width + 2 * margin,
            height=lens.height + 2 * margin,
            cx=lens.cx + margin,
            cy=lens.cy + margin,
        )
        camera = Camera(self._wide, scene.camera.rotation, scene.camera.position)
        layers = _layers(scene, camera, PixelGrid.of_lens(self._wide))
        # averaged over a pixel at every fine place, so that looking up one place is enough
        self._layers = [
            cv2.blur(
                np.moveaxis(layer[::-1], 0, -1).astype(np.float32), (SUPERSAMPLING, SUPERSAMPLING)
            )
            for layer in layers
        ]

    def stage(self, camera: Camera) -> Stage:
        """The stage for the scene's camera rotated to `camera`'s attitude."""
        x, y = self._grid.xy
        turned = np.stack([x, y, np.ones_like(x)], axis=-1) @ (
            camera.rotation @ self._scene.camera.rotation.T
        )
        px = self._wide.to_pixels(self._wide.distort(turned[..., :2] / turned[..., 2:]))
        where = ((px + 0.5) * SUPERSAMPLING - 0.5).astype(np.float32)
        lights = tuple(
            np.asarray(
                cv2.remap(layer, where[..., 0], where[..., 1], cv2.INTER_LINEAR), dtype=np.float32
            )
            for layer in self._layers
        )
        return Stage(lights, *_places(self._scene, camera, self._grid))


def _layers(scene: Scene, camera: Camera, coarse: PixelGrid) -> list[FloatArray]:
    """Light (3, H, W) of the still things on a finer grid: from everywhere, then from each lamp."""
    lighting = scene.room.lighting
    points, _ = _surfaces(camera, coarse)
    solids = standing_solids(scene)
    grid = PixelGrid.of_lens(_supersampled(camera.lens, SUPERSAMPLING))
    supersampled_points, on_floor = _surfaces(camera, grid)
    normals = _normals(on_floor)
    paint = _paint(scene, supersampled_points, on_floor)
    layers = [paint * np.reshape(lighting.ambient, (3, 1, 1))]
    patches = 1.0 + lighting.unevenness * mottle(
        supersampled_points[0] + supersampled_points[2],
        supersampled_points[1] - supersampled_points[2],
        0.6,
        scene.seed + 9,
    )
    for lamp in lighting.lamps:
        shade = _standing_shade(points, solids, lamp)
        lit = lamp_light(supersampled_points, normals, lamp) * patches
        lit *= 1.0 - cv2.resize(shade, on_floor.shape[::-1], interpolation=cv2.INTER_LINEAR)
        layers.append(paint * lit * np.reshape(lamp.colour, (3, 1, 1)))
    for solid in solids:
        _draw(solid, scene, camera, grid, layers)
    return layers


def _places(scene: Scene, camera: Camera, grid: PixelGrid) -> tuple[FloatArray, FloatArray]:
    """Where the pixels' sight lines end, and the normals there, both (3, H, W)."""
    points, on_floor = _surfaces(camera, grid)
    normals = _normals(on_floor)
    for solid in standing_solids(scene):
        _mark(solid, camera, grid, points, normals)
    return points, normals


def _shrunk(layer: FloatArray, lens: Lens) -> Float32:
    picture = np.moveaxis(layer[::-1], 0, -1)
    shape = (lens.height, SUPERSAMPLING, lens.width, SUPERSAMPLING, 3)
    return np.ascontiguousarray(picture.reshape(shape).mean(axis=(1, 3)), dtype=np.float32)


def _paint(scene: Scene, points: FloatArray, on_floor: NDArray[np.bool_]) -> FloatArray:
    x, y, z = points
    step_x = np.abs(np.gradient(x, axis=1))
    step_y = np.abs(np.gradient(y, axis=0))
    wall = wall_reflectance(x, y, step_x, step_y, scene.room.wall, scene.seed)
    floor = floor_reflectance(x, z, scene.room.floor_colour, scene.seed)
    return np.where(on_floor, floor, wall)


def _standing_shade(points: FloatArray, solids: list[Solid], lamp: Lamp) -> FloatArray:
    free = np.ones(points.shape[1:])
    for solid in solids:
        shade = shade_behind(points, solid.vertices, solid, np.array(lamp.position), lamp.radius)
        free *= 1.0 - shade
    return 1.0 - free


def _draw(
    solid: Solid, scene: Scene, camera: Camera, grid: PixelGrid, layers: list[FloatArray]
) -> None:
    vertices = into_camera(solid.vertices, camera)
    height, width = grid.xy.shape[1:]
    supersampled_camera = Camera(
        _supersampled(camera.lens, SUPERSAMPLING), camera.rotation, camera.position
    )
    window = window_of(supersampled_camera.project(solid.vertices), width, height)
    if window.empty:
        return
    crop = grid.crop(window)
    where = (slice(None), *window.slices)
    paint = np.reshape(solid.colour, (3, 1, 1))
    for face in solid.faces:
        cover = face_coverage(vertices, face, crop)
        if not cover.any():
            continue
        lights = face_lights(solid.vertices, face, scene)
        for layer, light in zip(layers, lights, strict=True):
            layer[where] += cover * (paint * np.reshape(light, (3, 1, 1)) - layer[where])


def face_lights(vertices: FloatArray, face: tuple[int, ...], scene: Scene) -> list[FloatArray]:
    """Irradiance (3,) on the middle of a face: from everywhere, then from each lamp."""
    a, b, c = (vertices[i] for i in face[:3])
    normal = np.cross(b - a, c - b)
    normal /= np.linalg.norm(normal)
    middle = vertices[list(face)].mean(axis=0)[:, np.newaxis]
    lighting = scene.room.lighting
    sky = np.array(lighting.ambient) * (0.75 + 0.25 * normal[1])
    lamps = [
        np.array(lamp.colour) * lamp_light(middle, normal[:, np.newaxis], lamp)[0]
        for lamp in lighting.lamps
    ]
    return [sky, *lamps]


def _mark(
    solid: Solid, camera: Camera, grid: PixelGrid, points: FloatArray, normals: FloatArray
) -> None:
    """Pixels whose centre is on the solid get its place, so that shadows fall on it."""
    lens = camera.lens
    window = window_of(camera.project(solid.vertices), lens.width, lens.height)
    if window.empty:
        return
    crop = grid.crop(window)
    vertices = into_camera(solid.vertices, camera)
    for face in solid.faces:
        on_face = face_coverage(vertices, face, crop) > 0.5
        if not on_face.any():
            continue
        a, b, c = (solid.vertices[i] for i in face[:3])
        normal = np.cross(b - a, c - b)
        normal /= np.linalg.norm(normal)
        x, y = crop.xy[:, on_face]
        ray = camera.rotation.T @ np.stack([x, y, np.ones_like(x)])
        reach = float(normal @ (a - camera.position)) / (normal @ ray)
        rows, columns = window.slices
        points[:, rows, columns][:, on_face] = camera.position[:, np.newaxis] + ray * reach
        normals[:, rows, columns][:, on_face] = normal[:, np.newaxis]
