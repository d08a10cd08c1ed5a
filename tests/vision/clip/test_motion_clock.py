import numpy as np
import pytest

from vision.clip.footage import MotionClock


def _picture(seed: int, x: float | None = None, gain: float = 1.0) -> np.ndarray:
    """A noisy wall, with a ball of 6 px on it where x is given."""
    gray = np.full((120, 160), 120.0)
    if x is not None:
        rows, columns = np.mgrid[0:120, 0:160]
        gray[np.hypot(columns - x, rows - 60.0) < 3.0] = 40.0
    gray = gain * gray + np.random.default_rng(seed).normal(0.0, 2.0, gray.shape)
    return np.clip(np.rint(gray), 0, 255).astype(np.uint8)


def test_noise_and_flicker_hardly_tick() -> None:
    clock = MotionClock()
    moved = [clock.tick(_picture(index, 50.0, 1 + 0.1 * np.sin(index))) for index in range(300)]
    assert not any(moved)
    assert clock.time < 3.0


def test_a_small_ball_ticks_with_how_far_it_goes() -> None:
    quick, slow = MotionClock(), MotionClock()
    for index in range(40):
        quick.tick(_picture(index, 20.0 + 3.0 * index))
    for index in range(400):
        slow.tick(_picture(index, 20.0 + 0.3 * index))
    assert 30 < quick.time < 45
    assert 30 < slow.time < 300


@pytest.mark.parametrize("shape", [(200, 320), (195, 333)])
@pytest.mark.parametrize("white", [255, 65535])
def test_cells_are_means_of_their_quarters_in_whole_levels(
    shape: tuple[int, int], white: int
) -> None:
    rng = np.random.default_rng(1)
    picture = rng.integers(0, white + 1, shape).astype(np.uint8 if white == 255 else np.uint16)
    picture[:8, :8] = white  # nothing overflows
    clock = MotionClock()
    clock.tick(picture)
    height, width = (side // 8 for side in shape)
    blocks = picture[: 8 * height, : 8 * width].reshape(height, 2, 4, width, 2, 4)
    quarters = np.round(blocks.mean(axis=(2, 5), dtype=np.float64))
    assert clock.cells == pytest.approx(quarters.mean(axis=(1, 3)))
