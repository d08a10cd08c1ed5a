"""When a fall contradicts rate or scale."""

import pytest

from measuring.budget import ClipConditions
from measuring.checks import CheckOutcome
from measuring.gravity import contradicts_gravity, gravity_check
from measuring.inputs import gather_inputs
from measuring.setup.file import Setup
from metrology import Quantity, UncertaintySource
from metrology.quantity import Contribution
from vision.clip.footage import CaptureRate, RateSource

G = 9.81


@pytest.mark.parametrize("share", [0.4, 0.7, 1.5, 4.0])
def test_a_fall_far_from_gravitys_contradicts(share: float) -> None:
    assert contradicts_gravity(share * G, G)
    assert contradicts_gravity(share * G, G, 0.01)


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_fall_as_gravity_has_it_does_not(share: float) -> None:
    assert not contradicts_gravity(share * G, G)
    assert not contradicts_gravity(share * G, G, 0.01)


@pytest.mark.parametrize(
    ("value", "noise", "scale", "outcome"),
    [
        # at 9.81 a scale good to 35 % leaves 3.4: what a small ball seen badly gives
        (2.49, 1.21, 0.87, CheckOutcome.UNDECIDED),
        (2.49, 0.10, 0.02, CheckOutcome.FAILED),
        # what does not fall at all shows it whatever the scale
        (0.10, 0.10, 0.03, CheckOutcome.FAILED),
        (-3.0, 0.50, 1.00, CheckOutcome.FAILED),
    ],
)
def test_a_doubtful_scale_is_doubted_as_much_where_the_fall_is_as_it_should_be(
    value: float, noise: float, scale: float, outcome: CheckOutcome
) -> None:
    lines = (
        Contribution(UncertaintySource.TRACK_NOISE, noise),
        Contribution(UncertaintySource.BALL_DIAMETER, scale),
    )
    found = Quantity.measured("gravity", value, "m/s^2", lines)
    rate = CaptureRate(600.0, 0.0, RateSource.OPTION)
    scene = ClipConditions(gather_inputs(Setup(), "jokku", None), rate, None)
    _, check = gravity_check(found, scene)
    assert check is not None
    assert check.outcome is outcome


@pytest.mark.parametrize("camera", ["distance_to_wall", None])
def test_a_fall_that_does_not_fit_names_what_lengths_follow_from(camera: str | None) -> None:
    setup = Setup() if camera is None else Setup().having({f"camera.{camera}": "4.6 m"})
    lines = (Contribution(UncertaintySource.TRACK_NOISE, 0.1),)
    found = Quantity.measured("gravity", 9.2, "m/s^2", lines)
    rate = CaptureRate(600.0, 0.0, RateSource.OPTION)
    inputs = gather_inputs(setup, "jokku", None)
    for scene, said in (
        (ClipConditions(inputs, rate, None), "--ball"),
        (ClipConditions(inputs, rate, None, metres_per_px=(0.01, 0.001)), "--scale"),
        (ClipConditions(inputs, rate, object()), camera or "--wall-grid"),
    ):
        _, check = gravity_check(found, scene)
        assert check is not None
        assert "lengths of 0.938 times the true ones" in check.statement
        assert said in check.statement
