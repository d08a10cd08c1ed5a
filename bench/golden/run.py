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
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import impact_vision as iv
from bench.golden.items import ClipInput, Item, TableInput, input_of
from bench.scenes.truths import marked_truths
from metrology import ImpactVisionError, write_text_whole
from vision.tracks import Track

__all__ = ["run_item"]

TRACK_GAP = "track_gap_px"
"""Median distance of the ball from centres marked by eye; not a quantity of the product."""


def run_item(item: Item, folder: Path, tracks_from: Path | None = None) -> dict[str, Any]:
    """Measure or explain one item and write the stages to `folder`.

    Parameters
    ----------
    item : Item
    folder : Path
    tracks_from : Path, optional
        Folder of the same item in which another run left its tracks: they are measured, and the
        clip is not followed again.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        given = input_of(item, Path(scratch))
        start = time.process_time()
        record: dict[str, Any] = {"input": _digest(given), "failure": None}
        try:
            if isinstance(given, TableInput):
                record |= _explained(given, folder)
            else:
                record |= _measured(given, folder, tracks_from)
        except ImpactVisionError as problem:
            record["failure"] = {"class": type(problem).__name__, "exit": problem.exit_code}
            record["message"] = problem.in_one_line
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
        with (folder / "tracks.pickle").open("wb") as file:
            pickle.dump((found.record.info, found.record.tracks), file)
    else:
        found = _from_tracks(given, tracks_from / "tracks.pickle")
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


def _from_tracks(given: ClipInput, stored: Path) -> iv.Measurement:
    """Measure stored tracks: everything `measure` does after following."""
    from pipelines.api.quantities import measure_options
    from pipelines.measure.chain import (
        FollowedClip,
        fit_tracks,
        measurement_of,
        quantities_of,
    )
    from pipelines.measure.inputs import gather_inputs
    from vision.clip.clip import ClipReader
    from vision.clip.footage import choose_capture_rate

    options = measure_options(**given.options)
    clip, camera = ClipReader.open(given.path), options.setup.camera
    with stored.open("rb") as file:
        info, tracks = pickle.load(file)
    rate = choose_capture_rate(
        clip.info,
        options.fps,
        camera.capture_fps,
        option_std=options.fps_std,
        setup_std=camera.capture_fps_std,
    )
    inputs = gather_inputs(options.setup, options.ball, options.wall_grid)
    clock = tracks.on_clock(clip.capture_times(1.0))
    followed = FollowedClip(tracks, clock, rate, inputs, options.scale_m_per_px)
    found = quantities_of(fit_tracks(followed), None, options.budget)
    return iv.Measurement(
        measurement_of(replace(info, path=given.path), followed, found, clip.warnings)
    )


def _track_gap(ball: Track, marked: Path) -> dict[str, float | None]:
    """Smallest over the marked objects of the median distance, px; std is that of the marks."""
    best: tuple[float, float] | None = None
    for truth in marked_truths(marked):
        _, ours, theirs = np.intersect1d(ball.frame, truth.frame, return_indices=True)
        if len(ours):
            gap = np.hypot(*(ball.centre_px[ours] - truth.centre[theirs]).T)
            found = (float(np.median(gap)), float(np.median(truth.std)))
            best = found if best is None else min(best, found)
    return {"value": best[0] if best else None, "std": best[1] if best else None}
