"""Count how often the checker finds a wrong input and blames a right one.

Each clip with a known set-up is tracked once; then its rate, ball and grid are stated rightly and
wrongly: ``python -m bench.inputs.wrong FOLDER… > table.csv``. The last lines compare the scales
by outline, grid and fall of rightly stated clips; the uncertainties of `measuring.checker.scene`
were fitted to them.
"""

import itertools
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from calib.grid import WallGrid, find_wall_grid
from measuring.chain import FollowedClip, MeasureOptions, tracked_once
from measuring.checker.clips import clip_facts
from measuring.checker.scene import SceneFacts, equations_of, findings_of, upright
from measuring.inputs import gather_inputs
from measuring.setup.file import Setup
from metrology import CalibrationError, ImpactVisionError
from vision.clip.clip import ClipReader
from vision.clip.footage import CaptureRate, RateSource, nominal_rate_std
from vision.following import follow

__all__ = ["differences_of", "mistakes_of", "outcome", "scene_of"]

RATE_SLIPS, BALL_FACTORS, GRID_FACTORS = (0.1, 0.5, 2.0), (0.5, 1.22, 3.14159), (0.8, 0.5, 2.0)
TAPE_FACTORS = (0.65, 0.5)
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
    ball = lab.get("ball", {})
    diameter, mass = ball.get("diameter_m"), ball.get("mass_kg")
    setup = Setup()
    if diameter is not None and mass is not None:
        setup = setup.having({"ball.diameter": f"{diameter} m", "ball.mass": f"{mass} kg"})
    inputs = gather_inputs(setup, None if diameter is None or mass else f"{diameter} m", None)
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
        for factor in RATE_SLIPS:
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
    if facts.grid is not None and facts.camera_distance and facts.plane_offset:
        for factor in TAPE_FACTORS:
            tape = (factor * facts.camera_distance[0], facts.camera_distance[1])
            yield "ratio", factor, replace(facts, camera_distance=tape)


def outcome(key: str, facts: SceneFacts) -> str:
    """``right``, ``listed`` (among several), ``unresolved``, ``nothing`` or ``wrong``."""
    found = findings_of(facts)
    if not found:
        return "right" if not key else "nothing"
    one = found[0]
    options = {"rate": "--fps", "ball": "--ball", "grid": "--wall-grid", "": "none"}
    option = options.get(key, "distance_to_wall")
    if one.key == "several":
        return "unresolved"
    if "One change" in one.sentence:
        return "listed" if option in one.sentence else "wrong"
    return "right" if one.key == key else "wrong"


def differences_of(facts: SceneFacts) -> dict[str, tuple[float, float]]:
    """Relative differences of the scales by outline, grid and fall, with their std."""
    inputs, relations = equations_of(upright(facts))
    known = {one.key: one for one in inputs if one.stated}
    scales = {}
    for relation in relations:
        others = {key: power for key, power in relation.powers.items() if key != "scale"}
        if others.keys() <= known.keys():
            power = relation.powers["scale"]
            log = math.log(relation.value)
            log -= sum(each * math.log(known[key].value) for key, each in others.items())
            terms = [each * known[key].relative_std for key, each in others.items()]
            scales[relation.name] = (log / power, math.hypot(relation.relative_std, *terms) / power)
    return {
        f"{one} / {other}": (
            scales[one][0] - scales[other][0],
            math.hypot(scales[one][1], scales[other][1]),
        )
        for one, other in itertools.combinations(scales, 2)
    }


def main() -> None:
    """Print one line per clip and mistake."""
    compared: dict[str, list[float]] = {}
    print("clip,input,factor,outcome,sentence")
    for name in sys.argv[1:]:
        for folder in sorted(path.parent for path in Path(name).rglob("setup.json")):
            try:
                scene = scene_of(folder)
            except ImpactVisionError as problem:
                print(f'{folder.name},,,untracked,"{problem.message}"', flush=True)
                continue
            for name, (off, std) in differences_of(scene.facts).items():
                compared.setdefault(name, []).append(off / std)
            for key, factor, facts in mistakes_of(scene.facts):
                found = findings_of(facts)
                sentence = found[0].sentence if found else ""
                said = sentence.replace('"', "'")
                print(f'{folder.name},{key},{factor},{outcome(key, facts)},"{said}"', flush=True)
    for name, sigmas in compared.items():
        middle = sorted(map(abs, sigmas))[len(sigmas) // 2]
        print(f"# {name}: {len(sigmas)} clips, median |difference| {middle:.2f} std")


if __name__ == "__main__":
    main()
