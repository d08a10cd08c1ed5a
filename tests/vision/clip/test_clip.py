"""What comes out of clips of every kind: the right pictures, upright, at the right times."""

import struct
import subprocess
import sys
from fractions import Fraction

import cv2
import numpy as np
import pytest

from metrology import ClipError
from tests.shared_data import shared_folder
from tests.vision.clip.written_clips import HEIGHT, WIDTH, moving_disc, repeated, scene, write_clip
from vision.clip.clip import ClipReader

LOSSLESS = {"qp": "0", "preset": "ultrafast"}


def worst_difference(clip, images):
    frames = list(clip.frames())
    assert len(frames) == len(images)
    return max(
        int(np.abs(frame.gray.astype(int) - image.astype(int)).max())
        for frame, image in zip(frames, images, strict=True)
    )


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv", ".avi"])
def test_containers_give_the_same_pictures_and_times(tmp_path, suffix):
    images = moving_disc(12)
    path = write_clip(tmp_path / f"a{suffix}", images, options={**LOSSLESS, "bf": "0"})
    clip = ClipReader.open(path)
    assert (clip.info.width, clip.info.height, clip.info.frames) == (WIDTH, HEIGHT, 12)
    assert clip.info.codec == "h264"
    # 219 levels of video range spread over 256.
    assert worst_difference(clip, images) <= 1
    assert clip.info.container_fps == pytest.approx(30.0, rel=1e-4)
    assert [frame.time_s for frame in clip.frames()] == pytest.approx(np.arange(12) / 30, abs=1e-4)
    assert not clip.warnings
    assert [frame.index for frame in clip.frames(3, 7)] == [3, 4, 5, 6]


def test_motion_jpeg_in_avi_and_alone(tmp_path):
    images = moving_disc(8)
    for name in ("a.avi", "a.mjpeg"):
        path = write_clip(
            tmp_path / name, images, codec="mjpeg", pix_fmt="yuvj420p", full_range=True,
            options={"qmin": "1", "qmax": "2"}, rate=25,
        )  # fmt: skip
        clip = ClipReader.open(path)
        assert clip.info.codec == "mjpeg"
        assert worst_difference(clip, images) <= 16
        assert [frame.time_s for frame in clip.frames()] == pytest.approx(np.arange(8) / 25)


def test_pictures_out_of_order_come_sorted(tmp_path):
    images = moving_disc(30)
    for suffix in (".mp4", ".mkv", ".avi"):
        path = write_clip(
            tmp_path / f"b{suffix}", images, options={"bf": "3", "crf": "4", "b-adapt": "0"}
        )
        clip = ClipReader.open(path)
        assert worst_difference(clip, images) <= 12, suffix
        assert [f.time_s for f in clip.frames()] == pytest.approx(np.arange(30) / 30, abs=2e-4)


def test_colour_frames_match_gray(tmp_path):
    path = write_clip(tmp_path / "a.mp4", moving_disc(4), options=LOSSLESS)
    clip = ClipReader.open(path)
    for frame, (index, colour) in zip(clip.frames(1), clip.colour_frames(1), strict=True):
        assert index == frame.index
        assert colour.shape == (HEIGHT, WIDTH, 3)
        gray = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY).astype(int)
        assert np.abs(gray - frame.gray).max() <= 2


def test_ten_bits_arrive_as_sixteen(tmp_path):
    ramp = np.tile(np.linspace(0, 65535, WIDTH), (HEIGHT, 1)).astype(np.uint16)
    for full in (False, True):
        path = write_clip(
            tmp_path / f"deep{full}.mkv", [ramp] * 3, codec="ffv1", pix_fmt="yuv420p10le",
            full_range=full,
        )  # fmt: skip
        clip = ClipReader.open(path)
        assert clip.info.bit_depth == 10
        frame = next(clip.frames())
        assert frame.gray.dtype == np.uint16
        assert np.abs(frame.gray.astype(int) - ramp).max() <= 65535 / 876
    # The step of one stored level survives: not squeezed to 8 bit on the way.
    assert len(np.unique(frame.gray)) > 150


def test_video_range_is_stretched_and_full_range_is_not(tmp_path):
    image = np.tile(np.linspace(0, 255, WIDTH), (HEIGHT, 1)).astype(np.uint8)
    for full in (False, True):
        path = write_clip(tmp_path / f"range{full}.mkv", [image] * 2, codec="ffv1", full_range=full)
        gray = next(ClipReader.open(path).frames()).gray
        assert np.abs(gray.astype(int) - image).max() <= (0 if full else 1)


def test_variable_rate_keeps_its_stamps(tmp_path):
    stamps = [0, 33, 71, 98, 160, 166, 210]
    path = write_clip(
        tmp_path / "phone.mkv", moving_disc(7), stamps=stamps, time_base=Fraction(1, 1000)
    )
    clip = ClipReader.open(path)
    assert clip.info.variable_rate
    assert [frame.time_s for frame in clip.frames()] == pytest.approx(np.array(stamps) / 1000)


def test_times_rounded_to_milliseconds_are_put_on_an_even_clock(tmp_path):
    stamps = [round(1000 * index / 600) for index in range(40)]
    path = write_clip(
        tmp_path / "fast.mkv", moving_disc(40, 1.0), stamps=stamps, time_base=Fraction(1, 1000)
    )
    clip = ClipReader.open(path)
    assert not clip.info.variable_rate
    assert clip.info.container_fps == pytest.approx(600, rel=2e-3)
    steps = np.diff([frame.time_s for frame in clip.frames()])
    assert np.ptp(steps) < 1e-9


def test_dropped_frames_leave_their_gap_and_are_told(tmp_path):
    stamps = [0, 1, 2, 3, 6, 7, 8]
    path = write_clip(tmp_path / "gap.mp4", moving_disc(7), stamps=stamps)
    clip = ClipReader.open(path)
    assert [frame.time_s for frame in clip.frames()] == pytest.approx(np.array(stamps) / 30)
    assert not clip.info.variable_rate
    assert any("2 frames are missing" in warning for warning in clip.warnings)


def test_one_long_last_frame_changes_neither_count_nor_rate(tmp_path):
    stamps = [*range(10), 60]
    path = write_clip(tmp_path / "long.mov", moving_disc(11), stamps=stamps)
    clip = ClipReader.open(path)
    assert clip.info.frames == 11
    assert clip.info.container_fps == pytest.approx(30)


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_rotated_pictures_stand_upright(tmp_path, degrees):
    upright = moving_disc(4)
    stored = [np.ascontiguousarray(np.rot90(image, -degrees // 90)) for image in upright]
    path = write_clip(tmp_path / "r.mp4", stored, options=LOSSLESS, rotation=degrees)
    clip = ClipReader.open(path)
    assert (clip.info.width, clip.info.height) == (WIDTH, HEIGHT)
    assert clip.info.rotation == degrees
    assert worst_difference(clip, upright) <= 1
    assert next(clip.colour_frames())[1].shape == (HEIGHT, WIDTH, 3)


def with_matrix(path, matrix):
    """Write a display matrix (2, 2), rows (a, b), (c, d), into the header of the clip's track."""
    data = bytearray(path.read_bytes())
    # ISO/IEC 14496-12, version 0: the matrix stands 44 bytes after the name, fixed-point 16.16
    place = data.index(b"tkhd") + 44
    (a, b), (c, d) = (np.asarray(matrix) * 65536).astype(int).tolist()
    data[place : place + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    path.write_bytes(data)


def as_displayed(image, matrix):
    """Each stored pixel x, y put where the matrix has it: x' = a x + c y, y' = b x + d y."""
    y, x = np.indices(image.shape)
    place = np.einsum("ij,ihw->jhw", np.asarray(matrix), np.stack([x, y]))
    place -= place.min(axis=(1, 2), keepdims=True)
    shown = np.zeros(tuple(place.max(axis=(1, 2))[::-1] + 1), image.dtype)
    shown[place[1], place[0]] = image
    return shown


@pytest.mark.parametrize("size", [1, 0.5, 30000])
def test_an_enlargement_alike_in_both_directions_only_turns(tmp_path, size):
    stored = moving_disc(3)
    path = write_clip(tmp_path / "m.mp4", stored, options=LOSSLESS)
    with_matrix(path, [[0, size], [-size, 0]])
    clip = ClipReader.open(path)
    assert worst_difference(clip, [as_displayed(image, [[0, 1], [-1, 0]]) for image in stored]) <= 1
    assert clip.warnings == ()


def test_unlike_enlargements_are_the_shape_of_a_pixel(tmp_path):
    path = write_clip(tmp_path / "m.mp4", moving_disc(3), options=LOSSLESS)
    with_matrix(path, [[2, 0], [0, 1]])
    clip = ClipReader.open(path)
    assert (clip.info.width, clip.info.height) == (2 * WIDTH, HEIGHT)
    assert all("measured as stored" not in said for said in clip.warnings)


@pytest.mark.parametrize("across", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
@pytest.mark.parametrize("crossed", [False, True])
def test_every_turned_and_mirrored_picture_stands_upright(tmp_path, across, crossed):
    one, other = across
    matrix = [[0, one], [other, 0]] if crossed else [[one, 0], [0, other]]
    stored = moving_disc(3)
    path = write_clip(tmp_path / "m.mp4", stored, options=LOSSLESS)
    with_matrix(path, matrix)
    clip = ClipReader.open(path)
    shown = [as_displayed(image, matrix) for image in stored]
    assert (clip.info.height, clip.info.width) == shown[0].shape
    assert worst_difference(clip, shown) <= 1
    assert clip.warnings == ()


@pytest.mark.parametrize(
    "matrix",
    [
        [[0.96, 0.29], [-0.29, 0.96]],
        [[0, 0], [0, 0]],
        [[1, 1], [1, 1]],
    ],
)
def test_a_matrix_that_is_no_quarter_turn_leaves_pictures_as_stored_and_is_told(tmp_path, matrix):
    stored = moving_disc(3)
    path = write_clip(tmp_path / "m.mp4", stored, options=LOSSLESS)
    with_matrix(path, matrix)
    clip = ClipReader.open(path)
    assert worst_difference(clip, stored) <= 1
    assert any("measured as stored" in said for said in clip.warnings)


def test_a_folder_of_images_is_a_clip_in_natural_order(tmp_path):
    images = moving_disc(12)
    for index, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"frame{index}.png"), image)
    (tmp_path / "notes.txt").write_text("not an image")
    clip = ClipReader.open(tmp_path)
    assert clip.info.frames == 12
    assert not clip.info.container_declares_rate
    assert worst_difference(clip, images) == 0


def test_deep_images_stay_deep(tmp_path):
    deep = (moving_disc(2)[0].astype(np.uint16)) * 257
    for index in range(2):
        cv2.imwrite(str(tmp_path / f"{index}.tif"), deep)
    frame = next(ClipReader.open(tmp_path).frames())
    assert np.array_equal(frame.gray, deep)


def test_images_of_mixed_sizes_are_refused_with_their_name(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), scene(30, 30))
    cv2.imwrite(str(tmp_path / "1.png"), scene(30, 30, size=(80, 60)))
    with pytest.raises(ClipError, match=r"1\.png is 80×60 px"):
        list(ClipReader.open(tmp_path).frames())


def test_digest_names_the_file(tmp_path):
    path = write_clip(tmp_path / "a.mp4", moving_disc(3))
    import hashlib

    assert ClipReader.open(path).info.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_real_clips_have_the_frames_and_times_of_their_truth():
    folder = shared_folder("clips")
    counts = {
        "projectile_A_canon240.mp4": 663,
        "puck_collision_A_canon240.mp4": 604,
        "pendulum_bag_wall_360p30.mp4": 334,
        "balltoss_480p15_tracker.mp4": 13,
        "balltoss_480p30.mov": 32,
        "toss_green_720p30.mp4": 60,
    }
    for name, count in counts.items():
        clip = ClipReader.open(folder / name)
        times = [frame.time_s for frame in clip.frames()]
        assert len(times) == clip.info.frames == count, name
        assert times[0] == 0.0
        assert np.all(np.diff(times) > 0)
        assert clip.info.weave == "progressive", name
        assert not clip.warnings, name
    # The pauses of the .mov stay where they are: 28 ticks of 1/600 s, then 20 each.
    times = np.array(
        [frame.time_s for frame in ClipReader.open(folder / "balltoss_480p30.mov").frames()]
    )
    assert np.diff(times) * 600 == pytest.approx([28] + [20] * 30)


def test_an_edit_list_hides_pictures_and_time_starts_at_the_first_shown(tmp_path):
    images = moving_disc(20)
    path = write_clip(
        tmp_path / "edited.mp4", images, stamps=list(range(-6, 14)), options={**LOSSLESS, "bf": "0"}
    )
    clip = ClipReader.open(path)
    assert clip.info.frames == 14
    assert worst_difference(clip, images[6:]) <= 1
    assert [frame.time_s for frame in clip.frames()] == pytest.approx(np.arange(14) / 30)
    assert not clip.warnings


def test_oblong_pixels_become_square(tmp_path):
    round_disc = scene(80, 60, radius=30)
    squeezed = cv2.resize(round_disc, (WIDTH // 2, HEIGHT), interpolation=cv2.INTER_AREA)
    path = write_clip(tmp_path / "dv.mp4", [squeezed] * 3, options=LOSSLESS, pixel_aspect=2)
    clip = ClipReader.open(path)
    assert (clip.info.width, clip.info.height) == (WIDTH, HEIGHT)
    weight = np.clip(next(clip.frames()).gray.astype(float) - 180, 0, None)
    rows, columns = np.indices(weight.shape)
    assert (weight * columns).sum() / weight.sum() == pytest.approx(80, abs=0.3)
    assert (weight * rows).sum() / weight.sum() == pytest.approx(60, abs=0.3)


@pytest.mark.slow
def test_memory_stays_flat_over_ten_seconds_of_1080p(tmp_path):
    """A child process reads 18 000 pictures of 1920×1080 and tells its peak resident memory."""
    second = write_clip(
        tmp_path / "part.mp4",
        [scene(400 + 30 * index, 500, radius=90, size=(1920, 1080)) for index in range(30)],
        options={"preset": "ultrafast", "crf": "35", "bf": "0"},
    )
    path = repeated(second, tmp_path / "long.mp4", 600)
    script = (
        "import resource, sys; from vision.clip.clip import ClipReader\n"
        "clip = ClipReader.open(sys.argv[1]); count = sum(1 for frame in clip.frames())\n"
        "print(count, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)"
    )
    printed = subprocess.run(
        [sys.executable, "-c", script, str(path)], check=True, capture_output=True, text=True
    ).stdout.split()
    assert int(printed[0]) == 18_000
    print(f"peak resident memory {float(printed[1]):.0f} MB")
    assert float(printed[1]) < 500.0


def test_capture_times_keep_gaps_and_need_no_decoding(tmp_path):
    stamps = [0, 1, 2, 3, 6, 7, 8]
    path = write_clip(tmp_path / "gap.mp4", moving_disc(7), stamps=stamps)
    clip = ClipReader.open(path)
    before = clip.capture_times(600.0)
    assert before == pytest.approx(np.array(stamps) / 600)
    list(clip.frames())
    assert clip.capture_times(600.0) == pytest.approx(before)
    for index in range(3):
        cv2.imwrite(str(tmp_path / f"{index}.png"), scene(20, 20))
    assert ClipReader.open(tmp_path).capture_times(600.0) == pytest.approx(np.arange(3) / 600)


def _in_sixteen_bit(cine: bytes) -> bytes:
    """A Phantom recording of 8 bit with 257 times its gray levels, as its cameras store 16 bit."""
    count, info, _, offsets = struct.unpack_from("<20xiIII", cine)
    width, height = struct.unpack_from("<ii", cine, info + 4)
    header = bytearray(cine[:offsets])
    struct.pack_into("<H", header, info + 14, 16)
    struct.pack_into("<I", header, info + 20, 2 * width * height)
    blocks = []
    for place in struct.unpack_from(f"<{count}q", cine, offsets):
        start = place + struct.unpack_from("<I", cine, place)[0]
        pixels = np.frombuffer(cine[start : start + width * height], np.uint8).astype("<u2") * 257
        note = cine[place : start - 4] + struct.pack("<I", 2 * width * height)
        blocks.append(note + pixels.tobytes())
    places = offsets + 8 * count + np.cumsum([0, *map(len, blocks[:-1])])
    return bytes(header) + struct.pack(f"<{count}q", *places.tolist()) + b"".join(blocks)


def test_a_phantom_recording_of_16_bit_has_the_same_pictures(tmp_path):
    phantom = shared_folder("inputs") / "r17_phantom_7_frames.cine"
    (tmp_path / "deep.cine").write_bytes(_in_sixteen_bit(phantom.read_bytes()))
    deep = list(ClipReader.open(tmp_path / "deep.cine").frames())
    plain = list(ClipReader.open(phantom).frames())
    assert len(deep) == len(plain)
    for one, other in zip(deep, plain, strict=True):
        assert np.array_equal(one.gray, other.gray.astype(np.uint16) * 257)


def test_lines_stored_from_the_bottom_are_read_upright():
    folder = shared_folder("inputs")
    phantom = ClipReader.open(folder / "r17_phantom_7_frames.cine")
    frames = list(phantom.frames())
    coloured = [image for _, image in phantom.colour_frames()]
    # other pictures of the same strike: the scene stands still
    same = next(ClipReader.open(folder / "base_strike.mkv").frames()).gray
    small = cv2.resize(same, frames[0].gray.shape[::-1], interpolation=cv2.INTER_AREA)
    for frame, image in zip(frames, coloured, strict=True):
        for read in (frame.gray, image.mean(axis=2)):
            upright, turned = (
                np.corrcoef(small.ravel(), one.ravel())[0, 1] for one in (read, read[::-1])
            )
            assert upright > 0.8
            assert turned < 0.2
