"""Repeated pictures: detected, dropped, and not taken for interlacing."""

import cv2
import numpy as np
import pytest

from tests.vision.clip.written_clips import moving_disc, scene, woven, write_clip
from vision.clip.clip import ClipReader
from vision.clip.footage import choose_capture_rate
from vision.clip.repeats import RepeatDetector
from vision.following import follow


def noisy(pictures, std=1.5, seed=5):
    rng = np.random.default_rng(seed)
    return [
        np.clip(picture + rng.normal(0.0, std, picture.shape), 0, 255).astype(np.uint8)
        for picture in pictures
    ]


def repeated_pictures(pictures, times, first=None):
    """Each picture `times` times, the first one `first` times."""
    counts = [times if first is None else first, *[times] * (len(pictures) - 1)]
    return [picture for picture, count in zip(pictures, counts, strict=True) for _ in range(count)]


def fall(count=40, bend=0.11):
    return noisy([scene(150.0, 25.0 + bend * k**2, size=(320, 240)) for k in range(count)])


@pytest.mark.parametrize("crf", ["0", "20", "30"])
@pytest.mark.parametrize("times", [2, 3, 8])
def test_each_picture_is_read_once(tmp_path, times, crf):
    pictures = fall()
    path = write_clip(
        tmp_path / "r.mp4",
        repeated_pictures(pictures, times),
        rate=25 * times,
        options={"crf": crf},
    )
    clip = ClipReader.open(path)
    assert clip.info.times_shown == times
    assert clip.info.weave == "progressive"
    assert clip.info.frames == len(pictures)
    assert clip.info.container_fps == pytest.approx(25)
    assert any(f"every picture {times} times" in warning for warning in clip.warnings)
    frames = list(clip.frames())
    assert [frame.index for frame in frames] == list(range(len(pictures)))
    assert [frame.time_s for frame in frames] == pytest.approx(np.arange(len(pictures)) / 25)
    assert clip.capture_times(25.0) == pytest.approx(np.arange(len(pictures)) / 25)
    for frame, picture in zip(frames, pictures, strict=True):
        assert np.abs(frame.gray.astype(float) - picture).mean() < 4.0
    assert sum(1 for _ in clip.colour_frames()) == len(pictures)


@pytest.mark.parametrize("first", [1, 2])
def test_a_clip_may_begin_within_a_group(tmp_path, first):
    pictures = fall()
    path = write_clip(
        tmp_path / "r.mp4", repeated_pictures(pictures, 3, first), rate=75, options={"crf": "20"}
    )
    clip = ClipReader.open(path)
    frames = list(clip.frames())
    assert len(frames) == clip.info.frames == len(pictures) - 1
    assert [frame.time_s for frame in frames] == pytest.approx(np.arange(len(frames)) / 25)
    assert np.abs(frames[0].gray.astype(float) - pictures[1]).mean() < 3.0


def test_a_fall_shown_twice_is_followed_like_the_fall_itself(tmp_path):
    pictures = fall()
    tracks = []
    for times in (1, 2):
        path = write_clip(
            tmp_path / f"{times}.mp4",
            repeated_pictures(pictures, times),
            rate=25 * times,
            options={"crf": "18"},
        )
        tracks.append(follow(ClipReader.open(path), 25.0).ball)
    true = np.array([(150.0, 25.0 + 0.11 * k**2) for k in range(40)])
    for track in tracks:
        assert len(track) >= 36
        assert np.hypot(*(track.centre_px - true[track.frame]).T).max() < 1.0


@pytest.mark.parametrize("bottom_first", [False, True])
def test_woven_fields_are_not_repeats(tmp_path, bottom_first):
    path = write_clip(
        tmp_path / "i.mp4",
        woven(noisy(moving_disc(80, 1.5)), bottom_first=bottom_first),
        rate=25,
        options={"crf": "20"},
    )
    clip = ClipReader.open(path)
    assert clip.info.times_shown == 1
    assert clip.info.weave == ("bottom_first" if bottom_first else "top_first")
    assert clip.info.frames == 80


def test_woven_pictures_shown_twice_are_both(tmp_path):
    pictures = woven(noisy(moving_disc(80, 1.5), 1.0), bottom_first=True)
    path = write_clip(
        tmp_path / "i.mp4", repeated_pictures(pictures, 2), rate=50, options={"crf": "18"}
    )
    clip = ClipReader.open(path)
    assert (clip.info.times_shown, clip.info.weave) == (2, "bottom_first")
    assert clip.info.frames == 80
    assert clip.info.container_fps == pytest.approx(50)


@pytest.mark.parametrize("speed", [0.2, 1.0, 6.0])
@pytest.mark.parametrize("crf", ["10", "30"])
def test_ordinary_clips_keep_all_pictures(tmp_path, speed, crf):
    count = min(120, int(100 / speed))
    path = write_clip(
        tmp_path / "p.mp4", noisy(moving_disc(count, speed)), rate=50, options={"crf": crf}
    )
    clip = ClipReader.open(path)
    assert (clip.info.times_shown, clip.info.weave) == (1, "progressive")
    assert clip.info.frames == count
    assert clip.warnings == ()


def test_noise_that_a_codec_renews_in_every_second_picture_makes_no_repeats():
    rng, detector = np.random.default_rng(4), RepeatDetector()
    row, column = np.mgrid[:140, :240]
    for index in range(100):
        if index % 2 == 0:
            noise = rng.normal(0.0, 5.0, row.shape)
        away = np.hypot(column - 40.0 - 1.8 * index, row - 70.0)
        ball = 40.0 * np.clip(35.5 - away, 0.0, 1.0)
        detector.show(np.clip(90.0 + ball + noise, 0.0, 255.0))
    assert detector.verdict().times == 1


def test_a_still_clip_has_no_repeats(tmp_path):
    path = write_clip(tmp_path / "s.mp4", [scene(60.0, 60.0)] * 40)
    assert ClipReader.open(path).info.frames == 40


def test_the_rate_of_the_file_is_that_of_its_repeats(tmp_path):
    path = write_clip(tmp_path / "r.mp4", repeated_pictures(fall(), 2), rate=50)
    info = ClipReader.open(path).info
    assert choose_capture_rate(info, 50.0).fps == pytest.approx(25.0)
    assert "2 times" in str(choose_capture_rate(info, 50.0).notice)
    # a slow-motion recording: the camera's rate, not the file's
    assert choose_capture_rate(info, 240.0).fps == 240.0


def test_images_of_a_folder_may_repeat(tmp_path):
    pictures = fall()
    for number, picture in enumerate(repeated_pictures(pictures, 2)):
        cv2.imwrite(str(tmp_path / f"p{number:04d}.png"), picture)
    clip = ClipReader.open(tmp_path)
    assert (clip.info.times_shown, clip.info.frames) == (2, len(pictures))
    assert clip.capture_times(25.0) == pytest.approx(np.arange(len(pictures)) / 25)


@pytest.mark.parametrize("crf", ["0", "24"])
@pytest.mark.parametrize(("shown", "rate"), [(24, 30), (24, 60), (25, 30), (25, 60), (30, 50)])
def test_a_rate_raised_by_no_whole_number(tmp_path, shown, rate, crf):
    pictures = fall(60, 0.05)
    frames = [pictures[k * shown // rate] for k in range(len(pictures) * rate // shown)]
    path = write_clip(tmp_path / "r.mp4", frames, rate=rate, options={"crf": crf})
    clip = ClipReader.open(path)
    assert clip.info.times_shown == pytest.approx(rate / shown)
    assert clip.info.container_fps == pytest.approx(shown)
    read = list(clip.frames())
    assert len(pictures) - 1 <= len(read) == clip.info.frames
    # an even clock, though the groups of repeats are uneven
    assert [frame.time_s for frame in read] == pytest.approx(np.arange(len(read)) / shown)
    for frame, picture in zip(read, pictures[-len(read) :], strict=True):
        assert np.abs(frame.gray.astype(float) - picture).mean() < 4.0
