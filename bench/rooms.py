"""Draw random rooms: wall, furniture, lights, ball, pendulum and camera; and film them."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.cases import Case, rendered
from calib.camera import Camera
from measuring.chain import MeasureOptions
from measuring.setup.tables import CameraSetup, Setup, WallSetup
from physics.bodies import BALLS
from sample_videos.render import render_clip
from sample_videos.scene import (
    BallLook,
    Lamp,
    Lighting,
    LooseBall,
    Room,
    Scene,
    SwingingScale,
    Wall,
)
from sample_videos.shot import Shot, default_scene, staged
from sample_videos.truth import truth_path

__all__ = ["draw_room", "room_case"]

Colour = tuple[float, float, float]
Vector = tuple[float, float, float]

ROOM_BEFORE_S, AFTER_S = 0.085, 0.11
"""s; interval filmed, relative to first contact."""
ROOM_SIZES = ((432, 240), (320, 180), (640, 360), (208, 116))
"""Image sizes, px."""
FAINT_WALL = 0.03
"""Contrast of grid lines below which a user would not give their spacing; chosen."""
MAKES = ("block", "wide block", "bob on a rod", "bob on a cord", "pale block", "long block")


def room_case(seed: int, folder: Path) -> Case:
    """Film a room, with the options a user could give: no distances, pendulum or lens."""
    scene, shot = draw_room(seed)
    path = folder / f"room_{seed:03d}.mp4"
    render_clip(scene, shot, path)
    wall = scene.room.wall
    pitch = wall.pitch if wall.contrast > FAINT_WALL else None
    setup = Setup(camera=CameraSetup(scene.shutter.fps), wall=WallSetup(pitch))
    return rendered(
        truth_path(path), f"{seed:03d}", MeasureOptions(setup=setup, ball=scene.ball.name)
    )


def draw_room(seed: int) -> tuple[Scene, Shot]:
    """Draw a room; a seed always gives the same room."""
    rng = np.random.default_rng([seed, 97])
    ball = BALLS[str(rng.choice(sorted(BALLS)))]
    size = ROOM_SIZES[int(rng.choice(4, p=[0.5, 0.2, 0.1, 0.2]))]
    scene = default_scene(ball=ball, size=size, seed=seed)
    yaw = float(np.radians(rng.uniform(-6.0, 25.0))) if rng.uniform() < 0.4 else 0.0
    make = str(rng.choice(MAKES))
    room = _room(rng, scene.room, make)
    scene = replace(
        scene,
        camera=_aside(scene.camera, yaw),
        room=room,
        look=_look(rng, scene.look),
        sensor=replace(scene.sensor, gain=float(rng.uniform(0.6, 1.1))),
        shutter=replace(scene.shutter, exposure=float(rng.uniform(0.3e-3, 1.6e-3))),
        mirrored=bool(rng.uniform() < 0.4),
    )
    backswing = float(rng.uniform(45.0, 110.0))
    scene, shot = staged(backswing, scene)
    first = -(ROOM_BEFORE_S + float(rng.uniform(0.0, 1.0 / 600.0)))
    scene = replace(
        scene,
        shutter=replace(scene.shutter, first=first),
        frames=math.ceil((AFTER_S - first) * scene.shutter.fps),
    )
    return scene, shot


def _aside(camera: Camera, yaw: float) -> Camera:
    """The camera rotated about the point at the image centre, which stays there."""
    if yaw == 0.0:
        return camera
    x, y, away = camera.position
    return Camera.facing_wall(camera.lens, [x + away * math.tan(yaw), y, away], yaw=-yaw)


def _colour(rng: np.random.Generator, low: float, high: float) -> Colour:
    level = float(rng.uniform(low, high))
    red, green, blue = (level * rng.uniform(0.85, 1.15, 3)).clip(0.02, 0.92).tolist()
    return red, green, blue


def _look(rng: np.random.Generator, usual: BallLook) -> BallLook:
    if rng.uniform() < 0.5:
        return usual
    return BallLook("plain", _colour(rng, 0.15, 0.85), gloss=float(rng.uniform(0.0, 0.3)))


def _room(rng: np.random.Generator, usual: Room, make: str) -> Room:
    wall = _wall(rng, usual.wall)
    room = replace(usual, wall=wall, lighting=_lighting(rng), floor_colour=_colour(rng, 0.15, 0.4))
    room = replace(room, block_colour=_colour(rng, 0.08, 0.35), bar_width=0.022)
    if make == "wide block":
        room = replace(room, block=(0.13, 0.06, 0.085))
    elif make == "long block":
        room = replace(room, block=(0.06, 0.14, 0.06))
    elif make == "pale block":
        room = replace(room, block_colour=wall.colour)
    elif make == "bob on a rod":
        room = replace(room, bob_radius=float(rng.uniform(0.035, 0.055)), bar_width=0.010)
    elif make == "bob on a cord":
        room = replace(room, bob_radius=float(rng.uniform(0.035, 0.055)), bar_width=0.003)
    return replace(room, scales=_scales(rng), loose_balls=_balls(rng))


def _wall(rng: np.random.Generator, usual: Wall) -> Wall:
    kind = rng.uniform()
    colour = _colour(rng, 0.3, 0.88)
    if kind < 0.25:
        return replace(usual, colour=colour, contrast=0.0, fine_contrast=0.0)
    if kind < 0.5:
        return replace(usual, colour=colour, fine_contrast=0.0)
    return replace(usual, colour=colour)


def _lighting(rng: np.random.Generator) -> Lighting:
    lamps = tuple(
        Lamp(
            (
                float(rng.uniform(-2.0, 3.5)),
                float(rng.uniform(1.8, 3.2)),
                float(rng.uniform(2.5, 4.5)),
            ),
            float(rng.uniform(0.05, 0.4)),
            float(rng.uniform(0.2, 0.6)),
        )
        for _ in range(int(rng.integers(1, 4)))
    )
    level = float(rng.uniform(0.15, 0.4))
    return Lighting(lamps, (level, level, level), flicker=float(rng.uniform(0.0, 0.08)))


def _place(rng: np.random.Generator, low: Vector, high: Vector) -> Vector:
    x, y, z = rng.uniform(low, high).tolist()
    return x, y, z


def _scales(rng: np.random.Generator) -> tuple[SwingingScale, ...]:
    if rng.uniform() > 0.3:
        return ()
    hook = (float(rng.uniform(0.8, 2.2)), 1.5, float(rng.uniform(0.1, 0.3)))
    return (
        SwingingScale(hook=hook, phase=float(rng.uniform(0, 6)), colour=_colour(rng, 0.1, 0.6)),
    )


def _balls(rng: np.random.Generator) -> tuple[LooseBall, ...]:
    if rng.uniform() > 0.3:
        return ()
    radius = float(rng.uniform(0.06, 0.12))
    speed = float(rng.choice([0.0, -0.6, 0.5]))
    place = (float(rng.uniform(0.7, 2.2)), radius, float(rng.uniform(0.2, 0.7)))
    look = BallLook("plain", _colour(rng, 0.2, 0.7))
    return (LooseBall(place, radius, (speed, 0.0, 0.0), look),)
