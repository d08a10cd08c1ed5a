"""Switch off one part of finding and following at a time, and count what changes.

Run: python -m bench.following.ablation STORE [--labs FOLDER]

STORE is a folder of training.finding_data. Features of the selection are left out of its fit, which
is made anew without each recording in turn; steps of linking are left out on the stored detections.
Each step of following is watched on the labs in FOLDER, and left out on those where it acts. Writes
docs/results/ablation.json.
"""

import argparse
import json
import pickle
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import vision.following as following
from metrology import NotFoundError
from metrology.files import write_text_whole
from training.finding_data import MEASURED, Recording, of_truth
from training.fit_finding import Table, kept_out, right_tracklet
from training.motion_tracks import ACCEPTED
from vision.clip.clip import ClipReader
from vision.finding import linking
from vision.finding.selection import FEATURES, tracklet_features
from vision.scene import FilmedScene
from vision.tracks import Track, Tracks

RESULTS = Path(__file__).parents[2] / "docs" / "results" / "ablation.json"
_ON_RADII, _MIN_FRACTION = 0.5, 0.8
"""Radii, with one pixel more, within which a track is on its object; fraction of its frames."""


def tables_of(store: list[Recording]) -> list[Table]:
    """Features of the tracklets of each recording, and which is right."""
    tables = []
    for one in store:
        found = linking.link(one.seen, one.frames, one.shape)
        features = tracklet_features(found, len(one.frames), one.shape)
        tables.append((features, right_tracklet(one, found)))
    return tables


def choices(tables: list[Table]) -> dict[str, float]:
    """Right choices and log loss with each recording left out of the fit in turn."""
    judged = kept_out(tables)
    right = np.array([share.argmax() == answer for share, answer in judged])
    sure = np.array([share.max() >= 0.9 for share, _ in judged])
    loss = float(np.mean([-np.log(share[answer]) for share, answer in judged]))
    return {
        "right": int(right.sum()),
        "sure": int(sure.sum()),
        "wrong_sure": int((sure & ~right).sum()),
        "log_loss": loss,
        "found": sum(answer < len(features) for features, answer in tables),
    }


def without_feature(tables: list[Table], name: str) -> list[Table]:
    """The tables with one feature set to a constant."""
    keep = np.array([each != name for each in FEATURES], dtype=float)
    return [(features * keep, answer) for features, answer in tables]


LINKING: dict[str, tuple[str, Callable[..., Any]]] = {
    "exchange of tails": ("_exchanged", lambda chains, _marks: chains),
    "cuts of chains": ("_parts", lambda rows, _marks: [rows]),
    "joins over gaps": ("_joined", lambda chains, _marks: chains),
    "limit of a jump": ("_beyond_reach", lambda frame, *_: np.zeros(len(frame), dtype=np.bool_)),
}
"""Steps of linking, and what takes their place."""


def _no_colour(find: Callable[..., Any]) -> Callable[..., Any]:
    def gray(scene: FilmedScene, path: Any, contrast: Any) -> Any:
        return find(scene, path, np.full(3, float(np.mean(contrast))))

    return gray


REFUSED: dict[str, Callable[[FilmedScene, bool], bool]] = {
    "striker in colour": lambda scene, _small: scene._footage._tint is not None,
    "small striker": lambda _scene, small: small,
}
"""Calls of the search for a striker that are left out."""


def _striker_of(step: str) -> Callable[..., Any]:
    def wrapped(find: Callable[..., Any]) -> Callable[..., Any]:
        def limited(scene: FilmedScene, *given: Any, small: bool = False) -> Any:
            return None if REFUSED[step](scene, small) else find(scene, *given, small=small)

        return limited

    return wrapped


ABLATED_STEPS: dict[str, tuple[Any, str, Callable[..., Any]]] = {
    "small objects at twice the size": (
        following,
        "with_small",
        lambda _: lambda _scene, seen: seen,
    ),
    "beyond the outlines by appearance": (
        following,
        "extended_by_appearance",
        lambda _: lambda _scene, found: found,
    ),
    "scene behind the object at rest": (following, "_uncover", lambda _: lambda *_given: None),
    "outlines in the object's colour": (following, "_fit", _no_colour),
    "second background for the striker": (FilmedScene, "as_it_began", lambda _: lambda _self: None),
    "striker in colour": (
        following,
        "find_striker",
        _striker_of("striker in colour"),
    ),
    "small striker": (following, "find_striker", _striker_of("small striker")),
    "straight path is no swing": (following, "_came_straight", lambda _: lambda *_given: False),
    "outlines where frames are missing": (following, "_with_gaps", lambda _: lambda _s, fits: fits),
    "lost frames": (following, "lost_frames", lambda _: lambda *_given: None),
}
"""Steps of following: where each is looked up, and what takes its place."""


@contextmanager
def without(step: str) -> Iterator[None]:
    """Following without a step."""
    place, name, substitute = ABLATED_STEPS[step]
    with patch.object(place, name, substitute(getattr(place, name))):
        yield


@contextmanager
def watched(acted: set[str]) -> Iterator[None]:
    """Following with a note of each step that gives another answer than its substitute."""
    with ExitStack() as stack:
        for step, (place, name, substitute) in ABLATED_STEPS.items():
            original = getattr(place, name)
            other = substitute(original)

            def both(
                *given: Any,
                _step: str = step,
                _original: Callable[..., Any] = original,
                _other: Callable[..., Any] = other,
                **named: Any,
            ) -> Any:
                answer = _original(*given, **named)
                if _step not in acted and not _alike(_step, answer, _other, given, named):
                    acted.add(_step)
                return answer

            stack.enter_context(patch.object(place, name, both))
        yield


def _alike(
    step: str, answer: Any, other: Callable[..., Any], given: Any, named: dict[str, Any]
) -> bool:
    """Whether the substitute would have had no effect."""
    if step == "scene behind the object at rest":
        return False
    if step == "outlines in the object's colour":
        return answer[0] is given[0]
    if step in REFUSED:
        return answer is None or not REFUSED[step](given[0], named.get("small", False))
    instead = other(*given, **named)
    if hasattr(answer, "frame"):
        return len(answer.frame) == len(instead.frame)
    return answer is instead or (isinstance(answer, bool) and answer == instead)


def judged(lab: Path) -> dict[str, Any]:
    """Kind, and whether ball and mass of a lab are on their objects."""
    truth = json.loads((lab / "truth.json").read_text("utf-8"))
    kind, bodies = of_truth(truth)
    try:
        tracks: Tracks | None = following.follow(
            ClipReader.open(lab / "clip.mp4"), float(truth["fps_nominal"])
        )
    except NotFoundError:
        return {"kind": False, "object": False, "mass": False}
    said = tracks.motion.kind.value
    measured = bodies.get(MEASURED.get(kind, "ball"))
    mass = bodies.get("mass") if kind == "strike" else None
    return {
        "kind": said in ACCEPTED.get(kind, (kind,)),
        "object": measured is not None and _on(tracks.ball, measured),
        "mass": mass is None or (tracks.pendulum is not None and _on(tracks.pendulum.track, mass)),
    }


def _on(track: Track, truth: np.ndarray) -> bool:
    places = truth[track.frame]
    known = np.isfinite(places[:, 0])
    radius = np.where(np.isfinite(places[:, 2]), places[:, 2], track.radius_px)
    off = np.hypot(*(track.centre_px - places[:, :2]).T)
    on = off[known] < _ON_RADII * radius[known] + 1.0
    return bool(known.any() and np.mean(on) >= _MIN_FRACTION)


def of_store(store: list[Recording]) -> Iterator[dict[str, Any]]:
    """What each feature of the selection and each step of linking moves; yielded after each."""
    tables = tables_of(store)
    found: dict[str, Any] = {"recordings": len(store), "whole": choices(tables), "features": {}}
    print("whole", found["whole"], flush=True)
    for name in FEATURES:
        found["features"][name] = choices(without_feature(tables, name))
        print(name, found["features"][name], flush=True)
    found["linking"] = {}
    for step, (name, substitute) in LINKING.items():
        yield found
        with patch.object(linking, name, substitute):
            found["linking"][step] = choices(tables_of(store))
        print(step, found["linking"][step], flush=True)
    yield found


def of_labs(labs: list[Path]) -> Iterator[dict[str, Any]]:
    """What each step of following moves on labs; yielded after each."""
    right = dict.fromkeys(("kind", "object", "mass"), 0)
    steps: dict[str, Any] = {
        step: {"acts_in": 0, "better_without": [], "worse_without": []} for step in ABLATED_STEPS
    }
    for count, lab in enumerate(labs, start=1):
        acted: set[str] = set()
        with watched(acted):
            whole = judged(lab)
        print(lab.name, whole, sorted(acted), flush=True)
        for what, known in whole.items():
            right[what] += known
        for step in sorted(acted):
            steps[step]["acts_in"] += 1
            with without(step):
                left = judged(lab)
            for what, known in whole.items():
                if left[what] != known:
                    change = "better_without" if left[what] else "worse_without"
                    steps[step][change].append(f"{lab.name} {what}")
                    print("  without", step, what, left[what], flush=True)
        yield {"labs": count, "labs_right": right, "following": steps}


def _keep(found: dict[str, Any]) -> None:
    known = json.loads(RESULTS.read_text("utf-8")) if RESULTS.exists() else {}
    write_text_whole(RESULTS, json.dumps(known | found, indent=1) + "\n")


def main() -> None:
    """Judge the parts, print and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("store", type=Path, nargs="?")
    parser.add_argument("--labs", type=Path)
    given = parser.parse_args()
    if given.store is not None:
        paths = sorted(given.store.glob("*.pickle"))
        for found in of_store([pickle.loads(path.read_bytes()) for path in paths]):
            _keep(found)
    if given.labs is not None:
        for found in of_labs(sorted(path.parent for path in given.labs.glob("*/truth.json"))):
            _keep(found)


if __name__ == "__main__":
    main()
