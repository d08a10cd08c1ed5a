"""From a trial table and a baseline to a verdict, in the same words as for whole tracks."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

from metrology import TooLittleDataError, UsageError
from mismatch.fitting.prepare import baseline_model
from mismatch.model.baseline import Baseline
from mismatch.model.model import Model
from mismatch.table.candidates import table_candidates
from mismatch.table.evidence import Posterior, unstated
from mismatch.table.held_out import table_held_out
from mismatch.table.model import TableForward, table_forward
from mismatch.table.search import Answer, Search, search
from mismatch.table.table import CHANNELS, LEAST_TRIALS, TrialTable
from mismatch.table.words import (
    alternatives,
    groups_of,
    located,
    named_effects,
    next_measurement,
    table_notes,
)
from mismatch.verdict import Remainder, Verdict, VerdictKind
from physics.arrays import FloatArray
from physics.effects import CATALOGUE, Effect

__all__ = ["TableExplained", "explain_table"]

NULL_DOUBTED = 0.02
"""Probability of "nothing is missing" below which something is named."""

RIVAL = 20.0
"""Odds within which another answer of the same size is not told apart."""

FAR_OFF = 30.0
ANOTHER_EXPERIMENT = 0.6

READING = 0.016
READING_SHARE = 0.012
"""m, and share of the range: what a landing read off a scale may scatter by."""

SPEED_SHARE = 0.03

SURPRISE = 1e-3


@dataclass(frozen=True)
class TableExplained:
    """A verdict on a trial table, with what it rests on.

    Attributes
    ----------
    verdict : Verdict
    forward : TableForward
    model : Model
        The baseline's effects.
    found : Search
    best : Answer or None
        None where nothing is named.
    """

    verdict: Verdict
    forward: TableForward
    model: Model
    found: Search
    best: Answer | None

    @property
    def null(self) -> Answer:
        """The baseline with nothing added."""
        return next(a for a in self.found.answers if not a.members)

    def residual(self, answer: Answer) -> FloatArray:
        """Recorded less fitted numbers of an answer, (T, 3)."""
        return answer.problem.residual - answer.problem.columns @ answer.posterior.mean


def explain_table(
    table: TrialTable,
    baseline: Baseline,
    *,
    own: Iterable[Effect] = (),
    hold_out: Sequence[str] = (),
) -> TableExplained:
    """Find what a model of the experiment lacks, from a few numbers per trial.

    Parameters
    ----------
    table : TrialTable
        Impact speeds or back-swings, and ball speeds or ranges.
    baseline : Baseline
        What the lab believes.
    own : iterable of Effect
        A user's own, which take part like any other.
    hold_out : sequence of str
        Trials to keep out of the fit; by default each is kept out in turn.

    Returns
    -------
    TableExplained

    Raises
    ------
    UsageError
        If units can't be right, columns look swapped, or the setup describes something else.
    TooLittleDataError
        If there are too few trials.
    """
    table.require_enough()
    forward = table_forward(table, baseline)
    model = baseline_model(baseline)
    refuse_nonsense(forward, model)
    effects = [*(e for forms in CATALOGUE.values() for e in forms), *own]
    found = search(forward, model, table_candidates(forward, model, effects))
    null = found.probabilities[[not a.members for a in found.answers]].sum()
    best = None
    if null < NULL_DOUBTED:
        best = next(a for a in found.answers if a.members)
    return TableExplained(
        _verdict(forward, model, found, best, hold_out), forward, model, found, best
    )


def refuse_nonsense(forward: TableForward, model: Model) -> None:
    """Refuse numbers whose units or columns can't be what they are said to be.

    Raises
    ------
    UsageError
        With what is wrong and what would help.
    """
    table = forward.table
    predicted = forward.predict([model], np.zeros((1, table.trials, 4)))[0]
    ratio = table.values / predicted
    for channel in range(3):
        mine = ratio[:, channel][np.isfinite(ratio[:, channel])]
        if not mine.size:
            continue
        middle = float(np.median(mine))
        name = CHANNELS[channel].replace("_", " ")
        if middle > FAR_OFF or middle < 1.0 / FAR_OFF:
            raise UsageError(
                f"the recorded {name} is {middle:.3g} times what the setup expects",
                hint="Lengths are in metres, speeds in metres per second.",
            )
        if abs(np.log(middle)) > np.log1p(ANOTHER_EXPERIMENT):
            raise UsageError(
                f"the setup contradicts the table: the recorded {name} is {middle:.2f} times what"
                " it expects",
                hint="Check that no columns are swapped, and ball names, pendulum and support.",
            )


def _rivals(found: Search, best: Answer) -> tuple[Answer, ...]:
    """Answers of the same size that the table can't tell from the best one."""
    least = best.log_weight - np.log(RIVAL)
    return tuple(
        a
        for a in found.answers
        if a is not best and len(a.members) == len(best.members) and a.log_weight >= least
    )


def _verdict(
    forward: TableForward,
    model: Model,
    found: Search,
    best: Answer | None,
    hold_out: Sequence[str],
) -> Verdict:
    null = next(a for a in found.answers if not a.members)
    rivals = () if best is None else _rivals(found, best)
    groups = () if best is None else groups_of(best, rivals)
    remainder = _remainder(forward.table, found, best or null)
    kind: VerdictKind = "no_mismatch" if remainder.white else "unexplained"
    if best is not None:
        # A name beside a large remainder rests on a model that is still incomplete.
        kind = "ambiguous" if groups or not remainder.white else "explained"
    left_out = None if best is None else _held(forward.table, hold_out)
    return Verdict(
        kind,
        ("gravity", *model.ids),
        _baseline_misfit(null, best or null, forward.table),
        None if kind == "no_mismatch" else located(forward, null, best, rivals),
        named_effects(found, best),
        alternatives(found, best, rivals),
        groups,
        next_measurement(forward.table, best, rivals, groups),
        None if best is None else table_held_out(forward, found.laws, null, best, left_out),
        remainder,
        (*forward.table.notes, *table_notes(forward, model)),
    )


def _held(table: TrialTable, names: Sequence[str]) -> NDArray[np.bool_] | None:
    if not names:
        return None
    unknown = [name for name in names if name not in table.names]
    if unknown:
        raise UsageError(
            f"there is no trial {', '.join(unknown)} to hold out",
            hint=f"Trials: {', '.join(table.names[:20])}.",
        )
    held = np.array([name in names for name in table.names])
    if int((~held).sum()) < LEAST_TRIALS:
        raise TooLittleDataError(
            f"{int((~held).sum())} trials are left after holding {len(names)} out",
            hint=f"At least {LEAST_TRIALS} must stay.",
        )
    return held


def _count(table: TrialTable) -> int:
    used = np.isfinite(table.values)
    used[:, 0] &= np.isfinite(table.backswing)
    return int(used.sum())


def _baseline_misfit(null: Answer, best: Answer, table: TrialTable) -> float:
    """Chi-square per number of the baseline, with the noise that the best answer leaves."""
    ratio = np.where(best.posterior.noise > 0.0, null.posterior.noise / best.posterior.noise, 1.0)
    worst = float(np.max(np.square(ratio)))
    return null.posterior.chi2 * worst / max(_count(table), 1)


def _remainder(table: TrialTable, found: Search, answer: Answer) -> Remainder:
    """Whether what is left could be errors of reading."""
    subject = "What remains after the best model" if answer.members else "The baseline's residuals"
    lacking = unstated(table)
    posterior: Posterior = answer.posterior
    told, white = [], True
    for channel, name in ((1, "ball speeds"), (2, "ranges")):
        if not table.present[channel]:
            continue
        noise = float(posterior.noise[channel])
        if not lacking[channel]:
            white = white and noise < 3.0
            told.append(f"{name} scatter {noise:.1f} times as widely as stated")
        elif channel == 2:
            white = white and noise < max(
                READING, READING_SHARE * float(np.nanmedian(table.values[:, 2]))
            )
            told.append(f"{name} scatter by {1e3 * noise:.1f} mm")
        else:
            white = white and noise < SPEED_SHARE
            told.append(f"{name} scatter by {100.0 * noise:.1f} %")
    free = sum(len(c.effect.strengths) for c in answer.members)
    surprise = float(gammaincc(0.5 * max(_count(table) - free, 1), 0.5 * posterior.chi2))
    white = white and surprise > SURPRISE
    end = "as errors of reading do" if white else "more than errors of reading would"
    return Remainder(white, f"{subject}: {' and '.join(told)}, {end}.")
