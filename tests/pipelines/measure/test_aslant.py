"""Scales without a grid: what a camera that looks aslant may do to them."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from metrology import Defaults, UncertaintySource
from pipelines.measure.budget import ClipConditions, systematic_budget
from pipelines.measure.inputs import gather_inputs
from pipelines.measure.metres import BallScale
from pipelines.setup.file import Setup
from vision.clip.footage import CaptureRate, RateSource


def test_lengths_along_the_rows_are_as_long_as_a_camera_square_to_them_sees_them() -> None:
    aslant = math.radians(30.0)
    places = np.array([[0.0, 0.0], [1.2, 0.0], [0.4, 0.7]])
    # from far away: rows are seen shorter by the cosine of the slant, columns as long as they are
    seen = places * [math.cos(aslant), -1.0] * 200.0 + [90.0, 150.0]
    rest = seen[0]
    scale = BallScale(1.0 / 200.0, rest, rest, foreshortening=math.cos(aslant))
    assert scale.point(seen) == pytest.approx(places, abs=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_camera_aslant_to_either_side_counts_by_the_worse_one(side: float) -> None:
    inputs = gather_inputs(Setup(), "jokku", None)
    scene = ClipConditions(inputs, CaptureRate(600.0, 0.0, RateSource.OPTION), None)

    def values(moved: ClipConditions) -> NDArray[np.float64]:
        return np.array([5.0 + (3.0 if side * moved.slant_rad > 0 else 1.0) * moved.slant_rad])

    column = systematic_budget(scene, values, np.inf)[UncertaintySource.CAMERA_SLANT]
    assert column[0] == pytest.approx(3.0 * Defaults.CAMERA_SLANT.std)
