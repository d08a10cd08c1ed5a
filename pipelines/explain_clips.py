"""Clips as a campaign: the measuring chain, its tracks in metres, one trial a clip."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from metrology import NotFoundError
from mismatch.campaign import Campaign, Trial
from physics.bodies import GRAVITY, Pendulum
from pipelines.measure.chain import MeasureOptions, measure_clip
from pipelines.measurement import Measurement
from pipelines.setup_file import Setup

__all__ = ["campaign_from_clips", "trial_of"]


def campaign_from_clips(clips: Sequence[Path], setup: Setup) -> Campaign:
    """Measure clips and lay their tracks out as trials.

    A clip whose back-swing is not in view starts from the angle that its speed before contact
    implies without losses; losses of the swing can then only be seen in the recorded part.

    Raises
    ------
    ClipError, NotFoundError
        If a clip can't be read, or no strike can be measured in it.
    """
    trials, notes = [], []
    for path in clips:
        trial, note = trial_of(path.stem, measure_clip(path, MeasureOptions(setup=setup)), setup)
        trials.append(trial)
        notes += [f"{path.name}: {text}" for text in note]
    return Campaign(tuple(trials), tuple(notes))


def trial_of(name: str, measured: Measurement, setup: Setup) -> tuple[Trial, list[str]]:
    """One clip's tracks as a trial, with notes on what was assumed."""
    if measured.impact is None:
        raise NotFoundError(
            f"{name}: no strike could be measured in this clip",
            hint="vision measure says what is missing.",
        )
    tracks = measured.impact.tracks
    notes = list(measured.warnings[:3])
    rest_height = 0.0
    if setup.support is not None:
        radius = 0.5 * setup.ball.diameter if setup.ball is not None else tracks.radius_m
        rest_height = setup.support.height + radius
    moved = tracks.ball_m - tracks.rest_m + np.array([0.0, rest_height])
    position = np.column_stack([moved, np.full(moved.shape[0], np.nan)])
    std = np.sqrt(np.stack([tracks.ball_cov_m2[:, 0, 0], tracks.ball_cov_m2[:, 1, 1]], axis=1))
    std = np.column_stack([std, np.full(std.shape[0], np.nan)])
    backswing = None
    angle = measured.quantity("backswing_angle")
    if angle.value is not None:
        backswing = math.radians(angle.value)
    elif setup.pendulum is not None:
        speed = measured.quantity("pendulum_speed_before").value
        contact = None if setup.ball is None else setup.ball.launch_angle
        if speed is not None and contact is not None:
            backswing = _lossless_backswing(setup.pendulum, speed, contact)
            notes.append("the back-swing is not in view; taken from the speed before contact")
    ball = None if setup.ball is None else setup.ball.name
    trial = Trial(
        name, tracks.ball_time_s, position, tracks.swing_time_s, tracks.swing_rad, ball,
        backswing, std,
    )  # fmt: skip
    return trial, notes


def _lossless_backswing(pendulum: Pendulum, speed: float, contact: float) -> float:
    rate = speed / pendulum.length
    drop = rate**2 * pendulum.inertia / (2.0 * pendulum.mass * GRAVITY * pendulum.com)
    return math.acos(float(np.clip(math.cos(contact) - drop, -1.0, 1.0)))
