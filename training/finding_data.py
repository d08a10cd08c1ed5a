"""Recordings with truth for the finding of objects: detections, and where the objects are.

    python -m training.finding_data OUT LABS... [--clips FOLDER]

writes one file a recording into OUT: its detections, the frames searched, and for each body with
truth its place and radius in these frames. LABS are folders of labs, scenes or
rendered clips with truth; FOLDER holds real clips with truth/NAME.csv.
"""

import argparse
import json
import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from metrology import ImpactVisionError
from vision.clip.clip import ClipReader
from vision.clip.footage import Footage
from vision.finding.detection import Detections, detect, searched_frames, with_small
from vision.scene import FilmedScene

FloatArray = NDArray[np.float64]
MEASURED = {"collision": "target", "swing": "mass"}
"""The body that is measured, by kind of motion; else the ball."""


@dataclass(frozen=True)
class Recording:
    """Detections of a recording with truth.

    Attributes
    ----------
    name, kind, measured : str
        Kind of motion and name of the body that is measured.
    frames : (K,) int array
        Frames searched.
    shape : (2,) tuple of int
    bodies : dict
        For each body its x, y and radius (K, 3), px; NaN where it is not in view or unknown.
    """

    name: str
    kind: str
    measured: str
    seen: Detections
    frames: NDArray[np.int64]
    shape: tuple[int, int]
    bodies: dict[str, FloatArray]


def of_truth(truth: dict[str, Any]) -> tuple[str, dict[str, FloatArray]]:
    """Kind of motion, and x, y, radius of each body in every frame of the clip (F, 3)."""
    frames = truth["frames"]
    found = {}
    if "outline_px" in frames:
        found["ball"] = np.column_stack([frames["outline_px"], frames["radius_px"]])
    if "u_px" in frames:
        found["ball"] = np.column_stack([frames["u_px"], frames["v_px"], frames["r_px"]])
        if "mass_u" in frames:
            unknown = np.full(len(frames["mass_u"]), np.nan)
            found["mass"] = np.column_stack([frames["mass_u"], frames["mass_v"], unknown])
    for name, each in frames.items():
        if isinstance(each, dict) and "u_px" in each:
            radius = each.get("r_px") or [np.nan] * len(each["u_px"])
            found[name] = np.column_stack([each["u_px"], each["v_px"], radius])
    return truth.get("kind", "strike"), {k: v.astype(np.float64) for k, v in found.items()}


def of_csv(path: Path, count: int) -> dict[str, FloatArray]:
    """x, y, radius of each body of a real clip in every frame (F, 3)."""
    table = pd.read_csv(path, comment="#")
    if "object" not in table:
        table["object"] = "ball"
    found = {}
    for name, rows in table.groupby("object"):
        places = np.full((count, 3), np.nan)
        rows = rows[rows["frame"] < count]
        places[rows["frame"]] = rows[["x_px", "y_px", "radius_px"]]
        found[str(name)] = places
    return found


def recorded(path: Path, name: str, kind: str, bodies: dict[str, FloatArray] | None) -> Recording:
    """Detections of a clip, and truth in the frames searched."""
    footage = Footage(ClipReader.open(path))
    scene = FilmedScene(footage)
    frames = searched_frames(scene)
    held = np.array([footage.in_clip(frame) for frame in frames.tolist()])
    if bodies is None:
        # a clip stored on its side is followed as it is shown
        shown = path.parent / "truth" / f"{path.stem}.display.csv"
        stored = path.parent / "truth" / f"{path.stem}.csv"
        bodies = of_csv(shown if shown.is_file() else stored, footage.whole_count)
    shifts = scene.shifts()
    placed = {}
    for body, places in bodies.items():
        inside = held < len(places)
        rows = np.full((len(frames), 3), np.nan)
        rows[inside] = places[held[inside]]
        if shifts is not None:
            rows[:, :2] -= shifts[frames]
        placed[body] = rows
    measured = MEASURED.get(kind, "ball")
    if measured not in placed:
        measured = next(iter(placed))
    return Recording(
        name, kind, measured, with_small(scene, detect(scene)), frames, scene.shape, placed
    )


def main() -> None:
    """Write the recordings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("labs", type=Path, nargs="*")
    parser.add_argument("--clips", type=Path)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    wanted = [
        (truth.parent / "clip.mp4", f"{folder.name}_{truth.parent.name}", truth)
        for folder in given.labs
        for truth in sorted(folder.glob("*/truth.json"))
    ]
    for folder in given.labs:
        for truth in sorted(folder.glob("*.truth.json")):
            clip = truth.with_name(truth.name.replace(".truth.json", ".mp4"))
            wanted.append((clip, f"{folder.name}_{clip.stem}", truth))
    if given.clips is not None:
        for truth in sorted((given.clips / "truth").glob("*.csv")):
            for clip in given.clips.glob(f"{truth.stem}.*"):
                wanted.append((clip, f"real_{truth.stem}", truth))
    for clip, name, truth in wanted:
        out = given.out / f"{name}.pickle"
        if out.exists() or not clip.is_file():
            continue
        kind, bodies = "flight", None
        if truth.suffix == ".json":
            kind, bodies = of_truth(json.loads(truth.read_text("utf-8")))
        elif "puck" in name:
            kind = "collision"
        try:
            one = recorded(clip, name, kind, bodies)
        except ImpactVisionError as error:
            print(f"{name}: {error}")
            continue
        out.write_bytes(pickle.dumps(one))
        print(name, len(one.seen), flush=True)


if __name__ == "__main__":
    # the class in the files is that of the module, not of a script
    from training.finding_data import main as run

    run()
