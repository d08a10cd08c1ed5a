"""Noise, outliers and lost rows of the concealed campaigns."""

import numpy as np

from bench.concealed.world.design import Noise
from bench.concealed.world.shots import Array

__all__ = ["disturb", "kept_rows"]

OUTLIER_SIZE = 15.0


def disturb(
    rng: np.random.Generator, clean: Array, sigma: float, noise: Noise, fps: float
) -> Array:
    """`clean` (n, channels) with white and correlated noise of total `sigma`, and outliers.

    An outlier is a wrong detection: all channels of the row are displaced together.
    """
    n, channels = clean.shape
    share = noise.correlated_share
    white = rng.normal(0, sigma * np.sqrt(1 - share), (n, channels))
    memory = np.exp(-1 / (noise.correlation_time * fps))
    kicks = rng.normal(0, 1, (n, channels))
    slow = np.empty((n, channels))
    slow[0] = kicks[0]
    for row in range(1, n):
        slow[row] = memory * slow[row - 1] + np.sqrt(1 - memory**2) * kicks[row]
    wrong = rng.random(n) < noise.outliers
    jump = rng.normal(0, OUTLIER_SIZE * sigma, (n, channels)) * wrong[:, None]
    return clean + white + np.sqrt(share) * sigma * slow + jump


def kept_rows(rng: np.random.Generator, rows: int, noise: Noise) -> np.ndarray:
    """Mask of detected rows: single losses and a few occlusions."""
    kept = rng.random(rows) >= noise.missing
    if noise.missing > 0 and rng.random() < 0.2:
        start = int(rng.integers(rows))
        kept[start : start + int(rng.integers(5, 15))] = False
    return kept
