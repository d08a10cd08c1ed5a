"""What the page displays of a measurement: numbers with their standing, graphs, outlines."""

import json
import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from measuring.chain import measure_clip
from measuring.checker.scene import Finding
from measuring.checks import Check, CheckKind, CheckOutcome
from measuring.inputs import (
    TIMELESS_UNITS,
    Assumption,
    gather_inputs,
    quantities_except,
)
from measuring.measurement import ClipMeasurement
from measuring.setup.file import Setup
from metrology.quantity import UncertaintySource
from physics.bodies import GRAVITY
from pipelines.api.quantities import measure_options
from pipelines.app.figures import Standing, figures_of
from pipelines.app.graphs import MAX_POINTS, graphs_of
from pipelines.app.marks import MAX_CANDIDATES, marks_of
from pipelines.app.words import hint_of, on_page, says, translated
from tests.pipelines.app.small import CLIP, strike
from vision.stages import candidate_table


def _sure(probability: float = 1.0) -> ClipMeasurement:
    """The small strike, its kind of motion that probable."""
    tracks = strike().tracks
    motion = replace(tracks.motion, probability=probability)
    return replace(strike(), tracks=replace(tracks, motion=motion))


def _standings(**changes: object) -> dict[str, tuple[Standing, str]]:
    nothing: dict[str, object] = {"findings": (), "checks": (), "assumed": ()}
    measured = replace(_sure(), **{**nothing, **changes})
    return {one.name: (one.standing, one.why) for one in figures_of(measured)}


def test_the_main_numbers_come_first_and_those_without_a_value_last() -> None:
    figures = figures_of(_sure())
    assert [one.name for one in figures[:3]] == [
        "contact_time",
        "pendulum_speed_before",
        "ball_speed",
    ]
    known = [bool(one.value) for one in figures]
    assert known == sorted(known, reverse=True)
    # other motions' numbers are not listed
    assert not any(one.name == "swing_period" for one in figures)
    speed = next(one for one in figures if one.name == "ball_speed")
    quantity = strike().quantity("ball_speed")
    assert float(speed.value) == pytest.approx(quantity.value, abs=quantity.std)
    assert (speed.unit, speed.standing) == ("m/s", Standing.SOUND)
    assert 0.9 < sum(part for _, _, part in speed.budget) < 1.1
    assert [part for _, _, part in speed.budget] == sorted(
        (part for _, _, part in speed.budget), reverse=True
    )


def _assumed(found: dict[str, tuple[Standing, str]]) -> set[str]:
    return {name for name, (kind, _) in found.items() if kind is Standing.ASSUMED}


def test_what_is_assumed_marks_the_numbers_that_it_concerns() -> None:
    no_pendulum = gather_inputs(Setup(), "jokku", "50mm").assumed[0]
    assert "No pendulum given" in no_pendulum.sentence
    found = _standings(assumed=(no_pendulum,))
    concerned = {"cor_speeds", "cor_launch", "cor_range", "cor", "external_impulse", "energy_loss"}
    known = {name for name, (kind, _) in found.items() if kind is not Standing.MISSING}
    assert _assumed(found) == concerned & known
    rate = Assumption("600 fps is assumed.", quantities_except(TIMELESS_UNITS))
    timed = _assumed(_standings(assumed=(rate,)))
    assert {"ball_speed", "contact_time"} <= timed
    assert not timed & {"launch_angle", "cor_speeds", "landing_distance"}


def test_numbers_of_a_doubtful_kind_of_motion_are_no_sound_ones() -> None:
    found = _standings(tracks=_sure(0.6).tracks)
    assert Standing.SOUND not in {kind for kind, _ in found.values()}
    assert "probability of only 0.60" in found["ball_speed"][1]


def test_a_contradiction_marks_what_depends_on_the_wrong_input() -> None:
    rate = _standings(findings=(Finding("rate", "The rate is 240 fps.", "--fps 240"),))
    assert rate["ball_speed"] == (Standing.CONTRADICTED, "The rate is 240 fps.")
    assert rate["launch_angle"][0] is Standing.SOUND
    size = _standings(findings=(Finding("ball", "The ball is 0.22 m.", "--ball 220mm"),))
    assert size["ball_speed"][0] is Standing.CONTRADICTED
    assert size["contact_time"][0] is Standing.SOUND
    missing = _standings(findings=(Finding("facts", "No scale.", ""),))
    assert Standing.CONTRADICTED not in {kind for kind, _ in missing.values()}


def test_a_failed_check_marks_its_numbers() -> None:
    failed = Check(CheckKind.CONTACT_BOUND, CheckOutcome.FAILED, "too long")
    found = _standings(checks=(failed,))
    assert found["contact_time"] == (Standing.CONTRADICTED, "too long")
    assert found["ball_speed"][0] is Standing.SOUND
    passed = replace(failed, outcome=CheckOutcome.PASSED)
    assert _standings(checks=(passed,))["contact_time"][0] is Standing.SOUND


def test_graphs_hold_the_track_and_each_point_its_frame() -> None:
    measured = strike()
    graphs = {one.name: one for one in graphs_of(measured)}
    assert set(graphs) == {"gap", "path", "position", "speed", "angle"}
    ball = measured.tracks.ball
    points = {row[2]: row for row in graphs["position"].series[0]["data"]}
    row = int(np.searchsorted(ball.frame, ball.frame[len(ball) // 2]))
    assert points[float(ball.frame[row])][0] == pytest.approx(ball.time_s[row], rel=1e-5)
    start, end = (measured.quantity(name).value for name in ("contact_start", "contact_end"))
    gap = np.array(graphs["gap"].series[0]["data"])
    inside = (gap[:, 0] > start) & (gap[:, 0] < end)
    assert gap[inside, 1].mean() < gap[~inside, 1].mean()
    assert np.all(np.abs(gap[:, 2] / measured.rate.fps - gap[:, 0]) < 1.0 / measured.rate.fps)
    for graph in graphs.values():
        assert all(len(part["data"]) <= MAX_POINTS for part in graph.series)
        json.dumps(graph.options(), allow_nan=False)
    path = graphs["path"].options()
    spans = [path[axis]["max"] - path[axis]["min"] for axis in ("xAxis", "yAxis")]
    assert spans[0] == pytest.approx(spans[1], rel=0.05)


def test_outlines_lie_where_the_tracks_are() -> None:
    measured = strike()
    found = measured.tracks.found
    assert found is not None
    document = marks_of(measured, candidate_table(found))
    json.dumps(document, allow_nan=False)
    ball = document["objects"][0]
    assert (ball["kind"], ball["frame"][0]) == ("ball", int(measured.tracks.ball.frame[0]))
    assert ball["x"][0] == pytest.approx(measured.tracks.ball.centre_px[0, 0], abs=0.01)
    start = measured.quantity("contact_start").value
    assert start is not None
    assert abs(document["contact"][0] / measured.rate.fps - start) < 1.0 / measured.rate.fps
    assert [one["name"] for one in document["events"]] == ["contact", "landing"]
    assert sum(one["measured"] for one in document["candidates"]) == 1
    assert len(document["candidates"]) <= MAX_CANDIDATES


def test_outlines_of_a_moving_camera_are_those_of_the_frames() -> None:
    measured = strike()
    still = marks_of(measured)["objects"][0]
    shift = np.tile([3.0, -2.0], (measured.info.frames, 1))
    moving = replace(measured, tracks=replace(measured.tracks, shift_px=shift))
    moved = marks_of(moving)["objects"][0]
    assert np.allclose(np.subtract(moved["x"], still["x"]), 3.0, atol=0.011)
    assert np.allclose(np.subtract(moved["y"], still["y"]), -2.0, atol=0.011)
    assert marks_of(None)["objects"] == []


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        (
            "estimated from gravity. Pass --fps RATE, or set capture_fps in the setup file.",
            "Estimated from gravity. Use “Capture rate”, or set capture_fps in the setup file.",
        ),
        ("pass --wall-grid 50mm.", "Use “Wall grid” 50mm."),
        (
            "point at it with --ball-at X,Y,FRAME.",
            "Point at it with “This is the ball”.",
        ),
        (
            "for example --fps 240 --ball 220mm (or --scale '410 px/m')",
            "For example “Capture rate” 240, “Ball or diameter” 220mm (or “Scale” 410 px/m)",
        ),
        ("check --fps and --ball", "Check “Capture rate” and “Ball or diameter”"),
        ("pass --drag yes", "Pass --drag yes"),
    ],
)
def test_messages_name_fields_and_buttons_of_the_page(message: str, shown: str) -> None:
    assert on_page(message, says("en")) == shown


def test_bounces_are_ticks_of_the_time_line() -> None:
    lesson = CLIP.parents[2] / "docs" / "lessons" / "bounce.mp4"
    options = measure_options(fps="240", scale="200 px/m ± 2 px/m", cache=True)
    events = marks_of(measure_clip(lesson, options))["events"]
    # as it was simulated: from 1 m to a radius of 0.1 m, and up again with 0.75 of the speed
    first = math.sqrt(2 * 0.9 / GRAVITY)
    moments = np.array([first, (1.0 + 2.0 * 0.75) * first]) + 0.047
    bounces = [one["frame"] for one in events if one["name"] == "bounce"]
    assert bounces == pytest.approx((240.0 * moments).tolist(), abs=1.5)
    assert len({one["frame"] for one in events}) == len(events)


def test_jargon_is_explained_in_both_languages() -> None:
    english = says("en")
    assert "restitution" in hint_of("cor_range", english)
    assert "Stoßzahl" in hint_of("cor_range", says("de"))
    assert hint_of("fall_acceleration_px", english) == hint_of("fall_acceleration", english)
    assert hint_of("ball_speed", english) == ""


def test_german_has_the_messages_axes_and_sources_of_uncertainty() -> None:
    say, english = says("de"), says("en")
    doubt = "the motion is a drop with a probability of only 0.87 (alternatives: roll 0.11): its "
    doubt += "quantities hold only if it is a drop. Show more of the motion, or point at the ball "
    said = on_page(f"{doubt}with another --ball-at.", say)
    assert said.startswith("Die Bewegung ist nur mit der Wahrscheinlichkeit 0.87 „Fall“")
    assert "“Das ist der Ball”" in said
    assert translated(doubt, english) == doubt
    for sentence in [one.sentence for one in strike().assumed]:
        assert "assumed" not in on_page(sentence, say)
        assert "page Set up" in on_page(sentence, english)
    # what an earlier version or another room says stays as it is
    assert translated("an unknown (message) {}", say) == "an unknown (message) {}"
    assert all(translated(source, say) != source for source in UncertaintySource)
    axes = [one.options(partial(translated, say=say)) for one in graphs_of(strike())]
    named = [axis[key]["name"] for axis in axes for key in ("xAxis", "yAxis")]
    assert "Geschwindigkeit / (m/s)" in named
    assert not any("speed" in one or "gap" in one for one in named)
