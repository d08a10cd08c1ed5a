"""Rows for spreadsheets, and what a report tells of what was seen."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from measuring.measurement import (
    ClipMeasurement,
    motion_warning,
    steady_px,
    tracks_as_frame,
)
from metrology import Quantity
from pipelines.interop.measured import read_tracks
from pipelines.measure.files import measurement_as_dict, report_input, without_formulas
from vision.clip.footage import CaptureRate, RateSource
from vision.clip.picture import ClipInfo
from vision.tracks import FollowedObject, Motion, MotionKind, MotionModel, Track, Tracks


@pytest.mark.parametrize("name", ["=cmd|'/c calc'!A0.mp4", "+1.mp4", "-1.mp4", "@SUM(A1).mp4"])
def test_a_clips_name_is_no_formula(name: str) -> None:
    row = without_formulas({"clip": name, "ball_speed_m_s": -1.5, "reason_cor": "a = b"})
    assert row == {"clip": f"'{name}", "ball_speed_m_s": -1.5, "reason_cor": "a = b"}


def seen_twice() -> Tracks:
    """A ball, a second one and a shadow, each in four frames."""

    def track(x: float) -> Track:
        variance = np.tile(0.01 * np.eye(2), (4, 1, 1))
        place = np.column_stack([x + np.arange(4.0), np.full(4, 30.0)])
        frame, one = np.arange(10, 14), np.ones(4)
        clear = np.array([0.1, 0.2, 0.9, 0.3])
        return Track(frame, frame / 30.0, place, variance, variance, 5.0 * one, 0.1 * one, clear)

    motion = Motion(
        MotionKind.FLIGHT,
        0.7,
        ("It flies freely.",),
        alternatives=((MotionKind.NONE, 0.29), (MotionKind.SWING, 0.002)),
    )
    second = FollowedObject(track(100.0), MotionModel.ROLL, ("It is less clear.",))
    shadow = FollowedObject(track(200.0), MotionModel.SHADOW, ("It only dims.",))
    return Tracks(
        track(50.0),
        None,
        np.zeros((60, 300), np.float32),
        None,
        others=(second,),
        dismissed=(shadow,),
        motion=motion,
        reasons=("Its outline is whole.",),
    )


def test_the_report_tells_what_was_seen_why_and_how_to_point_at_another() -> None:
    info = ClipInfo(
        Path("a.mp4"), "0", 300, 60, 20, "h264", 30.0, True, 0.7, 0, "progressive", 8, None, False
    )
    rate = CaptureRate(30.0, 0.1, RateSource.OPTION)
    missing = Quantity.missing("gravity_check", "m/s^2", "none")
    measured = ClipMeasurement(info, rate, (), (), missing, (), (), seen_twice(), None, None, None)
    told = dict(report_input(measured, None).seen)
    assert told["flight, probability 0.70"] == "It flies freely. Alternatives: none 0.29."
    assert told["ball"] == "Its outline is whole."
    # the clearest frame of each
    assert told["ball_2"].endswith("It is less clear. If this is the ball: --ball-at 102,30,12.")
    assert told["also moves"].startswith("shadow of another object. It only dims.")
    assert measurement_as_dict(measured)["others"][0]["ball_at"] == [102, 30, 12]


def test_places_of_a_hand_held_camera_are_those_in_the_frame(tmp_path: Path) -> None:
    info = ClipInfo(
        Path("a.mp4"), "0", 300, 60, 20, "h264", 30.0, True, 0.7, 0, "progressive", 8, None, False
    )
    rate = CaptureRate(30.0, 0.1, RateSource.OPTION)
    missing = Quantity.missing("gravity_check", "m/s^2", "none")
    shift = np.column_stack([np.sin(np.arange(20.0)), 2.0 * np.cos(np.arange(20.0))])
    still = seen_twice()
    shaken = replace(still, shift_px=shift)
    one, other = (
        ClipMeasurement(info, rate, (), (), missing, (), (), tracks, None, None, None)
        for tracks in (still, shaken)
    )
    rows, plain = tracks_as_frame(other), tracks_as_frame(one)
    off = rows[["x_px", "y_px"]].to_numpy() - plain[["x_px", "y_px"]].to_numpy()
    np.testing.assert_allclose(off, shift[plain["frame"]])
    assert list(plain.columns) == list(rows.columns[: len(plain.columns)])
    # read again, the camera's motion is taken away
    rows.to_csv(tmp_path / "tracks.csv", index=False)
    (ball, *_) = read_tracks(tmp_path / "tracks.csv").tracks
    np.testing.assert_allclose(ball.px, still.ball.centre_px)
    np.testing.assert_allclose(steady_px(rows), plain[["x_px", "y_px"]].to_numpy())
    # of a picture between bars, they count from the file's corner
    within = tracks_as_frame(replace(one, info=replace(info, bars=(40, 18, 30, 0))))
    off = within[["x_px", "y_px"]].to_numpy() - plain[["x_px", "y_px"]].to_numpy()
    np.testing.assert_allclose(off, np.tile([40.0, 18.0], (len(plain), 1)))


def test_numbers_of_a_kind_of_motion_in_doubt_come_with_a_proviso() -> None:
    beside = ((MotionKind.FLIGHT, 0.25), (MotionKind.NONE, 0.049), (MotionKind.DROP, 0.001))
    (said,) = motion_warning(Motion(MotionKind.SWING, 0.7, alternatives=beside))
    assert "a swing with a probability of only 0.70 (alternatives: flight 0.25, none 0.05)" in said
    assert motion_warning(Motion(MotionKind.SWING, 0.96, alternatives=beside)) == ()
    # free falls have the same quantities
    falls = ((MotionKind.BOUNCE, 0.25), (MotionKind.DROP, 0.1), (MotionKind.NONE, 0.05))
    assert motion_warning(Motion(MotionKind.FLIGHT, 0.6, alternatives=falls)) == ()
    # without a motion there is nothing to warn about
    assert motion_warning(Motion(MotionKind.NONE, 0.6, alternatives=beside)) == ()
    (said,) = motion_warning(Motion(MotionKind.NONE, 0.09, ("It is seen in 6 frames only.",)))
    assert "6 frames" in said
    assert "--ball-at" in said


def test_of_a_motion_that_is_more_probably_another_nothing_is_measured_unless_it_is_stated() -> (
    None
):
    doubtful = Motion(MotionKind.SWING, 0.4)
    assert doubtful.measured_as is MotionKind.NONE
    assert "--kind swing" in motion_warning(doubtful)[0]
    stated = replace(doubtful, given=True)
    assert stated.measured_as is MotionKind.SWING
    assert "not given" not in motion_warning(stated)[0]
