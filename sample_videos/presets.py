"""Scenes to start from: a ball, a back-swing, a picture size, and a camera that sees it all."""

import math
from dataclasses import replace
from typing import Literal

import numpy as np

from calib.camera.camera import Camera, Lens
from metrology import UsageError
from physics.bodies import BALLS, PAPER_PENDULUM, PAPER_SUPPORT, Ball, Pendulum, Support
from sample_videos.scene import BallLook, Encoding, Room, Scene, Sensor, Shutter
from sample_videos.shot import Physics, Shot, strike

__all__ = ["LOOKS", "View", "default_scene", "look_of", "staged"]

View = Literal["landing", "impact", "oblique"]

LOOKS = {
    "jokku": BallLook(),
    "basketball": BallLook("basketball", (0.68, 0.24, 0.055), (0.03, 0.025, 0.025), gloss=0.06),
}

SIDE_M = 0.28
"""Left to see of the pendulum behind the ball at rest."""


def look_of(ball: Ball) -> BallLook:
    """How a ball is painted: its own way if it is one of the paper's, with dark patches if not."""
    return LOOKS.get(ball.name, LOOKS["jokku"])


def default_scene(
    *,
    ball: Ball = BALLS["jokku"],
    size: tuple[int, int] = (432, 240),
    reach: float = 2.62,
    view: View = "landing",
    distance: float | None = None,
    foot: tuple[float, float] | None = None,
    plane: float = 0.45,
    pendulum: Pendulum = PAPER_PENDULUM,
    support: Support = PAPER_SUPPORT,
    seed: int = 1,
) -> Scene:
    """Scene with a camera on a tripod and good light.

    Parameters
    ----------
    size : (2,) tuple of int
        Width and height, px.
    reach : float
        Where the ball will land, m; the view "landing" holds it.
    view
        "landing" holds rest, pendulum and landing; "impact" is close to the stroke; "oblique" holds
        all, from aside, turned and rolled, through a strong lens.
    distance : float, optional
        Camera to wall, m.
    foot : (2,) tuple, optional
        Where the axis of a camera square to the wall meets it, x and y, m.
    seed : int
        Small offsets of grid, camera and clock are drawn from it, as no lab has round numbers.
    """
    width, height = size
    if width < 32 or height < 32:
        raise UsageError(f"a picture of {width} x {height} px is too small for this scene")
    rng = np.random.default_rng([seed, 21])
    right = 0.75 if view == "impact" else reach + 0.30
    if view == "impact":
        left, away = -0.65, 3.4
    else:
        left, away = -(SIDE_M + 0.3), 4.6
    far = away if distance is None else distance
    sight = far - plane
    across = right - left
    focal = (width - 1) * sight / across
    middle = 0.5 * (left + right)
    # the floor beneath the ball must be in the picture, whatever its shape
    tall = across * height / width
    low = -0.10 if view != "impact" else -0.02
    turn = rng.normal(0.0, 0.002, 3)
    lens = Lens.centred(width, height, focal, k1=-0.015)
    position = [middle + rng.normal(0, 0.01), low + 0.5 * tall, far]
    if foot is not None:
        position[:2] = foot
        widest = 2.0 * max(right - foot[0], foot[0] - left)
        lens = Lens.centred(width, height, (width - 1) * sight / widest, k1=-0.015)
        turn *= 0.0
    yaw, pitch, roll = turn
    if view == "oblique":
        lens = replace(lens, k1=-0.21, k2=0.05, fx=0.86 * lens.fx, fy=0.86 * lens.fy)
        position[0] += 0.2
        yaw, pitch, roll = yaw - 0.045, pitch - 0.03, roll - 0.012
    camera = Camera.facing_wall(lens, position, yaw=yaw, pitch=pitch, roll=roll)
    gx, gy = rng.uniform(0.0, 0.05, 2)
    room = Room(plane=plane)
    room = replace(room, wall=replace(room.wall, origin=(float(gx), float(gy))))
    shutter = Shutter(first=-(50.0 + float(rng.uniform())) / 600.0)
    return Scene(
        camera,
        ball=ball,
        pendulum=pendulum,
        support=support,
        look=look_of(ball),
        room=room,
        shutter=shutter,
        sensor=Sensor(),
        encoding=Encoding(bitrate=9.0 * width * height),
        seed=seed,
    )


def staged(
    backswing_deg: float, scene: Scene, *, physics: Physics | None = None, after: int = 14
) -> tuple[Scene, Shot]:
    """Scene with as many frames as reach `after` frames beyond landing, and its stroke.

    Parameters
    ----------
    backswing_deg : float
        Angle of release behind the lowest point, deg.
    physics : Physics, optional
        Default: drag, a little face friction and lift. Its back-swing is replaced.
    """
    laws = Physics(0.0, face_friction=0.08, lift_coefficient=0.25) if physics is None else physics
    shot = strike(scene, replace(laws, backswing=math.radians(backswing_deg)))
    span = shot.landing_time - scene.shutter.first
    return replace(scene, frames=math.ceil(span * scene.shutter.fps) + after), shot
