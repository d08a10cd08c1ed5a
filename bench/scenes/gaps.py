"""Clips in which the ball is not seen for a part of its flight: hidden, or pictures lost.

Run: python -m bench.scenes.gaps [FOLDER...] [--only CLIP...] [--ways WAY...] [--seed N]

In the middle of the flight an eighth of the pictures of the clips of the folders, and of those
shipped, is lost or hidden; where, the seed draws. Every quantity is compared with the truth.
"""

import argparse
import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.altered import FAR, NEAR, Pictures, Way, read, written
from bench.measure_truth import Case, cases
from metrology import ImpactVisionError
from pipelines.measure.chain import measure_clip

FloatArray = NDArray[np.float64]
SHARE, FEW = 0.125, 3
SIDES = 0.9
"""Radii on either side that a post is wider than the way behind it."""


@dataclass(frozen=True)
class Gap:
    """From which picture up to, not including, which the ball is not seen.

    Attributes
    ----------
    places : (n, 2) array
        Where it is meanwhile, px.
    radius : float
        px.
    """

    first: int
    end: int
    places: FloatArray
    radius: float
    rng: np.random.Generator

    @property
    def columns(self) -> tuple[int, int]:
        """First column, and the one after the last, that hide it."""
        x = self.places[:, 0]
        return int(max(x.min() - SIDES * self.radius, 0)), int(x.max() + SIDES * self.radius)


def post(pictures: Pictures, gap: Gap) -> Pictures:
    """Something textured that stands from top to bottom before the flight."""
    left, right = gap.columns
    shape = pictures[0][:, left:right].shape
    grain = cv2.GaussianBlur(gap.rng.normal(size=shape), (0, 0), 2.0)
    hidden = []
    for picture in pictures:
        shown = picture.copy()
        noisy = 90.0 + 12.0 * grain / grain.std() + gap.rng.normal(0.0, 1.5, shape)
        shown[:, left:right] = np.clip(noisy, 0, 255).astype(np.uint8)
        hidden.append(shown)
    return hidden


def arm(pictures: Pictures, gap: Gap) -> Pictures:
    """Something dark that comes from above as the ball arrives, hides it, and goes."""
    left, right = gap.columns
    height = pictures[0].shape[0]
    low = min(int(gap.places[:, 1].max() + 2.0 * gap.radius), height)
    grain = cv2.GaussianBlur(gap.rng.normal(size=(height, right - left)), (0, 0), 3.0)
    coming = 8
    hidden = []
    for index, picture in enumerate(pictures):
        away = max(gap.first - index, index - gap.end + 1, 0)
        depth = int(low * max(1.0 - away / coming, 0.0))
        shown = picture.copy()
        part = shown[:depth, left:right]
        dark = 60.0 + 15.0 * grain[height - depth :, : part.shape[1]] / grain.std()
        noisy = dark + gap.rng.normal(0.0, 1.5, part.shape)
        part[:] = np.clip(noisy, 0, 255).astype(np.uint8)
        hidden.append(shown)
    return hidden


@dataclass(frozen=True)
class Missing:
    """A way in which the ball is not seen: painted over, or so many pictures left out."""

    name: str
    painted: Callable[[Pictures, Gap], Pictures] | None = None
    times_kept: bool = True
    few: bool = False


WAYS = (
    Missing("a post before the flight", post),
    Missing("an arm before the flight", arm),
    Missing("pictures lost, times kept"),
    Missing("pictures lost without a trace", times_kept=False),
    Missing("three pictures lost without a trace", times_kept=False, few=True),
)


def drawn_gap(case: Case, way: Missing, count: int, seed: int) -> Gap:
    """Where the ball is not seen."""
    rng = np.random.default_rng(seed)
    flight = np.flatnonzero(np.isfinite(case.centre_px[:, 0]))
    length = FEW if way.few else min(max(round(SHARE * count), 4), int(0.6 * len(flight)))
    middle = flight[0] + rng.uniform(0.3, 0.7) * len(flight)
    first = int(np.clip(middle - length / 2, flight[0] + 6, flight[-1] - 6 - length))
    there = np.arange(first, first + length)
    return Gap(first, first + length, case.centre_px[there], ball_radius(case, flight), rng)


def ball_radius(case: Case, flight: NDArray[np.int64]) -> float:
    """Usual radius in flight, px, as the truth file has it."""
    path = case.path.with_name("truth.json")
    if not path.exists():
        path = case.path.with_suffix(".truth.json")
    frames = json.loads(path.read_text())["frames"]
    rows = frames.get("r_px") or frames["radius_px"]
    return float(np.nanmedian(np.array([np.nan if one is None else one for one in rows])[flight]))


def with_gap(case: Case, way: Missing, seed: int, folder: Path) -> Case:
    """The same case with another clip."""
    pictures = read(case.path)
    gap = drawn_gap(case, way, len(pictures), seed)
    stamps = list(range(len(pictures)))
    if way.painted is not None:
        pictures = way.painted(pictures, gap)
    else:
        kept = [index for index in stamps if not gap.first <= index < gap.end]
        pictures = [pictures[index] for index in kept]
        stamps = kept if way.times_kept else list(range(len(kept)))
    path = folder / f"{case.name}-{WAYS.index(way)}.mp4".replace(" ", "_")
    return replace(case, path=written(pictures, stamps, path, Way(way.name)))


def main() -> None:
    """Print a row for each clip and way."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="*")
    parser.add_argument("--only", nargs="*", default=[""], help="names of clips, or parts of them")
    parser.add_argument("--ways", nargs="*", default=[""], help="names of ways, or parts of them")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    print("| clip | way | as the truth, within 2 | beyond 4 | missing |\n|---|---|---|---|---|")
    near = count = far = 0
    for case in cases(*chosen.folders):
        if not any(part in case.name for part in chosen.only):
            continue
        for way in (way for way in WAYS if any(part in way.name for part in chosen.ways)):
            off, lost = judged(case, way, chosen.seed)
            beyond = [f"{name} {z:+.1f}" for name, z in off.items() if abs(z) > FAR]
            held = sum(abs(z) <= NEAR for z in off.values())
            print(
                f"| {case.name} | {way.name} | {held} of {len(off)} | {', '.join(beyond)} "
                f"| {lost} |",
                flush=True,
            )
            near, count, far = near + held, count + len(off), far + len(beyond)
    print(f"\nWithin 2: {100 * near / max(count, 1):.1f} % of {count}; beyond 4: {far}.")


def judged(case: Case, way: Missing, seed: int) -> tuple[dict[str, float], int]:
    """How far each quantity is from the truth, in stated uncertainties, and how many are lost."""
    with tempfile.TemporaryDirectory() as scratch:
        other = with_gap(case, way, seed, Path(scratch))
        try:
            found = measure_clip(other.path, other.options).quantities
        except ImpactVisionError:
            return {}, len(case.truth)
    told = [one for one in found if one.name in case.truth]
    off = {
        one.name: (one.value - case.truth[one.name]) / max(one.std or 0.0, 1e-12)
        for one in told
        if one.value is not None
    }
    return off, len(told) - len(off)


if __name__ == "__main__":
    main()
