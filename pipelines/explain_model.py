"""The improved model as a setup file that `simulate`, `plan` and `measure` take."""

from pathlib import Path

from mismatch import Explained

__all__ = ["improved_setup"]

SIMULATED = frozenset({"flight", "contact", "swing"})


def improved_setup(setup: Path, explained: Explained) -> str:
    """Text of the setup file with the named effects in its [model].

    Everything else stays as it was written. Faults of the instrument are no part of a model of the
    motion; they are noted in a comment.
    """
    kept, inside = [], False
    for line in setup.read_text(encoding="utf-8").splitlines():
        stripped = line.strip()
        if stripped.startswith("["):
            inside = stripped.startswith("[model")
        if not inside:
            kept.append(line)
    lines = [*_without_trailing_blank(kept), "", "[model]"]
    best = explained.naming.best
    entries = (explained.prepared.model if best is None else best.fit.model).entries
    held = [(e, v) for e, v in entries if e.phase in SIMULATED and e.id != "unnamed"]
    names = ", ".join(f'"{name}"' for name in ("gravity", *(e.id for e, _ in held)))
    lines.append(f"effects = [{names}]")
    for effect, values in held:
        lines += ["", f"[model.{effect.id}]"]
        lines += [f"{name} = {float(value):.8g}" for name, value in values.items()]
    for effect, values in entries:
        if effect.phase not in SIMULATED or effect.id == "unnamed":
            numbers = ", ".join(f"{name} = {float(v):.6g}" for name, v in values.items())
            lines += ["", f"# {effect.id}: {effect.statement} {numbers}"]
    return "\n".join(lines) + "\n"


def _without_trailing_blank(lines: list[str]) -> list[str]:
    while lines and not lines[-1].strip():
        lines = lines[:-1]
    return lines
