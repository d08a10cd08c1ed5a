"""Run every real and simulated recording and store which names are given, and which are right."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

import impact_vision as iv
from bench.concealed.answer import Answer
from bench.real import balldrop, juggling_mocap, rocket_coast, rod_pendulum
from bench.real.plain_sets import MADE_SETS
from bench.real.row import Explain

__all__ = ["named_in_all", "outcome"]

Truth = tuple[str, ...]
LOSSES = ("bearing_friction", "pendulum_drag")
PLAIN: dict[str, Truth] = {
    "encoder_pendulum": ("bearing_friction",),
    "encoder_pendulum_b": LOSSES,
    "coffee_filter": ("drag",),
    "tabletennis_rally": ("drag", "magnus"),
    "three_drops": ("drag",),
    "pingpong_throws": (),
}
"""Sets whose files the engine reads directly, with what is missing; source: PROVENANCE.md."""
SIMULATED: tuple[Truth, ...] = (
    LOSSES, LOSSES, ("viscous_damping", "pendulum_drag"), (), ("drag", "magnus"),
)  # fmt: skip
"""What is missing from each of `MADE_SETS`."""
LIKELY = 0.5
"""Probability from which a name is an answer; convention."""


def outcome(answer: Answer, truth: Truth) -> str:
    """Whether all that is missing, and nothing else, is named; `silent` if no name is likely.

    Silence is right where nothing is missing.
    """
    likely = {n.id for n in answer.named if (n.probability or 0.0) >= LIKELY}
    groups = [group for group in answer.groups if group & likely]
    declared = likely.union(*groups)
    false = [one for one in likely if not {one}.union(*(g for g in groups if one in g)) & {*truth}]
    if false:
        return "wrong"
    if not likely:
        return "silent" if truth else "right"
    return "right" if {*truth} <= declared else "in part"


def _recordings(source: Path, cache: Path) -> Iterator[tuple[str, Truth, Path]]:
    """Name, truth and folder of each recording; folders are written as they are asked for."""
    for name, truth in PLAIN.items():
        yield name, truth, _copied(source / name, cache / name)
    rod_pendulum.convert(source / "rod_pendulum", cache / "rod")
    yield "rod_pendulum", ("bearing_friction", "viscous_damping"), cache / "rod"
    bodies = tuple(pd.read_csv(source / "balldrop" / "objects.csv")["object"])
    balldrop.convert(source / "balldrop", cache / "balldrop", bodies, (1, 2))
    yield "balldrop", ("drag", "length_scale"), cache / "balldrop"
    for rocket in pd.read_csv(source / "rocket_coast" / "truth.csv")["object"]:
        rocket_coast.convert(source / "rocket_coast", cache / rocket, rocket)
        yield f"rocket_coast, {rocket}", ("drag",), cache / rocket
    for one in ("3_throws", "6_throws"):
        juggling_mocap.convert(source / "juggling_mocap", cache / one, one)
        yield f"juggling_mocap, {one}", ("length_scale", "camera_roll"), cache / one
    heights = source / "rebound_heights"
    for path in sorted(heights.glob("t_*.csv")):
        folder = _copied(heights, cache / path.stem)
        shutil.copyfile(path, folder / "ball.csv")
        yield f"rebound_heights, {path.stem.removeprefix('t_')}", (), folder
    for place, (asked, *_, write) in enumerate(MADE_SETS):
        write(cache / f"made_{place}")
        yield f"simulated {asked.partition(':')[0]}", SIMULATED[place], cache / f"made_{place}"


def _copied(source: Path, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for path in source.iterdir():
        if path.suffix in (".csv", ".toml"):
            shutil.copyfile(path, folder / path.name)
    return folder


def named_in_all(source: Path, cache: Path, explain: Explain) -> dict[str, dict[str, Any]]:
    """Recording → what is missing, verdict, names with probabilities, groups and outcome."""
    found = {}
    for name, truth, folder in _recordings(source, cache):
        answer = explain(folder, folder / "answer.json")
        found[name] = {
            "missing": list(truth),
            "verdict": answer.failure or answer.verdict,
            "named": {one.id: round(one.probability or 0.0, 2) for one in answer.named},
            "groups": [sorted(group) for group in answer.groups],
            "outcome": outcome(answer, truth),
        }
        print(name, json.dumps(found[name]), flush=True)
    return found | _laws(source)


def _laws(source: Path) -> dict[str, dict[str, Any]]:
    """Laws of restitution of the balls whose times between bounces were recorded."""
    bounces = pd.read_csv(source / "rebound_times" / "cor.csv")
    found = {}
    for ball, rows in bounces.groupby("ball"):
        law = iv.law(rows, setup=source / "rebound_heights" / "setup.toml", speeds_from="times")
        said = law.to_dict()["balls"][ball]
        found[f"rebound_times, {ball} (law)"] = {
            "missing": ["constant"],
            "verdict": "law",
            "named": {said["law"]: round(said["probability"], 2)},
            "groups": [],
            "outcome": "right" if said["law"] == "constant" else "wrong",
        }
    return found
