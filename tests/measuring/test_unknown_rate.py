"""A capture rate that nobody says: measured from the fall, or nothing in seconds."""

import math
from dataclasses import replace

import numpy as np
import pytest

from measuring.chain import Found
from measuring.checks import CheckKind, CheckOutcome
from measuring.inputs import gather_inputs
from pipelines.calibrate.plan import planned_setup
from tests.measuring.planned_stroke import (
    FILMING,
    TRUE_FPS,
    measured,
    planned,
    tracks_as_planned,
)
from vision.clip.footage import CaptureRate, RateSource
from vision.tracks import Motion, MotionKind

SECONDS = ("contact_time", "ball_speed", "landing_time", "external_impulse", "cor_speeds")


def found_at(fps: float, std: float, monkeypatch: pytest.MonkeyPatch) -> Found:
    """Results of a strike filmed at 300 fps with another rate given."""
    tracks = replace(tracks_as_planned(), motion=Motion(MotionKind.STRIKE, 0.9))
    source = RateSource.OPTION if math.isfinite(std) else RateSource.ASSUMED
    return measured(tracks, CaptureRate(fps, std, source), grid_for=monkeypatch)


def test_a_fall_with_a_known_scale_tells_the_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    found = found_at(600.0, math.inf, monkeypatch)
    assert found.rate.known
    assert abs(found.rate.fps - TRUE_FPS) < 3.0 * found.rate.std < 0.1 * TRUE_FPS
    by_name = {item.name: item for item in found.results.quantities}
    speed = by_name["ball_speed"]
    assert speed.value is not None
    assert speed.std is not None
    assert abs(speed.value - float(planned()[1].contact.outcome.ball_speed)) < 3.0 * speed.std
    assert any("Estimated from gravity" in one.sentence for one in found.assumed)
    gravity = next(one for one in found.results.checks if one.kind is CheckKind.GRAVITY)
    assert gravity.outcome is not CheckOutcome.PASSED


def test_without_a_scale_nothing_is_given_in_seconds() -> None:
    tracks = replace(
        tracks_as_planned(),
        motion=Motion(MotionKind.STRIKE, 0.9),
        background=np.zeros((240, 432), np.float32),
    )
    inputs = gather_inputs(replace(planned_setup(FILMING, planned()[0]), ball=None), None, None)
    found = measured(tracks, CaptureRate(600.0, math.inf, RateSource.ASSUMED), inputs)
    assert not found.rate.known
    by_name = {item.name: item for item in found.results.quantities}
    for name in SECONDS:
        assert by_name[name].value is None
        assert by_name[name].reason
    assert "--fps" in str(by_name["contact_time"].reason)


def test_a_rate_said_wrongly_is_contradicted_by_the_fall(monkeypatch: pytest.MonkeyPatch) -> None:
    found = found_at(240.0, 0.1, monkeypatch)
    by_name = {item.name: item for item in found.results.quantities}
    assert by_name["ball_speed"].value is None
    assert by_name["cor"].value is None


def test_a_path_that_shows_no_fall_and_no_strike_is_no_flight() -> None:
    tracks = tracks_as_planned()
    assert tracks.rest_frames is not None
    first = tracks.rest_frames[1]
    few = tracks.ball.frame < first + 18
    tracks = replace(tracks, ball=tracks.ball.where(few), pendulum=None)
    found = measured(tracks, CaptureRate(TRUE_FPS, 0.1, RateSource.OPTION))
    by_name = {item.name: item for item in found.results.quantities}
    gravity = found.results.gravity
    assert gravity.std is None or gravity.std > 4.9
    assert by_name["ball_speed"].value is None
    assert by_name["launch_angle"].value is None
