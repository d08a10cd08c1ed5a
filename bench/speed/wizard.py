"""What the wizard's answers to a change cost, in one process that runs on.

Run: python -m bench.speed.wizard [CLIP]

Prints processor and wall time of each change, and the largest processor time last.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from calib.calibration import Known
from pipelines.calibrate.wizard.answers import Answers, BallKind, look_at
from pipelines.calibrate.wizard.session import Session, starting_corners, with_ball, with_corners

CLIP = Path(__file__).parents[2] / "sample_videos" / "clips" / "jokku_120.mp4"
JOKKU = BallKind("jokku", 0.20175, 0.312)


def changes(session: Session) -> dict[str, Callable[[], object]]:
    """What somebody does once the grid is found and the ball followed."""
    scene = session.answers.scene
    corners = starting_corners(session.answers.grid, scene.size)
    return {
        "another capture rate": lambda: session.update("rate", fps=599.0),
        "the ball is named": lambda: session.apply(
            "ball", lambda answers: with_ball(answers, JOKKU, named=True)
        ),
        "squares of another size": lambda: session.update("squares", pitch=0.0501),
        "the camera's distance is taped": lambda: session.update(
            "tape", camera_distance=Known(4.0, 0.005)
        ),
        "the ball plane is taped": lambda: session.update(
            "tape", ball_plane_offset=Known(0.5, 0.005)
        ),
        "the origin is clicked": lambda: session.update("origin", origin_px=corners[0]),
        "a handle is moved": lambda: session.apply(
            "handle", lambda answers: with_corners(replace(answers, corners=corners + 0.4))
        ),
    }


def main() -> None:
    clip = Path(sys.argv[1]) if len(sys.argv) > 1 else CLIP
    session = Session(Answers(look_at(clip, 600.0), fps=600.0))
    session.find_grid()
    session.look_for_ball()
    most = 0.0
    for name, change in changes(session).items():
        change()  # what is loaded or compiled once is not waited for again
        used, passed = time.process_time(), time.perf_counter()
        change()
        used, passed = time.process_time() - used, time.perf_counter() - passed
        most = max(most, used)
        print(f"{name}: {used:.3f} s, waited {passed:.3f} s", flush=True)
    print(f"SPENT {most:.4f}")


if __name__ == "__main__":
    main()
