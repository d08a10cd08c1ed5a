"""The calibration of a clip from its own pictures and what the lab wrote down."""

from dataclasses import replace

import numpy as np

from calib.camera.lens_file import read_lens
from calib.camera.lens_prior import LensPrior
from calib.evidence import BallOutlines, Evidence, Known
from calib.grid.grid import find_wall_grid
from calib.solve import Solved, solve
from pipelines.measure.inputs import Inputs
from vision.tracks import Track, Tracks

__all__ = ["calibrate_clip", "known_lens", "scene_evidence"]


def calibrate_clip(tracks: Tracks, inputs: Inputs) -> Solved:
    """Find the wall grid behind the scene and fit camera and ball plane to all that is known.

    Raises
    ------
    CalibrationError
        If there is no grid, or it contradicts what is known.
    SetupError
        If the lens file can't be used.
    """
    lens = known_lens(tracks, inputs)
    grid = find_wall_grid(
        tracks.background, pitch_m=inputs.grid_pitch, fine_pitch_m=inputs.fine_pitch
    )
    return solve(grid, scene_evidence(tracks, inputs), lens=lens)


def known_lens(tracks: Tracks, inputs: Inputs) -> LensPrior | None:
    """The lens of the setup file, for the clip's picture; None where none is named.

    Raises
    ------
    SetupError
        If its file can't be read, or its picture has another shape than the clip's.
    """
    path = inputs.setup.camera.lens
    if path is None:
        return None
    height, width = tracks.background.shape
    return read_lens(path, width=width, height=height)


def _known(pair: tuple[float, float] | None) -> Known | None:
    return None if pair is None else Known(*pair)


def scene_evidence(tracks: Tracks, inputs: Inputs) -> Evidence:
    """What is known of the scene besides its grid.

    The foot of the optical axis is written down as seen from the ball at rest and the floor: where
    either is not known, so is it not.
    """
    camera, wall = inputs.setup.camera, inputs.setup.wall
    foot = camera.principal_point_on_wall
    ball = tracks.ball
    evidence = Evidence(
        camera_distance=_known(camera.distance_to_wall),
        ball_plane_offset=_known(wall.ball_plane_offset),
        pitch_relative_std=inputs.rig.grid_pitch.relative_std,
    )
    if inputs.ball is not None:
        radius = 0.5 * inputs.ball.diameter
        evidence = replace(evidence, ball_radius=radius, outlines=_outlines(ball, tracks, inputs))
        if inputs.fall is not None:
            evidence = replace(evidence, rest_height=inputs.fall + radius)
    if tracks.rest_frames is not None:
        first, last = tracks.rest_frames
        still = (ball.frame >= first) & (ball.frame <= last)
        if still.any():
            evidence = replace(evidence, rest_px=np.median(ball.centre_px[still], axis=0))
    if foot is not None and evidence.rest_px is not None:
        evidence = replace(evidence, axis_foot_x=_known(foot[0]))
        if inputs.ball is not None and inputs.fall is not None:
            evidence = replace(evidence, axis_foot_y=_known(foot[1]))
    return evidence


def _outlines(ball: Track, tracks: Tracks, inputs: Inputs) -> BallOutlines | None:
    diameter = inputs.rig.ball_diameter
    assert diameter is not None
    after = -1 if tracks.rest_frames is None else tracks.rest_frames[1]
    # the ball is squashed in the first hundredths of a second after its rest
    round_again = ball.frame > after + (0.03 / np.median(np.diff(ball.time_s)))
    good = ball.where(round_again & (ball.quality >= np.median(ball.quality) * 0.5))
    if len(good) < 3:
        return None
    return BallOutlines.followed(
        good.centre_px, good.radius_px, good.radius_std_px, Known(diameter.value, diameter.std)
    )
