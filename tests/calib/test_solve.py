"""A fall as additional evidence, and impossible scenes."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib.calibration import BallOutlines, Calibration, Evidence, Known
from calib.camera import Camera, Lens
from calib.grid import GridMap, WallGrid
from calib.solve import LensPrior, SeenFall, Solved, solve
from metrology import CalibrationError, UncertaintySource

FloatArray = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

SIZE = (640, 360)
DISTANCE, DEPTH, RADIUS = 3.6, 0.5, 0.1229
TAPE = 0.005
GRAVITY = 9.806


@dataclass(frozen=True)
class Scene:
    camera: Camera
    grid: WallGrid
    flight: FloatArray
    flight_px: FloatArray
    outlines: BallOutlines

    @property
    def taped(self) -> Evidence:
        return Evidence(
            ball_radius=RADIUS,
            camera_distance=Known(DISTANCE, TAPE),
            ball_plane_offset=Known(DEPTH, TAPE),
        )

    @property
    def untaped(self) -> Evidence:
        return Evidence(ball_radius=RADIUS, outlines=self.outlines)


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
    std = np.full(40, 0.02)
    outlines = BallOutlines(flight_px, radius_px, std, Known(2 * RADIUS, 0.0005), 0.1)
    return Scene(camera, grid, flight, flight_px, outlines)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene()


@pytest.fixture(scope="module")
def untaped(scene: Scene) -> Solved:
    return solve(scene.grid, scene.untaped)


def length_error(c: Calibration, scene: Scene) -> float:
    """Relative error of the length of the flight."""
    found = np.diff(c.position(scene.flight_px[[0, -1]])[0][:, 0])[0]
    return float(found / (scene.flight[-1, 0] - scene.flight[0, 0]) - 1.0)


def seen_gravity(c: Calibration, scene: Scene) -> float:
    time = np.linspace(0.0, 0.42, 40)
    return float(-2.0 * np.polyfit(time, c.position(scene.flight_px)[0][:, 1], 2)[0])


def scale_std(c: Calibration, scene: Scene) -> float:
    slope = c.gradient(lambda moved: length_error(moved, scene))
    return float(np.sqrt(slope @ c.covariance @ slope))


def fall(solved: Solved, scene: Scene, std: float = 0.01, factor: float = 1.0) -> SeenFall:
    apparent = factor * seen_gravity(solved.calibration, scene)
    return SeenFall(Known(apparent, std), GRAVITY, scene.flight_px)


@pytest.mark.parametrize("where", ["flight", "middle of the picture"])
def test_a_fall_narrows_the_scale_without_measured_distances(
    untaped: Solved, scene: Scene, where: str
) -> None:
    before = scale_std(untaped.calibration, scene)
    assert before > 0.003
    told = fall(untaped, scene)
    told = told if where == "flight" else replace(told, px=None)
    fused = untaped.weighing(told).calibration
    after = scale_std(fused, scene)
    assert after < 0.5 * before
    assert abs(length_error(fused, scene)) < max(2.0 * after, 0.001)
    assert "free fall" in {source.name for source in fused.sources}
    assert fused.warnings == untaped.calibration.warnings


def test_a_fall_measured_too_fast_pulls_the_scale(untaped: Solved, scene: Scene) -> None:
    fused = untaped.weighing(fall(untaped, scene, 0.005, factor=1.01)).calibration
    assert length_error(fused, scene) == pytest.approx(-0.01, abs=0.002)


def test_a_fall_that_contradicts_a_measured_distance_is_reported_and_excluded(scene: Scene) -> None:
    evidence = replace(scene.taped, ball_plane_offset=Known(DEPTH - 0.15, TAPE))
    wrong = solve(scene.grid, evidence)
    assert wrong.calibration.warnings == ()
    weighed = wrong.weighing(fall(wrong, scene))
    assert weighed.calibration is wrong.calibration
    told = weighed.contradiction
    assert told is not None
    assert "instead of 9.81" in told
    assert "too long" in told
    assert "measured ball plane offset" in told
    assert "capture rate" in told


def test_a_consistent_fall_gives_no_warning(scene: Scene) -> None:
    taped = solve(scene.grid, scene.taped)
    fused = taped.weighing(replace(fall(taped, scene), px=None))
    assert fused.contradiction is None
    assert scale_std(fused.calibration, scene) < scale_std(taped.calibration, scene)


def test_a_fall_upwards_is_refused(untaped: Solved) -> None:
    with pytest.raises(CalibrationError, match="gives no scale"):
        untaped.weighing(SeenFall(Known(-0.2, 0.1), GRAVITY))


def test_a_fall_is_requested_if_distances_do_not_give_the_scale(scene: Scene) -> None:
    asked: list[Calibration] = []

    def see(calibration: Calibration) -> None:
        asked.append(calibration)

    solve(scene.grid, scene.taped, see_fall=see)
    assert not asked
    solve(scene.grid, scene.untaped, see_fall=see)
    assert len(asked) == 1


def test_the_grid_spacing_enters_the_budget_if_it_is_the_scale(scene: Scene) -> None:
    """A length on the wall is as unsure as the squares it is counted in."""

    def on_wall(std: float) -> tuple[float, float]:
        found = solve(scene.grid, replace(scene.taped, pitch_relative_std=std)).calibration

        def width(c: Calibration) -> float:
            return float(np.ptp(c.on_wall(np.array([[40.0, 180.0], [600.0, 180.0]]))[:, 0]))

        budget = {line.source: line.std for line in found.budget(width)}
        return budget[UncertaintySource.GRID_PITCH], width(found)

    # the tape of the distance is no better than 0.14 %, so a pitch of 0.02 % is the scale by itself
    std, value = on_wall(2e-4)
    assert std == pytest.approx(2e-4 * value, rel=0.1)
    assert on_wall(4e-4)[0] == pytest.approx(2.0 * std, rel=0.1)


def test_a_wrong_grid_spacing_contradicts_the_ball() -> None:
    def of_pitch(pitch: float) -> Calibration:
        scene = make_scene(pitch=pitch)
        lens = LensPrior(scene.camera.lens, np.array([0.005, 1.0, 1.0, 0.01, 0.01]))
        return solve(scene.grid, scene.untaped, lens=lens).calibration

    with pytest.raises(CalibrationError, match="in front of the wall"):
        of_pitch(0.025)
    assert any("check the pitch" in w for w in of_pitch(0.1).warnings)
    assert of_pitch(0.05).warnings == ()
