"""Collect the facts of a tracked clip for the checker."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.grid import WallGrid, find_wall_grid
from measuring.checker.scene import Finding, SceneFacts, findings_of
from measuring.gravity import contradicts_gravity
from metrology import CalibrationError, Defaults
from vision.tracks import MotionKind

if TYPE_CHECKING:
    from measuring.chain import FollowedClip, Found

__all__ = ["clip_facts", "clip_findings"]

_FALLING_MOTIONS = frozenset(
    kind
    for kind in MotionKind
    if kind.value in ("strike", "flight", "drop", "bounce", "collision", "none")
)
"""Kinds of motion in which the ball may fly freely."""


def clip_findings(
    followed: "FollowedClip", grid: WallGrid | None, found: "Found | None" = None
) -> tuple[Finding, ...]:
    """Findings on a tracked clip, and on what was measured in it.

    Parameters
    ----------
    followed : FollowedClip
    grid : WallGrid or None
        As measured, None if it was not found or refused.
    found : Found, optional
        Its fitted fall is without air and perspective, which a track's parabola is not.
    """
    facts = clip_facts(followed, grid)
    if facts.flies and found is not None:
        facts = replace(facts, fall=_fitted_fall(found, facts.centre_px))
    return findings_of(facts)


def _fitted_fall(found: "Found", centre_px: NDArray[np.float64]) -> tuple[float, float] | None:
    """The fitted fall in px per picture squared; None if it is so far off that it was disturbed."""
    seen, plane = found.results.gravity, found.plane
    if seen.value is None or seen.std is None or plane is None:
        return None
    if contradicts_gravity(seen.value, Defaults.GRAVITY.known, seen.std):
        return None
    middle, step = np.median(centre_px, axis=0), 0.5 * np.eye(2)
    corners = plane.point(middle + step) - plane.point(middle - step)
    pixels = 1.0 / (float(np.sqrt(abs(np.linalg.det(corners)))) * found.rate.fps**2)
    return seen.value * pixels, seen.std * pixels


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
