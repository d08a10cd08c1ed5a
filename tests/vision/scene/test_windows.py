"""Windows of a camera that wanders: what the still wall shows, wherever the camera looked."""

import numpy as np
from numpy.typing import NDArray

from tests.vision.ball.painted import PaintedClip
from vision.clip.footage import Footage
from vision.scene import FilmedScene

HEIGHT, WIDTH, FRAMES = 120, 160, 30
WANDER = 3.0 * np.column_stack([np.sin(0.5 * np.arange(FRAMES)), np.cos(0.3 * np.arange(FRAMES))])


def _wall(shift: NDArray[np.float64]) -> NDArray[np.float64]:
    """A wall without lines that repeat, seen from elsewhere, gray levels."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    x, y = x - shift[0], y - shift[1]
    return (
        120.0
        + 30.0 * np.sin(x / 5.0 + 0.02 * y)
        + 30.0 * np.sin(y / 6.0 + 0.01 * x)
        + 20.0 * np.sin((x + 2.0 * y) / 31.0)
    )


def test_a_window_shows_the_wall_as_the_scene_does_at_the_picture_s_edges_too() -> None:
    pictures = []
    for index, shift in enumerate(WANDER):
        noise = np.random.default_rng(index).normal(0.0, 0.5, (HEIGHT, WIDTH))
        pictures.append(np.clip(_wall(shift) + noise, 0, 255).astype(np.uint8))
    scene = FilmedScene(Footage(PaintedClip(pictures)))  # type: ignore[arg-type]
    assert scene.hand_held
    windows = [
        (slice(0, 30), slice(0, 40)),
        (slice(50, 90), slice(33, 95)),
        (slice(HEIGHT - 25, HEIGHT), slice(WIDTH - 30, WIDTH)),
        (slice(20, 20), slice(0, 30)),
    ]
    shifts = scene.shifts()
    assert shifts is not None
    # the scene is where the camera looks on average
    usual = np.median(WANDER - shifts, axis=0)
    true = _wall(usual)
    wanted = np.arange(3, FRAMES, 5)
    for window in windows:
        for index, seen in scene.windows(wanted, [window] * len(wanted)):
            assert seen.shape == true[window].shape
            inside = np.ones(true.shape, dtype=bool)
            y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + shifts[index][::-1, None, None]
            inside &= (x > 0) & (y > 0) & (x < WIDTH - 1) & (y < HEIGHT - 1)
            off = (seen - true[window])[inside[window]]
            assert np.abs(off).max(initial=0.0) < 4.0
