"""Render random rooms and count how often ball and pendulum mass are followed.

Run: python -m bench.rooms [--rooms 40] [--first 0] [--keep FOLDER] [--traced]

Clips already in the folder are not rendered again. With --traced, rooms and strikes come from
`bench.rooms.traced`, which shares no code with the project's renderer and needs mitsuba.

Each clip is written as H.264, read back and followed unattended. The ball counts as followed if its
track is within half a radius of the truth in 90 % of the frames after first contact in which it is
entirely in view, and as wrong if more than half of its frames are further away. The mass counts as
followed if its track is a fixed point of the mass, to 1 px, in at least ten frames each before and
after the strike (of the 30 before first contact and of frames 13 to 30 after it), and as wrong if
the root mean square deviation from a fixed point exceeds 3 px.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.rooms.draw import draw_room
from bench.rooms.traced import draw_traced, film_traced
from metrology import MeasurementError
from sample_videos.render import render_clip
from sample_videos.truth import FrameTruth, truth_path
from vision.clip.clip import ClipReader
from vision.following import follow
from vision.tracks import PendulumTrack, Track

FloatArray = NDArray[np.float64]
GOOD_PX, WRONG_PX = 1.0, 3.0
SIDE_FRAMES, FROM_FRAMES, TO_FRAMES = 10, 12, 30
NEARLY_ALL = 0.9
FAINT = 0.03
"""Contrast of grid lines below which a user would not give their spacing; chosen."""


@dataclass(frozen=True)
class Judged:
    """Result for the mass in one room.

    Attributes
    ----------
    followed, wrong : bool
    off_px : float
        Root mean square deviation from a fixed point of the mass; NaN if no mass was followed.
    words : str
    """

    followed: bool
    wrong: bool
    off_px: float
    words: str
    ball: "JudgedBall | None" = None

    @property
    def verdict(self) -> str:
        """Short result."""
        return _verdict(self.followed, self.wrong)


@dataclass(frozen=True)
class JudgedBall:
    """Result for the ball after first contact.

    Attributes
    ----------
    near : float
        Fraction of the frames followed to within half a radius.
    wrong : bool
        Whether more than half of the followed frames are further away.
    """

    near: float
    wrong: bool

    @property
    def verdict(self) -> str:
        """Short result."""
        return _verdict(self.near >= NEARLY_ALL, self.wrong)


def _verdict(followed: bool, wrong: bool) -> str:
    if followed:
        return "followed"
    return "WRONG" if wrong else "not followed"


def judged_ball(ball: Track, truth: FrameTruth, shape: tuple[int, int]) -> JudgedBall:
    """Compare the ball's track with the truth after first contact."""
    radius, place = truth.radius_px, truth.outline_px
    inside = np.all(place > radius[:, None], axis=1)
    inside &= np.all(place < np.array(shape)[::-1] - 1 - radius[:, None], axis=1)
    wanted = np.flatnonzero(inside & (truth.time >= 0.0))
    frame = ball.frame[ball.frame < len(truth.time)]
    away = np.hypot(*(ball.centre_px[: len(frame)] - place[frame]).T)
    near = np.isin(wanted, frame[away < 0.5 * radius[frame]])
    there = truth.time[frame] >= 0.0
    off = away[there] >= 0.5 * radius[frame][there]
    return JudgedBall(float(np.mean(near)), bool(len(off) and np.mean(off) > 0.5))


def judged(pendulum: PendulumTrack | None, truth: FrameTruth, fps: float, mirrored: bool) -> Judged:
    """Compare the pendulum's track with the mass near the strike."""
    if pendulum is None:
        return Judged(False, False, float("nan"), "not found")
    frame = pendulum.track.frame
    since = truth.time[frame] * fps
    near = np.abs(since) < TO_FRAMES
    before = int(np.count_nonzero(near & (since < 0.0)))
    after = int(np.count_nonzero(near & (since > FROM_FRAMES)))
    if before < 3:
        return Judged(False, False, float("nan"), f"{before} frames before, {after} after")
    gap = pendulum.track.centre_px[near] - truth.mass_px[frame[near]]
    off = _off_a_fixed_point(gap, truth.phi_rad[frame[near]] * (-1.0 if mirrored else 1.0))
    enough = before >= SIDE_FRAMES and after >= SIDE_FRAMES
    words = f"{before} frames before, {after} after"
    return Judged(enough and off < GOOD_PX, off > WRONG_PX, off, words)


def _off_a_fixed_point(gap: FloatArray, turn: FloatArray) -> float:
    """Root mean square of gaps (N, 2) after a fit of a point fixed in the rotating body, px.

    Seen obliquely, such a point describes an ellipse: cosine and sine are free along x and y.
    """
    axes = np.column_stack([np.cos(turn), np.sin(turn)])
    left = gap - axes @ np.linalg.lstsq(axes, gap, rcond=None)[0]
    return float(np.sqrt(np.mean((left**2).sum(axis=1))))


def kept_truth(clip: Path) -> FrameTruth:
    """True values in each frame from the truth file; NaN where there is none."""
    stored = json.loads(truth_path(clip).read_text())["frames"]
    columns = {}
    for field in fields(FrameTruth):
        rows = stored["time_s" if field.name == "time" else field.name]
        nowhere = np.full(np.shape(next(row for row in rows if row is not None)), np.nan)
        columns[field.name] = np.array([nowhere if row is None else row for row in rows], float)
    return FrameTruth(**columns)


@dataclass(frozen=True)
class FilmedRoom:
    """A clip of a room with what a user knows about it.

    Attributes
    ----------
    pitch : float or None
        Spacing of the wall's grid, m; None if its lines are too faint.
    mirrored : bool
        Whether the pendulum comes from the right.
    """

    path: Path
    words: str
    ball: str
    fps: float
    pitch: float | None
    mirrored: bool


@dataclass(frozen=True)
class RoomsAskedFor:
    """Seeds, output folder and renderer requested on the command line."""

    seeds: range
    folder: Path
    traced: bool

    def filmed(self, seed: int) -> FilmedRoom:
        """Draw a room and render it unless its clip is in the folder."""
        return self._traced(seed) if self.traced else self._drawn(seed)

    def _drawn(self, seed: int) -> FilmedRoom:
        room = draw_room(seed)
        path = self.folder / f"room_{seed:03d}.mp4"
        if not truth_path(path).exists():
            render_clip(room.scene, room.shot, path)
        scene, wall = room.scene, room.scene.room.wall
        pitch = wall.pitch if wall.contrast > FAINT else None
        return FilmedRoom(
            path, room.words, scene.ball.name, scene.shutter.fps, pitch, scene.mirrored
        )

    def _traced(self, seed: int) -> FilmedRoom:
        room = draw_traced(seed)
        path = self.folder / f"traced_{seed:03d}.mp4"
        if not truth_path(path).exists():
            film_traced(room, path)
        return FilmedRoom(path, room.words, room.ball, room.fps, room.pitch, room.mirrored)


def followed_room(room: FilmedRoom) -> Judged:
    """Follow a room's pendulum and ball."""
    truth = kept_truth(room.path)
    try:
        tracks = follow(ClipReader.open(room.path), room.fps)
    except MeasurementError as problem:
        return Judged(False, False, float("nan"), f"{room.words}: {problem.in_one_line}")
    found = judged(tracks.pendulum, truth, room.fps, room.mirrored)
    ball = judged_ball(tracks.ball, truth, tracks.background.shape)
    return replace(found, words=f"{room.words}: {found.words}", ball=ball)


@contextmanager
def rooms_asked_for(described: str) -> Iterator[RoomsAskedFor]:
    """Parse the command line; clips are deleted at the end unless --keep is given."""
    parser = argparse.ArgumentParser(description=described)
    parser.add_argument("--rooms", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="seed of the first room")
    parser.add_argument("--keep", type=Path, help="folder for the clips")
    parser.add_argument(
        "--traced", action="store_true", help="rooms of the path tracer (needs mitsuba)"
    )
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) if chosen.keep is None else chosen.keep
        folder.mkdir(parents=True, exist_ok=True)
        seeds = range(chosen.first, chosen.first + chosen.rooms)
        yield RoomsAskedFor(seeds, folder, chosen.traced)


def main() -> None:
    """Print a line for each room and the count."""
    with rooms_asked_for((__doc__ or "").splitlines()[0]) as asked:
        rows = []
        for seed in asked.seeds:
            rows.append(followed_room(asked.filmed(seed)))
            row = rows[-1]
            ball = "–" if row.ball is None else f"{row.ball.verdict} {row.ball.near:.2f}"
            print(
                f"| {seed} | {row.verdict} | {row.off_px:.2f} px | ball {ball} | {row.words} |",
                flush=True,
            )
    done, wrong = sum(row.followed for row in rows), sum(row.wrong for row in rows)
    print(f"\nMass followed in {done} of {len(rows)} rooms, wrong in {wrong}.")
    balls = [row.ball for row in rows if row.ball is not None]
    done, wrong = sum(ball.near >= NEARLY_ALL for ball in balls), sum(ball.wrong for ball in balls)
    print(f"Ball followed in {done} of {len(rows)} rooms, wrong in {wrong}.")


if __name__ == "__main__":
    main()
