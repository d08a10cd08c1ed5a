"""List the effects that may be missing, and validate effects that a user wrote.

A candidate is an admissible effect at one start value of its shapes.
"""

import itertools
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from metrology import UsageError
from mismatch.forward import Forward, ForwardModel
from mismatch.search.unnamed import Bump, Magnet, ReadingCurve, smooth_fields, unnamed_laws
from physics.effects import (
    CATALOGUE,
    Coordinate,
    Effect,
    EffectId,
    Extent,
    Form,
    Level,
    Parameter,
    Size,
)
from physics.effects.flight import Buoyancy

__all__ = [
    "Candidate",
    "candidates_for",
    "refuse_unusable",
    "start_values",
    "steps_of",
    "within_patience",
]

BETWEEN_POWERS = frozenset({Form.UNDER_LOAD, Form.STRIBECK, Form.TWO_THIRDS, Form.THREE_HALVES})
"""Forms that in free swings equal sums of the zeroth, first and second power of the rate, which
have names of their own there."""

AT_TURNS = frozenset({Form.GIVING, Form.FALLING, Form.GIVING_FALLING})
"""Forms that differ from others of their law where the motion turns back, as free swings do."""

MAX_SHAPES = 200

"""Start values of the shapes of one effect: each costs a trajectory of every trial."""

SPATIAL = 3
"""Coordinates of places in space."""

MIN_GROUPS = 2

"""Balls, or trials, from which a scatter among them can be determined."""

BEFORE_CONTACT = -0.22

"""s; how long before the touch a recording of a strike may have lost frames."""

UNCATALOGUED = 6.0

"""Chi-square units for odds of one to twenty: most of what labs leave out has a name."""

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
    """

    effect: Effect
    shape: tuple[tuple[str, float], ...] = ()

    @property
    def id(self) -> str:
        """Id of the effect."""
        return self.effect.id

    @property
    def place(self) -> tuple[int, ...]:
        """Place of its shape in the grids of start values."""
        grids = [p.grid for p in self.effect.shapes]
        return tuple(grid.index(v) for grid, (_, v) in zip(grids, self.shape, strict=True))

    @property
    def key(self) -> Effect:
        """What distinguishes one law from another: everything but where its parameters may lie."""
        return replace(self.effect, parameters=())

    @property
    def complexity_penalty(self) -> float:
        """What the law's freedom costs: places tried for each shape, strengths beyond one.

        A law in no catalogue also pays for being rare.
        """
        strengths = max(sum(not p.is_held for p in self.effect.strengths), 1)
        search = sum(max(1.5, 2.0 * np.log(len(p.grid)) - 1.5) for p in self.effect.shapes)
        if self.effect.level is not Level.CAMPAIGN:
            # What own values cost stands in the evidence; each scatter was chosen among many.
            strengths += strengths
        search += getattr(self.effect, "search_cost", 0.0)
        return float(2.0 * (strengths - 1) + search + self.rarity)

    @property
    def rarity(self) -> float:
        """What it pays for being rare, whatever the data (chi-square units)."""
        return UNCATALOGUED if self.id == EffectId.UNNAMED else 0.0


def start_values(candidate: Candidate, model: ForwardModel) -> dict[str, float]:
    """Parameter values that leave the model as it is: what it holds already, else neutral."""
    held = {
        name: v
        for e, values in model.entries
        if e.id == candidate.id != EffectId.UNNAMED
        for name, v in values.items()
    }
    values = candidate.effect.neutral | dict(candidate.shape)
    return values | {k: float(v) for k, v in held.items() if k in values}


def _adapted(effect: Effect, forward: Forward) -> Effect:
    """Effect whose grids, scales and bounds fit this campaign, as it declares."""
    return replace(effect, parameters=tuple(_fitted(p, forward) for p in effect.parameters))


def _fitted(p: Parameter, forward: Forward) -> Parameter:
    begin, size = _extent(p.over, forward)
    factor = _factor(p.in_units_of, forward)
    if p.over is not Extent.FIXED:
        grid = tuple(begin + share * size for share in p.grid)
        # A length or a duration is bounded in shares of its size, a place or an instant is not.
        lower = p.lower * size if p.lower > 0.0 else p.lower
        p = replace(p, grid=grid, scale=p.scale * size, lower=lower)
    return replace(
        p, scale=p.scale * factor, lower=p.lower * factor, upper=p.upper * factor,
        width=p.width * _factor(p.width_in, forward),
    )  # fmt: skip


def _extent(over: Extent, forward: Forward) -> tuple[float, float]:
    """Where an extent begins in a campaign, and its size."""
    if over is Extent.RECORD_TIME:
        begin = BEFORE_CONTACT if forward.mode == "impact" else 0.0
        return begin, float(forward.flight_time.max()) - begin
    if over is Extent.FLIGHT_TIME:
        return 0.0, float(np.median(forward.flight_time))
    middle, _, half = forward.centre
    if over is Extent.WAY:
        return middle - half, 2.0 * half
    if over is Extent.HEIGHT:
        low, high = forward.flight_span(Coordinate.HEIGHT)
        return low, max(high - low, 1e-3)
    return 0.0, 2.0 * half if over is Extent.LENGTH_OF_WAY else 1.0


def _factor(size: Size, forward: Forward) -> float:
    baseline, body = forward.baseline, forward.baseline.pendulum
    if size is Size.BALL_WEIGHT:
        return float(np.median(forward.records.mass)) * baseline.gravity
    if size is Size.SPIN:
        fast = max(forward.flight_span(Coordinate.SPEED)[1], 1e-3)
        return fast / (0.5 * float(np.median(forward.records.diameter)))
    if body is None or size is Size.ONE:
        return 1.0
    if size is Size.BOARD:
        return baseline.air_density * body.length**5
    return body.mass * baseline.gravity * body.com / PAPER_TORQUE


def _admissible(effect: Effect, forward: Forward, model: ForwardModel) -> bool:
    hooks = effect.hooks
    if any(need not in model.ids for need in effect.requires):
        return False
    if "drag" in effect.requires and model.value("drag", "drag_coefficient", 0.0) <= 0.0:
        return False
    axes = int(forward.records.ball_used.any(axis=(0, 1)).sum())
    if axes < effect.axes and forward.mode != "swing":
        return False
    if effect.planar and axes == SPATIAL:
        return False
    if isinstance(effect, Buoyancy) and float(forward.displaced.max(initial=0.0)) >= 1.0:
        # A body that falls though it is lighter than the air of its volume is no solid ball.
        return False
    if isinstance(effect, Magnet | Bump) and not forward.records.ball_used[..., 0].any():
        return False
    if forward.mode == "swing":
        if effect.form in BETWEEN_POWERS:
            return False
        # A record has a period of its own, which is all that its clock changes.
        return "torque" in hooks or isinstance(effect, ReadingCurve)
    if effect.form in AT_TURNS:
        return False
    if forward.mode == "flight":
        return bool(hooks & {"force", "clock", "image"})
    return True


def candidates_for(
    forward: Forward, model: ForwardModel, effects: Iterable[Effect], *, unnamed: bool = True
) -> tuple[Candidate, ...]:
    """Every admissible effect at every start value of its shape, the model's own included."""
    # One throw repeats nothing: any smooth remainder would pass for a law of its own.
    tried = unnamed and (forward.mode != "flight" or forward.records.trials > 1)
    laws: Sequence[Effect] = (*unnamed_laws(forward.mode), *smooth_fields(forward)) if tried else ()
    found = []
    for effect in (*effects, *laws):
        if not _admissible(effect, forward, model):
            continue
        fitted = _adapted(effect, forward)
        found += _at_every_shape(fitted, forward)
    return tuple(found)


def _at_every_shape(fitted: Effect, forward: Forward) -> list[Candidate]:
    """Candidates of an effect at all start values of its shapes, at every level it may live at."""
    found: list[Candidate] = []
    for level in _levels(fitted, forward):
        at = fitted if level is fitted.level else replace(fitted, level=level)
        shapes = at.shapes
        combinations = list(itertools.product(*(p.grid for p in shapes)))
        if len(combinations) > MAX_SHAPES:
            raise UsageError(
                f"the effect {at.id!r} asks for {len(combinations)} combinations of"
                f" {', '.join(p.name for p in shapes)}; at most {MAX_SHAPES} are tried",
                hint="Give the grids of its shapes fewer values.",
            )
        for combination in combinations:
            shape = tuple((p.name, v) for p, v in zip(shapes, combination, strict=True))
            found.append(Candidate(at, shape))
    return found


def _levels(effect: Effect, forward: Forward) -> list[Level]:
    """Levels at which a campaign determines an effect's strengths.

    A strike repeats what it gives the ball, and free swings of one session are of one apparatus:
    only throws differ from trial to trial.
    """
    count = {
        Level.CAMPAIGN: MIN_GROUPS,
        Level.SESSION: len(forward.records.session_names),
        Level.BALL: len(set(forward.records.ball_index)) if forward.mode != "swing" else 0,
        Level.TRIAL: forward.records.trials if forward.mode == "flight" else 0,
    }
    return [level for level in effect.levels if count[level] >= MIN_GROUPS]


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


Result = TypeVar("Result")

PATIENCE = 60.0

"""s that one effect may take for a single prediction of a campaign, which takes about one."""


def refuse_unusable(effect: Effect) -> None:
    """Refuse an effect that can't be fitted, whatever the campaign.

    Raises
    ------
    UsageError
        If it acts nowhere, leaves nothing open, takes a name that is taken, or its parameters
        contradict themselves.
    """
    if not effect.hooks:
        _refuse(effect, "overrides no hook, so it changes nothing", "Write one of its hooks: "
                + ", ".join(Effect.HOOKS) + ".")  # fmt: skip
    if not effect.strengths:
        _refuse(effect, "leaves no strength open, so there is nothing to fit",
                "Give it a Parameter without a grid.")  # fmt: skip
    taken = [known for known in CATALOGUE.get(effect.id, ()) if known.form == effect.form]
    if taken or effect.id == EffectId.UNNAMED:
        _refuse(effect, "takes an id that the catalogue has",
                "Give it an id of its own, or, as another form of that law, a `form`.")  # fmt: skip
    try:
        hash(effect)
    except TypeError as problem:
        _refuse(effect, f"holds a field that may change ({problem})",
                "Use tuples and numbers, not lists, arrays or dicts.")  # fmt: skip
    names = [p.name for p in effect.parameters]
    if len(set(names)) < len(names):
        _refuse(effect, "has two parameters of one name", "Name each differently.")
    for p in effect.parameters:
        _refuse_parameter(effect, p)


def _refuse_parameter(effect: Effect, p: Parameter) -> None:
    numbers = (p.scale, p.lower, p.upper, p.neutral, *p.grid)
    if not all(np.isfinite(numbers)):
        _refuse(effect, f"has a parameter {p.name!r} with a number that is none", "Mend it.")
    if p.scale <= 0.0 or p.lower >= p.upper:
        _refuse(effect, f"has a parameter {p.name!r} whose scale or bounds leave no room",
                "Its scale is positive, and its lower bound below the upper one.")  # fmt: skip
    if not p.is_shape and not p.lower <= p.neutral <= p.upper:
        _refuse(effect, f"has a parameter {p.name!r} whose neutral value is out of its bounds",
                "Choose bounds that hold it: there the effect does nothing.")  # fmt: skip


def _refuse(effect: Effect, why: str, help_: str) -> None:
    raise UsageError(f"the effect {effect.id!r} {why}", hint=help_)


def within_patience(
    effect: Effect, work: Callable[[], Result], seconds: float = PATIENCE
) -> Result:
    """Result of work with an effect that may never end.

    Raises
    ------
    UsageError
        If it takes longer than `seconds`; the work is left to itself.
    """
    found: list[Result] = []
    raised: list[Exception | SystemExit] = []

    def run() -> None:
        try:
            found.append(work())
        except (Exception, SystemExit) as problem:  # handed on to who asked
            raised.append(problem)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(seconds)
    if raised:
        raise raised[0]
    if not found:
        _refuse(effect, f"has not answered within {seconds:.0f} s",
                "Its hooks must end: is there a loop without end?")  # fmt: skip
    return found[0]
