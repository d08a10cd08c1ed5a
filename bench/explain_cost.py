"""Measure the processor time and memory of `vision explain` by size of the campaign.

Strikes of one laboratory with a concealed back-spin, and a swing of two minutes with dry friction.
Each campaign runs in a process of its own. Run `python -m bench.explain_cost`; it writes
docs/results/cost.json, from which `python -m bench.insert` fills the page on speed.
"""

import argparse
import json
import resource
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from bench.concealed.campaign import perform
from bench.concealed.sample import CONCEALED, PAPER_LAB
from bench.concealed.world.design import Noise, draw_design
from bench.real.made import SwingRig, write_swings
from metrology import write_text_whole
from pipelines.explain.campaign import explain_files

__all__ = ["Cost", "make_strikes", "make_swing", "measure_cost"]

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "cost.json"

SWING = SwingRig(
    0.94, 0.94, 0.02, 0.01, 0.0, 0.0, 0.001, 1e-5, 200.0, 120.0, (0.86,)
)  # fmt: skip


@dataclass(frozen=True)
class Cost:
    """What one campaign took: s of the processor, MB at most, and the names that it gave."""

    seconds: float
    megabytes: float
    named: tuple[str, ...]


def make_strikes(trials: int, folder: Path) -> None:
    """Write strikes of the paper's pendulum against two balls, back-spin concealed."""
    rng = np.random.default_rng(20)
    design = draw_design(rng, PAPER_LAB)
    timing = tuple(
        replace(
            design.timing[k % len(design.timing)],
            touch_label=0.22 + float(rng.uniform(-0.5, 0.5)) / 600.0, first_label=0.0, hiccup=0.1,
        )
        for k in range(trials)
    )  # fmt: skip
    design = replace(
        design,
        ball_of_trial=tuple(k * 2 // trials for k in range(trials)),
        backswing_deg=np.resize([30.0, 60.0, 90.0, 120.0], trials),
        timing=timing, fps=600.0, rest_frames=8, swing_seconds=0.22, follow_seconds=0.14,
        noise=Noise(0.001, 0.001, 0.2, 0.006, 0.003, 0.05, 1.0),
    )  # fmt: skip
    perform(rng, design, [CONCEALED], folder)


def make_swing(folder: Path) -> None:
    """Write one free swing of two minutes, 200 readings a second."""
    write_swings(SWING, folder)


def measure_cost(folder: Path) -> Cost:
    """Explain a folder's campaign; the memory is that of the whole process."""
    ball = folder / "ball.csv"
    start = time.process_time()
    explained = explain_files(
        ball if ball.exists() else None, folder / "pendulum.csv", folder / "setup.toml"
    )
    seconds = time.process_time() - start
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    named = tuple(f"{e.id} {e.probability:.2f}" for e in explained.verdict.effects)
    return Cost(seconds, most, named)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.explain_cost", description=__doc__)
    parser.add_argument("--trials", type=int, nargs="*", default=[8, 40, 200])
    parser.add_argument("--no-swing", action="store_true")
    options = parser.parse_args()
    found = {}
    with tempfile.TemporaryDirectory() as room:
        made = {f"{count} strikes": Path(room) / str(count) for count in options.trials}
        for count, folder in zip(options.trials, made.values(), strict=True):
            make_strikes(count, folder)
        if not options.no_swing:
            made["swing of two minutes"] = Path(room) / "swing"
            made["swing of two minutes"].mkdir()
            make_swing(made["swing of two minutes"])
        for name, folder in made.items():
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
                cost = pool.submit(measure_cost, folder).result()
            print(name, cost, flush=True)
            found[name] = {
                "seconds": round(cost.seconds, 1),
                "megabytes": round(cost.megabytes),
                "named": list(cost.named),
            }
    write_text_whole(RESULTS, json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
