"""Compare names with errors that careful laboratories have in their inputs."""

from dataclasses import dataclass, replace

import numpy as np

from mismatch.candidates import Candidate
from mismatch.fitting.fit import Fit
from mismatch.fitting.hypotheses import (
    MEMBER_PENALTY,
    Hypothesis,
    as_fitted,
    fit_hypothesis,
)
from mismatch.fitting.prepare import Prepared
from mismatch.fitting.stated import usual_inputs
from mismatch.forward import Forward
from mismatch.search.naming import Naming
from physics.effects import Effect

__all__ = ["PRIOR_COST", "BesideInputs", "beside_usual_inputs", "lead_of_inputs"]


@dataclass(frozen=True)
class BesideInputs:
    """Sets of names next to usual errors of the inputs.

    Attributes
    ----------
    sets : tuple of Hypothesis
        Those errors alone, and next to the answer without each of its names; next to all of it
        where they belong into every fit.
    opened : Prepared or None
        The baseline with these errors open, where one of the sets has more evidence than the
        answer: then they belong into every fit.
    lead : float
        Evidence by which the best of the sets is ahead of the answer, beyond what it must be.
    """

    sets: tuple[Hypothesis, ...]
    opened: Prepared | None
    lead: float = 0.0


PRIOR_COST = -13.4
"""Chi-square units by which errors of the inputs must be ahead of names. Below zero: names have not
paid for being chosen among many of any strength. Fitted, -13.4 ± 1.5: training/fit_inputs.py,
careful laboratories against medium effects of the own generator and of a foreign world."""


def beside_usual_inputs(prepared: Prepared, naming: Naming) -> BesideInputs:
    """Fit usual errors of inputs and instruments in place of each name, and next to all.

    Only strikes need it: free flights and free swings leave their instruments open from the start.
    """
    forward, best = prepared.forward, naming.best
    if best is None or forward.mode != "impact":
        return BesideInputs((), None)
    instead = tuple(h for h in _in_place_of_names(prepared, naming, best) if h.allowed)
    if not instead or len(instead[0].members) > 1:
        # Errors beyond their bounds are a fit that ran away, and no baseline.
        return BesideInputs(instead, None)
    alone, *others = (h.penalised_gain for h in instead)
    inputs = instead[0].members[0].effect
    both = _beside(forward, prepared.fit, best, inputs)
    # Next to all names errors take the place of none: they are no further name, and have no odds.
    beside_all = both.penalised_gain + MEMBER_PENALTY + PRIOR_COST
    lead = max(alone, *others, beside_all) - naming.height(best)
    if lead <= 0.0:
        return BesideInputs(instead, None)
    baseline = replace(forward.baseline, instruments=(*forward.baseline.instruments, inputs))
    opened = replace(prepared, forward=replace(forward, baseline=baseline), fit=instead[0].fit)
    return BesideInputs((both, *instead), opened, lead)


def lead_of_inputs(prepared: Prepared, naming: Naming) -> float | None:
    """Evidence of the inputs over the names that they stand in for, their prior odds left out."""
    if naming.best is None or prepared.forward.mode != "impact":
        return None
    sets = _in_place_of_names(prepared, naming, naming.best)
    lead = max(h.penalised_gain for h in sets) - naming.height(naming.best)
    return lead + PRIOR_COST


def _in_place_of_names(
    prepared: Prepared, naming: Naming, best: Hypothesis
) -> tuple[Hypothesis, ...]:
    """Errors of the inputs alone, and in place of each name next to the others.

    One fault of an instrument is called by its name, however small it is. Several at once are what
    a careful laboratory has.
    """
    forward, known = prepared.forward, prepared.forward.baseline.instruments
    several = len(set(best.ids)) > 1
    all_inputs = usual_inputs(known, () if several else best.ids)
    others = [
        max(fitting, key=lambda h: h.penalised_gain)
        for name in dict.fromkeys(best.ids)
        for left in (sorted(one for one in best.ids if one != name),)
        for fitting in ([h for h in naming.tried if h.allowed and sorted(h.ids) == left],)
        if left and fitting
    ]
    return (
        _beside(forward, prepared.fit, None, all_inputs),
        *(_beside(forward, prepared.fit, h, usual_inputs(known, h.ids)) for h in others),
    )


def _beside(forward: Forward, base: Fit, found: Hypothesis | None, inputs: Effect) -> Hypothesis:
    """A set of names and the errors of the inputs, fitted together.

    Their evidence is integrated over the sizes that careful laboratories have: errors that all turn
    out far smaller speak for inputs that are exact. In place of a further name they cost what that
    costs, so that the odds against a name are the same alone and beside others.
    """
    members, strengths = ([], []) if found is None else as_fitted(found.members, found.fit)
    start = None if found is None else found.fit
    blank = Candidate(inputs)
    h = fit_hypothesis(
        forward, base, [*members, blank], [*strengths, np.zeros(len(inputs.parameters))],
        start=start,
    )  # fmt: skip
    return replace(h, gain=h.gain - PRIOR_COST)
