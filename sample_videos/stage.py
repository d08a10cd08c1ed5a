"""The still part of the picture: wall, floor, bracket and support under each lamp."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.camera import Camera, Lens
from sample_videos.bodies import Solid, face_coverage, shade_behind
from sample_videos.coverage import PixelGrid, Window
from sample_videos.light import lamp_light
from sample_videos.rig import standing_solids
from sample_videos.scene import Lamp, Scene
from sample_videos.textures import floor_reflectance, mottle, wall_reflectance

__all__ = ["Stage", "build_stage", "into_camera", "window_of"]

FloatArray = NDArray[np.float64]
Float32 = NDArray[np.float32]

FINE = 3
MARGIN_PX = 2


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


def _finer(lens: Lens, times: int) -> Lens:
    return lens.resized(lens.width * times, lens.height * times)


def _surfaces(camera: Camera, lens: Lens) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Where the sight lines meet wall or floor (3, H, W), and which meet the floor (H, W)."""
    xy = PixelGrid.of_lens(lens).xy
    ray = np.tensordot(camera.rotation.T, np.stack([*xy, np.ones_like(xy[0])]), axes=1)
    start = camera.position
    with np.errstate(divide="ignore", invalid="ignore"):
        to_wall = np.where(ray[2] < 0, -start[2] / ray[2], np.inf)
        to_floor = np.where(ray[1] < 0, -start[1] / ray[1], np.inf)
    reach = np.nan_to_num(np.minimum(to_wall, to_floor), nan=50.0, posinf=50.0)
    points = start[:, np.newaxis, np.newaxis] + ray * np.minimum(reach, 50.0)
    return points, to_floor < to_wall


def _normals(on_floor: NDArray[np.bool_]) -> FloatArray:
    up, out = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    return np.where(on_floor, up[:, np.newaxis, np.newaxis], out[:, np.newaxis, np.newaxis])


def build_stage(scene: Scene, camera: Camera) -> Stage:
    """Render the still things as `camera` sees them."""
    lens = camera.lens
    points, on_floor = _surfaces(camera, lens)
    normals = _normals(on_floor)
    solids = standing_solids(scene)
    shades = [_standing_shade(points, solids, lamp) for lamp in scene.room.lighting.lamps]
    fine_points, fine_floor = _surfaces(camera, _finer(lens, FINE))
    paint = _paint(scene, fine_points, fine_floor)
    fine_normals = _normals(fine_floor)
    layers = [paint * np.reshape(scene.room.lighting.ambient, (3, 1, 1))]
    patches = 1.0 + scene.room.lighting.unevenness * mottle(
        fine_points[0] + fine_points[2], fine_points[1] - fine_points[2], 0.6, scene.seed + 9
    )
    for lamp, shade in zip(scene.room.lighting.lamps, shades, strict=True):
        size = fine_floor.shape[::-1]
        lit = lamp_light(fine_points, fine_normals, lamp) * patches
        lit *= 1.0 - cv2.resize(shade, size, interpolation=cv2.INTER_LINEAR)
        layers.append(paint * lit * np.reshape(lamp.colour, (3, 1, 1)))
    grid = PixelGrid.of_lens(_finer(lens, FINE))
    for solid in solids:
        _draw(solid, scene, camera, grid, layers)
        _mark(solid, camera, points, normals)
    lights = tuple(_shrunk(layer, lens) for layer in layers)
    return Stage(lights, points, normals)


def _shrunk(layer: FloatArray, lens: Lens) -> Float32:
    picture = np.moveaxis(layer[::-1], 0, -1)
    shape = (lens.height, FINE, lens.width, FINE, 3)
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
    fine_camera = Camera(_finer(camera.lens, FINE), camera.rotation, camera.position)
    window = window_of(fine_camera.project(solid.vertices), width, height)
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


def _mark(solid: Solid, camera: Camera, points: FloatArray, normals: FloatArray) -> None:
    """Pixels whose centre is on the solid get its place, so that shadows fall on it."""
    lens = camera.lens
    window = window_of(camera.project(solid.vertices), lens.width, lens.height)
    if window.empty:
        return
    crop = PixelGrid.of_lens(lens).crop(window)
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
