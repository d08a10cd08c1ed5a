"""Clips as a campaign: notes, ignored clips, assumptions."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from measuring.setup.file import read_setup
from metrology import (
    ClipError,
    Contribution,
    NotFoundError,
    Quantity,
    UncertaintySource,
    UsageError,
)
from mismatch import EngineVerdict
from mismatch.verdict import Location, NamedEffect, ParameterValue, Remainder
from physics.bodies import PAPER_PENDULUM
from physics.effects import Level
from pipelines.explain.clips import (
    ClipFacts,
    calibration_widths,
    campaign_from_clips,
    clear_interval,
    clip_facts,
    common_widths,
    has_rig,
    outline_fractions,
    with_rig,
    within_calibration,
)

SETUP = read_setup('[ball]\npreset = "jokku"\n')


def measured(speed: float | None = 2.0, backswing_deg: float | None = None):
    """A measurement as the chain hands it over: at rest, struck at 0.1 s, in flight to 0.4 s."""
    time = np.arange(0.0, 0.5, 0.01)
    flying = np.maximum(time - 0.1, 0.0)
    path = np.stack([0.7 + 3.0 * flying, 1.1 + flying - 4.9 * flying**2], axis=1)
    frames = np.arange(time.size) + 7
    px = np.column_stack([500.0 * path[:, 0], 500.0 * (1.7 - path[:, 1])])
    tracks = SimpleNamespace(
        ball_time_s=time, ball_frame=frames, ball_m=path, rest_m=np.array([0.7, 1.1]), radius_m=0.1,
        ball_cov_m2=np.broadcast_to(np.diag([1e-6, 4e-6]), (time.size, 2, 2)),
        swing_time_s=time[:20], swing_rad=np.linspace(-0.5, 0.3, 20),
        rest_std_m=np.array([1e-3, 3e-3]),
    )  # fmt: skip
    impact = SimpleNamespace(
        tracks=tracks, last_flight_s=0.4, flight=SimpleNamespace(time_s=time[(time > 0.12)])
    )

    def quantity(name: str) -> Quantity:
        seen = {"pendulum_speed_before": speed, "backswing_angle": backswing_deg, "ball_speed": 3.0}
        value = seen[name]
        if value is None:
            return Quantity.missing(name, "1", "not in view")
        budget = {
            UncertaintySource.BALL_DIAMETER: 0.06, UncertaintySource.CAMERA_SLANT: 0.08,
            UncertaintySource.CAMERA_ROLL: 0.5,
        }  # fmt: skip
        parts = tuple(Contribution(source, std) for source, std in budget.items())
        return Quantity.measured(name, value, "1", parts)

    rate = SimpleNamespace(fps=600.0, std=0.6)
    seen = SimpleNamespace(
        ball=SimpleNamespace(frame=frames, centre_px=px, radius_px=np.full(time.size, 50.0)),
        background=np.random.default_rng(3).normal(180.0, 4.0, (600, 1000)).astype(np.float32),
        pendulum=SimpleNamespace(pivot_covariance_px2=np.diag([4.0, 9.0]), arm_px=250.0),
    )
    return SimpleNamespace(
        impact=impact, warnings=("a", "b", "c", "d"), quantity=quantity, rate=rate,
        calibration=None, tracks=seen,
    )  # fmt: skip


def chain(answers):
    def measure(path, options):
        answer = answers[path.stem]
        if isinstance(answer, Exception):
            raise answer
        return answer

    return measure


def test_tracks_are_told_from_the_ball_at_rest_and_end_where_the_flight_does():
    """At 0.14 s, the first row a radius off: 12 cm on, and up by 4 cm less 4.9 × 0.04²."""
    answers = chain({"one": measured()})
    campaign = campaign_from_clips([Path("one.mp4")], SETUP, None, answers, strikes=True)
    trial = campaign.trials[0]
    rig = with_rig(SETUP)
    height = rig.support.height + 0.201750 / 2
    assert trial.ball_time[0] == pytest.approx(0.14)
    assert trial.position[0, :2] == pytest.approx([0.12, height + 0.04 - 4.9 * 0.04**2])
    assert trial.ball_time[-1] == pytest.approx(0.4)
    assert trial.position_std[3, :2].tolist() == pytest.approx([1e-3, 2e-3])
    assert rig.pendulum is PAPER_PENDULUM


def test_a_backswing_is_told_seen_or_taken_from_the_speed_in_that_order():
    clips = [Path("a.mp4"), Path("b.mp4"), Path("c.mp4")]
    answers = {"a": measured(backswing_deg=50.0), "b": measured(backswing_deg=50.0),
               "c": measured()}  # fmt: skip
    facts = {"a": ClipFacts(math.radians(61.0))}
    campaign = campaign_from_clips(clips, SETUP, facts, chain(answers), strikes=True)
    angles = [math.degrees(trial.backswing) for trial in campaign.trials]
    assert angles[:2] == pytest.approx([61.0, 50.0])
    assert 45.0 < angles[2] < 60.0
    assert any("speed before contact" in note for note in campaign.notes)


def test_a_clip_that_fails_is_left_out_and_said_so():
    clips = [Path("good.mp4"), Path("torn.mp4"), Path("empty.mp4")]
    answers = {
        "good": measured(),
        "torn": ClipError("the file ends too early"),
        "empty": replace_impact(None),
    }
    campaign = campaign_from_clips(clips, SETUP, None, chain(answers))
    assert [trial.name for trial in campaign.trials] == ["good"]
    assert "torn.mp4 could not be measured" in campaign.notes[0]
    assert "the file ends too early" in campaign.notes[0]
    assert "empty.mp4" in campaign.notes[1]


def replace_impact(impact):
    nothing = measured()
    nothing.impact = impact
    return nothing


def test_when_every_clip_fails_the_first_reason_is_raised():
    answers = {"a": ClipError("no such file"), "b": NotFoundError("nothing moves")}
    with pytest.raises(ClipError, match="no such file"):
        campaign_from_clips([Path("a.mp4"), Path("b.mp4")], SETUP, None, chain(answers))


def test_without_a_backswing_flights_alone_are_compared():
    answers = {"a": measured(speed=None), "b": measured()}
    campaign = campaign_from_clips([Path("a.mp4"), Path("b.mp4")], SETUP, None, chain(answers))
    for trial in campaign.trials:
        assert trial.backswing is None
        assert trial.ball_time[0] > 0.12
        assert trial.pendulum_time.size == 0
    assert "flights are compared" in campaign.notes[0]
    bare = replace(SETUP, ball=replace(SETUP.ball, cor=None))
    campaign = campaign_from_clips([Path("b.mp4")], bare, None, chain(answers), strikes=True)
    assert campaign.trials[0].backswing is None


def test_strikes_are_compared_only_where_that_is_asked_for():
    answers = chain({"b": measured(backswing_deg=50.0)})
    flights = campaign_from_clips([Path("b.mp4")], SETUP, None, answers)
    strikes = campaign_from_clips([Path("b.mp4")], SETUP, None, answers, strikes=True)
    assert flights.trials[0].backswing is None
    assert "--strikes" in flights.notes[0]
    assert strikes.trials[0].backswing == pytest.approx(math.radians(50.0))
    # The ball needs 10 ms from its release to be clear; as long before that none has touched it.
    assert 0.0 < strikes.trials[0].pendulum_time[-1] < 0.12


def test_strikes_are_compared_by_default_only_of_a_stated_rig():
    pendulum = (
        '[pendulum]\nlength = "0.55 m"\ninertia = "1.6 kg m^2"\nmass = "6 kg"\ncom = "0.45 m"\n'
    )
    support = '[support]\nheight = "0.3 m"\n'
    assert has_rig(read_setup(pendulum + support))
    assert not has_rig(read_setup(pendulum))
    assert not has_rig(read_setup(support))


def test_a_clip_belongs_to_the_session_that_its_table_says():
    facts = {"b": ClipFacts(math.radians(50.0), session="Monday")}
    campaign = campaign_from_clips([Path("b.mp4")], SETUP, facts, chain({"b": measured()}))
    assert campaign.trials[0].session == "Monday"


def test_a_strike_leaves_open_what_its_clip_leaves_open():
    """Two millimetres a pixel: the axis to two and three pixels, the rest as it is measured."""
    answers = chain({"a": measured(), "b": measured()})
    clips = [Path("a.mp4"), Path("b.mp4")]
    campaign = campaign_from_clips(clips, SETUP, None, answers, strikes=True)
    found = {p.name: p for fault in campaign.instruments for p in fault.parameters}
    told = {"pivot_x": 4e-3, "pivot_y": 6e-3, "offset_x": 1e-3, "offset_y": 3e-3}
    assert {name: found[name].width for name in told} == pytest.approx(told)
    widths = calibration_widths(answers(Path("a.mp4"), None))
    assert found["scale_error"].width == pytest.approx(widths["length_scale"])
    assert widths["length_scale"] == pytest.approx(0.1 / 3.0)
    # Nothing has measured how a camera without a grid stands: by eye, to a degree.
    assert "camera_roll" not in widths
    assert found["roll"].width == pytest.approx(math.radians(1.0))
    assert campaign.assumed == {"roll_of_the_clip"}
    assert found["sine_2"].width == pytest.approx(1.0 / 250.0)
    assert all(p.is_held for p in found.values())


@pytest.mark.parametrize("strikes", [False, True])
def test_a_centre_may_be_off_by_what_is_stated_of_it(strikes):
    """One millimetre along and two up: slowly in each clip, and alike in all where they pass."""
    answers = chain({"a": measured(), "b": measured()})
    clips = [Path("a.mp4"), Path("b.mp4")]
    campaign = campaign_from_clips(clips, SETUP, None, answers, strikes=strikes)
    for fault in campaign.instruments[:2]:
        for p in fault.parameters:
            assert p.width == pytest.approx(1e-3 if p.name.startswith("along_") else 2e-3)
    assert [Level.TRIAL in fault.levels for fault in campaign.instruments[:2]] == [True, False]
    bare = measured()
    bare.tracks.pendulum = None
    answers = chain({"a": measured(), "b": bare})
    assert len(campaign_from_clips(clips, SETUP, None, answers).instruments) == 2


def test_a_flight_is_compared_where_the_wall_alone_is_behind_the_ball():
    """From a camera at 1.4 m, 4 m off, the foot of the wall is seen 0.175 m high half a metre
    nearer."""
    clip = measured()
    tracks, rig = clip.impact.tracks, with_rig(SETUP)
    floor = tracks.rest_m[1] - rig.support.height - tracks.radius_m
    foot = floor + 1.4 * 0.5 / 4.0
    clip.calibration = SimpleNamespace(
        camera=SimpleNamespace(position=np.array([0.8, floor + 1.4, 4.0])),
        ball_plane_offset=0.5, camera_distance=4.0,
    )  # fmt: skip
    clip.impact.last_flight_s = 0.49
    flown = clear_interval(clip, rig)
    lowest = tracks.ball_m[:, 1] - tracks.radius_m
    seen = tracks.ball_time_s[lowest >= foot]
    away = np.hypot(*(tracks.ball_m - tracks.rest_m).T)
    assert flown[0] == tracks.ball_time_s[away > tracks.radius_m][0]
    assert flown[1] == pytest.approx(seen[-1] + 0.01)


@pytest.mark.parametrize("edge", [False, True])
def test_without_a_camera_the_picture_tells_where_the_floor_begins(edge):
    """A picture of 500 px a metre, whose lowest part, from 0.94 m down, is darker than the rest."""
    clip, rig = measured(), with_rig(SETUP)
    tracks = clip.impact.tracks
    clip.tracks.background[380:] -= 60.0 * edge
    # What stands on the wall midway is no surface that it stays before.
    clip.tracks.background[:250, 600:640] -= 80.0
    end = clear_interval(clip, rig)[1]
    if not edge:
        assert end == math.inf
        return
    covers = tracks.ball_m[:, 1] - tracks.radius_m < 0.94
    expected = tracks.ball_time_s[covers & (tracks.ball_time_s > 0.2)][0]
    assert end == pytest.approx(expected, abs=0.011)


def test_two_clips_of_one_name_are_refused():
    with pytest.raises(UsageError, match="two clips"):
        campaign_from_clips([Path("x/a.mp4"), Path("y/a.mp4")], SETUP, None, chain({}))


def test_a_table_of_clips_is_read_by_name_without_ending(tmp_path):
    table = tmp_path / "trials.csv"
    table.write_text("clip,backswing_deg,ball,session\nfilms/a.mp4,60,jokku,1\nb,,,\n")
    facts = clip_facts(table)
    assert facts["a"] == ClipFacts(math.radians(60.0), "jokku", "1")
    assert facts["b"] == ClipFacts()
    table.write_text("film,angle\na,1\n")
    with pytest.raises(UsageError, match="columns"):
        clip_facts(table)


def _named(identity: str, name: str, value: float) -> EngineVerdict:
    effect = NamedEffect(identity, "…", 0.9, (ParameterValue(name, value, 1e-4, "1"),))
    location = Location("measurement", None, None, "horizontal", "…")
    return EngineVerdict(
        "explained", ("gravity",), 2.0, location, (effect,), (), (), None, None,
        Remainder(True, "…"),
    )  # fmt: skip


def test_an_error_that_the_calibration_allows_is_no_finding():
    widths = common_widths([calibration_widths(measured()), calibration_widths(measured())])
    assert widths["time_base"] == pytest.approx(0.001)
    inside = within_calibration(_named("time_base", "rate_error", 0.002), widths)
    assert inside.verdict == "no_mismatch"
    assert not inside.effects
    assert "is not significant" in inside.notes[-1]
    outside = within_calibration(_named("time_base", "rate_error", 0.017), widths)
    assert outside.verdict == "explained"
    assert outside.effects
    physics = within_calibration(_named("wind", "wind_x", 0.001), widths)
    assert physics.effects
    assert "uncertainty of the calibration" in physics.notes[-1]


def test_an_outline_that_wanders_matters_the_more_the_smaller_the_picture():
    path = np.array([[10.0, 80.0], [110.0, 50.0], [210.0, 110.0]])
    along, fall = outline_fractions(path)
    assert (along, fall) == pytest.approx((0.15 / 200.0, 0.15 / 60.0))
    assert outline_fractions(0.5 * path) == pytest.approx((2.0 * along, 2.0 * fall))
    assert outline_fractions(path[:1]) == (1.0, 1.0)
