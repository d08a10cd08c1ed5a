"""Score followed objects against their true positions."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bench.scenes.truths import Truth
from metrology import MeasurementError
from vision.clip.clip import ClipReader
from vision.following import follow
from vision.tracks import Track, Tracks

FloatArray = NDArray[np.float64]
HEAD = (
    "| clip | object | motion | near | RMS px | within | 2σ | > 8σ | radius px | mass | CPU s |\n"
    "|---|---|---|---|---|---|---|---|---|---|---|"
)
# Squared Mahalanobis distance that a two-dimensional normal exceeds with probability 4.55 %.
TWO_SIGMA_SQUARE = float(chi2.ppf(0.9545, 2))


@dataclass(frozen=True)
class Score:
    """Agreement of one followed object with its truth."""

    near: float
    rms: float
    within: float
    covered: float
    beyond: int
    frames: int


def score(track: Track, truth: Truth, shift: FloatArray | None) -> Score:
    """Compare a track with the truth; frames without a detection count as not near."""
    _, own, theirs = np.intersect1d(track.frame, truth.frame, return_indices=True)
    place = track.centre_px[own] + (0.0 if shift is None else shift[track.frame[own]])
    gap = place - truth.centre[theirs]
    distance = np.hypot(*gap.T)
    near = distance < 0.5 * truth.radius[theirs]
    limit = np.maximum(1.0, 1.5 * truth.std[theirs])
    covariance = track.covariance_px2[own] + truth.std[theirs][:, None, None] ** 2 * np.eye(2)
    square = np.einsum("ni,nij,nj->n", gap, np.linalg.inv(covariance), gap)
    count = max(len(truth.frame), 1)
    return Score(
        near.sum() / count,
        float(np.sqrt(np.mean(distance[near] ** 2))) if near.any() else np.nan,
        float(np.sum(distance <= limit)) / count,
        float(np.mean(square <= TWO_SIGMA_SQUARE)) if len(own) else np.nan,
        int(np.sum(square > 64.0)),
        len(own),
    )


def scored(tracks: Tracks, truths: list[Truth]) -> Iterator[tuple[Truth, str, Score]]:
    """Each true object with the name and score of the nearest followed object."""
    followed = [("ball", tracks.ball)]
    followed += [(f"ball_{i + 2}", other.track) for i, other in enumerate(tracks.others)]
    for truth in truths:
        results = [
            (name, score(track, truth, None if truth.steady else tracks.shift_px))
            for name, track in followed
        ]
        main = results[0]
        best = max(results, key=lambda result: (result[1].near, result[1].within))
        named = main if len(truths) == 1 else best
        yield truth, named[0], named[1]


@dataclass
class Coverage:
    """Coverage of the stated uncertainties over all clips of a table."""

    frames: int = 0
    covered: float = 0.0
    beyond: int = 0
    objects: int = 0
    well: int = 0

    def add(self, got: Score) -> None:
        """Add one object; it counts as followed if 90 % of its frames are within the limit."""
        self.objects += 1
        self.well += got.within >= 0.9
        self.beyond += got.beyond
        if got.frames:
            self.frames += got.frames
            self.covered += got.covered * got.frames

    @property
    def summary(self) -> str:
        """One line."""
        fraction = self.covered / max(self.frames, 1)
        return (
            f"{self.well} of {self.objects} objects within the limit; {100 * fraction:.1f} % of "
            f"{self.frames} frames within 2σ (nominal 95.4 %), {self.beyond} beyond 8σ"
        )


def following_lines(
    clip: Path, name: str, truths: list[Truth], rate: float, coverage: Coverage
) -> Iterator[str]:
    """Table rows of one clip; its objects are added to `coverage`."""
    start = time.process_time()
    try:
        tracks = follow(ClipReader.open(clip), rate)
    except MeasurementError as problem:
        coverage.objects += len(truths)
        yield f"| {name} | – | {problem.in_one_line} |"
        return
    spent = time.process_time() - start
    motion = f"{tracks.motion.kind.value} {tracks.motion.probability:.2f}"
    for truth, place, got in scored(tracks, truths):
        coverage.add(got)
        yield (
            f"| {name} | {truth.name}: {place} | {motion} | {got.near:.2f} of {len(truth.frame)} | "
            f"{got.rms:.3f} | {got.within:.2f} | {got.covered:.2f} | {got.beyond} | "
            f"{float(np.median(tracks.ball.radius_px)):.1f} | "
            f"{'yes' if tracks.pendulum is not None else 'no'} | {spent:.1f} |"
        )
    if not truths:
        yield f"| {name} | no truth | {motion} | | | | | | | | {spent:.1f} |"
