"""Fit what a pendulum's sure blow says: python -m training.fit_blow FOLDER... [--write].

Folders hold labs or rendered clips with truth (NAME/clip.mp4, truth.json); of labs drawn at random
seeds 0 to 999 train. Of each clip the most probable objects are looked at as by the measurement.
Two weights come from it: by how much the odds of an object to be the measured one grow where it was
struck, in a conditional logit over the objects of the clip, and by how much those of a strike do.
Each has a ridge of the selection's size and a 95 % interval by resampling of clips.
"""

import argparse
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from metrology.kept import KeptResults
from training.finding_data import MEASURED, of_truth
from vision.clip.clip import ClipReader
from vision.clip.footage import Footage
from vision.finding.linking import Tracklet
from vision.following import MAX_LOOKS, find_objects, look_at, track_of
from vision.motions.motion import interpret_tracks
from vision.pendulum.search import pendulum_track
from vision.scene import FilmedScene
from vision.tracks import MotionKind

FloatArray = NDArray[np.float64]

OUTPUT = Path("vision/blow.json")
MAX_SEED = 999
RESAMPLED = 500
_RIDGE = 0.05
"""As of `training.fit_finding`."""
_MIN_SHARE = 0.005
"""Probability below which an object is not looked at: it takes seconds and changes nothing."""


@dataclass(frozen=True)
class LookedAt:
    """A clip's objects, most probable first, and what the motion of the right one looks like.

    Attributes
    ----------
    probability : (N,) array
        Of each to be the measured one, before the look.
    none : float
        That no object is.
    right, struck : (N,) bool array
    strike : float
        Probability that the right one's motion is a strike, before the look; NaN if unseen.
    """

    probability: FloatArray
    none: float
    right: NDArray[np.bool_]
    struck: NDArray[np.bool_]
    strike: float
    is_strike: bool


def clips(folders: list[Path]) -> Iterator[Path]:
    """Truths of the clips to train on."""
    for folder in folders:
        for truth in sorted(folder.glob("*/truth.json")):
            if json.loads(truth.read_text("utf-8")).get("seed", 0) <= MAX_SEED:
                yield truth


def is_on(tracklet: Tracklet, footage: Footage, scene: FilmedScene, places: FloatArray) -> bool:
    """Whether most of a tracklet lies on a body's places (F, 3) in the frames of the clip."""
    frames = np.array([footage.in_clip(frame) for frame in tracklet.frame.tolist()])
    held = frames < len(places)
    shifts = scene.shifts()
    shown = tracklet.centre_px[held]
    shown = shown if shifts is None else shown + shifts[tracklet.frame[held]]
    away = np.hypot(*(shown - places[frames[held], :2]).T)
    return bool(np.mean(away < 0.35 * tracklet.radius + 1.5) > 0.6)


def looked_at(truth: Path) -> LookedAt | None:
    """Look at the objects of a clip; None where none is found."""
    kind, bodies = of_truth(json.loads(truth.read_text("utf-8")))
    footage = Footage(ClipReader.open(truth.with_name("clip.mp4")))
    scene = FilmedScene(footage)
    found = find_objects(scene, None, None)
    body = bodies.get(MEASURED.get(kind, "ball"))
    if found is None or body is None:
        return None
    order = found.selection.order[:MAX_LOOKS]
    places = order[found.selection.probability[order] > _MIN_SHARE].tolist()
    right, struck, strike = [], [], math.nan
    for place in places:
        own = replace(found, chosen=place)
        seen = look_at(scene.anew(), own, None, KeptResults())
        right.append(is_on(own.ball, footage, scene, body))
        struck.append(seen is not None and seen.surely_struck)
        if seen is not None and right[-1] and struck[-1] and math.isnan(strike):
            assert seen.striker is not None
            assert seen.rest is not None
            pendulum = pendulum_track(seen.striker, seen.rest, 1.0)
            motion = interpret_tracks(track_of(seen.rough, 1.0), pendulum)
            shares = {motion.kind: motion.probability, **dict(motion.alternatives)}
            strike = shares[MotionKind.STRIKE]
    share = found.selection.probability[places]
    none = max(1.0 - float(share.sum()), 1e-6)
    return LookedAt(share, none, np.array(right), np.array(struck), strike, kind == "strike")


def choice_loss(one: LookedAt, weight: float) -> float:
    """Minus the log probability of the right objects, of none where there is none."""
    odds = one.probability * np.exp(weight * one.struck)
    right = float(odds[one.right].sum()) if one.right.any() else one.none
    return -math.log(right / (float(odds.sum()) + one.none))


def strike_loss(one: LookedAt, weight: float) -> float:
    """Minus the log probability of the kind, of an object that was struck."""
    if math.isnan(one.strike):
        return 0.0
    odds = min(max(one.strike, 1e-6), 1.0 - 1e-6)
    odds = odds / (1.0 - odds) * math.exp(weight)
    return math.log1p(1.0 / odds) if one.is_strike else math.log1p(odds)


def fitted(clips: list[LookedAt], loss: Callable[[LookedAt, float], float]) -> float:
    """The weight with the least loss."""
    found = minimize_scalar(
        lambda weight: sum(loss(one, weight) for one in clips) + _RIDGE * weight**2,
        bounds=(0.0, 20.0), method="bounded",
    )  # fmt: skip
    return float(found.x)


def main() -> None:
    """Look, fit, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    seen = []
    for truth in clips(given.folders):
        one = looked_at(truth)
        if one is not None:
            seen.append(one)
            print(truth.parent.name, one, flush=True)
    rng = np.random.default_rng(1)
    entries: dict[str, object] = {"fitted_by": "training/fit_blow.py", "clips": len(seen)}
    for name, loss in (("choice", choice_loss), ("strike", strike_loss)):
        drawn = [
            fitted([seen[k] for k in rng.integers(0, len(seen), len(seen))], loss)
            for _ in range(RESAMPLED)
        ]
        low, high = np.quantile(drawn, [0.025, 0.975])
        value = fitted(seen, loss)
        entries[name] = {"value": round(value, 2), "low": round(low, 2), "high": round(high, 2)}
        before = sum(loss(one, 0.0) for one in seen)
        print(name, entries[name], "loss", before, sum(loss(one, value) for one in seen))
    if given.write:
        OUTPUT.write_text(json.dumps(entries, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
