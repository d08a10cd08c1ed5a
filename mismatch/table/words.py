"""What is said about a trial table: where it parts from the model, what was left out, what next."""

from collections.abc import Sequence

import numpy as np

from mismatch.model.model import Model
from mismatch.table.candidates import strengths_of
from mismatch.table.evidence import unstated
from mismatch.table.model import TableForward
from mismatch.table.search import Answer, Search
from mismatch.table.table import TrialTable
from mismatch.verdict import Alternative, Location, NamedEffect, ParameterValue

__all__ = [
    "alternatives",
    "groups_of",
    "located",
    "named_effects",
    "next_measurement",
    "table_notes",
]

BALL_SPEED = (
    "the ball's speed just after contact (a column ball_speed_m_s), which tells what happens in"
    " contact from what happens in flight"
)
MOST_ALTERNATIVES = 8
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


def named_effects(found: Search, best: Answer | None) -> tuple[NamedEffect, ...]:
    """The best answer's members, surest first; a probability counts every set that holds the id."""
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
                member.id, member.effect.statement, min(share, 0.999), tuple(values),
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
