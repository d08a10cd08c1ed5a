"""Stated probability of object and kind against the fraction right, on recordings kept out.

Run: python -m bench.following.reliability STORE [--drawn N] [--labs N]

STORE is a folder of training.finding_data: each recording is judged by a fit of the selection to
the others. Kinds are those of tracks that training.fit_motion_kinds has not seen. Writes
docs/results/reliability.json and docs/pictures/following_reliability.svg.
"""

import argparse
import json
import pickle
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.concealed.statistics import wilson
from bench.following.ablation import tables_of
from metrology.files import write_text_whole
from training.fit_finding import kept_out
from training.motion_tracks import clip_tracks, draw, lab_track
from vision.motions.kinds import interpret

DOCS = Path(__file__).parents[2] / "docs"
EDGES = (0.0, 0.5, 0.75, 0.9, 0.97, 1.0)
SURE = 0.9
FIRST_KEPT_OUT = 100_000
"""Seed of the first drawn track that no fit has seen."""

Pairs = NDArray[np.float64]
"""Stated probability, and 1 where it is right (N, 2)."""


def of_objects(store: Path) -> Pairs:
    """Choices among the tracklets of each recording."""
    paths = sorted(store.glob("*.pickle"))
    tables = tables_of([pickle.loads(path.read_bytes()) for path in paths])
    rows = [(share.max(), share.argmax() == answer) for share, answer in kept_out(tables)]
    return np.array(rows, dtype=np.float64)


def of_kinds(drawn: int, labs: int) -> dict[str, Pairs]:
    """Kinds of real clips by their truth, of simulated labs and of drawn tracks."""
    tracks = {
        "kind, recordings by others": clip_tracks(),
        "kind, simulated laboratories": (lab_track(1000 + seed) for seed in range(labs)),
        "kind, drawn tracks": (draw(FIRST_KEPT_OUT + seed) for seed in range(drawn)),
    }
    judged = {
        name: [(one, interpret(one.ball, one.striker)) for one in own]
        for name, own in tracks.items()
    }
    return {
        name: np.array([(got.probability, one.right(got.kind.value)) for one, got in pairs], float)
        for name, pairs in judged.items()
    }


def summary(pairs: Pairs) -> dict[str, float]:
    """Counts and Brier score of the stated probabilities."""
    stated, right = pairs.T
    sure = stated >= SURE
    return {
        "names": len(pairs),
        "right": int(right.sum()),
        "brier": float(np.mean((stated - right) ** 2)),
        "sure": int(sure.sum()),
        "sure_right": int(right[sure].sum()),
    }


def _draw(axes: Axes, pairs: Pairs, title: str) -> None:
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    stated, right = pairs.T
    for low, high in pairwise(EDGES):
        inside = (stated > low) & (stated <= high)
        if not inside.any():
            continue
        count, good = int(inside.sum()), int(right[inside].sum())
        ends = np.array(wilson(good, count))
        x, y = stated[inside].mean(), good / count
        axes.plot([x, x], ends, color="C0", linewidth=1)
        axes.plot(x, y, "o", color="C0", markersize=4)
        axes.annotate(str(count), (x, y), (4, -10), textcoords="offset points", fontsize=7)
    axes.set(xlim=(0.2, 1.02), ylim=(0.0, 1.04), xlabel="stated probability", title=title)


def main() -> None:
    """Judge, draw, write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("store", type=Path)
    parser.add_argument("--drawn", type=int, default=500)
    parser.add_argument("--labs", type=int, default=200)
    given = parser.parse_args()
    sets = {"object": of_objects(given.store), **of_kinds(given.drawn, given.labs)}
    kinds = np.concatenate([pairs for name, pairs in sets.items() if name != "object"])
    figure = Figure(figsize=(6.2, 3.1), layout="constrained")
    first, second = figure.subplots(1, 2, sharey=True)
    _draw(first, sets["object"], "which object")
    _draw(second, kinds, "which kind of motion")
    first.set_ylabel("fraction right (95 %)")
    figure.savefig(DOCS / "pictures" / "following_reliability.svg", metadata={"Date": None})
    found = {name: summary(pairs) for name, pairs in sets.items()}
    for name, row in found.items():
        print(name, row)
    write_text_whole(DOCS / "results" / "reliability.json", json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
