"""From light on the sensor to eight bits: point spread, vignetting, flicker, noise, gamma."""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.camera.camera import Lens
from sample_videos.scene import Lighting, Sensor

__all__ = ["developed", "flicker_gain", "vignette"]

FloatArray = NDArray[np.float64]
Float32 = NDArray[np.float32]

WHITE = 1.22
"""Light at full scale with gain 1, a factor on the reference: a white wall is then at 80 %."""


def vignette(lens: Lens, sensor: Sensor) -> Float32:
    """Share of light that reaches each pixel, (H, W, 1)."""
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
