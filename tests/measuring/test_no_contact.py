"""Contacts that no frame rate resolves, and paths between which there was none."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from measuring.results import Results
from metrology import Quantity
from pipelines.calibrate.plan import planned_tracks
from sample_videos import Scene, Shot
from sample_videos.shot import HermiteCurve
from tests.measuring.planned_stroke import (
    FILMING,
    TRUE_FPS,
    inputs_as_planned,
    measured,
    planned,
    tracks_as_planned,
)
from vision.clip.footage import CaptureRate, RateSource
from vision.tracks import Motion, MotionKind, Tracks

TIMES = ("contact_time", "contact_end", "contact_frames")


class CutOut(HermiteCurve):
    """A curve that is at `release` as it was at first touch, and goes on from there at `leaves`."""

    def __init__(self, whole: HermiteCurve, release: float, leaves: float) -> None:
        self.whole, self.release, self.leaves = whole, release, leaves

    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        time = np.asarray(times, dtype=np.float64)
        gone = self.whole.at([self.release]) - self.whole.at([0.0])
        before = self.whole.at(np.minimum(time, 0.0))
        after = self.whole.at(np.maximum(time - self.leaves, 0.0) + self.release) - gone
        return np.where(time[:, np.newaxis] < self.leaves, before, after)


def struck_at_once(scene: Scene, shot: Shot, early_s: float) -> Tracks:
    """The strike with its contact cut out; the ball leaves `early_s` before the mass is there."""
    release, motion = float(shot.contact.time[-1]), shot.motion
    motion = replace(
        motion,
        ball=CutOut(motion.ball, release, -early_s),
        pendulum=CutOut(motion.pendulum, release, 0.0),
    )
    tracks = planned_tracks(FILMING, scene, replace(shot, motion=motion))
    assert tracks.rest_frames is not None
    return replace(tracks, rest_frames=(0, tracks.rest_frames[1] - int(early_s * FILMING.fps) - 1))


def results(
    monkeypatch: pytest.MonkeyPatch,
    change: Callable[[Tracks], Tracks],
    early_s: float | None = None,
) -> Results:
    """Results of a strike, or of one whose contact was cut out, after a change."""
    tracks = tracks_as_planned() if early_s is None else struck_at_once(*planned(), early_s)
    inputs = inputs_as_planned()
    assert inputs.ball is not None
    # an angle at which the bar is set up to strike would tell where the face is
    unsaid = replace(inputs.rig, launch_angle=None)
    inputs = replace(inputs, ball=replace(inputs.ball, launch_angle=None), rig=unsaid)
    rate = CaptureRate(FILMING.fps, 0.1, RateSource.OPTION)
    return measured(change(tracks), rate, inputs, monkeypatch).results


def told(
    monkeypatch: pytest.MonkeyPatch,
    change: Callable[[Tracks], Tracks],
    early_s: float | None = None,
) -> dict[str, Quantity]:
    """Its quantities and what stands beside them, by name."""
    found = results(monkeypatch, change, early_s)
    everything = (*found.quantities, *found.other_speeds, found.gravity)
    return {item.name: item for item in everything}


def as_it_is(tracks: Tracks) -> Tracks:
    return tracks


def test_a_contact_too_short_for_the_frame_rate_gets_a_bound_and_no_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = told(monkeypatch, as_it_is, 0.0)
    for name in TIMES:
        assert found[name].value is None
        assert "too short for this frame rate" in str(found[name].reason)
    for name in ("contact_start", "ball_speed", "cor_speeds"):
        assert found[name].value is not None
        assert found[name].std


def test_a_mass_that_would_part_before_it_meets_did_not_strike_or_not_this(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = told(monkeypatch, as_it_is, 0.03)
    for name in (*TIMES, "cor_speeds", "pendulum_speed_after"):
        assert found[name].value is None
        assert "before it meets" in str(found[name].reason)
    # the flight does not depend on which object struck the ball
    speed, (_, shot) = found["ball_speed"], planned()
    assert speed.value == pytest.approx(float(shot.contact.outcome.ball_speed), abs=4 * speed.std)


def test_where_the_mass_is_hardly_seen_after_the_contact_the_flight_alone_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def blurred(tracks: Tracks) -> Tracks:
        swing, rest = tracks.pendulum, tracks.rest_frames
        assert swing is not None
        assert rest is not None
        unsure = np.where(swing.track.frame > rest[1], 3000.0, 1.0) * swing.angle_std_rad
        stray = np.random.default_rng(3).normal(0.0, 1.0, len(unsure))
        return replace(
            tracks,
            pendulum=replace(
                swing, angle_rad=swing.angle_rad + unsure * stray, angle_std_rad=unsure
            ),
        )

    found = told(monkeypatch, blurred)
    for name in ("cor_speeds", "cor", "pendulum_speed_after", "energy_loss", "contact_start"):
        assert found[name].value is None
        assert "not resolved" in str(found[name].reason)
    assert found["ball_speed"].value is not None


def test_a_contact_in_which_the_ball_is_hidden_is_told_from_both_sides(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def hidden(tracks: Tracks) -> Tracks:
        onset = tracks.rest_frames[1] / FILMING.fps if tracks.rest_frames else 0.0
        seen = np.abs(tracks.ball.time_s - onset) > 0.03
        return replace(tracks, ball=tracks.ball.where(seen))

    found = told(monkeypatch, hidden)
    assert found["ball_speed"].value is not None


def test_what_does_not_fall_freely_was_not_struck_either(monkeypatch: pytest.MonkeyPatch) -> None:
    def unsteady(tracks: Tracks) -> Tracks:
        assert tracks.rest_frames is not None
        mostly_rest = tracks.ball.frame < tracks.rest_frames[1] + 18
        ball = tracks.ball.where(mostly_rest)
        return replace(tracks, ball=ball, motion=Motion(MotionKind.FLIGHT, 0.7))

    found = told(monkeypatch, unsteady)
    for name in ("ball_speed", "cor_speeds", "contact_time"):
        assert found[name].value is None


def test_gravity_is_told_only_of_a_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    assert told(monkeypatch, lambda tracks: tracks)["gravity_check"].known
    nothing = Motion(MotionKind.NONE, 0.9)
    unseen = told(monkeypatch, lambda tracks: replace(tracks, motion=nothing))["gravity_check"]
    assert unseen.value is None
    assert "it needs a flight" in str(unseen.reason)


def test_of_what_is_no_motion_nothing_is_checked_and_no_strike_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nothing = Motion(MotionKind.NONE, 0.9)
    found = results(monkeypatch, lambda tracks: replace(tracks, motion=nothing))
    assert found.checks == ()
    assert not any(item.known for item in found.quantities)


def test_a_clip_that_begins_in_mid_flight_shows_no_strike() -> None:
    tracks = tracks_as_planned()
    assert tracks.rest_frames is not None
    begins = tracks.rest_frames[1] + 20
    ball = tracks.ball.where(tracks.ball.frame >= begins)
    first = int(ball.frame[0])
    found = measured(
        replace(tracks, ball=ball, rest_frames=(first, first), pendulum=None),
        CaptureRate(TRUE_FPS, 0.1, RateSource.OPTION),
    )
    by_name = {item.name: item for item in found.results.quantities}
    assert by_name["ball_speed"].value is None
    assert by_name["landing_distance"].value is None
    assert "from the first frame on" in str(by_name["ball_speed"].reason)
