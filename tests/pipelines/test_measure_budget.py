"""The budget of the measuring chain: what strongly correlated inputs do together."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.calibration import PARAMETERS, Calibration, Source
from calib.camera import Lens
from pipelines.measure.budget import Scene, merged, systematic_budget
from pipelines.measure.inputs import gather_inputs
from pipelines.setup_file import Setup
from vision.capture_rate import CaptureRate

DISTANCE, FOCAL = PARAMETERS.index("log_distance"), PARAMETERS.index("log_focal")


def a_calibration(distance_std: float, scale_std: float) -> Calibration:
    """Distance and focal length open by `distance_std`, their ratio known to `scale_std`."""
    vector = np.zeros(len(PARAMETERS))
    vector[DISTANCE], vector[FOCAL] = np.log(4.0), np.log(900.0)
    together = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    together[np.ix_([DISTANCE, FOCAL], [DISTANCE, FOCAL])] = distance_std**2
    apart = np.zeros_like(together)
    apart[FOCAL, FOCAL] = scale_std**2
    return Calibration(
        Lens.centred(400, 300, 900.0),
        np.eye(3),
        vector,
        (Source("lens not known beforehand", together), Source("grid lines", apart)),
    )


def a_scene(calibration: Calibration) -> Scene:
    inputs = gather_inputs(Setup(), None, None)
    return Scene(inputs, CaptureRate(600.0, 0.0, "option", None), calibration)


def scale_of(scene: Scene) -> NDArray[np.float64]:
    assert scene.calibration is not None
    vector = scene.calibration.vector
    return np.array([np.exp(vector[FOCAL] - vector[DISTANCE])])


def test_a_scale_is_as_sure_as_the_ratio_it_hangs_on() -> None:
    scene = a_scene(a_calibration(0.4, 0.001))
    table = systematic_budget(scene, scale_of, np.inf)
    assert table["grid lines"][0] == pytest.approx(0.001 * 225.0, rel=0.01)
    assert table["lens not known beforehand"][0] < 0.1 * table["grid lines"][0]


def test_each_input_is_moved_by_itself() -> None:
    scene = a_scene(a_calibration(0.05, 0.001))
    scene = replace(scene, rate=CaptureRate(600.0, 0.6, "setup", None))
    table = systematic_budget(scene, lambda moved: np.array([moved.rate.fps**2]), np.inf)
    assert table["capture rate"][0] == pytest.approx(2 * 600 * 0.6, rel=0.001)
    assert table["inertia of the pendulum"][0] == 0.0
    budget = merged(table, 0, 100.0)
    assert [line.source for line in budget] == ["capture rate", "noise of the tracks"]
