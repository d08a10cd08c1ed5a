"""Throws without drag: clock and scale errors are indistinguishable."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from bench.concealed.world.shots import Array
from metrology import write_text_whole

__all__ = ["Throws", "draw_throws", "perform_throws", "throws_visibility"]

GRAVITY = 9.806
FPS = 240.0


@dataclass(frozen=True)
class Throws:
    """Parabolas of a steel ball: position and velocity at the first frame, frames, noise."""

    start: Array
    velocity: Array
    frames: tuple[int, ...]
    sigma: float


def draw_throws(rng: np.random.Generator) -> Throws:
    """8 to 16 throws of 0.3 to 0.7 s."""
    n = int(rng.integers(8, 17))
    start = np.stack([rng.uniform(-0.2, 0.2, n), rng.uniform(0.8, 1.4, n)], axis=1)
    velocity = np.stack([rng.uniform(1, 4, n), rng.uniform(0.5, 3, n)], axis=1)
    frames = tuple(int(f) for f in rng.uniform(0.3, 0.7, n) * FPS)
    return Throws(start, velocity, frames, float(rng.uniform(0.0008, 0.002)))


def throws_visibility(throws: Throws, amplitude: float, per_amplitude: float) -> float:
    """Misfit of g with a relative error `amplitude * per_amplitude` after refitting the start."""
    total = 0.0
    for frames in throws.frames:
        t = np.arange(frames) / FPS
        fall = 0.5 * GRAVITY * amplitude * per_amplitude * t**2
        left = fall - np.polyval(np.polyfit(t, fall, 1), t)
        total += float((left**2).sum()) / throws.sigma**2
    return total


def perform_throws(
    rng: np.random.Generator, throws: Throws, rate_error: float, scale_error: float, folder: Path
) -> None:
    """Write the throws as recorded with that clock and length scale."""
    tables = []
    for trial, frames in enumerate(throws.frames):
        label = np.arange(frames) / FPS
        t = (label / (1 + rate_error))[:, None]
        place = throws.start[trial] + throws.velocity[trial] * t - [0, 0.5 * GRAVITY] * t**2
        place = place * (1 + scale_error) + rng.normal(0, throws.sigma, place.shape)
        table = pd.DataFrame(
            {
                "trial": trial,
                "t_s": np.round(label + rng.integers(100) / FPS, 6),
                "x_m": np.round(place[:, 0], 5),
                "y_m": np.round(place[:, 1], 5),
            }
        )
        tables.append(table[rng.random(frames) > 0.04])
    folder.mkdir(parents=True, exist_ok=True)
    pd.concat(tables).to_csv(folder / "ball.csv", index=False, lineterminator="\n")
    text = f"""[camera]
capture_fps = {FPS:g}

[ball]
mass = "0.510 kg"
diameter = "50 mm"

[air]
density = "1.18 kg/m^3"
viscosity = "1.852e-5 Pa s"

[noise]
position = "{throws.sigma * 1000:.2g} mm"

[model]
effects = ["gravity"]
"""
    write_text_whole(folder / "setup.toml", text)
