"""How fast the physics is: one flight, a thousand, ten thousand inversions; beside a scipy loop.

Run: python bench/physics_speed.py [--json FILE]
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from physics.air import PAPER_AIR
from physics.bodies import JOKKU, PAPER_PENDULUM, PAPER_SUPPORT
from physics.contact import contact_outcomes
from physics.effects import Term, effect_named
from physics.flight import fly, land_many
from physics.forward import Experiment, RangeInputs, monte_carlo_cor

MODEL = Experiment(JOKKU).flight.with_terms(Term(effect_named("magnus"), {"spin": -20.0}))
START = np.array([0.0, 0.42, 0.0, 6.2, 1.3, 0.1])


def best_of(function: Callable[[], object], repeats: int) -> float:
    """Shortest of several runs, s."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def scipy_flight(speed: float) -> float:
    """One flight by the adaptive solver, the plain way."""
    start = (speed, *START[4:])
    flight = fly(MODEL, START[:3], start, floor=JOKKU.radius, samples=2, tolerance=1e-6)
    return float(flight.landing_position[0])


def measure() -> dict[str, float]:
    """All numbers of the table."""
    exact = fly(MODEL, START[:3], START[3:], floor=JOKKU.radius, tolerance=1e-12)
    _, one = land_many(MODEL, START[:, None], floor=JOKKU.radius)
    error = float(np.linalg.norm(one[:3, 0] - exact.landing_position))
    single = best_of(lambda: land_many(MODEL, START[:, None], floor=JOKKU.radius), 50)

    speeds = np.linspace(2.0, 7.0, 1000)
    many = np.tile(START[:, None], (1, 1000))
    many[3] = speeds
    thousand = best_of(lambda: land_many(MODEL, many, floor=JOKKU.radius), 5)
    loop = 10.0 * best_of(lambda: [scipy_flight(float(v)) for v in speeds[::10]], 1)

    inputs = RangeInputs.of(
        PAPER_PENDULUM,
        JOKKU,
        PAPER_SUPPORT,
        PAPER_AIR,
        distance=1.8,
        impact_speed=3.2,
        contact_time=0.0145,
        drag_coefficient=0.47,
    )
    stds = {"distance": 0.005, "impact_speed": 0.005, "launch_angle": 0.003}
    inversions = best_of(lambda: monte_carlo_cor(inputs, stds, draws=10_000), 5)
    struck = np.linspace(0.8, 4.5, 500)
    ball = replace(JOKKU)
    contacts = best_of(lambda: contact_outcomes(PAPER_PENDULUM, ball, PAPER_SUPPORT, struck), 2)
    return {
        "one flight, drag and Magnus, 3-D (ms)": 1e3 * single,
        "its error against a tolerance of 1e-12 (mm)": 1e3 * error,
        "1000 flights at once (s)": thousand,
        "1000 flights in a scipy loop (s)": loop,
        "scipy loop / at once": loop / thousand,
        "10000 Monte-Carlo inversions of Eq. 17 (s)": inversions,
        "500 contacts calibrated and followed (s)": contacts,
    }


def main() -> None:
    """Print the table, and write it where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    numbers = measure()
    for name, value in numbers.items():
        print(f"{name:48s} {value:10.4g}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(numbers, indent=2) + "\n")


if __name__ == "__main__":
    main()
