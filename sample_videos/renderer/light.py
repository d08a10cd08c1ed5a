"""How much light reaches a surface: lamps with soft shadows, and the light from everywhere."""

import numpy as np
from numpy.typing import NDArray

from sample_videos.scene import Lamp

__all__ = ["closed_sky", "lamp_light", "sphere_shade"]

FloatArray = NDArray[np.float64]

REFERENCE = np.array([0.5, 0.4, 0.45])
"""m: where the lamps' light is one, about the ball's place at rest."""


def _column(vector: FloatArray, like: FloatArray) -> FloatArray:
    return vector.reshape((3,) + (1,) * (like.ndim - 1))


def lamp_light(points: FloatArray, normals: FloatArray, lamp: Lamp) -> FloatArray:
    """Irradiance (...) at points (3, ...) with unit normals (3, ...), cosine over square."""
    position = np.array(lamp.position)
    away = _column(position, points) - points
    square = np.sum(away * away, axis=0)
    reference = float(np.sum((position - REFERENCE) ** 2))
    cosine = np.sum(away * normals, axis=0) / np.sqrt(square)
    # the terminator is as soft as the lamp is large
    soft = lamp.radius / np.sqrt(reference)
    lit = np.where(cosine > soft, cosine, np.maximum(cosine + soft, 0.0) ** 2 / (4.0 * soft))
    return np.asarray(lamp.power * 1.6 * lit * reference / square)


def sphere_shade(
    points: FloatArray, centre: FloatArray, radius: float, lamp: FloatArray, lamp_radius: float
) -> FloatArray:
    """Share (...) of a lamp's light that a sphere takes from points (3, ...)."""
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
    """Share (...) of the light from everywhere that a sphere keeps from points (3, ...)."""
    to_ball = _column(centre, points) - points
    square = np.maximum(np.sum(to_ball * to_ball, axis=0), radius**2)
    cosine = np.sum(to_ball * normals, axis=0) / np.sqrt(square)
    factor = np.maximum(cosine, 0.0) * radius**2 / square
    # cut off where it no longer shows, so that only pixels near the ball need be touched
    return np.asarray(np.clip((factor - 0.02) / 0.98, 0.0, 0.9))
