"""The scene before the strike."""

import numpy as np

from tests.vision.ball.painted import exposed, struck_ball, wall
from vision.clip.footage import Footage
from vision.scene import FilmedScene, scene_before_strike
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
