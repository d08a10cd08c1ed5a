"""What the measuring commands say to clips that are broken, or that do not show what is wanted."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from click.testing import Result
from typer.testing import CliRunner

from pipelines.cli import app
from sample_videos import Scene, Shot
from tests.pipelines.measure.small_clips import FPS, Frames, corrupted, rendered, stroke, written

TAPED = """
[camera]
distance_to_wall = "4.60 +- 0.01 m"
[wall]
ball_plane_offset = "0.45 +- 0.01 m"
[ball]
preset = "basketball"
"""


@pytest.fixture(scope="module")
def played() -> tuple[Scene, Shot]:
    return stroke()


@pytest.fixture(scope="module")
def frames(played: tuple[Scene, Shot]) -> Frames:
    return rendered(*played)


@pytest.fixture(scope="module")
def whole(frames: Frames, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(frames, tmp_path_factory.mktemp("whole") / "whole.mp4")


@pytest.fixture
def taped(tmp_path: Path) -> Path:
    path = tmp_path / "lab.toml"
    path.write_text(TAPED, encoding="utf-8")
    return path


def run(command: str, clip: Path, *options: str, fps: float = FPS) -> Result:
    arguments = [command, str(clip), "--fps", f"{fps:g}", *options]
    result = CliRunner().invoke(app, arguments)
    assert "Traceback" not in result.output
    assert result.exit_code == 0 or isinstance(result.exception, SystemExit)
    return result


def measured(clip: Path, *options: str, fps: float = FPS) -> tuple[dict[str, Any], list[str]]:
    out = clip.with_suffix(".json")
    result = run("measure", clip, "--json", str(out), "--quiet", *options, fps=fps)
    assert result.exit_code == 0, result.output
    document = json.loads(out.read_text(encoding="utf-8"))
    return document["quantities"], document["warnings"]


def holds(quantity: dict[str, Any], true: float) -> bool:
    return bool(abs(quantity["value"] - true) < 3.0 * quantity["std"])


def cut_short(whole: Path, path: Path) -> None:
    path.write_bytes(whole.read_bytes()[:30_000])


def empty(whole: Path, path: Path) -> None:
    path.write_bytes(b"")


def renamed(whole: Path, path: Path) -> None:
    path.write_text("frame,x,y\n1,2,3\n", encoding="utf-8")


def audio_only(whole: Path, path: Path) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        sound = av.AudioFrame.from_ndarray(
            np.zeros((1, 4096), np.float32), format="fltp", layout="mono"
        )
        sound.sample_rate = 44100
        for packet in [*stream.encode(sound), *stream.encode(None)]:
            container.mux(packet)


def one_frame(whole: Path, path: Path) -> None:
    with av.open(str(whole)) as container:
        picture = next(container.decode(video=0)).to_ndarray(format="bgr24")
    written([picture], path)


@pytest.mark.parametrize(
    ("damage", "said", "helps"),
    [
        (cut_short, "is cut off", "Copy it"),
        (empty, "is empty", "Copy it"),
        (renamed, "holds text or a table", "--from-tracks"),
        (audio_only, "no video", "Pass the file"),
        (one_frame, "1 frame", "whole recording"),
    ],
)
def test_a_clip_that_cannot_be_read(
    damage: Callable[[Path, Path], None], said: str, helps: str, whole: Path, tmp_path: Path
) -> None:
    clip = tmp_path / "clip.mp4"
    damage(whole, clip)
    outputs = ["--json", str(tmp_path / "r.json"), "--csv", str(tmp_path / "r.csv")]
    outputs += ["--report", str(tmp_path / "r.html"), "--overlay", str(tmp_path / "o.mp4")]
    outputs += ["--tracks", str(tmp_path / "t.csv"), "--plot", str(tmp_path / "p.png")]
    result = run("measure", clip, *outputs)
    assert result.exit_code == 3
    assert said in result.output
    assert helps in result.output
    assert list(tmp_path.iterdir()) == [clip]


@pytest.mark.slow
def test_pictures_lost_in_the_middle_are_left_out(
    whole: Path, played: tuple[Scene, Shot], tmp_path: Path, taped: Path
) -> None:
    clip = corrupted(whole, tmp_path / "clip.mp4", parts=5)
    quantities, warnings = measured(clip, "--setup", str(taped))
    assert any("could not be decoded" in warning for warning in warnings)
    assert holds(quantities["ball_speed"], float(played[1].contact.outcome.ball_speed))


@pytest.mark.parametrize("parts", [3, pytest.param(8, marks=pytest.mark.slow)])
def test_where_lost_pictures_leave_doubt_nothing_false_is_stated(
    parts: int, whole: Path, played: tuple[Scene, Shot], tmp_path: Path, taped: Path
) -> None:
    clip = corrupted(whole, tmp_path / "clip.mp4", parts=parts)
    out = tmp_path / "r.json"
    result = run("measure", clip, "--setup", str(taped), "--json", str(out), "--quiet")
    assert result.exit_code in (0, 4)
    if result.exit_code == 4:
        assert "nothing can be measured" in result.output
        assert "--ball-at" in result.output
        return
    speed = json.loads(out.read_text(encoding="utf-8"))["quantities"]["ball_speed"]
    assert speed["value"] is None or holds(speed, float(played[1].contact.outcome.ball_speed))


def test_a_still_picture_has_no_ball(frames: Frames, tmp_path: Path) -> None:
    clip = written(frames[:1] * 40, tmp_path / "clip.mp4")
    result = run("measure", clip, "--json", str(tmp_path / "r.json"))
    assert result.exit_code == 4
    assert "no ball found" in result.output
    assert "--ball-at" in result.output
    assert list(tmp_path.iterdir()) == [clip]


def test_a_pendulum_alone_is_not_taken_for_a_struck_ball(
    played: tuple[Scene, Shot], tmp_path: Path
) -> None:
    scene, shot = played
    bare = replace(scene, room=replace(scene.room, show_ball=False), frames=60)
    clip = written(rendered(bare, shot), tmp_path / "clip.mp4")
    result = run("measure", clip, "--ball", "basketball")
    assert result.exit_code == 4
    assert "ball_speed" not in result.output


def test_without_a_pendulum_the_flight_is_measured_and_the_contact_is_not(
    played: tuple[Scene, Shot], tmp_path: Path, taped: Path
) -> None:
    scene, shot = played
    bare = replace(scene, room=replace(scene.room, show_rig=False))
    clip = written(rendered(bare, shot), tmp_path / "clip.mp4")
    quantities, warnings = measured(clip, "--setup", str(taped))
    for name in ("contact_time", "contact_frames", "pendulum_speed_before", "cor", "energy_loss"):
        assert quantities[name]["value"] is None
        assert "--mass-at" in quantities[name]["reason"] or "a strike" in quantities[name]["reason"]
    assert holds(quantities["ball_speed"], float(shot.contact.outcome.ball_speed))
    assert holds(quantities["landing_distance"], float(shot.flight.landing_position[0]))
    assert any("--mass-at" in warning for warning in warnings)


@pytest.mark.slow
def test_a_ball_that_leaves_the_picture_is_not_followed_further(
    frames: Frames, played: tuple[Scene, Shot], tmp_path: Path
) -> None:
    clip = written([frame[:, :150] for frame in frames], tmp_path / "clip.mp4")
    quantities, _ = measured(clip, "--ball", "basketball")
    assert holds(quantities["ball_speed"], float(played[1].contact.outcome.ball_speed))
    for name in ("landing_distance", "landing_distance_on_wall", "landing_time", "cor_range"):
        assert quantities[name]["value"] is None
        assert "leaves the picture" in quantities[name]["reason"]


@pytest.mark.slow
def test_a_landing_below_the_picture_is_not_measured(
    frames: Frames, tmp_path: Path, taped: Path
) -> None:
    clip = written([frame[:100] for frame in frames], tmp_path / "clip.mp4")
    result = run("landing", clip, "--setup", str(taped))
    assert result.exit_code == 4
    assert "before it lands" in result.output


@pytest.mark.slow
def test_a_wall_without_a_grid_gives_no_landing(played: tuple[Scene, Shot], tmp_path: Path) -> None:
    scene, shot = played
    wall = replace(scene.room.wall, contrast=0.0, fine_contrast=0.0)
    bare = replace(scene, room=replace(scene.room, wall=wall))
    clip = written(rendered(bare, shot), tmp_path / "clip.mp4")
    result = run("landing", clip, "--ball", "basketball", "--wall-grid", "50mm")
    assert result.exit_code == 4
    assert "grid" in result.output
    assert "it needs the wall grid" in result.output


@pytest.mark.slow
@pytest.mark.parametrize("pitch", ["40mm", "60mm"])
def test_a_pitch_that_contradicts_tape_and_ball_is_not_believed(
    pitch: str, whole: Path, taped: Path
) -> None:
    result = run("landing", whole, "--setup", str(taped), "--wall-grid", pitch)
    assert result.exit_code == 4
    assert "contradict" in result.output
    assert "pitch of the grid" in result.output


def test_a_pitch_that_puts_the_ball_behind_the_wall_is_not_believed(whole: Path) -> None:
    result = run("landing", whole, "--ball", "basketball", "--wall-grid", "40mm")
    assert result.exit_code == 4
    assert "squares of 40 mm and a ball of 245.9 mm contradict each other" in result.output
    assert "--wall-grid" in result.output


@pytest.mark.slow
def test_a_bumped_camera_is_told_and_corrected(
    frames: Frames, played: tuple[Scene, Shot], tmp_path: Path, taped: Path
) -> None:
    shoved = [np.roll(f, (3, 4), (0, 1)) if i >= 60 else f for i, f in enumerate(frames)]
    clip = written(shoved, tmp_path / "clip.mp4")
    quantities, warnings = measured(clip, "--setup", str(taped))
    assert any("bumped between frames 59 and 60" in warning for warning in warnings)
    assert holds(quantities["landing_distance"], float(played[1].flight.landing_position[0]))


@pytest.mark.slow
def test_at_30_fps_the_contact_is_not_measured_and_the_rest_is_honest(
    tmp_path: Path, taped: Path
) -> None:
    scene, shot = stroke(30.0, before_s=0.5)
    clip = written(rendered(scene, shot), tmp_path / "clip.mp4")
    quantities, _ = measured(clip, "--setup", str(taped), fps=30.0)
    for name in ("contact_time", "contact_frames", "cor_speeds"):
        assert quantities[name]["value"] is None
        assert quantities[name]["reason"]
    out = shot.contact.outcome
    assert holds(quantities["ball_speed"], float(out.ball_speed))
    assert holds(quantities["launch_angle"], float(np.degrees(out.launch_angle)))
    assert holds(quantities["landing_distance"], float(shot.flight.landing_position[0]))


def test_a_fast_clip_declared_as_30_fps_is_told_by_its_fall(whole: Path) -> None:
    result = run("contact-time", whole, "--ball", "basketball", fps=30.0)
    assert result.exit_code == 4
    assert "Likely cause: " in result.output
    assert "free fall" in result.output
    assert "--fps 200" in result.output
