"""How well an answer foretells trials of a table that it has not seen."""

import numpy as np
from numpy.typing import NDArray

from mismatch.table.candidates import strengths_of
from mismatch.table.evidence import Problem, gram_of, posterior_of
from mismatch.table.model import TableForward
from mismatch.table.search import Answer
from mismatch.table.table import LEAST_TRIALS
from mismatch.verdict import HeldOut
from physics.arrays import FloatArray

__all__ = ["table_held_out"]

RESAMPLED = 2000


def _foretold(
    forward: TableForward, laws: int, answer: Answer, kept_out: NDArray[np.bool_]
) -> FloatArray:
    """Errors (T, 3) of an answer that was trained without the marked trials."""
    scatter = forward.forward.baseline.scatter
    width = np.tile([scatter.cor_law, scatter.launch_angle_law], laws // 2)
    strengths = [s for c in answer.members for s in strengths_of(c, answer.model)]
    width = np.concatenate([width, [s.width for s in strengths]])
    sign = np.concatenate([np.zeros(laws), [float(s.sign) for s in strengths]])
    problem = answer.problem
    seen = np.where(kept_out[:, None], np.nan, problem.residual)
    gram = gram_of(Problem(seen, problem.columns, problem.jacobian), forward.table, scatter)
    posterior = posterior_of(gram, np.arange(width.size, dtype=np.int64), width, sign)
    return np.asarray(problem.residual - problem.columns @ posterior.mean)


def _errors(
    forward: TableForward, laws: int, answer: Answer, kept_out: NDArray[np.bool_] | None
) -> FloatArray:
    if kept_out is not None:
        return _foretold(forward, laws, answer, kept_out)[kept_out]
    count = forward.table.trials
    return np.concatenate(
        [_foretold(forward, laws, answer, np.arange(count) == k)[k : k + 1] for k in range(count)]
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def table_held_out(
    forward: TableForward,
    laws: int,
    null: Answer,
    best: Answer,
    kept_out: NDArray[np.bool_] | None = None,
) -> HeldOut | None:
    """Errors on unseen trials before and after.

    Parameters
    ----------
    laws : int
        How many shared parameters are trial-to-trial values of the balls.
    kept_out : (T,) bool array, optional
        Trials to keep out together; by default each is kept out in turn.

    Returns
    -------
    HeldOut or None
        None where too few trials would be left.
    """
    table = forward.table
    channel = 2 if table.present[2] else 1
    before = _errors(forward, laws, null, kept_out)[:, channel]
    after = _errors(forward, laws, best, kept_out)[:, channel]
    told = np.isfinite(before) & np.isfinite(after)
    if int(told.sum()) < 2 or table.trials - 1 < LEAST_TRIALS - 1:
        return None
    before, after = before[told], after[told]
    picks = np.random.default_rng(3).integers(0, before.size, (RESAMPLED, before.size))
    ratio = np.sqrt(
        np.square(before)[picks].mean(axis=1)
        / np.maximum(np.square(after)[picks].mean(axis=1), 1e-24)
    )
    low, high = np.quantile(ratio, (0.025, 0.975))
    names = table.names
    if kept_out is not None:
        names = tuple(n for n, out in zip(table.names, kept_out, strict=True) if out)
    return HeldOut(
        names, _rms(before), _rms(after), (float(low), float(high)),
        "m" if channel == 2 else "m_s",
    )  # fmt: skip
