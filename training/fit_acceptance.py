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
from bench.concealed.statistics import brier_score, calibration_error, wilson
from metrology import write_text_whole, written_whole
from mismatch.acceptance import FEATURES, NameEvidence, features_of
from pipelines.explain.campaign import explain_files
from pipelines.report.plots import Picture

__all__ = ["evidence_table", "fit_logistic", "leave_one_out", "right_ids"]

Array = NDArray[np.float64]
OUTPUT = Path(__file__).parents[1] / "mismatch" / "acceptance.json"
CARD = Path(__file__).parents[1] / "docs" / "results" / "acceptance.json"
PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "acceptance.svg"
SURE = 0.9
"""Probability from which a name is certain; convention."""

PRIOR = {
    "intercept": (-1.0, 1.0),
    "margin": (2.0, 0.5),
    "over_chance": (0.5, 0.15),
    "predicted": (1.0, 0.5),
    "held_out": (0.2, 0.2),
    "left": (-2.0, 1.0),
    "structure": (-1.0, 0.5),
    "fellows": (-0.5, 0.5),
    "doubts": (-1.5, 0.7),
    "mixed": (-1.0, 0.5),
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
        explained = explain_files(
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


Worlds = Mapping[str, tuple[Array, Array]]
"""World → columns of its names (n, features), and which are right (n,)."""


def leave_one_out(worlds: Worlds) -> dict[str, tuple[Array, Array]]:
    """World → probabilities by the weights of the other worlds, and which names are right."""
    found = {}
    for name, (columns, right) in worlds.items():
        others = [pair for world, pair in worlds.items() if world != name]
        if others:
            weights, _ = fit_logistic(*(np.concatenate(part) for part in zip(*others, strict=True)))
            found[name] = _stated(weights, columns), right
    return found


def _score(stated: Array, right: Array) -> dict[str, float]:
    sure = stated >= SURE
    return {
        "names": len(right),
        "right": int(right.sum()),
        "brier": brier_score(list(stated), [bool(one) for one in right]),
        "sure": int(sure.sum()),
        "sure_right": int(right[sure].sum()),
    }


def _draw(stated: Array, right: Array, path: Path) -> list[dict[str, float]]:
    """Draw frequency over stated probability, with 95 % intervals; returns the bins."""
    _, bins = calibration_error(list(stated), [bool(one) for one in right])
    figure = Picture(figsize=(4.6, 4.4), layout="constrained")
    axis = figure.subplots()
    axis.plot([0, 1], [0, 1], "-", color="0.7", lw=1.0)
    for mean, share, count in bins:
        axis.plot([mean, mean], wilson(round(share * count), count), "-", color="tab:blue", lw=1.2)
        axis.plot(mean, share, "o", color="tab:blue", ms=3.0 + 1.5 * count**0.5)
        axis.annotate(str(count), (mean, share), (6, -10), textcoords="offset points", fontsize=8)
    axis.set(
        xlabel="stated probability, by the weights of the other worlds",
        ylabel="fraction of names that are right",
    )
    with written_whole(path) as part:
        figure.savefig(part, format=path.suffix.lstrip("."), dpi=130)
    return [{"stated": m, "right": s, "names": n} for m, s, n in bins]


def _worlds(folders: Mapping[str, Path], keys: Mapping[str, Path], cache: Path) -> Worlds:
    worlds = {}
    for name, path in folders.items():
        rows: list[dict[str, Any]] = []
        right: list[bool] = []
        for folder in sorted(p.parent for p in path.glob("*/setup.toml")):
            if name in keys and not any(keys[name].glob(f"{folder.name}*")):
                continue
            found = evidence_table(folder, cache)
            accepted = right_ids(folder, keys.get(name))
            rows += found
            right += [row["id"] in accepted for row in found]
        if rows:
            worlds[name] = _columns(rows), np.array(right, dtype=np.float64)
    return worlds


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m training.fit_acceptance")
    parser.add_argument("--world", action="append", default=[], metavar="NAME=FOLDER")
    parser.add_argument("--keys", action="append", default=[], metavar="NAME=FOLDER")
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--score", action="store_true", help="leave the weights as they are")
    options = parser.parse_args()
    options.cache.mkdir(parents=True, exist_ok=True)
    folders, keys = (
        {name: Path(path) for name, path in (one.split("=", 1) for one in given)}
        for given in (options.world, options.keys)
    )
    worlds = _worlds(folders, keys, options.cache)
    kept_out = leave_one_out(worlds)
    scores = {name: _score(*pair) for name, pair in kept_out.items()}
    together = [np.concatenate(part) for part in zip(*kept_out.values(), strict=True)]
    for name, score in scores.items():
        print(name, score)
    weights, covariance = fit_logistic(
        *(np.concatenate(part) for part in zip(*worlds.values(), strict=True))
    )
    std = np.sqrt(np.diag(covariance))
    fitted = {
        "script": "training/fit_acceptance.py",
        "intercept": {"value": weights[0], "std": std[0]},
        "weights": {
            name: {"value": weights[k], "std": std[k]} for k, name in enumerate(FEATURES, 1)
        },
    }
    card = {
        "worlds": scores,
        "all": _score(together[0], together[1]),
        "bins": _draw(together[0], together[1], PICTURE),
    }
    write_text_whole(CARD, json.dumps(card, indent=1) + "\n")
    if not options.score:
        write_text_whole(OUTPUT, json.dumps(fitted, indent=1) + "\n")


if __name__ == "__main__":
    main()
