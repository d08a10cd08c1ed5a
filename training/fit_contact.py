"""Fit the priors of a strike's face: python -m training.fit_contact STORE FOLDER [--write].

A folder holds ray-traced strikes with their truth (clip.mp4, setup.json, truth.json); of labs drawn
at random seeds 0 to 999 train. STORE keeps the tracks of each. At the true onset and release the
paths say where the face was; its distance from where it was seen, and its shift between the two,
are each a mixture of two normal distributions with the mean 0: the seen face with its stated
uncertainty or another part of the mass, and a track that holds or one that slips. The logarithm of
the contact time is Cauchy's, since other balls may be far softer or harder. Maximum likelihood,
with 95 % intervals by resampling of strikes, goes to pipelines/measure/face_prior.json.
"""

import argparse
import json
import math
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

import pipelines.measure
from metrology import ImpactVisionError
from pipelines.measure import chain, impact
from pipelines.setup.file import read_setup

FloatArray = NDArray[np.float64]

OUTPUT = Path(pipelines.measure.__file__).with_name("face_prior.json")
MAX_SEED = 999
RESAMPLED = 200


def strikes(folders: list[Path]) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Folders of strikes for training, with their truth."""
    for folder in folders:
        for file in sorted(folder.glob("*/truth.json")):
            truth = json.loads(file.read_text("utf-8"))
            if truth.get("kind", "strike") == "strike" and truth.get("seed", 0) <= MAX_SEED:
                yield file.parent, truth


def setup_text(written: dict[str, Any]) -> str:
    """The set-up file of what a laboratory wrote down."""
    pendulum, ball = written["pendulum"], written["ball"]
    grid = written["grid_pitch_m"]
    return "\n".join(
        [
            f"[camera]\ncapture_fps = {written['camera_nominal_fps']}",
            f'distance_to_wall = "{written["camera_to_wall_m"]} m +- 0.005 m"',
            "[wall]",
            *([f'grid = "{1000 * grid} mm"'] if grid else []),
            f'ball_plane_offset = "{written["ball_plane_to_wall_m"]} m +- 0.005 m"',
            f'[ball]\nmass = "{ball["mass_kg"]} kg"\ndiameter = "{ball["diameter_m"]} m"',
            f'[pendulum]\nlength = "{pendulum["length_to_contact_m"]} m"',
            f'inertia = "{pendulum["inertia_kg_m2"]} kg m^2"',
            f'mass = "{pendulum["total_mass_kg"]} kg"\ncom = "{pendulum["com_from_pivot_m"]} m"',
            f'[support]\nheight = "{written["support_height_m"]} m"',
        ]
    )


def followed(clip: Path, store: Path) -> chain.FollowedClip:
    """The tracks of a recording, followed once."""
    kept = store / f"{clip.parent.name}_{clip.name}.pkl"
    if not kept.exists():
        written = json.loads((clip / "setup.json").read_text("utf-8"))
        options = chain.MeasureOptions(setup=read_setup(setup_text(written)))
        inputs = chain.gather_inputs(options.setup, None, None)
        reader = chain.ClipReader.open(clip / "clip.mp4")
        rate = chain.choose_capture_rate(reader.info, None, options.setup.camera.capture_fps)
        seen = chain.tracked_once(reader, rate.fps, options, lambda: chain.follow(reader, rate.fps))
        kept.write_bytes(
            pickle.dumps((chain.FollowedClip(seen.tracks, seen.clock, rate, inputs, None), None))
        )
    found: chain.FollowedClip = pickle.loads(kept.read_bytes())[0]
    return found


def face_errors(clip: chain.FollowedClip, truth: dict[str, Any]) -> FloatArray:
    """Distance of the true face from the seen one, its std, and its shift, radii; log time, s."""
    fps = clip.rate.fps
    onset = truth["contact"]["frame_on"] / fps
    release = onset + truth["contact"]["dt_s"] * truth["fps_true"] / fps
    tracks = chain.fit_tracks(clip, lambda *_: None).metric
    if tracks is None or tracks.pivot_m is None:
        raise ImpactVisionError("no strike was followed")
    landed = impact.flight_end(tracks, clip.inputs, impact.departure(tracks))
    flight = impact._flight(tracks, clip.inputs, release, landed, free=False)
    frames = impact._Frames.of(tracks, onset, release)
    view = impact._view(tracks, clip.inputs, flight, frames)
    face = float(impact.gap_before(view, np.array([onset]))[0])
    shift = float(impact.gap_after(view, np.array([release]))[0]) - face
    radii = np.array([face - view.face_offset, view.face_offset_std, shift]) / view.radius
    # scenes that were designed have two balls; what is drawn says how much balls differ
    lasting = truth["contact"]["dt_s"] if "seed" in truth else math.nan
    return np.append(radii, math.log(lasting))


def _mixture(off: FloatArray, narrow: FloatArray, wide: FloatArray, fraction: float) -> FloatArray:
    """Densities of the two parts, the wide one's share of `fraction`."""

    def normal(std: FloatArray) -> FloatArray:
        return np.asarray(np.exp(-0.5 * (off / std) ** 2) / std)

    return (1.0 - fraction) * normal(narrow) + fraction * normal(wide)


def other_part(errors: FloatArray) -> FloatArray:
    """Fraction of strikes whose seen face is another part, and std of its place, ball radii."""

    def cost(values: FloatArray) -> float:
        fraction, std = 1.0 / (1.0 + np.exp(-values[0])), np.exp(values[1])
        wide = np.hypot(errors[:, 1], std)
        return -float(np.log(_mixture(errors[:, 0], errors[:, 1], wide, fraction)).sum())

    best = _least(cost, [(-1.0, -1.0), (-2.0, -2.0), (0.0, -2.0)])
    return np.array([1.0 / (1.0 + np.exp(-best[0])), np.exp(best[1])])


def parting(errors: FloatArray) -> FloatArray:
    """Fraction of tracks that slip, and std of the shift of one that holds and one that slips."""

    def cost(values: FloatArray) -> float:
        fraction = 1.0 / (1.0 + np.exp(-values[0]))
        stds = [np.full(len(errors), np.exp(value)) for value in values[1:]]
        return -float(np.log(_mixture(errors[:, 2], *stds, fraction)).sum())

    best = _least(cost, [(-1.0, -4.0, -2.0), (0.0, -4.5, -2.5)])
    return np.array([1.0 / (1.0 + np.exp(-best[0])), *np.exp(best[1:])])


def duration(errors: FloatArray) -> FloatArray:
    """Centre and half width of the logarithm of contact times, s."""

    def cost(values: FloatArray) -> float:
        drawn = errors[np.isfinite(errors[:, 3]), 3]
        off = (drawn - values[0]) / np.exp(max(values[1], -6.0))
        return float((values[1] + np.log1p(off**2)).sum())

    best = _least(cost, [(-4.5, -1.0), (-4.0, -0.5)])
    return np.array([best[0], np.exp(best[1])])


def _least(cost: Callable[[FloatArray], float], starts: list[tuple[float, ...]]) -> FloatArray:
    found = [scipy.optimize.minimize(cost, start, method="Nelder-Mead") for start in starts]
    return np.asarray(min(found, key=lambda one: one.fun).x)


def fitted(errors: FloatArray) -> dict[str, Any]:
    """Values and 95 % intervals, as written to the file."""
    rng = np.random.default_rng(1)
    drawn = [errors[rng.integers(len(errors), size=len(errors))] for _ in range(RESAMPLED)]
    out: dict[str, Any] = {"strikes": len(errors)}
    for fit, name, keys in (
        (other_part, "other_part", ("fraction", "std_radii")),
        (parting, "parting", ("fraction", "holding_std_radii", "slipping_std_radii")),
        (duration, "log_duration", ("centre", "half_width")),
    ):
        values = fit(errors)
        low, high = np.quantile([fit(one) for one in drawn], (0.025, 0.975), axis=0)
        out[name] = {
            key: {
                "value": round(float(v), 4),
                "interval_95": [round(float(a), 4), round(float(b), 4)],
            }
            for key, v, a, b in zip(keys, values, low, high, strict=True)
        }
    return out


def main() -> None:
    """Follow what is not yet in the store, fit, and print or write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("store", type=Path)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--write", action="store_true", help=f"write {OUTPUT.name}")
    options = parser.parse_args()
    options.store.mkdir(parents=True, exist_ok=True)
    rows = []
    for clip, truth in strikes(options.folders):
        try:
            rows.append(face_errors(followed(clip, options.store), truth))
        except ImpactVisionError as problem:
            print(f"{clip.name}: left out: {problem}", flush=True)
            continue
        off, std, shift, _ = rows[-1]
        print(f"{clip.name}: face {off:+.3f} ({std:.3f} stated), shift {shift:+.3f}", flush=True)
    out = fitted(np.array(rows))
    text = json.dumps(out, indent=1) + "\n"
    print(text)
    if options.write:
        OUTPUT.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
