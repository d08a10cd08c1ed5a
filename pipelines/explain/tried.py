"""Table of every set of effects that was fitted, named or not, with its evidence."""

from collections.abc import Sequence
from dataclasses import dataclass

from mismatch import EngineVerdict
from mismatch.candidates import Candidate
from mismatch.fitting.fit import Ending
from mismatch.fitting.hypotheses import Hypothesis
from mismatch.search.naming import Naming
from physics.effects import EffectId

__all__ = ["TriedRow", "rows_of_tried"]


@dataclass(frozen=True)
class TriedRow:
    """A set of effects that was fitted.

    Attributes
    ----------
    misfit : float
        Chi-square per degree of freedom.
    gain : float
        Chi-square, with penalties, below the baseline.
    evidence : float
        The same minus what freedom, unlikely sizes and further names cost.
    remark : str
        Whether it is the answer, is not excluded, or why it is no answer.
    """

    names: str
    misfit: float
    gain: float
    evidence: float
    remark: str
    chosen: bool


def rows_of_tried(naming: Naming, verdict: EngineVerdict) -> tuple[TriedRow, ...]:
    """One row for each set, in the form of it that fits best, by evidence."""
    best, rows = naming.best, dict[str, TriedRow]()
    rivals = naming.rivals()
    listed = naming.tried if best is None else (best, *naming.tried)
    for h in listed:
        row = TriedRow(
            _names(h.members),
            h.fit.chi2 / max(h.fit.expected, 1.0),
            h.gain,
            h.penalised_gain,
            _remark(h, best, rivals, verdict),
            h is best and bool(verdict.effects),
        )
        known = rows.get(row.names)
        if known is None or (not known.chosen and known.evidence < row.evidence):
            rows[row.names] = row
    return tuple(sorted(rows.values(), key=lambda row: -row.evidence))


def _names(members: Sequence[Candidate]) -> str:
    """Ids without underscores; of a law in no catalogue its direction and its variable, too."""
    words = []
    for member in members:
        effect = member.effect
        word = effect.id.replace("_", " ")
        if effect.id == EffectId.UNNAMED:
            coordinate = getattr(effect.coordinate, "value", "")
            details = [effect.form.replace("_", " "), f"over {coordinate}" if coordinate else ""]
            word += f" ({', '.join(one for one in details if one)})"
        words.append(word)
    return " + ".join(words)


def _remark(
    h: Hypothesis, best: Hypothesis | None, rivals: Sequence[Hypothesis], verdict: EngineVerdict
) -> str:
    if h is best:
        return "the answer" if verdict.effects else "best, but not named"
    if h.fit.ending is Ending.LOST:
        return "could not be followed"
    if not h.allowed:
        return "its parameters leave what nature allows"
    if any(h is one for one in rivals):
        return "not excluded"
    if h.fit.ending is Ending.UNFINISHED:
        return "fit left early: far behind"
    if best is not None and h.gain > best.gain:
        return "fits better, with more freedom than that justifies"
    return ""
