"""Fit the probability of motion kinds: python -m training.fit_motion_kinds [--drawn N] [--labs N].

Tracks drawn at random (seeds 0 upwards), simulations of the shared labs (seeds 0 to 999) and, with
--followed, tracks of the shared labs as they are measured train a multinomial logistic regression.
Writes coefficients with 95 % intervals to vision/motions/motion_kinds.json.
"""

import argparse
import json
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

import vision.motions
from training.motion_tracks import Labelled, draw, followed_labs, lab_track
from vision.motions.features import FEATURES, features_of

FloatArray = NDArray[np.float64]

KINDS = (
    "strike",
    "flight",
    "drop",
    "bounce",
    "swing",
    "collision",
    "roll",
    "circle",
    "carried",
    "none",
)
OUTPUT = Path(vision.motions.__file__).with_name("motion_kinds.json")


def table(tracks: Sequence[Labelled]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Features and kinds of tracks."""
    rows = [features_of(one.ball, one.striker)[0] for one in tracks]
    return np.array(rows), np.array([KINDS.index(one.kind) for one in tracks])


def gathered(
    drawn: int, labs: int, folder: Path | None
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.bool_]]:
    """Features and kinds of all training tracks, and which are of labs, by hundreds."""
    parts = []
    for of_lab, source, count in ((True, lab_track, labs), (False, draw, drawn)):
        for first in range(0, count, 100):
            file = None if folder is None else folder / f"{'lab' if of_lab else 'drawn'}{first}.npz"
            if file is not None and file.exists():
                kept = np.load(file)
                values, kind = kept["values"], kept["kind"]
            else:
                values, kind = table(
                    [source(seed) for seed in range(first, min(first + 100, count))]
                )
                if file is not None:
                    file.parent.mkdir(parents=True, exist_ok=True)
                    np.savez(file, values=values, kind=kind)
            parts.append((values, kind, np.full(len(kind), of_lab)))
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))  # type: ignore[return-value]


RIDGE = 3.0
"""Chosen on real clips among 0.3, 1, 3, 10: drawn tracks kept out prefer less (0.39 for 0.43), real
ones, which differ more from drawn ones than these from each other, prefer it (0.81 for 1.05)."""

WORTH = 5.0
"""Drawn tracks for each measured one. Chosen; insensitive between 3 and 10."""


def fit(
    values: FloatArray, kind: NDArray[np.int64], weight: FloatArray, ridge: float
) -> FloatArray:
    """Coefficients (kinds, features) of least log loss with a ridge on all but the constant."""
    shape = (len(KINDS), values.shape[1])
    penalty = np.full(shape, ridge)
    penalty[:, 0] = 0.01 * ridge
    truth = np.eye(len(KINDS))[kind]

    def loss(flat: FloatArray) -> tuple[float, FloatArray]:
        coefficients = flat.reshape(shape)
        score = values @ coefficients.T
        score -= score.max(axis=1, keepdims=True)
        share = np.exp(score)
        share /= share.sum(axis=1, keepdims=True)
        value = -float(weight @ np.log(np.maximum(share[np.arange(len(kind)), kind], 1e-300)))
        slope = ((share - truth) * weight[:, None]).T @ values + 2 * penalty * coefficients
        return value + float((penalty * coefficients**2).sum()), slope.ravel()

    found = scipy.optimize.minimize(
        loss, np.zeros(shape).ravel(), jac=True, method="L-BFGS-B", options={"maxiter": 2000}
    )
    return np.asarray(found.x.reshape(shape))


def shares(values: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Probability of each kind for each track."""
    score = values @ coefficients.T
    share = np.exp(score - score.max(axis=1, keepdims=True))
    return np.asarray(share / share.sum(axis=1, keepdims=True))


def spread(
    values: FloatArray, coefficients: FloatArray, weight: FloatArray, ridge: float
) -> FloatArray:
    """Standard errors by the curvature of the loss."""
    share = shares(values, coefficients)
    kinds, count = coefficients.shape
    curvature = np.zeros((kinds * count, kinds * count))
    for first in range(kinds):
        for second in range(kinds):
            mixed = weight * share[:, first] * ((first == second) - share[:, second])
            block = (values * mixed[:, None]).T @ values
            curvature[
                first * count : (first + 1) * count, second * count : (second + 1) * count
            ] = block
    curvature += 2 * ridge * np.eye(len(curvature))
    return np.sqrt(np.diag(np.linalg.inv(curvature))).reshape(kinds, count)


def main() -> None:
    """Gather, fit, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drawn", type=int, default=3000)
    parser.add_argument("--labs", type=int, default=1000)
    parser.add_argument("--tables", type=Path, help="folder that keeps the features between runs")
    parser.add_argument("--followed", type=Path, help="folder of LAB.csv by `measure --tracks`")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    began = time.process_time()
    values, kind, lab = gathered(arguments.drawn, arguments.labs, arguments.tables)
    print(f"{len(kind)} tracks, {time.process_time() - began:.0f} s CPU")
    weight, many = np.ones(len(kind)), len(kind)
    followed = [] if arguments.followed is None else list(followed_labs(arguments.followed))
    if followed:
        more, named = table(followed)
        values, kind = np.vstack([values, more]), np.append(kind, named)
        weight = np.append(weight, np.full(len(named), WORTH))
    out = np.arange(many) % 5 == 0
    inner = np.append(~out, np.ones(len(followed), dtype=bool))
    coefficients = fit(values[inner], kind[inner], weight[inner], RIDGE)
    share = shares(values[:many][out], coefficients)
    loss = -float(np.mean(np.log(share[np.arange(out.sum()), kind[:many][out]])))
    right = float(np.mean(share.argmax(axis=1) == kind[:many][out]))
    print(f"ridge {RIDGE}: kept out log loss {loss:.3f}, right {right:.3f}")
    coefficients = fit(values, kind, weight, RIDGE)
    errors = spread(values, coefficients, weight, RIDGE)
    head = {
        "fitted_by": "training/fit_motion_kinds.py",
        "tracks": {
            "drawn": int((~lab).sum()),
            "labs": int(lab.sum()),
            "followed": len(followed),
        },
        "ridge": RIDGE,
        "kept_out_log_loss": round(loss, 4),
        "columns": ["value", "low", "high"],
    }
    low, high = coefficients - 1.96 * errors, coefficients + 1.96 * errors
    kinds = []
    for row, name in enumerate(KINDS):
        lines = [
            f'  "{feature}": [{coefficients[row, column]:.4f}, {low[row, column]:.3f},'
            f" {high[row, column]:.3f}]"
            for column, feature in enumerate(FEATURES)
        ]
        kinds.append(f' "{name}": {{\n' + ",\n".join(lines) + "\n }")
    text = json.dumps(head, indent=1)[:-2] + ',\n "coefficients": {\n'
    OUTPUT.write_text(text + ",\n".join(kinds) + "\n }\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
