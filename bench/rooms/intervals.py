"""Measure random rooms and test whether the stated intervals contain the truth.

Run: python -m bench.rooms.intervals [--rooms 40] [--first 0] [--keep FOLDER] [--traced]

Each room is measured with the frame rate, the ball's name and, if its lines are visible, the
spacing of the wall grid; no distances, pendulum or lens are given. Clips already in the folder are
not rendered again.
"""

from bench.measure import printed_overview
from bench.measure_truth import Case, rendered
from bench.rooms.__main__ import FilmedRoom, rooms_asked_for
from pipelines.measure.chain import MeasureOptions
from pipelines.setup.tables import CameraSetup, Setup, WallSetup
from sample_videos.truth import truth_path


def room_case(room: FilmedRoom) -> Case:
    """A room with the options a user could give."""
    setup = Setup(camera=CameraSetup(room.fps), wall=WallSetup(room.pitch))
    options = MeasureOptions(setup=setup, ball=room.ball)
    return rendered(truth_path(room.path), room.path.stem.rpartition("_")[2], options)


def main() -> None:
    """Print a row for each room and the statistics of all."""
    with rooms_asked_for((__doc__ or "").splitlines()[0]) as asked:
        printed_overview(room_case(asked.filmed(seed)) for seed in asked.seeds)


if __name__ == "__main__":
    main()
