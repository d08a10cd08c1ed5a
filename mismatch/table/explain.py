"""From a trial table and a baseline to a verdict, in the same words as for whole tracks.

What is said about a trial table: where it parts from the model, what was left out, what next.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

from metrology import TooLittleDataError, UsageError
from mismatch.fitting.prepare import baseline_model
from mismatch.forward import Model
from mismatch.records.records import Baseline
from mismatch.table.table import (
    CHANNELS,
    LEAST_TRIALS,
    TableForward,
    TrialTable,
    strengths_of,
    table_candidates,
    table_forward,
)
from mismatch.trial_table import Answer, Posterior, Search, search, table_held_out, unstated
from mismatch.verdict import (
    DOUBTED,
    Alternative,
    EngineVerdict,
    Location,
    NamedEffect,
    ParameterValue,
    Remainder,
    VerdictKind,
)
from physics.domain import FloatArray
from physics.effects import CATALOGUE, Effect

__all__ = ["TableExplained", "explain_table"]

BALL_SPEED = (
    "the ball's speed just after contact (a column ball_speed_m_s), which tells what happens in"
    " contact from what happens in flight"
)

MOST_ALTERNATIVES = 8
"""Rows, so that a reader sees all of them."""

ABOVE_THE_LIMIT = 2.0

"""Sigma above the speed of a swing without losses from which a trial is pointed out."""


def groups_of(best: Answer, rivals: Sequence[Answer]) -> tuple[tuple[str, ...], ...]:
    """Ids that may stand for each other, one group for each member that has rivals."""
    groups = {one: [one] for one in best.ids}
    for rival in rivals:
        left = [one for one in best.ids if one not in rival.ids]
        new = [one for one in rival.ids if one not in best.ids]
        for mine, other in zip(left, new, strict=True):
            if other not in groups[mine]:
                groups[mine].append(other)
    return tuple(tuple(sorted(group)) for group in groups.values() if len(group) > 1)


def named_effects(
    found: Search, best: Answer | None, most: float = 0.999
) -> tuple[NamedEffect, ...]:
    """The best answer's members, surest first; a probability counts every set that holds the id.

    It is `most` at most.
    """
    if best is None:
        return ()
    named, place = [], found.laws
    for member in best.members:
        share = found.inclusion[member.id]
        values = []
        for one in strengths_of(member, best.model):
            held = next(v for e, v in best.model.entries if e is member.effect)
            std = float(best.posterior.std[place])
            p = one.parameter
            values.append(ParameterValue(p.name, float(held[p.name]), std, p.unit))
            place += 1
        named.append(
            NamedEffect(
                member.id, member.effect.statement, min(share, most), tuple(values),
                member.effect.form,
            )
        )  # fmt: skip
    return tuple(sorted(named, key=lambda one: -one.probability))


def alternatives(
    found: Search, best: Answer | None, rivals: Sequence[Answer]
) -> tuple[Alternative, ...]:
    """Other answers; distances are twice the log odds, on the scale of a BIC."""
    if best is None:
        return ()
    rows = []
    for other in found.answers:
        if other is best or not other.members:
            continue
        behind = 2.0 * (best.log_weight - other.log_weight)
        if any(other is rival for rival in rivals):
            why = "not excluded: the table can't tell it apart"
        elif len(other.members) > len(best.members) and set(best.ids) <= set(other.ids):
            why = "the further effect explains no more than chance would"
        else:
            why = f"less likely by odds of {np.exp(min(0.5 * behind, 50.0)):.3g}"
        rows.append(Alternative(other.ids, why, behind))
    return tuple(rows[:MOST_ALTERNATIVES])


def next_measurement(
    table: TrialTable,
    best: Answer | None,
    rivals: Sequence[Answer],
    groups: Sequence[Sequence[str]],
) -> str | None:
    """What would separate the members of the groups."""
    if best is None or not groups:
        return None
    grouped = {one for group in groups for one in group}
    members = [m for a in (best, *rivals) for m in a.members if m.id in grouped]
    phases = {m.effect.phase for m in members}
    texts = []
    if not table.present[1] and "contact" in phases and len(phases) > 1:
        texts.append(BALL_SPEED)
    for member in members:
        if member.effect.separating and member.effect.separating not in texts:
            texts.append(member.effect.separating)
    return "; or ".join(texts[:3]) or None


def located(
    forward: TableForward, null: Answer, best: Answer | None, rivals: Sequence[Answer]
) -> Location:
    """Which numbers part from the model, and how that goes with impact speed."""
    table = forward.table
    residual = null.problem.residual
    channel = _parting(residual, table)
    phases = {m.effect.phase for a in (() if best is None else (best, *rivals)) for m in a.members}
    phase = phases.pop() if len(phases) == 1 else "across_trials"
    speed = table.values[:, 0]
    if not np.isfinite(speed).all():
        speed = forward.predict([null.model], np.zeros((1, table.trials, 4)))[0, :, 0]
    told = np.isfinite(residual[:, channel])
    order = np.flatnonzero(told)[np.argsort(speed[told])]
    share = 100.0 * residual[order, channel] / (table.values - residual)[order, channel]
    count = max(1, order.size // 4)
    slow, fast = float(share[:count].mean()), float(share[-count:].mean())
    gentle, hard = float(speed[order][:count].mean()), float(speed[order][-count:].mean())
    name = ("Impact speeds", "Ball speeds", "Ranges")[channel]
    statement = (
        f"{name} differ from the model's by {slow:+.1f} % at {gentle:.2f} m/s of impact and"
        f" {fast:+.1f} % at {hard:.2f} m/s."
    )
    return Location(phase, None, None, ("impact_speed", "ball_speed", "range")[channel], statement)


def _parting(residual: np.ndarray, table: TrialTable) -> int:
    """Channel with the largest relative misfit."""
    share = np.where(np.isfinite(residual), np.abs(residual) / table.values, 0.0)
    share[:, 0] *= np.isfinite(table.backswing)
    return int(np.argmax(np.sqrt(np.nanmean(np.square(share), axis=0))))


def table_notes(forward: TableForward, model: Model) -> tuple[str, ...]:
    """About the data: what is assumed, and single trials that no swing can have made."""
    table, notes = forward.table, []
    for lacking, name in zip(
        unstated(table), ("impact speeds", "ball speeds", "ranges"), strict=True
    ):
        if lacking:
            notes.append(f"the {name} come without uncertainties; how they scatter is fitted")
    if not table.present[1]:
        notes.append(
            "ranges alone show what contact and flight do together; ball speeds would part them"
        )
    speeds = table.values[:, 0][np.isfinite(table.values[:, 0])]
    if speeds.size > 1 and np.ptp(speeds) < 0.15 * float(np.median(speeds)):
        notes.append("all impact speeds are alike: nothing that goes with speed can be told")
    notes += _above_the_limit(forward, model)
    return tuple(notes)


def _above_the_limit(forward: TableForward, model: Model) -> list[str]:
    table = forward.table
    both = np.isfinite(table.values[:, 0]) & np.isfinite(table.backswing)
    if not both.any():
        return []
    bare = Model(tuple((e, v) for e, v in model.entries if e.phase != "swing"))
    nothing = np.zeros((1, table.trials, 4))
    moved = nothing.copy()
    moved[..., 1] = forward.forward.baseline.scatter.backswing
    limit, further = forward.predict([bare, bare], np.concatenate([nothing, moved]))[..., 0]
    std = np.hypot(further - limit, np.nan_to_num(table.stds[:, 0]))
    notes = []
    for row in np.flatnonzero(both):
        excess = table.values[row, 0] - limit[row]
        if excess > ABOVE_THE_LIMIT * std[row]:
            notes.append(
                f"trial {table.names[row]} is {100.0 * excess / limit[row]:.1f} % faster at impact"
                f" than a swing without losses from {np.rad2deg(table.backswing[row]):.0f} deg:"
                " its back-swing or its speed was misread, or the contact lies elsewhere"
            )
    return notes


NULL_DOUBTED = 0.02

"""Probability of "nothing is missing" below which something is named."""

RIVAL = 20.0

"""Odds within which another answer of the same size is not told apart."""

FAR_OFF = 30.0
"""Factor between table and model: a unit or a decimal point wrong, no physics."""

ANOTHER_EXPERIMENT = 0.6
"""Relative: more than any missing effect of the catalogue does to a landing, supposed."""

READING = 0.016
"""m, supposed: how well a landing is read off the floor where nobody says so."""

READING_SHARE = 0.012

"""m, and share of the range: what a landing read off a scale may scatter by."""

SPEED_SHARE = 0.03
"""Relative, supposed: noise of impact speeds from which it is not taken for white."""

FARTHEST_OFF = 3.0
"""Factor by which trials may scatter beyond the uncertainties stated for them, supposed: what one
forgets in a budget is about as large as what one counts."""

LEAST_P_VALUE = 1e-3
"""Probability of a chi² as large: one table in a thousand has it by chance."""


@dataclass(frozen=True)
class TableExplained:
    """A verdict on a trial table, with what it rests on.

    Attributes
    ----------
    verdict : EngineVerdict
    forward : TableForward
    model : Model
        The baseline's effects.
    found : Search
    best : Answer or None
        None where nothing is named.
    """

    verdict: EngineVerdict
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
        # none where every effect is worse than nothing at all, and nothing is doubted, too
        best = next((a for a in found.answers if a.members), None)
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
) -> EngineVerdict:
    null = next(a for a in found.answers if not a.members)
    rivals = () if best is None else _rivals(found, best)
    groups = () if best is None else groups_of(best, rivals)
    remainder = _remainder(forward.table, found, best or null)
    kind: VerdictKind = "no_mismatch" if remainder.white else "unexplained"
    if best is not None:
        # A name beside a large remainder rests on a model that is still incomplete.
        kind = "ambiguous" if groups or not remainder.white else "explained"
        if _contradicted(forward.table, best):
            kind = "unexplained"
    left_out = None if best is None else _held(forward.table, hold_out)
    return EngineVerdict(
        kind,
        ("gravity", *model.ids),
        _baseline_misfit(null, best or null, forward.table),
        None if kind == "no_mismatch" else located(forward, null, best, rivals),
        named_effects(found, best, DOUBTED if kind == "unexplained" else 0.999),
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


def _contradicted(table: TrialTable, answer: Answer) -> bool:
    """Whether what an answer leaves contradicts the uncertainties that the table states.

    No lab misses its own scatter by so much: trials are mixed up, or the sets compared do not hold
    what happened, and odds between them say nothing.
    """
    noise = answer.posterior.noise
    stated = [not one for one in unstated(table)]
    return any(stated[k] and table.present[k] and float(noise[k]) >= FARTHEST_OFF for k in (1, 2))


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
            white = white and noise < FARTHEST_OFF
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
    p_value = float(gammaincc(0.5 * max(_count(table) - free, 1), 0.5 * posterior.chi2))
    white = white and p_value > LEAST_P_VALUE
    end = "as errors of reading do" if white else "more than errors of reading would"
    return Remainder(white, f"{subject}: {' and '.join(told)}, {end}.")
