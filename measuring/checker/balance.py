"""Decide which stated input contradicts the others, and what would resolve it.

Everything known is an equation between logarithms: the scale of the ball's plane, the capture rate,
and the inputs. Each input has a prior: what was stated, with its uncertainty. An input is at fault
if everything else agrees once its statement is left out; its estimate is then the cure.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

__all__ = ["Cause", "Contradictory", "Input", "Relation", "weigh"]

FloatArray = NDArray[np.float64]

_MAX_CONSISTENT_PROBABILITY = 1e-3
"""Probability of so large a χ² by chance, below which inputs contradict each other (chosen: one
correct set of inputs in a thousand)."""

_MIN_RESOLVED_PROBABILITY = 0.01
"""The same, above which the remaining equations agree (chosen)."""

_MAX_WORSE_CHI2 = 9.0
"""χ² above the best cause at which another one is excluded (convention: three standard
deviations)."""


@dataclass(frozen=True)
class Input:
    """A stated or assumed value.

    Attributes
    ----------
    value : float
        Positive, in any unit.
    relative_std : float
        With bounds: of usual values, applied only where nothing else determines the input.
    stated : bool
        Whether a person stated it; others are never at fault.
    bounds : tuple of float or None
        Smallest and largest possible value.
    """

    key: str
    value: float
    relative_std: float
    stated: bool = True
    bounds: tuple[float, float] | None = None


@dataclass(frozen=True)
class Relation:
    """The sum of powers of the unknowns equals a value: Σ power · log(unknown) = log(value).

    Attributes
    ----------
    powers : mapping of str to float
        By input, or "scale" (m/px in the ball's plane) and "rate".
    """

    name: str
    powers: Mapping[str, float]
    value: float
    relative_std: float


@dataclass(frozen=True)
class Cause:
    """An input whose statement does not fit the others.

    Attributes
    ----------
    stated, value : float
        As stated, and as all others have it.
    std : float
        Standard uncertainty of `value`.
    chi2_before, chi2 : float
        Of all equations with its statement and without.
    """

    key: str
    stated: float
    value: float
    std: float
    chi2_before: float
    chi2: float


@dataclass(frozen=True)
class Contradictory:
    """A contradiction.

    Attributes
    ----------
    causes : tuple of Cause
        Inputs that resolve it one at a time, the best first; empty if none does.
    """

    causes: tuple[Cause, ...]
    chi2: float
    degrees: int


def weigh(inputs: Sequence[Input], relations: Sequence[Relation]) -> Contradictory | None:
    """Test whether all inputs fit each other.

    Returns
    -------
    Contradictory or None
        None if they fit, or too little is known to tell.
    """
    whole = _fit(inputs, relations, None)
    if whole is None or _probability(whole[1], whole[2]) > _MAX_CONSISTENT_PROBABILITY:
        return None
    causes = []
    for one in inputs:
        found = _fit(inputs, relations, one.key) if one.stated else None
        if found is None or one.key not in found[0]:
            continue
        (log, std), chi2, degrees = found[0][one.key], found[1], found[2]
        if _probability(chi2, max(degrees, 1)) > _MIN_RESOLVED_PROBABILITY:
            value = float(np.exp(log))
            causes.append(Cause(one.key, one.value, value, value * std, whole[1], chi2))
    causes.sort(key=lambda cause: cause.chi2)
    kept = tuple(one for one in causes if one.chi2 < causes[0].chi2 + _MAX_WORSE_CHI2)
    return Contradictory(kept, whole[1], whole[2])


def _probability(chi2: float, degrees: int) -> float:
    return float(scipy.special.chdtrc(degrees, chi2)) if degrees > 0 else 1.0


_Fitted = tuple[dict[str, tuple[float, float]], float, int]


def _fit(
    inputs: Sequence[Input], relations: Sequence[Relation], free: str | None
) -> _Fitted | None:
    """Logarithms of the determined unknowns with their std, χ², and degrees of freedom."""
    kept = [one for one in inputs if one.key != free]
    within = [replace(one, relative_std=math.inf) if one.bounds else one for one in kept]
    solved = _solved(within, inputs, relations)
    if solved is None:
        return None
    if any(one.bounds is not None and one.key not in solved[0] for one in kept):
        return _solved(kept, inputs, relations)
    beyond = [
        replace(
            one, value=min(max(value, one.bounds[0]), one.bounds[1]), relative_std=_AT_BOUND_STD
        )
        for one in kept
        if one.bounds is not None and one.key in solved[0]
        for value in [float(np.exp(solved[0][one.key][0]))]
        if not one.bounds[0] <= value <= one.bounds[1]
    ]
    if not beyond:
        return solved
    outer = {one.key: one for one in beyond}
    again = _solved([outer.get(one.key, one) for one in within], inputs, relations)
    # a bound is no measurement: it adds no degree of freedom
    return None if again is None else (again[0], again[1], again[2] - len(beyond))


_AT_BOUND_STD = 0.01
"""Relative std of a value held at its bound (chosen: small beside the relations')."""


def _solved(
    kept: Sequence[Input], inputs: Sequence[Input], relations: Sequence[Relation]
) -> _Fitted | None:
    """Least squares of the relations and the statements of `kept`."""
    keys = [one.key for one in inputs]
    names = list(dict.fromkeys([*keys, *(n for relation in relations for n in relation.powers)]))
    rows, values = [], []
    for one in kept:
        if math.isfinite(one.relative_std):
            rows.append([(name == one.key) / one.relative_std for name in names])
            values.append(np.log(one.value) / one.relative_std)
    for relation in relations:
        rows.append([relation.powers.get(name, 0.0) / relation.relative_std for name in names])
        values.append(np.log(relation.value) / relation.relative_std)
    design, right = np.array(rows), np.array(values)
    if design.size == 0:
        return None
    left, singular, turned = np.linalg.svd(design, full_matrices=True)
    rank = int(np.sum(singular > 1e-9 * singular[0]))
    inverse = turned[:rank].T / singular[:rank]
    found = inverse @ (left[:, :rank].T @ right)
    chi2 = float(np.sum((right - design @ found) ** 2))
    covariance = inverse @ inverse.T
    # directions that no equation fixes
    open_names = np.abs(turned[rank:]).max(axis=0, initial=0.0) > 1e-9
    determined = {
        name: (float(found[k]), float(np.sqrt(covariance[k, k])))
        for k, name in enumerate(names)
        if not open_names[k]
    }
    return determined, chi2, len(right) - rank
