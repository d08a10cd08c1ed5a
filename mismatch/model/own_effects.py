"""What a user's own effect must be before it takes part: told in plain words where it is not."""

import threading
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from metrology import UsageError
from physics.effects import CATALOGUE, Effect, Parameter

__all__ = ["PATIENCE", "refuse_unusable", "within_patience"]

Result = TypeVar("Result")

PATIENCE = 60.0
"""s that one effect may take for a single look at a campaign, which takes about one."""

UNCATALOGUED_ID = "unnamed"


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
    if taken or effect.id == UNCATALOGUED_ID:
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
                "At the neutral value the effect does nothing.")  # fmt: skip


def _refuse(effect: Effect, why: str, help_: str) -> None:
    raise UsageError(f"the effect {effect.id!r} {why}", hint=help_)


def within_patience(
    effect: Effect, look: Callable[[], Result], seconds: float = PATIENCE
) -> Result:
    """Result of a look at an effect that may never end.

    Raises
    ------
    UsageError
        If it takes longer than `seconds`; the look is left to itself.
    """
    found: list[Result] = []
    raised: list[Exception] = []

    def run() -> None:
        try:
            found.append(look())
        except Exception as problem:  # handed on to who asked
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
