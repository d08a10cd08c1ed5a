"""What the errors of forms are worth: evidence with every weight integrated over."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mismatch.fitting.fit import Fit
from mismatch.fitting.scan import Scan, scan
from mismatch.model.candidates import Candidate
from mismatch.model.form_error import form_errors
from mismatch.model.forward import Forward
from physics.arrays import FloatArray
from physics.effects import Effect

__all__ = ["EXACT", "FormEvidence", "form_evidence", "loose_candidates", "scan_beyond_forms"]

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
    )
