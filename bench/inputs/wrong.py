"""Count how often the checker finds a wrong input and blames a right one.

Each clip with a known set-up is tracked once; then its rate, ball and grid are stated rightly and
wrongly: ``python -m bench.inputs.wrong FOLDER… > table.csv``.
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from calib.grid import WallGrid, find_wall_grid
from metrology import CalibrationError, ImpactVisionError
from pipelines.checker.clips import clip_facts
from pipelines.checker.scene import SceneFacts, findings_of
from pipelines.measure.chain import FollowedClip, MeasureOptions, tracked_once
from pipelines.measure.inputs import gather_inputs
from pipelines.setup.file import Setup
from vision.clip.clip import ClipReader
from vision.clip.footage import CaptureRate, RateSource, nominal_rate_std
from vision.following import follow

__all__ = ["mistakes_of", "outcome", "scene_of"]

RATE_FACTORS, BALL_FACTORS, GRID_FACTORS = (0.1, 0.5, 2.0), (0.5, 1.22, 3.14159), (0.8, 0.5, 2.0)
"""Stated over true values: what people enter."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A clip's facts as they are, and its grid if it was found."""

    facts: SceneFacts
    grid: WallGrid | None


def scene_of(folder: Path) -> Scene:
    """Track a clip and state its set-up rightly.

    Raises
    ------
    ImpactVisionError
        If nothing is tracked.
    """
    lab = json.loads((folder / "setup.json").read_text())
    clip = ClipReader.open(folder / "clip.mp4")
    fps = float(lab["camera_nominal_fps"])
    options = MeasureOptions(cache=True)
    seen = tracked_once(clip, fps, options, lambda: follow(clip, fps))
    diameter = lab.get("ball", {}).get("diameter_m")
    inputs = gather_inputs(Setup(), None if diameter is None else f"{diameter} m", None)
    rate = CaptureRate(fps, nominal_rate_std(fps), RateSource.OPTION)
    pitch = lab.get("grid_pitch_m")
    grid = None
    if pitch is not None:
        try:
            grid = find_wall_grid(seen.tracks.background, pitch_m=pitch)
        except CalibrationError:
            grid = None
    facts = clip_facts(FollowedClip(seen.tracks, seen.clock, rate, inputs), grid)
    tape = float(lab.get("tape_uncertainty_m") or 0.005)
    far, near = lab.get("camera_to_wall_m"), lab.get("ball_plane_to_wall_m")
    facts = replace(
        facts,
        camera_distance=None if far is None else (far, tape),
        plane_offset=None if near is None else (near, tape),
    )
    return Scene(facts, grid)


def mistakes_of(facts: SceneFacts) -> Iterator[tuple[str, float, SceneFacts]]:
    """Key of the wrong input ("" for none), its factor, and the facts with it."""
    yield "", 1.0, facts
    if facts.rate is not None:
        for factor in RATE_FACTORS:
            rate = (factor * facts.rate[0], factor * facts.rate[1])
            yield "rate", factor, replace(facts, rate=rate)
    if facts.ball is not None:
        for factor in BALL_FACTORS:
            ball = (factor * facts.ball[0], factor * facts.ball[1])
            yield "ball", factor, replace(facts, ball=ball)
    if facts.grid is not None:
        for factor in GRID_FACTORS:
            grid = replace(facts.grid, pitch_m=factor * facts.grid.pitch_m)
            yield "grid", factor, replace(facts, grid=grid)


def outcome(key: str, facts: SceneFacts) -> str:
    """``right``, ``listed`` (among several), ``unresolved``, ``nothing`` or ``wrong``."""
    found = findings_of(facts)
    if not found:
        return "right" if not key else "nothing"
    one = found[0]
    option = {"rate": "--fps", "ball": "--ball", "grid": "--wall-grid", "": "none"}[key]
    if one.key == "several":
        return "unresolved"
    if "One change" in one.sentence:
        return "listed" if option in one.sentence else "wrong"
    return "right" if one.key == key else "wrong"


def main() -> None:
    """Print one line per clip and mistake."""
    print("clip,input,factor,outcome,sentence")
    for name in sys.argv[1:]:
        for folder in sorted(path.parent for path in Path(name).rglob("setup.json")):
            try:
                scene = scene_of(folder)
            except ImpactVisionError as problem:
                print(f'{folder.name},,,untracked,"{problem.message}"', flush=True)
                continue
            for key, factor, facts in mistakes_of(scene.facts):
                found = findings_of(facts)
                sentence = found[0].sentence if found else ""
                said = sentence.replace('"', "'")
                print(f'{folder.name},{key},{factor},{outcome(key, facts)},"{said}"', flush=True)


if __name__ == "__main__":
    main()
