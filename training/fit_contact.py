"""Fit the priors of a strike's face: python -m training.fit_contact STORE FOLDER [--write].

A folder holds ray-traced strikes with their truth (clip.mp4, setup.json, truth.json); of labs drawn
at random seeds 0 to 999 train. STORE keeps the tracks of each. At the true onset and release the
paths say where the face was; its distance from where it was seen, and its shift between the two,
are each a mixture of two normal distributions with the mean 0: the seen face with its stated
uncertainty or another part of the mass, and a track that holds or one that slips. The logarithm of
the contact time is Cauchy's, since other balls may be far softer or harder. The mass beside the
ball moves its outline while they touch, by half a sine. Maximum likelihood, with 95 % intervals by
resampling of strikes, goes to measuring/face_prior.json.
"""

import argparse
import json
import math
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

import measuring
from measuring import chain, impact
from measuring.setup.tables import Setup
from metrology import ImpactVisionError
from training.fit_striker import strikes
from vision.tracks import Track

FloatArray = NDArray[np.float64]

OUTPUT = Path(measuring.__file__).with_name("face_prior.json")
RESAMPLED = 200


def setup_of(written: dict[str, Any]) -> Setup:
    """The set-up of what a laboratory wrote down."""
    pendulum, ball = written["pendulum"], written["ball"]
    grid = written["grid_pitch_m"]
    return Setup().having(
        {
            "camera.capture_fps": written["camera_nominal_fps"],
            "camera.distance_to_wall": f"{written['camera_to_wall_m']} m ± 5 mm",
            "wall.grid": f"{grid} m" if grid else None,
            "wall.ball_plane_offset": f"{written['ball_plane_to_wall_m']} m ± 5 mm",
            "ball.mass": f"{ball['mass_kg']} kg",
            "ball.diameter": f"{ball['diameter_m']} m",
            "pendulum.length": f"{pendulum['length_to_contact_m']} m",
            "pendulum.inertia": f"{pendulum['inertia_kg_m2']} kg m^2",
            "pendulum.mass": f"{pendulum['total_mass_kg']} kg",
            "pendulum.com": f"{pendulum['com_from_pivot_m']} m",
            "support.height": f"{written['support_height_m']} m",
        }
    )


def followed(clip: Path, store: Path) -> chain.FollowedClip:
    """The tracks of a recording, followed once."""
    kept = store / f"{clip.parent.name}_{clip.name}.pkl"
    if not kept.exists():
        written = json.loads((clip / "setup.json").read_text("utf-8"))
        options = chain.MeasureOptions(setup=setup_of(written))
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
    """Centre and half width of the logarithm of contact times, s, by its quartiles (Cauchy)."""
    low, middle, high = np.nanquantile(errors[:, 3], (0.25, 0.5, 0.75))
    return np.array([middle, 0.5 * (high - low)])


@dataclass(frozen=True)
class PathErrors:
    """Errors of the ball's outline along its flight around a contact, stated std.

    Attributes
    ----------
    off : (N,) array
    phase : (N,) array
        0 at onset, 1 at release.
    """

    off: FloatArray
    phase: FloatArray

    def covariance(self, stds: FloatArray) -> FloatArray:
        """Of random errors, and of an offset, a drift and a bump during contact, of a strike."""
        touching = np.clip(self.phase, 0.0, 1.0)
        shapes = (np.ones_like(touching), self.phase - 0.5, np.sin(np.pi * touching))
        total = stds[0] ** 2 * np.eye(len(self.phase))
        for std, shape in zip(stds[1:], shapes, strict=True):
            total += std**2 * np.outer(shape, shape)
        return np.asarray(total)


def path_errors(track: Track, truth: dict[str, Any]) -> PathErrors:
    """Errors from one contact time before onset to one after release."""
    seen, contact = truth["frames"], truth["contact"]
    on, lasting = contact["frame_on"], contact["frame_off"] - contact["frame_on"]
    phase = (track.frame - on) / lasting
    near = (phase > -1.0) & (phase < 2.0)
    true = np.column_stack([seen["u_px"], seen["v_px"]])
    after = math.ceil(contact["frame_off"])
    way = true[min(after + 5, len(true) - 1)] - true[after]
    way = way / np.hypot(*way)
    off = (track.centre_px[near] - true[track.frame[near]]) @ way
    std = np.sqrt(np.einsum("i,nij,j->n", way, track.covariance_px2[near], way))
    return PathErrors(off / np.median(std), phase[near])


def beside_mass(strikes_seen: list[PathErrors]) -> FloatArray:
    """Std of the bump that the mass makes beside the ball, over the outline's stated std.

    Student's t with four degrees of freedom a strike, since some tracks are far worse than others.
    """

    def cost(logs: FloatArray) -> float:
        total = 0.0
        for one in strikes_seen:
            spread = one.covariance(np.exp(logs))
            count, size = len(one.off), one.off @ np.linalg.solve(spread, one.off)
            total += 0.5 * np.linalg.slogdet(spread)[1] + 0.5 * (4 + count) * np.log1p(size / 4.0)
        return float(total)

    return np.exp(_least(cost, [(0.0, 0.0, 0.0, -0.5), (-0.5, 0.5, 0.5, 0.5)])[3:])


def _least(cost: Callable[[FloatArray], float], starts: list[tuple[float, ...]]) -> FloatArray:
    found = [scipy.optimize.minimize(cost, start, method="Nelder-Mead") for start in starts]
    return np.asarray(min(found, key=lambda one: one.fun).x)


def fitted(errors: FloatArray, paths: list[PathErrors]) -> dict[str, Any]:
    """Values and 95 % intervals, as written to the file."""
    rng = np.random.default_rng(1)
    drawn = [errors[rng.integers(len(errors), size=len(errors))] for _ in range(RESAMPLED)]
    out: dict[str, Any] = {"strikes": len(errors)}
    for fit, name, keys in (
        (other_part, "other_part", ("fraction", "std_radii")),
        (parting, "parting", ("fraction", "holding_std_radii", "slipping_std_radii")),
        (duration, "log_duration", ("centre", "half_width")),
    ):
        out[name] = _stated(keys, fit(errors), [fit(one) for one in drawn])
    few = [[paths[i] for i in rng.integers(len(paths), size=len(paths))] for _ in range(40)]
    bumps = [beside_mass(one) for one in few]
    out["beside_mass"] = _stated(("over_std",), beside_mass(paths), bumps)
    return out


def _stated(
    keys: tuple[str, ...], values: FloatArray, resampled: list[FloatArray]
) -> dict[str, dict[str, Any]]:
    low, high = np.quantile(resampled, (0.025, 0.975), axis=0)
    return {
        key: {
            "value": round(float(value), 4),
            "interval_95": [round(float(least), 4), round(float(most), 4)],
        }
        for key, value, least, most in zip(keys, values, low, high, strict=True)
    }


def main() -> None:
    """Follow what is not yet in the store, fit, and print or write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("store", type=Path)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--write", action="store_true", help=f"write {OUTPUT.name}")
    options = parser.parse_args()
    options.store.mkdir(parents=True, exist_ok=True)
    rows, paths = [], []
    for clip, truth in strikes(options.folders):
        try:
            seen = followed(clip, options.store)
            rows.append(face_errors(seen, truth))
        except ImpactVisionError as problem:
            print(f"{clip.name}: left out: {problem}", flush=True)
            continue
        paths.append(path_errors(seen.tracks.ball, truth))
        off, std, shift, _ = rows[-1]
        print(f"{clip.name}: face {off:+.3f} ({std:.3f} stated), shift {shift:+.3f}", flush=True)
    out = fitted(np.array(rows), paths)
    text = json.dumps(out, indent=1) + "\n"
    print(text)
    if options.write:
        OUTPUT.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
