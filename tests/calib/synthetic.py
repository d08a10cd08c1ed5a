"""Render a supersampled wall grid through any camera, with noise."""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.camera import Camera, Lens

FloatArray = NDArray[np.float64]


def line_grid(
    xy: FloatArray,
    *,
    pitch: float = 0.05,
    width: float = 0.0015,
    fine: float | None = 0.01,
    fine_depth: float = 0.18,
    depth: float = 0.6,
) -> FloatArray:
    """Reflectance at wall coordinates (..., 2) of dark coarse and fainter fine lines."""
    shade = np.ones(xy.shape[:-1])
    for spacing, how_deep, wide in ((pitch, depth, width), (fine, fine_depth, 0.5 * width)):
        if spacing is None:
            continue
        off = np.abs(xy - spacing * np.round(xy / spacing)) < 0.5 * wide
        shade = np.minimum(shade, 1.0 - how_deep * off.any(axis=-1))
    return shade


def rendered(
    camera: Camera,
    wall: object = line_grid,
    *,
    noise: float = 2.0,
    seed: int = 0,
    shadow: bool = True,
    blur: float = 0.5,
    samples: int = 3,
) -> FloatArray:
    """Picture of the wall, gray levels 0–255, with uneven light, a floor and things in front."""
    assert callable(wall)
    width, height = camera.lens.width, camera.lens.height
    total = np.zeros((height, width))
    inside = (np.arange(samples) + 0.5) / samples - 0.5
    rows, columns = np.mgrid[:height, :width].astype(np.float64)
    for dy in inside:
        for dx in inside:
            xy = camera.to_plane(np.stack([columns + dx, rows + dy], axis=-1), 0.0)
            total += np.nan_to_num(wall(xy), nan=0.2)
    picture = 190.0 * total / samples**2
    picture *= 1.0 - 0.35 * columns / width - 0.15 * (rows / height) ** 2
    if shadow:
        centre = (int(0.3 * width), int(0.4 * height))
        dark = np.zeros((height, width))
        cv2.circle(dark, centre, int(0.12 * height), 1.0, -1)
        picture *= 1.0 - 0.4 * cv2.GaussianBlur(dark, (0, 0), 0.02 * width)
        cv2.circle(picture, (int(0.2 * width), int(0.55 * height)), int(0.09 * height), 90.0, -1)
        cv2.line(picture, (int(0.15 * width), 0), (int(0.25 * width), int(0.4 * height)), 60.0, 3)
        picture[int(0.88 * height) :] = 70.0
    picture = cv2.GaussianBlur(picture, (0, 0), blur)
    picture += np.random.default_rng(seed).normal(0.0, noise, picture.shape)
    return np.clip(np.round(picture), 0.0, 255.0)


def some_camera(rng: np.random.Generator, size: tuple[int, int] = (640, 360)) -> Camera:
    """A camera as people place them: up to 35° oblique, k1 from −0.25 to 0.1, rolled a little."""
    focal = size[0] * rng.uniform(1.0, 1.5)
    k1 = rng.uniform(-0.25, 0.1)
    lens = Lens.centred(*size, focal, k1=k1, k2=rng.uniform(0.0, 0.05) if k1 < -0.05 else 0.0)
    oblique = np.radians(rng.uniform(0.0, 35.0))
    direction = rng.uniform(0.0, 2.0 * np.pi)
    yaw, pitch = oblique * np.cos(direction), 0.5 * oblique * np.sin(direction)
    reach = rng.uniform(2.2, 4.2)
    target = np.array([0.9, 0.55])
    position = [target[0] - reach * np.tan(yaw), target[1] - reach * np.tan(pitch), reach]
    return Camera.facing_wall(
        lens, position, yaw=yaw, pitch=pitch, roll=np.radians(rng.uniform(-5, 5))
    )
