"""Rooms drawn at random, measured: do the intervals that are stated hold the truth?

Run: python -m bench.rooms.intervals [--rooms 40] [--first 0] [--keep FOLDER]

Each room is measured with what anybody knows: the rate, the ball's name and, where its lines can be
seen, the wall's pitch. No tape, no pendulum, no lens. A clip that the folder holds already is not
filmed again.
"""

from pathlib import Path

from bench.measure import printed_overview
from bench.measure_truth import Case, rendered
from bench.rooms.__main__ import filmed_room, rooms_asked_for
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
    with rooms_asked_for((__doc__ or "").splitlines()[0]) as (seeds, folder):
        printed_overview(room_case(seed, folder) for seed in seeds)


if __name__ == "__main__":
    main()
