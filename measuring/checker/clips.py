"""Collect the facts of a tracked clip for the checker."""

from typing import TYPE_CHECKING

import numpy as np

from calib.grid import WallGrid, find_wall_grid
from measuring.checker.scene import Finding, SceneFacts, findings_of
from metrology import CalibrationError
from vision.tracks import MotionKind

if TYPE_CHECKING:
    from measuring.chain import FollowedClip

__all__ = ["clip_facts", "clip_findings"]

_FALLING_MOTIONS = frozenset(
    kind
    for kind in MotionKind
    if kind.value in ("strike", "flight", "drop", "bounce", "collision", "none")
)
"""Kinds of motion in which the ball may fly freely."""


def clip_findings(followed: "FollowedClip", grid: WallGrid | None) -> tuple[Finding, ...]:
    """Findings on a tracked clip; `grid` as measured, None if it was not found or refused."""
    return findings_of(clip_facts(followed, grid))


def clip_facts(followed: "FollowedClip", grid: WallGrid | None) -> SceneFacts:
    """What is stated of a clip and what was seen in it."""
    inputs, ball = followed.inputs, followed.tracks.ball
    camera, wall = inputs.setup.camera, inputs.setup.wall
    diameter = inputs.rig.ball_diameter
    if grid is None and wall.grid is not None and followed.tracks.background.any():
        # A grid that contradicts the rest was refused, and is needed to find the cause.
        grid = _grid(followed)
    rows = ball.frame < len(followed.clock)
    return SceneFacts(
        frame=followed.clock[ball.frame[rows]],
        centre_px=ball.centre_px[rows],
        radius_px=ball.radius_px[rows] if ball.sized else None,
        flies=followed.tracks.motion.kind in _FALLING_MOTIONS,
        rate=(followed.rate.fps, followed.rate.std) if followed.rate.known else None,
        ball=None if diameter is None else (diameter.value, diameter.std),
        scale=followed.scale_m_per_px,
        grid=grid,
        pitch_stated=wall.grid is not None,
        pitch_relative_std=inputs.rig.grid_pitch.relative_std,
        camera_distance=camera.distance_to_wall,
        plane_offset=wall.ball_plane_offset,
        drag=inputs.drag_per_metre,
    )


def _grid(followed: "FollowedClip") -> WallGrid | None:
    inputs = followed.inputs
    background = np.asarray(followed.tracks.background)
    try:
        return find_wall_grid(background, pitch_m=inputs.grid_pitch, fine_pitch_m=inputs.fine_pitch)
    except CalibrationError:
        return None
