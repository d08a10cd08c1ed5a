"""The improved model as a setup file that `simulate`, `plan` and `measure` take."""

from collections.abc import Mapping
from pathlib import Path

from mismatch import Explained
from mismatch.table.explain import TableExplained
from physics.effects import CATALOGUE, Effect

__all__ = ["improved_setup"]

SIMULATED = frozenset({"flight", "contact", "swing"})


def improved_setup(setup: Path, explained: Explained | TableExplained) -> str:
    """Text of the setup file with the named effects in its [model].

    Everything else stays as it was written. Faults of the instrument are no part of a model of the
    motion, and a setup file holds every effect in its usual form only: others are noted in a
    comment.
    """
    kept, inside = [], False
    for line in setup.read_text(encoding="utf-8").splitlines():
        stripped = line.strip()
        if stripped.startswith("["):
            inside = stripped.startswith("[model")
        if not inside:
            kept.append(line)
    lines = [*_without_trailing_blank(kept), "", "[model]"]
    entries = _entries(explained)
    held = [(e, v) for e, v in entries if _simulated(e)]
    names = ", ".join(f'"{name}"' for name in ("gravity", *(e.id for e, _ in held)))
    lines.append(f"effects = [{names}]")
    for effect, values in held:
        lines += ["", f"[model.{effect.id}]"]
        lines += [f"{name} = {float(value):.8g}" for name, value in values.items()]
    for effect, values in entries:
        if not _simulated(effect):
            numbers = ", ".join(f"{name} = {float(v):.6g}" for name, v in values.items())
            form = f" ({effect.form.replace('_', ' ')})" if effect.form else ""
            lines += ["", f"# {effect.id}{form}: {effect.statement} {numbers}"]
    return "\n".join(lines) + "\n"


def _entries(
    explained: Explained | TableExplained,
) -> tuple[tuple[Effect, Mapping[str, float]], ...]:
    if isinstance(explained, TableExplained):
        return (explained.model if explained.best is None else explained.best.model).entries
    best = explained.naming.best
    return (explained.prepared.model if best is None else best.fit.model).entries


def _simulated(effect: Effect) -> bool:
    """Whether `simulate` can hold the effect: physics in the form that a setup file means."""
    forms = CATALOGUE.get(effect.id, ())
    usual = bool(forms) and forms[0].form == effect.form
    return effect.phase in SIMULATED and usual


def _without_trailing_blank(lines: list[str]) -> list[str]:
    while lines and not lines[-1].strip():
        lines = lines[:-1]
    return lines
