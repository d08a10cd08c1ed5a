"""The calibration a measurement uses: positions, one input moved at a time, and a fall fused in."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib.calibration import Calibration
from calib.camera import Camera, Lens
from calib.free_fall import with_free_fall
from calib.grid import WallGrid
from calib.grid_phase import GridMap
from calib.scene import SceneCalibration, calibrate
from metrology import CalibrationError

FloatArray = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

SIZE = (640, 360)
DISTANCE, DEPTH, RADIUS = 3.6, 0.5, 0.1229
TAPE_D, TAPE_BALL = (DISTANCE, 0.005), (DEPTH, 0.005)
DIAMETER = (2 * RADIUS, 0.0005)
GRAVITY = 9.806


@dataclass(frozen=True)
class Scene:
    camera: Camera
    grid: WallGrid
    flight: FloatArray
    flight_px: FloatArray
    outline: tuple[FloatArray, FloatArray, FloatArray]


def make_scene(*, pitch: float = 0.05, noise: float = 0.03, seed: int = 0) -> Scene:
    """A nearly square view of a wall, its nodes 0.03 px noisy, and a throw across the picture."""
    rng = np.random.default_rng(seed)
    lens = Lens.centred(*SIZE, 900.0, k1=-0.1)
    camera = Camera.facing_wall(lens, [1.0, 0.6, DISTANCE], yaw=0.01, pitch=-0.02, roll=0.02)
    nodes = np.stack(np.meshgrid(np.arange(-10, 50), np.arange(-10, 40)), axis=-1).reshape(-1, 2)
    px = camera.project(np.c_[0.05 * nodes, np.zeros(len(nodes))])
    inside = ((px > 2.0) & (px < np.array(SIZE) - 3.0)).all(axis=1)
    count = int(inside.sum())
    grid = WallGrid(
        size=SIZE,
        pitch_m=pitch,
        nodes=nodes[inside],
        points_px=px[inside] + rng.normal(0.0, noise, (count, 2)),
        covariance_px2=np.broadcast_to(noise**2 * np.eye(2), (count, 2, 2)),
        residual_px=np.zeros((count, 2)),
        map=GridMap(np.zeros(2), np.ones(2), np.zeros(10)),
        area=np.ones(SIZE[::-1], dtype=bool),
        dark=True,
        fine_ratio=5,
        origin_m=np.zeros(2),
    )
    time = np.linspace(0.0, 0.42, 40)
    flight = np.c_[
        0.15 + 3.4 * time, 0.45 + 1.6 * time - 0.5 * GRAVITY * time**2, np.full(40, DEPTH)
    ]
    flight_px, radius_px = camera.sphere_outline(flight, RADIUS)
    return Scene(camera, grid, flight, flight_px, (flight_px, radius_px, np.full(40, 0.02)))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene()


@pytest.fixture(scope="module")
def taped(scene: Scene) -> SceneCalibration:
    return calibrate(
        scene.grid, SIZE, distance=TAPE_D, ball_plane_offset=TAPE_BALL, ball_diameter=DIAMETER
    )


@pytest.fixture(scope="module")
def untaped(scene: Scene) -> SceneCalibration:
    return calibrate(scene.grid, SIZE, ball_diameter=DIAMETER, ball_outline=scene.outline)


def length(scene: Scene) -> Callable[[SceneCalibration], float]:
    ends = scene.flight_px[[0, -1]]
    return lambda c: float(np.diff(c.on_ball_plane(ends, RADIUS)[:, 0])[0])


def seen_gravity(c: SceneCalibration, scene: Scene) -> float:
    time = np.linspace(0.0, 0.42, 40)
    y = c.on_ball_plane(scene.flight_px, RADIUS)[:, 1]
    return float(-2.0 * np.polyfit(time, y, 2)[0])


def test_taped_scene_gives_positions_on_the_ball_plane(
    taped: SceneCalibration, scene: Scene
) -> None:
    found = taped.on_ball_plane(scene.flight_px, RADIUS)
    # Counted from the start: where the principal point is, nobody told
    error = found - found[0] - (scene.flight[:, :2] - scene.flight[0, :2])
    assert np.abs(error).max() < 0.001
    assert taped.ball_plane_offset.source == "tape"
    assert taped.camera_distance.value == pytest.approx(DISTANCE, abs=0.001)


def test_wall_readings_and_ball_centres(taped: SceneCalibration, scene: Scene) -> None:
    np.testing.assert_allclose(
        taped.on_wall(scene.grid.points_px), scene.grid.wall_m, atol=5 * 0.03 * DISTANCE / 900
    )
    centre_px = scene.camera.project(scene.flight)
    assert np.abs(centre_px - scene.flight_px).max() > 0.1
    np.testing.assert_allclose(taped.ball_centre_px(scene.flight_px, RADIUS), centre_px, atol=0.01)


def test_jacobian_is_the_derivative(taped: SceneCalibration, scene: Scene) -> None:
    px = scene.flight_px[::10]
    step = np.array([0.3, -0.2])
    moved = taped.on_ball_plane(px + step, 0.0) - taped.on_ball_plane(px, 0.0)
    np.testing.assert_allclose(taped.jacobian(px) @ step, moved, rtol=1e-3, atol=1e-7)


def test_shifts_add_up_to_the_covariance(taped: SceneCalibration, scene: Scene) -> None:
    told = length(scene)
    effects = [
        0.5 * (told(taped.shifted(i, 1.0)) - told(taped.shifted(i, -1.0)))
        for i in range(len(taped.names))
    ]

    def of_fit(fit: Calibration) -> float:
        return told(replace(taped, fit=fit))

    slope = taped.fit.gradient(of_fit)
    expected = float(np.sqrt(slope @ taped.fit.covariance @ slope))
    assert np.linalg.norm(effects) == pytest.approx(expected, rel=0.03)
    assert len(set(taped.names)) == len(taped.names)


def test_plane_offset_shift_is_what_a_wrong_tape_does(
    taped: SceneCalibration, scene: Scene
) -> None:
    index = taped.names.index("ball plane offset by tape")
    moved = taped.shifted(index, 1.0)
    assert abs(moved.ball_plane_offset.value - taped.ball_plane_offset.value) == pytest.approx(
        0.005, rel=0.02
    )
    ratio = length(scene)(moved) / length(scene)(taped)
    assert abs(ratio - 1.0) == pytest.approx(0.005 / (DISTANCE - DEPTH), rel=0.1)
    back = moved.shifted(index, -1.0)
    assert back.ball_plane_offset.value == pytest.approx(taped.ball_plane_offset.value)


def test_without_tape_the_ball_tells_the_scale(untaped: SceneCalibration, scene: Scene) -> None:
    truth = scene.flight[-1, 0] - scene.flight[0, 0]
    assert length(scene)(untaped) == pytest.approx(truth, rel=0.02)


def test_a_fall_narrows_the_scale(untaped: SceneCalibration, scene: Scene) -> None:
    truth = scene.flight[-1, 0] - scene.flight[0, 0]
    fused = with_free_fall(
        untaped, (seen_gravity(untaped, scene), 0.01), GRAVITY, px=scene.flight_px
    )
    assert length(scene)(fused) == pytest.approx(truth, rel=0.0015)
    assert "free fall" in fused.names
    assert fused.warnings == untaped.warnings


def test_a_fall_that_contradicts_the_tape_is_told(scene: Scene) -> None:
    wrong = calibrate(
        scene.grid,
        SIZE,
        distance=(DISTANCE, 0.005),
        ball_plane_offset=(DEPTH - 0.15, 0.005),
        ball_diameter=DIAMETER,
    )
    apparent = seen_gravity(wrong, scene)
    fused = with_free_fall(wrong, (apparent, 0.01), GRAVITY, px=scene.flight_px)
    told = " ".join(fused.warnings)
    assert "instead of 9.81" in told
    assert "too long" in told
    assert "pitch of the grid" in told
    assert "capture rate" in told


def test_a_diameter_that_contradicts_the_tape_is_told(scene: Scene) -> None:
    c = calibrate(
        scene.grid,
        SIZE,
        distance=(DISTANCE, 0.005),
        ball_plane_offset=(DEPTH - 0.2, 0.005),
        ball_diameter=DIAMETER,
        ball_outline=scene.outline,
    )
    assert any("contradict" in w and "ball diameter" in w for w in c.warnings)


def test_a_wrong_pitch_shows_in_the_ball() -> None:
    def of_pitch(pitch: float) -> SceneCalibration:
        scene = make_scene(pitch=pitch)
        return calibrate(
            scene.grid,
            SIZE,
            ball_diameter=DIAMETER,
            ball_outline=scene.outline,
            lens=scene.camera.lens,
        )

    with pytest.raises(CalibrationError, match="in front of the wall"):
        of_pitch(0.025)
    assert any("check the pitch" in w for w in of_pitch(0.1).warnings)
    assert of_pitch(0.05).warnings == ()


def test_foot_of_the_axis_tells_where_the_camera_points(scene: Scene) -> None:
    foot = scene.camera.axis_foot - scene.flight[0, :2]
    c = calibrate(
        scene.grid,
        SIZE,
        distance=TAPE_D,
        ball_plane_offset=TAPE_BALL,
        ball_diameter=DIAMETER,
        foot=((float(foot[0]), 0.002), (float(foot[1]) + 0.4, 0.002)),
        rest_px=scene.flight_px[0],
        rest_height=0.4,
    )
    np.testing.assert_allclose(c.camera.axis_foot, scene.camera.axis_foot, atol=0.006)


def test_grid_of_another_picture_size_is_refused(scene: Scene) -> None:
    with pytest.raises(CalibrationError, match="640×360"):
        calibrate(scene.grid, (1280, 720))


def test_a_fall_upwards_is_refused(taped: SceneCalibration) -> None:
    with pytest.raises(CalibrationError, match="tells no scale"):
        with_free_fall(taped, (-0.2, 0.1), GRAVITY)
