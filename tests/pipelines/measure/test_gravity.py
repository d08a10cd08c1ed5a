"""When a fall contradicts rate or scale."""

import pytest

from pipelines.measure.gravity import contradicts_gravity

G = 9.81


@pytest.mark.parametrize("share", [0.4, 0.7, 1.5, 4.0])
def test_a_fall_far_from_gravitys_contradicts(share: float) -> None:
    assert contradicts_gravity(share * G, G)
    assert contradicts_gravity(share * G, G, 0.01)


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_fall_as_gravity_has_it_does_not(share: float) -> None:
    assert not contradicts_gravity(share * G, G)
    assert not contradicts_gravity(share * G, G, 0.01)
