"""The things in the room as solids: bracket, support, pendulum, distractors."""

import numpy as np
from numpy.typing import NDArray

from physics.contact.law import ContactScene
from sample_videos.renderer.bodies import Solid, box, prism
from sample_videos.scene import Scene, SwingingScale

__all__ = [
    "bob_centre",
    "pendulum_solids",
    "pivot",
    "rest_centre",
    "scale_pose",
    "scale_solids",
    "standing_solids",
    "swing_rotation",
]

FloatArray = NDArray[np.float64]

# reflectance (red, green, blue), shares of the light, chosen by eye: the stand
STEEL = (0.2, 0.205, 0.22)
# likewise by eye, share of the light: the bar
BAR = (0.5, 0.5, 0.48)
# likewise by eye, share of the light: the plate
PLATE = (0.46, 0.46, 0.44)
CORD = (0.15, 0.14, 0.13)
"""Likewise by eye, share of the light: a hanging cord."""


def contact_scene(scene: Scene, gravity: float = 9.806) -> ContactScene:
    """Pendulum, ball and support placed so that they touch at the scene's contact angle."""
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
    """Everything that never moves, farthest from the camera first."""
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
