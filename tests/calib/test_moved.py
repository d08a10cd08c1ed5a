"""A moved camera is detected; a fixed camera is not reported."""

from dataclasses import replace

import numpy as np
import pytest

from calib.camera import Camera, Lens
from calib.grid import find_wall_grid
from calib.solve import camera_movement
from metrology import CalibrationError
from tests.calib.synthetic import rendered


def test_a_moved_camera_is_detected() -> None:
    lens = Lens.centred(432, 240, 520.0)
    here = Camera.facing_wall(lens, [0.9, 0.5, 2.5], yaw=0.05)
    bumped = Camera.facing_wall(lens, [0.9, 0.5, 2.5], yaw=0.05 + 3.1 / 520.0)
    old, again, new = (
        find_wall_grid(rendered(c, seed=s, samples=3)) for s, c in enumerate((here, here, bumped))
    )
    still = camera_movement(old, again)
    assert not still.moved
    assert "not moved" in str(still)
    moved = camera_movement(old, new)
    assert moved.moved
    assert moved.px == pytest.approx(3.1, abs=0.3)
    assert "moved by 3." in str(moved)
    other = replace(new, size=(640, 360), area=np.ones((360, 640), dtype=bool))
    with pytest.raises(CalibrationError, match="640×360"):
        camera_movement(old, other)
