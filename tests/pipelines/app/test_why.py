"""Page Why: the engine's answer for one clip, in a sentence with its picture."""

import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from fastapi.testclient import TestClient
from scipy.integrate import solve_ivp

from measuring.chain import measure_clip
from measuring.measurement import bob_pendulum
from metrology import NotFoundError, SetupError
from physics.bodies import GRAVITY
from pipelines.app.corrections import ClipInputs, Corrections, options_of
from pipelines.app.graphs import graphs_of
from pipelines.app.pages.addresses import app_of
from pipelines.app.pages.why import ClipExplained, command_of, explained
from pipelines.app.session import AppSession
from tests.pipelines.app.small import CLIP, strike
from vision.tracks import MotionKind


def _clip(path: Path, **inputs: str) -> Any:
    """What the page needs of an open clip."""
    corrections = Corrections(ClipInputs(**inputs))
    return SimpleNamespace(path=path, measured=strike(), corrections=corrections)


def test_the_answer_is_that_of_explain(tmp_path: Path) -> None:
    found = explained(_clip(CLIP, setup="jokku_90_small.toml"))
    # the clip is simulated: nothing may be missing
    assert found.sentence.startswith("Nothing is missing")
    assert found.picture.startswith(b"\x89PNG")
    assert "What remains" in found.report
    # a ball that was typed counts as well as one of the set-up file
    text = CLIP.with_suffix(".toml").read_text().partition("[ball]")[0]
    (tmp_path / "lab.toml").write_text(text)
    setup = str(tmp_path / "lab.toml")
    assert explained(_clip(CLIP, setup=setup, ball="jokku")).sentence == found.sentence
    with pytest.raises(SetupError, match="no ball"):
        explained(_clip(CLIP, setup=setup))


def test_picture_and_report_of_the_answer_are_served() -> None:
    session = AppSession()
    answer = ClipExplained("said", b"picture", "<p>report")
    session.clip = cast(Any, SimpleNamespace(number=1, explained=answer))
    client = TestClient(app_of(session))
    assert client.get("/why/1/report").text == "<p>report"
    assert client.get("/why/1/picture").content == b"picture"
    for path in ("/why/2/report", "/why/1/else"):
        assert client.get(path).status_code in (404, 422)


def _lesson(name: str, **inputs: str) -> Any:
    """A clip of the lessons, measured with the inputs of the page."""
    path = CLIP.parents[2] / "docs" / "lessons" / f"{name}.mp4"
    corrections = Corrections(ClipInputs(**inputs))
    measured = measure_clip(path, options_of(path, corrections, corrected=False))
    return SimpleNamespace(path=path, measured=measured, corrections=corrections)


def _with_drag(clip: Any, per_metre: float) -> Any:
    """The same throw through air: its positions are those of a simulation."""
    tracks, plane = clip.measured.tracks, clip.measured.plane
    time = tracks.ball.time_s - tracks.ball.time_s[0]
    x, y = (plane.ball(tracks.ball.centre_px, tracks.ball.covariance_px2)[0]).T
    start = [x[0], y[0], np.polyfit(time, x, 2)[-2], np.polyfit(time, y, 2)[-2]]

    def rate(_: float, state: Any) -> list[float]:
        vx, vy = state[2:]
        drag = per_metre * np.hypot(vx, vy)
        return [vx, vy, -drag * vx, -GRAVITY - drag * vy]

    flown = solve_ivp(rate, (0.0, time[-1]), start, t_eval=time, rtol=1e-9).y[:2].T
    px = tracks.ball.centre_px[0] + (flown - flown[0]) / plane.metres_per_px * [1.0, -1.0]
    noise = np.random.default_rng(1).normal(0.0, 0.05, px.shape)
    ball = replace(tracks.ball, centre_px=px + noise)
    clip.measured = replace(clip.measured, tracks=replace(tracks, ball=ball))
    return clip


def test_gravity_alone_explains_a_throw_but_not_one_with_drag() -> None:
    inputs = {"fps": "240", "scale": "200 px/m ± 2 px/m"}
    with pytest.raises(SetupError, match="no mass"):
        explained(_lesson("throw", ball="0.2 m", **inputs))
    throw = _lesson("throw", ball="0.2 m, 20 g", **inputs)
    assert explained(throw).sentence.startswith("Nothing is missing")
    # 0.47 of a ball of 20 g
    drag = 0.5 * 1.2 * 0.47 * np.pi * 0.1**2 / 0.02
    assert "drag" in explained(_with_drag(throw, drag)).sentence


def test_gravity_alone_explains_the_flight_before_a_bounce_at_the_right_rate() -> None:
    inputs = {"ball": "201.75 mm, 0.353 kg", "kind": "bounce"}
    assert explained(_lesson("bounce", fps="240", **inputs)).sentence.startswith("Nothing is")
    assert "wrong frame rate" in explained(_lesson("bounce", fps="120", **inputs)).sentence


def test_gravity_and_the_seen_length_explain_a_swing() -> None:
    swing = _lesson("swing", fps="60", ball="0.2 m", scale="200 px/m ± 2 px/m")
    # the cord is 0.60 m long
    assert bob_pendulum(swing.measured, None).length == pytest.approx(0.6, rel=0.02)
    assert explained(swing).sentence.startswith("Nothing is missing")
    # the angle is drawn, too
    angle = next(one for one in graphs_of(swing.measured) if one.name == "angle")
    degrees = np.array([row[1] for row in angle.series[0]["data"]])
    assert np.abs(degrees).max() == pytest.approx(30.0, abs=1.0)


def test_the_command_is_given_only_where_it_does_the_same() -> None:
    clip = _clip(Path("/lab of/a b.mp4"), setup="lab.toml")
    words = shlex.split(command_of(clip))
    assert words == ["vision", "explain", "/lab of/a b.mp4", "--setup", "/lab of/lab.toml"]
    assert command_of(_clip(CLIP, setup="lab.toml", ball="jokku")) == ""
    assert command_of(_clip(CLIP)) == ""


def test_a_collision_has_no_model() -> None:
    tracks = strike().tracks
    motion = replace(tracks.motion, kind=MotionKind.COLLISION)
    measured = replace(strike(), tracks=replace(tracks, motion=motion, pendulum=None))
    clip = _clip(CLIP, setup="jokku_90_small.toml")
    clip.measured = measured
    with pytest.raises(NotFoundError, match="no model of a collision"):
        explained(clip)
