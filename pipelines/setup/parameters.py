"""Parameters of effects as people type them: in ``[model.drag]`` and in ``--effect drag:…``."""

import difflib
from collections.abc import Iterable
from typing import Any

from metrology import Given, Measurand, SetupError, UsageError, read_given
from physics.effects import CATALOGUE, Parameter

__all__ = ["nearest", "read_parameter"]


def read_parameter(effect: str, key: str, typed: Any) -> Given:
    """A parameter of an effect of the catalogue, with or without its unit and uncertainty.

    Parameters
    ----------
    effect, key : str
        Id of the effect and name of its parameter.
    typed : Any
        A number or a text.

    Raises
    ------
    SetupError
        If the effect has no such parameter, or nature does not allow the value.
    """
    known: dict[str, Parameter] = {p.name: p for e in CATALOGUE[effect] for p in e.parameters}
    if key not in known:
        raise SetupError(f"there is no key 'model.{effect}.{key}'{nearest(key, known)}")
    p = known[key]
    what = Measurand(
        p.meaning or p.name, p.unit, p.lower, p.upper, f"nature allows {p.lower:g} to {p.upper:g}",
        f"{p.expected if p.expected is not None else p.scale:g} {p.unit if p.unit != '1' else ''}",
    )  # fmt: skip
    try:
        return read_given(typed, what)
    except UsageError as problem:
        raise SetupError(
            f"[model.{effect}] {key}: {problem.message}", hint=problem.hint
        ) from problem


def nearest(name: str, known: Iterable[str]) -> str:
    """Say which of the known names is the nearest, as the end of a message."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.0)
    return f"; the nearest is '{near[0]}'" if near else ""
