"""Fit the probability that a name of `vision explain` is right.

Runs the engine on campaigns with keys, collects the evidence of every name that it considers, and
fits a logistic model with a Gaussian prior on its weights. Evidence is cached, so that the model is
fitted again in a second. Run
`python -m training.fit_acceptance --world NAME=FOLDER … --keys NAME=FOLDER … --cache FOLDER`.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.concealed.foreign import CONTRACT_ID
from bench.concealed.statistics import brier_score
from metrology import write_text_whole
from mismatch.acceptance import FEATURES, NameEvidence, features_of
from pipelines.explain.campaign import explain_files_in_full

__all__ = ["evidence_table", "fit_logistic", "right_ids"]

Array = NDArray[np.float64]
OUTPUT = Path(__file__).parents[1] / "mismatch" / "acceptance.json"

PRIOR = {
    "intercept": (-1.0, 1.0),
    "margin": (2.0, 1.0),
    "predicted": (1.0, 0.5),
    "held_out": (0.2, 0.2),
    "left": (-2.0, 1.0),
    "structure": (-0.5, 0.3),
    "fellows": (-0.5, 0.5),
    "doubts": (-1.5, 0.7),
}
"""Mean and standard deviation of each weight before any campaign. Chosen: evidence counts about as
odds, each rule takes a factor of four, and the signs are those that the features mean."""


def right_ids(folder: Path, keys: Path | None) -> frozenset[str]:
    """Ids that the key of a campaign accepts, from either form of key."""
    beside = folder / "answer.json"
    path = keys / f"{folder.name}.json" if keys is not None else beside
    if keys is not None and not path.exists():
        path = keys / folder.name / "answer.json"
    raw = json.loads(path.read_text(encoding="utf-8"))
    if "ids" in raw:
        return frozenset(raw["ids"]) | frozenset(raw.get("fair") or ())
    return frozenset(
        effect.get("id") or CONTRACT_ID.get(effect["name"], effect["name"])
        for effect in raw["effects"]
    )


def evidence_table(folder: Path, cache: Path) -> list[dict[str, Any]]:
    """Evidence of every name considered for a campaign, of the answer and of the other kind."""
    output = cache / f"{folder.parent.name}-{folder.name}.json"
    if not output.exists():
        ball, pendulum = folder / "ball.csv", folder / "pendulum.csv"
        explained = explain_files_in_full(
            ball if ball.exists() else None,
            pendulum if pendulum.exists() else None,
            folder / "setup.toml",
        )
        rows = [asdict(one) for one in explained.considered]
        write_text_whole(output, json.dumps(rows))
    return list(json.loads(output.read_text(encoding="utf-8")))


def fit_logistic(columns: Array, right: Array) -> tuple[Array, Array]:
    """Weights (intercept first) of highest posterior, and their covariance.

    A weight whose sign would contradict its meaning is zero.
    """
    mean, std = np.array([PRIOR[name] for name in ("intercept", *FEATURES)]).T
    design = np.column_stack([np.ones(len(columns)), columns])
    free = np.ones(len(mean), dtype=bool)
    while True:
        weights, hessian = np.where(free, mean, 0.0), np.diag(std**-2.0)
        for _ in range(100):
            chance = _stated(weights, columns)
            gradient = design.T @ (right - chance) - (weights - mean) / std**2
            hessian = design.T @ (design * (chance * (1.0 - chance))[:, None]) + np.diag(std**-2.0)
            step = np.zeros_like(weights)
            step[free] = np.linalg.solve(hessian[np.ix_(free, free)], gradient[free])
            weights = weights + np.clip(step, -1.0, 1.0)
            if np.abs(step).max() < 1e-8:
                break
        wrong = np.where(free, weights * np.sign(mean), 0.0)
        wrong[0] = 0.0
        if wrong.min() >= 0.0:
            break
        free[int(np.argmin(wrong))] = False
    covariance = np.zeros_like(hessian)
    covariance[np.ix_(free, free)] = np.linalg.inv(hessian[np.ix_(free, free)])
    return weights, covariance


def _columns(rows: Sequence[Mapping[str, Any]]) -> Array:
    return np.array([features_of(NameEvidence(**row)) for row in rows])


def _stated(weights: Array, columns: Array) -> Array:
    return np.asarray(1.0 / (1.0 + np.exp(-(weights[0] + columns @ weights[1:]))))


def _report(worlds: Mapping[str, tuple[Array, Array]]) -> None:
    """Brier score and sure names of each world, by the weights of the other worlds."""
    for name, (columns, right) in worlds.items():
        others = [pair for world, pair in worlds.items() if world != name]
        if not others:
            return
        weights, _ = fit_logistic(*(np.concatenate(part) for part in zip(*others, strict=True)))
        stated = _stated(weights, columns)
        sure = stated >= 0.9
        score = brier_score(list(stated), [bool(one) for one in right])
        print(
            f"{name}: {len(right)} names, Brier {score:.3f};"
            f" stated ≥ 0.9: {int(right[sure].sum())} of {int(sure.sum())} right"
        )


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m training.fit_acceptance")
    parser.add_argument("--world", action="append", default=[], metavar="NAME=FOLDER")
    parser.add_argument("--keys", action="append", default=[], metavar="NAME=FOLDER")
    parser.add_argument("--cache", type=Path, required=True)
    options = parser.parse_args()
    options.cache.mkdir(parents=True, exist_ok=True)
    keys = {name: Path(path) for name, path in (one.split("=", 1) for one in options.keys)}
    worlds: dict[str, tuple[Array, Array]] = {}
    for name, path in (one.split("=", 1) for one in options.world):
        rows: list[dict[str, Any]] = []
        right: list[bool] = []
        for folder in sorted(p.parent for p in Path(path).glob("*/setup.toml")):
            found = evidence_table(folder, options.cache)
            accepted = right_ids(folder, keys.get(name))
            rows += found
            right += [row["id"] in accepted for row in found]
        if rows:
            worlds[name] = _columns(rows), np.array(right, dtype=np.float64)
    _report(worlds)
    columns, labels = (np.concatenate(part) for part in zip(*worlds.values(), strict=True))
    weights, covariance = fit_logistic(columns, labels)
    std = np.sqrt(np.diag(covariance))
    fitted = {
        "script": "training/fit_acceptance.py",
        "names": {world: len(part[1]) for world, part in worlds.items()},
        "intercept": {"value": weights[0], "std": std[0]},
        "weights": {
            name: {"value": weights[k], "std": std[k]} for k, name in enumerate(FEATURES, 1)
        },
    }
    write_text_whole(OUTPUT, json.dumps(fitted, indent=1) + "\n")


if __name__ == "__main__":
    main()
