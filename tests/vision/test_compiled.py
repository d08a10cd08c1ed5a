import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vision.compiled import gains_along, registered, registration_moments

SHAPE = (60, 80)
STRIPES = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
BEHIND = np.asarray(120.0 + 20.0 * np.sin(0.3 * STRIPES[0] + 0.2 * STRIPES[1]), dtype=np.float32)
NOWHERE = np.zeros(3)


def _spot(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Opacity of a soft disc of radius 7."""
    return np.asarray(1.0 / (1.0 + np.exp(np.hypot(x, y) - 7.0)))


def _look(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(60.0 + 15.0 * np.sin(0.5 * x) + 10.0 * np.cos(0.4 * y))


def _drawn(cx: float, cy: float, turn: float, gain: float) -> NDArray[np.float32]:
    """The layer before the scene, drawn from its formula."""
    dx, dy = STRIPES[0] - cx, STRIPES[1] - cy
    x = np.cos(turn) * dx + np.sin(turn) * dy
    y = -np.sin(turn) * dx + np.cos(turn) * dy
    part = _spot(x, y)
    return np.asarray(gain * (part * _look(x, y) + (1.0 - part) * BEHIND), dtype=np.float32)


@pytest.fixture(scope="module")
def layer() -> NDArray[np.float32]:
    x, y = (
        one.ravel().astype(float) for one in np.meshgrid(np.arange(-13, 14), np.arange(-13, 14))
    )
    return np.array([x, y, _look(x, y), _spot(x, y)], dtype=np.float32)


def test_a_drawn_layer_is_found_where_it_was_drawn(layer: NDArray[np.float32]) -> None:
    picture = _drawn(41.37, 28.62, 0.031, 1.1)
    prior = np.diag([0.0, 0.0, 1.0])
    start, normal = np.array([40.0, 30.0, 0.0]), np.empty((4, 4))
    settled, x, y, turn, *_, seen = registered(
        layer, start, prior, picture, BEHIND, 1.1, 1.0, NOWHERE, 30, normal
    )
    assert settled
    assert (x, y, turn) == pytest.approx((41.37, 28.62, 0.031), abs=0.01)
    assert seen == pytest.approx(1.0)


def test_a_layer_out_of_view_or_hidden_is_not_found(layer: NDArray[np.float32]) -> None:
    picture, normal = _drawn(41.0, 28.0, 0.0, 1.0), np.empty((4, 4))
    for place, disc in ((-5.0, NOWHERE), (41.0, np.array([41.0, 28.0, 20.0])), (np.nan, NOWHERE)):
        start = np.array([place, 28.0, 0.0])
        found = registered(layer, start, np.eye(3), picture, BEHIND, 1.0, 1.0, disc, 12, normal)
        assert not found[0]


def test_most_is_gained_where_the_layer_lies(layer: NDArray[np.float32]) -> None:
    picture = _drawn(41.0, 28.0, 0.0, 1.0)
    tried = np.array([[x, 28.0, 1.0, 0.0, 0.0, 1.0] for x in (30.0, 38.0, 41.0, 44.0, 500.0)])
    gains = gains_along(layer, tried, picture, BEHIND, 1.0, 1.0, NOWHERE)
    assert np.argmax(gains) == 2
    assert gains[2] > 0.0 > gains[0]
    assert gains[4] == -np.inf


def test_normal_equations_are_those_of_samples_taken_by_opencv(layer: NDArray[np.float32]) -> None:
    picture = _drawn(41.2, 28.4, 0.0, 1.0) + np.float32(3.0)
    x, y = layer[0] + np.float32(41.0), layer[1] + np.float32(28.0)
    half, flat = np.array([-0.5, 0.0, 0.5]), np.array([0.25, 0.5, 0.25])

    def shown(image: NDArray[np.float32]) -> list[NDArray[np.float64]]:
        across = cv2.sepFilter2D(image, cv2.CV_32F, half, flat)
        down = cv2.sepFilter2D(image, cv2.CV_32F, flat, half)
        ways = ((image, cv2.INTER_CUBIC), (across, cv2.INTER_LINEAR), (down, cv2.INTER_LINEAR))
        return [np.asarray(cv2.remap(one, x[None], y[None], how)[0], float) for one, how in ways]

    opacity, look = layer[3].astype(float), (layer[2] * layer[3]).astype(float)
    level, dx, dy = (
        seen - (1.0 - opacity) * scene
        for seen, scene in zip(shown(picture), shown(BEHIND), strict=True)
    )
    residual = level - look * (look @ level) / (look @ look)
    scale = max(1.4826 * float(np.median(np.abs(residual))), 0.7)
    weight = 1.0 / (1.0 + (residual / (3.0 * scale)) ** 2) ** 2
    columns = np.stack([dx, dy, -look])

    ways, normal, pull = np.eye(2, 6), np.empty((3, 3)), np.empty(3)
    placing = np.array([41.0, 28.0, 1.0, 0.0, 0.0, 1.0])
    said = registration_moments(
        layer, placing, ways, picture, BEHIND, 1.0, 1.0, NOWHERE, True, normal, pull
    )
    assert said[1] == pytest.approx(scale, rel=1e-3)
    assert normal == pytest.approx((columns * weight) @ columns.T, rel=1e-3, abs=1.0)
    assert pull == pytest.approx((columns * weight) @ residual, rel=1e-3, abs=1.0)
