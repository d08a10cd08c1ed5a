"""Tracker's and Kinovea's own files: read as they stand, written so that they read back."""

import io
import json
import os
import re
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from measuring.chain import MeasureOptions, measure_clip
from metrology import UsageError
from pipelines.interop.external import ExternalTrack, ExternalTracks, PlaneOfMotion, Program
from pipelines.interop.measured import (
    external_of,
    measure_from_tracks,
    read_tracks,
    track_table,
    write_tracks,
)
from pipelines.interop.tables import parse_columns
from tests.vision.clip.written_clips import scene, write_clip

SHARED = Path(os.environ.get("IMPACT_VISION_SHARED", "../shared")) / "clips"

KVA = """<?xml version="1.0" encoding="utf-8"?>
<KinoveaVideoAnalysis>
  <FormatVersion>2.0</FormatVersion>
  <Producer>Kinovea.2023.1.2</Producer>
  <OriginalFilename>toss</OriginalFilename>
  <ImageSize>640;480</ImageSize>
  <AverageTimeStampsPerFrame>512</AverageTimeStampsPerFrame>
  <CaptureFramerate>240</CaptureFramerate>
  <FirstTimeStamp>1024</FirstTimeStamp>
  <Calibration>
    <CalibrationLine>
      <Length>40</Length>
      <Segment><A>100;200</A><B>300;200</B></Segment>
      <Origin>100;200</Origin>
    </CalibrationLine>
    <Unit Abbreviation="cm">Centimeters</Unit>
  </Calibration>
  <Tracks>
    <Track id="11111111-2222-3333-4444-555555555555" name="balle">
      <TimePosition>2048</TimePosition>
      <TrackPointList Count="3">
        <TrackPoint>100.5;200.5;2048</TrackPoint>
        <TrackPoint>150.5;190.5;2560</TrackPoint>
        <TrackPoint>200.5;185.5;3584</TrackPoint>
      </TrackPointList>
      <MainLabel Text="balle"><SpacePosition>1;1</SpacePosition></MainLabel>
    </Track>
  </Tracks>
</KinoveaVideoAnalysis>
"""


def shared(name: str) -> Path:
    path = SHARED / name
    if not path.exists():
        pytest.skip(f"{path} is not here")
    return path


@pytest.mark.parametrize(
    ("project", "marks", "calibration"),
    [
        ("balltoss.trk", "balltoss_ball.csv", "balltoss_calib.json"),
        ("BallToss.trz", "balltoss_ball.csv", "balltoss_calib.json"),
        ("diabolo240.trk", "diabolo240_masa-A.csv", "diabolo240_calib.json"),
    ],
)
def test_a_tracker_project_is_read_as_another_reader_reads_it(project, marks, calibration) -> None:
    external = read_tracks(shared(f"tracker/{project}"))
    listed = pd.read_csv(shared(f"tracker/{marks}"))
    said = json.loads(shared(f"tracker/{calibration}").read_text())
    track = external.tracks[0]
    assert track.frame.tolist() == listed["frame"].tolist()
    # Tracker counts from the corner of the first pixel
    assert np.abs(track.px + 0.5 - listed[["x_px", "y_px"]].to_numpy()).max() < 1e-3
    assert external.plane is not None
    assert external.plane.px_per_m == pytest.approx(said["coords"][0]["xscale"])
    assert external.fps == pytest.approx(1000.0 / said["delta_t_ms"])


@pytest.mark.parametrize("suffix", [".trk", ".kva", ".csv", ".xlsx"])
def test_a_track_comes_back_from_every_format(suffix, tmp_path) -> None:
    rng = np.random.default_rng(3)
    frame = np.flatnonzero(rng.random(200) < 0.9)
    given = ExternalTracks(
        path=tmp_path / "a",
        program=Program.IMPACT_VISION,
        tracks=tuple(
            ExternalTrack(name, frame, rng.uniform(-50, 4000, (len(frame), 2)))
            for name in ("ball", "masse <&> B")
        ),
        size=(3840, 2160),
        fps=600.0,
        plane=PlaneOfMotion(412.3, 0.01, np.array([120.3, 900.7]), 0.02),
        clip="clips/a b.mp4",
    )
    path = tmp_path / f"a{suffix}"
    write_tracks(path, given)
    back = read_tracks(path)
    for one, other in zip(given.tracks, back.tracks, strict=True):
        assert one.name == other.name
        assert (other.frame - other.frame[0] == one.frame - one.frame[0]).all()
        assert np.abs(one.px - other.px).max() < 0.01
    if suffix in (".trk", ".kva"):
        assert back.size == given.size
        assert back.fps == pytest.approx(600.0)
        assert back.plane is not None
        metres = given.plane.metres(given.tracks[0].px)
        assert np.abs(back.plane.metres(back.tracks[0].px) - metres).max() < 1e-3


def test_plane_of_motion_turns_counterclockwise() -> None:
    plane = PlaneOfMotion(100.0, 0.01, np.array([10.0, 20.0]), np.radians(90.0))
    # the x axis points up in the picture, y to the left
    assert plane.metres(np.array([[10.0, -80.0], [-90.0, 20.0]])) == pytest.approx(
        np.array([[1.0, 0.0], [0.0, 1.0]])
    )
    assert plane.pixels(plane.metres(np.array([[3.0, 4.0]]))) == pytest.approx(
        np.array([[3.0, 4.0]])
    )


def test_kinovea_annotations_with_ticks_and_a_line(tmp_path) -> None:
    path = tmp_path / "a.kva"
    path.write_text(KVA, encoding="utf-8")
    external = read_tracks(path)
    assert external.tracks[0].frame.tolist() == [2, 3, 5]
    assert external.tracks[0].px[0].tolist() == [100.0, 200.0]
    assert external.plane is not None
    # 200 px are 40 cm
    assert external.plane.px_per_m == pytest.approx(500.0)
    table = track_table(path, {})
    assert table["object"].unique().tolist() == ["ball"]
    assert table["x_m"].tolist() == pytest.approx([0.001, 0.101, 0.201])
    assert table["y_m"].tolist() == pytest.approx([-0.001, 0.019, 0.029])
    assert table["t_s"].tolist() == pytest.approx([2 / 240, 3 / 240, 5 / 240])


LATER_TRACK = """    <Track id="21111111-2222-3333-4444-555555555555" name="balle">
      <TimePosition>2048</TimePosition>
      <IsVisible>true</IsVisible>
      <Visible>2048</Visible>
      <Invisible>-1</Invisible>
      <ExtraData>None</ExtraData>
      <TrackerParameters>
        <TrackingAlgorithm>Correlation</TrackingAlgorithm>
        <SearchWindow>100;100</SearchWindow>
        <BlockWindow>20;20</BlockWindow>
      </TrackerParameters>
      <TrackPointList Count="3">
        <TrackPoint>100.5;200.5;2048;12.5</TrackPoint>
        <TrackPoint>150.5;190.5;2560;12.4</TrackPoint>
        <TrackPoint>200.5;185.5;3584;0</TrackPoint>
      </TrackPointList>
      <MainLabel Text="balle"><SpacePosition>1;1</SpacePosition></MainLabel>
      <SeeFuture>true</SeeFuture>
      <ShowTrackLabel>false</ShowTrackLabel>
      <DrawingStyle><Color Key="color"><Value>255;255;140;0</Value></Color></DrawingStyle>
    </Track>
"""
"""A track as ``DrawingTrack.WriteXml`` of Kinovea's present source writes it: a point's fourth
number is the radius of what was followed."""


def test_kinovea_annotations_of_later_versions_carry_a_radius(tmp_path) -> None:
    path = tmp_path / "a.kva"
    head, _, rest = KVA.partition("  <Tracks>\n")
    path.write_text(f"{head}  <Tracks>\n{LATER_TRACK}  </Tracks>\n</KinoveaVideoAnalysis>\n")
    assert "TrackPoint" in rest
    (track,) = read_tracks(path).tracks
    assert track.name == "balle"
    assert track.frame.tolist() == [2, 3, 5]
    assert track.px.tolist() == [[100.0, 200.0], [150.0, 190.0], [200.0, 185.0]]


def test_kinovea_annotations_without_an_origin_keep_their_scale(tmp_path) -> None:
    path = tmp_path / "a.kva"
    found = re.search(r"<Origin>.*?</Origin>", KVA)
    assert found is not None
    path.write_text(KVA)
    scale = read_tracks(path).plane.px_per_m
    path.write_text(KVA.replace(found.group(), "<Origin>NaN;NaN</Origin>"))
    plane = read_tracks(path).plane
    assert plane.px_per_m == scale
    assert np.isfinite(plane.origin_px).all()


@pytest.mark.parametrize("mark", ["100.5;200.5;1e300", "nan;200.5;2048", "1;2;inf"])
def test_a_mark_of_kinovea_beyond_all_clips_is_refused(mark, tmp_path) -> None:
    path = tmp_path / "a.kva"
    path.write_text(KVA.replace("100.5;200.5;2048", mark))
    with pytest.raises(UsageError, match="no valid position or time"):
        read_tracks(path)


def test_kinovea_annotations_of_old_versions_count_from_the_first_mark(tmp_path) -> None:
    path = tmp_path / "a.kva"
    text = KVA
    for ticks in (2048, 2560, 3584):
        text = text.replace(f";{ticks}<", f";{ticks - 2048}<")
    path.write_text(text)
    assert read_tracks(path).tracks[0].frame.tolist() == [2, 3, 5]


def test_numbers_from_trackers_marks_alone_agree_with_the_fall() -> None:
    """Tracker's own example: with its g-scale of 409.9 px/m the ball falls with g."""
    from pipelines.api.quantities import measure_options

    path = shared("tracker/balltoss.trk")
    measured = measure_from_tracks(path, measure_options(scale="409.9 px/m ± 1 px/m"))
    fall = measured.quantity("fall_acceleration")
    assert fall.known
    assert abs(fall.value - 9.81) < 3.0 * fall.std
    assert fall.std < 0.3


def test_marks_and_clip_must_belong_together() -> None:
    with pytest.raises(UsageError, match="1536 × 848"):
        measure_from_tracks(
            shared("tracker/diabolo240.trk"), clip=shared("balltoss_480p15_tracker.mp4")
        )


def test_several_tracks_need_a_name(tmp_path) -> None:
    track = ExternalTrack("masa A", np.arange(5), np.zeros((5, 2)))
    other = ExternalTrack("masa B", np.arange(5), np.zeros((5, 2)))
    both = ExternalTracks(tmp_path / "a.trk", Program.TRACKER, (track, other))
    with pytest.raises(UsageError, match="'masa A', 'masa B'") as refusal:
        both.chosen({})
    assert "--columns" in str(refusal.value.hint)
    chosen = both.chosen(parse_columns("ball=masa B"))
    assert [one.name for one in chosen.tracks] == ["ball", "masa A"]
    with pytest.raises(UsageError, match="masa C"):
        both.chosen({"ball": "masa C"})


BOMB = (
    '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {chr(98 + k)} "{("&" + chr(97 + k) + ";") * 10}">' for k in range(9))
    + "]><KinoveaVideoAnalysis>&j;</KinoveaVideoAnalysis>"
)


@pytest.mark.parametrize("name", ["a.trk", "a.kva"])
@pytest.mark.parametrize(
    ("text", "said"),
    [
        (BOMB, "entities"),
        ('<!DOCTYPE a SYSTEM "file:///etc/passwd"><a/>', "entities"),
        ("<object class=", "not a (Tracker project|Kinovea annotation file)"),
        ("", "not a (Tracker project|Kinovea annotation file)"),
        ("<html></html>", "not a (Tracker project|Kinovea annotation file)"),
    ],
)
def test_hostile_or_broken_xml_is_refused(name, text, said, tmp_path) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(UsageError, match=said):
        read_tracks(path)


def test_cut_archives_and_archives_of_something_else_are_refused(tmp_path) -> None:
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.trk", "<object/>" + " " * 10_000)
    cut = tmp_path / "cut.trz"
    cut.write_bytes(whole.getvalue()[:-30])
    with pytest.raises(UsageError, match="not a complete Tracker archive"):
        read_tracks(cut)
    other = tmp_path / "other.trz"
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("a.txt", "hello")
    with pytest.raises(UsageError, match=r"contains no \.trk file"):
        read_tracks(other)


def test_an_archive_that_unpacks_without_end_is_refused(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("pipelines.interop.external.MAX_TRACK_FILE_BYTES", 2**20)
    path = tmp_path / "bomb.trz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.trk", b"0" * (2**20 + 1))
    with pytest.raises(UsageError, match="too large"):
        read_tracks(path)


def test_marks_with_many_gaps_are_as_sure_as_clicks(tmp_path) -> None:
    """Many equal steps, but never four consecutive marks: the noise stays undetermined."""
    frame = np.flatnonzero(np.arange(48) % 4 != 3)
    fall = np.column_stack([50.0 + 3.0 * frame, 40.0 + 0.0851 * frame**2])
    rows = [f"{k},{x:.4f},{y:.4f}" for k, (x, y) in zip(frame, fall, strict=True)]
    path = tmp_path / "a.csv"
    path.write_text("frame,x_px,y_px\n" + "\n".join(rows) + "\n")
    from pipelines.api.quantities import measure_options

    ball = measure_from_tracks(path, measure_options(scale="500 px/m", fps="240")).tracks.ball
    assert np.isfinite(ball.covariance_px2).all()
    assert (np.diagonal(ball.covariance_px2, axis1=1, axis2=2) > 0.0).all()


def test_without_a_clip_nobody_is_asked_to_light_its_wall(tmp_path) -> None:
    frame = np.arange(30)
    rows = [f"{k},{50.0 + 3.0 * k:.4f},{40.0 + 0.0851 * k**2:.4f}" for k in frame]
    path = tmp_path / "a.csv"
    path.write_text("frame,x_px,y_px\n" + "\n".join(rows) + "\n")
    from pipelines.api.quantities import measure_options

    said = " ".join(measure_from_tracks(path, measure_options(fps="240")).warnings)
    assert "there is no picture of the wall. Pass the clip, too" in said
    assert "Light" not in said


def test_a_table_whose_y_points_down_is_turned_over(tmp_path) -> None:
    time = np.arange(60) / 240.0
    x, y = 2.0 * time, 1.0 - 1.2 * time + 4.903 * time**2
    path = tmp_path / "a.csv"
    rows = [f"{a:.5f},{b:.5f},{c:.5f}" for a, b, c in zip(time, x, y, strict=True)]
    path.write_text("t_s,x_m,y_m\n" + "\n".join(rows) + "\n")
    from pipelines.api.quantities import measure_options

    said = " ".join(measure_from_tracks(path, measure_options(fps="240")).warnings)
    assert "y is taken as pointing down and turned over" in said
    assert "check --fps" not in said


@pytest.mark.parametrize(("shown", "rate"), [(25, 50), (24, 60)])
def test_marks_count_the_frames_of_a_file_that_repeats_pictures(tmp_path, shown, rate) -> None:
    falling = [scene(150.0, 25.0 + 0.11 * k**2, size=(320, 240)) for k in range(40)]
    frames = [falling[k * shown // rate] for k in range(len(falling) * rate // shown)]
    clip = write_clip(tmp_path / "r.mp4", frames, rate=rate, options={"crf": "12"})
    measured = measure_clip(clip, MeasureOptions(fps=float(shown), cache=False))
    path = tmp_path / "r.trk"
    write_tracks(path, external_of(measured, path, clip))
    marks = read_tracks(path).tracks[0].frame
    found = measured.tracks.ball.frame
    assert np.array_equal(marks * shown // rate, found)
    again = measure_from_tracks(path, MeasureOptions(fps=float(shown)), clip=clip)
    assert np.array_equal(again.tracks.ball.frame, found)
