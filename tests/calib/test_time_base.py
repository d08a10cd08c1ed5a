"""Frame rate from objects of known period in view."""

import numpy as np
import pytest

from metrology import CalibrationError
from vision.clip.footage import rate_from_blinking, rate_from_fall


def blinking(fps: float, hz: float, seed: int, noise: float = 8.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    time = (np.arange(300) + rng.uniform()) / fps
    return 80 + 60 * (np.sin(2 * np.pi * hz * time) > 0.3) + rng.normal(0, noise, 300)


@pytest.mark.parametrize("fps", [600.0, 585.0, 480.0])
def test_a_blinking_light_gives_the_frame_rate(fps: float) -> None:
    found = rate_from_blinking(blinking(fps, 31.0, 1), 31.0, nominal_fps=600.0)
    assert abs(found.fps - fps) < 4.0 * found.std + 0.02
    assert found.std < 1.0


def test_its_uncertainty_equals_its_standard_deviation() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(300) / 600.0
    found = []
    for _ in range(60):
        light = 50 * np.sin(2 * np.pi * 31 * time + rng.uniform(0, 6)) + rng.normal(0, 20, 300)
        found.append(rate_from_blinking(light, 31.0, nominal_fps=600.0))
    scatter = np.std([f.fps for f in found])
    assert np.mean([f.std for f in found]) == pytest.approx(scatter, rel=0.3)


def test_a_light_that_does_not_blink_is_refused() -> None:
    noise = np.random.default_rng(2).normal(100, 5, 300)
    with pytest.raises(CalibrationError, match="no blinking of"):
        rate_from_blinking(noise, 31.0, nominal_fps=600.0)
    with pytest.raises(CalibrationError, match="too fast"):
        rate_from_blinking(noise, 300.0, nominal_fps=600.0)
    with pytest.raises(CalibrationError, match="fewer than three"):
        rate_from_blinking(noise, 2.0, nominal_fps=600.0)


def test_free_fall_gives_the_rate() -> None:
    rng = np.random.default_rng(3)
    n = np.arange(200)
    t = n / 240.0
    y = 1.0 + 2.0 * t - 4.903 * t**2 + rng.normal(0, 0.001, 200)
    found = rate_from_fall(y, np.full(200, 0.001), n, acceleration=9.806)
    assert abs(found.fps - 240.0) < 4.0 * found.std
    with pytest.raises(CalibrationError, match="fall"):
        rate_from_fall(0 * y, np.full(200, 0.001), n, acceleration=9.806)


def test_frame_rates_from_falls_have_their_nominal_coverage() -> None:
    """400 falls: 68 % within one standard uncertainty, 95 % within two, to four binomial ones."""
    rng = np.random.default_rng(11)
    n = np.arange(60)
    t = n / 240.0
    true = 1.0 + 2.0 * t - 0.5 * 9.806 * t**2
    std = np.linspace(0.5e-3, 2e-3, n.size)
    z = np.empty(400)
    for k in range(z.size):
        scale = 1.0 + rng.normal(0.0, 0.002)
        found = rate_from_fall(
            scale * (true + rng.normal(0.0, std)), std, n,
            acceleration=9.806, relative_scale_std=0.002,
        )  # fmt: skip
        z[k] = (found.fps - 240.0) / found.std
    for within, share in ((1.0, 0.6827), (2.0, 0.9545)):
        spread = np.sqrt(share * (1.0 - share) / z.size)
        assert abs(np.mean(np.abs(z) < within) - share) < 4.0 * spread
