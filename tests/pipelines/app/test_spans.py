"""Fits to a span: true terms within their ±, as often as the ± promises."""

import numpy as np
import pytest

from metrology import UsageError
from pipelines.app.graphs import Graph
from pipelines.app.pages.spans import Shape, SpanFit, fit_span, scatter_rows
from pipelines.app.words import says

TIME = 0.3 + np.arange(60) / 240.0
SINCE = TIME - TIME[0]
NOISE = 0.002
TRUE = {
    Shape.LINE: (1.2 - 3.0 * SINCE, {"at_start": 1.2, "slope": -3.0}),
    Shape.PARABOLA: (
        1.2 + 2.0 * SINCE - 0.5 * 9.81 * SINCE**2,
        {"at_start": 1.2, "slope": 2.0, "curvature": -9.81},
    ),
    Shape.SINE: (
        0.4 + 0.1 * np.sin(2.0 * np.pi * TIME / 0.15 + 1.0),
        {"mean": 0.4, "amplitude": 0.1, "period": 0.15},
    ),
}


def fitted(shape: Shape, seed: int) -> SpanFit:
    noise = np.random.default_rng(seed).normal(0.0, NOISE, len(TIME))
    return fit_span(TIME, TRUE[shape][0] + noise, shape)


@pytest.mark.parametrize("shape", list(Shape))
def test_the_uncertainty_covers_the_truth_as_often_as_it_states(shape: Shape) -> None:
    fits = [fitted(shape, seed) for seed in range(100)]
    for place, (name, true) in enumerate(TRUE[shape][1].items()):
        assert fits[0].terms[place][0] == name
        off = [(one.terms[place][1] - true) / one.terms[place][2] for one in fits]
        # robust, and with correlation looked for: a little wider than the scatter
        assert 0.7 < np.std(off) < 1.15, name
        assert abs(np.mean(off)) < 0.35, name
    assert np.mean([one.scatter for one in fits]) == pytest.approx(NOISE, rel=0.05)
    curve = fits[0].curve
    assert curve[[0, -1], 0] == pytest.approx(TIME[[0, -1]])


def test_an_exact_curve_and_too_few_points() -> None:
    found = fit_span(TIME, TRUE[Shape.PARABOLA][0], Shape.PARABOLA)
    assert found.terms[2][1] == pytest.approx(-9.81, abs=1e-6)
    with pytest.raises(UsageError, match="4 points are too few for a parabola"):
        fit_span(TIME[:4], TIME[:4], Shape.PARABOLA)
    with pytest.raises(UsageError, match="0 points"):
        fit_span(TIME[:0], TIME[:0], Shape.LINE)


def test_measured_points_of_graphs_over_time_are_offered_with_their_unit() -> None:
    points = {"type": "scatter", "name": "ball", "data": [[0.2, 3.0, 1.0], [0.1, 2.0, 0.0]]}
    line = {"type": "line", "name": "fit", "data": [[0.0, 1.0]]}
    graphs = (
        Graph("path", "x / m", "y / m", False, (points,)),
        Graph("speed", "t / s", "speed / (m/s)", True, (points, line)),
    )
    ((name, (number, unit, rows)),) = scatter_rows(graphs, says("en")).items()
    assert (name, number, unit) == ("Speed: ball", 1, "m/s")
    assert rows[:, 2].tolist() == [0.0, 1.0]
