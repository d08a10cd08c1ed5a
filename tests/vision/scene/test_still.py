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
