"""Fit the probability of motion kinds: python -m training.fit_motion_kinds [--drawn N] [--labs N].

Tracks drawn at random (seeds 0 upwards) and simulations of the shared labs (seeds 0 to 999) train a
multinomial logistic regression; its ridge is chosen on one fifth kept out. Writes coefficients with
95 % intervals to vision/motions/motion_kinds.json.
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
from training.motion_tracks import Labelled, draw, lab_track
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
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    began = time.process_time()
    values, kind, lab = gathered(arguments.drawn, arguments.labs, arguments.tables)
    print(f"{len(kind)} tracks, {time.process_time() - began:.0f} s CPU")
    weight = np.ones(len(kind))
    out = np.arange(len(kind)) % 5 == 0
    best = (np.inf, 1.0)
    for ridge in (0.03, 0.1, 0.3, 1.0, 3.0):
        coefficients = fit(values[~out], kind[~out], weight[~out], ridge)
        share = shares(values[out], coefficients)
        loss = -float(np.mean(np.log(share[np.arange(out.sum()), kind[out]])))
        right = float(np.mean(share.argmax(axis=1) == kind[out]))
        print(f"ridge {ridge}: kept out log loss {loss:.3f}, right {right:.3f}")
        best = min(best, (loss, ridge))
    ridge = best[1]
    coefficients = fit(values, kind, weight, ridge)
    errors = spread(values, coefficients, weight, ridge)
    head = {
        "fitted_by": "training/fit_motion_kinds.py",
        "tracks": {"drawn": int((~lab).sum()), "labs": int(lab.sum())},
        "ridge": ridge,
        "kept_out_log_loss": round(best[0], 4),
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
