"""Tracks of a stroke that is known exactly, in metres, with as much noise as wanted."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from measuring.metres import MetricTracks
from physics.bodies import BALLS
from sample_videos import Scene, Shot, default_scene, staged
from sample_videos.bodies import pivot

__all__ = ["Noise", "ideal_tracks", "known_stroke"]


@dataclass(frozen=True)
class Noise:
    """One standard deviation: ball's centre (m), pendulum's angle (rad), lead of the face (m)."""

    ball: float = 1e-5
    angle: float = 2e-5
    face_offset: float = 1e-4
    seed: int = 0


SLANT, HALF_THICKNESS_M = -0.2, 0.045
"""Of the line of sight to the face, and of the mass."""


@cache
def known_stroke(ball: str, backswing_deg: float) -> tuple[Scene, Shot]:
    """A scene and its stroke; first touch is at t = 0."""
    return staged(backswing_deg, default_scene(ball=BALLS[ball], size=(96, 54)))


def ideal_tracks(
    scene: Scene, shot: Shot, noise: Noise, *, fps: float = 600.0, first_s: float = -0.0838
) -> MetricTracks:
    """What a perfect tracker with such noise would hand on; the clip starts at `first_s`."""
    rng = np.random.default_rng([noise.seed, 7])
    time = np.arange(0.0, shot.landing_time - first_s + 0.12, 1.0 / fps)
    moment = shot.motion.at(time + first_s)
    count = len(time)
    ball = moment.ball[:, :2] + rng.normal(0.0, noise.ball, (count, 2))
    angle = moment.phi + rng.normal(0.0, noise.angle, count)
    rest = shot.motion.at([first_s]).ball[0, :2]
    near = time + first_s < 0.25
    face_offset = scene.pendulum.face_offset + float(rng.normal(0.0, noise.face_offset))
    return MetricTracks(
        ball_frame=np.arange(count),
        ball_time_s=time,
        ball_m=ball,
        ball_cov_m2=np.tile(np.eye(2) * noise.ball**2, (count, 1, 1)),
        rest_m=rest,
        rest_std_m=np.full(2, noise.ball),
        pivot_m=pivot(scene)[:2],
        swing_time_s=time[near],
        swing_rad=angle[near],
        swing_std_rad=np.full(int(near.sum()), noise.angle),
        edge_offset_m=face_offset - SLANT * HALF_THICKNESS_M,
        edge_offset_std_m=noise.face_offset,
        middle_offset_m=face_offset,
        middle_offset_std_m=noise.face_offset,
        bob_arm_m=None,
        face_slant=SLANT,
        eye_m=None,
        radius_m=scene.ball.radius,
        direction=1.0,
    )
