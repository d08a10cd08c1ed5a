"""Estimate the probability that a name is right."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from scipy.special import expit

from mismatch.candidates import Candidate
from mismatch.fitting.fit import Fit
from mismatch.fitting.hypotheses import Hypothesis, group_tolerance
from mismatch.fitting.scan import scan
from mismatch.fitting.stated import USUAL_INPUTS
from mismatch.forward import Forward
from mismatch.search.naming import Naming
from mismatch.search.unnamed import smooth_fields
from mismatch.verdict import Prediction
from physics.domain import FloatArray

__all__ = [
    "FEATURES",
    "NameEvidence",
    "calibrated_probability",
    "evidence_for_names",
    "features_of",
    "other_kind",
    "other_sizes",
    "sets_to_predict",
]

FEATURES = (
    "margin",
    "over_chance",
    "predicted",
    "held_out",
    "left",
    "structure",
    "fellows",
    "doubts",
    "mixed",
)
"""Columns of the calibration table, in the order of its weights."""


ODDS = 7.0
"""Chi-square units of odds of thirty to one, which are a margin of one where a law is exact."""

FORM_ERROR = 0.015
"""Fraction of the evidence that laws leave open because no law is known better (as in the groups of
answers that cannot be distinguished)."""

SURE_BY = 30.0
"""Evidence, in units of the misfit, beyond which more of it adds nothing: a wrong law fitted to a
strong effect outdoes others by thousands. Chosen; odds of e¹⁵ are certainty."""


@dataclass(frozen=True)
class NameEvidence:
    """What speaks for and against one name of an answer.

    Attributes
    ----------
    id : str
        The name.
    without : tuple of str
        The best set of names, of any size, that does without it; empty for the baseline.
    gain : float
        Evidence of the answer over the baseline, in units of the misfit.
    log_odds : float
        Evidence over chance and all sets that do without it together, in units of the misfit: five
        answers that are as good leave each a fifth.
    log_odds_over_unnamed : float
        Evidence of the whole answer over the best answer of the other kind: of names over forces
        without a name, or the reverse.
    predicted : float
        Fraction of the error of the last 40 % of each track that the name removes beyond that set.
    predicted_95 : tuple of float
        Interval over trials.
    held_out : float
        Chi-square, in units of the misfit, by which held-out trials fit better with the name.
    left : float
        Root mean square misfit beyond the noise that the answer leaves, over the baseline's.
    structure : float
        Evidence of a smooth force or torque added to the answer.
    fellows : int
        Other names in the answer.
    doubts : int
        One if a rule takes probability away: a further name that removes no error of predictions
        (95 %), a parameter at a bound, a fit that did not converge, a better forbidden answer, a
        strength that trials do not share or leave open.
    over_chance : float
        Evidence of the answer over what chance alone reaches in one campaign of a hundred, in units
        of the misfit.
    mixed : int
        One if the answer names faults of the recording and laws of the motion together. Both at
        once are rare, and either bends a path as the other's imperfect form leaves it.
    log_odds_over_inputs : float
        Logarithm of the odds against usual errors of the inputs in its place.
    """

    id: str
    without: tuple[str, ...]
    gain: float
    log_odds: float
    log_odds_over_unnamed: float
    predicted: float
    predicted_95: tuple[float, float]
    held_out: float
    left: float
    structure: float
    fellows: int
    doubts: int
    over_chance: float = SURE_BY
    mixed: int = 0
    log_odds_over_inputs: float = SURE_BY


def features_of(evidence: NameEvidence) -> FloatArray:
    """The columns `FEATURES` of one name, compressed where evidence has long tails.

    The margin is the smaller one, over sets of names and over answers of the other kind. An answer
    that its other kind outdoes by less than forms are imperfect is not refuted; one that is ahead
    of it needs no such allowance, since the rarity of what has no name is in the evidence. What a
    smooth force explains of the remainder is counted in the same units: a finer instrument sees
    more of the imperfection of every form.
    """
    over = evidence.log_odds_over_unnamed
    return np.array(
        [
            min(
                _margin(evidence.log_odds, evidence.gain),
                _margin(over, evidence.gain if over < 0.0 else 0.0),
            ),
            _compressed(evidence.over_chance),
            float(np.clip(evidence.predicted, -0.5, 1.0)),
            _compressed(evidence.held_out),
            evidence.left,
            _margin(max(evidence.structure, 0.0), evidence.gain),
            float(evidence.fellows),
            float(evidence.doubts),
            float(evidence.mixed),
        ]
    )


def _margin(difference: float, gain: float) -> float:
    """Evidence of one answer over another in units of what an imperfect form is worth."""
    return _compressed(difference / (ODDS + FORM_ERROR * max(gain, 0.0)))


def _compressed(size: float) -> float:
    """Logarithm of a size with its sign, constant beyond `SURE_BY`."""
    return math.copysign(math.log1p(min(abs(size), SURE_BY)), size)


@cache
def _calibration() -> Mapping[str, Any]:
    text = resources.files("mismatch").joinpath("acceptance.json").read_text(encoding="utf-8")
    return dict(json.loads(text))


def calibrated_probability(evidence: NameEvidence) -> float:
    """Probability that a name is right, by the fitted logistic model, and no error of the inputs.

    The prior odds of usual errors of the inputs are fitted to careful laboratories.
    """
    fitted = _calibration()
    weights = np.array([fitted["weights"][name]["value"] for name in FEATURES])
    score = fitted["intercept"]["value"] + float(weights @ features_of(evidence))
    return float(expit(score) * expit(evidence.log_odds_over_inputs))


def evidence_for_names(
    forward: Forward,
    base: Fit,
    naming: Naming,
    predictions: Mapping[int, Prediction],
    doubted: bool,
) -> tuple[NameEvidence, ...]:
    """Evidence for each name of an answer.

    Parameters
    ----------
    predictions : mapping
        id of a fit → its prediction, for the answer and for the sets of `rivals_without`.
    doubted : bool
        Whether something speaks against the answer as a whole.
    """
    best = naming.best
    if best is None:
        return ()
    structure = smooth_structure(forward, best)
    mine = naming.height(best)
    other = other_kind(naming, best)
    over = mine - (0.0 if other is None else naming.height(other))
    # Chi-square itself scatters by sqrt(2 n): what is within three of these is no misfit.
    noise = 1.0 + 3.0 * math.sqrt(2.0 / best.fit.expected)
    left = math.sqrt(
        max(best.fit.chi2 / best.fit.expected - noise, 0.0)
        / max(base.chi2 / base.expected - 1.0, 1e-9)
    )
    mixed = len({member.effect.phase == "measurement" for member in best.members}) > 1
    found = []
    for member in best.members:
        without = naming.best_without(member.id)
        odds = mine - _together_without(naming, best, member.id)
        known = base if without is None else without.fit
        predicted, interval = _removed(predictions, known, best.fit)
        held = _held_gain(predictions, known, best)
        found.append(
            NameEvidence(
                member.id,
                () if without is None else without.ids,
                mine / best.reduced_chi2,
                odds / best.reduced_chi2,
                over / best.reduced_chi2,
                predicted,
                interval,
                held,
                min(left, 1.0),
                structure,
                len(best.members) - 1,
                int(doubted or (len(best.members) > 1 and interval[0] <= 0.0)),
                mine / best.reduced_chi2 - naming.threshold,
                int(mixed),
                _over_inputs(naming, best, member.id),
            )
        )
    return tuple(found)


def _together_without(naming: Naming, best: Hypothesis, identity: str) -> float:
    """Evidence of chance and of all allowed sets of names that do without one of them.

    Sets of one law in several forms count once, and a set with a further name, which mends its
    form, with the set that it grew from. Probabilities are added, each as far from certain as an
    imperfect form leaves it.
    """
    heights: dict[frozenset[str], float] = {}
    for h in sorted(naming.without(identity), key=lambda h: len(h.members)):
        ids = frozenset(h.ids)
        smaller = [one for one in heights if one <= ids]
        ids = max(smaller, key=lambda one: heights[one], default=ids)
        heights[ids] = max(naming.height(h), heights.get(ids, -math.inf))
    evidence = np.array([naming.threshold - 6.0, *heights.values()])
    unit = _unit_of_odds(naming, best)
    top = float(evidence.max())
    return top + unit * math.log(float(np.exp((evidence - top) / unit).sum()))


def _unit_of_odds(naming: Naming, best: Hypothesis) -> float:
    """Evidence per factor e in the odds of two answers, as far as imperfect forms leave them."""
    gain = naming.height(best) / best.reduced_chi2
    return 2.0 * best.reduced_chi2 * (1.0 + FORM_ERROR * max(gain, 0.0) / ODDS)


def _over_inputs(naming: Naming, best: Hypothesis, identity: str) -> float:
    """Logarithm of the odds of the answer over usual errors of the inputs in place of a name."""
    instead = [h for h in naming.tried if USUAL_INPUTS in h.ids and identity not in h.ids]
    first = max((naming.height(h) for h in instead), default=-math.inf)
    return min((naming.height(best) - first) / _unit_of_odds(naming, best), SURE_BY)


def sets_to_predict(naming: Naming) -> tuple[Hypothesis, ...]:
    """The answer and the best sets without each of its names."""
    best = naming.best
    if best is None:
        return ()
    found = [best]
    for identity in dict.fromkeys(best.ids):
        without = naming.best_without(identity)
        if without is not None and all(without is not one for one in found):
            found.append(without)
    return tuple(found)


def other_kind(naming: Naming, best: Hypothesis) -> Hypothesis | None:
    """The best allowed answer without a name where `best` has one, or the reverse."""
    others = [h for h in naming.tried if h.allowed and h.has_unnamed != best.has_unnamed]
    return max(others, key=lambda h: h.penalised_gain, default=None)


def other_sizes(naming: Naming, best: Hypothesis) -> tuple[Hypothesis, ...]:
    """The best allowed set of fewer names, and the best of more if it has as much evidence.

    The probability of a name does not ask whether others are missing: the answer without one of its
    names is an answer as long as imperfect forms may be ahead of it by as much.
    """
    named = [
        h for h in naming.tried
        if h.allowed and not h.has_unnamed and USUAL_INPUTS not in h.ids
    ]  # fmt: skip
    without = naming.height(best) - 0.5 * ODDS * _unit_of_odds(naming, best)
    fewer = [
        h
        for h in named
        if len(h.members) < len(best.members)
        and (naming.height(h) >= without or not set(h.ids) < set(best.ids))
    ]
    least = best.penalised_gain - group_tolerance(best)
    more = [h for h in named if len(h.members) > len(best.members) and h.penalised_gain >= least]
    return tuple(max(sets, key=lambda h: h.penalised_gain) for sets in (fewer, more) if sets)


def _removed(
    predictions: Mapping[int, Prediction], before: Fit, after: Fit
) -> tuple[float, tuple[float, float]]:
    one, other = predictions.get(id(before)), predictions.get(id(after))
    if one is None or other is None or not one.late.size or one.late.sum() <= 0.0:
        return 0.0, (-1.0, 1.0)
    fraction = 1.0 - math.sqrt(float(other.late.sum() / one.late.sum()))
    if one.late.size < 2:
        return fraction, (-1.0, 1.0)
    picks = np.random.default_rng(11).integers(0, one.late.size, (400, one.late.size))
    ratio = other.late[picks].sum(axis=1) / np.maximum(one.late[picks].sum(axis=1), 1e-300)
    low, high = np.quantile(1.0 - np.sqrt(ratio), [0.025, 0.975])
    return fraction, (float(low), float(high))


def _held_gain(predictions: Mapping[int, Prediction], before: Fit, best: Hypothesis) -> float:
    one, other = predictions.get(id(before)), predictions.get(id(best.fit))
    if one is None or other is None or one.cost is None or other.cost is None:
        return 0.0
    return (one.cost - other.cost) / best.reduced_chi2


def smooth_structure(forward: Forward, best: Hypothesis) -> float:
    """Evidence, in units of the misfit, of the best smooth component added to an answer.

    Scored to first order around the fit; its size is the one of highest evidence.
    """
    held = {member.key for member in best.members}
    pool = [Candidate(effect) for effect in smooth_fields(forward)]
    pool = [one for one in pool if one.key not in held]
    if not pool:
        return 0.0
    scored = scan(forward, best.fit, pool).with_likely_widths()
    gains = [scored.gain(k)[0] - one.complexity_penalty for k, one in enumerate(scored.candidates)]
    return max(gains) / best.reduced_chi2
