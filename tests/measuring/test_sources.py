"""Uncertainty by its source, outcomes by their type: nothing hangs on how a thing is worded."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from measuring.budget import DERIVED, ClipConditions, systematic_budget
from measuring.impact import find_impact
from measuring.inputs import gather_inputs
from measuring.results import Evaluated, reading_on_wall
from measuring.setup.file import Setup
from metrology import Contribution, Quantity, UncertaintySource
from tests.measuring.ideal_tracks import Noise, ideal_tracks, known_stroke
from tests.measuring.test_budget import a_calibration, a_scene


def test_a_reading_on_the_wall_does_not_hang_on_what_only_corrects_it() -> None:
    landing = Quantity.measured(
        "landing_distance",
        1.4,
        "m",
        (
            Contribution(UncertaintySource.CAMERA_DISTANCE, 0.003),
            Contribution(UncertaintySource.BALL_PLANE_OFFSET, 0.004),
            Contribution(UncertaintySource.GRID_LINES, 0.0005),
        ),
    )
    stroke = ideal_tracks(*known_stroke("basketball", 60.0), Noise())
    impact = find_impact(stroke, gather_inputs(Setup(), "basketball", None))
    scene = a_scene(a_calibration(0.01, 0.001))
    evaluated = Evaluated(scene, None, impact, np.full(len(DERIVED), 0.1), np.zeros(0), {}, "")
    reading = reading_on_wall(evaluated, landing)
    assert [line.source for line in reading.budget] == [UncertaintySource.GRID_LINES]


def test_a_rate_that_nobody_knows_adds_no_finite_line() -> None:
    scene = a_scene(a_calibration(0.05, 0.001))
    scene = replace(scene, rate=replace(scene.rate, std=math.inf))
    table = systematic_budget(scene, lambda moved: np.array([moved.rate.fps]), np.inf)
    assert UncertaintySource.CAPTURE_RATE not in table
    assert all(np.isfinite(column).all() for column in table.values())


def test_an_input_so_unsure_that_a_whole_step_leads_nowhere_counts_by_a_smaller_one() -> None:
    scene = a_scene(a_calibration(0.05, 0.001))
    scene = replace(scene, rate=replace(scene.rate, std=0.5))
    known, std = scene.rate.fps, scene.rate.std

    def values(moved: ClipConditions) -> NDArray[np.float64]:
        off = (moved.rate.fps - known) / std
        return np.array([math.nan if off > 0.6 else 7.0 + 3.0 * off, math.nan])

    column = systematic_budget(scene, values, np.inf)[UncertaintySource.CAPTURE_RATE]
    assert column[0] == pytest.approx(3.0, rel=1e-6)
