"""What can be missing where only a few numbers per trial are known, and how large it may be."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mismatch.model.candidates import Candidate, start_values
from mismatch.model.model import Model
from mismatch.table.model import TableForward
from physics.arrays import Vector
from physics.effects import Contact, Effect, Outcome, Parameter, Values, View
from physics.effects.impact import VelocityDependentCor, change_restitution
from physics.effects.measurement import OriginOffset

__all__ = ["Strength", "strengths_of", "table_candidates"]

UNREMARKABLE = 3.0
"""Prior width over the catalogue's `scale`: a campaign is explained because something is odd."""

SPHERE_DRAG_STD = 0.15
"""Spread of drag coefficients of balls below the drag crisis, where the model holds drag."""

POSITIONS_NEEDED = frozenset({"lens_distortion", "rolling_shutter", "dropped_frames"})
"""Faults that show in the course of a flight and in no single number of it."""

FORMS_LEFT_OUT = frozenset({"about a point", "three axes", "ball only"})

LEAST_TRACE = 1e-4
"""m or m/s below which a candidate at its scale leaves no trace."""


@dataclass(frozen=True)
class CorFallingFromRest(VelocityDependentCor):
    """A restitution that is right for gentle impacts and falls, or rises, with speed."""

    law: str = r"e(v) = e_0 + s\,v"
    form: str = "from rest"

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """More or less restitution, in proportion to impact speed."""
        return change_restitution(contact, outcome, values["slope"] * contact.impact_speed)


@dataclass(frozen=True)
class OriginAlongTheWall(OriginOffset):
    """An origin that is off along the wall; a range knows nothing of heights."""

    def image(self, values: Values, view: View) -> Vector:
        """Displace along the wall."""
        return view.x + values["offset_x"], view.y, view.z


@dataclass(frozen=True)
class Strength:
    """One free number of a candidate.

    Attributes
    ----------
    parameter : Parameter
    start : float
        Value at which the model stays as it is.
    width : float
        Standard deviation of its Gaussian prior about `start`.
    sign : int
        1 or −1 where nature allows one side of `start` only, else 0.
    """

    parameter: Parameter
    start: float
    width: float
    sign: int


def strengths_of(candidate: Candidate, model: Model) -> tuple[Strength, ...]:
    """A candidate's free numbers with their priors."""
    start = start_values(candidate, model)
    found = []
    for p in candidate.effect.strengths:
        here = start[p.name]
        width = UNREMARKABLE * p.scale
        if candidate.id == "drag":
            width = SPHERE_DRAG_STD if here > 0.0 else p.scale
        sign = 1 if here <= p.lower else -1 if here >= p.upper else 0
        found.append(Strength(p, here, width, sign))
    return tuple(found)


def table_candidates(
    forward: TableForward, model: Model, effects: Iterable[Effect]
) -> tuple[Candidate, ...]:
    """Every effect that leaves a trace in this table, at every start value of its shapes."""
    found = []
    for effect in (*effects, CorFallingFromRest()):
        if effect.id in POSITIONS_NEEDED or effect.form in FORMS_LEFT_OUT:
            continue
        if effect.phase == "swing" and not np.isfinite(forward.table.backswing).any():
            continue
        if any(need not in model.ids for need in effect.requires):
            continue
        if effect.id == "origin_offset":
            effect = _along_the_wall(effect)
        combinations = list(itertools.product(*(p.grid for p in effect.shapes)))
        names = [p.name for p in effect.shapes]
        for values in combinations:
            shape = tuple(zip(names, values, strict=True))
            found.append(Candidate(effect, shape, len(combinations)))
    return _with_a_trace(forward, model, found)


def _along_the_wall(effect: Effect) -> Effect:
    along = tuple(p for p in effect.parameters if p.name == "offset_x")
    return OriginAlongTheWall(**{**vars(effect), "parameters": along})


def _with_a_trace(
    forward: TableForward, model: Model, candidates: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    moved = []
    for candidate in candidates:
        values = start_values(candidate, model)
        for one in strengths_of(candidate, model):
            values[one.parameter.name] = one.start + (one.sign or 1) * one.parameter.scale
        moved.append(model.having(candidate.effect, values).order())
    nothing = np.zeros((len(moved) + 1, forward.table.trials, 4))
    predicted = forward.predict([model, *moved], nothing)
    used = np.isfinite(forward.table.values)
    change = np.where(used, np.abs(predicted[1:] - predicted[0]), 0.0)
    trace = np.nanmax(change.reshape(len(moved), -1), axis=1)
    return tuple(c for c, t in zip(candidates, trace, strict=True) if t > LEAST_TRACE)
