"""Written clips: contents, size, exactness and refusals."""

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from bench.shipped import CLIPS, FOLDER
from measuring.setup.file import load_setup
from metrology import UsageError
from sample_videos import (
    Encoding,
    Scene,
    Shot,
    Truth,
    default_scene,
    render_clip,
    render_frames,
    staged,
)
from sample_videos.render import write_clip
from sample_videos.truth import truth_path

RESULT_NAMES = {
    "contact_frames", "contact_time", "contact_start", "contact_end", "pendulum_speed_before",
    "pendulum_speed_after", "ball_speed", "launch_angle", "landing_distance",
    "landing_distance_on_wall", "landing_time", "cor_speeds", "cor_launch", "cor_range",
    "external_impulse", "energy_loss", "backswing_angle", "ball_plane_offset", "camera_distance",
}  # fmt: skip


@lru_cache
def tiny() -> tuple[Scene, Shot]:
    scene, shot = staged(90.0, default_scene(size=(96, 54)))
    return replace(scene, frames=12), shot


def decoded(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]


def rendered(path: Path, **encoding: object) -> Truth:
    scene, shot = tiny()
    return render_clip(replace(scene, encoding=Encoding(**encoding)), shot, path)


def test_lossless_clips_contain_the_exact_pixels(tmp_path: Path) -> None:
    rendered(tmp_path / "a.mkv", codec="ffv1")
    rendered(tmp_path / "b", codec="png")
    film = decoded(tmp_path / "a.mkv")
    pictures = [cv2.imread(str(p)) for p in sorted((tmp_path / "b").glob("*.png"))]
    assert len(film) == len(pictures) == 12
    assert all(np.array_equal(one, two) for one, two in zip(film, pictures, strict=True))


def test_h264_is_close_to_the_pixels_and_has_the_requested_rate(tmp_path: Path) -> None:
    rendered(tmp_path / "a.mkv", codec="ffv1")
    rendered(tmp_path / "a.mp4", bitrate=2e6, container_fps=25.0)
    with av.open(str(tmp_path / "a.mp4")) as container:
        assert float(container.streams.video[0].average_rate) == 25.0
        luma = next(container.decode(video=0)).to_ndarray(format="yuv420p")[:54].astype(float)
    blue, green, red = np.moveaxis(decoded(tmp_path / "a.mkv")[0].astype(float), -1, 0)
    # ITU-R BT.601, limited range
    wanted = 16 + 219 / 255 * (0.299 * red + 0.587 * green + 0.114 * blue)
    assert abs(np.mean(luma - wanted)) < 0.4
    assert np.std(luma - wanted) < 6.0


def test_a_lower_bitrate_gives_a_smaller_file(tmp_path: Path) -> None:
    for rate in (2e5, 2e6):
        rendered(tmp_path / f"{rate:.0f}.mp4", bitrate=rate)
    small, large = ((tmp_path / f"{rate:.0f}.mp4").stat().st_size for rate in (2e5, 2e6))
    assert small < 0.6 * large


def test_the_truth_file_contains_the_truth(tmp_path: Path) -> None:
    truth = rendered(tmp_path / "a.mkv", codec="ffv1")
    read = json.loads(truth_path(tmp_path / "a.mkv").read_text())
    assert set(read["quantities"]) == RESULT_NAMES
    assert read["quantities"]["launch_angle"]["value"] == truth.quantities["launch_angle"][0]
    assert len(read["frames"]["ball_px"]) == 12
    assert read["frames"]["ball_px"][3] == pytest.approx(truth.frames.ball_px[3], abs=1e-4)
    assert read["quantities"]["landing_distance"]["value"] is None


def test_quantities_agree_with_each_other() -> None:
    scene, shot = staged(90.0, default_scene(size=(96, 54)))
    _, truth = render_frames(scene, shot)
    value = {name: number for name, (number, _) in truth.quantities.items()}
    touching = (truth.frames.time >= 0) & (truth.frames.time <= value["contact_time"])
    assert value["contact_frames"] == np.count_nonzero(touching)
    assert value["contact_end"] - value["contact_start"] == pytest.approx(value["contact_time"])
    far = value["camera_distance"] / (value["camera_distance"] - value["ball_plane_offset"])
    assert value["landing_distance_on_wall"] == pytest.approx(
        value["landing_distance"] * far, rel=2e-3
    )
    assert value["external_impulse"] == pytest.approx(0.353 * value["ball_speed"])
    body = scene.pendulum
    squares = value["pendulum_speed_before"] ** 2 - value["pendulum_speed_after"] ** 2
    assert value["energy_loss"] == pytest.approx(0.5 * body.inertia * squares / body.length**2)
    assert value["landing_distance"] == pytest.approx(shot.flight.landing_position[0])


@pytest.mark.parametrize(
    ("name", "codec"), [("a.avi", "h264"), ("a.mp4", "ffv1"), ("a.txt", "mjpeg"), ("a.png", "png")]
)
def test_a_suffix_that_does_not_match_the_codec_is_refused(
    tmp_path: Path, name: str, codec: str
) -> None:
    with pytest.raises(UsageError, match="does not go with"):
        rendered(tmp_path / name, codec=codec)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_left_after_a_failed_rendering(tmp_path: Path) -> None:
    def frames() -> object:
        yield np.zeros((54, 96, 3), np.uint8)
        raise RuntimeError("the lamp went out")

    for name, codec in (("a.mp4", "h264"), ("b", "png")):
        with pytest.raises(RuntimeError):
            write_clip(frames(), tmp_path / name, Encoding(codec=codec))
    with pytest.raises(UsageError, match="no frames"):
        write_clip(iter(()), tmp_path / "c.mp4", Encoding())
    assert list(tmp_path.iterdir()) == []


def test_odd_sizes_and_missing_folders_are_refused(tmp_path: Path) -> None:
    odd = iter([np.zeros((55, 97, 3), np.uint8)])
    with pytest.raises(UsageError, match="can't hold"):
        write_clip(odd, tmp_path / "a.mp4", Encoding())
    picture = np.zeros((54, 96, 3), np.uint8)
    (tmp_path / "there").mkdir()
    with pytest.raises(UsageError, match="exists"):
        write_clip(iter([picture]), tmp_path / "there", Encoding(codec="png"))
    for name, codec in (("no/a.mp4", "h264"), ("no/b", "png")):
        with pytest.raises(UsageError, match="can't write"):
            write_clip(iter([picture]), tmp_path / name, Encoding(codec=codec))


@pytest.mark.parametrize("sample", CLIPS, ids=lambda s: s.name)
def test_the_shipped_clips_are_small_and_complete(sample: object) -> None:
    clip = FOLDER / f"{sample.name}.mp4"
    assert clip.stat().st_size < 600_000
    truth = json.loads(truth_path(clip).read_text())
    pictures = decoded(clip)
    assert len(pictures) == len(truth["frames"]["time_s"])
    assert pictures[0].shape == (*sample.size[::-1], 3)
    assert all(entry["value"] is not None for entry in truth["quantities"].values())
    setup = load_setup(FOLDER / f"{sample.name}.toml")
    distance = setup.camera.distance_to_wall
    assert distance is not None
    assert abs(distance[0] - truth["camera"]["position_m"][2]) < 3 * distance[1]
    assert setup.ball is not None
    assert setup.ball.name == sample.ball


def test_writing_is_reproducible(tmp_path: Path) -> None:
    noise = np.random.default_rng(1)
    scene = cv2.GaussianBlur(noise.integers(0, 256, (134, 260, 3), dtype=np.uint8), (0, 0), 2.0)
    grain = noise.integers(0, 8, (24, 134, 240, 3), dtype=np.uint8)
    pictures = [np.ascontiguousarray(scene[:, i // 2 : i // 2 + 240] + grain[i]) for i in range(24)]
    clips = set()
    for turn in range(8):
        path = tmp_path / f"{turn}.mp4"
        write_clip(iter(pictures), path, Encoding(rate_factor=16.0))
        clips.add(path.read_bytes())
    assert len(clips) == 1
