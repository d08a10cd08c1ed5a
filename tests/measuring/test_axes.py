"""Positions in metres: of any motion with a scale, on axes that a person places."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from measuring.chain import measure_clip
from measuring.measurement import Axes, tracks_as_frame
from metrology import UsageError
from pipelines.api.quantities import measure_options
from pipelines.app.graphs import graphs_of
from tests.pipelines.app.small import FALL, falling, strike

POINTS = ["x_m", "y_m"]


def test_a_fall_with_a_given_scale_is_in_metres(tmp_path: Path) -> None:
    options = measure_options(fps="240", scale="1 mm/px ± 0.01 mm/px", cache=True)
    measured = measure_clip(falling(tmp_path / "fall"), options)
    table = tracks_as_frame(measured)
    ball = table[table["object"] == "ball"].set_index("frame")
    first, last = ball.index[0], ball.index[-1]
    fallen = 1e-3 * FALL * (last**2 - first**2)
    assert ball.loc[first, "y_m"] - ball.loc[last, "y_m"] == pytest.approx(fallen, rel=0.01)
    assert np.ptp(ball["x_m"]) < 2e-3
    path = next(one for one in graphs_of(measured) if one.name == "path")
    assert path.x == "x / m"


def test_axes_move_and_turn_positions_and_leave_the_numbers() -> None:
    found = strike()
    rest = found.tracks.ball.centre_px[0]
    turned = replace(found, axes=Axes(float(rest[0]), float(rest[1]), 30.0))
    before, after = (
        table[table["object"] == "ball"][POINTS].to_numpy()
        for table in map(tracks_as_frame, (found, turned))
    )
    assert np.abs(after[0]).max() < 2e-3
    step = before[-1] - before[0]
    along = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6)])
    across = np.array([-along[1], along[0]])
    assert np.allclose(after[-1] - after[0], (step @ along, step @ across))
    assert turned.quantities == found.quantities
    # the fitted path is drawn on the same axes
    path = next(one for one in graphs_of(turned) if one.name == "path")
    drawn = {one["name"]: np.array([row[:2] for row in one["data"]]) for one in path.series}
    ball, fit = drawn["ball"], drawn["fitted flight"]
    nearest = [np.hypot(*(ball - point).T).min() for point in fit[5:-5]]
    assert max(nearest) < 0.05


def test_axes_are_an_option() -> None:
    assert measure_options(axes="12,34").axes == Axes(12.0, 34.0)
    assert measure_options(axes=(12, 34, -5)).axes == Axes(12.0, 34.0, -5.0)
    with pytest.raises(UsageError, match="X,Y,DEGREES"):
        measure_options(axes="left")
