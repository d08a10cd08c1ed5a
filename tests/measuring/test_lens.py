"""A lens of the setup file, and the foot of the optical axis, as the measuring chain uses them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.calibration import Calibration
from calib.grid import WallGrid
from calib.lens import LensPrior
from calib.solve import calibrate, planned_grid
from measuring import metres
from measuring.inputs import Inputs, gather_inputs
from metrology import SetupError
from pipelines.calibrate.plan import Filming, film_scene, planned_setup, planned_tracks
from sample_videos.scene import Scene
from vision.tracks import Tracks

FILMING = Filming(width=432, height=240, tape_std_m=None)


@pytest.fixture(scope="module")
def filmed() -> tuple[Scene, Tracks, Inputs]:
    scene, shot = film_scene(FILMING)
    tracks = planned_tracks(FILMING, scene, shot)
    return scene, tracks, gather_inputs(planned_setup(FILMING, scene), None, None)


def lens_file(scene: Scene, path: Path, *, width: int = 864, height: int = 480) -> Path:
    """The true lens at twice the clip's size, its focal length known to a thousandth."""
    lens = scene.camera.lens.resized(width, height)
    numbers = {name: getattr(lens, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    lines = ["[lens]", *(f"{name} = {value}" for name, value in numbers.items())]
    lines += [f"k1 = {lens.k1}", "[std]", f"fx = {lens.fx / 1000}", "cx = 1.0", "cy = 1.0"]
    lines += ["k1 = 0.002", "k2 = 0.002"]
    path.write_text("\n".join(lines))
    return path


def with_lens(inputs: Inputs, path: Path) -> Inputs:
    camera = replace(inputs.setup.camera, lens=path)
    return replace(inputs, setup=replace(inputs.setup, camera=camera))


def test_the_lens_of_the_setup_is_the_prior_of_the_clip(
    filmed: tuple[Scene, Tracks, Inputs], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, tracks, inputs = filmed
    grid = planned_grid(scene.camera)

    def seen(*_: object, **__: object) -> WallGrid:
        return grid

    monkeypatch.setattr(metres, "find_wall_grid", seen)
    plain = metres.calibrate_clip(tracks, inputs).calibration
    known = metres.calibrate_clip(
        tracks, with_lens(inputs, lens_file(scene, tmp_path / "lens.toml"))
    ).calibration

    def open_distance(c: Calibration) -> float:
        return float(np.sqrt(c.covariance[5, 5]))

    assert "lens calibration" in {source.name for source in known.sources}
    assert known.grid_camera.lens.fx == pytest.approx(scene.camera.lens.fx, rel=1e-3)
    assert known.camera_distance == pytest.approx(scene.camera.position[2], rel=2e-3)
    assert open_distance(known) < 0.002
    assert open_distance(plain) > 20.0 * open_distance(known)


def test_a_lens_of_another_picture_is_refused(
    filmed: tuple[Scene, Tracks, Inputs], tmp_path: Path
) -> None:
    scene, tracks, inputs = filmed
    other = lens_file(scene, tmp_path / "lens.toml", width=640, height=480)
    with pytest.raises(SetupError, match="another aspect ratio"):
        metres.known_lens(tracks, with_lens(inputs, other))
    with pytest.raises(SetupError, match="can't read"):
        metres.known_lens(tracks, with_lens(inputs, tmp_path / "none.toml"))
    assert metres.known_lens(tracks, inputs) is None


def test_the_uncertainty_of_the_lens_is_carried_on(
    filmed: tuple[Scene, Tracks, Inputs],
) -> None:
    scene, tracks, inputs = filmed
    evidence = metres.scene_evidence(tracks, inputs)
    grid = planned_grid(scene.camera)
    landing = scene.camera.project([1.9, 0.1, scene.room.plane])

    def adds(focal: float) -> float:
        prior = LensPrior(scene.camera.lens, np.array([focal, 1.0, 1.0, 0.002, 0.002]))
        found = calibrate(grid, evidence, lens=prior)
        budget = found.budget(lambda c: float(c.position(landing)[0][0]))
        return next(line.std for line in budget if line.source == "lens calibration")

    assert adds(0.01) > 1.5 * adds(0.002)


def test_the_foot_of_the_axis_needs_the_ball_and_the_floor_it_is_measured_from(
    filmed: tuple[Scene, Tracks, Inputs],
) -> None:
    scene, tracks, inputs = filmed
    foot = scene.camera.axis_foot
    told = ((float(foot[0]), 0.005), (float(foot[1]), 0.005))
    camera = replace(inputs.setup.camera, principal_point_on_wall=told)
    inputs = replace(inputs, setup=replace(inputs.setup, camera=camera))
    evidence = metres.scene_evidence(tracks, inputs)
    assert evidence.axis_foot_x is not None
    assert evidence.axis_foot_y is not None
    found = calibrate(planned_grid(scene.camera), evidence)
    assert found.camera.axis_foot == pytest.approx(foot, abs=0.003)
    assert not found.warnings
    # a floor nobody knows gives no height; without a ball at rest the world has no origin at all
    floorless = metres.scene_evidence(tracks, replace(inputs, fall=None))
    assert floorless.axis_foot_x is not None
    assert floorless.axis_foot_y is None
    nowhere = metres.scene_evidence(replace(tracks, rest_frames=None), inputs)
    assert nowhere.axis_foot_x is None
    assert nowhere.axis_foot_y is None
