"""Drag and lift curves compared with published values."""

import math

import numpy as np
import pytest

from metrology import DomainError
from physics.air import (
    BASKETBALL_DRAG,
    SMOOTH_SPHERE_DRAG,
    SOCCER_DRAG,
    SOCCER_LIFT,
    drag_curve,
    standard_drag,
)


def test_slow_spheres_obey_stokes() -> None:
    assert float(standard_drag(1e-3)) == pytest.approx(24.0 / 1e-3, rel=2e-3)
    # the standard drag curve of any textbook
    for reynolds, wanted in ((1.0, 27.5), (100.0, 1.09), (1e3, 0.46), (1e5, 0.49)):
        assert float(standard_drag(reynolds)) == pytest.approx(wanted, rel=0.07)


def test_smooth_sphere_passes_the_measured_crisis() -> None:
    # Achenbach 1972
    for reynolds, wanted in ((2e5, 0.51), (3.75e5, 0.12), (4e5, 0.09), (8e5, 0.11), (4e6, 0.18)):
        assert float(SMOOTH_SPHERE_DRAG(reynolds)) == pytest.approx(wanted, abs=0.035)


def test_soccer_curve_is_the_published_fit() -> None:
    for speed in (3.0, 10.0, 12.19, 15.0, 25.0):
        wanted = 0.155 + 0.346 / (1.0 + math.exp((speed - 12.19) / 1.309))
        assert float(SOCCER_DRAG(speed * 0.2185 / 1.5e-5)) == pytest.approx(wanted, rel=1e-9)


def test_rough_balls_have_their_crisis_earlier() -> None:
    assert BASKETBALL_DRAG.centre < SOCCER_DRAG.centre < SMOOTH_SPHERE_DRAG.centre


@pytest.mark.parametrize("curve", [SMOOTH_SPHERE_DRAG, SOCCER_DRAG, BASKETBALL_DRAG])
def test_curves_are_finite_and_the_same_for_floats_and_arrays(curve: type(SOCCER_DRAG)) -> None:
    reynolds = np.array([0.0, 1.0, 1e4, 2e5, 1e7])
    values = np.asarray(curve(reynolds))
    assert np.all(np.isfinite(values))
    assert float(curve(2e5)) == pytest.approx(values[3])


def test_values_out_of_range_or_of_unconfirmed_source_are_flagged() -> None:
    assert SMOOTH_SPHERE_DRAG.notes(1e4, 1e5) == ()
    assert "covers" in SOCCER_DRAG.notes(1e4, 1e5)[0]
    assert "could not be confirmed" in BASKETBALL_DRAG.notes(5e4, 1e5)[0]
    assert drag_curve("soccer") is SOCCER_DRAG
    with pytest.raises(DomainError, match="smooth"):
        drag_curve("velvet")


def test_lift_table_starts_at_zero_and_stays_level_beyond_its_end() -> None:
    assert SOCCER_LIFT(0.0, 2e5) == 0.0
    assert SOCCER_LIFT(0.4, 2e5) == SOCCER_LIFT(3.0, 2e5)
    assert not SOCCER_LIFT.covers(0.5)
