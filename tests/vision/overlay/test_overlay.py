"""The overlay shows what was found where it was found, and is written whole or not at all."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from metrology import ClipError, UsageError
from tests.vision.clip.written_clips import HEIGHT, WIDTH, moving_disc, write_clip
from vision.clip.clip import ClipReader
from vision.overlay import OverlayMarks, overlay_still, png_bytes, write_overlay
from vision.tracks import (
    Face,
    FollowedObject,
    Motion,
    MotionKind,
    PendulumTrack,
    Track,
    Tracks,
)

BALL, PENDULUM, CONTACT, GRID = (0, 159, 230), (233, 180, 86), (0, 94, 213), (115, 158, 0)
COUNT = 8


def track(centres, radius, frames):
    count = len(frames)
    covariance = np.tile(0.01 * np.eye(2), (count, 1, 1))
    return Track(
        np.array(frames), np.array(frames) / 600, np.array(centres, float), covariance, covariance,
        np.full(count, radius), np.full(count, 0.05), np.ones(count),
    )  # fmt: skip


@pytest.fixture
def clip(tmp_path):
    return ClipReader.open(write_clip(tmp_path / "a.mp4", moving_disc(COUNT)))


@pytest.fixture
def tracks():
    frames = list(range(COUNT))
    ball = track([(20 + 3 * i, 50 + 0.6 * i) for i in frames], 14.0, frames)
    mass = track([(100 + i, 90 - i) for i in frames[:4]], 6.0, frames[:4])
    pendulum = PendulumTrack(
        mass, np.linspace(0, 0.1, 4), np.full(4, 0.001), np.array([110.0, 20.0]), np.eye(2),
        70.0, Face(1, np.array([115.0, 90.0]), 0.1),
    )  # fmt: skip
    return Tracks(ball, pendulum, np.zeros((HEIGHT, WIDTH), np.float32), None)


def near(image, colour, x, y, scale, reach=3):
    """Whether a colour is found within `reach` canvas pixels of a clip position."""
    column, row = round((x + 0.5) * scale - 0.5), round((y + 0.5) * scale - 0.5)
    window = image[
        max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1
    ]
    return bool((np.abs(window.astype(int) - colour).max(axis=2) < 12).any())


def test_of_a_hand_held_camera_all_is_drawn_where_it_is_in_the_frame(clip, tracks):
    shift = np.column_stack([np.arange(COUNT), -2.0 * np.arange(COUNT)])
    shaken = replace(tracks, shift_px=shift)
    image = overlay_still(clip, shaken, frame=4)
    scale = image.shape[1] // WIDTH
    x, y = tracks.ball.centre_px[4] + shift[4]
    assert near(image, BALL, x, y - 14.0, scale)
    still = overlay_still(clip, tracks, frame=4)
    assert near(still, BALL, x - shift[4, 0], y - shift[4, 1] - 14.0, scale)
    assert not near(still, BALL, x, y - 14.0, scale)


def test_marks_stand_where_things_are(clip, tracks):
    marks = OverlayMarks(
        contact=(2, 4), grid_px=np.array([[140.0, 10.0]]), captions=("COR 0.7 ± 0.1",)
    )
    image = overlay_still(clip, tracks, marks, frame=3)
    scale = image.shape[1] // WIDTH
    assert scale >= 5
    x, y = tracks.ball.centre_px[3]
    for direction in (0, 1, 2, 3):
        edge = x + 14 * np.cos(direction * np.pi / 2), y + 14 * np.sin(direction * np.pi / 2)
        assert near(image, BALL, *edge, scale)
    assert near(image, PENDULUM, 103, 87, scale)
    assert near(image, PENDULUM, 106.5, 53.5, scale), "the arm from pivot to mass"
    assert near(image, GRID, 140, 10, scale)
    assert near(image, CONTACT, WIDTH - 1, HEIGHT - 1, scale)


def test_what_has_no_known_size_has_no_outline(clip, tracks):
    ball = replace(tracks.ball, radius_std_px=np.full(COUNT, np.nan))
    image = overlay_still(clip, replace(tracks, ball=ball), frame=3)
    scale = image.shape[1] // WIDTH
    x, y = ball.centre_px[3]
    assert near(image, BALL, x, y, scale)
    assert not near(image, BALL, x, y - 14.0, scale)


def test_only_the_past_of_the_track_and_only_contact_frames_are_marked(clip, tracks):
    marks = OverlayMarks(contact=(2, 4))
    early = overlay_still(clip, tracks, marks, frame=1)
    late = overlay_still(clip, tracks, marks, frame=7)
    scale = early.shape[1] // WIDTH
    assert not near(early, CONTACT, WIDTH - 1, HEIGHT - 1, scale)
    assert not near(late, CONTACT, WIDTH - 1, HEIGHT - 1, scale)
    assert near(late, BALL, *tracks.ball.centre_px[1], scale)
    assert not near(early, BALL, *tracks.ball.centre_px[6], scale)
    # The pendulum is not drawn as if still there once it is out of view.
    assert not near(late, PENDULUM, 106.5, 53.5, scale)


@pytest.mark.parametrize("kind", [MotionKind.COLLISION, MotionKind.FLIGHT])
def test_the_ball_that_came_is_marked_where_two_collide(clip, tracks, kind):
    other = track([(120.0 - 3 * i, 60.0) for i in range(COUNT)], 14.0, range(COUNT))
    both = replace(tracks, pendulum=None, others=(FollowedObject(other),), motion=Motion(kind, 0.9))
    image = overlay_still(clip, both, OverlayMarks(), frame=3)
    scale = image.shape[1] // WIDTH
    assert near(image, PENDULUM, 111.0, 60.0, scale) is (kind is MotionKind.COLLISION)
    assert near(image, BALL, *tracks.ball.centre_px[3], scale)


def test_the_video_has_every_frame_and_even_sizes(clip, tracks, tmp_path):
    path = tmp_path / "overlay.mp4"
    told = []
    write_overlay(path, clip, tracks, OverlayMarks(captions=("a", "b", "c")), progress=told.append)
    overlay = ClipReader.open(path)
    assert overlay.info.frames == COUNT
    assert overlay.info.codec == "h264"
    assert overlay.info.width % 2 == overlay.info.height % 2 == 0
    assert told == list(range(1, COUNT + 1))
    image = overlay_still(clip, tracks, OverlayMarks(captions=("a", "b", "c")), frame=5)
    still = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    assert np.abs(list(overlay.frames())[5].gray.astype(int) - still).mean() < 4


def test_nothing_is_left_where_it_breaks_off(clip, tracks, tmp_path):
    def stop(count):
        if count == 4:
            raise ClipError("the disk with the clip is gone")

    path = tmp_path / "overlay.mp4"
    path.write_bytes(b"what was there before")
    with pytest.raises(ClipError):
        write_overlay(path, clip, tracks, progress=stop)
    assert path.read_bytes() == b"what was there before"
    assert sorted(item.name for item in tmp_path.iterdir()) == ["a.mp4", "overlay.mp4"]


def test_other_kinds_of_file_and_frames_that_are_not_there_are_refused(clip, tracks, tmp_path):
    with pytest.raises(UsageError, match=r"\.gif"):
        write_overlay(tmp_path / "a.gif", clip, tracks)
    with pytest.raises(UsageError, match="no frame 99"):
        overlay_still(clip, tracks, frame=99)
    with pytest.raises(UsageError):
        write_overlay(tmp_path / "no" / "folder.mp4", clip, tracks)


def test_long_captions_and_odd_sizes_fit(tmp_path):
    images = [np.full((91, 131), 90, np.uint8)] * 2
    clip = ClipReader.open(write_clip(tmp_path / "odd.mkv", images, codec="ffv1"))
    nothing = Tracks(track(np.zeros((0, 2)), 1.0, []), None, np.zeros((91, 131), np.float32), None)
    image = overlay_still(clip, nothing, OverlayMarks(captions=("x" * 300, "short")))
    assert image.shape[0] % 2 == image.shape[1] % 2 == 0
    assert png_bytes(image).startswith(b"\x89PNG")
