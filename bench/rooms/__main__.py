"""Rooms drawn at random, filmed and followed: is the mass followed, and nothing else taken for it?

Run: python -m bench.rooms [--rooms 40] [--first 0]

Each clip is written as H.264, read back and followed unattended. The mass counts as followed where
its track is one fixed point of it, to a pixel, for ten frames on either side of the strike; a track
further off than three pixels is one of something else.
"""

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.rooms.draw import draw_room
from metrology import MeasurementError
from sample_videos.render import render_clip
from sample_videos.truth import FrameTruth
from vision.clip.clip import ClipReader
from vision.following import follow
from vision.tracks import PendulumTrack

FloatArray = NDArray[np.float64]
GOOD_PX, WRONG_PX = 1.0, 3.0
SIDE_FRAMES = 10


@dataclass(frozen=True)
class Judged:
    """How the mass was followed in one room.

    Attributes
    ----------
    followed, wrong : bool
    off_px : float
        Root mean square distance from a fixed point of the mass; NaN where nothing was followed.
    words : str
    """

    followed: bool
    wrong: bool
    off_px: float
    words: str

    @property
    def verdict(self) -> str:
        """In a word or two."""
        if self.followed:
            return "followed"
        return "WRONG" if self.wrong else "not followed"


def judged(pendulum: PendulumTrack | None, truth: FrameTruth, mirrored: bool) -> Judged:
    """Hold a track against where the mass was, near the strike."""
    if pendulum is None:
        return Judged(False, False, float("nan"), "not found")
    frame = pendulum.track.frame
    near = (truth.time[frame] > -0.05) & (truth.time[frame] < 0.05)
    before = int(np.count_nonzero(near & (truth.time[frame] < 0.0)))
    after = int(np.count_nonzero(near & (truth.time[frame] > 0.02)))
    if before < 3:
        return Judged(False, False, float("nan"), f"{before} frames before, {after} after")
    gap = pendulum.track.centre_px[near] - truth.mass_px[frame[near]]
    off = _off_a_fixed_point(gap, truth.phi_rad[frame[near]] * (-1.0 if mirrored else 1.0))
    enough = before >= SIDE_FRAMES and after >= SIDE_FRAMES
    words = f"{before} frames before, {after} after"
    return Judged(enough and off < GOOD_PX, off > WRONG_PX, off, words)


def _off_a_fixed_point(gap: FloatArray, turn: FloatArray) -> float:
    """What is left of gaps (N, 2) after the best point fixed in a body that has turned, px.

    Seen aslant, such a point goes round an ellipse: cosine and sine are free along x and y.
    """
    axes = np.column_stack([np.cos(turn), np.sin(turn)])
    left = gap - axes @ np.linalg.lstsq(axes, gap, rcond=None)[0]
    return float(np.sqrt(np.mean((left**2).sum(axis=1))))


def followed_room(seed: int, folder: Path) -> Judged:
    """Film a room and follow its pendulum."""
    room = draw_room(seed)
    path = folder / f"room_{seed:03d}.mp4"
    truth = render_clip(room.scene, room.shot, path)
    try:
        tracks = follow(ClipReader.open(path), room.scene.shutter.fps)
    except MeasurementError as problem:
        return Judged(False, False, float("nan"), f"{room.words}: {problem.in_one_line}")
    found = judged(tracks.pendulum, truth.frames, room.scene.mirrored)
    return Judged(found.followed, found.wrong, found.off_px, f"{room.words}: {found.words}")


def main() -> None:
    """Print a line for each room and the count."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rooms", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="seed of the first room")
    parser.add_argument("--keep", type=Path, help="folder in which the clips are kept")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) if chosen.keep is None else chosen.keep
        folder.mkdir(parents=True, exist_ok=True)
        rows = []
        for seed in range(chosen.first, chosen.first + chosen.rooms):
            rows.append(followed_room(seed, folder))
            word = (
                "followed" if rows[-1].followed else "WRONG" if rows[-1].wrong else "not followed"
            )
            print(f"| {seed} | {word} | {rows[-1].off_px:.2f} px | {rows[-1].words} |", flush=True)
    done, wrong = sum(row.followed for row in rows), sum(row.wrong for row in rows)
    print(f"\nMass followed in {done} of {len(rows)} rooms, something else in {wrong}.")


if __name__ == "__main__":
    main()
