"""`vision render` as a person types it."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from measuring.setup.file import Setup, read_setup
from metrology import ImpactVisionError, UsageError
from pipelines.render import RenderOptions, parse_size, planned_scene, render_command

app = typer.Typer()
app.command()(render_command)
SMALL = ["--size", "96x54", "--frames", "3"]


def run(*arguments: str) -> object:
    return CliRunner().invoke(app, list(arguments))


def test_a_clip_and_its_truth_are_written(tmp_path: Path) -> None:
    setup = tmp_path / "lab.toml"
    setup.write_text('[ball]\npreset = "basketball"\n[camera]\ndistance_to_wall = "4.10 m"\n')
    out = tmp_path / "a.mp4"
    result = run("--setup", str(setup), "-o", str(out), "--backswing", "60 deg", *SMALL)
    assert result.exit_code == 0, result.output
    assert out.stat().st_size > 500
    truth = json.loads((tmp_path / "a.truth.json").read_text())
    assert truth["bodies"]["ball"]["name"] == "basketball"
    assert truth["camera"]["position_m"][2] == pytest.approx(4.10)
    assert truth["physics"]["backswing_deg"] == pytest.approx(60.0)
    assert len(truth["frames"]["time_s"]) == 3


def test_the_seed_decides_and_the_options_reach_the_scene() -> None:
    options = RenderOptions(
        math.radians(90), size=(96, 54), fps=300.0, shutter=1e-3, readout=2e-3, view="oblique",
        noise=0.0, mirrored=True, codec="ffv1",
    )  # fmt: skip
    scene, _ = planned_scene(Setup(), options)
    assert (scene.shutter.fps, scene.shutter.exposure, scene.shutter.readout) == (300, 1e-3, 2e-3)
    assert scene.sensor.full_well == 0.0
    assert scene.mirrored
    assert scene.camera.lens.k1 == -0.21
    assert scene.encoding.codec == "ffv1"


@pytest.mark.parametrize("view", ["landing", "oblique"])
@pytest.mark.parametrize("ball", ["jokku", "basketball"])
def test_rest_pendulum_and_landing_are_all_in_view(view: str, ball: str) -> None:
    scene, shot = planned_scene(Setup(), RenderOptions(ball=ball, view=view, size=(640, 360)))
    places = np.stack(
        [shot.flight.landing_position, [0.0, scene.support.height, 0.45], [-0.25, 0.5, 0.45]]
    )
    px = scene.camera.project(places)
    assert np.all((px > 4) & (px < [635, 355]))
    assert scene.frame_time(scene.frames - 1) > shot.landing_time


def test_effects_of_the_catalogue_enter_the_motion() -> None:
    plain = planned_scene(Setup(), RenderOptions())[1]
    spun = planned_scene(Setup(), RenderOptions(effects=("magnus:spin=40",)))[1]
    braked = planned_scene(Setup(), RenderOptions(effects=("bearing_friction:dry_torque=0.5",)))[1]
    assert abs(spun.landing_time - plain.landing_time) > 0.01
    assert float(braked.contact.outcome.impact_speed) < float(plain.contact.outcome.impact_speed)


def test_faults_of_the_recording_are_options(tmp_path: Path) -> None:
    out = tmp_path / "a.mkv"
    options = ["--codec", "ffv1", "--drop", "1", "--shake", "1.5", "--roll", "2 deg"]
    result = run("-o", str(out), *SMALL, *options, "--quiet")
    assert result.exit_code == 0, result.output
    truth = json.loads((tmp_path / "a.truth.json").read_text())
    assert len(truth["frames"]["time_s"]) == 2
    turned = np.array(truth["camera"]["rotation_world_to_camera"])
    assert math.degrees(math.atan2(-turned[0, 1], turned[0, 0])) == pytest.approx(2.0, abs=0.5)
    assert truth["shake"]["amplitude"] == 1.5


def test_a_principal_point_in_the_setup_places_the_camera() -> None:
    setup = read_setup(
        '[camera]\nprincipal_point_on_wall = ["1.10 m", "0.60 m"]\ndistance_to_wall = "4 m"\n'
    )
    scene, shot = planned_scene(setup, RenderOptions(size=(96, 54)))
    assert scene.camera.axis_foot == pytest.approx([1.10, 0.60])
    assert np.all(np.isfinite(scene.camera.project(shot.flight.landing_position)))


@pytest.mark.parametrize(
    "wrong",
    [
        ["--size", "big"],
        ["--size", "2x2"],
        ["--noise", "loud"],
        ["--view", "above"],
        ["--codec", "vp9"],
        ["--shutter", "1 s"],
        ["--shutter", "0 s"],
        ["--bitrate", "-5"],
        ["--ball", "melon"],
        ["--backswing", "1 parsec"],
        ["--backswing", "200 deg"],
        ["--effect", "moonlight"],
        ["--effect", "oblique_impact"],
    ],
)
def test_what_can_not_be_is_refused_and_nothing_is_written(
    tmp_path: Path, wrong: list[str]
) -> None:
    result = run("-o", str(tmp_path / "a.mp4"), *SMALL, *wrong)
    assert isinstance(result.exception, ImpactVisionError)
    assert result.exception.exit_code == 2
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_refused_before_the_work(tmp_path: Path) -> None:
    result = run("-o", str(tmp_path / "no" / "a.mp4"), *SMALL)
    assert isinstance(result.exception, UsageError)


def test_sizes_are_read_with_either_cross() -> None:
    assert parse_size("432x240") == parse_size("432 × 240") == (432, 240)


def test_help_has_an_example() -> None:
    assert "vision render --setup" in run("--help").output
