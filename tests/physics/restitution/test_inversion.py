"""COR from the landing distance: inversion, propagation and Monte Carlo."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from metrology import DomainError
from physics.air import PAPER_AIR
from physics.bodies import BALLS, BASKETBALL, JOKKU, PAPER_PENDULUM, PAPER_SUPPORT
from physics.contact import impact
from physics.flight import Launch, land
from physics.forward import (
    RangeInputs,
    cor_from_range,
    sensitivities,
)


def _inputs(ball_name: str, distance: float, speed: float) -> RangeInputs:
    return RangeInputs.of(
        PAPER_PENDULUM,
        BALLS[ball_name],
        PAPER_SUPPORT,
        PAPER_AIR,
        distance=distance,
        impact_speed=speed,
        contact_time=0.015,
        drag_coefficient=0.47,
    )


@settings(max_examples=300)
@given(
    e=st.floats(0.05, 1.0),
    speed=st.floats(0.2, 12.0),
    contact_time=st.floats(0.0, 0.04),
    angle=st.floats(0.0, 1.0),
    height=st.floats(0.02, 2.0),
    ball_mass=st.floats(0.05, 2.0),
    effective_mass=st.floats(1.0, 20.0),
    drag=st.floats(0.0, 1.0),
)
def test_inverting_a_simulated_flight_returns_e(
    e: float,
    speed: float,
    contact_time: float,
    angle: float,
    height: float,
    ball_mass: float,
    effective_mass: float,
    drag: float,
) -> None:
    after = impact(effective_mass, ball_mass, e, speed)
    inputs = RangeInputs(
        1.0, speed, contact_time, angle, height, ball_mass, effective_mass, 0.2, drag, 1.18
    )
    landing = land(
        Launch(after.ball_speed, angle, after.mean_speed * contact_time),
        height,
        inputs.drag_constant,
    )
    found = cor_from_range(dataclasses.replace(inputs, distance=float(landing.distance)))
    assert float(found) == pytest.approx(e, abs=1e-6)


def test_the_four_conclusions_of_ryu_et_al() -> None:
    for ball, distance, speed in ((JOKKU, 1.8, 3.2144), (BASKETBALL, 2.07, 3.1223)):
        inputs = _inputs(ball.name, distance, speed)
        slopes = sensitivities(inputs)
        assert slopes["impact_speed"] < 0.0
        assert slopes["contact_time"] < 0.0
        assert slopes["ball_mass"] > 0.0
        e = float(cor_from_range(inputs))
        for name in ("ball_diameter", "air_density", "drag_coefficient"):
            change = slopes[name] * float(getattr(inputs, name)) * 0.1
            assert abs(change) < 0.02 * e


def test_ten_thousand_inversions_are_one_call() -> None:
    distances = np.linspace(1.0, 2.5, 10_000)
    found = np.asarray(
        cor_from_range(dataclasses.replace(_inputs("jokku", 1.0, 3.2), distance=distances))
    )
    assert found.shape == distances.shape
    assert np.all(np.diff(found) > 0.0)


@pytest.mark.parametrize(
    "bad",
    [
        {"distance": -1.0},
        {"distance": 0.01},
        {"impact_speed": 0.0},
        {"ball_mass": -0.1},
        {"support_height": -0.2},
        {"distance": float("nan")},
        {"contact_time": 15.0},
    ],
)
def test_bad_input_is_an_error_never_a_nan(bad: dict[str, float]) -> None:
    with pytest.raises(DomainError):
        cor_from_range(dataclasses.replace(_inputs("jokku", 1.8, 3.2), **bad))
