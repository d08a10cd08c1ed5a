"""Search for the set of effects that explains a mismatch.

The missing force over time is the posterior of a row of overlapping hats with a smoothness prior;
positions are linear in it, so that it is Gaussian and exact.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import TypeAlias

import numpy as np

from mismatch.candidates import Candidate, candidates_for
from mismatch.fitting.fit import FIRST_STEPS, Ending, Fit
from mismatch.fitting.hypotheses import (
    FIRST_REACH,
    FIRST_SHARE,
    MEMBER_PENALTY,
    POOR_FIT,
    SLACK,
    WHOLE_ROUNDS,
    Hypothesis,
    as_fitted,
    evidence_of_uneven_losses,
    fit_hypothesis,
    group_tolerance,
    is_distinct,
    is_known,
    least_gain,
    left_by_forms,
    left_by_uneven_losses,
    null_threshold,
    scan_beyond_forms,
    second_effect_share,
)
from mismatch.fitting.scan import Scan, robust_spread, scan
from mismatch.fitting.stated import USUAL_INPUTS
from mismatch.forward import Forward
from mismatch.sanity import drifting_clock, dropped_in_each
from mismatch.search.unnamed import SmoothCurve
from physics.domain import FloatArray, Number, Vector
from physics.effects import (
    Coordinate,
    Effect,
    EffectId,
    FlightState,
    Level,
    Parameter,
    Phase,
    SwingState,
    Values,
)

__all__ = ["Family", "LatentForce", "Naming", "missing_force", "name_effects"]

_log = logging.getLogger(__name__)

WEIGHT_SCALE = 2.2

"""Chi-square units per factor e in the odds of two answers: two would be Gaussian to the letter."""

FORM_REACH = 12.0

"""Penalised gain behind its law's best form, by the linear score, from which a form is not
refitted: odds of one to two hundred, beyond what a refit usually adds."""

FORM_SHARE = 0.15

"""Share of its law's gain by which, in strong cases, the linear score may misjudge a form."""

MISJUDGED = 0.5

"""Share of what the linear score promised of a form below which a law's fits have shown nothing of
its other forms; assumed."""

SECOND_FORM_REACH = 4.0

"""Penalised gain behind the best further law, by the linear score, up to which its other forms are
fitted."""

MAX_UNNAMED = 6

"""Laws in no catalogue that are tried, and likewise curves, the best by the linear score. Chosen:
a law that saturates is misjudged by the linear score, and curves would crowd it out."""

MAX_STARTS = 3

"""Shapes from which one law is fitted. Chosen: of 70 laws of a strike a fifth have a second peak,
hardly one a fourth."""

START_SHARE = 0.4

"""Fraction of its law's linear score from which another peak is a start, as for laws alone. The
score of a place between two starts of the grid may be half of what a fit gains there."""

MAX_CORRECTED = 3

"""Laws and curves in no catalogue, the best alone first, that are tried beside a correction of what
the setup states; assumed."""

SEED_SHARE = 0.35

"""Share of the best smaller set's evidence from which a set is grown; assumed."""

LAW_REACH = 16.0

"""Penalised gain behind the best answer from which further forms of a law can't matter any more."""

MAX_SINGLES = 16

"""Effects that are tried in groups, the best alone first; assumed."""

MAX_INSTEAD = 6

"""Pairs of laws that are fitted in place of one that leaves nothing over, and laws that are fitted
in place of one of several; assumed."""

SCALES = frozenset({"length_scale", "time_base"})

STATED = frozenset({EffectId.DRAG})

"""Ids whose size a setup states, and may state wrongly: as itself, or by the mass, size or air that
it goes with."""

KNOWN_GAIN = 2.0

"""Gain over reduced χ² from which an effect of known size, like thinner air, is taken in."""

STEADY = 3.0

"""Sigma, by the scatter of trials, from which a strength is not chance."""

MAX_EFFECTS = 3

"""Effects in one answer, assumed: a campaign hardly distinguishes four."""


@dataclass(frozen=True)
class Family:
    """All forms of one set of laws that were fitted.

    Attributes
    ----------
    ids : tuple of str
        In order of the alphabet.
    members : tuple of Hypothesis
        Best first, allowed ones alone.
    penalised_gain : float
        Evidence averaged over the forms that there are, chi-square units.
    quality : float
        The same by the data alone, unlikely strengths not counted against it.
    """

    ids: tuple[str, ...]
    members: tuple[Hypothesis, ...]
    penalised_gain: float
    quality: float

    @property
    def best(self) -> Hypothesis:
        """The form that fits best."""
        return self.members[0]


def _averaged(gains: Sequence[float], forms: int, scale: float) -> float:
    top = max(gains)
    total = sum(float(np.exp((gain - top) / scale)) for gain in gains)
    # Forms that were not refitted count for nothing: the average is then a little too low.
    return top + scale * float(np.log(total / forms))


@dataclass(frozen=True)
class Naming:
    """What the search found.

    Attributes
    ----------
    best : Hypothesis or None
        The answer; None where nothing is missing.
    tried : tuple of Hypothesis
        Everything that was refitted, best first.
    threshold : float
        Penalised gain that chance alone exceeds in one campaign of a hundred.
    first_scan : Scan
        Scores around the baseline.
    agreed : int
        Independent starts from which the answer's fit ended at the same place; one alone leaves
        open that another start would have ended lower.
    set_aside : (tuple of str, float) or None
        Names that usual errors of the inputs took the place of, and by how much evidence.
    """

    best: Hypothesis | None
    tried: tuple[Hypothesis, ...]
    threshold: float
    first_scan: Scan
    agreed: int = 1
    set_aside: tuple[tuple[str, ...], float] | None = None

    @cached_property
    def forms(self) -> Mapping[str, int]:
        """Id → how many forms of its law there are for this campaign.

        Each law in no catalogue has paid for being rare by itself, and none is a form of another:
        together they have the sum of their evidence.
        """
        keys = {(one.id, one.effect.form, one.effect.level) for one in self.first_scan.candidates}
        found: dict[str, int] = {}
        for identity, *_ in keys:
            found[identity] = found.get(identity, 0) + 1
        return found | {EffectId.UNNAMED: 1}

    @cached_property
    def families(self) -> Mapping[tuple[str, ...], Family]:
        """Every set of laws that was fitted, its evidence averaged over their forms."""
        scale = WEIGHT_SCALE * (1.0 if self.best is None else self.best.reduced_chi2)
        grouped: dict[tuple[str, ...], list[Hypothesis]] = {}
        for h in self.tried:
            if h.allowed:
                grouped.setdefault(tuple(sorted(h.ids)), []).append(h)
        found = {}
        for ids, members in grouped.items():
            count = int(np.prod([self.forms.get(one, 1) for one in ids]))
            if EffectId.UNNAMED not in ids:
                count = max(count, len(members))
            ordered = tuple(sorted(members, key=lambda h: -h.penalised_gain))
            found[ids] = Family(
                ids, ordered,
                _averaged([h.penalised_gain for h in ordered], count, scale),
                _averaged([h.quality for h in ordered], count, scale),
            )  # fmt: skip
        return found

    def nearest(self) -> Mapping[tuple[str, ...], float]:
        """Allowed sets → evidence, best first; by the linear score alone where none was fitted."""
        pool = self.first_scan.candidates
        scored = [((pool[at].id,), gain) for gain, at, _ in _best_by_law(self.first_scan)]
        fitted = [(h.ids, self.height(h)) for h in self.tried if h.allowed]
        found: dict[tuple[str, ...], float] = {}
        for ids, evidence in fitted or scored:
            found.setdefault(ids, evidence)
        return found

    def rivals(self) -> tuple[Hypothesis, ...]:
        """Answers that the data cannot distinguish from the best one.

        Laws are compared by all their forms together, and by their best forms: what either leaves
        open is not excluded, as far as it belongs to the most probable `CREDIBLE` of all.
        """
        best = self.best
        if best is None:
            return ()
        tolerance = group_tolerance(best)
        mine = self.families.get(tuple(sorted(best.ids)))

        def behind(h: Hypothesis) -> float:
            theirs = self.families.get(tuple(sorted(h.ids)))
            if mine is None or theirs is None:
                return best.quality - h.quality
            return mine.quality - theirs.quality

        alike = [
            h
            for h in self.tried
            if h is not best
            and (h.fit.inside_bounds or h.fit.may_be_inside)
            and len(h.members) == len(best.members)
        ]
        near = [best, *(h for h in alike if min(behind(h), best.quality - h.quality) <= tolerance)]
        gaps = {tuple(sorted(h.ids)): behind(h) for h in near}
        credible = _credible(gaps, tolerance) | {tuple(sorted(best.ids))}
        return (
            *(h for h in alike if tuple(sorted(h.ids)) in credible or not is_distinct(best, h)),
            *self._of_other_sizes(best, tolerance),
        )

    def _of_other_sizes(self, best: Hypothesis, tolerance: float) -> list[Hypothesis]:
        """Sets with fewer or more names in place of the answer's, with as much evidence.

        More names follow an imperfect law anyway: of those, evidence alone is compared.
        """
        mine, size = set(best.ids), len(best.members)
        return [
            h
            for h in self.tried
            if h.allowed
            and len(h.members) != size
            and not (mine <= set(h.ids) or set(h.ids) <= mine)
            and self.height(best) - self.height(h)
            <= (tolerance if len(h.members) < size else EXCLUDED * best.reduced_chi2)
        ]

    def without(self, identity: str) -> list[Hypothesis]:
        """Allowed sets of names, of any size, that do without one of them.

        Forces without a name are compared with the whole answer, since one may contain a named law;
        usual errors of the inputs have odds of their own.
        """
        apart = {identity, EffectId.UNNAMED, USUAL_INPUTS}
        return [h for h in self.tried if h.allowed and apart.isdisjoint(h.ids)]

    def best_without(self, identity: str) -> Hypothesis | None:
        """The best of these sets; None where none is better than the baseline."""
        best = max(self.without(identity), key=lambda h: h.penalised_gain, default=None)
        return best if best is not None and best.penalised_gain > 0.0 else None

    def height(self, h: Hypothesis) -> float:
        """Evidence of a set over the baseline, averaged over the forms of its laws."""
        family = self.families.get(tuple(sorted(h.ids)))
        return h.penalised_gain if family is None else family.penalised_gain

    def and_tried(self, more: Sequence[Hypothesis]) -> "Naming":
        """The same with further sets among those that were tried."""
        return replace(self, tried=_sorted([*self.tried, *more]))

    def with_likeliest(self) -> "Naming":
        """The same, its answer the best form of the set that all forms together make most probable.

        One form among five that fits best was chosen among five. A name goes before a law that has
        none as long as that is no likelier, and it has paid for being rare. Where nothing fits to
        the noise, or what fits best has no name, the search has weighed more than evidence.
        """
        best = self.best
        if best is None or best.has_unnamed or best.reduced_chi2 >= POOR_FIT:
            return self
        size = len(best.members)
        alike = [
            one
            for ids, one in self.families.items()
            if len(ids) == size and not one.best.has_unnamed and one.best.fit.inside_bounds
        ]
        first = max(alike, key=lambda one: one.penalised_gain, default=None)
        if first is None:
            return self
        nameless = self.families.get((str(EffectId.UNNAMED),)) if size == 1 else None
        if nameless is not None and nameless.penalised_gain > first.penalised_gain:
            first = nameless
        return replace(self, best=first.best)

    def suspects(self) -> tuple[str, ...]:
        """Faults of clock or ruler that take a part of the misfit, though not enough to be named.

        In free flights they trade against the strength of what was named; in a fall both come to
        the same.
        """
        best = self.best
        if best is None or best.reduced_chi2 < POOR_FIT or SCALES.intersection(best.ids):
            return ()
        least = best.quality + 7.0 * best.reduced_chi2
        larger = [h for h in self.tried if len(h.ids) == len(best.ids) + 1]
        blamed = {
            one for h in larger if set(h.ids) > set(best.ids) and h.quality > least
            for one in SCALES.difference(best.ids).intersection(h.ids)
        }  # fmt: skip
        return tuple(sorted(SCALES)) if blamed else ()

    @property
    def outdone(self) -> bool:
        """Whether the records prefer an answer no larger that nature forbids.

        A drag below none, or air that lifts and does not resist, is no answer; but where it fits
        beyond doubt better than the best allowed one, the truth is not among those that were
        tried, or the setup around them is wrong.
        """
        best = self.best
        if best is None:
            return False
        least = best.quality + group_tolerance(best)
        return any(
            h.forbidden
            and len(h.members) <= len(best.members)
            and h.quality > least
            and is_distinct(h, best)
            for h in self.tried
        )


CREDIBLE = 0.95

"""Share of the probability that an answer and those not excluded in its place have together."""

EXCLUDED = 7.0

"""Chi-square units, odds of one to thirty, from which an answer is excluded."""

ODDS = EXCLUDED / WEIGHT_SCALE

"""Factors e that a tolerance stands for."""


def _credible(
    gaps: Mapping[tuple[str, ...], float], tolerance: float
) -> frozenset[tuple[str, ...]]:
    """Sets of laws that have the share `CREDIBLE` of the probability together with the best one.

    Those that say the same fit alike, and stay; of a long tail each is unlikely.

    Parameters
    ----------
    gaps : mapping
        Set → chi-square units behind the best one, that one perhaps among them.
    """
    weights = {ids: float(np.exp(-max(gap, 0.0) * ODDS / tolerance)) for ids, gap in gaps.items()}
    order = sorted(weights, key=lambda ids: -weights[ids])
    before = np.cumsum([0.0, *(weights[ids] for ids in order)])
    return frozenset(
        ids for ids, seen in zip(order, before, strict=False) if seen < CREDIBLE * before[-1]
    )


def _best_by_law(scored: Scan, anywhere: bool = False) -> list[tuple[float, int, FloatArray]]:
    """Best shape of every law: (penalised, candidate, strengths), best first.

    Free swings are scored `anywhere`: far from the answer the sign of an estimate says nothing.
    """
    best: dict[Effect, tuple[float, int, FloatArray]] = {}
    for index, candidate in enumerate(scored.candidates):
        gain, values = scored.gain(index)
        known = is_known(candidate.effect)
        if not anywhere and not known and not scored.allowed(index, values):
            continue
        penalised = gain - candidate.complexity_penalty
        if candidate.key not in best or penalised > best[candidate.key][0]:
            best[candidate.key] = (penalised, index, values)
    return sorted(best.values(), key=lambda item: -item[0])


def _starts(scored: Scan, index: int, values: FloatArray) -> list[tuple[Candidate, FloatArray]]:
    """Shapes and strengths from which a law is fitted: its best by the linear score, other peaks.

    A push from above the path scores as a pull from below it, and no fit leads from one to the
    other: shapes whose strengths have opposite signs are no neighbours.
    """
    law = scored.candidates[index]
    scores = {
        k: scored.gain(k)
        for k, one in enumerate(scored.candidates)
        if law.shape and one.key == law.key and k != index
    }
    least = START_SHARE * scored.gain(index)[0]
    others = [k for k, (gain, found) in scores.items() if scored.allowed(k, found)]
    starts, seen = [(law, values)], [(np.array(law.place), values)]
    for k in sorted(others, key=lambda k: -scores[k][0]):
        gain, found = scores[k]
        place = np.array(scored.candidates[k].place)
        beside = any(np.abs(place - at).max() <= 1 and found @ one > 0.0 for at, one in seen)
        seen.append((place, found))
        if gain > least and not beside:
            starts.append((scored.candidates[k], found))
    return starts


def _from_each_start(
    forward: Forward,
    base: Fit,
    scored: Scan,
    item: tuple[float, int, FloatArray],
    seed: Hypothesis | None = None,
    *,
    rounds: int = WHOLE_ROUNDS,
    rival: float = np.inf,
) -> Hypothesis:
    """A law fitted alone, or with those of a smaller set where they ended, from all its starts.

    Of several starts each is followed to its end: the right one may be far behind at first. Free
    swings, which pass every place at many rates, ended alike from all and need the best one alone.
    """
    members, strengths = ([], []) if seed is None else as_fitted(seed.members, seed.fit)
    starts = _starts(scored, *item[1:])[: 1 if forward.mode == "swing" else MAX_STARTS]
    if len(starts) > 1:
        rounds, rival = WHOLE_ROUNDS, np.inf
    found = [
        fit_hypothesis(
            forward, base, [*members, one], [*strengths, values],
            start=None if seed is None else seed.fit, rounds=rounds, rival=rival,
        )
        for one, values in starts
    ]  # fmt: skip
    return min(found, key=lambda h: (not h.allowed, h.fit.objective))


Ranked: TypeAlias = list[tuple[float, int, FloatArray]]

"""(penalised, candidate, strengths) by the linear score, best first."""


def _by_law(ranked: Ranked, candidates: Sequence[Candidate]) -> tuple[Ranked, Ranked]:
    """The best form of each law, and the other forms that are not far behind it.

    Laws in no catalogue are no forms of each other.
    """
    first: Ranked = []
    others: Ranked = []
    lead: dict[str, float] = {}
    unnamed = {True: 0, False: 0}
    for item in ranked:
        identity = candidates[item[1]].id
        if identity == EffectId.UNNAMED:
            kind = isinstance(candidates[item[1]].effect, SmoothCurve)
            if unnamed[kind] < MAX_UNNAMED:
                unnamed[kind] += 1
                first.append(item)
        elif identity not in lead:
            lead[identity] = item[0]
            first.append(item)
        elif item[0] > lead[identity] - FORM_REACH or item[0] > (1.0 - FORM_SHARE) * lead[identity]:
            others.append(item)
    return first, others


def _those_that_compete_finished(
    forward: Forward, base: Fit, tried: Sequence[Hypothesis]
) -> list[Hypothesis]:
    """Fits brought to their end where that may matter, the others as they are.

    Free swings are always followed to their end.
    """
    if forward.mode == "swing":
        return list(tried)
    lead = max((h.penalised_gain for h in tried if h.allowed), default=-np.inf)
    least = lead - max(FIRST_REACH, FIRST_SHARE * abs(lead))
    rival = _ahead(tried)
    return [
        _continued(forward, base, h, rival)
        if (h.penalised_gain > least and not _has_ended(h)) or h.fit.ending is Ending.UNFINISHED
        else h
        for h in tried
    ]


def _has_ended(h: Hypothesis) -> bool:
    """Whether another start would end where the fit did: shapes are held near where they start."""
    shaped = any(member.effect.shapes for member in h.members)
    return h.fit.ending is Ending.CONVERGED and not shaped


def _continued(forward: Forward, base: Fit, h: Hypothesis, rival: float) -> Hypothesis:
    """A hypothesis fitted on from where it stands, as long as it may reach its rival."""
    members, strengths = as_fitted(h.members, h.fit)
    return fit_hypothesis(forward, base, members, strengths, start=h.fit, rival=rival)


def _other_forms(
    forward: Forward,
    base: Fit,
    scored: Scan,
    others: Ranked,
    tried: Sequence[Hypothesis],
) -> list[Hypothesis]:
    """Further forms of the laws that compete, refitted.

    A law may also have been misjudged: the linear score is blind to what saturates, and the form
    that it puts first may fit nothing where the plain one fits all.
    """
    lead = max((h.penalised_gain for h in tried if h.allowed), default=-np.inf)
    reach = max(LAW_REACH, FORM_SHARE * lead)
    best = {h.ids[0]: h.penalised_gain for h in tried}
    found = []
    for promised, index, values in others:
        identity = scored.candidates[index].id
        so_far = best.get(identity, -np.inf)
        misjudged = promised > lead - reach and so_far < MISJUDGED * promised
        if so_far > lead - reach or misjudged:
            h = _from_each_start(forward, base, scored, (promised, index, values))
            best[identity] = max(so_far, h.penalised_gain)
            found.append(h)
    return found


def _shortlist(
    ranked: list[tuple[float, int, FloatArray]], most: int, share: float
) -> list[tuple[float, int, FloatArray]]:
    if not ranked:
        return []
    top = ranked[0][0]
    return [item for item in ranked[:most] if item[0] > min(share * abs(top), top - 16.0)]


def _with_a_nameless_one(listed: Ranked, ranked: Ranked, candidates: Sequence[Candidate]) -> Ranked:
    """The list and, if no law in it is nameless, the best of those: all compare with it."""
    nameless = [item for item in ranked if candidates[item[1]].id == EffectId.UNNAMED]
    held = any(candidates[index].id == EffectId.UNNAMED for _, index, _ in listed)
    return listed if held or not listed else [*listed, *nameless[:1]]


def name_effects(
    forward: Forward,
    base: Fit,
    effects: Sequence[Effect],
    *,
    most: int = MAX_EFFECTS,
    unnamed: bool = True,
) -> Naming:
    """Find the set of effects that explains a mismatch.

    Parameters
    ----------
    forward : Forward
        Predictor with the records.
    base : Fit
        The refitted baseline.
    effects : sequence of Effect
        The catalogue, a user's own included.
    most : int
        Largest set.
    unnamed : bool
        Whether laws in no catalogue take part.

    Returns
    -------
    Naming
    """
    with_clocks = _with_clocks(forward, base, effects)
    pool = candidates_for(forward, base.model, with_clocks, unnamed=unnamed)
    _log.info("Score %d forms of effects", len(pool))
    first = scan(forward, base, pool).with_likely_widths()
    threshold = null_threshold(first)
    ranked = _best_by_law(first, forward.mode == "swing")
    if not ranked or ranked[0][0] < 0.6 * threshold:
        return Naming(None, (), threshold, first)
    _log.info("Fit the most probable effects alone")
    tried = _singles(forward, base, first, ranked)
    best = _best_allowed(forward, tried)
    if best is None or best.penalised_gain < least_gain(best, base, threshold):
        return Naming(None, _sorted(tried), threshold, first)
    most = min(most, 2) if _one_throw(forward) else most
    for size in range(2, most + 1):
        _log.info("Fit sets of %d effects", size)
        larger, best = _one_more(forward, base, effects, best, tried, size, threshold, first)
        if larger is None:
            break
        best = larger
    steady = _steady(forward, best, tried)
    if steady is None:
        return Naming(None, _sorted(tried), threshold, first)
    best = steady
    if best.reduced_chi2 >= POOR_FIT and forward.mode == "flight":
        tried.extend(_with_ruler_or_clock(forward, base, effects, best))
    tried.extend(_in_place_of_each(forward, base, effects, best, tried))
    found = Naming(best, _sorted(tried), threshold, first).with_likeliest()
    return _confirmed(forward, base, found)


def _singles(forward: Forward, base: Fit, first: Scan, ranked: Ranked) -> list[Hypothesis]:
    """Laws alone, the best by the linear score, those that compete fitted to their end."""
    share = -np.inf if forward.mode == "swing" else 0.4
    first_of_each, others = _by_law(ranked, first.candidates)
    listed = _shortlist(first_of_each, MAX_SINGLES, share)
    tried: list[Hypothesis] = []
    for item in _with_a_nameless_one(listed, first_of_each, first.candidates):
        ahead = _ahead(tried)
        tried.append(_from_each_start(forward, base, first, item, rounds=FIRST_STEPS, rival=ahead))
    tried = _those_that_compete_finished(forward, base, tried)
    return tried + _other_forms(forward, base, first, others, tried)


def _one_more(
    forward: Forward,
    base: Fit,
    effects: Sequence[Effect],
    best: Hypothesis,
    tried: list[Hypothesis],
    size: int,
    threshold: float,
    first: Scan,
) -> tuple[Hypothesis | None, Hypothesis]:
    """A set of some size that goes before the best smaller one, and the best smaller one.

    What is fitted in between joins those `tried`.
    """
    swinging = forward.mode == "swing"
    grown = _grow(forward, base, effects, tried, size, threshold, first)
    if size == 2:
        grown += _corrected(forward, base, effects, [*tried, *grown], threshold)
    tried.extend(grown)
    supported = [h for h in grown if _goes_first(forward, h, best, tried, threshold)]
    if _one_throw(forward):
        # Two strengths of one throw trade against each other; only a known size may follow.
        supported = [h for h in supported if is_known(h.members[-1].effect)]
    larger = _best_allowed(forward, supported)
    if larger is None:
        return None, best
    smaller = _without_each(forward, base, larger) if swinging else []
    tried.extend(smaller)
    best = _best_allowed(forward, [best, *smaller]) or best
    if not _goes_first(forward, larger, best, tried, threshold):
        return None, best
    larger, best = _in_best_forms(forward, base, effects, larger, best, tried)
    return (larger if _goes_first(forward, larger, best, tried, threshold) else None), best


OTHER_STARTS = (0.5, 0.0, 1.5)

"""Shares of the strengths found from which the answer is fitted anew until two starts agree."""


def _confirmed(forward: Forward, base: Fit, naming: Naming) -> Naming:
    """The naming with its answer fitted anew from other starts, until one ends where it did.

    A start that ends lower takes its place, and has to be confirmed in turn.
    """
    best = naming.best
    if best is None:
        return naming
    agreed, tried = 1, list(naming.tried)
    for share in OTHER_STARTS:
        members, strengths = as_fitted(best.members, best.fit)
        begun = [
            np.array([p.neutral + share * (v - p.neutral) for p, v in
                      zip(member.effect.strengths, values, strict=True)])
            for member, values in zip(members, strengths, strict=True)
        ]  # fmt: skip
        again = fit_hypothesis(forward, base, members, begun, rival=best.fit.objective)
        lower = best.fit.objective - again.fit.objective
        if abs(lower) <= SLACK * best.reduced_chi2:
            agreed += 1
            break
        if lower > 0.0 and again.allowed:
            best, agreed = again, 1
            tried.append(again)
    return replace(naming, best=best, tried=_sorted(tried), agreed=agreed)


def _goes_first(
    forward: Forward,
    larger: Hypothesis,
    best: Hypothesis,
    tried: Sequence[Hypothesis],
    threshold: float,
) -> bool:
    """Whether a larger set takes the place of the best smaller one.

    A law or curve in no catalogue competes with sets of names on equal terms: names that carry at
    least as much evidence, each of which is needed among its fellows, go before it.
    """
    last = larger.members[-1]
    if is_known(last.effect) and set(larger.ids[:-1]) != set(best.ids):
        # What a known law adds is seen beside its own fellows, not against another law's gain.
        if larger.penalised_gain < best.penalised_gain:
            return False
        fellows = [h for h in tried if h.allowed and h.ids == larger.ids[:-1]]
        beside = max(fellows, key=lambda h: h.gain, default=None)
        return beside is not None and _supported(forward, larger, beside, threshold)
    if _supported(forward, larger, best, threshold):
        return True
    if not best.has_unnamed or larger.penalised_gain < best.penalised_gain:
        return False
    size = len(larger.members) - 1
    fellows = [h for h in tried if not h.has_unnamed and len(h.members) == size and h.allowed]
    named = max(fellows, key=lambda h: h.penalised_gain, default=None)
    return named is not None and _supported(forward, larger, named, threshold)


def _steady(forward: Forward, best: Hypothesis, tried: Sequence[Hypothesis]) -> Hypothesis | None:
    """The answer without what is lost in the scatter of trials, where no law fits to the noise.

    A fault that differs from trial to trial leaves a misfit in which something of any law can be
    found; what then is real pulls all trials in one direction.
    """
    if best.reduced_chi2 < POOR_FIT:
        return best
    keys = {member.key for member in best.members}
    parts = [h for h in _sorted(tried) if h.allowed and {m.key for m in h.members} < keys]
    # The larger set hides behind each other what two of its members say alike.
    for answer in (best, *parts):
        spreads = robust_spread(forward, answer.fit)
        if all(_significance(answer.fit, m.effect, spreads) > STEADY for m in answer.members):
            return answer
    return None


def _significance(fit: Fit, effect: Effect, spreads: FloatArray) -> float:
    """Sigma by which the strongest strength of an effect is off neutral.

    One that each ball, session or trial has of its own may have a mean of zero; the evidence has
    weighed its scatter already.
    """
    if effect.level is not Level.CAMPAIGN:
        return np.inf
    found = [
        abs(fit.value(i)[0] - item.parameter.neutral) / max(float(spreads[i]), 1e-300)
        for i, item in enumerate(fit.free)
        if fit.model.entries[item.entry][0] is effect and not item.parameter.is_shape
    ]
    return np.inf if is_known(effect) else max(found, default=0.0)


def _with_ruler_or_clock(
    forward: Forward, base: Fit, effects: Sequence[Effect], best: Hypothesis
) -> list[Hypothesis]:
    """The answer and a fault of scale or rate, which a law that fits badly leaves room for."""
    more = [e for e in effects if e.id in SCALES.difference(best.ids)]
    pool = candidates_for(forward, best.fit.model, more, unnamed=False)
    scored = scan(forward, best.fit, pool)
    return [_from_each_start(forward, base, scored, item, best) for item in _best_by_law(scored)]


def _with_clocks(forward: Forward, fit: Fit, effects: Sequence[Effect]) -> list[Effect]:
    """The effects, with a clock that drifts and frames dropped at each trial's own step.

    Each is a form of an effect that is asked for.
    """
    jumps = dropped_in_each(forward, fit)
    clocks = drifting_clock(forward) if any(e.id == EffectId.TIME_BASE for e in effects) else ()
    return [*effects, *clocks, *(() if jumps is None else (jumps,))]


def _one_throw(forward: Forward) -> bool:
    return forward.mode == "flight" and forward.records.trials == 1


def _supported(forward: Forward, larger: Hypothesis, smaller: Hypothesis, threshold: float) -> bool:
    more = larger.penalised_gain - smaller.penalised_gain
    if is_known(larger.members[-1].effect):
        # By the laws as they are: loose forms would explain the same.
        return larger.gain - smaller.gain > KNOWN_GAIN * larger.reduced_chi2
    threshold = threshold * larger.reduced_chi2
    left = smaller.fit.chi2 - smaller.fit.expected
    if forward.mode == "swing":
        # A baseline that is out of step makes any share of the gain a small one.
        return more > max(threshold, 0.5 * left) and _beyond_losses(forward, larger, smaller)
    further = [m for m in larger.members if m.id not in smaller.ids] or larger.members[-1:]
    # A law that does not stay leaves nothing over: other laws in its place have chance to beat.
    stays = replace(smaller, members=tuple(m for m in smaller.members if m.id in larger.ids))
    # The evidence has weighed errors of form already: a share of the gain is held against what the
    # laws as they are written gain by the further one.
    gained = max(more, larger.gain - smaller.gain)
    if more > threshold and all(_beyond_form(forward, stays, m, gained) for m in further):
        return True
    # Against a baseline that runs away any share is small; then what is left over counts.
    return left > 0.5 * smaller.fit.expected and more > max(threshold, 0.5 * left)


def _beyond_form(forward: Forward, seed: Hypothesis, further: Candidate, gained: float) -> bool:
    """Whether a further law gains more than an imperfect law of the seed leaves over for it.

    A share of what the seed gains is more than that where errors of its form hardly do what the
    further law does: a turned camera gains a thousand times what friction on the axis gains.
    """
    if gained > second_effect_share(seed, further.effect) * seed.gain:
        return True
    laws = [member.effect for member in seed.members]
    return gained > left_by_forms(forward, seed.fit, laws, further)


def _best_allowed(forward: Forward, hypotheses: Sequence[Hypothesis]) -> Hypothesis | None:
    allowed = [h for h in hypotheses if h.allowed]
    best = max(allowed, key=lambda h: h.penalised_gain, default=None)
    if best is not None and not best.has_unnamed and best.reduced_chi2 >= POOR_FIT:
        # Where no law fits to the noise, the least penalised of those that fit alike goes first.
        alike = [h for h in allowed if not h.has_unnamed and len(h.ids) == len(best.ids)]
        best = min(
            (h for h in alike if h is best or not is_distinct(best, h)),
            key=lambda h: h.prior_penalty + sum(member.complexity_penalty for member in h.members),
        )
    if best is None or not best.has_unnamed:
        return best
    # What has a name and fits as well goes first; the rest stays in its group.
    known = [h for h in allowed if not h.has_unnamed and len(h.members) <= len(best.members)]
    second = max(known, key=lambda h: h.penalised_gain, default=None)
    if second is None:
        return best
    near = second.penalised_gain >= best.penalised_gain - group_tolerance(best)
    if near or not is_distinct(best, second) or not _beyond_losses(forward, best, second):
        return second
    return best


def _beyond_losses(forward: Forward, larger: Hypothesis, named: Hypothesis) -> bool:
    """Whether laws of a free swing that are no losses say more than uneven losses leave over.

    Friction that drifts a little while a swing dies away passes for a torque at any angle that the
    swing goes through less often.
    """
    if forward.mode != "swing":
        return True
    further = [
        member
        for member in as_fitted(larger.members, larger.fit)[0]
        if member.id not in named.ids and member.effect.coordinate is not Coordinate.RATE
    ]
    if not further:
        return True
    laws = [member.effect for member in named.members]
    more = larger.penalised_gain - named.penalised_gain
    uneven = evidence_of_uneven_losses(forward, named.fit, laws)
    return more > uneven + group_tolerance(larger) and all(
        more > left_by_uneven_losses(forward, named.fit, laws, member) for member in further
    )


def _sorted(hypotheses: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    return tuple(sorted(hypotheses, key=lambda h: -h.penalised_gain))


def _grow(
    forward: Forward,
    base: Fit,
    effects: Sequence[Effect],
    tried: Sequence[Hypothesis],
    size: int,
    threshold: float,
    first: Scan,
) -> list[Hypothesis]:
    """Sets one larger than the best ones so far."""
    # A law without a name is for what nothing else explains, never for the rest of it; but every
    # free swing has losses, whatever else moves it, and a size that the setup states wrongly is
    # none that was left out.
    swinging = forward.mode == "swing"
    seeds = [
        h for h in _sorted(tried)
        if len(h.members) == size - 1 and h.allowed and (swinging or not h.has_unnamed)
    ]  # fmt: skip
    if not seeds:
        return []
    top = seeds[0].penalised_gain
    least = min(SEED_SHARE * top, top - group_tolerance(seeds[0]))
    foremost = _best_allowed(forward, [h for h in tried if len(h.members) == size - 1])
    grown: dict[frozenset[Effect], Hypothesis] = {}
    for number, seed in enumerate(_one_per_id(seeds, 9 if size == 2 else 3)):
        if seed.penalised_gain < least:
            continue
        more = _with_clocks(forward, seed.fit, effects)
        beside = _corrects(base, seed) or (swinging and number == 0 and not seed.has_unnamed)
        pool = candidates_for(forward, seed.fit.model, more, unnamed=beside)
        keys = {member.key for member in seed.members}
        ids = {member.id for member in seed.members} - {"unnamed"}
        pool = tuple(c for c in pool if c.key not in keys and c.id not in ids)
        laws = [member.effect for member in seed.members]
        scored = scan_beyond_forms(forward, seed.fit, laws, seed.form.size, pool)
        ranked = _best_by_law(scored, forward.mode == "swing")
        strained = number == 0 and seed.form.gain > threshold
        if strained and not _worth_a_fit(forward, seed, pool, ranked, threshold):
            # What errors of form take up at that size may as well be a law of its own: both are
            # fitted, and their evidence decides.
            scored = scan(forward, seed.fit, pool)
            ranked = _best_by_law(scored, forward.mode == "swing")
        known = _known_that_show(forward, seed, pool)
        if known:
            ranked = [*known, *ranked]
        elif forward.mode != "swing":
            ranked = [one for one in ranked if not is_known(pool[one[1]].effect)]
        # Far off the noise the linear score means little for a swing.
        is_worth_it = bool(known) or (swinging and (size == 2 or seed.reduced_chi2 >= POOR_FIT))
        if not is_worth_it and not _worth_a_fit(forward, seed, pool, ranked, threshold):
            idle = number == 0 and seed is foremost and ranked and ranked[0][0] < threshold
            if idle and not strained:
                # The best smaller set leaves nothing to explain: a larger one would be idle, but
                # where two laws without it promise as much.
                for members, strengths in _two_instead(first, seed) if size == 2 else ():
                    law = frozenset(member.key for member in members)
                    grown[law] = fit_hypothesis(forward, base, members, strengths)
                break
            continue
        share = -np.inf if forward.mode == "swing" else 0.6
        first_of_each, others = _by_law(ranked, pool)
        # Far off the noise the linear score distinguishes the forms of a law less surely.
        near = SECOND_FORM_REACH
        if seed.reduced_chi2 >= POOR_FIT:
            near = max(near, FORM_SHARE * ranked[0][0])
        alike = [item for item in others if item[0] > ranked[0][0] - near]
        for item in [*_shortlist(first_of_each, 6, share), *alike[:3]]:
            law = frozenset(keys | {pool[item[1]].key})
            if law in grown:
                continue
            rival = _ahead([*tried, *grown.values()])
            grown[law] = _from_each_start(forward, base, scored, item, seed, rival=rival)
    return list(grown.values())


def _two_instead(first: Scan, best: Hypothesis) -> list[tuple[list[Candidate], list[FloatArray]]]:
    """Pairs of other names, with strengths, that together promise what the best has alone.

    One law may do by chance what two did. Scored to first order around the baseline.
    """
    leading = [
        (gain, at) for gain, at, _ in _by_law(_best_by_law(first), first.candidates)[0]
        if first.candidates[at].id != EffectId.UNNAMED
    ]  # fmt: skip
    own = max((gain for gain, at in leading if first.candidates[at].id in best.ids), default=np.inf)
    others = [at for _, at in leading if first.candidates[at].id not in best.ids][:MAX_SINGLES]
    found = []
    for pair in combinations(others, 2):
        gain, values = first.gain(*pair)
        members = [first.candidates[at] for at in pair]
        gain -= MEMBER_PENALTY + sum(member.complexity_penalty for member in members)
        if gain > own - group_tolerance(best):
            found.append((gain, members, np.split(values, [len(first.columns[pair[0]])])))
    found.sort(key=lambda one: -one[0])
    return [(members, strengths) for _, members, strengths in found[:MAX_INSTEAD]]


def _worth_a_fit(
    forward: Forward,
    seed: Hypothesis,
    pool: Sequence[Candidate],
    ranked: Ranked,
    threshold: float,
) -> bool:
    """Whether a further law promises more than chance, and more than an imperfect law leaves."""
    return any(
        gain >= threshold and _beyond_form(forward, seed, pool[index], gain)
        for gain, index, _ in ranked
    )


def _corrects(base: Fit, seed: Hypothesis) -> bool:
    """Whether an answer only gives laws of the baseline another size than the setup states."""
    return set(seed.ids) <= _stated(base)


def _stated(base: Fit) -> frozenset[str]:
    """Ids of what the baseline holds at a stated size, and does not leave open."""
    left_open = {base.model.entries[item.entry][0].id for item in base.free}
    return STATED.intersection(base.model.ids) - left_open


def _corrected(
    forward: Forward,
    base: Fit,
    effects: Sequence[Effect],
    tried: Sequence[Hypothesis],
    threshold: float,
) -> list[Hypothesis]:
    """Laws in no catalogue, each beside another size of what the setup states.

    What a setup states wrongly is no law that was left out; held where it is wrong, it has to be
    paid for by names.
    """
    stated = [effect for effect in effects if effect.id in _stated(base)]
    done = {frozenset(member.key for member in h.members) for h in tried}
    alone = [h for h in _sorted(tried) if len(h.members) == 1 and h.allowed]
    if forward.mode == "swing" or not stated or not alone:
        return []
    found = []
    for seed in [h for h in alone if h.has_unnamed][:MAX_CORRECTED]:
        if seed.penalised_gain < SEED_SHARE * alone[0].penalised_gain:
            continue
        pool = candidates_for(forward, seed.fit.model, stated, unnamed=False)
        scored = scan(forward, seed.fit, pool)
        ranked = _best_by_law(scored)[:1]
        for item in ranked:
            new = frozenset({seed.members[0].key, pool[item[1]].key}) not in done
            if new and _worth_a_fit(forward, seed, pool, ranked, threshold):
                rival = _ahead(tried)
                found.append(_from_each_start(forward, base, scored, item, seed, rival=rival))
    return found


def _without_each(forward: Forward, base: Fit, found: Hypothesis) -> list[Hypothesis]:
    """The set without each of its laws in turn, fitted on from where the larger one ended.

    A law of several strengths or shapes may have ended elsewhere when it was fitted alone; what
    seems to need a fellow then only needed another start.
    """
    members, strengths = as_fitted(found.members, found.fit)
    smaller = []
    for place in range(len(members)):
        kept = [k for k in range(len(members)) if k != place]
        smaller.append(
            fit_hypothesis(
                forward, base, [members[k] for k in kept], [strengths[k] for k in kept],
                start=found.fit,
            )
        )  # fmt: skip
    return smaller


def _in_place_of_each(
    forward: Forward,
    base: Fit,
    effects: Sequence[Effect],
    best: Hypothesis,
    tried: Sequence[Hypothesis],
) -> list[Hypothesis]:
    """The set with each law in turn replaced by others that promise as much beside its fellows.

    Sets grow by the best form of each law; another form may be indistinguishable from the answer,
    and a law that was never fitted is not excluded.
    """
    if forward.mode == "swing" or len(best.members) < 2:
        return []
    done = {frozenset(member.key for member in h.members) for h in tried}
    found: list[Hypothesis] = []
    for left_out, rest in zip(best.members, _without_each(forward, base, best), strict=True):
        pool = tuple(
            one
            for one in candidates_for(forward, rest.fit.model, effects, unnamed=False)
            if one.id not in rest.ids and not is_known(one.effect)
        )
        laws = [member.effect for member in rest.members]
        scored = scan_beyond_forms(forward, rest.fit, laws, rest.form.size, pool)
        ranked = _best_by_law(scored)
        own = max((gain for gain, at, _ in ranked if pool[at].id == left_out.id), default=np.inf)
        least = own - max(LAW_REACH, FORM_SHARE * abs(own))
        keys = frozenset(member.key for member in rest.members)
        new = [
            item for item in ranked for one in (pool[item[1]],)
            if item[0] > least and one.id not in best.ids and keys | {one.key} not in done
        ]  # fmt: skip
        found += [_from_each_start(forward, base, scored, item, rest) for item in new[:MAX_INSTEAD]]
    return found


def _in_best_forms(
    forward: Forward,
    base: Fit,
    effects: Sequence[Effect],
    larger: Hypothesis,
    best: Hypothesis,
    tried: list[Hypothesis],
) -> tuple[Hypothesis, Hypothesis]:
    """A set in the forms that fit best together, and the best smaller one in those forms.

    What is fitted in between joins those `tried`.
    """
    others = _in_other_forms(forward, base, effects, larger)
    tried.extend(others)
    found = _best_allowed(forward, [larger, *others]) or larger
    if forward.mode == "swing" or (found is larger and len(found.members) < MAX_EFFECTS):
        return found, best
    # A law may have been taken in for what another form of its fellow says, or for what a fellow
    # explains that came after it: sets grow one by one, and not every pair was fitted in between.
    smaller = _without_each(forward, base, found)
    tried.extend(smaller)
    return found, _best_allowed(forward, [best, *smaller]) or best


def _in_other_forms(
    forward: Forward, base: Fit, effects: Sequence[Effect], found: Hypothesis
) -> list[Hypothesis]:
    """The set with each law in turn in its other forms of no more strengths.

    The form that was chosen alone also took up what its fellow explains.
    """
    simpler = []
    for place, member in enumerate(found.members):
        held = _held_values(found.fit, member.effect)
        for effect in effects:
            names = [p.name for p in effect.strengths]
            other = effect.id == member.id and effect.form != member.effect.form
            if not other or effect.shapes or not set(names) <= held.keys():
                continue
            pool = candidates_for(forward, base.model, [effect], unnamed=False)
            law = next((one for one in pool if one.effect.level is effect.level), None)
            if law is None:
                continue
            members = [law if k == place else one for k, one in enumerate(found.members)]
            strengths = [
                np.array([(held | _held_values(found.fit, one.effect))[p.name]
                          for p in one.effect.strengths])
                for one in members
            ]  # fmt: skip
            simpler.append(fit_hypothesis(forward, base, members, strengths, start=found.fit))
    return simpler


def _held_values(fit: Fit, effect: Effect) -> dict[str, float]:
    return next(
        ({k: float(v) for k, v in values.items()} for one, values in fit.model.entries
         if one is effect), {},
    )  # fmt: skip


def _known_that_show(
    forward: Forward, seed: Hypothesis, pool: Sequence[Candidate]
) -> list[tuple[float, int, FloatArray]]:
    """Effects of known size that would be seen: (penalised, place in the pool, strengths).

    What nature is known to do goes before what a law's form may be wrong by, which in one throw
    could say the same.
    """
    places = [place for place, one in enumerate(pool) if is_known(one.effect)]
    if not places:
        return []
    scored = scan(forward, seed.fit, [pool[place] for place in places])
    return [
        (penalised, places[index], values)
        for penalised, index, values in _best_by_law(scored)
        if _shows(scored, index, seed.reduced_chi2)
    ]


def _shows(scored: Scan, index: int, reduced_chi2: float) -> bool:
    """Whether an effect of known size would be seen at all, and in the right direction."""
    effect = scored.candidates[index].effect
    if not is_known(effect):
        return False
    gain = 0.0
    for column, p in zip(scored.columns[index], effect.strengths, strict=True):
        size = float(p.expected or 0.0) - scored.start[column]
        gain += size * (2.0 * scored.score[column] - size * scored.information[column, column])
    return bool(gain > KNOWN_GAIN * reduced_chi2)


def _one_per_id(seeds: Sequence[Hypothesis], most: int) -> list[Hypothesis]:
    chosen: dict[tuple[str, ...], Hypothesis] = {}
    for seed in seeds:
        chosen.setdefault(seed.ids, seed)
    return list(chosen.values())[:most]


def _ahead(tried: Sequence[Hypothesis]) -> float:
    """Objective of the best fit so far."""
    return min((h.fit.objective for h in tried if h.allowed), default=np.inf)


@dataclass(frozen=True)
class _Hat(Effect):
    """A force (or torque) of hat shape in time (or angle), one of a row."""

    id: str = "hat"
    statement: str = ""
    law: str = ""
    source: str = ""
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = (Parameter("strength", "N", 0.01, -1e9, 1e9),)
    form: str = "horizontal"
    middle: float = 0.0
    width: float = 1.0

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Hat in time."""
        shape = np.maximum(0.0, 1.0 - np.abs(flight.time - self.middle) / self.width)
        size = values["strength"] * shape + 0.0 * np.asarray(flight.x)
        nothing = np.zeros_like(size)
        return (size, nothing, nothing) if self.form == "horizontal" else (nothing, size, nothing)


@dataclass(frozen=True)
class _AngleHat(_Hat):
    """A torque of hat shape in the pendulum's angle."""

    phase: Phase = "swing"
    parameters: tuple[Parameter, ...] = (Parameter("strength", "N m", 0.02, -1e9, 1e9),)
    form: str = "angle"

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Hat in the angle."""
        shape = np.maximum(0.0, 1.0 - np.abs(swing.phi - self.middle) / self.width)
        return values["strength"] * shape


@dataclass(frozen=True)
class LatentForce:
    """A force over time, or a torque over angle, with its band.

    Attributes
    ----------
    channel : str
        horizontal, vertical or angle.
    place : (n,) array
        s after release, or rad.
    value, std : (n,) array
        N, or N m.
    """

    channel: str
    place: FloatArray
    value: FloatArray
    std: FloatArray


def missing_force(forward: Forward, base: Fit, hats: int = 12) -> tuple[LatentForce, ...]:
    """Posterior of the missing force in flight and of the missing torque in the swing.

    Parameters
    ----------
    forward, base
        The predictor and the refitted baseline.
    hats : int
        How many hats span the flight (or the angles swung through).

    Returns
    -------
    tuple of LatentForce
        One for each direction that was recorded.
    """
    found = []
    if forward.mode != "swing":
        end = float(np.median(forward.flight_time))
        middles = np.linspace(0.0, end, hats)
        both = [
            replace(_Hat(), form=direction, middle=float(m), width=end / (hats - 1))
            for direction in ("horizontal", "vertical")
            for m in middles
        ]
        found += _posterior(forward, base, both, middles, ("horizontal", "vertical"))
    if forward.records.pendulum_used.any() and forward.mode != "flight":
        angles = forward.records.pendulum_angle[forward.records.pendulum_used]
        middles = np.linspace(float(angles.min()), float(angles.max()), hats)
        width = float(middles[1] - middles[0])
        row = [replace(_AngleHat(), middle=float(m), width=width) for m in middles]
        found += _posterior(forward, base, row, middles, ("angle",))
    return tuple(found)


def _posterior(
    forward: Forward,
    base: Fit,
    hats: list[_Hat] | list[_AngleHat],
    middles: FloatArray,
    channels: tuple[str, ...],
) -> list[LatentForce]:
    scored = scan(forward, base, [Candidate(hat) for hat in hats])
    n = middles.size
    # Second differences are penalised; the weight is the one of highest evidence.
    second = np.diff(np.eye(n), n=2, axis=0)
    rough = np.kron(np.eye(len(channels)), second.T @ second)
    ridge = 1e-6 * np.eye(rough.shape[0])
    scale = float(np.median(np.diag(scored.information)))
    best, chosen = -np.inf, (np.zeros(rough.shape[0]), np.eye(rough.shape[0]))
    for weight in scale * np.logspace(-4, 6, 21):
        prior = weight * (rough + ridge)
        posterior = scored.information + prior
        mean = np.linalg.solve(posterior, scored.score)
        evidence = 0.5 * float(scored.score @ mean)
        evidence += 0.5 * float(np.linalg.slogdet(prior)[1] - np.linalg.slogdet(posterior)[1])
        if evidence > best:
            best, chosen = evidence, (mean, np.linalg.inv(posterior))
    mean, covariance = chosen
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return [
        LatentForce(name, middles, mean[k * n : (k + 1) * n], std[k * n : (k + 1) * n])
        for k, name in enumerate(channels)
    ]
