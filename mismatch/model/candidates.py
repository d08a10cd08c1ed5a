"""What could be missing: every admissible effect at every start value of its shape."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mismatch.model.forward import Forward
from mismatch.model.model import Model
from mismatch.search.unnamed import Bump, Magnet, unnamed_laws
from physics.effects import Effect, Parameter

__all__ = ["Candidate", "candidates_for", "start_values", "steps_of"]

MOST_SHAPES = 64

UNCATALOGUED = 6.0
"""Chi-square units for odds of one to twenty: most of what labs leave out has a name."""

TORQUES = frozenset({"N m", "N m s", "N m s^2"})

PAPER_TORQUE = 26.8
"""N m, m g d of the paper's pendulum, which the catalogue's scales of torques are made for."""


@dataclass(frozen=True)
class Candidate:
    """An effect with its shape set, its strengths still neutral.

    Attributes
    ----------
    effect : Effect
        What may be missing.
    shape : tuple of (name, value)
        Values of its shapes.
    tries : int
        How many shapes of this effect are tried in all.
    """

    effect: Effect
    shape: tuple[tuple[str, float], ...]
    tries: int

    @property
    def id(self) -> str:
        """Id of the effect."""
        return self.effect.id

    @property
    def key(self) -> Effect:
        """What tells one law from another: everything but where its parameters may lie."""
        return replace(self.effect, parameters=())

    @property
    def fine(self) -> float:
        """What the law's freedom costs: places looked at for each shape, strengths beyond one.

        A law in no catalogue also pays for being rare.
        """
        strengths = len(self.effect.strengths)
        looks = sum(max(1.5, 2.0 * np.log(len(p.grid)) - 1.5) for p in self.effect.shapes)
        rare = UNCATALOGUED if self.id == "unnamed" else 0.0
        return float(2.0 * (strengths - 1) + looks + rare + getattr(self.effect, "looks", 0.0))


def start_values(candidate: Candidate, model: Model) -> dict[str, float]:
    """Parameter values that leave the model as it is: what it holds already, else neutral."""
    held = {
        name: v
        for e, values in model.entries
        if e.id == candidate.id != "unnamed"
        for name, v in values.items()
    }
    values = candidate.effect.neutral | dict(candidate.shape)
    return values | {k: float(v) for k, v in held.items() if k in values}


def _adapted(effect: Effect, forward: Forward) -> Effect:
    """Effect whose grids of places and times fit this campaign."""
    return replace(effect, parameters=tuple(_adapted_grid(p, forward) for p in effect.parameters))


def _spread_grid(low: float, high: float, count: int) -> tuple[float, ...]:
    return tuple(float(v) for v in np.linspace(low, high, count))


def _adapted_grid(p: Parameter, forward: Forward) -> Parameter:
    records = forward.records
    span = float(np.median(forward.flight_time))
    x0, _, half = forward.centre
    if p.name == "instant":
        first, last = -0.22, float(forward.flight_time.max())
        if forward.mode != "impact":
            first = 0.0
        grid = _spread_grid(first, last, 36)
        return replace(p, grid=grid, scale=(last - first) / 36)
    if p.name == "middle":
        grid = _spread_grid(0.06 * span, 1.1 * span, 11)
        return replace(p, grid=grid, scale=0.1 * span)
    if p.name == "duration":
        return replace(p, grid=(0.12 * span, 0.3 * span), scale=0.1 * span, lower=0.02 * span)
    if p.name in ("place_x", "place") and p.unit == "m":
        return replace(p, grid=_spread_grid(x0 - 0.9 * half, x0 + 0.9 * half, 8), scale=0.12 * half)
    if p.name == "place_y":
        used = records.ball_used[..., 1]
        ys = records.position[..., 1][used]
        low, high = (float(ys.min()), float(ys.max())) if ys.size else (0.0, 1.0)
        return replace(
            p, grid=_spread_grid(low - 0.1 * half, high + 0.1 * half, 4), scale=0.1 * half
        )
    if p.name == "reach" and p.unit == "m":
        return replace(p, grid=(0.07 * half, 0.2 * half), scale=0.07 * half, lower=0.01 * half)
    if p.unit in TORQUES and forward.baseline.pendulum is not None:
        body = forward.baseline.pendulum
        size = body.mass * forward.baseline.gravity * body.com / PAPER_TORQUE
        width = p.width
        if p.name == "drag_torque":
            # A board half as wide as the pendulum is long, and a drag coefficient near one.
            width = 0.1 * forward.baseline.air_density * body.length**5
        return replace(
            p, scale=p.scale * size, lower=p.lower * size, upper=p.upper * size, width=width
        )
    if p.name == "strength" and p.unit == "N":
        weight = float(np.median(records.mass)) * forward.baseline.gravity
        return replace(p, scale=0.02 * weight, lower=-300.0 * weight, upper=300.0 * weight)
    return p


def _admissible(effect: Effect, forward: Forward, model: Model) -> bool:
    hooks = effect.hooks
    if any(need not in model.ids for need in effect.requires):
        return False
    if "drag" in effect.requires and model.value("drag", "drag_coefficient", 0.0) <= 0.0:
        return False
    axes = int(forward.records.ball_used.any(axis=(0, 1)).sum())
    if axes < effect.axes and forward.mode != "swing":
        return False
    if isinstance(effect, Magnet | Bump) and not forward.records.ball_used[..., 0].any():
        return False
    if forward.mode == "swing":
        return "torque" in hooks or effect.id == "time_base"
    if forward.mode == "flight":
        return bool(hooks & {"force", "clock", "image"})
    return True


def candidates_for(
    forward: Forward, model: Model, effects: Iterable[Effect], *, unnamed: bool = True
) -> tuple[Candidate, ...]:
    """Every admissible effect at every start value of its shape, the model's own included."""
    # One throw repeats nothing: any smooth remainder would pass for a law of its own.
    tried = unnamed and (forward.mode != "flight" or forward.records.trials > 1)
    laws: Sequence[Effect] = unnamed_laws(forward.mode) if tried else ()
    found = []
    for effect in (*effects, *laws):
        if not _admissible(effect, forward, model):
            continue
        fitted = _adapted(effect, forward)
        shapes = fitted.shapes
        combinations = list(itertools.product(*(p.grid for p in shapes)))[:MOST_SHAPES]
        for combination in combinations:
            shape = tuple((p.name, v) for p, v in zip(shapes, combination, strict=True))
            found.append(Candidate(fitted, shape, len(combinations)))
    return tuple(found)


def steps_of(
    candidate: Candidate, values: dict[str, float]
) -> list[tuple[Parameter, float, dict[str, float]]]:
    """One small step of each strength, inwards where a bound is near."""
    moves = []
    for p in candidate.effect.strengths:
        step = 1e-3 * p.scale
        if values[p.name] + step > p.upper:
            step = -step
        moves.append((p, step, values | {p.name: values[p.name] + step}))
    return moves
