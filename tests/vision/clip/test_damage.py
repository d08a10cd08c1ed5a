"""Files that are not what they should be: said in words, or read as far as they go."""

import re

import cv2
import numpy as np
import pytest

from metrology import ClipError
from tests.vision.clip.written_clips import moving_disc, scene, write_clip, write_sound
from vision.clip.clip import ClipReader, VideoFile

KEYS_OFTEN = {"g": "5", "crf": "10", "bf": "0"}


def refusal(path):
    with pytest.raises(ClipError) as caught:
        ClipReader.open(path)
    assert caught.value.exit_code == 3
    assert caught.value.hint
    return caught.value.message


def test_missing_file(tmp_path):
    for name in ("none.mp4", "x" * 300, "a\0b"):
        assert "there is no file" in refusal(tmp_path / name)
    assert "there is no file" in refusal(tmp_path / "nowhere" / "none.mp4")


@pytest.mark.parametrize(
    ("name", "cure"),
    [
        ("https://example.org/a.mp4", "download"),
        ("b.mp4", "in iCloud alone"),
        ("%04d.png", "pass the folder"),
        ("0001.png", "one picture of 5: pass their folder"),
        ("throw.mov", "Did you mean Throw.mov?"),
        ("t.csv", "--from-tracks"),
        ("t.txt", "--from-tracks"),
        ("t.xlsx", "--from-tracks"),
        ("a.cine", "Phantom Camera Control"),
    ],
)
def test_the_hint_names_what_was_meant(tmp_path, name, cure):
    for number in range(5):
        cv2.imwrite(str(tmp_path / f"{number:04d}.png"), scene(20, 20))
    for other in ("Throw.mov", ".b.mp4.icloud"):
        (tmp_path / other).write_bytes(b"x")
    for table in ("t.csv", "t.txt"):
        (tmp_path / table).write_text("t,x,y\n" + "0,1,2\n" * 60)
    (tmp_path / "t.xlsx").write_bytes(b"PK\3\4" + bytes(200))
    (tmp_path / "a.cine").write_bytes(b"CI\x2c\0\1\0" + bytes(200))
    path = name if "://" in name else tmp_path / name
    with pytest.raises(ClipError) as caught:
        ClipReader.open(path)
    assert cure in caught.value.hint


def test_empty_file(tmp_path):
    path = tmp_path / "empty.mp4"
    path.touch()
    assert "is empty" in refusal(path)


def test_text_under_a_video_name(tmp_path):
    path = tmp_path / "notes.mp4"
    path.write_text("these are notes\n" * 500)
    assert "holds text" in refusal(path)


def test_sound_without_pictures(tmp_path):
    assert "audio and no video" in refusal(write_sound(tmp_path / "tone.mp4"))


def test_pictures_that_no_decoder_knows(tmp_path):
    path = write_clip(tmp_path / "a.mp4", moving_disc(8))
    raw = path.read_bytes()
    assert raw.count(b"avc1") == 2
    head, _, rest = raw.rpartition(b"avc1")
    path.write_bytes(head + b"zzzz" + rest)
    assert "is not supported" in refusal(path)


def test_tags_in_another_encoding_hide_no_picture(tmp_path):
    path = write_clip(tmp_path / "a.mp4", moving_disc(8))
    raw = path.read_bytes()
    assert b"VideoHandler" in raw
    path.write_bytes(raw.replace(b"VideoHandler", b"Vid\x92oHandler"))
    assert ClipReader.open(path).info.frames == 8


def test_single_frame(tmp_path):
    assert "too few" in refusal(write_clip(tmp_path / "one.mp4", moving_disc(1)))
    cv2.imwrite(str(tmp_path / "photo.png"), scene(20, 20))
    assert "too few" in refusal(tmp_path / "photo.png")
    assert ClipReader.open(tmp_path / "photo.png", least_frames=1).info.frames == 1


def test_folder_without_images(tmp_path):
    (tmp_path / "readme.txt").write_text("x")
    assert "no images" in refusal(tmp_path)


def test_broken_image_in_a_folder(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), scene(20, 20))
    (tmp_path / "1.png").write_bytes(b"")
    with pytest.raises(ClipError, match=r"1\.png cannot be read as an image"):
        list(ClipReader.open(tmp_path).frames())


def test_cut_off_without_its_index(tmp_path):
    path = write_clip(tmp_path / "a.mp4", moving_disc(40))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert "cut off" in refusal(path)


def test_cut_off_with_its_index_is_read_as_far_as_it_goes(tmp_path):
    path = write_clip(
        tmp_path / "a.mp4", moving_disc(40), options=KEYS_OFTEN,
        container_options={"movflags": "faststart"},
    )  # fmt: skip
    path.write_bytes(path.read_bytes()[: int(0.6 * path.stat().st_size)])
    clip = ClipReader.open(path)
    frames = list(clip.frames())
    assert 10 < len(frames) < 36
    told = " ".join(clip.warnings)
    share = re.search(r"declares 40 pictures and holds (\d+) \((\d+) %\)", told)
    assert share
    assert abs(int(share.group(1)) - len(frames)) <= 1


@pytest.mark.parametrize("suffix", [".mkv", ".avi"])
def test_other_containers_cut_off(tmp_path, suffix):
    path = write_clip(tmp_path / f"a{suffix}", moving_disc(40), options=KEYS_OFTEN)
    path.write_bytes(path.read_bytes()[: int(0.6 * path.stat().st_size)])
    clip = ClipReader.open(path)
    count = len(list(clip.frames()))
    assert 10 < count < 36
    assert "cut off" in " ".join(clip.warnings)


def test_damage_in_the_middle_is_left_out_and_told(tmp_path, capfd):
    images = moving_disc(40)
    path = write_clip(tmp_path / "a.mp4", images, options=KEYS_OFTEN)
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    rng = np.random.default_rng(1)
    data[middle : middle + 600] = rng.integers(0, 256, 600, dtype=np.uint8).tobytes()
    path.write_bytes(data)
    clip = ClipReader.open(path)
    frames = list(clip.frames())
    assert 20 <= len(frames) < 40
    assert clip.info.frames == len(frames)
    assert "could not be decoded" in " ".join(clip.warnings)
    # Frames after the damage still have their own times.
    assert clip.capture_times(600.0)[-1] == pytest.approx(39 / 600)
    assert len(clip.capture_times(600.0)) == len(frames)
    last = frames[-1]
    assert last.time_s == pytest.approx(39 / 30)
    assert np.abs(last.gray.astype(int) - images[39]).mean() < 3
    # The decoder's own complaints do not reach the terminal.
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err == ""


def test_nothing_decodable(tmp_path):
    path = write_clip(tmp_path / "a.mkv", moving_disc(4), codec="mjpeg", pix_fmt="yuvj420p")
    data = path.read_bytes()
    start = data.index(b"\xff\xd8")
    path.write_bytes(data[:start] + bytes(len(data) - start))
    refusal(path)


def test_a_container_under_another_ones_name_is_read(tmp_path):
    path = write_clip(tmp_path / "a.avi", moving_disc(5))
    assert ClipReader.open(path.rename(tmp_path / "a.mp4")).info.frames == 5


def test_names_that_look_like_protocols_are_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = write_clip(tmp_path / "a.mp4", moving_disc(3))
    path.rename(tmp_path / "trial 1: jokku.mp4")
    assert ClipReader.open("trial 1: jokku.mp4").info.frames == 3


def test_a_playlist_under_a_video_name_does_not_reach_out(tmp_path):
    path = tmp_path / "list.mp4"
    path.write_text("#EXTM3U\n#EXTINF:10,\nhttp://127.0.0.1:9/clip.ts\n#EXT-X-ENDLIST\n")
    refusal(path)


def test_pictures_that_change_size_are_refused_where_they_do(tmp_path):
    parts = []
    for number, size in enumerate(((160, 120), (96, 64))):
        images = [scene(30, 30, size=size)] * 4
        parts.append(
            write_clip(
                tmp_path / f"{number}.mjpeg", images, codec="mjpeg", pix_fmt="yuvj420p",
                full_range=True,
            ).read_bytes()
        )  # fmt: skip
    path = tmp_path / "joined.mjpeg"
    path.write_bytes(b"".join(parts))
    with pytest.raises(ClipError, match="change size at frame 4, from 160×120 to 96×64"):
        list(ClipReader.open(path).frames())


def test_a_damaged_file_gives_the_same_pictures_at_every_reading(tmp_path):
    """Concealment borrows from neighbours: it must not hang on which thread came first."""
    whole = write_clip(tmp_path / "whole.mp4", moving_disc(60), options={"g": "60", "crf": "20"})
    raw = whole.read_bytes()
    random = np.random.default_rng(5)
    for attempt in range(6):
        hurt = bytearray(raw)
        for place in random.integers(len(raw) // 4, len(raw), 6 + 3 * attempt):
            hurt[place] ^= 1 << int(random.integers(8))
        path = tmp_path / f"hurt{attempt}.mp4"
        path.write_bytes(bytes(hurt))
        readings = set()
        for _ in range(4):
            try:
                pictures = [picture.gray().tobytes() for picture in VideoFile(path).pictures()]
            except ClipError as problem:
                pictures = [problem.message.encode()]
            readings.add(hash(tuple(pictures)))
        assert len(readings) == 1
