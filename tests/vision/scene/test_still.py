"""The scene before the strike."""

import numpy as np

from tests.vision.ball.painted import PaintedClip, exposed, struck_ball, wall
from vision.clip.footage import Footage
from vision.scene import Backdrop, FilmedScene, scene_before_strike
from vision.tracks import Rest


def test_a_thick_mass_that_hardly_moves_before_the_strike_is_no_part_of_the_scene() -> None:
    begin = 16
    clip, centres, angles = struck_ball(200, slower=4.0, begin=begin)
    rest = Rest(0, 40 - begin, centres[0], np.array([1.0, 0.0]), 0.5)
    before = scene_before_strike(FilmedScene(Footage(clip)), rest, 11.0)  # type: ignore[arg-type]
    swept = np.zeros(before.shape, dtype=bool)
    for angle in angles[: 40 - begin]:
        left, top = np.array([60.0, 12.0]) + 62.0 * np.array([np.sin(angle), np.cos(angle)]) - 7.0
        swept[int(top) + 1 : int(top) + 14, int(left) + 1 : int(left) + 14] = True
    empty = exposed(wall(120, 240), 0.0, 0).astype(float)
    assert np.mean(np.abs(before - empty)[swept] > 15.0) < 0.05


def test_frames_are_as_steady_where_the_scene_was_never_seen() -> None:
    scene = FilmedScene(Footage(struck_ball(60)[0]))  # type: ignore[arg-type]
    usual, known = scene.usual_noise, scene.known
    where = np.zeros(scene.shape, dtype=np.float32)
    where[40:60, 80:100] = 1.0
    hidden = [np.ones(scene.shape, dtype=bool)] * 4
    scene.uncover(np.array([50, 52, 54, 56]), hidden, where, soonest=3, since=50)
    assert scene.background.noise[50, 90] == 255.0
    assert scene.usual_noise[50, 90] < 3.0 * np.median(usual)
    assert scene.noise_in(10)[50, 90] < 255.0
    scene.restore(scene.known.throughout)
    assert scene.noise_in(10)[50, 90] == 255.0
    scene.restore(known)
    assert np.array_equal(scene.background.noise, known.image.noise)


def _door(shift: float) -> np.ndarray:
    """Light of a plain wall with a band whose edges are upright."""
    x = np.mgrid[0:160, 0:240][1] - shift
    return 0.5 - 0.2 * (np.abs(x - 130.0) < 12.0)


def test_a_camera_before_upright_edges_stands_still_though_the_light_changes() -> None:
    y = np.mgrid[0:160, 0:240][0]
    lights = [1.0 + 0.1 * np.sin(0.1 * k) * (y / 80.0 - 1.0) for k in range(80)]
    pictures = [exposed(_door(0.0) * light, 1.0, k) for k, light in enumerate(lights)]
    assert not FilmedScene(Footage(PaintedClip(pictures))).hand_held  # type: ignore[arg-type]


def test_a_camera_that_sways_is_held_by_hand_though_the_light_changes() -> None:
    lights = [1.0 + 0.05 * np.sin(0.1 * k) for k in range(80)]
    sway = 2.0 * np.sin(0.3 * np.arange(80.0))
    grid = [wall(160, 260)[:, 10 + round(part) : 250 + round(part)] for part in sway]
    pictures = [
        exposed(part * light, 1.0, k)
        for k, (part, light) in enumerate(zip(grid, lights, strict=True))
    ]
    assert FilmedScene(Footage(PaintedClip(pictures))).hand_held  # type: ignore[arg-type]


def test_the_scene_is_lit_as_each_frame_is_however_many_were_looked_at_since() -> None:
    dim = np.linspace(1.0, 0.7, 60)
    bright = wall(120, 240)
    shade = np.linspace(0.0, 1.0, 240)
    lights = [bright * (1.0 - (1.0 - part) * shade) for part in dim]
    pictures = [exposed(light, 1.0, index) for index, light in enumerate(lights)]
    scene = FilmedScene(Footage(PaintedClip(pictures)))  # type: ignore[arg-type]
    image = exposed(bright, 0.0, 0).astype(np.float32)
    lit = Backdrop(scene, image, 15.0, relit=True)
    for index in [*range(60), *range(59, -1, -1)]:
        gray = lit.in_frame(index) * scene.views[index].gain
        off = gray - exposed(lights[index], 0.0, index)
        assert abs(float(np.median(off))) < 2.0
        assert float(np.percentile(np.abs(off), 95)) < 6.0
