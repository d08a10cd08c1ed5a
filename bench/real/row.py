"""Row of the table of real recordings."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bench.concealed.answer import Answer

__all__ = ["Explain", "Row", "words"]

Explain = Callable[[Path, Path], Answer]
"""Runs the engine on a folder and writes its JSON to a file."""


@dataclass(frozen=True)
class Row:
    """Question, required result, goal and measured result."""

    asked: str
    at_least: str
    aim: str
    measured: str


def words(answer: Answer) -> str:
    """Short description of an answer."""
    if answer.failure:
        return f"failed ({answer.failure[:80]})"
    groups = "; ".join("{" + ", ".join(sorted(group)) + "}" for group in answer.groups)
    return f"{answer.verdict}: {', '.join(sorted(answer.ids)) or 'nothing named'} {groups}".strip()
