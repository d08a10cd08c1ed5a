"""Recordings already in the engine's format, and simulated ones."""

import json
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

from bench.real import made
from bench.real.row import Explain, Row, words

__all__ = ["heights_rows", "made_rows", "plain_rows"]

Write = Callable[[Path], None]


def _measured(folder: Path, explain: Explain) -> str:
    output = folder / "answer.json"
    answer = explain(folder, output)
    sure = ", ".join(f"{n.id} {n.probability or 0.0:.2f}" for n in answer.named)
    text = f"{words(answer)} [{sure or 'no name'}]"
    raw = json.loads(output.read_text(encoding="utf-8"))
    held = raw.get("held_out") or {}
    for unit, small in (("rad", "mrad"), ("m", "mm")):
        if f"rmse_before_{unit}" in held:
            before, after = held[f"rmse_before_{unit}"], held[f"rmse_after_{unit}"]
            text += f"; held out {1e3 * before:.3g} → {1e3 * after:.3g} {small}"
    return text


def plain_rows(
    source: Path, cache: Path, explain: Explain, *, asked: str, at_least: str, aim: str
) -> list[Row]:
    """One row of a set whose files the engine reads directly."""
    folder = cache / source.name
    folder.mkdir(parents=True, exist_ok=True)
    for path in source.iterdir():
        if path.suffix in (".csv", ".toml"):
            shutil.copyfile(path, folder / path.name)
    return [Row(f"{source.name}: {asked}", at_least, aim, _measured(folder, explain))]


def heights_rows(source: Path, cache: Path, explain: Explain) -> list[Row]:
    """One row for each ball whose drop and rebound heights are a table of strikes."""
    found = []
    for path in sorted(source.glob("t_*.csv")):
        folder = cache / f"{source.name}_{path.stem}"
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, folder / "ball.csv")
        shutil.copyfile(source / "setup.toml", folder / "setup.toml")
        asked = f"{source.name}, {path.stem.removeprefix('t_')}: levels differ, no support"
        found.append(Row(asked, "no second name", "unexplained", _measured(folder, explain)))
    return found


MADE_SETS: tuple[tuple[str, str, str, Write], ...] = (
    ("swings on a cart, 200 Hz: dry and quadratic", "3 mrad", "2.1 mrad",
     partial(made.write_swings, made.CART)),
    ("the same at 25 Hz", "3 mrad", "2.1 mrad",
     partial(made.write_swings, made.CART, rate=25.0)),
    ("a weight on a string, zero offset: linear and quadratic", "1.7 mrad", "1.2 mrad",
     partial(made.write_swings, made.STRING)),
    ("a rolling ball: nothing in the catalogue", "unexplained", "unexplained",
     made.write_rolling),
    ("flights in 3-D, each with its own spin: drag and spin", "6 mm", "3.3 mm",
     made.write_flights),
)  # fmt: skip


def made_rows(cache: Path, explain: Explain) -> list[Row]:
    """One row for each simulated recording."""
    found = []
    for place, (asked, at_least, aim, write) in enumerate(MADE_SETS):
        folder = cache / f"made_{place}"
        write(folder)
        found.append(Row(f"simulated, {asked}", at_least, aim, _measured(folder, explain)))
    return found
