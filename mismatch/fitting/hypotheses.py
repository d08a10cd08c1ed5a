"""Fitted answers to "what was left out", and how they are weighed against each other.

What errors of forms explain: evidence with every weight integrated over.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mismatch.fitting.fit import Ending, Fit
from mismatch.fitting.levels import fit_with_levels, price_of_levels, with_own_strengths
from mismatch.fitting.normal_equations import free_parameters
from mismatch.fitting.scan import Scan, price, scan
from mismatch.model.candidates import Candidate, start_values
from mismatch.model.form_error import form_errors
from mismatch.model.forward import Forward, Model
from physics.domain import FloatArray
from physics.effects import CATALOGUE, Effect, EffectId, Form

__all__ = [
    "EXPECTED",
    "LOOSE_LAWS",
    "POOR_FIT",
    "Hypothesis",
    "fit_hypothesis",
    "form_evidence",
    "group_tolerance",
    "is_known",
    "least_gain",
    "null_threshold",
    "scan_beyond_forms",
    "second_effect_share",
    "told_apart",
]

SIZES = (0.0, 0.25, 0.5, 1.0, 2.0)

"""Errors of a form in units of what is usual for the law; each as likely as the others."""


@dataclass(frozen=True)
class FormEvidence:
    """What a set of laws gains when their forms need not be quite right.

    Attributes
    ----------
    gain : float
        Twice the logarithm of the evidence over that of exact forms (chi-square units).
    absorbed : float
        Chi-square that the errors take up at their likeliest size.
    size : float
        That size, in units of what is usual for the laws.
    """

    gain: float = 0.0
    absorbed: float = 0.0
    size: float = 0.0


EXACT = FormEvidence()

"""Of laws whose forms are held to be exact."""


def loose_candidates(
    forward: Forward, fit: Fit, laws: Sequence[Effect]
) -> tuple[tuple[Candidate, ...], FloatArray]:
    """Errors of the forms of laws that a fit holds, and the usual size of each, (n,)."""
    found: list[Candidate] = []
    sizes: list[float] = []
    for effect, values in fit.model.entries:
        if any(effect is one for one in laws):
            errors = form_errors(forward, effect, values)
            found += [Candidate(error, (), 1) for error in errors]
            sizes += [effect.looseness] * len(errors)
    return tuple(found), np.array(sizes)


def form_evidence(forward: Forward, fit: Fit, laws: Sequence[Effect]) -> FormEvidence:
    """Evidence of a fit with the forms of `laws` loose, over that with exact forms.

    Around the fit the records are linear in the weights, and everything else that was fitted is
    marginalised; a Gaussian prior on the weights makes the integral exact.
    """
    errors, usual = loose_candidates(forward, fit, laws)
    if not errors:
        return EXACT
    scored = scan(forward, fit, errors)
    matrix = scored.information * usual[:, None] * usual
    vector = scored.score * usual
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    values, along = np.maximum(values, 0.0), np.square(vectors.T @ vector)
    gains, taken = [], []
    for size in SIZES:
        shrunk = size**2 / (1.0 + size**2 * values)
        gains.append(float(np.sum(along * shrunk - np.log1p(size**2 * values))))
        taken.append(float(np.sum(along * shrunk * (2.0 - values * shrunk))))
    top = max(gains)
    mean = top + 2.0 * float(np.log(np.mean(np.exp(0.5 * (np.array(gains) - top)))))
    best = int(np.argmax(gains))
    # Whatever the forms are off by, the exact ones stay among what is averaged.
    return FormEvidence(max(mean, -2.0 * float(np.log(len(SIZES)))), taken[best], SIZES[best])


def scan_beyond_forms(
    forward: Forward, fit: Fit, laws: Sequence[Effect], size: float, pool: Sequence[Candidate]
) -> Scan:
    """Score candidates by what they explain beyond errors of the forms of `laws`.

    Parameters
    ----------
    size : float
        Of the errors, in units of what is usual for the laws.
    """
    errors, usual = loose_candidates(forward, fit, laws)
    if not errors or size == 0.0:
        return scan(forward, fit, pool)
    both = scan(forward, fit, (*pool, *errors))
    first = both.score.size - len(errors)
    inner = both.information[first:, first:] + np.diag(1.0 / np.square(size * usual))
    cross = both.information[first:, :first]
    middle = np.linalg.solve(inner, cross)
    return replace(
        both,
        candidates=tuple(pool),
        columns=both.columns[: len(pool)],
        information=both.information[:first, :first] - cross.T @ middle,
        score=both.score[:first] - middle.T @ both.score[first:],
        start=both.start[:first],
        scattered=both.scattered[: len(pool)],
    )


MEMBER_PENALTY = 9.0

"""Chi-square that each further effect must pay, ln n for a few thousand rows (BIC)."""

DRAWS = 4000
"""Draws: an evidence is then good to about 2 % of itself."""

FALSE_ALARMS = 0.01

"""Share of blameless campaigns in which chance may exceed the threshold, for whole catalogues."""

CERTAIN_GAIN = 6.6

"""What the penalised gain of one effect with a sign exceeds by chance in half a per cent."""

EXPECTED = 6.0
"""Chi-square units, odds of one to twenty, against an answer that does without what nature always
has: what a law in no catalogue pays for being rare."""

POOR_FIT = 1.5

"""Chi-square per entry from which what is left over is a fault of the law, not noise."""

FAR_WORSE = 4.0

"""Misfit over that of the best answer, both beyond the noise, from which an answer is out."""

LOOSE_LAWS = frozenset(
    {
        "drag_crisis", "lens_distortion", "dropped_frames", "support_friction", "support_recoil",
        "effective_mass", "camera_roll", "rolling_shutter", "oblique_impact",
        "contact_displacement",
    }
)  # fmt: skip

"""Ids whose law differs from one apparatus to the next, so that a fit leaves a part of it over."""


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects, fitted.

    Attributes
    ----------
    members : tuple of Candidate
        What is said to be missing.
    fit : Fit
        The model with them in it.
    gain : float
        Objective of the refitted baseline minus that of this fit (chi-square units).
    form : FormEvidence
        What it gains once the forms of its laws need not be quite right.
    lacking : tuple of str
        What nature always has, and neither the baseline nor the answer holds.
    """

    members: tuple[Candidate, ...]
    fit: Fit
    gain: float
    form: FormEvidence = EXACT
    lacking: tuple[str, ...] = ()

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids, in order."""
        return tuple(member.id for member in self.members)

    @property
    def penalised_gain(self) -> float:
        """Gain less what freedom, size of the set and unlikely strengths cost."""
        penalties = sum(member.complexity_penalty for member in self.members) + EXPECTED * len(
            self.lacking
        )
        further = sum(not is_known(member.effect) for member in self.members) - 1
        gain = self.gain + self.form.gain
        return (
            gain
            - penalties
            - MEMBER_PENALTY * max(further, 0)
            - self.reduced_chi2 * self.prior_penalty
        )

    @property
    def prior_penalty(self) -> float:
        """What the fitted strengths cost by their priors (chi-square units at no misfit)."""
        added = [member.effect for member in self.members]
        values = {
            id(item.parameter): (item.parameter, self.fit.value(index)[0])
            for index, item in enumerate(self.fit.free)
            if any(self.fit.model.entries[item.entry][0] is effect for effect in added)
        }
        # What has an expected value is held to it by the fit itself.
        strengths = [v for v in values.values() if not v[0].is_shape and v[0].expected is None]
        return sum(p.prior_penalty(value) for p, value in strengths)

    @property
    def reduced_chi2(self) -> float:
        """Chi-square that even loose forms leave over what noise leaves, at least one."""
        return max(1.0, (self.fit.chi2 - self.form.absorbed) / max(self.fit.expected, 1.0))

    @property
    def allowed(self) -> bool:
        """Whether all parameters are within what nature allows and practice knows."""
        found = self.fit.believable and self.fit.ending is not Ending.LOST
        return found and self.fit.model.scatters_within_reason

    @property
    def quality(self) -> float:
        """Penalised gain by the data alone, unlikely strengths not counted against it."""
        return self.penalised_gain + self.reduced_chi2 * self.prior_penalty

    @property
    def has_unnamed(self) -> bool:
        """Whether a force in no catalogue is part of it."""
        return EffectId.UNNAMED in self.ids


def is_known(effect: Effect) -> bool:
    """Whether nature is known to give the effect its size, so that it has no freedom."""
    return bool(effect.strengths) and all(p.is_known for p in effect.strengths)


def told_apart(best: Hypothesis, other: Hypothesis) -> bool:
    """Whether two answers differ by more than the misfit that both share.

    Where no law fits to the noise, chi-square says nothing; the difference has to be steady over
    pieces of the record (Vuong, Econometrica 57, 307 (1989)).
    """
    if best.reduced_chi2 < POOR_FIT:
        return True
    pieces = max(1, -(-24 // best.fit.residual.shape[0]))
    mine, theirs = (
        np.concatenate(
            [part.sum(axis=1) for part in np.array_split(h.fit.residual**2, pieces, axis=1)]
        )
        for h in (best, other)
    )
    kept = mine != theirs
    if int(kept.sum()) < 4:
        return False
    if other.fit.chi2 > FAR_WORSE * best.fit.chi2:
        return True
    # Where a law goes wrong ever faster one piece outweighs all others; ratios don't mind.
    ratios = np.log((theirs[kept] + 1.0) / (mine[kept] + 1.0))
    return _steadily_above(theirs[kept] - mine[kept]) or _steadily_above(ratios)


def _steadily_above(differences: FloatArray) -> bool:
    spread = float(np.std(differences, ddof=1)) * np.sqrt(differences.size)
    return bool(differences.sum() > 2.0 * spread)


def fit_hypothesis(
    forward: Forward,
    base: Fit,
    members: Sequence[Candidate],
    strengths: Sequence[FloatArray],
    start: Fit | None = None,
    rounds: int = 10,
) -> Hypothesis:
    """Fit the baseline with candidates in it.

    Parameters
    ----------
    base : Fit
        The refitted baseline, which the gain is counted from.
    members : candidates
        What to add.
    strengths : one array per member
        Start values of its strengths.
    start : Fit, optional
        Where trial-to-trial values start from; the baseline's by default.
    rounds : int
        Most Gauss–Newton steps.
    """
    model: Model = base.model
    for member, values in zip(members, strengths, strict=True):
        start_at = start_values(member, base.model)
        for p, value in zip(member.effect.strengths, values, strict=True):
            known = value if p.expected is None or p.is_held else p.expected
            start_at[p.name] = float(np.clip(known, p.lower, p.upper))
        model = model.having(member.effect, start_at)
    model = model.order()
    added: list[Effect] = [member.effect for member in members]
    origin = base if start is None else start
    point = (origin.nuisance, origin.law_offsets)
    model = with_own_strengths(model, added, origin.model)
    free = free_parameters(model, added)
    fit = fit_with_levels(forward, model, free, point, rounds=rounds)
    # In free swings the catalogue's laws are each other's errors of form: zeroth, first and second
    # power of the rate. Loose ones would pass for any sum of them.
    form = EXACT if forward.mode == "swing" else form_evidence(forward, fit, added)
    gain = base.objective - fit.objective - _price_of_weights(fit) - price_of_levels(forward, fit)
    return Hypothesis(tuple(members), fit, gain, form, _lacking(forward, model))


def _lacking(forward: Forward, model: Model) -> tuple[str, ...]:
    if forward.mode == "swing":
        return ()
    certain = (one.id for forms in CATALOGUE.values() for one in forms if one.certain)
    return tuple(one for one in certain if one not in model.ids)


def _price_of_weights(fit: Fit) -> float:
    """What the evidence asks for weights that a prior holds: ln det of prior over posterior."""
    held = [k for k, item in enumerate(fit.free) if item.parameter.is_held]
    if not held:
        return 0.0
    part = fit.covariance[np.ix_(held, held)]
    widths = np.array([fit.free[k].parameter.width for k in held])
    sign, size = np.linalg.slogdet(part / np.outer(widths, widths))
    return float(max(-size, 0.0)) if sign > 0 else np.inf


def null_threshold(scan: Scan, false_alarms: float = FALSE_ALARMS, seed: int = 20240229) -> float:
    """Penalised gain that chance alone exceeds in a share of blameless campaigns.

    A parametric bootstrap: without a mismatch the score of all candidates is Gaussian with the
    information as its covariance, so drawing scores stands for drawing campaigns.
    """
    size = scan.score.size
    if size == 0:
        return 12.0
    values, vectors = np.linalg.eigh(scan.information / _outer(scan.information))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    scale = np.sqrt(np.diag(scan.information))
    draws = (np.random.default_rng(seed).standard_normal((DRAWS, size)) @ root.T) * scale
    penalised = np.full(DRAWS, -np.inf)
    for index, candidate in enumerate(scan.candidates):
        which = np.array(scan.columns[index])
        block = scan.information[np.ix_(which, which)]
        held = scan.prior[which]
        inverse = np.linalg.pinv(block + np.diag(held), rcond=1e-9, hermitian=True)
        part = draws[:, which]
        gain = np.einsum("di,ij,dj->d", part, inverse, part) - price(block, held)
        one_sided = [p.lower == p.neutral for p in candidate.effect.strengths]
        if len(which) == 1 and one_sided[0] and scan.start[which[0]] == 0.0:
            gain = np.where(part[:, 0] > 0.0, gain, -np.inf)
        penalised = np.maximum(penalised, gain - candidate.complexity_penalty)
    tail = float(np.quantile(penalised, 1.0 - false_alarms))
    return max(tail, 9.0)


def least_gain(best: Hypothesis, base: Fit, threshold: float) -> float:
    """Penalised gain from which an answer is more than chance.

    What nature always has, and the model has not, was expected: no search of a catalogue has to be
    paid for before it is believed.
    """
    expected = all(m.effect.certain and m.id not in base.model.ids for m in best.members)
    return (min(threshold, CERTAIN_GAIN) if expected else threshold) * best.reduced_chi2


def _outer(matrix: FloatArray) -> FloatArray:
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.asarray(scale[:, None] * scale[None, :])


def group_tolerance(best: Hypothesis) -> float:
    """By how much another answer's penalised gain may be less, and it still be not told apart.

    Seven chi-square units are odds of thirty to one, times the misfit that is left; in strong
    cases one and a half per cent of the gain, since no law is known better than that, but no more
    than a part of what is left over.
    """
    count = best.fit.count
    odds = 7.0 * best.reduced_chi2
    left = max(best.fit.chi2 - best.fit.expected, 0.0) + np.sqrt(2.0 * count)
    return float(max(odds, min(0.015 * best.gain, 0.25 * left)))


PLACES = frozenset({"contact_displacement", "origin_offset", "length_scale", "parallax"})

"""Ids that shift where a flight starts, as an imperfect law of contact or camera also does."""


def second_effect_share(hypothesis: Hypothesis, further: str | None = None) -> float:
    """Share of the gain that a further effect must add before it is more than an imperfect law."""
    # A camera turned about all its axes is every way in which a camera can be turned.
    loose = any(
        member.id in LOOSE_LAWS and member.effect.form != Form.PERSPECTIVE
        for member in hypothesis.members
    )
    if further in PLACES and loose:
        return 0.2
    if hypothesis.has_unnamed:
        return 0.03
    return 0.04 if loose else 0.008


def with_gain(hypothesis: Hypothesis, base_objective: float) -> Hypothesis:
    """The hypothesis with its gain counted from another baseline."""
    return replace(hypothesis, gain=base_objective - hypothesis.fit.objective)
