"""Run the stages of one item and keep the output of each.

Folder of an item: `tracks.csv` and `tracks.pickle` (what was followed), `measurement.json`,
`verdict.json` and `record.json` (what is compared, with the truth and the processor time).
"""

import hashlib
import json
import pickle
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import impact_vision as iv
from bench.golden.items import ClipInput, Item, TableInput, input_of
from bench.marked import marked_objects
from measuring import chain
from metrology import write_text_whole
from vision.tracks import Track

__all__ = ["run_item"]

TRACK_GAP = "track_gap_px"
"""Median distance of the ball from centres marked by eye; not a quantity of the product."""


def run_item(item: Item, folder: Path, tracks_from: Path | None = None) -> dict[str, Any]:
    """Measure or explain one item and write the stages to `folder`.

    Parameters
    ----------
    tracks_from : Path, optional
        Folder of the same item in which another run left its tracks: they are measured, and the
        clip is not followed again.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        start = time.process_time()
        given = input_of(item, Path(scratch))
        record: dict[str, Any] = {"input": _digest(given), "failure": None}
        try:
            if isinstance(given, TableInput):
                record |= _explained(given, folder)
            else:
                record |= _measured(given, folder, tracks_from)
        # a bug in one item must not end the run; it is a result, too
        except Exception as problem:
            code = getattr(problem, "exit_code", 1)
            record["failure"] = {"class": type(problem).__name__, "exit": code}
            record["message"] = str(problem)
        record["cpu_s"] = round(time.process_time() - start, 1)
        record["truth"] = given.truth
    write_text_whole(folder / "record.json", json.dumps(record, indent=1, ensure_ascii=False))
    return record


def _digest(given: ClipInput | TableInput) -> str:
    """Digest of the files an item is measured from."""
    place = given.path if isinstance(given, ClipInput) else given.folder
    digest = hashlib.sha256()
    for path in sorted(place.iterdir()) if place.is_dir() else [place]:
        if isinstance(given, ClipInput) or path.name in ("ball.csv", "pendulum.csv", "setup.toml"):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _explained(given: TableInput, folder: Path) -> dict[str, Any]:
    ball, pendulum = given.folder / "ball.csv", given.folder / "pendulum.csv"
    verdict = iv.explain(
        balls=ball if ball.exists() else None,
        pendulum=pendulum if pendulum.exists() else None,
        setup=given.folder / "setup.toml",
    ).to_dict()
    write_text_whole(folder / "verdict.json", json.dumps(verdict, indent=1, ensure_ascii=False))
    effects = {
        effect["id"]: {
            "probability": effect["probability"],
            "parameters": {
                name: {"value": entry["value"], "std": entry.get("std")}
                for name, entry in (effect.get("parameters") or {}).items()
                if isinstance(entry, Mapping)
            },
        }
        for effect in verdict["effects"]
    }
    groups = [sorted(group) for group in verdict["indistinguishable"]]
    return {"verdict": verdict["verdict"], "effects": effects, "groups": sorted(groups)}


def _measured(given: ClipInput, folder: Path, tracks_from: Path | None) -> dict[str, Any]:
    if tracks_from is None:
        found = iv.measure(given.path, cache=False, **given.options)
    else:
        followed = pickle.loads((tracks_from / "tracks.pickle").read_bytes())
        with patch.object(chain, "follow", lambda *_, **__: followed):
            found = iv.measure(given.path, cache=False, **given.options)
    (folder / "tracks.pickle").write_bytes(pickle.dumps(found.record.tracks))
    found.tracks.to_csv(folder / "tracks.csv", index=False)
    document = found.to_dict()
    write_text_whole(
        folder / "measurement.json", json.dumps(document, indent=1, ensure_ascii=False)
    )
    quantities = {**document["quantities"], **document["beside"]}
    quantities["gravity_check"] = document["time_base"]["gravity_check"]
    if not document["time_base"]["std"]:
        quantities.pop("gravity_check")
    if given.marked is not None:
        quantities[TRACK_GAP] = _track_gap(found.record.tracks.ball, given.marked)
        given.truth["quantities"] = given.truth["quantities"] | {TRACK_GAP: 0.0}
    motion = document["motion"]
    return {
        "motion": {"kind": motion["kind"], "probability": motion["probability"]},
        "quantities": {
            name: {key: entry.get(key) for key in ("value", "std")}
            for name, entry in quantities.items()
        },
    }


def _track_gap(ball: Track, marked: Path) -> dict[str, float | None]:
    """Smallest over the marked objects of the median distance, px; std is that of the marks."""
    best: tuple[float, float] | None = None
    for truth in marked_objects(marked):
        _, ours, theirs = np.intersect1d(ball.frame, truth.frame, return_indices=True)
        if len(ours):
            gap = np.hypot(*(ball.centre_px[ours] - truth.centre[theirs]).T)
            found = (float(np.median(gap)), float(np.median(truth.std)))
            best = found if best is None else min(best, found)
    return {"value": best[0] if best else None, "std": best[1] if best else None}
