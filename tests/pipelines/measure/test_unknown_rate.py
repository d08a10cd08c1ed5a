"""A capture rate that nobody says: measured from the fall, or nothing in seconds."""

import math
from dataclasses import replace

import numpy as np
import pytest

from calib.grid import WallGrid
from calib.solve import planned_grid
from pipelines.calibrate.plan import Filming, film_scene, planned_setup, planned_tracks
from pipelines.measure import metres
from pipelines.measure.chain import FollowedClip, Found, measure_tracks
from pipelines.measure.inputs import gather_inputs
from pipelines.report import CheckKind, CheckOutcome
from sample_videos import Shot
from vision.clip.footage import CaptureRate, RateSource
from vision.tracks import Motion, MotionKind

TRUE_FPS = 300.0
FILMING = Filming(width=432, height=240, tape_std_m=0.005, fps=TRUE_FPS)
SECONDS = ("contact_time", "ball_speed", "landing_time", "external_impulse", "cor_speeds")


def found_at(fps: float, std: float, monkeypatch: pytest.MonkeyPatch) -> tuple[Found, Shot]:
    """What the chain makes of a stroke filmed at 300 fps, told to be at another rate."""
    scene, shot = film_scene(FILMING)
    grid = planned_grid(scene.camera)

    def seen(*_: object, **__: object) -> WallGrid:
        return grid

    monkeypatch.setattr(metres, "find_wall_grid", seen)
    tracks = planned_tracks(FILMING, scene, shot)
    tracks = replace(tracks, motion=Motion(MotionKind.STRIKE, 0.9))
    clock = np.arange(scene.frames, dtype=float)
    source = RateSource.OPTION if math.isfinite(std) else RateSource.ASSUMED
    inputs = gather_inputs(planned_setup(FILMING, scene), None, None)
    return measure_tracks(FollowedClip(tracks, clock, CaptureRate(fps, std, source), inputs)), shot


def test_a_fall_with_a_known_scale_tells_the_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    found, shot = found_at(600.0, math.inf, monkeypatch)
    assert found.rate.known
    assert abs(found.rate.fps - TRUE_FPS) < 3.0 * found.rate.std < 0.1 * TRUE_FPS
    by_name = {item.name: item for item in found.results.quantities}
    speed = by_name["ball_speed"]
    assert speed.value is not None
    assert speed.std is not None
    assert abs(speed.value - float(shot.contact.outcome.ball_speed)) < 3.0 * speed.std
    assert any("FREE FALL" in warning for warning in found.warnings)
    gravity = next(one for one in found.results.checks if one.kind is CheckKind.GRAVITY)
    assert gravity.outcome is not CheckOutcome.PASSED


def test_without_a_scale_nothing_is_given_in_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, shot = film_scene(FILMING)
    tracks = replace(
        planned_tracks(FILMING, scene, shot),
        motion=Motion(MotionKind.STRIKE, 0.9),
        background=np.zeros((240, 432), np.float32),
    )
    inputs = gather_inputs(replace(planned_setup(FILMING, scene), ball=None), None, None)
    clock = np.arange(scene.frames, dtype=float)
    rate = CaptureRate(600.0, math.inf, RateSource.ASSUMED)
    found = measure_tracks(FollowedClip(tracks, clock, rate, inputs))
    assert not found.rate.known
    by_name = {item.name: item for item in found.results.quantities}
    for name in SECONDS:
        assert by_name[name].value is None
        assert by_name[name].reason
    assert "--fps" in str(by_name["contact_time"].reason)


def test_a_rate_said_wrongly_is_contradicted_by_the_fall(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = found_at(240.0, 0.1, monkeypatch)
    by_name = {item.name: item for item in found.results.quantities}
    assert by_name["ball_speed"].value is None
    assert by_name["cor"].value is None


def test_a_path_that_shows_no_fall_and_no_strike_is_no_flight() -> None:
    scene, shot = film_scene(FILMING)
    tracks = planned_tracks(FILMING, scene, shot)
    assert tracks.rest_frames is not None
    first = tracks.rest_frames[1]
    few = tracks.ball.frame < first + 18
    tracks = replace(tracks, ball=tracks.ball.where(few), pendulum=None)
    inputs = gather_inputs(planned_setup(FILMING, scene), None, None)
    clock = np.arange(scene.frames, dtype=float)
    rate = CaptureRate(TRUE_FPS, 0.1, RateSource.OPTION)
    found = measure_tracks(FollowedClip(tracks, clock, rate, inputs))
    by_name = {item.name: item for item in found.results.quantities}
    gravity = found.results.gravity
    assert gravity.std is None or gravity.std > 4.9
    assert by_name["ball_speed"].value is None
    assert by_name["launch_angle"].value is None
