"""Rooms drawn at random, filmed and followed: are ball and mass, and nothing else taken for them?

Run: python -m bench.rooms [--rooms 40] [--first 0] [--keep FOLDER] [--traced]

A clip that the folder holds already is not filmed again. With --traced, rooms and strikes are those
of `bench.rooms.traced`, which share nothing with the project's renderer (mitsuba must be there).

Of the ball, the part of the frames from the first touch on, in which it is wholly in view, that are
followed to within half its radius; it is followed where that is 0.9, and something else is where
more than half of what was followed then lies further off.

Each clip is written as H.264, read back and followed unattended. The mass counts as followed where
its track is one fixed point of it, to a pixel, for ten frames on either side of the strike, of the
thirty before and those from the thirteenth to the thirtieth after the first touch; a track further
off than three pixels is one of something else.
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
"""Contrast of lines that nobody would lay a pitch to."""


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
    ball: "JudgedBall | None" = None

    @property
    def verdict(self) -> str:
        """In a word or two."""
        return _verdict(self.followed, self.wrong)


@dataclass(frozen=True)
class JudgedBall:
    """How the ball was followed from the first touch on.

    Attributes
    ----------
    near : float
        Part of the frames that are followed to within half a radius.
    wrong : bool
        Whether most of what was followed then is something else.
    """

    near: float
    wrong: bool

    @property
    def verdict(self) -> str:
        """In a word or two."""
        return _verdict(self.near >= NEARLY_ALL, self.wrong)


def _verdict(followed: bool, wrong: bool) -> str:
    if followed:
        return "followed"
    return "WRONG" if wrong else "not followed"


def judged_ball(ball: Track, truth: FrameTruth, shape: tuple[int, int]) -> JudgedBall:
    """Hold the ball's track against where it was, from the first touch on."""
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
    """Hold a track against where the mass was, near the strike."""
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
    """What is left of gaps (N, 2) after the best point fixed in a body that has turned, px.

    Seen aslant, such a point goes round an ellipse: cosine and sine are free along x and y.
    """
    axes = np.column_stack([np.cos(turn), np.sin(turn)])
    left = gap - axes @ np.linalg.lstsq(axes, gap, rcond=None)[0]
    return float(np.sqrt(np.mean((left**2).sum(axis=1))))


def kept_truth(clip: Path) -> FrameTruth:
    """What the file beside a clip says of each frame; NaN where it says nothing."""
    told = json.loads(truth_path(clip).read_text())["frames"]
    columns = {}
    for field in fields(FrameTruth):
        rows = told["time_s" if field.name == "time" else field.name]
        nowhere = np.full(np.shape(next(row for row in rows if row is not None)), np.nan)
        columns[field.name] = np.array([nowhere if row is None else row for row in rows], float)
    return FrameTruth(**columns)


@dataclass(frozen=True)
class FilmedRoom:
    """A clip of a room, and what anybody in it knows.

    Attributes
    ----------
    pitch : float or None
        Of the wall's grid, m; None where nobody would lay a rule to it.
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
    """Seeds that the command line asks for, and who films them into which folder."""

    seeds: range
    folder: Path
    traced: bool

    def filmed(self, seed: int) -> FilmedRoom:
        """Draw a room and film it, unless the folder holds its clip."""
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
    """What the command line asks for; clips that need not be kept go at the end."""
    parser = argparse.ArgumentParser(description=described)
    parser.add_argument("--rooms", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="seed of the first room")
    parser.add_argument("--keep", type=Path, help="folder in which the clips are kept")
    parser.add_argument("--traced", action="store_true", help="rooms of the path tracer")
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
    print(f"\nMass followed in {done} of {len(rows)} rooms, something else in {wrong}.")
    balls = [row.ball for row in rows if row.ball is not None]
    done, wrong = sum(ball.near >= NEARLY_ALL for ball in balls), sum(ball.wrong for ball in balls)
    print(f"Ball followed in {done} of {len(rows)} rooms, something else in {wrong}.")


if __name__ == "__main__":
    main()
