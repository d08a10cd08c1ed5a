"""Rooms drawn at random, measured: do the intervals that are stated hold the truth?

Run: python -m bench.rooms.intervals [--rooms 40] [--first 0] [--keep FOLDER] [--traced]

Each room is measured with what anybody knows: the rate, the ball's name and, where its lines can be
seen, the wall's pitch. No tape, no pendulum, no lens. A clip that the folder holds already is not
filmed again.
"""

from bench.measure import printed_overview
from bench.measure_truth import Case, rendered
from bench.rooms.__main__ import FilmedRoom, rooms_asked_for
from pipelines.measure.chain import MeasureOptions
from pipelines.setup.tables import CameraSetup, Setup, WallSetup
from sample_videos.truth import truth_path


def room_case(room: FilmedRoom) -> Case:
    """A room with what anybody knows of it."""
    setup = Setup(camera=CameraSetup(room.fps), wall=WallSetup(room.pitch))
    options = MeasureOptions(setup=setup, ball=room.ball)
    return rendered(truth_path(room.path), room.path.stem.rpartition("_")[2], options)


def main() -> None:
    """Print a row for each room and what holds over all."""
    with rooms_asked_for((__doc__ or "").splitlines()[0]) as asked:
        printed_overview(room_case(asked.filmed(seed)) for seed in asked.seeds)


if __name__ == "__main__":
    main()
