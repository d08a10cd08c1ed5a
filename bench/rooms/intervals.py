"""Rooms drawn at random, measured: do the intervals that are stated hold the truth?

Run: python -m bench.rooms.intervals [--rooms 40] [--first 0] [--keep FOLDER]

Each room is measured with what anybody knows: the rate, the ball's name and, where its lines can be
seen, the wall's pitch. No tape, no pendulum, no lens. A clip that the folder holds already is not
filmed again.
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench.measure import printed_overview
from bench.measure_truth import Case, rendered
from bench.rooms.__main__ import filmed_room
from pipelines.measure.chain import MeasureOptions
from pipelines.setup.tables import CameraSetup, Setup, WallSetup
from sample_videos.truth import truth_path

FAINT = 0.03
"""Contrast of lines that nobody would lay a pitch to."""


def room_case(seed: int, folder: Path) -> Case:
    """A room with what anybody knows of it."""
    room, path = filmed_room(seed, folder)
    wall = room.scene.room.wall
    pitch = wall.pitch if wall.contrast > FAINT else None
    setup = Setup(camera=CameraSetup(room.scene.shutter.fps), wall=WallSetup(pitch))
    options = MeasureOptions(setup=setup, ball=room.scene.ball.name)
    return rendered(truth_path(path), f"{seed}", options)


def main() -> None:
    """Print a row for each room and what holds over all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rooms", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="seed of the first room")
    parser.add_argument("--keep", type=Path, help="folder in which the clips are kept")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) if chosen.keep is None else chosen.keep
        folder.mkdir(parents=True, exist_ok=True)

        def cases() -> Iterator[Case]:
            for seed in range(chosen.first, chosen.first + chosen.rooms):
                yield room_case(seed, folder)

        printed_overview(cases())


if __name__ == "__main__":
    main()
