"""Fit the prior of a strike: python -m training.fit_striker FOLDER [FOLDER].

A folder holds ray-traced strikes with their truth (clip.mp4, truth.json); of labs drawn at random
seeds 0 to 999 train. From the true motions come centre and scale of speed, pivot and tilt, from the
pictures at the true motion the distance of the body from the point of contact. Centres are means,
scales standard deviations, each with a 95 % interval by resampling of strikes; of the tilt, which
is as often to the left as to the right, the centre is 0. The prior itself is Cauchy's: other rooms
may lie far out. Written to vision/pendulum/swing_prior.json.
"""

import argparse
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import vision.pendulum
from vision.clip.clip import ClipReader
from vision.clip.footage import Footage
from vision.pendulum.candidates import face_gap
from vision.scene import FilmedScene
from vision.tracks import Rest, find_rest

FloatArray = NDArray[np.float64]

OUTPUT = Path(vision.pendulum.__file__).with_name("swing_prior.json")
MAX_SEED = 999
RESAMPLED = 2000


def strikes(folders: list[Path]) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Folders of strikes for training, with their truth."""
    for folder in folders:
        for file in sorted(folder.glob("*/truth.json")):
            truth = json.loads(file.read_text("utf-8"))
            if "mass_u" in truth["frames"] and truth.get("seed", 0) <= MAX_SEED:
                yield file.parent, truth


def true_motion(truth: dict[str, Any], rest: Rest, radius: float) -> FloatArray:
    """Tilt, log pivot distance and log speed of a strike, as in `SwingPrior`."""
    frames = truth["frames"]
    angle, u, v = (np.array(frames[name]) for name in ("phi_rad", "mass_u", "mass_v"))
    angle = -angle if truth.get("mirrored", False) else angle
    one, none = np.ones_like(angle), np.zeros_like(angle)
    rows = np.concatenate(
        [
            np.column_stack([one, none, np.sin(angle), np.cos(angle)]),
            np.column_stack([none, one, np.cos(angle), -np.sin(angle)]),
        ]
    )
    pivot = np.linalg.lstsq(rows, np.concatenate([u, v]), rcond=None)[0][:2]
    on = max(int(truth["contact"]["frame_on"]), 3)
    near = np.arange(max(on - 8, 0), on)
    rate = abs(float(np.polyfit(near, angle[near], 1)[0]))
    along = rest.direction
    across = np.array([along[1], -along[0]])
    up = across if across[1] < 0 else -across
    arm = pivot - (rest.centre_px - radius * along)
    tilt = math.atan2(up[0] * arm[1] - up[1] * arm[0], float(up @ arm))
    length = float(np.hypot(*arm))
    return np.array([tilt, math.log(length / radius), math.log(rate * length / rest.speed_px)])


def features(folder: Path, truth: dict[str, Any]) -> FloatArray | None:
    """True motion and face gap of a strike; None where the ball is not seen at rest."""
    footage = Footage(ClipReader.open(folder / "clip.mp4", fields="progressive"))
    scene = FilmedScene(footage)
    frames = truth["frames"]
    u, v, r = (np.array(frames[name]) for name in ("u_px", "v_px", "r_px"))
    held = np.array([footage.in_clip(index) for index in range(footage.count)])
    height, width = scene.shape
    seen = (u[held] > 0) & (u[held] < width) & (v[held] > 0) & (v[held] < height)
    rows = np.flatnonzero(seen)
    radius = float(np.median(r[held[rows]]))
    rest = find_rest(rows, np.column_stack([u, v])[held[rows]], radius)
    if rest is None:
        return None
    motion = true_motion(truth, rest, radius)
    gap = face_gap(scene, rest, radius, motion)
    return None if gap is None else np.array([*motion, gap])


def fitted(values: FloatArray) -> dict[str, dict[str, float | list[float]]]:
    """Centre and scale of each column, with intervals."""
    rng = np.random.default_rng(1)
    drawn = rng.integers(0, len(values), (RESAMPLED, len(values)))
    out: dict[str, dict[str, float | list[float]]] = {}
    for name, column in zip(("tilt", "pivot", "speed", "face"), values.T, strict=True):
        centre = np.zeros(RESAMPLED) if name == "tilt" else column[drawn].mean(axis=1)
        spread = np.sqrt(np.mean((column[drawn] - centre[:, None]) ** 2, axis=1))
        out[name] = {
            "centre": round(float(centre.mean()), 4),
            "centre_95": np.percentile(centre, [2.5, 97.5]).round(4).tolist(),
            "scale": round(float(spread.mean()), 4),
            "scale_95": np.percentile(spread, [2.5, 97.5]).round(4).tolist(),
        }
    return out


def main() -> None:
    """Fit and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    found = [features(*one) for one in strikes(parser.parse_args().folders)]
    values = np.array([one for one in found if one is not None])
    new = {"strikes": len(values), "fitted": fitted(values)}
    OUTPUT.write_text(json.dumps(new, indent=1) + "\n", "utf-8")
    print(json.dumps(new, indent=1))


if __name__ == "__main__":
    main()
