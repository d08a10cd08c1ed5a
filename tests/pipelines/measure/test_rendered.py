"""The whole chain on clips that another renderer made, against their truth and the limits set."""

import math

import numpy as np
import pytest

from bench.measure import COVERAGE, Outcome, measured
from bench.measure_truth import ray_traced
from tests.shared_data import shared_folder

pytestmark = pytest.mark.slow

GOOD = ("jokku_120", "basketball_60_wide")
HARD = ("jokku_90_small", "basketball_120_dim")
LIMITS = {
    "ball_speed": ("relative", 0.005),
    "launch_angle": ("absolute", 0.3),
    "landing_distance": ("relative", 0.003),
    "landing_distance_on_wall": ("relative", 0.003),
    "contact_frames": ("absolute", 1.0),
    "cor": ("absolute", 0.015),
}
MIN_COVERAGE = 0.85
CENTRE_PX, CONTACT_FRAMES = 0.13, 1.5
"""What is reached now; the aims are tighter, see the benchmark page."""


@pytest.fixture(scope="module")
def outcomes() -> dict[str, Outcome]:
    folder = shared_folder("rendered")
    return {name: measured(ray_traced(folder / name)) for name in (*GOOD, *HARD)}


@pytest.mark.parametrize("name", [*GOOD, *HARD])
def test_errors_are_within_what_is_stated(outcomes: dict[str, Outcome], name: str) -> None:
    far = {
        item.name: (item.value - true) / item.std
        for item, true in outcomes[name].scored()
        if item.value is not None and item.std and abs(item.value - true) > 3.0 * item.std
    }
    assert far == {}


@pytest.mark.parametrize("name", GOOD)
@pytest.mark.parametrize("quantity", LIMITS)
def test_in_good_light_errors_are_within_the_limits(
    outcomes: dict[str, Outcome], name: str, quantity: str
) -> None:
    outcome = outcomes[name]
    error = outcome.error(quantity)
    if error is None:
        # the ball leaves the picture before it lands
        assert outcome.case.name == "jokku_120"
        assert quantity.startswith("landing")
        return
    kind, limit = LIMITS[quantity]
    scale = outcome.case.truth[quantity] if kind == "relative" else 1.0
    assert abs(error) <= limit * scale


@pytest.mark.parametrize("name", GOOD)
def test_the_balls_centre_is_found(outcomes: dict[str, Outcome], name: str) -> None:
    assert outcomes[name].centre_rms_px < CENTRE_PX


@pytest.mark.parametrize("name", GOOD)
def test_contact_time_is_found_between_frames(outcomes: dict[str, Outcome], name: str) -> None:
    error = outcomes[name].error("contact_time")
    assert error is not None
    assert abs(error) * outcomes[name].case.fps < CONTACT_FRAMES


def test_intervals_hold_the_truth_as_often_as_they_say(outcomes: dict[str, Outcome]) -> None:
    inside = [
        abs(item.value - true) <= COVERAGE * item.std
        for outcome in outcomes.values()
        for item, true in outcome.scored()
        if item.value is not None and item.std
    ]
    assert np.mean(inside) >= MIN_COVERAGE


def test_the_pendulums_loss_is_that_of_eq_18(outcomes: dict[str, Outcome]) -> None:
    case = outcomes["jokku_120"].case
    found = outcomes["jokku_120"].measurement.quantity("energy_loss")
    assert found.value is not None
    assert found.std is not None
    # ½ I (ω₀² − ω₁²) of the truth file, many times what deformation takes
    assert math.isclose(case.truth["energy_loss"], 8.938, abs_tol=0.01)
    assert abs(found.value - case.truth["energy_loss"]) < 3.0 * found.std
