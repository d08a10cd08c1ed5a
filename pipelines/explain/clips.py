"""Clips as a campaign: the measuring chain, its tracks in metres, one trial a clip."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from metrology import ClipError, MeasurementError, NotFoundError, UsageError
from mismatch.records.records import CampaignRecords, Trial
from physics.bodies import GRAVITY, PAPER_PENDULUM, PAPER_SUPPORT, Pendulum
from pipelines.explain.systematics import calibration_widths, common_widths
from pipelines.explain.tabular import numbers_of, read_sheet
from pipelines.measure.chain import MeasureOptions, measure_clip
from pipelines.measure.measurement import ClipMeasurement
from pipelines.setup.file import Setup

__all__ = ["ClipCampaign", "ClipFacts", "campaign_from_clips", "clip_facts", "trial_of", "with_rig"]

MOST_WARNINGS = 3
"""Warnings of one clip that are passed on: further ones are there if the clip is measured."""


@dataclass(frozen=True)
class ClipFacts:
    """What the lab wrote down about one clip: back-swing (rad) and ball; None where it did not."""

    backswing: float | None = None
    ball: str | None = None


@dataclass(frozen=True)
class ClipCampaign(CampaignRecords):
    """Trials from clips, with what their calibration leaves open.

    Attributes
    ----------
    widths : mapping
        Id of a fault of the instrument → standard uncertainty of the calibration in it.
    calibrated : bool
        Whether the widths are of the clips' own calibration, or what is usual of one.
    """

    widths: Mapping[str, float] = field(default_factory=dict)
    calibrated: bool = True


def clip_facts(path: Path) -> dict[str, ClipFacts]:
    """Read a table of clips: columns ``clip``, and ``backswing_deg`` or ``ball`` or both.

    Returns
    -------
    dict
        By the clip's name without folder and ending.

    Raises
    ------
    UsageError
        If the file can't be read, or has no column ``clip``.
    """
    table = read_sheet(path, {"backswing": "deg"}, ("clip", "ball")).table
    if "clip" not in table or not {"backswing_deg", "ball"} & set(table.columns):
        raise UsageError(
            f"{path} has the columns {', '.join(table.columns)}",
            hint="A table of clips has the columns clip and backswing_deg, and may have ball.",
        )
    nothing = pd.Series(np.nan, index=table.index)
    angles = nothing.to_numpy()
    if "backswing_deg" in table:
        said: list[str] = []
        angles = numbers_of(table, "backswing_deg", path.name, said)
        if said:
            raise UsageError(said[0].removesuffix("; they are left out"), hint="Mend these cells.")
    balls = table.get("ball", nothing)
    facts = {}
    for name, angle, ball in zip(table["clip"], angles, balls, strict=True):
        facts[Path(str(name).strip()).stem] = ClipFacts(
            None if pd.isna(angle) else math.radians(float(angle)),
            None if pd.isna(ball) else str(ball).strip(),
        )
    return facts


def campaign_from_clips(
    clips: Sequence[Path],
    setup: Setup,
    facts: Mapping[str, ClipFacts] | None = None,
    measure: Callable[[Path, MeasureOptions], ClipMeasurement] = measure_clip,
    *,
    strikes: bool = False,
) -> ClipCampaign:
    """Measure clips and lay their tracks out as trials.

    Flights are compared; with `strikes` the swing and the contact, too. A clip whose back-swing is
    neither told nor in view starts from the angle that its speed before contact implies without
    losses; losses of the swing can then only be seen in the recorded part.
    A clip that can't be measured is left out and noted, unless none can.

    Parameters
    ----------
    clips : sequence of Path
    setup : Setup
    facts : mapping, optional
        Clip's name → what the lab wrote down about it.
    measure : callable
        The measuring chain.
    strikes : bool
        Compare swing and contact, too. All clips of a camera share errors of the pendulum's pivot,
        about half a degree in its angles, which are told as physics where there is none.

    Raises
    ------
    UsageError
        If two clips have one name.
    ClipError, MeasurementError
        If no clip can be read and measured: the first clip's reason.
    """
    names = [path.stem for path in clips]
    again = sorted({name for name in names if names.count(name) > 1})
    if again:
        raise UsageError(
            f"two clips are called {again[0]}", hint="Every clip is a trial and needs its own name."
        )
    known, setup = facts or {}, with_rig(setup)
    trials: list[Trial] = []
    widths: list[dict[str, float]] = []
    releases: list[float] = []
    notes: list[str] = []
    refused: list[tuple[Path, ClipError | MeasurementError]] = []
    for path in clips:
        about = known.get(path.stem, ClipFacts())
        try:
            measured = measure(path, MeasureOptions(setup=setup, ball=about.ball))
            trial, said = trial_of(path.stem, measured, setup, about)
        except (ClipError, MeasurementError) as problem:
            refused.append((path, problem))
            continue
        trials.append(trial)
        releases.append(_release(measured))
        widths.append(calibration_widths(measured))
        notes += [f"{path.name}: {text}" for text in said]
    if not trials:
        raise refused[0][1]
    left_out = [
        f"{path.name} could not be measured and is left out: {why.message}" for path, why in refused
    ]
    told = all(_struck(trial, setup) for trial in trials)
    if not (strikes and told):
        # Without a whole strike to compare, rest and contact are no part of a free flight.
        trials = [_flight_only(t, r) for t, r in zip(trials, releases, strict=True)]
        notes.insert(0, _why_flights(told))
    return ClipCampaign(tuple(trials), (*left_out, *notes), common_widths(widths))


def with_rig(setup: Setup) -> Setup:
    """The setup with the paper's pendulum and support where it is silent, as the chain assumes."""
    return replace(
        setup,
        pendulum=setup.pendulum or PAPER_PENDULUM,
        support=setup.support or PAPER_SUPPORT,
    )


def _why_flights(told: bool) -> str:
    if not told:
        return "not every strike is known from its back-swing on: flights are compared"
    return (
        "flights are compared; --strikes compares swing and contact, too, but clips of one camera "
        "share errors of about half a degree in the pendulum's angles"
    )


def _release(measured: ClipMeasurement) -> float:
    """When the ball is free in the first frame of its flight, s."""
    return -math.inf if measured.impact is None else float(measured.impact.flight.time_s[0])


def _struck(trial: Trial, setup: Setup) -> bool:
    """Whether the baseline can follow the trial from the back-swing on."""
    ball = setup.balls.get(trial.ball or "", setup.ball)
    told = ball is not None and (
        bool(ball.contact_outcome) or None not in (ball.cor, ball.launch_angle, ball.mass)
    )
    return told and trial.backswing is not None


def _flight_only(trial: Trial, release: float) -> Trial:
    flying = trial.ball_time >= release - 1e-9
    std = None if trial.position_std is None else trial.position_std[flying]
    return replace(
        trial,
        ball_time=trial.ball_time[flying],
        position=trial.position[flying],
        pendulum_time=np.zeros(0),
        pendulum_angle=np.zeros(0),
        backswing=None,
        position_std=std,
    )


def trial_of(
    name: str, measured: ClipMeasurement, setup: Setup, about: ClipFacts | None = None
) -> tuple[Trial, list[str]]:
    """One clip's tracks as a trial, with notes on what was assumed.

    Raises
    ------
    NotFoundError
        If no strike could be measured in the clip.
    """
    facts = about or ClipFacts()
    if measured.impact is None:
        raise NotFoundError(
            f"{name}: no strike could be measured in this clip",
            hint="vision measure says what is missing.",
        )
    tracks = measured.impact.tracks
    notes = list(measured.warnings[:MOST_WARNINGS])
    named = setup.balls.get(facts.ball or "", setup.ball)
    rest_height = 0.0
    if setup.support is not None:
        radius = 0.5 * named.diameter if named is not None else tracks.radius_m
        rest_height = setup.support.height + radius
    # What bounces is no flight any more.
    flying = tracks.ball_time_s <= measured.impact.last_flight_s + 1e-9
    moved = (tracks.ball_m - tracks.rest_m + np.array([0.0, rest_height]))[flying]
    blank = np.full(moved.shape[0], np.nan)
    covariance = tracks.ball_cov_m2[flying]
    std = np.sqrt(np.stack([covariance[:, 0, 0], covariance[:, 1, 1]], axis=1))
    backswing = facts.backswing
    if backswing is None:
        backswing, said = _backswing(measured, setup)
        notes += said
    ball = facts.ball or (None if setup.ball is None else setup.ball.name)
    trial = Trial(
        name, tracks.ball_time_s[flying], np.column_stack([moved, blank]), tracks.swing_time_s,
        tracks.swing_rad, ball, backswing, np.column_stack([std, blank]),
    )  # fmt: skip
    return trial, notes


def _backswing(measured: ClipMeasurement, setup: Setup) -> tuple[float | None, list[str]]:
    angle = measured.quantity("backswing_angle")
    if angle.value is not None:
        return math.radians(angle.value), []
    speed = measured.quantity("pendulum_speed_before").value
    contact = None if setup.ball is None else setup.ball.launch_angle
    if setup.pendulum is None or speed is None or contact is None:
        return None, []
    note = "the back-swing is not in view; taken from the speed before contact"
    return _lossless_backswing(setup.pendulum, speed, contact), [note]


def _lossless_backswing(pendulum: Pendulum, speed: float, contact: float) -> float:
    rate = speed / pendulum.length
    drop = rate**2 * pendulum.inertia / (2.0 * pendulum.mass * GRAVITY * pendulum.com)
    return math.acos(float(np.clip(math.cos(contact) - drop, -1.0, 1.0)))
