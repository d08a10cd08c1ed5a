"""Simulate the campaign shipped with the package: one effect is concealed."""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.concealed.campaign import perform
from bench.concealed.world.design import Noise, draw_design
from bench.concealed.world.labs import BASKETBALL, JOKKU, Lab
from bench.concealed.world.recipes import CATALOGUE, Strength

__all__ = ["CONCEALED", "make_sample"]

SEED = 20
CONCEALED = Strength(CATALOGUE["magnus"], 9.0)
"""Back-spin of 9 rad/s: 2 cm at the end of the longest flight."""

PAPER_LAB = Lab(
    balls=(JOKKU, BASKETBALL),
    length=0.5541,
    inertia=1.579,
    pendulum_mass=6.0,
    com=0.4553,
    face_offset=0.045,
    support_height=0.312,
    density=1.18,
    viscosity=1.852e-5,
    drag_coefficient=0.45,
)


def make_sample(folder: Path) -> None:
    """Write ball.csv, pendulum.csv and setup.toml: 8 shots at 600 fps, 1 mm of noise."""
    rng = np.random.default_rng(SEED)
    design = draw_design(rng, PAPER_LAB)
    backswings = np.array([30.0, 60.0, 90.0, 120.0] * 2)
    trials = len(backswings)
    timing = tuple(design.timing[i % len(design.timing)] for i in range(trials))
    design = replace(
        design,
        ball_of_trial=(0,) * 4 + (1,) * 4,
        backswing_deg=backswings,
        timing=tuple(
            replace(t, touch_label=t.first_label + 0.22 + rng.uniform(-0.5, 0.5) / 600, hiccup=0.1)
            for t in timing
        ),
        fps=600.0,
        rest_frames=8,
        swing_seconds=0.22,
        follow_seconds=0.14,
        noise=Noise(0.001, 0.001, 0.2, 0.006, 0.003, 0.05, 1.0),
    )
    perform(rng, design, [CONCEALED], folder)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.concealed.sample", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("sample_videos/campaign"))
    make_sample(parser.parse_args().folder)


if __name__ == "__main__":
    main()
