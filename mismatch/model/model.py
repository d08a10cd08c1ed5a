"""A model as the engine bends it: effects with a column of parameter values per lane."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from physics.arrays import FloatArray
from physics.effects import Effect

__all__ = ["Model", "Term", "lane_terms"]


@dataclass(frozen=True)
class Model:
    """Effects and the values of their parameters; gravity, swing and contact are always there.

    Attributes
    ----------
    entries : tuple of (Effect, mapping)
        What the model holds.
    """

    entries: tuple[tuple[Effect, Mapping[str, float]], ...] = ()

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of the effects, in order."""
        return tuple(effect.id for effect, _ in self.entries)

    def value(self, effect_id: str, name: str, default: float) -> float:
        """Value of one parameter, or the default where the model lacks the effect."""
        for effect, values in self.entries:
            if effect.id == effect_id:
                return float(values[name])
        return default

    def having(self, effect: Effect, values: Mapping[str, float]) -> "Model":
        """Model with the effect in it; one with the same id is replaced, unless it is unnamed."""
        kept = tuple(
            entry for entry in self.entries if entry[0].id != effect.id or effect.id == "unnamed"
        )
        return replace(self, entries=(*kept, (effect, dict(values))))

    def order(self) -> "Model":
        """The same model with drag and spin first, since others build on them."""
        first = [e for e in self.entries if e[0].id in ("drag", "magnus")]
        rest = [e for e in self.entries if e[0].id not in ("drag", "magnus")]
        return replace(self, entries=(*first, *rest))


@dataclass(frozen=True)
class Term:
    """An effect at work in some lanes.

    Attributes
    ----------
    effect : Effect
        What acts.
    lanes : slice
        In which lanes.
    values : mapping
        Parameter → (k, 1) array over those lanes.
    """

    effect: Effect
    lanes: slice
    values: Mapping[str, FloatArray]


def lane_terms(models: Iterable[Model]) -> tuple[Term, ...]:
    """Terms for one model per lane, runs of lanes with the same effect gathered.

    An effect takes part in a lane only if that lane's model holds it, so a lane pays for its own
    effects alone. Effects are told apart as objects: two of one class and form may differ in any
    field of their own (the hats of a smooth force, laws that a user wrote).
    """
    runs: dict[tuple[int, int], list[list[tuple[int, Mapping[str, float]]]]] = {}
    effects: dict[tuple[int, int], Effect] = {}
    for lane, model in enumerate(models):
        seen: dict[int, int] = {}
        for effect, values in model.entries:
            copy = seen.get(id(effect), 0)
            seen[id(effect)] = copy + 1
            key = (id(effect), copy)
            effects[key] = effect
            here = runs.setdefault(key, [])
            if here and here[-1][-1][0] == lane - 1:
                here[-1].append((lane, values))
            else:
                here.append([(lane, values)])
    return tuple(
        Term(
            effects[key],
            slice(run[0][0], run[-1][0] + 1),
            {name: np.array([values[name] for _, values in run])[:, None] for name in run[0][1]},
        )
        for key, parts in runs.items()
        for run in parts
    )
