"""The proof on data kept aside: fit on some trials, predict the others."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from mismatch.fitting.fit import Fit, fit_model
from mismatch.fitting.hypotheses import POOR_FIT, Hypothesis
from mismatch.fitting.normal_equations import Free, free_parameters
from mismatch.model.forward import Forward
from mismatch.verdict import HeldOut
from physics.domain import FloatArray

__all__ = ["choose_held_out", "hold_out"]

DRAWS = 1000
"""Resamples: a probability of 0.95 is then good to 0.007."""

FEW = 4
"""Trials up to which each is kept out in turn: one alone may be the one that can't tell."""

BLOCKS = 8
"""Pieces of each held-out trial that are drawn anew: one trial alone tells an interval, too."""


def choose_held_out(forward: Forward) -> np.ndarray:
    """(folds, T) masks of what is kept out: every third trial, or each in turn where few are."""
    trials = forward.records.trials
    if trials <= FEW:
        return np.eye(trials, dtype=bool)
    return np.asarray(np.arange(trials) % 3 == 2)[None]


def _errors(
    forward: Forward, model_fit: Fit, free: Sequence[Free], held: np.ndarray
) -> tuple[FloatArray, FloatArray, float]:
    """Squared error sums and counts (held-out trials × blocks), after training on the others.

    And what the held-out trials cost in all: their misfit, and how far each had to be moved from
    what repeats, which takes up errors of metres that a law would else show.
    """
    train = type(forward)(**{**vars(forward), "records": forward.records.chosen(~held)})
    trained = fit_model(
        train, model_fit.model, free, (model_fit.nuisance, model_fit.law_offsets), rounds=5
    )
    test = type(forward)(**{**vars(forward), "records": forward.records.chosen(held)})
    # Trained parameters and law offsets stay; only what belongs to the trial is refitted.
    fitted = fit_model(test, trained.model, (), (model_fit.nuisance, trained.law_offsets), rounds=4)
    weights = test.records.weights
    errors = np.where(weights > 0.0, fitted.residual / np.where(weights > 0.0, weights, 1.0), 0.0)
    s3 = 3 * forward.records.ball_time.shape[1]
    part = slice(0, s3) if forward.mode != "swing" else slice(s3, None)
    squares, used = errors[held][:, part] ** 2, weights[held][:, part] > 0.0
    axes = 3 if forward.mode != "swing" else 1
    sums = _in_blocks(squares, axes), _in_blocks(used.astype(np.float64), axes)
    return *sums, fitted.objective


Errors: TypeAlias = tuple[FloatArray, FloatArray, float]


def _together(folds: Sequence[Errors]) -> Errors:
    """Errors, counts and costs of all folds."""
    errors, counts, costs = zip(*folds, strict=True)
    return np.concatenate(errors), np.concatenate(counts), float(sum(costs))


def _in_blocks(rows: FloatArray, axes: int) -> FloatArray:
    """Sums over blocks of rows of a record (T, axes × S), all axes of a row together."""
    together = rows.reshape(len(rows), axes, -1).sum(axis=1)
    parts = np.array_split(together, min(BLOCKS, together.shape[1]), axis=1)
    return np.concatenate([part.sum(axis=1) for part in parts])


def _extrapolation(
    forward: Forward, model_fit: Fit, free: Sequence[Free], share: float = 0.6
) -> float | None:
    """Root mean square error of the last part of every flight or swing, fitted on the first."""
    records = forward.records
    s3 = 3 * records.ball_time.shape[1]
    ball = forward.mode != "swing"
    time = records.ball_time if ball else records.pendulum_time
    seen = records.ball_used.any(axis=-1) if ball else records.pendulum_used
    start = np.where(seen, time, np.inf).min(axis=1, keepdims=True)
    if forward.mode == "impact":
        start = np.maximum(start, model_fit.nuisance[:, :1])
    end = np.where(seen, time, -np.inf).max(axis=1, keepdims=True)
    early = time <= start + share * (end - start)
    kept = np.ones(records.used.shape, dtype=bool)
    part = slice(0, s3) if ball else slice(s3, None)
    kept[:, part] = np.tile(early, 3) if ball else early
    late = records.used[:, part] & ~kept[:, part]
    if not late.any() or records.keeping(kept).count < 3 * records.trials:
        return None
    first = replace(forward, records=records.keeping(kept))
    trained = fit_model(
        first, model_fit.model, free, (model_fit.nuisance, model_fit.law_offsets), rounds=5
    )
    whole = fit_model(forward, trained.model, (), (trained.nuisance, trained.law_offsets), rounds=0)
    weights = records.weights[:, part]
    errors = whole.residual[:, part][late] / weights[late]
    return float(np.sqrt(np.mean(errors**2)))


def hold_out(
    forward: Forward, base: Fit, best: Hypothesis, held: np.ndarray | None = None
) -> HeldOut | None:
    """Held-out error of baseline and best model, with a bootstrap interval of their ratio.

    Returns
    -------
    HeldOut or None
        None with fewer than two trials, or none kept aside.
    """
    folds = choose_held_out(forward) if held is None else held[None]
    folds = folds[folds.any(axis=1) & ~folds.all(axis=1)]
    if not folds.size:
        return None
    free = free_parameters(best.fit.model, [m.effect for m in best.members])
    plain = [_errors(forward, base, (), mask) for mask in folds]
    mended = [_errors(forward, best.fit, free, mask) for mask in folds]
    before, count, cost = _together(plain)
    after, _, less = _together(mended)
    rng = np.random.default_rng(11)
    picks = rng.integers(0, before.size, (DRAWS, before.size))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.sqrt(before[picks].sum(axis=1) / np.maximum(after[picks].sum(axis=1), 1e-300))
    total = max(float(count.sum()), 1.0)
    low, high = np.quantile(ratio, [0.025, 0.975])
    return HeldOut(
        tuple(str(index) for index in np.flatnonzero(folds.any(axis=0))),
        float(np.sqrt(before.sum() / total)),
        float(np.sqrt(after.sum() / total)),
        (float(low), float(high)),
        "rad" if forward.mode == "swing" else "m",
        _extrapolation(forward, base, ()),
        _extrapolation(forward, best.fit, free),
        float(cost - less) / best.reduced_chi2 if best.reduced_chi2 < POOR_FIT else None,
    )  # fmt: skip
