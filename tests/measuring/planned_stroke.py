"""A stroke that is planned and not filmed: its tracks and its grid are what the plan says."""

from functools import cache

import numpy as np
import pytest

from calib.grid import WallGrid
from calib.solve import planned_grid
from measuring import metres
from measuring.chain import FollowedClip, Found, measure_tracks
from measuring.inputs import Inputs, gather_inputs
from pipelines.calibrate.plan import Filming, film_scene, planned_setup, planned_tracks
from sample_videos import Scene, Shot
from vision.clip.footage import CaptureRate
from vision.tracks import Tracks

TRUE_FPS = 300.0
FILMING = Filming(width=432, height=240, tape_std_m=0.005, fps=TRUE_FPS)


@cache
def planned() -> tuple[Scene, Shot]:
    return film_scene(FILMING)


@cache
def tracks_as_planned() -> Tracks:
    return planned_tracks(FILMING, *planned())


@cache
def inputs_as_planned() -> Inputs:
    return gather_inputs(planned_setup(FILMING, planned()[0]), None, None)


def measured(
    tracks: Tracks,
    rate: CaptureRate,
    inputs: Inputs | None = None,
    grid_for: pytest.MonkeyPatch | None = None,
) -> Found:
    """What the chain makes of tracks; the planned grid is seen where `grid_for` can show it."""
    scene = planned()[0]
    if grid_for is not None:
        grid = planned_grid(scene.camera)

        def seen(*_: object, **__: object) -> WallGrid:
            return grid

        grid_for.setattr(metres, "find_wall_grid", seen)
    clock = np.arange(scene.frames, dtype=float)
    return measure_tracks(FollowedClip(tracks, clock, rate, inputs or inputs_as_planned()))
