"""Gray levels are looked up wherever somebody points, however many and however far off."""

import numpy as np
import pytest

from vision.pendulum.arc import sampled

PICTURE = np.arange(48, dtype=np.float32).reshape(6, 8)


@pytest.mark.parametrize("count", [0, 1, 16_384, 16_385, 40_000])
def test_any_number_of_points_is_looked_up(count: int) -> None:
    x, y = np.arange(count) % 8, np.arange(count) // 8 % 6
    assert sampled(PICTURE, x, y).tolist() == PICTURE[y, x].tolist()


@pytest.mark.parametrize("far", [np.nan, np.inf, -np.inf, 1e300, -1e12, 40_000.0])
def test_a_place_beyond_the_picture_gives_a_gray_level_of_it(far: float) -> None:
    with np.errstate(over="ignore"):
        found = sampled(PICTURE, np.array([far, 3.0]), np.array([2.0, 2.0]))
    assert found[1] == PICTURE[2, 3]
    assert PICTURE.min() <= found[0] <= PICTURE.max()
